"""MuJoCo asked about geometry: its broad phase, its box contacts, a ball at a wall.

Its broad phase sorts along the principal axis of the centres and does not say how many tests it
makes (Computation, Collision, Selection). What can be asked is its time, by its own clock.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from course.oracles.mujoco import kit

Array = NDArray[np.float64]


def _text(numbers: Array) -> str:
    return " ".join(f"{value:.17g}" for value in np.ravel(numbers))


class BroadPhase:
    """Boxes of fixed size and orientation, one a body, for MuJoCo's broad phase.

    Args:
        boxes: lower and upper corners, shape (2, 3, N) [m].
    """

    def __init__(self, boxes: Array) -> None:
        self._mujoco = kit.library()
        middle, half = (boxes[0] + boxes[1]) / 2.0, (boxes[1] - boxes[0]) / 2.0
        bodies = "".join(
            f'<body pos="{_text(middle[:, i])}"><freejoint/>'
            f'<geom type="box" size="{_text(half[:, i])}"/></body>'
            for i in range(boxes.shape[2])
        )
        self.model = self._mujoco.MjModel.from_xml_string(
            f"<mujoco><worldbody>{bodies}</worldbody></mujoco>"
        )
        self.data = self._mujoco.MjData(self.model)
        self._mujoco.mj_kinematics(self.model, self.data)
        self._mujoco.mj_comPos(self.model, self.data)

    def seconds(self, calls: int) -> float:
        """Return the time of the broad phase in `calls` calls, by MuJoCo's own clock [s]."""
        timer = self.data.timer[self._mujoco.mjtTimer.mjTIMER_COL_BROAD]
        before = timer.duration
        for _ in range(calls):
            self._mujoco.mj_collision(self.model, self.data)
        return float(timer.duration - before)


def box_contacts(half_a: Array, half_b: Array, pose: Array) -> tuple[Array, Array]:
    """Return contacts of two boxes.

    Args:
        half_a: half sizes of the first box, shape (3,) [m].
        half_b: half sizes of the second box, shape (3,) [m].
        pose: of both, shape (7, 2).

    Returns:
        Points, shape (3, K), and distances, shape (K,) [m].
    """
    mujoco = kit.library()
    bodies = "".join(
        f'<body><freejoint/><geom type="box" size="{_text(half)}"/></body>'
        for half in (half_a, half_b)
    )
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    data.qpos[:] = pose.T.ravel()
    mujoco.mj_forward(model, data)
    return data.contact.pos.T.copy(), data.contact.dist.copy()


def passes(
    speed: float, dt: float, start: float, radius: float, wall: float, speculative: bool = False
) -> bool:
    """Return whether a ball that flies at a wall comes out on its other side.

    A ball of 1 kg slides along x without gravity; the contact is critically damped, with MuJoCo's
    usual impedance. Integrated by MuJoCo's Euler.

    Args:
        speed: of the ball [m/s].
        dt: step [s].
        start: gap between ball and wall at the start [m].
        radius: of the ball [m].
        wall: thickness of the wall [m].
        speculative: whether contacts of the step ahead are looked for.
    """
    timeconst = 0.02  # s, MuJoCo's own
    body = (
        f'<geom type="box" size="{wall / 2:.17g} 1 1"/>'
        f'<body pos="{-(start + radius + wall / 2):.17g} 0 0"><joint type="slide" axis="1 0 0"/>'
        f'<geom type="sphere" size="{radius:.17g}" mass="1"/></body>'
    )
    xml = kit.scene_xml(body, dt, "Euler", 0.0, touching=True)
    if speculative:
        xml = xml.replace("<flag ", '<flag speculative="enable" ')
    runner = kit.Runner(xml, [0.0], [speed], "Euler")
    # Long enough to fly through, and to be pushed out again.
    flight = int((start + 4 * radius + 2 * wall) / (speed * dt)) + int(10 * timeconst / dt) + 2
    q, _ = runner.run(flight)
    return bool(q[0] > start + 2 * radius + wall)
