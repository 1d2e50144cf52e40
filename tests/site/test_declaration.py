"""What a page is told about a simulation is what the notebook's panel has."""

import base64
import gzip
import json
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from course import CHAPTERS
from course.simulations import declaration as told
from course.simulations.model import KEYS, Experiment
from course.site import films
from tests.simulations.models import WALK


@pytest.fixture(scope="module", autouse=True)
def anything_goes() -> Any:
    """Whatever is compiled today, everything can be declared."""
    patch = pytest.MonkeyPatch()
    for name in told.names():
        if name not in told.RECORDED and not told.module(name).exists():
            patch.setitem(told.RECORDED, name, "it is not compiled")
    yield
    patch.undo()


def record(runs: list[Any], dtype: np.dtype[Any]) -> Any:
    """A record from its runs of words."""
    words = [np.full(count, int(word), np.uint64) for count, word in runs]
    return np.frombuffer(np.concatenate(words).tobytes(), dtype)[0]


def strict(text: str) -> Any:
    def refuse(token: str) -> None:
        raise ValueError(token)

    return json.loads(text, parse_constant=refuse)


def test_every_chapter_has_simulations_in_its_order() -> None:
    chapters = [name.partition(".")[0] for name in told.names()]
    assert list(dict.fromkeys(chapters)) == [c.topic for c in CHAPTERS if c.ready]
    assert len(set(told.names())) == len(told.names())
    with pytest.raises(ValueError, match=r"rigid_body\.bouncing_box"):
        told.model("no such")


@pytest.mark.parametrize("name", told.names())
def test_a_declaration_is_what_the_model_declares(name: str, monkeypatch: Any) -> None:
    monkeypatch.setattr(Experiment, "start", lambda self: None)  # some take seconds
    model = told.model(name)
    made = strict(json.dumps(told.declaration(name), allow_nan=False))
    for key, declared in (("controls", model.controls), ("state", model.state)):
        assert made[key]["size"] == declared.dtype.itemsize
        assert record(made[key]["words"], declared.dtype).tobytes() == declared.new().tobytes()
    pen = model.paper.pen()
    assert made["pen"]["size"] == pen.size
    assert pen[: len(made["pen"]["header"])].tolist() == made["pen"]["header"]
    assert made["paper"]["words"] == model.paper.words.entries

    experiment = Experiment(model)
    assert [preset["name"] for preset in made["presets"]] == list(model.presets)
    for preset in made["presets"]:
        experiment.choose(preset["name"])
        controls = record(preset["words"], model.controls.dtype)
        assert controls.tobytes() == experiment.controls.tobytes()
        note, of_a_film = model.presets[preset["name"]].note, model.presets[preset["name"]].recorded
        assert preset["note"] == ((made["recorded"] and of_a_film) or note)
        # An input finds its value where it is told to look.
        for each in made["inputs"]:
            observed = np.frombuffer(controls.tobytes(), f"<{each['kind']}8", 1, each["offset"])
            assert observed[0] == experiment.controls[each["name"]]

    fields = dict(model.controls.panel())
    assert [each["name"] for each in made["inputs"]] == list(fields)
    for each in made["inputs"]:
        field = fields[each["name"]]
        assert (each["low"], each["high"]) == (field.ends[0], field.ends[-1])
        assert each["label"] == field.label and each["live"] == field.live
        assert (each["choices"], each["switch"]) == (list(field.choices), field.switch)
        assert (each["step"], each["unit"], each["decimals"]) == (
            field.step,
            field.unit,
            field.decimals,
        )
        # A slider gets to both ends: its steps divide the way between them.
        if field.step:
            steps = (field.high - field.low) / field.step
            assert abs(steps - round(steps)) < 1e-9, each["name"]
    has = {f for f in ("drag", "grab", "press", "complete") if getattr(model, f) is not None}
    assert set(made["functions"]) == {"initial", "advance", "frame"} | has
    assert made["keys"] == (list(KEYS) if model.press is not None else [])
    assert made["live_drag"] == model.live_drag
    # Where the number of remaining portions is, the record of the state has it.
    assert ("remaining" in made["state"]) == (model.complete is not None)
    if model.complete is not None:
        state = model.state.new()
        state["remaining"] = 1234567
        offset = made["state"]["remaining"]
        assert int.from_bytes(state.tobytes()[offset : offset + 8], "little") == 1234567


def test_one_that_is_neither_compiled_nor_recorded_is_refused(monkeypatch: Any) -> None:
    monkeypatch.setattr(told, "RECORDED", {})
    monkeypatch.setattr(told, "module", lambda name: told._HERE / "no.wasm")
    with pytest.raises(ValueError, match=r"course\.site\.wasm rigid_body\.top"):
        told.bundle("rigid_body.top")


def test_a_recording_shows_three_values_of_each_slider() -> None:
    for name in told.RECORDED:
        made = told.model(name)
        for key, field in made.controls.panel():
            if not field.choices and not field.switch:
                shown = {each.values.get(key, field.default) for each in made.presets.values()}
                assert len(shown) >= 3, f"{name}: {key} is only {sorted(shown)}"


def test_whoever_is_recorded_is_a_simulation_and_says_why() -> None:
    for name, why in told.RECORDED.items():
        assert name in told.names() and why[-1:] not in ("", ".")
        assert told.declaration(name)["recorded"] == why


def _content(script: str) -> tuple[str, Any]:
    result = re.fullmatch(r"\(window.courseSimulations \?\?= \{\}\)\[(.*?)\] = (.*);\n", script)
    assert result
    return strict(result[1]), strict(result[2])


def test_a_live_bundle_has_the_compiled_module(monkeypatch: Any, tmp_path: Any) -> None:
    (tmp_path / "top.wasm").write_bytes(b"\0asm and more")
    monkeypatch.setattr(told, "RECORDED", {})
    monkeypatch.setattr(told, "module", lambda name: tmp_path / "top.wasm")
    name, content = _content(told.bundle("rigid_body.top"))
    assert name == "rigid_body.top" and content["pictures"] is None
    assert base64.b64decode(content["wasm"]) == b"\0asm and more"
    assert content["declaration"]["recorded"] == ""


def _unpacked(film: Any) -> Iterator[Any]:
    """The pictures of a film, as live.js unpacks them."""
    data = gzip.decompress(base64.b64decode(film["data"]))
    before, picture, at = np.empty(0, np.int32), np.empty(0), 0
    for size in film["sizes"]:
        if size:
            planes = np.frombuffer(data, np.uint8, 4 * size, at).reshape(4, size)
            steps = np.ascontiguousarray(planes.T).view(np.int32)[:, 0]
            both = min(size, before.size)
            steps[:both] += before[:both]
            exact, at = steps == 1 - 2**31, at + 4 * size
            picture = np.where(steps == -(2**31), np.nan, steps / 512.0)
            picture[exact] = np.frombuffer(data, float, exact.sum(), at)
            before, at = steps, at + 8 * exact.sum()
        yield picture
    assert at == len(data)


@pytest.mark.slow
@pytest.mark.parametrize("model", [WALK, told.model("rigid_body.spring")])
def test_a_recording_gives_back_its_pictures(model: Any, monkeypatch: Any) -> None:
    monkeypatch.setattr(told, "SECONDS", 1.0)
    films = told.recorded(model)
    assert films == told.recorded(model) and list(films) == list(model.presets)
    for preset, film in films.items():
        experiment = Experiment(model)
        experiment.choose(preset)
        for unpacked in _unpacked(film):
            shown = experiment.picture()
            assert unpacked == pytest.approx(shown.data, abs=1e-3, rel=0.0, nan_ok=True)
            assert type(shown)(shown.paper, unpacked).numbers == shown.numbers  # exactly
            experiment.advance(1.0 / told.RATE)
        assert len(film["sizes"]) == 26


def test_a_recording_has_as_many_pictures_as_there_is_room_for(monkeypatch: Any) -> None:
    monkeypatch.setattr(told, "SECONDS", 1.0)
    lengths = []
    for room in (0, 1_500, 3_000, 1_000_000):
        monkeypatch.setattr(told, "ROOM", room)
        made = told.recorded(WALK)
        lengths.append(min(len(film["sizes"]) for film in made.values()))
        # Two different pictures there are always: what is played has to move.
        assert all(sum(map(bool, film["sizes"])) >= 2 for film in made.values())
        assert sum(len(film["data"]) for film in made.values()) <= max(room, 1_500)
    assert lengths == sorted(lengths) and lengths[0] == 2 and lengths[-1] == 26


@pytest.mark.slow
@pytest.mark.parametrize("name", films.names())
def test_a_recording_was_made_from_the_sources_as_they_are(name: str) -> None:
    assert not films.stale(name), f"run `python -m course.site.films {name}`"
    retained = json.loads(told.recording(name).read_text())["films"]
    assert list(retained) == list(told.model(name).presets)
    assert all(film["data"] and film["sizes"][0] > 0 for film in retained.values())


def test_no_other_simulation_has_a_recording() -> None:
    assert {*told._HERE.rglob("*.json")} == {told.recording(name) for name in films.names()}


def test_a_recording_knows_what_it_was_made_from(monkeypatch: Any, tmp_path: Any) -> None:
    """Code at the far end of its imports, and data, count; words for readers do not."""
    monkeypatch.setattr(films, "COURSE", tmp_path)
    for name, text in {
        "simulations/__init__.py": "",
        "simulations/walk.py": '"""A walk."""\nfrom course.topic import far\n',
        "topic/__init__.py": "from course.other import near\nimport math\n",
        "topic/far.py": "STEP = 1.0\n",
        "topic/data.toml": "a = 1\n",
        "other.py": "near = 1\n",
        "nobody.py": "x = 1\n",
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert {path.name for path in films.reached("walk")} == {
        "__init__.py",
        "walk.py",
        "far.py",
        "data.toml",
        "other.py",
    }
    before = films.fingerprint("walk")
    (tmp_path / "simulations/walk.py").write_text('"""It walks."""\nfrom course.topic import far\n')
    (tmp_path / "nobody.py").write_text("x = 2\n")
    assert films.fingerprint("walk") == before
    text = "from course.topic import far\nPRESETS = {'A': Preset({'a': %s}, '%s', recorded='%s')}\n"
    texts = [text % each for each in ((1, "a", "b"), (1, "c", "d"), (2, "a", "b"))]
    texts.append(texts[0] + "READOUTS = {'time': 'It passes.'}\n")
    texts.append(texts[0] + "READOUTS = {'time': 'Simulated time.'}\n")
    prints = []
    for each in texts:
        (tmp_path / "simulations/walk.py").write_text(each)
        prints.append(films.fingerprint("walk"))
    assert prints[0] == prints[1] != prints[2], "notes do not count, values do"
    assert prints[3] == prints[4], "tooltips do not count"
    before = prints[4]
    for name, text in (
        ("other.py", "near = 2\n"),
        ("topic/far.py", "STEP = 2.0\n"),
        ("topic/data.toml", "a = 2\n"),
    ):
        (tmp_path / name).write_text(text)
        assert films.fingerprint("walk") != before
        before = films.fingerprint("walk")


def test_a_recorded_simulation_without_its_recording_is_refused(
    monkeypatch: Any, tmp_path: Any
) -> None:
    monkeypatch.setattr(told, "recording", lambda name: tmp_path / "none.json")
    with pytest.raises(ValueError, match=r"python -m course\.site\.films pipeline"):
        told.bundle("pipeline")
    with pytest.raises(ValueError, match=r"python -m course\.site\.films pipeline"):
        told.film("pipeline")


def test_the_pictures_of_a_recording_are_a_script_of_their_own() -> None:
    name = "pipeline"
    told_by, _, where = told.bundle(name).partition(";\n")
    assert _content(f"{told_by};\n")[1]["pictures"] is None
    assert f"{name}.film.js" in where and len(told_by) < 50_000
    films = re.fullmatch(r"\(window.courseFilms \?\?= \{\}\)\[(.*?)\] = (.*);\n", told.film(name))
    assert films and strict(films[1]) == name
    assert list(strict(films[2])) == list(told.model(name).presets)


def test_the_script_is_one_without_modules() -> None:
    text = told.script()
    assert not re.search(r"^\s*(import|export) ", text, re.M)
    assert "innerHTML" not in text and "fetch(" not in text and "http" not in text
