"""A picture of a reaching arm, drawn in NumPy by the distance of each pixel from what is drawn.

The coverage of a pixel falls from 1 to 0 within one pixel of a shape's edge, so edges are smooth.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SIDE = 300  # pixels
# Red, green and blue, 0 to 255.
WORKSPACE, LINKS, JOINTS = (0xDD, 0xDD, 0xDD), (0x00, 0x72, 0xB2), (0x22, 0x22, 0x22)
TIP, TARGET = (0xD5, 0x5E, 0x00), (0xC1, 0x27, 0x2D)


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
    # Absolute directions of the links: running sums of the joint angles.
    turned = np.cumsum(q)
    joints = [np.append(0.0, np.cumsum(lengths * f(turned))) for f in (np.cos, np.sin)]
    base, elbow, tip = np.array(joints).T
    reach = float(lengths.sum())
    edge = 1.1 * reach
    pixel = 2.0 * edge / SIDE  # m
    across = (np.arange(SIDE) + 0.5) * pixel - edge  # centres of the pixels
    x, y = across, -across[:, None]
    image = np.full((SIDE, SIDE, 3), 255.0)

    def paint(distance: Array, colour: tuple[int, int, int]) -> None:
        """Cover the pixels whose signed distance from a shape's edge [m] is negative."""
        near = distance < 0.5 * pixel
        coverage = np.minimum(0.5 - distance[near] / pixel, 1.0)[:, None]
        image[near] += coverage * (np.array(colour) - image[near])

    def from_point(point: Array) -> Array:
        return np.hypot(x - point[0], y - point[1])

    def from_segment(a: Array, b: Array) -> Array:
        dx, dy = b - a
        share = np.clip(((x - a[0]) * dx + (y - a[1]) * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        return np.hypot(x - a[0] - share * dx, y - a[1] - share * dy)

    paint(np.abs(from_point(base) - reach) - 0.5 * pixel, WORKSPACE)
    # The target is its own size, which is small, in a ring that can be seen.
    paint(from_point(target) - radius, TARGET)
    paint(np.abs(from_point(target) - 2.5 * radius) - 0.75 * pixel, TARGET)
    for a, b in ((base, elbow), (elbow, tip)):
        paint(from_segment(a, b) - 3.0 * pixel, LINKS)
    for joint in (base, elbow):
        paint(from_point(joint) - 0.03 * reach, JOINTS)
    paint(from_point(tip) - 0.02 * reach, TIP)
    return np.rint(image).astype(np.uint8)
