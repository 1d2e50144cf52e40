"""MuJoCo asked for a depth picture: its rays, and its OpenGL renderer where the system has EGL.

The scene is one of `course.perception`, as geoms of the world: no body moves, nothing collides.
Rays go along (x, y, 1), so that what MuJoCo calls distance is depth along z.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from course.check import invalid
from course.libraries import install_line
from course.oracles.mujoco import kit
from course.perception.camera import KINDS, Camera, Shapes

Array = NDArray[np.float64]
NEAR, FAR = 0.01, 10.0  # planes between which OpenGL draws [m]


def scene(shapes: Shapes, camera: Camera) -> str:
    """Return the model's text, with a camera at the origin that looks along -z with y up."""

    def words(values: Array) -> str:
        return " ".join(f"{value:.17g}" for value in values)

    geoms = "".join(
        f'<geom type="{kind}" size="{words(size[: KINDS[kind]] if KINDS[kind] else size)}" '
        f'pos="{words(pose[:3])}" quat="{words(pose[3:])}"/>'
        for kind, size, pose in zip(shapes.kinds, shapes.sizes.T, shapes.poses.T, strict=True)
    ).replace('type="plane" size="0 0 0"', 'type="plane" size="0 0 1"')  # without an end
    view = math.degrees(2.0 * math.atan(0.5 * camera.height / camera.fy))
    return (
        f'<mujoco><statistic extent="1"/><visual><map znear="{NEAR}" zfar="{FAR}"/>'
        f'<global offwidth="{camera.width}" offheight="{camera.height}"/>'
        '<quality offsamples="0"/></visual><worldbody>'  # one sample, in the middle of a pixel
        f'<camera name="eye" xyaxes="1 0 0 0 -1 0" fovy="{view:.17g}"/>{geoms}</worldbody></mujoco>'
    )


class Rays:
    """`mj_multiRay` through every pixel; `cast` is the part to be timed."""

    def __init__(self, shapes: Shapes, camera: Camera) -> None:
        self._mujoco = kit.library()
        self.model = self._mujoco.MjModel.from_xml_string(scene(shapes, camera))
        self.data = self._mujoco.MjData(self.model)
        self._mujoco.mj_forward(self.model, self.data)
        x, y = camera.rays()
        self._shape = (y.size, x.size)
        rays = np.empty((y.size, x.size, 3))
        rays[..., 0], rays[..., 1], rays[..., 2] = x, y[:, None], 1.0
        self._rays = rays.ravel()
        self._depth, self._ids = np.empty(x.size * y.size), np.empty(x.size * y.size, np.int32)

    def cast(self) -> None:
        """Cast all rays in one call."""
        # One ray for each pixel, with z = 1, so the distance along the ray is the depth.
        self._mujoco.mj_multiRay(
            self.model,
            self.data,
            np.zeros(3),
            self._rays,
            None,
            True,
            -1,
            self._ids,
            self._depth,
            None,
            self._ids.size,
            1e10,
        )

    def picture(self) -> tuple[Array, NDArray[np.int64]]:
        """Return depth, 0 without a hit, and the number of the shape, -1 without a hit; (H, W)."""
        self.cast()
        depth = np.where(self._ids < 0, 0.0, self._depth)
        return depth.reshape(self._shape), self._ids.astype(np.int64).reshape(self._shape)


def opengl(shapes: Shapes, camera: Camera) -> Array:
    """Return the depth picture of MuJoCo's OpenGL renderer, shape (H, W), 0 beyond `FAR` [m].

    OpenGL draws in single precision. Round shapes are drawn as polyhedra, planes with an end.

    Raises:
        ValueError: for a camera whose pixels are not square or whose axis is not in the middle.
        ImportError: where the system has no EGL.
    """
    middle = (0.5 * (camera.width - 1), 0.5 * (camera.height - 1))
    if camera.fx != camera.fy or (camera.cx, camera.cy) != middle:
        raise invalid("camera", camera, "one that Camera.symmetric makes")
    mujoco = kit.library()
    try:
        from mujoco.egl import GLContext

        context = GLContext(camera.width, camera.height)
    except (ImportError, AttributeError, RuntimeError, OSError) as error:
        raise ImportError(
            f"this needs EGL: {install_line(['libegl1'])}, and a driver ({error})"
        ) from error
    try:
        context.make_current()
        model = mujoco.MjModel.from_xml_string(scene(shapes, camera))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        device = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        device.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, device)
        eye = mujoco.MjvCamera()
        eye.type, eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
        drawn = mujoco.MjvScene(model, 1000)
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        option = mujoco.MjvOption()
        mujoco.mjv_updateScene(model, data, option, None, eye, everything, drawn)
        rows = np.empty((camera.height, camera.width), np.float32)
        window = mujoco.MjrRect(0, 0, camera.width, camera.height)
        mujoco.mjr_render(window, drawn, device)
        mujoco.mjr_readPixels(None, rows, window, device)
        device.free()
    finally:
        context.free()
    # The buffer holds 1 at NEAR and 0 at FAR, even in the inverse depth, the lowest row first.
    share = rows[::-1].astype(float)
    return np.where(share > 0.0, NEAR * FAR / (share * (FAR - NEAR) + NEAR), 0.0)
