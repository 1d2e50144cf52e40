"""Accelerations, for the judge and for runs inside the child, where the chart counts them."""

import numpy as np


class Field:
    """Springs that get stiffer or softer, a constant pull, or a planet at the origin."""

    def __init__(self, kind, numbers):
        self.kind = kind
        self.numbers = [float(number) for number in numbers]
        self.calls = 0

    def __call__(self, q):
        """Return the acceleration at q and count the call."""
        self.calls += 1
        return acceleration(self.kind, self.numbers, q)


def acceleration(kind, numbers, q):
    """Return the acceleration at q for unit mass, one of four force fields."""
    q = np.array(q, dtype=float)
    if kind == "spring":
        return -numbers[0] * q - numbers[1] * q**3
    if kind == "constant":
        return np.full(q.shape, numbers[0])
    if kind == "planet":
        return -numbers[0] * q / np.linalg.norm(q) ** 3
    return -numbers[0] * np.sin(q)


def field(kind, numbers):
    """Return a force field that counts its evaluations."""
    return Field(kind, numbers)


def drive(q, v, kind, numbers, dt, steps):
    """Run the submission's step to the end, and return the run for the chart."""
    from submission import verlet_step

    field = Field(kind, numbers)
    a = field(q)
    for _ in range(steps):
        q, v, a = verlet_step(q, v, a, field, dt)
    return np.array(q, dtype=float), field.calls
