"""Drake asked for the scenes of chapter 3.

A discrete plant is stepped by `Simulator.AdvanceTo`, one call for all steps, in Drake's own loop;
so is a continuous one, with the integrator of the scheme at a fixed step. Scenes of joints are
parsed by Drake from their URDF text; bodies are boxes with a free joint, or on a rail.

Free bodies have their origin at their centre. The ground is a box of 1 m below z = 0, as is
recommended for contact by patches: a half space gives the same motion and a warning.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from types import ModuleType
from typing import Any

import numpy as np

from course.check import positive
from course.libraries import import_error
from course.platforms import FAIR, NO_CONTACTS, Change, ContactReport, Engine
from course.platforms.contract import Array, Run, Settings, State, reported
from course.platforms.scenes import Scene
from course.rigid_body.quaternion import conjugate, rotate, to_matrix

MODULUS = 1e6  # of the boxes [Pa]; one on the ground sinks by its pressure over this, of its half
_GROUND = 100.0  # side of the ground [m]
OPTIONS = ("approximation", "modulus", "accuracy")


def library() -> ModuleType:
    """Return the parts of Drake that are needed, as one module.

    Raises:
        ImportError: it is not installed; the message names the package.
    """
    try:
        for part in (
            "geometry",
            "math",
            "multibody.math",
            "multibody.parsing",
            "multibody.plant",
            "multibody.tree",
            "systems.analysis",
            "systems.framework",
        ):
            importlib.import_module(f"pydrake.{part}")
        return importlib.import_module("pydrake")
    except ImportError as error:
        install = "make platforms, or pip install 'drake>=1.51'"
        raise import_error("Drake", install, error) from error


class Drake(Engine):
    """Drake, of the Toyota Research Institute; https://drake.mit.edu.

    Its discrete plant is shipped with the contact approximation `lagged`, and stays so: with `sap`
    and `similar` a box that slides glides above the ground and hops (Castro et al. 2022, An
    unconstrained convex formulation of compliant contact, on the gliding of convex approximations).

    Options: `approximation` ("lagged", "sap", "similar"), `modulus` of the boxes [Pa], `accuracy`
    (of a continuous scheme, whose step is then chosen, at most dt).
    """

    name, package = "Drake", "drake"
    schemes = ("discrete", "runge_kutta2", "runge_kutta3", "runge_kutta5", "implicit_euler")
    changes = (
        Change(
            "hydroelastic",
            "proximity properties",
            "none: contact at a point",
            f"compliant boxes of {MODULUS:.0e} Pa on a rigid ground",
            "On a contact point, a box tips; so a patch (section 2). Its stiffness is our choice.",
            "Drake 1.51 (2026), Hydroelastic Contact User Guide",
            "bodies",
        ),
    )

    def missing(self) -> str:
        """Return why pydrake cannot be imported, or an empty text."""
        try:
            library()
        except ImportError as error:
            return str(error)
        return ""

    def build(self, scene: Scene, dt: float, settings: Settings = FAIR) -> DrakeRun:
        """Return a run of the scene in Drake."""
        return DrakeRun(self, scene, dt, settings)


class DrakeRun(Run):
    """A diagram of plant and geometry with its simulator.

    Attributes:
        plant, simulator, context: Drake's own; the context is the plant's.
    """

    def __init__(self, engine: Drake, scene: Scene, dt: float, settings: Settings) -> None:
        drake = library()
        self.scene, self.dt = scene, positive("dt", dt, unit="s")
        self._drake, self._settings = drake, settings
        scheme, options = settings.checked(engine, OPTIONS), settings.options
        discrete = scheme == "discrete"
        # A time step of 0 makes the plant continuous, for the error-controlled integrators.
        config = drake.multibody.plant.MultibodyPlantConfig(time_step=dt if discrete else 0.0)
        approximation = options.get("approximation", config.discrete_contact_approximation)
        config.discrete_contact_approximation = approximation
        builder = drake.systems.framework.DiagramBuilder()
        self.plant, _ = plant, _ = drake.multibody.plant.AddMultibodyPlant(config, builder)
        self._bodies: list[Any] = []
        if scene.urdf:
            drake.multibody.parsing.Parser(plant).AddModelsFromString(scene.urdf, "urdf")
            # The URDF's base is free unless it is welded to the world.
            plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
        self._numbers: dict[Any, int] = {}
        if scene.ground:
            self._shape(plant.world_body(), -1, (_GROUND, _GROUND, 1.0), (0.0, 0.0, -0.5))
        self._add_bodies()
        plant.mutable_gravity_field().set_gravity_vector(np.array(scene.gravity))
        plant.Finalize()
        joints = [plant.GetJointByName(name) for name in scene.joints]
        self._at = np.array([joint.position_start() for joint in joints], dtype=int)
        simulator = drake.systems.analysis.Simulator(builder.Build())
        if not discrete:
            desired = drake.systems.analysis.SimulatorConfig(
                integration_scheme=scheme,
                max_step_size=dt,
                accuracy=options.get("accuracy", 1e-4),
                use_error_control="accuracy" in options,
            )
            drake.systems.analysis.ApplySimulatorConfig(desired, simulator)
        self.simulator, self._steps = simulator, 0
        self.context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        self._push()
        self._start()
        # Saved before the first step, for `reset`.
        self._first = simulator.get_context().Clone()

    # --- building -----------------------------------------------------------------------------

    def _shape(
        self,
        body: Any,
        number: int,
        size: Sequence[float] | Array,
        place: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Add a box to a body; that of the ground, number -1, is rigid."""
        geometry, modulus = self._drake.geometry, self._settings.options.get("modulus", MODULUS)
        friction = self._drake.multibody.plant.CoulombFriction(*[self.scene.friction] * 2)
        result = geometry.ProximityProperties()
        geometry.AddContactMaterial(friction=friction, properties=result)
        if self._settings.applies("hydroelastic"):
            # A rigid ground and compliant boxes: patches need at least one compliant side.
            if number < 0:
                geometry.AddRigidHydroelasticProperties(resolution_hint=_GROUND, properties=result)
            else:
                geometry.AddCompliantHydroelasticProperties(1.0, modulus, result)
        at, box = self._drake.math.RigidTransform(np.array(place)), geometry.Box(*size)
        shape = self.plant.RegisterCollisionGeometry(body, at, box, f"box {number}", result)
        self._numbers[shape] = number

    def _add_bodies(self) -> None:
        plant, tree = self.plant, self._drake.multibody.tree
        for i, body in enumerate(self.scene.bodies):
            # Drake takes moments of inertia for a mass of 1.
            unit = tree.UnitInertia(*(np.array(body.moments) / body.mass))
            part = plant.AddRigidBody(body.name, tree.SpatialInertia(body.mass, np.zeros(3), unit))
            self._bodies.append(part)
            if body.half:
                self._shape(part, i, 2.0 * np.array(body.half))
            if body.guide:
                pose = np.array(body.pose)
                place, world = self._transform(pose), plant.world_frame()
                rail = plant.AddFrame(tree.FixedOffsetFrame(f"{body.name} rail", world, place))
                # The joint's axis is given in the rail's frame, the guide in the world's.
                axis = rotate(conjugate(pose[3:]), np.array(body.guide))
                slide = tree.PrismaticJoint(f"{body.name} slide", rail, part.body_frame(), axis)
                plant.AddJoint(slide)

    def _transform(self, pose: Array) -> Any:
        turn = self._drake.math.RotationMatrix(to_matrix(pose[3:]))
        return self._drake.math.RigidTransform(turn, pose[:3])

    def _push(self) -> None:
        """Apply the constant forces of the scene at the centres."""
        drake, pushes = self._drake, []
        for body, part in zip(self.scene.bodies, self._bodies, strict=True):
            if any(body.force):
                push = drake.multibody.plant.ExternallyAppliedSpatialForce()
                push.body_index, push.p_BoBq_B = part.index(), np.zeros(3)
                push.F_Bq_W = drake.multibody.math.SpatialForce(np.zeros(3), np.array(body.force))
                pushes.append(push)
        if pushes:
            port = self.plant.get_applied_spatial_force_input_port()
            port.FixValue(self.context, drake.common.value.AbstractValue.Make(pushes))

    def _start(self) -> None:
        start, plant, context = self.scene.start, self.plant, self.context
        if self.scene.urdf:
            q = np.zeros(plant.num_positions())
            q[self._at] = start.q
            plant.SetPositions(context, q)
        for body, part, pose in zip(self.scene.bodies, self._bodies, start.q.T, strict=False):
            if not body.guide:
                plant.SetFreeBodyPose(context, part, self._transform(pose))
        self.set_velocity(start.v)
        self.simulator.Initialize()

    # --- running ------------------------------------------------------------------------------

    def advance(self, steps: int) -> None:
        """Advance the simulator by this many steps of dt."""
        self._steps += steps
        # From the count of steps, so that rounding errors of the time do not add up.
        self.simulator.AdvanceTo(self._steps * self.dt)

    def state(self) -> State:
        """Return the state; the plant's order of joints is translated to the scene's."""
        plant, context = self.plant, self.context
        time = context.get_time()
        if self.scene.urdf:
            q, v = plant.GetPositions(context), plant.GetVelocities(context)
            return State(time, q[self._at], v[self._at])
        q, v = np.empty((7, len(self._bodies))), np.empty((6, len(self._bodies)))
        for i, part in enumerate(self._bodies):
            pose = plant.EvalBodyPoseInWorld(context, part)
            speed = plant.EvalBodySpatialVelocityInWorld(context, part)
            q[:3, i], q[3:, i] = pose.translation(), pose.rotation().ToQuaternion().wxyz()
            v[:3, i] = speed.translational()
            # Drake's angular velocity is in the world, the course's in the body.
            v[3:, i] = pose.rotation().matrix().T @ speed.rotational()
        return State(time, q, v)

    def energy(self) -> float:
        """Return kinetic plus potential energy [J], including the scene's constant forces."""
        plant, context = self.plant, self.context
        result = plant.CalcKineticEnergy(context) + plant.CalcPotentialEnergy(context)
        for body, part in zip(self.scene.bodies, self._bodies, strict=True):
            place = plant.EvalBodyPoseInWorld(context, part).translation()
            result -= float(np.dot(body.force, place))
        return float(result)

    def contacts(self) -> ContactReport:
        """Return point contacts and the resultants of hydroelastic patches."""
        if not self._steps or not self._numbers:
            return NO_CONTACTS
        plant, rows = self.plant, []
        results = plant.get_contact_results_output_port().Eval(self.context)
        for i in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(i)
            pair = info.point_pair()
            rows.append((pair.id_A, pair.id_B, info.contact_point(), info.contact_force()))
        for i in range(results.num_hydroelastic_contacts()):
            info = results.hydroelastic_contact_info(i)
            patch = info.contact_surface()
            # The force on A, the body of M, at the patch's centroid.
            force = -info.F_Ac_W().translational()
            rows.append((patch.id_M(), patch.id_N(), patch.centroid(), force))
        if not rows:
            return NO_CONTACTS
        query = plant.get_geometry_query_input_port().Eval(self.context)
        bodies = np.empty((2, len(rows)), dtype=np.int64)
        point, normal, force, gap = *np.empty((3, 3, len(rows))), np.empty(len(rows))
        for k, (first, second, place, push) in enumerate(rows):
            bodies[:, k] = self._numbers[first], self._numbers[second]
            # A patch has no gap: the signed distance of both shapes stands for it.
            near = query.ComputeSignedDistancePairClosestPoints(first, second)
            point[:, k], force[:, k], gap[k] = place, push, near.distance
            # Drake's gradient points from B into A.
            side = 1.0 if near.id_B == first else -1.0
            normal[:, k] = side * near.nhat_BA_W
        return reported(self.state(), bodies, point, normal, gap, force)

    def set_velocity(self, v: Array) -> None:
        """Set joint rates, or each body's velocity (linear in the world, angular in the body)."""
        plant, context = self.plant, self.context
        if self.scene.urdf:
            rates = np.zeros(plant.num_velocities())
            rates[self._at] = v
            plant.SetVelocities(context, rates)
        for body, part, w in zip(self.scene.bodies, self._bodies, v.T, strict=False):
            if body.guide:
                joint = plant.GetJointByName(f"{body.name} slide")
                joint.set_translation_rate(context, float(np.dot(body.guide, w[:3])))
            else:
                turn = plant.EvalBodyPoseInWorld(context, part).rotation().matrix()
                # The spatial velocity is expressed in the world: rotation first, then translation.
                speed = self._drake.multibody.math.SpatialVelocity(turn @ w[3:], w[:3])
                plant.SetFreeBodySpatialVelocity(context, part, speed)

    def set_torque(self, torque: Array) -> None:
        """Set the joint torques that act from now on."""
        result = np.zeros(self.plant.num_velocities())
        result[self._at] = torque
        self.plant.get_applied_generalized_force_input_port().FixValue(self.context, result)

    def reset(self) -> None:
        """Return to the state at time 0."""
        self.restore((self._first, 0))

    def save(self) -> Any:
        """Return a copy of the context and the number of steps, for `restore`."""
        return self.simulator.get_context().Clone(), self._steps

    def restore(self, saved: Any) -> None:
        """Continue from what `save` returned.

        The simulator is initialised again. An error-controlled integrator nevertheless starts with
        the step size that it reached last, so its continuation agrees only within its accuracy.
        """
        context, self._steps = saved
        self.simulator.get_mutable_context().SetTimeStateAndParametersFrom(context)
        # The integrator's step history does not belong to the context.
        self.simulator.Initialize()
