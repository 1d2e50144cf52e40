"""Chapter 11's simulation: what each preset says is so, and a target that is moved."""

import numpy as np
import pytest

from course import pipeline as chapter
from course.pipeline.run import tip_of
from course.simulations import pipeline as whole
from course.simulations.model import Experiment


def outcome(preset, **values):
    experiment = Experiment(whole.MODEL)
    experiment.choose(preset)
    if values:
        experiment.set(**values)
    return experiment, experiment.state["report"]


def distance(experiment):
    """From tip to target at the end, by what is drawn [m]."""
    state = experiment.state
    return float(np.hypot(*(tip_of(whole.ARM, state["q"]) - state["target"])[:, -1]))


def test_the_arrows_and_the_rate_are_those_of_the_chapter():
    experiment, report = outcome("All stages")
    scenario, settings = whole.scenario_and_settings(tuple(experiment.state["values"].tolist()))
    seed = whole.SEED
    record = chapter.run(scenario, settings, seed=seed)
    assert distance(experiment) == pytest.approx(record.distance, abs=1e-12)
    for k, stage in enumerate(chapter.STAGES):
        mended = chapter.run(scenario, chapter.repair(settings, stage), seed=seed)
        arrow = report[whole.PARTS + 2 * k : whole.PARTS + 2 * k + 2]
        assert arrow == pytest.approx(record.error - mended.error, abs=1e-12)
    # Its band holds the share of other seeds.
    others = chapter.run_many(scenario, settings, range(100, 150))
    assert report[whole.LOW] <= np.mean(chapter.successes(others)) <= report[whole.HIGH]


@pytest.mark.prove
@pytest.mark.parametrize(
    ("preset", "broken", "cure"),
    [
        ("All stages", "none", None),
        ("Noise, no filter", "its path takes longer than there is time", "perceive"),
        ("Planner step to minimum", "no path", None),
        ("Stale camera", "frames are older than was agreed", "age"),
        ("All to extremes", "it is less exact than was agreed", None),
    ],
)
def test_what_each_preset_breaks_first_and_what_cures_it(preset, broken, cure):
    _, report = outcome(preset)
    assert whole.CONTRACTS[int(report[whole.BROKEN])] == broken
    assert (report[whole.ENDED] == 0.0) == (preset == "All stages")
    assert report[whole.CURED] == (0 if cure is None else 1 + chapter.STAGES.index(cure))
    assert report[whole.SHARE] == 1.0 if preset == "All stages" else report[whole.LOW] < 0.1


@pytest.mark.prove
def test_what_the_notes_say():
    first, report = outcome("Cancelling errors")
    parts = report[whole.PARTS :].reshape(-1, 2)
    assert distance(first) < 0.5 * np.hypot(*parts[[0, 3]].T).min()
    assert distance(outcome("Cancelling errors", mended=1)[0]) > 3.0 * distance(first)
    plain, ringing = (outcome(p)[0] for p in ("All stages", "Kp high, Kd zero"))
    late = slice(300, None)  # the last second, when the reference stands
    swing = [np.ptp(e.state["q"][0, late]) for e in (plain, ringing)]
    assert swing[1] > 3.0 * swing[0]
    beyond, report = outcome("Physics step to maximum")
    assert report[whole.LIMIT] < 1e-3 * beyond.controls["dt"] and report[whole.GAINED] > 0.05
    assert outcome("Physics step to maximum", dt=5.0)[1][whole.GAINED] < 1e-3
    stiffer = outcome("Physics step to maximum", kd=16.0)[1]
    assert stiffer[whole.LIMIT] < report[whole.LIMIT]
    filtered = outcome("Noise, no filter", filtered=True)[1]
    assert filtered[whole.SHARE] > 0.8


@pytest.mark.slow
def test_a_plan_from_an_old_posture_jumps_and_a_plan_that_is_waited_for_does_not():
    """A plan moves a joint by at most its largest rate times the time between two pictures.

    The estimate, which corrects the end of a plan, adds its noise to that.
    """
    largest = chapter.Settings().rate * whole.SECONDS / whole.SHOWN
    jumps, plans = [], []
    for follows in (True, False):
        experiment, report = outcome("Plan from an old posture", follows=follows)
        jumps.append(np.abs(np.diff(experiment.state["reference"])).max())
        plans.append(report[whole.ASKED])
        values = tuple(experiment.state["values"].tolist())
        _, settings = whole.scenario_and_settings(values)
        assert settings.hysteresis is follows and settings.check_cost == pytest.approx(2e-3)
    assert min(plans) > 2
    assert jumps[0] > 10.0 * largest and jumps[1] < 2.0 * largest
    assert "tenths of a second" in whole.PRESETS["Plan from an old posture"].note
    experiment, report = outcome("Plan from an old posture")
    assert 0.1 < 2e-3 * report[whole.CHECKS] / report[whole.ASKED] < 1.0  # s a plan
    # The other presets have the chapter's defaults.
    _, settings = whole.scenario_and_settings(tuple(outcome("All stages")[0].state["values"]))
    assert settings.hysteresis is False
    assert settings.check_cost == pytest.approx(chapter.Settings().check_cost)


def test_a_target_that_is_moved_changes_nothing_that_was():
    experiment, _ = outcome("All stages")
    before = experiment.state["q"].copy()
    experiment.advance(0.5)
    experiment.drag(2.5, 3.7)
    state, now = experiment.state, 120
    assert np.array_equal(state["q"][:, : now + 1], before[:, : now + 1])
    assert not np.allclose(state["q"][:, -1], before[:, -1])
    assert np.ptp(state["target"][:, now:], axis=1) == pytest.approx([0.0, 0.0], abs=1e-12)
    jump = np.hypot(*(state["target"][:, now] - state["target"][:, now - 1]))
    assert distance(experiment) < 0.5 * jump  # the filter believes in slow targets
    experiment.advance(whole.SECONDS + whole.PAUSE)
    assert np.array_equal(state["q"], before)


@pytest.mark.parametrize("place", [(0.0, 0.0), (-9.0, 9.0), (9.0, 0.5)])
def test_any_place_of_the_pointer_is_one_that_the_arm_reaches(place):
    experiment, _ = outcome("All stages")
    experiment.advance(1.0)
    experiment.drag(*place)
    target = experiment.state["target"][:, -1]
    assert np.isfinite(experiment.state["q"]).all()
    assert whole.NEAREST - 1e-9 <= np.hypot(*target) <= whole.FARTHEST + 0.2
    assert all(np.hypot(*(target - disc[:2])) > disc[2] for disc in np.array(whole.DISCS))


def test_a_target_anywhere_is_within_reach_and_free_of_the_discs():
    everywhere = np.random.default_rng(0).uniform(-2.0, 2.0, (2000, 2))
    # Near a disc, on its left side too, and its centre itself.
    around = [
        np.array((u, v)) + 0.1 * np.array(d)
        for u, v, _ in whole.DISCS
        for d in ((-1, 0), (0, -1), (0, 0))
    ]
    for x, y in [*everywhere, *around]:
        target = np.array(whole._reachable(x, y))
        assert whole.NEAREST - 1e-9 <= np.hypot(*target) <= whole.FARTHEST + 1e-9
        for u, v, size in whole.DISCS:
            assert np.hypot(*(target - (u, v))) >= size + whole.ROOM - 1e-9


@pytest.mark.slow
def test_presets_between_the_extremes_show_what_their_notes_say():
    ringing, undamped = outcome("Kp high, Kd zero")
    quiet, damped = outcome("More damping")
    shakes = [
        np.ptp((each.state["q"] - each.state["reference"])[:, -100:], axis=1).max()
        for each in (ringing, quiet)
    ]
    assert shakes[1] < shakes[0] / 3.0
    assert damped[whole.SHARE] == 1.0 > undamped[whole.SHARE]
    assert damped[whole.LIMIT] / undamped[whole.LIMIT] == pytest.approx(1.0 / 6.0, abs=0.02)
    _, report = outcome("Physics step above its limit")
    assert 0.012 / report[whole.LIMIT] == pytest.approx(1.2, abs=0.03)
    assert 0.01 < report[whole.GAINED] < 0.1
    assert whole.REASONS[int(report[whole.ENDED])] == "success"
    experiment, report = outcome("Half the latency")
    assert report[whole.SHARE] == 0.0 == outcome("Stale camera")[1][whole.SHARE]
    scenario, _ = whole.scenario_and_settings(tuple(experiment.state["values"].tolist()))
    assert 0.015 < report[whole.AGE] * np.hypot(*scenario.velocity) < 0.02


def test_portions_add_up_to_what_is_computed_at_once():
    whole_run, slow = Experiment(whole.MODEL), Experiment(whole.MODEL)
    whole.count.cache_clear()
    slow.in_portions = True
    for run in (slow, whole_run):
        run.set(kp=60.0, noise=0.02)
        if run is slow:
            # The run that is drawn is there at once, its successes and repairs are still to come.
            early = run.state["report"].copy()
            assert early[whole.LEFT] == whole.COUNTED + len(whole.blame.REPLAYED)
            assert run.remaining == early[whole.LEFT]
            assert early[whole.HIGH] == 0.0 < early[whole.LIMIT]
            drawn = run.state["q"].copy()
            portions = 1
            while run.complete():
                portions += 1
            assert portions > 8
    assert slow.state.tobytes() == whole_run.state.tobytes()
    assert np.array_equal(drawn, whole_run.state["q"])
    assert whole_run.state["report"][whole.LEFT] == 0.0 < whole_run.state["report"][whole.HIGH]


def test_the_first_portion_of_a_run_that_plans_much_is_its_beginning():
    """A slider is answered after a few plans; the rest comes between other messages."""
    whole.count.cache_clear()
    slow = Experiment(whole.MODEL)
    slow.in_portions = True
    slow.choose("All to extremes")
    state, report = slow.state, slow.state["report"]
    scenario, settings = whole.scenario_and_settings(tuple(state["values"].tolist()))
    record = chapter.run(scenario, settings, seed=whole.SEED)
    checks = np.cumsum([crossing.value.checks for crossing in record.plans])
    # The first portion ends within a slice after the limit, far from the run's end.
    assert whole.CHECKED < report[whole.CHECKS] < 0.1 * checks[-1]
    assert report[whole.CHECKS] == checks[int(report[whole.ASKED]) - 1]
    assert report[whole.ENDED] == whole.UNDER_WAY and report[whole.LEFT] > 0.0
    rows = np.arange(whole.SHOWN + 1) * (len(record.log) - 1) // whole.SHOWN
    angles = record.log[rows, whole.drive.Q : whole.drive.V].T
    begun = np.flatnonzero((state["q"] == angles).all(axis=0))
    assert begun.size > 1 and np.array_equal(begun, np.arange(begun.size)), "it is its beginning"
    portions, counts = 0, [report[whole.CHECKS]]
    while slow.complete():
        portions += 1
        counts.append(report[whole.CHECKS])
    assert portions > 20 and max(np.diff(counts)) < 0.1 * checks[-1]
    # In slices it is the run that it is in one go.
    assert np.array_equal(state["q"], angles)
    assert (report[whole.CHECKS], report[whole.ASKED]) == (checks[-1], len(record.plans))
    assert whole.REASONS[int(report[whole.ENDED])] == record.reason.split(":")[0]
    others = chapter.run_many(scenario, settings, range(whole.FEWER))
    assert report[whole.SHARE] == np.mean(chapter.successes(others))


def test_a_target_that_is_moved_between_portions_stays_moved():
    whole.count.cache_clear()
    slow = Experiment(whole.MODEL)
    slow.in_portions = True
    slow.set(kp=70.0)
    slow.drag(2.5, 3.7)
    moved = slow.state["q"].copy()
    assert slow.remaining > 0, "a drag does not wait for the report"
    while slow.complete():
        pass
    assert np.array_equal(slow.state["q"], moved)
