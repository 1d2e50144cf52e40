"""Claims of chapter 10: transforms with time stamps, extrapolation, and clocks."""

from itertools import pairwise

import numpy as np

from course.derivations import claim

SYMBOLS: dict[str, str] = {}


def largest_error(motion, period, ahead, beyond, ends, noise=0.0, rng=None):
    """Return the largest error of the angle, so long after the newest stamp [rad].

    Args:
        motion: a swinging frame.
        period: between two transforms [s].
        ahead: after the newest stamp [s].
        beyond: see `TransformBuffer.lookup`.
        ends: newest stamps that are tried [s].
        noise: standard deviation of each stored angle [rad].
        rng: of the noise.
    """
    from course.middleware.transforms import TransformBuffer, angle_between

    largest = 0.0
    for end in ends:
        buffer = TransformBuffer()
        for stamp in (end - period, end):
            angle = motion.amplitude * np.sin(motion.rate * stamp)
            if rng is not None:
                angle += noise * rng.normal()
            buffer.insert(stamp, np.zeros(3), [np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])
        result = buffer.lookup([end + ahead], beyond).quaternion
        true = motion.at([end + ahead]).quaternion
        largest = max(largest, float(angle_between(result, true)[0]))
    return largest


@claim(
    "If the newest transform is a few milliseconds older than the requested time, tf2 extrapolates "
    "it.",
    "tf2 raises an ExtrapolationException for every time after the newest stamp, however short. "
    "Wait for the transform (a timeout), or request an earlier time. A program that extrapolates "
    "by itself pays for it: {ahead_ms:.0f} ms after the newest stamp, a camera that swings with at "
    "most {speed:.2f} m/s was up to {held_mm:.0f} mm away from the pose that was held. With "
    "{hz:.0f} transforms per second it was up to {straight_mm:.1f} mm from the one that was "
    "continued linearly.",
    source="geometry2, tf2/src/cache.cpp, Jazzy 2024; Foote, tf: The transform library, 2013",
)
def tf_extrapolates(result):
    from course.middleware.transforms import (
        ExtrapolationError,
        SwingingFrame,
        hold_bound,
        linear_bound,
        sample,
    )

    motion, hz = SwingingFrame(), result.input("hz", 50)
    ahead = 1e-3 * result.input("ahead_ms", 20)
    speed = result.measure("speed", motion.speed)
    errors = {"hold": 0.0, "linear": 0.0}
    ends = np.linspace(4.0, 6.0, 100)

    def looked_up(end, later):
        """Return the distance of a refusing lookup from the true position [m], or None."""
        try:
            place = sample(motion, 1.0 / hz, end, cache=0.1).lookup(end + later).position
        except ExtrapolationError:
            return None
        return float(np.linalg.norm(place - motion.at(end + later).position[:, 0]))

    for end in ends:
        buffer = sample(motion, 1.0 / hz, end, cache=0.1)
        true = motion.at(end + ahead).position[:, 0]
        for how in errors:
            place = buffer.lookup(end + ahead, how).position
            errors[how] = max(errors[how], float(np.linalg.norm(place - true)))
    held = result.measure("held_mm", 1e3 * errors["hold"], 0.01)
    straight = result.measure("straight_mm", 1e3 * errors["linear"], 0.01)
    result.statement = "A buffer with tf2's rule, at 100 newest stamps of a swinging camera."
    # However little ahead of the newest stamp, and at the stamp itself, which is no extrapolation.
    little = result.rng.uniform(1e-9, 0.1, ends.size)
    result.statement_holds(
        any(
            looked_up(float(end), float(later)) is not None
            for end, later in zip(ends, little, strict=True)
        )
    )
    result.correction_holds(
        max(looked_up(float(end), 0.0) for end in ends) < 1e-9,
        straight < held,
        bool(held <= 1e3 * hold_bound(ahead, speed)),
        bool(straight <= 1e3 * linear_bound(ahead, motion.acceleration, 1.0 / hz)),
    )


@claim(
    "Twice as many transforms per second halve the error of a lookup between two of them.",
    "They divide it by {ratio:.1f}. Between two stamps tf2 interpolates linearly, and the error "
    "is at most a T^2 / 8, with the acceleration a and the time T between the stamps. With "
    "{hz:.0f} transforms per second the swinging camera was misplaced by up to {error_mm:.2f} mm, "
    "with twice as many by up to {twice_mm:.2f} mm. If the newest transform is held instead, twice "
    "as many do halve the error.",
    source="Foote, tf: The transform library, 2013; the remainder of linear interpolation",
)
def half_period_half_error(result):
    from course.middleware.transforms import SwingingFrame, interpolation_bound, sample

    motion, hz = SwingingFrame(), result.input("hz", 10)
    t = np.linspace(4.0, 8.0, 4001)

    def between(rate):
        place = sample(motion, 1.0 / rate, 10.0).lookup(t).position
        return float(np.linalg.norm(place - motion.at(t).position, axis=0).max())

    def held(rate):
        # The newest transform at each time is up to one period old.
        return max(
            float(np.linalg.norm(motion.at(x).position - motion.at(x - 1.0 / rate).position))
            for x in t[::20]
        )

    rates = [float(hz) * 2**k for k in range(4)]
    errors = [between(rate) for rate in rates]
    result.measure("error_mm", 1e3 * errors[0], 0.01)
    result.measure("twice_mm", 1e3 * errors[1], 0.01)
    ratio = result.measure("ratio", errors[0] / errors[1], 0.02)
    result.statement = "Lookups between the stamps of a swinging camera, at four rates."
    result.statement_holds(abs(ratio - 2.0) < 0.5)
    result.correction_holds(
        all(3.8 < a / b < 4.2 for a, b in pairwise(errors)),
        all(
            0.9 * interpolation_bound(1.0 / rate, motion.acceleration)
            < error
            <= interpolation_bound(1.0 / rate, motion.acceleration)
            for rate, error in zip(rates, errors, strict=True)
        ),
        all(1.8 < held(a) / held(b) < 2.2 for a, b in pairwise(rates)),
    )


@claim(
    "After the newest transform, continuing with the last velocity is more accurate than holding "
    "the newest pose.",
    "For a sine with exact and frequent transforms, the largest error of the linear continuation "
    "is smaller up to {share:.0%} of a swing. Beyond that the motion has turned back, and the "
    "line has not. Noise shortens the look-ahead: with {hz:.0f} transforms per second, the line "
    "through the last two multiplies their noise by {gain:.0f} at a look-ahead of {ahead_ms:.0f} "
    "ms. A slow motion is then better held.",
    source="the remainder of linear interpolation; variance of a linear combination",
)
def linear_beats_hold(result):
    from course.middleware.transforms import SwingingFrame

    # Of a sine: the errors are 2 sin(x / 2) and |exp(ix) - 1 - ix|, equal where x = 2 sin x.
    limit = 1.5
    for _ in range(100):
        limit = 2.0 * np.sin(limit)
    share = result.measure("share", limit / (2.0 * np.pi), 1e-3)

    def better(amplitude, swings, ahead_swings):
        """Return whether the line is more accurate, by its largest error over a swing."""
        motion = SwingingFrame(amplitude, 2.0 * np.pi * swings)
        ends = 5.0 / swings + np.linspace(0.0, 1.0, 60) / swings
        # Frequent: two thousand transforms in a swing.
        line, held = (
            largest_error(motion, 5e-4 / swings, ahead_swings / swings, how, ends)
            for how in ("linear", "hold")
        )
        return line < held

    hz, ahead = result.input("hz", 50), 1e-3 * result.input("ahead_ms", 100)
    slow, noise = SwingingFrame(0.01, 0.2), result.input("noise_rad", 0.002)
    ends = np.linspace(4.0, 30.0, 300)
    noisy = [
        largest_error(slow, 1.0 / hz, ahead, how, ends, noise, result.rng)
        for how in ("linear", "hold")
    ]
    # A frame at rest shows what the line makes of noise: about the root of (1 + h/T)^2 + (h/T)^2.
    still = SwingingFrame(1e-12, 1.0)
    spread = [
        largest_error(still, 1.0 / hz, ahead, "linear", [end], noise, result.rng)
        for end in np.linspace(4.0, 5.0, 3000)
    ]
    factor = float(np.sqrt(np.mean(np.square(spread)))) / noise
    result.measure("gain", factor, 0.1)
    result.statement = "Swings of random size and frequency, and a slow one with noise."
    result.statement_holds(
        noisy[0] < noisy[1],
        only_if="the motion is a sine, its transforms are exact and frequent, and the look-ahead "
        "is below {share:.0%} of a swing",
        inside=[
            better(a, f, x * share)
            for a, f, x in zip(
                result.rng.uniform(0.05, 1.0, 10),
                result.rng.uniform(0.1, 5.0, 10),
                [0.98, 0.97, *result.rng.uniform(0.02, 0.96, 8)],
                strict=True,
            )
        ]
        # Chosen to break it: swings of a quarter turn and of nearly half a turn to each side.
        + [better(a, 0.7, x * share) for a in (0.5 * np.pi, 3.0) for x in (0.1, 0.9, 0.97)],
        outside=[
            better(a, f, x * share)
            for a, f, x in zip(
                result.rng.uniform(0.05, 0.6, 8),
                result.rng.uniform(0.1, 5.0, 8),
                [1.02, 1.03, *result.rng.uniform(1.04, 1.6, 6)],
                strict=True,
            )
        ],
    )
    result.correction_holds(
        abs(limit - 2.0 * np.sin(limit)) < 1e-9,
        noisy[0] > 2.0 * noisy[1],
        abs(factor / np.hypot(1.0 + ahead * hz, ahead * hz) - 1.0) < 0.1,
    )


@claim(
    "If the clock of the computer that sends transforms is wrong, lookups fail.",
    "Inside the buffer nothing fails. The lookup returns the pose of another moment, and the error "
    "is up to the speed times the offset: at {speed:.2f} m/s and {offset_ms:.0f} ms up to "
    "{error_mm:.0f} mm, without an exception. A lookup of a certain time, not of the newest "
    "transform, fails if the clock is further behind than this time is old plus the lookup's "
    "timeout, or ahead by nearly the length of the buffer. Mixed use_sim_time does this: one node "
    "uses simulated time and another wall time, which differ by decades.",
    source="geometry2, tf2/src/cache.cpp, Jazzy 2024; ROS 2 design, Clock and Time, 2015",
)
def wrong_clock_fails(result):
    from course.middleware.transforms import CACHE, ExtrapolationError, SwingingFrame, sample

    motion, hz, now = SwingingFrame(), 100.0, 20.0
    late = 0.2

    def looked_up(offset, requested=now - late):
        """Return the error of a lookup with a sender whose clock is ahead by so much, or None."""
        try:
            place = sample(motion, 1.0 / hz, now, offset=offset).lookup(requested).position
        except ExtrapolationError:
            return None
        return float(np.linalg.norm(place - motion.at(requested).position[:, 0]))

    def jumped(back, ago=0.1):
        """Return whether a lookup fails where the sender's clock went back only so long ago [s]."""
        buffer = sample(motion, 1.0 / hz, now - ago)
        for time in np.arange(now - ago + 1.0 / hz, now, 1.0 / hz):
            pose = motion.at(time)
            buffer.insert(time - back, pose.position[:, 0], pose.quaternion[:, 0])
        try:
            buffer.lookup(now - late)
        except ExtrapolationError:
            return True
        return False

    def waits(offset, timeout=1.0):
        """Return whether a lookup still fails after it has waited for its timeout [s]."""
        buffer = sample(motion, 1.0 / hz, now + timeout, offset=offset)
        try:
            buffer.lookup(now - late)
        except ExtrapolationError:
            return True
        return False

    def newest(offset):
        """Return whether a lookup of the newest transform fails."""
        buffer = sample(motion, 1.0 / hz, now, offset=offset)
        return not np.isfinite(buffer.lookup(buffer.newest).position).all()

    speed = result.measure("speed", motion.speed)
    offset = 1e-3 * result.input("offset_ms", 50)
    errors = [
        looked_up(sign * offset, float(at))
        for at in np.linspace(now - 3.0, now - late, 60)
        for sign in (-1.0, 1.0)
    ]
    silent = [one for one in errors if one is not None]
    error = result.measure("error_mm", 1e3 * max(silent), 0.02)
    dropped_after = CACHE - late
    result.statement = "A sender with its clock at random offsets; lookups 0.2 s in the past."
    result.statement_holds(
        looked_up(offset) is None,
        only_if="the transform is not static, and the lookup requests a certain time, of age x, "
        "and not the newest transform. Since before that time, the clock has been behind by more "
        "than x plus the timeout, or ahead by more than the buffer's length minus x",
        inside=[
            looked_up(float(x)) is None
            for x in (
                -late - 1e-6,
                dropped_after + 1e-3,
                1.7e9,
                -1.7e9,
                *-(late + result.rng.uniform(1e-3, 5.0, 4)),
                *(dropped_after + result.rng.uniform(1e-2, 5.0, 4)),
            )
        ]
        + [waits(-late - 1.0 - 1e-6)],
        outside=[
            looked_up(float(x)) is None
            for x in (
                -late + 1e-6,
                dropped_after - 0.02,
                *-result.rng.uniform(0.0, 0.95 * late, 4),
                *result.rng.uniform(0.0, 0.95 * dropped_after, 4),
            )
        ]
        # Chosen to break it: a clock that went wrong a moment ago, lookups of the newest, and
        # lookups with a timeout.
        + [jumped(x) for x in (0.5, 3.0, 9.0)]
        + [newest(x) for x in (-1.7e9, -5.0, 5.0, 1.7e9)]
        + [waits(-late - x) for x in (0.2, 0.9)],
    )
    result.correction_holds(
        len(silent) == len(errors),
        bool(0.9 * offset * speed < 1e-3 * error <= offset * speed + 1e-4),
    )


@claim(
    "When a simulation starts again at time zero, the transform buffers of the other nodes "
    "continue with the new transforms.",
    "Only a buffer that is cleared does. Without that, a jump back by more than the buffer's "
    "{cache:.0f} s made it ignore all of {sent:.0f} new transforms, because they were older than "
    "what it stores. After a jump by less it stored them between those of the previous run, and "
    "{mixed:.0%} of the lookups of the newest transform returned a pose of the previous run. "
    "tf2_ros clears its buffer when its node's clock jumps back. That needs use_sim_time in this "
    "node, too.",
    source="geometry2, tf2/src/cache.cpp and tf2_ros/src/buffer.cpp, Jazzy 2024",
)
def restart_continues(result):
    from course.middleware.transforms import CACHE, SwingingFrame, sample

    motion, end = SwingingFrame(), 30.0
    cache = result.measure("cache", CACHE)
    sent = int(result.input("sent", 100))

    def again(back, clears):
        """Return transforms ignored after the jump, and the share of lookups of the old run."""
        buffer = sample(motion, 0.05, end)
        old = 0
        if clears:
            buffer.clear()
        for k in range(sent):
            # In the new run the camera is somewhere else: one metre above.
            buffer.insert(end - back + 0.01 * k, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0])
            old += bool(buffer.lookup(buffer.newest).position[2] < 0.5)
        return buffer.ignored, old / sent

    far = [again(float(x), False) for x in result.rng.uniform(1.2 * cache, 2.9 * cache, 6)]
    near = [again(float(x), False) for x in result.rng.uniform(0.2 * cache, 0.9 * cache, 6)]
    clear = [again(float(x), True) for x in result.rng.uniform(0.2 * cache, 2.9 * cache, 6)]
    mixed = result.measure("mixed", min(old for _, old in near), 0.01)
    result.statement = "Clocks that jump back by random times, with and without clearing."
    result.statement_holds(all(one == (0, 0.0) for one in far + near))
    result.correction_holds(
        all(lost == sent for lost, _ in far),
        all(lost == 0 for lost, _ in near),
        mixed > 0.99,
        all(one == (0, 0.0) for one in clear),
    )
