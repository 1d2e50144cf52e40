"""The diagnosis with sixty failing runs a fault, and a rare failure of the pipeline itself."""

from dataclasses import replace

import numpy as np
import pytest

from course.measure.success import wilson
from course.pipeline import STAGES, Scenario, Settings, run
from course.pipeline.blame import CASE, FAULTS, Fault, confusion, injected
from course.pipeline.rare import cross_entropy, plain

RIGHT = [STAGES.index(fault.stage) for fault in FAULTS]


@pytest.fixture(scope="module")
def diagnosed():
    return {contracted: confusion(60, contracted=contracted) for contracted in (True, False)}


def test_contracts_then_repairs_name_nearly_all_and_need_fewer_replays(diagnosed):
    hits, rows = {}, np.arange(len(FAULTS))
    for contracted, (result, _, last) in diagnosed.items():
        assert np.all(result.sum(axis=1) == 60)
        hits[contracted] = wilson(int(result[rows, RIGHT].sum()), int(result.sum()))
        hits["last"] = wilson(int(last[rows, RIGHT].sum()), int(last.sum()))
    assert hits[True][0] > 0.95
    assert hits["last"][1] < hits[False][0] and hits[False][1] < hits[True][1]
    assert np.mean(diagnosed[False][1]) > 1.7 * np.mean(diagnosed[True][1])


def test_with_a_fault_in_a_tenth_of_the_runs_it_works_nine_times_in_ten():
    rng, answer = np.random.default_rng(0), 0
    for seed in range(400):
        fault = FAULTS[rng.integers(len(FAULTS))] if rng.random() < 0.1 else Fault("none", "move")
        answer += injected(fault, seed)().success
    low, high = wilson(answer, 400)
    assert low < 0.9 < high or low < 0.92 < high


def test_a_stale_camera_and_a_moving_target_take_two_repairs():
    case = (replace(CASE[0], velocity=(-0.04, 0.03)), replace(CASE[1], kd=12.0))
    late = Fault("late", "age", disturb=lambda f, s: replace(f, arrived=f.arrived + 500_000))
    result, _, _ = confusion(40, (late,), case)
    assert wilson(int(result[0, len(STAGES)]), 40)[0] > 0.7


def test_a_rare_failure_of_the_arm_is_found_with_fewer_runs():
    """Six disturbances: bias and speed of the target, latency, tilt."""
    scene, report = Scenario(discs=()), Settings(noise=0.01)

    def severity(x):
        bad = np.empty(x.shape[1])
        for i, d in enumerate(x.T):
            velocity = (-0.008 + 0.006 * d[4], 0.006 + 0.006 * d[5])
            case = replace(scene, tilt=0.01 * d[3], velocity=velocity)
            bias = (-0.003 + 0.004 * d[0], 0.002 + 0.004 * d[1])
            settings = replace(report, bias=bias, latency=0.1 * float(np.exp(0.4 * d[2])))
            bad[i] = run(case, settings).distance - scene.tolerance
        return bad

    result = [
        cross_entropy(severity, 6, np.random.default_rng(k), each=100, last=400, least=1.0)
        for k in range(5)
    ]
    shares = np.array([one.share for one in result])
    observed = plain(severity, 6, 12_000, np.random.default_rng(9))
    assert abs(shares.mean() - observed.share) < 4.0 * np.hypot(shares.std() / 2.0, observed.error)
    runs_plain = shares.mean() / shares.var(ddof=1)
    assert runs_plain > 3.0 * result[0].runs
