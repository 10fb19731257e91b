"""The order of the stages that make a picture of lit voxels, and nothing else.

volume -> G-buffer -> diffuse cones of some pixels -> interpolation, or diffuse cones of all
volume -> G-buffer -> specular cones
diffuse, specular -> composite = a sample of each pixel; their mean = frame

What is done for each camera ray of a pixel stands in `vctgi.frame_samples`.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.config import RenderConfig
from vctgi.frame_channels import tensors
from vctgi.frame_samples import Sums, Tracing, finish, gatherer, look, openness, surface_light
from vctgi.frame_samples import visible_points as visible_points
from vctgi.parameters import ConeParameters
from vctgi.prepared import PreparedScene, StageClock, no_clock
from vctgi.scene.records import GBuffer
from vctgi.stages.composite import IndirectLight
from vctgi.stages.cone_tracing.tally import FrameTally as FrameTally
from vctgi.stages.reconstruction.interpolation import lanes_for, lone_rays
from vctgi.trace_cache import TraceCache as TraceCache


@dataclass
class Frame:
    """A rendered picture, each component a tensor [height, width, channels].

    Attributes
    ----------
    indirect_diffuse, indirect_specular
        W m^-2 sr^-1, three channels; indirect light is their sum. Zero in the mode "ambient".
    albedo
        Diffuse albedo, three channels.
    normal
        Shading normal, three channels in [-1, 1].
    depth
        Distance along the ray, world units, one channel.
    position, surface_normal
        World point and unit normal that the first ray of each pixel met, three channels; zero where
        it met nothing.
    ambient
        How open the hemisphere is, one channel in [0, 1]; None but in the mode "ambient".
    refined_share
        Share of the camera rays that met a surface but found no neighbour to take diffuse light
        from, and so traced cones of their own; 0 where all do.
    """

    indirect_diffuse: mi.TensorXf
    indirect_specular: mi.TensorXf
    albedo: mi.TensorXf
    normal: mi.TensorXf
    depth: mi.TensorXf
    position: mi.TensorXf
    surface_normal: mi.TensorXf
    ambient: mi.TensorXf | None = None
    refined_share: float = 0.0


def render_frame(
    prepared: PreparedScene,
    volume: VoxelVolume,
    config: RenderConfig,
    clock: StageClock = no_clock,
    seed: int = 0,
    tally: FrameTally | None = None,
    parameters: ConeParameters | None = None,
    cache: TraceCache | None = None,
) -> Frame:
    """Render the indirect light of a picture, or its ambient occlusion.

    Parameters
    ----------
    prepared
        Scene and camera.
    volume
        Its voxels, lit but in the mode "ambient".
    config
        Cones and samples per pixel.
    clock
        Times the stages.
    seed
        Chooses the random rotations and phases of the cones.
    tally
        Counts what the frame's cones read, not those that light voxels; None: nothing is counted,
        and the kernels are those of a frame that never is.
    parameters
        Values that go before the numbers of `config`, for derivatives; None: those numbers.
    cache
        Kept by the caller for the next frame, which then need not be traced in Python. Not for
        frames that are counted or have derivatives. None: every frame is traced.

    Raises
    ------
    ValueError
        Parameters out of their bounds; a cache with a tally, parameters or derivatives.
    """
    width, height = (int(n) for n in prepared.sensor.film().crop_size())
    count = config.samples_per_pixel
    tracing = Tracing(prepared, volume, config, clock, tally, parameters)
    tracing.keep_in(cache)
    sums = Sums({}, {})
    traced, refined_count = None, 0
    for number in range(count):
        place_number = dr.opaque(mi.UInt32, number)
        stream = dr.opaque(mi.UInt32, number + seed * SEED_STRIDE)
        if not config.reconstruction.is_traced_once:
            traced = None
        seen = tracing.run(look, number, number, place_number, stream, traced)
        traced = seen.traced
        with clock("interpolation"):
            alone = lone_rays(seen.found)
        lone_count = 0 if alone is None else dr.width(alone)
        sums = tracing.run(
            finish,
            (number, lanes_for(lone_count)),
            number,
            seen.gbuffer,
            seen.found.light,
            alone,
            sums.channels,
            reads_scene=lone_count > 0,
        )
        refined_count += lone_count
    pictures = tensors(sums.flats, width, height)
    return Frame(
        indirect_diffuse=pictures["indirect_diffuse"],
        indirect_specular=pictures["indirect_specular"],
        albedo=pictures["albedo"],
        normal=pictures["normal"],
        depth=pictures["depth"],
        position=pictures["position"],
        surface_normal=pictures["surface_normal"],
        ambient=pictures.get("ambient"),
        refined_share=refined_count / (width * height * count),
    )


def gather_light(
    prepared: PreparedScene,
    gbuffer: GBuffer,
    volume: VoxelVolume,
    config: RenderConfig,
    parameters: ConeParameters | None = None,
) -> IndirectLight:
    """Trace the cones of visible points, which need not be pixels, and put their light together.

    Parameters
    ----------
    prepared, gbuffer, volume, config
        Scene, visible points, lit voxels, cones. Nothing can be filtered, and noise that is bound
        to pixels is refused.
    parameters
        Values that go before the numbers of `config`, for derivatives; None: those numbers.

    Raises
    ------
    ValueError
        Parameters out of their bounds.
    """
    tracing = Tracing(prepared, volume, config, parameters=parameters)
    return surface_light(tracing, gbuffer, gatherer(tracing)(gbuffer), None)


def gather_ambient(
    prepared: PreparedScene,
    gbuffer: GBuffer,
    volume: VoxelVolume,
    config: RenderConfig,
    tally: FrameTally | None = None,
    parameters: ConeParameters | None = None,
) -> mi.Float:
    """Return how open the hemisphere over visible points is, [0, 1]."""
    tracing = Tracing(prepared, volume, config, tally=tally, parameters=parameters)
    return openness(tracing, gbuffer)


SEED_STRIDE = 4096
"""Samples per pixel that one seed may use before it meets the next seed's."""
