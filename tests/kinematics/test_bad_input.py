"""Bad input of the chapter: named, with its value and what is allowed."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from course import kinematics
from course.kinematics import TwoLink, ik, panda, planar, tip, two_link_ik

NAN = float("nan")


def changed(**fields):
    """A good arm of two joints with some fields changed."""
    return replace(planar([1.0, 0.5]), **fields)


def with_one(name, index, value):
    """A field of that arm with one number changed."""
    array = np.array(getattr(planar([1.0, 0.5]), name), dtype=float)
    array[index] = value
    return {name: array}


ARM = panda()
Q = np.zeros(7)
POSE = np.array([0.4, 0, 0.4, 1, 0, 0, 0])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        # Chains.
        (lambda: changed(parent=[]), r"len\(parent\) must be a positive integer.*, got 0"),
        (lambda: planar([]), r"len\(lengths\) must be .*, got 0"),
        (lambda: kinematics.random_chain(0, np.random.default_rng(0)), r"n must be .*, got 0"),
        (lambda: changed(parent=[1, -1]), r"parent\[0\] must be -1 or a joint before 0.*, got 1"),
        (lambda: changed(parent=[-1, 1]), r"parent\[1\] must be .*, got 1"),
        (lambda: changed(parent=[-1, -2]), r"parent\[1\] must be .*, got -2"),
        (lambda: changed(parent=[-1.0, 0.0]), "must be a row of integers"),
        (
            lambda: changed(lower=[1.0, 0.0], upper=[0.5, 1.0]),
            r"\(lower\[0\], upper\[0\]\) must be",
        ),
        (lambda: changed(lower=[NAN, 0.0]), r"lower\[0\] must be .*, got nan"),
        (
            lambda: changed(upper=[1.0, 2.0, 3.0]),
            r"upper.shape must be \(\) or \(2,\).*, got \(3,\)",
        ),
        (lambda: changed(slides="x"), r"slides must be .*, got 'x'"),
        (lambda: changed(**with_one("placement", (3, 1), 1.1)), r"placement\[3:\]\[:, 1\] must be"),
        (
            lambda: changed(**with_one("placement", (0, 1), NAN)),
            r"placement\[0, 1\] must be .*, got nan",
        ),
        (lambda: changed(placement=np.zeros((6, 2))), "placement.shape must be"),
        (lambda: changed(**with_one("mass", 1, 0.0)), r"mass\[1\] must be a positive.*, got 0.0"),
        (
            lambda: changed(**with_one("inertia", (0, 0, 1), 9.0)),
            r"inertia must be .* principal moments",
        ),
        (lambda: changed(damping=-1.0), r"damping must be .*, got -1.0"),
        (lambda: changed(tool=[0, 0, 0, 2, 0, 0, 0]), r"tool\[3:\] must be"),
        (lambda: planar([1.0, 0.0]), r"lengths\[1\] must be a positive finite number.*, got 0.0"),
        (lambda: planar([1.0, 0.5], [1.0]), "masses.shape must be"),
        (lambda: kinematics.turn_to([0, 0, 0]), "axis must be a direction"),
        # Motion.
        (lambda: tip(ARM, np.zeros(6)), r"q.shape must be \(7,\) or \(7, N\).*, got \(6,\)"),
        (lambda: tip(ARM, [NAN] * 7), r"q\[0\] must be .*, got nan"),
        (lambda: kinematics.jacobian(ARM, Q, [0, 0]), "point.shape"),
        (lambda: kinematics.jacobian(ARM, Q, joint=7), r"joint must be .*, got 7"),
        (
            lambda: kinematics.jacobian_rate(ARM, Q, np.zeros((7, 2))),
            r"v.shape must be .*, got \(7, 2\)",
        ),
        (lambda: kinematics.condition_number(np.eye(6), 0.0), r"length must be .*, got 0.0"),
        (lambda: kinematics.condition_number(np.eye(3), 1.0), r"J.shape must be .*, got \(3, 3\)"),
        (lambda: kinematics.null_space(np.zeros(3)), "J.shape"),
        # Dynamics.
        (lambda: kinematics.inverse_dynamics(ARM, Q, Q, [NAN] * 7), r"a\[0\] must be .*, got nan"),
        (lambda: kinematics.inverse_dynamics(ARM, Q, Q, Q, np.zeros(5)), "wrench.shape"),
        (lambda: kinematics.bias(ARM, Q, Q, gravity=(0, 0)), "gravity.shape"),
        (lambda: kinematics.forward_dynamics(ARM, Q, Q, np.zeros(6)), "tau.shape"),
        (lambda: kinematics.pack(ARM, [1.0, 2.0]), "tau.shape"),
        (lambda: kinematics.linearise(ARM, Q, Q, np.zeros(3)), "tau.shape"),
        (
            lambda: kinematics.linearise(ARM, Q, Q, Q, step=0.0),
            r"step must be a positive.*, got 0.0",
        ),
        # Inverse kinematics.
        (lambda: ik(ARM, np.zeros(6)), r"target.shape must be .*, got \(6,\)"),
        (lambda: ik(ARM, np.zeros(7)), r"target\[3:\]\[:, 0\] must be .*normalise it"),
        (lambda: ik(ARM, [NAN, 0, 0, 1, 0, 0, 0]), r"target\[0\] must be .*, got nan"),
        (lambda: ik(ARM, POSE, np.zeros(6)), r"start.shape must be .*, got \(6,\)"),
        (lambda: ik(ARM, POSE, kinematics.Samples(panda(), 5, 0)), "samples of this chain"),
        (lambda: ik(ARM, POSE, restarts=0), r"\(start, restarts\) must be .*, got \(None, 0\)"),
        (lambda: ik(ARM, POSE, np.empty((7, 0)), restarts=0), r"\(start, restarts\) must be"),
        (
            lambda: ik(ARM, POSE, kinematics.Samples(ARM, 5, 0), nearest=0),
            r"nearest must be .*, got 0",
        ),
        (lambda: kinematics.elbow_height(ARM, Q, 7), r"joint must be .*, got 7"),
        (lambda: kinematics.pose_error(POSE, np.zeros(7)), r"pose\[3:\] must be .*normalise it"),
        (lambda: ik(ARM, POSE, method="newton"), r"method must be one of.*, got 'newton'"),
        (lambda: ik(ARM, POSE, damping=0.0), r"damping must be .*, got 0.0"),
        (lambda: ik(ARM, POSE, tolerance=(1e-6, -1.0)), r"tolerance\[1\] must be .*, got -1.0"),
        (lambda: ik(ARM, POSE, iterations=0), r"iterations must be .*, got 0"),
        (lambda: ik(changed(slides=[False, True]), [1.0, 0, 0]), "must be finite for a slide"),
        (lambda: two_link_ik([1.0, 0.0], [1.0, 0.0]), r"lengths\[1\] must be .*, got 0.0"),
        (lambda: two_link_ik([1.0, 0.5], [1.0, 0.0, 0.0]), r"target.shape must be .*, got \(3,\)"),
        (lambda: two_link_ik([1.0, 0.5], [NAN, 0.0]), r"target\[0\] must be .*, got nan"),
        (lambda: two_link_ik([1.0, 0.5, 0.2], [1.0, 0.0]), "lengths.shape"),
        # Two links.
        (lambda: TwoLink(lengths=(1.0, 0.0)), r"lengths\[1\] must be .*, got 0.0"),
        (lambda: TwoLink(payload=-1.0), r"payload must be .*, got -1.0"),
        (lambda: TwoLink().regressor([0, 0], [0, 0, 0], [0, 0]), "v.shape"),
        (
            lambda: TwoLink().regressor([0, 0], [[0], [0]], [0, 0]),
            r"v.shape must be that of q.*, got \(2, 1\)",
        ),
    ],
)
def test_bad_input_is_named(call, message) -> None:
    with pytest.raises(ValueError, match=message):
        call()


def test_a_chain_does_not_change_after_its_checks() -> None:
    arm: Any = panda()
    with pytest.raises(ValueError, match="read-only"):
        arm.mass[0] = -1.0
    with pytest.raises(AttributeError):
        arm.mass = np.ones(7)
    one = planar([1.0])
    kinematics.inertial_parameters(one)[0] = -1.0
    assert kinematics.inertial_parameters(one)[0] == one.mass[0]
