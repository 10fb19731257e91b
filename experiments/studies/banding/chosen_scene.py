"""B1 of any scene: how its glossy light changes with the start phase of all specular marches."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

import vctgi
from experiments.errors import InputError
from experiments.scenes import load_scene
from experiments.studies.accuracy.glossy import GlossyView
from experiments.studies.banding.maps import add_spread_map
from experiments.studies.banding.sweeps import PHASE_COUNT, PHASE_STEP, TREATMENTS, WAYS
from experiments.studies.check import Check, Measured, StudyContext
from metrics.banding import phase_spread
from metrics.confidence import estimate_from_leave_one_out
from metrics.luminance import luminance
from vctgi.stages.reconstruction.denoising import SpecularFilterConfig

CHOSEN = "chosen scene"
"""The scene of `--scene`; without one, the glossy floor as it is built in."""

EDGE = (128, 64)
"""Pixels along an edge, in the whole study and in the quick one."""


def checks() -> list[Check]:
    """Return the checks of the chosen scene."""
    return [
        Check(
            name=f"{CHOSEN}, B1, {treatment}",
            configuration=f'preset "high", noise {TREATMENTS[treatment][0]}, '
            f"filter {TREATMENTS[treatment][1]}, {PHASE_COUNT} start phases",
            scene="glossy_floor, or the scene of --scene, specular light",
            measure=partial(_spread, treatment=treatment),
            goal=0.0,
            in_quick=False,
            is_headline=True,
        )
        for treatment in TREATMENTS
    ]


def _view(context: StudyContext) -> tuple[str, GlossyView, np.ndarray]:
    """Return the scene's title, its view, and where it is glossy [row, column].

    Raises
    ------
    InputError
        The camera sees nothing glossy.
    """
    source, edge = context.scene or "glossy_floor", EDGE[context.quick]
    loaded = load_scene(source, resolution=(edge, edge))
    config = vctgi.preset("high")
    sensor = loaded.scene.sensors()[loaded.sensor_index]
    prepared = vctgi.prepare_scene(loaded.scene, sensor, config)
    refusal = InputError(
        what="the camera sees no glossy surface, so there is no specular march to look for bands",
        where=source,
        remedy="leave out the checks of banding's chosen scene, or name a scene with glossy "
        "materials in view",
    )
    if not prepared.plan.has_specular:
        raise refusal
    view = GlossyView(edge, prepared, vctgi.light_volume(prepared, config).volume, config)
    gbuffer = view.gbuffer(config)
    albedo = np.array(gbuffer.specular_albedo).max(axis=0)
    is_glossy = (np.array(gbuffer.is_valid) & (albedo > 0.0)).reshape(edge, edge)
    if not is_glossy.any():
        raise refusal
    return loaded.title, view, is_glossy


def _spread(context: StudyContext, treatment: str) -> Measured:
    title, view, is_glossy = context.once("bands, chosen scene", partial(_view, context))
    noise, kind = TREATMENTS[treatment]
    pictures = []
    for number in range(PHASE_COUNT):
        context.progress("start phases", number / PHASE_COUNT)
        specular = replace(
            view.config.specular, noise=noise, phase_offset=number * PHASE_STEP % 1.0
        )
        config = replace(
            view.config, specular=specular, specular_filter=SpecularFilterConfig(kind=kind)
        )
        pictures.append(luminance(view.render(config)))
    found = np.stack(pictures)
    if treatment == "off":
        context.shelf.add_picture(title, "Specular light, no noise, no filter", view.render(config))
    add_spread_map(context.shelf, title, WAYS[treatment], found, is_glossy)
    without_one = [
        phase_spread(np.delete(found, left_out, axis=0), is_glossy)
        for left_out in range(PHASE_COUNT)
    ]
    estimate = estimate_from_leave_one_out(phase_spread(found, is_glossy), np.array(without_one))
    return Measured(value=estimate.value, low=estimate.low, high=estimate.high)
