"""The march of a cone through the clipmap, shared by every kind of cone.

A cone accumulates radiance and loses transmittance in steps that grow with its footprint, each
read from a coarser level than the one before. The march is continuous in its parameters: samples
lie in the middle of their step, the last step ends exactly at the rim, levels are interpolated, and
the phase of the first step can be jittered.

Near opacity 1 it stays bounded: the optical depth of a voxel is at most OPTICAL_DEPTH_CAP of
`clipmap/sampling.py`, so neither depth nor derivative becomes infinite. Recipes of other systems
(`vctgi/peers.py`) are rules of the same loop.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.clipmap.texel_choice import TexelChoice
from vctgi.stages.cone_tracing.live_march import AnyMarch
from vctgi.stages.cone_tracing.march_config import ConeMarchConfig as ConeMarchConfig
from vctgi.stages.cone_tracing.march_derivative import differentiated_march, has_derivatives
from vctgi.stages.cone_tracing.march_loop import ConeSample as ConeSample
from vctgi.stages.cone_tracing.march_loop import run_march
from vctgi.stages.cone_tracing.march_step import ConeRay
from vctgi.stages.cone_tracing.march_step import finest_level as finest_level
from vctgi.stages.cone_tracing.march_step import level_around as level_around
from vctgi.stages.cone_tracing.march_step import level_read as level_read
from vctgi.stages.cone_tracing.march_step import limited_end as limited_end
from vctgi.stages.cone_tracing.march_step import march_range as march_range
from vctgi.stages.cone_tracing.march_step import step_at as step_at


def march_cone(
    volume: VoxelVolume,
    apex: mi.Point3f,
    axis: mi.Vector3f,
    cone_ratio: mi.Float,
    phase: mi.Float,
    config: AnyMarch,
    active: mi.Bool,
    t_near: mi.Float | float = 0.0,
) -> ConeSample:
    """March one cone per lane through the clipmap.

    Parameters
    ----------
    volume
        Opacity and emittance to march through, `VoxelVolume.choosing` texels where
        `config.filtering` wants that. Where anything has derivatives single texels are not
        chosen but interpolated: the choice of one has none.
    apex
        World points where the cones start.
    axis
        Unit directions.
    cone_ratio
        Footprint diameter over distance, 2 tan(aperture / 2), >= 0.
    phase
        Share of the first step that is taken, (0, 1].
    config
        Step, offset and level rules.
    active
        Lanes that march; the others return nothing seen and everything let through.
    t_near
        Distance before which the cone is not marched, because real rays saw to it, world units.

    Raises
    ------
    ValueError
        Derivatives of voxels in a format that has none, or a volume that chooses texels where the
        configuration interpolates, or the other way round.

    References
    ----------
    [Panteleev2014], slides "Cone tracing basics" and "Diffuse and specular cone tracing".
    """
    if (volume.choice is None) != (config.filtering == "linear"):
        raise ValueError(
            f'march_cone: ConeMarchConfig.filtering is "{config.filtering}"; pass '
            "`volume.choosing(random_choice(..., config.filtering))`, see "
            "vctgi.clipmap.texel_choice."
        )
    layout = volume.layout
    inputs = (apex, axis, cone_ratio, phase, active)
    full = dr.zeros(mi.Float, max(dr.width(each) for each in inputs))
    t_begin, t_end = march_range(volume, apex, axis, cone_ratio)
    t_end = limited_end(layout, t_end, cone_ratio, config)
    start = config.start_offset_voxels * layout.finest_voxel_size
    t_start = dr.maximum(start * dr.exp2(finest_level(volume, apex)), t_near)
    t = dr.maximum(t_begin, t_start) + full
    cone = ConeRay(apex, axis, cone_ratio, t_end)
    if has_derivatives(volume, cone, t, phase, config):
        if volume.choice is not None and volume.choice.offset is not None:
            volume = volume.choosing(TexelChoice(volume.choice.level, None))
        return differentiated_march(volume, cone, t, phase + full, active, config)
    return run_march(volume, cone, t, phase + full, active, config)
