"""One step of a march: how long it is, what it stops and what it adds."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.sampling import THIN_OPACITY
from vctgi.maths.stub_gaps import as_component
from vctgi.stages.cone_tracing.live_march import AnyMarch

THIN_DEPTH = 1e-2
"""Optical depth below which the first three terms of a series are exact to single precision."""

WIDEST_SPHERES = 0.9
"""Largest half cone ratio for which spheres that touch have a finite growth; a wider cone takes the
steps of this one."""


def step_length(t: mi.Float, held: mi.Float, cone_ratio: mi.Float, config: AnyMarch) -> mi.Float:
    """Return the length of the step that begins at a distance.

    Parameters
    ----------
    t
        Distance from the apex, world units.
    held
        Edge of the finest voxels that hold the place, world units.
    cone_ratio
        Footprint diameter over distance.
    config
        Shortest step, and the rule of the others. Spheres around two axis points touch if the
        farther one lies at t (1 + h) / (1 - h), h being half the cone ratio.
    """
    if config.step_rule == "spheres":
        half = dr.minimum(0.5 * cone_ratio, WIDEST_SPHERES)
        wanted = t * 2.0 * half / (1.0 - half)
    else:
        wanted = config.step_ratio * cone_ratio * t
    return dr.maximum(wanted, config.min_step_voxels * held)


def seen_in_medium(
    extinction: mi.Float, source: mi.Color3f, step: mi.Float
) -> tuple[mi.Float, mi.Color3f]:
    """Return share stopped and radiance added by a homogeneous medium, in closed form.

    Parameters
    ----------
    extinction, source
        Optical depth and radiance per world unit.
    step
        Length, world units.
    """
    stopped = 1.0 - dr.exp(-extinction * step)
    if dr.grad_enabled(extinction, source, step):
        # The quotient below has no derivative in single precision where extinction is tiny.
        depth = extinction * step
        is_thin = depth < THIN_DEPTH
        series = 1.0 + depth * (-0.5 + depth * (1.0 / 6.0))
        share = dr.select(is_thin, series, stopped / dr.select(is_thin, 1.0, depth))
        return stopped, source * as_component(step * share)
    is_clear = extinction <= 0.0
    seen = source * as_component(stopped / dr.select(is_clear, 1.0, extinction))
    return stopped, dr.select(is_clear, 0.0, seen)


def corrected_sample(
    opacity: mi.Float, emittance: mi.Color3f, voxels: mi.Float, config: AnyMarch
) -> tuple[mi.Float, mi.Color3f]:
    """Return share stopped and radiance added by a sample of voxels.

    Parameters
    ----------
    opacity, emittance
        Of one voxel, emittance premultiplied.
    voxels
        Length of the step in voxels of the level that was read, times the correction factor.
    config
        Rules for opacity and for emittance.
    """
    if config.correction == "exponent":
        # 0^k of an opaque voxel is 0; the derivative there is kept finite by the smallest normal.
        clear = dr.maximum(1.0 - opacity, dr.smallest(mi.Float))  # type: ignore[no-untyped-call]
        stopped = 1.0 - dr.exp(voxels * dr.log(clear))
    elif config.correction == "linear":
        stopped = dr.minimum(voxels * opacity, 1.0)
    else:
        stopped = opacity
    if config.color == "proportional":
        return stopped, emittance * as_component(voxels)
    if config.correction == "none":
        return stopped, emittance
    # Where hardly anything is, both rules tend to the length of the step.
    is_thin = opacity < THIN_OPACITY
    growth = dr.select(is_thin, voxels, stopped / dr.select(is_thin, 1.0, opacity))
    return stopped, emittance * as_component(growth)
