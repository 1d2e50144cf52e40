"""A perception stage is confident and wrong: causes, probes, repairs."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from course.interview.scenarios import Cause, Probe, Repair, Scenario
from course.interview.scenarios.programs.sure import (
    Array,
    Camera,
    Scene,
    Stage,
    estimate,
    image,
)

Run = Callable[[str, int], float]
Change = Callable[[Scene], Scene]

AWAY, SIDE = 0.6, 0.16  # from the camera to the box, along its axis and to the side [m]
ERROR = 0.024  # of the grasp point, which each fault causes [m]
SPEED = 0.3  # of the hand [m/s]
NOISE = 3e-4  # standard deviation of an estimated or taped length [m]
GRASPED = 8.0  # mm, the largest error with which the gripper still grasps
CORNERS = np.array(
    [[x, y, z] for x in (-0.06, 0.06) for y in (-0.04, 0.04) for z in (-0.03, 0.03)]
).T


def shifted(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    """Return a frame that is moved and not turned."""
    frame = np.eye(4)
    frame[:3, 3] = x, y, z
    return frame


def about_z(angle: float) -> Array:
    """Return a frame that is turned about z."""
    frame = np.eye(4)
    c, s = np.cos(angle), np.sin(angle)
    frame[:2, :2] = [[c, -s], [s, c]]
    return frame


# The camera looks down: its z axis is that of the hand and points to the table.
DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
CAMERA = Camera(
    focal=600.0, middle=np.array([320.0, 240.0]), gain=1.0, offset=0.0, mount=shifted(z=0.05)
)
# The grasp point is not the middle of the box: a stage that confuses the ends misses it by twice
# the distance between the two points.
TWIN = shifted(x=ERROR / 2.0) @ about_z(np.pi) @ shifted(x=-ERROR / 2.0)
STAGE = Stage(
    focal=CAMERA.focal,
    middle=CAMERA.middle,
    gain=1.0,
    offset=0.0,
    mount=CAMERA.mount,
    late=0.0,
    model=CORNERS + [[ERROR / 2.0], [0.0], [0.0]],
    marked=True,
)
FAULTS: dict[str, tuple[dict[str, Any], str]] = {
    # A focal length that is too small by a factor 1 + s places a point too far out by the share s.
    "wrong_focal": ({"focal": CAMERA.focal / (1.0 + ERROR / SIDE)}, "calibrate_focal"),
    "shifted_middle": (
        {"middle": CAMERA.middle + [0.0, CAMERA.focal * ERROR / AWAY]},
        "calibrate_middle",
    ),
    "depth_scale": ({"gain": 1.0 + ERROR / np.hypot(AWAY, SIDE)}, "calibrate_scale"),
    "depth_offset": ({"offset": ERROR * AWAY / np.hypot(AWAY, SIDE)}, "calibrate_zero"),
    "bent_mount": ({"mount": CAMERA.mount @ shifted(y=ERROR)}, "calibrate_mount"),
    "old_pose": ({"late": ERROR / SPEED}, "stamp_pose"),
    "other_end": ({"marked": False}, "mark_an_end"),
    "other_origin": ({"model": STAGE.model + [[0.0], [0.0], [ERROR]]}, "fix_origin"),
}


def scene(seed: int) -> Scene:
    """Return the scene of a seed: the hand above the table, the box at the side of the image."""
    draw = np.random.default_rng([16, seed])
    place = shifted(*draw.uniform(-0.2, 0.2, 2))
    hand = place @ about_z(float(draw.uniform(-0.3, 0.3))) @ shifted(z=0.8) @ DOWN
    side = SIDE * float(draw.uniform(0.97, 1.03))
    box = (
        hand
        @ CAMERA.mount
        @ shifted(x=side, z=AWAY)
        @ DOWN
        @ about_z(float(draw.uniform(-0.2, 0.2)))
    )
    moving = SPEED * np.array([0.0, 1.0, 0.0])
    corners = CORNERS + [[ERROR / 2.0], [0.0], [0.0]]
    return Scene(box, hand, moving, corners, TWIN)


def stage(cause: str, repair: str | None = None) -> Stage:
    """Return the stage with a fault, after a repair."""
    numbers, right = FAULTS[cause]
    one = replace(STAGE, **numbers)
    return STAGE if repair == right else one


def turned_hand(one: Scene) -> Scene:
    """Return the scene with the camera turned by half a turn about its axis, above the box."""
    away = np.linalg.inv(one.hand @ CAMERA.mount) @ one.box
    return replace(
        one, hand=one.hand @ shifted(2.0 * away[0, 3], 2.0 * away[1, 3]) @ about_z(np.pi)
    )


def closer(one: Scene) -> Scene:
    """Return the scene with the camera at half the distance."""
    return replace(one, hand=one.hand @ shifted(z=AWAY / 2.0))


def centred(one: Scene) -> Scene:
    """Return the scene with the box in the middle of the image."""
    away = np.linalg.inv(one.hand @ CAMERA.mount) @ one.box
    return replace(one, hand=one.hand @ shifted(away[0, 3], away[1, 3]))


def turned_box(one: Scene) -> Scene:
    """Return the scene with the box turned by half a turn about its grasp point."""
    return replace(one, box=one.box @ about_z(np.pi))


def still(one: Scene) -> Scene:
    """Return the scene with the hand at rest."""
    return replace(one, moving=0.0 * one.moving)


def miss(one: Stage, where: Scene) -> Array:
    """Return the error of the estimated grasp point, (3,) [m]."""
    frame, _ = estimate(one, CAMERA, where)
    return np.asarray(frame[:3, 3] - where.box[:3, 3])


def symptom(cause: str, seed: int, repair: str | None) -> float:
    """Return the distance between the estimated and the true grasp point [mm]."""
    if repair == "slow_hand":
        where = scene(seed)
        return 1e3 * float(np.linalg.norm(miss(stage(cause), still(where))))
    return 1e3 * float(np.linalg.norm(miss(stage(cause, repair), scene(seed))))


def price(cause: str, seed: int, repair: str) -> float:
    """Return the time per grasp after a repair, divided by the time before."""
    return {"average": 2.0, "slow_hand": 3.0}.get(repair, 1.0)


# --- Probes ---------------------------------------------------------------------------------------


def read(value: float, number: int, seed: int) -> float:
    """Return a length [mm] with the noise of its measurement."""
    noise = NOISE * float(np.random.default_rng([17, number, seed]).normal())
    return 1e3 * (value + noise)


def after(change: Change, number: int) -> Run:
    """Return the probe that changes the scene and returns the error of the grasp point [mm]."""

    def run(cause: str, seed: int) -> float:
        missed = float(np.linalg.norm(miss(stage(cause), change(scene(seed)))))
        return abs(read(missed, number, seed))

    return run


def difference_after(change: Change, number: int) -> Run:
    """Return the probe that compares the estimates before and after a change of the scene [mm]."""

    def run(cause: str, seed: int) -> float:
        one, where = stage(cause), scene(seed)
        between = miss(one, change(where)) - miss(one, where)
        return abs(read(float(np.linalg.norm(between)), number, seed))

    return run


def residual(cause: str, seed: int) -> float:
    """Return the residual of the fit [mm]."""
    return abs(read(estimate(stage(cause), CAMERA, scene(seed))[1], 1, seed))


def tape(cause: str, seed: int) -> float:
    """Return the stage's depth of the box's middle minus that measured with a tape [mm]."""
    one, where = stage(cause), scene(seed)
    _, depth = image(CAMERA, where)
    return read(float(np.mean(one.gain * depth + one.offset - depth)), 2, seed)


def tape_closer(cause: str, seed: int) -> float:
    """Return the same difference at half the distance [mm]."""
    one, where = stage(cause), closer(scene(seed))
    _, depth = image(CAMERA, where)
    return read(float(np.mean(one.gain * depth + one.offset - depth)), 3, seed)


def pose_age(cause: str, seed: int) -> float:
    """Return the age of the hand's frame when it is used [ms]."""
    return 1e3 * stage(cause).late + 0.5 * float(np.random.default_rng([18, seed]).normal())


SCENARIO = Scenario(
    name="sure",
    title="The perception stage is confident and wrong",
    prompt="A camera on the hand observes a box while the hand moves. The perception stage fits a "
    "model of the box to the image and reports a confidence close to one. Yet the gripper misses "
    "the grasp point by more than two centimetres in every attempt. You can read the program, but "
    "not the parameters of the stage, which are on the robot; you can only run the probes below. "
    "What is the cause, and what do you change?",
    symptom_words="error of the estimated grasp point",
    unit="mm",
    symptom=symptom,
    spread=0.2,
    removed=lambda figure: figure < GRASPED,
    causes=(
        Cause(
            "wrong_focal",
            "The stage uses a focal length that is not the camera's, so objects near the edge of "
            "the image are placed too far from the optical axis.",
            "calibrate_focal",
        ),
        Cause(
            "shifted_middle",
            "The stage uses a wrong principal point (the pixel on the optical axis), so it shifts "
            "every point sideways in proportion to its depth.",
            "calibrate_middle",
        ),
        Cause("depth_scale", "The measured depth has a wrong scale factor.", "calibrate_scale"),
        Cause(
            "depth_offset",
            "The measured depth has an offset that is the same at every distance.",
            "calibrate_zero",
        ),
        Cause(
            "bent_mount",
            "The camera's mount was bent, so the hand-eye calibration is wrong by a translation.",
            "calibrate_mount",
        ),
        Cause(
            "old_pose",
            "The image is combined with an outdated pose of the hand.",
            "stamp_pose",
        ),
        Cause(
            "other_end",
            "The box looks the same from both ends, and the stage confuses one end with the other.",
            "mark_an_end",
        ),
        Cause(
            "other_origin",
            "The model's origin is not where the gripper expects it: it is at another height.",
            "fix_origin",
        ),
    ),
    probes=(
        Probe("read_residual", "residual (remaining error) of the fit", "mm", 1, residual, 0.8),
        Probe(
            "hold_still",
            "error of the estimated grasp point with the hand at rest",
            "mm",
            3,
            after(still, 4),
            2.0,
        ),
        Probe(
            "look_closer",
            "error of the estimated grasp point with the camera at half the distance from the box",
            "mm",
            4,
            after(closer, 5),
            2.0,
        ),
        Probe(
            "look_straight",
            "error of the estimated grasp point with the box in the centre of the image",
            "mm",
            4,
            after(centred, 6),
            2.0,
        ),
        Probe(
            "turn_hand",
            "distance between the original estimate and one with the camera rotated by 180 degrees "
            "about its viewing direction",
            "mm",
            6,
            difference_after(turned_hand, 7),
            3.0,
        ),
        Probe(
            "turn_box",
            "distance between the original estimate and one with the box rotated by 180 degrees "
            "about its grasp point",
            "mm",
            5,
            difference_after(turned_box, 8),
            3.0,
        ),
        Probe(
            "tape",
            "depth of the box according to the stage, minus its depth measured with a tape",
            "mm",
            6,
            tape,
            2.0,
        ),
        Probe(
            "tape_closer",
            "the same difference with the camera at half the distance",
            "mm",
            6,
            tape_closer,
            2.0,
        ),
        Probe("pose_age", "age of the hand's pose when it is used", "ms", 10, pose_age, 3.0),
    ),
    repairs=(
        Repair("calibrate_focal", "The focal length is calibrated with a calibration board."),
        Repair("calibrate_middle", "The principal point is taken from a calibration."),
        Repair("calibrate_scale", "The depth's scale is calibrated at two distances from a tape."),
        Repair("calibrate_zero", "The depth's offset is calibrated at one distance from a tape."),
        Repair("calibrate_mount", "The hand-eye calibration is repeated."),
        Repair("stamp_pose", "The pose of the hand is interpolated to the image's time stamp."),
        Repair("mark_an_end", "The boxes get a mark at one end, which the stage detects."),
        Repair("fix_origin", "The model's origin is moved to where the gripper expects it."),
        Repair("average", "The stage averages ten images."),
        Repair("slow_hand", "The hand stops for every image."),
    ),
    popular="average",
    price=price,
    price_words="time per grasp, relative to the original time",
    affordable=1.5,
    path=5,
)
