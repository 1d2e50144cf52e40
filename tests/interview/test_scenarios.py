"""The debugging scenarios: one symptom, causes that probes tell apart, and nothing given away."""

from __future__ import annotations

import ast
import json
import pickle
import re
import sys
import traceback
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from course.interview import scenarios
from course.interview.scenarios import Scenario, explodes, touch
from drills.interview import debug
from tests.budget import PROVE, sampled
from tests.drills.place import Place, a_place

__all__ = ["a_place"]

SEEDS = range(6)  # tests/prove has twenty
LENGTHS = {"explodes": 7, "policy": 6, "touch": 8, "gap": 7, "late": 9, "sure": 5}
ALL = [scenarios.scenario(name) for name in scenarios.scenario_names()]
EACH = pytest.mark.parametrize("one", ALL, ids=lambda one: one.name)
# A drive that feels a wall is simulated for seconds by each of its probes.
MOST = pytest.mark.parametrize(
    "one",
    [
        pytest.param(one, id=one.name, marks=pytest.mark.prove if one.name == "touch" else ())
        for one in ALL
    ],
)
CASES = [(one.name, cause.name) for one in ALL for cause in one.causes]
EVERY = pytest.mark.parametrize(("name", "cause"), CASES)
# Eight causes each: a step of eleven takes one of most scenarios.
SAMPLED = pytest.mark.parametrize(
    ("name", "cause"),
    [
        pytest.param(
            *case, marks=pytest.mark.prove if case[0] in ("touch", "late", "policy") else ()
        )
        for case in sampled(CASES, 11)
    ],
)


def seed_of(name: str, cause: str, missing: str = "") -> int:
    """The first seed that draws a cause and offers it, or does not offer the one named."""

    def fits(seed: int) -> bool:
        drawn, left_out = scenarios._drawn_causes(scenarios.drawn(name, seed))
        return drawn == cause and (left_out == missing if missing else left_out != cause)

    return next(filter(fits, range(2000)))


# --- The scenarios --------------------------------------------------------------------------------


@EACH
def test_a_scenario_is_whole(one: Scenario) -> None:
    assert len(one.causes) >= 8 and 8 <= len(one.probes) <= 14
    assert one.path == LENGTHS[one.name]
    for group in (one.causes, one.probes, one.repairs):
        assert len({entry.name for entry in group}) == len(group)
    for cause in one.causes:
        assert one.repair(cause.repair).name == cause.repair
    assert one.popular not in {cause.repair for cause in one.causes}
    assert 0.0 < one.spread <= 0.25 and all(p.minutes > 0 and p.noise > 0 for p in one.probes)


@EACH
def test_the_listing_is_short_and_gives_nothing_away(one: Scenario) -> None:
    text = one.listing()
    assert len(text.splitlines()) < 120
    assert re.search(r"\b(faults?|wrong|bugs?|causes?|hidden|mistakes?)\b", text, re.I) is None
    pages: dict[str, set[str]] = {}
    for seed in range(200):
        case = scenarios.drawn(one.name, seed)
        pages.setdefault(scenarios._drawn_causes(case)[1], set()).add(
            scenarios.diagnose(one.name, seed).show()
        )
    # One page for each cause that is not offered, whichever is at work.
    assert {len(some) for some in pages.values()} == {1} and len(pages) == len(one.causes)
    for missing, (page,) in ((name, tuple(some)) for name, some in pages.items()):
        assert text in page and f"`{missing}`" not in page and f"`{scenarios.NONE}`" in page


@pytest.mark.prove
@EACH
def test_all_causes_show_the_same_symptom(one: Scenario) -> None:
    figures = [
        scenarios.symptom(one.name, None, cause.name, seed)
        for cause in one.causes
        for seed in SEEDS
    ]
    assert np.ptp(figures) <= one.spread * abs(np.mean(figures))
    assert not any(map(one.removed, figures))


@pytest.mark.prove
@EACH
def test_every_pair_of_causes_is_told_apart(one: Scenario) -> None:
    for pair in combinations([cause.name for cause in one.causes], 2):
        assert any(scenarios.tells_apart(one.name, p.name, *pair) for p in one.probes), pair


@pytest.mark.prove
@SAMPLED
def test_the_model_answer_leaves_the_cause_alone(name: str, cause: str) -> None:
    path_leaves_the_cause(name, cause, SEEDS)


def path_leaves_the_cause(name: str, cause: str, seeds: Iterable[int]) -> None:
    """For machines that the ranges were not made from."""
    path = scenarios.model_path(name)
    assert len(path) == len(set(path)) == LENGTHS[name]
    for seed in seeds:
        out = [scenarios.ruled_out(name, p, scenarios.figure(name, p, cause, seed)) for p in path]
        assert {c for c in set().union(*out)} == {
            other.name for other in scenarios.scenario(name).causes
        } - {cause}, seed


@pytest.mark.prove
@SAMPLED
def test_the_right_repair_removes_the_symptom(name: str, cause: str) -> None:
    """And no other does at a price that can be paid; the popular one is no better."""
    one = scenarios.scenario(name)
    right = one.cause(cause).repair
    for repair in one.repairs:
        cured = [
            one.removed(scenarios.symptom(name, repair.name, cause, seed))
            and scenarios.price(name, repair.name, cause, seed) <= one.affordable
            for seed in SEEDS[:3]
        ]
        assert cured == [repair.name == right] * 3, repair.name


@pytest.mark.prove
@MOST
def test_what_is_run_does_not_depend_on_the_cause(one: Scenario) -> None:
    """Counted in calls of functions: a probe must not be quicker for one cause than another."""

    def calls(probe: scenarios.Probe, cause: str) -> int:
        count = 0

        def counted(frame: object, event: str, argument: object) -> None:
            nonlocal count
            count += event in ("call", "c_call")

        before = sys.getprofile()
        sys.setprofile(counted)
        try:
            probe.run(cause, 0)
        finally:
            sys.setprofile(before)
        return count

    for probe in one.probes:
        for cause in one.causes:
            scenarios.figure(one.name, probe.name, cause.name, 0)  # what runs keep is there
        counts = [calls(probe, cause.name) for cause in one.causes]
        assert max(counts) <= 1.1 * min(counts) + 50, (probe.name, counts)


# --- A case -------------------------------------------------------------------------------------


def answer_to(name: str, seed: int) -> str:
    """What has to be named."""
    drawn, missing = scenarios._drawn_causes(scenarios.drawn(name, seed))
    return scenarios.NONE if drawn == missing else drawn


def test_the_lag_that_the_task_allows_is_the_one_that_counts_as_gone() -> None:
    one = scenarios.scenario("late")
    (allowed,) = (float(text) for text in re.findall(r"less than (\d+) mm", one.prompt))
    assert one.removed(allowed - 1e-6) and not one.removed(allowed)
    before = [scenarios.symptom("late", None, cause.name, 0) for cause in one.causes]
    assert 1.7 * allowed < min(before) and max(before) < 2.1 * allowed  # "nearly twice as much"


@pytest.mark.prove
def test_a_slide_that_survives_is_not_called_lost() -> None:
    """The figure is then the end of the run."""
    case = scenarios.diagnose("explodes", seed_of("explodes", "double_brake"))
    cured = [one for one in case.conclude("double_brake", "damp_once").sentences() if "gone" in one]
    assert "or the run ends" in cured[0] and "lost after" not in str(cured)


@EACH
def test_the_draw_is_even(one: Scenario) -> None:
    """By four standard deviations of a share: `NONE` is as likely as a cause, nearly."""
    n, chance = 4000, 1.0 / len(one.causes)
    drawn = Counter(answer_to(one.name, seed) for seed in range(n))
    assert set(drawn) == {*(cause.name for cause in one.causes), scenarios.NONE}
    allowed = 4.0 * np.sqrt(chance * (1.0 - chance) / n)
    assert max(drawn.values()) / n < chance + allowed
    assert abs(drawn[scenarios.NONE] / n - chance) < allowed


@pytest.mark.prove
@MOST
def test_bots_score_as_they_should(one: Scenario) -> None:
    """One cause always and random answers: chance, no evidence. All probes: right, and dear."""
    seeds, rng = range(12 if PROVE else 4), np.random.default_rng(0)
    right = {name: 0 for name in (*(cause.name for cause in one.causes), scenarios.NONE)}
    for seed in seeds:
        answer = answer_to(one.name, seed)
        true = one.cause(scenarios._cause(scenarios.drawn(one.name, seed)))
        names = [c.name for c in scenarios.offered(scenarios.drawn(one.name, seed))]
        always = scenarios.diagnose(one.name, seed).conclude(names[0], one.popular)
        assert not always.supported and always.right == (answer == names[0])
        guess = str(rng.choice([*names, scenarios.NONE]))
        verdict = scenarios.diagnose(one.name, seed).conclude(guess, one.popular)
        right[answer] += 1
        assert verdict.points == verdict.right + verdict.cured and not verdict.supported
        thorough = scenarios.diagnose(one.name, seed)
        for probe in one.probes:
            thorough.probe(probe.name)
        verdict = thorough.conclude(answer, true.repair)
        assert verdict.points == 3 and verdict.minutes > verdict.model_minutes
    assert max(right.values()) < len(seeds)


@pytest.mark.prove
@SAMPLED
def test_the_model_answer_stops_when_one_cause_is_left(name: str, cause: str) -> None:
    """Whether it is offered or not; what is not offered leaves none of the others."""
    one = scenarios.scenario(name)
    for missing in ("", cause):
        seed = seed_of(name, cause, missing)
        case = scenarios.drawn(name, seed)
        verdict = scenarios.diagnose(name, seed).conclude(scenarios.NONE, one.popular)
        assert verdict.right == bool(missing)
        assert verdict.model[-1].remaining == (() if missing else (cause,))
        findings = [
            scenarios.Finding(row.probe, row.figure, row.unit, 0, 0) for row in verdict.model
        ]
        causes = [len(row.remaining) for row in scenarios.evidence(name, findings)]
        assert causes[-1] == 1 and min(causes[:-1], default=2) > 1
        for row in verdict.model:
            assert [r.cause for r in row.ranges] == [c.name for c in scenarios.offered(case)]
            for each in row.ranges:
                assert (each.low, each.high) == scenarios.expected(name, row.probe, each.cause)
                assert (each.cause in row.ruled_out) == (not each.explains(row.figure))


def test_a_probe_runs_for_every_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that the time that it takes does not name one."""
    run: list[str] = []
    true = scenarios.figure

    def counted(name: str, probe: str, cause: str, seed: int) -> float:
        run.append(cause)
        return true(name, probe, cause, seed)

    monkeypatch.setattr(scenarios, "figure", counted)
    scenarios.diagnose("late", 1).probe("command_echo")
    assert run[:-1] == [cause.name for cause in scenarios.scenario("late").causes]


def test_the_policys_probes_stand_beside_those_of_the_model() -> None:
    from course.interview.scenarios import policy

    finding = scenarios.diagnose("policy", 1).probe("two_torques")
    assert finding.model == pytest.approx(policy.MODEL.inertia, rel=0.03)
    assert f"on the model: {finding.model:.4g} kg m^2" in str(finding)
    assert scenarios.diagnose("touch", 1).probe("log_ticks").model is None


@pytest.mark.slow
@SAMPLED
def test_a_session_ends_with_the_evidence(name: str, cause: str) -> None:
    session = scenarios.diagnose(name, seed_of(name, cause))
    for probe in scenarios.model_path(name):
        session.probe(probe)
    verdict = session.conclude(cause, scenarios.scenario(name).cause(cause).repair)
    assert verdict.points == 3 and verdict.rows[: len(verdict.model)] == verdict.model
    assert session.minutes == verdict.minutes >= verdict.model_minutes > 0
    shown = verdict._repr_markdown_()
    assert cause in shown and all(probe in shown for probe in scenarios.model_path(name))
    assert all(f"{scenarios.span(r)}" in shown for row in verdict.rows for r in row.ranges)
    other = next(c for c in scenarios.offered(session.case) if c.name != cause)
    wrong = session.conclude(other.name, scenarios.scenario(name).popular)
    assert wrong.points == 0 and "had ruled it out: " in str(wrong)


@pytest.mark.prove
@EVERY
def test_the_cause_is_nowhere_by_accident(
    name: str, cause: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only names and seeds are held; an error in the program is told without its lines."""
    session = scenarios.diagnose(name, seed_of(name, cause))
    finding = session.probe(scenarios.scenario(name).probes[0].name)
    held = [repr(session), json.dumps(asdict(session)), str(vars(session.case)), str(finding)]
    assert not any(cause in text for text in held)
    assert cause.encode() not in pickle.dumps(session)

    for kind in (ZeroDivisionError, KeyboardInterrupt):

        def fails(*given: Any, kind: type[BaseException] = kind) -> float:
            raise kind(f"in {given}")

        monkeypatch.setattr(scenarios, "figure", fails)
        told_as = KeyboardInterrupt if kind is KeyboardInterrupt else RuntimeError
        with pytest.raises(told_as) as caught:
            session.probe(finding.probe)
        message = traceback.TracebackException.from_exception(caught.value, capture_locals=True)
        inside = [frame for frame in message.stack if frame.filename == scenarios.__file__]
        assert message.__cause__ is None and message.__context__ is None
        assert inside and cause not in str(message) + "".join(str(f.locals) for f in inside)


def test_one_minute_and_one_cause_are_singular() -> None:
    case = scenarios.diagnose("sure", 9)
    case.probe("read_residual")
    text = " ".join(case.conclude("other_origin", "fix_origin").sentences())
    assert "After 1 minute of probes, this cause remains possible: wrong_focal." in text
    assert scenarios.in_minutes(2) == "2 minutes"


def test_rounding_is_shown_as_zero() -> None:
    finding = scenarios.Finding("log_energy", -1.665e-17, "1", 5, 5, model=1e-18)
    assert str(finding) == "log_energy: 0 1, on the model: 0 1 (5 min spent)"
    assert scenarios.span(scenarios.Range("x", -2e-16, 0.25)) == "0 to 0.25"


def test_bad_input_is_named() -> None:
    for act, name in (
        (lambda: scenarios.diagnose("nothing"), r"name must be .*, got 'nothing'"),
        (lambda: scenarios.diagnose("explodes", -1), r"seed must be .*, got -1"),
        (lambda: scenarios.diagnose("explodes").probe("look"), r"probe must be .*, got 'look'"),
        (
            lambda: scenarios.diagnose("explodes").conclude("x", "soften"),
            r"cause must be .*, got 'x'",
        ),
        (
            lambda: scenarios.diagnose("explodes").conclude("late_brake", "x"),
            r"repair must be .*, got 'x'",
        ),
    ):
        with pytest.raises(ValueError, match=name):
            act()


# --- The theory of the slide --------------------------------------------------------------------


def step_matrix(tune: explodes.Tune, detect: bool) -> NDArray[np.float64]:
    """One step of the state x / dt, v, speeds before, detected x / dt, sum of the drive."""
    age, size = tune.age, 4 + tune.age
    late, held, total = 1 + age, 2 + age, 3 + age
    a2, rub = tune.a**2, -tune.rub if tune.turned else tune.rub
    A = np.zeros((size, size))
    # The sum comes first, then the speed, then the position, each from those before.
    A[total, [0, total]] = tune.encoder, 1.0
    A[held, 0 if detect else held] = 1.0
    A[1] = -tune.points * a2 * A[held] - tune.integral * A[total]
    A[1, 0] -= tune.gain * a2 * tune.encoder
    A[1, 1] += 1.0 - rub
    A[1, late] -= 2.0 * tune.brakes * tune.zeta * tune.a
    A[0] = tune.blend * A[1]
    A[0, [0, 1]] += 1.0, 1.0 - tune.blend
    for k in range(2, 2 + age):
        A[k, k - 1] = 1.0
    return A


def growth(tune: explodes.Tune) -> tuple[float, float]:
    """Growth of a step by the eigenvalues, and how far the start is in what grows."""
    period = step_matrix(tune, detect=True)
    for _ in range(tune.every - 1):
        period = step_matrix(tune, detect=False) @ period
    values, right = np.linalg.eig(period)
    inverse = np.linalg.inv(right)  # rows: the part of a state in each mode
    k = int(np.argmax(np.abs(values)))
    start = np.zeros(len(period))
    start[[0, 2 + tune.age]] = 1.0
    # A mode that swings comes with its conjugate, which has as much of x again.
    both = 1.0 if abs(values[k].imag) < 1e-9 else 2.0
    size = both * float(abs(right[0, k] * (inverse[k] @ start)))
    return float(np.log(abs(values[k]))) / tune.every, size


def test_the_growth_of_the_slide_is_that_of_its_step_matrix() -> None:
    """Independent of the program: eigenvalues of one step of the linear recursion."""
    for cause, tune in explodes.TUNES.items():
        rate, size = growth(tune)
        assert rate > 0.0
        starts = [explodes.machine(cause, seed).start for seed in SEEDS]
        expected = np.mean([np.log(explodes.LIMIT / (size * start)) / rate for start in starts])
        steps = np.mean([scenarios.symptom("explodes", None, cause, seed) for seed in SEEDS])
        # Half a swing may pass until a swing that is large enough has its peak.
        assert steps == pytest.approx(expected, rel=0.04), cause


def test_without_the_fault_the_slide_comes_to_rest() -> None:
    """The growth is negative once the repair is in the recursion."""
    repaired = {
        "double_contact": replace(explodes.TUNES["double_contact"], points=1),
        "explicit_step": replace(explodes.TUNES["explicit_step"], blend=1.0),
        "late_brake": replace(explodes.TUNES["late_brake"], age=0),
        "wrong_friction": replace(explodes.TUNES["wrong_friction"], turned=False),
        "double_brake": replace(explodes.TUNES["double_brake"], brakes=1),
        "held_contact": replace(explodes.TUNES["held_contact"], every=1),
        "turned_encoder": replace(explodes.TUNES["turned_encoder"], encoder=1.0),
        "eager_integral": replace(explodes.TUNES["eager_integral"], integral=0.0),
    }
    for cause, tune in repaired.items():
        step = step_matrix(tune, detect=True)
        if tune.integral == 0.0:
            step = step[:-1, :-1]  # the sum is not used, and adds up for ever
        assert np.abs(np.linalg.eigvals(step)).max() < 1.0, cause


def test_the_energy_of_a_step_is_that_of_its_scheme() -> None:
    """Explicit Euler turns and stretches by 1 + a^2; semi-implicit keeps a skewed energy."""
    for cause, tune in explodes.TUNES.items():
        gained = scenarios.figure("explodes", "log_energy", cause, 0)
        bare = replace(tune, zeta=0.0, rub=0.0, gain=0.0, integral=0.0)
        theory = 20.0 * growth(bare)[0] if bare.blend == 0.0 or bare.every > 1 else 0.0
        assert gained == pytest.approx(theory, abs=1e-3 if bare.every > 1 else 1e-9), cause
    euler = explodes.TUNES["explicit_step"].a
    assert scenarios.figure("explodes", "log_energy", "explicit_step", 0) == pytest.approx(
        10.0 * np.log(1.0 + euler**2)
    )


def test_a_reading_that_is_shifted_is_behind_by_its_shift() -> None:
    from course.interview.scenarios.programs.touch import ROW

    log = np.zeros(2000, dtype=ROW)
    log["force"] = np.random.default_rng(1).normal(5.0, 1.0, 2000)
    for steps in (0, 40, 159):
        log["reading"] = np.roll(log["force"], steps)
        assert touch.lag(log, "reading", "force") == steps / 8


def test_drive_and_filter_are_first_order_lags() -> None:
    """Of the command and of the speed, by SciPy's filter; a lag of one step passes all through."""
    for cause, tune in touch.TUNES.items():
        log = touch.logged(touch.machine(cause, 1))
        for behind, signal, constant in (
            ("drive", "command", tune.rise),
            ("speed", "v", tune.smooth),
        ):
            share = 0.125 / constant
            expected = lfilter([share], [1.0, share - 1.0], log[signal])
            assert log[behind] == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())
            assert (touch.lag(log, behind, signal) > 1.0) == (constant > 1.0), cause


@pytest.mark.slow
def test_the_loop_has_the_rate_and_the_unit_that_it_was_given() -> None:
    for cause, tune in touch.TUNES.items():
        for seed in SEEDS:
            rate = scenarios.figure("touch", "log_rate", cause, seed)
            assert rate == pytest.approx(1.0 / tune.slowed, abs=0.02), cause
            scale = scenarios.figure("touch", "log_scale", cause, seed)
            assert scale == pytest.approx(tune.scale, rel=0.05), cause


@pytest.mark.prove
def test_what_is_tried_first_helps_at_times() -> None:
    """Half the step removes only what the step's limit breaks; a softer loop only what is late a
    little. The verdict shows whether the symptom is gone, and the price.
    """
    missing = {
        name: {c.name for c in scenarios.scenario(name).causes if helped(name, c.name)}
        for name in ("explodes", "touch")
    }
    assert missing == {
        "explodes": {"double_contact", "double_brake"},
        "touch": {"uneven_ticks", "soft_sensor", "slow_drive", "low_rate"},
    }


def helped(name: str, cause: str) -> bool:
    one = scenarios.scenario(name)
    verdict = scenarios.diagnose(name, seed_of(name, cause)).conclude(cause, one.popular)
    assert verdict.tried.price > one.affordable and "too high" in str(verdict)
    return verdict.tried.removed


# --- The command --------------------------------------------------------------------------------


@EACH
def test_a_listing_fits_a_terminal_and_is_the_same_program(one: Scenario) -> None:
    def without_docstrings(text: str) -> str:
        tree = ast.parse(text)
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                node.body = node.body[ast.get_docstring(node) is not None :]
        return ast.dump(tree)

    text = one.listing()
    assert max(map(len, text.splitlines())) > 80
    for width in (60, 80):
        result = debug.fitted(text, width)
        assert max(map(len, result.splitlines())) <= width
        assert without_docstrings(result) == without_docstrings(text)
        assert sorted(re.findall(r"\w+", result)) == sorted(re.findall(r"\w+", text))


@pytest.mark.slow
def test_a_case_is_solved_in_a_pipe(place: Place) -> None:
    one, seed = scenarios.scenario("touch"), seed_of("touch", "windup")
    lines = [f"probe {name}" for name in scenarios.model_path("touch")]
    lines += ["probes", "program", "causes", "hm", "probe x", "conclude windup bound_integral"]
    done = place.run(
        "debug", "touch", "--seed", str(seed), text="\n".join(lines), LC_ALL="C", NO_COLOR="1"
    )
    assert done.code == 0, done
    assert max(map(len, done.out.splitlines())) <= 80 < len(done.out) and done.out.isascii()
    assert "ruled out" in done.out and "fits" in done.out
    assert debug.fitted(one.listing(), 80) in done.out and "Computing what each" in done.out
    assert "\x1b" not in done.out and "3 of 3 points" in done.out
    data = place.json("debug", "touch", "--seed", str(seed), text="\n".join(lines))
    assert data["verdict"]["cause"] == "windup" and data["verdict"]["points"] == 3
    assert len(data["findings"]) == one.path and len(data["refused"]) == 2


@pytest.mark.slow
def test_a_case_is_left_open_or_failed(place: Place) -> None:
    remaining = place.json("debug", "touch", "--seed", "5", text="probe integral_off\nquit\n")
    assert remaining["verdict"] is None and remaining["exit"] == 0
    text = json.dumps({**remaining, "findings": []})
    assert not any(cause.name in text for cause in scenarios.scenario("touch").causes)
    wrong = next(
        c.name
        for c in scenarios.offered(scenarios.drawn("touch", 5))
        if c.name != scenarios._cause(scenarios.drawn("touch", 5))
    )
    assert place.json("debug", "touch", "--seed", "5", text=f"conclude {wrong} soften")["exit"] == 1
    assert place.run("debug", "tuch").code == 2
    listed = place.json("debug")["scenarios"]
    assert [entry["scenario"] for entry in listed] == list(scenarios.scenario_names())


def test_probes_are_there_again_and_a_case_that_is_over_is_not(place: Place) -> None:
    """What was bought stays bought: its figures and its minutes, until a conclusion."""
    first = place.json("debug", "touch", "--seed", "5", text="probe integral_off\nquit\n")
    done = place.run("debug", "touch", text="quit\n")
    assert (
        "You are continuing this case. Results so far:" in done.out
        and "Your 1 probe is stored." in done.out
    )
    assert "(open)" in place.run("debug").out
    second = place.json("debug", "touch", text="probe quarter_gain\nquit\n")
    assert second["seed"] == 5 and second["findings"][:1] == first["findings"]
    assert second["minutes"] > first["minutes"]
    other = place.json("debug", "touch", "--seed", "5", "--new", text="quit\n")
    assert other["findings"] == [] and other["minutes"] == 0
    cause = scenarios.offered(scenarios.drawn("touch", 5))[0].name
    place.json("debug", "touch", text=f"conclude {cause} soften\n")
    assert "(open)" not in place.run("debug").out
    unkept = place.run(
        "debug", "touch", "--seed", "5", text="probe integral_off\nquit\n", DRILLS_PROGRESS="none"
    )
    assert "Your 1 probe is not stored." in unkept.out


@pytest.mark.parametrize("text", ['{"schema": "drills-debug/1", "probes": {"x/1": ["a"]}}', "[]"])
def test_a_damaged_file_of_open_cases_is_put_aside(text: str, place: Place) -> None:
    place.work.mkdir()
    (place.work / "debug.json").write_text(text)
    data = place.json("debug", "touch", "--seed", "5", text="quit\n")
    assert data["findings"] == [] and "damaged" in data["notices"][0]
