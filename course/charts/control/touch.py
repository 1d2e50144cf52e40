"""One mass and a wall: where force loops, impedance and admittance hold, and the regimes."""

import functools
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from course.charts import chart
from course.charts.control.limits import largest
from course.control import Probe, TouchLaw, run_touch, sampled
from course.measure.figure import Panel, Series
from course.measure.scene import LeftOut, Modelled, Scene, Tolerance
from course.oracles.mujoco import wall as mujoco

Array = NDArray[np.float64]
DT, DELAY = 1e-3, 2e-3  # sample time and delay of the loop [s]
ARM = Probe(mass=4.0, damping=20.0)
SPEED = 0.1  # m/s: of the approach


def growth(law: TouchLaw, wall: float, delay: float = DELAY, dt: float = DT) -> float:
    """Return growth per sample of a law while the arm touches a wall [N/m]."""
    probe = replace(ARM, wall=wall)
    plant = sampled.held(*probe.system(), dt, delay)
    return sampled.growth(sampled.loop_matrix(plant, law.linear(probe, dt)))


# --- a force loop, and what a simulated contact makes of it ---------------------------------------


def force_edge(wall: float, delay: float = DELAY) -> float:
    """Return the largest stable gain of P on the force, from the loop's matrix."""
    return largest(lambda g: growth(TouchLaw(force_gain=g), wall, delay), 1e-6, 1e3)


def force_edge_mujoco(
    wall: float, delay: float, kind: str, substeps: int = 1, impedance: float = 0.9
) -> float:
    """Return the stability limit measured in MuJoCo, with a force that keeps contact throughout."""
    # Pressed with 20 N, so that the deviation never opens the contact.
    whole, press = round(delay / DT), 20.0
    probe = mujoco.Probe(
        ARM.mass, ARM.damping, wall, DT, wall=kind, impedance=impedance, substeps=substeps
    )

    def holds(gain: float) -> float:
        probe.reset(press / wall, 1e-2 * press / wall / DT * 1e-2)
        sent, force, size = [press] * (whole + 1), press, np.empty(2500)
        for k in range(size.size):
            sent.append(press + gain * (press - force))
            force = probe.step(sent[k + 1])
            size[k] = abs(probe.x * wall / press - 1.0) + abs(force / press - 1.0)
            if not size[k] < 0.9:
                return 2.0
        # Stable if the last fifth swings less than the beginning after the transient.
        return 2.0 if np.max(size[-500:]) > np.max(size[100:600]) else 1.0

    low, high = 1e-4, 1e2
    while high / low > 1.002:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if holds(middle) <= 1.0 else (low, middle)
    return low


# --- impedance and admittance ---------------------------------------------------------------------


def stiffest(wall: float, delay: float = DELAY, damping: float = 0.0) -> float:
    """Return the largest stiffness of an impedance law up to which all are stable at a wall."""
    return largest(lambda K: growth(TouchLaw(K, damping), wall, delay), 1.0, 1e8)


def stiffest_damped(wall: float, delay: float = DELAY, points: int = 25) -> float:
    """Return the same with the best active damping."""
    from scipy.optimize import minimize_scalar

    def edge(damping: float) -> float:
        stable = growth(TouchLaw(1.0, damping), wall, delay) <= 1.0
        return stiffest(wall, delay, damping) if stable else 0.0

    # A logarithmic range up to 2 m/dt, above which a held damper alone is unstable; then refined.
    tried = np.geomspace(20.0, 2.0 * ARM.mass / DT, points)
    edges = [edge(float(d)) for d in tried]
    best = int(np.argmax(edges))
    bounds = tried[max(best - 1, 0)], tried[min(best + 1, points - 1)]
    fine = minimize_scalar(lambda d: -edge(d), bounds=bounds, method="bounded")
    return max(edge(0.0), edges[best], -float(fine.fun))


def lightest(wall: float, delay: float = 0.0, damping: float = 1.0) -> float:
    """Return the least virtual mass that admittance can show at a wall [kg].

    Its damping is a multiple of what is critical for 100 N/m.
    """

    def grown(lightness: float) -> float:
        mass = 1.0 / lightness
        # Over a stiff inner position loop; mass and damping shrink together.
        law = TouchLaw(4e4, 800.0, mass=mass, give=damping * 2.0 * math.sqrt(100.0 * mass))
        return growth(law, wall, delay)

    return 1.0 / largest(grown, 1e-3, 1e7)


@chart
def touching(points: int = 13) -> Iterator[Panel]:
    """Chart what holds at a wall, over its stiffness: a force loop, impedance, admittance.

    Args:
        points: walls.
    """
    walls = np.geomspace(1e2, 1e6, points)
    few = walls[:: max(1, points // 4)]
    panel = Panel(
        "A force loop on a wall, and on a simulated contact",
        "wall [N/m]",
        "largest gain on the force",
        scale="log",
    )
    exact = [force_edge(k) for k in walls]
    panel.series = [
        Series(
            "the loop's matrix",
            walls,
            exact,
            "",
            theory=lambda k: sampled.force_limit(ARM.damping, k, DELAY + 0.5 * DT),
        ),
        Series(
            "MuJoCo, spring",
            few,
            [force_edge_mujoco(k, DELAY, "spring", 10) for k in few],
            "MuJoCo",
            "",
            hollow=True,
        ),
    ]
    for d in (0.02, 0.9):
        panel.series.append(
            Series(
                f"MuJoCo, contact d = {d:g}",
                few,
                [force_edge_mujoco(k, DELAY, "contact", 1, d) for k in few],
            )
        )
    at = int(np.argmin(np.abs(walls - 1e5)))
    panel.notes = [
        f"P on the force at {walls[at]:.0e} N/m and {1e3 * DELAY:g} ms: gain {exact[at]:.3f}"
    ]
    yield panel

    panel = Panel(
        "Active damping raises the limit, delay lowers it",
        "wall [N/m]",
        "largest stiffness [N/m]",
        scale="log",
    )
    for delay in (0.0, DELAY):
        own = [stiffest(k, delay) for k in walls]
        active = [stiffest_damped(k, delay) for k in walls]
        bound = sampled.passive_stiffness(ARM.damping, DT, delay)
        panel.series += [
            Series(
                f"own friction, {1e3 * delay:g} ms",
                walls,
                own,
                "",
                "--",
                note=f"impedance, {1e3 * delay:g} ms late: own friction {min(own):.0f} to "
                f"{max(own):.0f} N/m, passive bound {bound:.0f}",
            ),
            Series(
                f"best active damping, {1e3 * delay:g} ms",
                walls,
                active,
                note=f"impedance, {1e3 * delay:g} ms late, active damping: {active[0]:.2g} N/m "
                f"at {walls[0]:.0e}, {active[-1]:.2g} at {walls[-1]:.0e}",
            ),
        ]
    yield panel

    panel = Panel(
        "Admittance: a stiffer wall needs more virtual mass",
        "wall [N/m]",
        "smallest virtual mass [kg]",
        scale="log",
    )
    light = [lightest(k) for k in walls]
    panel.lines = [("y", ARM.mass, "the arm's own mass")]
    panel.series = [Series("admittance over a stiff inner loop", walls, light)]
    shown = zip(walls[::3], light[::3], strict=True)
    panel.notes = [
        "least virtual mass: " + ", ".join(f"{m:.2g} kg at {k:.0e} N/m" for k, m in shown)
    ]
    yield panel


# --- the regimes ----------------------------------------------------------------------------------

# What each controller is along the normal; the force is 10 N where one is asked for. Hybrid control
# is two of them: force along the normal, position along the wall, where nothing is touched.
STIFF = TouchLaw(4000.0, 2.0 * math.sqrt(4000.0 * ARM.mass))
PRESS = TouchLaw(0.0, 300.0, force=10.0, force_gain=0.3)
REGIMES = {
    "stiff position": STIFF,
    "soft impedance": TouchLaw(200.0, 2.0 * math.sqrt(200.0 * ARM.mass)),
    "force": PRESS,
    "admittance": TouchLaw(4e4, 800.0, force=10.0, mass=8.0, give=400.0),
    "hybrid": PRESS,
}
TANGENT = {"hybrid": STIFF}
WALL = 1e4  # N/m


def tracking(law: TouchLaw) -> float:
    """Return the largest error in free space after the start, on a slow sine of 0.1 m [m]."""
    t = DT * np.arange(4000)
    free = replace(ARM, surface=9.0)
    law = replace(law, force=0.0)
    run = run_touch(free, law, 0.1 * np.sin(2.0 * t), DT, 4.0, delay=DELAY)
    # After two seconds, when the start has been forgotten.
    return float(np.max(np.abs(run.q[2000:-1] - 0.1 * np.sin(2.0 * t[2000:]))))


def first_peak(law: TouchLaw, arm: Probe = ARM, wall: float = WALL) -> float:
    """Return the first peak of the force when the set-point runs into the wall at `SPEED` [N]."""
    t = DT * np.arange(800)
    probe = replace(arm, wall=wall)
    run = run_touch(
        probe, law, np.minimum(SPEED * t - 0.02, 0.02), DT, 0.8, delay=DELAY, start=(-0.02, SPEED)
    )
    hit = int(np.argmax(run.torque > 0.0))
    later = run.torque[hit:]
    # The first local maximum after the contact begins.
    down = np.flatnonzero(np.diff(later) < 0.0)
    return float(later[down[0]]) if down.size else float(later[-1])


def surface_error(law: TouchLaw, gap: float = 2e-3) -> float:
    """Return how far the steady force moves when the surface is `gap` nearer than thought [N].

    The place is set so that 10 N press where the surface is expected; a law of force ignores it.
    """
    # The set-point that gives 10 N with both springs in series.
    place = 10.0 / law.stiffness + 10.0 / WALL if law.stiffness and not law.mass else 0.0
    force = [
        run_touch(
            replace(ARM, wall=WALL, wall_damping=50.0),
            law,
            place,
            DT,
            8.0,
            delay=DELAY,
            start=(0.0, 0.0),
            surface=np.full(8000, -x),
        ).torque[-1]
        for x in (0.0, gap)
    ]
    return float(force[1] - force[0])


def series_stiffness(law: TouchLaw, gap: float = 2e-3) -> float:
    """Return what two springs in series predict of that [N]."""
    return gap / (1.0 / law.stiffness + 1.0 / WALL)


def gain_margin(law: TouchLaw, wall: float = WALL) -> float:
    """Return the factor on all gains at which the law becomes unstable at the wall.

    For admittance the factor divides the virtual mass.
    """

    def scaled(factor: float) -> TouchLaw:
        if law.mass:
            # Admittance has no gain; dividing mass and damping by the factor scales its response.
            return replace(law, mass=law.mass / factor, give=law.give / factor)
        return replace(
            law,
            stiffness=factor * law.stiffness,
            damping=factor * law.damping,
            force_gain=factor * law.force_gain,
        )

    return largest(lambda x: growth(scaled(x), wall), 0.01, 1e3)


def touch_scene() -> Scene:
    """Return the scene of the first peak: what a mass and a one-sided spring leave out."""
    law = REGIMES["soft impedance"]
    answer = first_peak(law)

    def by_mujoco(kind: str) -> float:
        probe = mujoco.Probe(
            ARM.mass, ARM.damping, WALL, DT, wall=kind, impedance=0.02, substeps=10
        )
        probe.reset(-0.02, SPEED)
        sent, peak = [0.0, 0.0, 0.0], 0.0
        for k in range(600):
            aim = min(SPEED * k * DT - 0.02, 0.02)
            sent.append(law.stiffness * (aim - probe.x) - law.damping * probe.v)
            force = probe.step(sent[k + 1])
            # The first decrease ends the first peak.
            if force < peak:
                return peak
            peak = max(peak, force)
        return peak

    return Scene(
        question="How hard is the first peak when an arm runs into a wall?",
        tolerance=Tolerance(1.0, "N", "a tenth of the force that is wanted in contact"),
        degrees_of_freedom=("place along the normal",),
        modelled=(
            Modelled(
                "the wall's give",
                lambda: abs(first_peak(law, wall=10 * WALL) - answer),
                "N",
                against="the exact probe, ten times stiffer",
            ),
            Modelled(
                "the law while it touches",
                lambda: abs(first_peak(TouchLaw()) - answer),
                "N",
                against="no law",
            ),
        ),
        left_out=(
            LeftOut(
                "stepping, and a contact of MuJoCo",
                lambda: abs(by_mujoco("contact") - answer),
                "N",
                against="MuJoCo, ten steps a sample, d = 0.02",
            ),
            LeftOut(
                "the loss in a real wall of 10 N s/m",
                lambda: abs(first_peak(law, replace(ARM, wall_damping=10.0)) - answer),
                "N",
                against="the exact probe with it",
            ),
            LeftOut(
                "a tenth of the arm's friction",
                lambda: abs(first_peak(law, replace(ARM, damping=22.0)) - answer),
                "N",
                against="the exact probe with it",
            ),
        ),
    )


def slowest(law: TouchLaw, wall: float = WALL) -> float:
    """Return the rate from which on a law stands at a wall, as late as at 1 kHz [samples/s]."""
    steps = np.geomspace(DT, 1.0, 80)  # far below it may stand again
    # The first rate that fails, from fast to slow; at very slow ones it may stand again.
    fails = next(i for i, dt in enumerate(steps) if growth(law, wall, dt=dt) > sampled.STABLE)
    near = (float(dt) for dt in steps[fails - 1 : fails + 1])
    return 1.0 / largest(lambda dt: growth(law, wall, dt=dt), *near)


def row(name: str) -> dict[str, float]:
    """Return a row of the table of regimes: what its controller was measured to do."""
    law, along = REGIMES[name], TANGENT.get(name)
    free = along or law
    return {
        "free_mm": 1e3 * tracking(free) if free.stiffness else math.nan,
        "peak_n": first_peak(law),
        "off_n": surface_error(law),
        "margin": min(gain_margin(law), gain_margin(along, 0.0) if along else math.inf),
        "rate_hz": max(slowest(law), slowest(along, 0.0) if along else 0.0),
    }


def sentence(name: str) -> str:
    """Return one row of the table of regimes, as a sentence of its own figures."""
    law, result = REGIMES[name], row(name)
    expected = (
        f" (springs in series {series_stiffness(law):.1f})"
        if (law.stiffness and not law.mass)
        else ""
    )
    where = "along the wall" if name in TANGENT else "free"
    free = "nothing to follow" if math.isnan(result["free_mm"]) else f"{result['free_mm']:.1f} mm"
    return (
        f"{name:<15}tracking {where} {free}; first peak {result['peak_n']:.0f} N; surface 2 mm off "
        f"{result['off_n']:+.1f} N{expected}; margin x{result['margin']:.1f}, "
        f"from {result['rate_hz']:.0f} Hz on"
    )


@chart
def contact_regimes(points: int = 9) -> Iterator[Panel]:
    """Chart which controller for which regime: each measured on the same probe.

    Args:
        points: of each curve.
    """
    stiffness = np.geomspace(50.0, 2e4, points)
    panel = Panel(
        "First peak at 0.1 m/s and a wall of 10 kN/m, no damping",
        "stiffness of the controller [N/m]",
        "first peak of the force [N]",
        scale="log",
    )
    for mass in (1.0, 4.0):
        arm = replace(ARM, mass=mass, damping=0.0)
        peaks = [first_peak(TouchLaw(k), arm) for k in stiffness]
        theory = SPEED * math.sqrt(mass * WALL)
        panel.series.append(
            Series(
                f"{mass:g} kg",
                stiffness,
                peaks,
                theory=functools.partial(_undamped, theory),
                note=f"first peak of {mass:g} kg: {peaks[0]:.1f} N with {stiffness[0]:.0f} N/m, "
                f"speed sqrt(m ke) = {theory:.1f} N",
            )
        )
    panel.theory = "speed sqrt(m ke)"
    panel.notes = [sentence(name) for name in REGIMES] + [touch_scene().table()]
    yield panel


def _undamped(peak: float, _: float) -> float:
    return peak
