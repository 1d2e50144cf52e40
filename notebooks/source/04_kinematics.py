# %% [markdown]
# # 4 · Kinematics and dynamics of arms
#
# *A robot arm moves smoothly towards a part, and suddenly two joints spin at full speed although the hand hardly
# moves. Another arm stops in front of its target and never gets there. Both faults come from the way joint angles are
# computed.*
#
# Below, a two-link arm follows a target in small steps, each computed from how the tip moves when a joint turns a
# little. The question below has the arm stretched; the simulation after it starts bent. Section 1 explains the numbers
# below the picture.
#
# About {open minutes} minutes of reading, cards and charts. The folded parts add {folded minutes} minutes, the
# exercises {exercise minutes} minutes. The interview answers in section 9 are not counted.

# %%
from course.cards import predict
from course.simulations import simulation

predict("inward_from_stretched")

# %% [markdown]
# ![Two links follow a target](attachment:kinematics.arm.png)

# %%
simulation("arm")

# %% [markdown]
# **After this chapter you can** compute where the hand of any arm is and how fast it moves; derive the joint angles of
# a two-link arm on paper, and solve larger arms step by step; explain what goes wrong where the arm is stretched, and
# what damping costs; use a spare joint; and compute the torques behind a motion. You need vectors, matrices and
# derivatives, and chapter 1 for quaternions and integrators.
#
# ## How this chapter works
#
# Every measured number comes from a cell on this page, from a chart, or from a check that `python -m course.derivations
# 4` runs again. The code is the package `course.kinematics`. These exercises wait in section 7:

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint, your_robot

badges(4)

# %% tags=["hide-code"]
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
from course.charts.kinematics import motion
from course.derivations import more_claims, show
from course.kinematics import ik, jacobian, panda, planar, tip, two_link_ik
from course.rigid_body.quaternion import to_matrix


def source(*functions):
    """Show functions as they are in the module."""
    text = "\n\n".join(inspect.getsource(f) for f in functions)
    return Markdown(f"```python\n{text}```")


def listed(numbers):
    """Return numbers to two places in one line."""
    return " ".join(f"{number + 0.0:.2f}" for number in np.round(numbers, 2))


def print_figures(chart, *rows):
    """Print the key figures of a chart whose lines begin with one of the given words."""
    for line in read(chart).splitlines():
        words = " ".join(line.split())
        if words.startswith(rows):
            print(textwrap.fill(words, 96, subsequent_indent="    "))


# %% [markdown]
# ## 1 · Concept: position, velocity and torque of an arm
#
# ### Forward kinematics: where is the hand?
#
# The motors of an arm know angles. The task is about a place: the cup stands 60 cm in front of the base.
#
# An arm is a chain of rigid **links** connected by **joints**. A *revolute* joint (R) turns, a *prismatic* joint
# slides. The **end effector** is what does the work at the end of the chain: a gripper, a tool. We call the point on it
# that matters the **tip**. In **joint space**, a point is the list $q$ of all joint values. In **task space** a point
# is what the task specifies: the position of the tip, or its **pose**, which is position and orientation.
# **Forward kinematics**, FK, maps the first to the second.
#
# Attach a coordinate frame to each joint. A **homogeneous transform** is the $4\times4$ matrix that contains the
# position and the rotation of one frame in another; multiplying two of them chains them. Let $A_i$ be the fixed pose
# of frame $i$ in frame $i-1$ while joint $i$ is at angle zero, and let $R_z(q_i)$ be the turn of frame $i$ about its
# own $z$ axis by the joint angle. If all joints are revolute, and $T_{\text{tool}}$ is the pose of the tip in the last
# frame,
#
# $$T_{\text{tip}} = A_1\,R_z(q_1)\;A_2\,R_z(q_2)\cdots A_n\,R_z(q_n)\;T_{\text{tool}} .$$
#
# The result always exists, is unique, and depends smoothly on $q$.

# %% tags=["hide-code"]
lengths, posture = (1.0, 0.8), np.radians([30.0, 60.0])
two = planar(lengths)
joints = np.column_stack([kinematics.frames(two, posture)[:2], tip(two, posture)[:2]])
figure_, axes = plt.subplots(1, 2, figsize=(9.6, 3.8), layout="constrained")
for axis, title in zip(axes, ("a frame in each joint", "two conventions for q2"), strict=True):
    _ = axis.plot(*joints, "o-", color="#9bb7d4", linewidth=8, markersize=10)
    _ = axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title=title)
    _ = axis.set(xlim=(-0.3, 1.9), ylim=(-0.2, 1.8))
for i, heading in enumerate((posture[0], posture.sum(), posture.sum())):
    for turn, colour in ((0.0, "tab:red"), (np.pi / 2, "tab:green")):
        heading_arrow = 0.25 * np.array([np.cos(heading + turn), np.sin(heading + turn)])
        _ = axes[0].quiver(
            *joints[:, i],
            *heading_arrow,
            color=colour,
            angles="xy",
            scale_units="xy",
            scale=1,
            zorder=5,
        )
    _ = axes[0].text(*(joints[:, i] + [0.1, -0.13]), ("joint 1", "joint 2", "tip")[i])
_ = axes[1].plot([joints[0, 1], 1.6 * joints[0, 1]], [joints[1, 1], 1.6 * joints[1, 1]], "k:")
_ = axes[1].plot([joints[0, 1], joints[0, 1] + 0.6], [joints[1, 1]] * 2, "k:")
for start, end, radius, name in (
    (posture[0], posture.sum(), 0.3, "q2 from link 1"),
    (0.0, posture.sum(), 0.5, "q2 from the x axis"),
):
    arc = np.linspace(start, end, 40)
    curve = joints[:, 1:2] + radius * np.array([np.cos(arc), np.sin(arc)])
    (line,) = axes[1].plot(*curve, label=name, linewidth=2)
_ = axes[1].legend(loc="upper left")
plt.show()

# %%
show("fk_is_a_product")

# %% [markdown]
# For two links in a plane, with $q_2$ measured from the first link (the blue arc on the right), the product is
#
# $$x = l_1\cos q_1 + l_2\cos(q_1+q_2), \qquad y = l_1\sin q_1 + l_2\sin(q_1+q_2) .$$
#
# **Worked example.** Take $l_1 = 1$ m, $l_2 = 0.8$ m, $q_1 = 30°$ and $q_2 = 60°$, the posture in the drawing. The
# second link points straight up, at $30° + 60° = 90°$. So $x = 0.866 + 0 = 0.866$ m and $y = 0.5 + 0.8 = 1.3$ m.
#
# Always ask how an angle is measured. The sensor of an angle is called an **encoder**. Some elbow motors sit in the
# base and drive the second link through a belt over equal pulleys. If only joint 1 turns, the belt keeps the direction
# of the second link. So this motor's encoder measures from the $x$ axis (the orange arc). Then write $q_2$ where the
# formula has $q_1+q_2$.
#
# The same product works in space. From here on, our larger example is an arm with seven revolute joints, a **7-R
# arm**, with the dimensions of the Franka Panda. The course stores a pose as seven numbers, a position and a unit
# quaternion. The cell compares this product with the library function `tip`:

# %% tags=["show-code"]
arm = panda()
q = np.array([0.3, -0.4, 0.1, -1.9, 0.0, 1.7, 0.6])
hand = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])  # the base: position, then quaternion
for angle, placement in zip(q, arm.placement.T, strict=True):
    turn = np.array([0.0, 0.0, 0.0, np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)])
    hand = kinematics.compose(hand, kinematics.compose(placement, turn))
hand = kinematics.compose(hand, arm.tool)
print("position of the tip [m]:", hand[:3].round(4))
print("same as tip(arm, q) up to rounding:", np.abs(hand - tip(arm, q)).max() < 1e-14)

# %%
more_claims("two_link_position")

# %% [markdown]
# ### Denavit-Hartenberg parameters and the product of exponentials
#
# **Homogeneous transforms** place each joint's frame with six numbers. URDF robot files use them (with an axis
# direction in addition), and so does this course's `Chain`.
#
# **Denavit-Hartenberg** parameters need only four numbers per joint, two lengths and two angles. You may shift each
# frame along its joint's axis and turn it about this axis, so that two of the six numbers become zero. The transform of
# one joint, turn included, is
#
# $$D_i(q_i) = R_z(q_i)\;\mathrm{Trans}_z(d_i)\;\mathrm{Trans}_x(a_i)\;R_x(\alpha_i) .$$
#
# For our two links, $a_1 = l_1$, $a_2 = l_2$, and every $d$ and $\alpha$ is zero. The two most common conventions are
# the original one (1955), shown here, and Craig's, which orders the factors differently and is used for the published
# numbers of the Panda. Read in the wrong convention, a table describes a different arm.
#
# In general base and tool still need full transforms. The tool of our 7-R arm lies along the last axis, so it fits
# into the table as the $d$ of the last row:


# %% tags=["show-code"]
def denavit_hartenberg(turn, d, a, alpha):
    """Return the 4 x 4 transform of one joint; d and a in metres, the angles in radians."""
    c, s, ca, sa = np.cos(turn), np.sin(turn), np.cos(alpha), np.sin(alpha)
    about_z = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, d], [0, 0, 0, 1]])
    about_x = np.array([[1, 0, 0, a], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1]])
    return about_z @ about_x


d = [0.333, 0.0, 0.316, 0.0, 0.384, 0.0, 0.107]
a = [0.0, 0.0, 0.0825, -0.0825, 0.0, 0.088, 0.0]
alpha = np.radians([-90, 90, 90, -90, 90, 90, 0])
dh_frames = [np.eye(4)]
for row in zip(q, d, a, alpha, strict=True):
    dh_frames.append(dh_frames[-1] @ denavit_hartenberg(*row))
pose = tip(arm, q)
same = np.allclose(dh_frames[-1][:3, 3], pose[:3], atol=1e-14)
turned = np.allclose(dh_frames[-1][:3, :3], to_matrix(pose[3:]), atol=1e-14)
print(f"frame 7 is the tip: position {same}, orientation {turned}")


# %% tags=["hide-code"]
def space(figure_, rows, columns, index, title, high=1.0):
    """Return axes for a drawing of the 7-R arm in space, all three at the same scale."""
    axis = figure_.add_subplot(rows, columns, index, projection="3d", proj_type="ortho")
    _ = axis.set(xlim=(-0.35, 0.6), ylim=(-0.4, 0.4), zlim=(0.0, high))
    axis.set_box_aspect((0.95, 0.8, high), zoom=1.15)
    axis.view_init(20, -58)
    _ = axis.set(xticks=[0, 0.5], yticks=[0], zticks=np.arange(0.0, high + 0.1, 0.5))
    _ = axis.set(xlabel="x [m]", ylabel="y", zlabel="z [m]")
    axis.tick_params(labelsize=9, pad=0)
    _ = axis.set_title(title, fontsize=13)
    return axis


figure_ = plt.figure(figsize=(6.0, 5.2))
figure_.subplots_adjust(0.0, 0.04, 0.97, 0.93)
axis = space(figure_, 1, 1, 1, "Denavit-Hartenberg frames of the 7-R arm", high=0.85)
places = {}
for i, frame in enumerate(dh_frames):
    places.setdefault(tuple(frame[:3, 3].round(6)), []).append(str(i))
    for k, colour in enumerate(("tab:red", "tab:green", "tab:blue")):
        name = f"{'xyz'[k]} of each frame" if i == 0 else None
        _ = axis.quiver(*frame[:3, 3], *(0.12 * frame[:3, k]), color=colour, lw=1.8, label=name)
for i in range(7):
    start, z_axis, x_axis = dh_frames[i][:3, 3], dh_frames[i][:3, 2], dh_frames[i + 1][:3, 0]
    corner = start + d[i] * z_axis
    for ends, colour, name in (
        ((start, corner), "#9bb7d4", "d: along z"),
        ((corner, corner + a[i] * x_axis), "#e8a39a", "a: along the next x"),
    ):
        _ = axis.plot(*np.transpose(ends), color=colour, lw=7, label=name if i == 0 else None)
for place, names in places.items():
    _ = axis.text(*(np.array(place) + [0.05, -0.09, -0.04]), ", ".join(names), fontsize=13)
_ = axis.legend(fontsize=10, loc=(0.53, 0.27))
plt.show()

# %% [markdown]
# The numbers in the drawing are those of the frames. Frames 1 and 2 share one origin: only their axes differ. To get
# from one frame to the next, go $d$ along this frame's $z$ (blue bar), then $a$ along the next frame's $x$ (red bar).
#
# The **product of exponentials** needs no frame between base and tip. It describes each joint by the motion that the
# joint causes. The velocity of a rigid body is a **twist** $(\omega, v)$. $\omega$ is its angular velocity. For $v$,
# imagine the body large enough to cover the origin; $v$ is its velocity there. Let a joint turn at 1 rad/s about an
# axis along the unit vector $\hat\omega$ through the point $c$. The twist that it causes is called the **screw** of
# the joint:
#
# $$S = \begin{pmatrix} \hat\omega \\ c\times\hat\omega \end{pmatrix}, \qquad
# [S] = \begin{pmatrix} {[\hat\omega]} & c\times\hat\omega \\ 0 & 0 \end{pmatrix},$$
#
# where $[\hat\omega]$ is the matrix of the cross product, $[\hat\omega]\,x = \hat\omega\times x$.  (A joint that slides
# along $\hat v$ has $S = (0, \hat v)$.)

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 2, figsize=(9.6, 3.8), layout="constrained")
grid = np.array(np.meshgrid(np.linspace(-0.2, 2.2, 9), np.linspace(-0.9, 0.9, 7))).reshape(2, -1)
field = np.array([-grid[1], grid[0] - lengths[0]])
_ = axes[0].quiver(*grid, *field, color="0.6", angles="xy", scale=7, width=0.004)
_ = axes[0].plot([0, 1, 1.8], [0, 0, 0], "o-", color="#9bb7d4", linewidth=8, markersize=10)
_ = axes[0].plot(1, 0, "o", color="tab:red", markersize=12, label="axis of joint 2")
_ = axes[0].quiver(
    0, 0, 0, -0.8, color="tab:red", angles="xy", scale_units="xy", scale=1, label="v"
)
_ = axes[0].set(title="the twist of joint 2", xlim=(-0.4, 2.4), ylim=(-1.1, 2.0))
_ = axes[0].legend(loc="upper right")
bent = np.column_stack(
    [kinematics.frames(two, [0.0, posture[1]])[:2], tip(two, [0, posture[1]])[:2]]
)
for points, colour, name in (
    (np.array([[0, 1, 1.8], [0, 0, 0]]), "0.8", "1. zero posture"),
    (bent, "tab:orange", "2. joint 2 turned by 60°"),
    (joints, "#3b6ea5", "3. then joint 1 by 30°"),
):
    _ = axes[1].plot(*points, "o-", color=colour, linewidth=6, markersize=9, label=name)
_ = axes[1].set(title="the product, read from right to left", xlim=(-0.2, 2.2), ylim=(-0.2, 2.2))
_ = axes[1].legend(loc="upper left")
for axis in axes:
    _ = axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
plt.show()

# %% [markdown]
# Left: a twist assigns a velocity to every point of space; these velocities circle around the axis. The red arrow is
# $v$ (drawn shorter), the velocity at the origin. A body that moves with the constant twist $S$ through the angle $q$
# is displaced by the matrix exponential $e^{[S]q}$, the rotation about that axis. With $T_0$, the pose of the tip in
# the zero posture,
#
# $$T_{\text{tip}} = e^{[S_1]q_1}\;e^{[S_2]q_2}\cdots e^{[S_n]q_n}\;T_0 .$$
#
# All screws are written down once, in the zero posture. Read the product from right to left, as in the drawing: turn
# the last joint first. The joints nearer to the base are then still in the zero posture, so their axes are where we
# wrote them down.
#
# <details><summary>Worked example: two links</summary>
#
# The elbow's axis passes through $(1, 0, 0)$ m, so $S_2 = (0, 0, 1;\; 0, -1, 0)$. It moves the tip from $(1.8, 0)$ to
# $(1 + 0.8\cos 60°,\; 0.8\sin 60°) = (1.4,\; 0.693)$ m. The shoulder rotates this point by $30°$ about the origin, to
# $(0.866,\; 1.3)$ m: the same tip as above.
#
# </details>
#
# If a transform $T = (R, p)$ displaces an axis, the **adjoint** of $T$ converts the twist about the old axis to the
# twist about the new one. (The same matrix rewrites a twist in another frame.)
#
# $$\mathrm{Ad}_T = \begin{pmatrix} R & 0 \\ [p]\,R & R \end{pmatrix} .$$
#
# The joints before joint $i$ displace its axis by $T_{i-1} = e^{[S_1]q_1}\cdots e^{[S_{i-1}]q_{i-1}}$. So the twist
# of joint $i$ becomes $S_i' = \mathrm{Ad}_{T_{i-1}} S_i = (\omega_i, v_i)$. A body with this twist moves its point at
# $p$ with the velocity $v_i + \omega_i\times p$. The cell checks tip and velocities for both arms:

# %% tags=["show-code"]
from scipy.linalg import expm


def bracket(S):
    """Return the 4 x 4 matrix of a twist S = (w, v)."""
    result = np.zeros((4, 4))
    result[:3, :3], result[:3, 3] = np.cross(np.eye(3), S[:3]), S[3:]
    return result


def adjoint(T):
    """Return the 6 x 6 matrix that moves a twist by the transform T."""
    R, p = T[:3, :3], np.cross(np.eye(3), T[:3, 3])
    return np.block([[R, np.zeros((3, 3))], [p @ R, R]])


def exponentials(screws, angles):
    """Return how the last link is displaced, and the twist of each joint where it is now."""
    T, twists = np.eye(4), []
    for S, angle in zip(screws, angles, strict=True):
        twists.append(adjoint(T) @ S)
        T = T @ expm(bracket(S) * angle)
    return T, np.array(twists)


def screws_in_zero_posture(chain):
    """Return S = (w, c x w) for each revolute joint of a chain."""
    zero = kinematics.frames(chain, np.zeros(len(chain.mass)))
    w = to_matrix(zero[3:])[:, 2]
    return np.vstack([w, np.cross(zero[:3], w, axis=0)]).T


for name, chain, angles in (("two links", two, posture), ("7-R arm", arm, q)):
    T, twists = exponentials(screws_in_zero_posture(chain), angles)
    p = (T @ [*tip(chain, 0.0 * angles)[:3], 1.0])[:3]
    v = twists[:, 3:] + np.cross(twists[:, :3], p)  # velocity of the tip per joint
    position = np.allclose(p, tip(chain, angles)[:3], atol=1e-14)
    velocity = np.allclose(v.T, jacobian(chain, angles)[:3], atol=1e-14)
    print(f"{name}: tip {p.round(4)} m; same as tip(): {position}, as jacobian(): {velocity}")

# %% tags=["hide-code"]
figure_ = plt.figure(figsize=(8.6, 5.2))
figure_.subplots_adjust(0.0, 0.04, 0.94, 0.93, 0.08)
axis = space(figure_, 1, 2, 1, "seven screws, and the twist of joint 2")
points = kinematics.frames(arm, q)[:3]
skeleton = np.column_stack([np.zeros(3), points, p])
_ = axis.plot(*skeleton, color="#9bb7d4", lw=7)
for i, (w, c) in enumerate(zip(twists[:, :3], points.T, strict=True)):
    colour = "tab:red" if i == 1 else "0.35"
    _ = axis.plot(*np.transpose([c - 0.2 * w, c + 0.2 * w]), "--", color=colour, lw=1)
    _ = axis.quiver(*c, *(0.2 * w), color=colour, lw=2)
    _ = axis.plot(*c, "o", color=colour, ms=5)
    _ = axis.text(*(c + 0.29 * w), str(i + 1), color=colour, fontsize=15, ha="center", va="center")
w, c = twists[1, :3], points[:, 1]
middle = c + w * (w @ (p - c))  # on the axis, level with the tip
across = p - middle
turn = np.radians(np.linspace(-105.0, 60.0, 12))
for share in (0.4, 0.7, 1.0):
    ring = share * (np.outer(across, np.cos(turn)) + np.outer(np.cross(w, across), np.sin(turn)))
    ring += middle[:, None]
    flow = twists[1, 3:, None] + np.cross(w, ring, axisb=0, axisc=0)
    _ = axis.quiver(*ring, *(0.3 * flow), color="0.6", lw=1)
_ = axis.quiver(*p, *(0.3 * v[1]), color="tab:red", lw=3)
_ = axis.plot(*p, "o", color="#1f4e79", ms=8)
axis = space(figure_, 1, 2, 2, "the product, read from right to left", high=1.2)
for turned, colour, name in (
    (np.zeros(7), "0.75", "1. zero posture"),
    (np.where(np.arange(7) > 2, q, 0.0), "tab:orange", "2. joints 7 to 4 turned"),
    (q, "#3b6ea5", "3. then joints 3 to 1"),
):
    bent = np.column_stack([np.zeros(3), kinematics.frames(arm, turned)[:3], tip(arm, turned)[:3]])
    _ = axis.plot(*bent, "o-", color=colour, lw=5, ms=7, label=name)
_ = axis.legend(fontsize=11, loc=(0.5, 0.8))
plt.show()

# %% [markdown]
# Left: the screws of the 7-R arm in the posture `q`, as arrows along $\omega_i$ from a point of each axis. Joint 2
# turns at 1 rad/s. The red arrow is the velocity of the tip. The grey ones are the velocities of other points in the
# same plane perpendicular to axis 2 (0.3 m for 1 m/s). Right: the product, from the zero posture to `q`.
#
# ### The Jacobian: how fast does the hand move?
#
# To follow a moving target, or to correct a small error, you need to know how the tip moves when each joint turns a
# little. The **Jacobian** $J$ is the matrix of partial derivatives: tip velocity $= J(q)\,\dot q$. For two links, with
# $s_1$ short for $\sin q_1$, $s_{12}$ short for $\sin(q_1+q_2)$, and $c$ for the cosines,
#
# $$J = \frac{\partial(x, y)}{\partial(q_1, q_2)} =
# \begin{pmatrix} -l_1s_1-l_2s_{12} & -l_2s_{12} \\ l_1c_1+l_2c_{12} & l_2c_{12} \end{pmatrix} .$$
#
# Column $i$ is the tip velocity that joint $i$ causes when it turns alone at 1 rad/s. You can draw it without
# differentiating: it is perpendicular to the line from the joint to the tip, and as long as that line.

# %% tags=["hide-code"]
J = jacobian(two, posture)[:2]
figure_, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
_ = axes.plot(*joints, "o-", color="#3b6ea5", linewidth=6, markersize=9)
for i, colour in enumerate(("tab:orange", "tab:green")):
    _ = axes.plot(*joints[:, [i, 2]], "--", color=colour)
    _ = axes.quiver(*joints[:, 2], *J[:, i], color=colour, scale=2.5, scale_units="xy", angles="xy")
    _ = axes.text(*(joints[:, 2] + 0.44 * J[:, i]), f"column {i + 1}", color=colour, ha="right")
_ = axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", xlim=(-0.6, 1.6), ylim=(-0.1, 2.0))
_ = axes.set_title("the columns of J, drawn at 0.4 of their length")
plt.show()
for i in range(2):
    line = joints[:, 2] - joints[:, i]
    print(
        f"joint {i + 1}: {np.linalg.norm(line):.3f} m from the tip; its column is "
        f"{np.linalg.norm(J[:, i]):.3f} m/rad long, perpendicular: {abs(line @ J[:, i]) < 1e-12}"
    )

# %% [markdown]
# **Worked example.** In the same posture the columns are $(-1.3,\; 0.866)$ and $(-0.8,\; 0)$ m/rad. Turn both joints
# at 1 rad/s and the tip moves at $(-2.1,\; 0.866)$ m/s.
#
# In space a column has six numbers. With the axis $z_i$ of the joint, and the line $p - p_i$ from the joint to the
# tip, both in world axes,
#
# $$J_i = \begin{pmatrix} z_i\times(p-p_i) \\ z_i\end{pmatrix}
# \quad\text{if joint } i \text{ is revolute},\qquad
# \begin{pmatrix} z_i \\ 0\end{pmatrix} \quad\text{if it is prismatic.}$$
#
# This is the **geometric Jacobian**, with the linear rows first (in the twists above, $\omega$ came first). Pinocchio,
# the C++ library of section 5, calls this choice `LOCAL_WORLD_ALIGNED`: velocity of the tip, in world axes. The lower
# three rows give the angular velocity, which is not the derivative of any three angles. The **analytic Jacobian**
# replaces these rows by the rates of Euler angles. At **gimbal lock**, the axes of two of the three angles lie on one
# line. Close to it the entries grow without bound, even where the arm itself is fine.
#
# **Forces use the transpose.** Leave out mass, gravity and friction. Then the power that a force delivers at the tip
# equals the power that the torques deliver at the joints; this is the principle of **virtual work**. So
# $F^\mathsf{T}J\dot q = \tau^\mathsf{T}\dot q$ for every $\dot q$. A **wrench** $F$, a force and a torque, that the
# *arm exerts* at the tip costs the torques $\tau = J^\mathsf{T}F$. If the *environment exerts* $F$ on the tip, the
# motors must supply $\tau = -J^\mathsf{T}F$ to hold still, in addition to what the weight of the links needs.
#
# **Worked example.** Hang a weight of 10 N on the tip, $F = (0, -10)$ N. Then $-J^\mathsf{T}F = (8.66,\; 0)$ N m. For
# this weight the shoulder holds 10 N at a lever arm of 0.866 m. The elbow is directly below the tip and feels
# nothing.
#
# The cell checks both uses of $J$ on the 7-R arm:

# %% tags=["show-code"]
J, rest = jacobian(arm, q), np.zeros(7)
for h in (1e-2, 1e-3):
    step = h * np.ones(7) / np.sqrt(7.0)
    missed = np.linalg.norm((tip(arm, q + step) - tip(arm, q))[:3] - (J @ step)[:3])
    print(f"a joint step of {h:g} rad: J predicts the tip's motion with an error of {missed:.1e} m")
pull = np.array([0.0, 0.0, -20.0, 0.0, 0.0, 0.0])
free = kinematics.inverse_dynamics(arm, q, rest, rest)
pulled = kinematics.inverse_dynamics(arm, q, rest, rest, pull)
print("extra torques for 20 N downwards [N m]:", listed(pulled - free))
print("equal to -J^T F:", np.allclose(pulled - free, -J.T @ pull, atol=1e-12))

# %%
more_claims("euler_jacobian_locks")

# %% [markdown]
# ### Inverse kinematics: which angles reach a target?
#
# The task says where the tip should be; the motors need angles. **Inverse kinematics**, IK, finds the joint values that
# put the tip at a target.
#
# Two links reach a point with the elbow on either side of the line from base to target. The two solutions, or
# **branches**, are called **elbow up** (orange in the drawing) and elbow down. The points that the tip can reach are
# its **workspace**. If both joints can turn all the way round, it is an **annulus**, a ring: $\lvert l_1-l_2\rvert \le
# r \le l_1+l_2$.

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 2, figsize=(9.6, 3.8), layout="constrained")
exact = two_link_ik(lengths, tip(two, posture)[:2])
for angles, colour, name in (
    (exact.q[:, 0], "#3b6ea5", "q2 > 0"),
    (exact.q[:, 1], "tab:orange", "q2 < 0"),
):
    points = np.column_stack([kinematics.frames(two, angles)[:2], tip(two, angles)[:2]])
    _ = axes[0].plot(*points, "o-", color=colour, linewidth=5, markersize=9, label=name)
_ = axes[0].plot([0, joints[0, 2]], [0, joints[1, 2]], "k--")
_ = axes[0].text(0.40, 0.72, "r", fontsize=13)
_ = axes[0].text(0.5, 0.16, "$l_1$", fontsize=13)
_ = axes[0].text(0.92, 0.85, "$l_2$", fontsize=13)
_ = axes[0].set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="base, elbow and tip")
_ = axes[0].set(xlim=(-0.7, 1.2))
_ = axes[0].legend(loc="upper left")
ring = np.linspace(0, 2 * np.pi, 200)
circle = np.array([np.cos(ring), np.sin(ring)])
_ = axes[1].fill(*(1.8 * circle), color="#cfe0f0")
_ = axes[1].fill(*(0.2 * circle), color="white")
for radius, note, direction, place in (
    (0.2, "$|l_1-l_2|$", np.radians(-90), (0.0, -0.45)),
    (1.8, "$l_1+l_2$", np.radians(40), (0.45, 0.75)),
):
    rim = radius * np.array([np.cos(direction), np.sin(direction)])
    _ = axes[1].plot(*(radius * circle), color="#3b6ea5")
    _ = axes[1].plot([0, rim[0]], [0, rim[1]], "k-", linewidth=1)
    _ = axes[1].text(*place, note, ha="center")
_ = axes[1].set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="the workspace")
_ = axes[1].set(xlim=(-2.1, 2.1), ylim=(-2.0, 2.1))
plt.show()

# %% [markdown]
# Base, elbow and tip form a triangle with the sides $l_1$, $l_2$ and $r = \sqrt{x^2+y^2}$. Its angle at the elbow is
# $\pi - q_2$, so the law of cosines gives $q_2$. The direction of the first link is the direction of the target minus
# the angle of the triangle at the base:
#
# $$\boxed{\; q_2 = \pm\arccos\frac{x^2+y^2-l_1^2-l_2^2}{2\,l_1l_2}, \qquad
# q_1 = \operatorname{atan2}(y, x) - \operatorname{atan2}(l_2\sin q_2,\; l_1 + l_2\cos q_2) \;}$$
#
# **Worked example.** Target $(0.866, 1.3)$ m: $r^2 = 2.44$, so $\cos q_2 = (2.44 - 1 - 0.64)/1.6 = 0.5$ and $q_2 =
# \pm60°$. For $q_2 = 60°$, $q_1 = 56.33° - 26.33° = 30°$. For $q_2 = -60°$, $q_1 = 56.33° + 26.33° = 82.66°$.
#
# Two bugs are common in this formula. At the edges of the annulus the slope of arccos is infinite. So near an edge,
# rounding its argument costs $q_2$ half of its digits, even if $r$ is exact. And if rounding or a target out of reach
# pushes its argument beyond 1, people clamp it to $[-1, 1]$ and silently return a posture that misses the target. The
# library uses another formula, shown in section 3, and reports whether the target was reached:

# %% tags=["hide-code"]
for name, r in (
    ("inside", 1.2),
    ("outer edge", 1.8),
    ("1 mm beyond", 1.801),
    ("in the hole", 0.1),
):
    exact = two_link_ik(lengths, (r, 0.0))
    (a, b), (c, d) = exact.q.round(3).T + 0.0
    print(
        f"{name:<12} ({r:.3f}, 0) m: {'reached' if exact.reached else 'missed':<7} "
        f"({a:6.3f}, {b:6.3f}) and ({c:6.3f}, {d:6.3f}) rad, off by {exact.distance:.3f} m"
    )

# %% [markdown]
# On each edge of this ring the two solutions merge into one. In the simulation below, dashed arms show the exact
# solutions. At first the target is out of reach: both are stretched, and the arm hides them. Drag the target inside the
# ring, and they separate. The tip glows red when it is close to the edge.

# %%
simulation("arm", "Target out of reach")

# %%
more_claims("number_of_solutions")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Forward kinematics is a function. Inverse kinematics is an equation: it may have no solution, one,
# finitely many or a whole curve of solutions, and a solver has to say which case it found.
#
# </div>
#
# ### Singularities: where the hand loses a direction
#
# Stretch your arm and try to push your hand straight outwards. It can't move in that direction, whatever your joints
# do.
#
# Take all joint velocities $\dot q$ of length at most one. The tip velocities that they produce fill an ellipse, the
# green one in the simulation (with more dimensions, an ellipsoid). Its half axes are the **singular values**
# $s_{\max}\ge\dots\ge s_{\min}$ of $J$. The **singular value decomposition** $J = U\,\mathrm{diag}(s)\,V^\mathsf{T}$
# pairs a direction of joint motion (a column of $V$) with a direction of the tip (a column of $U$), and $s$ is the
# speed of the tip per joint speed. Conversely, a small motion of the tip in that direction costs $1/s$ radians per
# metre.
#
# A posture where the smallest singular value is zero is a **singularity**: the ellipse is flat, $J$ loses rank, and
# the tip has lost at least one direction.
#
# The drawing shows the half axes at 0.4 of their length, in m/rad:

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 2, figsize=(9.6, 3.4), layout="constrained")
for axis, bend in zip(axes, (90.0, 8.0), strict=True):
    angles = np.radians([15.0, bend])
    points = np.column_stack([kinematics.frames(two, angles)[:2], tip(two, angles)[:2]])
    U, s, _ = np.linalg.svd(jacobian(two, angles)[:2])
    ellipse = points[:, 2:] + 0.4 * U @ (s[:, None] * circle)
    _ = axis.plot(*points, "o-", color="#9bb7d4", linewidth=6, markersize=9)
    _ = axis.fill(*ellipse, color="tab:green", alpha=0.3)
    for k, (name, side) in enumerate((("max", -1.0), ("min", 1.0))):
        half = 0.4 * s[k] * U[:, k] * side * np.sign(U[0, k])
        end = points[:, 2] + half
        _ = axis.plot([points[0, 2], end[0]], [points[1, 2], end[1]], color="tab:green")
        ha, gap = ("right", [-0.05, 0.0]) if k == 0 else ("left", [0.08, 0.05])
        _ = axis.text(*(end + gap), f"$s_{{\\{name}}}$ = {s[k]:.2f}", ha=ha, va="bottom")
    _ = axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", xlim=(-0.5, 2.7), ylim=(-0.6, 1.6))
    _ = axis.set(title=f"elbow bent by {bend:.0f} degrees")
plt.show()

# %%
show("two_link_jacobian")

# %% [markdown]
# For two links $\det J = l_1l_2\sin q_2$. The determinant is zero exactly where the elbow is stretched or folded, and
# $q_1$ doesn't enter: turning the whole arm changes nothing. Spatial arms have other singular postures too, even in the
# middle of the workspace. In an arm with just as many joints as the task has numbers, a direction is lost whenever two
# revolute axes lie on one line. In a wrist of three joints whose axes meet in a point, this happens when the first and
# the last axis are parallel.

# %%
show("singular_stretched_or_folded")

# %% [markdown]
# Two numbers measure how close a posture is to a singularity. The **manipulability** $\sqrt{\det JJ^\mathsf{T}}$
# (Yoshikawa 1985) is the product of all singular values (with at least as many joints as rows), because $\det
# JJ^\mathsf{T} = \det(U\,\mathrm{diag}(s^2)\,U^\mathsf{T})$. With revolute joints it shrinks with the size of the arm.
# The **condition number** $s_{\max}/s_{\min}$ is the ratio of the largest to the smallest. For position rows and
# revolute joints alone, it doesn't depend on the size of the arm. With rotation rows it has a weakness.

# %%
predict("millimetres")

# %% tags=["show-code"]
J = jacobian(arm, q)
for unit, length in (("metres", 1.0), ("millimetres", 1e-3), ("units of the reach", arm.reach[1])):
    number = kinematics.condition_number(J, length)
    print(f"condition number, position in {unit:<18}: {number:7.1f}")
print(f"{'condition number, position rows only':<48}: {np.linalg.cond(J[:3]):7.1f}")

# %% [markdown]
# Metres and radians have no common scale, so you first have to choose a **characteristic length** that converts
# between them, and state it. A better question is how fast the tip can move in its worst direction. Take the position
# rows of $J$, and their $s_{\min}$. If the norm of the joint velocities is at most $\dot q_{\max}$, the tip reaches
# $s_{\min}\,\dot q_{\max}$ metres per second in its worst direction.

# %%
show("condition_above_hundred")

# %%
more_claims("condition_is_a_product", "condition_needs_a_length")

# %% [markdown]
# ### Iterative inverse kinematics: pseudo-inverse and damping
#
# An arm of six or more joints has a convenient closed form only if its axes are arranged for it. Otherwise use
# Newton's method: compute the error $e$ of the tip, solve $J\,\Delta q \approx e$ for a step, apply it, and repeat. If
# $J$ is not square, take the step that leaves the smallest error, and among several of these the shortest: the
# **minimum-norm least-squares solution**.
#
# **The error of a pose.** For the position, subtract. Orientations can't be subtracted. Compute the rotation that is
# missing, $\delta = Q_{\text{target}}\otimes Q_{\text{hand}}^{*}$, as a unit quaternion $(w, \vec v)$. A quaternion and
# its negative describe the same rotation, so if $w < 0$, flip the sign of $\delta$; otherwise the hand takes the long
# way round. The error is the **rotation vector** $2\operatorname{atan2}(\lvert\vec v\rvert, w)\,\vec v/\lvert\vec
# v\rvert$, an axis times an angle (zero where $\vec v = 0$). Stack the two errors, position on top. Both are in world
# axes, like the rows of the geometric Jacobian.
#
# **The step.** Split the error into components along the columns $u_k$ of $U$. A component along $u_k$ turns the
# joints along $v_k$, the column of $V$ that belongs to it. The **gain** is the turn per error (for position rows in
# rad/m). The methods differ only in their gain at a singular value $s$:
#
# | step | $\Delta q$ | gain at $s$ |
# |---|---|---|
# | transpose | $\alpha J^\mathsf{T}e$, with a small number $\alpha$ | $\alpha s$ |
# | **pseudo-inverse** | $J^+e$, the minimum-norm least-squares solution | $1/s$; 0 where $s=0$ |
# | **damped least squares** (DLS) | $J^\mathsf{T}(JJ^\mathsf{T}+\lambda^2 I)^{-1}e$ | $s/(s^2+\lambda^2)$ |
# | adaptive | as DLS, but each direction has its own damping: $\lambda^2-s^2$ in place of $\lambda^2$ where $s<\lambda$, none where $s\ge\lambda$ | $s/(s^2+\lambda^2-s^2) = s/\lambda^2$ where $s<\lambda$, else $1/s$; at most $1/\lambda$ |
# | **Levenberg-Marquardt** (LM) | as DLS; a step that reduces the error is accepted and $\lambda$ shrinks; any other step is undone and $\lambda$ grows | as DLS, with the current $\lambda$ |

# %% tags=["hide-code"]
s, damping = np.logspace(-3, 0.3, 300), 0.1
figure_, axes = plt.subplots(figsize=(7.5, 3.4), layout="constrained")
_ = axes.loglog(s, 1 / s, label="pseudo-inverse 1/s", linewidth=5, alpha=0.4)
_ = axes.loglog(s, s / (s**2 + damping**2), label="damped, λ = 0.1 m/rad")
_ = axes.loglog(s, np.where(s < damping, s / damping**2, 1 / s), "--", label="adaptive")
_ = axes.loglog(s, 0.3 * s, ":", label="transpose, α = 0.3 rad²/m²")
_ = axes.axvline(damping, color="0.6")
_ = axes.axhline(0.5 / damping, color="0.6")
_ = axes.text(damping * 1.05, 2e-3, "s = λ")
_ = axes.text(1.2e-3, 0.6 / damping, "1/(2λ)")
_ = axes.set(xlabel="singular value s [m/rad]", ylabel="gain [rad/m]", ylim=(1e-3, 1e3))
_ = axes.legend(loc="upper right")
plt.show()

# %%
predict("gain_of_a_step")

# %% [markdown]
# The damped step minimises $\lvert J\,\Delta q - e\rvert^2 + \lambda^2\lvert\Delta q\rvert^2$: the remaining error plus
# a penalty on motion. The **damping** $\lambda$ has the unit of $s$, for position rows metres per radian, so a value
# that works on one arm does not carry over to an arm of another size.
#
# **Worked example.** Two degrees from stretched, our two-link arm has $s_{\min} = 0.014$ m/rad. The target is 1 cm
# closer to the base. The pseudo-inverse asks for $0.01/0.014 = 0.7$ rad, or 40 degrees, for one centimetre. With
# $\lambda = 0.1$ m/rad the step is $0.01\cdot 0.014/(0.014^2+0.1^2) = 0.014$ rad. The arm stays calm, but the step
# removes only 2 % of the error.

# %%
show("damped_gain")

# %% [markdown]
# Here the arm starts almost stretched, with the pseudo-inverse. Press *Play*: the joints jump at once, and *largest
# gain so far* records the jump. (The picture shows the arm after the jump.) Then try the damped step and move
# $\lambda$:

# %%
simulation("arm", "Jump beside the singularity")

# %%
show("damping_is_free")

# %% [markdown]
# <details><summary>Derive it: where the damped step comes from</summary>
#
# Set the gradient of $\lvert J\,\Delta q - e\rvert^2 + \lambda^2\lvert\Delta q\rvert^2$ to zero:
# $(J^\mathsf{T}J+\lambda^2 I)\,\Delta q = J^\mathsf{T}e$. Multiply the identity $J^\mathsf{T}(JJ^\mathsf{T}+\lambda^2
# I) = (J^\mathsf{T}J+\lambda^2 I)J^\mathsf{T}$ from both sides with the two inverses. The result is the formula in the
# table, where the matrix to invert has only as many rows as the task.
#
# With $J = U\,\mathrm{diag}(s)\,V^\mathsf{T}$ each singular direction can be treated on its own: its gain is
# $s/(s^2+\lambda^2)$. The derivative $(\lambda^2-s^2)/(s^2+\lambda^2)^2$ vanishes at $s=\lambda$, where the gain is
# $1/(2\lambda)$ (Nakamura and Hanafusa 1986; Wampler 1986).
#
# </details>
#
# <div class="alert alert-block alert-warning">
#
# **Key insight.** The pseudo-inverse is dangerous near a singularity. Exactly at it, the lost direction has gain 0,
# if the code treats a tiny $s$ as zero. Constant damping limits each step to $1/(2\lambda)$ times the error, but
# each step leaves a part of the error in every direction.
#
# </div>
#
# Limits on joint speeds enter the same least-squares problem as constraints. If the tip is commanded to move at $\dot
# x$, minimise $\lvert J\dot q-\dot x\rvert^2+\lambda^2\lvert\dot q\rvert^2$ subject to $\dot q_{\min}\le\dot q\le\dot
# q_{\max}$. Position limits become bounds of this kind too: within one control cycle, a **tick**, a joint may move at
# most to its limit. Minimising such a quadratic objective within linear bounds is called a **quadratic program**. The
# libraries pink (for Pinocchio) and mink (for MuJoCo) solve one per tick.
#
# ### Redundancy and the null space
#
# Put your palm flat on the table and move your elbow up and down. The hand stays where it is, because your arm has
# one joint more than the task needs. This is **redundancy**: with one joint more than task dimensions the solutions
# of IK in general form a curve, with two more a surface. Joint velocities that change nothing in the task, $J\,\dot q
# = 0$, are the **null space** of $J$.
#
# You can use this freedom for a **secondary objective**, such as staying away from an obstacle. Call the joint step
# that it prefers $\Delta q_0$. The **projector** $N$ removes the part that would move the tip:
#
# $$N = I - J^+J, \qquad \Delta q = J^+e + N\,\Delta q_0 .$$
#
# **Worked example.** Two joints, and a task with one number: $J = (3, 4)$. Then $J^+ = (3, 4)^\mathsf{T}/25$, and
# $\Delta q_0 = (1, 0)$ is projected to $(1, 0) - \tfrac{3}{25}(3, 4) = (0.64, -0.48)$. Check: $3\cdot0.64 - 4\cdot0.48
# = 0$.

# %%
show("one_joint_to_spare")

# %% [markdown]
# The null space is a straight line, a plane or a larger flat space of velocities. The solutions of IK are curved. In
# this drawing the task of a two-link arm is to hold the $x$ coordinate of its tip; $y$ is free. The blue curve is one
# half of the solutions:

# %% tags=["hide-code"]
a = np.linspace(-0.9, 1.2, 200)
cosine = (1.2 - lengths[0] * np.cos(a)) / lengths[1]
curve = np.where(np.abs(cosine) <= 1, np.arccos(np.clip(cosine, -1, 1)) - a, np.nan)
at = 130
here = np.array([a[at], curve[at]])
row = jacobian(two, here)[0]
along = np.array([row[1], -row[0]]) / np.linalg.norm(row)
along = along * np.sign(along[0])
end = here + 0.7 * along
row = jacobian(two, end)[0]
back = end + row * (1.2 - tip(two, end)[0]) / (row @ row)
figure_, axes = plt.subplots(figsize=(6.8, 3.8), layout="constrained")
_ = axes.plot(a, curve, color="#3b6ea5", label="solutions with x = 1.2 m and q1 + q2 > 0")
_ = axes.plot(*np.column_stack([here, end]), "o-", color="tab:orange", label="null-space step")
_ = axes.plot(*np.column_stack([end, back]), color="tab:green", label="then one IK step")
_ = axes.plot(*back, "s", color="tab:green", label="after both steps")
_ = axes.set(xlabel="q1 [rad]", ylabel="q2 [rad]", title="the null space is only the tangent")
_ = axes.set(xlim=(0.2, 1.3), ylim=(-1.2, 0.9))
_ = axes.legend(loc="lower left")
plt.show()

# %%
predict("tip_in_the_null_space")

# %% [markdown]
# The green ball is the **elbow**, the origin of joint 4, with its path. The orange arrows are the target frame of the
# hand; the black ones, drawn on top, are its present frame. The number *off by one step / h²* is the motion of the
# hand in one step, divided by $h^2$. It hardly changes when you change $h$, but it does depend on the posture.

# %%
simulation("elbow")

# %% [markdown]
# A practical use: the hand of the 7-R arm is at its target, but the arm is close to a pillar. The dotted line is the
# gap. In each step the program takes the gradient of the gap, projects it onto the null space, moves the joints along
# it, and then corrects the hand with IK:

# %% tags=["hide-code"]
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
    ends = np.arange(places.shape[1])
    dense = [np.interp(np.linspace(0, ends[-1], 2000), ends, row) for row in places[:2]]
    near = np.array(dense)[:, np.argmin(np.hypot(*(np.array(dense) - pillar[:, None])))]
    rim = pillar + radius * (near - pillar) / np.linalg.norm(near - pillar)
    _ = axes[0].plot(*np.column_stack([near, rim]), "k:", linewidth=2)
_ = axes[0].add_patch(plt.Circle(pillar, radius, color="tab:red", alpha=0.6))
_ = axes[0].set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="the arm from above")
_ = axes[0].legend(loc="lower right")
_ = axes[1].plot(np.arange(len(gaps)), 1e3 * np.array(gaps))
_ = axes[1].set(
    xlabel="steps", ylabel="gap to the pillar [mm]", title="the arm moves away from the pillar"
)
plt.show()
for name, posture_ in (("one IK run after each step", moved), ("never corrected", plain)):
    deviation = np.linalg.norm(kinematics.pose_error(target, tip(arm, posture_))[:3])
    gap = kinematics.disc_distance(arm, posture_, pillar, radius)[0]
    print(
        f"{name:<26}: gap {1e3 * gaps[0]:.0f} -> {1e3 * gap:.0f} mm, hand off by "
        f"{'under 0.001' if deviation < 1e-6 else format(1e3 * deviation, '.1f')} mm"
    )

# %% [markdown]
# ### The swivel angle: six joints in closed form
#
# In an arm like the Panda, the first three axes meet in a point, the **shoulder**, and axes 5 and 6 in another one,
# the **wrist**. Then you can compute points on the curve of solutions without iterating (He and Liu 2021): choose the
# angle of joint 7, and the other six angles follow in closed form. There are up to eight postures for each angle.
# Shoulder, elbow and wrist form a triangle. Its turn about the line from shoulder to wrist is the **swivel angle**,
# zero with the elbow straight above the line.
#
# The hand is fixed, so axis 7 is fixed too. A wrist on axis 7 would stay where it is, and the triangle would turn
# without changing its shape. But the Panda's wrist is 88 mm from axis 7 and circles around it. So the line from
# shoulder to wrist moves, its length changes, and joint 4 turns too.
#
# <details><summary>Derive it: from the angle of joint 7 to eight postures</summary>
#
# Start at the hand, whose pose is given. The pose and the angle of joint 7 determine where axis 6 is. The wrist is a
# fixed point of axis 6. Turning joint 6 does not move it, so you know where the wrist is, whatever joint 6 does. The
# shoulder never moves. So shoulder, elbow and wrist form a triangle with three known sides, and the law of cosines
# gives the angle of the elbow.
#
# To find the swivel angle, look for the direction of axis 5, which passes through the wrist. It lies in the plane of
# the triangle, at a known angle to the line from shoulder to wrist. While the triangle turns, the direction of axis 5
# sweeps a cone about this line. Axis 5 is also perpendicular to axis 6, so its direction lies in a known plane. Cone
# and plane meet in two lines, touch in one, or don't meet. Two lines, two bends of the elbow and two postures of the
# shoulder make eight postures.
#
# </details>
#
# ![All postures of one pose; share of poses without an answer against time](../docs/charts/seven_joint.png)
#
# On the left, every point is a posture with the same pose of the hand; only the blue ones respect the joint limits. On
# the right, two methods look for one posture within the limits for each of many poses, in one call. The closed form
# tries some angles of joint 7. The search, Levenberg-Marquardt, tries random starts.
#
# Our closed form computes all its angles for every pose. The search stops at its first success, so more starts cost
# little. If one pose in a hundred may stay without an answer, our closed form is faster; at one in a thousand both take
# the same time; below that, the search is faster.
#
# For each angle of joint 7, the closed form also returns all postures or proves that there is none. And its only error
# is rounding.

# %%
figures(read("seven_joint"), summary="Time, answers and errors")

# %%
more_claims(
    "null_motion_leaves_the_tip",
    "projector_of_the_null_space",
    "second_task",
    "seven_joints_have_no_closed_form",
)

# %% [markdown]
# ### Dynamics: which torques cause a motion?
#
# When one link accelerates, it pushes on its neighbours, so the torque of
# each motor depends on all joints.

# %%
predict("elbow_accelerates")

# %% [markdown]
# The equations of motion of any chain are
#
# $$\boxed{\;M(q)\,\ddot q + h(q,\dot q) = \tau + J^\mathsf{T}F\;}$$
#
# with the symmetric **mass matrix** $M$, positive definite if every motion of the joints moves some mass. The bias $h$
# collects gravity, joint friction, and terms quadratic in the velocities: centrifugal ones with the square of one
# joint's velocity, **Coriolis** terms with the product of two. $F$ is the wrench that the environment exerts on the
# tip. **Inverse dynamics** computes the torques for a given motion; **forward dynamics** computes the accelerations for
# given torques.
#
# **The mass matrix of two links.** The kinetic energy is $\tfrac12\dot q^\mathsf{T}M\dot q$. Each link contributes the
# motion of its centre of mass and its rotation:
#
# $$M = \sum_k \Big( m_k\,J_{c,k}^\mathsf{T}J_{c,k} + I_k\,J_{\omega,k}^\mathsf{T}J_{\omega,k} \Big),$$
#
# where $J_{c,k}$ is the Jacobian of the centre of link $k$, and $J_{\omega,k}$ that of its angular velocity: $(1, 0)$
# for the first link, $(1, 1)$ for the second. A uniform rod has $I = m\,l^2/12$ about its centre. **Worked example:**
# if only the elbow turns, the centre of the second rod moves at $l_2/2$, so $M_{22} = m_2(l_2/2)^2 + m_2l_2^2/12 =
# m_2l_2^2/3$. With 0.8 kg and 0.8 m that is 0.17 kg m². If only the shoulder turns with the arm stretched (and $m_1 =
# 1$ kg), $M_{11} = \tfrac13 + 0.8\cdot1.4^2 + m_2l_2^2/12 = 1.94$ kg m²; folded back it is only 0.66 kg m².

# %% tags=["hide-code"]
bends = np.linspace(-np.pi, np.pi, 181)
rods = kinematics.TwoLink(lengths=lengths, masses=(1.0, 0.8))
entries = rods.mass_matrix(np.array([np.zeros(181), bends]))
figure_, axes = plt.subplots(figsize=(7.5, 3.2), layout="constrained")
for i, j in ((0, 0), (0, 1), (1, 1)):
    _ = axes.plot(np.degrees(bends), entries[i, j], label=f"$M_{{{i + 1}{j + 1}}}$")
_ = axes.axhline(0, color="0.7", linewidth=1)
_ = axes.set(xlabel="bend of the elbow q2 [degrees]", ylabel="entry of M [kg m²]")
_ = axes.set(title="the mass matrix of two rods depends on the posture")
_ = axes.legend()
plt.show()

# %% [markdown]
# Larger arms use recursions that pass along the chain up to three times, outwards from the base or inwards from the tip
# ($n$ joints):
#
# | algorithm | computes | idea | cost |
# |---|---|---|---|
# | **recursive Newton-Euler** (RNEA) | $\tau$ | velocities and accelerations outwards, forces inwards | $O(n)$ |
# | **composite rigid body** (CRBA) | $M$ | treat all links beyond a joint, towards the tip, as one rigid body | $O(n^2)$ |
# | **articulated body** (ABA) | $\ddot q$ | velocities outwards; inwards, each link's inertia if the joints beyond it are free to move, and the force that keeps it unaccelerated; accelerations outwards | $O(n)$ |
#
# RNEA in words. *Outwards from the base*: a link's angular velocity is that of its parent plus $\dot q_i z_i$. Its
# angular acceleration $\alpha$ is that of its parent plus the derivative of $\dot q_i z_i$, which is
# $\ddot q_i z_i + \omega\times\dot q_i z_i$, because the axis $z_i$ turns too. Relative to its (revolute) joint, a
# point of the link at $r$ accelerates by $\alpha\times r + \omega\times(\omega\times r)$. Use this for the next joint,
# and for the acceleration $a_c$ of the centre of mass. The link needs the force $m\,a_c$ and, about its centre of mass,
# the torque $I\alpha+\omega\times I\omega$.
#
# *Inwards from the tip*: each joint delivers what its own link needs plus what the next joint takes. The link's own
# force acts at its centre of mass, the passed-on one at the next joint. Each force $f$, at $r$ from this joint, adds
# the torque $r\times f$. The motor supplies the component along its axis, the bearing the rest. For gravity, let the
# base accelerate upwards at $g$.
#
# <details><summary>Worked example: both rods held out horizontally</summary>
#
# The elbow carries 0.8 kg at 0.4 m: $0.8\cdot9.81\cdot0.4 = 3.1$
# N m. The shoulder carries 1 kg at 0.5 m and 0.8 kg at 1.4 m: $9.81\,(0.5 + 1.12) = 15.9$ N m.
#
# </details>
#
# The three algorithms must agree:

# %% tags=["show-code"]
free = replace(arm, damping=0.0)  # joints without friction
v, a = np.array([0.5, -0.8, 0.3, 1.0, -0.6, 0.9, -1.2]), np.linspace(-1.0, 1.0, 7)
tau = kinematics.inverse_dynamics(free, q, v, a)
M, h = kinematics.mass_matrix(free, q), kinematics.bias(free, q, v)
back = kinematics.forward_dynamics(free, q, v, tau)
print("torques of the motion [N m]:", listed(tau))
print("RNEA equals M a + h with M from CRBA:", np.allclose(tau, M @ a + h, atol=1e-12))
print("ABA returns the accelerations:", np.allclose(back, a, atol=1e-11))
held = kinematics.inverse_dynamics(free, q, rest, rest)
print("torques that only hold the arm up [N m]:", listed(held))

# %% [markdown]
# A falling arm without motors and friction conserves its energy, so with RK4 from chapter 1 the drift must be divided
# by at least about $2^4 = 16$ when the step is halved. An error in the bias $h$ that changes the energy does not
# shrink with the step:

# %% tags=["hide-code"]
fall = rigid_body.System("arm", kinematics.acceleration, kinematics.pack(free), q, v)
worst = []
for count in (500, 1000, 2000):
    run = rigid_body.simulate(fall, "rk4", 1.0 / count, count, every=count // 50)
    total = kinematics.energy(free, run.q.T, run.v.T)[2]
    worst.append(np.abs(total / total[0] - 1.0).max())
    print(f"{count:5d} steps of RK4 over 1 s: largest relative energy error {worst[-1]:.1e}")
print(f"halving the step divides it by {worst[0] / worst[1]:.0f} and {worst[1] / worst[2]:.0f}")

# %%
more_claims("articulated_bodies_lose_fewer_digits")

# %% [markdown]
# ### Identification: what can torques tell about the masses?
#
# Each link has ten inertial numbers: its mass, three first moments (mass times centre of mass), and six second moments
# about the origin of its frame. Apart from friction and motor inertias, torques are *linear* in all of them: $\tau =
# Y(q,\dot q,\ddot q)\,\theta$. The matrix $Y$ is the **regressor**. So you can move the arm, record torques, and fit
# $\theta$ by least squares. But some numbers never show. The first axis of our arm is vertical, so the weight of the
# first link never loads the motor, and of its inertia only the part about that axis counts.

# %%
show("torques_tell_ten_numbers")

# %% [markdown]
# We sampled 60 random states, computed their torques without friction and motor inertias, added noise, fitted $\theta$,
# and predicted the torques of new states:

# %% tags=["hide-code"]
rng = np.random.default_rng(4)


def motions(number):
    """Return the regressor of random states, as rows, and torques without the known friction."""
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
print(f"unknown numbers {Y.shape[1]}, identifiable combinations {rank}")
print(
    f"noise 0.05 N m; new torques (typical size {truth.std():.1f} N m) predicted to {rms:.3f} N m"
)
print(f"mass of the first link: fitted {abs(theta[0]):.2f} kg, true {arm.mass[0]:.2f} kg")

# %% [markdown]
# The fit predicts torques to less than the noise. The mass of the first link never shows, so the minimum-norm solution
# sets it to zero. The combinations that can be identified are the **base parameters** (Khalil and Dombre 2002). As long
# as the base stays mounted as it is, a controller needs only these, motor inertias and friction. On a real arm friction
# is often the largest missing part. Chapter 8 fits it too, for two links.
#
# ## 2 · Design: three levels and their rates
#
# ### Task space, joint space, actuators
#
# A command such as "put the cup there" passes through three levels before a current flows. Feedback runs on each
# level, one control loop inside the other.
#
# **The inner loop must be fast compared with the loop that closes around it.** The outer loop can then assume that its
# commands are executed at once. Fast means a high **bandwidth**: the highest frequency of commands that the loop still
# follows. As a rule of thumb, it is three to ten times the bandwidth of the loop around it. The drawing shows update
# rates, which must be higher still.

# %% tags=["hide-code"]
LEVELS = (
    ("task space", "poses of the hand", "10 to 100 Hz", "planner or operator"),
    ("joint space", "angles and velocities", "100 Hz to 1 kHz", "joint controller"),
    (
        "actuator space",
        "torques, currents",
        "torque 1 kHz and more, current 10 kHz and more",
        "motor driver",
    ),
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

# %% [markdown]
# Follow one command downwards. The task specifies a pose, and IK finds joint angles. The controller asks for an
# acceleration in proportion to the joint error (and damps the joint rates, which are zero here), and inverse dynamics
# turns that into torques. This is **computed torque** control; chapter 6 continues from here.

# %% tags=["show-code"]
desired = tip(arm, q) + np.array([0.0, 0.1, -0.05, 0.0, 0.0, 0.0, 0.0])
outcome = ik(arm, desired, q)
requested = 100.0 * (outcome.q - q)  # rad/s^2; at rest, so no damping
torques = kinematics.inverse_dynamics(arm, q, rest, requested)
print("task space:     hand to", listed(desired[:3]), "m")
print(f"joint space:    {listed(outcome.q)} rad ({outcome.reason} in {outcome.iterations} steps)")
print("actuator space:", listed(torques), "N m")

# %% [markdown]
# ### Where to solve inverse kinematics
#
# You can solve IK *once*, for the goal, and let a planner find a path in joint space. Or you can solve at every tick
# for a velocity: $\dot q = J^\mathsf{T}(JJ^\mathsf{T}+\lambda^2I)^{-1}(\dot x + k\,e)$, with the damped inverse instead
# of $J^+$. That is **resolved rate** control (Whitney 1969; he used no damping). Without the term $k\,e$, which feeds
# back the position error, small errors would add up. Far from singularities the tip then stays close to its target, and
# a tick costs little. But it doesn't look ahead: it may run into a joint limit or a singularity.
#
# A third approach plans points of the tip and solves IK for each of them. If the joints are interpolated in between,
# the tip leaves the straight line, and two neighbouring solutions may lie on different branches. If you solve IK all
# along the line, the line may cross the hole around the base or pass close to a singularity.

# %%
show("tip_plans_need_joints")

# %% [markdown]
# A real-time loop starts from the last posture, takes a fixed number of steps, and reports whether it succeeded. It
# does not restart elsewhere: another start may end on another branch, and the joints would jump.
#
# ## 3 · Code: the reference functions
#
# Here is the closed form of the two-link arm as it is in the library. It returns both branches. It computes $q_2$ from
# the tangent of $q_2/2$, where $r_{\max} = l_1+l_2$ and $r_{\min} = \lvert l_1-l_2\rvert$:
#
# $$\tan^2\frac{q_2}{2} = \frac{(r_{\max}-r)(r_{\max}+r)}{(r-r_{\min})(r+r_{\min})} .$$
#
# At the edges of the annulus $q_2$ itself is sensitive: in *any* formula, a rounding error of $10^{-16}$ m in $r$ moves
# it by about $10^{-8}$ rad. This formula adds no second error of that size: it subtracts $r$ first, and the difference
# of two close numbers is exact. The arccosine adds one even if $r$ is exact, because it rounds squares before it
# subtracts them.

# %%
source(kinematics.two_link.branches)

# %% [markdown]
# The Jacobian takes one column for each joint between the base and the tip: walk from the tip inwards, from each joint
# to its parent. The second function is the gain of the steps that work with singular values. These steps skip
# directions with $s$ below $10^{-12}$ of the largest: at a singularity, rounding leaves a tiny $s$ rather than zero,
# and $1/s$ would be a huge step. The projector follows:

# %%
source(kinematics.motion.columns, kinematics.inverse.gain)

# %%
source(kinematics.null_space)

# %% [markdown]
# With these functions the IK loop that most people write first takes only a few lines, with half of a damped step per
# iteration. The library's `ik` takes Levenberg-Marquardt steps and adds three things: it enforces joint limits, it
# restarts from another posture when it gets stuck, and it says *why* it failed.
#
# Only the reason *unreachable* is a proof: the target is farther from the base than the arm can stretch, or nearer than
# it can fold. The other reasons only say what stopped the best start: a joint at its limit (*limit*), a rank that is
# (nearly) lost (*singularity*), steps that gain too little at full rank (*stuck*), or the number of steps
# (*iterations*).

# %%
show("listing_reaches_its_target")


# %% tags=["show-code"]
def follow(chain, goal, q, damping=0.1, tolerance=1e-4, at_most=100):
    """Return joint angles after repeated half steps of damped least squares, and the step count."""
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
more_claims("listing_converges")

# %% [markdown]
# Invalid input raises an error that names the argument and what is allowed:

# %% tags=["hide-code"]
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
# Click or drag to set the target, inside or outside the ring; the arrow keys move it by five centimetres. Choose the
# step rule, the damping, and the unit of length in which the Jacobian is written. Before you choose a preset, predict
# what the numbers below the picture will do:
#
# 1. *Stretched, target inward*: which of the five step rules moves?
# 2. *Target out of reach*: what does *smallest value*, the smallest singular value, do? What changes with the
#    pseudo-inverse?
# 3. *Jump beside the singularity*: with the damped step, how does the largest gain depend on the damping?
# 4. *The same arm in millimetres*: which numbers change when you choose metres?

# %%
simulation("arm")

# %% [markdown]
# ## 5 · Speed against accuracy
#
# ### How many states per second?
#
# **Pinocchio** (Carpentier and others 2019) is a widely used C++ library for the dynamics of arms; **MuJoCo** is the
# simulator from chapter 1. Their usual functions compute one state per call, and every call from Python costs extra
# time. This course's compiled loop accepts a whole
# **batch** of states in one call.

# %%
predict("one_call_or_a_batch")

# %% [markdown]
# The chart shows the 7-R arm at random states, on one core, called from Python. Pinocchio is called once per state and
# also, for torques and accelerations, once per batch (`rneaInParallel` and `abaInParallel`, one thread). MuJoCo is
# called once per state, for torques and accelerations with `mj_inverse` and `mj_forward`:
#
# ![States per second against the size of the batch, for the course, Pinocchio and
# MuJoCo](../docs/charts/arm_throughput.png)

# %%
figures(read("arm_throughput"), summary="Ratios of the times, one state and 10,000, with quartiles")

# %% [markdown]
# All three agree up to rounding. With one state per call, the course spends most of its time on checking arguments and
# creating arrays. A batch shares this fixed cost: to the right of the crossing the course is faster. (This is no
# ranking of libraries.)
#
# <details><summary>What the comparison leaves open</summary>
#
# MuJoCo's two functions also do work that a bare arm doesn't need, such as looking for contacts, and only the course's
# loop is compiled for the processor that it runs on. Pinocchio's batch calls close only a part of the gap. We did not
# measure where the rest comes from, nor why our Jacobians slow down in large batches. For one call per state, $N$ only
# counts the calls in a timed loop, which share the time of starting this loop.
#
# </details>
#
# ### Jacobians from finite differences
#
# The simplest test of a Jacobian is a **forward difference**: $(f(q+h)-f(q))/h$. A
# **central difference**, $(f(q+h)-f(q-h))/(2h)$, is more accurate. Both subtract two numbers that are nearly equal,
# and floating-point numbers have only 16 digits.

# %%
predict("step_of_a_difference")

# %% [markdown]
# A third formula, the **complex step** $\operatorname{Im} f(q + \mathrm{i}h)/h$, contains no subtraction, so $h$ can be
# tiny (Squire and Trapp 1998). It needs an $f$ made of analytic functions: no absolute value, no `atan2`. *Autograd* is
# PyTorch's automatic differentiation.
#
# ![Error of a Jacobian against the step of the difference, and against its time](../docs/charts/jacobian_precision.png)

# %%
print_figures(
    "jacobian_precision",
    "forward error",
    "central error",
    "complex step error",
    "autograd",
    "analytic",
)

# %% [markdown]
# The errors are differences from a complex step with $h = 10^{-100}$, which is exact up to rounding. So the complex
# step is compared with itself, and below $10^{-15}$ the ranking means nothing. Drawn against $h$, the error of a
# difference is a V: the truncation error of the Taylor series shrinks with $h$, and the rounding error grows with
# $1/h$.
#
# To *check* a Jacobian, use central differences with $h$ near the cube root of machine precision, about $10^{-5}$, and
# expect agreement to about ten digits, not sixteen. (The times compare Python loops and autograd with a compiled
# Jacobian.)
#
# ### How many poses does a solver find?
#
# The benchmark has ten thousand reachable poses of the 7-R arm, to be solved within the joint limits to a micrometre
# and a microradian. The Python loops get only three hundred of them, so their uncertainty, shaded, is larger.
#
# The *usual loop* follows an example from Pinocchio's documentation: a tenth of each pseudo-inverse step, no limits,
# one start. *Clamped, 20 starts* adds joint limits and restarts. *Same with full steps* also takes the whole step
# instead of a tenth. The course's compiled solver takes Levenberg-Marquardt steps. It begins at random postures
# (*uniform starts*) or at the *nearest of a table* of random postures. *Our method in Python* takes the same steps in
# a Python loop, with Pinocchio's functions. We did not measure an IK library such as TRAC-IK. In the chart, every
# method is called for one pose at a time:
#
# ![Share of poses solved against time per pose](../docs/charts/ik_success.png)

# %%
show("converged_within_limits")

# %% [markdown]
# Every solution was checked with forward kinematics; none of our reported successes was wrong. The right-hand panel
# has poses near a singular posture of the shoulder: axes 1 and 3 on one line, $q_3 = 90°$, $q_5 = 0$. With one pose
# per call, they are solved about as often and as fast as the others. For poses beyond the reach the solver never
# reports success.
#
# Three things make a method fast here: its steps, compiled code instead of Python, and the batch. The table separates
# them. *A batch* is one call for all poses, also on one core: 10,000 ordinary ones, or 1,000 near a singular posture.
# So don't compare the columns of these two rows.

# %% tags=["hide-code"]
lines = [line for line in read("ik_success").splitlines() if "solved a second" in line]
names, rates = zip(*(line.split(" solved")[0].rsplit(None, 1) for line in lines), strict=True)
half = len(lines) // 2  # of each panel; the usual loop solves too few to count
table = [
    "| poses solved per second | ordinary poses | near a singular posture |",
    "|---|---:|---:|",
]
rows = list(zip(names[:half], map(float, rates[:half]), map(float, rates[half:]), strict=True))
for name, *both in sorted(rows, key=lambda row: row[1]):
    if name.strip() != "usual loop":
        single = "uniform starts", "nearest of a table"
        name = f"{name.strip()}, a batch" if name.strip() in single else name.strip()
        name = name.replace("a call a pose", "one call per pose")
        table.append(f"| {name} | " + " | ".join(f"{x:,.0f}" for x in both) + " |")
Markdown("\n".join(table))

# %%
figures(read("ik_success"), summary="Steps, starts, and poses solved per second")

# %% [markdown]
# Joint limits in every step and restarts decide *whether* a pose is solved. Full steps instead of tenths make the
# same loop several times as fast. A start from the table saves steps, but its look-up costs time.
#
# ### Which step for which tolerance?
#
# Every method runs for one to forty steps on forty poses, all near the pose of its start. Drag the tolerance, or move
# it with the arrow keys. A circle marks the cheapest run that meets it, in steps on one side, in time on the other.

# %% tags=["hide-code"]
from course.measure.work_precision import Method, Result, measure
from course.simulations.trade_off import TradeOff

home = np.array([0.0, -0.6, 0.0, -2.2, 0.0, 1.6, 0.8])
goals = tip(arm, home[:, None] + np.random.default_rng(8).uniform(-0.4, 0.4, (7, 40)))


def steps_of(name):
    """Return a work-precision curve: the remaining error after 1 to 40 steps of a method."""

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
    repeats=15,
    best=True,
    question="How large is the error after given steps, and after a given time?",
    error_unit="m, rad",
    converges=False,
)
best = result.pick(by="count").point
print(f"fewest steps for an error below 1e-6: {best.count:.0f} (remaining error {best.error:.0e})")
TradeOff(result)

# %% [markdown]
# Near a solution that is not singular, the pseudo-inverse and Levenberg-Marquardt about double the number of correct
# digits in each step. So does the adaptive step where no singular value is below $\lambda$. In time,
# Levenberg-Marquardt is ahead only because our code solves a small linear system for it and computes singular values
# for the others. (Points: the least of 15 times; thin lines: up to the upper quartile.)
#
# The next chart compares an ordinary target with one exactly on the edge of the workspace of two links, where the
# solution itself is singular:
#
# ![Remaining error against steps, for an ordinary target and one on the edge](../docs/charts/ik_residual.png)

# %%
print_figures("ik_residual", "A target on")

# %% [markdown]
# For the ordinary target, constant damping ($\lambda = 0.1$, full steps) soon shrinks the error by the same factor in
# every step. On the edge $J$ is singular at the solution, so the pseudo-inverse and Levenberg-Marquardt only divide the
# error by four per step. The damped and the adaptive step get slower and slower: in the long run the error is
# proportional to $1/n$ after $n$ steps.
#
# ### Limits in every cycle: clip, scale, or solve a quadratic program?
#
# `bounded_velocity` solves the quadratic program of section 1: it holds some joints at their bounds, the **active
# set**, solves least squares for the others, and changes the set until that no longer helps. Two cheaper remedies
# start from the damped pseudo-inverse: one *clips* each velocity on its own, the other *scales* all by one factor.
# mink and pink solve the same program with a compiled solver. (In the chart, *quadratic program* is our solver.) The
# hand of the 7-R arm follows paths that the arm can follow within its limits. The target does not wait for the arm:
#
# ![Error of the hand against computing time, and against time on one path](../docs/charts/velocity_limits.png)

# %%
print_figures("velocity_limits", "clipped largest", "quadratic program", "mink:", "no limits:")

# %% [markdown]
# The bands are quartiles over the paths. The grey curve ignores the limits, so no real arm can move like this.
# Clipping drops what the clipped joint should have contributed. In the program the other joints make up for it, as
# far as they can. Scaling keeps the direction of the hand, but a single joint that would have to pass its position
# limit stops the whole arm, while the target moves on. (If the target can wait, slow down the path instead.) The
# program is not perfect either: it looks no further than one cycle, and may lead the arm to a limit that a planner
# would have avoided.
#
# mink and pink take about half the time of our solver. The printed figures are for cycles of 5 ms.
#
# <details><summary>Do the solvers agree?</summary>
#
# With cycles of 20 ms or less the largest errors of mink, pink and our solver agree. At 50 ms theirs are smaller,
# because they measure the error of a pose as one screw motion, we as a shift and a turn. (With their error our solver
# agrees with them.)
#
# </details>

# %%
more_claims("clipped_velocities")

# %% [markdown]
# ### When is a planar model enough to predict a motion?
#
# A planar arm is cheap to simulate, but real arms are never perfectly planar. Chapter 8's arm moves in a level plane
# for one second, with both joints turning at the start and constant torques, without feedback. We simulated the same
# second in three dimensions with MuJoCo: once with the base tilted, so that gravity pulls along the plane, and once
# with the elbow's axis not quite parallel to the shoulder's. The chart shows how far apart the tips end:
#
# ![Error of the planar arm against the tilt of its base and of its elbow axis](../docs/charts/two_links_enough.png)

# %%
figures(
    read("two_links_enough"),
    "base out of level    within",
    "elbow axis skewed    within",
    summary="All effects that were modelled or neglected",
)

# %% [markdown]
# The tolerance is a tenth of the target's radius in the reaching task of chapter 8. Each fault was varied alone; their
# errors can add up. For a controller that feeds back the joint angles, a small tilt is only a small disturbance torque.
#
# ### What to pick
#
# * *Two joints and a point, three joints and a point with a direction of the hand, six with a wrist whose axes meet*:
#   the closed form. It returns all solutions, if finitely many, without iterations or a start.
# * *Following a path, at every tick*: one or two damped or adaptive steps from the last posture, checked by forward
#   kinematics. With hard limits, a quadratic program.
# * *Seven joints arranged like the Panda's*: the closed form at a few angles of the last joint, or the search of the
#   next line.
# * *A single pose without a previous solution*: Levenberg-Marquardt with joint limits and random restarts (in a batch,
#   with a first start from a table); with a time limit, and a reason when it fails.
# * *Torques*: RNEA. *Simulation*: ABA, or CRBA and solving with $M$ for a short arm. *Tests*: each against
#   the others.
#
# ## 6 · Debug: where it fails
#
# ### How much damping is enough?
#
# The tip is commanded to move at $v = 0.1$ m/s, and the norm of the joint speeds may be at most $w = 2$ rad/s. So the
# gain must stay below $w/v = 20$ rad/m. In the left panel, the joints are too fast below the black line. The predicted
# border (dashed), where $s/(s^2+\lambda^2) = w/v$, lies on the measured one. Its highest point is at $\lambda =
# v/(2w)$, the dotted line: with this damping or more, no posture violates the limit.
#
# What does this damping cost? In the right-hand panel the folded arm is led past the hole around the base, one damped
# step every 2 mm. (Even undamped, these paths stay below $w$.)
#
# * *Little damping*: the elbow folds, turns back and opens on its old side.
# * *More*: it turns back more slowly, and the error grows.
# * *Enough* (less is enough on a path closer to the hole): the elbow passes through the folded posture to the other
#   side. The joints then stay slow, and the error falls again.
# * *Still more*: the tip misses its points by up to centimetres.
#
# ![Joint speed against elbow bend and damping, and the tracking error that damping
# costs](../docs/charts/damping_map.png)

# %% tags=["hide-code"]
print_figures("damping_map", "never", "without")
weakest = motion.SPEED / (2.0 * motion.RATE)
for gap in (1e-2, 1e-3, 1e-4):
    hole_error, turn = motion.past_the_hole(weakest, gap)
    rate = turn * motion.SPEED / 0.002  # the points are 2 mm apart
    print(
        f"{1e3 * gap:4g} mm from the hole: largest error {1e3 * hole_error:.2f} mm, "
        f"fastest joint motion {rate:.2f} rad/s"
    )

# %% [markdown]
# (Feedback of the position error can raise the commanded speed above $v$; then $\lambda$ must be larger.)
#
# The gains also explain the first question of this page. The arm is straight, so both columns of $J$ are
# perpendicular to it. The error lies along the arm, in the lost direction, where $s = 0$ and all five gains are zero.
# So all five steps are zero:

# %% tags=["hide-code"]
figure_, axes = plt.subplots(figsize=(8, 2.6), layout="constrained")
_ = axes.plot([0, 1, 1.8], [0, 0, 0], "o-", color="#9bb7d4", linewidth=8, markersize=10)
for length, colour, name in ((1.8, "tab:orange", "column 1"), (0.8, "tab:green", "column 2")):
    _ = axes.quiver(
        1.8,
        0,
        0,
        0.3 * length,
        color=colour,
        angles="xy",
        scale_units="xy",
        scale=1,
        label=name,
    )
_ = axes.quiver(
    1.8,
    0,
    -0.5,
    0,
    color="tab:red",
    angles="xy",
    scale_units="xy",
    scale=1,
    zorder=5,
    label="error e",
)
_ = axes.plot(1.3, 0, "kx", markersize=10, zorder=6, label="target")
_ = axes.set(aspect="equal", xlim=(-0.2, 2.9), ylim=(-0.2, 0.7), xlabel="x [m]", ylabel="y [m]")
_ = axes.set_title("both columns (drawn at 0.3 of their length) are perpendicular to the error")
_ = axes.legend(loc="upper left")
plt.show()

# %%
more_claims("rank_loss_is_failure", "singular_start")

# %% [markdown]
# ### Targets at the edge and beyond
#
# The true answer is known for each of these targets, so we can check the reason that the solver reports. It may
# restart twenty times:

# %% tags=["hide-code"]
stiff = replace(planar((1.0, 0.8)), lower=(-np.pi, -2.0), upper=(np.pi, 2.0))
for name, chain, r in (
    ("1 mm inside the edge", pair, 1.799),
    ("on the edge", pair, 1.8),
    ("1 mm beyond", pair, 1.801),
    ("beyond, twice as far", pair, 3.6),
    ("at 0.4 m, free elbow", pair, 0.4),
    ("at 0.4 m, elbow limit 2 rad", stiff, 0.4),
):
    place = np.array([r * np.cos(0.7), r * np.sin(0.7), 0.0])
    one = ik(chain, place, np.array([0.2, 0.9]), restarts=20)
    print(
        f"{name:<27} {one.reason:<12} off by {one.distance:9.2e} m "
        f"after {one.iterations:4d} steps from {one.starts:2d} starts"
    )

# %% [markdown]
# All six are right. The last target is out of reach too, but the solver cannot prove it. It says what it observed: a
# joint limit stopped its best start.
#
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Joint angles that a solver returns prove nothing. Compute the remaining error with forward
# kinematics, and ask for the reason why the solver stopped.
#
# </div>
#
# ### How far the hand drifts in the null space
#
# ![Motion of the tip against the length of a null-space step](../docs/charts/null_space_step.png)

# %%
print_figures("null_space_step", "exact", "damped")

# %% [markdown]
# A damped projector is $I - J^\mathsf{T}(JJ^\mathsf{T}+\lambda^2I)^{-1}J$. It lets a part of the step through to the
# tip. In general, the drift of the tip per step is $O(h^2)$ with the exact projector (it hides the black line $ch^2$),
# $O(h^4)$ after one corrective IK step, and $O(h)$ with a damped projector. Use the exact projector for the null space,
# damping only for the task.
#
# ### Debugging table
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *IK does not converge.* Test the code first: take a target that must work, forward kinematics of a
# known posture, and start close by. Compare $J$ with central differences in any case: a wrong $J$ may cost only two
# more steps. If the code is right: Is the target reachable, within the reach *and the joint limits*? Does the solver
# succeed from twenty other starts? Is a joint at its limit where it stops? (If none is, constantly damped steps end
# only where rows of $J$ depend on each other, whether or not the target is reachable.)
#
# <details><summary>What people get wrong there</summary>
#
# They increase the damping first. Damping shortens the steps, so near an edge it makes convergence *slower*. Or they
# quote a condition number without noticing its units.
#
# </details>
#
# </div>

# %% [markdown]
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The hand arrives, but the elbow is in an awkward position.* A 7-R arm has a curve of solutions,
# and the start decided which one you got. Add a secondary objective in the null space, such as elbow height. Take small
# steps, correct the hand after each, and stop when the projected gradient vanishes.
#
# <details><summary>What people get wrong there</summary>
#
# They use a damped projector, and the hand drifts. They expect the elbow to go anywhere, but it can only follow the
# curve of solutions, and not past a joint limit. Another *branch*, for example with the shoulder turned round, needs a
# restart from another posture.
#
# </details>
#
# </div>
#
# <table>
# <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr>
# <tr><td>joints jump by radians for a millimetre of the tip</td> <td>pseudo-inverse close to a singularity</td>
# <td>print
# $1/s_{\min}$</td> <td>damp; slow down; plan around it in joint space</td></tr>
# <tr><td>nothing moves, the error stays</td> <td>$J^\mathsf{T}e=0$: arm stretched, target along the arm</td>
# <td>compare
# $\lvert J^\mathsf{T}e\rvert$ with $s_{\max}\lvert e\rvert$</td> <td>bend the elbow a little; another start</td></tr>
# <tr><td>convergence gets slower and slower</td> <td>constant damping, and a target on the edge</td> <td>the ratio of
# successive errors approaches one</td> <td>Levenberg-Marquardt</td></tr>
# <tr><td>convergence is slow everywhere, although FK is right</td> <td>wrong $J$ (tool offset, frame of the
# angular rows); shortened or damped steps</td> <td>$J$ against central differences</td> <td>compute
# $J$ and error at one point, in one frame; full steps</td></tr>
# <tr><td>the robot stops at a limit although IK converged</td> <td>limits not enforced, or off by a full turn</td>
# <td>`within(chain, q)`</td> <td>limits in every step; restarts</td></tr>
# <tr><td>the arm sags when it carries a load</td> <td>payload or gravity wrong in the model; no integral
# term (a torque that grows while the error stays)</td> <td>torques at rest in two postures</td> <td>set or identify
# the payload; add an integral term</td></tr>
# </table>

# %%
predict("error_that_stays")

# %% [markdown]
# ## 7 · Exercises
#
# Warm up with a **drill**, a short exercise in your own editor: `drills start fk3` opens forward kinematics of three
# links. After a correct solution, `check(fk3).chart()` compares its speed with the reference and with Pinocchio.
#
# Each exercise below has a card with the task and three hints, a cell to change, and a check on new random cases.
#
# ### Inverse kinematics of two links

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
# The linear rows of a column are the joint's axis crossed with the line from the joint to the tool.

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
# ### A damped step
#
# Your step must respect its bound $\lvert e\rvert/(2\lambda)$ even if the Jacobian is zero, or if $\lambda^2$ is so
# small that adding it changes nothing.

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
# Here the joints have different weights: moving the heavy shoulder costs more than moving the wrist. The
# pseudo-inverse that minimises $\sum_i w_i\,\Delta q_i^2$ is $J^{+}_W = W^{-1}J^\mathsf{T}(JW^{-1}J^\mathsf{T})^{-1}$
# with $W = \mathrm{diag}(w)$, and the projector is no longer symmetric.

# %%
card("null_space_step")


# %%
def null_space_step(J, dx, secondary, weights):
    """Return the step that moves the tip by dx and otherwise follows a preferred step.

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
# ### Recursive Newton-Euler for a planar arm

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
# An IK loop stops when forward kinematics agrees with the target. So its *pose* is right even if its Jacobian is
# wrong. The **flange** is the plate at the end of the arm to which a tool is screwed. This loop computes the Jacobian
# at the flange, although the tip of the tool is 35 cm away:

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
        f"in {np.median(steps):.0f} steps (median); 20 N sideways: "
        f"{listed((jacobian(longer, q, point, joint=6)[:3].T @ (0.0, 20.0, 0.0))[:3])} N m"
    )

# %% [markdown]
# Both loops reach the pose. If the loop converges, a wrong Jacobian shows in the *number of steps* or in a
# comparison with finite differences, but not in the remaining error.
# The same matrix also turns forces into torques, printed here for the first three joints. Nothing corrects those.
#
# Now find a bug yourself. The next function returns angles every time, and on the robot it tears a cable.

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
# The check is symbolic, so any equivalent form is accepted. For a wrong formula it shows numbers at which yours
# differs. The second of the two answers below is wrong on purpose.
# <span class="kernel-only">Replace the text in quotes until the check accepts it.</span>

# %%
answer("two_link_jacobian", "l1*l2*sin(q2)")

# %%
answer("damped_gain", "1/lambda")

# %% [markdown]
# Four more formulas to answer in the same way: `damping_is_free`, `null_motion_leaves_the_tip`,
# `projector_of_the_null_space` and `second_task`.

# %% [markdown]
# ### Put it into your robot
#
# Your graded answers are parts of the pick-and-place robot of `drills robot`:

# %%
your_robot(4)

# %% [markdown]
# ## 8 · Frontier: learned inverse kinematics
#
# A grasp planner needs *many* postures for one pose of the hand, so that it can pick one that avoids obstacles. And an
# iterative solver needs fewer steps if it starts close to a solution. Could a network propose the starts? The simplest
# competitor is a **lookup table**: sample random postures once, store the pose of the tip for each, and start from the
# nearest stored poses.

# %%
predict("what_a_learned_start_must_beat")

# %% [markdown]
# A **normalizing flow** is an invertible network that bends a cloud of random noise into a cloud of postures. A
# **conditional** flow receives the pose as an additional input, so one pass produces thousands of candidates for it.
# Because the flow is continuous and the noise is one connected cloud, it cannot cut the cloud into separate pieces.
# Where the solutions form separate branches, some samples fall between them (drawn with a simple formula, not a trained
# flow):

# %% tags=["hide-code"]
rng = np.random.default_rng(3)
noise = rng.normal(size=(2, 500))
bend = np.tanh(4.0 * noise[0])  # a continuous map that moves most samples to two branches
figure_, axes = plt.subplots(1, 2, figsize=(9.6, 3.2), layout="constrained")
_ = axes[0].scatter(*noise, s=6, color="#3b6ea5")
_ = axes[0].set(title="noise", xlabel="z1", ylabel="z2")
_ = axes[1].scatter(
    -0.6 * bend + 0.08 * noise[1], 1.2 * bend + 0.05 * noise[1], s=6, color="#3b6ea5"
)
for side in (-1, 1):
    _ = axes[1].plot(-0.6 * side, 1.2 * side, "x", color="tab:red", markersize=14, mew=3)
_ = axes[1].set(
    title="two solutions (crosses), and samples between", xlabel="q1 [rad]", ylabel="q2 [rad]"
)
plt.show()

# %%
show("flow_samples_all")

# %% [markdown]
# <table>
# <tr><th>work</th> <th>year</th> <th>what it does</th></tr>
# <tr><td>TRAC-IK (Beeson and Ames, Humanoids)</td> <td>2015</td> <td>classical: two solvers with restarts in parallel;
# a common baseline</td></tr>
# <tr><td>IKFlow (Ames, Morgan and Konidaris, IEEE RA-L 7)</td> <td>2022</td> <td>a conditional flow for one arm; its
# approximate samples are refined by a classical solver</td></tr>
# <tr><td>Neural Inverse Kinematics (Bensadoun and others, ICML)</td> <td>2022</td> <td>samples one joint after another,
# each given the joints before it</td></tr>
# <tr><td>GGIK (Limoyo and others, arXiv 2209.08812)</td> <td>2022</td> <td>one graph network for many arms</td></tr>
# <tr><td>IK-Geo (Elias and Wen)</td> <td>2022</td> <td>classical: all solutions of a six-joint arm from geometric
# subproblems</td></tr>
# <tr><td>cuRobo (Sundaralingam and others, ICRA)</td> <td>2023</td> <td>classical: thousands of starts optimised at
# once on a GPU, with collision checks</td></tr>
# <tr><td>PyRoki (Kim, Yi and others, arXiv 2505.03728)</td> <td>2025</td> <td>classical: differentiable kinematics
# and least squares on CPU and GPU</td></tr>
# </table>
#
# The course trains something simpler than a flow: a small network with several outputs, each proposing one start for
# Levenberg-Marquardt. The left panel shows the share of poses of the 7-R arm that are solved within a given number of
# steps, counted over all starts. The right panel shows which part of all solutions of a planar three-joint arm is
# found, the *coverage*; for that arm the curve of solutions is known exactly:
#
# ![Poses solved, and solutions covered, with random starts, a lookup table and a
# network](../docs/charts/learned_seeds.png)

# %%
figures(read("learned_seeds"), summary="Poses solved and solutions covered")

# %% [markdown]
# The network needs as many steps as the lookup table. Neither covers clearly more solutions than random starts, whose
# curve is hidden behind the table's; with 16 to 64 starts the network covers fewer. So this small network, trained for
# ten seconds, has no advantage over the table. A larger one might.
#
# **Differentiable kinematics.** Forward kinematics is a product of smooth functions, so gradients pass through it:
# from a loss on a grasp or an image back to joint angles. Small gradient steps cannot move between separate branches.
#
# ## 9 · Interview
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** Asked about IK, state the step in one sentence and spend the minute on how it fails. Unreachable
# targets: report the remaining error. Singularities: give your step's gain there and *close by*. Several solutions:
# the start decides which one you get. Joint limits: enforce them in every step. If stuck, restart; in a control loop,
# report it. For seven joints, mention the null space, and that it is only the tangent of the solution curve, so you
# project, step, and correct the hand. Then say how you would test your Jacobian.
#
# </div>
#
# Answer each question aloud before you open it.

# %%
interview("kinematics")

# %% [markdown]
# ### Checkpoint
#
# Five questions, drawn by a seed.

# %%
checkpoint("kinematics", ["", "", "", "", ""], seed=1)
