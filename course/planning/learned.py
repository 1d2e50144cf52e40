"""Planners that have learned: a sampler from pictures of a world, and paths made out of noise.

Both are trained on questions that RRT-Connect has answered, in about a minute, and neither is
believed: what they propose is asked of the world, edge by edge, as everything else is. PyTorch is
imported when it is needed.

The sampler sees which of 32 by 32 places are free, the start and the goal, and colours the places
where answers went; states are drawn from these colours (after Ichter, Harrison and Pavone, ICRA
2018, who draw from a conditional autoencoder). The other takes noise away from a whole path, step
by step, told start and goal (Ho, Jain and Abbeel, 2020; for plans Janner et al., ICML 2022). It
knows one world, by heart.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.check import count
from course.compiled import compiled
from course.planning.problem import plan
from course.planning.scenes import SQUARE, Scene, free_state
from course.planning.trajectory import shortcut
from course.planning.worlds import STATE, World, edge_free, plane

Array = NDArray[np.float64]

CELLS = 32  # of a picture, each way
POINTS = 30  # of a path between start and goal
STEPS = 40  # of noise
SCALE = 5.0  # m; half of the square, what ends are counted in
NOISE = 0.5  # m; how far paths are from the straight line, about
ROOM = 0.2  # m; that answers keep from a disc


def slits(rng: np.random.Generator, turned: bool = False) -> Scene:
    """Return three walls across the square, each with a slit; both are 0.4 m wide.

    That is more than a cell of the network's image. Queries go from the first room to the last.

    Args:
        rng: where walls, slits, start and goal are.
        turned: by a quarter; the sampler is not trained on these.
    """
    boxes = []
    for x in (2.5, 5.0, 7.5) + rng.uniform(-0.5, 0.5, 3):
        low = rng.uniform(0.3, 9.3)
        boxes += [[x - 0.2, 0, x + 0.2, low], [x - 0.2, low + 0.4, x + 0.2, 10]]
    ends = rng.uniform([[0.2, 0.2], [8.6, 0.2]], [[1.4, 9.8], [9.8, 9.8]])
    order = [1, 0, 3, 2] if turned else [0, 1, 2, 3]
    start, goal = ends[:, order[:2]]
    return Scene("slits", plane(SQUARE, boxes=np.array(boxes)[:, order]), start, goal, 1.0)


def answered(scene: Scene, seed: int, points: int) -> Array | None:
    """Return states in equal steps along a short path of a scene, (2, points), or None."""
    result = plan(scene.world, scene.start, scene.goal, rng=seed, step=scene.step)
    if result.path is None:
        return None
    rng = np.random.default_rng(seed)
    path = shortcut(result.path, scene.world, rng, rounds=60)
    # Resample the path in equal steps of arc length.
    at = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path), axis=0))))
    return np.array([np.interp(np.linspace(0.0, at[-1], points), at, row) for row in path])


def picture(scene: Scene) -> Array:
    """Return what the sampler sees, shape (3, CELLS, CELLS).

    Free places, nearness of start and goal.
    """
    free, world = compiled(scene.world.state_free, STATE), scene.world
    at = (np.arange(CELLS) + 0.5) / CELLS
    low, high = world.bounds
    q = low + (high - low) * np.stack(np.meshgrid(at, at, indexing="ij"), axis=-1)
    observed = [[free(world.obstacles, world.body, p) for p in row] for row in q]
    # Gaussian bumps with a standard deviation of 0.5 m around both ends.
    near = [np.exp(-2.0 * np.sum((q - end) ** 2, axis=-1)) for end in (scene.start, scene.goal)]
    return np.array([observed, *near], dtype=float)


@contextlib.contextmanager
def _alone(seed: int) -> Iterator[None]:
    """Random numbers of torch from a seed and one thread.

    The same answer, and on small networks sooner than with several; both are put back.
    """
    import torch

    threads = torch.get_num_threads()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(threads)


def _fitted(net: Any, loss: Callable[[], Any], steps: int, rate: float) -> Any:
    """Train a network for `steps` steps of Adam with a one-cycle learning rate, and return it."""
    import torch

    optimiser = torch.optim.Adam(net.parameters())
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, rate, total_steps=steps)
    for _ in range(count("steps", steps, 1)):
        optimiser.zero_grad()
        loss().backward()
        optimiser.step()
        schedule.step()
    return net.eval()


# --- a sampler ------------------------------------------------------------------------------------


def train_sampler(worlds: int = 1500, steps: int = 600, seed: int = 0) -> Any:
    """Train a network that colours a picture, and return it.

    Args:
        worlds: of slits, each with one answer.
        steps: of the optimiser, with 32 of them each.
        seed: of worlds and network.

    Returns:
        A torch module: pictures (m, 3, CELLS, CELLS) -> logits (m, CELLS * CELLS).
    """
    import torch
    from torch import nn

    rng = np.random.default_rng((seed, 1))
    shown: list[Array] = []
    desired: list[Array] = []
    while len(shown) < count("worlds", worlds, 1):
        scene = slits(rng)
        path = answered(scene, int(rng.integers(2**31)), 100)
        if path is not None:
            # The target is a distribution over cells: the share of the path's 100 points in each.
            i, j = np.minimum((CELLS * path / 10.0).astype(int), CELLS - 1)
            where = np.zeros((CELLS, CELLS))
            np.add.at(where, (i, j), 0.01)
            shown.append(picture(scene))
            desired.append(where)
    x = torch.tensor(np.array(shown), dtype=torch.float32)
    y = torch.tensor(np.array(desired), dtype=torch.float32)
    with _alone(seed):
        layers: list[nn.Module] = []
        # Dilated convolutions (Yu and Koltun, 2016): each output sees 65 cells, more than the image
        # has.
        for k, wide in enumerate((1, 2, 4, 8, 16, 1)):  # each cell sees the whole picture
            layers += [nn.Conv2d(16 if k else 3, 16, 3, padding=wide, dilation=wide), nn.ReLU()]
        net = nn.Sequential(*layers, nn.Conv2d(16, 1, 1), nn.Flatten())

        def loss() -> Any:
            pick, flip = torch.randint(len(x), (32,)), [-1] if torch.rand(()) < 0.5 else []
            a, b = x[pick].flip(flip), y[pick].flip(flip)  # upside down is of the family too
            # Cross-entropy of the predicted distribution with respect to the path's.
            return -(net(a).log_softmax(1) * b.flatten(1)).sum(1).mean()

        return _fitted(net, loss, steps, 6e-3)


def drawn(net: Any, scene: Scene, count: int, rng: np.random.Generator) -> Array:
    """Return states sampled from the network's prediction for a scene's image, shape (2, count)."""
    import torch

    with _alone(0), torch.no_grad():
        logits = net(torch.tensor(picture(scene)[None], dtype=torch.float32))[0]
    share = torch.softmax(logits.double(), 0).numpy()
    # Sample a cell, then a uniform point inside it.
    cells = rng.choice(share.size, count, p=share / share.sum())
    inside = (np.array(divmod(cells, CELLS)) + rng.uniform(size=(2, count))) / CELLS
    low, high = scene.world.bounds[:, :, None]
    return np.asarray(low + (high - low) * inside)


# --- paths out of noise ---------------------------------------------------------------------------


def _alpha_bar() -> Array:
    """Return the share of a path's variance that remains after each noising step, (STEPS,).

    The schedule is that of Nichol and Dhariwal (2021).
    """
    # The cosine's argument stays away from both ends, so that no share is exactly 0 or 1.
    turn = 0.5 * np.pi * (np.arange(1, STEPS + 1) / STEPS * 0.98 + 0.01)
    return np.cos(turn) ** 2


def grown(world: World) -> World:
    """Return a world with larger discs.

    A shortest path touches its obstacles and leaves no margin; training paths need one.
    """
    return plane(world.bounds, world.obstacles[:, 1:4] + [0.0, 0.0, ROOM])


def questions(world: World, count: int, rng: np.random.Generator) -> list[Scene]:
    """Return random free ends.

    At least 3 m apart, that can be joined, but not by a straight edge.
    """
    some: list[Scene] = []
    while len(some) < count:
        a, b = free_state(world, rng), free_state(world, rng)
        if math.dist(a, b) > 3.0 and not edge_free(world, a, b):
            if plan(world, a, b, step=1.0, budget=2000).solved:
                some.append(Scene("discs", world, a, b, 1.0))
    return some


def train_diffusion(world: World, paths: int = 4000, steps: int = 8000, seed: int = 0) -> Any:
    """Train a network that predicts a path from its noisy version, and return it.

    It is trained on paths of one world of discs.

    Args:
        world: its discs are grown by ROOM while it learns.
        paths: answered questions.
        steps: of the optimiser, with 256 of them each.
        seed: of questions and network.

    Returns:
        A torch module: rows of a noisy path less the straight line, over NOISE, start and goal over
        SCALE, less 1, and the step of noise, shape (m, 2 * POINTS + 5) -> the clean path likewise.
    """
    import torch
    from torch import nn

    rng = np.random.default_rng((seed, 2))
    rows: list[Array] = []
    larger = grown(world)
    while len(rows) < count("paths", paths, 1):
        (scene,) = questions(larger, 1, rng)
        path = answered(scene, int(rng.integers(2**31)), POINTS + 2)
        if path is not None:
            rows.append(path)
    result = np.array(rows)
    # The network works on deviations from the straight line, which are 0 at both ends.
    lines = _lines(result[:, :, 0], result[:, :, -1])
    ends = np.concatenate((result[:, :, 0], result[:, :, -1]), axis=1) / SCALE - 1.0
    x = torch.tensor(((result - lines)[:, :, 1:-1] / NOISE).reshape(len(rows), -1)).float()
    report, retained = torch.tensor(ends).float(), torch.tensor(_alpha_bar()).float()
    with _alone(seed):
        sizes = (2 * POINTS + 5, 256, 256, 256)
        layers: list[nn.Module] = []
        for wide, narrow in itertools.pairwise(sizes):
            layers += [nn.Linear(wide, narrow), nn.SiLU()]
        net = nn.Sequential(*layers, nn.Linear(256, 2 * POINTS))

        def loss() -> Any:
            pick, k = torch.randint(len(x), (256,)), torch.randint(STEPS, (256,))
            # Forward process in one step (Ho et al., 2020, eq. 4). The network predicts the clean
            # path, not the noise.
            clean, remaining = x[pick], retained[k][:, None]
            noisy = remaining.sqrt() * clean + (1.0 - remaining).sqrt() * torch.randn_like(clean)
            observed = net(torch.cat((noisy, report[pick], k[:, None] / STEPS), 1))
            return ((observed - clean) ** 2).mean()

        return _fitted(net, loss, steps, 2e-3)


def _lines(a: Array, b: Array) -> Array:
    """Return straight paths between rows of ends, shape (m, 2, POINTS + 2)."""
    share = np.linspace(0.0, 1.0, POINTS + 2)
    return a[:, :, None] * (1.0 - share) + b[:, :, None] * share


def denoised(net: Any, scene: Scene, count: int, rng: np.random.Generator) -> Array:
    """Return paths out of noise from start to goal, shape (many, 2, POINTS + 2); none is checked.

    Each step takes the path that the network sees in the noise, and puts as much noise back as the
    step before has (Ho et al., 2020, eq. 7).
    """
    import torch

    retained = np.append(_alpha_bar(), 1.0)  # retained[-1] is before any noise
    ends = np.concatenate((scene.start, scene.goal)) / SCALE - 1.0
    report = torch.tensor(np.tile(ends, (count, 1))).float()
    x = rng.standard_normal((count, 2 * POINTS))
    with _alone(0), torch.no_grad():
        for k in reversed(range(STEPS)):
            requested = (torch.tensor(x).float(), report, torch.full((count, 1), k / STEPS))
            observed = net(torch.cat(requested, 1)).numpy().astype(float)
            # Mean of the posterior q(x_{k-1} | x_k, x_0), with the network's path as x_0.
            before = retained[k - 1]
            beta = 1.0 - retained[k] / before
            x = (
                math.sqrt(before) * beta * observed + math.sqrt(1.0 - beta) * (1.0 - before) * x
            ) / (1.0 - retained[k])
            # Standard deviation of the posterior; the last step adds no noise.
            if k:
                spread = math.sqrt(beta * (1.0 - before) / (1.0 - retained[k]))
                x += spread * rng.standard_normal(x.shape)
    paths = _lines(np.tile(scene.start, (count, 1)), np.tile(scene.goal, (count, 1)))
    paths[:, :, 1:-1] += NOISE * x.reshape(count, 2, POINTS)
    return paths
