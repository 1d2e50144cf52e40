"""The judge of the randomisation drill: right answers of another kind, wrong ones, tampering."""

import pytest

from drills import cards as catalogue
from tests.drills.here import grade_here

pytestmark = pytest.mark.slow


CARD = catalogue.card("randomize")
SOLUTION = CARD.solution_text()

# Lists instead of arrays, loops, another order of draws, a copy of the model as the defaults, the
# caller's data for mj_setConst with its positions put back, friction by way of a smooth floor.
ANOTHER = """
import copy
import mujoco
import numpy as np


class DomainRandomizer:
    def __init__(self, model, friction=(0.4, 1.2), mass=(0.7, 1.3), damping=(0.0, 0.5),
                 delay=(0, 3), noise=0.01, idle=0.0):
        for (low, high), least in ((friction, 1e-12), (mass, 1e-12), (damping, 0), (delay, 0)):
            if not least <= low <= high:
                raise ValueError("not a range")
        if noise < 0 or delay != (int(delay[0]), int(delay[1])):
            raise ValueError("noise or delay")
        self.m, self.saved = model, copy.copy(model)
        self.r = friction, mass, damping, delay
        self.noise, self.idle, self.k, self.buffer = noise, idle, 0, []
        names = [n for n in dir(model) if n[0] != "_"]
        self.names = [n for n in names if isinstance(getattr(model, n), np.ndarray)]

    def restore(self, data):
        for name in self.names:
            getattr(self.m, name)[...] = getattr(self.saved, name)
        mujoco.mj_forward(self.m, data)
        self.k, self.buffer = 0, []

    def randomize(self, data, rng):
        m = self.m
        self.restore(data)
        self.k = rng.integers(self.r[3][0], self.r[3][1] + 1)
        for joint in range(m.njnt):
            if m.jnt_type[joint] in (2, 3):
                m.dof_damping[m.jnt_dofadr[joint]] += rng.uniform(*self.r[2])
        for body in range(1, m.nbody):
            factor = rng.uniform(*self.r[1])
            m.body_mass[body] *= factor
            m.body_inertia[body] *= factor
        mu = rng.uniform(*self.r[0])
        m.geom_friction[1:, 0] = mu
        m.geom_friction[0, 0] = 0.0
        m.pair_friction[:, :2] = mu
        qpos = data.qpos.copy()
        mujoco.mj_setConst(m, data)
        data.qpos[:] = qpos
        mujoco.mj_forward(m, data)
        print("drawn")

    def delay(self, action):
        self.buffer.append([float(a) for a in action])
        return self.buffer.pop(0) if len(self.buffer) > self.k else [self.idle] * len(action)

    def observe(self, observation, rng):
        return [float(x) + self.noise * rng.standard_normal() for x in observation]
"""


@pytest.mark.prove
def test_another_right_answer_passes() -> None:
    report = grade_here("randomize", ANOTHER, seed=1)
    assert report.passed, report.sentence


@pytest.mark.prove
@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("rng.standard_normal()", "rng.uniform(-3**0.5, 3**0.5)", "beyond two standard dev"),
        ("mu = rng.uniform(", "mu = np.random.uniform(", "The same seed gives another model"),
        ("m.geom_friction[0, 0] = 0.0", "m.geom_friction[0, 0] = mu + 0.1", "not one draw"),
        ("        mu = rng", "        m.geom_size[:] *= 1.1\n        mu = rng", "geom_size"),
        ("*= factor\n        mu", "*= factor**2\n        mu", "inertia is not multiplied"),
        ("else [self.idle] * len(action)", "else [0.0] * len(action)", "delay returned"),
        ("return self.buffer.pop(0) if", "return 'x' if", "is (or holds) a str"),
    ],
)
def test_another_wrong_answer_fails(old: str, new: str, text: str) -> None:
    assert ANOTHER.count(old) == 1
    report = grade_here("randomize", ANOTHER.replace(old, new), seed=2)
    assert not report.passed
    assert text in report.sentence and not report.slip


@pytest.mark.prove
@pytest.mark.parametrize(
    "tampering",
    [
        "given.arrays = lambda model: None",
        "given.draw = lambda *a: {'delayed': []}",
        "given.state = lambda data: {'qpos': float('nan')}",
        "given.delay_reused = lambda *a: ['x']",
    ],
)
def test_a_tampered_reading_fails_and_stops_nothing(tampering: str) -> None:
    assert not grade_here("randomize", f"{SOLUTION}\nimport given\n{tampering}\n", seed=3).passed


def test_what_neither_is_right_nor_known_is_not_named() -> None:
    report = grade_here("randomize", CARD.starter(), seed=4)
    assert not report.passed and not report.slip
