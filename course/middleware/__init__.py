"""Chapter 10: middleware and real time. What reaches whom, how old it is, and what is in time.

The front door:

    QoS(reliability, depth, ...), compatible(offered, requested)    who is heard by whom
    Bus(seed), Bus.node(name), Link(delay, loss, ...)    nodes, topics, services, actions
    Executor(bus, threads, order), respond(works), bounds(works)    who waits for whom, how long
    run_chain(stages, phases)    chapter 0's chain on the bus
    response_times(C, T), breakdown(C, T), schedule.run(C, T)    fixed priorities on one core

The chapter's algorithms, and the functions of their steps:

- Response-time analysis (Joseph and Pandya, 1986): `schedule.response_times`, its fixed point in
  `_analyse`; `blocking` adds shared resources, `breakdown` scales a task set.
- Fixed-priority scheduling with inheritance and ceilings (Sha, Rajkumar and Lehoczky, 1990):
  `schedule._run`.
- Executors of ROS 2 (Casini et al., 2019): `executor.Executor._pick` and `_dispatch`; `bounds`
  bounds their response times.
- Matching and reliable delivery of DDS (OMG, 2015): `qos.compatible`, `bus._match`, and
  `bus._Match.send` and `_again`.

Examples:
    >>> from course import middleware
    >>> print(middleware.response_times([1.0, 2.0, 3.0], [4.0, 8.0, 16.0]))
    [1. 3. 7.]
    >>> print(f"{middleware.liu_layland(2):.4f}")  # 2 (sqrt(2) - 1)
    0.8284
"""

from course.middleware.bus import ActionClient, Bus, Event, Future, Group, Link, Node, Sample
from course.middleware.executor import Executor, Work, bounds, deadlocks, respond, run_chain
from course.middleware.qos import QoS, compatible
from course.middleware.schedule import (
    blocking,
    breakdown,
    hyperbolic,
    liu_layland,
    random_sets,
    response_times,
    utilization,
    warm,
)

__all__ = [
    "ActionClient",
    "Bus",
    "Event",
    "Executor",
    "Future",
    "Group",
    "Link",
    "Node",
    "QoS",
    "Sample",
    "Work",
    "blocking",
    "bounds",
    "breakdown",
    "compatible",
    "deadlocks",
    "hyperbolic",
    "liu_layland",
    "random_sets",
    "respond",
    "response_times",
    "run_chain",
    "utilization",
    "warm",
]
