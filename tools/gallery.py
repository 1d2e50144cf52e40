"""The gallery of charts and the moving picture of the README: `python -m tools.gallery`.

The gallery, `docs/charts/README.md`, shows every chart of the course with what it says and its key
figures; the film, `docs/film.png`, is a simulation of the course, recorded from its model;
`docs/robot.png`, on the home page, is a task of `drills robot` with the course's parts. The
README's first link is the site's address, which a fork sets in pyproject.toml.
"""

import json
import re
import tomllib
from pathlib import Path

import click

from course import CHAPTERS, charts
from course.charts import write
from tools import settings

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
FILM = ROOT / "docs" / "film.png"
ROBOT = ROOT / "docs" / "robot.png"
GALLERY = charts.PICTURES / "README.md"

HEAD = """# The charts of the course

`make charts` measures everything anew and writes the pictures, this page and, into
[course/charts/data](../../course/charts/data), their data (`NAME.json`) and key figures
(`NAME.txt`).

In a work-precision diagram each point is one method with one setting: the error against an
independent truth upwards, the cost to the right; lower left is better. A cross at the top edge is a
run that failed. Where a setting is a step, the cross stands above what these steps cost; elsewhere
its place along the edge means nothing. The circle is the cheapest run within the tolerance. An
error in the grey band is no larger than the error of the reference, so it says nothing about the
method. Dashed curves with hollow marks are another library on the same problem in the same run. A
picture shows six curves; the others, named under it, are in its data.

*As shipped* means with the default settings of a library. *Fair* means with settings that make the
engines solve the same problem (chapter 3).
"""


def caption(name: str) -> str:
    """Return what a chart shows, in a sentence.

    It comes from the chart's experiment, or is the question on the picture.
    """
    sentence = (charts.CHARTS[name][0].__doc__ or "").strip().partition("\n")[0]
    # The docstring of a function begins with a verb; a caption begins with its subject.
    if sentence.startswith("Chart "):
        sentence = sentence[6].upper() + sentence[7:]
    if not sentence:
        data = json.loads((charts.FOLDER / f"{name}.json").read_text(encoding="utf-8"))
        sentence = str(data["question"] if "question" in data else data["panels"][0]["title"])
    return sentence


def topic(name: str) -> str:
    """Return the file or folder of `course.charts` that a chart is in."""
    return charts.CHARTS[name][0].__module__.split(".")[2]


def place(name: str) -> tuple[str, int]:
    """Return where a chart is written, which orders the page however its modules were imported."""
    experiment = charts.CHARTS[name][0]
    return experiment.__module__, experiment.__code__.co_firstlineno


def gallery() -> str:
    """Return the page, in Markdown."""
    charts.load()
    titles = {chapter.topic: f"{chapter.number} · {chapter.title}" for chapter in CHAPTERS}
    titles["vector_env"] = "Many environments stepped as one"
    parts = [HEAD]
    in_order = sorted(charts.CHARTS, key=place)
    for room, title in titles.items():
        names = [name for name in in_order if topic(name) == room]
        parts += [f"## {title}\n"] if names else []
        for name in names:
            drawn = (charts.PICTURES / f"{name}.png").is_file()
            parts.append(f"### {name}\n\n{caption(name)}\n")
            parts += [f"![{name}]({name}.png)\n"] if drawn else []
            figures = charts.read(name)
            parts.append(
                f"<details><summary>Key figures</summary>\n\n```\n{figures}\n```\n\n</details>\n"
            )
    return "\n".join(parts)


def readme_film() -> bytes:
    """Return the film of the README, recorded from the model as it is now."""
    from course.simulations.painter import film
    from course.simulations.rigid_body import MODEL

    return film(MODEL, seconds=5.0)


def robot_picture(path: Path) -> None:
    """Write the picture of the home page: the course's robot at its first task of level 5."""
    from drills.robot import film
    from drills.robot.holders import course_part
    from drills.robot.levels import level
    from drills.robot.play import play
    from drills.robot.slots import NAMES

    parts = [course_part(name) for name in NAMES]
    played = play(parts, level(5), 1, filmed=frozenset({0}))
    film.still(played, level(5), 0, 0, path)


def readme() -> str:
    """Return the README with the site's address, its first link, as pyproject.toml says it."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    address = settings["project"]["urls"]["Documentation"]
    text = README.read_text(encoding="utf-8")
    return re.sub(r"(?<=\]\()https://[^)]*(?=\))", lambda _: address, text, count=1)


@click.command()
def main() -> None:
    """Write the gallery, the film, and the site's address in the README."""
    write(README, readme())
    write(GALLERY, gallery())
    write(FILM, lambda path: path.write_bytes(readme_film()))
    settings.store(settings.README, settings.of_readme())
    write(ROBOT, robot_picture)
    click.echo(
        f"written: the README's link, {GALLERY.relative_to(ROOT)}, {FILM.name} and {ROBOT.name}"
    )


if __name__ == "__main__":
    main()
