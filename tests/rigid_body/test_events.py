"""Events inside a step: order kept, order lost without, and what the root finder promises."""

from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.charts import build
from course.rigid_body import events
from course.rigid_body.integrators import INTEGRATORS, rk4, velocity_verlet
from course.rigid_body.problems import bounce_height, bounce_times
from tests.budget import examples

GRAVITY = 9.80665


def fall(q, v, params):
    return np.full_like(v, -GRAVITY)


def floor(q):
    return q[0]


def bounce(q, v):
    return q, 0.7 * np.abs(v)


@pytest.mark.slow
def test_order_is_kept_with_the_event_handled_and_is_one_without():
    (panel,) = build("events_order", steps=(150, 300, 600), phases=6)
    for name, order in (("RK4", 4), ("velocity Verlet", 2)):
        handled, late = (panel[f"{name}, impact {when}"] for when in ("time", "at"))
        slopes = [np.polyfit(np.log(s.x), np.log(s.y), 1)[0] for s in (handled, late)]
        assert slopes == [pytest.approx(order, abs=0.1), pytest.approx(1.0, abs=0.2)]
        assert late.y[-1] > 100.0 * handled.y[-1]


@pytest.mark.parametrize("name", ["semi_implicit_euler", "explicit_midpoint", "implicit_midpoint"])
def test_every_integrator_can_be_cut(name):
    problem = events.bouncing_pendulum()
    errors = []
    for n in (200, 400, 800):
        end, hits = events.simulate_with_events(
            problem.system, name, problem.duration / n, n, events.wall_gap, events.elastic_wall
        )
        assert hits == 2
        assert np.all(end.q >= 0.0)
        errors.append(problem.error(end.q[-1]))
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(INTEGRATORS[name].order, abs=0.2)


@examples(60)
@given(height=st.floats(1e-3, 5.0), speed=st.floats(-5.0, 5.0), extra=st.floats(1e-3, 2.0))
def test_the_time_of_a_fall_is_found_to_rounding(height, speed, extra):
    # RK4 is exact on a parabola, so the event's time is its root.
    truth = (speed + np.sqrt(speed**2 + 2.0 * GRAVITY * height)) / GRAVITY
    dt = truth * (1.0 + extra)
    q, v = np.array([height]), np.array([speed])
    result = events.time_of_event(q, v, rk4, fall, dt, np.zeros(0), floor)
    assert result == pytest.approx(truth, rel=1e-12, abs=1e-13)
    end, _ = rk4(q, v, fall, result, np.zeros(0))
    assert end[0] >= 0.0


def test_many_bounces_within_one_step_end_on_the_closed_form():
    times = bounce_times(1.0, 0.7, 12, GRAVITY)
    for count in (1, 4, 11):
        t = 0.5 * (times[count - 1] + times[count])
        q, _, hits = events.step_with_event(
            np.array([1.0]), np.zeros(1), velocity_verlet, fall, t, np.zeros(0), floor, bounce
        )
        assert hits == count
        assert q[0] == pytest.approx(bounce_height(t, 1.0, 0.7, GRAVITY), abs=1e-12)


def test_a_step_without_an_event_is_the_step_itself():
    q, v = np.array([1.0]), np.array([0.3])
    plain = rk4(q, v, fall, 0.01, np.zeros(0))
    for advance in (events.step_with_event, events.step_with_late_event):
        end = advance(q, v, rk4, fall, 0.01, np.zeros(0), floor, bounce)
        assert (end[0], end[1], end[2]) == (*plain, 0)
    assert q[0] == 1.0 and v[0] == 0.3


def test_a_state_that_starts_behind_the_wall_is_stepped_as_it_is():
    q, v = np.array([-1.0]), np.array([0.0])
    end = events.step_with_event(q, v, rk4, fall, 0.1, np.zeros(0), floor, bounce)
    assert end[2] == 0 and end[0][0] == pytest.approx(-1.0 - 0.5 * GRAVITY * 0.01)


def test_a_reset_that_does_not_turn_back_is_reported():
    with pytest.raises(RuntimeError, match="64 events"):
        events.step_with_event(
            np.array([0.1]), np.zeros(1), rk4, fall, 1.0, np.zeros(0), floor, lambda q, v: (q, v)
        )


def test_the_late_event_leaves_the_state_behind_the_wall():
    q, v, hits = events.step_with_late_event(
        np.array([0.01]), np.array([-1.0]), rk4, fall, 0.1, np.zeros(0), floor, bounce
    )
    assert hits == 1 and q[0] < 0.0 < v[0]


@numba.extending.register_jitable
def _drop(q, v, acceleration, dt, params):
    # Exact on a parabola, and quick to compile.
    a = acceleration(q, v, params)
    return q + dt * (v + 0.5 * dt * a), v + dt * a


_jitable_fall = numba.extending.register_jitable(fall)
_jitable_floor = numba.extending.register_jitable(floor)
_jitable_bounce = numba.extending.register_jitable(bounce)


@numba.njit
def _compiled_step(q, v, dt, params):
    return events.step_with_event(
        q, v, _drop, _jitable_fall, dt, params, _jitable_floor, _jitable_bounce
    )


@pytest.mark.prove
def test_the_same_source_compiles():
    start = np.array([1.0]), np.zeros(1)
    q, v, hits = _compiled_step(*start, 1.2, np.zeros(0))
    p, w, count = events.step_with_event(*start, _drop, fall, 1.2, np.zeros(0), floor, bounce)
    assert hits == count == 2
    np.testing.assert_allclose([q[0], v[0]], [p[0], w[0]], rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"integrator": "leapfrog"}, r"integrator must be .*, got 'leapfrog'"),
        ({"dt": -0.1}, r"dt must be .*, got -0.1"),
        ({"dt": float("nan")}, r"dt must be .*, got nan"),
        ({"steps": 0}, r"steps must be .*, got 0"),
    ],
)
def test_bad_arguments_are_named(change, message):
    arguments: dict[str, Any] = {"integrator": "rk4", "dt": 0.01, "steps": 1, **change}
    with pytest.raises(ValueError, match=message):
        events.simulate_with_events(
            events.bouncing_pendulum().system, gap=floor, reset=bounce, **arguments
        )


@pytest.mark.parametrize("amplitude", [0.0, -1.0, 3.2, float("nan")])
def test_amplitude_out_of_range(amplitude):
    with pytest.raises(ValueError, match="amplitude"):
        events.bouncing_pendulum(amplitude)
