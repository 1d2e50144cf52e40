"""The imperfect arm: the parameters of chapter 8's real machine on the robot's own links."""

from __future__ import annotations

from course.sim_to_real import real
from course.sim_to_real.plants import ARM
from drills.robot.cell import World
from drills.robot.levels import CELL
from drills.robot.records import Cell

DELAY = 0.01  # s, of a torque, as in that chapter


def imperfect_world(gap: float, cell: Cell = CELL, delay: float = DELAY) -> World:
    """Return the arm at a distance from what the robot's programs believe, as in chapter 8.

    `course.sim_to_real.real` moves all parameters along one direction: heavier links, an unknown
    payload, viscous and dry friction, a weak motor, and encoders with an offset and noise. The
    second joint has half the dry friction of the first, as there. All of this friction adds to the
    one that the programs know of.

    Args:
        gap: 0 for an arm as believed but for the damping of chapter 8's arm, up to 1.25.
        cell: what the programs believe.
        delay: of a torque [s], rounded to ticks.
    """
    plant = real(gap, delay)
    mass, payload, viscous, coulomb, motor, late, bias, noise = (
        float(value[0])
        for value in (
            plant.mass,
            plant.payload,
            plant.viscous,
            plant.coulomb,
            plant.torque,
            plant.delay,
            plant.bias,
            plant.noise,
        )
    )
    m1, m2 = cell.masses
    c1, c2 = ARM.damping
    d1, d2 = cell.viscous
    f1, f2 = cell.coulomb
    return World(
        cell.lengths,
        (mass * m1, mass * m2),
        damping=(d1 + viscous * c1, d2 + viscous * c2),
        coulomb=(f1 + coulomb, f2 + 0.5 * coulomb),
        delay=round(late / cell.tick),
        payload=payload,
        motor=motor,
        bias=bias,
        noise=noise,
        transition=cell.transition,
    )
