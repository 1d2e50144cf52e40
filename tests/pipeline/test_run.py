"""A run: its parts against the chapters they come from, its clock, and what it refuses."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.control import Actuator, computed_torque, pd_gravity
from course.kinematics import TwoLink
from course.middleware import run_chain
from course.perception.track import Tracker, follow
from course.pipeline import theory
from course.pipeline.drive import GAP, REFERENCE, SENT, TORQUE, USED, Q, V
from course.pipeline.run import Run, errors, run, run_many, successes, tip_of
from course.pipeline.scenario import OVERRUNS, STAGES, Scenario, Settings, repair
from course.pipeline.stages import Stages, control, frames, move, perceive, plan_path
from course.planning import check_path, clearance, time_parameterise
from course.planning.trajectory import state_at
from course.role import Stage, age, simulate
from tests.budget import examples

SHORT = Scenario(seconds=0.6)
QUIET = Settings(noise=0.0, bias=(0.0, 0.0))
angles = st.floats(-3.0, 3.0)
pairs = st.tuples(angles, angles).map(np.array)


# --- parts, against the chapters that they come from ----------------------------------------------


@given(st.integers(0, 2**32 - 1))
@examples(20)
def test_the_compiled_track_is_the_tracker(seed):
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(2, 2))
    R = noise @ noise.T + 0.01 * np.eye(2)
    both = np.eye(3)
    both[:2, :2] = R
    whole = Tracker((0.3, 1.0), (0.2, 1.0), gate=math.inf)
    x, P, last = np.zeros(4), np.zeros((4, 4)), 0.0
    for k, stamp in enumerate(np.cumsum(rng.uniform(0.0, 0.3, 12))):
        z = rng.normal(size=2)
        whole.update(stamp, np.append(z, 0.0), both)
        if k == 0:
            x[:2], P[:2, :2], P[2:, 2:] = z, R, 0.2**2 * np.eye(2)
        else:
            follow(x, P, stamp - last, z, R, 0.3)
        last = stamp
    retained = np.ix_([0, 1, 3, 4], [0, 1, 3, 4])
    np.testing.assert_allclose(x, whole.state[[0, 1, 3, 4]], atol=1e-12)
    np.testing.assert_allclose(P, whole.covariance[retained], atol=1e-12)


@given(st.integers(0, 2**32 - 1))
@examples(20)
def test_the_compiled_reader_is_the_trajectory(seed):
    rng = np.random.default_rng(seed)
    motion = time_parameterise(rng.uniform(-2.0, 2.0, (2, 4)), (1.5, 4.0), blend=0.1)
    out, i = np.zeros((3, 2)), 0
    for t in np.sort(rng.uniform(-0.2, motion.duration + 0.2, 40)):
        i, share = state_at(motion.table, t, i, out)
        np.testing.assert_allclose(out, motion(t), atol=1e-12)
        assert 0.0 <= share <= 1.0 + 1e-12
    assert share == pytest.approx(1.0) if t > motion.duration else True


@given(pairs, pairs, pairs, pairs, pairs)
@examples(30)
def test_laws_and_steps_are_those_of_the_chapters(q, v, a, rate, tau):
    scenario, settings = Scenario(tilt=0.05), Settings()
    expected = np.stack((a, rate, tau))
    mine = control(q, v, expected, scenario, settings)
    given_by = pd_gravity(scenario.arm, q, v, a, np.zeros(2), settings.kp, settings.kd)
    np.testing.assert_allclose(mine, given_by, atol=1e-9)
    mine = control(q, v, expected, scenario, replace(settings, law="computed_torque"))
    given_by = computed_torque(scenario.arm, q, v, a, rate, tau, settings.kp, settings.kd)
    np.testing.assert_allclose(mine, given_by, atol=1e-9)
    place, speed = move(q, v, tau, 1e-3, scenario)
    plant = scenario.plant
    forces = np.linalg.solve(plant.mass_matrix(q), tau - plant.bias(q, v))
    np.testing.assert_allclose(speed, v + 1e-3 * forces, atol=1e-10)
    np.testing.assert_allclose(place, q + 1e-3 * speed, atol=1e-12)


def test_what_it_plans_is_a_path_that_the_judge_passes():
    scenario, settings = Scenario(), Settings()
    for seed in range(10):
        goal = scenario.at(0.0) + np.random.default_rng(seed).normal(0.0, 0.03, 2)
        rng = np.random.default_rng(seed)
        path = plan_path(np.array(scenario.start), goal, scenario, settings, rng)
        assert path.motion is not None and path.checks > 0
        np.testing.assert_allclose(tip_of(scenario.arm, path.goal), goal, atol=1e-12)
        wide = scenario.world(path.margin)
        assert check_path(wide, path.waypoints, scenario.start, path.goal)
        assert check_path(wide, path.motion.waypoints(0.05))


# --- one source, compiled and plain ---------------------------------------------------------------


@pytest.mark.parametrize("names", [("perceive",), ("control",), ("move",), STAGES[:1] + STAGES[3:]])
@pytest.mark.parametrize("law", ["pd", "computed_torque"])
def test_the_same_source_runs_compiled_and_plain(names, law):
    functions = {"perceive": perceive, "control": control, "move": move}
    # Another function with the same answer is a learner's: the driver then runs as plain Python.
    theirs: dict[str, Any] = {name: lambda *given, f=functions[name]: f(*given) for name in names}
    tilted = replace(SHORT, tilt=0.02)
    settings = Settings(law=law, carried=True, actuator=Actuator(lag=0.01, delay=0.004))
    one, other = run(tilted, settings, seed=3), run(tilted, settings, Stages(**theirs), 3)
    np.testing.assert_allclose(one.log, other.log, atol=1e-10)
    np.testing.assert_allclose(one.sightings, other.sightings, atol=1e-12)
    assert [p.arrived for p in one.plans] == [p.arrived for p in other.plans]


def test_a_seed_gives_one_record_and_a_stop_on_the_way_changes_nothing():
    settings = Settings(lost=0.1)
    one, again, other = (run(SHORT, settings, seed=seed) for seed in (5, 5, 6))
    assert np.array_equal(one.log, again.log) and np.array_equal(one.sightings, again.sightings)
    assert not np.array_equal(one.log, other.log)
    halting = Run(SHORT, settings, seed=5)
    for when in (0.1234567, 0.2, 0.35, 0.6):
        assert halting.to(when)
    assert np.array_equal(halting.record().log, one.log)
    calm = run(SHORT, repair(settings, "perceive", "control"), seed=5)
    assert np.array_equal(calm.timetable.draws, one.timetable.draws)
    assert np.array_equal(calm.timetable.captured, one.timetable.captured)


# --- the clock ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "frame, latency, overrun",
    [
        (0.02, 0.007, "drop"),
        (0.02, 0.1, "pipelined"),
        (0.03, 0.1, "drop"),
        (0.1, 0.033, "queue"),
    ],
)
def test_ages_are_those_of_chapter_0_and_of_chapter_10s_bus(frame, latency, overrun):
    rule = {"drop": "skip", "queue": ""}.get(overrun, overrun)
    chain = [Stage("camera", latency, frame, overload=rule)]
    trace, bus = simulate(chain, [0.0], seconds=4.0), run_chain(chain, [0.0], seconds=4.0)
    table = frames(Settings(frame=frame, latency=latency, overrun=overrun), 4.0, 0)
    n = table.captured.size
    np.testing.assert_allclose(1e-6 * table.captured, trace.captured[:n], atol=1e-6)
    np.testing.assert_allclose(1e-6 * table.arrived, trace.published[:n], atol=1e-6)
    arrived = bus.published.size
    np.testing.assert_allclose(1e-6 * table.arrived[:arrived], bus.published[:n], atol=1e-6)
    record = run(Scenario(), replace(QUIET, frame=frame, latency=latency, overrun=overrun))
    ages = estimate_ages(record)
    held = bus.age(record.times[250:-1] + 1e-6)  # nothing arrives in the last instant
    np.testing.assert_allclose(ages[:-1], held, atol=1e-5)
    bounds, slack = age(chain), 2.1e-6
    assert bounds.least - slack <= ages.min() and ages.max() <= bounds.greatest + slack
    assert ages.mean() == pytest.approx(bounds.mean, abs=0.1 * frame)


def estimate_ages(record):
    """Of the estimate in force at the ticks after the first half second [s]."""
    arrived = np.array([e.arrived for e in record.estimates])
    captured = np.array([e.captured for e in record.estimates])
    ticks = np.round(1e6 * record.times[250:]).astype(int)
    return 1e-6 * (ticks - captured[np.searchsorted(arrived, ticks, side="right") - 1])


def test_what_an_overrun_does():
    """Latency C and period T: a queue grows by C - T a frame, a camera that waits has period C."""
    settings = Settings(frame=0.02, latency=0.05)
    queue, block, drop = (
        frames(replace(settings, overrun=rule), 2.0, 0) for rule in ("queue", "block", "drop")
    )
    k = np.arange(queue.captured.size)
    assert np.array_equal(queue.arrived - queue.captured, 50_000 + 30_000 * k)
    assert set(np.diff(block.captured)) == {50_000} and block.captured.max() < 2_000_000
    assert set(np.diff(drop.captured)) == {60_000}
    assert np.array_equal(drop.draws, queue.draws[::3])  # noise goes with the frame's number


def test_a_plan_arrives_after_its_checks_and_is_timed_by_count():
    settings = replace(QUIET, check_cost=1e-3)
    record = run(Scenario(), settings)
    plan, requested = record.plans[0], record.plan_requests[0]
    assert requested == 100_000 and plan.captured == 0
    assert plan.arrived - requested == 1000 * plan.value.checks
    waits = round(plan.arrived / record.step)
    assert np.all(record.log[:waits, REFERENCE:SENT] == record.scenario.start)
    assert run(Scenario(), repair(settings, "plan")).plans[0].arrived == requested


def test_a_path_comes_into_force_without_a_jump():
    """The goal has moved since by as much as the filter learnt; the path takes it up on its way."""
    record = run(Scenario(), Settings(check_cost=2e-3), seed=1)
    begins = round(record.plans[-1].arrived / record.step)
    reference = record.log[begins - 1 : begins + 25, REFERENCE:SENT]
    assert np.abs(np.diff(reference, axis=0)).max() < 0.01
    assert np.abs(reference[-1] - reference[0]).max() > 1e-3


@pytest.mark.parametrize("follows", [False, True])
def test_while_a_plan_is_made_the_arm_waits_or_follows_the_old_one(follows: bool):
    """Either way the new path begins where the reference was when the plan was requested."""
    settings = Settings(noise=0.1, filtered=False, check_cost=2e-3, replan=0.3, hysteresis=follows)
    away = []
    for seed in range(3):
        record = run(Scenario(), settings, seed=seed)
        for requested, plan in list(zip(record.plan_requests, record.plans, strict=False))[1:]:
            if plan.value.motion is None or 1e-6 * plan.arrived >= record.scenario.seconds:
                continue
            first, last = (round(t / record.step) for t in (requested, plan.arrived))
            begin = plan.value.motion.table[0, 4:6]
            from_begin = np.abs(record.log[first - 1 : last + 1, REFERENCE:SENT] - begin)
            assert from_begin[0].max() < 1e-9 and from_begin[-1].max() < 1e-6
            away.append(from_begin[1:-1].max())
    assert len(away) > 5
    # On the old path it is somewhere else by then, so the new one brings it back with a jump.
    assert np.median(away) > 0.05 if follows else np.max(away) < 1e-9


# --- what a run must be ---------------------------------------------------------------------------


def test_an_ideal_pipeline_is_exact_and_each_part_is_what_theory_says():
    """Nothing left: no error. Age alone: age times speed. Control alone: the lag of theory."""
    scenario, everything = Scenario(), set(STAGES)
    speed = np.array(scenario.velocity)
    exact = run(scenario, repair(Settings(), *everything))
    assert exact.success and exact.distance < 1e-9
    old = run(scenario, repair(Settings(), *everything - {"age"}))
    newest = [e.captured for e in old.estimates][-1]
    np.testing.assert_allclose(old.error, -speed * (4.0 - 1e-6 * newest), atol=1e-6)
    late = run(scenario, repair(Settings(), *everything - {"control"}))
    settings = late.settings
    lag = theory.lag(scenario.arm, late.log[-1, Q:V], settings.kp, settings.kd, speed)
    np.testing.assert_allclose(late.error, lag, atol=0.05 * float(np.linalg.norm(lag)))
    biased = run(
        scenario, replace(repair(Settings(), *STAGES[1:]), noise=0.0, bias=(0.004, -0.003))
    )
    np.testing.assert_allclose(biased.error, (0.004, -0.003), atol=1e-7)


@pytest.mark.prove
def test_a_filter_is_worth_it_and_a_raw_estimate_plans_again_and_again():
    with_it = run_many(Scenario(), Settings(), range(30))
    raw = run_many(Scenario(), Settings(filtered=False), range(5))
    assert successes(with_it).mean() > 0.85 > 0.2 > successes(raw).mean()
    assert np.median([len(r.plans) for r in with_it]) == 1
    assert np.median([len(r.plans) for r in raw]) > 40
    assert errors(with_it).shape == (2, 30)
    away = np.linalg.norm(errors(with_it), axis=0)
    for record, d in zip(with_it, away, strict=True):
        assert record.clearance <= 0.0 or (record.reason == "beside the target") == (d > 0.02)


def test_the_log_keeps_what_it_says():
    arm, drive = TwoLink(torques=(0.8, 0.4)), Actuator(rate=20.0, delay=0.007)
    record = run(Scenario(arm=arm), Settings(actuator=drive, control=0.006), seed=1)
    log = record.log
    assert np.all(np.abs(log[:, SENT:TORQUE]) <= (0.8, 0.4))
    assert np.abs(np.diff(log[:, SENT:TORQUE], axis=0)).max() <= 20.0 * 0.006 + 1e-12
    # 7 ms are four steps of 2 ms; a command is held for three.
    np.testing.assert_allclose(log[4:-1, TORQUE:GAP], log[:-5, SENT:TORQUE], rtol=0, atol=1e-14)
    steps = np.abs(np.diff(log[:-1, SENT:TORQUE], axis=0)).max(axis=1)
    changes = np.flatnonzero(steps > 1e-14) + 1
    assert np.all(changes % 3 == 0)
    world = record.scenario.world()
    for k in (0, 700, 1400, 2000):
        assert log[k, GAP] == pytest.approx(clearance(world, log[k, Q:V]), abs=1e-12)
    assert record.clearance == log[:, GAP].min()
    smooth = run(Scenario(), Settings(actuator=Actuator(lag=0.02)), seed=1).log
    retained = math.exp(-0.002 / 0.02)
    np.testing.assert_allclose(
        smooth[1:-1, TORQUE:GAP],
        retained * smooth[:-2, TORQUE:GAP] + (1.0 - retained) * smooth[1:-1, SENT:TORQUE],
        atol=1e-12,
    )
    held = run(Scenario(), repair(Settings(), "control")).log
    assert np.array_equal(held[1:, Q:V], held[1:, REFERENCE:SENT])


def test_disturbances_are_undone_where_a_stage_is_ideal():
    def shaken(table):
        table = replace(table, shift=table.shift + 0.05, scale=5.0 * table.scale)
        return replace(table, arrived=table.arrived + 200_000).where(table.captured % 3 == 0)

    calm, bad = run(SHORT, QUIET), run(SHORT, QUIET, disturb=shaken)
    assert bad.timetable.captured.size < calm.timetable.captured.size
    assert np.abs(bad.pictures[0].value - calm.pictures[0].value).min() > 0.04
    mended = repair(QUIET, "perceive", "age")
    one, other = run(SHORT, mended), run(SHORT, mended, disturb=shaken)
    assert np.array_equal(one.log, other.log)

    def overtaken(table):
        few = table.where(table.captured <= 300_000)
        return replace(few, arrived=450_000 - few.captured // 2)

    # The last picture arrives first: all others are older than what is known.
    used = run(SHORT, QUIET, disturb=overtaken).sightings[:, USED]
    assert (used == 1.0).sum() == 1 and (used == -1.0).sum() == 15


# --- bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "make, name",
    [
        (lambda: Scenario(target=(1.2, 0.0)), "target"),
        (lambda: Scenario(velocity=(0.3, 0.0)), "target"),
        (lambda: Scenario(target=(0.62, 0.36)), "target"),
        (lambda: Scenario(start=(0.5, 0.0)), "start"),
        (lambda: Scenario(start=(math.nan, 0.0)), "start"),
        (lambda: Scenario(seconds=-1.0), "seconds"),
        (lambda: Scenario(arm=TwoLink(gravity=9.81)), "gravity"),
        (lambda: Settings(control=0.001, physics=0.002), "control"),
        (lambda: Settings(noise=-0.1), "noise"),
        (lambda: Settings(physics=0.0), "physics"),
        (lambda: Settings(law="pid"), "law"),
        (lambda: Settings(overrun="panic"), "overrun"),
        (lambda: repair(Settings(), "luck"), "stage"),
        (lambda: run(SHORT, Settings(latency=0.6)), "latency"),
        *(
            (lambda rule=rule: run(SHORT, Settings(phase=10.0, overrun=rule)), "phase")
            for rule in OVERRUNS
        ),
        # Half way the target crosses a disc, and the ring about the base that the tip can't reach.
        (lambda: crossing((0.50, 0.36), (0.06, 0.0)), "target at 2 s"),
        (
            lambda: crossing((0.30, 0.02), (-0.15, 0.0), TwoLink(lengths=(0.5, 0.2))),
            "target at 2 s",
        ),
        (lambda: run(SHORT, Settings(), seed=-1), "seed"),
    ],
)
def test_bad_input_is_refused(make, name):
    with pytest.raises(ValueError, match=name):
        make()


def crossing(target, velocity, arm=None):
    """Return a scenario whose target is in a good place at the start and at the end."""
    scenario = Scenario(arm or TwoLink(), target=target, velocity=velocity)
    assert scenario


@pytest.mark.parametrize(
    "stage, answer, words",
    [
        ("control", lambda *_: 1.0, "what control returns .* shape"),
        ("control", lambda *_: np.zeros(3), "what control returns .* shape"),
        ("control", lambda *_: None, r"what control returns must be .*, got None"),
        ("plan", lambda *_: None, r"what plan returns must be .*, got None"),
        ("plan", lambda *_: np.zeros((2, 5)), "what plan returns"),
        ("perceive", lambda *_: None, r"what perceive returns must be .*, got None"),
        ("perceive", lambda *_: (np.zeros(3), np.eye(2), "base", 0), "the place"),
        ("perceive", lambda *_: (np.zeros(2), None, "base", 0), "the covariance"),
        ("perceive", lambda *_: (np.zeros(2), np.eye(2), "base", None), "stamp"),
        (
            "perceive",
            lambda *_: (np.zeros(2), np.array([[1, 0.5], [0, 1]]), "base", 0),
            "covariance that perceive returns",
        ),
        ("move", lambda *_: None, r"what move returns must be .*, got None"),
        ("move", lambda q, v, *_: (q, 0.0), "what move returns .* rates"),
    ],
)
def test_a_stage_that_returns_another_shape_is_named(stage, answer, words):
    with pytest.raises(ValueError, match=words):
        run(SHORT, Settings(), Stages(**{stage: answer}))


def seeing(**changed):
    """A `perceive` of which something is wrong after the tenth frame."""

    def stage(sight, scenario, settings):
        answer = dict(
            zip(
                ("place", "spread", "frame", "stamp"),
                perceive(sight, scenario, settings),
                strict=True,
            )
        )
        if sight.number >= 10:
            answer |= {k: f(sight) if callable(f) else f for k, f in changed.items()}
        return tuple(answer.values())

    return Stages(perceive=stage)


def from_elsewhere(start, goal, scenario, settings, rng):
    return plan_path(start + 0.01, goal, scenario, settings, rng)


def late_nan(q, v, desired, scenario, settings):
    return np.full(2, np.nan) if abs(desired[1]).max() > 0 else np.zeros(2)


@pytest.mark.parametrize(
    "stages, reason",
    [
        (seeing(place=np.full(2, np.nan)), "perceive: a place that is not finite"),
        (seeing(spread=-np.eye(2)), "perceive: a covariance that is not positive"),
        (seeing(spread=np.ones((2, 2))), "perceive: a covariance that is not positive"),
        (seeing(frame="camera"), "perceive: another frame"),
        (seeing(stamp=lambda s: s.captured + 200_000), "perceive: a stamp from the future"),
        (Stages(plan=from_elsewhere), "plan: a path that does not begin where the arm should be"),
        (Stages(control=late_nan), "control: a torque that is not finite"),
        (Stages(move=lambda q, v, tau, dt, s: (q + 1e3, v)), "move: the arm diverged"),
    ],
)
def test_a_stage_that_breaks_its_word_ends_the_run_and_is_named(stages, reason):
    record = run(SHORT, Settings(), stages)
    assert record.reason == reason and not record.success
    assert math.isnan(record.distance) and record.time == math.inf
    assert len(record.log) < 301


def test_nothing_seen_is_no_measurement():
    """An infinite covariance is a picture in which nothing was found: the estimate stays."""
    blind = run(SHORT, Settings(), seeing(spread=np.diag([np.inf, np.inf])))
    assert len(blind.estimates) == 10 and len(blind.pictures) > 20 and not blind.reason.count(":")
