"""The worked answers of chapter 12 against SciPy, small steps and everything written out."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest, norm

from drills import cards
from drills.catalogue.catch_the_slip import exercise as catch
from solutions import interview as solutions
from tests.budget import examples


def rngs():
    return st.integers(0, 2**32 - 1).map(np.random.default_rng)


# --- intervals and trials -------------------------------------------------------------------------


@examples(40)
@given(st.integers(1, 500), st.floats(0.0, 1.0), st.floats(0.05, 0.999))
def test_the_intervals_are_those_of_scipy(tried, part, confidence):
    solved = round(part * tried)
    low, high, _ = solutions.success_interval([solved], [tried], confidence, 0.5, 0.5)
    right = binomtest(solved, tried).proportion_ci(confidence, "wilson")
    np.testing.assert_allclose((low[0], high[0]), (right.low, right.high), atol=1e-12)


@examples(40)
@given(st.floats(0.0, 1.0), st.floats(0.003, 0.3), st.floats(0.5, 0.99))
def test_the_trials_are_the_first_whose_rates_lie_close_together(share, half, confidence):
    """The ends are the roots of (share - p)^2 = z^2 p (1 - p) / n."""
    z = norm.ppf(0.5 + confidence / 2.0)

    def width(n):
        ends = np.roots([1.0 + z**2 / n, -2.0 * share - z**2 / n, share**2])
        return abs(ends[0] - ends[1]) / 2.0

    n = solutions.success_interval([1], [2], confidence, share, half)[2]
    assert width(n) <= half + 1e-9
    assert n == 1 or width(n - 1) > half - 1e-9


# --- a person in the way --------------------------------------------------------------------------


@examples(25)
@given(rngs())
def test_the_way_is_that_of_small_steps(rng):
    reaction, slope, person, unsure, sight = rng.uniform(
        [0.0, -0.2, 0.0, 0.0, 0.2], [0.6, 0.15, 2.0, 0.3, 9.0]
    )
    sight *= rng.choice([0.1, 1.0])  # now and then too little even to stand
    args = reaction, 2.5, slope, person, unsure, sight
    along = np.array([np.cos(slope), -np.sin(slope)]) @ [0.0, -9.81]  # gravity on the way down
    dt = 1e-4

    def stops(kmh):
        t = dt * (np.arange(200_000) + 0.5)
        v = np.maximum(kmh * 1000.0 / 3600.0 + (along - 2.5) * np.maximum(t - reaction, 0.0), 0.0)
        still = max(dt * np.count_nonzero(v), reaction)
        return dt * v.sum(), dt * v.sum() + person * still + unsure

    speed = rng.uniform(0.0, 15.0)
    distance, gap, top = solutions.stopping_distance([speed], *args)
    np.testing.assert_allclose((distance[0], gap[0]), stops(speed), atol=1e-3)
    if top > 0.0:
        assert stops(top)[1] == pytest.approx(sight, abs=1e-3)
    else:
        assert top == 0.0 and stops(0.0)[1] > sight - 1e-3


# --- latency over a graph -------------------------------------------------------------------------


@examples(40)
@given(rngs(), st.integers(2, 7))
def test_the_budget_is_that_of_every_chain_written_out(rng, n):
    edges = [pair for pair in itertools.combinations(range(n), 2) if rng.random() < 0.4] + [(0, 1)]
    scale = 10.0 ** rng.uniform(-1.0, 1.0, n)
    runs, periods = scale[:, None] * rng.random((n, 3)), rng.random(n) * rng.integers(0, 2, n)
    goal = max(b for a, b in edges if a == 0)
    chains = [
        (0, *middle, goal)
        for k in range(goal)
        for middle in itertools.combinations(range(1, goal), k)
        if all(pair in edges for pair in itertools.pairwise((0, *middle, goal)))
    ]
    lengths = {chain: sum(max(runs[i]) + periods[i] for i in chain) for chain in chains}
    through = [max((s for chain, s in lengths.items() if i in chain), default=0) for i in range(n)]
    name = rng.permutation(n)
    place = np.argsort(name)
    order = rng.permutation(len(edges))
    worst, remaining = solutions.latency_budget(
        name[np.array(edges)][order], runs[place], periods[place], name[0], name[goal], 2.0
    )
    assert worst == pytest.approx(max(lengths.values()))
    np.testing.assert_allclose(remaining[name], 2.0 - np.array(through), atol=1e-12)


# --- episodes in a buffer -------------------------------------------------------------------------


@examples(30)
@given(rngs(), st.integers(1, 5), st.booleans())
def test_each_episode_has_the_advantages_that_it_has_alone(rng, episodes, begun):
    """The double sum over each episode, whatever stands beside it in the buffer."""
    gamma, lam = rng.uniform(0.5, 1.0, 2)
    rows, finals, right, last = [], [], [], 0.0
    for k in range(episodes):
        n, over = int(rng.integers(1, 6)), rng.random() < 0.5
        reward, value = rng.normal(size=(2, n))
        last = rng.normal()
        if not over and k < episodes - 1:
            finals.append(last)
        ahead = [*value[1:], 0.0 if over else last]
        delta = reward + gamma * np.array(ahead) - value
        right += [sum((gamma * lam) ** (s - t) * delta[s] for s in range(t, n)) for t in range(n)]
        first = [int(k > 0 or not begun)] + [0] * (n - 1)
        rows += list(zip(reward, value, first, [0] * (n - 1) + [int(over)], strict=True))
    columns = list(np.array(rows).T)
    args: Any = (*columns, finals, last, gamma, lam)
    result, target = solutions.truncated_advantages(*args)
    np.testing.assert_allclose(result, right, atol=1e-12)
    np.testing.assert_allclose(target - columns[1], right, atol=1e-12)


def test_a_reward_of_one_for_ever_leaves_nothing_to_learn_whatever_the_time_limit():
    """What is worth 1 / (1 - gamma) everywhere has no advantage anywhere, cut off or not."""
    gamma, n = 0.9, 12
    worth = 1.0 / (1.0 - gamma)
    starts = np.arange(n) % 4 == 0
    result, target = solutions.truncated_advantages(
        np.ones(n), np.full(n, worth), starts, np.zeros(n), [worth] * 2, worth, gamma, 0.95
    )
    np.testing.assert_allclose(result, 0.0, atol=1e-12)
    np.testing.assert_allclose(target, worth, atol=1e-12)


# --- slips that nobody has seen -------------------------------------------------------------------


@examples(15)
@given(rngs())
def test_a_symmetric_top_is_right_and_what_is_done_to_it_is_found(rng):
    """In closed form: it spins about its axis, which goes round the momentum."""
    step, t = 4e-3, 4e-3 * np.arange(50)[:, None]
    around, along = 10.0 ** rng.uniform(-4.0, 2.0) * np.array([1.0, rng.uniform(1.3, 1.9)])
    first = Rotation.random(rng=int(rng.integers(1 << 31)))
    spin = rng.choice([-1.0, 1.0], 3) * rng.uniform(1.5, 3.0, 3)
    L = first.apply(np.array([around, around, along]) * spin)

    def top(faster=1.0):
        own = [0.0, 0.0, along * spin[2] * (1.0 / along - 1.0 / around)]
        turned = Rotation.from_rotvec(t * faster * L / around) * first
        turned = turned * Rotation.from_rotvec(t * own)
        return turned.as_matrix(), faster * L / around + turned.apply(own)

    R, w = top()
    moments = np.array([around, around, along])
    at, axis = int(rng.integers(50)), int(rng.integers(3))
    bump, hole = np.zeros((2, *w.shape))
    bump[at, axis], hole[at, axis] = 0.6, np.nan
    broken = R.copy()
    broken[at, axis] *= 1.001
    swapped = R[:, :, [1, 0, 2]]
    batch = {
        "right": (R, w, moments, 0),
        "backwards": (R[::-1], -w[::-1], moments, 0),
        "single precision": (R.astype(np.float32), w.astype(np.float32), moments, 0),
        "another body in proportion": (R, w, 1e3 * moments, 0),
        "mirror": (swapped, w, moments, 1),
        "stretched once": (broken, w, moments, 1),
        "no number": (R + hole[:, None], w, moments, 1),
        "no rate": (R, w + hole, moments, 2),
        "body's axes": (R, np.einsum("nji,nj->ni", R, w), moments, 2),
        "once": (R, w + bump, moments, 2),
        "slow": (R, 0.7 * w, moments, 2),
        "another body": (R, w, moments[::-1], 3),
        "goes round faster": (*top(1.5), moments, 3),
    }
    args: Any = [np.array([one[i] for one in batch.values()], dtype=float) for i in range(3)]
    result = solutions.catch_the_slip(*[*args, step])
    assert dict(zip(batch, result, strict=True)) == {name: one[3] for name, one in batch.items()}


@pytest.mark.parametrize("seed", range(4))
def test_the_drawn_programs_are_what_they_are_drawn_for_and_what_the_task_says(seed):
    rng = np.random.default_rng(seed)
    for verdict, family in enumerate((catch.RIGHT, catch.BENT, catch.LATE, catch.PUSHED)):
        drawn = [catch.program(kind, rng, 40) for kind in family]
        R, w, moments = (np.array(one) for one in zip(*drawn, strict=True))
        result = solutions.catch_the_slip(R, w, moments, catch.STEP)
        assert dict(zip(family, result, strict=True)) == dict.fromkeys(family, verdict)
        if verdict in (0, 3):
            assert np.linalg.norm(w, axis=2).max() * catch.STEP < 0.04
            assert np.linalg.norm(np.diff(w, axis=1), axis=2).max() < 0.3
            L = np.einsum("knij,kj,knlj,knl->kni", R, moments, R, w)
            error = np.linalg.norm(L - L[:, :1], axis=2).max(axis=1) / np.linalg.norm(
                L[:, 0], axis=1
            )
            assert np.all(error > 0.01 if verdict else error < 1e-6)


# --- the hunt -------------------------------------------------------------------------------------


@examples(30)
@given(rngs(), st.integers(1, 30), st.floats(0.05, 0.95))
def test_the_gate_is_scipys_over_first_runs_and_the_tally_is_of_sets(rng, n, gate):
    def night():
        return rng.integers(0, 12, n), rng.integers(-1, 2, n)

    (names, results), (old, before) = night(), night()
    solved = {s for s in set(names) if results[list(names).index(s)] == 1}
    once = {s for s in set(old) if before[list(old).index(s)] == 1}
    both = set(names) & set(old)
    low, tally, opens = solutions.silent_gate(names, results, old, before, gate)
    right = binomtest(len(solved), len(set(names))).proportion_ci(0.95, "wilson").low
    assert low == pytest.approx(right, abs=1e-12)
    assert tally.tolist() == [len((solved - once) & both), len((once - solved) & both)]
    assert opens == (right >= gate)


def test_the_starter_of_the_hunt_agrees_where_its_author_looked_and_only_there():
    names: dict = {}
    exec(cards.card("silent_gate").starter(), names)

    def same(*nights: Any) -> list[bool]:
        args: Any = (*nights, 0.3)
        pairs = zip(names["silent_gate"](*args), solutions.silent_gate(*args), strict=True)
        return [np.array_equal(got, np.asarray(right)) for got, right in pairs]

    seeds, new, old = [1, 2, 3, 4, 5], [1, 1, 0, 1, 0], [1, 0, 1, 1, 0]
    assert all(same(seeds, new, seeds, old))
    assert not same(seeds, [1, 1, 0, 1, -1], seeds, old)[0]
    assert not same([*seeds, 3], [*new, 1], seeds, old)[0]
    assert not same(seeds, new, [5, 1, 2, 3, 4], old)[1]


def test_one_count_moves_the_tip_of_an_arm_by_its_arc() -> None:
    """A stretched arm in the plane, each joint turned by one count of its encoder."""
    links, counts, ratio = np.array([0.5, 0.4, 0.2]), np.array([4096, 8192, 1024]), [100.0, 80, 50]
    reach = np.cumsum(links[::-1])[::-1]

    def tip(turned: np.ndarray) -> Any:
        heading = np.cumsum(turned)
        return np.array([links @ np.cos(heading), links @ np.sin(heading)])

    one = 2.0 * np.pi / counts / ratio
    each, total = solutions.tip_resolution(counts, ratio, reach)
    still = tip(np.zeros(3))
    for joint in range(3):
        moved = np.linalg.norm(tip(one * (np.arange(3) == joint)) - still)
        assert each[joint] == pytest.approx(1e3 * moved, rel=1e-4)
    assert total == pytest.approx(1e3 * np.linalg.norm(tip(one) - still), rel=1e-4)
