# %% [markdown]
# # 6 · Control
#
# *A joint has to follow its target, the dashed line. Answer first<span class="kernel-only">, run the cells</span>,
# then press* Play *and drag the target.* About {open minutes} minutes of reading, cards and charts. The folded parts
# add {folded minutes} minutes, the exercises {exercise minutes} minutes.

# %%
from course.cards import predict
from course.simulations import simulation

predict("far_from_limits")

# %% [markdown]
# ![A joint that tracks a step](attachment:control.joint.png)

# %%
simulation("joint")

# %% [markdown]
# **You will be able to** say how much gain a loop stands before you tune it; write a controller that survives limits,
# jams and encoders; choose a law that tracks, and say what is wrong when it does not; touch a wall with the right one
# of four controllers; and tell a limit of the robot from one of its simulator. **Know first:** chapter 4's equations of
# motion; differential equations, eigenvalues.
#
# ## How this chapter works
#
# Most scenes begin with a card: answer first; a click says whether you are right, and **Explanation** says why.
# Derivations are folded away. A number in the text comes from the cell above it, or from a check that `python -m
# course.derivations 6` runs again. The code is `course.control`. These exercises wait in section 8:

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint

badges(6)

# %%
import inspect
import math
import textwrap
from dataclasses import replace

import numpy as np
from IPython.display import Markdown

from course import control
from course.cards import figures, interview
from course.charts import read
from course.charts.control import limits, touch
from course.control import Actuator, Encoder, Gains, Joint, identify, run_joint, sampled
from course.derivations import more_claims, show
from course.kinematics import TwoLink
from course.oracles.mujoco import chain as mujoco


def source(*functions):
    """Show functions as they stand in the module."""
    text = "\n\n".join(inspect.getsource(f) for f in functions)
    return Markdown(f"```python\n{text}```")


def print_figures(chart, *rows):
    """Print the lines of a chart's key figures that begin so, no wider than a page."""
    for line in read(chart).splitlines():
        if line.lstrip().startswith(rows):
            words = " ".join(line.split())
            print(textwrap.fill(words, 96, subsequent_indent="    "))


# %% [markdown]
# ## 1 · Concept: one joint
#
# ### Three terms
#
# The **set-point** $q_d$ says where the joint should be, the error is $e = q_d - q$. **PID** turns it
# into a torque:
#
# $$\boxed{\;\tau = K_p\,e + K_i\int e\,dt + K_d\,\dot e\;}$$
#
# A spring to the target, a memory of what was missed, a damper. On an inertia $I$ with friction $b$ (some cards and
# charts write $J$ for $I$) the spring alone swings, once it is stiffer than $b^2 / (4 I)$. An integral with dry
# friction may wait, jump past the target, and wait again: **hunting**.

# %%
show("p_alone_overshoots")

# %%
show("integral_removes_the_error")

# %%
show("too_much_d")

# %% [markdown]
# Which $\dot e$? If the set-point jumps, so does the error, and its rate is a spike: the **derivative kick**. Choose
# that preset on the first screen.

# %%
show("error_derivative_kick")

# %% [markdown]
# The rate of the *measurement* has no such spike, and the loop around it is the same: compare the margins of the two.

# %%
more_claims("critical_settles_fastest", "one_gain_one_symptom")

# %% [markdown]
# ### What happens at the motor's limit

# %%
predict("jammed")

# %% [markdown]
# That is **windup**. Choose *A jam*, then switch on anti-windup. Two remedies are in use. **Conditional integration**
# takes a sample into the integral only if the command is free, or if the error leads back from the limit.
# **Back-calculation** pulls the integral by what the limit cut off. Below: a jam of 2 s, the set-point at 0.25 rad.

# %%
show("integral_clamp")

# %% [markdown]
# ![A jam of two seconds, with anti-windup and without](../docs/charts/pid_windup.png)

# %%
figures(
    read("pid_windup"), "conditional", "no anti-windup", summary="The scene, and what it leaves out"
)

# %% [markdown]
# <details><summary>The listing that everybody has seen</summary>
#
# A class with the error as its input, an integral clamped to a range of its own, the derivative of the error with a
# comment that this avoids the kick, and a loop of three seconds that subtracts half of the velocity "for friction".
#
# Whether such a block runs *as it was printed* can't be checked here: a page leaves out what its reader has to supply,
# such as the import of NumPy, and there is no one text of it to run. What it computes can be checked. The course ran
# its own writing of it: see `listing_friction`, `integral_clamp`, `error_derivative_kick` in
# `python -m course.derivations 6`, and the next card.
#
# </details>

# %%
show("listing_settles")

# %% [markdown]
# ### A sampled loop is a matrix

# %%
predict("more_p")

# %% [markdown]
# A computer measures every $dt$ (on cards: $h$), computes, and holds the torque until the next sample: a
# **zero-order hold**. Between samples the
# joint can be solved exactly, so one sample is a linear map of the state *and* of the commands that are still under
# way. That matrix decides everything. The largest modulus of its eigenvalues is the **growth** per sample: below 1 the
# loop comes to rest, above it doesn't.

# %%
show("hold_is_half_a_sample")

# %% [markdown]
# With a delay $D$ that gives the gain at which P alone swings for ever, the **ultimate gain**:
#
# $$\omega\tan\!\big(\omega\,(D + \tfrac12 dt)\big) = \frac{b}{I} .$$

# %%
show("p_at_any_gain")

# %% [markdown]
# <details><summary>Derive: the ultimate gain of a late loop</summary>
#
# At the limit the joint swings as $e^{i\omega t}$, and $I\ddot q + b\dot q = -K\,q(t - T)$ becomes
# $I\omega^2 - ib\omega = K e^{-i\omega T}$. The angle of the left side is $-\arctan(b/(I\omega))$, that of the right
# one $-\omega T$: so $\tan\omega T = b/(I\omega)$. Its size is $K$. A torque that is held for $dt$ is a staircase whose
# steps lag $dt/2$ behind on average, so $T = D + dt/2$; the chart says how good that is.
#
# </details>

# %%
inertia, damping, dt = 0.5, 0.5, 1e-3  # kg m^2, N m s/rad, s: the joint of the first screen
A, B = control.joint_system(inertia, damping)
for late in (0.0, 0.005, 0.02, 0.05):
    gain, period = control.ultimate_gain(A, B, dt, late)
    rule = sampled.delay_limit(inertia, damping, late + dt / 2)[0]
    print(
        f"{1e3 * late:3.0f} ms late: ultimate gain {gain:8.3f} N m/rad, period {period:.3f} s; "
        f"the rule is {abs(gain / rule - 1):.0e} off"
    )

# %% [markdown]
# ![Ultimate gain against delay, and against a simulator's steps](../docs/charts/delay_limit.png)

# %%
show("pade_is_enough")

# %% [markdown]
# How far is a loop from its limit? The **gain margin** is the factor that all gains stand, the **phase margin** the lag
# in the swing where the loop has the size one, and the **delay margin** the time that may still be lost. All three come
# out of the same matrix; change a slider on the first screen and watch them. For a robot the last is the one to say
# aloud: it is in milliseconds, like what your colleagues will take from you.
#
# ### How much damping, and what a late rate costs
#
# Take friction away. On a free inertia, with $K_p$ in units of $I/dt^2$ and $K_d$ of $I/dt$, the stable gains of PD
# form a triangle. Every way to be late makes the region smaller, and its edge a curve. You will derive three of its
# edges in section 8.
#
# ![Stable gains of PD, and MuJoCo's position servo](../docs/charts/pd_triangles.png)

# %%
print_figures("pd_triangles", "PD on an inertia")

# %% [markdown]
# ### What the encoder, friction and the motor do

# %%
predict("faster_loop")

# %% [markdown]
# An encoder has lines: **quantisation**. The rate is made of it, and every estimate of a rate trades noise for lag: the
# plain difference, a difference behind a low-pass, or a **tracking observer** that predicts place and rate and corrects
# both by what it missed.

# %%
show("filtered_rate_is_late")

# %% [markdown]
# ![Noise of a rate against its lag](../docs/charts/rate_estimates.png)

# %%
print_figures("rate_estimates", "difference", "filtered", "tracking")

# %% [markdown]
# Dry friction stops a joint short of its target, and an integral then pushes until it breaks loose. If static friction
# is above Coulomb's, it jumps past the target and waits on the other side. Choose *Hunting* and lower *Static / dry* to
# one.

# %%
show("friction_leaves_an_error")

# %% [markdown]
# ![Ripple of an encoder, and hunting](../docs/charts/ripple_and_hunting.png)

# %%
print_figures("ripple_and_hunting", "ripple", "hunting")

# %% [markdown]
# **Saturation** is the limit of the torque. It takes the loop away while it lasts, and on a plant that falls over by
# itself no gain brings it back. The map shows from where a pendulum with a weak motor is caught:
#
# ![Where a weak motor catches a pendulum](../docs/charts/saturation_region.png)

# %%
print_figures("saturation_region", "from rest")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Count what is late: half a sample for the hold, half for a difference, the filter, the wire. That
# sum, the inertia and the friction decide how much gain there is. Tuning only finds it again.
#
# </div>

# %%
more_claims("encoder_ripple", "listing_friction")

# %% [markdown]
# ### Tuning by rule
#
# **Ziegler-Nichols** (1942) is the procedure that everybody can recite: (1) set $K_i$ and $K_d$ to zero; (2) raise
# $K_p$ until the loop swings at a constant amplitude, at the ultimate gain $K_u$; (3) measure the period $T_u$; (4)
# take a row of the table.
#
# | controller | $K_p$ | $K_i$ | $K_d$ |
# |---|---|---|---|
# | P only | $0.5\,K_u$ | 0 | 0 |
# | PI | $0.45\,K_u$ | $0.54\,K_u/T_u$ | 0 |
# | PID | $0.6\,K_u$ | $1.2\,K_u/T_u$ | $0.075\,K_u T_u$ |

# %%
show("every_joint_has_ku")

# %% [markdown]
# So the delay has to be stated. With twenty milliseconds, every row judged by its matrix and a step:

# %%
late = 0.02
Ku, Tu = control.ultimate_gain(A, B, dt, late)
plant = control.held(A, B, dt, late)
print(f"Ku = {Ku:.2f} N m/rad, Tu = {Tu:.3f} s")
tried = {name: (p * Ku, i * Ku / Tu, d * Ku * Tu) for name, (p, i, d) in limits.ROWS.items()}
tried["often quoted"] = (27.0, 120.0, 1.5)
for name, (kp, ki, kd) in tried.items():
    growth = control.growth(control.loop_matrix(plant, control.pid_law(kp, ki, kd, dt=dt)))
    run = run_joint(
        Joint(inertia, damping), Actuator(delay=late), Encoder(), Gains(kp, ki, kd), 1.0, dt, 20.0
    )
    observed = control.step_metrics(run.times, run.q, 1.0)
    steps = (
        f"overshoot {observed.overshoot:4.0%}, settled after {observed.settling:5.2f} s"
        if growth < 1.0
        else f"unstable: it grows {growth ** (1.0 / dt):.2f} times a second"
    )
    print(f"{name:<12} kp {kp:5.1f}  ki {ki:5.1f}  kd {kd:4.2f}   {steps}")

# %%
show("quoted_gains_overshoot")

# %%
show("half_the_ultimate_gain")

# %% [markdown]
# The rows are for plants that lag by themselves. A joint integrates as well. What to do instead is no more work: put
# the poles where you want them, *with the stated delay* in the equation. Three equal ones are the curve at the bottom:
#
# ![The rows on a joint with its true delay](../docs/charts/ziegler_nichols_rows.png)

# %%
show("ziegler_nichols_is_safe")

# %%
more_claims("quoted_ku_tu", "safer_set")

# %% [markdown]
# ## 2 · Concept: many joints
#
# ### Which law tracks?
#
# Chapter 4 gave the arm's equation, $M(q)\ddot q + h(q,\dot q) = \tau$. What a law knows of it:
#
# | law | torque | knows |
# |---|---|---|
# | PD | $K_p e + K_d\dot e$ | nothing |
# | PD with **gravity compensation** | $K_p e + K_d\dot e + g(q)$ | what holds it up |
# | feedforward | $K_p e + K_d\dot e + M(q_d)\ddot q_d + h(q_d,\dot q_d)$ | the planned motion |
# | **computed torque** | see below | the arm as it moves |
#
# $$\boxed{\;\tau = M(q)\,\big(\ddot q_d + K_d(\dot q_d - \dot q) + K_p(q_d - q)\big) + C(q,\dot q)\,\dot q + g(q)\;}$$
#
# The gains stand *inside* the mass matrix.

# %%
show("computed_torque_law")

# %%
show("perfect_model_perfect_tracking")

# %% [markdown]
# And with the wrong model, such as a payload that nobody told it of? **Adaptive control** (Slotine and Li 1987)
# learns the numbers of the model while it moves. The torques are linear in them, chapter 4's regressor $Y$; the
# estimate moves along $Y^\mathsf{T}s$, with $s$ a mixture of both errors. In continuous time a sum of squares can
# then only fall.

# %%
show("adaptive_finds_parameters")

# %%
show("adaptive_sum_can_only_fall")

# %% [markdown]
# ### What a wrong inertia does

# %%
predict("wrong_inertia")

# %% [markdown]
# With $\hat I$ in the model for the true $I$ the error obeys
#
# $$\ddot e + K_d\,\dot e + K_p\,e = \Big(\frac{I}{\hat I} - 1\Big)\,\ddot q .$$
#
# <details><summary>Derive: who drives the error</summary>
#
# The law asks for $\tau = \hat I(\ddot q_d + K_d\dot e + K_p e)$, the joint answers $I\ddot q = \tau$. Subtract
# $\hat I\ddot q$ from both sides: $(I - \hat I)\ddot q = \hat I(\ddot q_d - \ddot q + K_d\dot e + K_p e)$, and
# $\ddot q_d - \ddot q = \ddot e$. Divide by $\hat I$.
#
# For slow motion only $K_p e$ counts on the left, and the slope of $e$ over $\ddot q$ is $(I/\hat I - 1)/K_p$. At a
# frequency $\omega$ the error is $1/(K_p - \omega^2 + i\omega K_d)$ times the right side: late, and smaller. A plot of
# one over the other then shows the real part of that.
#
# </details>

# %%
show("error_follows_acceleration")

# %% [markdown]
# So don't read the inertia from a slope, and don't differentiate a log twice: noise grows with $1/dt^2$. Multiply the
# equation of motion by smooth bumps and integrate by parts; then the angle stands in it as it was measured.

# %%
t = 2e-3 * np.arange(4000)
wave = 0.9 * np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t + 1.0) + 0.25 * np.sin(5.7 * t + 2.0)
truth = Joint(0.12, 0.15, 0.0, 0.10)


def logged(joint, actuator):
    """Return a log of a joint under PD, an encoder with 0.03 mrad of noise."""
    run = run_joint(
        joint, actuator, Encoder(noise=3e-5), Gains(12.0, 0.0, 1.2, 5e-3), wave, 2e-3, 8.0
    )
    return control.Log(2e-3, np.append(run.measured, run.q[-1]), run.command)


result = identify(logged(truth, Actuator())).model
for name, true in (("inertia", truth.inertia), ("damping", truth.damping), ("coulomb", 0.10)):
    print(f"{name:<8} found {getattr(result, name):.4f}, true {true:.4f}")
believed = control.JointModel(0.12, 0.15, 0.10)
for name, joint, actuator in (
    ("a fifth more inertia", replace(truth, inertia=0.144), Actuator()),
    ("10 ms of delay", truth, Actuator(delay=0.01)),
):
    report = control.diagnose(logged(joint, actuator), believed).causes
    print(f"{name:<20} told: {', '.join(report)}")

# %% [markdown]
# `diagnose` asks the harder question, which of seven causes it is: it fits each by itself and looks at what is left
# over time. The acceleration: inertia or torque constant. The velocity: viscous friction, or a delay, which differs at
# turning points. Its sign: Coulomb friction. The angle: gravity. The largest torques only: saturation.

# %%
show("acceleration_means_inertia")

# %% [markdown]
# ![Inertia out of a log, and which cause is named](../docs/charts/what_a_log_tells.png)

# %%
print_figures("what_a_log_tells", "integral", "second", "coulomb")

# %%
more_claims("inertia_by_differences")

# %% [markdown]
# ### The best law: Riccati, limits, samples
#
# **LQR** asks for the gains that make a sum of squares, $x^\mathsf{T}Qx + u^\mathsf{T}Ru$ over all samples, as small as
# it can be. The cost that is left, $x^\mathsf{T}Px$, obeys the **Riccati** equation; doubling the horizon in each pass
# solves it in about ten passes. Near a torque limit the best command is no linear law any more:
# **model predictive control** (MPC) solves a quadratic program with the limits in it at every sample.

# %%
show("mpc_beats_clipping")

# %% [markdown]
# ![What MPC saves beside a clipped regulator, and its time](../docs/charts/mpc_where.png)

# %%
print_figures("mpc_where", "40 samples", "MPC, warm")

# %% [markdown]
# **MPPI** needs neither a linear model nor a gradient: it tries plans, weights each by $e^{-\text{cost}/\lambda}$, and
# averages. A pendulum whose motor has a third of the torque that holds it level has to swing to get up:
#
# ![How often MPPI swings a weak pendulum up](../docs/charts/swing_up.png)

# %%
print_figures("swing_up", "upright by tries", "upright by samples")

# %%
show("samples_find_the_plan")

# %% [markdown]
# ## 3 · Concept: touch
#
# ### A spring for a hand
#
# **Impedance control** (Hogan 1985) makes the arm answer a displacement as a mass, a spring and a damper would:
#
# $$\boxed{\;F = M\,\ddot x + B\,\dot x + K\,(x - x_0)\;}$$
#
# Mass $M$, damping $B$ and stiffness $K$ are yours to choose. Read it with care: this $F$ is what *you* have to push
# with. The arm's command has the other sign.

# %%
show("impedance_sign")

# %% [markdown]
# **Admittance** goes the other way: it measures the force, moves a virtual mass by it, and lets a stiff position loop
# follow. Play with both, and drag the set-point into the wall:

# %%
simulation("probe")

# %%
show("wall_in_series")

# %% [markdown]
# How stiff may the hand be? A stiffness that a computer shows is late, and what is late feeds the swing. If it always
# takes at least as much energy as it gives, no wall can make it swing: **passivity** (Colgate and Schenkel 1997).

# %%
show("stiffness_depends_on_the_wall")

# %%
show("damping_is_safe")

# %% [markdown]
# Force control and admittance have limits of their own: the wall multiplies a force loop's gain, and a virtual mass may
# be the lighter the softer the wall is.
#
# ![What holds at a wall: force, impedance, admittance](../docs/charts/touching.png)

# %%
print_figures("touching", "P on the force", "impedance", "least virtual")

# %%
more_claims("force_gain_is_free", "admittance_is_light")

# %% [markdown]
# ### The first blow

# %%
predict("softer_hand")

# %%
show("stiff_control_hurts")

# %% [markdown]
# ### Which axis gets the force?

# %%
show("axes_of_a_surface")

# %% [markdown]
# A rigid surface allows no velocity along its normal and, without friction, no force along itself: those are the
# **natural constraint** of each direction (Mason 1981). You may command what the world leaves open, and only that:
# force where place is fixed, place where force is. That is **hybrid control** (Raibert and Craig 1981).
#
# <details><summary>Derive: why it can't be the other way round</summary>
#
# Power through the contact is $f\cdot v$. A frictionless rigid surface takes and gives none, so in each of its own
# directions $f_i v_i = 0$: along the normal $v_n = 0$ and $f_n$ is free, along the tangents $f_t = 0$ and $v_t$ is
# free. Command $x_n$: with a surface of stiffness $k_e$ the force is $k_e$ times your error of place, whatever that is.
# Command $f_t$: there is nothing to push against, and the hand accelerates. Turn the surface, and the directions turn
# with it: select in *its* frame, then turn back.
#
# </details>
#
# In the same frame **operational space** control (Khatib 1987) gives the tip an inertia of its own,
# $\Lambda = (JM^{-1}J^\mathsf{T})^{-1}$, and a null space that does not disturb it: the **dynamically consistent** one.
# Another projector keeps the tip still in statics only.
#
# <div class="alert alert-block alert-warning">
#
# **Key insight.** In contact you close a loop through the wall. Ask what its stiffness multiplies: the gain of a force
# loop, the error of a place, the virtual mass you may show.
#
# </div>

# %%
more_claims("impedance_holds_a_force")

# %% [markdown]
# ## 4 · Design: regimes, levels, rates
#
# Four regimes, four controllers. The rate in the table is the least at which the loop stands at all, measured on one
# probe at a wall of 10 kN/m, two milliseconds late. For the *first peak* the set-point comes at 0.1 m/s and stops 20 mm
# inside the wall (a law of force wants 10 N): the peak of the stiff law is that press, not the blow. *Surface 2 mm
# off* is the change of the force at rest when the surface is 2 mm nearer than believed.

# %%
lines = [
    "| regime | controller | rate | use | first peak | surface 2 mm off |",
    "|---|" + "---|" * 5,
]
for regime, name, use in (
    ("free space", "stiff position", "between waypoints"),
    ("before contact", "soft impedance", "approach, slowly"),
    ("contact", "force", "pushing, insertion"),
    ("hybrid", "hybrid", "wiping: force along the normal, place along the surface"),
):
    result = touch.row(name)
    lines.append(
        f"| {regime} | {name} | from {result['rate_hz']:.0f} Hz on | {use} | "
        f"{result['peak_n']:.0f} N | {result['off_n']:+.1f} N |"
    )
Markdown("\n".join(lines))

# %% [markdown]
# ![First peak of the force against the stiffness of the law](../docs/charts/contact_regimes.png)

# %%
print_figures("contact_regimes", "stiff", "soft", "force", "admittance", "hybrid")

# %% [markdown]
# <div class="alert alert-block alert-success">
#
# **Interview tip.** *The hierarchy*, from the inside out: current, joint torque or velocity, place or impedance, task,
# planner. Each level must be several times quicker than the one around it, because it is treated there as if it obeyed
# at once. Say what sets each rate (the motor's electrical time constant, the delay margin, the stiffness of what is
# touched, what the camera gives), and when you would leave place for force.
#
# <details><summary>"PID inside at 1 kHz, impedance around it at 1 kHz"</summary>
#
# That pair of rates can't be checked: it describes no particular robot, and two loops of one rate are no inner and
# outer one. An impedance law on torque-controlled joints has no PID of place inside at all. What can be checked is a
# loop with its numbers: rate, delay, gains. Then its matrix gives the margins.
#
# </details>
#
# </div>
#
# ## 5 · Code, and the simulation in full
#
# The loop as a matrix over the state, the commands under way and the law's memory; a PID with what a drive adds to it,
# one sample; computed torque, with the half sample; a better plan by trying:

# %%
source(sampled._closed, control.pid._update, control.computed_torque, control.mppi)

# %% [markdown]
# Sliders for three gains, torque limit, delay, sample time, load, friction; a menu for the encoder; switches for
# anti-windup and for the derivative. The joint is solved exactly, so its limits are the robot's. Go through the
# presets, each is one failure. Before you choose one, say what will happen:
#
# 1. *P past its limit*: how does it look a minute later, with a motor that is limited?
# 2. *PD at its limit*: which way do you move the sample time?
# 3. *A weak motor*: what do the margins say about it?
# 4. *Z-N, PID*: which gain do you change first?

# %%
simulation("joint", "Hunting")

# %% [markdown]
# ## 6 · Speed against accuracy
#
# ### Which law for which error
#
# Two links on one motion: largest error against samples a second, the model right and wrong; and against computing
# time, with the same law through Pinocchio and MuJoCo from Python. A triangle at the upper edge is off the chart.
#
# ![Tracking error against samples a second, and against computing time](../docs/charts/tracking_laws.png)

# %%
print_figures("tracking_laws", "half-sample", "PD + gravity  ", "Pinocchio", "MuJoCo")

# %% [markdown]
# The parts of a plan, against SciPy and MuJoCo: rollouts of two links, Riccati equations, box QPs.
#
# ![Rollouts beside MuJoCo, regulators and boxes beside SciPy](../docs/charts/control_speed.png)

# %%
print_figures("control_speed", "")

# %% [markdown]
# *What to pick.* A good model and a known load: computed torque, half a sample ahead; nothing else buys as much for a
# microsecond. A load that changes: adapt. A torque limit that binds, or a cost that is not a distance from a path:
# plan ahead, by a quadratic program while the model is linear enough, by samples when it is not.
#
# With the model wrong as here, PD with gravity is ahead of computed torque in this chart, but not by its law: its
# spring at the elbow is seven times as stiff. At equal stiffness the two err about alike with the wrong model. With the
# right one computed torque is ahead by a factor of more than a hundred:
#
# ![Error of PD with gravity and of computed torque over the stiffness of the elbow](../docs/charts/equal_stiffness.png)
#
# ## 7 · Debug: what a simulator hides
#
# A stepping simulator has limits that belong to its steps:

# %%
predict("one_step_a_sample")

# %%
show("simulator_hold")

# %% [markdown]
# ![Where the sampled PID loop is stable, measured and in theory](../docs/charts/pid_stability.png)

# %%
print_figures("pid_stability", "largest", "MuJoCo")

# %% [markdown]
# That settles the per cents between the map's theory and MuJoCo's marks: the marks are right, for a loop with MuJoCo's
# hold. The more of the loop one hands over to a simulator, the more it helps:

# %%
show("servo_is_a_sampled_loop")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** A simulator's actuator, contact and friction are models with time constants of their own. Close the
# loop outside, at the robot's rate, with several steps a sample, or you tune the simulator.
#
# </div>

# %%
more_claims(
    "delay_delays_the_loop",
    "contact_is_the_wall",
    "pid_actuator_guards",
    "friction_loss_holds",
)

# %% [markdown]
# ### Debugging
#
# Say the cause before you open the answer.
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The robot overshoots its target.* Is the command at its limit during the step? Then it is windup,
# or a motor that can't brake: no gain helps. Is there an integral? Then take it out for a moment. Is it PD, far from
# its limits? Then more Kd or less Kp. Is the growth near one? Then something is late: look for the delay, not for a
# gain. And does the set-point have to jump?
#
# <details><summary>What people get wrong there</summary>
#
# They lower Kp. With an integral that makes it worse. And they raise Kd near the limit that the delay sets.
#
# </details>
#
# </div>

# %%
show("overshoot_means_p")

# %%
show("overdamped_cure")

# %% [markdown]
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The robot vibrates at contact.* Which loop goes through the wall? For an impedance law, less
# stiffness, then damping for the stiffness *in contact*, as far as the delay allows. For a force loop, less gain on the
# force: its stiffness is not in it. For admittance, more virtual mass, or a softer inner loop. Count the bounces, too:
# a hand that leaves the surface is another problem than one that rings on it.
#
# </div>

# %%
show("vibration_needs_softness")

# %% [markdown]
# <table>
# <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr>
# <tr><td>a swing that neither grows nor dies</td> <td>a loop past its limit, its torque limited</td> <td>growth of its
# matrix; halve all gains</td> <td>less gain, less delay</td></tr>
# <tr><td>a slow swing about the target, with pauses</td> <td>hunting</td> <td>take the integral out</td> <td>a dead
# band; friction compensation from the reference's speed</td></tr>
# <tr><td>torque noise at rest</td> <td>encoder lines times Kd</td> <td>count lines</td> <td>filter; observer; sample
# slower</td></tr>
# <tr><td>error like the acceleration</td> <td>inertia or torque constant; on a sine, gravity too</td>
# <td>`diagnose`</td> <td>identify, payload</td></tr>
# <tr><td>fine in the simulator, swings on the robot</td> <td>the simulator's hold, or a delay of the target only</td>
# <td>ten steps a sample, the loop outside</td> <td>tune with the true lateness</td></tr>
# </table>
#
# ## 8 · Exercises
#
# Graded exercises; the drill `pid` (`drills start pid`) comes before them. `check` runs what your cell defines in
# a process of its own, on cases drawn afresh, and says what is right, what is wrong and, where it recognises the
# mistake, why.
#
# ### The ultimate gain

# %%
card("ultimate_gain")


# %%
def ultimate_gain(inertia, damping, dt, delay):
    """Return the gain at which a sampled P loop around a joint swings for ever.

    And the period of that.
    """
    # As if the whole loop were one dead time and the joint did not turn meanwhile.
    late = delay + dt
    return inertia / late**2, 2.0 * math.pi * late


check(ultimate_gain)

# %% [markdown]
# ### Computed torque

# %%
card("computed_torque")


# %%
def computed_torque(lengths, masses, gravity, q, v, reference, kp, kd):
    """Return torques that make two links in a vertical plane follow a reference."""
    # A law that knows no arm: PD alone.
    return np.asarray(kp) * (reference[0] - q) + np.asarray(kd) * (reference[1] - v)


check(computed_torque)

# %% [markdown]
# ### The gain of a regulator

# %%
card("lqr")


# %%
def lqr(A, B, Q, R):
    """Return the gain of the discrete linear quadratic regulator."""
    # Only the next sample counts.
    return np.linalg.solve(R + B.T @ Q @ B, B.T @ Q @ A)


check(lqr)

# %% [markdown]
# ### Force here, place there

# %%
card("hybrid")


# %%
def hybrid_torque(J, frame, forced, error, velocity, force, wanted, gains):
    """Return joint torques that press along some axes of a surface and move along the others."""
    # Impedance along all axes: no force is controlled.
    return np.asarray(J).T @ (gains[0] * np.asarray(error) - gains[1] * np.asarray(velocity))


check(hybrid_torque)

# %% [markdown]
# ### Inertia from a log

# %%
card("inertia_from_log")


# %%
def inertia_from_log(q, tau, dt):
    """Return inertia of a joint with friction and gravity, from a log of angles and torques."""
    # The largest torque over the largest acceleration.
    acceleration = np.gradient(np.gradient(q, dt), dt)
    return float(np.max(np.abs(tau)) / np.max(np.abs(acceleration)))


check(inertia_from_log)

# %% [markdown]
# ### One step of MPPI

# %%
card("mppi_step")


# %%
def mppi_step(plan, noise, costs, temperature, low, high):
    """Return a plan of commands, moved towards its cheap variations."""
    # All rollouts count alike, whatever they cost.
    return np.mean(plan + noise, axis=0), float(len(costs))


check(mppi_step)

# %% [markdown]
# ### Silent-bug hunt
#
# It holds every load and never rings, and its poles are not where they should be.

# %%
card("hold_joint")


# %%
def hold_joint(q, target, pole, load, dt, steps):
    """Return a link in a vertical plane under computed torque with an integral, from rest."""
    inertia, weight = 0.5, 9.0  # kg m^2; N m, times the cosine of the angle
    kp, ki, kd = 3.0 * pole**2, pole**3, 3.0 * pole
    q, v, total = float(q), 0.0, 0.0
    for _ in range(steps):
        error = target - q
        wanted = kp * error + ki * (total + error) - kd * v
        torque = inertia * wanted + weight * math.cos(q)
        total = total + dt * error
        v = v + dt * (torque + load - weight * math.cos(q)) / inertia
        q = q + dt * v
    return q, v, total


check(hold_joint)

# %% [markdown]
# ### Formulas: three triangles
#
# PD on a free inertia. Write one sample as a matrix or as a polynomial in $z$, and ask when its roots leave the unit
# circle (Jury's conditions). Any equivalent form is right. <span class="kernel-only">Change the texts.</span>

# %%
answer("pd_exact_rate", "4*J/h^2")

# %%
answer("pd_difference", "2*c")

# %%
answer("pd_sample_late", "V")

# %% [markdown]
# ## 9 · Frontier: learned controllers
#
# A **residual** law is a classical one plus a learned correction, $\tau = \tau_{\text{model}} + \pi_\theta(x)$.
# Residual policy learning (Silver and others, arXiv 1812.06298; Johannink and others, ICRA 2019) learns the second part
# by reinforcement. It starts from something that works, and that is most of what it gains. That it "converges much
# faster" names two learners and no task; measured on one task:

# %%
show("residual_learning_is_faster")

# %%
show("residual_of_the_state")

# %% [markdown]
# <table>
# <tr><th>work</th> <th>year</th> <th>what it does</th></tr>
# <tr><td>Slotine and Li</td> <td>1987</td> <td>adapts the model's own numbers, with a proof: the baseline</td></tr>
# <tr><td>Actuator nets (Hwangbo and others, Science Robotics)</td> <td>2019</td> <td>a network for what the drive does,
# inside a simulator</td></tr>
# <tr><td>RMA (Kumar and others, RSS)</td> <td>2021</td> <td>a policy that reads the changed dynamics from the last
# moments</td></tr>
# <tr><td>Neural-Fly (O'Connell and others, Science Robotics)</td> <td>2022</td> <td>features learned beforehand, their
# weights adapted in flight</td></tr>
# <tr><td>MJPC (Howell and others, arXiv 2212.00541)</td> <td>2022</td> <td>predictive sampling with MuJoCo, weights
# changed live</td></tr>
# </table>

# %%
predict("taught_elsewhere")

# %% [markdown]
# A small one: two hundred random waves, fitted to the torques that a wrong model lacks, collected again under the
# improved law; beside it the adaptive law with seven parameters:
#
# ![Learned and adapted, on the trained motion and on a larger one](../docs/charts/learned_beside_adaptive.png)

# %%
print_figures("learned_beside_adaptive", "adaptive", "learned")

# %% [markdown]
# What that proves: the lack is a smooth function of state and acceleration, and a linear fit finds it where it was
# seen. What it does not: that it knows the arm. On a larger motion the law with numbers that mean something stays good.
#
# And MPPI through MuJoCo, by the same interface, its weights changed while it runs: first the upper arm shall go up,
# then torque gets dear.

# %%
body, arm = TwoLink(gravity=9.81).chain(), TwoLink(gravity=9.81)
rng, price, plan = np.random.default_rng(0), 1e-4, np.zeros((15, 2))
state = np.array([-1.5, 0.0]), np.zeros(2)


def in_mujoco(plans):
    """Return costs of plans (K, 15, 2) from the state on: distance at the end, and torque."""
    ends = mujoco.rollouts(body, plans, 0.02, state, (0.0, -9.81, 0.0))()
    return ((ends - (1.2, 0.6)) ** 2).sum(axis=1) + price * (plans**2).sum(axis=(1, 2))


for price in (1e-4, 1.0):
    for _ in range(60):
        result = control.mppi(in_mujoco, plan, rng, spread=4.0, temperature=0.05, limit=20.0)
        q, v = control.rollouts(arm, result.plan[None, :1], 0.02, state)
        state, plan = (q[-1, :, 0], v[-1, :, 0]), control.sampling.shifted(result.plan)
    print(f"price of torque {price:g}: the upper arm is up: {np.sin(state[0][0]) > 0.5}")

# %% [markdown]
# ## 10 · Interview
#
# Answer aloud, then open: first what one says in a minute, then the whole of it, then what comes next.

# %%
interview("control")

# %% [markdown]
# ### Checkpoint
#
# Three formulas that are not on this page; you can derive them from what is. The gate opens when all are right.

# %%
checkpoint(
    "control",
    tenth_of_p="",
    critical_in_contact="",
    high_gain_catches="",
)
