# %% [markdown]
# # 10 · Middleware and real time
#
# *Thirty pictures a second leave the camera, and the controller runs a thousand times a second. Who hears whom, how
# old is what arrives, and is it in time? Answer first<span class="kernel-only">, then run the cells</span>.* About
# {open minutes} minutes of reading, cards and charts. The folded parts add {folded minutes} minutes, the exercises
# {exercise minutes} minutes.

# %%
from course.cards import predict
from course.simulations import simulation

predict("silent_pair")

# %% [markdown]
# ![A graph of nodes and topics](attachment:middleware.png)

# %%
simulation("middleware")

# %% [markdown]
# **You will be able to** say of any two ends whether they hear each other, and which policy fails; predict how old a
# message is and how late a loop, and measure both; find out why messages come late or a controller jitters; and defend
# a stack of nodes, rates and policies. **Know first:** chapter 0's ages.
#
# ## How this chapter works
#
# Most scenes begin with a card: answer first; a click says whether you are right, and **Explanation** says why. A
# number in the text comes from the cell above it, or from a check that `python -m course.derivations 10` runs again.
#
# *What runs here.* No ROS 2 is needed. DDS (Data Distribution Service, a standard of the OMG) is what ROS 2 stands on
# by default. A **bus** in this course does what DDS does between two ends, in virtual time: the same nodes run in a
# fraction of a second, and each run is the same. What it says of policies was tried on a real DDS, Eclipse Cyclone, as
# well. DDS's words are used: a **writer** publishes, a **reader** subscribes, a **sample** is one message.
#
# Section 8 has these exercises:

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint

badges(10)

# %%
import inspect
import tempfile
import textwrap
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

from course.cards import figures, interview
from course.charts import read, stored
from course.control.sampled import delay_limit
from course.derivations import show
from course.middleware import controller, launch, loop, schedule, transport
from course.middleware.bus import ActionClient, Bus, Group, Link
from course.middleware.executor import Executor, Work, bounds, deadlocks, respond, run_chain
from course.middleware.qos import QoS, compatible
from course.middleware.schedule import hyperbolic, liu_layland, response_times, utilization
from course.role import Stage, age


def print_figures(chart, *rows):
    """Print the lines of a chart's key figures that begin so, no wider than a page."""
    for line in read(chart).splitlines():
        if line.lstrip().startswith(rows):
            print(textwrap.fill(" ".join(line.split()), 96, subsequent_indent="    "))


# %% [markdown]
# ## 1 · Concept: who hears whom, and what is kept
#
# ### Three layers, three kinds of "in time"

# %%
layers = {
    "Behaviour, 1-10 Hz": "state machines, behaviour trees: what comes next\nlate: the robot hesitates",
    "ROS 2, 10-100 Hz": "perception, planning, coordination: soft real time\nlate: the result is older",
    "Real-time thread, 1 kHz": "read encoders, compute torque, write: hard real time\nlate: the fault is physical",
}
crossing = ("goals as actions; feedback back", "newest trajectory, lock-free; joint states back")
figure_, axis = plt.subplots(figsize=(8, 3.1), layout="constrained")
for k, (name, does) in enumerate(layers.items()):
    hard = k == 2
    _ = axis.text(
        0,
        -1.3 * k,
        f"{name}\n{does}",
        ha="center",
        va="center",
        fontsize=9,
        bbox={
            "boxstyle": "round,pad=0.5",
            "fc": "#ffebee" if hard else "#e8eaf6",
            "ec": "#c62828" if hard else "#5c6bc0",
        },
    )
    if k:
        for x, ends in ((-0.08, (0.82, 0.48)), (0.08, (0.48, 0.82))):
            _ = axis.annotate(
                "",
                (x, -1.3 * k + ends[1]),
                (x, -1.3 * k + ends[0]),
                arrowprops={"arrowstyle": "->"},
            )
        _ = axis.text(0.16, -1.3 * k + 0.65, crossing[k - 1], va="center", fontsize=8.5)
_ = axis.set(xlim=(-1.6, 1.6), ylim=(-3.1, 0.5))
axis.axis("off")
plt.show()
print(" -> ".join(layers))

# %% [markdown]
# A **node** is a part of the software that others know by what it publishes, hears and answers; these are its *ends*.
# What crosses between nodes takes one of four forms:

# %% tags=["nbval-ignore-output"]
bus = Bus()
server, asker = bus.node("server", Executor(bus)), bus.node("asker", Executor(bus, 2))
took = {name: [] for name in ("Topic", "Service", "Action", "Parameter")}
settings = launch.Parameters({"gain": 20.0})
_ = settings.declare("gain", 1.0)


def execute(goal):
    goal.feedback("half")
    yield 0.0
    return goal.value


def on_sample(sample):
    took["Topic"].append(perf_counter() - sample.value)


def ask():
    out.publish(perf_counter())
    for name, call in (("Service", lambda: plan.call(1)), ("Action", lambda: move.send(1)[1])):
        begun = perf_counter()
        yield call()
        took[name].append(perf_counter() - begun)
    begun = perf_counter()
    settings.value["gain"]
    took["Parameter"].append(perf_counter() - begun)


server.reader("joints", on_sample)
server.service("plan", lambda request: request)
server.action("move", execute)
out, plan, move = asker.writer("joints"), asker.client("plan"), ActionClient(asker, "move")
asker.timer(0.01, ask, group=Group("asks"))
bus.run(1.0, real=True)
forms = {
    "Topic": ("publish, subscribe; many to many", "streams: joint states, pictures"),
    "Service": ("request, reply; one server", "short questions: plan now, get a parameter"),
    "Action": ("goal, feedback, result, cancel", "what takes seconds: move to a pose"),
    "Parameter": ("names and values of one node", "configuration; read again only if asked to"),
}
Markdown(
    "\n".join(
        [
            "| concept | pattern | use | median latency between two threads here |",
            "|---|---|---|---|",
            *(
                f"| {name} | {' | '.join(words)} | {1e6 * np.median(took[name]):.1f} us |"
                for name, words in forms.items()
            ),
        ]
    )
)

# %%
show("service_takes_five")

# %%
show("service_blocks")

# %%
show("topics_many_to_many")

# %%
show("node_is_a_process")

# %% [markdown]
# The latencies are those of threads of one Python process, on this machine, now: not a property of the concept. An
# action is made of services and topics, so that it takes as many ways. Section 6 has two processes and a real DDS.
#
# ### Offer and request
#
# **Quality of service** is what the two ends of a topic say about it, policy by policy. The writer offers, the reader
# requests:
#
# * Reliability. *Reliable*: what is lost is sent again. **Best effort**: it is not.
# * Durability. *Volatile*: the past is past. **Transient local**: the writer keeps its last samples, as long as it
#   lives, for a **late joiner**, a reader that is made after they were written.
# * Deadline: the longest time between two samples. Both ends are told when it is missed; nothing else happens.
# * **Liveliness**: who says that a writer lives, and for how long a word of that counts, its **lease**.
# * History and depth: how many samples a cache keeps. **Lifespan**: the age from which on a sample is thrown away.
#
# Where an offer is weaker than the request in one of those with an order, the pair is silent.

# %%
show("reliability_both_ways")

# %% [markdown]
# <table>
# <tr><th>policy</th> <th>silent if</th> <th>what that looks like</th></tr>
# <tr><td>reliability</td> <td>best effort offered, reliable requested</td> <td>a driver with a sensor's profile, a
# tool with the default one: the tool stays empty</td></tr>
# <tr><td>durability</td> <td>volatile offered, transient local requested</td> <td>not only the past is
# missing</td></tr>
# <tr><td>deadline, lease</td> <td>the offered time is longer, or there is none</td> <td>one end got a deadline, the
# other was forgotten</td></tr>
# <tr><td>liveliness</td> <td>automatic offered, by topic requested</td> <td>a watchdog whose writer never has to
# say that it lives</td></tr>
# <tr><td>history, depth, lifespan</td> <td>never: each end's own affair</td> <td>messages vanish between two ends that
# hear each other</td></tr>
# </table>
#
# DDS knows ownership and destination order as well; ROS 2's profile does not. *Do vendors differ?* That profile names
# reliability, history, depth and durability, so these stay the same whichever DDS is below. What it leaves open or has
# no word for does not: a deadline or lifespan that nobody set, from when a lifespan counts, the depth of DDS's
# durability service, the size of socket buffers (rmw and DDS tuning, ROS 2 documentation, Jazzy 2024). Seven pairs on
# the real one, now:

# %% tags=["nbval-ignore-output"]
late = {"durability": "transient_local"}
queried = {
    "best effort -> reliable": (QoS("best_effort"), QoS()),
    "reliable -> best effort": (QoS(), QoS("best_effort")),
    "volatile -> transient local": (QoS(), QoS(**late)),
    "transient local -> volatile": (QoS(**late), QoS()),
    "no deadline -> 0.1 s": (QoS(), QoS(deadline=0.1)),
    "deadline 0.05 s -> 0.1 s": (QoS(deadline=0.05), QoS(deadline=0.1)),
    "lease 2 s -> 1 s": tuple(QoS(liveliness_lease_duration=s) for s in (2.0, 1.0)),
}
try:
    from course.oracles.cyclonedds import verdicts

    observed = [one.reader or "heard" for one in verdicts(list(queried.values()))]
except ImportError as missing:
    print(missing)
    observed = ["not run"] * len(queried)
for (name, pair), cyclone in zip(queried.items(), observed, strict=True):
    print(f"{name:<30}ours: {', '.join(compatible(*pair)) or 'heard':<14}Cyclone DDS: {cyclone}")

# %% [markdown]
# Each pair of values of each policy, then depths, late joiners and events, took some seconds on Cyclone DDS; rows where
# something is surprising, the others folded:

# %%
rows_ = ("93", "ownership: sh", "liveliness: manual_by_p", "lifespan", "deadline mis")
figures(read("qos_verdicts"), *rows_)

# %%
show("stronger_offer")

# %%
show("volatile_is_no_past")

# %%
show("deadline_for_deadline")

# %%
show("event_names_all")

# %% [markdown]
# ### What is kept

# %%
predict("late_screen")


# %%
def late_reader(offered, requested, joins=0.0, reads=1.0, every=0.1):
    """Return what a reader finds at its first look, and how old that is [s]."""
    bus = Bus()
    writer = bus.node("writer").writer("x", offered)
    for k in range(10):
        bus.after(k * every, writer.publish, k)
    if joins:
        bus.run(joins)
    reader = bus.node("reader").reader("x", None, requested)
    bus.run(reads)
    result = list(iter(reader.take, None))
    return [one.value for one in result], [reads - one.stamp for one in result], reader.dropped


for name, case in {
    "depth 1": (QoS(), QoS(depth=1)),
    "depth 3": (QoS(), QoS(depth=3)),
    "depth 3, best effort": (QoS("best_effort"), QoS("best_effort", depth=3)),
    "depth 10, lifespan 0.35 s": (QoS(lifespan=0.35), QoS()),
    "late, volatile": (QoS(), QoS(), 0.95),
    "late, transient local, writer's depth 2": (QoS(depth=2, **late), QoS(**late), 0.95),
    "late, transient local, depths 2 and 1": (QoS(depth=2, **late), QoS(depth=1, **late), 0.95),
}.items():
    values, old, dropped = late_reader(*case)
    oldest = f"oldest {max(old):.1f} s" if old else "nothing"
    print(f"{name:<42}finds {values!s:<12} {oldest}, {dropped} dropped")

# %% [markdown]
# Depth decides what is thrown away, under either reliability. It also decides how old the rest is: a reader that is
# slower than its writer finds a full queue, and takes its oldest: chapter 0's $(d - 1) T$, on the bus and on Cyclone
# DDS alike. Who takes all that is there and uses the newest escapes it:
#
# ![Age of what a slow reader takes over the depth: bus, Cyclone DDS, theory](../docs/charts/queue_ages.png)

# %%
print_figures("queue_ages", "bus", "Cyclone", "all are")

# %%
show("reliable_arrives")

# %%
show("late_joiner_gets_the_last")

# %%
show("late_joiner_depth")

# %%
show("lifespan_bounds_age")

# %%
show("deadline_is_one_event")

# %% [markdown]
# ## 2 · Concept: in time?
#
# ### A loop that keeps its phase

# %%
predict("sleep_for_a_period")


# %%
def clock(wake=60_000, hiccup=()):
    """Return a clock of our own [ns]: each sleep ends 60 us late, one of them much later."""
    now, sleeps = [0], [0]

    def sleep(seconds):
        sleeps[0] += 1
        now[0] += round(1e9 * seconds) + wake + (5_300_000 if sleeps[0] in hiccup else 0)

    def work(k):
        now[0] += 100_000

    return {"now": lambda: now[0], "sleep": sleep}, work


for name, relative, hiccup in (
    ("sleep until the release", False, ()),
    ("sleep for a period", True, ()),
    ("until the release, one wake-up 5.3 ms late", False, (500,)),
):
    times, work = clock(hiccup=hiccup)
    retained = loop.run(work, 1e-3, 1000, relative=relative, **times)
    last, worst = 1e3 * retained.lateness[-1], 1e3 * retained.lateness.max()
    print(f"{name:<44}last {last:7.2f} ms late, worst {worst:7.2f}, skipped {retained.skipped}")

# %% [markdown]
# The **release** of a period is start plus a whole number of periods; **lateness** is counted from it. A loop that
# sleeps for a period *after* its work drifts by work and wake-up each time. After a long gap the right one skips and
# counts, and is in phase again: no burst. *Derive it yourself:* at which rate does the wrong one run, with the period
# T, the work C and a wake-up that is L late? The text below forgets something; change it.

# %%
answer("relative_sleep", "1/(T + C)")

# %% [markdown]
# ### Are all tasks in time?
#
# Task $i$ computes for at most $C_i$ once in each period $T_i$; what it asks of the core, $C_i/T_i$, summed over all
# tasks, is the **utilization**. Priorities are fixed, the shorter period first: **rate-monotonic**. The worst moment is
# a **critical instant**, when all are released at once. Then the **response time**, from release to end, is the least
# $R_i = C_i + B_i + \sum_{j<i} \lceil R_i/T_j \rceil C_j$, where $B_i$ is the longest wait for a lock that a less
# urgent task holds.

# %%
C, T = np.array([0.25e-3, 2.0e-3, 40e-3]), np.array([1e-3, 10e-3, 100e-3])
longest = schedule.run(C, T, 10.0).longest
for name, ends in {"analysis": response_times(C, T), "a scheduler, run": longest}.items():
    print(f"{name:<18}" + ", ".join(f"{1e3 * x:.2f} ms" for x in ends))
print(
    f"utilization {float(utilization(C, T)):.3f}; bound of three tasks {liu_layland(3):.3f}; "
    f"within the hyperbolic bound: {bool(hyperbolic(C, T))}"
)

# %% [markdown]
# ![Which task sets are in time by three tests, and breakdown utilization](../docs/charts/task_sets.png)

# %%
print_figures("task_sets", "largest", "Liu", "hyperbolic", "exact", "bound")

# %% [markdown]
# On the left, random sets; on the right the utilization at which a growing set first misses. Liu and Layland's bound
# (1973), utilization up to $n(2^{1/n} - 1)$ for $n$ tasks, and the **hyperbolic bound** (Bini and others, 2001),
# $\prod (C_i/T_i + 1) \leq 2$, are sufficient: a set beyond them may well be in time. The analysis is exact where all
# can be released at once, and cheap: section 6 has its time for a thousand sets.

# %%
show("critical_instant")

# %%
show("by_rate_is_best")

# %% [markdown]
# ### Who waits for a lock

# %%
predict("middle_priority")

# %%
# high, middle, low: the low one has the lock when the high one comes.
C3, T3 = np.array([5e-3, 100e-3, 25e-3]), np.full(3, 1.0)
for protocol in ("none", "inheritance", "ceiling"):
    ends = schedule.run(
        C3,
        T3,
        1.0,
        phase=[2e-3, 3e-3, 0.0],
        before=[0.0, 0.0, 0.0],
        section=[5e-3, 0.0, 20e-3],
        lock=[0, -1, 0],
        protocol=protocol,
    ).longest
    print(f"{protocol:<12}the most urgent task waits {1e3 * (ends[0] - C3[0]):6.1f} ms")

# %% [markdown]
# **Priority inversion**: the most urgent task waits for the least urgent, and so for everybody between them.
# **Priority inheritance** lends the holder the waiter's priority; a **priority ceiling** gives it beforehand. On this
# system too, three processes on one core:
#
# ![Waits for a lock against the middle task's time, three protocols](../docs/charts/lock_waits.png)

# %%
print_figures("lock_waits", "none", "inheritance", "this system")

# %%
show("inversion_is_bounded")

# %% [markdown]
# ### Who waits for a thread
#
# An **executor** runs callbacks, one a thread, each to its end. ROS 2's refills its **ready set** only when that is
# empty (Casini and others, 2019): a callback may wait for all others, whatever its rate.

# %%
predict("camera_callback")

# %%
works = [Work("control", 0.001, 0.050), Work("camera", 0.025, 0.033, "subscription")]
apart = [replace(work, group=work.name) for work in works]
rng = np.random.default_rng(1)
for name, some, order, threads in (
    ("one thread, ready set", works, "ready set", 1),
    ("one thread, first in first out", works, "fifo", 1),
    ("a group and a thread each", apart, "ready set", 2),
):
    phases = rng.random((8, 2))
    largest = max(respond(some, order, threads, tuple(p), 5.0)["control"].max() for p in phases)
    bound = bounds(some, order, threads)["control"]
    print(f"{name:<32}control at most {1e3 * largest:5.2f} ms, bound {1e3 * bound:5.2f}")

# %% [markdown]
# ![Longest wait of a control callback behind a camera's, in three orders](../docs/charts/executor_waits.png)
#
# A **callback group** says who may run beside whom: of an exclusive one, the default, one at a time; of a reentrant
# one, any number.

# %%
show("not_real_time_by_default")

# %% [markdown]
# One can also wait for itself:

# %%
bus = Bus()
node = bus.node("planner", Executor(bus, 2))
node.service("grasp", lambda request: request)
client = node.client("grasp")


def tick():
    yield client.call("which hand?")


node.timer(0.1, tick)
bus.run(0.5)
print(*(textwrap.fill(one, 96, subsequent_indent="    ") for one in deadlocks(bus)), sep="\n")

# %% [markdown]
# The timer holds the group that the answer needs.

# %%
show("threads_cure_deadlock")

# %%
show("callback_over_a_period")

# %%
show("callback_sets_the_rate")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Late and silent are different faults. Between ends of one topic and type silence is a contract that
# was not met: compare two profiles. Lateness is a queue: name it, and compute its bound before you measure. The cache's
# depth, the link's rounds, the executor's other callbacks, the core's other tasks; what has no bound is the fault.
#
# </div>
#
# ## 3 · Design: one stack, edge by edge
#
# <div class="alert alert-block alert-info">
#
# **Interview question.** *Camera at 30 Hz, planner at 10 Hz, controller at 1 kHz. Draw the nodes, and say the quality
# of service of every edge.*
#
# Answer aloud, then go on: the sketch is the simulation above, the policies are the table, the numbers the cells.
#
# </div>
#
# <table>
# <tr><th>edge</th> <th>policies</th> <th>because</th></tr>
# <tr><td>camera → perception</td> <td>best effort, depth 1, one process if it can be</td> <td>only the newest
# counts: a repaired picture comes a round trip later, when a newer one is due. It is the age that repair costs, hardly
# any packets</td></tr>
# <tr><td>perception → planner</td> <td>depth 1, deadline of three periods</td> <td>a stale scene must be
# noticed</td></tr>
# <tr><td>planner → controller</td> <td>reliable, depth 1, a whole timed trajectory</td> <td>nothing follows soon
# that would replace it; the controller interpolates</td></tr>
# <tr><td>controller → drives</td> <td>no middleware: one thread</td> <td>a missed period is a physical
# fault</td></tr>
# <tr><td>monitor → controller, screen</td> <td>reliable, transient local, depth 1, with a lease</td> <td>who comes
# later must know; who hears nothing must stop</td></tr>
# </table>

# %%
rows = {
    "as asked": [
        Stage("camera", 0.005, 1 / 30),
        Stage("perception", 0.020),
        Stage("planner", 0.040, 0.1),
        Stage("controller", 1e-4, 1e-3),
    ],
}
rows["planner starts on arrival"] = [
    *rows["as asked"][:2],
    Stage("planner", 0.030),
    rows["as asked"][3],
]
rows["controller at 100 Hz"] = [*rows["as asked"][:3], Stage("controller", 1e-4, 1e-2)]
rows["depth 10, slow perception"] = [
    rows["as asked"][0],
    Stage("perception", 0.050, depth=10, overload="queue"),
    *rows["as asked"][2:],
]
moments, rng = np.linspace(2.0, 2.9, 901), np.random.default_rng(0)
PARTS = {
    "executions": "#5c6bc0",
    "picture waits": "#ef6c00",
    "scene waits": "#2e7d32",
    "plan waits": "#c62828",
    "command in force": "#9e9e9e",
}
figure_, axis = plt.subplots(figsize=(8, 2.0), layout="constrained")
print(f"{'age at the drives [ms]':<28}{'least':>8}{'mean':>8}{'most':>8}{'on the bus':>14}")
for name, stages in rows.items():
    output = age(stages)
    runs = (run_chain(stages, p, seconds=3.0) for p in rng.random((16, len(stages))))
    ages = 1e3 * np.mean([one.age(moments).mean() for one in runs])
    times = "".join(f"{1e3 * x:8.1f}" for x in (output.least, output.mean, output.greatest))
    print(f"{name:<28}{times}{ages:14.1f}")
    remaining, work = 0.0, 1e3 * sum(stage.execution for stage in stages)
    parts = (work, *(1e3 * x for x in output.waits))
    for (label, colour), part in zip(PARTS.items(), parts, strict=True):
        _ = axis.barh(name, part, left=remaining, color=colour, label="" if axis.texts else label)
        remaining += part
    _ = axis.text(remaining, name, f" {remaining:.0f}", va="center", fontsize=8)
_ = axis.set(xlabel="mean age [ms]", xlim=(0, 560))
axis.invert_yaxis()
_ = axis.legend(fontsize=7, loc="upper right")
plt.show()

# %%
STREAMS = {"VGA colour": (640, 480, 3, 30), "720p colour, depth": (1280, 720, 5, 30)}
for name, shape in STREAMS.items():
    size, rate, packets = transport.stream(*shape)
    print(f"{name:<20}{size / 1e3:8.0f} kB, {rate / 1e6:6.1f} MB/s, {packets} packets a picture")
C, T = np.array([1e-4, 20e-3, 40e-3]), np.array([1e-3, 1 / 30, 0.1])
for output, some in {
    "controller, perception, planner on one core": [0, 1, 2],
    "controller and planner, perception elsewhere": [0, 2],
}.items():
    ends = ", ".join(f"{1e3 * x:.1f}" for x in response_times(C[some], T[some]))
    print(f"{output}: utilization {float(utilization(C[some], T[some])):.2f}, responses {ends} ms")

# %% [markdown]
# Computed is one thing. Ten pictures each, written at once on Cyclone DDS, from Python to another process on this
# machine:

# %% tags=["nbval-ignore-output"]
try:
    from course.oracles.slow_reader import flood

    for (name, shape), how in zip(STREAMS.items(), ("reliable", "best_effort"), strict=True):
        size, rate, _ = transport.stream(*shape)
        came = flood(size, 10, 10, reliability=how)
        print(
            f"{name}, {how}: {came.received} of 10 came, {came.through / 1e6:.0f} MB/s (asked "
            f"{rate / 1e6:.0f})"
        )
except ImportError as missing:
    print(missing)

# %% [markdown]
# A picture that is larger than the socket's receive buffer loses packets on a cable that loses none, and then best
# effort loses the picture.

# %%
show("gigabit_is_enough")

# %% [markdown]
# The planner's clock is the dearest edge: start it on arrival, if it is done before the next picture. (A mean on the
# bus is that of sixteen draws of phases.) 720p colour with depth, uncompressed, is more than a gigabit a second
# carries: one process, or a compressed stream. And one core is not enough: what it lacks, the least urgent lacks
# altogether.
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** Show the hierarchy of constraints, and a number for each. *"Torque at 1 kHz in a thread of its own:
# SCHED_FIFO, Linux's real-time scheduling, locked memory, nothing allocated; I look at the worst lateness under load,
# against what the loop's phase margin bears. The planner at 10 Hz may be late: the controller interpolates, and comes
# to rest at its trajectory's end. Perception keeps one picture, so that a slow frame is replaced, not queued: that is
# the depth, not best effort."*
#
# </div>
#
# ### The launch file, and what it sets

# %%
predict("five_comments")

# %% [markdown]
# A usual launch file starts five nodes, with comments that say rates and policies. Run against stand-ins of `launch`
# and `launch_ros`, which keep what is set:

# %%
usual, ours = (launch.nodes(text) for text in (launch.USUAL, launch.OURS))
for node in usual:
    total = len(launch.overrides(node.parameters))
    print(f"{node.executable:<12}{node.parameters!s:<34}policies set: {total}")

# %%
Markdown(f"```python\n{launch.OURS.strip()}\n```")

# %% [markdown]
# What was decided, and what it costs:
#
# * *Processes.* A crash of perception leaves the controller alive. That it *holds position* is not a gift of the
#   process: somebody has to say what happens when the plan ends. Camera and perception apart cost a copy of each
#   picture.
# * *The controller* belongs to ros2_control's manager, whose rate and thread priority are parameters (manual, Jazzy
#   2024: `update_rate`, `thread_priority`, 50 by default). `rate: 1000` of a node of one's own sets whatever its
#   author reads, or nothing.
# * *Policies* from outside, `qos_overrides` (since Galactic, 2021), name by name, times in whole nanoseconds. A node
#   has to allow them: by default history, depth and reliability.
# * *Names* belong to a version. `depth_module.profile` set a RealSense camera's depth stream up to version 4.54 of its
#   driver, `realsense2_camera`; since 4.55.1 (May 2024) that is `depth_module.depth_profile`. A name that the node does
#   not declare is ignored, without a word (rclcpp, `NodeOptions`).
# * *Tuned at run time* is only what a node reads again, or asks to be told of.

# %%
for node in ours:
    for (topic, end), qos in launch.overrides(node.parameters).items():
        unlike = [v for k, v in vars(qos).items() if v != getattr(QoS(), k) and isinstance(v, str)]
        times = [
            f"{k.removeprefix('liveliness_').split('_')[0]} {1e3 * v:g} ms"
            for k, v in vars(qos).items()
            if v != getattr(QoS(), k) and isinstance(v, float)
        ]
        print(f"{node.executable:<18}{topic:<15}{end:<13}{', '.join([*unlike, *times])}")
print("silent topics:", launch.silent(ours) or "none")
needed = sorted({name for node in ours for name in launch.to_be_allowed(node.parameters)})
print("to be allowed in the nodes' source:", ", ".join(needed))
broken = launch.OURS.replace(
    'qos("/safety/status", "publisher", STATUS)',
    'qos("/safety/status", "publisher", {"reliability": "reliable"})',
)
print("with the monitor's offer left at default:", launch.silent(launch.nodes(broken)))

# %%
gains = launch.Parameters({"stiffness": 1000.0})
copied = gains.declare("stiffness", 500.0)
gains.set("stiffness", 200.0)
print(f"the controller's copy {copied:g}, the parameter {gains.value['stiffness']:g}")

# %%
show("launch_comments")

# %%
show("parameters_are_tunable")

# %%
show("processes_isolate")

# %% [markdown]
# ## 4 · Code
#
# Who hears whom takes twelve lines, and each line is a row of the table above:

# %%
Markdown(f"```python\n{inspect.getsource(compatible)}```")

# %% [markdown]
# ### The controller in C++
#
# From the file itself, in the shape that ros2_control's controllers have: sizes are checked when it is configured, and
# `update` neither allocates nor locks.

# %%
cpp = Path(controller.SOURCE).parent
whole = (cpp / "arm_controller.cpp").read_text()
update = whole[whole.index("  controller_interface::return_type update") : whole.index("\nprivate")]
folded = f"<details><summary>The whole file</summary>\n\n```cpp\n{whole}```\n\n</details>"
Markdown(f"```cpp\n{update}```\n\n{folded}")

# %% [markdown]
# The common form computes inside a subscription's callback. Both are compiled with a sanitizer, which checks each
# access to memory as it runs:

# %%
common = (cpp / "callback_controller.cpp").read_text()
body = common[common.index("  void on_joint_state") : common.index("\nprivate")]
Markdown(f"```cpp\n{body}```")

# %%
predict("six_positions")

# %% [markdown]
# <details><summary>Five things that are wrong with it</summary>
#
# It runs when a message comes: at the publisher's rate, in bunches if that bunches, not at all if it stops. It
# allocates twice a call. It trusts the message: seven joints read beyond the targets, and a joint state without
# velocities, which the message allows, reads what is not there. Nothing limits a torque.
#
# And a comment that calls it a lifecycle node makes it none: what derives from `rclcpp::Node` has no states, and runs
# as soon as it is made. One with states (unconfigured, inactive, active, finalized) derives from
# `rclcpp_lifecycle::LifecycleNode` (documentation of rclcpp_lifecycle, Humble 2022).
#
# </details>

# %% tags=["nbval-ignore-output"]
rng, six = np.random.default_rng(2), 6
first = [*(rng.uniform(*ends, six) for ends in ((-1, 1), (50, 100), (1, 9))), np.full(six, 80.0)]
states = rng.uniform(-1, 1, (50, 2 * six))


def message(positions, velocities):
    return [positions, *[0.1] * positions, velocities, *[0.0] * velocities]


if controller.compiler() is None:
    print(f"not run here, as {controller.NO_COMPILER}")
    print("the card below shows the figures from the stored record")
else:
    with tempfile.TemporaryDirectory() as folder:
        program = controller.build(Path(folder))
        good = controller.drive(program, "update", first, states)
        torques = [controller.torques(s[:six], s[six:], *first) for s in states]
        gap = np.abs(np.array(good.torque) - torques).max()
        took_ = sum(good.allocations)
        print(f"largest difference from Python {gap:.1e} N m, allocations in update {took_}")
        sizes = {"six joints": (6, 6), "seven joints": (7, 7), "no velocities": (6, 0)}
        for name, row in sizes.items():
            bad = controller.drive(program, "callback", [np.zeros(six)], [message(*row)])
            report = bad.report.split(" on ")[0] or f"{sum(bad.allocations)} allocations"
            print(f"callback, {name:<16}{textwrap.shorten(report, 70)}")

# %%
show("any_joint_message")

# %% [markdown]
# Bad input, and what is said of it:

# %%
for attempt in (
    lambda: QoS("best effort"),
    lambda: QoS(deadline=-1.0),
    lambda: Link(loss=1.0),
    lambda: launch.overrides({"qos_overrides./image.publisher.dept": 1}),
    lambda: launch.overrides({"qos_overrides./image.publisher.deadline": 0.1}),
    lambda: bounds([replace(w, group=w.name) for w in [*works, Work("log", 1e-3, 1.0)]], threads=2),
):
    try:
        print(attempt())
    except ValueError as problem:
        print(textwrap.fill(str(problem), 96, subsequent_indent="    "))

# %% [markdown]
# ## 5 · The simulation in full
#
# Choose a topic, and what each of its ends says. Width of an edge is its rate, yellow a topic, blue a service, red a
# pair that is silent, with the policy that fails; the node with the red border has to be in time. Below: who has the
# processor, and the age of the command in force. *Deep queue*: what becomes of the age if the reader keeps one?

# %%
simulation("middleware", "Deep queue")

# %% [markdown]
# ### What to break
#
# Each preset, with what the theory says before it runs:

# %%
from course.simulations.middleware import CAMERA, HOLD, LOOP, PACKETS, SEEING

slow, once = SEEING / 0.4, SEEING / 0.7
broken_rows = {
    "Mismatch": ("best effort offered, reliable requested", "silence",
        f"fails: {', '.join(compatible(QoS('best_effort'), QoS()))}"),
    "Lossy wire": ("one packet of a thousand", "pictures are missing",
        f"{transport.expected_loss(PACKETS, 1e-3):.0%} of the pictures; reliable: "
        f"{transport.expected_rounds(PACKETS, 1e-3):.2f} rounds"),
    "Deep queue": ("perception slower than the camera, depth 10", "all commands are old",
        f"{10 - 1} periods of the camera of {1e3 * CAMERA:.0f} ms, {9e3 * CAMERA:.0f} ms"),
    "Overload": ("the loop in perception's thread", "ticks late, ticks skipped",
        f"late by up to {1e3 * (once + LOOP):.1f} ms"),
    "Inversion": ("the logger's lock", "the loop waits for perception",
        f"{1e3 * HOLD:.0f} ms and a picture's {1e3 * SEEING:.0f}; with inheritance {1e3 * HOLD:.0f}"),
    "Late monitor": ("volatile, published once", "blind to the zone", "kept for later at both ends"),
}  # fmt: skip
Markdown(
    "\n".join(
        [
            "| What to break | How | What happens | Its limit, computed |",
            "|---|---|---|---|",
            *(f"| {name} | {' | '.join(cells)} |" for name, cells in broken_rows.items()),
        ]
    )
)

# %% [markdown]
# ## 6 · Speed against accuracy
#
# There and back between two processes, by size, in units of the floor: 64 bytes through a queue between two threads.
# What is *accurate* here is the same for all: the bytes that come back.
#
# ![Round trips by size: threads, socket, shared memory, zenoh, Cyclone DDS](../docs/charts/round_trips.png)

# %%
print_figures("round_trips", "threads", "Unix", "shared", "zenoh", "Cyclone")

# %% [markdown]
# Read it from the left: for small messages the carriers differ by what they do besides, waking a thread of their own,
# counting, asking again.
#
# Read it from the right: each copy costs, and a datagram is 64 kB at most. Up to a picture the
# dearest curve is neither the network nor DDS: `sequence[uint8]` makes an object of Python of each byte. Declare
# `array[uint8, n]`. The last step of Cyclone's other curve is steeper than its size: 4 MB are more than the socket's
# receive buffer holds, and part of them is sent again.
#
# *What to pick.* In one process, hand over a pointer. On one machine, shared memory for what is large. Across machines,
# whatever the fleet speaks; then compute bandwidth and packets first. No carrier makes an old picture new.

# %%
show("command_waits_for_picture")

# %% [markdown]
# ### How fast are our own tools?

# %% tags=["nbval-ignore-output"]
bus, count = Bus(), 20_000
writer = bus.node("a").writer("x")
bus.node("b").reader("x", lambda sample: None)
bus.node("a").timer(1e-3, lambda: (writer.publish(0), None)[1])
begun = perf_counter()
bus.run(count * 1e-3)
print(f"bus: {count / (perf_counter() - begun):,.0f} messages/s, timer and callback included")
sets = schedule.random_sets(8, 0.9, 1000, np.random.default_rng(3))
begun = perf_counter()
_ = response_times(*sets)
print(f"response times of 1,000 sets of 8 tasks: {1e3 * (perf_counter() - begun):.1f} ms")

# %% [markdown]
# The smallest model that does: the bus knows no processes, no copies, no discovery, and its acknowledgements are not
# lost. What the verdicts, depths and events lose by that is nothing (the table above); what times lose is the left side
# of the picture.
#
# ## 7 · Debug: where it fails
#
# ### Six hundred packets
#
# A picture goes out in **fragments**, packets that must all arrive. Reliable readers send a
# **negative acknowledgement**, the numbers of what they lack, and those are sent again.

# %%
predict("one_in_ten_thousand")

# %% [markdown]
# With a loss $p$ of a packet, a message of $n$ is lost with probability $1 - (1 - p)^n$, if each packet is lost for
# itself. Sent again it takes rounds, once there and, if something is missing, back: $\sum_k 1 - (1 - p^k)^n$ of them in
# the mean, from $k = 0$ on.
#
# ![Lost messages and rounds over packets, theory beside bus and socket](../docs/charts/lost_fragments.png)

# %%
print_figures("lost_fragments", "lost", "socket")

# %%
show("reliable_resends_all")

# %% [markdown]
# ### Late, or lost?
#
# A servo follows commands, one each 10 ms, of which a twentieth is lost. Sent again they come late, and those behind
# them wait; not sent again, the next replaces them. Which is nearer to the truth?

# %%
predict("late_or_lost")

# %% [markdown]
# ![Tracking error that the loss adds, over the delay of the link, both reliabilities](../docs/charts/late_or_lost.png)

# %%
print_figures("late_or_lost", "lost", "sent")

# %% [markdown]
# They cross where a round costs about as much as a period. On a quick link reliable is better for a command, too; on a
# slow one it is far worse. So "control needs reliable" is a statement about a link. What is said *once*, a goal, a
# change of mode, a stop, has no next one: that is what reliable is for.

# %%
show("joint_states_reliable")

# %% [markdown]
# ### A loop among busy processes
#
# 1 kHz beside four processes that always compute, on two cores; all in Python:
#
# ![Lateness of a loop beside busy processes, and the drift of a relative sleep](../docs/charts/loop_lateness.png)

# %%
print_figures("loop_lateness", "default", "nice", "SCHED_FIFO", "sleep")
for one in stored("loop_lateness")[0].series:
    late_ = 1e-3 * np.interp(0.99, one.x, one.y)
    print(
        f"{one.label:<12}gains up to {delay_limit(0.5, 0.5, late_ + 0.5e-3)[0]:7.1f} N m/rad are stable"
    )

# %% [markdown]
# (Chapter 6's joint under P control, as if each cycle were as late as the worst hundredth of those that ran.) The
# ordinary scheduler is fair, and that is what is wrong with it: the loop had its share, in slices. With `nice -20`, the
# largest share, fewer periods were skipped, not none. Asking is not getting. `SCHED_FIFO` is the class of tasks that
# run before all ordinary ones, highest priority first. Here and now this process is granted:

# %% tags=["nbval-ignore-output"]
with loop.urgent() as granted:
    no = textwrap.shorten("; ".join(f"{k}: {v}" for k, v in granted.denied.items()), 80)
    print(
        f"scheduler {granted.scheduler}, priority {granted.priority}, "
        f"memory locked: {granted.locked}; refused: {no or 'nothing'}"
    )

# %% [markdown]
# What is left even then: a page fault, a garbage collection, a lock, interrupts, tasks under SCHED_DEADLINE, and
# **real-time throttling**: by default Linux gives real-time tasks 950 ms of each second
# (`/proc/sys/kernel/sched_rt_runtime_us`), so a FIFO loop that spins is stopped for the other 50. A real-time kernel
# does not take these away. *PREEMPT_RT* is
# a configuration of the Linux kernel, which makes most of it interruptible; Xenomai's *Cobalt* is a second kernel
# beside Linux, with threads of its own (Xenomai 3 documentation). Neither makes a thread real-time that allocates,
# faults or has no priority.

# %%
show("gc_hits_the_loop")

# %%
show("fifo_makes_real_time")

# %% [markdown]
# ### Debugging
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *Messages arrive late.* It is no mismatch: that makes silence. Put four stamps on a message:
# capture, publishing, reception, start of the callback. The largest difference names the place.
#
# <details><summary>What people get wrong there</summary>
#
# They stamp when they publish, and everything before is hidden. Or they look at the policies (`ros2 topic info -v`
# shows them) for an hour, find them alike, and change both to reliable: then loss becomes lateness, too.
#
# </details>
#
# </div>
#

# %%
show("mismatch_is_late")

# %% [markdown]
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The controller is jittery.* Record three times a cycle: asked for, woken, done. `use_sim_time`
# measures nothing; it chooses a clock. A callback that takes less than a period is not enough: it waits for others'.
#
# <details><summary>What people get wrong there</summary>
#
# They ask for real-time priority and don't read back what was granted. Or they look at the mean period, which is right
# to the microsecond in a loop of bunches and gaps.
#
# </details>
#
# </div>
#
# <table>
# <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr>
# <tr><td>nothing arrives, nobody complains</td> <td>a policy is offered weaker than requested; or another topic, type
# or domain</td> <td>listen to the events of both ends; compare two profiles</td> <td>raise the offer, or lower the
# request</td></tr>
# <tr><td>messages late by whole periods</td> <td>a full queue</td> <td>set depth to one</td> <td>depth one; or a
# reader that takes all and uses the newest</td></tr>
# <tr><td>late, and later the larger they are</td> <td>serialising, or fragments sent again</td> <td>a small payload;
# then the same over loopback</td> <td>another type, one process, shared memory, compression</td></tr>
# <tr><td>late between reception and callback</td> <td>the executor: somebody else runs</td> <td>time each callback,
# add them up</td> <td>an own group and thread, or process</td></tr>
# <tr><td>jitter grows with load</td> <td>ordinary scheduling, or an own lock</td> <td>read back class, core,
# memory; busy processes beside it</td> <td>SCHED_FIFO as granted; inheritance; no lock in the loop</td></tr>
# <tr><td>period too long by a constant</td> <td>a relative sleep</td> <td>drift over a thousand periods</td>
# <td>absolute releases</td></tr>
# <tr><td>a screen that starts late stays empty</td> <td>volatile, or one end only</td> <td>start it first</td>
# <td>transient local at both ends; unknown counts as unsafe</td></tr>
# </table>
#
# ## 8 · Exercises
#
# Graded exercises. `check` asks your cell on cases drawn afresh, and says what is wrong and, if it can, why.

# %% [markdown]
# ### Will these two talk?

# %%
card("compatible")


# %%
def compatible(offered, requested):
    """Return the policies for which a writer offers less than a reader requests.

    Args:
        offered, requested: reliability, durability, deadline [s], liveliness, lease [s],
            destination order and ownership of each end, shape (7,); a time of 0 is none.

    Returns:
        1 where reliability, durability, deadline, liveliness with its lease, destination order or
        ownership fails, else 0, shape (6,).
    """
    # As if both ends had to say the same.
    unlike = np.asarray(offered) != np.asarray(requested)
    return unlike[[0, 1, 2, 3, 5, 6]].astype(int)


check(compatible)

# %% [markdown]
# ### The last few, while they are fresh

# %%
card("keep_last")


# %%
def keep_last(stamps, arrivals, reads, depth, lifespan):
    """Return what a reader takes out of a cache of the last messages with a lifespan.

    Args:
        stamps: when each message was written, shape (n,) [s].
        arrivals: when it arrived, rising, (n,) [s].
        reads: when the cache is emptied, rising, (m,) [s].
        depth: how many messages it holds.
        lifespan: age from which a message is gone [s]; 0 for none.

    Returns:
        (numbers of the messages of each read in the order of arrival, then -1, shape (m, depth);
        how many were pushed out by later ones).
    """
    # Every read takes what has come since the one before, as far as there is room for it.
    taken, edges = np.full((len(reads), depth), -1), [-np.inf, *reads]
    for row in range(len(reads)):
        new = [k for k, at in enumerate(arrivals) if edges[row] < at <= edges[row + 1]][:depth]
        taken[row, : len(new)] = new
    return taken, len(arrivals) - int(np.sum(taken >= 0))


check(keep_last)

# %% [markdown]
# ### One in ten thousand, six hundred times

# %%
card("fragment_loss")


# %%
def fragment_loss(size, payload, loss):
    """Return a message in fragments over a link that loses some.

    Lost, or sent again until all are there.

    Args:
        size: of the message [byte].
        payload: bytes of it that one fragment carries.
        loss: probability that a fragment is lost, below 1, each independently.

    Returns:
        (probability that at least one is lost when each is sent once, mean number of rounds until
        none is missing, mean number of fragments sent in these).
    """
    # As if the message were one fragment.
    return loss, 1.0 / (1.0 - loss), 1.0 / (1.0 - loss)


check(fragment_loss)

# %% [markdown]
# ### The worst day of every task

# %%
card("response_times")


# %%
def response_times(executions, periods, deadlines, blocking):
    """Return the longest response times of periodic tasks on one processor that can be interrupted.

    Args:
        executions, periods: of each task, the most important first, shape (n,) [us].
        deadlines: after its release, at most its period, (n,) [us].
        blocking: longest time for which a less important task holds what this one needs, (n,) [us].

    Returns:
        Of each task, -1 where it can miss its deadline, shape (n,) [us].
    """
    # As if everybody ran once.
    responses = np.cumsum(executions) + np.asarray(blocking)
    return np.where(responses <= np.asarray(deadlines), responses, -1)


check(response_times)

# %% [markdown]
# ### When to wake up next

# %%
card("wake_ups")


# %%
def wake_ups(start, period, late, work):
    """Return when a periodic loop asks to be woken, and how many of its periods it has to skip.

    Args:
        start: of the first period [ns].
        period: [ns].
        late: how long after the time asked for each cycle really begins, shape (n,) [ns].
        work: how long it then works, (n,) [ns].

    Returns:
        (time that each cycle asked for (n,) [ns], periods skipped right after it (n,)).
    """
    # Work, then sleep for a period.
    spent = np.cumsum(np.asarray(late) + np.asarray(work) + period)
    return start + np.concatenate(([0], spent[:-1])), np.zeros(len(spent))


check(wake_ups)

# %% [markdown]
# ### Silent-bug hunt
#
# Two nodes, each right on the bench of its author.

# %%
card("follow_part")


# %%
def follow_part(frames, saves, work, late, period, deadline, drift, ticks):
    """Return what a drive is told by two nodes, (m,) [m]; the task's table says what goes in."""
    # The camera's node: callbacks of one group wait for each other.
    rows = np.asarray(frames, dtype=float)
    calls = [(row[1], 0, work, number) for number, row in enumerate(rows)]
    calls += [(row[0], 1, row[1], -1) for row in np.asarray(saves, dtype=float)]
    free, published = [-np.inf, -np.inf], []
    for time, kind, lasts, number in sorted(calls):
        group = 0
        free[group] = max(time, free[group]) + lasts
        if kind == 0:
            published.append((free[group], free[group], rows[number, 2]))
    # The controller's node: a loop that carries the newest place on to its present.
    sent = []
    wake_up = 0.0
    for lateness in np.asarray(late, dtype=float):
        now = wake_up + lateness
        here = [message for message in published if message[0] <= now]
        if here and now - here[-1][1] <= deadline:
            sent.append((now, here[-1][2] + drift * (now - here[-1][1])))
        wake_up = now + period
    # The drive: one command a tick.
    depth, command, came = 10, 0.0, 0
    queue = []
    driven = np.zeros(len(np.asarray(ticks)))
    for i, tick in enumerate(np.asarray(ticks, dtype=float)):
        while came < len(sent) and sent[came][0] <= tick:
            queue = [*queue, sent[came][1]][-depth:]
            came += 1
        if queue:
            command = queue.pop(0)
        driven[i] = command
    return driven


check(follow_part)

# %% [markdown]
# ### A formula: a message of twelve packets
#
# Any equivalent form is right. <span class="kernel-only">Change the text.</span>

# %%
answer("picture_lost_like_packet", "12*p")

# %% [markdown]
# ## 9 · Frontier: fewer nodes, the same clocks
#
# *What changes below*, by its makers' documents:
#
# * Zenoh under ROS 2 (`rmw_zenoh`, packages for Humble and Jazzy since January 2025): a router in place of multicast
#   discovery, services without topics. Its design document knows no incompatible policies, so that a pair that is
#   silent on DDS is heard, and says that deadline and lifespan are not implemented.
# * **Zero-copy** transports (Eclipse iceoryx; loaned messages): a reader looks where the writer wrote, and time no
#   longer goes with size, if the type has a fixed one.
# * Event executors (`EventsExecutor`, Iron 2023): first in, first out in place of the ready set. The bound above is the
#   same sum.
# * PREEMPT_RT in the mainline kernel (Linux 6.12, November 2024; x86, ARM64, RISC-V): no patch any more. Which task is
#   how urgent is still yours to say.
#
# *What changes above.* A policy from pixels to actions replaces perception, planner and some of the controller. Its
# rate is low; an **action chunk**, several actions at once, fills the time until the next. What does that hide?

# %%
predict("chunk_hides")

# %%
think, step = 0.1, 0.02
print(f"{'actions a chunk':<18}{'moves':>8}{'mean age':>12}{'on the bus':>12}{'most':>8}  [ms]")
camera = Stage("camera", 0.005, 1 / 30)
for n in (1, 5, 10):
    stages = [camera, Stage("policy", think, max(think, n * step)), Stage("arm", 1e-4, step)]
    output = age(stages)
    draws = np.random.default_rng(n).random((16, 3))
    run_ = [run_chain(stages, p, seconds=3.0).age(moments).mean() for p in draws]
    share = min(1.0, n * step / stages[1].period)
    ages = (output.mean, np.mean(run_), output.greatest)
    print(f"{n:<18}{share:8.0%}" + "{:12.0f}{:12.0f}{:8.0f}".format(*(1e3 * x for x in ages)))

# %%
show("chunks_hide_latency")

# %%
show("seven_billion_on_board")

# %% [markdown]
# A chunk hides the *pause*, not the age: the arm moves all the time, on pictures that are no newer, and under longer
# chunks older. The last action of a chunk rests on a picture as old as inference and chunk together. So the loop that
# must react stays below, at its own rate, and edges to policy and drives keep their deadlines.
#
# ## 10 · Interview
#
# Answer aloud, then open: first what one says in a minute, then the whole of it, then what comes next.

# %%
interview("middleware")

# %% [markdown]
# ### Checkpoint
#
# *In your own words: your arm jerks now and then, and the log of its commands has gaps. What do you measure first,
# second, third, and what would make you change your mind?* Write it down first; then unfold.

# %%
mine = ""
print("written" if len(mine.split()) > 30 else "open: thirty words or more")

# %% [markdown]
# <details><summary>An answer, from this chapter's figures</summary>
#
# *First* where the gap is: four stamps on each command, three times a cycle of the loop. A gap between woken and done
# is mine: a lock, a page, a collector, a print. One before waking is the scheduler's, and I read back what was granted.
#
# *Second* what I would have predicted: response times of all that shares the core, the sum of the callbacks that share
# the thread, blocking by locks. A gap larger than that says that something is missing from my list.
#
# *Third* the same under load, with busy processes. I'd change my mind about the loop if its cycles are on time and the
# commands rest on an old picture: then it is a queue upstream, and the loop is innocent.
#
# </details>
#
# Three formulas that are not on this page; you can derive them from what is. The gate opens when all are right.

# %%
checkpoint("middleware", best_effort_is_fresh="", liu_layland_says_no="", jitter_below_a_period="")
