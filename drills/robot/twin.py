"""The imperfect arm: what chapter 8's real machine does to the same stages."""

from __future__ import annotations

from drills.robot.cell import World
from drills.robot.levels import CELL
from drills.robot.records import Cell


def imperfect_world(cell: Cell = CELL) -> World:
    """Return an arm that differs from what the robot's programs believe, as arms do.

    Links are heavier by 8 %, one is a millimetre longer than measured, the joints have viscous and
    dry friction, and a torque takes effect two ticks late (see `course.sim_to_real.plants`).
    """
    l1, l2 = cell.lengths
    m1, m2 = cell.masses
    return World((l1 + 0.001, l2), (1.08 * m1, 1.08 * m2), (0.4, 0.2), (0.3, 0.1), 2)
