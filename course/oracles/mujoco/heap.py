"""MuJoCo asked what shapes cost: bodies in a box of walls, that differ in their shape only.

Spheres, boxes and hulls of a number of points on one sphere, of one mass, fall into a pen. Steps a
second, contacts, rows of the constraint solver, and the time of its parts are MuJoCo's own. Nothing
is switched off but the automatic reset: it is the usual simulator that is asked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from course.check import count
from course.oracles.mujoco import kit

Array = NDArray[np.float64]

RADIUS, MASS, DT = 0.05, 0.2, 0.002  # m, kg, s


@dataclass(frozen=True)
class Cost:
    """Means over the steps that were timed.

    Attributes:
        contacts, rows: of a step.
        step: time of a step, by MuJoCo's own clock [s].
        collision, solver: parts of it that found contacts, and that solved for their forces [s].
        memory: largest part of the arena in use [bytes].
    """

    contacts: float
    rows: float
    step: float
    collision: float
    solver: float
    memory: int


def hull(points: int, seed: int = 0) -> Array:
    """Return points on a sphere of `RADIUS`, a spiral turned at random, (points, 3) [m]."""
    n, rng = count("points", points, 4), np.random.default_rng(seed)
    z = 1.0 - 2.0 * (np.arange(n) + 0.5) / n
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(n)
    flat = np.sqrt(1.0 - z * z)
    spiral = np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return RADIUS * spiral @ turn


class Heap:
    """Bodies of one shape that were dropped into a pen.

    Args:
        points: of a hull; 0 for spheres, 1 for boxes that just hold one.
        bodies: how many.
        settle: steps before anything is timed; a heap at rest costs its solver next to nothing.
    """

    def __init__(self, points: int, bodies: int, settle: int = 100) -> None:
        self._mujoco = kit.library()
        rng, side = np.random.default_rng(1), int(np.ceil(count("bodies", bodies, 1) ** (1 / 3)))
        half, asset = 1.15 * RADIUS * (side + 1), ""
        geom = f'<geom type="sphere" size="{RADIUS}" mass="{MASS}"/>'
        if points == 1:
            edge = RADIUS * (4.0 * np.pi / 3.0) ** (1 / 3) / 2.0
            geom = f'<geom type="box" size="{edge} {edge} {edge}" mass="{MASS}"/>'
        elif points:
            text = " ".join(f"{x:.9g}" for x in hull(points).ravel())
            asset = f'<asset><mesh name="hull" vertex="{text}"/></asset>'
            geom = f'<geom type="mesh" mesh="hull" mass="{MASS}"/>'
        walls = "".join(
            f'<geom type="plane" size="2 2 .1" pos="{x * half} {y * half} 0" '
            f'zaxis="{-x} {-y} {z}"/>'
            for x, y, z in ((0, 0, 1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))
        )
        falling = ""
        for k in range(bodies):
            cell = np.array([k % side, k // side % side, k // side**2], float)
            x, y, z = 2.3 * RADIUS * (cell - (0.5 * side - 0.5, 0.5 * side - 0.5, -0.7))
            dx, dy = rng.uniform(-0.1, 0.1, 2) * RADIUS
            turn = " ".join(f"{value}" for value in rng.normal(size=4))  # or they stack, each alone
            falling += f'<body pos="{x + dx} {y + dy} {z}" quat="{turn}"><freejoint/>{geom}</body>'
        self.model = self._mujoco.MjModel.from_xml_string(
            f'<mujoco><option timestep="{DT}"><flag autoreset="disable"/></option>{asset}'
            f"<worldbody>{walls}{falling}</worldbody></mujoco>"
        )
        self.data = self._mujoco.MjData(self.model)
        self.run(settle)

    def run(self, steps: int) -> None:
        """Advance by `steps` steps, in one compiled loop: the part to be timed."""
        self._mujoco.mj_step(self.model, self.data, count("steps", steps, 1))

    def measure(self, steps: int) -> Cost:
        """Measure the mean cost of the next steps, by MuJoCo's own timers."""
        names = ("STEP", "POS_COLLISION", "CONSTRAINT")
        timers = [self.data.timer[getattr(self._mujoco.mjtTimer, f"mjTIMER_{n}")] for n in names]
        before = [timer.duration for timer in timers]
        contacts = rows = 0
        for _ in range(count("steps", steps, 1)):
            self._mujoco.mj_step(self.model, self.data)
            contacts += self.data.ncon
            rows += self.data.nefc
        step, collision, solver = (
            float(timer.duration - start) / steps
            for timer, start in zip(timers, before, strict=True)
        )
        memory = int(self.data.maxuse_arena)
        return Cost(contacts / steps, rows / steps, step, collision, solver, memory)
