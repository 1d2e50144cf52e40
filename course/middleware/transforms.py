"""Transforms with time stamps, as tf2 stores them, and what a lookup between or after them costs.

`TransformBuffer` holds the poses of one moving frame in a fixed one. Between two stamps it
interpolates: the position linearly, the orientation along the shortest rotation (slerp). tf2 does
the same and refuses anything else (`ExtrapolationError`); "hold" and "linear" are what people
program instead. `hold_bound`, `linear_bound` and `interpolation_bound` say what each may cost.

Sources: Foote, tf: The transform library, 2013; Shoemake, Animating rotation with quaternion
curves, 1985; geometry2 (Jazzy, 2024), tf2/src/cache.cpp and tf2_ros/src/buffer.cpp.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import finite, invalid, one_of, positive, vector
from course.rigid_body.quaternion import conjugate, exp, product, unit_quaternion

Array = NDArray[np.float64]
CACHE = 10.0  # s: for how long tf2 stores a transform by default
METHODS = ("refuse", "hold", "linear")


class ExtrapolationError(LookupError):
    """No stored transforms on both sides of the requested time; named after tf2's exception."""


class Poses(NamedTuple):
    """Poses of the moving frame in the fixed one.

    Attributes:
        position: shape (3,) or (3, N) [m].
        quaternion: scalar first, shape (4,) or (4, N).
    """

    position: Array
    quaternion: Array


def _shortest(a: Array, b: Array) -> Array:
    """Return the rotation vectors from a to b, at most half a turn; shape (3, N) [rad]."""
    turn = product(conjugate(a), b)
    # q and -q are the same rotation: the one with a positive scalar part is the shorter way.
    turn = np.where(turn[0] < 0.0, -turn, turn)
    length = np.sqrt(turn[1] ** 2 + turn[2] ** 2 + turn[3] ** 2)
    # The arc tangent is accurate for small angles, where the arc cosine loses half the digits.
    angle = 2.0 * np.arctan2(length, turn[0])
    factor = np.where(length > 0.0, angle / np.where(length > 0.0, length, 1.0), 2.0)
    return factor * turn[1:]


def slerp(a: Array, b: Array, share: Array) -> Array:
    """Return orientations on the shortest rotation from a to b (Shoemake, 1985).

    Args:
        a: unit quaternions, shape (4, N).
        b: unit quaternions, shape (4, N).
        share: 0 for a, 1 for b; beyond these the rotation continues at the same rate. Shape (N,).

    Returns:
        Unit quaternions, shape (4, N).
    """
    return product(a, exp(np.ascontiguousarray(share * _shortest(a, b))))


def angle_between(a: Array, b: Array) -> Array:
    """Return the angles of the rotations from a to b, shapes (4, N) to (N,) [rad]."""
    return np.sqrt(np.sum(_shortest(a, b) ** 2, axis=0))


class TransformBuffer:
    """The transforms of one moving frame, sorted by their stamps.

    Args:
        cache: for how long a transform is stored, counted back from the newest stamp [s].

    Attributes:
        ignored: how many transforms were older than the cache when they came, and were not stored.
    """

    def __init__(self, cache: float = CACHE) -> None:
        self.cache, self.ignored = positive("cache", cache, unit="s"), 0
        self._stamps: list[float] = []
        self._poses: list[Array] = []
        self._packed: tuple[Array, Array] | None = None

    def __len__(self) -> int:
        return len(self._stamps)

    def insert(self, stamp: float, position: ArrayLike, quaternion: ArrayLike) -> bool:
        """Store a transform in the order of the stamps; one that is too old is ignored.

        Args:
            stamp: when the pose was true, by the clock of the sender [s].
            position: shape (3,) [m].
            quaternion: scalar first, shape (4,).

        Returns:
            Whether it was stored. Like tf2, the buffer ignores a stamp that is more than `cache`
            older than the newest one.
        """
        time = finite("stamp", stamp, unit="s")
        pose = np.concatenate(
            (vector("position", position, (3,)), unit_quaternion(quaternion).reshape(4))
        )
        if self._stamps and time < self._stamps[-1] - self.cache:
            self.ignored += 1
            return False
        at = int(np.searchsorted(self._stamps, time))
        if at < len(self._stamps) and self._stamps[at] == time:
            self._poses[at] = pose
        else:
            self._stamps.insert(at, time)
            self._poses.insert(at, pose)
        # What has outlived the cache is dropped from the old end.
        while self._stamps[0] < self._stamps[-1] - self.cache:
            del self._stamps[0], self._poses[0]
        self._packed = None
        return True

    def clear(self) -> None:
        """Forget all transforms, as tf2 does when its clock jumps back."""
        self._stamps.clear()
        self._poses.clear()
        self._packed = None

    @property
    def newest(self) -> float:
        """The newest stamp [s]: what tf2 returns a transform for where time 0 is requested.

        Raises:
            ExtrapolationError: the buffer is empty.
        """
        if not self._stamps:
            raise ExtrapolationError("the buffer is empty: no transform was stored yet")
        return self._stamps[-1]

    def lookup(self, times: ArrayLike, beyond: str = "refuse") -> Poses:
        """Return the poses at these times.

        Args:
            times: shape () or (N,) [s].
            beyond: what to do after the newest stamp: "refuse" raises, as tf2 does; "hold" repeats
                the newest pose; "linear" continues with the velocity between the last two stamps.

        Returns:
            Poses of shape (3,) and (4,), or (3, N) and (4, N).

        Raises:
            ExtrapolationError: a time before the oldest stamp, or after the newest one with
                "refuse"; the message says by how much.
        """
        one_of("beyond", beyond, METHODS)
        requested = vector("times", times, (), (None,))
        t = np.atleast_1d(requested)
        last = self.newest
        first = self._stamps[0]
        if t.size and t.min() < first:
            raise ExtrapolationError(
                f"lookup would require extrapolation into the past: requested {t.min():.3f} s, "
                f"{first - t.min():.3g} s before the earliest data"
            )
        if beyond == "refuse" and t.size and t.max() > last:
            raise ExtrapolationError(
                f"lookup would require extrapolation into the future: requested {t.max():.3f} s, "
                f"{t.max() - last:.3g} s after the latest data"
            )
        stamps, poses = self._arrays()
        if len(stamps) == 1:
            if beyond == "linear" and t.max() > last:
                raise ExtrapolationError("one stored transform has no velocity: store a second one")
            result = np.repeat(poses, len(t), axis=1)
        else:
            # The pair of stamps around each time; after the newest stamp, the last pair.
            k = np.clip(np.searchsorted(stamps, t, side="right") - 1, 0, len(stamps) - 2)
            share = (t - stamps[k]) / (stamps[k + 1] - stamps[k])
            if beyond == "hold":
                share = np.minimum(share, 1.0)
            a, b = poses[:, k], poses[:, k + 1]
            result = np.concatenate(
                (a[:3] + share * (b[:3] - a[:3]), slerp(a[3:].copy(), b[3:].copy(), share))
            )
        if not requested.ndim:
            result = result[:, 0]
        return Poses(result[:3], result[3:])

    def _arrays(self) -> tuple[Array, Array]:
        # Packed once after an insertion, so that a batch of lookups does not copy for each time.
        if self._packed is None:
            self._packed = np.array(self._stamps), np.array(self._poses).T.copy()
        return self._packed


def hold_bound(ahead: ArrayLike, speed: float) -> Array:
    """Return the largest error of a pose that is held: speed times look-ahead.

    Args:
        ahead: time after the newest stamp [s].
        speed: largest of the motion [m/s], or [rad/s].
    """
    return finite("speed", speed, 0.0) * np.asarray(ahead, dtype=float)


def linear_bound(ahead: ArrayLike, acceleration: float, period: float) -> Array:
    """Return the largest error of linear extrapolation: a h (h + T) / 2.

    The remainder of linear interpolation, evaluated outside of its interval. It is of second order
    in h where h exceeds the period T between the last two stamps, of first order below.

    Args:
        ahead: time h after the newest stamp [s].
        acceleration: largest of the motion [m/s^2]; of a rotation about a fixed axis [rad/s^2].
        period: T between the last two stamps [s].
    """
    h = np.asarray(ahead, dtype=float)
    largest = finite("acceleration", acceleration, 0.0)
    return 0.5 * largest * h * (h + positive("period", period, unit="s"))


def interpolation_bound(period: ArrayLike, acceleration: float) -> Array:
    """Return the largest error of linear interpolation between stamps: a T^2 / 8.

    Args:
        period: T between two stamps [s].
        acceleration: largest of the motion [m/s^2]; of a rotation about a fixed axis [rad/s^2].
    """
    return finite("acceleration", acceleration, 0.0) * np.asarray(period, dtype=float) ** 2 / 8.0


class SwingingFrame(NamedTuple):
    """A camera on a link that swings about a vertical axis through the origin.

    The angle is amplitude sin(rate t), and the camera sits at a distance `radius` from the axis.
    Largest angular velocity and acceleration are amplitude rate and amplitude rate^2.
    """

    amplitude: float = 0.5
    rate: float = 2.0 * np.pi * 0.5
    radius: float = 0.6

    def at(self, times: ArrayLike) -> Poses:
        """Return the true poses, shapes (3, N) and (4, N)."""
        t = np.atleast_1d(np.asarray(times, dtype=float))
        angle = self.amplitude * np.sin(self.rate * t)
        zero = np.zeros_like(t)
        position = self.radius * np.stack((np.cos(angle), np.sin(angle), zero))
        return Poses(position, np.stack((np.cos(angle / 2.0), zero, zero, np.sin(angle / 2.0))))

    @property
    def speed(self) -> float:
        """Largest speed of the camera [m/s]."""
        return self.radius * self.amplitude * self.rate

    @property
    def acceleration(self) -> float:
        """A bound on the acceleration of the camera [m/s^2].

        Tangential r A w^2 |sin| and centripetal r A^2 w^2 cos^2 are never largest together:
        with c = cos^2, the square is r^2 A^2 w^4 (1 - c + A^2 c^2), largest at an end of c in
        [0, 1] because it is convex in c.
        """
        largest = max(1.0, self.amplitude)
        return self.radius * self.amplitude * self.rate**2 * largest


def sample(
    motion: SwingingFrame, period: float, end: float, cache: float = CACHE, offset: float = 0.0
) -> TransformBuffer:
    """Return a buffer with the transforms of a motion, one each period, up to a time.

    Args:
        motion: true motion.
        period: between two transforms [s].
        end: of the newest stamp [s], at least one period.
        cache: see `TransformBuffer`.
        offset: of the sender's clock, which is added to each stamp [s].
    """
    positive("period", period, unit="s")
    if not end >= period:
        raise invalid("end", end, f"at least one period, {period} s")
    buffer = TransformBuffer(cache)
    # Stamps count back from the end, so that the newest one is exact.
    for back in range(int(min(cache, end) / period + 1e-9), -1, -1):
        time = end - back * period
        pose = motion.at(time)
        buffer.insert(time + offset, pose.position[:, 0], pose.quaternion[:, 0])
    return buffer
