# %% [markdown]
# # 5 · Motion planning
#
# *A robot has to get from the green start to the yellow goal without touching anything red. Answer the question below
# first; the wall in it returns in section 2. Then press* Plan. About {open minutes} minutes of reading, cards and
# charts. The folded parts add {folded minutes} minutes, the exercises {exercise minutes} minutes. The interview in
# section 10 is not counted.

# %%
from course.cards import predict
from course.simulations import simulation

predict("unseen_wall")

# %% [markdown]
# ![A planner among obstacles that you place](attachment:planning.growing.png)

# %%
simulation("growing")

# %% [markdown]
# **You will be able to** write the planner above and its faster relatives on a whiteboard; say what a returned path
# guarantees, and what it means when no path comes back; choose between growing a tree, reusing a stored graph and
# optimising a trajectory; turn a path into a motion that respects the joint limits; and bring a search of seconds down
# to milliseconds. **Know first:** the arms of chapter 4. The distances of chapter 2 help.
#
# The planner in the simulation connects random points by straight segments. The points are **nodes** and the segments
# **edges**. A **tree** is a set of nodes in which each node except the first, the root, is connected to one earlier
# node, its **parent**. Every path that this page calls free was also validated by `check_path`, a separate function
# that shares no code with the planners. A **seed** is the number that fixes all random choices of a run: the same seed
# gives the same tree.

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint, your_robot

badges(5)

# %% tags=["hide-code"]
import re

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

from course import planning
from course.cards import figures, interview
from course.charts import read
from course.derivations import more_claims, show
from course.kinematics import compose, frames, panda, tip
from course.planning import check_path, length, plan, scenes, time_parameterise
from course.planning.worlds import DISC, LAST_SIDE

BLUE, ORANGE, GREY, GREEN, RED, ROSE, PURPLE = (
    "#0072b2",
    "#d55e00",
    "#8a8a8a",
    "#009e73",
    "#c0392b",
    "#e9a3a0",
    "#8e44ad",
)
HALO = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8}


def table(*rows):
    """Return rows of text as a table; the first one is the head."""
    lines = [f"| {' | '.join(map(str, row))} |" for row in rows]
    return Markdown("\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]))


def key(chart, pattern):
    """Return the groups of each line of a chart's key figures that matches a pattern."""
    return [match.groups() for match in re.finditer(pattern, read(chart), re.M)]


def obstacles(axis, world):
    """Draw the discs and polygons of a planar world."""
    corners = []
    for kind, x, y, *rest in world.obstacles:
        if kind == DISC:
            axis.add_patch(plt.Circle((x, y), rest[0], color=ROSE))
            continue
        corners.append((x, y))
        if kind == LAST_SIDE:
            axis.add_patch(plt.Polygon(corners, color=ROSE))
            corners = []


def branches(axis, nodes, parents, ink, width=0.9):
    """Draw the edges of trees, nodes (2, m), each from its parent; a second tree is purple."""
    for i, parent in enumerate(parents):
        if parent >= 0:
            root = parent
            while parents[root] >= 0:
                root = parents[root]
            tint = ink if root == 0 else PURPLE
            _ = axis.plot(*nodes[:, [parent, i]], color=tint, lw=width)


def ends(axis, start, goal):
    """Mark start and goal."""
    _ = axis.plot(*start, "o", color=GREEN, mec="black", ms=8, zorder=5)
    _ = axis.plot(*goal, "o", color="#e8b700", mec="black", ms=8, zorder=5)


def bare(axis, title, low=0.0, high=10.0):
    """Give a sketch a title and no ticks."""
    _ = axis.set(xlim=(low, high), ylim=(low, high), aspect="equal", xticks=(), yticks=())
    _ = axis.set_title(title, fontsize=9)


# %% [markdown]
# ## 1 · Concept: configuration space
#
# ### The whole arm becomes a point
#
# An arm reaches around a post for a cup. Its hand moves through free air all the way, and still there is a crash: the
# elbow has hit the post. So planning has to consider every part of the robot. The trick for that is to change the space
# in which we plan.
#
# A **configuration** is a list of numbers that fixes the position of every part of the robot; libraries often call it a
# **state**. For an arm these are the joint angles. The set of all configurations is the **configuration space**. For an
# arm on a fixed base whose joints move independently, it has one dimension per joint. The ordinary space in which the
# robot and the obstacles stand is called the **workspace**. In configuration space the robot has no width and no elbow:
# it is a single point, and a motion is a curve.
#
# The price is the shape of the obstacles. A configuration is blocked when any part of the arm touches anything, and the
# set of blocked configurations has no simple formula. But one operation is always possible: take a single
# configuration, place the arm accordingly, and test whether it touches something. This is a **collision check**.

# %%
predict("shape_of_a_disc")

# %% tags=["hide-code"]
two = planning.planar_arm([1.0, 1.0], 0.06, discs=[[1.2, 0.9, 0.35], [-1.0, 1.2, 0.4]])
angles = np.linspace(-np.pi, np.pi, 151)
hit = [[not planning.state_free(two, (a, b)) for a in angles] for b in angles]
here, other = np.array([-0.4, 0.6]), np.array([2.9, -0.5])
result = plan(two, here, other, rng=2, step=0.5)
assert check_path(two, result.path, here, other)
figure_, (left, right) = plt.subplots(1, 2, figsize=(8, 3.8), layout="constrained")
obstacles(left, two)


def links(q):
    """Return base, elbow and tip of the two-link arm, (2, 3)."""
    directions = np.cumsum(q)
    return np.hstack(
        (np.zeros((2, 1)), np.cumsum([np.cos(directions), np.sin(directions)], axis=1))
    )


states = time_parameterise(result.path, (1.0, 4.0)).waypoints(0.25)
for k, q in enumerate(states.T):
    _ = left.plot(*links(q), color=plt.cm.viridis(k / states.shape[1]), lw=2)
_ = left.set(xlim=(-2.1, 2.1), ylim=(-2.1, 2.1), aspect="equal", title="workspace [m]")
_ = right.contourf(angles, angles, np.array(hit, float), levels=[0.5, 1.5], colors=[ROSE])
_ = right.plot(*result.path, "-", color=GREY)
_ = right.scatter(*states, c=np.arange(states.shape[1]), s=14, zorder=3)
_ = right.set(
    xlabel="shoulder [rad]", ylabel="elbow [rad]", title="configuration space", aspect="equal"
)
plt.show()

# %% [markdown]
# Left: the arm at successive times, dark colours first. Right: the same motion as a curve in configuration space, with
# the same colours. Each disc on the left becomes one curved region on the right. Three patches are visible, but only
# two regions: at $\pm\pi$ the shoulder angle wraps around, so the left border and the right border are the same angle,
# and the patches there belong together.
#
# ### Why not plan a path for the tip?
#
# It is tempting to find a free path for the tip first, then joint angles for each point of it (inverse kinematics,
# chapter 4). Most tip positions can be reached with the elbow on either side, and the path of the tip does not say
# which one is free.

# %% tags=["hide-code"]
figure_, (left, right) = plt.subplots(1, 2, figsize=(7.5, 3.2), layout="constrained")
left.add_patch(plt.Circle((0.35, 1.0), 0.3, color=ROSE))
for q, ink, name in (((0.95, -1.25), RED, "collides"), ((-0.3, 1.25), GREEN, "free")):
    x, y = links(q)
    _ = left.plot(
        x, y, "o-", color=ink, lw=3, label=f"elbow {'up' if q[0] > 0 else 'down'}: {name}"
    )
_ = left.set(xlim=(-0.4, 2.2), ylim=(-0.8, 1.6), aspect="equal", xlabel="x [m]", ylabel="y [m]")
_ = left.set_title("one tip position, two configurations", fontsize=9)
_ = left.legend(fontsize=8, loc="lower right")
start_, end_ = 170.0, -170.0
_ = right.axhspan(-180, 180, color="#f2f2f2")
_ = right.plot([0, 1], [start_, end_], color=RED, label="angles as plain numbers: 340°")
_ = right.plot([0, 0.5], [start_, 180], color=GREEN, label="through the wrap: 20°")
_ = right.plot([0.5, 1], [-180, end_], color=GREEN)
_ = right.set(
    xlabel="share of the motion", ylabel="joint angle [°]", yticks=(-180, -90, 0, 90, 180)
)
_ = right.set_title("a joint without limits wraps around", fontsize=9)
_ = right.legend(fontsize=7, loc="upper right", bbox_to_anchor=(1.0, 0.92))
plt.show()

# %% [markdown]
# Also, from one point of the tip's path to the next, the inverse kinematics may switch to the other elbow side. Then
# the arm has to swing through space that nobody has checked.

# %%
show("tip_path_then_ik")

# %% [markdown]
# How many dimensions does the space have? Count the independent joints, not the coordinates of the hand. A hand pose
# has six coordinates, and an arm with seven joints can hold one pose with a whole family of configurations. And a joint
# without limits needs a distance that knows about wrapping, or the planner takes the long way round.

# %%
show("one_dimension_a_joint")

# %% [markdown]
# ## 2 · Concept: planners that sample
#
# ### RRT: a tree that grows into empty space
#
# A grid is the obvious way to search a space, and it fails quickly. With 100 values per joint, a seven-joint arm has
# $100^7 = 10^{14}$ cells. Sampling-based planners avoid the grid: they try random configurations and connect those that
# work.
#
# The **RRT**, the rapidly-exploring random tree (LaValle 1998), starts with a tree that has one node, the start. Then
# it repeats five steps:
#
# 1. *Sample* a random configuration. With a small probability, the **goal bias**, use the goal itself.
# 2. Find the *nearest* node of the tree.
# 3. *Steer*: go from that node straight towards the sample, by at most the **step size**. If the sample is closer than
#    that, go exactly to the sample.
# 4. *Check* the new edge for collisions. If it is free, add the new node and store the nearest node as its parent.
# 5. If the goal has become a node, follow the parents back to the start. This is the path.


# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 4, figsize=(10, 2.8), layout="constrained")
nodes = np.array([[1.5, 3.2, 4.6, 3.6], [2.0, 3.0, 4.6, 6.0]])
sample, new = np.array([8.6, 7.4]), np.array([6.35, 5.8])
branches(axes[0], nodes, [-1, 0, 1, 1], BLUE, 1.5)
_ = axes[0].plot(*nodes, "o", color=BLUE, ms=4)
_ = axes[0].plot(*zip(nodes[:, 2], sample, strict=True), ":", color=GREY)
_ = axes[0].plot(*zip(nodes[:, 2], new, strict=True), color=ORANGE, lw=2.5)
_ = axes[0].plot(*sample, "x", color="black", ms=8)
_ = axes[0].plot(*new, "o", color=ORANGE, ms=6)
for spot, word in (
    ((7.0, 8.0), "1 sample"),
    ((5.0, 4.0), "2 nearest"),
    ((5.9, 4.9), "3, 4 new node"),
):
    _ = axes[0].text(*spot, word, fontsize=8)
bare(axes[0], "one round")
few = plan(
    scenes.empty().world,
    [5.0, 5.0],
    [9.5, 9.5],
    method="rrt",
    budget=18,
    rng=4,
    step=1.2,
    goal_bias=0.0,
)
across = np.linspace(0.0, 10.0, 120)
grid = np.stack(np.meshgrid(across, across)).reshape(2, -1)
owner = np.argmin(np.linalg.norm(grid[:, :, None] - few.nodes[:, None], axis=0), axis=1)
_ = axes[1].imshow(
    owner.reshape(120, 120) % 10, extent=(0, 10, 0, 10), origin="lower", cmap="Pastel1"
)
branches(axes[1], few.nodes, few.parents, BLUE, 1.5)
_ = axes[1].plot(*few.nodes, "o", color=BLUE, ms=3)
bare(axes[1], "points nearest to each node")
trap = scenes.bug_trap()
for axis, count in zip(axes[2:], (60, 600), strict=True):
    grown = plan(trap.world, trap.start, trap.goal, method="rrt", budget=count, rng=1, step=1.0)
    obstacles(axis, trap.world)
    branches(axis, grown.nodes, grown.parents, BLUE)
    ends(axis, trap.start, trap.goal)
    bare(axis, f"{count} samples in a bug trap")
plt.show()

# %% [markdown]
# Why does the tree spread instead of clumping? Look at the second sketch. All points of one patch have the same nearest
# node. A node at the border of the tree owns a large empty region, so most samples fall there and pull that node
# outwards. The right half shows a **bug trap**: the corridor to the only exit juts into the room. Branches at the walls
# don't help; a new branch has to grow from the middle of the room, where the corridor begins. So the tree fills the
# room long before it finds the way out.
#
# ### What "probabilistically complete" promises
#
# A planner is **probabilistically complete** if the probability that it has found an existing path approaches one as
# the number of samples grows. For RRT it is enough that (1) some path stays at least a small distance, its
# **clearance**, away from all obstacles, so that samples have a region to hit, and (2) samples fall everywhere and the
# goal is tried again and again, which means a goal bias below 1 and above 0.
#
# This gives no number of samples and says nothing about your deadline. And if there is no path, RRT will not tell you
# so: it uses up its budget and reports exactly what it reports when it was merely unlucky.

# %%
show("rrt_complete")

# %%
more_claims("rrt_loop")

# %% [markdown]
# ### Checking an edge, not only its end points
#
# Both ends of an edge are free. Is the segment between them free as well? Most libraries answer by checking points
# along the edge. A wall thinner than the spacing of these points can be missed: that is how the planner in the first
# card walked through one. An obstacle that an edge only grazes can be missed at any size.

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 3, figsize=(9.5, 3.0), layout="constrained")
axes[0].add_patch(plt.Rectangle((4.75, 0), 0.5, 10, color=ROSE))
_ = axes[0].plot([1, 9], [3, 7], color=GREY)
_ = axes[0].plot(np.linspace(1, 9, 6), np.linspace(3, 7, 6), "o", color=GREEN)
bare(axes[0], "six free points, one wall between")
axes[1].add_patch(plt.Circle((5, 3.2), 3.2, color=ROSE))
axes[1].add_patch(plt.Circle((5, 3.2), 3.9, fill=False, ls="--", color=GREY))
high = 3.2 + np.sqrt(3.9**2 - 2.6**2)
_ = axes[1].plot([0.5, 9.5], [high, high], color=GREY)
_ = axes[1].plot([2.4, 7.6], [high, high], "o", color=GREEN)
_ = axes[1].plot([5, 7.6, 5, 5], [3.2, high, high, 3.2], color="black", lw=1)
_ = axes[1].plot([5, 5 - 3.2 * np.cos(0.4)], [3.2, 3.2 - 3.2 * np.sin(0.4)], color=GREY, lw=1)
for spot, word in (
    ((5.8, 6.4), "s/2"),
    ((4.5, 4.6), "h"),
    ((3.2, 2.9), "r"),
    ((5.85, 3.4), r"$\sqrt{h^2 + s^2/4}$"),
):
    _ = axes[1].text(*spot, word, fontsize=9)
bare(axes[1], "enlarged disc (dashed): nothing missed")
axes[2].add_patch(plt.Circle((6.0, 7.4), 2.2, color=ROSE))
here_ = np.array([0.8, 3.0])
while here_[0] < 9.3:
    gap_ = np.hypot(*(here_ - [6.0, 7.4])) - 2.2
    axes[2].add_patch(plt.Circle(here_, gap_, fill=False, color=BLUE, lw=0.9))
    _ = axes[2].plot(*here_, "o", color=BLUE, ms=4)
    here_ = here_ + gap_ * np.array([0.97, 0.12]) / np.hypot(0.97, 0.12)
_ = axes[2].plot([0.8, 9.6], [3.0, 3.0 + 8.8 * 0.12 / 0.97], color=GREY)
bare(axes[2], "conservative advancement")
plt.show()

# %% [markdown]
# If you must use points, enlarge the obstacles (middle picture). Check points, both ends among them, are a distance $s$
# apart, and the edge passes the centre of a disc of radius $r$ at a distance $h \le r$. A check point lies within $s/2$
# of the point of the edge that is nearest to the centre. By Pythagoras it is at most $\sqrt{h^2 + s^2/4}$ from the
# centre, hence at most $\sqrt{r^2 + s^2/4}$. Enlarge the disc to this radius, and whenever an edge touches the original
# disc, a check point is in the enlarged one.
#
# **A worked example.** A post has a radius of 0.3 m, the points are 0.4 m apart. The enlarged radius is $\sqrt{0.09 +
# 0.04} = 0.36$ m. So checking at points adds 6 cm to the radius of each post. For a point robot and any other shape, a
# margin of $s/2$, here 20 cm, is always enough: no point of the edge is farther than that from a check point.
#
# For a point robot among discs and polygons, check points are unnecessary: whether a segment meets a disc or a polygon
# can be computed exactly. The chart shows the share of colliding edges that each method accepts, for a wall crossed at
# right angles and for a disc. OMPL,
# an open-source planning library, checks points as well, so its markers lie on ours. Thin dark lines (*closed form*)
# predict the share, bands are two standard errors of the measured one. Our exact test stays at zero:
#
# ![Share of colliding edges that points along the edge miss, and that an exact test misses
# (none)](../docs/charts/thin_obstacles.png)
#
# ### Conservative advancement: an edge check that proves
#
# An arm that turns has no such formula. But **conservative advancement**, drawn on the right of the sketch above, gives
# a guarantee. Measure the distance $g$ between the arm and the nearest obstacle. If no point of the arm can move
# farther than $g$ during the next stretch of the motion, that stretch is free. Go to the end of that stretch, measure
# again, and repeat.
#
# How far can a point of the arm move? Let the edge lead from $q$ to $q + \Delta q$, and let $\lambda$ be the share of
# the edge that is done, from 0 to 1. When joint $i$ turns by $\Delta q_i$, a point at a distance $r$ from that joint
# moves at most $r\,|\Delta q_i|$. Let $r_i$ be the reach of the part of the arm beyond joint $i$ when that part is
# stretched out. Then the safe step is
#
# $$\boxed{\;\Delta \lambda = \frac{g(q)}{\sum_i r_i\,|\Delta q_i|}\;}$$
#
# **A worked example.** Two links of 1 m, both joints turn by 0.5 rad. Then $r_1 = 2$ m, $r_2 = 1$ m, and no point moves
# farther than $2 \cdot 0.5 + 1 \cdot 0.5 = 1.5$ m along the whole edge. With a gap of 0.3 m, the first $0.3/1.5 = 20$ %
# of the edge are free.
#
# When the gap has shrunk to a few micrometres, the check stops and reports a collision. So its errors are on one side
# only. It may reject an edge that barely passes. It never accepts an edge on which the arm hits an obstacle, provided
# that the obstacles stand still and the measured distance is never too large.
#
# The simulation starts with check points 0.5 m apart, and the tree grows through the wall. Press *Plan*. Then set
# *Edges checked* to *exactly* and plan again: no path comes back.

# %%
simulation("growing", "Tunnelling edge check")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** A planner is a search around one question: is this edge free? For an arm, planning time is mostly the
# number of edge checks times the cost of one check. How far you can trust the path depends on what the checker means by
# "free".
#
# </div>

# %%
more_claims("edge_by_ten_points")

# %% [markdown]
# ### Connecting the goal
#
# When is the search finished? Many programs in tutorials stop as soon as a node is within one step of the goal. That
# saves a line and returns a path that ends somewhere near the goal. Or a node is close to the goal, but on the other
# side of a wall. The goal has to become a node of its own, connected by an edge that was checked.

# %%
show("near_the_goal")

# %% [markdown]
# <details><summary>The class RRT that you will find in many tutorials (a fragment, not to be run)</summary>
#
# It has the methods `sample`, `nearest`, `steer`, `collision_free` and `plan`; a tenth of its samples is the goal; it
# checks ten points along an edge and stops within one step of the goal:
#
# ```python
# for _ in range(self.max_samples):
#     target = self.sample()  # the goal with probability 0.1
#     near = self.nearest(target)
#     new = self.steer(near, target)
#     if self.collision_free(near, new):  # ten points along the edge
#         self.nodes.append(new)
#         if np.linalg.norm(new - self.goal) < self.step:
#             return self.path_to(new)  # ends at a neighbour of the goal
# ```
#
# It runs. The path that it returns ends at a *neighbour* of the goal, and nobody has checked the last stretch. Its
# nearest-neighbour search is a loop over a list, so $m$ samples need up to $m^2/2$ distances; the planners here use a
# spatial tree once it is faster. The drill `rrt` asks for the repaired version.
#
# </details>
#
# ### RRT-Connect: a tree from each end
#
# A single tree has to find a goal that is one small target in a large space. **RRT-Connect** (Kuffner and LaValle 2000)
# grows a second tree from the goal and lets the two look for each other. Each round has two halves:
#
# 1. *Extend.* One tree takes a single step towards a random sample, as in RRT, but without goal bias.
# 2. *Connect.* The other tree tries to reach this new node. It goes there step after step, without new samples, until
#    it arrives or an edge collides.
#
# If the second tree arrives, the path is complete. If not, the trees swap roles and a new round begins. The greedy
# second half can cross open space in one round.

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 3, figsize=(9.5, 3.2), layout="constrained")
nodes = np.array([[1.2, 2.6, 3.4], [1.5, 2.6, 4.2]])
second = np.array([[8.8, 8.0], [8.6, 7.0]])
new, sample = np.array([4.9, 4.9]), np.array([8.2, 6.2])
for points, ink in ((nodes, BLUE), (second, PURPLE)):
    _ = axes[0].plot(*points, "o-", color=ink, ms=4)
_ = axes[0].plot(*sample, "x", color="black", ms=8)
_ = axes[0].plot([3.4, 4.9], [4.2, 4.9], color=ORANGE, lw=2.5)
chain = second[:, [1]] + np.linspace(0, 1, 4) * (new - second[:, 1])[:, None]
_ = axes[0].plot(*chain, "o-", color=GREEN, lw=2, ms=4)
_ = axes[0].plot(*new, "o", color=ORANGE, ms=7)
for spot, word in (
    ((0.6, 5.5), "1 extend: one step"),
    ((4.5, 4.0), "2 connect: until it arrives"),
    ((8.0, 5.3), "sample"),
):
    _ = axes[0].text(*spot, word, fontsize=8)
bare(axes[0], "one round of RRT-Connect")
for axis, method in zip(axes[1:], ("rrt", "rrt_connect"), strict=True):
    grown = plan(trap.world, trap.start, trap.goal, method=method, budget=20_000, rng=5, step=1.0)
    assert check_path(trap.world, grown.path, trap.start, trap.goal)
    obstacles(axis, trap.world)
    branches(axis, grown.nodes, grown.parents, BLUE, 0.6)
    _ = axis.plot(*grown.path, color=GREEN, lw=1.5)
    ends(axis, trap.start, trap.goal)
    bare(axis, f"{'RRT' if method == 'rrt' else 'RRT-Connect'}, one seed: {grown.samples} samples")
plt.show()

# %% [markdown]
# Left: the tree that extends is blue, its new edge orange; the other tree is purple, its connecting edges green. In the
# other two sketches, blue is the tree of the start, purple that of the goal, green the path.
#
# **A worked example.** Start and goal are 11.3 m apart with nothing between, the step size is 1 m. In the first round
# the tree of the start adds one node. The tree of the goal then walks all the way to it, about eleven nodes, and the
# problem is solved with a single sample.
#
# A **narrow passage** is a small part of the free space that connects two larger parts and that random samples rarely
# hit. If a passage is as hard to enter from one side as from the other, the second tree helps less: both trees have to
# find it by chance.

# %%
predict("both_ends_of_a_slit")

# %%
simulation("growing", "Narrow gap")

# %% [markdown]
# The sketch with the bug trap shows one run of each. The number of samples varies enormously from seed to seed, so two
# single runs prove nothing; try several. A comparison needs its settings, the spread over many seeds, path lengths
# before and after shortening, and a fair unit: one sample of RRT-Connect may cost many edge checks. Here is one: a
# square of 10 m, a wall of 0.5 m, steps of 1 m, a goal bias of 5 % for RRT, exact edge checks, a goal that has to be
# connected, 100 seeds.

# %% tags=["hide-code"]
lines = [
    (
        "planner",
        "open share of the wall",
        "samples: median (25th to 75th percentile)",
        "edge checks: median",
        "path length / shortest length (after shortening)",
    ),
]
for name, title in (("rrt", "RRT"), ("rrt_connect", "RRT-Connect")):
    for share in scenes.GAPS:
        requested = scenes.gap(share)
        ends_ = requested.world, requested.start, requested.goal
        runs = [plan(*ends_, method=name, budget=200_000, rng=k, step=1.0) for k in range(100)]
        drawn = np.percentile([run.samples for run in runs], (50, 25, 75))
        corner = np.array([4.75, 5.0 - 5.0 * share])
        best = 2.0 * np.linalg.norm(corner - requested.start) + 0.5
        cut = [
            length(planning.shortcut(run.path, requested.world, np.random.default_rng(0))) / best
            for run in runs[:20]
        ]
        assert all(
            check_path(requested.world, run.path, requested.start, requested.goal) for run in runs
        )
        lines.append(
            (
                title,
                f"{share:.0%}",
                f"{drawn[0]:.0f} ({drawn[1]:.0f} to {drawn[2]:.0f})",
                f"{np.median([run.edge_checks for run in runs]):.0f}",
                f"{np.median([run.cost for run in runs]) / best:.2f} ({np.median(cut):.2f})",
            )
        )
table(*lines)

# %% [markdown]
# A narrower gap lengthens the search and shrinks the advantage of RRT-Connect. In edge checks the advantage is smaller
# than in samples: at the 2 % gap the medians of the edge checks are nearly equal. (Our RRT also tries an edge to the
# goal from each new node near it, without a sample.)

# %%
more_claims("connect_is_two_rrts", "gap_table", "connect_in_narrow_passages")

# %% [markdown]
# ### Where to sample
#
# How can we help the samples? The first idea is more goal bias. In an empty room that works. Now think of the bug
# trap, where the straight way to the goal is blocked by the wall.

# %%
predict("pull_of_the_goal")

# %%
simulation("growing", "Bug trap")

# %% [markdown]
# The second idea is to place samples where passages are. A **bridge test** samples two nearby configurations. If *both*
# collide and the midpoint between them is free, it keeps the midpoint, which is then likely to lie in a passage. A
# **Gaussian sampler** asks for less: exactly one of the two must collide, and the other one is kept, so its samples
# follow every surface. (On the right below, dots outside the corridor are uniform samples: one is taken whenever 100
# bridge tests in a row have failed.)

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 3, figsize=(9, 3.1), layout="constrained")
corridor = scenes.gap(0.05, 4.0)
for axis, name in zip(axes, ("uniform", "gaussian", "bridge"), strict=True):
    some = plan(
        corridor.world,
        scenes.START,
        scenes.GOAL,
        method="prm_star",
        sampler=name,
        budget=250,
        rng=1,
        spread=0.5,
    ).nodes[:, 2:]
    obstacles(axis, corridor.world)
    _ = axis.plot(*some, ".", color=BLUE, ms=4)
    inside = np.mean(np.abs(some[0] - 5.0) < 2.0)
    bare(axis, f"{name}: {inside:.0%} of the samples in the corridor")
plt.show()

# %% [markdown]
# Both samplers pay for this with extra collision checks per sample. The bridge must also have the right length: if the
# two samples are closer to each other than the passage is wide, they can't lie in the walls on both sides of it.

# %%
more_claims("goal_bias_in_passages", "bridge_test")

# %% [markdown]
# ### Rewiring: paths that keep getting better
#
# RRT never revisits a decision. Once a node has a parent, its path from the start stays as crooked as it is. **RRT\***
# (Karaman and Frazzoli 2011) adds two steps when a node is inserted. *Choose parent*: among all nodes within a certain
# radius whose edge to the new node is free, take the one that gives the shortest path from the start, which need not be
# the nearest. *Rewire*: for each of these neighbours, test whether the path through the new node is shorter than its
# present one, and if so, make the new node its parent.

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 3, figsize=(9.5, 3.1), layout="constrained")
spots = {"start": (0.8, 1.2), "a": (2.2, 4.0), "b": (4.6, 6.6), "c": (7.6, 7.2), "new": (4.95, 3.2)}
before = [("start", "a"), ("a", "b"), ("b", "c")]
after = [("start", "a"), ("a", "b"), ("start", "new"), ("new", "c")]
for axis, pairs, title in ((axes[0], before, "before"), (axes[1], after, "after: c is rewired")):
    for p, q in pairs:
        ink = ORANGE if "new" in (p, q) else BLUE
        _ = axis.plot(*zip(spots[p], spots[q], strict=True), "o-", color=ink, lw=2)
    axis.add_patch(plt.Circle(spots["new"], 4.9, fill=False, ls=":", color=GREY))
    _ = axis.plot(*spots["new"], "o", color=ORANGE, ms=8)
    costs = {"start": 0.0}
    for p, q in pairs:
        costs[q] = costs[p] + np.hypot(*np.subtract(spots[q], spots[p]))
    for name, (x, y) in spots.items():
        from_start = f" {costs[name]:.1f} m" if costs.get(name) else ""
        _ = axis.text(x + 0.25, y - 0.75, name + from_start, fontsize=8)
    bare(axis, title)
around = planning.plane(scenes.SQUARE, [[5.0, 5.0, 2.0]])
left_, right_ = np.array([1.0, 5.0]), np.array([9.0, 5.0])
star = plan(around, left_, right_, method="informed_rrt_star", budget=700, rng=3, step=1.0)
obstacles(axes[2], around)
branches(axes[2], star.nodes, star.parents, BLUE, 0.4)
_ = axes[2].plot(*star.path, color=GREEN, lw=2.5)
turn = np.linspace(0.0, 2.0 * np.pi, 200)
wide, tall = star.cost / 2.0, np.sqrt(star.cost**2 - 64.0) / 2.0
_ = axes[2].plot(5.0 + wide * np.cos(turn), 5.0 + tall * np.sin(turn), "--", color=ORANGE)
ends(axes[2], left_, right_)
bare(axes[2], "informed: the ellipse that can still help")
plt.show()

# %% [markdown]
# **A worked example.** The nearest node to the new one is *a*, but over *a* its path would be 6.0 m long; straight from
# the start it is 4.6 m, so the start becomes its parent. Node *c* had a path of 9.7 m. It is 4.8 m from the new node,
# and $4.6 + 4.8 = 9.4$ m is shorter, so *c* is rewired. Node *b* is not: its path of 6.7 m is shorter than the 8.0 m
# over the new node. (In the sketch, numbers are path lengths from the start; the dotted circle shows the radius.)
#
# A planner is **asymptotically optimal** if the length of its best path converges to the optimum with probability one.
# The path of RRT\* never gets longer, since a node changes its parent only for a shorter path. For convergence to the
# optimum, two conditions are enough. First, the radius must not shrink too fast as the number $n$ of nodes grows: in
# $d$ dimensions, the original paper used $(\log n/n)^{1/d}$, but its proof has a gap; a later proof needs the exponent
# $1/(d+1)$ and a large enough factor. Second, some paths with clearance must be hardly longer than the shortest one: no
# random sample falls into a gap of zero width.

# %%
show("rrt_star_converges")

# %% [markdown]
# **Informed RRT\*** (Gammell and others 2014) adds one idea. Once a path of length $c_{\text{best}}$ is known, a
# configuration $q$ can improve it only if the way from start to $q$ to goal in straight lines is shorter than this
# path. With start $q_a$ and goal $q_b$:
#
# $$\lVert q - q_a\rVert + \lVert q - q_b\rVert < c_{\text{best}} .$$
#
# In the plane these configurations fill an ellipse (drawn on the right above). All further samples come from it. The
# chart shows the excess length against computing time, in two scenes whose shortest path is known exactly:
#
# ![Excess path length over the shortest path against computing time, in two scenes](../docs/charts/path_quality.png)
#
# Lines are medians over seeds; bands (**quartiles**) contain the middle half of them. All trees take steps of 1 m.
# OMPL's RRT\* calls Python for each edge check, so its curve says nothing about OMPL's speed. On the curve
# *RRT-Connect, shortcuts*, each point stands for a number of random attempts to shorten the path (section 3): 0, 10,
# 30, 100 and 300.
#
# The circle (*pick*) marks the fastest setting whose median is within 5 % of the optimum. It lies on that curve in both
# scenes. A smaller tolerance can change the winner: at the gap, Informed RRT\* is closer to the optimum from about 2 ms
# on. (PRM\* is explained in the next part.)

# %%
more_claims("informed_rrt_star")

# %% [markdown]
# ### Roadmaps: reuse what you know
#
# A robot at a shelf solves similar problems all day, and a tree throws everything away after each. A **roadmap** (PRM,
# probabilistic roadmap; Kavraki and others 1996) is built in advance: sample free configurations, and connect each to
# its nearest neighbours where the edge is free. To answer a **query**, one start with one goal, connect both to nearby
# nodes, and search the graph. In **PRM\*** the number of neighbours grows with the logarithm of the number of nodes.
# Under the conditions of RRT\* its paths, too, converge to the optimum.
#
# Most edges of a roadmap never appear in any answer, so why check them in advance? A **lazy** roadmap (Bohlin and
# Kavraki 2000) assumes that all edges are free and checks only when it has to:
#
# 1. Search the graph for the shortest path, treating unchecked edges as free.
# 2. Check the edges of this path. If all are free, return it.
# 3. Otherwise delete the edge that collides, and go back to step 1.

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 3, figsize=(9.5, 3.1), layout="constrained")
points = np.array(
    [
        [0.8, 1.0],
        [2.0, 4.8],
        [3.6, 1.4],
        [5.4, 3.4],
        [4.8, 7.4],
        [7.4, 5.6],
        [7.0, 1.6],
        [2.2, 8.2],
        [9.2, 8.8],
    ]
).T
# The search proposes the shorter candidate first.
assert length(points[:, [0, 2, 3, 5, 8]]) < length(points[:, [0, 1, 4, 8]])
graph = [
    (0, 1),
    (0, 2),
    (1, 3),
    (2, 3),
    (1, 4),
    (3, 5),
    (4, 5),
    (2, 6),
    (6, 5),
    (1, 7),
    (7, 4),
    (5, 8),
    (4, 8),
    (3, 4),
]
states_ = (
    ("first candidate: one edge collides", {(0, 2): GREEN, (2, 3): GREEN, (3, 5): RED}),
    (
        "second candidate: free",
        {(0, 1): GREEN, (1, 4): GREEN, (4, 8): GREEN, (0, 2): BLUE, (2, 3): BLUE},
    ),
)
for axis, (title, inks) in zip(axes[1:], states_, strict=True):
    axis.add_patch(plt.Circle((6.6, 4.3), 0.75, color=ROSE))
    for i, j in graph:
        ink = inks.get((i, j), "#cfcfcf")
        if title.startswith("second") and (i, j) == (3, 5):
            continue
        unchecked = title.startswith("first") and (i, j) == (5, 8)
        _ = axis.plot(
            *points[:, [i, j]],
            color=GREY if unchecked else ink,
            ls="--" if unchecked else "-",
            lw=2.5 if unchecked or (i, j) in inks else 1.2,
        )
    _ = axis.plot(*points, "o", color=GREY, ms=4)
    ends(axis, points[:, 0], points[:, 8])
    bare(axis, title)
world_ = scenes.discs()
road = planning.build_roadmap(world_.world, 110, 0)
obstacles(axes[0], world_.world)
for i, j in road.pairs[road.status == 1]:
    _ = axes[0].plot(*road.nodes[[i, j]].T, color=BLUE, lw=0.4)
_ = axes[0].plot(*road.nodes.T, ".", color=BLUE, ms=3)
bare(axes[0], "a small roadmap among discs")
plt.show()

# %% [markdown]
# The left sketch shows the free edges of a small roadmap. In the other two, green edges are on the present candidate
# and free, the red one collides, blue ones were found free earlier, and grey ones were never checked, also the dashed
# one.

# %%
show("lazy_tests_the_final_path")

# %% [markdown]
# Being lazy also helps when something has moved. The next scene is a shelf with an arm of seven joints (*7-R arm* in
# the charts). The arm reaches from one compartment into another.

# %% tags=["hide-code"]
requested = planning.shelf("open")
rng = np.random.default_rng(1)
query = requested.query(rng)
figure_ = plt.figure(figsize=(8.5, 3.9), layout="constrained")
for k, name in enumerate(("open", "tight")):
    place = planning.shelf(name)
    axis = figure_.add_subplot(1, 2, k + 1, projection="3d", proj_type="ortho")
    for row in place.world.obstacles:
        centre, half = row[1:4], row[4:7]
        if half.max() < 0.9:
            axis.bar3d(*(centre - half), *(2 * half), color=ROSE, alpha=0.18, shade=False)
    for q, ink in zip(
        query if name == "open" else place.query(np.random.default_rng(3)),
        (BLUE, GREEN),
        strict=True,
    ):
        flange = tip(panda(), q[:, None])
        finger = compose(flange, np.array([0, 0, 0.145, 1, 0, 0, 0])[:, None])
        joints = np.hstack(
            (np.zeros((3, 1)), frames(panda(), q[:, None])[:3, :, 0], flange[:3], finger[:3])
        )
        _ = axis.plot(*joints, "o-", color=ink, lw=3, ms=4)
    _ = axis.set(
        xlim=(-0.1, 0.95), ylim=(-0.55, 0.55), zlim=(0, 1.1), title=f"the {name} shelf [m]"
    )
    axis.view_init(18, -125)
    axis.set_box_aspect((1.05, 1.1, 1.1))
    _ = axis.set(xlabel="x", ylabel="y", zlabel="z")
    axis.tick_params(labelsize=7)
plt.show()

# %% [markdown]
# Blue is a start, green a goal, each with the fingertip inside a compartment. The open shelf has two rows of
# compartments. The tight shelf has three, and each is less high. Now somebody places a ball of 8 cm radius in front of
# the open shelf before each query, and any edge of the stored roadmap might be blocked.

# %%
predict("after_the_ball")

# %% tags=["hide-code"]
roadmap = planning.build_roadmap(requested.world, 1000, 0)
rng = np.random.default_rng(1)
rows = [("ball", "edges checked", "edges on the path", "`check_path`")]
for k in range(5):
    pair = requested.query(rng)
    world = requested.disturbed(rng, *pair)
    reply = plan(world, *pair, method="roadmap", roadmap=roadmap, budget=20_000, rng=k, step=1.0)
    passed = "free" if check_path(world, reply.path, *pair) else "in collision"
    rows.append((k + 1, reply.edge_checks, reply.path.shape[1] - 1, passed))
counts = f"The stored roadmap has {len(roadmap.nodes)} nodes and {len(roadmap.pairs):,} edges."
both = "Where the two numbers of edges are equal, no edge that was checked is blocked."
joined = "The edges that join start and goal to the roadmap are included."
Markdown(f"{table(*rows).data}\n\n{joined} {both} {counts}")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Precompute what is known before the query arrives: the robot, the shelf, most of the free space. When
# something has been added, check only the edges that the answer wants to use. When something has gone, recheck blocked
# edges too.
#
# </div>

# %%
more_claims("cached_roadmap")

# %% [markdown]
# ## 3 · Concept: from a path to a motion
#
# ### Shortcutting
#
# The path of a tree zigzags, because it runs through random points. **Shortcutting** repairs that: pick two points on
# the path at random, and if the straight edge between them is free, replace the part between them by this edge. Then
# repeat. The ends and corner points of a path are its **waypoints**. Choose the two points anywhere on the path, not
# only among the waypoints. If both had to be waypoints, a path with a single corner would offer only one shortcut, the
# straight line from start to goal.

# %%
show("shortcut_never_lengthens")

# %% tags=["hide-code"]
scene = scenes.discs()
walk = plan(scene.world, scene.start, scene.goal, method="rrt", rng=1, step=1.0).path
cut = planning.shortcut(walk, scene.world, np.random.default_rng(0))
round_ = planning.smooth(cut, scene.world)
figure_, axes = plt.subplots(1, 2, figsize=(9.5, 4.0), layout="constrained")
corner = np.array([[0.8, 4.0, 7.6, 9.2], [1.2, 7.6, 6.9, 1.4]])
bump = planning.plane(scenes.SQUARE, [[5.9, 3.3, 1.7]])
obstacles(axes[0], bump)
_ = axes[0].plot(*corner, "o-", color=GREY, lw=1.5)
_ = axes[0].plot([4.0, 9.2], [7.6, 1.4], ":", color=RED, lw=2)
p_, q_ = (
    corner[:, 0] + 0.62 * (corner[:, 1] - corner[:, 0]),
    corner[:, 2] + 0.3 * (corner[:, 3] - corner[:, 2]),
)
_ = axes[0].plot(*np.stack((p_, q_), axis=1), "o-", color=GREEN, lw=2.5)
assert planning.edge_free(bump, p_, q_) and not planning.edge_free(bump, *corner[:, [1, 3]].T)
_ = axes[0].text(6.0, 0.3, "between waypoints:\ncollides", fontsize=8, color=RED)
_ = axes[0].text(0.2, 5.9, "between any\ntwo points: free", fontsize=8, color=GREEN)
bare(axes[0], "two attempts to cut the same path")
obstacles(axes[1], scene.world)
rows = [
    (
        "path",
        "length",
        "waypoints",
        "duration, stopping at each waypoint",
        "duration, corners rounded in passing",
    )
]
for name, path, style in (
    ("from the tree", walk, {"color": BLUE}),
    ("after shortcutting", cut, {"color": ORANGE, "lw": 4}),
    ("smoothed", round_, {"color": "black", "ls": ":", "lw": 2}),
):
    _ = axes[1].plot(*path, label=name, **style)
    assert check_path(scene.world, path, scene.start, scene.goal)
    if name == "smoothed":
        continue
    stops = time_parameterise(path, (1.0, 1.0)).duration
    flows = time_parameterise(path, (1.0, 1.0), blend=0.5, free=scene.world).duration
    rows.append((name, f"{length(path):.2f} m", path.shape[1], f"{stops:.1f} s", f"{flows:.1f} s"))
ends(axes[1], scene.start, scene.goal)
_ = axes[1].set(xlim=(0, 10), ylim=(0, 10), aspect="equal", xlabel="x [m]", ylabel="y [m]")
_ = axes[1].legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))
plt.show()

# %% [markdown]
# At a sharp corner the robot has to stop, since turning at once would take an infinite acceleration, or it rounds the
# corner with a short curve, a **blend**. The table compares both. (The dotted path, *smoothed*, belongs to the next
# part.)

# %% tags=["hide-code"]
table(*rows)

# %% [markdown]
# The limits are 1 m/s and 1 m/s², for x and for y separately.
#
# ### Smoothing and trajectory optimisation
#
# A **B-spline** is a smooth curve made of polynomial pieces; here it replaces corners. It departs from the edges that
# were checked, so it has to be checked again; where it collides, the corner stays.
#
# An **optimiser** takes a whole trajectory and deforms it to reduce a cost. **CHOMP** (Zucker and others 2013) follows
# the gradient of a smoothness cost plus an obstacle cost, and spreads each change over the neighbouring waypoints so
# that the path bends instead of kinking.
#
# **TrajOpt** (Schulman and others 2014) also penalises waypoints that are too close to an obstacle, and in its
# published form the volume swept between two waypoints. Near the present path it approximates the total cost by a
# **convex** function, whose minima are all global. It minimises this function in a small region around the path, and
# repeats.
#
# **STOMP** (Kalakrishnan and others 2011) needs no gradient: it averages noisy variations of the trajectory.
#
# All of them start from an **initial guess**, and it decides a lot. If no deformation turns one path into another
# without crossing an obstacle, the two belong to different **homotopy classes**. In the plane, these are paths on
# different sides of an obstacle. If the initial guess runs through the obstacle, it is hard to predict which side it
# ends on, or whether it gets out at all.

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 2, figsize=(6.5, 3.0), layout="constrained")
along = np.linspace(0.0, 1.0, 60)
for axis, title in zip(axes, ("two homotopy classes", "a guess through the obstacle"), strict=True):
    axis.add_patch(plt.Circle((5, 5), 1.9, color=ROSE))
    ends(axis, (1, 5), (9, 5))
    bare(axis, title)
for lift, ink in ((3.1, BLUE), (4.2, BLUE), (-3.1, ORANGE), (-4.2, ORANGE)):
    _ = axes[0].plot(1 + 8 * along, 5 + lift * np.sin(np.pi * along), color=ink)
_ = axes[1].plot([1, 9], [5, 5], color=GREY, lw=2)
for lift in (3.1, -3.1):
    _ = axes[1].plot(1 + 8 * along, 5 + lift * np.sin(np.pi * along), ":", color=RED)
_ = axes[1].text(5, 0.9, "to which side?", ha="center", fontsize=8)
plt.show()

# %% [markdown]
# The chart tests this with 169 initial guesses in a scene of 16 discs. Each guess leads in two straight lines from the
# start near the lower left corner to the goal near the upper right corner. The point where the lines meet is its **via
# point**. The mark there shows the optimiser's result: free and at most 5 % longer than this optimiser's shortest free
# result (*free, shortest*), free and longer, or in collision. Black rings are the discs.
#
# ![Result of two optimisers for 169 initial guesses, at the via point of each
# guess](../docs/charts/optimiser_minima.png)

# %% tags=["hide-code"]
counted = {(a, b): n for a, b, n in key("optimiser_minima", r"^(CHOMP|TrajOpt) +(.*?) +(\d+) of")}
((heavy,),) = key("optimiser_minima", r"^CHOMP with five times the weight: (\d+) collide")
rows = table(
    ("optimiser", "free, at most 5 % over its shortest", "free, longer", "in collision"),
    *(
        (name, *(counted[name, x] for x in ("free, shortest", "free, longer", "collides")))
        for name in ("CHOMP", "TrajOpt")
    ),
)
Markdown(
    f"{rows.data}\n\nWith five times the weight of the obstacle cost, {heavy} of CHOMP's results collide."
)

# %% [markdown]
# Both optimisers are our own short versions, with one setting each (24 waypoints, a desired clearance of 20 cm). The
# counts show how much depends on initial guess and settings; they are no ranking.
#
# What helps is a better initial guess, such as a planner's path, or the best valid result of several guesses.

# %%
show("optimisers_get_stuck")

# %%
more_claims("trajopt_minimises_jerk", "shortcut_leaves_corners")

# %% [markdown]
# ### Time parameterisation: how fast along the path?
#
# A path says where, not when. **Time parameterisation** assigns a time to each point of a path. Here it is the
# time-optimal one: the fastest motion along the path that respects the velocity and acceleration limits of all joints.
#
# Let $s$ grow along the path, and let $q(s)$ be the configuration at $s$, with the derivatives $q'$ and $q''$ with
# respect to $s$. On a straight line $s$ is the distance. A rounded corner is a parabola, quadratic in $s$, and $q'$
# does not jump where it joins the lines. Along the parabola, $s$ is not exactly the distance. The path speed $\dot s$
# says how fast $s$ grows. The chain rule gives the joint accelerations:
#
# $$\ddot q = q'(s)\,\ddot s + q''(s)\,\dot s^2 .$$
#
# The left side is limited for every joint. Fix the path speed $\dot s$ at one point. Then each joint allows an interval
# of path accelerations $\ddot s$, and the robot may use those that all joints allow. Two things cap the path speed at a
# point: the velocity limits of the joints, and in a bend also the acceleration limits, since above some speed no $\ddot
# s$ suits all joints. This cap is dotted in the left sketch, with dips at two bends. So the only unknown left is the
# path speed. Two passes find it:
#
# 1. *Backward*, from the goal at rest: at each point compute the highest path speed that stays below the cap and from
#    which the robot can still brake for every dip of the cap ahead.
# 2. *Forward*, from the start at rest: accelerate as hard as the limits allow, but stay below the result of the first
#    pass.

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 3, figsize=(10, 3.0), layout="constrained")
place_ = np.linspace(0.0, 4.0, 801)
cap = (
    2.2
    - 1.3 * np.exp(-(((place_ - 1.6) / 0.25) ** 2))
    - 0.8 * np.exp(-(((place_ - 2.9) / 0.2) ** 2))
)
back, ahead = cap.copy(), cap.copy()
back[-1] = ahead[0] = 0.0
for k in range(len(place_) - 2, -1, -1):
    back[k] = min(cap[k], np.sqrt(back[k + 1] ** 2 + 2 * 2.0 * 0.005))
for k in range(1, len(place_)):
    ahead[k] = min(back[k], np.sqrt(ahead[k - 1] ** 2 + 2 * 2.0 * 0.005))
_ = axes[0].plot(place_, cap, ":", color=GREY, label="cap on the path speed")
_ = axes[0].plot(place_, back, "--", color=ORANGE, label="backward pass")
_ = axes[0].plot(place_, np.minimum(back, ahead), color=BLUE, lw=2, label="forward pass: result")
_ = axes[0].set(xlabel="s [m]", ylabel="path speed [m/s]", ylim=(0, 3.4))
_ = axes[0].legend(fontsize=7, loc="upper right")
for distance, name in ((2.0, "2 rad: trapezoid"), (0.2, "0.2 rad: triangle")):
    move = time_parameterise(np.array([[0.0, distance]]), (1.0, 2.0))
    when = np.linspace(0.0, move.duration, 400)
    _ = axes[1].plot(when, move(when)[1][0], label=name)
_ = axes[1].set(xlabel="time [s]", ylabel="joint rate [rad/s]", ylim=(0, 1.35))
_ = axes[1].legend(fontsize=7, loc="upper right")
motion = time_parameterise(cut, (1.0, 1.0), blend=0.5, free=scene.world)
times = np.linspace(0.0, motion.duration, 4001)
q, rate, push = motion(times)
assert max(np.abs(rate).max(), np.abs(push).max()) < 1.0 + 1e-9
_ = axes[2].plot(times, rate.T, label=["rate of x [m/s]", "rate of y [m/s]"])
_ = axes[2].plot(
    times, push.T, lw=0.7, label=["acceleration of x [m/s²]", "acceleration of y [m/s²]"]
)
_ = axes[2].axhline(1.0, color=GREY, ls=":")
_ = axes[2].axhline(-1.0, color=GREY, ls=":")
_ = axes[2].set(xlabel="time [s]", ylim=(-1.1, 2.3))
_ = axes[2].legend(fontsize=7, loc="upper right", ncols=2)
for axis, title in zip(
    axes, ("two passes", "a single straight line", "the path among discs"), strict=True
):
    _ = axis.set_title(title, fontsize=9)
plt.show()

# %% [markdown]
# On a straight line from rest to rest, the fastest velocity over time is a **trapezoid**: accelerate, cruise, brake; on
# a short one, a triangle. The plot on the right shows the motion for the path among the discs: at nearly every moment
# one of the limits (dotted) is reached, and none is exceeded. The accelerations jump: their derivative, the **jerk**,
# is not limited here.
#
# **A worked example.** One joint moves 2 rad with at most 1 rad/s and 2 rad/s². Speeding up takes 0.5 s and covers 0.25
# rad, braking the same. The remaining 1.5 rad take 1.5 s, so the motion lasts 2.5 s.
#
# <details><summary>Derive: the trapezoid for several joints</summary>
#
# All joints stay on the line, $q = a + \lambda\,(b - a)$ with $\lambda$ from 0 to 1. Joint $i$ moves at $|b_i -
# a_i|\,\dot\lambda$, so $\dot\lambda \le v = \min_i v_i/|b_i - a_i|$ and $|\ddot\lambda| \le u = \min_i u_i/|b_i -
# a_i|$; the two minima may belong to two different joints. Speeding up to $v$ takes $v/u$ seconds and $v^2/(2u)$ of the
# line, braking the same. If $v^2/u < 1$ there is a stretch at full speed and the motion lasts $1/v + v/u$. Otherwise
# the ramps meet in the middle and the motion lasts $2/\sqrt{u}$.
#
# </details>
#
# In a computer the two passes visit a grid of points along the path. In each interval between two of them the path
# acceleration $\ddot s$ is constant, but the joint accelerations $\ddot q$ change with $\dot s$. Some schemes test
# $\ddot q$ only at the first point of each interval, others at both ends.
#
# Is it enough to test both ends? In an interval $\ddot s$ is constant, so $\dot s^2$ is linear in $s$. On a line $q''$
# is zero, on our parabolas it is constant, and $q'$ is linear on both. So each term of $\ddot q$ is linear in $s$, and
# $\ddot q$ is largest at one of the ends. (The velocity $q'\dot s$ is not: on a parabola it needs a bound of its own.)
# On a circular arc the direction of $q''$ turns, and $\ddot q$ can be larger in between.

# %%
show("limits_between_grid_points")

# %% [markdown]
# ![How far the acceleration limit is exceeded between grid points, and how much time rounding the corners
# saves](../docs/charts/limits_between.png)
#
# The left plot shows by how much the acceleration exceeds its limit inside the intervals, on straight lines and
# parabolas. With a test at both ends, only rounding errors remain. The right plot compares with the motion that stops
# at every waypoint. The earlier the rounding of a corner begins, the less time the motion takes, but the farther it
# leaves the checked path. The other curve still stops at every waypoint, but times every joint with its own trapezoid.
# That hardly saves time here, and the robot leaves the checked straight lines.

# %%
more_claims("shortcut_share")

# %% [markdown]
# ## 4 · Design: where a planner sits
#
# A robot that fetches a cup decides four kinds of things, and each level passes its decision down. When a level fails,
# the problem goes back up.

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(8.5, 3.2), layout="constrained")
levels = (
    ("task planning", "what to do", "grasp pose"),
    ("motion planning", "which way", "waypoints"),
    ("trajectory generation", "how fast", r"$q, \dot q, \ddot q$ over time"),
    ("control", "which torques", "torques at 1 kHz"),
)
failures = (
    "no path: try another grasp",
    "the motion takes too long: ask for another path",
    "cannot follow: slow down or replan",
)
for k, (name, what, down) in enumerate(levels):
    y = 3.0 - k
    axis.add_patch(plt.Rectangle((0.0, y), 3.0, 0.62, fc="#dbe9f4", ec=BLUE))
    _ = axis.text(1.5, y + 0.31, f"{name}\n{what}", ha="center", va="center", fontsize=9)
    arrow = {"arrowstyle": "->", "color": BLUE, "lw": 1.5}
    _ = axis.annotate("", (0.8, y - 0.36 if k < 3 else y - 0.3), (0.8, y), arrowprops=arrow)
    _ = axis.text(0.7, y - 0.2, down, ha="right", va="center", fontsize=8)
    if k < 3:
        _ = axis.annotate("", (2.2, y), (2.2, y - 0.36), arrowprops=arrow | {"color": RED})
        _ = axis.text(2.35, y - 0.2, failures[k], va="center", fontsize=8, color=RED)
_ = axis.set(xlim=(-1.5, 5.6), ylim=(-0.4, 3.8))
axis.axis("off")
plt.show()

# %% [markdown]
# Blue arrows show what a level passes down, red ones what it reports when it fails.
#
# Each level should report *why* it failed, or the level above will try the same again. And by the time a plan is
# carried out, the scene that it was computed for may be out of date. Keep checking the rest of the path at the rate of
# the camera.
#
# How long do the stages take? This cell times planning, shortcutting and time parameterisation on your machine, for one
# query at the open shelf (the scene `requested`). `plan` runs RRT-Connect unless you name another method.
# `time_parameterise` takes the limits (2 rad/s, 8 rad/s²), the distance `blend` from a corner at which rounding begins,
# and the world `free` in which roundings are checked.

# %% tags=["nbval-ignore-output", "show-code"]
import time

ends_ = requested.query(np.random.default_rng(3))
result = plan(requested.world, *ends_, rng=0, step=1.0)
begun = time.perf_counter()
path = planning.shortcut(result.path, requested.world, np.random.default_rng(0), rounds=60)
between = time.perf_counter()
motion = time_parameterise(path, (2.0, 8.0), blend=0.2, free=requested.world)
spent = 1e3 * np.array([result.seconds, between - begun, time.perf_counter() - between])
print("plan {:.1f} ms, shortcut {:.1f} ms, time parameterisation {:.1f} ms".format(*spent))
print(f"for a motion of {motion.duration:.2f} s between two compartments of the open shelf")

# %% [markdown]
# Shortcutting takes longer here than planning. Once the planner is fast, look at the shortcuts.
#
# ## 5 · Code: from your own collision check to a motion
#
# A planner needs one function from you: is this configuration free? The cell below plans around a ring that is known
# only through such a function. Edges are checked at points 2 cm apart, because a yes-or-no function offers nothing
# better. For this spacing, the margin of section 2 is 1 cm. The function keeps 5 cm away from the ring (dashed in the
# picture), also at its opening. Then the path is shortened and timed. `check_path` validates it twice, the second time
# with its rounded corners. (Here it calls the same `is_free` at points 2 cm apart, so it cannot find an error in
# `is_free`.)


# %% tags=["show-code"]
def is_free(q):
    """Return whether a point keeps 5 cm away from a ring (1.0 to 1.3 m) with an opening."""
    radius, angle = np.hypot(*q), np.arctan2(q[1], q[0])
    return not (0.95 < radius < 1.35 and abs(angle) > 0.25)


bounds = [[-2.0, -2.0], [2.0, 2.0]]
world = planning.from_function(is_free, bounds, resolution=0.02)
start, goal = np.array([-0.5, 0.0]), np.array([-1.7, 0.0])
answer_ = plan(world, start, goal, rng=0, budget=5000, step=0.5)
path = planning.shortcut(answer_.path, world, np.random.default_rng(0))
assert check_path(world, path, start, goal)
motion = time_parameterise(path, (1.0, 2.0), blend=0.2, free=world)
assert check_path(world, motion.waypoints(0.02))  # with its corners rounded
print(f"{answer_.status}: {answer_.samples} samples, {answer_.state_checks} collision checks")
print(f"path {length(path):.2f} m, motion {motion.duration:.2f} s")

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(3.4, 3.2), layout="constrained")
turn = np.linspace(0.3, 2 * np.pi - 0.3, 100)
_ = axis.fill(
    np.append(np.cos(turn), 1.3 * np.cos(turn[::-1])),
    np.append(np.sin(turn), 1.3 * np.sin(turn[::-1])),
    color=ROSE,
)
turn = np.linspace(0.25, 2 * np.pi - 0.25, 100)
edge_ = np.hstack(
    [r * np.array([np.cos(turn), np.sin(turn)])[:, ::k] for r, k in ((0.95, 1), (1.35, -1))]
)
_ = axis.plot(*edge_[:, np.r_[:200, 0]], "--", color=GREY, lw=0.8)
branches(axis, answer_.nodes, answer_.parents, BLUE, 0.7)
_ = axis.plot(*motion.waypoints(0.02), color=GREEN, lw=2.5)
ends(axis, start, goal)
bare(axis, "two trees (blue, purple), shortened path", -2.0, 2.0)
plt.show()

# %% [markdown]
# What should a planner do with bad input? A wrong *argument* is the caller's mistake and raises an error that names it.
# A start in collision is a normal situation for a robot and gets a *status*, so that the level above can react:

# %% tags=["show-code"]
gap = scenes.gap(0.1)
for attempt in (
    lambda: plan(gap.world, [1.0, np.nan], gap.goal),
    lambda: plan(gap.world, gap.start, gap.goal, step=0.0),
    lambda: plan(gap.world, [1.0, 1.0, 1.0], gap.goal),
):
    try:
        attempt()
    except ValueError as problem:
        print("ValueError:", problem)
for start, goal in (([5.0, 1.0], gap.goal), (gap.start, [5.0, 1.0]), (gap.start, [11.0, 1.0])):
    print("status:", plan(gap.world, start, goal).status)

# %% [markdown]
# ## 6 · Speed: from seconds to milliseconds
#
# <div class="alert alert-block alert-info">
#
# **Interview question.** *Your robot plans a path to an object at the back of a cluttered shelf. RRT takes five
# seconds. Get it under a tenth of a second.*
#
# </div>
#
# Take the seven-joint arm and its two shelves from section 2, and a single RRT in plain Python with a step size of 1
# rad. Most of its queries are unsolved after five seconds. Most of the space in front of the shelf is free, and the
# compartments are its narrow passages.

# %%
predict("first_of_ten_ideas")

# %% [markdown]
# The table lists twelve versions. Most change one thing in an earlier one ("as 2"); versions 9 and 10 are new starts
# with a roadmap. The single trees and version 9 stop after 20,000 samples, the others after 200,000; with more samples
# they might solve more. Version 1 also stops after five seconds.
#
# The test has 100 queries that have a solution when nothing has moved. Version 1 was run on every 20th of them,
# versions 2 to 4 on every 10th, the others on all. (Section 9 explains "32 points at a time".) Each query was run once
# with the shelf unchanged (*still* in the chart; the table shows only this case) and once with a ball in front of it
# (*moved*).
#
# The chart shows versions 5 to 12, which were run on all 100 queries: the median and the slowest query. A triangle at
# the top edge means that at least one query stayed unsolved. If that is true of both *still* and *moved*, one triangle
# covers the other. The dashed lines skip such a version.
#
# ![Planning time of eight versions at two shelves, median and slowest query](../docs/charts/shelf_ladder.png)

# %% tags=["hide-code"]
VERSIONS = {
    "RRT in Python": "RRT in plain Python, steps of 1 rad",
    "compiled": "as 1, compiled",
    "in batches": "as 2, 32 points at a time",
    "edges proved": "as 2, edges by conservative advancement",
    "longer steps": "as 4, steps of 2.6 rad",
    "from both ends": "as 5, but RRT-Connect",
    "both, in batches": "as 6, 32 points at a time",
    "bridge sampler": "as 6, with bridge samples",
    "lazy PRM": "lazy roadmap, built per query",
    "cached, by a list": "stored roadmap, ends joined to neighbours",
    "cached, by trees": "as 10, ends joined by small trees",
    "earlier paths too": "as 11, with earlier paths added",
}
ladder = {
    (name.strip(), shelf): (f"{solved} of {goals}", *(x.replace("inf", "none") for x in spent))
    for name, shelf, solved, goals, *spent in key(
        "shelf_ladder",
        r"^(.{17}) still (open|tight) +(\d+) of +(\d+), ms: median +(\S+), slowest +(\S+);",
    )
}
built = key("shelf_ladder", r"^(open|tight) shelf: .* built in (\S+) s;")
rows = table(
    (
        "version (shelf unchanged)",
        "open shelf: solved",
        "median [ms]",
        "slowest [ms]",
        "tight shelf: solved",
        "median [ms]",
        "slowest [ms]",
    ),
    *(
        (f"{k}. {title}", *ladder[name, "open"], *ladder[name, "tight"])
        for k, (name, title) in enumerate(VERSIONS.items(), 1)
    ),
)
once = " and ".join(f"{seconds} s at the {shelf} shelf" for shelf, seconds in built)
# Three of the first versions with the ball: compiled, the medians are finite and the edges the same.
(*_, few_), (solved_, of_, points_, edges_), (*_, proof_, _) = key(
    "shelf_ladder",
    r"^(?:RRT in Python|compiled|edges proved) +moved open +(\d+) of +(\d+), "
    r"ms: median +(\S+), .*; +(\d+) edges",
)
Markdown(
    f"{rows.data}\n\nNot in the table: building the stored roadmap once took {once}. With the ball, "
    f"at the open shelf, version 1 checks {few_} edges within five seconds. Versions 2 and 4 each check "
    f"{int(edges_):,} edges, in {float(points_) / 1e3:.2g} s and {float(proof_) / 1e3:.2g} s, and solve "
    f"{solved_} of {of_} queries. That is more than without the ball, but with so few queries this can be chance. "
    "(These numbers of edges and seconds are medians.) All times exclude shortcuts, and we did not "
    "compare path lengths."
)

# %% [markdown]
# What each version contributed:
#
# * *1 to 4.* One tree with short steps. Versions 1 to 3 check points 0.01 rad apart. Versions 2 and 4 make the edge
#   check much faster (numbers below the table). But in the table, none solves more than half of its queries.
# * *5. Longer steps* (OMPL's default). Nearly all queries are solved.
# * *6. RRT-Connect.* It solves the rest, and the median falls. Its limit is ten times that of version 5, but with the
#   shelf unchanged no query needed more than 20,000 samples.
# * *7. Batches of points 0.05 rad apart* (section 9). By the median, slightly faster than version 6 at the open shelf,
#   slightly slower at the tight one. For this check, spheres up to 2 % thicker than the arm cover it: a few starts and
#   goals collide.
# * *8. Bridge samples.* Median and slowest query take longer.
# * *9. A lazy roadmap, built per query.* Slower than RRT-Connect in the median, and some queries stay unsolved.
# * *10 and 11. A stored roadmap.* Version 10 joins start and goal to near nodes by straight edges, and uses RRT-Connect
#   where that fails. In version 11 a small tree grows from each end until it reaches the roadmap. Its slowest query
#   beats that of version 6 in all four cases.
# * *12. Earlier paths added.* No consistent gain: the median is longer in three of four cases.
#
# By the median, version 5 already meets the required tenth of a second. With the shelf unchanged, versions 6 and 10 to
# 12 meet it in every query; with the ball, only 11 and 12 do (chart). One run per query is weak evidence: repeat with
# other seeds before you promise it.
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** *How do you speed up planning?* (1) Measure two numbers: how many checks, and what one costs. (2)
# Reduce the number first, since that decides whether a query is solved at all: longer steps or a second tree. (3) Make
# the check cheap: simple shapes, compiled or vectorised code. (4) Reuse: a stored roadmap, checked lazily.
#
# </div>

# %%
more_claims("both_ends_first")

# %% [markdown]
# ### Compared with OMPL
#
# We ran the RRT-Connect of the library OMPL in two ways: with a Python function that checks single configurations
# (*Python states* in the chart), and with our compiled edge check, which OMPL calls through Python once per edge.
# World, step size and goal are the same. A path that `check_path` rejects counts as no path.
#
# ![Share of seeds with a valid path against time, compared with OMPL, in four scenes](../docs/charts/plan_times.png)

# %% tags=["hide-code"]
SCENES = {
    "discs": "discs",
    "gap 10%": "wall with a 10 % gap",
    "gap 2%": "wall with a 2 % gap",
    "4-link arm": "four-link arm",
    "7-R arm": "seven-joint arm at the shelf",
}
pattern = (
    r"^(.*?) {2,}(ours|OMPL, our edge check|OMPL, Python states) +median +(\S+) ms, +(\S+) of ours; "
    r"(\d+) of (\d+)"
)
measured = {
    (a, b): rest for name in ("plan_times", "shelf_times") for a, b, *rest in key(name, pattern)
}
table(
    (
        "scene",
        "this course, median [ms]",
        "OMPL, our edge check",
        "OMPL, Python function",
        "Python function: paths in collision",
    ),
    *(
        (
            title,
            measured[name, "ours"][0],
            f"{measured[name, 'OMPL, our edge check'][1]} times as long",
            f"{measured[name, 'OMPL, Python states'][1]} times as long",
            " of ".join(measured[name, "OMPL, Python states"][2:]),
        )
        for name, title in SCENES.items()
    ),
)

# %% [markdown]
# With the same compiled edge check, OMPL takes about as long as our planner in most scenes, and several times as long
# at the 2 % gap. With the discs and the 10 % gap, nearly all of our time is the fixed cost of a call. At the 2 % gap
# hundreds of edges are checked, and OMPL calls Python for each, which takes more than half of its time. The curve
# *OMPL's own part* omits the time inside our edge check, but not the cost of calling it from C++.
#
# In the last two columns of the table, two things change at once: the check runs in Python, and it tests points instead
# of whole edges. We did not separate the two. At OMPL's default spacing, 1 % of the diagonal of the space, some of the
# returned paths are in collision. (*OMPL, Python, 0.2%* has a fifth of that spacing.)
#
# In all scenes but the 2 % gap, the two changes together cost far more time than the choice between the two
# implementations of RRT-Connect. So use the library, and spend your effort on a compiled edge check.
#
# <details><summary>Samples of both planners, and the seven-joint arm in detail</summary>
#
# Is it the same algorithm? Both planners were run with 500 seeds each. If they implement the same algorithm, the
# numbers of samples have the same distribution. A rank test gives *p*, the probability that two identical planners
# would differ by at least this much by chance. For RRT and RRT-Connect *p* is above 0.05 in all scenes. RRT\* differs
# among the discs as long as ours keeps sampling the goal after it is in the tree, which OMPL stops doing; with the same
# rule the difference disappears.
#
# ![Samples, path lengths and success of both implementations](../docs/charts/sample_counts.png)
#
# ![The seven-joint arm at the shelf: share of queries with a valid path against time](../docs/charts/shelf_times.png)
#
# </details>

# %%
more_claims("ompl_defaults")

# %% [markdown]
# ## 7 · Debug: where planning fails
#
# ### Narrow in how many directions?
#
# "It has seven joints, so planning is hard" is a common excuse. What counts is in how many directions a passage is
# narrow. Compare three openings in a wall. A *slab* is narrow in one direction only, like a door. A *hole* is narrow in
# every direction along the wall, which is thin. A *tunnel* is the same hole in a wall as thick as the hole is wide.

# %% tags=["hide-code"]
figure_ = plt.figure(figsize=(8.5, 2.9), layout="constrained")
hole = ((-1, -1, 2, 0.85), (-1, -0.15, 0.85, 0.3), (0.15, -0.15, 0.85, 0.3))  # top cut away
shapes = (
    ("slab: narrow in one direction", 0.06, ((-1, -1, 0.85, 2), (0.15, -1, 0.85, 2))),
    ("hole: narrow in both\n(wall above it cut away)", 0.06, hole),
    ("tunnel: the same, in a thick wall\n(wall above it cut away)", 0.3, hole),
)
for k, (title, thick, pieces) in enumerate(shapes):
    axis = figure_.add_subplot(1, 3, k + 1, projection="3d", proj_type="ortho")
    y, z, wide, tall = np.array(pieces).T
    axis.bar3d(-thick / 2, y, z, thick, wide, tall, color=ROSE, edgecolor=RED, lw=0.6, shade=False)
    for end_x in (-1, 1):  # in two parts, so that the nearer one is drawn in front of the wall
        _ = axis.plot([0, end_x], [0, 0], [0, 0], color=GREEN, lw=2.5, zorder=5 if end_x > 0 else 0)
    _ = axis.set_title(title, fontsize=9)
    _ = axis.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1), xticks=(), yticks=(), zticks=())
    axis.view_init(35, -30)
    axis.computed_zorder = False
plt.show()

# %% [markdown]
# On the left, the chart shows the probability that two random points, one on each side of the wall, see each other
# through the opening. On the right, it shows how many samples RRT-Connect needs. In each direction in which an opening
# is narrow, it is a tenth of the wall wide.
#
# ![Probability that two points are joined through a slab, a hole and a tunnel, and samples that RRT-Connect needs, by
# dimension](../docs/charts/narrow_passages.png)
#
# On the left we sampled 100,000 pairs for each point; a curve ends where none of them saw each other. On the right, a
# filled triangle at the top edge means that the median exceeds the budget. At dimension 5 it does so for hole and
# tunnel, in both implementations. For the hole, the bands (quartiles of 100 runs) span a factor of more than ten. So a
# median is uncertain by a factor of two, and a difference between the two implementations can be chance.
#
# In seven dimensions the slab still needs only a few samples. The hole gets harder by a large factor with each
# dimension. So count the directions in which your passage is narrow, and remove some of them: first plan to a
# configuration in front of the slot, with the gripper already aligned; then move straight in.
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The planner finds no path.* Check in this order. (1) Are start and goal free in the planner's own
# model of robot and scene? (2) Where is it narrow? Shrink the obstacles until a path appears; where it squeezes
# through is your passage. (3) Use two trees. (4) Try other step sizes, longer and shorter. (5) Allow more samples, and
# place some in the passage. (6) Only then try another planner.
#
# <details><summary>What people get wrong</summary>
#
# They raise the goal bias, which pulls the tree against the wall. They raise the time limit of a query that has no
# solution. And they plan for the tip in three dimensions and lose the elbow.
#
# </details>
#
# </div>
#
# Why also longer steps? Surely a narrow passage needs a *small* step? With an exact edge check, a long edge is as safe
# as a short one. A long step lets a lucky sample reach straight through the opening; short ones need many nodes to get
# there.

# %%
show("step_through_a_passage")

# %% [markdown]
# The card's explanation counts samples; a long edge also takes longer to check.
#
# ### Slow only sometimes
#
# Planning times have a heavy tail: a few runs take far longer than the median. If that is bad luck of the random
# numbers, restart with another seed. If some queries are simply harder, look at those. Solving 36 queries at the tight
# shelf with five seeds each separates the two causes, for RRT-Connect.

# %%
show("slow_plans_are_slow_questions")

# %% [markdown]
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The motion is jerky, or far too long.* Find out which of four it is. Corners in free space: use
# shortcuts. Jumps of the acceleration: limit the jerk. Stops at each waypoint: that is the timing; round the corners in
# passing. A long detour: the path passes an obstacle on its longer side, in another homotopy class. No spline changes
# that, and a shortcut only by luck; plan again, or use RRT\*.
#
# </div>
#
# <table> <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr> <tr><td>the path hits something thin</td>
# <td>edges are checked at points</td> <td><code>check_path</code>; halve the spacing</td> <td>use an exact edge check,
# or enlarge the obstacles as section 2 computes</td></tr> <tr><td>fast on average, sometimes far too slow</td> <td>some
# queries are hard, or a seed is unlucky</td> <td>look at the 99th percentile, counting failures as infinite; run the
# slow queries with other seeds</td>
# <td>look at their start and goal: take longer steps, or grow a small tree from each to a stored roadmap</td></tr>
# <tr><td>a different result in each run</td> <td>the seed or the time limit comes from the clock</td> <td>make the same
# call twice</td> <td>pass a seed; limit the number of samples instead of seconds</td></tr> </table>

# %%
more_claims("blocked_ends_are_named")

# %% [markdown]
# ### What the model leaves out
#
# A planner can't avoid a collision that its model doesn't contain. So far the arm may pass through itself, its hand is
# empty, and any motion is allowed.
#
# **Self-collision** and the **held object**. Check each pair of links that can meet. Once the gripper holds a cup, the
# cup is part of the robot: attach its shape to the hand, allow the contact between hand and cup, and treat every stored
# edge as unchecked. Conservative advancement still proves an edge if the reach $r_i$ includes the cup. Between two
# links of the arm, the gap can shrink by at most the sum of both motions.

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 4, figsize=(10, 2.6), layout="constrained")
q_ = np.array([0.2, 0.4])
x, y = links(q_)
_ = axes[0].plot(4 * x + 1, 4 * y + 1, "o-", color=BLUE, lw=4)
end_ = np.array([4 * x[-1] + 1, 4 * y[-1] + 1])
axes[0].add_patch(plt.Rectangle(end_ - [0.5, 0.9], 1.0, 1.8, fc="#f5d76e", ec="black"))
axes[0].add_patch(plt.Rectangle((5.5, 7.2), 4.2, 0.6, color=ROSE))
bare(axes[0], "held object: part of the robot")
turn = np.linspace(0.3, 2.6, 80)
curve = np.array([5 + 4.2 * np.cos(turn), 1.5 + 5.5 * np.sin(turn)])
_ = axes[1].plot(*curve, color=GREEN, lw=2.5)
rng = np.random.default_rng(5)
for p in rng.uniform(1, 9, (9, 2)):
    near_ = curve[:, np.argmin(np.linalg.norm(curve - p[:, None], axis=0))]
    _ = axes[1].annotate("", near_, p, arrowprops={"arrowstyle": "->", "color": GREY})
    _ = axes[1].plot(*p, "o", color=BLUE, ms=4)
bare(axes[1], "projection onto a manifold")
_ = axes[2].plot(*curve, color=GREEN, lw=2.5)
for first, last, ink in ((8, 72, RED), (72, 40, BLUE), (40, 8, BLUE)):
    ends_, middle = curve[:, [first, last]], (first + last) // 2
    _ = axes[2].plot(*ends_, "o-", color=ink, ms=4, lw=1.5)
    centre = ends_.mean(axis=1)
    foot = curve[:, np.argmin(np.linalg.norm(curve - centre[:, None], axis=0))]
    _ = axes[2].plot(*np.stack((centre, foot), axis=1), ":", color=ink, lw=1.5)
bare(axes[2], "half the step: a quarter of the distance")
for bend in (-0.5, -0.25, 0.0, 0.25, 0.5):
    heading = np.pi / 4 + bend * np.linspace(0, 3, 40)
    steps_ = 0.14 * np.cumsum([np.cos(heading), np.sin(heading)], axis=1)
    _ = axes[3].plot(*(np.array([[2.0], [2.0]]) + steps_), color=BLUE)
_ = axes[3].plot(2.0, 2.0, "o", color=GREEN, mec="black", ms=8)
bare(axes[3], "kinodynamic: simulated controls")
plt.show()

# %% [markdown]
# On the left, the chart shows what these checks cost: within each group of three bars, every bar adds one check to the
# bar above it. Both together triple the time of our edge check. On the right, it shows how many configurations and
# paths collide if the planner omits a check; *cup* counts only what passes the check of the arm against itself.
#
# The paths lead from compartment to compartment; the cup is 8 cm wide and 12 cm high. Starts and goals are free also
# with the cup. Still, nearly all paths planned without the cup collide once it is held. (*Coal*, a library for general
# shapes called from Python, confirms the results; its times are not comparable.)
#
# ![Time of a check with self-collision and a held cup, and collisions missed without
# them](../docs/charts/held_object.png)
#
# <details><summary>Which pairs are checked, and how a cup becomes capsules</summary>
#
# Links and hand are nine capsules. Capsules on the same link can't move against each other, and
# neighbouring links always overlap at their joint, so these pairs are left out. So are pairs that stay apart in ten
# thousand random configurations, as MoveIt's setup assistant does it. That makes a collision of such a pair unlikely
# and proves nothing.
#
# A box is covered by capsules. They reach beyond it, so some free configurations are rejected: the figures say how
# many, for one, four and nine capsules. Coal with Pinocchio, the standard libraries for this, judges the same capsules
# alike.
#
# </details>

# %%
figures(
    read("held_object"),
    "free edge, obstacles only",
    "free edge, and itself",
    "free edge, and a cup",
    summary="Times, collisions and plans",
)

# %%
more_claims("limits_keep_an_arm_from_itself")

# %% [markdown]
# **A constraint on the motion.** Carrying the cup upright removes two degrees of freedom. The allowed configurations
# form a curved surface, a **constraint manifold**, which a random sample never hits. CBiRRT (Berenson and others 2009)
# grows two trees and projects each new configuration onto the surface (second sketch). But the edge between two such
# configurations is straight and leaves the surface, so the cup tilts there. With half the step, this tilt falls to
# about a quarter (third sketch).
#
# The next plot shows a planned path. Each edge has an upper bound on its tilt, computed without check points. The bound
# stays below the allowed 1°.

# %% tags=["hide-code"]
from course.charts.planning.constraints import carried
from course.planning import manifold

shelf_ = planning.shelf("open").world
begin_, aim_ = carried("open", 4)
carried_ = manifold.cbirrt(shelf_, begin_, aim_, rng=4).path
assert check_path(shelf_, carried_, begin_, aim_)
figure_, axis = plt.subplots(figsize=(6.5, 2.7), layout="constrained")
share_ = np.linspace(0.0, 1.0, 40)[:, None]
direct = np.degrees(manifold.tilt(panda(), (begin_ + share_ * (aim_ - begin_)).T))
_ = axis.semilogy(share_, direct, color=RED, label="straight edge from start to goal")
worst_ = np.array(
    [
        np.degrees(manifold.tilt(panda(), (a + share_ * (b - a)).T)).max()
        for a, b in zip(carried_.T, carried_.T[1:], strict=False)
    ]
)
proved_ = np.degrees(manifold.chord_tilt(carried_[:, :-1], carried_[:, 1:]))
at_ = (np.arange(worst_.size) + 0.5) / worst_.size
_ = axis.plot(at_, proved_, "_", color=BLUE, ms=8, label="bound of each edge")
shown_ = np.maximum(worst_, 1.5e-5)  # a tilt of zero has no place on the axis
_ = axis.plot(at_, shown_, ".", color=GREEN, label="largest tilt on each edge of CBiRRT's path")
_ = axis.axhline(1.0, color=GREY, ls=":")
_ = axis.text(0.5, 1.4, "allowed: 1°", fontsize=8, color=GREY, ha="center")
_ = axis.set(xlabel="share of the motion", ylabel="tilt of the cup [°]", ylim=(1e-5, 300))
_ = axis.legend(fontsize=7.5, loc="lower center", ncols=3, bbox_to_anchor=(0.5, 1.0))
plt.show()
side_ = "below" if worst_.max() < 1 else "above"
direct_ = f"{direct.max():.0f}° on the straight edge"
print(f"largest tilt: {direct_}, {side_} 1° on each edge of CBiRRT's path")

# %% [markdown]
# The edges must be checked for collisions as well. In OMPL's constrained spaces, only configurations at a spacing that
# you choose are checked, so its paths can collide.
#
# <details><summary>Projection, and a bound on the tilt between two states</summary>
#
# *Projection.* Let $u(q)$ be the direction of the cup's axis in the world. The constraint says that its two horizontal
# components are zero. Let $e$ be the rotation about a horizontal line that would make the axis vertical (two numbers),
# and $J$ the two rows of the Jacobian that say how the joints turn the hand about horizontal lines. The shortest joint
# motion with this rotation, to first order, is
#
# $$\Delta q = J^\top (J J^\top)^{-1} e .$$
#
# Apply it, compute $e$ again, and repeat until the tilt is below a millionth of a radian. It fails where no joint turns
# the cup about some horizontal line, or where the result leaves the joint limits.
#
# *Between two states.* When joints $i$ and $j$ turn, the second derivative of $u$ is $z_i \times (z_j \times u)$, with
# the joint axes $z_i$ and $z_j$. It is no longer than 1. So along a straight edge, with its share from 0 to 1 as the
# parameter, the second derivative is at most $(\sum_k |\Delta q_k|)^2$. A function that is zero at both ends and has a
# second derivative of at most $C$ stays below $C/8$ in between:
#
# $$\sin(\text{tilt}) \le \tfrac18 \Bigl(\sum_k |\Delta q_k|\Bigr)^2 .$$
#
# **A worked example.** The joints of an edge move by 0.37 rad in total. The bound is $0.37^2/8 = 0.017$, a tilt of just
# under 1°. The planner makes its steps nine tenths of what the bound allows at most, and gives up an extension if the
# projection takes an edge beyond the bound.
#
# *The chart.* Left: the largest tilt on an edge against the step. *Paths, worst* is the worst edge of all planned
# paths, *bound* the upper bound for these edges, *random edge* the median of random edges. Without a proof, a long step
# tilts the cup more than allowed on some edge. The bound forbids a step earlier than necessary, because it adds up the
# motions of all joints as if each of them turned the cup. With the proof, any setting of the step is safe: the planner
# shortens a step that the bound does not allow.
#
# ![Tilt of the cup between projected states against the step, and share of queries solved, compared with OMPL's
# projected state space](../docs/charts/upright_cup.png)
#
# Right: our planner and OMPL's on 24 queries. *Ours, tilt proved* shortens each edge until its bound is below 1°;
# *ours, no proof* does not. Both prove that the arm hits nothing along an edge. OMPL's planner is RRT-Connect in its
# projected state space. We tried four ranges (the longest motion) with two distances between its checks. The chart has
# the pair that solves the most queries; the table also has the one with the least median time. A path that collides
# counts as unsolved, and in the median as infinitely slow.
#
# Don't take the times for a comparison of methods. OMPL calls Python functions for the constraint, its Jacobian and the
# collision check of each configuration; our planner is compiled. *OMPL's own part* omits the time inside these
# functions, but not that of calling them. The clock is the processor time of the thread.
#
# </details>

# %% tags=["hide-code"]
runs_ = {
    name: rest
    for name, *rest in key(
        "upright_cup",
        r"^(ours, tilt proved|ours, no proof|OMPL, range \S+, states \S+): median (\S+) ms, (\d+) of "
        r"(\d+) solved, worst tilt (\S+) degrees; (\d+) of (\d+) paths",
    )
}
((best_,),) = key("upright_cup", r"^drawn of OMPL's is (.+) rad, which")
best_ = f"OMPL, {best_}"
# Of OMPL's settings: the drawn one, which solves the most queries, and the one with the least median.
fast_ = min((name for name in runs_ if "OMPL" in name), key=lambda name: float(runs_[name][0]))
titles_ = {"ours, tilt proved": "ours, tilt proved", "ours, no proof": "ours, no proof"} | {
    name: f"OMPL, checked every {name.split('states ')[1]} rad" for name in (best_, fast_)
}
titles_[best_] += " (*OMPL, most solved*)"
rows = table(
    (
        "planner",
        "paths returned",
        "of these in collision",
        "queries solved",
        "largest tilt [°]",
        "median time [ms]",
    ),
    *(
        (
            title,
            runs_[name][5],
            runs_[name][4],
            "{1} of {2}".format(*runs_[name]),
            runs_[name][3],
            runs_[name][0],
        )
        for name, title in titles_.items()
    ),
)
((step_, sure_),) = key("upright_cup", r"above a step of (\S+) rad, the bound above (\S+) rad$")
summary_ = "The planners for the upright cup: collisions, tilts, times"
Markdown(
    f"<details><summary>{summary_}</summary>\n\n{rows.data}\n\nWithout a proof, the worst edge of the "
    f"paths tilts the cup by more than 1° above a step of {step_} rad. The bound proves less than 1° up "
    f"to {sure_} rad.\n\n</details>"
)

# %%
figures(read("upright_cup"), summary="Steps, tilts and OMPL's settings")

# %% [markdown]
# **Dynamics.** A fast arm can't turn a corner at full speed. **Kinodynamic** planning has velocities in its states and
# limits of acceleration in its edges. The RRT of LaValle and Kuffner (2001) simulates random controls from the node
# nearest to a sample, and adds the result that comes closest to the sample (fourth sketch). We tried it with a point of
# limited acceleration among 150 posts, 6 cm thick, in a square of 10 m. Two results:
#
# * Of the trajectories that were checked only at points 0.1 s apart, nearly half hit a post. With a margin that covers
#   the motion between two points, none did.
# * Which node is *nearest*? When we chose the one from which the sample could be reached soonest if there were no
#   posts, the trajectories lasted less than two thirds as long as with the Euclidean distance, in which 1 m/s counts
#   like 1 m.
#
# <details><summary>The comparison in detail: planners, lower bound, margin between points</summary>
#
# *The loop.* Sample a state, position and velocity. Find the node from which it is nearest. From there, simulate
# several random constant accelerations and add the end that comes nearest to the sample. The straight segment of RRT is
# replaced by a parabola, so a node is reached exactly, and the goal only within a tolerance. With Euclidean distance a
# fast point just before the goal counts as near, though it can't stop there.
#
# *The planners* in the chart differ in three choices. Nearest node: by Euclidean distance of position and velocity
# (*Euclidean*), or by the time to the sample if there were no posts (*minimum time*). Check: at points 0.1 s apart
# (*points*), or at such points with the margin (*proved*). Controls per sample: eight, but only one in *one control*,
# which checks points.
#
# ![A kinodynamic tree compared with its lower bound and with OMPL, and posts that check points
# miss](../docs/charts/kinodynamic_bounds.png)
#
# OMPL measures Euclidean distance, checks points and, from Python, can try only one control per sample. So *Euclidean,
# one control* is our planner with its rule: both need about as many samples. OMPL calls Python for each simulated
# point, so don't compare its planning time with the others. We tried four limits for how long a control lasts and drew
# the one with the least median. The clock is the processor time of the thread.
#
# *The bound.* One axis goes from rest to rest over a distance $d$ with full acceleration $a$ one way and then the other
# (**bang-bang**), in $2\sqrt{d/a}$. Both axes have to finish, so the slower one decides. **A worked example.** 8 m
# along both axes at 1 m/s² take at least $2\sqrt 8 = 5.7$ s.
#
# *Between the points.* The simulation checks points a time $\Delta t$ apart. Between two of them the motion leaves the
# chord by at most $|a|\,\Delta t^2/8$. A point of a chord of length $L$, at a distance $x$ from one end, keeps a
# clearance of at least $c_1 - x$ and of at least $c_2 - (L - x)$, and the larger of the two is at least their mean. So
# where the clearances $c_1$ and $c_2$ at both ends have a mean above $L/2 + |a|\,\Delta t^2/8$, the motion in between
# is free.
#
# The lower plots show both sides: points alone miss posts as the geometry predicts, and with the margin
# nothing is hit. The price of the margin is a longer search: compare *Euclidean, proved* with *Euclidean, points*.
#
# </details>

# %% tags=["hide-code"]
((best_,),) = key("kinodynamic_bounds", r"^drawn of OMPL's is (.+) of a control, the least")
rows = table(
    (
        "planner",
        "solved",
        "of these, hit a post",
        "time of the trajectory / lower bound",
        "median planning time [ms]",
    ),
    *(
        (
            "OMPL, points" if name.startswith("OMPL") else name,
            f"{solved} of {queries}",
            hits,
            excess,
            spent,
        )
        for name, solved, queries, spent, excess, hits in key(
            "kinodynamic_bounds",
            r"^(.+?): (\d+) of (\d+) solved, median \d+ samples and (\S+) ms; time over the lower "
            r"bound (\S+) .*; (\d+) hit a post",
        )
        if not name.startswith("OMPL") or name == f"OMPL, {best_}"
    ),
)
summary_ = "The planners of the comparison: solved, posts hit, times"
Markdown(f"<details><summary>{summary_}</summary>\n\n{rows.data}\n\n</details>")

# %%
figures(read("kinodynamic_bounds"), summary="Samples, times and posts hit")

# %% [markdown]
# ## 8 · Exercises
#
# As a warm-up, write the RRT of section 2: `drills start rrt` in a terminal. The `check` cells run your function in a
# separate process, on cases that are generated each time.
#
# ### Clearance of a straight edge

# %%
card("edge_clearance")


# %%
def edge_clearance(a, b, discs):
    """Return the clearance between a straight edge and each disc."""
    # The nearer end alone.
    discs = np.asarray(discs, dtype=float).reshape(-1, 3)
    ends = [np.hypot(*(discs[:, :2] - np.asarray(end)).T) for end in (a, b)]
    return np.minimum(*ends) - discs[:, 2]


check(edge_clearance)

# %% [markdown]
# ### An edge, with a guarantee

# %%
card("edge_check")


# %%
def edge_check(lengths, discs, a, b):
    """Return how much of a straight motion of the joints of a planar arm is free of discs."""
    return 0.0 if np.not_equal(a, b).any() else 1.0


check(edge_check)

# %% [markdown]
# ### Greedy connect

# %%
card("rrt_connect")


# %%
def rrt_connect(start, goal, discs, samples, step):
    """Return a path for a point among discs from two trees, whose samples are given."""
    return np.zeros((0, 2)), np.array([1, 1])


check(rrt_connect)

# %% [markdown]
# ### Shortcuts

# %%
card("shortcut")


# %%
def shortcut(path, discs, draws):
    """Return a path among discs, shortened between drawn places."""
    return np.array(path, dtype=float)[[0, -1]]


check(shortcut)

# %% [markdown]
# ### A lazy query

# %%
card("lazy_prm")


# %%
def lazy_prm(points, edges, discs, start, goal):
    """Return the shortest free route of a roadmap, of which only what is needed is checked."""
    return np.array([start, goal]), 0


check(lazy_prm)

# %% [markdown]
# ### A trapezoid for several joints

# %%
card("trapezoid")


# %%
def trapezoid(start, end, speed, acceleration, times):
    """Return the quickest motion from rest to rest along a straight line of the joints."""
    q = np.outer(end, np.ones(len(times)))
    return 0.0, q, 0.0 * q


check(trapezoid)

# %% [markdown]
# ### Silent-bug hunt
#
# This RRT\* returns collision-free paths that get shorter as samples are added. It still contains a bug.

# %%
card("rrt_star")


# %%
def edge_is_free(a, b, discs):
    """Return whether the segment from a to b, each (2,), touches no disc, rows (x, y, radius) [m]."""
    along, to_centres = b - a, discs[:, :2] - a
    length_squared = max(float(along @ along), 1e-300)
    share = np.clip(to_centres @ along / length_squared, 0.0, 1.0)
    gaps = to_centres - share[:, None] * along
    return bool(np.all(np.hypot(gaps[:, 0], gaps[:, 1]) > discs[:, 2]))


def rrt_star(start, discs, samples, step, radius):
    """Return a tree of short paths (RRT*, Karaman and Frazzoli, 2011), whose samples are given."""
    discs = np.asarray(discs, dtype=float).reshape(-1, 3)
    nodes, parents, costs = [np.array(start, dtype=float)], [-1], [0.0]
    for target in np.asarray(samples, dtype=float):
        points = np.array(nodes)
        away = np.hypot(*(points - target).T)
        near = int(np.argmin(away))
        new = target
        if away[near] > step:
            new = points[near] + step / away[near] * (target - points[near])
        if not edge_is_free(points[near], new, discs):
            continue
        distance = np.hypot(*(points - new).T)
        around = [i for i in range(len(nodes)) if distance[i] <= radius]
        around = [i for i in around if i == near or edge_is_free(points[i], new, discs)]
        parent = min([near, *around], key=lambda i: costs[i] + distance[i])
        cost = costs[parent] + distance[parent]
        for i in around:
            saved = costs[i] - (cost + distance[i])
            if saved > 0.0:
                parents[i] = len(nodes)
                costs[i] -= saved
        nodes.append(new)
        parents.append(parent)
        costs.append(cost)
    return np.array(nodes), np.array(parents), np.array(costs)


check(rrt_star)

# %% [markdown]
# ### Few distance evaluations

# %%
card("certify_edge")


# %%
def certify_edge(clearance, half, a, b):
    """Return whether a capsule moves along a straight edge without a collision."""
    # Ten poses along the edge: enough for thick obstacles only.
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    return float(all(clearance(a + s * (b - a)) > 0.0 for s in np.linspace(0.0, 1.0, 10)))


check(certify_edge)

# %% [markdown]
# ### A formula: what points miss
#
# Check points are a distance $s$ apart on a straight edge, and an obstacle is a disc of radius $r > s/2$. How deep can
# the edge enter the disc while none of the points is inside? In the worst case, two neighbouring points lie on the
# circle, and the edge is deepest halfway between them. Enter a formula in `s` and `r`; any equivalent form is accepted.
# <span class="kernel-only">Replace the text in quotation marks.</span>

# %%
answer("edge_by_ten_points", "s^2/(8*r)")

# %% [markdown]
# ### Put it into your robot
#
# Your graded answers are parts of the pick-and-place robot of `drills robot`.

# %%
your_robot(5)

# %% [markdown]
# ## 9 · Frontier: planners that learn, and planners in microseconds
#
# ### A learned sampler
#
# Random samples ignore everything that earlier queries taught us. A network can do better: show it many solved
# problems, and let it predict where solutions run. The network's input is an **occupancy grid**, an image that marks
# which cells are free, together with start and goal. Its output is a map of the cells through which solution paths are
# likely to pass. The planner (here RRT-Connect) samples from this map, plus a share of uniform samples so that it stays
# probabilistically complete.
#
# The test worlds have three walls with one slit each. The first panel of the chart shows one of them with the proposed
# samples, the second the worlds of the training family, the third the same worlds rotated by 90°. On the curve *bridge
# test, a fifth*, one sample in five comes from a bridge test. We did not tune the bridge's length, so it is no fair
# comparison. The last panel belongs to the diffusion model, which comes next.
#
# ![A learned sampler and a diffusion planner, compared with methods without
# learning](../docs/charts/learned_planners.png)

# %% tags=["hide-code"]
NAMES = {
    "uniform": "uniform samples",
    "learned": "learned sampler (filling the grid not counted)",
    "grid search": "samples along a plain grid search (filling the grid not counted)",
    "learned, grid counted": "learned sampler, checks to fill the grid counted",
    "turned: uniform": "uniform samples, worlds rotated by 90°",
    "turned: learned": "learned sampler, worlds rotated by 90°",
}
checks = {
    a.strip(): rest
    for a, *rest in key(
        "learned_planners",
        r"^(.{24,32}?) median +(\d+) checks \((\d+) to (\d+) by seed\), 90 % within (\d+)",
    )
}
rows = [
    (
        "where samples come from",
        "collision checks in the median of 200 worlds, by three seeds and networks: middle (smallest to largest)",
        "90 % of the worlds within",
    )
]
for name, title in NAMES.items():
    middle, least, largest, tail = (f"{int(n):,}" for n in checks[name])
    rows.append((title, f"{middle} ({least} to {largest})", tail))
table(*rows)

# %% [markdown]
# So ask three questions about a learned sampler. What does its *input* cost? For an arm, a camera shows only the
# workspace, not which configurations are free. The table counts the check of one grid cell as much as that of a whole
# edge. Counted so, filling the grid (1,024 cells) costs more than the median query saves; only the hard queries still
# gain. What would a *simple* method such as a grid search make of the same input? And how far is your world from those
# of the training?
#
# If every edge is checked exactly, a bad sampler can't make a path collide. As long as uniform samples are mixed in, it
# can only make the planner slow.

# %%
more_claims("learned_sampler_speeds_up")

# %% [markdown]
# ### Diffusion: whole paths from noise
#
# A **diffusion model** learns to remove noise. Take solved paths, add random noise in many small steps, and train a
# network to undo one step. Run backwards from pure noise, it produces new paths. Ours receives start and goal and was
# trained in a single world of discs. Nothing in the training ever says "collision": the network imitates the shape of
# paths that happened to be free.

# %% tags=["hide-code"]
rng = np.random.default_rng(2)
figure_, axes = plt.subplots(1, 4, figsize=(10, 2.7), layout="constrained")
t = np.linspace(0.0, 1.0, 32)
clean = plan(scene.world, scene.start, scene.goal, rng=4, step=1.0).path
clean = planning.smooth(planning.shortcut(clean, scene.world, rng), scene.world)
at_ = np.insert(np.cumsum(np.linalg.norm(np.diff(clean), axis=0)), 0, 0.0)
clean = np.array([np.interp(t, at_ / at_[-1], row) for row in clean])
noise = rng.standard_normal(clean.shape)
noise[:, [0, -1]] = 0.0
for axis, share in zip(axes, (0.1, 0.6, 0.95, 1.0), strict=True):
    obstacles(axis, scene.world)
    mixed = np.sqrt(share) * (clean - 5.0) + np.sqrt(1.0 - share) * 2.5 * noise + 5.0
    mixed[:, [0, -1]] = clean[:, [0, -1]]
    _ = axis.plot(*mixed, ".-", color=BLUE, lw=0.8, ms=3)
    ends(axis, scene.start, scene.goal)
    bare(axis, f"{1 - share:.0%} of the variance is noise" if share < 1 else "no noise left")
plt.show()

# %% [markdown]
# The sketch shows one solved path with less and less noise. Are the paths from the network collision-free?

# %%
show("diffusion_is_collision_free")

# %% [markdown]
# In the last panel of the chart, *diffusion, checked* returns the first of eight proposals that is free; if none is,
# the query stays unsolved. *Pushed out* first moves each proposal out of the discs with an optimiser. *Bent lines* are
# untrained guesses. RRT-Connect with shortcuts is the fastest here, in the plane and on one CPU core. After the
# optimiser, bent lines are faster in the median than the proposals of the diffusion model, and slower on the hardest
# queries.
#
# Of each planner that learns, ask what guarantees that the result is free: was a collision check passed, or was only a
# cost low?
#
# <details><summary>Five often cited planners that learn, and what makes their result collision-free</summary>
#
# <table> <tr><th>work</th> <th>year</th> <th>what it does</th> <th>what makes the result collision-free</th></tr>
# <tr><td>MPNet (Qureshi and others, arXiv 1806.05767)</td> <td>2018</td> <td>a network reads the obstacles as an
# encoded point cloud (measured points on their surfaces) and predicts the next configuration, by turns for a path from
# the start and one from the goal</td> <td>a check; a classical planner where it fails</td></tr> <tr><td>Learned
# sampling distributions (Ichter, Harrison and Pavone, ICRA)</td> <td>2018</td> <td>a generative network proposes
# samples where solutions were</td> <td>the planner's check; uniform samples are mixed in</td></tr> <tr><td>Diffuser
# (Janner and others, ICML)</td> <td>2022</td> <td>denoises a whole trajectory, guided by a reward, a score for each
# step</td> <td>nothing</td></tr> <tr><td>Diffusion Policy (Chi and others, RSS)</td> <td>2023</td> <td>denoises short
# chunks of actions from images</td> <td>nothing; it is a policy, not a planner</td></tr> <tr><td>Motion Planning
# Diffusion (Carvalho and others, arXiv 2308.01557)</td> <td>2023</td> <td>a diffusion model makes likely trajectories;
# gradients of costs push them</td> <td>only its costs</td></tr> </table>
#
# </details>
#
# ### What the field uses now
#
# Vectorised planners check many configurations at once
# with the vector instructions of an ordinary CPU and report times in microseconds. Optimisers start from many guesses
# at once on a graphics card. Convex formulations plan through convex regions of free space that were computed in
# advance. When one is called *faster*, ask for the **baseline**: faster than what?

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 3, figsize=(9.5, 2.9), layout="constrained")
for axis, batch, title in (
    (axes[0], 1, "one point at a time"),
    (axes[1], 4, "four points per instruction"),
):
    axis.add_patch(plt.Circle((6.5, 5.6), 1.1, color=ROSE))
    spots_ = np.linspace([1, 4.2], [9, 6.6], 12)
    _ = axis.plot(*spots_.T, color=GREY, lw=1)
    for k, p in enumerate(spots_):
        order = k if batch == 1 else k % 3
        _ = axis.plot(*p, "o", color=plt.cm.viridis(order / (11 if batch == 1 else 2)), ms=7)
        _ = axis.text(p[0], p[1] + 0.4, str(order + 1), fontsize=7, ha="center")
    bare(axis, title)
for x, y, wide, tall in ((2.3, 4.4, 1.3, 5.0), (7.2, 0.5, 0.9, 5.4)):
    axes[2].add_patch(plt.Rectangle((x, y), wide, tall, color=ROSE))
for corners in (
    [(0.3, 0.3), (7.0, 0.3), (7.0, 4.2), (0.3, 4.2)],
    [(3.8, 0.8), (7.0, 0.8), (7.0, 9.5), (3.8, 9.5)],
    [(4.2, 6.1), (9.7, 6.1), (9.7, 9.5), (4.2, 9.5)],
):
    axes[2].add_patch(plt.Polygon(corners, fc=BLUE, alpha=0.15, ec=BLUE))
_ = axes[2].plot([1.0, 4.2, 6.2, 9.0], [1.5, 3.6, 6.7, 8.8], color=GREEN, lw=2.5)
ends(axes[2], (1.0, 1.5), (9.0, 8.8))
bare(axes[2], "convex regions, computed in advance")
plt.show()

# %% [markdown]
# The number at each point of the edge says which instruction checks it. With four points per instruction, the first one
# already looks at all parts of the edge. On the right, three convex regions overlap; a path inside them is free without
# a check.
#
# <table> <tr><th>work</th> <th>year</th> <th>what it does</th> <th>what makes the result collision-free</th></tr>
# <tr><td>BIT* (Gammell, Srinivasa and Barfoot, arXiv 1405.5848); AIT* and EIT* (Strub and Gammell, arXiv
# 2111.01877)</td> <td>2015; 2022</td> <td>asymptotically optimal like RRT*, but search batches of samples in the order
# of estimated path cost; AIT* and EIT* improve the estimate with a search from the goal</td> <td>an edge check, made as
# late as possible</td></tr> <tr><td>STORM (Bhardwaj and others, CoRL, arXiv 2104.13542)</td> <td>2021</td> <td>samples
# joint motions on a graphics card at each control step and averages them</td> <td>only its costs, some of them
# learned</td></tr> <tr><td>Graphs of convex sets (Marcucci and others, arXiv 2205.04422)</td> <td>2023</td> <td>covers
# free space with convex regions; which regions the path uses is a yes-or-no choice; a convex problem that allows
# fractions is solved first, then the fractions become choices</td> <td>the regions, if they are free</td></tr>
# <tr><td>cuRobo (Sundaralingam and others, arXiv 2310.17274)</td> <td>2023</td> <td>nothing learned: many optimisations
# at once on a graphics card, some from guesses of a geometric planner</td> <td>costs during the optimisation; then a
# test of the result, with collision checks at its points</td></tr> <tr><td>VAMP (Thomason, Kingston and Kavraki, arXiv
# 2309.14545)</td> <td>2024</td>
# <td>nothing learned: RRT-Connect and PRM whose collision checks use the vector instructions of a CPU</td> <td>a check
# at points along each edge</td></tr> </table>
#
# We imitated VAMP's edge check for our arm, which we covered by spheres of a larger radius than the links. The excess,
# as a share of the radius, is the *swelling*; it is 0.1 where times are shown. We checked 32 points of an edge at a
# time:
#
# ![Time of an edge check in batches, free edges rejected, and collisions missed](../docs/charts/batch_edges.png)

# %% tags=["hide-code"]
edges_ = {
    (kind, check): row.split(", ")[2]
    for kind, check, row in key("batch_edges", r"^(\w+) edges, (.+?): (.+) µs$")
}
table(
    ("edge check", "a free edge [µs]", "a colliding edge [µs]"),
    *(
        (title, edges_["free", name], edges_["colliding", name])
        for title, name in (
            ("proof by conservative advancement", "conservative advancement"),
            ("batches of 32 points, 0.05 rad", "batches of 32"),
            ("the same points, one by one", "the same points, one by one"),
        )
    ),
)

# %% [markdown]
# At 0.05 rad and at this shelf, our batches beat the same points one by one, but not the proof. (With VAMP's spheres,
# used below, batches win on free edges.) Batches have two limits. Larger spheres reject free edges (third plot). And a
# collision can fall between two points.
#
# Let $h$ be the spacing and $c$ the length of the stretch of the edge that collides. If $h \le c$, a point always hits.
# If $h > c$, points with a random offset miss with probability $1 - c/h$. The fourth plot shows this for a pole 8 mm
# thick: left of the dotted line nothing is missed, right of it the missed share grows about as the formula says. The
# proof misses nothing on either side.
#
# How fast is VAMP itself? We gave both programs the 59 spheres of VAMP's Panda, the same obstacles and the same
# spacing, 1/32 rad:
#
# ![Time of an edge and of a plan compared with VAMP, and collisions that VAMP
# misses](../docs/charts/vamp_comparison.png)

# %% tags=["hide-code"]
AMONG = "30"  # balls
names_ = {
    "VAMP": "VAMP",
    "batches of 32": "our batches of 32",
    "conservative advancement": "our proof",
}
spent_ = {
    (kind, name): re.search(rf"\b{AMONG}: (\S+) ", row)[1]
    for kind, name, row in key("vamp_comparison", r"^(free|colliding) edge, (.+?), by balls: (.+)$")
}
plans_ = {
    name.removeprefix("ours, "): rest
    for name, *rest in key(
        "vamp_comparison",
        r"^plan, (.+?): median (\S+) ms \((\S+) to (\S+)\), .*; (\d+) of (\d+) solved; (\d+) paths not",
    )
}
rows = table(
    (
        "program",
        f"a free edge, {AMONG} balls [µs]",
        "a colliding edge [µs]",
        "a plan at the shelf, median (quartiles) [ms]",
        "plans found",
        "of these not confirmed by our proof",
    ),
    *(
        (
            title,
            spent_["free", name],
            spent_["colliding", name],
            "{} ({} to {})".format(*plans_[name]),
            "{3} of {4}".format(*plans_[name]),
            plans_[name][5],
        )
        for name, title in names_.items()
    ),
)
faster_ = float(spent_["free", "batches of 32"]) / float(spent_["free", "VAMP"])
((search_,),) = key("vamp_comparison", r"and its own search takes (\S+) ms$")
pole_ = {
    name: (int(missed_below) + int(missed_above), int(below) + int(above))
    for name, missed_below, below, missed_above, above in key(
        "vamp_comparison",
        r"^(its planners|validate_motion), .*; (\d+) of (\d+) missed at ratios up to 1, (\d+) of (\d+) above",
    )
}
Markdown(
    f"{rows.data}\n\nAmong {AMONG} balls, VAMP checks a free edge {faster_:.0f} times as fast as our batches. A plan "
    f"includes the call from Python; VAMP's search alone takes {float(search_):.2g} ms in the median. Of "
    f"{pole_['its planners'][1]:,} collisions with the pole, the points of VAMP's planners miss "
    f"{pole_['its planners'][0]}, those of its Python function `validate_motion` {pole_['validate_motion'][0]:,}."
)

# %% [markdown]
# VAMP checks the arm against itself as well, which our batches do not. Its planners miss only collisions shorter than
# their spacing, too few for the last plot. `validate_motion` takes one point per radian, at least eight on an edge, and
# misses as the formula says; don't validate a path with it.
#
# BIT* was run where the shortest path is known exactly, with edge checks counted instead of time. (Lower plot: graphs
# of convex sets, see the fold.)
#
# ![Excess length against edge checks, and against convex regions](../docs/charts/informed_and_convex.png)

# %% tags=["hide-code"]
excess_ = {
    (place, method): [(int(n), float(e)) for n, e in re.findall(r"(\d+): (\S+)%", row)]
    for place, method, row in key(
        "informed_and_convex", r"^(one disc|gap 10%), (.+), by checks: (.+)$"
    )
}


def needed(method):
    """Return the edge checks after which a method is within 1 % around the disc, in the median."""
    return f"{next(n for n, e in excess_['one disc', method] if e <= 1.0):,}"


(early_, without_path_), (first_, late_) = excess_["gap 10%", "OMPL BIT*"][:2]
longer_ = late_, dict(excess_["gap 10%", "RRT-Connect, shortcuts"])[first_]
assert without_path_ == np.inf
Markdown(
    f"Around the disc, the median path is within 1 % of the shortest after {needed('OMPL BIT*')} edge checks of "
    f"BIT\\*, {needed('Informed RRT*')} of Informed RRT\\* and {needed('RRT*')} of RRT\\*. BIT\\* is weak at the "
    f"beginning: at the gap, after {early_} checks, fewer than half of its runs have a path, and after {first_} its "
    f"median path is {longer_[0]:.1f} % too long, that of RRT-Connect with shortcuts {longer_[1]:.1f} %."
)

# %% [markdown]
# BIT* checks an edge only when that edge could be part of a better path. RRT-Connect with shortcuts needs about as few
# checks. If a check is cheap, as here, the bookkeeping of BIT* takes most of its time.
#
# <details><summary>More on the batches; graphs of convex sets, run in the plane</summary>
#
# One instruction computes the same number for eight points or more. We found no missed collision among the edges at the
# shelf, and that is no proof: the boards and the arm are thick. In the fourth plot, each edge collides in one stretch,
# whose length was measured with 4,000 points.
#
# *VAMP.* Times are of the processor, and the time of a call from Python that checks nothing is subtracted from those of
# the edges. The queries lead from bay to bay of the open shelf without its floor, in which VAMP's base stands. Its
# authors report a median planning time of 35 µs for a seven-joint arm, on other queries and another CPU.
#
# VAMP has no wheel; we compiled it for this processor. In place of its search tree for nearest nodes it used a search
# through the list, which matters little, because its trees are small here (see the figures). Two differences show in
# its source: the arm's frames are generated code, and obstacles are sorted by their distance from the base, so that a
# sphere's loop ends at the first one out of reach.
#
# A graph of convex sets needs no edge check. With the three rectangles of the gap, its path is the shortest one, up to
# the solver's tolerance. A disc can't be covered around exactly: the path follows the tangents that bound the regions,
# and its excess falls with the square of their number (last plot above). Its limit is that somebody has to supply the
# regions. (Of the other works we read abstracts and documentation.)
#
# </details>

# %%
figures(read("vamp_comparison"), summary="VAMP: times, plans and missed collisions")

# %%
figures(read("informed_and_convex"), summary="Edge checks, excess lengths and times")

# %% [markdown]
# ## 10 · Interview
#
# Answer each question aloud first. Then open the one-minute answer, the full answer, and the follow-up questions.

# %%
interview("planning")

# %% [markdown]
# ### Checkpoint
#
# Five questions on this chapter, drawn by a seed.

# %%
checkpoint("planning", ["", "", "", "", ""], seed=1)
