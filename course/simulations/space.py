"""A view in space: a camera that orbits the origin, and solids, arrows and trails on a pen.

A model in space has `camera()` among its controls, where a change of another control leaves the
view alone, and `ORBIT` among its arguments: then dragging and the arrow keys turn the view, + and -
come nearer and go away, while time runs on. The world's z axis points up. Points are arrays (3,)
or (3, N) in the world; what is drawn becomes lines and polygons of the same pen as in the plane,
here, by projection. Nothing hides anything by itself: `faces` are sorted by depth among themselves,
and what is drawn later lies over what was drawn before.
"""

import math
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from course.rigid_body.quaternion import cross
from course.simulations import pen as draw
from course.simulations.record import Field

_TURN = 0.7  # rad for one unit of the window, and for a few presses of a key
_SHADES = 8  # of each colour, from dark to light
_LIGHT = (-0.35, 0.55, 0.76)  # where it comes from, seen by the camera: right, up, towards it


def camera(azimuth: float = 0.7, elevation: float = 0.35, distance: float = 5.0) -> dict[str, Any]:
    """Return fields of the camera.

    Where it starts [rad], how far away in half heights of the view.
    """
    return {
        "azimuth": Field(azimuth, unit="rad"),
        "elevation": Field(elevation, low=-1.5, high=1.5, unit="rad"),
        "distance": Field(distance, low=2.5, high=20.0),
        "grip": Field((0.0, 0.0)),  # where the pointer was last
    }


@register_jitable
def _turn(controls, right, up):
    """Turn what is seen to the right and up [rad]."""
    # The azimuth wraps around; the elevation stops before the poles, where the picture would flip.
    controls["azimuth"] = (controls["azimuth"] - right + math.pi) % (2.0 * math.pi) - math.pi
    controls["elevation"] = min(max(controls["elevation"] - up, -1.5), 1.5)


def grab(controls, state, x, y):
    """Handle the pointer going down: remember where it is."""
    controls["grip"][0] = x
    controls["grip"][1] = y


def orbit(controls, state, x, y):
    """Handle the pointer moving while it is down: turn the camera."""
    grip = controls["grip"]
    _turn(controls, _TURN * (x - grip[0]), _TURN * (y - grip[1]))
    grip[0] = x
    grip[1] = y


def press(controls, state, key):
    """Handle a key of `model.KEYS`: the arrows turn, the others move nearer or farther."""
    if key < 4:
        _turn(
            controls,
            0.2 * _TURN * ((key == 1) - (key == 0)),
            0.2 * _TURN * ((key == 2) - (key == 3)),
        )
    else:
        far = controls["distance"] * (0.9 if key == 4 else 1.0 / 0.9)
        controls["distance"] = min(max(far, 2.5), 20.0)


ORBIT: dict[str, Any] = {"drag": orbit, "grab": grab, "press": press, "live_drag": True}


# --- What a frame calls ---------------------------------------------------------------------------


@register_jitable
def camera_view(pen, rectangle, controls, reach):
    """Set the rectangle to draw in; it shows `reach` above and below the origin.

    Returns:
        What the other functions call the eye: the camera's axes (right, up, towards it) as rows,
        and its distance.
    """
    wide = reach * (rectangle[1] - rectangle[0]) / (rectangle[3] - rectangle[2])
    draw.area(pen, rectangle, (-wide, wide, -reach, reach))
    c, s = math.cos(controls["azimuth"]), math.sin(controls["azimuth"])
    ce, se = math.cos(controls["elevation"]), math.sin(controls["elevation"])
    # Rows: the camera's right, up, and the direction towards it, in the world's frame.
    axes = np.array([[-s, c, 0.0], [-se * c, -se * s, ce], [ce * c, ce * s, se]])
    return axes, controls["distance"] * reach


@register_jitable
def project(eye, p):
    """Return where points are seen.

    The coordinates x and y are in the view's units; depth points towards the camera.
    """
    axes, far = eye
    depth = axes[2, 0] * p[0] + axes[2, 1] * p[1] + axes[2, 2] * p[2]
    # Perspective by similar triangles; points near the camera or behind it would divide by zero.
    scale = far / np.maximum(far - depth, 0.1 * far)
    x = scale * (axes[0, 0] * p[0] + axes[0, 1] * p[1] + axes[0, 2] * p[2])
    y = scale * (axes[1, 0] * p[0] + axes[1, 1] * p[1] + axes[1, 2] * p[2])
    return x, y, depth


@register_jitable
def behind(eye, p):
    """Return whether a point (3,) is farther away than the origin: draw it before what is there."""
    return project(eye, p)[2] < 0.0


@register_jitable
def trail(pen, eye, p, colour, width=1.5, alpha=1.0, on=0.0, gap=0.0, side=0.0):
    """Draw a line through points (3, N).

    With side -1 only what is behind the origin, with 1 before.
    """
    x, y, depth = project(eye, p)
    # With a side, points on the other side of the origin become NaN, which leaves gaps.
    draw.line(pen, colour, width, alpha, on, gap)
    draw.points(pen, np.where(side * depth < 0.0, np.nan, x), y)


@register_jitable
def circle(radius, points=73):
    """Return a closed circle around the z axis, (3, points)."""
    angle = np.linspace(0.0, 2.0 * math.pi, points)
    round = np.zeros((3, points))
    round[0], round[1] = radius * np.cos(angle), radius * np.sin(angle)
    return round


@register_jitable
def sheet(pen, eye, p, fill, edge=draw.NONE, width=1.0, alpha=0.2):
    """Draw one filled polygon through points (3, N), which need not lie in a plane."""
    x, y, _ = project(eye, p)
    draw.polygon(pen, fill, edge, width, alpha)
    draw.points(pen, x, y)


@register_jitable
def dot(pen, eye, p, colour, radius, alpha=1.0):
    """Draw a disc of a radius in values of the view around a point (3,)."""
    x, y, _ = project(eye, p)
    draw.disc(pen, radius, colour, draw.NONE, 1.0, alpha)
    draw.point(pen, x, y)


@register_jitable
def arrow(pen, eye, start, tip, colour, width=2.5, head=11.0, word=0, size=13.0):
    """Draw an arrow from a point (3,) to another one, with a word beyond its tip."""
    x0, y0, _ = project(eye, start)
    x1, y1, _ = project(eye, tip)
    draw.arrow(pen, x0, y0, x1, y1, colour, width, head)
    if word != 0:
        away = max(math.hypot(x1 - x0, y1 - y0), 1e-9)
        right, up = 11.0 * (x1 - x0) / away, 11.0 * (y1 - y0) / away
        draw.text(pen, x1, y1, word, colour, size, draw.CENTRE, draw.MIDDLE, right, up, 0.0, 1.0)


@register_jitable
def faces(pen, eye, corners, index, fills, edge=draw.NONE, width=0.6, alpha=1.0):
    """Draw filled faces, the farthest first, each in the shade that its slope to the light gives.

    Args:
        pen: what the simulation draws with.
        eye: the camera, from `camera_view`.
        corners: (3, N).
        index: the four corners of each face in turn, (F, 4); of a triangle one stands twice.
        fills: colour of each face, from `shades`, (F,).
        edge: as for `pen.polygon`.
        width: as for `pen.polygon`.
        alpha: as for `pen.polygon`.
    """
    axes, _ = eye
    x, y, depth = project(eye, corners)
    # Painter's algorithm: whole faces by depth, which is right for convex or well separated bodies.
    a, b, c, d = index[:, 0], index[:, 1], index[:, 2], index[:, 3]
    middle = depth[a] + depth[b] + depth[c] + depth[d]
    # The product of both diagonals is normal to a face; of its two sides we see the nearer one.
    one, other = corners[:, c] - corners[:, a], corners[:, d] - corners[:, b]
    normal = cross(one, other)
    size = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2) + 1e-300
    light = axes[0] * _LIGHT[0] + axes[1] * _LIGHT[1] + axes[2] * _LIGHT[2]
    along = normal[0] * light[0] + normal[1] * light[1] + normal[2] * light[2]
    _, _, towards = project(eye, normal)
    # The normal of a face may point either way; the side that is seen is lit.
    lit = np.where(towards < 0.0, -along, along) / size
    order = np.argsort(middle, kind="mergesort")
    for k in order:
        # Lambert's law with ambient light: the share of full brightness, as one of the stored
        # shades.
        shade = int(min(max(0.25 + 0.8 * lit[k], 0.0), 0.999) * _SHADES)
        draw.polygon(pen, fills[k] + shade, edge, width, alpha)
        for corner in index[k]:
            draw.point(pen, x[corner], y[corner])


# --- What a module makes once ---------------------------------------------------------------------


def shades(table: draw.Table, *colours: str) -> tuple[int, ...]:
    """Add the shades of colours to a table; the number of each colour for `faces`."""
    numbers = []
    for colour in colours:
        full = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)])
        mixed = []
        # Below 1 the colour darkens towards black, above 1 it lightens towards white.
        for share in np.linspace(0.55, 1.15, _SHADES):
            toned = full * share if share <= 1.0 else full + (255 - full) * (share - 1.0) * 2.0
            mixed.append("#" + "".join(f"{round(float(value)):02x}" for value in toned))
        numbers.append(table(*mixed)[0])
    return tuple(numbers)


def box(*sides: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return corners (3, 8) of a box around the origin and its faces: -x, +x, -y, +y, -z, +z."""
    grid = np.array(np.meshgrid((-0.5, 0.5), (-0.5, 0.5), (-0.5, 0.5), indexing="ij"))
    index = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
    return grid.reshape(3, 8) * np.reshape(sides, (3, 1)), np.array(index)


def lathe(
    profile: list[tuple[float, float]], sides: int = 24
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Turn a profile of (radius, height) about the z axis: corners (3, N), faces (F, 4)."""
    radius, height = np.array(profile).T
    angle = 2.0 * np.pi * np.arange(sides) / sides
    corners = np.array(
        [
            np.outer(radius, np.cos(angle)),
            np.outer(radius, np.sin(angle)),
            np.outer(height, 0 * angle + 1),
        ]
    ).reshape(3, -1)
    rows, k = np.meshgrid(np.arange(len(profile) - 1), np.arange(sides), indexing="ij")
    after = (k + 1) % sides
    quads = [
        rows * sides + k,
        rows * sides + after,
        (rows + 1) * sides + after,
        (rows + 1) * sides + k,
    ]
    return corners, np.stack(quads, axis=-1).reshape(-1, 4)


def ring(radius: float, half: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return a ring around the z axis whose section is a square of side 2 * half."""
    inner, outer = radius - half, radius + half
    return lathe([(inner, -half), (outer, -half), (outer, half), (inner, half), (inner, -half)], 28)
