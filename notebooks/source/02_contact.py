# %% [markdown]
# # 2 · Contact and friction
#
# *A contact can be a **penalty**, a stiff spring that pushes back what sinks in (blue), or a constraint, an impulse
# that is solved for so that nothing sinks in (orange). Answer first; then run the cells, press* Play *and drag.*
# {open minutes} minutes to read and move, {folded minutes} minutes more for what is folded away, {exercise minutes}
# minutes of exercises.
# %%
from course.cards import predict
from course.simulations import simulation

predict("gentle_pull")
# %% [markdown]
# ![Two shapes touch: penalty and constraint at one step](attachment:contact.touch.png)
# %%
simulation("touch")
# %% [markdown]
# **You will be able to** find what touches among thousands of bodies and say what that costs; compute distance, depth
# and normal of convex shapes; write the contact law, its models and their limits; say with figures what each model does
# right, what it costs, where it breaks; and reproduce MuJoCo's contact forces to the last digits. **Know first:**
# chapter 1; matrices; Python with NumPy.
#
# ## How this chapter works
#
# Most scenes begin with a card: answer first; a click tells whether you are right. (What holds only under a condition
# is false as it stands.) Derivations are folded away. A number in the text comes from the cell above it, or from a
# check that `python -m course.derivations 2` runs again. The code is `course.contact`, as the tests run it. These
# exercises wait in section 8:
# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint

badges(2)
# %%
import inspect
import math
import textwrap

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

from course import contact
from course.cards import figures, interview
from course.charts import read
from course.charts.contact import models as charts
from course.contact import broad, scenes, solve
from course.contact.models import penalty_force, pgs_sweep
from course.contact.soft import soft_forces
from course.derivations import show
from course.oracles.mujoco import contact as mujoco_contact
from course.oracles.mujoco.contact import Options, contact_state


def source(*functions):
    """Show functions as they stand in the module."""
    text = "\n\n".join(inspect.getsource(f) for f in functions)
    return Markdown(f"```python\n{text}```")


# %% [markdown]
# ## 1 · Concept: who touches whom
#
# ### Thousands of bodies, few contacts
#
# Of $N$ bodies each could touch each. So collision detection has two phases. The **broad phase** throws away nearly all
# pairs by a cheap test of boxes; the **narrow phase** looks at the shapes of the pairs that are left. The cheap box is
# the **AABB**, the axis-aligned bounding box: the lowest and the highest coordinate on each axis.
# %%
show("aabb_all_axes")
# %%
show("aabb_listing_two_axes")
# %% [markdown]
# Testing every pair is $N(N-1)/2$ tests. **Sweep and prune** sorts the lower ends of the boxes along one axis, and
# tests each box only against those that begin before it ends. Between two steps the order hardly changes, so one keeps
# it and repairs it by an insertion sort. A uniform grid tests only what shares a cell.
# %%
predict("sweep_ten_times")
# %%
rng = np.random.default_rng(0)
for kind in ("spread", "settled", "aligned"):
    boxes = broad.crowd(kind, 3000, rng)
    pairs, every = contact.brute_force(boxes)
    sweep = contact.SweepAndPrune(axis=0)
    same = sweep.pairs(boxes).shape == pairs.shape
    in_cells = contact.uniform_grid(boxes)[1]
    print(
        f"{kind:<8} {pairs.shape[1]} pairs overlap; tests: all {every}, sweep {sweep.tests}, "
        f"grid {in_cells}; same pairs: {same}"
    )
# %% [markdown]
# Counts are the same on every machine, so they are what is tested. The times beside them have MuJoCo's own broad phase
# on the same boxes:
#
# ![Overlap tests and time of the broad phase against the number of boxes](../docs/charts/broad_phase.png)
# %% jupyter={"source_hidden": true}
figures(read("broad_phase"), "spread", "settled", "aligned", cut="; swaps", summary="Times, swaps")
# %%
show("sweep_and_prune_n_log_n")
# %% [markdown]
# The order that is kept saves less than one hopes: if every box moves by one per cent of its size, the swaps grow about
# as fast as the tests. What really decides is how many pairs are left, and that belongs to the shapes:
# %%
show("pile_of_a_hundred")
# %% [markdown]
# ### How deep, and which way out?
#
# A contact needs a **penetration** depth (or a distance, which is the same number with the other sign), a unit normal,
# and a point. For circles it is school geometry, with one trap:
# %%
show("circle_test_concentric")
# %% [markdown]
# For other convex shapes one function is enough: the **support function** gives the farthest point in a direction. The
# **Minkowski difference** of two shapes is the set of all differences of their points. The nearest point of that set to
# the origin is the distance. **GJK** (Gilbert, Johnson and Keerthi, 1988) walks there over small simplices of support
# points. When the origin is inside, **EPA** (the expanding polytope algorithm) blows a polytope up from within until it
# finds the nearest face: depth and normal. Move the box and see:
# %%
place = (0.95, 0.45, 0.5)  # change me: x [m], y [m], angle [rad]
triangle, brick = contact.points([[0.0, 1.0, 0.3], [0.0, 0.2, 0.9]]), contact.box([0.5, 0.3])
result = contact.distance(triangle, [0.0, 0.0, 0.0], brick, place)


def outline(shape, pose):
    """Return corners in the world, in their order around."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    corners = np.array([[c, -s], [s, c]]) @ shape.corners[:2] + np.array(pose[:2])[:, None]
    around = np.argsort(np.arctan2(*(corners - corners.mean(axis=1, keepdims=True))))
    return np.hstack((corners[:, around], corners[:, around[:1]]))


one, two = outline(triangle, (0.0, 0.0, 0.0)), outline(brick, place)
figure_, axes = plt.subplots(1, 2, figsize=(10, 3.4), layout="constrained")
_ = axes[0].plot(*one, *two, color="0.3")
_ = axes[0].plot(*np.column_stack((result.point_a, result.point_b)), "o-", color="tab:red")
_ = axes[0].set(aspect="equal", title="the nearest, or deepest, points", xlabel="x [m]")
differences = (one[:, :, None] - two[:, None, :]).reshape(2, -1)
_ = axes[1].plot(*differences, ".", color="tab:blue")
_ = axes[1].plot(0, 0, "k+", markersize=14)
_ = axes[1].set(aspect="equal", title="their differences, and the origin", xlabel="x [m]")
plt.show()
print(
    f"signed distance {float(result.distance):.4f} m, normal {result.normal.round(3)}, "
    f"{result.iterations} iterations"
)
# %%
show("gjk_minkowski")
# %% [markdown]
# The course stores a shape as a **core and a radius**: a point, a segment, a box or a set of points, and how far the
# surface is outside of it. A capsule is a segment with a radius. So GJK and EPA only ever see polytopes, which have
# finitely many corners, and end exactly instead of by a tolerance. An independent check is the **separating axis**
# test: two convex polytopes are apart if they are apart along a normal of one, or along a cross product of two edges.
# %%
show("epa_gives_the_contact")
# %% [markdown]
# A box on a table touches in a face. One point would let it tip over. A **manifold** is the polygon of the contact: the
# face of one body is cut by the sides of the other's, and each corner becomes a contact.
#
# A shape with a notch is not convex. What is asked of it by support points is its hull. A **convex decomposition** cuts
# it into convex pieces beforehand. Who does that?
# %%
show("concave_mesh_is_its_hull")
# %% [markdown]
# What one often hears instead is to take the hull as it is:
# %%
show("mug_and_its_hull")
# %% [markdown]
# ### Between two steps
# %%
predict("smaller_step_at_a_wall")
# %%
simulation("touch", "Tunnelling")
# %% [markdown]
# **Tunnelling** is what you see: one body comes through. There are two reasons, and two limits. Between two tests a
# body may fly over the wall: from $v\,h = 2r + w$ on (ball radius $r$, wall $w$, step $h$). And a soft contact may be
# pushed past the middle, at any step.
#
# The first has a cure. The **time of impact** is when two moving shapes first touch, however long the step. For balls
# it is a root. For convex shapes **conservative advancement** moves on by what the distance certainly allows, again and
# again: distance over a bound of the approach speed (Mirtich 1996).
# %%
ball, wall = contact.sphere(0.02), contact.box([0.005, 1.0, 1.0])
still, here = np.zeros(6), np.array([0.0, 0, 0, 1, 0, 0, 0])
for speed in (10.0, 1000.0):
    start, going = here - [0.5, 0, 0, 0, 0, 0, 0], np.array([speed, 0, 0, 0, 0, 0])
    hit = contact.time_of_impact(ball, start, going, wall, here, still, duration=1.0)
    print(
        f"{speed:6.0f} m/s: touches after {1e3 * float(hit.time):.6f} ms, exact "
        f"{1e3 * 0.475 / speed:.6f} ms; {hit.advances} advances"
    )
# %%
show("circles_once_a_step")
# %% [markdown]
# The least speed that comes through, by step, with both theories on it. MuJoCo's `speculative` flag is one curve:
#
# ![The least speed that comes through a wall, against the step](../docs/charts/tunnelling_limit.png)
# %% jupyter={"source_hidden": true}
line = read("tunnelling_limit").replace("none up to 400", "none").replace(" ms:", ":")
figures(
    line,
    "checked",
    "advanced",
    "MuJoCo, default",
    "MuJoCo, speculative",
    summary="Step [ms]: least speed [m/s] (none: up to 400); grid and soft limit",
)
# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** A pair costs nothing until its boxes overlap, and a contact is only as good as the shape, the normal
# and the moment at which one looked.
#
# </div>
#
# ## 2 · Concept: what they do to each other
#
# ### A spring for a floor
#
# The simplest contact force is a spring and a damper in the direction of the normal $n$ (from the other body to this
# one; $d$ is the depth, $u_n$ the normal speed, positive apart):
#
# $$\boxed{\; F_n = \max(0,\; k\,d - b\,u_n), \qquad F_t = -\mu F_n \min\!\Big(1, \frac{\lvert u_t\rvert}{v_s}\Big)
# \frac{u_t}{\lvert u_t\rvert} \;}$$
#
# Friction that is regularised like this is full from the slip speed $v_s$ on. Nothing has to be solved.
# %%
show("penalty_law_has_a_plus")
# %%
simulation("touch", "Pull-back")
# %% [markdown]
# Without the $\max$ the damper pulls while the bodies part: the normal force in the picture goes below zero, as if the
# floor were sticky. *Is the damper then why things stick together?*
# %%
show("damping_makes_things_stick")
# %%
show("penalty_is_a_step")
# %% [markdown]
# ### What the spring costs
# %%
predict("hundred_times_stiffer")
# %%
simulation("touch", "Explosion")
# %% [markdown]
# **Why the step matters: derive it.** Three tasks. (1) A mass $m$ on a spring $k$, no damper: below which step is the
# simulation stable? (2) How many milliseconds is that for 100 kN/m and 1 kg? (3) What changes with the damper, for each
# Euler?
#
# <details><summary>Hint 1: what is a step?</summary>
#
# A linear map of $(x, v)$. Write its matrix for semi-implicit Euler: first $v' = v - h\omega^2x$, then $x' = x + hv'$.
#
# </details>
# <details><summary>Hint 2: when is it stable?</summary>
#
# When no eigenvalue leaves the unit circle. The product of both is the determinant, their sum the trace.
#
# </details>
# <details><summary>Hint 3: where do they leave it?</summary>
#
# At $-1$ for semi-implicit Euler: set $1 + \text{trace} + \det = 0$. For explicit Euler the determinant passes 1 first.
#
# </details>
# <details><summary>Full solution</summary>
#
# *Explicit Euler*, without a damper: eigenvalues $1 \pm i\omega h$, outside the circle at every step. There is no
# limit. With a damper ($2\zeta\omega = b/m$) the determinant is $1 - 2\zeta\omega h + (\omega h)^2$; it is below 1 for
# $\omega h < 2\zeta$. Above critical damping the faster real eigenvalue decides, $\omega h <
# 2(\zeta - \sqrt{\zeta^2-1})$.
#
# *Semi-implicit Euler*: the determinant is $1 - 2\zeta\omega h$, the trace $2 - 2\zeta\omega h - (\omega h)^2$. The sum
# $1 + \text{trace} + \det$ is $4 - 4\zeta\omega h - (\omega h)^2$, which is zero at $\omega h =
# 2(\sqrt{1+\zeta^2} - \zeta)$, and at 2 without a damper.
#
# **Key insight.** Damping helps one scheme and hurts the other. The limit is necessary and not sufficient: a contact
# that opens and closes can rattle below it.
#
# </details>
#
# Change the texts until they are right:
# %%
answer("semi_implicit_limit", "sqrt(m/k)")
# %%
answer("contact_limit_explicit", "2000*sqrt(1/100000)")
# %%
answer("semi_implicit_damped_limit", "2/omega")
# %% [markdown]
# ![Largest step of penalty contact over damping, measured and in theory](../docs/charts/contact_penalty_limit.png)
# %% jupyter={"source_hidden": true}
figures(read("contact_penalty_limit"), "explicit", "semi-implicit", "a cube", summary="MuJoCo's")
# %% [markdown]
# Two contacts at once are stiffer than one: a cube on two springs pitches faster than it bounces, and that decides.
# And friction has a step limit of its own:
# %%
show("friction_has_a_step_limit")
# %% [markdown]
# ### Solve for the force instead
#
# Ask what a rigid contact *is*: force $f$ only pushes, gap $\phi$ never closes beyond zero, and no force acts at a
# distance. That is **complementarity**, here the **Signorini** conditions:
#
# $$\boxed{\; f \ge 0, \qquad \phi \ge 0, \qquad f\,\phi = 0 \;}\qquad\text{in short}\qquad 0 \le f \perp \phi \ge 0 .$$
# %%
show("one_of_force_and_gap_is_zero")
# %%
show("never_both_positive")
# %% [markdown]
# **Derive it.** Three tasks. (1) Why do the three conditions hold together? (2) Get them from a minimum of the energy.
# (3) Why is the law not smooth?
#
# <details><summary>Hint 1: what is minimised?</summary>
#
# Not $f\phi$: that is no energy. At rest a body minimises its own potential $V(q)$, among the positions that are
# allowed.
#
# </details>
# <details><summary>Hint 2: how does one minimise under an inequality?</summary>
#
# With a multiplier: $L = V(q) - f\,\phi(q)$. What is $\partial L/\partial q = 0$ in words?
#
# </details>
# <details><summary>Hint 3: draw it.</summary>
#
# Draw all allowed pairs $(\phi, f)$ in a plane. How many values has $f$ at $\phi = 0$?
#
# </details>
# <details><summary>Full solution</summary>
#
# (1) and (2): Minimise $V(q)$ with $\phi(q) \ge 0$. The conditions of Karush, Kuhn and Tucker are
# $\nabla V = f\,\nabla\phi$, $f \ge 0$, $\phi \ge 0$ and $f\phi = 0$. The first says that the contact carries what the
# other forces leave, along the normal. The sign of $f$ says that leaving the allowed set would lower $V$. The product
# says that a constraint that does not bind has no force.
#
# (3) The allowed pairs are two half axes with a corner. At $\phi = 0$ every $f \ge 0$ is allowed, so the force is no
# function of the gap: the law is set-valued. Velocities jump at impacts. An integrator that expects a smooth right
# side has nothing to evaluate; a time-stepping scheme asks instead for the impulse of the whole step.
#
# **Key insight.** The force is the multiplier of "do not overlap". It is found together with the motion, not before.
#
# </details>
# %%
answer("potential_of_contact", "k*c")
# %%
answer("velocity_lcp_without_gap", "-m*a")
# %%
show("contact_law_is_set_valued")
# %% [markdown]
# Now a step of length $h$. With the mass matrix $M$, the Jacobian $J$ of the contacts, the velocity $v_f$ that there
# would be without contact and the impulses $p$, the contacts move at
#
# $$u = J v_f + A\,p, \qquad A = J M^{-1} J^{\mathsf T}\qquad\text{and}\qquad 0 \le p_n \perp u_n + \phi/h \ge 0 .$$
#
# $A$ is the **Delassus** matrix: what one contact's impulse does to the velocity of another. Without friction this is
# an **LCP**, a linear complementarity problem. **Restitution** enters as the wanted speed: $u_n \ge -e\,u_n^-$ where a
# contact closes.
# %%
show("contact_is_an_lcp")
# %%
show("contact_velocity_jumps")
# %%
predict("legs_of_a_table")
# %%
figures(
    read("contact_table"),
    "carry    exact",
    "carry    sweeps, true cone (1000)",
    "carry    true",
    "carry    convex",
    "carry    penalty",
    "carry    MuJoCo",
    summary="Models, scenes",
)
# %% [markdown]
# ### Friction: a cone
#
# Coulomb's law: the tangential force is at most $\mu$ times the normal one, and where it slides it is as large as that
# and straight against the sliding. All allowed forces form the **friction cone** $\lvert f_t\rvert \le \mu f_n$.
# %%
simulation("touch", "Slip")
# %%
show("below_the_limit_sticks")
# %% [markdown]
# A round cone is not linear. The old way out is a **pyramid** inside of it: a few edges, and the whole problem is an
# LCP again, which pivots solve exactly. What does that do?
# %%
predict("braking_between_edges")
# %% [markdown]
# ![The way of a braking block and its direction, by cone and by pyramid](../docs/charts/contact_steering.png)
# %% jupyter={"source_hidden": true}
shown = ("exact pyramid", "box", "true cone", "MuJoCo Newton, pyramidal")
figures(
    read("contact_steering"),
    *(f"stretched {name}" for name in shown),
    *(f"turned    {name}" for name in shown if name != "true cone"),
    summary="All models: way over Coulomb's, degrees turned",
)
# %%
show("pyramid_slips")
# %%
show("box_of_limits")
# %% [markdown]
# ### How one solves it
#
# Projected **Gauss-Seidel** (PGS) goes from contact to contact: take the velocity that all impulses make now, move this
# contact's impulse against it, project it onto its cone. Then the next, and round again. Starting from the impulses of
# the last step is a **warm start**. It is what most game engines do.
# %%
source(pgs_sweep)
# %%
predict("heavy_on_light")
# %% [markdown]
# ![Sweeps against mass ratio and height of a tower](../docs/charts/contact_sweeps.png)
# %% jupyter={"source_hidden": true}
print(read("contact_sweeps"))
# %% [markdown]
# Two other ways end at the answer. Pivots (Lemke) solve the pyramid exactly. Newton's method on the *natural map*,
# $p = P(p - u/r)$ with the projection $P$ onto the cone, solves the round one.
# %%
show("iterations_50_to_100")
# %% [markdown]
# ### Friction made convex
#
# Coulomb's law is no minimum of anything: friction depends on a normal force that is itself unknown.
# The **convex relaxation** (Anitescu 2006) changes the law a little: what slides at speed $u$ also separates at
# $\mu u$. Then the step is one convex problem, with one velocity for an answer, and a duality gap says how far one is.
# %%
predict("block_that_hops")
# %%
show("mujoco_is_convex_and_unique")
# %% [markdown]
# ### What MuJoCo does
#
# MuJoCo solves a convex problem, and a soft one. Each row of a contact wants a reference acceleration, that of a spring
# and a damper, and pays for what it misses:
#
# $$a_{\text{ref}} = -b\,u - k\,d(r)\,r, \qquad f = (a_{\text{ref}} - a)/R \ \text{ within the cone}, \qquad
# R = \frac{1-d}{d}\,\hat A .$$
#
# **solref** sets $k$ and $b$ by a time constant and a damping ratio. **solimp** sets the impedance $d$ between 0 and 1
# as a function of the depth $r$. **impratio** makes friction harder than the normal; **condim** says how many rows a
# contact has: 1 without friction, 3 with sliding, 4 with spin, 6 with rolling. That is all:
# %%
options = Options(cone="elliptic")
runner, worst, largest = mujoco_contact.box(options, (0.5, 0.2)), 0.0, 0.0
for steps in range(1, 200, 10):
    runner.run(steps)
    state = contact_state(runner)
    if state is not None:
        force = soft_forces(state.problem, options.softness(state.weight))[0]
        worst = max(worst, np.abs(force - state.force).max())
        largest = max(largest, np.abs(state.force).max())
print("a box that slides on four corners: efc_force and ours differ by less than a part in 1e10:")
print(worst < 1e-10 * largest)
# %%
show("default_tolerance")
# %% [markdown]
# A disc that spins on one point at 10 rad/s: which condim stops it?
# %%
for condim in (1, 3, 4, 6):
    spun = Options(condim=condim, friction=(0.5, 0.01, 0.0001))
    remaining = mujoco_contact.spinning_disc(spun, 10.0).run(300)[1][3]
    print(f"condim {condim}: {abs(remaining):.2f} rad/s after 0.6 s in MuJoCo")
remaining = [
    scenes.run(scenes.spinning_disc(10.0, 0.5, x), "coulomb", 2e-3, 300).v[3, -1] for x in (0, 0.01)
]
print(
    f"true cone: {remaining[0]:.2f} rad/s by three rows, {abs(remaining[1]):.2f} by the fourth, torsion"
)
# %%
show("condim_4_is_the_full_cone")
# %%
show("condim_1_is_frictionless")
# %% [markdown]
# A soft contact has a step limit too, the third picture of the penalty's step limits above. A clamp hides it:
# %%
show("refsafe_keeps_it_stable")
# %% [markdown]
# ### It holds, and it moves
# %%
predict("glass_that_creeps")
# %% [markdown]
# A friction row of that model has a damper and no spring. To carry a load it has to move, slowly and for ever:
# **creep**. A block on a slope of 0.2 rad that needs a fifth of a coefficient, and has a half:
# %%
for label, changed in (
    ("elliptic", {"cone": "elliptic"}),
    ("impratio 10", {"cone": "elliptic", "impratio": 10.0}),
    ("pyramidal", {"cone": "pyramidal"}),
):
    ours = scenes.run(scenes.block(0.2, 0.5), "soft", 0.002, 500, **changed).v[0, -1]
    queried = Options(0.002, friction=(0.5, 0.005, 0.0001), **changed)
    theirs = mujoco_contact.block(queried, 0.2).run(500)[1][0]
    print(f"{label:<12} creeps at {1e3 * ours:.4f} mm/s, in MuJoCo at {1e3 * theirs:.4f} mm/s")
# %%
show("more_friction_holds_the_glass")
# %%
show("heavy_on_light_sinks")
# %%
show("tower_sags")
# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Every model gives something up. Penalty gives up depth and step, pyramids the direction, the convex
# cone the gap in sliding, softness the standstill, and Coulomb's law itself the promise that there is an answer.
#
# </div>
#
# ### Through a contact, by derivatives
# %%
predict("push_that_starts_too_slow")
# %% [markdown]
# ![Derivatives through a contact, by five ways](../docs/charts/contact_gradients.png)
# %% jupyter={"source_hidden": true}
print(read("contact_gradients"))
# %%
show("contact_gradients_vanish")
# %% [markdown]
# Two remedies feel a contact from afar, and both trade a bias for a slope. *Randomised smoothing* takes the mean over
# noisy runs, from values alone. An *interior point* lets force times gap speed be a small number instead of zero, so
# that a little force acts at a distance (Dojo does that; it does not average over noise).
#
# ## 3 · Design: where contact sits in the loop
#
# First a decision: does one solve for accelerations and forces, or for velocities and impulses?
# %%
show("mujoco_is_velocity_level")
# %% [markdown]
# <table>
# <tr><th>stage</th> <th>takes</th> <th>gives</th> <th>what it costs</th></tr>
# <tr><td>broad phase</td> <td>boxes, the order of the last step</td> <td>pairs</td> <td>grows faster than $N$; hash or
# grid for many equal bodies</td></tr>
# <tr><td>filters</td> <td>pairs</td> <td>pairs that may touch (not parent and child, groups, sleeping)</td>
# <td>nothing</td></tr>
# <tr><td>narrow phase</td> <td>shapes, poses</td> <td>points, normals, depths</td> <td>the same for each pair of convex
# shapes (section 6); a mesh more</td></tr>
# <tr><td>constraints</td> <td>contacts, $M$, $v$, $h$</td> <td>$J$, $A$, wanted speeds</td> <td>$A$ is dense within an
# island of touching bodies</td></tr>
# <tr><td>solver</td> <td>$A$, $b$, cones, the last impulses</td> <td>impulses, a residual</td> <td>sweeps, or Newton
# steps that factor a matrix</td></tr>
# <tr><td>integration</td> <td>impulses</td> <td>new state</td> <td>nothing</td></tr>
# </table>
#
# All of that once a physics step, usually 0.5 to 5 ms. Four decisions are taken here and felt everywhere. Shapes:
# primitives and few convex pieces, separate from what is drawn. Order: contacts in a fixed order, or a run does not
# repeat. Memory: contacts are matched to those of the last step for the warm start. And honesty: a solver that did not
# converge says so, with its residual.
# %%
pile = scenes.tower([1.0, 100.0]).problem(0.002)
for name, sweeps in (("pgs", {"sweeps": 10}), ("pgs", {"sweeps": 1000}), ("coulomb", {})):
    line = solve(name, pile, **sweeps)
    how = "solved" if line.converged else f"NOT solved, residual {line.residual:.0e} m/s"
    print(f"{name:<8} after {line.iterations:4d} iterations: {how}")
# %% [markdown]
# **Five numbers judge any of them**, ours or an engine: penetration, Signorini's product, how far friction leaves its
# cone, what friction could have dissipated and did not, and energy that came from nowhere.
# %%
sliding = scenes.block(0.0, 0.5, (0.6, 0.8)).problem(0.01)
for model in ("lcp", "pgs", "coulomb", "convex"):
    r = contact.residuals(sliding, solve(model, sliding).impulses)
    print(
        f"{model:<8} Signorini {r.signorini:.3f} m/s, out of the cone {r.cone:.3f} N s, "
        f"not dissipated {1e3 * r.dissipation:.1f} mJ"
    )
# %% [markdown]
# ## 4 · Code: the reference functions
#
# Three that one is asked to write. The overlap of two boxes, in any dimension:
# %%
source(broad.aabb_overlap)
# %% [markdown]
# How often is it called by brute force, for `n` bodies?
# %%
answer("brute_force_pairs", "n^2")
# %% [markdown]
# The contact of two circles is an exercise of this chapter (section 8). The penalty force, with friction, and with the
# switch that lets the damper pull:
# %%
source(penalty_force)
# %%
show("damper_damps")
# %% [markdown]
# And the front door. A `Problem` is one step: masses, Jacobian, velocities, gaps, friction. `solve` answers with
# impulses by one of six models, and says whether it solved it:
# %%
braking = scenes.block(0.0, 0.5, (1.0, 0.0))
for model in contact.MODELS:
    path = scenes.run(braking, model, 0.001, 300)
    print(
        f"{model:<8} stops after {path.q[0, -1]:.4f} m (Coulomb {1 / scenes.GRAVITY:.4f} m), "
        f"off the ground by up to {1e3 * path.q[2].max():.3f} mm"
    )
# %%
try:
    scenes.block(0.0, friction=-0.5)
except ValueError as problem:
    print(textwrap.fill(str(problem), 96))
# %% [markdown]
# ## 5 · The simulation in full
#
# Both bodies hang on the hand by the same spring; only the contact differs. Depth, forces and normal are printed for
# both, penalty first. Drag the hand, or move it with the arrow keys. Before you choose a preset, say what will happen:
#
# 1. *Stick*: which of the two moves, and how fast?
# 2. *Slip*: where in the picture of forces do both points lie?
# 3. *Explosion*: at which step does the penalty calm down? Compare $\omega h$ with the limit.
# 4. A stiffness of 50,000 N/m instead of 3,000: what becomes of the depth, and what of the largest step?
# 5. *Tunnelling*: is there a step at which the penalty holds?
# %%
simulation("touch", "Stick")
# %% [markdown]
# ## 6 · Speed against accuracy
#
# Four scenes, each the smallest that answers its question, each with a tolerance. *Where does a block stop* that was
# sent off between the edges (2 mm)? *How far does a block slide* down a slope (1 mm)? *How deep does a light body sink*
# under a heavy one (1 mm)? *How far does a held glass slip* (1 mm)? Drag the tolerance, switch methods on:
# %%
from course.simulations.trade_off import TradeOff

STEPS = (2e-2, 1e-2, 5e-3, 2e-3, 1e-3)
measured = charts.work_precision("braking", STEPS, repeats=1)
for name in ("true cone (Newton)", "exact pyramid (LCP)", "MuJoCo Newton, elliptic"):
    curve = next(curve for curve in measured.curves if curve.name == name)
    print(f"{name:<24} error at 1 ms {1e3 * curve.points[-1].error:6.3f} mm")
TradeOff(measured)
# %% [markdown]
# Put a contact model of your own on it. It gets a `Problem` and returns impulses; this one clamps each tangent by
# itself, as one often sees it:
# %%
from course.measure.work_precision import Method, Result


def my_model(problem):
    """Change me: normal and friction impulses of a single contact, shape (1, 3)."""
    u = problem.jacobian @ problem.free
    normal = max(0.0, -u[0, 0] / problem.delassus[0, 0])
    largest = problem.friction[0] * normal
    return np.array(
        [[normal, *np.clip(-u[0, 1:] / np.diag(problem.delassus)[1:], -largest, largest)]]
    )


def once(dt):
    """Return the braking block, stepped with it."""
    requested, steps = charts.QUESTIONS["braking"], round(charts.DURATION / dt)
    h, q, v = charts.DURATION / steps, requested.scene.q, requested.scene.v
    for _ in range(steps):
        step = requested.scene.problem(h, q, v)
        v = step.after(my_model(step))
        q = q + h * v
    return Result(requested.answer(q), steps)


once(1e-3)  # what fails here would only be a failed run on the chart
mine = measured.with_method(Method("yours", once, STEPS, "yours"), repeats=1)
print(f"error of yours at 1 ms: {1e3 * mine.curves[-1].points[-1].error:.1f} mm")
TradeOff(mine)
# %% [markdown]
# Two of the others, beside MuJoCo with three solvers and two cones at its default softness, and hardened: a time
# constant of 4 ms, an impedance near 1 and an impratio of 100. Under a heavy body MuJoCo's defaults miss at every step,
# and hardening it cures that:
#
# ![How deep a light body sinks under a heavy one, error against cost](../docs/charts/contact_heavy.png)
#
# By default a held glass creeps in MuJoCo, however short the step. Hardened it creeps within the tolerance:
#
# ![How far a held glass slips, error against cost](../docs/charts/contact_glass.png)
#
# <details><summary>The block that slides, where all agree</summary>
#
# ![How far a block slides, error against cost](../docs/charts/contact_incline.png)
#
# </details>
#
# ### Model by scene
#
# One step of 2 ms for all; *good* is an error within the scene's tolerance. `python -m course.charts contact_table`
# measures it again, and each sentence under it is checked.
# %% jupyter={"source_hidden": true}
rows = [line for line in read("contact_table").splitlines() if line[:8].strip() in charts.QUESTIONS]
retained = ("penalty", "exact", "sweeps, true cone (10)", "true cone", "convex")
figures(
    read("contact_table"),
    "scene",
    *(row for row in rows if row[9:].startswith(retained) and row[:5] in ("braki", "heavy")),
    summary="All models and scenes, MuJoCo's among them, with the cost of a step",
)
# %% jupyter={"source_hidden": true}
print("\n".join(line for line in read("contact_table").splitlines() if line in charts.SENTENCES))
# %% [markdown]
# Read the cost with care: MuJoCo's step is compiled, a step of ours is a few lines of NumPy, so compare *counts*
# between the two and times within each.
#
# **The narrow phase beside Coal** (the library that Pinocchio uses): our public `distance` against Pinocchio's
# `computeDistances`, one call in C++ for all pairs, and against one call a pair from Python. Poses are set beforehand:
#
# ![Narrow phase: time over that of Coal, and error](../docs/charts/narrow_phase.png)
# %% jupyter={"source_hidden": true}
figures(read("narrow_phase"), "GJK and EPA", "Coal  ", "Coal, default", "largest", summary="Pairs")
# %% [markdown]
# Where the two differ, it is not by chance:
# %%
show("coal_is_the_truth")
# %% [markdown]
# ### What to pick
#
# * *A robot arm, learning at scale*: soft and convex (MuJoCo). Unique, fast, smooth enough; raise impratio where things
#   are held, use the elliptic cone where they slide.
# * *Stacks, large mass ratios*: the rigid law by Newton or pivots, or MuJoCo hardened; sweeps only with light on heavy.
# * *Exact standstill*: the rigid law. A hardened contact creeps, too, only more slowly.
# * *A few soft contacts, gradients, no solver at hand*: penalty, with a step below its limit and a depth you can
# accept.
# * *Games*: ten sweeps with a warm start. It looks right.
# %%
show("constraints_take_larger_steps")
# %% [markdown]
# ## 7 · Debug: where it fails
#
# ### No answer at all
# %%
predict("chalk_on_the_board")
# %% [markdown]
# This is **Painlevé**'s rod (1895), here at 60 degrees to the ground. It has a limit of $\mu$, computed below. Under
# it a force holds the end, so the impulse goes with the step. Above it no force does. A time-stepping scheme answers
# with an impulse that does not shrink: the rod is stopped at once although nothing collided.
# %%
angle = np.radians(60.0)
limit = (1.0 + 3.0 * np.cos(angle) ** 2) / (3.0 * np.sin(angle) * np.cos(angle))
print(f"limit: mu = {limit:.3f}")
for mu in (1.0, 2.0):
    rod = scenes.rod(angle, mu)
    shares = [solve("coulomb", rod.problem(dt)).impulses[0, 0] for dt in (1e-3, 1e-6)]
    dive = scenes.run(rod, "penalty", 1e-4, 100, stiffness=1e6, damping=100.0)
    print(
        f"mu {mu:.0f}: normal impulse {shares[0]:.1e} N s in 1 ms, {shares[1]:.1e} in 1 us; by "
        f"penalty up to {dive.impulses[0, 0].max() / 1e-4:.0f} N"
    )
# %% [markdown]
# The convex model has an answer here too, as it always has. It is not Coulomb's: below the limit it makes the rod hop.
#
# ### Thrown out of the ground
#
# A body that starts too deep has to come out. Rigid models take back a share of the depth in each step, 0.2 here. The
# field calls this **Baumgarte stabilisation**. A fixed share per step is a speed of share times depth over step, so a
# shorter step throws the body out faster. Our models cap that speed at 1 m/s (`max_recovery_speed`):
#
# ![How fast a ball that starts 1 cm deep leaves the ground, over the step](../docs/charts/contact_recovery.png)
#
# ### Debugging table
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *Objects stick together.* Log the normal force: below zero, a damper pulls (clip it). Then look at
# the tangential force of a contact that opens; at the margin, and at adhesion that somebody set.
#
# </div>
# %%
show("nconmax_helps")
# %% [markdown]
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *A grasped object slips.* Is it sliding or creeping? Print speed, and friction over its limit. At
# the limit: more squeeze, more friction, a cone instead of a pyramid. Far below it: creep; raise impratio or shorten
# the time constant. In steps: contacts come and go; look at the manifold.
#
# </div>
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The simulation is slow with many objects.* Count before you time: pairs tested, pairs left,
# contacts, iterations. Too many pairs: boxes that are too large, or one sweep axis along a pile. Too many contacts:
# meshes instead of primitives. Too many iterations: mass ratios. Then time each stage.
#
# </div>
# %%
show("mujoco_timer")
# %% [markdown]
# <table>
# <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr>
# <tr><td>body thrown off at touch</td> <td>$\omega h$ beyond the limit, or a deep start taken back in one step</td>
# <td>halve $h$; print the first depth</td> <td>softer; a bounded speed of recovery (a shorter step alone throws it out
# faster)</td></tr>
# <tr><td>deep overlap at rest</td> <td>spring too soft, light under heavy, sweeps not converged</td> <td>the residual;
# swap the masses</td> <td>solver by Newton; direct solref</td></tr>
# <tr><td>bends its way while braking</td> <td>pyramid</td> <td>send it off at several angles</td> <td>elliptic
# cone</td></tr>
# <tr><td>rattles on a mesh or an edge</td> <td>normal flips between features; one point instead of a manifold</td>
# <td>draw normals over time</td> <td>manifold, rounded edges (a radius)</td></tr>
# <tr><td>passes a wall at any step</td> <td>soft contact past its middle</td> <td>record depth over wall</td>
# <td>stiffen, thicken</td></tr>
# <tr><td>another result at each run</td> <td>contacts in another order</td> <td>hash the state</td> <td>sort pairs; fix
# threads</td></tr>
# <tr><td>NaN now and then</td> <td>normal of concentric centres, degenerate simplex</td> <td>place centres on each
# other</td> <td>a case of its own</td></tr>
# </table>
#
# ## 8 · Exercises
#
# Each has a card with the task and three hints, a cell to change, and a check, which runs what your cell defines on
# cases drawn afresh, and says what is wrong and, where it recognises the mistake, why. The same run in a terminal:
# `drills start aabb`, `drills check aabb`.
# %% [markdown]
# ### Boxes
#
# Simple, and asked often: on every axis, in any dimension.
# %%
card("aabb")


# %%
def aabb_contact(a, b):
    """Return overlap of two axis-aligned boxes, and the shortest way out of it along an axis.

    Args:
        a: corners of the first box, rows low and high, shape (2, d) [m].
        b: corners of the second box, shape (2, d) [m].

    Returns:
        (depth, push): depth [m], negative when apart; the move of b, shape (d,) [m].
    """
    # Nothing ever touches.
    return -1.0, np.zeros(np.shape(a)[1])


# %%
check(aabb_contact)
# %% [markdown]
# ### Circles
#
# Section 1 showed the trap. Any distance of the centres counts, also none.
# %%
card("circle_contact")


# %%
def circle_contact(centre_a, radius_a, centre_b, radius_b):
    """Return gap, normal and point of contact of two circles.

    Args:
        centre_a: of the first circle, shape (2,) [m].
        radius_a: of the first circle [m].
        centre_b: of the second circle, shape (2,) [m].
        radius_b: of the second circle [m].

    Returns:
        (gap, normal, point): gap [m]; unit normal from a to b, shape (2,); point, shape (2,) [m].
    """
    # Any two circles touch at the origin.
    return 0.0, np.array([1.0, 0.0]), np.zeros(2)


# %%
check(circle_contact)
# %% [markdown]
# ### Time of impact
#
# A root that everybody can write down, and that loses its digits far away.
# %%
card("impact_time")


# %%
def impact_time(place, velocity, other, other_velocity, reach):
    """Return when two balls in straight flight touch for the first time.

    Args:
        place: of the first ball's centre, shape (d,) [m].
        velocity: of the first ball, shape (d,) [m/s].
        other: of the second ball's centre, shape (d,) [m].
        other_velocity: of the second ball, shape (d,) [m/s].
        reach: both radii together [m].

    Returns:
        The time [s]; 0 when they overlap now, -1 when they never touch.
    """
    # The distance is looked at now, and never again.
    distance = np.linalg.norm(np.asarray(other) - np.asarray(place))
    return 0.0 if distance <= reach else -1.0


# %%
check(impact_time)
# %% [markdown]
# ### A sweep
#
# The block form of section 2, in the true cone: projected, not clamped.
# %%
card("pgs_sweep")


# %%
def pgs_sweep(impulses, A, b, mu):
    """Return the impulses after one sweep of projected Gauss-Seidel with friction cones.

    Args:
        impulses: of each contact: normal, then two tangents, shape (n, 3) [N s].
        A: velocity at the contacts by unit impulses, shape (3 n, 3 n) [1/kg].
        b: velocity at the contacts without impulses, shape (3 n,) [m/s].
        mu: coefficient of friction.

    Returns:
        The impulses after the sweep, shape (n, 3) [N s].
    """
    swept = np.array(impulses, dtype=float)
    # No contact has been looked at yet.
    return swept


# %%
check(pgs_sweep)
# %% [markdown]
# ### Silent-bug hunt
#
# Nothing crashes, the pictures are plausible, one thing is wrong. Find the experiment whose result you know without a
# program.
# %%
card("contact_step")


# %%
def contact_step(position, velocity, slope, mu, dt, steps):
    """Return a block over an inclined plane.

    By time stepping with one contact and Coulomb friction.

    Args:
        position: along the slope downwards, and above the plane, shape (2,) [m].
        velocity: along the same axes, shape (2,) [m/s].
        slope: inclination of the plane [rad].
        mu: coefficient of friction.
        dt: step [s].
        steps: how many.

    Returns:
        (position, velocity) at the end, each shape (2,).
    """
    x, v = np.array(position, dtype=float), np.array(velocity, dtype=float)
    gravity = 9.81 * np.array([math.sin(slope), -math.cos(slope)])
    for _ in range(steps):
        v = v + dt * gravity
        # Impulses per kilogram: the normal one lets the block just touch at the end of the step.
        normal = max(0.0, -(v[1] + x[1] / dt))
        largest = mu * 9.81 * dt if normal > 0.0 else 0.0
        friction = min(max(-v[0], -largest), largest)
        v = v + np.array([friction, normal])
        x = x + dt * v
    return x, v


# %%
check(contact_step)
# %% [markdown]
# ### Formulas
#
# Checked symbolically, like those of section 2. Two fingers press a glass of mass `m` with the force `F` each:
# %%
answer("more_friction_holds_the_glass", "m*g/F")
# %% [markdown]
# ## 9 · Frontier: contact that can be differentiated, learned, trusted
#
# <table>
# <tr><th>what</th> <th>source</th> <th>idea</th></tr>
# <tr><td>SAP, in Drake</td> <td>Castro, Permenter and Han 2022</td> <td>compliant contact as an unconstrained convex
# problem, solved globally each step</td></tr>
# <tr><td>hydroelastic contact</td> <td>Elandt et al. 2019; Masterjohn et al. 2022</td> <td>pressure fields inside the
# bodies; a contact is a surface, and its force changes continuously with the pose</td></tr>
# <tr><td>incremental potential contact</td> <td>Li et al. 2020</td> <td>a barrier on the distance: nothing ever passes,
# large steps, costs a nonlinear solve</td></tr>
# <tr><td>Dojo</td> <td>Howell et al. 2022</td> <td>rigid contact by an interior point, gradients of the softened
# problem</td></tr>
# <tr><td>smoothing for planning</td> <td>Suh et al. 2022; Pang et al. 2023</td> <td>what randomised and analytic
# smoothing have in common; plans through contact</td></tr>
# <tr><td>learned contact</td> <td>Pfrommer, Halm and Posa 2020 (ContactNets)</td> <td>shape and friction from tosses,
# with complementarity inside the loss</td></tr>
# <tr><td>models compared</td> <td>Le Lidec et al. 2024</td> <td>which engine relaxes which of the laws, and what that
# does</td></tr>
# </table>
#
# <details><summary>Sentences one hears that nothing here checks, and why</summary>
#
# *There are two approaches to contact*, penalty and constraint: section 2 has six models, and MuJoCo's soft one is
# both. *Real engines use constraints*: a count of engines, and no experiment; Drake's compliant point contact is a
# penalty. *Rubber on plastic has 0.8 to 1.2*: a property of two surfaces, their load and speed; measure yours (tilt it
# until it slides).
#
# *A decomposition (V-HACD) gives 3 to 8 pieces*: a parameter of that tool, and of the mesh. *Hydroelastic contact
# replaces hard contact by smooth pressure*: so say its authors; Drake is not run here, and it stands beside point
# contact. *Contact solvers are PGS and ADMM*: Pinocchio 4 ships one of each; ADMM is left out, as what it solves is
# what Newton's method solves here, and Newton, CG and pivots are missing in that list.
#
# </details>
#
# Does a gradient learn to push? Descent on the finger's speed, from a start that does not arrive, for a mark at 5 cm
# behind the block. By the rigid gradient nothing ever happens; the smoothed one gets there:
# %%
for how in ("rigid", "randomised"):
    speed, rng = 0.15, np.random.default_rng(1)
    for _ in range(40):
        error = charts.pushed(speed, "rigid", 2e-2) - 0.05
        if how == "rigid":
            slope = charts.slope(lambda s: charts.pushed(s, "rigid", 2e-2), speed, 1e-5)
        else:
            slope = charts.smoothed_slope(
                lambda s: charts.pushed(s, "rigid", 2e-2), speed, 0.05, rng, 20
            )
        speed -= 2.0 * error * slope
    reached = charts.pushed(speed, "rigid", 2e-2)
    print(f"{how:<11} speed {speed:.2f} m/s, block at {1e3 * reached:.0f} mm (mark 50 mm)")
# %%
show("penalty_is_differentiable")
# %% [markdown]
# ## 10 · Interview
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** *Penalty or constraint?* Say first what is asked of the contact. "Penalty: a spring, nothing to
# solve, smooth force; it sinks in, its friction creeps, and $h < 2(\sqrt{1+\zeta^2}-\zeta)/\omega$. Constraint: no
# depth, sticks exactly, has no step limit of its own; it needs a solver, and the sweeps of Gauss-Seidel grow with the
# mass ratio (Newton's steps do not). Its gradients are zero before touch and ordinary numbers behind it. MuJoCo is in between: constraints with softness, convex, unique, and it
# creeps. For a grasp I take the true cone and print the residual."
#
# </div>
#
# Answer aloud, then open: first what one says in a minute, then the whole of it, then what comes next.
# %%
interview("contact")
# %% [markdown]
# ### Checkpoint
#
# Three formulas that are not on this page; you can derive them from what is. The gate opens when all are right.
# %%
checkpoint("contact", sweeps_and_masses="", convex_cone_is_coulomb="", mujoco_creeps="")
