"""A graph of nodes and topics: what each end of a topic asks for, and who runs where.

A camera's pictures become poses, the poses plans, the plans commands of a loop; a monitor that
starts late needs the zone that a planner published once. The run is computed at the start, for
`SPAN` seconds, as `course.middleware` runs the same nodes on its bus (`tests/middleware` holds both
together), and is shown twenty times slower.

Left out: the loop's and the planner's own use of perception's processor (one part in ten at 1 kHz),
and other traffic on the wire.
"""

import math

import numpy as np
from numba.extending import register_jitable

from course import role
from course.middleware.qos import QoS, compatible
from course.simulations import pen as draw
from course.simulations import splitmix
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider

read, serve = register_jitable(role.read), register_jitable(role.serve)

SPAN, SETTLED, PACE = 5.0, 1.0, 0.05  # of the run [s]; where the picture begins [s]; of the picture
CAMERA, PHASE, SEEING = 1.0 / 30.0, 0.4, 0.020  # period and its phase; execution unloaded [s]
PLAN_PERIOD, PLAN_PHASE, PLAN = 0.1, 0.37, 0.040  # of the planner [s, 1, s]
LOOP, HOLD, LOGGER = 1e-4, 0.002, 0.110  # of a tick; of the logger's lock; its period [s]
IMAGE, FRAGMENT, RATE, DELAY = 921_600, 1472, 125e6, 2e-4  # bytes, bytes, bytes/s, s
ZONE, DEADLINE = 0.2, 0.050  # when the zone is published; the deadline of a profile [s]
PACKETS = math.ceil(IMAGE / FRAGMENT)
_IMAGES, _PLANS, _TICKS = 160, 60, 5010

PROFILES = {
    "best effort": QoS("best_effort", depth=1),
    "reliable": QoS("reliable", depth=1),
    "reliable, kept for later": QoS("reliable", depth=1, durability="transient_local"),
    "reliable, each 50 ms": QoS("reliable", depth=1, deadline=DEADLINE),
}
TOPICS = ("image", "poses", "plan", "zone")
DEFAULTS = (0, 1, 1, 2)  # profile of both ends of a topic that is not chosen
SCHEDULES = (
    "its own thread, first",
    "perception's thread",
    "waits for a logger's lock",
    "lock, with inheritance",
)
NODES = ("camera", "perception", "planner", "controller", "robot", "monitor")
# Offered against requested QoS (DDS): a topic is silent if the writer offers less than its reader
# requests.
# The policy that keeps an offer (row) from a request, by its place in `FAILING`; 0: none does.
FAILING = ("", "reliability", "durability", "deadline")
_VERDICT = np.array(
    [
        [FAILING.index((*compatible(a, b), "")[0]) for b in PROFILES.values()]
        for a in PROFILES.values()
    ]
)

CONTROLS = Record(
    topic=menu("Topic", TOPICS),
    offered=menu("its writer offers", tuple(PROFILES)),
    requested=menu("its reader requests", tuple(PROFILES)),
    depth=slider("its reader keeps", 1, 1, 10, 1),
    loss=slider("Packets lost", 0.0, 0.0, 2.0, 0.1, "in 1000", 1),
    load=slider("Processor taken", 0.0, 0.0, 80.0, 5.0, "%", 0),
    loop=slider("Loop", 1000.0, 100.0, 1000.0, 100.0, "Hz", 0),
    schedule=menu("The loop runs in", SCHEDULES),
    joins=slider("Monitor starts at", 1.0, 0.0, 2.0, 0.1, "s", 1),
    node=menu("Node", NODES, 3, live=True),
)
STATE = Record(
    time=Field(SETTLED, unit="s"),
    seed=Field(np.uint64(7), shape=(1,)),
    sent=Field(0.0, shape=(_IMAGES,), unit="s"),  # when a picture was taken and sent,
    came=Field(-1.0, shape=(_IMAGES,), unit="s"),  # when it came, -1 if it is lost;
    images=Field(0),
    begun=Field(0.0, shape=(2, _IMAGES), unit="s"),  # jobs of perception and planner: begin,
    done=Field(0.0, shape=(2, _IMAGES), unit="s"),  # end,
    born=Field(0.0, shape=(2, _IMAGES), unit="s"),  # and when their picture was taken
    jobs=Field(0, shape=(2,)),
    due=Field(0.0, shape=(_TICKS,), unit="s"),  # ticks of the loop: when each was due,
    start=Field(0.0, shape=(_TICKS,), unit="s"),  # when it ran, skipped ones left out,
    stamp=Field(-1.0, shape=(_TICKS,), unit="s"),  # and of which picture; -1: no plan yet
    ticks=Field(0),
    due_ticks=Field(0),  # ticks that were due
    missed=Field(0),  # deadlines of the topic that passed, on the reader's side
    dropped=Field(0),  # samples that newer ones pushed out of the topic's queue
    mean=Field(0.0, unit="s"),
    late=Field(0.0, unit="s"),
    zone=Field(0),  # whether the monitor knows it
    clicked=Field((-1.0, -1.0)),
)


@register_jitable
def profile(controls, topic, reader):
    """Return the number of the profile of an end of a topic."""
    if topic == controls["topic"]:
        return controls["requested"] if reader else controls["offered"]
    return DEFAULTS[topic]


@register_jitable
def verdict(controls, topic):
    """Return the policy that keeps a topic silent, by its place in `FAILING`; 0: it is heard."""
    return _VERDICT[profile(controls, topic, False), profile(controls, topic, True)]


@register_jitable
def reliable(controls, topic):
    """Return whether what is lost is sent again: where both ends want it."""
    return profile(controls, topic, False) > 0 and profile(controls, topic, True) > 0


@register_jitable
def _depth_of(controls, topic):
    return controls["depth"] if topic == controls["topic"] else 1


@register_jitable
def seeing(controls):
    """Return the execution time of perception for an image [s].

    Perception gets the share of the processor that the load leaves.
    """
    return SEEING / (1.0 - 0.01 * controls["load"])


@register_jitable
def _travel(sent, packets, size, controls, topic, seed):
    """Return the arrival times of messages sent at these times, (N,) [s]; -1 for a lost one."""
    came = np.full(sent.size, -1.0)
    # Incompatible profiles never match, so nothing is transported.
    if verdict(controls, topic):
        return came
    p, last, again = 1e-3 * controls["loss"], 0.0, reliable(controls, topic)
    for k in range(sent.size):
        remaining, now, bulk = packets, sent[k], size
        # One round of the link for each pass: the lost packets are sent again, if it is reliable.
        while remaining > 0:
            now += bulk / RATE + DELAY
            # Each packet is lost independently; the reader of a reliable topic requests exactly the
            # lost ones (negative acknowledgement).
            dice = np.empty(remaining)
            splitmix.uniform(seed, dice)
            remaining = np.sum(dice < p)
            if remaining > 0 and not again:
                break
            now += DELAY * (remaining > 0)  # the reader asks again
            bulk = min(size, remaining * FRAGMENT)
        if remaining == 0:
            # Delivery in order: a message waits for those before it.
            came[k] = last = max(now, last)
    return came


@register_jitable
def shared(arrived, taking, depth, due):
    """Return the schedule of perception and the loop in one thread.

    The thread refills its ready set only when the set is empty, like the executor of ROS 2.

    Returns:
        taken, begun: pictures, by number, and when each is begun; starts: of the ticks, -1 if
        skipped.
    """
    starts, taken = np.full(due.size, -1.0), np.empty(arrived.size, np.int64)
    begun, now, tick, last, jobs = np.empty(arrived.size), 0.0, 0, -1, 0
    while True:
        waits = tick < due.size and due[tick] <= now
        came = last + 1 < arrived.size and arrived[last + 1] <= now
        # Idle: jump to the next event, or end where there is none.
        if not waits and not came:
            after = due[tick] if tick < due.size else np.inf
            if last + 1 < arrived.size:
                after = min(after, arrived[last + 1])
            if after == np.inf:
                return taken[:jobs], begun[:jobs], starts
            now = after
        if waits:
            # A tick that is due runs first, as timers precede subscriptions in the executor's ready
            # set.
            starts[tick] = now
            while tick < due.size and due[tick] <= now:  # one tick waits, those after it are lost
                tick += 1
            now += LOOP
        # Perception was ready too: it takes the oldest image that the queue still holds. Ticks that
        # become due meanwhile wait until the set is refilled.
        if came:
            newest = np.searchsorted(arrived, now, side="right") - 1
            last = max(last + 1, newest - depth + 1)
            taken[jobs], begun[jobs], jobs = last, now, jobs + 1
            now += taking


@register_jitable
def locked(begun, done, due, inherits):
    """Return starts of the ticks where a logger's lock is in the way, -1 if skipped.

    The logger is the least urgent: it runs where perception does not. With inheritance it is as
    urgent as the loop while that waits.
    """
    starts = due.copy()
    for k in range(int((SPAN - 0.5) / LOGGER)):
        held = LOGGER * k
        # The logger starts its section when perception leaves it the processor.
        for job in range(begun.size):
            if begun[job] <= held < done[job]:
                held = done[job]
        first = np.searchsorted(due, held, side="right")
        waits = due[first] if inherits and first < due.size else np.inf
        # The logger holds the lock and works off what remains of its section; perception preempts
        # it, unless the loop waits for the lock and the logger has inherited its priority.
        now, remaining = held, HOLD
        # Priority inversion until the loop waits, with inheritance (Sha, Rajkumar and Lehoczky,
        # 1990), or for whole executions of perception without it.
        for job in range(begun.size):
            if held < begun[job] < now + remaining and begun[job] < waits:
                remaining -= begun[job] - now
                now = min(done[job], max(waits, begun[job]))
        over = now + remaining
        # The first tick after the lock was taken runs when it is released, those due meanwhile are
        # skipped.
        last = np.searchsorted(due, over, side="left")
        if first < last:
            starts[first] = over
            starts[first + 1 : last] = -1.0
    return starts


def initial(controls, state):
    """Compute the whole run."""
    seed, taking = state["seed"], seeing(controls)
    n = int(SPAN / CAMERA)
    sent = (PHASE + np.arange(n)) * CAMERA
    # Images over the link, then perception, the planner and the loop, each from what the stage
    # before it has delivered.
    came = _travel(sent, PACKETS, IMAGE, controls, 0, seed)
    state["sent"][:n], state["came"][:n], state["images"] = sent, came, n
    arrived, born = came[came >= 0.0], sent[came >= 0.0]
    period = 1.0 / controls["loop"]
    due = period * np.arange(1, int(SPAN / period))
    # In one thread perception delays the loop; else the loop has its own thread, possibly with a
    # lock.
    if controls["schedule"] == 1:
        taken, begun, starts = shared(arrived, taking, _depth_of(controls, 0), due)
    else:
        taken, begun = serve(arrived, np.full(n, taking), _depth_of(controls, 0))
        starts = due.copy()
        if controls["schedule"] > 1:
            starts = locked(begun, begun + taking, due, controls["schedule"] == 3)
    _jobs(state, 0, begun, taking, born[taken])
    # Poses travel as one packet; the planner reads its queue at its own period and skips ticks
    # before the first pose.
    poses = _travel(begun + taking, 1, 1472, controls, 1, seed)
    received, posed = poses[poses >= 0.0], born[taken][poses >= 0.0]
    ticks = PLAN_PERIOD * (PLAN_PHASE + np.arange(int(SPAN / PLAN_PERIOD)))
    which = read(received, ticks, _depth_of(controls, 1))
    ticks, which = ticks[which >= 0], which[which >= 0]
    _jobs(state, 1, ticks, PLAN, posed[which])
    plans = _travel(ticks + PLAN, 1, 1472, controls, 2, seed)
    known, aim = plans[plans >= 0.0], posed[which][plans >= 0.0]
    # Each tick that ran uses the newest plan by then, with the time stamp of the image behind it.
    ran = starts >= 0.0
    m = np.sum(ran)
    state["due"][:m], state["start"][:m] = due[ran], starts[ran]
    newest = np.searchsorted(known, starts[ran], side="right") - 1
    for k in range(m):
        state["stamp"][k] = aim[newest[k]] if newest[k] >= 0 else -1.0
    state["ticks"], state["due_ticks"] = m, due.size
    state["late"] = np.max(starts[ran] - due[ran])
    _report(controls, state, arrived, received, known, taken)


@register_jitable
def _jobs(state, stage, begun, taking, born):
    state["jobs"][stage] = begun.size
    state["begun"][stage, : begun.size] = begun
    state["done"][stage, : begun.size] = begun + taking
    state["born"][stage, : begun.size] = born


@register_jitable
def _report(controls, state, arrived, received, known, taken):
    """Write what the ends are told, and the mean age of commands."""
    topic, came = controls["topic"], arrived
    if topic > 0:
        came = received if topic == 1 else known
    # Samples that newer ones pushed out are the numbers that were never taken.
    if topic == 0 and taken.size > 0:
        state["dropped"] = taken[-1] + 1 - taken.size
    # Deadline events on the reader's side: each full deadline between two arrivals counts once.
    if controls["requested"] == 3 and topic < 3 and not verdict(controls, topic):
        for k in range(came.size - 1):
            state["missed"] += int((came[k + 1] - came[k]) / DEADLINE)
    # A late joiner learns the zone only if both ends are transient local: the writer stores it for
    # later.
    selected = profile(controls, 3, False) == 2 and profile(controls, 3, True) == 2
    state["zone"] = not verdict(controls, 3) and (controls["joins"] <= ZONE or selected)
    times = np.linspace(2.0, SPAN - 0.2, 2003)
    ages = times - stamps(state, times)
    state["mean"] = np.mean(ages) if np.min(stamps(state, times)) >= 0.0 else -1.0


@register_jitable
def stamps(state, times):
    """Return, for these times (N,), when the image behind the current command was taken [s].

    The value is -1 where there is none.
    """
    index = np.searchsorted(state["start"][: state["ticks"]] + LOOP, times, side="right") - 1
    return state["stamp"][np.maximum(index, 0)]


def advance(state, controls, seconds):
    """Advance the simulation, twenty times slower than the nodes.

    At the end of the run it starts again.
    """
    passed = state["time"] + PACE * seconds - SETTLED
    state["time"] = SETTLED + passed % (SPAN - SETTLED - 0.5)


@register_jitable
def bound(controls):
    """Return the largest lateness of a tick by the schedule [s]; -1 where it is unbounded."""
    kind, taking = controls["schedule"], seeing(controls)
    if kind == 0:
        return 0.0
    if kind == 1:
        return taking + LOOP
    if kind == 3:
        return HOLD
    # Without inheritance the section stretches over whole executions of perception, as many as its
    # share of the gaps requires; without gaps it never ends.
    gap = CAMERA - taking  # what a full stream of pictures leaves to the logger, each period
    return HOLD + taking * math.ceil(HOLD / gap) if gap > 0.01 * HOLD else -1.0


TITLE = "A graph of nodes and topics"
word, colour = draw.words_table(), draw.colours_table()
_NAMES, _FLOWS = word(*NODES)[0], word(*TOPICS, "commands", "joint states", "stop", "look again")[0]
_WHY = word("", *FAILING[1:])[0]
_QUIET, _CHOSEN, _TOPIC, _SERVICE = colour("#eef3f7", "#fbe3c8", "#c79100", "#0072b2")
_MS, _PER_CENT, _HZ, _SIGHT, _BLIND, _NO_PLAN, _NO_BOUND, _COMMA = word(
    " ms", " %", " Hz", "sees its zone", "blind", "no plan", "none", ", "
)
_AGE, _MEAN, _LATE, _BOUND, _SKIPPED, _LOST, _EXPECTED, _DROPPED, _MISSED, _MONITOR = word(
    "command age",
    "mean command age",
    "loop late by",
    "lateness bound",
    "ticks skipped",
    "images lost",
    "loss expected",
    "queue dropped",
    "deadlines missed",
    "monitor",
)
_GANTT, _LAST, _TRACE, _TIME, _OLD = word(
    "who runs", "last 150 ms [ms]", "age of the command in force", "time [s]", "ms"
)
_ROWS = word("perception", "planner", "loop")[0]
# Of each edge: from, to, how often [Hz] where the run does not say, and whether it is a service.
_EDGES = np.array([(0, 1), (1, 2), (2, 3), (2, 5), (3, 4), (4, 3), (5, 4), (2, 1)])
_SLOW, _FIRST_SERVICE = (0.2, 0.1, 0.5), 6  # zone, stop, look again
_AT = np.array([(0.8, 4.35), (2.9, 4.35), (5.0, 4.35), (5.0, 2.75), (2.9, 2.75), (0.8, 2.75)])
_W, _H, _WINDOW = 0.68, 0.27, 0.150  # half a box; of the chart of who runs [s]


def drag(controls, state, x, y):
    """Handle a drag: the node that is nearest to the pointer is shown."""
    controls["node"] = np.argmin((_AT[:, 0] - x) ** 2 + (2.0 * (_AT[:, 1] - y)) ** 2)
    state["clicked"][0], state["clicked"][1] = min(max(x, 0.0), 9.0), min(max(y, 0.0), 5.0)


def press(controls, state, key):
    """Handle a key: arrow keys go from node to node."""
    controls["node"] = (controls["node"] + (1 if key in (1, 3, 4) else -1)) % len(NODES)


@register_jitable
def _rate(state, controls, edge):
    """Return how often something comes along an edge in this run [Hz]."""
    if edge == 0:
        return np.sum(state["came"][: state["images"]] >= 0.0) / SPAN
    if edge == 1 or edge == 2:
        return 0.0 if verdict(controls, edge) else state["jobs"][edge - 1] / SPAN
    if edge == 4:
        return state["ticks"] / SPAN
    if edge == 5:
        return controls["loop"]
    return _SLOW[0] if edge == 3 else _SLOW[edge - 5]


@register_jitable
def _ends(edge):
    """Return where an edge is drawn: beside the one that goes the other way, from rim to rim."""
    a, b = _AT[_EDGES[edge, 0]], _AT[_EDGES[edge, 1]]
    dx, dy = b[0] - a[0], b[1] - a[1]
    size = math.hypot(dx, dy)
    # An edge in the opposite direction runs beside this one, and both end at the rims of the boxes.
    rim = min(_W / max(abs(dx), 1e-9), _H / max(abs(dy), 1e-9)) + 0.03
    sx, sy = -0.1 * dy / size, 0.1 * dx / size
    return a[0] + rim * dx + sx, a[1] + rim * dy + sy, b[0] - rim * dx + sx, b[1] - rim * dy + sy


@register_jitable
def _graph(pen, state, controls):
    """Draw the graph of nodes and edges: what a tool such as rqt_graph shows of a running system.

    An edge is as wide as its rate is high, those of the chosen node are lit, and a topic whose
    policies do not match is red and says why.
    """
    chosen = controls["node"]
    # Edges first, so that the boxes cover their ends.
    for k in range(len(_EDGES)):
        x0, y0, x1, y1 = _ends(k)
        rate, service = _rate(state, controls, k), k >= _FIRST_SERVICE
        lit = _EDGES[k, 0] == chosen or _EDGES[k, 1] == chosen
        # Rates go from 0.1 Hz to 1 kHz, hence a logarithm.
        width = 1.0 + 1.2 * math.log10(1.0 + rate)
        # Only topics have policies that can fail to match (request-offered); services have none.
        silent = k < len(TOPICS) and verdict(controls, k) > 0
        ink = draw.RED if silent else (_SERVICE if service else _TOPIC)
        draw.arrow(pen, x0, y0, x1, y1, ink, width, 8.0 + width, 1.0 if lit or silent else 0.35)
        if silent:
            draw.text(
                pen,
                0.5 * (x0 + x1),
                0.5 * (y0 + y1),
                _WHY + verdict(controls, k),
                draw.RED,
                12.0,
                draw.CENTRE,
                draw.MIDDLE,
                0.0,
                32.0,
                0.0,
                1.0,
            )
    # Boxes with the names of the nodes. The controller, node 3, is outlined in red: the only one
    # whose deadline is hard.
    for k in range(len(_AT)):
        x, y = _AT[k]
        edge = draw.RED if k == 3 else (draw.INK if k == chosen else draw.GREY)
        draw.box(
            pen,
            x - _W,
            x + _W,
            y - _H,
            y + _H,
            _CHOSEN if k == chosen else _QUIET,
            edge,
            2.6 if k == 3 else 1.3,
        )
        draw.text(pen, x, y, _NAMES + k, draw.INK, 13.0, draw.CENTRE)


@register_jitable
def _pulses(pen, state, now):
    """Pictures on their way, and those that are lost."""
    x0, y0, x1, y1 = _ends(0)
    for k in range(state["images"]):
        passed, came = now - state["sent"][k], state["came"][k]
        if 0.0 <= passed < 0.012:
            # An image moves along its edge while it travels; a lost one stops halfway and turns
            # red.
            share = min(passed / 0.010, 1.0 if came >= 0.0 else 0.5)
            ink = draw.ORANGE if came >= 0.0 else draw.RED
            draw.spot(pen, x0 + share * (x1 - x0), y0 + share * (y1 - y0), 0.08, ink, draw.INK, 1.0)


@register_jitable
def _flows(pen, state, controls):
    """Draw what flows into the chosen node and out of it."""
    y = 4.55
    for k in range(len(_EDGES)):
        out = _EDGES[k, 0] == controls["node"]
        if not out and _EDGES[k, 1] != controls["node"]:
            continue
        ink = _SERVICE if k >= _FIRST_SERVICE else _TOPIC
        draw.arrow(pen, 6.35 if out else 6.65, y, 6.65 if out else 6.35, y, ink, 2.0, 8.0)
        draw.text(pen, 6.8, y, _FLOWS + k, draw.INK, 12.0)
        draw.words(pen, _COMMA)
        rate = _rate(state, controls, k)
        draw.number(pen, rate, 1 if rate < 100.0 else 0, _HZ)
        y -= 0.28


@register_jitable
def _who_runs(pen, state, controls, now):
    """Who has the processor, over the last moments; red: a tick that came late."""
    draw.window(pen)
    draw.area(pen, (1.05, 5.7, 0.55, 1.75), (-1e3 * _WINDOW, 0.0, 0.0, 3.0))
    draw.axes(pen, _LAST, 0, _GANTT, 3, 0)
    # Jobs within the window as bars; a tick as a line, high and red if it was late.
    for stage in range(2):
        for job in range(state["jobs"][stage]):
            begun, done = state["begun"][stage, job], state["done"][stage, job]
            if done > now - _WINDOW and begun < now:
                draw.box(
                    pen,
                    1e3 * (begun - now),
                    1e3 * (min(done, now) - now),
                    2.1 - stage,
                    2.9 - stage,
                    draw.ORANGE if stage == 0 else draw.GREEN,
                )
    first = np.searchsorted(state["start"][: state["ticks"]], now - _WINDOW)
    last = np.searchsorted(state["start"][: state["ticks"]], now)
    for k in range(first, last):
        x, late = 1e3 * (state["start"][k] - now), state["start"][k] - state["due"][k]
        draw.segment(
            pen, x, 0.1, x, 0.9 if late > 1e-9 else 0.5, draw.RED if late > 1e-9 else draw.BLUE, 1.0
        )
    draw.window(pen)
    for k in range(3):
        draw.text(pen, 0.98, 1.55 - 0.4 * k, _ROWS + k, draw.INK, 11.5, draw.RIGHT)


@register_jitable
def _trace(pen, state, now):
    """Draw the age of the command over the last second."""
    times = now - 1.0 + np.linspace(0.0, 1.0, 401)
    born = stamps(state, times)
    ages = np.where(born >= 0.0, 1e3 * (times - born), np.nan)
    high = 100.0
    for k in range(ages.size):
        if ages[k] > high:
            high = ages[k]
    draw.area(pen, (6.6, 8.8, 0.55, 2.25), (now - 1.0, now, 0.0, 1.15 * high))
    draw.axes(pen, _TIME, _OLD, _TRACE, 3, 3)
    draw.curve(pen, times, ages, draw.BLUE, 1.8)
    draw.window(pen)


def frame(pen, state, controls):
    """Draw the graph at this moment, who runs, and the age of the command."""
    now = state["time"]
    _graph(pen, state, controls)
    _pulses(pen, state, now)
    draw.spot(pen, state["clicked"][0], state["clicked"][1], 0.05, draw.NONE, draw.GREY, 1.0)
    _flows(pen, state, controls)
    _who_runs(pen, state, controls, now)
    _trace(pen, state, now)
    born, largest = stamps(state, np.array([now]))[0], bound(controls)
    draw.reading(pen, _AGE, 1e3 * (now - born), 1, _MS, _NO_PLAN if born < 0.0 else 0)
    draw.reading(pen, _MEAN, 1e3 * state["mean"], 1, _MS, _NO_PLAN if state["mean"] < 0.0 else 0)
    draw.reading(pen, _LATE, 1e3 * state["late"], 2, _MS)
    draw.reading(pen, _BOUND, 1e3 * largest, 2, _MS, _NO_BOUND if largest < 0.0 else 0)
    draw.reading(pen, _SKIPPED, 100.0 * (1.0 - state["ticks"] / state["due_ticks"]), 1, _PER_CENT)
    lost = np.sum(state["came"][: state["images"]] < 0.0) / state["images"]
    draw.reading(pen, _LOST, 100.0 * lost, 1, _PER_CENT)
    # An image is lost if any of its packets is: 1 - (1 - p)^n.
    share = 1.0 - (1.0 - 1e-3 * controls["loss"]) ** PACKETS
    expected = 100.0 if verdict(controls, 0) else (0.0 if reliable(controls, 0) else 100.0 * share)
    draw.reading(pen, _EXPECTED, expected, 1, _PER_CENT)
    draw.reading(pen, _DROPPED, state["dropped"], 0)
    draw.reading(pen, _MISSED, state["missed"], 0)
    draw.reading(pen, _MONITOR, 0.0, 0, 0, _SIGHT if state["zone"] else _BLIND)


PRESETS = {
    "Working stack": Preset(
        {},
        "Press play: twenty times slower than in truth. Click a node, or go on with the arrow "
        "keys: what flows in and out lights up.",
    ),
    "Mismatch": Preset(
        {"requested": "reliable", "node": "perception"},
        "The camera offers best effort, perception requests reliable: nothing arrives, and no "
        "program stops. ROS 2 only logs a warning. Let the writer offer reliable.",
    ),
    "Lossy wire": Preset(
        {"loss": 1.0, "node": "camera"},
        "One packet of a thousand is lost, and a picture has over six hundred. Make both ends "
        "reliable: none is lost, each comes later.",
    ),
    "Deep queue": Preset(
        {"load": 60.0, "depth": 10, "node": "perception"},
        "Perception needs 50 ms where 33 pass: its queue is full, and hands out the oldest. Slide "
        "what the reader keeps to one.",
    ),
    "Overload": Preset(
        {"schedule": "perception's thread", "load": 30.0},
        "The loop shares a thread with perception: a tick that comes while a picture is seen waits "
        "for its end.",
    ),
    "Inversion": Preset(
        {"schedule": "waits for a logger's lock"},
        "The least urgent task holds a lock for 2 ms, and perception keeps it from the processor. "
        "Choose the lock with inheritance.",
    ),
    "Late monitor": Preset(
        {"topic": "zone", "offered": "reliable", "requested": "reliable", "node": "monitor"},
        "The zone was published once, before the monitor started: it stays blind. Let both ends "
        "keep it for later.",
    ),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "command age": "Age of the camera image behind the command that acts right now.",
    "mean command age": "Mean age of the command over the run, without the first two seconds.",
    "loop late by": "Largest delay of a control cycle after its due time, over the whole run.",
    "lateness bound": "Upper bound of that delay from response-time analysis.",
    "ticks skipped": "Control ticks that did not run because the previous one had not finished.",
    "images lost": "Images that never arrived at perception, measured.",
    "loss expected": "Fraction of lost images that theory predicts for these settings.",
    "queue dropped": "Messages that a full queue discarded.",
    "deadlines missed": "Deadlines that passed at the subscriber without a new message.",
    "monitor": "Whether the safety monitor has received the zone, which is published once.",
}

MODEL = Model(
    TITLE,
    PAPER,
    CONTROLS,
    STATE,
    PRESETS,
    initial,
    advance,
    frame,
    drag,
    press=press,
    live_drag=True,
    readouts=READOUTS,
    upright=False,
)
