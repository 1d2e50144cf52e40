"""Reference answers of the coding drills, as one would write them in an interview.

Each section is self-contained: it needs NumPy, and where the drill is about MuJoCo, MuJoCo. The
autograder shows these texts as the solutions and compares submissions with what they compute.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


# --- fk3: forward kinematics of a planar three-link arm -------------------------------------------


def fk3(lengths: ArrayLike, thetas: ArrayLike) -> Array:
    """Return joint positions of a planar arm of three links, from the base to the tip.

    Each joint turns everything after it, so the direction of link i is the sum of the first i
    relative angles; a joint is the one before it plus a link along that direction (Craig,
    Introduction to Robotics, 2005, ch. 3).

    Args:
        lengths: link lengths, shape (3,) [m], not negative.
        thetas: joint angles, shape (3,) [rad], each measured from the link before it,
            counter-clockwise; the first from the x axis.

    Returns:
        Positions (x, y) of the base (the origin), both inner joints and the tip, shape (4, 2) [m].

    Raises:
        ValueError: if an argument is not three finite numbers, or a length is negative.
    """
    lengths = np.asarray(lengths, dtype=float)
    thetas = np.asarray(thetas, dtype=float)
    # One message for a wrong shape, NaN and infinity.
    for name, value in (("lengths", lengths), ("thetas", thetas)):
        if value.shape != (3,) or not np.isfinite(value).all():
            raise ValueError(f"{name} must be three finite numbers, got {value.tolist()}")
    if (lengths < 0.0).any():
        raise ValueError(f"lengths must be non-negative, got {lengths.tolist()}")
    # Relative angles add up along the chain: the absolute direction of each link.
    directions = np.cumsum(thetas)
    links = lengths[:, None] * np.column_stack((np.cos(directions), np.sin(directions)))
    return np.vstack((np.zeros(2), np.cumsum(links, axis=0)))


# --- rrt: a rapidly-exploring random tree among discs ---------------------------------------------

GOAL_BIAS = 0.1  # the share of samples that are the goal itself


def edge_is_free(a: Array, b: Array, discs: Array) -> bool:
    """Return whether the segment from a to b touches no disc.

    The point of the segment nearest to each centre decides.

    Points tried along the edge instead would let through discs that fit between two of them.
    """
    # The centre's projection on the line through the edge, clamped to the edge.
    along = b - a
    to_centres = discs[:, :2] - a
    length_squared = np.maximum(along @ along, np.finfo(float).tiny)  # an edge may have no length
    fraction = np.clip(to_centres @ along / length_squared, 0.0, 1.0)
    gaps = to_centres - fraction[:, None] * along
    return bool(np.all(np.hypot(gaps[:, 0], gaps[:, 1]) > discs[:, 2]))


def steer(origin: Array, target: Array, step: float) -> Array:
    """Return the target if it is within `step` of origin, else the point at `step` towards it."""
    offset = target - origin
    distance = np.hypot(offset[0], offset[1])
    return target if distance <= step else origin + step / distance * offset


def trace(nodes: Array, parents: list[int]) -> Array:
    """Return the path from the root to the newest node, found backwards from parent to parent."""
    # The parent of the root is -1.
    chain = [len(parents) - 1]
    while parents[chain[-1]] >= 0:
        chain.append(parents[chain[-1]])
    return nodes[chain[::-1]]


def rrt(
    start: ArrayLike,
    goal: ArrayLike,
    discs: ArrayLike,
    bounds: ArrayLike,
    step: float,
    max_samples: int,
    rng: np.random.Generator,
) -> tuple[Array | None, Array, NDArray[np.int64], Array]:
    """Return a collision-free path for a point among discs, by a rapidly-exploring random tree.

    Draw a target (the goal in one of ten draws, else uniform within the bounds), find the nearest
    node, go at most `step` from there towards the target, keep the new node if the edge is free.
    A new node within `step` of the goal is joined to it if that edge is free too (LaValle, 1998).

    Args:
        start: where the path begins, shape (2,) [m].
        goal: where it ends, exactly, shape (2,) [m].
        discs: obstacles, shape (n, 3), rows (x, y, radius) [m]; touching one is a collision.
        bounds: the world, shape (2, 2), rows (xmin, ymin) and (xmax, ymax) [m].
        step: the longest edge [m], positive.
        max_samples: how many targets to draw at most.
        rng: where the random numbers come from.

    Returns:
        (path, nodes, parents, samples): the path from start to goal, shape (k, 2) [m], or None if
        none was found, (1, 2) if start is goal; the tree's nodes, shape (m, 2) [m], the start
        first; each node's parent, an index into nodes, shape (m,), -1 for the start; the targets
        in the order of drawing, draws of the goal included, shape (s, 2) [m].

    Raises:
        ValueError: if start or goal is in collision or out of bounds, step is not positive,
            max_samples is negative, the bounds are empty, or a shape is wrong.
    """
    start, goal = np.asarray(start, dtype=float), np.asarray(goal, dtype=float)
    discs = np.asarray(discs, dtype=float)
    if discs.size and discs.shape[1:] != (3,):
        raise ValueError(f"discs.shape must be (n, 3): rows (x, y, radius), got {discs.shape}")
    discs = discs.reshape(-1, 3)
    low, high = np.asarray(bounds, dtype=float)
    if not (low < high).all():
        raise ValueError(f"bounds must be (xmin, ymin) below (xmax, ymax), got {low}, {high}")
    if not 0.0 < step < np.inf:
        raise ValueError(f"step must be a positive finite number, got {step}")
    if max_samples < 0:
        raise ValueError(f"max_samples must be a non-negative integer, got {max_samples}")
    for name, point in (("start", start), ("goal", goal)):
        if point.shape != (2,) or not ((low <= point) & (point <= high)).all():
            raise ValueError(f"{name} must be a point within the bounds, got {point.tolist()}")
        if not edge_is_free(point, point, discs):
            raise ValueError(f"{name} must be a point that touches no disc, got {point.tolist()}")

    # Rows for the largest tree that can come out, so that nothing grows in the loop.
    nodes = np.empty((max_samples + 2, 2))  # one a sample, and the start and the goal
    nodes[0] = start
    parents = [-1]
    samples: list[Array] = []
    result = np.array_equal(start, goal)
    while not result and len(samples) < max_samples:
        # A share of the samples is the goal itself, which pulls the tree towards it (goal bias).
        target = goal if rng.random() < GOAL_BIAS else rng.uniform(low, high)
        samples.append(target)
        offsets = nodes[: len(parents)] - target
        # The nearest node, by brute force over the whole tree.
        near = int(np.argmin(np.hypot(offsets[:, 0], offsets[:, 1])))
        new = steer(nodes[near], target, step)
        if not edge_is_free(nodes[near], new, discs):
            continue
        nodes[len(parents)] = new
        parents.append(near)
        result = np.array_equal(new, goal)
        # Connect: a new node within one step of the goal is joined to it directly.
        if not result and np.hypot(*(goal - new)) <= step and edge_is_free(new, goal, discs):
            nodes[len(parents)] = goal
            parents.append(len(parents) - 1)
            result = True
    path = trace(nodes, parents) if result else None
    return path, nodes[: len(parents)].copy(), np.array(parents), np.reshape(samples, (-1, 2))


# --- PID ------------------------------------------------------------------------------------------


class PID:
    """A sampled PID controller with output limits, anti-windup and a filtered derivative.

    command = limit(kp e + integral of ki e - kd r), with e = setpoint - measurement. Four choices:

    - The derivative r is that of the **measurement**: for a constant set-point the same as minus
      that of the error, but a step of the set-point makes no kick.
    - r goes through a first-order low-pass, tau r' + r = y', as a bare difference multiplies noise
      by 1 / dt. Backward Euler, r = (tau r + y - y_last) / (tau + dt), is stable for every tau.
    - Anti-windup is **conditional integration**: a sample is not integrated if the command is at
      a limit and the error pushes further into it. Unlike back-calculation it has no time constant
      to tune, and the integral keeps the load that it has found. An integral clamped to a range
      of its own would do less: it must allow the whole output, and still has that to unwind.
    - The integral is kept as a part of the command, with ki inside the sum. A new ki then acts on
      what comes and makes no bump (K. J. Astrom, T. Hagglund, Advanced PID Control, 2006, ch. 3).

    The first update after the start or a reset has no earlier measurement, so r starts at 0.
    """

    def __init__(
        self,
        kp: float,
        ki: float,
        kd: float,
        dt: float,
        u_min: float,
        u_max: float,
        tau: float,
    ) -> None:
        """Set the gains; u is the command's unit, y the measurement's.

        Args:
            kp: proportional gain [u/y], finite and not negative.
            ki: integral gain [u/(y s)], finite and not negative.
            kd: derivative gain [u s/y], finite and not negative.
            dt: time from one update to the next [s], positive.
            u_min: lower limit of the command [u]; may be infinite.
            u_max: upper limit of the command [u], above u_min; may be infinite.
            tau: time constant of the derivative's filter [s], not negative; 0 is no filter.

        Raises:
            ValueError: for an argument out of its range.
        """
        for name, value in (("kp", kp), ("ki", ki), ("kd", kd), ("tau", tau)):
            if not 0.0 <= value < np.inf:
                raise ValueError(f"{name} must be a non-negative finite number, got {value}")
        if not 0.0 < dt < np.inf:
            raise ValueError(f"dt must be a positive finite number, got {dt}")
        if not u_min < u_max:
            raise ValueError(f"u_min must be a number below u_max = {u_max}, got {u_min}")
        self.kp, self.ki, self.kd = kp, ki, kd
        self.dt, self.tau = dt, tau
        self.u_min, self.u_max = u_min, u_max
        self.reset()

    def reset(self) -> None:
        """Forget the past: integral, filter and last measurement."""
        self.integral = 0.0  # [u]
        self.rate = 0.0  # [y/s]
        self.last: float | None = None

    def update(self, setpoint: float, measurement: float) -> float:
        """Return the command for the sample that begins now.

        Args:
            setpoint: desired value [y].
            measurement: value now [y].

        Returns:
            The command [u], between u_min and u_max.

        Raises:
            ValueError: for a value that is not finite; the controller is then as it was before.
        """
        for name, value in (("setpoint", setpoint), ("measurement", measurement)):
            if not abs(value) < np.inf:
                raise ValueError(f"{name} must be a finite number, got {value}")
        # The first sample has no predecessor, so its rate is 0 and not a jump from 0.
        change = 0.0 if self.last is None else measurement - self.last
        self.last = measurement
        # Backward Euler on the low-pass of the derivative: stable for every tau.
        self.rate = (self.tau * self.rate + change) / (self.tau + self.dt)

        error = setpoint - measurement
        integral = self.integral + self.ki * error * self.dt
        desired = self.kp * error + integral - self.kd * self.rate
        # Saturate, and integrate only what does not push deeper into the limit (anti-windup).
        command = min(max(desired, self.u_min), self.u_max)
        deeper = (desired > self.u_max and error > 0.0) or (desired < self.u_min and error < 0.0)
        if not deeper:
            self.integral = integral
        return float(command)


class ExactJoint:
    """The joint that the controller drives: inertia q'' = u + load - damping q', solved exactly.

    The command is held from one sample to the next (zero-order hold) and the system is linear, so
    the state at the samples has a closed form: there is no step to choose and no error of time
    (K. J. Astrom, B. Wittenmark, Computer-Controlled Systems, 1997, sec. 2.3).
    """

    def __init__(self, inertia: float, damping: float, dt: float, load: float = 0.0) -> None:
        """Create a joint at rest at angle 0.

        Args:
            inertia: about the axis [kg m^2], positive.
            damping: [N m s/rad], not negative.
            dt: sample time [s], positive.
            load: constant torque that acts beside the motor's [N m].

        Raises:
            ValueError: for an argument out of its range.
        """
        for name, value in (("inertia", inertia), ("dt", dt)):
            if not 0.0 < value < np.inf:
                raise ValueError(f"{name} must be a positive finite number, got {value}")
        if not 0.0 <= damping < np.inf:
            raise ValueError(f"damping must be a non-negative finite number, got {damping}")
        if not abs(load) < np.inf:
            raise ValueError(f"load must be a finite number, got {load}")
        # Zero-order hold of a linear system: the exponential of the state matrix in closed form.
        x = damping * dt / inertia
        decay = float(np.exp(-x))
        if x > 1e-3:
            first = float(-np.expm1(-x)) / x
            second = (1.0 - first) / x
        else:  # the same as power series, as the differences cancel
            first = 1.0 - x / 2.0 + x**2 / 6.0 - x**3 / 24.0
            second = 0.5 - x / 6.0 + x**2 / 24.0 - x**3 / 120.0
        # (q, v) after a sample is transition (q, v) + drive (u + load)
        self.transition = np.array([[1.0, first * dt], [0.0, decay]])
        self.drive = np.array([second * dt**2 / inertia, first * dt / inertia])
        self.load = load
        self.reset()

    def reset(self, q: float = 0.0, v: float = 0.0) -> None:
        """Put the joint at an angle [rad] with a speed [rad/s]."""
        self.q, self.v = q, v

    def step(self, command: float, blocked: bool = False) -> float:
        """Hold a torque for one sample.

        Args:
            command: the motor's torque [N m].
            blocked: whether the joint is jammed for this sample: it stays where it is.

        Returns:
            The angle after the sample [rad].
        """
        if blocked:
            self.v = 0.0
            return self.q
        (_, reach), (_, decay) = self.transition.tolist()
        near, fast = self.drive.tolist()
        torque = command + self.load
        self.q, self.v = self.q + reach * self.v + near * torque, decay * self.v + fast * torque
        return self.q


def closed_loop(
    controller: Any,
    joint: Any,
    setpoints: ArrayLike,
    blocked: ArrayLike = False,
    noise: ArrayLike = 0.0,
) -> tuple[Array, Array]:
    """Run a controller on a joint: measure, command, hold the command for one sample.

    Args:
        controller: anything with `update(setpoint, measurement) -> command`.
        joint: anything with an angle `q` and `step(command, blocked) -> angle`.
        setpoints: one for each sample, shape (n,) [rad].
        blocked: whether the joint is jammed, for each sample or for all.
        noise: added to each measurement [rad].

    Returns:
        Angles (n + 1,) from the start on [rad] and commands (n,) [N m].
    """
    desired = np.asarray(setpoints, dtype=float)
    # One value for all samples, or one each.
    jam = np.broadcast_to(blocked, desired.shape).tolist()
    errors = np.broadcast_to(noise, desired.shape).tolist()
    angles, commands = [joint.q], []
    for setpoint, stuck, error in zip(desired.tolist(), jam, errors, strict=True):
        commands.append(controller.update(setpoint, angles[-1] + error))
        angles.append(joint.step(commands[-1], stuck))
    return np.array(angles), np.array(commands)


# --- randomize: domain randomisation of a MuJoCo model --------------------------------------------


class DomainRandomizer:
    """Draws friction, masses, damping, an action delay and observation noise for a MuJoCo model.

    Every draw is made from the model's defaults, so that draws do not compound, and `restore` puts
    every array of the model back bit for bit. Four things are easily missed:

    - A contact takes the larger of the two geoms' coefficients. Were each drawn by itself, the
      contact would have the distribution of the larger of two draws, so all geoms get the same.
    - A body's inertia is a value of its own, which no function of MuJoCo derives from the mass: it
      is scaled by the same factor, as that of a body which keeps its shape.
    - The damping of a joint may be zero, which no factor changes: the draw is added.
    - `mj_setConst` recomputes what depends on mass and inertia (subtree masses, inverse weights,
      ...), but leaves the positions of the data it is given in the reference pose. It gets data of
      its own here.

    Randomising the dynamics like this is due to Peng et al., Sim-to-Real Transfer of Robotic
    Control with Dynamics Randomization, 2018.
    """

    def __init__(
        self,
        model: Any,
        friction: tuple[float, float] = (0.4, 1.2),
        mass: tuple[float, float] = (0.7, 1.3),
        damping: tuple[float, float] = (0.0, 0.5),
        delay: tuple[int, int] = (0, 3),
        noise: float = 0.01,
        idle: ArrayLike = 0.0,
    ) -> None:
        """Remember the model as it is now; what is drawn is uniform between (low, high).

        Args:
            model: `mujoco.MjModel`, changed in place by `randomize` and `restore`.
            friction: sliding friction coefficient of all contacts [-], positive.
            mass: factor on the mass and inertia of a body, drawn for each body [-], positive.
            damping: added to the damping of a joint, drawn for each hinge [N m s/rad] and slide
                [N s/m], not negative; free and ball joints keep theirs.
            delay: of the actions, in whole calls of `delay`, both ends included, not negative.
            noise: standard deviation of the observation noise [unit of the observation].
            idle: what `delay` returns until the first action is due [unit of the action].

        Raises:
            ValueError: for a range that is empty or not allowed, or a negative noise.
        """
        import mujoco

        for name, (low, high), least in (
            ("friction", friction, np.finfo(float).tiny),
            ("mass", mass, np.finfo(float).tiny),
            ("damping", damping, 0.0),
            ("delay", delay, 0),
            ("noise", (0.0, noise), 0.0),
        ):
            if not least <= low <= high < np.inf:
                what = "positive" if least else "not negative"
                allowed = f"finite, {what}, the low end first"
                raise ValueError(f"{name} must be {allowed}, got {low}, {high}")
        if any(end % 1 for end in delay):
            raise ValueError(f"delay must be an integer number of calls, got {delay}")
        self.model = model
        self.friction, self.mass, self.damping = friction, mass, damping
        self.delays, self.noise, self.idle = delay, noise, idle
        # Every array of the model is saved, so that `restore` needs no list of what was changed.
        fields = {name: getattr(model, name) for name in dir(model) if not name.startswith("_")}
        self._arrays = {k: v for k, v in fields.items() if isinstance(v, np.ndarray)}
        self._defaults = {name: value.copy() for name, value in self._arrays.items()}
        self._scratch = mujoco.MjData(model)
        # Free and ball joints keep their damping: only hinges and slides take a draw.
        single = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
        self._damped = np.isin(model.jnt_type, single)
        self.steps = 0  # of the action delay that was drawn
        self._waiting: deque[Array] = deque()

    def randomize(self, data: Any, rng: np.random.Generator) -> None:
        """Draw anew, write it into the model and start the action delay afresh.

        Args:
            data: `mujoco.MjData` of the model. Its state stays; what follows from the state and
                the model is computed anew.
            rng: where the random numbers come from.

        Raises:
            ValueError: if the data is of another model.
        """
        import mujoco

        self._check(data)
        # All draws come first: if one of them fails, the model is still whole.
        model, default = self.model, self._defaults
        friction = rng.uniform(*self.friction)
        factor = rng.uniform(*self.mass, size=model.nbody)
        added = np.where(self._damped, rng.uniform(*self.damping, size=model.njnt), 0.0)
        steps = int(rng.integers(*self.delays, endpoint=True))

        # Always from the defaults, so that factors do not compound from draw to draw.
        model.geom_friction[:, 0] = friction
        model.pair_friction[:, :2] = friction  # of a <pair>; both directions of sliding
        model.body_mass[:] = factor * default["body_mass"]
        model.body_inertia[:] = factor[:, None] * default["body_inertia"]
        model.dof_damping[:] = default["dof_damping"] + added[model.dof_jntid]
        # Quantities that follow from the masses, such as inverse weights, are computed again.
        mujoco.mj_setConst(model, self._scratch)
        mujoco.mj_forward(model, data)
        self._start_delay(steps)

    def restore(self, data: Any) -> None:
        """Put every array of the model back, bit for bit, and end the action delay.

        Args:
            data: `mujoco.MjData` of the model, treated as by `randomize`.

        Raises:
            ValueError: if the data is of another model.
        """
        import mujoco

        self._check(data)
        for name, value in self._defaults.items():
            self._arrays[name][...] = value
        mujoco.mj_forward(self.model, data)
        self._start_delay(0)

    def _check(self, data: Any) -> None:
        # MuJoCo itself would write beyond the arrays of smaller data.
        if data.signature != self.model.signature:
            raise ValueError(f"data must be that of the model that is randomised, got {data}")

    def _start_delay(self, steps: int) -> None:
        self.steps = steps
        self._waiting.clear()

    def delay(self, action: ArrayLike) -> Array:
        """Take the action of now, give back the one that is due: that of `steps` calls ago.

        Args:
            action: any shape, the same in every call.

        Returns:
            A new array of that shape; `idle` in each of the first `steps` calls.
        """
        action = np.array(action, dtype=float)  # a copy, as the caller may use the array again
        self._waiting.append(action)
        # The first `steps` calls have no action that is due.
        if len(self._waiting) <= self.steps:
            return np.full(action.shape, self.idle, dtype=float)
        return self._waiting.popleft()

    def observe(self, observation: ArrayLike, rng: np.random.Generator) -> Array:
        """Return a copy of the observation with fresh noise on each component."""
        observation = np.asarray(observation, dtype=float)
        return observation + rng.normal(0.0, self.noise, size=observation.shape)


# --- vector_env: many environments stepped as one -------------------------------------------------


class VectorizedEnv:
    """N environments stepped as one; a finished one starts again within the same step.

    What is easy to get wrong:

    - The last observation of a finished episode is copied **before** the reset. A learner needs it:
      where the clock ran out (truncated) the future still has a value, V(last observation); where
      the task is over (terminated) it has none. So the two flags stay apart as well.
    - Every environment gets a seed of its own at the reset, and none when it starts again: the same
      seed would replay the same episode for ever.
    - What is returned is new at every step, since the caller keeps it; an environment may write its
      next observation into the array of the last one.
    - The number of actions is checked: `zip` would drop what is too much and say nothing.
    """

    def __init__(self, env_fn: Callable[[], Any], num_envs: int) -> None:
        """Build the environments.

        Args:
            env_fn: function without arguments that builds one.
            num_envs: how many, at least 1.

        Raises:
            ValueError: for a num_envs below 1.
        """
        if num_envs < 1:
            raise ValueError(f"num_envs must be a positive integer, got {num_envs}")
        self.num_envs = num_envs
        self.envs = [env_fn() for _ in range(num_envs)]

    def reset(self, seed: int | None = None) -> tuple[Array, list[dict[str, Any]]]:
        """Start an episode in every environment; environment i gets the seed seed + i.

        Returns:
            Observations (num_envs, obs_dim) and one info for each environment.
        """
        observations, infos = [], []
        for i, env in enumerate(self.envs):
            observation, info = env.reset(seed=None if seed is None else seed + i)
            observations.append(np.array(observation, dtype=float))
            infos.append(dict(info))
        return np.stack(observations), infos

    def step(
        self, actions: Array
    ) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], list[dict[str, Any]]]:
        """Step every environment once, and start those again whose episode is over.

        Args:
            actions: one row for each environment, (num_envs, act_dim).

        Returns:
            observations (num_envs, obs_dim), of a finished environment the first one of its new
            episode; rewards, terminated and truncated (num_envs,); infos, with "final_obs" and
            "final_info" where an episode has ended.

        Raises:
            ValueError: for another number of actions.
        """
        if len(actions) != self.num_envs:
            raise ValueError(f"len(actions) must be {self.num_envs}, got {len(actions)}")
        observations, infos = [], []
        rewards = np.zeros(self.num_envs)
        terminated = np.zeros(self.num_envs, dtype=bool)
        truncated = np.zeros(self.num_envs, dtype=bool)
        for i, env in enumerate(self.envs):
            observation, rewards[i], terminated[i], truncated[i], info = env.step(actions[i])
            observation, info = np.array(observation, dtype=float), dict(info)
            if terminated[i] or truncated[i]:
                # The last observation was copied above, before the reset overwrites it.
                first, reset_info = self._auto_reset(i)
                info = {**reset_info, "final_obs": observation, "final_info": info}
                observation = first
            observations.append(observation)
            infos.append(info)
        return np.stack(observations), rewards, terminated, truncated, infos

    def _auto_reset(self, i: int) -> tuple[Array, dict[str, Any]]:
        """Start the next episode of environment i, with the generator that it has."""
        observation, info = self.envs[i].reset()
        return np.array(observation, dtype=float), dict(info)

    def close(self) -> None:
        """Close every environment."""
        for env in self.envs:
            env.close()
