// A joint controller in ros2_control's shape. Sizes are checked once, when it is configured and
// activated. update() is called by the controller manager at its own rate; it neither allocates nor
// locks, and what is not a number goes out as no torque. A brake does not see NaN: it engages when
// its current is cut, and until then the arm falls. So update() reports ERROR. In Jazzy the
// controller manager then deactivates this controller and activates its fallback_controllers; the
// hardware component has to cut the current of the brakes.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "ros2_control_stub.hpp"

class ArmController final : public controller_interface::ControllerInterface {
public:
  using Result = controller_interface::CallbackReturn;

  Result on_configure() override {
    target_ = parameters["target"];
    stiffness_ = parameters["stiffness"];
    damping_ = parameters["damping"];
    limit_ = parameters["limit"];
    joints_ = target_.size();
    const bool alike = stiffness_.size() == joints_ && damping_.size() == joints_ &&
                       limit_.size() == joints_;
    return joints_ > 0 && alike ? Result::SUCCESS : Result::FAILURE;
  }

  Result on_activate() override {
    const bool fits =
        state_interfaces_.size() == 2 * joints_ && command_interfaces_.size() == joints_;
    return fits ? Result::SUCCESS : Result::FAILURE;
  }

  controller_interface::return_type update(const rclcpp::Time&, const rclcpp::Duration&) override {
    auto result = controller_interface::return_type::OK;
    for (std::size_t i = 0; i < joints_; ++i) {
      // Empty where the hardware writes at this moment: then not a number, like a bad reading.
      const double position = state_interfaces_[i].get_optional().value_or(NAN);
      const double velocity = state_interfaces_[joints_ + i].get_optional().value_or(NAN);
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
  std::size_t joints_ = 0;
  std::vector<double> target_, stiffness_, damping_, limit_;
};
