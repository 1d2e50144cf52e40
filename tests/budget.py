"""How much the tests try, and which topic a file belongs to."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import hypothesis
import pytest

from course import CHAPTERS

Item = TypeVar("Item")

ROOT = Path(__file__).resolve().parents[1]
TOPICS = [chapter.topic for chapter in CHAPTERS]
CHAPTER = {chapter.number: chapter.topic for chapter in CHAPTERS}

# Whether this is the long tier, which `make prove` runs.
PROVE = os.environ.get("COURSE_PROVE") == "1"


def examples(count: int) -> hypothesis.settings:
    """Return the settings of a property: `count` examples, and ten times as many to prove it."""
    return hypothesis.settings(max_examples=10 * count if PROVE else count)


def sampled(items: Sequence[Item], step: int) -> Sequence[Item]:
    """Return every `step`-th of many alike items, and all of them to prove it."""
    return items if PROVE else items[::step]


def exercise_topics() -> dict[str, str]:
    """Return the topic of each exercise of the catalogue, by name."""
    from drills.cards import cards

    return {card.name: CHAPTER[card.chapter] for card in cards()}


def exercise_params(*long: str, step: int = 1) -> list[pytest.ParameterSet]:
    """Return the name of each exercise as a test's parameter, with its topic.

    Args:
        *long: those that take seconds; only `make prove` runs them.
        step: `make test` runs one of so many of the others, where another test covers each.
    """
    topics = exercise_topics()
    assert topics.keys() >= set(long), "an exercise was renamed"
    return [
        pytest.param(
            name,
            id=name,
            marks=[
                pytest.mark.topic(topic),
                *([pytest.mark.prove] if name in long or k % step else []),
            ],
        )
        for k, (name, topic) in enumerate(topics.items())
    ]


def topic_of(path: str) -> str:
    """Return the topic that a file belongs to: a chapter's, or the room that it serves.

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
