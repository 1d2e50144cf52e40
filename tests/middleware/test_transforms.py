"""Lookups of transforms: SciPy's slerp, closed forms and bounds are the independent truth."""

import numpy as np
import pytest

from course.middleware import transforms
from course.middleware.transforms import (
    ExtrapolationError,
    SwingingFrame,
    TransformBuffer,
    angle_between,
    hold_bound,
    interpolation_bound,
    linear_bound,
    sample,
)

MOTION = SwingingFrame()


def errors(buffer, times, motion=MOTION, beyond="refuse"):
    """Return the errors of position [m] and angle [rad] of lookups."""
    result, true = buffer.lookup(times, beyond), motion.at(times)
    return (
        np.linalg.norm(result.position - true.position, axis=0),
        angle_between(result.quaternion, true.quaternion),
    )


def random_buffer(rng, n=30):
    """Return random stamps and poses, also as SciPy's rotations."""
    from scipy.spatial.transform import Rotation

    stamps = np.cumsum(rng.uniform(0.01, 0.2, n))
    turns = Rotation.random(n, rng=rng)
    places = rng.normal(size=(n, 3))
    buffer = TransformBuffer()
    for k in rng.permutation(n):
        # The order of arrival does not matter, and either sign of a quaternion is right.
        sign = rng.choice((-1.0, 1.0))
        buffer.insert(stamps[k], places[k], sign * turns[k].as_quat(scalar_first=True))
    return buffer, stamps, places, turns


@pytest.mark.parametrize("seed", range(5))
def test_interpolation_is_what_scipy_computes(seed):
    from scipy.spatial.transform import Slerp

    rng = np.random.default_rng(seed)
    buffer, stamps, places, turns = random_buffer(rng)
    t = np.concatenate((stamps, rng.uniform(stamps[0], stamps[-1], 200)))
    result = buffer.lookup(t)
    expected = Slerp(stamps, turns)(t).as_quat(scalar_first=True).T
    assert angle_between(result.quaternion, expected).max() < 1e-12
    straight = [np.interp(t, stamps, places[:, k]) for k in range(3)]
    np.testing.assert_allclose(result.position, straight, atol=1e-12)
    one = buffer.lookup(float(t[-1]))
    np.testing.assert_allclose(one.position, result.position[:, -1], atol=1e-12)


def test_a_time_outside_is_refused_and_the_message_says_by_how_much():
    buffer = sample(MOTION, 0.02, 5.0)
    with pytest.raises(ExtrapolationError, match=r"future.*0.003 s after"):
        buffer.lookup(5.003)
    with pytest.raises(ExtrapolationError, match=r"past.*0.01 s before"):
        buffer.lookup([4.0, -0.01])
    with pytest.raises(ExtrapolationError, match="empty"):
        TransformBuffer().lookup(0.0)
    # At the ends themselves the stored pose is returned.
    assert max(map(np.max, errors(buffer, [0.0, 5.0]))) < 1e-12


def test_the_bounds_are_true_and_reached_in_order():
    ends = np.linspace(4.0, 6.0, 160)
    for period in (0.01, 0.05):
        for ahead in (0.005, 0.02, 0.1):
            worst = {name: np.zeros(2) for name in ("hold", "linear")}
            for end in ends:
                buffer = sample(MOTION, period, end, cache=3 * period)
                for name, value in worst.items():
                    place, angle = errors(buffer, np.array([end + ahead]), beyond=name)
                    worst[name] = np.maximum(value, [place[0], angle[0]])
            scales = np.array([MOTION.radius, 1.0]) * MOTION.amplitude
            held = hold_bound(ahead, MOTION.rate) * scales
            straight = linear_bound(ahead, MOTION.rate**2, period) * scales
            assert (worst["hold"] <= held * (1 + 1e-9)).all()
            assert (worst["linear"] <= straight * (1 + 1e-9)).all()
            # Bounds that were far too large would prove nothing.
            assert (worst["hold"] > 0.95 * held).all()
            assert (worst["linear"] > 0.9 * straight).all()


def test_interpolation_is_of_second_order_and_below_its_bound():
    t = np.linspace(4.0, 8.0, 4001)
    worst = []
    for period in (0.2, 0.1, 0.05):
        place, angle = errors(sample(MOTION, period, 10.0), t)
        bound = interpolation_bound(period, MOTION.acceleration)
        assert 0.9 * bound < place.max() <= bound
        assert angle.max() <= interpolation_bound(period, MOTION.amplitude * MOTION.rate**2)
        worst.append(place.max())
    np.testing.assert_allclose(np.divide(worst[:-1], worst[1:]), 4.0, rtol=0.05)


def test_order_two_also_for_a_body_whose_axis_turns():
    """No fixed axis here; a reference from chapter 1's product of two rotations."""
    from course.rigid_body.quaternion import exp, product

    def tumble(t):
        zero = np.zeros_like(t)
        return product(
            exp(np.stack((zero, zero, 2.0 * t))), exp(np.stack((1.5 * np.sin(t), t, zero)))
        )

    t, worst = np.linspace(1.0, 2.0, 999), []
    for period in (0.1, 0.05, 0.025):
        buffer = TransformBuffer()
        for stamp in np.arange(0.0, 3.0, period):
            buffer.insert(stamp, np.zeros(3), tumble(np.array([stamp]))[:, 0])
        worst.append(angle_between(buffer.lookup(t).quaternion, tumble(t)).max())
    np.testing.assert_allclose(np.divide(worst[:-1], worst[1:]), 4.0, rtol=0.1)


def test_linear_is_better_than_hold_up_to_a_limit():
    """For a sine and frequent transforms the curves cross at w h = 2 sin(w h), 1.895."""
    times = np.linspace(4.0, 6.0, 200)

    def worst(ahead, beyond):
        rows = (
            errors(sample(MOTION, 1e-3, e, 3e-3), np.array([e + ahead]), beyond=beyond)
            for e in times
        )
        return max(angle.item() for _, angle in rows)

    limit = 1.8954942 / MOTION.rate
    assert np.isclose(1.8954942, 2.0 * np.sin(1.8954942))
    assert worst(0.95 * limit, "linear") < worst(0.95 * limit, "hold")
    assert worst(1.05 * limit, "linear") > worst(1.05 * limit, "hold")


def test_old_transforms_are_dropped_and_too_old_ones_ignored():
    buffer = sample(MOTION, 0.1, 30.0)
    assert len(buffer) == 101
    assert not buffer.insert(19.9, np.zeros(3), [1.0, 0.0, 0.0, 0.0]) and buffer.ignored == 1
    assert buffer.insert(20.05, np.zeros(3), [1.0, 0.0, 0.0, 0.0])
    with pytest.raises(ExtrapolationError):
        buffer.lookup(19.95)


@pytest.mark.parametrize(("back", "stored"), [(5.0, True), (15.0, False)])
def test_a_clock_that_jumps_back_mixes_two_runs_or_stops_the_buffer(back, stored):
    """A simulation starts again, and the camera now rests; nobody clears the buffer."""
    buffer, end = sample(MOTION, 0.1, 30.05), 30.05
    assert buffer.insert(end - back, np.zeros(3), [1.0, 0.0, 0.0, 0.0]) is stored
    # The newest transform is one of the previous run either way.
    assert buffer.newest == end
    assert np.linalg.norm(buffer.lookup(buffer.newest).position) > 0.5
    buffer.clear()
    assert buffer.insert(end - back, np.zeros(3), [1.0, 0.0, 0.0, 0.0])
    assert not buffer.lookup(end - back).position.any()


def test_a_wrong_clock_is_silent_inside_the_buffer_and_loud_outside():
    now, late = 5.0, 0.1
    # The sender's clock is ahead by less than the age of the lookup, or behind it: no message.
    for offset in (-0.08, 0.05):
        place, _ = errors(sample(MOTION, 0.01, now, offset=offset), np.array([now - late]))
        assert 0.2 * abs(offset) * MOTION.speed < place[0] <= abs(offset) * MOTION.speed * 1.001
    with pytest.raises(ExtrapolationError, match="future"):
        sample(MOTION, 0.01, now, offset=-0.12).lookup(now - late)
    # Wall-clock stamps looked up with simulated time, and the reverse.
    with pytest.raises(ExtrapolationError, match="past"):
        sample(MOTION, 0.01, now, offset=1.7e9).lookup(now)
    with pytest.raises(ExtrapolationError, match="future"):
        sample(MOTION, 0.01, now).lookup(1.7e9)


def test_wrong_input_is_named():
    buffer = TransformBuffer()
    for call, words in (
        (lambda: TransformBuffer(0.0), "cache must be"),
        (lambda: buffer.insert(np.nan, np.zeros(3), [1, 0, 0, 0]), "stamp must be"),
        (lambda: buffer.insert(0.0, np.zeros(2), [1, 0, 0, 0]), "position"),
        (lambda: buffer.insert(0.0, np.zeros(3), [1, 1, 0, 0]), "quaternion"),
        (lambda: sample(MOTION, 0.1, 5.0).lookup(1.0, "cubic"), "beyond must be"),
        (lambda: sample(MOTION, 0.1, 0.05), "end must be"),
        (lambda: transforms.linear_bound(0.1, -1.0, 0.1), "acceleration must be"),
    ):
        with pytest.raises(ValueError, match=words):
            call()
    assert buffer.insert(1.0, np.zeros(3), [1.0, 0.0, 0.0, 0.0])
    with pytest.raises(ExtrapolationError, match="second one"):
        buffer.lookup(1.1, "linear")
    assert not buffer.lookup([1.0, 1.1], "hold").position.any()
