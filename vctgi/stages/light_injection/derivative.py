"""The sums of injected light once more, in numbers that have derivatives.

A surface that covers more of a voxel's face is lit where it newly covers it as it is elsewhere, so
each texel counts as the covered area of its slot does; so shapes and thickness change light
without moving texels from voxel to voxel, which happens in jumps.

Integers have none. Each sum is linear in the light of its texels: the same weights, in double
precision, give it the derivatives; its value stays that of the integers. The adjoint of a scatter
is a gather, so reverse mode reads each slot's adjoint back with the weight that the texel wrote by.
"""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import texel_from_voxel
from vctgi.clipmap.slots import BEHIND_NUDGE, surface_slot
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.stages.light_injection.balance import blurred
from vctgi.stages.light_injection.splats import CoveredSlots, Splats, splat_light
from vctgi.stages.light_injection.target import Target


def have_derivatives(
    maps: list[ReflectiveShadowMap], opacity: OpacityClipmap, scale: mi.Float | None
) -> bool:
    """Whether the light of any texel has derivatives, or where it goes.

    Raises
    ------
    ValueError
        So have places, which light does not follow smoothly from voxel to voxel.
    """
    for rsm in maps:
        if dr.grad_enabled(rsm.position, rsm.normal):
            raise ValueError(
                "inject_light: the places of lit points have derivatives (of a light's position or "
                "direction, or of vertices), and the voxel that a point lies in changes in jumps: "
                "detach that parameter, or render it with another integrator."
            )
    return dr.grad_enabled(opacity.levels, scale) or any(
        dr.grad_enabled(rsm.reflected_flux, rsm.radiance) for rsm in maps
    )


def detached_slots(covered: CoveredSlots) -> CoveredSlots:
    """Return the same slots without derivatives."""
    taps = [dr.detach(tap) if isinstance(tap, mi.Float) else tap for tap in covered.taps]
    return replace(covered, drawing=dr.detach(covered.drawing), taps=taps)


def make_mirror(target: Target) -> list[mi.Float64]:
    """Return sums [direction, z, y, x] of nothing, one for each of the target's channels."""
    size = DIRECTION_COUNT * target.level.voxel_count
    return [dr.zeros(mi.Float64, size) for _ in target.sums]


def mirror_splats(target: Target, splats: Splats) -> None:
    """Add splats to the slots of the mirror that they lie in, if the target has one."""
    if target.mirror is None:
        return
    level = target.level
    slot = texel_from_voxel(splats.voxel, level.resolution) + splats.direction * level.voxel_count
    for sums, light in zip(target.mirror, splats.light, strict=True):
        dr.scatter_reduce(dr.ReduceOp.Add, sums, mi.Float64(light), slot, splats.is_seen)


def spread_mirror(
    target: Target, covered: CoveredSlots, opacity: OpacityClipmap, width: int
) -> None:
    """Find what slots have after the pre-filter, as `scatter_splats` leaves it.

    Its weights follow from the slot that a texel lies in, not from where in it the texel lies, so
    all texels of a slot are spread together.

    Parameters
    ----------
    target
        What `mirror_splats` summed up, if anything; gets the result.
    covered
        Slots of the level; they may have derivatives.
    opacity
        Voxels, whose covered areas may have derivatives.
    width
        Of the pre-filter, voxels.
    """
    if target.mirror is None:
        return
    level = covered.level
    lights = [mi.Float(sums) for sums in target.mirror]
    if opacity.growth is not None:
        lights = [light * opacity.growth[level.level] for light in lights]
    target.live = lights
    if width == 1:
        return

    def spread(values: mi.Float) -> mi.Float:
        for axis in range(3):
            values = blurred(values, level, axis, covered.taps)
            dr.eval(values)
        return values

    around = spread(covered.drawing)
    has_weight = around > 0.0
    per_weight = dr.select(has_weight, 1.0 / dr.select(has_weight, around, 1.0), 0.0)
    target.live = [covered.drawing * spread(light * per_weight) for light in lights]


def mirror_thickness(
    target: Target,
    rsm: ReflectiveShadowMap,
    covered: CoveredSlots,
    axis: int,
    opacity: OpacityClipmap,
) -> None:
    """Add what texels give to further layers along an axis when surfaces become thicker.

    A texel fills a layer from the thickness on at which its segment touches it. That jump is
    spread over thicknesses half a voxel less and more (or as much less as there are), so that each
    texel of a sloped surface gives its light to the layer whose boundary its segment's end is
    nearest to. The value that is added is zero.

    Parameters
    ----------
    target
        Gets them in its mirror, if it has one.
    rsm
        Texels.
    covered
        Slots of the level.
    axis
        Along which surfaces become thicker.
    opacity
        Voxels, whose thickness may have derivatives.
    """
    if target.mirror is None or opacity.thickness is None:
        return
    level, alpha = covered.level, dr.detach(opacity.levels[covered.level.level])
    reach = min(0.5, max(covered.rule.thickness_voxels, LEAST_REACH))
    slot = surface_slot(mi.Float(rsm.normal[axis]), covered.rule)
    where, behind = rsm.position / level.voxel_size, mi.Float(slot.behind)
    begin = mi.Float(where[axis]) + behind * BEHIND_NUDGE
    end = begin + behind * slot.thickness
    # How far the end lies behind the boundary of its layer.
    past = behind * end - dr.floor(behind * end)
    is_past = past < 0.5
    is_near = dr.select(is_past, past, 1.0 - past) < reach
    voxel = mi.Vector3i(dr.floor(where))
    voxel[axis] = mi.Int32(dr.floor(end)) + dr.select(is_past, mi.Int32(0), slot.behind)
    active = slot.is_facing & slot.is_sloped & is_near & covered.is_held(voxel)
    active &= voxel[axis] != mi.Int32(dr.floor(begin))
    if covered.is_finer is not None:
        active &= ~covered.is_finer(2 * voxel)
    index = texel_from_voxel(voxel, level.resolution)
    index += (2 * axis + slot.side) * level.voxel_count
    active &= dr.gather(mi.Float, alpha, index, active) > 0.0
    thicker = (opacity.thickness - dr.detach(opacity.thickness)) / (2.0 * reach)
    lights = splat_light(rsm, level, axis, len(target.mirror))
    for sums, light in zip(target.mirror, lights, strict=True):
        amount = mi.Float64(dr.detach(light) * thicker)
        dr.scatter_reduce(dr.ReduceOp.Add, sums, amount, index, active)


LEAST_REACH = 0.05
"""Voxels over which the jump of a texel is spread at least, when surfaces are hardly thick."""
