"""Every module compiled anew, and every end of every slider by itself."""

import numpy as np
import pytest

from course.site import compiler, wasm
from tests.site.host import Hosted
from tests.site.same import MINUTES, assert_same_run

LIVE = wasm.live()
DATA = 11  # section of a module with its constants, such as a grid of frequencies


def _sections(module: bytes) -> list[tuple[int, bytes]]:
    """Return the sections of a WebAssembly module: kind, content."""
    sections, at = [], 8
    while at < len(module):
        kind, at, size, shift = module[at], at + 1, 0, 0
        while True:
            byte, at = module[at], at + 1
            size |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                break
        sections.append((kind, module[at : at + size]))
        at += size
    return sections


def _assert_same_constants(first: bytes, second: bytes) -> None:
    """Check that constants are equal, but for the last digits of a double (1024 units).

    NumPy computes powers and exponentials with the instructions of the machine that compiles. That
    changed the constants of five modules, by up to 60 units in the last place.
    """
    assert len(first) == len(second)
    at = 0
    while at < len(first):
        if first[at] != second[at]:
            bits = [int.from_bytes(data[at : at + 8], "little") for data in (first, second)]
            assert abs(bits[0] - bits[1]) <= 1024, at
            at += 8
        else:
            at += 1


@pytest.mark.parametrize("name", LIVE)
def test_the_same_sources_give_the_same_bytes(name: str) -> None:
    report = wasm.read_sources(wasm.file_of(name).read_bytes())
    tools = {"numba": wasm.numba.__version__, "llvmlite": wasm.llvmlite.__version__}
    if {each: report[each] for each in tools} != tools or report["linker"] != compiler.linker()[1]:
        pytest.skip(f"made with {report}")
    here, stored = _sections(wasm.rebuilt(name)), _sections(wasm.file_of(name).read_bytes())
    assert [kind for kind, _ in here] == [kind for kind, _ in stored]
    for (kind, new), (_, old) in zip(here, stored, strict=True):
        if kind == DATA:
            _assert_same_constants(new, old)
        else:
            assert new == old, kind


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
