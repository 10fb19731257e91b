"""The order of the stages that make a picture of lit voxels, and nothing else.

volume -> G-buffer -> diffuse cones of some pixels -> interpolation, or diffuse cones of all
volume -> G-buffer -> specular cones
diffuse, specular -> composite = a sample of each pixel; their mean = frame
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.config import RenderConfig
from vctgi.maths.directions import kronecker_points, random_bits, random_unit
from vctgi.maths.stub_gaps import as_component
from vctgi.parameters import ConeParameters
from vctgi.prepared import PreparedScene, StageClock, no_clock
from vctgi.scene.records import FilmSample, GBuffer
from vctgi.specular_pipeline import gather_specular
from vctgi.stages.composite import IndirectLight, composite
from vctgi.stages.cone_tracing.ambient import trace_ambient
from vctgi.stages.cone_tracing.diffuse import trace_diffuse
from vctgi.stages.cone_tracing.tally import FrameTally as FrameTally
from vctgi.stages.gbuffer import trace_gbuffer
from vctgi.stages.reconstruction.interpolation import Gather, interpolate, refine, trace_sparse
from vctgi.stages.reconstruction.sparse_pixels import SparseGrid


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

    Raises
    ------
    ValueError
        Parameters out of their bounds.
    """
    width, height = (int(n) for n in prepared.sensor.film().crop_size())
    count = config.samples_per_pixel
    is_ambient = config.mode == "ambient"
    pixel = dr.arange(mi.UInt32, width * height)
    tracing = _Tracing(prepared, volume, config, clock, tally, parameters)
    gather = _gatherer(tracing)
    sums: dict[str, list[mi.Float]] = {}
    first, traced, refined_count = {}, None, 0
    for number in range(count):
        stream = dr.opaque(mi.UInt32, number + seed * SEED_STRIDE)
        sample_index = random_bits(pixel, stream)
        place = mi.Point2f(pixel % width, pixel // width) + kronecker_points(
            dr.opaque(mi.UInt32, number)
        )
        with clock("G-buffer"):
            gbuffer = visible_points(prepared, config, place, sample_index)
        if number == 0:
            first = _surfaces(gbuffer)
        if config.reconstruction.sparsity == 1:
            incident = gather(gbuffer)
        else:
            if traced is None or not config.reconstruction.is_traced_once:
                edge = config.reconstruction.edge
                grid = SparseGrid(width=width, height=height, edge=edge, layer=number)
                traced = trace_sparse(gbuffer, place, grid, gather)
            with clock("interpolation"):
                widths = None if parameters is None else parameters.surface_widths()
                found = interpolate(gbuffer, place, traced, config.reconstruction, widths)
            incident = refine(gbuffer, found, gather)
            refined_count += dr.width(found.alone)
        if is_ambient:
            sample = _ambient_sample(gbuffer, incident)
        else:
            film = FilmSample(width, number)
            light = _gather_light(tracing, gbuffer, incident, film)
            sample = _light_sample(gbuffer, light)
        _accumulate(sums, sample, count)
    tensors = _tensors({**sums, **first}, width, height)
    return Frame(
        indirect_diffuse=tensors["indirect_diffuse"],
        indirect_specular=tensors["indirect_specular"],
        albedo=tensors["albedo"],
        normal=tensors["normal"],
        depth=tensors["depth"],
        position=tensors["position"],
        surface_normal=tensors["surface_normal"],
        ambient=tensors.get("ambient"),
        refined_share=refined_count / (width * height * count),
    )


def visible_points(
    prepared: PreparedScene, config: RenderConfig, place: mi.Point2f, sample_index: mi.UInt32
) -> GBuffer:
    """Return what rays through places of the picture, in pixels, meet first."""
    gbuffer = trace_gbuffer(
        prepared.scene,
        _camera_rays(prepared.sensor, place, sample_index),
        sample_index,
        config.gbuffer,
        has_specular=prepared.plan.has_specular,
        has_passing=prepared.plan.has_passing,
        lobe_kinds=prepared.lobe_kinds,
    )
    dr.eval(gbuffer)
    return gbuffer


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
    tracing = _Tracing(prepared, volume, config, no_clock, None, parameters)
    return _gather_light(tracing, gbuffer, _gatherer(tracing)(gbuffer), None)


def gather_ambient(
    prepared: PreparedScene,
    gbuffer: GBuffer,
    volume: VoxelVolume,
    config: RenderConfig,
    tally: FrameTally | None = None,
    parameters: ConeParameters | None = None,
) -> mi.Float:
    """Return how open the hemisphere over visible points is, [0, 1]."""
    counts = None if tally is None else tally.gathering
    scale = None if parameters is None else parameters["ambient_range_scale"]
    return trace_ambient(gbuffer, volume, config.ambient, prepared.scene, counts, scale)


@dataclass
class _Tracing:
    """What cones are traced in, how, and who watches."""

    prepared: PreparedScene
    volume: VoxelVolume
    config: RenderConfig
    clock: StageClock
    tally: FrameTally | None
    parameters: ConeParameters | None

    def __post_init__(self) -> None:
        if self.parameters is not None:
            self.parameters.check_bounds()


def _gather_light(
    tracing: _Tracing, gbuffer: GBuffer, incident: mi.Color3f, film: FilmSample | None
) -> IndirectLight:
    """Trace the specular cones of points, and add the diffuse light E / pi that they have."""
    plan, config, tally = tracing.prepared.plan, tracing.config, tracing.tally
    specular = None
    if plan.has_specular or plan.has_passing:
        with tracing.clock("specular cones"):
            sky = tracing.prepared.sky if plan.has_sky_in_cones else None
            counts = None if tally is None else tally.specular
            specular = gather_specular(
                plan, gbuffer, tracing.volume, config, sky, film, counts, tracing.parameters
            )
            dr.eval(specular)
    with tracing.clock("composite"):
        light = composite(gbuffer, incident, specular)
        dr.eval(light)
    return light


def _gatherer(tracing: _Tracing) -> Gather:
    """Return what gathers the light that is interpolated: diffuse light, or how open it is."""
    prepared, volume, config = tracing.prepared, tracing.volume, tracing.config
    tally, parameters = tracing.tally, tracing.parameters

    def ambient(gbuffer: GBuffer) -> mi.Color3f:
        with tracing.clock("ambient cones"):
            openness = gather_ambient(prepared, gbuffer, volume, config, tally, parameters)
            gray = mi.Color3f(as_component(openness))
            dr.eval(gray)
        return gray

    def diffuse(gbuffer: GBuffer) -> mi.Color3f:
        sky = prepared.sky if prepared.plan.has_sky_in_cones else None
        counts = None if tally is None else tally.gathering
        with tracing.clock("diffuse cones"):
            incident = trace_diffuse(
                gbuffer, volume, config.diffuse, prepared.scene, sky, counts, parameters
            )
            dr.eval(incident)
        return incident

    return ambient if config.mode == "ambient" else diffuse


SEED_STRIDE = 4096
"""Samples per pixel that one seed may use before it meets the next seed's."""


def _camera_rays(
    sensor: mi.Sensor, place: mi.Point2f, sample_index: mi.UInt32
) -> mi.RayDifferential3f:
    """Rays through places of the picture, pixels from its upper left corner."""
    width, height = (float(n) for n in sensor.film().crop_size())
    # Mitsuba's sensors count the unit square over the crop window, not over the film.
    position = place / mi.Point2f(width, height)
    lens = mi.Point2f(random_unit(sample_index, 1), random_unit(sample_index, 2))
    time = sensor.shutter_open() + sensor.shutter_open_time() * random_unit(sample_index, 3)
    ray, _ = sensor.sample_ray_differential(
        as_component(time), as_component(random_unit(sample_index, 4)), position, lens
    )
    return ray


def _surfaces(gbuffer: GBuffer) -> dict[str, list[mi.Float]]:
    """Return what the first ray of each pixel met."""
    normal = dr.select(gbuffer.is_valid, gbuffer.normal, 0.0)
    return {
        "position": [mi.Float(each) for each in gbuffer.position],
        "surface_normal": [mi.Float(each) for each in normal],
    }


def _light_sample(gbuffer: GBuffer, light: IndirectLight) -> dict[str, list[mi.Float]]:
    """Return a sample of each pixel of a picture of light."""
    return {
        "indirect_diffuse": list(light.diffuse),
        "indirect_specular": list(light.specular),
        **_surface_sample(gbuffer),
    }


def _ambient_sample(gbuffer: GBuffer, openness: mi.Color3f) -> dict[str, list[mi.Float]]:
    """Return a sample of each pixel of a picture of ambient occlusion, which has no light."""
    dark = [dr.zeros(mi.Float, dr.width(gbuffer.depth))] * 3
    return {
        "indirect_diffuse": dark,
        "indirect_specular": dark,
        **_surface_sample(gbuffer),
        "ambient": [mi.Float(dr.select(gbuffer.is_valid, openness.x, 1.0))],
    }


def _surface_sample(gbuffer: GBuffer) -> dict[str, list[mi.Float]]:
    normal = dr.select(gbuffer.is_valid, gbuffer.normal, 0.0)
    return {
        "albedo": list(gbuffer.albedo),
        "normal": [mi.Float(each) for each in normal],
        "depth": [gbuffer.depth],
    }


def _accumulate(
    sums: dict[str, list[mi.Float]], sample: dict[str, list[mi.Float]], sample_count: int
) -> None:
    """Add a sample of each pixel to the picture."""
    for name, channels in sample.items():
        shares = [mi.Float(channel) / sample_count for channel in channels]
        held = sums.get(name)
        sums[name] = shares if held is None else [a + b for a, b in zip(held, shares, strict=True)]
    dr.eval(sums)


def _tensors(
    channels: dict[str, list[mi.Float]], width: int, height: int
) -> dict[str, mi.TensorXf]:
    """Return pictures, each with its channels side by side."""
    pixel = dr.arange(mi.UInt32, width * height)
    tensors = {}
    for name, planes in channels.items():
        count = len(planes)
        flat = dr.empty(mi.Float, width * height * count)
        for number, plane in enumerate(planes):
            dr.scatter(flat, plane, pixel * count + number)
        tensors[name] = mi.TensorXf(flat, (height, width, count))
    dr.eval(tensors)
    return tensors
