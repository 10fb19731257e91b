"""Why a small lit cube that is turned against the voxels is too bright: one cause after another.

A black room, a spot lamp, a white-lit cube below it: all light of the receivers comes from the
cube, so its error is the cube's own. What makes it is replaced by its exact counterpart, one after
another, down to path tracing, which closes the ledger. A cube along the axes is the control.

- Each point of a sloped surface fills two voxels of its column (`vctgi/clipmap/slots.py`), so that
  rays do not slip between the steps of a slanted wall. In a wall the one behind is hidden; of a
  thing that fills part of a column both are seen, and it shines twice.
- Three slots that face a ray share a face's light by |n_k| |d_k|, of which those of the wrong sign
  are left out: at least its cosine, and 3/2 of it in the mean over all turns and directions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import mitsuba as mi
import numpy as np

from experiments.studies.aliasing.light_tracing import traced_light
from experiments.studies.aliasing.moved_rooms import (
    CUTOFF_DEGREES,
    LAMP_HEIGHT,
    LIT,
    SHARPNESS,
    wall_points,
    windows,
)
from experiments.studies.attribution.gathering import Gatherer
from experiments.studies.attribution.stages import Exact
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.exact_voxels import surfaces_in
from experiments.studies.figures import Curve, Point
from experiments.studies.light.injections import INJECTIONS
from experiments.studies.light.lit_rooms import LitPoints, light_points, placement, room
from vctgi.clipmap.slots import SlotRule
from vctgi.config import preset
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.diffuse import trace_diffuse
from vctgi.stages.voxelization.opacity import OpacityVoxelizationConfig, voxelize_opacity

LEVEL = 1
"""In whose voxels the cube lies."""

EDGES = (0.64, 1.28, 2.56, 5.12)
"""Edge of the cube, voxels; the second is that of the moved object."""

LEDGER_EDGE = 1.28

RECEIVERS = (96, 40)
PHASES = (4, 2)
"""Points, and places of the cube within a voxel, in the whole study and in the quick one."""

PATHS, BATCHES = 1024, 4
RAYS_PER_CONE = 24

THIN = SlotRule(thickness_voxels=0.0)
"""Surfaces fill the voxel that they lie in, and no other."""

SEEN = Exact(width=True, directions=True)
STOPPED = Exact(width=True, directions=True, visibility=True)
TRUE = Exact(width=True, directions=True, visibility=True, radiance=True)

STEPS: dict[str, tuple[SlotRule, Exact | None]] = {
    "as it is": (SlotRule(), None),
    "no voxel behind": (THIN, None),
    "no voxel behind, thin rays": (THIN, SEEN),
    "no voxel behind, thin rays, exact visibility": (THIN, STOPPED),
    "exact visibility alone": (SlotRule(), STOPPED),
    "no voxel behind, thin rays, exact visibility, exact radiance": (THIN, TRUE),
}
"""The ledger: how surfaces fill voxels, and which stages are exact; None: the cones of "high"."""

CLOSED = 0.05
"""How far path tracing may be from light tracing: four standard errors of the quick version."""

OVER_EDGE = Curve(
    group="Small lit cube",
    title="Received light of a lit cube over its size",
    caption="Over path-traced light; the truth is 1. A turned cube of few voxels shines from the "
    "voxels behind its faces, too.",
    x_label="edge of the cube, voxels of its level",
    y_label="light over path-traced light",
    is_x_log=True,
)

CURVES: dict[str, tuple[bool, SlotRule]] = {
    "along the axes": (False, SlotRule()),
    "turned": (True, SlotRule()),
    "turned, no voxel behind": (True, THIN),
}

SCENE = "black room two wide, lit cube by a spot lamp, level 1"


@dataclass(frozen=True)
class LitCube:
    """A cube, its truth and the power that its voxels should have.

    Attributes
    ----------
    scene
        The room.
    points, normals
        Receivers [point, 3].
    truth
        E / pi of each, green.
    """

    scene: mi.Scene
    points: np.ndarray
    normals: np.ndarray
    truth: np.ndarray

    def voxels(self, rule: SlotRule) -> LitPoints:
        """Return its voxels, filled by a rule, and where light lands."""
        found = light_points(self.scene, windows(LEVEL))
        config = OpacityVoxelizationConfig(slots=rule)
        opacity = voxelize_opacity(surfaces_in(self.scene), windows(LEVEL), config)
        return replace(found, opacity=opacity)


def checks() -> list[Check]:
    """Return the checks of the cube."""
    found = [
        Check(
            name=f"lit cube, {way}, edge {edge:g} voxels, energy",
            configuration='preset "high" cones, four levels of 32^3, scatter',
            scene=SCENE,
            measure=partial(_energy, edge=edge, is_turned=is_turned, rule=rule, exact=None),
            goal=1.0,
            points=(Point(OVER_EDGE, way, edge),),
        )
        for way, (is_turned, rule) in CURVES.items()
        for edge in EDGES
    ]
    for step, (rule, exact) in STEPS.items():
        is_closing = exact == TRUE
        found.append(
            Check(
                name=f"lit cube, turned, ledger: {step}",
                configuration='preset "high" cones, four levels of 32^3, scatter',
                scene=f"{SCENE}, edge {LEDGER_EDGE:g} voxels",
                measure=partial(_energy, edge=LEDGER_EDGE, is_turned=True, rule=rule, exact=exact),
                goal=1.0,
                limit_low=1.0 - CLOSED if is_closing else None,
                limit_high=1.0 + CLOSED if is_closing else None,
            )
        )
    more: dict[str, Callable[..., Measured]] = {
        "power in the voxels over that of its faces": _power_in_voxels,
        "six slots in place of cosines, nothing in the way": _by_slots,
    }
    found += [
        Check(
            name=f"lit cube, {placed}, ledger: {what}",
            configuration="four levels of 32^3, scatter",
            scene=f"{SCENE}, edge {LEDGER_EDGE:g} voxels",
            measure=partial(measure, is_turned=is_turned),
            goal=1.0,
        )
        for what, measure in more.items()
        for placed, is_turned in (("along the axes", False), ("turned", True))
    ]
    return found


def cube_scene(edge: float, offset: np.ndarray, *, is_turned: bool) -> mi.Scene:
    """Return a black room with a cube of this edge in world units, lit from above."""
    black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
    parts = room(placement(np.zeros(3), is_turned=False), bsdf=black)
    middle = LIT + offset
    # A larger cube lies higher, so as not to touch the floor.
    middle = middle + np.array([0.0, max(0.0, edge - 0.2), 0.0])
    above = middle + np.array([0.0, LAMP_HEIGHT, 0.0])
    beam: Any = mi.ScalarTransform4f().look_at(above.tolist(), middle.tolist(), [0.0, 0.0, 1.0])
    parts["spot"] = {
        "type": "spot",
        "to_world": beam,
        "cutoff_angle": CUTOFF_DEGREES,
        "beam_width": SHARPNESS * CUTOFF_DEGREES,
    }
    small = placement(middle, is_turned=is_turned) @ mi.ScalarTransform4f().scale(0.5 * edge)
    parts["cube"] = {"type": "cube", "to_world": small}
    scene: mi.Scene = mi.load_dict(parts)
    return scene


def lit_cubes(context: StudyContext, edge: float, *, is_turned: bool) -> list[LitCube]:
    """Return the cube at several places within a voxel, once for all checks."""

    def prepare() -> list[LitCube]:
        voxel = windows(LEVEL).levels[LEVEL].voxel_size
        points, normals = wall_points(RECEIVERS[context.quick])
        found = []
        for number in range(PHASES[context.quick]):
            # A lattice along the diagonal of a voxel.
            offset = voxel * number / PHASES[context.quick] * np.array([1.0, 0.5, 0.25])
            scene = cube_scene(edge * voxel, offset, is_turned=is_turned)
            truth = [traced_light(scene, points, normals, PATHS, k) for k in range(BATCHES)]
            found.append(LitCube(scene, points, normals, np.mean(truth, axis=0)[:, 1]))
        return found

    return context.once(f"lit cube, {edge}, {is_turned}", prepare)


def cube_light(cube: LitCube, rule: SlotRule, exact: Exact | None) -> np.ndarray:
    """Return E / pi [point], green, with surfaces that fill voxels by a rule, and exact stages."""
    volume = cube.voxels(rule).volume(INJECTIONS["scatter"])
    receivers, cones = white_receivers(cube.points, cube.normals), preset("high").diffuse
    if exact is None:
        found = trace_diffuse(receivers, volume, cones, cube.scene)
    else:
        gather = Gatherer(cube.scene, volume, cones, 1, exact, RAYS_PER_CONE)
        found = gather(receivers, 0)
    light: np.ndarray = np.array(found, dtype=np.float64)[1]
    return light


def _energy(
    context: StudyContext, edge: float, rule: SlotRule, exact: Exact | None, *, is_turned: bool
) -> Measured:
    cubes = lit_cubes(context, edge, is_turned=is_turned)
    found = []
    for number, cube in enumerate(cubes):
        context.progress("lit cube", number / len(cubes))
        found.append(float(cube_light(cube, rule, exact).mean() / cube.truth.mean()))
    return mean_of(found)


def _power_in_voxels(context: StudyContext, *, is_turned: bool) -> Measured:
    """Emittance of all slots over flux / pi times |n_k|, summed: how often a face is in voxels."""
    found = []
    for cube in lit_cubes(context, LEDGER_EDGE, is_turned=is_turned):
        lit = cube.voxels(SlotRule())
        held = lit.inject(INJECTIONS["scatter"]).levels[LEVEL]
        size = windows(LEVEL).levels[LEVEL].voxel_size
        flux, _, normal = _lit_texels(lit)
        faces = float((flux[:, None] * np.abs(normal)).sum()) / np.pi
        found.append(float(np.array(held, dtype=np.float64)[1].sum()) * size**2 / faces)
    return mean_of(found)


def _by_slots(context: StudyContext, *, is_turned: bool) -> Measured:
    """Light of lit texels by |n_k| |d_k| of the right signs over that by their cosine."""
    found = []
    for cube in lit_cubes(context, LEDGER_EDGE, is_turned=is_turned):
        flux, place, normal = _lit_texels(cube.voxels(SlotRule()))
        way = cube.points[:, None] - place
        distance = np.linalg.norm(way, axis=-1, keepdims=True)
        product = normal * way / distance
        arriving = -(cube.normals[:, None] * way).sum(axis=-1)
        weight = flux * np.maximum(arriving, 0.0) / distance[..., 0] ** 3
        by_slots = np.maximum(product, 0.0).sum(axis=-1)
        by_cosine = np.maximum(product.sum(axis=-1), 0.0)
        found.append(float((weight * by_slots).sum() / (weight * by_cosine).sum()))
    return mean_of(found)


def _lit_texels(lit: LitPoints) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return flux [texel], place and normal [texel, 3] of lit texels."""
    (found,) = lit.maps
    flux = np.array(found.reflected_flux, dtype=np.float64)[1]
    place, normal = (np.array(each, dtype=np.float64).T for each in (found.position, found.normal))
    is_lit = flux > 0.0
    return flux[is_lit], place[is_lit], normal[is_lit]
