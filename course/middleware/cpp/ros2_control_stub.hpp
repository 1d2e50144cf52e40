// What the controllers here use of ros2_control (Kilted, 2025), just enough to compile and to be
// driven: names and signatures are theirs, the insides are not. What is deprecated there, such as
// get_value() of an interface, is absent, so that code which calls it does not compile.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "rclcpp_stub.hpp"

namespace hardware_interface {
inline constexpr char HW_IF_POSITION[] = "position", HW_IF_VELOCITY[] = "velocity",
                      HW_IF_EFFORT[] = "effort";
struct Handle {  // of this stub: one number of the hardware, behind a lock that is never waited for
  std::string name;
  double value = 0.0;
  bool busy = false;  // as while another thread holds the lock
};
class LoanedStateInterface {  // real ones cannot be copied either
public:
  explicit LoanedStateInterface(std::shared_ptr<Handle> handle) : handle_(std::move(handle)) {}
  LoanedStateInterface(const LoanedStateInterface&) = delete;
  LoanedStateInterface(LoanedStateInterface&&) = default;
  const std::string& get_name() const { return handle_->name; }
  template <typename T = double>
  [[nodiscard]] std::optional<T> get_optional(unsigned int /*max_tries*/ = 10) const {
    return handle_->busy ? std::nullopt : std::optional<T>(handle_->value);
  }
protected:
  std::shared_ptr<Handle> handle_;
};
class LoanedCommandInterface : public LoanedStateInterface {
public:
  using LoanedStateInterface::LoanedStateInterface;
  template <typename T>
  [[nodiscard]] bool set_value(const T& value, unsigned int /*max_tries*/ = 10) {
    if (!handle_->busy) handle_->value = value;
    return !handle_->busy;
  }
};
}  // namespace hardware_interface

namespace controller_interface {
using rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface;
using CallbackReturn = LifecycleNodeInterface::CallbackReturn;
enum class return_type : std::uint8_t { OK = 0, ERROR = 1 };
enum class interface_configuration_type : std::uint8_t { ALL = 0, INDIVIDUAL = 1, NONE = 2 };
struct InterfaceConfiguration {
  interface_configuration_type type;
  std::vector<std::string> names = {};
};
class ControllerInterface : public LifecycleNodeInterface {
public:
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_init() = 0;
  virtual return_type update(const rclcpp::Time& time, const rclcpp::Duration& period) = 0;
  // By the controller manager, before it activates: in the order of the configurations' names.
  virtual void assign_interfaces(
      std::vector<hardware_interface::LoanedCommandInterface>&& command_interfaces,
      std::vector<hardware_interface::LoanedStateInterface>&& state_interfaces) {
    command_interfaces_ = std::move(command_interfaces);
    state_interfaces_ = std::move(state_interfaces);
  }
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() { return node_; }
  template <typename ParameterT>
  auto auto_declare(const std::string& name, const ParameterT& default_value) {
    return std::get<ParameterT>(node_->overrides.try_emplace(name, default_value).first->second);
  }

protected:
  std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
  std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;

private:
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node_ =
      std::make_shared<rclcpp_lifecycle::LifecycleNode>();
};
}  // namespace controller_interface
