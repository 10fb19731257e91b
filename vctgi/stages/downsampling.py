"""Direction-aware downsampling: 2^3 voxels of a level into one of the next.

Across a direction the four columns of children average. Along it the two children of a column add,
up to 1, the one behind filling only what the one in front leaves open. Adding is exact for the
parts of one slanted plane, which are complementary; composing them as if they were independent
would lose light at every level (docs/decisions/0001).
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import is_inside, texel_from_voxel, voxel_from_texel
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap
from vctgi.maths.directions import other_axes
from vctgi.maths.stub_gaps import as_component


def downsample(
    opacity: OpacityClipmap, emittance: EmittanceClipmap | None
) -> tuple[OpacityClipmap, EmittanceClipmap | None]:
    """Fill every level from the finer one, where that covers it.

    Parameters
    ----------
    opacity, emittance
        Values voxelized and injected at each clip level's own resolution; emittance may be left
        out when only opacity is wanted.

    Returns
    -------
    tuple
        The same with the centre of every coarser clip level, and all mips, made from finer voxels.

    References
    ----------
    [Panteleev2014], slide "Multi-resolution voxelization".
    """
    layout = opacity.layout
    alphas = [opacity.levels[0]]
    colors = [emittance.levels[0]] if emittance else []
    for finer, coarser in zip(layout.levels[:-1], layout.levels[1:], strict=True):
        alpha = dr.copy(opacity.levels[coarser.level])
        color = dr.copy(emittance.levels[coarser.level]) if emittance else None
        merged_color = _downsample_level(
            finer, coarser, alphas[-1], colors[-1] if emittance else None, alpha, color
        )
        alphas.append(alpha)
        if merged_color is not None:
            colors.append(merged_color)
    lit = EmittanceClipmap(layout, colors, list(emittance.lost_flux_share)) if emittance else None
    return OpacityClipmap(layout, alphas, opacity.rule), lit


def _downsample_level(
    finer: LevelLayout,
    coarser: LevelLayout,
    fine_alpha: mi.Float,
    fine_color: mi.Color3f | None,
    alpha: mi.Float,
    color: mi.Color3f | None,
) -> mi.Color3f | None:
    """Overwrite the voxels of `coarser` whose children lie in the window of `finer`."""
    texel = dr.arange(mi.UInt32, coarser.voxel_count)
    parent = voxel_from_texel(texel, coarser)
    # Windows are snapped so that the first child decides for all eight.
    is_covered = is_inside(2 * parent, finer)
    for axis in range(3):
        for side in range(2):
            slot = 2 * axis + side
            base = slot * finer.voxel_count
            target = slot * coarser.voxel_count + texel
            mean_alpha, mean_color = _merge_columns(
                axis, side, base, parent, finer, fine_alpha, fine_color
            )
            dr.scatter(alpha, mean_alpha, target, is_covered)
            if color is not None:
                assert mean_color is not None, "emittance downsamples with its opacity"
                dr.scatter(color, mean_color, target, is_covered)
    dr.eval(alpha, color)
    return color


def _merge_columns(
    axis: int,
    side: int,
    base: int,
    parent: mi.Vector3i,
    finer: LevelLayout,
    fine_alpha: mi.Float,
    fine_color: mi.Color3f | None,
) -> tuple[mi.Float, mi.Color3f | None]:
    """Mean over the four columns of children along `axis`, each merged front to back."""
    u, v = other_axes(axis)
    mean_alpha = mi.Float(0.0)
    mean_color = mi.Color3f(0.0) if fine_color is not None else None
    for step_u in range(2):
        for step_v in range(2):
            children = []
            # A ray towards +axis meets the lower child first.
            for step in (side, 1 - side):
                offset = [0, 0, 0]
                offset[axis], offset[u], offset[v] = step, step_u, step_v
                child = 2 * parent + mi.Vector3i(offset)
                children.append(texel_from_voxel(child, finer.resolution) + base)
            front, back = (dr.gather(mi.Float, fine_alpha, index) for index in children)
            visible = dr.minimum(1.0 - front, back)
            mean_alpha += 0.25 * (front + visible)
            if fine_color is not None and mean_color is not None:
                share = dr.select(back > 0.0, visible / dr.select(back > 0.0, back, 1.0), 0.0)
                front_color, back_color = (
                    dr.gather(mi.Color3f, fine_color, index) for index in children
                )
                mean_color += 0.25 * dr.fma(as_component(share), back_color, front_color)
    return mean_alpha, mean_color
