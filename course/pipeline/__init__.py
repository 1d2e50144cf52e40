"""Chapter 11: the whole pipeline. Which stage owns which millimetre, and which failure.

The front door:

    Scenario, Settings                      what is asked, and how it is done
    run(scenario, settings, stages, seed) -> Record      once, the same on every machine
    many(scenario, settings, seeds)         for many seeds; `errors`, `successes` of the records
    Stages(perceive, plan, control, move)   ours, each replaceable by a library's or a learner's
    repair(settings, "age", ...)            the same with some stages ideal

The chapter's algorithms, and the functions of their steps:

- The pipeline from event to event: `drive.drive`, with `observe`, `advance` (control and physics)
  and `between`; `stages.plan_path` plans.
- Fault localisation by repairs (delta debugging; Zeller and Hildebrandt, 2002): `blame.contracts`
  checks, `blame.blame` replays with stages made ideal, `minimal` reduces the scenario.
- Error budget over all subsets (Shapley, 1953): `budget.budget`; `predicted` is its closed form.
- Noise with heavy tails (Student, 1908), as an AR(1) process, or hidden by the arm: `noise.Noise`;
  the false-alarm rates of two contracts in closed form: `alarms_of_frames`, `alarms_of_mean`.
- Rare failures by cross-entropy importance sampling (Rubinstein and Kroese, 2004):
  `rare.cross_entropy`, its weights in `_estimate`.

Examples:
    >>> from course import pipeline
    >>> settings = pipeline.repair(pipeline.Settings(), "age")
    >>> sorted(settings.ideal)
    ['age']
    >>> len(pipeline.subsets())  # of five stages
    32
"""

from functools import partial

from course.pipeline.run import Record, Run, errors, run, run_many, successes, tip_of
from course.pipeline.scenario import STAGES, Scenario, Settings, repair, subsets
from course.pipeline.stages import (
    Crossing,
    Frames,
    Path,
    Sight,
    Stages,
    control,
    frames,
    move,
    perceive,
    plan_path,
)

__all__ = [
    "STAGES",
    "Crossing",
    "Frames",
    "Path",
    "Record",
    "Run",
    "Scenario",
    "Settings",
    "Sight",
    "Stages",
    "control",
    "errors",
    "frames",
    "move",
    "perceive",
    "plan_path",
    "repair",
    "run",
    "run_many",
    "subsets",
    "successes",
    "tip_of",
    "warm",
]


def warm() -> None:
    """Compile, or load from the cache, everything in this chapter that is compiled."""
    short, settings = Scenario(seconds=0.2), Settings(frame=0.05)
    run(short, settings)
    # What is compiled between two events, where one of the two is not ours.
    run(short, settings, Stages(control=partial(control)))
    run(short, settings, Stages(move=partial(move)))
