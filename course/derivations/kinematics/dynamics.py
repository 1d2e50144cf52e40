"""Claims on what an arm's joints feel: its mass matrix, the algorithms, what torques can tell."""

from typing import Any

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "m2": Symbol("mass of the second link, a uniform rod [kg]"),
    "l1": Symbol("length of the first link [m]"),
    "l2": Symbol("length of the second link [m]"),
    "q2": Symbol("angle of the second link from the first [rad]", -3.0, 3.0),
}


@claim(
    "The inertia that a joint feels is that of the links behind it, a constant.",
    "It depends on the posture, and the joints feel one another. The first joint of rods of "
    "{l1_m} m and {l2_m} m, {m1_kg} kg and {m2_kg} kg feels {ratio:.1f} times as much with the arm "
    "stretched as folded, and an acceleration of the second asks it for M12 = {formula}, which "
    "changes its sign where cos q2 = -2 l2 / (3 l1), if anywhere.",
    ask=(
        "Two uniform rods. What is the entry M12 of the mass matrix, q2 from the first link?",
        "M12 = m2*l2^2/3 + m2*l1*l2*cos(q2)/2",
        {
            "m2*l2^2/3": "That is M22; the second rod also moves with the first one's tip.",
            "m2*l2^2/12 + m2*l1*l2*cos(q2)/2": "The rod turns about its end, not its centre.",
            "m2*l2^2/3 + m2*l1*l2*cos(q2)": "Its centre is half of l2 out.",
            "m2*l2^2/3 + m2*l1*l2*sin(q2)/2": "Stretched, q2 = 0, is where they couple most.",
        },
    ),
    source="Spong, Hutchinson and Vidyasagar, Robot Modeling and Control (2006), sec. 7.3",
)
def two_link_mass_matrix(found):
    import sympy

    from course.kinematics import TwoLink

    m1, m2, l1, l2, g, t = sympy.symbols("m1 m2 l1 l2 g t", positive=True)
    q = [sympy.Function(name)(t) for name in ("q1", "q2")]
    v = [angle.diff(t) for angle in q]
    heading = [q[0], q[0] + q[1]]

    def along(*steps: Any) -> sympy.Matrix:
        """A point so far along each link."""
        return sum(
            (sympy.Matrix([r * sympy.cos(a), r * sympy.sin(a)])
             for r, a in zip(steps, heading, strict=False)), sympy.zeros(2, 1),
        )  # fmt: skip

    centres = [along(l1 / 2), along(l1, l2 / 2)]
    kinetic = sum(
        m * (c.diff(t).dot(c.diff(t)) + length**2 / 12 * a.diff(t) ** 2) / 2
        for m, c, length, a in zip((m1, m2), centres, (l1, l2), heading, strict=True)
    )
    energy = kinetic - g * (m1 * centres[0][1] + m2 * centres[1][1])
    torque = sympy.Matrix(
        [energy.diff(w).diff(t) - energy.diff(x) for x, w in zip(q, v, strict=True)]
    )
    plain = sympy.symbols("q1 q2 v1 v2 a1 a2", real=True)
    names = [*q, *v, *(w.diff(t) for w in v)]
    torque = torque.subs(dict(zip(names[4:], plain[4:], strict=True)))
    torque = torque.subs(dict(zip(names[2:4], plain[2:4], strict=True)))
    torque = torque.subs(dict(zip(names[:2], plain[:2], strict=True)))
    M = torque.jacobian(plain[4:]).applyfunc(lambda x: sympy.trigsimp(sympy.expand(x)))
    found.formula = M[0, 1]
    numeric = sympy.lambdify((m1, m2, l1, l2, g, *plain), [torque, M])

    def off(draw: np.ndarray) -> float:
        """Largest difference to the closed form of the course, torques and mass matrix."""
        (a, b, c, d), state = draw[:4], draw[4:].reshape(3, 2)
        arm = TwoLink(lengths=(c, d), masses=(a, b), damping=(0.0, 0.0), gravity=9.81)
        tau, matrix = numeric(a, b, c, d, 9.81, *draw[4:])
        apart = np.abs(np.ravel(tau) - arm.inverse_dynamics(*state)).max()
        return max(float(apart), float(np.abs(matrix - arm.mass_matrix(state[0])).max()))

    lengths = found.given("l1_m", 1.0), found.given("l2_m", 0.8)
    masses = found.given("m1_kg", 1.0), found.given("m2_kg", 0.8)
    arm = TwoLink(lengths=lengths, masses=masses)
    swing = arm.mass_matrix(np.array([np.zeros(721), np.linspace(0, np.pi, 721)]))
    found.figure("ratio", swing[0, 0, 0] / swing[0, 0, -1], 1e-6)
    found.figure("m12_stretched", swing[0, 1, 0])
    draws = found.rng.uniform((0.2,) * 4 + (-3,) * 6, (2,) * 4 + (3,) * 6, (30, 10))
    turn = np.arccos(-2 * lengths[1] / (3 * lengths[0]))
    found.statement = (
        "Lagrange's equations of two rods with gravity, by algebra, against the course's closed "
        "form at 30 random arms and states."
    )
    found.heard(np.ptp(swing[0, 0]) < 1e-9 and np.abs(swing[0, 1]).max() < 1e-9)
    found.corrected(
        max(off(draw) for draw in draws) < 1e-10, M == M.T, swing[0, 0, 0] > swing[0, 0, -1],
        abs(arm.mass_matrix([0.0, turn])[0, 1]) < 1e-12,
    )  # fmt: skip
