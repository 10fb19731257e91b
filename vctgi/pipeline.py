"""The order of the stages, and nothing else.

scene -> triangles, materials, lights -> plan
plan -> opacity voxelization -> reflective shadow maps -> injection -> sky, bounces
sky, bounces -> downsampling = volume
volume -> frame (`vctgi.frame_pipeline`)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.levels import ClipmapLayout
from vctgi.clipmap.regions import Region, count_voxels, own_regions
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.config import RenderConfig
from vctgi.errors import SceneError
from vctgi.frame_pipeline import Frame as Frame
from vctgi.frame_pipeline import FrameTally as FrameTally
from vctgi.frame_pipeline import gather_ambient as gather_ambient
from vctgi.frame_pipeline import gather_light as gather_light
from vctgi.frame_pipeline import render_frame as render_frame
from vctgi.light_pipeline import LitVolume as LitVolume
from vctgi.light_pipeline import light_voxels
from vctgi.parameters import ConeParameters
from vctgi.plan import SceneParts, plan_render
from vctgi.prepared import PreparedScene as PreparedScene
from vctgi.prepared import StageClock as StageClock
from vctgi.prepared import no_clock as no_clock
from vctgi.scene.constants import is_opaque_mask
from vctgi.scene.derivatives import check_derivatives
from vctgi.scene.light_checks import check_lights
from vctgi.scene.lights import list_lights
from vctgi.scene.lobe_kinds import list_lobe_kinds
from vctgi.scene.materials import describe_material
from vctgi.scene.reflectance import list_plain_bsdfs
from vctgi.scene.sky import black_sky, prefilter_sky
from vctgi.scene.surfaces import VoxelSurfaces, select_surfaces
from vctgi.scene.triangles import extract_triangles
from vctgi.stages.reconstruction.temporal import TemporalFrame as TemporalFrame
from vctgi.stages.reconstruction.temporal import accumulate, project
from vctgi.stages.reflective_shadow_map import KeptLight
from vctgi.stages.voxelization.opacity import voxelize_triangles
from vctgi.stages.voxelization.triangles import DeviceTriangles, upload_triangles
from vctgi.stages.voxelization.update import changed_bounds, update_opacity
from vctgi.trace_cache import TraceCache


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
    light
        Light from outside that `light_volume` found on them.
    """

    surfaces: VoxelSurfaces
    triangles: DeviceTriangles
    opacity: OpacityClipmap
    filled_count: int
    light: KeptLight = field(default_factory=KeptLight, init=False)


def prepare_scene(
    scene: mi.Scene, sensor: mi.Sensor, config: RenderConfig, clock: StageClock = no_clock
) -> PreparedScene:
    """Read a Mitsuba scene and decide what it needs.

    Raises
    ------
    SceneError
        The scene has no light or no geometry, vertices that are not finite, or a light that cannot
        shine: without a sensible power, an angle or an area, or inside geometry. A parameter has
        derivatives enabled that the picture has none by.
    """
    with clock("scene"):
        is_cut = config.emission_in_voxels or config.sky_in_cones or config.sky_lighting == "cones"
        is_ambient = config.mode == "ambient"
        is_tangled = not is_ambient and (is_cut or config.bounce_count > 0)
        has_derivatives = check_derivatives(
            scene,
            ("radiance",) if is_cut else (),
            can_shapes_move=config.voxelization.coverage == "analytic" and not is_tangled,
        )
        lights = [] if is_ambient and not config.is_kept("light") else list_lights(scene)
        if not lights and not is_ambient:
            raise SceneError("no light", "the scene", "add an emitter")
        check_lights(lights)
        triangles = extract_triangles(scene)
        reads_masks = config.is_kept("alpha")
        materials = [
            describe_material(bsdf, is_opaque_mask=not reads_masks and is_opaque_mask(bsdf))
            for bsdf in triangles.bsdfs
        ]
        with dr.suspend_grad():  # type: ignore[no-untyped-call]
            surfaces = select_surfaces(scene, sensor, triangles, materials)
            parts = SceneParts(
                triangles=triangles, materials=materials, surfaces=surfaces, lights=lights
            )
            plan = plan_render(scene, sensor, parts, config)
    sky = None
    if plan.has_sky_in_cones or plan.has_sky_by_cones:
        with clock("sky"):
            environment = scene.environment()
            sky = black_sky(config.sky)
            if environment is not None:
                sky = prefilter_sky(environment, config.sky)
    kinds = list_lobe_kinds(triangles.bsdfs) if plan.has_specular else None
    return PreparedScene(
        scene=scene,
        sensor=sensor,
        triangles=triangles,
        materials=materials,
        surfaces=surfaces,
        plan=plan,
        plain_bsdfs=list_plain_bsdfs(triangles.bsdfs),
        sky=sky,
        lobe_kinds=kinds,
        has_derivatives=has_derivatives,
    )


def voxelize_scene(
    prepared: PreparedScene,
    config: RenderConfig,
    clock: StageClock = no_clock,
    parameters: ConeParameters | None = None,
) -> SceneVoxels:
    """Voxelize the surfaces of a scene; `parameters` as for `light_volume`."""
    with clock("opacity voxelization"):
        layout = prepared.plan.layout
        triangles = _upload(prepared, config)
        rules, thickness = config.voxelization, None
        if parameters is not None:
            rules, thickness = parameters.voxelization(rules), parameters.get("thickness_voxels")
        opacity = voxelize_triangles(triangles, layout, rules, thickness)
        dr.eval(opacity.levels)
    filled = count_voxels(box for level in layout.clip_levels for box in own_regions(layout, level))
    return SceneVoxels(prepared.surfaces, triangles, opacity, filled)


def _upload(prepared: PreparedScene, config: RenderConfig) -> DeviceTriangles:
    """Return the surfaces on the device, with what alpha tests need where the plan keeps those."""
    return upload_triangles(
        prepared.surfaces,
        has_uv=bool(prepared.surfaces.masks) or config.is_kept("textures"),
        has_masks=bool(prepared.surfaces.masks) or config.is_kept("alpha"),
    )


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

    Raises
    ------
    SceneError
        Vertices have derivatives, which voxels that are kept have not.
    """
    if prepared.surfaces.live is not None:
        raise SceneError(
            "no derivative",
            "voxels that are updated in place",
            "detach the vertices, or make the voxels anew by voxelize_scene",
        )
    with clock("opacity voxelization"):
        # A level that is still empty would be a constant of all kernels, until something enters it.
        dr.make_opaque(voxels.opacity.levels[: prepared.plan.layout.clip_level_count])
        changed = changed_bounds(voxels.surfaces, prepared.surfaces)
        triangles = _upload(prepared, config) if changed else voxels.triangles
        before = voxels.opacity.layout
        opacity, stale = update_opacity(
            voxels.opacity, triangles, prepared.plan.layout, changed, config.voxelization
        )
    filled = count_voxels(box for boxes in stale for box in boxes)
    found = SceneVoxels(prepared.surfaces, triangles, opacity, filled)
    found.light = voxels.light
    changed_levels = _changed_levels(before, prepared.plan.layout, stale)
    found.light.follow(voxels.opacity, opacity, changed_levels)
    return found


def _changed_levels(
    before: ClipmapLayout, after: ClipmapLayout, stale: list[list[Region]]
) -> list[int]:
    """Return clip levels whose window or voxels are not what they were."""
    moved = [
        old.origin != new.origin
        for old, new in zip(before.clip_levels, after.clip_levels, strict=True)
    ]
    # What a finer window covers is not filled.
    return [
        number
        for number, is_moved in enumerate(moved)
        if is_moved or stale[number] or (number > 0 and moved[number - 1])
    ]


def light_volume(
    prepared: PreparedScene,
    config: RenderConfig,
    clock: StageClock = no_clock,
    voxels: SceneVoxels | None = None,
    parameters: ConeParameters | None = None,
    cache: TraceCache | None = None,
) -> LitVolume:
    """Light the voxels of a scene, which are made first if they are not given.

    In the mode "ambient" there is no light: they are only downsampled.

    Parameters
    ----------
    prepared, config
        Scene, and how it is lit.
    clock
        Times the stages.
    voxels
        What `voxelize_scene` or `update_voxels` returned; None: made here.
    parameters
        Values that go before the numbers of `config`, for derivatives; None: those numbers.
    cache
        Kept by the caller for the next frame, as for `render_frame`, and not for derivatives.

    Raises
    ------
    ValueError
        Parameters out of their bounds; a cache with parameters or derivatives.
    """
    if cache is not None:
        if parameters is not None or prepared.has_derivatives:
            raise ValueError(
                "light_volume: voxels that have derivatives are lit anew each time; leave out "
                "`cache`."
            )
        cache.hold(prepared.scene)
    if parameters is not None:
        parameters.check_bounds()
    kept = None if voxels is None or config.is_kept("motion") else voxels.light
    if voxels is None:
        voxels = voxelize_scene(prepared, config, clock, parameters)
    both = (voxels.surfaces, voxels.opacity)
    return light_voxels(prepared, config, clock, both, parameters, kept, cache)


def accumulate_frame(
    history: TemporalFrame | None, frame: Frame, sensor: mi.Sensor, config: RenderConfig
) -> tuple[Frame, TemporalFrame]:
    """Blend a frame with the light that earlier ones found on the same surfaces.

    Parameters
    ----------
    history
        What the call for the frame before returned; None for the first.
    frame
        The new frame, of another seed than the last.
    sensor
        Its camera.
    config
        How to blend.

    Returns
    -------
    tuple
        The frame with the accumulated light, and the history for the next.

    Raises
    ------
    SceneError
        The camera is none that can be followed.
    """
    height, width = frame.depth.shape[:2]
    pixel = dr.arange(mi.UInt32, width * height)

    def planes(tensor: mi.TensorXf) -> list[mi.Float]:
        count = tensor.shape[2]
        return [dr.gather(mi.Float, tensor.array, pixel * count + c) for c in range(count)]

    def tensor(values: list[mi.Float]) -> mi.TensorXf:
        flat = dr.empty(mi.Float, width * height * len(values))
        for channel, value in enumerate(values):
            dr.scatter(flat, value, pixel * len(values) + channel)
        return mi.TensorXf(flat, (height, width, len(values)))

    albedo = mi.Color3f(*planes(frame.albedo))
    is_ambient = frame.ambient is not None
    if frame.ambient is not None:
        irradiance = mi.Color3f(planes(frame.ambient)[0])
    else:
        is_reflecting = albedo > 0.0
        reflected = mi.Color3f(*planes(frame.indirect_diffuse))
        irradiance = dr.select(
            is_reflecting, reflected / dr.select(is_reflecting, albedo, 1.0), 0.0
        )
    new = TemporalFrame(
        projection=project(sensor),
        irradiance=irradiance,
        specular=mi.Color3f(*planes(frame.indirect_specular)),
        position=mi.Point3f(*planes(frame.position)),
        normal=mi.Vector3f(*planes(frame.surface_normal)),
        frame_count=dr.full(mi.Float, 1.0, width * height),
    )
    blended = accumulate(history, new, config.temporal)
    if is_ambient:
        return replace(frame, ambient=tensor([mi.Float(blended.irradiance.x)])), blended
    diffuse = albedo * blended.irradiance
    return (
        replace(
            frame,
            indirect_diffuse=tensor([mi.Float(each) for each in diffuse]),
            indirect_specular=tensor([mi.Float(each) for each in blended.specular]),
        ),
        blended,
    )
