"""Which pairs are heard: against the tables of the standard, written out here by hand."""

import itertools
import math
from dataclasses import fields, replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.middleware.qos import QoS, compatible
from tests.budget import examples

# Pairs (offered, requested) that are heard, of OMG DDS 1.4, sec. 2.2.3.
HEARD = {
    "reliability": "best_effort-best_effort reliable-best_effort reliable-reliable",
    "durability": "volatile-volatile transient_local-volatile transient_local-transient_local "
    "transient-volatile transient-transient_local transient-transient persistent-volatile "
    "persistent-transient_local persistent-transient persistent-persistent",
    "liveliness": "automatic-automatic manual_by_participant-automatic "
    "manual_by_participant-manual_by_participant manual_by_topic-automatic "
    "manual_by_topic-manual_by_participant manual_by_topic-manual_by_topic",
    "ownership": "shared-shared exclusive-exclusive",
    "destination_order": "by_reception_timestamp-by_reception_timestamp "
    "by_source_timestamp-by_reception_timestamp by_source_timestamp-by_source_timestamp",
}
PERIODS = (0.01, 0.1, math.inf)
KINDS = {
    name: sorted({k for p in text.split() for k in p.split("-")}) for name, text in HEARD.items()
}


def one(name: str, value: Any) -> QoS:
    return QoS(**{name: value})


@pytest.mark.parametrize("name", HEARD)
def test_each_pair_of_kinds(name):
    for offered, requested in itertools.product(KINDS[name], repeat=2):
        failing = compatible(one(name, offered), one(name, requested))
        assert failing == (() if f"{offered}-{requested}" in HEARD[name].split() else (name,))


@pytest.mark.parametrize(
    ("name", "policy"), [("deadline", "deadline"), ("liveliness_lease_duration", "liveliness")]
)
def test_a_writer_that_promises_less_often_than_is_asked_is_not_heard(name, policy):
    for offered, requested in itertools.product(PERIODS, repeat=2):
        failing = compatible(one(name, offered), one(name, requested))
        assert failing == (() if offered <= requested else (policy,))


ENDS = st.builds(
    QoS,
    **{name: st.sampled_from(kinds) for name, kinds in KINDS.items()},
    deadline=st.sampled_from(PERIODS),
    liveliness_lease_duration=st.sampled_from(PERIODS),
    lifespan=st.sampled_from(PERIODS),
    depth=st.integers(1, 20),
    history=st.sampled_from(["keep_last", "keep_all"]),
)


@examples(100)
@given(offered=ENDS, requested=ENDS, other=ENDS)
def test_policies_fail_one_by_one_and_what_is_kept_never_matters(offered, requested, other):
    failing = set(compatible(offered, requested))
    alone = {
        policy
        for field in fields(QoS)
        for policy in compatible(
            QoS(**{field.name: getattr(offered, field.name)}),
            QoS(**{field.name: getattr(requested, field.name)}),
        )
    }
    assert failing == alone
    own = {name: getattr(other, name) for name in ("history", "depth", "lifespan")}
    assert set(compatible(replace(offered, **own), requested)) == failing
    assert set(compatible(offered, replace(requested, **own))) == failing
    assert compatible(offered, offered) == ()


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"reliability": "Reliable"}, r"reliability must be .*, got 'Reliable'"),
        ({"depth": 0}, r"depth must be .*, got 0"),
        ({"deadline": 0.0}, "deadline"),
        ({"lifespan": math.nan}, "lifespan"),
        ({"liveliness_lease_duration": None}, "infinite for none"),
        ({"history": "all"}, "history"),
    ],
)
def test_bad_input_is_refused(given, match):
    with pytest.raises(ValueError, match=match):
        QoS(**given)
