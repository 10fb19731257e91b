"""Adam with bounds, for many parameters: steps from gradients of a few frames at a time.

The same steps as `drjit.opt.Adam`, on a NumPy vector, so that a run that was stopped is repeated to
the last bit.

References
----------
D. Kingma, J. Ba, Adam: a method for stochastic optimization, ICLR 2015.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from experiments.optimize.gauss_newton import Minimum
from experiments.optimize.target import Array


class StochasticObjective(Protocol):
    """An objective that is a mean over groups of frames."""

    @property
    def group_count(self) -> int:
        """Groups that gradients can be asked of."""

    def group_gradient(self, point: Array, group: int) -> Array:
        """Return dF / dx of one group."""

    def value(self, point: Array) -> float:
        """Return F of all groups, or infinity where a point is refused; the start never is."""


@dataclass(frozen=True, kw_only=True)
class AdamOptions:
    """How Adam steps."""

    iterations: int = 60
    """Steps."""
    rate: float = 0.03
    """Length of a step, inner units."""
    beta_1: float = 0.9
    """Memory of the gradient."""
    beta_2: float = 0.99
    """Memory of its square; shorter than usual, because there are few steps."""
    epsilon: float = 1e-8
    """Keeps a parameter without gradient in its place."""
    check_every: int = 10
    """Steps after which all groups are asked whether the point is the best so far."""
    final_rate: float = 0.1
    """Share of the rate that the last step has; it falls along a cosine."""


ADAM_OPTIONS = AdamOptions()


def minimise_by_adam(
    objective: StochasticObjective,
    start: Array,
    low: Array,
    high: Array,
    options: AdamOptions = ADAM_OPTIONS,
    tell: Callable[[int], None] = lambda _count: None,
) -> Minimum:
    """Return the best of the points that were checked, the start among them.

    Parameters
    ----------
    objective
        What is minimised.
    start, low, high
        [parameter] where to begin, and bounds.
    options
        Steps.
    tell
        Told how many steps have been taken.
    """
    point = np.clip(start, low, high)
    best = (objective.value(point), point)
    checks = 1
    mean, square = np.zeros_like(point), np.zeros_like(point)
    for step in range(1, options.iterations + 1):
        tell(step)
        gradient = objective.group_gradient(point, (step - 1) % objective.group_count)
        mean = options.beta_1 * mean + (1.0 - options.beta_1) * gradient
        square = options.beta_2 * square + (1.0 - options.beta_2) * gradient**2
        direction = (mean / (1.0 - options.beta_1**step)) / (
            np.sqrt(square / (1.0 - options.beta_2**step)) + options.epsilon
        )
        fall = 0.5 * (1.0 + np.cos(np.pi * (step - 1) / options.iterations))
        rate = options.rate * (options.final_rate + (1.0 - options.final_rate) * fall)
        point = np.clip(point - rate * direction, low, high)
        if step % options.check_every == 0 or step == options.iterations:
            value = objective.value(point)
            checks += 1
            if value < best[0]:
                best = (value, point)
    return Minimum(
        point=best[1], value=best[0], evaluations=checks, message=f"{options.iterations} steps"
    )
