"""Records: a declaration gives defaults, limits and dtype, and keeps out what is not allowed."""

import numpy as np
import pytest

from course.simulations.record import Field, Record, menu, slider, switch

pytestmark = pytest.mark.smoke


RECORD = Record(
    speed=slider("Speed", 1.0, 0.0, 2.0, 0.1, "m/s"),
    count=slider("Count", 3, 1, 9, 1),
    kind=menu("Kind", ("first", "second"), 1),
    on=switch("On", True),
    start=Field((0.0, 1.0), low=-5.0),
    seed=Field(np.uint64(7), shape=(1,)),
)


def test_one_declaration_gives_defaults_and_types():
    record = RECORD.new()
    assert [record[n].item() for n in ("speed", "count", "kind", "on")] == [1.0, 3, 1, 1]
    assert record["start"].tolist() == [0.0, 1.0] and record["seed"].tolist() == [7]
    assert {RECORD.dtype[name].base.itemsize for name in RECORD.fields} == {8}
    assert [name for name, _ in RECORD.panel()] == ["speed", "count", "kind", "on"]
    ends = [field.ends for _, field in RECORD.panel()]
    assert ends == [(0.0, 2.0), (1, 9), (0, 1), (False, True)]


def test_a_record_is_changed_in_place_and_reset():
    record = RECORD.new()
    RECORD.set(record, speed=2, kind="first", on=False, start=(3.0, 4.0))
    assert (record["speed"], record["kind"], record["on"]) == (2.0, 0, 0)
    record["start"][1] = 9.0
    assert record["start"].tolist() == [3.0, 9.0]
    RECORD.reset(record)
    assert record.tobytes() == RECORD.new().tobytes()


@pytest.mark.parametrize(
    "wrong",
    [
        {"speed": 2.1},
        {"speed": -0.1},
        {"speed": np.nan},
        {"speed": "1"},
        {"speed": (1.0, 2.0)},
        {"count": 2.5},
        {"count": 10},
        {"kind": "third"},
        {"kind": 2},
        {"kind": -1},
        {"on": 2},
        {"start": (0.0, -6.0)},
        {"start": 1.0},
        {"start": (0.0, np.inf)},
        {"pace": 1.0},
    ],
)
def test_a_wrong_value_is_named_and_nothing_is_changed(wrong):
    record = RECORD.new()
    with pytest.raises(ValueError, match=next(iter(wrong))):
        RECORD.set(record, **{"count": 5, **wrong})
    assert record.tobytes() == RECORD.new().tobytes()


def test_a_record_is_read_from_its_bytes_if_they_are_allowed():
    record = RECORD.new(speed=1.5, on=False)
    assert RECORD.read(record.tobytes()).tobytes() == record.tobytes()
    record["kind"] = 2
    for wrong in (record.tobytes(), RECORD.new().tobytes() + b"\0", b""):
        with pytest.raises(ValueError, match=r"kind|bytes"):
            RECORD.read(wrong)
