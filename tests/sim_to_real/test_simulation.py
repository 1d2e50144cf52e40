"""Chapter 8's simulation: what each preset says is so, by what is counted."""

import numpy as np
import pytest

from course import sim_to_real as chapter
from course.control import Gains, joint_system, margins
from course.measure.success import paired
from course.sim_to_real import plants
from course.simulations import simulation
from course.simulations.model import Experiment
from course.simulations.sim_to_real import arms

POSED = chapter.tasks(256, 91)  # other tasks than those that the picture counts


def outcome(preset, **values):
    """Shares of successes of the simulated and the real arm, and all else that is told."""
    experiment = Experiment(arms.MODEL)
    experiment.choose(preset)
    experiment.set(**values)
    report = experiment.state["report"]
    return report[0], report[4], report


def counted_tasks(number=arms.COUNTED):
    """The tasks that the picture counts, with its noise."""
    posed = chapter.tasks(arms.COUNTED, arms.SEED)
    posed = chapter.Tasks(posed.start[:, :number], posed.goal[:, :number])
    object.__setattr__(posed, "unit_noise", arms.unit_noise()[:, :, :number].copy())
    return posed


def better(one, other, plant):
    """By how much more often other gains succeed on an arm, at least: the same tasks for both."""
    first, second = (chapter.rollouts(plant, gains, POSED).success for gains in (one, other))
    return paired(first, second)[1]


def gains(kind, gap=0.0, width=0.0, delay=0.01):
    return arms.policy(kind, gap, width, delay)[0]


def test_both_rates_are_those_of_the_chapter_and_their_bands_hold_on_other_tasks():
    home, real, report = outcome("No range")
    posed, record = counted_tasks(), chapter.recorded()["range"][0, 0]
    assert home == chapter.rollouts(chapter.nominal(), record, posed).rate == 1.0
    assert real == chapter.rollouts(chapter.real(0.3, 0.01), record, posed).rate
    assert report[arms.LOW + 4] < chapter.rollouts(chapter.real(0.3, 0.01), record, POSED).rate
    assert real < report[arms.HIGH + 4] < 0.93 < report[arms.LOW]


@pytest.mark.prove
@pytest.mark.parametrize("preset", arms.PRESETS)
def test_the_arms_and_the_costliest_part_are_those_of_the_chapter(preset):
    """The compiled arms by number against the chapter's, made of their parameters by name."""
    report, controls = outcome(preset)[2], arms.CONTROLS.new(**dict(arms.PRESETS[preset].values))
    kind, gap, delay = controls["policy"], controls["gap"], 1e-3 * controls["delay"]
    law, fields = arms.policy(kind, gap, controls["width"], delay)
    arm = chapter.real(gap, delay)
    believed = {
        arms.IDENTIFIED: chapter.real(gap, 0.01),
        arms.BOTH: chapter.real(gap, 0.01),
        arms.DELAY: chapter.mended(arm, ("delay",)),
        arms.LOAD: chapter.mended(arm, ("load",)),
    }.get(kind, chapter.nominal())
    np.testing.assert_allclose(plants.columns_of(fields), believed.columns(), rtol=1e-12)
    home, *rates = (
        chapter.rollouts(chapter.mended(arm, some), law, counted_tasks(arms.PORTION)).rate
        for some in ((), *((part,) for part in arms.PARTS))
    )
    costs = home - np.array(rates)
    assert report[arms.COSTS] == costs.max() and report[arms.PART] == np.argmax(costs)


def test_the_shares_grow_portion_by_portion_to_what_is_counted_at_once():
    run, whole = Experiment(arms.MODEL), Experiment(arms.MODEL)
    run.in_portions = True
    for experiment in (run, whole):
        experiment.choose("Wide range, far gap")
    report = run.state["report"]
    assert np.isnan(report[arms.SHARE]) and report[arms.LIMIT] == whole.state["report"][arms.LIMIT]
    assert run.picture().numbers["success, real"] == "being counted"
    # After the first block of both arms the shares are those of its tasks, with a wider band.
    run.complete(), run.complete()
    half = report.copy()
    posed = counted_tasks(arms.PORTION)
    policy = gains(arms.RANGE, width=1.0)
    expected = chapter.rollouts(chapter.real(1.0, 0.01), policy, posed).rate
    assert half[4 + arms.SHARE] == expected
    assert run.picture().numbers["costliest difference"] == "being counted"
    while run.complete():
        pass
    assert run.state.tobytes() == whole.state.tobytes()
    assert np.ptp(half[5:7]) > 1.2 * np.ptp(report[5:7])
    assert "being counted" not in run.picture().text


@pytest.mark.prove
def test_every_slider_acts_in_the_opening_preset():
    """Pull the gap up and successes are lost; pull the range up and part of them comes back."""
    start = outcome("Gap")[1]
    assert outcome("Gap", width=0.0)[1] < start < outcome("Gap", width=1.0)[1]
    assert outcome("Gap", gap=1.0)[1] < start - 0.2
    assert outcome("Gap", delay=30.0)[1] < start - 0.2
    assert outcome("Gap", width=0.0)[1] == outcome("No range", width=1.0)[1]


@pytest.mark.prove
def test_a_gap_costs_and_a_range_brings_part_of_it_back():
    assert outcome("No gap")[:2] == (1.0, 1.0)
    home, real, _ = outcome("Gap and range")
    assert home == 1.0 and real > outcome("No range")[1] > outcome("No range", gap=1.0)[1]
    empty, some, wide = (gains(arms.RANGE, width=w) for w in (0.0, 0.4, 1.0))
    assert better(empty, some, chapter.real(0.3, 0.01)) > 0.0
    far = chapter.real(1.0, 0.01)
    assert outcome("Wide range, far gap")[1] < 0.7
    at_home = [chapter.rollouts(chapter.nominal(), each, POSED) for each in (empty, wide)]
    assert all(each.rate == 1.0 for each in at_home)
    assert np.mean(at_home[1].inside) < 0.95 * np.mean(at_home[0].inside)
    assert better(wide, gains(arms.IDENTIFIED, 1.0), far) > 0.15


def test_delay_breaks_what_other_errors_hold():
    _, real, report = outcome("Delay beyond the margin")
    assert real < 0.15 and report[arms.LIMIT] < 0.02 and report[arms.GAIN] == 0.0
    _, below, report = outcome("Delay beyond the margin", delay=12.0)
    assert below > 0.7 and report[arms.GAIN] > 1.0
    _, both, report = outcome("Cancelling errors")
    assert (
        both > real + 0.4 and report[arms.LIMIT] > 0.02 and arms.PARTS[int(report[10])] == "delay"
    )
    arm, policy = chapter.real(0.3, 0.02), gains(arms.NOMINAL)
    for part in arms.PARTS[:-1]:
        some = chapter.rollouts(chapter.mended(arm, ("delay", part)), policy, POSED).rate
        assert some > 0.4 if part == "load" else some < 0.15, part


@pytest.mark.slow
def test_mending_the_delay_alone_hurts_and_mending_the_load_helps():
    far = chapter.real(1.0, 0.01)
    empty, delay, load = (gains(k, 1.0) for k in (arms.NOMINAL, arms.DELAY, arms.LOAD))
    assert better(delay, empty, far) > 0.05 and better(empty, load, far) > 0.2
    assert delay[3] < empty[3] and outcome("Mended delay alone")[1] < 0.35
    assert arms.PARTS[int(outcome("Mended delay alone")[2][arms.PART])] == "load"


def test_the_limit_is_that_of_the_loops_matrix():
    """The frequency response, which is quick, against what the picture has no time for."""
    arm, policy = chapter.real(0.3, 0.01), gains(arms.NOMINAL)
    inertia, damping, torque = arm.columns()[[2, 4, 7], 0]
    kp, ki, kd = torque * policy[3:]
    law = Gains(kp, ki, kd, plants.FILTER).law(plants.DT)
    exact = margins(*joint_system(inertia, damping), law, plants.DT).delay
    assert arms.stability(arm.columns(), policy)[0] == pytest.approx(exact, abs=1e-3)


def test_the_target_is_dragged_and_the_ghost_is_the_simulated_arm():
    for scene in arms._SCENES:
        now = Experiment(arms.MODEL)
        now.drag(scene[0] + 1.45 * (1.0 - 0.5 / 0.95), scene[2] + 1.45)  # at (-0.5, 0)
        np.testing.assert_allclose(now.controls["aim"], [-0.5, 0.0], atol=1e-12)
        end = plants.tip(now.state["q"][:, :, -1].T)  # columns: simulated and real
        assert np.hypot(*(end[:, 0] - [-0.5, 0.0])) < plants.RADIUS
    posed = chapter.Tasks(np.reshape(arms.START, (2, 1)), np.array([[-0.5], [0.0]]), arms.SEED)
    run = chapter.watch(chapter.nominal(), gains(arms.RANGE, width=0.2), posed)
    np.testing.assert_allclose(now.state["q"][arms.SIMULATED], run.q[:, 0], rtol=0, atol=1e-12)
    panel = simulation("arms", "No gap")
    assert "success, real: 100 % (99-100)" in repr(panel)
    panel.close()
