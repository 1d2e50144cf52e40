"""How many arms a second beside Pinocchio and MuJoCo, and when two links in a plane are enough."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from course.charts import chart
from course.kinematics import TwoLink, forward_dynamics, inverse_dynamics, jacobian, panda, tip
from course.kinematics.two_link import TORQUES, acceleration
from course.measure.figure import Panel, Series
from course.measure.scene import LeftOut, Modelled, Scene, Tolerance
from course.measure.timing import calls, interleaved, pairwise_ratios
from course.measure.work_precision import machine
from course.oracles.mujoco import chain as mujoco_chain
from course.oracles.pinocchio import Arm
from course.rigid_body import quaternion
from course.rigid_body.integrators import rk4
from course.rigid_body.spatial import STANDARD_GRAVITY

Array = NDArray[np.float64]

# --- throughput -----------------------------------------------------------------------------------

ASKED = {
    "Torques (Newton-Euler)": (inverse_dynamics, "rnea", "inverse"),
    "Accelerations (articulated bodies)": (forward_dynamics, "aba", "forward"),
    "Jacobian of the tip": (lambda arm, q, v, x: jacobian(arm, q), "jacobian", "jacobian"),
}


@chart
def arm_throughput(
    sizes: Sequence[int] = (1, 10, 100, 1000, 10_000, 100_000),
    at_most: int = 10_000,
    repeats: int = 15,
    clock: Callable[[], float] = time.process_time,
) -> Iterator[Panel]:
    """Chart states of the 7-R arm a second, in batches of N: the course, Pinocchio, MuJoCo.

    Libraries are called once a state, up to N = `at_most`, from where their time a state is the
    same; Pinocchio's parallel calls take a batch, on one thread. Ratios are those of interleaved
    pairs at N = `at_most`; `clock` as for `course.measure.timing.calls`.
    """
    arm = replace(panda(), damping=0.0)  # Pinocchio's calls know none
    states = np.random.default_rng(0).uniform(-1, 1, (3, 7, max(sizes)))
    other = Arm(arm)
    for title, (ours, theirs, mujocos) in ASKED.items():
        panel = Panel(title, "states at a time N", "states per second", scale="log")
        rates: dict[str, list[tuple[int, float, float, float]]] = {}
        busy, notes = 0.0, []
        for n in sizes:
            q, v, x = (np.ascontiguousarray(s[:, :n]) for s in states)
            given = (q[:, 0], v[:, 0], x[:, 0]) if n == 1 else (q, v, x)
            runs = {"course": calls(ours, arm, *given, clock=clock)}
            if n <= at_most:
                runs["Pinocchio"] = calls(other.calls(theirs, q, v, x), clock=clock)
                runs["MuJoCo"] = calls(mujoco_chain.calls(arm, mujocos, q, v, x), clock=clock)
            if theirs in ("rnea", "aba"):
                runs["Pinocchio, a batch"] = calls(other.parallel(theirs, q, v, x), clock=clock)
            if n in (1, at_most):
                rivals = [name for name in runs if name != "course"]
                samplers = [runs["course"], *(runs[name] for name in rivals)]
                both = pairwise_ratios(samplers, pairs=repeats, sample=3e-3)
                notes.append(
                    f"{title:<36} N = {n:<6} time over the course's: "
                    + ", ".join(f"{name} {r}" for name, r in zip(rivals, both, strict=True))
                )
            timed = interleaved(list(runs.values()), repeats=repeats, sample=3e-3)
            for name, result in zip(runs, timed, strict=True):
                row = (n, n / result.median, n / result.high, n / result.low)
                rates.setdefault(name, []).append(row)
                busy = max(busy, result.busy)
        for name, rows in rates.items():
            n, middle, low, high = np.array(rows).T
            panel.series.append(Series(name, n, middle, name, low=low, high=high))
        panel.notes = notes
        panel.footer = machine(busy) + "; one core"
        yield panel


# --- when are two links in a plane enough? --------------------------------------------------------

ARM = TwoLink()
START, RATES, HELD = np.array([0.3, 0.8]), np.array([0.5, -1.0]), np.array([0.15, -0.05])
DURATION, STEP = 1.0, 1e-3  # s
TOLERANCE = 0.002  # m: a tenth of the radius of the reaching task's target


def closed(arm: TwoLink = ARM) -> Array:
    """Return where the closed form's joints are after the motion, shape (2,)."""
    column = arm.column()
    column[TORQUES, 0] = HELD
    q, v = START[:, None], RATES[:, None]
    for _ in range(round(DURATION / STEP)):
        q, v = rk4(q, v, acceleration, STEP, column)
    return np.asarray(q[:, 0])


def spatial(tilt: float = 0.0, skew: float = 0.0, armature: float = 0.0) -> Array:
    """Return the tip of MuJoCo's arm in space after the same motion, (3,) [m].

    It is given in the base frame.

    The base is tilted about y, so that gravity pulls along x, the elbow's axis skewed about the
    first link [rad]; motors have an armature on their joints [kg m^2].
    """
    chain = replace(ARM.chain(), armature=armature)
    placement = chain.placement.copy()
    placement[3:, 1] = quaternion.exp(np.array([skew, 0.0, 0.0]))
    chain = replace(chain, placement=placement)
    g = STANDARD_GRAVITY * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    steps = round(DURATION / STEP)
    return tip(chain, mujoco_chain.moved(chain, START, RATES, HELD, g, STEP, steps))[:3]


def _tip_error(other: Array) -> float:
    return float(np.linalg.norm(other - tip(ARM.chain(), closed())[:3]))


def uncoupled() -> Array:
    """Return the tip if each joint felt a constant inertia of its own, and nothing of the other."""
    M, damping = np.diag(ARM.mass_matrix(START)), np.array(ARM.damping)
    rate = damping / M  # M v' = tau - c v has a closed form
    final = HELD / damping
    q = START + final * DURATION + (RATES - final) * (1 - np.exp(-rate * DURATION)) / rate
    return tip(ARM.chain(), q)[:3]


def reaching_arm() -> Scene:
    """Return the scene of the reaching task: where is the tip after a second of held torques?"""
    return Scene(
        question="Where is the tip of the two-link arm after a second?",
        tolerance=Tolerance(TOLERANCE, "m", "a tenth of the radius of the reaching task's target"),
        degrees_of_freedom=("shoulder", "elbow"),
        modelled=(
            Modelled(
                "coupling of the joints",
                lambda: _tip_error(uncoupled()),
                "m",
                against="two joints on their own",
            ),
            Modelled(
                "friction",
                lambda: _tip_error(tip(ARM.chain(), closed(replace(ARM, damping=(0.0, 0.0))))[:3]),
                "m",
                against="closed form without",
            ),
        ),
        left_out=(
            LeftOut(
                "base out of level by 0.01 deg",
                lambda: _tip_error(spatial(np.radians(0.01))),
                "m",
                against="MuJoCo in space",
            ),
            LeftOut(
                "elbow axis skewed by 0.03 deg",
                lambda: _tip_error(spatial(skew=np.radians(0.03))),
                "m",
                against="MuJoCo in space",
            ),
        ),
    )


@chart
def two_links_enough(angles: Sequence[float] = tuple(np.logspace(-3, 1, 17))) -> Iterator[Panel]:
    """Chart the error of the planar closed form against MuJoCo's arm in space.

    Args:
        angles: of the faults [degrees].
    """
    panel = Panel(
        "When are two links in a plane enough?",
        "fault [degrees]",
        "error of the tip after 1 s [m]",
        scale="log",
        lines=[("y", TOLERANCE, "tolerance")],
    )
    for name, fault in (
        ("base out of level", lambda x: spatial(tilt=x)),
        ("elbow axis skewed", lambda x: spatial(skew=x)),
    ):
        errors = np.array([_tip_error(fault(np.radians(x))) for x in angles])
        edge = float(np.interp(TOLERANCE, errors, angles))
        panel.series.append(
            Series(name, angles, errors, note=f"{name:<20} within 2 mm up to {edge:.2g} degrees")
        )
    motor = _tip_error(spatial(armature=0.005))
    panel.notes = [
        reaching_arm().table(),
        f"with neither fault the two agree to {_tip_error(spatial()):.1e} m; motors of 5 g m^2 on "
        f"the joints would move the tip by {1e3 * motor:.0f} mm; steps a second: chart vector_env",
    ]
    yield panel
