"""The record behind the dashboard is what the engines do, and the numbers shown are its numbers."""

import itertools

import numpy as np
import pytest

from course.charts.platforms import record
from course.oracles.engines import engines
from course.platforms.recorded import recorded
from course.simulations import platforms as sim
from course.simulations.model import Experiment
from tests import optional

FOUND = recorded()


def test_the_record_holds_every_scene_step_setting_and_engine():
    assert FOUND.engines == tuple(engines())
    assert FOUND.steps.tolist() == list(record.STEPS)
    shape = (len(sim.SCENES), len(record.STEPS), 2, len(FOUND.engines))
    assert FOUND.errors.shape == shape and FOUND.paths.shape == (*shape, record.SAMPLES, 2)
    assert np.isfinite(FOUND.paths).all() and (FOUND.errors >= 0.0).all()
    assert FOUND.tolerance.tolist() == [scene.tolerance for scene in record.shown()]
    assert ((FOUND.radar >= 0.0) & (FOUND.radar <= 1.0)).all()
    assert (np.diff(FOUND.radar, axis=2) >= 0.0).all()
    assert FOUND.heights.shape == (len(FOUND.engines), record.SAMPLES)


@pytest.mark.parametrize("scene", [sim.TUMBLE, sim.BRAKE])
def test_mujoco_repeats_its_record(scene):
    e, step = FOUND.engines.index("MuJoCo"), 2
    for k, settings in enumerate(record.SETTINGS):
        path, error = record.path(
            engines()["MuJoCo"], record.shown()[scene], FOUND.steps[step], settings
        )
        assert np.allclose(path, FOUND.paths[scene, step, k, e], atol=1e-5)
        assert error == pytest.approx(FOUND.errors[scene, step, k, e], rel=1e-6)


OTHERS = [pytest.param(name, marks=pytest.mark.optional) for name in ("Drake", "PyBullet")]


@pytest.mark.parametrize("name", ["own code", "MuJoCo", *OTHERS])
def test_every_engine_repeats_the_recorded_heights_of_the_braking_block(name):
    engine = engines()[name]
    if missing := engine.missing():
        optional.skip(f"{name}'s heights were NOT repeated: {missing}")
    stored = FOUND.heights[FOUND.engines.index(name)]
    assert np.allclose(record.heights(engine), stored, atol=1e-5)  # a hundredth of a millimetre
    assert np.ptp(stored) > 1e-3 if name == "MuJoCo" else np.abs(stored).max() < 2e-5


@pytest.mark.parametrize("scene", [sim.BRAKE, sim.GRASP])
def test_costs_are_of_the_scene_and_not_of_what_comes_after_it(scene, monkeypatch):
    """Long after its end, a part that creeps has left the grip, and steps are cheaper."""
    one, prepare, times = record.shown()[scene], record.platforms.prepared, []

    def watched(*arguments):
        run = prepare(*arguments)
        start, advance = run.state().time, run.advance

        def spy(steps):
            advance(steps)
            times.append(run.state().time - start)

        run.advance = spy
        return run

    monkeypatch.setattr(record.platforms, "prepared", watched)
    cost = record.costs([engines()["MuJoCo"]], one)
    assert cost.shape == (2, 1) and cost[1, 0] == 1.0
    assert np.allclose(times, round(one.duration / 1e-3) * 1e-3)


def test_the_presets_show_what_their_notes_say():
    names, fair, shipped = FOUND.engines, 1, 0
    errors, at = FOUND.errors, 1  # at 1 ms
    chain = errors[sim.CHAIN, at, fair]
    assert chain.max() / chain.min() < 1.02
    assert np.allclose(errors[sim.CHAIN, 0, fair] / chain, 0.5, atol=0.05)  # half the step
    damped = errors[sim.CHAIN, :, shipped, names.index("PyBullet")]
    assert (damped > 3.0 * errors[sim.CHAIN, :, fair].max(axis=1)).all()
    end = FOUND.paths[sim.BRAKE, at, shipped, names.index("MuJoCo"), -1]
    deviation = np.degrees(np.arctan2(end[1], end[0])) - np.degrees(record.HEADING)
    assert deviation == pytest.approx(12.8, abs=1.0)  # theory of the inscribed pyramid
    part = FOUND.paths[sim.GRASP, at, shipped, names.index("MuJoCo"), :, 1]
    assert (np.diff(part) < 1e-6).all() and -12.0 < part[-1] < -3.0  # it creeps and does not fall
    top = FOUND.paths[sim.TOWER, at, shipped, names.index("Drake"), -1, 1]
    assert top < -100.0


def test_an_area_depends_on_the_order_of_the_axes_and_the_axes_do_not():
    orders = [(0, *rest) for rest in itertools.permutations(range(1, 5))]
    assert sim.area(np.ones(5)) == pytest.approx(1.0)
    sums = {
        order: sum(sim.area(FOUND.radar[e, list(order), 1]) for e in range(4)) for order in orders
    }
    assert sums[tuple(sim.ORDERS[1].tolist())] == pytest.approx(max(sums.values()))


def test_what_the_card_says_is_on_record():
    for card, name in enumerate(FOUND.engines):
        report = dict(Experiment(sim.MODEL, card=card).picture().numbers)
        error = 1e3 * FOUND.errors[sim.CHAIN, 1, 1, card]
        assert report["error at the end"] == f"{error:.3f} mrad", name
        assert report["verdict"] == "beyond"  # 21 mrad, and 10 are allowed
    report = dict(Experiment(sim.MODEL, card=len(FOUND.engines)).picture().numbers)
    assert report["error at the end"] == report["cost of a step"] == "not measured here"
