"""The stage: lit points become emittance, all of it or only what became stale.

Sums are made in 64-bit fixed point, so they do not depend on the order of additions, and a part
that is lit anew equals the same part of the whole bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.addressing import texel_from_voxel, voxel_of_place
from vctgi.clipmap.levels import ClipmapLayout, LevelLayout
from vctgi.clipmap.regions import (
    Region,
    count_voxels,
    covered_by_finer,
    difference,
    intersection,
    merged,
    newly_covered_regions,
    own_regions,
    window_region,
)
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.stages.light_injection.balance import ROUNDS
from vctgi.stages.light_injection.centre import nearest_keys, offer_splats, radiance_of_keys
from vctgi.stages.light_injection.config import DEFAULT_CONFIG, LightInjectionConfig
from vctgi.stages.light_injection.derivative import (
    detached_slots,
    have_derivatives,
    make_mirror,
    mirror_splats,
    mirror_thickness,
    spread_mirror,
)
from vctgi.stages.light_injection.gather import gather_splats
from vctgi.stages.light_injection.scatter import scatter_splats
from vctgi.stages.light_injection.splats import (
    Splats,
    covered_slots,
    make_splats,
    radiance_per_flux,
)
from vctgi.stages.light_injection.target import Target, make_target

FIXED_POINT_BITS = 60
"""The sum of everything that is injected is below 2 to this power."""

SMALLEST = 1e-300
"""Keeps a quotient of sums finite where both are 0."""

Steps = tuple[float, float]


def inject_light(
    maps: list[ReflectiveShadowMap],
    opacity: OpacityClipmap,
    config: LightInjectionConfig = DEFAULT_CONFIG,
    prefilter_scale: mi.Float | None = None,
) -> EmittanceClipmap:
    """Turn lit points into emittance.

    Parameters
    ----------
    maps
        Lit points; those made for one level light only that level.
    opacity
        Opacity at each clip level's own resolution. Light goes only where it is not zero: what has
        no opacity is never seen.
    config
        Algorithm, pre-filter and normalisation.
    prefilter_scale
        Value that goes before that of `config`, for derivatives, one lane; None: that number.

    Returns
    -------
    EmittanceClipmap
        Zero in the mips; the share of flux that found no opacity is kept for each clip level.

    Raises
    ------
    ValueError
        Power that is not finite, or texels without the radiance that `config` needs.

    References
    ----------
    [Panteleev2014], slides "Light injection".
    """
    layout = opacity.layout
    dark = EmittanceClipmap(
        layout,
        [dr.zeros(mi.Color3f, DIRECTION_COUNT * level.voxel_count) for level in layout.levels],
        [0.0] * layout.clip_level_count,
        [(0.0, 0.0)] * layout.clip_level_count,
    )
    whole = [own_regions(layout, level) for level in layout.clip_levels]
    return update_emittance(dark, maps, opacity, whole, config, prefilter_scale)


def update_emittance(
    emittance: EmittanceClipmap,
    maps: list[ReflectiveShadowMap],
    opacity: OpacityClipmap,
    stale: Sequence[Sequence[Region]],
    config: LightInjectionConfig = DEFAULT_CONFIG,
    prefilter_scale: mi.Float | None = None,
) -> EmittanceClipmap:
    """Light anew what became stale.

    Parameters
    ----------
    emittance
        What `inject_light` or an earlier update returned; used up, its arrays are changed.
    maps
        All lit points as they are now.
    opacity
        Opacity at each clip level's own resolution, as it is now.
    stale
        Boxes of each level whose surfaces, opacity or light changed; all else must be as it was.
        `relit_regions` says what is overwritten.
    config, prefilter_scale
        As before.

    Returns
    -------
    EmittanceClipmap
        The same, bit for bit, as `inject_light` of all of it.
    """
    layout = opacity.layout
    if prefilter_scale is None and config.prefilter_scale != 1.0:
        prefilter_scale = dr.opaque(mi.Float, config.prefilter_scale)
    if config.needs_radiance and any(m.radiance is None for m in maps):
        raise ValueError(
            "inject_light: texels do not know their surface's radiance, which "
            f'algorithm "{config.algorithm}" with normalisation "{config.normalisation}" needs; '
            "call with_radiance on the maps first."
        )
    _darken(emittance.levels, newly_covered_regions(emittance.layout, layout))
    lit = EmittanceClipmap(layout, emittance.levels, [], [])
    relit = relit_regions(layout, stale, config)
    totals = _total_fluxes(maps, config)
    shares = []
    for level in layout.clip_levels:
        chosen = [number for number, m in enumerate(maps) if m.level in (None, level.level)]
        lighting = [maps[number] for number in chosen]
        steps = _steps_per_unit(totals[chosen], level)
        # Light summed in other steps is rounded otherwise: then all of it is summed again.
        is_kept = steps == emittance.steps_per_unit[level.level]
        boxes = relit[level.level] if is_kept else own_regions(layout, level)
        target = make_target(boxes, level, _channel_count(config), steps)
        shares.append(_fill(lit, target, lighting, opacity, (config, prefilter_scale)))
        lit.steps_per_unit.append(steps)
    for found, lost in np.array(dr.concat(shares), dtype=np.float64).reshape(-1, 2).tolist():
        lit.lost_flux_share.append(lost / (found + lost) if found + lost > 0.0 else 0.0)
    return lit


def relit_regions(
    layout: ClipmapLayout, stale: Sequence[Sequence[Region]], config: LightInjectionConfig
) -> list[list[Region]]:
    """Return the boxes of each clip level that an update of `stale` overwrites.

    A pre-filter spreads light by its reach, a texel's weights depend on the opacity around it, and
    each round of balancing reaches as far again: so far is felt what changed in one voxel. At the
    rims of what a level lights itself, outside and around the finer window, light has nowhere to
    go, so the rims are always lit anew.
    """
    reach = (2 + ROUNDS) * config.reach_voxels
    if reach == 0:
        return [list(stale[level.level]) for level in layout.clip_levels]
    relit = []
    for level in layout.clip_levels:
        whole, covered = window_region(level), covered_by_finer(layout, level)
        own = own_regions(layout, level)
        inner = _grown(whole, -reach)
        boxes = difference(whole, inner) if min(inner.shape) > 0 else [whole]
        felt = list(stale[level.level]) + ([] if covered is None else [covered])
        grown = [intersection(whole, _grown(box, reach)) for box in felt]
        boxes += merged([box for box in grown if box is not None])
        if covered is not None:
            boxes = [part for box in boxes for part in difference(box, covered)]
        relit.append(boxes if count_voxels(boxes) < count_voxels(own) else own)
    return relit


def _darken(levels: list[mi.Color3f], boxes: Sequence[Region]) -> None:
    """Set the emittance in boxes to zero; `levels` are changed in place."""
    for box in boxes:
        count = dr.opaque(mi.UInt32, box.voxel_count)
        lane = dr.arange(mi.UInt32, DIRECTION_COUNT * box.voxel_count)
        texel = texel_from_voxel(voxel_of_place(lane % count, [box]), box.level.resolution)
        index = texel + lane // count * box.level.voxel_count
        dr.scatter(levels[box.level.level], mi.Color3f(0.0), index)
        dr.eval(levels[box.level.level])


def _grown(box: Region, reach: int) -> Region:
    low, high = box.low, box.high
    return replace(
        box,
        low=(low[0] - reach, low[1] - reach, low[2] - reach),
        high=(high[0] + reach, high[1] + reach, high[2] + reach),
    )


def _channel_count(config: LightInjectionConfig) -> int:
    is_bounded = config.normalisation == "radiance" and config.algorithm != "centre"
    return 6 if is_bounded else 3


def _total_fluxes(maps: list[ReflectiveShadowMap], config: LightInjectionConfig) -> np.ndarray:
    """Return the flux that leaves each map, W, and its product with radiance, 0 if not wanted."""
    sums = []
    for rsm in maps:
        sums.append(dr.sum(mi.Float(dr.max(dr.detach(rsm.reflected_flux)))))
        if _channel_count(config) > 3:
            assert rsm.radiance is not None, "the radiance was asked for above"
            product = dr.detach(rsm.reflected_flux * rsm.radiance)
            sums.append(dr.sum(mi.Float(dr.max(product))))
        else:
            sums.append(mi.Float(0.0))
    # All are read at once, because each time the host waits for the device.
    read = np.array(dr.concat(sums), dtype=np.float64) if sums else np.zeros(0)
    fluxes: np.ndarray = read.reshape(-1, 2)
    return fluxes


def _steps_per_unit(fluxes: np.ndarray, level: LevelLayout) -> Steps:
    """Fixed-point steps per unit of emittance and of its product with radiance; 0 without light."""
    per_flux = radiance_per_flux(level)
    total, squared = (float(sum(column)) for column in fluxes.T)
    return _power_of_two(total * per_flux), _power_of_two(squared * per_flux)


def _power_of_two(total: float) -> float:
    """Return the steps per unit that keep a sum below its bound."""
    if total == 0.0:
        return 0.0
    if not math.isfinite(total):
        raise ValueError(
            "inject_light: the reflected flux of the scene's lights is not finite; "
            "check the emitters' power and the textures."
        )
    return 2.0 ** (FIXED_POINT_BITS - math.ceil(math.log2(total)))


def _fill(
    lit: EmittanceClipmap,
    target: Target,
    maps: list[ReflectiveShadowMap],
    opacity: OpacityClipmap,
    rules: tuple[LightInjectionConfig, mi.Float | None],
) -> mi.Float:
    """Overwrite the emittance in boxes of a level; return the light that was found, and lost."""
    level = target.level
    config, scale = rules
    live = covered_slots(opacity, level, config.prefilter, scale)
    covered = detached_slots(live)
    keys = nearest_keys(target)
    if have_derivatives(maps, opacity, scale) and config.algorithm != "centre":
        target.mirror = make_mirror(target)
    totals, first_texel = mi.Float(0.0, 0.0), 0
    for rsm in maps:
        found, lost = mi.Float(0.0), mi.Float(0.0)
        for axis in range(3):
            mirror_thickness(target, rsm, covered, axis, opacity)
            for attached in make_splats(rsm, covered, axis, config):
                # Integers have no derivatives, and loops that make them must not look for any.
                splats = replace(attached, light=dr.detach(attached.light))
                mirror_splats(target, attached)
                if config.algorithm == "centre":
                    offer_splats(keys, target, splats, first_texel, level)
                elif config.algorithm == "gather":
                    gather_splats(target, splats, covered, axis, config.prefilter)
                else:
                    scatter_splats(target, splats, covered, config.prefilter)
                if splats.number == 0:
                    found += _brightness(splats, splats.is_seen)
                    lost += _brightness(splats, splats.is_active & ~splats.is_seen)
        first_texel += rsm.texel_count
        # All axes of a map in one launch.
        dr.eval(found, lost, target.sums)
        totals += dr.concat([dr.sum(found), dr.sum(lost)])
    spread_mirror(target, live, opacity, config.prefilter)
    _write(lit, target, opacity, keys, maps, config)
    return totals


def _write(
    lit: EmittanceClipmap,
    target: Target,
    opacity: OpacityClipmap,
    keys: mi.UInt64,
    maps: list[ReflectiveShadowMap],
    config: LightInjectionConfig,
) -> None:
    """Turn what was summed, or who won, into emittance."""
    level, count = target.level, count_voxels(target.boxes)
    if count == 0:
        return
    lane = dr.arange(mi.UInt32, DIRECTION_COUNT * count)
    voxel = voxel_of_place(lane % target.count, target.boxes)
    texel = texel_from_voxel(voxel, level.resolution)
    index = texel + lane // target.count * level.voxel_count
    # A place that two boxes share has light in the one that came last; both are given it.
    held = dr.gather(mi.UInt32, target.place, texel) + lane // target.count * target.count
    coverage = dr.gather(mi.Float, opacity.levels[level.level], index)
    if config.algorithm == "centre":
        won = radiance_of_keys(dr.gather(mi.UInt64, keys, held), maps)
        emitted = [mi.Float(won[channel]) * coverage for channel in range(3)]
    else:
        emitted = _emitted(target, (held, index), coverage)
    dr.scatter(lit.levels[level.level], mi.Color3f(*emitted), index)
    dr.eval(lit.levels[level.level])


def _emitted(
    target: Target, places: tuple[mi.UInt32, mi.UInt32], coverage: mi.Float
) -> list[mi.Float]:
    """Emittance of slots from their sums, bounded by the mean radiance where that is known."""
    held, index = places
    per_step = [dr.opaque(mi.Float64, 1.0 / steps if steps else 0.0) for steps in target.steps]
    values = [
        mi.Float64(dr.gather(mi.Int64, sums, held)) * per_step[channel // 3]
        for channel, sums in enumerate(target.sums)
    ]
    if target.live is not None:
        # Values of the integers, derivatives of the mirror: what is added is zero.
        mirrored = (mi.Float64(dr.gather(mi.Float, live, index)) for live in target.live)
        pairs = zip(values, mirrored, strict=True)
        values = [mi.Float64(value + (live - dr.detach(live))) for value, live in pairs]
    emitted = []
    for channel in range(3):
        value = mi.Float64(values[channel])
        if len(values) > 3:
            # Where nothing is lit the sum is 0 as well.
            mean = values[3 + channel] / dr.maximum(value, SMALLEST)
            value = dr.minimum(value, mean * mi.Float64(coverage))
        emitted.append(mi.Float(value))
    return emitted


def _brightness(splats: Splats, active: mi.Bool) -> mi.Float:
    """Mean of the channels of each lane that is active."""
    mean = mi.Float((splats.light[0] + splats.light[1] + splats.light[2]) * (1.0 / 3.0))
    return mi.Float(dr.select(active, mean, 0.0))
