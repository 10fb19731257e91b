"""Voxels that look the same from all sides, as systems with one opacity a voxel have them."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.maths.stub_gaps import as_component


def same_for_all_directions(
    opacity: OpacityClipmap, emittance: EmittanceClipmap | None
) -> tuple[OpacityClipmap, EmittanceClipmap | None]:
    """Give all six slots of a voxel one opacity and one emittance.

    The opacity is the largest of the six: a voxel that a surface crosses is as closed from every
    side as from its face. The radiance is the mean over the slots, weighted by their opacity.

    Parameters
    ----------
    opacity, emittance
        Of six one-sided slots; emittance, premultiplied, may be left out.
    """
    alphas = []
    colors = []
    for number, alpha in enumerate(opacity.levels):
        voxel_count = dr.width(alpha) // DIRECTION_COUNT
        voxel = dr.arange(mi.UInt32, voxel_count)
        slots = [voxel + direction * voxel_count for direction in range(DIRECTION_COUNT)]
        largest, total = mi.Float(0.0), mi.Float(0.0)
        for slot in slots:
            found = dr.gather(mi.Float, alpha, slot)
            largest, total = dr.maximum(largest, found), total + found
        alphas.append(_repeated(largest))
        if emittance is None:
            continue
        emitted = mi.Color3f(0.0)
        for slot in slots:
            emitted += dr.gather(mi.Color3f, emittance.levels[number], slot)
        is_empty = total <= 0.0
        share = dr.select(is_empty, 0.0, largest / dr.select(is_empty, 1.0, total))
        emitted *= as_component(share)
        colors.append(mi.Color3f(*(_repeated(mi.Float(channel)) for channel in emitted)))
    lit = None if emittance is None else replace(emittance, levels=colors)
    return replace(opacity, levels=alphas), lit


def _repeated(values: mi.Float) -> mi.Float:
    """Return the values of voxels [voxel] as those of slots [direction, voxel]."""
    dr.eval(values)
    count = dr.width(values)
    lane = dr.arange(mi.UInt32, DIRECTION_COUNT * count)
    return dr.gather(mi.Float, values, lane % count)
