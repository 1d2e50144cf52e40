"""Chapter 9: robot learning. Every method on the smallest task that shows its point.

The chapter's algorithms, and the functions of their steps:

- Generalised advantage estimation (Schulman et al., 2016): `gae`.
- Proximal policy optimisation (Schulman et al., 2017): `ppo`, whose surrogate is
  `clipped_objective`.
- DAgger (Ross, Gordon and Bagnell, 2011): `dagger`.
- DDIM (Song, Meng and Ermon, 2021): `mix` is the schedule, `denoise` the sampler.
- Flow matching (Lipman et al., 2023): `flow_policy` trains the field, `integrate` solves it.

The public names of the chapter; each lives in the file of its section. `PointReach`, the task on
which PPO learns, is an environment like others: `course.vector_env`.

Examples:
    >>> import numpy as np
    >>> from course import learning
    >>> ended = np.array([[False], [False], [True]])
    >>> ones, zeros = np.ones((3, 1)), np.zeros((3, 1))
    >>> advantages = learning.gae(ones, zeros, zeros, ended, np.zeros_like(ended), 0.9, 1.0)
    >>> print(advantages.ravel())  # 1 + 0.9 + 0.81, 1 + 0.9, 1
    [2.71 1.9  1.  ]
"""

from course.learning.chunk import Coded, Commit, Delayed, Ensemble, Executor, chunk_policy
from course.learning.clone import Linear, Policy, Round, clone, dagger, linear, nearest
from course.learning.evaluate import Band, Episodes, band, evaluate, first_finished
from course.learning.generate import (
    Drawn,
    Mixture,
    ddim_step,
    denoise,
    diffusion_policy,
    flow_policy,
    integrate,
    mix,
)
from course.learning.network import (
    Diverged,
    Normaliser,
    fit,
    flatten,
    load,
    network,
    predict,
    tensor,
    weights,
)
from course.learning.ppo import ActorCritic, Iteration, Settings, clipped_objective, gae, ppo
from course.learning.recorded import recorded, remake
from course.learning.tasks import (
    Circle,
    Regulator,
    Runs,
    TwoWays,
    accumulated,
    context_costs,
    expected_cost,
    roll,
    runs,
    windows,
)
from course.libraries import one_thread

__all__ = [
    "ActorCritic",
    "Band",
    "Circle",
    "Coded",
    "Commit",
    "Delayed",
    "Diverged",
    "Drawn",
    "Ensemble",
    "Episodes",
    "Executor",
    "Iteration",
    "Linear",
    "Mixture",
    "Normaliser",
    "Policy",
    "Regulator",
    "Round",
    "Runs",
    "Settings",
    "TwoWays",
    "accumulated",
    "band",
    "chunk_policy",
    "clipped_objective",
    "clone",
    "context_costs",
    "dagger",
    "ddim_step",
    "denoise",
    "diffusion_policy",
    "evaluate",
    "expected_cost",
    "first_finished",
    "fit",
    "flatten",
    "flow_policy",
    "gae",
    "integrate",
    "linear",
    "load",
    "mix",
    "nearest",
    "network",
    "one_thread",
    "ppo",
    "predict",
    "recorded",
    "remake",
    "roll",
    "runs",
    "tensor",
    "warm",
    "weights",
    "windows",
]


def warm() -> None:
    """Compile, or load from the cache, everything in this chapter that is compiled."""
    import numpy as np

    from course.learning.forward import mixture_sample, perceptron

    one = np.zeros((1, 1))
    perceptron(one, np.zeros(6, np.float32), 1, 1)
    TwoWays().sides(np.zeros((1, 2, 2)))
    mixture_sample(np.zeros((1, 3)), 1, one, one)
