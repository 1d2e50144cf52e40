"""Faulty models: chapter 4 refuses what cannot be, and what the other readers do is on record."""

import json

import pytest

from course.oracles import readers
from course.oracles.mujoco.chain import read
from course.platforms import models
from course.platforms.models import GOOD, MODELS, Reading, honesty, possible, verdict
from tests import optional

BY_NAME = {model.name: model for model in MODELS}
# Of the readers besides ours, what is said of them in the course; "-" is any other row.
EXPECTED = {
    "Pinocchio": {
        "NaN mass": "warned",
        "triangle": "swallowed",
        "mimic": "swallowed",
        "zero axis": "swallowed",
        "swapped limits": "swallowed",
        "friction": "kept",
    },
    "MuJoCo": {
        "infinite mass": "swallowed",
        "fixed negative": "repaired",
        "NaN axis": "warned",
        "swapped limits": "repaired",
        "negative damping": "swallowed",
        "mimic": "kept",
        "triangle": "refused",
        "friction": "kept",
    },
    "Drake": {
        "negative mass": "warned",
        "triangle": "warned",
        "comma": "repaired",
        "swapped limits": "refused",
        "friction": "warned",
        "mimic": "kept",
    },
    "PyBullet": {
        "NaN mass": "swallowed",
        "negative mass": "swallowed",
        "zero axis": "swallowed",
        "triangle": "warned",
        "two parents": "crashed",
        "long line": "refused",
        "friction": "swallowed",
        "mimic": "swallowed",
    },
}


def test_there_are_models_of_each_kind_and_each_is_one_change_of_the_sound_one() -> None:
    kinds = [model.kind for model in MODELS]
    assert kinds.count("impossible") >= 14 and set(kinds) == set(models.KINDS)
    assert len(BY_NAME) == len({model.text for model in MODELS} | {GOOD}) - 1 == len(MODELS)


def test_the_importer_reads_the_sound_one_and_what_it_has() -> None:
    assert read(GOOD).n == read(BY_NAME["long line"].text).n == 2
    assert read(BY_NAME["damping"].text).damping.tolist() == [0.0, 0.5]
    for name, words in {
        "fixed negative": r"mass of body 'hand' must be .*, got -0.3",
        "swapped limits": "range of joint 'elbow' must be",
        "infinite mass": "mass of body",
        "mimic of nobody": "without a warning",
        "twin joint": "a name for each joint",
    }.items():
        with pytest.raises(ValueError, match=words):
            read(BY_NAME[name].text)


@pytest.mark.slow
@pytest.mark.parametrize(
    "reader",
    [
        pytest.param(name, marks=[pytest.mark.optional] if name in ("Drake", "PyBullet") else [])
        for name in readers.READERS
    ],
)
def test_what_a_reader_does(reader) -> None:
    try:
        result = readers.readings(reader)
    except ImportError as error:
        optional.skip(f"the reader of {reader} was NOT tried: {error}")
    sound = result.pop("sound")
    assert sound.facts and possible(sound.facts) and not sound.rejection
    assert (sound.facts["dof"], sound.facts["masses"]) == (2, [1.0, 1.0])
    for low_high in sound.facts["limits"]:
        assert list(low_high) == [-1.0, 2.0]
    verdicts = {name: verdict(BY_NAME[name], reading) for name, reading in result.items()}
    assert set(verdicts) == set(BY_NAME) and set(verdicts.values()) <= set(models.VERDICTS)
    if reader == "chapter 4":
        impossible = [m.name for m in MODELS if m.kind == "impossible"]
        assert {verdicts[name] for name in impossible} == {"refused"}
    else:
        expected = EXPECTED[reader]
        assert {name: verdicts[name] for name in expected} == expected
        assert 0.0 < honesty(verdicts) < 1.0
    json.dumps(verdicts)


def test_a_verdict_follows_from_what_was_loaded() -> None:
    sound = {
        "masses": [1.0],
        "moments": [[0.02] * 3],
        "places": [[0.0] * 3],
        "axes": [[0, 1, 0]],
        "limits": [[-1, 2]],
        "damping": [0.0],
        "friction": [],
        "dof": 2,
        "mimic": False,
    }
    faulty, feature = BY_NAME["NaN mass"], BY_NAME["mimic"]
    assert verdict(faulty, Reading(crashed=True)) == "crashed"
    assert verdict(faulty, Reading(rejection="no")) == "refused"
    assert verdict(faulty, Reading(messages="hm", facts=sound)) == "warned"
    assert verdict(faulty, Reading(facts=sound)) == "repaired"
    for key, value in {
        "masses": [float("nan")],
        "moments": [[0.02, 0.02, 0.2]],
        "axes": [[0, 0, 0]],
        "limits": [[2, -1]],
        "damping": [-1.0],
    }.items():
        assert verdict(faulty, Reading(facts={**sound, key: value})) == "swallowed", key
    assert verdict(feature, Reading(facts=sound)) == "swallowed"
    assert verdict(feature, Reading(facts={**sound, "mimic": True})) == "kept"
