// Drives both controllers from standard input, and counts what is allocated meanwhile.
//   update JOINTS: target, stiffness, damping, limit; then rows of positions and velocities
//   callback TARGETS: targets; then rows of POSITIONS positions VELOCITIES velocities
// For each row: 1 if all went well, the allocations that it took, the torques.
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <new>
#include <string>

#include "arm_controller.cpp"
#include "callback_controller.cpp"

static long allocations = 0;
// Not inlined: else the compiler sees new without its delete, and warns of a mismatch.
[[gnu::noinline]] void* operator new(std::size_t size) {
  ++allocations;
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}

static double number() {  // strtod knows nan and inf
  std::string word;
  std::cin >> word;
  return std::strtod(word.c_str(), nullptr);
}

static std::vector<double> numbers(std::size_t count) {
  std::vector<double> values(count);
  for (double& value : values) value = number();
  return values;
}

static void print(bool good, long taken, const std::vector<double>& torques) {
  std::printf("%d %ld", good ? 1 : 0, taken);
  for (double torque : torques) std::printf(" %.17g", torque);
  std::printf("\n");
  std::fflush(stdout);
}

int main(int count, char** words) {
  if (count != 4) return 2;
  const std::string mode = words[1];
  const std::size_t joints = std::stoul(words[2]), rows = std::stoul(words[3]);
  if (mode == "update") {
    ArmController controller;
    const rclcpp_lifecycle::State before_it;
    auto& given = controller.get_node()->overrides;
    std::vector<std::string> joint_names;
    for (std::size_t i = 0; i < joints; ++i) joint_names.push_back("joint" + std::to_string(i));
    given["joints"] = joint_names;
    for (const char* name : {"target", "stiffness", "damping", "limit"})
      given[name] = numbers(joints);
    using controller_interface::CallbackReturn;
    if (controller.on_init() != CallbackReturn::SUCCESS ||
        controller.on_configure(before_it) != CallbackReturn::SUCCESS) {
      std::cerr << "on_configure failed: no joint, a negative limit, or lists of different lengths\n";
      return 3;
    }
    std::vector<std::shared_ptr<hardware_interface::Handle>> states, commands;
    std::vector<hardware_interface::LoanedStateInterface> read;
    std::vector<hardware_interface::LoanedCommandInterface> write;
    for (const auto& name : controller.state_interface_configuration().names) {
      states.push_back(std::make_shared<hardware_interface::Handle>());
      states.back()->name = name;
      read.emplace_back(states.back());
    }
    for (const auto& name : controller.command_interface_configuration().names) {
      commands.push_back(std::make_shared<hardware_interface::Handle>());
      commands.back()->name = name;
      write.emplace_back(commands.back());
    }
    controller.assign_interfaces(std::move(write), std::move(read));
    if (controller.on_activate(before_it) != CallbackReturn::SUCCESS) {
      std::cerr << "on_activate failed: interfaces that do not fit the joints\n";
      return 4;
    }
    std::vector<double> torques(joints);
    for (std::size_t row = 0; row < rows; ++row) {
      for (auto& state : states) state->value = number();
      const long before = allocations;
      const auto result = controller.update(rclcpp::Time(), rclcpp::Duration(0, 1000000));
      const long taken = allocations - before;
      for (std::size_t i = 0; i < joints; ++i) torques[i] = commands[i]->value;
      print(result == controller_interface::return_type::OK, taken, torques);
    }
  } else {
    std::vector<double> torques(64);
    CallbackController controller(numbers(joints), [&](const auto& command) {
      torques.assign(command.data.begin(), command.data.end());
    });
    for (std::size_t row = 0; row < rows; ++row) {
      auto message = std::make_shared<sensor_msgs::msg::JointState>();
      message->position = numbers(static_cast<std::size_t>(number()));
      message->velocity = numbers(static_cast<std::size_t>(number()));
      const long before = allocations;
      controller.on_joint_state(message);
      print(true, allocations - before, torques);
    }
  }
}
