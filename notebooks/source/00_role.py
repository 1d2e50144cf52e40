# %% [markdown]
# # 0 · The role
#
# *A robot picks parts from a moving belt, and it always reaches for a place a little behind the part. Every program
# on the robot is fast. How old is the image behind its present motor command?* About {open minutes} minutes of
# reading, cards and charts. The folded parts add {folded minutes} minutes, the exercises {exercise minutes} minutes.
# The answers in section 10 are not counted.

# %%
from course.cards import predict
from course.simulations import simulation

predict("how_old_is_a_command")

# %% [markdown]
# ![The stack as a graph](attachment:role.stack.png)

# %%
simulation("stack")

# %% [markdown]
# The drawing shows the software of a robot, its *stack*. Each dot belongs to one image, and the number is the image's
# age. The blue bars show how often the command has each age in a simulated run. The dashed lines come from a formula
# (section 1): the least age, the mean, and a *bound* that no age exceeds. The last number is the age of the newest
# result of the box that you click (at first perception).
#
# **After this chapter you can** draw a stack as a graph, with the rate, the size and the kind of deadline of every
# arrow; compute how old the information behind a motor command is; find the change that makes it younger; and
# recognise, in a log, a full queue and trouble between two clocks. **Know first:** some Python, and what a mean is.
#
# ## How this course works
#
# This course prepares for a role: an engineer who simulates robots, and who can say how far a simulated number can be
# trusted.
#
# *Cards* ask questions. Some show a statement to judge: true, false, or true only under a condition.
#
# Section 7 has a formula and these exercises:

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint

badges(0)

# %% tags=["hide-code"]
import inspect

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

from course import role
from course.cards import figures, interview
from course.charts import read
from course.derivations import show
from course.measure.success import wilson
from course.role import CHAIN, STACK, Stage, age, cost, load, simulate, spend

BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#7f7f7f"


def source(*functions):
    """Show functions as they stand in the module, methods below the line of their class."""
    parts, last = [], ""
    for one in functions:
        owner = one.__qualname__.rpartition(".")[0]
        parts.append(f"class {owner}:\n" * (owner != last and owner != "") + inspect.getsource(one))
        last = owner
    text = "\n\n".join(parts)
    return Markdown(f"```python\n{text}```")


def table(*rows):
    """Return rows of text as a table; the first one is the head."""
    lines = [f"| {' | '.join(map(str, row))} |" for row in rows]
    return Markdown("\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]))


# %% [markdown]
# ## 1 · Concept: six boxes and a robot
#
# The drawing at the top has six boxes of software and one for the robot. Click a box to read what goes in and out:
#
# * The **simulation** takes torques (turning moments) and returns images and **joint states**: the angles, speeds and
#   torques of the joints. It stands for the robot (chapters 1 to 4).
# * The **middleware** carries messages from one program to another. Each image has a **time stamp**, at best the
#   moment of its capture. The camera sets it, or its *driver*, the program that reads the camera (chapter 10).
# * **Perception** turns images (*frames*) into poses, the positions and orientations of things, with their
#   uncertainty, the *covariance* (chapter 7).
# * **Planning** turns poses into trajectories, motions over time (chapter 5).
# * **Control**, also called the *joint loop*, turns trajectories and joint states into the motor commands, here
#   torques, 1,000 times per second (chapter 6).
# * **Learning** turns logs and **episodes** (tries at a task) into parameters of the simulation and into
#   **policies**, programs that choose the next action (chapters 8 and 9).
#
# An arrow carries samples, such as images. With a **hard deadline** each late sample counts as a failure. With a
# **soft deadline** a late sample is only worth less.

# %%
predict("never_late")

# %% [markdown]
# <details><summary>Which drawings of a stack are wrong?</summary>
#
# The function `check_stack` tests the drawing. Each box must have an input and an output. By convention, each closed
# path of arrows must also pass through the robot or its simulation. In any other closed path, each program may wait
# for the one before it. Then none of them ever starts.
#
# </details>
#
# The **bandwidth** of an arrow is its rate times the size of each sample: bytes per second. A depth camera measures
# the distance at each pixel. With 640 by 480 pixels of 2 bytes at 30 Hz, it sends $640 \cdot 480 \cdot 2 \cdot 30 =
# 18.4$ million bytes per second.
#
# The table lists the arrows with the largest bandwidth. The arrows of the simulation have no deadlines, because this
# simulation waits for its readers and for the torques.

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
# Nearly all bytes belong to images. Nearly all messages are joint states and torques. Only the arrows between the
# joint loop and the robot have hard deadlines. So the joint loop runs with *real-time priority*: when it has to
# start, other programs wait. Often it also has a processor *core* to itself.
#
# ### How old is a command?
#
# The motor command of this moment follows a trajectory. The trajectory was planned for a pose, and the pose was
# computed from an image. The **data age** of the command is the time from the capture of that image until now. A
# command is *in force* until the next command replaces it.
#
# Each program in this chain is a *stage*. A stage has an **execution time** $C$, the time from its start to its
# result. Most stages also have a clock with a **period** $T$: the clock ticks once per period, and each tick starts
# the stage. When a stage starts, it takes the newest result of the stage before it. The **interval** of a stage is
# the time from one result to the next. In our chain each interval is equal to the period.
#
# The chain of this chapter has three stages. *Perception* needs 45 ms. Each image of a camera at 30 Hz starts it, so
# we count the camera's clock as its clock. The 45 ms are longer than the 33.3 ms between two images. So two copies of
# the program, two *workers*, take turns, each with every second image. The *planner* starts 10 times per second and
# needs 60 ms. The *joint loop* runs at 1,000 Hz and needs 0.2 ms.
#
# We count only this work and the waits between the stages. The exposure of the image, the transport of messages and
# the delay of the motors come on top.

# %%
show("chain_age")

# %% [markdown]
# The next diagram shows how the age grows from 0, the capture of the image, to the present moment. Blue bars are
# work. An orange bar shows how long a result had been finished when the next stage read it. The last orange bar shows
# how long the command has been in force:

# %% tags=["hide-code"]
parts, names = [], []
words = (
    ("perception: work", "pose: until it is read"),
    ("planner: work", "plan: until it is read"),
    ("joint loop: work", "command: in force"),
)
for stage, wait, both in zip(CHAIN, age(CHAIN).waits, words, strict=True):
    parts += [stage.execution, wait]
    names += both
ends = 1000 * np.cumsum(parts)
figure_, axes = plt.subplots(figsize=(8, 2.6), layout="constrained")
for k, (part, end) in enumerate(zip(parts, ends, strict=True)):
    _ = axes.barh(k, 1000 * part, left=end - 1000 * part, color=[BLUE, ORANGE][k % 2])
    _ = axes.text(end + 2, k, f"{1000 * part:.1f}", va="center")
_ = axes.set(yticks=range(6), yticklabels=names, xlabel="mean age [ms]", xlim=(0, 190))
_ = axes.set_title(f"mean age of the command in force: {ends[-1]:.1f} ms")
axes.invert_yaxis()
plt.show()

# %% tags=["hide-code"]
report = age(CHAIN)
table(
    ("age of the command", "[ms]", "meanwhile a part at 0.3 m/s has moved [mm]"),
    *(
        (name, f"{1000 * value:.1f}", f"{300 * value:.0f}")
        for name, value in (
            ("least", report.least),
            ("mean", report.mean),
            ("bound (conditions below)", report.greatest),
        )
    ),
)

# %% [markdown]
# Why half of each period? The planner looks for a pose at a random moment of perception's period. The newest pose may
# have come just now, or almost a whole period ago. On average it came half a period ago. In the same way, the loop
# uses a plan that came, on average, half a planner period ago, 50 ms. And the command in force came half a loop period
# ago.
#
# **A worked example.** Suppose that the clocks of the camera, the planner and the joint loop run independently. The
# execution times add up to $45 + 60 + 0.2 = 105.2$ ms. Half of each period comes on top: $16.7 + 50 + 0.5 = 67.2$ ms.
# Together that is a mean age of 172.4 ms. In this time a part on a belt at 0.3 m/s moves by $0.3 \cdot 172.4 \approx
# 52$ mm. A robot that aims at the pose as it came reaches, on average, 52 mm behind the part.
#
# At worst, whole periods come on top instead of halves: $105.2 + 33.3 + 100 + 1 = 239.5$ ms. This is the *bound* in
# the table. No age exceeds it if every stage starts on time and never needs longer than its $C$, no result is lost,
# and every reader takes the newest result.
#
# The **phase** of two clocks is the time from a tick of one to the next tick of the other. Independent clocks
# **drift**: no clock keeps its rate exactly, so the phase changes slowly, and over some hours it takes all values. The
# 172.4 ms are the mean over all phases.
#
# Programs on one computer usually share its clock. Then the mean can depend on their phase (section 6).
#
# <details><summary>Derive the least age, the mean and the bound</summary>
#
# Go backwards from now. The command in force was issued at some time during the last $T_n$, the interval of the last
# stage. This time is evenly distributed from 0 to $T_n$, because now is a random moment. The last stage had begun
# $C_n$ earlier. It read the newest result of stage $n-1$, which had been waiting for a time that is evenly
# distributed from 0 to $T_{n-1}$. Continue in the same way to the capture of the image.
#
# So the age is the sum of all $C_i$ and of independent waits, each evenly distributed from 0 to $T_i$. It lies
# between $\sum C$ and $\sum C+\sum T$. Its mean is $\sum C+\tfrac12\sum T$ and its variance $\tfrac1{12}\sum T^2$.
# The bound is that of Davare and others (DAC 2007), who use response times on shared processors in place of $C$. Dürr
# and others (2019) made it tighter for tasks without a fixed period.
#
# </details>
#
# ### Whose period?
#
# Two stages meet at each arrow: the **producer**, which writes results, and the **reader**, which takes them. If the
# data are too old, many people first make the reader *poll* more often: look more often for a new result. A newspaper
# comes once a day. You look at it once an hour, then twice an hour. Is it fresher then?

# %%
show("polling_makes_fresh")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Information ages while it is worked on *and while it waits*. If results come regularly, a reader with
# a clock of its own finds one that has waited for half of the *producer's* interval, on average over all phases. The
# command in force ages as well, until the next one replaces it.
#
# </div>
#
# ### Reaction time
#
# Data age looks back from a command. **Reaction time** looks forward from an event: it is the time until the first
# command that uses an image taken after the event. The event first waits for the next image. At each arrow the result
# then waits until the *reader* starts.
#
# Both times contain all execution times. On average, these times come on top:
#
# * Data age: half an interval of perception and half an interval of the planner (the *producers*), and half an
#   interval of the joint loop, whose command is in force.
# * Reaction time: half an interval of the camera, because the event waits for the next image; half an interval of the
#   planner and half an interval of the joint loop (the *readers*).
#
# The camera and perception have the same interval. So both means are equal.
#
# Do both times also have the same *distribution*: is each value as frequent in one as in the other? The next card
# tests this with lost results and with **jitter**, execution times that vary. With jitter a result can overtake an
# older one. The simulation then drops the older one.

# %%
show("reaction_is_age")

# %% [markdown]
# Log the data age, because you only need a time stamp that travels with the data. Write requirements as reaction
# times, because people ask how soon a robot reacts.
#
# ## 2 · Design: where the time goes, and what it buys
#
# The **latency** of a box or an arrow is the time that information spends there. If a task allows a certain age, a
# **latency budget** divides this age among the boxes and arrows.
#
# Images and joint states reach the motors on two paths, and on each path the information has an age of its own. The
# **critical path** is the one on which the information becomes oldest, here the path from the camera. Time saved on
# another path does not make this information younger.

# %%
predict("where_to_spend")

# %% [markdown]
# A stage can get a faster clock, which keeps more cores busy. Or somebody shortens its execution time: then, with
# independent clocks and unchanged intervals, the mean age falls by what is saved. There are two other changes:
#
# * A stage that starts **on arrival** has no clock. Each new input starts it. So no input waits, as long as the stage
#   is free when the input comes.
# * A **pipelined** stage has several workers. One of them begins with a new sample before another has finished the
#   last one. Results come more often; a single sample takes as long as before. Each worker needs hardware of its own.
#
# A stage is in **overload** if it is started more often than one worker can finish. (For this reason perception has
# two workers.) If poses start our planner, they overload it: a plan takes 60 ms, and a pose comes every 33.3 ms. So
# the planner needs a rule. With *skip* it ignores the poses that come while it is busy, and starts with the next one
# that comes. With *queue* there is room for one waiting pose. A newer pose replaces it, and the planner takes the pose
# that waits as soon as it is free. Or the planner is *pipelined*: then it plans for every pose.

# %%
show("start_when_free")

# %% [markdown]
# **Utilisation** is the number of cores that a stage keeps busy: execution time divided by interval. Before any
# change the chain uses $0.045 \cdot 30 + 0.060 \cdot 10 + 0.0002 \cdot 1000 = 2.15$ cores.
#
# With *skip* a pose does not wait, which saves 16.7 ms. And a plan comes with every second pose, every 66.7 ms
# instead of every 100 ms. Half of this difference is another 16.7 ms.
#
# <details><summary>What <em>queue</em> and <em>pipelined</em> save</summary>
#
# With *queue* a plan comes every 60 ms, which saves 20 ms. A pose waits half of the interval between poses, 16.7 ms
# on average, if the 60 ms vary a little: that is as long as before. *Pipelined*, no pose waits, which saves 16.7 ms,
# and a plan comes every 33.3 ms, which saves 33.3 ms.
#
# </details>
#
# In the table the change that saves most per core comes first. Twice the rate of perception means a camera with 60
# images per second:

# %% tags=["hide-code"]
options = spend(CHAIN)
table(
    ("stage", "change", "saves [ms]", "additional cores", "saves per core [ms]"),
    *(
        (
            o.stage,
            o.change,
            f"{1000 * o.gain:.3g}",
            f"{o.load:+.2f}",
            f"{1000 * o.gain / o.load:.3g}",
        )
        for o in options
    ),
)

# %% [markdown]
# ### What is a millisecond worth?
#
# In the time $A$ a part with the speed $v$ moves by $v A$. If its position is $A$ seconds old and you use it as it
# came, you are wrong by this distance. If you know the age and the speed, you can **predict**: you add $v A$ to the
# old position. Here the joint loop also receives the speed of the belt, and shifts the planned path by $v A$ at each
# command. Two errors remain. An error of the speed is multiplied by $A$: 1 cm/s becomes 1.7 mm. And if the part
# accelerates by $a$, it moves by another $\tfrac12 a A^2$.
#
# To know the age of every sample, you need its time stamp. Without stamps you know only the mean age, so the
# prediction has an additional error. The **standard deviation** measures how much a value varies around its mean. The
# standard deviation of this error is the speed times the standard deviation of the age.
#
# If images steer the arm, old images can make it *unstable*: it swings more and more. Let the arm swing at $f$ Hz.
# During the age $A$ it goes through $f A$ cycles, so the correction comes with a **phase lag** of $2\pi f A$. Suppose
# that the arm moves with a speed proportional to the error in the image. Then a correction that is less than a quarter
# of a cycle (90 degrees) late makes the swing smaller. A later one makes it larger (chapter 6).
#
# In the chart the belt speeds up with 1 m/s². We know the speed at the capture (on the axis) exactly. *Used as it
# came* and *predicted* are mean errors: they always have the same direction. The third curve is the standard deviation
# of the error that is added without time stamps, which can have either direction. The table has the errors at 0.3 m/s.

# %% tags=["hide-code"]
speeds = np.linspace(0.0, 1.0, 50)
title = f"mean age {1000 * report.mean:.0f} ms, acceleration 1 m/s²"
figure_, axes = plt.subplots(figsize=(8, 3.0), layout="constrained")
errors = np.array([cost(report, v, 1.0)[:3] for v in speeds])
errors[:, 0] += errors[:, 1]  # What is used as it came also misses what the acceleration adds.
for name, row, style in (
    ("used as it came", 0, "-"),
    ("predicted", 1, "--"),
    ("additional without time stamps (standard deviation)", 2, ":"),
):
    _ = axes.plot(speeds, 1000 * errors[:, row], style, label=name)
_ = axes.set(xlabel="speed [m/s]", ylabel="error [mm]", title=title)
_ = axes.legend()
plt.show()

# %% tags=["hide-code"]
paid = cost(report, 0.3, 1.0, bandwidth=1.0)
table(
    (f"mean age {1000 * report.mean:.0f} ms, speed 0.3 m/s", "error or lag"),
    ("used as it came, constant speed", f"{1000 * paid.held:.0f} mm"),
    ("used as it came, acceleration 1 m/s²", f"{1000 * (paid.held + paid.predicted):.0f} mm"),
    (
        "predicted with each sample's age, acceleration 1 m/s²",
        f"{1000 * paid.predicted:.0f} mm",
    ),
    ("additional without time stamps (standard deviation)", f"{1000 * paid.unstamped:.0f} mm"),
    ("phase lag of a swing at 1 Hz", f"{np.degrees(paid.phase):.0f} degrees"),
)

# %% [markdown]
# Prediction removes what grows with the speed. Without time stamps, some of that comes back.
#
# ### What the boxes are built with
#
# Free software exists for most boxes: ROS 2 as middleware, ros2_control for the joint loop, MoveIt for planning. Above
# planning, a **behaviour tree** often decides what the robot does next, and what it does after a failure.
#
# <details><summary>These options, with year and source</summary>
#
# <table>
# <tr><th>option</th> <th>year</th> <th>which part</th> <th>source</th></tr>
# <tr><td>ROS 2</td> <td>2022</td> <td>middleware: topics, services, actions over DDS</td> <td>Macenski and others,
# Science Robotics 7</td></tr>
# <tr><td>ros2_control</td> <td>2017 (ros_control)</td> <td>the joint loop inside one process, apart from
# topics</td> <td>Chitta and others, ros_control, JOSS 2(20), on which it builds</td></tr>
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
# In a **queue** a new sample joins at the end, and the reader takes the one at the front. The **queue depth** is the
# number of samples that fit. If a new sample finds the queue full, the sample at the front is dropped. The function
# `read` returns which sample a reader gets. The class `Trace` is a recorded run. For each command it stores when it
# came into force (`published`), and when its image was taken (`captured`). Its methods `age` and `reaction` compute
# the two times of section 1:

# %% tags=["hide-code"]
source(role.read, role.Trace.age, role.Trace.reaction)

# %% [markdown]
# A chain is a list of stages. Each has a name, an execution time and, if it has a clock, a period, both in seconds. A
# stage in overload also has a rule. Here the planner starts on arrival, with the rule *skip*. The next cell compares
# the **closed form**, the formula of section 1 adapted to this planner, with 300 simulated runs with random phases.
# (The function `age` is the closed form. The method `age` belongs to a simulated run.)

# %% tags=["show-code"]
chain = [
    Stage("perception", 0.045, 1 / 30, overload="pipelined"),
    Stage("planner", 0.060, overload="skip"),
    Stage("joint loop", 0.0002, 0.001),
]
rng = np.random.default_rng(1)
ages = [
    # A phase for each stage (the planner has no clock and ignores its own). After 0.8 s, all have
    # results.
    simulate(chain, rng.random(3), seconds=2.0).age(rng.uniform(0.8, 2.0, 20))
    for _ in range(300)
]
simulated = 1000 * np.mean(ages)
spread = 1000 * np.std(np.mean(ages, axis=1)) / np.sqrt(len(ages))
print(f"predicted {1000 * age(chain).mean:.1f} ms, simulated {simulated:.1f} ± {spread:.1f} ms")

# %% [markdown]
# The ± is the **standard error**: the standard deviation that the mean of 300 runs would have if we repeated them. (We
# estimate it from the means of the single runs.) The two values differ by less, which can be chance.
#
# ## 4 · The simulation in full
#
# In the simulation at the top, a dot in a box belongs to an image on which this box works now. A dot on an arrow is
# the newest result of the box where the arrow begins. On the arrow from control to the robot it is the command in
# force. Blue arrows belong to the selected box; wider arrows carry more messages per second.
#
# The bars come from thirty seconds in which the clocks run through all phases: they drift much faster than real
# clocks. The switch *all clocks from one* stops the drift.
#
# Try the presets, and predict the bars first. In the preset *Deep queue* up to ten poses wait for the planner:

# %%
predict("queue_of_ten")

# %% [markdown]
# ## 5 · Speed against accuracy
#
# There are two ways to compute a mean age: the closed form and an event simulation, which jumps from one event to the
# next. Here an event is the start or the result of a stage. We simulate this chapter's chain many times with random
# phases. From each run we take the age at one random moment. So the ages are independent. Then we compute their mean.
#
# The *error* of such a mean is its distance from a reference: the mean over 8,192 runs whose phases are spread evenly
# over all values. For 3, 10, 30, 100, 300 and 1,000 runs we compute the error nine times. A green point is the
# *median*, the middle one of these nine errors. The band around it holds their middle half. The blue point is the
# closed form. It is exact for this chain. So the error at the blue point is that of the reference.
#
# ![Error of the mean age against time](../docs/charts/age_precision.png)

# %%
figures(read("age_precision"), "closed form", "1,000 runs", summary="Times and errors")

# %% [markdown]
# How many runs does an error of 1 ms take? One age has a standard deviation of 30.4 ms, and the mean over $n$ runs
# has $30.4/\sqrt n$ ms. That is 1 ms at $30.4^2 \approx 920$ runs. But the chart shows the median error. Means of
# many values follow a bell curve, and its median error is 0.67 of the standard deviation. So the green line reaches
# 1 ms, the dotted line, at about $0.67^2 \cdot 920 \approx 410$ runs.
#
# The closed form needs only microseconds, but it gives the mean over all phases. Use the formula to design, and the
# simulation where the formula's assumptions fail.
#
# ## 6 · Debug: where it fails
#
# ### Clocks that are locked
#
# The formula averages over all phases between two clocks. There are two reasons why a phase can change:
#
# * The clocks drift. A clock counts the swings of a **quartz**, a crystal that swings at a nearly constant rate. Two
#   clocks that count the swings of the same quartz never drift against each other.
# * The rates do not fit together. 30 Hz and 10 Hz fit: three periods of one clock last as long as one period of the
#   other. So each tick of the slower clock comes at the same moment between two ticks of the faster one. At 30 Hz and
#   9.73 Hz it comes at about twelve different moments, evenly spread.
#
# Two clocks are **locked** if neither is the case: they do not drift, and the slower clock ticks at the same moment
# each time, or at two or three in turn.

# %%
show("long_run_mean")

# %% [markdown]
# With locked clocks the data can be fresh after one start of the robot and old after the next, although nobody
# changed the code. On two computers it is different, because each has a quartz of its own:

# %%
show("same_rate_in_step")

# %% [markdown]
# The upper row of the chart shows locked and drifting clocks. The lower row belongs to *Queues* below. A camera takes
# 30 images per second, and *age at reading* is the age of an image when the reader takes it. Markers and coloured
# lines are the event simulation. The thin black lines are the theory.
#
# ![Locked clocks, drifting clocks, queues, overload](../docs/charts/age_limits.png)

# %%
figures(read("age_limits"), "10 Hz", "9.73 Hz", "drift", summary="All figures")

# %% [markdown]
# Upper left: the clock of a reader at 10 Hz is locked to the camera's, so the mean depends on the phase at the start
# (the axis). The curve has three teeth because three images come in one period of the reader. A reader at 9.73 Hz is
# not locked, even with the same quartz: its mean stays near half of the camera's period, marked $T/2$. Small waves
# remain, because there are only twelve moments.
#
# Upper right: the reader's clock is slower than the camera's by 100 **ppm**, parts per million. The age rises slowly,
# falls at once by one period, and rises again. This shape is a *sawtooth*.
#
# ### Clocks on two computers: what an offset does
#
# So far a clock was what starts a stage. Time stamps come from another one, the clock that tells a computer the time.
# They help only if the computers agree on the time. The difference between two such clocks at the same moment is
# their **offset**. Suppose that the clock of the camera's computer is 5 ms ahead of the clock of the joint loop's
# computer. Then every age that the joint loop logs is 5 ms too small, and at 0.3 m/s every prediction is wrong by
# $0.3$ m/s $\cdot\ 5$ ms $= 1.5$ mm. All ages shift equally, so their spread does not show it.
#
# Look instead at the least age over several hours. If the execution times are constant and the clocks that start the
# programs drift, this age comes close to the sum of the execution times. If it is smaller, suspect an offset or a
# late stamp. If it is larger, and not by whole periods (a full queue), suspect an offset in the other direction
# or the transport of messages, which we did not count. The ages cannot tell these two apart, so compare the two clocks
# directly.
#
# Computers set their clocks over the network. One computer sends a question at $t_0$, which arrives at another one at
# $t_1$. The answer leaves at $t_2$ and arrives at $t_3$. The first computer's clock measures $t_0$ and $t_3$, the
# other clock measures $t_1$ and $t_2$. The **round trip** is the time on the network, $(t_3 - t_0) - (t_2 - t_1)$.
#
# The first computer assumes that the question took as long as the answer, each half of the round trip. From this it
# computes the offset, and corrects its own clock.
#
# <details><summary>The formula of the offset</summary>
#
# Let the question take the time $d_1$, the answer $d_2$, and let the other clock be ahead by $x$. Then
# $t_1-t_0=d_1+x$ and $t_3-t_2=d_2-x$. If $d_1$ and $d_2$ are equal, both cancel in the difference of the two
# equations, and $x=((t_1-t_0)-(t_3-t_2))/2$.
#
# </details>

# %%
show("round_trip_sets_a_clock")

# %% [markdown]
# In the drawing the question takes longer than the answer. The assumption (dashed) puts its arrival at the grey
# point, too early. The clock that is corrected in this way is wrong by the orange distance:

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(7, 2.4), layout="constrained")
events = [(0.0, 0), (0.9, 1), (1.2, 1), (1.5, 0)]  # time, computer
for (a, i), (b, j) in ((events[0], events[1]), (events[2], events[3])):
    _ = axis.annotate("", (b, j), (a, i), arrowprops={"arrowstyle": "->", "color": BLUE})
for k, (t, speaker) in enumerate(events):
    _ = axis.plot(t, speaker, "o", color=BLUE)
    _ = axis.text(
        t + 0.02,
        speaker + (0.1 if speaker else -0.1),
        f"$t_{k}$",
        va="bottom" if speaker else "top",
    )
assumed = (events[1][0] + events[3][0] - events[2][0]) / 2  # half of the round trip
_ = axis.plot((0.0, assumed), (0, 1), "--", color=GREY)
_ = axis.plot((assumed, events[1][0]), (1, 1), color=ORANGE, lw=3)
_ = axis.plot(assumed, 1, "o", color=GREY)
_ = axis.text(assumed - 0.03, 1.1, "assumed $t_1$", ha="right")
_ = axis.text((assumed + events[1][0]) / 2, 1.24, "error", ha="center", color=ORANGE)
_ = axis.text(0.63, 0.5, "question: slow, $d_1$")
_ = axis.text(1.42, 0.5, "answer: fast, $d_2$")
for speaker, name in ((0, "first computer"), (1, "other computer")):
    _ = axis.hlines(speaker, -0.05, 2.05, color=GREY, lw=0.8, zorder=0)
    _ = axis.text(-0.1, speaker, name, ha="right", va="center")
_ = axis.set(xlim=(-0.55, 2.1), ylim=(-0.45, 1.45), xlabel="true time", yticks=(), xticks=())
plt.show()

# %% [markdown]
# **NTP** (Network Time Protocol, RFC 5905) works in this way. Usually software takes its stamps, so a wait in the
# operating system looks like a delay on the network. **PTP** (Precision Time Protocol, IEEE 1588) usually takes the
# stamps in the network card, and devices between the two computers that support PTP correct for the delay that they
# cause.
#
# For a camera there is a third solution: a **trigger line**, a wire whose signal tells the camera when to take an
# image. The sender knows the time of capture without any network. But after one lost image,
# all later ones may get the time of a wrong signal.
#
# Ask two questions about each sensor. Which clock makes its time stamp? And at which moment: in the middle of the
# *exposure*, the time in which the camera collects light; or when the image leaves the camera; or when a program
# receives it? The later the stamp, the younger every image looks.
#
# Ask a third question about the chain: are its clocks locked? Independent clocks run through all phases, but slowly:
# two clocks at 30 Hz that differ by 10 ppm need almost an hour. Synchronised clocks hardly drift. If the clocks that
# start our stages are synchronised, they are locked, because the rates of camera, planner and joint loop are 3 to 1 to
# 100. Then the mean age lies between about 155 and 190 ms, depending on the start of the robot.
#
# <details><summary>Derive these two limits</summary>
#
# With locked clocks all poses of a run have waited equally long when the planner takes them. The start fixes this
# wait, somewhere between 0 and 33.3 ms. Each plan also waits equally long until the joint loop first uses it,
# somewhere between 0 and 1 ms. Its commands are then in force for 100 ms. So at a random moment this has lasted for
# 50 ms, on average. (The loop renews the command in each millisecond, from the same plan. So these 50 ms include the
# half millisecond for which a single command is in force.) So the mean lies between
# $105.2+50 \approx 155$ ms and $155.2+33.3+1 \approx 190$ ms.
#
# </details>
#
# ### Queues
#
# While a reader is busy, samples wait in a queue. In a queue of depth 1, such as the rule *queue* of section 2, a new
# sample replaces the one that waits.

# %%
show("deep_queue")

# %% [markdown]
# What happens in overload if the queue has no limit? Suppose that a sample comes every $T$ and needs the time $C$,
# and that $C$ is longer than $T$. The stage is always busy, so a result comes every $C$. But the sample behind each
# result is only $T$ newer than the sample behind the result before. So from result to result the age grows by $C -
# T$. Per second it grows by $(C - T)/C$ seconds.
#
# The lower row of the chart above, left: a queue with a limit. A reader at 9.7 Hz is slower than the camera, so the
# queue is full, and each further place in the queue makes the data older by one period $T$ of the camera. A reader at
# 33 Hz is faster, so the queue is nearly empty. Right: a queue without a limit. To the right of the dotted line $C$
# is longer than $T$, and the age grows by as many seconds per second as the curve shows.
#
# So a stage in overload needs one of the rules of section 2. In the table a camera stage of 5 ms (0.15 cores) sends
# 30 images per second to a stage that needs 60 ms for each:

# %% tags=["hide-code"]
camera = Stage("camera", 0.005, 1 / 30)
rows = [("rule", "queue depth", "mean age of the newest result [ms]", "cores")]
for rule, depth in (("skip", 1), ("pipelined", 1), ("queue", 1), ("queue", 10)):
    busy = [camera, Stage("slow", 0.060, None, depth, rule)]
    # 54 s are 1620 images and 900 executions of the slow stage: the sampled time has whole cycles.
    run = simulate(busy, (0.0, 0.0), seconds=70.0)
    mean = np.mean(run.age(np.linspace(10.0, 64.0, 200_000, endpoint=False)))
    rows.append(
        (rule, depth if rule == "queue" else "none", f"{1000 * mean:.0f}", f"{load(busy):.2f}")
    )
table(*rows)

# %% [markdown]
# <details><summary>Why section 2 counts a longer wait for <em>queue</em></summary>
#
# Each execution in this table takes exactly 60 ms. Then the waits of the images repeat, and with *queue* their mean
# is $0.4\,T$, where $T$ is the interval between images. If the 60 ms vary a little, the mean wait is $T/2$, as in
# section 2, and the age is 3 ms larger.
#
# The 60 ms are $1.8\,T$. So each time the stage becomes free at another point of the interval between two images.
# After five executions, which last $9\,T$, the pattern begins again. So there are five waits: 0, 0.2, 0.4, 0.6 and
# 0.8 of $T$. Their mean is $0.4\,T$, about 13 ms. If the 60 ms vary a little, all waits up to $T$ occur, and their
# mean is $T/2$.
#
# </details>
#
# `Stage` raises an error if the execution time is above the period and no rule is chosen:

# %% tags=["show-code"]
try:
    Stage("plan", 0.060, 1 / 30)
except ValueError as error:
    print(error)

# %% [markdown]
# ### Jitter
#
# Execution times vary with the load of the computer and with what the camera sees. Suppose that their means stay the
# same. Does jitter then make the data older on average? If a result is late, the result before it stays in force
# longer. If a result is early, it replaces the one before it sooner.

# %%
show("jitter_leaves_the_mean")

# %% [markdown]
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The arm is late.* Send the time stamp of the capture along with the data. When a plan is used
# for the first time, log the age of its image. (Later ages of the same plan would hide the patterns.) Plot these ages
# over at least an hour. What you see, and the likely cause:
#
# * All ages are nearly equal, but different after a restart: locked clocks.
# * The age rises slowly and falls at once, again and again (a sawtooth as high as one period): clocks that drift, and
#   the reader's is too slow (too fast: the age falls slowly and rises at once).
# * All ages are larger than computed, by whole periods of one producer: a full queue.
# * The age grows without end: overload, and a queue without a limit. Or the clocks of two computers drift apart: then
#   only the logged ages grow (or shrink), and every prediction is wrong.
# * The ages are scattered over one period: rates that do not fit together (harmless). Over more: jitter or lost
#   samples.
# * Ages are clearly below the sum of the *shortest* execution times: a late stamp, or clocks with an offset.
#
# </div>
#
# <details><summary>As a table, with a test and a fix for each cause</summary>
#
# <table>
# <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr>
# <tr><td>late by nine periods, and nobody is busy</td> <td>full queue</td> <td>set the depth to 1</td> <td>read the
# newest value</td></tr>
# <tr><td>late after some starts only</td> <td>locked clocks</td> <td>restart ten times</td> <td>start on arrival, or
# set the phase</td></tr>
# <tr><td>slowly later, then suddenly well again</td> <td>two clocks that drift</td> <td>plot an hour of
# ages</td> <td>start on arrival</td></tr>
# <tr><td>later and later</td> <td>overload</td> <td>count waiting samples</td> <td>choose a rule, reduce the
# load</td></tr>
# <tr><td>the log is fresh, the arm is late</td> <td>stamped at publishing</td> <td>move a thing by hand and film
# it</td> <td>keep the capture's stamp</td></tr>
# <tr><td>negative ages</td> <td>clocks with an offset</td> <td>compare both clocks over a round trip</td> <td>PTP, or
# a trigger line</td></tr>
# <tr><td>predictions off to one side</td> <td>clocks with an offset, a late stamp, a delay that was not counted, or an
# acceleration</td> <td>compare both clocks over a round trip, then repeat at constant speed</td> <td>PTP; the capture's
# stamp; count the delay; predict with the acceleration</td></tr>
# </table>
#
# </details>
#
# ## 7 · Exercises
#
# Four functions and a formula. `check` runs your function on random cases. If a result is wrong, it shows the call
# and, if it can, the likely cause. An *edge* is an arrow.

# %%
card("blind_distance")


# %%
def blind_distance(latencies, period, speed):
    """Return how far a robot moves between a measurement and the command that uses it."""
    # The slowest stage alone.
    distance = np.asarray(speed) * np.max(latencies, initial=0.0)
    return distance, distance


check(blind_distance)

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
# Any equivalent form is right. The answer that stands there is a common mistake.
# <span class="kernel-only">Change the text in quotes.</span>

# %%
answer("deep_queue", "d*T")

# %% [markdown]
# ## 8 · What simulation buys
#
# Why simulate at all? The usual answer is a table such as the one in this question:

# %%
predict("gold_plated_table")

# %% [markdown]
# The table comes from an older course that names no source. It does not say what an iteration is, or whose months and
# dollars these are.
#
# <details><summary>The whole table</summary>
#
# | | without simulation | with simulation |
# |---|---|---|
# | first working policy | 6 months | 3 weeks and 2 days |
# | a training run | 50,000 dollars | 200 dollars |
# | iterations a day | 2 or 3 | over 1000 |
# | damages during development | about 12 | none in simulation, 1 on the robot |
# | transfer to the robot | does not apply | 60 to 90 % |
#
# The percentages do not say what they count.
#
# </details>
#
# What you *can* compute is the number of tries per day. On a robot it follows from the duration of a try and of its
# *reset*, which prepares the next try, and from the hours per day in which the robot runs (in the panel 24). In
# simulation it follows from the number of time steps in a try, the computing time of a step (chapter 1), and the
# number of cores.
#
# The panel below shows how many days the tries take. It only counts tries, but a simulated try teaches less about the
# robot. Two values are guesses: a step costs 100 µs, and 2 in 1,000 tries damage the robot. (A step that also renders
# an image costs far more, as in the second preset.) The axes count powers of ten: 3 means 1,000 tries, and $-3$ means
# a thousandth of a day.

# %%
simulation("development")

# %% [markdown]
# <details><summary>More sentences of this kind, and what this course can say about them</summary>
#
# * *"A cached roadmap with lazy checks takes a query from 800 ms to 50 ms."* Chapter 5 measures this comparison on
#   its own worlds, slow queries included. Whose 800 ms these were is not known.
# * *"87 % of first grasps succeed, validated in 10,000 episodes."* Ten thousand simulated episodes tell how certain
#   the *simulated* rate is. The robot's rate is as certain as the number of grasps on the robot makes it.
# * *"One hour spent on fidelity saves ten on the robot."* No data are known. Fidelity saves time only where the
#   simulation left out something that matters.
#
# </details>
#
# You can also compute how certain a success rate is after so many tries. The table shows three experiments with
# nearly the same rate, and for each *Wilson's interval* (chapter 12). If the tries are independent and you repeat an
# experiment 100 times, about 95 of these intervals contain the true rate:

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
# Here is another sentence without a source: *"A policy fell from 94 to 35 % because of 20 ms of delay."* No data are
# known. But you can compute the phase lag. How much is too much depends on the loop: the 90 degrees of section 2 hold
# only for the loop there.

# %% tags=["hide-code"]
table(
    ("frequency at which the arm swings", "phase lag from 20 ms of delay"),
    *(
        (f"{f:g} Hz", f"{np.degrees(cost(0.020, 0.0, bandwidth=f).phase):.1f} degrees")
        for f in (1.0, 5.0, 20.0)
    ),
)

# %% [markdown]
# ## 9 · Frontier: fewer boxes
#
# One learned policy can replace perception and planning (chapter 9). It receives an *observation*, for example an
# image, and returns a **chunk**, the actions for the next few tenths of a second. What happens to the data age?

# %%
predict("one_policy_for_three_boxes")

# %% [markdown]
# The table lists the data age for three intervals between observations. The policy's start triggers the camera, the
# policy needs 80 ms, and the joint loop runs at 1,000 Hz:

# %% tags=["hide-code"]
rows = [("a new chunk every", "mean age [ms]", "bound [ms]")]
for looks in (0.1, 0.4, 0.8):
    policy = [Stage("policy", 0.080, looks), Stage("control", 0.0002, 0.001)]
    one = age(policy)
    rows.append((f"{looks:.1f} s", f"{1000 * one.mean:.0f}", f"{1000 * one.greatest:.0f}"))
table(*rows)

# %% [markdown]
# The age of a command still follows the formula of section 1, with one stage before the joint loop. The robot executes
# a chunk until the next one arrives, so the interval of this stage is the time between two observations. If each
# action is executed at the moment for which it was chosen, its age does harm only where something happens that the
# policy did not foresee.
#
# <details><summary>For how many seconds must the actions of a chunk last?</summary>
#
# At least until the next chunk arrives, one interval later. If the first action is meant for the moment of the
# observation, the actions for the first 80 ms are too late when the chunk arrives, and the robot skips them. Then the
# chunk must last one interval plus 80 ms. After a chunk that is too short, the robot has no action until the next one
# arrives. Zhao and others (RSS 2023) introduced chunks. Where two of them overlap, they average the actions for the
# same moment.
#
# </details>
#
# The formula also applies to a **digital twin**, here a simulation that runs beside the robot and follows its joint
# states. It reads them as control does, so its data have an age, too.
#
# ## 10 · Interview
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** *"I built X, which made Y possible. I tested it by simulation Z and ran it on W."* This is a good
# frame if each of Y and Z has a number that you can defend: what was measured, compared with what, and how often. W
# needs such a number, too, once your work has run on a robot. Say also what your work did *not* do, before somebody
# asks.
#
# </div>
#
# This chapter in that frame, as you could say it after you have solved exercise 2. Your function knows no overload,
# but you can pass it other periods. With *skip* the planner uses every second pose, as if it started on arrival behind
# a camera at 15 Hz: `chain_age([0.045, 0.060, 0.0002], [2/30, 0, 0.001])`. With *queue* the
# periods are $1/30$ s for perception and $0.06$ s for the planner, *pipelined* they are $1/30$ s and 0.

# %% tags=["hide-code"]
table(
    ("", "what you could say"),
    ("X", "I wrote a model of the data age in a picking stack with three stages."),
    (
        "Y",
        f"With it I compared {len(options)} changes before anything was built. (A stage's cores are "
        "its execution time over its interval.) Per additional core, the best of them is "
        "a planner that starts with a fresh pose and skips the poses that come while it is busy. "
        f"This saves {1000 * options[0].gain:.0f} of {1000 * age(CHAIN).mean:.0f} ms, for "
        f"{options[0].load:.1f} more cores.",
    ),
    (
        "Z",
        f"I ran the changed chain {len(ages)} times in the event simulation of a course, with random "
        f"phases. The mean age was {simulated:.1f} ± {spread:.1f} ms (standard error over the runs). "
        f"My model predicts {1000 * age(chain).mean:.1f} ms.",
    ),
    (
        "W",
        "It has not run on a robot yet. There I would send the time stamp of the capture along "
        "with the data.",
    ),
)

# %% [markdown]
# Now answer these questions aloud. Then open *In a minute*. The questions stand in three groups: for a short
# first interview (*screen*), for a senior engineer, and for a *staff* engineer, who leads others.

# %%
interview("role")

# %% [markdown]
# ### Checkpoint
#
# Five questions on this chapter, drawn at random: the number `seed` below decides which.

# %%
checkpoint("role", ["", "", "", "", ""], seed=1)
