# %% [markdown]
# # 0 · The role
#
# *Six boxes turn pictures into motor commands. Answer first<span class="kernel-only">, run the cells</span>, then
# press* Play. About {open minutes} minutes of reading, cards and charts. The folded parts add {folded minutes}
# minutes, the exercises {exercise minutes} minutes.

# %%
from course.cards import predict
from course.simulations import simulation

predict("how_old_is_a_command")

# %% [markdown]
# ![The stack as a graph](attachment:role.stack.png)

# %%
simulation("stack")

# %% [markdown]
# **You will be able to** draw the software of a robot as a graph with a rate, a size and a deadline on every arrow; say
# how old the information behind a command is, before anything is built; find the change that makes it younger; and
# recognise a full queue and two drifting clocks in a log. **Know first:** some Python; averages. Later chapters need
# linear algebra, and now and then a derivative or an expected value, which they explain.
#
# ## How this course works
#
# Each chapter looks at its subject from five sides: concept, design, code, debugging, frontier. Most scenes begin
# with a card: answer first; a click says whether you are right, and **Explanation** says why. A number in the text
# comes from the cell above it, or from a check that `python -m course.derivations 0` runs again. The code is
# `course.role`. These exercises wait in section 7:

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint

badges(0)

# %%
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


def source(*functions):
    """Show functions as they stand in the module."""
    text = "\n\n".join(inspect.getsource(f) for f in functions)
    return Markdown(f"```python\n{text}```")


# %% [markdown]
# ## 1 · Concept: six boxes and a robot

# %%
predict("never_late")

# %% [markdown]
# Click through the boxes above. Each is named by what goes in and what comes out:
#
# * the **simulation engine** takes torques and gives pictures and joint states: it stands for the robot;
# * **middleware** carries messages between programs, and gives each sample a **time stamp**, the moment of its capture;
# * **perception** makes poses of pictures (chapter 7);
# * **planning** makes trajectories of poses (chapter 5);
# * **control** makes torques of trajectories and joint states (chapter 6);
# * **sim-to-real and learning** makes parameters and policies of logs and episodes (chapters 8 and 9).
#
# An arrow carries samples: so many a second, so many bytes each. Rate times size is its **bandwidth**. With a
# **hard deadline** a late sample is a failure; with a **soft deadline** it is only worth less.

# %%
for edge in sorted(STACK, key=lambda e: -e.bandwidth)[:9]:
    print(
        f"{edge.source:>10} -> {edge.target:<10} {edge.flow:<24} {edge.rate:6g} Hz "
        f"{edge.bandwidth / 1e6:8.3f} MB/s  {edge.deadline}"
    )
role.check_stack(STACK)
print("every box has both ends; every loop runs through the robot, or what stands for it")

# %% [markdown]
# Pictures are the bytes, joint states the messages, and one loop has hard deadlines. A loop among boxes that passes no
# robot would feed on its own output; `check_stack` refuses one.
#
# ### How old is a command?
#
# The motor command of this moment rests on a trajectory, that on a pose, that on a picture. **Data age** is the time
# from the capture of that picture to now. A stage has an **execution time** $C$, from its start to its result, and a
# clock with a **period** $T$. A clock takes what lies there: the newest result of the stage before.

# %%
show("chain_age")

# %%
parts, names = [], []
for stage, wait in zip(CHAIN, age(CHAIN).waits, strict=True):
    parts += [stage.execution, wait]
    names += [
        f"{stage.name} works",
        f"its result waits for {'its reader' if stage.period > 0.001 else 'the next'}",
    ]
ends = 1000 * np.cumsum(parts)
figure_, axes = plt.subplots(figsize=(8, 2.6), layout="constrained")
for k, (part, end) in enumerate(zip(parts, ends, strict=True)):
    _ = axes.barh(k, 1000 * part, left=end - 1000 * part, color=["#0072b2", "#d55e00"][k % 2])
    _ = axes.text(end + 2, k, f"{1000 * part:.1f}", va="center")
_ = axes.set(yticks=range(6), yticklabels=names, xlabel="mean age [ms]", xlim=(0, 190))
axes.invert_yaxis()
plt.show()
report = age(CHAIN)
print(
    f"least {1000 * report.least:.1f} ms, mean {1000 * report.mean:.1f}, below {1000 * report.greatest:.1f}"
)
print(f"at 0.3 m/s: {1000 * cost(report, 0.3).held:.0f} mm")

# %% [markdown]
# That is the worked example of this course, for clocks that run independently: what moves at 0.3 m/s has gone that far
# since the picture was taken. Clocks that are locked to each other, as after three of the fixes in section 2, have
# other means.
#
# <details><summary>Derive: least, mean and bound</summary>
#
# Go backwards from now. The command in force came at some time in the last $T_n$, the last stage's interval. Its phase
# is independent of now, so this *hold* is spread evenly from $0$ to $T_n$. The stage began $C_n$ earlier and read the
# newest result of stage $n-1$; how long that had been lying there is spread evenly from $0$ to $T_{n-1}$, and so on to
# the capture.
#
# A sum of $C_i$ and of independent even spreads: between $\sum C$ and $\sum C+\sum T$, in the mean
# $\sum C+\tfrac12\sum T$, with variance $\tfrac1{12}\sum T^2$. The bound is that of Davare and others (DAC 2007), there
# with response times of shared processors in place of $C$; Dürr and others (2019) sharpened it for sporadic tasks.
#
# </details>
#
# ### Whose period?

# %%
show("polling_makes_fresh")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Information is as old as the work it took *and the times it lay there*. It lies for half of the
# interval at which it is made, and the last command for half of the interval at which it is renewed.
#
# </div>
#
# ### Looking ahead
#
# **Reaction time** looks the other way: something happens; how long until a command rests on a picture taken after it?
# The event first waits for a capture. At each boundary it is then the *reader's* period that counts. So two figures?
# A run with **jitter**, executions now short, now long, and with lost samples:

# %%
show("reaction_is_age")

# %% [markdown]
# For maxima this was shown for nearly any scheduling by Günzel and others (ECRTS 2023). So log the age, which is easy,
# and require the reaction, which is what people mean.
#
# ## 2 · Design: where the time goes, and what it buys
#
# A **latency budget** gives each edge a share of the age that a task can bear. It is spent along the **critical path**,
# the slowest way from sensor to motor: what is saved beside it is saved for nothing.

# %%
predict("where_to_spend")

# %% [markdown]
# A stage that starts **on arrival** of its input has no clock, and waits for nothing; a chain of such stages keeps only
# one wait, that of the sensor's clock. If its execution is longer than the interval, that is **overload**: always busy.
# **Utilisation** is the share of a core that a stage keeps busy, execution over interval. **Pipelined** workers begin a
# new sample before the last is done: the interval shrinks, what one sample takes does not.
#
# A change that breaks a hard deadline is not offered: a joint loop that waits for plans would be silent for a tenth of
# a second.

# %%
print(
    f"now {1000 * report.mean:.1f} ms in the mean, {load(CHAIN):.2f} cores busy, "
    f"hard deadlines missed: {len(role.missed(CHAIN))}"
)
for option in spend(CHAIN):
    print(
        f"{option.stage:<11} {option.change:<15} saves {1000 * option.gain:5.2f} ms "
        f"for {option.load:+.2f} cores"
    )

# %% [markdown]
# What is a millisecond worth? With speed $v$ a value that is used as it came is $vA$ behind. Carried on at constant
# velocity over its *known* age it is $\tfrac12 aA^2$ behind. If the time of capture is lost, one can carry it on by the
# mean age only, and the spread of the age comes on top as error. A loop through the chain loses the phase $2\pi fA$.

# %%
speeds = np.linspace(0.0, 1.0, 50)
figure_, axes = plt.subplots(figsize=(8, 3.0), layout="constrained")
for name, row, style in (
    ("as it came", 0, "-"),
    ("predicted, a = 1 m/s²", 1, "--"),
    ("on top of it without stamps, rms", 2, ":"),
):
    _ = axes.plot(speeds, [1000 * cost(report, v, 1.0)[row] for v in speeds], style, label=name)
_ = axes.set(xlabel="speed [m/s]", ylabel="error [mm]")
_ = axes.legend()
plt.show()
paid = cost(report, 0.3, 1.0, bandwidth=1.0)
print(
    f"at 0.3 m/s: {1000 * paid.held:.0f} mm as it came, {1000 * paid.predicted:.0f} mm predicted, "
    f"and {1000 * paid.unstamped:.0f} mm rms on top without stamps"
)
print(f"a loop of 1 Hz through the camera loses {np.degrees(paid.phase):.0f} degrees")

# %% [markdown]
# **What one builds with.** The boxes have names in the field. A **behaviour tree**, whose nodes succeed, fail or go on,
# says what to do next, and after a failure. What is read by its newest value, and how old it may be, you decide.
#
# <details><summary>The options, with year and source</summary>
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
# ## 3 · Code
#
# A reader with a queue in three lines; and the two definitions, as the module has them. A chain is data: change it.

# %%
source(role.read, role.Trace.age, role.Trace.reaction)

# %%
chain = [
    Stage("see", 0.045, 1 / 30, overload="pipelined"),
    Stage("plan", 0.060),
    Stage("act", 0.0002, 0.001),
]
chain[1] = replace(chain[1], overload="queue")  # begins when it is done and a pose is there
rng = np.random.default_rng(1)
ages = [
    simulate(chain, rng.random(3), seconds=2.0).age(rng.uniform(1.0, 2.0, 20)) for _ in range(300)
]
print(
    f"predicted {1000 * age(chain).mean:.1f} ms, 300 simulated starts {1000 * np.mean(ages):.1f} ms"
)

# %% [markdown]
# Four milliseconds apart, and not by chance. 60 ms are to a thirtieth of a second as 9 to 5, and the planner's first
# start is set by a pose: the two are locked, and only five waits occur.
#
# ## 4 · The simulation in full
#
# Back to the first screen. A dot is a picture's content, its number its age. In a box it is worked on, on an arrow it
# lies. Bars are all ages of forty seconds, dashed lines the closed form. Take the presets in turn, and before each say
# what the bars will do. The third of them:

# %%
predict("queue_of_ten")

# %% [markdown]
# ## 5 · Speed against accuracy
#
# The closed form against event simulation with random phases, on the chapter's chain. Even phases, a lattice of them,
# are the truth.
#
# ![Error of the mean age against time](../docs/charts/age_precision.png)

# %%
figures(read("age_precision"), "closed form", "1000 random", summary="Times and errors")

# %% [markdown]
# A thousand starts are needed for half a millisecond; but they show the run of *this* start.
# Use the formula to design, and events for what breaks its assumptions.
#
# ## 6 · Debug: where it fails
#
# ### Clocks that know one another

# %%
show("long_run_mean")

# %%
show("same_rate_in_step")

# %% [markdown]
# ![Locked clocks, drifting clocks, queues, too much work](../docs/charts/age_limits.png)

# %%
figures(read("age_limits"), "10 Hz", "drift", "reader", "overload", summary="All figures")

# %% [markdown]
# ### Queues
#
# **Queue depth** is how many samples wait for a reader that has no time; what does not fit is dropped, oldest first.

# %%
show("deep_queue")

# %% [markdown]
# Overload needs a rule: skip, work in parallel, or drop; an endless queue is none. `Stage` refuses an execution above
# its period unless a rule is named.

# %%
camera = Stage("camera", 0.005, 1 / 30)
for rule, depth in (("skip", 1), ("pipelined", 1), ("queue", 1), ("queue", 10)):
    busy = [camera, Stage("slow", 0.060, None, depth, rule)]
    print(
        f"60 ms a picture, {rule:<9} depth {depth:>2}: mean age {1000 * age(busy).mean:5.0f} ms, {load(busy):.2f} cores"
    )
try:
    Stage("slow", 0.060, 1 / 30)
except ValueError as refusal:
    print(str(refusal).replace(", or more", ",\n  or more"))

# %% [markdown]
# ### Jitter
#
# Executions vary, with load and with what is seen. What becomes of the mean?

# %%
show("jitter_leaves_the_mean")

# %% [markdown]
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The arm is late.* Log the capture stamp with every command and plot the age. A constant: add up
# executions and half intervals. A jump by whole periods at one edge: a queue. A slope with jumps: two clocks. Growth:
# overload. Spread without a pattern: load. Ages that are too good: somebody stamps at publishing.
#
# </div>
#
# <details><summary>The same as a table: symptom, cause, test, fix</summary>
#
# <table>
# <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr>
# <tr><td>late by nine periods, nobody busy</td> <td>full queue</td> <td>depth 1</td> <td>newest value</td></tr>
# <tr><td>late after some starts only</td> <td>locked clocks</td> <td>restart ten times</td> <td>start on arrival, or
# set the phase</td></tr>
# <tr><td>slowly later, then at once well</td> <td>beat of two clocks</td> <td>ten minutes of ages</td> <td>start on
# arrival</td></tr>
# <tr><td>later and later</td> <td>overload</td> <td>count what is dropped</td> <td>a rule, less load</td></tr>
# <tr><td>log fresh, arm late</td> <td>stamped at publishing</td> <td>move a thing by hand, film it</td> <td>carry the
# capture's stamp</td></tr>
# </table>
#
# </details>
#
# ## 7 · Exercises

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
# ### Silent-bug hunt

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
# ### Formulas
#
# Checked symbolically: any equivalent form is right. <span class="kernel-only">Change the text.</span>

# %%
answer("deep_queue", "d*T")

# %% [markdown]
# ## 8 · What simulation buys

# %%
predict("gold_plated_table")

# %% [markdown]
# A table like this one is shown in many courses. No source is known for it; take it as an illustration of what people
# hope for, and repeat none of its cells:
#
# | | without simulation | with simulation |
# |---|---|---|
# | first working policy | 6 months | 3 weeks and 2 days |
# | a training run | 50,000 dollars | 200 dollars |
# | iterations a day | 2 or 3 | over 1000 |
# | damages during development | about 12 | none in simulation, 1 on the robot |
# | transfer to the robot | not asked | 60 to 90 % |
#
# What you *can* compute is below: tries a day from seconds a try, steps a second and the cost of a step, the last
# measured in chapter 1. What breaks on the robot grows with the tries made there.

# %%
simulation("development")

# %% [markdown]
# <details><summary>Other sentences of the kind, and what this course can say to them</summary>
#
# * *A cached roadmap with lazy checks takes a query from 800 ms to 50.* Chapter 5 measures that comparison on its own
#   worlds, tail included; whose 800 ms it was is not known.
# * *A policy fell from 94 to 35 %, because of 20 ms of delay.* An anecdote without data. What 20 ms cost a loop is
#   below; chapter 8 measures it on an arm.
# * *87 % of first grasps, validated in 10,000 episodes.* Ten thousand simulated episodes say how sure the *simulated*
#   share is. The robot's share is as sure as the number of grasps on the robot.
# * *One hour in fidelity saves ten on the robot.* No data known. It saves something only in what was left out.
#
# </details>

# %%
for tried in (15, 100, 10_000):
    low, high = wilson(0.87 * tried, tried)
    print(f"0.87 of {tried:>6} grasps: between {low:.3f} and {high:.3f} with 95 % confidence")
for bandwidth in (1.0, 5.0, 20.0):
    lost = np.degrees(cost(0.020, 0.0, bandwidth=bandwidth).phase)
    print(f"20 ms in a loop of {bandwidth:4g} Hz: {lost:5.1f} degrees of phase")

# %% [markdown]
# ## 9 · Frontier: fewer boxes

# %%
predict("one_policy_for_three_boxes")

# %%
for looks in (0.1, 0.4, 0.8):
    policy = [Stage("policy", 0.080, looks), Stage("control", 0.0002, 0.001)]
    report = age(policy)
    print(
        f"a look every {looks:.1f} s: age {1000 * report.mean:.0f} ms in the mean, below {1000 * report.greatest:.0f}"
    )

# %% [markdown]
# A learned policy merges perception and planning (chapter 9). Inside, the arrows are gone: no pose to look at, no path
# to check. The graph keeps its ends, and the age between them is that of one stage. Action chunks (Zhao and others,
# RSS 2023) make its interval the time between two looks. A **digital twin**, a simulation that runs beside the robot on
# its joint states, is one more reader of an edge, with an age of its own.
#
# ## 10 · Interview
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** *I built X, which made Y possible, tested by simulation Z, run on W.* A frame, if each letter holds
# a figure that you can defend: what was measured, against what, how often. Say what it did *not* do before you are
# asked.
#
# </div>

# %%
print("X: an age model of a picking stack, three stages, checked by event simulation;")
print(
    f"Y: it named the change worth {1000 * max(o.gain for o in spend(CHAIN)):.0f} ms of "
    f"{1000 * age(CHAIN).mean:.0f} before anything was built;"
)
print(
    f"Z: {figure('chain_age', 'simulated_ms'):.1f} ms simulated, "
    f"{figure('chain_age', 'mean_ms'):.1f} predicted;"
)
print("W: not yet on hardware; there the capture stamps would be the test.")

# %% [markdown]
# Answer aloud, then open: first what one says in a minute, then the whole of it, then what comes next.

# %%
interview("role")

# %% [markdown]
# ### Checkpoint
#
# Three formulas that are not on this page. The gate opens when all are right.

# %%
checkpoint(
    "role",
    queue_carries_overload="",
    losses_add_up="",
    rate_is_bandwidth="",
)
