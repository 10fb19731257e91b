"""What the stages work on: opacity and emittance of every voxel.

Both are in single precision along six directions, [level, direction, z, y, x], with each level's
texels at their toroidal address. Emittance is premultiplied by opacity (radiance x opacity), so
that it filters like colour with alpha.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.levels import ClipmapLayout
from vctgi.clipmap.slots import DEFAULT_RULE, SlotRule


@dataclass
class OpacityClipmap:
    """Opacity of every voxel.

    Attributes
    ----------
    layout
        Where the levels lie.
    levels
        For each level the flat opacities [direction, z, y, x], in [0, 1]: the share of light that
        one voxel of the level stops along that direction of travel.
    rule
        How thick the surfaces were made, which their light has to follow.
    growth
        For each level 1, with the derivative of each slot's covered area over that area, which
        goes on where opacity stops at 1; None where no surface moves.
    thickness
        `rule.thickness_voxels` with derivatives, one lane; None where it has none.
    """

    layout: ClipmapLayout
    levels: list[mi.Float]
    rule: SlotRule = DEFAULT_RULE
    growth: list[mi.Float] | None = None
    thickness: mi.Float | None = None


@dataclass
class SlotColors:
    """Emittance of the slots of each level, W m^-2 sr^-1."""

    levels: list[mi.Color3f]

    def read(self, level: int, index: mi.UInt32, active: mi.Bool) -> mi.Color3f:
        """Return emittance of slots of a level."""
        return dr.gather(mi.Color3f, self.levels[level], index, active)


@dataclass
class EmittanceClipmap:
    """Emittance of every voxel.

    Attributes
    ----------
    layout
        Where the levels lie.
    levels
        For each level the flat emittances [direction, z, y, x] in W m^-2 sr^-1, premultiplied by
        opacity: what a ray travelling along the direction meets from its front.
    lost_flux_share
        Share of the reflected flux that fell where the clipmap has no opacity, per clip level.
    steps_per_unit
        Fixed-point steps in which light was summed, per clip level: per W m^-2 sr^-1, and per its
        square where light was summed times radiance; 0 where there was none.
    """

    layout: ClipmapLayout
    levels: list[mi.Color3f]
    lost_flux_share: list[float]
    steps_per_unit: list[tuple[float, float]] = field(default_factory=list)

    @property
    def slots(self) -> SlotColors:
        """Arrays of the same, and nothing else."""
        return SlotColors(self.levels)

    def emittance(self) -> EmittanceClipmap:
        """Return it as it is: all slots are known."""
        return self
