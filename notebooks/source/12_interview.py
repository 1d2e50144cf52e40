# %% [markdown]
# # 12 · The interview
#
# *This chapter turns the measurements of this course into interview questions, and you answer aloud.*
# About {open minutes} minutes of reading, cards and charts. The folded parts add {folded minutes} minutes, the
# exercises {exercise minutes} minutes. Model answers, flashcards and five debugging cases are not counted.

# %%
from course.cards import predict
from course.simulations import simulation

simulation("interview")

# %% [markdown]
# Answer this question aloud while the thin bar shrinks. Then click *Reveal*, compare, and rate yourself. When your
# predicted chance to recall it (the curve) is near 90 %, the question comes back.
#
# A **policy** is the part of a robot's program that chooses actions. It may go from the simulator to the robot only if
# a test shows that its true success rate is above a limit, the **gate**. First judge a simpler rule:

# %%
predict("hundred_runs")

# %% [markdown]
# **After this chapter you can** answer with a number that you can justify, in thirty seconds or in five minutes; design
# a system on a whiteboard, with rates and latencies on its arrows; and find a fault with a few well-chosen experiments.
# **Know first:** as many of the other chapters as you have time for.
#
# ## How this chapter works
#
# Interviews for robotics jobs often have five rounds. On the phone you give short answers: you explain a concept,
# judge a statement, estimate a number. At the whiteboard you design a system. In the coding round you write some thirty
# lines. In the debugging round you find out why a program fails. In the behavioural round you tell what you did at
# work, and why. A broad question may end any of them: would you learn a component or write it by hand? The picture
# shows where you practise each, and section 9 has questions from all of them:

# %% tags=["hide-code"]
import matplotlib.pyplot as plt
import numpy as np
from IPython.display import SVG, Markdown
from scipy.stats import binom

from course.cards import interview
from course.charts import stored
from course.derivations import more_claims, show
from course.derivations.records import figure
from course.interview import designs, invariants, museum, tables
from course.interview.estimates import ESTIMATES
from course.interview.fields import filled
from course.interview.scenarios import diagnose, expected, scenario
from course.page_records import from_record

BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#7f7f7f"

ROUNDS = {
    "phone screen": "sections 1, 2",
    "whiteboard": "section 3",
    "coding": "sections 4, 8",
    "debugging": "sections 5, 6",
    "behavioural": "section 9",
    "broad question": "section 7",
}
figure_, axis = plt.subplots(figsize=(11.0, 1.2), layout="constrained")
for place, (name, where) in enumerate(ROUNDS.items()):
    axis.text(
        place,
        0.0,
        f"{name}\n{where}",
        ha="center",
        va="center",
        bbox={"boxstyle": "round,pad=0.6", "facecolor": "#eef3fa", "edgecolor": BLUE},
    )
    if place:
        axis.annotate("", (place - 0.34, 0.0), (place - 0.64, 0.0), arrowprops={"arrowstyle": "->"})
axis.set(xlim=(-0.5, len(ROUNDS) - 0.5), ylim=(-1.0, 1.0))
axis.axis("off")
plt.show()

# %% [markdown]
# The measured numbers in the model answers come from this course, and `python -m course.derivations 12` computes those
# of this chapter again. Inputs such as masses, speeds and reaction times are assumptions. The four stories in section 9
# ("Tell me about ..." and "Describe a problem ...") are invented: replace them with your own. In a
# terminal:
#
# | Command | What it does |
# |---|---|
# | `drills review` | shows the flashcards that are due today |
# | `drills interview --minutes 45` | runs a mock interview with shortened rounds, then writes a report |
# | `drills debug explodes` | lets you experiment on the faulty program `explodes`, one of six |
#
# Section 8 has these exercises:

# %% tags=["nbval-ignore-output"]
from drills.notebook import badges, card, check, checkpoint

badges(12)

# %% [markdown]
# ## 1 · Concept: thirty seconds on each subject
#
# An interviewer opens with a broad question, such as "What do you know about contact simulation?" A good answer takes
# thirty seconds. It says what the thing is, and gives one equation and a measured number. It ends with the limit: the
# point where the method stops working.
#
# The table has eight subjects from eight chapters, with an equation to write while you speak. Speak about each for
# thirty seconds, then open its text below the table: it has the words, a measurement and the limit. The measurement is
# how long our method and an established library take for one task, on one machine. Such a pair is often unequal
# (special against general, compiled against Python): say that, too.

# %% tags=["hide-code"]
sheet = tables.cheat_sheet()
overview = tables.Table(
    sheet.title, (sheet.head[0], *sheet.head[2:]), tuple((row[0], *row[2:]) for row in sheet.rows)
)
texts = [
    f"<details><summary>{row[0]}: the text for thirty seconds</summary>\n\n{row[1]}\n\n</details>"
    for row in sheet.rows
]
Markdown("\n\n".join([overview.markdown(), *texts]))

# %% [markdown]
# <div class="alert alert-block alert-success">
#
# **Interview tip.** Say first the answer, then its number, then its limit; then stop. For example: "Which integrator do
# you use?" "Semi-implicit Euler. For 1 kg on an undamped spring of 100,000 N/m it is stable below a step of 6.3 ms: two
# divided by the angular frequency. With a stiffer spring I need a smaller step."
#
# </div>
#
# ### How good is a policy that passed a test?
#
# A *trial* is one run of the policy. Suppose that each trial succeeds with the same probability $p$, the **true success
# rate**, and that no trial affects another. Here $p$ is the rate in the simulator: how far the robot's rate is from it,
# no number of simulated trials can tell.
#
# The *observed rate* is the number of successes divided by the number of trials $n$. It scatters around $p$ (by the
# binomial distribution), with the standard deviation
#
# $$\sigma = \sqrt{\frac{p\,(1 - p)}{n}} .$$
#
# The picture shows how likely each count is for $p = 0.7$ and $n = 100$. The band reaches two standard deviations to
# each side:

# %% tags=["hide-code"]
counts = np.arange(50, 91)
figure_, axis = plt.subplots(figsize=(6.5, 2.2), layout="constrained")
axis.bar(counts, binom.pmf(counts, 100, 0.7), color=BLUE)
spread = np.sqrt(100 * 0.7 * 0.3)
axis.axvspan(70 - 2 * spread, 70 + 2 * spread, color=ORANGE, alpha=0.2)
axis.set(xlabel="successes in 100 trials", ylabel="probability")
plt.show()

# %% [markdown]
# **A worked example.** For $p = 0.7$ and $n = 100$ the formula returns $\sqrt{0.21 / 100} = 0.046$. Two standard
# deviations are 0.09. So a policy whose true rate is 70 % usually shows an observed rate between 61 % and 79 %. To
# halve this width you need four times as many trials.
#
# In practice you know the observed rate and look for the true one. A **confidence interval** is a range of true rates
# that fit the observed rate. A *level* of 95 % means: if you repeat the whole test again and again, about 95 % of the
# intervals that you compute contain the true rate.
#
# We use the **Wilson interval**. Try each possible true rate $p$, and compute its standard deviation with the formula
# above. If the observed rate is at most 1.96 (about two) of these standard deviations away from $p$, for a level of
# 95 %, then $p$ belongs to the interval. For 70 successes in 100 trials the interval goes from 60 % to 78 %.
#
# On cards with a claim, *Only under a condition* means: the claim is true in some situations that occur in practice,
# and false in others.

# %%
show("hundred_trials")

# %% [markdown]
# "At least 70 of 100" is a bad rule for a gate of 70 %: a policy whose true rate is exactly 70 % passes more than half
# of the time, by luck. So demand more successes. A **one-sided test at 5 %** demands so many that a policy exactly at
# the gate has that many or more in at most 5 % of all tests: the smallest such number. The chart shows how likely a
# policy is to pass, for each true rate:

# %% tags=["hide-code"]
rate = np.linspace(0.6, 1.0, 161)


def bar(n):
    """Return the number of successes in n trials that the one-sided test at 5 % demands."""
    return next(k for k in range(n + 1) if binom.sf(k - 1, n, 0.7) <= 0.05)


figure_, axis = plt.subplots(figsize=(6.5, 2.6), layout="constrained")
for n in (20, 100, 500):
    axis.plot(rate, binom.sf(bar(n) - 1, n, rate), label=f"{n} trials")
axis.axvline(0.7, color="0.6", lw=1, ls="--")
axis.text(0.703, 0.9, "gate", color="0.4", fontsize=8)
axis.set(xlabel="true success rate", ylabel="probability to pass the\none-sided test at 5 %")
axis.legend(fontsize=8, loc="lower right")
plt.show()
for n in (100, 119):
    chances = (binom.sf(bar(n) - 1, n, p) for p in (0.7, 0.8))
    print(
        f"{n} trials: {bar(n)} successes are needed; a policy with a true rate of 70 % passes "
        "with\nprobability {:.3f}, one with 80 % with probability {:.2f}".format(*chances)
    )

# %% [markdown]
# With 20 trials, even a policy with a true rate of 80 % usually fails the test. The **power** of this test is the
# probability that a policy passes if its true rate is a given amount above the gate. So first name the true rate at
# which a policy should pass, for example 80 %, and the power that you want, often 80 % as well. Then take enough
# trials: the output above shows that 119, with 92 successes demanded, are enough.
#
# This answers the question in the first panel. Yes, release the policy, if the trials were independent and this test
# was chosen before the first one: 78 of 100 just pass. If no test was chosen, choose one now and run new trials: with
# the old ones you might choose a test that the policy passes. Plan 119: with 100, the test rejects about one in four
# policies with a true rate of 80 %.
#
# Some teams demand instead that the lower end of Wilson's 95 % interval reaches the gate. This interval is
# **two-sided**: its 5 % of error are divided between the two ends, about 2.5 % each. So the lower end alone is a
# one-sided test at about 2.5 %, which is stricter. For 78 of 100 the lower end is 69 %, below the gate: in such a team,
# the same policy is not released.
#
# ### What does an accelerometer measure?
#
# Think of an accelerometer as a small mass on a spring, inside a housing. It measures the force of the spring on the
# mass, divided by the mass. In free fall without rotation, mass and housing fall alike, so the spring is not deformed
# and the reading is zero. At rest on a table, the spring carries the mass: the reading is 9.81 m/s² upward. The reading
# is the **specific force** $f = a - g$, in the axes of the sensor. Here $a$ is the acceleration of the point at which
# the sensor sits, and $g$ the gravity vector, which points down.

# %%
show("imu_reads_acceleration")

# %% [markdown]
# ### How to say "I measured" honestly
#
# Five habits make a number yours:
#
# * **Say where the number comes from.** "In a course I measured ...", "in a simulation I computed ...", "at work we
#   measured ...". If you only read it, say where.
# * **Give the setting with the number**: the scene, the time step, the machine, how many trials.
# * **Give a success rate with its count and its interval.** On this page, the interval of a success rate is Wilson's at
#   95 %. A gate is tested one-sided at 5 %, unless the text says otherwise. Two policies are compared two-sided at 5 %,
#   because either may be the better one.
# * **Separate assumptions from results.** "I assume a speed of 1.5 m/s, a reaction time of 0.2 s and braking with 2
#   m/s². Then the base needs 0.86 m to stop."
# * **Say what you would measure next, and what you will do if the result is bad.**
#
# The numbers of this course are from simulations, the computing times from the machine that each chart names. If
# you name a safety standard, give its number and edition. Never quote a limit in a standard from memory.
#
# ### Where are the joints of a planar arm?
#
# A standard warm-up for the coding round is forward kinematics in the plane. The arm has links of lengths $L_i$ and
# joint angles $q_i$. A joint angle says by how much the link after the joint is turned, counter-clockwise, from the
# direction of the link before it. If the link continues straight on, the angle is zero. The first link is measured
# from the horizontal.

# %%
show("joints_by_sums")

# %% tags=["hide-code"]
lengths, turns = np.array([0.5, 0.4, 0.3]), np.radians([35.0, 30.0, -50.0])
sums = np.cumsum(turns)
steps = lengths[:, None] * np.c_[np.cos(sums), np.sin(sums)]
joints = np.vstack(([0.0, 0.0], np.cumsum(steps, axis=0)))
figure_, axis = plt.subplots(figsize=(6.5, 2.8), layout="constrained")
axis.plot(*joints.T, "o-", color=BLUE, lw=4, ms=9)
for place, (joint, total) in enumerate(zip(joints[:-1], sums, strict=True)):
    if place:  # the angle of the joint alone: from the link before, drawn on, to the link
        before = sums[place - 1]
        ahead = joint + 0.3 * np.array([np.cos(before), np.sin(before)])
        axis.plot(*np.vstack((joint, ahead)).T, color=BLUE, lw=1, ls=":")
        arc = joint + 0.24 * np.c_[np.cos(s := np.linspace(before, total, 30)), np.sin(s)]
        axis.plot(*arc.T, color=BLUE, lw=1.5)
        middle = 0.5 * (before + total)
        axis.text(
            *(joint + 0.28 * np.array([np.cos(middle), np.sin(middle)])),
            f"$q_{place + 1}$",
            color=BLUE,
            va="center",
        )
    arc = joint + 0.13 * np.c_[np.cos(s := np.linspace(0.0, total, 30)), np.sin(s)]
    axis.plot(*np.vstack((joint, joint + [0.2, 0.0])).T, color=GREY, lw=1, ls="--")
    axis.plot(*arc.T, color=ORANGE, lw=2)
    label = " + ".join(f"$q_{k + 1}$" for k in range(place + 1))
    axis.text(*(joint + [0.2, -0.005]), f" {label}", va="center", color=ORANGE)
axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", xlim=(-0.1, 1.4), ylim=(-0.08, 0.95))
plt.show()

# %% [markdown]
# Blue arcs are the joint angles $q_2$ and $q_3$. ($q_3$ is negative: the link is turned clockwise.) Orange arcs are
# the sums of the angles so far, and each is the direction of a link, measured from the horizontal (dashed). In code,
# `np.cumsum(angles)` computes these sums. A second cumulative sum, over the vectors along the links, starts at the
# base and returns the ends of the links: the other joints and the tip.
#
# ### What does a sampled controller cost?
#
# A digital controller computes a command and holds it until the next sample. So a command is fresh at the beginning
# of a step, one sample old at its end, and half a sample old on average. The picture shows a smooth command, the
# staircase that the motor receives, and the average of the staircase over a window of one sample around each point. The
# average has nearly the shape of the ideal command, but it is half a sample late.

# %% tags=["hide-code"]
time = np.linspace(0.0, 8.0, 801)
figure_, axis = plt.subplots(figsize=(6.5, 2.5), layout="constrained")
axis.plot(time, np.sin(0.8 * time), color=GREY, label="ideal command")
axis.plot(time, np.sin(0.8 * np.floor(time)), color=BLUE, label="held command")
held = np.sin(0.8 * np.floor(np.linspace(-1.0, 9.0, 1001)))
smooth = np.convolve(held, np.full(101, 1 / 101), mode="same")[100:-100]
axis.plot(time, smooth, color=ORANGE, ls=":", lw=2, label="held command, averaged")
axis.set(xlabel="time [samples]", ylabel="command")
axis.legend(fontsize=8, loc="lower left")
plt.show()

# %%
show("hold_is_half_a_sample")

# %% [markdown]
# So a loop at 1,000 Hz pays 0.5 ms for holding its commands. The time for measuring and computing comes on top. A late
# command still pushes when the joint has already moved on. With a high gain this can make the joint oscillate.
#
# The rule is for slow motions. We compared a rigid joint with viscous friction under held commands with the same joint
# under a smooth command that is half a sample late. With six samples per period, their phases differ by at most about
# one degree (a period is 360 degrees). With only two, they can differ by far more. But half a sample of six is 30
# degrees, which is much for a feedback loop.

# %%
more_claims("stiff_is_position")

# %% [markdown]
# ## 2 · Concept: the back of the envelope
#
# "How many picks per hour can this cell do?" The interviewer wants to see a short calculation whose inputs you state
# aloud.
#
# The **cycle time** of a picking cell is the time from one part to the next. Here it is the sum of three times: for the
# motion, for gripping and releasing, and for the computing during which the arm stands still. In each move the arm goes
# from rest to rest over a distance $D$. It accelerates and brakes with $a$, and its top speed is $v$. If it reaches
# $v$, the curve of its speed over time is a trapezoid, otherwise a triangle. The area under the curve is the distance
# $D$. From this follows the time $T$:
#
# $$T = \frac{D}{v} + \frac{v}{a} \quad\text{if}\; D \ge \frac{v^2}{a}, \qquad T = 2\sqrt{\frac{D}{a}}
# \quad\text{otherwise} .$$
#
# **A worked example.** A move of 0.6 m with 1 m/s and 2 m/s² is a trapezoid, because $v^2/a$ is 0.5 m. It takes 0.6 +
# 0.5 = 1.1 s. Four such moves, 0.6 s of gripping and 0.17 s of computing make a cycle of 4.4 + 0.6 + 0.17 = 5.17 s,
# or about 700 picks per hour. Planning all four moves takes 0.1 s of the computing. Below, the left panel also shows a
# shorter move: a triangle.

# %% tags=["hide-code"]
figure_, (left, right) = plt.subplots(
    1, 2, figsize=(8.5, 2.3), layout="constrained", width_ratios=(1, 2)
)
left.plot([0, 0.5, 0.6, 1.1], [0, 1, 1, 0], color=BLUE, label="0.6 m: trapezoid")
half = np.sqrt(0.15 / 2.0)
left.plot([0, half, 2 * half], [0, 2 * half, 0], color=ORANGE, label="0.15 m: triangle")
left.set(xlabel="time [s]", ylabel="speed [m/s]", ylim=(0, 1.55))
left.legend(fontsize=7, loc="upper right")
spans = [("planning", 0.1, "#cc79a7"), ("other computing", 0.07, "#e69f00")]
spans += [("four moves", 4.4, BLUE), ("gripping", 0.6, GREY)]
start = 0.0
for name, span, colour in spans:
    right.barh(0, span, left=start, color=colour, label=f"{name}: {span:g} s")
    start += span
right.set(xlabel="time of one cycle [s]", yticks=[], ylim=(-0.5, 1.6))
right.legend(fontsize=7, ncols=2, loc="upper center")
plt.show()

# %%
predict("twice_the_planner")

# %%
show("computing_and_cycle")

# %% [markdown]
# <details><summary>Simulation on GPUs: what you can measure on one core</summary>
#
# Interviewers ask what decides how well thousands of small worlds run on a GPU. Two effects can be measured on a
# processor. The first is the **layout**. An *array of structures* stores all numbers of a world next to each other. A
# *structure of arrays* stores one number of all worlds next to each other. *Blocks of arrays* are structures of arrays
# for a few hundred worlds each. The second effect is **divergence**. A GPU computes in groups of *lanes*, one world per
# lane, which share their instructions: all lanes of a group wait while one of them runs a branch.
#
# ![Time per arm by layout, by block width, and lanes occupied by contact](../docs/charts/batch_layout.png)
#
# All layouts run the same compiled source on the two-link arm of chapter 8, and agree to the last bit. The dotted lines
# mark the number of arms whose data fill a cache of the processor (L1 is the smallest). Upper left, "a call per arm"
# runs the same source for one arm at a time, and the two curves of MuJoCo use its functions for many worlds.
#
# A full Runge-Kutta step uses all numbers of an arm, so its layout matters little. What matters is the number of arms
# in a call. The upper right panel shows a pass that reads 4 of 17 numbers, where structures carry unused bytes along.
# MuJoCo takes longer per arm because it is a general engine: it builds the equations of any robot at every step.
#
# The lower left panel varies the width of a block. Lower right, groups of lanes execute the contact branch if one lane
# needs it. The lines are the formula of the card below, divided by the share of arms in contact. Nothing here was
# measured on a GPU.
#
# </details>

# %%
more_claims("rare_contact_is_cheap", "bytes_by_fields")

# %% [markdown]
# ### Six estimates
#
# Practise estimating these six numbers. They are for another robot than above: it picks parts from a moving belt.
#
# The **stopping distance** is how far a robot still travels after its sensor could first notice the reason to stop. So
# it contains the reaction time. The **effective mass** is the mass that you would feel if a given point of the arm hit
# you in a given direction. It depends on the posture.
#
# Below, the third row is the position error along the belt. It is the sum of two kinds of errors. A **systematic
# error** is the same in each pick. Here it is the distance that the part travels while the camera image is processed:
# belt speed times processing time. We know its size, but this robot does not correct for it. (Then the arm follows the
# belt.)
#
# A **random error** differs from pick to pick. Its mean is zero, and you know only its standard deviation $\sigma_i$.
# The sum of independent random errors has the standard deviation $\sqrt{\sum\sigma_i^2}$. If this sum is normally
# distributed, it is within two standard deviations in about 95 % of the picks. We add two standard deviations to the
# systematic error, so about 95 % of the picks or more stay within the estimate.
#
# The *hand-eye error* (in the angle between camera and arm) is the same in each pick of one robot. The robot is not
# built yet, so we don't know this error and treat it as random. The 95 % then hold for the picks of many such robots
# together; one with a large hand-eye error does worse. On a real robot, calibrate it, and add what may remain to the
# systematic error.

# %% tags=["hide-code"]
INPUTS = {
    "legs_m": ("moves", "m"),
    "top_m_per_s": ("top speed v", "m/s"),
    "rise_m_per_s2": ("acceleration a", "m/s²"),
    "still_s": ("gripping and releasing", "s"),
    "computing_s": ("waiting for the computer", "s"),
    "range_m": ("distance to the camera", "m"),
    "pixel_spread_px": ("pixel error", "px"),
    "focal_px": ("focal length", "px"),
    "hand_eye_spread_mrad": ("hand-eye error", "mrad"),
    "arm_spread_mm": ("error of the arm", "mm"),
    "speed_m_per_s": ("speed v", "m/s"),
    "delay_ms": ("processing time", "ms"),
    "mass_kg": ("mass m of the part", "kg"),
    "friction": ("friction coefficient μ", ""),
    "safety": ("safety factor S", ""),
    "fingers": ("fingers n", ""),
    "reaction_s": ("reaction time t", "s"),
    "braking_m_per_s2": ("braking a", "m/s²"),
    "stiffness_n_per_m": ("stiffness k", "N/m"),
    "robot_kg": ("effective mass m", "kg"),
}
POSITION = (
    r"belt speed × processing time $+\;2\sqrt{\sum\sigma_i^2}$<br>"
    r"$\sigma_1$: pixel error × distance / focal length<br>"
    r"$\sigma_2$: hand-eye error × distance<br>$\sigma_3$: error of the arm"
)
LABELS = {
    "cycle": ("Time of one pick and place", "moves + gripping + waiting"),
    "computing_share": ("Share of computing in that time", "waiting / cycle"),
    "finger_error": ("Position error at the fingertip, along the belt", POSITION),
    "grip_force": (
        "Force with which each finger presses to lift a part",
        r"$S\,m(g + a)/(n\mu)$<br>a points upward",
    ),
    "stopping": ("Stopping distance of the arm", r"$vt + v^2/(2a)$"),
    "contact_clamped": ("Peak force on something that cannot move", r"$v\sqrt{km}$"),
}
SPEEDS = {"finger_error": "belt speed", "stopping": "speed v near people"}
SPEEDS["contact_clamped"] = SPEEDS["stopping"]
rows, last = ["| Estimate | Formula | Value | Inputs |", "|---|---|---:|---|"], ""
for name, (label, formula) in LABELS.items():
    one = ESTIMATES[name]
    known = INPUTS | {"speed_m_per_s": (SPEEDS.get(name, ""), "m/s")}
    # The arm brakes as hard as it accelerates in the first row.
    other = {"braking_m_per_s2": 3.0} if name == "stopping" else {}
    inputs = "; ".join(
        f"{known[key][0]} {', '.join(f'{x:g}' for x in np.atleast_1d(value))} {known[key][1]}".strip()
        for key, value in (one.given() | other).items()
    )
    shown, last = ("as in the row above" if inputs == last else inputs), inputs
    value = one.value(**other)
    digits = 2 if name in ("finger_error", "stopping") else 3
    result = f"{value:.{digits}g} {one.unit}" if one.unit else f"{value:.1%}"
    rows.append(f"| {label} | {formula} | {result} | {shown} |")
Markdown("\n".join(rows))

# %% [markdown]
# Which input matters most? Double one at a time, here for the peak force:

# %% tags=["hide-code"]
one = ESTIMATES["contact_clamped"]
base = one.value()
for name, given in one.given().items():
    if isinstance(given, float) and given:
        factor = one.value(**{name: 2 * given}) / base
        label = " ".join(INPUTS[name])
        print(f"{label:<22} {given:8.3g} -> {2 * given:8.3g}   peak force x {factor:.2f}")

# %% [markdown]
# The speed matters most, but the input that you know worst is often the stiffness. You can derive the formula yourself:
# the contact acts like a linear spring, and if the motors don't act, this spring has stored all kinetic energy of the
# effective mass at its deepest point.
#
# ### Stop when you feel ten newtons
#
# Take an arm with an effective mass of 4 kg. It arrives with 0.25 m/s and meets a stiffness of 25,000 N/m. Its motors
# brake it with 100 N at the tip, beginning 8 ms after the sensor reads 10 N. (A mechanical brake would engage later.)

# %%
predict("ten_newtons")

# %% [markdown]
# The picture shows the contact from the touch until the arm first stands still, pressed into the spring. The dashed
# line marks the moment at which the force reaches 10 N:

# %% tags=["hide-code"]
mass, speed, stiffness, brake, delay = 4.0, 0.25, 25_000.0, 100.0, 0.008
curves = {}
for label, braking, wait in (
    ("no braking", 0.0, 0.0),
    ("100 N, 8 ms after 10 N", brake, delay),
    ("100 N, at 10 N", brake, 0.0),
):
    depth, rate_, clock, felt, log = 0.0, speed, 0.0, np.inf, []
    while rate_ > 0.0:
        force = stiffness * depth
        felt = min(felt, clock) if force >= 10.0 else felt
        push = braking if clock > felt + wait else 0.0
        rate_ -= 1e-5 * (force + push) / mass
        depth += 1e-5 * rate_
        clock += 1e-5
        log.append((1e3 * clock, force, rate_))
    curves[label] = np.array(log)
figure_, (upper, lower) = plt.subplots(1, 2, figsize=(8.5, 2.4), layout="constrained")
for (label, log), colour in zip(curves.items(), (GREY, BLUE, "#009e73"), strict=True):
    upper.plot(log[:, 0], log[:, 1], color=colour, label=f"{label}: peak {log[:, 1].max():.0f} N")
    lower.plot(log[:, 0], log[:, 2], color=colour)
for axis in (upper, lower):
    axis.axvline(1e3 * felt, color=ORANGE, lw=1, ls="--", label="10 N reached")
    axis.set(xlabel="time since the touch [ms]")
upper.set(ylabel="contact force [N]", ylim=(0, 140))
upper.legend(fontsize=7, loc="upper left")
lower.set(ylabel="speed [m/s]")
plt.show()

# %% [markdown]
# When the force reaches the threshold, the arm still has nearly all of its speed. The motors begin to brake 8 ms later,
# when the contact has absorbed nearly half of the arm's energy. So they lower the peak by only about a fifth. Even
# without this delay (green), the peak would be more than three times the threshold.
#
# What helps: a low speed, a small effective mass, a short delay, and a soft surface. On a hard surface, a soft
# controller barely lowers this first peak, because it comes from the kinetic energy of the arm and not from the
# motors.
#
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Say every input of an estimate aloud: an interviewer can correct an input that you stated. The number
# may come first if the inputs follow at once.
#
# </div>
#
# ## 3 · Design: four systems
#
# "Design a system that empties bins of mixed parts." You have a whiteboard and 45 minutes. Don't draw in the first ten
# minutes: you don't know the requirements yet.
#
# | Minutes | What you do |
# |---:|---|
# | 5 | Ask. A **clarifying question** is one whose answer changes the design: how many picks per hour, what does a failed pick cost, do the parts change, who else is in the cell? |
# | 5 | Estimate. The cycle time, the accuracy at the fingertip, the gripping force, as in section 2. |
# | 20 | Draw boxes and arrows. On each arrow, write what flows, its rate if it is periodic, and the time that the box before the arrow takes. |
# | 10 | Explain in detail the one box that decides about success, and say when you would choose something else. |
# | 5 | Say how you would find out that the design is wrong: what you measure, and which number stops the release. |
#
# Many interviewers grade with a **rubric**, a list of the points that a good answer covers. On this page, each point
# gets one of four grades: missing; mentioned; given with a number; or defended, which means that you also said what
# would change your mind. A **red flag** is a mistake so serious that you can fail because of it alone: for example, a
# design for a robot among people doesn't say which part of it keeps them safe. A **follow-up** is the question that the
# interviewer asks next, usually about your weakest point.
#
# A whiteboard for the first of the four designs could look like this after 30 minutes:

# %% tags=["hide-code"]
SVG(designs.svg(designs.read("pick_and_place")))

# %% [markdown]
# Work on one of the four designs, with clock and paper, before you open its answer.

# %%
Markdown(designs.read("pick_and_place").markdown(figure))

# %%
fleet = designs.read("fleet_simulation")
Markdown(fleet.markdown(figure))

# %%
Markdown(designs.read("dexterous_hand").markdown(figure))

# %%
Markdown(designs.read("among_people").markdown(figure))

# %% [markdown]
# A small program can grade a written answer by the rubric. It looks for key words, for a number with a unit close to
# them, and for a condition that would change the decision. It cannot judge whether a number is correct. Here it grades
# a first sentence about the second design, the fleet, and names a point that is missing:

# %% tags=["nbval-ignore-output"]
mine = "I would ask first which decision depends on the simulation: may a release go out?"
result = designs.levels(fleet, mine)
print(f"score: {designs.score(fleet, result):.0%} of the points")
print("mentioned:", *(name for name, grade in result.items() if grade != "missing"))
print(f'missing, for example: "{designs.weakest(fleet, result).asks}"')

# %% [markdown]
# ## 4 · Code: four coding questions, and how to remember
#
# Each of these four coding questions takes at most twenty minutes and has its usual mistake:
#
# * **Forward kinematics** of a three-link arm. Sum the angles, then the vectors along the links (section 1). The usual
#   mistake is to mix up the angle between a link and the ground with the angle between two links.
# * **RRT** (rapidly-exploring random tree), a planner that grows a tree of random samples. The usual mistake is to
#   check only the two ends of an edge for collisions, and not the segment between them.
# * **PID** (proportional, integral and derivative control) with a motor that reaches its limit. The usual mistake is to
#   let the integral grow while the motor is at its limit, so that the arm overshoots afterwards. Code that stops the
#   integral there while the error pushes further is one kind of anti-windup.
# * **Domain randomisation**, training on random variants of a model. The usual mistake is to change the mass of a body,
#   but not its inertia.
#
# Start one with, for example, `drills start rrt`. Section 9 has code and a list of tests for each.
#
# So that you still know the answers on the day of the interview, review them with flashcards. This panel shows the
# cards of chapter 12 that are due today:

# %% tags=["nbval-ignore-output"]
from drills.interview.panel import flashcards

flashcards(chapters=[12])

# %%
predict("when_again")

# %% [markdown]
# **Spaced repetition** shows a card again when the predicted probability that you still know it has fallen to a
# chosen value, here 90 %.
#
# <details><summary>More about the numbers in the first panel of this page</summary>
#
# The curve is the predicted probability. Schedulers call the number of days until it has fallen to 90 % the *stability*
# of a card. *Asked again after* is this number, rounded to whole days. The *difficulty* says how slowly the stability
# grows with each success. The four bars belong to four cards: the gate, forward kinematics (fk3), a planner (rrt) and a
# controller (pid).
#
# </details>
#
# The chart shows the gaps between reviews that the scheduler of this course computes. A card that was just reviewed for
# the first time, or just failed, comes back in ten minutes (`<1` below); the first panel of this page leaves this out.

# %% tags=["hide-code"]
from datetime import UTC, datetime, timedelta

import fsrs

scheduler = fsrs.Scheduler(enable_fuzzing=False)
GOOD, AGAIN = fsrs.Rating.Good, fsrs.Rating.Again
figure_, axis = plt.subplots(figsize=(6.5, 2.5), layout="constrained")
print("days until the next review, after review 1, 2, 3, ...")
for label, failed in {"good every time": None, "one failure": 3}.items():
    memory, now, days = fsrs.Card(card_id=1), datetime(2026, 1, 1, tzinfo=UTC), []
    for review in range(7):
        memory, _ = scheduler.review_card(memory, AGAIN if review == failed else GOOD, now)
        days.append((memory.due - now) / timedelta(days=1))
        now = memory.due
    axis.semilogy(range(1, 8), days, "o-", label=label)
    print(f"{label:<16}", "  ".join(f"{gap:.0f}" if gap >= 1 else "<1" for gap in days))
axis.set(xlabel="review", ylabel="days until the next review")
axis.legend(fontsize=8)
plt.show()

# %% [markdown]
# ## 5 · Debug: six programs that fail
#
# "Your simulation explodes. What do you do?" The tempting answer is a fix: a smaller time step. A better answer is an
# experiment. A **symptom** is what you observe. Several causes can produce the same symptom, and a fix that you try at
# random may hide the symptom without removing the cause.
#
# A **probe** is an experiment that you may run on the failing program. It returns a number, and it takes some of your
# time. It is worth this time only if its result differs between the causes that are still possible.

# %%
case = diagnose("explodes", seed=4)
case.show()

# %% [markdown]
# Eight causes are possible:
#
# 1. Each stop has two contact points by mistake, so it is twice as stiff as intended. With this stiffness and the
#    brake, the simulation is unstable at this time step.
# 2. The position is updated with the old speed. That is explicit Euler. It adds energy to a spring at every step, here
#    more than brake and friction remove.
# 3. The brake receives the speed late: by more than a quarter of a period, so that its force mostly points along the
#    motion instead of against it.
# 4. Friction and speed have opposite sign conventions, so friction drives the slide instead of slowing it.
# 5. The damping is entered twice. The brake uses the old speed, and such a brake becomes unstable if damping times step
#    exceeds about twice the mass.
# 6. Contacts are detected only every few steps. In between, a stop pushes with an old depth. So it pushes too late,
#    which adds energy.
# 7. The encoder of the drive counts the wrong way, so the drive pushes away from the middle.
# 8. The integral term of the drive is too strong for the damping, so the oscillation grows.
#
# Each case has eight possible causes; its fold *Possible causes and repairs* lists seven (here not number 8). If probes
# exclude all seven, answer `none_of_these`.

# %%
predict("first_probe")

# %% [markdown]
# Before you run anything, say what each cause predicts. A time ratio of one means that the change doesn't matter, and
# about three that the slide survives. Below one, the slide is lost sooner.
#
# * **Half the step.** This cures causes 1 and 5, where the step is too long. It nearly cures cause 6, because the time
#   between two detections is halved as well. Explicit Euler (2) adds half as much energy each second, so the slide
#   lasts about twice as long. The other causes stay as they are: the wrong signs (4 and 7), the integral (8), and the
#   delay of the brake (3), which is the same time as before.
# * **No brake.** This cures causes 3 and 5, because they are faults of the brake. It also cures cause 1: this brake
#   uses the old speed and so lowers the largest stable step. Without it, the doubled stiffness is stable. The other
#   causes stay, and most of them act faster when nothing brakes the slide.
#
# To check such predictions, we built simulations with a known cause. The table lists the range of their results. The
# last row has the results of the simulation that fails. A range is bold if it contains this result:

# %% tags=["hide-code"]
PROBES = {
    "halve_step": "Half the step: time ratio",
    "brake_off": "No brake: time ratio",
    "log_brake": "Delay of the brake [steps]",
}
measured = {probe: case.probe(probe).figure for probe in PROBES}
rows = [f"| Cause | {' | '.join(PROBES.values())} |", "|---" + "|---:" * len(PROBES) + "|"]
for number, cause in enumerate(scenario("explodes").causes, 1):
    cells = []
    for probe, value in measured.items():
        low, high = expected("explodes", probe, cause.name)
        bold = "**" if low <= value <= high else ""
        cells.append(f"{bold}{max(low, 0.0):.2g} to {high:.2g}{bold}")
    rows.append(f"| {number} `{cause.name}` | {' | '.join(cells)} |")
rows.append(f"| Measured | {' | '.join(f'{value:.3g}' for value in measured.values())} |")
Markdown("\n".join(rows))

# %% [markdown]
# Half the step leaves four causes. Of these four, only the late brake also has a bold range under *No brake*. The last
# column confirms this cause independently: the brake acts many steps after the speed was measured. So the fix is to
# remove the delay.
#
# At small steps, an error of the time integration shrinks with the step. The effect of a force that has the wrong sign,
# or that is late by a fixed time, does not.

# %%
show("growing_energy")

# %% [markdown]
# The next five cases are yours. Each shows its symptom, its program and its probes with their prices in minutes.
# <span class="kernel-only">Call `diagnose` with another seed to get another cause.</span>
# <span class="kernel-only">Run a probe with `case.probe("name")`; end with `case.conclude("cause", "repair")`.</span>
# <span class="kernel-only">The verdict names the excluded causes, the effect of a common fix and the answer.</span>

# %%
diagnose("policy", seed=1).show()

# %%
diagnose("touch", seed=1).show()

# %%
diagnose("gap", seed=1).show()

# %%
diagnose("late", seed=1).show()

# %%
diagnose("sure", seed=1).show()

# %% [markdown]
# Which probes are worth their time? Eight causes make 28 pairs. A probe tells two causes apart if the ranges of its
# results for them (as in the table above) don't overlap. The chart shows the share of pairs that each probe tells
# apart, and its price in minutes. It counts all causes as equally likely.
#
# A first probe should have a long bar and a low price. But two probes with long bars may tell the same pairs apart. So
# choose the next probe from the last result: which one separates the causes that are left?

# %% tags=["hide-code"]
import textwrap
from itertools import combinations

from course.interview.scenarios import scenario_names, tells_apart


def shares_of_pairs(name):
    """Return the share of the pairs of causes that each probe of a scenario tells apart."""
    one = scenario(name)
    pairs = list(combinations([cause.name for cause in one.causes], 2))
    return {
        p.name: np.mean([tells_apart(name, p.name, *pair) for pair in pairs]) for p in one.probes
    }


names = list(scenario_names())
shares = dict(zip(names, from_record("interview.probes", shares_of_pairs, names), strict=True))
figure_, axes = plt.subplots(2, 3, figsize=(10, 7.4), layout="constrained", sharex=True)
for axis, name in zip(axes.flat, names, strict=True):
    one, parted = scenario(name), shares[name]
    order = sorted(parted, key=parted.get)
    axis.barh(range(len(order)), [parted[probe] for probe in order], color=BLUE)
    minutes = {p.name: p.minutes for p in one.probes}
    labels = [f"{probe}, {minutes[probe]:g} min" for probe in order]
    axis.set_yticks(range(len(order)), labels, fontsize=9)
    axis.set_title(textwrap.fill(f"{name}: {one.title}", 32), fontsize=10)
    axis.set(xlim=(0, 1))
figure_.supxlabel("share of the 28 pairs of causes that the probe tells apart", fontsize=10)
plt.show()

# %% [markdown]
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** Before you change anything, say what you expect to observe for each cause.
#
# </div>

# %%
more_claims("error_by_its_shape", "complete_planners")

# %% [markdown]
# ## 6 · Debug: a museum of public bugs
#
# How do you test code when nobody knows the correct output? You test a property that the output must have. An
# **invariant** is a property that every correct result has, whatever the code does inside. Two examples: the momentum
# of a body without forces stays the same, and the contact forces under a body at rest add up to its weight, if only the
# ground supports it.

# %%
predict("round_trip")

# %% [markdown]
# The museum has bugs, and one surprising default, from public open-source code. Each is documented in a public thread.
# The course has a minimal version of each, next to a correct version. Two examples:
#
# **A free fall with a top speed (number 4 below).** This one is the surprising default: PyBullet damps the motion of a
# body that you load, unless you set its damping to zero. With the default, a body that falls from rest never gets
# faster than about 15 m/s. The invariant: without air, after a start from rest, the speed is the gravitational
# acceleration times the time:

# %% tags=["hide-code"]
seconds = np.linspace(0.0, 5.0, 21)
figure_, axis = plt.subplots(figsize=(6.5, 2.4), layout="constrained")
for slip, label, colour in ((False, "correct", BLUE), (True, "with the default damping", ORANGE)):
    speeds = [museum.fall(1.0, float(t), 1 / 240, slip) for t in seconds]
    axis.plot(seconds, speeds, color=colour, label=label)
axis.set(xlabel="time [s]", ylabel="speed [m/s]")
axis.legend(fontsize=8)
plt.show()

# %% [markdown]
# The obvious test drops a light and a heavy body and checks that they fall alike. They do, but both too slowly.
#
# **A rotation that mirrors (8).** A function returns a rotation matrix $R$, and the obvious test checks that $R^\top R$
# is the identity. A mirror passes as well. The determinant shows the difference: it is +1 for a rotation and -1 for a
# mirror:

# %%
from scipy.spatial.transform import Rotation

turn = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix()
mirror = turn @ np.diag([1, 1, -1])
for label, matrix in (("rotation", turn), ("mirror", mirror)):
    obvious = np.abs(matrix.T @ matrix - np.eye(3)).max()
    error = invariants.rotation_error(matrix)
    print(
        f"{label:<9} obvious test passes: {obvious < 1e-12}   with the determinant: {error < 1e-12}"
    )

# %% [markdown]
# Here are all entries. The columns *Right* and *Wrong* show by how much the correct and the faulty version violate the
# invariant: the largest violation in three random test cases. *Relative* means divided by the correct value. Row 3 has
# a ratio instead. Its cart-poles are integrated with first order, so with a quarter of the step, the error of the
# energy should fall to about a quarter. With wrong equations it stays nearly the same, and the ratio is about one:

# %% tags=["hide-code"]
LABELS = (
    "contact forces that are all reported as zero",
    "a robot model whose left and right feet differ",
    "a cart-pole with wrong equations of motion",
    "a free fall with a top speed",
    "a velocity that is read in one frame and written in another",
    "a quaternion rate in the wrong frame",
    "an acceleration of a point that lacks the part towards the axis of rotation",
    "a rotation that mirrors",
    "a planner that reports success away from the goal",
    "path costs in a tree that are not updated after a change",
    "ends of training episodes that are stored one step off",
    "an episode cut by a time limit that is treated as finished",
    "stored steps that lead from one episode into the next",
    "network layers whose output is never used",
)
PROPERTIES = (
    "at rest on the ground, the contact forces add up to the weight (relative)",
    "a symmetric robot: from the mirrored state, the mirrored input causes the mirrored motion "
    "(m/s, after 0.01 s)",
    "the error of the energy shrinks with the step (ratio)",
    "speed = gravitational acceleration × time (relative, after 1 to 19 s)",
    "writing back what was read changes nothing (rad/s, for a rate of 2 rad/s)",
    "without torque, the angular momentum of a body is constant in the world's frame (relative)",
    "in the world's frame, the acceleration is the time derivative of the velocity (relative)",
    "$R^\\top R$ is the identity, the determinant is +1 (difference, no unit)",
    "a path that counts as solved ends at the goal (distance, in a square of side 1)",
    "the cost of a node is the length of its path from the root (in a square of side 1)",
    "an episode has the same advantages alone and in a buffer with others (for rewards of typical size 1)",
    "a reward of 1 in each step, for ever, is worth 1 / (1 - discount) (relative)",
    "a stored step goes forward in time, and none is missing (number of wrong steps)",
    "each layer that should learn has a gradient (number of layers without one)",
)
rows = ["| | Bug | Public thread | Invariant | Right | Wrong |", "|---:|---|---|---|---:|---:|"]
for place, one in enumerate(museum.EXHIBITS, 1):
    label, rule = LABELS[place - 1], PROPERTIES[place - 1]
    right, wrong = (max(one.evidence(slip, seed) for seed in range(3)) for slip in (False, True))
    rows.append(
        f"| {place} | {label} | {one.threads[0]} ({one.years[0]}) | `{one.invariant}`: {rule} "
        f"| {right:{'.2g' if '(ratio)' in rule else '.1g'}} | {wrong:.1g} |"
    )
Markdown("\n".join(rows))

# %% [markdown]
# Each invariant is a function of `course.interview.invariants`, so you can use it in your own unit tests. Too small a
# tolerance causes a **false alarm**: the check rejects a correct implementation. Too large a tolerance misses the bug.
# Here, choose a tolerance between the columns *Right* and *Wrong*, far from both. At work you only have *Right*:
# stay well above it, and below the smallest error that would matter.
#
# <details><summary>Four invariants of the module that the table doesn't use</summary>
#
# `norm_error`: unit vectors, such as quaternions, have the length 1. `inertia_error`: an inertia tensor is symmetric,
# and no principal moment exceeds the sum of the other two. `shift_error`: far from fixed objects, a motion that begins
# elsewhere is the same motion, moved. `saturation_error`: what a controller commands after its actuator was at a limit
# does not depend on how long it was there, once its filters have settled; with windup it does.
#
# </details>
#
# ## 7 · Frontier: classical or learned, and what to read
#
# "Would you learn this or write it by hand?" is a question that may end any interview.

# %%
predict("learned_or_not")

# %% [markdown]
# Say under which conditions the learned method wins. Our example is the pose of a known part in a simulated camera
# image. ICP (iterative closest point) moves a model of the part until it fits the camera's points. It finds the right
# pose only if the first guess of the rotation, the *start*, is good enough. Either a network guesses one start, and ICP
# runs once. Or ICP runs from several fixed starts, one after another, and the best fit counts.
#
# The left panel shows how often the final pose is right (within 2 mm and 2 degrees), and the median processor time for
# everything, ICP included. The labels 1, 4 and 8 are numbers of fixed starts. "Axis" starts along the longest direction
# of the points. Orange squares are for almost four times the camera noise:
#
# ![Share of right poses and time per picture: network start, several fixed starts](../docs/charts/learned_start.png)
#
# With the normal noise, the network and four fixed starts were both right in all of a hundred images (Wilson's interval
# begins at 96 %). With more noise, both were less often right, again about equally often. The network only saved time,
# because ICP ran once instead of four times. The four starts need no training. They could also run on four cores, or
# stop at the first pose that passes a check; we did not measure that. So take the network only if this time matters.
#
# The right panel asks how you notice that a pose from the network is wrong. Its horizontal axis is the angle between
# the estimated rotation and the true one. Its vertical axis is the *see-through share*: the share of the estimated
# part's pixels at which the camera sees something farther away. A part that is really there would hide what is behind
# it, so we reject a pose above the dotted line.
#
# The green points belong to a mirror image of the part. No pose of the model fits it, so all these poses are wrong, and
# only their height in the plot matters. The network gives no warning (we did not try ICP's residual as one), but the
# see-through check rejects most of them. It rejects no orange point, although about a fifth of these poses are wrong
# (left panel): their errors are too small for the check. In most of them the rotation is right and the position wrong,
# which this panel doesn't show.
#
# The next lines are what you may say about our measurements, each with its limit:

# %% tags=["hide-code"]
SAY = """
* **Perception.** "On a hundred simulated images of a known part, with normal camera noise, a network's guess and
  one run of ICP were right in {chart.learned_start/0/noise x 1/y/4:.0%} (Wilson's interval begins at
  {estimate.start_low:.0%}). So were four fixed starts. The median processor time was
  {chart.learned_start/0/noise x 1/x/4:.1f} ms with the network and {chart.learned_start/0/noise x 1/x/1:.1f} ms
  with all four starts, one after another." Name the machine, too: it is printed below the picture. Limit: for a part
  that is not the model, both return a wrong pose. Of the network's poses for the mirrored part, the see-through check
  rejected REJECTED.
* **Planning.** "In two hundred new worlds like those of the training (a square with three walls, each with one slit),
  RRT-Connect needed {learned_sampler_speeds_up.learned:.0f} collision checks in the median with samples from a network,
  and {learned_sampler_speeds_up.uniform:.0f} with uniform samples. Without learning, samples along a grid search of the
  network's input image need {learned_sampler_speeds_up.search:.0f}. A check is one state or one whole edge. The 95 %
  intervals of the first two medians are {chart.learned_planners/1/learned/x@high=0.5:.0f} to
  {chart.learned_planners/1/learned/x@low=0.5:.0f} and {chart.learned_planners/1/uniform/x@high=0.5:.0f} to
  {chart.learned_planners/1/uniform/x@low=0.5:.0f}." Limit: with the walls turned by ninety degrees, the network needed
  more checks than uniform samples. It also needs an image of the world; without a camera, filling this image takes
  {learned_sampler_speeds_up.picture:.0f} checks. The network's computing time is not counted.
* **Control.** "On a simulated two-link arm, the model of the controller lacked the payload and more than half
  of the friction. With soft gains, computed torque with this model had a largest angle error of
  {chart.tracking_laws/1/computed torque/y/-1:.2g} rad. With the same gains and a learned correction it had
  {chart.learned_beside_adaptive/0/learned, trained/y/-1:.1g} rad, after
  {chart.learned_beside_adaptive/0/learned, trained/x/-1:.0f} s of data (median of seven runs)." Limit: on a motion 1.6
  times as large as the trained one, the error with this correction was
  {chart.learned_beside_adaptive/0/learned, a larger/y/-1:.1g} rad. And an adaptive law, which corrects
  the model while the arm moves and has higher gains, had {chart.tracking_laws/1/adaptive law/y/-1:.1g} rad without
  training. PD with gravity compensation by the same wrong model had {chart.equal_stiffness/1/PD + gravity/y/1:.2g} rad
  with a stiffness (torque per radian) as low as that of the soft gains, and
  {chart.tracking_laws/1/PD + gravity/y/-1:.2g} rad with seven times this stiffness at the elbow.
* **Model of an arm.** "A learned model (linear, fifty features) predicted new motions of a simulated arm, up to 0.6 s
  ahead, with an error of {chart.learned_model/0/learned/y/-1:.0f} mrad (root mean square), after
  {chart.learned_model/0/learned/x/-1:.0f} s of data. Equations with fitted parameters reached
  {chart.learned_model/0/our arm/y/-1:.0f} mrad after {chart.learned_model/0/our arm/x/-1:.0f} s." Limit: this
  arm is simulated with equations of the same form. A real arm never obeys them exactly, so there the result
  can differ.
"""
full = tables.classical_or_learned().markdown()
through = np.array(stored("learned_start")[1]["mirrored part"].y)
say = filled(SAY.replace("REJECTED", f"{np.mean(through > 0.1):.0%} of {len(through)}"), figure)
Markdown(
    f"{say}\n\n<details><summary>The full table of five components</summary>\n\n"
    f"{full}\n\n</details>"
)

# %% [markdown]
# A learned component can win on data like those of its training, and it may fail elsewhere. So check what it returns,
# and compare it with a classical method whose parameters were fitted to measured data.
#
# What to read:

# %%
tables.reading()

# %% [markdown]
# Topics that this course does not teach:

# %%
tables.not_taught()

# %% [markdown]
# ## 8 · Exercises
#
# `check` tests your function on new random cases and, where it can, explains the mistake. Each function below runs, but
# contains one or more common mistakes. `truncated_advantages` belongs to reinforcement learning (chapter 9). There, the
# *advantage* of an action says how much better it was than expected, and a *critic* is a network that predicts the
# discounted sum of future rewards from a state.

# %%
card("tip_resolution")


# %%
def tip_resolution(counts, ratio, reach):
    """Return how far the tip moves for one encoder count of each joint, and of all together."""
    # As if the encoder sat on the joint.
    each = 1e3 * 2.0 * np.pi * np.asarray(reach) / np.asarray(counts)
    return each, float(each.max())


check(tip_resolution)

# %%
card("catch_the_slip")


# %%
def catch_the_slip(turns, rates, moments, step):
    """Return what is wrong with each of several implementations of a free body."""
    # Columns of length 1, at the first sample.
    lengths = np.linalg.norm(turns[:, 0], axis=1)
    return np.any(np.abs(lengths - 1.0) > 1e-3, axis=1).astype(int)


check(catch_the_slip)

# %%
card("success_interval")


# %%
def success_interval(solved, tried, confidence, share, half):
    """Return Wilson's intervals of success rates, and the trials that make one narrow enough."""
    # The usual interval.
    p = np.asarray(solved) / np.asarray(tried)
    width = 1.96 * np.sqrt(p * (1.0 - p) / np.asarray(tried))
    return p - width, p + width, int(1.96**2 * share * (1.0 - share) / half**2)


check(success_interval)

# %%
card("stopping_distance")


# %%
def stopping_distance(speeds, reaction, braking, slope, person, unsure, sight):
    """Return what a mobile robot needs to stop before a person who walks on towards it."""
    # The brake alone, before somebody who stands.
    distance = np.asarray(speeds) ** 2 / (2.0 * braking)
    return distance, distance + unsure, np.sqrt(2.0 * braking * sight)


check(stopping_distance)

# %%
card("latency_budget")


# %%
def latency_budget(edges, runs, periods, sensor, actuator, allowed):
    """Return the worst latency of a graph of stages, and how much longer each of them may take."""
    # What all stages take on average; what is left is shared.
    cost = np.mean(runs, axis=1)
    total = float(np.sum(cost))
    return total, np.full(len(cost), (allowed - total) / len(cost))


check(latency_budget)

# %%
card("truncated_advantages")


# %%
def truncated_advantages(reward, value, starts, ended, final, last, gamma, lam):
    """Return generalised advantages of a buffer of episodes, some cut off by a time limit."""
    # As if the buffer were one episode, one step ahead.
    target = np.asarray(reward, dtype=float) + gamma * np.append(value[1:], last)
    return target - value, target


check(truncated_advantages)

# %%
card("silent_gate")


# %%
def silent_gate(seeds, outcomes, old_seeds, old_outcomes, gate):
    """Return what a nightly run says of a new version, beside the night before."""

    def results(names, values):
        table = {}
        for name, value in zip(names, values, strict=True):
            if value >= 0:
                table[int(name)] = bool(value)
        return table

    new, old = results(seeds, outcomes), results(old_seeds, old_outcomes)
    n, square = len(new), 1.959963984540054**2
    p = sum(new.values()) / n
    width = np.sqrt(square * (p * (1.0 - p) / n + square / (4.0 * n**2)))
    low = (p + square / (2.0 * n) - width) / (1.0 + square / n)
    both = list(zip(new.values(), old.values(), strict=False))
    tally = np.array([both.count((True, False)), both.count((False, True))])
    return low, tally, int(low >= gate)


check(silent_gate)

# %% [markdown]
# ## 9 · Interview
#
# The questions have three levels: *Screen* for a first interview, *Senior* for an experienced engineer, and *Staff*
# for a leading engineer. Answer aloud, then open the answer. The minutes include the follow-up questions. Two terms
# occur in the questions. In **hardware in the loop**, the real controller drives a simulated robot. **Continuous
# integration** (CI) runs the tests after each change of the code.

# %%
interview("interview")

# %% [markdown]
# ### Checkpoint
#
# *In your own words: which number in this course surprised you, and what had you expected?* Write it down.

# %%
mine = ""
print("written" if len(mine.split()) >= 30 else "open: thirty words or more")

# %% [markdown]
# Five questions, drawn at random by a seed:
#
# <details><summary>Ideas for three of the formulas that can be drawn</summary>
#
# - The peak force of a contact: all kinetic energy is in the spring (section 2).
# - The derivative of a mean reward (chapter 9): start with the mean reward as a function of the probability $p$, which
#   is the logistic function of the score, $p = 1/(1 + e^{-\theta})$, then use the chain rule.
# - The noise of a derivative that is computed from two noisy samples (chapter 6): variances of independent errors add
#   up.
#
# </details>

# %%
checkpoint("interview", ["", "", "", "", ""], seed=1)
