import numpy as np


def compare_engines(mu, masses, place, speed, steps, times):
    """Return one scene on two engines: a block that slides over a plank, which is free itself.

    Args:
        mu: coefficient of friction between them, the same for both engines.
        masses: of the block and the plank, (2,) [kg].
        place: where both are at the start [m].
        speed: of the block at the start [m/s]; the plank stands.
        steps: of the first and the second engine, (2,) [s].
        times: whole multiples of both steps, rising, (n,) [s].

    Returns:
        (position of the block on the second engine minus that on the first, (n,) [m]; what the
        scene's energy has gained on each engine from the start to the last time, (2,) [J]).
    """
    masses, steps, times = (np.asarray(one, dtype=float) for one in (masses, steps, times))

    def engine(surfaces, combine, damping, dt):
        friction = combine(*surfaces) * masses[0] * 9.81 * dt
        x, v = np.array([[place, place], [speed, 0.0]], dtype=np.float32)
        log = []
        for _ in range(round(times[-1] / dt) + 1):
            v *= 1.0 - damping * dt
            stick = (v[1] - v[0]) / np.sum(1.0 / masses)
            v += np.clip(stick, -friction, friction) * np.array([1.0, -1.0]) / masses
            x += dt * v
            log.append((*x, *v))
        return np.array(log)

    def energy(state):
        return float(masses[0] * state[2] ** 2 / 2.0)

    first = engine((mu, mu), lambda a, b: a * b, 0.04, steps[0])
    second = engine((mu, mu), max, 0.0, steps[1])
    rows = [np.rint(times / dt).astype(int) for dt in steps]
    difference = second[rows[1], 0] - first[rows[0], 0]
    gained = [energy(a[k[-1]]) - energy(a[0]) for a, k in ((first, rows[0]), (second, rows[1]))]
    return difference, np.array(gained)
