"""Chapter 9's small simulations against closed forms: what they show is what must come out."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import learning
from course.simulations import pen as draw
from course.simulations.learning import (
    action_chunks,
    clipped_objective,
    cloning_drift,
    denoising,
    gae_weights,
    policy_gradient,
)
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
    terminated, truncated = np.zeros((2, n), bool)
    (terminated if over else truncated)[-1] = True
    weights = gae_weights.error_weights(gamma, trace, n)
    rewards, critic = rng.normal(size=n), rng.normal(size=n + 1)
    truth = learning.gae(rewards, critic[:-1], critic[1:], terminated, truncated, gamma, trace)[0]
    errors = rewards + gamma * np.append(critic[1:-1], 0.0 if over else critic[-1]) - critic[:-1]
    assert weights @ errors == pytest.approx(truth, abs=1e-9)
    noise = rng.normal(size=n)
    critic = gae_weights.values_of(controls)
    rewards = gae_weights.rewards_of(controls, noise)
    truth = learning.gae(rewards, critic[:-1], critic[1:], terminated, truncated, gamma, trace)[0]
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


@pytest.mark.prove
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
    for end, factor in ((gae_weights.TERMINATED, 0.0), (gae_weights.TRUNCATED, 0.99**20)):
        controls = gae_weights.CONTROLS.new(end=end, error=0.4)
        assert gae_weights.bias(controls, 0.0) == pytest.approx(0.99 * 0.4)
        assert gae_weights.bias(controls, 1.0) == pytest.approx(factor * 0.4, abs=1e-12)
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


def test_without_noise_every_path_gives_the_same_advantage():
    """From sums of squares the deviation of 10 equal advantages came out as 1e-8."""
    run = Experiment(gae_weights.MODEL, trace=1.0, discount=0.875, end=1, error=0.46875, noise=0.0)
    run.advance(1.0)
    assert run.state["count"] == 41
    assert run.state["squares"] == 0.0
    expected = gae_weights.bias(run.controls, 1.0)
    assert run.state["mean"] + 0.46875 == pytest.approx(expected, abs=1e-12)


def test_an_error_that_is_rounding_has_no_bar():
    """An exact critic without noise: its temporal-difference errors are zero."""
    values = {"discount": 0.875, "steps": 10, "end": 1, "error": 0.0, "noise": 0.0, "trace": 0.5}
    run = Experiment(gae_weights.MODEL, **values)
    assert abs(run.state["errors"]).max() < 1e-15

    def bars():
        return sum(i.kind == draw.POLYGON for i in draw.decode(run.picture()))

    # Some CPUs compute these errors as exactly zero, others as 1e-17.
    for rounding in (0.0, 1e-17, -1e-15):
        run.state["errors"][:10] = rounding
        assert bars() == 20
    # Ten errors have a bar each, and so have their ten weighted contributions.
    run.state["errors"][:10] = 1e-3
    assert bars() == 40


# --- PPO's clipped objective ----------------------------------------------------------------------


@examples(60)
@given(st.floats(0.0, 2.5), st.floats(-2.0, 2.0), st.floats(0.05, 0.6))
def test_the_point_lies_on_the_chapters_objective(ratio, advantage, clip):
    run = Experiment(clipped_objective.MODEL, ratio=ratio, advantage=advantage, clip=clip)
    value, slope = learning.clipped_objective(np.array([ratio]), np.array([advantage]), clip)
    # Equation 7 of the paper, written out.
    clipped = min(max(ratio, 1.0 - clip), 1.0 + clip)
    assert value[0] == pytest.approx(min(ratio * advantage, clipped * advantage))
    assert number(run, "clipped objective") == pytest.approx(value[0], abs=0.0051)
    assert number(run, "slope") == pytest.approx(slope[0], abs=0.0051)
    assert number(run, "without the clip") == pytest.approx(ratio * advantage, abs=0.0051)


@pytest.mark.parametrize(
    ("advantage", "ratio", "flat"),
    [
        (1.0, 0.5, False),
        (1.0, 1.0, False),
        (1.0, 1.5, True),
        (-1.0, 0.5, True),
        (-1.0, 1.0, False),
        (-1.0, 1.5, False),
    ],
)
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


# --- policy gradient ------------------------------------------------------------------------------

MEANS = ((-1.4, -0.9), (0.2, 0.1), (2.0, -1.0))


def many_votes(mean, spread, baseline, n=200_000):
    noise = np.random.default_rng(4).normal(size=(n, 2))
    return policy_gradient.votes(np.array(mean), spread, baseline, noise)


@pytest.mark.parametrize("mean", MEANS)
def test_the_true_gradient_is_that_of_the_mean_reward(mean):
    rng, spread = np.random.default_rng(6), 0.6
    actions = mean + spread * rng.normal(size=(200_000, 2))
    sampled = policy_gradient.reward(*actions.T)
    expected = policy_gradient.expected_reward(np.array(mean), spread)
    assert sampled.mean() == pytest.approx(expected, abs=5.0 * sampled.std() / math.sqrt(200_000))
    for k in range(2):
        step = np.eye(2)[k] * 1e-5
        ends = [policy_gradient.expected_reward(mean + d, spread) for d in (step, -step)]
        slope = (ends[0] - ends[1]) / 2e-5
        assert policy_gradient.true_gradient(np.array(mean))[k] == pytest.approx(slope, abs=1e-6)


@pytest.mark.parametrize("mean", MEANS)
@pytest.mark.parametrize("baseline", [False, True])
@pytest.mark.parametrize("spread", [0.1, 0.5, 1.0])
def test_votes_are_unbiased_and_have_the_variance_of_the_closed_form(mean, baseline, spread):
    value = policy_gradient.expected_reward(np.array(mean), spread) if baseline else 0.0
    advantages, votes = many_votes(mean, spread, value)
    variance = policy_gradient.vote_variance(np.array(mean), spread, value)
    assert votes.var(axis=0).sum() == pytest.approx(variance, rel=0.03)
    error = np.linalg.norm(votes.mean(axis=0) - policy_gradient.true_gradient(np.array(mean)))
    assert error < 4.0 * math.sqrt(variance / len(votes))
    # A vote is the advantage times the derivative of the logarithm of the normal density.
    z = np.random.default_rng(4).normal(size=(200_000, 2))[:3]
    for k in range(3):
        action, step = mean + spread * z[k], np.array([1e-6, 0.0])

        def log_density(at, action=action):
            return -0.5 * np.sum((action - at) ** 2) / spread**2

        score = (log_density(mean + step) - log_density(mean - step)) / 2e-6
        assert votes[k, 0] == pytest.approx(advantages[k] * score, rel=1e-5, abs=1e-6)


@examples(60)
@given(st.floats(-2.6, 2.6), st.floats(-2.6, 2.6), st.floats(0.1, 1.0))
def test_the_baseline_reduces_the_variance_wherever_rewards_are_far_from_zero(x, y, spread):
    """The variance is 2 (b - 2 tr q)^2 plus a constant, with b = tr q where the baseline is on."""
    mean, trace = np.array([x, y]), spread**2 * policy_gradient.CURVES.sum()
    value = policy_gradient.expected_reward(mean, spread)
    on, without = (policy_gradient.vote_variance(mean, spread, b) for b in (value, 0.0))
    gain = abs(policy_gradient.reward(x, y) - 2.0 * trace) - trace
    if abs(gain) > 1e-6:
        assert (on < without) == (gain > 0.0)


def test_averages_over_many_seeds_are_unbiased_and_as_far_off_as_is_shown():
    for baseline in (True, False):
        errors = []
        for seed in range(1, 99):
            run = Experiment(policy_gradient.MODEL, seed=seed, baseline=baseline)
            average = policy_gradient.estimate(run.controls, run.state)
            errors.append(average - policy_gradient.true_gradient(np.array(run.state["mean"])))
        shown, deviation = number(run, "error, expected"), np.array(errors)
        size = math.sqrt(np.mean(np.sum(deviation**2, axis=1)))
        assert size == pytest.approx(shown, rel=0.25)
        assert np.linalg.norm(deviation.mean(axis=0)) < 4.0 * shown / math.sqrt(98)


def test_play_follows_the_estimate_to_the_top_and_a_drag_sets_the_start():
    run = Experiment(policy_gradient.MODEL, samples=200)
    ahead = run.state["mean"] + run.controls["rate"] * policy_gradient.estimate(
        run.controls, run.state
    )
    run.advance(policy_gradient._PACE)
    assert np.allclose(run.state["mean"], ahead) and run.state["steps"] == 1
    for _ in range(60):
        run.advance(policy_gradient._PACE)
    assert np.linalg.norm(run.state["mean"] - policy_gradient.GOAL) < 0.3
    run.drag(*at_values(policy_gradient._SCENE, policy_gradient._VIEW, 0.5, -1.0))
    assert np.allclose(run.state["mean"], (0.5, -1.0))


# --- how a clone drifts ---------------------------------------------------------------------------


@pytest.mark.parametrize("inside", [0.0, 0.1, 1.0, 5.0])
def test_both_ends_are_the_chapters_costs(inside):
    """Lost for good, and as safe off the path as on it."""
    steps = np.arange(101)
    for outside, recovers in ((100.0, False), (inside, True)):
        controls = cloning_drift.CONTROLS.new(inside=inside, outside=outside)
        expected = learning.expected_cost(0.01 * inside, steps, recovers=recovers)
        assert np.allclose(cloning_drift.mean_cost(controls, 100), expected, atol=1e-9)


@examples(40)
@given(st.floats(0.0, 0.05), st.floats(0.0, 0.99), st.integers(10, 200))
def test_the_cost_between_both_ends_has_the_closed_form_of_a_chain(inside, outside, steps):
    rates = cloning_drift.wrong_rates(inside, outside, steps)
    q, t = outside - inside, np.arange(steps + 1)
    assert np.allclose(rates, inside * (1.0 - q**t) / (1.0 - q), atol=1e-12)


@pytest.mark.parametrize("preset", cloning_drift.MODEL.presets)
def test_the_runs_of_many_seeds_drift_as_expected(preset):
    measured, rates = [], []
    for seed in range(1, 31):
        values = dict(cloning_drift.MODEL.presets[preset].values) | {"seed": seed}
        run = Experiment(cloning_drift.MODEL, **values)
        steps = run.controls["steps"]
        measured.append(run.state["cost"][steps])
        rates.append(run.state["rate"][steps])
    expected = cloning_drift.mean_cost(run.controls, steps)
    error = np.std(measured) / math.sqrt(30)
    assert np.mean(measured) == pytest.approx(expected[steps], abs=5.0 * error)
    assert np.mean(rates) == pytest.approx(
        expected[steps] - expected[steps - 1], abs=5.0 * np.std(rates) / math.sqrt(30) + 1e-3
    )


def test_a_wrong_step_leads_on_to_the_side_and_a_right_one_back():
    run = Experiment(cloning_drift.MODEL, inside=5.0, outside=60.0, steps=200)
    place = np.abs(run.state["place"])
    before, after = place[:-1], place[1:]
    wrong = after > 0.0
    assert wrong.any() and np.allclose(after[wrong], before[wrong] + cloning_drift.STEP)
    assert wrong.mean() == pytest.approx(run.state["cost"][200] / 200, abs=0.02)
    lost = Experiment(cloning_drift.MODEL, inside=2.0, outside=100.0).state["place"][:101]
    assert np.all(np.diff(np.abs(lost), axis=0) >= 0.0)


def test_the_square_law_and_the_straight_line_of_the_presets():
    run = Experiment(cloning_drift.MODEL)
    run.choose("A small error rate")
    first = number(run, "expected at T")
    run.set(steps=200)
    assert number(run, "expected at T") / first == pytest.approx(4.0, abs=0.2)
    run.choose("DAgger: labels off the path too")
    assert number(run, "expected at T") == number(run, "ε T, recovers") == 1.0
    run.choose("Errors are often corrected")
    assert number(run, "expected at T") == pytest.approx(5.0 * 1.0, rel=0.1)


# --- denoising ------------------------------------------------------------------------------------

FLOWS = [
    {},
    {"share": 0.1, "width": 0.3},
    {"share": 0.8, "width": 0.05},
]


def distribution(controls, x, time):
    """Distribution function of the samples at a time."""
    from scipy.special import ndtr

    weights, means, deviations = denoising.mixture(controls)
    widths = np.sqrt((time * deviations) ** 2 + (1.0 - time) ** 2)
    return sum(
        w * ndtr((x - time * m) / s) for w, m, s in zip(weights, means[:, 0], widths, strict=True)
    )


def test_the_noise_lies_on_the_quantiles_of_a_normal_distribution():
    from scipy.special import ndtri

    n = denoising.SAMPLES
    assert np.allclose(denoising.NOISE, ndtri((np.arange(n) + 0.5) / n), atol=5e-4)


@pytest.mark.parametrize("values", FLOWS)
def test_the_exact_flow_keeps_the_quantile_of_each_sample(values):
    """In one dimension a flow keeps the order, so each sample stays on its quantile."""
    from scipy.special import ndtr

    run = Experiment(denoising.MODEL, **values)
    for time in (0.0, 0.2, 0.5, 0.8, 1.0):
        now = denoising.position(run.state["exact"], denoising._FINE, time)
        reached = distribution(run.controls, now, time)
        assert np.allclose(reached, ndtr(denoising.NOISE), atol=4e-3), time


@pytest.mark.parametrize("values", FLOWS)
@pytest.mark.parametrize("solver", ["Euler", "Heun"])
@pytest.mark.parametrize("steps", [1, 3, 20])
def test_the_solver_is_the_chapters(values, solver, steps):
    run = Experiment(denoising.MODEL, steps=steps, solver=solver, **values)
    modes = learning.Mixture(*denoising.mixture(run.controls))
    noise = denoising.NOISE[:, None]
    end = learning.integrate(modes.velocity, noise, steps, solver.lower())[:, 0]
    assert np.allclose(run.state["path"][steps], end, atol=1e-9)
    away = np.abs(np.sort(end) - run.state["exact"][-1]).mean()
    assert number(run, "distance, at t = 1") == pytest.approx(away, abs=6e-4)


def test_the_distance_falls_with_the_order_of_the_solver():
    for solver, order in (("Euler", 1.0), ("Heun", 2.0)):
        far = []
        for steps in (12, 24):
            run = Experiment(denoising.MODEL, steps=steps, solver=solver, width=0.3)
            far.append(denoising.distance(run.state["path"], steps, run.state["exact"], 1.0))
        assert math.log2(far[0] / far[1]) == pytest.approx(order, abs=0.45), solver


@pytest.mark.parametrize("share", [0.1, 0.5, 0.75])
def test_one_euler_step_ends_at_the_mean_of_the_data(share):
    run = Experiment(denoising.MODEL, steps=1, share=share)
    assert np.allclose(run.state["path"][1], 2.0 * share - 1.0, atol=1e-12)


@pytest.mark.parametrize("values", FLOWS)
def test_the_density_is_the_slope_of_the_distribution(values):
    controls, x = denoising.CONTROLS.new(**values), np.linspace(-2.0, 2.0, 41)
    for time in (0.0, 0.5, 0.9, 1.0):
        slope = (
            distribution(controls, x + 1e-5, time) - distribution(controls, x - 1e-5, time)
        ) / 2e-5
        assert np.allclose(denoising.density(controls, x, time), slope, atol=1e-6)


def test_posterior_means_are_those_of_weighted_samples():
    """Bayes' rule over many samples of the data, in two dimensions."""
    modes = learning.Mixture(
        np.array([0.3, 0.7]), np.array([[-1.0, 0.5], [1.0, 0.0]]), np.array([0.4, 0.2])
    )
    clean = modes.draw(400_000, np.random.default_rng(2))
    x, a, s = np.array([[0.1, 0.3], [-0.6, 0.2]]), 0.6, 0.5
    for k, mean in enumerate(modes.expect(x, a, s)[0]):
        weight = np.exp(-0.5 * np.sum((x[k] - a * clean) ** 2, axis=1) / s**2)
        assert np.allclose(mean, weight @ clean / weight.sum(), atol=0.01)
    clean_mean, noise_mean = modes.expect(x, a, s)
    assert np.allclose(a * clean_mean + s * noise_mean, x)


# --- chunks of actions ----------------------------------------------------------------------------

timings = {
    "length": st.integers(1, 40),
    "executed": st.integers(1, 40),
    "latency": st.floats(0.0, 400.0),
    "mode": st.sampled_from((action_chunks.AHEAD, action_chunks.WAITS)),
}


def played(controls, periods):
    """Ages of the observations in periods, None without an action, by playing the loop."""
    length, waits = int(controls["length"]), controls["mode"] == action_chunks.WAITS
    executed, delay = min(int(controls["executed"]), length), 0
    # Up to a part in 1e9 of a period, a latency counts as whole periods.
    while delay * 20.0 < controls["latency"] - 2e-8:
        delay += 1
    result: list[int | None] = [None] * periods
    ready = 0
    while ready < periods:
        observed = ready - delay
        if waits:  # all of its part, then a look, then the wait
            following = ready + executed + delay
            last = ready + executed
        else:  # the next look: so early that it is ready in time, but one prediction at a time
            following = max(ready + executed - delay, ready) + delay
            last = min(following, observed + length)
        for t in range(ready, min(last, periods)):
            result[t] = t - observed
        ready = following
    return result


@pytest.mark.slow
@examples(150)
@given(st.fixed_dictionaries(timings))
def test_ages_are_those_of_a_loop_that_is_played(values):
    controls = action_chunks.CONTROLS.new(**values)
    _, _, cycle = action_chunks.schedule(controls)
    expected = played(controls, 3 * cycle)
    shown = [action_chunks.age_at(controls, t) for t in range(3 * cycle)]
    assert shown == pytest.approx([-1.0 if age is None else 0.02 * age for age in expected])
    known = [0.02 * age for age in expected if age is not None]
    truth = (min(known), np.mean(known), max(known)) if known else (-1.0, -1.0, -1.0)
    assert action_chunks.ages(controls) == pytest.approx(truth)
    run = Experiment(action_chunks.MODEL, **values)
    idle = 100.0 * (1.0 - len(known) / len(expected))
    assert number(run, "time without action") == pytest.approx(idle, abs=0.51)


def test_the_presets_show_what_they_say():
    numbers = {}
    for name in action_chunks.MODEL.presets:
        run = Experiment(action_chunks.MODEL)
        run.choose(name)
        numbers[name] = run.picture().numbers
    assert numbers["Eight of sixteen"]["time without action"] == "0 %"
    assert numbers["One action per chunk"]["age, mean"] == "20 ms"
    assert numbers["One action per chunk"]["predictions"] == "50.0 per s"
    assert numbers["The robot waits"]["time without action"] != "0 %"
    assert numbers["The chunk runs out"]["actions used"] == "4 of 12"
