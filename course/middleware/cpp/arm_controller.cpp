// A joint controller for ros2_control (Kilted, 2025). It names the interfaces that it needs, and
// checks once, when it is configured and activated, that it has them. update() is called by the
// controller manager at its own rate; it neither allocates nor waits for a lock (an interface tries
// its own ten times at most), and a torque that is not a number goes out as no torque. A brake does
// not see NaN: it engages when its current is cut, and until then the arm falls. So update()
// reports ERROR. The controller manager then deactivates this controller and activates its
// fallback_controllers; the hardware component has to cut the current of the brakes.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "ros2_control_stub.hpp"

class ArmController final : public controller_interface::ControllerInterface {
public:
  using Result = controller_interface::CallbackReturn;
  using Configuration = controller_interface::InterfaceConfiguration;
  using State = rclcpp_lifecycle::State;

  Result on_init() override {
    auto_declare<std::vector<std::string>>("joints", {});
    for (const char* name : {"target", "stiffness", "damping", "limit"})
      auto_declare<std::vector<double>>(name, {});
    return Result::SUCCESS;
  }

  Configuration command_interface_configuration() const override {
    return names_of({hardware_interface::HW_IF_EFFORT});
  }

  Configuration state_interface_configuration() const override {
    return names_of({hardware_interface::HW_IF_POSITION, hardware_interface::HW_IF_VELOCITY});
  }

  Result on_configure(const State& /*previous_state*/) override {
    joints_ = get_node()->get_parameter("joints").as_string_array();
    target_ = get_node()->get_parameter("target").as_double_array();
    stiffness_ = get_node()->get_parameter("stiffness").as_double_array();
    damping_ = get_node()->get_parameter("damping").as_double_array();
    limit_ = get_node()->get_parameter("limit").as_double_array();
    const std::size_t n = joints_.size();
    const bool alike = target_.size() == n && stiffness_.size() == n && damping_.size() == n &&
                       limit_.size() == n;
    // std::clamp is undefined where the lower limit is above the upper one.
    const bool limits = std::all_of(limit_.begin(), limit_.end(), [](double x) { return x >= 0.0; });
    return n > 0 && alike && limits ? Result::SUCCESS : Result::FAILURE;
  }

  Result on_activate(const State& /*previous_state*/) override {
    const bool fits = match(command_interfaces_, command_interface_configuration().names) &&
                      match(state_interfaces_, state_interface_configuration().names);
    return fits ? Result::SUCCESS : Result::FAILURE;
  }

  controller_interface::return_type update(const rclcpp::Time& /*time*/,
                                           const rclcpp::Duration& /*period*/) override {
    auto result = controller_interface::return_type::OK;
    for (std::size_t i = 0; i < target_.size(); ++i) {
      // Empty if its lock was taken at every try: then not a number, like a bad reading.
      const double position = state_interfaces_[i].get_optional().value_or(NAN);
      const double velocity = state_interfaces_[target_.size() + i].get_optional().value_or(NAN);
      double torque = stiffness_[i] * (target_[i] - position) - damping_[i] * velocity;
      if (!std::isfinite(torque)) {
        torque = 0.0;
        result = controller_interface::return_type::ERROR;
      }
      if (!command_interfaces_[i].set_value(std::clamp(torque, -limit_[i], limit_[i]))) {
        result = controller_interface::return_type::ERROR;
      }
    }
    return result;
  }

private:
  // All joints of the first kind, then all of the second: the order in which update() reads them.
  Configuration names_of(const std::vector<std::string>& kinds) const {
    Configuration result{controller_interface::interface_configuration_type::INDIVIDUAL};
    for (const auto& kind : kinds)
      for (const auto& joint : joints_) result.names.push_back(joint + "/" + kind);
    return result;
  }

  template <typename Interface>
  static bool match(const std::vector<Interface>& given, const std::vector<std::string>& names) {
    return std::equal(given.begin(), given.end(), names.begin(), names.end(),
                      [](const auto& one, const auto& name) { return one.get_name() == name; });
  }

  std::vector<std::string> joints_;
  std::vector<double> target_, stiffness_, damping_, limit_;
};
