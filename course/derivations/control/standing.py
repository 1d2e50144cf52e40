"""Claims of chapter 6: when a legged robot can stand."""

import math

from course.derivations import claim


@claim(
    "A legged robot can stand on any slope below the friction angle.",
    "Below the friction angle vertical forces stay in their cones, but they must also balance "
    "moments and respect the torque limits. At half of the friction angle's tangent, the biped of "
    "this chapter can stand while the vertical through its centre of mass meets the ground up to "
    "{reach_mm:.0f} mm from the middle, where its outermost contact is, and while its joints can "
    "bear {least:.1f} N m. Beyond the friction angle it cannot stand whatever its motors are.",
)
def below_the_friction_angle(result):
    import numpy as np

    from course.control.standing import biped, stand

    stance, half = 0.15, 0.08

    def stands(lean, limit=1e4, part=0.5, mu=0.6):
        slope = math.atan(part * mu)
        return stand(biped(slope, mu, lean=lean, limit=limit)).feasible

    def largest(test, low, high):
        """Return where a test that holds at low and not at high stops holding."""
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if test(middle) else (low, middle)
        return low

    reach = largest(lambda x: stands(x), 0.0, 0.5)
    least = 1.0 / largest(lambda x: stands(0.0, limit=1.0 / x), 1e-3, 10.0)
    result.measure("reach_mm", 1e3 * reach, 0.01)
    result.measure("least", least, 0.01)
    outermost = (stance + half) * math.cos(math.atan(0.3))
    draws = result.rng.uniform(0.0, 1.0, (3, 12))

    def drawn(lean, factor):
        """Return how the claim fares at random slopes, with a share of the reach."""
        rows = []
        for a, b, c in draws.T:
            mu, part = 0.2 + a, 0.05 + 0.93 * b
            edge = (stance + half) * math.cos(math.atan(part * mu))
            rows.append(stands(lean * edge * np.sign(c - 0.5), factor, part, mu))
        return rows

    result.statement = (
        "A planar biped with heels and toes, whose forces come from a quadratic program with "
        "friction cones."
    )
    result.statement_holds(
        all(drawn(1.1, 1e4)),
        only_if="the vertical through the centre of mass meets the ground between the outermost "
        "contacts, and the joints are strong enough",
        inside=drawn(0.95, 1e4),
        outside=[*drawn(1.05, 1e4), *drawn(0.0, 0.5 * least)],
    )
    beyond = [stands(0.0, 1e6, 1.01, 0.2 + a) for a in draws[0]]
    result.correction_holds(abs(reach / outermost - 1.0) < 1e-4, least > 0.5, not any(beyond))
