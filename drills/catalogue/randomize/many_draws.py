"""Many draws: repetition, restoring, distributions, delay, noise, and ranges of one value."""

from __future__ import annotations

from math import erfc
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.catalogue.randomize.bench import (
    ALLOWED,
    CHANCE,
    CONSTANTS,
    DRAWS,
    ENTRY,
    FAR,
    PRIMARY,
    ROUNDING,
    Array,
    Arrays,
    Bench,
    Setting,
    same_arrays,
)
from drills.catalogue.randomize.one_draw import (
    check_constants,
    check_state,
    contact_frictions,
    friction_slip,
)
from drills.values import Mismatch, as_float64, describe, identical


def repeated(bench: Bench, first: Arrays, seeds: list[int]) -> None:
    """Draw often, draw the first one again, restore, and only then say what was wrong."""
    attempt, learner = bench.attempt, bench.learner
    action = [np.zeros(bench.default.nu)]
    bench.draw(40, seeds[1], action)
    again = bench.randomize(seeds[0])
    state, computed = bench.state(), bench.computed()
    learner.method(bench.randomizer, "restore", bench.data)
    restored = bench.arrays()
    now = bench.state()

    gaps = [
        float(np.max(np.abs(again[k] - first[k]) / np.maximum(np.abs(first[k]), 1e-9)))
        for k in PRIMARY
    ]
    gap = max(gaps) if np.isfinite(gaps).all() else np.inf
    back = _equal(restored, bench.before, ("body_mass", "body_inertia", "dof_damping"))
    # One draw cannot leave these ranges: an answer that does has multiplied one draw by another.
    drifted = bool(
        np.any(bench.factors(again["body_mass"]) < bench.setting.mass[0])
        or np.any(bench.factors(again["body_mass"]) > bench.setting.mass[1])
        or np.any(again["dof_damping"] > bench.default.dof_damping + 2.0 * bench.setting.damping[1])
    )
    views = drifted and not back
    slip = "defaults_are_views" if views else "compounding" if drifted else ""
    attempt.require(
        "the same seed after 40 draws",
        gap <= 1e-9,
        sentence="The same seed gives another model than at first"
        + (": the values drift away." if drifted else ". What else does a draw depend on?"),
        error=gap,
        tolerance=1e-9,
        unit="1",
        why=ROUNDING,
        slip=slip,
    )

    def named(changed: list[str]) -> str:
        if views:
            return "defaults_are_views"
        if set(changed) <= set(CONSTANTS):
            return "restored_by_recomputing"
        return "" if back else "not_restored"

    same_arrays(
        attempt,
        "restored bit for bit",
        bench.before,
        restored,
        slip=named,
        sentence="After restore these arrays differ from what they were: ",
    )
    if not attempt.failed:
        check_state(bench, bench.before, state, now, "restore", computed)
        undelayed(bench, "after restore")


def _equal(a: Arrays, b: Arrays, names: tuple[str, ...]) -> bool:
    return all(np.array_equal(a[name], b[name]) for name in names)


def _distance(values: Array, low: float, high: float) -> float:
    """Return kolmogorov-Smirnov distance from the uniform distribution between two ends."""
    x = np.sort((values - low) / (high - low))
    n = x.size
    return float(max(np.max(np.arange(1, n + 1) / n - x), np.max(x - np.arange(n) / n)))


def undelayed(bench: Bench, when: str) -> None:
    """Actions come back at once."""
    actions = [np.full(bench.default.nu, float(k)) for k in range(1, 4)]
    due = [bench.learner.method(bench.randomizer, "delay", action) for action in actions]
    bench.attempt.compare(
        f"no delay {when}",
        due,
        np.array(actions),
        tolerance=0.0,
        unit="1",
        why="an action is handed on as it is",
        call="delay(action)",
    )


def defaults(bench: Bench, seed: int) -> None:
    """A randomizer that is told nothing but its model draws from the ranges of the signature."""
    attempt, report = bench.attempt, bench.setting
    ranges = (0.4, 1.2), (0.7, 1.3), (0.0, 0.5), (0, 3), 0.01, 0.0
    other = Bench(attempt, Setting(report.xml, report.tuned, *ranges, left_out=True))
    first = other.randomize(seed)
    if same_arrays(attempt, "nothing else changes", other.before, first, ALLOWED):
        distributions(other, first, seed, " with the defaults of the signature")
    if attempt.failed:
        return
    truth = attempt.rng.uniform(-1.0, 1.0, size=2000)
    observed = attempt.learner.method(other.randomizer, "observe", truth, other.generator(seed))
    noise = attempt.numbers("an observation with the default noise", observed, truth.shape)
    if noise is None:
        return
    ratio, allowed = float((noise - truth).std() / other.setting.noise), 6.0 / np.sqrt(4000.0)
    attempt.require(
        "noise with the defaults of the signature",
        bool(abs(ratio - 1.0) <= allowed),
        sentence=f"The noise has {ratio:.3g} times the standard deviation of the signature.",
        error=abs(ratio - 1.0),
        tolerance=allowed,
        unit="1",
        why=CHANCE,
    )


def distributions(bench: Bench, first: Arrays, seed: int, how: str = "") -> None:
    """Check that draws have the right distribution, independent for each body and joint."""
    attempt, setting = bench.attempt, bench.setting
    actions = [np.full(bench.default.nu, float(k)) for k in range(1, 8)]
    drawn = bench.draw(DRAWS, seed, actions)
    factors = bench.factors(drawn["body_mass"])
    added = (drawn["dof_damping"] - bench.default.dof_damping)[:, bench.damped]
    for name, values, (low, high), unit in (
        (
            "distribution of friction",
            drawn["geom_friction"][..., 0].max(axis=1, keepdims=True),
            setting.friction,
            "1",
        ),
        ("distribution of mass factors", factors, setting.mass, "1"),
        ("distribution of damping", added, setting.damping, "N m s/rad"),
    ):
        distance = max(_distance(column, low, high) for column in values.T)
        if distance <= FAR:  # all together tell more than each alone
            fewer = np.sqrt(DRAWS / values.size)
            distance = max(distance, _distance(values.ravel(), low, high) / float(fewer))
        attempt.require(
            name,
            distance <= FAR,
            sentence=f"{DRAWS} draws{how} are not uniform between {low:.4g} and {high:.4g} {unit}: "
            f"they range from {values.min():.4g} to {values.max():.4g}, with a mean of "
            f"{values.mean():.4g}.",
            error=distance,
            tolerance=FAR,
            unit="1",
            why=CHANCE,
        )
    for name, values, slip in (
        ("a factor for each body", factors, "one_factor_for_all"),
        ("a draw for each joint", added, "one_damping_for_all"),
    ):
        same = bool(np.all(np.ptp(values, axis=1) < 1e-9))
        attempt.require(
            name, not same, sentence="In every draw all of them got the same value.", slip=slip
        )
    if not attempt.failed:
        _lags(bench, drawn["delayed"], actions)


def _lags(bench: Bench, delayed: Any, actions: list[Array]) -> None:
    """How many calls late the actions come, after each draw."""
    attempt, (low, high), idle = bench.attempt, bench.setting.delay, bench.setting.idle
    shape = (DRAWS, len(actions), bench.default.nu)
    try:
        got = as_float64(delayed, shape, "what delay returned")
    except Mismatch as wrong:
        _mismatch(attempt, "what delay returns", wrong, "delay(action)")
        return
    sent = np.array(actions)[None] + 100.0 * np.arange(DRAWS)[:, None, None]
    fits = _shifted(got, sent, idle)
    lags = np.where(fits.any(axis=0), fits.argmax(axis=0), -1).tolist()
    counts = np.bincount([lag for lag in lags if lag >= 0], minlength=high + 2)
    strange = lags.count(-1)
    slip = ""
    if strange:
        place = lags.index(-1)
        message = f"delay returned {describe(got[place, :, 0])} for {describe(sent[place, :, 0])}."
        positive = got[..., 0] > 0.5
        if _shifted(got, sent, float(np.trunc(idle))).any(axis=0).all():
            slip = "idle_cut_off"
        elif (positive & (got[..., 0] < sent[:, :1, 0] - 0.5)).any():
            slip = "old_actions_kept"
        elif np.array_equal(got[:, -1], sent[:, -1]):
            slip = "newest_returned"
    elif counts[0] == DRAWS:
        message, slip = "Every action comes back at once, whatever the delay.", "newest_returned"
    elif counts[: low + 1].tolist()[:low] != [0] * low or counts[high + 1 :].any():
        message, slip = f"Delays of {_listed(counts)} calls came up.", "one_call_off"
    else:
        message, slip = f"In {DRAWS} draws only delays of {_listed(counts)} calls came up.", ""
        if counts[high] == 0:
            slip = "end_excluded"
    expected = DRAWS / (high - low + 1)
    # Chance of one count to be this far off, by Hoeffding: as for the other distributions.
    error = float(np.max(np.abs(counts[low : high + 1] - expected))) / DRAWS
    attempt.require(
        "delays that were drawn",
        bool(not strange and counts[low : high + 1].sum() == DRAWS and error <= FAR),
        sentence=message,
        got=f"{_listed(counts)} calls",
        expected=f"{low} to {high} calls, equally often",
        error=error,
        tolerance=FAR,
        unit="1",
        why=CHANCE,
        slip=slip,
        call="delay(action)",
    )


def _effective_frictions(bench: Bench, drawn: dict[str, Any], first: Arrays) -> Array | None:
    """Return the one coefficient that the contacts get in each draw, shape (draws, 1)."""
    result = np.empty((DRAWS, 1))
    model = bench.here(first)
    for number in range(DRAWS):
        arrays = first | {name: drawn[name][number] for name in ("geom_friction", "pair_friction")}
        model.geom_friction[:] = arrays["geom_friction"]
        model.pair_friction[:] = arrays["pair_friction"]
        contacts = contact_frictions(model)
        values = np.array([*contacts.values()])
        if not np.ptp(values) <= 1e-12:
            text = ", ".join(f"{name}: {mu:.4g}" for name, mu in contacts.items())
            bench.attempt.require(
                "friction of all contacts in many draws",
                False,
                sentence="In one of many draws the contacts do not all have the draw: " + text,
                slip=friction_slip(bench, arrays),
            )
            return None
        result[number] = values[0]
    return result


def _mismatch(attempt: Attempt, name: str, wrong: Mismatch, call: str) -> None:
    text = wrong.sentence[0].upper() + wrong.sentence[1:]
    attempt.require(name, False, sentence=text, reason=wrong.reason, call=call)


def _same(got: Any, expected: Array) -> bool:
    try:
        return bool(np.array_equal(as_float64(got, expected.shape), expected))
    except Mismatch:
        return False


def _shifted(got: Array, sent: Array, idle: float) -> NDArray[np.bool_]:
    """Return whether each draw's actions arrive the given number of calls late.

    The actions have shape (draws, calls, n), the result (calls, draws).
    """
    calls = sent.shape[1]
    return np.array(
        [
            (got[:, :lag] == idle).all(axis=(1, 2))
            & (got[:, lag:] == sent[:, : calls - lag]).all(axis=(1, 2))
            for lag in range(calls)
        ]
    )


def _listed(counts: NDArray[Any]) -> str:
    return ", ".join(str(lag) for lag in np.flatnonzero(counts))


def reused_actions(bench: Bench, seed: int) -> None:
    """The caller's array may be written again while its actions are under way."""
    if bench.attempt.failed:
        return
    attempt, idle, (low, high) = bench.attempt, bench.setting.idle, bench.setting.delay
    actions = attempt.rng.normal(size=(9, bench.default.nu))
    expected = [
        np.vstack((np.full((k, bench.default.nu), idle), actions[: 9 - k])) for k in range(9)
    ]
    bench.randomize(seed)
    plain = [bench.learner.method(bench.randomizer, "delay", action) for action in actions]
    lags = [k for k in range(low, high + 1) if _same(plain, expected[k])]
    result = attempt.require(
        "a delay",
        bool(lags),
        sentence=f"What delay returned is no delay of {low} to {high} calls.",
        got=describe(plain),
        call="delay(action)",
    )
    if not result:
        return
    bench.randomize(seed)
    again = [bench.learner.method(bench.randomizer, "delay", action) for action in actions]
    due = attempt.require(
        "the same seed, the same delay",
        _same(again, expected[lags[0]]),
        sentence="The same seed gave another delay. Every random number must come from rng.",
        got=describe(again),
        expected=describe(plain),
        call="delay(action)",
    )
    if not due:
        return
    bench.randomize(seed)
    reused = bench.learner.given("delay_reused", bench.randomizer, [*actions])
    # An array that was kept itself gives back what its caller wrote last.
    aliased = np.where(np.arange(9)[:, None] < lags[0], expected[lags[0]], actions)
    attempt.compare(
        "actions handed over in one array",
        reused,
        expected[lags[0]],
        tolerance=0.0,
        unit="1",
        why="the same actions, in an array that the caller writes again",
        call="delay(action)",
        slip="action_not_copied" if _same(reused, aliased) else "",
    )


def noise_added(bench: Bench, seed: int) -> None:
    """Check one noisy observation against the worked answer's, drawn with the same seed."""
    attempt, learner, sigma = bench.attempt, bench.learner, bench.setting.noise
    truth = attempt.rng.uniform(-2.0, 2.0, size=5)
    rng = bench.generator(seed)
    back = learner.method(bench.randomizer, "observe", truth, rng)
    attempt.compare(
        "one observation",
        back,
        truth,
        tolerance=8.0 * sigma,
        unit="1",
        why="eight standard deviations: once in 1e15",
        call="observe(observation, rng)",
    )
    twice = learner.method(bench.randomizer, "observe", truth, bench.generator(seed))
    attempt.require(
        "the same seed, the same noise",
        identical(back, twice),
        sentence="Two generators with the same seed gave different noise. Every random number must "
        "come from rng.",
        got=describe(twice),
        expected=describe(back),
        call="observe(observation, rng)",
    )
    like = {"handed": truth, "shared": False}
    one = bench.read("observe", bench.randomizer, truth, rng, like=like)
    attempt.require(
        "observe leaves its argument",
        bool(np.array_equal(one["handed"], truth)) and not one["shared"],
        sentence="The array that was handed to observe holds the noise as well.",
        got=describe(one["handed"]),
        expected=describe(truth),
        slip="noise_in_place",
        call="observe(observation, rng)",
    )
    if attempt.failed:
        return
    observed = learner.given("observe_often", bench.randomizer, truth, rng, DRAWS)
    try:
        noise = as_float64(observed, (DRAWS, truth.size), "what observe returned") - truth
    except Mismatch as wrong:
        _mismatch(attempt, "what observe returns", wrong, "observe(observation, rng)")
        return
    frozen = bool(np.all(np.ptp(noise, axis=0) < 1e-12))
    moving = attempt.require(
        "noise is new in each call",
        not frozen,
        sentence=f"{DRAWS} calls had the same noise.",
        slip="same_noise",
        call="observe(observation, rng)",
    )
    single = bool(np.all(np.ptp(noise, axis=1) < 1e-12))
    moving &= attempt.require(
        "noise is new in each component",
        not single,
        sentence="All components of an observation got the same noise.",
        slip="one_noise_for_all",
        call="observe(observation, rng)",
    )
    if not moving:
        return
    # The standard deviation of n normal numbers is known to 1 / sqrt(2 n); six times that.
    allowed = 6.0 / np.sqrt(2.0 * noise.size)
    ratio = float(noise.std() / sigma)
    attempt.require(
        "standard deviation of the noise",
        abs(ratio - 1.0) <= allowed,
        sentence=f"The noise has {ratio:.3g} times the standard deviation asked for.",
        got=f"{noise.std():.4g}",
        expected=f"{sigma:.4g}",
        error=abs(ratio - 1.0),
        tolerance=allowed,
        unit="1",
        why=CHANCE,
        slip="variance_for_deviation"
        if abs(ratio / sigma - 1.0) < 0.15
        else "noise_uniform"
        if abs(ratio * np.sqrt(3.0) - 1.0) < 0.1 and np.abs(noise).max() <= sigma
        else "",
    )
    mean = float(np.max(np.abs(noise.mean(axis=0)))) / sigma
    attempt.require(
        "mean of the noise",
        mean <= 6.0 / np.sqrt(DRAWS),
        sentence=f"The noise of a component has a mean of {mean:.3g} standard deviations.",
        error=mean,
        tolerance=6.0 / np.sqrt(DRAWS),
        unit="1",
        why=CHANCE,
    )
    beyond = float(np.mean(np.abs(noise) > 2.0 * sigma))
    share = erfc(np.sqrt(2.0))  # of normal numbers, beyond two standard deviations
    # Standard deviation of a binomial share, times seven.
    allowed = 7.0 * np.sqrt(share * (1.0 - share) / noise.size)
    attempt.require(
        "normal distribution of the noise",
        abs(beyond - share) <= allowed,
        sentence=f"Of the noise {beyond:.3%} is beyond two standard deviations. Of normal noise "
        f"it is {share:.3%}.",
        error=abs(beyond - share),
        tolerance=allowed,
        unit="1",
        why=CHANCE,
    )


def equal_ends(bench: Bench, seed: int) -> None:
    """Ranges of one value, which leave nothing to chance."""
    attempt, setting = bench.attempt, bench.setting
    lag = int(attempt.rng.integers(0, 4))
    fixed = Setting(
        setting.xml, setting.tuned, (0.6, 0.6), (1.5, 1.5), (0.2, 0.2), (lag, lag), 0, 0
    )
    other = Bench(attempt, fixed)
    arrays = other.randomize(seed)
    if not same_arrays(attempt, "nothing else changes", other.before, arrays, ALLOWED):
        return
    factors = other.factors(arrays["body_mass"])
    added = arrays["dof_damping"] - other.default.dof_damping
    for name, got, want, unit in (
        ("mass factors", factors, np.full(factors.shape, 1.5), "1"),
        ("added damping", added, 0.2 * other.damped, "N m s/rad"),
    ):
        attempt.compare(
            f"{name} of a range with equal ends", got, want, tolerance=1e-9, unit=unit, why=ROUNDING
        )
    result = contact_frictions(other.here(arrays))
    attempt.compare(
        "friction of a range with equal ends",
        [*result.values()],
        np.full(len(result), 0.6),
        tolerance=1e-9,
        unit="1",
        why=ROUNDING,
    )
    check_constants(other, arrays)
    actions = [np.full(other.default.nu, float(k)) for k in range(1, 7)]
    due = [attempt.learner.method(other.randomizer, "delay", action) for action in actions]
    attempt.compare(
        f"a delay of {lag} calls",
        due,
        np.array([np.zeros(other.default.nu)] * lag + actions[: len(actions) - lag]),
        tolerance=0.0,
        unit="1",
        why="an action is handed on as it is",
        call="delay(action)",
    )
    truth_seen = attempt.rng.normal(size=3)
    observed = attempt.learner.method(
        other.randomizer, "observe", truth_seen, other.generator(seed)
    )
    attempt.compare(
        "an observation without noise",
        observed,
        truth_seen,
        tolerance=0.0,
        unit="1",
        why="noise is 0",
    )


def refusals(bench: Bench) -> None:
    """Check that each impossible range raises ValueError when the randomiser is constructed."""
    good = bench.setting.ranges
    for place, value, what in (
        (0, (1.0, 0.5), "friction with its ends the wrong way round"),
        (0, (0.0, 0.5), "friction that may be zero"),
        (1, (0.0, 2.0), "a mass factor that may be zero"),
        (1, (0.5, float("nan")), "a mass factor that is not a number"),
        (2, (-0.1, 0.5), "negative damping"),
        (3, (-1, 2), "a negative delay"),
        (3, (0, 1.5), "a delay that is not whole"),
        (4, -0.1, "negative noise"),
    ):
        ranges = [*good[:place], value, *good[place + 1 :]]

        def request(ranges: list[Any] = ranges) -> Any:
            return bench.learner.new(ENTRY, bench.model, *ranges)

        bench.attempt.require_error(
            what,
            request,
            sentence=f"The constructor must refuse {what}.",
            call=f"DomainRandomizer(model, {', '.join(map(describe, ranges))})",
        )
