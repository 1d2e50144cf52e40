"""The procedure against faults that it does not see, and each contract against its breach."""

from dataclasses import replace

import numpy as np
import pytest

from course.pipeline import STAGES, Stages, run, theory
from course.pipeline.blame import (
    CASE,
    FAULTS,
    Fault,
    blame,
    confusion,
    contracts,
    gained,
    injected,
    last_error,
    minimal,
)
from course.pipeline.stages import perceive, plan_path

SCENE, AGREED = CASE


@pytest.mark.slow
def test_without_a_fault_no_contract_is_broken_that_matters():
    records = [run(SCENE, AGREED, seed=seed) for seed in range(30)]
    assert np.mean([record.success for record in records]) > 0.9
    broken = [one for record in records for one in contracts(record, AGREED)]
    assert {one.stage for one in broken} <= {"plan"}
    assert len(broken) < 6


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_the_first_contract_that_a_fault_breaks_is_that_of_its_stage(fault):
    failed = [r for r in (injected(fault, seed)() for seed in range(8)) if not r.success]
    assert failed
    named = [broken[0].stage for r in failed if (broken := contracts(r, AGREED))]
    assert len(named) >= 0.7 * len(failed)
    assert named.count(fault.stage) >= 0.8 * len(named)


@pytest.mark.slow
def test_contracts_and_replays_name_the_stage_and_the_last_error_does_not():
    result, runs, last = confusion(3)
    right = [STAGES.index(fault.stage) for fault in FAULTS]
    hits = result[np.arange(len(FAULTS)), right].sum()
    assert result.sum() == last.sum() == 3 * len(FAULTS)
    assert hits >= 0.9 * result.sum()
    assert last[np.arange(len(FAULTS)), right].sum() < 0.6 * result.sum()
    blind, more, _ = confusion(3, FAULTS[6:], contracted=False)
    assert np.mean(more) > 1.5 * np.mean(runs[6:])
    assert blind.sum() == 3 * len(FAULTS[6:])


@pytest.mark.slow
def test_two_faults_at_once_take_a_pair():
    moved, weak = FAULTS[0], next(f for f in FAULTS if f.name == "weak motor")
    both = Fault("both", "control", weak.settings, moved.disturb)
    for seed in range(40):
        replay = injected(both, seed)
        verdict = blame(replay(), AGREED, replay)
        if not injected(weak, seed)().success:
            break
    stages, how, taken = verdict
    assert (stages, how) == (("perceive", "control"), "pair")
    assert 6 <= taken <= 15


def test_energy_shows_the_step_limit_before_the_tip_does():
    """The motors' limits hold an unstable loop in a small circle: it still succeeds."""
    limit = theory.step_limit(SCENE.arm, (0.624, 1.64), AGREED.kp, AGREED.kd)
    for share, observed in ((0.9, False), (1.3, True)):
        step = share * limit
        record = run(SCENE, replace(AGREED, physics=step, control=step), seed=1)
        assert record.success
        assert (gained(record, AGREED.kp, AGREED.kd) > 0.003) == observed


def test_a_broken_frame_or_stamp_is_the_first_thing_said():
    def elsewhere(sight, scenario, settings):
        place, covariance, _, stamp = perceive(sight, scenario, settings)
        return place, covariance, "camera", stamp

    record = run(SCENE, AGREED, Stages(perceive=elsewhere))
    assert contracts(record, AGREED)[0].stage == "perceive"
    assert "another frame" in contracts(record, AGREED)[0].what
    record = injected(FAULTS[5], 0)()
    assert contracts(record, AGREED)[0] == ("age", "a stamp from the future")


def test_a_path_is_measured_and_not_believed():
    """It ends beside what was asked for, or keeps less than it says it does."""

    def beside(start, goal, scenario, settings, rng):
        return plan_path(start, goal + (0.02, 0.0), scenario, settings, rng)

    def close(start, goal, scenario, settings, rng):
        path = plan_path(start, goal, scenario, replace(settings, margin=0.0), rng)
        return replace(path, margin=settings.margin)

    for planner, words in ((beside, "does not end"), (close, "keeps less"), (plan_path, "")):
        records = [run(SCENE, AGREED, Stages(plan=planner), seed) for seed in range(8)]
        text = [any(words in one.what for one in contracts(r, AGREED)) for r in records]
        assert sum(text) >= 4 if words else not any(text)


def test_the_smallest_scenario_that_still_fails():
    fault = next(f for f in FAULTS if f.name == "calibration moved")
    full = replace(SCENE, tilt=0.002)
    small = minimal(full, lambda scene: not injected(fault, 3, (scene, AGREED))().success)
    assert not small.discs
    assert small.velocity == (0.0, 0.0)
    assert small.tilt == 0.0
    moving = minimal(full, lambda scene: np.hypot(*scene.velocity) > 0.0)
    assert moving == replace(full, discs=(), tilt=0.0)


def test_the_last_error_is_the_arms_only_where_the_arm_is_off():
    weak = next(f for f in FAULTS if f.name == "weak motor")
    assert last_error(injected(FAULTS[0], 1)()) == "perceive"
    late = [r for s in range(20) if not (r := injected(weak, s)()).success]
    assert {last_error(r) for r in late} == {"control"}
