"""Discrete choices and numbers together, without derivatives and without other packages.

An evolution strategy of few evaluations: each trial changes some of the numbers of one of the best
points so far, by steps that shrink as trials go on. Nothing depends on how many trials there will
be, so a longer run begins with the trials of a shorter one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from experiments.optimize.discrete import AnyObjective
from experiments.optimize.gauss_newton import Minimum
from experiments.optimize.parameters import Parameter
from experiments.optimize.target import Array

PARENT_COUNT = 4
"""Best points from which the next trial may start."""

FIRST_WIDTH = 0.15
"""Standard deviation of the first steps, as a share of the bounds' distance."""

HALVING = 30
"""Trials after which steps are about 0.7 of the first ones, and then 0.7 for twice as many."""

CHANGE_SHARE = 0.5
"""How many of the numbers a trial changes, on the mean."""

CHOICE_SHARE = 0.35
"""How many of the discrete choices it changes at first; they become rarer as steps shrink."""


def minimise_by_evolution(
    objective: AnyObjective,
    parameters: Sequence[Parameter],
    start: Array,
    *,
    trials: int,
    seed: int,
    tell: Callable[[int], None] = lambda _count: None,
) -> Minimum:
    """Return the best of many trials, the start being the first.

    Parameters
    ----------
    objective
        What is minimised.
    parameters
        What a point's numbers are, with their bounds or options.
    start
        Inner point.
    trials
        Points that are tried.
    seed
        Of the changes: the same gives the same points.
    tell
        Told how many points have been tried.
    """
    random = np.random.default_rng(seed)
    tell(1)
    best = [(objective.value(start), start)]
    for count in range(2, trials + 1):
        tell(count)
        _, parent = best[int(random.integers(len(best)))]
        point = _changed(parent, parameters, 1.0 / math.sqrt(1.0 + count / HALVING), random)
        value = objective.value(point)
        if math.isfinite(value):
            # Sorting is stable, so that of equal points the first stays first.
            best = sorted([*best, (value, point)], key=lambda each: each[0])[:PARENT_COUNT]
    value, point = best[0]
    return Minimum(point=point, value=value, evaluations=trials, message=f"{trials} trials")


def _changed(
    parent: Array, parameters: Sequence[Parameter], size: float, random: np.random.Generator
) -> Array:
    """Return a point near another one, and not the same."""
    while True:
        point = parent.copy()
        for place, parameter in enumerate(parameters):
            low, high = parameter.inner_bounds
            if parameter.options is not None:
                if random.random() < CHOICE_SHARE * size:
                    point[place] = _neighbour(parameter, float(parent[place]), random)
            elif random.random() < CHANGE_SHARE:
                step = FIRST_WIDTH * size * (high - low) * random.standard_normal()
                point[place] = min(max(parent[place] + step, low), high)
        if np.any(point != parent):
            return point


def _neighbour(parameter: Parameter, number: float, random: np.random.Generator) -> float:
    """Return the inner number of an option one or two places away."""
    options = parameter.options or ()
    place = options.index(round(parameter.outer(number)))
    near = [each for each in range(len(options)) if 1 <= abs(each - place) <= 2]
    return parameter.inner(options[near[int(random.integers(len(near)))]])
