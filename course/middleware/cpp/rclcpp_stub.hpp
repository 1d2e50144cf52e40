// What the controllers here use of rclcpp and its messages (Kilted, 2025), just enough to compile:
// names and signatures are theirs, the insides are not.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace rclcpp {
struct Time { explicit Time(std::int64_t = 0) {} };
struct Duration { Duration(std::int32_t, std::uint32_t) {} };
using Value = std::variant<std::vector<std::string>, std::vector<double>>;
class Parameter {
public:
  Parameter(std::string name, Value value) : name_(std::move(name)), value_(std::move(value)) {}
  const auto& as_string_array() const { return std::get<std::vector<std::string>>(value_); }
  const auto& as_double_array() const { return std::get<std::vector<double>>(value_); }
private:
  std::string name_;
  Value value_;
};
}  // namespace rclcpp

namespace rclcpp_lifecycle {
class State {};
struct LifecycleNode {
  std::map<std::string, rclcpp::Value> overrides;  // of this stub: the parameter file
  rclcpp::Parameter get_parameter(const std::string& name) const {
    return {name, overrides.at(name)};
  }
};
namespace node_interfaces {
struct LifecycleNodeInterface {
  enum class CallbackReturn : std::uint8_t { SUCCESS = 97, FAILURE = 98, ERROR = 99 };
  virtual CallbackReturn on_configure(const State&) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_activate(const State&) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_deactivate(const State&) { return CallbackReturn::SUCCESS; }
  virtual ~LifecycleNodeInterface() = default;
};
}  // namespace node_interfaces
}  // namespace rclcpp_lifecycle

namespace sensor_msgs::msg {
struct JointState {
  using SharedPtr = std::shared_ptr<JointState>;
  std::vector<double> position, velocity;  // either may be empty: the message allows it
};
}  // namespace sensor_msgs::msg

namespace std_msgs::msg {
struct Float64MultiArray { std::vector<double> data; };
}  // namespace std_msgs::msg
