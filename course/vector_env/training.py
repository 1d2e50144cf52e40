"""A training loop on a page: a linear policy learns to reach, by the cross-entropy method.

No gradient and no network: draw policies around a mean, let each of them reach for a few targets,
and take the mean and the spread of the best for the next draw (Rubinstein, Methodology and
Computing in Applied Probability 1, 1999; with noise that fades, Szita and Lorincz, Neural
Computation 18, 2006). All policies of a generation play at once, each in its rows of one batch.
"""

import numpy as np
from numpy.typing import NDArray

from course.vector_env.reach import MAX_STEPS, ArmReachVector

Array = NDArray[np.float64]

NOISE = 3.0  # spread of the first weights; a third of it is added to later ones, and fades
JUDGES = 10**6, 200  # first seed and number of the targets that no policy trains on


def features(observations: Array) -> Array:
    """Return the features in which the policy is linear, (n, 6).

    They are the remaining displacement in the frame of each link, and the two rates.

    Pulling the tip straight at the target, J^T (target - tip), is linear in them; so is damping.
    """
    c1, s1, c2, s2, w1, w2, dx, dy = observations.T
    # The displacement in the frame of link 1, and turned on by q2 in that of link 2.
    along, across = c1 * dx + s1 * dy, c1 * dy - s1 * dx
    return np.stack([along, across, c2 * along + s2 * across, c2 * across - s2 * along, w1, w2], 1)


def play(policies: Array, seed: int, targets: int) -> Array:
    """Return what each policy collects in one episode from each of the same starts.

    Args:
        policies: weights, (p, 2, 6): the action is weights @ features, cut at the torques' limits.
        seed: of the first start; the others have the following ones.
        targets: how many starts.

    Returns:
        Mean sum of rewards, and share of targets reached, (2, p).
    """
    p = len(policies)
    envs = ArmReachVector(p * targets)
    # Common random numbers: every policy starts from the same postures and targets.
    observations, _ = envs.reset(seed=[seed + i for i in range(targets)] * p)
    total, reached, alive = np.zeros(p * targets), np.zeros(p * targets), np.ones(p * targets)
    for _ in range(MAX_STEPS):
        observed = features(observations).reshape(p, targets, -1)
        # Policies and their rows of targets as one batched matrix product.
        actions = np.clip(observed @ policies.swapaxes(1, 2), -1.0, 1.0).reshape(-1, 2)
        observations, rewards, over, late, _ = envs.step(actions)
        # Once its episode is over, a row counts no more, though the batch plays on.
        total += alive * rewards
        reached += alive * over
        alive *= ~(over | late)
    return np.array([total, reached]).reshape(2, p, targets).mean(axis=2)


def train(
    seed: int, generations: int = 30, policies: int = 64, targets: int = 8, best: int = 10
) -> tuple[Array, Array]:
    """Learn to reach; `targets` for each of the `policies` of a generation, `best` of them kept.

    Returns:
        The learning curve (generations + 1, 3): environment steps so far; what the mean policy
        collects and the share that it reaches, on targets kept for judging. And the mean, (2, 6).
    """
    rng = np.random.default_rng(seed)
    mean, spread = np.zeros((2, 6)), np.full((2, 6), NOISE)
    # Judged on targets that no generation trains on.
    curve = [[0.0, *play(mean[None], *JUDGES)[:, 0]]]
    for k in range(generations):
        # Cross-entropy method: sample policies, score them, refit the normal distribution to the
        # elite.
        drawn = mean + spread * rng.normal(size=(policies, 2, 6))
        scores, _ = play(drawn, int(rng.integers(10**5)), targets)
        elite = drawn[np.argsort(scores, kind="stable")[-best:]]
        # Added noise that fades keeps the spread from collapsing too early (Szita and Lorincz,
        # 2006).
        fading = NOISE / 3.0 * max(0.0, 1.0 - 2.0 * k / generations)
        mean, spread = elite.mean(axis=0), np.sqrt(elite.var(axis=0) + fading**2)
        steps = (k + 1.0) * policies * targets * MAX_STEPS
        curve.append([steps, *play(mean[None], *JUDGES)[:, 0]])
    return np.array(curve), mean
