"""The simulation of faults: all combinations against the chapter's rollouts, and what interacts."""

import dataclasses
import itertools
from unittest import mock

import numpy as np
import pytest

from course import sim_to_real as chapter
from course.sim_to_real import plants
from course.simulations.model import Experiment
from course.simulations.sim_to_real import faults


def by_rollouts(some, radius=0.025, delay=0.006):
    """Success of a combination by the chapter's public functions, made of parameters by name."""
    step, friction, mass, camera, plain = (name in some for name in faults.FAULTS)
    dt = 0.02 if step else 0.01
    sizes = plants.SIZES.copy()
    sizes[:5] = round(0.9 / dt), dt, 0.005, radius, round(0.1 / dt)
    arm = chapter.Plants(mass=1.1 if mass else 1.0, coulomb=0.6 if friction else 0.0, delay=delay)
    gains = chapter.recorded()["range"][0 if plain else 4, 0]
    with mock.patch.object(plants, "DT", dt), mock.patch.object(plants, "SIZES", sizes):
        posed = chapter.tasks(faults.COUNTED, faults.SEED)
        moved = posed.goal + np.array([[0.02 if camera else 0.0], [0.0]])
        # The references aim at the observed goal, and the true goal decides.
        reference = plants.reference_angles(posed.start, moved)
        object.__setattr__(posed, "reference", reference)
        return chapter.rollouts(arm, gains, posed).rate


@pytest.fixture(scope="module")
def experiment():
    return Experiment(faults.MODEL)


def number(*names):
    return sum(1 << faults.FAULTS.index(name) for name in names)


def interaction(rates, *pair):
    return faults.lost(rates, number(*pair)) - faults.added(rates, number(*pair))


@pytest.mark.prove
def test_all_combinations_are_those_of_the_chapter(experiment):
    for size in range(6):
        for some in itertools.combinations(faults.FAULTS, size):
            counted = experiment.state["rates"][number(*some)]
            assert counted == pytest.approx(by_rollouts(some), abs=1.5 / faults.COUNTED), some


@pytest.mark.prove
@pytest.mark.parametrize(("radius", "delay"), [(2.2, 0.0), (2.2, 12.0), (4.0, 0.0), (4.0, 12.0)])
def test_both_ends_of_the_sliders(radius, delay):
    now = Experiment(faults.MODEL, radius=radius, delay=delay)
    for some in ((), faults.FAULTS, ("step", "camera")):
        expected = by_rollouts(some, 0.01 * radius, 1e-3 * delay)
        counted = now.state["rates"][number(*some)]
        assert counted == pytest.approx(expected, abs=1.5 / faults.COUNTED)


def test_the_chosen_combination_is_counted_first(experiment):
    run = Experiment(faults.MODEL)
    run.in_portions = True
    run.choose("All on")
    rates = run.state["rates"]
    assert np.flatnonzero(~np.isnan(rates)).tolist() == [number(*faults.FAULTS)]
    numbers = run.picture().numbers
    assert numbers["success"].endswith(")")
    assert numbers["lost together"] == numbers["strongest pair"] == "being counted"
    texts = {item.words for item in faults.draw.decode(run.picture())}
    assert "counted: 1 of 32 combinations" in texts
    # A switch in between: what it chooses is counted next, and no result of another is shown.
    run.set(mass=False)
    chosen = number("step", "friction", "camera", "no_randomisation")
    assert run.picture().numbers["success"] == "being counted" and np.isnan(rates[chosen])
    assert run.complete() and not np.isnan(rates[chosen]) and run.remaining == 30
    portions = 1
    while run.complete():
        portions += 1
    assert portions == 30 and "being counted" not in run.picture().text
    assert np.array_equal(rates, experiment.state["rates"])
    assert np.array_equal(run.state["q"], experiment.state["q"])


def test_which_pairs_interact(experiment):
    """Step and camera reinforce each other, friction makes up, the mass does nothing."""
    rates = experiment.state["rates"]
    assert interaction(rates, "step", "camera") > 0.12
    assert interaction(rates, "step", "friction") < -0.03
    assert interaction(rates, "friction", "no_randomisation") < -0.02
    for other in ("step", "friction", "camera", "no_randomisation"):
        assert abs(interaction(rates, "mass", other)) < 0.04
    # On more, other reaches as well: two standard errors are below 0.05 at 128 reaches.
    with mock.patch.multiple(faults, COUNTED=512, SEED=91):
        both, step, camera, neither = (
            by_rollouts(some) for some in (("step", "camera"), ("step",), ("camera",), ())
        )
    assert (neither - both) - (neither - step) - (neither - camera) > 0.12


@pytest.mark.prove
def test_presets_do_what_they_say():
    shares = {}
    for name in faults.PRESETS:
        now = Experiment(faults.MODEL)
        now.choose(name)
        shares[name] = now.state["rates"][faults.chosen(now.controls)]
    assert shares["All off"] > 0.95
    assert 0.4 < shares["Step and camera"] < 0.65
    assert shares["Friction makes up"] > shares["Step and camera"] + 0.2
    assert shares["No randomisation"] < 0.45
    assert shares["All on"] > shares["Step and camera"] + 0.15


def test_a_switch_acts_at_once_and_is_marked(experiment):
    counted = experiment.state["rates"].copy()
    for chosen in itertools.product((False, True), repeat=5):
        values = dict(zip(faults.FAULTS, chosen, strict=True))
        experiment.set(**values)
        picture = experiment.picture()
        marks = [item.words for item in faults.draw.decode(picture) if item.words == "ACTIVE"]
        assert len(marks) == sum(chosen)
        rate = 100.0 * counted[number(*(name for name in values if values[name]))]
        assert picture.numbers["success"].startswith(faults.draw.written(rate, 0) + " %")
    np.testing.assert_array_equal(experiment.state["rates"], counted)
    live = [name for name, field in faults.CONTROLS.fields.items() if field.switch]
    assert live == list(faults.FAULTS)
    assert all(dataclasses.asdict(faults.CONTROLS.fields[name])["live"] for name in live)
