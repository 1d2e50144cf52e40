"""`python -m course.derivations [WHICH] [--id ID] [--json] [--record]`: settle the claims."""

import functools
import json
import sys
import time
from pathlib import Path
from typing import Any

import click

import course
from course import CHAPTERS
from course.derivations import (
    Claim,
    Outcome,
    claims,
    defining,
    figure_text,
    records,
    run,
    unmet,
)

_STYLE = {"holds": "green", "holds only if": "yellow", "false": "red"}
_NOT_RUN = "NOT RUN"
# A claim; what its check found; and where it found nothing, why: it broke, or could not run here.
Result = tuple[Claim, Outcome | None, str]


@functools.cache
def _notebook(chapter: int) -> str:
    """Return the text of the cells in the chapter's notebook, or nothing if it does not exist."""
    notebook = next(item.notebook for item in CHAPTERS if item.number == chapter)
    path = Path(course.__file__).parents[1] / notebook
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"] if path.exists() else ()
    return "\n".join("".join(cell["source"]) for cell in cells)


def shown(claim: Claim) -> bool:
    """Return whether the notebook of its chapter or of a later one names the claim."""
    later = range(claim.chapter, len(CHAPTERS))
    return any(f'"{claim.id}"' in _notebook(chapter) for chapter in later)


def _could_not_run(outcome: Outcome | None, error: str) -> bool:
    return outcome is None and error.startswith(_NOT_RUN)


def _disagreements(outcome: Outcome | None, error: str) -> list[str]:
    """Return the faults of a claim; a check that could not run here is not a fault."""
    if outcome is not None:
        return list(outcome.disagreements)
    return [] if _could_not_run(outcome, error) else [error]


def _as_data(claim: Claim, outcome: Outcome | None, error: str) -> dict[str, Any]:
    data: dict[str, Any] = {
        "id": claim.id,
        "chapter": claim.chapter,
        "claim": claim.claim,
        "source": claim.source,
        "answerable": claim.formula is not None,
        "shown": shown(claim),
        "disagreements": _disagreements(outcome, error),
        "not_run": error if _could_not_run(outcome, error) else "",
    }
    if outcome is not None:
        data["verdict"] = outcome.finding.verdict.value
        data["condition"] = outcome.condition
        data["corrected"] = outcome.corrected
        data["statement"] = outcome.finding.statement
        data["figures"] = dict(outcome.finding.figures)
    return data


def _settled(selected: list[Claim]) -> list[Result]:
    results: list[Result] = []
    for item in selected:
        if reason := unmet(item):
            results.append((item, None, f"{_NOT_RUN}: {reason}"))
            continue
        try:
            results.append((item, run(item.id), ""))
        except Exception as problem:  # a check that breaks is a disagreement, not the end
            results.append((item, None, f"the check broke: {type(problem).__name__}: {problem}"))
    return results


def _print_table(results: list[Result]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(show_lines=True, expand=True, padding=(0, 1))
    table.add_column("verdict", width=18)
    table.add_column("claim, and what is true", ratio=1, overflow="fold")
    for claim, outcome, error in results:
        left, right = Text(), Text()
        right.append(claim.id, style="bold")
        right.append(f"\n“{claim.claim}”\n", style="italic")
        if outcome is not None:
            verdict = outcome.finding.verdict.value
            left.append(verdict, style=_STYLE[verdict])
            left.append(f" {outcome.condition}" if outcome.condition else "")
            right.append(outcome.corrected)
            for name, value in outcome.finding.figures.items():
                right.append(f"\n  {name} = {figure_text(value)}", style="cyan")
        left.append(f"\nchapter {claim.chapter}", style="dim")
        left.append("" if shown(claim) else "\nin no notebook", style="dim")
        if _could_not_run(outcome, error):
            right.append(f"\n  {error}", style="yellow")
        for text in _disagreements(outcome, error):
            right.append(f"\n  DISAGREES: {text}", style="bold red")
        table.add_row(left, right)
    console = Console()
    console.print(table)


def _record(results: list[Result], whole: bool) -> int:
    """Write what came out of these claims, say what changes; how many could not be written."""
    rejected = 0
    for file in sorted({claim.file for claim, _, _ in results}):
        entries = dict(records.load(file))
        new = dict(entries)
        for claim, outcome, error in results:
            if claim.file != file:
                continue
            if outcome is None or outcome.faults:
                rejected += 1
                for text in [error] if outcome is None else outcome.faults:
                    click.echo(f"{claim.id}: NOT WRITTEN: {text}")
                continue
            entry = claim.entry(outcome.finding)
            if claim.id not in entries:
                click.echo(f"{claim.id}: new on record")
            else:
                for text in records.differences(entries[claim.id], entry):
                    click.echo(f"{claim.id}: {text}")
            new[claim.id] = records.merged(entries.get(claim.id), entry)
        if whole:
            for id in sorted(set(new) - {item.id for item in claims() if item.file == file}):
                click.echo(f"{id}: leaves the record, there is no such claim in {file}")
                del new[id]
        if new != entries:
            records.save(file, new)
    return rejected


def select(which: str | None, ids: tuple[str, ...]) -> list[Claim]:
    """Return the claims of a chapter's number, a topic or a file.

    If ids are given, only those claims are returned.

    Raises:
        click.UsageError: where there is none.
    """
    try:
        if ids and which is None:
            selected = list(defining(ids))
        elif which is None or which.isdecimal():
            selected = claims(int(which) if which else None)
        else:
            everything = claims()
            selected = [c for c in everything if f"{c.file}.".startswith(f"{which}.")]
            if not selected:
                raise ValueError(
                    f"which is {which!r}; it is a chapter's number, a topic, or one of "
                    f"{', '.join(sorted({c.file for c in everything}))}"
                )
    except ValueError as problem:
        raise click.UsageError(str(problem)) from None
    missing = sorted(set(ids) - {item.id for item in selected})
    if missing:
        raise click.UsageError(f"there is no claim with the id {missing[0]!r} here")
    return [item for item in selected if item.id in ids] if ids else selected


@click.command()
@click.argument("which", required=False)
@click.option("--id", "ids", metavar="ID", multiple=True, help="Only this claim (repeatable).")
@click.option("--json", "as_json", is_flag=True, help="Print data instead of a table.")
@click.option("--record", is_flag=True, help="Write what came out on record; print what changes.")
def main(which: str | None, ids: tuple[str, ...], as_json: bool, record: bool) -> None:
    """Settle the claims of the course and print them with their figures.

    WHICH is a chapter's number, a topic (rigid_body) or a file (rigid_body.flight); default: all.
    The exit code is 1 if a check fails or disagrees with the record. A check whose simulator or
    compiler is not installed is named and not counted as failed.
    """
    start = time.perf_counter()
    selected = select(which, ids)
    results = _settled(selected)
    if record:
        sys.exit(1 if _record(results, whole=not ids) else 0)
    wrong = sum(bool(_disagreements(outcome, error)) for _, outcome, error in results)
    skipped = sum(_could_not_run(outcome, error) for _, outcome, error in results)
    if as_json:
        print(json.dumps([_as_data(*result) for result in results], indent=1))
    else:
        _print_table(results)
        seconds = time.perf_counter() - start
        computed = [outcome.finding.verdict.value for _, outcome, _ in results if outcome]
        verdicts = ", ".join(f"{computed.count(v)} {v}" for v in _STYLE if v in computed)
        count = len(results) - skipped
        settled = f"{count} claim{'' if count == 1 else 's'}{f' ({verdicts})' if verdicts else ''}"
        settled += f" settled in {seconds:.0f} s"
        remaining = f"; {skipped} not run here" if skipped else ""
        print(f"{settled}{remaining}; {wrong} disagree")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
