"""What a topic may cost: lines of Python, and seconds of processor time of its tests.

A chapter has the budget of all chapters. What was there before there was a budget has a ceiling of
its own, which only falls: whoever needs less lowers it here.
"""

from __future__ import annotations

import os
import subprocess
from collections import Counter
from pathlib import Path

import hypothesis

from course import CHAPTERS

ROOT = Path(__file__).resolve().parents[1]
TOPICS = [chapter.topic for chapter in CHAPTERS]
CHAPTER = {chapter.number: chapter.topic for chapter in CHAPTERS}

# Whether this is the long tier, which `make prove` runs.
PROVE = os.environ.get("COURSE_PROVE") == "1"

LINES, SECONDS = 7_500, 60.0
LINES_OF = {"rigid_body": 20_000, "drills": 20_000}
SECONDS_OF = {"learning": 90.0, "rigid_body": 200.0, "drills": 400.0}


def examples(count: int) -> hypothesis.settings:
    """Settings of a property: so many examples, and ten times as many to prove it."""
    return hypothesis.settings(max_examples=10 * count if PROVE else count)


def lines_allowed(topic: str) -> int:
    """Lines of Python that a topic may have."""
    return LINES_OF.get(topic, LINES)


def seconds_allowed(topic: str) -> float:
    """Seconds of processor time that the tests of a topic may take, once its loops are compiled."""
    return SECONDS_OF.get(topic, SECONDS)


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
