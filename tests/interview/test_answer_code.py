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

import mujoco
import numpy as np
import pytest
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


# The chapters whose coding questions all have their code.
WITH_CODE = ("interview", "role")


def test_a_request_for_code_is_answered_with_code() -> None:
    requested = {
        name
        for name, question in QUESTIONS.items()
        if name.split("/")[0] in WITH_CODE
        and (question.kind == "coding" or question.title.startswith("Write "))
    }
    assert len(requested) >= 5 and requested <= CODE.keys()


def test_every_code_has_its_truth() -> None:
    assert CODE.keys() == TRUTHS.keys()


@pytest.mark.parametrize("name", CODE)
def test_the_code_is_short_and_no_line_is_cut_on_a_page(name: str) -> None:
    for block in CODE[name]:
        lines = [line for line in block.splitlines() if line.strip()]
        assert len(lines) <= MOST_LINES
        assert max(map(len, lines)) <= 100


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
            assert np.linalg.norm(b - a) <= 1.0 + 1e-12
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
        one.start()
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
        twin.start()
    assert np.array_equal(twins[0].model.body_mass, twins[1].model.body_mass)


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
