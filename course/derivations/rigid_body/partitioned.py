"""Claims on what being symplectic does for the energy and for a stiff spring."""

import numpy as np

from course.derivations import claim
from course.derivations.rigid_body.linear import (
    measured_limit,
    numeric_matrix,
    spectral_radius,
    step_matrix,
    symbols,
)
from course.derivations.rigid_body.time_step import STABLE


def _partitioned(positions: np.ndarray, velocities: np.ndarray, weights: np.ndarray, x: float):
    """Return matrix of one step of a pair of Runge-Kutta rules on q' = v, v' = -q, shape (2, 2).

    Args:
        positions: table that builds the stages of q, shape (s, s).
        velocities: table that builds the stages of v, shape (s, s).
        weights: of the stages, shape (s,).
        x: the step.
    """
    one = np.ones((len(weights), 1)) * np.eye(2)[:, None, :]  # q and v at the start, by column
    # Stage equations, with the velocity stages eliminated.
    lhs = np.eye(len(weights)) + x * x * positions @ velocities
    q = np.linalg.solve(lhs, one[0] + x * positions @ one[1])
    v = one[1] - x * velocities @ q
    return np.eye(2) + x * np.array([weights @ v, -weights @ q])


LOBATTO = (  # IIIA, IIIB, weights (Hairer, Lubich and Wanner 2006, table II.2.2)
    np.array([[0, 0, 0], [5, 8, -1], [4, 16, 4]]) / 24,
    np.array([[1, -1, 0], [1, 2, 0], [1, 5, 0]]) / 6,
    np.array([1, 4, 1]) / 6,
)


@claim(
    "A symplectic integrator removes the limit that a stiff spring puts on the step.",
    "Symplectic and explicit together keep a limit: semi-implicit Euler and velocity Verlet have "
    "omega dt = 2. Being implicit does not remove it by itself: the pair Lobatto IIIA-IIIB, which "
    "is implicit and symplectic, grows by {lobatto_growth_at_3:.2f} a step at omega dt = 3. In a "
    "linear system without dampers a symplectic Runge-Kutta method that treats position and "
    "velocity alike, such as the midpoint rule, has none, and neither has implicit Euler, which is "
    "not symplectic. A "
    "contact is a spring that lets go: a ball that bounces on one has up to {bouncing:.0f} times "
    "its energy "
    "under the midpoint rule at omega dt = {bouncing_at} after {bouncing_steps:g} steps.",
    source="E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration, 2006, sec. VI.4",
)
def symplectic_removes_stiffness(result):
    def symplectic_rule(stages: int) -> tuple[np.ndarray, np.ndarray]:
        """Return a random one: b_i a_ij + b_j a_ji = b_i b_j."""
        b = result.rng.uniform(0.2, 1, stages)
        # Cooper's condition with a random antisymmetric part.
        skew = result.rng.normal(size=(stages, stages))
        b /= b.sum()
        return b / 2 + (skew - skew.T) / b[:, None], b

    def radius(matrix: np.ndarray) -> float:
        return float(np.abs(np.linalg.eigvals(matrix)).max())

    def alike(x: float) -> float:
        table, b = symplectic_rule(result.rng.integers(1, 4))
        return radius(_partitioned(table, table, b, x))

    explicit = [measured_limit(n) for n in ("semi_implicit_euler", "velocity_verlet")]
    steps = 10 ** result.rng.uniform(-1, 3, 40)
    backward = [radius(np.linalg.inv([[1.0, -x], [x, 1.0]])) for x in (1.0, *steps)]
    midpoint = [spectral_radius("implicit_midpoint", x) for x in steps]
    lobatto = radius(_partitioned(*LOBATTO, 3.0))
    result.measure("semi_implicit_omega_h", explicit[0], tolerance=1e-5)
    result.measure("verlet_omega_h", explicit[1], tolerance=1e-5)
    result.measure("implicit_euler_radius", backward[0], tolerance=1e-5)
    result.measure("lobatto_growth_at_3", lobatto)

    def bounced(x: float, steps: int, gravity: float = 0.1) -> np.ndarray:
        """Return the energy of balls on a one-sided spring over that at the start.

        They are integrated by implicit midpoint.
        """
        q, v = result.rng.uniform(0.1, 3, 200), np.zeros(200)
        start = gravity * q
        for _ in range(steps):
            free = q + x / 2 * v - x * x / 4 * gravity
            # Implicit midpoint, solved case by case: in contact or free at the middle of the step.
            middle = np.where(free < 0, free / (1 + x * x / 4), free)
            v = v + x * (-np.minimum(middle, 0) - gravity)
            q = 2 * middle - q
        return (v * v / 2 + gravity * q + np.minimum(q, 0) ** 2 / 2) / start

    at, count = result.input("bouncing_at", 1.5), result.input("bouncing_steps", 2000)
    largest = result.measure("bouncing", bounced(at, count).max(), tolerance=0.3)

    def hardened(x: float, steps: int = 400) -> np.ndarray:
        """Return the largest energy on q'' = -x^2 (q + q^3) over that at the start, step 1.

        They are integrated by implicit midpoint, solved by Newton's method.
        """
        q, v = np.linspace(0.5, 1.5, 20), np.zeros(20)

        def energy() -> np.ndarray:
            return v * v / 2 + x * x * (q * q / 2 + q**4 / 4)

        start = largest = energy()
        for _ in range(steps):
            middle = q + v / 2
            for _ in range(30):
                # At the middle of the step: m = q + v / 2 - x^2 (m + m^3) / 4.
                miss = middle - q - v / 2 + x * x * (middle + middle**3) / 4
                middle = middle - miss / (1 + x * x * (1 + 3 * middle**2) / 4)
            q, v = 2 * middle - q, v - x * x * (middle + middle**3)
            largest = np.maximum(largest, energy())
        return largest / start

    def swung(x: float, steps: int = 400, step: float = 0.05) -> float:
        """Return the largest energy of a mass on a linear spring about a pivot, by the start's.

        It is integrated by implicit midpoint, solved by Newton's method.
        """
        stiffness, q, v = (x / step) ** 2, np.array([1.0, 0.0]), np.array([0.0, 1.0])
        largest = start = 0.5
        for _ in range(steps):
            middle = q
            for _ in range(30):
                length = np.sqrt(middle @ middle)
                along = np.outer(middle, middle) / length**2
                slope = stiffness * (along + (1 - 1 / length) * (np.eye(2) - along))
                force = -stiffness * (1 - 1 / length) * middle
                miss = middle - q - step / 2 * v - step**2 / 4 * force
                change = np.linalg.solve(np.eye(2) + step**2 / 4 * slope, miss)
                middle = middle - change
                if np.abs(change).max() < 1e-12:
                    break
            q, v = 2 * middle - q, 4 / step * (middle - q) - v
            stretched = np.sqrt(q @ q) - 1
            largest = max(largest, v @ v / 2 + stiffness * stretched**2 / 2)
            if largest > 100 * start:
                break
        return largest / start

    def damped(x: float, zeta: float = 1.0) -> float:
        """Return the growth per step on a spring with a damper, under a symplectic method.

        It is Yoshida's composition of three midpoint steps, the middle one backwards.
        """
        outer = 1 / (2 - 2 ** (1 / 3))
        A, step = np.array([[0.0, 1.0], [-x * x, -2 * zeta * x]]), np.eye(2)
        for part in (outer, 1 - 2 * outer, outer):
            half = part * A / 2
            step = np.linalg.solve(np.eye(2) - half, np.eye(2) + half) @ step
        return radius(step)

    # Chosen to break it: springs that are not linear, let go, turn about a pivot or have a damper.
    other = [*(hardened(x).max() for x in (1.4, 1.5, 1.6)), largest, swung(100.0)]
    result.statement = f"Implicit midpoint up to omega dt = 1000: radius {max(midpoint):.6f}."
    result.statement_holds(
        all(spectral_radius("semi_implicit_euler", x) < STABLE for x in steps),
        only_if="it treats positions and velocities with the same Runge-Kutta method, and the "
        "whole system is linear and undamped",
        inside=[alike(x) < 1 + 1e-5 for x in steps],
        outside=[radius(_partitioned(*LOBATTO, x)) < STABLE for x in result.rng.uniform(2, 6, 20)]
        + [growth < 2 for growth in other]
        + [damped(x) < STABLE for x in np.linspace(1.0, 1.4, 8)],
    )
    result.correction_holds(
        np.allclose(explicit, 2),
        lobatto > 1.3,
        max(backward) < 1,
        max(midpoint) < 1 + 1e-6,
        np.isclose(np.linalg.det(_partitioned(*LOBATTO, 3.0)), 1),
        largest > 10,
        bounced(0.05, count).max() < 1.1,
    )


@claim(
    "Engines use symplectic integrators and not Runge-Kutta, because these take away the limit "
    "that stiff contacts put on the step.",
    "They take nothing away: RK4's limit is {rk4_over_semi_implicit:.2f} times theirs. A better "
    "reason is cost: per force evaluation, RK4's limit is only {rk4_per_evaluation:.2f} times "
    "theirs. Another is that contact solvers also work on velocities, which fits the step. With a "
    "damping force from the old velocity, semi-implicit Euler is no longer symplectic: its "
    "determinant is 1 - 2 zeta omega dt.",
)
def reason_for_symplectic(result):
    import sympy

    from course.rigid_body import integrators, problems

    h, omega, zeta = symbols()
    semi, rk4 = measured_limit("semi_implicit_euler"), measured_limit("rk4")
    system = problems.oscillator().system
    methods = ("rk4", "semi_implicit_euler")
    counts = [integrators.evaluations_per_step(system, name, 0.01) for name in methods]
    evaluations = counts[0] / counts[1]
    result.measure("rk4_over_semi_implicit", rk4 / semi)
    result.measure("rk4_per_evaluation", rk4 / semi / evaluations)
    result.statement = (
        "Both limits by bisection, the evaluations as the course's methods count them."
    )
    result.statement_holds(semi > rk4)
    result.correction_holds(
        rk4 > semi,
        rk4 / evaluations < semi,
        sympy.expand(step_matrix("semi_implicit_euler", damped=True).det())
        == 1 - 2 * zeta * omega * h,
    )


@claim(
    "Preserving phase-space volume is what makes the energy oscillate instead of growing.",
    "Volume is too little. Two oscillators, one stepped by explicit Euler and one by its inverse "
    "with -h, keep the volume to rounding, and the first has {energy_ratio:.3g} times its energy "
    "after {steps:g} steps of omega h = {omega_h}. A symplectic step keeps the sum of the areas "
    "over all pairs (q, p), which is more; and even that bounds the energy only for a small step: "
    "at omega h = {large} semi-implicit Euler keeps the area and explodes.",
    source="Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), sec. VI.2",
)
def volume_kept_bounds_energy(result):
    u, steps = result.input("omega_h", 0.1), result.input("steps", 1000)
    large = result.input("large", 2.1)

    def pair(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Return two oscillators in the order q1, p1, q2, p2."""
        return np.block([[first, np.zeros((2, 2))], [np.zeros((2, 2)), second]])

    def defect(step: np.ndarray) -> float:
        turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
        # Symplectic: M^T J M = J for the sum over both pairs.
        return float(np.abs(step.T @ pair(turn, turn) @ step - pair(turn, turn)).max())

    explicit = numeric_matrix("explicit_euler", u)
    growing = pair(explicit, np.linalg.inv(numeric_matrix("explicit_euler", -u)))
    both = pair(*(numeric_matrix("semi_implicit_euler", x) for x in (u, 2 * u)))
    volume = np.linalg.det(np.linalg.matrix_power(growing, steps))
    state = np.linalg.matrix_power(growing, steps) @ np.ones(4)
    energy = result.measure("energy_ratio", state[:2] @ state[:2] / 2, 1e-4)
    exploding = numeric_matrix("semi_implicit_euler", large)
    size = np.linalg.norm(np.linalg.matrix_power(exploding, 100))
    result.measure("volume", volume)
    result.statement = (
        f"Volume {volume:.9f} after all steps; one step misses symplecticity by "
        f"{defect(growing):.1e}, semi-implicit Euler only by rounding errors."
    )
    result.statement_holds(energy < 2)
    result.correction_holds(
        abs(volume - 1) < 1e-9,
        defect(growing) > 1e-3,
        defect(both) < 1e-14,
        abs(np.linalg.det(exploding) - 1) < 1e-12 < 1e6 < size,
    )
