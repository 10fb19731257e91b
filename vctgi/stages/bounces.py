"""Many bounces: the light that lit voxels send to other voxels, scattering after scattering.

Injected emittance is light after one scattering. Every slot with a surface gathers what the others
emit and reflects its albedo of it: light after one scattering more. The sum over all scatterings is
what cones from visible points gather. Who gathers is not decided here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.slot_surfaces import SlotSurfaces
from vctgi.clipmap.storage import EmittanceClipmap
from vctgi.maths.colors import channel_mean
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.receivers import diffuse_receivers
from vctgi.scene.records import GBuffer


class Gather(Protocol):
    """What brings the light of voxels to slots."""

    def __call__(self, emittance: EmittanceClipmap) -> Sequence[mi.Color3f]:
        """Return E / pi, W m^-2 sr^-1, at the surface of each slot of each clip level."""


@dataclass(frozen=True, kw_only=True)
class BouncesConfig:
    """When bounces stop."""

    min_bounce_share: float = 1e-3
    """No further scattering is traced once one added less than this share of the flux before it,
    [0, 1); 0 traces all that are asked for."""

    def __post_init__(self) -> None:
        """Refuse a share that is none."""
        if not 0.0 <= self.min_bounce_share < 1.0:
            raise ValueError(
                f"BouncesConfig.min_bounce_share must be in [0, 1), got {self.min_bounce_share}."
            )


@dataclass
class BouncedLight:
    """Light of several scatterings.

    Attributes
    ----------
    emittance
        Their sum, at each clip level's own resolution.
    fluxes
        Flux that the voxels emit after each scattering, the injected light's first, W, mean of the
        channels.
    left_out
        Bound on the radiance that scatterings which were asked for, but not traced, would add to
        any voxel, W m^-2 sr^-1.
    parts
        Emittance of each scattering, if it was asked for.
    """

    emittance: EmittanceClipmap
    fluxes: list[float]
    left_out: float = 0.0
    parts: list[EmittanceClipmap] = field(default_factory=list)


def bounce_light(
    injected: EmittanceClipmap,
    surfaces: Sequence[SlotSurfaces],
    gather: Gather,
    bounce_count: int,
    config: BouncesConfig,
    *,
    keeps_parts: bool = False,
) -> BouncedLight:
    """Scatter light from voxel to voxel.

    Parameters
    ----------
    injected
        Light after one scattering.
    surfaces
        The surfaces behind the slots of each clip level.
    gather
        Brings the light of voxels to the slots.
    bounce_count
        Further scatterings, >= 0.
    config
        When to stop before that.
    keeps_parts
        Whether each scattering's emittance is kept apart.
    """
    lit = BouncedLight(injected, [emitted_flux(injected, surfaces)])
    if keeps_parts:
        lit.parts.append(injected)
    last = injected
    for number in range(bounce_count):
        # Without any light the first flux is 0, and that is no more than a share of nothing.
        if lit.fluxes[-1] <= config.min_bounce_share * math.fsum(lit.fluxes[:-1]):
            lit.left_out = further_radiance(last, surfaces, bounce_count - number)
            break
        last = reflect(last, surfaces, gather(last))
        lit.fluxes.append(emitted_flux(last, surfaces))
        lit.emittance = add_light(lit.emittance, last)
        if keeps_parts:
            lit.parts.append(last)
    return lit


def reflect(
    like: EmittanceClipmap, surfaces: Sequence[SlotSurfaces], gathered: Sequence[mi.Color3f]
) -> EmittanceClipmap:
    """Return the emittance of slots that reflect the light which they gathered.

    Parameters
    ----------
    like
        Any emittance of the same layout.
    surfaces
        The surfaces behind the slots of each clip level.
    gathered
        E / pi at each of them, W m^-2 sr^-1.

    Returns
    -------
    EmittanceClipmap
        Albedo x E / pi x opacity: radiance premultiplied, as injected light is.
    """
    layout = like.layout
    levels = [dr.zeros(mi.Color3f, DIRECTION_COUNT * level.voxel_count) for level in layout.levels]
    for each, light in zip(surfaces, gathered, strict=True):
        if each.count:
            emitted = each.albedo * light * as_component(each.opacity)
            dr.scatter(levels[each.level.level], emitted, each.index)
    dr.eval(levels)
    return EmittanceClipmap(layout, levels, [0.0] * layout.clip_level_count)


def emitted_flux(emittance: EmittanceClipmap, surfaces: Sequence[SlotSurfaces]) -> float:
    """Flux that slots emit, W, mean of the channels; slots that finer ones replace left out."""
    total = 0.0
    for each in surfaces:
        if each.count:
            color = dr.gather(mi.Color3f, emittance.levels[each.level.level], each.index)
            face = math.pi * each.level.voxel_size**2
            total += face * float(dr.sum(mi.Float64(channel_mean(color)))[0])
    return total


def further_radiance(last: EmittanceClipmap, surfaces: Sequence[SlotSurfaces], count: int) -> float:
    """Return a bound on what further scatterings add to the radiance of any voxel.

    Parameters
    ----------
    last
        Light of the last scattering that was traced.
    surfaces
        The surfaces behind the slots of each clip level.
    count
        Scatterings after it.

    Notes
    -----
    Cones mix radiances with weights that sum to 1 at most: a step adds the radiance of what stops
    it, times the share that it stops, and the weights of a cone set sum to 1. So no slot gathers
    more than the brightest slot sends, and it reflects its albedo of that: each scattering is at
    most a times as bright as the one before, a the largest albedo, and `count` of them add
    a + a^2 + .. + a^count times the brightest radiance of the last. Rounding in single precision
    comes on top.
    """
    brightest = albedo = 0.0
    for each in surfaces:
        if each.count:
            color = dr.gather(mi.Color3f, last.levels[each.level.level], each.index)
            radiance = dr.detach(color / as_component(each.opacity))
            brightest = max(brightest, float(dr.max(dr.max(radiance))[0]))
            albedo = max(albedo, float(dr.max(dr.max(dr.detach(each.albedo)))[0]))
    if albedo == 1.0:
        return brightest * count
    return brightest * albedo * (1.0 - albedo**count) / (1.0 - albedo)


def slot_receivers(surfaces: SlotSurfaces) -> GBuffer:
    """Return the surfaces behind slots as points that gather light."""
    # The address of a voxel does not change when its window moves, so neither do its cones.
    return diffuse_receivers(surfaces.position, surfaces.normal, surfaces.albedo, surfaces.index)


def add_light(first: EmittanceClipmap, second: EmittanceClipmap) -> EmittanceClipmap:
    """Add two lights; what the first says about its injection stays."""
    levels = [a + b for a, b in zip(first.levels, second.levels, strict=True)]
    dr.eval(levels)
    return EmittanceClipmap(
        first.layout, levels, list(first.lost_flux_share), list(first.steps_per_unit)
    )
