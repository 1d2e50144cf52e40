"""Real libraries asked the same questions as the course: one thin adapter for each.

An adapter imports its library inside its functions, so `import course.oracles.mujoco` works without
MuJoCo and a missing library gives one clear sentence at the moment it is needed.
"""
