# %% [markdown]
# # 7 · Perception
#
# *A depth camera looks at a table. Where is the known part, to 2 mm and 2 degrees, so that a gripper can close on it?*
#
# About {open minutes} minutes of reading, cards and charts. The folded parts add {folded minutes} minutes, the
# exercises {exercise minutes} minutes. The answers of the interview are not counted.
#
# Answer the card first<span class="kernel-only">, run the cells, then drag a part</span>.

# %%
from course.cards import predict
from course.simulations import simulation

predict("lost_plate")

# %% [markdown]
# ![A table under a depth camera](attachment:perception.png)
#
# *Each dot is a measured point. Grey dots count as table: in this picture, they are within 8 mm (dashed red) of its
# plane (solid red). Each other colour is one part. Green outlines are estimated poses; they hide the dashed outlines of
# the true ones.*

# %%
simulation("perception")

# %% [markdown]
# *Predicted* is the standard deviation that the program itself expects of its pose. The list's last number should
# be near zero; section 3 explains it.
#
# **You will be able to** estimate a depth camera's noise from its data sheet and an assumed matching error; follow a
# part through every stage of a perception pipeline and name the stage that loses it; compute a pose together with its
# uncertainty; say which motions of a part an image cannot determine; and detect wrong poses that look right. **Know
# first:** chapter 1's quaternions and poses; least squares; eigenvalues.
#
# ## The pipeline in six stages
#
# A gripper needs a position and an orientation: six numbers. A depth camera delivers tens of thousands, one per
# pixel. Between them lie six stages. Each can lose the part or shift it.

# %% tags=["nbval-ignore-output"]
from drills.notebook import answer, badges, card, check, checkpoint, your_robot

badges(7)

# %% tags=["hide-code"]
import inspect
import re
import textwrap
import time
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Markdown
from matplotlib.colors import ListedColormap

from course import perception
from course.cards import figures, interview
from course.charts import read, stored
from course.charts.perception import learned
from course.charts.perception.poses import BOX, EYE, SENSOR, TABLE
from course.derivations import more_claims, show
from course.derivations.records import figure
from course.kinematics.chain import compose
from course.measure.timing import calls, interleaved
from course.oracles import open3d
from course.page_records import from_record
from course.perception import Camera, Sensor, locate, pose, render, sense, shape, together, yaw_net
from course.rigid_body.quaternion import conjugate, exp, rotate

BLUE, ORANGE, GREY, GREEN = "#0072b2", "#d55e00", "#7f7f7f", "#009e73"


def print_figures(chart, *rows):
    """Print the lines of a chart's key figures that begin so, no wider than a page."""
    for line in read(chart).splitlines():
        if line.lstrip().startswith(rows):
            words = " ".join(line.split())
            print(textwrap.fill(words, 96, subsequent_indent="    "))


def curve(chart, label, panel=0):
    """Return x and y of a curve of a stored chart."""
    one = next(one for one in stored(chart)[panel].series if one.label == label)
    return np.array(one.x), np.array(one.y)


CLEARER = {
    "lens, 0.2 px at corners": "lens after calibration, 0.2 px at the corners",
    "dark stripes, noise x 3": "dark stripes in the image",
    "two sensors in one image": "three times the noise in every second stripe",
    "shadow of the second eye": "pixels hidden from the second camera",
    "a second image": "the scene computed from there, too",
    "another projector": "false matches where another projector dazzles",
    "5% of pixels, in blocks": "wrong depths in 5% of the pixels, in blocks",
}


def omitted():
    """Return the effects that the chapter's world omits, the shift of each [mm], and its model."""
    lines = [re.split(r"\s{2,}", line) for line in read("scene_known_part").splitlines()]
    lines = [[CLEARER.get(word, word) for word in line] for line in lines]
    return [(one[0], 1e3 * float(one[2]), one[4]) for one in lines if "left out" in one]


def table_of(*rows):
    """Return rows of text as a table; the first one is the head."""
    lines = [f"| {' | '.join(map(str, row))} |" for row in rows]
    return Markdown("\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]))


# %% tags=["hide-code"]
STAGES = {
    "image": "a depth\nfor each pixel",
    "points": "x, y, z of\neach pixel",
    "table": "the plane, which\nis removed",
    "clusters": "one group of\npoints per part",
    "poses": "position, rotation,\nuncertainty",
    "grasp": "the same in the\narm's frame, now",
}
one_pixel = 1e3 * float(SENSOR.sigma(0.8, EYE))
EPS = 0.012  # radius within which points are neighbours [m]
ERRORS = (
    ("image", "noise of one pixel", one_pixel, BLUE),
    (
        "points",
        f"image centre off by half\na pixel, at {figure('half_a_pixel', 'far'):.2f} m",
        figure("half_a_pixel", "shift_mm"),
        ORANGE,
    ),
    ("table", "lowest part: 3 times the\nnoise of one pixel", 3.0 * one_pixel, "none"),
    ("clusters", "smallest gap between\ntwo parts (section 2)", 1e3 * EPS, "none"),
    (
        "poses",
        "pixels with\nindependent errors",
        1e3 * curve("pose_precision", "shape")[1].min(),
        BLUE,
    ),
    (
        "poses",
        "neighbours\nsharing errors",
        1e3 * curve("pose_precision", "shape", 1)[1].min(),
        BLUE,
    ),
    (
        "grasp",
        "3 touched points,\nfor calibration",
        figure("calibration_residual", "far_mm"),
        ORANGE,
    ),
    ("grasp", "pose 0.1 s old,\nat 200 mm/s", figure("pipeline_keeps_up", "late_mm"), ORANGE),
    ("grasp", "old pose, predicted\nto the present", figure("pipeline_keeps_up", "left_mm"), BLUE),
)
figure_, (top, axis) = plt.subplots(
    2, 1, figsize=(9.5, 5.0), height_ratios=(1, 2.6), sharex=True, layout="constrained"
)
places = {name: k for k, name in enumerate(STAGES)}
for name, k in places.items():
    box = {"boxstyle": "round,pad=0.5", "fc": "#e8eef7", "ec": BLUE}
    _ = top.text(
        k, 0.0, f"{k + 1} {name}\n{STAGES[name]}", ha="center", va="center", fontsize=8, bbox=box
    )
    if k:
        arrow = {"arrowstyle": "-|>", "color": "black", "lw": 1.5}
        _ = top.annotate("", (k - 0.41, 0.0), (k - 0.59, 0.0), arrowprops=arrow)
_ = top.set(ylim=(-1, 1), xlim=(-0.5, 5.5))
top.axis("off")
for name, label, mm, colour in ERRORS:
    _ = axis.plot(
        places[name] - 0.36, mm, "o", mfc=colour, mec=BLUE if colour == "none" else colour
    )
    side = "top" if 0.9 < mm < 2.0 else "center"  # clear of the line of the tolerance
    digits = 3 if name in ("image", "table", "clusters") else 2
    text = f"{label}\n{mm:.{digits}g} mm"
    _ = axis.text(places[name] - 0.29, mm, text, fontsize=8, va=side)
_ = axis.axhline(2.0, color=GREY, ls="--")
_ = axis.text(-0.48, 2.2, "the gripper allows 2 mm", fontsize=8, color=GREY)
_ = axis.set(yscale="log", ylim=(0.015, 45), xticks=[], ylabel="error or limit [mm]")
plt.show()

# %% [markdown]
# *Above: the six stages and what each one passes on. Below: the main error of each, in this chapter's experiments.
# Orange points are avoidable mistakes. Blue points remain when you work carefully; which of the two blue ones in stage
# 5 applies depends on the camera (section 1). Hollow points are limits: a lower part disappears in the noise of the
# table, and two parts with a smaller gap become one cluster.*
#
# The noise of a single pixel is not far below the 2 mm that the gripper allows. The pose is far more accurate, because
# it averages thousands of pixels. The two largest errors don't come from the noise of the image. One is the age of the
# pose: the part moves on before the gripper closes. The other is a poor calibration: the arm touched only three points,
# at most 0.3 m apart. At a part 0.6 m above them, an error of 1 mm in each of their coordinates becomes the error in
# the figure.
#
# All images are computed, so the true poses are known.
#
# ## 1 · Concept: what a depth camera measures
#
# ### The pinhole camera and its depth image
#
# A **depth image** holds for each pixel the **depth** $z$: the distance *along the camera's axis*, not along the ray
# from the camera to the point. In the camera's frame, $x$ points to the right and $y$ down. A **pinhole** camera
# shows the point $(x, y, z)$ in column $u$ and row $v$ of the image:
#
# $$u = f_x\,\frac{x}{z} + c_x, \qquad v = f_y\,\frac{y}{z} + c_y .$$
#
# In words: divide the sideways position by the depth, multiply by the focal length, and add the coordinate of the
# **principal point**, where the axis meets the image. The focal lengths $f_x$ (for columns) and $f_y$ (for rows) and
# the principal point $(c_x, c_y)$, all in pixels, are the **intrinsics** of the camera.
#
# **A worked example.** With $f = 300$ pixels, a part that is 30 mm wide and 1 m away covers $300 \cdot 0.03 / 1 = 9$
# pixels. At half the distance it covers 18.
#
# This chapter's scene is a table with a box, a can and a thin plate.

# %% tags=["hide-code"]
can, plate = shape("cylinder", 0.03, 0.04), shape("box", 0.03, 0.03, 0.003)


def stand(part, high, x, y, yaw):
    """Return a part of half the height `high` that stands on the table at x, y.

    In the camera's frame.
    """
    on_table = np.array([x, y, high, *exp(np.array([0.0, 0.0, yaw]))])
    return part.moved(compose(TABLE[:, None], on_table[:, None])[:, 0])


def take_image(sensor, seed, *present):
    """Return a noisy depth image of the table with parts on it."""
    exact, _ = render(together([shape("plane").moved(TABLE), *present]), EYE)
    return sense(exact, EYE, sensor, np.random.default_rng(seed))


parts = (stand(BOX, 0.03, -0.12, 0.02, 0.7), stand(can, 0.04, 0.1, 0.08, 0.0))
scene = together([shape("plane").moved(TABLE), *parts, stand(plate, 0.003, 0.12, -0.1, 0.3)])
rng = np.random.default_rng(0)
exact, ids = render(scene, EYE)
noticed = sense(exact, EYE, SENSOR, rng)
colours = ListedColormap(["#cfd8dc", "#3f51b5", "#e65100", "#2e7d32"])
figure_, axes = plt.subplots(1, 3, figsize=(9, 2.5), dpi=58, layout="constrained")
shown = axes[0].imshow(exact)
_ = figure_.colorbar(shown, ax=axes[0], shrink=0.8)
error = axes[1].imshow(1e3 * (noticed - exact), vmin=-3, vmax=3, cmap="coolwarm")
_ = figure_.colorbar(error, ax=axes[1], shrink=0.8)
_ = axes[2].imshow(ids, cmap=colours)
for axis, title in zip(axes, ("depth [m]", "its error [mm]", "what a pixel sees"), strict=True):
    _ = axis.set(title=title, xticks=[], yticks=[])
plt.show()
print(f"image           {EYE.width} x {EYE.height} pixels, focal length {EYE.fx:.1f} pixels")
print(
    "pixels of parts",
    ", ".join(
        f"{n} {np.count_nonzero(ids == k)}" for k, n in enumerate(("box", "can", "plate"), 1)
    ),
)

# %% [markdown]
# *Left: the exact depth. Middle: the error of the noisy image. Right: which part each pixel sees.* The error grows
# towards the top of the image, where the table is farther away. The worked example answers this:

# %%
show("small_parts_have_few_pixels")

# %% [markdown]
# ### Pixels without a measurement: 0 and NaN
#
# No depth camera measures every pixel. A surface may be black, shiny or without texture, a point near an edge may be
# hidden from one of a stereo sensor's two cameras, and something may be out of range. Such a pixel has **no
# measurement**, and a driver has to write *something*.
#
# Many drivers write 0, as do raw images in millimetres. In ROS (REP 118), a depth image in metres marks a missing
# measurement with NaN ("not a number"), and uses infinities for what is out of range. A zero that is treated as a depth
# becomes a point at the origin of the camera's frame. If one term of a sum is NaN, the sum is NaN. And every comparison
# with NaN except `!=` is false, so a test such as `if z < 0` finds no error.
#
# So convert once, when you read the image. This chapter's `Camera.picture` turns every NaN and every infinity into 0,
# and every later stage skips zeros.
#
# The cell below uses **`locate`**, this chapter's complete pipeline. It takes a depth image, the camera (its
# intrinsics), the sensor (its noise) and the shape of a known part. It returns a list of estimated poses, each with a
# **status**: *found* means that no test of the image objects to the pose. Some wrong poses pass all tests (section 3).
# We remove a tenth of the pixels and mark them first with 0, then with NaN:

# %% tags=["hide-code"]
missing = np.random.default_rng(1).random(noticed.shape) < 0.1
alone = take_image(SENSOR, 2, stand(BOX, 0.03, 0.0, 0.0, 0.7))
as_zero, as_nan = (
    locate(np.where(missing, mark, alone), EYE, SENSOR, BOX)[0] for mark in (0.0, np.nan)
)
print(f"missing pixels  {np.count_nonzero(missing)} of {missing.size}")
print(f"marked with 0   {as_zero.status}; marked with NaN: {as_nan.status}")
print(f"same pose       {np.array_equal(as_zero.pose, as_nan.pose)}")
print(f"mean of an image with NaN: {np.mean(np.where(missing, np.nan, alone))} m")

# %% [markdown]
# Depth images are stored as metres in floating point, or as millimetres in 16-bit integers. A program that reads
# these integers as metres sees the table 800 m away. `locate` rejects such an image. It also rejects swapped rows and
# columns, unless the image is square:

# %% tags=["hide-code"]
for wrong in (1000.0 * noticed, noticed.T):
    try:
        locate(wrong, EYE, SENSOR, BOX)
    except ValueError as problem:
        print(textwrap.fill(str(problem), 96))

# %% [markdown]
# ### Lens distortion: the pinhole is an approximation
#
# A real lens does not show straight lines as straight lines. Near the border of the image, points land farther
# out or in than the pinhole says. Take a point at depth 1, at the distance $r$ from the axis. The usual model,
# **radial distortion**, multiplies $r$ by a polynomial:
#
# $$r_\text{lens} = r\,(1 + k_1 r^2 + k_2 r^4 + \dots) .$$
#
# The numbers $k_1, k_2, \dots$ belong to the lens. Calibration with a checkerboard estimates them together with the
# intrinsics.

# %% tags=["hide-code"]
x, y = EYE.rays()
grid = np.linspace(0.0, 1.0, 40)
figure_, axes = plt.subplots(1, 3, figsize=(9, 2.4), layout="constrained", sharey=True)
for axis, k1, title in zip(
    axes, (-0.5, 0.0, 0.5), ("barrel", "pinhole", "pincushion"), strict=True
):
    for part in np.linspace(-1, 1, 9):
        for gx, gy in ((part + 0 * grid, 2 * grid - 1), (2 * grid - 1, part + 0 * grid)):
            px, py = gx * x[-1], gy * y[-1]
            scale = 1 + k1 * (px**2 + py**2)
            _ = axis.plot(px * scale, py * scale, color=BLUE, lw=1)
    _ = axis.set(title=f"{title}, k1 = {k1:g}", aspect="equal", xticks=[], yticks=[])
plt.show()
far = np.hypot(x[0], y[0])  # of a corner from the axis, at depth 1
print(f"k1 = -0.5 moves a corner of this chapter's image by {0.5 * far**3 * EYE.fx:.0f} pixels")
what, shift, _ = omitted()[0]
print(f"{what}: the estimated pose of a box moves by {shift:.2f} mm")

# %% [markdown]
# *A straight grid as three lenses show it.*
#
# Correct the distortion first. Most drivers deliver a **rectified** image, in which this is done, with intrinsics of
# its own. And don't interpolate between the pixels of a *depth* image, because that mixes two surfaces at every edge.
# Keep each depth, and correct the direction of its ray instead.
#
# ### Noise: the square of the distance
#
# A **stereo** camera consists of two cameras, a **baseline** $B$ apart. They see the same point in different columns.
# The difference of the columns is the **disparity** $d$. Similar triangles give $d = fB/z$, where $f$ is the focal
# length: the disparity of near points is large, that of far ones small.

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(8, 2.6), layout="constrained")
left, right, focal = np.array([0.0, 0.0]), np.array([0.0, 0.2]), 0.25
for z, colour in ((0.7, BLUE), (1.6, ORANGE)):
    spread = 0.012
    for eye in (left, right):
        _ = axis.plot([eye[0], z], [eye[1], 0.1], color=colour, lw=1)
    slope_l, slope_r = 0.1 / z, -0.1 / z
    hits = [0.2 / ((slope_l + a * spread) - (slope_r - a * spread)) for a in (-1, 1)]
    _ = axis.plot(hits, [0.1, 0.1], color=colour, lw=6, alpha=0.5, solid_capstyle="butt")
    _ = axis.text(z, 0.125, f"z = {z} m", ha="center", color=colour, fontsize=9)
_ = axis.plot([0, 0], [0, 0.2], "ks")
_ = axis.annotate("", (-0.05, 0.0), (-0.05, 0.2), arrowprops={"arrowstyle": "<->"})
_ = axis.text(-0.08, 0.1, "baseline B", ha="right", va="center", fontsize=9)
_ = axis.set(xlim=(-0.35, 2.3), ylim=(-0.03, 0.23), yticks=[], xlabel="distance z [m]")
plt.show()

# %% [markdown]
# *Two cameras (squares) and two points. Each ray has the same small error in its angle. The thick bars show the depths
# that can result.*
#
# To find the disparity, an algorithm searches where the two images match. Suppose that its error has a standard
# deviation $s$ of a fraction of a pixel, the same at every distance.

# %%
predict("twice_as_far")

# %% [markdown]
# Take the derivative of $z = fB/d$ with respect to $d$, multiply its size by $s$, and replace $d$ by $fB/z$. The result
# is the **depth noise** $\sigma_z$, the standard deviation of the depth:
#
# $$\boxed{\;\sigma_z = \frac{z^2}{f\,B}\,s\;}$$
#
# <details><summary>Derive: the law of noise, and what rounding adds; an example</summary>
#
# **A worked example.** With $f = 300$ pixels, $B = 5$ cm and $s = 0.1$ pixel, at one metre the noise is $0.1 / (300
# \cdot 0.05)$ m, which is 6.7 mm. At half a metre it is a quarter of that.
#
# $z = fB/d$, so $\mathrm{d}z = -fB/d^2\,\mathrm{d}d = -z^2/(fB)\,\mathrm{d}d$. A sensor that rounds disparities to
# steps of $q$ pixels adds an error that is nearly uniform between $-q/2$ and $q/2$. Its variance is the mean of $x^2$
# over that interval, $q^2/12$. So $s$ becomes $\sqrt{s^2 + q^2/12}$, as long as $s$ is not small compared with $q$.
# The upper right panel of the chart below shows what happens when it is. A second-order effect is left, because $1/d$
# is curved; the checkpoint may ask for it.
#
# </details>

# %%
show("noise_is_one_number")

# %% [markdown]
# Here are two stereo cameras: a RealSense D435, 848 pixels wide, and one with a longer focal length and a wider
# baseline. Data sheets say $B$ and the field of view, from which $f$ follows, but hardly ever $s$; we assume 0.1 pixel.
# To measure yours, fit a plane to a flat wall with texture that faces the camera, and multiply the spread of the depths
# about it by $fB/z^2$. The result includes the rounding.

# %% tags=["hide-code"]
z = np.linspace(0.2, 3.0, 50)
figure_, axis = plt.subplots(figsize=(6, 2.2), layout="constrained")
for name, width, view, base in (("D435", 848, 87.0, 0.05), ("larger f, B", 1280, 60.0, 0.12)):
    eye, sensor = Camera.symmetric(width, width // 2, np.radians(view)), Sensor(base, 0.1)
    _ = axis.semilogy(z, 1e3 * sensor.sigma(z, eye), label=name)
    message = ", ".join(
        f"{1e3 * sensor.sigma(far, eye):.2f} mm at {far} m" for far in (0.3, 1.0, 2.0)
    )
    print(f"{name:<11} f {eye.fx:4.0f} px, B {1e3 * base:3.0f} mm: {message}")
_ = axis.set(xlabel="distance [m]", ylabel="depth noise [mm]")
_ = axis.legend()
plt.show()

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Before you choose any algorithm, calculate $z^2 s/(fB)$ for your camera and distance.  A part that is
# only one or two $\sigma_z$ high cannot be distinguished from the table by single pixels.
#
# </div>
#
# ### Averaging pixels: neighbours share their noise
#
# A result such as a plane or a pose is computed from many pixels. A matrix, its **covariance**, says how accurate it
# is. On the diagonal stand the variances of the result's numbers. The other entries say how the errors of two of these
# numbers are related. Noise that is independent from pixel to pixel is called **white noise**. With white noise, the
# variance of the mean of $N$ pixels is that of one pixel divided by $N$.
#
# But a stereo camera compares *windows* of several pixels, and the windows of two neighbours overlap almost completely.
# Both therefore make nearly the same error: they have **shared noise**.
#
# Many sensors also round the disparity to a multiple of a **step**. Without noise, all pixels of a wall that faces the
# camera are rounded alike, so their mean has the whole error of the rounding. With enough noise, some are rounded up
# and others down, and the error of the mean shrinks.

# %%
show("pixels_are_independent")

# %% [markdown]
# ![The law of noise, what averaging leaves, and shared noise](../docs/charts/depth_noise.png)
#
# *Upper left: measured noise against the distance, with the law as a line. Upper right: the true disparity lies a
# quarter of a step above a value that the sensor can report. The curve shows the error of the mean against the noise,
# both in steps (negative: rounded down). Below: how many times noisier the mean of a square of pixels is with
# overlapping windows than with independent pixels of the same noise.*

# %%
print_figures("depth_noise", "a quarter", "window 5")

# %% [markdown]
# For a patch much larger than the window, shared noise multiplies the spread (standard deviation) of the mean by about
# the width of the window, here 5. A program that treats the pixels of such a patch as independent reports a variance
# that is about $5^2 = 25$ times too small.

# %%
more_claims("averaging_removes_all")

# %% [markdown]
# ### Kinds of depth sensors
#
# Stereo uses **triangulation**: it computes the depth from two directions, and the noise grows with the square of the
# distance. Many stereo cameras also project a pattern, which gives a white wall a texture. A **time-of-flight**
# sensor measures how long light travels to the surface and back. Its noise grows where less light comes back, as from
# far or dark surfaces.
#
# <details><summary>Five kinds of sensors: law, weakness and source; and common statements about them</summary>
#
# <table>
# <tr><th>sensor</th> <th>measures</th> <th>law of its error</th> <th>breaks at</th> <th>source</th></tr>
# <tr><td>passive stereo</td> <td>shift between two images</td> <td>$z^2 s/(fB)$</td> <td>no texture, repeated
# texture</td> <td>Keselman and others, arXiv 1705.05548, 2017</td></tr>
# <tr><td>active stereo (RealSense D435)</td> <td>the same, with a projected texture</td> <td>$z^2 s/(fB)$</td>
# <td>strong sun on the texture; shiny parts</td> <td>Intel, D400 data sheet, revision 0.7, 2017</td></tr>
# <tr><td>structured light (Kinect v1)</td> <td>shift of a known pattern</td> <td>$z^2 s/(fB)$</td> <td>sun; two
# projectors</td> <td>Khoshelham and Elberink, Sensors 12, 2012</td></tr>
# <tr><td>time of flight by phase (Azure Kinect)</td> <td>phase $\varphi$ of light modulated at $f_m$</td>
# <td>$\frac{c}{4\pi f_m}\,\sigma_\varphi$, $c$: speed of light</td> <td>several light paths; dark parts; sun</td>
# <td>Tölgyessy and others, Sensors 21, 2021</td></tr>
# <tr><td>LiDAR with pulses (OS1)</td> <td>time $t$ of a pulse, there and back</td> <td>$\frac{c}{2}\,\sigma_t$</td>
# <td>few points; edges; glass</td> <td>Ouster, OS1 data sheet, edition with 850 nm lasers</td></tr>
# </table>
#
# *Stereo fails on surfaces without texture.* The passive kind does. A projector gives a white wall a texture, which is
# why the table has separate rows.
#
# *The D435 uses structured light.* Its data sheet (revision 0.7, September 2017) says stereo, with an optional
# infrared projector that adds texture. Nothing is decoded from the pattern, so a second projector adds texture
# and spoils only the pixels that it dazzles (section 4).
#
# *Structured light suffers in sunlight.* So does time of flight, because the sun adds shot noise. Tölgyessy and others
# (Sensors 21, 413, 2021) found the Azure Kinect, a time-of-flight camera, unusable in direct sun. Active stereo loses
# only its projected texture: on surfaces with a texture of their own it still measures.
#
# *Time of flight suffers from several light paths.* Yes. The phases of the direct path and of a reflected one add up,
# and corners come out round. This is a bias, so averaging does not help. The corresponding error of stereo is a false
# match.
#
# *LiDAR is pulsed, expensive and sparse.* Some are pulsed; others modulate the frequency. Sparse: compared with an
# image, yes. Expensive: a statement about a year.
#
# *640 x 480 at 30 images a second.* One of the modes. The family's table lists depth up to 1280 x 720, and up to 90
# images a second.
#
# *Below a millimetre close up*, *1 to 3 mm*: both occur, at different distances (see the card on noise above). For the
# OS1, the edition in the table states a repeatability of 1.5 to 10 cm by signal-to-noise ratio. Other editions list it
# by distance.
#
# </details>
#
# ## 2 · Concept: from an image to clusters of points
#
# ### Points and voxels
#
# **Back-projection** inverts the pinhole and turns pixels into points in space: $x = (u - c_x)\,z/f_x$ and $y = (v -
# c_y)\,z/f_y$. Some sensors report the length of the ray instead of $z$. Then divide it by the length of
# $((u-c_x)/f_x,\;(v-c_y)/f_y,\;1)$ first.
#
# A **voxel grid** divides space into cubes, the voxels, and replaces the points in each cube with their mean. There are
# fewer points then, and they are about equally dense everywhere, as long as a pixel is narrower than a cube.

# %% tags=["hide-code"]
row = int(np.argmax(np.count_nonzero(ids == 1, axis=1)))  # the row with most of the box
columns = np.flatnonzero(ids[row] == 1)
columns = np.arange(columns[0] - 12, columns[-1] + 13)
rays_x, _ = EYE.rays()
in_row = np.array([rays_x[columns] * noticed[row, columns], 0 * columns, noticed[row, columns]])
corner = 0.01 * np.floor(100 * in_row.min(axis=1))  # the grid that is drawn
centres, _ = perception.voxel_mean(in_row, 0.01, corner)
figure_, axis = plt.subplots(figsize=(7, 2.6), layout="constrained")
_ = axis.plot(1e3 * centres[0], 1e3 * centres[2], "o", color=ORANGE, ms=7, label="means of voxels")
_ = axis.plot(
    1e3 * in_row[0], 1e3 * in_row[2], ".", color="black", ms=4, label="points of one image row"
)
steps_x, steps_z = (
    np.arange(np.floor(a.min() * 100), np.ceil(a.max() * 100) + 1) * 10 for a in in_row[::2]
)
_ = axis.set_xticks(steps_x, minor=True)
_ = axis.set_yticks(steps_z, minor=True)
axis.grid(which="both", lw=0.5)
axis.invert_yaxis()
_ = axis.set(xlabel="x [mm]", ylabel="depth z [mm]")
_ = axis.legend(fontsize=8)
plt.show()

# %% [markdown]
# *One row of the image, back-projected: the table on both sides, the box between. The grid shows the cubes, whose edge
# is 10 mm.*
#
# If the centre of the first pixel has the coordinate 0, the middle of $W$ columns is $(W-1)/2$ and not $W/2$. A
# principal point that is half a pixel off moves each point sideways in proportion to its depth. The depths on a table
# are similar, so all points move almost alike, and no test inside the pipeline notices.
#
# ### The table: RANSAC
#
# To find what stands on the table, you first need the table. A least-squares plane through *all* points is too high and
# tilted, because the parts pull at it. **RANSAC** (random sample consensus, Fischler and Bolles 1981) mostly avoids
# this by guessing and voting:
#
# 1. Sample three points and compute the plane through them.
# 2. Count the points whose distance from the plane is at most the **plane tolerance**. Each is an **inlier**.
# 3. Repeat. Keep the plane with the most inliers.
# 4. Fit the plane again, to all its inliers.

# %% tags=["hide-code"]
rng_ = np.random.default_rng(4)
flat = np.array([rng_.uniform(0, 1, 30), 0.02 * rng_.standard_normal(30) + 0.2])
raised = np.array([rng_.uniform(0.45, 0.75, 16), rng_.uniform(0.3, 0.6, 16)])
dots = np.hstack((flat, raised))
figure_, axes = plt.subplots(1, 2, figsize=(8, 2.2), layout="constrained", sharey=True)
for axis, pair, name in ((axes[0], (3, 40), "a bad sample"), (axes[1], (1, 0), "a good sample")):
    (x0, y0), (x1, y1) = dots[:, pair[0]], dots[:, pair[1]]
    slope = (y1 - y0) / (x1 - x0)
    inlier = np.abs(dots[1] - y0 - slope * (dots[0] - x0)) / np.hypot(1, slope) < 0.05
    line = np.array([0.0, 1.0])
    _ = axis.plot(line, y0 + slope * (line - x0), color=BLUE)
    for offset in (-0.05, 0.05):
        _ = axis.plot(
            line, y0 + slope * (line - x0) + offset * np.hypot(1, slope), "--", color=BLUE, lw=0.8
        )
    _ = axis.plot(*dots[:, ~inlier], "o", ms=3, color=GREY)
    _ = axis.plot(*dots[:, inlier], "o", ms=4, color=ORANGE)
    _ = axis.plot([x0, x1], [y0, y1], "ko", ms=7, mfc="none")
    _ = axis.set(title=f"{name}: {inlier.sum()} inliers", ylim=(0, 0.7), xticks=[], yticks=[])
plt.show()

# %% [markdown]
# *RANSAC in two dimensions: two sampled points (circles) define a line. Points within the plane tolerance (dashed) are
# its inliers (orange).*
#
# How many samples do you need? Let a share $w$ of the points lie on the table. If there are many points, three random
# ones all lie on it with probability $w^3$, and $n$ samples all fail with probability $(1 - w^3)^n$. If at least one
# sample is to succeed with probability $P$, this must equal $1 - P$. Solve for $n$:
#
# $$n = \frac{\log(1 - P)}{\log(1 - w^3)} .$$
#
# **A worked example.** With half of the points on the table, $w^3 = 1/8$. For $P = 0.99$ you need $\log 0.01 / \log
# 0.875$, which is about 35 samples.
#
# So the formula promises one sample of three table points. We say that a run *finds* the table if at least 90% as many
# table points are within the tolerance of its plane as are within that of the *true* plane. Is a plane through three
# table points already that good?

# %%
show("draws_find_the_plane")

# %% [markdown]
# ![How often the plane is found with the number of samples that the formula gives](../docs/charts/ransac_draws.png)
#
# *Share of runs that find the table, against the plane tolerance divided by the noise. Half of the 200 points lie on
# the table. Dotted: the promised probability. Three noisy points make a tilted plane, so without step 4 (no refit) the
# share stays below the promise. Step 4 (one refit), and repeating it (two refits), repair most of this from twice the
# noise on.*
#
# For the fit of step 4, write the plane as $1 = a\,x + b\,y + c\,z$, with three unknown numbers $a$, $b$ and $c$, and
# divide by $z$:
#
# $$\frac{1}{z} = a\,\frac{x}{z} + b\,\frac{y}{z} + c .$$
#
# The ratios $x/z$ and $y/z$ follow from the column and the row of the pixel, which are exact. Only $1/z$, on the left,
# has noise. With stereo, $1/z$ is proportional to the disparity, whose noise is the same everywhere. So an ordinary
# least-squares fit to $1/z$ gives every pixel the right weight.

# %%
show("inverse_depth_is_better")

# %% [markdown]
# ![Angle of the table against time, and its offset against the noise](../docs/charts/plane_precision.png)
#
# *Left: error of the plane's angle against computing time. Two methods fit table pixels only, from a thousandth of them
# (top) to all (bottom): a singular value decomposition (SVD) of the points, without weights, and the fit of $1/z$
# (inverse depth). RANSAC is given all pixels, a box among them, and 3 (top) to 300 samples; its refit is an SVD.
# Dotted: a tilt of 0.2 mm on 100 mm. Right: systematic offset of the plane against the noise.*
#
# The fit of $1/z$ gains most from many pixels. RANSAC without a refit stays far less accurate, even with 300 samples.
# Of many tilted planes, the one with the most inliers leans towards the box, to take in some of its points. And the
# largest plane may be a wall. So check: is it where the calibration puts the table, with the same normal (the direction
# perpendicular to it)?
#
# ### One cluster per part: DBSCAN and connected components
#
# **DBSCAN** (Ester and others 1996) groups points by density. A point with enough neighbours within a radius `eps`,
# itself included, is a **core point**. Core points that are neighbours of each other belong to the same cluster. A
# point that is no core point joins the cluster of a core point within `eps`. If there is none, the point is noise. So
# two parts become one cluster if core points of both are within `eps` of each other, and a part with too few points
# vanishes as noise.
#
# In a depth image there is a faster method. A **connected component** is a set of adjacent pixels whose depths differ
# by less than a given limit from one pixel to the next. If the limit is too large, neighbouring parts are joined. If it
# is too small, one part is cut in two at a steep face. At any limit, touching parts of equal depth are joined, and
# something in front may cut a part in two.
#
# How many neighbours should DBSCAN require? Take a flat face with one point per voxel, and let $v$ be the edge of a
# voxel. A disc of radius $\epsilon$ (`eps`) on this face holds about $\pi\epsilon^2/v^2$ points. Around a point at the
# edge of the face, only half of the disc lies on it.

# %%
show("fifty_neighbours")

# %% [markdown]
# So the points at an edge need a limit below half of $\pi\epsilon^2/v^2$. For parts wider than `eps`, require a third,
# for example.

# %% tags=["hide-code"]
points, pixels = perception.back_project(noticed, EYE)
plane, near, tried = perception.ransac_plane(points, 0.004, rng)
above = points[:, (plane[:3] @ points + plane[3] > 0) & ~near]
means, _ = perception.voxel_mean(above, 0.004)
high = np.zeros(noticed.size)
over = plane[:3] @ points + plane[3] > 0.004
high[pixels[over]] = points[2, over]
by_density, _ = perception.dbscan(means, EPS, 8)
by_pixels = perception.components(high.reshape(noticed.shape), EYE, 0.012)
counts = np.bincount(by_pixels[by_pixels >= 0])
large = np.isin(by_pixels, np.flatnonzero(counts >= 40))
figure_, axes = plt.subplots(1, 2, figsize=(8, 2.6), layout="constrained")
noise = by_density < 0
_ = axes[0].scatter(*means[:2, noise], c="black", s=2)
_ = axes[0].scatter(*means[:2, ~noise], c=by_density[~noise], s=2, cmap="Dark2", vmax=7)
_ = axes[0].set(
    title=f"DBSCAN, eps {1e3 * EPS:.0f} mm", aspect="equal", xlabel="x [m]", ylabel="y [m]"
)
axes[0].invert_yaxis()
names = np.unique(np.where(large, by_pixels, -1), return_inverse=True)[1].reshape(noticed.shape)
_ = axes[1].imshow(np.where(large, names - 1.0, np.nan), cmap="Dark2", vmax=7)
_ = axes[1].contourf(~large & (by_pixels >= 0), levels=[0.5, 1.5], colors=["black"])
_ = axes[1].set(title="components of 40 pixels or more", xticks=[], yticks=[])
plt.show()
print(f"{points.shape[1]} points, {above.shape[1]} above the plane, {means.shape[1]} voxels")
print(f"DBSCAN: clusters of {np.bincount(by_density[~noise])} voxels, {noise.sum()} noise")
print(f"pixels: clusters of {counts[counts >= 40]}, {counts[counts < 40].sum()} in smaller ones")

# %% [markdown]
# *The same image, clustered in two ways. Colours are clusters, black is noise. Left: voxels of 4 mm.*

# %%
more_claims(
    "voxels_remove_small_parts",
    "ransac_takes_the_table",
    "dbscan_separates",
    "dbscan_has_no_order",
)

# %% [markdown]
# ## 3 · Concept: from a cluster to a pose
#
# ### Rigid fit: known pairs
#
# Suppose you knew for each measured point to which point of the model it belongs. Then the pose is a **rigid fit**: the
# rotation $R$ and shift $p$ that minimise the sum of squared distances between the pairs. There is a closed form
# (Kabsch 1978):
#
# 1. Subtract the mean $\bar a$ from the model points $a_i$, and the mean $\bar b$ from the measured points $b_i$.
# 2. With these differences, form the $3 \times 3$ matrix $H = \sum_i (a_i - \bar a)(b_i - \bar b)^\mathsf{T}$.
# 3. Decompose $H = U S V^\mathsf{T}$, the singular value decomposition (SVD).
# 4. Set $R = V\,\mathrm{diag}(1, 1, \det(V U^\mathsf{T}))\,U^\mathsf{T}$ and $p = \bar b - R\,\bar a$.
#
# The determinant in step 4 is easily forgotten. Without it, $V U^\mathsf{T}$ is the best *orthogonal* matrix, which
# may also be a mirror, and no robot can mirror a part. When do you expect this to matter: for points that fill a
# thick body, or for points that are nearly flat?

# %%
show("kabsch_without_determinant")

# %% [markdown]
# ### ICP: guessed pairs
#
# You don't know the pairs. **ICP**, iterative closest point (Besl and McKay 1992; Chen and Medioni 1991), guesses them:
# each measured point belongs to the closest point of the model. Pairs farther apart than a limit, the **gate**, are
# ignored. Then ICP fits the pose, moves the model, and guesses again. The **residual** is the root mean square of the
# distances that remain.
#
# Two versions are common. Point-to-point pulls each point to its partner. **Point-to-plane** counts only the distance
# along the model's normal, so points can slide along a surface, and a wrong partner on the same plane costs nothing.
#
# For a box, a cylinder or a sphere, you don't need points of a model: there is a formula for the closest point.

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 3, figsize=(9, 2.4), layout="constrained")
corners = np.array([[-1, -0.6], [1, -0.6], [1, 0.6], [-1, 0.6], [-1, -0.6]]).T
s = np.linspace(-0.9, 0.9, 7)
data = np.hstack((np.array([s, 0 * s + 0.6]), np.array([0 * s[:5] + 1.0, s[:5] * 0.6])))
for axis, degrees, title in zip(
    axes, (35, 12, 0), ("guess the pairs", "fit, guess again", "converged"), strict=True
):
    a = np.radians(degrees)
    R = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    local = R.T @ data
    nearest = np.clip(local, [[-1], [-0.6]], [[1], [0.6]])
    inside = (abs(local[0]) < 1) & (abs(local[1]) < 0.6)
    up = inside & (0.6 - abs(local[1]) < 1 - abs(local[0]))
    nearest[1, up] = 0.6 * np.sign(local[1, up])
    side = inside & ~up
    nearest[0, side] = np.sign(local[0, side])
    partner = R @ nearest
    _ = axis.plot(*(R @ corners), color=BLUE)
    _ = axis.plot(*np.stack((data, partner), axis=1).reshape(2, 2, -1), color=GREY, lw=1)
    _ = axis.plot(*data, "o", color=ORANGE, ms=4)
    _ = axis.set(
        title=title, aspect="equal", xticks=[], yticks=[], xlim=(-1.3, 1.3), ylim=(-1.1, 1.1)
    )
plt.show()

# %% [markdown]
# *A model (blue) and measured points of two of its sides (orange). Grey lines join each point to the closest point of
# the model: the guessed pairs.*
#
# ICP is a local search. The set of starting poses from which it reaches the right pose is its **basin**. A **symmetry**
# of a part is a turn after which it looks the same: 90 degrees for a prism with four equal sides. So the prism has four
# equal poses. Suppose that only one of them is right, because one side has a mark that the depth camera does not see.
# From a start that is more than 45 degrees off, you expect ICP to end in the next of the four poses. At 45 degrees, the
# pulls towards two poses cancel.
#
# ![Where ICP converges to the right pose, and its iterations](../docs/charts/icp_basin.png)
#
# *Left: error of the final turn against the error of the starting turn, for prisms with different numbers of sides. The
# starts are 2.3 degrees apart. With four sides, the last start below 45 degrees stops almost where it began. Right:
# iterations for a box, against the error of the start. Point-to-plane (planes), and the shape given by a formula, need
# about a tenth of the iterations of point-to-point (points).*

# %%
print_figures("icp_basin", "3", "4", "6", "points", "planes", "shape")

# %% [markdown]
# To get into the basin, `locate` starts ICP at several turns and keeps the best result. **Global registration** needs
# no start. It describes the surface around each point by a short vector, a **descriptor**. It pairs points with similar
# descriptors, and keeps the pairs that one rigid motion explains. For a part on a table several starts are simpler,
# because only one angle is unknown if you know which side is down.

# %%
more_claims("icp_comes_home", "own_points_come_home", "picture_to_picture")

# %% [markdown]
# ### Covariance of a pose: what the points determine
#
# A pose is six numbers. How accurate is each of them? Take one measured point $q$ on a face with normal $n$, both in
# the part's frame. The point determines only how far the face is from it, along $n$. Now shift the part by a small
# $t$, and turn it by a small rotation vector $r$ about the origin of its frame. Up to the sign, the distance between
# point and face changes by $n\cdot t + (q \times n)\cdot r$. So each point contributes one row $J$. The rows of all
# points make the **information matrix**, and its inverse is the covariance of the pose. Here $\sigma$ is the standard
# deviation of the distance:
#
# $$J = \big(\,n^\mathsf{T},\; (q \times n)^\mathsf{T}\,\big), \qquad \text{information} = \sum \frac{J^\mathsf{T}
# J}{\sigma^2}, \qquad \text{covariance} = \text{information}^{-1} .$$
#
# **A worked example.** A hundred points on one flat face have 1 mm of independent noise each. At their middle, the
# height of the face has a standard deviation of $1/\sqrt{100}$ mm, which is 0.1 mm. About a shift *along* the face
# the points say nothing: its entries are zero in every row.
#
# In least squares, $\sum J^\mathsf{T} J$ is called the **normal matrix**. If each row is first divided by its $\sigma$,
# as here, it is the information matrix. Each step of point-to-plane ICP solves a linear system with it. A motion
# without information is **unobserved**. Then the matrix has a zero eigenvalue and no inverse. What should a program
# return in this case?

# %%
predict("turn_of_a_can")

# %%
show("what_is_not_seen")

# %% [markdown]
# Many programs add a small number to the diagonal so that the matrix can be inverted. This produces a finite variance
# for something that was never measured. The honest answer is infinity, together with the name of the direction.
#
# Are the *finite* variances honest? Let $e$ hold the errors of the observed directions, and let $P$ be their predicted
# covariance. The **NEES** (normalised estimation error squared) is $e^\mathsf{T} P^{-1} e$. Its mean over many images,
# divided by the number of these directions, should be one. But near an edge, a noisy point may be closest to a face
# that the camera cannot even see. ICP then assumes that this face was measured.

# %%
show("normal_matrix_is_covariance")

# %% [markdown]
# The last iterations of `icp` therefore compare each point with the shape *along its own ray* (projective
# association): where does this pixel's ray hit the model?
#
# ![Squared error over predicted variance, and shared noise](../docs/charts/pose_covariance.png)
#
# *Left: mean NEES, divided by the number of observed directions, for a box of which the camera sees three, two or one
# faces, a cylinder and a sphere. Right: the spread of the pose, divided by its spread with independent pixels, against
# the width of the matching window. The band reaches from the smallest to the largest of the pose's six numbers. The
# thin line is the width of the window.*

# %%
print_figures("pose_covariance", "closest", "along", "window 7")

# %% [markdown]
# As in section 1, shared noise makes this covariance too small. For a window of $w$ pixels, the true variances are up
# to $w^2$ times as large. To be on the safe side, `locate` takes the whole factor $w^2$ for the points. To check a
# covariance, place the part in a fixture at several known poses, and use the errors.
#
# ### The outline of a part
#
# Look at a box from straight above. All its points lie on one horizontal face, so they determine its height and two
# tilts, and nothing else. Yet you can *see* where it is, because you see its edge.
#
# The **outline** is the set of border pixels of the part, where it hides something farther away. Suppose that each
# pixel shows the surface that its central ray hits. Then the true edge lies between the centre of a border pixel and
# that of its outer neighbour, and the midpoint of the two is wrong by half a pixel at most. Draw the edge of the model
# into the image, too, and measure the distance of each midpoint from this edge in pixels.

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(7, 2.4), layout="constrained")
edge_of = np.poly1d([0.22, 3.2])  # row at which the true edge crosses a column
drawn = np.poly1d([0.22, 2.55])
inside = np.arange(7)[:, None] > edge_of(np.arange(12))[None, :]
_ = axis.pcolormesh(
    np.arange(13) - 0.5,
    np.arange(8) - 0.5,
    inside,
    cmap=ListedColormap(["#ffffff", "#cfd8dc"]),
    edgecolors="#b0b0b0",
    lw=0.5,
)
top_row = np.argmax(inside, axis=0)
line = np.array([-0.5, 11.5])
_ = axis.plot(line, edge_of(line), color="black", label="true edge")
_ = axis.plot(line, drawn(line), color=BLUE, label="drawn edge of the model")
_ = axis.plot(np.arange(12), top_row - 0.5, "o", color=ORANGE, ms=5, label="midpoints")
for column, row_ in enumerate(top_row - 0.5):
    foot = column + 0.22 * (row_ - drawn(column)) / (1 + 0.22**2)
    _ = axis.plot([column, foot], [row_, drawn(foot)], color=GREY, lw=1)
_ = axis.set(aspect="equal", xlim=(-0.5, 11.5), ylim=(6.5, -0.5), xticks=[], yticks=[])
_ = figure_.legend(fontsize=8, loc="outside right center")
plt.show()

# %% [markdown]
# *Pixels of the part are grey. The fit moves the model until the grey lines, from the midpoints to the drawn edge, are
# as short as possible.*
#
# Each border pixel adds a row $(m^\mathsf{T}, (q \times m)^\mathsf{T})$. Here $q$ is a point on the part's edge in
# space, the one whose image is nearest to the midpoint. The vector $m$ points outwards, across the edge. It turns a
# motion in metres into a distance in pixels, so its length is about $f/z$, the number of pixels per metre. The
# midpoint's error is spread evenly over one pixel: $\sigma = 1/\sqrt{12}$ pixel, about 0.29. Along an edge that is
# parallel to the pixel rows, all midpoints have the same error, so `locate` counts them for less. These rows determine
# $x$, $y$ and the turn.
#
# Where something nearer covers the part, the border belongs to *that* object and must not be used.

# %%
more_claims("outline_tells", "spread_of_symmetric_poses")

# %% [markdown]
# <details><summary>What the outline costs and gains: error against time</summary>
#
# ![Error of a pose with and without the outline, against time](../docs/charts/outline_precision.png)
#
# *Error of a corner of the box (root mean square) against the time of a pose, for images that are 80 to 1280 pixels
# wide, from the top. Points: the course's ICP fits x, y and the turn. Points and outline: with the outline as well, as
# in `locate`. Open3D fits six numbers to a cloud of the model's points. All start 8 mm and 3.4 degrees off.*
#
# From straight above, the points alone end about half a pixel off. From a wrong start, some of them lie beyond the edge
# of the model's top. They pull the model until it covers them all; then nothing holds it, and *unobserved* is the right
# word. The outline makes the error several times smaller, and it does so where three faces are visible, too. Its price
# is time. In small images, most of this time is overhead of Python.
#
# </details>

# %% [markdown]
# ### See-through: right, or only consistent?

# %%
predict("which_number_tells")

# %% [markdown]
# A small residual says that the measured points lie on the model. It says nothing about parts of the model where
# nothing was measured. But where the camera really measures the *table*, there cannot be an opaque part in between.
#
# The **see-through** test uses this. Draw the model at its estimated pose into the image. Count the pixels in which the
# part should be and the camera measured something clearly *behind* it. Divide by the number of all pixels of the model
# that have a measurement. If calibration and depths are right (on a shiny part, depths may be wrong), this share is a
# few per cent at most for a right pose. `locate` refutes a pose above a tenth.

# %% tags=["hide-code"]
figure_, axes = plt.subplots(1, 3, figsize=(9, 2.3), layout="constrained")
cases = ("right", "turned by 90 degrees", "across two equal parts")
for axis, title in zip(axes, cases, strict=True):
    if title.startswith("across"):
        measured = ((-1.5, 0, 1.5, 0.6), (0, 0, 1.5, 0.6))
        model = (-0.75, 0, 1.5, 0.6)
    elif title == "right":
        measured, model = ((-0.8, 0, 1.6, 0.6),), (-0.8, 0, 1.6, 0.6)
    else:
        measured, model = ((-0.4, 0, 0.8, 0.6),), (-0.8, 0, 1.6, 0.6)
    for x0, y0, w, h in measured:
        _ = axis.add_patch(plt.Rectangle((x0, y0), w, h, color="#cfd8dc"))
    _ = axis.add_patch(plt.Rectangle(model[:2], *model[2:], fill=False, ec=BLUE, lw=2))
    for ray in np.linspace(-1.8, 1.8, 13):
        on = any(x0 <= ray <= x0 + w for x0, _, w, _ in measured)
        through = not on and model[0] <= ray <= model[0] + model[2]
        _ = axis.plot(
            [ray, ray], [1.6, 0.6 if on else 0.0], color=ORANGE if through else GREY, lw=1
        )
    _ = axis.axhline(0, color="black")
    _ = axis.set(title=title, xlim=(-2, 2), ylim=(-0.1, 1.7), xticks=[], yticks=[])
plt.show()

# %% [markdown]
# *Seen from the side: parts (grey), the estimated pose (blue), the camera's rays from above. Orange rays reach the
# table where the part should be, and so refute the pose.*

# %%
show("looked_through_is_wrong")

# %% [markdown]
# The right panel shows the test's limit. Two equal parts that touch are **twins**. Every pixel of a model between them
# is covered by *something*, so see-through can't object. Nor can it if the part on the table is larger than the model.
#
# The opposite question helps: does the pose explain all that was measured? Take all pixels of the drawn model and of
# the cluster. A pixel **agrees** if both have the same depth there, up to the noise. The other pixels are **left
# over**. `locate` does not report *found* when too many are left over, or when the border is off the model's outline.
# A **near twin**, which differs from the model by one or two pixels, is still taken for it. A part that leans a little
# passes as standing unless you free its tilt (`standing=False`).

# %%
show("not_looked_through_is_right")

# %% [markdown]
# ![How often a part of slightly different length is taken for the model](../docs/charts/near_twins.png)
#
# *How often a box that is a little longer or shorter than the model is reported as* found*. Dotted: the differences at
# which the border is as far off the outline as `locate` allows (0.75 pixel, root mean square), if the whole difference
# is at one end, or half of it at each end.*

# %%
print_figures(
    "near_twins", "320 x 240 p", "320 x 240, longer:", "640 x 480 p", "640 x 480, longer:"
)

# %% [markdown]
# With little noise, the points of the visible end hold the model there, so the limit is that of *one end off*. With
# more noise and coarse pixels, the outline pulls the model towards the middle, and larger differences pass. At 320 x
# 240 pixels, *found* does not guarantee 2 mm if near twins are among the parts. At twice the resolution, all *found*
# poses were within 2 mm.
#
# ![Residual and see-through of right and wrong poses](../docs/charts/silently_wrong.png)
#
# *Residual (left) and see-through share (right) of fitted poses, against the true error of their position. The table
# below names the four cases. For the quarter turn, the error includes the path of the box's end, 80 mm times
# the angle. Dotted: poses above it are refuted.*


# %% tags=["hide-code"]
def span(form, values, unit=""):
    """Return the smallest and the largest value as text, or one if they look the same."""
    low, high = (format(end(values), form) for end in (np.min, np.max))
    return (low if low == high else f"{low} to {high}") + unit


CASES = {
    "right": "right",
    "quarter turn": "quarter turn: the fit started 90 degrees off",
    "cut off": "cut off: more than half of the box is outside the image",
    "scale 1 % off": "scale 1 % off: all depths are 1 % too long",
}
rows = [("12 poses each", "within 2 mm", "the others are off by", "residual", "see-through")]
for name, case in CASES.items():
    (error, residual), (_, through) = (curve("silently_wrong", name, panel) for panel in (0, 1))
    wrong = error[error > 0.002]
    rows.append(
        (
            case,
            error.size - wrong.size,
            span(".1f", 1e3 * wrong, " mm") if wrong.size else "-",
            span(".1f", 1e3 * residual, " mm"),
            span(".1%", through),
        )
    )
table_of(*rows)

# %% [markdown]
# The quarter turn has a large residual *and* a large see-through share. The wrong ones of the cut-off boxes are
# centimetres off, but their residual is less than twice that of a right pose. See-through refutes four of these six.
# The wrong scale moves every pose by several millimetres. Neither number shows this, because the wrong depths move the
# pose and the table alike. A program that knows the true table can notice it.

# %% tags=["hide-code"]
upwards = rotate(TABLE[3:], np.array([0.0, 0.0, 1.0]))
true_table = np.append(upwards, -upwards @ TABLE[:3])
looks = [
    take_image(SENSOR, seed, stand(BOX, 0.03, 0.0, 0.0, yaw))
    for seed, yaw in enumerate(np.linspace(0.2, 2.9, 10))
]


def is_found(case):
    """Return whether the box is found in an image whose depths are scaled."""
    scale, given, seed = case
    return locate(scale * looks[seed], EYE, SENSOR, BOX, table=given)[0].status == "found"


every = [(scale, t, k) for scale in (1.01, 0.99) for t in (None, true_table) for k in range(10)]
box_found = from_record("perception.scaled_depths", is_found, every, checked=4)
n_found = np.reshape(box_found, (2, 2, 10)).sum(axis=2)
for what, (n_unknown, n_known) in zip(("1 % too long", "1 % too short"), n_found, strict=True):
    print(f"depths {what:<14} found: {n_unknown} of 10, with the true table given: {n_known} of 10")

# %% [markdown]
# <div class="alert alert-block alert-warning">
#
# **Key insight.** Judge a fit by data that it did not use. Points say where something is; an image also says where
# nothing is. What neither can reveal, such as a small error of the depth scale or a wrong base frame, needs something
# known from outside: the table's position, a length, or a touch.
#
# </div>

# %%
more_claims("a_residual_tells")

# %% [markdown]
# ### Extrinsics and hand-eye calibration
#
# The arm needs the pose in its base frame, so you need the camera's own pose in the base: its **extrinsics**.
#
# **A fixed camera.** Touch several points with the arm and measure them with the camera. This is a rigid fit. Its
# residual may be small although the pose is poor: it shows only errors that change the distances between the points.
# All others go into the pose unseen; for three points, these are six of nine numbers. The error at the part depends on
# the number of points, on how far apart they are, and on how far the part lies outside of them (Fitzpatrick, West and
# Maurer 1998).
#
# **A camera on the hand.** Let $X$ be the camera's pose in the hand's frame. Move the arm while the camera watches a
# fixed target. The arm reports the hand's motion $A$, and the images show the camera's motion $B$. Two paths lead from
# the old hand frame to the new camera frame, and they must agree:
#
# $$A\,X = X\,B .$$
#
# This is **hand-eye calibration**. The rotation comes first. In each motion, hand and camera turn about the same axis.
# Their frames describe it by different vectors, and the rotation of $X$ turns the camera's vector into the hand's. Then
# the shift of $X$ follows from linear equations.

# %% tags=["hide-code"]
figure_, axis = plt.subplots(figsize=(7, 2.6), layout="constrained")
frames = {
    "hand, before": (0, 1),
    "hand, after": (2.2, 1),
    "camera, before": (0, 0),
    "camera, after": (2.2, 0),
}
for name, (px, py) in frames.items():
    box = {
        "boxstyle": "round,pad=0.4",
        "fc": "#e8eef7" if "hand" in name else "#fdebd9",
        "ec": GREY,
    }
    _ = axis.text(px, py, name, ha="center", va="center", bbox=box, fontsize=9)
for start, end, label, at in (
    ((0.5, 1), (1.75, 1), "A (from the joints)", (1.1, 1.1)),
    ((0.55, 0), (1.65, 0), "B (from the images)", (1.1, -0.2)),
    ((0, 0.8), (0, 0.2), "X (unknown)", (0.38, 0.5)),
    ((2.2, 0.8), (2.2, 0.2), "X (the same)", (2.6, 0.5)),
):
    _ = axis.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "lw": 1.5})
    _ = axis.text(*at, label, ha="center", fontsize=9)
_ = axis.set(xlim=(-0.7, 3.1), ylim=(-0.4, 1.3))
axis.axis("off")
plt.show()

# %% [markdown]
# *The two paths: across and then down must equal down and then across.*
#
# Which motions you make matters more than how many. On a planar arm, all of them turn about the same axis. Then the
# camera's position along this axis stays unknown:

# %% tags=["hide-code"]
print(
    f"planar arm      {figure('motions_calibrate_any_arm', 'rank'):.0f} of 3 directions of the shift determined"
)
print(
    "along the axis  the solver returns 0, the truth is "
    f"{figure('motions_calibrate_any_arm', 'off_mm'):.0f} mm"
)

# %% [markdown]
# Turn the hand about at least two clearly different axes, by large angles.

# %%
more_claims("motions_calibrate_any_arm")

# %% [markdown]
# OpenCV's `calibrateHandEye` offers five methods of hand-eye calibration. The fold-out compares them with the course's.
#
# <details><summary>Hand-eye calibration: error against time, and axes that are nearly parallel</summary>
#
# ![Error of a hand-eye calibration against its time and its turns](../docs/charts/hand_eye_precision.png)
#
# *Left: error of a point 0.5 m in front of the camera (median over sets of poses), against time, for 4, 10, 30, 100 and
# 300 poses, from the top. The hand's poses are exact; the target's have 1 mrad and 0.5 mm of noise for each axis.
# Right: error of the rotation for 30 poses that turn by 0.4 rad about one axis and by less about the two others (root
# mean square). Thin line: predicted from the noise of the turns. Left of the dotted line, the course reports that an
# axis is missing. Triangles: NaN for some of the sets.*
#
# OpenCV takes the motions between all pairs of poses. From the same pairs, the course computes the same pose as PARK.
# For few poses OpenCV is faster, because its call has less overhead. The number of pairs grows with the square of the
# number of poses, but the error hardly needs them: with the motions from each pose to only four others, it is nearly
# the same, in a small part of the time.
#
# Most of the methods, the course's among them, fit the rotation to the turns alone. As the axes become parallel, their
# error grows in inverse proportion to the turns about the second axis. ANDREFF and DANIILIDIS also use the shifts, so
# their rotation stays accurate with nearly parallel axes. With clearly different axes, though, ANDREFF is the least
# accurate. The position along the common axis stays unknown with every method, and OpenCV gives no warning.
#
# </details>
#
# ### Tracking: where is the part now?
#
# A pose is as old as its image. A part on a belt has moved on since then, by its speed times that age.
#
# A **Kalman filter** stores the part's position and velocity together with their covariance. It repeats two steps.
# *Predict*: move the estimate forward with the velocity, and enlarge the covariance. *Update*: when a new pose arrives,
# take a weighted mean of prediction and measurement; their covariances give the weights. The difference between
# measurement and prediction is the **innovation**. In a filter, a *gate* rejects a measurement whose innovation is far
# too large for its covariance.
#
# ![Averages of a part that moves, and prediction over an age](../docs/charts/tracking.png)
#
# *Each coordinate of a pose has 1 mm of noise here, and there are 30 images per second. Left: error of the mean of the
# last 1 to 16 images, for a part at rest and for moving ones. Right: error (root mean square) against the age of the
# pose, for parts that move at about 150 mm/s.*

# %%
print_figures("tracking", "0 mm/s", "20", "100", "last", "predicted", "error")

# %% [markdown]
# For a part at rest, further images help if their errors are independent and zero on average, as here. For a moving
# one, the mean shows where the part *was*, so only the mean of very few images helps, or none.
#
# A prediction removes most of the error of the moving part. Here the filter expects too large an error, because it
# allows for accelerations that these parts don't make.

# %%
more_claims("averaging_pictures_helps")

# %% [markdown]
# <details><summary>The height of a hopping robot: when may the filter use the leg's length?</summary>
#
# A Kalman filter can also estimate a robot's own motion. If a measurement is not linear in the estimated numbers, the
# *extended* Kalman filter uses its derivative instead.
#
# A one-legged hopping robot has an accelerometer with a constant error, a **bias**. A leg encoder measures the length
# of its leg, which shows the height while the foot touches the ground. If the contact sensor reports lift-off too late,
# the filter takes this length for the height while the robot already flies. When may it use the leg's length? There are
# three tests. *Flag*: the contact sensor reports contact. *Load*: the accelerometer shows that the leg pushes. *Gate*:
# the innovation is not too large. The chart compares four rules that combine them.
#
# ![Height error of four contact rules beside the Cramér-Rao bound](../docs/charts/hopper_errors.png)
#
# *Left: height error of 200 simulated runs. The **Cramér-Rao bound** is a limit: in the mean over many runs, no
# unbiased filter has a smaller error. Right: is the covariance $P$ that the filter reports right? Let $e$ hold the
# errors of height and velocity. Then $e^\mathsf{T} P^{-1} e$ is their squared size, measured in units of the reported
# spread. Its median over the runs should be 1.39 (dotted).*
#
# Two of the claims below are about an **IMU**, which measures accelerations and, with its gyroscope, angular rates.
# **Preintegration** combines all its samples between two images into one relative motion: the increments of rotation,
# velocity and position in the axes of the first image.
#
# </details>

# %%
more_claims("gate_replaces_contact", "imu_start_again", "bias_to_first_order")

# %% [markdown]
# ## 4 · Design: which estimate for which question
#
# ### The simplest estimate that answers the question
#
# Go through these rows from the top, and stop at the first that answers your question. The **centroid** of a cluster
# is the mean of its points. Its **principal axes** are perpendicular: along the first the points spread most, along
# the last least. A part that stands on a known table has three unknown numbers, $x$, $y$ and its turn. A part that
# can lie in any way has six.
#
# <table>
# <tr><th>question</th> <th>estimate</th> <th>needs</th> <th>leaves open</th></tr>
# <tr><td>is anything higher than the plane tolerance?</td> <td>pixels above the plane</td> <td>plane, noise</td>
# <td>what it is; lower parts</td></tr>
# <tr><td>where to push or apply suction?</td> <td>centroid</td> <td>a cluster</td> <td>where the part's own middle
# is</td></tr>
# <tr><td>which space to keep clear?</td> <td>box around the cluster</td> <td>a cluster</td> <td>its hidden
# half</td></tr>
# <tr><td>which way does it point, roughly?</td> <td>principal axes</td> <td>a long cluster, completely visible</td>
# <td>which end is which</td></tr>
# <tr><td>where does the gripper close?</td> <td>ICP on the shape, 3 numbers</td> <td>shape, table</td>
# <td>whether the table is where you assume it (figure below)</td></tr>
# <tr><td>the same, in any orientation</td> <td>ICP, 6 numbers, more starts</td> <td>shape</td> <td>motions that the
# view does not determine (it names them)</td></tr>
# <tr><td>where will it be?</td> <td>tracker</td> <td>poses with time stamp and covariance</td> <td>whether it has
# just stopped</td></tr>
# </table>
#
# Knowing the table helps if the knowledge is right. Here are four versions of the same fit.

# %% tags=["hide-code"]
normal = rotate(TABLE[3:], np.array([0.0, 0.0, 1.0]))
table = np.append(normal, -normal @ TABLE[:3])
shared = replace(SENSOR, window=5)
versions = {
    "3 numbers": (table, True),
    "6 numbers": (table, False),
    "3, table given 5 mm too high": (table - (0.0, 0.0, 0.0, 0.005), True),
    "3, table given 5 mm too low": (table + (0.0, 0.0, 0.0, 0.005), True),
}
yaws = np.random.default_rng(3).uniform(0.3, 1.2, 12)


def fitted(case):
    """Return the errors of position [m] and angle [rad] of a fit, and its status."""
    (message, standing), seed = case
    part = stand(BOX, 0.03, 0.0, 0.0, yaws[seed])
    image = take_image(shared, seed, part)
    result = locate(image, EYE, shared, BOX, table=message, standing=standing)[0]
    return perception.pose_distance(BOX, part.poses[:, 0], result.pose), result.status


every = [(one, seed) for one in versions.values() for seed in range(12)]
fits = from_record("perception.four_fits", fitted, every, checked=4)
figure_, axis = plt.subplots(figsize=(8, 2.4), layout="constrained")
for k, name in enumerate(versions):
    deviation, verdicts = zip(*fits[12 * k : 12 * (k + 1)], strict=True)
    shift, turn = np.median(deviation, axis=0)
    result = f"{verdicts.count('found')} of 12 found"
    print(f"{name:<31} {1e3 * shift:5.2f} mm, {np.degrees(turn):.2f} degrees, {result}")
    _ = axis.loglog(
        1e3 * np.array(deviation)[:, 0], np.degrees(deviation)[:, 1], "o", ms=4, label=name
    )
_ = axis.set(xlabel="position error [mm]", ylabel="angle error [degrees]")
_ = figure_.legend(fontsize=8, loc="outside right center")
plt.show()

# %% [markdown]
# *Twelve images each; the printed errors are medians. Green, table 5 mm too high: the camera sees through the poses, so
# none is reported as found. Red, 5 mm too low: pieces of the real table become clusters, and some of the wrong poses
# are still found.*
#
# ### What the model omits
#
# The chapter's world has one camera, planes and simple solids. Is that enough for 2 mm? We added each omitted effect
# separately to eight images of the box, and left the noise as it was. The table shows how far the estimated position
# moved (root mean square):

# %% tags=["hide-code"]
effects = omitted()
shifts = np.array([mm for _, mm, _ in effects])
rows = [("omitted effect", "shift of the position [mm]", "how the image was computed")]
rows += [(what, f"{mm:.2f}", how) for what, mm, how in effects]
for what, mm, how in (
    ("together, if independent", np.sqrt(np.sum(shifts**2)), "root of the sum of squares"),
    ("together, if all push the same way", np.sum(shifts), "sum, before rounding"),
):
    rows.append((what, f"**{mm:.2f}**, three times: {3.0 * mm:.2f}", how))
table_of(*rows)

# %% [markdown]
# Eight images give only a rough size, so take *three times* the shift as a safe bound. Even if the effects are
# independent, almost nothing of the 2 mm is left for calibration and age. If all push the same way, the bound is above
# 2 mm. Most of it comes from pixels that mix two surfaces. The effects were not tried together, and real sensors have
# others.
#
# ### Interfaces and answers
#
# <details><summary>The five interfaces</summary>
#
# <table>
# <tr><th>component</th> <th>takes</th> <th>returns</th> <th>checks</th></tr>
# <tr><td><code>Camera</code></td> <td>intrinsics</td> <td>rays; pixels of points</td> <td>an image's shape and unit;
# NaN becomes "no measurement"</td></tr>
# <tr><td><code>Sensor</code></td> <td>baseline, noise, window, steps, smallest and largest depth</td>
# <td>$\sigma_z$; an image with that noise</td> <td>the limits of each number</td></tr>
# <tr><td><code>locate</code></td> <td>image, camera, sensor, part, maybe the table</td> <td>a list of
# <code>Estimate</code>, the best first</td> <td>everything that it is passed</td></tr>
# <tr><td><code>Estimate</code></td> <td></td> <td>pose, covariance, matched, residual, see-through, unobserved,
# status</td> <td>never <i>found</i> if the image refutes the pose, if the pose leaves too much over, or if the
# position is not determined</td></tr>
# <tr><td><code>Tracker</code></td> <td>time stamp, (x, y, turn), covariance</td> <td>the same at any later time</td>
# <td>no image older than the last</td></tr>
# </table>
#
# </details>
#
# The caller of `locate` sees only the answer, and has to know what to do with it. An empty table is a normal case, so
# `locate` returns an empty list and raises no exception. The status of a pose is the first of these that applies:
#
# 1. *refuted*: the camera sees through the pose, or something nearer hides most of it.
# 2. *cut*: the part reaches the border of the image.
# 3. *ambiguous*: another pose explains the image as well; too much is left over; the border is off the model's
#    outline; or a shift is unobserved.
# 4. *found*: none of these.

# %% tags=["hide-code"]
square, other = shape("box", 0.05, 0.0499, 0.03), shape("box", 0.05, 0.03, 0.03)
LARGER = shape("box", 0.1, 0.05, 0.03)
answers = [("on the table", "status", "see-through", "left over", "what the robot should do")]
for name, part, available, then in (
    ("nothing", BOX, (), "wait, or ask for parts"),
    ("the part", BOX, (stand(BOX, 0.03, 0.0, 0.0, 0.5),), "grasp"),
    (
        "the part, mostly outside the image",
        BOX,
        (stand(BOX, 0.03, 0.45, 0.0, 0.5),),
        "move the camera",
    ),
    (
        "a nearly square part",
        square,
        (stand(square, 0.03, 0.0, 0.0, 0.5),),
        "don't grasp: look again or push",
    ),
    ("a can", can, (stand(can, 0.04, 0.0, 0.0, 0.5),), "grasp: its turn is free"),
    ("a smaller part", BOX, (stand(other, 0.03, 0.0, 0.0, 0.5),), "leave it, report it"),
    (
        "a larger part",
        BOX,
        (stand(LARGER, 0.03, 0.0, 0.0, 0.5),),
        "don't grasp: look again or push",
    ),
):
    result = locate(take_image(SENSOR, 5, *available), EYE, SENSOR, part)
    verdict = "; ".join(
        one.status + "".join(f", {name} unobserved" for name in one.unobserved) for one in result
    )
    shares = [
        f"{100.0 * some:.0f}%" for one in result for some in (one.see_through, 1.0 - one.agrees)
    ]
    answers.append((name, verdict or "empty list", *(shares or ("-", "-")), then))
table_of(*answers)

# %% [markdown]
# *Refuted* with little see-through means hidden: look from elsewhere. A cut-off part may also be refuted, so move the
# camera whenever the pose reaches the border. And *ambiguous* does not say why. One exception: you know that your part
# is almost the same after a quarter turn, little is left over, and no shift is unobserved. Then you may use a grasp
# that is safe in both poses. (`locate` does not report the border, so it may still be a near twin.)
#
# ### Throughput and latency

# %%
predict("keeps_up")

# %% [markdown]
# **Throughput** is how many images per second the pipeline processes: one over the time of the slowest stage, if all
# stages work at once, each on another image. **Latency** is how old an answer is: the time of all stages and of the
# waits between them, plus exposure and transport. Workers that take whole images in turn raise the throughput, but each
# answer is as old as before when it arrives.
#
# Here are the five stages after the image, timed on one core. The last stage, *grasp*, is the function **`closes`**:
# may the gripper close? It adds up:
#
# - three standard deviations of the position;
# - the shift at the edge of a finger if the part turns by three standard deviations (zero if the part is round, like
#   the can);
# - a bound for systematic errors, here the shift by half a pixel (section 2).
#
# The result is True if the pose is *found* and the sum is smaller than the gap between finger and part. Here the part
# rests, and the calibration is exact. Otherwise predict the pose to the time of use first, and add the error of the
# calibration to the bound.

# %% tags=["nbval-ignore-output", "hide-code"]
one = locate(noticed, EYE, SENSOR, BOX)[0]


HALF_A_PIXEL = 1e-3 * figure("half_a_pixel", "shift_mm")


def closes(one, gap=0.0025, finger=0.01, bound=HALF_A_PIXEL, is_round=False):
    """Return whether three standard deviations and a bound fit into the gap on each side [m].

    The fingers are 20 mm wide. The covariance must include shared noise. That of `locate` does if
    its sensor has the right window.
    """
    shift, turn = 3.0 * np.sqrt(np.diag(one.covariance)[[1, 5]])
    at_edge = 0.0 if is_round else finger * turn  # infinite if the turn is unobserved
    return one.status == "found" and bound + shift + at_edge < gap


stages = {
    "image": lambda: sense(render(scene, EYE)[0], EYE, SENSOR, rng),
    "points": lambda: perception.back_project(noticed, EYE),
    "table": lambda: perception.ransac_plane(points[:, ::37], 0.006, rng, at_most=200),
    "clusters": lambda: perception.components(high.reshape(noticed.shape), EYE, 0.012),
    "poses": lambda: locate(noticed, EYE, SENSOR, BOX),
    "grasp": lambda: closes(one),
}
clocks = [calls(stage, clock=time.process_time) for stage in stages.values()]
took = [1e3 * timed.median for timed in interleaved(clocks, repeats=5, sample=5e-3)]
took[4] -= sum(took[1:4])  # `locate` does these, too
figure_, axis = plt.subplots(figsize=(7, 2), layout="constrained")
bars = axis.barh(list(stages)[1:][::-1], took[1:][::-1], color=BLUE)
_ = axis.bar_label(
    bars,
    [f"{ms:.0f} ms" if ms > 10 else f"{ms:.2g} ms" for ms in took[1:][::-1]],
    padding=3,
    fontsize=8,
)
_ = axis.axvline(1e3 / 30, color=ORANGE)
_ = axis.text(35, 4, "period of 30 images per second", va="center", fontsize=8, color=ORANGE)
_ = axis.set(xlim=(0, 1.2 * max(took[1:])), xlabel="time per image [ms]")
plt.show()
whole = sum(took[1:])
print(f"after the image   {whole:.0f} ms; the gripper may close: {closes(one)}")

# %% [markdown]
# *Nearly all of the time goes into the poses: several starts for each cluster.*

# %%
more_claims("pipeline_keeps_up")

# %% [markdown]
# For the simulation of a whole system, computing images takes too long. So chapter 11 adds a random error to the true
# pose instead. **`stand_in`** returns the bias and covariance of this error. Compare its spread with that of 40 poses
# by `locate`:

# %% tags=["hide-code"]
place = stand(BOX, 0.03, 0.05, 0.0, 0.8)
bias, spread = perception.stand_in(EYE, shared, BOX, place.poses)
chain = [locate(take_image(shared, seed, place), EYE, shared, BOX)[0].p for seed in range(40)]
along = rotate(conjugate(place.poses[3:, 0]), np.transpose(chain) - place.poses[:3])
message = 1e3 * np.sqrt(np.diag(spread[:, :, 0]))[:2]
measured = 1e3 * along[:2].std(axis=1)
print("standard deviation of x and y [mm]")
print("the pipeline, 40 images ", *measured.round(3))
print("stand_in                ", *message.round(3))

# %% [markdown]
# Here `stand_in` predicts a larger spread: it, too, takes the whole factor $w^2$ for shared noise. It models good poses
# only; the simulation of a system has to add missing and wrong ones.

# %% [markdown]
# ## 5 · Code, and the simulation in full
#
# ### Five steps of a tutorial, line by line
#
# Here are the five steps of many tutorials with this chapter's functions, for the noisy depth image `noticed` of
# section 1 and its camera `EYE`.

# %%
cloud, _ = perception.back_project(noticed, EYE)  # 1 points of the image
cells, _ = perception.voxel_mean(cloud, 0.005)  # 2 one mean per voxel
plane, near, tried = perception.ransac_plane(cells, 0.01, np.random.default_rng(0))  # 3 the table
rest = np.ascontiguousarray(cells[:, ~near])
labels, core = perception.dbscan(rest, 0.02, 50)  # 4 clusters
boxes = [np.ptp(rest[:, labels == k], axis=1) for k in range(labels.max() + 1)]  # 5 their boxes

# %% [markdown]
# An independent library, Open3D, has to agree step by step:

# %% tags=["hide-code"]
theirs = open3d.Cloud(cloud)
theirs = theirs.array(theirs.voxel_mean(0.005))
a, b = (some[:, np.lexsort(some.round(9))] for some in (cells, theirs))  # in one order
their_plane, _ = open3d.Cloud(cells).plane(0.01, 1000)
lean = np.degrees(np.linalg.norm(np.cross(plane[:3], their_plane[:3])))
noise = labels < 0
same = np.array_equal(noise, open3d.Cloud(rest).dbscan(0.02, 50) < 0)
float32 = np.abs(cloud - open3d.Picture(noticed, EYE).points()).max()
print(f"1 points        differ by {float32:.0e} m (Open3D stores float32)")
print(f"2 voxels        {cells.shape[1]} means, differ by {np.abs(a - b).max():.0e} m")
print(
    f"3 planes        {lean:.4f} degrees apart, both with a refit; "
    f"{tried} samples (early stop), Open3D 1000"
)
print(
    f"4 clusters      {labels.max() + 1}, {noise.sum()} points of noise, the same in Open3D: {same}"
)
extents = [(1e3 * box).round().astype(int) for box in boxes]
print(
    "5 x, y, z [mm]  " + ", ".join(f"{a} {b}" for a, b in zip(("can", "box"), extents, strict=True))
)
print("  true [mm]     can 60 wide, 80 high, box", (2e3 * BOX.sizes[:, 0]).astype(int))

# %% [markdown]
# The *settings* are the problem: 50 neighbours at 5 mm voxels and a plane tolerance of 10 mm lose the plate, and the
# extent of a box along the camera's axes is not the size of the part.

# %%
more_claims("tutorial_runs")

# %% tags=["hide-code"]
shown = (pose.judge, pose._compare, perception.registration.covariance_of)
text = "\n\n".join(inspect.getsource(f) for f in shown)
Markdown(
    "<details><summary>The heart of the chapter as it is in the module: what an image says about a "
    f"pose, and what is known</summary>\n\n```python\n{text}```\n\n</details>"
)

# %% [markdown]
# ### The simulation in full
#
# You look from above. An estimated pose is green if *found*, orange if *ambiguous* or *cut*, red if *refuted*. A
# predicted error of *not seen* means infinite. Drag a part to move it, and drag its knob to turn it. Choose one preset
# after the other, and predict before you look:
#
# 1. *Table in clusters*: which slider cures it, and what is lost then?
# 2. *Touching*: does any eps separate the parts, and which direction is reported as uncertain?
# 3. *Cut off*: what do residual and see-through say?
# 4. *Scale error*: which numbers show the error? Does a real robot have them, too?
#
# <details><summary>Answers</summary>
#
# 1. A plane tolerance of 8 mm, about three standard deviations of the sensor in this preset. Parts that are clearly
# lower are lost. 2. No: parts that touch are one cluster at any eps at which they are clusters at all. The position
# along the block is uncertain. 3. Nothing unusual. The warning comes from the border of the image and from the
# unobserved shift. 4. Both *errors* and *plane is off* show it, but they compare with the truth, which a robot doesn't
# have. The predicted error stays below 0.1 mm while the pose is about 8 mm off.
#
# </details>

# %%
simulation("perception", "Touching")

# %% [markdown]
# *The preset* Touching*: two equal boxes are one cluster, and the estimate between them is ambiguous (orange).*

# %% [markdown]
# ## 6 · Speed against accuracy
#
# All times here are **processor time**: the time for which a core works on this program, without its waiting for
# other programs.
#
# ![Time of the library over that of the course, and clusters by the number of points](../docs/charts/cloud_speed.png)
#
# *Left: time of the library divided by that of the course. First two rows: MuJoCo and Embree cast one ray per pixel, on
# one thread. They are general, while the course knows a few simple solids; MuJoCo's renderer, which usually draws its
# depth images, is not measured. Other rows: Open3D. "Draws" are samples of RANSAC, with "early stop" until the formula
# of section 2 promises 0.99. Right: time of DBSCAN against the number of points in the same volume, with exponents
# fitted to the last three points.*
#
# On the right, each point also gets more neighbours, so Open3D's DBSCAN grows nearly with the square. The course's
# exponent is no law: in this range a fixed cost dominates. After a voxel grid the density is constant; this case is the
# row *clusters* of the next chart.

# %%
print_figures("cloud_speed", "voxels of 5", "plane, early", "course", "Open3D")

# %% [markdown]
# Here is the whole pipeline, for 25 images of three boxes on a table in 320 x 240 pixels: points, voxels, plane and
# clusters as above, then point-to-plane ICP with four starts for each cluster. Gates and stopping rule are the same,
# but the course fits the shape given by a formula, and Open3D a cloud of the model's points.
#
# ![Time of the stages of a frame, compared with Open3D](../docs/charts/frame_speed.png)
#
# *Processor time of each stage, and of `locate` as a whole. Below, a pose is right within 2 mm and 2 degrees.*

# %%
print_figures("frame_speed", "course", "Open3D", "locate", "clusters", "poses")

# %% [markdown]
# So part of the difference in *poses* is the formula; the next chart also compares fits to the same cloud. `locate`
# takes longer than the course's pipeline, because it tries more starts and tests its answer.
#
# ![Error of a pose against its time, by voxel size](../docs/charts/pose_precision.png)
#
# *Each curve is a method, each point a voxel size: from the left 30, 15, 8, 4, 2 and 1 mm. The error is the root mean
# square over the box's corners and 20 images. "Shape" fits the shape given by a formula (section 3); "cloud" (the
# course's ICP), Open3D and small_gicp (a registration library) fit points of the model. Dotted: 2 mm and a tenth of it.
# Circles: the fastest setting whose error is below each dotted line. Right: with noise that neighbouring pixels share.
# There, grids finer than 4 mm gain nothing; differences below a factor of two are the scatter of 20 images.*
#
# All of these need a start; global registration (section 3) doesn't. Open3D has a descriptor, **FPFH**, and two
# searches (explained in the fold-out). ICP refines the result.
#
# The table shows the share of poses within 2 mm and 2 degrees (up to symmetry), from the worst to the best setting. All
# methods are given the table, and Open3D the points above it. Only `locate` also knows which side is down, except for
# the L *held anyhow*.

# %% tags=["hide-code"]
PANELS = {
    "standing": "an L-shaped part, standing",
    "any turn": "the same, held anyhow",
    "hidden": "the same, standing, partly hidden",
}
rows = [("part", "locate", "FPFH, RANSAC", "FPFH, fast global")]
for name, words in (PANELS | {"box": "a box"}).items():
    ranges = []
    for method in rows[0][1:]:
        line = next(
            s for s in read("global_registration").splitlines() if f"{name}, {method}:" in s
        )
        shares = [float(share) for share in re.findall(r"([\d.]+) right", line)]
        ranges.append(span(".0%", shares))
    rows.append((words, *ranges))
table_of(*rows)

# %% [markdown]
# FPFH is weak here: points on flat faces all have the same descriptor, so few pairs are right.
#
# <details><summary>The settings, and a chart of error against time</summary>
#
# ![Error and time of a pose, by features and by starts](../docs/charts/global_registration.png)
#
# *Median error of a point 50 mm from the part's origin, against time, over 20 images. FPFH (Rusu and others 2009) is
# a histogram of the normals around a point. RANSAC samples a few pairs of points; *fast global* fits all pairs, and
# gives wrong ones little weight. Each square or diamond is a voxel size of Open3D: 10 mm (fast), 7, 5 and 4 mm
# (slow). Radius for a descriptor: 5 voxels. RANSAC: at most 100,000 samples, confidence 0.999. The dots are `locate`
# with 1 and with 4 starts; for the L held anyhow both mean 24 orientations.*
#
# Not measured here: TEASER++ (Yang, Shi and Carlone 2021), which tolerates far more wrong pairs, and point pair
# features (Drost and others 2010), which are often used for such parts.
#
# </details>
#
# **What to choose.** From the gripper's tolerance, first subtract the errors of calibration and age, and the effects
# that these images omit (section 4). Take the fastest method for which three times the error still fits into the rest,
# and test its answer with see-through. Of this chapter's 2 mm, almost nothing is left. If a wider gripper leaves 0.6
# mm, the error may be 0.2 mm: take the shape on a grid of 8 mm, or of 4 mm with shared noise.
#
# For clusters of one image, use connected components; DBSCAN is for points from several images. For the table, run
# RANSAC on a few thousand points, then fit all pixels near it: with stereo, fit $1/z$.
#
# ## 7 · Debug: where it fails
#
# ### Lost parts
#
# How low may a part be? The plane tolerance must be about three $\sigma_z$, or pieces of the table itself become
# clusters. The part must be about as high as this tolerance, and its points must have enough neighbours.
#
# ![The lowest part that is found, and clusters of bare table](../docs/charts/lost_parts.png)
#
# *Left: height of the lowest part that is found, against the distance, for four settings of plane tolerance and
# neighbours. A part is found if, in most images, a cluster consists mainly of its points. A curve ends where not even
# the highest part, 40 mm, is found. Right: clusters of bare table. (Voxels of 5 mm, eps 20 mm; a sensor with shared
# noise, $\sigma_z$ = 3.5 mm at 0.8 m.)*

# %%
print_figures("lost_parts", "10 mm, 12", "4 mm", "3 sigma")

# %% [markdown]
# Compare the settings with 12 neighbours. Near the camera, a fixed tolerance of 10 mm hides low parts. Farther away,
# noise lifts enough points of an 8 mm part above it, so the part is found. But at one metre and beyond, noise also
# lifts points of the bare table: more than a dozen false clusters appear. With 4 mm, this begins nearer, and from 1 m
# on every part is lost among such points.
#
# The tolerance of three $\sigma_z$ finds low parts near by and makes no false clusters far away. The price is that far
# parts must be higher: at 1 m, 15 mm instead of 8 mm. Requiring 50 neighbours also suppresses false clusters, but then
# parts below 15 mm are lost at every distance.
#
# <div class="alert alert-block alert-info">
#
# **Interview question.** *Your robot has a depth camera looking down at a bin of parts. Small parts are missed by the
# detector. Large parts have inaccurate poses. Diagnose both.*
#
# Answer aloud. The model answer is in section 10, under *Staff*.
#
# </div>
#
# **Small parts.** The chart counts the points of cube-shaped parts after each stage, with the settings of the
# tutorial, and tries cures.
#
# ![Which stage loses a small part, and what each cure costs](../docs/charts/small_parts.png)
#
# *Left: points of a cube after each stage, against its size. A triangle at the bottom means that none is left. Right:
# the smallest cube that is found with each cure, at 0.8 m if not said otherwise (eps: radius of DBSCAN; v: voxel edge;
# 5 images: their mean).*

# %%
rows = ("above", "clustered", "tolerance", "neighbours", "3 sigma, 0.2 pi (", "3 sigma, comp")
figures(read("small_parts"), *rows, summary="The counts and the cures")

# %% [markdown]
# Cubes of 12 to 20 mm still have most of their points above the plane, but none in a cluster: too many neighbours are
# required. Requiring fewer finds cubes of 16 mm, at the price of a false cluster in about one image of ten. With a
# plane tolerance of three $\sigma_z$ as well, false clusters are rare. Connected components in place of DBSCAN then
# find cubes of 12 mm, and no false cluster appeared.
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *Small parts are missed.* Count the part's points after each stage: pixels, voxels, above the
# plane, in a cluster. The first zero, or an earlier large drop, names the stage. No pixels: move the camera nearer.
# None above the plane: set the plane tolerance in multiples of $\sigma_z$. Not clustered: require a third or less of
# $\pi(\epsilon/v)^2$ neighbours.
#
# <details><summary>What people get wrong here</summary>
#
# They make voxels smaller first. A voxel grid removes no part that has a pixel. Only a part less than three cells wide
# may share all its means with the table and appear lower. What the grid does change is the number of neighbours. With
# `min_points` unchanged, a *finer* grid therefore helps, but for this reason and not for the one usually given.
#
# </details>
#
# </div>
#
# **Large parts.** The chart compares seven estimators of a box in seven situations. *Alone*; *touching*: a smaller box
# touches its long side; *twin*: an equal box does; *hidden*: a tall can hides nearly half of it; *cut off*: more than
# half of it is outside the image; *scale*: all depths are one per cent too long; *camera*: the camera is tilted
# forwards by one degree.
#
# ![Seven estimators of a pose, and what goes wrong](../docs/charts/large_parts.png)
#
# *Median error of the position (left) and the turn (right), over ten turns of the part. "Principal axes" takes the
# centroid as its position. A "box" takes the middle of the box around the cluster; "box along principal axes" has their
# turn. Dotted: the gripper's tolerances.*

# %%
rows = (
    "median",
    "centroid",
    "box along principal",
    "principal",
    "ICP, points",
    "ICP, shape",
    "locate  ",
)
figures(
    read("large_parts"),
    *rows,
    cut="scale",
    summary="All numbers, and what `locate` returns for each",
)

# %% [markdown]
# Beside the twin, with the wrong scale and with the tilted camera, the position of *every* estimator is wrong. For the
# twin, `locate` reports *ambiguous*. The other two are reported as *found*, because the program finds the table in the
# same wrong image. If you pass the true table to `locate`, it refutes both, because the measured table is then too high
# or too low at the part.
#
# A median hides wrong poses, and it also counts poses that are not *found*, such as the cut-off boxes.
#
# ### Debugging
#
# <div class="alert alert-block alert-danger">
#
# **Debugging tip.** *The pose is noisy from image to image.* Let the part rest, and compare the spread of its poses
# with the reported standard deviation. Equal: the sensor's noise; average if the part rests, filter if it moves. Larger
# by up to $w$ times, for a window of $w$ pixels: perhaps shared noise that the covariance ignores. Larger by any
# factor: points that are closest to a hidden face (section 3).
#
# Smaller: the covariance is cautious, or part of the error is the same in every image, which averaging does not remove.
# Jumps between two values: the part is symmetric, or two starts fit equally well.
#
# <details><summary>What people get wrong here</summary>
#
# They average a fixed number of images. For a part that moves, the average lags behind. A lag is not noisy, so it
# *looks* better, and above some speed it is worse than the last single image.
#
# </details>
#
# </div>
#
# <details><summary>A table of symptoms, causes, tests and fixes</summary>
#
# <table> <tr><th>symptom</th> <th>cause</th> <th>test</th> <th>fix</th></tr> <tr><td>everything is NaN, or a point
# sits at the camera's centre</td> <td>missing pixels treated as depths</td> <td>count zeros and NaN in the raw
# image</td> <td>convert once, on reading</td></tr> <tr><td>right in the middle of the image, wrong at its edge</td>
# <td>lens distortion, a range used as a depth, an inverted rotation</td> <td>targets at the corners</td> <td>rectify;
# the exercise <code>point_in_base</code></td></tr> <tr><td>everything shifted by a millimetre or two</td>
# <td>half a
# pixel</td> <td>ask whether the first pixel's centre is 0 or 0.5</td> <td>if 0, the middle is (W - 1)/2</td></tr>
# <tr><td>everything one per cent too near or too far</td> <td>depth scale, focal length</td>
# <td>a known length at two distances; a known table</td> <td>calibrate it</td></tr>
# <tr><td>pose good, grasp next to the part</td>
# <td>extrinsics, or an old pose</td> <td>touch a point far from the calibration's</td> <td>more points,
# motions about two axes; predict</td></tr> <tr><td>small residual, wrong pose</td> <td>a face of the same shape, a
# twin, cut off</td> <td>see-through, what is left over, the image border</td> <td>more starts; another view; a
# push</td></tr> </table>
#
# </details>
#
# ## 8 · Exercises
#
# `check` runs your function on new cases.

# %%
card("back_project")


# %%
def back_project(picture, fx, fy, cx, cy, unit):
    """Return the points that a depth image shows, row by row."""
    # All on the optical axis.
    z = np.asarray(picture, dtype=float).ravel() * unit
    return np.array([0.0 * z, 0.0 * z, z])


check(back_project)

# %%
card("rigid_fit")


# %%
def rigid_fit(source, target, weights):
    """Return the rigid motion that brings points onto their partners best."""
    # No turn, and all points count the same.
    return np.eye(3), np.mean(target, axis=1) - np.mean(source, axis=1)


check(rigid_fit)

# %%
card("plane_ransac")


# %%
def plane_ransac(points, triples, tolerance, confidence):
    """Return the plane near which most points lie, fitted once more to them."""
    # All points lie on the level plane through the first.
    return np.array([0.0, 0.0, 1.0, -points[2][0]]), np.arange(len(points[0])), 1


check(plane_ransac)

# %%
card("point_to_plane_step")


# %%
def point_to_plane_step(points, model, normals):
    """Return one step of ICP from points to planes."""
    # The means onto each other, whatever the matches.
    return np.eye(3), np.mean(model, axis=1) - np.mean(points, axis=1)


check(point_to_plane_step)

# %%
card("dbscan")


# %%
def dbscan(points, eps, least):
    """Return the cluster of each point, -1 for noise."""
    # All are one.
    return np.zeros(np.shape(points)[1])


check(dbscan)

# %%
card("blind_directions")


# %%
def blind_directions(points, normals, lever, least):
    """Return the motions of a part that its measured points do not determine."""
    # All motions are determined.
    return 0, np.zeros((6, 6))


check(blind_directions)

# %%
card("hopper_filter")


# %%
def hopper_filter(force, length, offset, contact, start, spread, noise, rest, dt):
    """Estimate height and vertical velocity of a one-legged hopper at every sample."""
    # The start and its uncertainty, for ever.
    n = len(force)
    estimates = np.tile(np.asarray(start, dtype=float)[:2], (n, 1))
    return estimates, np.tile(np.diag(np.asarray(spread, dtype=float)[:2] ** 2), (n, 1, 1))


check(hopper_filter)

# %%
card("point_in_base")


# %%
def point_in_base(pixels, stamp, camera, mount, log):
    """Return the positions in the base of points that a moving camera saw, shape (3, n) [m]."""
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
# Any equivalent form is accepted. <span class="kernel-only">The fields hold wrong answers. Replace them.</span> The
# sketch belongs to the last question.

# %% tags=["hide-code"]
W, b, e, t = 1.0, 0.9, 0.12, 0.2
turn = np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]])
figure_, axis = plt.subplots(figsize=(5.5, 2.6), layout="constrained")
reach = W / 2 / np.cos(t) + b / 2 * np.tan(t) + e
corners = turn @ np.array([[-1.6, 1.6, 1.6, -1.6, -1.6], [-W / 2, -W / 2, W / 2, W / 2, -W / 2]])
_ = axis.plot(corners[0], corners[1] + e, color=BLUE)
axial = turn @ np.array([[-1.7, 1.7], [0.0, 0.0]])
_ = axis.plot(axial[0], axial[1] + e, "--", color=BLUE, lw=0.8)
_ = axis.axhline(0.0, color=GREY, lw=0.8)
for side in (-1, 1):
    low = reach if side > 0 else -reach - 0.3
    _ = axis.add_patch(plt.Rectangle((-b / 2, low), b, 0.3, color=ORANGE, alpha=0.6))
for at, text in (
    ((0.0, reach + 0.15), "finger, b wide"),
    ((0.0, -reach - 0.15), "finger"),
    ((-0.35, -0.3), "part"),
    ((-0.95, -0.28), "W"),
):
    _ = axis.text(*at, text, ha="center", va="center", fontsize=8)
_ = axis.annotate("", (0.0, e), (0.0, 0.0), arrowprops={"arrowstyle": "<->", "lw": 1})
across = turn @ np.array([[-1.1, -1.1], [-W / 2, W / 2]]) + [[0.0], [e]]
_ = axis.annotate("", *across.T, arrowprops={"arrowstyle": "<->", "lw": 1})
_ = axis.text(0.06, 0.04, "e", fontsize=9)
_ = axis.text(1.3, 0.12, "t", fontsize=9)
_ = axis.text(0.12, -0.1, "gripper's middle", fontsize=7, color=GREY)
arc = np.linspace(0.0, t, 20)  # about the point where the two lines cross
_ = axis.plot(1.8 * np.cos(arc) - e / np.tan(t), 1.8 * np.sin(arc), color="black", lw=1)
_ = axis.set(xlim=(-1.9, 1.9), ylim=(-1.2, 1.2), aspect="equal")
axis.axis("off")
plt.show()

# %%
answer("calibration_residual", "sigma/sqrt(N)")

# %%
answer("half_a_pixel", "z/f")

# %%
answer("extent_is_size", "L")

# %%
answer("two_millimetres_will_do", "e")

# %% [markdown]
# ### Put it into your robot
#
# Your graded answers are parts of the pick-and-place robot of `drills robot`.

# %%
your_robot(7)

# %% [markdown]
# ## 9 · Frontier: networks that see
#
# So far, every accurate pose needed a model of the part's shape. Some learned methods need less.
#
# <details><summary>Contact-GraspNet, FoundationPose, SAM 2, SpatialVLM: claims and reports</summary>
#
# <table>
# <tr><th>work</th> <th>year</th> <th>what is new</th> <th>needs</th> <th>what is often said, and what the paper
# reports</th></tr>
# <tr><td>Contact-GraspNet (Sundermeyer and others, ICRA)</td> <td>2021</td> <td>proposes grasps where fingers may
# touch, for objects it never saw</td> <td>a depth image</td> <td>"grasps for novel objects": with a success rate, not
# a guarantee</td></tr>
# <tr><td>FoundationPose (Wen and others, arXiv 2312.08344)</td> <td>2023</td> <td>poses of objects that it was not
# trained on</td> <td>colour, depth, a mask; a mesh or reference images</td> <td>"one image, no CAD": a small number
# of images, from which a shape is reconstructed first. "All in 60 ms": 1.3 s for a first pose on an RTX 3090, 32 a
# second while it tracks</td></tr>
# <tr><td>SAM 2 (Ravi and others, arXiv 2408.00714)</td> <td>2024</td> <td>masks from a click, carried through a
# video</td> <td>an image, a click or box</td> <td>"a perfect mask": its results are mean overlaps below one, better
# with more clicks</td></tr>
# <tr><td>SpatialVLM (Chen and others, arXiv 2401.12168)</td> <td>2024</td> <td>answers in metres</td> <td>one colour
# image, a question</td> <td>"phrases become coordinates": distances and sizes are estimated, in words; no gripper's
# tolerance is among its tests</td></tr>
# </table>
#
# </details>
#
# We measure a small network instead. It looks at a patch of heights and estimates how an L-shaped part is turned. It
# was trained on a few thousand images of our simulated camera and table, with the noise of section 1.
# Its answer is used as the start of ICP.

# %% tags=["hide-code"]
print(f"weights         {yaw_net.WEIGHTS:,}")
print(f"input           a patch of {yaw_net.SIDE} x {yaw_net.SIDE} heights")

# %%
predict("network_and_mirror")

# %% [markdown]
# ![Share of right poses and time by start, and what the image says](../docs/charts/learned_start.png)
#
# *Left: share of right poses in 100 new images, against time (the network's included). A number counts the starts,
# which are evenly spread; "axis" starts along the direction in which the points spread most. Right: see-through share
# of the poses that begin with the network's start, against the error of their turn, for the part and for its mirror
# image. The latter's error is counted from the turn of the mirrored part itself, which no turn of the model can fit.*

# %%
rows = (
    "noise x 1, 1",
    "noise x 1, 4",
    "noise x 1, network",
    "noise x 3.75, 4",
    "noise x 3.75, network",
)
print_figures("learned_start", *rows, "a mirrored")

# %%
more_claims("network_knows_its_part")

# %% [markdown]
# On images like those of its training, the network replaces four starts by one and is right as often. With nearly
# four times the noise, which it never saw in training, its share of right poses is about that of four starts. Is the
# start to blame for the errors that remain? Let the fit start at the true turn:

# %% tags=["hide-code"]
rng = np.random.default_rng(6)
plane, noisy = yaw_net.plane_of(TABLE), replace(SENSOR, noise=3.75 * SENSOR.noise)
images, right = [yaw_net.picture(EYE, noisy, TABLE, rng) for _ in range(100)], 0
for depth, true in images:
    start = np.array([yaw_net.turn_of(true, plane)])
    result, _, _ = learned.laid(depth, noisy, lambda _, start=start: start)
    shift, turn = perception.pose_distance(yaw_net.L_PART, true, result)
    right += shift < 0.002 and turn < np.radians(2.0)
print(f"start at the true turn, noise x 3.75: {right / len(images):.2f} right")

# %% [markdown]
# Even then most of the errors remain, so they come from the fit and not from the start. See-through does not notice
# them: it refutes most poses of the mirrored part and, with the noise of section 1, most wrong turns that follow from a
# single start, but not an error of a few millimetres.
#
# Ask every learned method this chapter's questions. What input does it need? How large is its error *against a truth*,
# and at which distance? What does it answer for an object that it doesn't know? See-through judges its answers, too,
# and needs no training.
#
# ## 10 · Interview
#
# <div class="alert alert-block alert-success">
#
# **Interview tip.** *Describe the pipeline with numbers.* For each stage say its input, its tolerance, where the
# tolerance comes from, and how it fails. Image: $z^2 s/(fB)$. Points: intrinsics and missing pixels. Table: a few
# sigma. Clusters: connected components. Poses: several starts, a covariance, see-through. Grasp: the sum of the
# errors against the gap, in the arm's frame, at the time of use. Quote times only with the machine and the number of
# parts.
#
# </div>
#
# Answer aloud, then open the answers.

# %%
interview("perception")

# %% [markdown]
# ### Checkpoint
#
# Five questions on this chapter, chosen at random.

# %%
checkpoint("perception", ["", "", "", "", ""], seed=1)
