"""Interactive simulations: pure models of what happens, and the one canvas that shows them all."""

# Those that no browser computes, by their name, and why: their presets are shown as recorded.
RECORDED = {
    "perception": "a picture goes through NumPy and SciPy: rendering, trees of neighbours, poses",
    "sim_to_real": "each change counts hundreds of episodes, or tunes a policy anew",
    "learning.point": "each change trains a policy",
    "learning.two_ways": "each change runs a network a hundred times",
    "pipeline": "each change runs the whole pipeline a hundred times, its planner in Python",
}
