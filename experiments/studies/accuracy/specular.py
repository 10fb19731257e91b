"""Specular cones: their fit to lobes, the bands they leave, their pictures against the truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np

import metrics
from experiments.studies.accuracy.glossy import (
    RESOLUTION,
    glossy_view,
    path_traced_batches,
    relative_residual,
)
from experiments.studies.accuracy.true_lobes import true_lobe_cone
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from metrics.banding import phase_spread, structured_power
from vctgi.maths.lobes import DISTRIBUTIONS, TABLES, LobeDistribution, read_lobe_cone
from vctgi.stages.cone_tracing.specular import SpecularConesConfig, specular_march
from vctgi.stages.gbuffer import GBufferConfig
from vctgi.stages.reconstruction.denoising import SpecularFilterConfig

COATED = {"roughconductor": False, "roughplastic": True}
"""BSDFs whose lobes have tables: whether with the Fresnel factor of a coat."""

ALPHAS = (0.01, 0.03, 0.1, 0.2, 0.35, 0.5, 0.8)
DEGREES = (0.0, 30.0, 60.0, 80.0)
"""Roughness and incidence of the lobes that tables are compared with."""

LARGEST_APERTURE_ERROR = 0.02
"""Relative. A percent of an aperture moves the picture less than the grid's phase does."""

LARGEST_TILT_ERROR = 0.02
"""Of the axis, over the aperture."""

ROUGHNESS = (0.05, 0.1, 0.2, 0.4, 0.8)
"""GGX width of the glossy floor."""

BAND_ALPHA = 0.1
"""GGX width of the floor that bands are looked for on: the scene's own."""

PHASE_COUNT = 8
PHASE_STEP = 17.0 / 128.0
"""Start phases: spread evenly over a step and, modulo the 16 steps of the noise, over those too."""

LEAST_GAIN = 4.0
"""By how much noise and filter together must lower bands."""

STEP_VOXELS = 1.0
SAMPLE_COUNT = 4
"""Samples a pixel of the pictures that are compared with path tracing."""


def checks() -> list[Check]:
    """Return the checks of specular cones."""
    return [*_lobes(), *_bands(), *_pictures()]


def _lobes() -> list[Check]:
    found = []
    for distribution in DISTRIBUTIONS:
        for kind in COATED:
            for name, measure, limit in (
                ("aperture", _aperture_error, LARGEST_APERTURE_ERROR),
                ("axis over aperture", _tilt_error, LARGEST_TILT_ERROR),
            ):
                found.append(
                    Check(
                        name=f"lobe of {kind}, {distribution}, largest error of {name}",
                        configuration=f"table against integral, alpha {ALPHAS[0]:g}.."
                        f"{ALPHAS[-1]:g}, incidence {DEGREES[0]:g}..{DEGREES[-1]:g} degrees",
                        scene=f"Mitsuba's {kind}",
                        measure=partial(measure, distribution=distribution, kind=kind),
                        limit_high=limit,
                        goal=0.0,
                    )
                )
    for alpha in ROUGHNESS:
        found.append(
            Check(
                name=f"lobe by samples, alpha {alpha:g}, spread of the aperture over pixels",
                configuration=f"{GBufferConfig().lobe_sample_count} samples of the BSDF; the "
                "table has none",
                scene="glossy_floor, GGX",
                measure=partial(_sampling_noise, alpha=alpha),
                goal=0.0,
            )
        )
    return found


def _lobe_errors(
    context: StudyContext, distribution: LobeDistribution, kind: str
) -> list[tuple[float, float]]:
    """Relative error of the aperture, and of the axis over the aperture, of each lobe."""

    def compare() -> list[tuple[float, float]]:
        found = []
        table = mi.UInt32(TABLES.index((distribution, COATED[kind])))
        for alpha in ALPHAS:
            for degrees in DEGREES:
                cosine = math.cos(math.radians(degrees))
                exact = true_lobe_cone(distribution, alpha, cosine, kind)
                aperture, tilt = read_lobe_cone(table, mi.Float(alpha), mi.Float(cosine))
                found.append(
                    (
                        abs(float(aperture[0]) / exact.aperture - 1.0),
                        abs(float(tilt[0]) - exact.tilt) / exact.aperture,
                    )
                )
        return found

    return context.once(f"lobes, {distribution}, {kind}", compare)


def _aperture_error(context: StudyContext, distribution: LobeDistribution, kind: str) -> Measured:
    return Measured(value=max(error for error, _ in _lobe_errors(context, distribution, kind)))


def _tilt_error(context: StudyContext, distribution: LobeDistribution, kind: str) -> Measured:
    return Measured(value=max(error for _, error in _lobe_errors(context, distribution, kind)))


def _sampling_noise(context: StudyContext, alpha: float) -> Measured:
    """Root mean square of neighbours' relative difference: pixels next to each other see alike."""
    view = glossy_view(context, alpha)
    config = replace(view.config, gbuffer=GBufferConfig(lobe_cones="sampled"))
    sampled = view.gbuffer(config)
    is_glossy = np.array(sampled.is_valid & (dr.max(sampled.specular_albedo) > 0.0))
    aperture = np.where(is_glossy, np.array(sampled.specular_aperture), np.nan)
    rows = aperture.reshape(view.edge, view.edge)
    difference = np.diff(rows, axis=1) / (0.5 * (rows[:, 1:] + rows[:, :-1]))
    return Measured(value=math.sqrt(float(np.nanmean(difference**2)) / 2.0))


@dataclass(frozen=True)
class Sweep:
    """B1 and B2 over start phases."""

    spread: float
    powers: list[float]
    powers_of_truth: list[float]


TREATMENTS = {"off": ("none", "none"), "on": ("blue", "bilateral")}
"""Noise and filter."""


def _bands() -> list[Check]:
    scene = f"glossy_floor, alpha {BAND_ALPHA:g}, specular light"
    found = []
    for treatment, (noise, kind) in TREATMENTS.items():
        configuration = f"steps of {STEP_VOXELS:g} voxel, N = {RESOLUTION}, noise {noise}, "
        for name, measure in (
            ("B1", _spread),
            ("B2", _power),
            ("B2 against path tracing", _power_of_truth),
        ):
            found.append(
                Check(
                    name=f"banding {name}, noise and filter {treatment}",
                    configuration=configuration + f"filter {kind}",
                    scene=scene,
                    measure=partial(measure, treatment=treatment),
                    goal=0.0,
                )
            )
    for name, gain in (("B1", _gain_of_spread), ("B2", _gain_of_power)):
        found.append(
            Check(
                name=f"banding {name}, off over on",
                configuration=f"steps of {STEP_VOXELS:g} voxel, N = {RESOLUTION}",
                scene=scene,
                measure=gain,
                limit_low=LEAST_GAIN,
            )
        )
    return found


def _sweep(context: StudyContext, treatment: str) -> Sweep:
    """Render at every start phase.

    B2 takes the residual against the mean over the phases, which has no bands and every other error
    of the method; against path tracing those errors fall on the bands' waves too.
    """

    def render() -> Sweep:
        view = glossy_view(context, BAND_ALPHA)
        noise, kind = TREATMENTS[treatment]
        march = specular_march(STEP_VOXELS)
        pictures = []
        for number in range(PHASE_COUNT):
            context.progress("start phases", number / PHASE_COUNT)
            cones = SpecularConesConfig(
                noise=noise,  # type: ignore[arg-type]  # words of the table above
                phase_offset=number * PHASE_STEP % 1.0,
                march=march,
            )
            filtered = SpecularFilterConfig(kind=kind)  # type: ignore[arg-type]  # as above
            pictures.append(
                view.render(replace(view.config, specular=cones, specular_filter=filtered))
            )
        steps, mask = view.cycles(march)
        mean = np.mean(pictures, axis=0)
        truth = path_traced_batches(context, BAND_ALPHA).mean(axis=0)
        own, other = (
            [structured_power(relative_residual(each, to), steps, mask) for each in pictures]
            for to in (mean, truth)
        )
        return Sweep(phase_spread(pictures, mask), own, other)

    return context.once(f"bands, {treatment}", render)


def _spread(context: StudyContext, treatment: str) -> Measured:
    return Measured(value=_sweep(context, treatment).spread)


def _power(context: StudyContext, treatment: str) -> Measured:
    return mean_of(_sweep(context, treatment).powers)


def _power_of_truth(context: StudyContext, treatment: str) -> Measured:
    return mean_of(_sweep(context, treatment).powers_of_truth)


def _gain_of_spread(context: StudyContext) -> Measured:
    return Measured(value=_sweep(context, "off").spread / _sweep(context, "on").spread)


def _gain_of_power(context: StudyContext) -> Measured:
    """Ratio of the powers; the filtered one is at least as large as its spread, which is chance."""
    off, on = (np.array(_sweep(context, each).powers) for each in TREATMENTS)
    rest = max(float(on.mean()), float(on.std(ddof=1)))
    return Measured(value=float(off.mean()) / rest)


CONES = {
    "default": (GBufferConfig(), SpecularConesConfig()),
    "sampled lobes": (GBufferConfig(lobe_cones="sampled"), SpecularConesConfig()),
    "one cone": (GBufferConfig(), SpecularConesConfig(rough_cone_count=1)),
}
"""What the pictures compare: where cones come from, and whether rough lobes are split."""


def _pictures() -> list[Check]:
    rows: list[tuple[str, Callable[..., Measured], float]] = [
        ("FLIP", partial(_measured, metric="flip"), 0.0),
        ("relMSE", partial(_measured, metric="relmse_e2"), 0.0),
        ("energy ratio", partial(_measured, metric="energy_ratio"), 1.0),
    ]
    return [
        Check(
            name=f"glossy floor, alpha {alpha:g}, {cones}, {name}",
            configuration=f"{cones}, N = {RESOLUTION}, {SAMPLE_COUNT} samples a pixel",
            scene="glossy_floor, GGX, specular light of two scatterings, matched path tracing",
            measure=partial(measure, alpha=alpha, cones=cones),
            goal=goal,
        )
        for cones in CONES
        for alpha in ROUGHNESS
        for name, measure, goal in rows
    ]


def _measured(context: StudyContext, metric: str, alpha: float, cones: str) -> Measured:
    def compare() -> list[metrics.Measurement]:
        view = glossy_view(context, alpha)
        gbuffer, specular = CONES[cones]
        config = replace(view.config, gbuffer=gbuffer, specular=specular)
        batches = path_traced_batches(context, alpha)
        display = metrics.display_settings(batches.mean(axis=0))
        return metrics.measure(
            view.render(config, SAMPLE_COUNT),
            batches,
            component="indirect_specular",
            display=display,
        )

    measured = context.once(f"glossy floor, {alpha}, {cones}", compare)
    found = next(each for each in measured if each.name == metric)
    return Measured(value=found.value, low=found.low, high=found.high)
