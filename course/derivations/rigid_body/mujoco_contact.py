"""Claims on contact in MuJoCo: its order, its stiffness, and what passes a thin wall."""

import numpy as np

from course.derivations import claim
from course.derivations.rigid_body.mujoco import small_model

# A wall of 2 cm and a ball of 2 cm that flies at it: they meet at a distance of 2 cm.
_WALL, _BALL = 0.01, 0.01


def _thrown(speed, phase=0.5, dt=0.002, contact="", flags=""):
    """Return whether the ball passes the wall, its steps in contact and its deepest point [m].

    `phase` is where in a step it reaches the wall.
    """
    import mujoco

    model, data = small_model(
        f'<geom type="box" size="{_WALL} 1 1" {contact}/><body>'
        f'<joint type="slide" axis="1 0 0"/><geom size="{_BALL}" mass="1" {contact}/></body>',
        dt,
        "Euler",
        'gravity="0 0 0"',
        flags,
    )
    # The phase shifts the moment of contact within a step.
    data.qpos[0] = -_WALL - _BALL - speed * dt * (1 + phase)
    data.qvel[0] = speed
    touched, deepest = 0, -np.inf
    for _ in range(round(0.06 / dt)):
        mujoco.mj_step(model, data)
        touched += data.ncon > 0
        deepest = max(deepest, data.qpos[0] + _WALL + _BALL)
    return bool(data.qpos[0] > 0.0), touched, deepest


# A contact that stops within two steps, the fastest that MuJoCo grants.
def _hard(dt):
    return f'solref="{2 * dt} 1" solimp="0.99 0.999 0.001"'


_PHASES = np.linspace(0.01, 0.99, 16)


def _stop_time(time_constant):
    """Return the way to a stop of MuJoCo's default contact over the speed [s].

    Beyond 1 mm it is r'' + d b r' + d k r = 0 with the impedance d = 0.95, b = 2 / (d T) and
    k = 1 / (d T)^2 (MuJoCo documentation, Solver parameters). The deepest point of that oscillator
    is v / w exp(-z acos(z) / sqrt(1 - z^2)), with w^2 = d k and 2 z w = d b.
    """
    omega = np.sqrt(0.95) / (0.95 * time_constant)
    zeta = 1 / (time_constant * omega)
    return np.exp(-zeta * np.arccos(zeta) / np.sqrt(1 - zeta**2)) / omega


@claim(
    "With RK4 MuJoCo's contacts are accurate to fourth order.",
    "The contact force is not smooth where contact begins, so a drop is followed to about first "
    "order in the step ({order:.1f}), as with Euler ({order_euler:.1f}).",
)
def mujoco_rk4_contact_order(result):
    import mujoco

    drops = np.linspace(0.1, 0.3, 30)

    def heights(integrator, steps):
        model, data = small_model(
            '<geom type="plane" size="1 1 1" solref="-5000 -5"/><body pos="0 0 .1">'
            '<joint type="slide" axis="0 0 1"/>'
            '<geom size=".1" mass="1" solref="-5000 -5"/></body>',
            0.4 / steps,
            integrator,
        )
        ends = []
        for drop in drops:
            mujoco.mj_resetData(model, data)
            data.qpos[0] = drop
            mujoco.mj_step(model, data, steps)
            ends.append(data.qpos[0])
        return np.array(ends)

    reference = heights("RK4", 3200)

    def errors(integrator):
        # Mean over 30 heights: a single one may hit a step's end by luck.
        return [np.abs(heights(integrator, n) - reference).mean() for n in (100, 400)]

    (coarse, fine), (slow, fast) = errors("RK4"), errors("Euler")
    order = result.measure("order", np.log2(coarse / fine) / 2, tolerance=0.1)
    euler = result.measure("order_euler", np.log2(slow / fast) / 2, tolerance=0.1)
    result.statement = (
        f"A ball dropped from 30 heights: mean error {coarse:.1e} m at 4 ms, {fine:.1e} m at 1 ms."
    )
    result.statement_holds(order > 3.5)
    result.correction_holds(0.5 < order < 2.0, 0.5 < euler < 2.0)


@claim(
    "Stiff contacts in MuJoCo need a small step.",
    "By default no: MuJoCo keeps the contact's time constant at two steps or more (flag refsafe). "
    "A ball sinks in by {depth_asked_1_ms_um:.1f} um whether half a step or two steps are "
    "requested. There are three exceptions. With the flag off, a time constant below a step "
    "explodes. Stiffness and damping that are given directly, as negative numbers in solref, are "
    "used unchanged. And with a damping ratio of {low_ratio:.1f}, a ball does not come to rest "
    "even with the flag on. Under the discrete integrator one ball is stable in all three "
    "cases, and so is one box with a negative solref. A stack with a negative "
    "solref need not be: a tower of three stiff boxes with hardly a damper, at {tower_ms:.0f} ms, "
    "goes from {start_j:.1f} J up to {most_j:.1f} J. "
    "In the other two cases the same tower gains next to nothing.",
)
def mujoco_contact_stiffness_limit(result):
    import mujoco

    dt = 0.002

    def rest(solref, safe="enable", integrator="Euler"):
        """Return the mean depth [m] and the range of height [m] of a ball at rest.

        Both are taken over the last of two seconds.
        """
        model, data = small_model(
            f'<geom type="plane" size="1 1 1" solref="{solref}"/><body pos="0 0 .15">'
            '<joint type="slide" axis="0 0 1"/>'
            f'<geom size=".1" mass="1" solref="{solref}"/></body>',
            dt,
            integrator,
            "",
            f'refsafe="{safe}"',
        )
        heights = []
        for _ in range(1000):
            mujoco.mj_step(model, data)
            heights.append(data.qpos[0] + 0.05)
        return -np.mean(heights[500:]), np.ptp(heights[500:])

    def direct(time_constant):
        return f"{-1 / time_constant**2} {-2 / time_constant}"

    def needs(solref, safe="enable", integrator="Euler"):
        return rest(solref, safe, integrator)[1] > 1e-3

    requested = result.measure("depth_asked_1_ms_um", 1e6 * rest("0.001 1")[0], tolerance=1e-3)
    clamped = result.measure("depth_asked_4_ms_um", 1e6 * rest("0.004 1")[0], tolerance=1e-3)
    result.statement = (
        f"A ball at rest, 2 ms: with the flag on it moves by {rest('0.001 1')[1]:.0e} m, with the "
        f"flag off by {rest('0.001 1', 'disable')[1]:.1g} m, with 1 MN/m and 2 kN s/m asked for "
        f"directly by {rest('-1e6 -2000')[1]:.1g} m."
    )
    tower_ms = result.input("tower_ms", 20.0)

    def energies(boxes, solref, ms, safe="enable", integrator="discrete"):
        """Return start and largest energy of boxes on each other [J]."""
        bodies = "".join(
            f'<body pos="0 0 {0.1 + 0.2 * i}"><freejoint/><geom type="box" size=".1 .1 .1" '
            f'mass="1" solref="{solref}"/></body>'
            for i in range(boxes)
        )
        model, data = small_model(
            f'<geom type="plane" size="9 9 1" solref="{solref}"/>{bodies}',
            1e-3 * ms,
            integrator,
            "",
            f'refsafe="{safe}"',
        )
        model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
        mujoco.mj_forward(model, data)
        start = highest = float(data.energy.sum())
        for _ in range(round(4000 / ms)):
            mujoco.mj_step(model, data)
            # Energy may only fall under a passive contact; a rise shows the instability.
            highest = max(highest, float(data.energy.sum()))
        return start, highest

    start, highest = energies(3, "-1e6 -2", tower_ms)
    result.measure("start_j", start, tolerance=1e-6)
    result.measure("most_j", highest, tolerance=0.2)

    def jumps(boxes, ms, solref="-1e6 -2", *how):
        """Return whether boxes on each other gain far more energy than m (g h)^2 / 2 each.

        What starts at touch falls freely for one step, so a calm contact bounces by this much; a
        stiff and calm tower of three rises by up to eight times as much.
        """
        before, after = energies(boxes, solref, ms, *how)
        fall = 0.5 * (9.81e-3 * ms) ** 2  # of 1 kg in one step [J]
        return after - before > 10.0 * boxes * fall

    coarse = (15.0, 30.0, 50.0)
    # A tower in the discrete integrator without refsafe, and with it at low damping ratios.
    calm = [
        jumps(3, ms, f"0.001 {ratio}", safe)
        for ms in coarse
        for ratio, safe in ((1.0, "disable"), (0.3, "enable"), (0.01, "enable"))
    ]
    constants = dt * result.rng.uniform(0.3, 0.9, 5)
    low_ratio = result.input("low_ratio", 0.3)
    ratios = result.rng.uniform(0.15, low_ratio, 5)
    result.statement_holds(
        needs("0.001 1"),
        only_if="the integrator is not discrete, and in addition the refsafe flag is off, "
        "stiffness and damping are given directly, or the damping ratio is low (for one ball, "
        "below about a third)",
        inside=[needs(f"{t} 1", "disable") for t in constants]
        + [needs(direct(t)) for t in constants]
        + [needs(f"{t} {ratio}") for t, ratio in zip(constants, ratios, strict=True)]
        # Chosen to break it: bodies on each other.
        + [jumps(2, 2.0, "-1e6 -2000", "enable", "Euler")],
        outside=[needs(f"{t} {ratio}") for t in constants for ratio in (0.4, 1)]
        + [needs(f"{t} {low_ratio}", integrator="discrete") for t in constants]
        + [needs(direct(t), integrator="discrete") for t in constants]
        # One box, which touches at several points, and towers, of which some gain energy.
        + [jumps(boxes, ms) for boxes in (1, 3) for ms in coarse]
        + calm,
    )
    result.correction_holds(
        abs(requested / clamped - 1) < 1e-6,
        all(needs(f"{t} {low_ratio}") for t in constants),
        not any(needs(f"{t} 1", "disable", "discrete") for t in constants),
        not any(needs(direct(t), integrator="discrete") for t in constants),
        highest > 1.1 * start,
        all(jumps(3, ms) for ms in coarse),
        not any(calm),
    )


@claim(
    "A collision that is detected in time stops the body.",
    "In an engine with soft contacts a body also passes a wall that it is seen to touch at several "
    "steps: with MuJoCo's default time constant of {time_constant_ms:.0f} ms the way to a stop is "
    "{stop_over_v_tau:.2f} of speed times time constant, {stop_ms:.1f} ms times the speed. Once "
    "past the middle, it is pushed out on the far side: here above {stops_up_to_m_per_s:.1f} m/s, "
    "where an overlap is certain up to {overlap_certain_up_to_m_per_s:.0f} m/s.",
)
def contact_seen_is_contact_stopped(result):
    constant = result.input("time_constant_ms", 20) / 1000

    def passes(speed):
        """Return whether the ball passes through in some phase, and the fewest steps it touches."""
        through, touched, _ = zip(*(_thrown(speed, phase) for phase in _PHASES), strict=True)
        return any(through), min(touched)

    low, high = 0.5, 10.0
    # Bisection of the speed, over 16 phases each.
    while high / low > 1.01:
        middle = np.sqrt(low * high)
        low, high = (low, middle) if passes(middle)[0] else (middle, high)
    certain, unseen = 10.0, 40.0
    while unseen / certain > 1.001:  # from just before the wall to just behind it
        middle = np.sqrt(certain * unseen)
        certain, unseen = (middle, unseen) if _thrown(middle, 1e-6)[1] else (certain, middle)
    reach = _WALL + _BALL
    stop = result.measure("stop_ms", 1000 * _stop_time(constant)) / 1000
    result.measure("stop_over_v_tau", stop / constant)
    result.measure("stops_up_to_m_per_s", low, tolerance=0.02)
    result.measure("overlap_certain_up_to_m_per_s", certain, tolerance=2e-3)
    through, touched = passes(0.5 * certain)
    result.measure("steps_in_contact_at_half", touched)
    deep = [
        _thrown(0.8 * low, 0.5, 1e-4, f'solref="{tau} 1"')[2] / (0.8 * low * tau)
        for tau in (0.01, constant)
    ]
    result.statement = (
        f"2 cm wall and ball, 2 ms: the deepest point is {deep[1]:.3f} of speed times time "
        f"constant at a fine step; at {0.5 * certain:g} m/s they touch at {touched} steps or more "
        "and the ball goes through."
    )
    result.statement_holds(not through)
    result.correction_holds(
        through and touched >= 2,
        all(abs(x / (stop / constant) - 1) < 0.03 for x in deep),
        abs(low / (reach / stop) - 1) < 0.05,
        abs(certain / (2 * reach / 0.002) - 1) < 2e-3,
    )


@claim(
    "Against tunnelling switch on continuous collision detection, or take a smaller step.",
    "Both find the overlap; neither makes the contact stop the body. In MuJoCo's default contact "
    "every ball above {limit_m_per_s:.1f} m/s passes this wall at a tenth of the step too, and "
    "{soft_share:.2f} of those above {fast_m_per_s:.0f} m/s with speculative contacts on. With a "
    "contact that stops within two steps, both work: without them {hard_missed_share:.2f} of the "
    "same balls pass.",
    source="MuJoCo 4.0 documentation (2026), Computation, Speculative contacts",
)
def continuous_detection_or_smaller_step(result):
    speculative = 'speculative="enable"'
    limit = result.measure("limit_m_per_s", (_WALL + _BALL) / _stop_time(0.02))

    def stopped(speed, dt=0.002, contact="", flags=""):
        return not _thrown(speed, result.rng.random(), dt, contact, flags)[0]

    fast = result.rng.uniform(result.input("fast_m_per_s", 4), 50.0, 24)
    soft = [stopped(v, flags=speculative) for v in fast]
    result.measure("soft_share", 1 - np.mean(soft), tolerance=0.3)
    hard = [stopped(v, contact=_hard(0.002)) for v in fast]
    result.measure("hard_missed_share", 1 - np.mean(hard), tolerance=0.2)
    wild = result.rng.uniform(200.0, 1000.0, 12)
    result.statement = "A ball at random speeds and phases against a wall, 2 cm each, in MuJoCo."
    result.statement_holds(
        all(soft),
        only_if="the contact's time constant is two steps, the shortest that MuJoCo grants, and, "
        "without speculative contacts, a step moves the ball by less than half of wall and ball",
        inside=[stopped(v, contact=_hard(0.002), flags=speculative) for v in (*fast, *wild)]
        + [stopped(v, 2e-4, _hard(2e-4)) for v in (*fast, *(0.09 * wild))],
        # Chosen to break it: balls that the smaller step does not see in the wall.
        outside=soft
        + [stopped(v, 2e-4) for v in fast]
        + [stopped(v, 2e-4, _hard(2e-4)) for v in wild],
    )
    result.correction_holds(
        not any(stopped(v, 2e-4) for v in (*fast, *result.rng.uniform(1.03 * limit, 4.0, 8))),
        all(stopped(v, 2e-4) for v in result.rng.uniform(0.5, 0.9 * limit, 8)),
        not all(hard),
    )


@claim(
    "Most engines offer a maximum penetration that catches tunnelling.",
    "What engines offer by such a name is another thing: how fast an overlap is pushed out, how "
    "much of it is let be, or how stiff a contact is. Each acts on an overlap that was found. A "
    "plate that flies through a wall between two steps has none: in MuJoCo it passed unseen under "
    "{contacts_missed:.0f} of {contacts_tried:.0f} settings of the contact, and was stopped by "
    "speculative contacts and by a step of at most the two thicknesses over the speed.",
    source="By documentation: PhysX 5 PxRigidBody::setMaxDepenetrationVelocity (also Unity 6 and "
    "Unreal 5) and ODE 0.16 dWorldSetContactMaxCorrectingVel limit the velocity that corrects; "
    "ODE dWorldSetContactSurfaceLayer and Box2D linearSlop are a depth that is let be; Drake 1.x "
    "penetration_allowance sets a stiffness; Bullet's allowedCcdPenetration belongs to its swept "
    "test; MuJoCo 4.0 (2026) has none",
)
def penetration_limit_catches(result):
    import mujoco

    def observed(speed, contact="", flags="", dt=0.002, phase=0.5):
        """Return whether a plate of 1 cm touches a wall of 1 cm at any step and stays before it."""
        model, data = small_model(
            f'<geom type="box" size=".005 1 1" {contact}/><body>'
            '<joint type="slide" axis="1 0 0"/>'
            f'<geom type="box" size=".005 .1 .1" mass="1" {contact}/></body>',
            dt,
            "Euler",
            'gravity="0 0 0"',
            flags,
        )
        data.qpos[0], data.qvel[0] = -0.01 - speed * dt * (1 + phase), speed
        touched = 0
        for _ in range(round(0.05 / dt)):
            mujoco.mj_step(model, data)
            touched += data.ncon
        return touched > 0, data.qpos[0] < 0

    settings = [
        f'solref="{tau} 1" solimp="{d} 0.999 {width}"'
        for tau in (0.004, 0.02, 0.1)
        for d in (0.5, 0.99)
        for width in (1e-4, 1e-2)
    ]
    speed = 50.0  # ten centimetres a step, of which two overlap
    missed = [not observed(speed, contact)[0] for contact in settings]
    result.measure("contacts_tried", len(list(map(observed, [speed] * len(settings), settings))))
    result.measure("contacts_missed", np.sum(missed))
    names = [name for name in dir(mujoco.MjOption) if "penetr" in name.lower()]
    result.statement = "A plate at 50 m/s against a wall, 1 cm each, 2 ms, and 0.3 ms."
    result.statement_holds(len(names) > 0 or not all(missed))
    result.correction_holds(
        all(missed),
        all(
            all(observed(v, _hard(0.002), 'speculative="enable"', phase=p))
            for v, p in zip(result.rng.uniform(20, 100, 8), result.rng.random(8), strict=True)
        ),
        all(observed(speed, dt=0.99 * 0.02 / speed, phase=p)[0] for p in result.rng.random(8)),
        not all(observed(speed, dt=1.5 * 0.02 / speed, phase=p)[0] for p in result.rng.random(8)),
    )


@claim(
    "MuJoCo's ccd options switch on continuous collision detection.",
    "There ccd means convex collision detection: how two convex shapes at one instant are "
    "compared. A fast thin body passes a thin wall with any setting of it. What sweeps the motion "
    "is the speculative flag of version 4, off by default.",
)
def mujoco_ccd_is_continuous(result):
    import mujoco

    def missed(iterations, speed=50.0, flags=""):
        """Return whether a plate passes a wall of 1 cm unseen."""
        model, data = small_model(
            '<geom type="box" size=".005 1 1"/><body pos="-.53 0 0">'
            '<joint type="slide" axis="1 0 0"/><geom type="box" size=".005 .1 .1" '
            'mass="1"/></body>',
            0.002,
            "Euler",
            f'gravity="0 0 0" ccd_iterations="{iterations}"',
            flags,
        )
        data.qvel[0] = speed  # ten centimetres per step, 2 cm of overlap to be seen
        touched = 0
        for _ in range(12):
            mujoco.mj_step(model, data)
            touched += data.ncon
        return touched == 0 and bool(data.qpos[0] > 0.6)

    settings = [missed(n) for n in (10, 35, 200)]
    result.measure("settings_tried", len(list(map(missed, (10, 35, 200)))))
    result.measure("settings_missed", np.sum(settings))
    result.statement = (
        "A plate at 50 m/s against a 1 cm wall at 2 ms, with 10, 35 and 200 ccd iterations; then "
        "with the speculative flag."
    )
    result.statement_holds(not any(settings))
    result.correction_holds(all(settings), not missed(35, flags='speculative="enable"'))
