"""Arms that the tests of the chapter share."""

import numpy as np

from course.kinematics import Chain, panda, planar, random_chain


def states(chain: Chain, rng: np.random.Generator, count: int = 3) -> list[np.ndarray]:
    """Positions, rates, accelerations, ...: each of the size of the arm."""
    return [rng.normal(size=chain.n) for _ in range(count)]


def drawn(seed: int) -> Chain:
    """A chain or a tree of 1 to 30 joints of both kinds."""
    rng = np.random.default_rng(seed)
    return random_chain(int(rng.integers(1, 31)), rng, tree=seed % 2 == 1)


def named() -> dict[str, Chain]:
    """The constructors' arms."""
    return {"planar": planar([1.0, 0.5, 0.3], [2.0, 1.0, 0.4], 0.1), "panda": panda()}


def relative(result, truth) -> float:
    """The largest difference over the largest entry."""
    result, truth = np.asarray(result), np.asarray(truth)
    return float(np.abs(result - truth).max() / max(float(np.abs(truth).max()), 1e-300))
