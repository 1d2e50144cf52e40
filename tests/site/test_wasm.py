"""Every live simulation's module: made from these sources, and the same numbers as Python's."""

import gzip
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

from course.simulations import pen as draw
from course.simulations.model import Experiment
from course.simulations.rigid_body import spring
from course.site import compiler, wasm
from tests.budget import PROVE, ROOT, examples
from tests.site.host import Hosted, array
from tests.site.same import MINUTES, any_controls, assert_same_run, ends

pytestmark = pytest.mark.slow


LIVE = wasm.live()
# A start of these takes seconds, in plain Python or in a host that calls back for every sine.
EXPENSIVE = {"control.joint", "control.probe", *MINUTES}
# Compiled anew by the tests, and the constant that one of them changes.
SMALL, CONSTANT, OTHER = "role.development", "tries * real / 86_400.0", "tries * real / 80_000.0"


def hosted(name: str) -> Hosted:
    return Hosted(wasm.model(name), wasm.file_of(name))


@pytest.mark.parametrize("name", LIVE)
def test_a_module_is_made_from_the_sources_as_they_are(name: str) -> None:
    assert not wasm.stale(name), f"run `python -m course.site.wasm {name}`"
    module = wasm.file_of(name).read_bytes()
    assert len(gzip.compress(module)) <= wasm.largest(name)
    assert set(compiler.imports(module)) <= compiler.MATHS
    has = {"memory", "__heap_base", *wasm.signatures(wasm.model(name))}
    assert hosted(name).exports.keys() == has
    assert wasm.read_sources(module).keys() == {
        "fingerprint",
        "numba",
        "llvmlite",
        "python",
        "linker",
    }
    assert b".py" not in module  # no place on the machine that made it


@pytest.mark.prove
def test_no_module_is_stale_on_another_cpu() -> None:
    """Constants that are computed on import differ in their last digits there."""
    code = "from course.site import wasm; print([name for name in wasm.live() if wasm.stale(name)])"
    command = [sys.executable, "-m", "tools.cpus", "farthest", "--", sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "[]\n"


@pytest.mark.parametrize(("change", "counts"), [(1e-15, False), (-1e-15, False), (1e-10, True)])
def test_the_last_digits_of_a_constant_do_not_count(
    change: float, counts: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = wasm.model("rigid_body.spring")
    before, limits = wasm.fingerprint(model), spring._LIMITS
    monkeypatch.setattr(spring, "_LIMITS", limits * (1.0 + change))
    assert (wasm.fingerprint(model) != before) is counts


@pytest.mark.parametrize("name", ["perception", "rigid_body.spring", "kinematics.arm", "interview"])
def test_a_module_is_not_stale_because_its_model_has_run(name: str) -> None:
    """What a run leaves behind, such as a time, is no constant of the module."""
    model = wasm.model(name)
    before = wasm.fingerprint(model)
    experiment = Experiment(model)
    experiment.advance(0.1)
    experiment.picture()
    assert wasm.fingerprint(model) == before


def test_a_recorded_simulation_has_no_module() -> None:
    retained = {path for path in wasm.SIMULATIONS.rglob("*.wasm")}
    assert retained == {wasm.file_of(name) for name in LIVE}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(x, marks=pytest.mark.prove) if x in MINUTES or k % 2 else x
        for k, x in enumerate(LIVE)
    ],
)
def test_it_computes_what_python_does(name: str) -> None:
    """Presets, ends of sliders (in the long tier all), and controls within the limits.

    Of some only the first preset: all of theirs run in a browser, in tests/site/player.
    """
    model, module = wasm.model(name), hosted(name)
    presets = [dict(preset.values) for preset in model.presets.values()]
    largest = 1 if name in EXPENSIVE else None if PROVE else 2
    for values in presets[:largest]:
        assert_same_run(model, module, values, (1.0,))
    if name in MINUTES:
        return
    for values in list(ends(model))[:largest]:
        assert_same_run(model, module, values, (1.0,))

    @(examples(1) if name not in EXPENSIVE else settings(max_examples=1))
    @given(any_controls(model))
    def within(values: dict[str, Any]) -> None:
        assert_same_run(model, module, values, (0.3, 0.7))

    within()


@pytest.mark.prove
@pytest.mark.parametrize("name", LIVE)
def test_a_full_pen_is_an_error_and_nothing_is_written_past_its_end(name: str) -> None:
    model, module = wasm.model(name), hosted(name)
    run = Experiment(model)
    need = draw.HEADER + run.picture().data.size
    state, controls = (module.places[each.dtype] for each in (model.state, model.controls))
    place = module.places[np.dtype(float)]
    module.write(state, run.state.tobytes())
    module.write(controls, run.controls.tobytes())
    for room in (0, 5, need // 3, need // 2, need - draw.HEADER - 1):
        pen, spare = np.zeros(draw.HEADER + room), np.full(8, 1e300)
        draw.clear(pen)
        with pytest.raises(ValueError) as plain:
            model.frame(pen.copy(), run.state, run.controls)
        module.write(place, pen.tobytes() + spare.tobytes())
        with pytest.raises(ValueError, match=f"^{re.escape(str(plain.value))}$"):
            module.call("frame", *array(place, pen), state, controls)
        assert module.read(place + pen.nbytes, spare.nbytes) == spare.tobytes()


# --- Compiled anew --------------------------------------------------------------------------------


@pytest.mark.prove
def test_the_same_sources_give_the_same_bytes() -> None:
    report = wasm.read_sources(wasm.file_of(SMALL).read_bytes())
    here = {"numba": wasm.numba.__version__, "llvmlite": wasm.llvmlite.__version__}
    here["linker"] = compiler.linker()[1]
    here["python"] = f"{sys.version_info.major}.{sys.version_info.minor}"
    if {name: report.get(name) for name in here} != here:
        pytest.skip(f"made with {report}, here is {here}")
    assert wasm.rebuilt(SMALL) == wasm.file_of(SMALL).read_bytes()


@pytest.mark.prove
def test_a_constant_of_the_source_changes_the_module_and_its_picture(tmp_path: Path) -> None:
    """In a copy elsewhere; Python with the changed source is the judge of the new picture."""
    away = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "course", tmp_path / "course", ignore=away)
    shutil.copytree(ROOT / "tests", tmp_path / "tests", ignore=away)
    # A simulation reads the insights of the exercises.
    shutil.copytree(ROOT / "drills" / "catalogue", tmp_path / "drills" / "catalogue", ignore=away)
    source = tmp_path.joinpath("course", "simulations", *SMALL.split(".")).with_suffix(".py")
    text = source.read_text(encoding="utf-8")
    assert text.count(CONSTANT) == 1
    source.write_text(text.replace(CONSTANT, OTHER), encoding="utf-8")
    code = (
        "from course.site import wasm; from tests.site.host import Hosted\n"
        "from course.simulations.model import Experiment\n"
        f"name = {SMALL!r}; model, path = wasm.model(name), wasm.file_of(name)\n"
        "assert wasm.stale(name)\n"
        "before = Experiment(Hosted(model, path)).picture()\n"
        "assert wasm.main([name]) == 0 and not wasm.stale(name)\n"
        "after, plain = Experiment(Hosted(model, path)).picture(), Experiment(model).picture()\n"
        "assert after.data.tobytes() != before.data.tobytes()\n"
        "assert abs(after.data - plain.data).max() < 1e-9\n"
    )
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert source.with_suffix(".wasm").read_bytes() != wasm.file_of(SMALL).read_bytes()
