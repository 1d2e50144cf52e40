"""Chapter 9's small simulations against closed forms: what they show is what must come out."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import learning
from course.simulations import pen as draw
from course.simulations.learning import clipped_objective, gae_weights
from course.simulations.model import Experiment
from tests.budget import examples


def number(experiment, name):
    """A number as it is printed below the picture."""
    text = experiment.picture().numbers[name].split()[0].strip("°%")
    return float(text.replace("\N{MINUS SIGN}", "-"))


def at_values(rectangle, values, x, y):
    """The point of the window where an area shows the values (x, y)."""
    return draw.values_at(values, rectangle, x, y)


# --- weights of GAE -------------------------------------------------------------------------------

estimates = {
    "trace": st.floats(0.0, 1.0),
    "discount": st.floats(0.8, 1.0),
    "steps": st.integers(2, gae_weights.LONGEST),
    "end": st.sampled_from((gae_weights.TERMINATED, gae_weights.TRUNCATED)),
    "error": st.floats(-0.5, 0.5),
    "noise": st.floats(0.0, 0.5),
}


@examples(60)
@given(st.fixed_dictionaries(estimates), st.integers(0, 1000))
def test_the_weighted_errors_are_the_chapters_gae(values, seed):
    """Random rewards and values too: the weights don't know where the errors come from."""
    controls = gae_weights.CONTROLS.new(**values)
    rng, n = np.random.default_rng(seed), values["steps"]
    gamma, trace = values["discount"], values["trace"]
    over = values["end"] == gae_weights.TERMINATED
    ends = np.zeros((2, n), bool)
    ends[0 if over else 1, -1] = True
    weights = gae_weights.error_weights(gamma, trace, n)
    rewards, critic = rng.normal(size=n), rng.normal(size=n + 1)
    truth = learning.gae(rewards, critic[:-1], critic[1:], *ends, gamma, trace)[0]
    errors = rewards + gamma * np.append(critic[1:-1], 0.0 if over else critic[-1]) - critic[:-1]
    assert weights @ errors == pytest.approx(truth, abs=1e-9)
    noise = rng.normal(size=n)
    critic = gae_weights.values_of(controls)
    rewards = gae_weights.rewards_of(controls, noise)
    truth = learning.gae(rewards, critic[:-1], critic[1:], *ends, gamma, trace)[0]
    errors = gae_weights.temporal_differences(controls, noise)
    assert weights @ errors == pytest.approx(truth, abs=1e-9)


@examples(40)
@given(st.floats(0.0, 1.0), st.floats(0.8, 1.0), st.integers(2, 30), st.integers(0, 1000))
def test_n_step_advantages_with_their_weights_add_up_to_the_same(trace, gamma, steps, seed):
    errors = np.random.default_rng(seed).normal(size=steps)
    n_step = np.cumsum(gamma ** np.arange(steps) * errors)
    weights = gae_weights.n_step_weights(trace, steps)
    assert weights.sum() == pytest.approx(1.0, abs=1e-12)
    expected = gae_weights.error_weights(gamma, trace, steps) @ errors
    assert weights @ n_step == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("end", [gae_weights.TERMINATED, gae_weights.TRUNCATED])
@pytest.mark.parametrize("trace", [0.0, 0.7, 0.95, 1.0])
def test_bias_and_deviation_are_those_of_many_sampled_paths(trace, end):
    values = {"trace": trace, "end": end, "error": 0.3, "noise": 0.2, "discount": 0.95, "steps": 15}
    controls, n = gae_weights.CONTROLS.new(**values), 20_000
    noise = np.random.default_rng(5).normal(size=(n, 15))
    errors = np.array([gae_weights.temporal_differences(controls, row) for row in noise])
    sampled = errors @ gae_weights.error_weights(0.95, trace, 15)
    width = gae_weights.deviation(controls, trace)
    assert sampled.std() == pytest.approx(width, rel=0.03)
    # The values without error are exact, so the true advantage is zero.
    assert sampled.mean() + 0.3 == pytest.approx(
        gae_weights.bias(controls, trace), abs=5.0 * width / math.sqrt(n)
    )


def test_both_ends_of_lambda_have_their_textbook_bias():
    for end, left in ((gae_weights.TERMINATED, 0.0), (gae_weights.TRUNCATED, 0.99**20)):
        controls = gae_weights.CONTROLS.new(end=end, error=0.4)
        assert gae_weights.bias(controls, 0.0) == pytest.approx(0.99 * 0.4)
        assert gae_weights.bias(controls, 1.0) == pytest.approx(left * 0.4, abs=1e-12)
        assert gae_weights.deviation(controls, 0.0) == pytest.approx(0.1)


def test_the_measured_numbers_approach_the_predicted_ones_and_begin_again_with_lambda():
    run = Experiment(gae_weights.MODEL)
    run.advance(5.0)
    n, width = number(run, "paths sampled"), number(run, "standard deviation")
    assert n == 201
    assert number(run, "bias, measured") == pytest.approx(
        number(run, "bias"), abs=4.0 * width / math.sqrt(n)
    )
    assert number(run, "deviation, measured") == pytest.approx(width, rel=0.25)
    assert number(run, "horizon 1/(1 − γλ)") == pytest.approx(1.0 / (1.0 - 0.99 * 0.95), abs=0.06)
    run.set(trace=0.5)
    assert number(run, "paths sampled") == 0
    run.advance(0.25)
    assert number(run, "paths sampled") == 10
    assert (
        Experiment(gae_weights.MODEL, trace=1.0, discount=1.0)
        .picture()
        .numbers["horizon 1/(1 − γλ)"]
        == "no limit"
    )


# --- PPO's clipped objective ----------------------------------------------------------------------


@examples(60)
@given(st.floats(0.0, 2.5), st.floats(-2.0, 2.0), st.floats(0.05, 0.6))
def test_the_point_lies_on_the_chapters_objective(ratio, advantage, clip):
    run = Experiment(clipped_objective.MODEL, ratio=ratio, advantage=advantage, clip=clip)
    value, slope = learning.objective(np.array([ratio]), np.array([advantage]), clip)
    # Equation 7 of the paper, written out.
    kept = min(max(ratio, 1.0 - clip), 1.0 + clip)
    assert value[0] == pytest.approx(min(ratio * advantage, kept * advantage))
    assert number(run, "clipped objective") == pytest.approx(value[0], abs=0.0051)
    assert number(run, "slope") == pytest.approx(slope[0], abs=0.0051)
    assert number(run, "without the clip") == pytest.approx(ratio * advantage, abs=0.0051)


@pytest.mark.parametrize(
    ("advantage", "ratio", "flat"),
    [(1.0, 0.5, False), (1.0, 1.0, False), (1.0, 1.5, True),
     (-1.0, 0.5, True), (-1.0, 1.0, False), (-1.0, 1.5, False)],
)  # fmt: skip
def test_two_of_the_six_fields_have_no_gradient(advantage, ratio, flat):
    run = Experiment(clipped_objective.MODEL, advantage=advantage, ratio=ratio)
    pushes = "pushes ρ up" if advantage > 0.0 else "pushes ρ down"
    assert run.picture().numbers["effect"] == ("no gradient" if flat else pushes)
    step = 1e-5
    ends = [clipped_objective.clipped(ratio + d, advantage, 0.2)[0] for d in (step, -step)]
    difference = (ends[0] - ends[1]) / (2.0 * step)
    assert number(run, "slope") == pytest.approx(difference, abs=1e-6)


@pytest.mark.parametrize("advantage", [-2.0, -0.5, 0.5, 2.0])
def test_the_ascent_stops_at_the_edge_of_the_clip(advantage):
    run = Experiment(clipped_objective.MODEL, advantage=advantage, clip=0.3)
    for _ in range(20):
        run.advance(0.5)
    edge = 1.0 + math.copysign(0.3, advantage)
    assert run.state["ratio"] == pytest.approx(edge, abs=0.006)
    assert run.picture().numbers["effect"] == "no gradient"


def test_a_drag_sets_ratio_and_on_the_right_advantage_too():
    run = Experiment(clipped_objective.MODEL)
    view = clipped_objective._view(run.controls)
    run.drag(*at_values(clipped_objective._LEFT, view, 1.7, 0.3))
    assert run.state["ratio"] == pytest.approx(1.7) and run.controls["advantage"] == 1.0
    run.drag(*at_values(clipped_objective._RIGHT, clipped_objective._MAP_VIEW, 0.4, -1.5))
    assert run.state["ratio"] == pytest.approx(0.4)
    assert run.controls["advantage"] == pytest.approx(-1.5)
    run.press("ArrowRight")
    assert run.state["ratio"] == pytest.approx(0.42)
