"""Quality of service on Cyclone DDS: confined to this machine, and of one mind with ours."""

import importlib.util
import os
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from course.middleware import QoS, compatible
from course.oracles import cyclonedds, discovery, qos_matrix, slow_reader, unserved
from tests.budget import sampled
from tests.optional import REQUIRED

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("cyclonedds") is None and not REQUIRED,
    reason="nothing was run on Cyclone DDS: pip install -e '.[oracles]'",
)


@pytest.mark.slow
def test_nothing_leaves_the_machine():
    text = cyclonedds.read_back()
    assert text["interfaces"] == "lo (index 1 priority 2 mc {})"
    assert text["address"] == "udp/127.0.0.1"
    assert (text["multicast"], text["peers"], text["groups"]) == ("false", "127.0.0.1", "0")
    assert text["domain"] == str(1 + os.getpid() % 230) and text["tag"] == f"course-{os.getpid()}"


def test_what_it_listens_on_is_as_the_module_says():
    """Sending is confined to lo, listening is not: the kernel's own list of UDP sockets."""
    before = {line.split()[1] for line in _udp()}
    with cyclonedds.participant():
        bound = {line.split()[1] for line in _udp()} - before
    addresses = {address.split(":")[0] for address in bound}
    assert addresses <= {"00000000", "0100007F"} and "00000000" in addresses
    assert "Listening is not confined" in (cyclonedds.__doc__ or "")


def _udp() -> list[str]:
    return Path("/proc/net/udp").read_text(encoding="ascii").splitlines()[1:]


def test_every_pair_is_judged_as_cyclone_does():
    rows = qos_matrix.pair_rows()
    assert [row for row in rows if not row.agree] == []
    tally = Counter(row.policy for row in rows)
    assert tally == {
        "reliability": 4,
        "durability": 16,
        "liveliness": 9,
        "destination_order": 4,
        "ownership": 4,
        "deadline": 9,
        "liveliness_lease_duration": 9,
        "several": 3,
    }
    silent = Counter(row.policy for row in rows if row.named)
    assert silent == {  # one side of the diagonal; both of ownership, which has no order
        "reliability": 1,
        "durability": 6,
        "liveliness": 3,
        "destination_order": 1,
        "ownership": 2,
        "deadline": 3,
        "liveliness_lease_duration": 3,
        "several": 2,
    }
    # Only one reliability pair is silent, and its reverse is heard.
    (lost,) = (row for row in rows if row.policy == "reliability" and row.named)
    assert (lost.offered, lost.requested) == ("best_effort", "reliable")


def test_an_event_names_one_policy_of_several():
    offered = QoS("best_effort")
    requested = QoS(durability="transient_local", deadline=0.1, ownership="exclusive")
    (result,) = cyclonedds.verdicts([(offered, requested)])
    assert len(compatible(offered, requested)) == 4
    assert result == cyclonedds.Verdict(False, "reliability", "reliability", 0)


def test_what_is_kept_is_what_cyclone_keeps():
    rows = qos_matrix.kept_rows(samples=8)
    assert len(rows) == 23
    assert [row for row in rows if not row.agree] == []


def test_a_late_joiner_gets_one_sample_until_the_durability_service_is_set():
    retained = QoS(depth=3, durability="transient_local")
    late = QoS(durability="transient_local")
    result = [
        qos_matrix.history(retained, late, 8, late=True, kept_for_late=depth)
        for depth in (0, None, 3, 5)
    ]
    assert result == [[7], [5, 6, 7], [5, 6, 7], [3, 4, 5, 6, 7]]


@pytest.mark.slow
def test_what_time_does():
    rows = qos_matrix.event_rows()
    assert [row for row in rows if not row.agree] == []


@pytest.mark.parametrize("deadlines", [0.5, 1.5, 2.5])
def test_missed_deadlines_are_counted_at_both_ends(deadlines: float):
    """floor(gap / deadline) in each gap, in a run in which no gap became longer than it should."""
    result = qos_matrix.missed_undisturbed(0.05, 0.05 * deadlines, 4)
    assert result.possible, result
    assert not result.disturbed, f"the machine stalled in each run: {result}"
    assert result.offered == result.requested == 4 * int(deadlines)


@pytest.mark.slow
@pytest.mark.parametrize("per_event", sampled([1.5, 0.1, 2.0], 3))
def test_a_wrong_count_of_missed_deadlines_is_not_taken_for_a_disturbed_run(monkeypatch, per_event):
    """Deadlines per event: as if both ends had agreed on another one."""
    policies = cyclonedds.policies

    def of_another(qos, *settings):
        return policies(replace(qos, deadline=per_event * qos.deadline), *settings)

    monkeypatch.setattr(cyclonedds, "policies", of_another)
    result = qos_matrix.missed_undisturbed(0.05, 0.125, 2, tries=3)
    assert not result.possible or result.disturbed


@pytest.mark.parametrize("reliability", ["reliable", "best_effort"])
@pytest.mark.parametrize("depth", [1, 2, 5, 10])
def test_a_queue_that_is_full_is_depth_less_one_periods_old(depth: int, reliability: str):
    """Reliability changes nothing: what the depth has no room for is gone under either."""
    result = slow_reader.queue_ages(depth, 3, 20, reliability)
    filling = [min(2 * (turn + 1), depth - 1) for turn in range(20)]
    assert result.ages == filling  # two more wait after each turn, until there is no room
    kept_up = slow_reader.queue_ages(depth, 1, 20, reliability)
    assert (kept_up.ages, kept_up.lost) == ([0] * 20, 0.0)
    newest = slow_reader.queue_ages(depth, 3, 20, reliability, newest=True)
    assert newest.ages == [0] * 20


@pytest.mark.slow
def test_a_reliable_topic_loses_what_its_depth_lets_go():
    """Between two processes: 40 messages at once to a reader that rests after each."""
    short = slow_reader.flood(1000, 1, 40, 0.02, "reliable")
    long = slow_reader.flood(1000, 40, 40, 0.002, "reliable")
    assert short.lost > 0.0 and short.received < 40
    assert (long.received, long.lost) == (40, 0.0)


@pytest.mark.parametrize(
    ("call", "report"),
    [
        (lambda: qos_matrix.history(QoS(), QoS(), 0), r"samples must be .*, got 0"),
        (lambda: qos_matrix.missed(gaps=0), r"gaps must be .*, got 0"),
        (lambda: slow_reader.queue_ages(0, 3, 1), r"depth must be .*, got 0"),
        (lambda: slow_reader.flood(10, 1, 0), r"messages must be .*, got 0"),
        (lambda: slow_reader.flood(10, 1, pause=-1.0), r"pause must be .*, got -1.0"),
        (lambda: slow_reader.flood(10, 1, every=-1.0), r"every must be .*, got -1.0"),
    ],
)
def test_bad_input(call, report):
    with pytest.raises(ValueError, match=report):
        call()


@pytest.mark.prove
@pytest.mark.parametrize(
    ("case", "participants", "types", "matched", "policy"),
    [
        ("works", 1, ["course::Joint"], True, ""),
        ("other domain", 0, [], False, ""),
        ("other type", 1, ["course::Pose"], False, "type_consistency"),
        ("other policy", 1, ["course::Joint"], False, "reliability"),
        ("no peer", 0, [], False, ""),
        ("with a peer", 1, ["course::Joint"], True, ""),
        ("field added", 1, ["course::Joint"], False, "type_consistency"),
        ("field changed", 1, ["course::Joint"], False, "type_consistency"),
        ("field renamed", 1, ["course::Joint"], False, "type_consistency"),
        ("appendable", 1, ["course::Joint"], True, ""),
        ("no coercion", 1, ["course::Joint"], False, "type_consistency"),
    ],
)
def test_what_is_listed_and_what_is_matched(case, participants, types, matched, policy):
    result = discovery.discover(case)
    assert (result.participants, result.types) == (participants, types)
    assert (result.listed, result.matched, result.policy) == (bool(types), matched, policy)
    # The hash of the definition differs even where the type name does not.
    assert result.same_hash == (case not in ("other type", *discovery.DEFINITIONS))
    assert result.inconsistent == 0
    # Nothing is decoded with another definition, except that an appendable type gets a default.
    missing = {"effort": 0.0} if case == "appendable" else {}
    assert result.received == ({"number": 7} | missing if matched else {})


def test_an_unknown_case_of_discovery_is_rejected():
    with pytest.raises(ValueError, match="case must be"):
        discovery.discover("no cable")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "listed", "matched", "policy", "replied", "cause"),
    [
        ("answers", True, True, "", True, "answers"),
        ("no server", False, False, "", False, "not discovered"),
        ("other type", True, False, "type_consistency", False, "type mismatch"),
        ("other policy", True, False, "durability", False, "policy mismatch"),
        ("busy", True, True, "", False, "server busy"),
    ],
)
def test_a_request_without_a_reply_has_a_cause_that_discovery_shows(
    case, listed, matched, policy, replied, cause
):
    result = unserved.request(case)
    assert result == unserved.Requested(listed, matched, policy, replied)
    assert result.cause == cause and cause in unserved.CAUSES


def test_an_unknown_case_of_a_request_is_rejected():
    with pytest.raises(ValueError, match="case must be"):
        unserved.request("lost")
