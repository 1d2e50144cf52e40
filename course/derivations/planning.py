"""Claims of chapter 5: edges of a tree."""

import numpy as np

from course.derivations import Finding, Verdict, claim


@claim(
    "edge_by_ten_points",
    5,
    "To check an edge of a tree for collisions, try ten or more points along it.",
    verdict=Verdict.CONDITIONAL,
    condition="the radius of every obstacle is at least half the distance of two points tried",
    corrected="Ten points inside an edge leave gaps of an eleventh of it: a disc with a radius "
    "below 1/22 of the edge fits between two of them and is crossed through its middle unseen. Of "
    "random edges of 1 m that hit a disc of 0.1 m radius, ten points miss 3 %, none deeper than "
    "11 mm; of those that hit one of 0.03 m, 46 %. The distance of a disc's centre "
    "from the segment has a closed form, costs one point and misses none.",
    figures={
        "largest_radius_missed_m": (1.0 / 22.0, 1e-9),
        "missed_share_radius_0.1": (0.02923, 0.001),
        "deepest_missed_radius_0.1_m": (0.0101, 0.01),
        "missed_share_radius_0.03": (0.4593, 0.001),
        "missed_by_closed_form": (0.0, 0.0),
    },
    source="C. Ericson, Real-Time Collision Detection, 2005, sec. 5.1.2",
)
def _edge_by_ten_points() -> Finding:
    from course.drills import edge_is_free

    a, b = np.zeros(2), np.array([1.0, 0.0])
    tried = np.linspace(0.0, 1.0, 12)

    def seen(discs: np.ndarray) -> np.ndarray:
        """Whether one of the points tried (the ends too) is in the disc, by disc."""
        gaps = np.hypot(tried - discs[:, :1], discs[:, 1:2])
        return np.any(gaps <= discs[:, 2:], axis=1)

    # The largest disc on the edge that no point sees, by bisection on its radius.
    low, high = 0.0, 0.2
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (
            (low, middle) if seen(np.array([[4.5 / 11, 0.0, middle]]))[0] else (middle, high)
        )
    shares, deepest, wrong = [], [], 0
    rng = np.random.default_rng(0)
    for radius in (0.1, 0.03):
        centres = rng.uniform((-radius, -radius), (1.0 + radius, radius), size=(20000, 2))
        discs = np.column_stack([centres, np.full(len(centres), radius)])
        nearest = np.clip(centres[:, 0], 0.0, 1.0)
        hit = np.hypot(centres[:, 0] - nearest, centres[:, 1]) <= radius
        missed = hit & ~seen(discs)
        shares.append(float(np.sum(missed) / np.sum(hit)))
        reach = np.hypot(centres[:, 0] - nearest, centres[:, 1])
        deepest.append(float(np.max(radius - reach[missed])))
        wrong += sum(edge_is_free(a, b, discs[i : i + 1]) == hit[i] for i in range(0, 20000, 20))
    figures = {
        "largest_radius_missed_m": low,
        "missed_share_radius_0.1": shares[0],
        "deepest_missed_radius_0.1_m": deepest[0],
        "missed_share_radius_0.03": shares[1],
        "missed_by_closed_form": float(wrong),
    }
    return Finding(
        figures,
        f"Missed: {shares[0]:.1%} of the edges that hit a disc of 0.1 m, {shares[1]:.1%} of those "
        "that hit one of 0.03 m.",
        holds=max(shares) == 0.0,
        holds_if=not np.any(~seen(np.array([[4.5 / 11, 0.0, 1.0 / 22.0 + 1e-9]]))),
        corrected=bool(wrong == 0),
    )
