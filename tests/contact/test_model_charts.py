"""What the charts of the contact models say, on smaller settings: limits, slopes, sentences."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import charts
from course.charts.contact import limits, models
from course.contact import scenes
from course.oracles.mujoco.contact import SOLVERS
from tests.budget import examples


@pytest.fixture(scope="module")
def table() -> charts.Panel:
    return charts.build("contact_table", repeats=1)[0]


@pytest.mark.prove
@pytest.mark.parametrize("sentence", models.SENTENCES)
def test_every_sentence_of_the_table_holds(table: charts.Panel, sentence: str) -> None:
    assert models.SENTENCES[sentence]([tuple(row) for row in table.data])
    assert sentence in charts.read("contact_table")


@pytest.mark.prove
def test_a_sentence_fails_on_another_table(table: charts.Panel) -> None:
    """None of them is true of anything: errors handed round among the models break each."""
    rows = [list(row) for row in table.data]
    errors = [(row[2], row[5]) for row in rows]
    for row, (error, verdict) in zip(rows, errors[5:] + errors[:5], strict=True):
        row[2], row[5] = error, verdict
    broken = [not holds([tuple(row) for row in rows]) for holds in models.SENTENCES.values()]
    assert sum(broken) >= len(broken) - 1


@pytest.mark.prove
def test_the_table_has_every_model_and_mujocos_rows(table: charts.Panel) -> None:
    for scene in models.QUESTIONS:
        named = {row[1] for row in table.data if row[0] == scene}
        assert named >= set(models.OURS)
        assert len([name for name in named if name.startswith("MuJoCo N")]) == 4


def test_a_table_stands_by_any_forces_that_carry_it() -> None:
    """Every model's legs carry the load and its moments; which forces they are differs."""
    forces = models.leg_forces()
    rows = scenes.table().jacobian[:, 0]
    for name, force in forces.items():
        rigid = name in ("exact pyramid (LCP)", "convex cone") or "true cone" in name
        carried = rows.T @ force + scenes.table(models.LOAD).force
        assert np.max(np.abs(carried)) < (1e-8 if rigid else 0.5), name
    idle = forces["exact pyramid (LCP)"]
    assert np.min(np.abs(idle)) < 1e-9 and np.max(np.abs(idle)) > 40.0  # a vertex
    # Equal springs share with the least sum of squares: no part of (1, -1, 1, -1). MuJoCo's are
    # nearly equal, as their impedance grows with the depth.
    turn = np.array([1.0, -1.0, 1.0, -1.0])
    for name in ("penalty", "true cone (Newton)", *[f"MuJoCo {s}" for s in SOLVERS]):
        assert abs(forces[name] @ turn) < 0.05, name
    for name in ("exact pyramid (LCP)", "sweeps, true cone (1000)"):
        assert abs(forces[name] @ turn) > 10.0, name
    for solver in SOLVERS:  # convex and soft, so unique
        assert forces[f"MuJoCo {solver}"] == pytest.approx(forces["MuJoCo Newton"], abs=1e-6)


@pytest.mark.prove
@pytest.mark.parametrize("scene", ["heavy", "glass"])
def test_mujoco_is_compared_at_its_best_and_not_by_its_defaults_alone(scene: str) -> None:
    """Under 100 kg and in two fingers MuJoCo misses by default, and is good once hardened."""
    question = models.QUESTIONS[scene]
    names = ("penalty", models.NEWTON, models.HARD)
    result = models.work_precision(scene, (2e-3, 5e-4), 1, names)
    for usual, hard in zip(
        result.curve(models.NEWTON).points, result.curve(models.HARD).points, strict=True
    ):
        assert usual.error > 2.0 * question.tolerance
        assert hard.error < 0.5 * question.tolerance


def test_the_figure_of_the_heavy_scene_is_the_depth_of_the_light_body() -> None:
    """An independent run in MuJoCo: one number, that of the body which the question names."""
    mujoco = pytest.importorskip("mujoco")
    balls = "".join(
        f'<body pos="0 0 {z}"><joint type="slide" axis="0 0 1"/>'
        f'<geom size="0.1" mass="{m}"/></body>'
        for z, m in ((0.1, 1.0), (0.3, 100.0))
    )
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="0.002"/><default><geom condim="1"/></default><worldbody>'
        f'<geom type="plane" size="9 9 1"/>{balls}</worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 120)
    result = models.work_precision("heavy", (2e-3,), 1, ("penalty", models.NEWTON))
    (point,) = result.curve(models.NEWTON).points
    assert point.error == pytest.approx(-data.qpos[0], rel=1e-3)


def test_recovery_throws_out_faster_with_a_shorter_step_unless_it_is_capped() -> None:
    (panel,) = charts.build("contact_recovery", steps=(1e-2, 1e-3, 1e-4))
    free, capped = panel["recovery, no cap"], panel["recovery, speed capped"]
    assert free.y == pytest.approx([0.2, 2.0, 20.0], rel=1e-9)
    assert capped.y == pytest.approx([0.2, 1.0, 1.0], rel=1e-9)
    assert max(panel["MuJoCo"].y) < 0.5
    for model in ("lcp", "coulomb", "convex"):
        assert limits.ejected(1e-4, model, cap=0.3) == pytest.approx(0.3, rel=1e-6)
    slow = replace(scenes.ball_drop(-0.01), max_recovery_speed=0.3)
    assert scenes.march(slow, 1e-4, 3)[1] == pytest.approx([0.3], rel=1e-6)
    # A share of the depth that fits the step: the speed that comes out is that of the share.
    half = replace(scenes.ball_drop(-0.01), recovery=0.5, max_recovery_speed=math.inf)
    assert scenes.run(half, "lcp", 1e-2, 1).v[0, -1] == pytest.approx(0.5, rel=1e-9)


@given(zeta=st.floats(0.02, 3.0))
@examples(20)
def test_penalty_limits_are_the_theorys(zeta: float) -> None:
    for scheme in ("explicit", "semi-implicit"):
        if scheme == "explicit" and abs(zeta - 1.0) < 1e-3:
            continue  # a double root, where bisection stops at the square root of rounding
        theory = limits.step_limit(zeta, scheme)
        assert limits.measured_limit(zeta, scheme) == pytest.approx(theory, rel=1e-5)


def test_two_springs_turn_a_cube_before_they_lift_it() -> None:
    ratio = limits.cube_limit() / limits.cube_limit(1)
    assert ratio == pytest.approx(1.0 / math.sqrt(3.0), rel=1e-5)


def test_sweeps_have_their_slopes() -> None:
    ratio, height = charts.build("contact_sweeps", ratios=(30.0, 100.0, 300.0), heights=(5, 10, 20))
    two = ratio["two bodies, heavy"]
    assert two.y == pytest.approx(two.expected, rel=0.02)
    ten = ratio["tower of 10"]
    assert ten.y[-1] == pytest.approx(ten.expected[-1], rel=0.05)
    assert max(ratio["two bodies, light"].y) <= 6
    equal = height["equal tower"]
    assert equal.y == pytest.approx(equal.expected, rel=0.05)


def test_the_clamp_saves_what_theory_says() -> None:
    """MuJoCo without refsafe is at its limit; with it there is none above 1/sqrt(8)."""
    panel = limits._clamped((0.1, 0.3, 0.37, 1.0))
    deviation, on = panel["MuJoCo, refsafe off"], panel["MuJoCo, refsafe"]
    assert deviation.y == pytest.approx(deviation.expected, rel=0.02)
    assert list(on.x) == [0.1, 0.3] and on.y == pytest.approx(deviation.y[:2], rel=0.02)
    assert limits.soft_limit(limits.SAVED) == pytest.approx(0.5, rel=1e-12)


@pytest.mark.slow
def test_pyramids_steer_and_cones_do_not() -> None:
    stretched, turned = charts.build("contact_steering", degrees=(0.0, 22.5, 45.0), dt=2e-3)
    for label, law in (("exact", "exact"), ("MuJoCo Newton, pyramidal", "exact"), ("box", "box")):
        assert stretched[label].y == pytest.approx(stretched[law].expected, rel=0.02)
        assert turned[label].y == pytest.approx(turned[law].expected, abs=1.2)
    assert stretched["box"].expected == pytest.approx([1.0, 0.8660, 0.7071], abs=1e-4)
    assert turned["box"].expected[1] == pytest.approx(9.7356 - 22.5, abs=1e-4)
    for label in ("true cone", "MuJoCo Newton, elliptic"):
        assert stretched[label].y == pytest.approx([1.0] * 3, abs=0.02)
        assert turned[label].y == pytest.approx([0.0] * 3, abs=1e-6)


@pytest.mark.prove
def test_gradients_before_touch_behind_it_and_of_the_wrong_sign() -> None:
    push, bounce = charts.build("contact_gradients", points=7, draws=20)
    speeds = np.array(push["rigid"].x)
    before, after = speeds < 0.17, speeds > 0.25
    assert np.max(np.abs(np.array(push["rigid"].y)[before])) < 1e-9
    assert np.array(push["rigid"].y)[after] == pytest.approx(0.25, rel=1e-3)
    assert np.median(np.array(push["penalty"].y)[after]) > 0.4  # wrong by its jumps
    assert np.max(np.array(push["interior point"].y)[before]) > 1e-5  # it feels what is ahead
    assert np.max(np.array(push["randomised"].y)[before]) > 1e-3
    x, y = np.array(bounce["stepped"].x), np.array(bounce["stepped"].y)
    assert np.median(np.diff(y) / np.diff(x)) == pytest.approx(-1.0, rel=1e-6)
    assert np.polyfit(x, y, 1)[0] == pytest.approx(1.0, abs=0.1)


@pytest.mark.prove
def test_work_precision_of_a_scene_picks_what_is_good() -> None:
    names = ("penalty", "exact pyramid (LCP)", "true cone (Newton)", "MuJoCo Newton, elliptic")
    result = models.work_precision("braking", (1e-2, 5e-3, 2.5e-3), 1, names)
    assert result.observed_order("true cone (Newton)") == pytest.approx(1.0, abs=0.05)
    pick = result.pick(by="count")
    assert pick is not None and pick.name != "exact pyramid (LCP)"
    errors = [point.error for point in result.curve("exact pyramid (LCP)").points]
    assert min(errors) > 10 * 2e-3  # no step repairs a pyramid
