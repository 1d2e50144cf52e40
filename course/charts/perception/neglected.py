"""Chapter 7: the known part as a scene, the smallest model that answers its question."""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from course import perception
from course.charts import chart
from course.charts.perception.poses import BOX, EYE, SENSOR, TABLE
from course.kinematics.chain import compose
from course.measure.figure import Panel
from course.measure.scene import LeftOut, Modelled, Scene, Tolerance
from course.perception import Camera, Shapes, render, sense, shape, together
from course.perception.camera import Array
from course.rigid_body.quaternion import exp

FINE = 9  # rays to a side of a pixel, where a model needs what is within one; odd
DISTORTED = 0.2  # what a good calibration leaves of the lens, at the picture's corner [px]
SPEED, EXPOSURE = 0.05, 0.01  # of a part on a belt [m/s]; of the picture [s]
DARK = 3.0  # times the noise, where a stripe of the part hardly reflects
DAZZLED = 0.05  # share of the pixels that another projector spoils, in blocks of 4 x 4
# Of each picture: the turn of the part, and how far aside it lies [m].
YAWS, ASIDE = np.linspace(0.2, 2.9, 8), np.linspace(-0.2, 0.2, 8)

Look = Callable[[Shapes, int], Array]


def scene(yaw: float, x: float = 0.0) -> Shapes:
    """Return the table and the part on it, in the camera's frame."""
    at = np.array([x, 0.0, BOX.sizes[2, 0], *exp(np.array([0.0, 0.0, yaw]))])
    part = BOX.moved(compose(TABLE[:, None], at[:, None])[:, 0])
    return together([shape("plane").moved(TABLE), part])


def _fine(shapes: Shapes) -> Array:
    """Return the exact picture with FINE x FINE rays a pixel, (H, FINE, W, FINE) [m]."""
    n, shift = FINE, 0.5 * (FINE - 1)
    eye = Camera(
        n * EYE.width,
        n * EYE.height,
        n * EYE.fx,
        n * EYE.fy,
        n * EYE.cx + shift,
        n * EYE.cy + shift,
    )
    return render(shapes, eye)[0].reshape(EYE.height, n, EYE.width, n)


def _noisy(exact: Array, seed: int) -> Array:
    return sense(exact, EYE, SENSOR, np.random.default_rng(seed))


def plain(shapes: Shapes, seed: int) -> Array:
    """Return the chapter's own picture."""
    return _noisy(render(shapes, EYE)[0], seed)


def through_a_lens(shapes: Shapes, seed: int) -> Array:
    """Return radial distortion that nobody told: DISTORTED pixels at the corner, by the cube."""
    x, y = EYE.rays()
    square = (x[None, :] ** 2 + y[:, None] ** 2) / (x[-1] ** 2 + y[-1] ** 2)
    deviation = DISTORTED * square / math.hypot(EYE.cx, EYE.cy)
    u = np.arange(EYE.width)[None, :] + (np.arange(EYE.width)[None, :] - EYE.cx) * deviation
    v = np.arange(EYE.height)[:, None] + (np.arange(EYE.height)[:, None] - EYE.cy) * deviation
    fine = _fine(shapes).reshape(FINE * EYE.height, FINE * EYE.width)
    rows, columns = (np.rint(FINE * a + 0.5 * (FINE - 1)).astype(int) for a in (v, u))
    rows, columns = (np.clip(a, 0, n - 1) for a, n in zip((rows, columns), fine.shape, strict=True))
    return _noisy(fine[rows, columns], seed)


def mixed(shapes: Shapes, seed: int) -> Array:
    """Return a depth image whose pixels average all that they see, at an edge of two surfaces."""
    return _noisy(_fine(shapes).mean(axis=(1, 3)), seed)


def with_shadow(shapes: Shapes, seed: int) -> Array:
    """Return nothing is measured where the second eye, a baseline to the right, does not see."""
    exact = render(shapes, EYE)[0]
    points, pixels = perception.back_project(exact, EYE)
    points[0] -= SENSOR.baseline
    aside = shapes.moved(np.array([-SENSOR.baseline, 0, 0, 1, 0, 0, 0]))
    other = render(aside, EYE)[0]
    u, v = np.rint(EYE.project(points)).astype(int)
    inside = (u >= 0) & (u < EYE.width) & (v >= 0) & (v < EYE.height)
    hidden = ~inside
    hidden[inside] = other[v[inside], u[inside]] < points[2, inside] - 0.005
    observed = plain(shapes, seed)
    observed.ravel()[pixels[hidden]] = 0.0
    return observed


def striped(shapes: Shapes, seed: int) -> Array:
    """Return a colour image whose every other 32 columns reflect little.

    The noise there is DARK times as large.
    """
    exact = render(shapes, EYE)[0]
    rng = np.random.default_rng(seed)
    more = sense(exact, EYE, replace(SENSOR, noise=DARK * SENSOR.noise), rng)
    dark = np.arange(EYE.width) // 32 % 2 == 1
    return np.where(dark, more, plain(shapes, seed))


def dazzled(shapes: Shapes, seed: int) -> Array:
    """Return another projector.

    Blocks of pixels with anything between the table and half the way.
    """
    observed, rng = plain(shapes, seed), np.random.default_rng(seed + 100)
    blocks = rng.random((EYE.height // 4, EYE.width // 4)) < DAZZLED
    spoilt = np.kron(blocks, np.ones((4, 4), bool))
    return np.where(spoilt, observed * rng.uniform(0.5, 1.0, observed.shape), observed)


def moving(shapes: Shapes, seed: int) -> Array:
    """Return an image of a part that moves during the exposure; its pose is that of the middle."""
    del shapes
    distances = SPEED * EXPOSURE * np.linspace(-0.5, 0.5, 5)
    inverse = [1.0 / render(scene(YAWS[seed], ASIDE[seed] + x), EYE)[0] for x in distances]
    return _noisy(1.0 / np.mean(inverse, axis=0), seed)


def change(view: Look) -> float:
    """Return the rms shift of the estimated position that an effect causes over the images [m]."""
    far = []
    for seed, at in enumerate(zip(YAWS, ASIDE, strict=True)):
        pictures = (f(scene(*at), seed) for f in (plain, view))
        places = [perception.locate(picture, EYE, SENSOR, BOX)[0] for picture in pictures]
        far.append(perception.pose_distance(BOX, places[0].pose, places[1].pose)[0])
    return float(np.sqrt(np.mean(np.square(far))))


def _without_turn() -> float:
    """Return the corner error of a part laid down without its turn, the least over the yaws."""
    reach = math.hypot(*BOX.sizes[:2, 0])
    return float(min(2.0 * reach * abs(math.sin(0.5 * min(yaw, math.pi - yaw))) for yaw in YAWS))


def known_part() -> Scene:
    """Return where is the part, to what a gripper needs?"""
    left_out = (
        (f"lens, {DISTORTED:g} px at corners", through_a_lens, FINE**2, "rays through the lens"),
        (f"dark stripes, noise x {DARK:g}", striped, 1, "two sensors in one image"),
        ("pixels that mix surfaces", mixed, FINE**2, f"{FINE**2} rays per pixel"),
        ("shadow of the second eye", with_shadow, 2, "a second image"),
        ("another projector", dazzled, 1, f"{DAZZLED:.0%} of pixels, in blocks"),
        (f"motion, {1e3 * SPEED:g} mm/s in {1e3 * EXPOSURE:g} ms", moving, 5, "5 images in one"),
    )
    return Scene(
        question="Where on the table is the known part?",
        tolerance=Tolerance(0.002, "m", "a gripper 5 mm wider than the part has 2.5 mm a side"),
        degrees_of_freedom=("x", "y", "turn z"),
        modelled=(Modelled("the turn", _without_turn, "m", against="a corner, laid unturned"),),
        left_out=[
            LeftOut(what, functools.partial(change, view), "m", float(rays), against)
            for what, view, rays, against in left_out
        ],
    )


@chart
def scene_known_part() -> Iterator[Panel]:
    """Chart the known part's scene, with the error of everything left out."""
    panel = Panel("The known part on its table")
    panel.notes = [known_part().table()]
    yield panel
