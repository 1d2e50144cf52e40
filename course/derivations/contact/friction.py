"""Claims on friction, grasps and dampers: cone and pyramid, what holds, creeps, sticks."""

from dataclasses import replace

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "m": Symbol("mass [kg]"),
    "g": Symbol("gravity [m/s^2]"),
    "F": Symbol("force of each finger [N]"),
    "mu": Symbol("coefficient of friction"),
    "R": Symbol("compliance of a friction row [1/kg]"),
    "f": Symbol("friction force [N]"),
    "b": Symbol("damping of the reference acceleration [1/s]"),
}
RIGID = ("lcp", "pgs", "coulomb", "convex")


def _creep(dt=0.002, mu=0.5, cone="elliptic", angle=0.2, **options):
    """Return speed at which MuJoCo's block creeps down a slope that it should stick to [m/s]."""
    from course.oracles.mujoco import contact

    friction = (mu, 0.005, 0.0001)
    made = contact.Options(dt, cone=cone, friction=friction, **options)
    return float(contact.block(made, angle).run(round(1.0 / dt))[1][0])


@claim(
    "Below the limit of friction a contact sticks; at the limit it slides.",
    "Exactly at the limit it still sticks; only more than that makes it slide. Regularised "
    "friction and MuJoCo's soft contact hold a load only while they creep: at {creep_mm_s:.2f} "
    "mm/s here, on a slope of {slope_rad:.3f} rad, {slope:.0%} of the limiting one.",
)
def below_the_limit_sticks(result):
    from course.contact import scenes

    share = result.input("slope", 0.4)

    def sticks(model, mu, part, **options):
        # The limiting slope is arctan(mu); part scales its tangent.
        scene = scenes.block(np.arctan(mu * part), mu)
        moved = scenes.run(scene, model, 0.002, 100, **options)
        return bool(np.abs(moved.v[0, -1]) < 1e-9)

    def holds_aside(model, mu, part, turn):
        """Return whether a block sticks that is pushed at an angle to the axes of friction."""
        base = scenes.block(0.0, mu)
        push = part * mu * scenes.GRAVITY * np.array([np.cos(turn), np.sin(turn), 0.0])
        moved = scenes.run(replace(base, force=base.force + push), model, 0.002, 50)
        return bool(np.abs(moved.v[:2, -1]).max() < 1e-9)

    mus, parts = result.rng.uniform(0.2, 1.2, 8), result.rng.uniform(0.1, 0.95, 8)
    # From 90 % of the limit and at 20 to 69 degrees to an edge, where the pyramid is weaker.
    aside = result.rng.uniform((0.2, 0.9, 0.35), (1.2, 0.99, 1.2), (8, 3))
    creep = scenes.run(
        scenes.block(np.arctan(0.5) * share, 0.5), "soft", 0.002, 500, cone="elliptic"
    ).v[0, -1]
    result.measure("creep_mm_s", 1e3 * creep, tolerance=1e-4)
    result.measure("slope_rad", np.arctan(0.5) * share, tolerance=1e-9)
    above = [sticks(model, 0.5, 1.05) for model in RIGID]
    result.statement = f"MuJoCo's model creeps at {1e3 * creep:.3f} mm/s."
    result.statement_holds(
        abs(creep) < 1e-9,
        only_if="friction is Coulomb's, with a round cone or along an edge of the pyramid, neither "
        "regularised nor soft",
        inside=[sticks(m, *draw) for m in RIGID for draw in zip(mus, parts, strict=True)]
        + [holds_aside(m, *draw) for m in RIGID if m != "lcp" for draw in aside],
        # Chosen to break it: a load between two edges of the pyramid.
        outside=[
            sticks(m, *draw) for m in ("soft", "penalty") for draw in zip(mus, parts, strict=True)
        ]
        + [holds_aside("lcp", *draw) for draw in aside],
    )
    result.correction_holds(
        creep > 1e-4,
        not any(above),
        # Exactly at the limit, the case that "below" and "at" disagree about.
        all(sticks(m, a, 1.0) for m in RIGID for a in mus[:4]),
    )


@claim(
    "In MuJoCo, more friction than needed keeps a body where it is.",
    "With elliptic cones the body creeps at {formula}, whatever the friction coefficient: at "
    "{creep_mm_s:.4f} mm/s on a slope of {angle_rad:.1f} rad, and just as fast with twice the "
    "friction. The pyramid, which is the default, multiplies that by {pyramid:.2f} at a "
    "coefficient of {mu:.1f} and by {pyramid_twice:.2f} at twice that. So more friction is no "
    "remedy. A larger impratio is, because it divides the creep speed, and so is a shorter time "
    "constant.",
    ask=(
        "In a sticking contact, a friction row of MuJoCo has the force f = (a_ref - a) / R with "
        "a_ref = -b v. In steady creep a = 0. What is the size of the creep speed v under the "
        "friction force f? (The list may name a symbol that you do not need.)",
        "v = R*f/b",
        {
            "f/b": "The compliance R is missing: f is a force, b v is an acceleration.",
            "R*f": "That is the reference acceleration. Divide by b.",
            "b*f/R": "That is upside down: more damping makes the creep slower, more compliance "
            "faster.",
            "mu*R*f/b": "While the contact sticks, the friction coefficient does not appear.",
        },
    ),
    source="MuJoCo 4.0 documentation, Modeling, Preventing slip",
)
def mujoco_creeps(result):
    import sympy

    from course.contact import scenes
    from course.contact.soft import Softness, rows_of
    from course.oracles.mujoco import contact

    R, f, b, v = sympy.symbols("R f b v", positive=True)
    result.formula = sympy.solve(R * f - b * v, v)[0]
    angle = result.input("angle_rad", 0.2)
    creep = result.measure("creep_mm_s", 1e3 * _creep(angle=angle), tolerance=1e-6)
    runner = contact.block(contact.Options(), angle)
    runner.run(500)
    state = contact.contact_state(runner)
    assert state is not None
    softness = Softness(cone="elliptic")
    # R and b from the course's own model of MuJoCo's rows; the creep speed is measured in MuJoCo.
    compliance = rows_of(state.problem, contact.Options().softness(state.weight)).compliance[1]
    damping = softness.stiffness(softness.solref, 0.002)[1]
    theory = float(
        result.formula.subs({R: compliance, f: scenes.GRAVITY * np.sin(angle), b: damping})
    )
    mu = result.input("mu", 0.5)
    slippery = 1e3 * _creep(mu=2 * mu, angle=angle)
    # impratio divides the compliance of the friction rows, so ten times it is a tenth of the creep.
    tenth = creep / (1e3 * _creep(impratio=10.0, angle=angle))
    shorter = 1e3 * _creep(solref=(0.01, 1.0), angle=angle)

    def pyramids(mu):
        return 1e3 * _creep(mu=mu, cone="pyramidal", angle=angle) / creep

    pyramid = result.measure("pyramid", pyramids(mu), tolerance=1e-2)
    twice = result.measure("pyramid_twice", pyramids(2 * mu), tolerance=1e-2)
    result.statement = f"Measured {creep:.4f} mm/s, R f / b is {1e3 * theory:.4f} mm/s."
    result.statement_holds(creep < 1e-6)
    result.correction_holds(
        abs(creep / (1e3 * theory) - 1) < 1e-3,
        abs(slippery / creep - 1) < 1e-6,
        abs(tenth - 10) < 0.05,
        pyramid > 1.1,
        twice > 1.1 * pyramid,
        shorter < 0.7 * creep,
    )


@claim(
    "A glass slips out of two fingers only because friction is too low; more always stops that.",
    "Below mu = {formula} the glass falls. Above it, rigid models hold the glass, and soft ones "
    "let it creep: at {creep_mm_s:.2f} mm/s in MuJoCo with elliptic cones, whatever the friction. "
    "With pyramids, much more friction even makes it worse: the glass creeps at "
    "{pyramid_2:.0f}, {pyramid_4:.0f} and {pyramid_8:.0f} mm/s with two, four and eight times the "
    "friction that is needed.",
    ask=(
        "Two fingers press a glass of mass m from both sides, each with the force F. Above which "
        "friction coefficient mu do they hold it?",
        "mu > m*g/(2*F)",
        {
            "m*g/F": "Both contacts carry the weight: the limit of friction is 2 mu F.",
            "2*m*g/F": "With two contacts, each carries half of the weight, not twice.",
            "F/(m*g)": "That is upside down: more weight needs more friction.",
            "2*F/(m*g)": "That is upside down, though with both contacts.",
        },
    ),
)
def more_friction_holds_the_glass(result):
    import sympy

    from course.contact import scenes
    from course.oracles.mujoco import contact

    m, g, F, mu = sympy.symbols("m g F mu", positive=True)
    result.formula = sympy.solve(2 * mu * F - m * g, mu)[0]
    needed = float(result.formula.subs({m: 0.2, g: scenes.GRAVITY, F: 5}))

    def falls(model, share):
        # 1 mm/s within 0.2 s tells a fall from numerical creep even at 0.1 % below the limit.
        return scenes.run(scenes.pinch(5.0, share * needed), model, 0.01, 20).v[3, -1] < -1e-3

    def creep(times, cone="elliptic"):
        options = contact.Options(cone=cone, friction=(times * needed, 0.005, 0.0001))
        return 1e3 * -contact.pinch(options).run(500)[1][3]

    slow = result.measure("creep_mm_s", creep(2.0), tolerance=1e-3)
    result.measure("needed", needed, tolerance=1e-9)
    two, four, eight = [
        result.measure(f"pyramid_{n}", creep(n, "pyramidal"), tolerance=1e-2) for n in (2, 4, 8)
    ]
    result.statement = f"mu of {needed:.4f} is needed; with twice it creeps at {slow:.3f} mm/s."
    result.statement_holds(slow < 1e-3)
    result.correction_holds(
        all(falls(model, 0.999) for model in RIGID),
        not any(falls(model, 1.001) for model in RIGID),
        # From just above the friction needed to eight times it: the creep of the elliptic cone is
        # unchanged.
        *[abs(creep(x) / slow - 1) < 1e-2 for x in (1.02, 4.0, 8.0)],
        slow < four < two < eight,
    )


@claim(
    "A coarse friction pyramid makes grasped objects slip.",
    "A pyramid with four edges on the cone is weaker than the cone between its edges. At the "
    "angle t to an edge it holds the cone's load divided by cos(t) + sin(t), so at worst 1/sqrt(2) "
    "of it. Along an edge it is as strong as the cone. While an object slides, the pyramid also "
    "steers it: pushed off at {degrees:.1f} degrees to an edge, a block travels {stretched:.3f} "
    "times as far and stops in the direction {turned:.1f} degrees.",
)
def pyramid_slips(result):
    from course.charts.contact.models import stopped
    from course.contact import scenes, solve

    degrees = result.input("degrees", 22.5)

    def slips(angle, load=0.97, model="lcp", mu=0.5, mass=1.0, **options):
        """Return whether a block slips under a load of this share of mu f_n, in this direction."""
        t = np.radians(angle)
        base = scenes.block(0.0, mu, mass=mass)
        push = load * mu * mass * scenes.GRAVITY * np.array([np.cos(t), np.sin(t), 0.0])
        v = solve(model, replace(base, force=base.force + push).problem(0.01), **options)
        return bool(np.abs(v.velocity[:2]).max() > 1e-9)

    def on_two_feet(angle, load, turned, model="lcp"):
        """Return whether a body on two feet slips, their pyramids turned by these angles [deg].

        Each foot is pressed down by a weight of its own; the load is a share of what both cones
        hold, mu times the sum of the two weights.
        """
        t, weight = np.radians(angle), scenes.GRAVITY
        rows = np.zeros((2, 3, 4))
        for i, turn in enumerate(np.radians(turned)):
            rows[i, 0, 2 + i] = 1.0
            rows[i, 1:, :2] = (np.cos(turn), np.sin(turn)), (-np.sin(turn), np.cos(turn))
        push = load * weight * np.array([np.cos(t), np.sin(t)])  # mu is 0.5, twice
        feet = scenes.Scene(
            np.eye(4),
            rows,
            np.zeros(2),
            np.array([*push, -weight, -weight]),
            np.full((2, 2), 0.5),
            np.zeros(4),
            np.zeros(4),
        )
        return bool(np.abs(solve(model, feet.problem(0.01)).velocity[:2]).max() > 1e-9)

    distance, direction = stopped("lcp", degrees, 2e-4, 1.0)
    result.measure("stretched", distance, tolerance=1e-3)
    result.measure("turned", direction, tolerance=1e-3)
    between = result.rng.uniform(5.0, 85.0, 10)

    def share(angle):
        return 1.0 / (abs(np.cos(np.radians(angle))) + abs(np.sin(np.radians(angle))))

    strange = [
        (angle + 90.0 * quarter, 10.0**mu, 10.0**mass)
        for angle, quarter, mu, mass in zip(
            result.rng.uniform(5.0, 85.0, 6),
            result.rng.integers(0, 4, 6),
            result.rng.uniform(-2.0, 1.0, 6),
            result.rng.uniform(-3.0, 3.0, 6),
            strict=True,
        )
    ]
    result.statement = (
        f"Way {distance:.4f}, sqrt(1 + sin^2 2t) = {np.hypot(1, np.sin(np.pi / 4)):.4f}."
    )
    result.statement_holds(
        slips(0.0),
        only_if="all contacts have the same pyramid with four edges on the cone, the object does "
        "not turn, and the load is between the pyramid's limit and the cone's",
        # Above the cone's own load the object slips with any friction law: not the pyramid's doing.
        inside=[
            slips(angle, load) and not slips(angle, load, "coulomb")
            for angle in between
            for load in (1.001 * share(angle), 0.999)
        ]
        # Chosen to break it: loads in all quadrants, other masses and friction, and two contacts.
        + [
            slips(angle, load, mu=mu, mass=mass) and not slips(angle, load, "coulomb", mu, mass)
            for angle, mu, mass in strange
            for load in (1.001 * share(angle), 0.999)
        ]
        + [
            on_two_feet(angle, 1.001 * share(angle), (0.0, 90.0))
            and not on_two_feet(angle, 0.999, (0.0, 90.0), "coulomb")
            for angle in between[:4]
        ],
        outside=[
            slips(angle, load) and not slips(angle, load, "coulomb")
            for angle in between
            for load in (0.999 * share(angle), 1.001)
        ]
        # Pyramids with more edges, or around the cone, and two that are turned against each other:
        # each foot then pulls along its nearest edge.
        + [slips(22.5, 1.02 * share(22.5), edges=8)]
        + [slips(angle, 0.999, around=True) for angle in between[:4]]
        + [on_two_feet(0.0, 0.93, (-20.0, 20.0))],
    )
    t = np.radians(degrees)
    result.correction_holds(
        not any(slips(angle, model="coulomb") for angle in between),
        slips(45.0, 0.71) and not slips(45.0, 0.70),
        abs(distance - np.sqrt(1 + np.sin(2 * t) ** 2)) < 2e-3,
        abs(direction - np.degrees(np.arctan(np.sin(2 * t)))) < 0.1,
        not slips(45.0, 0.9, edges=16),
    )


@claim(
    "Limiting friction on each axis separately gives nearly Coulomb's friction.",
    "It gives a box around the cone, which is up to sqrt(2) times too strong between the axes. "
    "Each axis brakes on its own. Pushed off at the angle t to an axis, a block travels "
    "sqrt(cos(t)^4 + sin(t)^4) times as far, in the direction atan(tan(t)^2). At {degrees:.1f} "
    "degrees that is {short:.4f} times as far, in the direction {turned:.2f} degrees. At {half:.0f}"
    " degrees it is {diagonal:.4f} times as far.",
)
def box_of_limits(result):
    from course.charts.contact.models import stopped
    from course.contact.scenes import GRAVITY

    degrees, half, dt = result.input("degrees", 22.5), result.input("half", 45.0), 2e-3
    angles = np.array([degrees, half, *result.rng.uniform(0.0, 90.0, 6)])
    distances, turned = np.array([stopped("lcp", a, dt, around=True) for a in angles]).T
    # The new velocity moves the block: half a step of the first one is lost on the way.
    end = distances * np.exp(1j * np.radians(turned)) + 0.5 * dt * GRAVITY * np.exp(
        1j * np.radians(angles)
    )
    distances, turned = np.abs(end), np.degrees(np.angle(end))
    result.measure("short", distances[0], tolerance=1e-3)
    result.measure("turned", turned[0], tolerance=1e-3)
    diagonal = result.measure("diagonal", distances[1], tolerance=1e-3)
    t = np.radians(angles)
    path = np.abs(distances - np.sqrt(1 - np.sin(2 * t) ** 2 / 2)).max()
    turn = np.abs(turned - np.degrees(np.arctan(np.tan(t) ** 2))).max()
    result.statement = f"They miss theory by {path:.1e} of the way and {turn:.2f} degrees at most."
    result.statement_holds(abs(diagonal - 1) < 0.05)
    result.correction_holds(path < 2e-3, turn < 0.1, abs(diagonal - np.sqrt(0.5)) < 1e-3)


@claim(
    "Regularised friction is stable at any step that the contact's spring allows.",
    "Below the slip speed v_s, regularised friction is a damper of mu f_n/v_s that acts on the old "
    "velocity. In both Euler schemes a step multiplies the speed by 1 - h mu f_n/(m v_s), so the "
    "step must be below 2 m v_s/(mu f_n). Here m is the mass felt at the contact point: the whole "
    "mass of a block that cannot turn, but only {felt:.3f} of a solid ball, which the same force "
    "also spins. If a body has several contacts, f_n is the sum of their forces, and the motion in "
    "which they feel the least mass decides: a square plate on its {corners:.0f} corners that may "
    "turn about the vertical trembles above {turning:.2f} of the limit for sliding. At "
    "{step_ms:.2f} ms, twice the limit, a block that should rest trembles for ever at "
    "{trembles:.1f} times the slip speed, although its spring would allow {spring_ms:.1f} ms.",
)
def friction_has_a_step_limit(result):
    from course.charts.contact.limits import step_limit
    from course.contact import scenes

    def rolling(mu, slip, share, moment):
        """Return the contact point's speed over slip speed for a ball of 1 kg that can turn.

        The share is of 2 v_s / (mu g), as if it could not; the moment of inertia is over m r^2.
        """
        radius, dt = 0.1, share * 2 * slip / (mu * scenes.GRAVITY)
        # omega dt is 0.14, far below 2, so that the spring cannot cause the instability.
        stiffness = 0.02 / dt**2
        ball = scenes.Scene(
            np.diag([1.0, 1.0, moment * radius**2]),
            # One contact; its tangential velocity is v_x + r omega.
            np.array([[[0.0, 1.0, 0.0], [1.0, 0.0, radius]]]),
            np.zeros(1),
            np.array([0.0, -scenes.GRAVITY, 0.0]),
            np.full((1, 1), mu),
            np.array([0.0, -scenes.GRAVITY / stiffness, 0.0]),
            np.array([0.3 * slip, 0.0, 0.0]),
        )
        options = {"stiffness": stiffness, "damping": 0.0, "slip": slip}
        # The last 50 of 400 steps: what decays has decayed, what trembles is on its limit cycle.
        v = scenes.run(ball, "penalty", dt, 400, **options).v[:, -50:]
        return np.abs(v[0] + radius * v[2]).max() / slip

    def remaining(mu, slip, share):
        """Return the speed over slip speed after 400 steps, friction being this share of its limit.

        The step and the spring's period are in s.
        """
        dt = share * 2 * slip / (mu * scenes.GRAVITY)
        stiffness = 0.02 / dt**2  # its own limit is 14 of these steps
        rest = np.array([0.0, 0.0, -scenes.GRAVITY / stiffness])
        scene = replace(scenes.block(0.0, mu, (0.3 * slip, 0.2 * slip)), q=rest)
        options = {"stiffness": stiffness, "damping": 0.0, "slip": slip}
        v = scenes.run(scene, "penalty", dt, 400, **options).v[:2, -50:]
        bears = step_limit(0.0, "semi-implicit") / np.sqrt(stiffness)
        return np.abs(v).max() / slip, dt, bears

    def standing(mu, slip, share, count, moment):
        """Return the speed over slip speed of a body of 1 kg that stands on several contacts.

        They are on a circle of radius R. The body may slide and turn about the vertical, with a
        moment of inertia over m R^2. The share is of 2 v_s / (mu g), the limit for sliding.
        """
        radius, dt = 0.1, share * 2 * slip / (mu * scenes.GRAVITY)
        stiffness = 0.02 / dt**2 / count
        angles = 2 * np.pi * np.arange(count) / count
        rows = np.zeros((count, 3, 4))
        rows[:, 0, 2] = rows[:, 1, 0] = rows[:, 2, 1] = 1.0
        rows[:, 1, 3], rows[:, 2, 3] = -radius * np.sin(angles), radius * np.cos(angles)
        body = scenes.Scene(
            np.diag([1.0, 1.0, 1.0, moment * radius**2]),
            rows,
            np.zeros(count),
            np.array([0.0, 0.0, -scenes.GRAVITY, 0.0]),
            np.full((count, 2), mu),
            np.array([0.0, 0.0, -scenes.GRAVITY / (count * stiffness), 0.0]),
            slip * np.array([0.3, 0.2, 0.0, 0.3 / radius]),
        )
        options = {"stiffness": stiffness, "damping": 0.0, "slip": slip}
        v = scenes.run(body, "penalty", dt, 400, **options).v[:, -50:]
        return max(np.abs(v[:2]).max(), radius * np.abs(v[3]).max()) / slip

    corners = int(result.input("corners", 4))
    # A square plate of side L has the moment m L^2 / 6, and its corners are at R = L / sqrt(2).
    plate, low, high = 1 / 3, 0.1, 0.9
    while high - low > 1e-3:
        middle = (low + high) / 2
        low, high = (
            (middle, high) if standing(0.5, 1e-3, middle, corners, plate) < 1e-3 else (low, middle)
        )
    turning = result.measure("turning", low, tolerance=1e-2)
    trembles, step, bears = remaining(0.5, 1e-3, 2.0)
    result.measure("trembles", trembles, tolerance=1e-3)
    result.measure("step_ms", 1e3 * step, tolerance=1e-9)
    result.measure("spring_ms", 1e3 * bears, tolerance=1e-9)
    draws = result.rng.uniform((0.1, 1e-4, 0.05), (1.2, 1e-2, 0.95), (8, 3))
    # Of a body with the moment i m r^2 the contact feels m i / (1 + i).
    moments = result.rng.uniform(0.2, 1.0, 8)
    masses = moments / (1 + moments)
    counts, turns = result.rng.integers(2, 7, 8), result.rng.uniform(0.1, 3.0, 8)
    moment = result.input("moment", 0.4)
    ball = result.measure("felt", moment / (1 + moment), tolerance=1e-9)
    result.statement = f"At {1e3 * step:.3f} ms it trembles at {trembles:.3f} times the slip speed."
    result.statement_holds(
        trembles < 1e-3,
        only_if="the step is also below 2 m v_s/(mu f_n), with f_n summed over the body's "
        "contacts, and m the mass that they feel in the motion, sliding or turning, that is "
        "easiest to start",
        inside=[remaining(*draw)[0] < 1e-3 for draw in draws]
        + [
            rolling(mu, slip, share * mass, i) < 1e-3
            for (mu, slip, share), mass, i in zip(draws, masses, moments, strict=True)
        ]
        # Chosen to break it: several contacts, whose body may turn about the vertical.
        + [
            standing(mu, slip, share * min(1.0, i), count, i) < 1e-3
            for (mu, slip, share), count, i in zip(draws, counts, turns, strict=True)
        ],
        # From 2 % above the limit, with the same friction and slip speeds as inside.
        outside=[remaining(mu, slip, 1.02 + share)[0] < 1e-3 for mu, slip, share in draws]
        + [
            rolling(mu, slip, 1.05 * mass, i) < 1e-3
            for (mu, slip, _), mass, i in zip(draws, masses, moments, strict=True)
        ]
        + [
            standing(mu, slip, 1.05 * min(1.0, i), count, i) < 1e-3
            for (mu, slip, _), count, i in zip(draws, counts, turns, strict=True)
        ],
    )
    result.correction_holds(
        remaining(0.5, 1e-3, 0.98)[0] < 1e-3,
        remaining(0.5, 1e-3, 1.02)[0] > 0.1,
        trembles > 1,
        rolling(0.5, 1e-3, 0.97 * ball, moment) < 1e-3,
        rolling(0.5, 1e-3, 1.03 * ball, moment) > 0.1,
        # By the force of one of the four contacts the limit would be four times as large.
        standing(0.5, 1e-3, 0.98, corners, 10.0) < 1e-3,
        standing(0.5, 1e-3, 1.03, corners, 10.0) > 0.1,
        abs(turning - plate) < 0.01,
    )


@claim(
    "In MuJoCo, condim 4 gives the full friction cone.",
    "condim is the number of forces and torques of a contact. 3 has the normal force and two "
    "forces of sliding friction; 4 adds a torque against spinning. That stops what spins on one "
    "point. For what stands on several, such as a cylinder, 3 is enough. The shape of the "
    "cone is a separate option, and its default is the pyramid: pushed off halfway between two "
    "edges, a block with condim 4 ends {stretched:.2f} times as far from its start as with the "
    "elliptic cone.",
)
def condim_4_is_the_full_cone(result):
    import mujoco

    from course.oracles.mujoco import contact

    def path(cone, condim):
        # Halfway between two edges, where pyramid and cone differ most.
        velocity = (np.sqrt(0.5), np.sqrt(0.5))
        options = contact.Options(cone=cone, condim=condim)
        return np.linalg.norm(contact.block(options, 0.0, velocity, -1e-4).run(200)[0][:2])

    def spin(condim):
        options = contact.Options(condim=condim, friction=(0.5, 0.05, 0.0001))
        return contact.spinning_disc(options, 10.0).run(200)[1][3]

    stretched = result.measure(
        "stretched", path("pyramidal", 4) / path("elliptic", 4), tolerance=1e-3
    )
    same = path("elliptic", 4) / path("elliptic", 3)
    retained, lost = spin(3), spin(4)
    result.measure("spin_left_rad_s", retained, tolerance=1e-9)
    result.statement = f"10 rad/s after 0.4 s: condim 3 {retained:.3f}, condim 4 {lost:.1e} rad/s."
    # The counterexample: a cylinder on several contacts of condim 3 stops spinning.
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="plane" size="9 9 1"/><body pos="0 0 .02"><freejoint/>'
        '<geom type="cylinder" size=".1 .02" condim="3"/></body></worldbody></mujoco>'
    )
    standing = mujoco.MjData(model)
    standing.qvel[5] = 10.0
    mujoco.mj_step(model, standing, 300)
    result.statement_holds(abs(stretched - 1) < 0.01)
    result.correction_holds(
        stretched > 1.3,
        abs(same - 1) < 1e-6,
        abs(retained - 10) < 1e-9,
        abs(lost) < 0.01,
        standing.ncon > 1,
        abs(standing.qvel[5]) < 0.01,
    )


@claim(
    "In MuJoCo, condim 1 is frictionless.",
    "It is, whatever friction coefficient the shape has: a block that is pushed off keeps its "
    "speed to the last digit.",
)
def condim_1_is_frictionless(result):
    from course.oracles.mujoco import contact

    def retained(mu, speed):
        options = contact.Options(condim=1, friction=(mu, 0.005, 0.0001))
        return contact.block(options, 0.0, (speed, 0.0)).run(200)[1][0] == speed

    # Exact equality: a frictionless contact adds nothing to the tangential velocity.
    draws = [retained(*row) for row in result.rng.uniform((0.0, 0.1), (2.0, 3.0), (8, 2))]
    braked = contact.block(contact.Options(), 0.0, (1.0, 0.0)).run(200)[1][0]
    result.measure("with_condim_3_m_s", braked, tolerance=1e-6)
    result.statement = f"{sum(draws)} of {len(draws)} blocks keep 200 steps' speed exactly."
    result.statement_holds(all(draws))
    result.correction_holds(abs(braked) < 0.01)


@claim(
    "A simulator's friction coefficient is 0.5 unless you set it.",
    "That depends on the simulator. MuJoCo's default is {default:.1f}. If two of its shapes touch, "
    "the larger coefficient counts, unless one shape has a higher priority: then its coefficient "
    "counts.",
)
def default_friction(result):
    import mujoco

    def friction(*words):
        geoms = "".join(f'<body><freejoint/><geom size=".1" {w}/></body>' for w in words)
        model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geoms}</worldbody></mujoco>")
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        # Read from the contact that MuJoCo made, not from the model's geoms.
        return float(data.contact[0].friction[0])

    default = result.measure("default", friction("", ""))
    larger = friction('friction="0.3"', 'friction="0.7"')
    ranked = friction('friction="0.3" priority="1"', 'friction="0.7"')
    result.statement = f"Two spheres without a word: {default}; 0.3 against 0.7: {larger}."
    result.statement_holds(abs(default - 0.5) < 1e-9)
    result.correction_holds(
        abs(default - 1.0) < 1e-9, abs(larger - 0.7) < 1e-9, abs(ranked - 0.3) < 1e-9
    )


def _hit(zeta, pull, sign=-1.0, stiffness=1e4, dt=1e-5, start=(-1e-12, -1.0)):
    """Return the speed of a ball of 1 kg after it hits a spring-damper at 1 m/s [m/s].

    Or starts otherwise, at a height [m] and a speed [m/s]. Gravity is neglected. The result is NaN
    if the ball has not left after 60 / omega.
    """
    from course.contact.models import penalty_force

    # The step 1e-5 s is a thousandth of 1 / omega, so the integration error stays below the
    # tolerances.
    omega = np.sqrt(stiffness)
    damping = 2.0 * zeta * omega
    (x, v), force = start, np.zeros(1)
    for _ in range(round(60.0 / omega / dt)):
        penalty_force(-x, np.array([v]), stiffness, -sign * damping, np.zeros(0), 1.0, pull, force)
        v += dt * force[0]
        x += dt * v
        # Height above zero means that the ball has left; without gravity it won't return.
        if x > 0.0:
            return v
    return np.nan


@claim(
    "Too much damping in a penalty contact makes things stick together.",
    "Then the bodies never part by themselves. If the force is clipped at zero, the contact lets "
    "go at every damping ratio. At critical damping the bodies separate with {left:.3f} of their "
    "approach speed.",
)
def damping_makes_things_stick(result):
    from course.oracles.mujoco.box import spring_restitution

    def tears(zeta):
        """Return the speed apart at 1 mm depth beyond which the damper loses the bodies [m/s]."""
        # Slow and fast mode of the overdamped oscillator: the position overshoots zero only if the
        # start is faster than the fast eigenvalue times the depth.
        return 1e-3 * 100.0 * (zeta + np.sqrt(zeta**2 - 1))

    remaining = result.measure("left", _hit(1.0, False), tolerance=1e-2)
    zetas = result.rng.uniform(1.05, 3.0, 8)
    result.statement = (
        f"zeta = 1, clipped: {remaining:.4f} m/s; theory exp(-2) = {spring_restitution(1.0):.4f}."
    )
    result.statement_holds(
        bool(np.isnan(_hit(1.5, False))),
        only_if="the damper may pull, the damping ratio zeta is at least 1, and the bodies do not "
        "part faster than (zeta + sqrt(zeta^2 - 1)) omega times their depth, where omega^2 = k/m",
        inside=[bool(np.isnan(_hit(z, True))) for z in zetas]
        + [bool(np.isnan(_hit(z, True, start=(-1e-3, 0.95 * tears(z))))) for z in zetas],
        # A force clipped at zero, and underdamped contacts: both must part.
        outside=[bool(np.isnan(_hit(z, False))) for z in zetas]
        + [bool(np.isnan(_hit(z, True))) for z in 0.3 * zetas]
        # Chosen to break it: bodies that start in contact and part fast.
        + [bool(np.isnan(_hit(z, True, start=(-1e-3, 1.05 * tears(z))))) for z in zetas],
    )
    result.correction_holds(abs(remaining - spring_restitution(1.0)) < 0.01)


@claim(
    "The penalty force is F = k d n + b v_rel.",
    "With a plus sign the damper drives the bodies apart: at a damping ratio of {zeta:.1f} a ball "
    "leaves such a contact (even one clipped at zero) with {gain:.2f} times its speed. The damper "
    "must act against v_rel, the velocity of the pushed body minus that of the other one, along "
    "the normal: k d n - b (v_rel . n) n, clipped at zero.",
)
def penalty_law_has_a_plus(result):
    zeta = result.input("zeta", 0.1)
    gain = result.measure("gain", _hit(zeta, False, sign=1.0), tolerance=1e-2)
    loss = _hit(zeta, False)
    # With the right sign every damping ratio must lose speed.
    zetas = result.rng.uniform(0.05, 0.6, 8)
    result.statement = f"1 m/s comes back as {gain:.3f} m/s with a plus, {loss:.3f} with a minus."
    result.statement_holds(gain <= 1.0)
    result.correction_holds(gain > 1.0, all(_hit(z, False) < 1.0 for z in zetas))


@claim(
    "The damper of a penalty contact damps the oscillation.",
    "The damping itself lowers that limit: in semi-implicit Euler to 2 (sqrt(1 + zeta^2) - "
    "zeta)/omega. Above the limit the damper drives the oscillation. With several contacts, omega "
    "and zeta are those of the fastest oscillation: in a tower of {boxes:.0f} equal boxes both are "
    "{faster:.2f} times those of one box on the same contact. A contact that opens and "
    "closes needs a shorter step. Dropped from {drop_mm:.0f} mm, at a damping ratio of {ratio:.2f} "
    "and {share:.0%} of the limit, a ball reaches more than {gained:.0f} times its energy. At "
    "{safe:.0%} of the limit and a damping ratio of {least:.1f} or more, none of our balls gains "
    "energy. Sliding is not damped at all: a block that slides at {speed:.0f} m/s loses nothing to "
    "the damper.",
)
def damper_damps(result):
    from course.charts.contact.limits import step_limit
    from course.contact import scenes

    speed = result.input("speed", 1.0)

    def swing(ratio, share):
        """Return the height [m] over which a ball that starts off its rest still swings."""
        h = share * step_limit(ratio, "semi-implicit") / 100.0
        # It starts 0.5 m g / k below its rest depth, so that the contact stays closed.
        scene = scenes.ball_drop(-1.5 * scenes.GRAVITY / 1e4)
        path = scenes.run(scene, "penalty", h, 600, stiffness=1e4, damping=200.0 * ratio)
        # After 500 steps the swing of a stable contact is gone, for the damping ratios sampled.
        return np.ptp(path.q[0, -100:])

    def gains(ratio, share, drop):
        """Return the largest energy of a ball that bounces over that of its start."""
        h = share * step_limit(ratio, "semi-implicit") / 100.0
        path = scenes.run(
            scenes.ball_drop(drop), "penalty", h, 1500, stiffness=1e4, damping=200.0 * ratio
        )
        # Energy over that of the drop; the spring's is left out, so in contact it is a lower bound.
        energy = 0.5 * path.v[0] ** 2 + scenes.GRAVITY * path.q[0]
        return energy.max() / (scenes.GRAVITY * drop)

    def fastest(scene):
        """Return the largest natural frequency of bodies on springs of 1e4 N/m [rad/s]."""
        normal = scene.jacobian[:, 0]
        stiffness = 1e4 * normal.T @ normal
        return np.sqrt(np.linalg.eigvals(np.linalg.solve(scene.mass, stiffness)).real.max())

    def several(scene, ratio, share, omega):
        """Return the largest swing [m] of bodies that start at rest but 2 % too deep.

        `omega` is the frequency from which damping and step are computed.
        """
        normal = scene.jacobian[:, 0]
        deep = 1.02 * np.linalg.solve(1e4 * normal.T @ normal, scene.force)
        path = scenes.run(
            replace(scene, q=deep),
            "penalty",
            share * step_limit(ratio, "semi-implicit") / omega,
            1000,
            stiffness=1e4,
            damping=2e4 * ratio / omega,
        )
        return np.ptp(path.q[:, -100:], axis=1).max()

    stacks = [scenes.tower([1.0] * 3), scenes.tower([1.0, 2.0, 0.3]), scenes.table((0.2, 0.1))]
    boxes = int(result.input("boxes", 3))
    result.measure("faster", fastest(scenes.tower([1.0] * boxes)) / 100.0, tolerance=1e-6)
    ratio, share = result.input("ratio", 0.02), result.input("share", 0.95)
    drop = 1e-3 * result.input("drop_mm", 10.0)
    gained = result.input("gained", 100.0)
    least, safe = result.input("least", 0.1), result.input("safe", 0.5)
    bounces, damped = result.rng.uniform(1e-3, 0.1, 8), result.rng.uniform(least, 1.0, 8)
    ratios, shares = result.rng.uniform(0.1, 1.5, 8), result.rng.uniform(0.2, 0.95, 8)
    scene = scenes.block(0.0, 0.0, (speed, 0.0))
    slid = scenes.run(scene, "penalty", 1e-4, 1000, stiffness=1e4, damping=100.0)
    retained = result.measure("kept_m_s", slid.v[0, -1], tolerance=1e-9)
    result.statement = "A ball on a damped spring, steps below and above the limit."
    result.statement_holds(
        swing(1.0, 1.1) < 1e-6,
        only_if="the step is below the scheme's limit for the fastest oscillation of the bodies on "
        "their contacts, and well below it if a contact opens",
        inside=[swing(z, s) < 1e-6 for z, s in zip(ratios, shares, strict=True)]
        + [gains(z, safe, height) < 1.0 + 1e-9 for z, height in zip(damped, bounces, strict=True)]
        # Chosen to break it: towers and a table, close to the limit of their fastest oscillation.
        + [several(scene, z, 0.97, fastest(scene)) < 1e-6 for scene in stacks for z in (0.3, 1.0)],
        outside=[swing(z, 1.02 + s / 3) < 1e-6 for z, s in zip(ratios, shares, strict=True)]
        + [gains(ratio, share, height) < 1.0 + 1e-9 for height in bounces]
        # Below the limit of one box of 1 kg, which such towers exceed.
        + [several(scenes.tower([1.0] * n), 1.0, 0.95, 100.0) < 1e-6 for n in (2, boxes)],
    )
    # Past the limit the contact may only rattle, but it leaves rest.
    result.correction_holds(
        abs(retained - speed) < 1e-12,
        all(swing(z, 1.03) > 1e-6 for z in ratios),
        gains(ratio, share, drop) > gained,
        sum(gains(ratio, share, height) > 1.5 for height in bounces) > len(bounces) / 2,
        all(gains(z, safe, height) < 1.0 + 1e-9 for z, height in zip(damped, bounces, strict=True)),
        all(gains(least, safe, height) < 1.0 + 1e-9 for height in bounces),
    )
