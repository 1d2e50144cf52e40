"""The planar box against independent answers: closed forms, quadrature in impulse, root finding."""

import math
import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from course.rigid_body import planar, planar_contact
from course.rigid_body.planar import (
    FLIGHT_COEFFICIENT,
    STANDARD_GRAVITY,
    PlanarBody,
    advance_boxes,
    box_parameters,
    step_boxes,
)
from course.rigid_body.planar_contact import CLEAR, HIT, first_impact, impact, newton_impact
from tests.budget import examples

G = STANDARD_GRAVITY


def box(*state: float, **options: Any) -> PlanarBody:
    return PlanarBody(state=np.array(state, dtype=float), **options)


def random_states(n: int, seed: int, low: float = 0.6, high: float = 2.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.array(
        [
            rng.uniform(-1, 1, n),
            rng.uniform(low, high, n),
            rng.uniform(-4, 4, n),
            rng.uniform(-2, 2, n),
            rng.uniform(-1, 1, n),
            rng.uniform(-10, 10, n),
        ]
    )


def energies(state: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    m, inertia = parameters[0], parameters[3]
    return 0.5 * m * (state[3] ** 2 + state[4] ** 2 + 2 * G * state[1]) + (
        0.5 * inertia * state[5] ** 2
    )


def lowest(state: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """Height of the lowest point, by the support function of a box."""
    half = 0.5 * parameters[1] * np.abs(np.sin(state[2])) + 0.5 * parameters[2] * np.abs(
        np.cos(state[2])
    )
    return state[1] - half


# Flat drops: closed form


@pytest.mark.prove
@pytest.mark.parametrize("restitution", [0.3, 0.7, 0.95])
@pytest.mark.parametrize("dt", [0.0005, 0.003, 0.05])
def test_flat_drop_bounces_at_the_analytic_times(restitution: float, dt: float) -> None:
    drop = 1.2
    body = box(0, 0.1 + drop, 0, 0, 0, 0, restitution=restitution, rest_speed=1e-3)
    t1 = math.sqrt(2 * drop / G)
    hits = [t1 * (1 + 2 * sum(restitution**i for i in range(1, k))) for k in range(1, 8)]
    for k in range(1, int(hits[5] / dt)):
        body.step(dt, integrator="velocity_verlet")
        t = k * dt
        passed = sum(hit <= t for hit in hits)
        if min(abs(t - hit) for hit in hits) < 1e-9:
            continue
        assert body.impacts == passed
        if passed == 0:
            height = drop - 0.5 * G * t * t
        else:
            u = t - hits[passed - 1]
            height = restitution**passed * math.sqrt(2 * G * drop) * u - 0.5 * G * u * u
        # An error s of the impact time shows as a height error of vy s.
        assert body.state[1] - 0.1 == pytest.approx(height, abs=1e-10)
        assert body.state[2] == 0.0 and body.state[5] == 0.0 and body.state[3] == 0.0


def test_apex_heights_fall_by_the_square_of_restitution() -> None:
    body = box(0, 0.1 + 1.0, 0, 0, 0, 0, restitution=0.8)
    apexes = []
    for _ in range(5):
        before = body.impacts
        while body.impacts == before:
            body.step(0.004, integrator="rk4")
        _, y, _, _, vy, _ = body.state
        apexes.append(y - 0.1 + vy * vy / (2 * G))
    np.testing.assert_allclose(apexes, [0.8 ** (2 * k) for k in range(1, 6)], rtol=1e-10)


def test_a_slow_impact_does_not_bounce() -> None:
    for speed, bounces in ((0.0099, False), (0.0101, True)):
        body = box(0, 0.1, 0, 0, -speed, 0, restitution=0.5, rest_speed=0.01)
        body.step(1e-9, gravity=0.0)
        assert body.state[4] == pytest.approx(0.5 * speed if bounces else 0.0, abs=1e-15)


@pytest.mark.parametrize("name", FLIGHT_COEFFICIENT)
def test_an_impact_within_a_step_of_each_integrator(name: str) -> None:
    """Both parts of the step move by h v + c h^2 a; the impact is where the first one ends."""
    dt, gap, speed, e, c = 0.02, 0.03, 3.0, 0.6, FLIGHT_COEFFICIENT[name]
    tau = brentq(lambda t: gap - speed * t - c * G * t * t, 0, dt, xtol=1e-16)
    up = e * (speed + G * tau)
    remaining = dt - tau
    body = box(0, 0.1 + gap, 0, 0, -speed, 0, restitution=e)
    body.step(dt, integrator=name)
    assert body.state[1] - 0.1 == pytest.approx(up * remaining - c * G * remaining**2, abs=1e-12)
    assert body.state[4] == pytest.approx(up - G * remaining, abs=1e-12)


# Tumbling in flight and the time of the first impact


@pytest.mark.parametrize("name", FLIGHT_COEFFICIENT)
def test_flight_is_the_integrator_itself(name: str) -> None:
    """Against the textbook update, written out here."""
    dt, a, alpha = 0.01, np.array([0.7, -G - 0.3]), 2.5
    body = box(0.2, 5, 0.4, 1, 2, -3)
    body.apply_force([0.7, -0.3])
    body.apply_force([0, 1], body.position + np.array([alpha * body.moment, 0]))
    body.apply_force([0, -1])
    q, v = body.state[:3].copy(), body.state[3:].copy()
    body.step(dt, integrator=name)
    acc = np.array([*a, alpha])
    new_v = v + dt * acc
    if name == "explicit_euler":
        new_q = q + dt * v
    elif name == "semi_implicit_euler":
        new_q = q + dt * new_v
    else:
        new_q = q + dt * 0.5 * (v + new_v)
    np.testing.assert_allclose(body.state, [*new_q, *new_v], rtol=0, atol=1e-14)
    assert not body.force.any() and body.torque == 0.0


@pytest.mark.slow
def test_first_impact_agrees_with_sampling_and_brentq() -> None:
    rng = np.random.default_rng(7)
    hits = 0
    for _ in range(300):
        w, h = rng.uniform(0.05, 0.6, 2)
        vy, omega, alpha = rng.uniform(-4, 3), rng.uniform(-40, 40), rng.uniform(-100, 100)
        angle, c, horizon = rng.uniform(-7, 7), rng.choice([0.0, 0.5, 1.0]), 0.05
        a, b = 0.5 * w * np.array([1, 1, -1, -1]), 0.5 * h * np.array([1, -1, 1, -1])
        y = float(np.max(-(a * np.sin(angle) + b * np.cos(angle)))) + rng.uniform(1e-4, 0.05)

        def gap(t, y=y, vy=vy, angle=angle, omega=omega, alpha=alpha, c=c, a=a, b=b):
            theta = angle + omega * t + c * alpha * t * t
            s, k = np.sin(theta), np.cos(theta)
            corners = np.multiply.outer(s, a) + np.multiply.outer(k, b)
            return y + vy * t - c * G * t * t + corners.min(axis=-1)

        times = np.linspace(0, horizon, 20001)
        below = np.flatnonzero(gap(times) < 0)
        tau, outcome = first_impact(y, angle, vy, omega, -G, alpha, w, h, horizon, c)
        if below.size:
            hits += 1
            i = below[0]
            assert outcome == HIT
            assert tau == pytest.approx(brentq(gap, times[i - 1], times[i], xtol=1e-15), abs=1e-10)
        else:
            assert outcome == CLEAR and tau == horizon
    assert 50 < hits < 290


def test_a_corner_that_dips_and_comes_back_is_not_missed() -> None:
    """The box spins so fast that a corner is below the ground only in the midst of the step."""
    radius = 0.5 * math.hypot(0.3, 0.2)
    depth = 1e-5
    omega, middle = 100.0, 0.0123
    corner = math.atan2(-0.2, -0.3)  # direction of one corner in the body
    angle = -math.pi / 2 - corner - omega * middle
    tau, outcome = first_impact(radius - depth, angle, 0, omega, 0, 0, 0.3, 0.2, 0.02, 0.5)
    half = math.acos(1 - depth / radius) / omega  # how long before the lowest point it hits
    assert outcome == HIT and tau == pytest.approx(middle - half, abs=1e-9)
    tau, outcome = first_impact(radius + depth, angle, 0, omega, 0, 0, 0.3, 0.2, 0.02, 0.5)
    assert outcome == CLEAR


# Impacts

speeds = st.floats(-10, 10)
boxes = {
    "w": st.floats(0.05, 3),
    "h": st.floats(0.05, 3),
    "angle": st.floats(0, 2 * math.pi),
    "shape": st.floats(0.2, 1.5),
    "e": st.floats(0, 1),
    "mu": st.one_of(st.just(0.0), st.floats(0, 5)),
}


def corner_of(w: float, h: float, angle: float) -> tuple[float, float]:
    rx, ry, _, _ = planar_contact.lowest_corners(angle, w, h)
    return rx, ry


def after(v: np.ndarray, pt: float, pn: float, rx: float, ry: float, inertia: float) -> np.ndarray:
    return v + np.array([pt, pn, (rx * pn - ry * pt) / inertia])


def at_corner(v: np.ndarray, rx: float, ry: float) -> tuple[float, float]:
    return v[0] - v[2] * ry, v[1] + v[2] * rx


def impulse_reference(v, rx, ry, inertia, e, mu, steps=200):
    """March the velocities (3, N) over the normal impulse, with friction as an inclusion.

    In each small impulse p the friction is the k within [-mu, mu] that brings the tangential
    velocity closest to zero at its end: whether a corner slides, sticks or turns round is nowhere
    asked. The normal velocity ends the compression at zero, its work ends the restitution.
    """
    across, along = 1 + ry**2 / inertia, -rx * ry / inertia
    v, work, loaded = v.copy(), np.zeros_like(rx), np.zeros_like(rx)
    full = -at_corner(v, rx, ry)[1] / steps
    compressing, running = np.ones(rx.size, bool), np.ones(rx.size, bool)
    while running.any():
        vt, vn = at_corner(v, rx, ry)
        share = np.where(running, 1.0, 0.0)
        # No impulse goes on beyond the one that stops the sliding.
        stop = -vt / (along - mu * across * np.sign(vt) + 1e-300)
        p = np.where((np.abs(vt) > 1e-12) & (stop > 0), np.minimum(full, stop), full)
        for _ in range(3):  # the last impulse is a part of one; its size moves friction a little
            q = np.maximum(share * p, 1e-300)
            k = np.clip(-(vt / q + along) / across, -mu, mu)
            rise = 1 + rx**2 / inertia + along * k
            goal = loaded * (1 - e**2)
            root = np.sqrt(np.maximum(vn**2 + 2 * rise * (goal - work), 0.0))
            remaining = np.where(compressing, -vn / rise, (root - vn) / rise)
            share = np.where(
                running, np.where(remaining > 0, np.minimum(remaining / p, 1.0), 1.0), 0.0
            )
        q = share * p
        v += q * np.array([k, np.ones_like(k), (rx - ry * k) / inertia])
        work += q * (vn + 0.5 * rise * q)
        ended = running & (share < 1)
        loaded = np.where(ended & compressing, work, loaded)
        running &= ~(ended & (~compressing | (e == 0)))
        compressing &= ~ended
    return v


def test_impact_agrees_with_integration_over_the_impulse() -> None:
    rng = np.random.default_rng(3)
    drawn, news, kinds = [], [], set()
    for _ in range(600):
        w, h = rng.uniform(0.1, 1.0, 2)
        inertia = (w * w + h * h) / 12 * rng.uniform(0.3, 1.3)
        rx, ry = corner_of(w, h, rng.uniform(0, 2 * math.pi))
        v = rng.normal(size=3) * [2, 1, 4]
        v[0] = v[2] * ry + rng.choice([0.1, 1.0]) * rng.normal()
        vt, vn = at_corner(v, rx, ry)
        if vn > -0.1 or abs(vt) < 1e-3:
            continue
        e, mu = rng.uniform(0, 1), rng.choice([0.1, 0.2, 0.4, 1.0, 3.0])
        pt, pn = impact(vt, vn, rx, ry, 1.0, 1 / inertia, e, mu)
        new = after(v, pt, pn, rx, ry, inertia)
        end = at_corner(new, rx, ry)[0]
        kinds.add("sticks" if abs(end) < 1e-9 else "reverses" if end * vt < 0 else "slides")
        drawn.append([*v, rx, ry, inertia, e, mu])
        news.append(new)
    columns = np.array(drawn).T
    v, want = columns[:3], impulse_reference(columns[:3], *columns[3:])
    assert len(news) > 150
    error = np.abs(np.array(news).T - want).max(axis=0) / np.abs(v).max(axis=0)
    assert error.max() < 1e-10
    assert kinds == {"sticks", "slides", "reverses"}


@pytest.mark.slow
@examples(500)
@given(vx=speeds, vy=speeds, omega=speeds, **boxes)
def test_impact_properties(vx, vy, omega, w, h, angle, shape, e, mu) -> None:
    inertia = shape * (w * w + h * h) / 12
    rx, ry = corner_of(w, h, angle)
    v = np.array([vx, vy, omega])
    vt, vn = at_corner(v, rx, ry)
    pt, pn = impact(vt, vn, rx, ry, 1.0, 1 / inertia, e, mu)
    new = after(v, pt, pn, rx, ry, inertia)
    weight = np.array([1.0, 1.0, inertia])
    scale = v @ (weight * v) + 1e-300
    assert pn >= 0 and abs(pt) <= mu * pn * (1 + 1e-12)
    assert new @ (weight * new) <= scale * (1 + 1e-12)
    if vn < 0:
        assert at_corner(new, rx, ry)[1] >= -1e-9 * math.sqrt(scale / min(1, inertia))
        # Mirrored velocities and offsets give the mirrored impulse, exactly.
        assert impact(-vt, vn, -rx, ry, 1.0, 1 / inertia, e, mu) == (-pt, pn)
        if mu == 0:
            assert at_corner(new, rx, ry)[1] == pytest.approx(-e * vn, abs=1e-9 * (1 - vn))
    else:
        assert (pt, pn) == (0, 0)


@pytest.mark.slow
@examples(150)
@given(vx=speeds, vy=st.floats(-10, -0.01), omega=speeds, **boxes)
def test_normal_work_given_back_is_e_squared(vx, vy, omega, w, h, angle, shape, e, mu) -> None:
    """The work of compression is read off an impact with e = 0, that of both from e itself."""
    inertia = shape * (w * w + h * h) / 12
    rx, ry = corner_of(w, h, angle)
    vt, vn = at_corner(np.array([vx, vy, omega]), rx, ry)
    if vn > -1e-3:
        return

    def normal_work(restitution):
        """March through the impulse with Coulomb's law in each increment."""
        _, end = impact(vt, vn, rx, ry, 1.0, 1 / inertia, restitution, mu)
        wnn, wnt, wtt = 1 + rx * rx / inertia, -rx * ry / inertia, 1 + ry * ry / inertia
        n = 1000
        dp = end / n
        t, y, work = vt, vn, 0.0
        for _ in range(n):
            k = min(mu, max(-mu, -(t / dp + wnt) / wtt))
            t += (wnt + wtt * k) * dp
            work += (y + 0.5 * (wnn + wnt * k) * dp) * dp
            y += (wnn + wnt * k) * dp
        return work

    compression = normal_work(0.0)
    assert normal_work(e) == pytest.approx((1 - e * e) * compression, abs=4e-3 * abs(compression))


def test_newtons_rule_gains_energy_where_ours_does_not() -> None:
    """The paradox that Kane described in 1984, on a slender box that lands on its corner."""
    w, h, angle, e, mu = 1.0, 0.05, 0.5, 1.0, 0.7
    inertia = (w * w + h * h) / 12
    rx, ry = corner_of(w, h, angle)
    v = np.array([-1.0, -1.0, 4.0])
    vt, vn = at_corner(v, rx, ry)
    weight = np.array([1, 1, inertia])
    gains = []
    for rule in (newton_impact, impact):
        pt, pn = rule(vt, vn, rx, ry, 1.0, 1 / inertia, e, mu)
        assert abs(pt) <= mu * pn * (1 + 1e-12)
        new = after(v, pt, pn, rx, ry, inertia)
        gains.append(new @ (weight * new) / (v @ (weight * v)) - 1)
        if rule is newton_impact:
            assert at_corner(new, rx, ry)[1] == pytest.approx(-e * vn, abs=1e-12)
    assert gains == pytest.approx([0.921822, -0.074195], abs=1e-6)


@pytest.mark.slow
@examples(500)
@given(vx=speeds, vy=speeds, omega=speeds, **boxes)
def test_resting_face_contact_properties(vx, vy, omega, w, h, angle, shape, e, mu) -> None:
    """Two inelastic contacts: always a case that fits, no approach, no energy, Coulomb's cone."""
    inertia = shape * (w * w + h * h) / 12
    v = np.array([vx, vy, omega])
    *new, active = planar_contact.two_contacts(*v, -w / 2, w / 2, -h / 2, 1.0, 1 / inertia, mu)
    weight = np.array([1, 1, inertia])
    scale = math.sqrt(v @ (weight * v) / min(1, inertia))
    assert active >= 0
    assert new @ (weight * new) <= v @ (weight * v) * (1 + 1e-12)
    assert new[1] - abs(new[2]) * w / 2 >= -1e-9 * (1 + scale)
    assert new[1] >= vy - 1e-12
    assert abs(new[0] - vx) <= mu * (new[1] - vy) + 1e-9 * (1 + scale)


def test_a_leaving_corner_can_jam_under_large_friction() -> None:
    """The only impulse that fits sticks at a corner which by itself would leave the ground."""
    w, h, mass, inertia, mu = 6.98962644744305, 13.81764215458008, 3.04876, 12.85836, 1.97224
    v = np.array([1.35286026, -0.1616236, 0.15259696])
    vx, vy, omega, active = planar_contact.two_contacts(
        *v, -w / 2, w / 2, -h / 2, 1 / mass, 1 / inertia, mu
    )
    assert active == 2 and v[1] + v[2] * w / 2 > 0
    np.testing.assert_allclose(at_corner(np.array([vx, vy, omega]), w / 2, -h / 2), 0, atol=1e-12)
    assert vy - omega * w / 2 >= 0


# The resolved scheme as a whole


def test_elastic_frictionless_box_keeps_its_energy_over_100_impacts() -> None:
    parameters = box_parameters(restitution=1.0, friction=0.0)
    state = random_states(20, 1)
    start, vx = energies(state, parameters), state[3].copy()
    total = np.zeros(20, dtype=int)
    while total.min() < 100:
        state, counts = advance_boxes(state, parameters, 0.002, 500, integrator="velocity_verlet")
        total += counts[0]
        assert not counts[1].any()
    np.testing.assert_allclose(energies(state, parameters), start, rtol=1e-10)
    assert np.array_equal(state[3], vx)


@pytest.mark.parametrize("integrator", ["semi_implicit_euler", "velocity_verlet"])
@pytest.mark.parametrize("dt", [0.001, 0.01, 0.05])
def test_bodies_lose_energy_stay_above_ground_and_come_to_rest(integrator: str, dt: float) -> None:
    rng = np.random.default_rng(5)
    n = 300
    parameters = box_parameters(
        width=rng.uniform(0.1, 0.5, n),
        height=rng.uniform(0.1, 0.5, n),
        restitution=rng.uniform(0, 0.6, n),
        friction=rng.choice([0.2, 0.6, 2.0], n),
    )
    state = random_states(n, 6)
    start = energies(state, parameters)
    for _ in range(12):
        before = energies(state, parameters)
        state, counts = advance_boxes(state, parameters, dt, round(1 / dt), integrator=integrator)
        assert lowest(state, parameters).min() > -1e-8
        assert not counts[1].any()
        # Flight with c = 1 swings by m g^2 dt t/2 within one flight; contact is of first order.
        slack = 1e-3 if integrator == "velocity_verlet" else 0.5 * G * dt * parameters[0] * 5
        assert (energies(state, parameters) <= before + slack * start.max()).all()
    still = ~state[3:].any(axis=0)
    assert still.mean() > 0.98
    turned = state[2, still] / (0.5 * np.pi)
    np.testing.assert_allclose(turned, np.round(turned), atol=1e-12)


def test_resolved_impacts_do_not_depend_on_dt() -> None:
    """Impact times agree to 1e-9 s: then the states after them agree as closely."""
    parameters = box_parameters(restitution=0.8, friction=0.3)
    start = random_states(50, 2)
    ends = []
    for k in (1, 2, 4, 50):
        state, counts = advance_boxes(start, parameters, 0.02 / k, 50 * k, integrator="rk4")
        ends.append((state, counts[0]))
    # A box that has come to slow impacts has met sustained contact, which is of first order.
    few = ends[0][1] <= 3
    assert few.sum() > 10 and (ends[0][1][few] >= 1).sum() > 10
    for state, impacts in ends[1:]:
        assert np.array_equal(impacts[few], ends[0][1][few])
        np.testing.assert_allclose(state[:, few], ends[0][0][:, few], atol=1e-9)


def test_detected_late_is_of_first_order_and_resolved_is_exact() -> None:
    e, drop, end = 0.7, 1.0, 0.8
    t1 = math.sqrt(2 * drop / G)
    u = end - t1
    steps = np.array([20, 40, 80, 160, 320, 640, 1280, 2560, 5120])
    errors = {}
    for resolve in (False, True):
        rms = []
        for n in steps:
            result = []
            # The error depends on where in the step the impact falls: average over that.
            for shift in np.linspace(0, 1, 40, endpoint=False) * end / n:
                y0, v0 = 0.1 + drop - 0.5 * G * shift**2, -G * shift
                state = np.array([[0, y0, 0, 0, v0, 0.0]]).T
                state, _ = advance_boxes(
                    state,
                    box_parameters(restitution=e),
                    end / n,
                    int(n),
                    integrator="velocity_verlet",
                    resolve_impacts=resolve,
                )
                later = u + shift
                result.append(state[1, 0] - (0.1 + e * G * t1 * later - 0.5 * G * later**2))
            rms.append(np.sqrt(np.mean(np.square(result))))
        errors[resolve] = np.array(rms)
    slope = -np.polyfit(np.log(steps[3:]), np.log(errors[False][3:]), 1)[0]
    assert slope == pytest.approx(1.0, abs=0.1)
    assert errors[True].max() < 1e-11


def test_translation_and_mirror_symmetry() -> None:
    start = random_states(40, 3)
    parameters = box_parameters()
    end, counts = advance_boxes(start, parameters, 0.004, 200, integrator="rk4")
    moved = start.copy()
    moved[0] += 64.0
    other, _ = advance_boxes(moved, parameters, 0.004, 200, integrator="rk4")
    np.testing.assert_allclose(other[0] - 64.0, end[0], atol=1e-11)
    assert np.array_equal(other[1:], end[1:])
    sign = np.array([-1.0, 1, -1, -1, 1, -1])[:, None]
    mirrored, mirrored_counts = advance_boxes(
        sign * start, parameters, 0.004, 200, integrator="rk4"
    )
    assert np.array_equal(counts, mirrored_counts)
    np.testing.assert_allclose(sign * mirrored, end, atol=1e-12)


def test_a_batch_equals_its_bodies_one_by_one() -> None:
    rng = np.random.default_rng(4)
    n = 12
    parameters = box_parameters(rng.uniform(0.5, 2, n), friction=rng.uniform(0, 1, n))
    forces = rng.normal(size=(3, n)) * [[0.2], [0.2], [0.01]]
    start = random_states(n, 5)
    retained = start.copy(), parameters.copy(), forces.copy()
    end, counts = advance_boxes(start, parameters, 0.002, 600, forces=forces)
    assert all(map(np.array_equal, retained, (start, parameters, forces)))
    for j in range(n):
        state = start[:, j : j + 1]
        impacts = 0
        for _ in range(600):
            state, c = step_boxes(state, parameters[:, j : j + 1], 0.002, forces=forces[:, j])
            impacts += c[0, 0]
        assert np.array_equal(state[:, 0], end[:, j]) and impacts == counts[0, j]
    body = PlanarBody(mass=parameters[0, 0], friction=parameters[5, 0], state=start[:, 0])
    for _ in range(600):
        body.apply_force(forces[:2, 0])
        body.torque = forces[2, 0]
        body.step(0.002)
    assert np.array_equal(body.state, end[:, 0])


def test_the_same_numbers_without_compilation() -> None:
    code = (
        "import numpy as np, sys\n"
        "from course.rigid_body.planar import advance_boxes, box_parameters\n"
        "s = np.frombuffer(bytes.fromhex(sys.argv[1])).reshape(6, -1)\n"
        "s, c = advance_boxes(s, box_parameters(), 0.005, 300)\n"
        "print(s.tobytes().hex(), c.tobytes().hex())"
    )
    start = random_states(4, 8)
    end, counts = advance_boxes(start, box_parameters(), 0.005, 300)
    out = subprocess.run(
        [sys.executable, "-c", code, start.tobytes().hex()],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert out.stderr == ""
    state, c = (bytes.fromhex(word) for word in out.stdout.split())
    assert np.array_equal(np.frombuffer(c, np.int64).reshape(2, -1), counts)
    np.testing.assert_allclose(np.frombuffer(state).reshape(6, -1), end, rtol=0, atol=1e-12)


# Sustained contact


@pytest.mark.slow
@pytest.mark.parametrize("integrator", FLIGHT_COEFFICIENT)
@pytest.mark.parametrize("quarter", [0, 1, -2, 7])
def test_a_box_at_rest_stays_bit_for_bit(integrator: str, quarter: int) -> None:
    y = 0.1 if quarter % 2 == 0 else 0.15
    start = np.array([[0.3, y, quarter * np.pi / 2, 0, 0, 0]]).T
    # Pushed, so that the shortcut for a box at rest is not what is tested.
    for force in ([0.0, 0.0, 0.0], [1.0, -2.0, 0.05]):
        end, counts = advance_boxes(
            start, box_parameters(), 0.002, 1_000_000, forces=force, integrator=integrator
        )
        assert np.array_equal(end, start)
        assert not counts.any()


@pytest.mark.parametrize("dt", [0.001, 0.0137, 0.05])
def test_sliding_distance(dt: float) -> None:
    friction, speed = 0.4, 2.0
    exact = speed**2 / (2 * friction * G)
    for integrator in FLIGHT_COEFFICIENT:
        body = box(0, 0.1, 0, speed, 0, 0, friction=friction)
        body.step(dt, integrator=integrator)
        assert body.state[3] == pytest.approx(speed - friction * G * dt, rel=1e-12)
        for _ in range(math.ceil(1 / dt)):
            body.step(dt, integrator=integrator)
        assert not body.state[3:].any() and body.state[1] == 0.1 and body.state[2] == 0.0
        first_order = 0.0 if FLIGHT_COEFFICIENT[integrator] == 0.5 else 0.5 * speed * dt
        assert body.state[0] == pytest.approx(exact, abs=1e-12 + 1.01 * first_order)


def test_a_push_moves_the_box_only_beyond_friction() -> None:
    limit = 0.5 * 1.0 * G
    for factor in (0.999, 1.001):
        body = box(0, 0.1, 0, 0, 0, 0, friction=0.5)
        for _ in range(500):
            body.apply_force([factor * limit, 0], body.state[:2] - [0, 0.1])
            body.step(0.002)
        if factor < 1:
            assert np.array_equal(body.state, [0, 0.1, 0, 0, 0, 0])
        else:
            assert body.state[3] == pytest.approx(0.001 * limit, rel=1e-9)


def test_a_push_at_the_top_tips_the_box_only_beyond_its_moment() -> None:
    limit = G * 0.3 / 2 / 0.2
    for factor in (0.999, 1.001):
        body = box(0, 0.1, 0, 0, 0, 0, friction=5.0)
        for _ in range(400):
            body.apply_force([factor * limit, 0], [0.0, 0.2])
            body.step(0.002)
        if factor < 1:
            assert np.array_equal(body.state, [0, 0.1, 0, 0, 0, 0])
        else:
            assert body.state[2] < -1e-4 and body.state[5] < 0


def test_a_box_on_its_corner_falls_like_a_pendulum_and_comes_to_rest() -> None:
    """Against the inverted pendulum about a corner that sticks, integrated by scipy."""
    w, h = 0.3, 0.2
    radius, inertia = 0.5 * math.hypot(w, h), (w * w + h * h) / 12
    arm = math.pi - math.atan2(h, w)  # direction from the lower right corner to the centre
    angle0 = math.pi / 2 - 0.1 - arm  # leans 0.1 rad past the vertical

    def rate(t, z):
        return [z[1], -G * radius * math.cos(arm + z[0]) / (inertia + radius**2)]

    t = 0.2
    want = solve_ivp(rate, (0, t), [angle0, 0.0], rtol=1e-11, atol=1e-12).y[:, -1]
    assert angle0 - 0.05 > want[0] > -math.pi / 2
    # Of first order in dt = 0.2 ms; (angle, rate, slip of the foot).
    for integrator, tolerance in (
        ("velocity_verlet", (4e-5, 6e-4, 2e-9)),
        ("semi_implicit_euler", (2e-4, 6e-6, 4e-7)),
    ):
        body = box(
            radius * math.cos(arm + angle0),
            radius * math.sin(arm + angle0),
            angle0,
            0,
            0,
            0,
            friction=5.0,
            restitution=0.3,
        )
        for _ in range(1000):
            body.step(t / 1000, integrator=integrator)
        assert abs(body.state[2] - want[0]) < tolerance[0]
        assert abs(body.state[5] - want[1]) < tolerance[1]
        foot = body.corners()[:, np.argmin(body.corners()[1])]
        np.testing.assert_allclose(foot, [0, 0], atol=tolerance[2])
        for _ in range(3000):
            body.step(0.001, integrator=integrator)
        assert not body.state[3:].any()
        assert body.state[2] / (math.pi / 2) == pytest.approx(-1.0, abs=1e-12)
        assert body.state[1] == 0.15 and body.unresolved == 0


def test_a_pivoting_box_never_turns_through_its_face() -> None:
    tilts = np.concatenate([np.geomspace(1e-13, 1e-3, 60), -np.geomspace(1e-13, 1e-3, 60)])
    parameters = box_parameters(width=1.9, height=0.17, friction=1.0, restitution=0.0)
    angle = np.pi + tilts
    half = 0.95 * np.abs(np.sin(angle)) + 0.085 * np.abs(np.cos(angle))
    omega = -np.sign(tilts) * 2e-3
    rx, ry = np.array([planar_contact.lowest_corners(a, 1.9, 0.17)[:2] for a in angle]).T
    state = np.array([0 * tilts, half, angle, omega * ry, -omega * rx, omega])
    for _ in range(300):
        state, counts = step_boxes(state, parameters, 0.002, integrator="rk4")
        assert ((state[2] - np.pi) * np.sign(tilts) > -1e-12).all()
        assert lowest(state, parameters).min() > -1e-9
        assert not counts[1].any()
    assert not state[3:].any()


# Limits and errors


def test_too_many_impacts_in_a_step_are_reported() -> None:
    """Without a rest speed a box has infinitely many bounces before it rests."""
    body = box(0, 0.1 + 1e-4, 0, 0, 0, 0, restitution=0.9, rest_speed=0.0)
    for _ in range(10):
        body.step(0.05, integrator="rk4")
    assert body.unresolved == 1
    assert np.array_equal(body.state, [0, 0.1, 0, 0, 0, 0])


def test_without_ground_the_box_falls_through() -> None:
    body = box(0, 0.5, 0, 0, 0, 1, ground=False)
    for _ in range(100):
        body.step(0.01, gravity=[0.0, -2.0], integrator="rk4")
    np.testing.assert_allclose(body.state, [0, -0.5, 1, 0, -2, 1], atol=1e-13)
    assert body.impacts == 0


def test_energy_and_corners() -> None:
    body = box(1, 2, np.pi / 2, 3, 4, 5, mass=2.0)
    kinetic, potential, total = body.energy(10.0)
    assert kinetic == pytest.approx(25 + 0.5 * 2 * (0.3**2 + 0.2**2) / 12 * 25)
    assert potential == 40 and total == kinetic + potential
    want = [[1.1, 1.1, 0.9, 0.9], [1.85, 2.15, 2.15, 1.85]]
    np.testing.assert_allclose(body.corners(), want, atol=1e-15)
    assert body.energy([0.0, -10.0]) == body.energy(10.0)


@pytest.mark.parametrize(
    "name, value",
    [
        ("mass", 0.0),
        ("mass", -1.0),
        ("mass", math.nan),
        ("width", 0.0),
        ("height", math.inf),
        ("inertia", -1.0),
        ("friction", -0.1),
        ("restitution", 1.1),
        ("restitution", -0.1),
        ("rest_speed", -1.0),
        ("state", np.zeros(5)),
        ("state", np.full(6, math.nan)),
    ],
)
def test_bad_parameters_are_named(name: str, value: Any) -> None:
    arguments: dict[str, Any] = {name: value}
    with pytest.raises(ValueError, match=name):
        PlanarBody(**arguments)


def test_bad_arguments_are_named() -> None:
    body = PlanarBody()
    for dt in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match="dt"):
            body.step(dt)
    with pytest.raises(ValueError, match="integrator"):
        body.step(0.01, integrator="euler")
    with pytest.raises(ValueError, match="gravity"):
        body.step(0.01, gravity=[0, math.nan])
    with pytest.raises(ValueError, match="force"):
        body.apply_force([1, 2, 3])
    with pytest.raises(ValueError, match="point"):
        body.apply_force([1, 2], [math.nan, 0])
    good = random_states(3, 0)
    with pytest.raises(ValueError, match="state"):
        step_boxes(good[:5], body.parameters, 0.01)
    with pytest.raises(ValueError, match="parameters"):
        step_boxes(good, np.ones((7, 2)), 0.01)
    with pytest.raises(ValueError, match="forces"):
        step_boxes(good, body.parameters, 0.01, forces=np.ones((3, 2)))
    with pytest.raises(ValueError, match="shapes"):
        box_parameters(mass=[1, 2], width=[1, 2, 3])
    good[4, 1] = math.nan
    with pytest.raises(ValueError, match="box 1"):
        step_boxes(good, body.parameters, 0.01)
    bad = box_parameters(mass=[1.0, 1.0, 1.0])
    bad[4, 2] = 2.0
    with pytest.raises(ValueError, match="box 2"):
        step_boxes(random_states(3, 0), bad, 0.01)
    assert planar.PARAMETERS[4] == "restitution"


def test_attributes_may_be_set_and_are_checked() -> None:
    body = box(0, 5, 0, 0, 0, 0)
    body.mass = 10.0
    assert body.moment == pytest.approx(10.0 * box(0, 5, 0, 0, 0, 0).moment)
    written: Any = [0, 5, 0, 0, 0, 0]  # a list, as a reader might write it
    body.state = written
    body.step(1e-3)
    body.state = np.zeros(5)
    with pytest.raises(ValueError, match=r"state.shape must be .*, got \(5,\)"):
        body.step(1e-3)
