"""Small networks in PyTorch, one loop that fits them, and the running normaliser of their inputs.

The networks of this chapter have some thousand weights, where a call costs more than the numbers
in it. So all weights of a learner lie in one vector, of which the modules' parameters are views:
Adam, the length of the gradient and the copy of the last good weights are then one operation each,
not one for each layer. One thread is fastest at this size.

PyTorch takes seconds to import; it is imported when a network is made.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import count, invalid, one_of, positive, vector
from course.libraries import one_thread, pytorch

Array = NDArray[np.float64]


class Diverged(ArithmeticError):
    """A loss that is no finite number any more; the network has its last good weights."""

    policy: Any = None  # the policy with these weights, where one was being fitted


@functools.cache
def _tanh() -> Any:
    """Return the hyperbolic tangent as a module, by NumPy: PyTorch's takes ten times as long."""
    pytorch()
    import torch

    class Function(torch.autograd.Function):
        @staticmethod
        def forward(context: Any, x: Any) -> Any:
            y = torch.from_numpy(np.tanh(x.numpy()))
            context.save_for_backward(y)
            return y

        @staticmethod
        def backward(ctx: Any, *grad_outputs: Any) -> Any:
            # The derivative follows from the output alone: 1 - y^2.
            return torch.ops.aten.tanh_backward(*grad_outputs, *ctx.saved_tensors)

    class Tanh(torch.nn.Module):
        def forward(self, x):
            return Function.apply(x)

    return Tanh


def network(sizes: Sequence[int], seed: int, *, activation: str = "tanh", last: float = 1.0) -> Any:
    """Return a multilayer perceptron.

    Weights start orthogonal and offsets at 0 (Saxe, McClelland and Ganguli, Exact solutions to the
    nonlinear dynamics of learning in deep linear neural networks, 2014): an orthogonal layer
    neither shrinks nor enlarges what passes through it.

    Args:
        sizes: of the input, each hidden layer and the output.
        seed: of the weights; PyTorch's own random numbers are left alone.
        activation: between the layers, "tanh", "relu" or "silu".
        last: factor of the weights of the last layer; a small one makes a policy start near 0.

    Returns:
        A `torch.nn.Sequential`: (n, sizes[0]) -> (n, sizes[-1]), float32.
    """
    torch = pytorch()
    if len(sizes) < 2:
        raise invalid("sizes", sizes, "two numbers or more, of the input first")
    kinds = {"tanh": _tanh(), "relu": torch.nn.ReLU, "silu": torch.nn.SiLU}
    kind = kinds[one_of("activation", activation, kinds)]
    # A generator of its own leaves PyTorch's global random state alone.
    random = torch.Generator().manual_seed(count("seed", seed))
    layers: list[Any] = []
    for i in range(len(sizes) - 1):
        inner = i < len(sizes) - 2
        into, out = count("sizes", sizes[i], 1), count("sizes", sizes[i + 1], 1)
        # PyTorch's own initialisation would sample from the global random state.
        layer = torch.nn.utils.skip_init(torch.nn.Linear, into, out)
        # sqrt(2) makes up for what a rectifier cuts off; by custom the others have the same gain.
        gain = math.sqrt(2.0) if inner else last
        torch.nn.init.orthogonal_(layer.weight, gain, generator=random)
        torch.nn.init.zeros_(layer.bias)
        layers += [layer, kind()] if inner else [layer]
    return torch.nn.Sequential(*layers)


def flatten(*parts: Any) -> Any:
    """Return all weights of modules and parameters as one vector.

    The weights become views of that vector.

    Args:
        parts: modules, or parameters of no module.

    Returns:
        A `torch.nn.Parameter` (n,) whose `grad` is there and is filled by `backward` of any of
        them: set it to 0 with `grad.zero_()` before.
    """
    torch = pytorch()
    each = [p for part in parts for p in ([part] if torch.is_tensor(part) else part.parameters())]
    # One vector for all weights: Adam and the clip of the gradient are then single operations.
    flat = torch.nn.Parameter(torch.cat([p.detach().reshape(-1) for p in each]))
    flat.grad = torch.zeros_like(flat)
    start = 0
    for p in each:
        end = start + p.numel()
        # Weights and gradients become views: what moves the vector moves the modules.
        p.data = flat.data[start:end].view(p.shape)
        p.grad = flat.grad[start:end].view(p.shape)
        start = end
    return flat


def length(gradient: NDArray[np.float32]) -> float:
    """Return the Euclidean length of a float32 vector (n,), the same on every CPU.

    A float32 dot product depends on the kernel that BLAS picks for the CPU, and training amplifies
    the difference. Squares of float32 numbers are exact in float64, and NumPy adds them in an
    order that does not depend on the CPU.
    """
    return math.sqrt(np.square(gradient, dtype=float).sum())


def weights(net: Any) -> NDArray[np.float32]:
    """Return the weights of a network as one vector (n,), a copy, to keep or to store."""
    vector_of = pytorch().nn.utils.parameters_to_vector
    return vector_of([p.detach() for p in net.parameters()]).numpy().copy()


def load(net: Any, values: ArrayLike) -> Any:
    """Return the network with these weights, (n,) as `weights` gives them."""
    torch = pytorch()
    size = sum(p.numel() for p in net.parameters())
    remaining = torch.from_numpy(vector("values", values, (size,)).astype(np.float32))
    with torch.no_grad():
        for p in net.parameters():
            # In the order of `parameters()`, in which `weights` has written them.
            p.copy_(remaining[: p.numel()].view(p.shape))
            remaining = remaining[p.numel() :]
    return net


def tensor(values: ArrayLike) -> Any:
    """Return an array as a float32 tensor of its own."""
    return pytorch().tensor(np.asarray(values), dtype=pytorch().float32)


def predict(net: Any, rows: ArrayLike) -> Array:
    """Return what a network says of rows (n, d): (n, ...), as NumPy's numbers."""
    torch = pytorch()
    with torch.inference_mode(), one_thread():
        return np.asarray(net(tensor(rows)).numpy(), dtype=float)


def fit(
    net: Any,
    loss: Callable[[Any], Any],
    rows: int,
    *,
    seed: int,
    steps: int = 2_000,
    batch: int = 256,
    rate: float = 1e-3,
    clip: float = math.inf,
) -> Array:
    """Take a network down a loss by Adam, the rate falling to 0 (Kingma and Ba, Adam, 2015).

    Args:
        net: a module; it keeps its last good weights also where this raises.
        loss: indices of some rows, a tensor (batch,) -> their mean loss, a scalar tensor.
        rows: how many there are.
        seed: of the rows that are picked, with repetition.
        steps: of Adam.
        batch: rows in a step.
        rate: learning rate of Adam.
        clip: the longest gradient that is used as it is; a longer one is cut to this length.

    Returns:
        The loss of each step, shape (steps,).

    Raises:
        Diverged: when the loss is no finite number.
    """
    torch = pytorch()
    rng = np.random.default_rng(count("seed", seed))
    picks = rng.integers(count("rows", rows, 1), size=(count("steps", steps, 1), batch))
    flat = flatten(net)
    optimiser = torch.optim.Adam([flat], positive("rate", rate), fused=True)
    report, good = np.empty(steps), flat.detach().clone()
    with one_thread():
        for k, pick in enumerate(torch.from_numpy(picks)):
            flat.grad.zero_()
            value = loss(pick)
            report[k] = value.item()
            # A loss that is not finite: restore the last good weights before anybody sees the
            # others.
            if not math.isfinite(report[k]):
                with torch.no_grad():
                    flat.copy_(good)
                raise Diverged(f"the loss is {report[k]} at step {k} of {steps}: lower the rate")
            # The loss is finite, so these are the last good weights.
            good.copy_(flat.detach())
            value.backward()
            # Clip the gradient's length (Pascanu et al., 2013); the small number guards a length of
            # 0.
            if clip < math.inf:
                flat.grad.mul_(min(1.0, clip / (length(flat.grad.numpy()) + 1e-12)))
            # The rate falls linearly to 0.
            optimiser.param_groups[0]["lr"] = rate * (1.0 - k / steps)
            optimiser.step()
    return report


@dataclass
class Normaliser:
    """Mean and variance of columns, updated batch by batch, and the columns taken to 0 and 1.

    One for all environments: a row of any of them counts the same. The sums of two batches are
    put together exactly (Chan, Golub and LeVeque, Updating formulae and a pairwise algorithm for
    computing sample variances, 1979).

    Attributes:
        mean, variance: of each column, shape (d,); 0 and 1 before the first batch.
        rows: how many were counted.
        limit: normalised numbers are cut at plus and minus this.
    """

    mean: Array
    variance: Array
    rows: float = 0.0
    limit: float = 10.0

    @classmethod
    def of(cls, values: ArrayLike) -> Normaliser:
        """Return one that knows the rows (n, d) of a data set, and cuts nothing.

        Raises:
            ValueError: for a column without variance, which says nothing and would be divided by 0.
        """
        table = vector("values", values, (None, None))
        made = cls.blank(table.shape[1])
        made.limit = math.inf
        made.update(table)
        made.check("values")
        return made

    @classmethod
    def blank(cls, columns: int) -> Normaliser:
        """Return one that has seen nothing: it hands on what it gets."""
        return cls(np.zeros(count("columns", columns, 1)), np.ones(columns))

    def check(self, name: str) -> None:
        """Raise ValueError if what is called `name` has one row, or a column without variance."""
        if self.rows < 2:
            raise invalid(f"rows of {name}", int(self.rows), "2 or more: one has no variance")
        # Relative to the mean, as rounding leaves a constant column a little variance.
        flat = np.flatnonzero(self.variance <= 1e-12 * (1.0 + self.mean**2))
        if flat.size:
            column = f"variance of {name}[:, {flat[0]}]"
            raise invalid(column, float(self.variance[flat[0]]), "a positive number: leave it out")

    def update(self, values: Array) -> None:
        """Count some rows, (n, d), n from 1 on."""
        # Chan's update of mean and variance by a batch.
        n, mean = len(values), values.mean(axis=0)
        total, ahead = self.rows + n, mean - self.mean
        share = n / total
        within = (1.0 - share) * self.variance + share * values.var(axis=0)
        self.variance = within + share * (1.0 - share) * ahead**2
        self.mean = self.mean + share * ahead
        self.rows = total

    def __call__(self, values: ArrayLike) -> Array:
        """Return rows (..., d) normalised."""
        # The small number guards a column that has not varied so far.
        scaled = (np.asarray(values, dtype=float) - self.mean) / np.sqrt(self.variance + 1e-8)
        return np.clip(scaled, -self.limit, self.limit) if self.limit < math.inf else scaled

    def undo(self, values: ArrayLike) -> Array:
        """Return normalised rows as they were."""
        return np.asarray(values, dtype=float) * np.sqrt(self.variance + 1e-8) + self.mean
