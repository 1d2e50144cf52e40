"""The pictures of "The mathematics you need": `python -m tools.mathematics` draws them again."""

from collections.abc import Callable
from pathlib import Path

import click
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from course.charts import write_picture

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "mathematics"
MATRIX = np.array([[1.3, 0.6], [0.6, 0.7]])


def _axes(columns: int = 1, width: float = 6.0, height: float = 3.2) -> tuple[Figure, list[Axes]]:
    figure, axes = plt.subplots(
        1, columns, figsize=(width, height), layout="constrained", squeeze=False
    )
    return figure, list(axes[0])


def derivative() -> Figure:
    """Draw a curve, its tangent, and their difference against the step."""
    figure, (left, right) = _axes(2, 8.0)
    x = np.linspace(0.0, 1.6, 200)
    left.plot(x, np.exp(x), label="the function, $e^x$")
    left.plot(x, np.exp(0.5) * (1.0 + x - 0.5), label="its tangent at $x = 0.5$")
    left.plot([1.3, 1.3], [1.8 * np.exp(0.5), np.exp(1.3)], "k-", lw=2)
    left.annotate(
        "what the tangent\nleaves out", (1.3, 3.3), (0.55, 3.6), arrowprops={"arrowstyle": "->"}
    )
    left.set(xlabel="x", title="close to the point, the tangent will do")
    left.legend(loc="lower right")
    h = np.geomspace(0.01, 1.0, 30)
    right.loglog(h, np.exp(0.5) * (np.exp(h) - 1.0 - h), label="the difference")
    right.loglog(h, 0.5 * h**2 * np.exp(0.5), "k:", label="$h^2 f''/2$")
    right.set(xlabel="step h", ylabel="difference", title="a tenth of the step, a hundredth of it")
    right.legend()
    return figure


def eigenvalues() -> Figure:
    """Draw the unit circle, its image under a matrix, and the eigenvectors before and after."""
    figure, (axes,) = _axes(1, 5.2, 4.0)
    turn = np.linspace(0.0, 2.0 * np.pi, 300)
    circle = np.array([np.cos(turn), np.sin(turn)])
    axes.plot(*circle, color="0.6", label="vectors of length 1")
    axes.plot(*(MATRIX @ circle), label="what the matrix makes of them")
    values, vectors = np.linalg.eigh(MATRIX)
    for value, vector, colour in zip(values, vectors.T, ("tab:red", "tab:green"), strict=True):
        axes.plot(*np.outer(vector, [0.0, 1.0]), color=colour, lw=4, alpha=0.4)
        axes.annotate("", value * vector, (0.0, 0.0), arrowprops={"color": colour, "width": 1.5})
        axes.plot([], [], color=colour, label=f"an eigenvector, times {value:.2f}")
    axes.set(aspect="equal", xlim=(-1.8, 1.8), ylim=(-1.3, 2.3))
    axes.legend(loc="upper left", fontsize=9)
    return figure


def slopes() -> Figure:
    """Draw the field of slopes of x' = -x, the solution from 1, and Euler's polygon."""
    figure, (axes,) = _axes()
    t, x = np.meshgrid(np.linspace(0.0, 3.0, 16), np.linspace(0.05, 1.1, 9))
    axes.quiver(
        t, x, np.ones_like(x), -x, angles="xy", color="0.75", scale=28, width=0.003, headwidth=3
    )
    fine = np.linspace(0.0, 3.0, 200)
    axes.plot(fine, np.exp(-fine), lw=2, label="the solution, $e^{-t}$")
    steps = np.arange(7)
    axes.plot(0.5 * steps, 0.5**steps, "o-", color="tab:red", label="Euler, steps of 0.5 s")
    axes.set(xlabel="time t [s]", ylabel="x")
    axes.legend()
    return figure


def means() -> Figure:
    """Draw a histogram of single values, and one of means of 25."""
    figure, (axes,) = _axes()
    values = np.random.default_rng(0).normal(0.0, 1.0, (4000, 25))
    bins = np.linspace(-3.5, 3.5, 71).tolist()
    axes.hist(values[:, 0], bins, density=True, alpha=0.5, label="single values, $\\sigma = 1$")
    axes.hist(
        values.mean(axis=1), bins, density=True, alpha=0.6, label="means of 25, $\\sigma = 1/5$"
    )
    axes.set(xlabel="deviation from the mean", ylabel="density")
    axes.legend()
    return figure


def least_squares() -> Figure:
    """Draw a point, a plane, and the perpendicular from one to the other."""
    figure = plt.figure(figsize=(5.2, 3.6), layout="constrained")
    axes = figure.add_subplot(projection="3d")
    grid = np.meshgrid([-1.0, 1.4], [-1.0, 1.2])
    axes.plot_surface(*grid, np.zeros((2, 2)), alpha=0.25)
    foot, point = np.array([0.5, 0.3, 0.0]), np.array([0.5, 0.3, 1.0])
    axes.plot(*np.array([foot, point]).T, color="tab:red", lw=2)
    axes.scatter(*np.array([foot, point]).T, color="k")
    axes.text(0.58, 0.35, 1.0, "$b$")
    axes.text(0.6, 0.3, -0.16, "$Ax$, the nearest point")
    axes.text(0.58, 0.35, 0.5, "error $b - Ax$", color="tab:red")
    axes.text(-1.0, -0.95, 0.06, "all values of $Ax$")
    axes.set(xticks=[], yticks=[], zticks=[], zlim=(0.0, 1.1))
    axes.view_init(20, -65)
    axes.set_axis_off()
    return figure


PICTURES: dict[str, Callable[[], Figure]] = {
    draw.__name__: draw for draw in (derivative, eigenvalues, slopes, means, least_squares)
}


@click.command()
def main() -> None:
    """Draw every picture of the page."""
    for name, draw in PICTURES.items():
        figure = draw()
        write_picture(figure, FOLDER / f"{name}.png")
        plt.close(figure)
        click.echo(f"written: {name}.png")


if __name__ == "__main__":
    main()
