"""Claims of chapter 6: when a legged robot can stand."""

import math

from course.derivations import claim


@claim(
    "A legged robot can stand on any slope below the friction angle.",
    "Below the friction angle vertical forces stay in their cones, but they must also balance "
    "moments and respect the torque limits. At half of the friction angle's tangent, the biped of "
    "this chapter can stand while the vertical through its centre of mass meets the ground up to "
    "{reach_mm:.0f} mm from the middle, where its outermost contact is, and while its joints can "
    "bear {least:.1f} N m. A robot in space needs this vertical inside the convex hull of its "
    "contacts. Beyond the friction angle it cannot stand whatever its motors are.",
)
def below_the_friction_angle(result):
    import numpy as np
    from scipy.optimize import linprog

    from course.control.standing import biped, stand

    stance, half = 0.15, 0.08

    def stands(lean, limit=1e4, part=0.5, mu=0.6):
        slope = math.atan(part * mu)
        return stand(biped(slope, mu, lean=lean, limit=limit)).feasible

    def largest(test, low, high):
        """Return where a test that holds at low and not at high stops holding."""
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if test(middle) else (low, middle)
        return low

    reach = largest(lambda x: stands(x), 0.0, 0.5)
    least = 1.0 / largest(lambda x: stands(0.0, limit=1.0 / x), 1e-3, 10.0)
    result.measure("reach_mm", 1e3 * reach, 0.01)
    result.measure("least", least, 0.01)
    outermost = (stance + half) * math.cos(math.atan(0.3))
    draws = result.rng.uniform(0.0, 1.0, (3, 12))

    def drawn(lean, factor):
        """Return how the claim fares at random slopes, with a share of the reach."""
        rows = []
        for a, b, c in draws.T:
            mu, part = 0.2 + a, 0.05 + 0.93 * b
            edge = (stance + half) * math.cos(math.atan(part * mu))
            rows.append(stands(lean * edge * np.sign(c - 0.5), factor, part, mu))
        return rows

    def carried(spots, centre, slope, mu):
        """Return whether contacts at (x, y) on a slope along x carry a weight above (x, y).

        A linear program over the edges of a pyramid in each contact's friction cone, with strong
        joints.
        """
        points = np.column_stack([spots, spots[:, 0] * math.tan(slope)])
        levers = points - np.append(centre, 0.9)
        normal = np.array([-math.sin(slope), 0.0, math.cos(slope)])
        turn = 2.0 * np.pi / 16 * np.arange(16)[:, None]
        along = np.array([math.cos(slope), 0.0, math.sin(slope)])
        edges = normal + mu * (np.cos(turn) * along + np.sin(turn) * np.array([0.0, 1.0, 0.0]))
        forces = np.tile(edges, (len(points), 1))
        moments = np.cross(np.repeat(levers, 16, axis=0), forces)
        balance = np.vstack([forces.T, moments.T])
        return linprog(np.zeros(len(forces)), A_eq=balance, b_eq=[0, 0, 1, 0, 0, 0]).status == 0

    # Chosen to break it: wide and narrow stances on ice and on rubber, just below the friction
    # angle and just above the last contact.
    extreme = []
    for size, mu, sign in zip(
        (0.03, 0.1, 0.5, 2.0), (0.02, 3.0, 0.1, 1.5), (1, -1) * 2, strict=True
    ):
        slope = math.atan(0.999 * mu)
        edge = sign * 0.999 * (size + half) * math.cos(slope)
        extreme.append(stand(biped(slope, mu, lean=edge, stance=size)).feasible)
    # Also chosen to break it: feet that are not in one line. The centre of mass of a robot on three
    # of the corners of a square can be between the outermost contacts and yet outside the triangle.
    spatial, beside = [], []
    for _ in range(6):
        mu = 0.2 + result.rng.uniform()
        slope = math.atan(0.98 * mu)
        spots = result.rng.uniform(-0.4, 0.4, (result.rng.integers(3, 7), 2))
        spatial.append(carried(spots, result.rng.dirichlet(np.ones(len(spots))) @ spots, slope, mu))
        corners = np.array([[-0.3, -0.3], [0.3, -0.3], [-0.3, 0.3]])
        beside.append(carried(corners, result.rng.uniform(0.02, 0.28, 2), slope, mu))

    result.statement = (
        "A planar biped with heels and toes, whose forces come from a quadratic program with "
        "friction cones, and contacts of a robot in space, with a linear program."
    )
    result.statement_holds(
        all(drawn(1.1, 1e4)),
        only_if="the vertical through the centre of mass meets the ground inside the convex hull "
        "of the contacts (in the plane, between the outermost two), and the joints are strong "
        "enough",
        inside=[*drawn(0.95, 1e4), *extreme, *spatial],
        outside=[*drawn(1.05, 1e4), *drawn(0.0, 0.5 * least), *beside],
    )
    beyond = [stands(0.0, 1e6, 1.01, 0.2 + a) for a in draws[0]]
    result.correction_holds(
        abs(reach / outermost - 1.0) < 1e-4, least > 0.5, not any(beyond), not any(beside)
    )
