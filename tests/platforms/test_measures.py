"""Measures and closed forms: against hand-made runs whose answer is known, and against engines."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.oracles.engines import engines
from course.oracles.mujoco_scenes import MuJoCo
from course.platforms import (
    AS_SHIPPED,
    FAIR,
    NO_CONTACTS,
    SCENES,
    Engine,
    Run,
    State,
    prepared,
    theory,
)
from course.platforms import measures as m
from course.platforms.scenes import GRAVITY, brake, slope, tower
from tests.budget import examples

OWN, MUJOCO = (engines()[name] for name in ("own code", "MuJoCo"))


class Stated(Run):
    """A run whose state is told by a function of (step, times put back)."""

    def __init__(self, scene, dt, path) -> None:
        self.scene, self.dt, self.path, self.steps, self.resets = scene, dt, path, 0, 0

    def advance(self, steps):
        self.steps += steps

    def state(self):
        start = self.scene.start
        shift = self.path(self.steps * self.dt, self.resets)
        return State(self.steps * self.dt, start.q + shift, start.v)

    def energy(self):
        return float(np.sum(self.path(self.steps * self.dt, self.resets)))

    def set_velocity(self, v):
        pass

    set_torque = set_velocity

    def reset(self):
        self.steps, self.resets = 0, self.resets + 1

    def save(self):
        return self.steps

    def restore(self, saved):
        self.steps = saved


class Teller(Engine):
    name, schemes = "teller", ("told",)

    def __init__(self, path) -> None:
        self.path = path

    def missing(self):
        return ""

    def build(self, scene, dt, settings=FAIR):
        return Stated(scene, dt, self.path)


def up(rate):
    """Everything rises at a rate [m/s]."""
    shift = np.zeros((7, 1))
    shift[2] = 1.0
    return lambda time, resets: rate * time * shift


# --- measures with a known answer -----------------------------------------------------------------


def test_an_exponent() -> None:
    x = np.array([1.0, 2.0, 5.0])
    assert m.slope(x, 3.0 * x**1.7) == pytest.approx(1.7)
    with pytest.raises(ValueError, match="two equal sizes"):
        m.slope([1.0], [1.0])
    with pytest.raises(ValueError, match="y"):
        m.slope([1.0, 2.0], [1.0, 0.0])


def test_position_error() -> None:
    assert m.position_error(Teller(up(0.01)), tower(1), 1e-2) == pytest.approx(0.01)
    # 0.7 s don't fit into 1 s: judged at the time that it reached.
    falls = replace(SCENES["drop"](1.0, 1.0))
    g = np.zeros((7, 1))
    g[2] = -0.5 * GRAVITY
    assert m.position_error(Teller(lambda t, _: g * min(t * t, 2 / GRAVITY)), falls, 0.7) < 1e-12


def test_drift_and_swing_are_told_apart() -> None:
    def path(t, resets):
        return np.full((7, 1), (0.3 * t + 0.02 * math.sin(2.0 * math.pi * 10.0 * t)) / 7.0)

    result = m.energy_drift(Teller(path), tower(1), 1e-2)
    assert result.rate == pytest.approx(0.3, abs=5e-3)
    assert result.swing == pytest.approx(0.02, rel=0.1)
    assert result.change == pytest.approx(0.3)


def test_creep_is_a_speed() -> None:
    assert m.creep(Teller(up(2e-3)), slope(), 1e-2) == pytest.approx(2e-3)


def test_largest_step_needs_all_smaller_ones() -> None:
    class Odd(Teller):
        def build(self, scene, dt, settings=FAIR):
            good = dt < 3e-3 or 6e-3 < dt < 9e-3  # a lucky one is no step to use
            return Stated(scene, dt, up(0.0 if good else 1.0))

    steps = [1e-3, 2e-3, 4e-3, 8e-3, 1.6e-2]
    assert m.largest_step(Odd(None), tower(1), steps) == 2e-3
    assert m.largest_step(Teller(up(1.0)), tower(1), steps) == 0.0


def test_what_a_reset_leaves_behind_is_seen() -> None:
    def path(t, resets):
        return np.full((7, 1), t * (1.0 + 1e-15 * resets))

    result = m.repeatability(Teller(path), tower(1), 1e-2, 40)
    assert result.fresh == result.saved == 0.0 and 0.0 < result.reset < 1e-14


@pytest.mark.parametrize("name", ["chain", "tower", "brake"])
def test_own_code_and_mujoco_repeat_bit_by_bit(name: str) -> None:
    for engine, steps in ((OWN, 10), (MUJOCO, 200)):
        assert m.repeatability(engine, SCENES[name](), 1e-3, steps) == m.Repeat(0.0, 0.0, 0.0)


# --- forces, judged by chapter 2 ------------------------------------------------------------------


def test_own_forces_are_coulomb_s_and_mujoco_s_are_soft() -> None:
    own = m.judged(OWN, brake(0.3), 1e-3, 5)
    assert own.unexplained < 1e-14 and own.contacts == 4
    remaining = own.residuals
    assert (
        max(remaining.penetration, remaining.cone, remaining.dissipation, remaining.signorini)
        < 1e-9
    )
    soft = m.judged(MUJOCO, slope(), 1e-3, 50, AS_SHIPPED)
    assert soft.unexplained < 1e-14  # it tells the forces that it applied
    assert soft.residuals.cone < 1e-12
    assert soft.residuals.penetration > 1e-6 and soft.residuals.signorini > 1e-4
    hard = m.judged(MUJOCO, slope(), 1e-3, 50)
    for name in ("penetration", "signorini", "dissipation"):
        assert getattr(hard.residuals, name) < 0.5 * getattr(soft.residuals, name), name


def test_forces_that_did_not_act_are_found_out() -> None:
    class Liar(MuJoCo):
        def build(self, scene, dt, settings=FAIR):
            run = super().build(scene, dt, settings)
            report = run.contacts
            run.contacts = lambda: replace(report(), force=1.5 * report().force)  # type: ignore
            return run

    result = m.judged(Liar(), slope(), 1e-3, 50)
    assert result.unexplained > 0.4 * GRAVITY * 1e-3


def test_where_nothing_touches_there_is_nothing_to_judge() -> None:
    with pytest.raises(ValueError, match="after which something touches"):
        m.judged(OWN, SCENES["drop"](), 1e-3, 2)


# --- the braking law ------------------------------------------------------------------------------


@given(speed=st.floats(0.5, 5.0), mu=st.floats(0.1, 1.0), dt=st.floats(1e-4, 5e-3))
@examples(50)
def test_braking_distance_is_the_sum_of_the_steps(speed, mu, dt) -> None:
    v, x = speed, 0.0
    while (v := v - mu * GRAVITY * dt) > 0.0:
        x += v * dt
    assert theory.braking_distance(speed, mu, dt) == pytest.approx(x, abs=mu * GRAVITY * dt * dt)
    true = theory.braking_distance(speed, mu)
    law = true * (1.0 - theory.stopped_short(speed, mu, dt))
    assert abs(x - law) <= 0.126 * mu * GRAVITY * dt * dt + 1e-12


@pytest.mark.slow
def test_a_braking_block_stops_where_the_sum_says() -> None:
    for dt in (8e-3, 1.6e-2):
        result = m.stop(OWN, 0.0, dt)
        assert result.distance == pytest.approx(theory.braking_distance(dt=dt), rel=1e-6)
        assert abs(result.turn) < 1e-9
    true = theory.braking_distance()
    shares = [1.0 - m.stop(MUJOCO, 0.0, dt).distance / true for dt in (1e-3, 2e-3, 4e-3)]
    laws = [theory.stopped_short(dt=dt) for dt in (1e-3, 2e-3, 4e-3)]
    np.testing.assert_allclose(shares, laws, rtol=0.03)
    # Both sides of a tolerance of 0.5 %: mu g dt / v says 2.04 ms.
    edge = 0.005 * 2.0 / (0.5 * GRAVITY)
    inside, outside = (
        1.0 - m.stop(MUJOCO, 0.0, share * edge).distance / true for share in (0.95, 1.1)
    )
    assert inside < 0.005 < outside


def test_the_extremes_of_the_cones() -> None:
    full = theory.braking_distance()
    angles = np.radians([0.0, 45.0, 90.0, 135.0])
    for cone, factor in (("circle", 1.0), ("inscribed", math.sqrt(2)), ("box", math.sqrt(0.5))):
        distance, turn = theory.stop(angles, cone)
        np.testing.assert_allclose(distance, full * np.array([1, factor, 1, factor]))
        np.testing.assert_allclose(turn, 0.0, atol=1e-12)


# --- creep and the grasp --------------------------------------------------------------------------


def creeping(angle: float, **softness) -> tuple[float, float]:
    """MuJoCo's speed on a slope, and the law's, from the load and the gap that it reports."""
    scene, settings = slope(angle, duration=0.5), FAIR.using(**softness)
    run = prepared(MUJOCO, scene, 1e-3, settings)
    run.run(400)
    report = run.contacts()
    loads = np.linalg.norm(report.tangential_force, axis=0)
    law = theory.creep_speed(float(loads[0]), float(report.gap[0]), 1.0, 0.5, 1e-3, **softness)
    return m.creep(MUJOCO, scene, 1e-3, settings), law


@pytest.mark.parametrize("cone", ["elliptic", "pyramidal"])
def test_creep_is_compliance_times_load_over_damping(cone: str) -> None:
    soft = {"cone": cone, "solref": (0.02, 1.0), "solimp": (0.9, 0.95, 0.001, 0.5, 2.0)}
    speeds = []
    for ratio in (1.0, 10.0):
        measured, law = creeping(0.1, impratio=ratio, **soft)
        assert measured == pytest.approx(law, rel=1e-6)
        speeds.append(measured)
    assert speeds[0] / speeds[1] == pytest.approx(10.0, rel=2e-2)


def test_the_law_of_creep_ends_where_an_edge_of_the_pyramid_lets_go() -> None:
    measured, law = creeping(
        0.3, cone="pyramidal", impratio=1.0, solref=(0.02, 1.0), solimp=(0.9, 0.95, 0.001, 0.5, 2.0)
    )
    assert measured > 1.2 * law


def test_the_noslip_pass_stops_the_creep() -> None:
    scene = slope(0.1, duration=0.5)
    speeds = [
        m.creep(MUJOCO, scene, 1e-3, AS_SHIPPED.using(noslip_iterations=n)) for n in (0, 1, 3)
    ]
    assert speeds[0] > 1e-4 and speeds[1] < 0.3 * speeds[0] and speeds[2] < 0.01 * speeds[0]


def test_the_grasp_holds_from_m_g_over_2_mu_on() -> None:
    for settings in (AS_SHIPPED, FAIR):
        assert m.grasp_limit(MUJOCO, 1e-3, settings) == pytest.approx(0.996, abs=3e-3)
    held, sink = m.squeezed(MUJOCO, 0.98, 1e-3)
    assert not held and sink == pytest.approx(0.5 * 0.02 * GRAVITY * 0.5**2, rel=0.05)
    assert m.squeezed(MUJOCO, 1.2, 1e-3)[0]
    assert theory.grasp_threshold(0.2, 0.5) == pytest.approx(0.2 * GRAVITY)


def test_gauss_seidel_holds_the_part_and_lets_it_turn() -> None:
    """Its answer is one of Coulomb's, with all force on one corner; Newton's spreads it evenly."""
    spins = {}
    for model in ("pgs", "coulomb"):
        run = prepared(OWN, SCENES["grasp"](), 1e-3, FAIR.using(model=model))
        run.run(20)
        spins[model] = float(np.max(np.abs(run.state().v[3:, 0])))
    assert spins["coulomb"] < 1e-6 < 1e-1 < spins["pgs"]


# --- changes and the reach ------------------------------------------------------------------------


def test_the_effect_of_each_change() -> None:
    result = {effect.key: effect for effect in m.effects(MUJOCO, slope(), 2e-3)}
    assert set(result) == {"cone", "impratio", "solref", "solimp", "autoreset"}
    for key in ("cone", "impratio", "solref", "solimp"):
        assert result[key].alone < result[key].shipped and result[key].without > result[key].fair
    assert result["autoreset"].alone == result["autoreset"].shipped
    joints = m.effects(MUJOCO, SCENES["chain"](), 1e-3)
    assert [effect.key for effect in joints] == ["autoreset", "constraint"]
    assert all(effect.without == effect.fair == effect.shipped for effect in joints)


def test_a_reach_without_a_motion_is_none() -> None:
    stuck = m.reach(Teller(lambda t, _: np.zeros(7)), 1e-2)
    assert not stuck.success and stuck.error > 0.1


@pytest.mark.slow
def test_a_block_that_hops_is_seen_on_its_way_and_not_at_its_end() -> None:
    """MuJoCo's own count of contacts, step by step, is the truth."""
    scene, dt = brake(), 1e-3
    moving = scene.duration / 1.5
    run: Any = prepared(MUJOCO, scene, dt)
    without, rise = 0, 0.0
    for _ in range(round(moving / dt)):
        run.run(1)
        without += int(run.data.ncon == 0)
        rise = max(rise, float(run.state().q[2, 0] - scene.start.q[2, 0]))
    one = m.path_error(MUJOCO, scene, dt, moving=moving)
    assert one.airborne == pytest.approx(without / round(moving / dt), abs=0.02)
    assert one.airborne > 0.6
    assert one.largest >= rise > 4e-3
    assert one.final == m.position_error(MUJOCO, scene, dt) < 2e-3
    assert m.path_error(MUJOCO, scene, dt, FAIR.using(but=("solref",))).largest < 0.3 * one.largest
    own = m.path_error(OWN, scene, 4e-3)
    assert own.airborne == 0.0 and own.largest == pytest.approx(own.final, rel=1e-6)


@pytest.mark.slow
def test_the_error_of_a_path_is_the_largest_of_the_errors_on_it() -> None:
    class Bump(Stated):
        def contacts(self):
            return NO_CONTACTS

    class Engine_(type(OWN)):
        def build(self, scene, dt, settings=FAIR):
            up = np.zeros((7, 1))
            up[2] = 0.03
            return Bump(scene, dt, lambda t, _: up * (abs(t - 0.5) < 0.1) + 0.01 * up * (t > 0.9))

    scene = replace(slope(0.1, 0.5), settle=0.0)
    one = m.path_error(Engine_(), scene, 0.01)  # pyrefly: ignore[bad-instantiation]
    assert (one.final, one.largest) == (pytest.approx(3e-4), pytest.approx(0.03))
    assert one.airborne == 1.0
    with pytest.raises(ValueError, match="moving"):
        m.path_error(OWN, brake(), 1e-3, moving=10.0)
    smooth = m.path_error(MUJOCO, SCENES["chain"](2, 0.5), 1e-3, samples=7)
    assert smooth.airborne == 0.0 and smooth.largest >= smooth.final > 0.0
