"""The worked answers of chapter 3 against small steps, real engines and trying everything."""

from fractions import Fraction
from itertools import permutations

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.platforms import theory
from course.platforms.choose import Fact, Need, choose
from drills import cards
from solutions import platforms as solutions
from tests.budget import examples


def rngs():
    return st.integers(0, 2**32 - 1).map(np.random.default_rng)


# --- a braking block ------------------------------------------------------------------------------


def nearest(shape, p):
    """The point of a convex set of radius 1 nearest to p: circle, diamond, square."""
    if shape == 0:
        return p / max(np.linalg.norm(p), 1.0)
    if shape == 2:
        return np.clip(p, -1.0, 1.0)
    large, small = np.sort(np.abs(p))[::-1]
    if large + small <= 1.0:
        return p
    cut = (large + small - 1.0) / 2.0 if large - small <= 1.0 else large - 1.0
    return np.sign(p) * np.maximum(np.abs(p) - cut, 0.0)


@examples(10)
@given(rngs())
def test_the_stops_are_those_of_small_implicit_steps(rng):
    """Each step's impulse is the one nearest to what would stop the block, within the shape."""
    speed, mu, frame = rng.uniform([1.0, 0.3, -2.0], [3.0, 0.9, 2.0])
    angle, dt = rng.uniform(-3.1, 3.1), 5e-4
    distance, turned = solutions.sliding_stop(speed, angle, frame, mu)
    for shape in range(3):
        v = speed * np.array([np.cos(angle - frame), np.sin(angle - frame)])
        start, x, largest = v.copy(), np.zeros(2), 9.81 * mu * dt
        while v.any():
            v = v - largest * nearest(shape, v / largest)
            x = x + dt * v
        a = np.arctan2(start[0] * x[1] - start[1] * x[0], start @ x)
        np.testing.assert_allclose(np.linalg.norm(x), distance[shape], atol=2.0 * speed * dt)
        np.testing.assert_allclose(a, turned[shape], atol=5e-3)


@examples(20)
@given(rngs())
def test_the_stops_are_those_of_the_laws_that_claims_set_beside_the_engines(rng):
    speed, mu, heading, frame = rng.uniform([1.0, 0.3, -3.0, -2.0], [3.0, 0.9, 3.0, 2.0])
    result = np.transpose(solutions.sliding_stop(speed, heading, frame, mu))
    laws = [theory.stop(heading - frame, cone, speed, mu) for cone in theory.CONES]
    np.testing.assert_allclose(result, laws, atol=1e-12)


# --- drift and swing ------------------------------------------------------------------------------


@pytest.mark.parametrize("h", [0.05, 0.2, 0.5])
def test_the_energy_of_a_symplectic_step_swings_and_does_not_drift(h):
    """Semi-implicit Euler of an oscillator of rate 1 keeps v^2 + x^2 - h x v."""
    rate, n = 2.0 * np.arcsin(h / 2.0) / h, 240
    x, v, energy = 1.0, 0.5, []
    retained = (v**2 + x**2 - h * x * v) / 2.0
    for _ in range(n):
        energy.append((v**2 + x**2) / 2.0)
        v -= h * x
        x += h * v
    drift, swing = solutions.energy_drift(h * np.arange(n), energy, np.pi / rate)
    assert abs(drift) < 1e-13
    np.testing.assert_allclose(swing, h / 2.0 * retained / (1.0 - h**2 / 4.0) / 2**0.5, rtol=1e-10)


@examples(10)
@given(rngs(), st.floats(2.0, 6.0))
def test_the_swing_is_that_of_a_period_sampled_finely(rng, periods):
    """Smooth products of the phase, whose harmonics nobody wrote down."""
    a, b, drift = rng.normal(size=3)

    def swing(phase):
        return np.cos(phase + a) ** 3 + b * np.sin(phase) * np.cos(phase + 1.0)

    t = 0.7 * np.sort(rng.uniform(0.0, periods, 300))
    energy = 5.0 + drift * t + swing(2.0 * np.pi * t / 0.7)
    whole = swing(2.0 * np.pi * np.arange(64) / 64)
    result = solutions.energy_drift(t, energy, 0.7)
    np.testing.assert_allclose(result, (drift, whole.std()), atol=1e-10)


SPRING = """<mujoco><option timestep="{}" gravity="0 0 0"><flag energy="enable" contact="disable"
eulerdamp="disable"/></option><worldbody><body><joint type="slide" stiffness="{}" damping="{}"/>
<geom type="sphere" size=".1" mass="1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("damping", [0.0, 1e-5])
def test_the_drift_is_what_mujocos_damping_takes(damping):
    h, rate = 0.002, 10.0
    model = mujoco.MjModel.from_xml_string(SPRING.format(h, rate**2, damping))
    data, energy = mujoco.MjData(model), []
    data.qvel[0] = 1.0
    for _ in range(2000):
        mujoco.mj_forward(model, data)
        energy.append(data.energy.sum())
        mujoco.mj_step(model, data)
    period = np.pi * h / 2.0 / np.arcsin(h * rate / 2.0)
    drift, swing = solutions.energy_drift(h * np.arange(2000), energy, period)
    np.testing.assert_allclose(drift, -0.5 * damping, rtol=0.01, atol=1e-11)
    np.testing.assert_allclose(swing, 0.5 * h * rate / 2.0 / 2**0.5, rtol=0.01)
    assert abs(energy[-1] - energy[0]) / (2000 * h) > 50.0 * abs(drift)  # what two samples say


# --- a loaded model -------------------------------------------------------------------------------


def test_what_mujoco_loads_is_what_its_file_says_and_a_change_is_found():
    """MuJoCo diagonalises and orders its bodies depth first; the file's links stand otherwise."""
    rng = np.random.default_rng(0)
    masses, rods = 10.0 ** rng.uniform(-3.0, 1.0, 6), rng.uniform(1e-3, 1e-2, (6, 3))
    inertias: list[np.ndarray] = []
    for mass, rod in zip(masses, rods, strict=True):
        Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        Q = np.eye(3) if not inertias else Q  # the first along its own axes
        inertias.append(mass * Q @ np.diag(rod.sum() - rod) @ Q.T)
    names = [f"link{k}" for k in range(6)]

    def link(k, inner=""):
        upper = inertias[k][[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        full, mass = " ".join(map(str, upper.tolist())), str(masses[k])
        return (
            f'<body name="{names[k]}"><joint/><inertial pos=".1 .2 0" mass="{mass}" '
            f'fullinertia="{full}"/>{inner}</body>'
        )

    tree = link(3, link(0) + link(5, link(1))) + link(4) + link(2)
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{tree}</worldbody></mujoco>")
    ids = np.arange(6) + 10
    other = [model.body(k).name for k in range(model.nbody)]
    assert other[1:] != names
    loaded_ids = np.array([10 + names.index(one) if one in names else 0 for one in other])

    def faults(tolerance=1e-6):
        body = model.body_mass, model.body_inertia, model.body_iquat
        return solutions.audit_model(ids, masses, inertias, loaded_ids, *body, tolerance).tolist()

    assert faults() == [0] * 6
    model.body("link1").mass[0] *= 1.001
    model.body("link4").inertia[:] *= 0.999
    model.body("link2").iquat[:] = [1.0, 0.0, 0.0, 0.0]
    loaded_ids[other.index("link5")] = 99
    assert faults() == [0, 1, 2, 0, 2, 4]
    assert faults(tolerance=0.01) == [0, 0, 2, 0, 0, 4]
    model.body("link4").mass[0] *= 1.001
    assert faults()[4] == 3
    retained, turned = model.body("link0").iquat.copy(), np.zeros(4)
    for angle, fault in ((1e-7, 0), (2e-3, 2)):  # the diagonal changes by the square
        small = np.r_[np.cos(angle / 2.0), np.sin(angle / 2.0) * np.ones(3) / 3**0.5]
        mujoco.mju_mulQuat(turned, small, retained)
        model.body("link0").iquat[:] = turned
        assert faults(tolerance=2e-5 if fault else 1e-6)[0] == fault


# --- charts and picks -----------------------------------------------------------------------------


@examples(30)
@given(rngs(), st.integers(3, 6))
def test_the_areas_are_those_of_all_polygons_by_their_corners(rng, n):
    """The shoelace formula over all orders, those that are turns of one another included."""
    share, ends = rng.uniform(-0.2, 1.2, n), 10.0 ** rng.uniform(-3.0, 3.0, (2, n))
    radius = np.clip(share, 0.0, 1.0)
    turn = 2.0 * np.pi / n * np.arange(n)
    areas = []
    for order in permutations(range(n)):
        x, y = radius[list(order)] * np.cos(turn), radius[list(order)] * np.sin(turn)
        areas.append((x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0)
    result = solutions.radar_areas(ends[0] * (ends[1] / ends[0]) ** share, *ends)
    np.testing.assert_allclose(result, (min(areas), max(areas)), atol=1e-11)


@examples(50)
@given(rngs(), st.floats(0.3, 3.0))
def test_the_pick_is_that_of_the_chapters_table(rng, spare):
    """`choose` tries every limit at every value of its row, and just beyond it."""
    facts, limits = 10.0 ** rng.normal(size=(5, 3)), 10.0 ** rng.normal(size=3)
    larger, cost = rng.integers(0, 2, 3), 10.0 ** rng.normal(size=5)
    limits *= np.where(larger, 0.2, 5.0) ** spare
    facts[rng.uniform(size=(5, 3)) < 0.1] = np.nan
    cost[rng.uniform(size=5) < 0.1] = np.nan
    rows = [f"row {k}" for k in range(3)]
    table = {
        str(i): {row: Fact(value) for row, value in zip(rows, facts[i], strict=True)}
        | {"cost": Fact(cost[i])}
        for i in range(5)
    }
    senses = ["at least" if one else "at most" for one in larger]
    needs = [Need(*pair) for pair in zip(rows, limits, senses, strict=True)]
    right = choose(table, needs, "cost")
    pick, need, factor = solutions.pick_engine(facts, limits, larger, cost)
    assert pick == int(right.pick or -1)
    if right.turn is None:
        assert (need, factor) == (-1, 0.0)
    else:
        assert rows[need] == right.turn.row
        np.testing.assert_allclose(factor, right.turn.factor, rtol=1e-12)


def test_a_need_that_is_met_exactly_is_met():
    assert solutions.pick_engine([[2.0, 8.0]], [2.0, 16.0], [1, 0], [1.0]) == (0, 0, 1.0)


# --- the hunt -------------------------------------------------------------------------------------


@examples(8)
@given(st.floats(0.2, 0.8), st.floats(0.5, 3.0), st.floats(0.5, 5.0), st.floats(-900.0, 900.0))
def test_the_fair_comparison_is_the_closed_form_of_the_scheme(mu, block, plank, place):
    """Sliding: late by half a step each; sticking: the energy of an inelastic impact is gone."""
    speed, steps, slowing = 2.0, np.array([0.001, 0.004]), 9.81 * mu
    stuck = speed / slowing / (1.0 + block / plank)
    times = 0.004 * np.arange(1, 200)
    slide = times[times < 0.95 * stuck]
    args = mu, [block, plank], place, speed, steps
    distance, gained = solutions.compare_engines(*args, slide)
    np.testing.assert_allclose(distance, -0.5 * slowing * slide * (steps[1] - steps[0]), atol=1e-10)
    t, pushed = slide[-1], block / plank * slowing * slide[-1]
    energy = (block * (speed - slowing * t) ** 2 + plank * pushed**2 - block * speed**2) / 2.0
    np.testing.assert_allclose(gained, [energy, energy], rtol=1e-9)
    _, gained = solutions.compare_engines(*args, np.array([0.004 * round(1.5 * stuck / 0.004)]))
    lost = -0.5 * block * plank / (block + plank) * speed**2
    np.testing.assert_allclose(gained, [lost, lost], rtol=1e-9)


def test_the_starter_of_the_hunt_agrees_where_its_author_looked_and_only_there():
    names: dict = {}
    exec(cards.card("compare_engines").starter(), names)

    def deviation(mu=1.0, plank=1e6, place=0.0, steps=(0.01, 0.01), last=0.1):
        args = mu, [1.0, plank], place, 4.0, np.array(steps), np.array([last])
        pairs = zip(names["compare_engines"](*args), solutions.compare_engines(*args), strict=True)
        return [float(np.abs(got - right).max()) for got, right in pairs]

    assert deviation()[0] < 2e-3
    assert deviation(mu=0.4)[0] > 5e-3 and deviation(steps=(0.01, 0.02))[0] > 1e-3
    assert deviation(plank=1.0)[1] > 3.0 * deviation()[1]
    both = {"steps": (0.01, 0.02)}
    assert deviation(place=1e6, **both)[0] > deviation(**both)[0] + 0.01


def test_the_factor_is_simulated_time_by_time_on_the_clock():
    """By exact fractions, robot by robot; equal runs have the factor of each."""
    step, steps = [Fraction(1, 500), Fraction(1, 100)], [1000, 300]
    copies, wall = [3, 1], [Fraction(3, 2), Fraction(12)]
    simulated = [
        sum((h * n for _ in range(c)), Fraction(0))
        for h, n, c in zip(step, steps, copies, strict=True)
    ]
    factor, total = solutions.real_time_factor(
        [float(h) for h in step], steps, copies, [float(w) for w in wall]
    )
    assert factor == pytest.approx([float(s / w) for s, w in zip(simulated, wall, strict=True)])
    assert total == pytest.approx(float(sum(simulated) / sum(wall)))
    same, whole = solutions.real_time_factor([0.01] * 5, [100] * 5, [8] * 5, [2.0] * 5)
    assert whole == pytest.approx(same[0]) == pytest.approx(4.0)
