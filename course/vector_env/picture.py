"""A picture of a reaching arm, drawn with the pen and the painter that all simulations share."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SIDE = 300  # pixels


def reach_picture(q: Array, target: Array, lengths: Array, radius: float) -> NDArray[np.uint8]:
    """Return the arm from above, its target, and the circle that its tip can reach.

    Args:
        q: joint angles [rad], (2,).
        target: where the tip should go [m], (2,).
        lengths: of the links [m], (2,).
        radius: of the target [m].

    Returns:
        Red, green and blue of each pixel, rows from the top, (SIDE, SIDE, 3).
    """
    # An environment that is not looked at needs neither of them.
    from course.simulations import painter, pen

    # Absolute directions of the links: running sums of the joint angles.
    turned = np.cumsum(q)
    x, y = (np.append(0.0, np.cumsum(lengths * f(turned))) for f in (np.cos, np.sin))
    reach = float(lengths.sum())
    edge = 1.1 * reach
    paper = pen.Paper(
        "A two-link arm and its target", window=(-edge, edge, -edge, edge), width=SIDE
    )
    ink = paper.pen()
    pen.disc(ink, reach, pen.NONE, pen.FAINT, 1.0)
    pen.point(ink, 0.0, 0.0)
    # The target is its own size, which is small, in a ring that can be seen.
    for size, fill, width in ((radius, pen.RED, 1.0), (2.5 * radius, pen.NONE, 1.5)):
        pen.disc(ink, size, fill, pen.RED, width)
        pen.point(ink, *target)
    pen.line(ink, pen.BLUE, 6.0)
    pen.points(ink, x, y)
    pen.disc(ink, 0.03 * reach, pen.INK)
    pen.points(ink, x[:2], y[:2])
    pen.disc(ink, 0.02 * reach, pen.ORANGE)
    pen.point(ink, x[2], y[2])
    return painter.to_pixels(pen.picture(paper, ink))
