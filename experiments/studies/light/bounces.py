"""Bounces: what a scattering from voxel to voxel keeps, whether they contract, and the Cornell box.

In the closed box every scattering multiplies the radiance of the walls by their albedo. The first
one is given exactly, so that no light map is to blame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np

import reference
import vctgi
from experiments.run import component_images
from experiments.scenes import load_scene
from experiments.studies import scenes
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.exact_voxels import lay_out_window, scene_of, surfaces_in
from vctgi.bounce_pipeline import slot_gatherer
from vctgi.clipmap.slot_surfaces import SlotSurfaces
from vctgi.clipmap.storage import EmittanceClipmap
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.stages.bounces import BouncesConfig, Gather, reflect
from vctgi.stages.slot_surfaces.slots import describe_slots
from vctgi.stages.voxelization.opacity import voxelize_opacity

PLACEMENTS = {"axis": False, "turned": True}
"""Whether the scene is turned by 33 degrees about (1, 2, 3) against the lattice."""

ALBEDOS = (0.2, 0.5, 0.8)
RADIUS_ALBEDOS = (0.5, 0.8, 0.95, 0.99)

CHAINS = (ALBEDOS, (0.8, 0.95, 0.99))
"""Albedos that are measured at a time, a channel of colour each."""

SCATTERING_COUNT = 8
"""Scatterings in the furnace after the one that is given."""

LEAST_KEPT, GOAL_KEPT = 0.92, 0.95
MOST_AT_A_POINT = 1.001
"""A closed box of one radiance cannot gain light; rounding can."""

LARGEST_SPREAD = 0.02
"""Of the share that a scattering keeps: largest over least, less 1."""

POWER_STEPS = (24, 8)
"""Scatterings of the power iteration, in the whole study and in the quick one."""

CORNELL_COUNTS = (2, 3, 4)
CORNELL_ENERGY = (0.92, 1.08)
"""Of 17 cones, as for one bounce."""

CORNELL_EDGE, CORNELL_SAMPLES = (64, 32), (1024, 256)
"""Pixels along an edge and paths a pixel, in the whole study and in the quick one."""

CONES = vctgi.preset("high").bounce_cones
CONFIGURATION = (
    f"{CONES.cone_count} cones a slot, near field of {CONES.near_field_voxels:g} voxels, level "
    f"bias {CONES.march.level_bias:g}, N = 64"
)
BOX = "closed box two wide, first scattering exact"


def checks() -> list[Check]:
    """Return the checks of bounces."""
    return [*_furnaces(), *_contraction(), *_cornell()]


@dataclass(frozen=True)
class Box:
    """The closed box: surfaces behind its slots, what they gather, light of radiance 1."""

    surfaces: list[SlotSurfaces]
    gather: Gather
    lit: EmittanceClipmap

    def of_albedos(self, albedos: tuple[float, ...]) -> list[SlotSurfaces]:
        """Return the surfaces as if they all reflected these shares, one a channel."""
        return [
            replace(each, albedo=dr.zeros(mi.Color3f, each.count) + mi.Color3f(*albedos))
            for each in self.surfaces
        ]

    def fluxes(self, light: EmittanceClipmap) -> np.ndarray:
        """Flux [channel] that all slots emit, W."""
        total = np.zeros(3)
        for each in self.surfaces:
            if each.count:
                color = dr.gather(mi.Color3f, light.levels[each.level.level], each.index)
                area = math.pi * each.level.voxel_size**2
                total += area * np.array(color, dtype=np.float64).sum(axis=1)
        return total


def _box(context: StudyContext, placement: str) -> Box:
    def build() -> Box:
        walls = scenes.white_furnace(1, seed=1)
        walls = walls.turned() if PLACEMENTS[placement] else walls
        world = scene_of(walls.triangles)
        voxelized = surfaces_in(world)
        opacity = voxelize_opacity(voxelized, lay_out_window(walls.triangles))
        surfaces = describe_slots(world, voxelized, opacity)
        empty = [
            dr.zeros(mi.Color3f, DIRECTION_COUNT * each.voxel_count)
            for each in opacity.layout.levels
        ]
        white = [replace(s, albedo=dr.full(mi.Color3f, 1.0, s.count)) for s in surfaces]
        ones = [dr.full(mi.Color3f, 1.0, each.count) for each in white]
        lit = reflect(EmittanceClipmap(opacity.layout, empty, [0.0]), white, ones)
        gather = slot_gatherer(world, surfaces, opacity, vctgi.preset("high"))
        return Box(surfaces, gather, lit)

    return context.once(f"box, {placement}", build)


@dataclass(frozen=True)
class Chain:
    """Scattering after scattering, for one albedo."""

    albedo: float
    fluxes: np.ndarray
    """Of each scattering, the given one first, W."""
    largest: float
    """Largest radiance that a slot gathered, over the closed form."""

    @property
    def kept(self) -> np.ndarray:
        """Share of the closed form's light that each scattering keeps."""
        found: np.ndarray = self.fluxes[1:] / self.fluxes[:-1] / self.albedo
        return found


def _chain(context: StudyContext, placement: str, albedo: float, count: int) -> Chain:
    """Return `count` scatterings after the given one."""
    albedos = next(each for each in CHAINS if albedo in each)

    def scatter() -> tuple[np.ndarray, np.ndarray]:
        box = _box(context, placement)
        surfaces = box.of_albedos(albedos)
        light, fluxes, largest = box.lit, [box.fluxes(box.lit)], np.zeros(3)
        for number in range(count):
            context.progress("scatterings", number / count)
            gathered = box.gather(light)
            truth = np.array(albedos) ** number
            for each in gathered:
                if dr.width(each):
                    largest = np.maximum(largest, np.array(each).max(axis=1) / truth)
            light = reflect(light, surfaces, gathered)
            fluxes.append(box.fluxes(light))
        return np.array(fluxes), largest

    fluxes, largest = context.once(f"chain, {placement}, {albedos}, {count}", scatter)
    channel = albedos.index(albedo)
    return Chain(albedo, fluxes[:, channel], float(largest[channel]))


def _furnaces() -> list[Check]:
    rows = [
        ("least share a scattering keeps", _least_kept, LEAST_KEPT, MOST_AT_A_POINT, GOAL_KEPT),
        ("largest point", _largest, None, MOST_AT_A_POINT, None),
        ("spread of the share kept", _spread_of_kept, None, LARGEST_SPREAD, None),
        ("light of all scatterings", _sum_of_light, None, MOST_AT_A_POINT, 1.0),
    ]
    return [
        Check(
            name=f"furnace, k = 1..{SCATTERING_COUNT}, albedo {albedo:g}, {placement}, {name}",
            configuration=CONFIGURATION,
            scene=BOX,
            measure=partial(measure, placement=placement, albedo=albedo),
            limit_low=low,
            limit_high=high,
            goal=goal,
        )
        for albedo in ALBEDOS
        for placement in PLACEMENTS
        for name, measure, low, high, goal in rows
    ]


def _least_kept(context: StudyContext, placement: str, albedo: float) -> Measured:
    kept = _chain(context, placement, albedo, SCATTERING_COUNT).kept
    return Measured(value=float(kept.min()))


def _largest(context: StudyContext, placement: str, albedo: float) -> Measured:
    return Measured(value=_chain(context, placement, albedo, SCATTERING_COUNT).largest)


def _spread_of_kept(context: StudyContext, placement: str, albedo: float) -> Measured:
    kept = _chain(context, placement, albedo, SCATTERING_COUNT).kept
    return Measured(value=float(kept.max() / kept.min() - 1.0))


def _sum_of_light(context: StudyContext, placement: str, albedo: float) -> Measured:
    """Sum over the closed form (1 - a^(k+1)) / (1 - a) of a wall that emits 1."""
    fluxes = _chain(context, placement, albedo, SCATTERING_COUNT).fluxes
    exact = (1.0 - albedo ** len(fluxes)) / (1.0 - albedo)
    return Measured(value=float(fluxes.sum() / fluxes[0] / exact))


def _contraction() -> list[Check]:
    found = []
    for albedo in RADIUS_ALBEDOS:
        for placement in PLACEMENTS:
            found.append(
                Check(
                    name=f"spectral radius of a bounce, albedo {albedo:g}, {placement}",
                    configuration=CONFIGURATION,
                    scene=BOX,
                    measure=partial(_radius, placement=placement, albedo=albedo),
                    # Beyond 0.95 the answer is only stated.
                    limit_high=1.0 if albedo <= 0.95 else None,
                    goal=albedo,
                )
            )
    for albedo in RADIUS_ALBEDOS:
        found.append(
            Check(
                name=f"light left out when bounces stop, albedo {albedo:g}",
                configuration=f"{CONFIGURATION}, "
                f"min_bounce_share {BouncesConfig().min_bounce_share:g}",
                scene=f"{BOX}, turned",
                measure=partial(_left_out, albedo=albedo),
                goal=0.0,
            )
        )
    return found


def _radius(context: StudyContext, placement: str, albedo: float) -> Measured:
    """Power iteration: a positive operator's successive fluxes approach its spectral radius."""
    count = POWER_STEPS[context.quick]
    fluxes = _chain(context, placement, albedo, count).fluxes
    return Measured(value=float(fluxes[-1] / fluxes[-2]))


def _left_out(context: StudyContext, albedo: float) -> Measured:
    """Share of all light that scatterings after the last one would add, by the measured radius."""
    radius = _radius(context, "turned", albedo).value
    share = BouncesConfig().min_bounce_share
    # The fluxes go on as the powers of the radius.
    last, total = 1.0, 1.0
    while True:
        last *= radius
        if last <= share * total:
            total += last
            break
        total += last
    rest = last * radius / (1.0 - radius)
    return Measured(value=rest / (total + rest))


def _cornell() -> list[Check]:
    return [
        Check(
            name=f"Cornell box, energy ratio, {count} scatterings",
            configuration='preset "high" with N = 64, light maps as they are',
            scene="built-in cornell_box, all indirect light, matched path tracing",
            measure=partial(_cornell_energy, count=count),
            limit_low=CORNELL_ENERGY[0],
            limit_high=CORNELL_ENERGY[1],
            goal=1.0,
        )
        for count in CORNELL_COUNTS
    ]


def _cornell_energy(context: StudyContext, count: int) -> Measured:
    return energy_ratio(context, "cornell_box", small_config(scattering_count=count))


def small_config(**changes: object) -> vctgi.RenderConfig:
    """Return the preset "high" at 64^3 voxels with changes."""
    config = vctgi.preset("high")
    clipmap = replace(config.clipmap, resolution=64)
    return replace(config, clipmap=clipmap, **changes)  # type: ignore[arg-type]


def energy_ratio(context: StudyContext, name: str, config: vctgi.RenderConfig) -> Measured:
    """Indirect light of a built-in scene over that of as many scatterings by path tracing.

    The interval is that of the reference's batches.
    """
    loaded = load_scene(name, resolution=CORNELL_EDGE[context.quick])
    sensor = loaded.scene.sensors()[loaded.sensor_index]
    prepared = vctgi.prepare_scene(loaded.scene, sensor, config)
    frame = vctgi.render_frame(prepared, vctgi.light_volume(prepared, config).volume, config)
    found = float(component_images(frame)["indirect"].mean())
    request = reference.ReferenceRequest(
        samples_per_pixel=CORNELL_SAMPLES[context.quick],
        batch_count=8,
        scattering_count=config.scattering_count,
        seed=0,
    )
    truth = context.once(
        f"truth, {name}, {config.scattering_count}",
        lambda: reference.render_reference(
            loaded.scene,
            sensor=loaded.sensor_index,
            request=request,
            cache_directory=None,
            progress=lambda share: context.progress("path tracing", share),
        ),
    )
    means = truth.batches("indirect").mean(axis=(1, 2, 3))
    return mean_of([found / float(each) for each in means])
