# %% [markdown]
# # 0 · The role
#
# *A robot picks parts from a moving belt, and its gripper closes behind them. Every program on the robot is fast.
# How old is the picture behind its present motor command?* About {open minutes} minutes of reading, cards and charts.
# The folded parts add {folded minutes} minutes, the exercises {exercise minutes} minutes.

# %%
from course.cards import predict
from course.simulations import simulation

predict("how_old_is_a_command")

# %% [markdown]
# ![The stack as a graph](attachment:role.stack.png)

# %%
simulation("stack")

# %% [markdown]
# **After this chapter you can** draw the software of a robot as a graph, with a rate, a size and a deadline on every
# arrow; say how old the information behind a motor command is, before anything is built; find the change that makes it
# younger; and recognise a full queue, locked clocks and drifting clocks in a log. **Know first:** some Python, and what
# a mean is. Later chapters use linear algebra, derivatives, differential equations and probability.
#
# ## How this course works
#
# This is a course about simulated robots, and about how far you can trust a simulated number. Each chapter looks at its
# subject from five sides: concept, design, code, debugging and frontier. Each section explains an idea, asks about it,
# and shows the answer.
#
# Some cards show a common statement. You judge it: true, false, or true only under a condition. A program checked each
# of them; `python -m course.derivations 0` runs the checks again. These exercises wait in section 7:

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint

badges(0)

# %% tags=["hide-code"]
import inspect
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

from course import role
from course.cards import figures, interview
from course.charts import read
from course.derivations import figure, show
from course.measure.success import wilson
from course.role import CHAIN, STACK, Stage, age, cost, load, simulate, spend

BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#7f7f7f"


def source(*functions):
    """Show functions as they stand in the module."""
    text = "\n\n".join(inspect.getsource(f) for f in functions)
    return Markdown(f"```python\n{text}```")


def table(*rows):
    """Return rows of text as a table; the first one is the head."""
    lines = [f"| {' | '.join(map(str, row))} |" for row in rows]
    return Markdown("\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]))


# %% [markdown]
# ## 1 · Concept: six boxes and a robot
#
# This chapter is about what connects the parts of a robot's software. The simulation above draws it as a graph of six
# boxes and the robot. Click them to read what goes in and out:
#
# * The **simulation engine** takes torques (turning forces) and returns pictures and **joint
#   states**, the angles and speeds of the joints. It stands for the robot (chapters 1 to 4).
# * The **middleware** carries messages from one program to another. It gives each measurement a **time stamp**, the
#   moment at which it was taken (chapter 10).
# * **Perception** turns pictures into poses, the positions and orientations of things, with their uncertainty, the
#   *covariance* (chapter 7).
# * **Planning** turns poses into trajectories, motions over time (chapter 5).
# * **Control** turns trajectories and joint states into torques (chapter 6).
# * **Sim-to-real and learning** turns logs and **episodes**, tries at a task, into parameters and **policies**,
#   programs that choose the next action (chapters 8 and 9).
#
# An arrow carries samples: so many per second, each of so many bytes. Rate times size is the arrow's **bandwidth**. A
# depth camera with 640 by 480 pixels of 2 bytes at 30 Hz sends $640 \cdot 480 \cdot 2 \cdot 30 = 18.4$ million bytes
# per second.
#
# Arrows also differ in what a late sample means. With a **hard deadline** a late sample is a failure, whatever comes
# after it. With a **soft deadline** a late sample is only worth less.

# %%
predict("never_late")

# %% [markdown]
# The table lists the arrows with the largest bandwidth. A function of this chapter, `check_stack`, tests the graph:
# every loop has to pass through the robot or its simulation. If one does not, either an arrow points the wrong way, or
# two programs wait for each other. (This is a convention of this graph.)

# %% tags=["hide-code"]
role.check_stack(STACK)
table(
    ("from", "to", "what", "rate [Hz]", "bandwidth [MB/s]", "deadline"),
    *(
        (e.source, e.target, e.flow, f"{e.rate:g}", f"{e.bandwidth / 1e6:.3f}", e.deadline)
        for e in sorted(STACK, key=lambda e: -e.bandwidth)[:9]
    ),
)

# %% [markdown]
# Nearly all bytes belong to pictures, nearly all messages to joint states and torques, and only the loop between
# control and motors has hard deadlines. These three facts decide where the programs run and how they talk to each
# other. The loop gets a process of its own. The pictures stay on one computer. Everything else can be ordinary
# messages.
#
# ### How old is a command?
#
# The motor command of this moment follows a trajectory. The trajectory was planned for a pose, and the pose was
# computed from a picture. The **data age** of the command is the time from the capture of that picture until now. In
# this time the world has moved on.
#
# Each program in this chain is a *stage*. A stage has an **execution time** $C$, from its start to its result. Most
# stages also have a clock with a **period** $T$, and start whenever the clock ticks. When a stage starts, it takes the
# newest result of the stage before it.
#
# The chain of this chapter has three stages. *Perception* starts with each picture of a camera at 30 Hz and needs 45
# ms. That is longer than the 33.3 ms between two pictures, so two workers take turns. The *planner* starts 10 times per
# second and needs 60 ms. The *joint loop* runs at 1,000 Hz and needs 0.2 ms.

# %%
show("chain_age")

# %% [markdown]
# The next diagram follows one command back in time, with mean values. Blue is work and orange is waiting:

# %% tags=["hide-code"]
parts, names = [], []
for stage, wait in zip(CHAIN, age(CHAIN).waits, strict=True):
    parts += [stage.execution, wait]
    names += [
        f"{stage.name}: work",
        f"{stage.name}: its result waits {'to be read' if stage.period > 0.001 else 'for the next'}",
    ]
ends = 1000 * np.cumsum(parts)
figure_, axes = plt.subplots(figsize=(8, 2.6), layout="constrained")
for k, (part, end) in enumerate(zip(parts, ends, strict=True)):
    _ = axes.barh(k, 1000 * part, left=end - 1000 * part, color=[BLUE, ORANGE][k % 2])
    _ = axes.text(end + 2, k, f"{1000 * part:.1f}", va="center")
_ = axes.set(yticks=range(6), yticklabels=names, xlabel="mean age [ms]", xlim=(0, 190))
axes.invert_yaxis()
plt.show()

# %% tags=["hide-code"]
report = age(CHAIN)
table(
    ("age of the command", "[ms]", "at 0.3 m/s, moved since the picture [mm]"),
    *(
        (name, f"{1000 * value:.1f}", f"{300 * value:.0f}")
        for name, value in (
            ("least", report.least),
            ("mean", report.mean),
            ("bound", report.greatest),
        )
    ),
)

# %% [markdown]
# **A worked example.** The execution times add up to $45 + 60 + 0.2 = 105.2$ ms. Half of each period comes on top:
# $16.7 + 50 + 0.5 = 67.2$ ms. Together that is a mean age of 172.4 ms. A part on a belt at 0.3 m/s moves by $0.3 \cdot
# 172.4 = 52$ mm in this time, and the gripper of the opening question closes behind it.
#
# Two clocks may start at any shift against each other, their **phase**; 172.4 ms is the mean over all phases.
# Independent clocks drift, so all phases occur while the robot works. If two clocks never drift, the phase of the start
# stays, and so the mean differs from one start of the robot to the next (section 6).
#
# <details><summary>Derive the least age, the mean and the bound</summary>
#
# Go backwards from now. The command in force was issued at some time during the last $T_n$, the interval of the last
# stage. This time is evenly distributed from 0 to $T_n$, because now is a random moment. The last stage had begun $C_n$
# earlier. It read the newest result of stage $n-1$, which had been waiting for a time that is evenly distributed from 0
# to $T_{n-1}$. Continue in the same way to the capture of the picture.
#
# So the age is the sum of all $C_i$ and of independent waits, each evenly distributed from 0 to $T_i$. It lies between
# $\sum C$ and $\sum C+\sum T$. Its mean is $\sum C+\tfrac12\sum T$ and its variance $\tfrac1{12}\sum T^2$. The bound is
# that of Davare and others (DAC 2007), who use response times on shared processors in place of $C$. Dürr and others
# (2019) made it tighter for tasks without a fixed period.
#
# </details>
#
# ### Whose period?
#
# Two periods meet at each arrow: that of the stage that produces, and that of the stage that reads. A common reflex is
# to make the reader faster. Think of a letter box that is filled once a day. You may look into it once an hour.

# %%
show("polling_makes_fresh")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Information ages while it is worked on *and while it waits*. At each arrow it waits for half of the
# interval at which it is produced, on average. The last command ages as well, until the next one replaces it: on
# average by half of the interval at which it is renewed.
#
# </div>
#
# ### Reaction time
#
# Data age looks back from a command. **Reaction time** looks forward: it is the time from an event until the first
# command that uses a picture taken after the event. Here the event first has to wait for the next picture, and at each
# arrow a result has to wait for the *reader* to start. So you would expect two different numbers.
#
# To test this, let the execution times vary from run to run, which is called **jitter**, and let samples get lost.
# Jitter can let one of two parallel workers overtake the other. The late result of the older picture is then dropped.

# %%
show("reaction_is_age")

# %% [markdown]
# Günzel and others (ECRTS 2023) proved that the largest data age equals the largest reaction time, for nearly any way
# of sharing processors. In practice: log the age, because a time stamp that travels with the data is enough for it.
# State the requirement as a reaction time, because that is what people mean.
#
# ## 2 · Design: where the time goes, and what it buys
#
# A **latency budget** gives each arrow a share of the age that a task can bear. The **critical path** is the slowest
# way from the sensor to the motor; its execution and waiting times add up to the age. Time that is saved elsewhere
# changes nothing.

# %%
predict("where_to_spend")

# %% [markdown]
# What can be changed? Besides a faster clock or a shorter execution there are two other ways to run a stage:
#
# * A stage that starts **on arrival** of its input has no clock. If it finishes before the next input comes, no input
#   waits. If it is slower, it starts whenever it is free, with the newest input. If all stages are fast enough, the
#   only period left in the chain is the camera's: a command is in force until the next picture has passed through.
# * **Pipelined** workers begin with a new sample before the last one is finished, as two cooks do with two orders.
#   Results come more often; a single sample takes as long as before.
#
# A stage that needs longer than the interval at which samples arrive is in **overload**. One worker is then not enough:
# the stage leaves out samples, or it gets more workers.
#
# The price is computing. **Utilisation** is the share of a core that a stage keeps busy: execution time divided by
# interval. The table lists the best changes to our chain (by the formula). Changes that break
# a hard deadline are not offered. For example, a joint loop that waits for the next plan would be silent for a tenth of
# a second.

# %% tags=["hide-code"]
options = spend(CHAIN)
table(
    ("stage", "change", "saves [ms]", "additional cores"),
    *((o.stage, o.change, f"{1000 * o.gain:.1f}", f"{o.load:+.2f}") for o in options),
)

# %% [markdown]
# Compare that with what the chain uses now: perception needs 45 ms thirty times per second, the planner 60 ms ten
# times, the loop 0.2 ms a thousand times. That is $1.35 + 0.6 + 0.2 = 2.15$ cores.
#
# ### What is a millisecond worth?
#
# With the speed $v$ and the age $A$, a position that is used as it came is wrong by $v A$. If you know the age, you can
# **predict**: carry the position on at constant velocity. Then only the acceleration $a$ remains, with an error of
# $\tfrac12 a A^2$. To know the age of every sample, you need its time stamp. Without stamps you can only predict by the
# mean age, and then the prediction has an additional error, the speed times the scatter of the age (*rms*: root mean
# square).
#
# If a control loop runs through the chain, age costs it stability. A swing at $f$ Hz goes through $f A$ cycles during
# the delay $A$. The loop lags by the angle $2\pi f A$: it loses *phase*. An answer that comes half a cycle too late
# drives the swing instead of damping it. Chapter 6 derives how much a loop can afford.

# %% tags=["hide-code"]
speeds = np.linspace(0.0, 1.0, 50)
figure_, axes = plt.subplots(figsize=(8, 3.0), layout="constrained")
for name, row, style in (
    ("used as it came", 0, "-"),
    ("predicted, a = 1 m/s²", 1, "--"),
    ("predicted without stamps: additional, rms", 2, ":"),
):
    _ = axes.plot(speeds, [1000 * cost(report, v, 1.0)[row] for v in speeds], style, label=name)
_ = axes.set(xlabel="speed [m/s]", ylabel="error [mm]", title="a mean age of 172 ms")
_ = axes.legend()
plt.show()

# %% tags=["hide-code"]
paid = cost(report, 0.3, 1.0, bandwidth=1.0)
table(
    ("at 0.3 m/s", "error"),
    ("used as it came", f"{1000 * paid.held:.0f} mm"),
    ("predicted with each sample's age, a = 1 m/s²", f"{1000 * paid.predicted:.0f} mm"),
    ("additional in a prediction without stamps", f"{1000 * paid.unstamped:.0f} mm rms"),
    ("phase that a loop of 1 Hz loses", f"{np.degrees(paid.phase):.0f} degrees"),
)

# %% [markdown]
# ### What the boxes are built with
#
# The boxes have well-known implementations: ROS 2 as middleware, ros2_control for the joint loop, MoveIt for planning.
# What to do next, and after a failure, is often written as a **behaviour tree**, a tree whose nodes succeed, fail or
# continue. Which values are read as "the newest", and how old they may be, you have to decide yourself.
#
# <details><summary>These options, with year and source</summary>
#
# <table>
# <tr><th>option</th> <th>year</th> <th>which part</th> <th>source</th></tr>
# <tr><td>ROS 2</td> <td>2022</td> <td>middleware: topics, services, actions over DDS</td> <td>Macenski and others,
# Science Robotics 7</td></tr>
# <tr><td>ros2_control</td> <td>2017</td> <td>the joint loop inside one process, apart from topics</td> <td>Chitta and
# others, ros_control, JOSS 2(20), on which it builds</td></tr>
# <tr><td>MoveIt</td> <td>2014</td> <td>planning behind one interface</td> <td>Coleman and others, J. Software Eng. for
# Robotics</td></tr>
# <tr><td>behaviour trees</td> <td>2018</td> <td>above planning</td> <td>Colledanchise and Ögren, Behavior Trees in
# Robotics and AI</td></tr>
# </table>
#
# </details>
#
# ## 3 · Code: reading, age and reaction
#
# Three short functions carry the chapter. `read` says which sample a reader gets from a queue. `age` and `reaction`
# are methods of the class `Trace`, a recorded run. They are the two definitions of section 1:

# %% tags=["hide-code"]
source(role.read, role.Trace.age, role.Trace.reaction)

# %% [markdown]
# A chain is a list of stages. Change one of them, and compare the formula of section 1, the **closed form**, with 300
# simulated runs, each with random phases. Here the planner starts whenever it is free (rule `queue`, section 6):

# %% tags=["show-code"]
chain = [
    Stage("see", 0.045, 1 / 30, overload="pipelined"),
    Stage("plan", 0.060),
    Stage("act", 0.0002, 0.001),
]
chain[1] = replace(chain[1], overload="queue")
rng = np.random.default_rng(1)
ages = [
    simulate(chain, rng.random(3), seconds=2.0).age(rng.uniform(0.8, 2.0, 20)) for _ in range(300)
]
print(f"predicted {1000 * age(chain).mean:.1f} ms, simulated {1000 * np.mean(ages):.1f} ms")

# %% [markdown]
# The two differ by about 3 ms, and this is not chance. The planner now starts every 60 ms, and pictures come every 33.3
# ms: five plans take as long as nine pictures. The first plan starts with a pose, and after 300 ms everything repeats.
# So a pose waits for 0, 6.7, 13.3, 20 or 26.7 ms, which is 13.3 ms on average. The closed form takes half a period of
# the camera instead, 16.7 ms, because it averages over all waits. So this change saves about 3 ms more than the table
# of section 2 says. Section 6 comes back to this.
#
# ## 4 · The simulation in full
#
# Go back to the simulation at the top. Each dot is the content of one picture, and the number beside it is its age. In
# a box it is worked on; on an arrow it is a result that waits. The readout *newest result* is the age of the
# dot on the arrow that leaves the selected box. The bars are the distribution of all ages in forty seconds, and the
# dashed lines are the closed form: least, mean and bound. Its clocks run slightly off their rates, so their phase
# changes all the time. The switch *all clocks from one* keeps it fixed.
#
# Take the presets one after another, and say what the bars will do before you look. In the preset *Deep queue* samples
# wait in line, and the reader gets the oldest:

# %%
predict("queue_of_ten")

# %% [markdown]
# ## 5 · Speed against accuracy
#
# There are two ways to compute a mean age: the closed form, and an event simulation. An event simulation jumps from one
# start or result of a stage to the next, and we start it with many random phases. How many starts does it need? The
# chart compares them on this chapter's chain. The reference is an average over a regular grid of phases. The closed
# form differs from it a little; that is mostly the reference's error.
#
# ![Error of the mean age against time](../docs/charts/age_precision.png)

# %%
figures(read("age_precision"), "closed form", "1000 random", summary="Times and errors")

# %% [markdown]
# Each point of the event simulation is the median error of nine repeats, and the band spans the quartiles. It takes a
# thousand starts until the median is about half a millisecond. But the event simulation can show what happens
# after *one particular* start, and the closed form can't. Use the formula to design, and the simulation for everything
# that breaks the formula's assumptions.
#
# ## 6 · Debug: where it fails
#
# ### Clocks that are locked
#
# The formula averages over all phases between two clocks. That is right if the phases drift through all values while
# the robot runs. A clock counts the swings of a **quartz**, a crystal that swings at a nearly constant rate. Two clocks
# that count the swings of the same quartz never drift against each other.

# %%
show("long_run_mean")

# %% [markdown]
# On one start of the robot the data are fresh, on the next they are old, and nobody changed the code. The opposite case
# is two computers, each with a quartz of its own:

# %%
show("same_rate_in_step")

# %% [markdown]
# The chart shows both cases, and two more that follow below. Upper left: with locked clocks the mean depends on the
# phase (three teeth, because one period of the reader holds three pictures). Upper right: with drifting clocks the age
# runs through a sawtooth.
#
# ![Locked clocks, drifting clocks, queues, overload](../docs/charts/age_limits.png)

# %%
figures(read("age_limits"), "10 Hz", "drift", "reader", "overload", summary="All figures")

# %% [markdown]
# ### Clocks on two computers: what an offset does
#
# Time stamps help only if the computers agree on the time. If the camera's computer is 5 ms ahead of the controller,
# every age in the log is 5 ms too small, and at 0.3 m/s every prediction is wrong by $0.3 \cdot 5 = 1.5$ mm. All stamps
# are shifted by the same amount, so the scatter of the ages looks as usual.
#
# Look at the extremes instead. If the execution times are constant and the programs' clocks drift, a long log comes
# close to both: the least age is the sum of the execution times, the greatest is the bound. If both are off by the same
# amount, suspect an offset. Jitter moves the extremes, and with locked clocks a log may never come near them; then this
# test says nothing.
#
# Computers set their clocks over the network. One asks the other for the time, and notes when the question left and
# when the answer came. It doesn't know how much of the delay belongs to the way there and how much to the way back,
# so it assumes that both are equal.

# %%
show("round_trip_sets_a_clock")

# %% [markdown]
# The drawing shows one exchange. The four stamps are $t_0$ to $t_3$. The delays of the two ways differ, and so the
# estimated offset is wrong:

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(7, 2.4), layout="constrained")
events = [(0.0, 0), (0.9, 1), (1.2, 1), (1.5, 0)]  # time, computer
for (a, i), (b, j) in ((events[0], events[1]), (events[2], events[3])):
    _ = axis.annotate("", (b, j), (a, i), arrowprops={"arrowstyle": "->", "color": BLUE})
for k, (t, speaker) in enumerate(events):
    _ = axis.plot(t, speaker, "o", color=ORANGE)
    _ = axis.text(
        t + 0.02,
        speaker + (0.1 if speaker else -0.1),
        f"$t_{k}$",
        va="bottom" if speaker else "top",
    )
_ = axis.text(0.33, 0.5, "slow way there, $d_1$", ha="right")
_ = axis.text(1.42, 0.5, "fast way back, $d_2$")
for speaker, name in ((0, "asks"), (1, "answers")):
    _ = axis.hlines(speaker, -0.05, 2.05, color=GREY, lw=0.8, zorder=0)
    _ = axis.text(-0.1, speaker, name, ha="right", va="center")
_ = axis.set(xlim=(-0.4, 2.1), ylim=(-0.45, 1.45), xlabel="true time", yticks=(), xticks=())
plt.show()

# %% [markdown]
# **NTP** (Network Time Protocol, RFC 5905) works like this. It takes its stamps in software, so every wait in the
# operating system looks like network delay. **PTP** (Precision Time Protocol, IEEE 1588) takes them in the network
# card, and the switches on the way report their own delays. That removes most of the unequal part, if every device on
# the way takes part. For a camera there is a third way: a **trigger line**, a wire that tells the camera when to
# expose. The computer that drives the wire knows the time of capture without any network.
#
# Ask two questions about each sensor. Which clock made its stamp? And at what moment: at the middle of the exposure, at
# the end of the readout, or when the driver received the picture? A stamp from the driver makes every picture look
# younger than it is, by readout and transfer and a part of the exposure.
#
# A third question is about the chain: which mean applies? Independent clocks run through all phases, so over many
# minutes the mean of section 1 holds. Clocks that are synchronised by PTP or by a trigger keep one phase. Then the mean
# depends on this phase; the first claim of section 1 has the range for our chain.
#
# ### Queues
#
# A reader that is busy cannot take a new sample, so samples wait in a queue. The **queue depth** is the number of
# samples that fit. If another one arrives, the oldest is dropped. A queue of depth 1 always holds the newest sample.

# %%
show("deep_queue")

# %% [markdown]
# In overload every choice costs something. You can skip samples, use several workers, or let a queue drop samples. A
# queue without a limit is no choice, because the age then grows as long as the robot runs. In the table a camera stage
# of 5 ms (0.15 cores) sends 30 pictures per second to a stage that needs 60 ms for each. The rule *skip* drops what
# comes while the stage is busy. The rule *queue* starts again with the oldest sample in the queue. The ages are
# simulated, because these two rates are locked (five runs take as long as nine pictures), so the formula does not
# apply.

# %% tags=["hide-code"]
camera = Stage("camera", 0.005, 1 / 30)
rows = [("rule", "queue depth", "mean age behind the second stage's result [ms]", "cores")]
for rule, depth in (("skip", 1), ("pipelined", 1), ("queue", 1), ("queue", 10)):
    busy = [camera, Stage("slow", 0.060, None, depth, rule)]
    # 54 s are 1620 pictures and 900 runs of the slow stage: the sampled time has whole cycles.
    run = simulate(busy, (0.0, 0.0), seconds=70.0)
    mean = np.mean(run.age(np.linspace(10.0, 64.0, 200_000, endpoint=False)))
    rows.append((rule, depth, f"{1000 * mean:.0f}", f"{load(busy):.2f}"))
table(*rows)

# %% [markdown]
# `Stage` refuses an execution time above the period unless you choose one of these rules:

# %% tags=["show-code"]
try:
    Stage("slow", 0.060, 1 / 30)
except ValueError as refusal:
    print(str(refusal).replace(", or more", ",\n  or more"))

# %% [markdown]
# ### Jitter
#
# Execution times vary with the load of the computer and with what the camera sees. Does the mean age suffer? A late
# result replaces the old one later. But it also stays in force until the next one comes.

# %%
show("jitter_leaves_the_mean")

# %% [markdown]
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The arm is late.* Send the capture's time stamp along with every command, and plot the age. A
# constant age: add up execution times and half intervals. A jump by whole periods at one arrow: a full queue. A slope
# with jumps: two clocks that drift. Growth without end: overload behind a queue without a limit. Scatter without a
# pattern: the load of the computer. Ages that are too good: somebody stamps at publishing instead of at capture.
#
# </div>
#
# <details><summary>The same as a table: symptom, cause, test, fix</summary>
#
# <table>
# <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr>
# <tr><td>late by nine periods, and nobody is busy</td> <td>full queue</td> <td>set the depth to 1</td> <td>read the
# newest value</td></tr>
# <tr><td>late after some starts only</td> <td>locked clocks</td> <td>restart ten times</td> <td>start on arrival, or
# set the phase</td></tr>
# <tr><td>slowly later, then suddenly well again</td> <td>two clocks that drift</td> <td>plot ten minutes of
# ages</td> <td>start on arrival</td></tr>
# <tr><td>later and later</td> <td>overload</td> <td>count waiting samples</td> <td>choose a rule, reduce the
# load</td></tr>
# <tr><td>the log is fresh, the arm is late</td> <td>stamped at publishing</td> <td>move a thing by hand and film
# it</td> <td>keep the capture's stamp</td></tr>
# <tr><td>negative ages, or predictions off to one side</td> <td>clocks with an offset</td> <td>compare both clocks over
# a round trip</td> <td>PTP, or a trigger line</td></tr>
# </table>
#
# </details>
#
# ## 7 · Exercises
#
# Four functions and a formula. `check` runs your function on fresh random cases. If something is wrong, it shows the
# failing call and, where it can, the likely cause.

# %% [markdown]
# ### How far it moves before it knows
#
# A warm-up: latencies become a distance.

# %%
card("blind_distance")


# %%
def blind_distance(latencies, period, speed):
    """Return how far a robot moves between a measurement and the command that uses it."""
    # The slowest stage alone.
    distance = np.asarray(speed) * np.max(latencies, initial=0.0)
    return distance, distance


check(blind_distance)

# %% [markdown]
# ### How old is a command?
#
# The same chain with a clock in each stage.

# %%
card("chain_age")


# %%
def chain_age(executions, periods):
    """Return least, mean and greatest age of the information behind the command in force.

    Args:
        executions: of each stage, shape (n,) [s].
        periods: of its clock, shape (n,) [s]; 0 where it starts when its input arrives.

    Returns:
        The three, shape (3,) [s].
    """
    # As if nobody ever waited.
    return np.full(3, np.sum(executions))


# %%
check(chain_age)

# %%
card("over_budget")


# %%
def over_budget(edges, latencies, budgets, start, goal):
    """Return the first edge on the critical path that takes more than it may.

    Args:
        edges: from box, to box, shape (m, 2); no loops.
        latencies: what each edge takes, shape (m,) [s].
        budgets: what it may take, shape (m,) [s].
        start, goal: boxes at the ends of the path.

    Returns:
        (number of the edge, -1 for none; latency of the whole critical path [s]).
    """
    # The worst of all edges, wherever it is.
    late = np.asarray(latencies) - np.asarray(budgets)
    return int(np.argmax(late)), float(np.sum(latencies))


# %%
check(over_budget)

# %% [markdown]
# ### Silent bug: a log that looks fresh

# %%
card("log_age")


# %%
def log_age(captured, published, times):
    """Return how old the newest information is that a reader has.

    Args:
        captured: when each measurement was taken, shape (n,) [s].
        published: when it arrived, shape (n,) [s], in any order.
        times: of reading, shape (m,) [s].

    Returns:
        Ages, shape (m,) [s]; -1 where nothing has arrived.
    """
    arrivals = np.sort(np.asarray(published, dtype=float))
    ages = np.full(len(times), -1.0)
    for i, now in enumerate(times):
        last = np.searchsorted(arrivals, now, side="right") - 1
        if last >= 0:
            ages[i] = now - arrivals[last]
    return ages


# %%
check(log_age)

# %% [markdown]
# ### A formula: the full queue
#
# Any equivalent form is right. <span class="kernel-only">Change the text in quotes.</span>

# %%
answer("deep_queue", "d*T")

# %% [markdown]
# ## 8 · What simulation buys
#
# Why simulate at all? The usual answer is a table of before and after. Here is a question about such a table.

# %%
predict("gold_plated_table")

# %% [markdown]
# This table stands in the lesson that this course began with. It names no source, so read it as an illustration of what
# people hope for, and don't repeat its numbers:
#
# | | without simulation | with simulation |
# |---|---|---|
# | first working policy | 6 months | 3 weeks and 2 days |
# | a training run | 50,000 dollars | 200 dollars |
# | iterations a day | 2 or 3 | over 1000 |
# | damages during development | about 12 | none in simulation, 1 on the robot |
# | transfer to the robot | not asked | 60 to 90 % |
#
# What you *can* compute is the number of tries per day. On a robot it follows from the duration of a try and of its
# reset. In simulation it follows from the length of a try, the steps per second and the cost of one step, which chapter
# 1 measures. Damage grows with the number of tries on the real robot. The next simulation multiplies that number by a
# rate that you choose, the damages in 1,000 tries. Its axes count powers of ten: 3 stands for 1,000 tries, and $-3$ for
# a thousandth of a day, about a minute and a half.

# %%
simulation("development")

# %% [markdown]
# <details><summary>More sentences of this kind, and what this course can say about them</summary>
#
# * *"A cached roadmap with lazy checks takes a query from 800 ms to 50 ms."* Chapter 5 measures this comparison on its
#   own worlds, slow queries included. Whose 800 ms these were is not known.
# * *"A policy fell from 94 to 35 % because of 20 ms of delay."* No data are known. What 20 ms cost a loop stands below,
#   and chapter 8 measures a delay on an arm.
# * *"87 % of first grasps succeed, validated in 10,000 episodes."* Ten thousand simulated episodes tell how certain the
#   *simulated* rate is. The robot's rate is as certain as the number of grasps on the robot makes it.
# * *"One hour spent on fidelity saves ten on the robot."* No data are known. Fidelity saves time only where the
#   simulation left out something that matters.
#
# </details>
#
# How certain is a success rate? It depends on the number of tries. The table gives Wilson's interval, which holds the
# true rate in about 95 of 100 such experiments:

# %% tags=["hide-code"]
rows = [("successes", "rate", "95 % interval of the rate")]
for good, tried in ((13, 15), (87, 100), (8700, 10_000)):
    low, high = wilson(good, tried)
    rows.append(
        (
            f"{good:,} of {tried:,}",
            f"{100 * good / tried:.1f} %",
            f"{100 * low:.1f} to {100 * high:.1f} %",
        )
    )
table(*rows)

# %% [markdown]
# And what do 20 ms of delay cost a control loop? Phase, in proportion to the frequency that the loop has to follow:

# %% tags=["hide-code"]
table(
    ("20 ms of delay in a loop of", "phase that it loses"),
    *(
        (f"{f:g} Hz", f"{np.degrees(cost(0.020, 0.0, bandwidth=f).phase):.1f} degrees")
        for f in (1.0, 5.0, 20.0)
    ),
)

# %% [markdown]
# ## 9 · Frontier: fewer boxes
#
# A learned policy can replace perception and planning at once (chapter 9). It receives pictures and returns a
# **chunk**, the actions of the next few tenths of a second. What does that do to the age?

# %%
predict("one_policy_for_three_boxes")

# %% tags=["hide-code"]
rows = [("a new chunk every", "mean age [ms]", "bound [ms]")]
for looks in (0.1, 0.4, 0.8):
    policy = [Stage("policy", 0.080, looks), Stage("control", 0.0002, 0.001)]
    one = age(policy)
    rows.append((f"{looks:.1f} s", f"{1000 * one.mean:.0f}", f"{1000 * one.greatest:.0f}"))
table(*rows)

# %% [markdown]
# The arrows between the boxes disappear: there is no pose to look at and no path to check. The graph keeps its ends.
# The age between them is that of one stage in front of the joint loop. A policy that returns a chunk of actions (Zhao
# and others, RSS 2023) executes it until the answer to the next observation is there, so the interval of this stage is
# the time between two observations.
#
# If inference always takes 80 ms, the chunk has to last as long as this interval: 0.8 s in the last row. If inference
# times vary, it has to last a little longer. A chunk that is too short leaves a gap without actions.
#
# A **digital twin**, a simulation that runs beside the robot and follows its joint states, is one more reader of an
# arrow, with a data age of its own.
#
# ## 10 · Interview
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** *"I built X, which made Y possible. I tested it by simulation Z and ran it on W."* This is a good
# frame if you put a number behind Y, Z and W and can defend it: what was measured, against what, and how often. Say
# what it did *not* do before you are asked.
#
# </div>
#
# This chapter in that frame, with its own numbers:

# %% tags=["hide-code"]
table(
    ("", "what you could say"),
    ("X", "I wrote a model of the data age in a picking stack with three stages."),
    (
        "Y",
        f"It named the change that saves most, by its formula {1000 * max(o.gain for o in options):.0f} "
        f"of {1000 * age(CHAIN).mean:.0f} ms, before anything was built.",
    ),
    (
        "Z",
        f"An event simulation gave {figure('chain_age', 'simulated_ms'):.1f} ms where the model "
        f"predicts {figure('chain_age', 'mean_ms'):.1f} ms.",
    ),
    (
        "W",
        "It has not run on a robot yet; there I would send the capture's stamp with each command.",
    ),
)

# %% [markdown]
# Now answer these questions aloud. Then open the answer of one minute, the full answer, and the follow-up questions.

# %%
interview("role")

# %% [markdown]
# ### Checkpoint
#
# Five questions on this chapter, drawn by a seed. Where a gain is asked for: the integral of a swing lags behind it
# by a quarter of a cycle.

# %%
checkpoint("role", ["", "", "", "", ""], seed=1)
