"""The table of contents as Markdown: for the index of the course and for the README."""

from pathlib import Path

from course import CHAPTERS


def map_of_chapters(folder: str = "") -> str:
    """Return every chapter with its question and its simulation.

    Args:
        folder: what to put before the name of a notebook in a link, such as "notebooks/".

    Returns:
        A Markdown table.
    """
    rows = ["| | chapter | what it answers | simulation |", "|---:|---|---|---|"]
    for chapter in CHAPTERS:
        # Links start from the notebooks' folder; `folder` leads there from elsewhere.
        name = chapter.notebook.removeprefix("notebooks/")
        coming = f"{chapter.title} (coming)"
        title = f"[{chapter.title}]({folder}{name})" if chapter.ready else coming
        rows.append(f"| {chapter.number} | {title} | {chapter.question} | {chapter.simulation} |")
    return "\n".join(rows) + "\n"


def neighbours(number: int) -> str:
    """Return the last line of a chapter's page.

    It links the previous chapter, the contents and the next chapter.

    Args:
        number: of the chapter.

    Returns:
        Markdown with links to notebooks of the same folder; only to chapters that are there.
    """
    # Chapters that are not written yet are skipped, so every link leads somewhere.
    other = [chapter for chapter in CHAPTERS if chapter.ready]
    before = [c for c in other if c.number < number][-1:]
    behind = [c for c in other if c.number > number][:1]
    links = [
        *(f"[← {c.number} · {c.title}]({Path(c.notebook).name})" for c in before),
        "[Contents](index.ipynb)",
        *(f"[{c.number} · {c.title} →]({Path(c.notebook).name})" for c in behind),
    ]
    return "\n".join(["---", "", " | ".join(links)])


def moving() -> str:
    """Return which simulations a page without a kernel moves, and which it shows as recorded.

    Returns:
        A sentence and a Markdown list.
    """
    # Imported here, since the other tables need no simulation.
    from course.simulations import declaration

    names = declaration.names()
    recorded = [name for name in names if name in declaration.RECORDED]
    others = "The others are" if len(recorded) > 1 else "The other one is"
    lines = [
        f"{len(names) - len(recorded)} of the {len(names)} simulations are *live* on the site: the "
        "page computes them while you move a slider.",
        f"{others} *recorded*, one short film for each preset:",
        "",
    ]
    for name in recorded:
        lines.append(f"- {declaration.model(name).title}: {declaration.RECORDED[name]}.")
    return "\n".join(lines)
