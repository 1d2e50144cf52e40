# %% [markdown]
# # 2 · Contact and friction
#
# *A simulated gripper holds a glass, and the glass slides slowly out of its fingers. A box sinks into a table. A fast
# ball flies through a wall. All three faults come from the way a simulator computes contact.*
#
# A **penalty** method lets bodies overlap a little and pushes them apart with a stiff spring. A constraint method
# computes the push that prevents the overlap. Below, the blue box uses the penalty method, the orange one a constraint.
# Both start at the same place, so the orange box covers the blue one until they move apart.
#
# About {open minutes} minutes of reading, cards and charts. The folded parts add {folded minutes} minutes, the
# exercises {exercise minutes} minutes.
# %%
from course.cards import predict
from course.simulations import simulation

predict("gentle_pull")
# %% [markdown]
# ![Two shapes touch: penalty and constraint at one step](attachment:contact.touch.png)
# %%
simulation("touch")
# %% [markdown]
# The menu has **presets**, prepared sets of controls. The lower plot shows the force on each box, its part
# perpendicular to the floor (*normal*) against its part along the floor (*tangential*, positive to the right). The
# two slanted lines mark the largest friction that each normal part allows. A box that slides has its point on a line;
# between the lines a box sticks or creeps (slides slowly). Section 2 explains *ω h*.
#
# **After this chapter you can** find the touching pairs among thousands of bodies and say what that costs; compute
# distance, depth and normal of convex shapes; write down the contact law and solve it; say what each common
# approximation gets wrong, with numbers; and explain how MuJoCo computes contact forces. You need chapter 1,
# matrices, and Python with NumPy.
#
# ## How this chapter works
#
# Some cards show a statement, which you judge: true, false, or true only under a condition. Many are about
# **MuJoCo**, a widely used free simulator. `python -m course.derivations 2` reruns all checks of this page. The code
# is the package `course.contact`; it calls the step `dt`, which the text calls $h$. The times above include neither the
# fold-outs *More claims about this* nor section 10. Section 8 has six exercises:
# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint

badges(2)
# %% tags=["hide-code"]
import inspect
import math
from dataclasses import replace

import numpy as np
from IPython.display import Markdown

from course import contact
from course.cards import figures, interview
from course.charts import read
from course.charts.contact import models as charts
from course.contact import broad, scenes, solve
from course.contact.models import penalty_force
from course.contact.soft import soft_forces
from course.contact.stabilization import (
    erp_cfm,
    solve_erp_cfm,
    split_impulse_steps,
    xpbd_steps,
)
from course.derivations import more_claims, show
from course.oracles.mujoco import contact as mujoco_contact
from course.oracles.mujoco.contact import Options, contact_state
from course.page_records import from_record


def source(*functions):
    """Show functions as they are in the module."""
    text = "\n\n".join(inspect.getsource(f) for f in functions)
    return Markdown(f"```python\n{text}```")


# %% [markdown]
# ## 1 · Concept: finding contacts
#
# ### Broad phase: which pairs could touch?
#
# A warehouse simulation has thousands of parcels, and any two of them could touch. Computing the exact distance of
# every pair would take far longer than the rest of the step. Yet at any moment only neighbours touch.
#
# So collision detection works in two stages. The **broad phase** discards nearly all pairs with a cheap test. The
# **narrow phase** computes exact geometry for the pairs that remain. The cheap test uses an **AABB**, an axis-aligned
# bounding box: the smallest and the largest coordinate of a body on each axis. On one axis, two boxes overlap if each
# of them begins before the other ends.
# %%
show("aabb_all_axes")
# %% [markdown]
# Testing all pairs of $N$ boxes takes $N(N-1)/2$ overlap tests. **Sweep and prune** usually needs fewer. It sorts the
# boxes by their lower end along one axis and walks through the list. For each box, it tests the boxes that follow in
# the list, and stops at the first that begins after this box ends. A **uniform grid** divides space into cells and
# tests only boxes that share a cell. A **bounding-volume tree**, as in Bullet and Box2D, nests boxes in larger boxes
# and skips whole groups.
# %%
predict("sweep_ten_times")
# %% [markdown]
# This cell counts overlap tests for 3,000 boxes that fill a cube, lie in one layer, or all overlap along the sweep
# axis.
# %% tags=["hide-code"]
rng = np.random.default_rng(0)
names = {"spread": "filling a cube", "settled": "in one layer", "aligned": "all overlap in x"}
print(
    f"{'boxes':<17} {'overlap':>7} {'all pairs':>10} {'sweep':>10} {'grid':>7}   same pairs found"
)
for kind, name in names.items():
    boxes = broad.crowd(kind, 3000, rng)
    pairs, every = contact.brute_force(boxes)
    sweep = contact.SweepAndPrune(axis=0)
    same = sweep.pairs(boxes).shape == pairs.shape
    in_cells = contact.uniform_grid(boxes)[1]
    print(f"{name:<17} {pairs.shape[1]:7d} {every:10d} {sweep.tests:10d} {in_cells:7d}   {same}")
# %% [markdown]
# The grid needs the fewest tests here, but for few boxes not the least time (right chart below). For sweep and prune,
# sorting is cheap, and the overlap tests are the main cost. Storing the sorted order, but no pairs, saves only the
# sorting.
#
# ![Overlap tests and time of the broad phase against the number of boxes](../docs/charts/broad_phase.png)
#
# <details><summary>How to read the chart</summary>
#
# The solid lines in the left chart count tests, the dotted line the pairs that remain. For the dashed line, all
# boxes move by 1 % of their size. To restore the sorted order you swap neighbours; the line counts the swaps. The right
# chart shows measured times, also MuJoCo's. The exponents in the labels are fits. The cards give slightly different
# ones, because they fit another range of $N$.
#
# </details>
# %%
more_claims(
    "aabb_listing_two_axes", "aabb_six_numbers", "sweep_and_prune_n_log_n", "pile_of_a_hundred"
)
# %% [markdown]
# ### Narrow phase: distance, depth and normal
#
# The **contact solver** is the part of the simulator that computes the contact forces. It needs three things for each
# pair: how far apart or how deep the bodies are, in which direction to push, and where. The **signed distance** is
# positive while the bodies are apart. When they overlap it is negative, and its size is the **penetration** depth: the
# length of the shortest move that separates them. The **contact normal** is a unit vector that points from the first
# body to the second. If they overlap, it is the direction in which the second body has to move.
#
# For two circles this is one line: the distance of the centres minus both radii. For boxes and **meshes** (surfaces
# made of triangles), every combination of corners, edges and faces would need its own formula. One idea covers all
# **convex** shapes, those that contain the straight line between any two of their points.
#
# Subtract every point of shape $B$ from every point of shape $A$. The resulting set is the **Minkowski difference**
# $A \ominus B$. The set contains the origin exactly if some point of $A$ equals some point of $B$, that is, if the
# shapes share a point. If they are apart, the distance from the origin to the set equals the distance of the shapes.
# **GJK**, the algorithm of Gilbert, Johnson and Keerthi (1988), computes this distance, or finds that
# the origin is inside.
#
# A **support function** returns the point of a convex shape that lies farthest in a given direction; for a box it is a
# corner. The Minkowski difference has a support function too: the support point of $A$ in the direction $s$ minus the
# support point of $B$ in the direction $-s$.
# %%
show("gjk_minkowski")
# %% [markdown]
# GJK needs nothing but the support function. It stores a **simplex**: a point, an edge, a triangle or, in space, a
# tetrahedron of support points of the Minkowski difference. It starts with one support point, in any direction, and
# repeats:
#
# 1. Find the point $c$ of the simplex that is nearest to the origin. If $c$ is the origin, the shapes overlap: stop.
# 2. Find the smallest part of the simplex that contains $c$: a corner, an edge or a face. Keep its corners and drop the
#    others.
# 3. Compute the support point $w$ in the direction $-c$, which points from $c$ to the origin.
# 4. If $w$ lies no farther in that direction than $c$, stop. No point of the set is nearer to the origin, so the
#    shapes are apart by $\lVert c\rVert$, and the normal is $-c/\lVert c\rVert$. Otherwise add $w$ to the simplex.
#
# The new point $w$ may be farther from the origin than $c$. It helps nevertheless, because the line from $c$ to $w$
# passes nearer to the origin.
#
# For overlapping shapes, **EPA**, the expanding polytope algorithm, continues from GJK's simplex. If that is not yet
# a triangle (in space, a tetrahedron) around the origin, EPA adds support points until it is. It takes the face
# nearest to the origin (in the plane, the edge) and computes the support point in the direction of its outward
# normal. It removes every face that has this point on its outer side. That leaves a hole, and new faces join its rim
# to the point.
#
# When the support point already lies on the nearest face, EPA stops: the distance of that face from the origin is the
# depth, and its normal is the contact normal. Step through both:
# %%
simulation("simplex")
# %% [markdown]
# EPA finds the *shortest* way out. Is that always the way the body came in, which a solver should use? Think of a ball
# that is pressed deeper and deeper into a thin wall, and of a box that stands on a table.
# %%
show("epa_gives_the_contact")
# %% [markdown]
# In code, all of this is one call. A shape in this course is a **core and a radius**: all points that are at most the
# radius away from the core. A sphere is a point with a radius. A **capsule**, a rod with round ends, is a segment
# with a radius. GJK and EPA work on the cores, and both radii are subtracted from the cores' signed distance. A core
# is a **polytope**: a point, a segment, a polygon or a solid with flat faces. It has finitely many corners, so in
# exact arithmetic both algorithms end.
# %% tags=["show-code"]
triangle = contact.points([[0.0, 1.0, 0.3], [0.0, 0.2, 0.9]])
brick = contact.box([0.5, 0.3])  # half sides [m]
for pose in ((0.95, 0.45, 0.5), (1.95, 0.45, 0.5)):  # x [m], y [m], angle [rad]
    result = contact.distance(triangle, [0.0, 0.0, 0.0], brick, pose)
    print(
        f"signed distance {float(result.distance):7.4f} m, normal {result.normal.round(3)}, "
        f"iterations: {result.iterations}"
    )
# %% [markdown]
# <details><summary>An independent check: separating axes</summary>
#
# An independent check is the **separating axis** test. Two solid convex polytopes are apart exactly if their
# projections onto one of a few axes are apart. The axes are the face normals of both and, in space, the cross
# products of an edge of one and an edge of the other.
#
# </details>
#
# ### Contact points, and shapes that are not convex
#
# A box on a table touches it with a whole face. With a single contact point it would tip or rock. So the solver needs
# a **manifold**, a set of points that spans the touching area. The narrow phase takes the two touching faces and clips
# them: it cuts off the part of one that sticks out beyond the other. Each corner of the polygon that remains becomes a
# contact point.
#
# GJK sees a shape only through its support function, and that function cannot see a hollow. GJK works on the
# **convex hull** of a shape, the smallest convex shape around it. For GJK, a mug is solid.
# A **convex decomposition** cuts such a shape into convex pieces before the simulation starts. The number of pieces
# is a compromise between speed and accuracy.
# %%
show("concave_mesh_is_its_hull")
# %%
more_claims("circle_test_concentric", "mug_and_its_hull")
# %% [markdown]
# ### Tunnelling: what happens between two steps
#
# A simulator checks for overlap once per step. A ball of radius $r$ at speed $v$ moves by $v\,h$ in a step of length
# $h$. If that is more than $2r + w$, the ball can be in front of a wall of thickness $w$ at one check and behind it at
# the next. This is **tunnelling**.
#
# With a soft contact, one that lets bodies overlap, there is a second way through.
# While the ball is in the wall, a spring pushes it along the shortest way out. Once its centre has passed the middle of
# the wall, away from the edges, the shortest way out leads to the far side, and the spring pushes the ball through.
# %%
predict("smaller_step_at_a_wall")
# %% [markdown]
# Press *Play*. The blue ball uses the penalty method. The orange one uses a constraint that looks ahead by one step:
# %%
simulation("touch", "Tunnelling")
# %% [markdown]
# A shorter step raises the speed at which the first kind of tunnelling begins. Computing the **time of impact**, the
# moment at which two moving shapes first touch, removes it. For two balls at constant speed that is the root of a
# quadratic. For other convex shapes there is **conservative advancement** (Mirtich 1996). The shapes cannot meet sooner
# than their distance divided by an upper bound on their approach speed. So advance time by that much, measure the
# distance again, and repeat until the distance is within a tolerance.
#
# The second kind hardly depends on the step, as long as the step is short compared with the contact's **time
# constant**, roughly the time in which a soft contact pushes bodies apart (section 2 defines it). You need a stiffer
# contact, a thicker wall, or a contact that remembers from which side the ball came.
#
# ![The lowest speed at which a ball passes a wall, against the step](../docs/charts/tunnelling_limit.png)
#
# <details><summary>How to read the chart</summary>
#
# The chart shows the lowest speed at which the ball passes. If overlap is *checked once a step*, that speed lies at
# the geometric limit $(2r+w)/h$, the sloping line. The dotted line is the predicted speed at which the ball gets past
# the middle of the wall. We tried a list of speeds. With *MuJoCo, default*, the ball passes at the first or second
# speed above this line, at every step. *MuJoCo, speculative* creates the contact one step before touch (a
# **speculative** contact), which helps only at long steps. A ball that is *advanced to the impact* never passed. (A
# triangle at the top says that no tested speed passed.)
#
# </details>
# %%
more_claims("circles_once_a_step", "soft_wall")
# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** The narrow phase sees only pairs whose bounding boxes overlap, and (without a time of impact) only at
# one moment. GJK, and MuJoCo with its meshes, see only the convex hull of a shape.
#
# </div>
# %% [markdown]
# ## 2 · Concept: contact forces
#
# ### A spring for a contact: the penalty method
#
# The simplest contact force is a spring that pushes bodies apart where they overlap, and a damper next to it. The
# **normal force** $f_n$ acts along the contact normal. With the depth $\delta$, the stiffness $k$, the damping $b$
# and the normal velocity $u_n$ (positive while the bodies separate) it is
#
# $$\boxed{\; f_n = \max(0,\; k\,\delta - b\,u_n) \ \text{ where } \delta > 0, \text{ else } 0 \;}$$
#
# You evaluate the formula and integrate. But a body at rest always overlaps. Its weight $mg$ needs the depth
# $\delta = mg/k$: 1 kg on 10 kN/m sinks by 0.98 mm.
#
# Here a mass falls on such a contact. The left plot shows the force against the depth. On the way in, spring and
# damper both push; on the way out, the damper works against the spring. The area of the loop is the energy that the
# damper takes:
# %%
simulation("penalty_spring")
# %% [markdown]
# Look at the $\max$. While the bodies separate, $u_n$ is positive, and the damper's part pulls them *together*. As long
# as spring plus damper is a push, nothing is wrong. If the sum is a pull, the $\max$ sets it to zero.
#
# How strong is a damper? A spring $k$ with a mass $m$ oscillates at the angular frequency $\omega = \sqrt{k/m}$, and
# the **damping ratio** is $\zeta = b/(2m\omega)$. Below 1, the mass swings past the position where the spring is
# relaxed. (In a contact, that is where the bodies just touch.) At 1 (**critical damping**) and above, a mass released
# at rest only approaches it.
#
# In the next simulation the $\max$ is switched off and a hand lifts the blue box out of an overlap. (For the orange
# box the constraint removes the overlap at once.) Watch the force plot:
# %%
simulation("touch", "Pull-back", still=0.1)
# %%
show("damping_makes_things_stick")
# %% [markdown]
# **Friction** is the force along the surface. It resists sliding, and it is at most $\mu$ times the normal force;
# $\mu$ is the **friction coefficient**, which may be larger than 1. At rest, Coulomb's law gives no value for it,
# only this limit. The penalty method needs a value, so it uses a formula. In the simplest one, friction grows in
# proportion to the sliding velocity $u_t$ and reaches its full size at a **slip speed** $v_s$ that you choose:
#
# $$f_t = -\mu f_n\,\frac{u_t}{\max(\lvert u_t\rvert,\, v_s)}.$$
#
# This is called **regularised friction**. At rest it is zero. To hold anything it needs some sliding, which is why the
# blue box at the top of this page creeps: to resist 60 % of $\mu f_n$, it slides at 60 % of the slip speed for as long
# as the pull lasts. (A spring along the surface holds a load without sliding; Cundall and Strack 1979.)
#
# ### How large a step a stiff spring allows
#
# Things sink too deep, so you increase the stiffness. Then the simulation explodes. An integrator that computes the
# force before the step is stable only while its steps are shorter than a share of the period of the spring's
# oscillation, $2\pi/\omega$.
# %%
predict("hundred_times_stiffer")
# %% [markdown]
# The readout *ω h* is the step in units of $1/\omega$. Shorten the step until the blue box no longer bounces, and
# note *ω h*. (This contact has no damper. A damper between box and hand brings the box to rest.)
# %%
simulation("touch", "Explosion")
# %% [markdown]
# The table shows the largest stable step. The damper acts on the velocity from *before* the step, as in the formula
# for $f_n$ above:
#
# | scheme | without damping | with this damper |
# |---|---|---|
# | explicit Euler | none is stable | $h\omega < 2\zeta$ for $\zeta\le1$ |
# | semi-implicit Euler | $h\omega < 2$ | $h\omega < 2(\sqrt{1+\zeta^2}-\zeta)$ |
#
# <details><summary>A worked example: a gripper pad</summary>
#
# A gripper pad of 100 kN/m holds a part of 1 kg. $\omega = \sqrt{100\,000/1} = 316$ rad/s, so semi-implicit Euler is
# stable below $2/316 = 6.3$ ms. With critical damping, $\zeta = 1$, the limit is $0.83/316 = 2.6$ ms.
#
# </details>
#
# The limit assumes that the bodies stay in touch. A body that bounces can gain energy even at a step below the limit,
# unless something else takes it, such as the hand's damper above. So in practice use a tenth of the limit.
#
# <details><summary>Derive it: three tasks with hints and solution</summary>
#
# (1) A mass on a spring, without a damper: below which step is each Euler scheme stable? (2) How many milliseconds is
# that for 100 kN/m and 1 kg? (3) What does a damper change, for each scheme?
#
# <details><summary>Hint 1: write a step as a matrix</summary>
#
# A step is a linear map of $(x, v)$. For semi-implicit Euler, first $v' = v - h\omega^2x$, then $x' = x + hv'$.
#
# </details>
# <details><summary>Hint 2: what does stable mean for a matrix?</summary>
#
# No eigenvalue lies outside the unit circle. The product of the two eigenvalues is the determinant, their sum is the
# trace.
#
# </details>
# <details><summary>Hint 3: where do they leave the circle?</summary>
#
# For semi-implicit Euler at $-1$: set $1 + \text{trace} + \det = 0$. For explicit Euler the determinant exceeds 1
# first.
#
# </details>
# <details><summary>Full solution</summary>
#
# *Explicit Euler.* Without a damper the eigenvalues are $1 \pm i\omega h$. They lie outside the circle for every
# step, so no step is stable. With a damper the determinant is $1 - 2\zeta\omega h + (\omega h)^2$, which is below 1
# for $\omega h < 2\zeta$. Above critical damping the larger real eigenvalue decides: $\omega h < 2(\zeta -
# \sqrt{\zeta^2-1})$.
#
# *Semi-implicit Euler.* The determinant is $1 - 2\zeta\omega h$ and the trace $2 - 2\zeta\omega h - (\omega h)^2$.
# Then $1 + \text{trace} + \det = 4 - 4\zeta\omega h - (\omega h)^2$, which is zero at $\omega h =
# 2(\sqrt{1+\zeta^2} - \zeta)$; without a damper at 2.
#
# A damper that acts on the velocity *after* the step has the opposite effect: the limit of semi-implicit Euler rises to
# $h\omega < 2(\sqrt{1+\zeta^2}+\zeta)$. MuJoCo treats the damping of joints like this.
#
# **Key insight.** Damping from the old velocity helps explicit Euler up to $\zeta = 1$, and it always hurts
# semi-implicit Euler.
#
# </details>
# </details>
#
# Practise: <span class="kernel-only">Change the formula after "Your answer" until the check accepts
# it.</span>
# %%
answer("semi_implicit_limit", "sqrt(m/k)")
# %%
answer("contact_limit_explicit", "1000*sqrt(1/100000)")
# %%
answer("semi_implicit_damped_limit", "2/omega")
# %% [markdown]
# For the next chart a mass at rest on the contact is pushed a little. Where the chart is orange, its displacement
# grows from step to step; where it is purple, the displacement shrinks. The measured limit lies on the dashed
# formula. With explicit Euler, damping raises the limit up to $\zeta = 1$ and lowers it beyond. The lower panel is
# MuJoCo's soft contact; a fold-out below returns to it.
#
# ![Largest step of a penalty contact against damping, measured and in theory](../docs/charts/contact_penalty_limit.png)
# %%
more_claims(
    "penalty_law_has_a_plus",
    "penalty_is_a_step",
    "damper_damps",
    "friction_has_a_step_limit",
    "steel_stiffness",
)
# %% [markdown]
# ### Complementarity: the law of a rigid contact
#
# Put a mug on a table. The table pushes up exactly as hard as needed, whatever the mug weighs, and lets go at once
# when you lift it. What does a *rigid* contact demand of the force $f$ and the gap $\phi$ (the signed distance)?
#
# 1. The bodies do not overlap: $\phi \ge 0$.
# 2. The contact only pushes: $f \ge 0$.
# 3. There is no force at a distance: if $\phi > 0$, then $f = 0$.
#
# Together these are the **Signorini** conditions. Two numbers are **complementary** if both are non-negative and at
# least one of them is zero. The relation is called **complementarity**:
#
# $$\boxed{\; f \ge 0, \qquad \phi \ge 0, \qquad f\,\phi = 0 \;}$$
#
# All three conditions fit in one line, $0 \le f \perp \phi \ge 0$, where $\perp$ says that the product is zero.
#
# Plot the force against the gap. The allowed points are the upper half of the vertical axis and the right half of the
# horizontal axis. Try to drag the orange point off them:
# %%
simulation("half_axes")
# %% [markdown]
# Look at the vertical half axis. A law that allows a set of values instead of one is **set-valued**.
# %%
show("contact_law_is_set_valued")
# %% [markdown]
# What are force and gap in the corner of the picture?
# %%
show("one_of_force_and_gap_is_zero")
# %% [markdown]
# **Derive the complementarity constraint.** (1) Why must all three conditions hold? (2) Derive them from a
# minimum of the energy. (3) Why is the law not smooth?
#
# <details><summary>Hint 1: what is minimised?</summary>
#
# Not $f\phi$, which is no energy. In a stable rest without friction, a body minimises its own potential $V(q)$ among
# the positions that are allowed.
#
# </details>
# <details><summary>Hint 2: how do you minimise under an inequality?</summary>
#
# With a multiplier: $L = V(q) - f\,\phi(q)$. Say $\partial L/\partial q = 0$ in words.
#
# </details>
# <details><summary>Hint 3: count the values.</summary>
#
# How many values may $f$ have at $\phi = 0$? Can you write it as a function of $\phi$?
#
# </details>
# <details><summary>Full solution</summary>
#
# (1) and (2): Minimise $V(q)$ subject to $\phi(q) \ge 0$. The conditions of Karush, Kuhn and Tucker are
# $\nabla V = f\,\nabla\phi$, $f \ge 0$, $\phi \ge 0$ and $f\phi = 0$. The first says that the contact force balances
# the other forces, along the normal. The sign of $f$ says that entering the other body would lower $V$, so something
# has to push back. The product says that a constraint that is not active has no force.
#
# (3) The allowed pairs form two half axes with a corner. At $\phi = 0$ every $f \ge 0$ is allowed, so the force is
# not a function of the gap. Velocities jump at impacts. A standard integrator expects a smooth right-hand side and
# has nothing to evaluate; a time-stepping method asks for the impulse of the whole step instead.
#
# **Key insight.** The contact force is the multiplier of the constraint "do not overlap". It is found together with
# the motion, not before it.
#
# </details>
# %%
answer("potential_of_contact", "k*c")
# %% [markdown]
# ### From the Jacobian to the Delassus matrix
#
# Now solve for a contact force. Impacts make velocities jump, so forces can be infinite for an instant. Most simulators
# of rigid contact therefore compute **impulses**, force times time, for one step of length $h$. Four ingredients are
# needed:
#
# * $M$, the mass matrix, and $v$, the velocity of all bodies stacked into one vector;
# * $v_f$, the **free velocity**: what $v$ would be after the step if there were no contact;
# * $J$, the **contact Jacobian**: it turns $v$ into the contact velocities $u = J\,v$;
# * $p$, the impulses at the contacts. $J^{\mathsf T}$ turns them into impulses on the bodies, so they change the
#   velocity by $M^{-1}J^{\mathsf T}p$.
#
# Insert the new velocity $v_f + M^{-1}J^{\mathsf T}p$ into $u = J\,v$:
#
# $$u = J v_f + A\,p, \qquad \boxed{\;A = J M^{-1} J^{\mathsf T}\;}\qquad 0 \le p_n \perp u_n + \phi/h \ge 0 .$$
#
# $A$ is the **Delassus** matrix. Each row of $J$ is one direction at one contact. Entry $A_{ij}$ is the velocity in
# row $i$ that a unit impulse in row $j$ causes, and $1/A_{ii}$ is the mass that you feel when you push in that
# direction. The last condition is Signorini's for one step: the gap after the step, $\phi + h\,u_n$, must not be
# negative. (If bodies overlap already, this would remove the whole overlap in one step.)
# %% [markdown]
# <details><summary>A first worked example: one block</summary>
#
# A block of 1 kg lies on the floor. It can move along $x$ and $z$, so $v = (v_x, v_z)$
# and $M$ is the identity (in kg). The step is 10 ms. The contact has a normal row (velocity along $z$) and a
# tangential row (along $x$):
#
# $$J = \begin{pmatrix} 0 & 1\\ 1 & 0\end{pmatrix},\qquad A = J M^{-1} J^{\mathsf T} = \begin{pmatrix} 1 & 0\\ 0 &
# 1\end{pmatrix}\,\tfrac{1}{\text{kg}} ,\qquad
# v_f = \begin{pmatrix} 0\\ -0.0981\end{pmatrix}\,\tfrac{\text{m}}{\text{s}} .$$
#
# Without contact the block would fall at 9.81 m/s² · 10 ms = 0.0981 m/s. The gap is 0, so the normal condition is
# $0 \le p_n \perp p_n - 0.0981 \ge 0$, and $p_n = 0.0981$ N s. Divided by the step that is 9.81 N: the weight.
#
# </details>
#
# %% [markdown]
# **Worked example: a stack of two.** A block of 2 kg lies on top of the block of 1 kg. We look at vertical motion
# only: $v = (v_1, v_2)$, lower block first. Contact 1 is between floor and lower block, contact 2 between the blocks.
# A contact's velocity is that of the upper body minus that of the lower one:
#
# $$J = \begin{pmatrix} 1 & 0\\ -1 & 1\end{pmatrix},\quad M = \begin{pmatrix} 1 & 0\\ 0 & 2\end{pmatrix},\quad
# A = \begin{pmatrix} 1 & -1\\ -1 & 1.5\end{pmatrix},\quad J v_f = \begin{pmatrix} -0.0981\\ 0\end{pmatrix}.$$
# %% tags=["hide-code"]
import matplotlib.pyplot as plt

figure_, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
left.plot([-1.4, 1.4], [0, 0], color="0.3", lw=3)
for low, mass, colour in ((0.0, "1 kg", "tab:blue"), (1.0, "2 kg", "tab:orange")):
    left.add_patch(plt.Rectangle((-0.6, low + 0.06), 1.2, 0.88, color=colour, alpha=0.3))
    left.text(0.0, low + 0.5, mass, ha="center", va="center")
for x, start, end, text in (
    (-0.85, 0.0, 0.6, "$p_1$ on the lower block"),
    (0.85, 1.0, 1.6, "$p_2$ on the upper block"),
    (0.85, 1.0, 0.4, "$-p_2$ on the lower block"),
):
    left.annotate(
        "", (x, end), (x, start), arrowprops={"arrowstyle": "-|>", "color": "0.2", "lw": 2}
    )
    side = {"ha": "right", "x": x - 0.1} if x < 0 else {"ha": "left", "x": x + 0.1}
    left.text(y=0.5 * (start + end), s=text, va="center", **side)
left.set(xlim=(-2.9, 2.9), ylim=(-0.1, 2.2), title="the impulses at the two contacts")
left.axis("off")
delassus = scenes.tower([1.0, 2.0]).problem(dt=0.01).delassus
right.imshow(delassus, cmap="RdBu_r", vmin=-2, vmax=2)
for (row, column), value in np.ndenumerate(delassus):
    right.text(column, row, f"{value:g}", ha="center", va="center", fontsize=14)
right.set_xticks([0, 1], ["impulse 1", "impulse 2"])
right.set_yticks([0, 1], ["velocity 1", "velocity 2"])
right.set(title="Delassus matrix $A$ [1/kg]")
plt.show()
# %% [markdown]
# Each entry of $A$ has a plain meaning. A unit impulse at contact 1 lifts the lower block at 1 m/s, which opens contact
# 1 ($A_{11} = 1$) and closes contact 2 ($A_{21} = -1$). A unit impulse at contact 2 moves the blocks apart at $1 + 1/2$
# m/s ($A_{22} = 1.5$). If both contacts stay closed, $A p = -J v_f$. The second row says $p_1 = 1.5\,p_2$, and the
# first gives $p_2 = 0.1962$ and $p_1 = 0.2943$ N s: the weights of 2 kg and of 3 kg, times the step. The package
# agrees:
# %% tags=["show-code"]
step = scenes.tower([1.0, 2.0]).problem(dt=0.01)  # masses [kg], the lowest first
print("J =", step.rows.tolist())
print("A =", step.delassus.tolist(), "1/kg")
print("J v_f =", (step.rows @ step.free).round(4).tolist(), "m/s")
print("p =", solve("lcp", step).impulses[:, 0].round(4).tolist(), "N s")
# %% [markdown]
# The general task is called an **LCP**, a linear complementarity problem: given $A$ and $q$ (here $q = J v_f +
# \phi/h$), find $p \ge 0$ with $Ap + q \ge 0$ and $p \perp Ap + q$. The equations are linear. The hard part is to
# find out which contacts are open. A bounce, called **restitution**, fits in as well: after the step the bodies
# separate at $e\,s$ or faster, where $s$ was their closing speed before. For a contact that touches, replace the
# condition by $0 \le p_n \perp u_n - e\,s \ge 0$, with a coefficient $e$ between 0 (no bounce) and 1.
#
# Practise with one body. It touches the floor and moves downwards, so $v < 0$:
# %%
answer("velocity_lcp_without_gap", "-m*a")
# %% [markdown]
# Two blocks had one solution. What about a table with four legs?
# %%
predict("legs_of_a_table")
# %% tags=["hide-code"]
legs = {
    "exact pyramid (LCP)": "solved by pivots",
    "true cone (Newton)": "solved by Newton's method",
    "penalty": "springs under the legs",
    "MuJoCo Newton": "soft contact (MuJoCo)",
}
stored = {line[9:42].strip(): line[42:] for line in read("contact_table").splitlines()[-20:]}
print("force in each leg, in turn around the table [N]")
for name, how in legs.items():
    print(f"{how:<26}{stored[name]}")
# %% [markdown]
# *Pivots* and *Newton's method*, both explained below, solve the rigid law. Many sets of leg forces satisfy the law.
# Here Newton's method ends at the one with the smallest sum of squared forces, and equal springs give the same.
# %%
more_claims(
    "potential_of_contact",
    "never_both_positive",
    "velocity_lcp_without_gap",
    "contact_velocity_jumps",
    "contact_is_an_lcp",
)
# %% [markdown]
# ### Coulomb friction: the cone
#
# Push a heavy crate sideways, harder and harder. At first the floor pushes back exactly as hard as you do. Once you
# push harder than the floor can, the crate moves.
#
# **Coulomb's law** limits the friction force to $\mu$ times the normal force, and says where it points:
#
# $$\boxed{\;\lVert f_t\rVert \le \mu f_n, \qquad \text{and while the contact slides:}\quad
# f_t = -\mu f_n \frac{u_t}{\lVert u_t\rVert}\;}$$
#
# In three dimensions, all the forces that the inequality allows fill a cone around the normal, the **friction cone**.
# A larger $\mu$ makes it wider. Drag the pull and watch the tip of the contact force:
# %%
simulation("friction_cone")
# %% [markdown]
# While the block sticks, the law allows every force inside the cone or on it. Only the balance with the pull decides
# which one it is. There is no formula to evaluate, so the force has to be solved for. That is what makes contact
# harder than a spring.
#
# <details><summary>A worked example: a box of 3 kg</summary>
#
# A box of 3 kg lies on a floor with $\mu = 0.4$. The normal force is its weight, 29.4 N, so
# friction can resist up to $0.4 \cdot 29.4 = 11.8$ N. Pull with 8 N: friction is 8 N and nothing moves. Pull with 20
# N: friction is 11.8 N, and the box accelerates at $(20 - 11.8)/3 = 2.7$ m/s².
#
# </details>
#
# Here the penalty box and the constraint box are pulled harder than the cone allows. While they slide, both forces lie
# on the edge of the cone. Near the hand the pull gets weaker, the orange box stops (the blue one creeps on), and both
# forces move inside:
# %%
simulation("touch", "Slip", still=0.15)
# %% [markdown]
# A round cone (*true cone* in the charts) is not linear, so the step is no longer an LCP. The traditional way out is a
# **pyramid**: its four edges lie on the cone, along $x$ and $y$, and its faces are flat. The allowed forces are all
# sums of four vectors along the edges with non-negative weights. Seen from above, the circle of radius $\mu f_n$ has
# become a square that stands on its corner.
#
# Two things follow. A block that sticks is held less well: between two corners the square lies inside the circle, and
# at 45 degrees it allows only $1/\sqrt 2$ of the force. A block that slides is braked in another direction. Coulomb's
# law picks, of all allowed forces, the one that brakes most, and a solver with a pyramid does the same. In the
# circle, that force points straight against the motion. In the square, it is the corner nearest to that direction: of
# full size, but along $x$ or $y$. At exactly 45 degrees it lies between two corners and is weaker.
# %%
predict("braking_between_edges")
# %% [markdown]
# Drag the direction in which the block is pushed off, and compare where it stops. The blue circle shows where blocks
# stop with the cone, the orange square where they stop with the pyramid. They touch along the axes, where the pyramid
# is right:
# %%
simulation("stopping_distance")
# %% [markdown]
# A pyramid can also stand *around* the cone. You get it if you clamp each friction component to $\pm\mu f_n$ on its
# own, and it is up to 41 % too strong. The chart calls it *box of limits*, and shows it next to the inner pyramid and
# MuJoCo's two options, *pyramidal* (its default) and *elliptic* (the round cone):
#
# ![Stopping distance and direction of a braking block, with cone and pyramids](../docs/charts/contact_steering.png)
# %%
more_claims("below_the_limit_sticks", "pyramid_slips", "box_of_limits", "default_friction")
# %% [markdown]
# ### Solving it: projected Gauss-Seidel
#
# An engine has a millisecond to find the impulses of a hundred contacts. Projected **Gauss-Seidel** (PGS) does it one
# contact at a time, always with the latest impulses of all the others. The velocity of row $i$ is $u_i = (J v_f)_i +
# \sum_j A_{ij}\,p_j$; in a normal row with an open gap, add $\phi/h$. At each contact:
#
# 1. Normal: change the impulse so that $u_n$ would vanish, and project it: $p_n \leftarrow \max(0,\; p_n -
#    u_n/A_{nn})$.
# 2. Tangents: compute both velocities again, and change both impulses against them, $p_t \leftarrow p_t - u_t/a$. Use
#    one number $a$ for both rows. The larger eigenvalue of their $2\times2$ block of $A$ is a safe choice.
# 3. Project: if the vector $p_t$ is longer than $\mu p_n$, shorten it to that length.
#
# When the sweeps have converged, another sweep changes nothing: at a sliding contact, shortening $p_t - u_t/a$ gives
# $p_t$ again. So the part that is cut off, $-u_t/a$, has the direction of $p_t$: friction points straight against the
# sliding velocity. If each row were divided by its own
# $A_{ii}$, and these differed, friction would point elsewhere.
#
# One pass over all contacts is a **sweep**. Game engines do four to ten sweeps per step and start from the impulses of
# the step before (**warm start**). In code, without friction:
# %% tags=["show-code"]
A, b = step.delassus, step.rows @ step.free  # the stack of two from above
p = np.zeros(2)
for sweep in range(1, 9):
    for i in range(2):
        velocity = A[i] @ p + b[i]
        p[i] = max(0.0, p[i] - velocity / A[i, i])
    if sweep in (1, 2, 4, 8):
        print(f"after sweep {sweep}: p = {p.round(4)} N s  (solution 0.2943, 0.1962)")
# %% [markdown]
# In the first sweep, contact 1 stops the lower block as if nothing lay on it: $p_1 = 0.0981$. Now the lower
# block stands still and the upper one still falls, so contact 2 gets $p_2 = 0.0981/1.5 = 0.0654$. That pushes the lower
# block down again, and contact 1 can correct this only in the next sweep. In this stack the error shrinks by a factor
# of $2/3$ per sweep. The simulation starts with a mass ratio of 4. Set it to 2 to see the numbers above:
# %%
simulation("sweeps")
# %% [markdown]
# Each contact is solved as if its neighbours were already right. When is that a bad assumption? The lower contact has
# to carry both weights, and it learns of the upper one only through the motion of the lower block.
# %%
predict("heavy_on_light")
# %% [markdown]
# The number of sweeps from zero grows in proportion to the mass ratio if the ratio is large, for two bodies
# and for a tower. For a tower of equal boxes it grows with the square of the number of boxes:
#
# ![Sweeps against the mass ratio and against the height of a tower](../docs/charts/contact_sweeps.png)
#
# **Lemke's algorithm** solves the pyramid's LCP exactly. It guesses which contacts open, stick or slide (and in which
# direction), and changes one guess at a time (a *pivot*) until all conditions hold.
#
# <details><summary>Does it always find a solution?</summary>
#
# In exact arithmetic Lemke's algorithm ends with a solution if no bodies overlap and none bounces (Anitescu and Potra
# 1997). Otherwise there may be none, as for a body wedged between two walls, both of which should push it out. Then it
# reports that.
#
# </details>
#
# For the round cone, Coulomb's law can be written as one equation (De Saxcé and Feng 1998):
#
# $$p = \operatorname{proj}(p - \rho\,\tilde u)$$
#
# Here $\tilde u$ is the contact velocity with $\mu\lVert u_t\rVert$ added to its normal part. The factor $\rho$ is any
# positive number, in kg, so that $\rho\,\tilde u$ is an impulse, and proj goes to the nearest point of the cone: step
# away from $p$, go back to the cone, and you are at $p$ again (the fold-out shows why). The left side minus the right
# side is the **natural map**, and Newton's method searches for its zero.
#
# <details><summary>Why this is Coulomb's law: three cases</summary>
#
# If $p$ lies inside the cone, the step must change nothing: $\tilde u = 0$, so the contact sticks. If $p$ lies on the
# surface, either $\tilde u = 0$ and the contact just sticks, or $\tilde u$ is perpendicular to the surface. Then
# $u_t$ points straight against $p_t$, and $\tilde u_n = \mu\lVert u_t\rVert$; the added term is exactly this, so
# $u_n = 0$. If $p = 0$, it stays zero for $\tilde u_n \ge \mu\lVert u_t\rVert$, which says $u_n \ge 0$: the contact
# opens.
#
# </details>
#
# Each iteration solves a linear system. On this chapter's stacks a few are enough. Elsewhere it may need more, or fail.
#
# How far did a solver get in one step of 2 ms? The **residual** is the largest violation of the contact law, as a
# velocity.
# %% tags=["hide-code"]
pile = scenes.tower([1.0, 100.0]).problem(0.002)
labels = {"pgs": "Gauss-Seidel", "lcp": "Lemke", "coulomb": "Newton on the cone"}
for name, options in (
    ("pgs", {"sweeps": 10}),
    ("pgs", {"sweeps": 1000}),
    ("lcp", {}),
    ("coulomb", {}),
):
    line = solve(name, pile, **options)
    state = "solved" if line.residual < 1e-9 else f"residual {line.residual:.0e} m/s"
    print(f"100 kg on 1 kg, {labels[name]:<18} iterations {line.iterations:4d}: {state}")
# %%
more_claims("iterations_50_to_100")
# %% [markdown]
# ### Removing penetration: Baumgarte, split impulses, ERP and CFM, sub-steps
#
# Sooner or later bodies overlap: a solver stopped early, a robot was placed badly, a mesh was too coarse. A velocity
# constraint $u_n \ge 0$ does not remove an overlap. So engines add a correction.
#
# **Baumgarte stabilisation** asks for a separating velocity that removes a share $\beta$ of the depth $\delta$ in one
# step: $u_n \ge \beta\,\delta/h$. In this course $\beta$ is called `recovery` and is 0.2. Look at the $h$ in the
# denominator. A ball that starts 1 cm deep must leave at $0.2 \cdot 0.01 / h$. What does a shorter step do to that
# speed?
# %% tags=["hide-code"]
print("a ball that starts 10 mm deep, at rest: its speed after one step [m/s]")
print(f"{'step':>8} {'Baumgarte':>11} {'bounded':>9} {'split impulse':>15}")
deep = scenes.ball_drop(-0.01)
for dt in (1e-2, 1e-3, 1e-4):
    one = deep.problem(dt)
    free = solve("lcp", replace(one, max_recovery_speed=math.inf)).velocity[0]
    bounded = solve("lcp", one).velocity[0]
    ((_, v),) = split_impulse_steps(deep, dt, 1, model="lcp")
    print(f"{1e3 * dt:5.1f} ms {free:11.2f} {bounded:9.2f} {v[0]:15.2f}")
# %% [markdown]
# Ten times shorter steps eject the ball ten times as fast. So "just reduce the step" can make things worse, and
# engines bound (cap) this speed. Here the bound, `max_recovery_speed`, is 1 m/s. MuJoCo's soft
# contact (purple) pushes it out at a low speed that depends little on the step:
#
# ![How fast a ball that starts 1 cm deep leaves the ground, against the step](../docs/charts/contact_recovery.png)
#
# **Split impulse** avoids the ejection altogether. It solves for the velocity without any correction. A second solve
# finds a **pseudo-velocity** that removes the share $\beta$ of the depth. It is used for one
# position update and then deleted, so it never becomes kinetic energy. After $n$ steps the depth is
# $(1-\beta)^n\,\delta$.
#
# **ERP and CFM** come from the Open Dynamics Engine (ODE). **ERP** (error reduction parameter) is the share
# $\beta$. **CFM** (constraint force mixing) makes the contact yield: the condition becomes $u_n + \text{CFM}\,f =
# \text{ERP}\,\delta/h$. Since $f = p/h$, that adds CFM$/h$ to the diagonal of $A$. Choose
#
# $$\text{ERP} = \frac{hk}{hk + b}, \qquad \text{CFM} = \frac{1}{hk + b}.$$
#
# Then the force is $f = k\,(\delta - h\,u_n) - b\,u_n$: a spring $k$ that acts on the depth at the end of the step,
# and a damper $b$. This pair is stable at every step, while the contact stays closed and the solver converges.
# At another step, the same spring needs other values:
# %% tags=["hide-code"]
for dt in (1e-2, 1e-3):
    erp, cfm = erp_cfm(1e4, 100.0, dt)
    print(
        f"10 kN/m and 100 N s/m at a step of {1e3 * dt:4.0f} ms: ERP {erp:.3f}, CFM {cfm:.4f} m/(N s)"
    )
# %% [markdown]
# **Sub-stepping** spends the work differently: instead of $n$ sweeps in one step, do one sweep in each of $n$ shorter
# steps. Macklin and colleagues (2019) found that this usually works better: the position error of a sub-step is
# proportional to the square of its length, so at half the length, with twice as many sub-steps, half of the error
# remains. The **TGS** (temporal Gauss-Seidel) of the engine PhysX works like this.
#
# So does the sub-stepped form of **XPBD** (extended position-based dynamics). XPBD predicts the positions, moves them
# out of the overlaps contact by contact, and takes the velocity from the change of position. Each
# line visits every contact equally often:
# %% tags=["hide-code"]
heavy = scenes.tower([1.0, 100.0])
print("100 kg on 1 kg for 0.5 s, XPBD: deepest penetration")
for substeps, iterations in ((1, 20), (4, 5), (20, 1)):
    run = xpbd_steps(heavy, 1e-2, 50, substeps=substeps, iterations=iterations)
    depth = max(-(heavy.jacobian[:, 0] @ q).min() for q, _ in run)
    print(f"sub-steps {substeps:2d}, sweeps in each {iterations:2d}: {1e3 * depth:6.2f} mm")
# %% [markdown]
# Five of these corrections on one scene: a ball of 1 kg at rest, 1 cm deep in the ground, at a step of 1 ms:
# %% tags=["hide-code"]
dt, steps = 1e-3, 120
times, deep = 1e3 * dt * np.arange(steps + 1), scenes.ball_drop(-0.01)
q, v, spring = deep.q, deep.v, [deep.q[0]]
for _ in range(steps):
    v = solve_erp_cfm(deep.problem(dt, q, v), *erp_cfm(1e4, 200.0, dt)).velocity
    q = q + dt * v
    spring.append(q[0])
heights = {
    "Baumgarte, speed not bounded": scenes.run(
        replace(deep, max_recovery_speed=math.inf), "lcp", dt, steps
    ).q[0],
    "Baumgarte, at most 1 m/s": scenes.run(deep, "lcp", dt, steps).q[0],
    "split impulse": [
        deep.q[0],
        *(q[0] for q, _ in split_impulse_steps(deep, dt, steps, model="lcp")),
    ],
    "ERP and CFM of 10 kN/m, 200 N s/m": spring,
    "XPBD": [deep.q[0], *(q[0] for q, _ in xpbd_steps(deep, dt, steps))],
}
figure_, axes = plt.subplots(figsize=(8, 3.4), layout="constrained")
inks = ("tab:red", "tab:purple", "tab:green", "tab:brown", "tab:blue")
for (name, height), ink in zip(heights.items(), inks, strict=True):
    _ = axes.plot(times, 1e3 * np.array(height), color=ink, label=name)
_ = axes.axhline(0.0, color="0.3", lw=1)
_ = axes.set(xlabel="time [ms]", ylabel="height above the ground [mm]", ylim=(-12, 60))
_ = axes.legend(loc="center right")
plt.show()
print("highest point within 0.12 s [mm]:")
for name, height in heights.items():
    print(f"{name:<34} {round(1e3 * max(height), 1) + 0.0:6.1f}")
# %% [markdown]
# Baumgarte's correction throws the ball into the air, and even the bound of 1 m/s is enough for a few centimetres. XPBD
# throws it fastest, at $\delta/h$. The split impulse and the critically damped spring bring it up without throwing it.
# The spring leaves it at its resting depth $mg/k$, 1 mm below the ground.
#
# <details><summary>Why XPBD throws the ball, and why sub-steps make it worse</summary>
#
# XPBD moves the ball out of the whole overlap $\delta$ in the first step and then takes the velocity from this move:
# $\delta/h$, five times Baumgarte's $0.2\,\delta/h$. A sub-step is a shorter $h$, so twenty sub-steps throw the ball
# twenty times as fast. Sub-steps help against errors that arise during the motion, as in the stack above, and not
# against a deep start. Bound the speed here too, or give the contact a compliance (one over a stiffness).
#
# </details>
#
# <details><summary>How well-known engines do it (sources read in November 2026)</summary>
#
# | engine | solver | penetration and softness | source |
# |---|---|---|---|
# | Bullet 3 | PGS on impulses, 10 sweeps, warm start | Baumgarte with a share of 0.2; split impulse beyond 4 cm | `btContactSolverInfo.h` |
# | ODE | LCP by pivots (`dWorldStep`) or sweeps (`dWorldQuickStep`) | ERP 0.2, CFM 1e-10 (double precision); speed bound optional | ODE manual, World |
# | PhysX 5 | PGS, or TGS, whose iterations are sub-steps; Isaac Lab, a framework for robot learning, chooses TGS | speed bound per body (`setMaxDepenetrationVelocity`) | `PxSceneDesc.h`, `PxImmediateMode.h`; Isaac Lab, PhysX configuration |
# | Box2D 3 | sweeps in sub-steps, usually 4 | contact spring of 30 Hz and damping ratio 10; at most 3 m/s | `types.c`; Catto, *Solver2D*, 2024 |
# | MuJoCo 4 | convex, on accelerations: Newton, CG (conjugate gradients) or PGS | a spring and damper per contact, explained below | MuJoCo documentation, Computation |
# | Drake | convex, on velocities, with its solver SAP (section 9) | compliant point contact, or hydroelastic contact (section 9) | `multibody_plant_config.h`; Castro et al. 2022 |
#
# </details>
#
# ### Friction made convex
#
# Coulomb's law has an awkward property: the size of friction depends on a normal force that is itself unknown.
# So the contact forces do not minimise a convex function, and several solutions can exist. A
# strictly convex function, a bowl without flat parts, has at most one minimum, and there are reliable methods to find
# it.
#
# The **convex relaxation** (Anitescu 2006) changes the law slightly: a contact that slides must also separate, at
# $u_n = \mu\,\lVert u_t\rVert$ or faster. Then the step is a minimisation. For closed contacts, those with gap zero:
#
# $$\text{minimise}\quad \tfrac12\,(v - v_f)^{\mathsf T} M\,(v - v_f) \qquad\text{so that}\qquad
# u_n \ge \mu\,\lVert u_t\rVert \text{ at every contact.}$$
#
# So the new velocity is the allowed one nearest to $v_f$, if distance is weighted with the masses. At the minimum, a
# contact that carries a force and slides has exactly $u_n = \mu\,\lVert u_t\rVert$. The problem is strictly convex, so
# $v$ is unique. The impulses need not be: the four legs of a table can share the load in many ways.
# %%
predict("block_that_hops")
# %% [markdown]
# MuJoCo's contact model belongs to this family. It adds a compliance $R > 0$ to every contact, which the next part
# explains. What does that do to the four legs?
# %%
show("mujoco_is_convex_and_unique")
# %% [markdown]
# ### MuJoCo's soft contact: solref, solimp, impratio, condim
#
# In MuJoCo, a contact has one or several **rows**. With elliptic cones there is a normal row and one per direction of
# friction. With a pyramid, each row is a push along one of its edges: the normal plus or minus $\mu$ times one
# direction of friction.
#
# Each row asks for a reference acceleration $a_{\text{ref}}$, that of a spring and a damper. The row's real
# acceleration $a$ falls short of it by $R f$, where $f$ is the row's force: $a = a_{\text{ref}} - R f$. A large
# **compliance** $R$ means a soft contact. With the row's velocity $u$ and its position error $r$ (the gap for a normal
# row, always 0 for friction), as long as the force lies inside the cone:
#
# $$a_{\text{ref}} = -b\,u - k\,d\,r, \qquad f = \frac{a_{\text{ref}} - a}{R}, \qquad
# R = \frac{1-d}{d}\,\hat A .$$
#
# Otherwise the contact slides (force on the cone) or opens (no force). $\hat A$ estimates the row's entry on the
# diagonal of $A$. MuJoCo computes it once, from the masses in the start position. The **impedance** $d$ lies between 0
# and 1. It blends two accelerations: for a row on its own, $a = (1-d)\,a_0 + d\,a_{\text{ref}}$, where $a_0$ is the
# acceleration without contact. At $d = 0$ there is no contact. At $d = 1$ the row would follow the reference; MuJoCo
# limits $d$ to 0.9999. The parameters:
#
# * **solref** = (time constant $T$, damping ratio $\zeta$) sets $k = 1/(d_1 T \zeta)^2$ and $b = 2/(d_1 T)$, where
#   $d_1$ is the largest $d$. The default (0.02 s, 1) gives a critically damped spring that settles in about a tenth
#   of a second. MuJoCo raises $T$ to at least two steps, so a shorter $T$ needs a shorter step.
# * **solimp** = (d at touch, d at full depth, width, midpoint, power) sets $d$ as a function of the depth. The width
#   is the depth from which $d$ no longer rises. Midpoint and power shape the S-curve in between. By default $d$ rises
#   from 0.9 to 0.95 over the first millimetre.
# * **impratio** divides $R$ in the friction rows of an elliptic cone. Above 1, friction yields less than the normal
#   direction. (With pyramids there are no separate friction rows, and the manual advises against large values.)
# * **condim** is the number of forces and torques of the contact: 1 is the normal force alone, 3 adds two forces of
#   sliding friction, 4 adds a torque against spinning, 6 adds two torques against rolling.
#
# Drag the impedance curve or change solref, and watch how a body of 1 kg lands and rests:
# %%
simulation("soft_contact")
# %% [markdown]
# The course's own implementation, `course.contact.soft`, consists of these formulas, the exact curve of solimp and both
# kinds of cone. In the next cell MuJoCo simulates a box that slides on four corners. At selected steps the cell passes
# the state and MuJoCo's own $\hat A$ to the course's implementation, and compares all contact forces. MuJoCo's solver
# runs here with the tolerance zero; with the default tolerance its forces have fewer correct digits:
# %% tags=["show-code"]
for cone in ("elliptic", "pyramidal"):
    options = Options(cone=cone, tolerance=0.0)
    runner, worst, largest = mujoco_contact.box(options, (0.5, 0.2)), 0.0, 0.0
    for steps in range(1, 200, 10):
        runner.run(steps)
        state = contact_state(runner)
        if state is not None:
            force = soft_forces(state.problem, options.softness(state.weight))[0]
            worst = max(worst, np.abs(force - state.force).max())
            largest = max(largest, np.abs(state.force).max())
    print(f"{cone}: difference below 1e-10 of the largest force:", worst < 1e-10 * largest)
# %% [markdown]
# Back to condim. A disc spins on one point at 10 rad/s. Sliding friction cannot brake it, because the point does not
# slide. The cell prints what remains after 0.6 s:
# %% tags=["hide-code"]
for condim in (1, 3, 4, 6):
    spun = Options(condim=condim, friction=(0.5, 0.01, 0.0001))
    remaining = mujoco_contact.spinning_disc(spun, 10.0).run(300)[1][3]
    print(f"condim {condim}: {abs(remaining):5.2f} rad/s")
# %%
show("condim_4_is_the_full_cone")
# %% [markdown]
# <details><summary>How large a step MuJoCo's contact allows: refsafe</summary>
#
# MuJoCo's spring, like any spring whose force is evaluated before the step, has a largest stable step. With solref,
# $\omega = 1/(\zeta T)$, so the limit of the step for one contact is $2\zeta T(\sqrt{1+\zeta^2}-\zeta)$. The flag
# *refsafe*, on by default, raises $T$ to at least two steps. This makes stiff settings softer than you asked for.
#
# Is $T = 2h$ enough? Set it in the limit above and solve for $\zeta$: a single contact is stable if $\zeta > 1/\sqrt 8
# \approx 0.35$. The lower panel of the chart of step limits shows it: left of the dotted ratio, the same steps
# fail with refsafe and without; right of it, refsafe keeps a single contact stable at every step. Bodies that touch at
# several points, or whose impedance is low, need more damping. At the default, $\zeta = 1$, and an impedance of 0.9 or
# more, all scenes of this chapter are stable.
#
# </details>
#
# ### Creep and sinking: the price of softness
#
# Two fingers hold a glass. In MuJoCo it slides down, slowly and for ever, although friction is twice what is needed.
# A friction row has a damper ($-b\,u$) and no spring, since there is no position for it to return to. A damper gives
# a force only while it moves. This slow sliding of a contact that should stick is called **creep**.
# %%
predict("glass_that_creeps")
# %% [markdown]
# A block on a slope of 0.2 rad with $\mu = 0.5$ creeps as well, faster on a steeper slope. The course's model
# and MuJoCo creep at the same speed, and impratio divides it. (`noslip_iterations` adds sweeps that remove it.)
# %% tags=["hide-code"]
for label, changed in (
    ("elliptic", {"cone": "elliptic"}),
    ("elliptic, impratio 10", {"cone": "elliptic", "impratio": 10.0}),
    ("pyramidal (default)", {"cone": "pyramidal"}),
):
    ours = scenes.run(scenes.block(0.2, 0.5), "soft", 0.002, 500, **changed).v[0, -1]
    queried = Options(0.002, friction=(0.5, 0.005, 0.0001), **changed)
    theirs = mujoco_contact.block(queried, 0.2).run(500)[1][0]
    print(f"{label:<22} {1e3 * ours:7.4f} mm/s, in MuJoCo {1e3 * theirs:7.4f} mm/s")
# %% [markdown]
# The compliance $R$ has a second consequence. It is proportional to $\hat A$, which for a body on the ground is about
# one over its mass. So all single bodies with the same contact points sink about equally deep under their own weight.
# Put a heavy body on a light one, and the soft contact below the light body has to carry both: it sinks into the
# ground.
# %%
show("heavy_on_light_sinks")
# %% [markdown]
# By default both effects are large. A smaller time constant, a harder solimp and a larger impratio reduce them a
# great deal (section 6).
# %%
more_claims(
    "default_tolerance",
    "condim_1_is_frictionless",
    "refsafe_keeps_it_stable",
    "more_friction_holds_the_glass",
    "tower_sags",
)
# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Every contact model gives something up.
#
# * Penalty, evaluated before the step: bodies overlap, and the step has a limit.
# * Pyramid: friction has the wrong size or direction between the edges.
# * Convex cone: the gap opens while a contact slides.
# * Soft contact without a spring along the surface: a body that should stick creeps.
# * Coulomb's law itself: section 7 shows its price.
#
# </div>
#
# ### Gradients through contact
#
# A finger moves towards a block for a fixed time. You want to learn its speed by gradient descent, so you
# differentiate the simulation. At one speed, called *touch* in the chart, the finger just reaches the block. There
# the block's final position, plotted against the speed, has a kink, so its derivative jumps. Above it, the position
# rises smoothly.
# %%
predict("push_that_starts_too_slow")
# %% [markdown]
# ![Derivatives through a contact, computed in four ways, and the truth](../docs/charts/contact_gradients.png)
#
# Before touch, only *randomised* and *interior point* see the block, and both are biased.
#
# <details><summary>Two remedies, and what they cost</summary>
#
# Two remedies give a derivative before touch. **Randomised smoothing** averages over runs with noise on the parameter
# and needs only function values. Its points scatter, since each is an estimate. An
# **interior-point** relaxation lets force times gap be a small number instead of zero, so that a little force acts at a
# distance.
#
# Both pay with a bias: they spread the jump of the derivative over a range of speeds. The interior point is strongly
# relaxed in this chart, so its derivative is too large at high speeds. The penalty's final position jumps at some
# speeds. There its derivative is huge and leaves the chart; between the jumps it is too large.
#
# </details>
#
# In the right panel a ball flies at a wall and bounces off without loss. The horizontal axis is its initial distance,
# the vertical one its position after 1 s: 0 at the wall, negative in front of it. A ball that starts farther away
# bounces later, so its true position rises with the distance. If a simulator applies the bounce only at the end of a
# step, the computed position jumps as the distance changes, and between the jumps it falls: its derivative has the
# wrong sign. Compare a gradient with finite differences, for several changes of the parameter.
# %%
more_claims("contact_gradients_vanish", "penalty_is_differentiable")
# %% [markdown]
# ## 3 · Design: contact in the simulation loop
#
# All of the above runs once per physics step:
# %% tags=["hide-code"]
figure_, axes = plt.subplots(figsize=(9, 1.5), layout="constrained")
stages = ("broad phase", "filters", "narrow phase", "constraints", "solver", "integration")
passed = ("boxes", "pairs", "pairs", "contacts", "$A$, $J v_f$", "impulses", "new state")
box = {"boxstyle": "round,pad=0.4", "fc": "#cfe3f2", "ec": "0.3"}
for k, stage in enumerate(stages):
    _ = axes.text(2.0 * k, 0.0, stage, ha="center", va="center", bbox=box, fontsize=9)
for k, text in enumerate(passed):
    at = 2.0 * k - 1.0
    arrow = {"arrowstyle": "-|>", "color": "0.3"}
    _ = axes.annotate("", (at + 0.22, 0.0), (at - 0.22, 0.0), arrowprops=arrow)
    _ = axes.text(at, 0.55, text, ha="center", fontsize=8)
_ = axes.set(xlim=(-1.4, 11.4), ylim=(-0.7, 0.9))
_ = axes.axis("off")
plt.show()
# %% [markdown]
# | stage | input | output | cost |
# |---|---|---|---|
# | broad phase | bounding boxes, the sorted order of the last step | pairs whose boxes overlap | grows faster than $N$; use a grid for many equal bodies |
# | filters | pairs | pairs that may collide (no parent and child; no *sleeping* bodies, which rest and are skipped) | almost none |
# | narrow phase | shapes and poses | points, normals, depths | little for spheres, far more for polytopes and meshes |
# | constraints | contacts, $M$, $v$, $h$ | $J$, $A$, target velocities | grows with the contacts; each **island**, a group of bodies in contact, is solved on its own |
# | solver | $A$, $J v_f$, cones, impulses of the last step | impulses and a residual | sweeps, or Newton iterations that factor a matrix |
# | integration | impulses | new state | almost none |
#
# <details><summary>Four decisions that are made in this loop</summary>
#
# Four decisions are made here:
#
# 1. **Shapes.** Collide **primitives** (spheres, capsules, boxes) and a few convex pieces, not the meshes that are
#    drawn.
# 2. **Level.** Solve for impulses and velocities, or for forces and accelerations? At the velocity level a rigid
#    contact stops an impact of any speed within the step, so its force grows as $1/h$. At the acceleration level an
#    impact is spread over the contact's time constant.
# 3. **Order.** Process contacts in a fixed order. Otherwise two runs with the same number of sweeps differ.
# 4. **Memory.** Match contacts to those of the last step, so that the solver can start warm.
#
# </details>
#
# How do you judge a contact solver that is not your own? Five numbers need only the step itself ($J$, velocities, gaps,
# $\mu$) and the solver's impulses: **penetration** after the step; the violation of **Signorini's** conditions; how far
# friction lies outside its **cone**; the missing **dissipation**, the most energy that friction could have taken at
# the final velocity minus what it took; and **energy** that appeared from nowhere.
#
# The cell prints three of them for one step of a
# block that slides between two edges of the pyramid (1 kg, $\mu = 0.5$, velocity (0.6, 0.8) m/s, a step of 10 ms). The
# models are `lcp` (pyramid, pivots), `pgs` (cone, sweeps), `coulomb` (cone, Newton) and `convex`:
# %% tags=["hide-code"]
sliding = scenes.block(0.0, 0.5, (0.6, 0.8)).problem(0.01)
print(f"{'model':<9} {'Signorini':>14} {'outside cone':>14} {'not dissipated':>16}")
for model in ("lcp", "pgs", "coulomb", "convex"):
    r = contact.residuals(sliding, solve(model, sliding).impulses)
    print(f"{model:<9} {r.signorini:10.3f} m/s {r.cone:10.3f} N s {1e3 * r.dissipation:13.1f} mJ")
# %% [markdown]
# The pyramid dissipates too little. The convex model violates Signorini, because the block hops. The round cone does
# neither, by sweeps or with Newton's method.
# %%
more_claims("mujoco_is_velocity_level")
# %% [markdown]
# ## 4 · Code: the reference functions
#
# Three functions are typical interview questions. First, the overlap of two axis-aligned boxes, in any
# dimension:
# %% tags=["hide-code"]
source(broad.aabb_overlap)
# %% [markdown]
# How many times does brute force call it for `n` bodies?
# %%
answer("brute_force_pairs", "n^2")
# %%
more_claims("brute_force_pairs")
# %% [markdown]
# Second, the contact of two circles, an exercise in section 8. Third, the penalty force with regularised friction. The
# switch `pull` allows the damper to pull:
# %% tags=["hide-code"]
source(penalty_force)
# %% [markdown]
# A `Problem` describes one step: masses, Jacobian, velocities, gaps and friction. `solve` returns the
# impulses with one of six models (`lcp`, `pgs`, `coulomb`, `convex`, `penalty`, and `soft`, MuJoCo's soft contact) and
# reports whether it solved the problem. A block that brakes from 1 m/s with $\mu = 0.5$ should stop after $v^2/(2\mu g)
# = 0.1019$ m. The second column shows by how much the block leaves the ground on the way. (For `soft` this depends on
# the step.)
# %% tags=["show-code"]
braking = scenes.block(angle=0.0, friction=0.5, velocity=(1.0, 0.0))
for model in contact.MODELS:
    path = scenes.run(braking, model, dt=0.001, steps=300)
    print(f"{model:<8} stops after {path.q[0, -1]:.4f} m, rises {1e3 * path.q[2].max():.3f} mm")
# %% [markdown]
# ## 5 · The simulation in full
#
# The same spring connects both boxes to the hand; only the contact differs. Readouts with two numbers are the penalty's
# and the constraint's; only *normal* shows the $x$ and $y$ of one vector. Drag the hand, or move it with the arrow
# keys. Before you choose a preset, predict:
#
# 1. *Stick*: which of the two boxes moves, and how fast?
# 2. *Explosion*: below which step does the penalty box come to rest? Compare *ω h* with the limit of section 2.
# 3. Raise the stiffness from 3,000 to 50,000 N/m. What happens to the depth, and to the largest stable step?
#
# <details><summary>Answers</summary>
#
# (1) The blue one. At first it slides at the slip speed times the pull's share of $\mu f_n$; near the hand the pull
# fades, and so does the speed. (2) Once $\omega h$ is below about 1.9. For a contact without any damper the limit is 2;
# the hand's damper, which acts on the velocity before the step, lowers it a little. It also takes the energy of the
# bounces. (3) The depth, about $mg/k$ (the hand's spring carries a little), falls
# to a seventeenth; the largest stable step, proportional to $1/\sqrt k$, to a quarter.
#
# </details>

# %%
simulation("touch", "Stick")
# %% [markdown]
# ## 6 · Speed against accuracy
#
# We compare the models on four scenes; the last table adds a fifth. *Where is a braking block after 0.24 s* (tolerance
# 2 mm), if it is pushed off at 22.5° to the $x$ axis, between the edges of the pyramid? *How far does a block slide*
# down a slope (tolerance 1 mm)? *How deep does a light body sink* under a heavy one (1 mm)? *How far does a held glass
# slip* (1 mm)? The fifth: *how deep do the four legs of a table sink* (1 mm)?
#
# A **work-precision diagram** plots the error against the cost, one point per *setting*, here the step in s. Down and
# to the left is better. The cost is *steps and iterations*, all steps plus all iterations of the solver, or computing
# time. A cross at the upper edge is a failed run; ignore its horizontal position. A circle marks the *pick*, the
# cheapest run within the tolerance (dotted). *Discrete* is a MuJoCo integrator that is implicit in positions and
# velocities. Drag the tolerance and switch methods on:
# %% tags=["hide-code"]
from course.simulations.trade_off import TradeOff

STEPS = (2e-2, 1e-2, 5e-3, 2e-3, 1e-3)
measured = charts.work_precision("braking", STEPS, repeats=1)
print("error of the position after 0.24 s, at a step of 1 ms:")
for name in ("true cone (Newton)", "exact pyramid (LCP)", "MuJoCo Newton, elliptic"):
    curve = next(curve for curve in measured.curves if curve.name == name)
    print(f"{name:<24} {1e3 * curve.points[-1].error:6.2f} mm")
TradeOff(measured)
# %% [markdown]
# Put your own contact model on the chart: it gets a `Problem` and returns impulses. This one clamps each friction
# component alone:
# %% tags=["show-code"]
from course.measure.work_precision import Method, Result


def my_model(problem):
    """Return normal and friction impulses of a single contact, shape (1, 3)."""
    u = problem.jacobian @ problem.free
    normal = max(0.0, -u[0, 0] / problem.delassus[0, 0])
    largest = problem.friction[0] * normal
    friction = np.clip(-u[0, 1:] / np.diag(problem.delassus)[1:], -largest, largest)
    return np.array([[normal, *friction]])


# %% tags=["hide-code"]
def once(dt):
    """Return the position of the braking block after 0.24 s, stepped with it."""
    requested, steps = charts.QUESTIONS["braking"], round(charts.DURATION / dt)
    h, q, v = charts.DURATION / steps, requested.scene.q, requested.scene.v
    for _ in range(steps):
        step = requested.scene.problem(h, q, v)
        v = step.after(my_model(step))
        q = q + h * v
    return Result(requested.answer(q), steps)


once(1e-3)  # an error here would only show as a failed run on the chart
mine = measured.with_method(Method("yours", once, STEPS, "yours"), repeats=1)
print(f"error of yours at 1 ms: {1e3 * mine.curves[-1].points[-1].error:.1f} mm")
TradeOff(mine)
# %% [markdown]
# A light body under a heavy one, 0.24 s after the heavy one was set down. MuJoCo's default softness is wrong by
# centimetres at every step, with 100 kg on 1 kg. (They still move, and are deeper than in section 2's card, where they
# rest.) A **hardened** contact (solref of 4 ms, solimp near 1, impratio 100) is within the tolerance.
# The penalty method fails at long steps. At short ones its error is $mg/k$, the depth at which its spring carries both
# masses. (The smaller error at its longest stable step is a coincidence: the light body still jitters.)
#
# ![How deep a light body sinks under a heavy one, error against cost](../docs/charts/contact_heavy.png)
#
# A held glass, with a quarter more friction than it needs. By default it creeps in MuJoCo. The speed does not depend on
# the step until the step exceeds half the time constant; then MuJoCo softens the contact. Hardened, it creeps too, but
# stays within the tolerance except at the longest steps.
#
# ![How far a held glass slips, error against cost](../docs/charts/contact_glass.png)
#
# <details><summary>The block that slides down a slope: all models agree</summary>
#
# ![How far a block slides, error against cost](../docs/charts/contact_incline.png)
#
# (The dip of the hardened contact, where the circle marks the pick, is a coincidence: at steps next to it the error is
# far larger.)
#
# </details>
#
# ### All models on all scenes
#
# All models take steps of 2 ms; *good* means an error within the scene's tolerance, *FAILS* one above 0.3 m. The
# *compiled loop* is the course's sweep, compiled and started warm. Compare times only among compiled programs (MuJoCo,
# the compiled loop), or only among the course's other models, in NumPy.
# %% tags=["hide-code"]
rows = [line for line in read("contact_table").splitlines() if line[:8].strip() in charts.QUESTIONS]
retained = (
    "penalty",
    "exact",
    "true cone (N",
    "sweeps, comp",
    "MuJoCo Newton, elliptic ",
    "MuJoCo Newton, hard",
)
figures(
    read("contact_table"),
    "scene",
    *(row for row in rows if row[9:].startswith(retained) and row[:5] == "heavy"),
    summary="All models and scenes, with the time of a step",
)
# %% tags=["hide-code"]
print("\n".join(line for line in read("contact_table").splitlines() if line in charts.SENTENCES))
# %% [markdown]
# The penalty's stiffness is chosen for the tolerance of each scene. Where $\omega h$ of the lightest body gets too
# large, the run fails. Started warm, the compiled loop needs about 30 sweeps per step.
#
# <details><summary>What the columns for time and iterations count</summary>
#
# The time is a run's time divided by its steps, the median of several warm runs. Iterations are the mean
# per step.
#
# </details>
#
# <details><summary>The narrow phase compared with Coal</summary>
#
# Coal is the collision library that Pinocchio uses. The bars show Coal's processor time divided by that of the course,
# which answers 1,000 pairs in one compiled call. Coal has the tolerances of GJK and EPA at 1e-12 and its poses set
# before the clock starts. It is timed in one call for all pairs through Pinocchio, and in one call per pair from
# Python.
#
# A bar that ends left of the dotted line means that Coal is faster. In one call for all it is faster wherever the
# shapes are apart. It is also faster for overlapping spheres and capsules, and for a sphere in a box. For all other
# overlapping shapes it takes up to three times as long as the course. The lower chart compares error and time for two
# boxes whose faces are aligned, almost aligned (turned by 1e-8 rad), or turned at random. *Points* means the convex
# hull of a few points:
#
# ![Narrow phase: time compared with Coal, and error](../docs/charts/narrow_phase.png)
#
# </details>
# %%
more_claims("coal_is_the_truth")
# %% [markdown]
# ### What to pick
#
# The scenes above support the advice on small stacks and compliant contacts; the rest is our opinion.
#
# * **A robot arm:** a soft convex model such as MuJoCo's. It has one answer and is fast here. Use the
#   elliptic cone; raise impratio where things are held, and harden solref or solimp where a heavy body rests on a light
#   one.
# * **Learning in thousands of worlds:** measure the throughput; this chapter does not.
# * **Small stacks, exact standstill, large mass ratios without tuning:** the rigid law, solved with Newton's method or
#   pivots. Sweeps are fine if they converge: a warm start helps, and so do low stacks with light bodies on
#   top.
# * **A few compliant contacts, no very light body, no solver at hand:** a penalty, with a step well below the limits of
#   spring and friction, and a depth you accept.
# * **Games:** one sweep in each of several sub-steps, or ten sweeps with a warm start if mass ratios are small.
#
# One argument for constraints is their larger stable step. Compare them with an explicit penalty:
# %%
show("constraints_take_larger_steps")
# %% [markdown]
# ## 7 · Debug: when contact goes wrong
#
# ### When no contact force exists
#
# Push a piece of chalk across a blackboard with its end ahead of your hand. It chatters and squeaks. Rigid bodies
# with Coulomb friction do something stranger.
# %%
predict("chalk_on_the_board")
# %% [markdown]
# This is **Painlevé**'s rod (1895), here at an angle $\theta$ to the ground. A normal force at the end brings friction
# $\mu f_n$ with it. Friction turns the rod so that its end moves *into* the ground. Above $\mu = (1 +
# 3\cos^2\theta)/(3\sin\theta\cos\theta)$ this turning is faster than the lifting by the normal force. More force makes
# it worse, so for a rod that is not rotating yet, no finite force holds the end out.
#
# A time-stepping method still returns an answer: an impulse that does not shrink with the step. The rod's end stops at
# once, although nothing collided; its centre moves on. Compare one step of 1 ms with one of 1 µs, at 60 degrees:
# %% tags=["hide-code"]
angle = np.radians(60.0)
limit = (1.0 + 3.0 * np.cos(angle) ** 2) / (3.0 * np.sin(angle) * np.cos(angle))
print(f"the limit at 60 degrees: mu = {limit:.3f}")
for mu in (1.0, 2.0):
    rod = scenes.rod(angle, mu)
    steps = [(rod.problem(dt), solve("coulomb", rod.problem(dt))) for dt in (1e-3, 1e-6)]
    one, other = (after.impulses[0, 0] for _, after in steps)
    end, centre = abs((steps[1][0].jacobian @ steps[1][1].velocity)[0, 1]), steps[1][1].velocity[0]
    print(f"mu {mu:.0f}: normal impulse {one:.1e} N s in a step of 1 ms, {other:.1e} in 1 us")
    print(f"      after 1 us the end slides at {end:.2f} m/s, the centre at {centre:.2f} m/s")
# %% [markdown]
# Below the limit the impulse is proportional to the step, as for a force. Above it, both steps return nearly the same
# impulse.
#
# ### Debugging table
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *Objects stick together.* Log the normal force while they should separate. If it is negative, a
# damper is pulling: clip the force at zero. If it stays positive although the overlap does not shrink, something
# presses them together: adhesion that somebody set, or a second contact. If it is zero, something else holds them: a
# joint, a weld, a controller, or friction that was computed from an old or wrong normal force.
#
# </div>
#
# You will often read that you should enlarge `nconmax` and `njmax`, MuJoCo's former sizes of memory for contacts and
# constraint rows, when contacts stick:
# %%
show("nconmax_helps")
# %% [markdown]
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *A grasped object slips.* For each contact, print the sliding speed of the point, and friction over
# the limit of your solver's cone: $\lVert f_t\rVert/(\mu f_n)$, or $(\lvert f_x\rvert + \lvert f_y\rvert)/(\mu f_n)$
# for a pyramid, MuJoCo's default. A point that moves at a ratio of 1 slides: squeeze more, raise the friction, or
# replace a pyramid by a cone. One that moves below 1 creeps: in MuJoCo use elliptic cones and raise impratio, or
# shorten the time constant. If the points stand still, the object turns about them: spread the contacts, or use
# condim 4. If it moves in jerks, contacts come and go: look at the manifold.
#
# </div>
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The simulation is slow with many objects.* Count before you measure time: overlap tests, pairs
# that remain, contacts, iterations. Too many tests: a sweep along the wrong axis. Too many pairs: boxes that are too
# large. Too many contacts: meshes instead of spheres and boxes. Too many iterations: mass ratios.
#
# </div>
#
# | symptom | likely cause | test | fix |
# |---|---|---|---|
# | a body is thrown off when it touches | $\omega h$ near or above the limit, or a deep start that is removed in one step | print $\omega h$, the first depth and the ejection speed | $\omega h$: a shorter step or a softer contact. Deep start: bounded recovery speed or split impulse (here a shorter step ejects faster) |
# | deep overlap at rest | soft spring, heavy body on a light one, too few sweeps | print the residual; swap the masses | Newton's method; sub-steps; harder solref and solimp |
# | a block curves while it brakes | friction pyramid | push it off in several directions | elliptic cone |
# | rattling on a mesh or an edge | the normal flips; one point instead of a manifold | draw the normals over time | manifold; rounded edges (a radius) |
# | passes a wall at any step | soft contact pushed past the middle | compare depth with wall thickness | stiffer contact, thicker wall |
# | every run differs | contacts in another order, threads, a random generator without a seed | hash the state at each step | sort the pairs; fix threads and seed |
# | NaN now and then | concentric centres, a degenerate simplex | place two centres at one point | handle that case separately |
# %%
more_claims("mujoco_timer")
# %% [markdown]
# ## 8 · Exercises
#
# Each exercise has a card with the task and three hints, a cell to change, and a check on new random cases that reports
# errors and often their cause. In a terminal, run `drills start aabb` and `drills check aabb`.
#
# ### Two axis-aligned boxes
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
# ### Two circles
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
# The quadratic is easy to write down. Its textbook formula loses digits when the balls are far apart.
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
# ### A Gauss-Seidel sweep with friction
#
# A variant of the sweep of section 2. Here the three impulses of a contact are projected onto the cone *together*, onto
# its nearest point.
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
# ### Silent-bug hunt: a block on a slope
#
# Nothing crashes, the motion looks plausible, and one thing is wrong.
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
# ### Heavy boxes on light ones
#
# Gauss-Seidel needs thousands of sweeps here. Design a better solver.
# %%
card("solve_stack")


# %%
def solve_stack(product, diagonal, b, mu, layer):
    """Return impulses at the contacts of a stack that obey Coulomb's law.

    Args:
        product: product(x) is A x, shape (2 n,); product(x, rows) is only those rows of it.
        diagonal: of A, the Delassus matrix, shape (2 n,) [1/kg].
        b: velocity at the contacts without impulses, shape (2 n,): for each contact the normal,
            then the tangential component [m/s].
        mu: coefficient of friction of each contact, shape (n,).
        layer: number of the box that rests on each contact, 0 for the lowest box, shape (n,).

    Returns:
        Impulses, shape (n, 2): normal and tangential [N s].
    """
    # Two sweeps of projected Gauss-Seidel, in the order in which the contacts come.
    impulses = np.zeros((len(mu), 2))
    for _ in range(2):
        for i in range(len(mu)):
            rows = [2 * i, 2 * i + 1]
            u = product(impulses.ravel(), rows) + np.asarray(b, dtype=float)[rows]
            normal, tangent = impulses[i] - u / np.asarray(diagonal, dtype=float)[rows]
            normal = max(normal, 0.0)
            impulses[i] = normal, np.clip(tangent, -mu[i] * normal, mu[i] * normal)
    return impulses


# %%
check(solve_stack)
# %% [markdown]
# ### A formula
#
# Two fingers press a glass of mass `m` from both sides, each with the force `F`:
# %%
answer("more_friction_holds_the_glass", "m*g/F")
# %% [markdown]
# ## 9 · Frontier: contact that can be differentiated, learned, trusted
#
# | work | source | idea |
# |---|---|---|
# | SAP, in Drake | Castro, Permenter and Han 2022 | compliant contact as an unconstrained convex problem |
# | hydroelastic contact | Elandt et al. 2019; Masterjohn et al. 2022 | pressure fields inside the bodies; the force changes continuously with the pose |
# | incremental potential contact | Li et al. 2020 | a barrier on the distance: nothing ever passes, steps can be large, each is a nonlinear solve |
# | Dojo | Howell et al. 2022 | rigid contact with an interior-point method; gradients of the softened problem |
# | smoothing for planning | Suh et al. 2022; Pang et al. 2023 | what randomised and analytic smoothing have in common; plans through contact |
# | ContactNets | Pfrommer, Halm and Posa 2020 | shape and friction learned from tosses, with complementarity inside the loss |
# | comparison of models | Le Lidec et al. 2024 | which engine relaxes which law, and what that does |
#
# Can gradient descent learn to push? The finger should move the block to a mark at 5 cm, and the first guess for its
# speed is too slow to reach the block. With the rigid gradient nothing ever changes; with the randomised one,
# averaged over noisy speeds, it gets there:
# %% tags=["hide-code"]


def descended(how):
    """Return the speed of the finger after 40 steps down the slope, and where the block stops."""
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
    return speed, charts.pushed(speed, "rigid", 2e-2)


hows = ("rigid", "randomised")
for how, (speed, reached) in zip(
    hows, from_record("contact.descended", descended, hows), strict=True
):
    print(f"{how:<11} finger at {speed:.2f} m/s, block at {1e3 * reached:.0f} mm (mark: 50 mm)")
# %% [markdown]
# <details><summary>Common statements that nothing here checks, and why</summary>
#
# *There are two approaches to contact*, penalty and constraint: section 2 has six models, and MuJoCo's soft contact
# is a bit of both. *Real engines use constraints*: that would be a count of engines, not an experiment; Drake's
# continuous point contact is a penalty. *Rubber on plastic has 0.8 to 1.2*: this is a property of two surfaces, their
# load and their speed. Tilt your own pair until it slides.
#
# *V-HACD, a tool for convex decomposition, gives 3 to 8 pieces*: that number is a parameter, and it depends on the
# mesh. *Hydroelastic contact
# replaces hard contact by smooth pressure*: its authors say so; Drake is not run here, and it offers point contact as
# well. *Contact solvers are PGS and ADMM*: Pinocchio ships one of each. ADMM is not part of this chapter, because it
# solves the problem that Newton's method solves here; Newton, CG and pivots are missing from that list.
#
# </details>
#
# ## 10 · Interview
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** *Penalty or constraint?* First ask what the contact has to do. "A penalty is a spring: nothing to
# solve. But bodies sink in, regularised friction creeps, and integrated explicitly it has a step limit. Once solved, a
# constraint overlaps only by drift, and sticks without creep up to the limit of its cone. It has no step
# limit, but removing a deep overlap needs a bounded speed. It needs a solver: Gauss-Seidel is slow for heavy
# on light, Newton is not. MuJoCo is in between: its relaxed cone makes the problem convex, its softness makes the
# forces unique, and it creeps; impratio and solref reduce that."
#
# </div>
#
# Answer aloud before you open an answer.
# %%
interview("contact")
# %% [markdown]
# ### Checkpoint
#
# Five questions on this chapter, drawn by a seed.
# %%
checkpoint("contact", ["", "", "", "", ""], seed=1)
