"""A ball dropped from rest, in equal steps. For the chart."""


def drive(y, dt, restitution, gravity, steps):
    """Return the height after `steps` steps of the submission, from rest at height y."""
    from submission import bounce_step

    v = 0.0
    for _ in range(steps):
        y, v = bounce_step(y, v, dt, restitution, gravity)
    return [float(y)]
