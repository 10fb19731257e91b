"""Why a small lit cube that is turned against the voxels is too bright: one cause after another.

A black room, a spot lamp, a cube below it: all light of the receivers comes from the
cube, so its error is the cube's own. What makes it is replaced by its exact counterpart, one after
another, down to path tracing, which closes the ledger. A cube along the axes is the control.

- Each point of a sloped surface fills two voxels of its column (`vctgi/clipmap/slots.py`), so that
  rays do not slip between the steps of a slanted wall. In a wall the one behind is hidden; of a
  thing that fills part of a column both are seen, and it shines twice.
- Three slots that face a ray share a face's light by |n_k| |d_k|, of which those of the wrong sign
  are left out: at least its cosine, and 3/2 of it in the mean over all turns and directions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.studies.aliasing.light_tracing import traced_light
from experiments.studies.aliasing.moved_rooms import (
    LAMP_HEIGHT,
    LIT,
    SHARPNESS,
    wall_points,
    windows,
)
from experiments.studies.attribution.gathering import Gatherer
from experiments.studies.attribution.radiance import scattered_radiance
from experiments.studies.attribution.stages import Exact
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.exact_voxels import surfaces_in
from experiments.studies.figures import Curve, Point
from experiments.studies.light.injections import INJECTIONS
from experiments.studies.light.lit_rooms import LitPoints, light_points, placement, room
from vctgi.clipmap.sampling import read_surface
from vctgi.clipmap.slots import SlotRule
from vctgi.config import preset
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.diffuse import trace_diffuse
from vctgi.stages.voxelization.opacity import OpacityVoxelizationConfig, voxelize_opacity

LEVEL = 0
"""In whose voxels the cube lies, and in no others."""

EDGES = (0.64, 1.28, 2.56, 5.12, 10.24)
QUICK_EDGES = (1.28, 5.12)
"""Edge of the cube, voxels; the first three are those of the moved object in levels 2, 1, 0."""

LEDGER_EDGE = 1.28

FARTHEST_LAMP = 2.0
"""Height of the lamp over edges of the cube, at least: all of its upper side is lit."""

BEAM_RADIUS = 1.0
"""Of the beam at the cube, over its edge."""

RECEIVERS = (96, 40)
PHASES = (8, 3)
"""Points, and places of the cube within a voxel, in the whole study and in the quick one."""

PATHS, BATCHES = 1024, 4
RAYS_PER_CONE = 16

POINTS_PER_EDGE = 24
"""Points along an edge of the cube whose light is added up where visibility is exact."""

LIFT = 1e-4
"""Of rays from these points, world units."""

THIN = SlotRule(thickness_voxels=0.0)
"""Surfaces fill the voxel that they lie in, and no other."""

SEEN = Exact(width=True, directions=True)
"""Thin rays over the whole hemisphere, through the voxels."""

Light = Callable[["LitCube"], np.ndarray]

CLOSED = 0.02
"""How far light of the cube's points may be from light tracing: the edge of the shadows of a
lamp without extent runs between points."""

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

SCENE = "black room two wide, cube lit by a spot lamp, in the finest level"


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

    _found: dict[SlotRule, LitPoints] = field(default_factory=dict)

    def voxels(self, rule: SlotRule) -> LitPoints:
        """Return its voxels, filled by a rule, and where light lands; made once."""
        if rule not in self._found:
            found = light_points(self.scene, windows(LEVEL))
            config = OpacityVoxelizationConfig(slots=rule)
            opacity = voxelize_opacity(surfaces_in(self.scene), windows(LEVEL), config)
            self._found[rule] = replace(found, opacity=opacity)
        return self._found[rule]


def checks() -> list[Check]:
    """Return the checks of the cube."""
    found = [
        Check(
            name=f"lit cube, {way}, edge {edge:g} voxels, energy",
            configuration='preset "high" cones, four levels of 32^3, scatter',
            scene=SCENE,
            measure=partial(_energy, edge=edge, is_turned=is_turned, rule=rule),
            goal=1.0,
            in_quick=edge in QUICK_EDGES,
            points=(Point(OVER_EDGE, way, edge),),
        )
        for way, (is_turned, rule) in CURVES.items()
        for edge in EDGES
    ]
    for step, light in STEPS.items():
        limit = CLOSED if step == CLOSING else None
        found.append(
            Check(
                name=f"lit cube, turned, ledger: {step}",
                configuration='preset "high" cones, four levels of 32^3, scatter',
                scene=f"{SCENE}, edge {LEDGER_EDGE:g} voxels",
                measure=partial(_ledger, light=light),
                goal=1.0,
                limit_low=None if limit is None else 1.0 - limit,
                limit_high=None if limit is None else 1.0 + limit,
                in_quick=not step.endswith(THIN_RAYS),
                is_headline=step == AS_IT_IS,
            )
        )
    more: dict[str, Callable[[LitCube], float]] = {
        "power in the voxels over that of its faces": power_share,
        "six slots in place of cosines, nothing in the way": slot_share,
    }
    found += [
        Check(
            name=f"lit cube, {placed}, ledger: {what}",
            configuration="four levels of 32^3, scatter",
            scene=f"{SCENE}, edge {LEDGER_EDGE:g} voxels",
            measure=partial(_share, measure=measure, is_turned=is_turned),
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
    # A larger cube lies higher, so as not to touch the floor.
    middle = LIT + offset + np.array([0.0, max(0.0, edge - 0.2), 0.0])
    height = max(LAMP_HEIGHT, FARTHEST_LAMP * edge)
    cutoff = math.degrees(math.atan(BEAM_RADIUS * edge / height)) / SHARPNESS
    above = middle + np.array([0.0, height, 0.0])
    beam: Any = mi.ScalarTransform4f().look_at(above.tolist(), middle.tolist(), [0.0, 0.0, 1.0])
    parts["spot"] = {
        "type": "spot",
        "to_world": beam,
        "cutoff_angle": cutoff,
        "beam_width": SHARPNESS * cutoff,
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


def cone_seen(cube: LitCube, rule: SlotRule) -> np.ndarray:
    """Return E / pi [point], green, by the cones of preset "high"."""
    volume = cube.voxels(rule).volume(INJECTIONS["scatter"])
    receivers = white_receivers(cube.points, cube.normals)
    found = trace_diffuse(receivers, volume, preset("high").diffuse, cube.scene)
    return _green(found)


def ray_seen(cube: LitCube, rule: SlotRule) -> np.ndarray:
    """Return the same by thin rays through the voxels."""
    volume = cube.voxels(rule).volume(INJECTIONS["scatter"])
    gather = Gatherer(cube.scene, volume, preset("high").diffuse, 1, SEEN, RAYS_PER_CONE)
    return _green(gather(white_receivers(cube.points, cube.normals), 0))


def voxel_seen(cube: LitCube, rule: SlotRule) -> np.ndarray:
    """Return the same with exact visibility: what the voxels of its points say they send out."""
    volume = cube.voxels(rule).volume(INJECTIONS["scatter"])
    place, normal, area = _cube_points(cube)
    level = dr.full(mi.UInt32, LEVEL, len(place))
    where, facing = mi.Point3f(_rows(place)), mi.Vector3f(_rows(normal))
    radiance, _opacity = read_surface(volume, level, where, facing, mi.Bool(True))
    return _arriving(cube, place, normal, area * _green(radiance))


def truly_seen(cube: LitCube) -> np.ndarray:
    """Return the same with the path-traced radiance of its points."""
    place, normal, area = _cube_points(cube)
    start = mi.Point3f(_rows(place + LIFT * normal))
    ray = mi.Ray3f(start, mi.Vector3f(_rows(-normal)))
    radiance = scattered_radiance(cube.scene, ray, 1, 0, mi.Bool(True))
    return _arriving(cube, place, normal, area * _green(radiance))


AS_IT_IS, THIN_RAYS = "as it is", "thin rays"
CLOSING = "no voxel behind, exact visibility and radiance"

STEPS: dict[str, Light] = {
    AS_IT_IS: partial(cone_seen, rule=SlotRule()),
    THIN_RAYS: partial(ray_seen, rule=SlotRule()),
    "no voxel behind": partial(cone_seen, rule=THIN),
    f"no voxel behind, {THIN_RAYS}": partial(ray_seen, rule=THIN),
    "no voxel behind, exact visibility": partial(voxel_seen, rule=THIN),
    "exact visibility": partial(voxel_seen, rule=SlotRule()),
    CLOSING: truly_seen,
}
"""The ledger: how surfaces fill voxels, and what is exact."""


def _cube_points(cube: LitCube) -> tuple[np.ndarray, np.ndarray, float]:
    """Return places and normals [point, 3] all over the cube, and the area of each."""
    (shape,) = [each for each in cube.scene.shapes() if each.id() == "cube"]
    corners = np.array(mi.traverse(shape)["vertex_positions"], dtype=np.float64).reshape(-1, 3)
    faces = np.array(mi.traverse(shape)["faces"]).reshape(-1, 3)
    share = (np.arange(POINTS_PER_EDGE) + 0.5) / POINTS_PER_EDGE
    u, v = (each.ravel()[:, None] for each in np.meshgrid(share, share))
    # Upper halves of the squares are folded down: each triangle gets all points, evenly.
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    first, second, third = (corners[faces[:, k], None] for k in range(3))
    normal = np.cross(second - first, third - first)
    area = 0.5 * float(np.linalg.norm(normal, axis=-1).sum()) / (len(faces) * len(u))
    place = first + u * (second - first) + v * (third - first)
    normal = np.broadcast_to(normal / np.linalg.norm(normal, axis=-1, keepdims=True), place.shape)
    return place.reshape(-1, 3), normal.reshape(-1, 3), area


def _arriving(
    cube: LitCube, place: np.ndarray, normal: np.ndarray, power: np.ndarray
) -> np.ndarray:
    """Return E / pi [point] by points of a convex shape, which alone is in its own way."""
    way = cube.points[:, None] - place
    leaving = np.maximum((normal * way).sum(axis=-1), 0.0)
    arriving = np.maximum(-(cube.normals[:, None] * way).sum(axis=-1), 0.0)
    squared = (way**2).sum(axis=-1)
    found: np.ndarray = (leaving * arriving / squared**2) @ power / np.pi
    return found


def _rows(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values.T, dtype=np.float32)


def _green(color: mi.Color3f) -> np.ndarray:
    found: np.ndarray = np.array(color, dtype=np.float64)[1]
    return found


def _energy(context: StudyContext, edge: float, rule: SlotRule, *, is_turned: bool) -> Measured:
    cubes = lit_cubes(context, edge, is_turned=is_turned)
    return _over_truth(context, cubes, partial(cone_seen, rule=rule))


def _ledger(context: StudyContext, light: Light) -> Measured:
    return _over_truth(context, lit_cubes(context, LEDGER_EDGE, is_turned=True), light)


def _over_truth(context: StudyContext, cubes: list[LitCube], light: Light) -> Measured:
    found = []
    for number, cube in enumerate(cubes):
        context.progress("lit cube", number / len(cubes))
        found.append(float(light(cube).mean() / cube.truth.mean()))
    return mean_of(found)


def power_share(cube: LitCube) -> float:
    """Emittance of all slots over flux / pi times |n_k|, summed: how often a face is in voxels."""
    lit = cube.voxels(SlotRule())
    held = lit.inject(INJECTIONS["scatter"]).levels[LEVEL]
    size = windows(LEVEL).levels[LEVEL].voxel_size
    flux, _, normal = _lit_texels(lit)
    faces = float((flux[:, None] * np.abs(normal)).sum()) / np.pi
    return float(_green(held).sum()) * size**2 / faces


def slot_share(cube: LitCube) -> float:
    """Light of lit texels by |n_k| |d_k| of the right signs over that by their cosine."""
    flux, place, normal = _lit_texels(cube.voxels(SlotRule()))
    way = cube.points[:, None] - place
    distance = np.linalg.norm(way, axis=-1, keepdims=True)
    product = normal * way / distance
    arriving = -(cube.normals[:, None] * way).sum(axis=-1)
    weight = flux * np.maximum(arriving, 0.0) / distance[..., 0] ** 3
    by_slots = np.maximum(product, 0.0).sum(axis=-1)
    by_cosine = np.maximum(product.sum(axis=-1), 0.0)
    return float((weight * by_slots).sum() / (weight * by_cosine).sum())


def _share(
    context: StudyContext, measure: Callable[[LitCube], float], *, is_turned: bool
) -> Measured:
    cubes = lit_cubes(context, LEDGER_EDGE, is_turned=is_turned)
    return mean_of([measure(cube) for cube in cubes])


def _lit_texels(lit: LitPoints) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return flux [texel], place and normal [texel, 3] of lit texels."""
    (found,) = lit.maps
    flux = np.array(found.reflected_flux, dtype=np.float64)[1]
    place, normal = (np.array(each, dtype=np.float64).T for each in (found.position, found.normal))
    is_lit = flux > 0.0
    return flux[is_lit], place[is_lit], normal[is_lit]
