"""The view in space against plain geometry: where points are seen, what hides what, what turns."""

import math

import numpy as np
import pytest

from course.simulations import pen as draw
from course.simulations import space
from course.simulations.model import KEYS, Experiment, Model, Preset
from course.simulations.record import Field, Record

PAPER = draw.Paper("A box in space")
SHADES = np.array(space.shades(PAPER.colours, *["#808080", "#ff0000"] * 3))
WORD = PAPER.words("seen")[0]
CORNERS, INDEX = space.box(1.0, 2.0, 3.0)


def frame(pen, state, controls):
    eye = space.camera_view(pen, (0.0, 9.0, 0.0, 5.0), controls, 2.0)
    space.faces(pen, eye, CORNERS, INDEX, SHADES)
    draw.reading(pen, WORD, state["time"], 1)


def advance(state, controls, seconds):
    state["time"] += seconds


BOX = Model(
    "A box",
    PAPER,
    Record(**space.camera(0.3, 0.2)),
    Record(time=Field(0.0)),
    {"A box": Preset({}, "Drag it.")},
    lambda controls, state: None,
    advance,
    frame,
    **space.ORBIT,
)


def eye_of(**values):
    return space.camera_view(PAPER.pen(), (0, 9, 0, 5), Record(**space.camera()).new(**values), 2.0)


def test_a_camera_on_the_x_axis_sees_y_to_the_right_and_z_up():
    eye = eye_of(azimuth=0.0, elevation=0.0, distance=5.0)
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 20))
    x, y, depth = space.project(eye, points)
    # Similar triangles: the camera is 10 away from the plane of the picture.
    nearer = 10.0 / (10.0 - points[0])
    np.testing.assert_allclose([x, y, depth], [points[1] * nearer, points[2] * nearer, points[0]])
    assert space.behind(eye, np.array([-1.0, 0, 0])) and not space.behind(
        eye, np.array([1.0, 0, 0])
    )


def test_the_axes_of_the_camera_are_a_rotation_that_looks_at_the_origin():
    for azimuth, elevation in np.random.default_rng(2).uniform(-1.5, 1.5, (20, 2)):
        axes, far = eye_of(azimuth=azimuth, elevation=elevation, distance=4.0)
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(axes) == pytest.approx(1.0) and far == 8.0
        assert math.asin(axes[2, 2]) == pytest.approx(elevation)
        assert math.atan2(axes[2, 1], axes[2, 0]) == pytest.approx(azimuth)


def test_the_faces_that_look_at_the_camera_are_drawn_last():
    for azimuth, elevation in np.random.default_rng(3).uniform(-1.4, 1.4, (20, 2)):
        experiment = Experiment(BOX, azimuth=azimuth, elevation=elevation)
        drawn = [item for item in draw.decode(experiment.picture()) if item.kind == draw.POLYGON]
        axes, far = eye_of(azimuth=azimuth, elevation=elevation)
        centres = CORNERS[:, INDEX].mean(axis=2)
        normals = np.sign(centres) * (np.abs(centres) > 0)
        observed = np.einsum("if,if->f", normals, far * axes[2][:, None] - centres) > 0
        order = [int(np.searchsorted(SHADES, item.style[0], "right") - 1) for item in drawn]
        assert sorted(order) == list(range(6)) and not observed[order[: 6 - observed.sum()]].any()


def test_a_face_is_lit_by_its_slope():
    fills = np.array([SHADES[0]])
    for corners, index in (space.box(1.0, 1.0, 1.0), space.lathe([(0.0, -1.0), (1.0, 0.0)], 3)):
        pen = PAPER.pen()
        eye = space.camera_view(
            pen, (0, 9, 0, 5), BOX.controls.new(azimuth=0.0, elevation=0.0), 2.0
        )
        space.faces(pen, eye, corners, index, np.repeat(fills, len(index)))
        shades = [item.style[0] for item in draw.decode(draw.picture(PAPER, pen)) if item.style]
        assert len(set(shades)) > 1 and all(SHADES[0] <= shade < SHADES[1] for shade in shades)


def test_a_drag_turns_the_view_from_where_it_began_and_time_goes_on():
    experiment = Experiment(BOX)
    experiment.advance(1.0)
    experiment.grab(4.0, 2.0)
    experiment.drag(4.0, 2.0)
    assert experiment.controls["azimuth"] == pytest.approx(0.3)
    experiment.drag(5.0, 2.0)
    experiment.drag(5.0, 1.0)
    # What is seen follows the pointer: to the right, so the camera goes to the left, and down.
    assert experiment.controls["azimuth"] == pytest.approx(0.3 - 0.7)
    assert experiment.controls["elevation"] == pytest.approx(0.2 + 0.7)
    assert experiment.state["time"] == 1.0
    experiment.start()
    assert experiment.controls["azimuth"] == pytest.approx(-0.4)


def test_keys_turn_the_view_and_come_nearer():
    changed = {}
    for key in KEYS:
        experiment = Experiment(BOX)
        experiment.press(key)
        now = [experiment.controls[name] for name in ("azimuth", "elevation", "distance")]
        changed[key] = [
            int(np.sign(round(a - b, 9))) for a, b in zip(now, (0.3, 0.2, 5.0), strict=True)
        ]
    assert changed == {
        "ArrowLeft": [1, 0, 0],
        "ArrowRight": [-1, 0, 0],
        "ArrowUp": [0, -1, 0],
        "ArrowDown": [0, 1, 0],
        "+": [0, 0, -1],
        "-": [0, 0, 1],
    }


def test_solids_are_closed():
    for corners, index in (space.box(1.0, 2.0, 3.0), space.ring(1.0, 0.1)):
        edges = [(a, b) for face in index for a, b in zip(face, np.roll(face, -1), strict=True)]
        same = np.round(corners, 9).T
        sides = [tuple(sorted((tuple(same[a]), tuple(same[b])))) for a, b in edges]
        assert all(sides.count(side) == 2 for side in sides)


def test_a_trail_leaves_out_what_is_on_the_other_side():
    pen, points = PAPER.pen(), np.array([[-1.0, -0.5, 0.5, 1.0], [0.0] * 4, [0.0] * 4])
    eye = space.camera_view(pen, (0, 9, 0, 5), BOX.controls.new(azimuth=0.0, elevation=0.0), 2.0)
    for side, hidden in ((-1.0, [0, 0, 1, 1]), (1.0, [1, 1, 0, 0]), (0.0, [0, 0, 0, 0])):
        draw.clear(pen)
        space.trail(pen, eye, points, draw.INK, 1.0, 1.0, 0.0, 0.0, side)
        (item,) = draw.decode(draw.picture(PAPER, pen))
        assert np.isnan(item.points[0]).tolist() == [bool(h) for h in hidden]
