"""Planners that have learned: states of one's own, and what a network proposes, by known ones."""

import functools
import math
from typing import Any

import numpy as np
import pytest

from course.charts.planning import learned as chart
from course.planning import check_path, edge_free, learned, plan, scenes


def test_states_of_ones_own_are_drawn_in_their_order_and_uniform_ones_after_them() -> None:
    empty = scenes.empty()
    states = np.array([[1.5, 2.0, 2.5], [1.0, 1.0, 1.0]])
    ask: dict[str, Any] = {"method": "rrt_star", "goal_bias": 0.0, "step": 20.0, "budget": 8}
    result = plan(empty.world, empty.start, empty.goal, **ask, sampler=states)
    assert np.array_equal(result.nodes[:, [1, 3, 4]], states)  # the goal is joined after the first
    uniform = plan(empty.world, empty.start, empty.goal, **ask).nodes
    assert np.array_equal(result.nodes[:, 5:], uniform[:, [1, 3, 4, 5, 6]])


@pytest.mark.parametrize("states", [[[1.0], [11.0]], [[1.0, 2.0]], [[np.nan], [1.0]]])
def test_states_out_of_bounds_or_of_a_wrong_shape_are_refused(states) -> None:
    empty = scenes.empty()
    with pytest.raises(ValueError, match="sampler"):
        plan(empty.world, empty.start, empty.goal, sampler=states)


def test_a_world_of_slits_has_a_picture_and_its_answers_go_in_equal_steps() -> None:
    rng = np.random.default_rng(2)
    for turned in (False, True):
        scene = learned.slits(rng, turned)
        observed = learned.picture(scene)[0].mean(axis=0 if turned else 1)
        assert (
            np.all((observed == 1.0) | (np.abs(32 * observed - 1.5) < 1.0))
            and np.sum(observed < 1.0) >= 3
        )
        path = learned.answered(scene, 1, 3000)
        assert path is not None
        assert np.array_equal(path[:, [0, -1]].T, [scene.start, scene.goal])
        steps = np.linalg.norm(np.diff(path), axis=0)  # shorter only at a corner
        assert np.median(steps) == pytest.approx(steps.max()) and not np.any(steps == 0.0)
        assert all(edge_free(scene.world, q, q) for q in path.T)
        some = chart.searched(scene, 50, rng)
        distance = np.linalg.norm(some[:, :, None] - path[:, None], axis=0).min(axis=1)
        assert np.median(distance) < 1.0


def test_states_are_drawn_by_their_colours() -> None:
    import torch

    scene = scenes.gap(0.1)
    share = np.random.default_rng(0).dirichlet(np.full(learned.CELLS**2, 0.01))
    logits = torch.tensor(np.log(share + 1e-300))[None]
    states = learned.drawn(lambda x: logits, scene, 20_000, np.random.default_rng(1))
    cells = (states * learned.CELLS / 10.0).astype(int)
    drawn = np.bincount(cells[0] * learned.CELLS + cells[1], minlength=share.size) / 20_000
    assert np.abs(drawn - share).max() < 4.0 * math.sqrt(share.max() / 20_000)


@pytest.mark.slow
def test_noise_becomes_what_the_network_knows(monkeypatch) -> None:
    """Two networks in closed form: of one path, and of independent normal numbers, whose spread
    comes out the better the smaller the steps are."""
    import torch

    scene, rng = scenes.gap(0.1), np.random.default_rng(0)
    one = torch.tensor(rng.normal(size=2 * learned.POINTS))
    paths = learned.denoised(lambda x: one.expand(len(x), -1), scene, 3, rng)
    line = learned._lines(scene.start[None], scene.goal[None])
    assert np.allclose((paths - line)[:, :, 1:-1].reshape(3, -1), learned.NOISE * one.numpy())
    assert np.array_equal(paths[:, :, 0], [scene.start] * 3)
    assert np.array_equal(paths[:, :, -1], [scene.goal] * 3)

    wide = 0.6  # of the normal paths; the best guess from a noisy one is linear in it

    def normal(x):
        remaining = torch.tensor(learned._alpha_bar())[(x[:, -1:] * learned.STEPS).round().long()]
        return remaining.sqrt() * wide**2 * x[:, :-5] / (remaining * wide**2 + 1.0 - remaining)

    for steps, error in ((40, 0.1), (1000, 0.015)):
        monkeypatch.setattr(learned, "STEPS", steps)
        inner = (learned.denoised(normal, scene, 400, rng) - line)[:, :, 1:-1] / learned.NOISE
        assert np.std(inner) == pytest.approx(wide, rel=error)
        assert abs(np.mean(inner)) < 4.0 * wide / math.sqrt(inner.size)


@pytest.mark.prove
@pytest.mark.slow
def test_a_seed_gives_one_network_and_the_threads_are_put_back() -> None:
    import torch

    threads, drawn = torch.get_num_threads(), torch.get_rng_state()
    nets = [learned.train_sampler(3, 2, seed) for seed in (0, 0, 1)]
    values = [torch.cat([p.flatten() for p in net.parameters()]) for net in nets]
    assert torch.equal(values[0], values[1]) and not torch.equal(values[0], values[2])
    world = scenes.discs(count=chart.DISCS).world
    nets = [learned.train_diffusion(world, 3, 2) for _ in range(2)]
    assert torch.equal(*(next(net.parameters()) for net in nets))
    assert torch.get_num_threads() == threads and torch.equal(torch.get_rng_state(), drawn)


def test_only_what_the_edge_test_passes_counts_and_the_judge_agrees() -> None:
    world = scenes.discs(count=chart.DISCS).world
    some = learned.questions(learned.grown(world), 8, np.random.default_rng(1))
    lost = 0
    for k, q in enumerate(some):
        scene = scenes.Scene("discs", world, q.start, q.goal, 1.0)
        paths = chart.bent(scene, 2, np.random.default_rng(k))
        spent, before, after = chart.first_free(scene, functools.partial(list, paths), push=False)
        free = [bool(check_path(world, path)) for path in paths]
        assert (before, after) == (not free[0],) * 2 and math.isfinite(spent) == any(free)
        lost += not any(free)
    assert lost > 0
