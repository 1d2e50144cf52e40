# %% [markdown]
# # 6 · Control
#
# *A robot arm moves to a target. It overshoots, creeps back for seconds, or starts to shake. The motor is fine; the
# rule that turns the measured angle into a torque is not.*
#
# The most common rule is **PID**. It adds three torques: one proportional to the error (gain Kp), one to the error
# summed over time (Ki), and one to the rate of the error (Kd). Below, it drives one joint to the dashed target. Answer
# the card first<span class="kernel-only">, run the cells</span>, then press *Play* and drag the target.
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
# * compute the highest stable gain of a joint before you tune it;
# * write a PID controller that copes with torque limits, jams and encoders;
# * choose a tracking controller for an arm, and diagnose it when the arm does not follow;
# * choose among four controllers for contact with a wall;
# * tell an instability of the robot from an artefact of its simulator.
#
# You need the equations of motion of chapter 4, linear differential equations, and eigenvalues.
#
# ## How this chapter works
#
# Each section explains an idea, asks you a question about it, and shows the answer in a simulation or a chart.
# Cards with a common claim offer three verdicts: *true*, *false*, and *only under a condition*. Choose the third if
# the claim needs a condition that it does not state. Derivations are folded away. Measured numbers come from a cell
# on this page or from a check that you can run yourself with `python -m course.derivations 6`. The code is the package
# `course.control`. These exercises wait in section 8:

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint

badges(6)

# %% tags=["hide-code"]
import inspect
import math
import textwrap
from dataclasses import replace

import matplotlib.pyplot as plt
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
# ### PID: three terms
#
# The **set-point** $q_d$ is the angle that the joint should have, $q$ is the measured angle, and $e = q_d - q$ is the
# error. The controller turns the error into a torque, the motor turns the joint, and the encoder measures the new
# angle. This circle is the control loop:

# %% tags=["hide-code"]
figure_, axes = plt.subplots(figsize=(9, 1.9), layout="constrained")
box = {"boxstyle": "round,pad=0.4", "fc": "#cfe3f2", "ec": "0.3"}
arrow = {"arrowstyle": "-|>", "color": "0.3"}
blocks = ("set-point $q_d$", "error $e$", "controller", "torque limit", "delay", "joint")
for k, text in enumerate(blocks):
    _ = axes.text(2.0 * k, 0.0, text, ha="center", va="center", bbox=box, fontsize=9)
    if k:
        at = 2.0 * k - 1.0
        _ = axes.annotate("", (at + 0.28, 0.0), (at - 0.28, 0.0), arrowprops=arrow)
_ = axes.text(6.0, -1.1, "encoder", ha="center", va="center", bbox=box, fontsize=9)
_ = axes.plot([10.0, 10.0], [-0.35, -1.1], color="0.3", lw=1)
_ = axes.annotate("", (6.6, -1.1), (10.0, -1.1), arrowprops=arrow)
_ = axes.plot([5.4, 2.0], [-1.1, -1.1], color="0.3", lw=1)
_ = axes.annotate("", (2.0, -0.3), (2.0, -1.1), arrowprops=arrow)
_ = axes.text(3.7, -0.95, "measured angle $q$", ha="center", fontsize=9)
_ = axes.set(xlim=(-1.1, 10.8), ylim=(-1.5, 0.5))
_ = axes.axis("off")
plt.show()

# %% [markdown]
# PID control adds a torque for the present error, one for the past and one for the trend:
#
# $$\boxed{\;\tau = K_p\,e + K_i\int e\,dt + K_d\,\dot e\;}$$
#
# * The **P term** acts like a spring to the set-point. $K_p$ is its stiffness, in N m/rad.
# * The **I term** accumulates past error. It keeps pushing until the error is gone. $K_i$ has the unit N m/(rad s).
# * The **D term** acts like a damper. $K_d$ has the unit N m s/rad.
#
# The joint has an inertia $J$ and **viscous friction** $b$, a torque proportional to its speed. With a constant
# set-point and without the I term the closed loop obeys
#
# $$J\,\ddot q + (b + K_d)\,\dot q + K_p\,q = K_p\,q_d .$$
#
# This is a mass on a spring with a damper. A constant load torque $\tau_L$ stretches the spring: the joint stops with
# the error $\tau_L / K_p$. The I term grows until it carries that load. Here a load of 2 N m pushes the joint forwards:

# %% tags=["hide-code"]
figure_, axes = plt.subplots(figsize=(8, 2.9), layout="constrained")
for label, gains in (
    ("P: $K_p$ = 20", Gains(20.0)),
    ("PD: and $K_d$ = 4", Gains(20.0, 0.0, 4.0)),
    ("PID: and $K_i$ = 20", Gains(20.0, 20.0, 4.0)),
):
    run = run_joint(Joint(0.5, 0.5, 2.0), Actuator(), Encoder(), gains, 1.0, 1e-3, 6.0)
    _ = axes.plot(run.times, run.q, label=label)
_ = axes.axhline(1.0, color="0.3", ls="--", lw=1)
_ = axes.set(xlabel="time [s]", ylabel="angle [rad]", title="A step of the set-point, with a load")
_ = axes.legend(fontsize=9)
plt.show()

# %% [markdown]
# P alone oscillates, PD settles beside the dashed set-point, and PID reaches it slowly after going past it. How general
# is that? A mass on a spring does not oscillate if its damping is at least critical, which for P alone means
# $b^2 \ge 4 J K_p$.

# %%
show("p_alone_overshoots")

# %% [markdown]
# The I term stops changing only when the error is zero. That argument assumes that the loop settles at all. **Coulomb
# friction** (dry friction) is a torque of constant size against the motion, and it can hold a joint at rest away from
# the set-point. The I term then grows until the joint breaks loose. If the joint jumps past the set-point and sticks
# again, the same happens in the other direction, for ever. This cycle is called **hunting**.

# %%
show("integral_removes_the_error")

# %% [markdown]
# The D term needs the rate of the error. There are two ways to compute it: differentiate the error $e$, or
# differentiate
# the measured angle and use $-\dot q$. While the set-point is constant, both are the same. Now let the set-point jump
# from one sample to the next, and think about the error.

# %%
show("error_derivative_kick")

# %% [markdown]
# The spike in the command is the **derivative kick**. Choose the preset *Derivative kick* on the first screen and
# switch it off: the feedback loop, and with it the stability, is the same with both derivatives. So differentiate the
# measurement.

# %%
more_claims("critical_settles_fastest", "one_gain_one_symptom")

# %% [markdown]
# ### Windup and anti-windup
#
# Every motor has a largest torque. When the controller asks for more, the motor delivers the limit, whatever the error
# is. As long as this lasts, the gains have no effect. The I term does not know that. It keeps summing the error.

# %%
predict("jammed")

# %% [markdown]
# The surplus in the I term is called **windup**. Choose the preset *A jam* on the first screen, watch the joint run
# away, then switch on anti-windup. Two methods are in use:
#
# * **Conditional integration** updates the I term only while the command is within its limits, or while the error would
#   bring the command back from the limit.
# * **Back-calculation** takes the difference between the limited and the requested torque, and feeds it back into the I
#   term, so that the I term shrinks while the command is at the limit.
#
# A third idea is often seen in tutorials: keep the I term itself within a fixed range, for example $\pm$ the torque
# limit.

# %%
show("integral_clamp")

# %% [markdown]
# The chart shows a milder case than the card: a jam of 2 s, and a set-point of 0.25 rad. Look at the command on the
# right. Without anti-windup (orange) it stays at the upper limit after the jam has ended and the joint has passed the
# set-point. With conditional integration (blue) it leaves the limit at once. Solid lines are the exact solution of the
# joint, dots are MuJoCo:
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
# acceleration = (torque - 0.5 * velocity) / inertia
# ```
#
# Check the first two lines against the two cards above. The claims below examine the rest, with kp = 20, ki = 5 and
# kd = 8.
#
# </details>

# %%
more_claims("listing_settles", "listing_friction")

# %% [markdown]
# ### The sampled loop as a matrix
#
# So far the torque followed the angle at every instant. Then a joint with viscous friction is stable under P alone at
# any gain: the equation above has only decaying solutions. A computer works differently. It measures the angle once per
# sample time $dt$ (some cards write $h$), computes a torque, and the motor drive holds this torque until the next
# sample. Holding a value between samples is called a **zero-order hold**. It turns a smooth command into a staircase:

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
# Here is how to compute that limit. Between two samples the torque is constant, so the motion has a closed form. One
# sample maps the vector (angle, rate) linearly to its next value. For an inertia without friction, under P control to
# the set-point zero, the held torque is $-K_p q_k$, and
#
# $$\begin{pmatrix} q_{k+1}\\ v_{k+1}\end{pmatrix} =
# \begin{pmatrix} 1 - \dfrac{K_p\,dt^2}{2J} & dt\\[1ex] -\dfrac{K_p\,dt}{J} & 1\end{pmatrix}
# \begin{pmatrix} q_k\\ v_k\end{pmatrix}.$$
#
# The loop comes to rest exactly if all eigenvalues of this matrix are smaller than 1 in absolute value. The largest of
# these values is the **growth** per sample, or spectral radius. **Worked example:** the determinant of the matrix,
# which
# is the product of its eigenvalues, is $1 + K_p\,dt^2/(2J)$. For every positive $K_p$ it is above 1. So without
# friction, P alone is unstable at any gain. A delay adds the commands that are still waiting to the vector, and
# the matrix becomes larger; the method is the same.

# %%
show("hold_is_half_a_sample")

# %% [markdown]
# So count the hold as a delay of $dt/2$ and add it to the other delay $D$ of the loop. The **ultimate gain** $K_u$ is
# the P gain at which the loop oscillates with constant amplitude, on the border between stable and unstable. The
# angular
# frequency $\omega$ of that oscillation and $K_u$ follow from
#
# $$\omega\tan\!\big(\omega\,(D + \tfrac12 dt)\big) = \frac{b}{J}, \qquad
# K_u = \omega\,\sqrt{(J\omega)^2 + b^2} .$$
#
# <details><summary>Derive: the ultimate gain of a loop with delay</summary>
#
# Let $T = D + dt/2$ be the total delay. At the limit the joint moves as $e^{i\omega t}$, and
# $J\ddot q + b\dot q = -K\,q(t - T)$ becomes $J\omega^2 - ib\omega = K e^{-i\omega T}$. The angle of the left side is
# $-\arctan(b/(J\omega))$, that of the right side is $-\omega T$, so $\tan\omega T = b/(J\omega)$. The absolute value
# of both sides is $K$. Replacing the hold by a delay of $dt/2$ is an approximation, since a staircase is not a shifted
# smooth curve. The next cell compares it with the exact matrix.
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
        f"relative error of the rule {abs(gain / rule - 1):.0e}"
    )

# %% [markdown]
# A delay of 20 ms, common on a slow bus, lowers the largest gain from 1000 to 24 N m/rad. The left chart shows the same
# for all delays. The right one shows that a simulator can hide the limit; section 7 explains why:
#
# ![Ultimate gain against delay, and against a simulator's steps](../docs/charts/delay_limit.png)

# %%
more_claims("p_at_any_gain", "pade_is_enough")

# %% [markdown]
# ### Stability margins
#
# How far is a tuned loop from its limit? Cut the loop at the motor, feed in a sine, and compare the torque that comes
# back with the one that went in. Their ratio is the **open-loop gain**, and the shift of the sine is its **phase lag**.
# If a sine comes back with the same size and a lag of 180 degrees, the feedback's own minus sign makes it feed itself.
#
# * The **gain margin** is the factor by which all gains can be multiplied before the loop becomes unstable.
# * The **phase margin** is the additional phase lag that makes it unstable, at the frequency where the open-loop gain
#   is 1.
# * The **delay margin** is the additional delay that makes it unstable.

# %% tags=["hide-code"]
figure_, (top, bottom) = plt.subplots(2, 1, figsize=(8, 4.2), layout="constrained", sharex=True)
w = np.geomspace(1.0, 1000.0, 4000)
loop = (20.0 + 8.0j * w) * np.exp(-5e-3j * w) / (0.5j * w + 0.5 * (1j * w) ** 2)
size, lag = abs(loop), np.degrees(np.unwrap(np.angle(loop)))
lag -= 360.0 * round((lag[0] + 90.0) / 360.0)
one, half = np.argmax(size < 1.0), np.argmax(lag < -180.0)
_ = top.loglog(w, size)
_ = top.axhline(1.0, color="0.4", lw=1)
_ = top.plot([w[half]] * 2, [size[half], 1.0], color="C1", lw=3)
_ = top.text(1.1 * w[half], 0.5, f"gain margin {1.0 / size[half]:.1f}", color="C1")
_ = bottom.semilogx(w, lag)
_ = bottom.axhline(-180.0, color="0.4", lw=1)
_ = bottom.plot([w[one]] * 2, [lag[one], -180.0], color="C3", lw=3)
_ = bottom.text(
    w[one] / 1.1,
    -172.0,
    f"phase margin {180.0 + lag[one]:.0f} degrees\n"
    f"= delay margin {1e3 * np.radians(180.0 + lag[one]) / w[one]:.0f} ms at {w[one]:.0f} rad/s",
    color="C3",
    ha="right",
    va="bottom",
)
_ = top.set(ylabel="open-loop gain", title="PD, $K_p$ = 20, $K_d$ = 8, delay 5 ms")
_ = bottom.set(xlabel="angular frequency [rad/s]", ylabel="phase [degrees]", ylim=(-270, -80))
plt.show()

# %% [markdown]
# The course computes all three from the matrix; change a slider on the first screen and watch them. For a robot, quote
# the delay margin. It is in milliseconds, like the latency that the bus, the motor drive and the filters will add.
#
# ### Stable PD gains: damping and the delay of the rate
#
# Now leave out friction, so that all damping comes from $K_d$. To compare joints and sample times, use gains without
# units: $K_p\,dt^2/J$ and $K_d\,dt/J$. In the left chart each combination is one point. The stable PD gains lie below
# a line or curve of the chart. With the exact rate they form a triangle. If $K_d$ is small, the hold makes the loop
# unstable, as in the worked example. If $K_d$ is large, the damping torque, held for a whole sample, reverses the
# velocity and makes it larger.
#
# ![Stable gains of PD, and MuJoCo's position servo](../docs/charts/pd_triangles.png)

# %% tags=["hide-code"]
print("largest stable Kp on the grid of the chart, in J/dt^2:")
print_figures("pd_triangles", "PD on an inertia")

# %% [markdown]
# A joint rarely measures its rate. It takes the difference of two angles instead, divided by $dt$, which is the rate of
# half a sample ago. Together with one sample of computing time, this leaves less than a twentieth of the highest
# gain. You will derive three of the curves in section 8. The right chart belongs to section 7.

# %%
show("too_much_d")

# %% [markdown]
# ### Encoder, friction and torque limit
#
# An encoder rounds the angle to the nearest count (some cards say *line*). This rounding is called **quantisation**.
# The controller has to estimate the rate from these counts. Near rest, a single count more or less between two samples
# looks like a jump of the rate, and $K_d$ turns it into a jump of the torque.

# %%
predict("faster_loop")

# %% [markdown]
# Every estimator of the rate trades noise for lag. A plain difference has the least lag and the most noise. A low-pass
# filter with time constant $\tau$ averages the difference over about that time. A **tracking observer** predicts angle
# and rate one sample ahead, and corrects both with the error of the predicted angle. Both reduce noise; by how much
# are they
# late?

# %%
show("filtered_rate_is_late")

# %% [markdown]
# The chart compares the three. Down is less noise, left is less lag. At the same lag, the observer (green) has less
# noise than the filter (orange):
#
# ![Noise of a rate against its lag](../docs/charts/rate_estimates.png)

# %% tags=["hide-code"]
print("lag, and noise of the rate per noise of the angle, from the fastest to the slowest setting:")
print_figures("rate_estimates", "difference", "filtered", "tracking")

# %% [markdown]
# Now dry friction again, with a PD controller. As the joint nears the set-point, the torque of the P term falls. As
# soon as it
# is smaller than the friction $F$, the joint can stop.

# %%
show("friction_leaves_an_error")

# %% [markdown]
# An I term removes this error if friction at rest, **static friction**, is no larger than Coulomb friction. If it is
# larger,
# the torque that breaks the joint loose is more than what keeps it moving. The joint jumps, and hunts:

# %% tags=["hide-code"]
figure_, axes = plt.subplots(figsize=(8, 2.6), layout="constrained")
for label, static in (("static = Coulomb = 2 N m", 2.0), ("static 3, Coulomb 2 N m", 3.0)):
    stuck = Joint(0.5, 0.5, 0.0, 2.0, static)
    run = run_joint(stuck, Actuator(), Encoder(), Gains(40.0, 150.0, 6.0), 1.0, 1e-3, 12.0)
    _ = axes.plot(run.times, run.q, label=label)
_ = axes.axhline(1.0, color="0.3", ls="--", lw=1)
_ = axes.set(xlabel="time [s]", ylabel="angle [rad]", ylim=(0.95, 1.05))
_ = axes.legend(fontsize=9)
plt.show()

# %% [markdown]
# Choose the preset *Hunting* on the first screen and lower *Static / dry* to one: the hunting ends. The next chart
# shows
# both effects as functions of what you can change. Left: a slower rate filter reduces the ripple of the torque.
# Right: the
# amplitude of hunting grows with the ratio of static to Coulomb friction.
#
# ![Ripple of an encoder, and hunting](../docs/charts/ripple_and_hunting.png)
#
# **Saturation** means that the command is at the torque limit. While it lasts, the loop is open. If the plant falls
# over
# by itself, such as an upright pendulum, gravity can then win: outside a certain region no gain brings the pendulum
# back, because gravity pulls harder than the motor can. In the map, purple states are caught and orange states are
# lost, with half of the torque that holds the pendulum horizontally:
#
# ![Where a weak motor catches a pendulum](../docs/charts/saturation_region.png)

# %% tags=["hide-code"]
print("The pendulum and its linear model, released at rest:")
print_figures("saturation_region", "from rest")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Add up the delays of a loop: half a sample for the hold, half a sample for the difference of two
# angles, the time constant of the filter, and the communication. Their sum, the inertia and the friction decide how
# much gain is possible. Tuning by hand only rediscovers that limit.
#
# </div>

# %%
more_claims("encoder_ripple")

# %% [markdown]
# ### Tuning with the Ziegler-Nichols rules
#
# **Ziegler-Nichols** (1942) is the tuning procedure that interviewers ask for. (1) Set $K_i$ and $K_d$ to zero. (2)
# Raise $K_p$ until the loop oscillates with constant amplitude; this is the ultimate gain $K_u$. (3) Measure the period
# $T_u$ of the oscillation. (4) Take the gains from a row of the table.
#
# | controller | $K_p$ | $K_i$ | $K_d$ |
# |---|---|---|---|
# | P only | $0.5\,K_u$ | 0 | 0 |
# | PI | $0.45\,K_u$ | $0.54\,K_u/T_u$ | 0 |
# | PID | $0.6\,K_u$ | $1.2\,K_u/T_u$ | $0.075\,K_u T_u$ |
#
# Step 2 assumes that an ultimate gain exists. Compare this with what you know about joints with and without friction,
# delay and hold:

# %%
show("every_joint_has_ku")

# %% [markdown]
# So the delay must be stated. Suppose it is 20 ms. Before you look at the result: the rules were made for plants that
# settle by themselves, such as a heated tank. A joint under constant torque does not settle at an angle; it keeps
# turning. Its angle is already an integral.

# %%
show("ziegler_nichols_is_safe")

# %% [markdown]
# The alternative takes the same three numbers, $J$, $b$ and the delay. With PD and the total delay $D$ of hold,
# difference and wire, the motions $e^{st}$ of the closed loop, its **poles** $s$, solve
#
# $$J s^2 + b s + (K_p + K_d\,s)\,e^{-sD} = 0 .$$
#
# Choose $K_p$ and $K_d$ so that three of the poles are equal and real. The slowest part of the motion then does not
# oscillate. The second derivative of $(Js^2 + bs)\,e^{sD} + K_p + K_d s$ must be zero, which is a quadratic equation
# for $s$;
# the first derivative gives $K_d$, and the equation itself $K_p$:

# %% tags=["show-code"]
late = 0.02
D = late + dt  # hold and difference are half a sample each
s = max(np.roots([inertia * D**2, damping * D**2 + 4 * inertia * D, 2 * (damping * D + inertia)]))
plain = inertia * s**2 + damping * s
kd = -math.exp(s * D) * (D * plain + 2 * inertia * s + damping)
kp = -math.exp(s * D) * plain - kd * s

Ku, Tu = control.ultimate_gain(A, B, dt, late)
tried = {name: (p * Ku, i * Ku / Tu, d * Ku * Tu) for name, (p, i, d) in limits.ROWS.items()}
tried["often quoted"] = (27.0, 120.0, 1.5)
tried["equal poles"] = (kp, 0.0, kd)

# %% [markdown]
# The cell below checks all rows in two ways: with the growth of the matrix, and with a simulated step of 1 rad. The row
# *often quoted* has the gains that many tutorials derive from $K_u$ = 45 and $T_u$ = 0.45 s:

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
        f"overshoot {observed.overshoot:4.0%}, settled after {observed.settling:5.2f} s"
        if growth < 1.0
        else f"unstable: it grows {growth ** (1.0 / dt):.2f} times a second"
    )
    print(f"{name:<12} kp {kp:5.1f}  ki {ki:5.1f}  kd {kd:4.2f}   {steps}")

# %% [markdown]
# The chart repeats this over a wide range of delays. The three rules are the upper curves, the equal poles the one at
# the bottom:
#
# ![The rows on a joint with its true delay](../docs/charts/ziegler_nichols_rows.png)
#
# The P row halves $K_u$. Does that make it robust?

# %%
show("half_the_ultimate_gain")

# %%
more_claims("quoted_gains_overshoot", "quoted_ku_tu", "safer_set")

# %% [markdown]
# ## 2 · Concept: many joints
#
# ### Tracking controllers: PD to computed torque
#
# An arm follows a planned motion $q_d(t)$. Each joint's motion loads the others, so a controller that knows the
# equation of motion can do better than one PD loop per joint. Chapter 4 gave it as $M(q)\ddot q + h(q,\dot q) = \tau$,
# where $h = C(q,\dot q)\,\dot q + g(q)$ collects velocity terms and gravity. Four controllers use more and more of it:
#
# | controller | torque | what it knows |
# |---|---|---|
# | PD | $K_p e + K_d\dot e$ | nothing |
# | PD with **gravity compensation** | $K_p e + K_d\dot e + g(q)$ | the gravity torque |
# | feedforward | $K_p e + K_d\dot e + M(q_d)\ddot q_d + h(q_d,\dot q_d)$ | the torque of the planned motion |
# | **computed torque** | see below | the torque of the actual motion |
#
# $$\boxed{\;\tau = M(q)\,\big(\ddot q_d + K_d(\dot q_d - \dot q) + K_p(q_d - q)\big) + C(q,\dot q)\,\dot q + g(q)\;}$$
#
# In computed torque the PD terms are multiplied by $M(q)$. They are accelerations here, so $K_p$ has the unit 1/s² and
# $K_d$ the unit 1/s. To see what the error does, put this torque into the equation of motion. (On the card, $a_{ref}$
# is $\ddot q_d$.)

# %%
show("computed_torque_law")

# %% [markdown]
# Every joint's error then obeys its own linear equation, and the gains place its poles. This holds at each instant at
# which
# the torque is computed. Remember what the motor drive does between samples:

# %%
show("perfect_model_perfect_tracking")

# %% [markdown]
# The model can also be wrong, for instance because of an unknown payload. **Adaptive control** (Slotine and Li 1987)
# changes the model's parameters $\hat\theta$ during the motion. The torque is linear in the parameters, $\tau =
# Y\theta$,
# with the regressor $Y$ of chapter 4. With $s = \dot e + \Lambda e$, a weighted sum of both errors, the update is
#
# $$\dot{\hat\theta} = \Gamma\,Y^\mathsf{T} s ,$$
#
# where $\Lambda$ and $\Gamma$ are positive gains. The update stops as soon as the tracking error is zero, whatever
# $\hat\theta$ is by then.

# %%
show("adaptive_finds_parameters")

# %% [markdown]
# In continuous time one can prove that a sum of squares, of $s$ and of the parameter error, never increases. The proof
# needs an update at every instant. (The card writes $h$ for the sample time and *rate* for the gain $\Gamma$.)

# %%
show("adaptive_sum_can_only_fall")

# %% [markdown]
# ### What a wrong inertia does

# %%
predict("wrong_inertia")

# %% [markdown]
# With $\hat J$ in the model for the true $J$ the error obeys
#
# $$\ddot e + K_d\,\dot e + K_p\,e = \Big(\frac{J}{\hat J} - 1\Big)\,\ddot q .$$
#
# <details><summary>Derive: who drives the error</summary>
#
# The law asks for $\tau = \hat J(\ddot q_d + K_d\dot e + K_p e)$, the joint answers $J\ddot q = \tau$. Subtract
# $\hat J\ddot q$ from both sides: $(J - \hat J)\ddot q = \hat J(\ddot q_d - \ddot q + K_d\dot e + K_p e)$, and
# $\ddot q_d - \ddot q = \ddot e$. Divide by $\hat J$.
#
# For slow motion only $K_p e$ counts on the left, and the slope of $e$ over $\ddot q$ is $(J/\hat J - 1)/K_p$. At a
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
