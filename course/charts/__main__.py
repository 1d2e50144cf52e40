"""`python -m course.charts [name ...]`: rebuild the charts and print their key figures."""

import os
import time

import click

from course.charts import CHARTS, FOLDER, PICTURES, load, make, redraw

load()


@click.command()
@click.argument("names", nargs=-1, type=click.Choice(sorted(CHARTS)))
@click.option("--redraw", "only", is_flag=True, help="Draw from the data; measure nothing.")
def main(names: tuple[str, ...], only: bool) -> None:
    """Rebuild the named charts, or all of them."""
    import matplotlib

    if not PICTURES.is_dir():
        raise click.UsageError(f"there is no {PICTURES}: charts are built in the project's tree")
    matplotlib.use("Agg")
    os.environ.setdefault("COURSE_QUIET", "1")
    drawn = [name for name in CHARTS if (FOLDER / f"{name}.json").is_file()]
    for name in names or (drawn if only else CHARTS):
        if only:
            redraw(name)
            continue
        start = time.perf_counter()
        text = make(name)
        click.echo(f"== {name} ({time.perf_counter() - start:.0f} s)\n{text}\n")
    click.echo(f"pictures: {PICTURES}" if only else f"data: {FOLDER}; pictures: {PICTURES}")


if __name__ == "__main__":
    main()
