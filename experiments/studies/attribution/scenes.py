"""Scenes whose error is attributed, and their ledgers."""

from __future__ import annotations

from dataclasses import dataclass

import mitsuba as mi
import numpy as np

import reference
import vctgi
from experiments.scenes import load_scene
from experiments.studies.attribution.figures import add_waterfall
from experiments.studies.attribution.pictures import (
    Effort,
    make_volumes,
    render_batches,
    that_matters,
)
from experiments.studies.attribution.stages import (
    STAGE_TITLES,
    STAGES,
    Exact,
    first_exact,
    last_exact,
)
from experiments.studies.check import StudyContext
from experiments.studies.light.bounces import small_config
from experiments.studies.light.emitter_pictures import court
from experiments.studies.noise import require_told_apart
from metrics.attribution import Attribution, attribute_error
from vctgi.config import RenderConfig

EDGE = (48, 20)
"""Pixels along the longer edge, in the whole study and in the quick one."""

EFFORT = (
    Effort(batch_count=8, marched_rays=4, traced_rays=32, sparse_repeats=16),
    Effort(batch_count=8, marched_rays=1, traced_rays=32, sparse_repeats=8),
)

PATH_COUNT = 4096
"""Paths a pixel of the reference over all batches."""

CHOSEN = "chosen scene"
"""The scene of `--scene`; without one, that of a corridor of rooms."""


@dataclass(frozen=True)
class Case:
    """One scene.

    Attributes
    ----------
    title
        How the page calls it.
    scene, sensor
        Mitsuba's, and the number of the camera.
    config
        The renderer as it is.
    """

    title: str
    scene: mi.Scene
    sensor: int
    config: RenderConfig


@dataclass(frozen=True)
class Ledger:
    """The error of a scene by stages, as energy and as relMSE."""

    energy: Attribution
    relmse: Attribution


SCENES = {
    "Cornell box": "cornell_box",
    "sealed rooms": "sealed_rooms",
    "open court": "a court without a front and a ceiling, under an even sky",
    CHOSEN: "corridor",
}
"""What each scene is made from."""


def ledger_of(context: StudyContext, name: str) -> Ledger:
    """Return the ledger of a scene, made once in a study."""
    return context.once(f"attribution, {name}", lambda: _attribute(context, name))


def load_case(context: StudyContext, name: str) -> Case:
    """Load a scene at the study's size.

    The built-in ones have preset "high" in 64^3 voxels, a scene that is named in 128^3.
    """
    edge = EDGE[context.quick]
    if name == "open court":
        return Case("Open court", court("constant", edge), 0, small_config())
    is_given = name == CHOSEN and context.scene is not None
    loaded = load_scene(
        context.scene if is_given and context.scene else SCENES[name], resolution=edge
    )
    config = vctgi.preset("high") if is_given else small_config()
    return Case(loaded.title, loaded.scene, loaded.sensor_index, config)


def _attribute(context: StudyContext, name: str) -> Ledger:
    case, effort = load_case(context, name), EFFORT[context.quick]
    truth = reference.render_reference(
        case.scene,
        sensor=case.sensor,
        request=reference.ReferenceRequest(
            samples_per_pixel=PATH_COUNT,
            batch_count=effort.batch_count,
            scattering_count=case.config.scattering_count,
            seed=0,
            rest_samples_per_pixel=0,
        ),
        cache_directory=None,
        progress=lambda share: context.progress(f"path tracing, {name}", share),
    ).batches("indirect_diffuse")
    forward, backward = _both_orders(context, case, effort, name)
    require_told_apart(forward[0].mean(axis=0), truth, PATH_COUNT, f"the reference of {name}")
    titles = [STAGE_TITLES[stage] for stage in STAGES]
    ledger = Ledger(
        energy=attribute_error("energy", titles, forward, backward, truth),
        relmse=attribute_error("relmse", titles, forward, backward, truth),
    )
    add_waterfall(context.shelf, case.title, ledger.energy, ledger.relmse)
    return ledger


def _both_orders(
    context: StudyContext, case: Case, effort: Effort, name: str
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Pictures of both orders, each renderer run once."""
    prepared = vctgi.prepare_scene(case.scene, case.scene.sensors()[case.sensor], case.config)
    volumes = make_volumes(prepared, case.config)
    found: dict[Exact, np.ndarray] = {}

    def picture(exact: Exact) -> np.ndarray:
        needed = that_matters(exact, case.config)
        if needed not in found:
            found[needed] = render_batches(
                prepared,
                volumes,
                case.config,
                needed,
                effort,
                lambda share: context.progress(f"{name}, renderer {len(found) + 1}", share),
            )
        return found[needed]

    counts = range(len(STAGES) + 1)
    return [picture(first_exact(n)) for n in counts], [picture(last_exact(n)) for n in counts]
