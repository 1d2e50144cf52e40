"""Claims of chapter 3: hello worlds, actuators, readers of models, and a controller that moves."""

import numpy as np

from course.derivations import Symbol, claim
from course.derivations.platforms.same import DRAKE, MUJOCO, PYBULLET, simulators

SYMBOLS = {
    "kp": Symbol("gain of the servo [N m/rad]", 10.0, 1000.0),
    "m": Symbol("mass [kg]"),
    "g": Symbol("gravity [m/s^2]"),
    "d": Symbol("from the joint to the centre of mass [m]"),
}


def compiled(joint, more="", links=1):
    """Return (model, data) of upright links of 0.3 m, each on a hinge with these attributes."""
    import mujoco

    body = ""
    for i in reversed(range(links)):
        body = (
            f'<body pos="0 0 {0.3 * (i > 0)}"><joint name="j{i}" axis="0 1 0" {joint}/>'
            f'<geom type="capsule" size=".03" fromto="0 0 0 0 0 .3" mass="1"/>{body}</body>'
        )
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option><flag autoreset="disable" contact="disable"/></option>'
        f"<worldbody>{body}</worldbody><actuator>{more}</actuator></mujoco>"
    )
    return model, mujoco.MjData(model)


@claim(
    "The hello world ran and printed angles, so the arm moves as an arm does.",
    "Two links without damping, let go upright under gravity, wound up under constant torques: a "
    "joint got {turns:.1f} turns from its start within {seconds:.0f} s. Repeated with half the "
    "step, the second joint ended {apart:.0f} degrees away from where it ended before. With a "
    "damping of {damping:.1f} N m "
    "s/rad and limits the arm fell onto a stop at {calm:.2f} turns, and half the step changed the "
    "end by {near:.2f} degrees.",
)
def hello_world_winds(result):
    import mujoco

    seconds, damping = result.input("seconds", 2.0), result.input("damping", 0.5)
    motors = '<motor joint="j0"/><motor joint="j1"/>'

    def moved(joint, torques=(0.5, -0.3), dt=0.002):
        """Return (Most turns of a joint from its start, the second joint at the end)."""
        model, data = compiled(joint, motors, links=2)
        model.opt.timestep = dt
        data.ctrl[:] = torques
        largest = 0.0
        for _ in range(round(seconds / 0.01)):
            mujoco.mj_step(model, data, round(0.01 / dt))
            largest = max(largest, np.abs(data.qpos).max())
        return largest / (2.0 * np.pi), np.degrees(data.qpos[1])

    limited = f'damping="{damping}" range="-150 150"'
    (largest, free), (little, held) = moved(""), moved(limited)
    turns = result.measure("turns", largest, 0.02)
    result.measure("calm", little, 0.02)
    difference = result.measure("apart", abs(moved("", dt=0.001)[1] - free), 0.1)
    near = result.measure("near", abs(moved(limited, dt=0.001)[1] - held), 0.2)
    draws = result.rng.uniform((0.2, -0.5), (0.7, -0.2), (8, 2))
    result.statement = "MuJoCo at 2 and at 1 ms; the same at eight random pairs of torques."
    result.statement_holds(turns < 0.5)
    result.correction_holds(
        turns > 2.0,
        all(moved("", x)[0] > 1.0 for x in draws),
        difference > 10.0 * near,
        all(moved(limited, x)[0] < 0.5 for x in draws),
    )


@claim(
    "A joint limit in a MuJoCo model is a wall at which the joint stops.",
    "By default it is a critically damped spring with a time constant T of {ms:.0f} ms. A joint "
    "that arrives with the speed v passes it by about v T / e: a falling rod by {past:.0f} mrad, "
    "and it came to rest {rest:.2f} mrad beyond. A quarter of this time constant (solreflimit) "
    "gives a quarter of the overshoot, at steps of up to T/8.",
    source="MuJoCo 4.0 manual, 2026, Modeling, Solver parameters, solref",
)
def limit_is_a_wall(result):
    import mujoco

    from course.platforms.joint_scenes import stop

    ms = result.input("ms", 20.0)

    def fallen(start, time, dt=1e-4):
        """Return how far the rod passed its limit, where it rests beyond it, and v T / e."""
        problem = stop(start)
        model = mujoco.MjModel.from_xml_string(problem.scene.urdf)
        model.opt.timestep, model.opt.gravity[:] = dt, problem.scene.gravity
        default = model.jnt_solref[0, 0]
        model.jnt_solref[0, 0] = 1e-3 * time
        data, past = mujoco.MjData(model), 0.0
        data.qpos[0] = start
        for _ in range(round(1.0 / dt)):
            mujoco.mj_step(model, data)
            past = max(past, problem.limit - data.qpos[0])
        rest = problem.limit - data.qpos[0]
        return past, rest, problem.speed * 1e-3 * time / np.e, 1e3 * default

    past, rest, _, default = fallen(0.0, ms)
    result.measure("past", 1e3 * past, 0.05)
    result.measure("rest", 1e3 * rest, 0.05)
    starts = result.rng.uniform(-0.5, 0.8, 8)
    soft, stiff = ([fallen(x, time) for x in starts] for time in (ms, 0.25 * ms))
    result.statement = "A rod of 0.4 m that falls on its limit, from eight random angles."
    result.statement_holds(past < 1e-3)
    result.correction_holds(
        default == ms,
        all(abs(each[0] / each[2] - 1.0) < 0.1 for each in soft + stiff),
        all(0.2 < b[0] / a[0] < 0.3 for a, b in zip(soft, stiff, strict=True)),
        rest > 1e-4,
    )


@claim(
    "By default, MuJoCo applies the command of an actuator to a hinge as a torque in newton "
    "metres.",
    "`motor` does, and so does a plain `general`: a command of {ctrl:.1f} gave {torque:.1f} N m, "
    "with the default gear of 1. With `position`, the command is an angle, and the default spring "
    "has {kp:.0f} N m/rad. A joint has only the actuators that the file names.",
    source="MuJoCo 4.0 manual, 2026, XML reference, actuator/general, motor, position",
)
def motor_is_torque(result):
    import mujoco

    def torque(kind, ctrl, angle=0.0):
        model, data = compiled("", f'<{kind} joint="j0"/>')
        data.ctrl[:], data.qpos[:] = ctrl, angle
        mujoco.mj_forward(model, data)
        return float(data.qfrc_actuator[0])

    ctrl = result.input("ctrl", 0.7)
    result.measure("torque", torque("general", ctrl))
    kp = result.measure("kp", torque("position", 1.0))
    draws = result.rng.uniform(-2.0, 2.0, (8, 2))
    direct = [
        abs(torque(kind, x, y) - x) < 1e-12 for x, y in draws for kind in ("motor", "general")
    ]
    result.statement = "What MuJoCo says that it applies, at random controls and angles."
    result.statement_holds(all(direct))
    result.correction_holds(
        all(abs(torque("position", x, y) - kp * (x - y)) < 1e-12 for x, y in draws),
        compiled("")[0].nu == 0,
    )


@claim(
    "Add a damping of 0.1 to the joints, and a model is closer to its robot.",
    "Against a robot of {much:.1f} N m s/rad it takes the error of a swing to {better:.0%}, "
    "against one of {little:.2f} to {worse:.0%}. So measure the value.",
)
def damping_realism(result):
    import mujoco

    added = result.input("added", 0.1)
    amount, little = result.input("much", 0.2), result.input("little", 0.02)

    def swing(damping, start=0.5, dry=0.0):
        model, data = compiled(f'damping="{damping}" frictionloss="{dry}"')
        data.qpos[0], angles = np.pi - start, []
        for _ in range(100):
            mujoco.mj_step(model, data, 10)
            angles.append(float(data.qpos[0]))
        return np.array(angles)

    def remaining(robot, added, start=0.5, dry=0.0):
        """Return the error of the model with the damping over that of the one without."""
        true = swing(robot, start, dry)
        with_it, without = (swing(x, start) - true for x in (added, 0.0))
        return float(np.linalg.norm(with_it) / np.linalg.norm(without))

    better = result.measure("better", remaining(amount, added), 0.02)
    worse = result.measure("worse", remaining(little, added), 0.02)
    robots = result.rng.uniform(0.002, 0.01, 8)
    inside, outside = (
        [remaining(x, x * share) < 1.0 for x, share in zip(robots, shares, strict=True)]
        for shares in (result.rng.uniform(0.1, 1.9, 8), result.rng.uniform(2.2, 4.0, 8))
    )
    # Chosen to break it: strong dampers, a start far from rest, and a robot with dry friction too.
    inside += [
        remaining(r, r * share, start, dry) < 1.0
        for r in (0.05, 0.5, 5.0)
        for share in (0.1, 1.9)
        for start, dry in ((0.5, 0.0), (2.5, 0.0), (0.5, 0.02))
    ]
    result.statement = "Two seconds of a hanging link that was let go at half a radian, or at 2.5."
    result.statement_holds(
        worse < 1.0,
        only_if="the added damping is less than twice the robot's own, or both are large",
        inside=inside,
        outside=outside,
    )
    result.correction_holds(better < 1.0, worse > 1.0)


@claim(
    "Real joints have position servos, so MuJoCo's default position actuator models them well.",
    "The model gets a spring, not the robot's servo. At small angles, it lets a horizontal "
    "link droop by {formula}: by {droop:.2f} degrees with a gain of {stiff:.0f}. With the default, "
    "{kp:.0f}, the link drooped by {default:.0f}.",
    ask=(
        "A servo of gain kp without an integral holds a link out level, mass m with its centre at "
        "d. How low does it hang, small angles?",
        "e = m*g*d/kp",
        {
            "kp/(m*g*d)": "A stiffer servo holds it higher.",
            "m*g/kp": "A torque has an arm: d is missing.",
            "m*g*d/(2*kp)": "That takes d for the length; here it reaches to the centre.",
            "sqrt(m*g*d/kp)": "Torques balance, not energies.",
        },
    ),
    source="MuJoCo 4.0 manual, 2026, XML reference, actuator/position",
)
def servo_droops(result):
    import mujoco
    import sympy

    kp, m, g, d, e = sympy.symbols("kp m g d e", positive=True)
    result.formula = sympy.solve(sympy.Eq(kp * e, m * g * d), e)[0]

    def droop(gain=""):
        """Return (Angle below level [rad], gain) at rest."""
        model, data = compiled('damping="2"', f'<position joint="j0" {gain}/>')
        data.ctrl[:] = data.qpos[:] = 0.5 * np.pi
        mujoco.mj_step(model, data, 5000)
        return data.qpos[0] - 0.5 * np.pi, model.actuator_gainprm[0, 0]

    stiff = result.input("stiff", 200.0)
    (low, plain), (little, _) = droop(), droop(f'kp="{stiff}"')
    result.measure("kp", plain)
    result.measure("default", np.degrees(low), 0.01)
    result.measure("droop", np.degrees(little), 0.01)
    gains = result.rng.uniform(60.0, 400.0, 4)
    law = [float(result.formula.subs({kp: k, m: 1, g: 9.81, d: 0.15})) for k in gains]
    result.statement = "A link of 1 kg whose centre is 0.15 m out, after 10 s."
    result.statement_holds(bool(np.degrees(low) < 1.0))
    result.correction_holds(
        *(
            bool(abs(droop(f'kp="{k}"')[0] / x - 1.0) < 0.01)
            for k, x in zip(gains, law, strict=True)
        ),
        bool(low > 0.5),
    )


@claim(
    "PyBullet is the light one and Drake the heavy one.",
    "By disk PyBullet is the heaviest, {bullet:.0f} MB, {data:.0f} of them example data; Drake "
    "with Mosek, which it asks for, takes {drake:.0f} and MuJoCo {mujoco:.0f}. Unpacked sizes of "
    "these wheels; other versions have others.",
    needs=("Drake", "PyBullet"),
)
def lightest_install(result):
    from importlib.metadata import files

    from course.oracles.installs import size_of

    simulators(MUJOCO, DRAKE, PYBULLET)
    bullet = result.measure("bullet", size_of(PYBULLET), 0.3)
    drake = result.measure("drake", size_of(DRAKE), 0.3)
    mujoco = result.measure("mujoco", size_of(MUJOCO), 0.4)
    examples = [x.size or 0 for x in files("pybullet") or [] if "pybullet_data" in str(x)]
    data = result.measure("data", sum(examples) / 1e6, 0.3)
    result.statement = "Sizes in the packages' own metadata."
    result.statement_holds(bullet < min(drake, mujoco))
    result.correction_holds(bullet > drake > mujoco, data > 0.3 * bullet)


def read_by(reader, texts):
    """Return a reader's verdict on each model.

    It runs in this process, without the models that crash one.
    """
    import io
    import logging
    from contextlib import redirect_stderr, redirect_stdout

    import mujoco

    from course.oracles.quiet import quiet
    from course.oracles.readers import READERS
    from course.platforms.models import GOOD, Reading, verdict

    find, read = READERS[reader]
    find()

    def reading(text):
        """Return what it said, be it by C, by Python or by a log; its error; and the facts."""
        words, facts, printed = "", None, io.StringIO()
        log = logging.StreamHandler(printed)
        logging.getLogger().addHandler(log)
        with quiet() as output, redirect_stdout(printed), redirect_stderr(printed):
            try:
                facts = read(text)
            except (Exception, SystemExit) as error:
                words = f"{type(error).__name__}: {error}"
        logging.getLogger().removeHandler(log)
        return words, (output[0] + printed.getvalue()).strip(), facts

    usual = reading(GOOD)[1]
    result = {}
    for model in texts:
        words, message, facts = reading(model.text)
        result[model.name] = verdict(
            model, Reading(words, False, message * (message != usual), facts)
        )
    mujoco.set_mju_user_warning(None)
    return result


@claim(
    "A model that loads without a word is one that can exist.",
    "We wrote {n:.0f} URDF files of moving arms that can't exist. PyBullet loaded {bullet:.0f} of "
    "them without a message, one of them with a mass of NaN. Pinocchio loaded {pinocchio:.0f}, "
    "MuJoCo {mujoco:.0f} and Drake {drake:.0f}. Chapter 4's reader refused {refused:.0f}.",
    source="URDF, ROS wiki, XML specification, 2022",
    needs=("Drake", "PyBullet"),
)
def loaded_is_not_sound(result):
    from course.platforms.models import MODELS

    texts = [model for model in MODELS if model.kind == "impossible"]
    n = result.measure("n", len(texts) and sum(model.kind == "impossible" for model in MODELS), 0.0)
    simulators(DRAKE, PYBULLET)
    report = {
        name: read_by(name, texts) for name in ("chapter 4", "Pinocchio", MUJOCO, DRAKE, PYBULLET)
    }
    silent = {
        name: sum(v in ("swallowed", "repaired") for v in rows.values())
        for name, rows in report.items()
    }
    bullet = result.measure("bullet", silent[PYBULLET], 0.0)
    result.measure("pinocchio", silent["Pinocchio"], 0.4)
    mujoco = result.measure("mujoco", silent[MUJOCO], 0.4)
    drake = result.measure("drake", silent[DRAKE], 0.4)
    rejected = result.measure("refused", list(report["chapter 4"].values()).count("refused"), 0.0)
    result.statement = "Each reader with each text. A silent repair counts as taken without a word."
    result.statement_holds(max(bullet, mujoco, drake) == 0)
    result.correction_holds(
        rejected == n,
        report[PYBULLET]["NaN mass"] == "swallowed",
        bullet > n / 2,
        mujoco < n / 2,
        report[MUJOCO]["NaN mass"] == "refused",
    )


@claim(
    "Damping and dry friction that stand in a URDF act in every simulator.",
    "Damping was {bullet_damping} by PyBullet, {drake_damping} by Drake and {mujoco_damping} by "
    "MuJoCo. Dry friction was {bullet} by PyBullet, {drake} about by Drake, which leaves it out, "
    "and {mujoco} by MuJoCo.",
    source="Isaac Sim issue 841, 2026, on an importer that lost both; Drake 1.51, 2026, URDF "
    "support, joint dynamics",
    needs=("Drake", "PyBullet"),
)
def friction_of_a_urdf(result):
    from course.platforms.models import MODELS

    simulators(DRAKE, PYBULLET)
    texts = [model for model in MODELS if model.name in ("friction", "damping")]
    rows = {name: read_by(name, texts) for name in (MUJOCO, DRAKE, PYBULLET)}
    for name, short in ((MUJOCO, "mujoco"), (DRAKE, "drake"), (PYBULLET, "bullet")):
        result.measure(f"{short}_damping", rows[name]["damping"])
        result.measure(short, rows[name]["friction"])
    result.statement = "A two-link arm with both in its elbow, read by each."
    result.statement_holds(all(set(row.values()) == {"kept"} for row in rows.values()))
    result.correction_holds(
        rows[PYBULLET]["friction"] == "swallowed",
        rows[DRAKE]["friction"] == "warned",
        set(rows[MUJOCO].values()) == {"kept"},
    )


@claim(
    "A controller that was tuned in one simulator works in another.",
    "Computed torque, tuned on the course's own arm, brought the tip to within {fair:.3f} mm in "
    "MuJoCo, Drake and PyBullet with fair settings. PyBullet as shipped stopped {shipped:.0f} mm "
    "off: its motors hold the joints. And where MuJoCo lacks {lost:.3f} N m s/rad of the damping "
    "that the controller counts on, the arm flies apart.",
    needs=("Drake", "PyBullet"),
)
def controller_moves(result):
    from course import kinematics
    from course.platforms import AS_SHIPPED, FAIR, measures, scenes

    every = simulators(MUJOCO, DRAKE, PYBULLET)
    fair = [measures.reach(engine, 2e-3, FAIR) for engine in every]
    shipped = [measures.reach(engine, 2e-3, AS_SHIPPED) for engine in every]
    alone = measures.reach(every[2], 2e-3, AS_SHIPPED.using(but=("motors",)))
    result.measure("fair", 1e3 * max(one.error for one in fair), 0.3)
    error = result.measure("shipped", 1e3 * shipped[2].error, 0.1)
    # Chosen to break it: dampings and steps by chance, and then damping that only the model has,
    # or that only the simulator has, or a step that is long for the controller's pace.
    chain = scenes.arm().chain
    assert chain is not None
    mass = kinematics.mass_matrix(chain, np.array(measures.GOAL))
    limit = 2.0 * measures.PACE * float(np.linalg.eigvalsh(mass)[0])
    lost = result.measure("lost", 2.0 * limit)
    known = [
        measures.reach(every[0], 1e-3 * float(dt), FAIR, damping=float(d))
        for d, dt in result.rng.uniform((0.0, 1.0), (2.0, 10.0), (8, 2))
    ]
    lacking = [
        measures.reach(every[0], 1e-3, FAIR, damping=0.0, modelled=float(x) * limit)
        for x in result.rng.uniform(1.5, 3.0, 4)
    ]
    # Half of what the controller can bear to lack, and a little that the model does not know.
    nearly = [
        measures.reach(every[0], 1e-3, FAIR, damping=acts, modelled=believed)
        for acts, believed in ((0.0, 0.5 * limit), (0.05, 0.0))
    ]
    added = [measures.reach(every[0], 1e-3, FAIR, damping=x, modelled=0.0) for x in (5.0, 20.0)]
    long = [measures.reach(every[0], dt, FAIR) for dt in (0.11, 0.15)]
    result.statement = "A reach of the 7-R arm in 1.5 s: within 5 mm, slower than 5 cm/s."
    result.statement_holds(
        all(one.success for one in shipped),
        only_if="what acts is nearly what the model knows, and the step is short for the "
        "controller's pace",
        inside=[one.success for one in (*fair, *known, *nearly)],
        outside=[one.success for one in (*shipped, *lacking, *added, *long)],
    )
    result.correction_holds(
        error > 50.0,
        alone.error < 0.5 * shipped[2].error,
        not measures.reach(every[0], 1e-3, FAIR, damping=0.0, modelled=lost).success,
        not any(one.success for one in (*lacking, *added, *long)),
    )
