"""Claims of chapter 8: what randomising a MuJoCo model changes, and what it does not."""

import numpy as np

from course.derivations import claim

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

# A load that hangs on a tendon with a spring.
_HUNG = """
<mujoco>
  <worldbody>
    <site name="top" pos="0 0 1"/>
    <body name="load" pos="0 0 {z}">
      <joint type="slide" axis="0 0 1"/>
      <geom type="sphere" size="0.03" mass="1"/>
      <site name="eye"/>
    </body>
  </worldbody>
  <tendon>
    <spatial stiffness="200" damping="20" {length}><site site="top"/><site site="eye"/></spatial>
  </tendon>
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


def _arm(damping='kv="2"'):
    import mujoco

    return mujoco.MjModel.from_xml_string(_ARM.format(damping=damping))


def _sled(floor, sled, priority=0, cone="elliptic"):
    import mujoco

    xml = _SLED.format(floor=floor, sled=sled, priority=priority, cone=cone)
    return mujoco.MjModel.from_xml_string(xml)


def _scaled(model, mass, inertia=None, recompute=True):
    """Return the model with its masses and inertias scaled, by body or all alike."""
    import mujoco

    model.body_mass[:] *= mass
    model.body_inertia[:] *= np.reshape(mass if inertia is None else inertia, (-1, 1))
    if recompute:
        mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


@claim(
    "After a change of body_mass, mj_setConst recomputes the inertia.",
    "mj_setConst leaves body_inertia unchanged; you have to scale the inertia with the mass. What "
    "it recomputes are the quantities that follow from both: subtree masses, the joint-space "
    "inertia dof_M0, the inverse weights and the actuators' acc0, {arrays_recomputed:.0f} arrays "
    "here.",
    source="MuJoCo documentation, Programming, Simulation, mjModel changes",
)
def set_const_inertia(result):
    from course.oracles.mujoco.randomize import DERIVED, arrays

    before, after = arrays(_arm()), arrays(_scaled(_arm(), 2.0, 1.0))
    # Bytes are compared, so that every array that changed is found and not only expected ones.
    changed = {k for k in before if before[k].tobytes() != after[k].tobytes()} - {"body_mass"}
    inertia = np.max(after["body_inertia"][1:] / before["body_inertia"][1:])
    result.measure("inertia_ratio", inertia, tolerance=0.0)
    subtree = after["body_subtreemass"][1] / before["body_subtreemass"][1]
    result.measure("subtree_mass_ratio", subtree, tolerance=1e-12)
    result.measure("arrays_recomputed", np.size(sorted(changed)))
    result.statement = f"Masses doubled: recomputed were {', '.join(sorted(changed))}."
    result.statement_holds(abs(inertia - 2.0) < 1e-9)
    result.correction_holds(inertia == 1.0, changed <= set(DERIVED), subtree == 2.0)


@claim(
    "Without mj_setConst a changed mass is only partly applied to the motion.",
    "Gravity and the inertia matrix use the new body_mass and body_inertia at once: a free arm "
    "moves the same with it and without. What stays old is the inverse weight, by which MuJoCo "
    "scales the stiffness of constraints: with four times the mass a sled at rest sinks "
    "{depth_ratio:.2f} times as deep after mj_setConst as before. Subtree masses stay old, too: "
    "with four times the mass of the outer link a sensor of the centre of mass is "
    "{centre_mm:.0f} mm off, though nothing moves by it.",
    source="MuJoCo documentation, Modeling, Solver parameters",
)
def mass_without_set_const(result):
    import mujoco

    def free(factor, recompute, dry=0.0):
        """Return accelerations of the arm in a given state, nothing touching."""
        data = mujoco.MjData(model := _scaled(_arm(), factor, recompute=recompute))
        model.dof_frictionloss[:] = dry
        data.qpos[:], data.qvel[:] = (0.4, -0.7), (1.0, -2.0)
        mujoco.mj_forward(model, data)
        return data.qacc.copy()

    def stuck(factor, recompute):
        return free(factor, recompute, 500.0)

    def depth(factor, recompute):
        """Return how deep the sled rests in the floor [m]."""
        data = mujoco.MjData(model := _scaled(_sled(0.5, 0.5), factor, recompute=recompute))
        mujoco.mj_step(model, data, nstep=1500)
        return data.contact.dist.min()

    def pulled(factor, recompute, force=-1.0):
        """Return accelerations of the arm with a muscle; its force is scaled by acc0 if < 0."""
        muscle = (
            '<actuator><muscle joint="shoulder" lengthrange="-1 1" scale="200" '
            f'force="{force}"/></actuator>'
        )
        xml = _ARM.format(damping='kv="2"').replace("</mujoco>", muscle + "</mujoco>")
        model = _scaled(mujoco.MjModel.from_xml_string(xml), factor, recompute=recompute)
        data = mujoco.MjData(model)
        data.qpos[:], data.act[:] = (0.1, -0.7), 1.0
        mujoco.mj_forward(model, data)
        return data.qacc.copy()

    def bound(factor, recompute, elbow=-0.5, joined=False):
        """Return accelerations with a limit of the elbow, or with both joints' angles equal."""
        xml = _ARM.format(damping='kv="2"')
        if joined:
            both = '<equality><joint joint1="shoulder" joint2="elbow"/></equality></mujoco>'
            xml = xml.replace("</mujoco>", both)
        else:
            xml = xml.replace('name="elbow"', 'name="elbow" range="-0.2 0.2"')
        model = _scaled(mujoco.MjModel.from_xml_string(xml), factor, recompute=recompute)
        data = mujoco.MjData(model)
        data.qpos[:] = 0.4, elbow
        mujoco.mj_forward(model, data)
        return data.qacc.copy()

    def equal(factor, recompute):
        return bound(factor, recompute, joined=True)

    def inactive(factor, recompute):
        return bound(factor, recompute, elbow=-0.1)

    def slipping(factor, recompute):
        return free(factor, recompute, 0.05)

    def stated(factor, recompute):
        return pulled(factor, recompute, 50.0)

    def moved(measure, factor):
        """Return the largest relative difference that mj_setConst makes."""
        # The same model with and without the recomputation; nothing else differs.
        return np.max(np.abs(measure(factor, True) / measure(factor, False) - 1.0))

    def centre(recompute):
        """Return the centre of mass of the arm's subtree with a heavier outer link [m]."""
        model = _scaled(_arm(), np.array([1.0, 1.0, 4.0]), recompute=recompute)
        data = mujoco.MjData(model)
        data.qpos[:] = 0.4, -0.7
        mujoco.mj_forward(model, data)
        # Mass-weighted mean of the bodies' centres, independent of the stored subtree masses.
        exact = data.xipos[1:].T @ model.body_mass[1:] / model.body_mass[1:].sum()
        return data.subtree_com[1].copy(), exact

    (old, exact), (new, _) = centre(False), centre(True)
    offset = result.measure("centre_mm", 1000.0 * np.linalg.norm(old - exact), 1e-6)
    change = result.measure("acceleration_free", moved(free, 4.0), tolerance=1e-9)
    ratio = result.measure("depth_ratio", depth(4.0, True) / depth(4.0, False), tolerance=1e-3)
    result.statement = (
        f"Four times the mass: a free arm accelerates the same to {change:.0e}; a sled at rest "
        f"sinks {-1e6 * depth(4.0, False):.2f} um without and {-1e6 * depth(4.0, True):.2f} um "
        "with mj_setConst."
    )
    factors = result.rng.uniform(1.5, 6.0, 8)
    result.statement_holds(
        change > 1e-6,
        only_if="a constraint acts (a contact, a limit, an equality, or dry friction that holds), "
        "or a muscle whose force MuJoCo scales by acc0",
        # Each kind of constraint: a contact, dry friction that holds, a limit, an equality; and a
        # muscle scaled by acc0.
        inside=[moved(depth, x) > 0.1 for x in factors]
        + [moved(stuck, x) > 1e-3 for x in factors]
        + [moved(pulled, x) > 1e-3 for x in factors]
        + [moved(one, x) > 1e-3 for one in (bound, equal) for x in factors],
        outside=[moved(free, x) > 1e-6 for x in factors]
        + [moved(stated, x) > 1e-6 for x in factors]
        # Chosen to break it: a limit that is not reached, and dry friction that slips.
        + [moved(one, x) > 1e-6 for one in (inactive, slipping) for x in factors],
    )
    result.correction_holds(
        change < 1e-9,
        abs(ratio - 1.0) > 0.1,
        # The control: an unchanged mass must change nothing.
        moved(depth, 1.0) == 0.0,
        offset > 10.0,
        np.linalg.norm(new - exact) < 1e-12,
    )


@claim(
    "mj_setConst(model, data) changes the model and leaves the state in data as it was.",
    "It computes its constants in the data that it is given and leaves the positions in the "
    "reference pose of the springs: the elbow went from {elbow_before_rad:.1f} to "
    "{elbow_after_rad:.1f} rad. Give it an MjData of its own.",
)
def set_const_data(result):
    import mujoco

    model = _arm()
    data = mujoco.MjData(model)
    data.qpos[:] = 0.4, -0.7
    before = result.measure("elbow_before_rad", float(data.qpos[1]), tolerance=0.0)
    mujoco.mj_setConst(model, data)
    after = result.measure("elbow_after_rad", float(data.qpos[1]), tolerance=1e-12)
    result.statement = (
        f"The elbow stood at {before:g} rad and then at {after:g} rad, its springref."
    )
    result.statement_holds(after == before)
    result.correction_holds(np.array_equal(data.qpos, model.qpos_spring))


@claim(
    "mj_setConst gives the constants that compiling the changed model anew gives.",
    "The compiler turns a dampratio into a damping for the masses of that moment, and a joint's "
    "springdamper into stiffness and damping, and gives a tendon without a spring length the "
    "length that it has. mj_setConst repeats none of this. So the damping gain of a servo stays, "
    "as that of a real motor does; compiled for four times the mass it is "
    "{kv_compiled_over_kept:.0f} times as large. A load on such a tendon, moved by "
    "{moved_mm:.0f} mm, comes to rest {rest_mm:.0f} mm from where the compiled one does. The "
    "model's statistics stay old as well, but nothing moves "
    "by them.",
    source="MuJoCo changelog, 4.0: dampratio, the spring length of tendons from (-1, -1), and "
    "model statistics are resolved only at compile time",
)
def set_const_compiles(result):
    import mujoco

    from course.oracles.mujoco.randomize import different, recompiled, worst_constant

    def compared(damping, factor):
        """Return the worst error of the constants, and damping as compiled over that preserved."""
        factors = np.array([1.0, factor, factor])
        model = _scaled(_arm(damping), factors)
        # The independent truth: the changed model compiled from XML again.
        truth = recompiled(_ARM.format(damping=damping), factors)
        ratio = truth.actuator_biasprm[0, 2] / model.actuator_biasprm[0, 2]
        return worst_constant(model, truth)[0], ratio

    def same(damping, factor):
        error, ratio = compared(damping, factor)
        return error < 1e-12 and abs(ratio - 1.0) < 1e-9

    given, derived = 'kv="2"', 'dampratio="1"'
    worst = max(compared(damping, 4.0)[0] for damping in (given, derived))
    ratio = compared(derived, 4.0)[1]
    result.measure("worst_constant", worst, tolerance=1e-12)
    result.measure("kv_compiled_over_kept", ratio, tolerance=1e-9)
    result.statement = (
        f"Four times the mass: the constants agree to {worst:.0e}, the damping that the "
        f"compiler derives from a ratio is {ratio:g} times the one that was kept."
    )
    factors = result.rng.uniform(0.3, 5.0, 8)
    sprung = _ARM.format(damping=given).replace('damping="0.2"', 'springdamper="0.1 1"')
    retained, anew = mujoco.MjModel.from_xml_string(sprung), recompiled(sprung, np.full(3, 4.0))
    joint = [(m.dof_damping[0], m.jnt_stiffness[0]) for m in (_scaled(retained, 4.0), anew)]

    def hung(length, down):
        """Return which arrays differ from those of the compiled model, and both rests [m]."""
        stale = mujoco.MjModel.from_xml_string(_HUNG.format(z=0.5, length=length))
        stale.body_pos[1, 2] -= down
        mujoco.mj_setConst(stale, mujoco.MjData(stale))
        anew = mujoco.MjModel.from_xml_string(_HUNG.format(z=0.5 - down, length=length))
        rests = []
        for one in (stale, anew):
            data = mujoco.MjData(one)
            mujoco.mj_step(one, data, nstep=4000)
            rests.append(data.xpos[1, 2])
        return different(stale, anew), rests

    # All arrays of the model, not a list of our own: what a changed position may touch.
    down = result.input("moved_mm", 200.0) / 1000.0
    by_itself, rests = hung("", down)
    stated, _ = hung('springlength="0.5"', down)
    result.measure("rest_mm", 1000.0 * abs(rests[0] - rests[1]), 1e-6)
    depths = result.rng.uniform(0.05, 0.3, 4)

    def thicker(size):
        """Return the arrays that differ after a change of a capsule whose mass is stated."""
        xml = _ARM.format(damping=given)
        stale = mujoco.MjModel.from_xml_string(xml)
        stale.geom_size[1, 0] = size
        mujoco.mj_setConst(stale, mujoco.MjData(stale))
        anew = xml.replace('size="0.04"', f'size="{size:.17g}"')
        return different(stale, mujoco.MjModel.from_xml_string(anew))

    def centre_moves():
        """Return whether mj_setConst takes another centre of mass of a body compiled as simple."""
        inertial = '<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.02 0.025"/>'
        model = mujoco.MjModel.from_xml_string(
            f"<mujoco><worldbody><body><freejoint/>{inertial}</body></worldbody></mujoco>"
        )
        model.body_ipos[1, 0] = 0.2
        try:
            mujoco.mj_setConst(model, mujoco.MjData(model))
        except mujoco.FatalError:
            return False
        return True

    def muscles():
        """Return a muscle's model with a moved arm, after mj_setConst and compiled."""

        def built(z):
            return mujoco.MjModel.from_xml_string(
                f'<mujoco><worldbody><site name="top" pos="0.3 0 1"/><body pos="0 0 {z}">'
                '<joint axis="0 1 0" limited="true" range="-60 60"/>'
                '<geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.03"/>'
                '<site name="end" pos="0 0 -0.3"/></body></worldbody><tendon><spatial name="t">'
                '<site site="top"/><site site="end"/></spatial></tendon>'
                '<actuator><muscle tendon="t"/></actuator></mujoco>'
            )

        stale = built(1.0)
        stale.body_pos[1, 2] = 0.8
        mujoco.mj_setConst(stale, mujoco.MjData(stale))
        return stale, built(0.8)

    result.statement_holds(
        same(derived, 4.0),
        only_if="what changes are masses, inertias, friction, damping and the positions of bodies, "
        "and the model leaves no damping (dampratio, springdamper), no spring length of a tendon, "
        "no length range of a muscle and no total mass to the compiler",
        inside=[same(given, x) for x in factors]
        + [not hung('springlength="0.5"', x)[0] for x in depths],
        outside=[same(derived, x) for x in factors]
        + [joint[0][0] == joint[1][0]]
        + [not hung("", x)[0] for x in depths]
        # Chosen to break it: a thicker link, whose inertia only the compiler computes, a moved
        # centre of mass, and the length range of a muscle.
        + [not thicker(0.06), centre_moves(), not different(*muscles())],
    )
    result.correction_holds(
        worst < 1e-12,
        # Critical damping scales with the root of the mass.
        all(abs(compared(derived, x)[1] / np.sqrt(x) - 1) < 1e-9 for x in factors),
        bool(np.allclose(joint[1], 4.0 * np.array(joint[0]))),
        by_itself == {"tendon_lengthspring"},
        not stated,
    )


@claim(
    "Randomising the mass of a pendulum's link randomises its period.",
    "The period depends on inertia over mass. If both are scaled, as for another density, it "
    "stays. With the mass alone doubled it is {mass_only_ratio:.3f} of what it was, which shows "
    "that the inertia was forgotten.",
)
def mass_and_period(result):
    import mujoco

    from course.oracles.mujoco.randomize import swing_period

    xml = (
        '<mujoco><option timestep="1e-3" integrator="RK4"/><worldbody><body>'
        '<joint name="hinge" axis="0 1 0"/><geom type="box" pos="0 0 -0.3" size="0.03 0.05 0.3" '
        'mass="1"/></body></worldbody></mujoco>'
    )

    def period(mass, inertia, armature=0.0, stiffness=0.0, dry=0.0, text=xml, angle=0.5):
        model = mujoco.MjModel.from_xml_string(text)
        model.dof_armature[:], model.jnt_stiffness[:] = armature, stiffness
        model.dof_frictionloss[:] = dry
        return swing_period(_scaled(model, mass, inertia), "hinge", angle)

    plain = period(1.0, 1.0)
    scaled = result.measure("scaled_ratio", period(2.0, 2.0) / plain)
    alone = result.measure("mass_only_ratio", period(2.0, 1.0) / plain, tolerance=1e-4)
    # I / (m g l) about the hinge: (i / s + m l^2) / (m g l) with i the inertia about the centre
    centre, arm = (0.03**2 + 0.3**2) / 3.0, 0.3**2
    expected = np.sqrt((0.5 * centre + arm) / (centre + arm))
    # Mass and inertia scaled by the same random factor: the period must stay.
    other = period(*[result.rng.uniform(0.5, 3.0)] * 2)
    result.statement = (
        f"Twice the mass: {scaled:.6f} times the period with the inertia scaled, {alone:.4f} times "
        "without."
    )
    factors = result.rng.uniform(1.5, 3.0, 8).tolist()
    rotor = 0.05  # kg m^2, compared with the rod's 0.12 about the hinge
    # A small ball on a long rod without mass: almost all of its inertia is m l^2.
    ball = xml[: xml.index("<geom")] + '<geom size="0.01" pos="0 0 -1" mass="1"/>'
    ball += xml[xml.index("</body>") :]
    single = period(1.0, 1.0, text=ball)
    sprung = period(2.0, 2.0, 0.0, 3.0) / period(1.0, 1.0, 0.0, 3.0)

    def rubbed(dry, angle):
        """Return the ratio of the periods with dry friction that stays as it is [N m]."""
        heavy, light = (period(x, x, dry=dry, angle=angle) for x in (2.0, 1.0))
        return heavy / light

    result.statement_holds(
        abs(scaled - 1.0) > 1e-3,
        only_if="the inertia isn't scaled with the mass and isn't negligible compared with m l^2, "
        "or something else stays as it is, such as a motor's armature or a spring; dry friction "
        "counts only in large swings, whose period depends on how fast they decay",
        inside=[abs(period(x, 1.0) / plain - 1.0) > 1e-3 for x in factors]
        + [abs(period(2.0, 2.0, rotor) / period(1.0, 1.0, rotor) - 1.0) > 1e-3]
        # Chosen to break it: a spring, and a large swing that dry friction makes smaller.
        + [abs(x - 1.0) > 1e-3 for x in (sprung, rubbed(0.02, 0.5))],
        outside=[abs(period(x, x) / plain - 1.0) > 1e-3 for x in factors]
        # Chosen to break it: a ball on a long rod.
        + [abs(period(x, 1.0, text=ball) / single - 1.0) > 1e-3 for x in factors[:2]]
        # Chosen to break it: the same dry friction, compared with gravity, in a small swing.
        + [abs(rubbed(0.002, 0.05) - 1.0) > 1e-3],
    )
    result.correction_holds(
        abs(scaled - 1.0) < 1e-6, abs(other / plain - 1.0) < 1e-6, abs(alone - expected) < 1e-4
    )


def _drawn(model, draws, rng, **ranges):
    """Return (masses, damping, friction) of a model over samples of the course's randomiser."""
    import mujoco

    from course.drills import DomainRandomizer

    data, randomizer = mujoco.MjData(model), DomainRandomizer(model, **ranges)
    rows = []
    for _ in range(draws):
        randomizer.randomize(data, rng)
        rows.append((model.body_mass[1:].copy(), model.dof_damping.copy(), _contact(model)))
    return tuple(np.array(column) for column in zip(*rows, strict=True))


def _contact(model):
    """Return friction coefficient of the sled's contact, nan where there is no sled."""
    from course.oracles.mujoco.randomize import contact_friction

    names = [model.geom(i).name for i in range(model.ngeom)]
    return contact_friction(model, "sled") if "sled" in names else np.nan


@claim(
    "Multiplying the damping of all joints by a random factor randomises the damping.",
    "MuJoCo's default damping is zero, and a factor leaves it zero. Add a random offset, as this "
    "course's randomiser does (a spread of {added_spread:.2f} on the joint that had no damping), "
    "or sample the damping itself.",
)
def scaled_damping(result):
    import mujoco

    model = _arm()

    def spread(damping):
        """Return standard deviation over 200 factors between 0.7 and 1.3."""
        return float((damping * result.rng.uniform(0.7, 1.3, 200)).std())

    damped, zero = (spread(d) for d in model.dof_damping)
    result.measure("damped_default_spread", damped, tolerance=0.15)
    result.measure("zero_default_spread", zero, tolerance=0.0)
    _, drawn, _ = _drawn(_arm(), 200, result.rng, damping=(0.0, 0.5))
    added = result.measure("added_spread", drawn[:, 1].std(), tolerance=0.2)
    result.statement = (
        f"Standard deviation over 200 draws: {damped:.3f} and {zero:g} N m s/rad by factors, "
        f"{added:.3f} where the draw is added."
    )
    # MuJoCo's damping is a polynomial in the speed; dof_damping is only its first coefficient.
    text = _ARM.format(damping='kv="2"').replace('damping="0.2"', 'damping="0 0.5"')
    quadratic = mujoco.MjModel.from_xml_string(text)
    result.statement_holds(
        min(damped, zero) > 0.0,
        only_if="the default damping is not zero, and is proportional to the speed",
        inside=[spread(d) > 0.0 for d in 10 ** result.rng.uniform(-3, 1, 8)],
        # Defaults of exactly zero, which no factor can spread.
        outside=[spread(d) > 0.0 for d in np.zeros(8) * model.dof_damping[0]]
        # Chosen to break it: damping that grows with the square of the speed.
        + [spread(quadratic.dof_damping[0]) > 0.0],
    )
    result.correction_holds(
        bool(np.any(quadratic.dof_dampingpoly[0] > 0.0)),
        zero == 0.0,
        model.dof_damping[1] == 0.0,
        added > 0.1,
    )


@claim(
    "The friction of a geom is the friction of its contacts.",
    "A contact takes the larger coefficient of the two geoms, that of the geom with the higher "
    "priority, or that of an explicit pair. A slippery sled of {sled:.1f} on a floor of "
    "{floor:.1f} is rough: {sled_0_3_floor_0_9:.1f}.",
    source="MuJoCo documentation, Modeling, Contact parameters",
)
def one_geom_friction(result):
    import mujoco

    from course.oracles.mujoco.randomize import sliding_friction

    floor, sled = result.input("floor", 0.9), result.input("sled", 0.3)
    plain = result.measure("sled_0_3_floor_0_9", _contact(_sled(floor, sled)), tolerance=0.0)
    first = result.measure("with_priority", _contact(_sled(floor, sled, priority=1)), tolerance=0.0)
    # What actually brakes the sled, not only the number that the contact stores.
    measured = sliding_friction(_sled(floor, sled), "x", "z", speed=4.0)
    result.statement = (
        f"A sled of 0.3 on a floor of 0.9 is braked with a coefficient of {measured:.4f}."
    )
    # The two ranges don't overlap, so that the larger coefficient is always known.
    low = [float(x) for x in result.rng.uniform(0.1, 0.6, 8)]
    high = [float(x) for x in result.rng.uniform(0.65, 1.2, 8)]

    def paired(floor, sled):
        """Return the contact's, where an explicit pair says 0.2."""
        xml = _SLED.format(floor=floor, sled=sled, priority=0, cone="elliptic")
        pair = '<contact><pair geom1="floor" geom2="sled" friction="0.2 0.2 0 0 0"/></contact>'
        return _contact(
            mujoco.MjModel.from_xml_string(xml.replace("</mujoco>", pair + "</mujoco>"))
        )

    def overridden(floor, sled):
        """Return the contact's where the model's options override all contacts with 0.15."""
        model = _sled(floor, sled)
        model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
        model.opt.o_friction[:2] = 0.15
        return _contact(model)

    def frictionless(friction):
        """Return the coefficient that brakes a sled whose contact has one dimension (condim 1)."""
        xml = _SLED.format(floor=friction, sled=friction, priority=0, cone="elliptic")
        model = mujoco.MjModel.from_xml_string(xml.replace("<geom name", '<geom condim="1" name'))
        return sliding_friction(model, "x", "z", speed=4.0)

    def ruled():
        """Return whether all of a contact's coefficients are those that the rule names."""
        priority, condim = result.rng.integers(-2, 3, 2), result.rng.choice([3, 4, 6], 2)
        given = result.rng.uniform(0.05, 1.5, (2, 3))
        form = result.rng.choice(['sphere" size="0.05', 'capsule" size="0.05 0.1'])
        text = [
            f'condim="{condim[i]}" priority="{priority[i]}" friction="{a:.17g} {b:.17g} {c:.17g}"/>'
            for i, (a, b, c) in enumerate(given)
        ]
        model = mujoco.MjModel.from_xml_string(
            f'<mujoco><worldbody><geom type="plane" size="9 9 1" {text[0]}<body pos="0 0 0.04">'
            f'<freejoint/><geom type="{form}" {text[1]}</body></worldbody></mujoco>'
        )
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        # With equal priority the larger of each of the three coefficients.
        equal = priority[0] == priority[1]
        rule = given.max(axis=0) if equal else given[int(priority[1] > priority[0])]
        return bool(np.allclose(data.contact.friction[0][[0, 2, 3]], rule))

    both = list(zip(low, high, strict=True))
    result.statement_holds(
        plain == sled,
        only_if="it is the larger of the two, or its geom has the higher priority, no pair in the "
        "model names both, contacts are not overridden by an option, and condim is 3 or more",
        inside=[_contact(_sled(x, y)) == y for x, y in both]
        + [_contact(_sled(y, x, priority=1)) == x for x, y in both]
        # Chosen to break it: other shapes, priorities of either sign, several kinds of contact.
        + [ruled() for _ in range(24)],
        outside=[_contact(_sled(y, x)) == x for x, y in both]
        + [paired(x, y) == y for x, y in both]
        + [overridden(x, y) == y for x, y in both]
        + [abs(frictionless(x) - x) < 1e-3 for x in low[:2]],
    )
    result.correction_holds(
        first == sled,
        paired(low[0], high[0]) == 0.2,
        abs(measured - floor) < 1e-9,
        all(_contact(_sled(x, y)) == max(x, y) for x, y in zip(high, low, strict=True)),
    )


@claim(
    "If every geom's friction is sampled uniformly, the friction of the contacts is uniform, too.",
    "A contact gets the larger of two samples, so its distribution function is the square of the "
    "single one. Between {low:.1f} and {high:.1f} the mean is {mean:.2f} instead of {middle:.1f}, "
    "and {share_below_middle:.2f} of the contacts, not half, are below the middle. One sample for "
    "all geoms, as in this course's randomiser, preserves the mean: {mean_of_one_draw:.2f}.",
)
def friction_of_each_geom(result):
    import mujoco

    low, high = result.input("low", 0.4), result.input("high", 1.2)
    middle = result.input("middle", 0.5 * (low + high))
    model = _sled(0.5, 0.5)
    data = mujoco.MjData(model)
    drawn = []
    for _ in range(1000):
        model.geom_friction[:, 0] = result.rng.uniform(low, high, model.ngeom)
        mujoco.mj_forward(model, data)
        drawn.append(data.contact.friction[0, 0])
    mean = result.measure("mean", np.mean(drawn), tolerance=0.02)
    below = result.measure("share_below_middle", np.mean(np.array(drawn) < middle), tolerance=0.12)
    _, _, one = _drawn(_sled(0.5, 0.5), 400, result.rng, friction=(low, high))
    retained = result.measure("mean_of_one_draw", np.mean(one), tolerance=0.03)
    result.statement = (
        f"1000 contacts of MuJoCo: mean {mean:.3f}, {below:.1%} below 0.8; with one draw for all "
        f"geoms {retained:.3f} over 400."
    )
    result.statement_holds(abs(mean - middle) < 0.03)
    result.correction_holds(
        # Maximum of two uniform draws: mean at two thirds, and a quarter of it below the middle.
        abs(mean - (low + (high - low) * 2.0 / 3.0)) < 0.02,
        abs(below - 0.25) < 0.04,
        abs(retained - middle) < 0.04,
    )


@claim(
    "A sliding block is braked with the coefficient of its contact in every direction.",
    "MuJoCo's default cone is a pyramid: in the plane of contact it is a square. Along the "
    "diagonal of x and y the friction is smaller by sqrt(2): {pyramid_diagonal:.3f} of the "
    "coefficient.",
    source="MuJoCo documentation, Computation, Friction cones",
)
def friction_in_all_directions(result):
    import mujoco

    def braked(cone, angle, turn=0.0, pair=""):
        """Change of speed over that of the contact's impulse, over the coefficient.

        With the geom turned [deg], or with a pair that states the coefficients.
        """
        xml = _SLED.format(floor=0.5, sled=0.5, priority=0, cone=cone)
        xml = xml.replace('name="sled" type="box"', f'name="sled" type="box" euler="0 0 {turn}"')
        if pair:
            text = f'<pair geom1="floor" geom2="sled" friction="{pair} 0.005 0.0001 0.0001"/>'
            xml = xml.replace("</mujoco>", f"<contact>{text}</contact></mujoco>")
        model = mujoco.MjModel.from_xml_string(xml)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=200)
        data.qvel[:2] = 4.0 * np.cos(angle), 4.0 * np.sin(angle)
        start = data.qvel.copy()
        mujoco.mj_step(model, data, nstep=100)
        change = data.qvel - start
        # Change of momentum in the plane over the normal impulse of the same 0.1 s: an effective
        # coefficient that doesn't depend on how the normal force varies.
        return np.hypot(*change[:2]) / (9.81 * 0.1 + change[2]) / 0.5

    result.measure("pyramid_along", braked("pyramidal", 0.0), tolerance=1e-9)
    diagonal = result.measure("pyramid_diagonal", braked("pyramidal", np.pi / 4), tolerance=1e-3)
    ellipse = result.measure("ellipse_diagonal", braked("elliptic", np.pi / 4), tolerance=1e-3)
    result.statement = (
        f"Along the diagonal the pyramid gives {diagonal:.4f} of the coefficient, the ellipse "
        f"{ellipse:.4f}; and at ten random angles."
    )

    def crept(speed):
        """Return the same as `braked`, over one step at a speed [m/s] along x."""
        model = _sled(0.5, 0.5)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=300)
        data.qvel[0], rise = speed, data.qvel[2]
        mujoco.mj_step(model, data)
        return (speed - data.qvel[0]) / (9.81 * 0.001 + data.qvel[2] - rise) / 0.5

    def spun(rate):
        """Return what brakes a free block's centre that also spins [rad/s], over mu g."""
        axes = ("x", "y", "z")
        xml = _SLED.format(floor=0.5, sled=0.5, priority=0, cone="elliptic")
        for name, axis in zip(axes, ("1 0 0", "0 1 0", "0 0 1"), strict=True):
            new = "<freejoint/>" if name == "x" else ""
            xml = xml.replace(f'<joint name="{name}" type="slide" axis="{axis}"/>', new)
        model = mujoco.MjModel.from_xml_string(xml)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=200)
        data.qvel[:] = 2.0, 0.0, 0.0, 0.0, 0.0, rate
        mujoco.mj_step(model, data, nstep=50)
        return (2.0 - np.hypot(*data.qvel[:2])) / (0.5 * 9.81 * 0.05)

    def pushed(speed, share):
        """Return the same as `crept` along x, with a push of a share of the weight along y."""
        model = _sled(0.5, 0.5)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=300)
        data.qvel[0], rise = speed, data.qvel[2]
        data.qfrc_applied[1] = share * 9.81
        mujoco.mj_step(model, data)
        return (speed - data.qvel[0]) / (9.81 * 0.001 + data.qvel[2] - rise) / 0.5

    angles = result.rng.uniform(0.1, np.pi / 2 - 0.1, 10)
    spins = [spun(x) for x in (0.0, *result.rng.uniform(20.0, 60.0, 4))]
    # Attacks: a contact frame that is turned, and a pair with two coefficients of sliding.
    result.statement_holds(
        abs(diagonal - 1.0) < 1e-3,
        only_if="the friction cone is elliptic, no pair gives the two directions of sliding "
        "different coefficients, the block does not spin, nothing pushes it across its path, and "
        "it is not so slow that regularised friction stays below its limit",
        inside=[abs(braked("elliptic", a) - 1.0) < 1e-3 for a in angles]
        + [abs(braked("elliptic", a, turn=30.0 * a) - 1.0) < 1e-3 for a in angles[:4]]
        + [abs(crept(x) - 1.0) < 1e-3 for x in (0.3, 1.0)],
        outside=[abs(braked("pyramidal", a) - 1.0) < 1e-3 for a in angles]
        + [abs(braked("elliptic", a, pair="0.5 0.25") - 1.0) < 1e-3 for a in angles[:4]]
        + [abs(x - 1.0) < 0.1 for x in spins[1:]]
        + [abs(crept(x) - 1.0) < 0.1 for x in (0.001, 0.01)]
        # Chosen to break it: a push across the path of a block that slides slowly.
        + [abs(pushed(0.2, x) - 1.0) < 1e-3 for x in (0.4, 0.8)],
    )
    result.correction_holds(
        abs(diagonal - np.sqrt(0.5)) < 1e-3, abs(spins[0] - 1.0) < 0.05, max(spins[1:]) < 0.8
    )


@claim(
    "Multiplying the current mass in each episode by a factor of mean 1 is fair on average, so it "
    "does no harm.",
    "The mean stays, but the typical value goes to zero. The logarithm drifts by the mean "
    "logarithm of the factor, {drift_per_episode:.4f} per episode for factors between {low:.1f} "
    "and {high:.1f}, and after {episodes:.0f} episodes half of the runs are below "
    "{median_after_1000:.0e} of the default. Multiply the default instead: this course's "
    "randomiser then still has a median of {median_from_defaults:.2f}.",
)
def factors_compound(result):
    low, high = result.input("low", 0.7), result.input("high", 1.3)
    episodes = result.input("episodes", 1000)
    factors = np.random.default_rng(2).uniform(low, high, (2000, episodes))
    # Mean of the logarithm of a uniform factor, in closed form.
    theory = (high * np.log(high) - low * np.log(low)) / (high - low) - 1.0
    drift = result.measure("drift_per_episode", theory, tolerance=1e-4)
    median = result.measure(
        "median_after_1000", np.median(np.prod(factors, axis=1)), tolerance=0.01
    )
    default = _arm().body_mass[1:]
    masses, _, _ = _drawn(_arm(), episodes, result.rng, mass=(low, high))
    retained = result.measure("median_from_defaults", np.median(masses / default), tolerance=0.05)
    result.statement = (
        f"Between 0.7 and 1.3 the logarithm drifts by {drift:.4f} an episode; after 1000 episodes "
        f"the median of 2000 runs is {median:.1e} of the default, of draws from it {retained:.2f}."
    )
    result.statement_holds(median > 0.5)
    result.correction_holds(
        abs(np.log(factors).mean() / drift - 1) < 0.01,
        # The median of a product is the exponential of the summed mean logarithms (log-normal
        # limit).
        abs(np.log(median) / (episodes * drift) - 1.0) < 0.1,
        low <= (masses / default).min() < (masses / default).max() <= high,
        abs(retained - 1.0) < 0.05,
    )


@claim(
    "A queue that holds the last k actions, of which the oldest is used, delays by k steps.",
    "If the new action is appended first, as in most code, it is in the queue as well when the "
    "oldest is read: four slots delay by {lag_of_4_places:.0f} steps. A delay of k "
    "steps then needs k + 1 slots: put the action in, and take one out only when more than k are "
    "waiting, as this course's randomiser and MuJoCo's own actuator delay do. Put in a copy: a "
    "caller that uses one array again for each action changes the waiting ones, too.",
)
def queue_of_k(result):
    from collections import deque

    from course.drills import DomainRandomizer
    from course.oracles.mujoco.randomize import actuator_delay

    sent = result.rng.normal(size=400)

    def late(received):
        """Return the delay in steps, from the cross-correlation."""
        # White noise has a single sharp peak in the cross-correlation, at the delay.
        return np.argmax(np.correlate(np.ravel(received), sent, "full")) - (sent.size - 1)

    def lag(places, read_first=False, reused=False, copied=False):
        """Return the delay; with `reused` the caller writes each action into the same array."""
        queue, array = deque([np.zeros(1)] * places, maxlen=places), np.zeros(1)
        received = []
        for action in sent:
            array = array if reused else np.zeros(1)
            array[0], oldest = action, queue[0]
            queue.append(array.copy() if copied else array)
            received.append(float((oldest if read_first else queue[0])[0]))
        return late(received)

    def from_empty(k):
        """Return whether each action is used k steps later if the queue starts empty."""
        queue, received = deque(maxlen=k), []
        for action in sent:
            received.append(queue[0] if queue else 0.0)
            queue.append(action)
        return np.array_equal(received, np.concatenate((np.zeros(k), sent[:-k])))

    def ours(k):
        import mujoco

        model = _arm()
        randomizer = DomainRandomizer(model, delay=(k, k))
        randomizer.randomize(mujoco.MjData(model), result.rng)
        return late([randomizer.delay([action]) for action in sent])

    result.measure("lag_of_4_places", lag(4))
    result.measure("lag_of_5_places", lag(5))
    result.statement = (
        f"Cross-correlation of 400 random actions: 4 places are {lag(4)} steps late; MuJoCo's own "
        f"actuator delay of 4 steps is {late(actuator_delay(sent, 4))}, the randomiser's {ours(4)}."
    )
    slots = range(1, 12)
    result.statement_holds(
        lag(4) == 4,
        only_if="each reset fills the queue with k actions, the oldest action is read before the "
        "new one is appended, and the queue holds copies if the caller uses one array again for "
        "each action",
        inside=[lag(k, read_first=True) == k for k in slots]
        # Chosen to break it: a caller that writes every action into the same array.
        + [lag(k, read_first=True, reused=True, copied=True) == k for k in slots],
        outside=[lag(k) == k for k in slots]
        + [lag(k, read_first=True, reused=True) == k for k in slots]
        # Chosen to break it: an empty queue grows to k actions, and until then the first is used.
        + [from_empty(k) for k in slots],
    )
    result.correction_holds(
        all(lag(k) == k - 1 for k in range(1, 12)),
        # MuJoCo's own actuator delay is the independent reference.
        all(ours(k) == k == late(actuator_delay(sent, k)) for k in (1, 4, 7)),
    )
