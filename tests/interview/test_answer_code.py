"""The code in the answers: found in the texts, at most 25 lines, run against other computations.

Every block marked `python` in an answer is executed as it stands, and has a check here that does
not use the answer's own method.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator
from typing import Any

import mpmath
import mujoco
import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.signal import lfilter

from course import interview

MOST_LINES = 25
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.S | re.M)
TOPICS = sorted(path.name for path in interview.FOLDER.iterdir())
QUESTIONS = {f"{t}/{q.name}": q for t in TOPICS for q in interview.questions(t)}
CODE = {
    name: blocks
    for name, question in QUESTIONS.items()
    if (blocks := BLOCK.findall(f"{question.minute}\n{question.full}"))
}
Names = dict[str, Any]
TRUTHS: dict[str, Callable[[Names], None]] = {}


def truth(name: str) -> Callable[[Callable[[Names], None]], Callable[[Names], None]]:
    """Register the check of the code in an answer."""

    def register(check: Callable[[Names], None]) -> Callable[[Names], None]:
        TRUTHS[name] = check
        return check

    return register


def executed(name: str, **given: Any) -> Names:
    """Execute the code of an answer and return its names."""
    names: Names = {"__name__": name, **given}
    for block in CODE[name]:
        exec(compile(block, name, "exec"), names)
    return names


def test_a_question_on_coding_asks_for_code() -> None:
    """An interview draws these as tasks at the whiteboard, so something has to be written."""
    coding = [question for question in QUESTIONS.values() if question.kind == "coding"]
    assert len(coding) > 12
    assert [q.title for q in coding if not re.search(r"\bWrite\b", q.title)] == []


def test_a_request_for_code_is_answered_with_code() -> None:
    any_code = re.compile(r"^```(python|cpp)\n", re.M)
    missing = [
        name
        for name, question in QUESTIONS.items()
        if question.kind == "coding" and not any_code.search(f"{question.minute}\n{question.full}")
    ]
    assert missing == []


def test_no_code_is_in_a_language_that_nothing_runs() -> None:
    """Each fence that opens a block is of one of the two languages that are run."""
    for name, question in QUESTIONS.items():
        fences = re.findall(r"^ *(`{3,}|~{3,})(.*)$", f"{question.minute}\n{question.full}", re.M)
        assert all(fence == "```" for fence, _ in fences), name
        assert {words for _, words in fences[::2]} <= {"python", "cpp"}, name
        assert {words for _, words in fences[1::2]} <= {""} and len(fences) % 2 == 0, name


def test_every_code_has_its_truth() -> None:
    assert CODE.keys() == TRUTHS.keys()


@pytest.mark.parametrize("name", CODE)
def test_the_code_is_short_and_no_line_is_cut_on_a_page(name: str) -> None:
    for block in CODE[name]:
        lines = [line for line in block.splitlines() if line.strip()]
        assert len(lines) <= MOST_LINES
        assert max(map(len, lines)) <= 100


@pytest.mark.prove
@pytest.mark.parametrize("name", CODE)
def test_the_code_does_what_the_answer_says(name: str) -> None:
    if name in NEED_NAMES:
        TRUTHS[name]({})
    else:
        TRUTHS[name](executed(name))


# --- Forward kinematics: a product of transforms, and differences ---------------------------------


@truth("interview/three_link_chain")
def _chain(names: Names) -> None:
    rng = np.random.default_rng(1)
    lengths, angles = rng.uniform(0.2, 1.0, 3), rng.uniform(-3.0, 3.0, (5, 3))
    points = names["joint_positions"](lengths, angles)
    jacobian = names["tip_jacobian"](lengths, angles)
    assert points.shape == (5, 4, 2) and jacobian.shape == (5, 2, 3)
    for posture, joints, slopes in zip(angles, points, jacobian, strict=True):
        frame, expected = np.eye(3), [np.zeros(2)]
        for length, q in zip(lengths, posture, strict=True):
            c, s = math.cos(q), math.sin(q)
            frame = (
                frame @ [[c, -s, 0], [s, c, 0], [0, 0, 1]] @ [[1, 0, length], [0, 1, 0], [0, 0, 1]]
            )
            expected.append(frame[:2, 2])
        np.testing.assert_allclose(joints, expected, atol=1e-14)
        for k in range(3):
            step = 1e-6 * np.eye(3)[k]
            ends = [names["joint_positions"](lengths, posture + s * step)[-1] for s in (1, -1)]
            np.testing.assert_allclose(slopes[:, k], (ends[0] - ends[1]) / 2e-6, atol=1e-8)
    np.testing.assert_allclose(
        names["joint_positions"](lengths, np.zeros(3))[-1], [lengths.sum(), 0]
    )


# --- PID: a linear filter, and a blocked joint ----------------------------------------------------


def _released(controller: Any) -> float:
    """Return by how much a joint overshoots that is held for 3 s and then released."""
    place, rate, highest = 0.0, 0.0, 0.0
    for i in range(20_000):
        torque = controller.update(1.0, place)
        if i >= 3000:
            rate += 1e-3 * (torque - 1.0 * rate)
            place += 1e-3 * rate
        highest = max(highest, place)
    return highest - 1.0


@truth("interview/pid_that_lets_go")
def _pid(names: Names) -> None:
    rng = np.random.default_rng(2)
    period, measured = 2e-3, np.cumsum(rng.normal(0.0, 0.1, 400))
    for cutoff in (None, 15.0):
        loop = names["PID"](3.0, 5.0, 0.2, 1e9, period, cutoff)
        outputs = [loop.update(0.5, y) for y in measured]
        # One pole at 1 / (1 + T / tau): the backward difference of a first-order filter.
        pole = 0.0 if cutoff is None else 1.0 / (1.0 + period * 2.0 * math.pi * cutoff)
        raw = np.diff(measured, prepend=measured[0]) / period
        rate = lfilter([1.0 - pole], [1.0, -pole], raw)
        error = 0.5 - measured
        linear = 3.0 * error + 5.0 * period * np.cumsum(error) - 0.2 * rate
        np.testing.assert_allclose(outputs, linear, rtol=1e-9, atol=1e-9)
    # The first call and a step of the target cause no kick of the derivative.
    loop = names["PID"](1.0, 0.0, 100.0, 1e9, 1e-3)
    assert loop.update(0.0, 5.0) == -5.0 and loop.update(2.0, 5.0) == -3.0
    # With the path's rate, a joint that follows it exactly gets no torque from the derivative.
    loop = names["PID"](1.0, 0.0, 100.0, 1e9, 1e-3)
    loop.update(0.0, 0.0, 1.0)
    assert loop.update(1e-3, 1e-3, 1.0) == pytest.approx(0.0, abs=1e-9)
    # The limit, on both sides, and what it is for.
    for sign in (1.0, -1.0):
        loop = names["PID"](50.0, 1.0, 0.0, 2.0, 1e-3)
        assert loop.update(sign, 0.0) == sign * 2.0
    assert _released(names["PID"](4.0, 1.0, 1.0, 2.0, 1e-3)) < 0.4

    # Without the limit inside, the integral never stops; the command is limited afterwards.
    class Limited:
        def __init__(self) -> None:
            self.inner = names["PID"](4.0, 1.0, 1.0, 1e9, 1e-3)

        def update(self, target: float, measured: float) -> float:
            return min(max(float(self.inner.update(target, measured)), -2.0), 2.0)

    assert _released(Limited()) > 0.5


# --- RRT: dense samples of each edge, closed rooms, counted calls ---------------------------------


@truth("interview/tree_in_the_plane")
def _tree(names: Names) -> None:
    calls: list[int] = []
    exact = names["is_free"]

    def counted(*args: Any) -> bool:
        calls.append(1)
        return bool(exact(*args))

    names["is_free"] = counted
    fractions = np.linspace(0.0, 1.0, 3001)[:, None]
    for seed in range(6):
        rng = np.random.default_rng(seed)
        centres, radii = rng.uniform(1.5, 8.5, (25, 2)), rng.uniform(0.2, 0.8, 25)
        ends = np.array([0.5, 0.5]), np.array([9.5, 9.5])
        path, samples, checks = names["rrt"](*ends, centres, radii, 10.0, 1.0, rng)
        assert checks == len(calls) and samples >= 1
        calls.clear()
        assert (
            path is not None
            and np.array_equal(path[0], ends[0])
            and np.array_equal(path[-1], ends[1])
        )
        for a, b in itertools.pairwise(path):
            assert 1e-9 < np.linalg.norm(b - a) <= 1.0 + 1e-12
            points = a + fractions * (b - a)
            gaps = np.linalg.norm(points[:, None] - centres, axis=2) - radii
            assert gaps.min() > -1e-9
    # A thin disc across an edge whose ends and middle are free.
    a, b = np.zeros(2), np.array([10.0, 0.0])
    for x in (0.0, 3.0, 9.0):
        assert not exact(a, b, np.array([[x, 0.0]]), np.array([0.01]))
    assert exact(a, b, np.array([[3.0, 0.02], [-1.0, 0.0]]), np.array([0.01, 0.9]))
    # A goal inside a ring: no path, after the whole budget; a blocked end is an error.
    turn = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    ring = 5.0 + 1.5 * np.c_[np.cos(turn), np.sin(turn)]
    closed = (ring, np.full(40, 0.2), 10.0, 1.0)
    start, goal = np.array([0.5, 0.5]), np.array([5.0, 5.0])
    lost = names["rrt"](start, goal, *closed, np.random.default_rng(0), budget=300)
    assert lost[:2] == (None, 300)
    with pytest.raises(ValueError, match="free"):
        names["rrt"](start, ring[0], *closed, np.random.default_rng(0))
    runs = [
        names["rrt"](start, start + 6, ring[:1], [0.2], 10.0, 1.0, np.random.default_rng(4))
        for _ in "ab"
    ]
    assert np.array_equal(runs[0][0], runs[1][0])
    # The first sample is the goal, within a step of the start: two points, not the goal twice.
    near = (start, start + 0.5, ring[:1], [0.2], 10.0, 1.0, np.random.default_rng(5))
    assert np.array_equal(names["rrt"](*near, bias=1.0)[0], [start, start + 0.5])


# --- Randomiser: what MuJoCo then computes --------------------------------------------------------

ARM = """<mujoco><compiler angle="radian"/><worldbody><geom type="plane" size="2 2 .1"/>
<body pos="0 0 1"><joint name="a" axis="0 1 0"/>
<geom type="capsule" size=".04" fromto="0 0 0 .4 0 0"/>
<body pos=".4 0 0"><joint axis="0 1 0" damping=".3"/>
<geom type="capsule" size=".03" fromto="0 0 0 .3 0 0"/>
</body></body></worldbody><actuator><motor joint="a"/></actuator></mujoco>"""


def _arrays(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    names = (name for name in dir(model) if not name.startswith("_"))
    values = {name: getattr(model, name) for name in names}
    return {name: v.copy() for name, v in values.items() if isinstance(v, np.ndarray)}


def _lag(one: Any) -> int:
    """Return after how many steps an impulse of the command comes out."""
    outputs = [one.command(np.array([float(i == 0)]))[0] for i in range(12)]
    assert sum(outputs) == 1.0
    return outputs.index(1.0)


@truth("interview/randomise_a_model")
def _randomiser(names: Names) -> None:
    model = mujoco.MjModel.from_xml_string(ARM)
    one = names["Randomiser"](model, np.random.default_rng(3))
    before = _arrays(model)
    data = mujoco.MjData(model)
    factors, lags, frictions = [], set(), []
    for _ in range(200):
        one.start(np.zeros(1))
        factor = model.body_mass[1:] / before["body_mass"][1:]
        np.testing.assert_allclose(
            model.body_inertia[1:], before["body_inertia"][1:] * factor[:, None], rtol=1e-12
        )
        assert np.all((factor >= 0.8) & (factor <= 1.2)) and np.all(model.dof_damping >= [0.0, 0.3])
        # Derived by MuJoCo, and not by the answer's own copy: the mass of all that hangs below.
        assert model.body_subtreemass[0] == pytest.approx(model.body_mass.sum(), rel=1e-12)
        ratio = model.geom_friction[:, 0] / before["geom_friction"][:, 0]
        assert np.ptp(ratio) < 1e-12
        assert _lag(one) == one.delay
        lags.add(int(one.delay))
        # Before the first command arrives, the one that was in force at the reset still acts.
        one.start(np.array([0.7]))
        acted = [one.command(np.ones(1))[0] for _ in range(6)]
        assert acted == [0.7] * int(one.delay) + [1.0] * (6 - int(one.delay))
        factors.append(factor)
        frictions.append(ratio[0])
    assert lags == {0, 1, 2, 3}
    assert np.median(factors) == pytest.approx(1.0, abs=0.03)
    assert np.median(frictions) == pytest.approx(1.0, abs=0.08)
    data.qpos[:] = 0.4
    one.restore()
    after = _arrays(model)
    assert all(np.array_equal(after[name], value) for name, value in before.items())
    assert np.all(data.qpos == 0.4), "the running data is not the scratch one"
    one.noise = 0.5
    noise = np.array([one.reading(np.zeros(3)) for _ in range(4000)])
    assert noise.std() == pytest.approx(0.5, rel=0.05)
    twins = [
        names["Randomiser"](mujoco.MjModel.from_xml_string(ARM), np.random.default_rng(7))
        for _ in "ab"
    ]
    for twin in twins:
        twin.start(np.zeros(1))
    assert np.array_equal(twins[0].model.body_mass, twins[1].model.body_mass)
    # Beside the arm a ball on a free joint falls with gravity times time; only hinges are damped.
    ball = '<body pos="1 1 9"><freejoint/><geom size=".1"/></body></worldbody>'
    world = mujoco.MjModel.from_xml_string(ARM.replace("</worldbody>", ball))
    names["Randomiser"](world, np.random.default_rng(7)).start(np.zeros(1))
    assert np.all(world.dof_damping[:2] > [0.0, 0.3])
    falling = mujoco.MjData(world)
    mujoco.mj_step(world, falling, 200)
    assert falling.qvel[4] == pytest.approx(-9.81 * falling.time, rel=1e-9)


# --- The age of a chain: clocks with random phases ------------------------------------------------


def _ages(
    stages: list[tuple[float, float | None, int]], rng: np.random.Generator
) -> Iterator[float]:
    """Yield ages at random moments, from nothing but the starts of each stage."""
    for _ in range(4000):
        moment, phases = 1000.0 + rng.uniform(), [rng.uniform() for _ in stages]
        now = moment
        for (execution, period, _), phase in zip(reversed(stages), reversed(phases), strict=True):
            # The latest start whose result is there by now.
            latest = now - execution
            if period is not None:
                latest = period * (math.floor(latest / period - phase) + phase)
            now = latest
        yield moment - now


@truth("role/age_of_a_chain")
def _age(names: Names) -> None:
    rng = np.random.default_rng(5)
    chains: list[list[tuple[float, float | None, int]]] = [
        [(0.045, 1 / 30, 2), (0.06, 0.1, 1), (0.0002, 0.001, 1)],
        [(0.02, 0.05, 1), (0.015, None, 1), (0.004, 0.01, 1)],
    ]
    for stages in chains:
        least, mean, greatest = names["chain_age"](stages)
        observed = np.array(list(_ages(stages, rng)))
        assert least - 1e-9 <= observed.min() and observed.max() <= greatest + 1e-9
        assert observed.min() < least + 0.2 * (greatest - least)
        assert observed.max() > greatest - 0.2 * (greatest - least)
        assert observed.mean() == pytest.approx(mean, abs=5.0 * observed.std() / math.sqrt(4000))
    with pytest.raises(ValueError, match="overload"):
        names["chain_age"]([(0.045, 1 / 30, 1)])
    # On arrival a stage inherits the camera's interval: too short for one worker, not for two.
    with pytest.raises(ValueError, match="overload"):
        names["chain_age"]([(0.045, 1 / 30, 2), (0.06, None, 1)])
    assert names["chain_age"]([(0.045, 1 / 30, 2), (0.06, None, 2)])[0] == pytest.approx(0.105)


# --- A loop at a fixed rate: a clock that the test turns ------------------------------------------

NEED_NAMES = {"middleware/write_the_loop"}


@truth("middleware/write_the_loop")
def _loop(_: Names) -> None:
    durations = [0.2, 0.3, 2.4, 0.1, 1.0, 0.2, 3.0, 0.1]
    now = [10.0]
    starts: list[float] = []

    class Running:
        def __bool__(self) -> bool:
            return len(starts) < len(durations)

    def work() -> None:
        starts.append(now[0])
        now[0] += durations[len(starts) - 1]

    def sleep_until(moment: float) -> None:
        now[0] = max(now[0], moment)

    names = executed(
        "middleware/write_the_loop",
        clock=lambda: now[0],
        sleep_until=sleep_until,
        work=work,
        running=Running(),
        ceil=math.ceil,
        period=1.0,
        skipped=0,
    )
    # Starts stay on the grid of the first; a turn that is over is left out and counted.
    turns = np.array(starts) - 10.0
    np.testing.assert_allclose(turns, [0, 1, 2, 5, 6, 7, 8, 11], atol=1e-9)
    assert names["skipped"] == 4


# --- Layouts: the recurrence of the angles alone --------------------------------------------------


@truth("rigid_body/layout_of_a_batch")
def _layouts(names: Names) -> None:
    rng = np.random.default_rng(4)
    h, length = 0.01, 0.7
    angle, rate = rng.uniform(-2.0, 2.0, (2, 6))
    bodies = np.zeros(6, dtype=[("angle", float), ("rate", float), ("mass", float)])
    bodies["angle"], bodies["rate"] = angle, rate
    path = [angle.copy()]
    for _ in range(50):
        names["step_fields"](angle, rate, h, length=length)
        names["step_records"](bodies, h, length=length)
        path.append(angle.copy())
    np.testing.assert_allclose(bodies["angle"], angle, atol=1e-13)
    # Without the rates, the steps are a second difference: (a' - 2 a + a'') / h^2 = -g/l sin a.
    second = (path[2:] - 2.0 * np.array(path[1:-1]) + path[:-2]) / h**2
    np.testing.assert_allclose(second, -9.81 / length * np.sin(path[1:-1]), atol=1e-9)


# --- A filter: least squares over everything at once ----------------------------------------------


@truth("perception/write_an_ekf")
def _filter(names: Names) -> None:
    rng = np.random.default_rng(5)
    A, C = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    Q, R, P0 = np.diag([0.01, 0.04]), np.array([[0.09]]), np.diag([2.0, 3.0])
    z, x, P = rng.normal(size=(6, 1)), np.array([0.3, -0.2]), P0
    start, squares = x, []
    for one in z:
        x, P = names["predict"](x, P, lambda s: A @ s, lambda s: A, Q)
        x, P, square = names["update"](x, P, one, lambda s: C @ s, lambda s: C, R)
        squares.append(square)
    # All states from 0 to 6 as one weighted least-squares problem; the last one is compared.
    rows, right = [np.linalg.inv(np.linalg.cholesky(P0)) @ np.eye(2, 14)], []
    right.append(np.linalg.inv(np.linalg.cholesky(P0)) @ start)
    for k in range(6):
        root = np.linalg.inv(np.linalg.cholesky(Q))
        rows.append(root @ (np.eye(2, 14, 2 * k + 2) - A @ np.eye(2, 14, 2 * k)))
        right.append(np.zeros(2))
        rows.append(C @ np.eye(2, 14, 2 * k + 2) / np.sqrt(R))
        right.append(z[k] / np.sqrt(R[0]))
    J, b = np.vstack(rows), np.concatenate(right)
    states, squared, *_ = np.linalg.lstsq(J, b, rcond=None)
    np.testing.assert_allclose(x, states[-2:], atol=1e-10)
    np.testing.assert_allclose(P, np.linalg.inv(J.T @ J)[-2:, -2:], atol=1e-10)
    # The squares add up to what the least squares leave over.
    assert sum(squares) == pytest.approx(squared[0], rel=1e-9)


# --- Boxes: a linear program over the corners, and shorter moves ----------------------------------


def _corners(box: np.ndarray) -> np.ndarray:
    return np.array(list(itertools.product(*box.T)))


@truth("contact/aabb_by_hand")
def _boxes(names: Names) -> None:
    rng = np.random.default_rng(6)
    overlapping = 0
    for _ in range(60):
        a, b = np.sort(rng.uniform(-1.0, 1.0, (2, 2, 3)), axis=1)
        # Two convex shapes meet if a mean of corners of one is a mean of corners of the other.
        first, second = _corners(a), _corners(b)
        weights = np.zeros((2, 16))
        weights[0, :8] = weights[1, 8:] = 1.0
        meets = linprog(
            np.zeros(16),
            A_eq=np.vstack([weights, np.hstack([first.T, -second.T])]),
            b_eq=[1.0, 1.0, 0.0, 0.0, 0.0],
        ).success
        assert names["overlap"](a, b) == meets
        if not meets:
            continue
        overlapping += 1
        move = names["way_out"](a, b)
        assert not names["overlap"](a, b + 1.000001 * move)
        motions = rng.normal(size=(300, 3))
        motions *= 0.999 * np.linalg.norm(move) / np.linalg.norm(motions, axis=1)[:, None]
        assert all(names["overlap"](a, b + motion) for motion in motions)
    assert 10 < overlapping < 50
    # A touch counts, and a box inside another leaves by the near side.
    inside = np.array([[0.1, 0.4], [0.2, 0.6]])
    outer = np.array([[0.0, 0.0], [1.0, 1.0]])
    np.testing.assert_allclose(names["way_out"](outer, inside), [-0.2, 0.0])
    beside = np.array([[1.0, 0.0], [2.0, 1.0]])
    assert names["overlap"](outer, beside) and names["overlap"](beside, outer)


# --- A Jacobian's check: right and wrong ones of MuJoCo -------------------------------------------

WRIST = """<mujoco><compiler angle="radian"/><worldbody><body>
<joint axis="0 0 1"/><geom size=".1"/><body pos=".3 0 .2"><joint axis="0 1 0"/><geom size=".1"/>
<body pos=".4 .1 0"><joint axis="1 0 0"/><geom size=".1"/><site name="tip" pos=".1 .05 .2"/>
</body></body></body></worldbody></mujoco>"""


@truth("kinematics/jacobian_check")
def _jacobian_check(names: Names) -> None:
    model = mujoco.MjModel.from_xml_string(WRIST)
    data = mujoco.MjData(model)

    def pose(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        return data.site("tip").xpos.copy(), data.site("tip").xmat.reshape(3, 3).copy()

    def exact(q: np.ndarray) -> np.ndarray:
        pose(q)
        both = np.zeros((6, 3))
        mujoco.mj_jacSite(model, data, both[:3], both[3:], 0)
        return both

    def in_the_hand(q: np.ndarray) -> np.ndarray:
        both = exact(q)
        return np.vstack([both[:3], pose(q)[1].T @ both[3:]])

    def of_the_body(q: np.ndarray) -> np.ndarray:
        pose(q)
        both = np.zeros((6, 3))
        mujoco.mj_jacBody(model, data, both[:3], both[3:], 3)
        return both

    rng = np.random.default_rng(7)
    for q in rng.uniform(-3.0, 3.0, (20, 3)):
        assert names["worst_difference"](pose, exact, q) < 1e-9
        assert names["worst_difference"](pose, in_the_hand, q) > 1e-2
        assert names["worst_difference"](pose, of_the_body, q) > 1e-2
    # Right at zero, and wrong elsewhere.
    assert names["worst_difference"](pose, in_the_hand, np.zeros(3)) < 1e-9


# --- Two links: complex numbers, and a scan of the elbow ------------------------------------------


@truth("kinematics/two_link_whiteboard")
def _two_links(names: Names) -> None:
    rng = np.random.default_rng(8)
    postures, tip = names["postures"], names["tip"]

    def reached(l1: float, l2: float, q1: float, q2: float) -> complex:
        return complex(np.exp(1j * q1) * (l1 + l2 * np.exp(1j * q2)))

    for _ in range(200):
        l1, l2 = rng.uniform(0.2, 1.0, 2)
        point = complex(*rng.uniform(-2.0, 2.0, 2))
        solutions = postures(l1, l2, point.real, point.imag)
        # The distance of the tip for every elbow angle: how often does it pass the target's?
        scan = abs(l1 + l2 * np.exp(1j * np.linspace(-np.pi, np.pi, 3601))) - abs(point)
        assert len(solutions) == np.count_nonzero(np.diff(np.sign(scan)))
        for q1, q2 in solutions:
            assert abs(reached(l1, l2, q1, q2) - point) < 1e-13
            assert abs(complex(*tip(l1, l2, q1, q2)) - point) < 1e-13
        if solutions:
            assert solutions[0][1] == -solutions[1][1]
    assert len(postures(1.0, 0.5, 1.5, 0.0)) == len(postures(1.0, 0.5, 0.0, -0.5)) == 1
    for r in (1.5 - 1e-9, 0.5 + 1e-9):
        ((q1, q2), other) = postures(1.0, 0.5, r, 0.0)
        assert abs(reached(1.0, 0.5, q1, q2) - r) < 1e-15 and other[1] == -q2
        # All digits of the elbow, of which the arccosine loses half.
        with mpmath.workdps(50):
            elbow = mpmath.acos(mpmath.mpf(r) ** 2 - mpmath.mpf("1.25"))
        assert q2 == pytest.approx(float(elbow), rel=1e-13, abs=0.0)
    with pytest.raises(ValueError, match="every direction"):
        postures(0.4, 0.4, 0.0, 0.0)
    assert postures(0.4, 0.3, 0.0, 0.0) == []
    for r, edge in ((1.5 + 1e-10, 1.5), (0.5 - 1e-10, 0.5)):
        assert postures(1.0, 0.5, r, 0.0) == []
        ((q1, q2),) = postures(1.0, 0.5, r, 0.0, 1e-9)
        assert abs(reached(1.0, 0.5, q1, q2) - edge) < 1e-15


# --- RRT with its parts handed in: dense samples, a wall, a budget --------------------------------


@truth("planning/rrt_on_a_whiteboard")
def _whiteboard_tree(names: Names) -> None:
    fractions = np.linspace(0.0, 1.0, 2001)[:, None]

    def free(a: np.ndarray, b: np.ndarray) -> bool:
        """A wall at x = 0 with a gap, exactly."""
        if (a[0] < 0.0) == (b[0] < 0.0):
            return True
        y = a[1] + (b[1] - a[1]) * a[0] / (a[0] - b[0])
        return bool(0.3 < y < 0.6)

    def sample(rng: np.random.Generator) -> np.ndarray:
        return rng.uniform(-1.0, 1.0, 2)

    start, goal = np.array([-0.8, -0.7]), np.array([0.9, -0.2])
    for seed in range(8):
        rng = np.random.default_rng(seed)
        path = np.array(names["rrt"](start, goal, sample, free, 0.3, 3000, rng))
        assert np.array_equal(path[0], start) and np.array_equal(path[-1], goal)
        assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= 0.3 + 1e-12
        points = np.vstack([a + fractions * (b - a) for a, b in itertools.pairwise(path)])
        crossing = points[np.abs(points[:, 0]) < 1e-4]
        assert len(crossing) and np.all((crossing[:, 1] > 0.29) & (crossing[:, 1] < 0.61))
    for blocked in (lambda a, b: False, lambda a, b: free(a, b) and b[0] < 0.0):
        rng = np.random.default_rng(0)
        assert names["rrt"](start, goal, sample, blocked, 0.3, 200, rng) is None
    assert len(names["rrt"](start, start, sample, free, 0.3, 0, np.random.default_rng(0))) == 1


# --- PID, the integral as a torque: a linear filter, a blocked joint, a bad sample ----------------


@truth("control/windup")
def _windup(names: Names) -> None:
    rng = np.random.default_rng(9)
    period, measured = 2e-3, np.cumsum(rng.normal(0.0, 0.1, 400))
    loop = names["PID"](3.0, 5.0, 0.2, 1e9, period, 15.0)
    outputs = [loop.update(0.5, y) for y in measured]
    pole = 1.0 / (1.0 + period * 2.0 * math.pi * 15.0)
    raw = np.diff(measured, prepend=measured[0]) / period
    rate = lfilter([1.0 - pole], [1.0, -pole], raw)
    error = 0.5 - measured
    integral = 5.0 * period * (np.cumsum(error) - error)  # of the samples before this one
    np.testing.assert_allclose(outputs, 3.0 * error + integral - 0.2 * rate, rtol=1e-9, atol=1e-9)
    for sign in (1.0, -1.0):
        assert names["PID"](50.0, 1.0, 0.0, 2.0, 1e-3, 50.0).update(sign, 0.0) == sign * 2.0
    assert _released(names["PID"](4.0, 1.0, 1.0, 2.0, 1e-3, 1e9)) < 0.4
    # At the limit, an error that brings the command back is still added.
    loop = names["PID"](0.0, 1.0, 0.0, 2.0, 1e-2, 50.0)
    loop.integral = 3.0
    assert loop.update(-1.0, 0.0) == 2.0 and loop.integral == pytest.approx(2.99)
    before = dict(vars(loop))
    with pytest.raises(ValueError, match="finite"):
        loop.update(0.0, math.nan)
    assert vars(loop) == before


# --- RANSAC: the plane that made the points -------------------------------------------------------


@truth("perception/ransac_on_a_whiteboard")
def _ransac(names: Names) -> None:
    angles = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        flat = rng.uniform(-1.0, 1.0, (500, 3))
        flat -= np.outer(flat @ normal - 0.4 - rng.normal(0.0, 2e-3, 500), normal)
        cloud = np.vstack([flat, rng.uniform(-1.0, 1.0, (300, 3))])
        fitted, offset, inliers = names["plane"](cloud, 6e-3, rng)
        assert np.linalg.norm(fitted) == pytest.approx(1.0)
        sign = np.sign(fitted @ normal)
        angles.append(np.linalg.norm(np.cross(fitted, normal)))
        assert sign * offset == pytest.approx(0.4, abs=1e-3)
        assert inliers[:500].mean() > 0.98 and inliers[500:].mean() < 0.05
    # The best angle that 500 points with this noise allow is near 2e-3 / sqrt(500 / 3).
    assert np.median(angles) < 3.0 * 2e-3 / math.sqrt(500 / 3)
    rng = np.random.default_rng(0)
    exact = np.c_[rng.uniform(-1.0, 1.0, (40, 2)), np.full(40, 0.25)]
    exact[:10, :2] = np.linspace(0.0, 1.0, 10)[:, None]  # many of them on one line
    fitted, offset, inliers = names["plane"](exact, 1e-6, rng)
    assert np.allclose(np.abs(fitted), [0, 0, 1]) and inliers.all()
    assert abs(offset) == pytest.approx(0.25)
    # Points on one line have no plane; with few inliers the cube of their share is below rounding.
    with pytest.raises(ValueError, match="plane"), np.errstate(all="raise"):
        names["plane"](np.outer(np.arange(9.0), [1.0, 2.0, 3.0]), 1e-6, rng, most=20)
    sparse = rng.uniform(-1.0, 1.0, (1_000_000, 3))
    with np.errstate(all="raise"):
        *_, few = names["plane"](sparse, 1e-9, rng, most=5)
    assert few.sum() >= 3


# --- Stages with clocks of their own: what had arrived, by division -------------------------------


@truth("pipeline/clocks_of_their_own")
def _clocks(names: Names) -> None:
    def work(name: str) -> Callable[[int, Names], str]:
        return lambda now, known: f"{name} {now}"

    camera, planner, law = (33_333, 45_000), (100_000, 61_000), (1_000, 200)
    stages = {
        "camera": (*camera, (), work("camera")),
        "planner": (*planner, ("camera",), work("planner")),
        "law": (*law, ("planner", "camera"), work("law")),
    }
    log, dropped = names["run"](stages, 1_000_000)
    starts: dict[str, list[int]] = {name: [] for name in stages}
    for now, name, _ in log:
        starts[name].append(now)
    # A camera that needs more than one period starts at every second one; the others at each.
    assert starts["camera"] == list(range(0, 1_000_001, 2 * 33_333))
    assert starts["planner"] == list(range(0, 1_000_001, 100_000))
    assert starts["law"] == list(range(0, 1_000_001, 1_000))
    assert dropped == {"camera": 15}
    for now, name, known in log:
        assert set(known) == set(stages[name][2])
        for other, value in known.items():
            every, lasts = (2 * 33_333, 45_000) if other == "camera" else planner
            captured = (now - lasts) // every * every
            assert value == (None if captured < 0 else (captured, f"{other} {captured}"))
    assert [now for now, _, _ in log] == sorted(now for now, _, _ in log)
