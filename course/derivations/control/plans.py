"""Claims of chapter 6: plans within limits, plans by trying, and what a log tells."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "s": Symbol("noise of an angle, one standard deviation [rad]"),
    "dt": Symbol("sample time [s]"),
}


@claim(
    "MPC achieves a lower cost than LQR with a clipped command.",
    "A mass with a weak motor shows when. From rest {far_m:g} m from the target it has to speed "
    "up at one limit and to brake at the other. Only a plan sees the second one coming, and LQR "
    "costs {gain:.2f} times as much as MPC. If the limit is active in one stretch from the start, "
    "or never, both cost the same to {same:.0e}. MPC plans {ahead:.0f} samples each time. For "
    "other systems one stretch is not enough: for an oscillator that turns by {turn_deg:.0f} "
    "degrees per sample, LQR costs up to {swing:.2%} more.",
)
def mpc_beats_clipping(result):
    from itertools import pairwise

    from course import control
    from course.charts.control import plans

    far, ahead = result.input("far_m", 4.0), result.input("ahead", 40)

    def saved(x):
        """Return what MPC saves, and whether the clipped law saturates again after it was free."""
        gain = plans.cost(x, at_most=500)[0] / plans.cost(x, ahead, at_most=500)[0] - 1
        met = []
        for _ in range(500):
            u = -plans.K @ x
            met.append(np.sign(u[0]) * (abs(u[0]) > plans.WEAK))
            x = plans.A @ x + plans.B @ np.clip(u, -plans.WEAK, plans.WEAK)
        return gain, any(b not in (0, a) for a, b in pairwise(met))

    starts = 10 ** result.rng.uniform(-1.7, 0.2, (30, 1)) * result.rng.normal(size=(30, 2))
    # Chosen to break it: from the last start the clipped law brakes too late.
    draws = [saved(x) for x in [*starts, np.array([-0.14, 0.3])]]
    coming, less = ([s for s, late in draws if late == desired] for desired in (True, False))
    result.measure("gain", 1 + saved(np.array([far, 0.0]))[0], 1e-3)

    # Chosen to break it: an oscillator of which K B < 0, where a first command pushes the next one
    # the other way.
    turn = np.radians(result.input("turn_deg", 120.0))
    A = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    B, Q, R = np.array([[0.0], [1.0]]), np.eye(2), 0.1 * np.eye(1)
    K = control.lqr(A, B, Q, R).K
    plan = control.horizon(A, B, Q, R, ahead)

    def swing(x, planned):
        """Return the cost of an oscillator with a command of at most 1, and its limits met."""
        total, last, met = 0.0, None, []
        for _ in range(80):
            free = float((-K @ x)[0])
            met.append(np.sign(free) * (abs(free) > 1.0))
            u = np.clip([free], -1.0, 1.0)
            if planned:
                last = control.mpc(plan, x, 1.0, last)
                u = last[0]
            total += float(x @ Q @ x + u @ R @ u)
            x = A @ x + B @ u
        return total, met

    extra = []  # what the clipped law costs more where its limit is met in one stretch from 0 on
    along, across = -K[0] / (K[0] @ K[0]), np.array([-K[0, 1], K[0, 0]])
    for c in np.linspace(-3.0, 3.0, 61):
        # The first command is just beyond the limit; the second one depends on c.
        x = 1.01 * along + c * across
        clipped, met = swing(x, False)
        if met[0] and not any(b not in (0, a) for a, b in pairwise(met)):
            extra.append(clipped / swing(x, True)[0] - 1)
    result.measure("swing", max(extra), 1e-3)
    result.measure("same", max(np.abs(less).max(), 1e-12), 0.5)
    result.statement = "Costs of runs to rest from drawn places and speeds, 2 s ahead."
    result.statement_holds(
        min(s for s, _ in draws) > 1e-9,
        only_if="the clipped command of this mass reaches a limit after it was free or at the "
        "other limit",
        inside=[s > 1e-9 for s in coming],
        outside=[s > 1e-9 for s in less],
    )
    result.correction_holds(
        max(coming) > 0.05, draws[-1][0] > 0.05, np.abs(less).max() < 1e-9, max(extra) > 1e-3
    )


@claim(
    "Sampling-based control finds the plan if it has enough samples.",
    "The horizon must also be long enough for the plan to pay off. For a swing-up with a "
    "third of the torque of gravity and a horizon of {ahead:.0f} samples, {few:.0f} rollouts "
    "succeed in {few_won:.0f} of {seeds:.0f} runs, and {many:.0f} in {many_won:.0f}. With a "
    "horizon of {short:.0f} samples, {many:.0f} rollouts succeed in {short_won:.0f}.",
)
def samples_find_the_plan(result):
    from course.charts.control import plans

    seeds, few, more = result.input("seeds", 6), result.input("few", 2), result.input("many", 128)
    ahead, short = result.input("ahead", 20), result.input("short", 4)

    def won(samples, ahead):
        return np.sum([plans.swings_up(samples, ahead, 100 + seed) for seed in range(seeds)])

    result.measure("few_won", won(few, ahead), 1e-6)
    result.measure("many_won", won(more, ahead), 1e-6)
    result.measure("short_won", won(more, short), 1e-6)
    result.statement = "A pendulum under MPPI, judged after seven seconds, one seed a run."
    result.statement_holds(won(more, short) >= seeds / 2)
    result.correction_holds(won(more, ahead) > seeds / 2 > won(few, ahead))


@claim(
    "To get the inertia from a log, divide the torque by the second difference of the angle.",
    "Second differences of an angle with noise s have the noise {formula}, which is "
    "{worst:.0f} rad/s^2 for {noise:.0e} rad at {rate:.0f} Hz. The inertia from such a log "
    "comes out {diff:.0%} too small. The same equation, multiplied with a test function and "
    "integrated by parts, differentiates no measurement. It is off by at most {integral:.2%}.",
    ask=(
        "Each angle has independent noise of standard deviation s. What is the standard deviation "
        "of the second difference (q[k+1] - 2 q[k] + q[k-1])/dt^2?",
        "s_a = sqrt(6)*s/dt^2",
        {
            "2*s/dt^2": "The three angles have weights 1, -2 and 1: add their squares.",
            "4*s/dt^2": "Standard deviations do not add, variances do.",
            "sqrt(6)*s/dt": "It is divided by dt twice.",
        },
    ),
)
def inertia_by_differences(result):
    import sympy

    from course.charts.control import logs
    from course.control import identify

    s, step = sympy.symbols("s dt", positive=True)
    result.formula = sympy.sqrt(sum(w**2 for w in (1, -2, 1))) * s / step**2
    noise, dt = result.input("noise", 1e-4), 1 / result.input("rate", 500)
    drawn = np.diff(result.rng.normal(0, noise, 100_000), 2) / dt**2
    models = [logs.changed(result.rng, "inertia")[1] for _ in range(6)]
    pairs = list(zip(logs.record(models, dt=dt, noise=noise), models, strict=True))
    diff = np.array([logs.twice_differentiated(log, m) / m.inertia - 1 for log, m in pairs])
    deviation = np.array([identify(log).model.inertia / m.inertia - 1 for log, m in pairs])
    result.measure("worst", float(result.formula.subs({s: noise, step: dt})))
    result.measure("diff", -np.median(diff), 0.01)
    result.measure("integral", np.abs(deviation).max(), 0.05)
    result.statement = "Inertias out of six drawn joints' logs, friction and gravity known."
    result.statement_holds(np.abs(diff).max() < 0.05)
    result.correction_holds(
        abs(drawn.std() / float(result.formula.subs({s: noise, step: dt})) - 1) < 0.02,
        np.abs(deviation).max() < 0.005,
        np.max(diff) < -0.1,
    )


@claim(
    "An error that follows the acceleration means that the inertia in the model is wrong.",
    "A wrong torque constant of the motor looks the same. It scales inertia, friction and "
    "gravity alike, so only friction or gravity in the log can tell the two apart. In logs "
    "of a horizontal joint without friction, both explain all {flat:.0f} of {flat:.0f}. With "
    "gravity or friction, {named:.0f} of {drawn:.0f} logs name their one cause alone, among "
    "seven.",
)
def acceleration_means_inertia(result):
    from dataclasses import replace

    from course.charts.control import logs
    from course.control import diagnose
    from course.control.identify import CAUSES

    def report(cases):
        recorded = logs.record([truth for _, truth in cases], seconds=5.0)
        return [
            set(diagnose(log, model).causes)
            for log, (model, _) in zip(recorded, cases, strict=True)
        ]

    changes = [{"inertia": logs.FLAT.inertia * x} for x in result.rng.uniform(1.1, 1.4, 3)]
    changes += [{"constant": x} for x in result.rng.uniform(0.7, 0.9, 3)]
    flat = report([(logs.FLAT, replace(logs.FLAT, **change)) for change in changes])
    names = [cause for cause in CAUSES for _ in range(2)]
    cases = report([logs.changed(result.rng, cause) for cause in names])
    named = [found_out == {cause} for found_out, cause in zip(cases, names, strict=True)]
    result.measure("flat", np.sum([both == {"inertia", "constant"} for both in flat]), 1e-6)
    result.measure("named", np.sum(named), 1e-6)
    result.measure("drawn", len(cases) + 0 * np.sum(named))
    result.statement = "Logs of drawn joints, one number other than believed, 0.03 mrad of noise."
    result.statement_holds(all(causes == {"inertia"} for causes in flat))
    result.correction_holds(
        all(both == {"inertia", "constant"} for both in flat), np.mean(named) > 0.9
    )
