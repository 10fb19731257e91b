"""Everything together: a scene that needs little, and one that needs all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.scenes.parts import SceneDict
from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.elimination.comparison import Comparison, loaded_scene, study_config
from experiments.studies.elimination.figures import Savings, draw_frames
from experiments.studies.elimination.frames import Pair, Render, following_frames, single_frames
from experiments.studies.elimination.scenes import court, everything
from vctgi.config import RenderConfig
from vctgi.eliminations import ALL
from vctgi.pipeline import prepare_scene

LEAST_GAIN = 3.0
"""Times faster that a frame of the scene that needs little has to be."""

MOST_LOSS = 1.02
"""What a frame of the scene that needs all may cost, over one that leaves nothing out."""

WHOLE_TURNS = 25
"""Frames of each kind that are timed, at least: with eight the shortest of both kinds, the same
kernels where everything is needed, were up to 3 % apart."""

LEVELS_NEEDED = 4
"""Most clip levels of the scene that needs all, which it needs."""

GPU_RESOLUTION = 256
"""Voxels along an edge of a level in the scene that needs little, where a GPU renders it. With 128
a frame takes an H200 less time to compute than to launch, whatever is left out; with 256 and all
kept it needs 25 GB."""

LAMP, STEP = "lamp.position", 0.1
"""Parameter that moving frames change, and by how much."""


@dataclass(frozen=True, kw_only=True)
class Whole:
    """A scene with everything left out that can be, and with everything kept.

    Attributes
    ----------
    name, about
        Of the rows.
    scene
        Makes it for a size of the picture, pixels.
    frames
        Makes its frames.
    change
        Changes the configuration.
    in_quick
        Whether the quick version of the study measures it.
    """

    name: str
    about: str
    scene: Callable[[int], SceneDict]
    frames: Callable[[mi.Scene, RenderConfig], Render]
    change: Callable[[RenderConfig], RenderConfig] = lambda config: config
    in_quick: bool = True


def _moving(scene: mi.Scene, config: RenderConfig) -> Render:
    """Return what makes frames in which the lamp moves to and fro."""
    parameters = mi.traverse(scene)
    start = np.array(parameters[LAMP], dtype=np.float64).ravel()

    def change(number: int) -> None:
        x, y, z = start.tolist()
        parameters[LAMP] = mi.Point3f(x + STEP * (number % 2), y, z)
        parameters.update()

    return following_frames(scene, config, change)


def _needing_all(config: RenderConfig) -> RenderConfig:
    return replace(
        config,
        clipmap=replace(config.clipmap, max_level_count=LEVELS_NEEDED),
        sky_in_cones=True,
        scattering_count=3,
        bounce_cones=replace(config.bounce_cones, cone_count=6, near_field_voxels=0.0),
        slot_surfaces=replace(config.slot_surfaces, samples_per_face=1.0),
    )


def _needing_little(config: RenderConfig) -> RenderConfig:
    if dr.backend_v(mi.Float) != dr.JitBackend.CUDA:
        return config
    return replace(config, clipmap=replace(config.clipmap, resolution=GPU_RESOLUTION))


_COURT = (
    "two walls, ground, one lamp, all diffuse, held by one level, on a GPU of "
    f"{GPU_RESOLUTION}^3 voxels"
)

STILL = Whole(
    name="scene that needs little, frame after frame",
    about=f"{_COURT}; nothing moves",
    scene=court,
    frames=following_frames,
    change=_needing_little,
)
MOVING = Whole(
    name="scene that needs little, its lamp moving",
    about=f"{_COURT}; the scene is read anew in each frame",
    scene=court,
    frames=_moving,
    change=_needing_little,
)
SINGLE = Whole(
    name="scene that needs little, voxels to picture",
    about=f"{_COURT}; from scratch, without reading the scene",
    scene=court,
    frames=partial(single_frames, with_reading=False),
    in_quick=False,
    change=_needing_little,
)
NEEDY = Whole(
    name="scene that needs all",
    about="mirror, rough metal and plastic, mask, thin glass, sky, bounces, surfaces at all levels "
    "that face all ways; from scratch, without reading the scene",
    scene=everything,
    frames=partial(single_frames, with_reading=False),
    change=_needing_all,
)


def compare_whole(context: StudyContext, whole: Whole) -> Comparison:
    """Render a scene both ways, once for all its numbers."""

    def measure() -> Comparison:
        context.progress(whole.name, 0.0)
        scene = loaded_scene(context, whole.scene)
        config = whole.change(study_config(quick=context.quick))
        pair = Pair.of(partial(whole.frames, scene), config, ALL)
        found = Comparison.of(context, pair, WHOLE_TURNS)
        draw_frames(context.shelf, whole.name, found.lean_times, found.kept_times)
        light = found.lean.frame.indirect_diffuse + found.lean.frame.indirect_specular
        subject = whole.name.partition(",")[0]
        context.shelf.add_picture(
            "Everything together", f"{subject}: indirect light", np.array(light)
        )
        return found

    return context.once(f"elimination, {whole.name}", measure)


def whole_checks(savings: Callable[[StudyContext], Savings]) -> list[Check]:
    """Return the rows of everything together; the last draws what the cases before it saved."""

    def row(whole: Whole, what: str, measure: Callable[[Comparison], Measured]) -> Check:
        return Check(
            in_quick=whole.in_quick,
            name=f"{whole.name}: {what}",
            configuration="--keep all against nothing kept",
            scene=whole.about,
            measure=lambda context: measure(compare_whole(context, whole)),
        )

    faster = "device time, kept over left out"
    rows = [
        replace(
            row(STILL, faster, lambda found: found.time_ratio),
            limit_low=LEAST_GAIN,
            is_headline=True,
        ),
        row(STILL, "peak memory saved, MiB", lambda found: found.memory_saved),
        replace(row(MOVING, faster, lambda found: found.time_ratio), limit_low=1.0),
        replace(row(SINGLE, faster, lambda found: found.time_ratio), limit_low=1.0),
        row(SINGLE, "peak memory saved, MiB", lambda found: found.memory_saved),
        replace(
            row(NEEDY, "device time, left out over kept", lambda found: found.least_time_ratio),
            limit_high=MOST_LOSS,
            is_headline=True,
        ),
        replace(
            row(NEEDY, "counted operations, kept over left out", lambda f: f.operation_ratio),
            limit_low=1.0 / MOST_LOSS,
        ),
    ]
    rows += [
        replace(
            row(whole, "numbers of the picture that differ", lambda found: found.difference(None)),
            limit_low=0.0,
            limit_high=0.0,
        )
        for whole in (STILL, MOVING, SINGLE, NEEDY)
    ]
    return [
        *rows,
        Check(
            name="scene that needs all: eliminations that apply to it",
            configuration="the plan",
            scene=NEEDY.about,
            measure=partial(_applying, savings=savings),
            limit_low=0.0,
            limit_high=0.0,
        ),
    ]


def _applying(context: StudyContext, *, savings: Callable[[StudyContext], Savings]) -> Measured:
    """Count what the plan leaves out of the scene that needs all, as its needs go."""
    savings(context).draw(context.shelf)
    scene = loaded_scene(context, everything)
    config = _needing_all(study_config(quick=context.quick))
    entries = prepare_scene(scene, scene.sensors()[0], config).plan.entries
    applying = [e.item for e in entries if not e.kept and e.override.startswith("--keep")]
    return Measured(value=float(len(applying)), note=", ".join(applying))
