// The common form, kept as a specimen: control inside a subscription's callback. It runs when, and
// only when, a message comes, so at the publisher's rate; it builds a vector each time; and it
// trusts that a message has as many velocities as positions and no more joints than it has targets.
#include <cstddef>
#include <functional>
#include <utility>
#include <vector>

#include "rclcpp_stub.hpp"

class CallbackController {
public:
  using Publish = std::function<void(const std_msgs::msg::Float64MultiArray&)>;

  CallbackController(std::vector<double> target, Publish publish)
      : target_(std::move(target)), publish_(std::move(publish)) {}

  void on_joint_state(const sensor_msgs::msg::JointState::SharedPtr& message) {
    std::vector<double> torque(message->position.size());
    for (std::size_t i = 0; i < torque.size(); ++i) {
      torque[i] = stiffness_ * (target_[i] - message->position[i]) - damping_ * message->velocity[i];
    }
    std_msgs::msg::Float64MultiArray command;
    command.data = torque;
    publish_(command);
  }

private:
  double stiffness_ = 20.0, damping_ = 5.0;
  std::vector<double> target_;
  Publish publish_;
};
