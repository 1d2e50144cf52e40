# %% [markdown]
# # 12 · The interview
#
# *Everything that the eleven chapters before measured, asked back. Answer aloud, then turn the card.* About
# {open minutes} minutes of reading, cards and charts. The folded parts add {folded minutes} minutes, the exercises
# {exercise minutes} minutes. Add as many evenings of cards as you have.

# %%
from course.cards import predict
from course.simulations import simulation

predict("hundred_runs")

# %%
simulation("interview")

# %% [markdown]
# **You will be able to** answer with a figure that you can defend, in half a minute and in five; design a system on a
# whiteboard with rates and latencies on its arrows; find the cause of a failure in counted experiments; and rehearse
# all of it, timed and graded, in a terminal. **Know first:** as many of the chapters as you have time for. A card of a
# chapter that you have not read tells you what to read.
#
# ## How this chapter works
#
# Each number in an answer is computed by a claim, a chart or a function of this course;
# `python -m course.derivations 12` runs the claims of this page again. Three commands do the same in a terminal:
#
# | | |
# |---|---|
# | `drills review` | the cards that are due, each with its own next date |
# | `drills interview --minutes 45` | a question, a scenario, a drill that is graded, a design; a report at the end |
# | `drills debug explodes` | one of four programs that fail, to be questioned |
#
# Section 8 has these exercises:

# %% tags=["nbval-ignore-output"]
from drills.notebook import badges, card, check, checkpoint

badges(12)

# %%
import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown
from scipy.stats import binom

from course.cards import interview
from course.derivations import show
from course.derivations.records import figure
from course.interview import designs, invariants, museum, tables
from course.interview.estimates import ESTIMATES
from course.interview.scenarios import diagnose, model_path, scenario

# %% [markdown]
# ## 1 · Concept: the whole course in thirty seconds each
#
# Eight subjects; each ends with what was measured here: the pick, its price beside the real library, and its limit.

# %%
tables.cheat_sheet()

# %% [markdown]
# ### What is said often, and is not so
#
# Each of these has been heard in an interview. Is it true, false, or true under a condition? Decide before you turn the
# card. (A **gate** is a threshold that a policy has to pass before it goes on.)

# %%
show("hundred_trials")

# %% [markdown]
# How likely a policy passes, against how good it is:

# %%
rate = np.linspace(0.4, 1.0, 121)
figure_, axis = plt.subplots(figsize=(6.5, 2.6), layout="constrained")
for n in (20, 100, 500):
    passes = binom.sf(np.ceil(0.7 * n) - 1, n, rate)
    axis.plot(rate, passes, label=f"{n} trials")
axis.axvline(0.7, color="0.6", lw=1, ls="--")
axis.set(xlabel="true success rate", ylabel="probability to pass 70 %")
axis.legend(fontsize=8)
plt.show()

# %% [markdown]
# A **confidence interval** is the range of rates that the count does not speak against; the **power** of a test is the
# probability that it sees a difference that is there. No number of trials makes the curve a step; some make it steep
# where it matters.

# %% [markdown]
# <div class="alert alert-block alert-success">
#
# **Interview tip.** First the answer, then its figure, then its limit; then stop. "Semi-implicit Euler; at the step of
# this scene it errs by so much, and above twice the inverse frequency, or less with damping, it explodes" takes ten
# seconds, and the next question is one that you chose.
#
# </div>

# %%
show("imu_reads_acceleration")

# %% [markdown]
# (**Specific force** is that: force on the body, gravity left out, per mass.)

# %%
show("stiff_is_position")

# %%
show("joints_by_sums")

# %%
show("hold_is_half_a_sample")

# %% [markdown]
# ## 2 · Concept: the back of the envelope
#
# An estimate is a sum whose inputs you can say aloud. Which of them decides?

# %%
predict("twice_the_planner")

# %%
for name in (
    "cycle",
    "computing_share",
    "finger_error",
    "grip_force",
    "stopping",
    "contact_clamped",
):
    one = ESTIMATES[name]
    print(f"{one.statement:<36}{one.value():9.3g} {one.unit}")

# %% [markdown]
# The **cycle time** is from one part to the next; the **stopping distance** is what is travelled from the decision to
# rest, reaction included; the **effective mass** is what the contact feels of an arm, less than its weight on a scale.
# Change an input, and see which one the answer hangs on. Here each is doubled once:

# %%
one = ESTIMATES["contact_clamped"]
base = one.value()
for name, given in one.given().items():
    if isinstance(given, float) and given:
        print(
            f"{name:<24} {given:9.3g} -> {2 * given:9.3g}: {one.value(**{name: 2 * given}) / base:5.2f} times"
        )

# %%
show("computing_and_cycle")

# %%
predict("ten_newtons")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Say the formula, then the two inputs that matter, then the number. An interviewer corrects an input;
# nobody can correct a number that came alone.
#
# </div>
#
# ## 3 · Design: four systems
#
# Forty-five minutes each. First **clarifying questions**, those whose answers change the design; then boxes, with a
# rate and a latency on every arrow; then what you would measure to find out that you are wrong. A **rubric** is the
# list of what is listened for. Each of its items is missing, named, quantified, or defended with what would change
# your mind. A **red flag** is an answer that ends the matter, and a **follow-up** is what the weakest item earns you.

# %%
fleet = designs.read("fleet_simulation")
Markdown(fleet.markdown(figure))

# %%
Markdown(designs.read("pick_and_place").markdown(figure))

# %%
Markdown(designs.read("dexterous_hand").markdown(figure))

# %%
Markdown(designs.read("among_people").markdown(figure))

# %% [markdown]
# Write an answer and let it be read. The reader looks for words, for a number with a unit near them, and for what would
# change your mind; it does not know whether the number is right. That is for you and the passage that it points at.

# %% tags=["nbval-ignore-output"]
mine = "I would ask first which failures the nights have to find."
result = designs.levels(fleet, mine)
print(
    f"score {designs.score(fleet, result):.2f}; the weakest item: {designs.weakest(fleet, result).asks}"
)

# %% [markdown]
# ## 4 · Code: four drills, and cards
#
# Forward kinematics of three links, an RRT with checked edges, a PID that does not wind up, domain randomisation that
# changes all that belongs together. Each is graded in a second or two, in the terminal (`drills start rrt`) or here;
# the four cards at the top hold the key insight of each. To rate your own cards here instead of in the terminal, call
# `flashcards` from `drills.interview.panel` in a cell: it shows what is due and stores your ratings.

# %%
predict("when_again")

# %% [markdown]
# **Spaced repetition** shows a card when you are about to forget it. `drills review` asks what is due of all chapters:
# claims, formulas to type, questions, drills and the exhibits of section 6. How the gaps grow, if every answer is
# *good*, and what one failure does:

# %%
from datetime import UTC, datetime, timedelta

import fsrs

scheduler = fsrs.Scheduler(enable_fuzzing=False)
for report, ratings in {"good, every time": "33333333", "one failure": "33313333"}.items():
    memory, now, days = fsrs.Card(card_id=1), datetime(2026, 1, 1, tzinfo=UTC), []
    for rating in ratings:
        memory, _ = scheduler.review_card(memory, fsrs.Rating(int(rating)), now)
        days.append((memory.due - now) / timedelta(days=1))
        now = memory.due
    print(f"{report:<18}", "  ".join(f"{gap:.1f}" if gap >= 1 else "<1" for gap in days), "days")

# %% [markdown]
# ## 5 · Debug: four programs that fail
#
# Each has one **symptom**, what is seen, and four causes or more; which one it is, is drawn by the seed. A **probe** is
# something to try that returns a figure and costs minutes. Ask for the figures that part the causes; then name the
# cause, and the repair.

# %%
predict("first_probe")

# %%
case = diagnose("explodes", seed=3)
case.show()

# %% [markdown]
# Add probes of your own here, then uncomment the last line. The verdict shows what your figures ruled out, what the
# popular repair would have done, and the model answer.

# %%
for name in ("halve_step", "log_energy"):
    print(case.probe(name))
# case.conclude("the cause that you name", "the repair")

# %%
diagnose("policy", seed=1).show()

# %%
diagnose("touch", seed=1).show()

# %%
diagnose("gap", seed=1).show()

# %% [markdown]
# How much one probe tells: the pairs of causes that it parts beyond its own noise, for the minutes that it costs. The
# model answer takes the best first.

# %%
from itertools import combinations

from course.interview.scenarios import scenario_names, tells_apart

figure_, axes = plt.subplots(
    1, len(scenario_names()), figsize=(10, 3.2), layout="constrained", sharex=True
)
for axis, name in zip(axes, scenario_names(), strict=True):
    one = scenario(name)
    pairs = list(combinations([cause.name for cause in one.causes], 2))
    parted = {
        p.name: np.mean([tells_apart(name, p.name, *pair) for pair in pairs]) for p in one.probes
    }
    order = sorted(parted, key=parted.get)
    inside = model_path(name)
    colours = ["C0" if probe in inside else "0.75" for probe in order]
    axis.barh(range(len(order)), [parted[probe] for probe in order], color=colours)
    axis.set_yticks(range(len(order)), order, fontsize=7)
    axis.set(title=name, xlabel="pairs told apart", xlim=(0, 1))
plt.show()

# %% [markdown]
# (Blue: on the model answer's path.)
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** Before you change anything, ask what you expect to see under each cause. A probe for which the
# answers are the same is not worth its minutes, however quick it is.
#
# </div>

# %%
show("growing_energy")

# %%
show("error_by_its_shape")

# %%
show("complete_planners")

# %% [markdown]
# ## 6 · Debug: a museum of public slips
#
# Well-kept projects have shipped these, and said so in public. Each is small again here beside its right twin, with an
# **invariant**: a quantity that has to stay, whatever the code does inside.

# %%
predict("round_trip")

# %%
rows = ["| | slip | thread | invariant | right | wrong |", "|---:|---|---|---|---:|---:|"]
for place, one in enumerate(museum.EXHIBITS, 1):
    right, wrong = (max(one.evidence(slip, seed) for seed in range(3)) for slip in (False, True))
    years = "-".join(str(year) for year in sorted({min(one.years), max(one.years)}))
    rows.append(
        f"| {place} | {one.name} | {one.threads[0]} ({years}) | `{one.invariant}` "
        f"| {right:.0e} | {wrong:.1g} |"
    )
Markdown("\n".join(rows))

# %% [markdown]
# (Largest of three worlds each; an invariant's unit is told in its docstring.) What the check that one would write
# first sees of a slip, where one is known that passes it:

# %%
for one in museum.EXHIBITS:
    if one.naive:
        observed = [max(one.naive(slip, seed) for seed in range(3)) for slip in (False, True)]
        print(f"{one.name:<42} right {observed[0]:.0e}, wrong {observed[1]:.0e}")

# %% [markdown]
# The invariants are functions that take your code: two lines, in front of a whiteboard or in a test. A **false alarm**
# is an invariant that stops right code; tolerance and step are chosen so that it does not.

# %%
from scipy.spatial.transform import Rotation

turn = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix()
print(
    f"a rotation: {invariants.rotation_error(turn):.0e}, its mirror: "
    f"{invariants.rotation_error(turn @ np.diag([1, 1, -1])):.1f}"
)

# %% [markdown]
# ## 7 · Frontier: classical or learned, and what to read

# %%
predict("learned_or_not")

# %% [markdown]
# A *crossing* is the model error, the time or the number of samples from which on one of the two wins. Where this
# course measured one, the table has it.

# %%
tables.classical_or_learned()

# %% [markdown]
# One book, five papers, five repositories, with what each really says:

# %%
tables.reading()

# %% [markdown]
# What lies beside this course:

# %%
tables.lessons()

# %% [markdown]
# ## 8 · Exercises
#
# Graded exercises. `check` asks your cell on cases drawn afresh, and says what is wrong and, if it can, why.

# %% [markdown]
# ### Catch slips that you have not seen

# %%
card("catch_the_slip")


# %%
def catch_the_slip(turns, rates, moments, step):
    """Return what is wrong with each of several implementations of a free body."""
    # Columns of length 1, at the first sample.
    lengths = np.linalg.norm(turns[:, 0], axis=1)
    return np.any(np.abs(lengths - 1.0) > 1e-3, axis=1).astype(int)


check(catch_the_slip)

# %% [markdown]
# ### How sure is nine out of ten?

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

# %% [markdown]
# ### When does it have to begin to stop?

# %%
card("stopping_distance")


# %%
def stopping_distance(speeds, reaction, braking, slope, person, unsure, sight):
    """Return what a mobile robot needs to stop before a person who walks on towards it."""
    # The brake alone, before somebody who stands.
    distance = np.asarray(speeds) ** 2 / (2.0 * braking)
    return distance, distance + unsure, np.sqrt(2.0 * braking * sight)


check(stopping_distance)

# %% [markdown]
# ### A latency budget over a graph

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

# %% [markdown]
# ### Advantages in a buffer that cuts

# %%
card("truncated_advantages")


# %%
def truncated_advantages(reward, value, starts, ended, final, last, gamma, lam):
    """Return generalised advantages of a buffer of episodes, some cut off by a time limit."""
    # As if the buffer were one episode, one step ahead.
    target = np.asarray(reward, dtype=float) + gamma * np.append(value[1:], last)
    return target - value, target


check(truncated_advantages)

# %% [markdown]
# ### Silent bugs: the gate that always opens

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
# Answer aloud, then open: first what one says in a minute, then the whole of it, then what comes next. The last one
# takes three quarters of an hour.

# %%
interview("interview")

# %% [markdown]
# ### Checkpoint
#
# *In your own words: which figure of this course surprised you, and what did you believe before?* Write it down; it is
# the best answer that you have to "tell me something you learned".

# %%
mine = ""
print("written" if len(mine.split()) > 30 else "open: thirty words or more")

# %% [markdown]
# Three formulas that are not on this page; you can derive them from what is. The gate opens when all are right.

# %%
checkpoint("interview", stop_at_ten_newtons="", loss_of_a_policy="", derivative_is_filtered="")
