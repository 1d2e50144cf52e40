"""Faulty models of a two-link arm, as URDF texts: what does a reader of models do with each?

Each is one change of the sound `GOOD`. There are three kinds. No body can be like an "impossible"
one. A "broken" one breaks the rules of the format (URDF, ROS wiki, XML specification, 2022), so
that its meaning is a guess. A "feature" is right, and not every reader has it: it is kept or lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from course.check import one_of
from course.rigid_body.spatial import inertia_tensor

KINDS = ("impossible", "broken", "feature")
VERDICTS = ("refused", "warned", "kept", "repaired", "swallowed", "crashed")

_BODY = (
    '<link name="{0}"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>'
    '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>\n'
)
_JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>'
    '<origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>'
    '<limit lower="-1" upper="2" effort="50" velocity="3"/></joint>\n'
)
_FORE, _ELBOW = _BODY.format("fore"), _JOINT.format("elbow", "upper", "fore")
_FRAME = (
    '<?xml version="1.0"?>\n<robot name="arm">\n'
    + _BODY.format("base")
    + _BODY.format("upper")
    + "{fore}"
    + _JOINT.format("shoulder", "base", "upper")
    + "{elbow}{more}</robot>\n"
)
GOOD = _FRAME.format(fore=_FORE, elbow=_ELBOW, more="")


@dataclass(frozen=True)
class Model:
    """One faulty text: its kind, and in words what is wrong with it."""

    name: str
    kind: str
    fault: str
    text: str


def _changed(name: str, kind: str, fault: str, *edits: tuple[str, str], more: str = "") -> Model:
    """Return the sound text with the fore link or the elbow edited, and more at its end."""
    fore, elbow = _FORE, _ELBOW
    for old, new in edits:
        # Each edit must match exactly one of the two texts, or the fault would not be in the model.
        assert (old in fore) != (old in elbow), old
        fore, elbow = fore.replace(old, new, 1), elbow.replace(old, new, 1)
    return Model(
        name, one_of("kind", kind, KINDS), fault, _FRAME.format(fore=fore, elbow=elbow, more=more)
    )


_INERTIAL = _FORE[_FORE.index("<inertial>") : _FORE.index("</link>")]
_LIMIT = _ELBOW[_ELBOW.index("<limit") : _ELBOW.index("</joint>")]
_AXIS = '<axis xyz="0 1 0"/>'
_MASS, _END = '<mass value="1"/>', "</joint>"
_HAND = (
    '<link name="hand"><inertial><origin xyz="0 0 0"/><mass value="-0.3"/><inertia ixx="0.001" '
    'iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="wrist" '
    'type="fixed"><parent link="fore"/><child link="hand"/></joint>'
)

_ROW = "".join(
    f'<link name="mark{i:03}"/><joint name="glue{i:03}" type="fixed"><parent link="base"/>'
    f'<child link="mark{i:03}"/><origin xyz="{i} 0.25 0"/></joint>'
    for i in range(200)
)

MODELS = (
    _changed("negative mass", "impossible", "mass -1 kg", (_MASS, '<mass value="-1"/>')),
    _changed("NaN mass", "impossible", "mass nan", (_MASS, '<mass value="nan"/>')),
    _changed("infinite mass", "impossible", "mass inf", (_MASS, '<mass value="inf"/>')),
    _changed("zero mass", "impossible", "mass 0 and inertia", (_MASS, '<mass value="0"/>')),
    _changed("fixed negative", "impossible", "a link of -0.3 kg fixed to another", more=_HAND),
    _changed("negative inertia", "impossible", "izz -0.02", ('izz="0.02"', 'izz="-0.02"')),
    _changed("NaN inertia", "impossible", "izz nan", ('izz="0.02"', 'izz="nan"')),
    _changed("triangle", "impossible", "izz above ixx + iyy", ('izz="0.02"', 'izz="0.2"')),
    _changed("indefinite", "impossible", "ixy above ixx and iyy", ('ixy="0"', 'ixy="0.05"')),
    _changed(
        "negative damping",
        "impossible",
        "damping -0.5",
        (_END, '<dynamics damping="-0.5"/></joint>'),
    ),
    _changed("zero axis", "impossible", "axis 0 0 0", (_AXIS, '<axis xyz="0 0 0"/>')),
    _changed("NaN axis", "impossible", "axis 0 nan 1", (_AXIS, '<axis xyz="0 nan 1"/>')),
    _changed("NaN origin", "impossible", "origin 0 nan 0.3", ('xyz="0 0 0.3"', 'xyz="0 nan 0.3"')),
    _changed(
        "swapped limits",
        "impossible",
        "lower 2 above upper -1",
        ('lower="-1" upper="2"', 'lower="2" upper="-1"'),
    ),
    _changed(
        "zero inertia",
        "broken",
        "a mass without extent",
        ('ixx="0.02" iyy="0.02" izz="0.02"', 'ixx="0" iyy="0" izz="0"'),
    ),
    _changed("no inertial", "broken", "a moving link without mass", (_INERTIAL, "")),
    _changed("no mass", "broken", "an inertial without mass", (_MASS, "")),
    _changed("misspelt", "broken", "an attribute izzz", ("izz=", "izzz=")),
    _changed("comma", "broken", "mass 1,5", (_MASS, '<mass value="1,5"/>')),
    _changed("no limit", "broken", "a revolute joint without limits", (_LIMIT, "")),
    _changed("short origin", "broken", "two numbers of three", ('xyz="0 0 0.3"', 'xyz="0 0.3"')),
    _changed(
        "unknown parent",
        "broken",
        "a parent that is no link",
        ('parent link="upper"', 'parent link="uper"'),
    ),
    _changed("unknown type", "broken", "a joint of type hinge", ('"revolute"', '"hinge"')),
    _changed(
        "two parents", "broken", "a link on two joints", more=_JOINT.format("again", "base", "fore")
    ),
    _changed("twin link", "broken", "two links of one name", more=_BODY.format("upper")),
    _changed(
        "twin joint",
        "broken",
        "two joints of one name",
        more=_BODY.format("hand") + _JOINT.format("elbow", "fore", "hand"),
    ),
    _changed(
        "mimic of nobody",
        "broken",
        "it follows a joint that isn't there",
        (_END, '<mimic joint="nobody" multiplier="2"/></joint>'),
    ),
    _changed(
        "mimic",
        "feature",
        "the elbow turns twice as far as the shoulder",
        (_END, '<mimic joint="shoulder" multiplier="2"/></joint>'),
    ),
    _changed(
        "friction",
        "feature",
        "dry friction of a joint",
        (_END, '<dynamics damping="0.5" friction="0.3"/></joint>'),
    ),
    _changed(
        "damping", "feature", "damping of a joint", (_END, '<dynamics damping="0.5"/></joint>')
    ),
    _changed(
        "floating",
        "feature",
        "a floating joint",
        ('"revolute"', '"floating"'),
        (_AXIS, ""),
        (_LIMIT, ""),
    ),
    _changed(
        "planar",
        "feature",
        "a planar joint",
        ('"revolute"', '"planar"'),
        (_AXIS, '<axis xyz="0 0 1"/>'),
        (_LIMIT, ""),
    ),
    _changed("long line", "feature", "200 links fixed to the base, in one line", more=_ROW),
)


@dataclass(frozen=True)
class Reading:
    """What a reader did with a text.

    Attributes:
        rejection: its error message, else "".
        crashed: whether it took the process with it.
        messages: what it printed that it doesn't print about the sound model.
        facts: of the model as loaded; empty where there is none. "masses" [kg] and "moments"
            (3 each [kg m^2]) of the links that move, "places" of joints, "axes", "limits" (two
            each), "damping", "friction", "dof", "mimic".
    """

    rejection: str = ""
    crashed: bool = False
    messages: str = ""
    facts: dict[str, Any] | None = None


def possible(facts: dict[str, Any]) -> bool:
    """Return whether the loaded model can be an arm.

    Every moving link must be a body, and every number finite.
    """
    for name in ("masses", "moments", "places", "axes", "damping"):
        if not np.isfinite(np.array(facts[name], dtype=float)).all():
            return False
    # Written after the check for finite numbers: NaN compares as false.
    if min(facts["masses"]) <= 0.0 or min(facts["damping"], default=0.0) < 0.0:
        return False
    if any(low > high for low, high in facts["limits"]):
        return False
    if any(not np.any(axis) for axis in facts["axes"]):
        return False
    return all(_of_a_body(moments) for moments in facts["moments"])


def _of_a_body(moments: Sequence[float]) -> bool:
    try:
        inertia_tensor(np.diag(np.array(moments, dtype=float)))
    except ValueError:
        return False
    return True


def is_preserved(name: str, facts: dict[str, Any]) -> bool:
    """Return whether the loaded model has what the text of a feature says."""
    if name == "mimic":
        return bool(facts["mimic"])
    if name in ("friction", "damping"):
        return name in facts and any(x > 0.0 for x in facts[name])
    return facts["dof"] == {"floating": 7, "planar": 4}.get(name, 2)


def verdict(model: Model, reading: Reading) -> str:
    """Return one of `VERDICTS`.

    "warned" goes before what became of the model. Without a word: "kept" is a feature that is in
    the loaded model, "repaired" a fault that isn't any more, and "swallowed" the rest: a feature
    that is lost, or a model that no arm can be.
    """
    if reading.crashed:
        return "crashed"
    if reading.rejection:
        return "refused"
    # A warning counts more than what became of the model: the user was told.
    if reading.messages:
        return "warned"
    assert reading.facts is not None
    if model.kind == "feature":
        return "kept" if is_preserved(model.name, reading.facts) else "swallowed"
    return "repaired" if possible(reading.facts) else "swallowed"


def honesty(verdicts: dict[str, str]) -> float:
    """Return the share of the faulty models, features aside, that were refused or warned about."""
    faulty = [model.name for model in MODELS if model.kind != "feature"]
    return sum(verdicts[name] in ("refused", "warned") for name in faulty) / len(faulty)
