"""The warming of the cache: what it covers, in which order, and without standing in the way."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from course import CHAPTERS
from tools import warm

ROOT = Path(__file__).resolve().parents[1]
PLAIN = {**os.environ, "NUMBA_DISABLE_JIT": "1"}


def test_every_module_that_compiles_is_warmed_in_reading_order() -> None:
    order = [chapter.topic for chapter in CHAPTERS]
    result = warm.topics()
    assert {"rigid_body", "vector_env"} <= set(result)
    end = len(order)
    beside = {"vector_env": order.index("sim_to_real") - 0.5, "simulations": end, "robot": end}
    places = [beside[t] if t in beside else order.index(t) for t in result]
    assert places == sorted(places)
    compiling = {
        path.relative_to(ROOT / "course").parts[0].removesuffix(".py")
        for path in (ROOT / "course").rglob("*.py")
        if re.search(r"(?<!\w)(?:compiled|loop)\(", path.read_text(encoding="utf-8"))
    }
    compiling -= {"compiled", "charts", "derivations", "oracles", "simulations", "site"}
    assert compiling <= set(result)
    # Chapter 3 compiles nothing of its own: it runs a later chapter's loops before they are read.
    # The robot is in `drills`.
    assert set(result) - compiling == {"platforms", "simulations", "robot"}


@pytest.mark.prove
def test_a_topic_can_be_chosen_and_a_wrong_one_is_named() -> None:
    command = [sys.executable, "-m", "tools.warm"]
    done = subprocess.run(
        [*command, "vector_env"], cwd=ROOT, env=PLAIN, capture_output=True, text=True, timeout=120
    )
    assert done.stdout.startswith("vector_env: 0 compiled functions ready")
    assert "rigid_body" not in done.stdout
    with pytest.raises(SystemExit):
        warm.main(["weather"])


@pytest.mark.prove
def test_in_the_background_it_is_silent_detached_and_gentle(monkeypatch) -> None:
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    process = warm.start_in_background([])
    assert os.getpgid(process.pid) != os.getpgrp()
    # At the lowest priority it waits for everything else that runs: the limit is only a backstop.
    assert process.wait(timeout=1800) == 0
    program = "from tools import warm; import os; warm.topics = lambda: []; warm.main(['--gently'])"
    program += "; print(os.nice(0))"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=120
    )
    assert done.stdout.split() == ["19"]
    done = subprocess.run(
        [sys.executable, "-m", "tools.warm", "--background", "vector_env"],
        cwd=ROOT,
        env=PLAIN,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize("module", ["tools.warm", "tools.lab"])
def test_what_make_lab_runs_before_the_server_imports_nothing_heavy(module: str) -> None:
    heavy = "numba scipy matplotlib sympy torch mujoco jupyterlab nbformat"
    program = f"import sys, {module}; print(*[n for n in {heavy!r}.split() if n in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stdout.split()) == (0, []), done.stderr
