"""A task at two steps: what stays and what does not, by other ways to the same numbers."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.pipeline.timestep import Way, chain, prefers
from course.sim_to_real.shaping import evaluate_policy, value_iteration
from tests.budget import examples

OLD, NEW = 0.01, 0.001
WAY = Way()
KEPT = math.exp(-OLD / WAY.horizon)
PER_STEP = WAY.horizon * (1.0 - KEPT)


def always(path, speed, tired, falls):
    """Value of going at one speed all the way, in continuous time."""
    rate = 1.0 / path.horizon + falls
    missing = math.exp(-rate * path.seconds / speed)
    return missing * path.goal + (1.0 - missing) / rate * (falls * path.hurt - path.cost - tired)


def test_what_is_best_depends_on_what_is_kept():
    assert prefers(chain(WAY, OLD))[0] == "walk"
    assert prefers(chain(WAY, NEW))[0] == "walk"
    assert prefers(chain(WAY, NEW, KEPT, PER_STEP))[0] == "give up"  # -1 a step, as it stood
    assert prefers(chain(WAY, NEW, None, PER_STEP))[0] == "give up"
    assert prefers(chain(WAY, NEW, KEPT))[0] == "run"  # the goal is ten times as far


@examples(15)
@given(
    cost=st.floats(10.0, 400.0),
    effort=st.floats(0.0, 300.0),
    fall=st.floats(0.0, 5.0),
    horizon=st.floats(0.1, 5.0),
)
def test_rescaled_it_is_the_same_task_up_to_the_step(cost, effort, fall, horizon):
    path = Way(horizon=horizon, cost=cost, effort=effort, fall=fall)
    walk, run = always(path, 1.0, 0.0, 0.0), always(path, 2.0, effort, fall)
    for dt in (0.02, 0.01):
        process = chain(path, dt)
        n = process.terminal.size
        paid = math.exp(-(path.seconds - dt) / horizon) * path.goal  # one step early
        waits = cost * horizon * -math.expm1(-path.seconds / horizon)
        assert evaluate_policy(process, np.zeros(n))[0] == pytest.approx(paid - waits, abs=1e-9)
        deviation = evaluate_policy(process, np.ones(n))[0] - run
        # The goal is paid one step early. A step costs its full time, and a fall pays at its start:
        # each is too much by at most half a step, on a path that is run in half the time.
        early = math.expm1(dt / horizon) * path.goal
        late = 0.25 * path.seconds * dt * fall * (cost + effort - path.hurt / horizon)
        assert -late - 1e-9 <= deviation <= early + 1e-9
        result, value = prefers(process)
        best = max(walk, run, path.fee)
        assert value >= best - abs(deviation) - 1e-9
        if path.fee > max(walk, run) + 100.0 * dt * (1.0 + 1.0 / horizon):
            assert result == "give up"


def test_the_gap_between_actions_closes_with_the_step():
    """One step of the other action costs less, the shorter it is: what a learner has to tell apart
    (Tallec, Blier and Ollivier, 2019)."""
    gaps = []
    for dt in (OLD, NEW):
        process = chain(WAY, dt)
        q = process.backup(value_iteration(process).value)[0]
        gaps.append(q[0] - q[1])
    assert gaps[0] / gaps[1] == pytest.approx(OLD / NEW, rel=0.1)


def test_a_time_limit_in_steps_is_a_tenth_of_it():
    near, far = prefers(chain(WAY, OLD), 30), prefers(chain(WAY, NEW), 30)
    assert near[1] > 50.0
    assert -10.0 < far[1] < 0.0  # it waits for the cut, which is cheaper than to give up
    assert prefers(chain(WAY, NEW), 300)[1] == pytest.approx(near[1], rel=0.02)
