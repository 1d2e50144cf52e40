"""What the home page and the README say of the course's size, counted in the course itself.

A text of a notebook takes a sentence from here by its name, such as `{{front.hours}}`. Large counts
are rounded down, so that one more claim does not change the home page.
"""

from course import CHAPTERS, charts, derivations, simulations
from drills import agenda, cards, progress


def counts() -> str:
    """Return how much there is of what: chapters, simulations, claims, charts and exercises."""
    claims = _at_least(len(derivations.claims()), 100)
    pictures = _at_least(len(list(charts.FOLDER.glob("*.json"))), 10)
    exercises = _at_least(len(list(cards.cards())), 10)
    return (
        f"{len(CHAPTERS)} chapters, {len(simulations.SIMULATIONS)} simulations, {claims} claims "
        f"checked by code, {pictures} charts, {exercises} graded exercises."
    )


def hours() -> str:
    """Return how long the course takes: to read it, and to solve its exercises and drills."""
    standing = agenda.standings(progress.Loaded())
    reading = sum(row.reading_minutes for row in standing)
    solving = sum(row.exercise_minutes for row in standing)
    return f"About {round(reading / 60)} hours to read and {round(solving / 60)} hours to solve."


def _at_least(count: int, step: int) -> str:
    """Return a count as words, rounded down to a multiple of `step`."""
    return f"more than {count // step * step}" if count % step else str(count)
