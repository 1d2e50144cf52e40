"""Claims on what an arm's joints feel: its mass matrix, the algorithms, what torques can tell."""

from typing import Any

import numpy as np

from course.derivations import Symbol, claim
from course.derivations.kinematics import Floats, panda_postures

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
def two_link_mass_matrix(result):
    import sympy

    from course.kinematics import TwoLink

    m1, m2, l1, l2, g, t = sympy.symbols("m1 m2 l1 l2 g t", positive=True)
    q = [sympy.Function(name)(t) for name in ("q1", "q2")]
    v = [angle.diff(t) for angle in q]
    heading = [q[0], q[0] + q[1]]

    def along(*steps: Any) -> sympy.Matrix:
        """Return a point so far along each link."""
        return sum(
            (
                sympy.Matrix([r * sympy.cos(a), r * sympy.sin(a)])
                for r, a in zip(steps, heading, strict=False)
            ),
            sympy.zeros(2, 1),
        )

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
    torque = torque.subs(list(zip(names, plain, strict=True))[::-1])
    M = torque.jacobian(plain[4:]).applyfunc(lambda x: sympy.trigsimp(sympy.expand(x)))
    result.formula = M[0, 1]
    numeric = sympy.lambdify((m1, m2, l1, l2, g, *plain), [torque, M])

    def deviation(draw: np.ndarray) -> float:
        """Return largest difference to the closed form of the course, torques and mass matrix."""
        (a, b, c, d), state = draw[:4], draw[4:].reshape(3, 2)
        arm = TwoLink(lengths=(c, d), masses=(a, b), damping=(0.0, 0.0), gravity=9.81)
        tau, matrix = numeric(a, b, c, d, 9.81, *draw[4:])
        difference = np.abs(np.ravel(tau) - arm.inverse_dynamics(*state)).max()
        return max(float(difference), float(np.abs(matrix - arm.mass_matrix(state[0])).max()))

    lengths = result.input("l1_m", 1.0), result.input("l2_m", 0.8)
    masses = result.input("m1_kg", 1.0), result.input("m2_kg", 0.8)
    arm = TwoLink(lengths=lengths, masses=masses)
    swing = arm.mass_matrix(np.array([np.zeros(721), np.linspace(0, np.pi, 721)]))
    result.measure("ratio", swing[0, 0, 0] / swing[0, 0, -1], 1e-6)
    result.measure("m12_stretched", swing[0, 1, 0])
    draws = result.rng.uniform((0.2,) * 4 + (-3,) * 6, (2,) * 4 + (3,) * 6, (30, 10))
    turn = np.arccos(-2 * lengths[1] / (3 * lengths[0]))
    result.statement = (
        "Lagrange's equations of two rods with gravity, by algebra, against the course's closed "
        "form at 30 random arms and states."
    )
    result.statement_holds(np.ptp(swing[0, 0]) < 1e-9 and np.abs(swing[0, 1]).max() < 1e-9)
    result.correction_holds(
        max(deviation(draw) for draw in draws) < 1e-10,
        M == M.T,
        swing[0, 0, 0] > swing[0, 0, -1],
        abs(arm.mass_matrix([0.0, turn])[0, 1]) < 1e-12,
    )


def exact_accelerations(
    lengths: Floats,
    masses: Floats,
    q: np.ndarray,
    v: np.ndarray,
    tau: np.ndarray,
    gravity: float = 0.0,
) -> np.ndarray:
    """Return the exact joint accelerations (n,) of planar rods under gravity along -y.

    They follow from Lagrange's equations with 60 digits.
    """
    import mpmath as mp

    with mp.workdps(60):
        L, m, angle, spin, tau = (
            np.array([mp.mpf(float(x)) for x in row]) for row in (lengths, masses, q, v, tau)
        )
        links = L * np.array([mp.expj(x) for x in np.cumsum(angle)])
        M, rest, square = mp.zeros(len(q)), mp.matrix(tau), np.cumsum(spin) ** 2
        for k in range(len(q)):
            # Of the centre of rod k, as complex numbers: way from the joints, and acceleration.
            path = np.append(links[:k], links[k] / 2)
            J = 1j * np.cumsum(path[::-1])[::-1]
            pull = 1j * gravity - np.sum(square[: k + 1] * path)
            for i in range(k + 1):
                rest[i] -= m[k] * (mp.conj(J[i]) * pull).real
                for j in range(k + 1):
                    M[i, j] += m[k] * ((mp.conj(J[i]) * J[j]).real + L[k] ** 2 / 12)
        return np.array([float(x) for x in mp.lu_solve(M, rest)])


@claim(
    "The articulated-body algorithm loses fewer digits than a factorised mass matrix.",
    "It does on long arms whose last link is not light and whose links are not folded onto each "
    "other: the median error is then more than {clear:g} times smaller. For planar rods at rest "
    "under random torques, Cholesky's factors lose about {digits:.0f} digit more with {many:g} "
    "links in the median, and about {digits_heavy:.0f} digits more if the last link weighs "
    "{factor:.0e} times as much as the others. With {few:g} links the two are alike: the median "
    "errors differ by a factor of about {ratio:.1f}. Neither algorithm escapes the conditioning: "
    "the heavy last link costs even the articulated-body algorithm about {lost:.0f} digits.",
    source="Featherstone, Rigid Body Dynamics Algorithms (2008), ch. 7 and 10",
)
def articulated_bodies_lose_fewer_digits(result):
    from scipy.linalg import cho_factor, cho_solve

    from course.kinematics import forward_dynamics, mass_matrix, planar

    # No double is nearer to the truth than this, but by chance.
    unit = 2.0**-53

    def errors(n: int, factor: float, postures: int, bend: float | None = None) -> np.ndarray:
        """Return the median relative errors of articulated bodies and of Cholesky's factors.

        Links and postures are random; with a bend the links are equal and every joint has it.
        """
        measured = []
        for _ in range(postures):
            lengths, masses = result.rng.uniform(0.3, 1, n), result.rng.uniform(0.5, 2, n)
            masses[-1] *= factor
            q, tau = result.rng.uniform(-3, 3, n), result.rng.normal(size=n)
            if bend is not None:
                lengths, masses, q = np.ones(n), np.append(np.ones(n - 1), factor), np.full(n, bend)
            arm = planar(lengths, masses)
            truth = exact_accelerations(lengths, masses, q, 0 * q, tau)
            ours = forward_dynamics(arm, q, 0 * q, tau, gravity=(0, 0, 0))
            other = cho_solve(cho_factor(mass_matrix(arm, q)), tau)
            both = np.array([ours, other])
            measured.append(np.linalg.norm(both - truth, axis=1) / np.linalg.norm(truth))
        return np.median(np.maximum(measured, unit), axis=0)

    few, more = result.input("few", 2), result.input("many", 8)
    factor = result.input("factor", 1e6)
    short, long, loaded = errors(few, 1, 400), errors(more, 1, 40), errors(more, factor, 40)
    # Errors at the level of rounding depend on the CPU, so the figures are coarse on purpose: whole
    # digits, and the ratio to the nearest half.
    result.measure("digits", np.round(np.log10(long[1] / long[0])))
    result.measure("digits_heavy", np.round(np.log10(loaded[1] / loaded[0])))
    result.measure("lost", np.round(np.log10(loaded[0] / long[0])))
    result.measure("ratio", np.round(2.0 * short[1] / short[0]) / 2.0)
    result.statement = (
        "Median errors over 400 arms and postures with two links and 40 with more. The truth is a "
        "solution with 60 digits."
    )
    clear = result.input("clear", 5)

    def better(n: int, load: float) -> bool:
        ours, other = errors(n, load, 30)
        return bool(other > clear * ours)

    longest = int(result.input("longest", 10))
    draws = list(
        zip(result.rng.integers(8, longest + 1, 8), 10 ** result.rng.uniform(0, 6, 8), strict=True)
    )
    inside = [better(int(n), load) for n, load in draws]
    outside = [better(2, load) for _, load in draws] + [better(8, 1e-6) for _ in draws]
    # Chosen to break it: equal links, straight or curled up. Outside: folded onto each other.
    bends = {bend: errors(more, 1, 12, bend) for bend in (0.0, 2.0 * np.pi / more, np.pi)}
    apart = [other > clear * ours for ours, other in bends.values()]
    result.statement_holds(
        short[1] > clear * short[0] and long[1] > clear * long[0],
        only_if="the arm has many links (arms of {many:g} to {longest:g} were tried), the last one "
        "is at least as heavy as the others, and the links are not folded onto each other",
        inside=inside + apart[:2],
        outside=outside + apart[2:],
    )
    result.correction_holds(
        0.4 < short[1] / short[0] < 2.5,
        long[1] > 5 * long[0],
        loaded[1] > 20 * loaded[0],
        loaded[0] > 1e3 * long[0],
    )


@claim(
    "From enough torques and motions one can identify all ten inertial numbers of each link.",
    "Torques are linear in them. But of the {numbers:g} numbers of the 7-R arm, its first axis "
    "vertical, only {seen:g} combinations show in any motion. The first link only turns about "
    "that axis, so most of its numbers never act, and some mass can be moved from link to link "
    "without a change of any torque. Fit the combinations.",
    source="Atkeson, An and Hollerbach, Estimation of inertial parameters (1986)",
)
def torques_tell_ten_numbers(result):
    from course.kinematics import inertial_parameters, inverse_dynamics, regressor

    def motions(count: int) -> tuple[Any, Any, Any, Any]:
        arm, q = panda_postures(result.rng, count)
        return arm, q, result.rng.normal(size=q.shape), result.rng.normal(size=q.shape)

    def rows(count: int) -> np.ndarray:
        return regressor(*motions(count)).transpose(2, 0, 1).reshape(-1, 70)

    def rank(matrix: np.ndarray) -> int:
        s = np.linalg.svd(matrix)[1]
        return int(np.sum(s > 1e-9 * s[0]))

    matrix = rows(60)
    numbers = result.measure("numbers", matrix.shape[1])
    observed = result.measure("seen", rank(matrix))
    # Numbers that differ along the unseen directions give the same torques elsewhere.
    unseen = np.linalg.svd(matrix)[2][observed:]
    arm, q, v, a = motions(20)
    other = inertial_parameters(arm) + result.rng.normal(size=len(unseen)) @ unseen
    torques = np.einsum("ijk,j->ik", regressor(arm, q, v, a), other)
    torques += arm.armature[:, None] * a + arm.damping[:, None] * v
    more = rank(rows(90))
    result.statement = f"Rank of the regressor over 60 random states; with 90 it is {more}."
    result.statement_holds(observed == numbers)
    result.correction_holds(
        np.allclose(torques, inverse_dynamics(arm, q, v, a), atol=1e-9),
        observed < numbers,
        more == observed,
        rank(matrix[:, :10]) < 10,
    )
