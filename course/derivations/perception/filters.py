"""Claims of chapter 7: when a measurement of a filter is valid."""

import numpy as np

from course.derivations import claim


@claim(
    "If a legged robot's contact sensor is late, a gate on the innovation rejects the wrong leg "
    "readings.",
    "Right after lift-off the wrong reading hardly differs from the right one, so it passes the "
    "gate, and the filter is pulled away and becomes sure of itself. With a sensor that is up to "
    "{late:.0f} samples late, {gated:.0%} of the runs with a gate had more than "
    "{factor:.0f} times the Cramér-Rao bound as their height error. With a test for load in the "
    "accelerometer, which shows lift-off at once, it was {loaded:.0%}. Over all of these runs the "
    "error was then {ratio:.2f} times the bound.",
)
def gate_replaces_contact(result):
    from course.perception.hopper import hop_bound, hop_filter, hop_logs

    late, factor = int(result.input("late", 4)), result.input("factor", 3)

    def errors(logs, rule):
        """Return the mean squared height errors of logs and their bounds, from a third on."""
        rows = []
        for log in logs:
            scored = len(log.force) // 3
            away = hop_filter(log, rule)[0][scored:, 0] - log.height[scored:]
            rows.append((np.mean(away**2), np.mean(hop_bound(log)[scored:, 0, 0])))
        return np.array(rows).T

    logs = hop_logs(result.rng, 150, late=late)
    gate, load = (errors(logs, rule) for rule in ("flag and gate", "load and gate"))
    gated, loaded = (float(np.mean(a > factor**2 * b)) for a, b in (gate, load))
    result.measure("gated", gated, 0.3)
    result.measure("loaded", loaded, 0.05)
    ratio = result.measure("ratio", float(np.sqrt(load[0].mean() / load[1].mean())), 0.1)
    result.statement = (
        "Simulated hoppers with a noisy accelerometer, a leg encoder and a late contact sensor."
    )
    # A sensor that is right needs no gate: the lateness is what does the harm.
    right = errors(hop_logs(result.rng, 60, late=0, wrong=0.0), "flag and gate")
    result.statement_holds(gated <= loaded)
    result.correction_holds(
        gated > 0.25,
        loaded < 0.05,
        0.85 < ratio < 1.15,
        float(np.sqrt(right[0].mean() / right[1].mean())) < 1.2,
    )


def _imu(rng, n=100, spin=1.0):
    """Return gyroscope and accelerometer of a moving head: smooth, with gravity in it, (3, n)."""
    t = np.linspace(0.0, 1.0, n)
    waves = rng.normal(0.0, 1.0, (2, 3, 3)) @ np.array([np.sin(3 * t), np.cos(5 * t), np.ones(n)])
    return spin * waves[0], 3.0 * waves[1] + np.array([[0.0], [0.0], [9.81]])


def _apart(a, b):
    """Return the differences of two increments: angle, velocity, position."""
    from course.rigid_body import quaternion

    return np.array(
        [
            quaternion.angle_between(a.rotation, b.rotation),
            np.linalg.norm(a.velocity - b.velocity),
            np.linalg.norm(a.position - b.position),
        ]
    )


@claim(
    "When an optimiser moves the pose or the velocity at the first image, the IMU samples up to "
    "the second have to be integrated again.",
    "The increments of rotation, velocity and position in the axes of the first image do not "
    "depend on the start. Computed once and combined with {starts:.0f} random start states, they "
    "agree with integration in world axes to better than {bound:.0e} of the distance. A change of "
    "the gyroscope's bias by {shift:g} rad/s does change them: the velocity by {moved:.3f} m/s.",
    source="T. Lupton, S. Sukkarieh, Visual-inertial-aided navigation ..., 2012",
)
def imu_start_again(result):
    from course.perception.preintegration import preintegrate
    from course.rigid_body import quaternion

    dt = 5e-3

    def in_world(gyro, force, q, v, p, gravity):
        """Integrate the same held samples in world axes, from one start state."""
        for w, f in zip(gyro.T, force.T, strict=True):
            a = quaternion.rotate(q, f) + gravity
            p, v = p + dt * v + 0.5 * dt * dt * a, v + dt * a
            q = quaternion.product(q, quaternion.exp(dt * w))
        return q, v, p

    def miss(spin, far, fast, gravity):
        """Return how far both ways are apart, over the distance from the origin."""
        gyro, force = _imu(result.rng, spin=spin)
        q = quaternion.exp(result.rng.normal(0.0, 3.0, 3))
        v, p = (scale * result.rng.normal(0.0, 1.0, 3) for scale in (fast, far))
        ours = preintegrate(gyro, force, dt).predict(q, v, p, gravity)
        truth = in_world(gyro, force, q, v, p, gravity)
        gap = [np.abs(a - b).max() for a, b in zip(ours, truth, strict=True)]
        return max(gap) / (1.0 + np.abs(truth[2]).max())

    down, starts = np.array([0.0, 0.0, -9.81]), int(result.input("starts", 24))
    # Chosen to break it: far away, fast, upside down, a fast spin, another gravity.
    rows = [miss(1.0 + 20.0 * (i % 2), 10.0 ** (i % 5), 50.0, down) for i in range(starts)]
    rows += [miss(5.0, 1.0, 1.0, result.rng.normal(0.0, 20.0, 3)) for _ in range(8)]
    worst, bound = max(rows), result.input("bound", 1e-10)
    gyro, force = _imu(result.rng)
    changed = preintegrate(gyro, force, dt, (result.input("shift", 0.01), 0.0, 0.0))
    biased = _apart(changed, preintegrate(gyro, force, dt))
    result.measure("moved", biased[1], 1e-3)
    result.statement = "Half a second of samples at 200 Hz, integrated both ways."
    result.statement_holds(worst > 1e-6)
    result.correction_holds(worst < bound, bool(np.all(biased > 1e-4)))


@claim(
    "After a change of the gyroscope's bias, preintegrated increments are corrected to first order "
    "and need not be integrated again.",
    "The correction leaves an error that grows with the square of the change: its measured order "
    "is {order:.2f}. Over {seconds:g} s a change of {small:.2f} rad/s in a random direction "
    "leaves up to {left:.1%} of the correction of the velocity, one of {large:.1f} rad/s up to "
    "{much:.0%}. A change of the accelerometer's bias is corrected exactly, since the increments "
    "are linear in it.",
    source="C. Forster and others, On-manifold preintegration, 2017",
)
def bias_to_first_order(result):
    from course.perception.preintegration import preintegrate

    dt, n = 5e-3, 100
    seconds = result.input("seconds", dt * n)
    small, large = result.input("small", 0.05), result.input("large", 2.0)
    bound = result.input("bound", 0.05)

    def errors(change, force=0.0, spin=1.0):
        """Return error left by the correction and size of the correction: angle, velocity, way."""
        gyro, read = _imu(result.rng, n, spin)
        axes = result.rng.normal(0.0, 1.0, (2, 3))
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        old, moved = preintegrate(gyro, read, dt), (change * axes[0], force * axes[1])
        again = preintegrate(gyro, read, dt, *moved)
        return _apart(old.corrected(*moved), again), _apart(old, again)

    def share(change, spin=1.0):
        remaining, full = errors(change, spin=spin)
        return float(remaining[1] / full[1])

    def weakest(change, spin):
        """Return the error left along the axis that corrects least, over the largest correction."""
        gyro, read = _imu(result.rng, n, spin)
        old = preintegrate(gyro, read, dt)
        axes = np.linalg.svd(old.jacobian[3:6, :3])[2]
        least, most = ((change * x, np.zeros(3)) for x in (axes[2], axes[0]))
        remaining = _apart(old.corrected(*least), preintegrate(gyro, read, dt, *least))[1]
        return float(remaining / _apart(old, preintegrate(gyro, read, dt, *most))[1])

    def cancelled(change):
        """Return the error left over the full correction, for thrust that cancels over the time."""
        thrust = 10.0 * np.cos(2.0 * np.pi * (np.arange(n) + 0.5) / n)
        read, bias = thrust * np.array([[0.0], [0.0], [1.0]]), np.array([change, 0.0, 0.0])
        old = preintegrate(0.0 * read, read, dt)
        again = preintegrate(0.0 * read, read, dt, bias)
        return _apart(old.corrected(bias, np.zeros(3)), again)[1] / _apart(old, again)[1]

    draws = range(24)
    angle = result.input("angle", 0.05)
    remaining = result.measure("left", max(share(small) for _ in draws), 0.2)
    remaining_large = result.measure("much", max(share(large) for _ in draws), 0.2)
    sizes = np.geomspace(0.01, 0.3, 6)
    mean = [np.mean([errors(size)[0][1] for _ in draws]) for size in sizes]
    order = result.measure("order", np.polyfit(np.log(sizes), np.log(mean), 1)[0], 0.05)
    linear = max(errors(0.0, 10.0 ** (k % 3))[0].max() for k in draws)
    shares = result.rng.uniform(0.05, 0.98, 12)
    result.statement = "Half a second of samples at 200 Hz, with biases changed in any direction."
    result.statement_holds(
        remaining_large < bound,
        only_if="the change of the gyroscope's bias times the interval is a small angle, and the "
        "measured accelerations do not almost cancel over the interval, as near free fall. Below "
        "{angle:.2f} rad the remaining error is then less than {bound:.0%} of the largest velocity "
        "correction for a bias change of this size",
        # Chosen to break it: a sensor that spins ten times as fast, and a change about the axis
        # that needs the smallest correction.
        inside=[share(angle * u / seconds) < bound for u in shares]
        + [share(angle * u / seconds, 10.0) < bound for u in shares]
        + [weakest(angle * u / seconds, spin) < bound for u in shares for spin in (1.0, 10.0)],
        outside=[share(20.0 * angle * (1.0 + u) / seconds) < bound for u in shares]
        # Chosen to break it: thrust to and fro about free fall, whose first moment vanishes.
        + [cancelled(angle * u / seconds) < bound for u in shares],
    )
    result.correction_holds(
        1.85 < order < 2.15, linear < 1e-6, remaining < 0.05, remaining_large > 2.0 * remaining
    )
