"""One arm beside Pinocchio and MuJoCo: the largest differences, for few arms or for a thousand."""

import mujoco
import numpy as np

from course import kinematics
from course.kinematics import Chain
from course.oracles.mujoco import chain as mujoco_chain
from course.oracles.pinocchio import Arm
from tests.kinematics.arms import relative, states


def poses_apart(a, b) -> float:
    """Largest difference of poses, where q and -q are one rotation."""
    sign = np.sign(np.sum(a[3:] * b[3:], axis=0))
    return float(np.abs(a - np.concatenate([b[:3], sign * b[3:]])).max())


def beside_pinocchio(chain: Chain, rng: np.random.Generator) -> dict[str, float]:
    """Frames, Jacobians and dynamics; absolute for the first three, relative for the others."""
    q, v, a = states(chain, rng)
    arm = Arm(chain)
    mine = np.column_stack([kinematics.frames(chain, q), kinematics.tip(chain, q)])
    J, rate = arm.jacobians(q, v)
    tau = arm.inverse_dynamics(q, v, a)
    return {
        "frames": poses_apart(arm.frames(q), mine),
        "jacobian": float(np.abs(kinematics.jacobian(chain, q) - J).max()),
        "rate": float(np.abs(kinematics.jacobian_rate(chain, q, v) - rate).max()),
        "rnea": relative(kinematics.inverse_dynamics(chain, q, v, a), tau),
        "crba": relative(kinematics.mass_matrix(chain, q), arm.mass_matrix(q)),
        "aba": relative(
            kinematics.forward_dynamics(chain, q, v, tau), arm.forward_dynamics(q, v, tau)
        ),
    }


def beside_mujoco(chain: Chain, rng: np.random.Generator) -> dict[str, float]:
    """Positions, mass matrix and inverse dynamics in MuJoCo's model of the arm."""
    q, v, a = states(chain, rng)
    model = mujoco_chain.model(chain)
    data, at = mujoco.MjData(model), mujoco_chain.addresses(model, chain)
    data.qpos[at], data.qvel[at], data.qacc[at] = q, v, a
    mujoco.mj_inverse(model, data)
    M = np.zeros((chain.n, chain.n))
    mujoco.mj_fullM(model, data, M)
    links = [model.body(f"link {i}").id for i in range(chain.n)]
    frames = np.concatenate([data.xpos[links].T, data.xquat[links].T])
    return {
        "frames": poses_apart(frames, kinematics.frames(chain, q)),
        "tip": float(np.abs(data.site("tip").xpos - kinematics.tip(chain, q)[:3]).max()),
        "fullM": relative(kinematics.mass_matrix(chain, q), M[np.ix_(at, at)]),
        "inverse": relative(kinematics.inverse_dynamics(chain, q, v, a), data.qfrc_inverse[at]),
    }


# Absolute, in metres and radians, and relative; they grow with the arm: 30 joints reach 15 m.
EXACT = {"frames": 1e-12, "tip": 1e-12, "jacobian": 1e-12, "rate": 1e-12}
ROUNDED = 1e-10


def too_far(result: dict[str, float], scale: float) -> dict[str, float]:
    """What exceeds its tolerance."""
    return {
        name: value
        for name, value in result.items()
        if not value <= (EXACT[name] * scale if name in EXACT else ROUNDED)
    }
