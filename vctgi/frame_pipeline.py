"""The order of the stages that make a picture of lit voxels, and nothing else.

volume -> G-buffer -> diffuse cones of some pixels -> interpolation, or diffuse cones of all
volume -> G-buffer -> specular cones
diffuse, specular -> composite = a sample of each pixel; their mean = frame
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.config import RenderConfig
from vctgi.frame_channels import (
    accumulate,
    ambient_sample,
    light_sample,
    surfaces,
    tensors,
)
from vctgi.maths.directions import kronecker_points, random_bits, random_unit
from vctgi.maths.evaluation import evaluated
from vctgi.maths.stub_gaps import as_component
from vctgi.parameters import ConeParameters
from vctgi.prepared import PreparedScene, StageClock, no_clock
from vctgi.scene.records import FilmSample, GBuffer
from vctgi.scene.sky import PrefilteredSky
from vctgi.specular_pipeline import gather_specular
from vctgi.stages.composite import IndirectLight, composite
from vctgi.stages.cone_tracing.ambient import trace_ambient
from vctgi.stages.cone_tracing.diffuse import trace_diffuse
from vctgi.stages.cone_tracing.tally import FrameTally as FrameTally
from vctgi.stages.gbuffer import trace_gbuffer
from vctgi.stages.reconstruction.interpolation import Gather, interpolate, refine, trace_sparse
from vctgi.stages.reconstruction.sparse_pixels import SparseGrid
from vctgi.trace_cache import TraceCache as TraceCache
from vctgi.trace_cache import with_windows_at_origin


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
        frames that are counted or have derivatives; None: every frame is traced.

    Raises
    ------
    ValueError
        Parameters out of their bounds; a cache with a tally, parameters or derivatives.
    """
    width, height = (int(n) for n in prepared.sensor.film().crop_size())
    count = config.samples_per_pixel
    is_ambient = config.mode == "ambient"
    pixel = dr.arange(mi.UInt32, width * height)
    tracing = _Tracing(prepared, volume, config, clock, tally, parameters)
    tracing.keep_in(cache)
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
            gbuffer = _visible_points(tracing, place, sample_index)
        if number == 0:
            first = surfaces(gbuffer)
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
            sample = ambient_sample(gbuffer, incident)
        else:
            film = FilmSample(width, number)
            light = _gather_light(tracing, gbuffer, incident, film)
            sample = light_sample(gbuffer, light)
        accumulate(sums, sample, count)
    pictures = tensors({**sums, **first}, width, height)
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
    return evaluated(gbuffer)


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
    cache: TraceCache | None = None
    key: Hashable = None

    def __post_init__(self) -> None:
        if self.parameters is not None:
            self.parameters.check_bounds()

    def keep_in(self, cache: TraceCache | None) -> None:
        """Keep what is traced."""
        if cache is None:
            return
        if self.tally is not None or self.parameters is not None or self.volume.has_derivatives:
            raise ValueError(
                "render_frame: a frame that is counted or has derivatives is traced anew each "
                "time; leave out `cache`."
            )
        self.cache, self.key = cache, cache.key_of(self.prepared, self.config)
        self.volume = with_windows_at_origin(self.volume)

    @property
    def at(self) -> Callable[[mi.Scene, VoxelVolume, PrefilteredSky | None], _Tracing]:
        """What returns the same with other inputs, and keeps no voxels of these."""
        prepared, config = self.prepared, self.config

        def at(scene: mi.Scene, volume: VoxelVolume, sky: PrefilteredSky | None) -> _Tracing:
            here = replace(prepared, scene=scene, sky=sky)
            return _Tracing(here, volume, config, no_clock, None, None)

        return at

    @property
    def inputs(self) -> tuple[mi.Scene, VoxelVolume, PrefilteredSky | None]:
        """What `at` takes."""
        return self.prepared.scene, self.volume, self.prepared.sky


def _visible_points(tracing: _Tracing, place: mi.Point2f, sample_index: mi.UInt32) -> GBuffer:
    prepared, config = tracing.prepared, tracing.config
    if tracing.cache is None:
        return visible_points(prepared, config, place, sample_index)

    def visible(
        scene: mi.Scene,
        sensor: mi.Sensor,
        kinds: mi.UInt32 | None,
        place: mi.Point2f,
        sample_index: mi.UInt32,
    ) -> GBuffer:
        here = replace(prepared, scene=scene, sensor=sensor, lobe_kinds=kinds)
        return visible_points(here, config, place, sample_index)

    scene, sensor, kinds = prepared.scene, prepared.sensor, prepared.lobe_kinds
    key = ("visible points", tracing.key)
    return tracing.cache.run(key, visible, scene, sensor, kinds, place, sample_index)


def _gather_light(
    tracing: _Tracing, gbuffer: GBuffer, incident: mi.Color3f, film: FilmSample | None
) -> IndirectLight:
    """Trace the specular cones of points, and add the diffuse light E / pi that they have."""
    if tracing.cache is not None:
        at = tracing.at

        def gathered(
            scene: mi.Scene,
            volume: VoxelVolume,
            sky: PrefilteredSky | None,
            gbuffer: GBuffer,
            incident: mi.Color3f,
        ) -> IndirectLight:
            return _gather_light(at(scene, volume, sky), gbuffer, incident, film)

        with tracing.clock("specular cones"):
            key = ("light", tracing.key, film)
            return tracing.cache.run(key, gathered, *tracing.inputs, gbuffer, incident)
    plan, config, tally = tracing.prepared.plan, tracing.config, tracing.tally
    specular = None
    if plan.has_specular or plan.has_passing:
        with tracing.clock("specular cones"):
            sky = tracing.prepared.sky if plan.has_sky_in_cones else None
            counts = None if tally is None else tally.specular
            specular = evaluated(
                gather_specular(
                    plan, gbuffer, tracing.volume, config, sky, film, counts, tracing.parameters
                )
            )
    with tracing.clock("composite"):
        return evaluated(composite(gbuffer, incident, specular))


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
            return evaluated(incident)

    def kept(gbuffer: GBuffer) -> mi.Color3f:
        assert tracing.cache is not None, "only what is kept comes here"
        at = tracing.at

        def gathered(
            scene: mi.Scene, volume: VoxelVolume, sky: PrefilteredSky | None, gbuffer: GBuffer
        ) -> mi.Color3f:
            return _gatherer(at(scene, volume, sky))(gbuffer)

        with tracing.clock("diffuse cones"):
            key = ("cones", tracing.key, dr.width(gbuffer.position))
            return tracing.cache.run(key, gathered, *tracing.inputs, gbuffer)

    if tracing.cache is not None:
        return kept
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
