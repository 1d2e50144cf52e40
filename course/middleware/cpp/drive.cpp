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
void* operator new(std::size_t size) {
  ++allocations;
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

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
    for (const char* name : {"target", "stiffness", "damping", "limit"})
      controller.parameters[name] = numbers(joints);
    std::vector<double> states(2 * joints), commands(joints);
    std::vector<hardware_interface::Handle> read, write;
    for (double& value : states) read.emplace_back(&value);
    for (double& value : commands) write.emplace_back(&value);
    controller.assign(read, write);
    using controller_interface::CallbackReturn;
    if (controller.on_configure() != CallbackReturn::SUCCESS) {
      std::cerr << "on_configure failed: no joint, or lists of different lengths\n";
      return 3;
    }
    if (controller.on_activate() != CallbackReturn::SUCCESS) {
      std::cerr << "on_activate failed: interfaces that do not fit the joints\n";
      return 4;
    }
    for (std::size_t row = 0; row < rows; ++row) {
      for (double& value : states) value = number();
      const long before = allocations;
      const auto result = controller.update({}, {});
      const long taken = allocations - before;
      print(result == controller_interface::return_type::OK, taken, commands);
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
