"""A depth camera: shapes as data, the exact picture of them, and the picture that a sensor gives.

The camera looks along z, x is right and y down. Pixel centres are at whole numbers: pixel (u, v)
sees along ((u - cx) / fx, (v - cy) / fy, 1), and W columns have their middle at (W - 1) / 2. A
picture is an array (H, W) of depths along z [m]; 0 is no measurement. A pose is
(x, y, z, qw, qx, qy, qz), components along axis 0, one shape a column.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import float64, int64, types, void
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, one_of, positive, vector
from course.compiled import MATRIX, VECTOR, compiled, loop
from course.kinematics.chain import compose
from course.rigid_body.quaternion import to_matrix
from course.rigid_body.spatial import poses as checked_poses

Array = NDArray[np.float64]
Ids = NDArray[np.int64]

# The kinds of shapes, and their sizes: none; half lengths; radius and half length; radius.
KINDS = {"plane": 0, "box": 3, "cylinder": 2, "sphere": 1}
PLANE, BOX, CYLINDER, SPHERE = range(4)
STILL = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
# Where half of a picture is farther than this, it is in millimetres [m].
_FARTHEST = 100.0


@dataclass(frozen=True, eq=False)
class Shapes:
    """Some shapes and where they are. Make one by `shape`, several by `together`.

    Attributes:
        kinds: names of `KINDS`. A plane is z = 0 of its frame, seen from above only; the others lie
            about their origin, a cylinder along z.
        sizes: shape (3, n), as many as `KINDS` says, then zeros [m].
        poses: shape (7, n), in the camera's frame where a camera looks at them [m].

    Raises:
        ValueError: for another kind, a size that is not positive, or poses that are none.
    """

    kinds: tuple[str, ...]
    sizes: Array
    poses: Array

    def __post_init__(self) -> None:
        n = len(self.kinds)
        sizes = np.ascontiguousarray(vector("sizes", self.sizes, (3, n), unit="m"))
        for i, kind in enumerate(self.kinds):
            for k in range(KINDS[one_of(f"kinds[{i}]", kind, KINDS)]):
                positive(f"sizes[{k}, {i}]", sizes[k, i], unit="m")
        object.__setattr__(self, "sizes", sizes)
        vector("poses", self.poses, (7, n))
        object.__setattr__(self, "poses", checked_poses("poses", self.poses, 3))

    def at(self, pose: ArrayLike) -> Shapes:
        """Return the same shapes at other poses: (7, n), or (7,) of one shape."""
        return replace(self, poses=np.reshape(np.asarray(pose, dtype=float), (7, -1)))

    def moved(self, pose: ArrayLike) -> Shapes:
        """Return all shapes, given in the frame of a pose (7,), in that pose's parent frame.

        A camera at `pose` sees `shapes.moved(invert(pose))`.
        """
        by = checked_poses("pose", pose, 3)
        return replace(self, poses=compose(np.tile(by[:, :1], len(self.kinds)), self.poses))


def shape(kind: str, *size: float, pose: ArrayLike = STILL) -> Shapes:
    """Return one shape, such as `shape("box", 0.05, 0.03, 0.02)`.

    Args:
        kind: one of `KINDS`.
        size: half lengths of a box; radius and half length of a cylinder; radius of a sphere [m].
        pose: shape (7,).
    """
    desired = KINDS[one_of("kind", kind, KINDS)]
    if len(size) != desired:
        raise invalid("size", size, f"{desired} numbers for a {kind}")
    sizes = np.zeros((3, 1))
    sizes[:desired, 0] = size
    return Shapes((kind,), sizes, np.reshape(np.asarray(pose, dtype=float), (-1, 1)))


def together(shapes: Sequence[Shapes]) -> Shapes:
    """Return several collections of shapes as one."""
    return Shapes(
        tuple(kind for some in shapes for kind in some.kinds),
        np.hstack([np.zeros((3, 0)), *(some.sizes for some in shapes)]),
        np.hstack([np.zeros((7, 0)), *(some.poses for some in shapes)]),
    )


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Attributes:
        width, height: of the picture [pixels].
        fx, fy: focal lengths [pixels].
        cx, cy: where its axis meets the picture [pixels].

    Raises:
        ValueError: for a size that is no whole number, or a focal length that is not positive.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            count(name, getattr(self, name), 1)
        for name in ("fx", "fy"):
            positive(name, getattr(self, name), unit="pixels")
        for name in ("cx", "cy"):
            finite(name, getattr(self, name), unit="pixels")

    @classmethod
    def symmetric(cls, width: int, height: int, view: float) -> Camera:
        """Return a camera with square pixels and the axis in the middle.

        `view` is from left to right [rad].
        """
        angle = finite("view", view, 1e-3, math.pi - 1e-3, unit="rad")
        f = 0.5 * count("width", width, 1) / math.tan(0.5 * angle)
        return cls(width, height, f, f, 0.5 * (width - 1), 0.5 * (count("height", height, 1) - 1))

    def rays(self) -> tuple[Array, Array]:
        """Return x / z of each column, shape (W,), and y / z of each row, shape (H,)."""
        return rays_of(self)

    def project(self, points: ArrayLike) -> Array:
        """Return the pixel coordinates u and v, (2, N), of points (3, N) before the camera [m]."""
        x, y, z = vector("points", points, (3, None), unit="m")
        if not np.all(z > 0.0):
            raise invalid("points[2]", float(z.min()), "in front of the camera")
        return np.stack((self.cx + self.fx * x / z, self.cy + self.fy * y / z))

    def picture(self, depth: ArrayLike) -> Array:
        """Check a picture from outside; return it as contiguous floats (H, W) [m].

        NaN and infinity become 0, no measurement: depth images of ROS mark a pixel without a
        measurement, or beyond the range, like that (REP 118).

        Raises:
            ValueError: for another shape, whole numbers or depths that can only be millimetres, a
                negative depth, or no measurement at all.
        """
        given = np.asarray(depth)
        if given.dtype.kind in "iub":
            report = "metres as floats; whole numbers are millimetres: divide by 1000"
            raise invalid("depth.dtype", str(given.dtype), report)
        shape = (self.height, self.width)
        z = np.ascontiguousarray(given, dtype=float)
        if z.shape == shape and not (z.min() >= 0.0 and z.max() < np.inf):
            z = np.where(np.isfinite(z), z, 0.0)
        if z.shape != shape or z.min() < 0.0:
            vector("depth", z, shape, low=0.0, unit="m")
        if not z.any():
            raise invalid("depth", "0 everywhere", "a picture with at least one measurement")
        if z.max() > _FARTHEST and 2 * np.sum(z > _FARTHEST) > np.count_nonzero(z):
            report = f"up to {_FARTHEST:g} m; these look like millimetres: divide by 1000"
            raise invalid("depth", f"about {np.median(z[z > 0.0]):g}", report)
        return z


# --- Cameras, sensors and shapes as numbers -------------------------------------------------------

# Compiled code takes none of the classes above. The functions below that it calls read attributes
# of these tuples, which have the names of the attributes of `Camera` and of `Sensor`: Python may
# call them with either.


class Lens(NamedTuple):
    """A `Camera` as numbers, with its attributes."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float


class Noise(NamedTuple):
    """What compiled code needs of a `Sensor`, with its attributes."""

    baseline: float
    noise: float
    window: int
    step: float = 0.0
    unit: float = 0.0
    near: float = 0.1
    far: float = 10.0


class Solids(NamedTuple):
    """Shapes as numbers.

    Attributes:
        kinds: numbers in the order of `KINDS`, shape (n,).
        sizes: as of `Shapes`, shape (3, n) [m].
        poses: as of `Shapes`, shape (7, n).
    """

    kinds: Ids
    sizes: Array
    poses: Array


def numbers(shapes: Shapes) -> Solids:
    """Return shapes as numbers."""
    kinds = np.array([tuple(KINDS).index(kind) for kind in shapes.kinds], np.int64)
    return Solids(kinds, shapes.sizes, np.ascontiguousarray(shapes.poses))


@register_jitable
def moved_to(solids, pose):
    """Return solids that are given in the frame of a pose (7,) in that pose's parent frame."""
    return Solids(solids.kinds, solids.sizes, compose(pose, solids.poses))


@register_jitable
def rays_of(camera):
    """Return x / z of each column, shape (W,), and y / z of each row, shape (H,)."""
    x = (np.arange(camera.width) - camera.cx) / camera.fx
    return x, (np.arange(camera.height) - camera.cy) / camera.fy


@register_jitable
def depth_deviation(z, camera, sensor):
    """Return the standard deviation of a measured depth, of any shape [m]; see `Sensor.sigma`."""
    disparity = math.hypot(sensor.noise, sensor.step / math.sqrt(12.0))
    of_disparity = z * z / (camera.fx * sensor.baseline) * disparity
    return np.sqrt(of_disparity * of_disparity + sensor.unit * sensor.unit / 12.0)


# --- The exact picture ----------------------------------------------------------------------------

# The part [near, far] of a ray o + t d that is inside a shape, in the shape's frame: none where
# near <= far is false, as of a NaN. There is no branch, so that several pixels are done at once.


@register_jitable
def _slab(o, d, h, near, far):
    """Return what of [near, far] lies between -h and h along one axis.

    A ray along it divides by 0.
    """
    inverse = 1.0 / d
    a, b = (-h - o) * inverse, (h - o) * inverse
    low, high = (a, b) if a < b else (b, a)
    return (low if low > near else near), (high if high < far else far)


@register_jitable
def through_plane(size, o, d):
    """Return where a ray meets the plane z = 0 from above, twice; -inf if it never does."""
    t = -o[2] / d[2]
    # A plane is seen from above only, so the ray must descend.
    t = t if d[2] < 0.0 else -math.inf
    return t, t


@register_jitable
def through_box(size, o, d):
    """Return where a ray enters and leaves a box, slab by slab (Kay and Kajiya, 1986)."""
    near, far = _slab(o[0], d[0], size[0], -math.inf, math.inf)
    near, far = _slab(o[1], d[1], size[1], near, far)
    return _slab(o[2], d[2], size[2], near, far)


@register_jitable
def through_cylinder(size, o, d):
    """Return where a ray enters and leaves an upright cylinder.

    Half the chord comes from the distance of axis and ray, which does not cancel from far away.
    """
    a = d[0] * d[0] + d[1] * d[1]
    # The ray's point nearest to the axis, then half the chord from there.
    t = (o[0] * d[0] + o[1] * d[1]) / a if a > 0.0 else 0.0
    x, y = o[0] - t * d[0], o[1] - t * d[1]
    remaining = size[0] * size[0] - x * x - y * y
    # A miss is NaN, which makes `near <= far` false in the end, without a branch.
    half = math.sqrt(remaining / a if remaining >= 0.0 else math.nan)
    return _slab(o[2], d[2], size[1], -t - half, -t + half)


@register_jitable
def through_sphere(size, o, d):
    """Return where a ray enters and leaves a sphere.

    As for the cylinder, half the chord comes from the distance of centre and ray (Haines et al.,
    Precision Improvements for Ray/Sphere, 2019).
    """
    a = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    t = (o[0] * d[0] + o[1] * d[1] + o[2] * d[2]) / a
    x, y, z = o[0] - t * d[0], o[1] - t * d[1], o[2] - t * d[2]
    remaining = size[0] * size[0] - x * x - y * y - z * z
    # As for the cylinder, a miss is NaN.
    half = math.sqrt(remaining / a if remaining >= 0.0 else math.nan)
    return -t - half, -t + half


def _caster(interval):
    """Return one compiled ray-casting loop for a kind of shape.

    A test of the kind inside the loop would keep the compiler from vectorising it.
    """

    @register_jitable
    def cast(size, R, p, window, number, x, y, depth, ids):
        """Write the shape where it is nearer than what is there, within a window of pixels."""
        a, b, c = R[0], R[1], R[2]
        # The camera's centre in the frame of the shape, -R^T p.
        o = (
            -(a[0] * p[0] + b[0] * p[1] + c[0] * p[2]),
            -(a[1] * p[0] + b[1] * p[1] + c[1] * p[2]),
            -(a[2] * p[0] + b[2] * p[1] + c[2] * p[2]),
        )
        left, right, top, bottom = window
        # Only columns and rows of the window can see the shape.
        x = x[left:right]
        for v in range(top, bottom):
            # The part of a ray's direction that is the same along a row.
            row = (b[0] * y[v] + c[0], b[1] * y[v] + c[1], b[2] * y[v] + c[2])
            nearest, owner = depth[v, left:right], ids[v, left:right]
            for u in range(x.size):
                d = (a[0] * x[u] + row[0], a[1] * x[u] + row[1], a[2] * x[u] + row[2])
                near, far = interval(size, o, d)
                t = near if near > 0.0 else far  # from inside a shape its far side is seen
                # Depth buffer: keep the nearest hit, without a branch.
                nearer = (near <= far) & (t > 0.0) & (t < nearest[u])
                nearest[u] = t if nearer else nearest[u]
                owner[u] = number if nearer else owner[u]

    return cast


_cast_plane, _cast_box, _cast_cylinder, _cast_sphere = map(
    _caster, (through_plane, through_box, through_cylinder, through_sphere)
)


@register_jitable
def _window(half, R, p, x, y):
    """Return the columns and rows of the image that may see a box of given half lengths.

    It returns all of them if the box reaches behind the camera.
    """
    # A box is convex, so its image lies between those of its eight corners.
    left, right, top, bottom = math.inf, -math.inf, math.inf, -math.inf
    for corner in range(8):
        s = half[0] if corner & 1 else -half[0]
        t = half[1] if corner & 2 else -half[1]
        w = half[2] if corner & 4 else -half[2]
        z = p[2] + R[2][0] * s + R[2][1] * t + R[2][2] * w
        # A corner behind the camera projects to nowhere: the whole picture is searched.
        if not z > 0.0:
            return 0, x.size, 0, y.size
        a = (p[0] + R[0][0] * s + R[0][1] * t + R[0][2] * w) / z
        b = (p[1] + R[1][0] * s + R[1][1] * t + R[1][2] * w) / z
        left, right, top, bottom = min(left, a), max(right, a), min(top, b), max(bottom, b)
    # A pixel more on each side for what rounding may do.
    begin, end = np.searchsorted(x, left) - 1, np.searchsorted(x, right) + 1
    first, last = np.searchsorted(y, top) - 1, np.searchsorted(y, bottom) + 1
    return max(0, begin), min(x.size, end), max(0, first), min(y.size, last)


def _render(kinds, sizes, frames, poses, x, y, depth, ids):
    depth[:], ids[:] = math.inf, -1
    for i in range(kinds.size):
        r, s, t = sizes[0, i], sizes[1, i], sizes[2, i]
        p = (poses[0, i], poses[1, i], poses[2, i])
        f = frames[i]
        R = ((f[0, 0], f[0, 1], f[0, 2]), (f[1, 0], f[1, 1], f[1, 2]), (f[2, 0], f[2, 1], f[2, 2]))
        if kinds[i] == PLANE:
            whole = (0, x.size, 0, y.size)
            _cast_plane((r, s, t), R, p, whole, i, x, y, depth, ids)
        elif kinds[i] == BOX:
            window = _window((r, s, t), R, p, x, y)
            _cast_box((r, s, t), R, p, window, i, x, y, depth, ids)
        elif kinds[i] == CYLINDER:
            window = _window((r, r, s), R, p, x, y)
            _cast_cylinder((r, s, t), R, p, window, i, x, y, depth, ids)
        else:
            window = _window((r, r, r), R, p, x, y)
            _cast_sphere((r, s, t), R, p, window, i, x, y, depth, ids)
    # Pixels that no ray has hit.
    for v in range(y.size):
        for u in range(x.size):
            depth[v, u] = depth[v, u] if depth[v, u] < math.inf else 0.0


_IDS, _KINDS = types.Array(int64, 2, "C"), types.Array(int64, 1, "C")
_SIGNATURE = void(
    _KINDS, MATRIX, types.Array(float64, 3, "C"), MATRIX, VECTOR, VECTOR, MATRIX, _IDS
)
_cast = loop(_render, _SIGNATURE)


@register_jitable
def view(solids, camera):
    """Return depth and numbers of the shapes that are seen, as `render`, of shapes as numbers."""
    x, y = rays_of(camera)
    depth, ids = np.empty((y.size, x.size)), np.empty((y.size, x.size), np.int64)
    frames = np.empty((solids.kinds.size, 3, 3))
    for i in range(solids.kinds.size):
        frames[i] = to_matrix(solids.poses[3:, i])
    _cast(solids.kinds, solids.sizes, frames, solids.poses, x, y, depth, ids)
    return depth, ids


def render(shapes: Shapes, camera: Camera) -> tuple[Array, Ids]:
    """Return the exact picture of shapes.

    Rays meet them in closed form, those in a shape's window only.

    Args:
        shapes: with poses in the camera's frame.
        camera: at its origin.

    Returns:
        Depth along z, shape (H, W) [m], 0 where nothing is; the number of the shape that is seen,
        shape (H, W), -1 where nothing is.
    """
    return view(numbers(shapes), camera)


# --- The sensor's picture -------------------------------------------------------------------------


@dataclass(frozen=True)
class Sensor:
    """A stereo sensor: it measures disparity, focal length times baseline over depth.

    Attributes:
        baseline: between its two eyes [m].
        noise: standard deviation of a disparity [pixels].
        window: side of the square over which neighbours share their noise [pixels]; 1 is white.
        step: of the disparities that it can tell apart [pixels]; 0 for no steps.
        unit: of the depths that it writes [m]; 0 for none.
        dropout: share of pixels without a measurement.
        grazing: largest angle between ray and normal that is measured [rad].
        near, far: range of the depths that it writes [m].

    Raises:
        ValueError: for a number out of its range.
    """

    baseline: float = 0.05
    noise: float = 0.1
    window: int = 1
    step: float = 0.0
    unit: float = 0.0
    dropout: float = 0.0
    grazing: float = 0.5 * math.pi
    near: float = 0.1
    far: float = 10.0

    def __post_init__(self) -> None:
        positive("baseline", self.baseline, unit="m")
        finite("noise", self.noise, 0.0, unit="pixels")
        count("window", self.window, 1)
        finite("step", self.step, 0.0, unit="pixels")
        finite("unit", self.unit, 0.0, unit="m")
        finite("dropout", self.dropout, 0.0, 1.0)
        finite("grazing", self.grazing, 0.0, 0.5 * math.pi, unit="rad")
        positive("near", self.near, unit="m")
        finite("far", self.far, self.near, unit="m")

    def sigma(self, depth: ArrayLike, camera: Camera) -> Array:
        """Return standard deviation of a measured depth of any shape [m], to first order.

        It grows with the square of the depth. A step, and a unit, leaves an error that is taken as
        evenly spread, so that its variance is a twelfth of its square.
        """
        return depth_deviation(np.asarray(depth, dtype=float), camera, self)


# A sensor of the kind that hangs above a table, with everything that this model has.
STEREO = Sensor(0.05, 0.1, 5, 1 / 32, 1e-4, 0.01, math.radians(80.0), 0.1, 4.0)


@register_jitable
def shared_noise(noise, window):
    """Return numbers of variance 1 whose neighbours share: sums over a square, over its side.

    Args:
        noise: independent numbers of variance 1, shape (H + window - 1, W + window - 1).
        window: side of the square [pixels].

    Returns:
        Shape (H, W).
    """
    if window == 1:
        return noise
    # A separable box filter: sums along columns, then along rows. Dividing by the side makes the
    # variance 1.
    height, width = noise.shape[0] - window + 1, noise.shape[1] - window + 1
    rows = noise[:height].copy()
    for k in range(1, window):
        rows += noise[k : k + height]
    sums = rows[:, :width].copy()
    for k in range(1, window):
        sums += rows[:, k : k + width]
    return sums / window


@register_jitable
def measure(exact, noise, camera, sensor):
    """Return the depths that a sensor measures, 0 where none is within its range, shape (H, W) [m].

    Args:
        exact: the exact picture, shape (H, W) [m].
        noise: of the disparities, of variance 1, shape (H, W).
        camera: intrinsics of the image.
        sensor: noise, resolution and range.
    """
    # Disparity is this product over depth.
    reach = camera.fx * sensor.baseline
    observed = exact > 0.0
    # Noise acts on the disparity, before it is rounded to the sensor's steps.
    disparity = reach / np.where(observed, exact, 1.0) + sensor.noise * noise
    if sensor.step > 0.0:
        disparity = np.rint(disparity / sensor.step) * sensor.step
    observed = observed & (disparity > 0.0)
    measured = reach / np.where(observed, disparity, 1.0)
    # The depth is stored in units, such as millimetres.
    if sensor.unit > 0.0:
        measured = np.rint(measured / sensor.unit) * sensor.unit
    observed = observed & (measured >= sensor.near) & (measured <= sensor.far)
    return np.where(observed, measured, 0.0)


def incidence(depth: Array, camera: Camera) -> Array:
    """Return angle between ray and normal at each pixel of an exact picture, shape (H, W) [rad].

    Along a plane the inverse depth is linear in the pixel, and its gradient gives the normal. Of
    the differences to both sides of a pixel the smaller counts, so that an edge is no slope.
    """
    x, y = camera.rays()
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse, slopes = 1.0 / depth, []
        # In a pinhole picture the inverse depth of a plane is linear in the pixel, so differences
        # of it are the plane's slopes. At an edge the smaller of the two differences is taken.
        for axis, f in ((1, camera.fx), (0, camera.fy)):
            across = f * np.diff(inverse, axis=axis)
            across[~np.isfinite(across)] = np.inf
            # At the margin of the image only one neighbour exists; an infinite difference is never
            # chosen.
            empty = np.full_like(inverse.take([0], axis), np.inf)
            before = np.concatenate((empty, across), axis)
            after = np.concatenate((across, empty), axis)
            slopes.append(np.where(np.abs(before) < np.abs(after), before, after))
        a, b = slopes
        c = inverse - a * x - b * y[:, None]
        # The plane a x + b y + c = 1 / z has the normal (a, b, c), whose product with the ray is 1
        # / z.
        length = np.sqrt((a * a + b * b + c * c) * (x * x + (y * y)[:, None] + 1.0))
        return np.arccos(np.minimum(inverse / length, 1.0))


def sense(depth: ArrayLike, camera: Camera, sensor: Sensor, rng: np.random.Generator) -> Array:
    """Return what a sensor makes of an exact picture.

    Modelled are noise, steps and limits, in this order: noise in disparity, shared over a window;
    steps of disparity; the depth unit; range; dropout by chance and where the surface is grazed.
    Left out: lens distortion, colour, pixels that mix two surfaces, the shadow of the second eye,
    other projectors, motion during the exposure.

    Args:
        depth: shape (H, W), 0 where nothing is [m].
        camera: intrinsics of the image.
        sensor: noise, resolution and range of the depth.
        rng: where the noise comes from.

    Returns:
        Shape (H, W), 0 where there is no measurement [m].

    Raises:
        ValueError: as for `Camera.picture`.
    """
    exact = camera.picture(depth)
    noise = np.zeros(exact.shape)
    if sensor.noise:
        more = sensor.window - 1
        noise = shared_noise(
            rng.standard_normal((exact.shape[0] + more, exact.shape[1] + more)), sensor.window
        )
    measured = measure(exact, noise, camera, sensor)
    if sensor.grazing < 0.5 * math.pi:
        measured[~(incidence(exact, camera) <= sensor.grazing)] = 0.0
    if sensor.dropout:
        measured[rng.random(exact.shape) < sensor.dropout] = 0.0
    return measured


def warm() -> None:
    """Compile the loop of this file."""
    compiled(_render, _SIGNATURE)
