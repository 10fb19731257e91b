"""Whether quality rises from preset to preset, on every scene.

Each step up has to lower the error of the whole indirect light against the path tracer. What is
reported is the relative MSE and FLIP of each preset, and their ratio to those of the preset below.

On the glossy floor the relative MSE does not fall from "medium" to "high", and is not asked to. A
voxel sends out what a glossy surface reflects alike in all directions, so the box and the ball
there are lit by the mirroring floor as if it were diffuse: four fifths of the error lie on them.
"medium", which loses a tenth of all light, hides a part of that. FLIP falls there as everywhere.
"""

from __future__ import annotations

from functools import partial

import metrics
import reference
import vctgi
from experiments.run import component_images
from experiments.scenes import load_scene
from experiments.studies.check import Check, Measured, StudyContext

SCENES = ("cornell_box", "sealed_rooms", "glossy_floor", "open_sky")

LADDER = ("medium", "high", "ultra")
"""Presets that render light, from cheap to dear."""

ERRORS = {"relmse_e2": "relMSE", "flip": "FLIP"}
"""Measures of `metrics.measure` by what a table calls them."""

UNASKED = {("glossy_floor", "relmse_e2")}
"""What does not have to fall, for the reason that the module gives."""

EDGE = (128, 64)
SAMPLES = (2048, 256)
"""Picture in pixels, and paths a pixel of the reference, in the whole study and in the quick
one."""


def checks() -> list[Check]:
    """Return the checks of the presets."""
    found = []
    for scene in SCENES:
        for error, title in ERRORS.items():
            for number, preset in enumerate(LADDER):
                found.append(
                    Check(
                        name=f"preset {preset}, {scene}, {title}",
                        configuration=f'preset "{preset}"',
                        scene=f"built-in {scene}, all indirect light, matched path tracing",
                        measure=partial(_error, scene=scene, preset=preset, error=error),
                        goal=0.0,
                    )
                )
                if number == 0:
                    continue
                below = LADDER[number - 1]
                found.append(
                    Check(
                        name=f"preset {preset} over {below}, {scene}, {title}",
                        configuration=f'preset "{preset}" over preset "{below}"',
                        scene=f"built-in {scene}, all indirect light, matched path tracing",
                        measure=partial(_ratio, scene=scene, pair=(preset, below), error=error),
                        limit_high=None if (scene, error) in UNASKED else 1.0,
                    )
                )
    return found


def _errors(context: StudyContext, scene: str, preset: str) -> dict[str, float]:
    """Errors of a preset, by name."""

    def compare() -> dict[str, float]:
        loaded = load_scene(scene, resolution=EDGE[context.quick])
        sensor = loaded.scene.sensors()[loaded.sensor_index]
        request = reference.ReferenceRequest(
            samples_per_pixel=SAMPLES[context.quick], batch_count=8, scattering_count=2, seed=0
        )
        truth = context.once(
            f"presets, truth of {scene}",
            lambda: reference.render_reference(
                loaded.scene,
                sensor=loaded.sensor_index,
                request=request,
                cache_directory=None,
                progress=lambda share: context.progress(f"path tracing {scene}", share),
            ),
        )
        context.progress(f"{preset}, {scene}", 0.0)
        config = vctgi.preset(preset)
        prepared = vctgi.prepare_scene(loaded.scene, sensor, config)
        frame = vctgi.render_frame(prepared, vctgi.light_volume(prepared, config).volume, config)
        batches = truth.batches("indirect")
        whole = batches + truth.mean("emission") + truth.mean("direct")
        measured = metrics.measure(
            component_images(frame)["indirect"],
            batches,
            component="indirect",
            display=metrics.display_settings(whole.mean(axis=0)),
        )
        return {value.name: value.value for value in measured}

    return context.once(f"presets, {scene}, {preset}", compare)


def _error(context: StudyContext, scene: str, preset: str, error: str) -> Measured:
    return Measured(value=_errors(context, scene, preset)[error])


def _ratio(context: StudyContext, scene: str, pair: tuple[str, str], error: str) -> Measured:
    """Error of a preset over that of the one below: under 1, quality rises."""
    upper, lower = (_errors(context, scene, preset)[error] for preset in pair)
    return Measured(value=upper / lower)
