"""MuJoCo as the real arm of chapter 8: what its own simulator does not have.

Chapter 4's two links with motors that brake themselves (back-EMF), wind up a current, stick and
slip (LuGre's bristles) and turn a rotor of their own behind a backlash; commands and encoders come
late. Only logs and outcomes leave it: nothing in the course is tuned or fitted on its parameters.
`PLAIN` has none of this and is the arm that the simulator believes in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, one_of, positive, vector
from course.control import Controller, Gains
from course.oracles.mujoco.kit import MUJOCO_INTEGRATORS, library, scene_xml
from course.sim_to_real import Log, Outcome, Tasks
from course.sim_to_real.plants import ARM, DT, FILTER, HOLD, RADIUS, SECONDS, tip

Array = NDArray[np.float64]
Law = Callable[[int, Array], Array]


@dataclass(frozen=True)
class Hidden:
    """What nobody tells the simulator; joint 2 has half of the motor's numbers.

    Attributes:
        payload: at the tip [kg].
        emf: torque that a motor loses to its own speed [N m s/rad].
        lag: time constant of its current [s].
        coulomb, static: friction of LuGre's model in motion, and to start [N m].
        bristle: stiffness of its bristles [N m/rad]; 0 for no friction.
        armature: inertia of a rotor, at the joint [kg m^2].
        backlash: free play between rotor and link [rad].
        encoder: "motor" or "link", the side of the play that it is on.
        delay, sensing: of the command and of the encoder [s], whole steps.
        noise: of the encoder, standard deviation [rad].
    """

    payload: float = 0.5
    emf: float = 0.2
    lag: float = 0.003
    coulomb: float = 0.45
    static: float = 0.6
    bristle: float = 150.0
    armature: float = 0.03
    backlash: float = 0.006
    encoder: str = "motor"
    delay: float = 0.008
    sensing: float = 0.006
    noise: float = 0.001

    def __post_init__(self) -> None:
        one_of("encoder", self.encoder, ("motor", "link"))
        for name in self.__dataclass_fields__:
            if name != "encoder":
                finite(name, getattr(self, name), 0.0)
        if self.backlash and not self.armature:
            raise invalid("armature", self.armature, "a positive number with a backlash [kg m^2]")


PLAIN = Hidden(
    payload=0.0,
    emf=0.0,
    lag=0.0,
    coulomb=0.0,
    static=0.0,
    bristle=0.0,
    armature=0.0,
    backlash=0.0,
    delay=0.0,
    sensing=0.0,
    noise=0.0,
)


def _history(seconds: float, step: float) -> str:
    """Return attributes of a delay of whole steps.

    A quarter of one less, as rounding may add one.
    """
    n = round(seconds / step)
    return f'delay="{(n - 0.25) * step:.17g}" nsample="{n + 1}"' if n else ""


def _xml(hidden: Hidden, step: float, integrator: str) -> str:
    h, bodies, motors, sensors = hidden, "", "", ""
    for i, (m, length, inertia) in enumerate(
        zip(ARM.masses, ARM.lengths, ARM.inertias, strict=True)
    ):
        # The second motor is half as strong as the first.
        share, k = 1.0 / (i + 1), i + 1
        at = f'pos="{ARM.lengths[0] if i else 0.0} 0 0"'
        rotor = f'armature="{share * h.armature:.17g}"'
        damped = f'damping="{ARM.damping[i]:.17g}"'
        axis = 'type="hinge" axis="0 0 1"'
        # Backlash: a nearly massless body between motor and link, whose joint plays in its limits.
        if h.backlash:
            bodies += (
                f'<body {at}><joint name="motor{k}" {axis} {rotor} {damped}/>'
                '<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-6 1e-6 1e-6"/>'
                f'<body><joint name="play{k}" {axis} limited="true" '
                f'range="{-0.5 * h.backlash:.17g} {0.5 * h.backlash:.17g}" '
                f'solreflimit="{2.0 * step:.17g} 1" solimplimit="0.99 0.99 0.001"/>'
            )
        else:
            bodies += f'<body {at}><joint name="motor{k}" {axis} {rotor} {damped}/>'
        centre, mass, about = 0.5 * length, m, inertia
        if i and h.payload:
            mass = m + h.payload
            centre = (0.5 * m + h.payload) * length / mass
            # Steiner's theorem, for the common centre of link and payload.
            about += m * (0.5 * length - centre) ** 2 + h.payload * (length - centre) ** 2
        bodies += (
            f'<inertial pos="{centre:.17g} 0 0" mass="{mass:.17g}" '
            f'diaginertia="{about:.17g} {about:.17g} {about:.17g}"/>'
        )
        late = _history(h.delay, step)
        if h.emf:
            dry = f"{share * h.bristle} {0.01 * share * h.bristle} {share * h.coulomb}"
            lugre = f'lugre="{dry} {share * h.static} 0.05"' if h.bristle else ""
            lag = f'inductance="0 {h.lag}"' if h.lag else ""
            motors += (
                f'<dcmotor joint="motor{k}" {late} motorconst="1 1" '
                # Back-EMF as a resistance: with unit motor constants the braking torque is emf
                # times speed.
                f'resistance="{1.0 / (share * h.emf):.17g}" {lag} {lugre}/>'
            )
        else:
            motors += f'<motor joint="motor{k}" {late}/>'
        for name in ("motor", "play") if h.backlash else ("motor",):
            sensors += f'<jointpos joint="{name}{k}" {_history(h.sensing, step)}/>'
    ends = "</body>" * (4 if h.backlash else 2)
    extra = f"<actuator>{motors}</actuator><sensor>{sensors}</sensor>"
    return scene_xml(
        bodies + ends, step, integrator, 0.0, springs=True, touching=h.backlash > 0.0, extra=extra
    )


class Twin:
    """A batch of the same arm in MuJoCo, under a law that is sampled as the course's is."""

    def __init__(
        self,
        hidden: Hidden | None = None,
        *,
        step: float = 1e-3,
        integrator: str = "implicitfast",
        threads: int = 2,
    ) -> None:
        """Create the arm; step [s] has to divide the control loop's."""
        mujoco = library()
        self._hidden = Hidden() if hidden is None else hidden
        self.substeps = count("DT / step", round(DT / positive("step", step)), 1)
        self.threads = count("threads", threads, 1)
        one_of("integrator", integrator, MUJOCO_INTEGRATORS)
        self.model = mujoco.MjModel.from_xml_string(
            _xml(self._hidden, DT / self.substeps, integrator)
        )
        for flag in (mujoco.mjtDisableBit.mjDSBL_ACTUATION, mujoco.mjtDisableBit.mjDSBL_SENSOR):
            self.model.opt.disableflags &= ~int(flag)  # which the scenes of chapter 1 have off
        # A command is a voltage: as much as makes the torque while the motor stands.
        share = np.array([1.0, 0.5])
        self._volts = 1.0 / (share * self._hidden.emf) if self._hidden.emf else np.ones(2)

    def run(
        self, law: Law, start: ArrayLike, samples: int, seed: int = 0
    ) -> tuple[Array, Array, Array]:
        """Run arms from rest under a law, one command a sample.

        Args:
            law: (sample, measured angles (2, N)) -> torques (2, N) [rad, N m].
            start: angles, shape (2, N) [rad].
            samples: of the control loop.
            seed: of the encoders' noise.

        Returns:
            The links' angles (2, N, samples + 1), what was measured there, and the torques that
            were sent (2, N, samples).
        """
        mujoco = library()
        from mujoco import batch

        first = vector("start", start, (2, None), unit="rad")
        N, h = first.shape[1], self._hidden
        arms = batch.Batch(self.model, N, self.threads)
        data, both = mujoco.MjData(self.model), bool(h.backlash)
        for i in range(N):
            mujoco.mj_resetData(self.model, data)
            data.qpos[:: 2 if both else 1] = first[:, i]
            mujoco.mj_forward(self.model, data)
            if h.sensing:
                n = round(h.sensing / self.model.opt.timestep) + 1
                for sensor in range(self.model.nsensor):
                    value = np.full((n, 1), data.qpos[sensor])
                    # The delayed sensors start with the present angle, or they would read zeros at
                    # first.
                    mujoco.mj_initSensorHistory(self.model, data, sensor, None, value, 0.0)
            mujoco.mj_getState(self.model, data, arms.state[i], mujoco.mjtState.mjSTATE_INTEGRATION)
        q, text, ctrl = arms.bind("qpos"), arms.bind("sensordata"), arms.bind("ctrl")
        noise = h.noise * np.random.default_rng(seed).standard_normal((samples + 1, 2, N))
        angles, measured = np.empty((2, 2, N, samples + 1))
        sent = np.empty((2, N, samples))
        for k in range(samples + 1):
            # The link's angle is the motor's plus the play in between.
            angles[:, :, k] = (q[:, ::2] + q[:, 1::2] if both else q).T
            # `stage` below makes the sensors those of this instant, not of the step before.
            observed = (text if h.sensing and k else q).T
            if both:
                observed = observed[::2] + (observed[1::2] if h.encoder == "link" else 0.0)
            measured[:, :, k] = observed + noise[k]
            if k == samples:
                break
            torque = np.asarray(law(k, measured[:, :, k]), dtype=float)
            limit = np.array(ARM.torques)[:, None]
            sent[:, :, k] = np.clip(torque, -limit, limit)
            ctrl[:] = (sent[:, :, k] * self._volts[:, None]).T
            arms.step(nstep=self.substeps, stage=mujoco.mjtStage.mjSTAGE_POS)
        return angles, measured, sent

    def rollouts(self, gains: ArrayLike, tasks: Tasks) -> Outcome:
        """Return what `course.sim_to_real.rollouts` returns, for one set of gains (6,)."""
        numbers = vector("gains", gains, (6,), low=0.0).reshape(2, 3).tolist()
        N, T = tasks.size, round(SECONDS / DT)
        # One controller object per joint and arm, since each has an integral of its own.
        laws = [
            [Controller(Gains(kp, ki, kd, FILTER, -u, u), DT) for _ in range(N)]
            for (kp, ki, kd), u in zip(numbers, ARM.torques, strict=True)
        ]
        desired = tasks.reference.tolist()

        def law(k: int, observed: Array) -> Array:
            rows = zip(laws, desired, observed.tolist(), strict=True)
            return np.array(
                [[c.update(*pair) for c, *pair in zip(*row, strict=True)] for row in rows]
            )

        angles, _, _ = self.run(law, tasks.start, T, tasks.seed)
        return judged(angles, tasks)

    def log(self, torques: ArrayLike, start: ArrayLike, seed: int = 0) -> Log:
        """Return what one arm leaves that is driven by torques (T, 2) from rest at angles (2,)."""
        plan = vector("torques", torques, (None, 2), unit="N m")
        first = vector("start", start, (2,), unit="rad")[:, None]
        _, observed, sent = self.run(lambda k, _: plan[k][:, None], first, len(plan), seed)
        # One reading more than commands.
        times = np.linspace(0.0, DT * len(plan), len(plan) + 1)
        return Log(times, observed[:, 0], sent[:, 0])


def judged(angles: ArrayLike, tasks: Tasks) -> Outcome:
    """Return the outcome of motions (2, N, T + 1) by the rules of `plants.rollouts`."""
    q = np.asarray(angles)
    far = np.hypot(*(tip(q) - tasks.goal[:, :, None]))
    near, last = far <= RADIUS, round(HOLD / DT) + 1
    held, wild = near[:, -last:].all(axis=1), ~np.isfinite(far).all(axis=1)
    # In this order: diverged, held, arrived late, passed through; else never there.
    reason = np.select([wild, held, near[:, -1], near.any(axis=1)], [4, 0, 1, 2], 3)
    error = np.where(wild, np.inf, far[:, -1])
    return Outcome(held & ~wild, DT * near.sum(axis=1), error, reason)
