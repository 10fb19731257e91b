"""Light that was summed in the slots of all clip levels, in fixed point, as others read it."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.maths.number_rows import entry
from vctgi.scene.records import FallenLight

CHANNELS = 3
"""Sums of a slot."""


@dataclass
class SlotSums:
    """Light in the slots of all clip levels; the attributes are those of `SummedLight`.

    Attributes
    ----------
    alphas
        Opacity of each clip level.
    """

    alphas: list[mi.Float]
    sums: mi.Int64
    per_step: mi.Float64

    def read(self, level: int, index: mi.UInt32, active: mi.Bool) -> mi.Color3f:
        """Return emittance of slots of a clip level, W m^-2 sr^-1."""
        alpha = dr.gather(mi.Float, self.alphas[level], index, active)
        slot = mi.UInt32(level * dr.width(self.alphas[level])) + index
        is_lit = active & (alpha > 0.0)
        per_step = entry(self.per_step, level)
        sums = (
            dr.gather(mi.Int64, self.sums, CHANNELS * slot + channel, is_lit)
            for channel in range(CHANNELS)
        )
        return mi.Color3f(*(mi.Float(mi.Float64(each) * per_step) for each in sums))


@dataclass
class SummedLight:
    """Light in the slots of all clip levels, in fixed point.

    Attributes
    ----------
    opacity
        The voxels that were lit.
    sums
        [level, direction, z, y, x, channel]; of slots without opacity, any number.
    per_step
        [level] W m^-2 sr^-1 of a step, and the last once more.
    total
        Sum of the largest channels of all flux, W; not finite where a light's power or what a
        surface reflects is none.
    fallen
        What became of it.
    """

    opacity: OpacityClipmap
    sums: mi.Int64
    per_step: mi.Float64
    total: mi.Float64
    fallen: FallenLight

    @property
    def slots(self) -> SlotSums:
        """Arrays of the same, and nothing else."""
        alphas = self.opacity.levels[: self.opacity.layout.clip_level_count]
        return SlotSums(alphas, self.sums, self.per_step)

    def emittance(self) -> EmittanceClipmap:
        """Return the emittance of all slots; the host reads how much light was lost."""
        layout = self.opacity.layout
        colors = []
        for level in layout.levels:
            count = DIRECTION_COUNT * level.voxel_count
            if level.level >= layout.clip_level_count:
                colors.append(dr.zeros(mi.Color3f, count))
                continue
            colors.append(self.slots.read(level.level, dr.arange(mi.UInt32, count), mi.Bool(True)))
        dr.eval(colors)
        return EmittanceClipmap(layout, colors, self.fallen.lost_flux_share)
