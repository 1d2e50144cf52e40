"""The names of all simulations, and which of them a web page shows as recorded."""

# The module of each simulation below this package, in the order of the chapters.
SIMULATIONS = (
    "role.stack",
    "role.development",
    "rigid_body.bouncing_box",
    "rigid_body.double_cover",
    "rigid_body.flip",
    "rigid_body.free_body",
    "rigid_body.gimbal",
    "rigid_body.force_evaluations",
    "rigid_body.spring",
    "rigid_body.top",
    "rigid_body.tunnelling",
    "contact.touch",
    "contact.friction_cone",
    "contact.half_axes",
    "contact.simplex",
    "contact.penalty_spring",
    "contact.sweeps",
    "contact.soft_contact",
    "contact.stopping_distance",
    "platforms",
    "kinematics.arm",
    "kinematics.elbow",
    "planning.growing",
    "control.joint",
    "control.nyquist",
    "control.probe",
    "perception",
    "sim_to_real.arms",
    "sim_to_real.faults",
    "learning.point",
    "learning.two_ways",
    "learning.policy_gradient",
    "learning.gae_weights",
    "learning.clipped_objective",
    "learning.cloning_drift",
    "learning.denoising",
    "learning.action_chunks",
    "middleware",
    "pipeline",
    "interview",
)

# Those that no browser computes, by their name, and why: their presets are shown as recorded.
RECORDED = {
    "pipeline": (
        "its planner is a Python function that you can replace, which a browser cannot compile; in "
        "a notebook each change runs the whole pipeline more than 20 times, which takes 0.1 to 1 s"
    ),
}
