// What the controllers here use of ros2_control and rclcpp (Jazzy, 2024), just enough to compile and
// to be driven: names and signatures are theirs, the insides are not.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace rclcpp {
struct Time { std::int64_t nanoseconds = 0; };
struct Duration { std::int64_t nanoseconds = 0; };
}  // namespace rclcpp

namespace hardware_interface {
class Handle {  // of one number that the hardware wrote, or reads
public:
  explicit Handle(double* value) : value_(value) {}
  // Without a value where another thread writes at this moment. The older get_value(), which
  // returned a double, is deprecated in Jazzy and gone in Kilted.
  std::optional<double> get_optional() const {
    if (busy) return std::nullopt;
    return *value_;
  }
  [[nodiscard]] bool set_value(double value) {
    if (busy) return false;
    *value_ = value;
    return true;
  }
  bool busy = false;  // of this stub: as while another thread holds the lock
private:
  double* value_;
};
using LoanedStateInterface = Handle;
using LoanedCommandInterface = Handle;
}  // namespace hardware_interface

namespace controller_interface {
enum class return_type { OK, ERROR };
enum class CallbackReturn { SUCCESS, FAILURE };

class ControllerInterface {
public:
  virtual ~ControllerInterface() = default;
  virtual CallbackReturn on_configure() = 0;
  virtual CallbackReturn on_activate() = 0;
  virtual return_type update(const rclcpp::Time& time, const rclcpp::Duration& period) = 0;

  // By the controller manager, before it activates; states are all positions, then all velocities.
  void assign(std::vector<hardware_interface::Handle> states,
              std::vector<hardware_interface::Handle> commands) {
    state_interfaces_ = std::move(states);
    command_interfaces_ = std::move(commands);
  }
  std::map<std::string, std::vector<double>> parameters;

protected:
  std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;
  std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
};
}  // namespace controller_interface

namespace sensor_msgs::msg {
struct JointState {
  using SharedPtr = std::shared_ptr<JointState>;
  std::vector<double> position, velocity;  // either may be empty: the message allows it
};
}  // namespace sensor_msgs::msg

namespace std_msgs::msg {
struct Float64MultiArray { std::vector<double> data; };
}  // namespace std_msgs::msg
