"""Every module compiled anew, and every end of every slider by itself."""

import numpy as np
import pytest

from course.site import compiler, wasm
from tests.site.host import Hosted
from tests.site.same import MINUTES, assert_same_run

LIVE = wasm.live()


@pytest.mark.parametrize("name", LIVE)
def test_the_same_sources_give_the_same_bytes(name: str) -> None:
    report = wasm.read_sources(wasm.file_of(name).read_bytes())
    here = {"numba": wasm.numba.__version__, "llvmlite": wasm.llvmlite.__version__}
    if {each: report[each] for each in here} != here or report["linker"] != compiler.linker()[1]:
        pytest.skip(f"made with {report}")
    assert wasm.rebuilt(name) == wasm.file_of(name).read_bytes()


# The others run in a browser with each end and each preset: tests/site/player/test_browser.py.
@pytest.mark.parametrize("name", [name for name in LIVE if name not in MINUTES])
def test_each_end_of_each_slider_and_each_preset_for_longer(name: str) -> None:
    model = wasm.model(name)
    module = Hosted(model, wasm.file_of(name))
    runs = [dict(preset.values) for preset in model.presets.values()]
    runs += [{key: end} for key, field in model.controls.panel() for end in field.ends]
    for values in runs:
        assert_same_run(model, module, values, (0.04, 0.96, 2.0))


def test_random_boxes_are_the_same_box() -> None:
    """Flight, impacts and rest of 200 boxes: every state equal to the bit after three seconds."""
    name = "rigid_body.bouncing_box"
    model = wasm.model(name)
    module = Hosted(model, wasm.file_of(name))
    rng = np.random.default_rng(21)
    for _ in range(200):
        start = np.array([0.0, rng.uniform(1.0, 4.0), *rng.normal(size=4)])
        values = {
            "gravity": rng.uniform(0.0, 20.0),
            "restitution": rng.uniform(0.0, 1.0),
            "friction": rng.uniform(0.0, 2.0),
            "start": start,
        }
        worst = assert_same_run(model, module, values, (3.0,))
        assert worst < 1e-9
