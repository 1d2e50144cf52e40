"""Colour and marker of every method of the course, by a key: one row of `KEYS` for each.

A method looks the same in all charts. `key_of` finds the key in the name that a chart gives it.
"""

# Okabe and Ito (2008), distinguishable with any colour vision; yellow is too pale for a thin line.
BLUE, VERMILION, GREEN, PINK = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
SKY, AMBER, GREY, PURPLE = "#56B4E9", "#E69F00", "#7F7F7F", "#5D3A9B"
BROWN, LIME, WINE = "#7A4B00", "#8FBC3B", "#882255"
PALETTE = (BLUE, VERMILION, GREEN, PINK, SKY, AMBER, GREY, PURPLE)
MARKERS = "osDv^P*X"

# Colour and marker of every method of the course, one row each. MuJoCo's Euler and RK4 are the
# course's semi-implicit Euler and RK4 and have their colours; an oracle's markers are hollow.
KEYS: dict[str, tuple[str, str]] = {
    # integrators
    "explicit_euler": (BLUE, "o"),
    "semi_implicit_euler": (VERMILION, "s"),
    "velocity_verlet": (GREEN, "D"),
    "explicit_midpoint": (PINK, "v"),
    "implicit_midpoint": (SKY, "^"),
    "rk4": (AMBER, "P"),
    "rk4_renormalised": (GREY, "*"),
    "MuJoCo Euler": (VERMILION, "s"),
    "MuJoCo Euler, eulerdamp off": (WINE, "p"),
    "MuJoCo RK4": (AMBER, "P"),
    "MuJoCo implicitfast": (PURPLE, "X"),
    "MuJoCo implicit": (BROWN, "d"),
    "MuJoCo discrete": (LIME, "h"),
    # contact
    "exact flight, impact times": (BLUE, "o"),
    "semi-implicit, impact times": (GREEN, "D"),
    "exact flight, end of step": (SKY, "^"),
    "semi-implicit, end of step": (PINK, "v"),
    "MuJoCo Euler (spring)": (WINE, "p"),
    "checked once a step": (BLUE, "o"),
    "event in the step": (GREEN, "^"),
    "MuJoCo, one-step contact": (VERMILION, "s"),
    "MuJoCo, default contact": (PURPLE, "o"),
    # contact models
    "penalty": (VERMILION, "s"),
    "exact pyramid (LCP)": (SKY, "^"),
    "box of limits (LCP)": (LIME, "d"),
    "sweeps, true cone": (GREEN, "D"),
    "sweeps, true cone (10)": (LIME, "d"),
    "sweeps, true cone (1000)": (GREEN, "D"),
    "sweeps, compiled loop": ("black", "D"),
    "true cone (Newton)": (BLUE, "o"),
    "convex cone": (AMBER, "P"),
    "MuJoCo's soft model, ours": (PINK, "v"),
    "MuJoCo Newton, elliptic": (PURPLE, "X"),
    "MuJoCo CG, elliptic": (WINE, "X"),
    "MuJoCo PGS, elliptic": (BROWN, "X"),
    "MuJoCo Newton, pyramidal": (PURPLE, "^"),
    "MuJoCo CG, pyramidal": (WINE, "^"),
    "MuJoCo PGS, pyramidal": (BROWN, "^"),
    "MuJoCo Newton, elliptic, discrete": (GREY, "h"),
    "MuJoCo Newton, hardened": (BROWN, "o"),
    "recovery, speed capped": (BLUE, "o"),
    "recovery, no cap": (VERMILION, "s"),
    "MuJoCo, refsafe": (PURPLE, "X"),
    "MuJoCo, refsafe off": (BROWN, "d"),
    # contact geometry
    "brute force": (GREY, "*"),
    "sweep and prune": (BLUE, "o"),
    "kept order": (SKY, "^"),
    "uniform grid": (GREEN, "D"),
    "GJK and EPA": (BLUE, "o"),
    "Coal": (VERMILION, "s"),
    "Coal, poses in the loop": (AMBER, "P"),
    "Coal, one call for all": (VERMILION, "s"),
    "Coal, a call a pair": (AMBER, "P"),
    "Coal, default tolerance": (WINE, "p"),
    "every feature": (GREY, "*"),
    "advanced to the impact": (GREEN, "^"),
    "MuJoCo, default": (PURPLE, "X"),
    "MuJoCo, speculative": (LIME, "h"),
    # quaternions
    "added": (VERMILION, "s"),
    "added and renormalised": (GREY, "*"),
    "exponential map": (AMBER, "P"),
    # engines
    "course": (BLUE, "o"),
    "mujoco.batch": (PURPLE, "X"),
    "mujoco.rollout": (WINE, "p"),
    "a call per arm": (PINK, "v"),
    "array of structures": (VERMILION, "s"),
    "structure of arrays": (GREEN, "D"),
    "blocks of arrays": (BLUE, "o"),
    "closed form": (BLUE, "o"),
    "mujoco.batch, Euler": (VERMILION, "s"),
    "mujoco.batch, RK4": (AMBER, "P"),
    "mujoco.batch, implicitfast": (PURPLE, "X"),
    "processes": (GREEN, "D"),
    "loop": (PINK, "v"),
    "Gymnasium, loop": (SKY, "^"),
    "Gymnasium, processes": (WINE, "p"),
    "Gymnasium, loop, closed form": (GREY, "*"),
    # control
    "conditional integration": (BLUE, "o"),
    "no anti-windup": (VERMILION, "s"),
    "MuJoCo": (PURPLE, "X"),
    "PD": (GREY, "*"),
    "PD + gravity": (VERMILION, "s"),
    "computed torque": (SKY, "^"),
    "half-sample preview": (BLUE, "o"),
    "adaptive law": (PINK, "v"),
    "learned": (AMBER, "P"),
    "LQR along the path": (LIME, "d"),
    "saturated LQR": (LIME, "d"),
    "MPC": (BROWN, "h"),
    "MPPI": (WINE, "p"),
    "cascade": (VERMILION, "s"),
    "PD + feed-forward": (PURPLE, "X"),
    "observer": (GREEN, "D"),
    "observer with delay": (PINK, "v"),
    "predictor": (SKY, "^"),
    "predictor, half the delay": (AMBER, "P"),
    # kinematics
    "forward": (BLUE, "o"),
    "central": (VERMILION, "s"),
    "complex step": (GREEN, "D"),
    "autograd": (PINK, "v"),
    "analytic": (AMBER, "P"),
    "null space": (BLUE, "o"),
    "re-projected": (GREEN, "D"),
    "damped": (VERMILION, "s"),
    "transpose": (BLUE, "o"),
    "pseudo_inverse": (GREEN, "D"),
    "adaptive": (PINK, "v"),
    "levenberg_marquardt": (AMBER, "P"),
    "uniform starts": (BLUE, "o"),
    "compiled search": (GREEN, "D"),
    "compiled search, a batch": (AMBER, "P"),
    "closed form, a batch": (VERMILION, "s"),
    "nearest of a table": (GREEN, "D"),
    "network's starts": (VERMILION, "s"),
    "usual loop": (VERMILION, "s"),
    "usual loop, clamped, 20 starts": (AMBER, "P"),
    "same with full steps": (PINK, "v"),
    "our method in Python": (PURPLE, "X"),
    "no limits": (GREY, "*"),
    "scaled": (AMBER, "P"),
    "clipped": (VERMILION, "s"),
    "quadratic program": (BLUE, "o"),
    "mink": (PURPLE, "X"),
    "pink": (PINK, "v"),
    "Pinocchio": (GREEN, "D"),
    "Pinocchio, a batch": (AMBER, "P"),
    # perception
    "Open3D": (VERMILION, "s"),
    "Embree": (AMBER, "P"),
    "shape": (BLUE, "o"),
    "cloud": (GREEN, "D"),
    "small_gicp": (PURPLE, "X"),
    "centroid": (GREY, "*"),
    "box along the table": (AMBER, "P"),
    "principal axes": (PINK, "v"),
    "box along principal axes": (VERMILION, "s"),
    "ICP, points": (GREEN, "D"),
    "ICP, shape": (BLUE, "o"),
    "locate": (PURPLE, "X"),
    "RANSAC": (AMBER, "P"),
    "RANSAC, refit": (VERMILION, "s"),
    "SVD of points": (GREEN, "D"),
    "inverse depth": (BLUE, "o"),
    # identification
    "differentiated": (GREY, "*"),
    "filtered, 10 ms": (SKY, "^"),
    "filtered, 40 ms": (AMBER, "P"),
    "integral": (GREEN, "D"),
    "output error": (BLUE, "o"),
    "mujoco.sysid": (PURPLE, "X"),
    # arms that vary; the adaptive law stands above
    "one tuned gain set": (GREY, "*"),
    "randomised gains": (AMBER, "P"),
    "best gains in hindsight": (BLUE, "o"),
    "student with history": (GREEN, "D"),
    "teacher": (PURPLE, "X"),
    # actuator models
    "ideal drive": (GREY, "*"),
    "lag and friction": (VERMILION, "s"),
    "network": (GREEN, "D"),
    "network, PyTorch": (PURPLE, "X"),
    # platforms; MuJoCo stands above
    "own code": (BLUE, "o"),
    "Drake": (GREEN, "D"),
    "PyBullet": (AMBER, "P"),
    # role
    "events": (GREEN, "D"),
    "locked": (PURPLE, "D"),
    "queue": (VERMILION, "s"),
    # drawn black
    "yours": ("black", "s"),
    "theory": ("black", ""),
    "theory on a map": ("white", ""),
    "chosen": ("black", "o"),
}


def key_of(name: str) -> str:
    """Return the key of a method's name.

    "MuJoCo RK4 (spring)" and "compiled rk4" find theirs, else "".
    """
    plain = name.removeprefix("compiled ")
    for candidate in (plain, plain.partition(" (")[0], plain.partition(",")[0]):
        if candidate in KEYS:
            return candidate
    return ""
