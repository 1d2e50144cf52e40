"""Claims about what MuJoCo's integrators really do, each measured on a model of a few lines."""

from pathlib import Path
from typing import Any

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "m": Symbol("mass [kg]"),
    "k": Symbol("stiffness [N/m]"),
    "c": Symbol("damping [N s/m]"),
}


def small_model(worldbody, timestep, integrator="Euler", more="", flags=""):
    """Return (model, data) of a small scene; a run that blows up is not reset."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{timestep}" integrator="{integrator}" {more}>'
        # MuJoCo resets a diverging state by default, which would hide the instability.
        f'<flag autoreset="disable" {flags}/></option>'
        f"<worldbody>{worldbody}</worldbody></mujoco>"
    )
    return model, mujoco.MjData(model)


def _spring(integrator, timestep, stiffness, damping=0.0, flags=""):
    """Return (model, data) of 1 kg on a slide with a spring."""
    return small_model(
        f'<body><joint type="slide" axis="1 0 0" stiffness="{stiffness}" damping="{damping}"/>'
        '<geom size=".1" mass="1"/></body>',
        timestep,
        integrator,
        'gravity="0 0 0"',
        flags,
    )


def _grows(integrator, timestep, damping=0.0, steps=3000):
    """Return whether 1 kg on 1 N/m, released at 1 m, leaves 100 m."""
    import mujoco

    model, data = _spring(integrator, timestep, 1.0, damping)
    data.qpos[0] = 1.0
    for _ in range(steps):
        mujoco.mj_step(model, data)
        # Written so that NaN counts as growth.
        if not abs(data.qpos[0]) < 100.0:
            return True
    return False


def _limit(integrator, damping=0.0):
    """Return the largest stable omega h by bisection, to a part in 2000."""
    low, high = 0.1, 16.0
    if not _grows(integrator, 1000.0, damping):
        return float("inf")
    while high / low > 1.0005:
        # Bisection in the logarithm of the step.
        middle = float(np.sqrt(low * high))
        if _grows(integrator, middle, damping):
            high = middle
        else:
            low = middle
    return low


_MOMENTS = (1.0, 2.0, 3.0)
_SPIN = (1.0, 0.0, 1.5)


def _free_body(integrator, timestep, moments=_MOMENTS, child="", spin=_SPIN):
    """Return (model, data) of a free body that turns at `spin` [rad/s]."""
    inertia = " ".join(map(repr, map(float, moments)))
    model, data = small_model(
        f'<body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="{inertia}"/>{child}</body>',
        timestep,
        integrator,
        'gravity="0 0 0"',
    )
    data.qvel[3:6] = spin
    return model, data


def _energy(integrator, moments=_MOMENTS, child="", spin=_SPIN, timestep=0.0025, seconds=5.0):
    """Return kinetic energy after some tumbling over that at the start."""
    import mujoco

    model, data = _free_body(integrator, timestep, moments, child, spin)
    mujoco.mj_step(model, data, round(seconds / timestep))
    return float(np.dot(moments, data.qvel[3:6] ** 2) / np.dot(moments, np.square(spin)))


def _random_tumble(rng):
    """Return (moments, spin) of a body that can exist, well away from a steady spin."""
    moments = np.sort(rng.uniform(1.0, 3.0, 3))
    # Triangle inequality of the moments.
    moments[2] = min(moments[2], 0.95 * (moments[0] + moments[1]))
    return moments, rng.uniform(0.5, 1.5, 3)


def _derivative(difference, centred=0):
    """Return MuJoCo's derivative of a pendulum's step by its state, (2, 2)."""
    import mujoco

    model, data = small_model(
        '<body><joint axis="0 1 0"/><geom size=".1" pos="0 0 -1" mass="1"/></body>', 0.002
    )
    data.qpos[0] = 0.7
    matrix = np.zeros((2, 2))
    mujoco.mjd_transitionFD(model, data, difference, centred, matrix, None, None, None)
    return matrix


def _manual(page):
    """Return (version, text in one line) of a page of the manual that MuJoCo installs."""
    import mujoco

    path = Path(mujoco.__file__).parent / "doc" / page
    return mujoco.__version__, " ".join(path.read_text(encoding="utf-8").split())


@claim(
    "MuJoCo's default is RK4 at 1 kHz.",
    "The default is its semi-implicit Euler with a step of {timestep_ms:.0f} ms; other engines "
    "have other defaults.",
    source="Defaults by documentation: MuJoCo 4.0 (2026) 2 ms, PyBullet Quickstart Guide 1/240 s, "
    "SDFormat (Gazebo) max_step_size 1 ms, Isaac Lab 3.0 (2026) 1/60 s",
)
def mujoco_defaults(result):
    import mujoco

    option = mujoco.MjModel.from_xml_string("<mujoco/>").opt
    name = mujoco.mjtIntegrator(option.integrator).name.removeprefix("mjINT_").lower()
    result.measure("timestep_ms", 1000 * option.timestep)
    result.measure("integrator", name)
    result.statement = "Read from an empty model."
    result.statement_holds(name == "rk4" and option.timestep == 0.001)
    result.correction_holds(name == "euler", option.timestep == 0.002)


@claim(
    "MuJoCo's Euler is semi-implicit.",
    "Without damping its step on a spring is, to rounding, the semi-implicit Euler of this course: "
    "velocity first. A joint's damping is implicit besides.",
)
def mujoco_euler_is_semi_implicit(result):
    import mujoco

    from course.derivations.rigid_body.linear import numeric_matrix

    def matrix(omega_h, damping=0.0):
        columns = []
        for x, v in ((1.0, 0.0), (0.0, 1.0)):
            model, data = _spring("Euler", omega_h, 1.0, damping)
            data.qpos[0], data.qvel[0] = x, v
            mujoco.mj_step(model, data)
            # One step from each unit state gives a column of the step's matrix.
            columns.append([data.qpos[0], data.qvel[0]])
        return np.array(columns).T

    def distance(name, omega_h, zeta=0.0):
        return np.abs(matrix(omega_h, 2 * zeta) - numeric_matrix(name, omega_h, zeta)).max()

    semi = distance("semi_implicit_euler", 0.3)
    result.measure("distance_to_semi_implicit", round(semi, 12))
    explicit = result.measure("distance_to_explicit", distance("explicit_euler", 0.3))
    result.statement = "Matrix of one step at omega h = 0.3, and at ten random ones."
    result.statement_holds(semi < 1e-12)
    result.correction_holds(
        explicit > 1e-3,
        max(distance("semi_implicit_euler", x) for x in result.rng.uniform(0.01, 3, 10)) < 1e-12,
        # With damping it must differ, because MuJoCo takes the damping implicitly.
        distance("semi_implicit_euler", 0.3, 0.2) > 1e-3,
    )


@claim(
    "MuJoCo is so stable because its Euler integrator is semi-implicit.",
    "Being semi-implicit gives a joint's spring the limit omega h = 2 and no more: at "
    "{just_above:.2f} it explodes. What keeps stiff contacts quiet is a clamp of their time "
    "constant: with it a contact asked to be four times too stiff rests "
    "without moving under Euler and under RK4, which is not symplectic; without it the "
    "same Euler throws the ball about by {rest_free_m:.1f} m.",
)
def mujoco_stable_by_euler(result):
    import mujoco

    def moves(integrator, clamp):
        """Return range of the height of a ball at rest, its contact asked for half a step [m]."""
        # A time constant of half a step: refsafe would raise it to two steps.
        contact = 'solref="0.001 1"'
        model, data = small_model(
            f'<geom type="plane" size="1 1 1" {contact}/><body pos="0 0 .15">'
            f'<joint type="slide" axis="0 0 1"/><geom size=".1" mass="1" {contact}/></body>',
            0.002,
            integrator,
            "",
            f'refsafe="{clamp}"',
        )
        heights = []
        for _ in range(1000):
            mujoco.mj_step(model, data)
            heights.append(data.qpos[0])
        # The second half of the run, after the ball has settled or not.
        return np.ptp(heights[500:])

    above = result.input("just_above", 2.01)
    quiet = [moves(name, "enable") for name in ("Euler", "RK4", "implicitfast")]
    result.measure("rest_clamped_m", round(max(quiet), 9))
    free = result.measure("rest_free_m", moves("Euler", "disable"), tolerance=0.2)
    result.statement = (
        "A ball that lies on a plane, 2 ms, time constant 1 ms; and 1 kg on a spring."
    )
    result.statement_holds(not _grows("Euler", above) and free < 1e-3)
    result.correction_holds(
        _grows("Euler", above), not _grows("Euler", 1.99), max(quiet) < 1e-9, free > 1
    )


@claim(
    "A step first integrates and then detects collisions, so that its contacts belong to its "
    "positions.",
    "The order is a choice. This course's loop does so; MuJoCo detects first and integrates last, "
    "so after mj_step the contacts are those of the positions before it: of {falls:.0f} balls that "
    "had just sunk into the floor {seen_after_step:.0f} had a contact, "
    "and {seen_after_forward:.0f} after mj_forward.",
    source="MuJoCo 4.0 documentation (2026), Computation, Simulation pipeline",
)
def collisions_after_integration(result):
    import mujoco

    from course.rigid_body.loop import FixedStepLoop, Phases

    falls = result.input("falls", 12)
    model, data = small_model(
        '<geom type="plane" size="1 1 1"/><body pos="0 0 .1"><joint type="slide" axis="0 0 1"/>'
        '<geom size=".1" mass="1"/></body>',
        0.002,
    )

    def contacts(height):
        """Return contacts just after the step in which the ball sank in, and after mj_forward."""
        mujoco.mj_resetData(model, data)
        data.qpos[0] = height
        while data.qpos[0] > 0:
            mujoco.mj_step(model, data)
        # Contacts of the positions before the step's integration.
        stale = data.ncon
        mujoco.mj_forward(model, data)
        return stale, data.ncon

    observed = np.array([contacts(h) for h in result.rng.uniform(0.05, 0.5, int(falls))])
    result.measure("seen_after_step", observed[:, 0].sum())
    result.measure("seen_after_forward", observed[:, 1].sum())
    loop = FixedStepLoop(0.0, Phases(lambda state, force, dt: state), record=True)
    loop.advance(0.001)
    phases = [event.phase for event in loop.trace]
    result.statement = "Balls from random heights in MuJoCo; the trace of one step of the loop."
    result.statement_holds(observed[:, 0].sum() == falls)
    result.correction_holds(
        observed[:, 0].sum() == 0,
        observed[:, 1].sum() == falls,
        phases.index("integrate") < phases.index("detect collisions"),
    )


@claim(
    "MuJoCo's Euler takes the damping of joints explicitly, so strong damping needs a small step.",
    "Damping of joints enters implicitly: a step divides the velocity by 1 + h c / m and is stable "
    "for any c. Only with the eulerdamp flag off is it explicit.",
)
def mujoco_euler_damping_explicit(result):
    import mujoco

    h = 0.002

    def remaining(c, flag="enable"):
        """Return the velocity after a step from 1 m/s, 1 kg."""
        model, data = _spring("Euler", h, 0.0, c, f'eulerdamp="{flag}"')
        data.qvel[0] = 1.0
        mujoco.mj_step(model, data)
        return data.qvel[0]

    implicit = result.measure("velocity_left", remaining(1e5))
    explicit = result.measure("velocity_left_explicit", remaining(1e5, "disable"))
    result.statement = (
        "1 kg at 1 m/s with 100 kN s/m, one step of 2 ms; then with the eulerdamp flag off; and "
        "with twelve random dampings."
    )
    result.statement_holds(abs(implicit) > 1)
    result.correction_holds(
        abs(explicit - (1 - h * 1e5)) < 1e-6,
        # Eleven decades of damping against 1 / (1 + h c / m).
        all(
            abs(remaining(c) * (1 + h * c) - 1) < 1e-9 for c in 10 ** result.rng.uniform(-2, 9, 12)
        ),
    )


@claim(
    "MuJoCo's default integrator is stable for arbitrarily stiff springs.",
    "A joint's spring is explicit under Euler, implicit and implicitfast: the limit is omega h = "
    "2, as for any semi-implicit Euler.",
)
def mujoco_any_stiffness(result):
    names = ("Euler", "implicit", "implicitfast")
    limits = [result.measure(f"{n}_omega_h", _limit(n), tolerance=2e-3) for n in names]
    result.statement = "Largest stable step on 1 kg and 1 N/m, by bisection."
    result.statement_holds(np.isinf(limits[0]))
    # The bisection is good to 1 in 2000, hence 2e-3.
    result.correction_holds(all(abs(value / 2 - 1) < 2e-3 for value in limits))


@claim(
    "Under MuJoCo's Euler damping does not change the largest stable step of a stiff joint.",
    "Damping is implicit there and raises the limit to {formula}, from 2 sqrt(m / k) without it. "
    "Taken explicitly it would lower it.",
    ask=(
        "Semi-implicit Euler, with the damping force from the new velocity, as in MuJoCo's Euler: "
        "what is the largest stable step of a damped spring with a mass?",
        "dt < (c + sqrt(c^2 + 4*m*k))/k",
        {
            "2*sqrt(m/k)": "Yours is the limit without damping.",
            "(-c + sqrt(c^2 + 4*m*k))/k": "Yours is the limit with explicit damping.",
            "(c + sqrt(c^2 + m*k))/k": "Check c = 0, where it must be 2 sqrt(m / k).",
        },
    ),
)
def mujoco_damped_limit(result):
    import sympy

    m, k, c, h = sympy.symbols("m k c h", positive=True)
    # (m + h c) v1 = m v - h k x, x1 = x + h v1: at the limit an eigenvalue is -1.
    A = sympy.Matrix(
        [[1 - h**2 * k / (m + h * c), h * m / (m + h * c)], [-h * k / (m + h * c), m / (m + h * c)]]
    )
    at_limit = sympy.numer(sympy.together(1 + A.trace() + A.det()))
    limit = next(root for root in sympy.solve(at_limit, h) if root.subs({m: 1, k: 1, c: 1}) > 0)
    result.formula = sympy.simplify(limit)
    theory = float(limit.subs({m: 1, k: 1, c: 4}))
    measured = result.measure("measured_c_4", _limit("Euler", 4.0), tolerance=2e-3)
    result.measure("theory_c_4", theory, tolerance=2e-3)
    result.statement = (
        f"1 kg, 1 N/m, 4 N s/m: {measured:.3f} s measured, {theory:.3f} s from the step's matrix."
    )
    result.statement_holds(abs(measured - 2) < 0.01)
    result.correction_holds(
        abs(measured / theory - 1) < 2e-3,
        abs(_limit("Euler", 1.0) / float(limit.subs({m: 1, k: 1, c: 1})) - 1) < 2e-3,
    )


@claim(
    "Every integrator of MuJoCo has a largest stable step on a stiff joint.",
    "The discrete integrator takes the spring implicitly and has none. On a spring it is implicit "
    "Euler, and the price is damping: without any friction each step divides the energy by "
    "1 + (omega h)^2.",
)
def mujoco_discrete_has_a_limit(result):
    import mujoco

    def retained(omega_h, steps):
        model, data = _spring("discrete", omega_h, 1.0)
        data.qpos[0] = 1.0
        mujoco.mj_step(model, data, steps)
        return data.qpos[0] ** 2 + data.qvel[0] ** 2

    remaining = result.measure("energy_kept_after_10_s", retained(0.1, 100), tolerance=1e-3)
    result.statement = (
        f"Stable at omega h up to 1000. At omega h = 0.1 the share {remaining:.3f} of the energy "
        f"is left after 100 steps; implicit Euler keeps {(1 / (1 + 0.1**2)) ** 100:.3f}."
    )
    steps = 10 ** result.rng.uniform(-2, 3, 12)
    result.statement_holds(any(_grows("discrete", x, steps=300) for x in (*steps, 1000.0)))
    # Implicit Euler's factor 1 / (1 + (omega h)^2), over five decades of omega h.
    result.correction_holds(all(abs(retained(x, 3) * (1 + x * x) ** 3 - 1) < 1e-8 for x in steps))


@claim(
    "MuJoCo's RK4 is the classical one: four force computations, stable up to omega h = 2 sqrt(2).",
    "Four computations per step against one of the others, and the theoretical limit. Its damping "
    "is explicit, so strong damping lowers that limit, to omega h = {limit_damped_zeta_2:.2f} at "
    "a damping ratio of 2.",
)
def mujoco_rk4(result):
    import mujoco

    from course.derivations.rigid_body.linear import measured_limit

    def computations(name):
        """Force computations per step, counted with a callback."""
        model, data = _spring(name, 0.01, 1.0)
        calls: list[Any] = []
        # The passive-force callback runs once in every evaluation of the forces.
        mujoco.set_mjcb_passive(lambda model, data: calls.append(None))
        try:
            mujoco.mj_step(model, data, 10)
        finally:
            mujoco.set_mjcb_passive(None)
        return np.size(calls) / 10

    rk4 = result.measure("computations_rk4", computations("RK4"))
    euler = result.measure("computations_euler", computations("Euler"))
    limit = result.measure("limit_omega_h", _limit("RK4"), tolerance=2e-3)
    damped = result.measure("limit_damped_zeta_2", _limit("RK4", 4.0), tolerance=2e-3)
    result.statement = "Counted with a callback; limits by bisection on 1 kg and 1 N/m."
    result.statement_holds(rk4 == 4 and abs(limit / np.sqrt(8) - 1) < 2e-3)
    result.correction_holds(
        euler == 1,
        damped < 0.5 * limit,
        abs(damped / measured_limit("rk4", 2.0, low=0.01) - 1) < 2e-3,
    )


@claim(
    "MuJoCo's RK4 drops below fourth order on a tumbling body.",
    "In MuJoCo 4 it is of fourth order there too; Euler and the implicit integrators are of first.",
)
def mujoco_rk4_on_rotations(result):
    import mujoco

    from course.rigid_body import problems

    problem = problems.tumble(duration=2.0)

    def error(integrator, timestep):
        model, data = _free_body(integrator, timestep)
        data.qpos[3:], data.qvel[3:] = problem.system.q0, problem.system.v0
        mujoco.mj_step(model, data, round(2.0 / timestep))
        return problem.error(data.qpos[3:].copy())

    def order(name):
        # Observed order against Jacobi's closed form; both steps are in the asymptotic range.
        return np.log2(error(name, 0.01) / error(name, 0.005))

    names = ("Euler", "RK4", "implicitfast")
    euler, rk4, fast = (result.measure(f"{n}_order", order(n), tolerance=0.02) for n in names)
    result.statement = (
        "Observed on a free body with moments 1:2:3, steps of 10 and 5 ms, against Jacobi's closed "
        "form."
    )
    result.statement_holds(rk4 < 3.5)
    result.correction_holds(
        abs(rk4 - 4) < 0.1, *(abs(o - 1) < 0.1 for o in (euler, fast, order("implicit")))
    )


@claim(
    "MuJoCo's default integrator keeps the kinetic energy of a free tumbling body from growing.",
    "Its Euler takes the gyroscopic term explicitly: the energy grows, and a fast spin blows up. "
    "Implicit, implicitfast and discrete take it implicitly for a free body: their energy falls "
    "instead, at first order.",
)
def mujoco_free_spin_energy(result):
    import mujoco

    def fastest(integrator):
        """Return the largest rate within 1000 steps of 10 ms from 135 rad/s, to 10,000 [rad/s]."""
        model, data = _free_body(integrator, 0.01, spin=(50.0, 100.0, 75.0))
        rate = 0.0
        for _ in range(1000):
            mujoco.mj_step(model, data)
            rate = max(rate, np.abs(data.qvel[3:]).max())
            if rate > 1e4:
                break
        return rate

    euler = result.measure("euler_after_5_s", _energy("Euler"), tolerance=1e-3)
    fast = result.measure("implicitfast_after_5_s", _energy("implicitfast"), tolerance=1e-3)
    bodies = [_random_tumble(result.rng) for _ in range(8)]
    grown = [_energy("Euler", moments, spin=spin) for moments, spin in bodies]
    falling = [
        _energy(name, moments, spin=spin)
        for name in ("implicit", "implicitfast", "discrete")
        for moments, spin in bodies
    ]
    # A loss of first order halves with the step.
    halved = (1 - _energy("implicitfast", timestep=0.00125)) / (1 - fast)
    result.statement = (
        f"Kinetic energy over that at the start, 2.5 ms. From 135 rad/s at 10 ms Euler passes "
        f"10,000 rad/s; implicitfast stays below {fastest('implicitfast'):.0f} rad/s."
    )
    result.statement_holds(euler <= 1)
    result.correction_holds(
        min(grown) > 1 > max(falling),
        abs(halved - 0.5) < 0.05,
        fastest("Euler") > 1e4,
        fastest("implicitfast") < 200,
    )


@claim(
    "MuJoCo's implicitfast integrator takes gyroscopic forces implicitly.",
    "It does so for a body on a free joint that stands alone. Let it carry one joint, with a part "
    "of a milligram on it, and implicitfast gains the energy that Euler gains; implicit does not. "
    "On a ball joint a body gains energy, too.",
)
def mujoco_implicitfast_gyroscopic(result):
    import mujoco

    part = (
        '<body><joint type="slide" axis="1 0 0"/>'
        '<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-6 1e-6 1e-6"/></body>'
    )
    result.measure("alone", _energy("implicitfast"), tolerance=1e-4)
    loaded = result.measure("with_a_joint", _energy("implicitfast", child=part), tolerance=1e-4)
    euler = result.measure("euler", _energy("Euler", child=part), tolerance=1e-4)
    implicit = result.measure("implicit_with_a_joint", _energy("implicit", child=part), 1e-4)
    result.statement = "Kinetic energy after 5 s of tumbling over that at the start, 2.5 ms."
    bodies = [_random_tumble(result.rng) for _ in range(8)]

    def scene(moments, spin, joint="<freejoint/>", centre="0 0 0", more="", elsewhere=""):
        """Return the kinetic energy after 5 s over that at the start; the body comes last."""
        inertia = " ".join(map(repr, map(float, moments)))
        model, data = small_model(
            f"{elsewhere}<body>{joint}"
            f'<inertial pos="{centre}" mass="1" diaginertia="{inertia}"/>{more}</body>',
            0.0025,
            "implicitfast",
            'gravity="0 0 0"',
            'energy="enable"',
        )
        data.qvel[-3:] = spin
        # The centre of mass stays where it is; the joint's own velocity is that of the frame.
        data.qvel[:3] -= np.cross(spin, np.array(centre.split(), dtype=float)) * (model.nv > 3)
        mujoco.mj_forward(model, data)
        start = data.energy[1]
        mujoco.mj_step(model, data, 2000)
        mujoco.mj_forward(model, data)
        return data.energy[1] / start

    # Chosen to break it: a centre of mass aside, a part without a joint, a second body.
    aside = {"centre": ".5 .2 -.3"}
    welded = {"more": part.replace('<joint type="slide" axis="1 0 0"/>', "")}
    second = {"elsewhere": '<body pos="9 0 0"><freejoint/><geom size=".1"/></body>'}
    hostile = [scene(m, spin, **x) for m, spin in bodies[:3] for x in (aside, welded)]
    hostile += [scene(m, spin, **second) for m, spin in bodies[:3]]
    # Chosen to break it: the same bodies turn as freely on a ball joint.
    on_ball = [scene(m, spin, '<joint type="ball"/>') for m, spin in bodies]
    result.statement_holds(
        loaded < 1,
        only_if="the body moves on a free joint and carries no further joint",
        inside=[_energy("implicitfast", m, spin=spin) < 1 for m, spin in bodies]
        + [x < 1 for x in hostile],
        # The same bodies with a joint that hardly weighs anything.
        outside=[_energy("implicitfast", m, part, spin) < 1 for m, spin in bodies]
        + [x < 1 for x in on_ball],
    )
    result.correction_holds(
        abs(loaded - euler) < 1e-9,
        implicit < 1,
        all(_energy("implicit", m, part, spin) < 1 for m, spin in bodies),
        min(on_ball) > 1,
    )


@claim(
    "MuJoCo on the GPU (MJX) is differentiable.",
    "MJX has two implementations. The one in JAX is differentiable, in reverse mode as far as its "
    "solver's loop is unrolled; the one on Warp, which is the fast one for contacts, is not, and "
    "neither is MuJoCo Warp by itself. MuJoCo's own derivative of a step, mjd_transitionFD, is by "
    "finite differences: on a pendulum a ten times larger difference makes the error "
    "{error_ratio:.0f} times as large.",
    source="MuJoCo 4.0 manual (2026), MJX, feature parity; MuJoCo Warp, FAQ; "
    "google-deepmind/mujoco issue 2259 (2024 to 2026), reverse mode through the solver; Warp 1.x "
    "documentation, Differentiability: adjoints of kernels; Brax 0.13 (2025): only its training "
    "part is maintained, for physics it points to MJX",
)
def mjx_is_differentiable(result):
    version, mjx = _manual("mjx.rst")
    _, warp = _manual("mjwarp/index.rst")
    result.measure("manual", ".".join(version.split(".")[:2]))
    # Centred differences are of second order and serve as the truth for the one-sided ones.
    truth = _derivative(1e-5, centred=1)
    large, small = (np.abs(_derivative(d) - truth).max() for d in (1e-2, 1e-3))
    ratio = result.measure("error_ratio", large / small, tolerance=0.01)
    on_warp = "is **not** currently available in MJX-Warp" not in mjx
    result.statement = f"Read in the manual that MuJoCo {version} installs; a step of a pendulum."
    result.statement_holds(
        on_warp,
        only_if="its implementation in JAX is meant",
        inside=["mostly supported" in mjx and "not support automatic differentiation" in mjx],
        outside=[on_warp],
        cases=True,
    )
    result.correction_holds(
        "MJWarp is not currently differentiable" in warp,
        abs(ratio / 10 - 1) < 0.05,
    )
