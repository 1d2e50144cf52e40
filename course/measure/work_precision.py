"""Speed against accuracy: what does a method cost, and what does it buy?

Every method runs on the same question with several settings (mostly step sizes). Cost is counted
twice: as time and as a number that no machine changes (force evaluations). Error is the distance to
an independent reference, which is itself checked first. The times are those of
`course.measure.timing`: interleaved, medians and quartiles. A run that fails is a point at
infinite cost and is drawn at the top edge of the chart, above what its steps would cost.

The form of the diagram follows Hairer, Norsett and Wanner, Solving Ordinary Differential Equations
I, 1993, sec. II.4.
"""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, invalid, one_of, positive, vector
from course.measure.colours import key_of
from course.measure.data import from_json, json_text
from course.measure.figure import SIX, Panel, Series, write
from course.measure.timing import calls, interleaved

Array = NDArray[np.float64]
STYLES = ("ours", "oracle", "yours")


@dataclass(frozen=True)
class Result:
    """What one run gives: the answer and what it cost in counts (inf or nan is a failure)."""

    answer: ArrayLike
    count: float


@dataclass(frozen=True)
class Method:
    """One curve of the chart.

    Attributes:
        name: as in the legend.
        run: parameter -> `Result`. What is inside is timed, so prepare outside.
        parameters: the settings, usually step sizes; a larger parameter means less work.
        style: "ours", "oracle" (another library) or "yours" (the reader's).
        unit: what `Result.count` counts.
        key: whose colour and marker (a row of `course.measure.colours.KEYS`); empty where the name
            says it, or for the next colour.
        extra: not among the six curves that are drawn before others are switched on.
    """

    name: str
    run: Callable[[float], Result]
    parameters: Sequence[float]
    style: str = "ours"
    unit: str = "force evaluations"
    key: str = ""
    extra: bool = False

    def __post_init__(self) -> None:
        one_of("style", self.style, STYLES)
        if not vector("parameters", self.parameters, (None,), low=POSITIVE).size:
            raise invalid("parameters", self.parameters, "one or more positive numbers")


@dataclass(frozen=True)
class Point:
    """One method with one setting. Times in seconds; all infinite where it failed.

    Attributes:
        parameter: the setting.
        error: distance to the reference (inf for a failure).
        count: machine-independent cost.
        time, low, high: median (or least) and quartiles of the time for one run.
        failure: why it failed, empty if it didn't.
    """

    parameter: float
    error: float
    count: float
    time: float
    low: float
    high: float
    failure: str = ""

    def cost(self, by: str) -> float:
        """Return the cost by "time" [s] or by "count"."""
        one_of("by", by, ("time", "count"))
        return self.time if by == "time" else self.count


@dataclass(frozen=True)
class Curve:
    """All points of one method, the coarsest setting first."""

    name: str
    style: str
    unit: str
    points: tuple[Point, ...]
    key: str = ""
    extra: bool = False

    def valid_points(self) -> list[Point]:
        """Return the points that did not fail."""
        return [point for point in self.points if not point.failure]


@dataclass(frozen=True)
class Pick:
    """The cheapest method and setting that meet the tolerance."""

    name: str
    point: Point
    by: str


@dataclass(frozen=True)
class WorkPrecision:
    """The measured curves, with what is needed to draw and to repeat them."""

    question: str
    error_unit: str
    curves: tuple[Curve, ...]
    tolerance: float | None
    reference_uncertainty: float
    failed_above: float
    machine: str
    ratio: float | None = None  # time of the reader's method over that of the pick run beside it
    duration: float | None = None  # simulated time of a run [s]; a setting is then a step [s]
    converges: bool = True  # whether an order says something: a share of successes has none
    counts_only: bool = False  # drawn against counts alone: the times say nothing about the methods
    _repeat: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def curve(self, name: str) -> Curve:
        """Return the curve of that name.

        Raises:
            ValueError: if there is none.
        """
        for curve in self.curves:
            if curve.name == name:
                return curve
        raise invalid("name", name, f"one of {', '.join(repr(c.name) for c in self.curves)}")

    def pick(
        self, tolerance: float | None = None, by: str = "time", styles: Sequence[str] = STYLES
    ) -> Pick | None:
        """Return the cheapest measured point whose error is within the tolerance.

        Args:
            tolerance: largest error allowed; None for the chart's own.
            by: "time" or "count".
            styles: whose methods to choose from.

        Returns:
            The pick, or None where nothing is good enough.
        """
        # The cheapest point that is good enough; of equal costs the first curve wins.
        limit = self.tolerance if tolerance is None else tolerance
        if limit is None:
            raise invalid("tolerance", tolerance, "a number: this chart has none of its own")
        good = [
            (point.cost(by), i, curve.name, point)
            for i, curve in enumerate(self.curves)
            if curve.style in styles
            for point in curve.valid_points()
            if point.error <= limit
        ]
        if not good:
            return None
        _, _, name, point = min(good, key=lambda entry: entry[:2])
        return Pick(name, point, by)

    def observed_order(self, name: str) -> float:
        """Return the slope of log(error) against log(parameter) in the asymptotic range.

        The coarse end (not yet asymptotic, or failed) and the fine end (rounding, or the
        reference's own uncertainty) bend the line, so the fit takes the longest run of points
        whose local slopes agree within 0.05 of each other, or else 0.15; among equally long ones
        that with the smallest spread. NaN with fewer than two usable points.
        """
        # Errors near the reference's own uncertainty say nothing about the method.
        floor = 10.0 * self.reference_uncertainty
        usable = [p for p in self.curve(name).valid_points() if p.error > floor]
        x = np.log([p.parameter for p in usable])
        y = np.log([p.error for p in usable])
        if x.size < 2:
            return math.nan
        slopes = np.diff(y) / np.diff(x)
        # The longest window of slopes that agree, within 0.05 if there is one, else within 0.15.
        for allowed in (0.05, 0.15):
            best = (0, -math.inf, 0)
            for i in range(slopes.size):
                for j in range(i + 1, slopes.size + 1):
                    spread = float(np.ptp(slopes[i:j]))
                    # A slope near zero is the noise of the rounding floor, not convergence.
                    if spread <= allowed and np.all(slopes[i:j] > 0.2):
                        # One slope alone agrees with nothing: prefer the finest.
                        best = max(best, (j - i, -spread if j - i > 1 else i - slopes.size, i))
            if best[0] > 1:
                break
        length, _, start = best
        if length == 0:
            return math.nan
        window = slice(start, start + length + 1)
        return float(np.polyfit(x[window], y[window], 1)[0])

    def table(self) -> str:
        """Return all points and the observed orders as text."""
        # The table is as wide as its longest name.
        known = self.reference_uncertainty
        wide = max([24, *(len(curve.name) for curve in self.curves)])
        lines = [
            self.question,
            (f"reference known to {known:.1e}{self._unit}" if known else "reference exact")
            + ("" if self.tolerance is None else f"; tolerance {self.tolerance:g}{self._unit}"),
            f"{'method':<{wide}} {'setting':>10} {'error':>10} {'count':>10} {'time':>10}"
            f" {'quartiles':>21}",
        ]
        for curve in self.curves:
            for p in curve.points:
                head = f"{curve.name:<{wide}} {p.parameter:>10.4g}"
                if p.failure:
                    lines.append(f"{head} failed: {p.failure}")
                else:
                    quartiles = f"{_seconds(p.low)} to {_seconds(p.high)}"
                    lines.append(
                        f"{head} {p.error:>10.2e} {p.count:>10.4g} {_seconds(p.time):>10}"
                        f" {quartiles:>21}"
                    )
            order = self.observed_order(curve.name) if self.converges else math.nan
            if not math.isnan(order):
                lines.append(f"{curve.name:<{wide}} observed order {order:.2f}")
        if self.tolerance is not None:
            for by in ("count", "time"):
                lines.append(f"cheapest by {by}: {self._pick_text(by)}")
        if self.ratio is not None:
            lines.append(f"yours against the pick, side by side: {self.ratio:.3g} times its time")
        lines.append(self.machine)
        return "\n".join(lines)

    @property
    def _unit(self) -> str:
        """The unit of an error behind its number: nothing for a plain one."""
        return "" if self.error_unit == "1" else f" {self.error_unit}"

    def _pick_text(self, by: str) -> str:
        pick = self.pick(by=by)
        if pick is None:
            return "nothing meets the tolerance"
        cost = _seconds(pick.point.time) if by == "time" else f"{pick.point.count:.4g}"
        return f"{pick.name} at {pick.point.parameter:.4g} ({cost}, error {pick.point.error:.1e})"

    def with_method(self, method: Method, repeats: int | None = None) -> WorkPrecision:
        """Return the same chart with one more method, measured in the same way.

        The new method runs interleaved with the chart's pick (if there is one), so that `ratio`
        compares two times taken at the same moment; the other curves stay as they were.

        Args:
            method: with any style; "yours" draws it black and thick.
            repeats: as for `measure`; None for what the chart was measured with.

        Raises:
            ValueError: for a name that is taken, or a chart read from a file, which has no methods.
        """
        if not self._repeat:
            raise invalid("method", method.name, "none: this chart is from a file, measure it")
        if method.name in {curve.name for curve in self.curves}:
            raise invalid("name", method.name, "a name that is not on the chart yet")
        known: list[Method] = self._repeat["methods"]
        options = {**self._repeat["options"]}
        if repeats is not None:
            options["repeats"] = repeats
        # The pick runs beside the new method, so that both meet the same load of the machine.
        beside: list[Method] = []
        pick = None if self.tolerance is None else self.pick()
        if pick is not None:
            match = next(m for m in known if m.name == pick.name)
            beside = [replace(match, parameters=[pick.point.parameter])]
        curves, _ = _measure_curves([method, *beside], **options)
        ratio = None
        if beside and self.tolerance is not None:
            good = [p.time for p in curves[0].valid_points() if p.error <= self.tolerance]
            # Time of the reader's cheapest sufficient setting over that of the pick, from the same
            # rounds.
            cost = curves[1].points[0].time
            # A pick that fails when it is run again has no time to compare with.
            if math.isfinite(cost):
                ratio = min(good) / cost if good else math.inf
        return replace(
            self,
            curves=(*self.curves, curves[0]),
            ratio=ratio,
            _repeat={"methods": [*known, method], "options": self._repeat["options"]},
        )

    def to_json(self, path: str | Path) -> None:
        """Write all but the callables; whole or not at all."""
        write(path, json_text(self._document()))

    def _document(self) -> dict[str, Any]:
        return {k: v for k, v in asdict(replace(self, _repeat={})).items() if k != "_repeat"}

    @classmethod
    def from_json(cls, path: str | Path) -> WorkPrecision:
        """Return what `to_json` wrote. It can be drawn and searched, not measured on."""
        data = from_json(Path(path).read_text(encoding="utf-8"))
        data["curves"] = tuple(
            Curve(**(curve | {"points": tuple(Point(**point) for point in curve["points"])}))
            for curve in data["curves"]
        )
        return cls(**data)

    def shown(self) -> list[str]:
        """Return the names of the six curves that are drawn.

        They are ours, the picks, and the first others that matter.
        """
        yours = [curve.name for curve in self.curves if curve.style == "yours"]
        # The reader's own curves always, then the picks, then the others until there are six.
        picks = [self.pick(by=by) for by in ("time", "count") if self.tolerance is not None]
        first = [curve.name for curve in self.curves if not curve.extra]
        names = dict.fromkeys([*yours, *(pick.name for pick in picks if pick), *first])
        return [*names][:SIX]

    def price(self, tolerance: float, by: str = "time") -> str:
        """Return what a tolerance costs, in a sentence: the pick, its cost, and that of a tenth.

        Args:
            tolerance: largest error allowed.
            by: "time" or "count".
        """
        pick = self.pick(positive("tolerance", tolerance), by)
        desired = f"{tolerance:.2g}{self._unit}"
        # Nothing meets the tolerance: say how close the best run comes.
        if pick is None:
            errors = [(p.error, c.name, p) for c in self.curves for p in c.valid_points()]
            if not errors:
                return "No run worked."
            error, name, point = min(errors, key=lambda entry: entry[0])
            return (
                f"Nothing here comes within {desired}: the smallest error is {error:.1e}"
                f"{self._unit}, of {name} at {self._setting(point)}."
            )
        cost = pick.point.cost(by) / (self.duration or 1.0)
        spent = _seconds(cost) if by == "time" else f"{cost:.3g} {self._counted}"
        message = f"{pick.name} at {self._setting(pick.point)}: {spent} per "
        message += "run" if self.duration is None else "simulated s"
        # The price of one more digit shows how steep the trade-off is.
        finer = self.pick(0.1 * tolerance, by)
        if finer is None:
            return f"{message}; no run here has a tenth of that error."
        times = finer.point.cost(by) / pick.point.cost(by)
        if finer.point == pick.point:
            return f"{message}; a tenth of the error costs no more."
        other = "" if finer.name == pick.name else f", with {finer.name}"
        return f"{message}; a tenth of the error would cost {times:.2g} times as much{other}."

    def range(self) -> tuple[float, float]:
        """Return tolerances worth asking for.

        Decades that hold the errors of all runs, and one more.
        """
        errors = [p.error for curve in self.curves for p in curve.valid_points()]
        # Errors of zero have no logarithm; rounding is the least that they could mean.
        errors = [max(error, 1e-16) for error in errors] + [self.tolerance or 1.0]
        low, high = math.floor(math.log10(min(errors))), math.ceil(math.log10(max(errors)))
        return 10.0 ** (low - 1), 10.0**high

    @property
    def _counted(self) -> str:
        return self.curves[0].unit

    def _setting(self, point: Point) -> str:
        if self.duration is None:
            return f"a setting of {point.parameter:.3g}"
        return _seconds(point.parameter)

    def panels(self, pick: bool = True) -> list[Panel]:
        """Return error against count and mostly time; the text is the table, the data all points.

        Args:
            pick: whether tolerance and picks are drawn.
        """
        remaining = self._panel("count", self._counted if self.curves else "count", pick)
        remaining.title, remaining.legend = self.question, self.counts_only
        remaining.footer, remaining.notes = self.machine, [self.table()]
        remaining.data = self._document()
        if self.counts_only:
            return [remaining]
        return [remaining, self._panel("time", "time of one run [s]", pick)]

    def _panel(self, by: str, cost: str, marked: bool) -> Panel:
        panel = Panel("", cost, f"error [{self.error_unit}]", scale="log")
        shown = self.shown()
        for curve in self.curves:
            good = curve.valid_points()
            failed = len(curve.points) - len(good)
            # Oracles have hollow markers and dashed lines, so that equal points of ours show.
            series = Series(
                curve.name + (f", {failed} of {len(curve.points)} failed" if failed else ""),
                [p.cost(by) for p in good],
                [p.error for p in good],
                "yours" if curve.style == "yours" else curve.key or key_of(curve.name),
                "--" if curve.style == "oracle" else "-",
                hollow=curve.style == "oracle",
                size=6.0 if curve.style == "oracle" else 4.0,
                failed=failed,
                failed_at=self._failed_at(curve, by),
                extra=curve.name not in shown,
            )
            # Counts are exact; times have quartiles as horizontal bars.
            if by == "time":
                series.low, series.high = [p.low for p in good], [p.high for p in good]
                series.across = True
            panel.series.append(series)
        tolerance = self.tolerance if marked else None
        pick = None if tolerance is None else self.pick(by=by)
        if pick is not None:
            panel.series.append(
                Series(
                    "",
                    [pick.point.cost(by)],
                    [pick.point.error],
                    "chosen",
                    "",
                    hollow=True,
                    size=13.0,
                    tags=[f"pick: {pick.name}"],
                )
            )
        if tolerance is not None:
            words = f"tolerance {tolerance:g}{self._unit}"
            panel.lines = [("y", tolerance, words)]
        errors = [e for s in panel.series for e in s.y]
        if errors and self.reference_uncertainty > 0.5 * min(errors):
            # Below this an error says how good the reference is, not how good the method.
            panel.ylim = (0.2 * min(errors), None)
            panel.spans = [("y", 0.2 * min(errors), self.reference_uncertainty, "")]
        return panel

    def _failed_at(self, curve: Curve, by: str) -> list[float]:
        """Return what the failed runs would cost with as much per step as the next finer run.

        It is empty where a setting is no step, or where no run worked.
        """
        good = curve.valid_points()
        if self.duration is None or not good:
            return []
        # The nearest run that worked has the most similar cost per step.
        result = []
        for point in curve.points:
            if point.failure:
                near = min(good, key=lambda p: abs(math.log(p.parameter / point.parameter)))
                result.append(near.cost(by) * near.parameter / point.parameter)
        return result


def max_norm(answer: Array, reference: Array) -> float:
    """Return the largest difference of a component."""
    return float(np.max(np.abs(answer - reference)))


def measure(
    methods: Sequence[Method],
    reference: ArrayLike,
    error: Callable[[Array, Array], float] = max_norm,
    *,
    reference_check: ArrayLike,
    tolerance: float | None = None,
    failed_above: float = math.inf,
    repeats: int = 5,
    sample_time: float = 1e-3,
    best: bool = False,
    warm_up: float = 0.0,
    question: str = "",
    error_unit: str = "-",
    duration: float | None = None,
    converges: bool = True,
) -> WorkPrecision:
    """Run every method with every setting and compare with the reference.

    Args:
        methods: the curves.
        reference: the right answer.
        error: (answer, reference) -> distance.
        reference_check: the right answer found in a second, independent way.
        tolerance: the error that the question tolerates, if it has one.
        failed_above: an error above this is a failure (say, the size of the answer itself).
        repeats: timed rounds; a round runs every method and setting once, in turn.
        sample_time: least time of one sample [s]; faster runs are repeated inside the sample.
        best: draw the least time of a run, not the median: few rounds on a machine that does other
            work would else make a zigzag of a curve.
        warm_up: runs shorter than this [s] are made once more, uncounted, right before each sample:
            where methods of milliseconds and of microseconds take turns, the short ones would else
            pay for caches that the long ones have emptied.
        question: the chart's title.
        error_unit: unit of the error.
        duration: simulated time of a run [s], where a setting is a step [s]: costs are then said
            per simulated second.
        converges: whether the table prints the order at which the error falls with the setting.

    Returns:
        The measured `WorkPrecision`.

    Raises:
        ValueError: for equal names, or when the two references differ by more than a tenth of the
            smallest error measured or of the tolerance, whichever is larger: the chart would then
            show the reference's error, not the methods'.
    """
    if not methods or len({m.name for m in methods}) < len(methods):
        raise invalid("methods", [m.name for m in methods], "one or more of different names")
    # Counts are comparable in one unit only.
    units = {m.unit for m in methods}
    if len(units) > 1:
        raise invalid("methods", sorted(units), "methods that all count the same unit")
    count("repeats", repeats, 1)
    if tolerance is not None:
        positive("tolerance", tolerance)
    # The reference is tested against an independent one before anything is compared with it.
    truth = np.asarray(reference, dtype=float)
    uncertainty = float(error(np.asarray(reference_check, dtype=float), truth))
    if not math.isfinite(uncertainty):
        raise invalid("reference", reference, "finite and comparable with reference_check")
    options: dict[str, Any] = {
        "reference": truth,
        "error": error,
        "failed_above": failed_above,
        "repeats": repeats,
        "sample_time": sample_time,
        "best": best,
        "warm_up": warm_up,
    }

    def check(errors: Sequence[float]) -> None:
        smallest = min(errors, default=math.inf)
        # A method as good as the reference itself is no reason to stop; a reference worse than a
        # tenth of what is wanted is.
        allowed = 0.1 * max(smallest, tolerance or 0.0)
        if uncertainty > allowed:
            raise invalid(
                "the difference of reference and reference_check",
                uncertainty,
                f"a tenth of the smallest error or of the tolerance, {allowed:.2e}",
            )

    curves, busy = _measure_curves(methods, **options, check=check)
    return WorkPrecision(
        question=question,
        error_unit=error_unit,
        curves=curves,
        tolerance=tolerance,
        reference_uncertainty=uncertainty,
        failed_above=failed_above,
        duration=duration,
        converges=converges,
        machine=machine(busy) + (f"; least of {repeats} rounds" if best else ""),
        _repeat={"methods": list(methods), "options": options},
    )


def _measure_curves(
    methods: Sequence[Method],
    *,
    reference: Array,
    error: Callable[[Array, Array], float],
    failed_above: float,
    repeats: int,
    sample_time: float,
    best: bool,
    warm_up: float,
    check: Callable[[Sequence[float]], None] | None = None,
) -> tuple[tuple[Curve, ...], float]:
    """Return the curves, and the share of the timed rounds in which the machine was busy."""
    # Coarse settings first within each method; failures are known before time is measured.
    runs = [(m, float(p)) for m in methods for p in sorted(m.parameters, reverse=True)]
    with np.errstate(all="ignore"):  # a diverging run is recorded, not printed
        # The warm-up: compilation and caches, and the errors.
        points = [_first_run(*run, reference, error, failed_above) for run in runs]
        alive = [i for i, point in enumerate(points) if not point.failure]
        if check is not None:
            check([points[i].error for i in alive])
        # Failed runs are not timed: they would only lengthen each round.
        samplers = [calls(method.run, parameter) for method, parameter in runs]
        times = interleaved(
            [samplers[i] for i in alive],
            repeats=repeats,
            sample=sample_time,
            warm=True,
            warm_up=warm_up,
        )
    for i, result in zip(alive, times, strict=True):
        # An error of exactly zero has no place on a log axis; a rounding is what it means.
        exact = max(points[i].error, float(np.finfo(float).tiny))
        points[i] = replace(
            points[i],
            error=exact,
            time=result.best if best else result.median,
            low=result.best if best else result.low,
            high=result.high,
        )
    curves = []
    for method in methods:
        own = tuple(p for p, (owner, _) in zip(points, runs, strict=True) if owner is method)
        curves.append(Curve(method.name, method.style, method.unit, own, method.key, method.extra))
    return tuple(curves), max((result.busy for result in times), default=0.0)


def _first_run(
    method: Method,
    parameter: float,
    reference: Array,
    error: Callable[[Array, Array], float],
    failed_above: float,
) -> Point:
    """Return the point without its times."""
    never, deviation, failure = math.inf, math.nan, ""
    try:
        result = method.run(parameter)
        answer, spent = np.asarray(result.answer, dtype=float), float(result.count)
        if not np.all(np.isfinite(answer)):
            failure = "the answer is not finite"
        elif not math.isfinite(deviation := float(error(answer, reference))):
            failure = "the error is not finite"
        elif deviation > failed_above:
            failure = f"error {deviation:.2e} above {failed_above:.2e}"
        elif not math.isfinite(spent):
            failure = "the count is not finite"
    except Exception as problem:  # any failure of a method is a result of the measurement
        failure = f"{type(problem).__name__}: {problem}"
    if failure:
        return Point(parameter, never, never, never, never, never, failure)
    return Point(parameter, deviation, spent, never, never, never)


def machine(busy: float = 0.0, *, libraries: Sequence[str] = ("mujoco",)) -> str:
    """Return processor, cores and versions, for the footer of a chart.

    Args:
        busy: share of the timed rounds in which the machine had other work, see
            `course.measure.timing`.
        libraries: packages that the chart compares or trains with, beside NumPy and Numba.
    """
    name = platform.processor() or platform.machine()
    # Linux has the processor's name here; elsewhere the architecture has to do.
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                name = line.split(":", 1)[1].strip()
                break
    except OSError:
        name = platform.machine()
    versions = [f"Python {platform.python_version()}"]
    for package in ("numpy", "numba", *libraries):
        try:
            versions.append(f"{package} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            versions.append(f"no {package}")
    result = f"{name}, {os.cpu_count()} cores; " + ", ".join(versions)
    return result + (f"; busy in {busy:.0%} of the rounds" if busy else "")


def _seconds(value: float) -> str:
    for scale, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "us")):
        if value >= scale:
            return f"{value / scale:.3g} {unit}"
    return f"{value / 1e-9:.3g} ns"
