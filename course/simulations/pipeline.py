"""Chapter 11's simulation: the whole pipeline at work, and whose part of the error is whose.

A run is computed at every change, with common random numbers: once as it is, once with each stage
ideal, and for other seeds to count successes. A drag moves the target of the running experiment:
what was seen and done before stays as it was.
"""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numba import objmode
from numba.extending import register_jitable

from course import pipeline as chapter
from course.measure.success import wilson
from course.pipeline import blame, drive, theory
from course.pipeline.run import Run, tip_of
from course.pipeline.stages import Path, Stages, plan_path
from course.planning import plan as planner
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider, switch

SECONDS, PAUSE, SHOWN, SEED = 4.0, 0.8, 400, 3  # s, s, pictures, of the run shown
COUNTED, FEWER = 16, 2  # seeds that are counted, and where a run is dear
MANY, DEAR = 2_000, 10_000  # checks in a run that make it dear; beyond which it is not replayed
FRAMES, TREE, PLANS, LINE, MOVES = 200, 300, 12, 40, 24  # most of each that are shown
TO = (-0.1, 0.5)  # where a target drifts to, and beyond [m]
NEAREST, FARTHEST = 0.25, 0.85  # of a target [m]
NEVER = 1e9  # s
ROOM = 0.06  # that a target keeps from a disc [m]
_PUSHES = 8  # more than any place within the window needs
ARM, DISCS = chapter.Scenario().arm, chapter.Scenario().discs
_LENGTHS = tuple(map(float, ARM.lengths))
STAGES = chapter.STAGES
# What can break at an interface, as words; the first is for none.
CONTRACTS = (
    "none",
    "frames are older than was agreed",
    "frames do not arrive",
    "it is less exact than was agreed",
    "errors do not agree with the bias",
    "errors do not agree with the covariance",
    "no path",
    "its path takes longer than there is time",
    "it is late",
    "it keeps less from the discs than was agreed",
    "the torque is not that of the law",
    "the arm is faster than any path",
    "energy rises unforced",
    "the arm diverged",
    "another contract",
)
REASONS = (
    "success",
    "touched a disc",
    "beside the target",
    "the plan is late",
    "no plan",
    "the arm diverged",
    "stopped",
    "being computed",
)
UNDER_WAY = len(REASONS) - 1
# What the report holds: share of successes and its band, checks, age of what is acted upon [s], the
# largest stable step of the physics [s], energy that came from nowhere, how it ended, the contract
# broken first, whose repair alone cures (0 for nobody's), plans, whether stages are replayed, how
# many runs are missing until all of this is complete; then the signed parts [m].
SHARE, LOW, HIGH, CHECKS, AGE, LIMIT, GAINED, ENDED, BROKEN, CURED, ASKED, REPLAYED = range(12)
LEFT, PARTS = 12, 13
# A notebook goes on answering between portions: after PORTION runs, and within a run after the
# first slice with which the planner has made CHECKED more checks.
PORTION, SLICES, CHECKED = 2, 40, 5_000

CONTROLS = Record(
    noise=slider("Perception Noise", 0.05, 0.0, 0.2, 0.005, "m", 3),
    kp=slider("Control Kp", 25.0, 1.0, 200.0, 1.0, "N m/rad", 0),
    kd=slider("Control Kd", 8.0, 0.0, 20.0, 0.5, "N m s/rad", 1),
    dt=slider("Physics dt", 2.0, 0.5, 20.0, 0.5, "ms", 1),
    edge=slider("Planner Step", 0.3, 0.01, 0.6, 0.01, "rad", 3),
    latency=slider("Latency", 100.0, 0.0, 600.0, 20.0, "ms", 0),
    speed=slider("Target Speed", 0.01, 0.0, 0.1, 0.005, "m/s", 3),
    filtered=switch("Filter", True),
    mended=menu("Ideal stage", ("none", *STAGES)),
    follows=switch("Follow the old plan", False),
    aim=Field((0.15, 0.60), low=-1.0, high=1.0, unit="m"),
    margin=Field(0.05, low=0.0, high=0.1, unit="m"),
    bias=Field((-0.003, 0.002), low=-0.05, high=0.05, unit="m"),
    check=Field(20.0, low=0.0, high=5000.0, unit="us"),
)
STATE = Record(
    q=Field(0.0, shape=(2, SHOWN + 1), unit="rad"),
    reference=Field(0.0, shape=(2, SHOWN + 1), unit="rad"),
    target=Field(0.0, shape=(2, SHOWN + 1), unit="m"),
    sightings=Field(
        0.0, shape=(8, FRAMES)
    ),  # arrival, capture [s], picture, estimate, spread xx, yy
    tree=Field(0.0, shape=(4, TREE), unit="m"),
    paths=Field(0.0, shape=(2, PLANS, LINE), unit="m"),
    ready=Field(0.0, shape=(PLANS,), unit="s"),
    moves=Field(0.0, shape=(3, MOVES)),  # when the target was moved [s], and where to [m]
    moved=Field(0),
    report=Field(0.0, shape=(PARTS + 2 * len(STAGES),)),
    values=Field(0.0, shape=(16,)),  # the controls that this was computed for
    remaining=Field(0),  # runs that are missing until the report is complete
    time=Field(0.7, unit="s"),  # it is first seen on its way, not while it waits for a picture
)


def scenario_and_settings(values):
    """Return scenario and settings that the controls, as numbers, ask for."""
    noise, kp, kd, dt, edge, latency, speed, filtered, mended, x, y, margin, bx, by = values[:14]
    follows, check = values[14:]
    # A target that drifts towards TO, and where it would be at the end of the run: kept within
    # reach and off the discs, it defines the velocity.
    away = max(math.dist((x, y), TO), 1e-9)
    far = SECONDS * speed / away
    u, v = _reachable(x + far * (TO[0] - x), y + far * (TO[1] - y))
    velocity = (u - x) / SECONDS, (v - y) / SECONDS
    scenario = chapter.Scenario(target=(x, y), velocity=velocity)
    settings = chapter.Settings(
        noise=noise,
        bias=(bx, by),
        kp=kp,
        kd=kd,
        physics=1e-3 * dt,
        control=1e-3 * dt,
        step=edge,
        latency=1e-3 * latency,
        filtered=bool(filtered),
        margin=margin,
        samples=800,
        hysteresis=bool(follows),
        check_cost=1e-6 * check,
    )
    # An ideal stage has its imperfections removed before the run.
    return scenario, chapter.repair(settings, *STAGES[int(mended) - 1 : int(mended)])


def agreed(scenario, settings):
    """Return the settings that the interfaces specify.

    These are the chapter's defaults, with this period of control.
    """
    promised = chapter.Settings(kp=settings.kp, kd=settings.kd)
    return replace(promised, physics=settings.physics, control=settings.control)


class Count:
    """The run as the controls have it and its report, complete after several portions.

    A notebook shows the run at once, and counts and replays while it goes on answering.

    Attributes:
        report: of what has been computed so far.
        drawn: what is drawn of the run, as far as it has come, in the order of the state.
    """

    def __init__(self, values):
        self.report = np.zeros(PARTS + 2 * len(STAGES))
        self.report[LEFT], self.report[ENDED] = 1 + COUNTED + len(blame.REPLAYED), UNDER_WAY
        self.drawn = ()
        self._observed = Observed(values)
        self._portions = _portions(values, self._observed, self.report)
        self.more()

    def more(self):
        """Compute the next portion; return whether any is left."""
        going = self.report[ENDED] == UNDER_WAY
        next(self._portions, None)
        if going:
            self.drawn = self._observed.drawn()
        # A run that diverged leaves numbers that no readout can show.
        self.report[~np.isfinite(self.report)] = 0.0
        return bool(self.report[LEFT] > 0.0)


@lru_cache(maxsize=32)
def count(values):
    """Return the count that belongs to the controls, wherever it has come to."""
    return Count(values)


def _portions(values, observed, report):
    """Fill in the report: first what the run itself says, then a few other runs at a time."""
    scenario, settings = scenario_and_settings(values)
    # One recorded run is diagnosed in detail; the success rate comes from several seeds, fewer of
    # them if planning is expensive.
    for _ in _slices(observed.process):
        _tell(observed.process.record(), report)
        yield
    record = observed.process.record()
    _tell(record, report)
    dear = report[CHECKS] > DEAR
    seeds = FEWER if report[CHECKS] > MANY else COUNTED
    stages = () if dear else blame.REPLAYED
    report[LEFT] = seeds + len(stages)
    report[GAINED] = blame.gained(record, settings.kp, settings.kd)
    # Reasons and contracts are strings of the chapter; the state can hold their numbers only.
    text = record.reason.split(":")[0]
    diverged = "diverged" in record.reason
    known = {"": 0, **{name: k for k, name in enumerate(REASONS)}}
    report[ENDED] = 5 if diverged else known.get(text, 6)
    broken = blame.contracts(record, agreed(scenario, settings))
    if broken:
        what = broken[0].what.split(":")[0]
        report[BROKEN] = CONTRACTS.index(what) if what in CONTRACTS else len(CONTRACTS) - 1
    report[REPLAYED] = not dear
    yield
    good = 0
    for seed in range(seeds):
        other = Run(scenario, settings, seed=seed)
        yield from _slices(other)
        good += other.record().success
        report[LEFT] -= 1
        if seed % PORTION == PORTION - 1 and seed < seeds - 1:
            yield
    report[SHARE], (report[LOW], report[HIGH]) = good / seeds, wilson(good, seeds)
    # Counterfactual replays with the same seed: repair one stage and see whether this alone cures
    # the run, and by how much the error changes.
    for stage in stages:
        yield
        k = STAGES.index(stage)
        better = chapter.run(scenario, chapter.repair(settings, stage), seed=SEED)
        if not record.success and better.success and report[CURED] == 0.0:
            report[CURED] = k + 1.0
        report[PARTS + 2 * k : PARTS + 2 * k + 2] = record.error - better.error
        report[LEFT] -= 1


def _slices(process):
    """Advance a run to its end; yield on the way wherever the planner has checked much."""
    done = 0
    for k in range(1, SLICES):
        process.to(SECONDS * k / SLICES)
        checks = sum(p.value.checks for p in process.plans)
        if checks > done + CHECKED:
            done = checks
            yield
    process.to(SECONDS)


def _tell(record, report):
    """Fill in what a run says before its end: its plans, the age of what it sees, its limit."""
    report[CHECKS], report[ASKED] = sum(p.value.checks for p in record.plans), len(record.plans)
    report[AGE] = 1e-6 * np.mean([p.arrived - p.captured for p in record.pictures] or [0])
    # The step limit is that of the loop at the planned posture, or at the start without a plan.
    scenario, settings = record.scenario, record.settings
    posture = record.plans[0].value.goal if record.plans else np.full(2, np.nan)
    posture = posture if np.isfinite(posture).all() else np.array(scenario.start)
    report[LIMIT] = theory.step_limit(scenario.arm, posture, settings.kp, settings.kd)


class Observed:
    """The run that is drawn: its planner leaves the tree of its last call.

    Attributes:
        process: the run.
    """

    def __init__(self, values):
        scenario, settings = scenario_and_settings(values)
        self._tree = np.zeros((4, TREE))

        def grown(world, start, goal, settings, rng):
            result = planner(
                world, start, goal, budget=settings.samples, rng=rng, step=settings.step
            )
            inner = np.flatnonzero(result.parents >= 0)[:TREE]
            self._tree[:, : inner.size] = np.concatenate(
                [tip_of(scenario.arm, result.nodes[:, k]) for k in (result.parents[inner], inner)]
            )
            return result.path, result.state_checks + result.edge_checks, result.status

        def planned(start, goal, scenario, settings, rng) -> Path:
            return plan_path(start, goal, scenario, settings, rng, grown)

        self.process = Run(scenario, settings, Stages(plan=planned), SEED)
        self._times = np.linspace(0.0, SECONDS, SHOWN + 1)
        self._target = scenario.at(0.0)[:, None] + np.outer(scenario.velocity, self._times)

    def retarget(self, when, x, y):
        """Advance to a time [s] and put the target to (x, y) [m] from then on."""
        if self.process.to(when):
            self.process.retarget((x, y))
            self._target[:, self._times >= when] = [[x], [y]]

    def drawn(self):
        """Return what is drawn of the run as far as it has come, in the order of the state.

        The arm stays where the run has brought it.
        """
        record = self.process.record()
        # The log has its own rate: each shown moment takes the last row before it.
        rows = (self._times / (1e-6 * record.step) + 1e-9).astype(int)
        rows = np.minimum(rows, len(record.log) - 1)
        observed = np.zeros((8, FRAMES))
        observed[0] = NEVER
        # Only pictures that the estimator used; those beyond the room of the state are omitted.
        pictures = [k for k in np.flatnonzero(record.sightings[:, drive.USED] > 0.0)][:FRAMES]
        table, row = record.timetable, record.sightings[pictures]
        observed[0, : len(pictures)] = 1e-6 * table.arrived[pictures]
        observed[1, : len(pictures)] = 1e-6 * table.captured[pictures]
        columns = [drive.PLACE, drive.PLACE + 1, drive.GUESS, drive.GUESS + 1]
        observed[2:6, : len(pictures)] = row[:, columns].T
        observed[6:, : len(pictures)] = row[:, [drive.GUESS_SPREAD, drive.GUESS_SPREAD + 2]].T
        paths, ready = np.zeros((2, PLANS, LINE)), np.full(PLANS, NEVER)
        for k, crossing in enumerate(record.plans[-PLANS:]):
            if crossing.value.motion is not None:
                ready[k] = 1e-6 * crossing.arrived
                path = crossing.value.waypoints
                # Resample a path at equal distances in joint space, so that it has a fixed number
                # of points.
                along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path), axis=0))))
                at = np.linspace(0.0, along[-1], LINE)
                points = np.stack([np.interp(at, along, w) for w in path])
                paths[:, k] = tip_of(record.scenario.arm, points)
        q, desired = (record.log[rows, k : k + 2].T.copy() for k in (drive.Q, drive.REFERENCE))
        return q, desired, self._target.copy(), observed, self._tree.copy(), paths, ready


def shown(values, moves):
    """Return what is drawn of the run in which the target was moved, in the order of the state."""
    # Moves of the target are replayed at their times; the past before them stays as it was.
    observed = Observed(values)
    for when, x, y in moves.T:
        observed.retarget(when, x, y)
    observed.process.to(SECONDS)
    return observed.drawn()


@register_jitable
def _reachable(x, y):
    """Return a place near (x, y) that the arm reaches well and the discs leave free."""
    # A push out of one disc may lead into the next or out of reach, so all is repeated.
    for _ in range(_PUSHES):
        # Pull the target into the annulus that the arm reaches well; the origin has no direction.
        r = math.hypot(x, y)
        factor = min(max(r, NEAREST), FARTHEST) / max(r, 1e-9)
        x, y = (x * factor, y * factor) if r > 1e-9 else (NEAREST, 0.0)
        # Out of a disc along its radius; from its centre all directions are equal.
        for u, v, size in DISCS:
            away = math.hypot(x - u, y - v)
            if away < size + ROOM:
                out = (size + ROOM) / max(away, 1e-9)
                x, y = (
                    (u + out * (x - u), v + out * (y - v)) if away > 1e-9 else (u + size + ROOM, v)
                )
    return x, y


def computed(values, moves, more):
    """Return the report, and what is drawn, in the order of the state.

    Args:
        values: the controls, as numbers.
        moves: of the target: when [s] and where to [m], (3, M).
        more: whether another portion of the report is computed first.
    """
    key = tuple(values.tolist())
    whole = count(key)
    if more:
        whole.more()
    # Without a move the run that is reported on is the one that is drawn.
    return whole.report, *(shown(key, moves) if moves.size else whole.drawn)


def reported(values):
    """Return the report with another portion."""
    whole = count(tuple(values.tolist()))
    whole.more()
    return whole.report


@register_jitable
def _fill(state, more):
    """Write what has been computed into the state, with another portion or without."""
    # Planning and estimation are Python: compiled code calls them in object mode.
    values, moves = state["values"].copy(), state["moves"][:, : int(state["moved"])].copy()
    with objmode(
        report="float64[:]",
        q="float64[:,:]",
        desired="float64[:,:]",
        target="float64[:,:]",
        observed="float64[:,:]",
        tree="float64[:,:]",
        paths="float64[:,:,:]",
        ready="float64[:]",
    ):
        report, q, desired, target, observed, tree, paths, ready = computed(values, moves, more)
    state["report"][:], state["ready"][:] = report, ready
    state["remaining"] = int(report[LEFT])
    state["q"][:], state["reference"][:], state["target"][:] = q, desired, target
    state["sightings"][:], state["tree"][:], state["paths"][:] = observed, tree, paths


@register_jitable
def _take(controls, state):
    """Write the controls, as numbers, into the state."""
    c = controls
    x, y = _reachable(c["aim"][0], c["aim"][1])
    v = state["values"]
    v[0], v[1], v[2], v[3], v[4], v[5] = (
        c["noise"],
        c["kp"],
        c["kd"],
        c["dt"],
        c["edge"],
        c["latency"],
    )
    v[6], v[7], v[8], v[9], v[10] = c["speed"], 1.0 * c["filtered"], 1.0 * c["mended"], x, y
    v[11], v[12], v[13] = c["margin"], c["bias"][0], c["bias"][1]
    v[14], v[15] = 1.0 * c["follows"], c["check"]


@register_jitable
def initial(controls, state):
    """Set up the run, or its beginning where planning takes long; `complete` adds the rest."""
    _take(controls, state)
    _fill(state, False)


def complete(controls, state):
    """Continue a long run, or add a few more runs to the report."""
    if state["moved"] == 0:
        _fill(state, True)
    else:
        # The run that is drawn has its target moved, and it is there already.
        values = state["values"].copy()
        with objmode(report="float64[:]"):
            report = reported(values)
        state["report"][:] = report
        state["remaining"] = int(report[LEFT])


def advance(state, controls, seconds):
    """Advance the simulation: the run is shown again and again.

    A target that was moved is back when it begins anew.
    """
    state["time"] += seconds
    # After the pause the run begins again, with the target where the controls have it.
    if state["time"] > SECONDS + PAUSE:
        state["time"] -= SECONDS + PAUSE
        if state["moved"] > 0:
            state["moved"] = 0
            _fill(state, False)


TITLE = "The whole pipeline: see, plan, control, move"
word, colour = draw.words_table(), draw.colours_table()
_SAND = colour("#f7f5ef")[0]
_STAGE, _REASON, _CONTRACT = word(*STAGES)[0], word(*REASONS)[0], word(*CONTRACTS)[0]
_SCENE_TITLE, _PARTS_TITLE, _TIME, _FAR, _MM, _LIMIT, _DT = word(
    "arm, discs, target",
    "what an ideal stage takes away",
    "time [s]",
    "tip to target [cm]",
    "[mm]",
    "limit",
    "physics dt [ms]",
)
_TRUE, _SEEN, _BELIEVED, _PATH, _WANTED = word(
    "target", "frames", "estimate", "tree, path", "reference"
)
_NOW, _GOOD, _AGE, _CHECKS, _STABLE, _ROSE, _END, _FIX, _CURE = word(
    "tip to target",
    "successes [%]",
    "latency of a frame",
    "collision checks",
    "largest stable dt",
    "energy from nowhere",
    "this run",
    "Fix it: ",
    "cured alone by",
)
_NOBODY, _DEAR, _NOTHING, _MILLI, _MS, _BAND, _UP_TO, _CLOSE, _PERCENT, _PLANS = word(
    "none of five",
    "not replayed",
    "nothing to cure",
    " mm",
    " ms",
    " (",
    " to ",
    ")",
    " %",
    ", plans: ",
)
_RUNS_LEFT, _TRYING, _COLON = word(" runs to go", "being tried", ": ")
_COLOUR = (draw.BLUE, draw.GREEN, draw.ORANGE, draw.PURPLE, draw.RED)
_SCENE, _VIEW = (0.1, 4.4, 0.35, 4.65), (-0.65, 0.95, -0.5, 1.1)
_CHART, _SIGNED = (5.2, 8.85, 3.05, 4.5), (5.2, 6.9, 0.75, 2.25)
_GAUGE = (7.35, 8.85, 0.75, 0.98)


@register_jitable
def _arm(pen, q, ink, width, alpha):
    """Return links and joints of a posture."""
    l1, l2 = _LENGTHS
    x, y = l1 * math.cos(q[0]), l1 * math.sin(q[0])
    u, v = x + l2 * math.cos(q[0] + q[1]), y + l2 * math.sin(q[0] + q[1])
    draw.curve(pen, np.array([0.0, x, u]), np.array([0.0, y, v]), ink, width, alpha)
    draw.spots(pen, np.array([0.0, x]), np.array([0.0, y]), 0.02, ink, draw.NONE, 1.5, alpha)
    return u, v


@register_jitable
def _scene(pen, state, t, now):
    """Draw the world, what is observed and believed, the plan, and the arm; return its tip."""
    draw.area(pen, _SCENE, _VIEW)
    draw.box(pen, *_VIEW, _SAND, draw.GREY)
    draw.title(pen, _VIEW[0], _VIEW[3], _SCENE_TITLE)
    for x, y, size in DISCS:
        draw.spot(pen, x, y, size, draw.GREY, draw.INK, 1.0, 0.6)
    # The plan in force is the last one that was ready by now.
    tree, latest = state["tree"], -1
    for k in range(PLANS):
        if state["ready"][k] <= t:
            latest = k
    if latest >= 0:
        for k in range(TREE):
            if tree[0, k] != tree[2, k] or tree[1, k] != tree[3, k]:
                draw.segment(
                    pen, tree[0, k], tree[1, k], tree[2, k], tree[3, k], draw.ORANGE, 0.8, 0.45
                )
        path = state["paths"][:, latest]
        draw.curve(pen, path[0], path[1], draw.ORANGE, 2.0)
    # The last 25 pictures as dots, and the estimate with its ellipse of two standard deviations.
    observed, last, first = state["sightings"], -1, 0
    for k in range(FRAMES):
        if observed[0, k] <= t:
            last = k
    first = max(0, last - 24)
    if last >= 0:
        draw.spots(
            pen,
            observed[2, first : last + 1],
            observed[3, first : last + 1],
            0.008,
            draw.BLUE,
            draw.NONE,
            1.0,
            0.5,
        )
    x, y = state["target"][0, now], state["target"][1, now]
    draw.spot(pen, x, y, 0.02, draw.GREEN, draw.INK, 1.0, 0.9)
    if last >= 0:
        turn = np.linspace(0.0, 2.0 * math.pi, 33)
        draw.curve(
            pen,
            observed[4, last] + 2.0 * math.sqrt(observed[6, last]) * np.cos(turn),
            observed[5, last] + 2.0 * math.sqrt(observed[7, last]) * np.sin(turn),
            draw.BLUE,
            1.6,
        )
    # The reference as a pale arm behind the real one.
    _arm(pen, state["reference"][:, now], draw.ORANGE, 4.0, 0.35)
    return _arm(pen, state["q"][:, now], draw.INK, 5.0, 1.0)


def frame(pen, state, controls):
    """Draw the scene, the error and its signed parts over time, the step's limit and verdict."""
    report = state["report"]
    t = min(state["time"], SECONDS)
    now = int(t / SECONDS * SHOWN + 1e-9)
    u, v = _scene(pen, state, t, now)
    far = math.hypot(u - state["target"][0, now], v - state["target"][1, now])
    # Signed distances from the tip to the target, by forward kinematics, up to now.
    l1, l2 = _LENGTHS
    q, both = state["q"][:, : now + 1], state["q"][0, : now + 1] + state["q"][1, : now + 1]
    off_x = l1 * np.cos(q[0]) + l2 * np.cos(both) - state["target"][0, : now + 1]
    off_y = l1 * np.sin(q[0]) + l2 * np.sin(both) - state["target"][1, : now + 1]
    draw.chart(pen, _CHART, (0.0, SECONDS, 0.0, 30.0), _TIME, 0, _FAR, 5, 4)
    draw.segment(pen, 0.0, 2.0, SECONDS, 2.0, draw.GREEN, 1.5, 1.0, 4.0, 3.0)
    times = np.linspace(0.0, SECONDS, SHOWN + 1)
    draw.curve(pen, times[: now + 1], 100.0 * np.hypot(off_x, off_y), draw.INK, 2.0)
    # What each ideal stage would take away from the error, as arrows from the same origin. The
    # scale doubles until the longest arrow fits.
    high = 15.0
    while high < 1e3 * np.abs(report[PARTS:]).max() and high < 1e4:
        high *= 2.0
    across = high * 17.0 / 15.0
    draw.chart(pen, _SIGNED, (-across, across, -high, high), _MM, 0, _PARTS_TITLE, 4, 4)
    for k in range(len(STAGES)):
        x, y = 1e3 * report[PARTS + 2 * k], 1e3 * report[PARTS + 2 * k + 1]
        if math.hypot(x, y) > 0.02 * high:
            # Thinner from arrow to arrow: two that point the same way are both visible.
            draw.arrow(pen, 0.0, 0.0, x, y, _COLOUR[k], 5.5 - 0.9 * k, 8.0)
    # The physics step against the largest stable one.
    draw.gauge(pen, _GAUGE, 20.0, controls["dt"], draw.GREY, _DT, 1e3 * report[LIMIT], _LIMIT)
    draw.window(pen)
    for k in range(len(STAGES)):
        draw.key(pen, 7.2, 2.25 - 0.2 * k, _STAGE + k, _COLOUR[k], 3.0)
        draw.words(pen, _COLON)
        part = 1e3 * math.hypot(report[PARTS + 2 * k], report[PARTS + 2 * k + 1])
        draw.number(pen, part, 0, _MILLI)
    if report[BROKEN] > 0.0:
        draw.text(pen, 0.2, 0.52, _FIX, draw.INK, 13.0)
        draw.words(pen, _CONTRACT + int(report[BROKEN]))
    draw.key(pen, 0.15, 0.15, _SEEN, draw.BLUE, 3.0)
    draw.key(pen, 1.25, 0.15, _BELIEVED, draw.BLUE, 1.6)
    draw.key(pen, 2.45, 0.15, _PATH, draw.ORANGE, 2.0)
    draw.key(pen, 3.65, 0.15, _WANTED, draw.ORANGE, 4.0, 0.35)
    draw.reading(pen, _NOW, 1e3 * far, 1, _MILLI)
    if report[HIGH] > 0.0:
        draw.reading(pen, _GOOD, 100.0 * report[SHARE], 0)
        draw.words(pen, _BAND)
        draw.number(pen, 100.0 * report[LOW], 0, _UP_TO)
        draw.number(pen, 100.0 * report[HIGH], 0, _CLOSE)
    else:
        draw.reading(pen, _GOOD, report[LEFT], 0, _RUNS_LEFT)
    draw.reading(pen, _AGE, 1e3 * report[AGE], 0, _MS)
    draw.reading(pen, _CHECKS, report[CHECKS], 0, _PLANS)
    draw.number(pen, report[ASKED], 0)
    draw.reading(pen, _STABLE, 1e3 * report[LIMIT], 2, _MS)
    draw.reading(pen, _ROSE, 100.0 * report[GAINED], 1, _PERCENT)
    draw.reading(pen, _END, 0.0, 0, 0, _REASON + int(report[ENDED]))
    cured = int(report[CURED])
    nobody = _NOTHING if report[ENDED] == 0.0 else _NOBODY if report[REPLAYED] > 0.0 else _DEAR
    if report[LEFT] > 0.0:
        nobody = _TRYING
    draw.reading(pen, _CURE, 0.0, 0, 0, _STAGE + cured - 1 if cured > 0 else nobody)


def drag(controls, state, x, y):
    """Handle a drag: the target follows the pointer while the run goes on.

    The rest of the past stays.
    """
    u, v = draw.values_at(_SCENE, _VIEW, x, y)
    # The move happens at the time shown; at the very end it would have no consequence.
    t = min(state["time"], SECONDS - 0.01)
    count = int(state["moved"])
    # Moves that are close to each other in time are one.
    if count == 0 or (t - state["moves"][0, count - 1] > 0.05 and count < MOVES):
        count += 1
        state["moves"][0, count - 1] = t
    state["moves"][1, count - 1], state["moves"][2, count - 1] = _reachable(u, v)
    state["moved"] = count
    _fill(state, False)


PRESETS = {
    "All stages": Preset(
        {},
        "Seen with noise, planned, tracked, moved. Each arrow shows how "
        "far the tip would move if one stage were ideal. Drag the target while the arm is moving.",
        "Seen with noise, planned, tracked, moved. Each arrow shows how far the tip would move "
        "if one stage were ideal.",
    ),
    "Noise, no filter": Preset(
        {"filtered": False},
        "Every image is believed as it is: the goal "
        "jumps, and many plans are thrown away soon after the arm has begun to follow them. Turn "
        "the filter on.",
        "Every image is believed as it is: the goal jumps, and many plans are thrown away soon "
        "after the arm has begun to follow them.",
    ),
    "Planner step to minimum": Preset(
        {"edge": 0.01},
        "The planner adds edges of at most 0.01 "
        "rad, so its 800 samples run out before it reaches the goal. Mostly there is no plan, and "
        "the arm stays where it is. The checks themselves take only about 30 ms.",
    ),
    "Kp high, Kd zero": Preset(
        {"kp": 150.0, "kd": 0.0},
        "The arm overshoots and rings; only the friction of its joints damps it.",
    ),
    "More damping": Preset(
        {"kp": 150.0, "kd": 16.0},
        "With the same Kp and more damping the arm "
        "swings less than a third as far around its reference, and all counted seeds succeed. But "
        "the largest stable step of the physics is about a sixth of what it is without Kd.",
    ),
    "Physics step above its limit": Preset(
        {"dt": 12.0},
        "The step is a fifth longer than the "
        "largest stable one. Energy appears from nowhere, a few percent, and the run still "
        "succeeds: success alone does not show that the step is too long.",
    ),
    "Physics step to maximum": Preset(
        {"dt": 20.0},
        "The step exceeds the stability limit of the "
        "posture. The simulation creates energy, and only the torque limits keep the arm from "
        "flying off. With these gains no posture allows this step, and more damping lowers the "
        "limit.",
    ),
    "Cancelling errors": Preset(
        {"speed": 0.03, "noise": 0.01, "bias": (-0.012, -0.005)},
        "The bias of perception points ahead and the lag points back, so the tip ends closer to "
        "the target than with either alone. Make only perception ideal: it ends further away.",
        "The bias of perception points ahead and the lag points back, so the tip ends closer to "
        "the target than either error alone would allow.",
    ),
    "Stale camera": Preset(
        {"latency": 600.0, "speed": 0.06, "noise": 0.01},
        "The estimate is "
        "where the target was. A more accurate camera does not help; a shorter latency does.",
    ),
    "Half the latency": Preset(
        {"latency": 300.0, "speed": 0.06, "noise": 0.01},
        "Half the latency "
        "of a stale camera, and still no counted seed succeeds: while an image is processed, the "
        "target moves by almost 2 cm.",
    ),
    "Plan from an old posture": Preset(
        {"speed": 0.1, "check": 2000.0, "follows": True},
        "A "
        "collision check takes 2 ms here, so a plan takes some tenths of a second. Meanwhile the "
        "arm follows its old plan. The new one begins where the arm was when planning began: the "
        "reference, the pale arm, jumps back. Turn off *Follow the old plan*: the arm waits for "
        "each plan, and nothing jumps.",
        "A collision check takes 2 ms here, so a plan takes some tenths of a second. Meanwhile "
        "the arm follows its old plan. The new one begins where the arm was when planning began: "
        "the reference, the pale arm, jumps back.",
    ),
    "All to extremes": Preset(
        {
            "noise": 0.2,
            "filtered": False,
            "edge": 0.02,
            "kp": 200.0,
            "kd": 0.0,
            "dt": 20.0,
            "latency": 600.0,
            "speed": 0.1,
        },
        "Nothing works, and no single "
        "stage cures it. Fix the stage whose broken contract is nearest to the camera, and read "
        "again.",
        "Nothing works, and no single stage cures it. The line *Fix it* names the broken contract "
        "that is nearest to the camera: begin with its stage.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "tip to target": "Distance between the arm's tip and the target now.",
    "successes [%]": "Successful runs among the seeds counted, with a 95 % confidence interval.",
    "latency of a frame": "Time from taking a camera image to its result.",
    "collision checks": "Collision checks of the planner in this run, and how many plans it made.",
    "largest stable dt": "Largest stable physics step in the posture at the end of the first plan.",
    "energy from nowhere": (
        "Rises of the energy that neither the moving reference nor a motor at its limit explains, "
        "divided by the largest energy: a sign of an unstable integrator."
    ),
    "this run": "How the run shown ends.",
    "cured alone by": "The single stage whose ideal version turns this failure into a success.",
}

MODEL = Model(
    TITLE,
    draw.Paper(TITLE, word, colour, room=30_000),
    CONTROLS,
    STATE,
    PRESETS,
    initial,
    advance,
    frame,
    drag,
    live_drag=True,
    readouts=READOUTS,
    complete=complete,
)
