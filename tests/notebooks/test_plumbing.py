"""Code that only fetches, shows or draws is hidden; code that teaches is not."""

import jupytext
import nbformat
import pytest

from course.site.notebooks import without_kernel
from tools import notebooks, plumbing
from tools.plumbing import HIDDEN, SHOWN, TYPED_INTO

DRAWS = """figure_, axes = plt.subplots()
_ = axes.plot(x, y)
_ = axes.set(xlabel="time [s]")
plt.show()"""


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("import numpy as np\n\nfrom course.cards import predict\n\npredict('a')", HIDDEN),
        ("import numpy as np", HIDDEN),
        ('show("a")', HIDDEN),
        ('more_claims("a", "b")', HIDDEN),
        ('simulation("touch", "Pull")', HIDDEN),
        ('cards.figures(read("chart"), "row")', HIDDEN),
        ('rows = read("chart").replace("a", "b")\nfigures(rows, "row")', HIDDEN),
        ('names = ("a", "b")\nfigures(read("chart"), *(f"row {n}" for n in names))', HIDDEN),
        ('print(read("chart"))', HIDDEN),
        ("badges(2)", HIDDEN),
        ('card("sweep")', HIDDEN),
        ('interview("contact")', HIDDEN),
        (DRAWS, HIDDEN),
        (f"speed = run(0.1)\nx, y = speed\n{DRAWS}", HIDDEN),
        ('answer("a", "2/omega")', TYPED_INTO),
        ('checkpoint("contact", a="")', TYPED_INTO),
        (f"position = 0.5  # change me\n{DRAWS}", TYPED_INTO),
        ("hit = contact.time_of_impact(a, b)\nprint(hit.time)", SHOWN),
        ("for k in (1, 2):\n    print(k)", SHOWN),
        ('MJCF = """<mujoco/>"""', SHOWN),
        ("def step(x, v):\n    return x + v, v", SHOWN),
        ("def step(x, v):\n    ...\n\n\ncheck(step)", SHOWN),
        ("check(step)", SHOWN),
        (f"a = one()\nb = two()\nc = three()\nd = four()\ne = five()\n{DRAWS}", SHOWN),
        ("%timeit f()", SHOWN),
        ("", SHOWN),
    ],
)
def test_what_becomes_of_a_cell(source: str, expected: str) -> None:
    assert plumbing.kind(source) == expected


def test_a_tag_decides_against_the_code() -> None:
    assert plumbing.kind('show("a")', ["show-code"]) == SHOWN
    assert plumbing.kind("x = f()", ["hide-code"]) == HIDDEN
    with pytest.raises(ValueError, match="got both"):
        plumbing.kind("x = f()", ["hide-code", "show-code"])


def test_the_display_functions_of_a_notebook_are_found_and_exercises_are_none() -> None:
    sources = [
        "def source(*f):\n    return Markdown(text(f))",
        "def outline(axes, x):\n    axes.plot(x)",
        "def rows(chart):\n    print(read(chart))",
        "def step(x):\n    return x + 1",
        "def talks(x):\n    print(x)",
        "check(talks)",
    ]
    assert plumbing.helpers(sources) == {"source", "outline", "rows"}
    known = plumbing.helpers(sources)
    assert plumbing.kind("source(step)", known=known) == HIDDEN
    assert plumbing.kind("step(1)", known=known) == SHOWN
    assert plumbing.kind(sources[0], known=known) == HIDDEN


def test_a_notebook_hides_in_jupyterlab_and_removes_from_the_site() -> None:
    text = '# %%\nshow("a")\n\n# %% tags=["x"]\nanswer("a", "")\n\n# %%\nf(1)\n'
    cells = jupytext.reads(text, fmt="py:percent").cells
    plumbing.mark(cells)
    assert cells[0].metadata["jupyter"] == {"source_hidden": True}
    assert [cell.metadata.get("tags", []) for cell in cells] == [
        ["remove-input"],
        ["x", "remove-input"],
        [],
    ]
    assert not any("jupyter" in cell.metadata for cell in cells[1:])


@pytest.mark.parametrize("source", notebooks.sources(), ids=lambda path: path.stem)
def test_what_is_built_shows_no_plumbing(source) -> None:
    """A cell whose only call shows a card or a simulation has no code on the page."""
    cells = nbformat.read(notebooks.target(source), as_version=4).cells
    for cell in cells:
        if cell.cell_type == "code" and cell.source.startswith(("show(", "predict(", "simulation")):
            assert "remove-input" in cell.metadata.tags
            assert cell.metadata.jupyter.source_hidden


def test_the_site_drops_what_only_a_kernel_can_do() -> None:
    text = (
        'Answer first; <span class="kernel-only">run the cells,\nthen</span> press *Play*.\n\n'
        '<div class="kernel-only">\n\nChange the text:\n\n</div>\n\nIt stays.'
    )
    assert without_kernel(text) == "Answer first; press *Play*.\n\n\n\nIt stays."
