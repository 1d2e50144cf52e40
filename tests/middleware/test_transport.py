"""Carriers between processes: what comes back, what is refused; fragments lost on a real socket."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from course.middleware import transport
from course.oracles import cyclonedds, zenoh
from tests.optional import REQUIRED


def lacking(name: str) -> pytest.MarkDecorator:
    """Skip where a library is not installed, but not where the extras are required."""
    return pytest.mark.skipif(
        importlib.util.find_spec(name) is None and not REQUIRED,
        reason=f"nothing went through {name}: pip install -e '.[oracles]'",
    )


def payloads(size: int) -> list[bytes]:
    return [np.random.default_rng(seed).bytes(size) for seed in range(3)]


def comes_back(carrier, size: int) -> None:
    """Each payload comes back, in order, whole."""
    with carrier as trip:
        for payload in payloads(size):
            assert bytes(trip(payload)) == payload


@pytest.mark.parametrize("name", list(transport.carriers(1)))
def test_what_goes_comes_back(name: str):
    carriers = transport.carriers(300_000)
    comes_back(carriers[name], 300_000)


@lacking("zenoh")
@pytest.mark.parametrize("shared", [False, True])
def test_zenoh_brings_it_back(shared: bool):
    comes_back(zenoh.echo(shared), 300_000)


@lacking("zenoh")
def test_zenoh_leaves_nothing_in_shared_memory():
    """Neither of this process nor of its partner: segments of 16 MiB used to stay."""
    code = (
        "from course.oracles import zenoh\nwith zenoh.echo(True) as trip:\n"
        "    trip(bytes(1_000_000))\n"
        "    print(*{x.split()[-1] for x in open('/proc/self/maps') if x.endswith('.zenoh\\n')})"
    )
    run = [sys.executable, "-c", code]
    done = subprocess.run(run, capture_output=True, text=True, timeout=60, check=True)
    segments = [Path(name) for name in done.stdout.split()]
    assert segments  # it did use shared memory
    assert not any(path.exists() for path in segments)


@pytest.mark.prove
@pytest.mark.parametrize(
    "call",
    [
        "inversion.measure(True)",
        "[trip(b'x') for trip in [stack.enter_context(transport.unix_socket())]]",
        "[trip(b'x') for trip in [stack.enter_context(transport.shared_memory(8))]]",
    ],
)
def test_a_script_without_its_guard_is_told_so(call: str, tmp_path):
    """Each child imports the script again, and dies: the parent waited for ever.

    The parent kills the others; one that had made something in shared memory left it behind.
    """
    script = tmp_path / "plain.py"
    script.write_text(
        "import contextlib\nfrom course.middleware import inversion, transport\n"
        f"transport.PATIENCE = 3.0\nmade = {str(tmp_path / 'made')!r}\n"
        "class Noted(inversion.SharedMemory):\n"
        "    def __init__(self, *args, create=False, **more):\n"
        "        super().__init__(*args, create=create, **more)\n"
        "        if create:\n            print(self.name, file=open(made, 'a'))\n"
        "inversion.SharedMemory = transport.SharedMemory = Noted\n"
        f"with contextlib.ExitStack() as stack:\n    {call}\n"
    )
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode != 0
    assert "a child process died while it started" in done.stderr
    made = (tmp_path / "made").read_text().split() if (tmp_path / "made").exists() else []
    assert len(made) <= 2  # the parent's own, and none of a child
    assert not any(Path("/dev/shm", name).exists() for name in made)


@lacking("zenoh")
def test_zenoh_is_confined_to_this_machine():
    for listens in (True, False):
        text = zenoh.read_back(zenoh.configuration(7, listens, False))
        ends = text.pop("listen/endpoints"), text.pop("connect/endpoints")
        assert sorted(ends) == [[], ["tcp/127.0.0.1:7"]] and bool(ends[0]) == listens
        assert set(text.values()) == {False} and len(text) == 3


@lacking("cyclonedds")
def test_cyclone_brings_it_back():
    """A payload of several datagrams, between two processes."""
    comes_back(cyclonedds.echo(100_000, "reliable"), 100_000)


@lacking("cyclonedds")
def test_cyclone_brings_back_whole_what_best_effort_does_not_lose():
    """Best effort may lose any payload, so a lost one is sent again; it never changes one."""
    with cyclonedds.echo(100_000, "best_effort", patience=2.0) as trip:
        for payload in payloads(100_000):
            for attempt in range(10):
                try:
                    assert bytes(trip(payload)) == payload
                    break
                except TimeoutError:
                    assert attempt < 9, "ten payloads in a row were lost"


@lacking("cyclonedds")
def test_two_echoes_do_not_hear_each_other():
    with cyclonedds.echo(8) as first, cyclonedds.echo(8, "best_effort") as second:
        for k in range(5):
            assert bytes(first(bytes([k] * 8))) == bytes([k] * 8)
            assert bytes(second(bytes([k + 9] * 8))) == bytes([k + 9] * 8)


@pytest.mark.slow
@lacking("cyclonedds")
def test_a_message_larger_than_the_receive_buffer_needs_to_be_sent_again():
    """1.5 MB in some thousand datagrams, written at once, to a socket that holds a sixth of it."""
    with cyclonedds.buffered(at_most=262_144):
        # A reader that the scheduler favours may keep up with a few, but not with all of them.
        assert any(cyclonedds.answered(1_500_000, 4, "best_effort", 0.3) < 4 for _ in range(10))
        assert cyclonedds.answered(1_500_000, 2, "reliable", 20.0) == 2
        # A small one gets through, though best effort promises no single one of them.
        assert cyclonedds.answered(50_000, 8, "best_effort", 2.0) > 0
    assert "SocketReceiveBufferSize" not in os.environ["CYCLONEDDS_URI"]


@lacking("cyclonedds")
def test_both_types_of_payload_carry_the_same_bytes():
    cyclonedds.library()
    (payload, *_) = payloads(1000)
    for kind, more in (("array", 0), ("sequence", 4)):  # a sequence says its length first
        made = cyclonedds.payload_type(1000, kind)
        packed = made(data=payload).serialize()
        assert packed[4 + more : 1004 + more] == payload
        assert bytes(made.deserialize(packed).data) == payload


def test_a_full_ring_refuses_and_an_empty_one_has_nothing():
    ring = transport.Ring(2, 8)
    try:
        assert ring.take(0.0) is None
        assert [ring.put(bytes([k]), 0.0) for k in range(3)] == [True, True, False]
        assert bytes(ring.take(0.0) or b"") == b"\0"
        assert not ring.put(b"9", 0.0)  # what was taken is still being read
        assert bytes(ring.take(0.0) or b"") == b"\1"
        assert ring.put(b"9", 0.0) and bytes(ring.take(0.0) or b"") == b"9"
        with pytest.raises(ValueError, match=r"size must be .*, got 9"):
            ring.put(bytes(9))
    finally:
        ring.close()


def test_what_a_camera_asks_of_a_link():
    assert transport.stream(640, 480, 3, 30.0) == (921_600, 27_648_000.0, 627)
    assert transport.stream(1280, 720, 5, 30.0)[1] > 1e9 / 8  # colour and depth, gigabit Ethernet


@pytest.mark.parametrize(("messages", "fragments", "loss"), [(800, 50, 0.01), (300, 5, 0.3)])
def test_loss_grows_with_fragments_as_computed(messages: int, fragments: int, loss: float):
    """Within four standard errors of both formulas; the coin is seeded."""
    result = transport.lossy(messages, fragments, loss, seed=1)
    lost, rounds = (
        f(fragments, loss) for f in (transport.expected_loss, transport.expected_rounds)
    )
    assert abs(result.lost - lost) < 4.0 * (lost * (1.0 - lost) / messages) ** 0.5
    assert abs(result.rounds - rounds) < 4.0 * 0.7 * rounds / messages**0.5
    assert result.sent == pytest.approx(messages * fragments / (1.0 - loss), rel=0.05)


def test_the_formulas_are_those_of_the_textbook():
    assert transport.expected_loss(627, 1e-4) == pytest.approx(1.0 - (1.0 - 1e-4) ** 627, rel=1e-9)
    # The largest of n geometric numbers, drawn.
    drawn = np.random.default_rng(0).geometric(0.8, (200_000, 10)).max(axis=1)
    assert transport.expected_rounds(10, 0.2) == pytest.approx(drawn.mean(), rel=0.005)
    assert transport.expected_rounds(627, 0.0) == 1.0
    assert transport.lossy(3, 40, 0.0, seed=0) == transport.Loss(0.0, 1.0, 120)


@pytest.mark.parametrize(
    ("call", "report"),
    [
        (lambda: transport.Ring(0, 8), r"slots must be .*, got 0"),
        (lambda: transport.lossy(1, 1, 1.0, seed=0), r"loss must be .*, got 1.0"),
        (lambda: transport.lossy(0, 1, 0.1, seed=0), r"messages must be .*, got 0"),
        (lambda: transport.stream(0, 480, 3, 30.0), r"width must be .*, got 0"),
        (lambda: cyclonedds.echo(8, "sure").__enter__(), r"reliability must be .*, got 'sure'"),
        (lambda: cyclonedds.payload_type(8, "list"), r"kind must be .*, got 'list'"),
    ],
)
def test_bad_input(call, report):
    with pytest.raises(ValueError, match=report):
        call()
