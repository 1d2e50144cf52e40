"""MuJoCo as a probe that touches a wall: a mass on a slide, and the wall as a spring or a contact.

A spring joint is the wall that course.control reasons about, stepped by MuJoCo. A contact is what a
model of a robot has instead. MuJoCo's constraint of impedance d makes the acceleration
(1 - d) (what it would be) + d (what the constraint wants) (documentation, Computation, Constraint
model), so that a contact of stiffness ke moves a mass m like m / (1 - d), and hands the fraction d
of the command straight on to the force.
"""

from __future__ import annotations

from course.check import count, finite, one_of, positive
from course.oracles.mujoco.kit import library, scene_xml


class Probe:
    """A mass on a horizontal slide, driven by a force, pressed on a wall at x = 0 (x < 0 is free).

    Attributes:
        dt: sample time [s].
        model, data: MuJoCo's own.
    """

    def __init__(
        self,
        mass: float,
        damping: float,
        stiffness: float,
        dt: float,
        *,
        wall: str = "spring",
        impedance: float = 0.9,
        substeps: int = 1,
        integrator: str = "implicitfast",
    ) -> None:
        """Create a probe at rest where it just touches.

        Args:
            mass: of the arm [kg].
            damping: of the arm [N s/m].
            stiffness: of the wall [N/m].
            dt: sample time [s].
            wall: "spring", which also pulls, or "contact", which does not.
            impedance: of the contact, above 0 and below 1, at any depth.
            substeps: MuJoCo steps in a sample.
            integrator: one of `MUJOCO_INTEGRATORS`.
        """
        count("substeps", substeps, 1)
        positive("mass", mass, unit="kg")
        finite("damping", damping, 0.0, unit="N s/m")
        positive("stiffness", stiffness, unit="N/m")
        finite("impedance", impedance, 1e-4, 0.9999)
        mujoco = library()
        self.dt, self._spring = dt, one_of("wall", wall, ("spring", "contact")) == "spring"
        self._stiffness, self._substeps = stiffness, substeps
        d = f"{impedance:.17g}"
        # So that at rest the depth is command / stiffness; what damps is the arm.
        share = stiffness * (1.0 - impedance) / mass
        contact = f'solref="{-share:.17g} 0" solimp="{d} {d} 0.001"'
        spring = f'stiffness="{stiffness:.17g}"' if self._spring else ""
        body = (
            f'<geom name="wall" type="plane" size="1 1 1" euler="0 -1.5707963267948966 0" '
            f'contype="0" conaffinity="0"/>'
            f'<body><joint name="slide" type="slide" axis="1 0 0" damping="{damping:.17g}" '
            f'{spring}/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>'
            # free across, as MuJoCo takes the mean over all directions for the mass that is met
            f'<geom name="tip" type="sphere" size="0.1" pos="-0.1 0 0" '
            f'mass="{mass:.17g}" contype="0" conaffinity="0"/></body>'
        )
        extra = '<actuator><motor joint="slide"/></actuator>'
        if not self._spring:
            extra += f'<contact><pair geom1="wall" geom2="tip" condim="1" {contact}/></contact>'
        xml = scene_xml(
            body, dt / substeps, integrator, 0.0, springs=True, touching=True, extra=extra
        )
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        self.data = mujoco.MjData(self.model)
        self._step, self._fresh = mujoco.mj_step, mujoco.mj_resetData
        self.reset()

    def reset(self, x: float = 0.0, v: float = 0.0) -> None:
        """Put it at a depth [m] with a speed [m/s]."""
        self._fresh(self.model, self.data)
        self.data.qpos[0], self.data.qvel[0] = x, v

    @property
    def x(self) -> float:
        """The depth, positive in the wall [m]."""
        return float(self.data.qpos[0])

    @property
    def v(self) -> float:
        """The speed into the wall [m/s]."""
        return float(self.data.qvel[0])

    @property
    def force(self) -> float:
        """The force on the wall [N], as a sensor reads it after the last step."""
        if self._spring:
            return self._stiffness * self.x
        return float(self.data.efc_force[0]) if self.data.nefc else 0.0

    def step(self, command: float) -> float:
        """Hold a force [N] for one sample; returns the force on the wall after it [N]."""
        self.data.ctrl[0] = command
        self._step(self.model, self.data, self._substeps)
        return self.force
