"""The order of the stages that specular light takes: cones, filter, surfaces."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.config import RenderConfig
from vctgi.plan import Plan
from vctgi.scene.records import FilmSample, GBuffer
from vctgi.scene.sky import PrefilteredSky
from vctgi.stages.cone_tracing.cone_values import ConeValues
from vctgi.stages.cone_tracing.specular import trace_specular
from vctgi.stages.cone_tracing.tally import SampleTally
from vctgi.stages.reconstruction.denoising import filter_specular


def gather_specular(
    plan: Plan,
    gbuffer: GBuffer,
    volume: VoxelVolume,
    config: RenderConfig,
    sky: PrefilteredSky | None = None,
    film: FilmSample | None = None,
    tally: SampleTally | None = None,
    parameters: ConeValues | None = None,
) -> mi.Color3f:
    """Trace the specular cones of visible points, filter them, and weigh them with the surfaces.

    Parameters
    ----------
    plan
        Which cones the scene needs.
    gbuffer
        Visible points.
    volume
        Lit voxels.
    config
        Cones and filter.
    sky
        What cones see beyond the voxels; None: darkness.
    film
        Where the points lie in the picture, if they are pixels.
    tally
        Counts what the cones read; None: nothing is counted.
    parameters
        Values that go before the numbers of `config`, for derivatives; None: those numbers.

    Returns
    -------
    mi.Color3f
        Radiance towards the viewer, W m^-2 sr^-1.

    Raises
    ------
    ValueError
        A filter, or blue noise, for points that are not pixels.
    """
    cones, points = config.specular, gbuffer
    if parameters is not None:
        scale = parameters["specular_aperture_scale"]
        cones = replace(cones, aperture_scale=1.0)
        points = replace(gbuffer, specular_aperture=gbuffer.specular_aperture * scale)
    light = trace_specular(
        points,
        volume,
        cones,
        has_specular=plan.has_specular,
        has_passing=plan.has_passing,
        sky=sky,
        film=film,
        tally=tally,
    )
    if plan.has_specular and config.specular_filter.kind != "none":
        if film is None:
            raise ValueError(
                "gather_specular: only pixels have neighbours to filter with: pass `film`, or set "
                'RenderConfig.specular_filter.kind to "none".'
            )
        dr.eval(light)
        light.reflected = filter_specular(
            light.reflected,
            gbuffer,
            film.width,
            config.specular.min_aperture,
            config.specular_filter,
        )
    return light.towards_viewer(gbuffer)
