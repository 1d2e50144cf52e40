"""Many copies of one environment, stepped as one: the data source of reinforcement learning.

All of them are `gymnasium.vector.VectorEnv`, so Gymnasium's vector wrappers and training loops run
on them, and all give what a loop over single environments gives, bit for bit:

- `VectorizedEnv(env_fn, num_envs)`: one after the other, in this process;
- `ProcessVectorEnv(env_fn, num_envs)`: in worker processes, with shared memory;
- `ArmReachVector(num_envs)`: the closed-form two-link arm, all copies in one compiled call;
- `PointReachVector(num_envs)`: a point pushed to a disc, whose best is known exactly;
- `course.oracles.mujoco.reach.MujocoArmReachVector(num_envs)`: the same task in `mujoco.batch`.

An episode ends in one of two ways, which are kept apart: `terminations` (the task is over, there is
no future to value) and `truncations` (a time limit or something else that is not part of the task
cut it off, there is one). What follows is Gymnasium's `AutoresetMode`, an argument of all of them,
and `metadata["autoreset_mode"]` says which it is:

- NEXT_STEP, the default as in Gymnasium: the row holds the last observation, and the next step of
  this environment ignores its action and starts the new episode with reward 0;
- SAME_STEP: the row holds the first observation of the new episode; the last observation and info
  of the old one are in `infos["final_obs"]` and `infos["final_info"]`, with the masks
  `infos["_final_obs"]` and `infos["_final_info"]`;
- DISABLED: the caller resets, with `reset(options={"reset_mask": mask})`, before the next step.

    import gymnasium
    envs = gymnasium.make_vec("course.vector_env:course/ArmReach-v0", num_envs=256)

An episode is truncated after `max_steps`, an argument of every environment here. The registered
specifications state the default as `max_episode_steps`, so that wrappers such as
`TimeAwareObservation` know it. Where both are given, the earlier one truncates; for longer episodes
pass both. `course.oracles.sb3.vec_env` is the adapter for Stable-Baselines3.

`render_mode="rgb_array"` makes pictures of the arms; `course.vector_env.training` learns to reach.

The chapter's algorithms, and the functions of their steps:

- Autoreset with two kinds of ends (Pardo et al., 2018): `interface.Lane.step` for one environment,
  `arrays.ArrayVectorEnv.step` for arrays.
- Shared memory between processes: `processes._Shared` lays out the arrays, `_work` is the worker.
- Time-optimal reaching of a point mass: `point.plan` is the exact truth of `PointReach`.

Examples:
    >>> import numpy as np
    >>> from course.vector_env import PointReachVector
    >>> envs = PointReachVector(num_envs=3)
    >>> observations, infos = envs.reset(seed=0)
    >>> observations.shape
    (3, 4)
    >>> observations, rewards, terminations, truncations, infos = envs.step(np.zeros((3, 2)))
    >>> print(terminations)
    [False False False]
"""

import gymnasium

from course.vector_env import point, reach
from course.vector_env.arrays import ArrayVectorEnv
from course.vector_env.point import PointReach, PointReachVector
from course.vector_env.processes import ProcessVectorEnv, WorkerError
from course.vector_env.reach import ArmReach, ArmReachVector, kernels
from course.vector_env.sequential import VectorizedEnv

__all__ = [
    "ArmReach",
    "ArmReachVector",
    "ArrayVectorEnv",
    "PointReach",
    "PointReachVector",
    "ProcessVectorEnv",
    "VectorizedEnv",
    "WorkerError",
    "warm",
]

# Gymnasium imports the module before the colon of "course.vector_env:course/ArmReach-v0", and so
# comes by these names.
for _name, _single in (
    ("course/ArmReach-v0", "course.vector_env.reach:ArmReach"),
    ("course/PointReach-v0", "course.vector_env.point:PointReach"),
    ("course/ArmReachMujoco-v0", "course.oracles.mujoco.reach:MujocoArmReach"),
):
    if _name not in gymnasium.registry:
        gymnasium.register(
            _name,
            entry_point=_single,
            vector_entry_point=f"{_single}Vector",
            max_episode_steps=reach.MAX_STEPS if "Arm" in _name else point.MAX_STEPS,
        )


def warm() -> None:
    """Compile, or load from the cache, everything here that is compiled."""
    kernels()
    point.kernels()
