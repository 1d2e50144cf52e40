# %% [markdown]
# # 10 · Middleware and real time
#
# *A camera node publishes thirty images a second. The node that should find objects in them receives none. Nothing has
# crashed, and no cable is loose. How can that happen? Guess first.* About {open minutes} minutes of reading, cards and
# charts. The folded parts add {folded minutes} minutes, the exercises {exercise minutes} minutes. (The interview's
# answers are not counted.)

# %%
from course.cards import predict
from course.simulations import simulation

predict("silent_pair")

# %% [markdown]
# ![A graph of nodes and topics](attachment:middleware.png)

# %%
simulation("middleware")

# %% [markdown]
# In the picture, boxes are nodes, the parts of the robot's software, and lines are connections. A yellow line carries a
# stream of messages; the thicker it is, the more messages per second. A blue line is a request with a reply. A red line
# (none at the start) connects nothing, because its two ends disagree. The selected node is orange; the list at the
# right shows what it receives (left arrow) and sends (right arrow). The red frame marks the node that must never be
# late. The numbers have tooltips.
#
# **You will be able to** decide whether a publisher and a subscriber are compatible; predict how old a message is and
# how late a control loop runs; find out why messages are late or why a control loop runs at uneven intervals; and
# justify a design of nodes, rates and policies. **Know first:** the age of data from chapter 0, which is the time from
# taking an image until it has an effect.
#
# No ROS 2 installation is needed. The examples run on a small simulated message bus that imitates DDS, the system below
# ROS 2. It has its own simulated clock, and every run of it is identical. We checked its compatibility rules against a
# real DDS, Eclipse Cyclone.

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint, your_robot

badges(10)

# %% tags=["hide-code"]
import inspect
import re
import tempfile
import textwrap
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown, display

from course.cards import figures, interview
from course.charts import read, stored
from course.control.sampled import delay_limit
from course.derivations import more_claims, show
from course.middleware import controller, launch, loop, schedule, transforms, transport
from course.middleware.bus import ActionClient, Bus, Group
from course.middleware.executor import Executor, Work, bounds, deadlocks, respond, run_chain
from course.middleware.qos import QoS, compatible
from course.middleware.schedule import hyperbolic, liu_layland, response_times, utilization
from course.role import Stage, age

BLUE, ORANGE, GREEN, GREY, RED = "#0072b2", "#e69f00", "#009e73", "#bdbdbd", "#c62828"


def table(*rows):
    """Return rows of text as a table; the first one is the head."""
    lines = [f"| {' | '.join(map(str, row))} |" for row in rows]
    return Markdown("\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]))


def timeline(axis, rows, unit="ms"):
    """Draw intervals (start, end, colour) in one row for each name, the first name on top."""
    for k, spans in enumerate(rows.values()):
        for begin, end, ink in spans:
            _ = axis.barh(-k, end - begin, 0.6, begin, color=ink, edgecolor="white", lw=0.4)
    axis.set_yticks(-np.arange(len(rows)), rows)
    _ = axis.set(xlabel=f"time [{unit}]", ylim=(0.6 - len(rows), 0.6))


# %% [markdown]
# ## 1 · Concept: publishers, subscribers and their contract
#
# ### What middleware is
#
# A robot's software often consists of many programs that run at different rates on different computers. **Middleware**
# is the layer that carries messages between them, so that no program needs to know where the others run. **ROS 2** is a
# widely used one. By default it is built on **DDS** (Data Distribution Service), a standard with several
# implementations.
#
# A **node** is a software component with a name. It publishes messages, subscribes to messages of other nodes and
# answers requests. A named stream of messages is a **topic**. The publisher's end of a topic is called a **writer** in
# DDS, and the subscriber's end a **reader**. **Discovery** is how writers and readers of the same topic find each
# other: each announces itself on the network.
#
# A **callback** is a function of yours that runs at an **event**, such as the arrival of a message or the end of a
# timer's period.
#
# Robot software usually has three layers, which differ in what happens when a result is late:

# %% tags=["hide-code"]
layers = {
    "Behaviour, 1-10 Hz": "state machines, behaviour trees: choose the next action\n"
    "if late: the robot hesitates",
    "Perception and planning, 10-100 Hz": "find objects, plan motions: soft real time\n"
    "if late: the result is older",
    "Real-time thread, 1 kHz": "read encoders, compute torques, write them: hard real time\n"
    "if late: old torques act on; the arm can shake",
}
crossing = (
    "down: goals, as actions; up: feedback",
    "down: newest trajectory, without a lock; up: joint states",
)
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

# %% [markdown]
# The top layer decides what to do next, for instance "grasp the cup". State machines and behaviour trees are two ways
# of writing such decisions. The middle layer is **soft real time**: a late result is a worse result. The bottom layer
# is **hard real time**: it is designed so that no cycle is late, and a late cycle counts as a fault. It has a thread of
# its own. The planner passes new trajectories to this thread without ever making it wait.
#
# ROS 2 offers four ways to interact with a node: topics, services, actions and parameters. The drawing shows who sends
# what in the first three, with time running downwards:

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 3, figsize=(8, 2.6), layout="constrained")
talks = {
    "topic": [(1, 0, 0.1, "message"), (1, 0, 0.4, "message"), (1, 0, 0.7, "message")],
    "service": [(1, 0, 0.1, "request"), (0, 1, 0.6, "reply")],
    "action": [
        (1, 0, 0.1, "goal"),
        (0, 1, 0.35, "feedback"),
        (0, 1, 0.6, "feedback"),
        (0, 1, 0.85, "result"),
    ],
}
for axis, (name, arrows) in zip(axes, talks.items(), strict=True):
    source = "publisher" if name == "topic" else "client"
    for x, participant in ((0, source), (1, "subscriber" if name == "topic" else "server")):
        _ = axis.plot([x, x], [0, -1], color=GREY, lw=2)
        _ = axis.text(x, 0.06, participant, ha="center", fontsize=9)
    for forward, _back, at, word in arrows:
        begin, end = (0, 1) if forward else (1, 0)
        _ = axis.annotate(
            "", (end, -at - 0.08), (begin, -at), arrowprops={"arrowstyle": "->", "color": BLUE}
        )
        _ = axis.text(0.5, -at - 0.02, word, ha="center", va="bottom", fontsize=8.5)
    _ = axis.set(title=name, xlim=(-0.4, 1.4), ylim=(-1.05, 0.2))
    axis.axis("off")
plt.show()

# %% [markdown]
# The fourth, a **parameter**, is a named value that belongs to one node. The table's last column gives median times,
# measured with two Python threads. Each time begins with the call and ends when the topic's callback starts, when the
# reply of the service or the result of the action arrives, or when the node has read its own parameter.

# %% tags=["nbval-ignore-output", "hide-code"]
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
    "Topic": ("publish, subscribe; many to many", "streams: joint states, images"),
    "Service": (
        "request, reply; one server",
        "short requests: switch the gripper, get a parameter of another node",
    ),
    "Action": ("goal, feedback, result; can be cancelled", "what takes seconds: move to a pose"),
    "Parameter": (
        "names and values of one node",
        "configuration; the node reads it again, or registers a callback for changes",
    ),
}
table(
    ("concept", "pattern", "use", "median time here"),
    *(
        (
            name,
            *words,
            f"{1e6 * np.median(took[name]):.1f} us{' (own node)' * (name == 'Parameter')}",
        )
        for name, words in forms.items()
    ),
)

# %% [markdown]
# These are not times of ROS 2. A service is a request topic, a reply topic and a callback at the server, so the reply
# waits until the server has time for that callback. An action is made of services and topics.

# %% tags=["hide-code"]
more_claims("service_takes_five", "service_blocks", "topics_many_to_many", "node_is_a_process")

# %% [markdown]
# ### Offer and request: the quality of service
#
# Should a lost message be sent again? Should a subscriber that starts later receive old messages? Both ends of a topic
# have settings for this, together called **quality of service** (QoS). Each setting is a **policy**. A **profile** is
# one end's choice for all policies.
#
# * Reliability. *Reliable*: a message that the network loses is sent again. **Best effort**: it is not.
# * Durability. *Volatile*: nothing is stored for later subscribers. **Transient local**: the writer stores its last
#   messages as long as it lives. A **late joiner**, a reader that appears after they were written, still gets them
#   if both ends are transient local and reliable.
# * Deadline: the longest allowed time between two messages. Each time it passes after the first message, DDS raises an
#   event at the end that set it, as long as the writer exists.
# * **Liveliness**: how a writer proves that it is alive. The middleware does it (*automatic*), or the writer itself
#   sends a message or makes a call (*manual by topic*). Without such a sign for the length of its **lease**, the writer
#   counts as dead.
# * History and depth. With **keep last**, each end stores only the newest messages; the **depth** is how many. With
#   **keep all**, memory permitting, it stores every message until the reader has taken it.
# * **Lifespan**: the time after which a message is discarded, counted from sending or from arrival.
#
# The writer *offers*, the reader *requests*. Four of these policies are ranked: reliability, durability, deadline, and
# liveliness with its lease. If the writer offers less than the reader requests in any ranked policy, DDS does not
# connect the two. For times, shorter promises more: 50 ms offers more than 100 ms. History, depth and lifespan are not
# compared, so they never prevent a connection.

# %% tags=["hide-code"]
local = {"durability": "transient_local"}
grids = {
    "reliability": {"best effort": QoS("best_effort"), "reliable": QoS()},
    "durability": {"volatile": QoS(), "transient local": QoS(**local)},
    "deadline": {"none": QoS(), "100 ms": QoS(deadline=0.1), "50 ms": QoS(deadline=0.05)},
    "liveliness": {"automatic": QoS(), "manual by topic": QoS(liveliness="manual_by_topic")},
}
figure_, axes = plt.subplots(1, 4, figsize=(8.6, 2.3), layout="constrained")
for axis, (name, kinds) in zip(axes, grids.items(), strict=True):
    for i, offer in enumerate(kinds.values()):
        for j, request in enumerate(kinds.values()):
            fits = not compatible(offer, request)
            _ = axis.add_patch(
                plt.Rectangle((j, -i), 1, 1, fc="#c8e6c9" if fits else "#ffcdd2", ec="white", lw=2)
            )
            _ = axis.text(
                j + 0.5,
                0.5 - i,
                "works" if fits else "silent",
                ha="center",
                va="center",
                fontsize=8,
            )
    ticks = np.arange(len(kinds)) + 0.5
    axis.set_xticks(ticks, [one.replace(" ", "\n") for one in kinds], fontsize=8)
    axis.set_yticks(1 - ticks, [one.replace(" ", "\n") for one in kinds], fontsize=8)
    _ = axis.set(title=name, xlim=(0, len(kinds)), ylim=(1 - len(kinds), 1), xlabel="requested")
    axis.tick_params(length=0)
_ = axes[0].set_ylabel("offered")
plt.show()

# %% [markdown]
# A frequent case: a camera driver publishes with the best-effort profile for sensors, and a display tool subscribes
# with the reliable default. The tool's window stays empty. ROS 2 logs a warning ("incompatible QoS"), which is easy to
# overlook.

# %%
show("stronger_offer")

# %%
show("volatile_is_no_past")

# %% [markdown]
# Seven combinations, judged by our rule and by Cyclone DDS ("heard" means that the two ends connect):

# %% tags=["nbval-ignore-output", "hide-code"]
queried = {
    "best effort -> reliable": (QoS("best_effort"), QoS()),
    "reliable -> best effort": (QoS(), QoS("best_effort")),
    "volatile -> transient local": (QoS(), QoS(**local)),
    "transient local -> volatile": (QoS(**local), QoS()),
    "no deadline -> 0.1 s": (QoS(), QoS(deadline=0.1)),
    "deadline 0.05 s -> 0.1 s": (QoS(deadline=0.05), QoS(deadline=0.1)),
    "lease 2 s -> 1 s": tuple(QoS(liveliness_lease_duration=s) for s in (2.0, 1.0)),
}
try:
    from course.oracles.cyclonedds import verdicts

    observed = [
        f"silent: {one.reader}" if one.reader else "heard"
        for one in verdicts(list(queried.values()))
    ]
except ImportError as missing:
    print(missing)
    observed = ["not run"] * len(queried)
rows = [("offered -> requested", "our rule", "Cyclone DDS")]
for (name, pair), cyclone in zip(queried.items(), observed, strict=True):
    fails = ", ".join(compatible(*pair))
    rows.append((name, f"silent: {fails}" if fails else "heard", cyclone))
table(*rows)

# %% [markdown]
# We also ran a longer list of tests, both on the bus and on Cyclone: pairs of values of each policy, queue depths, late
# subscribers and events. Each test is a row of the table in the fold-out. The first line below counts the rows in which
# both agree. For lines 2 and 3 the writer paused five times for 0.12 s. With a deadline of 0.05 s, two deadlines pass
# in each pause, so ten events are raised at each end. The fold-out also lists policies that only DDS has.

# %% tags=["hide-code"]
figures(read("qos_verdicts"), "93", "deadline mis")

# %% [markdown]
# A topic can also be silent for other reasons. The two ends use different topic names or message types, or they are in
# different **domains**: each process takes a domain number from `ROS_DOMAIN_ID`, and discovery works only within one
# domain. Or the network blocks multicast (one packet that is sent to all members of a group), which discovery uses.
#
# <details><summary>Do DDS vendors differ?</summary>
#
# ROS 2's default profile fixes reliability, history, depth and durability. Other settings depend on the vendor, for
# instance the size of network buffers, or whether a lifespan counts from sending or from arrival (rmw and DDS tuning,
# ROS 2 documentation, Jazzy 2024).
#
# </details>

# %% tags=["hide-code"]
more_claims("reliability_both_ways", "deadline_for_deadline", "event_names_all")

# %% [markdown]
# ### Queues: what is stored, and how old it gets
#
# Each reader has a queue, and its depth $d$ is the number of messages that fit. With keep last, a new message that
# finds the queue full replaces the oldest one. This happens with both reliabilities: reliable delivery repairs losses
# on the network, not in the queue.
#
# The queue also decides how old the data are. A reader that is slower than its writer soon finds its queue full every
# time, and it takes the oldest message first. If the writer's period is $T$, the oldest of $d$ messages was written at
# least $(d - 1)\,T$ ago.

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(8, 1.8), layout="constrained")
for k in range(5):
    _ = axis.add_patch(
        plt.Rectangle((k, 0), 0.9, 0.9, fc="#bbdefb" if k else "#ffe0b2", ec="black")
    )
    _ = axis.text(k + 0.45, 0.45, f"{4 - k} T old" if k < 4 else "new", ha="center", va="center")
_ = axis.annotate("", (4.95, 0.45), (5.7, 0.45), arrowprops={"arrowstyle": "->"})
_ = axis.text(5.75, 0.45, "writer, each period T", va="center")
_ = axis.annotate("", (-0.75, 0.45), (-0.05, 0.45), arrowprops={"arrowstyle": "->"})
_ = axis.text(-0.8, 0.45, "slow reader\ntakes the oldest", va="center", ha="right")
_ = axis.text(2.45, 1.15, "queue of depth d = 5", ha="center")
_ = axis.set(xlim=(-2.6, 7.6), ylim=(-0.1, 1.5))
axis.axis("off")
plt.show()

# %% [markdown]
# **A worked example.** A camera writes every 33.3 ms, and the reader's depth is 10. The images that a slow reader takes
# are at least $9 \cdot 33.3 = 300$ ms old. With depth 1 it always takes the newest image. The chart compares this
# computed least age with measurements on the bus and on Cyclone DDS. In the chart, the reader takes one message for
# every three that are written. Green diamonds: a reader that empties its queue each time and uses only the newest
# message.
#
# ![Least age of what a slow reader takes against the depth: bus, Cyclone DDS, theory](../docs/charts/queue_ages.png)
#
# What does a reader find when it looks into its queue for the first time? In the table a writer publishes ten messages,
# numbered 0 to 9, one every 0.1 s, and the reader looks one second after the start. Each row has different policies. A
# late reader joins after all ten messages have been written.

# %% tags=["hide-code"]


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


rows = [("reader", "finds", "age of the oldest", "dropped from the queue")]
for name, case in {
    "depth 1": (QoS(), QoS(depth=1)),
    "depth 3": (QoS(), QoS(depth=3)),
    "depth 3, best effort": (QoS("best_effort"), QoS("best_effort", depth=3)),
    "depth 10, writer's lifespan 0.35 s": (QoS(lifespan=0.35), QoS()),
    "late, volatile": (QoS(), QoS(), 0.95),
    "late, transient local, writer's depth 2": (QoS(depth=2, **local), QoS(**local), 0.95),
    "late, transient local, writer's depth 2, reader's 1": (
        QoS(depth=2, **local),
        QoS(depth=1, **local),
        0.95,
    ),
}.items():
    values, old, dropped = late_reader(*case)
    received = ", ".join(map(str, values)) or "nothing"
    rows.append((name, received, f"{max(old):.1f} s" if old else "-", dropped))
table(*rows)

# %% [markdown]
# Messages whose lifespan has ended are gone too, but the last column counts only those that a full queue dropped. A
# late reader gets nothing from a volatile writer, because such a writer stores no message for later readers.

# %%
predict("late_screen")

# %%
show("reliable_arrives")

# %% tags=["hide-code"]
more_claims(
    "late_joiner_gets_the_last", "late_joiner_depth", "lifespan_bounds_age", "deadline_is_one_event"
)

# %% [markdown]
# ## 2 · Concept: real-time loops and scheduling
#
# ### A periodic loop that does not drift
#
# A controller should run once every millisecond. The obvious loop computes and then sleeps for one millisecond. But
# each cycle then takes longer than that: the sleep, the computation, and the short delay with which the operating
# system wakes the program up. How far behind is that loop after a thousand cycles?

# %%
predict("sleep_for_a_period")

# %% tags=["hide-code"]
figure_, axes = plt.subplots(2, 1, figsize=(8, 2.6), layout="constrained", sharex=True)
for axis, relative in zip(axes, (True, False), strict=True):
    begin, spans = 0.0, []
    for k in range(8):
        begin = begin if relative else 1.0 * k
        begin += 0.08
        spans.append((begin, begin + 0.25, ORANGE))
        begin += 0.25 + 1.0 if relative else 0.0
    timeline(axis, {"sleep for a period" if relative else "sleep until\nthe release": spans})
    for k in range(8):
        _ = axis.axvline(k, color="black", lw=0.7, ls=":")
    if relative:
        _ = axis.set_xlabel("")
_ = axes[1].set(xlim=(-0.1, 7.1))
plt.show()

# %% [markdown]
# The **release** of cycle $k$ is the time at which it should start: start time plus $k\,T$. These times are the dotted
# lines. **Lateness** is how long after its release a cycle really starts. The orange bars are the work; the picture
# exaggerates its length and its lateness. The upper loop drifts away from the dotted lines. The lower one sleeps
# *until* the next release, so an error in one cycle is not passed on to the next.
#
# The table runs both loops on one simulated clock. Each cycle works for 0.1 ms, and each wake-up is 0.06 ms late:

# %% tags=["hide-code"]


def clock(wake=60_000, hiccup=()):
    """Return a clock of our own [ns]: each sleep ends 60 us late, one of them much later."""
    now, sleeps = [0], [0]

    def sleep(seconds):
        sleeps[0] += 1
        now[0] += round(1e9 * seconds) + wake + (5_300_000 if sleeps[0] in hiccup else 0)

    def work(k):
        now[0] += 100_000

    return {"now": lambda: now[0], "sleep": sleep}, work


rows = [("1000 cycles of 1 ms", "last cycle late by", "largest lateness", "cycles skipped")]
for name, relative, hiccup in (
    ("sleep for a period", True, ()),
    ("sleep until the release", False, ()),
    ("until the release, one wake-up another 5.3 ms later", False, (500,)),
):
    times, work = clock(hiccup=hiccup)
    ran = loop.run(work, 1e-3, 1000, relative=relative, **times)
    late_by = 1e3 * ran.lateness
    rows.append((name, f"{late_by[-1]:.2f} ms", f"{late_by.max():.2f} ms", ran.skipped))
table(*rows)

# %% [markdown]
# In the last row the loop skips the cycles that it has missed, counts them, and starts again at the next multiple of
# $T$. Running the missed cycles one after another would send a burst of commands.
#
# *Derive it yourself.* The wrong loop sleeps for the period $T$, works for $C$ and wakes up late by $L$ each time. At
# which rate does it run? The formula in the cell omits one of these times; correct it.

# %%
answer("relative_sleep", "1/(T + C)")

# %% [markdown]
# ### Response-time analysis: are all tasks in time?
#
# Several tasks share one processor core. Each task is released once per period. Its **deadline** (not the QoS policy)
# is the end of that period. Task $i$ needs at most $C_i$ of computing time in each period $T_i$. Its share of the core
# is $C_i/T_i$, and the sum of these shares is the **utilization**. The tasks have fixed priorities, and a task of
# higher priority interrupts (**preempts**) the others. **Rate-monotonic** priorities give the highest priority to the
# task with the shortest period.
#
# A task's **response time** is the time from its release to the end of its work. It is longest at a
# **critical instant**, when all tasks are released at the same moment. This is true if the tasks are **independent**
# (none waits for anything or is released late) and all of them meet their deadlines. The picture shows a critical
# instant of a controller (period 1 ms), a filter (10 ms) and a planner (100 ms).
#
# <details><summary>Why the same moment?</summary>
#
# Start with our task and a more urgent one released at the same moment, and then move the releases of the urgent task.
# Suppose it is released earlier by a time $x$, and is still at work when we are released. Then $x$ of its work is
# already done, so we end earlier by $x$. Its later releases also come earlier, but only by $x$, so none of them slips
# in before our end. If instead it is released later than we are, all its releases move later, and fewer may fall before
# our end. Neither makes our response longer.
#
# </details>

# %% tags=["hide-code"]
C, T = np.array([0.25, 2.0, 40.0]), np.array([1.0, 10.0, 100.0])
names = ["controller", "filter", "planner"]
rows_, unfinished, due, step = {n: [] for n in names}, np.zeros(3), np.zeros(3), 0.25
for now in np.arange(0.0, 90.0, step):
    unfinished[due <= now] += C[due <= now]
    due[due <= now] += T[due <= now]
    if unfinished.any():
        k = int(np.argmax(unfinished > 0))
        unfinished[k] -= step
        rows_[names[k]].append((now, now + step, (BLUE, GREEN, ORANGE)[k]))
merged = {}
for name, spans in rows_.items():
    merged[name] = []
    for one in spans:
        if merged[name] and merged[name][-1][1] == one[0]:
            merged[name][-1] = (merged[name][-1][0], one[1], one[2])
        else:
            merged[name].append(one)
ends = response_times(1e-3 * C, 1e-3 * T)
figure_, axis = plt.subplots(figsize=(8.4, 2.2), layout="constrained")
timeline(axis, merged)
_ = axis.axvline(1e3 * ends[2], color=RED, ls="--")
_ = axis.text(
    1e3 * ends[2] + 0.6, -2.0, f"planner done\nat {1e3 * ends[2]:.2f} ms", color=RED, va="center"
)
_ = axis.set_xlim(0, 90)
plt.show()

# %% [markdown]
# The planner needs 40 ms but ends much later, because the others interrupt it again and again. Its worst-case response
# time follows from the smallest $R_i$ that solves
#
# $$R_i = C_i + B_i + \sum_{j<i} \left\lceil \frac{R_i}{T_j} \right\rceil C_j .$$
#
# Tasks are numbered by priority, the most urgent first. In words: the task's own work, plus the blocking $B_i$, plus
# all runs of the more urgent tasks $j$ that are released within $R_i$. The **blocking** is the longest time for which
# less urgent tasks can hold this one up, for instance with a lock (next section). So the formula also covers tasks that
# wait for locks. The brackets $\lceil\;\rceil$ round up.
#
# $R_i$ stands on both sides, so we start with $R_i = C_i$, insert it on the right, and repeat until nothing changes. If
# the result is at most $T_i$, no run of the task takes longer. If it exceeds $T_i$, the task can miss its deadline,
# unless $B_i$ is an estimate that never really occurs. Later runs can then take even longer than $R_i$, because they
# wait for the run before.
#
# **A worked example**, for the filter: $C = 2$ ms, and the controller takes 0.25 ms of each 1 ms. Start with 2 ms. In
# this time the controller is released twice, which makes $2 + 2 \cdot 0.25 = 2.5$ ms. In 2.5 ms there are three
# releases: $2 + 3 \cdot 0.25 = 2.75$ ms. In 2.75 ms there are three again, so 2.75 ms is the answer. The table compares
# the formula with a simulated scheduler.

# %% tags=["hide-code"]
longest = schedule.run(1e-3 * C, 1e-3 * T, 10.0).longest
table(
    ("longest response time", *names),
    ("analysis", *(f"{1e3 * x:.2f} ms" for x in ends)),
    ("simulated scheduler", *(f"{1e3 * x:.2f} ms" for x in longest)),
)

# %%
show("critical_instant")

# %% [markdown]
# Two simpler tests need only the utilizations of independent tasks with rate-monotonic priorities. Liu and Layland
# (1973) proved that $n$ such tasks meet all deadlines if their utilization is at most $n(2^{1/n} - 1)$. The
# **hyperbolic bound** (Bini and others, 2001) accepts a set if $\prod (C_i/T_i + 1) \leq 2$. Both are sufficient and
# not necessary: a set that they reject may still meet its deadlines. Of the sufficient tests that use only
# utilizations, the hyperbolic bound accepts the most. For the three tasks above:

# %% tags=["hide-code"]
table(
    ("utilization", "Liu and Layland's bound", "hyperbolic bound satisfied", "in time by analysis"),
    (
        f"{float(utilization(C, T)):.2f}",
        f"{liu_layland(3):.2f}",
        "yes" if bool(hyperbolic(C, T)) else "no",
        "yes" if bool(np.all(1e3 * ends <= T)) else "no",
    ),
)

# %% [markdown]
# For the left panel of the chart we generated random sets of five tasks. The curves show which share of them each test
# accepts; *exact* is the response-time analysis. Triangles show which share met all deadlines in a simulated run. For
# the right panel, all computing times of a set are lengthened by the same factor until a deadline is missed. The
# utilization at that point is called **breakdown utilization**. The curve is its median, and the band holds the middle
# 90% of the sets.
#
# ![Which task sets are in time by three tests, and breakdown utilization](../docs/charts/task_sets.png)
#
# <details><summary>Why should the shorter period come first?</summary>
#
# Suppose two tasks with neighbouring priorities meet their deadlines although the longer period comes first. Release
# both at once. The short-period task runs second; let it finish at time $R$, within its period. By then both are done.
# In the other order, the same work fills the time to $R$. So both end by $R$, within the shorter period and thus also
# within the longer one. Swap neighbours until all tasks are sorted by period: no deadline is lost.
#
# </details>

# %%
show("by_rate_is_best")

# %% [markdown]
# ### Locks: priority inversion
#
# A **lock** protects data that two tasks share: only one task can hold it, and the other has to wait. This wait is part
# of the blocking $B_i$. Consider three tasks on one core, of which the least urgent holds a lock that the most urgent
# one needs.

# %%
predict("middle_priority")

# %% tags=["hide-code"]
figure_, axes = plt.subplots(2, 1, figsize=(8.2, 3.6), layout="constrained", sharex=True)
charts = {
    "without a protocol": {
        "high": [(0, 120, "#ffcdd2"), (120, 125, BLUE)],
        "middle": [(0, 100, GREEN)],
        "low, holds the lock": [(-5, 0, ORANGE), (100, 120, ORANGE)],
    },
    "with priority inheritance": {
        "high": [(0, 20, "#ffcdd2"), (20, 25, BLUE)],
        "middle": [(25, 125, GREEN)],
        "low, holds the lock": [(-5, 20, ORANGE)],
    },
}
for axis, (name, spans) in zip(axes, charts.items(), strict=True):
    timeline(axis, spans)
    _ = axis.set_title(f"{name} (pale red: the most urgent task waits; blue: it runs)", fontsize=9)
_ = axes[0].set_xlabel("")
plt.show()

# %% [markdown]
# This is **priority inversion**: the most urgent task waits for the least urgent one, and here also for every task
# between them. **Priority inheritance** shortens the wait: while a more urgent task waits for a lock, the holder of the
# lock runs at the priority of that task. With a **priority ceiling**, the holder's priority is raised as soon as it
# takes the lock, to that of the most urgent task that ever uses this lock.
#
# In the lower panel even the middle task, which needs no lock, waits while the low task runs at the high priority. This
# time belongs to the middle task's blocking $B_i$. The table shows how long the most urgent task of the question waits
# in a simulated scheduler:

# %% tags=["hide-code"]
# high, middle, low: when the first two come, the low one has computed for 5 of 25 ms.
C3, T3 = np.array([5e-3, 100e-3, 25e-3]), np.full(3, 1.0)
rows = [("protocol", "the most urgent task waits")]
for protocol in ("none", "inheritance", "ceiling"):
    over = schedule.run(
        C3,
        T3,
        1.0,
        phase=[5e-3, 5e-3, 0.0],
        before=[0.0, 0.0, 0.0],
        section=[5e-3, 0.0, 25e-3],
        lock=[0, -1, 0],
        protocol=protocol,
    ).longest
    rows.append((protocol, f"{1e3 * (over[0] - C3[0]):.0f} ms"))
table(*rows)

# %% [markdown]
# When the most urgent task arrives, the low task still needs 20 ms under the lock, so 20 ms of waiting are unavoidable.
# The rest is the middle task's work. The chart shows the same effect with three real Linux processes on one core ("this
# system"; the ceiling is only simulated).
#
# ![Waits for a lock against the middle task's time, three protocols](../docs/charts/lock_waits.png)

# %%
show("inversion_is_bounded")

# %% [markdown]
# ### The newest value without a lock
#
# A planner passes trajectories to the control loop. The loop wants the newest one, whole, and must not wait. A **triple
# buffer** has three slots: the writer owns one, the reader owns one, and the third is in between. To publish, the
# writer fills its slot and swaps it for the slot in between, in one **atomic** step: no other thread can see it half
# done. The reader swaps its slot in the same way when a flag says that the one in between is new. Neither waits for the
# other, and no slot is copied while it is written.

# %% tags=["hide-code"]
header = (Path(controller.SOURCE).parent / "newest_value.hpp").read_text()
end = header.index("\ntemplate <typename T, typename Mutex")
triple = header[header.index("template <typename T>") : end]
Markdown(f"```cpp\n{triple.rstrip()}\n```")

# %% [markdown]
# The swap makes everything that a thread did before it visible to the thread that swaps next (C++ calls this *release*
# and *acquire*). So the reader never sees the index before the contents. And a slot that comes back to the writer is
# one that the reader has finished copying. (`alignas(64)`: memory moves between cores in blocks of 64 bytes,
# **cache lines**. In a shared line, each write would slow down the other thread.)
#
# A **data race** means that two threads access a variable that is not atomic, at least one of them writes, and nothing
# orders the accesses. Our tests run both threads under a **sanitizer**, a compiler option that adds checks to the
# running program, here for data races. It finds none. It finds one if the swap is unordered (*relaxed*), or if there
# are only two slots.
#
# <details><summary>Why a plain seqlock is a data race</summary>
#
# In a **seqlock** (a common alternative; the sanitizer finds a race in its plain form) the reader copies the value and
# repeats if a counter shows that the writer was busy meanwhile. But the copy itself reads what another thread writes.
# In C++ this is a data race, so the behaviour is undefined even if the copy is thrown away. The value has to consist of
# atomic words, with fences around them (Boehm 2012), and the reader may have to repeat without a bound. For values
# larger than a word, a triple buffer is simpler.
#
# </details>
#
# How long does one call take? A **mutex** is a lock of the operating system or the language. A reader of 2 kHz and a
# writer that never pauses share a trajectory of 5.6 kB:
#
# ![Time of a call without a lock, and with two kinds of mutex](../docs/charts/handover_waits.png)
#
# *The points of a line are the times that 50, 99 and 99.9 % of the calls do not exceed, and the slowest of all calls.
# "A copy, not shared" copies a value that no other thread uses. First three panels: the reader, with real-time
# priority. Last panel: the writer, an ordinary thread. The printed lines give these four times and the number of calls
# for the second panel ("loaded").*

# %%
figures(read("handover_waits"), "loaded, triple", "loaded, mutex", "loaded, std")

# %% [markdown]
# With every method, half of the calls take less than a microsecond. The slow calls differ. In the second panel, the
# writer can be interrupted while it holds `std::mutex`. Then the urgent reader waits until the scheduler lets the
# writer run again, for many periods. Inheritance ends most of this wait. The triple buffer has no lock to wait for, so
# its calls are about as long as those of a plain copy. (The slowest of 11,000 calls is not a bound.)
#
# <details><summary>The other three panels</summary>
#
# In the first panel, reader and writer have a core each. There a reader that meets a locked mutex waits much longer
# than one copy takes, probably because the system puts it to sleep and has to wake it again. In the third panel, with
# less load, the writer is interrupted more rarely. In the last panel the method makes no difference: the writer's
# slowest calls are probably those that the scheduler interrupts.
#
# </details>

# %% [markdown]
# ### Executors: who waits for a thread
#
# In ROS 2 a callback can wait even if the processor is idle. An **executor** has one or more threads and runs your
# callbacks on them. Each thread runs one callback at a time and never interrupts it. ROS 2's standard executor makes a
# list of the callbacks that are ready, its **ready set**, and runs the whole list. A callback that becomes ready
# meanwhile waits for the next list (Casini and others, 2019). Since 2019 (release Eloquent) timers wait too; before, a
# due timer ran first.
#
# With several threads, a **callback group** says which callbacks may run at the same time. Callbacks in a *mutually
# exclusive* group, the default, never overlap. Those in a *reentrant* group may overlap, and so may callbacks of
# different groups.

# %%
predict("camera_callback")

# %% tags=["hide-code"]
figure_, axes = plt.subplots(2, 1, figsize=(8.2, 2.8), layout="constrained", sharex=True)
one = {"thread": [(0, 25, ORANGE), (25, 26, BLUE), (33, 58, ORANGE), (58, 59, BLUE)]}
two = {
    "thread 1": [(1, 2, BLUE), (51, 52, BLUE)],
    "thread 2": [(0, 25, ORANGE), (33, 58, ORANGE)],
}
for axis, rows_, title in zip(
    axes, (one, two), ("one thread", "a thread and group each"), strict=True
):
    timeline(axis, rows_)
    for due in (1, 51):
        _ = axis.axvline(due, color=RED, ls=":", lw=1.2)
    _ = axis.set_title(title, fontsize=9)
_ = axes[0].set_xlabel("")
_ = axes[1].set_xlabel(
    "time [ms] (orange: camera, each 33 ms; blue: control; red: control is due, each 50 ms)"
)
plt.show()

# %% [markdown]
# To protect the control callback, put it in a group of its own. If all groups are exclusive, give the executor as many
# threads as groups: then a thread is always free for control. Control also needs processor time: a free core, or an
# executor of its own whose thread has a higher priority. The table shows the longest time from when control is due
# until it ends, in forty simulated runs, and a computed bound. In the rows with two cameras, both take an image at the
# same moment, every 100 ms. Control takes 1 ms and is due every 50 ms; a camera's callback takes 25 ms:

# %% tags=["hide-code"]
control = Work("control", 0.001, 0.050)
one = [control, Work("camera", 0.025, 0.033, "subscription")]
two = [control, *(Work(f"camera {k}", 0.025, 0.1, "subscription") for k in (1, 2))]
apart = [replace(work, group=work.name) for work in two]
rng = np.random.default_rng(1)
rows = [("callbacks", "executor", "longest, simulated", "bound")]
for cameras, name, some, order, threads in (
    ("control, one camera", "one thread, ready set", one, "ready set", 1),
    ("", "one thread, first in first out", one, "fifo", 1),
    ("control, two cameras", "one thread, ready set", two, "ready set", 1),
    ("", "one thread, due timers first", two, "timers first", 1),
    ("", "a group, a thread and a core each", apart, "ready set", 3),
):
    # Both cameras have the same phase.
    phases = [(a, *[b] * (len(some) - 1)) for a, b in rng.random((40, 2))]
    largest = max(respond(some, order, threads, p, 2.0)["control"].max() for p in phases)
    bound = bounds(some, order, threads)["control"]
    rows.append((cameras, name, f"{1e3 * largest:.1f} ms", f"{1e3 * bound:.1f} ms"))
table(*rows)

# %% [markdown]
# ![Longest wait of a control callback behind a camera's, in three orders](../docs/charts/executor_waits.png)
#
# *The three orders need the same time. The upper line is their bound, the lower one that of control in a thread of its
# own; "fifo" means first in, first out.*
#
# With one camera, the order of the callbacks does not change the bound, which is the sum of both callbacks. With two
# cameras the order matters. If control becomes due just after the thread has made its list, and both cameras are in the
# list, control waits for both: 25 + 25 + 1 = 51 ms. This is longer than control's period of 50 ms, so control's
# previous run may still be waiting when the next one is due. Then that run is in the list as well and takes another 1
# ms: together 52 ms.
#
# A bound is never exceeded, but it need not be reached. If due timers run first, control waits only for the camera
# callback that is already running.
#
# A callback can even wait for itself. Below, a node called `hand` offers a service called `grasp`. A timer callback of
# the same node calls this service and waits for the reply. When the reply arrives, it needs a callback too, at the
# client. Timer, service and client are all in the node's default group. The bus reports who waits for whom:

# %% tags=["hide-code"]
bus = Bus()
node = bus.node("hand", Executor(bus, 2))
node.service("grasp", lambda request: request)
client = node.client("grasp")


def tick():
    yield client.call("which hand?")


node.timer(0.1, tick)
bus.run(0.5)
print(*(textwrap.fill(one, 96, subsequent_indent="    ") for one in deadlocks(bus)), sep="\n")

# %% [markdown]
# The timer callback waits for the service. The service waits for the group, which is exclusive. And the timer callback
# holds the group until the service has replied. This is a **deadlock**, a circle in which each waits for the next.

# %%
show("threads_cure_deadlock")

# %% tags=["hide-code"]
more_claims("not_real_time_by_default", "callback_over_a_period", "callback_sets_the_rate")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Silent and late are different faults. *Silent* means that nothing arrives, not even a small message.
# First check that name, type and domain of the topic agree and that something is published. Then compare the QoS
# profiles of writer and reader. If they are compatible, look for a callback that never returns, for instance because it
# waits for itself.
#
# *Late* data waited somewhere: in a queue, on the link (for its turn, or to be sent again), behind other callbacks in
# the executor, or behind other tasks on the core. Or the message is large, and turning it into bytes and sending it
# takes long. Or its stamp comes from a clock that is not synchronised. Find out where, and compute the longest wait.
#
# </div>

# %% [markdown]
# ## 3 · Design: one stack, edge by edge
#
# <div class="alert alert-block alert-info">
#
# **Interview question.** *A camera at 30 Hz, a planner at 10 Hz, a controller at 1 kHz. Draw the nodes, and give the
# quality of service of every connection.*
#
# Answer aloud first. Then compare with the picture and the table.
#
# </div>

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(8.8, 3.1), layout="constrained")
boxes = {
    "camera\n30 Hz": (0, 0),
    "perception": (2.4, 0),
    "planner\n10 Hz": (4.8, 0),
    "controller\n1 kHz": (7.2, 0),
    "drives": (9.4, 0),
    "safety monitor": (4.8, -1.5),
    "screen": (2.4, -1.5),
}
for name, (x, y) in boxes.items():
    real_time = name.startswith(("controller", "drives"))
    _ = axis.text(
        x,
        y,
        name,
        ha="center",
        va="center",
        fontsize=9,
        bbox={
            "boxstyle": "round,pad=0.4",
            "fc": "#ffebee" if real_time else "#e8eaf6",
            "ec": "black",
        },
    )
arrows = [
    ((0.55, 0), (1.65, 0), "best effort\ndepth 1"),
    ((3.15, 0), (4.2, 0), "best effort\ndepth 1\ndeadline"),
    ((5.4, 0), (6.55, 0), "reliable\ndepth 1"),
    ((7.85, 0), (8.95, 0), "same\nthread"),
    ((5.7, -1.45), (7.2, -0.4), "reliable, transient\nlocal, lease"),
    ((4.0, -1.5), (2.9, -1.5), "reliable\ntransient\nlocal, lease"),
]
# Joint states go from the controller to whoever needs the arm's present position.
_ = axis.plot([7.2, 7.2, 2.4], [0.4, 1.15, 1.15], color=BLUE, lw=1.2)
for x in (2.4, 4.8):
    _ = axis.annotate("", (x, 0.95), (x, 1.16), arrowprops={"arrowstyle": "->", "color": BLUE})
_ = axis.annotate("", (5.15, -1.2), (6.75, -0.35), arrowprops={"arrowstyle": "->", "color": BLUE})
_ = axis.text(
    6.0,
    1.2,
    "joint states: best effort, depth 1",
    ha="center",
    va="bottom",
    fontsize=8.5,
    color=BLUE,
)
for begin, end, words in arrows:
    _ = axis.annotate("", end, begin, arrowprops={"arrowstyle": "->"})
    x, y = (begin[0] + end[0]) / 2, (begin[1] + end[1]) / 2
    slanted = begin[1] != end[1]
    _ = axis.text(
        x + (0.3 if slanted else 0),
        y + (-0.1 if slanted else 0.12),
        words,
        ha="left" if slanted else "center",
        va="top" if slanted else "bottom",
        fontsize=8.5,
    )
_ = axis.set(xlim=(-0.8, 10.2), ylim=(-1.8, 1.45))
axis.axis("off")
plt.show()

# %% [markdown]
# <table> <tr><th>connection</th> <th>policies</th> <th>because</th></tr> <tr><td>camera → perception</td> <td>best
# effort, depth 1, with a receive buffer that is large enough (see below)</td> <td>only the newest image counts; on a
# slow link, an image that is sent again arrives when a newer one is due</td></tr> <tr><td>perception → planner</td>
# <td>best effort, depth 1, deadline of three camera periods</td> <td>the next scene (the objects in an image) replaces
# a lost one; the planner must notice if several in a row are missing, also by the newest scene's age, because no
# deadline reports a writer that never wrote or was closed</td></tr> <tr><td>planner → controller</td> <td>reliable,
# depth 1, a whole trajectory with times</td> <td>the next trajectory comes only after 100 ms; until then the controller
# interpolates</td></tr> <tr><td>controller → drives</td> <td>no middleware: the same thread</td> <td>a late torque
# means that the old one acts on; several in a row can make the arm shake</td></tr> <tr><td>joint states → perception,
# planner, safety monitor</td> <td>best effort, depth 1, each with its time stamp</td> <td>perception computes the
# camera's pose from them, plans start from them, and the monitor checks them; the next one comes within
# milliseconds</td></tr> <tr><td>safety monitor → controller, screen</td> <td>reliable, transient local, depth 1, manual
# by topic with a lease</td> <td>a late subscriber needs the current status; if the monitor's own loop gives no sign of
# life, the controller must stop the arm</td></tr> </table>
#
# How old is the image behind a command at the **drives**, the electronics that move the motors? Chapter 0 added up the
# execution times and the waits between stages. The chart does the same for four variants of this stack. Blue is
# computing; each other colour is one wait. A plan is in use until the next plan arrives, and a command until the next
# command.

# %% tags=["hide-code"]
rows = {
    "as designed": [
        Stage("camera", 0.005, 1 / 30),
        Stage("perception", 0.020),
        Stage("planner", 0.040, 0.1),
        Stage("controller", 1e-4, 1e-3),
    ],
}
rows["planner of 30 ms, on arrival"] = [
    *rows["as designed"][:2],
    Stage("planner", 0.030),
    rows["as designed"][3],
]
rows["controller at 100 Hz"] = [*rows["as designed"][:3], Stage("controller", 1e-4, 1e-2)]
rows["depth 10, slow perception"] = [
    rows["as designed"][0],
    Stage("perception", 0.050, depth=10, overload="queue"),
    *rows["as designed"][2:],
]
moments, rng = np.linspace(2.0, 2.9, 901), np.random.default_rng(0)
PARTS = {
    "computing": "#5c6bc0",
    "image waits": "#ef6c00",
    "scene waits": "#2e7d32",
    "plan in use": "#c62828",
    "command in use": "#616161",
}
figure_, axis = plt.subplots(figsize=(8, 2.0), layout="constrained")
lines = [("stack", "least age", "mean age", "largest age", "mean, simulated")]
for name, stages in rows.items():
    output = age(stages)
    runs = (run_chain(stages, p, seconds=3.0) for p in rng.random((16, len(stages))))
    ages = 1e3 * np.mean([one.age(moments).mean() for one in runs])
    times = [f"{1e3 * x:.0f} ms" for x in (output.least, output.mean, output.greatest)]
    lines.append((name, *times, f"{ages:.0f} ms"))
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

# %% tags=["hide-code"]
table(*lines)

# %% [markdown]
# The ages are computed without losses and times on the link; the last column is the average of 16 simulated runs. In
# each run, every clock starts at a random time (its **phase**). The camera takes 5 ms, perception 20 ms (slow: 50 ms)
# and the planner 40 ms.
#
# Row 2 is 60 ms better on average. The faster planner saves 10 ms. Starting it when a scene arrives saves the other 50
# ms: no scene waits, and plans come three times as often. Such a planner must end before the next scene, 33 ms later,
# so row 2 assumes 30 ms.
#
# An image of $w \times h$ pixels with $c$ bytes per pixel, sent $f$ times a second, needs $w\,h\,c\,f$ bytes per
# second. A colour pixel takes three bytes, a depth pixel two. A packet on Ethernet has room for 1,472 bytes beside its
# headers.

# %% tags=["hide-code"]
STREAMS = {"VGA colour": (640, 480, 3, 30), "720p colour and depth": (1280, 720, 5, 30)}
lines = [("stream", "size of an image", "bandwidth", "packets per image")]
for name, shape in STREAMS.items():
    size, rate, packets = transport.stream(*shape)
    lines.append((name, f"{size / 1e3:.0f} kB", f"{rate / 1e6:.0f} MB/s", packets))
table(*lines)

# %% [markdown]
# Gigabit Ethernet carries at most 125 MB/s, so the larger stream does not fit: run camera and perception on one
# computer, or compress. Even there, images can be lost. The operating system stores arriving packets in a **receive
# buffer** until the program reads them from its **socket**, its end of the connection. If packets arrive faster than
# the program reads them, the buffer fills, and further packets are lost. Below, ten images at 30 Hz go to another
# process on this computer, over Cyclone DDS, with its default receive buffer (1 MiB) and a larger one:

# %% tags=["nbval-ignore-output", "hide-code"]
try:
    from course.oracles.cyclonedds import buffered
    from course.oracles.slow_reader import flood

    lines = [("images", "reliability", "receive buffer", "received")]
    for name, how, larger in (
        ("VGA colour", "best_effort", None),
        ("720p colour and depth", "best_effort", None),
        ("720p colour and depth", "best_effort", 4 << 20),
        ("720p colour and depth", "reliable", None),
    ):
        try:
            with buffered(larger) if larger else nullcontext():
                size = transport.stream(*STREAMS[name])[0]
                came = flood(size, 10, 10, reliability=how, every=1 / 30).received
            result = f"{came} of 10"
        except ImportError:
            raise
        except Exception:
            result = "not run: the system allows no such buffer"
        words = "4 MiB" if larger else "default"
        lines.append((name, how.replace("_", " "), words, result))
    result = table(*lines)
except ImportError as missing:
    result = Markdown(str(missing))
result

# %% [markdown]
# An image of 4.6 MB overflows the default buffer, so with best effort hardly any gets through. Reliable delivery sends
# the lost packets again, which takes longer. The better fix is a larger buffer; Linux limits it by `net.core.rmem_max`.
#
# Do controller (0.1 ms in each cycle), perception and planner fit on one core?

# %% tags=["hide-code"]
C, T = np.array([1e-4, 20e-3, 40e-3]), np.array([1e-3, 1 / 30, 0.1])
lines = [("on one core", "utilization", "worst-case response times")]
for output, some in {
    "controller, perception, planner": [0, 1, 2],
    "controller and planner": [0, 2],
}.items():
    ends = ", ".join(
        f"{1e3 * x:.1f} ms" if np.isfinite(x) else "no bound"
        for x in response_times(C[some], T[some])
    )
    lines.append((output, f"{float(utilization(C[some], T[some])):.2f}", ends))
table(*lines)

# %% [markdown]
# All three together need more than a whole core. The planner has the lowest priority, and its backlog grows from plan
# to plan, so no bound exists. Perception uses the most time, so it gets a core of its own.
#
# ### The launch file, and what it sets
#
# A **launch file** starts a system's nodes and passes them parameters. It can set a policy only where a node supports
# this. ROS 2's own method is a parameter whose name begins with `qos_overrides`. A typical file in Python:

# %% tags=["hide-code"]
Markdown(f"```python\n{launch.USUAL[launch.USUAL.index('def ') :].strip()}\n```")

# %%
predict("five_comments")

# %% [markdown]
# We ran this file with a replacement of ROS 2's launch system that only records what would be started:

# %% tags=["hide-code"]
usual, ours = (launch.nodes(text) for text in (launch.USUAL, launch.OURS))
table(
    ("node", "parameters", "policies set"),
    *((n.executable, f"`{n.parameters}`", len(launch.overrides(n.parameters))) for n in usual),
)

# %% [markdown]
# A `qos_overrides` parameter (since ROS 2 Galactic, 2021) sets one policy of one end, for example
# `qos_overrides./camera/image.publisher.depth: 1`. Times are in nanoseconds.
#
# The file in the fold-out sets policies in this way. Instead of the node `controller`, it uses **ros2_control**, ROS
# 2's framework for controllers. The framework's own process runs our controller as a plug-in. A second program, the
# **spawner**, loads the plug-in and passes its parameters to it. So the spawner's rows in the table are the
# controller's policies. The table lists what differs from the defaults. (The policies of the joint states are not in
# the file: each reader sets them in its own source code.)

# %% tags=["hide-code"]
Markdown(
    "<details><summary>The launch file with its policies</summary>\n\n"
    f"```python\n{launch.OURS.strip()}\n```\n\n</details>"
)

# %% tags=["hide-code"]
lines = [("node", "topic", "end", "policies that differ from the default")]
for node in ours:
    for (topic, end), qos in launch.overrides(node.parameters).items():
        unlike = [
            v.replace("_", " ")
            for k, v in vars(qos).items()
            if v != getattr(QoS(), k) and isinstance(v, str)
        ]
        times = [
            f"{k.removeprefix('liveliness_').split('_')[0]} {1e3 * v:g} ms"
            for k, v in vars(qos).items()
            if v != getattr(QoS(), k) and isinstance(v, float)
        ]
        if qos.depth != QoS().depth:
            times.append(f"depth {qos.depth}")
        lines.append((node.executable, topic, end, ", ".join([*unlike, *times])))
table(*lines)

# %% [markdown]
# Our recorder also compares both ends of each topic. It finds the silent topic if you set the policies of only one end:

# %% tags=["hide-code"]
broken = launch.OURS.replace(
    'qos("/safety/status", "publisher", STATUS)',
    'qos("/safety/status", "publisher", {"reliability": "reliable"})',
)
print("silent topics:", launch.silent(ours) or "none")
print("with the monitor's publisher left at default:", launch.silent(launch.nodes(broken)))

# %% [markdown]
# What was decided, and what it costs:
#
# * *Processes.* The file starts a process for each node. If perception crashes, the controller goes on running. The
#   price is that every image is turned into bytes (**serialisation**) and copied several times on its way. If that
#   takes too long, put camera and perception into one process.
# * *The controller.* The framework's parameters set its rate and its thread priority (`update_rate`, `thread_priority`;
#   manual, Jazzy 2024).
#
# <details><summary>Three more traps</summary>
#
# * *The plug-in has a node of its own* in the framework's process. Since August 2024 (Jazzy and later), that node
#   ignores the parameters of the process. That is why the spawner has to pass them (`--param-file`,
#   `--controller-ros-args`; release notes, Jazzy).
# * *Names depend on the version.* For RealSense cameras, `depth_module.profile` became `depth_module.depth_profile`
#   with driver 4.55.1 (May 2024). If a launch file sets a parameter that the node does not declare, ROS 2 ignores it
#   without a message.
# * *Tuning at run time* works only if the node reads the parameter again or registers a callback for changes.
#
# </details>

# %%
show("processes_isolate")

# %% tags=["hide-code"]
more_claims("gigabit_is_enough", "launch_comments", "parameters_are_tunable")

# %% [markdown]
# <div class="alert alert-block alert-success">
#
# **Interview tip.** Go through the layers and give a number for each. *"Torques at 1 kHz in a thread of their own, with
# Linux's real-time priority, locked memory and no allocation. I compare the worst lateness under load with the delay at
# which the loop would become unstable. The planner at 10 Hz may be late, because the controller interpolates and comes
# to rest at the end of its trajectory. If no image is lost and the link takes no time, the image behind a command is at
# most 200 ms old. Perception has a queue of depth 1, so a new image replaces an unread one."*
#
# </div>
#
# ## 4 · Code
#
# ### Compatibility in twelve lines
#
# The function compares the ranked policies with named values, then the times, then the policies that have to be equal
# (such as DDS's ownership, which ROS 2 does not use). `ORDERS` lists the named values, the weakest first. `TIMES` names
# deadline and lease, which are infinite if not set, and `SAME` the last group:

# %% tags=["hide-code"]
body = inspect.getsource(compatible)
Markdown(
    "```python\ndef compatible(offered, requested):\n" + body[body.index("    ends = ") :] + "```"
)

# %% [markdown]
# ### A controller in C++
#
# Below is the update function of a controller for ros2_control (Kilted, 2025). It reads positions and velocities from
# `state_interfaces_` and writes torques to `command_interfaces_`. The controller names the **interfaces** that it needs
# (each is one number of one joint), and checks that it has them when it is configured and activated. So `update` checks
# no sizes. It also allocates no memory and never waits for a lock: both can take arbitrarily long. (Reading or writing
# an interface tries a lock up to ten times, then gives up.)
#
# In the picture, the dashed arrow leads to the cycle that is repeated while the controller is active. The **hardware
# component**, the driver of the arm, reads the encoders and writes the torques:

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(8.6, 1.7), layout="constrained")
steps = ["unconfigured", "inactive", "active"]
for k, name in enumerate(steps):
    _ = axis.text(
        2.1 * k,
        0,
        name,
        ha="center",
        va="center",
        fontsize=9,
        bbox={"boxstyle": "round,pad=0.4", "fc": "#e8eaf6", "ec": "black"},
    )
for k, word in enumerate(("configure:\ncheck sizes", "activate")):
    _ = axis.annotate("", (2.1 * k + 1.45, 0), (2.1 * k + 0.65, 0), arrowprops={"arrowstyle": "->"})
    _ = axis.text(2.1 * k + 1.05, 0.12, word, ha="center", va="bottom", fontsize=8)
for k, word in enumerate(("read encoders", "update", "write torques")):
    _ = axis.text(
        5.9 + 1.45 * k,
        0,
        word,
        ha="center",
        va="center",
        fontsize=9,
        bbox={"boxstyle": "round,pad=0.3", "fc": "#ffebee", "ec": "#c62828"},
    )
for begin in (6.65, 7.8):
    _ = axis.annotate("", (begin + 0.25, 0), (begin, 0), arrowprops={"arrowstyle": "->"})
_ = axis.annotate("", (5.15, 0), (4.65, 0), arrowprops={"arrowstyle": "->", "ls": "--"})
_ = axis.annotate(
    "",
    (5.9, -0.25),
    (8.8, -0.25),
    arrowprops={"arrowstyle": "->", "connectionstyle": "arc3,rad=-0.25"},
)
_ = axis.text(7.35, -0.82, "every millisecond, while active", ha="center", va="center", fontsize=8)
_ = axis.set(xlim=(-0.9, 9.9), ylim=(-1.0, 0.6))
axis.axis("off")
plt.show()

# %% tags=["hide-code"]
cpp = Path(controller.SOURCE).parent
whole = (cpp / "arm_controller.cpp").read_text()
update = whole[whole.index("  controller_interface::return_type update") : whole.index("\nprivate")]
folded = f"<details><summary>The whole file</summary>\n\n```cpp\n{whole}```\n\n</details>"
Markdown(f"```cpp\n{textwrap.dedent(update)}```\n\n{folded}")

# %% [markdown]
# `update` returns `ERROR` in two cases. In the first, a torque cannot be written (`set_value` fails), and the last one
# remains in force. In the second, a reading is missing or invalid (NaN), and the joint gets zero torque. Zero torque
# does not hold a joint; only its brake can. The brake closes some time after its current is cut.
#
# Let $t$ be the time from the first cycle without torque until the brake has closed. If the joint was at rest and the
# other joints hold still, the centre of mass of what it carries drops by at most $g\,t^2/2$, as in free fall. (If
# several joints are limp, an outer link can fall faster.)
#
# When `update` returns `ERROR`, the controller manager of ros2_control deactivates the controller and activates its
# `fallback_controllers` (since Jazzy, 2024). The hardware component has to cut the current of the brakes.
#
# The example is stricter than what you would ship: a single cycle in which a lock was taken ends the controller. A real
# controller would use the last reading for two or three cycles, count them, and only then report an error.
#
# The common alternative computes inside a subscription's callback, like this:

# %% tags=["hide-code"]
common = (cpp / "callback_controller.cpp").read_text()
body = common[common.index("  void on_joint_state") : common.index("\nprivate")]
Markdown(f"```cpp\n{textwrap.dedent(body)}```")

# %%
predict("six_positions")

# %% [markdown]
# <details><summary>Five things that are wrong with it</summary>
#
# 1. It runs only when a message arrives, so its timing is that of the publisher. If messages stop, it stops.
# 2. It allocates memory twice in every call.
# 3. It trusts the message. With seven joints it reads beyond the targets; without velocities, which the message
#    definition allows, it reads beyond an empty array.
# 4. Nothing limits a torque.
# 5. It cannot be configured, activated and deactivated from outside. For that a node has to derive from
#    `rclcpp_lifecycle::LifecycleNode`; a class that derives from `rclcpp::Node` runs as soon as it is created
#    (documentation of rclcpp_lifecycle, Humble 2022).
#
# </details>
#
# We compiled both programs with a sanitizer that checks memory accesses. Then we called `update` with random joint
# states, and sent three messages to the callback:

# %% tags=["nbval-ignore-output", "hide-code"]
rng, six = np.random.default_rng(2), 6
first = [*(rng.uniform(*ends, six) for ends in ((-1, 1), (50, 100), (1, 9))), np.full(six, 80.0)]
states = rng.uniform(-1, 1, (50, 2 * six))


def message(positions, velocities):
    return [positions, *[0.1] * positions, velocities, *[0.0] * velocities]


if controller.compiler() is None:
    print(f"not run here, as {controller.NO_COMPILER}")
    print("the fold-out below shows the figures from the stored record")
else:
    with tempfile.TemporaryDirectory() as folder:
        program = controller.build(Path(folder))
        good = controller.drive(program, "update", first, states)
        torques = [controller.torques(s[:six], s[six:], *first) for s in states]
        gap = np.abs(np.array(good.torque) - torques).max()
        took_ = sum(good.allocations)
        print(f"update, {len(states)} random states: within {gap:.2g} N m of the formula in Python")
        print(f"update: {took_} allocations")
        sizes = {"six joints": (6, 6), "seven joints": (7, 7), "no velocities": (6, 0)}
        for name, row in sizes.items():
            bad = controller.drive(program, "callback", [np.zeros(six)], [message(*row)])
            report = bad.report.split(" on ")[0] or f"{sum(bad.allocations)} allocations"
            print(f"callback, {name:<16}{textwrap.shorten(report, 70)}")

# %% tags=["hide-code"]
more_claims("any_joint_message")

# %% [markdown]
# ## 5 · The simulation in full
#
# Select a topic, and set the policies of its publisher and its subscriber. A red line is a silent pair, with the policy
# that fails; bold lines belong to the selected node; a moving dot is an image. Below the graph you see which tasks run
# at each moment, and the age of the command that the drives use ("command in force"). All numbers but the first are
# about the whole run, five seconds (the mean age omits the first two).
#
# Unlike the design of section 3, this stack sends images over a link and commands as messages, and its clocks have
# fixed phases. So its mean age differs. Start with the preset *Deep queue*, and set the subscriber's depth to 1: what
# happens to the age?

# %%
simulation("middleware", "Deep queue")

# %% [markdown]
# ### What to break
#
# Each preset breaks one thing. The last column says what theory predicts before the run. (A *round* sends all fragments
# that are still missing; section 7 computes their mean number.)

# %% tags=["hide-code"]
from course.simulations.middleware import CAMERA, HOLD, LOOP, PACKETS, SEEING

slow, once = SEEING / 0.4, SEEING / 0.7
table(
    ("preset", "what is broken", "what happens", "prediction, or fix"),
    (
        "Mismatch",
        "best effort offered, reliable requested",
        "silence",
        f"{', '.join(compatible(QoS('best_effort'), QoS()))} is incompatible",
    ),
    (
        "Lossy wire",
        "one packet in a thousand is lost",
        "images are missing",
        f"{transport.expected_loss(PACKETS, 1e-3):.0%} of the images; with reliable none, after "
        f"{transport.expected_rounds(PACKETS, 1e-3):.2f} rounds of sending on average",
    ),
    (
        "Deep queue",
        "perception slower than the camera, depth 10",
        "all commands are old",
        f"9 camera periods of {1e3 * CAMERA:.1f} ms in the queue: {9e3 * CAMERA:.0f} ms",
    ),
    (
        "Overload",
        "the loop shares perception's thread",
        "cycles late and skipped",
        f"late by up to {1e3 * (once + LOOP):.1f} ms. If a cycle is due just after the thread has made its list, it "
        f"waits for the previous cycle, {1e3 * LOOP:.1f} ms, and for perception. That takes {1e3 * once:.1f} ms here, "
        f"because other programs on the core stretch its {1e3 * SEEING:.0f} ms",
    ),
    (
        "Inversion",
        "a logger holds a lock that the loop needs; perception, more urgent, interrupts the logger",
        "the loop waits for perception",
        f"{1e3 * HOLD:.0f} ms for the lock and {1e3 * SEEING:.0f} ms for perception; with "
        f"inheritance only {1e3 * HOLD:.0f} ms",
    ),
    (
        "Late monitor",
        "a forbidden zone is published once, volatile, before the monitor starts",
        "the monitor never learns the zone",
        "fix: transient local and reliable at both ends",
    ),
)

# %% [markdown]
# ## 6 · Speed: what a message costs
#
# How long does a message take to another process, or thread, and back? We measured it from Python, on one computer. The
# methods do different work with the bytes (second column of the table). Times are relative: 1 is the round trip of 64
# bytes between two threads that use a queue. (Zenoh is another middleware, see section 9.) Bands show the middle half
# of the measurements.
#
# ![Round trips by size: threads, socket, shared memory, zenoh, Cyclone DDS](../docs/charts/round_trips.png)

# %% tags=["hide-code"]
work = {
    "threads, a queue": "passes a reference: nothing is copied",
    "Unix socket": "copies raw bytes into the kernel and out of it",
    "shared-memory ring": "copies raw bytes once, into memory that both processes see",
    "zenoh, TCP": "raw bytes over TCP; its shared memory is switched off",
    "Cyclone DDS, reliable": "serialises a typed message; packets over UDP, with acknowledgements",
    "Cyclone DDS, sequence": "the same, and every byte becomes a Python object",
}
lines = [("transport", "what it does", "64 bytes", "16 kB", "one VGA image")]
for one in stored("round_trips")[0].series:
    # The stored sizes are rounded to six digits.
    by_size = {
        size: y
        for x, y in zip(one.x, one.y, strict=True)
        for size in (64, 16384, 921600)
        if abs(x / size - 1) < 1e-3
    }
    if 16384 in by_size:
        cells = [f"{y:,.0f}" if y >= 100 else f"{y:.2g}" for y in by_size.values()]
        lines.append((one.label, work[one.label], *cells))
table(*lines)

# %% [markdown]
# For small messages the differences are overhead: waking a background thread, numbering messages, and acknowledging
# that they have arrived. For large ones each copy costs time, and so does serialisation. The slow curve *Cyclone DDS,
# sequence* is due to Python: a message field declared as `sequence[uint8]` turns every byte into a Python object.
# Declare it as `array[uint8, n]`.
#
# In the chart, the time of Cyclone DDS jumps at 4 MB. Such a message does not fit into the receive buffer of 1 MiB, so
# packets are probably lost and sent again.
#
# *What to choose.* In one process, pass a pointer. On one machine, use shared memory for large messages. Between
# machines, use what the rest of your robots use, and compute bandwidth and packets first.
#
# Large and small messages can also delay each other, when they share a wire:

# %%
show("command_waits_for_picture")

# %% [markdown]
# The speed of the course's own tools, and the table's unit on this computer:

# %% tags=["nbval-ignore-output", "hide-code"]
bus, count = Bus(), 20_000
writer = bus.node("a").writer("x")
bus.node("b").reader("x", lambda sample: None)
bus.node("a").timer(1e-3, lambda: (writer.publish(0), None)[1])
begun = perf_counter()
bus.run(count * 1e-3)
print(f"bus: {count / (perf_counter() - begun):,.0f} messages/s, timer and callback included")
with transport.threads() as trip:
    begun = perf_counter()
    _ = [trip(bytes(64)) for _ in range(1000)]
    unit = 1e3 * (perf_counter() - begun)
print(f"two threads, 64 bytes there and back (the unit of the table): {unit:.0f} us")
sets = schedule.random_sets(8, 0.9, 1000, np.random.default_rng(3))
begun = perf_counter()
_ = response_times(*sets)
print(f"response times of 1,000 sets of 8 tasks: {1e3 * (perf_counter() - begun):.1f} ms")

# %% [markdown]
# The bus is a simple model: it has no processes, no copies and no discovery, and its acknowledgements are never lost.
# It predicts which pairs connect, and how long messages wait for queues, callbacks and a link of known speed. It does
# not predict the overhead of a real middleware.
#
# ## 7 · Debug: messages that are lost or late
#
# ### Fragments: how one lost packet loses an image
#
# A network packet carries about 1,500 bytes, so a VGA image is split into more than six hundred **fragments**. We
# assume one fragment per packet. The image is complete only if all fragments arrive. Assume that each packet is lost
# with probability $p$, independently. Then all $n$ fragments arrive with probability $(1 - p)^n$, and
#
# $$P(\text{image lost}) = 1 - (1 - p)^n .$$
#
# As long as $n\,p$ is small, this is close to $n\,p$.

# %%
predict("one_in_ten_thousand")

# %% [markdown]
# A reliable reader repairs this. It sends a **negative acknowledgement**, the list of the fragments that are missing,
# and the writer sends those again. The first **round** sends all fragments, and each further round only the missing
# ones. After $k$ rounds a given fragment is still missing with probability $p^k$, so round $k + 1$ is needed with
# probability $1 - (1 - p^k)^n$. (Round 1 is always needed.) Adding up these probabilities over all rounds gives the
# mean number of rounds:
#
# $$\sum_{k=0}^{\infty} \left(1 - (1 - p^k)^n\right).$$
#
# Each round after the first costs one more trip there and back. The chart compares both formulas with the bus and with
# a real socket whose packets we dropped at random. Bands: 95% confidence intervals.
#
# ![Lost messages and rounds against packets, theory, bus and socket](../docs/charts/lost_fragments.png)

# %%
show("reliable_resends_all")

# %% [markdown]
# ### Late, or lost?
#
# A servo receives a position command every 10 ms, and one in twenty is lost. With best effort the lost command is
# simply replaced by the next one. With reliable delivery the lost command is sent again and arrives late. Later ones
# wait behind it, because a reliable topic preserves the order.
#
# In the picture a trip takes 6 ms. We assume the best case: the servo notices the loss when the lost command should
# have arrived. Its request for the repair takes one trip back, and the repair one more trip there.

# %% tags=["hide-code"]
figure_, axes = plt.subplots(2, 1, figsize=(8, 3.2), layout="constrained", sharex=True)
for axis, again in zip(axes, (False, True), strict=True):
    free = 0.0
    for k in range(6):
        sent, came = 10.0 * k, 10.0 * k + 6.0
        missing = k == 1
        if missing:
            _ = axis.plot([sent, sent + 3], [1, 0.5], color=RED)
            _ = axis.plot(sent + 3, 0.5, "x", color=RED)
        if missing and not again:
            _ = axis.plot([came, came + 10.0], [0, 0], color=GREY, lw=3)
            _ = axis.text(came + 5.0, 0.1, "old command", ha="center", fontsize=8)
            continue
        if missing:
            # The request for the repair goes back; then the command travels once more.
            _ = axis.plot([came, came + 6.0], [0, 1], color=RED, ls="--")
            sent, came = came + 6.0, came + 12.0
        shown = max(came, free)
        free = shown if again else 0.0
        ink = RED if missing else (ORANGE if shown > came else BLUE)
        _ = axis.plot([sent, came], [1, 0], color=ink)
        if shown > came:
            _ = axis.plot([came, shown], [0, 0], color=ink, lw=3)
        _ = axis.plot(shown, 0, "o", color=ink)
    axis.set_yticks([0, 1], ["servo uses it", "sent"])
    _ = axis.set(ylim=(-0.25, 1.2))
    _ = axis.set_title(
        "reliable: the lost one is sent again" if again else "best effort", fontsize=9
    )
_ = axes[1].set_xlabel(
    "time [ms] (red: the lost command; dashed: request to repeat it; orange: waits behind it)"
)
plt.show()

# %%
predict("late_or_lost")

# %% [markdown]
# ![Tracking error added by loss, against the delay of the link, both reliabilities](../docs/charts/late_or_lost.png)
#
# "Sent again" is reliable; "lost, the next one counts" is best effort. The delay is one-way. The desired motion is a
# sine of 300 mrad, once per second. On a fast link, the repaired command arrives before the next one is due, and
# reliable is better for commands as well. On a slow link, several commands wait behind the lost one, and best effort is
# better. In this run the curves cross where the round trip takes somewhat less than one command period, so compare
# these two times.
#
# <details><summary>What differs on DDS</summary>
#
# On the bus, the writer stores enough commands to repeat any of them, and the reader notices a loss at once. Some
# middleware sends datagrams of several packets, which IP splits, so that one lost packet costs its whole datagram. A
# DDS reader notices a loss only when the next message arrives, or when the writer reports what it has sent (a
# **heartbeat**). Without a heartbeat, the repair comes a command period later. A writer of depth 1 can repeat a command
# only until it writes the next one. After that, later commands wait until the writer has reported that the lost one is
# gone.
#
# </details>
#
# A message that is sent *once* (a goal, a change of mode) has no successor, and needs reliable delivery. A stop must
# not depend on a message: the drives have to stop by themselves when no commands arrive.

# %% tags=["hide-code"]
more_claims("joint_states_reliable")

# %% [markdown]
# ### A control loop on a busy computer
#
# An ordinary Linux scheduler is fair. It gives every process slices of the processor in turn, also while your
# controller is due. `SCHED_FIFO` is another scheduling class: its tasks run before all ordinary ones, highest priority
# first. Such a task runs until it finishes or sleeps, or until a more urgent one is due. A **niceness** of -20 (`nice
# -n -20`) only asks the fair scheduler for a larger share.

# %% tags=["hide-code"]
figure_, axes = plt.subplots(2, 1, figsize=(8, 2.6), layout="constrained", sharex=True)
fair = {
    "loop": [(3.0, 3.3, BLUE), (6.3, 6.6, BLUE)],
    "other processes": [(0, 3.0, GREY), (3.3, 6.3, GREY), (6.6, 8.0, GREY)],
}
fifo = {
    "loop": [(k, k + 0.3, BLUE) for k in range(8)],
    "other processes": [(k + 0.3, k + 1.0, GREY) for k in range(8)],
}
for axis, rows_, title in zip(axes, (fair, fifo), ("fair scheduler", "SCHED_FIFO"), strict=True):
    timeline(axis, rows_)
    _ = axis.set_title(f"{title} (sketch; red: the loop is due)", fontsize=9)
    for k in range(8):
        _ = axis.axvline(k, color=RED, ls=":", lw=0.9)
_ = axes[0].set_xlabel("")
plt.show()

# %% [markdown]
# We ran a 1 kHz loop in Python for 1.5 s, next to four processes that always compute, on two cores. The left panel
# sorts the cycles by lateness: at 0.8 you read the lateness that 80% of them did not exceed.
#
# ![Lateness of a loop next to busy processes, and the drift of a relative sleep](../docs/charts/loop_lateness.png)
#
# The right panel compares the two loops of section 2 while other programs disturbed both. The table counts the skipped
# periods of the left panel:

# %% tags=["hide-code"]
row = r"(.+): skipped (\d+) of (\d+) periods; late by ([\d.]+) ms \(half\), ([\d.]+) \(99 %\), ([\d.]+)"
lines = [
    (
        "scheduler",
        "periods skipped",
        "median lateness",
        "99% are below",
        "largest",
        "largest stable gain",
    )
]
for name, *numbers in re.findall(row, read("loop_lateness")):
    skipped, periods, *late_ms = map(float, numbers)
    gain = delay_limit(0.5, 0.5, 1e-3 * late_ms[2] + 0.5e-3)[0]
    lines.append(
        (
            name,
            f"{skipped:.0f} of {periods:.0f}",
            *(f"{v:.2f} ms" for v in late_ms),
            f"{gain:.0f} N m/rad",
        )
    )
table(*lines)

# %% [markdown]
# Last column: if every cycle had the largest lateness of its row, the joint of chapter 6 would be stable up to this
# proportional gain (torque per angle of error). With the default scheduler the controller has to be much softer. The
# largest value of so short a run is not a bound: test for hours under the real load.
#
# A program needs a permission for a real-time priority, so read back what was granted. For this process, now:

# %% tags=["nbval-ignore-output", "hide-code"]
with loop.urgent() as granted:
    no = textwrap.shorten("; ".join(f"{k}: {v}" for k, v in granted.denied.items()), 80)
    print(
        f"scheduler {granted.scheduler}, priority {granted.priority}, "
        f"memory locked: {granted.locked}; denied: {no or 'nothing'}"
    )

# %% [markdown]
# SCHED_FIFO does not remove every delay:
#
# * A **page fault**: memory that the loop touches is not in RAM yet. Allocating and *locking* it beforehand prevents
#   this.
# * A **garbage collection**: Python stops everything in its interpreter to find unused objects.
# * Locks, hardware interrupts, and two scheduling classes that Linux serves before SCHED_FIFO: *stop* (the kernel's own
#   tasks) and SCHED_DEADLINE (`man 7 sched`).
# * **Real-time throttling**: from about version 5.10 to 6.11, Linux by default gave the real-time tasks of a core at
#   most 950 ms of each second (`/proc/sys/kernel/sched_rt_runtime_us`). A FIFO loop that never slept was stopped for
#   the other 50 ms. Since 6.12 a deadline server reserves time for ordinary tasks instead.
#
# A real-time kernel shortens some of these waits, but page faults and garbage collection remain. *PREEMPT_RT* is a
# configuration of the Linux kernel with which a more urgent task can preempt most of the kernel's own code.
#
# <details><summary>A second kernel</summary>
#
# Xenomai's *Cobalt* is a second kernel next to Linux with its own real-time threads (Xenomai 3 documentation).
#
# </details>

# %%
show("fifo_makes_real_time")

# %% tags=["hide-code"]
more_claims("gc_hits_the_loop")

# %% [markdown]
# ### Debugging by timestamps
#
# Put four timestamps on a message, and three on each cycle of a loop. The text below each interval says what to suspect
# if that interval is long:

# %% tags=["hide-code"]
figure_, axes = plt.subplots(2, 1, figsize=(8.4, 3.0), layout="constrained")
for axis, stamps, parts in (
    (
        axes[0],
        ("captured", "published", "received", "callback starts"),
        ("driver", "serialisation, link,\nretransmission", "queue, executor"),
    ),
    (
        axes[1],
        ("wake-up requested", "woken", "work done"),
        (
            "operating system:\nscheduler",
            "your code (lock, page fault,\ngarbage collection, print),\nor a task that preempts it",
        ),
    ),
):
    _ = axis.annotate("", (len(stamps) - 0.7, 0), (-0.3, 0), arrowprops={"arrowstyle": "->"})
    for k, name in enumerate(stamps):
        _ = axis.plot(k, 0, "o", color=BLUE)
        _ = axis.text(k, 0.25, name, ha="center", fontsize=9)
    for k, name in enumerate(parts):
        _ = axis.text(k + 0.5, -0.2, name, ha="center", va="top", fontsize=8.5, color=RED)
    _ = axis.set(ylim=(-1.0, 0.7), xlim=(-0.4, len(stamps) - 0.6))
    axis.axis("off")
plt.show()

# %% [markdown]
# ### Transforms and clocks: where was the camera at that moment?
#
# Perception finds a cup in an image that is 80 ms old. Since then the arm has moved the camera. To compute where the
# cup is in the room, you need the pose of the camera *when the image was taken*. In ROS 2, **tf2** answers this. Nodes
# publish the pose of one frame in another, each with a time stamp: a **transform**. Every node that needs transforms
# has a **transform buffer**, which stores those of the last 10 s.
#
# A **lookup** names two frames and a time. Between two stamps the buffer *interpolates*: it moves the position along
# the straight line and turns the orientation along the shortest rotation (**slerp**). With transforms every $T$ seconds
# and an acceleration of at most $a$, the error of the position is at most $a\,T^2/8$. (An error of the orientation
# comes on top.) After the newest stamp, interpolation is impossible. Guessing a pose there is called **extrapolation**,
# and tf2 refuses it with an exception:

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(8.2, 2.4), layout="constrained")
swing = transforms.SwingingFrame(rate=2.0 * np.pi, radius=1.0)
known, end = np.arange(0.0, 0.61, 0.15), 0.6
fine = np.linspace(0.0, 0.95, 300)
buffer_ = transforms.TransformBuffer()
for stamp in known:
    one = swing.at(stamp)
    buffer_.insert(stamp, one.position[:, 0], one.quaternion[:, 0])
later = np.linspace(end, 0.95, 50)
_ = axis.plot(1e3 * fine, swing.at(fine).position[1], color=GREY, lw=3)
_ = axis.plot(1e3 * known, swing.at(known).position[1], "o", color=BLUE)
inside = np.linspace(0.0, end, 200)
_ = axis.plot(1e3 * inside, buffer_.lookup(inside).position[1], color=BLUE)
for how, ink in (("hold", ORANGE), ("linear", RED)):
    _ = axis.plot(1e3 * later, buffer_.lookup(later, how).position[1], "--", color=ink)
_ = axis.axvspan(1e3 * end, 950, color="#ffebee", zorder=0)
for x, y, words, ink in (
    (615, 0.85, "tf2 refuses every time after this", "black"),
    (960, buffer_.lookup(0.95, "hold").position[1], "hold the newest", "#a06a00"),
    (960, buffer_.lookup(0.95, "linear").position[1], "continue linearly", RED),
    (960, swing.at(0.95).position[1, 0] + 0.15, "true motion", "#757575"),
    (90, 0.8, "stored transforms (dots), interpolated between", BLUE),
):
    _ = axis.text(x, y, words, color=ink, va="center", fontsize=8.5)
_ = axis.set(xlabel="time [ms]", ylabel="y [m]", xlim=(-20, 1150), ylim=(-1.6, 1.1))
plt.show()

# %% [markdown]
# So ask for the pose at the time of the *image*, and wait until a transform that is at least as new has arrived (tf2's
# timeout). The wait is a part of the age from section 3. Some programs request the newest transform instead. For an
# image from the past, that is the pose of another moment.
#
# **A worked example.** The camera sits on a link that swings to and fro, once in 2 s. It moves with at most $v = 0.94$
# m/s and accelerates with at most $a = 3.0$ m/s², and there is a transform every $T = 20$ ms. Between the stamps the
# error is at most $3.0 \cdot 0.02^2/8 = 0.15$ mm. Now look $h = 20$ ms ahead of the newest stamp. Holding the newest
# pose costs up to $v\,h = 19$ mm. The line through the last two poses costs up to $a\,h\,(h + T)/2 = 1.2$ mm. The chart
# compares these three bounds with lookups:
#
# ![Error of a lookup against look-ahead, and against the time between transforms](../docs/charts/transform_lookups.png)
#
# For a look-ahead well above $T$, the bound of the linear continuation grows with the square of the look-ahead, and the
# bound of holding only in proportion to it. If the look-ahead exceeds 0.3 of a swing (dotted), continuing the line is
# worse than holding: the camera has turned back, but the line goes on. The printed times are per lookup, for many
# lookups in one call.
#
# <details><summary>More about the chart</summary>
#
# Each point is the largest error over a whole swing of 2 s. For "SciPy's Slerp", NumPy interpolates the positions, with
# the same error as our buffer.
#
# </details>

# %% tags=["nbval-ignore-output", "hide-code"]
timing = next(line for line in read("transform_lookups").splitlines() if "of a lookup" in line)
print(textwrap.fill(timing, 90))

# %% [markdown]
# **Which clock?** With the parameter `use_sim_time`, a node takes its time from the topic `/clock`, which a simulator
# or a recording publishes. All nodes have to agree on it. What happens if they don't?

# %%
predict("clock_behind")

# %% tags=["hide-code"]
motion = transforms.SwingingFrame()


def lookup_at(requested, offset=0.0):
    """Return what a lookup says, after 20 s of transforms whose sender's clock is off [s]."""
    buffer = transforms.sample(motion, 0.01, 20.0, offset=offset)
    try:
        place = buffer.lookup(requested).position
    except transforms.ExtrapolationError as error:
        return "refused: extrapolation into the " + ("past" if "past" in str(error) else "future")
    true = motion.at(requested).position[:, 0]
    return f"no exception; wrong by {1e3 * np.linalg.norm(place - true):.0f} mm"


table(
    ("what is wrong", "lookup of the pose 0.1 s ago", "how to tell"),
    ("nothing", lookup_at(19.9), ""),
    (
        "the sender's clock is 50 ms behind",
        lookup_at(19.9, -0.05),
        "compare the clocks; the error grows with the speed",
    ),
    ("the sender's clock is 200 ms behind", lookup_at(19.9, -0.2), "exception"),
    (
        "sender on wall time, this node on simulated time",
        lookup_at(19.9, 1.7e9),
        "stamps of about 1.7e9 s next to stamps near 0",
    ),
    (
        "sender on simulated time, this node on wall time",
        lookup_at(1.7e9 - 0.1),
        "the same, the other way round",
    ),
)

# %% [markdown]
# The dangerous row is the second one: a small offset raises no exception. The error is about speed times offset. With a
# timeout of 0.2 s, the third row would raise none either.
#
# When a simulation is restarted, its clock jumps back, and new transforms have older stamps than those of the previous
# run. tf2's buffer clears itself when the clock of its own node jumps back. A node without `use_sim_time` never notices
# the jump, so its buffer still holds the previous run. It ignores new transforms that are more than 10 s older than its
# newest one, and sorts the others between the old ones. We restart, send ten new transforms, and look up the newest:

# %% tags=["hide-code"]


def after_restart(back, clear=False):
    """Return how many new transforms are stored after a jump back [s], and what a lookup finds."""
    buffer = transforms.sample(motion, 0.01, 20.0)
    if clear:
        buffer.clear()
    for k in range(10):
        # The new run: the camera rests one metre above the axis.
        buffer.insert(20.0 - back + 0.01 * k, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0])
    run = "new" if buffer.lookup(buffer.newest).position[2] > 0.5 else "previous"
    return f"{10 - buffer.ignored} of 10", f"a pose of the {run} run"


table(
    ("after the restart", "new transforms stored", "lookup of the newest", "how to tell"),
    ("clock back by 5 s", *after_restart(5.0), "poses jump"),
    ("clock back by 15 s", *after_restart(15.0), "warnings about old data"),
    ("clock back by 15 s, buffer cleared", *after_restart(15.0, clear=True), ""),
)

# %% tags=["hide-code"]
more_claims(
    "tf_extrapolates",
    "half_period_half_error",
    "linear_beats_hold",
    "wrong_clock_fails",
    "restart_continues",
)

# %% [markdown]
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *Messages arrive late.* Record the four timestamps. The longest interval shows where the time went,
# if all clocks agree. Incompatible QoS is not the cause: with it, this reader would get nothing at all from this
# writer.
#
# <details><summary>What people get wrong here</summary>
#
# They stamp the message when they publish it, which hides all delay before that. Or they change both ends to reliable,
# which turns losses into additional delay. (`ros2 topic info -v` shows the policies of both ends.) Two computers
# also need synchronised clocks; otherwise the timestamps cannot be compared.
#
# </details>
#
# </div>
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The controller is jittery*: it runs at uneven intervals. Record the three timestamps of each
# cycle. If the loop is a callback, being shorter than a period is not enough, because it also waits for other
# callbacks.
#
# <details><summary>What people get wrong here</summary>
#
# They request real-time priority and do not read back what was granted. Or they set `use_sim_time`, which only selects
# the simulated clock. Or they look at the mean period, which is right to the microsecond even if cycles come in bunches
# with gaps between them.
#
# </details>
#
# </div>

# %% [markdown]
# ### Listed, and yet not matched
#
# `ros2 topic list` shows your topic, and still nothing arrives. The list proves little: it shows a topic as soon as one
# end of it exists, perhaps only your own subscriber. `ros2 topic info --verbose` with the topic's name lists all ends
# that were discovered, with types and policies.
#
# Discovery and matching are two steps. First the programs find each other (DDS calls each a **participant**), and each
# lists the writers and readers of the other. Then a writer and a reader are **matched** if domain, name and type agree,
# the QoS is compatible, and nothing else forbids it:

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 3, figsize=(8.4, 2.1), layout="constrained")
for axis, title, reason, ink, listed, matched in (
    (axes[0], "not discovered", "other domain id; or\nno multicast, no peer", RED, False, False),
    (axes[1], "listed, not matched", "other type; or\nincompatible QoS", RED, True, False),
    (axes[2], "listed and matched", "messages arrive", BLUE, True, True),
):
    for x, end in ((0.0, "writer"), (2.0, "reader")):
        box = plt.Rectangle((x - 0.5, -0.5), 1.0, 1.2, fc="#f5f5f5", ec=GREY, lw=1.2)
        _ = axis.add_patch(box)
        _ = axis.text(x, 0.52, "participant", ha="center", va="center", fontsize=7.5)
        _ = axis.plot(x, -0.2, "o", color=BLUE)
        _ = axis.text(x, 0.08, end, ha="center", va="center", fontsize=8.5)
    if listed:
        both = {"arrowstyle": "<->", "ls": "--", "color": "#757575"}
        _ = axis.annotate("", (1.52, 0.52), (0.48, 0.52), arrowprops=both)
        _ = axis.text(1.0, 0.6, "lists", ha="center", va="bottom", fontsize=8.5, color="#616161")
        line = {"arrowstyle": "->" if matched else "-", "ls": "-" if matched else ":"}
        line |= {"color": ink, "lw": 1.6}
        _ = axis.annotate("", (1.9, -0.2), (0.1, -0.2), arrowprops=line)
    if not matched:
        _ = axis.plot(1.0, -0.2 if listed else 0.52, "x", color=RED, ms=10, mew=2.5)
    _ = axis.text(1.0, -0.65, reason, ha="center", va="top", fontsize=8.5, color=ink)
    _ = axis.set_title(title, fontsize=9.5)
    _ = axis.set(xlim=(-0.6, 2.6), ylim=(-1.35, 0.95))
    axis.axis("off")
plt.show()

# %% [markdown]
# Each row is a run of two processes on Cyclone DDS. Its **built-in topics** list what discovery has found. A **peer**
# is an address of another computer, written into the configuration. A **type hash** is a number computed from the
# fields of a message type; an *appendable* type may get more fields at its end.

# %% tags=["hide-code"]
table(
    ("cause", "other end listed", "matched", "how to tell"),
    (
        "another domain id (`ROS_DOMAIN_ID`)",
        "no",
        "no",
        "no participant is discovered; compare the ids",
    ),
    (
        "no multicast, no peer named",
        "no",
        "no",
        "no participant is discovered, although the ids agree",
    ),
    (
        "no multicast, one end names the other as a peer",
        "yes",
        "yes",
        "it works; one direction is enough",
    ),
    ("incompatible QoS", "yes", "no", "the event *offered incompatible QoS* names the policy"),
    (
        "same topic name, other type name",
        "yes",
        "no",
        "the same event names *type consistency*; compare both type names",
    ),
    (
        "same type name, a field added, changed or renamed",
        "yes",
        "no",
        "the same event; compare the type hashes",
    ),
    (
        "the same, types declared *appendable*",
        "yes",
        "yes",
        "no event; the reader gets 0 for an added field",
    ),
)

# %% [markdown]
# A service hides the same causes. DDS writes its request without an error even if nobody serves it. Discovery tells the
# cases apart:

# %% tags=["nbval-ignore-output", "hide-code"]
try:
    from course.oracles import unserved

    observed_ = {case: unserved.request(case) for case in unserved.CASES}
    display(
        table(
            ("case, on Cyclone DDS", "reader of the requests listed", "matched", "so the cause is"),
            *(
                (
                    case,
                    *("yes" if each else "no" for each in (one.listed, one.matched)),
                    unserved.CAUSES[one.cause] or "none, the reply came",
                )
                for case, one in observed_.items()
            ),
        )
    )
except ImportError as error:
    print(f"not run here: {error}")

# %% [markdown]
# In ROS 2, call `wait_for_service` first, and give each request a time limit.
#
# <details><summary>Same type name, other definition: what Cyclone DDS and ROS 2 compare</summary>
#
# Two computers may have different versions of one message. On Cyclone DDS, each end announces a hash of its definition
# (the *type identifier* of DDS-XTypes). We gave both ends the same type name and different fields. The hashes differed
# in each case. Cyclone takes a type as *final* unless it is declared otherwise. Then a field that is added, changed or
# renamed prevents the match. The event *offered incompatible QoS* names the policy *type consistency*, and no message
# is decoded with the wrong definition. (The status *inconsistent topic*, which DDS has for this, stayed at 0.)
#
# If both types are declared *appendable*, an added field does not prevent the match. A reader that knows the field gets
# 0 although nobody sent it. To prevent this, the reader can set the policy *type consistency* to *disallow type
# coercion*; then these two ends were not matched either.
#
# Since Iron (2023), ROS 2 computes a **type hash** of its own for each interface: the text `RIHS01_` and a SHA-256 of
# its description (REP 2016). On DDS it travels in the user data that each end announces, and `ros2 topic info -v` shows
# it. REP 2016 does not require the middleware to reject a mismatch. Whether ROS 2 matches the ends depends on the
# middleware, which may compare only the type names. So compare the hashes.
#
# </details>

# %% tags=["hide-code"]
more_claims("mismatch_is_late", "listed_is_matched")

# %% [markdown]
# <table> <tr><th>symptom</th> <th>likely cause</th> <th>test</th> <th>fix</th></tr> <tr><td>nothing arrives: not
# matched</td> <td>incompatible QoS; or another topic name, type or domain</td> <td>compare both ends (`ros2 topic info
# --verbose`)</td> <td>raise the offer or lower the request; or the same name, type and domain</td></tr> <tr><td>nothing
# arrives: matched</td> <td>nothing is published, or a callback never returns</td> <td>`ros2 topic hz`; log when each
# callback starts and ends</td> <td>publish; never wait inside a callback</td></tr> <tr><td>messages always late by
# several periods</td> <td>a full queue</td> <td>set the depth to 1</td> <td>depth 1, or read everything and use the
# newest</td></tr> <tr><td>the larger the message, the later it is</td> <td>serialisation, or fragments sent again</td>
# <td>send a small message; if it is fast, size matters. Send the large one within one computer; if that is fast, the
# link is slow</td> <td>another message type, one process, shared memory, compression</td></tr> <tr><td>late between
# reception and callback</td> <td>other callbacks run first</td> <td>time each callback, add them up</td> <td>a group
# and a thread of its own, or a process</td></tr> <tr><td>jitter grows with load</td> <td>ordinary scheduling, or a
# lock</td> <td>read back scheduler, core and memory locking; test under load</td> <td>SCHED_FIFO; priority inheritance;
# no lock in the loop</td></tr> <tr><td>period too long by a constant</td> <td>the loop sleeps for a period</td>
# <td>measure the drift over a thousand periods</td> <td>sleep until the release</td></tr> <tr><td>a display that starts
# late stays empty</td> <td>one end is volatile or best effort</td> <td>start the display before the writer. If it stays
# empty, the writer offers too little; otherwise nothing is stored for late readers</td> <td>transient local and
# reliable at both ends; until the first status arrives, assume that it is unsafe</td></tr> </table>
#
# ## 8 · Exercises
#
# `check` runs your function on new random cases. It says what is wrong and, where it can, why.

# %% [markdown]
# ### How busy is the processor?
#
# A warm-up, before any response time.

# %%
card("utilisation")


# %%
def utilisation(executions, periods):
    """Return the utilization of periodic tasks, Liu and Layland's bound, and what follows."""
    # As if less work than time were always enough.
    load = np.sum(executions) / np.sum(periods)
    return load, 1.0, 1 if load < 1.0 else -1


check(utilisation)

# %% [markdown]
# ### Are these two ends compatible?

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
# ### A queue with depth and lifespan

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
    # Every read takes what has arrived since the previous read, as far as there is room.
    taken, edges = np.full((len(reads), depth), -1), [-np.inf, *reads]
    for row in range(len(reads)):
        new = [k for k, at in enumerate(arrivals) if edges[row] < at <= edges[row + 1]][:depth]
        taken[row, : len(new)] = new
    return taken, len(arrivals) - int(np.sum(taken >= 0))


check(keep_last)

# %% [markdown]
# ### Messages in fragments on a lossy link

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
# ### Worst-case response times

# %%
card("response_times")


# %%
def response_times(executions, periods, deadlines, blocking):
    """Return the longest response times of periodic tasks on one processor that can be interrupted.

    Args:
        executions, periods: of each task, the most important first, shape (n,) [us].
        deadlines: after its release, at most its period, (n,) [us].
        blocking: longest time for which less important tasks can block this one, (n,) [us].

    Returns:
        Of each task, -1 where it can miss its deadline, shape (n,) [us].
    """
    # As if every task ran once.
    responses = np.cumsum(executions) + np.asarray(blocking)
    return np.where(responses <= np.asarray(deadlines), responses, -1)


check(response_times)

# %% [markdown]
# ### A periodic loop that skips missed cycles

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
# Two nodes that follow a part on a conveyor belt.

# %%
card("follow_part")


# %%
def follow_part(frames, saves, work, late, period, deadline, drift, ticks):
    """Return the commands that a drive uses, (m,) [m]; the table of the task explains the input."""
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
# A message has twelve packets, each lost with probability $p$, independently, and none is sent again. With which
# probability is the message lost? Any equivalent form is right. <span class="kernel-only">The formula in the cell is
# only close; change it.</span>

# %%
answer("picture_lost_like_packet", "12*p")

# %% [markdown]
# ### Put it into your robot
#
# The course's pick-and-place robot (`drills robot` in a terminal) receives its images as messages. What does it cost
# when they arrive late?

# %%
your_robot(10)

# %% [markdown]
# ## 9 · Frontier: fewer nodes, the same clocks
#
# What is changing in the middleware itself, according to the projects' documents:
#
# * *Zenoh under ROS 2* (`rmw_zenoh`, packages for Humble and Jazzy since January 2025) replaces multicast by a router,
#   a program that all nodes contact for discovery. Its design document says that no QoS settings are incompatible, so
#   pairs that are silent on DDS do connect. Deadline and lifespan are not implemented.
# * **Zero-copy** transports (Eclipse iceoryx; loaned messages in ROS 2): the reader accesses the writer's memory
#   directly, so the time of the transfer does not depend on the size of the message. The message type needs a fixed
#   size.
# * *Event executors* (`EventsExecutor`, Iron 2023) run callbacks first in, first out, without a ready set.
# * *PREEMPT_RT in the standard kernel* (Linux 6.12, November 2024): you no longer have to patch the kernel's source
#   code. You still have to choose a kernel in which it is switched on, and assign the priorities.
#
# A larger change comes from learning. A learned controller maps images to actions. It is also called a policy (not a
# QoS policy), and replaces perception, planner and some of the controller. One **inference**, the computation from an
# image to its output, is slow. So the policy outputs several actions at once, an **action chunk**, and the arm executes
# them while the next inference runs.

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(8.4, 2.2), layout="constrained")
timeline(
    axis,
    {
        "inference (100 ms)": [(100 * k, 100 * k + 99, ORANGE) for k in range(4)],
        "chunk of 5 actions": [
            (100 * (k + 1) + 20 * i, 100 * (k + 1) + 20 * i + 20, BLUE)
            for k in range(3)
            for i in range(5)
        ],
    },
)
for k in range(4):
    _ = axis.plot(100 * k, 0.45, "v", color=GREEN, ms=9)
_ = axis.annotate("", (200, -0.5), (0, -0.5), arrowprops={"arrowstyle": "<->", "color": RED})
_ = axis.text(
    100,
    -0.5,
    "age of the image at the chunk's end",
    ha="center",
    va="center",
    color=RED,
    fontsize=8.5,
    bbox={"fc": "white", "ec": "none", "pad": 1},
)
_ = axis.set_title("green: an image is taken", fontsize=9)
plt.show()

# %%
predict("chunk_hides")

# %% [markdown]
# A chunk at least as long as an inference hides the *pause*, not the age. When the last action of a chunk ends, its
# image is as old as one inference plus the whole chunk. That is 100 + 20 = 120 ms with one action, and 100 + 100 = 200
# ms with five. With one action, however, the arm then stands still until the next action comes, and its image ages to
# 200 ms as well.
#
# The ages in the table include three more times: the camera's own, the wait for its next image, and the wait for the
# arm's next action. So they are larger:

# %% tags=["hide-code"]
think, step = 0.1, 0.02
camera = Stage("camera", 0.005, 1 / 30)
lines = [("actions per chunk", "arm moves", "mean age", "mean age, simulated", "largest age")]
for n in (1, 5, 10):
    stages = [camera, Stage("policy", think, max(think, n * step)), Stage("arm", 1e-4, step)]
    output = age(stages)
    draws = np.random.default_rng(n).random((16, 3))
    run_ = [run_chain(stages, p, seconds=3.0).age(moments).mean() for p in draws]
    share = min(1.0, n * step / stages[1].period)
    ages = (output.mean, np.mean(run_), output.greatest)
    lines.append((n, f"{share:.0%} of the time", *(f"{1e3 * x:.0f} ms" for x in ages)))
table(*lines)

# %% [markdown]
# One action and five have the same ages, but with five the arm never stops. With ten actions the ages are larger. Even
# the smallest is too old for fast feedback, so keep that loop in its own real-time thread, and let it react if the
# policy's next chunk misses its deadline.
#
# Where should a large model run? In the simplest case, each inference reads all weights of the model from memory once.
# (A model that computes its output step by step reads them in each step.) With $n$ weights of $b$ bytes, $k$ actions
# per inference and $f$ actions per second, it reads $n\,b\,f/k$ bytes per second. Compare this with the memory
# bandwidth of a computer: two memory channels of a PC give about 90 GB/s. Weights often have two bytes.

# %%
show("seven_billion_on_board")

# %% tags=["hide-code"]
more_claims("chunks_hide_latency")

# %% [markdown]
# ## 10 · Interview
#
# Answer aloud, then open the answer: first what you can say in a minute, then the whole of it, then follow-up
# questions.

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
# <details><summary>An answer</summary>
#
# *First* I find out where the gap is: four timestamps on each command, and three on each cycle of the loop. If the time
# between wake-up and the end of the work is long, either my own code takes long (a lock, a page fault, garbage
# collection, a print), or a more urgent task or an interrupt preempts it. If the wake-up itself is late, it is the
# scheduler, and I check which priority was granted.
#
# *Second* I compare with a prediction: response times of all tasks that share the core, the sum of the callbacks that
# share the thread, and blocking by locks. If the gap is larger, something is missing from my list.
#
# *Third* I repeat it under load, with busy processes. I'd change my mind about the loop if its cycles are on time and
# the commands use an old image. Then the delay is in a queue before the loop, and the loop is innocent.
#
# </details>
#
# Five questions on this chapter, drawn by a seed.

# %%
checkpoint("middleware", ["", "", "", "", ""], seed=1)
