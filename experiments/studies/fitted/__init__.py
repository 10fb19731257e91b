"""Study "fitted": what fitted presets are worth, and what bounds any fit.

Start reading at `budget.py`: how much of a frame's error belongs to noise, to sparse pixels, to the
number of cones, and to what no setting of the cones takes away.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import vctgi
from experiments.scenes import BUILT_IN
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.fitted.budget import MANY_CONES, PRESET, Budget, budget_of
from experiments.studies.fitted.comparison import Comparison, comparison_of
from reports.study_figures import Definition
from vctgi.preset_file import read_preset_file

CHOSEN = "chosen scene"
"""The scene of `--scene`; without one, the Cornell box again."""

IN_QUICK = ("cornell_box",)

LEAST_GAIN = 0.7
"""Goal of the error over that before, in scenes that a fit never saw."""

MOST_COST = 1.02
"""Limit of what cones read over that before: what a fit allows itself."""

TITLES = {
    "frame": "relMSE of a frame",
    "noise": "relMSE owned by noise of one frame",
    "sparse": "relMSE owned by sparse pixels",
    "cones": f"relMSE owned by 17 cones in place of {MANY_CONES}",
    "rest": f"relMSE left with {MANY_CONES} dense cones",
}

DEFINITIONS = (
    Definition(
        name="relMSE",
        formula="mean of (V - R)^2 / (R^2 + 0.01 (mean R)^2), the noise of R taken out; indirect "
        "diffuse light, V one frame at its own place in the lattice of the voxels",
        source="experiments/optimize/target.py; metrics/squared_error.py",
    ),
    Definition(
        name="owned by",
        formula="frame less the product of two frames of other random numbers (noise), that less "
        "the same of dense pixels (sparse pixels), that less the same of 64 cones (cones)",
        source="experiments/studies/fitted/budget.py",
    ),
    Definition(
        name="over that of high",
        formula="mean over frames of the fitted preset over that of the other; the same places and "
        "random numbers, which no fit of up to 64 frames had",
        source="experiments/studies/fitted/comparison.py",
    ),
)


def checks() -> list[Check]:
    """Return the rows of all scenes."""
    scenes = [*BUILT_IN, CHOSEN]
    rows = [
        _compared(scene, preset, kind.name)
        for preset in vctgi.config.shipped_presets()
        for scene in scenes
        for kind in fields(Comparison)
    ]
    return [*rows, *(_share(scene, each.name) for scene in scenes for each in fields(Budget))]


def _share(scene: str, share: str) -> Check:
    def measure(context: StudyContext) -> Measured:
        return mean_of(getattr(budget_of(context, _scene_of(context, scene)), share))

    return _check(scene, f"{scene}, {TITLES[share]}", f'preset "{PRESET}"', measure)


def _compared(scene: str, preset: str, kind: str) -> Check:
    def measure(context: StudyContext) -> Measured:
        found = comparison_of(context, _scene_of(context, scene), preset)
        if kind == "error":
            ratio = found.error
            return Measured(value=ratio.value, low=ratio.low, high=ratio.high)
        return Measured(value=getattr(found, kind))

    trained = read_preset_file(vctgi.config.shipped_presets()[preset]).record["scenes"]
    role = "trained on" if scene in trained else "held out"
    if scene == CHOSEN:
        role = f"trained on {', '.join(trained)}"
    check = _check(
        scene, f"{preset}, {scene}, {COMPARED[kind]}", f'preset "{preset}", {role}', measure
    )
    if kind == "error":
        return replace(check, goal=LEAST_GAIN, is_headline=True)
    return replace(check, limit_high=MOST_COST if kind == "work" else None, goal=1.0)


COMPARED = {
    "error": f"relMSE over that of {PRESET}",
    "samples": f"samples of voxels over those of {PRESET}",
    "rays": f"near-field rays over those of {PRESET}",
    "work": f"samples and rays by their times over those of {PRESET}",
    "milliseconds": f"time of gathering over that of {PRESET}",
}


def _check(
    scene: str, name: str, configuration: str, measure: Callable[[StudyContext], Measured]
) -> Check:
    title = "Cornell box, or the scene of --scene" if scene == CHOSEN else scene
    return Check(
        name=name,
        configuration=configuration,
        scene=title,
        measure=measure,
        in_quick=scene in IN_QUICK,
    )


def _scene_of(context: StudyContext, scene: str) -> str:
    if scene != CHOSEN:
        return scene
    return "cornell_box" if context.scene is None else context.scene
