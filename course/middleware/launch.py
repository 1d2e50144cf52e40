"""Launch files read for what they set: run against stand-ins of `launch` and `launch_ros`.

Neither package comes from PyPI, and neither is needed to see what a file says: it builds a list of
processes, each with parameters. A comment that says "30 Hz, best effort" sets
nothing. Quality of service can be set from outside since Galactic (2021), by parameters named
qos_overrides.TOPIC.END.POLICY, of a topic whose node has allowed it when it made the publisher or
the subscription. What rclcpp allows by default there (QosOverridingOptions::with_default_policies)
is `BY_DEFAULT`; the other policies have to be named in the node's source (rclcpp, Galactic 2021,
qos_overriding_options.hpp). Times are whole nanoseconds.

A controller of ros2_control has a node of its own. Since August 2024 (Jazzy and later) it ignores
the arguments of the process, so parameters of ros2_control_node do not reach it: its spawner passes
them on, from a file (--param-file) or as arguments (--controller-ros-args, since 4.22, December
2024). See ros2_control, release notes from Humble to Jazzy, and pull requests 1694 and 1713.
Before, parameters that a launch file gave to a process without a node name reached all its nodes.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from types import ModuleType
from typing import Any

from course.check import invalid
from course.middleware.qos import QoS, compatible

USUAL = """
from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    return LaunchDescription([
        # camera at 30 Hz, best effort
        Node(package="camera_driver", executable="camera", parameters=[{"profile": "640x480x30"}]),
        # finds the objects in every image
        Node(package="object_finder", executable="finder", parameters=[{"model": "small"}]),
        # plans at 10 Hz, reliable
        Node(package="arm_planner", executable="planner", parameters=[{"timeout_ms": 500}]),
        # 1 kHz, real time, reliable
        Node(package="arm_control", executable="controller", parameters=[{"rate": 1000}]),
        # 1 kHz, reliable, transient local for the screen that joins late
        Node(package="arm_safety", executable="monitor", parameters=[{"max_force": 30.0}]),
    ])
"""

OURS = """
from launch import LaunchDescription
from launch_ros.actions import Node

PICTURE = {"reliability": "best_effort", "history": "keep_last", "depth": 1}
POSES = {"reliability": "best_effort", "history": "keep_last", "depth": 1,
         "deadline": 100_000_000}
PLAN = {"reliability": "reliable", "history": "keep_last", "depth": 1}
# The monitor is an ordinary process: under load it has been measured some 40 ms late, so that a
# shorter lease would declare a healthy one dead.
STATUS = {"reliability": "reliable", "durability": "transient_local", "history": "keep_last",
          "depth": 1, "liveliness": "manual_by_topic", "liveliness_lease_duration": 100_000_000}


def qos(topic, end, policies):
    return {f"qos_overrides.{topic}.{end}.{name}": value for name, value in policies.items()}


def passed_on(parameters):
    rules = " ".join(f"-p {name}:={value}" for name, value in parameters.items())
    return ["--controller-ros-args", rules]


def generate_launch_description():
    return LaunchDescription([
        Node(package="camera_driver", executable="camera", parameters=[
            {"profile": "640x480x30"}, qos("/camera/image", "publisher", PICTURE)]),
        Node(package="object_finder", executable="finder", parameters=[
            {"model": "small"}, qos("/camera/image", "subscription", PICTURE),
            qos("/object_poses", "publisher", POSES)]),
        Node(package="arm_planner", executable="planner", parameters=[
            {"timeout_ms": 500}, qos("/object_poses", "subscription", POSES),
            qos("/trajectory", "publisher", PLAN)]),
        Node(package="controller_manager", executable="ros2_control_node", parameters=[
            {"update_rate": 1000, "lock_memory": True, "thread_priority": 50}]),
        # The controller has a node of its own, which reads only what its spawner passes on.
        Node(package="controller_manager", executable="spawner", arguments=[
            "arm_controller", *passed_on(qos("/trajectory", "subscription", PLAN)),
            *passed_on(qos("/safety/status", "subscription", STATUS))]),
        Node(package="arm_safety", executable="monitor", parameters=[
            {"max_force": 30.0}, qos("/safety/status", "publisher", STATUS)]),
    ])
"""

_NAME = re.compile(r"qos_overrides\.(/[\w/]+)\.(publisher|subscription)(?:_\w+)?\.(\w+)")
_TIMES = ("deadline", "lifespan", "liveliness_lease_duration")
BY_DEFAULT = ("history", "depth", "reliability")
POLICIES = ("reliability", "history", "depth", "durability", "liveliness", *_TIMES)


@dataclass(frozen=True)
class Node:
    """What a launch file says of a process.

    Attributes:
        package, executable: what is started.
        parameters: of all its dictionaries; of a name that comes twice, the later value. For a
            spawner, those that it passes on to its controller.
    """

    package: str
    executable: str
    parameters: dict[str, Any] = field(default_factory=dict)


def _passed_on(arguments: Sequence[str]) -> dict[str, Any]:
    """Return the parameters that a spawner passes on to its controller's node."""
    result: dict[str, Any] = {}
    for option, rules in pairwise(arguments):
        if option == "--controller-ros-args":
            for name, value in re.findall(r"-p (\S+?):=(\S+)", rules):
                result[name] = int(value) if value.isdecimal() else value
    return result


def nodes(text: str) -> list[Node]:
    """Run a launch file that is written in Python, against the stand-ins.

    Args:
        text: of the file. It is run as it stands: only files that you trust.

    Returns:
        Its nodes in order. Arguments of `Node` beside those above and `arguments` are an error of
        type TypeError.
    """

    def made(package: str, executable: str, parameters: Any = (), arguments: Any = ()) -> Node:
        if executable == "spawner":
            return Node(package, executable, _passed_on(arguments))
        joined = {key: value for one in parameters for key, value in one.items()}
        return Node(package, executable, joined)

    # Stand-in modules for `launch` and `launch_ros`: the file runs without ROS 2 installed.
    stand_ins = {name: ModuleType(name) for name in ("launch", "launch_ros", "launch_ros.actions")}
    vars(stand_ins["launch"])["LaunchDescription"] = list
    vars(stand_ins["launch_ros.actions"])["Node"] = made
    before = {name: sys.modules.get(name) for name in stand_ins}
    sys.modules.update(stand_ins)
    try:
        room: dict[str, Any] = {}
        exec(compile(text, "launch file", "exec"), room)
        return room["generate_launch_description"]()
    # Restore whatever modules had these names, so that nothing of the stand-ins remains.
    finally:
        for name, module in before.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module


def overrides(parameters: Mapping[str, Any]) -> dict[tuple[str, str], QoS]:
    """Return the quality of service that parameters set.

    They name topic and end ("publisher", "subscription"); a policy that they do not name keeps its
    default.

    Raises:
        ValueError: a name is none that ROS 2 knows, or a value is none of its policy.
    """
    result: dict[tuple[str, str], QoS] = {}
    for name, value in parameters.items():
        if not name.startswith("qos_overrides"):
            continue
        match = _NAME.fullmatch(name)
        if match is None or match[3] not in POLICIES:
            allowed = f"qos_overrides.TOPIC.publisher.POLICY, of {', '.join(POLICIES)}"
            raise invalid("parameter", name, allowed)
        topic, end, policy = match.groups()
        if policy in _TIMES:
            if not isinstance(value, int) or isinstance(value, bool) or value < 1:
                raise invalid(name, value, "a positive integer, in nanoseconds")
            # ROS 2 parameters give durations in integer nanoseconds.
            value = 1e-9 * value
        result[topic, end] = replace(result.get((topic, end), QoS()), **{policy: value})
    return result


def to_be_allowed(parameters: Mapping[str, Any]) -> set[str]:
    """Return the policies that these set and that a node allows only if its source names them."""
    # The call checks all names first.
    overrides(parameters)
    names = (name.rpartition(".")[2] for name in parameters if name.startswith("qos_overrides"))
    return set(names) - set(BY_DEFAULT)


def silent(listed: list[Node]) -> dict[str, tuple[str, ...]]:
    """Return the topics on which two nodes of a file do not match, with the failing policies."""
    ends = [overrides(node.parameters) for node in listed]
    written = {t: qos for one in ends for (t, end), qos in one.items() if end == "publisher"}
    result = {
        topic: compatible(written[topic], qos)
        for one in ends
        for (topic, end), qos in one.items()
        if end == "subscription" and topic in written
    }
    return {topic: policies for topic, policies in result.items() if policies}


class Parameters:
    """A node's parameters, as rclcpp keeps them: declared before they are set, kept by name.

    Setting one changes what is read from now on. A node that has copied it at the start, or that
    has built a timer of it, goes on as it was, unless it asks to be told.
    """

    def __init__(self, given: Mapping[str, Any]) -> None:
        self.given, self.value, self.callbacks = dict(given), dict[str, Any](), list[Any]()

    def declare(self, name: str, default: Any) -> Any:
        """Declare one; what the launch file gave goes before the default."""
        return self.value.setdefault(name, self.given.get(name, default))

    def set(self, name: str, value: Any) -> None:
        """Set one at run time; one that nobody declared, or of another type, is refused."""
        if name not in self.value:
            raise invalid("parameter", name, f"one that is declared: {', '.join(self.value)}")
        if type(value) is not type(self.value[name]):
            raise invalid(name, value, f"of type {type(self.value[name]).__name__}")
        self.value[name] = value
        for call in self.callbacks:
            call(name, value)
