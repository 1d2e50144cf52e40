"""Our fit beside `mujoco.sysid` on the same log: the same answer, and where MuJoCo's clock is."""

import numpy as np
import pytest

from course.charts.sim_to_real.logs import FREE, GUESS, TRUTH, plants, record
from course.oracles.mujoco import sysid
from course.sim_to_real.identify import Log, arm, fit

TRUE = np.array(list(TRUTH.values()))


def test_the_adapter_finds_the_truth_without_noise():
    assert sysid.prepared(plants.ARM, record(noise=0.0), GUESS)().value == pytest.approx(
        TRUE, rel=1e-6
    )


@pytest.mark.prove
def test_both_give_the_same_answer_and_the_same_interval():
    for seed in range(2):
        log = record(seed=seed)
        ours, theirs = fit(arm, log, GUESS, FREE), sysid.prepared(plants.ARM, log, GUESS)()
        deviation = np.sqrt(np.diag(ours.covariance))
        # A thousandth of what noise does to both.
        assert (np.abs(ours.value - theirs.value) < 1e-3 * deviation).all()
        assert theirs.half_width == pytest.approx(ours.half_width(), rel=2e-3)
        assert theirs.residual == pytest.approx(ours.noise, rel=3e-3)


@pytest.mark.slow
def test_sensordata_is_one_step_late_and_shifting_the_log_mends_it():
    log = record()
    deviation = np.sqrt(np.diag(fit(arm, log, GUESS, FREE).covariance))
    wrong = sysid.prepared(plants.ARM, log, GUESS, observe="sensor")()
    assert (np.abs(wrong.value - TRUE) / deviation).max() > 30.0
    # What MuJoCo calls the reading at a time is that of the step before.
    shifted = np.column_stack([log.measured[:, 0], log.measured[:, :-1]])
    late = Log(log.times, shifted, log.command)
    right = sysid.prepared(plants.ARM, late, GUESS, observe="sensor")()
    assert (np.abs(right.value - TRUE) / deviation).max() < 4.0


def test_an_empty_module_says_what_to_install(monkeypatch):
    monkeypatch.delattr(sysid.toolbox(), "optimize")
    with pytest.raises(ImportError, match=r"'absl-py.*colorama.*tabulate"):
        sysid.toolbox()


def test_bad_input_is_named():
    with pytest.raises(ValueError, match=r"^observe must be .*, got 'camera'"):
        sysid.prepared(plants.ARM, record(), GUESS, observe="camera")
