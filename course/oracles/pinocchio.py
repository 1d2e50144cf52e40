"""Pinocchio asked for the kinematics and the dynamics of chains.

The model is built joint by joint, each turning about z or sliding along it, with the tip as a frame
of the last link. Building it is not part of what one would time: make the arm once, then ask it.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import invalid, one_of, vector
from course.kinematics.chain import Chain
from course.libraries import import_error
from course.rigid_body.spatial import DOWNWARDS

Array = NDArray[np.float64]


def _pinocchio() -> ModuleType:
    try:
        import pinocchio
    except ImportError as error:
        raise import_error("Pinocchio", "pip install 'pin>=4.0'", error) from error
    return pinocchio


class PlanarChain:
    """A planar arm of revolute joints about z, of given link lengths.

    Args:
        lengths: link lengths, shape (n,) [m], n at least 1.

    Raises:
        ValueError: if lengths is not a row of finite numbers.
        ImportError: if Pinocchio is not installed.
    """

    def __init__(self, lengths: ArrayLike) -> None:
        pinocchio = _pinocchio()
        lengths = vector("lengths", lengths, (None,))
        if not lengths.size:
            raise invalid("lengths", lengths, "one or more finite numbers")
        self.model = pinocchio.Model()
        joint, place = 0, pinocchio.SE3.Identity()
        for i, length in enumerate(lengths):
            joint = self.model.addJoint(joint, pinocchio.JointModelRZ(), place, f"joint {i}")
            place = pinocchio.SE3(np.eye(3), np.array([length, 0.0, 0.0]))
        tip = pinocchio.Frame("tip", joint, place, pinocchio.FrameType.OP_FRAME)
        self._tip = self.model.addFrame(tip)
        self._data = self.model.createData()
        self._update = pinocchio.framesForwardKinematics

    def positions(self, thetas: ArrayLike) -> Array:
        """Return where the joints and the tip are.

        Args:
            thetas: joint angles, shape (n,) [rad], each relative to the link before it.

        Returns:
            Positions (x, y) of the n joints, the base first, and of the tip, shape (n + 1, 2) [m].

        Raises:
            ValueError: if there is not one angle for each joint.
        """
        thetas = vector("thetas", thetas, (self.model.nq,))
        self._update(self.model, self._data, thetas)
        joints = [self._data.oMi[i].translation for i in range(1, self.model.njoints)]
        return np.array([*joints, self._data.oMf[self._tip].translation])[:, :2]


def _depth_first(chain: Chain) -> list[int]:
    result: list[int] = []
    waiting = [-1]
    while waiting:
        joint = waiting.pop()
        result += [joint] if joint >= 0 else []
        # Reversed onto the stack, so that the lowest number comes first.
        waiting += np.flatnonzero(chain.parent == joint)[::-1].tolist()
    return result


def model(chain: Chain, gravity: ArrayLike = DOWNWARDS) -> Any:
    """Return the same arm as a `pinocchio.Model`, its joints named by their number in the chain.

    Pinocchio wants the joints of a subtree in a row, so a tree's come depth first: `model.names`
    tells. Armature is in the model; damping is not, as `rnea` and `aba` know none.

    Args:
        chain: the arm.
        gravity: in the world, shape (3,) [m/s^2].
    """
    pinocchio = _pinocchio()

    def place(pose: Array) -> Any:
        return pinocchio.SE3(pinocchio.Quaternion(*pose[3:]).matrix(), pose[:3])

    result, ids = pinocchio.Model(), {-1: 0}
    # Pinocchio numbers joints depth first; the names keep the chain's numbers.
    for i in _depth_first(chain):
        kind = pinocchio.JointModelPZ() if chain.slides[i] else pinocchio.JointModelRZ()
        before = ids[int(chain.parent[i])]
        ids[i] = result.addJoint(before, kind, place(chain.placement[:, i]), f"joint {i}")
        body = pinocchio.Inertia(chain.mass[i], chain.centre[:, i], chain.inertia[:, :, i])
        result.appendBodyToJoint(ids[i], body, pinocchio.SE3.Identity())
    frame = pinocchio.FrameType.OP_FRAME
    result.addFrame(pinocchio.Frame("tip", ids[chain.n - 1], place(chain.tool), frame))
    result.armature = np.array([chain.armature[int(name.split()[1])] for name in result.names[1:]])
    result.gravity.linear = vector("gravity", gravity, (3,), unit="m/s^2")
    return result


class Arm:
    """Pinocchio's answers about a chain, in the chain's order of joints.

    Attributes:
        model, data: Pinocchio's own.
        order: `q[order]` is Pinocchio's q.
    """

    def __init__(self, chain: Chain, gravity: ArrayLike = DOWNWARDS) -> None:
        self._library = _pinocchio()
        self.model = model(chain, gravity)
        self.data = self.model.createData()
        self.order = np.array([int(name.split()[1]) for name in self.model.names[1:]])
        self._back = np.argsort(self.order)
        self._tip = self.model.getFrameId("tip")
        self._damping = chain.damping

    def _pose(self, place: Any) -> Array:
        # Pinocchio's quaternions have the scalar last.
        x, y, z, w = self._library.Quaternion(place.rotation).coeffs()
        return np.array([*place.translation, w, x, y, z])

    def frames(self, q: Array) -> Array:
        """Return poses of the joints and, in the last column, of the tip, shape (7, n + 1)."""
        self._library.framesForwardKinematics(self.model, self.data, q[self.order])
        joints = [self._pose(self.data.oMi[i + 1]) for i in self._back.tolist()]
        return np.column_stack([*joints, self._pose(self.data.oMf[self._tip])])

    def jacobians(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the tip's Jacobian and its time derivative, shape (6, n) each."""
        library, model, data = self._library, self.model, self.data
        q, v, axes = q[self.order], v[self.order], library.LOCAL_WORLD_ALIGNED
        library.computeJointJacobiansTimeVariation(model, data, q, v)
        library.computeJointJacobians(model, data, q)
        library.updateFramePlacements(model, data)
        J = library.getFrameJacobian(model, data, self._tip, axes)
        rate = library.getFrameJacobianTimeVariation(model, data, self._tip, axes)
        # Of a single joint Pinocchio returns a row of six.
        return J.reshape(6, -1)[:, self._back], rate.reshape(6, -1)[:, self._back]

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """Return torques of a motion, the damping of the joints added, shape (n,)."""
        order = self.order
        # Recursive Newton-Euler.
        tau = self._library.rnea(self.model, self.data, q[order], v[order], a[order])
        return np.asarray(tau[self._back] + self._damping * v)

    def mass_matrix(self, q: Array) -> Array:
        """Return M, shape (n, n)."""
        upper = np.triu(self._library.crba(self.model, self.data, q[self.order]))
        # CRBA fills the upper triangle only.
        whole = upper + np.triu(upper, 1).T
        # Rows and columns back into the chain's order.
        return np.asarray(whole[np.ix_(self._back, self._back)])

    def forward_dynamics(self, q: Array, v: Array, tau: Array) -> Array:
        """Return accelerations, the damping of the joints taken off the torques, shape (n,)."""
        order, remaining = self.order, tau - self._damping * v
        # Articulated body algorithm.
        a = self._library.aba(self.model, self.data, q[order], v[order], remaining[order])
        return np.asarray(a[self._back])

    def calls(self, what: str, q: Array, v: Array, x: Array) -> Callable[[], Array]:
        """Return a function that evaluates N states, with one Python call of Pinocchio's for each.

        It gives the last answer, in Pinocchio's order of joints.

        Args:
            what: "rnea" (x: accelerations), "aba" (x: torques) or "jacobian" of the tip.
            q: angles, shape (n, N); laid out beforehand as Pinocchio reads them.
            v: rates, likewise.
            x: accelerations or torques, likewise.
        """
        library, model, data, tip = self._library, self.model, self.data, self._tip
        one_of("what", what, ("rnea", "aba", "jacobian"))
        rows = [list(np.ascontiguousarray(state[self.order].T)) for state in (q, v, x)]

        def jacobians() -> Array:
            axes = library.LOCAL_WORLD_ALIGNED
            for here in rows[0]:
                J = library.computeFrameJacobian(model, data, here, tip, axes)
            return np.asarray(J)

        def dynamics() -> Array:
            ask = getattr(library, what)
            for here, rate, third in zip(*rows, strict=True):
                result = ask(model, data, here, rate, third)
            return np.array(result)

        return jacobians if what == "jacobian" else dynamics

    def parallel(self, what: str, q: Array, v: Array, x: Array) -> Callable[[], Array]:
        """Return a function that evaluates N states in one call of Pinocchio's, on one thread.

        It returns the answers (n, N), in Pinocchio's order of joints.

        Args:
            what: "rnea" (x: accelerations) or "aba" (x: torques).
            q: angles, shape (n, N); laid out beforehand as Pinocchio reads them.
            v: rates, likewise.
            x: accelerations or torques, likewise.
        """
        one_of("what", what, ("rnea", "aba"))
        compute = getattr(self._library, f"{what}InParallel")
        pool = self._library.ModelPool(self.model, 1)
        # Column-major, as Eigen reads it: no copy is made inside the timed call.
        states = [np.asfortranarray(state[self.order]) for state in (q, v, x)]
        result = np.empty_like(states[0])

        def run() -> Array:
            compute(1, pool, *states, result)
            return result

        return run

    def follow(self, motion: Array, kp: Array, kd: Array, dt: float) -> Callable[[], Array]:
        """Return a loop of computed torque with half-sample preview, by `rnea`, RK4 by `aba`.

        Arguments and what comes back are those of `oracles.mujoco.chain.follow`; an arm whose order
        of joints is Pinocchio's.
        """
        rnea, aba = self._library.rnea, self._library.aba
        model, data, damping, half = self.model, self.data, self._damping, 0.5 * dt
        # The references are half a sample ahead of the state: the start goes back by that.
        q0 = motion[0, :, 0] - half * motion[1, :, 0] + 0.5 * half**2 * motion[2, :, 0]
        start = q0, motion[1, :, 0] - half * motion[2, :, 0]

        def move(q: Array, v: Array, tau: Array) -> Array:
            return np.asarray(aba(model, data, q, v, tau - damping * v))

        def run() -> Array:
            places = np.empty((motion.shape[2] + 1, len(q0)))
            places[0], v = start
            q = places[0]
            for k in range(motion.shape[2]):
                desired, rate, a = motion[:, :, k]
                ahead, fast = q + half * v + 0.5 * half**2 * a, v + half * a
                a = a + kp * (desired - ahead) + kd * (rate - fast)
                # rnea has no damping, so the joints' friction is added to its torque.
                tau = rnea(model, data, ahead, fast, a) + damping * fast
                # Classical RK4 with the torque held over the step.
                a1 = move(q, v, tau)
                s2 = v + half * a1
                a2 = move(q + half * v, s2, tau)
                s3 = v + half * a2
                a3 = move(q + half * s2, s3, tau)
                s4 = v + dt * a3
                a4 = move(q + dt * s3, s4, tau)
                q = q + dt / 6.0 * (v + 2.0 * s2 + 2.0 * s3 + s4)
                v = v + dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
                places[k + 1] = q
            return places

        return run

    def marquardt_ik(
        self,
        target: Array,
        starts: Array,
        limits: tuple[Array, Array],
        damping: float = 0.1,
        at_most: int = 100,
        tolerance: float = 1e-6,
    ) -> tuple[Array, bool, int]:
        """Return the result of the course's own method, Levenberg-Marquardt, in Python.

        Pinocchio's calls give pose and Jacobian, NumPy solves the equations. Steps, limits and
        ends are those of `course.kinematics.ik`, so what is left between the two is the language.

        Args:
            target: pose of the tip, shape (7,).
            starts: shape (S, n), tried one after the other.
            limits: lower and upper, shape (n,) each.
            damping: the first lambda.
            at_most: steps from each start.
            tolerance: distance and angle that count as there [m, rad].

        Returns:
            The last posture, whether its tip is there, and the steps of all starts.
        """
        library, model, data = self._library, self.model, self.data
        goal = library.SE3(library.Quaternion(*target[3:]).matrix(), target[:3])
        low, high = (limit[self.order] for limit in limits)
        axes, steps = library.LOCAL_WORLD_ALIGNED, 0

        def miss(q: Array) -> Array:
            library.framesForwardKinematics(model, data, q)
            here = data.oMf[self._tip]
            turn = library.log3(goal.rotation @ here.rotation.T)
            return np.concatenate([goal.translation - here.translation, turn])

        for start in starts:
            q = np.clip(start[self.order], low, high)
            e, mu, slow, fresh = miss(q), damping**2, 0, True
            for _ in range(at_most):
                if max(np.linalg.norm(e[:3]), np.linalg.norm(e[3:])) <= tolerance:
                    return q[self._back], True, steps
                if fresh:
                    J = library.computeFrameJacobian(model, data, q, self._tip, axes)
                    pull = J.T @ e
                    J = J * ~((q <= low) & (pull < 0.0) | (q >= high) & (pull > 0.0))
                trial = np.clip(q + J.T @ np.linalg.solve(J @ J.T + mu * np.eye(6), e), low, high)
                steps += 1
                if not np.abs(trial - q).max() > 1e-13:
                    break
                new = miss(trial)
                slow = 0 if new @ new < 0.9 * (e @ e) else slow + 1
                fresh = bool(new @ new < e @ e)
                if fresh:
                    q, e, mu = trial, new, 0.1 * mu
                else:
                    mu *= 8.0
                if slow > 6:
                    break
            if max(np.linalg.norm(e[:3]), np.linalg.norm(e[3:])) <= tolerance:
                return q[self._back], True, steps
        return q[self._back], False, steps

    def usual_ik(
        self,
        target: Array,
        starts: Array,
        limits: tuple[Array, Array] | None = None,
        rate: float = 0.1,
        at_most: int = 1000,
        tolerance: float = 1e-6,
    ) -> tuple[Array, bool, int]:
        """Return the result of the inverse-kinematics loop that Pinocchio's users write.

        Each iteration takes a share of the damped step for the logarithm of the pose error.

        As in the example of its documentation (Inverse kinematics, clik): damping 1e-12, a tenth of
        every step, a thousand steps.

        Args:
            target: pose of the tip, shape (7,).
            starts: shape (S, n), tried one after the other.
            limits: lower and upper, to which each step is clamped; None as in the example.
            rate: share of a step.
            at_most: steps from each start.
            tolerance: distance and angle that count as there [m, rad].

        Returns:
            The last posture, whether its tip is there, and the steps of all starts.
        """
        library, model, data = self._library, self.model, self.data
        goal = library.SE3(library.Quaternion(*target[3:]).matrix(), target[:3])
        steps, q = 0, starts[0]
        for start in starts:
            q = start[self.order].copy()
            for _ in range(at_most):
                library.framesForwardKinematics(model, data, q)
                remaining = data.oMf[self._tip].actInv(goal)
                error = library.log6(remaining).vector
                if max(np.linalg.norm(error[:3]), np.linalg.norm(error[3:])) < tolerance:
                    return q[self._back], True, steps
                J = library.computeFrameJacobian(model, data, q, self._tip)
                # Jlog6 is the derivative of the pose error's logarithm, so the step is Gauss-Newton
                # on SE(3).
                J = -library.Jlog6(remaining.inverse()) @ J
                q = q - rate * J.T @ np.linalg.solve(J @ J.T + 1e-12 * np.eye(6), error)
                if limits is not None:
                    q = np.clip(q, limits[0][self.order], limits[1][self.order])
                steps += 1
        return q[self._back], False, steps
