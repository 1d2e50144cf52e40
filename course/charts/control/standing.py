"""Chapter 6: on which inclines a biped can stand, beside the friction angle."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from course.charts import chart
from course.control.standing import biped, stand, steepest
from course.measure.figure import Panel, Series

STRONG, WEAK = 1e4, 13.0  # N m
SIDES = (0.98, 1.02)  # of the friction angle's tangent


@chart(columns=2)
def standing_limit(
    frictions: Sequence[float] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0),
    slopes: int = 25,
) -> Iterator[Panel]:
    """Chart the steepest slope over friction, and the use of friction and torque over the slope."""

    def angle(mu: float) -> float:
        return math.degrees(math.atan(mu))

    limit = Panel("Steepest slope", "coefficient of friction", "slope [deg]")
    strong, weak = (
        [math.degrees(steepest(mu, limit=torque)) for mu in frictions] for torque in (STRONG, WEAK)
    )
    limit.series = [
        Series("strong joints", frictions, strong, style="", theory=angle),
        Series(f"limit {WEAK:g} N m", frictions, weak, marker="s"),
    ]
    sides = [
        [stand(biped(math.atan(part * mu), mu)).feasible for mu in frictions] for part in SIDES
    ]
    limit.notes = [
        f"slopes of {part:g} times the friction angle's tangent: {sum(feasible)} of "
        f"{len(feasible)} feasible"
        for part, feasible in zip(SIDES, sides, strict=True)
    ]
    away = np.max(np.abs(np.array(strong) - limit.series[0].expected))
    limit.notes.append(f"strong joints, largest distance from the friction angle: {away:.1g} deg")
    yield limit
    mu = 0.6
    tangents = np.linspace(0.0, 0.999 * mu, slopes)
    used, torque = [], []
    for tangent in tangents:
        result = stand(biped(math.atan(tangent), mu))
        tangential, normal = result.forces[..., 0], result.forces[..., 1]
        used.append(100.0 * np.max(np.abs(tangential)[normal > 1.0] / (mu * normal[normal > 1.0])))
        torque.append(np.max(np.abs(result.torques)))
    degrees = np.degrees(np.arctan(tangents))
    share = Panel(
        "Forces of lowest cost, friction 0.6",
        "slope [deg]",
        "largest use [% or N m]",
        lines=[("x", angle(mu), "friction angle")],
        ylim=(0.0, None),
    )
    share.series = [
        Series("friction [%]", degrees, used, marker=""),
        Series("torque [N m]", degrees, torque, marker=""),
    ]
    yield share
