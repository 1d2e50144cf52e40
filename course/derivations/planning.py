"""Claims of chapter 5: edges of a tree."""

import numpy as np

from course.derivations import claim


@claim(
    "To check an edge of a tree for collisions, try ten or more points along it.",
    "Ten points inside an edge leave gaps of an eleventh of it: a disc with a radius below 1/22 of "
    "the edge fits between two of them and is crossed through its middle unseen. A larger disc is "
    "missed where the edge cuts off less than a gap: of random edges of {edge_m:.0f} m that hit a "
    "disc of radius {large_m:.1f} m, ten points miss {large_share:.1%}, up to "
    "{deepest_missed_mm:.0f} mm deep; of those that hit one of {small_m:.2f} m, {small_share:.0%}; "
    "even at {huge_m:.0f} m some. The distance of a disc's centre from the segment has a closed "
    "form, costs one point and misses none.",
    source="C. Ericson, Real-Time Collision Detection, 2005, sec. 5.1.2",
)
def edge_by_ten_points(found):
    from course.drills import edge_is_free

    edge = found.given("edge_m", 1.0)
    a, b = np.zeros(2), np.array([edge, 0.0])
    tried = np.linspace(0.0, edge, 12)  # ten and the ends
    gap = edge / 11

    def unseen(discs, growth=0.0):
        """Whether no point tried is in the disc, grown by a share of what a gap needs."""
        radii = np.sqrt(discs[:, 2:] ** 2 + growth * (gap / 2) ** 2)
        return np.all(np.hypot(tried - discs[:, :1], discs[:, 1:2]) > radii, axis=1)

    def colliding(radius, count):
        """Discs that the edge hits, from uniform centres around it; and how deep it cuts."""
        centres = found.rng.uniform((-radius, -radius), (edge + radius, radius), (count, 2))
        outside = centres[:, 0] - np.clip(centres[:, 0], 0.0, edge)
        depth = radius - np.hypot(outside, centres[:, 1])
        return np.column_stack((centres, np.full(count, radius)))[depth >= 0], depth[depth >= 0]

    low, high = 0.0, 0.2  # the largest disc in the middle of a gap that no point sees
    for _ in range(40):
        middle = 0.5 * (low + high)
        seen = not unseen(np.array([[4.5 * gap, 0.0, middle]]))[0]
        low, high = (low, middle) if seen else (middle, high)
    found.figure("largest_radius_missed_m", low, tolerance=1e-9)
    large, small = found.given("large_m", 0.1), found.given("small_m", 0.03)
    wide, deep = colliding(large, 100_000)
    narrow, _ = colliding(small, 100_000)
    huge, _ = colliding(found.given("huge_m", 1.0), 200_000)
    share = found.figure("large_share", np.mean(unseen(wide)), tolerance=0.02)
    found.figure("small_share", np.mean(unseen(narrow)), tolerance=0.02)
    deepest = found.figure("deepest_missed_mm", 1000 * deep[unseen(wide)].max(), tolerance=0.05)
    some = found.figure("huge_missed", np.sum(unseen(huge)), tolerance=0.5)
    sample = [*wide[unseen(wide)][:300], *narrow[:300], *huge[:300]]
    wrong = sum(edge_is_free(a, b, disc[None]) for disc in sample)
    found.figure("missed_by_closed_form", wrong)
    found.statement = (
        f"Missed: {share:.1%} of the edges that hit a disc of 0.1 m, {np.sum(unseen(huge))} of "
        f"{len(huge)} that hit one of 1 m; by the closed form {wrong} of {len(sample)}."
    )

    def none_missed(growth):
        radius = 10 ** found.rng.uniform(-2, 0.5)
        return not np.any(unseen(colliding(radius, 20_000)[0], growth))

    found.heard(
        share == 0.0 and some == 0,
        only_if="every disc is grown to the radius sqrt(r^2 + s^2 / 4), s being the distance of "
        "two points tried",
        inside=[none_missed(1.0) for _ in range(10)],
        outside=[none_missed(0.9) for _ in range(10)],
    )
    found.corrected(
        wrong == 0,
        abs(low - gap / 2) < 1e-9,
        some > 0,
        deepest / 1000 <= large - np.sqrt(large**2 - (gap / 2) ** 2),
    )
