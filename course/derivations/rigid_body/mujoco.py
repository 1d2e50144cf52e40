"""Claims about what MuJoCo's integrators really do, each measured on a model of a few lines."""

from typing import Any

import numpy as np

from course.derivations import Finding, Formula, Verdict, claim
from course.derivations.answer import Symbol

_INTEGRATORS = ("Euler", "RK4", "implicit", "implicitfast", "discrete")


def _model(
    worldbody: str, timestep: float, integrator: str, more: str = "", flags: str = ""
) -> Any:
    """(model, data) of a small scene; a run that blows up is not reset."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{timestep}" integrator="{integrator}" {more}>'
        f'<flag autoreset="disable" {flags}/></option>'
        f"<worldbody>{worldbody}</worldbody></mujoco>"
    )
    return model, mujoco.MjData(model)


def _spring(integrator: str, timestep: float, stiffness: float, damping: float = 0.0) -> Any:
    return _model(
        f'<body><joint type="slide" axis="1 0 0" stiffness="{stiffness}" damping="{damping}"/>'
        '<geom size=".1" mass="1"/></body>',
        timestep, integrator, 'gravity="0 0 0"',
    )  # fmt: skip


def _grows(integrator: str, timestep: float, damping: float = 0.0, steps: int = 3000) -> bool:
    """Whether 1 kg on 1 N/m, released at 1 m, leaves 100 m."""
    import mujoco

    model, data = _spring(integrator, timestep, 1.0, damping)
    data.qpos[0] = 1.0
    for _ in range(steps):
        mujoco.mj_step(model, data)
        if not abs(data.qpos[0]) < 100.0:
            return True
    return False


def _limit(integrator: str, damping: float = 0.0) -> float:
    """Largest stable omega h by bisection, to a part in 2000."""
    low, high = 0.1, 16.0
    if not _grows(integrator, 1000.0, damping):
        return float("inf")
    while high / low > 1.0005:
        middle = float(np.sqrt(low * high))
        if _grows(integrator, middle, damping):
            high = middle
        else:
            low = middle
    return low


_TUMBLE = '<body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 2 3"/></body>'


def _tumble(integrator: str, timestep: float, seconds: float) -> tuple[float, float]:
    """(angle to the closed form [rad], kinetic energy over that at the start)."""
    import mujoco

    from course.rigid_body import problems

    problem = problems.tumble(duration=seconds)
    model, data = _model(_TUMBLE, timestep, integrator, 'gravity="0 0 0"')
    data.qpos[3:], data.qvel[3:] = problem.system.q0, problem.system.v0
    mujoco.mj_step(model, data, round(seconds / timestep))
    params = problem.system.params
    start = problems.tumble_energy(problem.system.q0, problem.system.v0, params)
    now = problems.tumble_energy(problem.system.q0, data.qvel[3:].copy(), params)
    return problem.error(data.qpos[3:].copy()), float(now / start)


@claim(
    "mujoco_defaults",
    1,
    "MuJoCo's default is RK4 at 1 kHz.",
    verdict=Verdict.FALSE,
    corrected="The default is its semi-implicit Euler with a step of 2 ms.",
    figures={"timestep_ms": (2, 0), "integrator": ("euler", 0)},
)
def _mujoco_defaults() -> Finding:
    import mujoco

    option = mujoco.MjModel.from_xml_string("<mujoco/>").opt
    name = mujoco.mjtIntegrator(option.integrator).name.removeprefix("mjINT_").lower()
    return Finding(
        {"timestep_ms": 1000 * option.timestep, "integrator": name},
        "Read from an empty model.",
        holds=name == "rk4" and option.timestep == 0.001,
        corrected=name == "euler" and option.timestep == 0.002,
    )


@claim(
    "mujoco_euler_is_semi_implicit",
    1,
    "MuJoCo's Euler is semi-implicit.",
    verdict=Verdict.HOLDS,
    corrected="Without damping its step on a spring is, to rounding, the semi-implicit Euler of "
    "this "
    "course: velocity first.",
    figures={"distance_to_semi_implicit": (0, 1e-6), "distance_to_explicit": (0.09, 1e-6)},
)
def _mujoco_euler_is_semi_implicit() -> Finding:
    import mujoco

    from course.derivations.rigid_body.linear import numeric_matrix

    columns = []
    for x, v in ((1.0, 0.0), (0.0, 1.0)):
        model, data = _spring("Euler", 0.3, 1.0)
        data.qpos[0], data.qvel[0] = x, v
        mujoco.mj_step(model, data)
        columns.append([data.qpos[0], data.qvel[0]])
    found = np.array(columns).T
    semi = float(np.abs(found - numeric_matrix("semi_implicit_euler", 0.3)).max())
    explicit = float(np.abs(found - numeric_matrix("explicit_euler", 0.3)).max())
    return Finding(
        {"distance_to_semi_implicit": round(semi, 12), "distance_to_explicit": explicit},
        "Matrix of one step at omega h = 0.3.",
        holds=semi < 1e-12,
        corrected=explicit > 1e-3,
    )


@claim(
    "mujoco_euler_damping_explicit",
    1,
    "MuJoCo's Euler takes the damping of joints explicitly, so strong damping needs a small step.",
    verdict=Verdict.FALSE,
    corrected="Damping of joints enters implicitly: a step divides the velocity by 1 + h c / m and "
    "is stable for any c. Only with the eulerdamp flag off is it explicit.",
    figures={"velocity_left": (0.004975124, 1e-6), "velocity_left_explicit": (-199, 1e-6)},
)
def _mujoco_euler_damping_explicit() -> Finding:
    import mujoco

    h, c = 0.002, 1e5
    left = {}
    for flag in ("enable", "disable"):
        model, data = _model(
            f'<body><joint type="slide" axis="1 0 0" damping="{c}"/><geom size=".1" '
            'mass="1"/></body>',
            h, "Euler", 'gravity="0 0 0"', f'eulerdamp="{flag}"',
        )  # fmt: skip
        data.qvel[0] = 1.0
        mujoco.mj_step(model, data)
        left[flag] = float(data.qvel[0])
    return Finding(
        {"velocity_left": left["enable"], "velocity_left_explicit": left["disable"]},
        "1 kg at 1 m/s with 100 kN s/m, one step of 2 ms; then with the eulerdamp flag off.",
        holds=abs(left["enable"]) > 1,
        corrected=abs(left["enable"] * (1 + h * c) - 1) < 1e-9
        and abs(left["disable"] - (1 - h * c)) < 1e-6,
    )


@claim(
    "mujoco_any_stiffness",
    1,
    "MuJoCo's default integrator is stable for arbitrarily stiff springs.",
    verdict=Verdict.FALSE,
    corrected="A joint's spring is explicit under Euler, implicit and implicitfast: the limit is "
    "omega h = 2, as for any semi-implicit Euler.",
    figures={
        "Euler_omega_h": (1.999372, 2e-3),
        "implicit_omega_h": (1.999372, 2e-3),
        "implicitfast_omega_h": (1.999372, 2e-3),
    },
)
def _mujoco_any_stiffness() -> Finding:
    limits = {name: _limit(name) for name in ("Euler", "implicit", "implicitfast")}
    return Finding(
        {f"{name}_omega_h": value for name, value in limits.items()},
        "Largest stable step on 1 kg and 1 N/m, by bisection.",
        holds=bool(np.isinf(limits["Euler"])),
        corrected=all(abs(value / 2 - 1) < 2e-3 for value in limits.values()),
    )


@claim(
    "mujoco_damped_limit",
    1,
    "Under MuJoCo's Euler damping does not change the largest stable step of a stiff joint.",
    verdict=Verdict.FALSE,
    corrected="Damping is implicit there and raises the limit to (c + sqrt(c^2 + 4 m k)) / k, from "
    "2 sqrt(m / k) without it. Taken explicitly it would lower it.",
    figures={"measured_c_4": (8.476204, 2e-3), "theory_c_4": (8.472136, 2e-3)},
    formula=Formula(
        "The spring is explicit, the damping implicit, as in MuJoCo's Euler. What is the largest "
        "stable step?",
        "(c + sqrt(c^2 + 4*m*k))/k",
        {
            "m": Symbol("mass [kg]"),
            "k": Symbol("stiffness [N/m]"),
            "c": Symbol("damping [N s/m]"),
        },
        left=("h", "dt"),
        relation="<",
        slips={
            "2*sqrt(m/k)": "That is the limit without damping.",
            "(-c + sqrt(c^2 + 4*m*k))/k": "That is the limit with explicit damping.",
            "(c + sqrt(c^2 + m*k))/k": "Check c = 0, where it must be 2 sqrt(m / k).",
        },
    ),
)
def _mujoco_damped_limit() -> Finding:
    import sympy

    m, k, c, h = sympy.symbols("m k c h", positive=True)
    # (m + h c) v1 = m v - h k x, x1 = x + h v1: at the limit an eigenvalue is -1.
    A = sympy.Matrix(
        [[1 - h**2 * k / (m + h * c), h * m / (m + h * c)], [-h * k / (m + h * c), m / (m + h * c)]]
    )
    at_limit = sympy.numer(sympy.together(1 + A.trace() + A.det()))
    limit = next(root for root in sympy.solve(at_limit, h) if root.subs({m: 1, k: 1, c: 1}) > 0)
    measured = _limit("Euler", 4.0)
    theory = float(limit.subs({m: 1, k: 1, c: 4}))
    return Finding(
        {"measured_c_4": measured, "theory_c_4": theory},
        f"1 kg, 1 N/m, 4 N s/m: {measured:.3f} s measured, {theory:.3f} s from the step's matrix.",
        holds=abs(measured - 2) < 0.01,
        corrected=abs(measured / theory - 1) < 2e-3,
        formula=sympy.simplify(limit),
    )


@claim(
    "mujoco_discrete_has_a_limit",
    1,
    "Every integrator of MuJoCo has a largest stable step on a stiff joint.",
    verdict=Verdict.FALSE,
    corrected="The discrete integrator takes the spring implicitly and has none. On a spring it is "
    "implicit Euler, and the price is damping: without any friction each step divides the energy "
    "by 1 + (omega h)^2.",
    figures={"energy_kept_after_10_s": (0.3697112, 1e-3)},
)
def _mujoco_discrete_has_a_limit() -> Finding:
    import mujoco

    grows = _grows("discrete", 1000.0, steps=1000)
    model, data = _spring("discrete", 0.1, 1.0)
    data.qpos[0] = 1.0
    mujoco.mj_step(model, data, 100)
    kept = float(data.qpos[0] ** 2 + data.qvel[0] ** 2)
    implicit_euler = (1 / (1 + 0.1**2)) ** 100
    return Finding(
        {"energy_kept_after_10_s": kept},
        f"Stable at omega h = 1000. At omega h = 0.1 the share {kept:.3f} of the energy is left "
        f"after 100 steps; implicit Euler keeps {implicit_euler:.3f}.",
        holds=grows,
        corrected=not grows and abs(kept / implicit_euler - 1) < 1e-9,
    )


@claim(
    "mujoco_rk4",
    1,
    "MuJoCo's RK4 is the classical one: four force computations, stable up to omega h = 2 sqrt(2).",
    verdict=Verdict.HOLDS,
    corrected="Four computations per step against one of the others, and the theoretical limit. "
    "Its "
    "damping is explicit, so strong damping lowers that limit.",
    figures={
        "computations_rk4": (4, 2e-3),
        "computations_euler": (1, 2e-3),
        "limit_omega_h": (2.828563, 2e-3),
        "limit_damped_zeta_2": (0.7466068, 2e-3),
    },
)
def _mujoco_rk4() -> Finding:
    import mujoco

    counts = {}
    calls = 0

    def count(model: Any, data: Any) -> None:
        nonlocal calls
        calls += 1

    for name in ("Euler", "RK4"):
        model, data = _spring(name, 0.01, 1.0)
        calls = 0
        mujoco.set_mjcb_passive(count)
        try:
            for _ in range(10):
                mujoco.mj_step(model, data)
        finally:
            mujoco.set_mjcb_passive(None)
        counts[name] = calls / 10
    limit, damped = _limit("RK4"), _limit("RK4", 4.0)
    return Finding(
        {"computations_rk4": counts["RK4"], "computations_euler": counts["Euler"],
         "limit_omega_h": limit, "limit_damped_zeta_2": damped},
        "Counted with a callback; limits by bisection on 1 kg and 1 N/m.",
        holds=counts["RK4"] == 4 and abs(limit / np.sqrt(8) - 1) < 2e-3,
        corrected=counts["Euler"] == 1 and damped < 0.5 * limit,
    )  # fmt: skip


@claim(
    "mujoco_rk4_on_rotations",
    1,
    "MuJoCo's RK4 drops below fourth order on a tumbling body.",
    verdict=Verdict.FALSE,
    corrected="In MuJoCo 4 it is of fourth order there too; Euler and the implicit integrators are "
    "of first.",
    figures={
        "Euler_order": (1.009195, 0.02),
        "RK4_order": (4.006918, 0.02),
        "implicitfast_order": (0.995147, 0.02),
    },
)
def _mujoco_rk4_on_rotations() -> Finding:
    orders = {
        name: float(np.log2(_tumble(name, 0.01, 2.0)[0] / _tumble(name, 0.005, 2.0)[0]))
        for name in ("Euler", "RK4", "implicitfast")
    }
    return Finding(
        {f"{name}_order": order for name, order in orders.items()},
        "Observed on a free body with moments 1:2:3, steps of 10 and 5 ms, against Jacobi's closed "
        "form.",
        holds=orders["RK4"] < 3.5,
        corrected=abs(orders["RK4"] - 4) < 0.1
        and abs(orders["Euler"] - 1) < 0.1
        and abs(orders["implicitfast"] - 1) < 0.1,
    )


@claim(
    "mujoco_free_spin_energy",
    1,
    "MuJoCo's default integrator keeps the kinetic energy of a free tumbling body from growing.",
    verdict=Verdict.FALSE,
    corrected="Its Euler takes the gyroscopic term explicitly: the energy grows, and a fast spin "
    "blows up. Implicit, implicitfast and discrete take it implicitly for a free body: their "
    "energy falls instead, at first order.",
    figures={"euler_after_5_s": (1.005345, 1e-3), "implicitfast_after_5_s": (0.9947997, 1e-3)},
)
def _mujoco_free_spin_energy() -> Finding:
    import mujoco

    ratios = {name: _tumble(name, 0.0025, 5.0)[1] for name in ("Euler", "implicitfast")}
    model, data = _model(_TUMBLE, 0.01, "Euler", 'gravity="0 0 0"')
    fast, fast_data = _model(_TUMBLE, 0.01, "implicitfast", 'gravity="0 0 0"')
    for d in (data, fast_data):
        d.qvel[3:] = np.array([50.0, 100.0, 75.0])
    largest = 0.0
    steps, blown = 0, 0.0
    while steps < 1000 and blown < 1e4:
        mujoco.mj_step(model, data)
        steps, blown = steps + 1, float(np.abs(data.qvel[3:]).max())
    for _ in range(1000):
        mujoco.mj_step(fast, fast_data)
        largest = max(largest, float(np.abs(fast_data.qvel[3:]).max()))
    return Finding(
        {"euler_after_5_s": ratios["Euler"], "implicitfast_after_5_s": ratios["implicitfast"]},
        f"Kinetic energy over that at the start, 2.5 ms. From 135 rad/s at 10 ms Euler is beyond "
        f"10,000 rad/s after {steps} steps; implicitfast stays below {largest:.0f} rad/s.",
        holds=ratios["Euler"] <= 1,
        corrected=ratios["Euler"] > 1 > ratios["implicitfast"] and blown > 1e4
        and largest < 200,
    )  # fmt: skip


@claim(
    "mujoco_implicitfast_gyroscopic",
    1,
    "MuJoCo's implicitfast integrator takes gyroscopic forces implicitly.",
    verdict=Verdict.CONDITIONAL,
    condition="the free body carries no further joint",
    corrected="It does so for a free body that stands alone. Let it carry one joint, with a "
    "part of "
    "a milligram on it, and implicitfast gains the energy that Euler gains; implicit does not.",
    figures={
        "alone": (0.9947997, 1e-4),
        "with_a_joint": (1.005345, 1e-4),
        "euler": (1.005345, 1e-4),
        "implicit_with_a_joint": (0.9947998, 1e-4),
    },
)
def _mujoco_implicitfast_gyroscopic() -> Finding:
    import mujoco

    part = (
        '<body><joint type="slide" axis="1 0 0"/>'
        '<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-6 1e-6 1e-6"/></body>'
    )

    def energy(integrator: str, child: str) -> float:
        """Kinetic energy after 5 s over that at the start."""
        model, data = _model(
            _TUMBLE.replace("</body>", child + "</body>"), 0.0025, integrator, 'gravity="0 0 0"'
        )
        data.qvel[3:6] = start = np.array([1.0, 0.0, 1.5])
        mujoco.mj_step(model, data, 2000)
        moments = np.array([1.0, 2.0, 3.0])
        return float(moments @ data.qvel[3:6] ** 2 / (moments @ start**2))

    alone, loaded = energy("implicitfast", ""), energy("implicitfast", part)
    euler, implicit = energy("Euler", part), energy("implicit", part)
    return Finding(
        {"alone": alone, "with_a_joint": loaded, "euler": euler, "implicit_with_a_joint": implicit},
        "Kinetic energy after 5 s of tumbling over that at the start, 2.5 ms.",
        holds=alone < 1 and loaded < 1,
        holds_if=alone < 1,
        corrected=abs(loaded - euler) < 1e-9 and implicit < 1,
    )


@claim(
    "mujoco_rk4_contact_order",
    1,
    "With RK4 MuJoCo's contacts are accurate to fourth order.",
    verdict=Verdict.FALSE,
    corrected="The contact force is not smooth where contact begins, so a drop is followed to "
    "about "
    "first order in the step, as with Euler.",
    figures={"order": (1.068591, 0.1)},
)
def _mujoco_rk4_contact_order() -> Finding:
    import mujoco

    def heights(steps: int) -> np.ndarray:
        model, data = _model(
            '<geom type="plane" size="1 1 1" solref="-5000 -5"/><body pos="0 0 .1">'
            '<joint type="slide" axis="0 0 1"/>'
            '<geom size=".1" mass="1" solref="-5000 -5"/></body>',
            0.4 / steps, "RK4",
        )  # fmt: skip
        ends = []
        for drop in np.linspace(0.1, 0.3, 30):
            mujoco.mj_resetData(model, data)
            data.qpos[0] = drop
            mujoco.mj_step(model, data, steps)
            ends.append(data.qpos[0])
        return np.array(ends)

    reference = heights(3200)
    coarse, fine = (float(np.abs(heights(n) - reference).mean()) for n in (100, 400))
    order = float(np.log2(coarse / fine) / 2)
    return Finding(
        {"order": order},
        f"A ball dropped from 30 heights: mean error {coarse:.1e} m at 4 ms, {fine:.1e} m at "
        "0.5 ms.",
        holds=order > 3.5,
        corrected=0.5 < order < 2.0,
    )


@claim(
    "mujoco_contact_stiffness_limit",
    1,
    "Stiff contacts in MuJoCo need a small step.",
    verdict=Verdict.CONDITIONAL,
    condition="the refsafe flag is off, or stiffness and damping are given as numbers",
    corrected="By default MuJoCo keeps the contact's time constant at two steps or more, so asking "
    "for a stiffer one changes nothing. With the flag off half a step of time constant explodes; "
    "and stiffness and damping given directly, as a negative solref, are taken as they are.",
    figures={"depth_asked_1_ms_um": (17.48191, 1e-3), "depth_asked_4_ms_um": (17.48191, 1e-3)},
)
def _mujoco_contact_stiffness_limit() -> Finding:
    import mujoco

    def deviation(solref: str, safe: str) -> tuple[float, float]:
        """(mean depth at rest, range of the height at rest) over the last of two seconds [m]."""
        model, data = _model(
            f'<geom type="plane" size="1 1 1" solref="{solref}"/><body pos="0 0 .15">'
            '<joint type="slide" axis="0 0 1"/>'
            f'<geom size=".1" mass="1" solref="{solref}"/></body>',
            0.002, "Euler", "", f'refsafe="{safe}"',
        )  # fmt: skip
        heights = []
        for i in range(1000):
            mujoco.mj_step(model, data)
            if i >= 500:
                heights.append(data.qpos[0] + 0.05)
        return -float(np.mean(heights)), float(np.ptp(heights))

    (asked, still), (clamped, _) = deviation("0.001 1", "enable"), deviation("0.004 1", "enable")
    loose, direct = deviation("0.001 1", "disable")[1], deviation("-1e6 -2000", "enable")[1]
    return Finding(
        {"depth_asked_1_ms_um": 1e6 * asked, "depth_asked_4_ms_um": 1e6 * clamped},
        f"A ball at rest, 2 ms: with the flag on it moves by {still:.0e} m, with the flag off by "
        f"{loose:.1g} m, with 1 MN/m and 2 kN s/m asked for directly by {direct:.1g} m.",
        holds=still > 1e-3,
        holds_if=loose > 1e-3 and direct > 1e-3,
        corrected=abs(asked / clamped - 1) < 1e-6,
    )


@claim(
    "contact_seen_is_contact_stopped",
    1,
    "A collision that is detected in time stops the body.",
    verdict=Verdict.FALSE,
    corrected="In an engine with soft contacts a body also passes a wall that it is seen to "
    "touch at "
    "several steps: with MuJoCo's default time constant of 20 ms the way to a stop is about "
    "the speed times that. Once past the middle, it is pushed out on the far side.",
    figures={
        "stops_up_to_m_per_s": (2.963809, 0.02),
        "overlap_certain_up_to_m_per_s": (20, 0.02),
        "steps_in_contact_at_half": (2, 0.02),
    },
)
def _contact_seen_is_contact_stopped() -> Finding:
    import mujoco

    thickness = 0.02  # wall and ball each [m]

    def passes(speed: float) -> tuple[bool, int]:
        model, data = _model(
            '<geom type="box" size=".01 1 1"/><body pos="-.1 0 0">'
            '<joint type="slide" axis="1 0 0"/><geom size=".01" mass="1"/></body>',
            0.002, "Euler", 'gravity="0 0 0"',
        )  # fmt: skip
        data.qvel[0] = speed
        touched = 0
        for _ in range(600):
            mujoco.mj_step(model, data)
            touched += data.ncon > 0
        return bool(data.qpos[0] > 0.1), touched

    low, high = 0.1, 20.0
    while high / low > 1.002:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if passes(middle)[0] else (middle, high)
    geometric = 2 * thickness / 0.002
    through, touched = passes(0.5 * geometric)
    return Finding(
        {"stops_up_to_m_per_s": low, "overlap_certain_up_to_m_per_s": geometric,
         "steps_in_contact_at_half": touched},
        f"2 cm wall and ball, 2 ms: at {0.5 * geometric:g} m/s they touch at {touched} steps "
        "and the "
        "ball goes through.",
        holds=not through,
        corrected=through and touched >= 2 and low < 0.5 * geometric,
    )  # fmt: skip


@claim(
    "mujoco_ccd_is_continuous",
    1,
    "MuJoCo's ccd options switch on continuous collision detection.",
    verdict=Verdict.FALSE,
    corrected="There ccd means convex collision detection: how two convex shapes at one instant "
    "are "
    "compared. A fast thin body passes a thin wall with any setting of it.",
    figures={"settings_tried": (3, 0), "settings_missed": (3, 0)},
)
def _mujoco_ccd_is_continuous() -> Finding:
    import mujoco

    def missed(iterations: int) -> bool:
        model, data = _model(
            '<geom type="box" size=".005 1 1"/><body pos="-.53 0 0">'
            '<joint type="slide" axis="1 0 0"/><geom type="box" size=".005 .1 .1" '
            'mass="1"/></body>',
            0.002, "Euler", f'gravity="0 0 0" ccd_iterations="{iterations}"',
        )  # fmt: skip
        data.qvel[0] = 50.0  # ten centimetres per step, 2 cm of overlap to be seen
        touched = 0
        for _ in range(12):
            mujoco.mj_step(model, data)
            touched += data.ncon
        return touched == 0 and bool(data.qpos[0] > 0.6)

    unseen = sum(missed(n) for n in (10, 35, 200))
    return Finding(
        {"settings_tried": 3, "settings_missed": unseen},
        "A plate at 50 m/s against a 1 cm wall at 2 ms, with 10, 35 and 200 ccd iterations.",
        holds=unseen == 0,
        corrected=unseen == 3,
    )
