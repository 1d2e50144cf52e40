"""Chapter 2, contact models: speed against accuracy beside MuJoCo, and where each of them fails."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.charts import chart
from course.contact import scenes
from course.contact.scenes import GRAVITY, Scene, march, run
from course.measure.figure import Panel, Series
from course.measure.work_precision import Method, Result, WorkPrecision, measure
from course.oracles.mujoco import contact as mujoco_contact
from course.oracles.mujoco.contact import Options
from course.oracles.mujoco.kit import Runner

Array = NDArray[np.float64]

# --- five scenes and what is asked of them --------------------------------------------------------

SOLVERS = [(s, c, "Euler") for c in ("elliptic", "pyramidal") for s in ("Newton", "CG", "PGS")]
SOLVERS.append(("Newton", "elliptic", "discrete"))
# MuJoCo's softness set for stiff contact: a time constant of two steps of 2 ms, an impedance near
# 1 and stiff friction rows. The penalty's stiffness is chosen scene by scene, so MuJoCo's is, too.
HARDENED: dict[str, Any] = {
    "solref": (0.004, 1.0),
    "solimp": (0.99, 0.9999, 0.001, 0.5, 2.0),
    "impratio": 100.0,
}
HARD = "MuJoCo Newton, hardened"

DURATION = 0.24  # s, of every question
LOAD = (0.1, 0.05)  # m, where the weight acts on the table


@dataclass(frozen=True)
class Question:
    """A scene, its answer in closed form, the error it can bear, and whom it is asked.

    Attributes:
        text: the question.
        scene: for our models.
        ask_mujoco: `Options` -> the same scene prepared.
        answer: state at the end -> the compared quantity [m].
        truth: by closed form [m].
        tolerance: [m].
        stiffness: of penalty contact, chosen to sink less than the tolerance [N/m].
        lightest: mass for which penalty contact is critically damped [kg].
    """

    text: str
    scene: Scene
    ask_mujoco: Callable[[Options], Runner]
    answer: Callable[[Array], Array]
    truth: Array
    tolerance: float
    stiffness: float = 1e5
    lightest: float = 1.0


_MU, _SLOPE = 0.5, math.radians(40.0)
_SENT = (math.cos(math.radians(22.5)), math.sin(math.radians(22.5)))  # m/s
_ALONG = GRAVITY * (math.sin(_SLOPE) - _MU * math.cos(_SLOPE))
QUESTIONS = {
    "braking": Question(
        "Where is a block 0.24 s after it is sent off at 1 m/s and 22.5 degrees?",
        scenes.block(0.0, _MU, _SENT),
        lambda options: mujoco_contact.block(options, 0.0, _SENT),
        lambda q: q[:2],
        np.array(_SENT) / (2.0 * _MU * GRAVITY),
        2e-3,
    ),
    "incline": Question(
        "How far does a block slide down 40 degrees in 0.24 s?",
        scenes.block(_SLOPE, _MU),
        lambda options: mujoco_contact.block(options, _SLOPE),
        lambda q: q[:1],
        np.array([0.5 * _ALONG * DURATION**2]),
        1e-3,
    ),
    "heavy": Question(
        "How deep is 1 kg in the ground 0.24 s after 100 kg are set on it?",
        scenes.tower([1.0, 100.0]),
        lambda options: mujoco_contact.tower(replace(options, condim=1), [1.0, 100.0]),
        lambda q: q[:1],
        np.zeros(1),
        1e-3,
        2e6,
    ),
    "glass": Question(
        "How far does a held glass slip in 0.24 s?",
        scenes.pinch(5.0, 0.25),
        lambda options: mujoco_contact.pinch(replace(options, friction=(0.25, 0.005, 0.0001))),
        lambda q: q[3:],
        np.zeros(1),
        1e-3,
        lightest=0.05,
    ),
    "legs": Question(
        "How deep do a table's four legs sink, the load off its middle?",
        scenes.table(LOAD),
        lambda options: mujoco_contact.table(replace(options, condim=1), LOAD),
        lambda q: scenes.table().jacobian[:, 0] @ q,
        np.zeros(4),
        1e-3,
    ),
}
_ROUNDING = 1e-12  # m; what is nearer is drawn here
# What is drawn of thirteen; the others can be switched on.
DRAWN = (
    "penalty",
    "sweeps, compiled loop",
    "true cone (Newton)",
    "convex cone",
    "MuJoCo Newton, elliptic",
    HARD,
)
STEPS = (2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4)
OURS: dict[str, tuple[str, dict[str, Any]]] = {
    "penalty": ("penalty", {}),
    "exact pyramid (LCP)": ("lcp", {}),
    "sweeps, true cone (10)": ("pgs", {"sweeps": 10}),
    "sweeps, true cone (1000)": ("pgs", {"sweeps": 1000}),
    "true cone (Newton)": ("coulomb", {}),
    "convex cone": ("convex", {}),
    "MuJoCo's soft model, ours": ("soft", {"cone": "elliptic"}),
}


def _steps(dt: float) -> tuple[int, float]:
    """Return the number of steps, and the length of each [s]."""
    # Whole steps that end exactly at the compared time.
    n = round(DURATION / dt)
    return n, DURATION / n


def _ours(name: str, question: Question, dt: float) -> scenes.Run:
    model, options = OURS[name]
    if model == "penalty":
        # Critical damping for the lightest body of the scene.
        damping = 2.0 * math.sqrt(question.stiffness * question.lightest)
        options = {"stiffness": question.stiffness, "damping": damping}
    n, h = _steps(dt)
    return run(question.scene, model, h, n, **options)


def _our_method(name: str, question: Question, steps: Sequence[float]) -> Method:
    def once(dt: float) -> Result:
        result = _ours(name, question, dt)
        return Result(question.answer(result.q[:, -1]), _steps(dt)[0] + result.iterations)

    return Method(name, once, steps, unit="steps and iterations")


def _compiled(question: Question, steps: Sequence[float]) -> Method:
    """Return sweeps in one compiled loop, started from the impulses of the step before."""

    def once(dt: float) -> Result:
        n, h = _steps(dt)
        q, _, taken = march(question.scene, h, n, tolerance=1e-7)
        return Result(question.answer(q), n + taken)

    return Method("sweeps, compiled loop", once, steps, unit="steps and iterations")


def _mujocos(
    solver: str,
    cone: str,
    integrator: str,
    question: Question,
    steps: Sequence[float],
    name: str = "",
    **softness: Any,
) -> Method:
    runners = {}
    for dt in steps:
        n, h = _steps(dt)
        options = Options(h, integrator, solver, cone=cone, tolerance=1e-10, **softness)
        runner = question.ask_mujoco(options)
        # Compiled models and the count of iterations are prepared here, outside the timed function.
        runners[dt] = runner, n, n + mujoco_contact.iterations(runner, n)

    def once(dt: float) -> Result:
        # Only the run itself is timed: one call of MuJoCo's own loop.
        runner, n, cost = runners[dt]
        return Result(question.answer(runner.run(n)[0]), cost)

    if not name:
        name = f"MuJoCo {solver}, {cone}" + (", discrete" if integrator == "discrete" else "")
    return Method(name, once, steps, "oracle", "steps and iterations")


def work_precision(
    name: str, steps: Sequence[float] = STEPS, repeats: int = 3, names: Sequence[str] | None = None
) -> WorkPrecision:
    """Return the error against cost of every model and of MuJoCo's solvers on one of `QUESTIONS`.

    Args:
        name: of the question.
        steps: [s].
        repeats: timed rounds.
        names: of the methods; None for all.
    """
    question = QUESTIONS[name]
    # Sweeps at a fine step, their positions made those of the trapezoid rule, of second order.
    n, h = _steps(2e-4)
    fine = run(question.scene, "pgs", h, n, sweeps=20000)
    # An independent check of the closed form: end positions of first order, corrected to the
    # trapezoid rule.
    check = fine.q[:, -1] - 0.5 * h * (fine.v[:, -1] - fine.v[:, 0])
    methods = [_our_method(ours, question, steps) for ours in OURS]
    methods.append(_compiled(question, steps))
    methods += [_mujocos(*which, question, steps) for which in SOLVERS]
    methods.append(_mujocos("Newton", "elliptic", "Euler", question, steps, HARD, **HARDENED))
    return measure(
        [
            replace(method, extra=method.name not in DRAWN)
            for method in methods
            if names is None or method.name in names
        ],
        question.truth,
        lambda answer, truth: max(float(np.linalg.norm(answer - truth)), _ROUNDING),
        reference_check=question.answer(check),
        tolerance=question.tolerance,
        failed_above=0.3,
        repeats=repeats,
        sample_time=0.0,
        # MuJoCo's runs of a tenth of a millisecond take turns with NumPy loops of a hundred.
        warm_up=0.02,
        question=question.text,
        error_unit="m",
    )


def _chart_of(name: str) -> None:
    def contact_scene(steps: Sequence[float] = STEPS, repeats: int = 3) -> Iterator[Panel]:
        """Chart every model on one scene, steps of 0.1 to 20 ms, beside MuJoCo."""
        yield from work_precision(name, steps, repeats).panels()

    chart(contact_scene, name=f"contact_{name}")


for _name in ("braking", "incline", "heavy", "glass"):
    _chart_of(_name)


Rows = list[tuple[str, str, float, float, float, str]]  # scene, model, error, cost, count, verdict

# --- the table ------------------------------------------------------------------------------------


def _hits(rows: Rows, scene: str, *words: str) -> list[bool]:
    """Return whether the models of a scene whose name holds one of the words are good."""
    return [row[5] == "good" for row in rows if row[0] == scene and any(w in row[1] for w in words)]


def _error(rows: Rows, scene: str, model: str) -> float:
    return next(row[2] for row in rows if row[:2] == (scene, model))


NEWTON = "MuJoCo Newton, elliptic"
SENTENCES: dict[str, Callable[[Rows], bool]] = {
    "A block launched between the pyramid's edges stops wrongly; the cone is right.": lambda r: (
        not any(_hits(r, "braking", "pyramid"))
        and all(_hits(r, "braking", "true cone", "convex", "elliptic", HARD, "ours", "compiled"))
    ),
    "On the slope, along an edge of the pyramid, all models are good.": lambda r: all(
        _hits(r, "incline", "")
    ),
    "By default 1 kg in MuJoCo sinks by centimetres under 100 kg, with any solver.": (
        lambda r: min(_error(r, "heavy", f"MuJoCo {s}, {c}") for s, c, _ in SOLVERS) > 0.01
    ),
    "Hardened, MuJoCo bears the heavy body and holds the glass, each within its tolerance.": (
        lambda r: all(_hits(r, "heavy", HARD) + _hits(r, "glass", HARD))
    ),
    "Pivots, Newton on the cone and 1000 sweeps carry the heavy body. Ten sweeps miss.": lambda r: (
        all(_hits(r, "heavy", "LCP", "(Newton)", "convex", "(1000)"))
        and not any(_hits(r, "heavy", "(10)"))
    ),
    "Where a body is light, penalty contact fails at this step.": lambda r: (
        math.isinf(_error(r, "heavy", "penalty")) and math.isinf(_error(r, "glass", "penalty"))
    ),
    "By default a held glass creeps in MuJoCo, about three times as far with the pyramid.": (
        lambda r: (
            not any(_hits(r, "glass", "elliptic", "pyramidal", "soft model"))
            and 2.5
            < _error(r, "glass", "MuJoCo Newton, pyramidal") / _error(r, "glass", NEWTON)
            < 3.5
        )
    ),
    "Rigid models keep a table's legs still; with soft ones they sink, within the tolerance.": (
        lambda r: all(_hits(r, "legs", "")) and _error(r, "legs", NEWTON) > 1e-5
    ),
    "Our soft model errs like MuJoCo's. On legs it errs more: there MuJoCo's A-hat is smaller.": (
        lambda r: all(
            ratio > 2.0 if s == "legs" else abs(ratio - 1.0) < 1e-6
            for s in QUESTIONS
            for ratio in [_error(r, s, "MuJoCo's soft model, ours") / _error(r, s, NEWTON)]
        )
    ),
}


def leg_forces(dt: float = 2e-3) -> dict[str, Array]:
    """Return the force in each leg at the end, by contact model and MuJoCo solver, (4,) [N]."""
    question, (n, h) = QUESTIONS["legs"], _steps(dt)
    result = {name: _ours(name, question, dt).impulses[:, 0, -1] / h for name in OURS}
    for solver in mujoco_contact.SOLVERS:
        # Enough iterations that the distribution is the model's and not the solver's.
        runner = question.ask_mujoco(Options(h, solver=solver, iterations=3000))
        runner.run(n)
        state = mujoco_contact.contact_state(runner)
        assert state is not None
        result[f"MuJoCo {solver}"] = state.force
    return result


@chart
def contact_table(dt: float = 2e-3, repeats: int = 3) -> Iterator[Panel]:
    """Chart model by scene: error, cost, verdict at one step `dt` [s], timed `repeats` times."""
    panel = Panel("Contact models at one step", data=[])
    rows: Rows = []
    panel.notes.append(
        f"a step of {1e3 * dt:g} ms; an error within the scene's tolerance is 'good'"
    )
    panel.notes.append(
        "MuJoCo's rows have its default softness; 'hardened': "
        + ", ".join(f"{name} {value}" for name, value in HARDENED.items())
    )
    panel.notes.append(f"{'scene':<8} {'model':<33} {'error':>9} {'a step':>9} {'iterations':>10}")
    for name in QUESTIONS:
        result = work_precision(name, [dt], repeats)
        steps, _ = _steps(dt)
        for curve in result.curves:
            point = curve.points[0]
            verdict = "good" if point.error <= (result.tolerance or 0.0) else "misses"
            verdict = "FAILS" if point.failure else verdict
            per_step, iterations = point.time / steps, point.count / steps - 1.0
            rows.append((name, curve.name, point.error, per_step, iterations, verdict))
            panel.notes.append(
                f"{name:<8} {curve.name:<33} {1e3 * point.error:6.3f} mm {1e6 * per_step:6.1f} us "
                f"{iterations:10.1f}  {verdict}"
            )
    panel.data = [list(row) for row in rows]
    panel.notes += [sentence for sentence, holds in SENTENCES.items() if holds(rows)]
    yield panel
    legs = {name: force.round(2).tolist() for name, force in leg_forces(dt).items()}
    yield Panel(
        "What a table's legs carry [N]",
        data=list(legs.items()),
        notes=["legs of the table, in turn around it, load off the middle [N]"]
        + [f"carry    {name:<33} " + " ".join(f"{x:8.2f}" for x in f) for name, f in legs.items()],
    )


# --- steering -------------------------------------------------------------------------------------


def stopped(
    name: str, degrees: float, dt: float = 1e-3, speed: float = 1.0, **options: Any
) -> tuple[float, float]:
    """Return (way to the stop over Coulomb's, direction [degrees]) of a block sent off at an angle.

    Args:
        name: one of our models, or "pyramidal" or "elliptic" for MuJoCo's cones.
        degrees: direction.
        dt: [s].
        speed: [m/s].
        **options: of the model.
    """
    t, mu = math.radians(degrees), 0.5
    velocity = (speed * math.cos(t), speed * math.sin(t))
    # 1.6 times the time that Coulomb's law takes to stop the block.
    steps = round(1.6 * speed / (mu * GRAVITY) / dt)
    if name in ("pyramidal", "elliptic"):
        stiff = Options(dt, cone=name, **options)
        end = mujoco_contact.block(stiff, 0.0, velocity, -1e-4).run(steps)[0]
    else:
        end = run(scenes.block(0.0, mu, velocity), name, dt, steps, **options).q[:, -1]
    distance = math.hypot(end[0], end[1]) / (speed**2 / (2.0 * mu * GRAVITY))
    return distance, math.degrees(math.atan2(end[1], end[0]))


TITLES = {
    "stretched": "How far a braking block slides",
    "turned": "In which direction it stops",
}


@chart
def contact_steering(
    degrees: Sequence[float] = (0.0, 10.0, 22.5, 35.0, 45.0, 60.0, 75.0, 90.0), dt: float = 1e-3
) -> Iterator[Panel]:
    """Chart what a pyramid in the cone does to a braking block, and one around it, a box of limits.

    The way is stretched or shortened, and bent, by the direction of the start; steps of `dt` [s].
    """

    def stretched(a: float) -> float:
        return math.hypot(1.0, math.sin(math.radians(2.0 * a)))

    def shortened(a: float) -> float:
        return math.sqrt(1.0 - 0.5 * math.sin(math.radians(2.0 * a)) ** 2)

    def turned(a: float) -> float:
        end = math.degrees(math.atan(math.sin(math.radians(2.0 * a))))
        return (end if a <= 45.0 else 90.0 - end) - a

    # A box brakes each axis by itself: the stop is at (cos^2, sin^2) of the way.
    def boxed(a: float) -> float:
        return (
            math.degrees(math.atan2(math.sin(math.radians(a)) ** 2, math.cos(math.radians(a)) ** 2))
            - a
        )

    t = np.array(degrees)
    requested: dict[str, tuple[str, dict[str, Any]]] = {
        "exact pyramid (LCP)": ("lcp", {}),
        "box of limits (LCP)": ("lcp", {"around": True}),
        "true cone (Newton)": ("coulomb", {}),
        "MuJoCo Newton, pyramidal": ("pyramidal", {}),
        "MuJoCo Newton, elliptic": ("elliptic", {}),
    }
    result = {
        name: [stopped(owner, a, dt, **how) for a in t] for name, (owner, how) in requested.items()
    }
    theories = [
        (
            "stopping distance / Coulomb's",
            "stretched",
            {"exact pyramid (LCP)": stretched, "box of limits (LCP)": shortened},
        ),
        (
            "final minus initial direction [degrees]",
            "turned",
            {"exact pyramid (LCP)": turned, "box of limits (LCP)": boxed},
        ),
    ]
    at = [int(np.argmin(np.abs(t - a))) for a in (22.5, 45.0)]
    for which, (what, short, laws) in enumerate(theories):
        panel = Panel(TITLES[short], "pushed off at [degrees]", what)
        for label, pairs in result.items():
            y = np.array([pair[which] - which * a for pair, a in zip(pairs, t, strict=True)])
            panel.series.append(
                Series(
                    label,
                    t,
                    y,
                    label,
                    theory=laws.get(label),
                    hollow="MuJoCo" in label,
                    note=f"{short:<9} {label:<26} at 22.5 degrees {y[at[0]]:8.4f}, "
                    f"at 45 degrees {y[at[1]]:8.4f}",
                )
            )
        yield panel


# --- gradients ------------------------------------------------------------------------------------


PUSH = {"stiffness": 2e3, "damping": 60.0}  # N/m, N s/m, of the penalty contact in `pushed`


def finger_and_block(speed: float) -> Scene:
    """Return a finger of 1 kg that moves at `speed` [m/s] at a block of 1 kg, 0.1 m ahead of it."""
    return Scene(
        np.eye(2),
        np.array([[[-1.0, 1.0]]]),
        np.array([0.1]),
        np.zeros(2),
        np.zeros((1, 0)),
        np.zeros(2),
        np.array([speed, 0.0]),
    )


def pushed(speed: float, how: str, dt: float = 5e-3, softness: float = 0.0) -> float:
    """Return where a block of 1 kg is 0.5 s after a finger of 1 kg is sent at it [m].

    The finger starts at a distance of 0.1 m.

    Args:
        speed: of the finger [m/s]; below 0.2 it does not arrive.
        how: "rigid", "penalty", or "interior point", where force times gap speed is `softness`
            instead of 0.
        dt: [s].
        softness: [W], times the step.
    """
    scene = finger_and_block(speed)
    steps = round(0.5 / dt)
    if how == "penalty":
        return float(run(scene, "penalty", dt, steps, **PUSH).q[1, -1])
    if how == "rigid":
        return float(run(scene, "coulomb", dt, steps).q[1, -1])
    q, v = scene.q.copy(), scene.v.copy()
    for _ in range(steps):
        problem = scene.problem(dt, q, v)
        a, b = problem.delassus[0, 0], problem.offset[0]
        # Positive root of the relaxed complementarity condition f (a f + b) = softness.
        impulse = (-b + math.sqrt(b * b + 4.0 * a * softness)) / (2.0 * a)  # f (a f + b) = softness
        v = problem.after([[impulse]])
        q = q + dt * v
    return float(q[1])


def rebound(start: float, dt: float = 0.02) -> float:
    """Return where a ball is that flies at a wall at 1 m/s and bounces without loss [m].

    It is evaluated at the end of the step that reaches 1 s; `start` is its distance from the wall.
    """
    x, v = -start, 1.0
    for _ in range(round(1.0 / dt)):
        x += dt * v
        # The late impact: reversed only at the end of the step, with the overlap left in.
        if x > 0.0:
            v = -abs(v)
    return x


def slope(f: Callable[[float], float], x: float, width: float) -> float:
    """Return central difference."""
    return (f(x + width) - f(x - width)) / (2.0 * width)


def smoothed_slope(
    f: Callable[[float], float], x: float, width: float, rng: np.random.Generator, draws: int = 100
) -> float:
    """Return the derivative of the mean of f over Gaussian perturbations.

    It is estimated from pairs of values alone.
    """
    e = rng.standard_normal(draws)
    # Score function of a Gaussian with antithetic pairs: no derivative of f is needed.
    values = [(f(x + width * z) - f(x - width * z)) * z / (2.0 * width) for z in e]
    return float(np.mean(values))


SOFTENED = 1e-2  # W times the step: a relaxation that can be seen


@chart
def contact_gradients(points: int = 31, draws: int = 100) -> Iterator[Panel]:
    """Chart gradients through contact: nothing before touch, a kink, and a sign that is wrong.

    At so many speeds, the randomised ones of so many pairs of draws.
    """
    rng = np.random.default_rng(0)
    speeds = np.linspace(0.1, 0.4, points)
    panel = Panel(
        "A finger pushes a block: derivative of the outcome",
        "speed of the finger [m/s]",
        "derivative of the final position [s]",
        ylim=(-0.05, 0.85),
        lines=[("x", 0.2, "touch")],
    )
    methods: dict[str, tuple[str, Callable[[float], float]]] = {
        "rigid": ("true cone (Newton)", lambda p: slope(lambda s: pushed(s, "rigid"), p, 1e-5)),
        "penalty": ("penalty", lambda p: slope(lambda s: pushed(s, "penalty"), p, 1e-5)),
        "interior point": (
            "convex cone",
            lambda p: slope(lambda s: pushed(s, "interior point", softness=SOFTENED), p, 1e-5),
        ),
        "randomised, 50 mm/s": (
            "sweeps, true cone",
            lambda p: smoothed_slope(lambda s: pushed(s, "rigid", 2e-2), p, 0.05, rng, draws),
        ),
    }
    # x = v (0.5 - 0.1 / v) / 2 once it touches, at 0.2 m/s.
    edges, truth = [speeds[0], 0.2, 0.2, speeds[-1]], [0.0, 0.0, 0.25, 0.25]
    panel.series.append(Series("truth", edges, truth, "theory", "-", marker=""))
    for label, (key, derivative) in methods.items():
        y = np.array([derivative(p) for p in speeds])
        # Without the speeds next to touch, where differences straddle the kink.
        before, after = y[speeds < 0.19], y[speeds > 0.21]
        panel.series.append(
            Series(
                label,
                speeds,
                y,
                key,
                note=f"{label:<20} before touch {np.mean(before):7.4f}, after it "
                f"{np.median(after):7.4f} (median)",
            )
        )
    yield panel
    starts = np.linspace(0.3, 0.5, 600)
    panel = Panel(
        "A bounce applied at the end of its step",
        "initial distance from the wall [m]",
        "position after 1 s [m]",
    )
    panel.series.append(
        Series(
            "stepped",
            starts,
            np.array([rebound(s) for s in starts]),
            "sweeps, true cone",
            marker="",
            note="derivative of the end by the start, truth 1 (the end is start - 1)",
        )
    )
    panel.series.append(Series("true", starts, starts - 1.0, "theory", "--", marker=""))
    own = [slope(rebound, s, 1e-7) for s in rng.uniform(0.3, 0.5, 50)]
    mean = [smoothed_slope(rebound, s, 0.05, rng, draws) for s in rng.uniform(0.3, 0.5, 20)]
    panel.notes.append(f"along the steps    {np.median(own):7.4f}: the wrong sign")
    panel.notes.append(f"randomised, 50 mm  {np.mean(mean):7.4f}")
    yield panel
