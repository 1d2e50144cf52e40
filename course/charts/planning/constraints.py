"""An arm that carries a cup upright, and a point with a velocity: two methods and their limits."""

import collections
import functools
import math
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from course import planning
from course.charts import chart
from course.kinematics import panda
from course.measure.figure import Panel, Series
from course.measure.work_precision import machine
from course.oracles import ompl
from course.planning import check_path, kinodynamic, manifold, state_free

Array = NDArray[np.float64]
TOLERATED = 1.0  # tilt of the cup along a path [degrees]
# Of OMPL's: each pair of a longest motion and a spacing of its states is tried [rad].
RANGES = (0.5, 1.0, 2.0, 4.0)
SPACINGS = (0.05, 0.2)
LONGEST = (5, 10, 20, 40)  # steps of a control at most, likewise


# --- a cup that is carried upright ----------------------------------------------------------------


def carried(name: str, seed: int) -> tuple[Array, Array]:
    """Return two free postures in different bays of a shelf whose cup is upright."""
    rng, place = np.random.default_rng(seed), planning.shelf(name)
    while True:
        ends = [manifold.constrain_config(place.world, q) for q in place.query(rng)]
        if all(q is not None and state_free(place.world, q) for q in ends):
            start, goal = ends
            assert start is not None and goal is not None
            return start, goal


@functools.cache
def _arm() -> Any:
    return panda()


def tilted(path: Array, pieces: int = 20) -> float:
    """Return the largest tilt along the straight edges of a path, states as columns [degrees]."""
    edges = zip(path.T, path.T[1:], strict=False)
    dense = np.concatenate([np.linspace(a, b, pieces + 1) for a, b in edges])
    return math.degrees(float(manifold.tilt(_arm(), dense.T).max()))


def chords(step: float, number: int, seed: int) -> tuple[Array, Array]:
    """Return upright configurations and neighbours a step away, projected, as columns (7, N)."""
    rng, world = np.random.default_rng(seed), planning.shelf("open").world
    pairs = list[tuple[Array, Array]]()
    while len(pairs) < number:
        a = manifold.constrain_config(world, rng.uniform(*world.bounds))
        along = rng.normal(size=7)
        if a is None:
            continue
        b = manifold.constrain_config(world, a + step * along / np.linalg.norm(along))
        # A projection that goes elsewhere is no neighbour: the extension would not take it either.
        if b is not None and np.linalg.norm(b - a) < 2.0 * step:
            pairs.append((a, b))
    ends = np.array(pairs)
    return ends[:, 0].T, ends[:, 1].T


@chart(columns=2)
def upright_cup(
    steps: Sequence[float] = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6),
    queries: int = 24,
    samples: int = 1_000_000,
    edges: int = 500,
    budget: int = 600,
) -> Iterator[Panel]:
    """Chart the tilt of a cup between projected states, and the time to plan for it.

    Args:
        steps: of an extension [rad].
        queries: at the open shelf.
        samples: random configurations whose tilt is looked at.
        edges: random chords for each step.
        budget: samples of each plan that is timed.
    """
    world, rng = planning.shelf("open").world, np.random.default_rng(0)
    footer = machine(libraries=("ompl",)) + "; one core, thread time"
    questions = [carried("open", k) for k in range(queries)]
    free_way = 0.5 * math.pi  # the proof of the tilt switched off
    manifold.warm()
    angles = np.degrees(
        manifold.tilt(_arm(), rng.uniform(world.bounds[0], world.bounds[1], (samples, 7)).T)
    )
    projected = sum(
        manifold.constrain_config(world, q) is not None
        for q in rng.uniform(world.bounds[0], world.bounds[1], (2000, 7))
    )
    # A uniformly random direction is within an angle of the vertical with this probability.
    cap = 0.5 * (1.0 - math.cos(math.radians(TOLERATED)))

    panel = Panel(
        "Tilt between projected states",
        "step [rad]",
        "largest tilt on an edge [°]",
        scale="log",
        footer=footer,
    )
    panel.lines = (("y", TOLERATED, "tolerance"),)
    worst, proven, single = [], [], []
    for h in steps:
        results = [
            manifold.cbirrt(world, *q, step=h, allowed=free_way, rng=k)
            for k, q in enumerate(questions)
        ]
        paths = [p.path for p in results if p.path is not None]
        worst.append(max(map(tilted, paths)))
        bound = max(float(manifold.chord_tilt(p[:, 1:], p[:, :-1]).max()) for p in paths)
        proven.append(math.degrees(bound))
        a, b = chords(h, edges, 1)
        middle = np.degrees(manifold.tilt(_arm(), 0.5 * (a + b)))
        single.append(float(np.median(middle)))
    # The second order: what a step twice as long multiplies the tilt by.
    order = np.diff(np.log(single)) / np.diff(np.log(steps))
    crossing = float(np.exp(np.interp(0.0, np.log(worst), np.log(steps))))
    proof = float(np.exp(np.interp(0.0, np.log(proven), np.log(steps))))
    x = np.array(steps)
    panel.series += [
        Series(
            "bound",
            x,
            proven,
            style="--",
            marker="",
            note="bound on the paths [degrees] " + ", ".join(f"{v:.2g}" for v in proven),
        ),
        Series(
            "paths, worst",
            x,
            worst,
            note="worst tilt on the paths [degrees] " + ", ".join(f"{v:.2g}" for v in worst),
        ),
        Series(
            "random edge, median",
            x,
            single,
            theory=lambda h: single[0] * (h / steps[0]) ** 2,
            note="median tilt of random edges [degrees] "
            + ", ".join(f"{v:.2g}" for v in single)
            + "; order "
            + ", ".join(f"{v:.2f}" for v in order),
        ),
    ]
    panel.notes = [
        f"steps {', '.join(f'{h:g}' for h in steps)} rad",
        f"the worst path exceeds {TOLERATED:g} degree above a step of {crossing:.2f} rad, "
        f"the bound above {proof:.2f} rad",
        f"random configurations: 0 of {samples} are upright exactly, "
        f"{int((angles <= TOLERATED).sum())} within {TOLERATED:g} degree "
        f"({samples * cap:.0f} expected for a uniform direction)",
        f"projected into the joint limits: {projected} of 2000 random configurations",
    ]
    assert int((angles == 0.0).sum()) == 0
    yield panel

    yield _races(world, questions, budget, footer)


def _races(
    world: planning.World, questions: list[tuple[Array, Array]], budget: int, footer: str
) -> Panel:
    """Return the shares of the queries that are solved without a collision, over time."""
    panel = Panel(
        "Share solved, open shelf",
        "time [ms]",
        "share of the queries",
        scale="log x",
        ylim=(0.0, 1.02),
        footer=footer,
    )
    own = ("ours, tilt proved", "ours, no proof")
    rivals = {
        f"OMPL, range {reach:g}, states {spacing:g}": (reach, spacing)
        for spacing in SPACINGS
        for reach in RANGES
    }
    spent: dict[str, list[float]] = {name: [] for name in (*own, *rivals)}
    tilts = {name: [0.0] for name in spent}
    answered, wrong = dict.fromkeys(spent, 0), dict.fromkeys(spent, 0)

    def rival(name: str, k: int, split: bool = False) -> ompl.Plan:
        reach, spacing = rivals[name]
        return ompl.carry(
            world, manifold.CUP, *questions[k], spacing, budget, k + 1, reach=reach, split=split
        )

    # Uncounted: what is loaded or compiled by a first call.
    manifold.cbirrt(world, *questions[0])
    rival(next(iter(rivals)), 0)
    for k, query in enumerate(questions):
        for name in spent:
            begun = time.thread_time()
            if name in rivals:
                other = rival(name, k)
                path, taken = None if other.path is None else other.path.T, other.seconds
            else:
                allowed = manifold.TILT if "proved" in name else 0.5 * math.pi
                path = manifold.cbirrt(world, *query, allowed=allowed, samples=budget, rng=k).path
                taken = time.thread_time() - begun
            if path is not None:
                answered[name] += 1
                tilts[name].append(tilted(path))
                if not check_path(world, path):
                    wrong[name] += 1
                    path = None
            spent[name].append(1e3 * taken if path is not None else math.inf)
    # The rival's best: the setting that solves the most queries; of these, the least median.
    best = min(rivals, key=lambda name: (-np.isfinite(spent[name]).sum(), np.median(spent[name])))
    parts = [1e3 * rival(best, k, split=True).own_seconds for k in range(len(questions))]
    parts = [t if math.isfinite(s) else math.inf for t, s in zip(parts, spent[best], strict=True)]
    for name, values in (*spent.items(), ("OMPL's own part", parts)):
        order = np.sort(values)
        solved = int(np.isfinite(order).sum())
        note = f"{name}: median {np.median(values):.1f} ms, {solved} of {len(questions)} solved"
        if name in tilts:
            note += f", worst tilt {max(tilts[name]):.2f} degrees; "
            note += f"{wrong[name]} of {answered[name]} paths collide and count as unsolved"
        if name in rivals and name != best:
            panel.notes.append(note)
            continue
        label = "OMPL, most solved" if name == best else name
        shares = np.arange(1, solved + 1) / len(questions)
        panel.series.append(
            Series(label, order[:solved], shares, style="steps", marker="", note=note)
        )
    both = [
        other / ours
        for other, ours in zip(spent[best], spent[own[0]], strict=True)
        if math.isfinite(other + ours)
    ]
    low, middle, high = np.quantile(both, (0.25, 0.5, 0.75))
    panel.notes += [
        f"drawn of OMPL's is {best.removeprefix('OMPL, ')} rad, which solves the most queries of "
        "those tried",
        f"OMPL's time over ours with the tilt proved, {len(both)} queries that both solved: "
        f"{middle:.1f} ({low:.1f} to {high:.1f})",
        "OMPL checks states, each by a Python function; ours proves edges in compiled code",
    ]
    return panel


# --- a point with a velocity ----------------------------------------------------------------------

ROOM = np.array([[0.0, 0.0, -2.0, -2.0], [10.0, 10.0, 2.0, 2.0]])  # m, m/s
BEGIN, END = np.array([1.0, 1.0, 0.0, 0.0]), np.array([9.0, 9.0, 0.0, 0.0])
POST = 0.03  # radius of a thin obstacle [m]


def posts(number: int = 150, seed: int = 0) -> Array:
    """Return posts of 3 cm radius, none near the start or the goal, shape (m, 3) [m]."""
    rng = np.random.default_rng(seed)
    rows = np.column_stack((rng.uniform(0.0, 10.0, (number, 2)), np.full(number, POST)))
    away = [np.hypot(*(rows[:, :2] - end[:2]).T) > 0.7 for end in (BEGIN, END)]
    return np.asarray(rows[away[0] & away[1]])


def touches(discs: Array, motion: kinodynamic.Motion) -> bool:
    """Return whether a trajectory, simulated again every 2 ms, enters a disc."""
    x, y = motion.points(0.002)[:2]
    gap = np.hypot(x - discs[:, :1], y - discs[:, 1:2]) - discs[:, 2:]
    return bool(gap.min() < 0.0)


def missed(spacing: float) -> float:
    """Return the share of straight crossings of a disc that points along the line miss.

    The chord has the length c = sqrt(1 - b^2) diameters for an offset b, uniform from 0 to 1.
    Points `spacing` diameters apart miss it with the probability 1 - c / spacing, at least 0.
    """
    b = (np.arange(20_000) + 0.5) / 20_000
    return float(np.mean(np.maximum(1.0 - np.sqrt(1.0 - b * b) / spacing, 0.0)))


def crossings(spacing: float, number: int, seed: int) -> tuple[float, float]:
    """Return the shares of crossings of a post that points miss, without and with the margin."""
    rng, unseen = np.random.default_rng(seed), [0, 0]
    wide = np.array([[-1e3] * 4, [1e3] * 4])
    dt = spacing * 2.0 * POST  # at 1 m/s
    steps = 2 + math.ceil(4.0 * POST / dt)
    for _ in range(number):
        begin = [-2.0 * POST - dt * rng.random(), POST * rng.uniform(-1.0, 1.0), 1.0, 0.0]
        for k, proved in enumerate((False, True)):
            done = kinodynamic.free_steps(
                [[0.0, 0.0, POST]], wide, begin, [0.0, 0.0], dt, steps, proved
            )
            unseen[k] += done == steps
    return unseen[0] / number, unseen[1] / number


@chart(columns=2)
def kinodynamic_bounds(
    seeds: int = 100,
    samples: int = 3000,
    ticks: Sequence[float] = (0.05, 0.1, 0.2, 0.4),
    spacings: Sequence[float] = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 4.0, 8.0),
    number: int = 2000,
) -> Iterator[Panel]:
    """Chart a kinodynamic RRT against its lower bound, and points along an edge against a proof.

    Args:
        seeds: runs of each method.
        samples: of a run at most.
        ticks: times between simulated points [s].
        spacings: of points over the diameter of a post.
        number: of crossings for each spacing.
    """
    discs, dt = posts(), 0.1
    footer = machine(libraries=("ompl",)) + "; one core, thread time"
    kinodynamic.warm()
    drawn, spent, ratios = (collections.defaultdict[str, list[float]](list) for _ in range(3))
    hit = collections.Counter[str]()
    # Name: whether proved, the metric, controls tried for each sample; of OMPL's the longest one.
    own = {
        "minimum time, proved": (True, "minimum time", kinodynamic.TRIES),
        "Euclidean, proved": (True, "Euclidean", kinodynamic.TRIES),
        "Euclidean, points": (False, "Euclidean", kinodynamic.TRIES),
        "Euclidean, one control": (False, "Euclidean", 1),
    }
    rivals = {f"OMPL, up to {steps} steps": steps for steps in LONGEST}
    ompl.controls(discs, ROOM, BEGIN, END, 0.5, 1.0, dt, kinodynamic.STEPS, 10, 1)  # uncounted
    for seed in range(seeds):
        for name in (*own, *rivals):
            begun = time.thread_time()
            if name in own:
                proved, metric, tries = own[name]
                motion = kinodynamic.kinodynamic_rrt(
                    discs,
                    ROOM,
                    BEGIN,
                    END,
                    dt=dt,
                    proved=proved,
                    metric=metric,
                    tries=tries,
                    samples=samples,
                    rng=seed,
                )
                taken = time.thread_time() - begun
            else:
                plan, pulls, lasted = ompl.controls(
                    discs, ROOM, BEGIN, END, 0.5, 1.0, dt, rivals[name], samples, seed + 1
                )
                taken = plan.seconds
                path = np.empty((4, 0)) if plan.path is None else plan.path.T
                status = "solved" if plan.path is not None else "out of samples"
                nothing = np.empty((4, 0)), np.empty(0, dtype=np.int64)
                motion = kinodynamic.Motion(status, path, pulls.T, lasted, plan.samples, *nothing)
            drawn[name].append(motion.samples if motion.solved else math.inf)
            spent[name].append(1e3 * taken if motion.solved else math.inf)
            bound = math.nan
            if motion.solved:
                bound = kinodynamic.minimum_time(motion.states[:, 0], motion.states[:, -1])
                hit[name] += touches(discs, motion)
            ratios[name].append(motion.seconds / bound if motion.solved else math.inf)
    # The rival's best: the least median, where a failure takes for ever.
    best = min(rivals, key=lambda name: float(np.median(spent[name])))
    notes = dict[str, str]()
    for name in drawn:
        solved = int(np.isfinite(drawn[name]).sum())
        low, middle, high = np.quantile(ratios[name], (0.25, 0.5, 0.75), method="higher")
        notes[name] = (
            f"{name}: {solved} of {seeds} solved, median {np.median(drawn[name]):.0f} samples and "
            f"{np.median(spent[name]):.1f} ms; time over the lower bound {middle:.2f} "
            f"({low:.2f} to {high:.2f}), least {min(ratios[name]):.2f}; {hit[name]} hit a post"
        )
    panels = [
        Panel(
            "Share solved", "time to plan [ms]", "share of the runs", scale="log x", footer=footer
        ),
        Panel(
            "Time of the trajectory",
            "time over the lower bound",
            "share of the runs",
            scale="log x",
            footer=footer,
        ),
    ]
    for panel, values in zip(panels, (spent, ratios), strict=True):
        for name in (*own, best):
            order = np.sort(values[name])
            solved = int(np.isfinite(order).sum())
            shares = np.arange(1, solved + 1) / seeds
            note = notes[name] if values is spent else ""
            label = "OMPL, points" if name == best else name
            panel.series.append(
                Series(label, order[:solved], shares, style="steps", marker="", note=note)
            )
    alike = stats.ks_2samp(
        drawn["Euclidean, one control"], drawn[f"OMPL, up to {kinodynamic.STEPS} steps"]
    )
    pairs = np.array(spent[best]) / spent["Euclidean, one control"]
    low, middle, high = np.quantile(pairs[np.isfinite(pairs)], (0.25, 0.5, 0.75))
    panels[0].notes = [
        *(notes[name] for name in rivals if name != best),
        f"drawn of OMPL's is {best.removeprefix('OMPL, ')} of a control, the least median",
        "OMPL tries one control for each sample; its simulation and its check are Python functions",
        f"samples of one control and of OMPL with as long controls: largest difference of the "
        f"shares {alike.statistic:.2f}, p {alike.pvalue:.2f}",
        f"OMPL's time over ours with one control, seed by seed: {middle:.1f} "
        f"({low:.1f} to {high:.1f})",
    ]
    panels[1].lines = (("x", 1.0, "bound"),)
    yield from panels

    panel = Panel(
        "Crossings of a post missed",
        "spacing of the points over the diameter",
        "share of the crossings",
        scale="log x",
        footer=footer,
    )
    kinds = np.array([crossings(spacing, number, 0) for spacing in spacings]).T
    deviation = np.abs(kinds[0] - [missed(s) for s in spacings])
    words = ", ".join(f"{v:.1%}" for v in kinds[0])
    panel.series = [
        Series(
            "points alone",
            spacings,
            kinds[0],
            theory=missed,
            note=f"crossings missed by points, spacing {', '.join(map(str, spacings))}: "
            f"{words}; from theory by {deviation.max():.3f} at most",
        ),
        Series(
            "with the margin",
            spacings,
            kinds[1],
            note=f"crossings missed with the margin: {int(kinds[1].sum() * number)} of "
            f"{number * len(spacings)}",
        ),
    ]
    yield panel

    panel = Panel(
        "Returned trajectories that hit a post",
        "time between points [s]",
        "share of the trajectories",
        scale="log x",
        ylim=(-0.02, 1.0),
        footer=footer,
    )
    for name, proved in (("points alone", False), ("with the margin", True)):
        hits, counts = list[float](), list[int]()
        for tick in ticks:
            motions = [
                kinodynamic.kinodynamic_rrt(
                    discs, ROOM, BEGIN, END, dt=tick, proved=proved, samples=samples, rng=seed
                )
                for seed in range(seeds)
            ]
            paths = [m for m in motions if m.solved]
            counts.append(len(paths))
            hits.append(float(np.mean([touches(discs, m) for m in paths])))
        note = f"{name}, {', '.join(map(str, ticks))} s between points: hit a post "
        note += ", ".join(f"{v:.0%}" for v in hits) + "; solved " + ", ".join(map(str, counts))
        panel.series.append(Series(name, ticks, hits, note=f"{note} of {seeds}"))
    yield panel
