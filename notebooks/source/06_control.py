# %% [markdown]
# # 6 · Control
#
# *A robot arm moves to a target. It overshoots, stops short, or starts to shake. Often the motor is fine, but the rule
# from measured angle to torque is not.*
#
# The most common rule is **PID**. The error is the target minus the measured angle. PID adds three torques: one
# proportional to the error (gain Kp), one to the error summed over time (Ki), and one to the rate of the error (Kd).
# Below, it drives one joint to the dashed target. Answer the question first<span class="kernel-only">, run the code
# cell under it</span>, then press *Play* and drag the target.
#
# About {open minutes} minutes of reading, cards and charts. The folded parts add {folded minutes} minutes, the
# exercises {exercise minutes} minutes.

# %%
from course.cards import predict
from course.simulations import simulation

predict("far_from_limits")

# %% [markdown]
# ![A joint that tracks a step](attachment:control.joint.png)

# %%
simulation("joint")

# %% [markdown]
# **After this chapter you can**
#
# * compute the highest stable gain of a rigid joint before you tune it;
# * write a PID controller that copes with torque limits, jams and encoders;
# * choose a tracking controller for an arm, and diagnose it when the arm does not follow;
# * choose a controller for contact with a wall;
# * tell an instability of the robot from an artefact of its simulator.
#
# In the simulation, *settled* means that the error stays below 2 % of the step. The other readouts follow below. You
# need the equations of motion of chapter 4, linear differential equations, and eigenvalues.
#
# ## How this chapter works
#
# Cards with a common claim offer three verdicts: *true*, *false*, and *only under a condition*. Choose the third if the
# claim needs a condition that it does not state. These are the exercises of section 8:

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint, your_robot

badges(6)

# %% tags=["hide-code"]
import inspect
import math
import re
import textwrap
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

from course import control
from course.cards import figures, interview
from course.charts import read, stored
from course.charts.control import limits, touch, tracking
from course.control import (
    Actuator,
    Encoder,
    Gains,
    Joint,
    JointLaw,
    Probe,
    TouchLaw,
    frequency,
    identify,
    run_joint,
    run_touch,
    sampled,
)
from course.derivations import more_claims, show
from course.kinematics import TwoLink
from course.oracles.mujoco import chain as mujoco


def source(function, begin):
    """Return the body of a function as it stands in its module, from the line that begins so."""
    lines = inspect.getsource(function).splitlines()
    first = next(k for k, line in enumerate(lines) if line.lstrip().startswith(begin))
    head = f"def {function.__name__}({', '.join(inspect.signature(function).parameters)}):"
    return Markdown("\n".join(["```python", head, *lines[first:], "```"]))


def print_figures(chart, *rows):
    """Print the lines of a chart's key figures that begin so, no wider than a page."""
    for line in read(chart).splitlines():
        if line.lstrip().startswith(rows):
            words = " ".join(line.split())
            print(textwrap.fill(words, 96, subsequent_indent="    "))


# %% [markdown]
# ## 1 · Concept: one joint
#
# ### PID: three terms
#
# The **set-point** $q_d$ is the angle that the joint should have, $q$ is the measured angle, and $e = q_d - q$ is the
# error. The controller turns the error into a torque, the motor turns the joint, and the encoder measures the new
# angle. This circle is the control loop:

# %% tags=["hide-code"]
figure_, axes = plt.subplots(figsize=(9, 1.9), layout="constrained")
box = {"boxstyle": "round,pad=0.4", "fc": "#cfe3f2", "ec": "0.3"}
arrow = {"arrowstyle": "-|>", "color": "0.3"}
blocks = ("set-point $q_d$", "+", "controller", "torque limit", "delay", "joint", "encoder")
places = ((0.0, 0.0), (2.0, 0.0), (4.0, 0.0), (6.0, 0.0), (8.0, 0.0), (10.0, 0.0), (6.0, -1.1))
drawn = [
    axes.text(*place, text, ha="center", va="center", bbox=box, fontsize=9)
    for place, text in zip(places, blocks, strict=True)
]
for k in range(5):
    ends = {"patchA": drawn[k].get_bbox_patch(), "patchB": drawn[k + 1].get_bbox_patch()}
    _ = axes.annotate("", places[k + 1], places[k], arrowprops={**arrow, **ends, "shrinkB": 0})
encoder_ = {"patchB": drawn[6].get_bbox_patch(), "shrinkB": 0}
_ = axes.plot([10.0, 10.0], [-0.22, -1.1], color="0.3", lw=1)
_ = axes.annotate("", places[6], (10.0, -1.1), arrowprops={**arrow, **encoder_, "shrinkA": 0})
_ = axes.plot([5.45, 2.0], [-1.1, -1.1], color="0.3", lw=1)
_ = axes.annotate("", (2.0, -0.24), (2.0, -1.1), arrowprops={**arrow, "shrinkA": 0, "shrinkB": 0})
for x, y, text in (
    (2.15, -0.5, "\u2212"),
    (2.9, 0.12, "error $e$"),
    (3.7, -0.95, "measured angle $q$"),
):
    _ = axes.text(x, y, text, ha="center", fontsize=9)
_ = axes.set(xlim=(-1.1, 10.8), ylim=(-1.5, 0.5))
_ = axes.axis("off")
plt.show()

# %% [markdown]
# In symbols, PID control is
#
# $$\boxed{\;\tau = K_p\,e + K_i\int e\,dt + K_d\,\dot e\;}$$
#
# * The **P term** acts like a spring to the set-point. $K_p$ is its stiffness, in N m/rad.
# * The **I term** sums the error over time. It changes as long as there is an error. $K_i$ has the unit N m/(rad s).
# * The **D term** acts like a damper. $K_d$ has the unit N m s/rad.
#
# The joint has an inertia $J$ and **viscous friction**, a torque $b\,\dot q$ against the motion. Our joint has $J$ =
# 0.5 kg m² and $b$ = 0.5 N m s/rad. With a constant set-point and without the I term, joint and controller together
# obey
#
# $$J\,\ddot q + (b + K_d)\,\dot q + K_p\,q = K_p\,q_d .$$
#
# This is a mass on a spring with a damper. A constant load torque $\tau_L$ stretches the spring, so the joint stops
# with an error of size $\tau_L / K_p$. With an I term, this error is summed until the I term carries the load. Here a
# load of 2 N m pushes the joint forwards:

# %% tags=["hide-code"]
figure_, axes = plt.subplots(figsize=(8, 2.9), layout="constrained")
for label, gains in (
    ("P: $K_p$ = 20", Gains(20.0)),
    ("PD: also $K_d$ = 4", Gains(20.0, 0.0, 4.0)),
    ("PID: also $K_i$ = 20", Gains(20.0, 20.0, 4.0)),
):
    run = run_joint(Joint(0.5, 0.5, 2.0), Actuator(), Encoder(), gains, 1.0, 1e-3, 6.0)
    _ = axes.plot(run.times, run.q, label=label)
_ = axes.axhline(1.0, color="0.3", ls="--", lw=1)
_ = axes.set(
    xlabel="time [s]",
    ylabel="angle [rad]",
    title="A step of the set-point, with a load (gains in SI units)",
)
_ = axes.legend(fontsize=9)
plt.show()

# %% [markdown]
# Here P without D oscillates for a long time. PD comes to rest past the dashed set-point, by $2/20$ = 0.1 rad. PID
# goes past it, too, but then returns to it slowly. Whether a mass on a spring oscillates depends on its **damping
# ratio** $\zeta = (b + K_d)/(2\sqrt{J K_p})$: below 1 it does. The value 1 is called **critical damping**.
#
# With an I term, the joint can rest for ever only where the error is zero, unless the command is at its limit or a stop
# is in the way. But dry friction can keep it away. It has two parts: **Coulomb friction** is a torque of constant size
# against the motion, and **static friction** holds a joint at rest. The I term grows until the joint breaks loose. If
# static friction is larger than Coulomb friction, the joint can jump past the set-point and stick on the other side,
# again and again. This is called **hunting**.

# %%
show("integral_removes_the_error")

# %% [markdown]
# The D term needs the rate of the error. There are two ways to compute it: differentiate the error $e$, or
# differentiate the measured angle and use $-\dot q$. While the set-point is constant, both are the same. Now let the
# set-point jump from one measurement to the next.

# %%
show("error_derivative_kick")

# %% [markdown]
# The spike in the command is the **derivative kick** (a preset of the first screen shows it). So differentiate the
# measurement if the set-point can jump. On a planned motion use $\dot q_d - \dot q$, as section 2 does.
#
# <details><summary>A continuous joint: wrap the error</summary>
#
# A **continuous joint** has no stops, and its encoder starts again at the end of each turn. Wrap the error of such a
# joint to half a turn on each side with $\operatorname{atan2}(\sin e, \cos e)$, so that the joint takes the short
# direction. Wrap the difference of two encoder angles as well: the rate made from it is right for speeds below
# $\pi/dt$. The claim *The error of a continuous joint* below shows where a wrapped error goes wrong.
#
# </details>

# %%
more_claims(
    "p_alone_overshoots",
    "critical_settles_fastest",
    "one_gain_one_symptom",
    "too_much_d",
    "angle_error_wraps",
)

# %% [markdown]
# ### Windup and anti-windup
#
# Every motor has a largest torque. When the controller asks for more, the motor delivers this limit, whatever the
# error is. But the I term keeps summing the error.

# %%
predict("jammed")

# %% [markdown]
# This build-up of the I term is called **windup**. Choose the preset *A jam* on the first screen, watch the joint run
# away, then switch on anti-windup. Two methods are common:
#
# * **Conditional integration** stops the sum while the command is at a limit and the error would push the command
#   further beyond the limit.
# * **Back-calculation** takes the difference between the limited and the requested torque, and feeds it back into the
#   I term, so that the I term shrinks while the command is at the limit.
#
# The chart shows another joint, which is blocked for 2 s. A load pushes forwards, and the set-point is 0.25 rad. In the
# right chart, the command without anti-windup (orange) stays at the upper limit even after the joint has passed the
# set-point. With conditional integration (blue), it leaves the limit at once. Lines are the exact solution, dots are
# from the simulator MuJoCo:
#
# ![A jam of two seconds, with anti-windup and without](../docs/charts/pid_windup.png)

# %%
figures(
    read("pid_windup"),
    "conditional",
    "no anti-windup",
    summary="Which effects the scene models, and how much the others would change the answer",
)

# %% [markdown]
# <details><summary>The PID code of many tutorials, and what is wrong with it</summary>
#
# In outline, with a fixed sample time `dt`:
#
# ```python
# integral = clip(integral + error * dt, -i_max, i_max)  # a fixed range for the integral
# rate = (error - last_error) / dt  # derivative of the error
# torque = clip(kp * error + ki * integral + kd * rate, -limit, limit)
# acceleration = torque / inertia - 0.5 * velocity
# ```
#
# The first line keeps the I term within a fixed range, whether the motor is at its limit or not. A range that the I
# term never reaches changes nothing. One that is narrower than the load leaves an error for ever. The second line has
# the derivative kick. The claims below examine the rest, with kp = 20, ki = 5 and kd = 8.
#
# </details>

# %%
more_claims("integral_clamp", "listing_settles", "listing_friction")

# %% [markdown]
# ### The sampled loop as a matrix
#
# So far the torque followed the angle at every instant. Under this assumption, a joint with viscous friction is
# stable under P alone at any gain: the friction damps every oscillation. A computer works differently. It measures
# the angle once per sample time $dt$ and computes a torque. The **motor drive**, the electronics that feed the motor,
# holds this torque until the next sample. Holding a value between samples is called a **zero-order hold**:

# %% tags=["hide-code"]
figure_, axes = plt.subplots(figsize=(8, 2.5), layout="constrained")
fine, samples = np.linspace(0.0, 8.0, 400), np.arange(9)
_ = axes.plot(fine, np.sin(0.8 * fine), color="0.5", label="smooth command")
_ = axes.step(samples, np.sin(0.8 * samples), where="post", label="held command")
_ = axes.plot(samples, np.sin(0.8 * samples), "o", color="C0", ms=4)
_ = axes.plot(
    fine, np.sin(0.8 * (fine - 0.5)), "--", color="C1", label="smooth, half a sample later"
)
_ = axes.set(xlabel="time [samples]", ylabel="torque", yticks=[], xlim=(0.0, 8.0))
_ = axes.legend(fontsize=9, loc="upper right")
plt.show()

# %%
predict("more_p")

# %% [markdown]
# Between two samples the torque is constant, so the motion can be computed exactly. The vector (angle, rate) of one
# sample, times a matrix, gives the vector of the next. Take an inertia without friction and P control to the
# set-point zero. At sample number $k$ the torque is $-K_p q_k$, and
#
# $$\begin{pmatrix} q_{k+1}\\ v_{k+1}\end{pmatrix} =
# \begin{pmatrix} 1 - \dfrac{K_p\,dt^2}{2J} & dt\\[1ex] -\dfrac{K_p\,dt}{J} & 1\end{pmatrix}
# \begin{pmatrix} q_k\\ v_k\end{pmatrix}.$$
#
# The loop comes to rest if and only if all eigenvalues of this matrix are smaller than 1 in absolute value. The
# largest absolute value is the **growth** per sample, or spectral radius. **Worked example:** the determinant of the
# matrix, which is the product of its eigenvalues, is $1 + K_p\,dt^2/(2J)$. For every positive $K_p$ it is above 1. So
# without friction, P alone is unstable at any gain. If the loop has a further delay, some commands are on their way
# to the motor. The vector then contains them, too.

# %%
show("hold_is_half_a_sample")

# %% [markdown]
# So in slow motions, count the hold as a delay of $dt/2$. Let $D$ be the sum of all other delays in the loop (not the D
# term). The **ultimate gain** $K_u$ is the P gain on the border between stable and unstable. There the loop oscillates
# with constant amplitude. The first equation below gives the angular frequency $\omega$ of this oscillation (its
# smallest positive solution), and the second gives $K_u$. Both are accurate while $dt$ is short compared with $J/b$:
#
# $$\omega\tan\!\big(\omega\,(D + \tfrac12 dt)\big) = \frac{b}{J}, \qquad
# K_u = \omega\,\sqrt{(J\omega)^2 + b^2} .$$
#
# <details><summary>Derive: the ultimate gain of a loop with delay</summary>
#
# Let $D_t = D + dt/2$ be the total delay. At the limit the joint moves as $e^{i\omega t}$, and $J\ddot q + b\dot q =
# -K\,q(t - D_t)$ becomes $J\omega^2 - ib\omega = K e^{-i\omega D_t}$. The angle of the left side is
# $-\arctan(b/(J\omega))$, that of the right side is $-\omega D_t$, so $\tan\omega D_t = b/(J\omega)$. The absolute
# value of both sides is $K$. Replacing the hold by a delay of $dt/2$ is an approximation, since a staircase is not a
# shifted smooth curve. The next cell compares it with the exact matrix.
#
# </details>

# %%
inertia, damping, dt = 0.5, 0.5, 1e-3  # kg m^2, N m s/rad, s: the joint of the first screen
A, B = control.joint_system(inertia, damping)
for late in (0.0, 0.005, 0.02, 0.05):
    gain, period = control.ultimate_gain(A, B, dt, late)
    rule = sampled.delay_limit(inertia, damping, late + dt / 2)[0]
    print(
        f"delay {1e3 * late:3.0f} ms: ultimate gain {gain:8.3f} N m/rad, period {period:.3f} s; "
        f"formula's relative error {abs(gain / rule - 1):.0e}"
    )

# %% [markdown]
# A delay of 20 ms lowers the ultimate gain from 1000 to 24 N m/rad. The left chart shows others. In the right chart,
# the hold is the only delay, and a simulator with one physics step per sample hides it (section 7):
#
# ![Ultimate gain against delay, and against a simulator's steps](../docs/charts/delay_limit.png)

# %%
more_claims("p_at_any_gain", "pade_is_enough")

# %% [markdown]
# ### Stability margins
#
# Imagine that you cut the loop at the motor and send a sine of torque into it. The joint moves, and the controller
# answers with another sine of torque. The controller pushes against the deflection, so its answer has a minus sign;
# leave this sign out at first. The size of the answer, divided by that of the sent sine, is the **open-loop gain**. The
# shift between the two sines is the **phase lag**.
#
# A lag of 180 degrees turns a sine into its negative, and the minus sign turns it back. So with gain 1 and this lag,
# the answer equals the sine that you sent in. In the closed loop, this oscillation keeps itself going.
#
# * The **gain margin** is the factor by which all gains can be raised before the loop becomes unstable. (With an I
#   term, lower gains can make a loop unstable, too.)
# * The **crossover frequency** is the frequency at which the open-loop gain is 1. The **phase margin** is the
#   additional phase lag there that makes the loop unstable.
# * The **delay margin** is the additional delay that makes the loop unstable. It is the phase margin in radians,
#   divided by the crossover frequency in rad/s. (With several crossovers, the smallest result counts.)
#
# A **Bode plot** draws gain and phase over the frequency, with logarithmic axes for gain and frequency:

# %% tags=["hide-code"]
w = np.geomspace(1.0, 1000.0, 4000)
kp, kd, late = 20.0, 8.0, 5e-3
plant, law = control.held(A, B, dt, late), control.pid_law(kp, 0.0, kd, dt=dt)
loop, shape = frequency.response(plant, law, w), frequency.loop_shape(plant, law)
margin = control.margins(A, B, law, dt, late)
lag, half = np.degrees(loop.phase), np.argmax(loop.phase < -math.pi)
figure_, (top, bottom) = plt.subplots(2, 1, figsize=(8, 4.2), layout="constrained", sharex=True)
_ = top.loglog(w, loop.size)
_ = top.axhline(1.0, color="0.4", lw=1)
_ = top.plot([w[half]] * 2, [loop.size[half], 1.0], color="C1", lw=3)
_ = top.text(1.1 * w[half], 0.5, f"gain margin {margin.gain:.1f}", color="C1")
_ = bottom.semilogx(w, lag)
_ = bottom.axhline(-180.0, color="0.4", lw=1)
_ = bottom.plot(
    [shape.crossover] * 2, [math.degrees(margin.phase) - 180.0, -180.0], color="C3", lw=3
)
_ = bottom.text(
    shape.crossover / 1.1,
    -172.0,
    f"phase margin {math.degrees(margin.phase):.0f} degrees\n"
    f"= delay margin {1e3 * margin.delay:.0f} ms, at {shape.crossover:.0f} rad/s",
    color="C3",
    ha="right",
    va="bottom",
)
_ = top.set(
    ylabel="open-loop gain", title="PD, $K_p$ = 20, $K_d$ = 8, delay 5 ms, sampled at 1 kHz"
)
_ = bottom.set(xlabel="angular frequency [rad/s]", ylabel="phase [degrees]", ylim=(-270, -80))
plt.show()

# %% [markdown]
# For a robot joint, quote the delay margin: you can compare it with the milliseconds that communication, motor drive
# and filters add. It does not cover a wrong gain; the gain margin does.
#
# ### Nyquist plot, sensitivity and bandwidth
#
# The margins look at two frequencies only. The **Nyquist plot** shows all of them. For each frequency, gain and phase
# together form one complex number $L$. Its distance from zero is the open-loop gain, and its angle is negative for a
# lag. The plot draws all these points as a curve. The critical point is $-1$: gain 1 and a lag of 180 degrees. So in a
# stable loop, the smallest distance of the curve from $-1$ shows how close the loop is to instability.
#
# What does the closed loop do to a disturbance that is a sine? Let $d$ be the error that it would cause without
# control, and $e$ the error that remains. All feedback runs along one path, from the error to the torque to the angle,
# so $L$ is the same wherever you cut this path. Now cut it at the error: the loop turns $e$ into the joint's motion
# $L\,e$, which reduces the error. So $e = d - L\,e$, and the ratio $e/d$ is the function $S$ below:
#
# $$S = \frac{1}{1 + L},\qquad T = \frac{L}{1 + L},\qquad S + T = 1 .$$
#
# * The **sensitivity** $S = e/d$ is the share of the error that is left. Where $\lvert S\rvert$ is 0.1, the loop
#   removes 90 %. Where it is above 1, the loop amplifies the disturbance.
# * The **complementary sensitivity** $T$ is the share of the sensor noise that the joint follows. If D acts on the
#   error, the set-point enters the loop as the noise does, so $T$ is also the ratio of joint angle to set-point. The
#   **bandwidth** is the frequency at which $\lvert T\rvert$ falls below $1/\sqrt2$.
#
# The distance of $L$ from $-1$ is $\lvert 1 + L\rvert = 1/\lvert S\rvert$. So the largest $\lvert S\rvert$, the
# **peak sensitivity** $M_s$, is one number for the whole curve: $1/M_s$ is its smallest distance from $-1$. **Worked
# example:** in a stable loop with $M_s = 2$ the curve stays 0.5 away from $-1$. So it does not cross the real axis
# between $-1$ and $-0.5$, and the gain can at least be doubled.
#
# The simulation begins with the PD loop of the Bode plot, with D on the error. Drag the gain curve up or the phase
# curve down. The preset *High sensitivity* has 8 times the gain:

# %%
simulation("nyquist")

# %% [markdown]
# The orange disc around $-1$ has the radius $1/M_s$, and the Nyquist curve touches it. Before the next claim, compare
# $\lvert S\rvert$ between 100 and 1000 rad/s in the presets *High sensitivity* and *Comfortable*.

# %%
show("more_gain_rejects_everywhere")

# %% [markdown]
# This is the **waterbed effect**: in a loop with a hold or a delay, if you push $\lvert S\rvert$ down at some
# frequencies, it rises at others. A common design rule is $M_s \le 2$, which also guarantees a phase margin of at least
# 29 degrees.

# %%
more_claims("peak_sensitivity_bounds_margins")

# %% [markdown]
# ### Stable PD gains: damping and delay
#
# Now omit friction, so that all damping comes from $K_d$. Gains without units, $K_p\,dt^2/J$ and $K_d\,dt/J$, make
# joints and sample times comparable. In the left chart, the gains below a curve are stable. The controller knows the
# exact rate, or it takes the difference of two angles. In the curves *a sample late*, the controller's whole command
# also comes a sample later.
#
# With the exact rate, the stable gains form a triangle: below the blue line, and left of $K_d\,dt/J$ = 2. If $K_d$ is
# too small, the delay of the hold makes the loop unstable, as in the worked example of the matrix. If $K_d$ is too
# large, the held damping torque reverses the velocity within one sample and makes it larger.
#
# ![Stable gains of PD, and MuJoCo's position servo](../docs/charts/pd_triangles.png)

# %% tags=["hide-code"]
print("largest stable Kp on the grid of the chart (exact rate, in theory: 4):")
for one in stored("pd_triangles")[0].series:
    print(f"{one.label:<28}{np.nanmax(one.y):6.3f} J/dt^2")

# %% [markdown]
# The difference of two angles, divided by $dt$, is the mean rate over the last sample, so it is half a sample late.
# With a command that is also a sample late, both delays together divide the highest stable $K_p$ by more than twenty.
# The right chart belongs to section 7; there $k_v$ is $K_d$ of MuJoCo's servo. (Triangles at its top: no limit found.)
#
# ### Encoder, friction and torque limit
#
# An encoder rounds the angle to the nearest count; this is called **quantisation**. The controller has to estimate
# the rate from these counts. Near rest, a single count more or less between two samples looks like a jump of the
# rate, and $K_d$ turns it into a jump of the torque.

# %%
predict("faster_loop")

# %% [markdown]
# Three estimates of the rate are common. The plain difference has the least lag and the most noise. A low-pass filter
# averages the difference over about its time constant. A **tracking observer** predicts angle and rate one sample
# ahead, and corrects both with the error of the predicted angle.
#
# The chart compares the three at 1 kHz by their lag under a steady acceleration. At the same lag, the observer (green)
# has less noise than the filter (orange). But it is of second order, so in fast motions its phase lag is larger. Before
# you choose, compare the delay margins of the loop:
#
# ![Noise of a rate against its lag](../docs/charts/rate_estimates.png)

# %% tags=["hide-code"]
print("from the fastest to the slowest setting:")
for one in stored("rate_estimates")[0].series:
    print(
        f"{one.label:<20} lag {1e3 * one.x[0]:4.1f} to {1e3 * one.x[-1]:5.1f} ms, noise "
        f"{one.y[0]:4.0f} to {one.y[-1]:4.0f} rad/s per rad of noise"
    )

# %% [markdown]
# Under PD, the torque of the P term falls as the joint nears the set-point. As soon as this torque is smaller than
# the static friction $\tau_s$, the joint can stay at rest. So without a load, dry friction leaves an error of up to
# $\tau_s/K_p$.
#
# If static friction does not exceed Coulomb friction, an I term removes this error step by step, with longer and
# longer pauses in between (blue). If static friction is larger, the joint can hunt (orange):

# %% tags=["hide-code"]
figure_, axes = plt.subplots(figsize=(8, 2.6), layout="constrained")
for label, static in (("static = Coulomb = 2 N m", 2.0), ("static 3, Coulomb 2 N m", 3.0)):
    stuck = Joint(0.5, 0.5, 0.0, 2.0, static)
    run = run_joint(stuck, Actuator(), Encoder(), Gains(40.0, 150.0, 6.0), 1.0, 1e-3, 30.0)
    _ = axes.plot(run.times, run.q, label=label)
_ = axes.axhline(1.0, color="0.3", ls="--", lw=1)
_ = axes.set(xlabel="time [s]", ylabel="angle [rad]", ylim=(0.95, 1.05))
_ = axes.legend(fontsize=9)
plt.show()

# %% [markdown]
# <details><summary>Ripple and hunting, measured</summary>
#
# Left, a slower filter of the rate makes the torque smoother (encoder of 12 bits, $K_d$ = 2). Right, hunting grows
# with the ratio of static to Coulomb friction.
#
# ![Ripple of an encoder, and hunting](../docs/charts/ripple_and_hunting.png)
#
# </details>
#
# **Saturation** means that the command is at the torque limit. While it is there, a larger error or a higher gain
# gives no more torque. A stronger motor helps, or a slower motion.
#
# <details><summary>From where a weak motor can catch a pendulum</summary>
#
# In the map, the motor of an upright pendulum has half of the torque that would hold it horizontal. The motion of a
# falling pendulum has a growing and a decaying part. The growing part is the sum angle + rate$/\sqrt{g/l}$ ($g$ is
# gravity, $l$ the length), and the controller pushes against this sum. Purple states are caught, orange ones are lost.
# On the border, full torque only just stops the fall. Beyond it no controller can stop the fall: it would have to let
# the pendulum fall and swing it up again. (The steps of the border are those of the grid.)
#
# ![Where a weak motor catches a pendulum](../docs/charts/saturation_region.png)
#
# </details>

# %%
figures(read("saturation_region"), summary="Largest angle at rest, computed and in theory")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Add up the delays of a loop: half a sample for the hold, the computing time, and the communication.
# The D term has further delays: half a sample if the rate is a difference, and, in slow oscillations, about the time
# constant of its filter. Together with inertia and friction, these delays limit the gain of a rigid joint, so compute
# this limit before you tune. The **resonance** of an elastic gear, at which motor and arm swing against each other,
# often lowers it further.
#
# </div>

# %%
more_claims("encoder_ripple", "filtered_rate_is_late", "friction_leaves_an_error")

# %% [markdown]
# ### Tuning with the Ziegler-Nichols rules
#
# **Ziegler-Nichols** (1942) is the classical tuning procedure. (1) Set $K_i$ and $K_d$ to zero. (2) Raise $K_p$ until
# the loop oscillates with constant amplitude, below the torque limit; this is the ultimate gain $K_u$. (3) Measure the
# period $T_u$ of the oscillation. (4) Take the gains from a row of the table.
#
# | controller | $K_p$ | $K_i$ | $K_d$ |
# |---|---|---|---|
# | P only | $0.5\,K_u$ | 0 | 0 |
# | PI | $0.45\,K_u$ | $0.54\,K_u/T_u$ | 0 |
# | PID | $0.6\,K_u$ | $1.2\,K_u/T_u$ | $0.075\,K_u T_u$ |
#
# These rules suit a joint badly. With friction, a constant torque gives a constant *speed*, and the angle is the
# integral of the speed. An I term integrates once more. Each integration has a phase lag of 90 degrees. So with an I
# term, slow motions lag by 180 degrees even without any delay. A joint with little friction lags by nearly 180 degrees
# by itself, so even P alone at half of $K_u$ has almost no phase margin.

# %%
show("ziegler_nichols_is_safe")

# %% [markdown]
# Another method uses three numbers: $J$, $b$ and the delay. Let $D_t$ be the total delay of the D term: hold,
# difference and communication. For simplicity, we give the P term the same delay. With PD, a motion $e^{st}$ is
# possible if
#
# $$J s^2 + b s + (K_p + K_d\,s)\,e^{-sD_t} = 0 .$$
#
# The solutions $s$ are the **poles** of the loop. Choose $K_p$ and $K_d$ so that three of them are equal and real. If
# all others decay faster, the slowest part of the motion does not oscillate. The code computes this triple pole `s` and
# both gains:
#
# <details><summary>Derive: three equal poles</summary>
#
# Multiply the equation by $e^{sD_t}$: its left side becomes $f(s) = (Js^2 + bs)\,e^{sD_t} + K_p + K_d s$. At a triple
# pole, $f$, $f'$ and $f''$ are zero. The second derivative does not contain the gains, so $f'' = 0$ is a quadratic
# equation for $s$ alone. Take its root nearer to zero. Then $f' = 0$ gives $K_d$, and $f = 0$ gives $K_p$.
#
# </details>

# %% tags=["show-code"]
late = 0.02  # s: the delay of our joint
Dt = late + dt  # hold and difference are half a sample each
s = max(
    np.roots([inertia * Dt**2, damping * Dt**2 + 4 * inertia * Dt, 2 * (damping * Dt + inertia)])
)
plain = inertia * s**2 + damping * s
kd = -math.exp(s * Dt) * (Dt * plain + 2 * inertia * s + damping)
kp = -math.exp(s * Dt) * plain - kd * s

Ku, Tu = control.ultimate_gain(A, B, dt, late)
tried = {name: (p * Ku, i * Ku / Tu, d * Ku * Tu) for name, (p, i, d) in limits.ROWS.items()}
tried["equal poles"] = (kp, 0.0, kd)

# %% [markdown]
# The output checks all rows with the growth of the matrix, and with a simulated step of 1 rad (D on the measurement, no
# torque limit):

# %% tags=["hide-code"]
plant = control.held(A, B, dt, late)
print(f"Ku = {Ku:.2f} N m/rad, Tu = {Tu:.3f} s")
for name, (kp, ki, kd) in tried.items():
    growth = control.growth(control.loop_matrix(plant, control.pid_law(kp, ki, kd, dt=dt)))
    run = run_joint(
        Joint(inertia, damping), Actuator(delay=late), Encoder(), Gains(kp, ki, kd), 1.0, dt, 20.0
    )
    observed = control.step_metrics(run.times, run.q, 1.0)
    steps = (
        f"overshoot {observed.overshoot:4.0%}, settled after {observed.settling:5.2f} s, "
        f"peak {np.abs(run.command).max():2.0f} N m"
        if growth < 1.0
        else f"unstable: it grows to {growth ** (1.0 / dt):.2f} times its size per second"
    )
    print(f"{name:<12} kp {kp:5.1f}  ki {ki:5.1f}  kd {kd:4.2f}   {steps}")

# %% tags=["hide-code"]
roots = np.linalg.eigvals(control.loop_matrix(plant, control.pid_law(kp, ki, kd, dt=dt)))
poles = np.log(roots[np.abs(roots) > 1e-9].astype(complex)) / dt
slowest = poles[np.argsort(-poles.real)][:5]
print(f"three equal poles in the formula: {s:.1f} 1/s; slowest poles of the sampled loop [1/s]:")
print(", ".join(f"{pole:.1f}" for pole in slowest))

# %% [markdown]
# <details><summary>Why the triple pole splits in the sampled loop</summary>
#
# There, P is half a sample less late than in the formula.
#
# </details>
#
# The equal poles settle first, but they need the largest torque (*peak*): a weaker motor settles later. They also need
# $J$, $b$ and the delay; the table needs only the experiment. And without an I term, a load leaves an error of
# $\tau_L/K_p$.
#
# The chart repeats the test over many delays. The three rows of the table overshoot far, or are unstable (triangles at
# the top). The equal poles do not overshoot, because D acts on the measurement:
#
# ![The rows on a joint with its true delay](../docs/charts/ziegler_nichols_rows.png)

# %%
show("half_the_ultimate_gain")

# %%
more_claims("every_joint_has_ku", "quoted_gains_overshoot", "quoted_ku_tu", "safer_set")

# %% [markdown]
# ## 2 · Concept: many joints
#
# ### Tracking controllers: PD to computed torque
#
# An arm follows a planned motion $q_d(t)$. Each joint's motion loads the others, so a controller that knows the
# equation of motion can do better than one PD loop per joint. Chapter 4 gave this equation as $M(q)\ddot q + h(q,\dot
# q) = \tau$, where $h = C(q,\dot q)\,\dot q + g(q)$ collects velocity terms and gravity. Four controllers use more
# and more of it:
#
# | controller | torque | what it knows |
# |---|---|---|
# | PD | $K_p e + K_d\dot e$ | nothing |
# | PD with **gravity compensation** | $K_p e + K_d\dot e + g(q)$ | the gravity torque |
# | PD with **feed-forward** | $K_p e + K_d\dot e + M(q_d)\ddot q_d + h(q_d,\dot q_d)$ | the torque of the planned motion |
# | **computed torque** | see below | the whole model, at the measured angles and rates |
#
# $$\boxed{\;\tau = M(q)\,\big(\ddot q_d + K_d(\dot q_d - \dot q) + K_p(q_d - q)\big) + C(q,\dot q)\,\dot q +
# g(q)\;}$$
#
# In computed torque the PD terms are multiplied by $M(q)$. They are accelerations here, so $K_p$ has the unit 1/s²
# and $K_d$ the unit 1/s. The picture shows all four on one motion of a two-link arm, with the correct model:

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(8, 2.9), layout="constrained")
feedforward = JointLaw("feedforward", tracking.ARM, tracking.STIFF, tracking.DAMP)
for label, law in (
    ("PD", tracking.LAWS["PD"](tracking.ARM, dt)),
    ("PD with gravity compensation", tracking.LAWS["PD + gravity"](tracking.ARM, dt)),
    ("PD with feed-forward", feedforward),
    ("computed torque", tracking.LAWS["computed torque"](tracking.ARM, dt)),
):
    run = control.track(tracking.ARM, law, tracking.motion, dt, 4.0)
    error = 1e3 * np.abs(run.q[:, :-1] - run.setpoint).max(axis=0)
    _ = axis.semilogy(dt * np.arange(error.size), error, lw=1.2, label=label)
_ = axis.set(xlabel="time [s]", ylabel="error of the worse joint [mrad]", ylim=(1e-3, 1e4))
_ = axis.legend(fontsize=8, ncols=4, loc="upper center")
plt.show()

# %% [markdown]
# The remaining errors of the two controllers with the full model come from the hold: each torque is constant for a
# sample while the arm moves on. (Section 6 compares these two at equal stiffness; here the PD gains are stiffer.) The
# model torque of PD with feed-forward belongs to the planned motion: away from the plan, it is wrong.
#
# Computed torque uses the measured angles and rates. Let its model be exact, and put its torque into the equation of
# motion: the velocity terms and gravity cancel. Both sides are then $M$ times an acceleration, so $M$ cancels, too.

# %%
show("computed_torque_law")

# %% [markdown]
# With diagonal gain matrices, every joint's error obeys its own linear equation, with the same poles in every pose.
#
# The cancellation is exact only at the instant of the measurement, because of the hold. A remedy is a delay
# compensation: compute the torque for the state and the reference half a sample ahead. We call this **half-sample
# preview** (compared in section 6).
#
# The model can also be wrong, for instance because of a payload. **Adaptive control** (Slotine and Li 1987) changes the
# model's parameters $\hat\theta$, such as masses, during the motion. The model's torque is
# $Y\hat\theta = \hat M(q)\,\ddot q_r + \hat C(q,\dot q)\,\dot q_r + \hat g(q)$, with chapter 4's **regressor** $Y$.
# The reference velocity $\dot q_r = \dot q_d + \Lambda e$ is the planned one plus a correction towards the plan.
#
# The sum $s = \dot e + \Lambda e$ (not the pole $s$ of section 1) combines the errors of velocity and angle. The
# torque is $Y\hat\theta + K s$, and the update is
#
# $$\dot{\hat\theta} = \Gamma\,Y^\mathsf{T} s ,$$
#
# where $\Lambda$, $\Gamma$ and the damping $K$ are positive definite matrices. The update stops when $s$ is zero, even
# if $\hat\theta$ is wrong.

# %%
show("adaptive_finds_parameters")

# %% [markdown]
# The estimate reaches the true values only if the motion keeps making every possible error of the parameters visible in
# the torques. This is called **persistent excitation**. Noise can make the estimate drift: $Y$ and $s$ contain the same
# noise, so their product does not average out. So limit the estimate to plausible values.
#
# <details><summary>Derive: the sampled limit, the drift under noise, and four cures</summary>
#
# Sampled, the update also has a limit. For one joint with exact rates and a constant regressor, it is stable while
# $dt\,\Gamma Y^2 < K + b$. The left chart shows a run on each side of this limit (our joint, $K = 5$ N m s/rad). If the
# rates are differences of the measured angles, the limit is about a third lower (right, green):
#
# ![The limit of adaptation: runs on both sides, and sample times](../docs/charts/adaptation_limits.png)
#
# **Limit.** Let the regressor $Y$ of one joint be constant, and $\varphi$ be the error of the estimated torque. One
# sample maps $s$ to $(a - \sigma K)s - \sigma\varphi$ and $\varphi$ to $\varphi + dt\,\Gamma Y^2 s$, with $a =
# e^{-b\,dt/J}$ and $\sigma = (1 - a)/b$. Both eigenvalues are inside the unit circle only if the determinant $a -
# \sigma K + \sigma\,dt\,\Gamma Y^2$ is below 1. That is $dt\,\Gamma Y^2 < K + b$.
#
# **Drift.** At rest the regressor of the inertia is $\Lambda\dot e$, and $s$ contains the same noisy $\dot e$. The
# mean of their product is not zero, so the estimated inertia grows by $\Gamma\Lambda\,(2\eta^2/dt^2 +
# \Lambda\eta^2/dt)$ per second, where $\eta$ is the standard deviation of the angle. It multiplies the noisy rate
# like a $K_d$, and the loop ends where PD ends.
#
# **Cures.** A *dead zone* stops the update while $s$ is as small as the noise. *Projection* limits the estimate.
# *Leakage* pulls it to a nominal value. *Normalisation* divides the update by $1 + \lvert Y\rvert^2$:
#
# ![Drift of an estimate at rest, and the error on a motion with four cures](../docs/charts/adaptive_cures.png)
#
# </details>

# %%
figures(
    read("adaptive_cures"),
    summary="Drift at rest and error on a motion, with each cure, 12 seeds",
)

# %%
more_claims(
    "perfect_model_perfect_tracking",
    "adaptive_sum_can_only_fall",
    "estimate_rests_with_the_arm",
)

# %% [markdown]
# ### How a wrong inertia shows in the error

# %%
predict("wrong_inertia")

# %% [markdown]
# Take one joint under computed torque. Its model has the inertia $\hat J$, while the true inertia is $J$. The error
# then obeys
#
# $$\ddot e + K_d\,\dot e + K_p\,e = \Big(\frac{J}{\hat J} - 1\Big)\,\ddot q .$$
#
# The right side is the missing torque, divided by $\hat J$. If the motion is slow compared with the loop, the error is
# about the right side divided by $K_p$, so it has the same shape: for inertia that of the acceleration, for viscous
# friction that of the velocity. In faster motions the error lags, which opens the lines into narrow loops. The picture
# shows one joint with 20 % more inertia than in the model, or with viscous or Coulomb friction that the model lacks.

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 3, figsize=(9, 2.6), layout="constrained")
t = 1e-3 * np.arange(14_000)
aim = [(2.0, 0.5, 0.0), (0.8, 1.3, 1.0)]  # rad, rad/s, rad: a slow motion of two sines
q_d = sum(a * np.sin(w * t + c) for a, w, c in aim)
v_d = sum(a * w * np.cos(w * t + c) for a, w, c in aim)
a_d = sum(-a * w * w * np.sin(w * t + c) for a, w, c in aim)
for axis, (title, word, true_inertia, viscous, coulomb) in zip(
    axes,
    (
        ("inertia missing", "acceleration [rad/s²]", 1.2, 0.0, 0.0),
        ("viscous friction missing", "velocity [rad/s]", 1.0, 0.5, 0.0),
        ("Coulomb friction missing", "velocity [rad/s]", 1.0, 0.0, 0.5),
    ),
    strict=True,
):
    q, v, rows = q_d[0], v_d[0], []
    for k in range(t.size):
        torque = a_d[k] + 40.0 * (v_d[k] - v) + 400.0 * (q_d[k] - q)  # the model's inertia is 1
        a = (torque - viscous * v - coulomb * np.tanh(v / 0.01)) / true_inertia
        rows.append((q_d[k] - q, v, a))
        v += 1e-3 * a
        q += 1e-3 * v
    e, rate, acceleration = np.array(rows[1000:]).T
    across = acceleration if "acceleration" in word else rate
    _ = axis.plot(across, 1e3 * e, ".", ms=1)
    _ = axis.set(title=title, xlabel=word)
_ = axes[0].set_ylabel("error [mrad]")
_ = figure_.suptitle("computed torque with $K_p$ = 400/s², $K_d$ = 40/s", fontsize=10)
plt.show()

# %% [markdown]
# | the logged error follows | likely cause |
# |---|---|
# | the acceleration | inertia |
# | the whole torque | the motor's torque constant (torque per ampere) |
# | the velocity | viscous friction |
# | the rate of the torque (for an inertia the **jerk**, the rate of acceleration) | a late command or measurement |
# | the sign of the velocity | Coulomb friction |
# | the cosine of the angle from the horizontal | gravity |
# | the torque above a certain size | a torque limit |
#
# A payload changes inertia and gravity together. In a single sine, velocity and jerk have the same shape, so use a
# motion of several frequencies. With large accelerations the first two rows look alike, because most of the torque is
# needed for the acceleration. To separate them, hold the arm still against gravity, without an I term. There a wrong
# inertia causes no error, and a wrong torque constant does. (So do a wrong gravity model and static friction.)
#
# <details><summary>Derive: the error equation, and when the slope is the inertia</summary>
#
# Computed torque commands $\tau = \hat J(\ddot q_d + K_d\dot e + K_p e)$, and the joint answers $J\ddot q = \tau$.
# Subtract $\hat J\ddot q$ from both sides: $(J - \hat J)\ddot q = \hat J(\ddot q_d - \ddot q + K_d\dot e + K_p e)$.
# Use $\ddot q_d - \ddot q = \ddot e$ and divide by $\hat J$.
#
# For slow motion only $K_p e$ matters on the left, so the slope of $e$ over $\ddot q$ is $(J/\hat J - 1)/K_p$. At the
# frequency $\omega$ the error is the right side times $1/(K_p - \omega^2 + i\omega K_d)$. It lags, and with a damping
# ratio of $1/\sqrt2$ or more it is smaller.
#
# A torque that is $D$ late lacks $D\dot\tau$, for an inertia $DJ$ times the jerk. A late measurement delays the same
# loop, so the logged error is the same. But the true angle is ahead of the measured one by $D\dot q$. Only a second
# sensor shows this.
#
# </details>

# %%
more_claims("error_follows_acceleration", "acceleration_means_inertia")

# %% [markdown]
# ### Identifying a joint from a log
#
# To correct the model you need the inertia, and $J = \tau/\ddot q$ looks like the obvious formula. But a log contains
# angles. Their second differences contain the noise, multiplied by a number proportional to $1/dt^2$. Least squares
# over the whole log computes $J = \sum\tau\ddot q\,/\sum\ddot q^2$. Noise makes the denominator too large, so $J$ comes
# out too small.
#
# The remedy is to move the derivatives to a function without noise. Choose a smooth **test function** $w(t)$ that is
# zero at both ends of a time window, and flat there. Multiply the equation of motion $J\ddot q + b\dot q = \tau$ by
# $w$, and integrate by parts:
#
# $$J\int \ddot w\,q\,dt - b\int \dot w\,q\,dt = \int w\,\tau\,dt .$$
#
# Each window gives one linear equation for $J$ and $b$, and least squares over many windows gives both. This is one
# window:

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 3, figsize=(9, 2.3), layout="constrained")
u = np.linspace(-1.0, 1.0, 300)
noisy = np.sin(2.0 * u) + 2e-4 * np.random.default_rng(0).standard_normal(u.size)
bump, bend = (1.0 - u**2) ** 3, 6.0 * (1.0 - u**2) * (5.0 * u**2 - 1.0)
second = np.gradient(np.gradient(noisy, u), u)
for axis, title, y in zip(
    axes,
    ("measured angle", "its second difference", r"test function $w$ and $\ddot w$ (dashed)"),
    (noisy, second, bump),
    strict=True,
):
    _ = axis.plot(u, y, lw=1)
    _ = axis.set(title=title, xlabel="time in the window", xticks=[], yticks=[])
_ = axes[2].plot(u, bend / 4.0, "--", lw=1)
plt.show()

# %% [markdown]
# `identify` does this for inertia, viscous and Coulomb friction, and gravity. `diagnose` takes a log and your model,
# and tries the seven causes of the table above, each alone. It names the cause that explains the log best, and those
# that explain it equally well. If two numbers are wrong at once (last case), the named cause leaves far more torque
# unexplained than the noise does:

# %% tags=["show-code"]
t = 2e-3 * np.arange(4000)
wave = 0.9 * np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t + 1.0) + 0.25 * np.sin(5.7 * t + 2.0)
truth = Joint(inertia=0.12, damping=0.15, coulomb=0.10)


def record_log(joint, actuator):
    """Return a log of a joint under PD, with 0.03 mrad of noise on the encoder."""
    gains = Gains(kp=12.0, kd=1.2, tau=5e-3)
    run = run_joint(joint, actuator, Encoder(noise=3e-5), gains, wave, 2e-3, 8.0)
    return control.Log(2e-3, np.append(run.measured, run.q[-1]), run.command)


model = identify(record_log(truth, Actuator())).model
believed = control.JointModel(0.12, 0.15, 0.10)
changes = {
    "20 % more inertia": (replace(truth, inertia=0.144), Actuator()),
    "10 ms of delay": (truth, Actuator(delay=0.01)),
}
changes["both"] = replace(truth, inertia=0.144), Actuator(delay=0.01)
diagnoses = {name: control.diagnose(record_log(*case), believed) for name, case in changes.items()}

# %% tags=["hide-code"]
print(f"inertia           {model.inertia:.4f} kg m^2, true {truth.inertia:.4f}")
print(f"viscous friction  {model.damping:.4f} N m s/rad, true {truth.damping:.4f}")
print(f"Coulomb friction  {model.coulomb:.4f} N m, true 0.1000")
for name, one in diagnoses.items():
    unexplained = 1e3 * min(one.remaining.values())
    print(f"real change: {name:<18} named: {', '.join(one.causes)}, leaves {unexplained:.2f} mN m")

# %% [markdown]
# Here is the relative error of the inertia under little and much noise, for the equation with test functions (*integral
# form*, windows of 0.3 s), for one low-pass filter on all terms, and for raw second differences. The filter needs the
# right cut-off frequency:

# %% tags=["hide-code"]
print_figures("what_a_log_tells", "integral form", "all terms filtered", "second differences")

# %% [markdown]
# <details><summary>Noise, filters and causes, measured</summary>
#
# The chart varies the noise. On the left (relative error of the inertia), raw second differences (orange) are always
# wrong, and the integral form (blue) stays accurate. One low-pass filter for all terms works, too (green, 10 Hz), but
# with the wrong cut-off frequency it lets the noise pass (pink, 40 Hz). The right chart shows how often the true
# cause, and no other, is named. (*Constant* is the torque constant, *damping* is viscous friction.) Only Coulomb
# friction (green) is often missed, under the largest noise. (Bands: from the best to the worst of eight joints.)
#
# ![Inertia out of a log, and which cause is named](../docs/charts/what_a_log_tells.png)
#
# </details>

# %%
more_claims("inertia_by_differences")

# %% [markdown]
# ### Optimal control: LQR and the Riccati equation
#
# The **LQR** (linear quadratic regulator) computes the gains from a cost that you choose. For a sampled system
# $x_{k+1} = A x_k + B u_k$ the LQR minimises the sum of $x^\mathsf{T}Qx + u^\mathsf{T}Ru$ over all samples. The
# matrix $Q$ weights deviations of the state $x$, and $R$ weights the effort of the command $u$.
#
# The cost from the state $x$ onwards, under the best commands, is $x^\mathsf{T}Px$ with some matrix $P$. The best
# command minimises its own cost plus that of the next state. This gives
#
# $$u = -Kx,\qquad K = (R + B^\mathsf{T}PB)^{-1}B^\mathsf{T}PA,\qquad P = Q + A^\mathsf{T}P\,(A - BK) .$$
#
# The last equation is the **Riccati equation**. If commands can bring every motion to rest, you can solve it by
# repetition: start with $P = Q$, compute $K$, then the next $P$.
#
# <details><summary>Derive: the gain and the Riccati equation</summary>
#
# The next state $Ax + Bu$ costs $(Ax + Bu)^\mathsf{T}P\,(Ax + Bu)$, and the command costs $u^\mathsf{T}Ru$. (The term
# $x^\mathsf{T}Qx$ does not depend on $u$.) Half of the derivative of this sum is $B^\mathsf{T}P\,(Ax + Bu) + Ru$. It is
# zero at $u = -Kx$. With this command, the three terms together must be $x^\mathsf{T}Px$ again. This simplifies to the
# Riccati equation.
#
# </details>
#
# **Worked example:** one state with $A = B = Q = 1$ and $R = 2$. Then $K = P/(2 + P)$ and $P = 1 + P(1 - K)$. The
# solution is $P = 2$ and $K = 1/2$: every command halves the state.
#
# ### Model predictive control: torque limits in the plan
#
# LQR ignores the torque limit. You can clip its command. But after a start far from the target, LQR expects a stronger
# brake than the motor has, so it brakes too late. **Model predictive control** (MPC) computes a whole plan at every
# sample: the commands for the next $N$ samples, within the limits. $N$ is the **horizon**. The plan minimises the cost
# of these samples plus $x^\mathsf{T}Px$ of the last state, the cost of everything after it if no limit is reached
# later.
#
# With a linear model this is a **quadratic program**: a quadratic cost with linear equations and limits. Only the first
# command of the plan is used; the next sample computes a new plan. Here is a mass of 1 kg that starts 4 m from its
# target, with a motor of at most 1 N:

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 2, figsize=(9, 2.8), layout="constrained")
h = 0.1
mass_A, mass_B = np.array([[1.0, h], [0.0, 1.0]]), np.array([[h * h / 2.0], [h]])
weights = np.diag([1.0, 0.1]), 0.1 * np.eye(1)
regulator, ahead = (
    control.lqr(mass_A, mass_B, *weights),
    control.horizon(mass_A, mass_B, *weights, 40),
)
paths = {}
for name in ("clipped LQR", "MPC"):
    x, last, path = np.array([-4.0, 0.0]), None, []
    for k in range(120):
        if name == "MPC":
            last = control.mpc(ahead, x, 1.0, last)
            u = last[0]
            if k in (0, 15):
                foreseen = [x]
                for command in last:
                    foreseen.append(mass_A @ foreseen[-1] + mass_B @ command)
                after = h * (k + np.arange(41))
                _ = axes[0].plot(after[::4], np.array(foreseen)[::4, 0], "kx", ms=4)
        else:
            u = np.clip(-regulator.K @ x, -1.0, 1.0)
        path.append((x[0], u[0]))
        x = mass_A @ x + mass_B @ u
    paths[name] = np.array(path)
    label = f"{name}, overshoot {paths[name][:, 0].max():.2f} m"
    _ = axes[0].plot(h * np.arange(120), paths[name][:, 0], lw=1.5, label=label)
    _ = axes[1].step(h * np.arange(120), paths[name][:, 1], where="post", lw=1.2, label=name)
_ = axes[0].axhline(0.0, color="0.4", ls="--", lw=1)
_ = axes[0].set(xlabel="time [s]", ylabel="position [m]", title="crosses: the plans at 0 and 1.5 s")
_ = axes[1].set(xlabel="time [s]", ylabel="command [N]", title="command, limited to 1 N")
_ = axes[0].legend(fontsize=9)
plt.show()

# %% [markdown]
# MPC plans 4 s ahead. The mass moves along its plans (crosses), because they contain the limit. MPC brakes fully one
# to two samples of 0.1 s earlier than clipped LQR, so it overshoots less.
#
# <details><summary>What MPC saves, and what it costs</summary>
#
# The left chart shows the cost of clipped LQR, divided by that of MPC, against the distance at the start. At short
# distances, MPC saves nothing: because of the term $x^\mathsf{T}Px$, both agree for this mass if the command is never
# at a limit, or only in one stretch from the start. Beyond the dotted line, the command reaches first one limit, to
# speed up, then the other, to brake. There MPC saves more, up to a bound that grows with the horizon.
#
# The right chart shows the computing time; a sample is 0.05 s. A **warm start** begins the search at the previous
# plan, a **cold start** at zero:
#
# ![What MPC saves compared with a clipped regulator, and its time](../docs/charts/mpc_where.png)
#
# </details>

# %%
more_claims("mpc_beats_clipping")

# %% [markdown]
# ### MPPI: plans from sampled rollouts
#
# For some tasks a linear model or a gradient helps little, for example if a hand makes and breaks contact. **MPPI**
# (model predictive path integral control, Williams and others 2017) needs only a simulator and a cost. At every sample
# it does three things:
#
# 1. Make $n$ copies of the current plan, add random noise to each, and simulate them. A simulated plan is called a
#    **rollout**.
# 2. Give each rollout the weight $w_k = e^{-(S_k - S_{\min})/\lambda}$, where $S_k$ is its cost and $S_{\min}$ the
#    lowest one. With a small temperature $\lambda$, nearly all the weight is on the best rollout. With a large one,
#    all rollouts count nearly the same.
# 3. The new plan is the weighted mean of the tried plans. Send its first command. Shift the rest forward by one sample:
#    it is the current plan of the next sample.
#
# Here is one sample, for a mass of 1 kg. The cost is the sum of the squared distances from the target, plus a little
# for force. So rollouts that approach fast have the largest weights, and their mean goes beyond the target at the end:

# %% tags=["hide-code"]
rng = np.random.default_rng(4)
tries = np.repeat(0.8 * rng.standard_normal((80, 5)), 4, axis=1)
speeds = np.cumsum(h * tries, axis=1)
places = np.cumsum(h * speeds, axis=1)
S = h * ((places - 1.0) ** 2 + 0.02 * tries**2).sum(axis=1)
share = np.exp(-(S - S.min()) / 0.1)
share /= share.sum()
figure_, axis = plt.subplots(figsize=(7, 2.8), layout="constrained")
for path, part in sorted(zip(places, share, strict=True), key=lambda row: row[1]):
    ink = plt.get_cmap("viridis_r")(part / share.max())
    _ = axis.plot(h * np.arange(1, 21), path, lw=0.8, color=ink)
_ = axis.plot(h * np.arange(1, 21), share @ places, "k", lw=1.5, label="weighted mean")
_ = axis.axhline(1.0, color="C1", ls="--", lw=1, label="target")
_ = axis.set(
    xlabel="time ahead [s]",
    ylabel="position [m]",
    title="80 rollouts; dark: large weight, yellow: small weight",
)
_ = axis.legend(fontsize=9, loc="upper left")
plt.show()

# %% [markdown]
# The motor of the next pendulum is too weak to lift it directly: it delivers at most a third of the torque that would
# hold the pendulum level. The pendulum has to swing back and forth first. The cost contains nothing for the time after
# the horizon, so the horizon must be long enough to show that swinging is worth its cost. A sample is 0.1 s, a small
# swing back and forth takes 2 s. The bands are 95 % confidence intervals from 20 runs per point:
#
# ![How often MPPI swings a weak pendulum up](../docs/charts/swing_up.png)
#
# With a horizon of 20 samples (one swing), nearly all runs with 8 rollouts succeed (upright and slow after 7 s). With a
# horizon of 8 samples no run succeeds, even with 64 rollouts: in 0.8 s, swinging away from the target only costs.

# %%
more_claims("samples_find_the_plan")

# %% [markdown]
# ## 3 · Concept: contact
#
# ### Impedance control and admittance control
#
# A stiff position controller whose set-point lies inside a wall presses hard, and with an I term harder and harder.
# In contact you want to choose how far the arm yields. **Impedance control** (Hogan 1985) makes the arm behave like a
# mass on a spring and a damper:
#
# $$\boxed{\;F = M\,\ddot x + B\,\dot x + K\,(x - x_0)\;}$$
#
# You choose the virtual mass $M$, the damping $B$, the stiffness $K$ and the set-point $x_0$, here along one axis.
# $F$ is the *external* force with which somebody moves the hand along the path $x(t)$. If $M$ is the arm's own mass,
# the arm has no friction and gravity is compensated, the command is $-B\dot x-K(x-x_0)$.


# %% tags=["hide-code"]
def spring(axis, start, end, height, ink="0.3"):
    """Draw a spring as a zigzag."""
    along = np.linspace(start, end, 16)
    up = height + 0.12 * np.array([0, 0, 0, *([1, -1] * 5), 0, 0, 0])
    axis.plot(along, up, color=ink, lw=1.2)


figure_, axes = plt.subplots(1, 2, figsize=(9, 2.1), layout="constrained")
left, right = axes
spring(left, 0.0, 2.0, 0.35)
_ = left.plot([0.0, 0.9, 0.9, 0.9], [-0.35, -0.35, -0.5, -0.2], color="0.3")
_ = left.plot([0.7, 1.15, 1.15, 0.7], [-0.55, -0.55, -0.15, -0.15], color="0.3")
_ = left.plot([1.15, 2.0], [-0.35, -0.35], color="0.3")
_ = left.plot([0.0, 0.0], [-0.8, 0.8], color="0.3", lw=3)
left.add_patch(plt.Rectangle((2.0, -0.7), 1.0, 1.4, fc="#cfe3f2", ec="0.3"))
_ = left.annotate(
    "", (4.1, 0.0), (3.1, 0.0), arrowprops={"arrowstyle": "-|>", "color": "C1", "lw": 2}
)
for x, y, text in ((2.5, 0, "M"), (1.0, 0.6, "K"), (1.0, -0.95, "B"), (3.9, 0.2, "external F")):
    _ = left.text(x, y, text, ha="center")
_ = left.annotate("", (3.3, -0.95), (2.3, -0.95), arrowprops={"arrowstyle": "->", "color": "0.3"})
_ = left.text(3.45, -0.95, "x", ha="center", va="center")
_ = left.set_title("what the arm behaves like", fontsize=10)
right.add_patch(plt.Rectangle((1.2, -0.8), 2.9, 1.6, fc="#ece8e0"))
spring(right, 1.2, 3.0, 0.35, "C0")
spring(right, 1.2, 4.1, -0.35, "C1")
_ = right.plot([0.6, 0.6], [-0.8, 0.8], color="0.3", ls="--", lw=1)
_ = right.plot([1.2, 1.2], [-0.6, 0.6], color="k", lw=4)
_ = right.plot([3.0, 3.0], [0.1, 0.6], color="C0", lw=3)
_ = right.plot([4.1, 4.1], [-0.8, 0.8], color="0.3", lw=3)
for x, y, text in (
    (0.5, -1.05, "surface, untouched"),
    (1.2, 0.88, "hand"),
    (2.1, 0.6, "controller K"),
    (3.1, 0.65, "set-point"),
    (2.7, -0.72, "wall $k_e$"),
):
    _ = right.text(x, y, text, ha="center", fontsize=9)
_ = right.set_title("in contact: one force runs through both springs", fontsize=10)
for axis in axes:
    _ = axis.set(xlim=(-0.5, 4.6), ylim=(-1.1, 1.0))
    _ = axis.axis("off")
plt.show()

# %% [markdown]
# **Admittance control** reverses the direction. It *measures* the contact force, computes how a virtual mass on a
# spring and a damper would move under it, and sends that motion to a stiff position loop. Impedance control suits
# torque-controlled joints with little friction. Admittance control suits arms with high gear ratios: the position loop
# overcomes their friction.
#
# Choose the controller, and drag the set-point into the wall. The orange arrow is the force of the wall on the hand:

# %%
simulation("probe")

# %% [markdown]
# With a set-point inside the wall, and without dry friction or a torque limit, the hand comes to rest where the
# controller's spring and the wall push equally hard. The same force runs through both springs, and their deflections
# add up to the depth of the set-point. **Worked example:** both have 1000 N/m, and the set-point is 10 mm deep. Each
# spring yields by 5 mm, so the force is 5 N.
#
# Now push the hand a little away from its position of rest. Both springs push it back. So for a vibration the
# stiffness is the sum $K + k_e$, where $k_e$ is that of the wall.

# %%
show("wall_in_series")

# %%
more_claims("impedance_sign", "impedance_holds_a_force")

# %% [markdown]
# ### Stability at a wall: passivity, force gain, virtual mass
#
# How stiff may the controller's spring be? With a delay, it pushes back a little too late: too weak while the hand
# moves in, too strong while it moves out. Over a whole oscillation it returns more energy than it took. The arm's own
# friction $b$ (here along a line, in N s/m) takes energy out. A controlled arm that never returns more energy than it
# has received is **passive**. By the theorem of **passivity**, two passive systems that are joined together cannot
# build up a motion, and come to rest if one of them loses energy in every motion. So a passive arm is stable at every
# passive wall.
#
# For a pure spring with the delay $D$, the condition for passivity (Colgate and Schenkel 1997) is
#
# $$K < \frac{b}{D + \tfrac12 dt}\, .$$
#
# **Worked example:** $b$ = 20 N s/m at 1 kHz allows $20/0.0005$ = 40,000 N/m. With a delay of 2 ms it is $20/0.0025$
# = 8,000 N/m.

# %%
show("damping_is_safe")

# %% [markdown]
# Proportional **force control** commands the desired force plus a gain $g$ (not gravity) times the force error. The
# wall turns motion into force, so its stiffness multiplies the loop gain. Let the controller add no damping, and the
# delay be short compared with the period of the hand on the wall. Then the limit is $g < b/(k_e\,(D + \tfrac12 dt))$: a
# stiffer wall allows less gain.
#
# In admittance control, the position loop has to follow the virtual mass. At a stiff wall, a light virtual mass would
# vibrate faster than this loop can follow. So a stiffer wall needs more virtual mass or damping.
#
# The charts are for an arm of 4 kg with $b$ = 20 N s/m at 1 kHz, and the controllers know the exact rate. The upper
# left one has 2 ms of delay. In the lower one, the hold is the only delay, the position loop has 40 kN/m and 800 N s/m,
# and there is no virtual spring. The virtual damping is the value critical on a wall of 100 N/m. On stiffer walls it is
# weak, so the mass has to rise to nearly the arm's own:
#
# ![Stability limits at a wall: force, impedance and admittance](../docs/charts/touching.png)
#
# In the upper right chart, *own friction* means that the controller adds no damping. *Best active damping* is what
# allows the most stiffness. (A rate from differences allows less, and so does a real arm, which bends.) Curves above
# the limit of passivity are valid only for walls that are pure springs: some other passive wall makes the arm unstable.
#
# The upper left chart also shows MuJoCo. With a spring as the wall (crosses), the limit is right. Its soft contact is
# set so that a resting hand sinks in as deep as into this spring. But a share $d$ of a change in the command appears in
# the measured force before the hand moves. With $d$ = 0.9 (green), the contact rejects gains that are fine at soft
# walls, and accepts far too high ones at stiff walls. With $d$ = 0.02 (orange), the limit is nearly the wall's.
#
# <details><summary>Why the limit of a soft contact is different</summary>
#
# The force loop feeds the share $d$ back with the factor $-g\,d$, so above $g = 1/d$ the loop is unstable even at soft
# walls. Only the rest of the force moves the hand, as if it were $1/(1 - d)$ times as heavy. With $d$ = 0.9 that is ten
# times, so at stiff walls the loop through the wall is too weak. (By default, `solimp` lets $d$ rise from 0.9 to 0.95
# with the depth.)
#
# </details>

# %%
more_claims("stiffness_depends_on_the_wall", "force_gain_is_free", "admittance_is_light")

# %% [markdown]
# ### The first impact

# %%
predict("softer_hand")

# %% [markdown]
# Energy explains the answer. Let $m$ be the mass that the surface feels at the hand, in this pose and direction. Behind
# rigid gears it contains the rotors, too, with the square of the gear ratio.
#
# This mass arrives with the energy $\tfrac12 m v^2$. Without damping, all of it is in the compressed surface at the
# peak, $F^2/(2k_e)$. So the peak is
#
# $$F_{\max} = v\,\sqrt{m\,k_e}\, ,$$
#
# and the controller's stiffness does not appear, as long as it is much lower than that of the surface. **Worked
# example:** 4 kg at 0.5 m/s against 100,000 N/m gives $0.5\cdot\sqrt{400{,}000}$ = 316 N. The picture shows this impact
# for a stiff and a soft controller with little damping, with the set-point of the question. Some damping of the surface
# lowers the peak below 316 N:

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 2, figsize=(9, 2.6), layout="constrained")
aim = np.minimum(0.5e-3 * np.arange(12_000), 0.02)
for k, ls in ((2000.0, "-"), (20.0, "--")):
    hand = Probe(4.0, 0.0, 1e5, 200.0)
    law = TouchLaw(k, 0.2 * math.sqrt(k * 4.0))
    force = run_touch(hand, law, aim, 1e-3, 12.0, start=(0.0, 0.5)).torque
    _ = axes[0].plot(np.arange(30), force[:30], "." + ls, ms=4, label=f"{k:.0f} N/m")
    _ = axes[1].plot(1e-3 * np.arange(force.size), force, ls, lw=1, label=f"{k:.0f} N/m")
_ = axes[0].set(
    xlabel="time since contact [ms]", ylabel="force [N]", title="first impact, at 1 kHz"
)
_ = axes[1].set(
    xlabel="time [s]", ylim=(0.0, 80.0), title="afterwards: bounces, then the held force"
)
_ = axes[0].legend(fontsize=9, title="controller")
plt.show()

# %% [markdown]
# So if the controller is already much softer than what the arm hits, and the set-point moves in with the hand, an even
# softer one hardly changes the first peak. It lowers the force with which the arm presses afterwards. Against the first
# peak, reduce the speed or the mass $m$, or pad the hand; against the bounces (right), add damping.

# %%
more_claims("stiff_control_hurts")

# %% [markdown]
# ### Hybrid control: which axis gets the force?
#
# A hand has to wipe a table. Along some directions you control force, along the others position. To decide, ask what
# the table itself fixes. While the hand presses on it, a rigid, frictionless table allows no velocity along its normal,
# and it gives no force along its tangents. Mason (1981) calls such a fixed velocity or force a **natural constraint**.
# You can control only what the table does not fix.

# %%
show("axes_of_a_surface")

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(6, 2.4), layout="constrained")
tilt = np.radians(20.0)
normal, tangent = np.array([-np.sin(tilt), np.cos(tilt)]), np.array([np.cos(tilt), np.sin(tilt)])
ends = np.array([-2.0 * tangent, 2.0 * tangent])
_ = axis.plot(*ends.T, color="0.3", lw=3)
_ = axis.fill(*np.array([*ends, ends[1] - 0.5 * normal, ends[0] - 0.5 * normal]).T, color="#d9d4ca")
for end, ink, text, offset in (
    (1.2 * normal, "C1", "normal: control force\n(the table fixes the velocity, 0)", (-0.25, 0.0)),
    (
        1.2 * tangent,
        "C0",
        "tangent: control position\n(the table fixes the force, 0)",
        (1.15, -0.35),
    ),
):
    _ = axis.annotate(
        "", end, (0.0, 0.0), arrowprops={"arrowstyle": "-|>", "color": ink, "lw": 2.5}
    )
    side = "right" if offset[0] < 0 else "left"
    _ = axis.text(*(end + offset), text, color=ink, fontsize=9, ha=side, va="center")
_ = axis.plot(0.0, 0.0, "ko")
_ = axis.set(xlim=(-4.2, 5.4), ylim=(-1.3, 1.9), aspect="equal")
_ = axis.axis("off")
plt.show()

# %% [markdown]
# **Hybrid control** (Raibert and Craig 1981) controls the force along the normal and the position along the tangents.
# Let $R$ be the rotation from the frame of the surface to the world. Rotate the errors into this frame with
# $R^\mathsf{T}$. Along each axis, compute a force from the force error or the position error. Rotate the force back
# with $R$, and map it to joint torques with $\tau = J^\mathsf{T}F$, where $J$ is now the Jacobian.
#
# <details><summary>Derive: why it can't be the other way round</summary>
#
# While the hand presses on a rigid surface, its velocity along the normal is $v_n = 0$, and the force $f_n$ is free.
# Without friction, the forces along the tangents are $f_t = 0$, and the velocities $v_t$ are free. So in each
# direction $f_i v_i = 0$: the surface neither takes nor gives power. If you command a position along the normal, a
# surface of stiffness $k_e$ turns your position error into the force $k_e$ times that error. If you command a force
# along a tangent, there is nothing to push against, and the hand accelerates.
#
# </details>
#
# <details><summary>The equation of motion of the hand</summary>
#
# **Operational space** control (Khatib 1987) writes the equation of motion for the hand instead of the joints. The
# hand's inertia is $\Lambda = (JM^{-1}J^\mathsf{T})^{-1}$ (not the gain of section 2). An arm with more joints than
# the task needs can move without moving the hand. The projector $N = I - J^\mathsf{T}\Lambda J M^{-1}$ removes from
# any torques $\tau$ the part that accelerates the hand. Such a projector is called **dynamically consistent**. Check:
# torques $\tau$ accelerate the hand by $J M^{-1}\tau$, and $J M^{-1} N = 0$.
#
# </details>
#
# ## 4 · Design: contact regimes and loop rates
#
# A contact task has three phases: free space, approach and contact. The table compares a usual controller of each
# phase at the same wall of 10 kN/m, on a hand of 4 kg with a delay of 2 ms. *Lowest rate* is the lowest sample rate at
# which the controller is stable in contact with this wall.
#
# For *first peak* the hand starts 20 mm before the wall at 0.1 m/s. The set-points of the stiff and the soft controller
# move at this speed to 20 mm inside the wall. The force controller commands 10 N plus the gain times the force error.
# The damping acts on the hand's velocity, so the hands arrive at different speeds. *Surface 2 mm off* is the change of
# the steady force when the surface is 2 mm nearer than expected.

# %% tags=["hide-code"]
lines = [
    "| regime | controller | damping [N s/m] | use | lowest rate | speed at the wall | first peak | "
    "at rest | surface 2 mm off |",
    "|---|" + "---|" * 8,
]
touch_dt, touch_start = touch.DT, (-0.02, touch.SPEED)
inwards = np.minimum(touch.SPEED * touch_dt * np.arange(800) - 0.02, 0.02)
at_wall = replace(touch.ARM, wall=touch.WALL)
for regime, name, use in (
    ("free space", "stiff position", "motion between waypoints"),
    ("approach", "soft impedance", "slow approach"),
    ("contact", "force", "pushing, insertion, wiping"),
):
    result, stiffness = touch.row(name), touch.REGIMES[name].stiffness
    spring_ = f", {stiffness:.0f} N/m" if stiffness else ""
    if gain := touch.REGIMES[name].force_gain:
        spring_ = f", gain {gain:g}"
    rest = touch.REGIMES[name].force or touch.series_stiffness(touch.REGIMES[name], 0.02)
    run = run_touch(
        at_wall, touch.REGIMES[name], inwards, touch_dt, 0.8, delay=touch.DELAY, start=touch_start
    )
    arrival = run.v[int(np.argmax(run.torque > 0.0)) - 1]
    lines.append(
        f"| {regime} | {name}{spring_} | {touch.REGIMES[name].damping:.0f} | {use} | {result['rate_hz']:.0f} Hz | "
        f"{arrival:.2f} m/s | {result['peak_n']:.0f} N | {rest:.0f} N | {result['off_n']:+.1f} N |"
    )
bare = touch.first_peak(replace(touch.PRESS, damping=0.0))
lines.append(
    f"\nThe hand has its own friction of {touch.ARM.damping:.0f} N s/m. Without the damping of "
    f"{touch.PRESS.damping:.0f} N s/m, the force controller would speed the hand up before the wall, and "
    f"the first peak would be {bare:.0f} N."
)
Markdown("\n".join(lines))

# %% [markdown]
# The first peak of the stiff controller is its steady pressing (*at rest*), not the impact. A hand that coasts into the
# wall at 0.1 m/s has a peak of $v\sqrt{m k_e}$ = 20 N.
#
# <details><summary>The first peak against the stiffness of the controller</summary>
#
# This chart has no damping, so the first peak is the impact. It hardly changes as long as the controller is softer
# than the wall. A stiffer controller (last point of each curve) pushes the hand on into the wall.
#
# ![First peak of the force against the stiffness of the controller](../docs/charts/contact_regimes.png)
#
# </details>
#
# A robot runs several loops inside each other, a **cascade**. You design the outer loop as if the inner one responded
# at once. So the inner loop needs several times the bandwidth of the outer one, not necessarily a higher sample rate.
# If both are of first order, four times is just enough to avoid overshoot. Typical sample rates:

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(8, 2.6), layout="constrained")
levels = (
    ("planner", "some Hz", "path"),
    ("task or force", "camera 30 to 100 Hz, force 100 Hz to 1 kHz", "pose, contact force"),
    ("impedance or position", "1 kHz", "joint angles"),
    ("joint torque or velocity", "several kHz", "torque sensor, encoder"),
    ("motor current", "tens of kHz", "current"),
)
for k, (name, rate, signal) in enumerate(levels):
    shade = plt.get_cmap("Blues")(0.05 + 0.1 * k)
    axis.add_patch(
        plt.Rectangle((1.1 * k, -2.6 + 0.45 * k), 10.0 - 1.1 * k, 5.2 - 0.9 * k, fc=shade, ec="0.3")
    )
    _ = axis.text(
        1.1 * k + 0.12, 2.6 - 0.45 * k - 0.12, f"{name} ({signal}): {rate}", va="top", fontsize=9
    )
_ = axis.set(xlim=(-0.1, 10.1), ylim=(-2.7, 2.7))
_ = axis.axis("off")
plt.show()

# %% [markdown]
# <details><summary>Derive: how much faster the inner loop must be</summary>
#
# Let an inner velocity loop follow its command $\dot q_c$ as $\ddot q = \omega_i(\dot q_c - \dot q)$, and let the
# outer loop command $\dot q_c = \omega_o e$. For a constant set-point, $\ddot q + \omega_i\dot q +
# \omega_i\omega_o\,q = \omega_i\omega_o\,q_d$. The damping ratio is $\tfrac12\sqrt{\omega_i/\omega_o}$: 1 if the
# inner loop is four times as fast, and only 0.5 if both are equally fast.
#
# </details>
#
# ### Around PID: feed-forward, observer, predictor, notch
#
# Four blocks extend the loop of one joint:
#
# * A **feed-forward** adds the torque that the planned motion needs (section 2). Computed from the plan alone, it
#   cannot make the loop unstable.
# * A **disturbance observer** solves the joint's equation for the load torque, filters the result, and subtracts it
#   from the command.
# * A **Smith predictor**, in the form used here, computes with a model the state that the joint will have when the
#   command arrives. PD works with this state. If the true delay is longer than the model's by $\Delta D$, a sine of
#   frequency $\omega$ has an extra phase lag $\omega\,\Delta D$, which is large at high frequencies.
# * A **notch filter** removes the frequency of a resonance from the command.

# %%
predict("delay_predicted")

# %% [markdown]
# In the charts below, all loops drive the joint with 10 ms of delay. The left chart shows the error on a planned
# motion; all loops except *PD* have a feed-forward of 90 % of the true torque. The right chart shows the error after a
# load step of 1 N m. Along each curve the poles get faster, up to the last stable ones, and the torque noise grows.
#
# The *cascade* is a velocity loop with an I term inside a position loop. The *observer with delay* has the delay in its
# model. *Half the delay* predicts only 5 of the 10 ms.
#
# Compare the errors at equal noise. The predictors are no better than PD with the same feed-forward: their model does
# not know the missing 10 %, or the load step. The cascade has the smallest error; on the right, the observer without
# the delay in its model is as good. The observer with delay stays stable with faster poles, where it reaches a smaller
# error at more noise:
#
# ![Tracking error and error after a load step, against torque noise](../docs/charts/loop_structures.png)
#
# <details><summary>Derive: what each block is, and where it ends</summary>
#
# **Cascade.** Let the outer loop ask for the speed $k(q_d - q)$, and let a PI controller with gains $k_v$ and $k_i$
# follow it. The integral of the measured rate is the angle, so the torque is that of PID with $K_p = k_v k + k_i$,
# $K_i = k_i k$ and $K_d = k_v$. Only the share $k_v k/K_p$ of the set-point enters the P term. Its zeros are $-k$ and
# $-k_i/k_v$, so a PID controller is a cascade only if $K_p^2 \ge 4 K_i K_d$. What the cascade adds are limits: one on
# the speed and one on the torque.
#
# **Disturbance observer.** With a filter of first order, $\hat d = \frac{g}{s+g}(J\ddot q + b\dot q - u)$. Insert
# $u = u_c - \hat d$: then $s\,\hat d = g\,(J\ddot q + b\dot q - u_c)$. So $-\hat d$ is $g$ times the integral of
# $u_c - b\dot q$, minus $gJ\dot q$. With PD as $u_c$ this is a PID controller again, and a constant load leaves no
# error. The extra damping $gJ$ is late by the delay, so $g$ has a limit. If the observer delays $u$ as the drive
# does, only an error of the model limits $g$.
#
# **Smith predictor.** The command is $-K\hat x$, and $\hat x$ is the state carried over the commands under way. If
# delay and model are exact, $\hat x$ is the state at which the command acts. The eigenvalues of the loop are then those
# of $A - BK$ and zeros. The model does not know a load, so an error remains under it. Smith's original
# block diagram runs the model beside the plant. For a joint, which integrates, this leaves an eigenvalue at 1.
#
# **Notch.** Its gain is smallest at the resonance. It lags below its frequency and leads above it. Tuned more than a
# few per cent too high, it does harm: it adds lag exactly where the elastic joint has its largest gain:
#
# ![Delay error that a predictor stands, and frequency error of a notch](../docs/charts/structure_limits.png)
#
# </details>

# %%
more_claims(
    "smith_removes_the_delay",
    "cascade_beats_pid",
    "observer_as_fast_as_possible",
    "notch_can_only_help",
)

# %% [markdown]
# <div class="alert alert-block alert-success">
#
# **Interview tip.** *The control hierarchy.* Draw the picture's five levels, and say what sets each rate. Current: the
# motor's electrical time constant. Torque or velocity: the bandwidth of the loop around it. Impedance or position: the
# stiffness that the task needs, and the delay that it allows. Task or force: the camera's frame rate, or the contact
# stiffness. Planner: its computing time.
#
# <details><summary>"PID inside at 1 kHz, impedance around it at 1 kHz"</summary>
#
# You will read such pairs of rates. A sample rate does not say which loop is faster; the bandwidth does. At one
# sample rate, an inner loop with ten times the bandwidth of the outer one is an ordinary cascade. If the bandwidths
# are close, both are one loop and have to be analysed as one. Impedance control on torque-controlled joints has no
# inner position PID at all. What you can check is a loop with stated rate, delay and gains: its matrix gives the
# margins.
#
# </details>
#
# </div>
#
# ## 5 · Code, and the simulation in full
#
# The first listing builds the matrix of the closed loop. The state contains the `n` states of the **plant** (the
# controlled joint), the commands that wait in the delay (`waiting` of them, newest first), and the `m` states of the
# controller `A`, `B`, `C`, `D`. A command may arrive in the middle of a sample: `before` is the effect of the old
# command on the plant, `now` that of the new one. `whole` counts whole samples of delay. `fed` is where this sample's
# command goes: into the queue, into the joint, or both:

# %% tags=["hide-code"]
source(sampled._closed, "n, waiting, m")

# %% [markdown]
# The next listing is one sample of a PID controller. Lines before it compute the filtered rate `state[1]` from the
# measurement `y`. These lines limit the torque and its change per second (`slew`). `windup` is 1 for back-calculation
# with the time constant `tracking`, 2 for no anti-windup. `weight` multiplies the set-point in the P term:

# %% tags=["hide-code"]
source(control.pid._update, "error = setpoint - y")

# %% [markdown]
# In computed torque with half-sample preview, the caller passes the reference for the middle of the sample. The
# function extrapolates the measured state to the same instant. `pd` returns the PD terms. `needed` is inverse dynamics:
# the torque that the model needs for a desired acceleration:

# %% tags=["hide-code"]
source(control.computed_torque, "half = 0.5")

# %% [markdown]
# The last one is the central part of MPPI. Lines before it made the noisy plans `tries`; `_costs` simulates them:

# %% tags=["hide-code"]
source(control.mppi, "cost = _costs")

# %% [markdown]
# Here is the first simulation, with the preset *Hunting*: lower *Static / Coulomb* to one, and the hunting ends.

# %%
simulation("joint", "Hunting")

# %% [markdown]
# <details><summary>Four questions on other presets</summary>
#
# 1. *P past its limit*: the motor has a torque limit. Does the oscillation grow for ever? No: it reaches a constant
#    amplitude, because the torque limit bounds it. This looks like the ultimate gain but isn't.
# 2. *PD at its limit*: should you lengthen or shorten the sample time? Shorten it: the largest $K_d$ is proportional to
#    $J/dt$.
# 3. *A weak motor*: do the margins warn you? No. They describe the linear loop; while the motor is at its limit, that
#    loop is open.
# 4. *Z-N, PID*: which gain do you change first? Raise $K_d$. It adds phase where the loop crosses the gain 1.
#
# </details>
#
# ## 6 · Speed against accuracy
#
# ### Which controller for which error
#
# A two-link arm with a payload of 0.5 kg follows one motion. The *right* model knows payload and friction, the *wrong*
# model knows neither. The upper charts show the largest tracking error in the last 2 s against the sample rate. In the
# upper right one, computed torque and half-sample preview coincide, and the purple triangles at the top are errors of
# MPPI that are too large for the chart. (Each point of MPPI is one random run.)
#
# LQR, MPC and MPPI correct the deviation from the planned motion. *LQR along the path* linearises the model at every
# sample of this motion, so it has one gain matrix per sample. MPC meets no limit, so its errors are LQR's.
#
# In the lower chart, only MPPI at 1 kHz computes for longer than the motion lasts (dotted line). Do not rank the others
# by time: here, only preview is compiled as a whole. (*Pinocchio* and *MuJoCo* are preview with these libraries, called
# from Python at every sample.)
#
# ![Tracking error against samples per second, and against computing time](../docs/charts/tracking_laws.png)

# %% tags=["hide-code"]
right, wrong = stored("tracking_laws")[:2]
timed = dict(re.findall(r"^(\S.*?) {2,}(\d+\.\d) us a sample", read("tracking_laws"), re.M))
lines = [
    "| controller at 1 kHz | elbow stiffness, right / wrong model [N m/rad] | "
    "largest error, right model [mrad] | wrong model [mrad] | time per sample [µs] |",
    "|---|---|---|---|---|",
]
models = tracking.ARM, tracking.WRONG
soft = " / ".join(f"{tracking.springs(m, tracking.KP, tracking.KD)[0][1]:.0f}" for m in models)
along = " / ".join(
    f"{np.mean([K[1, 1] for K in tracking.PathLQR(m, 1e-3).gains]):.0f}" for m in models
)
adapt_k = f"{tracking.SLOPE * tracking.ADAPTIVE_DAMP[1]:.0f}"
for name, stiffness, loop_ in (
    ("PD + gravity", f"{tracking.STIFF[1]:.0f}", "compiled"),
    ("computed torque", soft, "compiled"),
    ("half-sample preview", soft, "compiled"),
    ("LQR along the path", along, "Python"),
    ("adaptive law", adapt_k, "Python"),
):
    lines.append(
        f"| {name} | {stiffness} | {1e3 * right[name].y[-1]:.3g} | "
        f"{1e3 * wrong[name].y[-1]:.3g} | {timed[name]}, {loop_} |"
    )
    if name == "PD + gravity":
        for words, equal in (("", False), (", as stiff as computed torque", True)):
            ahead = []
            for model in (tracking.ARM, tracking.WRONG):
                gains = (tracking.STIFF, tracking.DAMP)
                if equal:
                    gains = tracking.springs(model, tracking.KP, tracking.KD)
                ahead.append(1e3 * tracking.error(JointLaw("feedforward", model, *gains), 1e-3))
            lines.append(
                f"| PD + feed-forward{words} | {soft if equal else round(tracking.STIFF[1])} | "
                f"{ahead[0]:.3g} | {ahead[1]:.3g} | not timed |"
            )
# A rate of 1e-9 switches the adaptation off.
not_adapted = [
    1e3 * tracking.error(tracking.adaptive(model, 1e-3, rate=1e-9), 1e-3)
    for model in (tracking.ARM, tracking.WRONG)
]
lines.append(
    f"| the same law, adaptation off | {adapt_k} | {not_adapted[0]:.3g} | {not_adapted[1]:.3g} | the same |"
)
Markdown("\n".join(lines))

# %% [markdown]
# The *elbow stiffness* of the table is the elbow's torque per radian of its error. For computed torque it is $K_p$
# times the model's inertia.
#
# At equal stiffness, PD with feed-forward has a smaller error than plain computed torque, with both models. With the
# exact model and no noise, half-sample preview removes nearly all of computed torque's error.
#
# With the wrong model, the table mostly ranks the stiffness. LQR is the stiffest, because neither delay nor noise
# limits its gains here; its small error is not robustness. With the sample rate it gets stiffer, so its error falls.
# Even with adaptation off, the stiffer adaptive law has a far smaller error than computed torque.
#
# <details><summary>PD with gravity compensation and computed torque at equal stiffness</summary>
#
# In the table, PD is stiffer at the elbow than computed torque. This chart compares the two at equal stiffness. (The
# axes differ, because the wrong model has less mass.) With the wrong model, computed torque is worse by a factor
# below two. With the right one it is better by a factor above a hundred:
#
# ![Error of PD with gravity and of computed torque over the stiffness of the elbow](../docs/charts/equal_stiffness.png)
#
# </details>
#
# <details><summary>Rollouts, Riccati solver and quadratic programs, compared with MuJoCo and SciPy</summary>
#
# Left, `mujoco.rollout` and `mujoco.batch` are two functions of MuJoCo that simulate many plans. They work for any
# robot, the course's only for two links. Right, *regulator* is the course's Riccati solver, and *size* is the number
# of states. *Box* is the course's quadratic program with bounds, BVLS is SciPy's bounded least squares, and *size* is
# the number of commands:
#
# ![Rollouts compared with MuJoCo, Riccati solver and quadratic programs with SciPy](../docs/charts/control_speed.png)
#
# </details>
#
# **What to pick.**
#
# * Only gravity is known: PD with gravity compensation.
# * Good model, known load: PD with feed-forward is the usual start. Computed torque with half-sample preview has a
#   smaller error here, but all of its torque depends on measurements.
# * Unknown constant load torque: an I term or a disturbance observer.
# * Unknown payload on a moving arm: identify it, or use adaptive control with bounds on its estimate.
# * The command will meet a torque limit later, as in braking, or the cost is not a tracking error: plan ahead with MPC,
#   on a linear or nonlinear model. Where no gradient helps, as often in contact, use MPPI.
#
# ## 7 · Debug: what a simulator hides
#
# ### The simulator's hold
#
# Gains that work in simulation can shake the robot. One cause is the integrator. MuJoCo's default integrator is
# **semi-implicit Euler**: it first updates the velocity with the torque, and then moves the position with the *new*
# velocity.

# %%
predict("one_step_a_sample")

# %% [markdown]
# The picture shows one sample with a constant torque. The velocity of the real joint grows gradually (grey), and the
# area under the line is its displacement. With one step per sample, the simulated joint moves with its final velocity
# during the whole sample (orange). So it moves half a sample too early, and this cancels the delay of the hold. With
# ten steps (blue), nine tenths of the delay remain:

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(6, 2.4), layout="constrained")
_ = axis.plot([0.0, 1.0], [0.0, 1.0], color="0.5", lw=2.5, label="real joint")
_ = axis.step(
    [0.0, 1.0], [1.0, 1.0], where="post", color="C1", label="simulator, 1 step per sample"
)
tenths = np.arange(11) / 10.0
_ = axis.step(
    tenths, np.minimum(tenths + 0.1, 1.0), where="post", color="C0", label="10 steps per sample"
)
_ = axis.set(
    xlabel="time [samples]", ylabel="velocity", yticks=[], xlim=(0.0, 1.0), ylim=(0.0, 1.15)
)
_ = axis.legend(fontsize=9, loc="lower right")
plt.show()

# %% [markdown]
# With $n$ physics steps per sample the delay is $(1 - 1/n)\,dt/2$ instead of $dt/2$. So compute the torque in your own
# controller, at the robot's sample rate, simulate each sample in ten physics steps, and add the robot's other delays.
#
# <details><summary>The limits of a PID loop: theory, the exact joint and MuJoCo</summary>
#
# A sampled PID loop is stable below the black line, which is measured on the exact joint and lies on the theory
# (dashed). The limits measured in MuJoCo with ten steps per sample (crosses) are slightly higher, because its delay
# is smaller:
#
# ![Where the sampled PID loop is stable, measured and in theory](../docs/charts/pid_stability.png)
#
# </details>
#
# MuJoCo computes its position servo inside the physics step. Its integrator (*Euler*, *implicitfast* or *discrete*)
# decides whether old or new angles and rates enter. So even at the same step its limits differ from those of sampled PD
# (dashed in *Stable PD gains*).
#
# <details><summary>How the integrator changes the servo's limits</summary>
#
# *Euler* computes spring and damping with the old state, so damping lowers the limit. *Implicitfast* uses the new
# velocity for the damping, so damping raises it. *Discrete*, new in MuJoCo 3.13, also uses the new position for the
# spring, and has no limit in the range tried (triangles at the top).
#
# </details>
#
# <div class="alert alert-block alert-warning">
#
# **Key insight.** If the simulator's servo computes the torque, your gains fit the simulator's loop, not the robot's.
#
# </div>

# %%
more_claims(
    "simulator_hold",
    "servo_is_a_sampled_loop",
    "delay_delays_the_loop",
    "contact_is_the_wall",
    "pid_actuator_guards",
    "friction_loss_holds",
)

# %% [markdown]
# ### Symptoms, causes and fixes
#
# Four traces. Name a cause for each before you read on:

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 4, figsize=(10, 2.3), layout="constrained")
plain = Joint(0.5, 0.5)


def trace(axis, title, gains, seconds, joint=plain, delay=0.0, encoder=None):
    """Plot a step response of a joint, and return its record."""
    run = run_joint(joint, Actuator(delay=delay), encoder or Encoder(), gains, 1.0, dt, seconds)
    _ = axis.plot(run.times, run.q, lw=1)
    _ = axis.axhline(1.0, color="0.4", ls="--", lw=0.8)
    _ = axis.set(title=title, xlabel="time [s]", ylabel="angle [rad]")
    return run


trace(axes[0], "A", Gains(1.5 * Ku, u_min=-4.0, u_max=4.0), 20.0, delay=late)
trace(axes[1], "B", Gains(40.0, 150.0, 6.0), 12.0, Joint(0.5, 0.5, 0.0, 2.0, 3.0))
_ = axes[1].set(ylim=(0.95, 1.05))
rattle = trace(axes[2], "C", Gains(20.0, 0.0, 4.0), 3.0, encoder=Encoder(12, 2e-4))
axes[2].clear()
_ = axes[2].plot(rattle.times[: rattle.command.size], rattle.command, lw=0.5, color="C1")
_ = axes[2].set(
    title="C", xlabel="time [s]", ylabel="torque [N m]", xlim=(2.0, 3.0), ylim=(-20, 20)
)
wound = trace(axes[3], "D", Gains(20.0, 20.0, 4.0, u_min=-2.0, u_max=2.0, windup="none"), 8.0)
limited = np.where(np.abs(wound.command) > 1.99, 0.0, np.nan)
_ = axes[3].plot(dt * np.arange(limited.size), limited, color="C3", lw=4, label="at the limit")
_ = axes[3].legend(fontsize=8, loc="lower right")
plt.show()

# %% [markdown]
# A, B and C are the first three rows of the table. In trace D the command was at the limit (red bar) during the whole
# rise, so suspect windup first:
#
# | symptom | cause | test | fix |
# |---|---|---|---|
# | constant oscillation (A) | unstable loop at its torque limit; backlash, encoder counts | lower the gains: just below its limit the first comes to rest, the others usually stay | lower gains, less delay |
# | slow oscillation with pauses (B) | hunting | switch off the I term | stop the I term while the error is small; friction compensation |
# | torque noise at rest (C) | encoder counts times $K_d$ | plot the encoder counts at rest | filter, observer; longer sample time if the delay allows |
# | large overshoot after saturation (D) | windup | plot the command; try anti-windup | anti-windup |
# | stable in simulation only | the simulator's hold or delay | ten steps per sample, your own controller | tune with the true delay |
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The robot overshoots its target.* First look at the command. If it is at its limit during the step
# and there is an I term, suspect windup, and try anti-windup. If that does not help, or there is no I term, try a step
# so small that the command stays below the limit. If only the large step overshoots, the motor cannot brake in time:
# plan a slower motion.
#
# Otherwise switch the I term off. If the overshoot goes away, the I term causes it: lower $K_i$ or raise $K_p$. If it
# stays, look at the delay margin. If the margin is small, remove delay or lower the gains. If it is large, and the step
# starts from rest and no load pushes the joint past the target, raise $K_d$ or lower $K_p$.
#
# <details><summary>A common mistake</summary>
#
# Lowering $K_p$ while there is an I term. Far from the delay limit, that usually makes the overshoot larger. If a load,
# or the speed at the start, carries the joint past its target, a lower $K_p$ also lets it go farther. Feed the load
# forward, or raise both gains.
#
# </details>
#
# </div>

# %%
show("overshoot_means_p")

# %% [markdown]
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The robot vibrates at contact.* First ask which loop runs through the wall.
#
# * Impedance control: does the vibration die out slowly? Then raise the damping as far as the delay allows, because the
#   wall has raised the stiffness to $K + k_e$. Does it grow, or stay because the torque limit bounds it? Then stiffness
#   or damping is too large for the delay. Halve each of them alone, and keep the change that calms the hand.
# * Force control: lower the gain on the force. The impedance stiffness is not part of this loop.
# * Admittance control: raise the virtual mass or damping. Soften the inner position loop only if it is
#   too stiff for its own delay.
#
# </div>

# %%
more_claims("overdamped_cure", "vibration_needs_softness")

# %% [markdown]
# ## 8 · Exercises
#
# First do the drill `pid`: run `drills start pid` in a terminal. `check` runs your function on new random cases.
#
# ### A warm-up

# %%
card("pd_gains")


# %%
def pd_gains(inertia, friction, frequency, ratio):
    """Return the PD gains with which joints have a desired frequency and damping ratio."""
    # The same gains for every joint.
    return np.full(len(inertia), 100.0), np.full(len(inertia), 10.0)


check(pd_gains)

# %% [markdown]
# ### The ultimate gain

# %%
card("ultimate_gain")


# %%
def ultimate_gain(inertia, damping, dt, delay):
    """Return the gain at which a sampled P loop oscillates for ever, and the period."""
    # This treats the whole loop as one delay, during which the joint does not move.
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
    # PD alone: it knows nothing of the arm.
    return np.asarray(kp) * (reference[0] - q) + np.asarray(kd) * (reference[1] - v)


check(computed_torque)

# %% [markdown]
# ### Friction compensation
#
# A **friction compensation** adds the friction torque of gears and bearings, in the direction of the motion. It uses
# the rate of the reference, because noise changes the sign of a measured rate at rest.

# %%
card("friction_torque")


# %%
def friction_torque(v, coulomb, viscous, transition):
    """Return the torques that motors add so that they cancel the friction of their joints."""
    # Viscous friction alone.
    return np.asarray(viscous) * np.asarray(v)


check(friction_torque)

# %% [markdown]
# ### The LQR gain

# %%
card("lqr")


# %%
def lqr(A, B, Q, R):
    """Return the gain of the discrete linear quadratic regulator."""
    # Only the next sample counts.
    return np.linalg.solve(R + B.T @ Q @ B, B.T @ Q @ A)


check(lqr)

# %% [markdown]
# ### Hybrid force and position control

# %%
card("hybrid")


# %%
def hybrid_torque(J, frame, forced, error, velocity, force, wanted, gains):
    """Return joint torques that control force along some axes of a surface, position along others."""
    # Impedance control along all axes: no force is controlled.
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
# ### Standing on an incline
#
# A biped on a slope needs contact forces that carry its weight, within their **friction cones**
# ($\lvert f_t\rvert \le \mu f_n$) and the torque limits of its joints. In the plane, a quadratic program finds the
# cheapest ones.
#
# <details><summary>Active limits and multipliers</summary>
#
# A limit that the solution just reaches is **active**. Its **multiplier**, which is never negative, says how fast the
# lowest cost would fall if this limit were relaxed. The equations for weight and moment have multipliers of either
# sign. At the minimum, the gradients of the active limits and of the equations, each times its multiplier, cancel the
# gradient of the cost.
#
# </details>
#
# <details><summary>How steep the slope can be</summary>
#
# The left chart shows the steepest slope on which such forces exist, for strong joints and for joints of 13 N m. The
# right chart shows how much of the allowed friction, and how much torque, the cheapest forces use with strong joints.
# Torque costs little there, so these forces need more than 13 N m:
#
# ![Steepest slope over friction, and what standing uses](../docs/charts/standing_limit.png)
#
# </details>
#
# <details><summary>Two models in the next claims: for walking, and for touch</summary>
#
# In the **linear inverted pendulum**, a mass at constant height $z$ runs away from its foot at the rate $w =
# \sqrt{g/z}$. The **capture point** is where the next foot has to be for the mass to come to rest above it.
#
# A **momentum observer** computes the external torque from the motor torques and the momentum, through a first-order
# filter with the gain $K$ (in 1/s). Its output is called the **residual**. The robot has noticed a touch once the
# residual passes a threshold.
#
# </details>

# %%
more_claims(
    "below_the_friction_angle",
    "capture_point_stops",
    "enough_steps_stop",
    "centroidal_without_legs",
    "pyramid_halves_its_loss",
    "gain_notices_sooner",
)

# %%
card("standing_qp")


# %%
def standing_qp(mass, mu, slope, com, joints, contacts, limit, weight):
    """Return contact forces and joint torques with which a planar biped stands on an incline."""
    # Each contact carries a quarter of the weight, whatever the slope and the balance.
    forces = np.zeros((2, 2, 2))
    forces[..., 1] = 0.25 * mass * 9.81
    return forces, np.zeros((2, 3)), 1.0


check(standing_qp)

# %% [markdown]
# ### Silent-bug hunt
#
# Find out why the poles of this controller are not where its gains should put them.

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
# ### Formulas: three limits of PD
#
# Derive three curves of the chart of stable PD gains. The joint is an inertia $J$ without friction, the sample time is
# $dt$. Write one sample as a matrix, or as a polynomial in $z$ (a factor of $z$ is a shift by one sample). Find out
# when an eigenvalue or a root reaches the unit circle.
# <span class="kernel-only">Replace the three answers below.</span>
#
# 1. The rate is exact. Which is the largest stable $K_p$ for a given $K_d$?
# 2. The rate is the difference of the last two angles, divided by $dt$. Which is the largest $p = K_p\,dt^2/(2J)$, as a
#    function of $c = K_d\,dt/(2J)$? Here $p$ and $c$ are half of the chart's values.
# 3. The rate is exact, and the command comes one sample late. Which is the largest $P = K_p\,dt^2/(2J)$, as a function
#    of $V = K_d\,dt/J$? Here only $P$ is half of the chart's value.

# %%
answer("pd_exact_rate", "4*J/dt^2")

# %%
answer("pd_difference", "2*c")

# %%
answer("pd_sample_late", "V")

# %% [markdown]
# ### Put it into your robot
#
# Your graded answers are parts of the pick-and-place robot of `drills robot`.

# %%
your_robot(6)

# %% [markdown]
# ## 9 · Frontier: learned controllers
#
# A **residual** controller adds a learned correction to a classical one, $\tau = \tau_{\text{model}} + \pi_\theta(x)$.
# Here $\pi_\theta$ is a function with learned numbers $\theta$. Its input $x$ is often the state. But the torque
# missing for an unknown payload depends on the acceleration, too. So here $x$ also contains the accelerations that
# computed torque requests.

# %%
predict("taught_elsewhere")

# %% [markdown]
# The example starts from a wrong model, without payload and friction. It fits the torque that this model misses with
# a weighted sum of 200 sines, each of a random combination of the inputs. It then drives the motion with the improved
# controller, adds the new data, and repeats this for six rounds. The curves are medians of seven random draws of the
# sines, the bands reach from the best to the worst. For comparison, adaptive control changes the seven physical
# parameters of the arm:
#
# ![Learned and adapted, on the trained motion and on a larger one](../docs/charts/learned_beside_adaptive.png)

# %% tags=["hide-code"]
print_figures("learned_beside_adaptive", "adaptive", "learned")
# A rate of 1e-9 switches the adaptation off.
still = tracking.adaptive(tracking.WRONG, 4e-3, rate=1e-9)
not_adapted = [tracking.error(still, 4e-3, size=size) for size in (1.0, 1.6)]
print(
    f"adaptation off, trained motion: {not_adapted[0]:.2g} rad, a larger one: {not_adapted[1]:.2g} rad"
)

# %% [markdown]
# On the trained motion both are accurate to a few milliradians. On the larger motion, the learned correction's error is
# about 35 times as large: it has no data there. The adaptive law's is about three times as large: its model has the
# form of the arm's equations, and it goes on adapting. Its gains are also higher, so the numbers do not rank learning
# against adaptation.
#
# <details><summary>Six works to read</summary>
#
# | work | year | idea |
# |---|---|---|
# | Slotine and Li | 1987 | adapts the parameters of the model, with a proof: the baseline |
# | Residual policy learning (Silver and others, arXiv 1812.06298) | 2018 | learns the correction by reinforcement (chapter 9) |
# | Actuator nets (Hwangbo and others, Science Robotics) | 2019 | a network models the motor drive inside a simulator |
# | RMA (Kumar and others, RSS) | 2021 | a policy infers the changed dynamics from recent observations |
# | Neural-Fly (O'Connell and others, Science Robotics) | 2022 | features learned before, weights adapted in flight |
# | MuJoCo MPC (Howell and others, arXiv 2212.00541) | 2022 | predictive sampling with MuJoCo, cost weights changed live |
#
# </details>

# %%
more_claims("residual_learning_is_faster", "residual_of_the_state")

# %% [markdown]
# A planner needs no new training when the task changes. Here MPPI plans with MuJoCo and raises the arm. Then we raise
# the price of torque, and the arm lets itself fall:

# %% tags=["show-code"]
body, arm = TwoLink(gravity=9.81).chain(), TwoLink(gravity=9.81)
rng, price, plan = np.random.default_rng(0), 1e-4, np.zeros((15, 2))
state = np.array([-1.5, 0.0]), np.zeros(2)


def in_mujoco(plans):
    """Return costs of plans (K, 15, 2): squared distance at the end, and torque."""
    ends = mujoco.rollouts(body, plans, 0.02, state, (0.0, -9.81, 0.0))()
    return ((ends - (1.2, 0.6)) ** 2).sum(axis=1) + price * (plans**2).sum(axis=(1, 2))


for price in (1e-4, 1.0):
    for _ in range(60):
        result = control.mppi(in_mujoco, plan, rng, spread=4.0, temperature=0.05, limit=20.0)
        q, v = control.rollouts(arm, result.plan[None, :1], 0.02, state)
        state, plan = (q[-1, :, 0], v[-1, :, 0]), control.sampling.shifted(result.plan)
    raised = np.sin(state[0][0]) > 0.5
    print(f"price of torque {price:g}: the upper arm {'is up' if raised else 'is no longer up'}")

# %% [markdown]
# ## 10 · Interview
#
# Answer aloud, then open the answers. Questions on legged robots and on the categories of stop go beyond this page.

# %%
interview("control")

# %% [markdown]
# ### Checkpoint
#
# Five random questions on this chapter.

# %%
checkpoint("control", ["", "", "", "", ""], seed=1)
