"""MuJoCo as the plant of a sampled controller: a hinge, a motor, and what can go wrong with both.

The same joint as `course.drills.ExactJoint`, which solves it exactly, so that two answers differ by
MuJoCo's stepping alone; and with what that joint leaves out: dry friction, and a jam that gives way
as a constraint does.
"""

from __future__ import annotations

from course.check import count, finite, positive
from course.oracles.mujoco.kit import library, scene_xml

_STIFF = "0.9999 0.9999 0.001"  # the largest impedance that MuJoCo takes, at any depth


class MotorJoint:
    """A hinge about a vertical axis, driven by a motor that holds each command for one sample.

    The loop is the caller's: hand in a command, get the angle at the next sample. Gravity, contacts
    and sensors are off; a motor of gear 1 without limits makes the command the torque.

    Attributes:
        dt: sample time [s].
        substeps: MuJoCo steps in a sample.
        model, data: MuJoCo's own.
    """

    def __init__(
        self,
        inertia: float,
        damping: float,
        dt: float,
        load: float = 0.0,
        *,
        substeps: int = 10,
        friction: float = 0.0,
        integrator: str = "implicitfast",
        actuator: str = "<motor {}/>",
        defaults: bool = False,
    ) -> None:
        """Create a joint at rest at angle 0.

        Args:
            inertia: about the axis [kg m^2].
            damping: [N m s/rad].
            dt: sample time [s].
            load: constant torque that acts beside the motor's [N m].
            substeps: MuJoCo steps in a sample.
            friction: dry friction [N m]: as much torque as it takes to start, and lost on the way.
            integrator: one of `MUJOCO_INTEGRATORS`.
            actuator: MuJoCo's element for the drive, with {} where the joint's name goes; of a
                servo, such as "<position kp='30' {}/>", the command is the set-point.
            defaults: dry friction with MuJoCo's default impedance, else with the largest.

        Raises:
            ValueError: for an argument out of its range.
        """
        finite("damping", damping, 0.0, unit="N m s/rad")
        finite("friction", friction, 0.0, unit="N m")
        finite("load", load, unit="N m")
        positive("inertia", inertia, unit="kg m^2")
        count("substeps", substeps, 1)
        mujoco = library()
        self.dt, self.substeps = positive("dt", dt, unit="s"), substeps
        step = dt / substeps
        stiff = f'solref="{2.0 * step:.17g} 1" solimp="{_STIFF}"'
        hard = "" if defaults else f'solimpfriction="{_STIFF}"'
        moments = " ".join([f"{inertia:.17g}"] * 3)
        body = (
            f'<body><joint name="hinge" type="hinge" axis="0 0 1" damping="{damping:.17g}" '
            f'frictionloss="{friction:.17g}" {hard}/>'
            f'<inertial pos="0 0 0" mass="1" diaginertia="{moments}"/></body>'
        )
        extra = (
            "<actuator>" + actuator.replace("{}", 'joint="hinge"') + "</actuator>"
            f'<equality><joint joint1="hinge" active="false" {stiff}/></equality>'
        )
        xml = scene_xml(body, step, integrator, 0.0, springs=True, touching=True, extra=extra)
        self.model = mujoco.MjModel.from_xml_string(xml)
        # Every scene of chapter 1 has motors off; this one is about its motor.
        self.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        self.data = mujoco.MjData(self.model)
        self._step, self._fresh = mujoco.mj_step, mujoco.mj_resetData
        self._load = load
        self.reset()

    @property
    def q(self) -> float:
        """The angle [rad]."""
        return float(self.data.qpos[0])

    @property
    def v(self) -> float:
        """The speed [rad/s]."""
        return float(self.data.qvel[0])

    def reset(self, q: float = 0.0, v: float = 0.0) -> None:
        """Put the joint at an angle [rad] with a speed [rad/s], free."""
        data = self.data
        self._fresh(self.model, data)
        data.qpos[0], data.qvel[0], data.qfrc_applied[0] = q, v, self._load

    def step(self, command: float, blocked: bool = False) -> float:
        """Hold a torque for one sample.

        Args:
            command: the motor's torque [N m].
            blocked: whether the joint is jammed for this sample. A stiff constraint catches it
                where it is when the jam begins.

        Returns:
            The angle after the sample [rad].
        """
        data = self.data
        if blocked and not data.eq_active[0]:
            self.model.eq_data[0, 0] = data.qpos[0]
        data.eq_active[0] = blocked
        data.ctrl[0] = command
        self._step(self.model, data, self.substeps)
        return float(data.qpos[0])
