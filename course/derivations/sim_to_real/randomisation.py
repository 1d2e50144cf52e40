"""Claims of chapter 8: what randomising a MuJoCo model changes, and what it does not."""

from typing import Any

import numpy as np

from course.derivations import Finding, Verdict, claim

# A link on a damped and one on an undamped hinge, hanging over a floor; nothing touches.
_ARM = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <geom type="plane" size="3 3 0.1"/>
    <body name="upper" pos="0 0 2">
      <joint name="shoulder" axis="0 1 0" damping="0.2"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.04" mass="1.2"/>
      <body name="fore" pos="0 0 -0.5">
        <joint name="elbow" axis="0 1 0" springref="0.3"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.03" mass="0.7"/>
      </body>
    </body>
  </worldbody>
  <actuator><position joint="shoulder" kp="30" {damping}/></actuator>
</mujoco>
"""

# A sled that can slide in the plane and rise, but not turn.
_SLED = """
<mujoco>
  <option timestep="0.001" cone="{cone}"/>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 0.1" friction="{floor} 0.005 0.0001"/>
    <body pos="0 0 0.05">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="y" type="slide" axis="0 1 0"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <geom name="sled" type="box" size="0.1 0.1 0.05" mass="1"
        friction="{sled} 0.005 0.0001" priority="{priority}"/>
    </body>
  </worldbody>
</mujoco>
"""


def _arm(damping: str = 'kv="2"') -> Any:
    import mujoco

    return mujoco.MjModel.from_xml_string(_ARM.format(damping=damping))


def _sled(floor: float, sled: float, priority: int = 0, cone: str = "elliptic") -> Any:
    import mujoco

    xml = _SLED.format(floor=floor, sled=sled, priority=priority, cone=cone)
    return mujoco.MjModel.from_xml_string(xml)


def _set_const(model: Any) -> None:
    import mujoco

    mujoco.mj_setConst(model, mujoco.MjData(model))


def _contact(model: Any) -> float:
    from course.oracles.mujoco.randomize import contact_friction

    return contact_friction(model, "sled")


@claim(
    "set_const_inertia",
    8,
    "After a change of body_mass, mj_setConst recomputes the inertia.",
    verdict=Verdict.FALSE,
    corrected="It leaves body_inertia as it is; inertia has to be scaled with the mass. What it "
    "recomputes are the quantities that follow from both: subtree masses, dof_M0, the inverse "
    "weights and the actuators' acc0.",
    figures={
        "inertia_ratio": (1.0, 0.0),
        "subtree_mass_ratio": (2.0, 1e-12),
        "arrays_recomputed": (5.0, 0.0),
    },
    source="MuJoCo documentation, Programming, Simulation, mjModel changes",
)
def _set_const_inertia() -> Finding:
    from course.oracles.mujoco.randomize import DERIVED, arrays

    model = _arm()
    before = arrays(model)
    model.body_mass[:] *= 2.0
    _set_const(model)
    after = arrays(model)
    changed = {k for k in before if before[k].tobytes() != after[k].tobytes()} - {"body_mass"}
    inertia = float(np.max(after["body_inertia"][1:] / before["body_inertia"][1:]))
    subtree = float(after["body_subtreemass"][1] / before["body_subtreemass"][1])
    return Finding(
        {
            "inertia_ratio": inertia,
            "subtree_mass_ratio": subtree,
            "arrays_recomputed": len(changed),
        },
        f"Masses doubled: recomputed were {', '.join(sorted(changed))}.",
        holds=abs(inertia - 2.0) < 1e-9,
        corrected=inertia == 1.0 and changed <= set(DERIVED),
    )


@claim(
    "mass_without_set_const",
    8,
    "Without mj_setConst a changed mass is only partly applied to the motion.",
    verdict=Verdict.CONDITIONAL,
    condition="a constraint acts: a contact, a limit, a tendon or an equality",
    corrected="Gravity and the inertia matrix use the new body_mass and body_inertia at once. "
    "What stays old is the inverse weight, by which MuJoCo scales the stiffness of constraints.",
    figures={"acceleration_free": (0.0, 1e-9), "depth_ratio": (0.2934661, 1e-3)},
    source="MuJoCo documentation, Modeling, Solver parameters",
)
def _mass_without_set_const() -> Finding:
    import mujoco

    free = []
    for recompute in (False, True):
        model = _arm()
        model.body_mass[:] *= 4.0
        model.body_inertia[:] *= 4.0
        if recompute:
            _set_const(model)
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = (0.4, -0.7), (1.0, -2.0)
        mujoco.mj_forward(model, data)
        free.append(data.qacc.copy())
    change = float(np.max(np.abs(free[1] / free[0] - 1.0)))
    depths = []
    for recompute in (False, True):
        model = _sled(0.5, 0.5)
        model.body_mass[:] *= 4.0
        model.body_inertia[:] *= 4.0
        if recompute:
            _set_const(model)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=3000)
        depths.append(float(data.contact.dist.min()))
    ratio = depths[1] / depths[0]
    return Finding(
        {"acceleration_free": change, "depth_ratio": ratio},
        f"Four times the mass: a free arm accelerates the same to {change:.0e}; a sled at rest "
        f"sinks {-1e6 * depths[0]:.2f} um without and {-1e6 * depths[1]:.2f} um with mj_setConst.",
        holds=change > 1e-6,
        holds_if=abs(ratio - 1.0) > 0.1,
        corrected=change < 1e-9 and abs(ratio - 1.0) > 0.1,
    )


@claim(
    "set_const_data",
    8,
    "mj_setConst(model, data) changes the model and leaves the state in data as it was.",
    verdict=Verdict.FALSE,
    corrected="It computes its constants in the data that it is given and leaves the positions in "
    "the reference pose of the springs. Give it an MjData of its own.",
    figures={"elbow_before_rad": (-0.7, 0.0), "elbow_after_rad": (0.3, 1e-12)},
)
def _set_const_data() -> Finding:
    import mujoco

    model = _arm()
    data = mujoco.MjData(model)
    data.qpos[:] = 0.4, -0.7
    before = float(data.qpos[1])
    mujoco.mj_setConst(model, data)
    after = float(data.qpos[1])
    return Finding(
        {"elbow_before_rad": before, "elbow_after_rad": after},
        f"The elbow stood at {before:g} rad and then at {after:g} rad, its springref.",
        holds=after == before,
        corrected=np.array_equal(data.qpos, model.qpos_spring),
    )


@claim(
    "set_const_compiles",
    8,
    "mj_setConst gives the constants that compiling the changed model anew gives.",
    verdict=Verdict.CONDITIONAL,
    condition="no position actuator states its damping as a ratio",
    corrected="The compiler turns a dampratio into a damping for the masses of that moment. "
    "mj_setConst does not do it again: the gain stays, as that of a real motor does.",
    figures={"worst_constant": (0.0, 1e-12), "kv_compiled_over_kept": (2.0, 1e-9)},
    source="MuJoCo changelog, 4.0: dampratio is resolved only at compile time",
)
def _set_const_compiles() -> Finding:
    from course.oracles.mujoco.randomize import recompiled, worst_constant

    factors = np.array([1.0, 4.0, 4.0])
    errors, ratios = [], []
    for damping in ('kv="2"', 'dampratio="1"'):
        model = _arm(damping)
        model.body_mass[:] *= factors
        model.body_inertia[:] *= factors[:, None]
        _set_const(model)
        truth = recompiled(_ARM.format(damping=damping), factors)
        errors.append(worst_constant(model, truth)[0])
        ratios.append(float(truth.actuator_biasprm[0, 2] / model.actuator_biasprm[0, 2]))
    return Finding(
        {"worst_constant": max(errors), "kv_compiled_over_kept": ratios[1]},
        f"Four times the mass: the constants agree to {max(errors):.0e}, the damping that the "
        f"compiler derives from a ratio is {ratios[1]:g} times the one that was kept.",
        holds=abs(ratios[1] - 1.0) < 1e-9,
        holds_if=max(errors) < 1e-12 and ratios[0] == 1.0,
        corrected=max(errors) < 1e-12 and abs(ratios[1] - 2.0) < 1e-9,
    )


@claim(
    "mass_and_period",
    8,
    "Randomising the mass of a pendulum's link randomises its period.",
    verdict=Verdict.FALSE,
    corrected="The period depends on inertia over mass. If both are scaled, as for another "
    "density, it stays; a change of period shows that the inertia was forgotten (or that there is "
    "an armature, a motor or a friction, which don't scale).",
    figures={"scaled_ratio": (1.0, 1e-6), "mass_only_ratio": (0.9349143, 1e-4)},
)
def _mass_and_period() -> Finding:
    import mujoco

    from course.oracles.mujoco.randomize import swing_period

    xml = (
        '<mujoco><option timestep="1e-3" integrator="RK4"/><worldbody><body>'
        '<joint name="hinge" axis="0 1 0"/><geom type="box" pos="0 0 -0.3" size="0.03 0.05 0.3" '
        'mass="1"/></body></worldbody></mujoco>'
    )
    periods = []
    for mass, inertia in ((1.0, 1.0), (2.0, 2.0), (2.0, 1.0)):
        model = mujoco.MjModel.from_xml_string(xml)
        model.body_mass[:] *= mass
        model.body_inertia[:] *= inertia
        _set_const(model)
        periods.append(swing_period(model, "hinge", 0.5))
    scaled, alone = periods[1] / periods[0], periods[2] / periods[0]
    # I / (m g l) about the hinge: (i / s + m l^2) / (m g l) with i the inertia about the centre
    centre, arm = (0.03**2 + 0.3**2) / 3.0, 0.3**2
    expected = np.sqrt((0.5 * centre + arm) / (centre + arm))
    return Finding(
        {"scaled_ratio": scaled, "mass_only_ratio": alone},
        f"Twice the mass: {scaled:.6f} times the period with the inertia scaled, {alone:.4f} times "
        "without.",
        holds=abs(scaled - 1.0) > 1e-3,
        corrected=abs(scaled - 1.0) < 1e-6 and abs(alone - expected) < 1e-4,
    )


@claim(
    "scaled_damping",
    8,
    "Multiplying the damping of all joints by a random factor randomises the damping.",
    verdict=Verdict.CONDITIONAL,
    condition="the default damping is not zero",
    corrected="MuJoCo's default is zero, and a factor leaves it there. Add a draw, or draw the "
    "value itself.",
    figures={"damped_default_spread": (0.035, 0.15), "zero_default_spread": (0.0, 0.0)},
)
def _scaled_damping() -> Finding:
    model, rng = _arm(), np.random.default_rng(0)
    draws = np.array([model.dof_damping * rng.uniform(0.7, 1.3, model.nv) for _ in range(200)])
    spread = draws.std(axis=0)
    return Finding(
        {"damped_default_spread": float(spread[0]), "zero_default_spread": float(spread[1])},
        f"Standard deviation over 200 draws: {spread[0]:.3f} and {spread[1]:g} N m s/rad.",
        holds=bool(spread.min() > 0.0),
        holds_if=bool(spread[0] > 0.0),
        corrected=bool(spread[1] == 0.0),
    )


@claim(
    "one_geom_friction",
    8,
    "The friction of a geom is the friction of its contacts.",
    verdict=Verdict.CONDITIONAL,
    condition="it is the larger of the two, or its geom has the higher priority",
    corrected="A contact takes the larger coefficient of the two geoms, that of the geom with the "
    "higher priority, or that of an explicit pair. A slippery sled on a rough floor is rough.",
    figures={"sled_0_3_floor_0_9": (0.9, 0.0), "with_priority": (0.3, 0.0)},
    source="MuJoCo documentation, Modeling, Contact parameters",
)
def _one_geom_friction() -> Finding:
    from course.oracles.mujoco.randomize import sliding_friction

    plain, rough = _sled(0.9, 0.3), _sled(0.9, 1.1)
    first = _sled(0.9, 0.3, priority=1)
    measured = sliding_friction(plain, "x", "z", speed=4.0)
    return Finding(
        {"sled_0_3_floor_0_9": _contact(plain), "with_priority": _contact(first)},
        f"A sled of 0.3 on a floor of 0.9 is braked with a coefficient of {measured:.4f}.",
        holds=_contact(plain) == 0.3,
        holds_if=_contact(rough) == 1.1 and _contact(first) == 0.3,
        corrected=_contact(plain) == 0.9 and abs(measured - 0.9) < 1e-9,
    )


@claim(
    "friction_of_each_geom",
    8,
    "If every geom's friction is drawn uniformly, so is the friction of the contacts.",
    verdict=Verdict.FALSE,
    corrected="A contact gets the larger of two draws: its distribution function is the square. "
    "Between 0.4 and 1.2 the mean is 0.933 instead of 0.8, and a quarter of the contacts, not "
    "half, are below the middle.",
    figures={"mean": (0.9333, 0.01), "share_below_middle": (0.25, 0.06)},
)
def _friction_of_each_geom() -> Finding:
    import mujoco

    model, rng = _sled(0.5, 0.5), np.random.default_rng(1)
    data = mujoco.MjData(model)
    found = []
    for _ in range(1000):
        model.geom_friction[:, 0] = rng.uniform(0.4, 1.2, model.ngeom)
        mujoco.mj_forward(model, data)
        found.append(float(data.contact.friction[0, 0]))
    mean, below = float(np.mean(found)), float(np.mean(np.array(found) < 0.8))
    return Finding(
        {"mean": mean, "share_below_middle": below},
        f"1000 contacts of MuJoCo: mean {mean:.3f}, {below:.1%} below 0.8.",
        holds=abs(mean - 0.8) < 0.03,
        corrected=abs(mean - (0.4 + 0.8 * 2.0 / 3.0)) < 0.015 and abs(below - 0.25) < 0.03,
    )


@claim(
    "friction_in_all_directions",
    8,
    "A sliding block is braked with the coefficient of its contact in every direction.",
    verdict=Verdict.CONDITIONAL,
    condition="the friction cone is elliptic",
    corrected="MuJoCo's default cone is a pyramid: in the plane of contact it is a square. Along "
    "the diagonal of x and y the friction is smaller by sqrt(2).",
    figures={"pyramid_along": (1.0, 1e-9), "pyramid_diagonal": (0.7071, 1e-3),
             "ellipse_diagonal": (1.0, 1e-3)},
    source="MuJoCo documentation, Computation, Friction cones",
)  # fmt: skip
def _friction_in_all_directions() -> Finding:
    import mujoco

    def braked(cone: str, angle: float) -> float:
        model = _sled(0.5, 0.5, cone=cone)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=200)
        data.qvel[:2] = 4.0 * np.cos(angle), 4.0 * np.sin(angle)
        start = data.qvel.copy()
        mujoco.mj_step(model, data, nstep=100)
        change = data.qvel - start
        return float(np.hypot(*change[:2]) / (9.81 * 0.1 + change[2]) / 0.5)

    along, diagonal = braked("pyramidal", 0.0), braked("pyramidal", np.pi / 4)
    ellipse = braked("elliptic", np.pi / 4)
    return Finding(
        {"pyramid_along": along, "pyramid_diagonal": diagonal, "ellipse_diagonal": ellipse},
        f"Along the diagonal the pyramid gives {diagonal:.4f} of the coefficient, the ellipse "
        f"{ellipse:.4f}.",
        holds=abs(diagonal - 1.0) < 1e-3,
        holds_if=abs(ellipse - 1.0) < 1e-3,
        corrected=abs(diagonal - np.sqrt(0.5)) < 1e-3,
    )


@claim(
    "factors_compound",
    8,
    "Multiplying the current mass in each episode by a factor of mean 1 is fair on average, so it "
    "does no harm.",
    verdict=Verdict.FALSE,
    corrected="The mean stays, the typical value goes to zero: the logarithm drifts by the mean "
    "logarithm of the factor, which is negative. Draw from the defaults.",
    figures={"drift_per_episode": (-0.0154233, 1e-4), "median_after_1000": (2.166e-7, 0.01)},
)
def _factors_compound() -> Finding:
    low, high = 0.7, 1.3
    drift = (high * np.log(high) - low * np.log(low)) / (high - low) - 1.0
    factors = np.random.default_rng(2).uniform(low, high, (2000, 1000))
    median = float(np.median(np.prod(factors, axis=1)))
    return Finding(
        {"drift_per_episode": drift, "median_after_1000": median},
        f"Between 0.7 and 1.3 the logarithm drifts by {drift:.4f} an episode; after 1000 episodes "
        f"the median of 2000 runs is {median:.1e} of the default.",
        holds=median > 0.5,
        corrected=drift < 0.0 and abs(np.log(median) / (1000.0 * drift) - 1.0) < 0.1,
    )


@claim(
    "queue_of_k",
    8,
    "A queue that holds the last k actions, of which the oldest is used, delays by k steps.",
    verdict=Verdict.FALSE,
    corrected="The newest action is in the queue as well, so it delays by k - 1. A delay of k "
    "needs k + 1 places: put the action in, and take one out only when more than k are waiting.",
    figures={"lag_of_4_places": (3.0, 0.0), "lag_of_5_places": (4.0, 0.0)},
)
def _queue_of_k() -> Finding:
    from collections import deque

    from course.oracles.mujoco.randomize import actuator_delay

    sent = np.random.default_rng(3).normal(size=400)

    def lag(places: int) -> int:
        queue: deque[float] = deque([0.0] * places, maxlen=places)
        received = []
        for action in sent:
            queue.append(float(action))
            received.append(queue[0])
        return int(np.argmax(np.correlate(received, sent, "full"))) - (sent.size - 1)

    truth = actuator_delay(sent, 4)
    library = int(np.argmax(np.correlate(truth, sent, "full"))) - (sent.size - 1)
    return Finding(
        {"lag_of_4_places": lag(4), "lag_of_5_places": lag(5)},
        f"Cross-correlation of 400 random actions: 4 places are {lag(4)} steps late; MuJoCo's "
        f"own actuator delay of 4 steps is {library}.",
        holds=lag(4) == 4,
        corrected=lag(4) == 3 and lag(5) == library == 4,
    )
