"""`python -m course.derivations [chapter] [--id ID] [--json]`: settle the claims and print them."""

import json
import sys
import time
from typing import Any

import click

from course.derivations import Claim, Outcome, claims, figure_text, run

_STYLE = {"holds": "green", "holds only if": "yellow", "false": "red"}


def _as_data(claim: Claim, outcome: Outcome | None, error: str) -> dict[str, Any]:
    data: dict[str, Any] = {
        "id": claim.id,
        "chapter": claim.chapter,
        "claim": claim.claim,
        "verdict": claim.verdict.value,
        "condition": claim.condition,
        "corrected": claim.corrected,
        "source": claim.source,
        "answerable": claim.formula is not None,
        "disagreements": [error] if outcome is None else list(outcome.disagreements),
    }
    if outcome is not None:
        data["statement"] = outcome.finding.statement
        data["figures"] = dict(outcome.finding.figures)
    return data


def _settled(selected: list[Claim]) -> list[tuple[Claim, Outcome | None, str]]:
    results: list[tuple[Claim, Outcome | None, str]] = []
    for item in selected:
        try:
            results.append((item, run(item.id), ""))
        except Exception as problem:  # a check that breaks is a disagreement, not the end
            results.append((item, None, f"the check broke: {type(problem).__name__}: {problem}"))
    return results


def _print_table(results: list[tuple[Claim, Outcome | None, str]]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(show_lines=True, expand=True, padding=(0, 1))
    table.add_column("verdict", width=18)
    table.add_column("claim, and what is true", ratio=1, overflow="fold")
    for claim, outcome, error in results:
        verdict = claim.verdict.value
        left = Text(verdict, style=_STYLE[verdict])
        if claim.condition:
            left.append(f" {claim.condition}", style="default")
        left.append(f"\nchapter {claim.chapter}", style="dim")
        right = Text()
        right.append(claim.id, style="bold")
        right.append(f"\n“{claim.claim}”\n", style="italic")
        right.append(claim.corrected)
        if outcome is not None:
            for name, value in outcome.finding.figures.items():
                right.append(f"\n  {name} = {figure_text(value)}", style="cyan")
        for text in [error] if outcome is None else outcome.disagreements:
            right.append(f"\n  DISAGREES: {text}", style="bold red")
        table.add_row(left, right)
    console = Console()
    console.print(table)


@click.command()
@click.argument("chapter", type=int, required=False)
@click.option("--id", "only", metavar="ID", help="Only the claim with this id.")
@click.option("--json", "as_json", is_flag=True, help="Print data instead of a table.")
def main(chapter: int | None, only: str | None, as_json: bool) -> None:
    """Settle the claims of the course, or of one CHAPTER, and print them with their figures.

    The exit code is 1 if a check disagrees with the record.
    """
    start = time.perf_counter()
    try:
        selected = claims(chapter)
    except ValueError as problem:
        raise click.UsageError(str(problem)) from None
    if only is not None:
        selected = [item for item in selected if item.id == only]
        if not selected:
            raise click.UsageError(f"there is no claim with the id {only!r} here")
    results = _settled(selected)
    wrong = sum(outcome is None or not outcome.agrees for _, outcome, _ in results)
    if as_json:
        print(json.dumps([_as_data(*result) for result in results], indent=1))
    else:
        _print_table(results)
        seconds = time.perf_counter() - start
        verdicts = ", ".join(
            f"{sum(c.verdict.value == v for c in selected)} {v.removesuffix(' if')}" for v in _STYLE
        )
        print(f"{len(results)} claims ({verdicts}) settled in {seconds:.0f} s; {wrong} disagree")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
