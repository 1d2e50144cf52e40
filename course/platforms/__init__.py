"""Chapter 3: platforms. One scene on several simulators, measured, not rated.

The public names of the chapter; each lives in the file of its section. An engine is built for a
scene (`prepared(engine, scene, dt, settings)`), stepped (`run.run(steps)`) and asked for its state,
its energy and its contacts. `measures` turns runs into numbers with units, `theory` holds the
closed forms that they are set beside. The course's own code is the engine `Own()`; the adapters of
MuJoCo, Drake and PyBullet stand in `course.oracles` and are handed in.

It needs chapters 1, 2 and 4, whose code it runs.

The chapter's algorithms, and the functions of their steps:

- One interface for all engines: `contract.Engine.build` and `contract.Run`; `prepared` checks the
  scene.
- Time stepping with contacts (Stewart and Trinkle, 1996; Anitescu and Potra, 1997):
  `own.Touching._step`: free velocity, contacts, impulses, positions.
- Friction cones of the engines: `theory.stop` is where a block comes to rest for each section.
- Grasp limit by bisection: `measures.grasp_limit`, against `theory.grasp_threshold`.

Examples:
    >>> from course import platforms
    >>> engine = platforms.Own()  # the course's own code, as one of the simulators
    >>> isinstance(engine, platforms.Engine)
    True
"""

from course.platforms.contract import (
    AS_SHIPPED,
    FAIR,
    NO_CONTACTS,
    Change,
    ContactReport,
    Engine,
    Run,
    Settings,
    State,
    prepared,
    slip_of,
)
from course.platforms.own import Own
from course.platforms.scenes import SCENES, Body, Scene

__all__ = [
    "AS_SHIPPED",
    "FAIR",
    "NO_CONTACTS",
    "SCENES",
    "Body",
    "Change",
    "ContactReport",
    "Engine",
    "Own",
    "Run",
    "Scene",
    "Settings",
    "State",
    "prepared",
    "slip_of",
    "warm",
]


def warm() -> None:
    """Compile, or load from the cache, everything in this chapter that is compiled."""
    from course import contact, kinematics

    contact.warm()
    kinematics.warm()
    for name in ("tumble", "arm"):
        for scheme in Own.schemes:
            Own().build(SCENES[name](), 1e-3, FAIR.using(scheme)).run(1)
