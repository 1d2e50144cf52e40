"""The graph of the stack beside the chapter's own functions; what development costs."""

import numpy as np
import pytest

from course.role import BOXES, CHAIN, Stage, age, simulate
from course.simulations.model import Experiment
from course.simulations.role import MODEL, development, stack


def stages(controls):
    """The chain that the controls describe."""
    see = Stage(
        "see", controls["seeing"] / 1000, 1 / 30, 1, "pipelined" if controls["parallel"] else "skip"
    )
    arrival, depth = controls["trigger"] == 1, int(controls["depth"])
    plan = Stage(
        "plan",
        stack.PLAN,
        None if arrival else 1 / controls["rate"],
        depth,
        "queue" if arrival else "skip",
    )
    return see, plan, Stage("loop", stack.LOOP, 1 / controls["loop"])


def settings():
    yield from (dict(preset.values) for preset in MODEL.presets.values())
    rng = np.random.default_rng(4)
    for _ in range(12):
        yield {
            "seeing": float(rng.integers(1, 25) * 5),
            "parallel": bool(rng.integers(2)),
            "rate": float(rng.integers(2, 33) / 2),
            "depth": int(rng.integers(1, 11)),
            "trigger": int(rng.integers(2)),
            "loop": float(rng.integers(1, 21) * 50),
        }


@pytest.mark.parametrize("values", list(settings()))
def test_its_lines_are_those_of_the_closed_form(values):
    run = Experiment(MODEL, **values)
    report = age(stages(run.controls))
    least, mean, greatest, *_ = stack.predicted(run.controls)
    assert (least, mean, greatest) == pytest.approx((report.least, report.mean, report.greatest))
    ages = np.flatnonzero(run.state["ages"]) * 1.15 * greatest / run.state["ages"].size
    assert ages[0] >= least - 0.03 * greatest and ages[-1] <= greatest
    if not values.get("locked") and run.controls["rate"] >= 4.0 and report.waits[0] > 0:
        assert run.state["mean"] == pytest.approx(mean, rel=0.06)
    assert run.state["ages"].sum() == pytest.approx(1.0)


@pytest.mark.parametrize(
    "values", [{}, {"parallel": False, "seeing": 80.0}, {"depth": 4}, {"trigger": 1, "depth": 3}]
)
def test_its_run_is_that_of_the_chapters_simulation(values):
    run = Experiment(MODEL, **values, locked=True, phase=0.35, loop=500.0)
    other = simulate(stages(run.controls), [0.4, 0.35, 0.0], seconds=stack.SPAN)
    times = np.linspace(10.0, 38.0, 501) + 1e-4
    mine = times - stack.commands(run.controls, run.state, times)
    assert np.mean(np.abs(mine - other.age(times)) < 1e-9) > 0.99  # a tick may meet a result


def test_a_click_and_the_keys_choose_each_box():
    run = Experiment(MODEL)
    for k, (x, y) in enumerate(stack._AT):
        run.drag(x + 0.1, y - 0.1)
        assert run.controls["box"] == k
    visited = set()
    for _ in BOXES:
        run.press("ArrowRight")
        visited.add(int(run.controls["box"]))
    assert visited == set(range(len(BOXES)))


def test_the_pulse_gets_older_by_the_time_that_passes():
    run = Experiment(MODEL)
    ages = []
    for _ in range(30):
        run.advance(0.05)  # 5 ms of the stack
        now = run.state["time"]
        ages.append(now - stack.commands(run.controls, run.state, np.array([now]))[0])
    steps = np.diff(ages)
    assert np.median(steps) == pytest.approx(0.005, abs=1e-9) and steps.min() < 0
    assert age(CHAIN).least <= min(ages) and max(ages) <= age(CHAIN).greatest


def test_faster_loops_have_wider_edges_and_rates_follow_the_sliders():
    slow, fast = Experiment(MODEL, loop=50.0, box=5), Experiment(MODEL, loop=1000.0, box=5)
    rates = [
        [stack._rate(k, run.controls, 1 / 30, 0.1) for k in range(len(stack._FROM))]
        for run in (slow, fast)
    ]
    assert sum(a != b for a, b in zip(*rates, strict=True)) == 4
    assert stack._rate(4, slow.controls, 1 / 15, 0.2) == pytest.approx(15.0)
    assert stack._rate(5, slow.controls, 1 / 15, 0.2) == pytest.approx(5.0)


def test_tries_cost_what_arithmetic_says():
    run = Experiment(development.MODEL, tries=3.0, seconds=10.0, reset=20.0, robots=2, step=4.0)
    real, computed, a_day, here, broken, alone = development.days(run.controls)
    assert real == pytest.approx(1000 * 30 / 2 / 86_400) and a_day == pytest.approx(5760)
    assert computed == pytest.approx(1000 * 5000 * 4e-6 / 2 / 86_400)
    assert here == pytest.approx(86_400 / 0.01) and broken == pytest.approx(2.0)
    assert alone == pytest.approx(5000 * 4e-6)
