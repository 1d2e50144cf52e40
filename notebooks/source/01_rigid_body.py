# %% [markdown]
# # 1 · Rigid bodies
#
# *Your simulated robot stands still, and its energy grows. A part tumbles through the air and turns the wrong way. A
# simulation with a stiff gripper explodes at one step size and runs well at another. In all three, the time step is
# to blame: how long it is, or how it is coded.*
#
# A simulator advances time in small **steps**. In each step it updates the velocity of a body and its position. Does it
# matter which of the two comes first?
#
# About {open minutes} minutes of reading, cards and charts. The folded parts add {folded minutes} minutes, the
# exercises {exercise minutes} minutes. (The interview questions of section 10 are not counted.)
# %%
from course.cards import predict
from course.simulations import simulation

predict("energy_of_a_fall")
# %% [markdown]
# ![Rigid body simulator: bouncing box](attachment:rigid_body.bouncing_box.png)
# %%
simulation("bouncing_box")
# %% [markdown]
# The menu offers **presets**, prepared settings. Choose the second (old velocity), then the third (new velocity). In
# both, impacts are found within the step and lose no energy, so every change of energy is an error of the flight.
# *Steps not resolved* counts the steps with more impacts than the program may compute in one step.
#
# **After this chapter you can** write the equations of motion of a rigid body; store and update an orientation without
# drift; choose an integrator, the method that computes a time step, by its error for a given cost; predict the largest
# stable step; and find the cause when a simulation explodes, misses a wall or gains energy. You need vectors, matrices
# with eigenvalues, derivatives, simple differential equations ([a refresher](../docs/mathematics/README.md)), and
# Python with NumPy.
#
# ## How this chapter works
#
# Some cards show a common claim. Answer *only under a condition* if the claim needs a condition that it does not
# state. Six exercises wait in section 8:
# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint

badges(1)
# %% tags=["hide-code"]
import inspect
import re
import textwrap

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

from course import rigid_body
from course.cards import figures, interview
from course.charts import read
from course.charts.rigid_body import accuracy
from course.derivations import more_claims, show
from course.rigid_body import planar, problems, quaternion


def source(*functions):
    """Show functions as they are in the module, without their docstrings."""
    text = "\n\n".join(inspect.getsource(f).removeprefix("@register_jitable\n") for f in functions)
    return Markdown("```python\n" + re.sub(r'\n    """.*?"""', "", text, flags=re.S) + "```")


# %% [markdown]
# ## 1 · Concept: what moves, and by which law
#
# ### How many numbers describe a rigid body?
#
# A **rigid body** is a body that keeps its shape. Its centre of mass can move along three axes, and the body can
# rotate about three, so it has six **degrees of freedom**. Position and orientation together are called the **pose**.
# Newton's law gives only accelerations, so to predict the motion you also need six velocities, three of the centre
# and three of the rotation. The **state** is all that you need to predict the motion under known forces, here pose
# and velocities: twelve numbers.
# %% tags=["hide-code"]
corner = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
edges = [(a, b) for a in range(8) for b in range(a) if np.sum(corner[a] != corner[b]) == 1]
sheet = np.array([[-0.55, 1.0, 0.0], [-0.35, -0.17, 1.0]])  # x to the front, y right, z up


def draw_box(axes, pose, colour, sides=(0.5, 0.8, 0.3), mark=True):
    """Draw the edges of a box, and with `mark` its long axis, in an oblique view."""
    flat = (corner * sides) @ pose.T @ sheet.T
    for a, b in edges:
        axes.plot(*flat[[a, b]].T, color=colour, lw=1.4)
    if mark:
        axis = np.array([[0, 0.8, 0], [0, 1.25, 0]]) @ pose.T @ sheet.T
        axes.plot(*axis.T, color=colour, lw=3)


figure_, axes_ = plt.subplots(figsize=(6.5, 3.6), layout="constrained")
draw_box(axes_, np.eye(3), "0.35", mark=False)
round_ = np.linspace(0.3, 2 * np.pi - 0.7, 40)
for k, (colour, name) in enumerate((("tab:blue", "x"), ("tab:orange", "y"), ("tab:green", "z"))):
    unit, across = np.eye(3)[k], np.roll(np.eye(3), -k - 1, axis=0)[:2]
    reach = 0.6 if name == "x" else 0.0  # the axis that points at the reader is drawn longer
    tip, base = sheet @ ((2.0 + reach) * unit), sheet @ (0.75 * unit)
    axes_.annotate("", tip, base, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2})
    ring = (1.5 + reach) * unit + 0.3 * (
        np.cos(round_)[:, None] * across[0] + np.sin(round_)[:, None] * across[1]
    )
    flat = ring @ sheet.T
    axes_.plot(*flat.T, color=colour, lw=1.5)
    axes_.annotate("", flat[-1], flat[-4], arrowprops={"arrowstyle": "-|>", "color": colour})
    place = (-130, -14) if name == "x" else (6, -4)
    axes_.annotate(f"along and about {name}", tip, place, textcoords="offset points", color=colour)
axes_.set(aspect="equal", title="six degrees of freedom", xlim=(-4.0, 3.8), ylim=(-1.5, 2.3))
axes_.axis("off")
plt.show()
# %% [markdown]
# How many numbers you *store* depends on how you write the orientation. The set of all orientations is called
# **SO(3)** (special orthogonal group). It has three dimensions. But whichever three numbers you choose, at some
# orientations a small turn changes them by a huge amount, as a small step near the North Pole changes your longitude.
# There the three are **singular**:
#
# | orientation stored as | numbers | with position and velocities | drawback |
# |---|---|---|---|
# | three successive rotation angles, the **Euler angles** | 3 | 12 | singular at some orientations |
# | a unit **quaternion**, explained below | 4 | 13 | one constraint, length 1; $q$ and $-q$ are the same orientation |
# | a rotation matrix | 9 | 18 | six constraints (three unit columns, three right angles), and no mirror image |
# %%
more_claims("state_is_six_quantities", "state_with_quaternion", "planar_state")
# %% [markdown]
# ### Free rotation: what stays constant without torque
#
# Throw a book into the air with a spin. Nothing touches it, yet it wobbles.
#
# A piece of mass $dm$ at the distance $r$ from an axis resists every change of a rotation about it, in proportion to
# $r^2$. Summed over the body, this gives the **moments of inertia**. About the axes $x$, $y$ and $z$ through the centre
# of mass they are
#
# $$I_x = \int (y^2+z^2)\,dm, \qquad I_y = \int (x^2+z^2)\,dm, \qquad I_z = \int (x^2+y^2)\,dm .$$
#
# For most axes there are also mixed terms such as $-\int xy\,dm$. Moments and mixed terms form the **inertia tensor**
# $I$, a symmetric 3 × 3 matrix, which has three perpendicular eigenvectors. Each is a **principal axis**, its
# eigenvalue a principal moment. In these axes $I$ is diagonal. A homogeneous box has its principal axes parallel to
# its edges.
#
# The tensor connects the **angular velocity** $\omega$ (along the axis of rotation, its length the rate in rad/s)
# with the **angular momentum** $L = I\omega$.
#
# Without torque, $L$ is constant in space. But the body turns, and $I$, seen from space, turns with it. To keep $L =
# I\omega$ constant, $\omega$ usually has to change too: the axis of rotation moves, and the book wobbles. The
# exception is a spin about a principal axis. There $L$ and $\omega$ are parallel, and both stay constant.
#
# In the simulation below, $\omega$ sweeps out a surface, the green *space cone*, which need not be round or closed.
# Seen from the body, $\omega$ sweeps out the pink *body cone*; the path of its tip there is the **polhode**. No torque
# does work, so the energy $\tfrac12\,\omega\cdot L$ is constant, like $L$. So the part of $\omega$ along $L$ is
# constant too: the tip of $\omega$ stays in the grey plane, perpendicular to $L$.
# %%
show("free_body_keeps_angular_velocity")
# %%
simulation("free_body")
# %% [markdown]
# ### The equations of motion
#
# Force changes the momentum $p = mv$, and torque about the centre of mass changes the angular momentum. Both laws hold
# in the world frame, which does not rotate:
#
# $$\dot p = F, \qquad \dot L = \tau, \qquad p = m v, \quad L = I\omega .$$
#
# These are the **Newton-Euler** equations. In the world frame, $I$ changes as the body turns. In a frame that is fixed
# to the body, $I$ is constant, but there the second equation gets an extra term:
#
# $$\boxed{\; m\,\dot v = F \ \text{(world frame)}, \qquad I\,\dot\omega + \omega\times(I\omega) = \tau \ \text{(body
# frame)} \;}$$
#
# The product $\omega\times(I\omega)$ is the **gyroscopic term**. It is not a torque that acts on the body. It appears
# because you describe $L$ from a frame that rotates: seen from a turning chair, a fixed lamp moves the other way. The
# term is zero if $L$ and $\omega$ are parallel: in a spin about a principal axis, or if all three moments are equal.
#
# <details><summary>Derive it: where the extra term comes from</summary>
#
# Let $u$ be the components of a vector in the body frame. If the vector is constant in the world, the body frame turns
# past it with $\omega$, so its components change with $\dot u = -\omega\times u$. If it also changes in the world, then
# the rate in the world, written in body components, is $\dot u + \omega\times u$. Apply this to $L = I\omega$, where
# $I$ is constant in the body frame: the rate of $L$ in the world is $I\dot\omega + \omega\times(I\omega)$. By Newton
# and Euler it equals the torque.
#
# </details>
#
# **Worked example.** A body with the moments 1, 2 and 3 kg m² has the angular velocity $\omega = (1, 1, 0)$ rad/s and
# no torque. Then $L = (1, 2, 0)$, and $\omega\times L = (0, 0, 1\cdot 2 - 1\cdot 1) = (0, 0, 1)$ N m. So
# $\dot\omega = (0, 0, -\tfrac13)$ rad/s²: the body starts to rotate about its third axis.
#
# <div class="alert alert-block alert-warning">
#
# **Key insight.** A free body keeps its angular momentum $L$, but in general not its angular velocity $\omega$.
#
# </div>
# %%
more_claims(
    "force_is_mass_times_acceleration",
    "planar_torque",
    "euler_equation_point",
    "gyroscopic_term_always_there",
    "wobble_comes_from_the_term",
)
# %% [markdown]
# ### Stable and unstable axes
#
# Take a brick with three different sides. A spin about any of its three principal axes is an exact solution of the
# equations. But what does a small disturbance do?
# %%
predict("brick_that_flips")
# %%
simulation("flip")
# %% [markdown]
# Along the longest side, the brick has its smallest moment, along the shortest side its largest. So the axis along the
# middle side is that of the middle moment: the **middle axis**, grey in the simulation. After a flip it points the
# other way. (Lower chart: the rate about the two other axes.)
#
# To see why, look at $L$ in the body frame, with its components $L_i$ along the principal axes. The length of $L$ is
# constant, so its tip stays on a sphere. The energy $\tfrac12\,\omega\cdot L = \sum_i L_i^2/(2I_i)$ is constant, too,
# so the tip also stays on an ellipsoid. It runs along a curve in which the two meet.
#
# Close to the axes of the smallest and of the largest moment, the curves are small closed loops. On the middle axis
# two curves cross, and an $L$ that starts near the crossing moves all the way to the opposite side and back:
# %% tags=["hide-code"]
moments = np.array([1.0, 2.0, 3.0])


def momentum_paths(starts, steps, dt=0.01):
    """Return the angular momenta of free bodies in their frames, by RK4, (n, steps + 1, 3)."""
    path = [np.array([np.array(start) / np.linalg.norm(start) for start in starts])]
    for _ in range(steps):
        stages = [np.zeros_like(path[0])]
        for share in (0.0, 0.5, 0.5, 1.0):
            moved = path[-1] + share * dt * stages[-1]
            stages.append(np.cross(moved, moved / moments))
        path.append(path[-1] + dt / 6 * (stages[1] + 2 * stages[2] + 2 * stages[3] + stages[4]))
    return np.swapaxes(path, 0, 1)


towards = np.array([1.0, 1.25, 0.75]) / np.linalg.norm([1.0, 1.25, 0.75])
across = np.cross([0.0, 0.0, 1.0], towards) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], towards))
plane = np.array([across, np.cross(towards, across)])
figure_, (left, right) = plt.subplots(
    1, 2, figsize=(11.5, 4.4), width_ratios=(1.3, 1), layout="constrained"
)
left.add_patch(plt.Circle((0, 0), 1, facecolor="0.95", edgecolor="0.6"))
starts = {
    "tab:blue": [(1, 0.25, 0), (1, 0.5, 0), (1, 0.8, 0)],
    "tab:green": [(0, 0.25, 1), (0, 0.5, 1), (0, 0.8, 1)],
    "tab:red": [(0.02, 1, 0), (-0.02, 1, 0), (0.02, -1, 0), (-0.02, -1, 0)],
}
paths = momentum_paths([start for several in starts.values() for start in several], 4000)
colours = [colour for colour, several in starts.items() for _ in several]
for colour, path in zip(colours, paths, strict=True):
    flat, front = path @ plane.T, path @ towards > 0
    left.plot(*np.where(front[:, None], flat, np.nan).T, color=colour, lw=1.6)
    left.plot(*np.where(front[:, None], np.nan, flat).T, color=colour, lw=0.7, ls=":")
left.plot([], [], color="0.5", ls=":", lw=0.9, label="on the far side")
left.legend(loc="lower right", fontsize=9, frameon=False)
names = ("1: smallest moment", "2: middle moment", "3: largest moment")
for axis, name, place in zip(plane.T, names, ((-125, 45), (65, 0), (85, -2)), strict=True):
    left.plot(*axis, "ko", ms=4)
    left.annotate(
        name,
        axis,
        place,
        textcoords="offset points",
        fontsize=9,
        arrowprops={"arrowstyle": "-", "lw": 0.6},
    )
left.set(
    xlim=(-1.75, 1.95),
    ylim=(-1.05, 1.05),
    aspect="equal",
    title="paths of $L$ in the body, moments 1, 2, 3 kg m²",
)
left.axis("off")
time = 0.01 * np.arange(4001)
spins = momentum_paths([(1, 0.02, 0), (0.02, 1, 0), (0, 0.02, 1)], 4000)
for row, colour in enumerate(("tab:blue", "tab:red", "tab:green")):
    right.plot(
        time,
        spins[row, :, row],
        color=colour,
        label=f"axis {row + 1}",
        lw=5 if row == 0 else 1.8,  # axes 1 and 3 give the same line
        alpha=0.4 if row == 0 else 1,
    )
right.set(
    xlabel="time [s]",
    ylabel="component of $L$ along that axis",
    ylim=(-1.2, 1.2),
    title="|L| = 1 N m s, disturbance of 2 %",
)
right.legend(loc="center right", title="spin about", fontsize=9)
plt.show()
lowest = [spins[row, :, row].min() for row in range(3)]
print("component of L along the axis of the spin, as a share of |L|: lowest value in 40 s")
print("   ".join(f"about axis {k}: {x:+.3f}" for k, x in enumerate(lowest, 1)))
# %% [markdown]
# Let the body spin at the rate $\Omega$ about its middle axis, with moments $I_1 < I_2 < I_3$. A small disturbance
# grows like $e^{\sigma t}$ with
#
# $$\sigma = \Omega\,\sqrt{\frac{(I_2-I_1)(I_3-I_2)}{I_1\,I_3}} .$$
#
# **Worked example.** A brick of 2 kg measures 20 × 10 × 6 cm. For a box, $I_x = \tfrac{m}{12}(b^2+c^2)$ with the two
# other sides $b$ and $c$. That gives 2.267, 7.267 and 8.333 in units of $10^{-3}$ kg m². The root is
# $\sqrt{5.000\cdot1.066/(2.267\cdot8.333)} = 0.53$. At $\Omega = 10$ rad/s a disturbance grows by the factor 2.72
# every $1/5.3 = 0.19$ s.
#
# <details><summary>Derive it: the rate of growth</summary>
#
# Put $\omega = (\epsilon_1, \Omega, \epsilon_3)$ with small $\epsilon$ into the equations. To first order
# $I_1\dot\epsilon_1 = (I_2 - I_3)\,\Omega\,\epsilon_3$ and $I_3\dot\epsilon_3 = (I_1 - I_2)\,\Omega\,\epsilon_1$: each
# disturbance drives the other. Differentiate the first equation and insert the second:
#
# $$\ddot\epsilon_1 = \sigma^2\epsilon_1, \qquad \sigma^2 = \Omega^2\,\frac{(I_2-I_1)(I_3-I_2)}{I_1 I_3} .$$
#
# If $I_2$ is the largest or the smallest of the three, the product is negative. Then $\sigma$ is imaginary, and the
# disturbance oscillates instead of growing. The flips themselves are regular: their period is an elliptic integral.
#
# </details>
# %%
more_claims("principal_axis_is_stable", "tumbling_is_irregular")
# %% [markdown]
# ### What keeps a spinning top up?
#
# A spinning top leans over and does not fall. Gravity exerts a torque about its tip. This torque is horizontal and
# perpendicular to the axis. Without spin, $L$ starts at zero and grows along the torque: the top falls over. With a
# fast spin, there is already a large $L$, nearly along the axis. At every instant the torque adds a small sideways
# piece to it, so the axis turns sideways.
#
# This is called **precession**. With the distance $l$ from the tip to the centre of mass, its rate is about $mgl/L$
# for a fast spin. If you release a top that spins but has no precession yet, its axis also nods up and down
# (**nutation**). In the simulation, the blue line is the path of the top's axis. Raise the spin: $L$ moves closer to
# the axis.
# %%
show("gyroscopic_term_holds_the_top_up")
# %%
simulation("top")
# %% [markdown]
# An upright top survives a small push only if its spin $\Omega$ is fast enough (the bar in the simulation). With
# the moments $I_3$ about its axis and $I_1$ across it (both about the tip), the condition is $(I_3\,\Omega)^2 >
# 4\,I_1\,m g\,l$.
# %%
more_claims(
    "top_condition",
    "gyroscopic_term_is_negligible",
    "robotics_cannot_drop_the_term",
)
# %% [markdown]
# ### Checking an inertia tensor
#
# A robot model comes as a file with a mass and an inertia tensor for each rigid part, a **link**. Some published
# files contain tensors that no body can have. You can check them with the three integrals above. Add two of them and
# subtract the third: $I_x + I_y - I_z = 2\int z^2\,dm$, which is never negative. So about any three perpendicular
# axes, each moment is at most the sum of the other two. If the *principal* moments meet this condition, some body has
# the tensor.
# %%
predict("inertia_of_a_thin_rod")
# %% [markdown]
# The course's `RigidBody` class makes the same check:
# %% tags=["show-code"]
try:
    rigid_body.RigidBody(mass=1.0, inertia=(1.0, 1.0, 3.0))
except ValueError as problem:
    print(textwrap.fill(str(problem), 96))
# %% [markdown]
# Next, check about which point the tensor is given. By the **parallel axis** theorem, the moment about a parallel
# axis at the distance $d$ from the one through the centre of mass is larger by $m d^2$. A rod of mass $m$ and length
# $a$ has $\tfrac1{12}ma^2$ about its middle and $\tfrac1{12}ma^2 + m(\tfrac a2)^2 = \tfrac13ma^2$ about its end: four
# times as much.
#
# <details><summary>For the whole tensor</summary>
#
# For a displacement vector $d$ add $m(\lvert d\rvert^2\,1 - d\,d^{\mathsf T})$, with the identity matrix $1$.
#
# </details>
#
# ### Euler angles and gimbal lock
#
# Three angles can describe the orientation of an aircraft. First turn it by the **yaw** about the axis $z$, which
# points up as usual in robotics. Then turn it by the **pitch** $\theta$ about its new $y$ axis, and then by the
# **roll** about its new $x$ axis, which points to the nose. With $z$ up, a positive $\theta$ turns the nose down.
#
# At $\theta = -90°$ the nose points straight up, at $+90°$ straight down. There yaw and roll turn about the same
# line: the nose can move only about the pitch axis. This is **gimbal lock**. Set the pitch to 90° and watch the blue
# ring (yaw) and the violet ring (roll):
# %%
simulation("gimbal")
# %% [markdown]
# A matrix $E$ converts the three angle rates into the angular velocity. Its determinant is $\lvert\det E\rvert =
# \lvert\cos\theta\rvert$. At $\theta = \pm90°$ its rank is only two. Then one direction, the *lost axis*, is missing:
# no angle rates can turn the body about it. Near the lock, such a turn needs huge rates.
#
# Take the three angle rates as one vector of length 1 rad/s and try all its directions. The smallest angular speed
# that results is the smallest **singular value** of $E$ (*weakest turn* in the simulation). The body then turns about
# the *weakest axis*. At the lock this speed is zero, and the weakest axis becomes the lost axis.
# %% tags=["hide-code"]
print("angle rates needed to turn at 1 rad/s about the weakest axis")
for angle in (60.0, 89.0, 90.0):
    E = quaternion.euler_zyx_rate_matrix(np.radians(angle), 0.3)
    _, values, right_vectors = np.linalg.svd(E)
    rates = np.abs(right_vectors[2]) / max(values[2], 1e-12)
    needed = (
        f"length of the three rates {np.linalg.norm(rates):5.1f} rad/s, yaw {rates[0]:5.1f} rad/s"
    )
    if values[2] < 1e-12:
        needed = "no finite rates"
    print(f"pitch {angle:.0f}°, rank of E {np.linalg.matrix_rank(E)}: {needed}")
# %%
show("gimbal_lock_is_physical")
# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Gimbal lock is a fault of the three angles, not of the body. Every choice of three successive angles
# has it at some orientation.
#
# </div>
# %%
more_claims(
    "gimbal_lock_rank",
    "gimbal_lock_at_one_attitude",
    "pointing_up_locks",
    "another_order_of_angles",
)
# %% [markdown]
# ### Quaternions: four numbers, no gimbal lock
#
# Every orientation can be reached from the reference orientation with one rotation, by an angle $\alpha$ about a unit
# vector $n$. This is the **axis-angle** form. A unit quaternion stores it with *half* the angle:
#
# $$q = (w, x, y, z) = \left(\cos\tfrac{\alpha}{2},\; n\sin\tfrac{\alpha}{2}\right).$$
#
# A quarter turn about $z$ is $q = (\cos 45°, 0, 0, \sin 45°) = (0.707, 0, 0, 0.707)$. The map from the *rotation
# vector* $\alpha n$ to $q$ is called the **exponential map**, $q = \exp(\alpha n)$. Its inverse is the logarithm,
# $\log q = \alpha n$, for $\alpha < \pi$. (If $w < 0$, take $-q$, the same orientation.)
#
# To rotate first by $q$ and then by $p$, both about axes fixed in space, multiply: $p\,q$ (*Hamilton's product*). With
# the scalar part $w$ and the vector part $u = (x,y,z)$ it is
#
# $$p\,q = \left(w_p w_q - u_p\cdot u_q,\;\; w_p u_q + w_q u_p + u_p\times u_q\right).$$
#
# Because of the cross product, the order matters, as it does for rotations. The conjugate $q^* = (w, -u)$ is the
# inverse rotation, and $q\,(0, r)\,q^*$ is the rotated vector $r$. If $\omega$ is given in *body* coordinates, then $q$
# changes at the rate
#
# $$\dot q = \tfrac12\, q\,(0, \omega) .$$
#
# <details><summary>Derive it: the rate of q</summary>
#
# In a short time $dt$ the body turns by $\omega\,dt$. This rotation has the quaternion $\exp(\omega\,dt) \approx (1,
# \tfrac12\omega\,dt)$. It acts first, in body coordinates, so it stands on the right: $q + dq = q\,(1,
# \tfrac12\omega\,dt)$.
#
# </details>
#
# Multiplication by a unit quaternion does not change lengths. So a rotation at the rate $\lvert\omega\rvert$ always
# moves $q$ at the speed $\tfrac12\lvert\omega\rvert$, whatever the orientation: there is no lock.
# %%
show("quaternion_has_no_lock")
# %% [markdown]
# After a full turn, $\alpha = 2\pi$, the body is back where it started, but $q$ has arrived at $-q$. So each
# orientation has two quaternions, $q$ and $-q$. This is called the **double cover**. Turn the body once and watch the
# arrow on the right, which only makes half a turn:
# %%
simulation("double_cover")
# %% [markdown]
# Before you subtract or interpolate two quaternions $p$ and $q$, make their signs agree: if the dot product is
# negative, flip the sign of one of them. Otherwise a **controller**, the program that commands the motors, may order
# a turn of nearly 360 degrees for an error of nearly zero.
#
# **SLERP**, spherical linear interpolation, turns from one orientation to another at a constant rate, along the arc
# between the two quaternions: $p\,\exp(t\,\log(p^*q))$ for $t$ from 0 to 1. If you mix the four numbers linearly and
# scale the result to length one, you follow the same arc, but not at a constant rate.
#
# When you need the rotation matrix $R$, **Rodrigues'** formula computes it from axis and angle. With the identity
# matrix $1$ and the matrix $[n]_\times$ for which $[n]_\times u = n\times u$ it is
#
# $$R = 1 + \sin\alpha\,[n]_\times + (1-\cos\alpha)\,[n]_\times^2 .$$
# %% tags=["show-code"]
axis, angle = np.array([2.0, -1.0, 2.0]) / 3.0, 0.7
K = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
rodrigues = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
same = np.allclose(quaternion.to_matrix(quaternion.exp(angle * axis)), rodrigues, atol=1e-14)
print("Rodrigues' matrix and the quaternion's agree:", same)

# %% tags=["show-code"]


def slerp(p, q, t):
    """Return the orientation a share t of the way from p to q, along the shorter arc."""
    q = q if p @ q >= 0.0 else -q
    return quaternion.product(
        p, quaternion.exp(t * quaternion.log(quaternion.product(quaternion.conjugate(p), q)))
    )


start, end = quaternion.identity(), quaternion.exp(2.8 * axis)
for name, quarter in (
    ("SLERP", slerp(start, end, 0.25)),
    ("mixed linearly and scaled", 0.75 * start + 0.25 * end),
):
    turned = quaternion.angle_between(start, quaternion.normalise(quarter))
    print(f"t = 0.25, {name:<26}: {100 * turned / 2.8:4.1f} % of the angle")
# %%
more_claims("quaternion_is_unique")
# %% [markdown]
# ## 2 · Concept: how a computer moves it
#
# ### Explicit and semi-implicit Euler
#
# The equations give accelerations. An **integrator** turns them into motion: it advances the state by one time step
# $h$ (`dt` in code). From here on, $q$ stands for all position coordinates (orientations follow below), $v$ for the
# velocity, $a$ for the acceleration at the start of the step, and a prime for values after the step.
# **Explicit Euler** uses only values that are known at the start of the step:
#
# $$q' = q + h\,v, \qquad v' = v + h\,a .$$
#
# **Semi-implicit Euler** updates the velocity first and moves with the *new* velocity:
#
# $$v' = v + h\,a, \qquad q' = q + h\,v' .$$
#
# Only the order of two lines differs, but it decides how the energy behaves. The picture shows a mass on a spring,
# with its velocity plotted against its position. In the units used here, the exact motion is a circle:
# %% tags=["hide-code"]
figure_, (left, right) = plt.subplots(1, 2, figsize=(10, 3.9), layout="constrained")
turn = np.linspace(0, 2 * np.pi, 200)
for axes_, h, counts in ((left, 0.25, (50, 50)), (right, 1.0, (4, 6))):
    axes_.plot(np.cos(turn), np.sin(turn), color="0.6", lw=1, label="exact: a circle")
    for name, colour, count in zip(
        ("explicit Euler", "semi-implicit Euler"), ("tab:red", "tab:blue"), counts, strict=True
    ):
        states = [(1.0, 0.0)]
        for _ in range(count):
            x, v = states[-1]
            late = v - h * x
            states.append((x + h * (v if name == "explicit Euler" else late), late))
        axes_.plot(*zip(*states, strict=True), "o-", color=colour, ms=3, lw=1, label=name)
    axes_.set(
        xlabel="position", ylabel="velocity", aspect="equal", title=f"a spring, $\\omega h$ = {h:g}"
    )
figure_.legend(*right.get_legend_handles_labels(), loc="outside lower center", ncols=3)
plt.show()
grown = (1 + 0.25**2) ** 50
print(f"left: after 50 steps explicit Euler has {grown:.0f} times the energy")
# %% [markdown]
# With the old velocity, each step leaves its circle along the tangent, and a tangent always leads outwards. With the
# new velocity and these two step sizes, the points stay on a closed curve, an ellipse.
# %%
show("usual_listing_is_explicit")
# %%
more_claims(
    "swapping_two_lines",
    "explicit_energy_factor",
    "explicit_adds_always",
    "explicit_adds_without_forces",
    "semi_implicit_dissipates",
    "semi_implicit_energy_swing",
)
# %% [markdown]
# ### The stability limit of a step
#
# A gripper closes on a stiff part, and the simulation explodes. A mass $m$ on a spring is enough to find the limit.
# If a spring of **stiffness** $k$ is stretched by $x$, it pulls back with the force $kx$. So $\ddot x = -\omega^2 x$
# with the angular frequency $\omega = \sqrt{k/m}$. Near a stable resting position, most systems with forces from a
# potential energy act like several independent springs. Each stands for a *mode of vibration*, a pattern in which all
# parts swing at one frequency.
#
# On a spring, a step multiplies the state $(x, v)$ by a fixed matrix $A$. For semi-implicit Euler, insert the new
# velocity into the position:
#
# $$\begin{pmatrix}x'\\ v'\end{pmatrix} = A\begin{pmatrix}x\\ v\end{pmatrix},\qquad
# A = \begin{pmatrix}1-(\omega h)^2 & h\\ -\omega^2h & 1\end{pmatrix}.$$
#
# After $n$ steps the state is $A^n$ times the first. It stays bounded if the two **eigenvalues** of $A$ differ and
# neither has an absolute value above 1. So look where the two lie in the complex plane.
# %%
predict("spring_and_step")
# %%
simulation("spring")
# %% [markdown]
# (A later section explains the coloured patch.) The determinant of $A$ is 1, so the product of the two eigenvalues is
# 1. While they are complex, they form a conjugate pair on the unit circle: the motion oscillates. Their sum is the
# trace of $A$, $2-(\omega h)^2$. At $\omega h = 2$ the trace is $-2$, and both eigenvalues are $-1$. Beyond this value
# they are real, $\lambda$ and $1/\lambda$, and one of them lies outside the circle: the motion explodes. For explicit
# Euler the eigenvalues are $1\pm i\omega h$, which lie outside the circle for every step:
# %% tags=["hide-code"]
figure_, axes_ = plt.subplots(figsize=(8, 4.2), layout="constrained")
axes_.plot(np.cos(turn), np.sin(turn), color="0.6", lw=1)
axes_.axhline(0, color="0.85", lw=0.8, zorder=0)
for omega_h in (0.5, 1.0, 1.5, 1.9, 2.2):
    values = np.linalg.eigvals(np.array([[1 - omega_h**2, omega_h], [-omega_h, 1]]))
    axes_.plot(values.real, values.imag, "o", color="tab:blue" if omega_h < 2 else "tab:red", ms=7)
    for value in values:
        axes_.annotate(
            f"{omega_h:g}",
            (value.real, value.imag),
            (8 if omega_h > 0.5 else -24, 6 if value.imag >= 0 else -12),
            textcoords="offset points",
            fontsize=9,
        )
for omega_h in (0.5, 1.0):
    axes_.plot([1, 1], [omega_h, -omega_h], "s", color="tab:orange", ms=6)
    axes_.annotate(f"{omega_h:g}", (1, omega_h), (8, 2), textcoords="offset points", fontsize=9)
axes_.plot([], [], "o", color="tab:blue", label="semi-implicit Euler, stable")
axes_.plot([], [], "o", color="tab:red", label="semi-implicit Euler, unstable")
axes_.plot([], [], "s", color="tab:orange", label="explicit Euler")
axes_.legend(loc="lower left", fontsize=9)
axes_.set(
    aspect="equal",
    xlim=(-3.4, 1.6),
    ylim=(-1.4, 1.4),
    xlabel="real part",
    ylabel="imaginary part",
    title="eigenvalues of a step; the numbers are $\\omega h$",
)
plt.show()
beyond = np.linalg.eigvals(np.array([[1 - 2.2**2, 2.2], [-2.2, 1]])).real
print(f"at omega h = 2.2 the eigenvalues are {min(beyond):.2f} and {max(beyond):.2f}")
# %%
show("semi_implicit_unconditional")
# %% [markdown]
# Without damping and near a stable resting position, semi-implicit Euler is stable if
#
# $$\boxed{\; h < \frac{2}{\omega_{\max}} \;}\qquad\text{for one mass on one spring:}\quad h < 2\sqrt{\frac{m}{k}},$$
#
# where $\omega_{\max}$ is the highest frequency among the modes.
#
# **Worked example.** Simulators often model a contact as a stiff spring that pushes bodies apart in proportion to
# their overlap, a **penalty** contact. With 100 kN/m and a part of 1 kg, $\omega = \sqrt{10^5} = 316$ rad/s while
# they touch. The limit is $2/316$ s, or 6.3 ms. It assumes that the spring is always attached. A contact begins and
# ends within a step, and each time the energy can be wrong: at 5 ms, an elastic bounce leaves 1.23 times the
# energy on average. So take a step well below 6.3 ms.
#
# If a stable step is shorter than the time between two commands, simulators take several **substeps** per command
# (*decimation* or *frame skip* in robot learning).
#
# <details><summary>Derive it: both Eulers on the spring</summary>
#
# *Explicit Euler*: $A = \begin{pmatrix}1 & h\\ -\omega^2h & 1\end{pmatrix}$ has the eigenvalues $1 \pm i\omega h$, so
# $\lvert\lambda\rvert^2 = 1 + (\omega h)^2 > 1$ for **every** $h$. No step is stable.
#
# *Semi-implicit Euler*: with determinant 1 the eigenvalues solve $\lambda^2 - (2-\omega^2h^2)\lambda + 1 = 0$. They are
# complex, and then on the unit circle, while $\lvert 2-\omega^2h^2\rvert < 2$, that is $\omega h < 2$. At equality both
# eigenvalues are $-1$ with a single eigenvector, and the state grows linearly.
#
# </details>
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Without damping, semi-implicit Euler needs $h < 2/\omega_{\max}$, so the fastest oscillation in the
# model decides.
#
# </div>
# %%
more_claims(
    "explicit_undamped_limit",
    "explicit_eigenvalues",
    "quoted_modulus",
    "growing_determinant_has_a_limit",
    "determinant_one_is_stable",
    "stable_at_the_limit",
    "explicit_damped_limit",
    "limit_scales_with_root",
    "contact_stable_at_1_khz",
    "contact_rate_by_stability",
    "penalty_listing_limits",
)
# %% [markdown]
# ### Six integrators, and what a step costs
#
# The expensive part of a step is to compute the forces of contacts, joints and muscles. So the cost of an integrator is
# mainly its number of **force evaluations** per step. More evaluations can give a higher **order**. If the motion is
# smooth and the step small, a method of order $p$ has an error proportional to $h^p$: halve the step, and the error
# shrinks by the factor $2^p$.
#
# **Velocity Verlet** averages the accelerations at the start and at the end of the step:
#
# $$q' = q + h\,v + \tfrac{h^2}{2}\,a, \qquad v' = v + \tfrac h2\,(a + a') .$$
#
# If forces depend on positions only, the $a'$ of this step is the $a$ of the next, so one evaluation per step is
# enough. (**Leapfrog** is this method with velocities stored at half steps.)
#
# The **explicit midpoint** rule takes half a step of explicit Euler, computes the derivative there, and uses it for
# the full step. The **implicit midpoint** rule uses the derivative at the average of the old and the new state. The
# new state appears on both sides, so every step has to solve an equation.
#
# **RK4**, the classical Runge-Kutta method of fourth order, evaluates four slopes $k_1$ to $k_4$. With the state $y =
# (q, v)$ and $\dot y = f(y)$:
#
# $$k_1 = f(y),\quad k_2 = f(y+\tfrac h2k_1),\quad k_3 = f(y+\tfrac h2k_2),\quad k_4 = f(y+h\,k_3),$$
# $$y' = y + \tfrac h6\,(k_1+2k_2+2k_3+k_4) .$$
#
# Choose an integrator, drag the start, and press play. Dots show where it evaluates the force, the red ring where the
# step ends. *Ratio for small ω h* is the factor $2^p$ above.
# %%
simulation("force_evaluations", still=0.0)
# %% [markdown]
# | method | order | force evaluations per step | keeps area | stability limit on an undamped spring |
# |---|---|---|---|---|
# | explicit Euler | 1 | 1 | no | 0: no step is stable |
# | semi-implicit Euler | 1 | 1 | yes | $\omega h < 2$ |
# | velocity Verlet | 2 | 1, or 2 if forces depend on velocity | yes | $\omega h < 2$ |
# | explicit midpoint | 2 | 2 | no | 0: no step is stable |
# | implicit midpoint | 2 | several (here about 5), to solve an equation | yes | no limit, if the equation is solved |
# | RK4 | 4 | 4 | no | $\omega h \le 2\sqrt2 \approx 2.828$ |
#
# The next section explains *keeps area*. *Yes* holds for a fixed step if the accelerations depend on positions alone.
# With several coordinates, the forces must also come from a potential energy.
# %%
show("orders_of_accuracy")
# %%
more_claims(
    "semi_implicit_is_verlet",
    "verlet_limit",
    "explicit_midpoint_limit",
    "rk4_limit",
    "implicit_midpoint_limit",
    "evaluations_per_step",
    "semi_implicit_stability_per_cost",
)
# %% [markdown]
# ### Symplectic integrators: area in phase space
#
# Simulate a pendulum for a million steps, about a hundred per swing. The energy error of semi-implicit Euler does not
# grow; that of RK4 is far smaller, but grows all the time. The reason is geometric.
#
# Draw a state as a point in the plane of position and momentum, the **phase plane**. Now follow all states of a
# patch, such as a small disk. The patch moves and changes its shape. If the forces depend on positions alone, its
# area does not change (Liouville's theorem). With one degree of freedom, an integrator is called **symplectic** if
# its step leaves the area of every patch unchanged. With such forces semi-implicit Euler, also called symplectic
# Euler, does so.
#
# The picture shows a patch of pendulum states under three integrators, with about 18 steps per swing. Explicit Euler
# enlarges this patch in each step, and RK4 shrinks it very slowly. The vertical axis is the angular velocity, which
# is proportional to the momentum. Grey lines have constant energy, and the numbers count steps:
# %% tags=["hide-code"]
figure_, panels = plt.subplots(1, 3, figsize=(11, 3.6), sharey=True, layout="constrained")
h, shots = 0.35, (0, 3, 6, 9)
turn_closed = np.linspace(0, 2 * np.pi, 400)
circle = np.array([0.9 + 0.3 * np.cos(turn_closed), 0.3 * np.sin(turn_closed)])
grid_q, grid_v = np.meshgrid(np.linspace(-3.4, 3.4, 100), np.linspace(-2.6, 2.6, 100))


def area(points):
    x, y = points
    return 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def pendulum_acceleration(q, v, params):
    return -np.sin(q)


for axes_, (name, method) in zip(
    panels,
    {
        "explicit Euler": rigid_body.explicit_euler,
        "semi-implicit Euler": rigid_body.semi_implicit_euler,
        "RK4": rigid_body.rk4,
    }.items(),
    strict=True,
):
    axes_.contour(
        grid_q,
        grid_v,
        grid_v**2 / 2 - np.cos(grid_q),
        levels=8,
        colors="0.88",
        linewidths=0.8,
        linestyles="solid",
    )
    patch, first = circle.copy(), area(circle)
    for step in range(shots[-1] + 1):
        if step in shots:
            axes_.fill(*patch, alpha=0.55, color=plt.cm.viridis(step / 11))
            axes_.annotate(f"{step}", patch.mean(axis=1), ha="center", va="center", fontsize=9)
        if step < shots[-1]:
            patch = np.array(method(patch[:1], patch[1:], pendulum_acceleration, h, np.zeros(1)))[
                :, 0
            ]
    axes_.set(
        title=f"{name}: area × {area(patch) / first:.4f}",
        xlabel="angle [rad]",
        xlim=(-1.9, 1.5),
        ylim=(-2.2, 1.2),
    )
    print(f"{name:<20} area after {shots[-1]} steps: {area(patch) / first:.4f} of the first")
panels[0].set(ylabel="angular velocity [rad/s]")
plt.show()
# %%
show("area_preserved")
# %% [markdown]
# If the forces are smooth, the motion stays bounded, and the step is small and fixed, the energy error of a
# symplectic method stays bounded for a very long time. The method almost exactly conserves a slightly different
# energy. On a spring, semi-implicit Euler exactly conserves (per unit of mass)
#
# $$\tfrac12 v^2 + \tfrac12\omega^2x^2 - \tfrac12\omega^2h\,x\,v .$$
#
# The true energy is the sum of the first two terms. The third term oscillates, so the true energy oscillates, too.
# %%
show("symplectic_conserves_energy")
# %% [markdown]
# A symplectic method promises neither an exact energy nor the right period. The energy error need not stay bounded
# with friction, with other forces that depend on velocity, or (with few exceptions) if the step size adapts to the
# motion.
#
# <details><summary>Derive it: why the energy stays near, and where the promise ends</summary>
#
# With several degrees of freedom, preserving the volume is not enough. A symplectic map preserves the sum of the areas
# of a patch's projections onto the planes $(q_i, p_i)$. Then the numerical solution follows a nearby energy function,
# up to an error that is exponentially small in $1/h$, and on the oscillator exactly.
#
# In joint angles and rates, an arm's Coriolis terms and a body's $\omega\times(I\omega)$ depend on the velocity. There
# *no* method of the table is symplectic, and semi-implicit Euler's energy drifts on a double pendulum and on a tumbling
# body. Symplectic methods for these systems work with momenta (splitting, RATTLE, discrete Moser-Veselov).
#
# </details>
# %%
more_claims(
    "rk4_energy_factor",
    "symplectic_with_varying_step",
    "semi_implicit_arm_energy",
    "semi_implicit_keeps_area_always",
    "volume_kept_bounds_energy",
    "symplectic_removes_stiffness",
    "reason_for_symplectic",
)
# %% [markdown]
# ### Updating an orientation
#
# The orientation of a simulated drone drifts although all its rates are right. A common cause is one line: `q += dt *
# q_rate`. The unit quaternions form a sphere, and $\dot q$ is tangent to it. A step along a tangent leaves the sphere,
# so people scale the result back to length one. Then the length is right, but the angle is not:
# %% tags=["hide-code"]
half = 0.8  # half the angle by which the body turns in the step
figure_, axes_ = plt.subplots(figsize=(8, 4), layout="constrained")
arc = np.linspace(-0.25, 1.2, 100)
axes_.plot(np.cos(arc), np.sin(arc), color="0.6", lw=1.5)
axes_.annotate("", (1, half), (1, 0), arrowprops={"arrowstyle": "-|>", "color": "tab:red", "lw": 2})
back = np.arctan(half)
axes_.plot([0, 1], [0, half], color="tab:red", lw=0.8, ls="--")
axes_.plot([0, np.cos(half)], [0, np.sin(half)], color="tab:blue", lw=0.8, ls="--")
for point, text, colour, place in (
    ((1, 0), "$q$", "black", (10, -4)),
    ((1, half), "$q + h\\,\\dot q$: too long", "tab:red", (10, 0)),
    ((np.cos(back), np.sin(back)), "scaled back: turned too little", "tab:red", (62, -6)),
    ((np.cos(half), np.sin(half)), "$q\\,\\exp(h\\omega)$: right", "tab:blue", (-105, 8)),
):
    axes_.plot(*point, "o", color=colour, ms=8)
    leader = {"arrowstyle": "-", "lw": 0.5, "color": colour} if "scaled" in text else None
    axes_.annotate(
        text,
        point,
        place,
        textcoords="offset points",
        color=colour,
        fontsize=11,
        arrowprops=leader,
    )
axes_.text(1.04, -0.2, "sphere of unit quaternions", color="0.4")
axes_.set(xlim=(-0.05, 1.9), ylim=(-0.28, 1.05), aspect="equal")
axes_.axis("off")
plt.show()
print(f"the body should turn by {2 * half:.2f} rad; scaled back it turns by {2 * back:.2f} rad")
print("(between quaternions, as drawn, the angles are half of these)")
# %% [markdown]
# The correct update is a multiplication with a small rotation:
#
# $$\boxed{\; q' = q\,\exp(h\,\omega) \;}\qquad\text{for } \omega \text{ in the body frame.}$$
#
# It stays on the sphere, and for a steady spin it is exact. Call the small rotation $s = \exp(h\omega)$. The new
# orientation turns $r$ into $q\,s\,(0,r)\,s^*q^*$: first $s$ turns it in body coordinates, then $q$ takes it to the
# world. So $s$ stands on the *right* of $q$. If your $\omega$ is given in world coordinates, the small rotation is the
# factor on the left: $q' = \exp(h\,\omega)\,q$.
#
# **Worked example.** A wheel spins at 10 rad/s, and the step is 10 ms, so it turns by 0.1 rad per step. Adding and
# scaling turns it by only $2\arctan(\tfrac12\omega h) = 0.09992$ rad. The lag, about $\tfrac1{12}(\omega h)^3 =
# 0.00008$ rad, looks harmless. But after 1000 steps the wheel lags by 0.083 rad.
# %%
more_claims(
    "renormalising_repairs",
    "quaternion_norm_keeps_itself",
    "added_quaternion_adds_energy",
    "renormalised_rk4_order",
)
# %% [markdown]
# ### Free fall and impacts: where the energy goes
#
# Between impacts, the acceleration of the box's centre is constant, so you can compute the energy error of a step by
# hand. All six integrators get the velocity right. They differ only in the position: $q' =
# q + h v + c\,h^2 a$, with $c = 0$ for explicit Euler, $c = 1$ for semi-implicit Euler and $c = \tfrac12$ for the four
# others, which are exact. Insert this into the energy $E = mgy + \tfrac12mv^2$ at the height $y$:
#
# $$\Delta E = m g^2 h^2\,(\tfrac12 - c) \quad\text{per step.}$$
#
# So explicit Euler gains $\tfrac12 mg^2h^2$ in every step, and semi-implicit Euler loses as much, although it is
# symplectic. When something swings, this error changes its sign with the swing. In free fall the velocity changes in
# one direction only, so the error adds up.
#
# **Restitution** $e$ is the speed after an impact divided by the speed before, both measured perpendicular to the
# floor. With $e = 1$ a bounce should cost no energy. Programs often use a simple rule: if a ball is below the floor
# at the end of a step, put it on the floor and reverse its velocity. In the drawing, the ball falls to the depth $d$
# below the floor during the step. Putting it back adds the energy $mgd$.
#
# The remedy is to find the **time of impact** inside the step, to reverse the velocity there, and to continue with the
# rest of the step:
# %% tags=["hide-code"]
figure_, panels = plt.subplots(1, 2, figsize=(9, 3.7), layout="constrained")
g, h, y0, v0 = problems.STANDARD_GRAVITY, 0.1, 0.25, -3.2
steps = [(y0, v0)]
for _ in range(2):
    y, v = steps[-1]
    steps.append((y + v * h - g * h * h / 2, v - g * h))
fall = np.linspace(0, 2 * h, 50)
for axes_ in panels:
    axes_.axhline(0, color="0.3", lw=2)
    axes_.plot(fall, y0 + v0 * fall - g * fall**2 / 2, color="0.6", ls="--")
    axes_.set(xlim=(-0.01, 0.32), ylim=(-0.62, 0.5), xlabel="time [s]", xticks=[0, h, 2 * h, 3 * h])
for t, (y, _) in zip((0, h), steps[:2], strict=True):
    panels[0].plot(t, y, "o", color="tab:red")
panels[0].plot(h, steps[1][0], "o", color="tab:red")
depth = -steps[1][0]
panels[0].annotate(
    "",
    (h, 0),
    (h, -depth),
    arrowprops={"arrowstyle": "-|>", "color": "tab:red", "lw": 2},
)
panels[0].text(
    h + 0.09,
    -0.08,
    f"found at the depth\nd = {depth:.2f} m, then\nput on the floor",
    va="top",
    fontsize=9,
)
up = np.linspace(0, 2 * h, 50)
panels[0].plot(h + up, -steps[1][1] * up - g * up**2 / 2, color="tab:red")
panels[0].set(title="end of the step: energy is added", ylabel="height [m]")
hit = (v0 + np.sqrt(v0**2 + 2 * g * y0)) / g
speed = np.sqrt(v0**2 + 2 * g * y0)
panels[1].plot(hit, 0, "*", color="tab:blue", ms=13)
panels[1].text(h + 0.09, -0.2, f"impact at {1000 * hit:.0f} ms,\nwithin the step", fontsize=9)
panels[1].plot([0], [y0], "o", color="tab:blue")
after = np.linspace(0, 3 * h - hit, 50)
panels[1].plot(hit + after, speed * after - g * after**2 / 2, color="tab:blue")
panels[1].plot(h, speed * (h - hit) - g * (h - hit) ** 2 / 2, "o", color="tab:blue")
panels[1].set(title="time of impact found: exact")
plt.show()
before, wrong = 0.5 * v0**2 + g * y0, 0.5 * steps[1][1] ** 2
print(f"energy per kilogram: before {before:.2f} J, bounce at the end of the step {wrong:.2f} J,")
print(f"                     bounce at the time of impact {0.5 * speed**2:.2f} J")
# %% [markdown]
# <details><summary>Derive it: the loss of a flight, and the gain of a bounce</summary>
#
# The energy error of a step has the same sign whether the ball rises or falls. Over a flight it adds up to $\tfrac12
# mgh$ times the change of velocity. A bounce reverses the velocity but restores nothing, so the next flight loses as
# much again. The rule at the floor lifts the ball by the depth $d$, which adds $mgd$, and leaves the speed that the
# ball had at that depth. So semi-implicit Euler loses $mghv$ in a flight that starts and ends with the speed $v$. The
# depth $d$ lies between 0 and $hv$, so on average a bounce gives back half of this loss.
#
# A drop from rest is an exception: in exact arithmetic every rebound ends exactly on the floor, and the next bounce
# gives back all of the loss.
#
# The claims below use a *worked example*: a ball of 1 kg that falls 5 m and bounces with $e = 1$, in steps of 10 ms.
# *The usual listing* is a box simulator as tutorials print it: semi-implicit Euler, with the bounce rule at the centre.
#
# </details>
# %%
more_claims(
    "bounce_gives_the_loss_back",
    "elastic_bounce_rule",
    "free_fall_energy_error",
    "semi_implicit_free_fall",
    "worked_step_1_semi_implicit",
    "worked_step_100",
    "worked_step_500",
    "worked_ten_bounces_explicit",
    "worked_ten_bounces_semi_implicit",
    "worked_ten_bounces_rk4",
    "worked_table_belongs_to_the_method",
    "semi_implicit_bouncing_decays",
    "bounce_rule_takes_energy",
    "listing_box_tumbles",
    "listing_energy_decay",
    "explicit_in_the_listing_grows",
)
# %% [markdown]
# ## 3 · Design: the loop around the equations
#
# ### The tasks of a loop, and their rates
#
# One program has to run a robot's controller, its camera and the physics at different rates. The drawing shows the
# order of its seven tasks and three of their rates. (*Rendering* draws the *image* on the screen.) The physics step
# is fixed. From the number of steps so far, the loop knows which other tasks are due:
# %% tags=["hide-code"]
figure_, (order_, axes_) = plt.subplots(
    2, 1, figsize=(10, 4.0), height_ratios=(1.0, 2.2), layout="constrained"
)
order = ("camera", "sensors", "controller", "forces", "integration", "collisions", "rendering")
due = ("camera", "sensors", "controller", "rendering")  # not in every step
arrow = {"arrowstyle": "-|>", "color": "0.2"}
for k, task in enumerate(order):
    box = {"boxstyle": "round,pad=0.4", "fc": "#e8eaf6" if task in due else "#9cc9ec", "ec": "0.3"}
    order_.text(k, 0, task, ha="center", va="center", fontsize=9, bbox=box)
    if k:
        order_.annotate("", (k - 0.38, 0), (k - 0.6, 0), arrowprops=arrow)
order_.plot([6, 6, 0, 0], [-0.45, -1.1, -1.1, -0.75], color="0.2", lw=1)
order_.annotate("", (0, -0.45), (0, -0.85), arrowprops=arrow)
order_.text(
    3.0,
    -1.0,
    "repeated 1,000 times per second; pale: only in steps in which the task is due",
    ha="center",
    va="bottom",
    fontsize=9,
)
order_.set(xlim=(-0.6, 6.6), ylim=(-1.25, 0.5))
order_.axis("off")
for row, (period, colour) in enumerate(
    ((1000 / 60, "tab:purple"), (2.0, "tab:orange"), (1.0, "tab:blue"))
):
    # An image closes its period, so none is due at time 0.
    times = np.arange(period if row == 0 else 0, 18.01, period)
    axes_.plot(times, np.full(len(times), row), "o", color=colour, ms=7)
    if row == 1:
        for t in times[:-1]:
            axes_.plot([t, t + 1.85], [row, row], color=colour, lw=4, alpha=0.35)
axes_.axvline(1000 / 60, color="tab:purple", lw=0.8, ls=":")
axes_.annotate(
    "the image falls due between two steps",
    (1000 / 60, 0),
    (8.2, 0.25),
    arrowprops={"arrowstyle": "->"},
)
axes_.text(3.1, 1.28, "the command is held until the next one", fontsize=9, color="tab:orange")
axes_.set(
    yticks=[0, 1, 2],
    yticklabels=["render, 60 Hz", "controller, 500 Hz", "physics, 1 kHz"],
    xlabel="simulated time [ms]",
    ylim=(-0.5, 2.5),
)
plt.show()
print(f"an image falls due every {1000 / 60:.2f} physics steps")
# %% [markdown]
# The loop records each task (*phase*). *Age* says how old the state is that a task works with. Most tasks use the
# newest state, so their age is 0. For *apply forces*, it is the age of the state from which the command was computed.
# A new command comes only every 2 ms, so in every second step that state is 1 ms old.
#
# Collisions are the last task of the physics step, so the first row of the table below ends the step from 0 to 1 ms.
# The next two rows belong to the step that begins at 1 ms. Images are drawn between two steps. The image in the last
# row is due at 16.667 ms, and to show that moment, the loop would need the state of 17 ms. To avoid waiting, the loop
# shows the motion one step late but smooth: it mixes the states of 15 and 16 ms, with the weight 0.667 for the newer
# one.
# %% tags=["hide-code"]
from fractions import Fraction

from course.rigid_body.loop import FixedStepLoop, Phases, float_clock_error, trace_table

spring = problems.oscillator().system


def integrate(state, force, dt):
    return rigid_body.semi_implicit_euler(*state, spring.acceleration, dt, spring.params)


loop = FixedStepLoop((spring.q0, spring.v0), Phases(integrate=integrate), record=True)
_ = loop.advance(Fraction(18, 1000))  # 0.018 as a float is a little less than 18 steps
rows = trace_table(loop.trace).splitlines()
figures(
    "\n".join(rows),
    rows[0],
    "1.000",
    "16.667",
    summary="All 18 steps in the order of execution: an image is drawn once both its states exist",
)
# %% [markdown]
# Three details decide whether the loop works:
#
# * **The accumulator.** Real time arrives in uneven pieces. An **accumulator** adds up the elapsed time and runs as
#   many whole physics steps as fit into it. The physics never reads the clock. So with the same inputs at the same
#   steps, two runs of the same program on one machine give the same result, unless parallel threads add numbers in a
#   varying order.
# * **Interpolation.** In an image, the weight of the newer state is the time left in the accumulator, divided by $h$.
#   If you draw the latest state instead, each image is too old by a different part of a step, and the motion looks
#   jerky.
# * **Counting steps.** Compute the time as the number of steps times $h$. If you add 0.001 s millions of times, the
#   rounding errors add up too.
# %% tags=["hide-code"]
print(
    f"error of a clock that adds 1 ms per step, after an hour: {float_clock_error(0.001, 3_600_000):.1e} s"
)
# %% [markdown]
# <details><summary>If the machine is too slow for real time: the spiral of death</summary>
#
# A loop that tries to catch up runs more steps per image. Each image then takes longer, the loop falls further behind,
# and it never recovers. This is the *spiral of death*. So limit the number of steps per image, drop the rest of the
# time, and *report* it.
#
# </details>
#
# ### The engine we compare with
#
# This chapter compares with **MuJoCo** (Todorov, Erez and Tassa, 2012), an open-source physics engine widely used in
# robot learning. All statements are about version 4.0. Within a step, MuJoCo performs the tasks in another order:
# %% tags=["hide-code"]
tasks = {
    "this course": ("sensors", "controller", "forces", "integrate", "collisions"),
    "MuJoCo": (
        "collisions",
        "sensors of\nposition, velocity",
        "controller",
        "forces",
        "sensors of force,\nacceleration",
        "integrate",
    ),
}
figure_, axes_ = plt.subplots(figsize=(11, 2.2), layout="constrained")
for row, (component, names) in enumerate(reversed(tasks.items())):
    for column, name in enumerate(names):
        colour = {"collisions": "tab:red", "integrate": "tab:blue"}.get(name, "0.6")
        axes_.add_patch(plt.Rectangle((2 * column, row), 1.6, 0.6, color=colour, alpha=0.35))
        axes_.text(2 * column + 0.8, row + 0.3, name, ha="center", va="center", fontsize=9)
        axes_.annotate(
            "",
            (2 * column + 2, row + 0.3),
            (2 * column + 1.6, row + 0.3),
            arrowprops={"arrowstyle": "->"},
        )
    axes_.text(-0.2, row + 0.3, component, ha="right", va="center")
    axes_.text(2 * len(names) + 0.1, row + 0.3, "next\nstep", va="center", fontsize=9)
axes_.set(
    xlim=(-1.8, 12.9),
    ylim=(-0.2, 1.8),
    title="the order within a step (images are drawn between steps)",
)
axes_.axis("off")
plt.show()
# %% [markdown]
# <details><summary>Where your controller runs</summary>
#
# In the picture, the controller runs inside the step: MuJoCo calls it back (`mjcb_control`), or you call the two
# halves of the step yourself (`mj_step1`, then `mj_step2`). Most programs write the motor commands into the array
# `ctrl` and then call the whole step, `mj_step`. It evaluates the sensors only afterwards, so such a controller reads
# the values of the step before.
#
# </details>
#
# MuJoCo detects collisions *before* it integrates, so after a step its contacts belong to the positions before the
# step. Call `mj_forward` to update them. MuJoCo's `Euler` is semi-implicit Euler, but it
# computes the damping of joints from the *new* velocity. A force that is computed from the new state is called
# **implicit**. If an implicit damping force acts on the fastest oscillation, it allows larger steps (section 7).
# MuJoCo's `implicit` and `implicitfast` also compute the damping of motors (*actuators*) and cables (*tendons*)
# implicitly. Its `discrete` does this for the springs as well.
# %%
more_claims(
    "steps_per_picture",
    "step_sweet_spot",
    "collisions_after_integration",
    "cameras_in_every_step",
    "clock_by_adding_dt",
    "deformables_need_a_tenth",
    "tenth_of_the_step",
)
# %% [markdown]
# ## 4 · Code: the reference functions
#
# ### One integrator for positions and orientations
#
# Semi-implicit Euler adds $h\,v'$ to a position, but it multiplies an orientation by $\exp(h\,\omega')$. The course
# puts the difference into one function, `retract(q, u)`, which moves $q$ by $u$. If the array of positions is one
# element longer than the array of velocities, its last four elements are a unit quaternion. With this function,
# semi-implicit Euler needs only two lines. Here are both functions:
# %% tags=["hide-code"]
source(rigid_body.retract, rigid_body.semi_implicit_euler)
# %% [markdown]
# RK4 needs one more idea. Its four angular velocities belong to four *different* orientations, and the order of
# rotations matters. Turn a box by a quarter about $x$ and then about $z$, and in the other order (both axes are fixed
# in space, $x$ towards you and $z$ up):
# %% tags=["hide-code"]
quarter = {
    "about x": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "about z": np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
}
figure_, panels = plt.subplots(2, 3, figsize=(8.5, 4.6), layout="constrained")
ends = []
for row, order in enumerate((("about x", "about z"), ("about z", "about x"))):
    pose = np.eye(3)
    for column, axes_ in enumerate(panels[row]):
        if column:
            pose = quarter[order[column - 1]] @ pose
        draw_box(axes_, pose, ("0.5", "tab:blue", "tab:red")[column])
        axes_.set(aspect="equal", xlim=(-1.5, 1.5), ylim=(-1.4, 1.4))
        axes_.set_title(
            "start" if column == 0 else f"a quarter turn {order[column - 1]}", fontsize=10
        )
        axes_.axis("off")
    ends.append(pose)
plt.show()
print("same orientation at the end:", bool(np.allclose(*ends)))
# %% [markdown]
# Averaged like ordinary vectors, the four give only order 2. Two corrections restore order 4 (Munthe-Kaas and Owren
# 1999): cross products of angular velocities (`bracket` in the code). Without rotations, the code is the RK4 of
# section 2 (`_along` adds a multiple, `_mean` averages with the weights 1, 2, 2, 1):
# %% tags=["hide-code"]
source(rigid_body.rk4)
# %% [markdown]
# We test five integrators on a free body with three different moments, over 20 s with a step of 1 ms. The exact
# motion is known:
# %% tags=["hide-code"]
tumbling = problems.tumble()
print(f"{'integrator':<20} {'error [rad]':>12} {'drift of energy':>17} {'drift of L':>12}")
for name in (
    "semi_implicit_euler",
    "velocity_verlet",
    "implicit_midpoint",
    "rk4",
    "rk4_renormalised",
):
    run = rigid_body.simulate(tumbling.system, name, 1e-3, 20_000, every=20_000)
    ends = [(run.q[i], run.v[i], tumbling.system.params) for i in (0, -1)]
    energy = [problems.tumble_energy(*end) for end in ends]
    momentum = [problems.angular_momentum(*end) for end in ends]
    drift = np.linalg.norm(momentum[1] - momentum[0]) / np.linalg.norm(momentum[0])
    numbers = (tumbling.error(run.q[-1]), abs(energy[1] / energy[0] - 1), drift)
    # Below 1e-11 one would read the rounding of this machine.
    error, by_energy, by_momentum = (f"{x:.0e}" if x > 1e-11 else "<1e-11" for x in numbers)
    print(f"{name:<20} {error:>12} {by_energy:>17} {by_momentum:>12}")
# %% [markdown]
# The drifts are relative to the start. `rk4_renormalised` is ordinary RK4 on the quaternion's four numbers, scaled to
# length one after each step. It averages rates of these numbers, not angular velocities, so it needs no corrections.
# %%
more_claims("rotation_stages_add")
# %% [markdown]
# ### A box that tumbles, hits the floor and slides
#
# The course's planar box finds the time at which a corner hits the floor inside the step, and solves the impact with
# restitution and **Coulomb friction**: the friction force opposes the sliding, and it is at most $\mu$ times the
# normal force.
#
# With friction, restitution needs care. If $e$ is a ratio of speeds, as above, a computed impact can *gain* energy
# (Kane 1984). The box uses Stronge's definition (1990). Imagine a tiny spring at the contact: it stores energy while
# it is compressed, and the share $e^2$ of this energy comes back. So no impact gains energy.
# %%
predict("box_at_rest")
# %% tags=["hide-code"]
box = planar.PlanarBody(restitution=0.7, friction=0.5)
box.state[:] = (0.0, 1.0, 0.4, 0.5, 0.0, 1.0)
path, total = [box.state.copy()], [box.energy()[2]]
for _ in range(1500):
    box.step(2e-3, integrator="rk4")
    path.append(box.state.copy())
    total.append(box.energy()[2])
path = np.array(path)
outline = np.array([[-0.15, 0.15, 0.15, -0.15, -0.15], [-0.1, -0.1, 0.1, 0.1, -0.1]])
figure_, axes = plt.subplots(1, 2, figsize=(11, 3.2), layout="constrained")
for i in range(0, 1500, 25):
    x, y, angle = path[i, :3]
    turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ outline
    axes[0].plot(x + turned[0], y + turned[1], color=plt.cm.viridis(i / 1500), linewidth=0.8)
axes[0].axhline(0, color="0.3")
axes[0].set(
    aspect="equal", xlabel="x [m]", ylabel="y [m]", title="every 50 ms for 3 s, dark to bright"
)
axes[1].plot(np.arange(len(total)) * 2e-3, total)
axes[1].set(xlabel="time [s]", ylabel="total energy [J]", title="energy: flat in flight")
plt.show()
print(f"impacts: {box.impacts}, steps not resolved: {box.unresolved}")
print(f"at rest after 3 s: {bool(np.all(path[-1][3:] == 0.0))},")
print(f"height of the centre {path[-1][1]:.6f} m, energy left m g y = {total[-1]:.2f} J")
# %% [markdown]
# ## 5 · The simulation in full
#
# In the simulation below, the dashed path is the same box with very small steps. The two paths separate because each
# impact enlarges small differences. An impact slower than the *rest speed* ends the bouncing.
#
# Predict each preset before you choose it:
#
# 1. *Exact flight, late impacts* ($e = 1$, impacts at the end of the step): RK4 makes no error in flight. Is the
#    energy constant?
# 2. *50 ms steps: deep in the ground*: how far below the floor can the box be at the end of a step?
# 3. *Late impacts: never at rest*: what does the box do when it should lie still?
# 4. *No rest speed: endless impacts*: what happens when the bounces become ever shorter?
#
# <details><summary>Answers</summary>
#
# 1: No, each bounce adds $mgd$. 2: Up to the distance travelled in one step, $vh$. 3: It gains the speed $gh$ in every
# step and bounces. 4: They pile up until a step has more impacts than the program follows. With
# semi-implicit Euler this goes on without end (section 7).
#
# </details>
# %%
simulation("bouncing_box")
# %% [markdown]
# ## 6 · Speed against accuracy
#
# ### The work-precision diagram
#
# "RK4 costs four times as much as Euler." That is true for one step, but RK4 may need only a thousandth of the steps.
# Your task has a tolerance, the largest error that you accept, and you want to reach it with the least work.
#
# A **work-precision** diagram plots the error against the cost for every method, with one point per step size. Draw a
# horizontal line at your tolerance: of the runs below it, the one furthest to the left is the cheapest. On the
# logarithmic axes a method of order $p$ has the slope $-p$.
#
# The problem here is a double pendulum. Drag the tolerance line. The circle marks the cheapest run. Each run is timed
# in three rounds: the point shows the fastest round, and its thin bar ends halfway between the two others. If other
# programs run too (*busy* below the chart), a curve may run backwards. The measured orders:
# %% tags=["hide-code"]
from course.simulations.trade_off import TradeOff

result = accuracy.work_precision("double_pendulum", repeats=3, best=True)
orders = {}
for curve in result.curves:
    orders.setdefault(round(result.observed_order(curve.name)), []).append(curve.name)
for order, names in sorted(orders.items()):
    print(textwrap.fill(f"observed order {order}: {', '.join(names)}", 90, subsequent_indent="  "))
TradeOff(result)


# %% [markdown]
# The buttons switch on other methods. On this problem, MuJoCo's `Euler` and `RK4` have the
# same errors as ours. Their steps take longer, because a general engine does more.
#
# The next picture adds an integrator in plain Python as *yours*, here semi-implicit Euler.
# <span class="kernel-only">Change `my_step` to test your own.</span> Compare it in the left panel, because plain Python
# is slow:
# %%
def my_step(q, v, acceleration, dt, params):
    """Change me: a step of your own. This one is semi-implicit Euler."""
    v = v + dt * acceleration(q, v, params)
    return rigid_body.retract(q, dt * v), v


mine = result.with_method(accuracy.your_method("double_pendulum", my_step))
_ = accuracy.draw(mine)
plt.show()
print(f"observed order of yours: {mine.observed_order('yours'):.1f}")
# %%
predict("method_for_a_tumble")
# %% [markdown]
# This is the chart of the tumbling satellite, with a tolerance of 1 mrad after 20 s. A cross at the top marks a run
# that failed: its result was not finite or more than 1 rad wrong (1 m in the chart of the box). In the grey band an
# error means nothing: the reference solution is no more accurate than that. *Pick* names the cheapest method of a
# panel:
#
# ![Error against cost on the free tumble](../docs/charts/work_precision_tumble.png)
#
# The bouncing box has two separate errors of first order: semi-implicit Euler's flight is wrong (*exact flight*
# corrects this), and impacts happen only at the end of a step (*impact times* correct this). For this throw and a step
# of 1 ms the two partly cancel, so the result gets worse if you correct only one. Correct both, and only rounding
# errors remain:
#
# ![Error against cost on the bouncing box](../docs/charts/work_precision_box.png)
#
# *Impulse* is a MuJoCo contact tuned to turn $v$ into $-ev$ in one step. *Spring* is a MuJoCo contact with a spring
# and a damper. The table shows the errors of the same throw (*box drop*) with a step of 1 ms:
# %% jupyter={"source_hidden": true}
figures(
    read("table_at_one_millisecond"),
    "problem",
    "box drop    exact flight, impact times",
    "box drop    semi-implicit, impact times",
    "box drop    exact flight, end of step",
    "box drop    semi-implicit, end of step",
    "box drop    MuJoCo Euler (impulse)",
    cut="time per step",
    summary="All methods and problems at a step of 1 ms, with times (in our box drop, most of the time is "
    "one call from Python, spread over a thousand steps; heavy_top is a spinning top)",
)
# %% [markdown]
# <details><summary>Where MuJoCo and the course differ, and why</summary>
#
# 1. `implicitfast` and `discrete` treat the gyroscopic torque of a free body without joints implicitly. Its energy
#    cannot grow, but the tumbling is damped. The error of the orientation is still of first order, about as large as
#    with `Euler`.
# 2. MuJoCo has no coefficient of restitution, but two ways to imitate one. "Impulse" in the table is a contact with a
#    damper of $(1+e)/h$ and no stiffness. It turns $v$ into $-ev$ within one step, for Euler and the two implicit
#    methods, and does not push out a body that has sunk in. "Spring" is a spring with a damper, for every integrator.
#    It takes time and depth and must be tuned. Compare rows of the same kind only.
# 3. No integrator of MuJoCo divides the step at the impact. Its `speculative` flag (off by default) finds the time of
#    impact in order not to miss a wall, not in order to place the impact. The error at a contact is of first order,
#    with RK4 too. On rotations, MuJoCo's RK4 is another fourth-order method than ours; the errors are about equal.
#
# </details>
# %%
more_claims(
    "rk4_costs_four_times",
    "mujoco_defaults",
    "mujoco_euler_is_semi_implicit",
    "mujoco_stable_by_euler",
    "mujoco_euler_damping_explicit",
    "mujoco_any_stiffness",
    "mujoco_discrete_has_a_limit",
    "mujoco_rk4_on_rotations",
    "mujoco_free_spin_energy",
    "mujoco_implicitfast_gyroscopic",
)
# %% [markdown]
# ### Many bodies at once
#
# Reinforcement learning needs thousands of copies of a scene, mostly on GPUs; this chart measures one CPU core. It
# compares the course's integrators, compiled for whole batches, with `mujoco.batch`, MuJoCo's own tool for this. A
# *body-step* is one step of one body. In the table below the chart, the last column is the simulated time per second
# of computing, *summed over all bodies*. *Error* is that of the position in metres after the first impacts. It is
# larger in MuJoCo, which does not find the impact times. (The right panel is about free bodies.)
#
# ![Bodies per second against the number of bodies](../docs/charts/throughput.png)
# %% jupyter={"source_hidden": true}
figures(
    read("throughput"),
    "who  ",
    "course                            1000 ",
    "mujoco.batch                      1000 ",
    summary="All batches, boxes and free bodies",
)
# %% [markdown]
# A program that can simulate only a planar box on a floor is two orders of magnitude faster than a general engine. But
# it is useless if two bodies can touch.
#
# <details><summary>How it was measured, and the free bodies</summary>
#
# For the error we simulated the first impacts without friction, where an exact solution exists. For the speed we
# simulated 1 s with friction. Other programs ran at the same time; the two contestants took turns. The second table is
# about free bodies. For a single free body ours is about 2.5 times as fast as `mujoco.batch`. The larger gain comes
# with the batch.
#
# </details>
#
# ### The smallest model that answers the question
#
# The cheapest effect is one that you do not simulate. State the question and the tolerance. Then compute the answer
# with and without each effect. Neglect effects as long as their errors add up to less than the tolerance. Check once
# with all of them neglected.
# %%
predict("what_to_leave_out")
# %% [markdown]
# In the table, *error* is the change of the answer in metres when an effect is neglected. *Measured against* names the
# other model: without the effect if it is *modelled*, with it if it is *left out*. The three effects that are left out
# (the table shows the largest) change the answer by less than the tolerance, even all together:
# %% jupyter={"source_hidden": true}
figures(
    re.sub(r"   saves(?=  )|       -(?=  )", "", read("scene_bouncing_box")),
    "How high",
    "tolerance",
    "effect",
    "rotation",
    "deformation",
    "answer",
    summary="All effects, neglected and modelled",
)
# %% [markdown]
# ### Which integrator to choose
#
# * *A robot with contacts, at 1 kHz*: semi-implicit Euler, or in MuJoCo `implicitfast`. The contacts decide the step
#   size.
# * *Smooth motion for up to some hundred periods* (free flight, flexible joints): RK4.
# * *Stiff springs whose vibration you don't need*: an implicit method that damps, such as implicit Euler (forces at the
#   *end* of the step) or MuJoCo's `discrete`.
# * *Very long smooth runs in which averages matter and not the exact path*: a symplectic method with a small fixed
#   step.
#
# ## 7 · Debug: where it fails
#
# ### The stability limit with damping
#
# The arm of your simulated robot vibrates at a large step, so you add joint damping. That calms a real arm, but a
# simulation may explode. What counts is which velocity the damping force uses. Plain semi-implicit Euler uses the old
# one, semi-implicit Euler with *implicit damping*, such as MuJoCo's `Euler`, the new one. The **damping ratio**
# $\zeta$ says how strong the damper is: at $\zeta = 1$, *critical damping*, the motion no longer oscillates.
# %%
predict("damping_and_the_limit")
# %% [markdown]
# A damping force from the old velocity comes late. With the damping constant $c$, it throws $v$ past zero if $hc/m >
# 1$. In terms of $\zeta$ the equation is $\ddot x = -2\zeta\omega\dot x - \omega^2x$, and the limits are
#
# | integrator | damping force from | largest stable step |
# |---|---|---|
# | semi-implicit Euler | the old velocity | $\omega h < 2(\sqrt{1+\zeta^2}-\zeta)$ |
# | semi-implicit Euler with implicit damping | the new velocity | $\omega h < 2(\sqrt{1+\zeta^2}+\zeta)$ |
# | explicit Euler, $\zeta\le1$ | the old velocity | $\omega h < 2\zeta$ |
#
# **Worked example.** At critical damping, $\zeta = 1$, the first limit is $2(\sqrt2 - 1) = 0.83$, less than half of
# the undamped 2. The second is $2(\sqrt2+1) = 4.83$.
#
# The next table shows the largest stable $\omega h$ (`omega dt`), found to 0.01 %, so some values lie just above the
# theory. For `discrete`, *none* means that every step was stable.
# %% jupyter={"source_hidden": true}
figures(
    read("stability_limits"),
    "limit",
    "explicit_euler",
    "semi_implicit_euler",
    "rk4",
    "MuJoCo Euler  ",
    "MuJoCo discrete",
    cut="worst",
    summary="All integrators, and how far they are from the theory",
)
# %% [markdown]
# In the maps, over $\omega h$ and the damping ratio, the motion decays in the purple region and grows in the orange
# one:
#
# ![Stability maps](../docs/charts/stability_maps.png)
# %%
show("mujoco_rk4")
# %% [markdown]
# On this spring MuJoCo's `discrete` is stable at every step size, because it computes the spring force from the new
# state, like implicit Euler. But it damps and slows down even a spring that has no damper:
#
# ![The stiff spring in MuJoCo](../docs/charts/mujoco_stiff_spring.png)
# %%
more_claims("semi_implicit_damped_limit", "halving_dt_finds_the_culprit", "arm_drift_is_numerical")
# %% [markdown]
# ### Energy over a million steps
#
# Over a million steps of a pendulum, explicit Euler is useless after a few seconds. RK4 starts with the smallest
# error, but this error grows in proportion to time. The errors of the symplectic methods do not grow. The numbers are
# the largest relative energy errors:
#
# ![Energy error over a million steps](../docs/charts/long_run_energy.png)
# %% jupyter={"source_hidden": true}
figures(
    read("long_run_energy")
    .replace("largest relative energy error: first 1 %", "energy error in the first 1 %:")
    .replace("last 1 %", "last 1 %:"),
    "explicit_euler",
    "semi_implicit_euler",
    "implicit_midpoint",
    "rk4",
    summary="All methods: largest relative energy error in the first and last 1 % of the run",
)
# %% [markdown]
# Keep the step of a symplectic method fixed, or the energy may grow. Take semi-implicit Euler on a spring:
# alternate two steps that are both below its limit, $\omega h$ = 1.7 and 1.2, and the oscillation explodes.
# Far smaller steps explode too if they vary in the rhythm of the oscillation: in the chart, five steps of $\omega h$
# = 0.3 and then sixteen of 0.1, together half a period, again and again. Even with a fixed step, the period is
# slightly wrong:
#
# ![Alternating steps](../docs/charts/symplectic_not_enough.png)
# %% jupyter={"source_hidden": true}
figures(
    read("symplectic_not_enough"),
    summary="Growth per cycle, measured and in theory; timing (phase) errors",
)
# %% [markdown]
# ### Impacts and the order of a method
#
# A method has its order only on a smooth motion. At an impact of rigid bodies the velocity jumps. If the program
# notices the impact only at the end of a step, the impact comes late by up to $h$.
# %%
show("order_survives_bounces")
# %% [markdown]
# We measured this on a pendulum that hits an elastic wall at its lowest point. If the program finds the impact time
# within the step, RK4 and velocity Verlet keep their order. If not, both drop to first order, and RK4 is no better
# than Verlet, at four times the cost:
#
# ![Order with and without events](../docs/charts/events_order.png)
# %% tags=["hide-code"]
print(
    read("events_order")
    .replace("handled", "impact within the step")
    .replace("late   ", "impact at its end     ")
    .replace("error at 3.1 ms", "error, 3.1 ms steps")
)
# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** If a step does not find the time of a rigid impact, every method is first order at best. Then a
# cheap, stable method is usually the right choice.
#
# </div>
# %%
more_claims("mujoco_rk4_contact_order", "mujoco_contact_stiffness_limit")
# %% [markdown]
# ### Tunnelling: through the wall
#
# A fast ball is in front of a wall at one step and behind it at the next. It overlaps the wall at neither step, so the
# simulator never notices the collision. This is **tunnelling**. Three lengths decide whether it can happen: the
# distance $vh$ travelled per step, the thickness of the body and the thickness of the wall, both measured along the
# motion.
# %%
show("tunnelling_thickness")
# %%
simulation("tunnelling", still=3.3)
# %% [markdown]
# Let $D$ be the sum of both thicknesses. While $vh \le D$, a ball that hits head on overlaps the wall at the end of at
# least one step. If $vh$ is larger and the ball starts at a random position, one check per step misses the wall with
# the probability
#
# $$P = 1 - \frac{D}{v\,h}, \qquad v\,h > D .$$
#
# **Worked example.** A bolt of 20 mm flies at 50 m/s against a plate of 30 mm, and the step is 2 ms. It travels 100
# mm per step, and $D$ = 50 mm: it passes unnoticed half of the time.
#
# For hard contacts the remedy is **continuous collision detection**: test the whole motion between two steps, or
# compute the time of impact.
#
# There is a second way through a wall. MuJoCo's default contact is soft, so a fast ball sinks in, however small the
# step. Once its centre has passed the middle of the wall, at the overlap $D/2$, the contact pushes it out on the far
# side.
#
# The formula assumes that *every* overlap sends the ball back, as in our program when it checks once per step. A MuJoCo
# contact does so only up to the overlap $D/2$, so $D/2$ replaces $D$ in the formula. The left chart shows it for the
# *one-step contact*, which is stiff enough to stop the ball within a step: balls get through it at half the speed.
# Nothing gets through if the program finds the time of impact within the step (*impact as an event*):
#
# ![Tunnelling](../docs/charts/tunnelling.png)
#
# In the right chart, a smaller step helps the one-step contact only. The default contact lets the ball sink in by its
# speed times 7.29 ms, at any step.
# %% jupyter={"source_hidden": true}
figures(
    read("tunnelling").replace(" (theory)", ""),
    "checked once",
    "MuJoCo, one-step",
    "MuJoCo, default",
    summary="All speeds and steps",
)
# %%
more_claims(
    "contact_seen_is_contact_stopped",
    "continuous_detection_or_smaller_step",
    "penetration_limit_catches",
    "mujoco_ccd_is_continuous",
)
# %% [markdown]
# ### Chatter: a box that never comes to rest
#
# A box lies on the floor, but its simulated contact sensor reports hundreds of impacts per second. Take a ball: if
# its restitution $e$ is the same at every speed, each bounce lasts $e$ times as long as the one before.
# %%
predict("impacts_at_rest")
# %% [markdown]
# So infinitely many bounces fit into a finite time. All kinds of endless bounces are called **chatter**. A box that
# should lie still can also bounce because impacts act at the end of a step. In each step gravity gives the box the
# speed $gh$, the step ends below the floor, and the impact turns the speed upwards.
#
# MuJoCo's *spring*, which we tuned to bounce, chatters too. On MuJoCo's default contact a box lies still.
#
# The longest bar of the chart below comes from the error of semi-implicit flight (explained below the chart). With the
# exact flight of velocity Verlet, the hops of this drop shrink until they are too short for the program to follow, and
# the box lies still.
#
# The remedy is a **rest speed**: after a slower impact, the program sets the body to rest. If impacts are found
# within the step, a small rest speed is enough (except with explicit Euler). If impacts act only at the end of a step,
# it must be higher than about $gh$, here 19.6 mm/s for $h$ = 2 ms.
#
# <details><summary>How high, and when none is needed</summary>
#
# Let $v$ be the speed of the repeated impacts. A ball that should lie still leaves each impact with $ev$, and gravity
# takes $gh$ away. So it hits again with $gh - ev$. If this is $v$ again, then $v = gh/(1+e)$. The corners of a rocking
# box hit at about $gh$. A rest speed of 10 mm/s (0.01 m/s in the table) is too low: the box moves more slowly but hits
# more often. MuJoCo's *spring* starts to push only in the step *after* the one that ended below the floor. By then
# gravity has given the box the speed $gh$.
#
# With explicit Euler a hop does not end within its step, even if impacts are found there. With $e$ = 0.7 most boxes
# still chatter at a rest speed of 25 mm/s. Without any rest speed, exact flight is not always enough: with $e$ = 0.7
# most boxes come to rest, with $e$ = 0.4 most chatter.
#
# </details>
#
# ![Chatter](../docs/charts/chatter.png)
#
# <details><summary>Why the box bounces without end in semi-implicit flight</summary>
#
# Semi-implicit Euler moves the box for a time $s$ with the velocity at the *end* of this time. If a hop starts with
# the speed $v$, this velocity is $v-gs$, and the height is $s\,(v-gs)$. Both are zero at $s = v/g$. So the box is back
# on the floor in half of the true time, and has no speed to rise again: impact follows impact, until the program
# reaches its limit of impacts in the step.
#
# </details>
# %% jupyter={"source_hidden": true}
figures(
    read("chatter"),
    "semi_implicit_euler, in the step, rest speed 0.01",
    "semi_implicit_euler, end of step, rest speed 0  ",
    "semi_implicit_euler, end of step, rest speed 0.01",
    "MuJoCo Euler, impulse",
    "MuJoCo Euler, spring",
    summary="All methods and contacts: impacts per second, and the root mean square (rms) of the speed",
)
# %% [markdown]
# ### Orientation over a million steps
#
# If you add $h\,\dot q$ and scale the result, section 2 predicts a lag of $(\omega h)^3/12$ per step. With 10 mrad
# per step, the measured lag adds up to 0.083 rad after a million steps. In this steady spin the exponential map is
# exact except for rounding. In RK4, both updates are about equally good (the last two rows):
#
# ![Quaternion drift](../docs/charts/quaternion_drift.png)
# %% jupyter={"source_hidden": true}
figures(
    read("quaternion_drift").replace("after 1e6 steps: ", ""),
    "added and renormalised, 10 mrad",
    "exponential map, 10 mrad",
    "tumble over 20 s, rk4 ",
    "tumble over 20 s, rk4_r",
    summary="All updates: errors of length and of orientation",
)
# %% [markdown]
# ### Debugging tips and a table of symptoms
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The simulation explodes.* Compare $h$ with the limit of your integrator, for semi-implicit Euler
# $2/\omega_{\max}$ without damping, and less with damping from the old velocity (first table of this section). Many
# springs together obey $M\ddot x = -Kx$ with the mass and stiffness matrices $M$ and $K$. Here $\omega_{\max}^2$ is
# the largest eigenvalue of $M^{-1}K$. Next, halve the step several times. If that does not help, either the step is
# not the cause, or the integrator has no stable step.
#
# <details><summary>What people get wrong there</summary>
#
# $\sqrt{k/m}$ of the stiffest single spring is only a lower bound for $\omega_{\max}$. Coupled springs can have a much
# higher frequency: two fingers on one part, a chain of masses. And the limit assumes a spring that is always attached.
# A contact that opens and closes can gain energy even below the limit.
#
# An explicit damper lowers the limit of semi-implicit Euler to $\omega h < 2(\sqrt{1+\zeta^2}-\zeta)$. People often
# test $\omega h < 2$ and $hc/m < 2$ one by one, with the damping $c$. Both tests pass for $\zeta = 1$ at $\omega h =
# 0.9$, which is beyond the limit of 0.83. Without damping, a smaller step cures nothing if the integrator is explicit
# Euler.
#
# </details>
#
# </div>
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *Objects pass through each other.* Compare their relative travel per step, $vh$, with the *sum*
# of both thicknesses, in MuJoCo with half of it. If $vh$ is larger, use continuous collision detection (in MuJoCo,
# set the `speculative` flag for this and make the contact stiffer). If $vh$ is much smaller, check that collisions
# between the two objects are switched on, that the objects don't overlap at the start, and that the contact is not too
# soft.
#
# <details><summary>And in between</summary>
#
# If $vh$ is more than half of the sum, the overlap may first be seen when the centre of the body is already past the
# middle of the wall. The contact then pushes it out on the wrong side. The remedy is the same: continuous collision
# detection and a stiff contact.
#
# </details>
#
# </div>
# %%
predict("perfect_energy_wrong_momentum")
# %% [markdown]
# <table> <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr>
# <tr><td>amplitude grows at <em>every</em> step size; at small steps, more slowly with
# each halving</td>
# <td>explicit Euler or explicit midpoint on an undamped oscillation</td> <td>energy ratio
# per step: $1+(\omega h)^2$ or $1+(\omega h)^4/4$</td> <td>Euler: swap the two lines, and keep $\omega h$ well below 2;
# midpoint: Verlet or RK4</td></tr>
# <tr><td>energy right in flight, wrong after bounces</td> <td>bounce rule at the end of the step, or a contact
# spring near its limit</td> <td>drop with $e=1$, compare the heights of the bounces</td> <td>find the time of impact;
# for a spring, a shorter step</td></tr> <tr><td>box jitters on the floor
# for ever</td> <td>impacts at the end of the step (chatter)</td> <td>count impacts
# per second</td> <td>impact times and a rest speed, or a solver that computes impulses (chapter 2)</td></tr>
# <tr><td>orientation drifts</td> <td>quaternion rate added, not multiplied</td> <td>in a steady spin, compare the
# angle with $\omega t$</td>
# <td>$q\exp(h\omega)$</td></tr> <tr><td>an orientation error jumps by $2\pi$, or a controller turns the long way</td>
# <td>$q$ compared with $-q$</td> <td>look at the dot product of the two quaternions</td> <td>flip the sign of one if it
# is negative</td></tr> <tr><td>energy and $\lvert q\rvert$ perfect, but $L$ of a free body turns in the world
# frame</td> <td>body rate multiplied on the left, or gyroscopic term with the wrong sign</td> <td>plot $L$ in the
# world. Repeat with three equal
# moments (no gyroscopic term): if $L$ still turns, the rate stands on the wrong side. Do not start at $q = (1, 0, 0,
# 0)$: from there, a steady spin gives the same $q$ on both sides</td>
# <td>$q\exp(h\omega)$ for body rates, $\exp(h\omega)\,q$ for world rates;
# $I\dot\omega=-\omega\times(I\omega)$</td></tr> <tr><td>satellite speeds up without torque</td>
# <td>the Euler step computes the gyroscopic term from the old rates</td> <td>plot the kinetic energy over time</td>
# <td>RK4, implicit midpoint, smaller step</td></tr>
# </table>
# %%
predict("drift_of_joints")
# %% [markdown]
# ## 8 · Exercises
#
# Each exercise has a card with the task and three hints, a cell to change, and a check on new random cases.
# `check(verlet_step).chart()` draws your correct solution on a work-precision diagram. After a pass,
# `drills.notebook.solution("verlet")` shows the model solution. In a terminal: `drills start verlet`, then
# `drills check verlet`.
# %% [markdown]
# ### Velocity Verlet with one evaluation
# %%
card("verlet")


# %%
def verlet_step(q, v, a, acceleration, dt):
    """Return one step of velocity Verlet.

    Args:
        q, v, a: positions [m], velocities [m/s] and acceleration at q [m/s^2], shape (n,) each.
        acceleration: function q -> acceleration, to be called once.
        dt: step [s].

    Returns:
        The new (q, v, a).
    """
    # Explicit Euler: change this into velocity Verlet.
    q_new = np.asarray(q) + dt * np.asarray(v)
    v_new = np.asarray(v) + dt * np.asarray(a)
    return q_new, v_new, acceleration(q_new)


# %%
check(verlet_step)

# %% [markdown]
# ### Updating a quaternion

# %%
card("orientation")


# %%
def update_orientation(q, omega, dt):
    """Return the orientation after turning for dt at a constant body rate.

    Args:
        q: unit quaternion (w, x, y, z), body to world, shape (4,).
        omega: angular velocity in the body frame, shape (3,) [rad/s].
        dt: step [s].

    Returns:
        Unit quaternion (w, x, y, z), shape (4,).
    """
    # It does not turn yet.
    return np.array(q, dtype=float)


# %%
check(update_orientation)

# %% [markdown]
# ### Bouncing at the time of impact

# %%
card("bounce")


# %%
def bounce_step(y, v, dt, restitution, gravity=9.81):
    """Return height and velocity of a bouncing ball after dt.

    Args:
        y: height above the floor, not negative [m].
        v: velocity, upwards positive [m/s].
        dt: length of the step [s].
        restitution: speed after an impact over speed before, 0 to 1.
        gravity: downwards, positive [m/s^2].

    Returns:
        (y, v) at the end of the step.
    """
    # Free flight: the floor is missing.
    return y + v * dt - 0.5 * gravity * dt**2, v - gravity * dt


# %%
check(bounce_step)

# %% [markdown]
# ### Step limit of a mechanism

# %%
card("stable_step")


# %%
def largest_stable_step(stiffness, mass):
    """Return the longest step at which semi-implicit Euler is stable on M x'' = -K x.

    Args:
        stiffness: K, shape (n, n) [N/m].
        mass: M, shape (n, n) [kg].

    Returns:
        The step [s].
    """
    # A common default, which knows nothing of the model.
    return 0.001


# %%
check(largest_stable_step)

# %% [markdown]
# ### Measuring the order without an exact solution
#
# Make three runs, each with half the step of the one before. If the error is $c\,h^p$, the two differences between
# successive runs have the ratio $2^p$. With the order $p$ you can compute the limit for $h\to0$. This is called
# **Richardson extrapolation**.

# %%
card("observed_order")


# %%
def observed_order(coarse, medium, fine, ratio=2.0):
    """Order of accuracy from three runs, and the result that they are heading for.

    Args:
        coarse, medium, fine: results with the steps r^2 h, r h and h, shape (n,) each [m].
        ratio: r, above 1.

    Returns:
        The order, and the result extrapolated to step zero, shape (n,) [m].
    """
    # Neither is right yet.
    return 1.0, np.array(fine, dtype=float)


# %%
check(observed_order)

# %% [markdown]
# ### Silent-bug hunt
#
# This line updates an orientation from an angular velocity in the body frame:
#
# ```python
# q = quaternion.product(quaternion.exp(dt * omega_body), q)
# ```
#
# The small rotation stands on the wrong side. Neither the length of $q$ nor the kinetic energy reveals this, because
# neither depends on the order of the factors. The angular momentum of a free body, as a vector in the world frame,
# depends on it:

# %%
inertia, dt = np.array([1.0, 2.0, 2.5]), 1e-3
for side in ("right", "left"):
    q, omega = quaternion.exp(np.array([0.4, -0.3, 0.8])), np.array([0.5, 2.0, 1.0])
    momentum = quaternion.rotate(q, inertia * omega)
    energy = 0.5 * inertia @ omega**2
    for _ in range(2000):
        half = omega - 0.5 * dt * np.cross(omega, inertia * omega) / inertia
        turn = quaternion.exp(dt * half)
        q = quaternion.product(q, turn) if side == "right" else quaternion.product(turn, q)
        omega = omega - dt * np.cross(half, inertia * half) / inertia
    moved = quaternion.rotate(q, inertia * omega) - momentum
    print(
        f"rotation on the {side:<5}: |q| = 1: {abs(np.linalg.norm(q) - 1) < 1e-12}, error of energy "
        f"{abs(0.5 * inertia @ omega**2 / energy - 1):.1g}, |change of L| / |L| = "
        f"{np.linalg.norm(moved) / np.linalg.norm(momentum):.1g}"
    )

# %% [markdown]
# Now find a bug:

# %%
card("tumble")


# %%
def tumble(q, omega, inertia, dt, steps):
    """Return a body that turns freely, integrated with RK4.

    Args:
        q: orientation, unit quaternion (w, x, y, z), body to world, shape (4,).
        omega: angular velocity in the body frame, shape (3,) [rad/s].
        inertia: principal moments, shape (3,) [kg m^2].
        dt: step [s].
        steps: how many.

    Returns:
        (q, omega) at the end.
    """
    inertia = np.asarray(inertia, dtype=float)

    def rates(q, omega):
        w, x, y, z = q
        i, j, k = omega
        q_rate = 0.5 * np.array(
            [
                -x * i - y * j - z * k,
                w * i + y * k - z * j,
                w * j + z * i - x * k,
                w * k + x * j - y * i,
            ]
        )
        omega_rate = np.cross(omega, inertia * omega) / inertia
        return q_rate, omega_rate

    q, omega = np.array(q, dtype=float), np.array(omega, dtype=float)
    for _ in range(steps):
        q1, w1 = rates(q, omega)
        q2, w2 = rates(q + 0.5 * dt * q1, omega + 0.5 * dt * w1)
        q3, w3 = rates(q + 0.5 * dt * q2, omega + 0.5 * dt * w2)
        q4, w4 = rates(q + dt * q3, omega + dt * w3)
        q = q + dt / 6.0 * (q1 + 2.0 * q2 + 2.0 * q3 + q4)
        omega = omega + dt / 6.0 * (w1 + 2.0 * w2 + 2.0 * w3 + w4)
        q = q / np.linalg.norm(q)
    return q, omega


# %%
check(tumble)

# %% [markdown]
# ### Formulas
#
# What is the largest stable step of RK4 on an undamped spring of angular frequency $\omega$? And that of semi-implicit
# Euler on a mass $m$ with a spring $k$? The cells below contain examples of wrong answers.
# <span class="kernel-only">Replace the text in quotes.</span> Any equivalent form counts.

# %%
answer("rk4_limit", "2/omega")

# %%
answer("semi_implicit_limit", "sqrt(m/k)")

# %% [markdown]
# <details><summary>Others to try</summary>
#
# `explicit_energy_factor` (energy after one step divided by the energy before, in `omega` and `h`), `top_condition`
# (smallest stable spin in `I1`, `I3`, `m`, `g`, `l`).
#
# </details>
#
# ## 9 · Frontier: differentiable simulation
#
# ### Gradients of a whole simulation
#
# You recorded how a real block slides. With which friction coefficient does your simulator reproduce the recording? If
# you knew the *derivative* of the error with respect to each parameter, you could follow it downhill instead of trying
# many values.
#
# **Finite differences** change one parameter at a time, so each parameter costs one more run. But a simulation is a
# long chain of simple operations, so the chain rule applies. **Reverse mode** (also called backpropagation) runs the
# simulation once forward, stores all its states, and goes through them once backward. It returns the derivatives of
# one number, such as the error, with respect to *all* parameters, in the time of a few runs.
#
# Now drop a ball from rest, at the height $H$. Its bounce depends on *when* it hits the floor. A program that handles
# impacts only at the end of a step never computes that time. If the ball is then below the floor, the program sets its
# height to 0 and its velocity $v$ to $-ev$.
# %%
predict("gradient_through_an_impact")
# %% tags=["hide-code"]
figure_, (upper, lower) = plt.subplots(
    2, 1, figsize=(9, 4.4), sharex=True, height_ratios=(2, 1), layout="constrained"
)
g, e, time = problems.STANDARD_GRAVITY, 0.6, np.linspace(0, 0.8, 801)
heights = {}
for H, colour in ((1.0, "tab:blue"), (1.05, "tab:orange")):
    hit = np.sqrt(2 * H / g)
    since = time - hit
    heights[H] = np.where(
        since < 0, H - g * time**2 / 2, e * np.sqrt(2 * g * H) * since - g * since**2 / 2
    )
    upper.plot(time, heights[H], color=colour, label=f"dropped from {H:g} m")
    upper.plot(hit, 0, "*", color=colour, ms=11)
upper.axhline(0, color="0.3")
upper.set(ylabel="height [m]", title=f"two drop heights, two impact times; restitution e = {e:g}")
upper.legend()
slope = (heights[1.05] - heights[1.0]) / 0.05
hit, speed = np.sqrt(2 / g), np.sqrt(2 * g)
derivative = np.where(time < hit, 1.0, -e + (1 + e) * g / speed * (time - hit))
lower.plot(time, slope, color="tab:green", label="difference divided by 5 cm")
lower.plot(time, derivative, color="0.2", ls="--", lw=1.2, label="derivative at 1 m")
lower.axhline(0, color="0.8", lw=0.8)
lower.set(xlabel="time [s]", ylabel="change of height\nper drop height")
lower.legend(fontsize=9, loc="lower left")
plt.show()
print(f"before the impacts: difference {slope[100]:+.2f}, derivative {derivative[100]:+.2f}")
print(f"at 0.8 s:           difference {slope[-1]:+.2f}, derivative {derivative[-1]:+.2f}")
# %% [markdown]
# Before the impacts the curves stay as far apart as at the start, so the derivative with respect to the drop height
# $H$ is 1. At the impact it jumps to $-e$: when the second ball lands, the first is already above it. Then the
# derivative rises, because the second ball leaves the floor faster, and gravity has slowed it for a shorter time.
#
# <details><summary>Derive it: the derivative after the impact</summary>
#
# A ball from the height $H + dH$ lands later by $dH/v$, where $v$ is the impact speed. In this time the first ball
# rises by $e\,v\,(dH/v) = e\,dH$. So when the second ball lands, it is $e\,dH$ *below* the first.
#
# After the impact at $t_1 = \sqrt{2H/g}$ the height is $e\,v\,(t-t_1) - \tfrac12 g\,(t-t_1)^2$ with $v = \sqrt{2gH}$.
# Its derivative with respect to $H$ starts at $-e$ and increases by $(1+e)\,g/v$ per second. Hu et al. (2020) correct
# the gradient with the time of impact. Suh et al. (2022) show how such errors affect training with gradients.
#
# </details>
#
# A program with impacts at the end of a step loses this. At the bounce the height is 0 and the speed is $gh$ times
# the number of steps. Only this *number* depends on the drop height. It is an integer, and its derivative is zero.
# The error of the height shrinks with the step, but the gradient stays wrong:
# %% tags=["hide-code"]
from course.rigid_body.differentiable import (
    Setup,
    drop_gradients,
    information,
    naive_drop_gradients,
    record,
    recover,
)

exact = drop_gradients(1.0, 0.6, 0.8)
print("derivative of the height at 0.8 s with respect to the drop height of 1 m")
print(f"time of impact computed:      {exact.by_height:+.4f}   (height {exact.height:.4f} m)")
for dt in (1e-2, 1e-3):
    naive = naive_drop_gradients(1.0, 0.6, dt, 0.8)
    print(
        f"end of the step, {1e3 * dt:3.0f} ms:      {naive.by_height:+.4f}   (height {naive.height:.4f} m)"
    )
# %% [markdown]
# With computed impact times, two runs and reverse mode (*autograd*) are both accurate. (Reverse mode is worth it if
# there are many parameters. Here there is one, and PyTorch's overhead makes it slower.) MuJoCo does not compute impact
# times. There, two whole runs whose drop heights differ by centimetres are better than the derivatives of its steps:
#
# ![Error of the derivative of a bounce against its time](../docs/charts/gradient_precision.png)
#
# <details><summary>MuJoCo's derivatives in the chart</summary>
#
# MuJoCo differentiates one step by finite differences (`mjd_transitionFD`), which gives a matrix for each step. The
# product of these matrices is the derivative of the *simulated* bounce. With a one-step contact (*impulse*) its error
# does not shrink with the step; with a *soft* contact it shrinks slowly. *Two runs* divides the difference of two
# results by that of the drop heights. Each impact is late by less than a step. This matters little if the heights
# differ by centimetres.
#
# </details>
#
# ### What a recording can tell
#
# The course has a small differentiable simulator in PyTorch. It computes the impact times, so their derivatives are
# right. A block is thrown, bounces, slides and is pushed. We record it with 1 mm of noise and recover its
# restitution, friction coefficient and mass. The number after `+-` is the *standard error*, the scatter that the
# noise causes. `chi^2 per degree` (of freedom) is the mean squared error of the fit, divided by that of the noise.
# Near 1, the remaining error is as large as the noise:
# %% tags=["show-code"]
# The push: from 1.2 s to 1.5 s with 8 N.
scene = Setup(position=(0.0, 0.5), velocity=(2.0, 0.0), push=((1.2, 1.5, 8.0),))
times = np.linspace(0.0, 2.0, 101)
truth = (0.6, 0.25, 1.3)
recorded = record(truth, scene, times, noise=1e-3, generator=np.random.default_rng(0))
print(recover(recorded, scene, guess=(0.4, 0.4, 1.0)))
# %% [markdown]
# A gradient can find only parameters that change the recorded motion.
# %%
predict("what_a_drop_tells")
# %% [markdown]
# To check this in advance, collect the derivatives of all recorded positions with respect to the parameters in one
# matrix, the Jacobian. If one of its singular values is zero, some combination of small changes of the parameters
# leaves no trace in the recording. A drop without tilt or spin says nothing about friction or mass. A block that does
# not move under a push gives only a lower *bound* for the friction, the push divided by the weight:
# %% tags=["hide-code"]
for label, poor in (
    ("a drop without tilt or spin", Setup((0.0, 0.5))),
    ("a block that sticks under a push", Setup((0.0, 0.0), push=((0.2, 1.0, 2.0),))),
):
    print(f"--- {label}\n{information(truth, poor, times)}\n")
# %% [markdown]
# <details><summary>Engines with gradients</summary>
#
# <table>
# <tr><th>engine</th> <th>runs on</th> <th>known for</th></tr>
# <tr><td>Brax (Freeman et al. 2021)</td> <td>JAX</td> <td>rigid bodies on accelerators, for reinforcement
# learning</td></tr>
# <tr><td>DiffTaichi (Hu et al. 2020)</td> <td>Taichi</td> <td>gradients of simulation programs; correction by the time
# of impact</td></tr>
# <tr><td>Warp (Macklin 2022)</td> <td>GPU and CPU, programmed in Python</td> <td>reverse-mode gradients of simulation
# code</td></tr>
# <tr><td>MuJoCo MJX (2023)</td> <td>JAX</td> <td>MuJoCo's models and contacts on accelerators</td></tr>
# <tr><td>Dojo (Howell et al. 2022)</td> <td>CPU, in Julia</td> <td>hard contacts, with smoothed gradients</td></tr>
# </table>
#
# </details>
# %%
more_claims(
    "gradient_by_differences",
    "gradient_search_is_linear",
    "every_recording_identifies",
    "smooth_gradients_by_draws",
    "mjx_is_differentiable",
)
# %% [markdown]
# ## 10 · Interview
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** *Which integrator?* Give three numbers for each: order, cost per step, stability limit. Then say
# what your scene needs. "Semi-implicit Euler is first order, costs one evaluation, and on an undamped spring needs
# $\omega h<2$; damping from the old velocity lowers that. In smooth bounded motion, with forces from a potential and
# accelerations that depend on positions alone, its energy does not drift at a small fixed step. RK4 is fourth order,
# costs four evaluations, and on the same spring needs $\omega h\le2\sqrt2$. If impacts act only at the end of a step,
# both are of first order, so I take the cheap one. For a satellite I take RK4."
#
# </div>
#
# Answer aloud before you open an answer. The levels are
# *screen* (a first call), *senior* and *staff* (above senior).
# %%
interview("rigid_body")
# %% [markdown]
# ### Checkpoint
#
# Five random questions on this chapter. Type your answers between the quotation marks below.
# %%
checkpoint("rigid_body", ["", "", "", "", ""], seed=1)
