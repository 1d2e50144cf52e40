"""Domain randomisation, against models compiled anew, closed forms and measured motion."""

import copy
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import special, stats

from course.drills import DomainRandomizer
from course.oracles.mujoco import randomize as oracle
from tests.budget import examples

N = 400  # draws of a distribution test
RARE = 1e-4  # seeds are fixed, so that a test of a distribution passes or fails for good


def scene(xml: str = oracle.SCENE) -> tuple[Any, Any]:
    model = mujoco.MjModel.from_xml_string(xml)
    return model, mujoco.MjData(model)


def bytes_of(model: Any) -> dict[str, bytes]:
    return {name: value.tobytes() for name, value in oracle.arrays(model).items()}


def factors(model: Any, default: Any) -> np.ndarray:
    """The mass factor of each body; 1 where there is no mass."""
    one = np.ones(model.nbody)
    return np.divide(model.body_mass, default.body_mass, out=one, where=default.body_mass > 0.0)


# --- Masses, inertias and what follows from them --------------------------------------------------


@given(seed=st.integers(0, 2**32 - 1))
@examples(25)
def test_every_array_is_that_of_a_model_compiled_with_the_new_values(seed: int) -> None:
    model, data = scene()
    default = copy.copy(model)
    DomainRandomizer(model).randomize(data, np.random.default_rng(seed))
    truth = oracle.recompiled(
        oracle.SCENE,
        factors(model, default),
        friction=model.geom_friction[0, 0],
        damping=model.dof_damping[model.jnt_dofadr],
    )
    ours, theirs = oracle.arrays(model), oracle.arrays(truth)
    assert ours.keys() == theirs.keys()
    for name in ours:
        if ours[name].dtype.kind == "f":
            np.testing.assert_allclose(ours[name], theirs[name], rtol=1e-12, atol=1e-15)
        else:
            np.testing.assert_array_equal(ours[name], theirs[name])
    assert oracle.worst_constant(model, truth)[0] < 1e-13
    assert oracle.worst_constant(default, truth)[0] > 1e-3  # what it would be without mj_setConst


def test_exactly_these_arrays_change() -> None:
    model, data = scene()
    before = bytes_of(model)
    DomainRandomizer(model).randomize(data, np.random.default_rng(1))
    after = bytes_of(model)
    primary = {"body_inertia", "body_mass", "dof_damping", "geom_friction", "pair_friction"}
    assert {k for k in before if before[k] != after[k]} == primary | set(oracle.DERIVED)
    default = mujoco.MjModel.from_xml_string(oracle.SCENE)
    assert np.array_equal(model.geom_friction[:, 1:], default.geom_friction[:, 1:])
    assert np.array_equal(model.pair_friction[:, 2:], default.pair_friction[:, 2:])


def test_a_damping_ratio_is_resolved_when_the_model_is_compiled() -> None:
    """The one array that a model compiled anew has otherwise: it is a gain, which stays."""
    xml = oracle.SCENE.replace('kv="2"', 'dampratio="1"')
    model, data = scene(xml)
    default = copy.copy(model)
    DomainRandomizer(model).randomize(data, np.random.default_rng(2))
    truth = oracle.recompiled(xml, factors(model, default))
    assert np.array_equal(model.actuator_biasprm, default.actuator_biasprm)
    assert not np.allclose(model.actuator_biasprm, truth.actuator_biasprm, rtol=1e-3)
    assert oracle.worst_constant(model, truth)[0] < 1e-13


PENDULUM = """
<mujoco>
  <option timestep="1e-3" integrator="RK4"/>
  <worldbody>
    <body><joint name="hinge" axis="0 1 0"/>
      <geom type="box" pos="0 0 -0.3" size="0.03 0.05 0.3" mass="1.2"/></body>
    <body pos="0 1 0"><joint name="light" axis="0 1 0" armature="0.05"/>
      <geom type="box" pos="0 0 -0.3" size="0.03 0.05 0.3" mass="1.2"/></body>
    <body pos="0 2 9"><freejoint/>
      <geom type="box" size="0.1 0.2 0.3" mass="2"/></body>
  </worldbody>
</mujoco>
"""


def exact_period(mass: float, armature: float, angle: float) -> float:
    """Of the box above on its hinge: 4 K(sin^2(angle / 2)) sqrt(I / (m g l))."""
    inertia = mass / 3.0 * (0.03**2 + 0.3**2) + mass * 0.3**2 + armature
    ratio = inertia / (mass * 9.81 * 0.3)
    return float(4.0 * special.ellipk(np.sin(angle / 2.0) ** 2) * np.sqrt(ratio))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_the_period_of_a_pendulum_is_that_of_the_new_mass_and_inertia(seed: int) -> None:
    model, data = scene(PENDULUM)
    randomizer = DomainRandomizer(model, mass=(0.3, 3.0), damping=(0.0, 0.0))
    randomizer.randomize(data, np.random.default_rng(seed))
    for joint, body, armature in (("hinge", 1, 0.0), ("light", 2, 0.05)):
        exact = exact_period(float(model.body_mass[body]), armature, 0.8)
        assert oracle.swing_period(model, joint, 0.8) == pytest.approx(exact, rel=1e-6)
    # Without an armature the period does not tell the mass, if the inertia is scaled with it.
    assert oracle.swing_period(model, "hinge", 0.8) == pytest.approx(
        exact_period(1.2, 0.0, 0.8), rel=1e-6
    )


def test_torque_turns_and_force_pushes_by_the_new_inertia_and_mass() -> None:
    model, data = scene(PENDULUM)
    DomainRandomizer(model, damping=(0.0, 0.0)).randomize(data, np.random.default_rng(5))
    model.opt.gravity[:] = 0.0
    mass = float(model.body_mass[3])
    inertia = mass / 3.0 * (0.2**2 + 0.3**2)
    data.xfrc_applied[3] = [3.0, 0.0, 0.0, 0.7, 0.0, 0.0]
    mujoco.mj_forward(model, data)
    assert data.qacc[2] == pytest.approx(3.0 / mass, rel=1e-12)
    assert data.qacc[5] == pytest.approx(0.7 / inertia, rel=1e-12)


def test_energy_of_the_randomised_model_is_kept() -> None:
    model, data = scene(PENDULUM)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    DomainRandomizer(model, damping=(0.0, 0.0)).randomize(data, np.random.default_rng(6))
    data.qpos[:2] = 1.0, -2.0
    mujoco.mj_forward(model, data)
    start = data.energy.sum()
    mujoco.mj_step(model, data, nstep=1000)
    assert data.energy.sum() == pytest.approx(start, abs=1e-7)


# --- Friction -------------------------------------------------------------------------------------


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
@pytest.mark.parametrize("limits", [(0.1, 0.3), (0.4, 1.2), (1.5, 2.0)])
def test_friction_of_contacts_is_what_was_drawn(limits: tuple[float, float], cone: str) -> None:
    """Below, around and above the defaults; shapes, a pair and a geom with priority."""
    model, data = scene(oracle.SCENE.replace("<option", f'<option cone="{cone}"'))
    randomizer = DomainRandomizer(model, friction=limits)
    rng = np.random.default_rng(7)
    for _ in range(5):
        randomizer.randomize(data, rng)
        result = {oracle.contact_friction(model, geom) for geom in ("sled", "box", "puck")}
        assert len(result) == 1
        mu = result.pop()
        assert limits[0] <= mu <= limits[1]
        assert oracle.sliding_friction(model, speed=6.0) == pytest.approx(mu, rel=1e-9)


def effective(draw: Callable[[Any, np.random.Generator], None], measure: Callable) -> list[float]:
    model, data = scene()
    rng = np.random.default_rng(8)
    randomizer = DomainRandomizer(model)
    result = []
    for _ in range(N):
        randomizer.randomize(data, rng)
        draw(model, rng)
        result.append(measure(model))
    return result


def distance(result: list[float]) -> float:
    """p of a Kolmogorov-Smirnov test against the uniform distribution asked for."""
    return float(stats.kstest(result, stats.uniform(0.4, 0.8).cdf).pvalue)


@pytest.mark.prove
@pytest.mark.parametrize(
    "measure",
    [
        lambda model: oracle.contact_friction(model, "sled"),
        lambda model: oracle.contact_friction(model, "puck"),
        lambda model: oracle.sliding_friction(model, steps=60),
    ],
    ids=["contact", "pair", "motion"],
)
def test_effective_friction_has_the_distribution_asked_for(measure: Callable) -> None:
    assert distance(effective(lambda model, rng: None, measure)) > RARE


@pytest.mark.slow
def test_the_distribution_test_finds_the_usual_mistakes() -> None:
    def each_by_itself(model: Any, rng: np.random.Generator) -> None:
        model.geom_friction[:, 0] = rng.uniform(0.4, 1.2, size=model.ngeom)

    def one_geom_only(model: Any, rng: np.random.Generator) -> None:
        model.geom_friction[model.geom("floor").id, 0] = 0.9  # its default

    for wrong in (each_by_itself, one_geom_only):
        assert distance(effective(wrong, lambda m: oracle.contact_friction(m, "sled"))) < RARE


# --- Damping and masses as drawn ------------------------------------------------------------------


def test_dampings_and_mass_factors_have_the_distribution_asked_for() -> None:
    model, data = scene()
    default = copy.copy(model)
    randomizer = DomainRandomizer(model, mass=(0.5, 2.0), damping=(0.1, 0.6))
    rng = np.random.default_rng(9)
    added, scaled = [], []
    for _ in range(N):
        randomizer.randomize(data, rng)
        added.append(model.dof_damping - default.dof_damping)
        scaled.append(factors(model, default)[1:])
        np.testing.assert_allclose(
            model.body_inertia[1:], scaled[-1][:, None] * default.body_inertia[1:], rtol=1e-14
        )
    drawn = np.array(added)
    for joint in ("sled_x", "sled_z", "shoulder", "elbow"):
        column = drawn[:, model.joint(joint).dofadr[0]]
        assert column.min() >= 0.1 and column.max() <= 0.6  # a zero default does not stay zero
        assert stats.kstest(column, stats.uniform(0.1, 0.5).cdf).pvalue > RARE
    single = [model.joint(joint).dofadr[0] for joint in ("sled_x", "sled_z", "shoulder", "elbow")]
    assert not np.delete(drawn, single, axis=1).any()  # free and ball joints
    masses = np.array(scaled)
    for column in masses.T:
        assert stats.kstest(column, stats.uniform(0.5, 1.5).cdf).pvalue > RARE
    # Each body and each joint is drawn by itself.
    for table in (masses, drawn[:, single]):
        deviation = np.corrcoef(table.T) - np.eye(table.shape[1])
        assert np.abs(deviation).max() < 0.25


def test_a_damped_joint_stops_as_the_drawn_damping_says() -> None:
    xml = (
        '<mujoco><option timestep="1e-3" gravity="0 0 0" integrator="RK4"/><worldbody><body>'
        '<joint axis="0 1 0"/><geom size="0.1" mass="1"/></body></worldbody></mujoco>'
    )
    model, data = scene(xml)
    DomainRandomizer(model).randomize(data, np.random.default_rng(10))
    data.qvel[0] = 2.0
    mujoco.mj_step(model, data, nstep=20)
    rate = model.dof_damping[0] / model.body_inertia[1, 1]
    assert data.qvel[0] == pytest.approx(2.0 * np.exp(-rate * 0.02), rel=1e-6)


# --- Save and restore -----------------------------------------------------------------------------


@given(seed=st.integers(0, 2**32 - 1), times=st.integers(1, 5))
@examples(25)
def test_restore_is_bit_for_bit(seed: int, times: int) -> None:
    model, data = scene()
    before = bytes_of(model)
    rng = np.random.default_rng(seed)
    randomizer = DomainRandomizer(model)
    for _ in range(times):
        randomizer.randomize(data, rng)
        mujoco.mj_step(model, data, nstep=3)
    assert bytes_of(model) != before
    randomizer.restore(data)
    assert bytes_of(model) == before
    randomizer.restore(data)
    assert bytes_of(model) == before


def test_defaults_that_the_compiler_did_not_compute_come_back_too() -> None:
    """mj_setConst on the restored masses would not do: here the constants were set by hand."""
    model, data = scene()
    model.dof_invweight0[:] *= 1.25
    model.body_invweight0[:] *= 1.25
    before = bytes_of(model)
    randomizer = DomainRandomizer(model)
    randomizer.randomize(data, np.random.default_rng(11))
    randomizer.restore(data)
    assert bytes_of(model) == before


def test_draws_start_from_the_defaults() -> None:
    """The same seed gives the same model, whatever was drawn before."""
    model, data = scene()
    randomizer = DomainRandomizer(model)
    randomizer.randomize(data, np.random.default_rng(12))
    once = bytes_of(model)
    rng = np.random.default_rng(13)
    for _ in range(200):
        randomizer.randomize(data, rng)
    assert bytes_of(model) != once
    randomizer.randomize(data, np.random.default_rng(12))
    assert bytes_of(model) == once


def test_the_model_comes_back_when_the_episode_fails() -> None:
    model, data = scene()
    before = bytes_of(model)
    randomizer = DomainRandomizer(model)
    with pytest.raises(ZeroDivisionError):
        try:
            randomizer.randomize(data, np.random.default_rng(14))
            raise ZeroDivisionError
        finally:
            randomizer.restore(data)
    assert bytes_of(model) == before


def exhausted(calls: int) -> Any:
    """A generator that gives `calls` draws and fails at the next."""
    rng = np.random.default_rng(15)

    class Exhausted:
        def __getattr__(self, name: str) -> Any:
            nonlocal calls
            calls -= 1
            if calls < 0:
                raise RuntimeError("no more numbers")
            return getattr(rng, name)

    return Exhausted()


@pytest.mark.parametrize("remaining", range(4))
def test_a_draw_that_fails_changes_nothing(remaining: int) -> None:
    model, data = scene()
    randomizer = DomainRandomizer(model)
    randomizer.randomize(data, np.random.default_rng(16))
    before, steps = bytes_of(model), randomizer.steps
    with pytest.raises(RuntimeError, match="no more numbers"):
        randomizer.randomize(data, exhausted(remaining))
    assert bytes_of(model) == before and randomizer.steps == steps
    randomizer.randomize(data, exhausted(4))


def test_the_state_stays_and_what_follows_from_it_is_new() -> None:
    model, data = scene()
    rng = np.random.default_rng(17)
    mujoco.mj_step(model, data, nstep=20)
    data.qvel[:] += rng.normal(size=model.nv)
    data.ctrl[:] = rng.normal(size=model.nu)
    state = [np.copy(v) for v in (data.qpos, data.qvel, data.ctrl, data.time, data.act)]
    randomizer = DomainRandomizer(model)
    for change in (lambda: randomizer.randomize(data, rng), lambda: randomizer.restore(data)):
        change()
        now = (data.qpos, data.qvel, data.ctrl, data.time, data.act)
        assert all(np.array_equal(a, b) for a, b in zip(state, now, strict=True))
        fresh = mujoco.MjData(model)
        fresh.qpos[:], fresh.qvel[:], fresh.ctrl[:] = data.qpos, data.qvel, data.ctrl
        fresh.qacc_warmstart[:] = data.qacc_warmstart
        fresh.time = data.time
        mujoco.mj_forward(model, fresh)
        for name in ("xipos", "subtree_com", "M", "qfrc_bias", "qfrc_passive", "actuator_force"):
            assert np.array_equal(getattr(data, name), getattr(fresh, name)), name
        np.testing.assert_allclose(data.qacc, fresh.qacc, rtol=1e-6, atol=1e-6)


# --- Delay and noise ------------------------------------------------------------------------------


def lag(sent: np.ndarray, received: np.ndarray) -> int:
    """Where the cross-correlation of white noise with its delayed self has its peak."""
    return int(np.argmax(np.correlate(received, sent, mode="full"))) - (len(sent) - 1)


@pytest.mark.parametrize("steps", [0, 1, 2, 7])
def test_an_action_arrives_after_the_drawn_number_of_calls(steps: int) -> None:
    model, data = scene()
    randomizer = DomainRandomizer(model, delay=(steps, steps), idle=-9.0)
    rng = np.random.default_rng(18)
    randomizer.randomize(data, rng)
    sent = rng.normal(size=300)
    got = np.array([randomizer.delay([u])[0] for u in sent])
    assert randomizer.steps == steps
    assert lag(sent, got) == steps
    assert np.array_equal(got[:steps], np.full(steps, -9.0))
    assert np.array_equal(got[steps:], sent[: len(sent) - steps])


@pytest.mark.parametrize("steps", [0, 1, 2, 7])
def test_the_delay_is_that_of_a_delayed_actuator_of_mujoco(steps: int) -> None:
    model, data = scene()
    randomizer = DomainRandomizer(model, delay=(steps, steps))
    rng = np.random.default_rng(19)
    randomizer.randomize(data, rng)
    sent = rng.normal(size=40)
    ours = [randomizer.delay(u) for u in sent]
    np.testing.assert_allclose(ours, oracle.actuator_delay(sent, steps), rtol=1e-12)


def test_delays_have_the_distribution_asked_for() -> None:
    model, data = scene()
    randomizer = DomainRandomizer(model, delay=(1, 4))
    rng = np.random.default_rng(20)
    drawn = []
    for _ in range(N):
        randomizer.randomize(data, rng)
        drawn.append([float(randomizer.delay(k)) for k in range(1, 9)].index(1.0))
    assert set(drawn) == {1, 2, 3, 4}
    assert stats.chisquare(np.bincount(drawn)[1:]).pvalue > RARE


def test_a_new_draw_forgets_what_was_under_way() -> None:
    model, data = scene()
    randomizer = DomainRandomizer(model, delay=(2, 2))
    rng = np.random.default_rng(21)
    for forget in (
        lambda: randomizer.randomize(data, rng),
        lambda: randomizer.randomize(data, rng),
    ):
        forget()
        assert [float(randomizer.delay(u)) for u in (5.0, 6.0, 7.0)] == [0.0, 0.0, 5.0]
    randomizer.restore(data)
    assert float(randomizer.delay(8.0)) == 8.0


@pytest.mark.parametrize("steps", [0, 2])
def test_the_caller_may_use_its_action_array_again(steps: int) -> None:
    model, data = scene()
    randomizer = DomainRandomizer(model, delay=(steps, steps))
    randomizer.randomize(data, np.random.default_rng(22))
    action = np.zeros((3, 2))
    for call in range(1, 9):
        action[:] = call
        got = randomizer.delay(action)
        assert got.shape == action.shape and not np.shares_memory(got, action)
        assert (got == max(call - steps, 0)).all()
        got[:] = 99.0  # what was given back is the caller's


def test_noise_is_normal_white_and_added_to_a_copy() -> None:
    model, _ = scene()
    randomizer = DomainRandomizer(model, noise=0.2)
    rng = np.random.default_rng(23)
    observation = np.array([3.0, -1.0, 0.0])
    noise = np.array([randomizer.observe(observation, rng) for _ in range(3000)]) - observation
    assert np.array_equal(observation, [3.0, -1.0, 0.0])
    for column in noise.T:
        assert stats.kstest(column, stats.norm(0.0, 0.2).cdf).pvalue > RARE
        assert abs(np.corrcoef(column[1:], column[:-1])[0, 1]) < 4.0 / np.sqrt(3000)
    assert np.abs(np.corrcoef(noise.T) - np.eye(3)).max() < 4.0 / np.sqrt(3000)
    assert noise.mean() == pytest.approx(0.0, abs=4 * 0.2 / np.sqrt(noise.size))
    assert noise.std() == pytest.approx(0.2, rel=4 / np.sqrt(2 * noise.size))
    assert randomizer.observe(np.ones((2, 3), dtype=int), rng).shape == (2, 3)


def test_without_noise_the_observation_is_a_copy() -> None:
    model, _ = scene()
    observation = np.array([1.0, 2.0])
    observed = DomainRandomizer(model, noise=0.0).observe(observation, np.random.default_rng(24))
    assert np.array_equal(observed, observation) and not np.shares_memory(observed, observation)


# --- Wrong input ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("friction", (0.0, 1.0)),
        ("friction", (1.0, 0.5)),
        ("friction", (0.1, float("nan"))),
        ("mass", (0.0, 2.0)),
        ("mass", (0.5, float("inf"))),
        ("damping", (-0.1, 0.5)),
        ("delay", (-1, 2)),
        ("delay", (3, 1)),
        ("delay", (0, 1.5)),
        ("delay", (0, float("inf"))),
        ("noise", -0.1),
        ("noise", float("nan")),
    ],
)
def test_a_range_that_is_not_one_is_named(name: str, value: Any) -> None:
    model, _ = scene()
    with pytest.raises(ValueError, match=f"^{name} must be"):
        DomainRandomizer(model, **{name: value})


def test_data_of_another_model_is_refused() -> None:
    model, _ = scene()
    _, other = scene(PENDULUM)
    before = bytes_of(model)
    randomizer = DomainRandomizer(model)
    for change in (
        lambda: randomizer.randomize(other, np.random.default_rng(25)),
        lambda: randomizer.restore(other),
    ):
        with pytest.raises(ValueError, match="must be that of the model that"):
            change()
    assert bytes_of(model) == before


# --- The ways to measure --------------------------------------------------------------------------


@pytest.mark.parametrize("mu", [0.2, 0.6, 1.0])
def test_a_sled_on_a_slope_slips_where_the_measured_friction_says(mu: float) -> None:
    """Tilting instead of pushing: it creeps below atan(mu) and runs away above."""
    model, _ = scene()
    model.geom_friction[:, 0] = mu
    assert oracle.sliding_friction(model) == pytest.approx(mu, rel=1e-9)
    for excess in (-0.02, 0.02):
        angle = np.arctan(mu) + excess
        model.opt.gravity[:] = 9.81 * np.sin(angle), 0.0, -9.81 * np.cos(angle)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=500)
        run = 9.81 * (np.sin(angle) - mu * np.cos(angle)) * 0.5
        speed = data.qvel[model.joint("sled_x").dofadr[0]]
        assert speed < 0.02 if excess < 0.0 else speed > 0.5 * run


@pytest.mark.prove
def test_the_measures_say_when_they_cannot() -> None:
    model, _ = scene()
    with pytest.raises(ValueError, match="enough to slide"):
        oracle.sliding_friction(model, speed=0.1)
    with pytest.raises(ValueError, match="two that touch"):
        oracle.contact_friction(model, "hand")
    model.opt.gravity[:] = 0.0
    with pytest.raises(ValueError, match="angle must be"):
        oracle.swing_period(
            scene(PENDULUM.replace("<option", '<option gravity="0 0 0"'))[0], "hinge", 0.1
        )
