"""The sums of injected light once more, in numbers that have derivatives.

Integers have none. Each sum is linear in the light of its texels: the same weights, in double
precision, give it the derivatives; its value stays that of the integers. The adjoint of a scatter
is a gather, so reverse mode reads each slot's adjoint back with the weight that the texel wrote by.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import texel_from_voxel
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.stages.light_injection.splats import CoveredSlots, Splats, kernel_weight, neighbour
from vctgi.stages.light_injection.target import NOWHERE, Target


def have_derivatives(maps: list[ReflectiveShadowMap]) -> bool:
    """Whether the light of any texel has derivatives.

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
    return any(dr.grad_enabled(rsm.reflected_flux, rsm.radiance) for rsm in maps)


def make_mirror(target: Target) -> list[mi.Float64]:
    """Return sums of nothing, one for each of the target's channels."""
    return [dr.zeros(mi.Float64, dr.width(sums)) for sums in target.sums]


def mirror_splats(
    mirror: list[mi.Float64], target: Target, splats: Splats, covered: CoveredSlots, width: int
) -> None:
    """Add splats to the sums, with the weights of `scatter_splats`."""
    level = covered.level
    block = splats.direction * level.voxel_count
    for number in range(width**3):
        voxel, weight = splats.voxel, mi.Float(1.0)
        is_lit = splats.is_seen
        if width > 1:
            step = neighbour(mi.UInt32(number), width)
            voxel = splats.voxel + step
            is_lit = is_lit & covered.is_held(voxel)
            texel = texel_from_voxel(voxel, level.resolution)
            held = dr.gather(mi.Float, covered.drawing, texel + block, is_lit)
            weight = kernel_weight(step, width) * held * splats.per_weight
        texel = texel_from_voxel(voxel, level.resolution)
        place = dr.gather(mi.UInt32, target.place, texel, is_lit)
        is_lit &= place != NOWHERE
        slot = place + splats.direction * target.count
        for sums, light in zip(mirror, splats.light, strict=True):
            amount = mi.Float64(light * weight)
            dr.scatter_reduce(dr.ReduceOp.Add, sums, amount, slot, is_lit)
