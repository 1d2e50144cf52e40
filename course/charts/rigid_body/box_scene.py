"""Chapter 1: the bouncing box as a scene, the smallest model that answers its question."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from course.charts import chart
from course.check import invalid
from course.measure.figure import Panel
from course.measure.scene import LeftOut, Modelled, Scene, Tolerance
from course.oracles.mujoco import box as mujoco_box
from course.oracles.mujoco.box import add_air, spatial_box
from course.rigid_body import planar
from course.rigid_body.integrators import STANDARD_GRAVITY

START = np.array([0.0, 1.0, 0.5, 0.0, 0.0, 0.0])
SIZE = (0.3, 0.02, 0.2)  # width, depth, height [m]: a tile
MASS, RESTITUTION, FRICTION = 1.0, 0.7, 0.4
FINE = 2e-5  # s, where MuJoCo's own error of the apex is far below what is measured here
DURATION = 1.0  # s, holds the first bounce and the top of the flight after it
CONTACT_TIME = 2e-3  # s, of a hard plastic or wooden body
TILT = np.radians(0.5)  # how level a release can be expected to be


def apex(height: np.ndarray) -> float:
    """Return the first maximum after the first minimum [m], refined by a parabola of three samples.

    Args:
        height: samples at equal distances in time, shape (n,) [m].
    """
    rising = np.flatnonzero(np.diff(height) > 0.0)
    falling = np.flatnonzero(np.diff(height) < 0.0)
    top = falling[falling > rising[0]] if rising.size else rising
    if top.size == 0:
        raise invalid("height", height, "samples with a bounce and an apex after it")
    a, b, c = height[top[0] - 1 : top[0] + 2]
    # Vertex of the parabola through three samples.
    return float(b - 0.125 * (c - a) ** 2 / (a + c - 2.0 * b))


def ours(start: np.ndarray = START, dt: float = 1e-3, **changes: float) -> float:
    """Return the scene's answer: height of the apex after the first bounce [m]."""
    parameters = planar.box_parameters(
        MASS,
        SIZE[0],
        SIZE[2],
        restitution=changes.get("restitution", RESTITUTION),
        friction=changes.get("friction", FRICTION),
        inertia=changes.get("inertia"),
    )
    state, heights = start[:, None].copy(), [start[1]]
    for _ in range(round(DURATION / dt)):
        state, _ = planar.advance_boxes(state, parameters, dt, 1, integrator="rk4")
        heights.append(state[1, 0])
    return apex(np.array(heights))


def _mujocos_plane(air: bool = False, **options: Any) -> float:
    runner = mujoco_box.box_drop(
        (0.5 * SIZE[0], 0.5 * SIZE[2]),
        MASS,
        START[:3],
        START[3:],
        FINE,
        "Euler",
        restitution=RESTITUTION,
        friction=FRICTION,
        gravity=STANDARD_GRAVITY,
        **options,
    )
    if air:
        add_air(runner)
    path = runner.samples(round(DURATION / FINE), every=25)
    return apex(path.q[1])


def third_dimension(depth: float = SIZE[1], tilt: float = TILT) -> float:
    """Change of the apex when the release is not level [m], by MuJoCo's box in space.

    Args:
        depth: of the box, across the plane [m].
        tilt: out of the plane [rad].
    """
    # Two runs of one model, so that its own errors cancel.
    return abs(_mujocos_space(tilt, depth) - _mujocos_space(0.0, depth))


def _mujocos_space(tilt: float, depth: float) -> float:
    runner = spatial_box(
        (SIZE[0], depth, SIZE[2]),
        MASS,
        START,
        tilt,
        FINE,
        restitution=RESTITUTION,
        friction=FRICTION,
        gravity=STANDARD_GRAVITY,
    )
    path = runner.samples(round(DURATION / FINE), every=25)
    return apex(path.q[2])


def bouncing_box() -> Scene:
    """Return the scene of the chapter's simulation: how high does the box come back?"""
    answer = ours()
    rigid = _mujocos_plane()

    def spinless() -> float:
        return abs(ours(inertia=1e9) - answer)

    return Scene(
        question="How high does the centre of the dropped tile come after its first bounce?",
        tolerance=Tolerance(
            0.02, "m", "the hand that must catch it at the top spans 4 cm, 2 cm to each side"
        ),
        degrees_of_freedom=("x", "y", "angle"),
        modelled=(
            Modelled("rotation", spinless, "m", against="the planar box that can't turn"),
            Modelled(
                "friction at the corner",
                lambda: abs(ours(friction=0.0) - answer),
                "m",
                against="the planar box without",
            ),
            Modelled(
                "energy lost in the impact",
                lambda: abs(ours(restitution=1.0) - answer),
                "m",
                against="the planar box with e = 1",
            ),
        ),
        left_out=(
            LeftOut(
                f"third dimension (tilt {np.degrees(TILT):.1f} deg)",
                third_dimension,
                "m",
                against="MuJoCo, free joint, 8 corners",
            ),
            LeftOut(
                "air",
                lambda: abs(_mujocos_plane(air=True) - rigid),
                "m",
                against="MuJoCo, planar, air at 20 deg C",
            ),
            LeftOut(
                f"deformation ({1e3 * CONTACT_TIME:g} ms contact)",
                lambda: abs(
                    _mujocos_plane(contact="spring", contact_steps=CONTACT_TIME / FINE) - rigid
                ),
                "m",
                against="MuJoCo, planar, spring contact",
            ),
        ),
    )


@chart
def scene_bouncing_box() -> Iterator[Panel]:
    """Chart the bouncing tile's scene with the error of everything left out, and where it ends."""
    answer, rigid = ours(), _mujocos_plane()
    thick = {depth: third_dimension(depth) for depth in (0.02, 0.05, 0.1, 0.2)}
    rows = ", ".join(f"{1e3 * depth:.0f} mm: {error:.3f} m" for depth, error in thick.items())
    panel = Panel("The bouncing tile")
    panel.notes = [
        bouncing_box().table(),
        f"answer {answer:.4f} m; MuJoCo with the same effects neglected, step {FINE:g} s: "
        f"{rigid:.4f} m",
        "where the plane ends: error of leaving out the third dimension by depth of the body, "
        f"tilt {np.degrees(TILT):.1f} deg: {rows}",
    ]
    yield panel
