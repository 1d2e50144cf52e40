"""Claims of chapter 10: nodes and processes, controllers, launch files, and policies in between."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "n": Symbol("parameters"),
    "b": Symbol("bytes of a parameter"),
    "f": Symbol("actions a second [1/s]"),
    "k": Symbol("actions of one pass"),
    "C": Symbol("time of a pass [s]"),
    "H": Symbol("actions of a chunk that are played", 1.0, 50.0),
    "T": Symbol("time of an action [s]"),
}


@claim(
    "A node is a process.",
    "A node is a name with topics, services and parameters. You decide when you start them how "
    "many share a process, which ROS 2 calls composition. The usual launch file starts "
    "{started:.0f} processes for {written:.0f} nodes; here {nodes:.0f} nodes ran in "
    "{processes:.0f} process.",
    source="ROS 2 documentation, Composing multiple nodes in a single process, Humble 2022",
)
def node_is_a_process(result):
    import os

    from course.middleware import launch
    from course.middleware.bus import Bus

    bus, at = Bus(), dict[str, int]()
    for name in ("camera", "perception", "planner", "control", "monitor"):
        node = bus.node(name)
        # Every callback notes the process that it runs in.
        node.timer(0.1, lambda name=name: at.__setitem__(name, os.getpid()))
    bus.run(0.5)
    nodes = result.measure("nodes", len(at))
    processes = result.measure("processes", len(set(at.values())))
    listed = launch.nodes(launch.USUAL)
    written = result.measure("written", len(listed))
    started = result.measure("started", len({(x.package, x.executable) for x in listed}))
    result.statement = "Process numbers seen by the callbacks of a stack; a launch file, run."
    result.statement_holds(processes == nodes)
    result.correction_holds(processes == 1, nodes == 5, started == written)


CRASH = """
import ctypes, resource, sys, threading
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
def fail(): ctypes.string_at(0)
one = threading.Thread(target=fail)
one.start(); one.join()
print("alive")
"""


def told_of_a_crash(lease):
    """Return whether a reader learns that its writer died, and whether a client is answered."""
    from course.middleware.bus import Bus
    from course.middleware.qos import QoS

    bus = Bus()
    eye = bus.node("perception")
    writer = eye.writer("pose", QoS(liveliness_lease_duration=lease))
    bus.node("control").reader("pose", None, QoS(liveliness_lease_duration=lease))

    def never(_):
        yield 1e9

    eye.service("where", never)
    answer = bus.node("planner").client("where").call(0)
    writer.die()
    bus.run(100.0)
    return [one.kind for one in bus.events], answer.done


@claim(
    "Suppose that each node runs in a process of its own. The processes share no memory, locks or "
    "pipes, and no rule of the launch file stops them together. If one of them accesses an invalid "
    "address and crashes, the others go on running.",
    "Within one process, the crash ends all of them. But the other nodes are not told: on the "
    "bus, {events:.0f} events were raised without a lease, and {told:.0f} with one. (DDS also "
    "notices when a whole process stops answering, seconds later.) A client that waits "
    "for a reply keeps waiting. That the arm then holds its position has to be programmed.",
)
def processes_isolate(result):
    import subprocess
    import sys

    def python(code):
        return subprocess.Popen(
            [sys.executable, "-S", "-c", code],
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )

    other = python("input(); print('alive')")
    crashed = python(CRASH)
    # The crash is over before the other process is asked.
    text = crashed.communicate()[0]  # over, before the other one is asked
    answer = other.communicate("are you?\n")[0]
    # A process that writes into a pipe whose reader crashed does not go on.
    reader = python(CRASH)
    endless = "import sys" + chr(10) + "while True: print('x' * 999, file=sys.stdout, flush=True)"
    writer = subprocess.Popen(
        [sys.executable, "-S", "-c", endless], stdout=reader.stdin, stderr=subprocess.DEVNULL
    )
    reader.communicate()
    silent, done = told_of_a_crash(float("inf"))
    noticed, _ = told_of_a_crash(0.1)
    result.measure("events", len(silent))
    report = result.measure("told", len(noticed))
    result.statement = (
        "A process with two threads, one of which reads address 0; leases on the bus."
    )
    result.statement_holds(answer.strip() == "alive" and crashed.returncode != 0)
    result.correction_holds(
        text == "",
        silent == [],
        report == 1 and noticed == ["not alive"],
        not done,
        writer.wait() != 0,
    )


@claim(
    "A controller in the callback of the joint states runs at 1 kHz.",
    "It runs once per message. With joint states at {hz:.0f} Hz it sent {sent:.0f} commands a "
    "second, and none when they stopped. After another callback had occupied the thread for "
    "{busy_ms:.0f} ms, it sent {burst:.0f} commands at once, because its queue was that deep. A "
    "loop of its own keeps its rate, and can check how old its state is.",
)
def callback_sets_the_rate(result):
    from course.middleware.bus import Bus
    from course.middleware.executor import Executor
    from course.middleware.qos import QoS

    def commands(hz, stops=np.inf, busy=0.0):
        """Return when commands were sent [s]; a callback that takes `busy` comes at 0.5 s."""
        bus, sent = Bus(), list[float]()
        out = bus.node("drives").writer("joint_states")
        node = bus.node("control", Executor(bus))
        node.reader("joint_states", lambda s: sent.append(bus.now), QoS())

        def other():
            yield busy

        if busy:
            node.timer(10.0, other, 0.05)
        bus.node("clock").timer(
            1.0 / hz, lambda: (out.publish(0), None)[1] if bus.now < stops else None
        )
        bus.run(0.9999)
        return np.array(sent)

    hz = result.input("hz", 200)
    sent = result.measure("sent", commands(hz).size)
    times = commands(hz, busy=1e-3 * result.input("busy_ms", 200))
    # Most commands at one instant: what the queue held while the callback was blocked.
    burst = result.measure("burst", int(np.unique(times, return_counts=True)[1].max()))
    late = commands(hz, stops=0.5)
    result.statement = "Joint states at some rates on the bus, one second each."
    result.statement_holds(sent > 900)
    result.correction_holds(
        all(commands(float(x)).size == np.ceil(0.9999 * x) for x in (50, 333, 1000)),
        sent == hz,
        bool(late.max() < 0.5),
        burst == QoS().depth,
    )


@claim(
    "A callback that accesses joints by index is safe for every joint-state message.",
    "The usual form does not check sizes. With more joints than targets, or without velocities, it "
    "read beyond its arrays: {stopped:.0f} of {bad:.0f} such messages stopped it under the "
    "sanitizer. It also allocated memory {made:.0f} times per message. A controller that checks "
    "sizes when it is configured allocated {none:.0f} times in {updates:.0f} updates. Compare the "
    "joint names as well, because their order in a message is not guaranteed.",
    source="sensor_msgs/JointState, ROS 2 Jazzy 2024; ros2_control documentation, Jazzy 2024",
    needs=("a C++ compiler",),
)
def any_joint_message(result):
    import tempfile
    from pathlib import Path

    from course.middleware import controller

    targets, six = [[0.5] * 6], [6, *[0.1] * 6, 6, *[0.2] * 6]
    # Too many joints, and no velocities.
    wrong = [[7, *[0.1] * 7, 7, *[0.2] * 7], [6, *[0.1] * 6, 0]]
    settings = result.rng.uniform(0.1, 5.0, (4, 6))
    rows = result.rng.normal(0.0, 2.0, (int(result.input("updates", 100)), 12))
    with tempfile.TemporaryDirectory() as folder:
        program = controller.build(Path(folder))
        fine = controller.drive(program, "callback", targets, [six, six])
        failed = [controller.drive(program, "callback", targets, [row]) for row in wrong]
        ours = controller.drive(program, "update", settings, rows)
    result.measure("bad", len(failed))
    stopped = result.measure("stopped", sum(bool(one.report) for one in failed))
    made = result.measure("made", min(fine.allocations), 0.5)
    empty = result.measure("none", sum(ours.allocations))
    # The same law in Python as the reference for the numbers.
    report = [controller.torques(row[:6], row[6:], *settings) for row in rows]
    result.statement = "Both in C++ under the address sanitizer, and the same law in Python."
    result.statement_holds(all(one.code == 0 for one in failed))
    result.correction_holds(
        stopped == len(wrong),
        fine.code == 0 and made >= 2,
        empty == 0,
        all(ours.good),
        bool(np.abs(np.array(ours.torque) - report).max() <= 1e-15),
    )


@claim(
    "A launch file whose comment says best effort at 30 Hz, with a parameter rate of 1000, sets "
    "both.",
    "Comments set nothing, and a parameter has an effect only if the node declares and reads it. "
    "The usual file sets the quality of service of {usual:.0f} ends, ours of {ours:.0f}. And a "
    "parameter called rate has no effect on ros2_control, whose parameter is called update_rate: "
    "that stays at its default of {left:.0f} Hz, without a warning.",
    source="rclcpp, qos_overriding_options.hpp, Galactic 2021 and later; ros2_control "
    "documentation, Controller Manager, Jazzy 2024",
)
def launch_comments(result):
    from course.middleware import launch

    def ends(text):
        return sum(len(launch.overrides(node.parameters)) for node in launch.nodes(text))

    usual, ours = (
        result.measure("usual", ends(launch.USUAL)),
        result.measure("ours", ends(launch.OURS)),
    )
    (control,) = (x for x in launch.nodes(launch.USUAL) if "rate" in x.parameters)
    node = launch.Parameters(control.parameters)
    # Declared under the name that the node reads, not the one that the file sets.
    remaining = result.measure(
        "left", node.declare("update_rate", int(result.input("default", 100)))
    )
    requested = control.parameters["rate"]
    result.statement = "Both files run against stand-ins of launch, their parameters read by name."
    result.statement_holds(usual > 0)
    result.correction_holds(
        usual == 0,
        ours > 4,
        remaining != requested,
        "rate" not in node.value,
        not launch.silent(launch.nodes(launch.OURS)),
    )


@claim(
    "All parameters of a node can be tuned while it runs.",
    "A new value has an effect only where the program uses it. Of {kinds:.0f} ways to use a "
    "parameter, {tuned:.0f} took the new value: reading it in each cycle, and a callback for "
    "changes. A value that was copied at the start stayed as it was. Setting a parameter that was "
    "never declared was rejected, which is the default, and so was a value of another type. A "
    "read-only parameter is rejected as well, "
    "such as ros2_control's update_rate (by its documentation), and so is a value outside of a "
    "declared range or one that a callback of the node rejects. Nobody answers a request from "
    "outside if the node never spins: its parameter services are callbacks, too.",
    source="ROS 2 documentation, Parameters, and ros2_control, Controller Manager, Jazzy 2024",
)
def parameters_are_tunable(result):
    from course.middleware import launch

    def stiffness(path, start, new):
        """Return what a controller works with after it was set to a new value."""
        node, used = launch.Parameters({"stiffness": start}), {}
        if path != "undeclared":
            used["now"] = node.declare("stiffness", 1.0)
        if path == "told":
            node.callbacks.append(lambda name, value: used.update(now=value))
        try:
            node.set("stiffness", new)
        except ValueError:
            return start
        return node.value["stiffness"] if path == "read" else used["now"]

    paths = ("read", "told", "copied", "undeclared")
    drawn = result.rng.uniform(1.0, 100.0, (8, 2))
    works = {
        method: [stiffness(method, float(a), float(b)) == b for a, b in drawn] for method in paths
    }
    result.measure("kinds", len(works))
    tuned = result.measure("tuned", sum(all(one) for one in works.values()))

    def limited(limit=0.5):
        """Return what a controller reads after a callback has rejected the value."""
        node = launch.Parameters({})
        node.declare("stiffness", 0.1)

        def reject(name, value):
            if value > limit:
                node.value[name] = 0.1
                raise ValueError(f"{name} must be at most {limit}, got {value}")

        node.callbacks.append(reject)
        try:
            node.set("stiffness", 1.0)
        except ValueError:
            pass
        return node.value["stiffness"]

    # An integer where a floating-point number is declared.
    whole = [stiffness("read", float(a), int(b)) == int(b) for a, b in drawn]
    result.statement = "A stand-in that keeps parameters as rclcpp does, four ways to use one."
    result.statement_holds(
        all(works["copied"]),
        only_if="it is declared, not read-only, and read again or watched by a callback, the new "
        "value has its type, no range or callback rejects it, and the node spins and offers "
        "parameter services, which it does by default",
        inside=works["read"] + works["told"],
        # Chosen to break it: a value that the node's own callback rejects.
        outside=[*works["copied"], *works["undeclared"], *whole, limited() == 1.0],
    )
    result.correction_holds(
        tuned == 2, not any(works["copied"]), not any(works["undeclared"]), not any(whole)
    )


@claim(
    "At ten actions per second, a model of seven billion parameters needs more bytes per second "
    "than a PC's memory delivers.",
    "Each inference reads all n weights of b bytes and makes k actions, so f actions per second "
    "need {formula}. With two bytes per weight and one action per inference that is {each:.0f} "
    "GB/s, and two memory channels of a PC deliver {pc:.1f} GB/s. With {chunk:.0f} actions per "
    "inference it is {few:.1f} GB/s. Memory is not the only limit. With {tokens:.0f} tokens of "
    "images, an inference takes two operations per weight and token: even with {chunk:.0f} actions "
    "per inference {tera:.1f} trillion per second, and {cores:.0f} cores with {a_cycle:.0f} "
    "operations per cycle at {ghz:.0f} GHz do {able:.1f} trillion. So such a model needs a GPU, or "
    "another computer over a link. A link of {link_ms:.0f} ms makes the mean age {far_ms:.0f} "
    "instead of {near_ms:.0f} ms. The cache of a transformer, and models that need several "
    "inferences per action, come on top.",
    ask=(
        "A model of n parameters with b bytes each makes k actions per inference, which reads each "
        "weight once from memory. It outputs f actions per second. How many bytes per second does "
        "it read at least?",
        "B, rate = n*b*f/k",
        {
            "n*b*f": "One inference makes k actions.",
            "n*b*f*k": "More actions per inference mean fewer inferences.",
            "n*f/k": "A parameter has b bytes.",
            "8*n*b*f/k": "That is bits.",
        },
    ),
)
def seven_billion_on_board(result):
    import sympy

    from course.role import Stage, age

    n, b, f, k, t = sympy.symbols("n b f k t", positive=True)
    result.formula = sympy.diff(n * b * (f * t / k), t)

    def read(layers, width, actions, a_pass):
        """Return the bytes of weights that a network reads for its actions, counted by matrix."""
        weights = [np.zeros((width, width), np.float16) for _ in range(layers)]
        count, state = 0, np.zeros(width, np.float16)
        for _ in range(0, actions, a_pass):
            for matrix in weights:
                state, count = matrix @ state, count + matrix.nbytes
        return count, sum(matrix.size for matrix in weights)

    counted = [(*read(3, 8, 24, x), x) for x in (1, 2, 8)]

    def traffic(size, actions=1.0, rate=10.0, model=7e9):
        values = {n: model, b: float(size), f: rate, k: float(actions)}
        return float(result.formula.subs(values)) / 1e9

    pc, chunk = result.input("pc", 89.6), result.input("chunk", 8)
    each = result.measure("each", traffic(2))
    result.measure("few", traffic(2, chunk))
    least = result.measure("least", pc / traffic(1))
    tokens = result.input("tokens", 500)
    tera = result.measure("tera", 2.0 * 7e9 * tokens * 10.0 / chunk / 1e12)
    cores, a_cycle, ghz = (result.input(*x) for x in (("cores", 8), ("a_cycle", 32), ("ghz", 4)))
    able = result.measure("able", cores * a_cycle * ghz / 1e3)
    link = 1e-3 * result.input("link_ms", 40)
    stages = [Stage("camera", 0.01, 1 / 30), Stage("policy", 0.09, 0.1), Stage("drive", 1e-4, 1e-3)]
    near = age(stages).mean
    far = age([stages[0], Stage("link", link, overload="pipelined"), *stages[1:]]).mean
    result.measure("near_ms", 1e3 * near)
    result.measure("far_ms", 1e3 * far)
    # Bytes per weight and action above and below the least, and actions per inference.
    sizes, small = result.rng.uniform(1.05 * least, 4.0, 8), result.rng.uniform(0.3, 0.95, 8)
    few = result.rng.uniform(4.0, 16.0, 8)
    # Chosen to break it: a mixture of experts, of whose weights an inference reads a tenth.
    sparse = [traffic(x) / 10.0 > pc for x in sizes]
    # Chosen to break it: just above the limit, with faster modules or eight channels of them.
    faster = [traffic(1.05 * least) > pc * x for x in (6000 / 5600, 6400 / 5600, 4.0)]
    result.statement = "Counted on small networks; two channels of DDR5-5600; ages of chapter 0."
    result.statement_holds(
        bool(traffic(2, chunk) > pc),
        only_if="each inference reads every weight, and the bytes per weight and action are more "
        "than {least:.2f} in a PC whose memory delivers {pc:.1f} GB/s; this limit is proportional "
        "to what the memory delivers",
        # The same quotient, with one action per inference and with several.
        inside=[traffic(x) > pc for x in sizes]
        + [traffic(x * a, a) > pc for x, a in zip(sizes, few, strict=True)],
        outside=[traffic(x, a) > pc for x, a in zip(sizes, few, strict=True)]
        + [traffic(x * least) > pc for x in small]
        + sparse
        + faster,
    )
    result.correction_holds(
        each > pc,
        tera > 2.0 * able,
        abs(far - near - link) < 1e-9,
        all(
            abs(bytes_ / float(result.formula.subs({n: size, b: 2, f: 24, k: x})) - 1.0) < 1e-9
            for bytes_, size, x in counted
        ),
    )


@claim(
    "A policy that plays chunks of actions has no latency.",
    "If an inference takes no longer than a chunk, the arm never waits, but it acts on an older "
    "image: at the end of a chunk the image is {formula} old, the inference time plus the length "
    "of "
    "the chunk. With an inference of "
    "{pass_ms:.0f} ms and chunks of {played:.0f} actions of {action_ms:.0f} ms that is "
    "{worst_ms:.0f} ms, and {mean_ms:.0f} ms on average. With chunks as short as one inference it "
    "is {short_ms:.0f} ms.",
    ask=(
        "An inference takes the time C from its image to its output. It outputs a chunk, of which "
        "H actions of length T are played while the next inference runs, so that the next chunk is "
        "ready just in time. How old is the image at the end of a chunk?",
        "A, age = C + H*T",
        {
            "C": "That is at the beginning of the chunk.",
            "H*T": "The inference took time before that.",
            "C + H*T/2": "That is the mean.",
            "2*C": "That is for a chunk that lasts as long as an inference.",
        },
    ),
)
def chunks_hide_latency(result):
    import sympy

    from course.middleware.executor import run_chain
    from course.role import Stage

    C, H, T, x = sympy.symbols("C H T x", positive=True)
    result.formula = C + sympy.integrate(1, (x, 0, H * T))
    a_pass, action = (1e-3 * result.input(*x) for x in (("pass_ms", 100), ("action_ms", 20)))
    played = int(result.input("played", 25))

    def ages(a_pass, chunk, overload=""):
        """Return ages behind the motion on the bus [s]: a pass as each chunk is to end [s]."""
        run = run_chain([Stage("policy", a_pass, chunk, 1, overload)], [0.3], 0, 60.0 * chunk)
        return run.age(result.rng.uniform(5.0 * chunk, 58.0 * chunk, 4000))

    observed, short = ages(a_pass, played * action), ages(a_pass, a_pass)
    worst = result.measure("worst_ms", 1e3 * observed.max(), 0.01)
    mean = result.measure("mean_ms", 1e3 * observed.mean(), 0.03)
    result.measure("short_ms", 1e3 * short.max(), 0.01)
    drawn = [(float(a), float(h)) for a, h in result.rng.uniform((0.02, 0.1), (0.1, 0.6), (5, 2))]
    result.statement = "A policy as a stage of chapter 0 on the bus, ages at drawn moments."
    result.statement_holds(worst < 1.1e3 * a_pass)
    result.correction_holds(
        all(
            abs(ages(a, h).max() / float(result.formula.subs({C: a, H: 1, T: h})) - 1.0) < 0.01
            for a, h in drawn
        ),
        bool(observed.min() > 0.99 * a_pass),
        bool(abs(mean / (1e3 * (a_pass + 0.5 * played * action)) - 1.0) < 0.03),
        bool(abs(short.max() / (2.0 * a_pass) - 1.0) < 0.01),
        # Chunks shorter than an inference: the next one is not ready in time.
        bool(ages(a_pass, 0.9 * a_pass, "skip").max() > 1.4 * 1.9 * a_pass),
    )
