"""Parts of libraries against the course's, on the robot's own calls and on random ones."""

import functools
import importlib.util
from typing import Any

import numpy as np
import pytest

from drills.robot import libraries
from drills.robot.holders import Holder, chosen, course_part
from drills.robot.levels import CELL, level
from drills.robot.parts import load_part
from drills.robot.play import play
from drills.robot.report import Summary, compare, summarise
from drills.robot.slots import NAMES
from tests.drills.robot.robots import parts_with
from tests.optional import skip

pytestmark = [pytest.mark.slow, pytest.mark.optional]
OFFERED = [(slot, library) for slot, texts in libraries.TEXTS.items() for library in texts]
# How far a robot with the part may be off the course's, in the mean over tasks: success, cycle [s],
# distance from the slot [m]. OMPL plans other paths; MuJoCo's contact,
# integrator and friction are others. A plan lasts an integer number of ticks: a goal that moves by
# 0.1 mm can add one to each of the two motions.
DIFFERENT = {
    "rrt_connect": (0.0, 0.5, 1e-4),
    "plane_ransac": (0.0, 2 * CELL.tick, 3e-4),
    "verlet": (0.0, 0.05, 3e-4),
    "friction_torque": (0.0, 2 * CELL.tick, 1e-4),
    "contact_step": (0.0, 0.0, 3e-4),
}


def both(slot: str, library: str) -> tuple[Any, Any]:
    """The course's and the library's function, or a skip with a sentence."""
    if not libraries.installed(library):
        skip(f"{library} did not hold the slot {slot}: it is not installed.")
    part = libraries.part(slot, library)
    assert part is not None
    return load_part(course_part(slot)), load_part(part)


@functools.cache
def of_the_course() -> Summary:
    """The course's own robot on the same tasks, which every library is compared with."""
    return summarise(play(parts_with(), level(5), 8))


@pytest.mark.prove
@pytest.mark.parametrize(("slot", "library"), OFFERED)
def test_a_robot_with_a_library_s_part_does_as_well(slot: str, library: str) -> None:
    both(slot, library)
    part = libraries.part(slot, library)
    parts = [part if part and name == slot else course_part(name) for name in NAMES]
    result = play(parts, level(5), 8)
    assert result.failure is None and result.breaches == ()
    change = compare(of_the_course(), summarise(result))
    limits = DIFFERENT.get(slot, (0.0, 0.0, 1e-6))
    for (value, _, _), limit in zip(change, limits, strict=True):
        assert abs(value) <= limit + 1e-12


@pytest.mark.prove
@pytest.mark.parametrize("library", ("pinocchio", "open3d", "mujoco"))
def test_a_library_s_part_runs_beside_a_part_of_the_learner_s(library: str) -> None:
    """In the sandbox's child process."""
    slot = {"pinocchio": "computed_torque", "open3d": "dbscan", "mujoco": "contact_step"}[library]
    both(slot, library)
    parts = parts_with(lqr=course_part("lqr").source)
    parts = [libraries.part(slot, library) or part if part.slot == slot else part for part in parts]
    result = play(parts, level(2), 2)
    assert result.failure is None, result.failure
    assert result.success.all() and result.breaches == ()


def test_pinocchio_s_jacobian_is_the_course_s() -> None:
    plain, other = both("jacobian", "pinocchio")
    rng = np.random.default_rng(0)
    for n in (2, 3, 6):
        placements = np.tile(np.eye(4), (n, 1, 1))
        for placement in placements:
            placement[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            placement[:3, 0] *= np.linalg.det(placement[:3, :3])
            placement[:3, 3] = rng.normal(size=3)
        q, tool = rng.uniform(-3.0, 3.0, n), rng.normal(size=3)
        np.testing.assert_allclose(
            other(placements, q, tool), plain(placements, q, tool), atol=1e-12
        )


@pytest.mark.parametrize("slot", ("computed_torque", "rnea_planar"))
def test_pinocchio_s_torques_are_the_course_s(slot: str) -> None:
    plain, other = both(slot, "pinocchio")
    rng = np.random.default_rng(1)
    for _ in range(20):
        lengths, masses = rng.uniform(0.2, 1.0, 2), rng.uniform(0.5, 4.0, 2)
        q, v, a = rng.normal(size=(3, 2))
        args: tuple[Any, ...] = (lengths, masses, q, v, a, 3.0)
        if slot == "computed_torque":
            reference = rng.normal(size=(3, 2))
            args = (lengths, masses, 3.0, q, v, reference, np.full(2, 50.0), np.full(2, 9.0))
        np.testing.assert_allclose(other(*args), plain(*args), atol=1e-10)


def test_open3d_finds_the_plane_and_the_clusters() -> None:
    rng = np.random.default_rng(2)
    _, plane_of = both("plane_ransac", "open3d")
    xy = rng.uniform(-0.3, 0.3, (2, 600))
    z = 0.9 + 0.2 * xy[0] - 0.1 * xy[1] + rng.normal(0.0, 0.001, 600)
    cloud = np.vstack((xy, np.where(np.arange(600) % 5 == 0, z - 0.1, z)))
    plane, near, _ = plane_of(cloud, rng.integers(0, 600, (40, 3)), 0.004, 0.999)
    true = np.array([0.2, -0.1, -1.0]) / np.linalg.norm([0.2, -0.1, -1.0])
    # Of 480 points with noise of 1 mm over 0.17 m (rms) the slope is known to 0.3 mrad.
    assert np.linalg.norm(np.cross(true, plane[:3])) < 2e-3
    assert 470 <= near.size <= 485
    plain, clusters_of = both("dbscan", "open3d")
    blobs = rng.normal(0.0, 0.01, (3, 90)) + np.repeat(np.arange(3) * 0.2, 30)
    np.testing.assert_array_equal(clusters_of(blobs, 0.03, 4), plain(blobs, 0.03, 4))


def test_mujoco_steps_like_the_course() -> None:
    plain, other = both("verlet", "mujoco")
    rng = np.random.default_rng(3)
    stiffness = np.array([40.0, 90.0])

    def acceleration(q: np.ndarray) -> np.ndarray:
        return -stiffness * q

    for dt in (4e-3, 1e-3):
        q, v = rng.normal(size=(2, 2))
        ours = plain(q, v, acceleration(q), acceleration, dt)
        theirs = other(q, v, acceleration(q), acceleration, dt)
        # Semi-implicit Euler differs from Verlet by a dt^2 / 2 in q, by a jerk's dt^2 / 2 in v.
        push, jerk = np.max(np.abs(acceleration(q))), np.max(stiffness * np.abs(v))
        np.testing.assert_allclose(theirs[0], ours[0], atol=0.51 * dt**2 * push)
        np.testing.assert_allclose(
            theirs[1], ours[1], atol=dt**2 * (0.51 * jerk + dt * push * 90.0)
        )


def test_mujoco_s_friction_is_a_line_up_to_the_transition_speed() -> None:
    """And constant above it; the course's is a tanh with the same slope and the same limit."""
    plain, other = both("friction_torque", "mujoco")
    rng = np.random.default_rng(4)
    for _ in range(10):
        coulomb, viscous = rng.uniform(0.1, 3.0, (2, 2))
        transition = rng.uniform(0.02, 0.2)
        for scale in (0.0, 0.01, 0.5, 3.0, 50.0):
            v = scale * transition * rng.choice([-1.0, 1.0], 2)
            theirs = other(v, coulomb, viscous, transition)
            line = coulomb * np.clip(v / transition, -1.0, 1.0) + viscous * v
            np.testing.assert_allclose(theirs, line, atol=1e-9)
            # |tanh(x) - x| and 1 - tanh(x) are largest at 1.
            ours = plain(v, coulomb, viscous, transition)
            assert np.all(np.abs(theirs - ours) <= coulomb * (1.0 - np.tanh(1.0)) + 1e-9)


def test_mujoco_s_part_stops_where_the_course_s_does() -> None:
    plain, other = both("contact_step", "mujoco")
    for speed in (-0.3, 0.0, 0.2):
        args = (np.array([0.1, 0.002]), np.array([speed, 0.0]), 0.35, 0.6, 1e-3, 300)
        ours, theirs = plain(*args), other(*args)
        # A soft contact sinks in by micrometres and creeps.
        assert abs(theirs[0][1]) < 1e-4
        np.testing.assert_allclose(theirs[0][0], ours[0][0], atol=1e-3)


def test_a_missing_library_is_skipped_with_a_sentence(monkeypatch: Any, tmp_path: Any) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "pinocchio" else find(name)
    )
    held = {name: Holder(course_part(name), "", "") for name in NAMES}
    notices: list[str] = []
    parts = chosen(tmp_path, held, ["rnea_planar=pinocchio"], [], notices)
    assert {part.holder for part in parts} == {"course"}
    assert notices == [
        "pinocchio is not installed, so the course's part stays in rnea_planar. pip install pin"
    ]
