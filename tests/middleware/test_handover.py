"""The newest value from thread to thread: nothing torn, nothing old, and broken ones are caught."""

import numpy as np
import pytest

from course import charts
from course.middleware import controller, handover
from tests import optional

# What has to be caught: the writer fills the slot that the reader may be copying.
DOUBLE = """
template <typename T>
class TripleBuffer {
public:
  void write(const T& value) {
    const unsigned next = 1 - newest_.load(std::memory_order_acquire);
    slots_[next] = value;
    newest_.store(next, std::memory_order_release);
    fresh_.store(true, std::memory_order_release);
  }
  bool read(T& value) {
    const bool fresh = fresh_.exchange(false, std::memory_order_acq_rel);
    value = slots_[newest_.load(std::memory_order_acquire)];
    return fresh;
  }

private:
  std::array<T, 2> slots_{};
  std::atomic<unsigned> newest_{0};
  std::atomic<bool> fresh_{false};
};
"""
# The usual seqlock: the copy is thrown away if the counter moved, and is a data race all the same.
SEQLOCK = """
template <typename T>
class TripleBuffer {
public:
  void write(const T& value) {
    counter_.fetch_add(1, std::memory_order_acq_rel);
    value_ = value;
    counter_.fetch_add(1, std::memory_order_release);
  }
  bool read(T& value) {
    unsigned before = 0, after = 0;
    do {
      before = counter_.load(std::memory_order_acquire);
      value = value_;
      after = counter_.load(std::memory_order_acquire);
    } while (before != after || before % 2 == 1);
    return std::exchange(seen_, before) != before;
  }

private:
  T value_{};
  std::atomic<unsigned> counter_{0};
  unsigned seen_ = 0;
};
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    if controller.compiler() is None:
        optional.skip(f"the buffers in C++ did NOT run: {controller.NO_COMPILER}")
    return tmp_path_factory.mktemp("handover")


@pytest.fixture(scope="module")
def thread_checked(folder):
    return handover.build(folder, "thread")


@pytest.fixture(scope="module")
def memory_checked(folder):
    return handover.build(folder, "address,undefined")


def broken(folder, name: str, header: str):
    """Build the program with another header under the thread sanitizer."""
    place = folder / name
    place.mkdir()
    (place / "newest_value.hpp").write_text(header)
    (place / "newest_value.cpp").write_text(handover.SOURCE.read_text())
    return handover.build(place, "thread", place / "newest_value.cpp")


def header_with(other: str) -> str:
    """Return the header with another class instead of the triple buffer."""
    text = handover.SOURCE.with_suffix(".hpp").read_text()
    begin = text.index("template <typename T>\nclass TripleBuffer")
    end = text.index("template <typename T, typename Mutex")
    return text[:begin] + other.strip() + "\n\n" + text[end:]


@pytest.mark.prove
@pytest.mark.parametrize("method", ["triple", "mutex", "inherit"])
def test_no_value_is_torn_or_old_and_the_newest_arrives(method, thread_checked, memory_checked):
    for program, count in ((thread_checked, 3_000), (memory_checked, 3_000)):
        done = handover.check(program, method, count)
        assert (done.returncode, done.stderr) == (0, ""), done.stderr[:2000]
        assert 0 < int(done.stdout) <= count


@pytest.mark.prove
def test_relaxed_order_a_double_buffer_and_a_plain_seqlock_are_races(folder):
    text = handover.SOURCE.with_suffix(".hpp").read_text()
    relaxed = text.replace("std::memory_order_acq_rel", "std::memory_order_relaxed")
    assert relaxed != text
    for name, header in (
        ("relaxed", relaxed),
        ("double", header_with(DOUBLE)),
        ("seqlock", header_with(SEQLOCK)),
    ):
        done = handover.check(broken(folder, name, header), "triple", 3_000)
        assert "data race" in done.stderr, name


@pytest.mark.prove
def test_latency_counts_calls_and_sorts_its_quantiles(folder):
    program = handover.build(folder)
    for method in handover.METHODS:
        one = handover.latency(program, method, "alone", 0.5)
        assert one.reads > 1 and one.writes > 1
        for times in (one.read, one.written):
            assert len(times) == len(handover.SHARES)
            assert (np.diff(times) >= 0.0).all() and times[-1] > 0.0


def test_bad_input(tmp_path):
    with pytest.raises(ValueError, match="sanitizer must be"):
        handover.build(tmp_path, "memory")
    for arguments in (("spin", "alone", 1.0), ("triple", "idle", 1.0), ("triple", "alone", 0.0)):
        with pytest.raises(ValueError, match="must be"):
            handover.latency(tmp_path, *arguments)


def test_the_stored_chart_bounds_the_triple_buffer_and_not_the_lock():
    """The story: without a lock the reader's calls cost what a copy costs; with one they do not.

    With a core each, the writer keeps the lock only while it copies, and the single worst call of
    any method is an interruption of the reader itself: the shares below it are compared. Where the
    writer is interrupted with the lock in its hands, the worst call tells.
    """
    alone, *interrupted, _writer = charts.stored("handover_waits")
    calls = {series.label: series.y for series in alone.series}
    for share in (1, 2):  # 99 % and 99.9 %
        assert calls["triple buffer"][share] < 2.0 * calls["a copy, not shared"][share]
        assert calls["triple buffer"][share] < calls["std::mutex"][share] / 5.0
    for panel in interrupted:
        worst = {series.label: series.y[-1] for series in panel.series}
        assert worst["triple buffer"] < 2.0 * worst["a copy, not shared"]
        assert worst["triple buffer"] < worst["std::mutex"] / 10.0
