"""The order of the stages, and nothing else.

scene -> triangles, materials, lights -> plan
plan -> opacity voxelization -> reflective shadow maps -> injection -> sky, bounces
sky, bounces -> downsampling = volume
volume -> G-buffer -> diffuse cones, specular cones -> composite = frame
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from typing import Protocol

import drjit as dr
import mitsuba as mi

from vctgi.bounce_pipeline import light_by_cones
from vctgi.clipmap.regions import count_voxels, own_regions
from vctgi.clipmap.storage import OpacityClipmap, VoxelVolume, pack_volume
from vctgi.config import RenderConfig
from vctgi.errors import SceneError
from vctgi.maths.directions import TEA_ROUNDS, kronecker_points, random_unit
from vctgi.maths.stub_gaps import as_bits, as_component
from vctgi.plan import Plan, plan_render
from vctgi.scene.emissive import list_emissive_surfaces
from vctgi.scene.light_checks import check_lights
from vctgi.scene.lights import list_lights
from vctgi.scene.lobe_kinds import list_lobe_kinds
from vctgi.scene.materials import Material, describe_material
from vctgi.scene.records import FilmSample, GBuffer
from vctgi.scene.sky import PrefilteredSky, prefilter_sky
from vctgi.scene.surfaces import VoxelSurfaces, select_surfaces
from vctgi.scene.triangles import SceneTriangles, extract_triangles
from vctgi.specular_pipeline import gather_specular
from vctgi.stages.composite import IndirectLight, composite
from vctgi.stages.cone_tracing.diffuse import trace_diffuse
from vctgi.stages.downsampling import downsample
from vctgi.stages.gbuffer import trace_gbuffer
from vctgi.stages.light_injection import inject_light
from vctgi.stages.outgoing_radiance import with_radiance
from vctgi.stages.reflective_shadow_map import render_reflective_shadow_maps
from vctgi.stages.voxelization.emittance import voxelize_emission
from vctgi.stages.voxelization.opacity import voxelize_triangles
from vctgi.stages.voxelization.triangles import DeviceTriangles, upload_triangles
from vctgi.stages.voxelization.update import changed_bounds, update_opacity


class StageClock(Protocol):
    """Something that can time a stage."""

    def __call__(self, stage: str) -> AbstractContextManager[object]:
        """Return a context that lasts as long as the stage."""


def no_clock(stage: str) -> AbstractContextManager[object]:
    """Time nothing."""
    return nullcontext(stage)


@dataclass
class PreparedScene:
    """A scene as the renderer sees it.

    Attributes
    ----------
    scene, sensor
        The Mitsuba scene and the camera it was prepared for.
    triangles, materials, surfaces
        Geometry, what its BSDFs contribute, and the sides that are voxelized.
    plan
        What is run and what is left out.
    sky
        The environment for cones, if any of them see it.
    lobe_kinds
        Which BSDFs have their lobes' cones in a table, if any has.
    """

    scene: mi.Scene
    sensor: mi.Sensor
    triangles: SceneTriangles
    materials: list[Material]
    surfaces: VoxelSurfaces
    plan: Plan
    sky: PrefilteredSky | None = None
    lobe_kinds: mi.UInt32 | None = None


@dataclass
class SceneVoxels:
    """Voxels of a scene's surfaces, which are kept over frames.

    Attributes
    ----------
    surfaces, triangles
        What they hold, on the host and on the device.
    opacity
        Opacity at each clip level's own resolution.
    filled_count
        Voxels that the last call filled anew.
    """

    surfaces: VoxelSurfaces
    triangles: DeviceTriangles
    opacity: OpacityClipmap
    filled_count: int


@dataclass
class LitVolume:
    """Lit voxels, with what was lost on the way.

    Attributes
    ----------
    volume
        Opacity and emittance.
    lost_flux_share
        Share of the reflected flux that found no opacity, for each clip level.
    texel_count
        Lit points of all reflective shadow maps.
    bounce_fluxes
        Flux that the voxels emit after each scattering, W; empty where light goes straight from
        the injection to the eye.
    """

    volume: VoxelVolume
    lost_flux_share: list[float]
    texel_count: int
    bounce_fluxes: list[float] = field(default_factory=list)


@dataclass
class Frame:
    """A rendered picture, each component a tensor [height, width, channels].

    Attributes
    ----------
    indirect_diffuse, indirect_specular
        W m^-2 sr^-1, three channels; indirect light is their sum.
    albedo
        Diffuse albedo, three channels.
    normal
        Shading normal, three channels in [-1, 1].
    depth
        Distance along the ray, world units, one channel.
    """

    indirect_diffuse: mi.TensorXf
    indirect_specular: mi.TensorXf
    albedo: mi.TensorXf
    normal: mi.TensorXf
    depth: mi.TensorXf


def prepare_scene(
    scene: mi.Scene, sensor: mi.Sensor, config: RenderConfig, clock: StageClock = no_clock
) -> PreparedScene:
    """Read a Mitsuba scene and decide what it needs.

    Raises
    ------
    SceneError
        The scene has no light or no geometry, vertices that are not finite, or a light that cannot
        shine: without a sensible power, an angle or an area, or inside geometry.
    """
    with clock("scene"):
        lights = list_lights(scene)
        if not lights:
            raise SceneError("no light", "the scene", "add an emitter")
        check_lights(lights)
        triangles = extract_triangles(scene)
        materials = [describe_material(bsdf) for bsdf in triangles.bsdfs]
        surfaces = select_surfaces(scene, sensor, triangles, materials)
        plan = plan_render(scene, sensor, triangles, materials, lights, config)
    sky = None
    if plan.has_sky_in_cones or plan.has_sky_by_cones:
        with clock("sky"):
            sky = prefilter_sky(scene.environment(), config.sky)
    kinds = list_lobe_kinds(triangles.bsdfs) if plan.has_specular else None
    return PreparedScene(scene, sensor, triangles, materials, surfaces, plan, sky, kinds)


def voxelize_scene(
    prepared: PreparedScene, config: RenderConfig, clock: StageClock = no_clock
) -> SceneVoxels:
    """Voxelize the surfaces of a scene."""
    with clock("opacity voxelization"):
        layout = prepared.plan.layout
        triangles = upload_triangles(prepared.surfaces)
        opacity = voxelize_triangles(triangles, layout, config.voxelization)
        dr.eval(opacity.levels)
    filled = count_voxels(box for level in layout.clip_levels for box in own_regions(layout, level))
    return SceneVoxels(prepared.surfaces, triangles, opacity, filled)


def update_voxels(
    voxels: SceneVoxels, prepared: PreparedScene, config: RenderConfig, clock: StageClock = no_clock
) -> SceneVoxels:
    """Make voxels follow a moved camera, and surfaces that moved, came or went.

    Parameters
    ----------
    voxels
        Voxels of an earlier frame; used up, their arrays are changed.
    prepared
        The scene as it is now, with windows of the same sizes (`clipmap.levels.move_clipmap`).
    config
        As for the earlier frame.
    clock
        Times the stages.

    Returns
    -------
    SceneVoxels
        The same as `voxelize_scene` returns, bit for bit.
    """
    with clock("opacity voxelization"):
        changed = changed_bounds(voxels.surfaces, prepared.surfaces)
        triangles = upload_triangles(prepared.surfaces) if changed else voxels.triangles
        opacity, stale = update_opacity(
            voxels.opacity, triangles, prepared.plan.layout, changed, config.voxelization
        )
    filled = count_voxels(box for boxes in stale for box in boxes)
    return SceneVoxels(prepared.surfaces, triangles, opacity, filled)


def light_volume(
    prepared: PreparedScene,
    config: RenderConfig,
    clock: StageClock = no_clock,
    voxels: SceneVoxels | None = None,
) -> LitVolume:
    """Light the voxels of a scene, which are made first if they are not given."""
    plan = prepared.plan
    if voxels is None:
        voxels = voxelize_scene(prepared, config, clock)
    opacity = voxels.opacity
    with clock("reflective shadow maps"):
        maps = render_reflective_shadow_maps(
            prepared.scene, list(plan.lights), plan.layout, config.reflective_shadow_map, opacity
        )
    if config.injection.needs_radiance:
        with clock("radiance of lit points"):
            maps = with_radiance(prepared.scene, maps)
    with clock("light injection"):
        emittance = inject_light(maps, opacity, config.injection)
    fluxes: list[float] = []
    if plan.bounce_count > 0 or plan.has_sky_by_cones:
        emittance, fluxes = light_by_cones(
            prepared.scene, voxels.surfaces, opacity, emittance, config, prepared.sky, clock
        )
    if config.emission_in_voxels:
        with clock("emittance voxelization"):
            opacity, emitted = voxelize_emission(list_emissive_surfaces(prepared.scene), opacity)
            both = zip(emittance.levels, emitted.levels, strict=True)
            emittance = replace(emittance, levels=[light + own for light, own in both])
    with clock("downsampling"):
        merged, lit = downsample(opacity, emittance)
        assert lit is not None, "downsampling keeps the emittance it is given"
        volume = pack_volume(merged, lit, config.storage)
    return LitVolume(volume, lit.lost_flux_share, sum(m.texel_count for m in maps), fluxes)


def gather_light(
    prepared: PreparedScene,
    gbuffer: GBuffer,
    volume: VoxelVolume,
    config: RenderConfig,
    clock: StageClock = no_clock,
    film: FilmSample | None = None,
) -> IndirectLight:
    """Trace the cones of visible points and put their light together.

    `film` says that the points are pixels; without it nothing can be filtered, and noise that is
    bound to pixels is refused.
    """
    plan = prepared.plan
    sky = prepared.sky if plan.has_sky_in_cones else None
    with clock("diffuse cones"):
        incident = trace_diffuse(gbuffer, volume, config.diffuse, prepared.scene, sky)
        dr.eval(incident)
    specular = None
    if plan.has_specular or plan.has_passing:
        with clock("specular cones"):
            specular = gather_specular(plan, gbuffer, volume, config, sky, film)
            dr.eval(specular)
    with clock("composite"):
        light = composite(gbuffer, incident, specular)
        dr.eval(light)
    return light


def render_frame(
    prepared: PreparedScene,
    volume: VoxelVolume,
    config: RenderConfig,
    clock: StageClock = no_clock,
    seed: int = 0,
) -> Frame:
    """Render the indirect light of a picture.

    Parameters
    ----------
    prepared
        Scene and camera.
    volume
        Its lit voxels.
    config
        Cones and samples per pixel.
    clock
        Times the stages.
    seed
        Chooses the random rotations and phases of the cones.
    """
    width, height = (int(n) for n in prepared.sensor.film().crop_size())
    pixel_count = width * height
    sums = {name: dr.zeros(mi.Float, pixel_count * n) for name, n in CHANNELS.items()}
    pixel = dr.arange(mi.UInt32, pixel_count)
    for number in range(config.samples_per_pixel):
        stream = dr.opaque(mi.UInt32, number + seed * SEED_STRIDE)
        sample_index = mi.UInt32(mi.sample_tea_32(as_bits(pixel), as_bits(stream), TEA_ROUNDS)[0])
        with clock("G-buffer"):
            ray = _camera_rays(prepared.sensor, pixel, sample_index, number)
            gbuffer = trace_gbuffer(
                prepared.scene,
                ray,
                sample_index,
                config.gbuffer,
                has_specular=prepared.plan.has_specular,
                has_passing=prepared.plan.has_passing,
                lobe_kinds=prepared.lobe_kinds,
            )
            dr.eval(gbuffer)
        film = FilmSample(width, number)
        light = gather_light(prepared, gbuffer, volume, config, clock, film)
        _accumulate(sums, gbuffer, light, pixel, config.samples_per_pixel)
    shaped = {name: mi.TensorXf(sums[name], (height, width, n)) for name, n in CHANNELS.items()}
    return Frame(**shaped)


CHANNELS = {"indirect_diffuse": 3, "indirect_specular": 3, "albedo": 3, "normal": 3, "depth": 1}
"""Components of a frame and their channels."""

SEED_STRIDE = 4096
"""Samples per pixel that one seed may use before it meets the next seed's."""


def _camera_rays(
    sensor: mi.Sensor, pixel: mi.UInt32, sample_index: mi.UInt32, number: int
) -> mi.RayDifferential3f:
    """One ray a pixel, at the place within the pixel that belongs to this sample."""
    film = sensor.film()
    crop, size = film.crop_size(), film.size()
    offset = film.crop_offset()
    width = int(crop[0])
    place = mi.Point2f(pixel % width, pixel // width) + kronecker_points(
        dr.opaque(mi.UInt32, number)
    )
    position = (place + mi.Point2f(float(offset[0]), float(offset[1]))) / mi.Point2f(
        float(size[0]), float(size[1])
    )
    lens = mi.Point2f(random_unit(sample_index, 1), random_unit(sample_index, 2))
    time = sensor.shutter_open() + sensor.shutter_open_time() * random_unit(sample_index, 3)
    ray, _ = sensor.sample_ray_differential(
        as_component(time), as_component(random_unit(sample_index, 4)), position, lens
    )
    return ray


def _accumulate(
    sums: dict[str, mi.Float],
    gbuffer: GBuffer,
    light: IndirectLight,
    pixel: mi.UInt32,
    sample_count: int,
) -> None:
    """Add a sample of each pixel to the picture."""
    depth = gbuffer.depth / sample_count
    values: dict[str, list[mi.Float]] = {
        "indirect_diffuse": list(light.diffuse / sample_count),
        "indirect_specular": list(light.specular / sample_count),
        "albedo": list(gbuffer.albedo / sample_count),
        "normal": list(dr.select(gbuffer.is_valid, gbuffer.normal, 0.0) / sample_count),
        "depth": [depth],
    }
    for name, channels in values.items():
        for channel, value in enumerate(channels):
            index = pixel * len(channels) + channel
            held = dr.gather(mi.Float, sums[name], index)
            dr.scatter(sums[name], held + value, index)
    dr.eval(sums)
