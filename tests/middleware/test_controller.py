"""The controller in C++ beside the same law in Python, and the common form under the sanitizer."""

import math
import re
import subprocess

import numpy as np
import pytest

from course import charts
from course.middleware import controller, launch
from course.middleware.qos import QoS
from tests import optional

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    if controller.compiler() is None:
        optional.skip(f"the C++ controller did NOT run: {controller.NO_COMPILER}")
    return controller.build(tmp_path_factory.mktemp("cpp"))


def settings(joints: int, seed: int = 0) -> np.ndarray:
    """Target, stiffness, damping and limit, shape (4, joints)."""
    scale = np.array([[2.0], [50.0], [5.0], [20.0]])
    return scale * np.random.default_rng(seed).uniform(0.1, 1.0, (4, joints))


@pytest.mark.prove
@pytest.mark.parametrize("joints", [1, 6, 7])
def test_torques_are_those_of_python_and_nothing_is_allocated(program, joints: int):
    first = settings(joints)
    rows = np.random.default_rng(1).normal(0.0, 2.0, (100, 2 * joints))
    done = controller.drive(program, "update", first, rows)
    assert (done.code, done.report, all(done.good)) == (0, "", True)
    expected = [controller.torques(row[:joints], row[joints:], *first) for row in rows]
    assert np.abs(np.array(done.torque) - expected).max() <= 1e-15
    assert any(np.any(np.abs(t) == first[3]) for t in expected)  # some are cut off, some are not
    assert any(np.any(np.abs(t) < first[3]) for t in expected)
    assert done.allocations == [0] * 100


def test_what_is_not_a_number_goes_out_as_no_torque(program):
    rows = [[np.nan, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, np.inf], [0.1, 0.2, 0.3, 0.4]]
    done = controller.drive(program, "update", settings(2), rows)
    assert done.code == 0 and done.good == [False, False, True]
    assert done.torque[0][0] == 0.0 and done.torque[1][1] == 0.0
    assert np.isfinite(done.torque).all() and done.torque[0][1] != 0.0


def test_sizes_that_disagree_are_refused_when_it_is_configured(program):
    """The driver hands over as many numbers as the first list has; so an empty arm is the way."""
    done = controller.drive(program, "update", [[], [], [], []], [])
    assert done.code == 3 and "no joint" in done.report


def test_a_program_that_dies_says_why(program, monkeypatch):
    """A preloaded library (jemalloc, VirtualGL) keeps the sanitizer from starting."""
    libraries = subprocess.run(["ldd", str(program)], capture_output=True, text=True, check=True)
    libc = re.search(r"(\S*libm\.so\S*) \(|=> (\S*libm\.so\S*) ", libraries.stdout)
    assert libc is not None
    monkeypatch.setenv("LD_PRELOAD", libc.group(1) or libc.group(2))
    with pytest.raises(RuntimeError, match=r"(?s)code 1.*LD_PRELOAD"):
        controller.drive(program, "update", settings(2), [[0.0] * 4])


BY_HAND = """
#include "arm_controller.cpp"
#include <cstdio>
using controller_interface::CallbackReturn;
struct Arm {  // one joint, with interfaces of the names that are given
  ArmController controller;
  std::shared_ptr<hardware_interface::Handle> q, v, u;
  CallbackReturn start(const char* first, const char* second, double limit) {
    auto& given = controller.get_node()->overrides;
    given["joints"] = std::vector<std::string>{"elbow"};
    given["target"] = std::vector<double>{1.0};
    given["stiffness"] = std::vector<double>{4.0};
    given["damping"] = std::vector<double>{1.0};
    given["limit"] = std::vector<double>{limit};
    if (controller.on_init() != CallbackReturn::SUCCESS) return CallbackReturn::ERROR;
    const auto configured = controller.on_configure(rclcpp_lifecycle::State());
    if (configured != CallbackReturn::SUCCESS) return configured;
    using hardware_interface::Handle;
    q = std::make_shared<Handle>(Handle{first, 0.5});
    v = std::make_shared<Handle>(Handle{second, 0.0});
    u = std::make_shared<Handle>(Handle{"elbow/effort", 7.0});
    std::vector<hardware_interface::LoanedStateInterface> states;
    states.emplace_back(q);
    states.emplace_back(v);
    std::vector<hardware_interface::LoanedCommandInterface> commands;
    commands.emplace_back(u);
    controller.assign_interfaces(std::move(commands), std::move(states));
    return controller.on_activate(rclcpp_lifecycle::State());
  }
};
"""


def by_hand(folder, body: str) -> subprocess.CompletedProcess[str]:
    """Compile a program with the controller as `build` does, and return what the compiler said."""
    (folder / "hand.cpp").write_text(f"{BY_HAND}int main() {{\n{body}\n}}\n")
    return subprocess.run(
        [
            controller.compiler() or "",
            *controller.FLAGS,
            f"-I{controller.SOURCE.parent}",
            str(folder / "hand.cpp"),
            "-o",
            str(folder / "hand"),
        ],
        capture_output=True,
        text=True,
    )


def run_by_hand(folder, body: str) -> list[str]:
    """Return the lines that such a program prints."""
    built = by_hand(folder, body)
    assert built.returncode == 0, built.stderr
    done = subprocess.run([str(folder / "hand")], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


@pytest.mark.prove
def test_an_interface_that_is_busy_is_no_number(program, tmp_path):
    """As in ros2_control: without a value, or not written, where another thread has the lock."""
    lines = run_by_hand(
        tmp_path,
        """
  for (int busy = 0; busy < 3; ++busy) {
    Arm arm;
    if (arm.start("elbow/position", "elbow/velocity", 9.0) != CallbackReturn::SUCCESS) return 1;
    arm.q->busy = busy == 1;
    arm.u->busy = busy == 2;
    const auto result = arm.controller.update(rclcpp::Time(), rclcpp::Duration(0, 1000000));
    const bool good = result == controller_interface::return_type::OK;
    std::printf("%d %g\\n", good ? 1 : 0, arm.u->value);
  }""",
    )
    # 4 (1 - 0.5) = 2; no torque without a reading; the old torque where it cannot be written.
    assert lines == ["1 2", "0 0", "0 7"]


@pytest.mark.prove
def test_it_names_its_interfaces_and_rejects_others(program, tmp_path):
    lines = run_by_hand(
        tmp_path,
        """
  Arm arm;
  const auto code = [](CallbackReturn one) { return one == CallbackReturn::SUCCESS ? 1 : 0; };
  std::printf("%d\\n", code(arm.start("elbow/position", "elbow/velocity", 9.0)));
  for (const auto& name : arm.controller.state_interface_configuration().names)
    std::printf("%s\\n", name.c_str());
  for (const auto& name : arm.controller.command_interface_configuration().names)
    std::printf("%s\\n", name.c_str());
  std::printf("%d\\n", code(Arm().start("elbow/velocity", "elbow/position", 9.0)));
  std::printf("%d\\n", code(Arm().start("wrist/position", "elbow/velocity", 9.0)));
  std::printf("%d\\n", code(Arm().start("elbow/position", "elbow/velocity", -9.0)));
  std::printf("%d\\n", code(Arm().start("elbow/position", "elbow/velocity", NAN)));""",
    )
    names = ["elbow/position", "elbow/velocity", "elbow/effort"]
    # Swapped, of another joint, and limits that std::clamp is not defined for.
    assert lines == ["1", *names, "0", "0", "0", "0"]


@pytest.mark.parametrize(
    ("call", "report"),
    [
        ("const double x = one.get_value(); (void)x;", "get_value"),
        *(
            pytest.param(*call, marks=pytest.mark.prove)
            for call in (
                ("one.set_value(1.0);", "nodiscard|unused-result"),
                ("auto copy = one; (void)copy;", "deleted"),
                ("ArmController().on_configure();", "on_configure"),
                ("ArmController().update({}, {});", "explicit|convert|initializer"),
            )
        ),
    ],
)
def test_the_older_calls_do_not_compile(program, tmp_path, call: str, report: str):
    body = (
        "  hardware_interface::LoanedCommandInterface one(\n"
        "      std::make_shared<hardware_interface::Handle>());\n"
    )
    assert by_hand(tmp_path, body).returncode == 0
    built = by_hand(tmp_path, f"{body}  {call}")
    assert built.returncode != 0
    assert re.search(report, built.stderr)


def test_the_common_form_reads_beyond_its_vectors(program):
    """Its six targets are right for six joints; not for a seventh, nor without velocities."""
    targets, six = [[0.5] * 6], [6, *[0.1] * 6, 6, *[0.2] * 6]
    fine = controller.drive(program, "callback", targets, [six, six])
    assert fine.code == 0
    expected = controller.torques([0.1] * 6, [0.2] * 6, [0.5] * 6, [20.0] * 6, [5.0] * 6, [1e9] * 6)
    assert np.allclose(fine.torque, [expected] * 2, rtol=0, atol=1e-15)
    assert min(fine.allocations) >= 2  # the vector, and its copy in the message
    seven = controller.drive(program, "callback", targets, [[7, *[0.1] * 7, 7, *[0.2] * 7]])
    assert seven.code != 0 and seven.torque == []
    assert "heap-buffer-overflow" in seven.report
    empty = controller.drive(program, "callback", targets, [[6, *[0.1] * 6, 0]])
    assert empty.code != 0 and empty.torque == []
    assert "null pointer" in empty.report or "SEGV" in empty.report
    # It runs once a message: three messages, three commands, however much time passes.
    assert len(controller.drive(program, "callback", targets, [six] * 3).torque) == 3


@pytest.mark.parametrize("name", ["rclcpp_stub.hpp", "ros2_control_stub.hpp"])
def test_the_stubs_are_short(name: str):
    stub = controller.SOURCE.parent / name
    assert len(stub.read_text().splitlines()) <= 100


# --- Launch files ---------------------------------------------------------------------------------


def test_the_usual_file_sets_no_rate_and_no_quality_of_service():
    result = launch.nodes(launch.USUAL)
    assert len(result) == 5 and len({node.package for node in result}) == 5
    assert all(launch.overrides(node.parameters) == {} for node in result)
    # All that reaches the nodes; "rate" is a number that one of them may read.
    named = [name for node in result for name in node.parameters]
    assert named == ["profile", "model", "timeout_ms", "rate", "max_force"]
    assert "best effort" in launch.USUAL and "1 kHz" in launch.USUAL  # only in comments


def test_ours_sets_what_it_says_name_by_name():
    result = launch.nodes(launch.OURS)
    ends = [launch.overrides(node.parameters) for node in result]
    picture = QoS("best_effort", depth=1)
    poses = QoS("best_effort", depth=1, deadline=0.1)
    status = QoS(
        depth=1,
        durability="transient_local",
        liveliness="manual_by_topic",
        liveliness_lease_duration=0.1,
    )
    plan = QoS(depth=1)
    assert ends == [
        {("/camera/image", "publisher"): picture},
        {("/camera/image", "subscription"): picture, ("/object_poses", "publisher"): poses},
        {("/object_poses", "subscription"): poses, ("/trajectory", "publisher"): plan},
        # Of the process; the controller's own come with its spawner.
        {},
        {("/trajectory", "subscription"): plan, ("/safety/status", "subscription"): status},
        {("/safety/status", "publisher"): status},
    ]
    assert launch.silent(result) == {}
    allowed = [sorted(launch.to_be_allowed(node.parameters)) for node in result]
    late = ["durability", "liveliness", "liveliness_lease_duration"]
    assert allowed == [[], ["deadline"], ["deadline"], [], late, late]
    swapped = launch.OURS.replace(
        '"/safety/status", "publisher", STATUS', '"/safety/status", "publisher", POSES'
    )
    assert launch.silent(launch.nodes(swapped)) == {
        "/safety/status": ("reliability", "durability", "liveliness")
    }


@pytest.mark.parametrize(
    ("name", "value", "report"),
    [
        (
            "qos_overrides./a.publisher.reliable",
            "reliable",
            r"parameter must be .*, got 'qos_overrides./a.pub",
        ),
        ("qos_overrides.a.publisher.depth", 1, r"parameter must be .*, got 'qos_overrides.a.pub"),
        ("qos_overrides./a.writer.depth", 1, "parameter must be"),
        (
            "qos_overrides./a.publisher.deadline",
            0.1,
            r"deadline must be a positive integer, in nanoseconds, got 0.1",
        ),
        (
            "qos_overrides./a.publisher.reliability",
            "RELIABLE",
            r"reliability must be .*, got 'RELIABLE'",
        ),
        ("qos_overrides./a.subscription.depth", 0, r"depth must be .*, got 0"),
    ],
)
def test_a_wrong_override_is_named(name: str, value, report: str):
    with pytest.raises(ValueError, match=report):
        launch.overrides({name: value})


def test_the_lease_outlasts_the_lateness_that_was_measured():
    """Of an ordinary process beside busy ones; a lease of 10 ms declared a healthy one dead."""
    report = charts.read("loop_lateness")
    match = re.search(r"default: .*, ([\d.]+) \(all\)", report)
    assert match is not None
    worst = float(match.group(1)) / 1000.0
    ends = [launch.overrides(node.parameters) for node in launch.nodes(launch.OURS)]
    leases = {q.liveliness_lease_duration for e in ends for q in e.values()} - {math.inf}
    assert leases and min(leases) > 2.0 * worst


def test_a_parameter_that_was_copied_is_not_tuned():
    parameters = launch.Parameters({"stiffness": 100.0, "never_declared": 1})
    copied = parameters.declare("stiffness", 20.0)
    assert (copied, parameters.declare("damping", 5.0)) == (100.0, 5.0)
    received = []
    parameters.callbacks.append(lambda name, value: received.append((name, value)))
    parameters.set("stiffness", 200.0)
    assert (copied, parameters.value["stiffness"]) == (100.0, 200.0)
    assert received == [("stiffness", 200.0)]
    for name, value in (("never_declared", 2), ("stiffness", "soft")):
        with pytest.raises(ValueError, match=name):
            parameters.set(name, value)


@pytest.mark.parametrize("limit", [[-1.0], [np.nan]])
def test_bad_input(limit):
    with pytest.raises(ValueError, match=r"limit\[0\]"):
        controller.torques([0.0], [0.0], [0.0], [1.0], [1.0], limit)
    with pytest.raises(ValueError, match="velocity"):
        controller.torques([0.0], [], [0.0], [1.0], [1.0], [1.0])
