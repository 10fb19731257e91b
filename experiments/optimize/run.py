"""A fit from beginning to end: views, optimiser, what it found on views that it never saw."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

import vctgi
from experiments.errors import InputError
from experiments.optimize.adam import AdamOptions, minimise_by_adam
from experiments.optimize.discrete import minimise_by_trials
from experiments.optimize.evaluation import FrameEvaluator, code_circumstances
from experiments.optimize.evolution import minimise_by_evolution
from experiments.optimize.find_parameters import find_parameters
from experiments.optimize.findings import ViewFinding, compare_view
from experiments.optimize.fit import LEAST_ERROR, Fit, LimitRules
from experiments.optimize.frames import Derivatives, FrameSource, point_config
from experiments.optimize.gauss_newton import Minimum, StopRule, minimise
from experiments.optimize.intervals import Uncertainty
from experiments.optimize.ledger import EvaluationLedger
from experiments.optimize.limits import Limit
from experiments.optimize.parameters import Parameter
from experiments.optimize.views import View, ViewName, ViewOptions, make_view
from vctgi.config import RenderConfig

Method = Literal["gauss-newton", "adam", "evolution", "optuna"]
"""How the objective is made small."""

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of it that is done, in [0, 1]."""

WITHOUT_DERIVATIVES: tuple[Method, ...] = ("evolution", "optuna")
"""Methods that make discrete choices, and give no intervals."""

MOST_GAUSS_NEWTON = 24
"""Most parameters of Gauss-Newton: each costs a pass over all frames at each step."""


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """What a fit is asked for."""

    scenes: tuple[str, ...]
    """Training scenes."""
    held_out: tuple[str, ...] = ()
    """Scenes that are only measured."""
    has_turned_views: bool = True
    """Whether each training scene is also measured from a turned camera."""
    preset: str = "high"
    """Where the fit starts."""
    parameters: tuple[str, ...] = ("aperture_scale", "exponent", "pull_back", "level_bias")
    """What is fitted."""
    method: Method = "gauss-newton"
    """How."""
    derivatives: Derivatives = "forward"
    """How derivatives are found."""
    frame_count: int = 4
    """Frames of each view: places in the lattice, each with random numbers of its own."""
    iterations: int = 20
    """Most points, steps or trials."""
    reference_spp: int = 512
    """Paths a pixel of the references."""
    resolution: int = 64
    """Longer edge of the pictures, pixels."""
    seed: int = 0
    """Start of all random numbers."""
    limits: LimitRules = field(default_factory=LimitRules)
    """What must not get worse."""
    cache: Path | None = None
    """Folder of references and of finished evaluations."""
    clipmap_resolution: int | None = None
    """Voxels along an edge of a level while fitting; None: the preset's."""


@dataclass(frozen=True, kw_only=True)
class FitResult:
    """What a fit found.

    Attributes
    ----------
    base, fitted
        Configurations before and after.
    parameters, start, end
        What was fitted, with inner points.
    uncertainty
        How sure the end is; None where a method has no derivatives.
    minimum
        Where the optimiser ended, and why.
    objective
        Objective at the start and at the end; 1 is the start.
    training, held_out
        What each view says.
    limits
        What was limited, with the means at the end.
    seconds
        Wall time of the fit, and of it how many evaluations were found in the ledger.
    """

    base: RenderConfig
    fitted: RenderConfig
    parameters: list[Parameter]
    start: np.ndarray
    end: np.ndarray
    uncertainty: Uncertainty | None
    minimum: Minimum
    objective: tuple[float, float]
    training: list[ViewFinding]
    held_out: list[ViewFinding]
    limits: list[tuple[Limit, float]]
    seconds: float
    reused_count: int


def run_fit(options: FitOptions, variant: str, progress: Progress) -> FitResult:
    """Fit parameters, and measure start and end on training and held-out views.

    Raises
    ------
    InputError
        A parameter, a preset or a scene that cannot be used.
    """
    began = time.monotonic()
    base = fit_config(options)
    parameters = check_options(options)
    names, outside = view_names(options)
    view_options = ViewOptions(
        resolution=options.resolution,
        reference_spp=options.reference_spp,
        seed=options.seed,
        cache=options.cache,
    )
    views = [make_view(name, view_options, base, progress) for name in names]
    unseen = [make_view(name, view_options, base, progress) for name in outside]
    cache = options.cache or Path.cwd()
    ledger = EvaluationLedger(cache / "optimize" / f"{variant}.jsonl", code_circumstances(variant))
    source = FrameSource(options.seed, options.derivatives)
    shown = _Shown(progress, options)

    def evaluator(chosen: Sequence[View], first_frame: int) -> FrameEvaluator:
        return FrameEvaluator(
            chosen,
            options.frame_count,
            base,
            parameters,
            source,
            ledger,
            first_frame=first_frame,
            tell=shown.evaluation,
        )

    training = evaluator(views, 0)
    start = np.array([each.inner(each.read(base)) for each in parameters])
    is_pushed = options.method not in WITHOUT_DERIVATIVES
    fit = Fit(training, start, options.limits, is_pushed=is_pushed)
    _require_errors(fit, views)
    minimum = _minimise(fit, parameters, start, options, shown)
    end, fitted = minimum.point, point_config(base, parameters, minimum.point)
    bounds = np.array([each.inner_bounds for each in parameters])
    uncertainty = None
    if options.method not in WITHOUT_DERIVATIVES:
        uncertainty = fit.uncertainty(end, bounds[:, 0], bounds[:, 1])
    frames = fit.frames(end)
    held_out = evaluator(unseen, options.frame_count)
    configs = (base, fitted)
    shown.stage("measuring")
    result = FitResult(
        base=base,
        fitted=fitted,
        parameters=parameters,
        start=start,
        end=end,
        uncertainty=uncertainty,
        minimum=minimum,
        objective=(fit.objective(fit.frames(start)), fit.objective(frames)),
        training=[
            compare_view(view, training, number, configs, source)
            for number, view in enumerate(views)
        ],
        held_out=[
            compare_view(view, held_out, number, configs, source)
            for number, view in enumerate(unseen)
        ],
        limits=[(each, each.mean(frames[each.scene])) for each in fit.limits],
        seconds=time.monotonic() - began,
        reused_count=ledger.reused_count,
    )
    shown.done()
    return result


def fit_config(options: FitOptions) -> RenderConfig:
    """Return the configuration that a fit starts from."""
    base = vctgi.preset(options.preset)
    if options.clipmap_resolution is None:
        return base
    clipmap = replace(base.clipmap, resolution=options.clipmap_resolution)
    return replace(base, clipmap=clipmap)


def check_options(options: FitOptions) -> list[Parameter]:
    """Return the parameters of a fit, or refuse what does not fit together.

    Raises
    ------
    InputError
        No scene, a discrete choice for a method with derivatives, too many parameters for it, or
        too few frames for intervals.
    """
    parameters = find_parameters(options.parameters, fit_config(options))
    discrete = [each.name for each in parameters if each.options is not None]
    if not options.scenes:
        raise InputError(what="no scene is named", where="SCENE", remedy="name at least one")
    if options.method not in WITHOUT_DERIVATIVES and discrete:
        raise InputError(
            what=f"'{discrete[0]}' is a discrete choice, which has no derivative",
            where="--parameters",
            remedy="use --method evolution or optuna, or leave it out",
        )
    if options.method == "gauss-newton" and len(parameters) > MOST_GAUSS_NEWTON:
        raise InputError(
            what=f"{len(parameters)} parameters are too many for Gauss-Newton",
            where="--parameters",
            remedy=f"give at most {MOST_GAUSS_NEWTON}, or use --method adam",
        )
    return parameters


def view_names(options: FitOptions) -> tuple[list[ViewName], list[ViewName]]:
    """Return training and held-out views.

    Raises
    ------
    InputError
        A held-out scene that is also trained on.
    """
    both = [scene for scene in options.held_out if scene in options.scenes]
    if both:
        raise InputError(
            what=f"'{both[0]}' is trained on",
            where="--held-out",
            remedy="hold out another scene; turned views of training scenes are measured anyway",
        )
    training = [ViewName(scene=scene) for scene in dict.fromkeys(options.scenes)]
    held_out = [ViewName(scene=scene) for scene in dict.fromkeys(options.held_out)]
    if options.has_turned_views:
        held_out += [ViewName(scene=each.scene, is_turned=True) for each in training]
    return training, held_out


MOST_NOISE = 4.0
"""Largest noise of a reference over the error at the start, both relative and squared. Noise is
taken out of the error, but not what is uncertain of the noise."""


def _require_errors(fit: Fit, views: Sequence[View]) -> None:
    """Refuse a scene whose error at the start is lost in the noise of its reference."""
    for view, error in zip(views, fit.start_errors, strict=True):
        if error <= max(LEAST_ERROR, view.noise / MOST_NOISE):
            raise InputError(
                what="the error at the start is lost in the noise of the reference",
                where=view.name.title,
                remedy="give more --spp",
            )


def _minimise(
    fit: Fit, parameters: list[Parameter], start: np.ndarray, options: FitOptions, shown: _Shown
) -> Minimum:
    low, high = np.array([each.inner_bounds for each in parameters]).T
    if options.method in WITHOUT_DERIVATIVES:
        search = minimise_by_trials if options.method == "optuna" else minimise_by_evolution
        return search(
            fit, parameters, start, trials=options.iterations, seed=options.seed, tell=shown.point
        )
    if options.method == "adam":
        steps = AdamOptions(iterations=options.iterations)
        return minimise_by_adam(fit, start, low, high, steps, shown.point)
    return minimise(fit, start, low, high, StopRule(evaluations=options.iterations), shown.point)


class _Shown:
    """What a reader of the progress sees."""

    def __init__(self, progress: Progress, options: FitOptions) -> None:
        self._progress = progress
        self._most = options.iterations
        self._stage = "start"
        self._share = 0.0

    def point(self, count: int) -> None:
        """Say that a point is tried."""
        self._stage = f"fitting, point {count} of at most {self._most}"
        self._share = (count - 1) / self._most
        self._progress("fitting", self._share)

    def evaluation(self, title: str) -> None:
        """Say that a frame is rendered."""
        self._progress(f"{self._stage}: {title}", self._share)

    def stage(self, name: str) -> None:
        """Say that something else begins."""
        self._stage, self._share = name, 0.0

    def done(self) -> None:
        """Say that all is done."""
        self._progress("measuring", 1.0)
