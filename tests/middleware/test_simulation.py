"""The simulation's run is what the same nodes do on the bus, and its bounds hold."""

import numpy as np
import pytest

from course.middleware import Bus, Executor, Link, QoS
from course.simulations import middleware as sim
from course.simulations.model import Experiment
from tests.budget import examples

PROFILES = list(sim.PROFILES.values())


def on_the_bus(controls):
    """Ticks of the loop on the bus, (2, N): when each ran, and the stamp of its plan or -1 [s]."""
    bus, ran = Bus(), []
    camera, planner = bus.node("camera"), bus.node("planner")
    thread = Executor(bus)
    perception = bus.node("perception", thread)
    loop = bus.node("controller", thread if controls["schedule"] == 1 else None)
    wire = Link(sim.DELAY, rate=sim.RATE, fragment=sim.FRAGMENT)
    ends = [QoS("reliable", depth=1) for _ in range(2)]
    offered, requested = (PROFILES[controls[name]] for name in ("offered", "requested"))
    requested = QoS(
        requested.reliability,
        depth=int(controls["depth"]),
        durability=requested.durability,
        deadline=requested.deadline,
    )
    report = []
    pictures = camera.writer("image", offered)
    poses = perception.writer("poses", ends[0])
    plans = planner.writer("plan", ends[0])

    def see(sample):
        yield sim.seeing(controls)
        poses.publish(sample.value, 1472)

    perception.reader("image", see, requested, wire, on_event=lambda e: report.append(e.kind))
    received = planner.reader("poses", None, ends[1], wire)
    known = loop.reader("plan", None, ends[1], wire)
    last = {"pose": -1.0, "plan": -1.0}

    def newest(reader, name):
        while (sample := reader.take()) is not None:
            last[name] = sample.value
        return last[name]

    def plan():
        aim = newest(received, "pose")
        if aim >= 0.0:
            yield sim.PLAN
            plans.publish(aim, 1472)

    def tick():
        ran.append((bus.now, newest(known, "plan")))
        yield sim.LOOP

    camera.timer(sim.CAMERA, lambda: pictures.publish(bus.now, sim.IMAGE), sim.PHASE)
    planner.timer(sim.PLAN_PERIOD, plan, sim.PLAN_PHASE)
    loop.timer(1.0 / controls["loop"], tick, 1.0)
    bus.run(3.0)
    return np.array(ran).T, report


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"schedule": 1, "load": 30.0},
        {"schedule": 1, "load": 60.0, "loop": 300.0},
        {"load": 60.0, "depth": 10},
        {"requested": 1},
        {"offered": 3, "requested": 3, "load": 50.0},
        {"offered": 1, "requested": 0, "loop": 100.0},
    ],
)
def test_a_run_is_what_the_bus_does(values):
    experiment = Experiment(sim.MODEL, **values)
    state, m = experiment.state, experiment.state["ticks"]
    ours = np.array([state["start"][:m], state["stamp"][:m]])
    theirs, report = on_the_bus(experiment.controls)
    same = min(ours.shape[1], theirs.shape[1], int(np.sum(ours[0] < 2.9)))
    assert same > 50
    assert np.abs(ours[:, :same] - theirs[:, :same]).max() < 1e-6
    silent = sim.verdict(experiment.controls, 0)
    assert ("incompatible" in report) == (silent > 0)
    assert np.any(theirs[1] > 0.0) == (silent == 0)


def test_loss_is_the_closed_form_and_reliable_ends_lose_nothing():
    lost = []
    for loss in (0.3, 1.0, 2.0):
        state = Experiment(sim.MODEL, loss=loss).state
        count = state["images"]
        share = 1.0 - (1.0 - 1e-3 * loss) ** sim.PACKETS
        lost.append(np.mean(state["came"][:count] < 0.0))
        assert abs(lost[-1] - share) < 4.0 * np.sqrt(share * (1.0 - share) / count)
        again = Experiment(sim.MODEL, loss=loss, offered=1, requested=1).state
        assert (again["came"][:count] > again["sent"][:count]).all()
    assert lost == sorted(lost) and lost[0] < lost[-1]


def test_no_tick_is_later_than_its_bound():
    from hypothesis import example, given
    from hypothesis import strategies as st

    @examples(20)
    @example(3, 0, 1, True)  # perception preempts the logger before the loop waits for its lock
    @given(st.sampled_from((1, 2, 3)), st.integers(0, 16), st.integers(1, 10), st.booleans())
    def check(schedule, load, loop, received):
        experiment = Experiment(
            sim.MODEL,
            schedule=schedule,
            load=5.0 * load,
            loop=100.0 * loop,
            requested=0 if received else 1,
        )
        largest = sim.bound(experiment.controls)
        assert largest < 0.0 or experiment.state["late"] <= largest + 1e-9

    check()
    late = [Experiment(sim.MODEL, schedule=k).state["late"] for k in range(4)]
    assert late[0] == 0.0 and 0.0 < late[3] < late[2] and late[1] > 0.015


def test_a_late_monitor_needs_both_ends_to_keep():
    observed = {
        (a, b, joins): bool(
            Experiment(sim.MODEL, topic=3, offered=a, requested=b, joins=joins).state["zone"]
        )
        for a in range(4)
        for b in range(4)
        for joins in (0.0, 1.0)
    }
    assert [key for key, zone in observed.items() if zone and key[2]] == [(2, 2, 1.0)]
    assert observed[1, 1, 0.0] and not observed[1, 2, 0.0] and not observed[0, 1, 0.0]
