"""What chapter 1 says of its charts, on smaller settings: errors, orders, picks, ratios."""

import time

import numpy as np
import pytest

from course import charts
from course.charts.rigid_body import accuracy, box_scene, throughput
from course.measure.colours import KEYS
from course.rigid_body.integrators import INTEGRATORS


@pytest.fixture(scope="module")
def tumble():
    return accuracy.work_precision("tumble", repeats=1, steps=(250, 500, 1000, 2000, 4000))


@pytest.mark.slow
def test_every_integrator_shows_its_order_on_the_tumble(tumble) -> None:
    for name, item in INTEGRATORS.items():
        if item.order > 1:
            assert tumble.observed_order(name) == pytest.approx(item.order, abs=0.1), name
    assert tumble.observed_order("MuJoCo RK4") == pytest.approx(4.0, abs=0.1)


@pytest.mark.slow
def test_mujocos_euler_is_our_semi_implicit_euler(tumble) -> None:
    theirs = [p.error for p in tumble.curve("MuJoCo Euler").points]
    ours = [p.error for p in tumble.curve("semi_implicit_euler").points]
    np.testing.assert_allclose(theirs, ours, rtol=1e-6)


@pytest.mark.prove
def test_mujocos_implicit_methods_are_of_first_order_on_a_tumble() -> None:
    names = tuple(f"MuJoCo {name}" for name in ("Euler", "implicitfast", "discrete"))
    result = accuracy.work_precision("tumble", 1, (8_000, 16_000, 32_000), names)
    for name in names:
        assert result.observed_order(name) == pytest.approx(1.0, abs=0.1)
    finest = [result.curve(name).points[-1].error for name in names[:2]]
    assert 0.5 < finest[1] / finest[0] < 2.0


@pytest.mark.slow
def test_at_a_milliradian_rk4_needs_the_fewest_evaluations(tumble) -> None:
    pick = tumble.pick(by="count")
    assert pick.name in ("rk4", "rk4_renormalised", "MuJoCo RK4")
    second = tumble.pick(by="count", tolerance=1e-3, styles=("oracle",))
    assert pick.point.count == second.point.count


def test_a_function_of_the_learner_joins_the_chart_with_one_call() -> None:
    names = ("semi_implicit_euler", "velocity_verlet")
    result = accuracy.work_precision("pendulum", 1, (40, 80, 160, 320), names)

    def mine(q, v, acceleration, dt, params):
        v = v + dt * acceleration(q, v, params)
        return q + dt * v, v

    chart = result.with_method(accuracy.your_method("pendulum", mine))
    errors = {p.parameter: p.error for p in chart.curve("yours").points}
    for point in result.curve("semi_implicit_euler").points:
        assert errors[point.parameter] == pytest.approx(point.error, rel=1e-9)
    assert chart.ratio is not None


@pytest.mark.slow
def test_the_box_is_exact_with_impact_times_and_first_order_without() -> None:
    result = accuracy.box_work_precision(repeats=1, counts=(10, 80, 1280, 5120))
    assert max(p.error for p in result.curve("exact flight, impact times").points) < 1e-10
    late = [p.error for p in result.curve("exact flight, end of step").points]
    assert late[0] > 1e-2 and 1e-5 < late[-1] < 1e-2
    for curve in result.curves:
        if curve.style == "oracle":
            assert min(p.error for p in curve.points) > 1e-6, curve.name
    pick = result.pick(by="count")
    assert pick is not None
    assert pick.name == "exact flight, impact times" and pick.point.count == 10


@pytest.mark.prove
def test_table_has_every_scene_and_integrator() -> None:
    rows = accuracy.table_at(dt=5e-3, repeats=1)
    for problem in ("tumble", "heavy_top", "oscillator", "box drop"):
        names = " ".join(row.method for row in rows if row.problem == problem)
        for integrator in accuracy.MUJOCO_SHOWN:
            assert f"MuJoCo {integrator}" in names
    error = {(row.problem, row.method): row.error for row in rows}
    assert error["tumble", "rk4"] < 1e-9 and error["tumble", "MuJoCo RK4"] < 1e-9
    assert error["tumble", "rk4"] < 1e-6 * error["tumble", "semi_implicit_euler"]


@pytest.mark.prove
def test_batches_beat_a_general_engine_at_the_same_accuracy() -> None:
    """Aims are 100 and 25 on the clock; these are ratios of processor time, with room."""
    boxes = throughput.box_contenders(samples=8)
    assert boxes[0].dt == boxes[1].dt
    assert boxes[0].error < 1e-9 < boxes[1].error <= throughput.BOX_TOLERANCE
    clock = time.process_time
    rates = throughput.measure_rates(boxes[:2], (64,), 3, horizon=1.0, clock=clock)
    step, second = throughput.ratios(rates, "course", "mujoco.batch")
    assert step == pytest.approx(second, rel=1e-9) and step > 40
    bodies = throughput.body_contenders(samples=4, integrators=("RK4",))
    assert all(c.error <= throughput.BODY_TOLERANCE for c in bodies)
    rates = throughput.measure_rates(bodies, (512,), 3, sample=0.01, clock=clock)
    assert throughput.ratios(rates, "course rk4_renormalised", "mujoco.batch RK4")[1] > 8
    panel = throughput._panel("bodies", "seconds", rates, per_step=False)
    assert [s.key for s in panel.series] == ["rk4_renormalised", "mujoco.batch, RK4"]
    for series, rate in zip(panel.series, rates, strict=True):
        assert series.x == [512] and series.y == [rate.seconds_per_second]
        assert np.all(np.less_equal([series.low, series.y], [series.y, series.high]))


@pytest.mark.prove
def test_the_scene_fits_its_question_and_its_neighbours_do_not() -> None:
    scene = box_scene.bouncing_box()
    assert scene.check() == []
    assert box_scene.third_dimension(depth=0.2) > scene.tolerance.value
    assert box_scene.ours() == pytest.approx(box_scene._mujocos_plane(), abs=1e-3)
    assert box_scene.ours(dt=1e-3) == pytest.approx(box_scene.ours(dt=5e-4), abs=1e-5)


def test_apex_of_a_known_path() -> None:
    t = np.arange(0.0, 1.0, 1e-3)
    fall = 1.0 - 4.9 * t**2
    rise = 3.0 * (t - 0.4) - 4.9 * (t - 0.4) ** 2
    assert box_scene.apex(np.where(t < 0.4, fall, rise)) == pytest.approx(9.0 / 19.6, abs=1e-9)
    with pytest.raises(ValueError, match="with a bounce"):
        box_scene.apex(fall)


@pytest.mark.prove
def test_a_chart_is_made_of_what_its_experiment_yields(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(charts, "FOLDER", tmp_path)
    monkeypatch.setattr(charts, "PICTURES", tmp_path)
    (panel,) = charts.build("events_order", steps=(50, 100), phases=2)
    monkeypatch.setitem(charts.CHARTS, "events_order", (lambda: iter([panel]), {}))
    text = charts.make("events_order")
    assert text == "\n".join(series.note for series in panel.series) == charts.read("events_order")
    names = [path.name for path in sorted(tmp_path.iterdir())]
    assert names == [f"events_order.{kind}" for kind in ("json", "png", "txt")]
    for name, call in (("two", charts.read), ("nothing", charts.build)):
        with pytest.raises(ValueError, match=f"'{name}'"):
            call(name)


def test_every_chart_of_the_folder_has_its_experiment_and_every_method_its_colour() -> None:
    charts.load()
    assert {path.stem for path in charts.FOLDER.glob("*.txt")} == {*charts.CHARTS}
    problem, question = accuracy.questions()["tumble"]
    shown = [accuracy._ours(problem, name, (10,)).name for name in INTEGRATORS]
    shown += [accuracy._mujocos(problem, question, n, (10,)).name for n in accuracy.MUJOCO_SHOWN]
    assert {*shown} <= {*KEYS}
