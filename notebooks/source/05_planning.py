# %% [markdown]
# # 5 · Motion planning
#
# *From the green spot to the yellow one without touching red. Answer first<span class="kernel-only">, run the
# cells</span>, then press* Play. About {open minutes} minutes of reading, cards and charts. The folded parts add
# {folded minutes} minutes, the exercises {exercise minutes} minutes.

# %%
from course.cards import predict
from course.simulations import simulation

predict("unseen_wall")

# %% [markdown]
# ![A planner among obstacles that you place](attachment:planning.growing.png)

# %%
simulation("growing")

# %% [markdown]
# **You will be able to** say what a planner has proved when it hands you a path, and what it has not when it hands you
# none; choose between growing, caching and optimising; make a motion of a path within the joints' limits; and bring a
# search of seconds down to milliseconds, knowing which idea did it. **Know first:** chapter 4's arms; chapter 2's
# distances help.
#
# ## How this chapter works
#
# Most scenes begin with a card: answer first; a click says whether you are right, and **Explanation** says why.
# Derivations are folded away. A number in the text comes from the cell above it, or from a check that `python -m
# course.derivations 5` runs again. Every path on this page went through one judge, `check_path`, which shares no code
# with the planners. These exercises wait in section 8:

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint

badges(5)

# %%
import inspect

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown

from course import planning
from course.cards import figures, interview
from course.charts import read
from course.derivations import more_claims, show
from course.planning import check_path, length, plan, scenes, time_parameterise, trees

# %% [markdown]
# ## 1 · Concept: a space in which the robot is a point

# %%
predict("shape_of_a_disc")

# %% [markdown]
# A **configuration** is a list of numbers that says where every part of the robot is: for an arm its joint angles. All
# of them together are the **configuration space**, one dimension a joint. In it the robot is a point, without width,
# without an elbow, and a motion is a curve. The price: obstacles there have shapes that nobody can write down. One can
# only *ask*: does the arm, at these angles, touch something?

# %%
two = planning.planar_arm([1.0, 1.0], 0.06, discs=[[1.2, 0.9, 0.35], [-1.0, 1.2, 0.4]])
angles = np.linspace(-np.pi, np.pi, 151)
hit = [[not planning.state_free(two, (a, b)) for a in angles] for b in angles]
here, other = np.array([-0.4, 0.6]), np.array([2.9, -0.5])
result = plan(two, here, other, rng=2, step=0.5)
figure_, (left, right) = plt.subplots(1, 2, figsize=(8, 3.8), layout="constrained")
for _, x, y, r, _ in two.obstacles:
    _ = left.add_patch(plt.Circle((x, y), r, color="#e9a3a0"))
states = time_parameterise(result.path, (1.0, 4.0)).waypoints(0.25)
for k, (a, b) in enumerate(states.T):
    elbow = np.array([np.cos(a), np.sin(a)])
    xy = np.column_stack(([0, 0], elbow, elbow + [np.cos(a + b), np.sin(a + b)]))
    _ = left.plot(*xy, color=plt.cm.viridis(k / states.shape[1]), lw=2)
_ = left.set(xlim=(-2.1, 2.1), ylim=(-2.1, 2.1), aspect="equal", title="the room [m]")
_ = right.contourf(angles, angles, np.array(hit, float), levels=[0.5, 1.5], colors=["#e9a3a0"])
_ = right.plot(*result.path, "o-", ms=3)
_ = right.set(xlabel="shoulder [rad]", ylabel="elbow [rad]", title="the joints", aspect="equal")
plt.show()
print(f"{np.mean(hit):.0%} of the square of angles collides; {result.samples} samples;")
print("judged:", "free" if check_path(two, result.path, here, other) else "in collision")

# %% [markdown]
# Left, what happens in the room, dark first; right, the same as a point between two islands (the patch at the left edge
# is the right one, come round). Why not plan for the tip?

# %%
show("tip_path_then_ik")

# %%
show("one_dimension_a_joint")

# %% [markdown]
# ## 2 · Concept: grow, connect, remember
#
# ### A tree
#
# **RRT**, the rapidly-exploring random tree (LaValle 1998), is a loop of five lines. Draw a state anywhere; now and
# then the goal itself, that share is the **goal bias**. Find the node of the tree nearest to it. Go from there towards
# it, by a **step size** at most. Is that edge free? Keep the new node. Is the goal reached, by a free edge? Then read
# the path backwards.

# %%
show("rrt_loop")

# %% [markdown]
# Why does it spread? The node that borders the largest unexplored region is nearest to most samples, and grows most.

# %%
show("rrt_complete")

# %% [markdown]
# That is what **probabilistically complete** means: the probability to have found a path goes to one with the number of
# samples. It is a sentence about infinity. About your deadline it says nothing, and about a question without an answer
# even less.
#
# ### An edge is not its ends
#
# Nodes are asked and free. What is between two of them? Most libraries try points along the edge, as in the first card.

# %%
show("edge_by_ten_points")

# %% [markdown]
# ![Collisions that points along an edge miss, and the closed form](../docs/charts/thin_obstacles.png)

# %%
figures(read("thin_obstacles"), "wall, points", "disc, points", "our", summary="And OMPL's points")

# %% [markdown]
# For a point among discs and polygons this test has a closed form. For an arm it has none, but there is a proof:
# **conservative advancement**. If nothing is nearer to the arm than $g$, and no point of it can move more than $g$
# during the next stretch, the stretch is free.
#
# $$\boxed{\;\Delta s = \frac{g(q)}{\sum_i r_i\,|\Delta q_i|}\;}$$
#
# Here $r_i$ is the farthest reach of what joint $i$ carries. Large steps in the open, small ones near a board, and at
# some micrometres it gives up and says *collides*. It errs on one side only. You will write it in section 8.
#
# <div class="alert alert-block alert-warning">
#
# **Key insight.** A planner is a search around one question: is this edge free? Its speed is how often it asks times
# what an answer costs. Its honesty is what "yes" means.
#
# </div>
#
# ### Is it there yet?

# %%
show("near_the_goal")

# %% [markdown]
# <details><summary>The listing that one often sees</summary>
#
# A class with `sample`, `nearest`, `steer`, `collision_free` and `plan`; a tenth of its targets is the goal; ten points
# along an edge; success as soon as a node is within a step of the goal.
#
# It runs, and what it returns is a path to a *neighbour* of the goal: the goal itself is never appended, and the last
# stretch is never asked about. Its nearest neighbour is a loop over a list, so $m$ samples cost $m^2/2$ distances; the
# chapter uses a k-d tree as soon as that measures faster. The exercise `rrt` is its repaired form.
#
# </details>
#
# ### From both ends
#
# **RRT-Connect** (Kuffner and LaValle 2000) is what most people should use first.

# %%
show("connect_is_two_rrts")

# %% [markdown]
# Choose it as *Planner* on the first screen, in the preset *Narrow gap*, with some seeds. A **narrow passage** is a
# part of the free space that most samples miss and that every path needs.

# %%
predict("both_ends_of_a_slit")

# %% [markdown]
# One hears a planner, a gap and one number. It needs four things more: the room and the step (10 m, a wall of 0.5 m, a
# step of 1 m), the spread, and what is left of the length after shortcuts (section 3). Medians of 100 seeds:

# %%
lines = [
    "| planner | gap of the wall | samples (middle half) | length / shortest (shortened) |",
    4 * "|---" + "|",
]
for name in ("rrt", "rrt_connect"):
    for share in scenes.GAPS:
        requested = scenes.gap(share)
        ends = requested.world, requested.start, requested.goal
        runs = [plan(*ends, method=name, budget=200_000, rng=k, step=1.0) for k in range(100)]
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
            f"| {name} | {share:.0%} | {drawn[0]:.0f} ({drawn[1]:.0f} to {drawn[2]:.0f}) | "
            f"{np.median([run.cost for run in runs]) / best:.2f} ({np.median(cut):.2f}) |"
        )
Markdown("\n".join(lines))

# %% [markdown]
# Read samples against lengths. A gap that is hard to find doesn't make RRT's path longer, and after shortcuts nobody
# can tell the two apart. In the slit their middle halves overlap: one run of each shows nothing.

# %%
show("connect_in_narrow_passages")

# %% [markdown]
# ### Where to draw

# %%
predict("pull_of_the_goal")

# %%
show("goal_bias_in_passages")

# %% [markdown]
# Better samples can help where the passage is. A **bridge test** draws two states near each other and takes the middle
# if both collide and it doesn't. The Gaussian sampler takes a free state beside one that collides.

# %%
show("bridge_test")

# %% [markdown]
# Both cost extra questions for each sample, and in wide space they draw where nobody needs a node.
#
# ### Better with time
#
# **RRT\*** (Karaman and Frazzoli 2011) hangs each new node where its way from the root is shortest, and then its
# neighbours under it where that is shorter. The best path's length never rises, and goes to the optimum if the
# neighbourhood shrinks slowly enough. **Informed**
# RRT\* (Gammell and others 2014) draws, once there is a path, only from the ellipsoid of states that could shorten it:
#
# $$\lVert q - q_a\rVert + \lVert q - q_b\rVert < c_{\text{best}} .$$
#
# How far above the shortest a path is, against time, where the shortest is known:
#
# ![Length above the shortest against time](../docs/charts/path_quality.png)

# %%
figures(read("path_quality"), "pick", summary="Each planner: time, and how far above the shortest")

# %%
show("rrt_star_converges")

# %%
show("informed_rrt_star")

# %% [markdown]
# To be quick use RRT-Connect and shorten it: with no or ten rounds of shortcuts it is first within a twentieth of the
# shortest. Past the disc more rounds keep up with Informed RRT\*; at the gap they stay a per cent above, it goes on.
#
# ### Remember
#
# A **roadmap** (PRM, Kavraki and others 1996) draws free states without a question in mind and joins neighbours by free
# edges. A question then joins its ends to it and searches a graph. A **lazy** roadmap leaves its edges unasked until a
# search wants to use one: most edges of a roadmap are on nobody's way.

# %%
show("lazy_tests_the_final_path")

# %%
predict("after_the_ball")

# %%
requested = planning.shelf("open")
roadmap = planning.build_roadmap(requested.world, 1000, 0)
rng = np.random.default_rng(1)
for k in range(5):
    ends = requested.query(rng)
    world = requested.disturbed(rng, *ends)
    reply = plan(world, *ends, method="roadmap", roadmap=roadmap, budget=20_000, rng=k, step=1.0)
    print(
        f"ball {k + 1}: {reply.edge_checks:4d} edges asked, {reply.path.shape[1]:2d} states, "
        f"judged {'free' if check_path(world, reply.path, *ends) else 'in collision'}"
    )
print(f"the roadmap: {len(roadmap.nodes)} nodes, {len(roadmap.pairs)} edges")

# %%
show("cached_roadmap")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** What can be known before the question comes should be: the arm, the shelf, most of the free space.
# What changes is a ball, and only edges that the answer uses have to be asked about it.
#
# </div>
#
# ## 3 · Concept: from a path to a motion
#
# ### Shorter
#
# A tree's path zigzags. **Shortcutting** takes two places on the path and joins them by a straight edge, if that is
# free. Between waypoints only, it can't take off a corner; between any two places it can.

# %%
show("shortcut_never_lengthens")

# %%
scene = scenes.discs()
walk = plan(scene.world, scene.start, scene.goal, method="rrt", rng=1, step=1.0).path
cut = planning.shortcut(walk, scene.world, np.random.default_rng(0))
round_ = planning.smooth(cut, scene.world)
figure_, axes = plt.subplots(figsize=(6.0, 4.4), layout="constrained")
for _, x, y, r, _ in scene.world.obstacles:
    _ = axes.add_patch(plt.Circle((x, y), r, color="#e9a3a0"))
for name, path in (("tree", walk), ("shortcuts", cut), ("rounded", round_)):
    _ = axes.plot(*path, label=name, lw=4 if name == "shortcuts" else 1.5)
    assert check_path(scene.world, path, scene.start, scene.goal)
    stops = time_parameterise(path, (1.0, 1.0)).duration
    flows = time_parameterise(path, (1.0, 1.0), blend=0.5, free=scene.world).duration
    print(
        f"{name:<10} {length(path):6.2f} m, {path.shape[1]:3d} states; with a stop at each "
        f"{stops:5.1f} s, corners rounded {flows:5.1f} s"
    )
_ = axes.set(xlim=(0, 10), ylim=(0, 10), aspect="equal", xlabel="x [m]", ylabel="y [m]")
_ = axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
plt.show()

# %% [markdown]
# The limits are 1 m/s and 1 m/s². A stop at every corner of a finely rounded path is the worst of all: it is the
# *motion* that has to be smooth, not the picture.
#
# ### Smoother
#
# A **B-spline** near the corners leaves the free edges, so it has to be asked again; where it collides a corner stays.
# An **optimiser** deforms a whole trajectory. **CHOMP** (Zucker and others 2013) goes down the gradient of smoothness
# and obstacle cost, measured so that a pushed waypoint takes its neighbours along. **TrajOpt** (Schulman and
# others 2014)
# solves a sequence of convex problems with hinge costs. **STOMP** (Kalakrishnan and others 2011) needs no
# gradient: it averages noisy tries.
#
# ![Where an optimiser ends, by the point that its first guess goes through](../docs/charts/optimiser_minima.png)

# %%
figures(read("optimiser_minima"), "CHOMP", "TrajOpt", summary="And a planner")

# %% [markdown]
# An optimiser mostly keeps the side of an obstacle on which it began, and inside one it has no side. Longer ways
# are local minima, too. What helps is another beginning: a planner's path, or random ones. (16 discs above, 40 below.)

# %%
show("optimisers_get_stuck")

# %% [markdown]
# ### In time
#
# A path says where, not when. **Time parameterisation** finds the fastest motion along it within the joints' limits of
# rate and acceleration. With $\dot s$ the speed along the path,
#
# $$\ddot q = q'(s)\,\ddot s + q''(s)\,\dot s^2 ,$$
#
# so at each place the limits leave an interval for $\ddot s$ that depends on $\dot s^2$ alone. Backward: from which
# speeds can one still brake? Forward: as fast as that allows. On one straight line the answer is a **trapezoid** of the
# rate, and a triangle when the way is short.
#
# <details><summary>Derive: the trapezoid for several joints</summary>
#
# All joints stay on the line, $q = a + s\,(b - a)$ with $s$ from 0 to 1. Joint $i$ moves at $|b_i - a_i|\,\dot s$, so
# $\dot s \le v = \min_i v_i/|b_i - a_i|$ and $|\ddot s| \le u = \min_i u_i/|b_i - a_i|$; the two minima may belong to
# two joints. Speeding up to $v$ takes $v/u$ seconds and $v^2/(2u)$ of the line, braking as much. If $v^2/u < 1$ there
# is a stretch at full speed and the motion lasts $1/v + v/u$, else the ramps meet half way, after $1/\sqrt{u}$.
#
# </details>

# %% tags=["show-code"]
motion = time_parameterise(cut, (1.0, 1.0), blend=0.5, free=scene.world)
times = np.linspace(0.0, motion.duration, 4001)
q, rate, push = motion(times)
figure_, axes = plt.subplots(figsize=(8, 2.4), layout="constrained")
_ = axes.plot(times, rate.T, label=["rate of x", "rate of y"])
_ = axes.plot(times, push.T, lw=0.8, label=["acceleration of x", "acceleration of y"])
_ = axes.set(xlabel="time [s]", ylabel="[m/s], [m/s²]")
_ = axes.legend(ncols=4, fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0))
plt.show()
print(f"largest rate {np.abs(rate).max():.6f} of 1, acceleration {np.abs(push).max():.6f} of 1")

# %% [markdown]
# Do limits that hold at grid points hold between them? A drive that trips doesn't care about your grid.

# %%
show("limits_between_grid_points")

# %% [markdown]
# ![How far a limit is exceeded between grid points, and what rounding a corner buys](../docs/charts/limits_between.png)

# %%
figures(read("limits_between"), "at grid", "time-optimal", summary="All key figures")

# %% [markdown]
# Right: the earlier a corner is rounded, the shorter the motion. Joints timed each by itself only leave the path.
#
# ## 4 · Design: where a planner sits
#
# | level | what it decides | takes | hands down |
# |---|---|---|---|
# | **Task planning** | *what*: pick up the cup, put it on the shelf | goals, objects | ↓ a grasp pose |
# | **Motion planning** | *where along*: a free path from here to there | a world, two configurations | ↓ waypoints |
# | **Trajectory optimisation** | *when*: smooth, within the limits | a path | ↓ $q, \dot q, \ddot q$ at any $t$ |
# | **Control** | *how hard*: torques that follow it | a reference, a measurement | torques, at a kilohertz |
#
# Failures go up the same stairs: no trajectory within the limits, another path; no path, another grasp; no grasp,
# another task. Each level has to say *why* it failed, or the one above tries the same again. The planner's world is
# older than its answer: what moves has to be asked again, along the path that is being driven, at the camera's rate.

# %% tags=["nbval-ignore-output"]
import time

ends = requested.query(np.random.default_rng(3))
result = plan(requested.world, *ends, rng=0, step=1.0)
begun = time.perf_counter()
path = planning.shortcut(result.path, requested.world, np.random.default_rng(0), rounds=60)
between = time.perf_counter()
motion = time_parameterise(path, (2.0, 8.0), blend=0.2, free=requested.world)
spent = 1e3 * np.array([result.seconds, between - begun, time.perf_counter() - between])
print("plan {:.1f} ms, shorten {:.1f} ms, time {:.1f} ms".format(*spent))
print(f"for a motion of {motion.duration:.2f} s between two bays of the open shelf")

# %% [markdown]
# "200 ms for the planner, 50 ms for the smoothing" can't be checked: it names no arm, no shelf and no machine. The cell
# above has the share of each stage on yours. Two other numbers that one hears can be checked:

# %%
show("shortcut_share")

# %% [markdown]
# ## 5 · Code, and the simulation in full
#
# Two trees that take turns, as the module has it: turn 0 steps towards a sample, turn 1 connects. The same source runs
# compiled, and as plain Python in a debugger.

# %%
Markdown(f"```python\n{inspect.getsource(trees._connect)}```")

# %% [markdown]
# A bad argument is refused; a start in collision is no mistake of the caller, and gets a status:

# %%
gap = scenes.gap(0.1)
for attempt in (
    lambda: plan(gap.world, [1.0, np.nan], gap.goal),
    lambda: plan(gap.world, gap.start, gap.goal, step=0.0),
    lambda: plan(gap.world, [1.0, 1.0, 1.0], gap.goal),
    lambda: plan(gap.world, gap.start, gap.goal, budget=0),
):
    try:
        attempt()
    except ValueError as problem:
        print(problem)
for start, goal in (([5.0, 1.0], gap.goal), (gap.start, [5.0, 1.0]), (gap.start, [11.0, 1.0])):
    print(plan(gap.world, start, goal).status)

# %% [markdown]
# Drag start, goal and obstacles, drag a rim to resize, click on free ground for a new one; *Plan*, *Step*, *Shortcut*
# and *Reset* are in the picture, and arrow keys move what *Keys move* says. Go through the presets. Before you choose
# one, say what will happen:
#
# 1. *Narrow gap*: how many samples, and how many with the next seed?
# 2. *Bug trap*: does more goal bias help?
# 3. *Unreachable goal*: which of the four planners will say so?
# 4. Among obstacles, a step of 0.1 m against one of 3 m: which one wins, and where does it turn?

# %%
simulation("growing", "Bug trap")

# %% [markdown]
# ## 6 · Speed
#
# ### The five-second question
#
# <div class="alert alert-block alert-info">
#
# **Interview question.** *Your robot plans a path to an object at the back of a cluttered shelf. RRT takes five
# seconds. Get it under a tenth of a second.*
#
# </div>

# %%
predict("first_of_ten_ideas")

# %%
show("both_ends_first")

# %% [markdown]
# Measured, one idea at a time: an arm of seven joints, from bay to bay of two shelves, the same hundred questions for
# every rung (1 to 3 a few of them), each known to have an answer; once with the shelf as it was (*still*) and once with
# a ball put before the bays (*moved*). A triangle at the top: no answer.
#
# ![Time of a plan, rung by rung, at two shelves](../docs/charts/shelf_ladder.png)

# %%
figures(
    read("shelf_ladder"),
    "compiled          still",
    "longer steps      still",
    "from both ends    still",
    "bridge sampler    still",
    "cached, by a list still",
    "cached, by trees  still",
    summary="Every rung, still and with a ball that has moved; memory and building",
)

# %% [markdown]
# What each rung bought. *1 to 3*, one tree in Python, compiled, with proved edges, its steps a radian: faster by a
# factor, and no path within its samples for about half of the questions. *4*, steps of 2.6 radians, which all others
# take: nearly all. *5*, a tree from each end: the rest, and a smaller median, as the way out of a bay is easy.
# (With short steps it answers all, too.) *6*, bridge samples: they cost more than they find. *7*, lazy: few edges, some
# questions open.
#
# *8 and 9*, a cached roadmap: nothing at the median; a shorter tail with a tree from each end onto it (*8* joins them
# to neighbours). *10*, earlier paths put into it: a longer tail. A ball before a bay makes a few questions hard.
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** *How do you speed up planning?* Don't recite a menu, order it. (1) Measure: questions asked, times
# what one costs. (2) Make the answer cheap: simple shapes, compiled, a distance in place of many samples. (3) Longer
# steps; two trees. (4) Remember: a roadmap, asked lazily. (5) Replanning: what of the last path is still free? (6)
# Samplers last, for a passage that you can name. *And what each costs.*
#
# </div>
#
# ### Beside OMPL
#
# The same world, step and goal rule; OMPL with states checked in Python, as most of its Python users have it, and with
# our compiled edge check handed to it. A path that the judge refuses counts as none.
#
# ![The share of seeds with a free path against time, beside OMPL](../docs/charts/plan_times.png)

# %%
figures(
    read("plan_times"),
    *(
        f"{place:<11} {name:<21}"
        for place in ("discs", "gap 2%", "4-link arm")
        for name in ("ours", "OMPL, our edge check", "OMPL, Python states")
    ),
    summary="All scenes; a finer resolution; edge checks left out on both sides",
)

# %% [markdown]
# *0.2%*: states tried every 0.2 % of the diagonal, not every 1 %; *own part*: without the calls into Python. Is it the
# same algorithm? *p* is the chance that two equal planners differ as much (a rank test):
#
# ![Samples, lengths and success, ours and OMPL's](../docs/charts/sample_counts.png)

# %%
figures(
    read("sample_counts"), "4-link", summary="The same algorithm? Samples, lengths, success, and p"
)

# %% [markdown]
# And the 7-R arm from bay to bay of the open shelf, each question once:
#
# ![The 7-R arm at the shelf: share of questions with a free path against time](../docs/charts/shelf_times.png)

# %%
figures(
    read("shelf_times"),
    *(f"7-R arm     {name}" for name in ("ours", "OMPL, our", "OMPL, Python states")),
    summary="All of it",
)

# %% [markdown]
# *What to pick.* With one compiled edge check ours was ahead in all four scenes, by little where a plan takes a tenth
# of a millisecond: half of that is the call, and OMPL's own part is quicker; with seven joints nearly all is the edge
# check, and neither is ahead. With states in Python one waits not for the planner but for the interpreter, asked
# thousands of times. And at its own resolution some of those paths collide.

# %% tags=["nbval-ignore-output"]
show("ompl_defaults")

# %% [markdown]
# ## 7 · Debug: where it fails
#
# ### Narrow in how many directions?
#
# A slab is narrow in one direction, a tube in all but the one that leads through it, a cube is a tube as long as it is
# wide. That two random states see each other through a thin wall has a closed form; what planners need, one has to try:
#
# ![Samples through a slab, a tube and a cube, by dimension](../docs/charts/narrow_passages.png)

# %%
figures(
    read("narrow_passages"),
    *("slab  ", "slab, OMPL", "tube  ", "tube, OMPL", "cube  "),
    summary="All key figures",
)

# %% [markdown]
# A number for each dimension from two on; *inf*: half of the runs or more ran out. So dimension is no excuse by itself.
# Count the directions in which your passage is narrow, and give up some of them: a posture before the slot.

# %%
more_claims("gap_table")

# %% [markdown]
# ### Debugging
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The planner finds no path.* In this order: Is the start free, is the goal, with the planner's own
# shapes? (A gripper that holds the cup *touches* the cup.) Is there a path at all: make the obstacles smaller until one
# appears; where it squeezes through is the passage. Another step, longer and shorter. Then two trees, more samples
# there, and only then another planner.
#
# <details><summary>What people get wrong there</summary>
#
# They raise the goal bias, which pulls the tree against the wall. They raise the time limit of a question that has no
# answer. And they plan for the tip in three dimensions and lose the elbow.
#
# </details>
#
# </div>
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The path is jerky.* Which of three? Corners where nothing is: shortcuts. Stops at each waypoint:
# the timing; round corners in passing. Detours that no obstacle asks for: the wrong side of an obstacle (another
# *homotopy class*), and no smoothing gets out of it; plan again, or RRT\*. After each repair ask the judge again, a
# rounded corner is a new path, a spline through the waypoints all the more.
#
# </div>

# %%
show("blocked_ends_are_named")

# %%
show("step_through_a_passage")

# %%
show("slow_plans_are_slow_questions")

# %% [markdown]
# And what the planner's world leaves out, nobody asks about:

# %%
show("limits_keep_an_arm_from_itself")

# %%
show("shortcut_leaves_corners")

# %%
show("trajopt_minimises_jerk")

# %% [markdown]
# <table>
# <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr>
# <tr><td>hits something thin</td> <td>edges tried at points</td> <td><code>check_path</code>; halve the
# spacing</td> <td>prove
# edges; grow obstacles by what is missed</td></tr>
# <tr><td>ends near the goal, not at it</td> <td>a tolerance called success</td> <td>last state against the goal</td>
# <td>join the goal by an edge that is asked</td></tr>
# <tr><td>quick on average, late on Fridays</td> <td>a heavy tail</td> <td>the 99th percentile, failures as
# infinite; which questions</td> <td>samples near the ends, a roadmap</td></tr>
# <tr><td>other answers each run</td> <td>a seed or a limit from the clock</td> <td>the same call twice</td> <td>hand in
# a seed, limit samples</td></tr>
# </table>
#
# ## 8 · Exercises
#
# Graded exercises; the drill `rrt` (`drills start rrt`) comes before them. `check` runs what your cell defines in a
# process of its own, on cases drawn afresh, and says what is right, what is wrong and, where it recognises the mistake,
# why.
#
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
# Its paths are free, and get shorter with every sample. It is wrong all the same.

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
        apart = np.hypot(*(points - new).T)
        around = [i for i in range(len(nodes)) if apart[i] <= radius]
        around = [i for i in around if i == near or edge_is_free(points[i], new, discs)]
        parent = min([near, *around], key=lambda i: costs[i] + apart[i])
        cost = costs[parent] + apart[parent]
        for i in around:
            saved = costs[i] - (cost + apart[i])
            if saved > 0.0:
                parents[i] = len(nodes)
                costs[i] -= saved
        nodes.append(new)
        parents.append(parent)
        costs.append(cost)
    return np.array(nodes), np.array(parents), np.array(costs)


check(rrt_star)

# %% [markdown]
# ### A formula: what points miss
#
# Half a chord, its depth, the radius: a right triangle. Any equivalent form is right, and a wrong one is named.
# <span class="kernel-only">Change the text.</span>

# %%
answer("edge_by_ten_points", "s^2/(8*r)")

# %% [markdown]
# ## 9 · Frontier: planners that have learned
#
# Two of them, small enough to be trained here in a minute each, on questions that RRT-Connect has answered. The first
# only says where to draw: a network sees which places of a world are free, the start and the goal, and colours the
# places where answers went.
#
# ![A learned sampler and paths out of noise, beside what has learned nothing](../docs/charts/learned_planners.png)

# %%
figures(
    read("learned_planners"),
    *("uniform", "learned  ", "turned", "noise, checked", "noise, pushed", "RRT-Connect"),
    summary="All key figures, time of training",
)

# %%
show("learned_sampler_speeds_up")

# %% [markdown]
# So ask three things of a learned sampler. What does its *input* cost: a camera's picture is free, one that has to be
# asked state by state is not. What would a *simple* method make of the same input? And how far is your world from those
# it has seen? It can't be wrong, only slow: a share of uniform samples keeps completeness, and every edge is asked.
#
# The second network makes a whole path out of noise, in forty steps, told start and goal. It has one world in its
# weights.

# %%
show("diffusion_is_collision_free")

# %% [markdown]
# <table>
# <tr><th>work</th> <th>year</th> <th>what it does</th> <th>what decides</th></tr>
# <tr><td>MPNet (Qureshi and others, arXiv 1806.05767)</td> <td>2018</td> <td>a network predicts the next configuration
# from a point cloud's code, from both ends; no sampler of an RRT</td> <td>a check; a classical planner where it
# fails</td></tr>
# <tr><td>Learned sampling distributions (Ichter, Harrison and Pavone, ICRA)</td> <td>2018</td> <td>a conditional
# autoencoder draws samples where solutions were</td> <td>the planner's check; uniform samples are mixed in</td></tr>
# <tr><td>STORM (Bhardwaj and others, CoRL, arXiv 2104.13542)</td> <td>2021</td> <td>rollouts of the
# joints are sampled on a GPU at each control step and averaged</td> <td>its costs, some of them learned</td></tr>
# <tr><td>Diffuser (Janner and others, ICML)</td> <td>2022</td> <td>denoises a whole trajectory, guided by a
# reward</td> <td>nothing: a reward is no proof</td></tr>
# <tr><td>Diffusion Policy (Chi and others, RSS)</td> <td>2023</td> <td>denoises short chunks of actions from
# pictures</td> <td>nothing; it is a policy, not a planner</td></tr>
# <tr><td>Motion Planning Diffusion (Carvalho and others, arXiv 2308.01557)</td> <td>2023</td> <td>a diffusion over
# trajectories as a prior, its samples pushed by the gradients of costs</td> <td>its costs</td></tr>
# <tr><td>cuRobo (Sundaralingam and others, arXiv 2310.17274)</td> <td>2023</td> <td>nothing learned: many
# optimisations at once on a GPU, with a geometric planner beside them</td> <td>its costs, collision among
# them</td></tr>
# </table>
#
# *Collision-free* by whom: a cost that was low, or a check that passed? *Faster* than what: Python, or section 6?
#
# ## 10 · Interview
#
# Answer aloud, then open: first what one says in a minute, then the whole of it, then what comes next.

# %%
interview("planning")

# %% [markdown]
# ### Checkpoint
#
# Formulas that are not on this page; you can derive them from what is. The gate opens when all are right.

# %%
checkpoint("planning", thin_wall_missed="", passage_in_more_dimensions="", informed_area="")
