"""The statistics of the fit over 400 logs."""

from tests.sim_to_real import test_identify as short


def test_spread_bias_and_coverage_over_400_logs(monkeypatch):
    monkeypatch.setattr(short, "RUNS", 400)
    short.runs.cache_clear()
    short.test_the_spread_is_the_least_possible_and_the_intervals_hold()
    short.runs.cache_clear()
