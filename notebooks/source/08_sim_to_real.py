# %% [markdown]
# # 8 · From simulation to the real robot
#
# *Six gains that never fail in their simulator meet the arm that it was made for. What is lost, and what brings it
# back? Answer first<span class="kernel-only">, run the cells, then pull the gap up</span>.* About {open minutes}
# minutes of reading, cards and charts. The folded parts add {folded minutes} minutes, the exercises
# {exercise minutes} minutes.

# %%
from course.cards import predict
from course.simulations import simulation

predict("mend_the_delay")

# %% [markdown]
# ![One policy, two arms](attachment:sim_to_real.png)

# %%
simulation("sim_to_real")

# %% [markdown]
# **You will be able to** measure a **reality gap**, what a policy loses between a simulator and the robot; say which
# part of it costs what, and why mending a part can make it worse; close it by **system identification**, which finds
# the robot's numbers in logs, or by **domain randomisation**, which trains on many simulators at once; and know what
# each costs in robot time. **Know first:** chapter 4's two-link arm, chapter 6's margins; least squares.
#
# ## How this chapter works
#
# Most scenes begin with a card: answer first; a click says whether you are right, and **Explanation** says why. A
# number in the text comes from the cell above it, or from a check that `python -m course.derivations 8` runs again.
#
# The "real" arm is simulated too, so that the truth is known; MuJoCo's **twin** of it has what our simulator has no
# words for. **Reward shaping** adds to a reward what makes learning easier; a **potential**, a number for each state,
# makes that safe. Section 8 has these exercises:

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint

badges(8)

# %%
import inspect
import textwrap

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

from course import sim_to_real
from course.cards import interview
from course.charts import read
from course.charts.sim_to_real import logs
from course.derivations import more_claims, show
from course.measure.success import wilson
from course.sim_to_real import (
    Log,
    Plants,
    Process,
    Ranges,
    excitation,
    fit,
    late,
    mended,
    only,
    real,
    recorded,
    rollouts,
    shaped,
    tasks,
    transfer,
    trials,
    tune,
    value_iteration,
)
from course.sim_to_real.identify import arm


def print_figures(chart, *rows):
    """Print the lines of a chart's key figures that begin so, no wider than a page."""
    for line in read(chart).splitlines():
        if line.lstrip().startswith(rows):
            print(textwrap.fill(" ".join(line.split()), 96, subsequent_indent="    "))


# %% [markdown]
# ## 1 · Concept: what differs
#
# ### A number for the gap

# %%
predict("which_part_matters")

# %% [markdown]
# The task: reach a point within 0.9 s and stay within 2 cm of it for the last tenth. The policy: three gains a joint,
# the least that can be fitted to a simulator too well. It is **zero-shot transfer** if the gains go to the robot as
# they are. What counts is the **success rate** on common tasks, with its band: after $k$ of $n$ successes the true rate
# is somewhere in an interval, and Wilson's is one that also works near 0 and 1.
#
# The simulator's arm carries nothing, has no dry friction, no delay, and a perfect encoder. `real(gap, delay)` moves
# all of these along one direction. Which of them matter? Tune on the simulator; try an arm that differs in *one* part;
# then tune on that arm:

# %%
far_end, posed = real(1.0, 0.01), tasks(500, 41)
tuned = recorded()["range"][0, 0]
figure_, axis = plt.subplots(figsize=(6.5, 2.2), layout="constrained")
for row, part in enumerate((*transfer.PARTS, "all")):
    one = far_end if part == "all" else mended(far_end, (part,))
    again = tune(only(one), 0, rounds=12, samples=32, elites=8, episodes=24).gains
    rates = [rollouts(one, gains, posed).rate for gains in (tuned, again)]
    low, high = wilson(500 * rates[0], 500)
    print(f"{part:<9} tuned without it {rates[0]:.3f} [{low:.3f}, {high:.3f}], with {rates[1]:.3f}")
    _ = axis.plot(rates, [row, row], color="grey", zorder=0)
    for k, (name, mark) in enumerate((("without", "o"), ("with", "s"))):
        _ = axis.plot(rates[k], row, mark, color=("#c62828", "#2e7d32")[k], label=name * (row == 0))
_ = axis.set(
    yticks=range(6), yticklabels=[*transfer.PARTS, "all"], xlabel="success", xlim=(0, 1.02)
)
axis.invert_yaxis()
_ = axis.legend(fontsize=8, title="tuned")
plt.show()
for gap in (0.5, 1.0):
    arm_there = real(gap, 0.01)
    alone = [1 - rollouts(mended(arm_there, (part,)), tuned, posed).rate for part in transfer.PARTS]
    lost = 1 - rollouts(arm_there, tuned, posed).rate
    print(f"gap {gap}: lost alone {sum(alone):.3f} in all, together {lost:.3f}")

# %% [markdown]
# Two parts cost something, three nearly nothing; and yet all five together cost more than the sum. (At half the gap
# they just add up: nothing here is a law.) Keep that in mind for section 3.
#
# <table>
# <tr><th>gap</th> <th>what differs</th> <th>what one sees</th> <th>on this arm, above</th> <th>cure</th></tr>
# <tr><td>dynamics</td> <td>mass, friction, motor; backlash</td> <td>lags, overshoots, stops short</td> <td><i>load,
# friction, motor</i></td> <td>identify; then a range</td></tr>
# <tr><td>timing</td> <td>a late command, a late measurement</td> <td>oscillation, sooner with high gains</td>
# <td><i>delay</i></td> <td>measure it; lower the gains or predict</td></tr>
# <tr><td>sensing</td> <td>offset, noise, dropouts</td> <td>a steady miss; a motor that hums</td>
# <td><i>encoder</i></td> <td>calibrate; filter; never trust a policy that saw perfect states</td></tr>
# <tr><td>perception</td> <td>pictures unlike rendered ones; the camera's place</td> <td>right motions to a wrong
# place</td> <td>chapter 7; the camera of section 7</td> <td>calibrate; randomise what is drawn; a separate
# pose</td></tr>
# </table>

# %%
predict("gains_and_a_late_command")

# %% [markdown]
# Chapter 6 said when: a loop has a **delay margin**, the lateness at which it becomes unstable. It belongs to the gains
# as much as to the robot. Tuning in a simulator without delay spends it, as nothing there punishes high gains. (Below a
# third of the gains success ends for another reason: they are too slow.)
#
# The curve is the margin of joint 2 while joint 1 is held. With both free joint 1 gives way, and joint 2 turns less
# inertia; most of all where the arm is stretched. So stretched reaches fail first:
#
# ![Success over delay and gain, with the limit of stability](../docs/charts/late_commands.png)

# %%
print_figures("late_commands", "delay", "both", "success", "no range", "range 1")

# %%
show("late_command")

# %% [markdown]
# ## 2 · Concept: what are the robot's numbers?
#
# ### Output error
#
# Send known torques, record the angles. Then simulate the same torques with parameters $\theta$, and move $\theta$
# until the sum of squares of the **residual**, measured minus simulated, is least. That is the **output error** fit:
#
# $$\hat\theta = \arg\min_\theta \sum_k \bigl\| y_k - \hat y_k(\theta) \bigr\|^2, \qquad
# \operatorname{cov}\hat\theta = \sigma^2 \,(J^\mathsf{T}J)^{-1}, \qquad J = \frac{\partial \hat y}{\partial \theta} .$$
#
# No angle is ever differentiated. All columns of $J$ are one batch of simulations.

# %%
log = logs.record()  # two seconds of two sines on each joint, 1 mrad of noise
result = fit(arm, log, logs.GUESS, logs.FREE)
truth = np.array([logs.TRUTH[name] for name in result.names])
for name, true, value, half in zip(
    result.names, truth, result.value, result.half_width(), strict=True
):
    print(f"{name:<3} true {true:.4f}  found {value:.4f} +- {half:.4f} ({100 * half / true:.2f} %)")
print(f"residual {1e3 * result.noise:.3f} mrad, {result.rollouts} simulations,", end=" ")
print(f"against it: {result.reason or 'nothing'}")

# %% [markdown]
# What else do people do? Differentiate the angles twice and solve a linear system. Filter before that. Or multiply by a
# smooth bump and integrate by parts, as chapter 6 did. Section 6 has all of them on one chart.

# %% [markdown]
# ### When it lies
#
# An error bar assumes the model. Leave something out, and the fit will be wrong *and sure*:

# %%
for name, changed in (
    ("right", {}),
    ("dry friction left out", {"f1": 0.1, "f2": 0.05}),
    ("10 ms of delay left out", {"delay": 0.01}),
    ("the same, one slow joint", {"delay": 0.01, "kind": "one slow joint"}),
):
    wrong = fit(arm, logs.record(**changed), logs.GUESS, logs.FREE)
    error = 100 * np.abs(wrong.value / truth - 1).max()
    message = 100 * (wrong.half_width() / truth).max()
    print(
        f"{name:<24} off by {error:5.2f} %, says {message:.2f} %; residual {1e3 * wrong.noise:5.2f} mrad",
        end="",
    )
    print(", not white" if wrong.white < 0.01 else ", white")

# %% [markdown]
# What is left must look like the sensor's noise: **white**, each sample independent of the one before. Ljung and Box's
# test (1978) puts a number on that. It is a smoke detector, not a certificate: the last row is white, and wrong.

# %%
show("believed_error_bar")

# %%
predict("one_step_late")

# %%
stamped = np.hstack([log.measured[:, :1], log.measured[:, :-1]])
slipped = Log(log.times, stamped, log.command)
wrong = fit(arm, slipped, logs.GUESS, logs.FREE)
error = np.abs(wrong.value - truth) / np.sqrt(np.diag(result.covariance))
lag, sure = late(wrong, slipped)
worst = 100 * np.abs(wrong.value / truth - 1).max()
print(f"off by up to {error.max():.0f} standard deviations, {worst:.1f} %;", end=" ")
print(f"residual {wrong.noise / result.noise:.2f} times the right one")
print(f"against the speed: {1e3 * lag:.2f} +- {1e3 * sure:.2f} ms late, of {1e3 * log.dt:.0f}")

# %%
more_claims("one_sample_late")

# %% [markdown]
# ### What a log can tell
#
# A parameter is **identifiable** if moving it moves the log. Two masses and two inertias move a flat arm in only three
# ways: a **null direction** is a change of several numbers that no motion shows. And a log needs **excitation**:
# torques that make each number matter. Both can be asked before anything is measured.

# %%
plans = {name: logs.record(name) for name in ("two sines", "steps", "one slow joint")}
for name, report in excitation(arm, plans, logs.TRUTH, logs.FREE).items():
    worst = 100 * (np.sqrt(np.diag(report.covariance)) / truth).max()
    print(f"{name:<15} condition {report.condition:4.1f}, worst parameter known to {worst:.3f} %")
free = dict.fromkeys(logs.six(), (1e-4, 10.0))
(report,) = excitation(logs.rods, {"two sines": log}, logs.six(), free).values()
print(f"six numbers, rank {report.rank}: {'; '.join(report.null)}")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** A fit always returns numbers. Ask it three more things: which numbers the log can't tell, whether
# what is left is noise, and whether a log that it has not seen agrees. An error bar without these is the error bar of a
# model, not of the robot.
#
# </div>
#
# ## 3 · Concept: many simulators, or the right one?
#
# ### Ranges
#
# Domain randomisation draws the parameters anew for each episode, so that gains can't lean on any one value.

# %%
predict("what_a_range_costs")

# %% [markdown]
# ![Success over the gap and over the range](../docs/charts/success_over_gap.png)

# %%
for name, k in (("no range", 0), ("the widest", 10)):
    home = rollouts(sim_to_real.nominal(), recorded()["range"][k].T, posed)
    print(f"at home, {name}: success {home.rate.mean():.3f}, {home.inside.mean():.3f} s in target")
print_figures("success_over_gap", "no range", "range", "identified", "home", "gap 0.3", "MuJoCo")

# %% [markdown]
# The rate falls with the gap, and a range brings part of it back: much of what delay took, little of what a payload
# took. One set of gains can be careful. It can't be strong for a heavy arm and gentle for a light one at once.
#
# What the range costs here is not a success at home but time: careful gains arrive later. And the one arm that was
# identified wins wherever the gap is large.

# %%
show("measured_or_randomised")

# %%
predict("which_wins")

# %% [markdown]
# On the twin few things that are identified have the right name: a motor that brakes itself looks like damping, but
# nothing of ours is a bristle, a rotor or a backlash. Is such a fit worth anything? What counts is success per second
# of
# robot time:
#
# ![Success on the twin over the robot time used](../docs/charts/robot_time.png)

# %%
print_figures(
    "robot_time", "no range", "range", "its law", "adaptive", "identified", "and a", "fine-tuned"
)

# %% [markdown]
# **Fine-tuning** searches on the robot itself. It needs no model, and far more robot time than a single log. A
# longer log, or a range about it, buys nothing that these bands show. Chapter 6's adaptive law learns within each
# reach, but most of its gain is there without adapting (*its law, not adapting*).
#
# ### When each of them wins
#
# Three plants that differ, and one that differs *every time*:
#
# <table>
# <tr><th>what is unknown</th> <th>what wins</th> <th>why</th></tr>
# <tr><td>one arm, its numbers fixed, logs to be had</td> <td>identification</td> <td>the unknown becomes
# known</td></tr>
# <tr><td>one arm, no robot yet</td> <td>a range</td> <td>nothing to identify; modest gains against delay</td></tr>
# <tr><td>a new plant each episode, the spread known</td> <td>the mean, and a range about it</td> <td>one set of gains
# is a compromise anyway; these are nearly equal here</td></tr>
# <tr><td>a new plant each episode, and it can be observed</td> <td>in the literature: memory, adaptation</td>
# <td>what was unknown is measured within the episode; not run on this page</td></tr>
# </table>

# %%
spread = sim_to_real.around(real(0.6, 0.012), 0.6)
there_is = spread(1000, np.random.default_rng(5))
sets = {
    "nothing": recorded()["range"][0, 0],
    "a wide range, no log": recorded()["range"][10, 0],
    "the mean of the spread": tune(only(real(0.6, 0.012)), 0).gains,
    "the true spread": tune(spread, 0).gains,
}
for name, gains in sets.items():
    print(f"{name:<24} {rollouts(there_is, gains, tasks(1000, 42)).rate:.3f}")

# %% [markdown]
# So "identify what is fixed, randomise what varies" is half of the answer: randomising what varies buys little here.
# A policy that measures the plant within the episode may do better; this page does not run one.
#
# ### A mended parameter can hurt
#
# The textbook trace has five rows: find the largest gap, fix it, train again, success goes up. Run at gap 1, delay
# first, each row with what a log shows, what was mended, and the success then:
#
# ![All partly mended simulators, and the same parameter asked three times](../docs/charts/mending.png)

# %%
print_figures("mending", "row", "delay", "friction", "motor", "load", "encoder")
rows = [line for line in read("mending").splitlines() if "hurt" in line]
print(textwrap.fill(" ".join(rows[0].split()), 96))

# %%
show("mended_parameter")

# %% [markdown]
# Errors cancel. Gains that know nothing of load and delay are high; a heavy arm can bear them, delay or not. Tell the
# simulator of the delay alone and the gains come down: too weak for the load it has not heard of. Where the load is
# small
# and the delay large, the same mending helps.
#
# Which part is then "the dominant gap"? Mended alone, mended last, or on average over all orders (**Shapley's value**,
# the only split that adds up to the whole), a part has three different worths. So not "fix the dominant gap first" but:
# *mend all that one log tells, at once, and keep a change only if success on the robot rose by more than its band.*

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** A policy is tuned to the sum of a simulator's errors. Take one away and the sum may grow. The unit of
# progress is a success rate with a band, never a parameter that came closer to its true value.
#
# </div>
#
# How large must a trial be? Two rates are told apart by the band of their *difference*; trials on the *same* tasks are
# **paired**, and only those count that one policy wins and the other loses:

# %%
print(f"78 % from 87 %: {trials(0.78, 0.87)} trials of each on tasks of their own")
print(f"the same tasks, 75 % won by both: {trials(0.78, 0.87, together=0.75)}")
for k, n in ((7, 10), (70, 100), (700, 1000)):
    print("{} of {}: between {:.2f} and {:.2f}".format(k, n, *wilson(k, n)))

# %% [markdown]
# ### Does shaping change the answer?
#
# Policies are trained on a reward, and a reward that says "nearer" is easier than one that says "there". Shaping adds
# to it. Ng, Harada and Russell (1999) say which addition is safe: with a potential $\Phi$ of the state,
#
# $$R'(s, a, s') = R(s, a, s') + \gamma\,\Phi(s') - \Phi(s), \qquad Q'(s, a) = Q(s, a) - \Phi(s) .$$

# %%
predict("shaping_at_the_end")

# %% [markdown]
# *Prove it yourself*: what do the added terms of a way from $s_0$ to $s_{T+1}$ sum up to? Look at the hints
# first<span class="kernel-only">, then change the text below</span>.
#
# <details><summary>Hint 1</summary>Is what is added to $Q$ the same for all actions in a state? Then nothing
# changes.</details>
# <details><summary>Hint 2</summary>Write three terms of the sum under each other, with their discounts, and look for
# what occurs twice.</details>
# <details><summary>Hint 3</summary>Which term belongs to the start, which to the end, and which of the two can a policy
# choose?</details>

# %%
answer("telescoped_sum", "b - a")

# %%
answer("q_of_shaped", "Q")

# %%
show("telescoped_sum")

# %% [markdown]
# <details><summary>The whole derivation, and a common slip</summary>
#
# The term $\gamma^{t}\,\gamma\,\Phi(s_{t+1})$ of step $t$ meets its negative in step $t+1$. Only the first and the last
# are left: minus the potential of the start, and the discounted potential of the end. The first is the same for all
# policies. The second is not, unless it vanishes: $\Phi = 0$ wherever an episode ends, or no ends and a bounded $\Phi$.
# Then what $Q$ loses has no action in it, and the best one stays.
#
# The slip: a second term, $\gamma\Phi(s)$, in $Q'$. The next state's potential is cancelled by the step after, and it
# is not that of $s$. A time limit is an end too, unless the value of the last state is added.
#
# For reaching: a potential that falls with the distance to the goal, is zero at the goal, and has the *scale* of the
# true value. The last is what speed depends on.
#
# </details>

# %%
changed = {"zero at the end": 0, "left as it is": 0}
rng = np.random.default_rng(0)
ends = np.arange(8) >= 5
for _ in range(100):
    P, R = rng.dirichlet(np.ones(8), (8, 3)), rng.random((8, 3, 8))
    P[ends], R[ends] = np.eye(8)[ends, None], 0.0
    process, phi = Process(P, R, 0.95, ends), 3.0 * rng.normal(size=8)
    best = value_iteration(process).policy[~ends]
    for name, free_end in (("zero at the end", False), ("left as it is", True)):
        other = value_iteration(shaped(process, phi, free_end=free_end)).policy[~ends]
        changed[name] += bool(np.any(other != best))
print("best policies changed, of 100 random processes that end:")
print(changed)

# %%
show("shaping_keeps_the_best")

# %% [markdown]
# A clock that cuts an episode off is an end as well:

# %%
show("time_is_an_end")

# %% [markdown]
# And the raw distance, as a reward, is no potential's difference:

# %%
show("two_routes")

# %% [markdown]
# The optimum is safe, the speed is not (section 4 has the chart). Shaping by $\Phi$ does exactly what it does to start
# learning with $Q = \Phi$ (Wiewiora 2003). Between zero and the true values it leads straight, even a hundredth of
# them.
# Above them everything has to be tried before it is disbelieved; below zero whatever was tried looks better than what
# was not, and nothing new is tried.

# %% [markdown]
# ## 4 · Design: a pipeline that comes back

# %%
steps = (
    "build\nthe simulator",
    "identify\nfrom logs",
    "randomise\nwhat is left",
    "train",
    "try on\nthe robot",
    "fine-tune,\nif needed",
)
figure_, axis = plt.subplots(figsize=(9, 1.5), layout="constrained")
for k, step in enumerate(steps):
    _ = axis.text(
        k,
        0,
        step,
        ha="center",
        va="center",
        fontsize=9,
        bbox={"boxstyle": "round", "fc": "#e8eaf6"},
    )
    if k:
        _ = axis.annotate("", (k - 0.38, 0), (k - 0.62, 0), arrowprops={"arrowstyle": "->"})
back = {"arrowstyle": "->", "connectionstyle": "arc3,rad=-0.25", "color": "#c62828"}
_ = axis.annotate("", (1, -0.35), (4, -0.35), arrowprops=back)
_ = axis.text(
    2.5,
    -1.25,
    "iterate: new logs, where success fell short",
    ha="center",
    color="#c62828",
    fontsize=9,
)
_ = axis.set(xlim=(-0.6, 5.6), ylim=(-1.5, 0.7))
axis.axis("off")
plt.show()
report = " -> ".join(step.replace("\n", " ") for step in steps)
print(textwrap.fill(f"{report} -> back to identify", 96))

# %% [markdown]
# Three things flow along the red arrow, and all three are logs: torques that were sent, angles that came back, and
# their stamps on *one* clock. A pipeline that doesn't record commands can't be mended.
#
# <table>
# <tr><th>piece</th> <th>takes</th> <th>gives</th> <th>refuses or reports</th></tr>
# <tr><td><code>Plants</code>, <code>Ranges</code></td> <td>numbers, or bounds of them</td> <td>a batch of arms</td>
# <td>negative mass, crossed bounds, a delay below 0</td></tr>
# <tr><td><code>rollouts</code></td> <td>arms, gains, tasks</td> <td>success, time inside, error, reason</td> <td>a
# target out of reach; an arm that diverged</td></tr>
# <tr><td><code>fit</code></td> <td>a simulation, a log, a start</td> <td>values, covariance, rank, null directions</td>
# <td>NaN, gaps, two clocks; a value at its bound; a residual that is not white</td></tr>
# <tr><td><code>tune</code></td> <td>anything that draws arms</td> <td>gains, and the episodes it took</td>
# <td></td></tr>
# <tr><td><code>Process</code></td> <td>transitions, rewards, discount, ends</td> <td>values, best policies</td>
# <td>rows that don't sum to 1, an end that pays, a discount of 1</td></tr>
# </table>
#
# And each question has the smallest model that answers it: two links and six gains for transfer; the same arm and its
# angles for identification; a gantry with two fingers in MuJoCo for what breaks at touch; ten by ten cells for shaping.
#
# ### You are the architect

# %%
predict("thirteen_thousand_years")

# %% [markdown]
# A five-fingered hand is to turn an object, held by its fingertips, to a wanted orientation. The policy is trained in
# simulation only.
#
# | | as the task is set |
# |---|---|
# | degrees of freedom | 24 joints, and 6 of the object |
# | computing | 8 GPUs for a week |
# | contacts | five fingertips on one object |
# | target | 70 % or more, zero-shot |
# | objects | some that were not in training |
# | vision | a camera at the wrist |
#
# Write two or three sentences for each of five questions, before you unfold what was done in 2018 and 2019.

# %%
mine = {
    "1 engine: few accurate contacts, or many environments on a GPU?": "",
    "2 observations: joint angles, forces, a camera? The gap of each?": "",
    "3 what is randomised, in which ranges, without real data?": "",
    "4 pictures: photorealistic, or features that transfer? Which camera?": "",
    "5 a curriculum, or everything at once?": "",
}
for question, words in mine.items():
    print("written " if len(words.split()) > 12 else "   open ", question)

# %% [markdown]
# *What OpenAI did.* Two papers: A is arXiv 1808.00177 (2018, a block), B is arXiv 1910.07113 (2019, a Rubik's cube).
# Each fold says where its figure stands.
#
# <details><summary>1 Engine</summary>
#
# MuJoCo, in both (A, section 2.2; B, section 4). A: 384 machines with 16 processor cores each, and one with 8 GPUs,
# make about 2 years of experience an hour (section 4.3). B: 920 machines with 32 cores each and 64 V100, for several
# months (section 6.3). The "13 thousand years" of B are *simulated experience*, no processor time. The 6,144 cores that
# are often told of the cube are those of A.
#
# *Rubric:* contacts per second at the accuracy that the task needs, not environments per second; a plan for what the
# simulator's contacts can't do; the cost of an experience counted with the randomisation on: A needed 3 years of it
# without and about 100 with (section 6.3).
#
# </details>
#
# <details><summary>2 Observations</summary>
#
# A's policy saw fingertip positions from motion capture, the object's position, and the turn that is left (table 2).
# Neither touch nor joint angles: those sensors were judged too hard to model (section 3.1). The critic saw all the
# simulator knows: an **asymmetric actor-critic**. B alike; joint angles go to the value network only (table 1). The
# hand has 24 degrees of freedom; 20 are driven (A, section 2.1).
#
# *Rubric:* for each sensor its error on the robot and whether the simulator can make that error; nothing in the actor
# that the robot doesn't have; memory: from A's recurrent state one can tell after 5 s whether the block is larger than
# average, in 80 % of cases (section 6.4).
#
# </details>
#
# <details><summary>3 Ranges</summary>
#
# A by hand, about calibrated values: masses times 0.5 to 1.5, friction times 0.7 to 1.3, damping times 0.3 to 3, gains
# times 0.75 to 1.5 (table 1), and delays, backlash, noise. B by **automatic domain randomisation**: it starts at the
# calibrated values; each boundary has a buffer of 240 episodes; a mean of 20 successes or more moves it out, of 10 or
# fewer back *in*, by 0.02 (table 15).
#
# So it doesn't widen and then hold, and the paper lists no ranges: they are its result. The parameters are named in
# table 9.
#
# *Rubric:* calibrate first; ranges from repeated calibrations, then from what training bears; a test of each range. B,
# table 3: with the ranges of A on the changed setup a mean of 2.7 of 50 successes, with automatic ones 13.3 after the
# same training. And A's own policy, tried again a year later: 18.8 had become 4.0.
#
# </details>
#
# <details><summary>4 Pictures</summary>
#
# Three RGB cameras about the cage (A, section 5.1; B, section 7.1: left, right, top). None at the wrist, where fingers
# hide the object. A separate network makes a pose of them; the policy never sees a pixel. Rendering was plain, its
# appearance random. Without that the orientation error on real pictures was 129 degrees, with it 7.8 (B, table 2).
#
# *Rubric:* a pose with its error, and that error in the policy's training; how it is tested alone. The papers don't say
# that this split mattered most. A names randomisation with calibration, memory, and scale (section 1).
#
# </details>
#
# <details><summary>5 Curriculum, and the result</summary>
#
# The physics is the curriculum: with ranges fixed and wide from the start, learning took far longer (B, figure 16). The
# goals are not: flips and single face turns were drawn from the first day (section 6.1). Nobody learned to solve the
# cube: a solver says which face to turn next (section 2.2).
#
# Result (B, table 6): of 10 trials 60 % went through half a scramble and 20 % through all of it, with the cube's own
# sensors for its faces; by vision alone 20 % and none. A, table 3: a median of 13 turns of the block in a row, of 5 for
# a prism. A sphere failed (section 6.2). So 70 % on unseen objects asks for more than was shown.
#
# *Rubric:* success by difficulty, with the number of trials. Ten are few:
#
# </details>

# %%
figure_, axis = plt.subplots(figsize=(5, 1.4), layout="constrained")
for k in (6, 2, 0):
    low, high = wilson(k, 10)
    print(f"{k} of 10: the true rate is between {low:.2f} and {high:.2f}")
    _ = axis.plot([low, high], [k, k], lw=6, color="#9fa8da")
    _ = axis.plot(k / 10, k, "o", color="#1a237e")
_ = axis.set(xlim=(0, 1), xlabel="success rate", yticks=(0, 2, 6), ylabel="of 10")
plt.show()

# %% [markdown]
# ### Two patterns
#
# **A simulator is a world model.** A **world model** says what comes next, $s' = f(s, a)$; a physics engine is one that
# was written, a network one that was learned. Written ones are exact *for their own world*: with a wrong term they stay
# wrong however long the log. Learned ones have no wrong term, only too few data where nobody has been.
#
# So learn one where a term is missing and logs are plenty? Try it on the twin. A model that is linear in fifty features
# of the last angles and torques, against our arm fitted with its friction and delay, and with both left out:
#
# ![Error of motions foretold over the seconds of the log](../docs/charts/learned_model.png)

# %%
print_figures("learned_model", "learned", "our arm", "no friction")

# %% [markdown]
# From too short a log the learned one runs away. From ten seconds on it is better than an arm with wrong terms, which
# no
# longer log helps. The arm whose terms are nearly right is better than both, from a second.
#
# And gradients? MJX, MuJoCo in JAX, differentiates its own steps exactly: that is the slope of the *simulation*. Where
# something touches, it may point another way than the slope of the motion (chapter 1 drops a ball on it).
#
# **Transfer is domain adaptation.** **Domain adaptation** learns in a source domain and works in a target one; a range
# is many sources. If rewards lie in $[0, R]$ and the distribution of the next state differs by at most $\epsilon$ in
# total variation, values differ by no more than a **transfer bound**: its formula is a question of the checkpoint.
#
# <details><summary>How to derive it, and the chain that reaches it</summary>
#
# How large can a value be, and by how much can its expectation differ over two distributions? Write $V-V'$ of one
# policy as one such difference, and $\gamma$ times $V-V'$ a step later; solve for the largest.
#
# Two states: one pays $R$ and stays, for ever in the simulator, while the real one leaves it for good with probability
# $\epsilon$. Its share of the bound is $(1-\gamma)/(1-\gamma(1-\epsilon))$, which goes to one as $\epsilon$ goes to
# zero.
#
# </details>
#
# The right panel below has that chain; the curves are the formula. On the arm the bound says nothing: the next state of
# a slightly heavier arm *never* equals that of the lighter one, so $\epsilon$ is one. It is a statement about
# distributions that overlap.
#
# ![Steps of learning by potential, and the share of the bound that is reached](../docs/charts/shaping_speed.png)

# %%
print_figures("shaping_speed", "none", "gamma")

# %% [markdown]
# *Could a network that was trained on many simulators help on a new robot, as one trained on pictures helps in
# medicine?* For pictures the help was little: on two large medical sets small networks without it did about as well
# (Raghu and others, arXiv 1902.07208, 2019, from the abstract). For policies the trained thing would be what the hand
# above had: not one robot's numbers but the habit of finding them.
#
# ## 5 · Code, and the simulation in full
#
# ### The listing that everybody has seen
#
# Draw factors, multiply, call `mj_setConst`, train. Each line is a claim, and half of them don't do what their comment
# says:

# %%
show("friction_of_each_geom")

# %%
show("set_const_inertia")

# %%
show("scaled_damping")

# %%
show("queue_of_k")

# %% [markdown]
# (`mj_setConst` writes into the data it is given as well: hand it an `MjData` of its own.) The drill `randomize` (in a
# terminal, `drills start randomize`) is that listing, done right. The other half of
# training at scale is a class that steps many environments, and starts those anew that are over:

# %%
show("vector_one_done_flag")

# %%
show("vector_one_step_test")

# %% [markdown]
# (The last observation is `final_obs` in Gymnasium 1, and `terminal_observation` in Stable-Baselines3: the course's
# adapter of the latter moves it from one name to the other.) That is the drill `vector_env`, with a version in
# processes
# as its bonus:
#
# ![Steps a second over the number of environments](../docs/charts/vector_env.png)
#
# The heart of this chapter is short: one arm that differs from another in chosen parts, and what a part is worth.

# %%
text = "\n\n".join(inspect.getsource(f) for f in (transfer.mended, transfer.attribution))
Markdown(f"```python\n{text}```")

# %% [markdown]
# Bad input is refused, by name:

# %%
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
# Left the arm that the policy was tuned for, right the real one, and over it the other's ghost. Sliders for gap, range
# and delay; a menu for what the gains were tuned on. Both rates are counted on the same tasks at every change. Drag the
# target. Go through the presets, and say first what will happen:
#
# 1. *Gap and range*: what does the range cost on the left? 2. *Delay beyond the margin*: does it fail where the linear
# limit says? 3. *Cancelling errors*: what happens when you take the gap away? 4. *Mended delay alone*, then the load.

# %%
simulation("sim_to_real", "Cancelling errors")

# %%
more_claims(
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
# ## 6 · Speed against accuracy
#
# Five ways to the same five numbers, and MuJoCo's own fit on the same log. Left over the noise of the sensor, right
# over the time that it takes:
#
# ![Error of the numbers over noise, and over time, by method](../docs/charts/what_finds_the_numbers.png)

# %%
print_figures(
    "what_finds_the_numbers", "differentiated", "filtered", "integral", "output", "mujoco", "cheap"
)

# %% [markdown]
# *What to pick.* To 1 % the integral form is the cheapest, and it needs no start. Below that, output error: its answer
# is as good as the noise allows, and MuJoCo's fit finds the same one. It also carries over to what is not linear in its
# parameters, such as a delay. Nobody should differentiate an encoder twice.

# %%
show("same_as_mujoco")

# %% [markdown]
# ## 7 · Debug: where it fails
#
# ### How sure, and since when
#
# How much must be left out before the residual says so, and how wrong are the numbers by then? The curves are the true
# error, what the fit claims, and how often the test of whiteness fires:
#
# ![True error, claimed error and alarms over what was left out](../docs/charts/believed_error_bars.png)

# %%
print_figures("believed_error_bars", "dry friction", "delay")

# %% [markdown]
# ### Break it: one gripper, one error at a time
#
# A gripper on a gantry lowers two fingers around a box, closes, lifts. Its policy is a grip force and a servo, tuned
# where the model is right. Each row of the table below changes one thing, and the last one two:

# %%
show("large_step_at_contact")

# %%
show("friction_wrong_both_ways")

# %%
show("camera_off")

# %%
from dataclasses import replace

from course.oracles.mujoco import lab

stiff, slick, rough = (-50000.0, -450.0), lab.Lab(friction=1.2), lab.Lab(friction=0.3)
toggles = {
    "nothing wrong": (lab.Lab(), "lifts", "-"),
    "20 ms, default contacts": (lab.Lab(dt=0.02), "explodes", "halve the step"),
    "20 ms, stiff contacts": (lab.Lab(dt=0.02, solref=stiff), "explodes", "limit of the step"),
    "friction 1.2, is 0.4": (replace(lab.tuned(slick), friction=0.4), "slips", "a slip test"),
    "friction 0.3, is 0.9": (replace(lab.tuned(rough), friction=0.9), "crushes", "force sensor"),
    "box 10 % heavier": (lab.Lab(mass=0.55), "lifts 10 % less", "weigh it: the torque"),
    "camera 20 mm off": (lab.Lab(offset=0.02), "misses", "touch a known point"),
    "camera 30 mm off": (lab.Lab(offset=0.03), "misses", "touch a known point"),
    "camera 20 mm, box + 10 %": (lab.Lab(offset=0.02, mass=0.55), "misses", "one at a time"),
}
print(f"{'what is wrong':<25}{'expected':<16}{'held, with its band':<21}what tells")
for name, (scene, report, caught) in toggles.items():
    held = lab.trials(scene, 20)
    low, high = wilson(held, 20)
    print(f"{name:<25}{report:<16}{held:2d}/20 [{low:.2f}, {high:.2f}]   {caught}")
heavy, light = (lab.lift(lab.Lab(mass=m)).error for m in (0.55, 0.5))
print(f"10 % more mass: lifted {100 * (heavy - light) / lab.Lab().height:.1f} % less high")

# %% [markdown]
# ![Grip, camera and step, swept to both sides of their limits](../docs/charts/break_it.png)

# %%
print_figures("break_it", "tuned for", "friction", "jaw", "by 25", "closing", "up")
omega_dt = np.sqrt(5e4) * 0.02
step = np.array([[1.0 - omega_dt**2, omega_dt], [-omega_dt, 1.0]])  # semi-implicit Euler
radius = np.abs(np.linalg.eigvals(step)).max()
print(
    f"energy of a spring with (omega dt)^2 = {omega_dt**2:.0f}, a step: explicit Euler "
    f"x {1 + omega_dt**2:.0f}, semi-implicit x {radius**2:.0f}"
)
print(
    f"after fifty steps 10^{50 * np.log10(1 + omega_dt**2):.0f} and 10^{100 * np.log10(radius):.0f}"
)

# %% [markdown]
# The factor told, $1 + \Delta t^2 k/m$, is explicit Euler's, which MuJoCo doesn't use; fifty of it are no $10^4$.
# What is
# measured has a limit each: a force of $m(g+a)/(2\mu)$, the jaw's free width, the step at which servo or stiff contact
# turn unstable. Too hard, the fingers knock the box out.
#
# ### Debugging
#
# <div class="alert alert-block alert-info">
#
# **Interview question.** *Your policy succeeds in 95 % of its episodes in simulation, and in 20 % on the real robot.
# Describe how you find out why.*
#
# Answer aloud. The model answer, its follow-ups and what is listened for are in section 10.
#
# </div>
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *It works in simulation and fails on the robot.* Record commands, angles and stamps. Replay the
# commands in the simulator, from the same start. Late by a constant: delay, or stamps. Right at first, then away:
# dynamics; fit, and look at the residual. Right until touch: contact. Right all along: not the dynamics; look at what
# the policy *saw*.
#
# <details><summary>What people get wrong there</summary>
#
# They replay only the commands. A policy reacts: its errors feed back, and open-loop replay of an arm at rest may hide
# a delay that a loop can't bear. Replay the *policy* too, with the delay that was found, and see whether the simulator
# now fails as the robot does. A simulator that predicts the failure is the first milestone.
#
# </details>
#
# </div>
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *It is robust in simulation and brittle on the robot.* The robot may be outside of the ranges: then
# wider ones help. Or the simulator lacks a term: no range of other parameters has a backlash in it. Or the ranges are
# so wide that nothing is done well. Identify once. If the values lie inside of the ranges, widening is not the cure.
#
# <details><summary>What people get wrong there</summary>
#
# They widen. In the chart of section 3 the widest range brings little more than a moderate one where the gap is large:
# a payload wants other gains, not more careful ones.
#
# </details>
#
# </div>

# %% [markdown]
# One failure no gains cured, even ten times lower. A rotor behind a play of some milliradians, on the twin: the encoder
# sits on the link, or on the motor.

# %%
from course.control import Controller, Gains
from course.oracles.mujoco.twin import PLAIN, Twin

figure_, axis = plt.subplots(figsize=(6, 2.0), layout="constrained")
start = np.array([[0.2], [1.2]])
for play, lower in ((0.004, 1), (0.01, 1), (0.04, 1), (0.04, 10)):
    for side, style in (("link", "-"), ("motor", ":")):
        numbers = ((50.0 / lower, 5.0 / lower), (20.0 / lower, 1.0 / lower))
        laws = [Controller(Gains(kp, 0.0, kd, 0.005), 0.01) for kp, kd in numbers]
        goal = start[:, 0] + 0.3 * play

        def law(k, observed, laws=laws, goal=goal):
            desired = zip(laws, goal, observed[:, 0], strict=True)
            return np.array([[c.update(x, y)] for c, x, y in desired])

        loose = replace(PLAIN, armature=0.03, backlash=play, encoder=side)
        q = Twin(loose, threads=1).run(law, start, 200)[0][1, 0]
        swing = np.ptp(q[120:]) / play
        print(f"play {1e3 * play:2.0f} mrad, gains / {lower}, {side}: swings by {swing:.2f} of it")
        _ = axis.plot(0.01 * np.arange(q.size), (q - goal[1]) / play, style, lw=1)
_ = axis.set(xlabel="time [s]", ylabel="off, in plays", ylim=(-1.5, 1.5))
plt.show()

# %% [markdown]
# <table>
# <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr>
# <tr><td>swings about the target at a steady frequency</td> <td>delay beyond the margin</td> <td>halve the gains: the
# swing stops</td> <td>gains from the margin; less delay</td></tr>
# <tr><td>swings by an amount that other gains change and don't end</td> <td>backlash, encoder on the link</td>
# <td>amplitude over the play</td> <td>encoder on the motor, or a preload</td></tr>
# <tr><td>stops short, and stays there</td> <td>dry friction over $k_p$</td> <td>push: it stays there, too</td> <td>an
# integral; friction compensation</td></tr>
# <tr><td>a mended simulator, a worse robot</td> <td>errors that cancelled</td> <td>all subsets, or all at once</td>
# <td>keep it only if success rose</td></tr>
# <tr><td>tiny error bars, other values with each log</td> <td>a term is missing</td> <td>whiteness; another log</td>
# <td>add it, or widen the bars</td></tr>
# <tr><td>training looks perfect from the first hour</td> <td>draws that are never used</td> <td>record the delay that
# an episode had</td> <td>the hunt of section 8</td></tr>
# </table>
#
# ## 8 · Exercises
#
# Graded exercises. `check` asks your cell on cases drawn afresh, and says what is wrong and, if it can, why.
#
# ### A fit of angles

# %%
card("output_error")


# %%
def output_error(q, tau, dt, start, guess):
    """Return inertia and damping of a joint that minimise the squared error of simulated angles."""
    # By differences of the angles.
    rate = np.gradient(q, dt)
    return np.linalg.lstsq(np.column_stack((np.gradient(rate, dt), rate)), tau, rcond=None)[0]


check(output_error)

# %% [markdown]
# ### What a log can't tell

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

# %% [markdown]
# ### How late?

# %%
card("delay_from_log")


# %%
def delay_from_log(sent, measured, dt, longest):
    """Return how late a measurement follows a command, in parts of a sample too."""
    # From the largest command to the largest measurement.
    return float(dt * (np.argmax(measured) - np.argmax(sent)))


check(delay_from_log)

# %% [markdown]
# ### Ranges that open by themselves

# %%
card("boundary_update")


# %%
def boundary_update(bounds, centre, outcomes, thresholds, step):
    """Return both ends of each range after their buffers are full."""
    # Wider, whatever happened.
    return np.asarray(bounds, dtype=float) + np.outer(step, [-1.0, 1.0])


check(boundary_update)

# %% [markdown]
# ### Shaped rewards

# %%
card("shaped_reward")


# %%
def shaped_reward(state, following, reward, terminated, truncated, phi, gamma):
    """Return rewards of logged steps with a potential's difference added."""
    # The potential itself as a reward.
    return np.asarray(reward, dtype=float) + np.asarray(phi, dtype=float)[state]


check(shaped_reward)

# %% [markdown]
# ### Silent-bug hunt
#
# Its author has seen the costs go down, and the test agree with the training.

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
# Any equivalent form is right. <span class="kernel-only">Change the texts.</span>

# %%
answer("slip_force", "m*g")

# %% [markdown]
# ## 9 · Frontier: closing the gap by itself
#
# <table>
# <tr><th>work</th> <th>year</th> <th>what is new</th> <th>what is said of it, and what it says</th></tr>
# <tr><td>Automatic domain randomisation (OpenAI, arXiv 1910.07113)</td> <td>2019</td> <td>a range that widens while
# success at its boundary lasts</td> <td>"a second agent learns the ranges": two thresholds and a buffer a
# boundary</td></tr>
# <tr><td>Closing the loop (Chebotar and others, arXiv 1810.05687)</td> <td>2018</td> <td>ranges moved until simulated
# motions look like some real ones</td> <td>needs real logs, as identification does</td></tr>
# <tr><td>Active domain randomisation (Mehta and others, arXiv 1904.04762)</td> <td>2019</td> <td>learned draws: where a
# policy behaves unlike the nominal one</td> <td>this one is the second agent</td></tr>
# <tr><td>NeRF2Real (Byravan and others, arXiv 2210.04932)</td> <td>2022</td> <td>a scene scanned with a camera,
# rendered for training</td> <td>"a digital twin": of looks and surfaces; masses and friction are put in</td></tr>
# <tr><td>DINOv2 (Oquab and others, arXiv 2304.07193)</td> <td>2023</td> <td>features of pictures, learned without
# labels</td> <td>"transfer better than pixels": often; what is *invariant* in them was not chosen for your
# task</td></tr>
# <tr><td><code>mujoco.sysid</code></td> <td>2026</td> <td>identification that comes with the simulator</td>
# <td>intervals, and not that they assume a right model; section 6 has it</td></tr>
# </table>
#
# (The first from the paper, the next four from their abstracts.) The first is small enough to run. It begins at the
# simulator's values; each boundary of each parameter has its
# own buffer:

# %%
found_ranges = sim_to_real.automatic(0, rounds=30)
wide = sim_to_real.around(sim_to_real.nominal(), 1.0).bounds
figure_, axis = plt.subplots(figsize=(6, 2.2), layout="constrained")
for row, (name, (low, high)) in enumerate(found_ranges.ranges.bounds.items()):
    middle = getattr(sim_to_real.nominal(), name)[0]
    ends_at = (np.array([low, high]) - middle) / (wide[name][1] - middle)
    _ = axis.plot(ends_at, [row, row], lw=6)
    print(f"{name:<8} {low:8.4f} to {high:.4f}, in widths {ends_at[0]:5.2f} to {ends_at[1]:.2f}")
_ = axis.set(yticks=range(len(wide)), yticklabels=list(wide), xlabel="1 is as far as gap 1 moves")
plt.show()

# %%
for gap in (0.0, 0.3, 1.0):
    hand, auto = (
        rollouts(real(gap, 0.01), gains, tasks(1000, 43)).rate
        for gains in (recorded()["range"][4, 0], found_ranges.gains)
    )
    print(f"gap {gap:.1f}: range 0.4 by hand {hand:.3f}, automatic {auto:.3f}")
print(f"{found_ranges.episodes} episodes, {len(found_ranges.history)} moves of a boundary")

# %% [markdown]
# It opens where success doesn't care and stops where it does. That says which parameters *this task* minds. It does not
# say where the robot is, and no buffer can: nothing in it has seen the robot.
#
# ## 10 · Interview
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** *Three axes.* Compare simulation and robot in dynamics (replayed logs, residual), timing
# (distribution of the delay, from stamps on one clock) and perception (pose error against a touched truth). Give each a
# number, and then the only one that counts: success with its band, after each change. Say how many trials. "I turn
# randomisation up" is no diagnosis; neither is "I fix the largest gap first", until success says so.
#
# </div>
#
# Answer aloud, then open: first what one says in a minute, then the whole of it, then what comes next.

# %%
interview("sim_to_real")

# %% [markdown]
# ### Checkpoint
#
# *In your own words: when is finding the numbers better than randomising them, and when not? A scenario for each.*
# Write it down first; then unfold.

# %%
mine_too = ""
print("written" if len(mine_too.split()) > 30 else "open: thirty words or more")

# %% [markdown]
# <details><summary>An answer, from this chapter's figures</summary>
#
# *Identification wins* where numbers are fixed and a log can be had: an arm with an unknown payload. One log, less than
# a second of robot time, did more for the twin than any range. Not because the values became true: the twin has terms
# that ours lacks. It is because the gains were tuned to what the arm *does*.
#
# *A range wins* where there is no robot yet, and where what is unknown is of the careful kind: a delay. It costs time
# in the target, and it can't make a weak motor strong.
#
# *Where plants differ each time* neither wins by itself: gains for the mean and for the spread are equal. What could
# help is a policy that measures the plant within the episode, which this chapter did not run. "Measuring is strictly
# better" fails three times: a mended part may hurt, a
# number with a wrong model is wrong and sure, and what varies can't be measured beforehand.
#
# </details>
#
# Three formulas that are not on this page; you can derive them from what is. The gate opens when all are right.

# %%
checkpoint("sim_to_real", step_penalty="", gap_of_values="", trials_to_tell="")
