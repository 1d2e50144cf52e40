"""Claims of chapter 6: what MuJoCo's loops, servos, friction and contacts hide of a real loop."""

import numpy as np

from course.derivations import claim


@claim(
    "Gains that are stable in the simulator at the robot's rate are stable on the robot.",
    "The simulator's step changes the hold. Semi-implicit Euler with n steps per sample dt "
    "delays the torque by (1 - 1/n) dt/2, the robot by dt/2. At {rate_hz:.0f} Hz and without "
    "other delays, the robot's largest P gain is {robot:.0f} N m/rad. MuJoCo gives {one:.0f} "
    "with one step per sample and {ten:.0f} with ten. Both are the limits of its own update "
    "matrix, to {same:.0e}.",
)
def simulator_hold(result):
    from course.charts.control import limits
    from course.control import sampled
    from course.oracles.mujoco.joint import MotorJoint

    inertia, damping, dt = 0.5, 0.5, 1 / result.input("rate_hz", 1000)

    def mujoco(steps):
        joint = MotorJoint(inertia, damping, dt, substeps=steps)
        return limits.largest(lambda k: limits.mujoco_growth(joint, lambda q, _: -k * q), 1.0, 1e8)

    def matrix(steps):
        plant = sampled.stepped(inertia, damping, dt, steps)
        return limits.largest(lambda k: limits.loop_growth(plant, k), 1.0, 1e8)

    robot = sampled.ultimate_gain(*sampled.joint_system(inertia, damping), dt)[0]
    read = {n: mujoco(n) for n in (1, 10, 50)}
    error = max(abs(read[n] / matrix(n) - 1) for n in read)
    result.measure("robot", robot)
    result.measure("one", read[1], 1e-4)
    result.measure("ten", read[10], 1e-4)
    result.measure("same", error + 1e-6, 0.5)
    # Semi-implicit steps lead by half of their own step: (1 - 1/n) dt / 2 is left of the hold.
    theory = [sampled.delay_limit(inertia, damping, (dt - dt / n) / 2)[0] for n in (10, 50)]
    result.statement = "Limits by bisection of the loop's growth, MuJoCo's joint and the matrix."
    result.statement_holds(abs(read[1] / robot - 1) < 0.1)
    result.correction_holds(
        error < 1e-5,
        read[1] > 1000 * robot,
        max(abs(read[n] / t - 1) for n, t in zip((10, 50), theory, strict=True)) < 1e-3,
        abs(read[50] / robot - 1) < 0.03,
    )


@claim(
    "MuJoCo's position servo shows how stiff a PD loop may be at that rate.",
    "The servo is computed inside the physics step. It is not a sampled loop. On an inertia, "
    "with kp in units of J/dt^2 and kv in units of J/dt, it is stable below {at_rest:.0f} - "
    "2 kv with Euler, below {at_rest:.0f} + 2 kv with implicitfast, and at any gain with the "
    "integrator called discrete. A sampled PD loop is stable up to kp = 2 kd, and only while "
    "kd is below {edge:.0f}.",
)
def servo_is_a_sampled_loop(result):
    from course.charts.control import limits
    from course.control import sampled

    def limit(integrator, kv):
        return limits.largest(lambda kp: limits.servo_growth(integrator, kp, kv), 1e-6, 1e5)

    # Random velocity gains in units of J / dt: the law must hold along the edge.
    kvs = result.rng.uniform(0, 1.8, 6)
    euler, fast, discrete = (
        np.array([limit(name, kv) for kv in kvs]) for name in ("Euler", "implicitfast", "discrete")
    )
    sampled_limit = np.array([sampled.pd_limit(kv, 1, 1) for kv in kvs])
    result.measure("at_rest", limit("Euler", 0.0), 1e-4)
    result.measure(
        "edge", max(kd for kd in np.linspace(0, 3, 301) if sampled.pd_limit(kd, 1, 1)), 0.01
    )
    result.statement = "Growth per step of MuJoCo's servo at drawn kv; one step a sample."
    result.statement_holds(np.all(np.abs(fast / sampled_limit - 1) < 0.1))
    result.correction_holds(
        np.allclose(euler, 4 - 2 * kvs, rtol=1e-4),
        np.allclose(fast, 4 + 2 * kvs, rtol=1e-4),
        np.all(discrete >= 1e5),
    )


@claim(
    "The attribute delay of MuJoCo's position actuator is the delay of its feedback loop.",
    "It delays the set-point only. With {delay_ms:.0f} ms and kp = {kp:g} the servo settles "
    "to within {servo_rad:.0e} rad of its target. A motor with the same delay and the same "
    "gains computed outside has reached {motor_rad:.0e} rad after {seconds:.0f} s: this loop "
    "is unstable, as its matrix says.",
)
def delay_delays_the_loop(result):
    from course.control import sampled
    from course.oracles.mujoco.joint import MotorJoint

    dt, seconds = 0.005, result.input("seconds", 3)
    delay, kp, kd = result.input("delay_ms", 50) / 1000, result.input("kp", 30), 0.5
    late = f'delay="{delay}" nsample="60"'

    def joint(drive):
        return MotorJoint(0.05, 0.1, dt, substeps=5, actuator=drive)

    # The same delay attribute on a servo and on a motor with the loop outside.
    servo = joint(f'<position kp="{kp}" kv="{kd}" {late} {{}}/>')
    angles = [servo.step(1.0) for _ in range(round(seconds / dt))]
    motor, swings = joint(f"<motor {late} {{}}/>"), []
    for _ in range(round(seconds / dt)):
        swings.append(motor.step(kp * (1.0 - motor.q) - kd * motor.v))
    plant = sampled.held(*sampled.joint_system(0.05, 0.1), dt, delay)
    law = sampled.pid_law(kp, 0, kd, dt=dt, rate="exact")
    result.measure("servo_rad", abs(angles[-1] - 1), 0.1)
    result.measure("motor_rad", np.max(np.abs(swings)), 0.1)
    result.statement = "A step of 1 rad through MuJoCo's servo and through a late motor."
    result.statement_holds(np.max(np.abs(angles)) > 10)
    result.correction_holds(
        abs(angles[-1] - 1) < 1e-3,
        np.max(np.abs(swings)) > 1e3,
        sampled.growth(sampled.loop_matrix(plant, law)) > 1.01,
    )


@claim(
    "MuJoCo's pid actuator prevents windup by itself, without further settings.",
    "A jam of {jam_s:.0f} s leaves {bare_rad:.2f} rad of overshoot, as with no anti-windup at "
    "all. The setting imax limits the I term to a fixed range. With imax {tight:g}, little more "
    "than the load needs, the overshoot is {clamped_rad:.3f} rad, and with {wide:g} it is "
    "{wide_rad:.2f} rad. Conditional integration needs no range and leaves "
    "{conditional_rad:.3f} rad.",
)
def pid_actuator_guards(result):
    from course.control import Actuator, Encoder, Gains, Joint, run_joint
    from course.oracles.mujoco.joint import MotorJoint

    dt, jam = 0.002, result.input("jam_s", 3)
    # Blocked in the first seconds: the integral winds up meanwhile.
    held = np.arange(5000) < round(jam / dt)

    def mujoco(extra=""):
        servo = f'<pid kp="4" ki="6" kv="0.5" forcerange="-2 2" {extra} {{}}/>'
        joint = MotorJoint(0.05, 0.2, dt, -0.3, substeps=10, actuator=servo)
        return max(joint.step(1.0, bool(stuck)) for stuck in held) - 1

    def ours(windup):
        gains = Gains(4, 6, 0.5, 0.01, -2, 2, windup=windup)
        parts = Joint(0.05, 0.2, -0.3), Actuator(), Encoder()
        return np.max(run_joint(*parts, gains, 1.0, dt, 10.0, blocked=held).q) - 1

    ranges = result.input("tight", 0.06), result.input("wide", 1.0)
    bare, clamped, wide = mujoco(), *(mujoco(f'imax="{x}"') for x in ranges)
    result.measure("bare_rad", bare, 0.01)
    result.measure("clamped_rad", clamped, 0.05)
    result.measure("wide_rad", wide, 0.01)
    result.measure("conditional_rad", ours("conditional"), 0.01)
    result.statement = "A step of 1 rad, the joint blocked at first, MuJoCo's actuator and ours."
    result.statement_holds(bare < 0.2)
    result.correction_holds(
        abs(bare - ours("none")) < 0.1, clamped < 0.1 < wide, ours("conditional") < 0.1
    )


@claim(
    "In MuJoCo, a joint with frictionloss stays where it is below that torque.",
    "It creeps. Under {share:.0%} of its friction an inertia of {inertia:g} kg m^2 moves at "
    "{creep_mrad_s:.2f} mrad/s with the default settings, and a lighter one faster. The "
    "largest constraint impedance reduces this to {stiff_mrad_s:.5f} mrad/s. Under exact "
    "Coulomb friction the joint stays.",
)
def friction_loss_holds(result):
    from course.control import Actuator, Encoder, Gains, Joint, run_joint
    from course.oracles.mujoco.joint import MotorJoint

    dt, share, inertia = 0.005, result.input("share", 0.8), result.input("inertia", 0.2)

    def creep(inertia, defaults):
        """Return the speed over the second half of two seconds [rad/s]."""
        joint = MotorJoint(inertia, 0.1, dt, substeps=5, friction=0.2, defaults=defaults)
        # Second half of the run, after the onset.
        q = [joint.step(share * 0.2) for _ in range(400)]
        return q[-1] - q[200]

    here = creep(inertia, True)
    exact = run_joint(
        Joint(inertia, 0.1, share * 0.2, 0.2), Actuator(), Encoder(), Gains(0.0), 0.0, dt, 2.0
    )
    result.measure("creep_mrad_s", 1000 * here, 0.01)
    result.measure("stiff_mrad_s", 1000 * creep(inertia, False), 0.05)
    result.statement = "MuJoCo's hinge under a constant torque, over a second."
    result.statement_holds(here < 1e-6)
    result.correction_holds(
        here > 1e-4,
        creep(inertia / 10, True) > 5 * here,
        creep(inertia, False) < here / 100,
        np.max(np.abs(exact.q)) < 1e-12,
    )


@claim(
    "A force loop that is stable on a simulated contact is stable on that wall.",
    "In a MuJoCo contact with constraint impedance d (from solimp), a mass m moves like m/(1 "
    "- d), and the fraction d of the command goes straight to the contact force. If ke (D + dt/2) "
    "(1 - d)/(2 d) < b, with the arm's friction b, a loop is stable there up to a gain of "
    "about 1/d, whatever the wall. At {ke:.0e} N/m with {delay_ms:.0f} ms of delay the "
    "wall's limit is {wall:.3f}. MuJoCo gives {spring:.3f} for a spring, {soft:.3f} for a "
    "contact with d = {soft_d:g}, and {default:.2f} with the default of {default_d:g}: "
    "{hopeful:.0f} times too high.",
)
def contact_is_the_wall(result):
    from course.charts.control import touch

    ke, delay = result.input("ke", 1e5), result.input("delay_ms", 2) / 1000
    soft_d, default_d = result.input("soft_d", 0.02), result.input("default_d", 0.9)
    exact = touch.force_edge(ke, delay)
    spring = touch.force_edge_mujoco(ke, delay, "spring", 10)
    soft, default = (
        touch.force_edge_mujoco(ke, delay, "contact", 10, d) for d in (soft_d, default_d)
    )
    result.measure("wall", exact)
    result.measure("spring", spring, 0.01)
    result.measure("soft", soft, 0.01)
    result.measure("default", default, 0.01)
    result.measure("hopeful", default / exact, 0.02)
    friction, late = touch.ARM.damping, delay + touch.DT / 2
    tried = [
        (k, D, touch.force_edge_mujoco(k, D, "contact", 1, default_d))
        for k, D in ((1e4, 0.002), (1e5, 0.001), (1e6, 0.004))
    ]
    free = [
        k * (D + touch.DT / 2) * (1 - default_d) / default_d / 2 < friction for k, D, _ in tried
    ]
    result.statement = "Gain limits of P on the force, by bisection of runs in MuJoCo."
    result.statement_holds(abs(default / exact - 1) < 0.1)
    result.correction_holds(
        abs(spring / exact - 1) < 0.05,
        abs(soft / exact - 1) < 0.1,
        all(
            (abs(edge * default_d - 1) < 0.05) == ok
            for (_, _, edge), ok in zip(tried, free, strict=True)
        ),
        ke * late * (1 - default_d) / default_d / 2 < friction,
        abs(default * default_d - 1) < 0.05,
    )
