"""The builder of the notebooks, and the notebooks that it built."""

import base64
import io
import sys
from pathlib import Path

import nbformat
import numpy as np
import pytest
from PIL import Image

from course import DIMENSIONS
from course.simulations import painter
from tools import notebooks

SOURCE = '''# %% [markdown]
# # A notebook of three cells

# %%
import os
import sys


class Canvas:
    """Offers a live view, a picture and a text, as a widget does."""

    def __repr__(self):
        return "Canvas(320 x 240)"

    def _repr_mimebundle_(self, **options):
        # A new model for every run, as widgets have it.
        view = {"model_id": os.urandom(16).hex(), "version_major": 2, "version_minor": 0}
        return {
            "application/vnd.jupyter.widget-view+json": view,
            "image/png": b"the same picture every time",
            "text/plain": repr(self),
        }


Canvas()

# %% tags=["nbval-ignore-output"]
for part in ("one", "two", "three"):
    print(part, flush=True)
print(os.environ["COURSE_QUIET"], sys.executable == os.environ["EXPECTED_PYTHON"])

# %% [markdown]
# {{DIMENSIONS}}
# ![Rigid body simulator: bouncing box](attachment:rigid_body.bouncing_box.png)

# %%
Canvas()
'''


def put(folder: Path, text: str) -> Path:
    (folder / "source").mkdir(exist_ok=True)
    source = folder / "source" / "07_example.py"
    source.write_text(text, encoding="utf-8")
    return source


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, bytes, bytes]:
    """The source, and the bytes of two builds of it."""
    folder = tmp_path_factory.mktemp("notebooks")
    source = put(folder, SOURCE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("EXPECTED_PYTHON", sys.executable)
        patch.setattr(painter, "film", lambda model: model.title.encode())
        builds = [notebooks.build(source).read_bytes() for _ in range(2)]
    assert sorted(path.name for path in folder.iterdir()) == [
        "07_example.ipynb",
        "settings.json",
        "source",
    ]
    return SOURCE, builds[0], builds[1]


@pytest.fixture
def example(built: tuple[str, bytes, bytes], tmp_path: Path) -> Path:
    """A source with its notebook beside it; returns the source."""
    source = put(tmp_path, built[0])
    notebooks.target(source).write_bytes(built[1])
    return source


def edit(source: Path, change) -> None:
    path = notebooks.target(source)
    notebook = nbformat.read(path, as_version=4)
    change(notebook)
    nbformat.write(notebook, path)


@pytest.mark.slow
def test_every_notebook_of_the_course_was_built_from_its_source() -> None:
    assert notebooks.sources()
    assert notebooks.check_all() == []


@pytest.mark.slow
def test_two_builds_are_the_same_to_the_byte(built: tuple[str, bytes, bytes]) -> None:
    assert built[1] == built[2]


def test_a_fresh_build_has_no_fault(example: Path) -> None:
    assert notebooks.check(example) == []
    assert notebooks.check_all(example.parent.parent) == []


def test_what_is_kept_of_an_output(example: Path) -> None:
    notebook = nbformat.read(notebooks.target(example), as_version=4)
    assert set(notebook.metadata) == {"kernelspec"}
    title, canvas, printed, text, live = notebook.cells
    assert title.source == "# A notebook of three cells"
    assert set(canvas.outputs[0].data) == {"image/png", "text/plain"}
    assert printed.outputs[0].text == "one\ntwo\nthree\n1 True\n"
    assert printed.metadata == {"tags": ["nbval-ignore-output"]}
    assert [cell.execution_count for cell in (canvas, printed, live)] == [1, 2, 3]
    # A film stands in the text, so the picture of the widget below it is not kept.
    (film,) = text.attachments.values()
    assert base64.b64decode(film["image/png"]) == b"Rigid body simulator: bouncing box"
    assert text.source.startswith(str(DIMENSIONS))
    assert set(live.outputs[0].data) == {"text/plain"}


def test_the_cell_ids_depend_on_place_and_text_only(example: Path) -> None:
    before = [cell.id for cell in notebooks.read_source(example).cells]
    assert len(set(before)) == 5
    example.write_text(SOURCE.replace("three cells", "3 cells"), encoding="utf-8")
    after = [cell.id for cell in notebooks.read_source(example).cells]
    assert after[0] != before[0]
    assert after[1:] == before[1:]


def test_a_changed_source_is_a_fault(example: Path) -> None:
    example.write_text(SOURCE.replace('"two"', '"zwei"'), encoding="utf-8")
    assert any("cell 2: its source differs" in fault for fault in notebooks.check(example))


def test_a_changed_tag_is_a_fault(example: Path) -> None:
    example.write_text(SOURCE.replace("nbval-ignore-output", "skip"), encoding="utf-8")
    assert any("cell 2: its metadata differs" in fault for fault in notebooks.check(example))


def test_a_missing_film_is_a_fault(example: Path) -> None:
    edit(example, lambda notebook: notebook.cells[3].pop("attachments"))
    assert any("cell 3: its films" in fault for fault in notebooks.check(example))


def test_a_film_has_the_title_by_which_the_live_picture_finds_it() -> None:
    with pytest.raises(ValueError, match=r"title of a film must be .*, got 'A box'"):
        notebooks.films("![A box](attachment:rigid_body.bouncing_box.png)")


def test_an_added_cell_is_a_fault(example: Path) -> None:
    example.write_text(SOURCE + "\n# %%\n1 + 1\n", encoding="utf-8")
    assert any("has 5 cells, its source has 6" in fault for fault in notebooks.check(example))


def test_a_cell_that_was_not_run_is_a_fault(example: Path) -> None:
    edit(example, lambda notebook: notebook.cells[1].update(execution_count=None, outputs=[]))
    assert any("cell 1: run as None" in fault for fault in notebooks.check(example))


def test_cells_run_out_of_order_are_a_fault(example: Path) -> None:
    edit(example, lambda notebook: notebook.cells[2].update(execution_count=7))
    assert any("cell 2: run as 7, expected 2" in fault for fault in notebooks.check(example))


def test_a_shown_error_is_a_fault_unless_it_is_meant(example: Path) -> None:
    error = nbformat.v4.new_output("error", ename="ValueError", evalue="no", traceback=[])
    edit(example, lambda notebook: notebook.cells[1].outputs.append(error))
    assert any("shows the error ValueError" in fault for fault in notebooks.check(example))

    intended = SOURCE.replace("# %%\nimport", '# %% tags=["raises-exception"]\nimport')
    example.write_text(intended, encoding="utf-8")
    tags = {"tags": ["raises-exception"]}
    edit(example, lambda notebook: notebook.cells[1].update(metadata=tags))
    assert not any("error" in fault for fault in notebooks.check(example))


def test_a_memory_address_is_a_fault(example: Path) -> None:
    def show_address(notebook) -> None:
        notebook.cells[1].outputs[0].data["text/plain"] = "<Canvas object at 0x7f3c1a2b4d50>"

    edit(example, show_address)
    assert any("memory address" in fault for fault in notebooks.check(example))


def test_saved_widget_state_is_a_fault(example: Path) -> None:
    edit(example, lambda notebook: notebook.metadata.update(widgets={}))
    assert any("metadata" in fault for fault in notebooks.check(example))


def test_missing_and_stray_notebooks_are_faults(example: Path) -> None:
    path = notebooks.target(example)
    path.rename(path.with_name("08_other.ipynb"))
    faults = notebooks.check_all(path.parent)
    assert any("07_example.ipynb is missing" in fault for fault in faults)
    assert any("08_other.ipynb has no source" in fault for fault in faults)


@pytest.mark.slow
def test_a_source_that_fails_leaves_the_old_notebook(example: Path) -> None:
    path = notebooks.target(example)
    before = path.read_bytes()
    example.write_text("# %%\n1 / 0\n", encoding="utf-8")
    with pytest.raises(notebooks.nbclient.exceptions.CellExecutionError, match="ZeroDivision"):
        notebooks.build(example)
    assert path.read_bytes() == before
    assert sorted(result.name for result in path.parent.iterdir()) == [path.name, "source"]


def test_a_picture_is_kept_in_few_colours_and_stays_the_same_picture() -> None:
    rng = np.random.default_rng(0)
    blurred = np.repeat(np.repeat(rng.integers(0, 255, (20, 20, 3)), 8, 0), 8, 1).astype("uint8")
    blurred[:80] //= 2
    raw = io.BytesIO()
    Image.fromarray(blurred).save(raw, "PNG", compress_level=0)
    png = base64.b64encode(raw.getvalue()).decode()
    small = notebooks.smaller(png)
    assert len(small) < 0.5 * len(png)
    retained = np.asarray(Image.open(io.BytesIO(base64.b64decode(small))).convert("RGB")).astype(
        int
    )
    assert retained.shape == blurred.shape and np.abs(retained - blurred).mean() < 8


def test_a_rare_colour_is_not_given_to_its_neighbour() -> None:
    """The name of a curve has few pixels, and its colour says which curve it names."""
    rng = np.random.default_rng(0)
    drawn = np.full((200, 200, 3), 255, dtype=np.uint8)
    # Blended edges of many orange letters, and a few amber pixels.
    shares = rng.uniform(0.0, 1.0, (100, 200, 1))
    drawn[:100] = (1.0 - shares) * 255 + shares * rng.normal((170, 75, 0), 3.0, (100, 200, 3))
    amber = np.array([184, 127, 0])
    drawn[150, :12] = amber
    raw = io.BytesIO()
    Image.fromarray(drawn).save(raw, "PNG", compress_level=0)
    small = notebooks.smaller(base64.b64encode(raw.getvalue()).decode())
    retained = np.asarray(Image.open(io.BytesIO(base64.b64decode(small))).convert("RGB"))
    assert np.abs(retained[150, :12].astype(int) - amber).max() < 16


def test_an_animated_picture_retains_all_its_frames() -> None:
    rng = np.random.default_rng(0)
    frames = [Image.fromarray(rng.integers(0, 255, (9, 9, 3), dtype=np.uint8)) for _ in range(3)]
    raw = io.BytesIO()
    frames[0].save(raw, "PNG", save_all=True, append_images=frames[1:], duration=50, loop=0)
    png = base64.b64encode(raw.getvalue()).decode()
    built = Image.open(io.BytesIO(base64.b64decode(notebooks.smaller(png))))
    assert getattr(built, "n_frames", 1) == 3
