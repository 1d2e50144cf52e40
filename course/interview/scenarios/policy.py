"""A policy that works on its model fails on the robot: causes, probes, repairs."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from course.interview.scenarios import Cause, Probe, Repair, Scenario
from course.interview.scenarios.programs import policy as program
from course.interview.scenarios.programs.policy import STEP, SURFACE, Array, Log, Robot, move, press

BANDWIDTH = 10.7  # rad/s, of the policy that was trained
STEPS, HELD = 150, 25  # of a press: 0.6 s, within the key's width for the last 0.1 s
KEYS = 200
WIDTHS = np.linspace(0.01, 0.06, KEYS)  # rad
ENCODER = 2e-4  # standard deviation of a reading [rad]
SOFT = 7.0  # rad/s

_SEEN = program.observe(*program.poses(np.random.default_rng(0), 2000))
MODEL = Robot(
    inertia=0.05,
    drag=0.1,
    friction=0.02,
    stiffness=6.0,
    damping=0.1,
    limit=program.LIMIT,
    zero=0.0,
    delay=0,
    mean=_SEEN.mean(axis=1, keepdims=True),
    std=_SEEN.std(axis=1, keepdims=True),
)
LIMITED, DRAG, ZERO = 0.8, 0.93, 0.072  # N m, N m s/rad, rad
# The parameter that differs on the robot; of the statistics, only the angle's deviation does.
FAULTS: dict[str, dict[str, Any]] = {
    "late_drive": {"delay": 12},
    "dry_joint": {"friction": 0.56},
    "heavy_tool": {"inertia": 0.1095},
    "stiff_keys": {"stiffness": 9.3},
    "weak_drive": {"limit": LIMITED},
    "thick_grease": {"drag": DRAG},
    "shifted_zero": {"zero": ZERO},
    "foreign_statistics": {"std": MODEL.std * np.array([[1.415], [1.0], [1.0], [1.0], [1.0]])},
}
ON_MODEL = "model"  # is passed instead of a cause
LEARNT = {
    "refit_friction": "dry_joint",
    "refit_inertia": "heavy_tool",
    "refit_key": "stiff_keys",
    "refit_drag": "thick_grease",
}


def robot(cause: str, seed: int) -> Robot:
    """Return the robot of a seed: close to the model except for one cause. Or return the model."""
    if cause == ON_MODEL:
        return MODEL
    one, draw = replace(MODEL, **FAULTS[cause]), np.random.default_rng([2, seed])
    sizes = {"inertia": 0.005, "drag": 0.05, "friction": 0.02, "stiffness": 0.01}
    near = {name: getattr(one, name) * draw.uniform(1 - s, 1 + s) for name, s in sizes.items()}
    return replace(one, **near)


@cache
def weights(cause: str | None = None, bandwidth: float = BANDWIDTH) -> Array:
    """Return the policy trained on the model, or on a model with the measured value of a cause."""
    return program.train(replace(MODEL, **FAULTS[cause]) if cause else MODEL, bandwidth)


@cache
def widest() -> float:
    """Return the bandwidth [rad/s] that presses most keys on robots sampled from wide ranges."""
    rng = np.random.default_rng(0)
    target, width = rng.uniform(0.3, 1.0, 600), rng.uniform(0.01, 0.06, 600)
    wide = replace(
        MODEL,
        inertia=MODEL.inertia * rng.uniform(0.5, 1.5, 600),
        friction=rng.uniform(0.0, 0.6, 600),
        stiffness=MODEL.stiffness * rng.uniform(0.5, 1.5, 600),
        delay=rng.integers(0, 16, 600),
    )
    tried = (6.0, 8.0, 10.0, 12.0, 14.0)
    runs = [press(wide, weights(None, bandwidth), target, STEPS) for bandwidth in tried]
    return tried[int(np.argmax([program.success(run, target, width, HELD) for run in runs]))]


def repaired(cause: str, seed: int, repair: str | None) -> tuple[Robot, Array]:
    """Return robot and policy after a repair."""
    one = robot(cause, seed)
    if repair == "empty_queue":
        return replace(one, delay=MODEL.delay), weights()
    if repair == "ship_statistics":
        return replace(one, mean=MODEL.mean, std=MODEL.std), weights()
    if repair == "raise_limit":
        return replace(one, limit=MODEL.limit), weights()
    if repair == "set_zero":
        return replace(one, zero=MODEL.zero), weights()
    if repair in ("widen", "soften"):
        return one, weights(None, widest() if repair == "widen" else SOFT)
    return one, weights(LEARNT.get(repair or ""))


def keys(seed: int) -> Array:
    """Return targets [rad] spread evenly over depths and `WIDTHS`, a golden-ratio sequence."""
    first = np.random.default_rng([3, seed]).uniform()
    return 0.3 + 0.7 * ((first + np.arange(KEYS) * (np.sqrt(5.0) - 1.0) / 2.0) % 1.0)


def pressed(one: Robot, policy: Array, seed: int) -> tuple[Log, Array]:
    """Return a press of every key, and their targets in the order of the seed."""
    target = keys(seed)
    return press(one, policy, target, STEPS), target


def symptom(cause: str, seed: int, repair: str | None) -> float:
    """Return the fraction of keys that are pressed and held."""
    log, target = pressed(*repaired(cause, seed, repair), seed)
    return program.success(log, target, WIDTHS, HELD)


def price(cause: str, seed: int, repair: str) -> float:
    """Return the time until half of the presses are close, divided by that on the model."""
    arrivals = []
    for one, policy in (repaired(cause, seed, repair), (MODEL, weights())):
        log, target = pressed(one, policy, seed)
        near = np.median(np.abs(log.q / target - 1.0), axis=1) < 0.1
        arrivals.append(np.argmax(near) if near.any() else STEPS)
    return float(arrivals[0] / arrivals[1])


# --- Probes ---------------------------------------------------------------------------------------


def sensed(figure: float, noise: float, seed: int) -> float:
    """Return a figure with the noise of an instrument with this standard deviation."""
    return figure + noise * float(np.random.default_rng([4, seed]).normal())


def driven(one: Robot, requested: Array, v: float = 0.0, q: float = 0.0) -> Log:
    """Run the robot in open loop from `q` and `v` with the torques `requested`, (steps,)."""
    return move(
        one, lambda i, q, _: requested[i] + 0.0 * q, np.full(1, q), np.full(1, v), len(requested)
    )


def statistics(cause: str, seed: int) -> float:
    """Return the standard deviation of the scaled angle over poses like those in training."""
    observed = program.observe(*program.poses(np.random.default_rng([4, seed]), 2000))[0]
    return float(np.std(observed) / robot(cause, seed).std[0, 0])


def swapped(cause: str, seed: int) -> float:
    """Return the symptom with the statistics of training."""
    return symptom(cause, seed, "ship_statistics")


def frozen(cause: str, seed: int) -> float:
    """Return how far the arm moves away from a target at its current angle [mrad]."""
    one, start = robot(cause, seed), np.full(1, 0.2)
    log = move(
        one, lambda _, q, v: program.torque(one, weights(), start, q, v), start, 0.0 * start, 125
    )
    return 1e3 * sensed(float(np.abs(log.q - start).max()), ENCODER, seed)


@cache
def recorded() -> tuple[Array, Array]:
    """Return torques and angles of one press on the model."""
    log = press(MODEL, weights(), np.array([0.9]), 100)
    return log.commanded[:, 0], log.q[:, 0]


def replayed(first: int, last: int) -> Callable[[str, int], float]:
    """Return the probe that replays the torques.

    Its figure is the root mean square difference of the angles [mrad].
    """

    def run(cause: str, seed: int) -> float:
        requested, angles = recorded()
        noise = np.random.default_rng([5, seed]).normal(0.0, ENCODER, last)
        difference = driven(robot(cause, seed), requested[:last]).q[:, 0] + noise - angles[:last]
        return 1e3 * float(np.sqrt(np.mean(difference[first:] ** 2)))

    return run


def positions(cause: str, seed: int) -> float:
    """Return the torque of a slow servo deep in a key, minus what the model needs there [N m]."""
    path = np.linspace(0.0, 0.8, 250)

    def servo(i: int, q: Array, v: Array) -> Array:
        return 8.0 * (path[i] - q) - 0.8 * v

    log = move(robot(cause, seed), servo, np.zeros(1), np.zeros(1), 250)
    q, v, requested = log.q[200:], log.v[200:], log.commanded[200:]
    held = MODEL.stiffness * (q - SURFACE) + (MODEL.drag + MODEL.damping) * v + MODEL.friction
    return sensed(float(np.mean(requested - held)), 0.01, seed)


def strike(cause: str, seed: int) -> float:
    """Return how deep the arm moves into a key that it meets at 2 rad/s without torque [mrad]."""
    log = driven(robot(cause, seed), np.zeros(60), 2.0, SURFACE)
    return 1e3 * sensed(float(log.q.max() - SURFACE), ENCODER, seed)


def coast(cause: str, seed: int) -> float:
    """Return the velocity lost in a tenth of a second without torque [rad/s]."""
    log = driven(robot(cause, seed), np.zeros(25), 3.0)
    return sensed(3.0 - float(log.v[-1, 0]), 0.02, seed)


def lag(cause: str, seed: int) -> float:
    """Return the shift at which commands and accelerations correlate best [ms]."""
    draw = np.random.default_rng([6, seed])
    requested = np.repeat(draw.choice((-1.5, 1.5), 50), 3)
    speed = driven(robot(cause, seed), requested).v[:, 0] + draw.normal(0.0, 0.02, 150)
    change = np.diff(speed, prepend=0.0)
    alike = [np.dot(requested[:120], change[k : k + 120]) for k in range(30)]
    return 1e3 * STEP * float(np.argmax(alike))


def breakaway(cause: str, seed: int) -> float:
    """Return the torque of a slow ramp at which the arm starts to move [N m]."""
    ramp = np.linspace(0.0, 0.7, 350)  # 0.5 N m/s
    angle = driven(robot(cause, seed), ramp).q[:, 0]
    return sensed(float(ramp[np.argmax(angle > 2e-3)]), 0.005, seed)


def two_torques(cause: str, seed: int) -> float:
    """Return the inertia from the velocities under 1 and 2 N m and the model's drag [kg m^2]."""
    one, answered, steps = robot(cause, seed), 15, 15
    low, high = (driven(one, np.full(answered + steps, u)).v[:, 0] for u in (1.0, 2.0))
    lost = 1.0 - MODEL.drag * (high - low)
    lasting = (lost[-1] / lost[answered - 1]) ** (1.0 / steps)
    # If the drive is limited to 1 N m or less, both velocities are the same.
    return sensed(float(MODEL.drag * STEP / max(1.0 - lasting, 1e-3)), 3e-4, seed)


def untouched(cause: str, seed: int) -> float:
    """Return the fraction of targets above the keys that are reached."""
    target = np.linspace(0.2, SURFACE - 0.01, 50)
    width = np.random.default_rng([7, seed]).permutation(np.linspace(0.01, 0.06, 50))
    return program.success(press(robot(cause, seed), weights(), target, STEPS), target, width, HELD)


@cache
def on_model(probe: str) -> float:
    """Return the figure of a probe on the model: the median of several readings."""
    return float(np.median([SCENARIO.a_probe(probe).run(ON_MODEL, seed) for seed in range(7)]))


SCENARIO = Scenario(
    name="policy",
    title="The policy works on its model and fails on the robot",
    prompt="An arm with one joint presses keys of different depths and widths. Its policy was "
    "trained on a model of the arm, and on the model it presses every key in time and holds "
    "it. On the real robot it presses and holds fewer than half of them. You can read the "
    "program, but not the parameters of the robot; you can only run the probes below. Each result "
    "is shown next to that on the model. "
    "What differs between the robot with its program and the training, and what do you change?",
    symptom_words="fraction of keys pressed and held",
    unit="",
    symptom=symptom,
    spread=0.25,
    removed=lambda figure: figure >= 0.95,
    causes=(
        Cause(
            "late_drive",
            "The drive keeps commands in a queue, so each torque is applied late by the length of "
            "the queue.",
            "empty_queue",
        ),
        Cause(
            "dry_joint",
            "The joint has dry friction: below a break-away torque the arm does not move.",
            "refit_friction",
        ),
        Cause(
            "heavy_tool", "The arm carries a tool that the model does not have.", "refit_inertia"
        ),
        Cause("stiff_keys", "The keys are stiffer than those of the model.", "refit_key"),
        Cause(
            "weak_drive",
            "The drive's torque limit is lower than what deep keys need.",
            "raise_limit",
        ),
        Cause(
            "thick_grease",
            "The joint's grease is thick and brakes the arm in proportion to its velocity.",
            "refit_drag",
        ),
        Cause(
            "shifted_zero",
            "The encoder's zero is shifted, so every measured angle has the same error.",
            "set_zero",
        ),
        Cause(
            "foreign_statistics",
            "The observed angle is scaled with the statistics of a different run, not with those "
            "of the run that trained the policy.",
            "ship_statistics",
        ),
    ),
    probes=(
        Probe(
            "print_statistics",
            "standard deviation of the normalised angle that the policy uses, in poses like those "
            "of training",
            "",
            4,
            statistics,
            0.03,
        ),
        Probe(
            "swap_statistics",
            "fraction of keys pressed and held if the policy normalises the angle by the mean and "
            "standard deviation that were saved in training",
            "",
            10,
            swapped,
            0.06,
        ),
        Probe(
            "freeze_target",
            "how far the arm moves if its target is its current angle",
            "mrad",
            6,
            frozen,
            1.0,
        ),
        Probe(
            "replay_early",
            "difference between the angles of robot and model in the first 80 ms when both get the "
            "torques that were recorded during a press on the model",
            "mrad",
            15,
            replayed(0, 20),
            2.0,
        ),
        Probe(
            "replay_late",
            "the same difference in the last 80 of 400 ms",
            "mrad",
            15,
            replayed(80, 100),
            10.0,
        ),
        Probe(
            "replay_positions",
            "torque of a slow servo that moves the arm deep into a key, minus the torque that the "
            "model needs there",
            "N m",
            20,
            positions,
            0.04,
        ),
        Probe(
            "strike_key",
            "depth that the arm reaches in a key that it meets at 2 rad/s without torque",
            "mrad",
            12,
            strike,
            3.0,
        ),
        Probe(
            "coast",
            "velocity lost in 0.1 s without torque, starting at 3 rad/s",
            "rad/s",
            8,
            coast,
            0.06,
        ),
        Probe(
            "step_lag",
            "time shift at which commands and accelerations correlate best",
            "ms",
            15,
            lag,
            2.0,
        ),
        Probe(
            "break_away",
            "torque of a slow ramp at which the arm starts to move",
            "N m",
            10,
            breakaway,
            0.03,
        ),
        Probe(
            "two_torques",
            "inertia estimated from the velocities under two constant torques",
            "kg m^2",
            12,
            two_torques,
            2e-2,
        ),
        Probe(
            "no_touch",
            "fraction of targets reached when all of them are above the keys",
            "",
            6,
            untouched,
            0.1,
        ),
    ),
    repairs=(
        Repair("empty_queue", "The drive applies the newest command and drops all others."),
        Repair(
            "refit_friction",
            "The break-away torque is measured and put into the model; the policy is trained "
            "again.",
        ),
        Repair(
            "refit_inertia",
            "The inertia is measured and put into the model; the policy is trained again.",
        ),
        Repair(
            "refit_key",
            "The keys' stiffness is measured and put into the model; the policy is trained again.",
        ),
        Repair("raise_limit", "The torque limit is set to what the drive can bear."),
        Repair(
            "refit_drag",
            "The joint's drag is measured and put into the model; the policy is trained again.",
        ),
        Repair("set_zero", "The encoder's zero is set again at the mechanical stop."),
        Repair("ship_statistics", "The robot loads the statistics that were saved in training."),
        Repair(
            "widen",
            "The policy is trained for robots sampled from wide ranges of delay, friction, "
            "inertia and stiffness.",
        ),
        Repair("soften", "The policy is trained to move the arm more slowly."),
    ),
    popular="widen",
    price=price,
    price_words="time until the arm is close to the key, relative to the model",
    affordable=1.4,
    path=6,
    on_model=on_model,
)
