"""Executors: every measured response below its bound, and the bound met; deadlocks by hand; chapter
0's ages, in closed form and by its own simulation, on the bus."""

import math
import threading
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from course.middleware.bus import ActionClient, Bus, Future, Group, drive
from course.middleware.executor import ORDERS, Executor, Work, bounds, deadlocks, respond, run_chain
from course.middleware.qos import QoS
from course.role import CHAIN, Stage, age, simulate
from tests.budget import examples

CONTROL, CAMERA = Work("control", 0.001, 0.05), Work("camera", 0.025, 1 / 30, "subscription")


@pytest.mark.slow
@pytest.mark.parametrize("order", ORDERS)
def test_a_short_callback_waits_for_a_long_one_in_every_order(order):
    works, worst = [CONTROL, CAMERA], 0.0
    bound = bounds(works, order)["control"]
    assert bound == pytest.approx(0.026)
    for phase in np.linspace(0.0, 1 / 3, 100):
        result = respond(works, order, phases=(phase, 0.0), seconds=0.2)
        worst = max(worst, result["control"].max())
    assert 0.99 * bound < worst <= bound
    own = Work("camera", 0.025, 1 / 30, "subscription", "own")
    assert respond([CONTROL, own], order, 2)["control"].max() == pytest.approx(0.001)
    assert bounds([CONTROL, own], order, 2)["control"] == pytest.approx(0.001)


WORKS = st.lists(
    st.tuples(
        st.integers(1, 30),
        st.sampled_from([20, 33, 50, 90, 140, 300]),
        st.booleans(),
        st.sampled_from(["a", "b", ""]),
        st.floats(0.0, 0.999),
    ),
    min_size=1,
    max_size=5,
)


@pytest.mark.slow
@examples(100)
@given(rows=WORKS, order=st.sampled_from(ORDERS), threads=st.sampled_from([1, 5]))
def test_no_response_is_longer_than_its_bound(rows, order, threads):
    works = [
        Work(f"{k}", 1e-3 * C, 1e-3 * T, "timer" if timer else "subscription", group)
        for k, (C, T, timer, group, _) in enumerate(rows)
    ]
    assume(threads == 1 or all(w.group or w.execution <= w.period for w in works))
    bound = bounds(works, order, threads)
    result = respond(works, order, threads, [row[-1] for row in rows], 2.0)
    for name, times in result.items():
        assert times.size == 0 or times.max() <= bound[name] + 1e-8


@pytest.mark.parametrize(
    ("order", "runs"), [("ready set", "cTSTS"), ("timers first", "cTTST"), ("fifo", "cSTST")]
)
def test_the_order_of_what_came_during_a_long_callback(order, runs):
    """S, T, S come while c runs from 0 to 1; T comes again at 1.5 and 2.4; each takes 0.5."""
    bus, log = Bus(), []
    executor = Executor(bus, order=order)
    node, out = bus.node("a", executor), bus.node("b").writer("S")

    def note(letter, seconds):
        def run(*_):
            log.append(letter)
            yield seconds

        return run

    node.timer(100.0, note("c", 1.0))
    node.timer(0.9, note("T", 0.5), phase=2 / 3)
    node.reader("S", note("S", 0.5))
    bus.after(0.5, out.publish, 1)
    bus.after(0.7, out.publish, 2)
    bus.run(2.9)
    assert "".join(log)[:5] == runs


def calling(bus, threads=1, group=None, server=None):
    """A timer's callback that asks a service and waits for the answer."""
    executor = Executor(bus, threads)
    node, got = bus.node("control", executor), []
    (server or bus.node("planner")).service("plan", lambda x: x + 1)
    client = node.client("plan", group)

    def ask():
        got.append((yield client.call(1)))

    node.timer(1.0, ask)
    return got


def test_a_service_call_inside_a_callback_of_its_own_group_never_ends():
    bus = Bus()
    got = calling(bus, threads=4)
    bus.run(3.0)
    assert got == []
    assert deadlocks(bus) == [
        "the timer of control waits for client plan/reply of control, which needs "
        "the default group of control, held by the timer of control"
    ]


@pytest.mark.parametrize(("threads", "group"), [(2, Group("other")), (2, Group("open", True))])
def test_a_group_of_its_own_and_a_second_thread_are_the_cure(threads, group):
    bus = Bus()
    got = calling(bus, threads, group)
    bus.run(2.5)
    assert (got, deadlocks(bus)) == ([2, 2, 2], [])
    bus = Bus()
    assert calling(bus, 1, group) == []
    bus.run(3.0)
    assert "a thread, all held by the timer of control" in deadlocks(bus)[0]


@pytest.mark.parametrize(("threads", "group"), [(1, None), (2, None), (2, Group("other"))])
def test_a_service_that_nobody_serves_is_named_as_the_cause(threads, group):
    """Also a server that starts after the request: it never sees that one."""
    bus, got = Bus(), []
    node = bus.node("a", Executor(bus, threads))
    client = node.client("nobody", group)

    def ask():
        got.append((yield client.call(1)))

    node.timer(10.0, ask)
    bus.run(1.0)
    bus.node("late", Executor(bus, 1)).service("nobody", lambda x: x)
    bus.run(5.0)
    (reason,) = deadlocks(bus)
    assert got == [] and "'nobody', which nobody served" in reason and "group" not in reason


def test_two_nodes_that_ask_each_other_block_each_other():
    bus = Bus()
    nodes = [bus.node(name, Executor(bus, 2)) for name in "ab"]
    replies = [Group("replies of a"), Group("replies of b")]
    clients = [nodes[k].client(f"of {'ba'[k]}", replies[k]) for k in range(2)]
    for k, node in enumerate(nodes):
        node.service(f"of {node.name}", lambda x: x)

        def ask(client=clients[k]):
            yield client.call(0)

        node.timer(10.0, ask)
    bus.run(1.0)
    result = deadlocks(bus)
    assert len(result) == 2
    assert "service of b/request of b, which needs the default group of b, held by" in result[0]


def test_who_waits_for_one_that_only_takes_long_is_not_stuck():
    """b waits for a slow c; a waits for b, whose group is held until c has answered."""
    bus, got = Bus(), []

    def slow(x):
        yield 2.0
        return x

    def ask(client):
        got.append((yield client.call(0)))

    a, b, c = (bus.node(name, Executor(bus, 2)) for name in "abc")
    c.service("of c", slow)
    b.service("of b", lambda x: x)
    for node, name in ((b, "of c"), (a, "of b")):
        client = node.client(name, Group("replies"))
        node.timer(10.0, lambda client=client: ask(client))
    bus.run(1.0)
    assert sum(len(executor.blocked) for executor in bus.executors) == 2
    assert deadlocks(bus) == []
    bus.run(3.0)
    assert got == [0, 0]


def test_executors_have_threads_in_real_time():
    bus, names = Bus(), set()
    executor = Executor(bus, 2)
    camera, eye = bus.node("camera", executor), bus.node("eye", Executor(bus))
    out, observed = camera.writer("x"), []
    numbers = iter(range(6))

    def shoot():
        names.add(threading.current_thread())
        yield 0.001
        if (k := next(numbers, None)) is not None:
            out.publish(k)

    camera.timer(0.005, shoot)
    eye.reader("x", lambda s: observed.append(s.value), QoS(history="keep_all"))
    for _ in range(50):
        bus.run(bus.now + 0.05, real=True)
        if len(observed) == 6:
            break
    assert observed == list(range(6))
    assert threading.main_thread() not in names
    assert not any(thread.is_alive() for thread in names)


# --- Chapter 0 on the bus -------------------------------------------------------------------------

CHAINS = {
    "of chapter 0": CHAIN,
    "deep queue": (Stage("a", 0.01, 0.031), Stage("b", 0.02, 0.103, depth=4)),
    "on arrival": (Stage("a", 0.01, 0.031), Stage("b", 0.02), Stage("c", 0.001, 0.01)),
    "skip": (Stage("a", 0.045, 0.031, overload="skip"), Stage("b", 0.02, 0.103)),
    "queue": (Stage("a", 0.01, 0.031), Stage("b", 0.05, depth=3, overload="queue")),
}


@pytest.mark.prove
@pytest.mark.parametrize("name", CHAINS)
def test_the_bus_runs_a_chain_as_chapter_0_says(name):
    chain = CHAINS[name]
    text, observed = age(chain), []
    for phases in np.random.default_rng(0).random((6, len(chain))):
        ours, theirs = (run(chain, phases, seconds=10.0) for run in (run_chain, simulate))
        n = ours.published.size
        assert 0 <= theirs.published.size - n <= 5  # what came after the end
        assert np.allclose(ours.published, theirs.published[:n], rtol=0, atol=1e-8)
        assert np.allclose(ours.captured, theirs.captured[:n], rtol=0, atol=1e-8)
        observed.append(ours.age(np.random.default_rng(1).uniform(2.0, 9.5, 20_000)))
    ages = np.concatenate(observed)
    assert ages.mean() == pytest.approx(text.mean, rel=0.03)
    assert text.least - 1e-8 <= ages.min()
    assert ages.max() <= text.greatest + 1e-8


@pytest.mark.prove
def test_jitter_and_losses_of_a_chain():
    chain = (Stage("a", 0.02, 0.1, jitter=0.01, lost=0.3), Stage("b", 0.01, 0.037))
    text, trace = age(chain), run_chain(chain, (0.2, 0.7), 3, 1000.0)
    ages = trace.age(np.random.default_rng(1).uniform(5.0, 990.0, 100_000))
    assert ages.mean() == pytest.approx(text.mean, rel=0.03)
    assert ages.std() == pytest.approx(text.std, rel=0.05)
    again = run_chain(chain, (0.2, 0.7), 3, 1000.0)
    assert np.array_equal(trace.captured, again.captured)


@examples(25)
@given(depth=st.integers(1, 12), T=st.floats(0.005, 0.05), ratio=st.floats(1.3, 5.0))
def test_a_queue_of_depth_d_makes_what_is_read_older_by_d_minus_1_periods(depth, T, ratio):

    def read(d):
        bus, result = Bus(), []
        out = bus.node("camera").writer("image")
        reader = bus.node("eye").reader("image", None, QoS(depth=d))

        def view():
            if sample := reader.take():
                result.append(bus.now - sample.stamp)

        bus.node("a").timer(T, lambda: (out.publish(0), None)[1])
        bus.node("b").timer(ratio * T, view)
        bus.run(100 * ratio * T)
        return np.array(result)[-50:]

    assert np.allclose(read(depth) - read(1), (depth - 1) * T, rtol=0, atol=1e-7)


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: Executor(Bus(), 0), "threads"),
        (lambda: Executor(Bus(), 1, "lifo"), "order"),
        (lambda: Work("a", 0.0, 1.0), "execution of a"),
        (lambda: Work("a", 1.0, 1.0, "x"), "kind"),
        (
            lambda: bounds(
                [CONTROL, CAMERA, Work("c", 1, 2, group="c"), Work("d", 1, 2, group="")], threads=2
            ),
            "at least one for each of 3 groups",
        ),
        (lambda: bounds([Work("c", 3, 2, group="")], threads=2), "reentrant"),
        (lambda: run_chain((Stage("a", 0.1),), (0.0,)), "first stage has a period"),
        (lambda: run_chain(CHAIN, (0.0,)), "phases"),
    ],
)
def test_bad_input_is_refused(call, match):
    with pytest.raises(ValueError, match=match):
        call()


@pytest.mark.parametrize("wait", [-1.0, math.nan, math.inf, "1"])
def test_a_wait_that_is_none_is_raised_at_the_yield_and_ends_the_run(wait):
    bus, log = Bus(), []
    executor = Executor(bus)
    node = bus.node("a", executor)

    def work():
        try:
            yield 0.1
            yield wait
        except ValueError:
            log.append("in the generator")
            raise

    node.timer(1.0, work, phase=0.5)
    rule = r"the wait yielded by work must be a non-negative finite number \[s\], got"
    with pytest.raises(ValueError, match=rf"^{rule} .*{wait}"):
        bus.run(0.7)
    assert log == ["in the generator"]
    # The run has ended: its thread and its group are free for the next callback.
    assert executor.running == [] and not executor.blocked
    assert executor.log[0].end == pytest.approx(0.6e9)
    node.timer(10.0, lambda: log.append("the next"), phase=0.02)
    bus.run(0.9)
    assert log == ["in the generator", "the next"]


def test_a_generator_may_handle_the_error_of_its_wait():
    bus, ended = Bus(), list[float]()

    def work():
        try:
            yield -1.0
        except ValueError:
            yield 2.0
        return bus.now

    drive(bus, work(), ended.append)
    assert ended == []
    bus.run(3.0)
    assert ended == [2.0]


def test_a_goal_whose_generator_fails_is_aborted():
    bus, ends = Bus(), list[Any]()

    def execute(goal):
        yield 0.1
        raise RuntimeError("no path")

    bus.node("server").action("move", execute)
    _, answer = ActionClient(bus.node("client"), "move").send(1)
    answer.then(ends.append)
    with pytest.raises(RuntimeError, match="no path"):
        bus.run(1.0)
    bus.run(1.0)
    assert ends == [("aborted", None)]


def test_a_run_is_blocked_before_it_continues_whoever_sets_the_answer():
    """Another thread may set the answer while a generator begins to wait for it."""

    class Early(Future):
        def then(self, call: Any) -> None:
            self.set(7)
            super().then(call)

    notes: list[Any] = []
    early = Early()

    def work():
        return (yield early)

    drive(Bus(), work(), notes.append, notes.append)
    assert notes == [early, None, 7]


def test_no_answer_is_lost_that_is_set_while_somebody_begins_to_wait():
    answers: list[int] = []
    future = Future()

    class Slow(list):
        """A list during whose `append` another thread sets the answer."""

        def append(self, call: Any) -> None:
            other = threading.Thread(target=future.set, args=(7,))
            other.start()
            other.join(0.1)
            super().append(call)
            others.append(other)

    others: list[threading.Thread] = []
    future._then = Slow()
    future.then(answers.append)
    others[0].join(10.0)
    assert answers == [7]
