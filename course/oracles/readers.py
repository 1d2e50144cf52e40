"""What five readers of models do with the faulty URDF texts of chapter 3.

Some readers end the process that asks them, so each model is read in a process of its own, forked
from one that has imported the reader (`python -m course.oracles.readers NAME` prints the answers).
"""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from course.check import one_of
from course.oracles import drake as drake_oracle
from course.oracles import pinocchio as pinocchio_oracle
from course.oracles import pybullet as pybullet_oracle
from course.oracles.mujoco.kit import library as mujoco_library
from course.oracles.quiet import quiet
from course.platforms.models import GOOD, MODELS, Reading

# What a reader reports, by body or joint: masses [kg], principal moments [kg m^2], places (the
# position in the parent [m]), axes, limits [rad], damping, friction; dof (the count of joints) and
# mimic (whether one joint follows another).
Facts = dict[str, Any]


def _ours(text: str) -> Facts:
    """Return what chapter 4's reader reads in a model, in the keys of `Facts`."""
    from course.oracles.mujoco.chain import read

    chain = read(text)
    return {
        "masses": chain.mass.tolist(),
        "moments": np.linalg.eigvalsh(chain.inertia.transpose(2, 0, 1)).tolist(),
        "places": chain.placement.T.tolist(),
        "axes": [],
        "limits": list(zip(chain.lower.tolist(), chain.upper.tolist(), strict=True)),
        "damping": chain.damping.tolist(),
        "friction": [],
        "dof": chain.n,
        "mimic": False,
    }


def _mujoco(text: str) -> Facts:
    """Return what MuJoCo reads in a model, in the keys of `Facts`."""
    mujoco = mujoco_library()
    mujoco.set_mju_user_warning(print)  # its log may be switched off, its warnings are not
    model = mujoco.MjModel.from_xml_string(text)
    limited = model.jnt_limited.astype(bool)
    limits = np.where(limited[:, None], model.jnt_range, [-np.inf, np.inf])
    return {
        "masses": model.body_mass[1:].tolist(),
        "moments": model.body_inertia[1:].tolist(),
        "places": model.body_pos[1:].tolist(),
        "axes": model.jnt_axis.tolist(),
        "limits": limits.tolist(),
        "damping": model.dof_damping.tolist(),
        "friction": model.dof_frictionloss.tolist(),
        "dof": model.nv,
        "mimic": model.neq > 0,
    }


def _pinocchio(text: str) -> Facts:
    import pinocchio

    model = pinocchio.buildModelFromXML(text)
    moving = list(model.inertias)[1:]
    return {
        "masses": [body.mass for body in moving],
        "moments": [np.linalg.eigvalsh(body.inertia).tolist() for body in moving],
        "places": [place.translation.tolist() for place in list(model.jointPlacements)[1:]],
        "axes": [_probe(pinocchio, model)],
        "limits": np.column_stack([model.lowerPositionLimit, model.upperPositionLimit]).tolist(),
        "damping": model.damping.tolist(),
        "friction": model.upperDryFrictionLimit.tolist(),
        "dof": model.nv,
        "mimic": any("Mimic" in joint.shortname() for joint in model.joints),
    }


def _probe(pinocchio: Any, model: Any) -> list[float]:
    """Return 1, or not a number if an axis cannot be normalised.

    Then the accelerations are none.
    """
    q, still = pinocchio.neutral(model), np.zeros(model.nv)
    # An axis that cannot be normalised makes the accelerations NaN.
    result = pinocchio.aba(model, model.createData(), q, still, still)
    return [1.0 + 0.0 * float(np.sum(result))]


def _drake(text: str) -> Facts:
    pydrake = drake_oracle.library()
    plant = pydrake.multibody.plant.MultibodyPlant(1e-3)
    (arm,) = pydrake.multibody.parsing.Parser(plant).AddModelsFromString(text, "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    bodies = [plant.get_body(i) for i in plant.GetBodyIndices(arm)]
    bodies = [body for body in bodies if body.name() != "base"]
    result = [body.CalcSpatialInertiaInBodyFrame(context) for body in bodies]
    joints = [plant.get_joint(i) for i in plant.GetJointIndices(arm)]
    moments = [
        # Drake's inertias are about the body's origin; moments are compared about the centre of
        # mass.
        i.Shift(i.get_com()).get_unit_inertia().CalcPrincipalMomentsOfInertia() * i.get_mass()
        for i in result
    ]
    low, high = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    return {
        "masses": [i.get_mass() for i in result],
        "moments": [m.tolist() for m in moments],
        "places": [
            j.frame_on_parent().GetFixedPoseInBodyFrame().translation().tolist() for j in joints
        ],
        "axes": [j.revolute_axis().tolist() for j in joints if j.type_name() == "revolute"],
        "limits": np.column_stack([low, high]).tolist(),
        "damping": [x for j in joints for x in np.ravel(j.default_damping_vector()).tolist()],
        "friction": [],
        "dof": plant.num_velocities(),
        "mimic": plant.num_constraints() > 0,
    }


def _pybullet(text: str) -> Facts:
    lib = pybullet_oracle.library()
    client = lib.connect(lib.DIRECT)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "model.urdf")
        path.write_text(text, encoding="utf-8")
        flags = lib.URDF_USE_INERTIA_FROM_FILE
        arm = lib.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
    links = range(lib.getNumJoints(arm, client))
    joints = [lib.getJointInfo(arm, i, client) for i in links]
    bodies = [lib.getDynamicsInfo(arm, i, client) for i in links]
    return {
        "masses": [body[0] for body in bodies],
        "moments": [body[2] for body in bodies],
        "places": [joint[14] for joint in joints],
        "axes": [joint[13] for joint in joints],
        "limits": [joint[8:10] for joint in joints],
        "damping": [joint[6] for joint in joints],
        "friction": [],  # it tells that of the file, and does nothing with it
        "dof": sum(
            {lib.JOINT_FIXED: 0, lib.JOINT_SPHERICAL: 3, lib.JOINT_PLANAR: 3}.get(joint[2], 1)
            for joint in joints
        ),
        "mimic": False,
    }


READERS: dict[str, tuple[Callable[[], Any], Callable[[str], Facts]]] = {
    "chapter 4": (mujoco_library, _ours),
    "Pinocchio": (pinocchio_oracle._pinocchio, _pinocchio),
    "MuJoCo": (mujoco_library, _mujoco),
    "Drake": (drake_oracle.library, _drake),
    "PyBullet": (pybullet_oracle.library, _pybullet),
}


def _alone(read: Callable[[str], Facts], text: str) -> Reading:
    """Return a text read in a forked process, with all that is printed there."""
    with tempfile.TemporaryFile("w+") as answer:
        # A crash of the reader ends the child only; an empty answer is the sign of it.
        child = os.fork()
        if not child:
            try:
                result: dict[str, Any] = {}
                with quiet() as message:
                    try:
                        result["facts"] = read(text)
                    except (Exception, SystemExit) as error:  # Drake ends the script for some
                        result["rejection"] = f"{type(error).__name__}: {error}"
                json.dump({**result, "messages": message[0].strip()}, answer)
                answer.flush()
            finally:
                os._exit(0)
        os.waitpid(child, 0)
        answer.seek(0)
        words = answer.read()
    return Reading(**json.loads(words)) if words else Reading(crashed=True)


def _all(name: str) -> dict[str, Reading]:
    find, read = READERS[name]
    find()
    logging.basicConfig(format="%(message)s")
    usual = _alone(read, GOOD)
    result = {"sound": usual}
    for model in MODELS:
        reading = _alone(read, model.text)
        # What the reader prints about the sound model as well is no warning.
        new = "" if reading.messages == usual.messages else reading.messages
        result[model.name] = Reading(reading.rejection, reading.crashed, new, reading.facts)
    return result


def readings(reader: str) -> dict[str, Reading]:
    """Return what a reader did with every model, by the model's name.

    The unchanged model is included as "sound".

    Args:
        reader: one of `READERS`.

    Raises:
        ImportError: it is not installed.
    """
    find, _ = READERS[one_of("reader", reader, READERS)]
    find()
    done = subprocess.run(
        [sys.executable, "-m", "course.oracles.readers", reader],
        capture_output=True,
        text=True,
        check=True,
    )
    rows = json.loads(done.stdout.splitlines()[-1])
    return {name: Reading(**row) for name, row in rows.items()}


if __name__ == "__main__":
    print(json.dumps({name: asdict(reading) for name, reading in _all(sys.argv[1]).items()}))
