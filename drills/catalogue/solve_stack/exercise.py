"""A stack of boxes: the residual of Coulomb's law, and the products with its matrix are counted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drills.attempt import Attempt, Place
from drills.cards import definitions
from drills.case_code import literal
from drills.case_judge import WHOLE, Case, repeat_calls
from drills.catalogue.solve_stack.scene import HEIGHT, WIDTH, coulomb_errors, stack_matrix
from drills.chart_plan import Drawing
from drills.exercise import Exercise, slips, value_slips
from drills.grade_report import LEVELS
from drills.inprocess import InProcess
from drills.sandbox import Limits
from drills.values import describe_call, numbers

Array = NDArray[np.float64]
SCENE = Path(__file__).with_name("scene.py")
STEP = 0.01  # s, whose gravity the contacts have to stop
LIMIT = 1000  # products of one call, after which `product` raises


@dataclass(frozen=True)
class Bar:
    """What a stack demands: the largest residual, and the most products, a function of unknowns."""

    residual: float
    products: Callable[[int], float]


BARS = {
    "simple": Bar(1e-2, lambda unknowns: 400.0),
    "core": Bar(1e-4, lambda unknowns: 2.0 * unknowns),
    "edge": Bar(1e-6, lambda unknowns: 0.5 * unknowns),
}


class Product:
    """The Delassus matrix of a stack, which the grader multiplies and counts in its own process.

    Attributes:
        matrix: A, which no answer gets.
        rows: that were multiplied so far.
        calls: products so far, of whatever number of rows.
        probes, partial: calls with zeros and ones only; with at most half of the rows.
        trace: what was multiplied at about every seventh product.
        copies: of this function that were made, each with its own counts.
    """

    __name__ = "product"

    def __init__(self, matrix: ArrayLike, source: str) -> None:
        self.matrix, self.source = np.asarray(matrix, dtype=float), source
        self.rows = self.calls = self.probes = self.partial = 0
        self.trace: list[Array] = []
        self.copies: list[Product] = []

    @property
    def products(self) -> float:
        """The number of products with the whole matrix that the rows amount to."""
        return self.rows / len(self.matrix)

    def fresh(self) -> Product:
        """Return the same function with nothing counted."""
        return Product(self.matrix, self.source)

    def __deepcopy__(self, memo: Any) -> Product:
        """Return a function of its own for the worked answer, whose products do not count."""
        copy = self.fresh()
        self.copies.append(copy)
        return copy

    def code(self) -> str:
        """Return the product as a function that a learner can run."""
        return (
            f"{self.source}\n\ndef product(x, rows=slice(None)):\n"
            "    return A[rows] @ np.asarray(x, dtype=float)\n"
        )

    def __call__(self, x: Any, rows: Any = None) -> Array:
        """Return A x, or some rows of it, and count them."""
        size = len(self.matrix)
        value = numbers(x, "x")
        if value.shape != (size,):
            raise ValueError(f"product takes x of shape ({size},), got {value.shape}")
        chosen = np.arange(size) if rows is None else numbers(rows, "rows").ravel().astype(int)
        if chosen.size and not (-size <= chosen.min() and chosen.max() < size):
            raise ValueError(f"rows must be from 0 to {size - 1}, got {chosen.tolist()[:8]}")
        if self.rows + chosen.size > LIMIT * size:
            raise ValueError(f"more than {LIMIT} products with the matrix were made in one call")
        if self.rows // (7 * size) >= len(self.trace):
            self.trace.append(value.copy())
        self.rows += chosen.size
        self.calls += 1
        self.probes += bool(np.all((value == 0.0) | (value == 1.0)))
        self.partial += 2 * chosen.size <= size
        return np.asarray(self.matrix[chosen] @ value)


def cases(rng: np.random.Generator) -> list[Case]:
    """Return low stacks of similar boxes; higher ones; and heavy boxes on light ones."""

    def stack(
        label: str,
        level: str,
        mass: ArrayLike,
        *,
        contacts: int = 2,
        mu: tuple[float, float] = (0.25, 0.8),
        brake: tuple[float, float] = (0.5, 1.0),
        push: float = 0.0,
        lift: bool = False,
    ) -> Case:
        mass = np.asarray(mass, dtype=float)
        n = len(mass)
        centres = rng.uniform(-0.05, 0.05, n)
        low, high = centres - 0.5 * WIDTH, centres + 0.5 * WIDTH
        low[1:], high[1:] = np.maximum(low[1:], low[:-1]), np.minimum(high[1:], high[:-1])
        points = np.linspace(low, high, contacts, axis=1)
        order = rng.permutation(n * contacts)
        A, J = stack_matrix(mass, centres, points, order)
        velocity = np.column_stack(
            (rng.normal(0.0, 0.01, n), rng.normal(0.0, 0.003, n), rng.normal(0.0, 0.02, n))
        )
        velocity[:, 0] += STEP * rng.choice([-1.0, 1.0]) * rng.uniform(*brake)
        velocity[:, 0] += push * rng.choice([-1.0, 1.0], n)
        velocity[:, 1] -= STEP * 9.81
        if lift:
            velocity[-1] = 0.0, 0.3, 0.4
        layer = np.repeat(np.arange(n), contacts)[order]
        friction = np.repeat(rng.uniform(*mu, n), contacts)[order]
        arguments = ", ".join(literal(each) for each in (mass, centres, points, order))
        source = (
            f"WIDTH, HEIGHT = {WIDTH!r}, {HEIGHT!r}\n\n"
            f"{definitions(SCENE, ['stack_matrix'])}\n\nA = stack_matrix({arguments})[0]"
        )
        product = Product(A, source)
        return Case(
            (product, np.diag(A).copy(), J @ velocity.ravel(), friction, layer), label, level
        )

    def similar(n: int) -> Array:
        return rng.uniform(4.0, 12.0, n)

    def top_heavy(n: int) -> Array:
        return similar(n) * np.append(np.ones(n - 1), 1000.0)

    def alternating(n: int) -> Array:
        return similar(n) * np.where(np.arange(n) % 2, 1000.0, 1.0)

    def growing(n: int) -> Array:
        return similar(n) * 1000.0 ** np.linspace(-1.0, 0.0, n)

    # One box of 1 kg with an arm of 1 m to each side: A of integers, b = J (1, -4, 0).
    whole = np.array([[2, -1, 0, -1], [-1, 2, 1, 2], [0, 1, 2, 1], [-1, 2, 1, 2]])
    integers = (
        Product(whole, f"A = {literal(whole)}"),
        np.diag(whole).copy(),
        np.array([-4, 1, -4, 1]),
        np.array([1, 1]),
        np.array([0, 0]),
    )
    return [
        stack("one box", "simple", similar(1)),
        stack("two boxes", "simple", similar(2)),
        stack("one box that slides", "simple", similar(1), mu=(0.1, 0.3), push=0.15),
        stack("three boxes, pushed apart", "simple", similar(3), push=0.06),
        stack("two boxes, the upper one lifts off", "simple", similar(2), lift=True),
        Case(integers, WHOLE, "simple"),
        stack("eight boxes", "core", similar(8)),
        stack("ten boxes, pushed apart", "core", similar(10), push=0.08),
        stack("light boxes on heavy ones", "core", growing(10)[::-1]),
        stack("the top box lifts off", "core", similar(8), lift=True),
        stack("four contacts below each box", "core", similar(8), contacts=4),
        stack("a box 1000 times as heavy on top", "edge", top_heavy(13)),
        stack("masses grow 1000 times upwards", "edge", growing(14), push=0.03),
        stack("heavy and light boxes in turn", "edge", alternating(14)),
        stack("heavy on light, pushed apart", "edge", alternating(12), push=0.1),
        stack("heavy on light, four contacts", "edge", top_heavy(9), contacts=4),
    ]


@dataclass
class Run:
    """One call: the stack, the impulses if they had the right form, their residual, the work."""

    case: Case
    impulses: Array | None = None
    residual: float = np.inf
    products: float = 0.0

    @property
    def problem(self) -> tuple[Array, Array, Array]:
        """A, b and mu of the stack."""
        product, _, b, mu, _ = self.case.args
        return product.matrix, np.asarray(b, dtype=float), np.asarray(mu, dtype=float)

    @property
    def accurate(self) -> bool:
        """True if the residual is small enough for the stack."""
        return self.residual <= BARS[self.case.level].residual

    @property
    def frugal(self) -> bool:
        """True if the products are few enough for the stack."""
        return self.products <= BARS[self.case.level].products(len(self.problem[0]))


def residual(impulses: Array, A: Array, b: Array, mu: Array) -> float:
    """Return the largest error of Coulomb's law over the largest velocity without impulses."""
    with np.errstate(all="ignore"):  # what came back may be as large as it likes
        error = float(np.max(np.abs(coulomb_errors(impulses, A, b, mu))))
    return error / float(np.max(np.abs(b)))


def judge(attempt: Attempt) -> None:
    """Solve stack after stack: a level that fails is the last."""
    drawn = sorted(cases(attempt.rng), key=lambda case: LEVELS.index(case.level))
    attempt.plan([(case.level, case.label) for case in drawn])
    runs: list[Run] = []
    answers: list[tuple[Case, Any]] = []
    try:
        for level in LEVELS:
            chosen = [i for i, case in enumerate(drawn) if case.level == level]
            for index in attempt.rng.permutation(chosen).tolist():
                with attempt.part(index):
                    runs.append(Run(drawn[index]))
                    answers.append((drawn[index], solved(attempt, runs[-1])))
            if attempt.failed:
                break
    finally:
        attempt.shown = explain(runs)
        if attempt.shown == "constant_factor":
            attempt.shown, attempt.factor = "", FACTOR
    if attempt.failed:
        return
    repeat_calls(attempt, [((case.args[0].fresh(), *case.args[1:]), got) for case, got in answers])
    mean = float(np.mean([run.products for run in runs]))
    ours = float(np.mean([products(attempt.card.solution_text(), case) for case in drawn]))
    attempt.cost("products per stack", "1", yours=mean, reference=ours)


def solved(attempt: Attempt, run: Run) -> Any:
    """Ask for the impulses of a stack and check residual and products; return what came back."""
    case, bar = run.case, BARS[run.case.level]
    call = describe_call(attempt.card.entry, case.args)
    got = attempt.call(*case.args)
    run.products = case.args[0].products
    run.impulses = attempt.numbers("impulses", got, (len(case.args[3]), 2), call=call)
    if run.impulses is None:
        return got
    run.residual, unknowns = residual(run.impulses, *run.problem), len(case.args[2])
    limit = bar.products(unknowns)
    attempt.require(
        f"{case.label}: residual",
        run.accurate,
        sentence=f"The residual of your impulses is {run.residual:.2g}. At most {bar.residual:g} "
        f"is allowed at this level. You made {run.products:.3g} products.",
        got=f"{run.residual:.2g}",
        expected=f"at most {bar.residual:g}",
        error=run.residual,
        tolerance=bar.residual,
        unit="1",
        why="the residual of Coulomb's law itself, computed without the worked answer",
        call=call,
    )
    attempt.require(
        f"{case.label}: products",
        run.frugal,
        sentence=f"You made {run.products:.3g} products with the matrix of {unknowns} unknowns. "
        f"At most {limit:.3g} are allowed at this level.",
        got=f"{run.products:.3g}",
        expected=f"at most {limit:.3g}",
        error=run.products,
        tolerance=limit,
        unit="1",
        why="counted in rows, in the grader's own process",
        call=call,
    )
    return got


def products(solution: str, case: Case) -> float:
    """Return how many products the worked answer makes for a stack."""
    product = case.args[0].fresh()
    InProcess(solution, "").call("solve_stack", product, *case.args[1:])
    return float(sum(each.products for each in [product, *product.copies]))


# --- what a wrong answer did ----------------------------------------------------------------------


def explain(runs: Sequence[Run]) -> str:
    """Name the law that wrong impulses obey, or how too many products were made."""
    for run in runs:
        if run.impulses is None and run.case.args[0].products > LIMIT - 1:
            return method(run)
    wrong = [run for run in runs if run.impulses is not None and not run.accurate]
    if wrong:
        for name, law in LAWS.items():
            if all(obeys(run, law) for run in wrong):
                return name
        factors = [factor(run) for run in wrong]
        if all(obeys(run, _scaled(each)) for run, each in zip(wrong, factors, strict=True)):
            same = max(factors) - min(factors) < 1e-2 * abs(min(factors))
            return "constant_factor" if same and len(wrong) > 1 else "impulses_scaled"
        if all(map(improves, wrong)):
            return method(wrong[0])
        if all(map(moves, wrong)):
            return "diverged"
        if all(run.case.label == WHOLE for run in wrong) and len(runs) > 1:
            return "whole_numbers"
        low = [run for run in runs if run.case.level == LEVELS[0]]
        early = all(run.accurate for run in low) and all(map(allowed, wrong))
        return "stopped_early" if early else ""
    expensive = [run for run in runs if run.impulses is not None and not run.frugal]
    return method(expensive[0]) if expensive else ""


Law = Callable[[Array, Array, Array, Array, Array], float]


def obeys(run: Run, law: Law) -> bool:
    """Return whether impulses obey a law as well as they should obey Coulomb's."""
    assert run.impulses is not None
    with np.errstate(all="ignore"):
        error = law(run.impulses, *run.problem, np.asarray(run.case.args[4]))
    return error <= min(BARS[run.case.level].residual, 0.3 * run.residual)


def method(run: Run) -> str:
    """Return which method the calls of `product` show."""
    product = run.case.args[0]
    if probed(product):
        return "column_by_column" if run.accurate else ""
    return "gauss_seidel" if product.partial >= 0.8 * product.calls else "first_order"


def probed(product: Product) -> bool:
    """Return whether a product was used to read the matrix, not to iterate."""
    return product.probes >= 0.9 * product.calls


def improves(run: Run) -> bool:
    """Return whether the vectors that were multiplied come closer to a solution all the time."""
    trace = run.case.args[0].trace
    if run.impulses is None or len(trace) < 2 or probed(run.case.args[0]):
        return False
    errors = [residual(x.reshape(-1, 2), *run.problem) for x in (*trace, run.impulses)]
    return bool(errors[-1] < 0.9 * max(errors[:2]) and errors[-1] < 1.0)


def allowed(run: Run) -> bool:
    """Return whether no contact pulls and no friction is too large, whatever the velocities are."""
    assert run.impulses is not None
    (normal, tangential), mu = run.impulses.T, run.problem[2]
    size = 1e-9 * float(np.max(np.abs(run.impulses), initial=0.0))
    return bool(np.all(normal >= -size) and np.all(np.abs(tangential) <= mu * normal + size))


def moves(run: Run) -> bool:
    """Return whether the vectors that were multiplied still change at the end, or are huge."""
    trace = run.case.args[0].trace
    if len(trace) < 2 or probed(run.case.args[0]) or run.impulses is None:
        return False
    with np.errstate(all="ignore"):
        # Two vectors, an odd number of products apart: Jacobi's may come back every second time.
        change = np.max(np.abs(np.array(trace[-2:]) - run.impulses.ravel()))
        return not change <= 1e-2 * float(np.max(np.abs(run.impulses)))


def factor(run: Run) -> float:
    """Return by what impulses must be multiplied for the touching contacts to be at rest."""
    assert run.impulses is not None
    A, b, _ = run.problem
    moved = (A @ run.impulses.ravel())[0::2] * (run.impulses[:, 0] > 0.0)
    return -float(moved @ b[0::2]) / max(float(moved @ moved), 1e-300)


def _relative(error: Array, b: Array) -> float:
    return float(np.max(np.abs(error)) / np.max(np.abs(b)))


def _split(p: Array, A: Array, b: Array) -> tuple[Array, Array]:
    """Return the velocities of the contacts, and their impulses over their own mass."""
    return (A @ p.ravel() + b).reshape(-1, 2), np.diag(A).reshape(-1, 2) * p


def _scaled(factor: float) -> Law:
    return lambda p, A, b, mu, layer: residual(factor * p, A, b, mu)


def _zero(p: Array, A: Array, b: Array, mu: Array, layer: Array) -> float:
    return min(float(np.max(np.abs(p)) > 0.0), residual(p, A, -b, mu))


def _equations(p: Array, A: Array, b: Array, mu: Array, layer: Array) -> float:
    return _relative(_split(p, A, b)[0], b)


def _unlimited(p: Array, A: Array, b: Array, mu: Array, layer: Array) -> float:
    u, w = _split(p, A, b)
    # A contact that is open has no friction, however large the coefficient.
    tangential = np.where(p[:, 0] > 0.0, u[:, 1], w[:, 1])
    return _relative(np.column_stack((np.minimum(u[:, 0], w[:, 0]), tangential)), b)


def _convex(p: Array, A: Array, b: Array, mu: Array, layer: Array) -> float:
    u, _ = _split(p, A, b)
    q = np.diag(A)[0::2, None] * p - u
    slip = np.abs(q[:, 1])
    on = np.maximum(q[:, 0] + mu * slip, 0.0) / (1.0 + mu * mu)
    side = np.column_stack((on, mu * on * np.sign(q[:, 1])))
    nearest = np.where((slip <= mu * q[:, 0])[:, None], q, side)
    return _relative(np.diag(A)[0::2, None] * p - nearest, b)


def _sorted(p: Array, A: Array, b: Array, mu: Array, layer: Array) -> float:
    restored = np.empty_like(p)
    restored[np.argsort(layer, kind="stable")] = p
    return residual(restored, A, b, mu)


def _uncoupled(p: Array, A: Array, b: Array, mu: Array, layer: Array) -> float:
    layers = np.repeat(layer, 2)
    return residual(p, A * (layers[:, None] == layers), b, mu)


def _one_coefficient(p: Array, A: Array, b: Array, mu: Array, layer: Array) -> float:
    shared = (mu.mean(), mu[0], mu.min(), mu.max(), np.median(mu))
    return min(residual(p, A, b, np.full_like(mu, each)) for each in shared)


def _other_bound(p: Array, A: Array, b: Array, mu: Array, layer: Array) -> float:
    """Return the error of a law in which nothing is wrong but the size of sliding friction."""
    u, w = _split(p, A, b)
    sticks = np.abs(u[:, 1])
    slides = np.maximum(u[:, 1] * np.sign(p[:, 1]), 0.0)  # along friction, which must oppose it
    tangential = np.where(p[:, 1] == 0.0, 0.0, np.minimum(sticks, slides))
    return _relative(np.column_stack((np.minimum(u[:, 0], w[:, 0]), tangential)), b)


LAWS: dict[str, Law] = {
    "no_impulses": _zero,
    "tangent_first": lambda p, A, b, mu, layer: residual(p[:, ::-1], A, b, mu),
    "components_in_rows": lambda p, A, b, mu, layer: residual(p.reshape(2, -1).T.copy(), A, b, mu),
    "impulses_negated": lambda p, A, b, mu, layer: residual(-p, A, b, mu),
    "friction_reversed": lambda p, A, b, mu, layer: residual(p * [1.0, -1.0], A, b, mu),
    "sorted_by_layer": _sorted,
    "friction_forgotten": lambda p, A, b, mu, layer: residual(p, A, b, 0.0 * mu),
    "convex_relaxation": _convex,
    "one_coefficient": _one_coefficient,
    "friction_unlimited": _unlimited,
    "equations_only": _equations,
    "layers_uncoupled": _uncoupled,
    "contacts_alone": lambda p, A, b, mu, layer: residual(p, np.diag(np.diag(A)), b, mu),
    "other_bound": _other_bound,
}
FACTOR = (
    "Your impulses are the same multiple of right ones in every stack: a factor is missing or one "
    "too many."
)


# --- the chart: speed against accuracy ------------------------------------------------------------


def gauss_seidel(case: Case, sweeps: int) -> list[float]:
    """Return the residual after each sweep of plain projected Gauss-Seidel."""
    product, diagonal, b, mu, _ = case.args
    p, errors = np.zeros((len(mu), 2)), []
    for _ in range(sweeps):
        for i in range(len(mu)):
            rows = slice(2 * i, 2 * i + 2)
            normal, tangent = p[i] - (product.matrix[rows] @ p.ravel() + b[rows]) / diagonal[rows]
            normal = max(normal, 0.0)
            p[i] = normal, np.clip(tangent, -mu[i] * normal, mu[i] * normal)
        errors.append(residual(p, *Run(case).problem))
    return errors


def chart(attempt: Attempt, answer: Place) -> Drawing:
    """Return residual against products on a stack of each bar, beside plain Gauss-Seidel."""
    from course.measure.figure import Panel, Series

    panels = []
    drawn = cases(np.random.default_rng(attempt.report.seed))
    for level, label in (
        ("core", "ten boxes, pushed apart"),
        ("edge", "heavy and light boxes in turn"),
    ):
        case = next(case for case in drawn if case.label == label)
        reached = []
        for place in (attempt.learner.child, answer):
            # The clock of a product is its counter: each answer gets a counter of its own.
            product = case.args[0].fresh()
            got = np.asarray(place.call("solve_stack", product, *case.args[1:]), dtype=float)
            used = sum(each.products for each in [product, *product.copies])
            reached.append((used, max(residual(got, *Run(case).problem), 1e-16)))
        sweeps = gauss_seidel(case, 300)
        bar = BARS[level]
        panel = Panel(label, "products", "residual", scale="log")
        panel.series = [
            Series("yours", [reached[0][0]], [reached[0][1]], "yours", style=""),
            Series("worked answer", [reached[1][0]], [reached[1][1]], style=""),
            Series("Gauss-Seidel", np.arange(1, 301), np.array(sweeps), style="-", marker=""),
        ]
        limit = bar.products(len(case.args[2]))
        panel.lines = [("x", limit, "most products"), ("y", bar.residual, "largest residual")]
        distance = abs(reached[0][1] - reached[1][1])
        panel.notes = [
            f"{label}: the bar is a residual of {bar.residual:g} within {limit:.3g} products. "
            f"Plain Gauss-Seidel has {sweeps[-1]:.2g} after 300, your answer {reached[0][1]:.1g} "
            f"after {reached[0][0]:.3g}; yours is within {distance:.1e} of the worked answer's "
            "residual"
        ]
        panels.append(panel)
    return Drawing(panels)


# --- slips ----------------------------------------------------------------------------------------

_READ = "A = read_by_colours(product, np.repeat(np.asarray(layer), 2))"
_MU = "friction = np.asarray(mu, dtype=float) * size[N] / size[T]"
_RETURN = "np.column_stack((normal * size[N], (right - left) * size[T]))"
_SWEEPS = """
import numpy as np


def solve_stack(product, diagonal, b, mu, layer):
    b, mu, a = (np.asarray(x, dtype=float) for x in (b, mu, diagonal))
    p = np.zeros(2 * len(mu))
    for _ in range({count}):
        old = p.copy()
        {visit}
        if np.max(np.abs(p - old)) <= 1e-9 * np.max(np.abs(p)) or np.max(np.abs(p)) > 1e9:
            break
    return p.reshape(-1, 2)
"""
_VISIT = """for i in range(len(mu)):
            rows = [2 * i, 2 * i + 1]
            p[rows] -= (product(p, rows) + b[rows]) / a[rows]
            p[2 * i] = max(p[2 * i], 0.0)
            p[2 * i + 1] = np.clip(p[2 * i + 1], -mu[i] * p[2 * i], mu[i] * p[2 * i])"""
_ALL = """p -= {step} * (product(p) + b) / a
        p[0::2] = np.maximum(p[0::2], 0.0)
        p[1::2] = np.clip(p[1::2], -mu * p[0::2], mu * p[0::2])"""

SLIPS = slips(
    gauss_seidel=(
        _SWEEPS.format(count=300, visit=_VISIT),
        "This is Gauss-Seidel, contact by contact. A sweep carries a change by about one layer, "
        "and a heavy box on light ones makes progress slower still. Another order helps little: "
        "look for a method that solves many contacts at once.",
    ),
    first_order=(
        _SWEEPS.format(count=300, visit=_ALL.format(step=0.12)),
        "Your iteration multiplies the whole matrix again and again, and it needs too many "
        "products where light boxes carry heavy ones. The matrix has few nonzero entries: read "
        "them, and finish without products.",
    ),
    diverged=(
        _SWEEPS.format(count=60, visit=_ALL.format(step=1.0)),
        "Your iteration doesn't converge. Updating all contacts at once (Jacobi) overshoots, as "
        "several contacts carry the same box; so does a step that ignores the diagonal. Use a "
        "smaller step, or the latest impulses of the other contacts.",
    ),
    stopped_early=(
        "normal, right, left, _ = lemke(M, q).reshape(4, -1) * scale",
        "p = np.zeros(len(free))\n"
        "    for _ in range(300):\n"
        "        for i in range(len(friction)):\n"
        "            rows = [2 * i, 2 * i + 1]\n"
        "            p[rows] -= A[rows] @ p + free[rows]\n"
        "            p[2 * i] = max(p[2 * i], 0.0)\n"
        "            most = friction[i] * p[2 * i]\n"
        "            p[2 * i + 1] = np.clip(p[2 * i + 1], -most, most)\n"
        "    normal, right, left = p[N] * scale, p[T] * scale, 0.0",
        "Your impulses are allowed, but don't stop the contacts yet. The low stacks are right, "
        "so your iteration probably ends too early: heavy boxes on light ones take Gauss-Seidel "
        "more than 100,000 sweeps. Solve the problem by pivoting, or with Newton's method.",
    ),
    column_by_column=(
        _READ,
        "A = np.column_stack([product(x) for x in np.eye(len(mu) * 2)])",
        "You read whole columns of the matrix, most of which is zero. Layers that are not "
        "neighbours don't act on each other: read columns of several such layers at once, or only "
        "the rows that are not zero.",
    ),
    no_impulses=(
        "free = free / scale",
        "free = -free / scale",
        "Your impulses are zero where contacts close. Check the sign: b is the velocity without "
        "impulses, negative where a contact closes, and u = A p + b must not be negative.",
    ),
    tangent_first=(
        _RETURN,
        _RETURN + "[:, ::-1]",
        "The two columns are swapped: the normal impulse comes first.",
    ),
    components_in_rows=(
        _RETURN,
        _RETURN + ".T",
        "Your answer has all normal impulses in its first row and all tangential ones in the "
        "second. Return a row for each contact.",
    ),
    impulses_scaled=(
        "lemke(M, q).reshape(4, -1) * scale",
        "lemke(M, q).reshape(4, -1)",
        "In each stack your impulses are a multiple of right ones, but not the same multiple in "
        "all of them. If you scale the problem before you solve it, scale its answer back.",
    ),
    impulses_negated=(
        _RETURN,
        "-" + _RETURN,
        "All impulses have the opposite sign. A normal impulse pushes: it is positive.",
    ),
    friction_reversed=(
        "(right - left)",
        "(left - right)",
        "Your friction has the right size and the wrong direction. It acts against the sliding.",
    ),
    sorted_by_layer=(
        _RETURN,
        _RETURN + "[np.argsort(layer, kind='stable')]",
        "Your impulses come sorted by layer. Return them in the order in which the contacts came.",
    ),
    friction_forgotten=(
        _MU,
        "friction = 0.0 * np.asarray(mu, dtype=float)",
        "There is no friction in your impulses: the normal ones are those of a frictionless stack.",
    ),
    equations_only=(
        "lemke(M, q).reshape(4, -1)",
        "np.linalg.lstsq(np.block([[A[N, N], A[N, T]], [A[T, N], A[T, T]]]),"
        " -np.concatenate((free[N], free[T])), rcond=1e-12)[0].reshape(2, -1)"
        "[[0, 1, 1, 1]] * np.array([[1.0], [1.0], [0.0], [0.0]])",
        "Your impulses stop every contact: you solved A p = -b. The inequalities are missing: a "
        "contact must not pull, and friction is limited.",
    ),
    friction_unlimited=(
        _MU,
        "friction = np.full(len(size) // 2, 50.0)",
        "Your friction has no limit: every closed contact sticks. It is at most mu times the "
        "normal impulse.",
    ),
    convex_relaxation=(
        "[A[N, N], A[N, T], -A[N, T], zeros]",
        "[A[N, N], A[N, T], -A[N, T], -np.diag(friction)]",
        "These impulses solve the convex relaxation of Coulomb's law, in which a contact that "
        "slides also lifts off, with mu times the sliding speed. The normal velocity of a contact "
        "with an impulse must be zero.",
    ),
    layers_uncoupled=(
        "np.abs(layers - layers[column]) <= 1",
        "layers == layers[column]",
        "You solve each layer for itself. A box has contacts below and above it, so neighbouring "
        "layers act on each other.",
    ),
    contacts_alone=(
        "A, free = A * np.outer(size, size), np.asarray(b, dtype=float) * size",
        "A, free = np.eye(len(size)), np.asarray(b, dtype=float) * size",
        "You solve each contact as if the others had no impulses. The velocity of a contact "
        "follows from all impulses: u = A p + b.",
    ),
    one_coefficient=(
        _MU,
        "friction = np.mean(mu) * size[N] / size[T]",
        "You use one coefficient of friction for all contacts. Each has its own, in the order of "
        "the contacts.",
    ),
    other_bound=(
        "[np.diag(friction), -identity, -identity, zeros]",
        "[zeros, -identity, -identity, zeros]",
        "np.concatenate((free[N], free[T], -free[T], np.zeros(len(friction))))",
        "np.concatenate((free[N], free[T], -free[T], friction * np.maximum(-free[N], 0.0)))",
        "Normal impulses and the direction of friction are right, but sliding friction is not mu "
        "times the normal impulse of its contact. The bound must follow the normal impulse that "
        "you return, with the contact's own mu.",
    ),
)

_MATRIX = "np.array([[2, -1, 0, -1], [-1, 2, 1, 2], [0, 1, 2, 1], [-1, 2, 1, 2]])"
_ONE = f"lambda x, rows=slice(None): ({_MATRIX} @ x)[rows]"

EXERCISE = Exercise(
    judge=judge,
    examples=(
        f"solve_stack({_ONE}, [2.0, 2.0, 2.0, 2.0], [-4.0, 1.0, -4.0, 1.0], [1.0, 1.0], [0, 0])",
        f"solve_stack({_ONE}, [2.0, 2.0, 2.0, 2.0], [-4.0, 9.0, -4.0, 9.0], [0.5, 0.5], [0, 0])",
    ),
    slips=SLIPS
    + tuple(
        slip for slip in value_slips("solve_stack", in_part=False) if slip.name != "one_part_right"
    ),
    limits=Limits(call=8.0, total=60.0),
    chart=chart,
)
