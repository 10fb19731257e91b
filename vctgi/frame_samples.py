"""One camera ray of every pixel: what it meets, what it gathers there, and what that adds up to.

`look` and `finish` are all that is done for it. They are two, because the host has to know in
between how many rays found no neighbour to take light from. A `TraceCache` records each of them.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.config import RenderConfig
from vctgi.frame_channels import (
    Channels,
    accumulate,
    ambient_sample,
    interleaved,
    light_sample,
    surfaces,
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
from vctgi.stages.cone_tracing.tally import FrameTally
from vctgi.stages.gbuffer import trace_gbuffer
from vctgi.stages.reconstruction.interpolation import (
    Gather,
    Interpolated,
    TracedPixels,
    interpolate,
    refine,
    trace_sparse,
)
from vctgi.stages.reconstruction.sparse_pixels import SparseGrid
from vctgi.trace_cache import TraceCache, with_windows_at_origin

Found = TypeVar("Found")


@dataclass
class Tracing:
    """What cones are traced in, how, and who watches.

    Attributes
    ----------
    prepared, volume, config, clock, tally, parameters
        As `vctgi.frame_pipeline.render_frame` takes them.
    cache, key
        Where what is traced is recorded, and what it depends on there; None: nowhere.
    """

    prepared: PreparedScene
    volume: VoxelVolume
    config: RenderConfig
    clock: StageClock = no_clock
    tally: FrameTally | None = None
    parameters: ConeParameters | None = None
    cache: TraceCache | None = None
    key: Hashable = None

    def __post_init__(self) -> None:
        """Refuse parameters out of their bounds."""
        if self.parameters is not None:
            self.parameters.check_bounds()

    def keep_in(self, cache: TraceCache | None) -> None:
        """Record what is traced."""
        if cache is None:
            return
        is_live = self.volume.has_derivatives or self.prepared.has_derivatives
        if self.tally is not None or self.parameters is not None or is_live:
            raise ValueError(
                "render_frame: a frame that is counted or has derivatives is traced anew each "
                "time; leave out `cache`."
            )
        self.cache, self.key = cache, cache.key_of(self.prepared, self.config)
        self.volume = with_windows_at_origin(self.volume)

    def run(
        self,
        part: Callable[..., Found],
        key: Hashable,
        *inputs: Any,
        reads_scene: bool = True,
    ) -> Found:
        """Return what a part of a frame makes of this and inputs, or launch its recording.

        Parameters
        ----------
        part
            Takes a `Tracing`, and the inputs.
        key
            What it depends on besides both.
        inputs
            Arrays.
        reads_scene
            Whether it looks at anything but the voxels: a scene of many objects takes the host
            longer to hand over than all the rest.
        """
        if self.cache is None:
            return part(self, *inputs)
        prepared, config = self.prepared, self.config
        scene = (prepared.scene, prepared.sensor) if reads_scene else None

        def recorded(
            scene: tuple[mi.Scene, mi.Sensor] | None,
            tables: tuple[PrefilteredSky | None, mi.UInt32 | None],
            volume: VoxelVolume,
            *inputs: Any,
        ) -> Found:
            sky, kinds = tables
            here = replace(prepared, sky=sky, lobe_kinds=kinds)
            if scene is not None:
                here = replace(here, scene=scene[0], sensor=scene[1])
            return part(Tracing(here, volume, config), *inputs)

        tables = (prepared.sky, prepared.lobe_kinds)
        with self.clock("recorded frame"):
            return self.cache.run(
                (part.__name__, self.key, key), recorded, scene, tables, self.volume, *inputs
            )


@dataclass
class Look:
    """What the camera rays met, and what light they have so far.

    Attributes
    ----------
    gbuffer
        What they met.
    traced
        The pixels that traced cones, where not all did.
    found
        The light of the rays, and which of them have to gather their own.
    """

    gbuffer: GBuffer
    traced: TracedPixels | None
    found: Interpolated


def look(
    tracing: Tracing,
    number: int,
    place_number: mi.UInt32,
    stream: mi.UInt32,
    traced: TracedPixels | None,
) -> Look:
    """Trace one camera ray of every pixel, and gather the light of those that trace cones.

    Parameters
    ----------
    tracing
        Scene, voxels, cones.
    number
        Of the ray in its pixel.
    place_number
        The same on the device: sets the place of the ray in its pixel.
    stream
        Chooses random numbers.
    traced
        Pixels that traced cones already and are not to do so again; None: some do now.
    """
    config = tracing.config
    width, height = (int(n) for n in tracing.prepared.sensor.film().crop_size())
    pixel = dr.arange(mi.UInt32, width * height)
    sample_index = random_bits(pixel, stream)
    place = mi.Point2f(pixel % width, pixel // width) + kronecker_points(place_number)
    with tracing.clock("G-buffer"):
        gbuffer = visible_points(tracing.prepared, config, place, sample_index)
    gather = gatherer(tracing)
    if config.reconstruction.sparsity == 1:
        return Look(gbuffer, None, Interpolated(gather(gbuffer), None))
    if traced is None:
        edge = config.reconstruction.edge
        grid = SparseGrid(width=width, height=height, edge=edge, layer=number)
        traced = trace_sparse(gbuffer, place, grid, gather)
    with tracing.clock("interpolation"):
        parameters = tracing.parameters
        widths = None if parameters is None else parameters.surface_widths()
        found = interpolate(gbuffer, place, traced, config.reconstruction, widths)
    return Look(gbuffer, traced, found)


@dataclass
class Sums:
    """The picture so far.

    Attributes
    ----------
    channels
        Sums over the camera rays of each pixel; after the last ray nothing.
    flats
        The same with the channels of each pixel side by side, after the last ray; else nothing.
    """

    channels: Channels
    flats: dict[str, mi.Float]


def finish(
    tracing: Tracing,
    number: int,
    gbuffer: GBuffer,
    light: mi.Color3f,
    alone: mi.UInt32 | None,
    sums: Channels,
) -> Sums:
    """Gather what is left, and add the samples of all pixels to the picture.

    Parameters
    ----------
    tracing
        Scene, voxels, cones.
    number
        Of the camera ray in its pixel.
    gbuffer, light
        What rays met, and the light they have so far.
    alone
        Numbers of those that have to gather their own; None: none has to.
    sums
        The picture so far.
    """
    light = refine(gbuffer, light, alone, gatherer(tracing))
    config = tracing.config
    if config.mode == "ambient":
        sample = ambient_sample(gbuffer, light)
    else:
        width = int(tracing.prepared.sensor.film().crop_size()[0])
        sample = light_sample(
            gbuffer, surface_light(tracing, gbuffer, light, FilmSample(width, number))
        )
    sums = accumulate(sums, sample, config.samples_per_pixel)
    if number == 0:
        sums = {**sums, **surfaces(gbuffer)}
    if number < config.samples_per_pixel - 1:
        return Sums(evaluated(sums), {})
    return Sums({}, interleaved(sums))


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


def surface_light(
    tracing: Tracing, gbuffer: GBuffer, incident: mi.Color3f, film: FilmSample | None
) -> IndirectLight:
    """Trace the specular cones of points, and add the diffuse light E / pi that they have."""
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


def openness(tracing: Tracing, gbuffer: GBuffer) -> mi.Float:
    """Return how open the hemisphere over visible points is, [0, 1]."""
    tally, parameters = tracing.tally, tracing.parameters
    counts = None if tally is None else tally.gathering
    scale = None if parameters is None else parameters["ambient_range_scale"]
    return trace_ambient(
        gbuffer, tracing.volume, tracing.config.ambient, tracing.prepared.scene, counts, scale
    )


def gatherer(tracing: Tracing) -> Gather:
    """Return what gathers the light that is interpolated: diffuse light, or how open it is."""
    prepared, volume, config = tracing.prepared, tracing.volume, tracing.config

    def ambient(gbuffer: GBuffer) -> mi.Color3f:
        with tracing.clock("ambient cones"):
            gray = mi.Color3f(as_component(openness(tracing, gbuffer)))
            dr.eval(gray)
        return gray

    def diffuse(gbuffer: GBuffer) -> mi.Color3f:
        sky = prepared.sky if prepared.plan.has_sky_in_cones else None
        counts = None if tracing.tally is None else tracing.tally.gathering
        with tracing.clock("diffuse cones"):
            incident = trace_diffuse(
                gbuffer, volume, config.diffuse, prepared.scene, sky, counts, tracing.parameters
            )
            return evaluated(incident)

    return ambient if config.mode == "ambient" else diffuse


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
