"""What a topic may cost: lines of Python, and seconds of processor time of its tests.

A chapter has the budget of all chapters. What was there before there was a budget has a ceiling of
its own, which only falls: whoever needs less lowers it here.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import hypothesis
import numpy as np

from course import CHAPTERS

ROOT = Path(__file__).resolve().parents[1]
TOPICS = [chapter.topic for chapter in CHAPTERS]
CHAPTER = {chapter.number: chapter.topic for chapter in CHAPTERS}

# Whether this is the long tier, which `make prove` runs.
PROVE = os.environ.get("COURSE_PROVE") == "1"

LINES, SECONDS = 7_500, 60.0
# What is above the budget of a chapter has a ceiling of its own until it is back within it.
LINES_OF = {
    "rigid_body": 21_400, "drills": 15_300, "kinematics": 9_300, "contact": 10_400,
    "control": 13_670, "planning": 12_510, "perception": 9_950, "sim_to_real": 9_790,
    "learning": 8_040, "pipeline": 8_060, "middleware": 9_495, "platforms": 8_299,
    "interview": 10_340,
}  # fmt: skip
SECONDS_OF = {
    "learning": 90.0, "rigid_body": 135.0, "drills": 150.0,
    "control": 70.0, "planning": 90.0, "sim_to_real": 80.0,
    "site": 120.0,
}  # fmt: skip

# A topic above its seconds is told, and fails the run only above so many times its seconds, as
# processor time itself is uncertain: the same tests of contact, of the same commit, took 55 and
# 71 s on two quiet machines of the same kind; and where all tests ran two at a time, on a machine
# whose `yardstick` was 1.3 times the one below, most topics took 1.6 to 1.9 times their seconds.
SPREAD = 1.9
# Processor time [s] of `yardstick` where the seconds above were set, with two processes at work. A
# machine on which the same work takes twice as long may take twice the seconds for everything.
YARDSTICK = 0.018

# Beginnings of the names of tests. What is run with every topic: the frame that all stand in.
SMOKE = (
    "tests/test_project.py",
    "tests/test_check.py",
    "tests/measure/test_figure.py",
    "tests/measure/test_scene.py",
    "tests/measure/test_stability.py",
    "tests/measure/test_success.py",
    "tests/measure/test_timing.py",
    "tests/measure/test_work_precision.py",
    "tests/derivations/test_framework.py",
    "tests/simulations/test_record.py",
    "tests/simulations/test_pen.py",
    "tests/drills/test_chapters.py",
    "tests/drills/test_layout.py",
    "tests/drills/test_values.py",
    "tests/drills/test_submission.py",
    "tests/drills/test_cli.py::test_a_newcomer_starts_fails_asks_and_solves",
    "tests/drills/test_cli.py::test_the_first_two_minutes_of_the_readme",
    "tests/drills/test_cli.py::test_the_json_of_the_quick_commands",
)
# What `make check` leaves out, as it takes long: processes, browsers, whole catalogues, compiling.
SLOW = (
    "tests/contact/test_model_charts.py",
    "tests/control/test_solutions.py::test_gain_and_period",
    "tests/control/test_solutions.py::test_the_inertia_comes_out",
    "tests/derivations/test_derivations.py",
    "tests/derivations/test_mutations.py",
    "tests/dist/test_wheel.py",
    "tests/drills/test_attacks_judges.py",
    "tests/drills/test_cli.py",
    "tests/drills/test_feedback.py::test_feedback_is_the_golden_one",
    "tests/drills/test_hostile.py",
    "tests/drills/test_notebook.py",
    "tests/drills/test_sandbox",
    "tests/drills/test_session.py",
    "tests/drills/test_verify.py",
    "tests/kinematics/test_solutions.py::test_torques_are_those_of_pinocchio_and_mujoco",
    "tests/kinematics/test_charts.py",
    "tests/learning/test_evaluate.py::test_settings_are",
    "tests/learning/test_ppo.py::test_the_point_is_learned",
    "tests/notebooks/test_browser.py",
    "tests/notebooks/test_lab",
    "tests/perception/test_cloud_charts.py",
    "tests/platforms/test_readers.py::test_what_a_reader_does",
    "tests/platforms/test_simulators.py",
    "tests/rigid_body/test_charts.py",
    "tests/rigid_body/test_differentiable.py::test_recovers_parameters",
    "tests/rigid_body/test_integrators.py::test_compiled_and_plain_source_agree",
    "tests/rigid_body/test_loop.py::test_an_hour_has",
    "tests/rigid_body/test_planar.py::test_resting_face_contact_properties",
    "tests/simulations/test_browser.py",
    "tests/simulations/test_compiled.py",
    "tests/simulations/test_models.py",
    "tests/site/player/test_browser.py",
    "tests/site/test_build.py",
    "tests/site/pages",
    "tests/test_compiled.py",
    "tests/test_tools.py::test_in_the_background",
    "tests/vector_env/test_charts.py",
    "tests/vector_env/test_wrappers_sb3.py",
    "tests/vector_env/test_vector_env.py",
)
# Processor time that the quick tests may take in all, warm.
QUICK_SECONDS = 240.0


def is_smoke(name: str) -> bool:
    """Whether a test, by its name from the project's folder, is run with every topic."""
    return name.startswith(SMOKE)


def is_quick(name: str) -> bool:
    """Whether `make check` runs a test."""
    return is_smoke(name) or not name.startswith(SLOW)


def examples(count: int) -> hypothesis.settings:
    """Settings of a property: so many examples, and ten times as many to prove it."""
    return hypothesis.settings(max_examples=10 * count if PROVE else count)


def lines_allowed(topic: str) -> int:
    """Lines of Python that a topic may have."""
    return LINES_OF.get(topic, LINES)


def seconds_allowed(topic: str) -> float:
    """Seconds of processor time that the tests of a topic may take, once its loops are compiled."""
    return SECONDS_OF.get(topic, SECONDS)


def processor_time() -> float:
    """Seconds of processor time of this process and of those that it has waited for."""
    usages = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def working_time() -> float:
    """Processor time without what went into compiling, as a topic's seconds are those after it.

    Some loops are compiled by the first test that calls them, not by `make warm`.
    """
    module = sys.modules.get("course.compiled")
    return processor_time() - sum(module.COMPILE_SECONDS.values() if module else ())


def yardstick() -> float:
    """Processor time [s] of a fixed piece of work: objects, text and memory, as in a test."""
    start = processor_time()
    words = {f"{i % 977}.{i}": (i, str(i)) for i in range(15_000)}
    sorted(words, key=lambda word: words[word][1])
    np.sort(np.cos(np.arange(200_000.0)))
    return processor_time() - start


def slowness(measured: Sequence[float]) -> float:
    """How many times slower than where the seconds were set, at least 1; `yardstick`s of a run."""
    return max(1.0, statistics.median(measured) / YARDSTICK) if measured else 1.0


def too_costly(seconds: Mapping[str, float], slow: float = 1.0) -> list[str]:
    """The topics that took more than `SPREAD` times the seconds that they may take.

    Args:
        seconds: processor time by topic.
        slow: how many times slower the machine is than that of the seconds.
    """
    limit = SPREAD * slow
    return [topic for topic, spent in seconds.items() if spent > limit * seconds_allowed(topic)]


def exercise_topics() -> dict[str, str]:
    """The topic of each exercise of the catalogue, by name."""
    from drills.cards import cards

    return {card.name: CHAPTER[card.chapter] for card in cards()}


def topic_of(path: str) -> str:
    """The topic that a file counts for: a chapter's, or the room that it serves.

    Args:
        path: relative to the project, with slashes.
    """
    parts = Path(path).parts
    if parts[:2] == ("drills", "catalogue") and len(parts) > 3:
        return exercise_topics().get(parts[2], "drills")
    named = [part.removesuffix(".py") for part in parts]
    numbered = {f"{chapter.number:02d}_{chapter.topic}": chapter.topic for chapter in CHAPTERS}
    for part in named:
        if part in TOPICS or part in numbered:
            return numbered.get(part, part)
    if "vector_env" in named:
        return "vector_env"
    inner = [part for part in parts[:-1] if part not in ("tests", "prove", "course")]
    return inner[0] if inner else "project"


def count_lines() -> Counter[str]:
    """Lines of Python by topic, of what git knows or would add."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", "*.py"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    counted: Counter[str] = Counter()
    for name in sorted(set(done.stdout.split("\0"))):
        if name and (ROOT / name).is_file():
            lines = (ROOT / name).read_text(encoding="utf-8").count("\n")
            counted[topic_of(name)] += lines
    return counted
