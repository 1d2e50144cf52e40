"""Claims of chapter 3: what "built on", "default", "guaranteed", "headless" and a speed mean."""

import time
from typing import Any

import numpy as np

from course.derivations import Symbol, claim
from course.derivations.platforms.same import DRAKE, MUJOCO, PYBULLET, simulators

SYMBOLS = {
    "a": Symbol("fixed cost of a batch step [s]"),
    "b": Symbol("cost of one environment more [s]"),
    "N": Symbol("environments"),
    "n": Symbol("axes of the chart", 3.0, 12.0),
    "r": Symbol("value on each axis"),
}


def seconds(call, repeats):
    """Return the least processor time of a call, in five rounds of `repeats` calls [s]."""
    result = []
    for _ in range(5):
        start = time.process_time()
        for _ in range(repeats):
            call()
        result.append((time.process_time() - start) / repeats)
    # The least of five: what other work does to a time is only added.
    return min(result)


@claim(
    "Two products that are built on the same engine give the same motion, whatever their settings.",
    "The settings decide, and the engine's name leaves them open. With PyBullet's default settings "
    "a block slides {shipped:.0%} further than with fair settings, on the same engine. With fair "
    "settings, along an axis of the contact, three different engines agree within {spread:.2%}.",
    source="Documented, not measured here: Isaac Sim on Omniverse, with PhysX or Newton (NVIDIA, "
    "Isaac Sim documentation, 2026); both are backends of Isaac Lab 3.0 (2026)",
    needs=("Drake", "PyBullet"),
)
def built_on(result):
    from course.platforms import AS_SHIPPED, FAIR, measures

    def length(name, heading=0.0, options=FAIR):
        return measures.stop(simulators(name)[0], heading, 2e-3, options).distance

    fair = [length(name) for name in (MUJOCO, DRAKE, PYBULLET)]
    shipped = result.measure("shipped", length(PYBULLET, options=AS_SHIPPED) / fair[2] - 1.0, 0.02)
    spread = result.measure("spread", max(fair) / min(fair) - 1.0, 0.5)
    headings = result.rng.uniform(0.0, 1.5, 3)
    # Random headings as well: a single one could be an exception.
    others = [length(PYBULLET, x, AS_SHIPPED) / length(PYBULLET, x) for x in headings]
    result.statement = (
        "A block sent off at 2 m/s with friction 0.5; step 2 ms. Measured after 1.5 times "
        "Coulomb's stopping time, when PyBullet's block with its own settings still slides."
    )
    result.statement_holds(abs(shipped) < 0.02)
    result.correction_holds(spread < 0.005, min(others) > 1.3)


@claim(
    "MuJoCo is the default of reinforcement learning.",
    "There is no official default. Of the {all:.0f} environments in Gymnasium's own packages, "
    "{mujoco:.0f} run on MuJoCo, its Ant and its Humanoid among them, and {plane:.0f} on Box2D, "
    "such as its walker in the plane. This counts what one library offers, not what people use.",
    source="Gymnasium's registry, as installed",
)
def default_of_learning(result):
    import gymnasium

    specs = gymnasium.registry.values()
    modules = [str(spec.entry_point).split(":")[0].split(".") for spec in specs]
    # Counted in the registry of the installed version.
    families = [m[2] for m in modules if m[:2] == ["gymnasium", "envs"]]
    mujoco = result.measure("mujoco", families.count("mujoco"), 0.3)
    everything = result.measure("all", len(families), 0.3)
    plane = result.measure("plane", families.count("box2d"), 0.5)
    result.statement = "Entry points of the registry, by the package that they name."
    named = ["mujoco" in m for m in modules if m[-1].startswith(("ant", "humanoid"))]
    result.statement_holds(mujoco == everything)
    # The robots that walk in a plane are the counter-example among robots.
    result.correction_holds(0.2 < mujoco / everything < 0.8, all(named), plane > 0)


@claim(
    "What Drake computes comes with a guarantee of correctness.",
    "A guarantee belongs to a class of problems. Started at {n:.0f} points, SNOPT called success "
    "at costs of {best:.2f} and {worst:.2f} for the same task, each a minimum of its surroundings.",
    source="Gill, Murray and Saunders, SNOPT, 2005, on local minima; Boyd and Vandenberghe, Convex "
    "Optimization, 2004, section 4.2.2",
    needs=("Drake",),
)
def drake_guarantees(outcome):
    n = int(outcome.input("n", 5))

    def costs(bend, tilt):
        """Return what SNOPT ends with from several starts for (x^2 - bend)^2 + tilt x."""
        from pydrake.solvers import MathematicalProgram, SnoptSolver

        ends = []
        for start in np.linspace(-2.0, 2.0, n):
            program = MathematicalProgram()
            x = program.NewContinuousVariables(1)[0]
            program.AddCost((x**2 - bend) ** 2 + tilt * x)
            result = SnoptSolver().Solve(program, np.array([start]))
            assert result.is_success()
            # The same problem from evenly spread starts: success means a local minimum.
            ends.append(result.get_optimal_cost())
        return np.array(ends)

    simulators(DRAKE)
    both = costs(1.0, 0.3)
    outcome.measure("best", both.min(), 1e-3)
    outcome.measure("worst", both.max(), 1e-3)
    draws = outcome.rng.uniform((0.3, 0.05), (1.5, 0.3), (8, 2))
    outcome.statement = "The cost (x^2 - b)^2 + a x, which is convex where b is not positive."
    outcome.statement_holds(
        np.ptp(both) < 1e-4,
        only_if="the problem is convex, or the solver bounds the global optimum as branch and "
        "bound does, and then within the solver's tolerance",
        # Chosen to break it: convex problems that are flat at their minimum, and steep ones.
        inside=[
            *(np.ptp(costs(-b, t)) < 1e-4 for b, t in draws),
            *(np.ptp(costs(b, t)) < 1e-4 for b, t in ((0.0, 0.0), (0.0, 1e-3), (-50.0, 5.0))),
        ],
        outside=[np.ptp(costs(b, t)) < 1e-4 for b, t in draws],
    )
    outcome.correction_holds(both.max() - both.min() > 0.1)


@claim(
    "Drake brings the planners SNOPT and IPOPT, LQR and MPC.",
    "SNOPT and IPOPT solve optimisation problems. To plan with them, you write such a problem "
    "yourself or use one of Drake's {plans:.0f} classes for trajectory optimisation. Drake has "
    "LQR; its gain agrees with SciPy's to {digits:.0f} digits. Of the {n:.0f} names among its "
    "controllers in Python, {mpc:.0f} are predictive. A linear MPC exists in C++ only.",
    source="Drake 1.51, 2026, pydrake.planning, solvers, systems.controllers; in C++ "
    "systems/controllers/linear_model_predictive_controller.h",
    needs=("Drake",),
)
def drake_planners(result):
    simulators(DRAKE)
    import pydrake.planning
    import pydrake.solvers
    import pydrake.systems.controllers as controllers
    from scipy.linalg import solve_continuous_are

    A, B = np.array([[0.0, 1.0], [2.0, -0.1]]), np.array([[0.0], [1.0]])
    gain, _ = controllers.LinearQuadraticRegulator(A, B, np.eye(2), np.eye(1))
    # Drake's gain against SciPy's Riccati solution.
    error = np.abs(gain / (B.T @ solve_continuous_are(A, B, np.eye(2), np.eye(1))) - 1.0).max()
    names = [name for name in dir(controllers) if name[0].isupper() and "_" not in name]
    mpc = result.measure("mpc", sum("Predictive" in name or "Mpc" in name for name in names), 0.0)
    result.measure("n", len(names), 0.5)
    plans = [getattr(pydrake.planning, x) for x in dir(pydrake.planning) if "TrajectoryOpt" in x]
    result.measure("plans", sum(isinstance(plan, type) for plan in plans), 0.5)
    digits = result.measure("digits", np.floor(-np.log10(max(error, 1e-10))), 0.3)
    solvers = [getattr(pydrake.solvers, name)() for name in ("SnoptSolver", "IpoptSolver")]
    result.statement = "Names of the module, and the gain of an unstable second-order plant."
    result.statement_holds(mpc > 0)
    result.correction_holds(
        digits >= 7,
        len(plans) > 0,
        *(s.available() and s.enabled() for s in solvers),
        *(isinstance(s, pydrake.solvers.SolverInterface) for s in solvers),
    )


@claim(
    "With Drake's formal verification one proves that a robot never falls.",
    "What is proved is a set of states of a polynomial model. Of x' = x^3 - x it finds |x| < "
    "{edge:.3f}, which is exact. If the real cubic term is {more:.0%} larger, a state that starts "
    "at {start:.2f} of that edge does not come back.",
    source="Tedrake, Underactuated Robotics, 2024, Lyapunov analysis; Drake 1.51, 2026, "
    "RegionOfAttraction",
    needs=("Drake",),
)
def proof_never_falls(result):
    more, share = result.input("more", 0.1), result.input("start", 0.98)
    simulators(DRAKE)
    from pydrake.symbolic import Variable
    from pydrake.systems.analysis import RegionOfAttraction, Simulator
    from pydrake.systems.primitives import SymbolicVectorSystem

    def plant(cubic):
        x = Variable("x")
        return SymbolicVectorSystem(state=[x], dynamics=[cubic * x**3 - x])

    def stands(start, cubic, kick=0.0):
        """Return whether a state comes back to 0, kicked after a quarter of a second."""
        simulator = Simulator(plant(cubic))
        state = simulator.get_mutable_context().get_mutable_continuous_state_vector()
        state.SetFromVector([start])
        for k in range(60):
            if k == 5:
                state.SetFromVector([state.GetAtIndex(0) + kick])
            simulator.AdvanceTo(simulator.get_context().get_time() + 0.05)
            if abs(state.GetAtIndex(0)) > 3.0:
                return False
        return bool(abs(state.GetAtIndex(0)) < abs(start))

    system = plant(1.0)
    level = RegionOfAttraction(system, system.CreateDefaultContext())
    (variable,) = level.GetVariables()
    at = level.Evaluate({variable: 1.0})
    edge = result.measure("edge", np.sqrt(1.0 / at), 1e-3)
    missing = not stands(share * edge, 1.0 + more)
    draws = result.rng.uniform((0.5, 0.0), (0.98, 0.2), (8, 2))
    result.statement = "Sums of squares for the set, Drake's own simulator for the runs."
    result.statement_holds(
        not missing,
        only_if="the model is right, disturbances included, and the start is in the set that was "
        "proved",
        # Chosen to break it: starts on the other side, and next to the edge.
        inside=[
            *(stands(x * edge, 1.0) for x, _ in draws),
            *(stands(x * edge, 1.0) for x in (-0.5, -0.98, 0.9999, -0.9999)),
        ],
        # Also a right model and a right start, but a kick out of the set.
        outside=[stands(0.98 * edge, 1.02 + y) for _, y in draws]
        + [stands(x * edge, 1.0, kick=1.0) for x in (0.3, 0.9)],
    )
    result.correction_holds(abs(edge - 1.0) < 1e-3, missing, not stands(1.02 * edge, 1.0))


@claim(
    "Headless means that nothing is rendered.",
    "It means that there is no window. In a world without one, PyBullet still rendered an image of "
    "{side:.0f} by {side:.0f} pixels. It took {steps:.1f} orders of magnitude longer than a step "
    "of the scene. To save this time, remove the camera.",
    source="Documented, not measured here: Isaac Lab, AppLauncher, 2025: --headless opens no "
    "window, --enable_cameras renders without one; since 3.0 (2026) it is --viz none",
    needs=("PyBullet",),
)
def headless_renders(result):
    from course.oracles.pybullet import library
    from course.platforms import FAIR, scenes

    side = int(result.input("side", 64))
    (bullet,) = simulators(PYBULLET)
    lib, run = library(), bullet.build(scenes.field(4), 1e-3, FAIR)
    view = lib.computeViewMatrix([1.0, 1.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    lens = lib.computeProjectionMatrixFOV(60.0, 1.0, 0.1, 10.0)

    def picture():
        return lib.getCameraImage(
            side, side, view, lens, renderer=lib.ER_TINY_RENDERER, physicsClientId=run.client
        )

    run.run(50)
    cost = seconds(picture, 5) / seconds(lambda: run.run(50), 4) * 50.0
    steps = result.measure("steps", np.log10(cost), 0.25)
    windows = lib.getConnectionInfo(run.client)["connectionMethod"] != lib.DIRECT
    observed = np.unique(np.reshape(picture()[4], -1)).size
    run.close()
    result.statement = "Four cubes; the pixels' own numbers of bodies, and times of one process."
    result.statement_holds(observed < 2)
    result.correction_holds(not windows, observed >= 4, steps > 0.5)


@claim(
    "MuJoCo 3 is a simulator with a Python-first API.",
    "Its API is the header mujoco.h, by its own manual: {same:.0f} of its {n:.0f} functions carry "
    "the same name in Python. The bindings came with version {first}, not with the third.",
    source="MuJoCo 4.0 manual, 2026, Python and Changelog",
)
def python_first(result):
    import re
    from pathlib import Path

    import mujoco

    folder = Path(mujoco.__file__).parent
    header = (folder / "include" / "mujoco" / "mujoco.h").read_text(encoding="utf-8")
    names = set(re.findall(r"MJAPI [\w\s*]*?\b(mj\w*_\w+)\(", header))
    n = result.measure("n", len(names), 0.3)
    same = result.measure("same", sum(hasattr(mujoco, name) for name in names), 0.3)
    log = (folder / "doc" / "changelog.rst").read_text(encoding="utf-8")
    news = log[: log.index("Added new :doc:`Python bindings")]
    first = result.measure("first", re.findall(r"^Version ([\d.]+)", news, re.M)[-1])
    result.statement = "The header, the manual and the changelog that are installed with it."
    result.statement_holds(int(first.split(".")[0]) >= 3)
    page = (folder / "doc" / "python.rst").read_text(encoding="utf-8")
    result.correction_holds(same > 0.4 * n, "consistent with the underlying C API" in page)


@claim(
    "DeepMind bought MuJoCo and opened its sources.",
    "{months:.0f} months after the first free version the sources were opened; what is installed "
    "is under {licence}.",
    source="MuJoCo 4.0 manual, 2026, Changelog, versions 2.1.0 (2021) and 2.2.0 (2022); Google "
    "DeepMind, Opening up a physics simulator for robotics, 2021",
)
def opened(result):
    import re
    from importlib.metadata import metadata
    from pathlib import Path

    import mujoco

    log = (Path(mujoco.__file__).parent / "doc" / "changelog.rst").read_text(encoding="utf-8")
    months = "JanFebMarAprMayJunJulAugSepOctNovDec"

    def dated(version):
        (row,) = re.findall(rf"Version {version} \((\w{{3}})\S* \d+, (\d+)\)", log)
        month, year = row
        return 12 * int(year) + months.index(month) // 3

    gap = result.measure("months", dated("2.2.0") - dated("2.1.0"), 0.0)
    licence = result.measure("licence", metadata("mujoco")["License-Expression"])
    opening = log[log.index("Version 2.2.0") :][:200]
    result.statement = "Dates and words of the installed changelog, licence of the package."
    result.statement_holds("Open Sourcing" in opening and licence == "Apache-2.0")
    result.correction_holds("Open Sourcing" in opening, 0 < gap < 12)


@claim(
    "PyBullet wraps Bullet, and has no physics on the GPU.",
    "Of the {n:.0f} names of its module {gpu:.0f} speak of a GPU, CUDA or OpenCL, and {gl:.0f} of "
    "OpenGL, which draws. An experiment with OpenCL in Bullet's own sources stays there.",
    source="README of bullet3, on experimental OpenCL; PyBullet Quickstart Guide, 2023; Coumans "
    "and Bai, PyBullet, 2016 to 2021",
    needs=("PyBullet",),
)
def bullet_on_gpu(result):
    from course.oracles.pybullet import library

    names = [name.lower() for name in dir(library()) if not name.startswith("_")]
    result.measure("n", len(names), 0.2)
    on_gpu = [name for name in names if any(word in name for word in ("gpu", "cuda", "opencl"))]
    gpu = result.measure("gpu", len(on_gpu), 0.0)
    gl = result.measure("gl", sum("opengl" in name for name in names), 0.5)
    result.statement = "Names of the installed module."
    result.statement_holds(gpu == 0)
    result.correction_holds(gl > 0, "stepsimulation" in names)


@claim(
    "A batch simulator that is slow gets faster with fewer environments.",
    "A step of it does end sooner. But as long as memory holds all environments, a step costs "
    "a + b N, so the rate is N / (a + b N) environment steps per second. At N = {formula} it "
    "reaches half of its largest value, 1/b. On one thread, the course's arm had a rate "
    "{gain:.1f} orders of magnitude higher with {many:.0f} environments than with one.",
    ask=(
        "A batch step of N environments costs a + b N. At which N is half of the highest rate of "
        "environment steps reached?",
        "N = a/b",
        {
            "b/a": "The dearer the launch, the more environments it takes.",
            "a*b": "Its unit is not that of a number.",
            "2*a/b": "There it is two thirds.",
            "a/(2*b)": "There it is a third.",
        },
    ),
    source="Documented, not measured here: Isaac Lab, Performance benchmarks, 2025",
)
def fewer_environments(result):
    import sympy

    from course import kinematics

    a, b, N = sympy.symbols("a b N", positive=True)
    rate = N / (a + b * N)
    result.formula = sympy.solve(sympy.Eq(rate, sympy.limit(rate, N, sympy.oo) / 2), N)[0]
    arm, count = kinematics.panda(), int(result.input("many", 256))

    def cost(n):
        q = result.rng.uniform(-1.0, 1.0, (arm.n, n))
        still = np.zeros_like(q)
        kinematics.forward_dynamics(arm, q, still, still)
        return seconds(lambda: kinematics.forward_dynamics(arm, q, still, still), 1000 // n + 2)

    one, some, lots = (cost(n) for n in (1, 16, count))
    # It depends on the vector instructions of the processor, and on what else runs beside it.
    gain = result.measure("gain", np.log10(count * one / lots), 0.5)
    result.statement = "Forward dynamics of the 7-R arm, vectorised, in processor time."
    result.statement_holds(1.0 / one > count / lots)
    result.correction_holds(gain > 0.3, one < some < lots, 16 / some > 1 / one)


@claim(
    "MuJoCo makes 10 to 50 million steps a second on one thread.",
    "A number without its scene says nothing. Even a pendulum that touches nothing fell short of "
    "ten million by {short:.1f} powers of ten. A step with {n:.0f} cubes on the ground cost "
    "eight to nine times as much as with the cubes floating and contacts switched off.",
    source="genesis-world, issue 181, 2024: from 14.5 to 1.2 million with more exact settings, a "
    "robot that moved and could touch itself; DeepMind, MuJoCo XLA, 2023: millions of steps on "
    "accelerators, in batches",
)
def steps_per_second(result):
    import mujoco

    from course.platforms import FAIR, prepared, scenes

    def cost(scene, steps, free=False):
        run: Any = prepared(simulators(MUJOCO)[0], scene, 1e-3, FAIR)
        if free:
            run.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
            run.model.opt.gravity[:] = 0.0
        run.run(100)
        return seconds(lambda: run.run(steps), 1) / steps

    n = int(result.input("n", 16))
    pendulum = cost(scenes.chain(1), 20_000)
    short = result.measure("short", np.log10(1e7 * pendulum), 0.3)
    cubes = scenes.field(n)
    more = cost(cubes, 300) / cost(cubes, 1000, free=True)
    ground = result.measure("ground", np.log10(more), 0.3)
    # The texts say eight to nine times: it varies a little from run to run.
    result.measure("times", more, 0.5)
    result.statement = "Processor time of steps in MuJoCo's own loop, fair settings."
    result.statement_holds(short <= 0.0)
    result.correction_holds(short > 0.3, ground > 0.5)


@claim(
    "The simulator with the larger area in a radar chart is the better one.",
    "The area is a sum of products of neighbouring values, so it depends on the order of the axes. "
    "With the same five values, the largest area is {most:.2f} times the smallest. In {turned:.0%} "
    "of {n:.0f} random pairs of charts, the order decides which one is larger.",
    ask=(
        "A radar chart of n axes shows the value r on each. What is its area?",
        "n*r^2*sin(2*pi/n)/2",
        {
            "pi*r^2": "That is the circle; five corners leave a quarter of it out.",
            "n*r^2*sin(pi/n)/2": "Between two axes there is the angle 2 pi / n.",
            "n*r*sin(2*pi/n)/2": "An area goes with the square.",
            "n*r^2*tan(pi/n)": "That is the polygon around the circle.",
        },
    ),
)
def radar_area(result):
    import itertools

    import sympy

    n, r = sympy.symbols("n r", positive=True)
    corner = sympy.Matrix([r * sympy.cos(2 * sympy.pi / n), r * sympy.sin(2 * sympy.pi / n)])
    result.formula = n * sympy.Matrix.hstack(sympy.Matrix([r, 0]), corner).det() / 2
    orders = [(0, *rest) for rest in itertools.permutations(range(1, 5)) if rest[0] < rest[-1]]

    def areas(values):
        turned = np.asarray(values)[..., orders]
        return 0.5 * np.sin(0.4 * np.pi) * np.sum(turned * np.roll(turned, 1, axis=-1), axis=-1)

    figures = areas([1.0, 0.9, 0.2, 0.1, 0.8])
    largest = result.measure("most", figures.max() / figures.min(), 1e-6)
    pairs = areas(result.rng.uniform(0.1, 1.0, (int(result.input("n", 2000)), 2, 5)))
    first = pairs[:, 0] > pairs[:, 1]
    turned = result.measure("turned", np.mean(first.any(axis=1) & ~first.all(axis=1)), 0.1)
    result.statement = "All twelve orders of five axes."
    result.statement_holds(turned == 0.0)
    result.correction_holds(
        largest > 1.3,
        turned > 0.1,
        bool(abs(areas([1.0] * 5)[0] / float(result.formula.subs({n: 5, r: 1})) - 1) < 1e-9),
    )
