"""MuJoCo's own identification, `mujoco.sysid`, asked for the flat two-link arm.

Trap one: with plain MuJoCo `import mujoco.sysid` succeeds and is empty; the packages that it wants
are in the extra `oracles`. Trap two: `mj_step` leaves in `sensordata` the readings of the state
before the step, and `mujoco.sysid` stamps them with the time after it. A log whose angles carry
their own times then looks one step early; `observe="state"` compares with the state instead.
"""

from __future__ import annotations

import contextlib
import importlib
import io
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from course.check import count, one_of
from course.kinematics import TwoLink
from course.libraries import import_error
from course.oracles.mujoco.kit import ALWAYS_OFF, CONTACT_OFF, library
from course.sim_to_real.identify import BASE, Log

Array = NDArray[np.float64]
OBSERVE = ("state", "sensor")


class Fitted(NamedTuple):
    """What came out, in the order of `BASE`.

    Attributes:
        value, half_width: of the interval that MuJoCo says holds 95 %, shape (5,).
        residual: root mean square of measured minus simulated [rad], weighed for "sensor".
    """

    value: Array
    half_width: Array
    residual: float


def toolbox() -> Any:
    """Return the module `mujoco.sysid`; ImportError says what to install where it is empty."""
    library()
    # By its name only: this part of MuJoCo has types, and they would hide the rest from Pyrefly.
    sysid = importlib.import_module("mujoco.sysid")
    if not hasattr(sysid, "optimize"):
        install = "pip install 'absl-py>=2.3' 'colorama>=0.4.6' 'tabulate>=0.9'"
        cause: ImportError = ModuleNotFoundError("without them mujoco.sysid is an empty module")
        try:
            # The package swallows the error that left it empty; its last module still raises it.
            importlib.import_module("mujoco.sysid.report.defaults")
        except ImportError as error:
            cause = error
        raise import_error("mujoco.sysid", install, cause) from cause
    return sysid


def _spec(arm: TwoLink, dt: float) -> Any:
    """Return two hinges with motors and sensors; masses and damping are set at each compilation."""
    l1, l2 = arm.lengths
    deviation = " ".join(
        f'{f}="disable"' for f in (*ALWAYS_OFF, *CONTACT_OFF) if f not in ("actuation", "sensor")
    )
    sensors, motors = (
        "".join(f'<{kind} name="{kind}{i}" joint="joint{i}"/>' for i in (1, 2))
        for kind in ("jointpos", "motor")
    )
    return library().MjSpec.from_string(
        f'<mujoco><option timestep="{dt:.17g}" integrator="RK4" gravity="0 0 0"><flag {deviation}/>'
        '</option><worldbody><body name="link1">'
        '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        f'<joint name="joint1" axis="0 0 1"/><body name="link2" pos="{l1:.17g} 0 0">'
        f'<inertial pos="{0.5 * l2:.17g} 0 0" mass="1" diaginertia="1 1 1"/>'
        '<joint name="joint2" axis="0 0 1"/></body></body></worldbody>'
        f"<actuator>{motors}</actuator><sensor>{sensors}</sensor></mujoco>"
    )


def prepared(
    arm: TwoLink, log: Log, start: Mapping[str, float], *, observe: str = "state", threads: int = 1
) -> Callable[[], Fitted]:
    """Return a function that fits the five numbers of `BASE` to a log of angles, from rest at 0.

    MuJoCo moves what keeps every model on the way a real one: a first link's inertia, mass and
    inertia of the second, both dampings. `BASE` is linear in them.

    Args:
        arm: only its lengths are read.
        log: as for `course.sim_to_real.fit`.
        start: as for `course.sim_to_real.fit`.
        observe: "state" compares angles with the state, all alike; "sensor" with `sensordata` as
            the toolbox stamps and weighs it.
        threads: that MuJoCo may use.
    """
    sysid = toolbox()
    one_of("observe", observe, OBSERVE)
    l1, l2 = arm.lengths
    # The arm shows only five combinations of its masses and inertias; `into` is that linear map.
    # Of (inertia 1, mass 2, inertia 2, damping 1, damping 2) into (a, b, d, c1, c2).
    into = np.eye(5)
    into[0, 1:3] = l1 * l1 + 0.25 * l2 * l2, 1.0
    into[1, 1], into[2, 1], into[2, 2] = 0.5 * l1 * l2, 0.25 * l2 * l2, 1.0
    first = np.linalg.solve(into, [start[name] for name in BASE])
    spec = _spec(arm, log.dt)
    model = spec.compile()
    joints, bodies = (
        [find(f"{name}{i}") for i in (1, 2)]
        for find, name in ((spec.joint, "joint"), (spec.body, "link"))
    )

    def build(params: Any, spec: Any) -> Any:
        i1, m2, i2, *damping = params.as_vector()
        bodies[0].inertia, bodies[1].inertia, bodies[1].mass = [i1] * 3, [i2] * 3, m2
        for joint, c in zip(joints, damping, strict=True):
            joint.damping = [c, *np.zeros(len(np.atleast_1d(joint.damping)) - 1)]
        return spec.compile()

    def against_state(params: Any, predicted: Any, measured: Any, *_: Any, state: Array) -> Any:
        late = sysid.TimeSeries(measured.times[1:], measured.data[1:], predicted.signal_mapping)
        return late.data - state[:, 1:3], late, late

    # The toolbox drops the last command.
    sent = sysid.TimeSeries(log.times, np.vstack([log.command.T, log.command.T[-1:]]))
    observed = sysid.TimeSeries.from_names(log.times, log.measured.T, model)
    at_rest = sysid.create_initial_state(model, np.zeros(2))
    sequence = sysid.ModelSequences("arm", spec, "log", at_rest, sent, observed)
    residual = sysid.build_residual_fn(
        models_sequences=[sequence],
        build_model=build,
        n_threads=count("threads", threads, 1),
        modify_residual=against_state if observe == "state" else None,
    )

    def run() -> Fitted:
        params = sysid.ParameterDict()
        params.add(sysid.Parameter("rods", first, np.full(5, 1e-4), np.full(5, 10.0)))
        with contextlib.redirect_stdout(io.StringIO()):  # it prints each step, asked or not
            best, result = sysid.optimize(params, residual, verbose=False)
        remaining = residual(best.as_vector(), best)[0]
        covariance, _ = sysid.calculate_intervals(remaining, result.jac)
        # Covariance of the combinations, from that of the toolbox's parameters.
        spread = np.sqrt(np.diag(into @ covariance @ into.T))
        size = float(np.sqrt(np.mean(np.square(remaining))))
        return Fitted(into @ best.as_vector(), 1.96 * spread, size)

    return run
