"""Chapter 6: control. Limits that are computed before they are tuned, and what a simulator hides.

The public names of the chapter; each lives in the file of its section.

The chapter's algorithms, and the functions of their steps:

- LQR by structure-preserving doubling (Chu, Fan, Lin and Wang, 2004): `optimal._regulate`; `_gain`
  is the regulator's gain.
- Projected Newton for box-constrained programs (Bertsekas, 1982): `optimal._box`, with `_newton` on
  the free coordinates; `horizon` condenses the model predictive problem.
- Model predictive path integral control (Williams, Aldrich and Theodorou, 2017) and the
  cross-entropy method (Rubinstein, 1999): `sampling.mppi`, `cem`; `_tries` samples the plans.
- Adaptive control (Slotine and Li, 1987): `laws.Adaptive.parts`.
- Operational space and hybrid control (Khatib, 1987; Raibert and Craig, 1981): `laws.hybrid`.
- PID with anti-windup (Astrom and Hagglund, 2006): `pid._update`, its rate in `_advance_rate`.
- Cascade, notch, disturbance observer and delay predictor (Smith, 1957): `structures`.
- The cures of an adaptive law (Ioannou and Sun, 1996): `adaptive.adapted`.

Examples:
    >>> from course import control
    >>> regulator = control.lqr([[1.0]], [[1.0]], [[1.0]], [[1.0]])  # x' = x + u, both cost 1
    >>> print(regulator.P.round(4))  # of this scalar the golden ratio
    [[1.618]]
"""

from course.control.identify import JointModel, Log, diagnose, identify
from course.control.joint import (
    Actuator,
    Encoder,
    Joint,
    Record,
    StepMetrics,
    run_joint,
    step_metrics,
)
from course.control.laws import (
    Adaptive,
    admittance,
    computed_torque,
    feedforward,
    friction_compensation,
    hybrid,
    impedance,
    operational_space,
    pd,
    pd_gravity,
)
from course.control.optimal import box_qp, horizon, lqr, mpc
from course.control.pid import Controller, Gains
from course.control.residual import Learned, learn
from course.control.sampled import (
    Margins,
    growth,
    held,
    joint_system,
    loop_matrix,
    margins,
    pid_law,
    ultimate_gain,
)
from course.control.sampling import cem, mppi, predictive
from course.control.touch import Probe, TouchLaw, run_touch
from course.control.tracking import JointLaw, rollouts, track
from course.drills import PID, ExactJoint, closed_loop

__all__ = [
    "PID",
    "Actuator",
    "Adaptive",
    "Controller",
    "Encoder",
    "ExactJoint",
    "Gains",
    "Joint",
    "JointLaw",
    "JointModel",
    "Learned",
    "Log",
    "Margins",
    "Probe",
    "Record",
    "StepMetrics",
    "TouchLaw",
    "admittance",
    "box_qp",
    "cem",
    "closed_loop",
    "computed_torque",
    "diagnose",
    "feedforward",
    "friction_compensation",
    "growth",
    "held",
    "horizon",
    "hybrid",
    "identify",
    "impedance",
    "joint_system",
    "learn",
    "loop_matrix",
    "lqr",
    "margins",
    "mpc",
    "mppi",
    "operational_space",
    "pd",
    "pd_gravity",
    "pid_law",
    "predictive",
    "rollouts",
    "run_joint",
    "run_touch",
    "step_metrics",
    "track",
    "ultimate_gain",
    "warm",
]


def warm() -> None:
    """Compile, or load from the cache, everything in this chapter that is compiled."""
    import numpy as np

    from course.control import frequency
    from course.control.pid import advance_rate
    from course.control.sampled import crossings
    from course.kinematics import TwoLink

    Controller(Gains(1.0), 1e-3).update(0.0, 0.0)
    run_joint(Joint(1.0), Actuator(), Encoder(), Gains(1.0), 1.0, 1e-3, 1e-2)
    run_touch(Probe(), TouchLaw(), 0.0, 1e-3, 1e-2)
    arm = TwoLink()
    track(arm, JointLaw("pd", arm, 1.0, 1.0), lambda t: np.zeros((3, 2, t.size)), 1e-3, 1e-3)
    rollouts(arm, np.zeros((1, 1, 2)), 1e-3, (np.zeros(2), np.zeros(2)))
    lqr(np.eye(1), np.eye(1), np.eye(1), np.eye(1))
    advance_rate(0.0, 0.0, 1e-3, np.zeros(5), 0.0, 0.0)
    plant, law = held(*joint_system(1.0), 0.1), pid_law(1.0, 0.0, 1.0, dt=0.1)
    crossings(plant, law)
    frequency.response(plant, law)
    frequency.loop_shape(plant, law)
    box_qp(np.eye(1), np.zeros(1), 0.0, 1.0)
