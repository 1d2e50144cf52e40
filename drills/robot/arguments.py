"""Options that several commands of the robot share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def level_option(highest: int, default: str) -> Decorator:
    """Return the option for the level, which arrives as `number`.

    Args:
        highest: the last level that the command plays.
        default: the end of its help text, which says what happens without it.
    """
    help_text = f"1 to {highest}; else {default}."
    return click.option("--level", "number", type=click.IntRange(1, highest), help=help_text)


def tasks_option(least: int, largest: int, default: int) -> Decorator:
    """Return the option for the number of tasks."""
    limits = click.IntRange(least, largest)
    return click.option("--tasks", type=limits, default=default, show_default=True)


def output_option(kind: str, what: str) -> Decorator:
    """Return the option for the file to write.

    Args:
        kind: of the file, such as "PNG".
        what: is written into it, a noun.
    """
    return click.option("-o", "--output", metavar=kind, help=f"Where to write the {what}.")


seed_option: Decorator = click.option(
    "--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True
)


def parts_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options for who holds slots, `choices`, and for functions of one's own, `own`."""
    command = click.option(
        "--own", multiple=True, metavar="FUNCTION=FILE", help="A stage's function of your own."
    )(command)
    return click.option(
        "--part",
        "choices",
        multiple=True,
        metavar="SLOT=WHO",
        help="Who holds a slot or a stage: yours, course, or a library.",
    )(command)
