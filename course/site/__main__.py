"""`python -m course.site` builds the folder `site/`."""

import gc
import sys
import time
from pathlib import Path

import click

from course.site import build


@click.command()
@click.option("-o", "target", type=click.Path(path_type=Path), default=build.TARGET)
@click.option("--work", type=click.Path(path_type=Path), default=build.WORK)
def main(target: Path, work: Path) -> None:
    """Build the static site from the committed notebooks, into TARGET, by way of WORK."""
    start = time.perf_counter()
    gc.disable()  # what a build makes stays until it ends
    try:
        build.build(target, work=work)
    except build.Unbuildable as problem:
        for fault in problem.faults:
            click.echo(fault, err=True)
        click.echo(f"the site cannot be built: {len(problem.faults)} reasons above", err=True)
        sys.exit(1)
    files = [path for path in target.rglob("*") if path.is_file()]
    size = sum(path.stat().st_size for path in files)
    largest = max(target.glob("*.html"), key=lambda path: path.stat().st_size)
    click.echo(
        f"{target.name}/: {len(list(target.glob('*.html')))} pages, {size / 1e6:.1f} MB; the "
        f"largest is {largest.name}, {largest.stat().st_size / 1e6:.1f} MB; "
        f"built in {time.perf_counter() - start:.0f} s"
    )
    click.echo("open site/index.html, or: python -m http.server -d site")


if __name__ == "__main__":
    main(prog_name="python -m course.site")
