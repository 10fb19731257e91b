"""Discrete choices by Optuna: how many cones, how many pixels, beside numbers if need be."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from experiments.errors import InputError
from experiments.optimize.gauss_newton import Minimum
from experiments.optimize.parameters import Parameter
from experiments.optimize.target import Array

REFUSED_VALUE = 1e3
"""What a sampler is told of a point that a limit refuses: the objective begins near 1."""


class AnyObjective(Protocol):
    """An objective without derivatives."""

    def value(self, point: Array) -> float:
        """Return F, or infinity where a point is refused; the start never is."""


def minimise_by_trials(
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
        Of the sampler (a tree-structured Parzen estimator): the same gives the same points.
    tell
        Told how many points have been tried.

    Raises
    ------
    InputError
        Optuna is not installed.
    """
    try:
        import optuna
    except ModuleNotFoundError as error:
        raise InputError(
            what="Optuna is not installed",
            where="--method optuna",
            remedy="install the extra: pip install 'vctgi[tune]'",
        ) from error
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed))
    study.enqueue_trial(
        {
            each.name: float(x) if each.options is None else round(each.outer(float(x)))
            for each, x in zip(parameters, start, strict=True)
        }
    )
    best = (math.inf, start)
    for count in range(1, trials + 1):
        tell(count)
        trial = study.ask()
        point = np.array([_suggest(trial, each) for each in parameters])
        value = objective.value(point)
        study.tell(trial, value if math.isfinite(value) else REFUSED_VALUE)
        if value < best[0]:
            best = (value, point)
    return Minimum(point=best[1], value=best[0], evaluations=trials, message=f"{trials} trials")


def _suggest(trial: object, parameter: Parameter) -> float:
    """Return the inner number that a trial takes for a parameter."""
    suggest_float: Callable[[str, float, float], float] = trial.suggest_float  # type: ignore[attr-defined]
    choose: Callable[[str, tuple[int, ...]], int] = trial.suggest_categorical  # type: ignore[attr-defined]
    if parameter.options is not None:
        return parameter.inner(choose(parameter.name, parameter.options))
    return suggest_float(parameter.name, *parameter.inner_bounds)
