# %% [markdown]
# # 8 · From simulation to the real robot
#
# *A controller works in its simulator and fails more often on the real arm. What is lost, and what brings it back?*
# About {open minutes} minutes of reading, cards and charts. The folded parts add {folded minutes} minutes, the
# exercises {exercise minutes} minutes.
#
# A two-link arm reaches for a point. A PID controller drives each joint. Its six gains, three for each joint, are the
# arm's **policy**: they decide how it reacts to what it measures. Its **success rate** is the share of reaches that
# succeed: the hand stays within 2 cm of the target for the whole last 0.1 s.

# %% tags=["hide-code"]
import matplotlib.pyplot as plt
import numpy as np

from course.cards import predict
from course.sim_to_real.plants import DIRECTION, HOLD, RADIUS, SECONDS, tip
from course.simulations import simulation

figure_, axis = plt.subplots(figsize=(8.5, 3.2), layout="constrained")
for q, line_style in (
    (np.array([0.25, 1.1]), {"lw": 9}),
    (np.array([0.75, 0.75]), {"lw": 2, "ls": "--"}),
):
    elbow, hand = 0.5 * np.array([np.cos(q[0]), np.sin(q[0])]), tip(q)
    _ = axis.plot([0, elbow[0], hand[0]], [0, elbow[1], hand[1]], color="#3f51b5", **line_style)
    if line_style["lw"] == 9:
        _ = axis.plot([0, elbow[0]], [0, elbow[1]], "o", color="#1a237e", ms=13)
        notes = (
            (hand, (0.95, 0.66), f"load: + {DIRECTION['payload']} kg, links + 10 %"),
            (elbow, (0.95, 0.32), f"friction: {DIRECTION['coulomb']} N m dry, less viscous"),
            (elbow, (0.95, 0.1), f"encoder: {1e3 * DIRECTION['bias']:.0f} mrad off, noise"),
            ((0, 0), (-1.25, 0.28), f"motor: {-100 * DIRECTION['torque']:.0f} % weaker"),
            ((0, 0), (-1.25, 0.02), "delay of the command: set separately"),
        )
        for point, text, words in notes:
            arrow = {"arrowstyle": "-", "color": "#c62828", "lw": 0.8}
            _ = axis.annotate(words, point, text, color="#c62828", va="center", arrowprops=arrow)
goal = tip(np.array([0.75, 0.75]))
axis.add_patch(plt.Circle(goal, RADIUS, color="#2e7d32"))
words = f"target: within {100 * RADIUS:.0f} cm\nin the last {HOLD} s of {SECONDS} s"
_ = axis.annotate(words, goal, (-0.75, 0.72), color="#2e7d32", arrowprops={"arrowstyle": "->"})
_ = axis.set(xlim=(-1.3, 2.0), ylim=(-0.12, 0.95), aspect="equal")
_ = axis.set_title(
    "one reach (dashed: arrived), and how simulator and real arm differ at gap 1", fontsize=10
)
axis.axis("off")
plt.show()

# %%
predict("mend_the_delay")

# %% [markdown]
# ![One policy, two arms](attachment:sim_to_real.arms.png)

# %%
simulation("arms")

# %% [markdown]
# The left arm is the simulated arm on which the gains were tuned. The right arm plays the real one; it is simulated
# too, so we know its true parameters. The **reality gap** is the mismatch between simulator and robot. The slider *gap*
# sets how much load, friction, motor and encoder differ: at 1 as much as in the first picture, at 0 not at all. The
# delay of the commands has its own slider, so at gap 0 the arms can still differ. *DR Range* sets how widely the
# simulated arms varied while the gains were tuned (section 3).
#
# Under the arms, *longest stable delay* is a computed limit, with one joint locked. The moving arm begins to oscillate
# earlier (section 1).
#
# <details><summary>The other numbers, and the buttons</summary>
#
# Each button is a preset: a prepared setting. *Costliest difference* is the one that would cost the most successes if
# it were alone, at the present settings. *This reach* reports how the reach that you see ended (*late*: the hand
# arrived too late). *Delay to spare* is the longest stable delay minus the present one. *Longest stable delay* is
# computed for each joint with the other joint locked; the smaller value counts. It depends on the gains and on the
# load. *Gain margin* is the factor by which you can raise all gains before a joint becomes unstable.
#
# </details>
#
# **You will be able to** measure what a controller loses between simulator and robot; say why correcting one difference
# can make things worse; find a robot's parameters from a log and judge whether to believe them; and choose between
# measuring parameters and training on many simulators. **Know first:** chapter 4's two-link arm, chapter 6's feedback
# loops, least squares.
#
# `python -m course.derivations 8` repeats the checks behind the numbers. Section 8 has these exercises:

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint, your_robot

badges(8)

# %% tags=["hide-code"]
import inspect
import re
import textwrap
from dataclasses import replace
from unittest import mock

from IPython.display import Markdown

from course import sim_to_real
from course.cards import interview
from course.charts import read, stored
from course.charts.sim_to_real import logs
from course.derivations import more_claims, show
from course.derivations.sim_to_real.signals import (
    estimates,
    over_the_bound,
    scattered,
    two_kinds,
)
from course.measure.success import trials, wilson
from course.page_records import from_record
from course.sim_to_real import (
    Log,
    Plants,
    Process,
    Ranges,
    excitation,
    fit,
    grid,
    measurement_lag,
    mended,
    only,
    plants,
    real,
    recorded,
    rollouts,
    shaped,
    tasks,
    transfer,
    tune,
    value_iteration,
)
from course.sim_to_real.identify import arm
from course.sim_to_real.plants import watch
from course.sim_to_real.signals import SpeedLoop, weighted_covariance

BLUE, RED, GREEN, GREY = "#3f51b5", "#c62828", "#2e7d32", "#757575"


def table(*rows):
    """Return rows of text as a table; the first one is the head."""
    lines = [f"| {' | '.join(map(str, row))} |" for row in rows]
    return Markdown("\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]))


def curves(chart, panel, axis, rows):
    """Return curves of a stored chart as a table: values along its axis, a row for each curve."""
    lines = {one.label: one for one in stored(chart)[panel].series}
    x = lines[next(iter(rows))].x
    head = [axis, *(f"{value:g}" for value in x)]
    return table(head, *([text, *(f"{y:.2f}" for y in lines[n].y)] for n, text in rows.items()))


def diagram(size, boxes, arrows=(), colour="#e8eaf6"):
    """Draw boxes of text, each (x, y, text), and arrows between them, each (from, to, text)."""
    _, axis = plt.subplots(figsize=size, layout="constrained")
    style = {"boxstyle": "round", "fc": colour, "ec": BLUE}
    drawn = [
        axis.text(x, y, text, ha="center", va="center", fontsize=9, bbox=style)
        for x, y, text in boxes
    ]
    for start, end, text in arrows:
        (x, y), (u, v) = boxes[start][:2], boxes[end][:2]
        patches = {"patchA": drawn[start].get_bbox_patch(), "patchB": drawn[end].get_bbox_patch()}
        line = {"arrowstyle": "->", "shrinkA": 2, "shrinkB": 2, "color": GREY, **patches}
        _ = axis.annotate("", (u, v), (x, y), arrowprops=line)
        _ = axis.text((x + u) / 2, (y + v) / 2, text, fontsize=8, ha="center", va="bottom")
    xs, ys = [box[0] for box in boxes], [box[1] for box in boxes]
    _ = axis.set(xlim=(min(xs) - 0.7, max(xs) + 0.7), ylim=(min(ys) - 0.5, max(ys) + 0.5))
    axis.axis("off")
    return axis


# %% [markdown]
# ## 1 · Concept: the reality gap
#
# ### Measuring what is lost
#
# We measure the reality gap by the success that a controller loses.
#
# The task is the reach in the first drawing, an **episode** of 0.9 s. Start and target are sampled at random, and every
# controller gets the same ones.
#
# The PID law of a joint has a proportional gain $k_p$, an integral gain $k_i$ and a derivative gain $k_d$. A search
# tunes the gains. It samples sets of gains, runs each set on simulated reaches, keeps the best sets, and samples new
# ones near those. Using the gains on the robot without any change is called **zero-shot transfer**.

# %% tags=["hide-code"]
axis = diagram(
    (8.5, 1.3),
    (
        (0, 0, "simulator\nwith wrong parameters"),
        (2.3, 0, "search tunes\nsix gains"),
        (4.2, 0, "real arm:\nsame gains"),
        (6.4, 0, "compare the\nsuccess rates"),
    ),
    ((0, 1, ""), (1, 2, ""), (2, 3, "")),
)
plt.show()

# %% [markdown]
# A success rate from few trials is uncertain, so each one gets a 95 % confidence interval (Wilson's, which stays usable
# when nearly all trials succeed or nearly all fail).
#
# ### Five differences, one at a time
#
# The real arm differs from the simulator in load (a payload, and heavier links), friction, motor, encoder and delay. We
# take the simulator's arm and give it *one* of the differences, as large as at gap 1 (the delay: 10 ms). Then we run
# gains that were tuned without this difference.
#
# Feedback corrects the error that it *measures*. Dry friction takes a fixed amount off the torque. The motor that is
# 20 % weaker delivers 80 % of each commanded torque. In both cases the measured error grows a little, and the PID law
# commands more torque, up to the motor's limit. A heavy load slows down every response of the arm. A delay makes
# feedback act on an old measurement. And feedback can't see a constant offset of the encoder: the true angle stays
# wrong by this offset.
#
# One difference can also make another one cost more, or less. Take the motor: how often does a light arm need its full
# torque, and how often a heavy one?

# %%
predict("which_part_matters")

# %% tags=["hide-code"]
far_end, posed, n = real(1.0, 0.01), tasks(2000, 41), 2000
tuned = recorded()["range"][0, 0]
figure_, axis = plt.subplots(figsize=(6.5, 2.4), layout="constrained")
rows = [("difference", "gains tuned without it", "95 % interval", "gains tuned with it")]
for row, part in enumerate((*transfer.PARTS, "all")):
    one = far_end if part == "all" else mended(far_end, (part,))
    again = tune(only(one), 0, rounds=12, samples=32, elites=8, episodes=24).gains
    rates = [rollouts(one, gains, posed).rate for gains in (tuned, again)]
    low, high = wilson(n * rates[0], n)
    rows.append((part, f"{rates[0]:.3f}", f"{low:.3f} to {high:.3f}", f"{rates[1]:.3f}"))
    _ = axis.plot(rates, [row, row], color="grey", zorder=0)
    for k, (name, mark) in enumerate((("without it", "o"), ("with it", "s"))):
        _ = axis.plot(rates[k], row, mark, color=(RED, GREEN)[k], label=name * (row == 0))
_ = axis.set(yticks=range(6), yticklabels=[*transfer.PARTS, "all five"], xlim=(0, 1.02))
_ = axis.set(xlabel="success rate on the arm with this difference")
axis.invert_yaxis()
_ = axis.legend(fontsize=8, title="gains tuned")
plt.show()
table(*rows)

# %% [markdown]
# Load and delay cost most, the motor a little, friction and encoder almost nothing. Gains that were tuned on the arm on
# which they run (green squares) recover most of what was lost.
#
# The next table puts several differences into one arm. Both tables use the gains of one search. Two more searches,
# started from other random numbers, find other gains. The success rates of the three searches (printed below) differ by
# more than an interval is wide: an interval covers the luck in the trials, not the luck in a search. The last column
# counts the searches in which the losses together exceed their sum.

# %% tags=["hide-code"]
head = ("arm", "differences", "costliest alone", "separate losses, added", "lost together")
rows = [(*head, "more than the sum")]
three = recorded()["range"][0].T


def lost_together(case):
    """Return the row of a gap, a delay and the differences that an arm has."""
    gap, delay, parts = case
    real_arm = real(gap, delay)
    alone = np.array([1 - rollouts(mended(real_arm, (one,)), three, posed).rate for one in parts])
    lost = 1 - rollouts(mended(real_arm, parts), three, posed).rate
    names = "all five" if len(parts) == 5 else " and ".join(parts)
    costliest = f"{list(parts)[alone[:, 0].argmax()]}: {alone[:, 0].max():.3f}"
    numbers = (costliest, f"{alone[:, 0].sum():.3f}", f"{lost[0]:.3f}")
    more = f"{np.sum(lost > alone.sum(axis=0))} of 3"
    return f"gap {gap:g}, {1e3 * delay:.0f} ms", names, *numbers, more


several = (
    (1.0, 0.01, transfer.PARTS),
    (1.0, 0.01, ("load", "motor")),
    (1.0, 0.01, ("load", "delay")),
    (1.0, 0.01, ("load", "friction")),
    (0.5, 0.01, transfer.PARTS),
    (0.3, 0.02, transfer.PARTS),
    (0.3, 0.02, ("load", "delay")),
)
rows += from_record("sim_to_real.lost_together", lost_together, several)
searches = rollouts(far_end, three, posed).rate
print("success of three searches on the arm with all five differences:", end=" ")
print(", ".join(f"{rate:.2f}" for rate in searches))
table(*rows)

# %% [markdown]
# At gap 1 all five together cost more than their separate losses added up. The reason is the pair of load and motor: a
# heavy arm needs the torque that the weaker motor lacks. The next three rows cost a little less than their sums.
#
# The last two rows (gap 0.3, 20 ms) show the opposite. There the delay alone makes almost every reach fail. Load and
# delay *together* cost much less than that: the load slows down the loop, and a slower loop tolerates a later command.
# So losses measured one at a time don't tell you what the differences cost together.
#
# <details><summary>On a real robot you start from symptoms: a table</summary>
#
# <table>
# <tr><th>gap</th> <th>what differs</th> <th>what you observe</th> <th>on this arm</th> <th>remedy</th></tr>
# <tr><td>dynamics</td> <td>mass, friction, motor, backlash (free play in a gear)</td> <td>lags, overshoots, stops
# short</td> <td><i>load, friction, motor</i></td> <td>identify the parameters, then randomise what is still
# uncertain</td></tr>
# <tr><td>timing</td> <td>delayed commands or measurements</td> <td>oscillation, sooner with high gains</td>
# <td><i>delay</i></td> <td>measure the delay; lower the gains or predict</td></tr>
# <tr><td>sensing</td> <td>offset, noise, missing samples</td> <td>a constant error; a motor that hums</td>
# <td><i>encoder</i></td> <td>calibrate, filter, add the same errors in training</td></tr>
# <tr><td>perception</td> <td>images unlike rendered ones; camera pose</td> <td>good motion to the wrong position</td>
# <td>chapter 7; the camera in section 7</td> <td>calibrate the camera, randomise the rendering, estimate the pose
# with a separate network</td></tr>
# </table>
#
# </details>
#
# ### Delay and the delay margin
#
# If a correction arrives late, the joint has already moved on, and the correction pushes in a direction that was right
# a moment ago. With small gains little happens in that time. With large gains the joint overshoots, the next late
# correction overshoots further, and the loop oscillates.
#
# The **delay margin** is the smallest delay that makes a loop unstable (in the simulation: *longest stable delay*).
# Chapter 6 derives it: $\tau_\text{max} = \varphi_m/\omega_c$, the phase margin over the crossover frequency. Here
# higher gains raise $\omega_c$, and $\varphi_m$ doesn't make up for it. So they shorten the delay margin.

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(6.5, 2.2), layout="constrained")
reach = tasks(1, 3)
for delay, colour in ((0.0, GREEN), (0.016, BLUE), (0.028, RED)):
    run = watch(Plants(delay=delay), tuned, reach)
    away = 100 * np.linalg.norm(tip(run.measured[:, 0]) - reach.goal, axis=0)
    _ = axis.plot(run.times, away, color=colour, label=f"{1e3 * delay:.0f} ms late")
_ = axis.axhspan(0, 100 * RADIUS, color=GREEN, alpha=0.4, label="target")
_ = axis.set(xlabel="time [s]", ylabel="distance to target [cm]", ylim=(0, None))
_ = axis.legend(fontsize=8)
_ = axis.set_title("the same reach and gains at three delays", fontsize=9)
plt.show()

# %% [markdown]
# Without delay the hand overshoots once and settles. At the two delays it doesn't settle within the 0.9 s.

# %%
predict("gains_and_a_late_command")

# %% [markdown]
# In the left panel below, one factor multiplies all gains (those tuned without delay). The circles show the delay at
# which half of the reaches fail; in the blue area 10 to 90 % fail. The other two curves are computed delay margins, as
# if the motors had no torque limit.
#
# <details><summary>Why a free joint 1 shortens the limit</summary>
#
# A free joint 1 gives way, so joint 2 moves a smaller inertia. The same gains then accelerate it faster, and a faster
# loop tolerates less delay. The effect is strongest when the arm is stretched, so stretched reaches fail first.
#
# </details>
#
# The right panel shows success over the delay, for gains tuned on one arm (*no range*) and on many arms whose delay
# lies between 0 and 30 ms (*range 1*, section 3). For *MuJoCo* the arm runs in that physics engine, not in the course's
# own model. The coloured areas are 95 % intervals. The vertical lines are the delay margins of joint 2 with joint 1
# locked. With these gains half of the reaches fail at a shorter delay.
#
# ![Delay at which reaches fail, against the gains, and success against the delay](../docs/charts/late_commands.png)

# %% tags=["hide-code"]
for name, k in (("no range", 0), ("range 1", 10)):
    kp = recorded()["range"][k][:, [0, 3]].mean(axis=0)
    means = f"{kp[0]:.0f} and {kp[1]:.0f} N m/rad (means of three searches)"
    print(f"{name}: gain kp of joints 1 and 2 {means}")
curves(
    "late_commands",
    1,
    "success at a delay [ms] of",
    {
        "no range": "no range",
        "no range, MuJoCo": "no range, MuJoCo",
        "range 1": "range 1",
        "range 1, MuJoCo": "range 1, MuJoCo",
    },
)

# %% [markdown]
# In each row the success rate falls slowly at first and then collapses. In a simulator without delay and noise, higher
# gains reach the target sooner, so the search raises the gains. The gains *range 1* were tuned with delays. They are
# lower (lines above the table), so they tolerate a later command.
#
# At both ends of the left panel it isn't the delay margin that decides. With much lower gains the arm is too slow to
# arrive in time. With high gains reaches succeed at delays beyond both computed margins: the motors' torque limit stops
# the growing oscillation, so the hand only trembles.

# %% tags=["hide-code"]
with mock.patch.object(plants, "ARM", replace(plants.ARM, torques=(600.0, 300.0))):
    delays = np.linspace(0.0, 0.03, 16)
    failing = [1 - rollouts(Plants(delay=x), 1.6 * tuned, tasks(200, 41)).rate for x in delays]
without = 1e3 * np.interp(0.5, failing, delays)
failing = [1 - rollouts(Plants(delay=x), 1.6 * tuned, tasks(200, 41)).rate for x in delays]
limited = 1e3 * np.interp(0.5, failing, delays)
print(f"gains x 1.6: half of the reaches fail at {limited:.1f} ms;")
print(f"with motors of a hundred times the torque at {without:.1f} ms")

# %% [markdown]
# Without the torque limit, half of the reaches fail even before the limit with both joints free (diamonds, computed for
# an elbow bent by 1.6 rad; a straighter arm tolerates less).

# %%
show("late_command")

# %% [markdown]
# ## 2 · Concept: system identification
#
# **System identification** finds a robot's parameters from recorded motion. You send known torques, record the angles,
# and look for the parameters that explain them.
#
# ### The regression that interviewers ask for
#
# The equations of motion of an arm are nonlinear in the angles. But they are *linear* in the inertial parameters and in
# the coefficients of viscous friction:
#
# $$\boxed{\;\tau = Y(q, \dot q, \ddot q)\,\theta\;}$$
#
# Here $q$ holds the joint angles, $\tau$ the joint torques and $\theta$ the unknown parameters. The matrix $Y$, the
# **regressor**, depends on the motion alone.
#
# Our arm moves in a horizontal plane. With the elbow at a right angle, its inertia about joint 1 is $a$. At the elbow
# angle $q_2$ it is $a + 2b\cos q_2$, so $b$ says how much the elbow matters. The inertia of link 2 about joint 2 is
# $d$. The viscous frictions of the joints are $c_1$ and $c_2$. For short, let $c = \cos q_2$ and $s = \sin q_2$. Then
#
# $$Y = \begin{pmatrix}
# \ddot q_1 & c\,(2\ddot q_1 + \ddot q_2) - s\,(2\dot q_1\dot q_2 + \dot q_2^2) & \ddot q_2 & \dot q_1 & 0 \\
# 0 & c\,\ddot q_1 + s\,\dot q_1^2 & \ddot q_1 + \ddot q_2 & 0 & \dot q_2
# \end{pmatrix}, \qquad
# \theta = \begin{pmatrix} a \\ b \\ d \\ c_1 \\ c_2 \end{pmatrix} .$$
#
# <details><summary>More on the five parameters</summary>
#
# $b$ couples the two links: an acceleration of one needs a torque at the other. For a uniform link 2 it is
# $\tfrac12 m_2 l_1 l_2$, with its mass $m_2$ and the lengths $l_1$, $l_2$ of the links. A viscous friction is a torque
# for each unit of speed.
#
# </details>
#
# Write the two rows of every sample below each other. A log of 1,000 samples then has 2,000 equations for five
# unknowns. Least squares solves them: $\hat\theta = (Y^\mathsf{T}Y)^{-1}Y^\mathsf{T}\tau$.

# %% tags=["hide-code"]
log = logs.record()  # two seconds of two sines on each joint, 1 mrad of noise
quiet = logs.record(noise=0.0)
speed = np.gradient(quiet.measured, quiet.dt, axis=1)
rows = np.arange(50, 950, 75)
acceleration = np.gradient(speed, quiet.dt, axis=1)
Y = plants.ARM.regressor(quiet.measured[:, rows], speed[:, rows], acceleration[:, rows])
Y = Y.transpose(2, 0, 1).reshape(-1, 5)
theta = np.array([list(logs.TRUTH.values())]).T
figure_, axes = plt.subplots(1, 3, figsize=(6.5, 3.2), layout="constrained", width_ratios=(1, 5, 1))
for axis, block, name in zip(
    axes, (Y @ theta, Y, theta), (r"$\tau$ =", "$Y$", r"$\theta$"), strict=True
):
    top = np.abs(block).max(axis=0) if block is Y else np.abs(block).max()
    _ = axis.imshow(block / top, cmap="coolwarm", vmin=-1, vmax=1, aspect="auto")
    _ = axis.set(title=name, xticks=[], yticks=[])
_ = axes[1].set(xticks=range(5), xticklabels=["$a$", "$b$", "$d$", "$c_1$", "$c_2$"])
_ = axes[2].set(yticks=range(5), yticklabels=["$a$", "$b$", "$d$", "$c_1$", "$c_2$"])
_ = axes[0].set_ylabel("two rows for each sample in time")
plt.show()

# %% [markdown]
# (Red is positive, blue negative; each column has its own scale.) If one column were a weighted sum of others, the log
# couldn't separate their parameters.
#
# The difficulty is $\ddot q$. An encoder measures angles. Differentiating twice multiplies the noise by
# $\sqrt6/\Delta t^2$, where $\Delta t$ is the time between samples. With samples every 2 ms, 1 mrad of noise gives the
# accelerations an error of hundreds of rad/s². Least squares assumes that only $\tau$ is noisy. If $Y$ is noisy too,
# the estimate is biased: it stays wrong, however long the log is. There are three remedies:
#
# 1. Filter the angles before you differentiate them, and filter the torques in the same way (an approximation, because
#    $Y$ is nonlinear).
# 2. Use the integral (weak) form. Multiply the equation by a **test function** $\phi$, a smooth bump that is zero
#    outside a short window, and integrate over the window. Integration by parts turns $\int\phi\,\ddot q\,dt$ into
#    $\int\ddot\phi\,q\,dt$. So you differentiate the known bump, not twice the noisy angle.
# 3. Don't differentiate at all. The next method does this.
#
# ### Output error
#
# The **output error** method simulates the log. Start from a guess of $\theta$ and simulate the arm under the recorded
# torques. The **residual** is the measured angle minus the simulated one. Change $\theta$ until the sum of the squared
# residuals is smallest:
#
# $$\hat\theta = \arg\min_\theta \sum_k \bigl\| y_k - \hat y_k(\theta) \bigr\|^2, \qquad
# J = \frac{\partial \hat y}{\partial \theta} .$$
#
# $y_k$ are the measured angles at sample $k$ and $\hat y_k$ the simulated ones. $J$ holds the derivatives of the
# simulated angles, computed by finite differences. Because $\hat y$ is nonlinear in $\theta$, the problem is solved in
# **Gauss-Newton** steps: approximate $\hat y$ by a linear function with slope $J$, solve that least-squares problem,
# and repeat at the new $\theta$.
#
# The function `fit` does this. It also reports the **half-width** of each parameter's 95 % confidence interval: if its
# assumptions hold (see below), in 95 % of all logs the true value is no farther than this from the fitted one.

# %% tags=["show-code"]
# The simulation, the log, the starting guess, and the free parameters with their bounds.
result = fit(arm, log, logs.GUESS, logs.FREE)

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 2, figsize=(8, 2.2), layout="constrained", sharey=True)
for axis, given, name in zip(
    axes,
    (logs.GUESS, dict(zip(result.names, result.value, strict=True))),
    ("the starting guess", "after the fit"),
    strict=True,
):
    angle = arm({key: np.array([value]) for key, value in given.items()}, log)[1, :, 0]
    _ = axis.plot(log.times, log.measured[1], color=GREY, lw=3, label="measured")
    _ = axis.plot(log.times, angle, color=RED, lw=1, label="simulated")
    _ = axis.fill_between(log.times, log.measured[1], angle, color=RED, alpha=0.2)
    _ = axis.set(title=name, xlabel="time [s]")
_ = axes[0].set_ylabel("angle of joint 2 [rad]")
_ = axes[0].legend(fontsize=8)
plt.show()

# %% tags=["hide-code"]
truth = np.array([logs.TRUTH[name] for name in result.names])
units = ("kg m²", "kg m²", "kg m²", "N m s/rad", "N m s/rad")
meaning = (
    "inertia about joint 1, elbow at 90°",
    "coupling of the links",
    "inertia of link 2 about joint 2",
    "friction 1",
    "friction 2",
)
table(
    ("parameter", "meaning", "true", "fitted", "95 % half-width", "unit"),
    *(
        (name, what, f"{true:.4f}", f"{value:.4f}", f"{half:.5f}", unit)
        for name, what, true, value, half, unit in zip(
            result.names, meaning, truth, result.value, result.half_width(), units, strict=True
        )
    ),
)

# %% [markdown]
# ### Fisher information and the Cramér-Rao bound
#
# How accurate can any method be? Suppose that every sample has independent normal noise of standard deviation $\sigma$.
# The **Fisher information** $F$ measures how much the whole log reveals about the parameters. No method that is right
# on average (unbiased) can have a smaller covariance than $F^{-1}$. This is the **Cramér-Rao bound**. So the variance
# of each parameter's estimate is at least its diagonal entry of $F^{-1}$:
#
# $$F = \frac{1}{\sigma^2}\,J^\mathsf{T}J, \qquad \operatorname{cov}\hat\theta \;\succeq\; F^{-1}
# = \sigma^2\,(J^\mathsf{T}J)^{-1} .$$
#
# <details><summary>The sign in the formula, and an example with one parameter</summary>
#
# The sign $\succeq$ says that the bound holds for every weighted sum of the parameters too. If a parameter moves the
# angles strongly, its variance is small, unless another parameter moves them in the same way. Take a single parameter,
# and let each of $n$ samples change by $j$ per unit of the parameter. Then $F = n j^2/\sigma^2$, and the standard
# deviation is at least $\sigma/(j\sqrt n)$. So four times as many samples halve it.
#
# </details>
#
# `fit` assumes that its estimates scatter exactly as the bound says, and takes $\sigma$ from the residual. Do they? We
# fit 60 logs that differ only in the noise, and compare the scatter of the fits with the ellipse of the bound, computed
# from one log:

# %% tags=["show-code"]
J = result.slope.reshape(-1, 5)
bound = np.linalg.inv(J.T @ J / result.noise**2)
fits = np.array(
    [fit(arm, logs.record(seed=k), logs.GUESS, logs.FREE).value for k in range(100, 160)]
)

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(5, 2.8), layout="constrained")
pair = [0, 3]
angle = np.linspace(0, 2 * np.pi, 100)
circle = np.sqrt(-2 * np.log(0.05)) * np.array([np.cos(angle), np.sin(angle)])
ellipse = np.linalg.cholesky(bound[np.ix_(pair, pair)]) @ circle
_ = axis.plot(*(1e4 * ellipse), color=RED, label="95 % ellipse of the bound")
_ = axis.plot(*(1e4 * (fits - truth)[:, pair].T), ".", color=BLUE, label="60 fits")
_ = axis.set(xlabel="error of $a$ [1e-4 kg m²]", ylabel="error of $c_1$ [1e-4 N m s/rad]")
_ = axis.legend(fontsize=8)
plt.show()
ratio = fits.std(axis=0, ddof=1) / np.sqrt(np.diag(bound))
print("standard deviation of 60 fits over the bound:")
print(", ".join(f"{name} {value:.2f}" for name, value in zip(result.names, ratio, strict=True)))

# %% [markdown]
# The ratios are near one, so no unbiased method can do noticeably better on this log. (60 fits give the scatter itself
# only to about 9 %, so a ratio slightly below one can be chance.)
#
# Two complications are common. Signals of different kinds, such as angles and speeds, need weights: one over the
# variance of each signal's noise, if their noises are independent. Wrong weights increase the scatter of the fits (left
# panel below).
#
# The other is a controller that runs during the log. Take a joint with the inertia $I$ and a noisy speed sensor. Its
# acceleration is measured as the difference of two speed readings. A least-squares line of the accelerations over the
# torques has the slope $1/I$. Without feedback, the noise scatters this slope but doesn't bias it.
#
# With feedback, suppose that one speed is read too high. If the controller reacts within the same sample, it answers
# with less torque, and the difference to the next reading is too small. So the noise lowers torque and acceleration
# *together*. Least squares takes this for an effect of the torque, and $1/I$ comes out too large.
#
# A longer log doesn't remove this bias (middle panel). A higher gain first raises it (right panel). At very high gains
# it falls again.
#
# Output error stays right if the sensor's noise is the only disturbance and is independent from sample to sample. So
# does the method of *instrumental variables*. Its instrument is the part of the torque that was planned before the run:
# it moves the joint, but contains no noise of the sensor.
#
# <details><summary>Logs of several signals, and logs under a running controller: a run of each</summary>
#
# **Weights.** Our fit weighs all angles alike, because they have the same noise. A log with angles in rad *and* speeds
# in rad/s needs weights: divide each signal's residual by the standard deviation of that signal's noise before you add
# the squares. Let the diagonal matrix $W$ hold the weights, one over the square of what you divide by, and $\Sigma$ the
# variances of the noise. If the noises are independent of each other, the fit has the covariance
#
# $$\operatorname{cov}\hat\theta = (J^\mathsf{T}WJ)^{-1}\,J^\mathsf{T}W\Sigma WJ\,(J^\mathsf{T}WJ)^{-1},$$
#
# which is the Cramér-Rao bound for $W = \Sigma^{-1}$ and larger for other weights (up to a common factor). A speed that
# is computed from the angles shares their noise: then use the inverse of the whole covariance, or fit the angles alone.
#
# In the left panel below the weight of the speeds is wrong. The line is this formula, for the parameter that suffers
# most. The dots are the scatter of 40 fits (bars: 95 % intervals). If the noise of the speeds is assumed 3 times too
# large or too small, the scatter grows by about a half at most. The loss is limited on both sides, because the worst
# case is a fit of one kind of signal alone.
#
# **Feedback.** Robots usually record logs while a controller is running. Then the torque depends on the measured
# signal, noise included. Take a joint whose speed $v$ is measured as $y_k = v_k + e_k$, with noise of variance
# $\sigma^2$. The torque is a plan plus $K$ times the speed error, so it contains $-K e_k$. The measured acceleration
# $(y_{k+1} - y_k)/\Delta t$ contains $-e_k/\Delta t$. The product of the two has the mean $K\sigma^2/\Delta t$. Least
# squares of the acceleration on the torque divides this by the mean square of the torque, so that on average
#
# $$\widehat{1/I} - 1/I = \frac{K\,\sigma^2}{\Delta t\;\overline{\tau^2}} .$$
#
# A longer log doesn't help: the scatter shrinks and the bias stays (middle panel). If the controller uses an older
# speed, the torque contains $-K e_{k-1}$ instead. The product then has the mean zero, and there is no bias. The bias
# grows with the gain; when most of the torque is noise, it shrinks again, because the noise raises the mean square of
# the torque (right panel; the lines are the formula).
#
# Two estimates are not biased here. Output error takes the torques as given inputs. It is right on average if the
# torques that were really sent are in the log, and the noise of each sample is independent of the others. An
# **instrument** is a signal $z$ that is correlated with the torque but not with the noise, here the planned torque:
# $\widehat{1/I} = \sum_k z_k a_k / \sum_k z_k \tau_k$, where $a_k$ is the measured acceleration: in both sums the noise
# averages out.
#
# The limit: suppose the sensor is perfect, and the joint is shaken by a torque that is independent in each sample. The
# controller then reacts to earlier disturbances only, and least squares is right on average, under feedback too. Now
# output error is biased. Its residual contains all earlier disturbances, and the controller has reacted to them. A
# disturbance that lasts, such as the pull of a cable, biases least squares, too: what the controller has
# reacted to is still there.
#
# </details>

# %% tags=["hide-code"]
noise, rng = np.array([2e-3, 2e-3, 0.02, 0.02]), np.random.default_rng(0)
figure_, axes = plt.subplots(1, 3, figsize=(9.6, 3.1), layout="constrained")
factors = np.logspace(-2, 2, 41)
scales = [noise * (1.0, 1.0, factor, factor) for factor in factors]
_ = axes[0].loglog(factors, [over_the_bound(one, noise).max() for one in scales], color=BLUE)
best = np.sqrt(np.diag(weighted_covariance(two_kinds()[1], noise, noise)))
for factor in (0.01, 0.1, 1.0, 10.0):
    scale = noise * (1.0, 1.0, factor, factor)
    worst = np.argmax(over_the_bound(scale, noise))
    values = scattered(scale, noise, rng, 40)[0]
    ratio = values[:, worst].std(ddof=1) / best[worst]
    # Of a standard deviation, the standard error of n values is 1 / sqrt(2 (n - 1)) of it.
    twice = 2.0 * ratio / np.sqrt(2.0 * 39)
    _ = axes[0].errorbar(factor, ratio, twice, fmt="o", color=BLUE, capsize=3)
_ = axes[0].set(xlabel="assumed / true noise of the speeds", ylabel="scatter / Cramér-Rao bound")
_ = axes[0].set(title="a wrong weight", yticks=[1, 2, 5, 10], ylim=(0.7, 12))
axes[0].yaxis.set_major_formatter("{x:g}")
axes[0].yaxis.set_minor_formatter("")
loop, lengths = SpeedLoop(), np.array([250, 1000, 4000, 16000])
looks = {"least squares": (RED, "o"), "output error": (GREEN, "s"), "instrument": (BLUE, "^")}
runs = [estimates(loop, n, 60, rng) for n in lengths]
for k, (name, (colour, mark)) in enumerate(looks.items()):
    middle, spread = (100 * np.array([of(one[name]) for one in runs]) for of in (np.mean, np.std))
    x = lengths * 1.12 ** (k - 1)
    _ = axes[1].errorbar(x, middle, spread, fmt=mark, color=colour, capsize=3, label=name)
laws = [100 * loop.inertia * loop.bias(n) for n in lengths]
_ = axes[1].plot(lengths, laws, "--", color=RED, lw=1, label="formula")
_ = axes[1].set(xscale="log", xlabel="samples in the log", ylabel="error of 1/I [%]")
_ = axes[1].set(title=f"a longer log, gain {loop.gain:g} (bars: scatter)")
_ = axes[1].legend(fontsize=8, loc="center right")
gains = np.linspace(0.0, 40.0, 81)
laws = [100 * one.inertia * one.bias(1000) for one in (replace(loop, gain=g) for g in gains)]
_ = axes[2].plot(gains, laws, color=RED)
for gain in (0.0, 2.0, 5.0, 10.0, 16.0, 24.0, 32.0, 40.0):
    for name, value in estimates(replace(loop, gain=gain), 1000, 60, rng).items():
        _ = axes[2].plot(gain, 100 * value.mean(), looks[name][1], color=looks[name][0], ms=5)
_ = axes[2].set(
    xlabel="gain [N m s/rad]", ylabel="error of 1/I [%]", title="a higher gain, 1,000 samples"
)
plt.show()

# %%
more_claims("signals_of_different_kinds", "feedback_and_regression")

# %% [markdown]
# ### What a log can tell: excitation and base parameters
#
# A parameter is **identifiable** if changing it always changes the log, even if you change the other parameters at the
# same time. This depends on the robot's structure and on the torques.
#
# First the structure. Suppose that each link's length is known, and that its centre of mass is in its middle. Then six
# numbers describe our arm: the mass $m$ of each link, its inertia $I$ about the centre of mass, and two frictions.
#
# No motion of a horizontal arm can separate $m_1$ from $I_1$. Link 1 only turns about joint 1, so only its inertia
# about that joint matters: $I_1 + \tfrac14 l_1^2 m_1$. Raise $m_1$ and lower $I_1$ so that this sum stays the same:
# then every motion stays the same. A change of parameters that no log reveals is a **null direction**. Then $J$ loses
# rank, and the Cramér-Rao bound along this direction is infinite.
#
# The remedy is to fit only the **base parameters**: a smallest set of combinations that determines every motion. Our
# $a, b, d, c_1, c_2$ are the base parameters of the six numbers.
#
# <details><summary>How to compute the null directions</summary>
#
# Take the $J$ of the six numbers. Its singular value decomposition has one singular value above zero for each base
# parameter, if the log excites them all. The singular vectors of the zero values are the null directions.
#
# </details>

# %% tags=["hide-code"]
free = dict.fromkeys(logs.six(), (1e-4, 10.0))
(report,) = excitation(logs.rods, {"two sines": log}, logs.six(), free).values()
six = logs.six()
masses, inertias = (np.linspace(0.4, 1.6, 21) * six[name] for name in ("m1", "I1"))
pairs = np.meshgrid(masses, inertias)
candidates = {name: np.full(pairs[0].size, value) for name, value in six.items()}
candidates |= {"m1": pairs[0].ravel(), "I1": pairs[1].ravel()}
residual = logs.rods(candidates, log) - log.measured[..., None]
rms = 1e3 * np.sqrt((residual**2).mean(axis=(0, 1))).reshape(pairs[0].shape)
figure_, axis = plt.subplots(figsize=(5, 2.7), layout="constrained")
drawn = axis.contourf(masses, inertias, rms, levels=12, cmap="viridis")
_ = figure_.colorbar(drawn, ax=axis, label="residual, rms [mrad]")
_ = axis.plot(masses, six["I1"] + 0.0625 * (six["m1"] - masses), "w--", lw=1)
_ = axis.plot(six["m1"], six["I1"], "w*", ms=11)
_ = axis.set(xlabel="$m_1$ [kg]", ylabel="$I_1$ [kg m²]", ylim=(inertias[0], inertias[-1]))
plt.show()
print(f"six parameters, rank {report.rank}: {'; '.join(report.null)}")

# %% [markdown]
# The dashed line is the null direction through the true arm (star). Everywhere on it the residual is as small as at the
# star, so a fit may return any of its points.
#
# Now the torques. **Excitation** means torques under which every base parameter changes the log in its own way. An arm
# whose second joint never turns reveals nothing about $c_2$. The standard choice is a sum of sines on all joints at
# once.
#
# You can compare plans *before* you record anything: simulate each one and compute $F$. This needs a guess of the
# parameters, because $J$ depends on them. So check that the best plan stays the best for other guesses. (The table uses
# the true values.)
#
# A common summary is the **condition number** of $J$, each column multiplied by its parameter's value: the largest
# singular value over the smallest one. A large value warns of a nearly null direction.
#
# What counts in the end is the **standard error**: the standard deviation of an estimate, about half of the half-width.
# The table shows it for the worst parameter. In the last two columns all plans are scaled to the same rms torque
# $\sqrt{\text{mean of } \tau_1^2 + \tau_2^2}$, that of the two sines.

# %% tags=["hide-code"]
plans = {name: logs.record(name) for name in ("two sines", "steps", "one slow joint")}
figure_, axes = plt.subplots(1, 3, figsize=(8, 1.7), layout="constrained", sharey=True)
for axis, (name, one) in zip(axes, plans.items(), strict=True):
    _ = axis.plot(one.times[:-1], one.command.T, label=("joint 1", "joint 2"))
    _ = axis.set(title=name, xlabel="time [s]")
_ = axes[2].legend(fontsize=8)
_ = axes[0].set_ylabel("torque [N m]")
plt.show()
# The same plans, scaled to the rms torque of the two sines.
rms = {name: np.sqrt((one.command**2).sum(axis=0).mean()) for name, one in plans.items()}
alike = {
    name: replace(one, command=one.command * rms["two sines"] / rms[name])
    for name, one in plans.items()
}
head = "standard error of the worst parameter"
last = ("the same at equal rms torque", "joints then travel [rad]")
rows = [("torques", "rms torque [N m]", "condition number", head, *last)]
known = {key: np.array([value]) for key, value in logs.TRUTH.items()}
reports = [excitation(arm, some, logs.TRUTH, logs.FREE) for some in (plans, alike)]
for name in plans:
    report = reports[0][name]
    worst = [100 * (np.sqrt(np.diag(x[name].covariance)) / truth).max() for x in reports]
    errors = (f"{value:.3f} %" for value in worst)
    travel = " and ".join(f"{x:.1f}" for x in np.ptp(arm(known, alike[name])[..., 0], axis=1))
    rows.append((name, f"{rms[name]:.2f}", f"{report.condition:.1f}", *errors, travel))
table(*rows)

# %% [markdown]
# The slow joint has a smaller condition number than the steps and yet a larger error, because its torques are small; a
# ratio can't show that. At equal rms torque it beats the steps. But a larger plan moves the joints farther (last
# column; the slow joint pulls the other one along): check it against the robot's limits.
#
# ### When the fit misleads you
#
# An error bar assumes that the model and the time stamps are right, and that the noise of the angles is zero on average
# and independent from sample to sample. If the robot has an effect that the model lacks, the fitted parameters absorb
# this effect as well as they can. Then they are wrong, and their error bars are still small.
#
# If the model explains everything except such noise, the residual is **white**: no sample is correlated with any
# earlier one. The test of Ljung and Box (1978) measures this. It correlates the residual with copies of itself, shifted
# by one sample, two, three, and so on. It adds up the squares of these correlations and returns the probability that
# pure noise gives such a large sum. Below 1 % we say *not white*.
#
# A second test is **validation**: let the fitted model predict another log. If the model is right and its parameters
# are well determined, the prediction differs from that log by little more than the sensor's noise.
#
# We record four logs and fit the same five-parameter model to each. For the last column each arm records another log,
# with the plan *steps* from above.

# %% tags=["hide-code"]
cases = (
    ("nothing missing", {}),
    ("dry friction missing", {"f1": 0.1, "f2": 0.05}),
    ("10 ms delay missing", {"delay": 0.01}),
    (
        "10 ms delay missing, only one joint driven, slowly",
        {"delay": 0.01, "kind": "one slow joint"},
    ),
)
figure_, axes = plt.subplots(1, 4, figsize=(9, 1.9), layout="constrained", sharex=True)
rows = [
    (
        "in the log",
        "largest error of a parameter",
        "largest half-width claimed (95 %)",
        "residual",
        "verdict of the test",
        "error of prediction, another log",
    )
]
for axis, (name, changed) in zip(axes, cases, strict=True):
    wrong = fit(arm, logs.record(**changed), logs.GUESS, logs.FREE)
    error = 100 * np.abs(wrong.value / truth - 1).max()
    claimed = 100 * (wrong.half_width() / truth).max()
    verdict = "not white" if wrong.white < 0.01 else "white"
    # The same arm under other torques, predicted with the fitted parameters.
    other = logs.record(seed=1, **{**changed, "kind": "steps"})
    fitted = {key: np.array([x]) for key, x in zip(wrong.names, wrong.value, strict=True)}
    missed = np.sqrt(((arm(fitted, other)[..., 0] - other.measured) ** 2).mean())
    sizes = (f"{1e3 * size:.2f} mrad" for size in (wrong.noise, missed))
    rows.append((name, f"{error:.2f} %", f"{claimed:.2f} %", next(sizes), verdict, next(sizes)))
    _ = axis.plot(log.times, 1e3 * wrong.residual[0], lw=0.6, color=BLUE)
    _ = axis.set(title=textwrap.fill(name, 26), xlabel="time [s]")
    axis.title.set_fontsize(8)
_ = axes[0].set_ylabel("residual 1 [mrad]")
plt.show()
table(*rows)

# %% [markdown]
# The whiteness test raises the alarm in rows two and three. It doesn't in the last row: the residual looks like noise,
# and yet the parameters are wrong. The motion was so slow that other parameters could imitate the delay. Only the other
# log reveals the error.

# %%
show("believed_error_bar")

# %% [markdown]
# ### A log that is shifted by one sample
#
# Sometimes the model is right, and the recording program is wrong. Suppose that each row of the log holds its own
# command, but the angle of the row before. Then every angle is one sample old.
#
# At 2 ms per sample, a joint at 1 rad/s moves by 2 mrad in that time, twice the sensor's noise here. But a fit can
# imitate a part of this lag with wrong parameters.

# %%
predict("one_step_late")

# %% tags=["hide-code"]
stamped = np.hstack([log.measured[:, :1], log.measured[:, :-1]])
slipped = Log(log.times, stamped, log.command)
wrong = fit(arm, slipped, logs.GUESS, logs.FREE)
error = np.abs(wrong.value - truth) / np.sqrt(np.diag(result.covariance))
lag, sure = measurement_lag(wrong, slipped)
worst = 100 * np.abs(wrong.value / truth - 1).max()
name = result.names[error.argmax()]
print(
    f"largest error: {error.max():.0f} standard deviations ({name}); in per cent at most {worst:.1f} %"
)
verdict = "not white" if wrong.white < 0.01 else "white"
print(f"residual: {wrong.noise / result.noise:.2f} times that of the correct log, {verdict}")
exact = {name: np.array([value]) for name, value in logs.TRUTH.items()}
unfitted = np.sqrt(((arm(exact, slipped)[..., 0] - stamped) ** 2).mean())
print(f"with the true parameters: {unfitted / result.noise:.2f} times that of the correct log")
print(
    f"lag from the residual and the speed: {1e3 * lag:.2f} +- {1e3 * sure:.2f} ms (true: {1e3 * log.dt:.0f} ms)"
)

# %% [markdown]
# The whiteness test notices the shift, and the last printed line measures it. An angle that is late by a lag is wrong
# by minus the lag times the speed. So plot the residual against minus the speed: the slope is the lag. The fit has
# hidden a part of it in its parameters; the printed value is corrected for that (fold).
#
# <details><summary>The correction for what the fit has hidden</summary>
#
# An angle that is late by $\delta$ is wrong by $-\delta\,\dot q$. By changing parameters the fit can only add columns
# of $J$ to the simulated angles, so it can hide only that part of the error. Subtract from the speed the sum of columns
# of $J$ that is closest to it (by least squares), and use what remains for the slope.
#
# </details>

# %%
more_claims("one_sample_late")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** A fit always returns numbers. Ask three more questions. Which parameters can't the log tell apart? Is
# the residual white? Does the model predict a log that it was not fitted to? Without these answers, an error bar
# describes the model, not the robot.
#
# </div>
#
# ## 3 · Concept: many simulators, or the right one?
#
# ### Domain randomisation
#
# If you can't record a log, because the robot isn't built yet, you can tune for many possible robots.
# **Domain randomisation** (DR) samples new simulator parameters for every episode, so that the gains can't rely on any
# one value.
#
# The *range* sets how far the parameters may differ from the simulator's. At range 1 each parameter except the delay
# differs by at most as much as at gap 1. Payload, dry friction and noise vary only upward from zero, the others in both
# directions. The delay lies between 0 and 30 ms at range 1.

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(6, 2.5), layout="constrained")
rng = np.random.default_rng(0)
for width, colour in ((1.0, "#c5cae9"), (0.4, BLUE)):
    cloud = sim_to_real.around(sim_to_real.nominal(), width)(150, rng)
    label = f"simulators, range {width:g}"
    _ = axis.plot(1e3 * cloud.delay, cloud.payload, ".", color=colour, label=label)
for gap, late_by in ((0.3, 0.01), (1.0, 0.01)):
    robot = real(gap, late_by)
    _ = axis.plot(1e3 * robot.delay, robot.payload, "*", color=RED, ms=12)
    at = (1e3 * robot.delay[0], robot.payload[0])
    white = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.9}
    _ = axis.annotate(
        f"real arm, gap {gap}",
        at,
        (9, 0),
        textcoords="offset points",
        color=RED,
        va="center",
        bbox=white,
    )
_ = axis.set(xlabel="delay [ms]", ylabel="payload [kg]", ylim=(-0.02, 0.58))
figure_.legend(fontsize=8, loc="outside right upper")
plt.show()

# %% [markdown]
# One set of gains now has to serve all these arms. It can be cautious: low gains tolerate a longer delay. In return
# they take longer to reach the target. So besides success we also measure the time that the hand spends inside the
# target.

# %%
predict("what_a_range_costs")

# %% [markdown]
# ![Success over the gap and over the range](../docs/charts/success_over_gap.png)

# %% tags=["hide-code"]
for name, k in (("no range", 0), ("range 1", 10)):
    home = rollouts(sim_to_real.nominal(), recorded()["range"][k].T, posed)
    print(f"on the simulator's own arm, {name}: success {home.rate.mean():.3f},", end=" ")
    print(f"{home.inside.mean():.3f} s inside the target")
curves(
    "success_over_gap",
    0,
    "success at gap (delay: 10 ms)",
    {
        "no range": "no range",
        "range 1": "range 1",
        "true parameters": "true parameters",
    },
)

# %% [markdown]
# On an arm identical to the simulator range 1 costs no success here, only time. In the table the real arm always has a
# delay of 10 ms, which the simulator lacks. So some reaches fail even at gap 0. Range 1 recovers much of what the delay
# costs, and little of what the load costs at large gaps.
#
# The third row is **the other approach**: find the real arm's parameters and tune on them. We used the exact
# parameters, so this row shows what perfect identification gives, up to the luck of a search. Up to gap 0.5 range 1
# succeeds about as often. Range 1 needs no log, only a good guess of its width. At large gaps the true parameters are
# far better. But gap 1 is the hardest case for randomisation: every parameter except the delay is at an end of range 1,
# and hardly any sample falls there.
#
# In the right panel wider ranges help on every arm but the simulator's own, most of all up to range 0.4. (MuJoCo's
# **twin**: see the next heading.) *True, range 0.4* on the left adds a range around the true parameters; it gains
# nothing. Compare only rates of one table or chart: others use other searches and tasks.
#
# <details><summary>The areas in the chart, and why the success at gap 1 has other values in other tables</summary>
#
# In the left panel, the areas around *no range* and both ranges reach from the worst to the best of three searches. The
# other areas in the chart are 95 % intervals.
#
# The searches and the tasks differ. Section 1 uses the first of three searches. The table above shows the mean of these
# three on other tasks, section 9 on other tasks again. The corrections below use the mean of two more searches.
#
# </details>

# %%
more_claims("measured_or_randomised")

# %% [markdown]
# ### A robot that the simulator can't represent
#
# Real robots also have effects for which our simulator has no parameter. The chapter's twin is another model of the
# arm, built in MuJoCo, with three such effects: **backlash** (free play between the teeth of the gears), the inertia of
# the motors' rotors, and friction that first gives way a little like a spring (presliding).
#
# No parameters make our simpler arm move exactly like the twin: nothing in it can imitate the backlash. But to tune a
# controller you only need a model that moves like the robot in the motions of the task.

# %%
predict("which_wins")

# %% [markdown]
# **Fine-tuning** continues the search on the robot itself, here from the gains of range 1. Every set of gains that it
# tries costs real trials.
#
# ![Success on the twin against the robot time used](../docs/charts/robot_time.png)

# %% tags=["hide-code"]
curves("robot_time", 0, "success after robot time [s] of", {"identified from a log": "identified"})

# %% tags=["hide-code"]
curves("robot_time", 0, "success after robot time [s] of", {"fine-tuned": "fine-tuned"})

# %% [markdown]
# One log of less than a second lifts the success far above every range (three lowest lines). Longer logs, or a range
# around the identified values, don't raise it further. Fine-tuning ends at a similar rate, after far more robot time.
#
# <details><summary>The two upper dotted lines</summary>
#
# The two upper dotted lines belong to chapter 6's adaptive controller, with and without adapting. It isn't a fair
# rival: its settings were chosen by trials on the twin that the chart doesn't count.
#
# </details>
#
# ### When each approach wins
#
# Now let the arm differ in every episode, as when a robot picks up boxes of unknown weight. We tune gains in four ways
# and test them on 1,000 sampled arms. The first two ways use no knowledge of these arms. The third knows their mean,
# the fourth how they are sampled.

# %% tags=["hide-code"]
spread = sim_to_real.around(real(0.6, 0.012), 0.6)
there_is = spread(1000, np.random.default_rng(5))


def searched(case):
    """Return the gains of a search of so many rounds, on the mean of the arms or on all."""
    on_all, rounds = case
    return tune(spread if on_all else only(real(0.6, 0.012)), 0, rounds=rounds).gains


# The first search is a short one, which is computed again whenever the page is tested.
_, on_mean, on_spread = from_record(
    "sim_to_real.true_spread", searched, ((True, 2), (False, 20), (True, 20))
)
sets = {
    "on the plain simulator": recorded()["range"][0, 0],
    "on a wide range, no log": recorded()["range"][10, 0],
    "on the mean of the arms": np.array(on_mean),
    "on the arms' true spread": np.array(on_spread),
}
rows = [("gains tuned", "success on varying arms", "95 % interval")]
success = {}
for name, gains in sets.items():
    success[name] = rollouts(there_is, gains, tasks(1000, 42)).success
    rate = float(success[name].mean())
    low, high = wilson(1000 * rate, 1000)
    rows.append((name, f"{rate:.3f}", f"{low:.3f} to {high:.3f}"))
# All sets meet the same arms and targets, so the difference is one of pairs.
pairs = success["on the arms' true spread"] * 1.0 - success["on the mean of the arms"]
middle, half = pairs.mean(), 1.96 * pairs.std(ddof=1) / np.sqrt(1000)
print(f"true spread minus mean, on the same arms: {middle:+.3f}, ", end="")
print(f"95 % interval {middle - half:+.3f} to {middle + half:+.3f}")
table(*rows)

# %% [markdown]
# Identification won on the twin: one robot, and a log of it. Randomisation helps where you have no log: a wide range
# does much better than the plain simulator (first two rows).
#
# Common advice is to identify what is fixed and to randomise what varies. Here the second half gains nothing: the
# interval of the difference between the last two rows (above the table) contains zero.
#
# <details><summary>Which approach in which situation: a table</summary>
#
# <table>
# <tr><th>situation</th> <th>what to do</th> <th>why</th></tr>
# <tr><td>one robot, fixed parameters, logs can be recorded</td> <td>identify</td> <td>the unknown becomes
# known (with a small gap a range does as well)</td></tr>
# <tr><td>one robot, not available yet</td> <td>randomise</td> <td>nothing to identify; cautious gains tolerate
# delay</td></tr>
# <tr><td>a new arm in each episode, its spread known</td> <td>tune on the mean or on the spread</td> <td>a compromise
# either way; nearly equal here</td></tr>
# <tr><td>a new arm in each episode, whose behaviour shows during the episode</td> <td>memory or adaptation</td>
# <td>the controller estimates the arm while it acts: see the next heading</td></tr>
# </table>
#
# </details>
#
# ### Adapting during the episode
#
# A controller can also estimate the arm while it moves. Here one joint swings a load in the vertical plane. Load (0 to
# 2 kg) and friction differ in every episode, torques arrive 10 ms late, and the encoder is noisy.
#
# All methods use one control law, a variant of the law of Slotine and Li (1987). It computes the torque with which an
# *estimate* of the arm would follow the motion, and adds feedback. The original law has constant feedback gains; ours
# multiplies them by the estimated inertia.

# %%
predict("which_arm_shakes")

# %% [markdown]
# The methods differ in where the estimate comes from:
#
# - Two methods never change their estimate. They assume an arm in the middle of the range. *One tuned gain set* was
#   tuned on this middle arm, *randomised gains* on sampled arms.
# - The *adaptive law* corrects its estimate all the time, in proportion to the tracking error. It was tuned on the same
#   sampled arms.
# - The **teacher** receives the parameters of the true arm. Only a simulator knows them, so this is called **privileged
#   information**.
# - The **student** is a small network. It computes the estimate from the last 0.4 s of angle, speed and torque. It was
#   trained to output the true parameters, mostly in episodes that it controlled itself. This is a simple form of
#   **rapid motor adaptation** (RMA).
#
# *Best gains in hindsight* also assumes the middle arm. It tries every gain set of the search on each test arm and
# picks the best one. The *error* of an arm is the root of its mean squared tracking error.
#
# ![Six methods on arms that vary](../docs/charts/varying_arms.png)

# %% tags=["hide-code"]
pattern = r"(.+): median ([\d.]+) mrad, nine of ten arms below ([\d.]+), mean ([\d.]+);"
rows = [
    (
        "method",
        "median error [mrad]",
        "9 of 10 arms below [mrad]",
        "mean error [mrad]",
    )
]
table(*rows, *re.findall(pattern, read("varying_arms")))

# %% [markdown]
# On the median arm the teacher is about as good as the best gains in hindsight. On the difficult arms, mostly light
# ones, it is better, because it has a better estimate (column *9 of 10 arms below*). The student comes close on the
# median arm only. Randomised gains and the adaptive law give up accuracy on the median arm to avoid large errors on
# the others. The next table (second panel) varies the load, also beyond the 2 kg of the training:

# %% tags=["hide-code"]
names = ("one tuned gain set", "randomised gains", "adaptive law", "student with history")
names += ("teacher", "best gains in hindsight")
curves("varying_arms", 1, "median error [mrad] at a load [kg] of", {name: name for name in names})

# %% [markdown]
# Without load, still inside the training's range, only the teacher works well. The others, except the gains in
# hindsight, start with too strong a feedback for so light an arm, and it oscillates. On most of these arms the adaptive
# law doesn't recover. It corrects the inertia by the product of the tracking error and the commanded acceleration. Both
# contain the error's rate, so in an oscillation this product is positive on average: the estimated inertia goes *up*,
# and the feedback with it.
#
# A heavy arm gets too weak a feedback instead. With the adaptive law it stays stable until the estimate is corrected,
# even far beyond the training. The randomised gains fail right beyond the training, the one tuned gain set soon
# after, the student at twice the largest load.
#
# <details><summary>The four panels, and the original RMA</summary>
#
# In the original RMA (Kumar and others, 2021) the student estimates a learned code of the parameters, not the
# parameters themselves. In the table, the best gains in hindsight beat the teacher at 1.5 kg and above: they are picked
# for each arm, the teacher's one set serves all.
#
# The first panel adds the computing time: the student needs more, for its network. The ends of a bar are the errors
# that 10 % and 90 % of the arms stay below. The third panel shows that a student with a shorter history is worse.
# With the full history, five times the noise hardly changes its median error.
#
# Why does the adaptive law fail without load? With `DELAY = 0` in `varying_arms.py` its estimate comes down on most of
# these arms, and the error is small. With the delay it stays right on most arms only if it starts at the true values.
#
# In the last panel the dotted lines are computed limits. An arm without load has a quarter of the inertia that the law
# assumes there. So it gets four times the feedback that it needs, and it becomes unstable first. The limits differ by
# more than a factor of four, because the panel varies only a part of the feedback, the damping.
#
# </details>

# %%
more_claims("best_fixed_gains")

# %% [markdown]
# ### Correcting one parameter can hurt
#
# The usual advice is a loop: find a difference, correct it in the simulator, and tune again. At gap 1 the load costs
# most, and correcting it first does help (the dot *load first* in the left panel below). But suppose that you begin
# with the delay, because it is the easiest to measure. Each row of the table names what you notice on the robot, then
# corrects one more parameter and tunes again:

# %% tags=["hide-code"]
text = read("mending")
pattern = r"row \d, (?:([^;:]+); )?([^:]+):\s+([\d.]+) \[([\d.]+), ([\d.]+)\]"
rows = [("symptom", "corrected in addition", "success", "interval of the trials")]
for symptom, part, rate, low, high in re.findall(pattern, text):
    rows.append((symptom or "-", part if symptom else "nothing yet", rate, f"{low} to {high}"))
tuned_on = {"nothing": "range", "delay": "delay", "load": "load", "all": "known"}
print("gains kp [N m/rad] and kd [N m s/rad] of joint 2, by what is corrected:")
sets = {n: recorded()[k][0 if n == "nothing" else 10].mean(axis=0) for n, k in tuned_on.items()}
print(", ".join(f"{name} {gains[3]:.0f} and {gains[5]:.1f}" for name, gains in sets.items()))
table(*rows)

# %% [markdown]
# ![All partly corrected simulators, and the value of correcting each parameter](../docs/charts/mending.png)
#
# The left panel shows all 32 combinations of corrections. Each rate is the mean of two searches, and another search
# would change it (section 1). So read only the large steps.
#
# The first correction, of the delay, makes the robot *worse*. Gains tuned with nothing corrected are much higher than
# those tuned with the right delay alone (lines above the table; *load* there is the load alone). The real arm is heavy
# and needs high gains. It also tolerates them in spite of the delay, because its inertia slows down the loop.
#
# With the delay corrected, but not the load, the search lowers the gains, as it should for a *light* arm with delay.
# For the heavy arm they are too low, in stiffness $k_p$ and in damping $k_d$: more often the hand swings out of the
# target again or never reaches it. Two errors had cancelled each other, and we removed only one.

# %% tags=["hide-code"]
points = stored("mending")[0][""]
value = dict(zip(sim_to_real.subsets(transfer.PARTS), np.array(points.y), strict=True))
worse = sim_to_real.harmful_corrections(value)


def half_width(some, part):
    """Return the half-width of the 95 % interval of a change between two rates of 2,000 trials."""
    return 1.96 * np.sqrt(sum(x * (1 - x) / 2000 for x in (value[some], value[some | {part}])))


sure = [one for one in worse if -one[2] > half_width(*one[:2])]
large = [(before, part) for before, part, change in worse if change < -0.1]
print("a single correction: 5 parameters, each with 16 sets of earlier corrections, 80 in all")
print(f"{len(worse)} of these 80 show a lower success rate,")
print(
    f"{len(sure)} by more than the interval of the trials, {len(large)} by more than 10 percentage points."
)
only_delay = all(part == "delay" and "load" not in before for before, part in large)
verb = "correct" if only_delay else "do not all correct"
print(f"These {len(large)} {verb} the delay while the load is still wrong.")
rows = [("value of correcting", "as the first", "average over all orders", "as the last")]
for part, *worth in re.findall(
    r"(\w+): alone, average, last ([-+.\d]+), ([-+.\d]+), ([-+.\d]+)", text
):
    rows.append((part, *worth))
table(*rows)

# %% [markdown]
# <details><summary>How much of this is chance?</summary>
#
# If corrections did nothing, chance alone would lower the rate in about half of the 80 cases. And another search
# changes rates by more than the interval of the trials. But the large falls all have the same form: the delay is
# corrected before the load. In the table above, friction helps as the first correction and not as the last, the motor
# the other way round.
#
# </details>
#
# What a parameter is worth depends on what was corrected before: compare the first column with the last. The average
# over all orders is called **Shapley's value**; the five averages add up to the gain of correcting all. The load is
# dominant in every column. The others have no fixed order.
#
# The practical rule: *correct together everything that your logs reveal, and treat it as one change.* The measured
# values stay in the simulator, even if the success falls. Then look for the error that they had cancelled.
#
# Which *policy* runs on the robot is a separate decision. Fix the number of trials, and test the one new policy that
# you would use. It replaces the old one only if the confidence interval of the *difference* in success lies above
# zero. To judge the *correction*, and not the luck of one training, compare the means of several trainings with and
# without it.

# %%
show("mended_parameter")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** A policy is tuned to all errors of its simulator together. If you remove one error, the others may
# cost more. So judge a *policy* by its success rate with its confidence interval, not by the accuracy of a parameter.
#
# </div>
#
# ### How many trials are enough?
#
# For rates that aren't near 0 or 1, four times as many trials roughly halve the confidence interval.

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(5.5, 1.6), layout="constrained")
for row, (k, n) in enumerate(((7, 10), (70, 100), (700, 1000))):
    low, high = wilson(k, n)
    _ = axis.plot([low, high], [row, row], lw=6, color="#9fa8da")
    _ = axis.plot(k / n, row, "o", color="#1a237e")
_ = axis.set(yticks=range(3), yticklabels=["7 of 10", "70 of 100", "700 of 1000"], xlim=(0, 1))
_ = axis.set(xlabel="true success rate, 95 % interval", ylim=(-0.6, 2.6))
plt.show()

# %% [markdown]
# How many trials do you need to tell two policies apart? That depends on the **level** of the test, the probability
# that equally good policies look different (usually 5 %), and on its **power**, the probability that a real difference
# is detected (usually 80 %). Let $p$ be the mean of the two success rates and $d$ their difference. Then each policy
# needs about $n = 2p(1-p)z^2/d^2$ trials. For the usual level and power, $z$ = 1.96 + 0.84 (two quantiles of the normal
# distribution).
#
# <details><summary>From level and power to a number of trials</summary>
#
# A rate $p$ from $n$ trials has the variance $p(1-p)/n$, and the difference of two independent rates has the sum of
# both variances. The difference must exceed its standard deviation by the factor $z$: the quantile of the normal
# distribution for the level plus the one for the power. (The number printed below is smaller by one. It uses the mean
# rate $p$ for the level only, and each policy's own variance for the power.)
#
# </details>
#
# Running both policies on the *same* tasks saves trials if they tend to fail together. Such trials are **paired**. Only
# the tasks on which the policies disagree show which one is better. McNemar's test compares their numbers,
# $n_\text{old}$ and $n_\text{new}$:
#
# | | new policy wins | new policy loses |
# |---|---|---|
# | old policy wins | both win | $n_\text{old}$ |
# | old policy loses | $n_\text{new}$ | both lose |

# %% tags=["hide-code"]
print("example: to tell rates of 78 % and 87 % apart in 80 % of the cases, at the 5 % level:")
print(f"{trials(0.78, 0.87)} trials of each policy on its own tasks;")
print(f"{trials(0.78, 0.87, together=0.75)} tasks if both policies get the same ones,", end=" ")
print("and 75 % of these are solved by both policies")

# %% [markdown]
# ### Reward shaping: does it change the best policy?
#
# Many robot policies are trained on a reward. We use small worlds in which the best policy can be computed exactly.
#
# A Markov decision process has states $s$ and actions $a$. An action leads to a next state $s'$ and pays a reward $R(s,
# a, s')$. A reward $t$ steps ahead is multiplied by $\gamma^t$, where the discount $\gamma$ is below one. $Q(s, a)$ is
# the discounted sum that you can expect if you take $a$ now and act optimally afterwards. The **value** $V(s)$ is the
# largest $Q(s, a)$ of a state.
#
# A reward that is paid only at the goal is rare, and learning from it is slow. **Reward shaping** adds rewards that
# guide the learner on the way. A careless addition changes which policy is best: pay a robot for being near the goal at
# each step, and it may prefer to stay near it and never arrive. Ng, Harada and Russell (1999) found a safe form. Choose
# a **potential** $\Phi(s)$, a number for each state, and pay its discounted *difference*:
#
# $$\boxed{\;R'(s, a, s') = R(s, a, s') + \gamma\,\Phi(s') - \Phi(s)\;}$$
#
# Why is this safe? Add up the extra payments along a path of states. In each step you receive the discounted potential
# of the next state. One step later you pay the same amount back. So all terms in between cancel; the sum *telescopes*.

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(7, 2.1), layout="constrained")
for k in range(4):
    _ = axis.plot(k, 0, "o", color=BLUE, ms=15)
    _ = axis.text(k, 0.28, f"$s_{k}$", ha="center")
    if k < 3:
        _ = axis.annotate("", (k + 0.85, 0), (k + 0.15, 0), arrowprops={"arrowstyle": "->"})
        words = [r"$-\,\Phi(s_0)$", r"$-\,\gamma\Phi(s_1)$", r"$-\,\gamma^2\Phi(s_2)$"][k]
        gained = [r"$+\,\gamma\Phi(s_1)$", r"$+\,\gamma^2\Phi(s_2)$", r"$+\,\gamma^3\Phi(s_3)$"][k]
        _ = axis.text(k + 0.5, -0.4, gained, ha="center", color=RED if k == 2 else GREY)
        _ = axis.text(k + 0.5, -0.75, words, ha="center", color=RED if k == 0 else GREY)
_ = axis.set(xlim=(-0.3, 3.3), ylim=(-1, 0.6))
_ = axis.set_title(
    "what shaping adds in three steps: the grey terms cancel, the red ones remain", fontsize=9
)
axis.axis("off")
plt.show()

# %% [markdown]
# Now write it down, in two formulas. <span class="kernel-only">Change the text in quotation marks.</span>
#
# 1. Three steps lead from a state with the potential `p0` to one with the potential `p3`. What is the discounted sum of
#    all that shaping adds?
# 2. In a task that never ends, an action has the value `Q` without shaping, in a state with the potential `phi`. What
#    is its value with shaping?
#
# <details><summary>Hint 1</summary>Write the three added terms under each other, with their discounts, and look for
# what occurs twice.</details>
# <details><summary>Hint 2</summary>Which remaining term belongs to the start, which to the end, and which of them can a
# policy influence?</details>
# <details><summary>Hint 3</summary>Is what shaping adds to $Q$ the same for all actions in a state? Then the best
# action doesn't change.</details>

# %%
answer("telescoped_sum", "p3 - p0")

# %%
answer("q_of_shaped", "Q")

# %%
show("telescoped_sum")

# %% [markdown]
# Two terms remain, one for the start and one for the end. Every policy begins at the same start, so the first term
# changes no comparison. But a policy can choose where it ends.

# %%
predict("shaping_at_the_end")

# %% [markdown]
# The rule is therefore: $\Phi = 0$ at every terminal state, and $\Phi$ is bounded (with finitely many states it always
# is). Then shaping subtracts $\Phi(s)$ from each $Q(s, a)$ of a state, and the best action stays the best. We check the
# rule on 100 random processes with eight states, three of them terminal.

# %% tags=["hide-code"]
changed = {"zero at terminal states": 0, "not zero there": 0}
rng = np.random.default_rng(0)
ends = np.arange(8) >= 5
for _ in range(100):
    P, R = rng.dirichlet(np.ones(8), (8, 3)), rng.random((8, 3, 8))
    P[ends], R[ends] = np.eye(8)[ends, None], 0.0
    process, phi = Process(P, R, 0.95, ends), 3.0 * rng.normal(size=8)
    best = value_iteration(process).policy[~ends]
    for name, free_end in zip(changed, (False, True), strict=True):
        other = value_iteration(shaped(process, phi, free_end=free_end)).policy[~ends]
        changed[name] += bool(np.any(other != best))
for name, n in changed.items():
    print(f"potential {name:<24} best policy changed in {n:2d} of 100 processes")

# %% [markdown]
# At a time limit, a learner that *bootstraps* adds its own estimate $V$ of the shaped rewards that would follow. For it
# nothing has ended, so $\Phi$ of the last state stays. For a learner that counts the limit as an end, $\Phi$ must be
# zero there:
#
# <details><summary>What Gymnasium reports</summary>
#
# Gymnasium's interface reports two flags for this: `terminated` (the task is over) and `truncated` (the clock stopped).
#
# </details>

# %% tags=["hide-code"]
axis = diagram(
    (8, 2.2),
    (
        (0, 1, "state $s_T$"),
        (2.2, 1, "terminated:\nthe task is over"),
        (5, 1, r"value ahead 0, $\Phi = 0$"),
        (2.2, 0, "truncated:\nthe clock stopped"),
        (5, 0.4, r"bootstraps: add $\gamma V(s_T)$, keep $\Phi(s_T)$"),
        (5, -0.5, r"doesn't bootstrap: an end, $\Phi = 0$ in this step"),
    ),
    ((0, 1, ""), (1, 2, ""), (0, 3, ""), (3, 4, ""), (3, 5, "")),
)
plt.show()

# %% [markdown]
# <details><summary>The whole derivation, and a common slip</summary>
#
# The term $\gamma^{t}\,\gamma\,\Phi(s_{t+1})$ of step $t$ meets its negative in step $t+1$. Two terms are left: minus
# the potential of the start, and the discounted potential of the end. The first is the same for all policies. The
# second vanishes if $\Phi = 0$ wherever an episode ends, or if nothing ends and $\Phi$ is bounded. Then $Q$ is reduced
# by a term that does not depend on the action, so the best action is unchanged.
#
# A common slip is a second term $\gamma\Phi(s)$ in $Q'$. The $\gamma\Phi(s')$ of one step cancels against the next
# step, so nothing of it remains.
#
# </details>
#
# <details><summary>Why paying minus the distance is not a difference of potentials</summary>
#
# What if you pay minus the distance to the goal in each step? That is *not* a difference of potentials: the payments
# add up along the path. So a longer path that soon comes near the goal can cost less than a shorter one that stays far
# away until its last steps. Paying for *getting nearer* has no such effect: $\gamma\Phi(s') - \Phi(s)$ with $\Phi =
# -\text{distance}$, and with $\Phi = 0$ wherever an episode ends.
#
# </details>

# %%
show("two_routes")

# %% [markdown]
# Under the conditions above, shaping preserves the best policy. But it can speed up or slow down *learning* a great
# deal. **Tabular Q-learning** stores one estimate of $Q$ for each state and action and corrects it after every step.
#
# The chart below compares seven potentials in a grid of ten by ten cells. The goal in the lower right corner pays 1 and
# all other steps 0, with $\gamma$ = 0.95. All estimates of $Q$ start at 0. The bars count the steps until the learned
# path is a shortest one (18 steps).
#
# Minus the distance is the slowest. By far the fastest are the potentials that rise towards the goal and lie between 0
# and the true value $V$: they lead the learner almost straight to the goal.
#
# <details><summary>Which potentials help, and why minus the distance starts too low</summary>
#
# The bars of the fastest are equal because the path is tested only every 20 steps. For Q-learning, shaping with $\Phi$
# has the same effect as starting with $Q = \Phi$, if its exploration depends only on differences of $Q$ (Wiewiora
# 2003). What helps is the *shape* of the true value: a potential between 0 and $V$ that rises towards the goal as $V$
# does leads almost straight there, even scaled down to a hundredth.
#
# A potential above the true values is optimistic: everything has to be tried before its estimate falls. Minus the
# distance starts every value too low. The first action that is tried then rises, the untried ones stay low, and the
# learner repeats the first one instead of exploring. That holds for this reward: if each step cost 1 and $\gamma$ were
# one, minus the distance would be $V$ itself.
#
# </details>
#
# Lying between 0 and $V$ isn't enough. A potential that falls on the way to the goal makes learning slower:

# %% tags=["hide-code"]
world = grid(10)
true_value = value_iteration(world).value
in_left_half = np.where(np.arange(100) % 10 < 5, true_value, 0.0)
for name, phi in (
    ("0 everywhere", 0.0 * in_left_half),
    ("V in the left half, 0 in the right", in_left_half),
):
    learner = shaped(world, phi)
    seeds = [np.random.default_rng(k) for k in range(15)]
    taken = [sim_to_real.learning_steps(learner, seed, 18, at_most=300_000) for seed in seeds]
    print(f"potential {name:<35} median of 15 runs: {np.median(taken):6,.0f} steps")

# %% [markdown]
# ![Steps of learning by potential](../docs/charts/shaping_speed.png)
#
# <div class="alert alert-block alert-warning">
#
# **Key insight.** A difference of potentials telescopes, if it is discounted as the rewards are. What is left depends
# only on the start, the end, and when the end comes. So make the potential zero at every terminal state, and at a time
# limit if the learner counts it as an end. Then the best policy can't change.
#
# </div>

# %%
more_claims("shaping_keeps_the_best", "time_is_an_end")

# %% [markdown]
# ## 4 · Design: a pipeline that loops back
#
# A transfer project is a loop: the logs of each test on the robot go back into identification.

# %% tags=["hide-code"]
steps = (
    "build\nthe simulator",
    "identify\nfrom logs",
    "randomise,\nif it helps",
    "train",
    "test on\nthe robot",
    "fine-tune,\nif needed",
)
axis = diagram(
    (9, 1.7),
    [(1.2 * k, 0, step) for k, step in enumerate(steps)],
    [(k, k + 1, "") for k in range(5)],
)
back = {"arrowstyle": "->", "connectionstyle": "arc3,rad=-0.25", "color": RED}
_ = axis.annotate("", (1.2, -0.25), (4.8, -0.25), arrowprops=back)
words = "new logs"
_ = axis.text(3.0, -0.95, words, ha="center", color=RED, fontsize=9)
_ = axis.set(ylim=(-1.1, 0.5))
plt.show()

# %% [markdown]
# The red arrow carries the torques that were sent, the angles that came back, and time stamps of both on *one* clock.
#
# <details><summary>The chapter's code follows this loop: what each component takes, returns and rejects</summary>
#
# <table>
# <tr><th>component</th> <th>takes</th> <th>returns</th> <th>rejects or reports</th></tr>
# <tr><td><code>Plants</code>, <code>Ranges</code></td> <td>parameters, or their bounds</td> <td>a batch of arms</td>
# <td>negative mass, crossed bounds, negative delay</td></tr>
# <tr><td><code>rollouts</code></td> <td>arms, gains, tasks</td> <td>success, time inside, error, reason</td> <td>a
# target out of reach; an arm that diverged</td></tr>
# <tr><td><code>fit</code></td> <td>a simulation, a log, a starting guess</td> <td>values, covariance, rank, null
# directions</td> <td>NaN, gaps, two clocks; a value at its bound; a residual with structure</td></tr>
# <tr><td><code>tune</code></td> <td>a function that samples arms</td> <td>gains, number of episodes</td> <td></td></tr>
# <tr><td><code>Process</code></td> <td>transitions, rewards, discount, terminal states</td> <td>values, best
# policies</td> <td>rows that don't sum to 1, a terminal state that pays, a discount of 1</td></tr>
# </table>
#
# </details>
#
# ### A design exercise: the hand that turned a cube
#
# In 2018 and 2019 OpenAI trained a five-fingered hand in simulation only, first to turn a block, then to manipulate a
# Rubik's cube. Thousands of simulated hands (*environments*) ran at once.

# %%
predict("thirteen_thousand_years")

# %% [markdown]
# Now you are the architect: the hand turns an object in its palm to a given orientation.
#
# | | requirement |
# |---|---|
# | degrees of freedom | 24 joints (20 driven), and 6 of the object |
# | computing | 8 GPUs for a week |
# | target | 70 % success or more, zero-shot |
# | objects | some that were not in training |
# | sensors | your choice: cameras, touch, joint angles |
#
# Write two or three sentences on each of five questions before you open what was done: <span class="kernel-only">the
# cell below counts them.</span>

# %%
mine = {
    "1 engine: accurate contacts on CPUs, or more environments on GPUs?": "",
    "2 observations: joint angles, forces, cameras? How real is each in simulation?": "",
    "3 what is randomised, in which ranges, without real data?": "",
    "4 images: photorealistic, or with random colours? Cameras where?": "",
    "5 a curriculum (easy tasks first), or everything at once?": "",
}
for question, words in mine.items():
    print("written " if len(words.split()) > 12 else "   open ", question)

# %% [markdown]
# In simulation you know the true state, on the robot you don't. An **asymmetric actor-critic** uses this. The critic, a
# network that estimates values, is needed only in training and receives the full simulator state. The actor, the policy
# for the robot, receives only what the robot can measure.

# %% tags=["hide-code"]
axis = diagram(
    (7, 1.9),
    (
        (0, 1, "full state\n(simulator only)"),
        (2.4, 1, "critic"),
        (4.6, 1, "value: used in\ntraining only"),
        (0, 0, "what the robot\ncan measure"),
        (2.4, 0, "actor"),
        (4.6, 0, "action: goes to\nthe robot"),
    ),
    ((0, 1, ""), (1, 2, ""), (3, 4, ""), (4, 5, "")),
)
plt.show()

# %% [markdown]
# *What OpenAI did.* Paper A is arXiv 1808.00177 (2018, a block), paper B is arXiv 1910.07113 (2019, a Rubik's cube).
#
# <details><summary>1 Engine</summary>
#
# Both used MuJoCo (A, section 2.2; B, section 4). In A, 384 machines with 16 processor cores each, and one machine with
# 8 GPUs, produced about 2 years of experience per hour (section 4.3). In B it was 920 machines with 32 cores each and
# 64 V100 GPUs for several months (section 6.3). The "13 thousand years" of B are *simulated experience*. The 6,144
# cores often quoted for the cube belong to A.
#
# *Rubric:* count contacts per second at the accuracy that the task needs, not environments per second. Have a plan for
# what the simulated contacts can't do. Count the experience needed with randomisation: A needed 3 years without it and
# about 100 with it (section 6.3).
#
# </details>
#
# <details><summary>2 Observations</summary>
#
# A's policy observed fingertip positions from motion capture, the object's position, and the remaining rotation to the
# goal (table 2). It had neither touch nor joint angles: those sensors were judged too hard to model (section 3.1). The
# critic observed the full simulator state. B did the same; joint angles go to the value network only (table 1). The
# hand has 24 degrees of freedom, of which 20 are driven (A, section 2.1).
#
# *Rubric:* know each sensor's error on the robot, and whether the simulator can produce that error. Give the actor
# nothing that the robot lacks. Give it memory: after 5 s, A's recurrent state reveals in 80 % of cases whether the
# block is larger than average (section 6.4).
#
# </details>
#
# <details><summary>3 Ranges</summary>
#
# A chose ranges by hand around calibrated values: masses times 0.5 to 1.5, friction times 0.7 to 1.3, damping times 0.3
# to 3, gains times 0.75 to 1.5 (table 1), and delays, backlash, noise. B used **automatic domain randomisation**, which
# moves each end of a range by the policy's success there. It starts at the calibrated values. Each boundary has a
# buffer of 240 episodes. With a mean of 20 successes per episode or more the boundary moves outward by 0.02; with 10 or
# fewer it moves back *in* (table 15).
#
# The paper lists no final ranges: they are a result of training. The parameters are named in table 9.
#
# *Rubric:* calibrate first. Take ranges from repeated calibrations, then widen them as far as training allows, and test
# each range. In B, table 3, manual ranges on the new setup gave a mean of 2.7 successes of 50, automatic ones 13.3
# after the same training. A's old policy, tested again a year later, had dropped from 18.8 to 4.0.
#
# </details>
#
# <details><summary>4 Images</summary>
#
# Three RGB cameras around the cage (A, section 5.1; B, section 7.1). None at the wrist, where fingers hide the object.
# A separate network estimates a pose; the policy never receives a pixel. Rendering was plain, its appearance random.
# Without that randomisation the orientation error on real images was 129 degrees, with it 7.8 (B, table 2).
#
# *Rubric:* know the error of the pose estimate, inject that error in the policy's training, and test the estimator on
# its own. The papers don't say that this split mattered most. A names randomisation with calibration, memory, and scale
# (section 1).
#
# </details>
#
# <details><summary>5 Curriculum, and the result</summary>
#
# The physics is the curriculum: with fixed wide ranges from the start, learning took far longer (B, figure 16). The
# goals are not: flips and single face turns were sampled from the first day (section 6.1). Nobody learned to solve the
# cube: a solver says which face to turn next (section 2.2).
#
# Result (B, table 6): of 10 trials, 60 % completed half a scramble and 20 % all of it, with the cube's own sensors for
# its faces; with vision alone 20 % and none. A, table 3: a median of 13 rotations of the block in a row, and of 5 for a
# prism. A sphere failed (section 6.2). So 70 % on unseen objects asks for more than was shown.
#
# *Rubric:* report success by difficulty, with the number of trials.
#
# </details>
#
# A solver prescribed the moves that undo a *scramble*, the turns that mixed the cube. The hand had to execute all of
# them, or at least half. The result rests on few trials: ten with sensors inside the cube for its faces, ten with
# cameras alone.

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(5, 1.7), layout="constrained")
solved = {"sensors, half": 6, "sensors, all": 2, "cameras, half": 2, "cameras, all": 0}
for row, (what, k) in enumerate(solved.items()):
    low, high = wilson(k, 10)
    print(f"{what} of a scramble: {k} of 10; the true rate is between {low:.2f} and {high:.2f}")
    _ = axis.plot([low, high], [row, row], lw=6, color="#9fa8da")
    _ = axis.plot(k / 10, row, "o", color="#1a237e")
_ = axis.set(
    xlim=(0, 1), xlabel="true success rate, 95 % interval", yticks=range(4), ylim=(3.6, -0.6)
)
_ = axis.set_yticklabels([f"{what}: {k} of 10" for what, k in solved.items()])
plt.show()

# %% [markdown]
# ### World models
#
# A **world model** predicts what comes next, $s' = f(s, a)$. A physics engine is a written one, a neural network can be
# a learned one. A written model with a wrong term stays wrong, however long the log is. A learned one is unreliable for
# motions that are not in its data.
#
# We try one simple learned model on the twin, linear in fifty features of recent angles and torques. It competes with
# our arm's equations, fitted with friction and delay (*our arm*) and without them:
#
# ![Error of predicted motions against the length of the log](../docs/charts/learned_model.png)
#
# With 1 or 3 s of log the learned model runs away (the triangles at the upper edge). With 10 s or more it beats the
# equations without friction and delay. But fitted to 3 s or more, the equations with friction and delay are clearly
# better than either of the other two models, even with its best log. (Each point averages only two logs; a better
# learned model may do better.) A common third approach keeps the equations and learns only what they miss.
#
# ### A learned actuator
#
# Often only one component is hard to describe. A drive receives a desired angle and produces a torque. Between them lie
# a delay, the lag of the current, a limited voltage, and friction. Hwangbo and others (2019) recorded a drive and
# fitted an **actuator network**. It predicts the torque from a short history of position error and speed. We do the
# same with a simulated drive, whose true torque is known.
#
# ![Torque error of three actuator models, and time](../docs/charts/actuator_models.png)
#
# The *ideal drive* produces the commanded torque at once. *Lag and friction* is a formula with delay, lag and dry
# friction, fitted to the same recording as the network. The network has the smallest median error in every row. But the
# formula lacks the voltage limit and the larger friction at rest; with both it might be as good.
#
# The network's own error grows where the recording has no data: several times on faster motions. So record the motions
# that the policy will meet. The right panel shows the price in computing time, for networks with 2 to 64 units in a
# layer (on other recordings than the left panel).
#
# <details><summary>The rows of the chart</summary>
#
# Targets that move faster multiply the errors of both models. At half the supply voltage the network's median stays,
# but the error that nine of ten runs stay below (the right end of the bar) grows a lot.
#
# </details>
#
# <details><summary>What about gradients?</summary>
#
# MJX, MuJoCo in JAX, differentiates its own steps exactly. That is the slope of the *simulation*. At contacts it may
# even have another sign than the slope of the true motion; chapter 1 shows it with a bouncing ball.
#
# </details>
#
# ### Domain adaptation and a transfer bound
#
# **Domain adaptation** is the general problem: learn in a source domain and work in a target domain. A
# **transfer bound** limits how much the value of a policy can differ between two worlds. Let both worlds pay the same
# rewards, between 0 and $R$, which don't depend on the next state. For any state, any action and any set of next
# states, let the probability of reaching this set differ between the worlds by at most $\epsilon$ (the *total
# variation*).
#
# Let $V_\pi$ and $V'_\pi$ be what one policy $\pi$ earns on average in the two worlds, with discount. Then
#
# $$|V_\pi - V'_\pi| \le \frac{\gamma\,\epsilon\,R}{(1-\gamma)^2} .$$
#
# Why is the denominator squared? With probability $\epsilon$ the next state is a wrong one. This costs at most
# $\gamma R/(1-\gamma)$: the largest possible value, one step later. And it can happen again at every step, which brings
# the second factor $1/(1-\gamma)$. The process in the drawing below comes close to this bound if $\epsilon$ is much
# smaller than $1-\gamma$ (chart).
#
# <details><summary>How to derive it, and a chain that comes close to it</summary>
#
# How large can a value be, and how much can its expectation differ between two distributions? Write $V_\pi-V'_\pi$ as
# $\gamma$ times one such difference plus $\gamma$ times the expected $V_\pi-V'_\pi$ one step later. Take the maximum on
# both sides and solve.
#
# Take two states. One pays $R$ and stays, for ever in the simulator, while the real one leaves it for good with
# probability $\epsilon$. Its share of the bound is $(1-\gamma)/(1-\gamma(1-\epsilon))$, which tends to one as
# $\epsilon$ tends to zero.
#
# </details>

# %% tags=["hide-code"]
axis = diagram(
    (5.5, 1.3),
    ((0, 0, "good state: pays $R$,\nstays otherwise"), (3.5, 0, "bad state:\npays 0 for ever")),
    ((0, 1, r"probability $\epsilon$ (real), 0 (simulator)"),),
)
plt.show()

# %% [markdown]
# ![Share of the bound that the process in the drawing reaches](../docs/charts/bound_reached.png)
#
# <details><summary>When the bound says nothing</summary>
#
# If the two worlds never reach the same next state, $\epsilon$ is 1. With $\gamma$ above one half the bound is then
# larger than $R/(1-\gamma)$, the largest possible value, and says nothing. Our arm is such a case: a slightly heavier
# arm almost never reaches exactly the same next state.
#
# </details>
#
# <details><summary>Would a network that is pretrained on many simulated robots transfer to a new one?</summary>
#
# A common argument: pretraining on ImageNet, a large set of photographs, transfers to medical images although the two
# look nothing alike. So a "PhysicsNet", pretrained on many simulated robots, should transfer to a new robot. Answer
# before you read on: what could it learn that holds for the new robot as well?
#
# The first sentence is true only in part. Raghu and others (*Transfusion*, NeurIPS 2019, arXiv 1902.07208, read as an
# abstract) tested it on two large medical tasks. Pretraining improved the performance little, and small simple networks
# did about as well. Part of the benefit came from the scale of the weights alone, not from reused features.
#
# The same question decides about the PhysicsNet. What all arms share can transfer: the form of the equations of motion,
# and that a contact only pushes. What differs has to be measured on the new robot: masses, friction, delay. The
# *student* of section 3 does both on a small scale. It was trained on many simulated arms and estimates from the last
# 0.4 s which arm it moves. Inside the range of its training it serves most arms well, though not those without a load.
# At twice the largest load of its training it fails.
#
# </details>
#
# ## 5 · Code, and the simulation in full
#
# ### Common mistakes in randomisation code
#
# A typical randomiser scales or samples the model's parameters and calls MuJoCo's function `mj_setConst`, which
# computes many derived constants again:
#
# ```python
# model.body_mass *= rng.uniform(0.8, 1.2, model.nbody)            # new masses
# model.geom_friction[:, 0] = rng.uniform(0.5, 1.5, model.ngeom)   # new friction
# model.dof_damping *= rng.uniform(0.5, 2.0, model.nv)             # new damping
# mujoco.mj_setConst(model, data)                                  # derived constants
# waiting = deque([rest] * k, maxlen=k)                            # a delay of k steps
# ```
#
# Each line runs, and each has a trap.
#
# - *Line 1, masses:* MuJoCo stores a body's mass and inertia separately, so scale `body_inertia` by the same factor.
#   And `*=` starts from the mass of the last episode: the factors of all episodes pile up. Multiply the default
#   instead.
# - *Line 2, friction:* a contact joins two geoms (the shapes that can touch), and MuJoCo by default uses the larger of
#   their two coefficients. So a low sample has no effect where the other geom is rough.
# - *Line 3, damping:* a factor on zero leaves zero, and zero is the default. Factors pile up here as well.
# - *Line 4, constants:* `mj_setConst` also overwrites the simulation state (`MjData`) that you pass. So pass a spare
#   copy.
# - *Line 5, delay:* the delay depends on whether you append the new action before or after you read the oldest one. And
#   for a sampled delay of $k = 0$ there is no entry to read: the program stops with an error.

# %%
show("set_const_inertia")

# %% [markdown]
# How long does an entry wait in such a queue? In the drawing, the queue is first filled with commands to rest (-). Each
# step appends the new action on the right, as `deque.append` does, then uses the oldest one, on the left.

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(6.5, 1.8), layout="constrained")
for step in range(4):
    for slot, entry in enumerate((step - 1, step)):
        box = plt.Rectangle((2 * step + 0.8 * slot, 0), 0.75, 0.6, fc="#e8eaf6", ec=BLUE)
        axis.add_patch(box)
        words = f"$a_{entry}$" if entry >= 0 else "-"
        _ = axis.text(2 * step + 0.8 * slot + 0.37, 0.3, words, ha="center", va="center")
    _ = axis.text(2 * step + 0.75, 0.8, f"step {step}", ha="center", fontsize=9)
    _ = axis.text(2 * step + 0.37, -0.3, "used", ha="center", fontsize=8, color=RED)
_ = axis.set(xlim=(-0.2, 8), ylim=(-0.5, 1.1))
_ = axis.set_title("a queue with two slots: oldest left, newest right", fontsize=9)
axis.axis("off")
plt.show()

# %%
show("queue_of_k")

# %% [markdown]
# In the exercise `randomize` you write a correct version. Training at scale also needs a vectorised environment: a
# class that steps many copies of a task and resets those whose episode has ended (exercise `vector_env`).
#
# In the first panel below, computing all copies in one array (*ArmReachVector*; with MuJoCo *mujoco.batch*) is faster
# than a loop over the copies (*SyncVectorEnv*), even on one thread. (*Closed form*: our own equations.) In the second
# panel Runge-Kutta meets the tolerance with one substep, Euler needs many.
#
# In the third panel two processes (*ProcessVectorEnv*) lose against a loop (*VectorizedEnv*) where one step is cheap,
# because waking them takes time. Right of the dotted line they win a little, except at the last point.
#
# <details><summary>The traps of a vectorised environment are at the ends of episodes</summary>
#
# One flag `done` can't tell a finished task from a time limit. And the last observation has to survive the reset,
# because a learner bootstraps from it: `final_obs` in Gymnasium 1, `terminal_observation` in Stable-Baselines3.
#
# </details>
#
# ![Steps per second by number of environments, accuracy, and when processes pay](../docs/charts/vector_env.png)
#
# <details><summary>How to read the chart</summary>
#
# The first panel counts environment steps per second. *MujocoArmReachVector* uses two threads, all loops use one, and
# *mujoco.batch on one thread* is drawn for a fair comparison with them. Processes pay if processors are free, all
# environments cost about the same, and one step is expensive or each process steps many environments. The dotted line
# in the third panel marks where the measured curves cross. To its right two processes could save up to half of the
# time. Here they save less, perhaps because other programs used the second core during the measurement; we did not
# measure why. *AsyncVectorEnv*, with a process for each environment, never beat the loop here.
#
# </details>

# %%
more_claims(
    "friction_of_each_geom",
    "scaled_damping",
    "vector_one_done_flag",
    "vector_one_step_test",
    "mass_without_set_const",
    "set_const_data",
    "set_const_compiles",
    "mass_and_period",
    "one_geom_friction",
    "friction_in_all_directions",
    "factors_compound",
    "vector_zip_of_actions",
    "vector_same_step_reset",
    "vector_one_seed",
    "vector_processes_pay",
)

# %% [markdown]
# ### The core of the chapter in code
#
# One function copies chosen parameters from the real arm into the simulator. `PARTS` names the fields of each part:
# *load* is `mass` and `payload`. `KINDS` groups parts: *dynamics* is load, friction and motor.

# %% tags=["hide-code"]
Markdown(f"```python\n{inspect.getsource(transfer.mended)}```")

# %% [markdown]
# Invalid input is rejected with a message that names it:

# %% tags=["hide-code"]
for attempt in (
    lambda: Plants(mass=-1.0),
    lambda: Ranges({"payload": (0.5, 0.1)}),
    lambda: real(0.3, -0.01),
    lambda: Log(log.times, np.where(log.times > 1.0, np.nan, log.measured), log.command),
    lambda: Process(0.9 * P, R, 0.95, ends),
    lambda: fit(arm, log, logs.GUESS, {"a": (2.0, 1.0)}),
):
    try:
        attempt()
    except ValueError as problem:
        print(textwrap.fill(str(problem), 96))

# %% [markdown]
# ### The simulation, with everything you now know
#
# The simulated motion is drawn over the right arm as a shadow. Say what will happen before you choose a preset:
#
# 1. *Gap and range*: what does randomisation cost on the left?
# 2. *Delay beyond the margin*: at which delay does the arm begin to fail? Compare it with *longest stable delay*.
# 3. *Cancelling errors*: load and delay partly cancel. What happens on the right when you reduce the gap to zero?
# 4. *Mended delay alone* (only the delay corrected): then correct the load as well.

# %%
simulation("arms", "Cancelling errors")

# %% [markdown]
# ## 6 · Speed and accuracy of identification
#
# Here the methods of section 2 and MuJoCo's own tool, `mujoco.sysid`, estimate the same five parameters from the same
# logs. *Differentiated* is the plain regression. Suppose that you need an error below 1 % (dotted line).
#
# ![Error of the parameters against noise, and against time, by method](../docs/charts/what_finds_the_numbers.png)
#
# <details><summary>The methods in a table, and the circle</summary>
#
# The circle marks the fastest result that is at least a fifth below the limit, because another log can be worse. The
# integral form still needs the speeds in the terms of $b$, so there it differentiates the angle once.
#
# <table>
# <tr><th>method</th> <th>what it does to the angles</th> <th>solves</th> <th>choose it when</th></tr>
# <tr><td>differentiated regression</td> <td>two central differences</td> <td>linear least squares</td> <td>only with
# nearly noise-free angles or long samples</td></tr>
# <tr><td>filtered regression</td> <td>smooths, then differentiates; filters torques alike</td> <td>linear least
# squares</td> <td>you know the bandwidth of motion and noise</td></tr>
# <tr><td>integral (weak) form</td> <td>multiplies by test functions, integrates by parts</td> <td>linear least
# squares</td> <td>about 1 % accuracy is enough, or you need a first guess</td></tr>
# <tr><td>output error</td> <td>nothing; simulates instead</td> <td>nonlinear least squares</td> <td>you want the
# best accuracy, or fit a delay</td></tr>
# </table>
#
# </details>
#
# The two filtered regressions differ in the length of their filter: a short filter passes noise, a long one distorts
# the motion, even without noise. In the right panel the 40 ms filter gets below 1 % only with the longest log. The
# integral form gets there with a log a quarter as long, in about the same computing time (circle). Output error is
# the most accurate: its error approaches the Cramér-Rao bound. But it needs a starting guess.
#
# `mujoco.sysid` solves the same problem. It is slower, but it fits any MuJoCo model.

# %%
show("same_as_mujoco")

# %% [markdown]
# ## 7 · Debug: where it fails
#
# ### How large must a model error be before the residual reveals it?
#
# In the picture a missing effect grows from left to right. The curves show the true error and the half-width that the
# fit claims. In the grey area the whiteness test raises the alarm in more than half of eight logs:
#
# ![True error, claimed error and alarm against the size of the missing effect](../docs/charts/believed_error_bars.png)
#
# The true error exceeds the claimed one *before* the alarm sounds. The remedy is a second log with other torques,
# fitted by itself. If the fits differ by clearly more than their half-widths explain, a term is missing, a recording is
# wrong, the noise is not independent, or the robot has changed.
#
# <details><summary>How large a difference may be</summary>
#
# If $h_1$ and $h_2$ are the half-widths of a parameter in the two fits, the half-width of its difference is
# $\sqrt{h_1^2 + h_2^2}$. With five parameters chance has five opportunities, so allow 1.3 times as much.
#
# </details>
#
# ### Break it: one gripper, several faults
#
# A gripper hangs from a frame, which a servo (a position controller) moves up and down. It lowers two fingers around
# a box, closes them with a fixed force, and lifts. A model of the gripper sets force and servo. In each row of the
# table below, something in this model is wrong. Which of these errors make the lift fail?
#
# Each finger presses with the force $F$. Dry friction with the coefficient $\mu$ then lets it carry at most $\mu F$
# upward (Coulomb's law). The two fingers together carry the weight and accelerate the box. So the required force is
# inversely proportional to $\mu$: assume a third of the true friction, and you squeeze three times too hard. A margin
# on the force, here 1.2, covers small errors of $\mu$.

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(5.5, 2.6), layout="constrained")
axis.add_patch(plt.Rectangle((-0.5, 0), 1, 1, fc="#ffe0b2", ec="#e65100"))
for side in (-1, 1):
    axis.add_patch(plt.Rectangle((side * 0.6 - 0.1, 0.1), 0.2, 1.4, fc="#cfd8dc", ec=GREY))
    push, up = (
        {"arrowstyle": "->", "color": BLUE, "lw": 2},
        {"arrowstyle": "->", "color": GREEN, "lw": 2},
    )
    _ = axis.annotate("", (side * 0.72, 0.5), (side * 1.4, 0.5), arrowprops=push)
    _ = axis.text(side * 1.5, 0.5, "$F$", ha="center", va="center", color=BLUE)
    _ = axis.annotate("", (side * 0.42, 0.95), (side * 0.42, 0.4), arrowprops=up)
    _ = axis.text(side * 0.25, 0.7, r"$\mu F$", ha="center", color=GREEN)
_ = axis.annotate("", (0, -0.5), (0, 0.3), arrowprops={"arrowstyle": "->", "color": RED, "lw": 2})
_ = axis.text(0.1, -0.35, "weight $m g$", color=RED)
_ = axis.annotate("", (0, 1.55), (0, 1.1), arrowprops={"arrowstyle": "->", "color": GREY, "lw": 2})
_ = axis.text(0, 1.62, "acceleration $a$", ha="center", color=GREY)
_ = axis.set(xlim=(-1.8, 2.4), ylim=(-0.6, 1.8), aspect="equal")
axis.axis("off")
plt.show()

# %%
show("friction_wrong_both_ways")

# %% [markdown]
# The box must also be between the fingers before they close. So the camera's error plus the box's must not exceed the
# free width, the space between the box and an open finger on each side (less if the grip is too weak to push the box).
# And the time step must be short enough for the stiffest contact, which the simulator treats as a spring.

# %% tags=["hide-code"]
from course.oracles.mujoco import lab

stiff, slick, rough = (-50000.0, -450.0), lab.Lab(friction=1.2), lab.Lab(friction=0.3)
toggles = {
    "nothing": (lab.Lab(), "lifts", "-"),
    "step of 20 ms, default contacts": (lab.Lab(dt=0.02), "explodes", "halve the step"),
    "step of 20 ms, stiff contacts": (
        lab.Lab(dt=0.02, solref=stiff),
        "explodes",
        "compute the largest stable step",
    ),
    "friction assumed 1.2, real 0.4": (
        replace(lab.tuned(slick), friction=0.4),
        "slips",
        "a slip test",
    ),
    "friction assumed 0.3, real 0.9": (
        replace(lab.tuned(rough), friction=0.9),
        "crushes (our box is rigid)",
        "a force sensor",
    ),
    "box 10 % heavier": (lab.Lab(mass=0.55), "lifts 10 % less", "torque while holding it"),
    "camera off by 20 mm": (lab.Lab(offset=0.02), "misses", "touch a known point"),
    "camera off by 30 mm": (lab.Lab(offset=0.03), "misses", "touch a known point"),
    "camera off by 20 mm, box 10 % heavier": (
        lab.Lab(offset=0.02, mass=0.55),
        "misses",
        "test each fault alone",
    ),
}
rows = [("what is wrong", "common prediction", "boxes held", "95 % interval", "how to detect it")]
scenes = [scene for scene, _, _ in toggles.values()]
n_held = from_record("sim_to_real.boxes_held", lambda scene: lab.trials(scene, 20), scenes)
for (name, (_, report, caught)), held in zip(toggles.items(), n_held, strict=True):
    low, high = wilson(held, 20)
    rows.append((name, report, f"{held} of 20", f"{low:.2f} to {high:.2f}", caught))
heavy, light = (lab.lift(lab.Lab(mass=m)).error for m in (0.55, 0.5))
print(
    f"a box 10 % heavier is lifted {100 * (heavy - light) / lab.Lab().height:.1f} % less high with this servo;"
)
print(f"free width on each side of the box: {1e3 * lab.Lab().opening:.0f} mm")
table(*rows)

# %% [markdown]
# Each row counts 20 lifts. The boxes lie up to 15 mm off, and their mass varies by 5 %. The camera's error adds to
# that, so at 20 mm some lifts fail. (In the chart below the box lies in the middle, so the limits are sharp.)
#
# <details><summary>Several common predictions are wrong here, and why</summary>
#
# A step of 20 ms doesn't make the simulation explode with MuJoCo's default contacts, because MuJoCo softens contacts
# that are too stiff for the step. With stiff contacts set by hand the grip does fail. A box that is 10 % heavier is
# lifted almost as high, because the servo controls the height. Whether a box is crushed, the model can't show: its box
# is rigid.
#
# </details>
#
# The charts below vary each fault beyond its limit. The first one divides the force by the force that the box needs:
# below 1 the box slips. A force that is far too *large* makes the closing fingers knock the box out. (Lost boxes are
# drawn at 200 mm.) The servo also has a longest time step (third panel), but with default contacts some lifts fail at
# shorter ones, perhaps because a closing finger sinks too deep (last panel).
#
# ![Grip, camera and step, swept to both sides of their limits](../docs/charts/break_it.png)
#
# <details><summary>The force, and the time step: two limits, and lifts that fail below one of them</summary>
#
# In the first panel 3.6 is the force of the row *friction assumed 0.3, real 0.9*: three times too large, times the
# margin of 1.2. Don't transfer the upper limit of the force to a real gripper, whose contacts are harder.
#
# The panel about the time step marks two limits: of the stiff contact, and of the servo, which is a sampled control
# loop. Some lifts with default contacts fail below the limit of the servo; the other limit doesn't concern them. The
# last panel suggests why: at its longest step a closing finger sinks much deeper into the box than at shorter ones, and
# may push it out. How deep depends on how far the finger is from the box when the step begins, so a slightly longer
# step can lose fewer boxes.
#
# </details>

# %% tags=["hide-code"]
omega_dt = np.sqrt(5e4) * 0.02
step = np.array([[1.0 - omega_dt**2, omega_dt], [-omega_dt, 1.0]])  # semi-implicit Euler
radius = np.abs(np.linalg.eigvals(step)).max()
Markdown(rf"""<details><summary>How fast does the energy of a contact grow if the step is too large?</summary>

You may read that the energy grows by a factor $1 + \Delta t^2 k/m$ per step, where $\Delta t$ is the step, $k$ the
stiffness of the contact and $m$ the mass. That is the factor of explicit Euler, which moves the position with the *old*
speed. It grows at every step size, and MuJoCo doesn't use it. Semi-implicit Euler uses the *new* speed. With it the
energy of an undamped spring stays bounded as long as $\omega\,\Delta t$ is below 2, where $\omega = \sqrt{{k/m}}$.
Above that threshold it can grow even faster. At $\omega\,\Delta t$ = {omega_dt:.2f} the energy grows per step
by a factor of {1 + omega_dt**2:.0f} with explicit Euler, and of {radius**2:.0f} with semi-implicit Euler.

</details>""")

# %%
more_claims("large_step_at_contact", "camera_off")

# %% [markdown]
# Do the losses of several faults add up? Here the two-link arm runs again, with a larger target than in section 1. Each
# switch gives it a fault, and each dot is a combination of switches. On the dashed line a combination costs the sum of
# its separate losses. (*Control step*: the time between two commands.)

# %%
simulation("faults")

# %% [markdown]
# Mostly they nearly add up. The exception is the long control step with the camera's error (dots far above the line):
# the camera's error uses up the tolerance, and the oscillation of the long step leaves the target.
#
# <details><summary>Which pairs interact, and what exactly the switches change</summary>
#
# The switches set the control step to 20 ms instead of 10 ms, add dry friction to both joints, make both links 10 %
# heavier, shift the camera's target by 2 cm, and replace gains tuned on range 0.4 by gains tuned without randomisation.
# All 32 combinations run the same reaches. The target and the gains differ from those in section 1, and so do the
# losses.
#
# Friction reduces the loss from a long step, because it damps the oscillation. It also reduces the loss from the higher
# gains of a search without randomisation. The heavier links interact with no other single fault noticeably. With the
# long step and the camera's error together, they reduce the loss.
#
# </details>

# %%
more_claims("losses_add", "feedback_and_offset")

# %% [markdown]
# ### Debugging: replay the log
#
# <div class="alert alert-block alert-info">
#
# **Interview question.** *Your policy succeeds in 95 % of its episodes in simulation, and in 20 % on the real robot.
# Describe how you find out why.*
#
# Answer aloud. The answer is in section 10.
#
# </div>
#
# The most useful tool is a replay. Record commands, angles and time stamps on the robot. Set the simulator to the
# logged angles and the speeds estimated from them. Send it the same commands for a few tenths of a second, then restart
# it from the log. (A longer replay drifts even with the right parameters, because small errors of the start
# grow.) Where do the two motions begin to differ?

# %% tags=["hide-code"]
axis = diagram(
    (9, 3.2),
    (
        (0, 1.5, "replay the\nrecorded commands"),
        (3, 3, "late by a constant"),
        (6.6, 3, "delay or time stamps: correlate residual and speed"),
        (3, 2, "right at first,\nthen drifts away by more\nthan the start error explains"),
        (6.6, 2, "dynamics: fit the parameters, look at the residual"),
        (3, 1, "right until contact"),
        (6.6, 1, "contact: friction, stiffness, geometry"),
        (3, 0, "right all along"),
        (
            6.6,
            0,
            "look at what the policy observed, and when:\na replay doesn't use the policy's inputs",
        ),
    ),
    (
        (0, 1, ""),
        (1, 2, ""),
        (0, 3, ""),
        (3, 4, ""),
        (0, 5, ""),
        (5, 6, ""),
        (0, 7, ""),
        (7, 8, ""),
    ),
)
_ = axis.set(xlim=(-1, 9))
plt.show()

# %% [markdown]
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *It works in simulation and fails on the robot.* Replay the recorded commands first. Then put
# everything that you found into the simulator, run the *policy* there, and see whether it fails as the robot does.
#
# <details><summary>What people get wrong here</summary>
#
# They replay only the commands. A policy reacts, and its errors feed back. Open-loop replay of a slow arm may hide a
# delay that makes the closed loop oscillate.
#
# </details>
#
# </div>
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *It is robust in simulation and brittle on the robot.* Identify the robot once. If its parameters
# lie inside the ranges, look for another cause before you widen them.
#
# <details><summary>The four possibilities, and what people get wrong here</summary>
#
# The robot is outside the ranges or at their edge: then wider ones may help. The simulator lacks an effect: randomising
# other parameters won't produce backlash. The ranges are so wide that the policy does nothing well. Or the sampled
# parameters never reached the simulation: log them.
#
# They widen the ranges. In section 3 the arm at gap 0.3 and 10 ms is inside range 0.4, and wider ranges help it only a
# little. In the chart there, range 1 brings little more than range 0.4 where the gap is large: a load needs other
# gains, not more cautious ones.
#
# </details>
#
# </div>
#
# ### Backlash: a limit cycle that lower gains didn't stop
#
# While the motor of a gear with backlash crosses the free play, it doesn't move the link. With the encoder on the
# motor's side, the controller never notices the play, and the motor settles. With the encoder on the link's side, the
# controller observes the error, pushes the motor across the play, overshoots, and pushes back. This repeats as a
# **limit cycle**, an oscillation of steady amplitude.
#
# We watch a joint without dry friction under a PD controller for 20 s. The play is 4, 10 or 40 mrad; at 40 mrad we also
# divide the gains by 2, 10 and 30: six runs with each encoder.

# %% tags=["hide-code"]
axis = diagram(
    (7.5, 1.5),
    (
        (0, 0, "motor"),
        (1.8, 0, "gear with play"),
        (3.6, 0, "link"),
        (0, -1, "encoder on the motor"),
        (3.6, -1, "encoder on the link"),
    ),
    ((0, 1, ""), (1, 2, ""), (0, 3, ""), (2, 4, "")),
)
plt.show()

# %% tags=["hide-code"]
from course.control import Controller, Gains
from course.oracles.mujoco.twin import PLAIN, Twin

figure_, axis = plt.subplots(figsize=(6, 2.2), layout="constrained")
start = np.array([[0.2], [1.2]])
swings = {"link": [], "motor": []}
swings["motor, larger step"] = []
plays = ((0.004, 1), (0.01, 1), (0.04, 1), (0.04, 2), (0.04, 10), (0.04, 30))
# The first two begin inside the play; the third has to cross it three times over.
sides = (("link", "-", 0.3), ("motor", ":", 0.3), ("motor, larger step", "", 3.0))
for play, lower in plays:
    for side, style, away in sides:
        numbers = ((50.0 / lower, 5.0 / lower), (20.0 / lower, 1.0 / lower))
        laws = [Controller(Gains(kp, 0.0, kd, 0.005), 0.01) for kp, kd in numbers]
        goal = start[:, 0] + away * play

        def law(k, observed, laws=laws, goal=goal):
            desired = zip(laws, goal, observed[:, 0], strict=True)
            return np.array([[c.update(x, y)] for c, x, y in desired])

        loose = replace(PLAIN, armature=0.03, backlash=play, encoder=side.split(",")[0])
        q = Twin(loose, threads=1).run(law, start, 2000)[0][1, 0]
        swings[side].append(np.ptp(q[1000:]) / play)
        if style and play == 0.04 and (lower == 1 or (lower == 10 and side == "link")):
            link = "full" if lower == 1 else "1/10"
            label = f"encoder on the {side}, gains {link if side == 'link' else 'full or 1/10'}"
            _ = axis.plot(0.01 * np.arange(600), (q[:600] - goal[1]) / play, style, label=label)
_ = axis.set(xlabel="time [s]", ylabel="error, in units of the play", ylim=(-0.8, 1.1))
_ = axis.legend(fontsize=7, ncols=2)
_ = axis.set_title("error of the link with 40 mrad of play: the first 6 s of 20", fontsize=9)
plt.show()
# As counts: the last digits of these swings differ between processors.
large, small = (sum(x > 0.6 for x in swings["link"]), sum(x < 0.05 for x in swings["motor"]))
print("swing of the link in the last 10 s of 20:")
print(f"encoder on the link: more than 0.6 of the play in {large} of {len(swings['link'])} runs")
print(f"encoder on the motor: less than 0.05 of the play in {small} of {len(swings['motor'])} runs")
rattles = sum(x > 0.2 for x in swings["motor, larger step"])
print("encoder on the motor, after a step of three times the play:")
print(f"    more than 0.2 of the play in {rattles} of 6 runs")

# %% [markdown]
# With the encoder on the link, lower gains make the oscillation slower, but even gains thirty times lower don't stop
# it in 20 s. With the encoder on the motor, these runs begin at rest inside the play, and the controller sees no
# error. So nothing moves, and the link stays beside the target. After a larger step the link, which has no friction,
# goes on rattling inside the play (last line).
#
# <details><summary>Symptoms that are worth learning: cause, test and remedy</summary>
#
# <table>
# <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>remedy</th></tr>
# <tr><td>oscillates about the target at a steady frequency</td> <td>delay beyond the margin</td> <td>lower the gains
# in steps: once the margin exceeds the delay, it stops</td> <td>gains chosen from the margin; less delay</td></tr>
# <tr><td>a limit cycle that lower gains change but rarely stop</td> <td>backlash, encoder on the link</td> <td>compare
# the amplitude with the play</td> <td>encoder on the motor, or a preload: a spring that holds the teeth
# together</td></tr>
# <tr><td>stops short of the target and stays there</td> <td>dry friction; with a PD law the error is at most the
# friction torque over
# $k_p$</td> <td>with a PD law, push the joint slightly to either side: within that error it stays where you leave it,
# from farther away it returns only to this limit</td> <td>friction compensation; integral action, if static friction
# hardly exceeds sliding friction (otherwise the joint hunts, chapter 6)</td></tr>
# <tr><td>a corrected simulator, a worse robot</td> <td>errors that had cancelled</td> <td>correct all parameters
# together</td> <td>use the new policy only if success rose</td></tr>
# <tr><td>tiny error bars, values that differ between logs by far more</td> <td>a missing term, wrong time
# stamps, or noise that is not independent</td> <td>whiteness; another log</td> <td>add the term, correct the stamps, or
# widen the bars</td></tr>
# <tr><td>training looks perfect from the start</td> <td>sampled parameters are never applied</td> <td>log the delay
# that each episode really had</td> <td>the bug hunt of section 8</td></tr>
# </table>
#
# </details>
#
# ## 8 · Exercises
#
# Seven exercises are on this page. Two more, `randomize` and `vector_env`, start from a terminal. `check` runs your
# function on new random cases and tells you what is wrong.

# %%
card("log_uniform")


# %%
def log_uniform(low, high, u):
    """Return log-uniform parameters from uniform numbers."""
    # Uniform between the ends.
    return np.asarray(low) + np.asarray(u) * (np.asarray(high) - np.asarray(low))


check(log_uniform)

# %%
card("output_error")


# %%
def output_error(q, tau, dt, start, guess):
    """Return inertia and damping of a joint that minimise the squared error of simulated angles."""
    # By differences of the angles.
    rate = np.gradient(q, dt)
    return np.linalg.lstsq(np.column_stack((np.gradient(rate, dt), rate)), tau, rcond=None)[0]


check(output_error)

# %%
card("identifiable")


# %%
def identifiable(jacobian, scale, sigma):
    """Return what a log tells of parameters: rank, hidden directions, and error bars."""
    # Each parameter by itself, and all of them seen.
    J = np.asarray(jacobian, dtype=float)
    p = J.shape[1]
    return p, np.zeros((p, p)), sigma / np.sqrt(np.sum(J**2, axis=0) + 1e-30)


check(identifiable)

# %%
card("delay_from_log")


# %%
def delay_from_log(sent, measured, dt, longest):
    """Return how late a measurement follows a command, in parts of a sample too."""
    # From the largest command to the largest measurement.
    return float(dt * (np.argmax(measured) - np.argmax(sent)))


check(delay_from_log)

# %%
card("boundary_update")


# %%
def boundary_update(bounds, centre, outcomes, thresholds, step):
    """Return both ends of each range after their buffers are full."""
    # Wider, whatever happened.
    return np.asarray(bounds, dtype=float) + np.outer(step, [-1.0, 1.0])


check(boundary_update)

# %%
card("shaped_reward")


# %%
def shaped_reward(state, following, reward, terminated, truncated, phi, gamma):
    """Return rewards of logged steps with a potential's difference added."""
    # The potential itself as a reward.
    return np.asarray(reward, dtype=float) + np.asarray(phi, dtype=float)[state]


check(shaped_reward)

# %%
card("tune_randomised")


# %%
def tune_randomised(gains, draws, trained):
    """Return the gains that are best on randomised carts, and what they cost on carts not seen."""
    dt, steps = 0.02, 100
    nominal = {"mass": 1.0, "damping": 0.2, "delay": 0.0}
    cart = dict(nominal)

    def rollout(kp, kd):
        x, v, cost = 1.0, 0.0, 0.0
        for _ in range(steps):
            force = -kp * x - kd * v
            v += dt * (force - cart["damping"] * v) / cart["mass"]
            x += dt * v
            cost += dt * min(x * x, 1.0)
        return cost

    def mean_cost(kp, kd, carts):
        costs = []
        for mass, damping, delay in carts:
            cart.update(mass=mass, damping=damping, delay=delay)
            cart.update(nominal)
            costs.append(rollout(kp, kd))
        return float(np.mean(costs))

    rows, carts = np.asarray(gains, dtype=float), np.asarray(draws, dtype=float)
    costs = np.array([mean_cost(kp, kd, carts[:trained]) for kp, kd in rows])
    best = int(np.argmin(costs))
    kp, kd = rows[best]
    return costs, best, mean_cost(kp, kd, carts[:trained])


check(tune_randomised)

# %% [markdown]
# ### A formula: the grip
#
# Two fingers hold a box of mass `m` by friction `mu` and lift it with the acceleration `a`; gravity is `g`. What is the
# least force of each finger? Equivalent forms count. <span class="kernel-only">Replace the formula in quotation
# marks.</span>

# %%
answer("slip_force", "m*g")

# %%
your_robot(8)

# %% [markdown]
# ## 9 · Frontier: ranges and models that are found automatically
#
# Published methods find the ranges from the policy's success or from real logs, or learn parts of the simulator.
#
# <details><summary>Six works, and what their common summaries get wrong</summary>
#
# <table>
# <tr><th>work</th> <th>year</th> <th>what is new</th> <th>common summary, and what the paper shows</th></tr>
# <tr><td>Automatic domain randomisation (OpenAI, arXiv 1910.07113)</td> <td>2019</td> <td>a range that widens while
# success at its boundary lasts</td> <td>often described as a second agent that learns the ranges; in fact each boundary
# has a buffer and two thresholds</td></tr>
# <tr><td>Closing the loop (Chebotar and others, arXiv 1810.05687)</td> <td>2018</td> <td>ranges moved until simulated
# motions resemble some real ones</td> <td>needs real logs, as identification does</td></tr>
# <tr><td>Active domain randomisation (Mehta and others, arXiv 1904.04762)</td> <td>2019</td> <td>learns to sample
# parameters for which the policy behaves differently than on the nominal model</td> <td>here there really is a second
# agent</td></tr>
# <tr><td>NeRF2Real (Byravan and others, arXiv 2210.04932)</td> <td>2022</td> <td>a scene scanned with a camera and
# rendered for training</td> <td>called a digital twin, but of geometry and appearance only; masses and friction are
# entered by hand</td></tr>
# <tr><td>DINOv2 (Oquab and others, arXiv 2304.07193)</td> <td>2023</td> <td>image features learned without labels</td>
# <td>said to transfer better than pixels, and often does; but what these features ignore may be what your
# task needs</td></tr>
# <tr><td><code>mujoco.sysid</code></td> <td>2026</td> <td>identification that comes with the simulator</td> <td>prints
# confidence intervals, and doesn't say that they assume a correct model</td></tr>
# </table>
#
# (The first row is from the paper, the next four from their abstracts.)
#
# </details>
#
# We run automatic domain randomisation on the arm. It begins at the simulator's parameters. In some episodes one
# parameter is set exactly to an end of its range, and the result goes into the buffer of that end. When the buffer is
# full, its success rate decides: at 90 % or more the end moves outward, at 80 % or less inward, between them it stays.
# Until the buffers are full again, the gains are tuned further on the present ranges.

# %% tags=["hide-code"]
rounds, buffer, move = 60, 128, 0.1


def ranges_after(n):
    """Return the ranges after n rounds of automatic domain randomisation, and the gains."""
    result = sim_to_real.automatic(0, rounds=n, buffer=buffer, step=move, thresholds=(0.8, 0.9))
    return result.ranges.bounds, result.gains


# After five rounds first, which is computed again whenever the page is tested.
_, (bounds, automatic_gains) = from_record("sim_to_real.automatic", ranges_after, (5, rounds))
wide = sim_to_real.around(sim_to_real.nominal(), 1.0).bounds
figure_, axis = plt.subplots(figsize=(7, 2.4), layout="constrained")
rows = [("parameter", "low end", "high end")]
# The fields of `Plants`, with their units.
units = {
    "mass": "mass of the links (factor)",
    "payload": "payload [kg]",
    "viscous": "viscous friction (factor)",
    "coulomb": "dry friction [N m]",
    "torque": "torque of the motors (factor)",
    "bias": "offset of the encoders [rad]",
    "noise": "noise of the encoders [rad]",
    "delay": "delay [s]",
}
for row, (name, (low, high)) in enumerate(bounds.items()):
    middle = getattr(sim_to_real.nominal(), name)[0]
    ends_at = (np.array([low, high]) - middle) / (wide[name][1] - middle)
    _ = axis.plot(ends_at, [row, row], lw=6, solid_capstyle="butt")
    rows.append((units[name], f"{low:.4f}", f"{high:.4f}"))
_ = axis.set(yticks=range(len(wide)), yticklabels=[units[name] for name in wide])
_ = axis.set(xlabel="range found, as a fraction of range 1")
plt.show()
# Each end gets a quarter of its buffer in a round of the search.
updates = rounds // 4
print(f"each end is updated {updates} times and moves by {move} of range 1 each time:", end=" ")
print(f"{updates * move:.1f} at most")
table(*rows)

# %% tags=["hide-code"]
# By hand: three searches. The same ranges as found, but with gains tuned from scratch: two.


def from_scratch(case):
    """Return the gains that a search of so many rounds finds on the ranges."""
    seed, n = case
    sampler = sim_to_real.Ranges({name: tuple(ends) for name, ends in bounds.items()})
    return tune(sampler, seed, rounds=n).gains


_, *again = from_record("sim_to_real.from_scratch", from_scratch, ((0, 2), (0, 20), (1, 20)))
sets = {
    "range 0.4": recorded()["range"][4],
    "range 1": recorded()["range"][10],
    "automatic ranges": np.array([automatic_gains]),
    "the same ranges, tuned from scratch": np.array(again),
}
rows = [("success at gap", *sets)]
for gap in (0.0, 0.3, 1.0):
    rates = [
        rollouts(real(gap, 0.01), gains.T, tasks(1000, 43)).rate.mean() for gains in sets.values()
    ]
    rows.append((gap, *(f"{rate:.2f}" for rate in rates)))
# Three searches of one column, at each gap.
scatter = [
    max(
        np.ptp(rollouts(real(gap, 0.01), sets[name].T, tasks(1000, 43)).rate)
        for name in ("range 0.4", "range 1")
    )
    for gap in (0.0, 0.3, 1.0)
]
print("Range 0.4 and range 1 are means of three searches. These three differ by up to")
print(", ".join(f"{x:.2f} at gap {gap:g}" for x, gap in zip(scatter, (0.0, 0.3, 1.0), strict=True)))
print("The automatic ranges are one search, the same ranges from scratch the mean of two.")
table(*rows)

# %% [markdown]
# <details><summary>Which ends got far, and why</summary>
#
# The delay got least far, the payload's upper end comes next: the delay and the load cost most in section 1. Most other
# ends are close to the farthest value that they can reach in this run. The payload gets as far as gap 1 although it is
# expensive, because the gains are tuned again on every new range. With enough updates, an end stops where no gains that
# the search finds serve the whole range well.
#
# These ranges may suit the robot at gap 1 better than both that we chose: range 1 goes to 30 ms of delay, so its
# gains are more cautious, and range 0.4 ends at 0.2 kg of payload. One reason may be effort: the gains of the
# automatic ranges were tuned for longer. New gains, tuned from scratch on the same ranges, keep only a part of the
# advantage.
#
# </details>
#
# Ends that stopped early (delay, payload) show what *this task* tolerates after training; most others may have run out
# of updates. They don't tell you where the robot is: the method never observes it. At gap 1 the automatic ranges do
# better than both ranges chosen by hand, by more than searches differ (lines above the table). At gap 0.3 they do a
# little worse.
#
# ## 10 · Interview
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** Compare simulation and robot in four parts. Dynamics: the residual of a replayed log. Timing: the
# delays, from time stamps on one clock. Sensing: the angles measured in a known pose. Perception: the pose error,
# checked by touching. Then report the success rate after each set of corrections, with its confidence interval and
# the number of trials. "I increase randomisation" is not a diagnosis.
#
# </div>
#
# Answer aloud first. The three questions about GPUs go beyond this chapter.

# %%
interview("sim_to_real")

# %% [markdown]
# ### Checkpoint
#
# *In your own words: when is it better to identify the parameters, and when to randomise them? Give a scenario for
# each.* Write it down first; then unfold.

# %%
mine_too = ""
print("written" if len(mine_too.split()) > 30 else "open: thirty words or more")

# %% [markdown]
# <details><summary>An answer, from this chapter's figures</summary>
#
# *Identification wins* where parameters are fixed, a log can be recorded, and the gap is large, for example an arm with
# a large unknown load. One log of less than a second did more for the twin than any randomisation. The fitted
# parameters are not true, since the twin has effects that our model lacks. But the gains were tuned to what the arm
# *does*.
#
# *Randomisation wins* where there is no robot yet, and where caution helps, as with an uncertain delay. It costs time
# inside the target, and it can't make a weak motor strong.
#
# *Where the arm differs in each episode* neither wins by itself: gains tuned on the mean and on the spread are about
# equal. A controller that estimates the arm during the episode can do better: in section 3 the student did on most
# arms, the adaptive law mainly on heavy ones.
#
# "Measuring is always better" is wrong in three cases. If the gap is small, a range does as well and needs no log. If
# you correct only one parameter, the policy may get worse. And what varies can't be measured beforehand.
#
# </details>
#
# Five questions on this chapter. The number `seed` selects them.

# %%
checkpoint("sim_to_real", ["", "", "", "", ""], seed=1)
