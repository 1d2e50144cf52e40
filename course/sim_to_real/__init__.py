"""Chapter 8: from simulation to the real robot. The gap measured, and what each cure costs.

The public names of the chapter; each lives in the file of its section.

The chapter's algorithms, and the functions of their steps:

- Output-error identification (Ljung, 1999): `identify.fit`, its Jacobian in `_slope`; `excitation`
  predicts, `whiteness` tests the residuals.
- Potential-based shaping (Ng, Harada and Russell, 1999): `shaping.shaped`; `value_iteration`,
  `policy_iteration` and `learning_steps` solve the processes.
- Automatic domain randomisation (OpenAI, 2019): `tune.automatic`, whose search is `improve`, the
  cross-entropy method.
- Shapley values (Shapley, 1953): `transfer.attribution`.
- Rapid motor adaptation (Kumar and others, 2021): `varying_arms.train_student` computes the
  teacher's knowledge from a history; `track` runs every method's law.
- Actuator networks (Hwangbo and others, 2019): `actuator_network.fit_network`.

Examples:
    >>> from course import sim_to_real
    >>> world = sim_to_real.grid(4)  # 4 by 4 cells, the prize in the last corner
    >>> solution = sim_to_real.value_iteration(world)
    >>> print(f"{solution.value[0]:.4f}")  # six steps away, the prize comes with the last: 0.95^5
    0.7738
"""

from course.sim_to_real.identify import (
    Fit,
    Log,
    Visible,
    excitation,
    fit,
    measurement_lag,
    scan,
    validate,
    whiteness,
)
from course.sim_to_real.plants import (
    Outcome,
    Plants,
    Tasks,
    driven,
    nominal,
    real,
    rollouts,
    tasks,
    watch,
)
from course.sim_to_real.shaping import (
    Process,
    Solution,
    evaluate_policy,
    grid,
    learning_steps,
    policy_iteration,
    shaped,
    value_iteration,
)
from course.sim_to_real.transfer import (
    attribution,
    harmful_corrections,
    mended,
    share_of_bound,
    subsets,
    transfer_bound,
)
from course.sim_to_real.tune import (
    Automatic,
    Ranges,
    Tuned,
    around,
    automatic,
    improve,
    only,
    recorded,
    tune,
)

__all__ = [
    "Automatic",
    "Fit",
    "Log",
    "Outcome",
    "Plants",
    "Process",
    "Ranges",
    "Solution",
    "Tasks",
    "Tuned",
    "Visible",
    "around",
    "attribution",
    "automatic",
    "driven",
    "evaluate_policy",
    "excitation",
    "fit",
    "grid",
    "harmful_corrections",
    "improve",
    "learning_steps",
    "measurement_lag",
    "mended",
    "nominal",
    "only",
    "policy_iteration",
    "real",
    "recorded",
    "rollouts",
    "scan",
    "shaped",
    "share_of_bound",
    "subsets",
    "tasks",
    "transfer_bound",
    "tune",
    "validate",
    "value_iteration",
    "warm",
    "watch",
    "whiteness",
]


def warm() -> None:
    """Compile, or load from the cache, everything in this chapter that is compiled."""
    import numpy as np

    from course.sim_to_real import actuator_network, varying_arms

    rng = np.random.default_rng(0)
    rollouts(nominal(), [1.0] * 6, tasks(1, 0))
    learning_steps(grid(2), rng, 2, at_most=1)
    paths = varying_arms.references(1, rng, 0.02)
    varying_arms.track(varying_arms.family(1, rng), (1.0, 1.0, 0.0), paths)
    actuator_network.record(
        actuator_network.Drive(), actuator_network.targets(1, rng, seconds=0.02)
    )
