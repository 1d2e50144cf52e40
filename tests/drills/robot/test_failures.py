"""A part that fails is named, with the tick and the call; the call reproduces the failure."""

import pytest

from drills.robot.levels import level
from drills.robot.play import Played, play
from tests.drills.robot.robots import parts_with

pytestmark = pytest.mark.slow

TORQUE = "def computed_torque(lengths, masses, gravity, q, v, reference, kp, kd):\n"
LATER = (
    "CALLS = []\n"
    + TORQUE
    + "    CALLS.append(1)\n    if len(CALLS) < 40:\n        return kp * 0\n"
)


def run(**texts: str) -> Played:
    return play(parts_with(**texts), level(2), 3)


@pytest.mark.prove
@pytest.mark.parametrize(
    ("text", "kind", "message"),
    (
        (TORQUE + "    return [1 / 0, 2]\n", "raised", "ZeroDivisionError"),
        (TORQUE + "    raise SystemExit(3)\n", "raised", "SystemExit"),
        (TORQUE + "    return [float('nan'), 1.0]\n", "not finite", "NaN"),
        (TORQUE + "    return q[:1]\n", "wrong shape", "(1,)"),
        (TORQUE + "    return None\n", "wrong type", "None"),
        (TORQUE + "    return 'fast'\n", "wrong type", "str"),
        (TORQUE + "    while True:\n        pass\n", "too slow", "processor time"),
        (
            TORQUE + "    while True:\n        try:\n            sum(q)\n"
            "        except Exception:\n            pass\n",
            "too slow",
            "processor time",
        ),
        ("def computed_torque(:\n", "raised", "SyntaxError"),
        ("x = 1\n", "raised", "no function"),
    ),
)
def test_a_part_that_fails_is_named(text: str, kind: str, message: str) -> None:
    failure = run(computed_torque=text).failure
    assert failure is not None
    assert (failure.part, failure.kind) == ("computed_torque", kind)
    assert message in failure.text


def test_the_tick_the_line_and_the_call_are_told() -> None:
    result = run(computed_torque=LATER + "    return 1 / 0\n")
    failure = result.failure
    assert failure is not None and failure.line == LATER.count("\n") + 1
    # The motion begins after four images of twelve ticks.
    assert failure.tick == 4 * 12 + 39
    names: dict[str, object] = {}
    exec("import numpy as np\n" + LATER + "    return 1 / 0\nCALLS += [1] * 39\n", names)
    with pytest.raises(ZeroDivisionError):
        exec(failure.call, names)


@pytest.mark.prove
@pytest.mark.parametrize(
    ("line", "kind"),
    (
        ("import ctypes; ctypes.string_at(0)", "ended the process"),
        ("sum(range(10**12))", "too slow"),
    ),
)
def test_a_part_that_takes_the_process_with_it_is_named(line: str, kind: str) -> None:
    failure = run(computed_torque=TORQUE + f"    {line}\n").failure
    assert failure is not None
    assert (failure.part, failure.kind) == ("computed_torque", kind)
    assert failure.call.startswith("computed_torque(") and failure.tick == 4 * 12


@pytest.mark.prove
def test_what_a_part_prints_does_not_end_the_run() -> None:
    from drills.robot.holders import course_part

    source = course_part("verlet").source
    talkative = source.replace('    """\n', '    """\n    print("x" * 2000)\n', 1)
    talkative = talkative.replace("raise ValueError", "print(1); raise ValueError", 1)
    assert run(verlet=talkative).failure is None
