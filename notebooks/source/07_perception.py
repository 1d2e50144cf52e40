# %% [markdown]
# # 7 · Perception
#
# *A depth camera looks at a table. Where is the known part: to 2 mm and 2 degrees, so that a gripper closes on it?
# Answer first<span class="kernel-only">, run the cells, then drag a part</span>.* About {open minutes} minutes of
# reading, cards and charts. The folded parts add {folded minutes} minutes, the exercises {exercise minutes} minutes.

# %%
from course.cards import predict
from course.simulations import simulation

predict("lost_plate")

# %% [markdown]
# ![A table under a depth camera](attachment:perception.png)

# %%
simulation("perception")

# %% [markdown]
# **You will be able to** say how well a depth camera measures before you buy it; follow a part through every stage and
# name the one that loses it; fit a pose that knows how sure it is; know what a picture can't tell; and catch the wrong
# poses that every internal number calls right. **Know first:** chapter 1's quaternions and poses; least squares,
# eigenvalues.
#
# ## How this chapter works
#
# Most scenes begin with a card: answer first; a click says whether you are right, and **Explanation** says why.
# Derivations are folded away. A number in the text comes from the cell above it, or from a check that `python -m
# course.derivations 7` runs again. All pictures are computed, so that every step has a truth to be compared with.
# These exercises wait in section 8:

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint

badges(7)

# %%
import inspect
import textwrap
import time
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown
from matplotlib.colors import ListedColormap

from course import perception
from course.cards import figures, interview
from course.charts import read
from course.charts.perception.poses import BOX, EYE, SENSOR, TABLE
from course.derivations import more_claims, show
from course.kinematics.chain import compose
from course.measure.timing import calls, interleaved
from course.oracles import open3d
from course.perception import Camera, Sensor, locate, pose, render, sense, shape, together, yaw_net
from course.rigid_body.quaternion import conjugate, exp, rotate


def print_figures(chart, *rows):
    """Print the lines of a chart's key figures that begin so, no wider than a page."""
    for line in read(chart).splitlines():
        if line.lstrip().startswith(rows):
            words = " ".join(line.split())
            print(textwrap.fill(words, 96, subsequent_indent="    "))


# %% [markdown]
# ## 1 · Concept: what a depth camera measures
#
# ### A picture of distances
#
# A **depth picture** is a table of numbers: for each pixel the distance along the camera's axis, and 0 where nothing
# was measured. A **pinhole** camera sees the point $(x, y, z)$ at
#
# $$u = f_x\,\frac{x}{z} + c_x, \qquad v = f_y\,\frac{y}{z} + c_y ,$$
#
# where the focal lengths $f$ and the principal point $c$ [pixels] are its **intrinsics**. Here is the table of this
# chapter: a box, a can, a thin plate. It is computed by meeting a ray per pixel with each shape in closed form, and
# then a sensor is modelled on top.

# %%
can, plate = shape("cylinder", 0.03, 0.04), shape("box", 0.03, 0.03, 0.003)


def stand(part, high, x, y, yaw):
    """Return a part of half the height `high` that stands on the table at x, y.

    In the camera's frame.
    """
    on_table = np.array([x, y, high, *exp(np.array([0.0, 0.0, yaw]))])
    return part.moved(compose(TABLE[:, None], on_table[:, None])[:, 0])


def take_image(sensor, seed, *present):
    """Return a noisy picture of the table with parts on it."""
    exact, _ = render(together([shape("plane").moved(TABLE), *present]), EYE)
    return sense(exact, EYE, sensor, np.random.default_rng(seed))


parts = (stand(BOX, 0.03, -0.12, 0.02, 0.7), stand(can, 0.04, 0.1, 0.08, 0.0))
scene = together([shape("plane").moved(TABLE), *parts, stand(plate, 0.003, 0.12, -0.1, 0.3)])
rng = np.random.default_rng(0)
exact, ids = render(scene, EYE)
noticed = sense(exact, EYE, SENSOR, rng)
colours = ListedColormap(["#cfd8dc", "#3f51b5", "#e65100", "#2e7d32"])
figure_, axes = plt.subplots(1, 3, figsize=(9, 2.5), layout="constrained")
shown = axes[0].imshow(exact)
_ = figure_.colorbar(shown, ax=axes[0], shrink=0.8)
error = axes[1].imshow(1e3 * (noticed - exact), vmin=-3, vmax=3, cmap="coolwarm")
_ = figure_.colorbar(error, ax=axes[1], shrink=0.8)
_ = axes[2].imshow(ids, cmap=colours)
for axis, title in zip(axes, ("depth [m]", "its error [mm]", "what a pixel sees"), strict=True):
    _ = axis.set(title=title, xticks=[], yticks=[])
plt.show()
print(f"{EYE.width} x {EYE.height} pixels, focal length {EYE.fx:.1f} pixels")
print("pixels of box, can, plate:", *(np.count_nonzero(ids == k) for k in (1, 2, 3)))

# %%
show("small_parts_have_few_pixels")

# %% [markdown]
# ### How well, and why kinds of sensor differ

# %%
predict("twice_as_far")

# %% [markdown]
# Two eyes a **baseline** $B$ apart see a point at columns that differ by its **disparity** $d = fB/z$. The error of a
# disparity is a fraction $s$ of a pixel, the same near and far. That of the depth is not:
#
# $$\boxed{\;\sigma_z = \frac{z^2}{f\,B}\,s\;}$$
#
# <details><summary>Derive: the law of noise, and what steps add</summary>
#
# $z = fB/d$, so $\mathrm{d}z = -fB/d^2\,\mathrm{d}d = -z^2/(fB)\,\mathrm{d}d$. A sensor that tells disparities apart in
# steps of $q$ pixels adds an error that is nearly even between $-q/2$ and $q/2$: its variance is the mean of $x^2$
# there, $q^2/12$. So $s$ becomes $\sqrt{s^2 + q^2/12}$, as long as $s$ is not small beside $q$; the middle panel below
# shows what happens when it is. A second order is left: $1/d$ bends, and what follows is a question of the checkpoint.
#
# </details>

# %%
show("noise_is_one_number")

# %% [markdown]
# ![The law of noise, what averaging leaves, and shared noise](../docs/charts/depth_noise.png)

# %%
print_figures("depth_noise", "noise", "a quarter", "window 5")

# %%
show("averaging_removes_all")

# %% [markdown]
# And how sure is a result that was made of many pixels? A **covariance** says it: the variances of all its numbers, and
# how they err together. It is the easiest thing in this chapter to get wrong:

# %%
show("pixels_are_independent")

# %% [markdown]
# Which law a sensor obeys follows from how it measures. Triangulation has the square of the distance; a time of flight
# has not, but it depends on how much light comes back.
#
# <table>
# <tr><th>sensor</th> <th>measures</th> <th>law of its error</th> <th>breaks at</th> <th>source</th></tr>
# <tr><td>passive stereo</td> <td>shift between two pictures</td> <td>$z^2 s/(fB)$</td> <td>no texture, repeated
# texture</td> <td>Keselman and others, arXiv 1705.05548, 2017</td></tr>
# <tr><td>active stereo (RealSense D435)</td> <td>the same, on a projected texture</td> <td>$z^2 s/(fB)$</td>
# <td>strong sun on the texture; shiny parts</td> <td>Intel, D400 data sheet, revision 0.7, 2017</td></tr>
# <tr><td>structured light (Kinect v1)</td> <td>shift of a pattern that is known</td> <td>$z^2 s/(fB)$</td> <td>sun;
# two projectors</td> <td>Khoshelham and Elberink, Sensors 12, 2012</td></tr>
# <tr><td>time of flight by phase (Azure Kinect)</td> <td>phase $\varphi$ of light modulated at $f_m$</td>
# <td>$\frac{c}{4\pi f_m}\,\sigma_\varphi$</td> <td>several ways of the light; dark parts; sun</td> <td>Tölgyessy and
# others, Sensors 21, 2021</td></tr>
# <tr><td>LiDAR with pulses (OS1)</td> <td>time $t$ of a pulse</td> <td>$\frac{c}{2}\,\sigma_t$</td> <td>few points;
# edges; glass</td> <td>Ouster, OS1 data sheet</td></tr>
# </table>
#
# <details><summary>What is usually said of them, and what of it holds</summary>
#
# *Stereo fails on surfaces without texture.* The passive kind does. A projector gives a white wall a texture, which is
# why the table has two rows of it.
#
# *The D435 is structured light.* Its data sheet (revision 0.7, September 2017) says stereo, with an optional infrared
# projector that adds texture. Nothing is decoded from the pattern, so a second one only adds texture.
#
# *Structured light suffers in sunlight.* So does all light that one sends: the sun adds shot noise. Tölgyessy and
# others (Sensors 21, 413, 2021) found the Azure Kinect, a time-of-flight camera, not usable in direct sun.
#
# *Time of flight suffers from several paths.* Yes: the phases of a direct and a bounced way add up, and corners come
# out round. It is a bias, so no average helps. That of stereo is a false match.
#
# *LiDAR is pulsed, expensive and sparse.* Pulsed ones are; others modulate the frequency. Sparse: compared with a
# picture, yes. Expensive: a statement about a year.
#
# *640 x 480 at 30 pictures a second.* One of the modes. The family's table lists depth up to 1280 x 720, and up to 90
# pictures a second.
#
# *Below a millimetre close up*, *1 to 3 mm*: the card above. The OS1's data sheet gives a repeatability in centimetres,
# by signal and not by distance.
#
# </details>
#
# What the law makes of two cameras, at a tenth of a pixel:

# %%
z = np.linspace(0.2, 3.0, 50)
figure_, axis = plt.subplots(figsize=(6, 2.2), layout="constrained")
for name, width, view, base in (("D435", 848, 87.0, 0.05), ("wider base", 1280, 60.0, 0.12)):
    eye, sensor = Camera.symmetric(width, width // 2, np.radians(view)), Sensor(base, 0.1)
    _ = axis.semilogy(z, 1e3 * sensor.sigma(z, eye), label=name)
    message = ", ".join(
        f"{1e3 * sensor.sigma(far, eye):.2f} mm at {far} m" for far in (0.3, 1.0, 2.0)
    )
    print(f"{name:<15} f {eye.fx:4.0f} px, B {1e3 * base:3.0f} mm: {message}")
_ = axis.set(xlabel="distance [m]", ylabel="noise of a depth [mm]")
_ = axis.legend()
plt.show()

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Before any algorithm, write down $z^2 s/(fB)$ for your camera and distance. Every tolerance in depth
# is a multiple of it, and in one picture a part that is lower than a few of it can't be told from the table pixel by
# pixel.
#
# </div>
#
# ## 2 · Concept: from a picture to the things on the table
#
# ### Points and cells
#
# **Back-projection** turns the pinhole round: $x = (u - c_x)\,z/f_x$, $y = (v - c_y)\,z/f_y$. What is in the picture is
# $z$, not the length of the ray; you will write it in section 8. A **voxel grid** then keeps one mean for each cube
# that holds any points. Its use is speed, and an even density for what comes later, such as **DBSCAN**, which groups
# points that have many neighbours.

# %%
show("voxels_remove_small_parts")

# %% [markdown]
# ### The table
#
# A plane by least squares through *all* points is pulled up by the parts. **RANSAC** (Fischler and Bolles 1981) draws
# three points, makes their plane, and counts who is near: an **inlier** is a point within the tolerance. The plane with
# the most is kept, and fitted once more to all of them.

# %%
show("draws_find_the_plane")

# %% [markdown]
# ![How often the plane is found with the draws of the law](../docs/charts/ransac_draws.png)

# %%
print_figures("ransac_draws", "no refit", "one refit", "three exact")

# %% [markdown]
# Along a plane $1/z = a\,x/z + b\,y/z + c$ is linear in the pixel, and that is where a stereo sensor's noise is even.
# So once RANSAC has said who belongs to it:

# %%
show("inverse_depth_is_better")

# %% [markdown]
# ![Angle of the table over time, and its offset over noise](../docs/charts/plane_precision.png)

# %%
print_figures("plane_precision", "the fit", "RANSAC, refit", "inverse depth:")

# %% [markdown]
# And is the largest plane the table?

# %%
show("ransac_takes_the_table")

# %% [markdown]
# Three tests cost nothing: is it where the calibration puts the table, does its normal point up, is the rest above it?
# What is left are parts, walls of the bin, the robot's hand, and noise.
#
# ### Things
#
# **DBSCAN** (Ester and others 1996) calls a point with enough neighbours within `eps` a **core point**; core points
# that are neighbours are one cluster, and what has no core point near is noise. On a picture there is a quicker way: a
# **connected component** of pixels, where neighbours that differ by less than a step in depth belong together.

# %%
show("fifty_neighbours")

# %%
show("dbscan_separates")

# %%
points, pixels = perception.back_project(noticed, EYE)
plane, near, tried = perception.ransac_plane(points, 0.004, rng)
above = points[:, (plane[:3] @ points + plane[3] > 0) & ~near]
means, _ = perception.voxel_mean(above, 0.004)
high = np.zeros(noticed.size)
over = plane[:3] @ points + plane[3] > 0.004
high[pixels[over]] = points[2, over]
by_density, _ = perception.dbscan(means, 0.012, 8)
by_pixels = perception.components(high.reshape(noticed.shape), EYE, 0.012)
counts = np.bincount(by_pixels[by_pixels >= 0])
large = np.isin(by_pixels, np.flatnonzero(counts >= 40))
figure_, axes = plt.subplots(1, 2, figsize=(8, 2.6), layout="constrained")
noise = by_density < 0
_ = axes[0].scatter(*means[:2, noise], c="black", s=2)
_ = axes[0].scatter(*means[:2, ~noise], c=by_density[~noise], s=2, cmap="Dark2", vmax=7)
_ = axes[0].set(title="DBSCAN on 4 mm voxels", aspect="equal", xlabel="x [m]", ylabel="y [m]")
axes[0].invert_yaxis()
names = np.unique(np.where(large, by_pixels, -1), return_inverse=True)[1].reshape(noticed.shape)
_ = axes[1].imshow(np.where(large, names - 1.0, np.nan), cmap="Dark2", vmax=7)
_ = axes[1].contourf(~large & (by_pixels >= 0), levels=[0.5, 1.5], colors=["black"])
_ = axes[1].set(title="components of pixels, 40 or more", xticks=[], yticks=[])
plt.show()
print(f"{points.shape[1]} points, {above.shape[1]} above the plane, {means.shape[1]} voxels")
print(f"DBSCAN: clusters of {np.bincount(by_density[~noise])} voxels, {noise.sum()} noise")
print(f"pixels: clusters of {counts[counts >= 40]}, {counts[counts < 40].sum()} in smaller ones")

# %%
more_claims("dbscan_has_no_order")

# %% [markdown]
# ## 3 · Concept: from a cluster to a pose
#
# ### Pairs, then guesses of pairs
#
# If you knew which measured point is which point of the model, the pose would be a **rigid fit**: a singular value
# decomposition $USV^\mathsf{T}$ of one $3 \times 3$ matrix (Kabsch 1978).

# %%
show("kabsch_without_determinant")

# %% [markdown]
# You don't know the pairs. **ICP** (Besl and McKay 1992; Chen and Medioni 1991) guesses that each point belongs to the
# closest one, moves, and guesses again; the **residual** is the root mean square distance that is left.
# **Point-to-plane** lets points slide along the surface: far fewer steps.
#
# For a known part there is no need for a cloud of the model. The closest point of a box, a cylinder or a sphere has a
# closed form, and nothing is sampled.

# %%
show("icp_comes_home")

# %% [markdown]
# The set of starts from which it ends at the right pose is its **basin**. So `locate` starts several times, evenly over
# what the part's symmetry leaves.
#
# ![Where ICP comes home, and its iterations](../docs/charts/icp_basin.png)

# %%
print_figures("icp_basin", "3", "4", "6", "points", "planes", "shape")

# %% [markdown]
# A test of ICP is easily too kind:

# %%
show("own_points_come_home")

# %% [markdown]
# ### How sure?
#
# Each point says something about the six numbers of a pose, along its normal only: a row $J = (n,\; p \times n)$. The
# sum of $J^\mathsf{T}J/\sigma^2$ is the information, its inverse the **covariance**.

# %%
predict("turn_of_a_can")

# %%
show("what_is_not_seen")

# %%
show("normal_matrix_is_covariance")

# %% [markdown]
# A direction without information is **unobserved**. Whoever inverts the matrix anyway, with a little something on its
# diagonal, gets a number for it. Are the others honest? Error squared over what was predicted, which should be one:
#
# ![Error squared over its prediction, and shared noise](../docs/charts/pose_covariance.png)

# %%
print_figures("pose_covariance", "closest", "along", "w = 7")

# %% [markdown]
# Closest points find a face that no ray met, as a noisy point near an edge may lie nearer to it. The last steps of
# `icp` compare each point with the shape *along its own ray*. And shared noise makes every covariance too small by up
# to the window squared: that factor has to come from the sensor.
#
# Where no face tells a direction, the **outline** may. From straight above the faces of a box tell its height and two
# tilts. But a border pixel, where the part hides something farther away, lies within half a pixel of the model's
# contour. Its distance from the contour is one more residual, with a row of the same form, and the rows together tell
# $x$, $y$ and the turn. A border that something nearer cuts is not used: it is no outline of the part.
#
# ### Right, or only consistent?

# %%
predict("which_number_tells")

# %%
show("a_residual_tells")

# %%
show("looked_through_is_wrong")

# %% [markdown]
# A small residual does not acquit a fit: it tells a quarter turn, but neither a part that is cut off nor a scale that
# is one per cent off. **See-through** asks the picture something that the fit did not use: are there pixels where the
# part should be, and where the camera sees what is behind it?
#
# ![Residual and see-through of right and wrong poses](../docs/charts/silently_wrong.png)

# %%
print_figures("silently_wrong", "right", "quarter", "cut", "scale")

# %%
show("not_looked_through_is_right")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** A fit is judged by what it did not fit. Points say where something is; a picture also says where
# nothing is. What neither can say (a scale that is off by a per cent, a wrong base frame) needs a length or a touch
# from outside.
#
# </div>
#
# ### Where is the camera?
#
# A pose in the camera's frame is of no use to an arm. Its **extrinsics**, the camera's place in the base, come from
# points that the camera sees and the arm touches: a rigid fit again, whose error at a place can be predicted
# (Fitzpatrick, West and Maurer 1998). You will derive the simplest case in section 8. With the camera in the hand the
# equation is $AX = XB$, **hand-eye calibration**: motions $A$ of the hand, $B$ of the camera, $X$ between the two.

# %%
show("motions_calibrate_any_arm")

# %% [markdown]
# ### And a moment later?
#
# A pose is as old as its picture. A **Kalman filter** keeps place and rate with their covariance, predicts over the
# age, and weighs each new pose by how sure it is. The difference between what was predicted and what is seen is the
# **innovation**; one that is impossibly large is refused, but not for ever, or the filter locks itself out.

# %%
show("averaging_pictures_helps")

# %% [markdown]
# ![Averages of a part that moves, and prediction over an age](../docs/charts/tracking.png)

# %%
print_figures("tracking", "0 mm/s", "20", "100", "last", "predicted", "its own")

# %%
more_claims("picture_to_picture", "outline_tells")

# %% [markdown]
# ## 4 · Design: which estimate for which question
#
# ### The smallest that answers
#
# <table>
# <tr><th>question</th> <th>estimate</th> <th>needs</th> <th>can't say</th></tr>
# <tr><td>is anything there?</td> <td>pixels above the plane</td> <td>plane, noise</td> <td>what it is</td></tr>
# <tr><td>where to push or suck?</td> <td>centroid</td> <td>a cluster</td> <td>the middle of the part: it is that of
# what is seen</td></tr>
# <tr><td>what room to keep clear?</td> <td>box around the cluster</td> <td>a cluster</td> <td>its hidden
# half</td></tr>
# <tr><td>which way does it lie, roughly?</td> <td>principal axes</td> <td>a long cluster, all of it</td> <td>which end
# is which</td></tr>
# <tr><td>where does the gripper close?</td> <td>ICP on the shape, 3 numbers</td> <td>shape, table</td> <td>that the
# table is elsewhere: see-through does</td></tr>
# <tr><td>the same, however it lies</td> <td>ICP, 6 numbers, more starts</td> <td>shape</td> <td>what the view doesn't
# show; it names it</td></tr>
# <tr><td>where will it be?</td> <td>tracker</td> <td>poses with stamp and covariance</td> <td>a sudden stop, for some
# pictures</td></tr>
# </table>
#
# A part that stands has three degrees of freedom. To fit three and not six is better, while the table is right:

# %%
normal = rotate(TABLE[3:], np.array([0.0, 0.0, 1.0]))
table = np.append(normal, -normal @ TABLE[:3])
shared = replace(SENSOR, window=5)
figure_, axis = plt.subplots(figsize=(6, 2.4), layout="constrained")
for name, message, standing in (
    ("3 numbers", table, True),
    ("6 numbers", table, False),
    ("3, the table told 5 mm too high", table - (0.0, 0.0, 0.0, 0.005), True),
):
    deviation, verdicts = [], []
    for seed, yaw in enumerate(np.random.default_rng(3).uniform(0.3, 1.2, 12)):
        part = stand(BOX, 0.03, 0.0, 0.0, yaw)
        result = locate(
            take_image(shared, seed, part), EYE, shared, BOX, table=message, standing=standing
        )[0]
        deviation.append(perception.apart(BOX, part.poses[:, 0], result.pose))
        verdicts.append(result.status)
    shift, turn = np.sqrt(np.mean(np.square(deviation), axis=0))
    result = f"{verdicts.count('found')} of 12 found"
    print(f"{name:<31} {1e3 * shift:5.2f} mm, {np.degrees(turn):.2f} degrees, {result}")
    _ = axis.loglog(
        1e3 * np.array(deviation)[:, 0], np.degrees(deviation)[:, 1], "o", ms=4, label=name
    )
_ = axis.set(xlabel="error of the place [mm]", ylabel="of the turn [degrees]")
_ = axis.legend(fontsize=8, loc="center")
plt.show()

# %% [markdown]
# A table that is told 5 mm too high shows: the picture *refutes* those poses.
#
# ### What the model leaves out
#
# One camera, one picture, planes and simple solids, and a noise with steps and shared pixels. What is left out was
# added, one thing at a time, and the place compared:

# %%
rows = "tolerance", "lens", "dark", "pixels", "shadow", "another", "motion"
figures(read("scene_known_part"), *rows, summary="The whole scene")

# %% [markdown]
# All together stay below the tolerance. One thing that does not: a depth scale that is 1 % wrong moves a pose by
# several tolerances (a card above), and no test inside sees it. At some per cent the outline does: it no longer fits.
#
# ### Interfaces, and what a failure says
#
# <table>
# <tr><th>piece</th> <th>takes</th> <th>gives</th> <th>checks</th></tr>
# <tr><td><code>Camera</code></td> <td>intrinsics</td> <td>rays; pixels of points</td> <td>a picture's shape and unit:
# metres, not millimetres</td></tr>
# <tr><td><code>Sensor</code></td> <td>baseline, noise, window, steps, range</td> <td>$\sigma_z$; a picture with that
# noise</td> <td>each number in its range</td></tr>
# <tr><td><code>locate</code></td> <td>picture, camera, sensor, part, maybe the table</td> <td>a list of
# <code>Estimate</code>, the best first</td> <td>all of these</td></tr>
# <tr><td><code>Estimate</code></td> <td></td> <td>pose, covariance, matched, residual, see-through, unobserved,
# status</td> <td>it is never <i>found</i> where the picture refutes it, shows more, or tells no place</td></tr>
# <tr><td><code>Tracker</code></td> <td>stamp, (x, y, turn), covariance</td> <td>the same at any later time</td> <td>no
# picture older than the last</td></tr>
# </table>
#
# The caller of `locate` must know what to do with each answer. Nothing on the table is an answer, no exception:

# %%
square, other = shape("box", 0.05, 0.0499, 0.03), shape("box", 0.05, 0.03, 0.03)
for name, part, available, then in (
    ("an empty table", BOX, (), "wait, or ask for parts"),
    ("the part", BOX, (stand(BOX, 0.03, 0.0, 0.0, 0.5),), "grasp"),
    ("half out of the picture", BOX, (stand(BOX, 0.03, 0.45, 0.0, 0.5),), "move the camera"),
    ("nearly square", square, (stand(square, 0.03, 0.0, 0.0, 0.5),), "both ways must be safe"),
    ("a can", can, (stand(can, 0.04, 0.0, 0.0, 0.5),), "grasp: its turn is free"),
    ("another part", BOX, (stand(other, 0.03, 0.0, 0.0, 0.5),), "leave it, report it"),
):
    result = locate(take_image(SENSOR, 5, *available), EYE, SENSOR, part)
    verdict = "; ".join(" ".join((one.status, *one.unobserved)) for one in result)
    print(f"{name:<24} {verdict or '[]':<13} -> {then}")

# %% [markdown]
# ### Rates and ages

# %%
predict("keeps_up")

# %% [markdown]
# Six stages, each timed here on one core, against the 33 ms that a camera leaves at thirty pictures a second:

# %% tags=["nbval-ignore-output"]
one = locate(noticed, EYE, SENSOR, BOX)[0]


def closes(one, gap=0.0025, finger=0.01):
    """Return whether fingers 20 mm wide, 5 mm farther apart than the part, go around it at 3 sigma
    [m].
    """
    shift, turn = 3.0 * np.sqrt(np.diag(one.covariance)[[1, 5]])
    return one.status == "found" and shift + finger * turn < gap


stages = {
    "picture": lambda: sense(render(scene, EYE)[0], EYE, SENSOR, rng),
    "points": lambda: perception.back_project(noticed, EYE),
    "table": lambda: perception.ransac_plane(points[:, ::37], 0.006, rng, at_most=200),
    "things": lambda: perception.components(high.reshape(noticed.shape), EYE, 0.012),
    "poses": lambda: locate(noticed, EYE, SENSOR, BOX),
    "grasp": lambda: closes(one),
}
clocks = [calls(stage, clock=time.process_time) for stage in stages.values()]
took = [1e3 * timed.median for timed in interleaved(clocks, repeats=5, sample=5e-3)]
took[4] -= sum(took[1:4])  # `locate` does these, too
print(" -> ".join(f"{name} {ms:.2g}" for name, ms in zip(stages, took, strict=True)), "ms")
whole, start = sum(took[1:]), time.process_time()
locate(noticed, EYE, SENSOR, BOX, least=1000)
large = 1e3 * (time.process_time() - start)
print(f"after the picture {whole:.0f} ms, {whole / 33.3:.0%} of 33; closes: {closes(one)}")
print(f"where only things as large as the box are tried: {large:.0f} ms")

# %% [markdown]
# Nearly all of it are the poses: several starts for each thing on the table, be it the part or not. The picture, which
# is simulated, is not counted. `closes` asks for three standard deviations of place and turn together: a part may be
# found and still be known too badly to close on.
#
# Two numbers are easily mixed: *throughput*, one over the slowest stage if stages overlap, and *latency*, their sum
# with exposure and transport before it. A loop at a kilohertz waits for neither: it follows a reference, which a new
# pose moves.

# %%
show("pipeline_keeps_up")

# %% [markdown]
# *A pose error of 2 mm is fine*: you will derive when, in section 8. `closes` is that sum to first order, with the
# covariance.
#
# For a whole system (chapter 11) all this is too much. `stand_in` is the model of this chapter in two numbers a place,
# a bias and a covariance:

# %%
place = stand(BOX, 0.03, 0.05, 0.0, 0.8)
bias, spread = perception.stand_in(EYE, shared, BOX, place.poses)
chain = [locate(take_image(shared, seed, place), EYE, shared, BOX)[0].p for seed in range(40)]
along = rotate(conjugate(place.poses[3:, 0]), np.transpose(chain) - place.poses[:3])
message = 1e3 * np.sqrt(np.diag(spread[:, :, 0]))[:2]
measured = 1e3 * along[:2].std(axis=1)
print("spread of x and y [mm]: the chain", *measured.round(3), "stand_in", *message.round(3))

# %% [markdown]
# ## 5 · Code, and the simulation in full
#
# ### The listing, line by line
#
# Five steps that every tutorial has. Here each is ours, run on the picture above, and the same line of Open3D beside
# it:

# %%
cloud, _ = perception.back_project(noticed, EYE)  # 1 points of the picture
cells, _ = perception.voxel_mean(cloud, 0.005)  # 2 one mean a voxel
plane, near, tried = perception.ransac_plane(cells, 0.01, np.random.default_rng(0))  # 3 the table
rest = np.ascontiguousarray(cells[:, ~near])
labels, core = perception.dbscan(rest, 0.02, 50)  # 4 clusters
boxes = [np.ptp(rest[:, labels == k], axis=1) for k in range(labels.max() + 1)]  # 5 their boxes

theirs = open3d.Cloud(cloud)
theirs = theirs.array(theirs.voxel_mean(0.005))
a, b = (some[:, np.lexsort(some.round(9))] for some in (cells, theirs))  # in one order
their_plane, _ = open3d.Cloud(cells).plane(0.01, 1000)
lean = np.degrees(np.linalg.norm(np.cross(plane[:3], their_plane[:3])))
noise = labels < 0
same = np.array_equal(noise, open3d.Cloud(rest).dbscan(0.02, 50) < 0)
float32 = np.abs(cloud - open3d.Picture(noticed, EYE).points()).max()
print(f"1 points: {float32:.0e} m apart; float32 there")
print(f"2 voxels: {cells.shape[1]}, {np.abs(a - b).max():.0e} m apart")
print(f"3 planes: {lean:.4f} degrees apart, after {tried} draws here and 1000 there")
print(f"4 clusters: {labels.max() + 1}, {noise.sum()} points of noise, the same there: {same}")
print("5 extents [mm]:", *((1e3 * box).round().astype(int) for box in boxes))
print("  true: a can of 60 x 80, a box of", (2e3 * BOX.sizes[:, 0]).astype(int), "- no plate")

# %% [markdown]
# The usual listing of tutorials has these lines, with 50 neighbours for 5 mm voxels (a card in section 2), a box's
# extent for the size of its object (a formula in section 8), and a first comment that says *from a depth image*:

# %%
show("tutorial_runs")

# %% [markdown]
# The heart of the chapter, as it stands in the module: what the picture says to a pose, and what is known.

# %%
text = "\n\n".join(inspect.getsource(f) for f in (pose.verdict, perception.known))
Markdown(f"```python\n{text}```")

# %% [markdown]
# A bad picture is refused, by name:

# %%
for wrong in (1000.0 * noticed, (1000.0 * noticed).astype(np.uint16), noticed.T, 0.0 * noticed):
    try:
        locate(wrong, EYE, SENSOR, BOX)
    except ValueError as problem:
        print(textwrap.fill(str(problem), 96))

# %% [markdown]
# Points from above in the colour of their cluster, the plane grey, noise black; outlines are found poses over true
# ones. Sliders for voxels, tolerance, eps, neighbours, distance, noise, correlation and depth scale; menus for clusters
# and plane. Drag a part, or its knob to turn it. Go through the presets, and say first what will happen:
#
# 1. *Table in clusters*: which slider cures it, and what is lost then?
# 2. *Touching*: does any eps part them, and what is said of the direction along the row?
# 3. *Cut off*: what do residual and see-through say?
# 4. *Scale error*: does any number notice?

# %%
simulation("perception", "Touching")

# %% [markdown]
# ## 6 · Speed against accuracy
#
# Each step beside the library that is used for it, at equal answers, by processor time:
#
# ![Time of the library over that of the course, and clusters by the number of points](../docs/charts/cloud_speed.png)

# %%
print_figures("cloud_speed", "picture", "points", "voxels of 5", "plane, early", "course", "Open3D")

# %% [markdown]
# A whole frame, three boxes on a table in 320 x 240 pixels, with the chain of the listing in both and then ICP:
#
# ![Where the time of a frame goes, beside Open3D](../docs/charts/frame_speed.png)

# %%
print_figures("frame_speed", "course", "Open3D", "locate", "poses")

# %% [markdown]
# And the pose alone, over the voxel size, with white noise and with noise that neighbours share:
#
# ![Error of a pose over its time, by voxel size](../docs/charts/pose_precision.png)

# %%
print_figures(
    "pose_precision", "white noise, shape", "white noise, pick", "noise shared over 5 px, pick"
)

# %% [markdown]
# A coarse grid rounds edges and so biases the pose; a grid finer than the noise costs time and buys nothing. *What to
# pick.* For a gripper with millimetres to spare, whatever is quickest. For a tenth of that the shape itself on a grid
# of some millimetres, with the shared noise in mind. For clusters of one picture components of its pixels; DBSCAN where
# points come from several. For the table RANSAC on a few thousand points, then the linear fit to all pixels near it.
#
# ## 7 · Debug: where it fails
#
# ### Lost parts
#
# How low may a part be? The tolerance must be some $\sigma_z$, or the table itself becomes parts; and then a part must
# be higher than that, and have neighbours enough:
#
# ![The lowest part that is found, and clusters of bare table](../docs/charts/lost_parts.png)

# %%
print_figures("lost_parts", "10 mm", "4 mm", "3 sigma")

# %% [markdown]
# Left, *nan* is where not even the highest part was found. Right, what a tolerance below the noise makes of a bare
# table. Only the tolerance that follows the noise has neither.
#
# <div class="alert alert-block alert-info">
#
# **Interview question.** *Your robot has a depth camera looking down at a bin of parts. Small parts are missed by the
# detector. Large parts have inaccurate poses. Diagnose both.*
#
# Answer aloud. The model answer, its follow-ups and what is listened for are in section 10, under *Staff*.
#
# </div>
#
# Small parts: points of cubes after each stage, with the settings of the listing, and the smallest cube that each cure
# finds:
#
# ![Which stage loses a small part, and what each cure costs](../docs/charts/small_parts.png)

# %%
print_figures("small_parts", "pixels", "voxels", "above", "clustered")

# %%
rows = "as in", "nearer", "tolerance", "grid of", "neighbours", "3 sigma,", "and 5"
figures(read("small_parts"), *rows, summary="The counts, too")

# %% [markdown]
# One cure alone may buy nothing: where two stages lose the part, count first. Large parts: what one calls the pose,
# down, and what goes wrong, across, in millimetres and degrees:
#
# ![Seven estimators of a pose, and what goes wrong](../docs/charts/large_parts.png)

# %%
rows = "median", "centroid", "box along them", "principal", "ICP, points", "ICP, shape", "locate  "
figures(read("large_parts"), *rows, cut="scale", summary="All, and what `locate` says to each")

# %% [markdown]
# ### Debugging
#
# Two symptoms: say a cause for each before you read on.
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *Small parts are missed.* Count the part's points after each stage: pixels, voxels, above the
# plane, in a cluster. The first zero names the stage. No pixels: nearer, or a longer lens. None above the plane: the
# tolerance in $\sigma_z$, not in millimetres of habit. Not clustered: neighbours as a third or less of
# $\pi(\epsilon/v)^2$.
#
# <details><summary>What people get wrong there</summary>
#
# They make voxels smaller first. A voxel grid loses no part that has a pixel; below two cells across its means may be
# shared with the table and stand lower. What it changes is the number of neighbours, and with `min_points` as it was a
# *finer* grid helps, for that reason and not for the one that is told.
#
# </details>
#
# </div>
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The pose is noisy from picture to picture.* Compare its spread at rest with the covariance that it
# reports. Equal: it is the sensor; average a part that rests, filter one that moves. Larger by about the window: noise
# is shared, and the covariance has to know. Jumps between two places: a symmetry, or two starts that win in turn. A
# drift: the camera warms up, or each picture is registered to the one before instead of to the model.
#
# <details><summary>What people get wrong there</summary>
#
# They average a fixed number of pictures. For a part that moves that is a lag, and a lag is not noisy: it looks better,
# and from some speed on it is worse than the last picture.
#
# </details>
#
# </div>

# %%
show("spread_of_symmetric_poses")

# %% [markdown]
# <table> <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr> <tr><td>dozens of clusters of table</td>
# <td>tolerance below the noise</td> <td>spread of heights over the bare table</td> <td>4 sigma of the
# distance</td></tr> <tr><td>right in the middle of the picture, wrong at its edge</td> <td>a range taken for a depth, a
# turn the wrong way round</td> <td>targets at corners</td> <td>the exercise <code>point_in_base</code></td></tr>
# <tr><td>everything shifted by about a millimetre</td> <td>half a pixel</td> <td>where is pixel 0?</td> <td>the middle
# of W columns is (W - 1)/2</td></tr> <tr><td>all too near by a per cent</td> <td>depth scale, focal length</td> <td>a
# known length at two distances</td> <td>calibrate it; at one per cent nothing inside the chain will tell</td></tr>
# <tr><td>pose good, grasp beside the part</td> <td>extrinsics</td> <td>touch a point far from those of the
# calibration</td> <td>more points</td></tr> <tr><td>small residual, wrong pose</td> <td>another face, cut off</td>
# <td>see-through; does it reach the edge?</td> <td>more starts; a gate that narrows</td></tr> </table>
#
# ## 8 · Exercises
#
# Graded exercises. `check` asks your cell on cases drawn afresh, and says what is wrong and, if it can, why.
#
# ### From a picture to points

# %%
card("back_project")


# %%
def back_project(picture, fx, fy, cx, cy, unit):
    """Return the points that a depth picture shows, row by row."""
    # All on the optical axis.
    z = np.asarray(picture, dtype=float).ravel() * unit
    return np.array([0.0 * z, 0.0 * z, z])


check(back_project)

# %% [markdown]
# ### The best rigid motion

# %%
card("rigid_fit")


# %%
def rigid_fit(source, target, weights):
    """Return the rigid motion that brings points onto their partners best."""
    # No turn, and all points count the same.
    return np.eye(3), np.mean(target, axis=1) - np.mean(source, axis=1)


check(rigid_fit)

# %% [markdown]
# ### The table

# %%
card("plane_ransac")


# %%
def plane_ransac(points, triples, tolerance, confidence):
    """Return the plane near which most points lie, fitted once more to them."""
    # All points lie on the level plane through the first.
    return np.array([0.0, 0.0, 1.0, -points[2][0]]), np.arange(len(points[0])), 1


check(plane_ransac)

# %% [markdown]
# ### One step of ICP

# %%
card("point_to_plane_step")


# %%
def point_to_plane_step(points, model, normals):
    """Return one step of ICP from points to planes."""
    # The means onto each other, whatever the matches.
    return np.eye(3), np.mean(model, axis=1) - np.mean(points, axis=1)


check(point_to_plane_step)

# %% [markdown]
# ### Clusters

# %%
card("dbscan")


# %%
def dbscan(points, eps, least):
    """Return the cluster of each point, -1 for noise."""
    # All are one.
    return np.zeros(np.shape(points)[1])


check(dbscan)

# %% [markdown]
# ### What the points do not tell

# %%
card("blind_directions")


# %%
def blind_directions(points, normals, lever, least):
    """Return the motions of a part that its measured points do not tell."""
    # All is seen.
    return 0, np.zeros((6, 6))


check(blind_directions)

# %% [markdown]
# ### Silent-bug hunt
#
# Its author has tested it: a target in the middle of the picture, the arm at rest.

# %%
card("point_in_base")


# %%
def point_in_base(pixels, stamp, camera, mount, log):
    """Return where what a camera at a moving arm has seen is in the base, shape (3, n) [m]."""
    u, v, z = np.asarray(pixels, dtype=float)
    fx, fy, cx, cy = camera
    in_camera = np.array([(u + 0.5 - cx) / fx * z, (v + 0.5 - cy) / fy * z, z])
    rows = np.asarray(log, dtype=float).T
    rows = np.vstack((rows[:4], np.unwrap(rows[4])))
    flange = np.array([np.interp(stamp + 0.1, rows[0], row) for row in rows[1:]])

    def moved(pose, points):
        c, s = np.cos(pose[3]), np.sin(pose[3])
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return R @ points + pose[:3, None]

    turned = np.asarray(mount, dtype=float) * np.array([1.0, 1.0, 1.0, -1.0])
    return moved(flange, moved(turned, in_camera))


check(point_in_base)

# %% [markdown]
# ### Formulas: a calibration, half a pixel, a box, two fingers
#
# Any equivalent form is right. <span class="kernel-only">Change the texts.</span>

# %%
answer("calibration_residual", "sigma")

# %%
answer("half_a_pixel", "z/f")

# %%
answer("extent_is_size", "L")

# %%
answer("two_millimetres_will_do", "e")

# %% [markdown]
# ## 9 · Frontier: networks that see
#
# <table>
# <tr><th>work</th> <th>year</th> <th>what is new</th> <th>needs</th> <th>what is said of it, and what its paper
# says</th></tr>
# <tr><td>Contact-GraspNet (Sundermeyer and others, ICRA)</td> <td>2021</td> <td>proposes grasps where fingers may
# touch, for things it never saw</td> <td>a depth picture</td> <td>"grasps for novel objects": with a success rate, no
# proof</td></tr>
# <tr><td>FoundationPose (Wen and others, arXiv 2312.08344)</td> <td>2023</td> <td>poses of things that it was not
# trained on</td> <td>colour, depth, a mask; a mesh or reference pictures</td> <td>"one picture, no CAD": a small number
# of them, of which a shape is made first. "All in 60 ms": 1.3 s for a first pose on an RTX 3090, 32 a second while it
# tracks</td></tr>
# <tr><td>SAM 2 (Ravi and others, arXiv 2408.00714)</td> <td>2024</td> <td>masks from a click, carried through a
# video</td> <td>a picture, a click or box</td> <td>"a perfect mask": its results are mean overlaps, below one, better
# with more clicks</td></tr>
# <tr><td>SpatialVLM (Chen and others, arXiv 2401.12168)</td> <td>2024</td> <td>answers in metres</td> <td>one colour
# picture, a question</td> <td>"phrases become coordinates": distances and sizes are estimated, in words; no gripper's
# tolerance among its tests</td></tr>
# </table>
#
# None of these is measured here. What runs here is small: a network that looks at a patch of heights and says how
# an L-shaped part is turned. It was trained on some thousand of our pictures, and its answer is where ICP starts.

# %%
print(f"{yaw_net.WEIGHTS:,} weights, a patch of {yaw_net.SIDE} x {yaw_net.SIDE} heights")

# %%
predict("network_and_mirror")

# %% [markdown]
# ![Share of right poses and time by start, and what the picture says](../docs/charts/learned_start.png)

# %%
print_figures(
    "learned_start", "noise x 1,", "noise x 3.75, 4", "noise x 3.75, network", "a mirrored"
)

# %%
show("network_knows_its_part")

# %% [markdown]
# One start in place of four, and as often right: that is what it buys. With nearly four times the noise it loses no
# more than four starts do, as it is the fit that fails then. And the slightly wrong poses that are left nobody notices,
# see-through included: it tells another part, not a millimetre.
#
# Read the table above with this chapter's questions. What does it need as input? What is its error *against a truth*,
# in millimetres and at which distance? What does it answer to a thing that it doesn't know? A network is a good
# proposer. What refutes a proposal need not be trained.
#
# ## 10 · Interview
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** *The pipeline, with times.* Say a stage, its input, its tolerance and where that comes from, and
# how it fails: picture, $z^2 s/(fB)$; points; table, four sigma; things, components of pixels; poses, several starts, a
# covariance, see-through; grasp, the sum of errors against the gap. Times are those of your machine, from section 4,
# with the age that they add. A time without a machine and a number of parts is no time.
#
# </div>
#
# Answer aloud, then open: first what one says in a minute, then the whole of it, then what comes next.

# %%
interview("perception")

# %% [markdown]
# ### Checkpoint
#
# Three formulas that are not on this page; you can derive them from what is. The gate opens when all are right.

# %%
checkpoint("perception", depth_bias="", farthest_part="", fit_residual="")
