"""The tables of the interview: the cheat sheet, classical against learned, and what to read.

They are data, `cheat_sheet.toml` and `reading.toml`; here they are filled and laid out: as Markdown
for a notebook, as text of 80 columns for a terminal, as one page to print.

    python -m course.interview.tables                 # the text
    python -m course.interview.tables --page          # a page, HTML to print
    python -m course.interview.tables --record        # what the charts and estimates give now
"""

import functools
import html
import os
import sys
import textwrap
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from course import CHAPTERS
from course.check import invalid, one_of
from course.interview.chart_data import chart
from course.interview.fields import FIELD, estimate, filled

FOLDER = Path(__file__).parent
RECORD = FOLDER / "quoted.toml"
NOT_MEASURED = "not measured here"


@dataclass(frozen=True)
class Table:
    """A table of words.

    Attributes:
        title: above it.
        head: of the columns.
        rows: cells, as many as there are columns.
    """

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.head) or not all(row):
                raise invalid(f"a row of {self.title}", row, f"{len(self.head)} cells, none empty")

    def text(self, width: int = 80) -> str:
        """Return a table row by row, for a terminal.

        The first cell comes first, then the others after the names of their columns.
        """
        blank = max(map(len, self.head[1:])) + 4
        lines = [self.title, "=" * len(self.title)]
        for first, *cells in self.rows:
            lines += ["", *textwrap.wrap(first, width, break_on_hyphens=False)]
            for head, cell in zip(self.head[1:], cells, strict=True):
                result = textwrap.wrap(cell, width - blank, break_on_hyphens=False)
                lines.append(f"  {head}".ljust(blank) + f"\n{' ' * blank}".join(result))
        return "\n".join(lines)

    def markdown(self) -> str:
        """Return a table of Markdown."""
        rows = [self.head, ("---",) * len(self.head), *self.rows]
        return "\n".join(
            "| " + " | ".join(c.replace("|", r"\|") for c in row) + " |" for row in rows
        )

    def html(self) -> str:
        """Return a table of HTML, with its title as caption."""

        def line(cells: tuple[str, ...], tag: str) -> str:
            return "<tr>" + "".join(f"<{tag}>{html.escape(c)}</{tag}>" for c in cells) + "</tr>"

        rows = [line(self.head, "th"), *(line(row, "td") for row in self.rows)]
        return "\n".join(
            [f"<table><caption>{html.escape(self.title)}</caption>", *rows, "</table>"]
        )

    def __repr__(self) -> str:
        return self.text()

    def _repr_markdown_(self) -> str:
        return self.markdown()


@functools.cache
def data(name: str) -> dict[str, Any]:
    """Return what stands in `cheat_sheet.toml` or `reading.toml`, as it is written."""
    one_of("name", name, ("cheat_sheet", "reading"))
    return tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def work(name: str) -> dict[str, Any]:
    """Return a paper or book by its name in `reading.toml`."""
    known: dict[str, dict[str, Any]] = data("reading")["works"]
    return known[one_of("work", name, known)]


def short(name: str) -> str:
    """Return a work as it is named in a table: authors, year, venue."""
    result = work(name)
    first, *others = result["authors"].replace(" and others", ", others").split(", ")
    owner = f"{first} and others" if others else first
    return f"{owner}, {result['year']} ({result['venue']})"


def link(name: str) -> str:
    """Return where a work is found: its DOI, or its number at arXiv."""
    result = work(name)
    return f"doi.org/{result['doi']}" if "doi" in result else f"arXiv:{result['arxiv']}"


def _filled_in(text: str) -> str:
    from course.derivations import records

    return filled(text, records.figure)


def cheat_sheet(plain: bool = False) -> Table:
    """Return eight concepts, each with a short summary and a result measured in this course.

    Args:
        plain: equations in letters of a keyboard, else as formulas of TeX.
    """
    rows = []
    for row in data("cheat_sheet")["row"]:
        message = _filled_in(f"{row['says']} {row['measured']}")
        # On paper there is room for one page only; a page names the symbols as well.
        equation = row["plain"] if plain else f"${row['equation']}$<br>{row['symbols']}"
        papers = (short(row["classic"]), short(row["modern"]))
        rows.append((row["concept"], message, equation, row["tool"], *papers))
    head = ("Concept", "Thirty seconds", "Equation", "Tool", "Classic paper", "Modern paper")
    return Table("Cheat sheet", head, tuple(rows))


def classical_or_learned() -> Table:
    """Return five components, and where the learned one overtook the classical one."""
    keys = ("name", "classical", "learned", "when")
    parts = data("cheat_sheet")["component"]
    rows = tuple(tuple(_filled_in(part[key]) for key in keys) for part in parts)
    return Table(
        "Classical or learned",
        ("Component", "Classical", "Learned", "When the learned one wins"),
        rows,
    )


def _numbered(place: str) -> str:
    """Return "contact: 9 · Frontier" as "chapter 2, section 9 · Frontier"."""
    topic, heading = place.split(": ", 1)
    (number,) = (chapter.number for chapter in CHAPTERS if chapter.topic == topic)
    section = "section " if heading[0].isdecimal() else ""
    return f"chapter {number}, {section}{heading}"


def reading() -> Table:
    """Return the book, the papers and the repositories, with their content and their chapters."""
    rows = []
    for kind in ("book", "paper", "repository"):
        for entry in data("reading")[kind]:
            result = work(entry["work"])
            named = f"{entry['name']}: " if "name" in entry else ""
            cited = named + ", ".join(str(result[k]) for k in ("authors", "title", "year", "venue"))
            serves = "; ".join(_numbered(place) for place in entry["serves"])
            address = f"github.com/{entry['name']}" if kind == "repository" else link(entry["work"])
            rows.append((cited, address, entry["says"], serves))
    return Table("Reading", ("What", "Link", "It says", "Where in this course"), tuple(rows))


def not_taught() -> Table:
    """Return topics that the course does not teach, and what each is about."""
    rows = tuple((entry["title"], entry["adds"]) for entry in data("reading")["lesson"])
    return Table("Topics that this course does not teach", ("Topic", "What it is about"), rows)


def page() -> str:
    """Return the cheat sheet as one page to print, A4 on its side."""
    style = (
        "@page { size: A4 landscape; margin: 7mm } body { font: 7.4pt/1.22 sans-serif; margin: 0 } "
        "table { border-collapse: collapse; width: 100% } caption { font-weight: bold } "
        "td, th { border: 0.3pt solid #888; padding: 1.5pt 3pt; vertical-align: top; "
        "text-align: left } td:first-child { font-weight: bold; width: 9% } "
        "td:nth-child(2) { width: 50% } td:nth-child(3) { font-family: monospace; width: 15% }"
    )
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>Cheat sheet</title>'
        f"<style>{style}</style></head><body>\n{cheat_sheet(plain=True).html()}\n</body></html>\n"
    )


def quoted() -> dict[str, float | str]:
    """Return what the tables take from charts and estimates, by field, as it is now."""
    texts = [
        str(v)
        for kind in ("row", "component")
        for e in data("cheat_sheet")[kind]
        for v in e.values()
    ]
    result = {(m[1], m[2]) for text in texts for m in FIELD.finditer(text)}
    read = {"chart": chart, "estimate": estimate}
    return {f"{a}.{b}": read[a](b) for a, b in sorted(result) if a in read}


def record() -> str:
    """Return the text of `quoted.toml`: a value that changes shows in a diff, and in a test."""
    head = "# Written by `python -m course.interview.tables --record`; reviewed as a diff."
    rows = [
        f'"{key}" = ' + (f'"{result}"' if isinstance(result, str) else f"{result:.6g}")
        for key, result in quoted().items()
    ]
    return "\n".join([head, *rows]) + "\n"


TABLES: tuple[Callable[[], Table], ...] = (
    functools.partial(cheat_sheet, plain=True),
    classical_or_learned,
    reading,
    not_taught,
)


def main(arguments: list[str]) -> None:
    """Print the tables, or the page, or write the record."""
    if arguments == ["--record"]:
        RECORD.write_text(record(), encoding="utf-8")
    elif arguments == ["--page"]:
        print(page())
    elif arguments:
        raise invalid("argument", " ".join(arguments), "--page, --record or none")
    else:
        print("\n\n".join(table().text() for table in TABLES))


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
        sys.stdout.flush()
    except BrokenPipeError:  # the reader has seen enough; the rest goes nowhere
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
