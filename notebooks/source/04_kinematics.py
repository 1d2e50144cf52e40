# %% [markdown]
# # 4 · Kinematics and dynamics of arms
#
# *Two links follow a target, one small step after the other. Answer first<span class="kernel-only">, run the
# cells</span>, then press* Play *and click anywhere in the picture.* About {open minutes} minutes of reading, cards
# and charts; the collapsed parts add {folded minutes}; exercises {exercise minutes}.

# %%
from course.cards import predict
from course.simulations import simulation

predict("inward_from_stretched")

# %% [markdown]
# ![Two links follow a target](attachment:kinematics.arm.png)
#
# *Here the arm is bent, and reaches its target (dashed: the two ways to do so). The question is about an arm that is
# not bent at all; a damped step is one that holds back, see section 1.*

# %%
simulation("arm")

# %% [markdown]
# **You will be able to** say where the hand is and how fast it moves for any chain of joints; choose a step towards a
# target by what it does where the arm is stretched; tell an unreachable target from a bad start; use a joint to spare;
# and compute the torques behind a motion, in one pass out and one back. **Know first:** vectors, matrices, derivatives;
# chapter 1 for quaternions and integrators.
#
# ## How this chapter works
#
# Most scenes begin with a card: answer first; a click says whether you are right, and **Explanation** says why. Then
# you move something, learn its name, and see one number. A number in the text comes from the cell above it, or from a
# check that `python -m course.derivations 4` runs again. The code is `course.kinematics`. These exercises wait in
# section 7:

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint

badges(4)

# %%
import inspect
import math
import textwrap
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

from course import kinematics, rigid_body
from course.cards import figures, interview
from course.charts import read
from course.derivations import more_claims, show
from course.kinematics import ik, jacobian, panda, planar, tip, two_link_ik


def source(*functions):
    """Show functions as they stand in the module."""
    text = "\n\n".join(inspect.getsource(f) for f in functions)
    return Markdown(f"```python\n{text}```")


def listed(numbers):
    """Return numbers to two places in one line."""
    return " ".join(f"{number + 0.0:.2f}" for number in np.round(numbers, 2))


def print_figures(chart, *rows):
    """Print the lines of a chart's key figures that begin so, no wider than a page."""
    for line in read(chart).splitlines():
        if line.lstrip().startswith(rows):
            words = " ".join(line.split())
            print(textwrap.fill(words, 96, subsequent_indent="    "))


# %% [markdown]
# ## 1 · Concept: from angles to the hand, and back
#
# ### Where is the hand?
#
# An arm is a chain of links and joints. What one wants to place is the hand, the tool, the tip: the **end effector**.
# There are two ways to say where the arm is. In **joint space** a point $q$ is a list of joint angles. In
# **task space** a point is what the task asks for: a position of the tip, or a pose, which is position and
# orientation. **Forward kinematics** goes from the first to the second.

# %%
show("fk_is_a_product")

# %% [markdown]
# Each joint has a frame; it sits at a fixed place in the frame before it, and turns about its own $z$:
#
# $$T_{\text{hand}} = A_1\,R_z(q_1)\;A_2\,R_z(q_2)\cdots A_n\,R_z(q_n)\;T_{\text{tool}} .$$
#
# There is one answer, it always exists, and it is smooth. For two links in a plane, $q_2$ measured from the first
# link, it is
#
# $$x = l_1\cos q_1 + l_2\cos(q_1+q_2), \qquad y = l_1\sin q_1 + l_2\sin(q_1+q_2) .$$

# %%
show("two_link_position")

# %% [markdown]
# The product, written out for an arm with seven turning joints (7-R for short) of the size of the Franka Panda, beside
# the compiled function. A pose is seven numbers here: a position and a unit quaternion.

# %%
arm = panda()
q = np.array([0.3, -0.4, 0.1, -1.9, 0.0, 1.7, 0.6])
hand = np.array(kinematics.chain.HERE)
for angle, placement in zip(q, arm.placement.T, strict=True):
    turn = np.array([0.0, 0.0, 0.0, np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)])
    hand = kinematics.compose(hand, kinematics.compose(placement, turn))
hand = kinematics.compose(hand, arm.tool)
print("position of the hand [m]:", hand[:3].round(4))
print("the product is the function's, to rounding:", np.abs(hand - tip(arm, q)).max() < 1e-14)

# %% [markdown]
# <details><summary>Which four numbers describe a joint?</summary>
#
# **Denavit-Hartenberg** parameters place a joint's frame with two angles and two lengths instead of six numbers,
# because the frame may be slid and turned along its own axis without changing the motion. Two conventions are in use
# (Denavit and Hartenberg 1955, and Craig's, in which the numbers of the Panda are published), and a table of numbers
# without its convention describes another arm. Robot descriptions such as URDF give all six, and so does `Chain`.
#
# </details>
#
# ### How does the hand move?
#
# The **Jacobian** $J$ is the matrix of partial derivatives: tip velocity $= J(q)\,\dot q$. For two links, with $s_{12}$
# short for $\sin(q_1+q_2)$,
#
# $$J = \frac{\partial(x, y)}{\partial(q_1, q_2)} =
# \begin{pmatrix} -l_1s_1-l_2s_{12} & -l_2s_{12} \\ l_1c_1+l_2c_{12} & l_2c_{12} \end{pmatrix} .$$
#
# Its column $i$ is what joint $i$ does alone. You can draw it without a derivative: a turning joint moves the tip
# across the line from the joint to the tip, as fast as that line is long.

# %%
lengths, posture = (1.0, 0.7), np.array([0.4, 1.1])
two = planar(lengths)
joints = np.column_stack([kinematics.frames(two, posture)[:2], tip(two, posture)[:2]])
J = jacobian(two, posture)[:2]
figure_, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
_ = axes.plot(*joints, "o-", color="#3b6ea5", linewidth=6, markersize=9)
for i, colour in enumerate(("tab:orange", "tab:green")):
    _ = axes.plot(*joints[:, [i, 2]], "--", color=colour)
    _ = axes.quiver(*joints[:, 2], *J[:, i], color=colour, scale=2.5, scale_units="xy", angles="xy")
    _ = axes.text(*(joints[:, 2] + 0.44 * J[:, i]), f"column {i + 1}", color=colour, ha="right")
_ = axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", xlim=(-0.6, 1.6), ylim=(-0.1, 1.7))
plt.show()
for i in range(2):
    line = joints[:, 2] - joints[:, i]
    print(
        f"joint {i + 1}: {np.linalg.norm(line):.3f} m from the tip, its column "
        f"{np.linalg.norm(J[:, i]):.3f} m/rad long, at right angles: {abs(line @ J[:, i]) < 1e-12}"
    )

# %% [markdown]
# In space a column has six numbers: with the axis $z_i$ of the joint and the line $p - p_i$ from it to the tip, all in
# world axes,
#
# $$J_i = \begin{pmatrix} z_i\times(p-p_i) \\ z_i\end{pmatrix}
# \quad\text{if joint } i \text{ turns},\qquad
# \begin{pmatrix} z_i \\ 0\end{pmatrix} \quad\text{if it slides.}$$
#
# That is the *geometric* Jacobian. Its lower rows are an angular velocity, which is the derivative of no three angles.
#
# The same matrix carries forces the other way. By the principle of **virtual work** a force and torque $F$ (a *wrench*)
# that pulls at the tip asks the motors for $\tau = -J^\mathsf{T}F$ to hold against it. A check of both, on the 7-R arm:
# small motions by $J$, and the torques that a pull at the hand changes.

# %%
J, still = jacobian(arm, q), np.zeros(7)
for h in (1e-2, 1e-3):
    step = h * np.ones(7) / np.sqrt(7.0)
    missed = np.linalg.norm((tip(arm, q + step) - tip(arm, q))[:3] - (J @ step)[:3])
    print(f"a step of {h:g} rad: J misses the motion of the hand by {missed:.1e} m")
pull = np.array([0.0, 0.0, -20.0, 0.0, 0.0, 0.0])
free = kinematics.inverse_dynamics(arm, q, still, still)
pulled = kinematics.inverse_dynamics(arm, q, still, still, pull)
print("20 N down at the hand ask for [N m]:", listed(pulled - free))
print("which is -J^T F:", np.allclose(pulled - free, -J.T @ pull, atol=1e-12))

# %% [markdown]
# ### The way back
#
# **Inverse kinematics**, IK, asks for the joint angles that put the tip at a target. Nobody promises that there are
# any, or only one. Two links reach a point inside their range with the elbow on either side: **elbow up** or elbow
# down, as one says where gravity gives a meaning to up. The points that the tip can reach at all are its
# **workspace**; for two links whose joints turn all the way round it is an **annulus**, a ring between two circles:
#
# $$\lvert l_1-l_2\rvert \;\le\; r \;\le\; l_1+l_2 .$$

# %%
show("number_of_solutions")

# %% [markdown]
# Click into the hole of the ring on the first screen, and outside of it. The dashed ghosts are the two exact answers.
# The closed form needs only the triangle of base, elbow and tip. Its two usual faults are an arccosine that loses half
# the digits at the edges, and a clamp that turns *no answer* into a wrong one.

# %%
for name, r in (
    ("inside", 1.2),
    ("outer edge", 1.7),
    ("1 mm beyond", 1.701),
    ("in the hole", 0.2),
):
    exact = two_link_ik(lengths, (r, 0.0))
    (a, b), (c, d) = exact.q.round(3).T + 0.0
    print(
        f"{name:<12} r = {r:.3f} m: {'reached' if exact.reached else 'not':<7} by "
        f"({a:6.3f}, {b:6.3f}) and ({c:6.3f}, {d:6.3f}), off by {exact.distance:.3f} m"
    )

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Forward kinematics is a function. Inverse kinematics is a question: none, one, finitely many, or a
# whole curve of answers, and a solver has to say which.
#
# </div>
#
# ### Where a direction is lost
#
# Ask how far the tip can go for joint rates of length one. The answers form an ellipse: the green one in the
# simulation. Its half axes are the **singular values** $s_1\ge s_2\ge\dots$ of $J$, and $1/s$ is how much joint motion
# a unit of tip motion costs along that axis. A posture where the smallest is zero is a **singularity**: the ellipse is
# flat, $J$ has lost rank, and one direction of the hand is out of reach for the moment.

# %%
show("two_link_jacobian")

# %%
show("singular_stretched_or_folded")

# %% [markdown]
# Two numbers are quoted for the distance from there. The **manipulability** $\sqrt{\det JJ^\mathsf{T}}$ (Yoshikawa
# 1985) is the product of the singular values. The **condition number** $s_1/s_{\min}$ is the ratio of the largest to
# the smallest.

# %%
show("condition_is_a_product")

# %%
predict("millimetres")

# %%
J = jacobian(arm, q)
for unit, length in (("metres", 1.0), ("millimetres", 1e-3), ("units of the reach", arm.reach[1])):
    print(f"rows of position in {unit:<18}: {kinematics.condition_number(J, length):7.1f}")
print(f"{'without the rows of rotation':<38}: {np.linalg.cond(J[:3]):7.1f}")

# %% [markdown]
# The same posture, the same arm. `condition_number(J, length)` therefore has no default for its length. What you can
# always compare is $s_{\min}$ of the rows that you care about with your own speeds: joints of $\dot q_{\max}$ move the
# tip at $s_{\min}\,\dot q_{\max}$ in the worst direction.

# %%
show("condition_above_hundred")

# %%
show("euler_jacobian_locks")

# %%
more_claims("condition_needs_a_length")

# %% [markdown]
# ### A step towards the target
#
# One solves IK as Newton would: the error $e$ of the tip, a step $\Delta q$ with $J\,\Delta q\approx e$, and again.
# Every method answers each singular direction of the error with a number of its own, the *gain*; the right-hand panel
# of the simulation draws it.
#
# | step | $\Delta q$ | gain at $s$ |
# |---|---|---|
# | transpose | $\alpha J^\mathsf{T}e$ | $\alpha s$ |
# | **pseudo-inverse** | $J^+e$, the shortest of all steps that do the most | $1/s$, and 0 where $s=0$ |
# | **damped least squares** (DLS) | $J^\mathsf{T}(JJ^\mathsf{T}+\lambda^2 1)^{-1}e$ | $s/(s^2+\lambda^2)$ |
# | adaptive | damped where $s$ is below $\lambda$ only | $1/s$, or $s/\lambda^2$ |
# | **Levenberg-Marquardt** (LM) | damped, $\lambda$ down after a success, up after a failure | its own at every step |

# %%
predict("gain_of_a_step")

# %% [markdown]
# Now choose *Jump beside the singularity* on the first screen and press *Play*; then the damped step, and slide
# $\lambda$ while it moves. The red glow grows with $1/s_{\min}$.

# %%
show("damped_gain")

# %% [markdown]
# <details><summary>Derive: where the damped step comes from</summary>
#
# Minimise $\lvert J\,\Delta q - e\rvert^2 + \lambda^2\lvert\Delta q\rvert^2$: the error that is left, and a price for
# motion. Setting the gradient to zero gives $(J^\mathsf{T}J+\lambda^2 1)\,\Delta q = J^\mathsf{T}e$. Multiply
# $J^\mathsf{T}(JJ^\mathsf{T}+\lambda^21) = (J^\mathsf{T}J+\lambda^21)J^\mathsf{T}$ from both sides with the inverses,
# and the form of the table comes out, whose matrix is as small as the task. With $J =
# U\,\mathrm{diag}(s)\,V^\mathsf{T}$ each singular direction stands alone: gain $s/(s^2+\lambda^2)$, greatest where
# its derivative $(\lambda^2-s^2)/(s^2+\lambda^2)^2$ vanishes (Nakamura and Hanafusa 1986; Wampler 1986).
#
# The damping has the unit of $s$, metres per radian where the task is a position. A $\lambda$ without a unit is a
# number from somebody else's arm.
#
# </details>

# %%
show("damping_is_free")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** The dangerous place is not the singularity but its neighbourhood. Damping bounds the step there by
# $1/(2\lambda)$ times the error, and leaves a share of the error everywhere.
#
# </div>
#
# ### A joint to spare
#
# With more joints than the task has numbers there is **redundancy**, and the answers of IK form curves. The joint rates
# that the tip does not feel, $J\,\dot q = 0$, are the **null space** of $J$. Any wish $z$ for the joints is cut down to
# it by the **projector**
#
# $$N = 1 - J^+J, \qquad \Delta q = J^+e + N z .$$

# %%
show("one_joint_to_spare")

# %%
predict("tip_in_the_null_space")

# %%
simulation("elbow")

# %%
show("null_motion_leaves_the_tip")

# %% [markdown]
# The hand of the chapter's arm is where it shall be; the elbow is close to a pillar. Go up the gradient of the
# distance, in the null space, and put the hand back with one run of IK after each step:

# %%
crowded = np.array([-0.79, -0.70, 0.78, -1.87, 0.53, 1.56, 0.17])
pillar, radius = np.array([-0.08, 0.30]), 0.10
target, moved, plain, gaps = tip(arm, crowded), crowded, crowded, []
for _ in range(60):
    gap, uphill = kinematics.disc_distance(arm, moved, pillar, radius)
    gaps.append(gap)
    moved = ik(arm, target, kinematics.null_space_step(arm, moved, uphill, 0.02), restarts=0).q
    uphill = kinematics.disc_distance(arm, plain, pillar, radius)[1]
    plain = kinematics.null_space_step(arm, plain, uphill, 0.02)
figure_, axes = plt.subplots(1, 2, figsize=(10, 3.4), layout="constrained")
for name, posture_, colour in (("before", crowded, "0.6"), ("after", moved, "#3b6ea5")):
    places = np.column_stack(
        [np.zeros(3), kinematics.frames(arm, posture_)[:3], tip(arm, posture_)[:3]]
    )
    _ = axes[0].plot(*places[:2], "o-", color=colour, linewidth=4, label=name)
_ = axes[0].add_patch(plt.Circle(pillar, radius, color="tab:red", alpha=0.6))
_ = axes[0].set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="the arm from above")
_ = axes[0].legend()
_ = axes[1].plot(np.arange(len(gaps)), 1e3 * np.array(gaps))
_ = axes[1].set(xlabel="steps", ylabel="gap to the pillar [mm]", title="the elbow backs away")
plt.show()
for name, posture_ in (("one IK after each", moved), ("never put back", plain)):
    deviation = np.linalg.norm(kinematics.pose_error(target, tip(arm, posture_))[:3])
    gap = kinematics.disc_distance(arm, posture_, pillar, radius)[0]
    print(
        f"{name:<17}: gap {1e3 * gaps[0]:.0f} -> {1e3 * gap:.0f} mm, hand off by "
        f"{'under 0.001' if deviation < 1e-6 else format(1e3 * deviation, '.1f')} mm, "
        f"within limits: {kinematics.within(arm, posture_)}"
    )

# %% [markdown]
# ### What the motors must do

# %%
predict("elbow_accelerates")

# %% [markdown]
# The equations of motion of any chain are
#
# $$\boxed{\;M(q)\,\ddot q + h(q,\dot q) = \tau + J^\mathsf{T}F\;}$$
#
# with the symmetric, positive **mass matrix** $M$, and the bias $h$: **Coriolis** and centrifugal terms (quadratic in
# the rates), gravity, friction. *Inverse dynamics* asks for the torques of a motion, *forward dynamics* for the
# accelerations that torques cause. Three recursions answer, each in one or two passes along the chain:
#
# | algorithm | gives | how it goes | cost |
# |---|---|---|---|
# | **recursive Newton-Euler** (RNEA) | $\tau$ | velocities and accelerations outwards, forces inwards | $O(n)$ |
# | **composite rigid body** (CRBA) | $M$ | all links behind a joint as one body | $O(n^2)$ |
# | **articulated body** (ABA) | $\ddot q$ | what a link feels like when all behind it may give way | $O(n)$ |
#
# Gravity costs nothing extra: let the base accelerate upwards at $g$.
#
# <details><summary>Derive: Newton-Euler, out and back</summary>
#
# Outwards, from the base: a link's angular velocity is its parent's plus $\dot q_i z_i$; differentiate for the angular
# acceleration, and carry the acceleration of the origin along with $\alpha\times r + \omega\times(\omega\times r)$.
# Each link now knows its motion, so by chapter 1 the force $m a$ and the torque $I\alpha + \omega\times I\omega$ that
# it needs. Inwards, from the tip: the joint in front of a link must deliver what the link needs and what the links
# behind it ask of it. The motor feels the part along its axis; the rest is carried by the bearing.
#
# </details>

# %%
free = replace(arm, damping=0.0)
v, a = np.array([0.5, -0.8, 0.3, 1.0, -0.6, 0.9, -1.2]), np.linspace(-1.0, 1.0, 7)
tau = kinematics.inverse_dynamics(free, q, v, a)
M, h = kinematics.mass_matrix(free, q), kinematics.bias(free, q, v)
back = kinematics.forward_dynamics(free, q, v, tau)
print("torques of the motion [N m]:", listed(tau))
print("RNEA = CRBA's M times a + bias:", np.allclose(tau, M @ a + h, atol=1e-12))
print("ABA gives the accelerations back:", np.allclose(back, a, atol=1e-11))
held = kinematics.inverse_dynamics(free, q, still, still)
print("torques that only hold the arm up:", listed(held))

# %% [markdown]
# The joints of an arm that is let go feel no motor: what it had, it keeps. Energy, by chapter 1's integrators on
# `acceleration(q, v, params)`:

# %%
fall = rigid_body.System("arm", kinematics.acceleration, kinematics.pack(free), q, v)
worst = []
for count in (500, 1000, 2000):
    run = rigid_body.simulate(fall, "rk4", 1.0 / count, count, every=count // 50)
    total = kinematics.energy(free, run.q.T, run.v.T)[2]
    worst.append(np.abs(total / total[0] - 1.0).max())
    print(f"{count:5d} steps of RK4 over 1 s: energy off by {worst[-1]:.1e} of itself at most")
print(f"halving the step divides that by {worst[0] / worst[1]:.0f} and {worst[1] / worst[2]:.0f}")

# %% [markdown]
# None of chapter 1's methods is symplectic here: the mass matrix depends on $q$, so the kinetic energy does too, in
# angles and rates.

# %%
show("articulated_bodies_lose_fewer_digits")

# %% [markdown]
# ### What the torques tell
#
# Torques are *linear* in ten numbers of each link: mass, three first moments, six second moments. The matrix in
# $\tau = Y(q,\dot q,\ddot q)\,\theta$ is the **regressor**. So one can weigh an arm by moving it:

# %%
show("torques_tell_ten_numbers")

# %%
rng = np.random.default_rng(4)


def motions(number):
    """Return random states, their regressor as rows.

    And their torques without the known friction.
    """
    states = rng.uniform(-1.5, 1.5, (3, 7, number))
    Y = kinematics.regressor(arm, *states)
    known = arm.armature[:, None] * states[2] + arm.damping[:, None] * states[1]
    torque = kinematics.inverse_dynamics(arm, *states) - known
    return Y.transpose(2, 0, 1).reshape(-1, Y.shape[1]), torque.T.reshape(-1)


Y, torque = motions(60)
noisy = torque + 0.05 * rng.normal(size=torque.size)
theta, _, rank, _ = np.linalg.lstsq(Y, noisy, rcond=1e-9)
fresh, truth = motions(40)
rms = np.sqrt(np.mean((fresh @ theta - truth) ** 2))
print(f"numbers {Y.shape[1]}, combinations that show {rank}")
print(f"noise 0.05 N m; fresh torques predicted to {rms:.3f} N m of {truth.std():.1f} N m")
print(f"mass of the first link: fitted {abs(theta[0]):.2f} kg, true {arm.mass[0]:.2f} kg")

# %% [markdown]
# The fit predicts every torque and knows not even the first mass. The combinations that show are the
# **base parameters** (Khalil and Dombre 2002); chapters 6 and 8 fit those.
#
# ## 2 · Design: three levels, three rates
#
# An arm is commanded on three levels, each several times as fast as the one above: an inner loop must be fast compared
# with the loop that closes around it. (Not all of it has to run at a kilohertz, only the level that holds the torque.)

# %%
LEVELS = (
    ("task space", "poses of the hand", "tens of Hz to 1 kHz", "what the planner or a person asks"),
    ("joint space", "angles and rates", "hundreds of Hz to 1 kHz", "what the controller tracks"),
    ("actuator space", "torques, currents", "1 kHz; current loop 10 kHz and more", "what drives"),
)
DOWN = ("inverse kinematics", "dynamics, feedback")
UP = ("forward kinematics", "encoders")
figure_, axes = plt.subplots(figsize=(9, 3.6), layout="constrained")
for row, (name, what, rate, owner) in enumerate(LEVELS):
    y = 2.0 - row
    box = {"boxstyle": "round,pad=0.5", "facecolor": "#eef3f7", "edgecolor": "#3b6ea5"}
    _ = axes.text(0.0, y, f"{name}\n{what}", ha="center", va="center", bbox=box, fontsize=11)
    _ = axes.text(1.0, y, f"{rate}\n{owner}", va="center", fontsize=10)
for row in range(2):
    for x, start, end, label, side in (
        (-0.12, 1.70 - row, 1.30 - row, DOWN[row], "right"),
        (0.12, 1.30 - row, 1.70 - row, UP[row], "left"),
    ):
        _ = axes.annotate("", (x, end), (x, start), arrowprops={"arrowstyle": "-|>", "lw": 1.8})
        _ = axes.text(x + np.sign(x) * 0.05, 1.5 - row, label, ha=side, va="center", fontsize=10)
_ = axes.set(xlim=(-1.0, 2.4), ylim=(-0.5, 2.5))
axes.set_axis_off()
plt.show()
print("\n".join(f"{name:<15} {what:<18} {rate}" for name, what, rate, _ in LEVELS))

# %% [markdown]
# One command on its way down. The task says a pose; IK finds joint angles; a law turns the error into an acceleration,
# and inverse dynamics into torques: **computed torque**, which chapter 6 takes further.

# %%
desired = tip(arm, q) + np.array([0.0, 0.1, -0.05, 0.0, 0.0, 0.0, 0.0])
outcome = ik(arm, desired, q)
requested = 100.0 * (outcome.q - q)  # rad/s^2: a spring of 100 1/s^2, from rest
torques = kinematics.inverse_dynamics(arm, q, still, requested)
print("task space:     hand to", listed(desired[:3]), "m")
print(f"joint space:    {listed(outcome.q)} rad ({outcome.reason} in {outcome.iterations} steps)")
print("actuator space:", listed(torques), "N m")

# %% [markdown]
# Where IK sits is a choice. Solved *once*, for the goal, it gives a planner of joint space its end point. Solved at
# every tick for a rate, $\dot q = J^+\dot x$ with damping, it is **resolved rate** control (Whitney 1969): cheap, and
# blind to what comes.

# %%
show("tip_plans_need_joints")

# %% [markdown]
# Trade-offs to say aloud: more rate at the task level buys disturbance rejection and costs bandwidth below; one joint
# more buys a null space and costs a rule for what to do with it; a solver with restarts buys success and costs a bound
# on its time, so real-time loops take the last posture as start, a fixed number of steps, and a report.
#
# ## 3 · Code: the reference functions
#
# The two links in closed form, both branches at once. The half-angle form keeps its digits at both edges:

# %%
source(kinematics.two_link.branches)

# %% [markdown]
# A column of the Jacobian for every joint between base and tip, walking from the tip inwards along the parents; a tree
# costs nothing extra. Then the gain of each step, and the projector:

# %%
source(kinematics.motion.columns, kinematics.inverse.gain)

# %%
source(kinematics.null_space)

# %% [markdown]
# With these, the smallest loop of IK is seven lines. Beside it the chapter's `ik`, which also holds limits, starts
# again where it got stuck, and says *why* it failed:


# %%
def follow(chain, goal, q, damping=0.1, tolerance=1e-4, at_most=100):
    """Return half of a damped step, again and again: what one writes first."""
    taken = 0
    while taken < at_most:
        error = goal - tip(chain, q)[:2]
        if np.linalg.norm(error) < tolerance:
            break
        J = jacobian(chain, q)[:2]
        q = q + 0.5 * J.T @ np.linalg.solve(J @ J.T + damping**2 * np.eye(2), error)
        taken += 1
    return q, taken


pair = planar((1.0, 0.8))
goal = np.array([1.2, 0.5, 0.0])
reached, taken = follow(pair, goal[:2], np.array([0.5, 0.5]))
print(f"target {goal[:2]}, reached {tip(pair, reached)[:2].round(4)} after {taken} steps")
for place in (goal, np.array([1.8, 0.5, 0.0])):
    one = ik(pair, place, np.array([0.5, 0.5]))
    print(f"ik to {place[:2]}: {one.reason}, off by {one.distance:.1e} m, {one.starts} starts")

# %%
show("listing_reaches_its_target")

# %%
show("listing_converges")

# %% [markdown]
# Bad input is refused at the door, with the argument's name and what is allowed:

# %%
for attempt in (
    lambda: ik(arm, np.array([0.4, 0.0, 0.5, 1.0, 1.0, 0.0, 0.0]), q),
    lambda: planar((1.0, 0.0)),
    lambda: jacobian(arm, np.zeros(6)),
):
    try:
        attempt()
    except ValueError as problem:
        print(textwrap.fill(str(problem), 96, subsequent_indent="    "))

# %% [markdown]
# ## 4 · The simulation in full
#
# Click or drag to set the target, inside the ring or out of it; arrow keys move it by five centimetres. Choose the
# step, slide the damping (0.10 m/rad to begin with), choose whose condition number is shown. Live: the error, the
# condition number, the manipulability, the smallest singular value, the gain of the last step and its bound. Each
# preset shows one failure. Before you choose one, say what will happen:
#
# 1. *Stretched, target inward*: which of the five steps moves?
# 2. *Target out of reach*: what does the glow do, and what if you then take the pseudo-inverse?
# 3. *Jump beside the singularity*: how far does the damping have to go up until the arm stays calm?
# 4. *The same arm in millimetres*: what changes in the picture, apart from the number?

# %%
simulation("arm")

# %% [markdown]
# ## 5 · Speed against accuracy
#
# ### States a second

# %%
predict("one_call_or_a_batch")

# %% [markdown]
# The 7-R arm, random states, one core, called from Python; Pinocchio (Carpentier and others 2019) is what professionals
# use for rigid-body algorithms, MuJoCo you know from chapter 1. Our batch is one call. Pinocchio is called once a state
# and, for torques and accelerations, once for the whole batch (`rneaInParallel` and `abaInParallel`, on one thread).
# MuJoCo is called once a state:
#
# ![States a second against the size of the batch](../docs/charts/arm_throughput.png)

# %%
print_figures("arm_throughput", "Torques", "Accelerations", "Jacobian")

# %% [markdown]
# All three agree to rounding, so there is no accuracy to trade. What differs is the price of the door: one state a call
# costs us our checks and NumPy's arrays; where the curves cross, the batch has paid for them.
#
# ### A Jacobian by differences

# %%
predict("step_of_a_difference")

# %% [markdown]
# ![Error of a Jacobian against step, and against time](../docs/charts/jacobian_precision.png)

# %%
print_figures("jacobian_precision", "forward", "central", "complex", "autograd", "analytic")

# %% [markdown]
# Differences make a V: Taylor's error falls with the step, rounding rises. A **complex step** has no difference to
# cancel, so it can be as small as you like (Squire and Trapp 1998). Use differences to *check* a Jacobian, central ones
# at the cube root of the rounding unit, and compare the error with the V.
#
# ### Poses solved
#
# Ten thousand reachable poses of the 7-R arm, solved within its limits to a micrometre and a microradian. The *usual
# loop* is the one of Pinocchio's documentation: a tenth of each pseudo-inverse step, no limits, one start. It gets
# clamping, restarts and full steps in two more curves:
#
# ![Share of poses solved against time](../docs/charts/ik_success.png)

# %%
show("converged_within_limits")

# %% [markdown]
# Each answer was checked by forward kinematics, and none of ours contradicted. Right, the same for poses beside a
# singular posture of the shoulder; and of poses beyond the reach none is claimed. The rates compare one compiled batch
# with a loop in Python around Pinocchio's calls, one pose after the other, as its users write it. That mixes three
# things, so two more rows take them apart: *our method in Python* takes our steps with Pinocchio's calls, and *a call
# a pose* calls our compiled method for one pose at a time.

# %%
rates = [line for line in read("ik_success").splitlines() if "solved a second" in line]
print("\n".join(rates[: len(rates) // 2]))  # of the picture on the left
print_figures("ik_success", "poses 5 %")
figures(read("ik_success"), summary="Steps, starts, and poses solved a second")

# %% [markdown]
# What makes the difference is not the single step but what surrounds it: limits held in every step, a new start when
# the error stops to shrink, and a start that is near.
#
# ### Which step for which tolerance?
#
# Forty poses near a start, every method with one to forty steps. Drag the tolerance, or use the arrow keys on it: the
# circle goes to the cheapest run within it, and the sentence says what that costs.

# %%
from course.measure.work_precision import Method, Result, measure
from course.simulations.trade_off import TradeOff

home = np.array([0.0, -0.6, 0.0, -2.2, 0.0, 1.6, 0.8])
goals = tip(arm, home[:, None] + np.random.default_rng(8).uniform(-0.4, 0.4, (7, 40)))


def steps_of(name):
    """Return a curve: what so many steps leave of the error, and cost."""

    def run(setting):
        largest = round(1.0 / setting)
        end = ik(
            arm, goals, home, method=name, restarts=0, iterations=largest, tolerance=(1e-14, 1e-14)
        )
        return Result(np.hypot(end.distance, end.angle), largest)

    return Method(name, run, [1.0 / k for k in (1, 2, 3, 4, 6, 8, 12, 20, 40)], unit="steps")


result = measure(
    [steps_of(name) for name in kinematics.METHODS],
    np.zeros(40),
    lambda remaining, zero: float(np.median(remaining)),
    reference_check=np.zeros(40),
    tolerance=1e-6,
    repeats=3,
    best=True,
    question="What do so many steps leave of the error?",
    error_unit="m, rad",
    converges=False,
)
best = result.pick(by="count").point
print(f"fewest steps within 1e-6: {best.count:.0f}, with {best.error:.0e} left")
TradeOff(result)

# %% [markdown]
# In steps, all that let go of the damping are Newton's method in the end. In time Levenberg-Marquardt is ahead: it
# solves a small system by Cholesky where the others here take singular values. The same at both kinds of target, an
# ordinary one and one on the edge of two links:
#
# ![Residual against steps](../docs/charts/ik_residual.png)

# %%
print_figures("ik_residual", "An ordinary", "A target on")

# %% [markdown]
# Damping that stays keeps a share of each error, where the others gain more with each step. On the edge of the annulus,
# where the answer itself is singular, only steps that let go of the damping arrive.
#
# ### The smallest model that answers the question
#
# A planar two-link arm has a closed form for everything, and costs a small share of a general engine (the chart
# [vector_env](../docs/charts/README.md) has the ratio). When is it enough? The **scene** of chapter 8's reaching task:
#
# ![Error of the planar arm against its faults](../docs/charts/two_links_enough.png)

# %%
figures(
    read("two_links_enough"),
    "Where is",
    "tolerance",
    "coupling",
    "friction",
    "base out of level by",
    "elbow axis skewed by",
    "the scene fits",
    summary="With the limits of both faults",
)

# %% [markdown]
# ### What to pick
#
# * *Two or three joints in a plane, or a wrist whose axes meet*: the closed form. All answers, no steps, no start.
# * *Following a path, at every tick*: one or two damped steps from the last posture, $\lambda$ adaptive, and the result
#   checked by forward kinematics.
# * *A pose out of nothing*: Levenberg-Marquardt with limits, starts from a table of samples, then uniform ones; a bound
#   on time, and a reason when it fails.
# * *Torques*: RNEA. *Simulation*: ABA, or CRBA and Cholesky for a short arm. *A check*: each against the others.
# * *Thousands at once*: a batch, whoever computes it.
#
# ## 6 · Debug: where it fails
#
# ### Damping, and what it costs
#
# A tip that shall go at a constant speed, joints with a largest rate: for which damping do they keep it? Measured over
# the bend of the elbow and $\lambda$, with the theory drawn on it, $s/(s^2+\lambda^2) =$ limit. Right, the price: the
# largest error of a tip that is led past the folded arm:
#
# ![Damping near a singularity](../docs/charts/damping_map.png)

# %%
print_figures("damping_map", "never", "without", "10 mm", "1 mm", "0.1 mm")

# %% [markdown]
# Above $\lambda = 1/(2\cdot\text{limit})$ no posture asks for too much. Below it there is a wedge beside the
# singularity where it does, and a line *at* the singularity where it does not.

# %%
show("rank_loss_is_failure")

# %%
show("singular_start")

# %% [markdown]
# ### Beyond, and at the edge
#
# Targets just inside, on and just beyond the edge, and one in the hole that a limit of the elbow makes. The exact
# answer is known, so a wrong *reason* would be seen:

# %%
stiff = replace(planar((1.0, 0.8)), lower=(-np.pi, -2.0), upper=(np.pi, 2.0))
for name, chain, r in (
    ("1 mm inside the edge", pair, 1.799),
    ("on the edge", pair, 1.8),
    ("1 mm beyond", pair, 1.801),
    ("beyond, twice as far", pair, 3.6),
    ("at 0.4 m, free elbow", pair, 0.4),
    ("at 0.4 m, elbow stops at 2", stiff, 0.4),
):
    place = np.array([r * np.cos(0.7), r * np.sin(0.7), 0.0])
    one = ik(chain, place, np.array([0.2, 0.9]), restarts=20)
    print(
        f"{name:<27} {one.reason:<12} off by {one.distance:9.2e} m "
        f"after {one.iterations:4d} steps from {one.starts:2d} starts"
    )

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** A solver that returns angles has told you nothing. Ask for the residual by forward kinematics, and
# for the reason.
#
# </div>
#
# ### The null space is not straight
#
# ![A step in the null space](../docs/charts/null_space_step.png)

# %%
print_figures("null_space_step", "c =", "exact", "damped")

# %% [markdown]
# Second order for the exact projector, fourth after one step of IK, first for a damped one. Project exactly, damp the
# task.

# %%
show("projector_of_the_null_space")

# %% [markdown]
# ### Debugging table
#
# Say the cause before you open the answer.
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *IK does not converge.* Three questions, in this order. Is the target reachable at all: inside the
# annulus for two links, within the reach *and the limits* for any arm? Is the start bad: does it get there from twenty
# others? Is it beside a singularity: what is $s_{\min}$ of the rows you care about, at the place where it stops?
#
# <details><summary>What people get wrong there</summary>
#
# They raise the damping first. Damping makes a step shorter, so near an edge it makes convergence *slower*: the card
# of the listing in section 3 has the shares. And they read a condition number in millimetres.
#
# </details>
#
# </div>

# %% [markdown]
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The hand arrives, the elbow is in an awkward place.* A 7-R arm has a curve of answers, and yours
# is the one next to your start. Add a wish in the null space (elbow height, distance from an obstacle, middle of the
# joint ranges), small steps, the hand put back by one IK step after each, and stop when the projected gradient
# vanishes.
#
# <details><summary>What people get wrong there</summary>
#
# They add the wish with a damped projector, and the hand creeps. They expect the elbow to go where they want: it goes
# where the curve of answers goes, and not past a joint limit. Another *piece* of the answers, with the shoulder turned
# round, is reached by a new start, not by a gradient.
#
# </details>
#
# </div>

# %%
show("second_task")

# %% [markdown]
# <table>
# <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr>
# <tr><td>joints jump by radians for a millimetre</td> <td>pseudo-inverse beside a singularity</td> <td>print
# $1/s_{\min}$</td> <td>damp; slow down; plan around it in joint space</td></tr>
# <tr><td>nothing moves, the error stays</td> <td>$J^\mathsf{T}e=0$: stretched, target along the arm</td> <td>print
# $\lvert J^\mathsf{T}e\rvert$ beside $\lvert e\rvert$</td> <td>bend the elbow a little; another start</td></tr>
# <tr><td>it converges, ever more slowly</td> <td>fixed damping, and a target on the edge</td> <td>ratio of
# one error to the next: it goes to one</td> <td>Levenberg-Marquardt; adaptive damping</td></tr>
# <tr><td>it converges, but slowly everywhere, and FK is right</td> <td>$J$ is wrong (tool offset, frame of the
# angular rows)</td> <td>$J$ against central differences</td> <td>one point and one frame for $J$ and error</td></tr>
# </table>

# %%
predict("error_that_stays")

# %% [markdown]
# <table>
# <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr>
# <tr><td>the robot stops at a limit although IK converged</td> <td>limits not held, or off by a full turn</td>
# <td>`within(chain, q)`</td> <td>limits in every step; restarts</td></tr>
# <tr><td>a tip sags under load by what it weighs</td> <td>gravity or payload missing in the model</td> <td>torques at
# rest in two postures</td> <td>fit the base parameters</td></tr>
# </table>
#
# ## 7 · Exercises
#
# Graded exercises, and a drill for the beginning: `drills start fk3` puts forward kinematics of three links into
# your editor. Each card has the task and three hints to unfold; below it a cell to change, and a check. `check` runs
# what your cell defines in a process of its own, on cases drawn afresh every time, and says what is right, what is
# wrong and, where it recognises the mistake, why. `check(fk3).chart()` puts a right answer on a chart beside the worked
# one and Pinocchio.
#
# ### Both arms
#
# Section 1 has the triangle; here it has to hold on the edges too.

# %%
card("two_link_ik")


# %%
def two_link_ik(lengths, target):
    """Return both pairs of joint angles that bring the tip of a two-link arm to a target.

    Args:
        lengths: of both links, shape (2,) [m].
        target: of the tip, shape (2,) [m].

    Returns:
        Rows (q1, q2), shape (2, 2) [rad]: the arm with q2 >= 0, then the one with q2 <= 0.

    Raises:
        ValueError: when the target is out of reach.
    """
    # It points both arms at the target, stretched.
    direction = np.arctan2(target[1], target[0])
    return np.array([[direction, 0.0], [direction, 0.0]])


# %%
check(two_link_ik)

# %% [markdown]
# ### The Jacobian of an arm in space
#
# Axis cross line, one column a joint. Compare yours with differences before you check it: the V of section 5 says how
# close they can come.

# %%
card("jacobian")


# %%
def geometric_jacobian(placements, q, tool):
    """Return velocity and angular velocity at a tool point for each joint rate.

    Args:
        placements: of each joint in the frame before it, homogeneous, shape (n, 4, 4) [1, m].
        q: joint angles about each frame's own z, shape (n,) [rad].
        tool: the point, in the last frame, shape (3,) [m].

    Returns:
        The Jacobian in world axes, linear rows first, shape (6, n).
    """
    # Nothing moves yet.
    return np.zeros((6, len(q)))


# %%
check(geometric_jacobian)

# %% [markdown]
# ### A step that keeps its bound
#
# Also where the Jacobian is zero, and where the damping squared would drown in rounding.

# %%
card("damped_step")


# %%
def damped_step(J, error, damping):
    """Return one step of damped least squares.

    Args:
        J: Jacobian, shape (m, n) [m/rad].
        error: what the tip has yet to move, shape (m,) [m].
        damping: positive [m/rad].

    Returns:
        The step dq, shape (n,) [rad].
    """
    # This one has no bound.
    return np.linalg.pinv(J) @ error


# %%
check(damped_step)

# %% [markdown]
# ### Hold the tip, move the elbow
#
# With joints that don't count alike: the projector is then no longer symmetric.

# %%
card("null_space_step")


# %%
def null_space_step(J, dx, secondary, weights):
    """Return the step that moves the tip by dx and, for the rest, follows a second wish.

    Args:
        J: Jacobian, shape (m, n) [m/rad].
        dx: of the tip, shape (m,) [m].
        secondary: what the joints would like to do, shape (n,) [rad].
        weights: of the joints, shape (n,).

    Returns:
        The step, shape (n,) [rad].
    """
    # It does what the elbow likes, and the tip comes along.
    return np.array(secondary, dtype=float)


# %%
check(null_space_step)

# %% [markdown]
# ### Torques, out and back
#
# In one pass outwards and one inwards; a hundred links cost ten times what ten cost.

# %%
card("rnea_planar")


# %%
def rnea_planar(lengths, masses, q, v, a, gravity):
    """Return joint torques of a planar arm of uniform rods.

    Args:
        lengths: of the links, shape (n,) [m].
        masses: of the links, shape (n,) [kg].
        q: joint angles, each relative to the link before, shape (n,) [rad].
        v: their rates, shape (n,) [rad/s].
        a: their accelerations, shape (n,) [rad/s^2].
        gravity: downwards, along -y [m/s^2].

    Returns:
        Torques at the joints, shape (n,) [N m].
    """
    # Each link for itself, as if it hung on a wall: no gravity, no other link.
    return np.asarray(masses) * np.asarray(lengths) ** 2 / 3.0 * np.asarray(a)


# %%
check(rnea_planar)

# %% [markdown]
# ### Silent-bug hunt
#
# IK checks itself: the loop runs until forward kinematics agrees. That is what makes it a good place for a bug to hide.
# A first one, to see what it looks like: this loop takes the Jacobian at the flange, although the tool sticks out.

# %%
longer = replace(arm, tool=(0.0, 0.25, 0.107 + 0.25, 1.0, 0.0, 0.0, 0.0))
flange = np.array([0.0, 0.0, 0.107])
goals = tip(longer, q[:, None] + np.random.default_rng(2).uniform(-0.3, 0.3, (7, 200)))
for name, point in (("at the tool", longer.tool[:3]), ("at the flange", flange)):
    steps = []
    for goal in goals.T:
        x, e, count = q, kinematics.pose_error(goal, tip(longer, q)), 0
        while np.abs(e).max() > 1e-6 and count < 60:
            x = x + np.linalg.pinv(jacobian(longer, x, point, joint=6)) @ e
            e, count = kinematics.pose_error(goal, tip(longer, x)), count + 1
        steps.append(count)
    print(
        f"J {name:<13}: {np.mean(np.array(steps) < 60):.0%} arrive "
        f"in {np.median(steps):.0f} steps (median); 20 N sideways "
        f"ask for {listed((jacobian(longer, q, point, joint=6)[:3].T @ (0.0, 20.0, 0.0))[:3])} N m"
    )

# %% [markdown]
# The answers of both are right, and who would notice two more steps? A wrong Jacobian shows in the *number of steps*,
# or in a comparison with differences; never in the residual. The same matrix turns forces into torques, shown for the
# first three joints, and nothing corrects those.
#
# Now yours. It reports success every time, and on the robot it tears a cable.

# %%
card("wrist_ik")


# %%
def wrist_ik(q, target, damping, steps):
    """Return joint angles that turn a wrist of three joints to a target orientation.

    Args:
        q: joint angles at the start, about z, then y, then x, shape (3,) [rad].
        target: orientation of the hand, unit quaternion (w, x, y, z), shape (4,).
        damping: of the steps, positive.
        steps: how many.

    Returns:
        The angles after all steps, shape (3,) [rad].
    """

    def product(p, r):
        (w, x, y, z), (a, b, c, d) = p, r
        return np.array(
            [
                w * a - x * b - y * c - z * d,
                w * b + x * a + y * d - z * c,
                w * c - x * d + y * a + z * b,
                w * d + x * c - y * b + z * a,
            ]
        )

    def about(axis, angle):
        turn = [math.cos(angle / 2), 0.0, 0.0, 0.0]
        turn[1 + axis] = math.sin(angle / 2)
        return turn

    q = np.array(q, dtype=float)
    for _ in range(steps):
        hand = product(about(2, q[0]), product(about(1, q[1]), about(0, q[2])))
        left = product(target, hand * [1.0, -1.0, -1.0, -1.0])
        error = 2.0 * left[1:]  # of a small turn, its vector
        c, s = math.cos(q[0]), math.sin(q[0])
        J = np.array(
            [
                [0.0, -s, c * math.cos(q[1])],
                [0.0, c, s * math.cos(q[1])],
                [1.0, 0.0, -math.sin(q[1])],
            ]
        )
        q = q + 0.3 * J.T @ np.linalg.solve(J @ J.T + damping**2 * np.eye(3), error)
    return q


# %%
check(wrist_ik)

# %% [markdown]
# ### Formulas
#
# These are checked symbolically: any equivalent form is right, and a wrong one gets numbers at which it differs.
# <span class="kernel-only">Change the texts.</span>

# %%
answer("two_link_jacobian", "l1*l2*sin(q2)")

# %%
answer("damped_gain", "1/lambda")

# %% [markdown]
# Others to try: `damping_is_free` (the share of an error that a damped step leaves), `null_motion_leaves_the_tip` (how
# far a step in the null space moves the tip), `projector_of_the_null_space` (the largest leak of a damped projector),
# `second_task` (the share of a wish that survives).
#
# ## 8 · Frontier: learned inverse kinematics

# %%
predict("what_a_learned_start_must_beat")

# %% [markdown]
# For planning and grasping one wants *many* postures for a pose, at once: spread over all its answers, near no
# obstacle. A **normalizing flow** bends a cloud of noise into a cloud of postures, given the pose; one pass gives
# thousands of candidates.
#
# <table>
# <tr><th>work</th> <th>year</th> <th>what it does</th></tr>
# <tr><td>TRAC-IK (Beeson and Ames, Humanoids)</td> <td>2015</td> <td>two classical solvers with restarts in parallel:
# the baseline that a learned one has to beat</td></tr>
# <tr><td>IKFlow (Ames, Morgan and Konidaris, IEEE RA-L 7)</td> <td>2022</td> <td>a conditional flow for one arm; its
# samples are near, and are refined by a classical solver</td></tr>
# <tr><td>Neural Inverse Kinematics (Bensadoun and others, ICML)</td> <td>2022</td> <td>joint after joint, each drawn
# given those before</td></tr>
# <tr><td>GGIK (Limoyo and others, arXiv 2209.08812)</td> <td>2022</td> <td>one graph network for many arms</td></tr>
# <tr><td>cuRobo (Sundaralingam and others, ICRA)</td> <td>2023</td> <td>not learned: thousands of starts optimised at
# once on a GPU, with collisions</td></tr>
# <tr><td>IK-Geo (Elias and Wen)</td> <td>2022</td> <td>not learned: all answers of a six-joint arm by geometric
# subproblems</td></tr>
# <tr><td>PyRoki (Kim, Yi and others, arXiv 2505.03728)</td> <td>2025</td> <td>not learned: differentiable kinematics
# and least squares on CPU and GPU</td></tr>
# </table>

# %%
show("flow_samples_all")

# %% [markdown]
# A small one runs here: a network with several heads, trained for less than a minute, proposes starts for
# Levenberg-Marquardt. Left, the 7-R arm, solved within a budget of steps; right, a planar arm of three joints, whose
# curve of answers is known exactly, so that *coverage* can be measured:
#
# ![Starts: uniform, from a table, learned](../docs/charts/learned_seeds.png)

# %%
figures(read("learned_seeds"), summary="Shares solved and answers covered")

# %% [markdown]
# Ours ties with the table in steps, and covers no more: here training bought nothing that a table does not have.
#
# **Differentiable kinematics.** Forward kinematics is a product of smooth functions, so a gradient runs through it:
# from a loss on grasps, pictures or contacts back to joint angles, and even to link lengths. The Jacobian of section 5
# by PyTorch's reverse mode is that gradient, row by row. It is exact, and costs what the chart says; what a gradient
# cannot do is to jump from one piece of the answers to another.
#
# ## 9 · Interview
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** Asked about IK, give the step in a sentence and spend the minute on how it fails: a target out of
# reach (show the residual), a singularity (say what the gain is there, and *beside* it), several answers (which one
# comes out depends on the start), limits (hold them in the step, start again when stuck). For seven joints name the
# null space, and say that it is a tangent: step, project, put the hand back. Then say how you would know that your
# Jacobian is right.
#
# </div>
#
# Answer aloud, then open: first what one says in a minute, then the whole of it, then what comes next.

# %%
interview("kinematics")

# %% [markdown]
# ### Checkpoint
#
# Three formulas that are not on this page; you can derive them from what is. The gate opens when all are right.

# %%
checkpoint(
    "kinematics",
    two_link_mass_matrix="",
    reachable_annulus="",
    pseudo_inverse_beside="",
)
