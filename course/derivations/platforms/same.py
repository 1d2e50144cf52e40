"""Claims of chapter 3: what engines have in common, what their defaults change, what repeats."""

from dataclasses import replace

import numpy as np

from course.derivations import claim

MUJOCO, DRAKE, PYBULLET, OURS = "MuJoCo", "Drake", "PyBullet", "own code"
FOUR = (OURS, MUJOCO, DRAKE, PYBULLET)


def simulators(*names):
    """Return engines by name.

    Raises:
        ImportError: one is not installed; the message names the package.
    """
    from course.oracles.engines import engines

    result = [engines()[name] for name in names]
    for engine in result:
        if missing := engine.missing():
            raise ImportError(missing)
    return result


def errors(names, scene, dt, **settings):
    """Return the error of a scene at its end in each engine with its fair settings [m or rad]."""
    from course.platforms import FAIR, measures

    report = FAIR.using(**settings)
    return np.array([measures.position_error(e, scene, dt, report) for e in simulators(*names)])


@claim(
    "Drake integrates more accurately than MuJoCo, and MuJoCo more accurately than PyBullet.",
    "An engine is not a scheme. Where nothing touches, all four use semi-implicit Euler (Drake "
    "updates orientations by a variant of it). At a step of {ms:.0f} ms, all err by "
    "{tumble:.3f} mrad on a tumbling body and {arm:.3f} mrad on a "
    "falling arm. Over steps of {short:.1f} to {long:.1f} ms they differ by at most {spread:.3%} "
    "of their error. With contact they differ more: on a braking block launched at {heading:.1f} "
    "degrees to an axis of its contact, the errors of MuJoCo, Drake and PyBullet range from "
    "{least:.2f} to {most:.2f} mm.",
    source="Erez, Tassa and Todorov, Simulation tools for model-based robotics, 2015, which "
    "compares engines at equal cost",
    needs=("Drake", "PyBullet"),
)
def engines_agree(result):
    from course.platforms import scenes

    short, long = result.input("short", 0.3), result.input("long", 2.0)
    dt = 1e-3 * result.input("ms", 1.0)
    tumble = errors(FOUR, scenes.tumble(1.0), dt)
    arm = errors(FOUR, scenes.arm(0.2), dt)
    result.measure("tumble", 1e3 * tumble.mean(), 1e-3)
    result.measure("arm", 1e3 * arm.mean(), 1e-3)
    tried = [tumble, arm, errors(FOUR, scenes.chain(3, 0.3), dt)]
    for some in 1e-3 * result.rng.uniform(short, long, 4):
        tried += [errors(FOUR, scenes.tumble(0.5), some), errors(FOUR, scenes.arm(0.1), some)]
    heading = result.input("heading", 22.5)
    brake = errors((MUJOCO, DRAKE, PYBULLET), scenes.brake(float(np.radians(heading))), dt)
    result.measure("least", 1e3 * brake.min(), 0.2)
    result.measure("most", 1e3 * brake.max(), 0.2)
    touch = np.ptp(brake) / brake.min()
    along = errors((MUJOCO, DRAKE, PYBULLET), scenes.brake(), dt)
    spread = result.measure("spread", max(np.ptp(row) / row.min() for row in tried), 0.3)
    result.statement = "All four with fair settings, compared with a truth that is more accurate."
    result.statement_holds(any(row[2] < 0.9 * row[1] < 0.81 * row[3] for row in tried))
    result.correction_holds(
        spread < 0.01,
        touch > 0.5,
        # Along an axis of the contact they agree far better.
        np.ptp(along) / along.min() < 0.25 * touch,
        min(row.min() for row in tried) > 1e-6,
        1e-4 < brake.min() < brake.max() < 2e-3,
    )


@claim(
    "Out of the box, two simulators that load the same URDF give the same motion.",
    "Defaults are part of the model. Those of MuJoCo and Drake change nothing here. PyBullet's "
    "default damping and motors, and inertias that it computes from shapes, multiply its error: "
    "by {tumble:.0f} on a tumbling body, {chain:.0f} on a chain and {arm:.0f} on an arm, compared "
    "with fair settings. MuJoCo and Drake differ, too, at joint limits, at dry friction "
    "(which Drake does not read) and at joints that copy another.",
    source="PyBullet Quickstart Guide, 2023: changeDynamics, setJointMotorControl2, loadURDF",
    needs=("Drake", "PyBullet"),
)
def defaults_differ(result):
    from course.platforms import AS_SHIPPED, measures, prepared, scenes

    (bullet,) = simulators(PYBULLET)
    cases = {"tumble": scenes.tumble(1.0), "chain": scenes.chain(6, 0.5), "arm": scenes.arm(0.2)}
    found_by = {name: measures.effects(bullet, scene, 1e-3) for name, scene in cases.items()}
    for name, rows in found_by.items():
        result.measure(name, rows[0].shipped / rows[0].fair, 0.05)
    without = {row.key: row.without / row.fair for row in found_by["arm"]}
    damped = {row.key: row.without / row.fair for row in found_by["tumble"]}
    others = simulators(MUJOCO, DRAKE)
    settled = [measures.effects(e, scene, 1e-3) for e in others for scene in cases.values()]
    shipped = np.array(
        [
            [measures.position_error(e, scene, 1e-3, AS_SHIPPED) for e in (*others, bullet)]
            for scene in cases.values()
        ]
    )
    # How far the second and the third engine are from the first, as a share of its error.
    apart = np.abs(shipped[:, 1:] / shipped[:, :1] - 1.0)
    two = scenes.chain(2, 0.5)

    def alike(text):
        """Return whether MuJoCo and Drake differ by under 1 % of what half the step changes."""
        scene = replace(two, urdf=text)

        def end(engine, dt):
            world = prepared(engine, scene, dt, AS_SHIPPED)
            world.run(round(scene.duration / dt))
            return world.state().q

        first, half, second = (
            end(*x) for x in ((others[0], 1e-3), (others[0], 5e-4), (others[1], 1e-3))
        )
        return bool(np.abs(second - first).max() < 0.01 * np.abs(half - first).max())

    viscous = two.urdf.replace('damping="0"', 'damping="0.2"')
    rubbing = two.urdf.replace('friction="0"', 'friction="0.3"')
    limited = two.urdf.replace("continuous", "revolute").replace(
        "<limit ", '<limit lower="-0.7" upper="0.7" '
    )
    copied = two.urdf.replace(
        '<joint name="joint1" type="continuous">',
        '<joint name="joint1" type="continuous"><mimic joint="joint0" multiplier="0.5"/>',
    )
    result.statement = "Errors at 1 ms, all changes made, none, and all but one."
    result.statement_holds(
        bool(np.all(apart < 0.01)),
        only_if="nothing touches, no joint meets a limit, has dry friction or copies another one, "
        "both take the same step, and neither adds damping, motors or other inertias by default "
        "(MuJoCo and Drake add none)",
        inside=[*(apart[:, 0] < 0.01), alike(viscous)],
        # Chosen to break it: what a URDF may also say of a joint.
        outside=[*(apart[:, 1] < 0.01), *(alike(text) for text in (limited, rubbing, copied))],
        cases=True,
    )
    result.correction_holds(
        damped["damping"] > 10,
        without["motors"] > 10,
        without["inertia"] > 10,
        all(x.shipped < 1.01 * x.fair for rows in settled for x in rows),
        not any(alike(text) for text in (limited, rubbing, copied)),
    )


@claim(
    "With fair settings, where nothing touches and no joint meets a limit or copies another one, "
    "half the step leaves about half the error in each engine's default scheme.",
    "Each default scheme is of first order: on a tumble and a short fall the four orders were "
    "{lowest:.3f} to {highest:.3f}. MuJoCo's RK4 is of order {rk4:.1f}. With settings  as shipped "
    "this fails: half the step left {left:.1%} of PyBullet's error on the tumble, because its "
    "damping is no error of the step. MuJoCo's joint limits and copied joints are soft springs, "
    "and what they yield does not shrink with the step.",
    needs=("Drake", "PyBullet"),
)
def halving_halves(result):
    from course.charts.platforms import joints
    from course.platforms import scenes
    from course.platforms.joint_scenes import coupled, stop

    def yields(scene, dt):
        """Return the largest error of MuJoCo's joints, looked at every 20 ms [rad]."""
        times, q, _ = joints.motion(simulators(MUJOCO)[0], scene, dt, scene.duration)
        seen = slice(round(0.02 / dt) - 1, None, round(0.02 / dt))
        return np.abs(q[:, seen] - np.array([scene.truth(float(t)) for t in times[seen]]).T).max()

    def orders(scene, dt, **settings):
        names = FOUR if not settings else (MUJOCO,)
        whole, half = (errors(names, scene, x, **settings) for x in (dt, dt / 2))
        return np.log2(whole / half)

    tried = np.array(
        [orders(scenes.tumble(0.5), 1e-3 * dt) for dt in result.rng.uniform(0.5, 2.0, 3)]
        + [orders(scenes.arm(0.16), 1e-3)]
    )
    result.measure("lowest", tried.min(), 0.02)
    result.measure("highest", tried.max(), 0.02)
    rk4 = result.measure("rk4", orders(scenes.tumble(1.0), 0.02, scheme="RK4")[0], 0.02)
    from course.platforms import AS_SHIPPED, measures

    (bullet,) = simulators(PYBULLET)
    whole, half = (
        measures.position_error(bullet, scenes.tumble(1.0), dt, AS_SHIPPED) for dt in (1e-3, 5e-4)
    )
    ratio = result.measure("left", half / whole, 0.02)
    # What the sentence leaves out: a rod on its limit, and a joint that copies another.
    soft = [yields(scene, 5e-4) / yields(scene, 1e-3) for scene in (stop().scene, coupled())]
    result.statement = (
        "Tumble at three random steps and the arm, each against half the step; fair settings."
    )
    result.statement_holds(bool(np.all(np.abs(tried - 1.0) < 0.1)))
    result.correction_holds(
        bool(np.all(np.abs(tried - 1.0) < 0.1)), abs(rk4 - 4.0) < 0.2, ratio > 0.9, min(soft) > 0.8
    )


@claim(
    "Switch MuJoCo to RK4, and its error reliably gets smaller.",
    "On a chain of two links, after half a second at {ms:.0f} ms, it is more accurate by "
    "{smooth:.1f} orders of magnitude. On a braking block the contact forces change within a "
    "step, and RK4 was worse in {worse:.0f} of {n:.0f} runs, although it evaluates the forces "
    "four times per step. RK4 is also explicit. If the step exceeds {limit:.3f} divided by the "
    "fastest damping rate of the joints, the arm flies apart. MuJoCo's Euler treats damping "
    "implicitly and stays stable there.",
)
def rk4_and_contact(result):
    from course import kinematics
    from course.platforms import scenes

    def both(scene, dt):
        return [errors((MUJOCO,), scene, dt, scheme=name)[0] for name in ("Euler", "RK4")]

    ms = result.input("ms", 1.0)
    plain, better = both(scenes.chain(2, 0.5), 1e-3 * ms)
    smooth = result.measure("smooth", np.log10(plain / better), 0.1)
    n = int(result.input("n", 16))
    draws = [
        (scenes.brake(float(a), float(v)), 1e-3 * dt)
        for a, v, dt in result.rng.uniform((0.1, 1.0, 0.5), (0.7, 3.0, 2.0), (n, 3))
    ]
    touching = [both(scene, dt) for scene, dt in draws]
    worse = result.measure("worse", sum(b > a for a, b in touching), 0.4)
    free = [both(scenes.tumble(0.5), 1e-3 * dt) for dt in result.rng.uniform(0.5, 5.0, 8)]
    # Real poles of RK4 are stable up to here: 1 + z + z^2 / 2 + z^3 / 6 + z^4 / 24 = 1.
    (edge,) = (-x.real for x in np.roots([1 / 24, 1 / 6, 1 / 2, 1]) if abs(x.imag) < 1e-9)
    limit = result.measure("limit", edge)
    still = scenes.arm()
    assert still.chain is not None and still.q0 is not None
    mass = kinematics.mass_matrix(still.chain, still.q0)
    fastest = 1.0 / float(np.linalg.eigvalsh(mass)[0])

    chain = scenes.chain(2, 0.5)

    def against_itself(text, dt):
        """Return both errors of a chain from this URDF, MuJoCo at 10 us being the truth."""
        import mujoco

        def end(integrator, step):
            model = mujoco.MjModel.from_xml_string(text)
            model.opt.timestep, model.opt.integrator = step, integrator
            model.opt.gravity[:] = chain.gravity
            data = mujoco.MjData(model)
            data.qpos[:] = chain.q0
            mujoco.mj_step(model, data, round(0.5 / step))
            return data.qpos

        schemes = mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_RK4
        truth = end(schemes[1], 1e-5)
        return [np.abs(end(int(scheme), dt) - truth).max() for scheme in schemes]

    rubbing = [
        against_itself(chain.urdf.replace('friction="0"', f'friction="{x}"'), 1e-3)
        for x in (0.4, 1.0, 3.0)
    ]
    limited = chain.urdf.replace("continuous", "revolute")
    # Chosen to break it: nothing touches, but the first joint swings onto its limit.
    stopped = [
        against_itself(limited.replace("<limit ", f'<limit lower="-{x}" upper="{x}" '), dt)
        for x, dt in ((0.75, 1e-3), (0.75, 5e-4), (1.15, 1e-3), (1.15, 1.25e-3), (1.0, 1e-3))
    ]

    def damped(share, dt):
        """Return both errors of an arm whose fastest rate of damping is a share of the limit."""
        return both(scenes.arm(0.16, damping=share * limit / (dt * fastest)), dt)

    # Chosen to break it: nothing touches, but the joints are damped nearly and more than RK4 bears.
    below, beyond = (
        [damped(float(x), 1e-3 * float(dt)) for x, dt in result.rng.uniform(low, high, (4, 2))]
        for low, high in (((0.3, 0.5), (0.85, 2.0)), ((1.2, 0.5), (4.0, 2.0)))
    )
    result.statement = (
        "A chain; tumbles and damped arms at random steps; blocks at random speeds and headings."
    )
    result.statement_holds(
        worse == 0,
        only_if="nothing touches, no joint meets a limit, and the step is below RK4's limit for "
        "the damping",
        inside=[b < a for a, b in (*free, *below, *rubbing)],
        outside=[b < a for a, b in (*touching, *beyond, *stopped)],
    )
    result.correction_holds(
        smooth > 3,
        worse >= 2,
        any(b > a for a, b in stopped),
        all(b < 1e-3 * a for a, b in free),
        all(a < 0.1 < b for a, b in beyond),
    )


@claim(
    "On one thread, a newly built world repeats the run of an equal one bit by bit, in each of the "
    "four engines.",
    "It did in every run that we tried, also after a saved state was restored: in {n:.0f} runs the "
    "largest difference was {most:.0f}. Other machines, versions or numbers of threads may round "
    "differently.",
    needs=("Drake", "PyBullet"),
)
def fresh_worlds_repeat(result):
    from course.platforms import measures, scenes

    draws = result.rng.uniform((0.0, 1.0), (1.5, 3.0), (2, 2))
    cases = [(scenes.brake(float(a)), 1e-3 * dt) for a, dt in draws] + [(scenes.chain(3), 1e-3)]
    rows = [
        measures.repeatability(e, scene, dt, 40) for scene, dt in cases for e in simulators(*FOUR)
    ]
    result.measure("n", len(rows), 0.0)
    largest = result.measure("most", max(max(row.fresh, row.saved) for row in rows), 0.0)
    result.statement = "Two worlds built alike and a saved state, compared bit by bit."
    result.statement_holds(largest == 0.0)
    result.correction_holds(all(row.fresh == 0.0 == row.saved for row in rows))


@claim(
    "Resetting the world is as good as building it from scratch.",
    "A reset puts back what it knows of. PyBullet's resetBasePositionAndOrientation leaves the "
    "contacts that are cached: a block's second run ended {off:.1f} millionths [m, m/s] off. Moved "
    "far away in between, which drops the contacts, the block ran as before, bit by bit. MuJoCo's "
    "mj_resetData resets the whole state, but not a mass or friction that you changed in its "
    "model. An integrator of Drake that chooses its steps goes on with the last one: after the "
    "state was put back, a chain ended {chain_rad:.0e} rad off.",
    source="PyBullet Quickstart Guide, 2023: resetSimulation, saveState",
    needs=("Drake", "PyBullet"),
)
def reset_world(result):
    from course.oracles.pybullet import library
    from course.platforms import FAIR, measures, scenes

    def same(name, scene, dt):
        (engine,) = simulators(name)
        return measures.repeatability(engine, scene, dt, 200).reset

    cases = [
        (scenes.brake(float(a)), 1e-3 * dt)
        for a, dt in result.rng.uniform((0.0, 1.0), (1.5, 2.0), (3, 2))
    ]
    bullet = [same(PYBULLET, *case) for case in cases]
    others = [same(name, *case) for name in (MUJOCO, DRAKE) for case in cases]
    deviation = result.measure("off", 1e6 * same(PYBULLET, scenes.brake(0.0), 1e-3), 0.5)
    (engine,) = simulators(PYBULLET)
    run = engine.build(scenes.brake(0.0), 1e-3)
    run.run(200)
    first = run.state()
    library().resetBasePositionAndOrientation(
        run.bodies[0], [100.0, 0.0, 50.0], [0.0, 0.0, 0.0, 1.0], physicsClientId=run.client
    )
    library().performCollisionDetection(physicsClientId=run.client)
    run.reset()
    run.run(200)

    def heavier(scene, dt):
        """Return whether MuJoCo repeats a run after a body became heavier and the reset call."""
        (mujoco,) = simulators(MUJOCO)
        world = mujoco.build(scene, dt)
        world.run(200)
        end = world.state()
        world.model.body_mass[1] *= 1.2
        world.reset()
        world.run(200)
        return world.state().same(end)

    tower, chain = (scenes.tower(3), 2e-3), (scenes.chain(3), 1e-2)
    others += [same(name, *case) for name in (MUJOCO, DRAKE) for case in (tower, chain)]
    chosen = FAIR.using(scheme="runge_kutta3", accuracy=1e-3)
    off = measures.repeatability(simulators(DRAKE)[0], *chain, 200, chosen).reset
    result.measure("chain_rad", off, 0.5)
    changed = [heavier(*case) for case in cases]
    result.statement = "Braking blocks, 200 steps, then the same after a reset, bit by bit."
    result.statement_holds(
        max(bullet) == 0.0,
        only_if="the reset covers all that the engine and its integrator store between steps, as "
        "in MuJoCo and in Drake's discrete plant, and all that the program changed in the model",
        inside=[x == 0.0 for x in others],
        # Chosen to break it: a mass that was changed, and an integrator that chooses its steps.
        outside=[x == 0.0 for x in bullet] + changed + [off == 0.0],
        cases=True,
    )
    result.correction_holds(
        deviation > 0.0, max(others) == 0.0, run.state().same(first), not any(changed), off > 1e-6
    )
