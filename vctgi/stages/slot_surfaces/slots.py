"""The mean place, normal and albedo of the surfaces in each slot.

Points are spread over every voxelized side, and each adds itself to the slots that its surface
fills, by the share of the voxel's face that it covers: the rule that light is injected by. Sums are
made in fixed point, so they do not depend on the order of the points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import is_inside, texel_from_voxel, voxel_from_texel
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.slot_surfaces import SlotSurfaces
from vctgi.clipmap.slots import SlotRule, filled_layers, surface_slot
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.surfaces import VoxelSurfaces
from vctgi.stages.slot_surfaces.samples import (
    SAMPLES_PER_FACE,
    SurfaceSamples,
    shade_surfaces,
)

STEPS_PER_FACE = 2.0**32
"""Fixed-point steps of one voxel's face covered; a slot has room for 2^28 faces."""

NOWHERE = 0xFFFFFFFF
"""Place of a slot that is not asked for."""


@dataclass
class SlotSums:
    """What the points of surfaces add up to in slots, by share of a voxel's face.

    Attributes
    ----------
    covered
        Shares themselves.
    reflected
        Shares times albedo.
    normal
        Shares times normal.
    offset
        Shares times the way from the voxel's centre to the point, voxels.
    """

    covered: mi.Float
    reflected: mi.Color3f
    normal: mi.Vector3f
    offset: mi.Vector3f


@dataclass(frozen=True, kw_only=True)
class SlotSurfacesConfig:
    """How surfaces are looked at."""

    samples_per_face: float = SAMPLES_PER_FACE
    """Points on a surface as large as a voxel's face, > 0."""

    def __post_init__(self) -> None:
        """Refuse to look at nothing."""
        if not self.samples_per_face > 0.0:
            raise ValueError(
                f"SlotSurfacesConfig.samples_per_face must be > 0, got {self.samples_per_face}."
            )


def describe_slots(
    scene: mi.Scene,
    surfaces: VoxelSurfaces,
    opacity: OpacityClipmap,
    config: SlotSurfacesConfig | None = None,
) -> list[SlotSurfaces]:
    """Return the surfaces behind the slots of every clip level.

    Parameters
    ----------
    scene, surfaces
        Geometry with its materials, and the sides of it that are voxelized.
    opacity
        Opacity at each clip level's own resolution. Slots that finer voxels will replace when the
        level is downsampled into are left out.
    config
        How densely surfaces are looked at.
    """
    chosen = config or SlotSurfacesConfig()
    layout = opacity.layout
    found = []
    for level in layout.clip_levels:
        alpha = opacity.levels[level.level]
        has_surface = alpha > 0.0
        if level.level > 0:
            lane = dr.arange(mi.UInt32, dr.width(alpha)) % dr.opaque(mi.UInt32, level.voxel_count)
            voxel = voxel_from_texel(lane, level)
            has_surface &= ~is_inside(2 * voxel, layout.levels[level.level - 1])
        index = mi.UInt32(dr.compress(has_surface))
        found.append(_describe(scene, surfaces, opacity, index, chosen, level))
    return found


def _describe(
    scene: mi.Scene,
    surfaces: VoxelSurfaces,
    opacity: OpacityClipmap,
    index: mi.UInt32,
    config: SlotSurfacesConfig,
    level: LevelLayout,
) -> SlotSurfaces:
    """Return the surfaces behind some slots of a level."""
    alpha = dr.gather(mi.Float, opacity.levels[level.level], index)
    if dr.width(index) == 0:
        return SlotSurfaces(
            level,
            index,
            alpha,
            dr.zeros(mi.Point3f, 0),
            dr.zeros(mi.Vector3f, 0),
            dr.zeros(mi.Color3f, 0),
            0.0,
        )
    samples = shade_surfaces(scene, surfaces.vertices, level, config.samples_per_face)
    sums = borrow(sum_in_slots(samples, index, level, opacity.rule), index, level)
    is_known = sums.covered > 0.0
    per_share = as_component(dr.select(is_known, 1.0 / sums.covered, 0.0))
    voxel = voxel_from_texel(index % dr.opaque(mi.UInt32, level.voxel_count), level)
    place = mi.Vector3f(voxel) + 0.5 + sums.offset * per_share
    up = mi.Vector3f(0.0, 0.0, 1.0)
    normal = mi.Vector3f(dr.select(is_known, mi.Vector3f(dr.normalize(sums.normal)), up))
    unseen = dr.select(is_known, mi.Float(0.0), alpha)
    unknown = float(dr.sum(unseen)[0]) / float(dr.sum(alpha)[0])
    # The albedo of a rough lobe is an estimate, whose noise may exceed 1.
    albedo = dr.minimum(sums.reflected * per_share, mi.Color3f(1.0))
    result = SlotSurfaces(
        level=level,
        index=index,
        opacity=alpha,
        position=mi.Point3f(place * level.voxel_size),
        normal=normal,
        albedo=mi.Color3f(albedo),
        unknown_share=unknown,
    )
    dr.eval(result)
    return result


def sum_in_slots(
    samples: SurfaceSamples, index: mi.UInt32, level: LevelLayout, rule: SlotRule
) -> SlotSums:
    """Add up the points that fall into slots.

    Parameters
    ----------
    samples
        Points of surfaces.
    index
        Slots to add up in, each named once.
    level
        Their level.
    rule
        How thick the surfaces were made.
    """
    count = dr.width(index)
    place = _places(index, level)
    sums = [dr.zeros(mi.Int64, count) for _ in range(10)]
    live = _live_sums(samples, count)
    if samples.count:
        for axis in range(3):
            for target, values in _amounts(samples, place, axis, level, rule):
                for mirror, value in zip(live, values[1:4], strict=False):
                    amount = mi.Float64(value)
                    dr.scatter_reduce(dr.ReduceOp.Add, mirror, amount, target, target != NOWHERE)
                for held, value in zip(sums, dr.detach(values), strict=True):
                    steps = mi.Int64(dr.round(mi.Float64(value) * STEPS_PER_FACE))
                    dr.scatter_reduce(
                        dr.ReduceOp.Add,
                        held,
                        steps,
                        target,
                        target != NOWHERE,
                        dr.ReduceMode.Direct,
                    )
        dr.eval(sums)
    found = [mi.Float(mi.Float64(held) * (1.0 / STEPS_PER_FACE)) for held in sums]
    for number, mirror in enumerate(live, start=1):
        # Zero, with the derivatives of the mirror
        slope = mi.Float(mirror - dr.detach(mirror))
        found[number] = found[number] + slope
    result = SlotSums(
        found[0], mi.Color3f(*found[1:4]), mi.Vector3f(*found[4:7]), mi.Vector3f(*found[7:10])
    )
    dr.eval(result)
    return result


def _live_sums(samples: SurfaceSamples, count: int) -> list[mi.Float64]:
    """Return sums for the three channels of reflected light if it has derivatives, else none.

    Raises
    ------
    ValueError
        The places of surfaces have derivatives, which slots do not follow smoothly.
    """
    if dr.grad_enabled(samples.position, samples.normal, samples.area):
        raise ValueError(
            "describe_slots: vertices have derivatives, and light of more than one bounce does not "
            "follow them smoothly: detach them, or set RenderConfig.scattering_count to 2."
        )
    if not dr.grad_enabled(samples.reflected):
        return []
    return [dr.zeros(mi.Float64, count) for _ in range(3)]


def _places(index: mi.UInt32, level: LevelLayout) -> mi.UInt32:
    """Return the place of every slot of a level in a list of some of them."""
    place = dr.full(mi.UInt32, NOWHERE, DIRECTION_COUNT * level.voxel_count)
    dr.scatter(place, dr.arange(mi.UInt32, dr.width(index)), index)
    return place


def borrow(sums: SlotSums, index: mi.UInt32, level: LevelLayout) -> SlotSums:
    """Give slots that no point fell into what the slots around them found.

    Such slots are slivers of coverage, smaller than the spacing of the points.
    """
    empty = mi.UInt32(dr.compress(sums.covered <= 0.0))
    if dr.width(empty) == 0:
        return sums
    place = _places(index, level)
    slot = dr.gather(mi.UInt32, index, empty)
    direction = slot // dr.opaque(mi.UInt32, level.voxel_count)
    voxel = voxel_from_texel(slot % dr.opaque(mi.UInt32, level.voxel_count), level)
    # Field by field: Dr.Jit knows the types of a record from the first variant that used it.
    none, width = dr.zeros(mi.Vector3f, dr.width(empty)), dr.width(empty)
    found = SlotSums(
        dr.zeros(mi.Float, width), dr.zeros(mi.Color3f, width), none, mi.Vector3f(none)
    )
    for step in product((-1, 0, 1), repeat=3):
        around = voxel + mi.Vector3i(*step)
        active = is_inside(around, level)
        texel = texel_from_voxel(around, level.resolution) + direction * level.voxel_count
        held = dr.gather(mi.UInt32, place, texel, active)
        active &= held != NOWHERE
        near = dr.gather(SlotSums, sums, held, active)
        found.covered += near.covered
        found.reflected += near.reflected
        found.normal += near.normal
        found.offset += near.offset + mi.Vector3f(*step) * as_component(near.covered)
    dr.eval(found)
    dr.scatter(sums, found, empty)
    dr.eval(sums)
    return sums


def _amounts(
    samples: SurfaceSamples, place: mi.UInt32, axis: int, level: LevelLayout, rule: SlotRule
) -> Iterator[tuple[mi.UInt32, list[mi.Float]]]:
    """Yield for each layer along an axis where the points go and what they add there."""
    slot = surface_slot(mi.Float(samples.normal[axis]), rule)
    per_face = mi.Float(dr.abs(samples.normal[axis])) / dr.opaque(mi.Float, level.voxel_size**2)
    share = samples.area * per_face
    reflected = samples.reflected * as_component(per_face)
    where = samples.position / level.voxel_size
    voxel = mi.Vector3i(dr.floor(where))
    for layer, is_filled in filled_layers(mi.Float(where[axis]), slot):
        filled = mi.Vector3i([layer if i == axis else mi.Int32(voxel[i]) for i in range(3)])
        active = is_filled & is_inside(filled, level)
        index = (
            texel_from_voxel(filled, level.resolution) + (2 * axis + slot.side) * level.voxel_count
        )
        target = dr.select(active, dr.gather(mi.UInt32, place, index, active), NOWHERE)
        offset = mi.Vector3f(where - (mi.Point3f(filled) + 0.5))
        values = [share, *reflected]
        values += [share * mi.Float(each) for each in (*samples.normal, *offset)]
        yield target, [mi.Float(each) for each in values]
