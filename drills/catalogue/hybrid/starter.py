import numpy as np


def hybrid_torque(J, frame, forced, error, velocity, force, wanted, gains):
    """Return joint torques that press along some axes of a surface and move along the others.

    Args:
        J: Jacobian of the tip, velocity in the world by joint rates, shape (3, n).
        frame: axes of the surface in the world, as columns, shape (3, 3).
        forced: of each of these axes, 1 where a force is wanted, 0 where a place is, shape (3,).
        error: goal less place of the tip, in the world, shape (3,) [m].
        velocity: of the tip, in the world, shape (3,) [m/s].
        force: that the tip exerts, measured, in the world, shape (3,) [N].
        wanted: force that the tip shall exert, along the axes of the surface, shape (3,) [N].
        gains: stiffness [N/m], damping [N s/m] and force gain [1].

    Returns:
        Torques at the joints, shape (n,) [N m].
    """
    # Impedance along all axes: no force is controlled.
    return np.asarray(J).T @ (gains[0] * np.asarray(error) - gains[1] * np.asarray(velocity))
