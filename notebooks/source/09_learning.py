# %% [markdown]
# # 9 · Robot learning
#
# *A point learns to reach a disc, while you watch. The best that is possible is known exactly; which reward gets near
# it? Answer first; then run the cells.* {open minutes} minutes to read and move, {folded minutes} minutes more for what
# is folded away, {exercise minutes} minutes of exercises.

# %%
from course.cards import predict
from course.simulations import simulation

predict("three_rewards")

# %% [markdown]
# ![A point learns to reach a disc](attachment:learning.point.png)

# %%
simulation("point")

# %% [markdown]
# **You will be able to** choose between a policy that learns from reward, one that copies, and one that is written; say
# when the errors of a copy grow and how fast; make a policy that keeps several ways apart; and test any of them so that
# the number means something. **Know first:** chapter 8's potentials, chapter 6's loops, some probability.
#
# ## How this chapter works
#
# Most scenes begin with a card: answer first; a click tells whether you are right. (What holds only under a condition
# is false as it stands.) A number in the text comes from the cell above it, or from a check that `python -m
# course.derivations 9` runs again. Each method is shown on the smallest task that has its point, beside an optimum that
# is known. Section 9 has these exercises:

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint

badges(9)

# %%
import inspect
import textwrap
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

from course import learning
from course.cards import interview
from course.charts import read
from course.derivations import figure, show
from course.learning import Commit, Delayed, Regulator, Settings, TwoWays, evaluate, objective, roll
from course.measure.success import wilson
from course.measure.sweep import sweep
from course.vector_env import PointReachVector
from course.vector_env.point import optimum, plan


def print_figures(chart, *rows):
    """Print the lines of a chart's key figures that begin so, no wider than a page."""
    for line in read(chart).splitlines():
        if line.lstrip().startswith(rows):
            print(textwrap.fill(" ".join(line.split()), 96, subsequent_indent="    "))


def source(*functions):
    """Show functions as they stand in the module."""
    text = "\n\n".join(inspect.getsource(f) for f in functions)
    return Markdown(f"```python\n{text}```")


# %% [markdown]
# ## 1 · Concept: learning from reward
#
# ### A task whose best is known
#
# In **reinforcement learning** a policy acts, is paid, and changes so that it will be paid more. It is shown what to do
# in **imitation learning**. Written laws are the third way, and the yardstick here.
#
# The point has a bounded acceleration along each axis. After $k$ steps it can be anywhere in a box that grows with
# $k(k+1)/2$; the first box that meets the disc gives the least number of steps. A prize of 1 that many steps away,
# discounted by 0.99 a step, is the optimum; every learner is charted by its share of it.

# %%
envs = PointReachVector(64, "sparse", autoreset_mode="SameStep")
best = optimum(envs.reset(seed=1000)[0])


def fastest(observed):
    """Return the best policy, from the boxes."""
    return plan(observed)[1].astype(np.float32)


def written(observed):
    """Return two gains, on what is left of the way and on the speed."""
    return np.clip(4.0 * observed[:, :2] - 3.5 * observed[:, 2:], -1.0, 1.0).astype(np.float32)


figure_, axes = plt.subplots(1, 2, figsize=(7, 3), layout="constrained", sharey=True)
for axis, (name, act) in zip(axes, (("fastest", fastest), ("two gains", written)), strict=True):
    ran = evaluate(act, envs, 1000)
    share = ran.returns.mean() / best.mean()
    print(f"{name:<10} {share:.2f} of the optimum, {ran.steps.mean():.1f} steps")
    few = PointReachVector(6, "sparse")
    measured, route = few.reset(seed=1000)[0], []
    for _ in range(60):
        route.append(few.task.p.copy())
        measured = few.step(act(measured))[0]
    route = np.array(route)
    for i, last in enumerate(evaluate(act, PointReachVector(6, "sparse"), 1000).steps):
        _ = axis.plot(route[:last, 0, i], route[:last, 1, i], ".-", ms=2, lw=0.7)
    _ = axis.set(title=name, aspect="equal", xlabel="x [m]")
plt.show()

# %% [markdown]
# ### Whose merit was it?
#
# A policy that draws its actions can be improved by the **policy gradient**: raise the probability of an action in
# proportion to its *advantage*, how much better it turned out than what a critic expected. What it turned out to be is
# known in many ways: the next reward and the critic's word for the rest, or two rewards, or all of them.
#
# **Generalised advantage estimation** takes all at once, with weights. Where the clock cuts an episode off, the
# critic's word for what would have come is added, which is **bootstrapping**; where it ended, nothing comes.

# %%
show("lambda_mixes")

# %%
show("next_row")

# %% [markdown]
# ### How far in one step?

# %%
predict("where_the_clip_bites")

# %% [markdown]
# The gradient is right at the policy that drew the data, and wrong far from it. PPO uses a batch for several epochs
# nevertheless. Its **clipped objective** is the smaller of ratio times advantage and the same with the ratio held near
# one. Both signs, three places each, are the six cases:

# %%
ratio = np.linspace(0.4, 1.6, 241)
figure_, axes = plt.subplots(1, 2, figsize=(7, 2.3), layout="constrained")
for axis, A in zip(axes, (1.0, -1.0), strict=True):
    value, slope = objective(ratio, np.full(ratio.size, A), 0.2)
    _ = axis.plot(ratio, value, lw=2)
    _ = axis.plot(ratio, ratio * A, ":", lw=1, color="grey")
    _ = axis.axvspan(0.8, 1.2, color="#e8eaf6")
    _ = axis.set(title=f"advantage {A:+.0f}", xlabel="ratio", ylabel="objective")
plt.show()
for A in (1.0, -1.0):
    slopes = objective(np.array([0.7, 1.0, 1.3]), np.full(3, A), 0.2)[1] + 0.0
    print(f"advantage {A:+.0f}: slope {slopes} where the ratio is below, near and above one")

# %%
show("beyond_the_clip")

# %%
show("clip_keeps")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** The clip does not hold the policy; it only stops paying for going further. What holds it is the
# number of epochs times the step size. Measure the divergence of an iteration: section 8 has the map.
#
# </div>
#
# PPO is **on-policy**: each batch comes from the policy of the moment, and is thrown away. SAC and TD3 keep every step
# in a **replay buffer**, a store from which they learn again and again. They win where a step is dear: on a real robot,
# in a slow simulator; one pays more gradients a step, and more ways to diverge. They are not built here. "PPO
# dominates" is true where steps are nearly free, as on a GPU, and of nothing wider.
#
# ## 2 · Concept: what to pay for
#
# Three rewards for the same task. A **sparse reward** pays for success only. Where it is not found by chance, nothing
# is learned; how often chance finds it, can be told beforehand:

# %%
show("sparse_chance")

# %% [markdown]
# ![Share of the optimum by reward, and chance by the size of the disc](../docs/charts/rewards.png)

# %%
print_figures("rewards", "potential", "sparse", "minus", "the same", "chance")

# %%
show("minus_distance")

# %% [markdown]
# **Reward hacking** is a policy that is paid well for what nobody wanted. It is no malice and often no accident: it is
# the optimum of what was written. So ask for the optimum *before* training.

# %%
show("hovering")

# %%
show("no_time_penalty")

# %% [markdown]
# ### The listing: a reward to reach
#
# The usual listing takes minus the distance, adds 1 within 5 cm "for getting close, not for staying", and takes away
# speed near the goal and angles near their limits. It runs, and two of its comments are wrong: the bonus has no memory,
# so it *is* paid for staying; and minus the distance dictates a route. Ours ends the episode, pays once, and shapes by
# a difference:

# %%
for kind in ("sparse", "distance", "potential", "hover", "once"):
    paid = PointReachVector(64, kind, autoreset_mode="SameStep")
    quick = evaluate(fastest, paid, 1000).returns.mean()
    still = evaluate(lambda observed: 0.0 * observed[:, :2], paid, 1000).returns.mean()
    print(f"{kind:<10} the fastest way is worth {quick:6.2f}, to stay away {still:6.2f}")

# %% [markdown]
# With a bonus for each step near, doing nothing at all is worth more than the fastest way. The exercise `reach_reward`
# is that listing, done right. Does it take a network, and no data?

# %%
show("two_gains")

# %% [markdown]
# ## 3 · Concept: copying, and when errors grow
#
# ### One step at a time
#
# **Behaviour cloning** is regression: states in, the expert's actions out. It errs a little, comes to states that
# nobody showed, errs more: **compounding errors**.

# %%
predict("how_errors_grow")

# %%
show("errors_compound")

# %% [markdown]
# ![Cost over the horizon, the end of the square law, three plants, circling](../docs/charts/compounding.png)

# %%
print_figures("compounding", "a fall", "recovers", "the law", "a =", "cloned", "DAgger")

# %% [markdown]
# So "errors compound quadratically" is the worst case of a bound. A plant whose own dynamics forgive makes it linear,
# an unstable one makes it exponential, and no average error on held-out data tells which.
#
# ### The data that were not there

# %%
predict("perfect_and_useless")

# %% [markdown]
# Four ways to collect labels of the same perfect expert. **Dataset aggregation**, DAgger, lets the *learner* drive and
# asks the expert what to do there. **Noise injection** pushes the expert while it demonstrates.

# %%
plant = Regulator()
figure_, axis = plt.subplots(figsize=(6.5, 2.6), layout="constrained")
for name, how in (
    ("expert", None),
    ("cloned", {"rounds": 0}),
    ("two rounds of DAgger", {"rounds": 2}),
    ("the same, labels with noise", {"rounds": 2, "label_noise": 1e-6}),
    ("pushed, then cloned", {"rounds": 0, "injected": 0.01}),
):
    rng, act = np.random.default_rng(0), plant.expert
    radius = plant.radius(plant.K)
    if how is not None:
        rounds = learning.dagger(
            plant, plant.expert, learning.linear, plant.starts, 40, rng, number=10, **how
        )
        *_, last = rounds
        act, radius = last.policy, plant.radius(last.policy.gain[0])
    ran = roll(plant, act, np.array([[0.1, 0.0]]), 60, rng)
    _ = axis.semilogy(np.abs(ran.states[0, :, 0]), label=name, lw=8 / (1 + len(axis.lines)))
    print(f"{name:<28} spectral radius {radius:.3f}")
_ = axis.set(xlabel="step", ylabel="angle [rad]", ylim=(1e-4, 1e2))
_ = axis.legend(fontsize=7)
plt.show()

# %%
show("dagger_fixes_drift")

# %%
show("dagger_needs_room")

# %% [markdown]
# Drift is an identification problem, like chapter 8's null directions: the labels don't hold what the policy needs.
# A richer network doesn't add it:

# %%
show("diffusion_mends_drift")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** A copy fails where it was not shown what to do. So what counts is not how well it fits, but which
# states are in the data, and whether the plant leads back by itself.
#
# </div>
#
# ## 4 · Concept: many ways to do it
#
# <div class="alert alert-block alert-info">
#
# **Interview question.** *You have 100 demonstrations of a folding task. Some fold the left sleeve first, some the
# right. Which learning algorithm do you take, and why?*
#
# Answer aloud. The smallest such task is below: an obstacle, 100 demonstrations, half of them to each side.
#
# </div>

# %%
predict("left_or_right")

# %% [markdown]
# *The squared error* is least at the mean, which nobody did: **mode averaging**. A **mixture head** gives weights,
# means and widths of several answers, and picks one. **Denoising diffusion** learns to take noise away, a step at a
# time; **flow matching** learns a velocity from noise to data, and follows it. A conditional
# **variational autoencoder** has a code for what the state doesn't tell: ACT's encoder and decoder are one, built of
# transformers. Here two small networks do, as there are no pictures to attend to.

# %%
paths = TwoWays()
heads = {name: learning.recorded(name) for name in learning.recorded.__globals__["HEADS"]}
heads["z = 0, as ACT runs"] = replace(heads["autoencoder"], zero=True)
heads["nearest shown"] = learning.nearest(*learning.windows(paths.demonstrate(100, 0), 8))
passed = {}
figure_, axes = plt.subplots(1, 7, figsize=(11, 1.9), layout="constrained", sharey=True)
for axis, (name, policy) in zip(axes, heads.items(), strict=True):
    rng = np.random.default_rng(3)
    ran = roll(paths, Commit(policy, 8), paths.starts(400, rng), 16, rng)
    sides = paths.sides(ran.states)
    _ = axis.plot(*ran.states[:40].transpose(2, 1, 0), lw=0.4, color="#0072b2")
    axis.add_patch(plt.Circle((0.5, 0.0), 0.2, color="grey"))
    _ = axis.set(title=name, aspect="equal", xticks=(), xlim=(-0.1, 1.15), ylim=(-0.6, 0.6))
    passed[name] = np.mean(sides != 0)
    low, high = wilson(400 * passed[name], 400)
    print(f"{name:<19} passes {passed[name]:.2f} [{low:.2f}, {high:.2f}], ", end="")
    print(f"left {np.mean(sides > 0):.2f}, right {np.mean(sides < 0):.2f}")
plt.show()

# %%
answer("cloning_averages", "0*w")

# %%
show("cloning_averages")

# %% [markdown]
# ![Success over held-out error, over time, and the share of each side](../docs/charts/many_ways.png)

# %%
print_figures("many_ways", "mean", "mixture", "flow", "diffusion", "autoencoder", "nearest", "left")

# %%
show("held_out_error")

# %% [markdown]
# *The answer, with these figures.* No squared error: it folds neither sleeve. On this task a mixture is as good as
# anything, the cheapest to run, and it states its shares; for an action with many parts, where one doesn't know how
# many ways there are, a flow or a diffusion policy, with a chunk so that one way is carried through.
#
# And the nearest
# demonstration first of all, as a yardstick that trains in no time: it passes everything here, and would pass little
# where states have many numbers. Then count runs and sides; and ask whether fifty demonstrations of the rarer way are
# in there.

# %%
show("diffusion_between")

# %%
show("code_of_zero")

# %% [markdown]
# ### How many steps of a sampler?
#
# A flow is an ordinary differential equation, and chapter 1's orders hold for it. For a mixture of Gaussians the exact
# field is known, so a sampler can be tested without any training. *Prove it yourself*: where does one Euler step end?
#
# <details><summary>Hint 1</summary>At time 0 the sample is noise and tells nothing of the data.</details>
# <details><summary>Hint 2</summary>The velocity is the mean of (data minus noise), given the sample.</details>
# <details><summary>Hint 3</summary>Given noise that is known, what is random in it?</details>

# %%
answer("one_euler_step", "z + h*m")

# %%
show("one_euler_step")

# %%
show("sampler_orders")

# %% [markdown]
# ![Error over calls of the field, exact and trained; success over calls](../docs/charts/samplers.png)

# %%
print_figures("samplers", "Euler", "Heun", "DDIM", "flow, euler", "flow, heun", "diffusion, ddim")

# %%
show("ten_denoising_steps")

# %% [markdown]
# Finer than the network's own error no solver gets. "Ten to fifty steps, hence slow" is a habit of the first papers:
# here ten calls are near the floor of the network, and Heun's ten are on it.
#
# ### Commit or react

# %%
predict("length_of_a_chunk")

# %% [markdown]
# An **action chunk** is what a policy plans ahead: eight to thirty-two steps in many papers, up to a hundred in ACT's.
# Executed as a whole it is open loop. **Temporal ensembling** asks at every step and averages what older chunks say of
# this one.

# %% [markdown]
# ![Success over the steps executed and over the pushes; wavering and drifting](../docs/charts/commit_or_react.png)

# %%
print_figures("commit_or_react", "pushed", "changes", "off")

# %%
answer("react_less", "s*k")

# %%
show("react_less")

# %% [markdown]
# Try it: the head, the steps that are carried out, the pushes, the steps of the sampler. Nothing is trained here; the
# weights are on record, and `python -m course.learning` makes them anew.

# %%
simulation("two_ways")

# %% [markdown]
# So a chunk limits reaction by what is *executed*, not by what is planned: "a fixed chunk limits reactivity" is true of
# the whole chunk only. Nor does its length come from the task's demonstrations: "50 to 100" is what some papers had.
# How many are needed depends on the rarest way that must be in there; the checkpoint asks. And people pause:

# %%
show("pauses")

# %% [markdown]
# ## 5 · Design: which method for what
#
# ### One table, and each sentence of it tested

# %%
f = figure
rows = (
    ("PPO", "a simulator, and a reward whose optimum you know", "no demonstrations; steps, and time",
     f"finds a way that nobody showed; two gains searched for get {f('two_gains', 'share'):.0%} too",
     f"sparse: chance finds it in {f('sparse_chance', 'measured'):.1%} of the episodes",
     f("two_gains", "share") > 0.8 and f("sparse_chance", "measured") < 0.05),
    ("cloning", "an expert, one way, a plant that leads back", "labels that span the states",
     f"trains in a second; as a mixture it passes {passed['mixture']:.0%} of two ways",
     f"by squared error {passed['mean']:.0%}; a perfect fit may have radius "
     f"{f('perfect_fit', 'copy'):.2f}",
     passed["mean"] < 0.05 < passed["mixture"] and f("perfect_fit", "copy") > 1.0),
    ("DAgger", "an expert who can be asked anywhere", "labels on the learner's own states",
     f"mends drift, radius {f('dagger_fixes_drift', 'mended'):.2f}, once noise takes it off the line",
     f"none without noise ({f('dagger_fixes_drift', 'quiet'):.2f}), nor for a net trained too briefly",
     f("dagger_fixes_drift", "mended") < 1.0 < f("dagger_fixes_drift", "quiet")
     and f("dagger_needs_room", "short_dagger") > f("dagger_needs_room", "short_clone")),
    ("diffusion, flow", "several ways, many numbers in an action", "the same labels; all ways in them",
     f"keeps both ways: {passed['diffusion']:.0%} and {passed['flow']:.0%} pass",
     f"ten calls an action; {f('diffusion_between', 'ten'):.0%} between the ways; drifts as any copy",
     min(passed["diffusion"], passed["flow"]) > 0.7 and f("diffusion_mends_drift", "lost") > 0.9),
    ("ACT", "long smooth motions, people who pause", "the same labels",
     f"a chunk carries through a pause ({f('pauses', 'through'):.0%} stuck, else "
     f"{f('pauses', 'stuck'):.0%})",
     f"code at zero: {passed['z = 0, as ACT runs']:.0%} pass; a whole chunk reacts late",
     f("pauses", "through") == 0.0 and passed["z = 0, as ACT runs"] < passed["autoencoder"]
     and f("react_less", "eight") < f("react_less", "two")),
)  # fmt: skip
assert all(row[-1] for row in rows)
table = [
    "| method | when to use it | what it needs | strength | weakness |",
    "|---|---|---|---|---|",
]
table += [f"| {' | '.join(row[:5])} |" for row in rows]
Markdown("\n".join(table))

# %% [markdown]
# The last column of each row is a test that the cell above ran. No row says "precise" or "dexterous": none of these
# methods is, by itself.
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** *Which one?* Ask four things before you name a method. Is there a simulator whose reward means the
# task? Then reinforcement learning, and say what its optimum is. Is there an expert? Then copy; and say how the data
# get off the expert's line. Is there more than one way? Then a head that can hold two. Is there a law that can be
# written? Then write it, and learn what is left. End with the test: runs, a band, and both sides.
#
# </div>
#
# ### Details that matter, and where
#
# Implementations of PPO have dozens of details, and lists of them. Leave each out on the usual task, then on one that
# is made so that it matters:

# %% [markdown]
# ![PPO without each detail, and tasks on which a detail matters](../docs/charts/details_that_matter.png)

# %%
print_figures("details_that_matter", "left out", "where")

# %% [markdown]
# Four changes break the learner on the usual task: lambda 0 and a discount of 0.9, which take credit from early steps;
# one epoch; and four hidden units. Without normalised observations it reaches a sixth less of the optimum, and the low
# end of its band is near half of it. No other detail costs a tenth.
#
# Each of those has a task on which it does matter: observations far from zero, large steps, large prizes, and a reward
# for staying near the goal. In that last task a learner that counts the time limit as an end overrates the prize.
# Normalisation has a trap when each environment has its own statistics:

# %%
show("own_normaliser")

# %% [markdown]
# ### Many seeds, many machines
#
# One seed says nothing: bands here are over several. Each job has its own seed, so results don't depend on who runs
# them; `executor=` takes any pool, a cluster's too. A failed job names its arguments and costs no other.


# %%
def one(gain, seed):
    """Return what a law of two gains is worth."""

    def act(observed):
        push = gain * (observed[:, :2] - observed[:, 2:])
        return np.clip(push, -1.0, 1.0).astype(np.float32)

    return float(evaluate(act, PointReachVector(64, "sparse"), seed).returns.mean())


jobs = [{"gain": gain, "seed": seed} for gain in (0.25, 1.0, 4.0) for seed in (0, 64)]
for job, worth in zip(jobs, sweep(one, jobs), strict=True):
    print(job, f"{worth:.3f}")

# %% [markdown]
# ## 6 · Code, and the simulation in full
#
# ### The listing: a policy and its update
#
# The usual listing of "a PPO training loop" has a network with two layers and a Gaussian head, a clipped loss for some
# epochs, and a reward. Its clipped surrogate is right. As listed, it stops in the second epoch with "Trying to backward
# through the graph a second time": the old log-probabilities still carry their graph. Call `detach()` on them.
#
# Even then the listing is an update and not a loop: nothing acts, nothing computes advantages, there is no critic, and
# the reward of 10 inside the disc is paid at every step. Those missing parts are the ones that people get wrong. Ours:

# %%
source(learning.gae, learning.objective)

# %%
small = Settings(epochs=5, rate=3e-3, hidden=(16, 16))
train = PointReachVector(64, "potential", autoreset_mode="SameStep")
for report in learning.ppo(train, small, steps=3 * 2048, seed=0):
    print(f"{report.steps} steps, the actions have a standard deviation of {report.spread:.1f}")
print("mean actions for 64 points:", report.policy(train.reset(seed=5)[0]).shape)

# %% [markdown]
# The generator yields after each iteration, so a page can draw, and anybody can stop. Bad input is refused, by name:

# %%
for attempt in (
    lambda: Settings(discount=1.5),
    lambda: learning.gae(np.zeros(3), np.zeros(2), np.zeros(3), np.zeros(3), np.zeros(3)),
    lambda: learning.clone(np.zeros((1, 2)), np.zeros((1, 2)), 0),
    lambda: learning.clone(np.ones((5, 2)), np.ones((5, 2)), 0),
    lambda: learning.windows(paths.demonstrate(3, 0), 40),
    lambda: next(learning.ppo(train, Settings(minibatches=7), steps=2048)),
):
    try:
        attempt()
    except ValueError as problem:
        print(textwrap.fill(str(problem), 96))

# %% [markdown]
# Now break it, with a preset each: *One epoch*, *Discount 0.9*, *No reward scaling*, *Hovering*, *First to finish*. Say
# first what return and success will do. The line is the optimum.

# %%
simulation("point")

# %% [markdown]
# ## 7 · Speed against accuracy
#
# Ours beside Stable-Baselines3 in the same environments with the same settings, and beside a search for eight numbers:
#
# ![Share of the optimum over steps and over time](../docs/charts/learning_curves.png)

# %%
print_figures("learning_curves", "ours", "Stable", "search")

# %% [markdown]
# *What to pick.* For a point, two numbers of the right form: section 2 drew them in fewer steps than any of these
# takes. Eight of no form stop at two thirds. Where nobody knows a form, ours or the library, which learn alike from
# the same steps, within their bands: what differs is what a step costs. Where does that time go? Not into products:

# %%
answer("gradient_cost", "d*h + h^2 + h*m")

# %%
show("gradient_cost")

# %% [markdown]
# On an arm everything is dearer. Chapter 8's arm, torques as actions, a linear policy found by search: more than a
# million steps to pass a law that was written by hand, and by little:
#
# ![Reward and success of the arm over the steps of its training](../docs/charts/learning_curve_reach.png)

# %%
print_figures("learning_curve_reach", "targets")

# %% [markdown]
# Copied from that law, networks come near it, and what they lack is fit: at equal labels DAgger gains some, a wider net
# that is trained longer more. PPO, as it solves the point, is far below after half a million steps:
#
# ![Targets reached by copies of a written law, and by PPO](../docs/charts/arm_learned.png)

# %%
print_figures("arm_learned", "DAgger", "cloned", "PPO")

# %% [markdown]
# ## 8 · Debug: where it fails
#
# ### Too far in one iteration
#
# Step size and epochs trade: both move the policy. One number tells how far, the divergence of an iteration. Who gets
# far moves by about a hundredth each time; not all who move so far get far:
#
# ![Share of the optimum over step size and epochs, and over the divergence](../docs/charts/step_epochs.png)

# %%
print_figures("step_epochs", "3 ", "10 ", "30 ", "all")

# %% [markdown]
# ### Debugging
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *It doesn't converge.* Test the *task* before the learner: what does a policy that knows nothing
# earn, a written law, and the best? If chance never succeeds, no detail of PPO helps: shape by a potential, or start
# nearer. If the written law earns less than standing still, mend the reward. Does the policy see what it needs: the
# goal, the speed? Then the learner: divergence of an iteration, loss of the critic, bands over five seeds.
#
# <details><summary>What people get wrong there</summary>
#
# They add minus the distance. In the chart of section 2 that is no better than paying nothing on the way: scaled by its
# running deviation, the prize for arriving is lost in it, and it pays for another way than the fastest. A difference of
# the same distance does what they meant.
#
# </details>
#
# </div>
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The copy drifts after some seconds.* Draw the states it visits over the states that were shown.
# Off them: data are missing; ask the expert there, with DAgger, or push it while it demonstrates. On them, and wrong:
# labels disagree; look for two ways, for a pause, for something that the expert saw and the policy doesn't. Then count
# what the plant does with an error.
#
# <details><summary>What people get wrong there</summary>
#
# They take a larger head. A diffusion policy drifts on the regulator as any other copy does; with the same network and
# pushed data nothing drifts. Chunks help where looking is what hurts (wavering, pauses), and harm where the plant must
# be held.
#
# </details>
#
# </div>

# %%
predict("curve_at_one")

# %% [markdown]
# A policy that stands still where the goal is too far to the left, tested in both ways:

# %%
for edge in (0.1, -0.5):

    def lame(observed, edge=edge):
        return np.where(observed[:, :1] > edge, plan(observed)[1], 0.0).astype(np.float32)

    rig = PointReachVector(128, "sparse")
    true = evaluate(lame, rig, 0).success.mean()
    report = learning.first_finished(lame, rig, 128, 0).success.mean()
    print(f"one episode in each of 128: {true:.2f}; the first 128 that finish: {report:.2f}")

# %% [markdown]
# <table>
# <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr>
# <tr><td>reward stays flat from the first step</td> <td>chance never finds it</td> <td>count successes of random
# actions</td> <td>a potential; easier starts</td></tr>
# <tr><td>reward rises, success doesn't</td> <td>reward hacking</td> <td>worth of the best way against staying
# near</td> <td>pay once, and end</td></tr>
# <tr><td>rises, then breaks down</td> <td>too far in one iteration</td> <td>its divergence</td> <td>fewer epochs, a
# smaller step</td></tr>
# <tr><td>test at 1, demonstration fails</td> <td>first to finish; statistics of the test</td> <td>one episode in each,
# statistics frozen</td> <td>the hunt of section 9</td></tr>
# <tr><td>the copy wavers in front of the obstacle</td> <td>two ways, a look at each step</td> <td>changes of side in a
# run</td> <td>carry out more of a chunk</td></tr>
# <tr><td>the copy stops for good</td> <td>a pause in the data, no memory</td> <td>steps without motion that were
# shown</td> <td>cut pauses; chunks longer than these</td></tr>
# </table>
#
# ## 9 · Exercises
#
# Graded exercises and a hunt. `check` asks your cell on cases drawn afresh, and says what is wrong and, if it
# can, why.

# %% [markdown]
# ### A gradient by hand

# %%
card("backprop")


# %%
def backprop(x, target, W1, b1, W2, b2):
    """Return gradients of a net of two layers, tanh after the first, by hand.

    (dW1, db1, dW2, db2).
    """
    # A net that is not to be changed.
    return np.zeros(np.shape(W1)), np.zeros(len(b1)), np.zeros(np.shape(W2)), np.zeros(len(b2))


check(backprop)

# %% [markdown]
# ### Whose merit?

# %%
card("gae")


# %%
def gae(reward, value, following, terminated, truncated, gamma, lam):
    """Return generalised advantage estimates of T steps in N environments.

    And the critic's targets.
    """
    # One step ahead only.
    target = np.asarray(reward, dtype=float) + gamma * np.asarray(following, dtype=float)
    return target - value, target


check(gae)

# %% [markdown]
# ### The clipped objective

# %%
card("ppo_objective")


# %%
def ppo_objective(new, old, advantage, clip):
    """Return PPO's clipped objective, which is to be raised, and its gradient by `new`."""
    # The policy gradient, without ratio and clip.
    return float(np.mean(np.multiply(new, advantage))), np.divide(advantage, len(advantage))


check(ppo_objective)

# %% [markdown]
# ### Ask the expert

# %%
card("dagger_round")


# %%
def dagger_round(A, B, expert, states, labels, start, steps):
    """Return one round of DAgger, with a linear learner u = K x fitted by least squares."""
    # Cloning: nothing is added.
    return states, labels, np.linalg.lstsq(np.transpose(states), np.transpose(labels))[0].T


check(dagger_round)

# %% [markdown]
# ### Follow the flow

# %%
card("flow_sample")


# %%
def flow_sample(field, noise, steps):
    """Return samples of a flow policy.

    From noise at time 0 to actions at time 1, by Heun's method.
    """
    # One large step.
    return np.asarray(noise, dtype=float) + field(noise, 0.0)


check(flow_sample)

# %% [markdown]
# ### Commit, or average

# %%
card("execute_chunks")


# %%
def execute_chunks(chunks, every, rate):
    """Return what is executed of a chunk policy.

    Committed for some steps, and ensembled over time.
    """
    # One whole chunk, then nothing.
    plans = np.zeros((np.shape(chunks)[0], np.shape(chunks)[2]))
    plans[: np.shape(chunks)[1]] = chunks[0][: len(plans)]
    return plans, plans


check(execute_chunks)

# %% [markdown]
# ### A reward that is paid once

# %%
card("reach_reward")


# %%
def reach_reward(path, goal, radius, gamma):
    """Return rewards of a logged run to a disc.

    1 for reaching it, and a potential: minus the distance.
    """
    # Minus the distance itself, and a bonus wherever it is inside.
    distance = np.linalg.norm(np.asarray(path, dtype=float).T - goal, axis=1)[1:]
    return (distance <= radius) - distance, len(distance)


check(reach_reward)

# %% [markdown]
# ### Silent-bug hunt
#
# The curve of its author goes to one.

# %%
card("training_round")


# %%
def training_round(weights, statistics, starts, noise, tested):
    """Return one round of training a carriage to go to 0, and the point of its learning curve."""
    dt, limit, sigma, rate = 0.1, 20, 0.5, 0.1
    w, known = np.array(weights, dtype=float), np.array(statistics, dtype=float)

    def normalised(x):
        count, mean, squares = known
        new = mean + np.sum(x - mean) / (count + x.size)
        known[:] = count + x.size, new, squares + np.sum((x - mean) * (x - new))
        return (x - known[1]) / np.sqrt(known[2] / known[0])

    def score():
        x, age, finished = np.array(tested, dtype=float), np.zeros(len(tested)), []
        while len(finished) < len(tested):
            x = x + dt * np.clip(w[0] * normalised(x) + w[1], -1.0, 1.0)
            age += 1
            over = (np.abs(x) < 0.1) | (age == limit)
            finished += list(np.abs(x[over]) < 0.1)
            x[over], age[over] = tested[over], 0
        return float(np.mean(finished[: len(tested)]))

    x, slopes, rewards = np.array(starts, dtype=float), [], []
    for drawn in noise:
        z = normalised(x)
        mean = w[0] * z + w[1]
        action = np.clip(mean + sigma * drawn, -1.0, 1.0)
        x = x + dt * action
        slopes.append((action - mean) / sigma**2 * np.array([z, np.ones(x.size)]))
        rewards.append(-np.abs(x))
    ahead = np.cumsum(rewards[::-1], axis=0)[::-1]
    better = ahead - np.mean(ahead, axis=1, keepdims=True)
    w += rate * np.mean(np.array(slopes) * better[:, None], axis=(0, 2))
    return w, known, score()


check(training_round)

# %% [markdown]
# ### A formula: what one reads

# %%
answer("first_to_finish", "p")

# %% [markdown]
# ## 10 · Frontier: foundation policies, and why chunks help
#
# <table>
# <tr><th>work</th> <th>year</th> <th>what it is</th> <th>size and data, as stated</th> <th>what is said of it</th></tr>
# <tr><td>RT-2 (Brohan and others, arXiv 2307.15818)</td> <td>2023</td> <td>a **vision-language-action model**: pictures
# and words in, actions out, written as text tokens</td> <td>variants of 55 and 5 (PaLI-X) and 12 billion parameters
# (PaLM-E); web data and robot data together; about 6,000 trials</td> <td>"a 55B model": the largest of three, at 1 to
# 3 Hz</td></tr>
# <tr><td>Octo (Octo Model Team, arXiv 2405.12213)</td> <td>2024</td> <td>an open transformer with a diffusion
# head</td> <td>27 and 93 million; 800,000 trajectories, 25 sets of Open X-Embodiment</td> <td>"trained on the set of a
# million": on a part of it</td></tr>
# <tr><td>pi-0 (Black and others, arXiv 2410.24164)</td> <td>2024</td> <td>a pretrained vision-language model with a
# flow-matching head for chunks</td> <td>3.3 billion; about 10,000 hours, 7 robots, 68 tasks; chunks of 50, ten Euler
# steps</td> <td>"uses flow matching": yes</td></tr>
# <tr><td>LeRobot (Cadene and others, arXiv 2602.22818)</td> <td>2026</td> <td>an open library: motors, data format,
# training, asynchronous inference</td> <td>no model</td> <td>"a unified framework": of tools; each method keeps its own
# assumptions</td></tr>
# </table>
#
# (Octo and LeRobot from abstract and project page, RT-2 and pi-0 from abstract and others' summaries; nothing was
# downloaded or run.) Each is one of this chapter's heads behind a large encoder. Data of many robots buy it states that
# one robot's demonstrations don't span. What the heads do, they do here.
#
# *Why do chunks help?* Three tasks, the same labels for all, with and without pushes while they were collected:

# %%
mixture, rng = heads["mixture"], np.random.default_rng(0)
taught = {}
for injected in (0.0, 0.01):
    shown = roll(plant, plant.expert, plant.starts(100, rng), 40, rng, injected=injected)
    states, chunks = learning.windows(shown, 8)
    whole = np.tile(np.arange(40) <= 32, 100)  # behind the end of a run there are zeros
    taught[injected] = learning.linear(states[whole], chunks[whole].reshape(whole.sum(), -1))


def lost(injected, executor, *how):
    """Return share of runs of the regulator that end ten times as far off as they began."""

    def act(observed, rng):
        return taught[injected](observed, rng).reshape(len(observed), 8, 1)

    rng = np.random.default_rng(1)
    begin = plant.starts(200, rng) + 0.01 * rng.standard_normal((200, 2))
    far = np.abs(roll(plant, executor(act, *how), begin, 100, rng).states).max(axis=2)
    return np.mean(far[:, -1] > 10.0 * far[:, 0])


def missed(executor, how):
    """Return wrong steps of 40 in contexts, 5 of 1,000 miscopied.

    Without a way back, and with one.
    """
    observed = (np.arange(40) % how == 0) & (executor is Commit)
    wrong = np.where(
        observed, 0.005, 0.5
    )  # what comes next is not seen before: one of two is a guess
    return np.sum(1.0 - np.cumprod(1.0 - wrong)), wrong.sum()


cases = (("each step", Commit, 1), ("chunk of 2", Commit, 2), ("chunk of 8", Commit, 8),
         ("a step late", Delayed, 1), ("three late", Delayed, 3))  # fmt: skip
noises = (0.0, 0.01, 0.02, 0.03, 0.05)
figure_, axis = plt.subplots(figsize=(6, 2.4), layout="constrained")
print("             two ways         regulator, lost     contexts, wrong of 40")
print("             pass   pushed    as is  pushes       no way back   with one")
for name, executor, how in cases:
    rates = []
    for noise in noises:
        disturbed, rng = TwoWays(noise=noise), np.random.default_rng(7)
        ran = roll(disturbed, executor(mixture, how), disturbed.starts(600, rng), 16, rng)
        rates.append(np.mean(disturbed.sides(ran.states) != 0))
    _ = axis.plot([1000 * x for x in noises], rates, ".-", label=name)
    never, back = missed(executor, how)
    print(
        f"{name:<13}{rates[0]:.2f}   {rates[-1]:.2f}      {lost(0.0, executor, how):5.0%}"
        f"  {lost(0.01, executor, how):5.0%}        {never:11.1f}   {back:8.1f}"
    )
_ = axis.set(xlabel="push in a step [mm]", ylabel="pass, of two ways")
_ = axis.legend(fontsize=7)
plt.show()

# %%
print_figures("commit_or_react", "1 executed", "2 executed", "delayed", "noise")

# %% [markdown]
# Zhang and others (arXiv 2507.09061, 2025, from the abstract): errors of a copy can grow exponentially; chunks and
# pushed demonstrations each prevent that, in different regimes, and what decides is stability. A newer paper (arXiv
# 2608.02547, 2026, which we could not read) is said to credit delay instead: one step, on an *older* state, does as
# well.
#
# On two ways an old state does what a chunk of two does: both keep what was begun. There the later explanation is
# enough. The regulator is unstable even without a policy; neither chunk nor delay helps, pushes do, as the first paper
# would have it. On two ways pushes help most under pushes, and cost most without.
#
# Contexts can't be foreseen, so chunks and delays guess; only a way back that was shown helps. So ask first whether
# your task has several ways, an unstable loop, or news at every step.
#
# ## 11 · Interview
#
# Answer aloud, then open: first what one says in a minute, then the whole of it, then what comes next.

# %%
interview("learning")

# %% [markdown]
# ### Checkpoint
#
# *In your own words: when does a learned policy beat a written one, and how would you prove it? An example for each
# side.* Write it down first; then unfold.

# %%
mine = ""
print("written" if len(mine.split()) > 30 else "open: thirty words or more")

# %% [markdown]
# <details><summary>An answer, from this chapter</summary>
#
# *A written law wins* where its form is known: two gains reach most of the optimum of the point, in no time, and one
# can say when they are stable. *Reward wins* where a simulator is cheap and nobody knows the form. *Copying wins* where
# somebody can do it and nobody can say how, as with cloth. *Proof*: the same starts for both, one episode each, several
# seeds of what was trained, bands, the optimum or the expert as the line; pushes; and the states where they differ.
#
# </details>
#
# Three formulas that are not on this page; you can derive them from what is. The gate opens when all are right.

# %%
checkpoint("learning", clone_error_grows="", ways_missed="", ensembling_averages="")
