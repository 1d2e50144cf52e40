"""Forward passes of the chapter's policies in Numba's subset, for a page that has no PyTorch.

The weights are those of `course.learning.recorded`, fitted by PyTorch and stored as one vector for
each policy, layer by layer, a matrix (outputs, inputs) before its offsets. The compiled functions
sum in double precision what PyTorch sums in single precision.
"""

import math

import numba
import numpy as np
from numba.extending import register_jitable

from course.compiled import MATRIX, loop
from course.learning.clone import LEAST
from course.learning.generate import ddim_step, mix


def _perceptron(rows, weights, hidden, outputs):
    """Return what a network with two hidden layers of SiLU computes, (n, outputs).

    Args:
        rows: inputs (n, d).
        weights: vector of at least as many weights as the network has, float32.
        hidden: width of both hidden layers.
        outputs: size of the output.
    """
    n, start, layer = len(rows), 0, rows
    for depth in range(3):
        inner, width = depth < 2, layer.shape[1]
        size = hidden if inner else outputs
        offsets = start + size * width
        # Stored as (size, width). Rounded up to blocks of four outputs, and converted to double
        # precision once for all rows.
        blocks = (size + 3) // 4
        matrix = np.zeros((blocks, width, 4))
        for j in range(size):
            for i in range(width):
                matrix[j // 4, i, j % 4] = weights[start + j * width + i]
        result = np.empty((n, size))
        for block in range(blocks):
            for row in range(n):
                # Four sums at a time stay in registers, each in the order of its inputs.
                a = b = c = d = 0.0
                for i in range(width):
                    x = layer[row, i]
                    a += x * matrix[block, i, 0]
                    b += x * matrix[block, i, 1]
                    c += x * matrix[block, i, 2]
                    d += x * matrix[block, i, 3]
                sums = (a, b, c, d)
                for k in range(min(4, size - 4 * block)):
                    j = 4 * block + k
                    value = sums[k] + weights[offsets + j]
                    result[row, j] = value / (1.0 + math.exp(-value)) if inner else value
        layer, start = result, offsets + size
    return layer


_WEIGHTS = numba.types.Array(numba.float32, 1, "C")
perceptron = loop(_perceptron, MATRIX(MATRIX, _WEIGHTS, numba.int64, numba.int64))


def _mixture_sample(out, modes, gumbel, normal):
    """Return a sample of each row's mixture of normal distributions, (n, d).

    Args:
        out: what the network predicts, (n, modes (1 + 2 d)): the logarithms of the weights up to a
            constant, then mean and raw deviation of each component.
        modes: number of components.
        gumbel: numbers of a standard Gumbel distribution, (n, modes).
        normal: standard normal numbers, (n, d).
    """
    n, size = normal.shape
    result = np.empty((n, size))
    for row in range(n):
        # The Gumbel-max trick samples a component from the log-weights.
        best = 0
        for k in range(1, modes):
            if out[row, k] + gumbel[row, k] > out[row, best] + gumbel[row, best]:
                best = k
        mean = modes + 2 * best * size
        for j in range(size):
            raw = out[row, mean + size + j]
            # Softplus keeps deviations positive, written so that no exponential overflows.
            deviation = max(raw, 0.0) + math.log1p(math.exp(-abs(raw))) + LEAST
            result[row, j] = out[row, mean + j] + deviation * normal[row, j]
    return result


mixture_sample = loop(_mixture_sample, MATRIX(MATRIX, numba.int64, MATRIX, MATRIX))


@register_jitable
def rate(sample, rows, time, flow, weights, hidden):
    """Return the velocity that the network of a flow or of a diffusion predicts, (n, d).

    With the sample x = a clean + s noise, a flow predicts dx/dtime = clean - noise, and a diffusion
    predicts v = s clean - a noise (Salimans and Ho, Progressive Distillation, 2022).

    Args:
        sample: x, between noise and data, (n, d).
        rows: normalised states (n, k).
        time: from 0 (noise) to 1 (data).
        flow: whether the network belongs to a flow.
        weights: of the network, float32.
        hidden: width of its hidden layers.
    """
    n, size = sample.shape
    turn = 2.0 * math.pi * time
    # The network's inputs are the sample, the clock as sines and cosines, and the state.
    given = np.empty((n, size + 5 + rows.shape[1]))
    given[:, :size] = sample
    given[:, size] = time
    given[:, size + 1] = math.sin(turn)
    given[:, size + 2] = math.cos(turn)
    given[:, size + 3] = math.sin(2.0 * turn)
    given[:, size + 4] = math.cos(2.0 * turn)
    given[:, size + 5 :] = rows
    # The best linear prediction, exact for standard normal data; the network adds the rest.
    skip = (2.0 * time - 1.0) / ((1.0 - time) ** 2 + time**2) if flow else 0.0
    return skip * sample + perceptron(given, weights, hidden, size)


@register_jitable
def flow_sample(noise, rows, steps, weights, hidden):
    """Return samples (n, d) of a flow, carried from noise to data by Euler steps."""
    x = noise
    for k in range(steps):
        x = x + rate(x, rows, k / steps, True, weights, hidden) / steps
    return x


@register_jitable
def diffusion_sample(noise, rows, steps, weights, hidden):
    """Return samples (n, d) of a diffusion, denoised in the steps of DDIM."""
    x = noise
    for k in range(steps):
        a, s = mix(k / steps)
        after = mix((k + 1) / steps) if k + 1 < steps else (1.0, 0.0)
        # With x = a clean + s noise and v = s clean - a noise, clean is a x + s v.
        clean = a * x + s * rate(x, rows, k / steps, False, weights, hidden)
        x = ddim_step(x, clean, (a, s), after, 0.0)
    return x
