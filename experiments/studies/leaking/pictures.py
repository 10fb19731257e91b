"""The leak audit and the one-sided excess of whole pictures, with the renderer's own light."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np

import reference
import vctgi
from experiments.scenes import LoadedScene, load_scene
from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.cornell import PIXEL_PLACE
from experiments.studies.leaking.audit import PointLight, audit_of, audit_points, reflected_light
from experiments.studies.leaking.maps import add_audit_maps, add_excess_maps
from experiments.studies.noise import require_told_apart
from metrics.leaking import (
    LeakAudit,
    audit_shares,
    one_sided_excess,
    sealed_room_ratio,
    share_of_choices,
)
from metrics.measurement import Measurement
from vctgi.clipmap.storage import VoxelVolume
from vctgi.config import RenderConfig, preset
from vctgi.maths.stub_gaps import as_component
from vctgi.pipeline import PreparedScene
from vctgi.scene.records import GBuffer
from vctgi.stages.cone_tracing.diffuse import trace_diffuse
from vctgi.stages.gbuffer import trace_gbuffer

CHOSEN = "chosen scene"
"""The scene of `--scene`; without one, that of a corridor of rooms."""

SCENES = ("sealed_rooms", "cornell_box", CHOSEN)

EDGE = (64, 32)
BATCHES = (8, 4)
PATHS = (4096, 1024)
"""Pixels along an edge, batches of probes, and paths a pixel of the reference, in the whole study
and in the quick one."""

RESOLUTION = 64

ROUNDING = 1e-6
"""Of sums in double precision of numbers in single precision."""

DARK_TRUTH = 1e-9
"""Pixels of sealed_rooms with less true light lie in the dark room."""

MOST_LEAK = {"sealed_rooms": 0.10, "cornell_box": 0.10}
"""Most of the picture's light that may have leaked."""

CONFIGURATION = f'cones and light of preset "high", N = {RESOLUTION}'
GIVEN = ", 128 for a scene that is given"
LIGHT = "indirect diffuse light of two scatterings"
WORDS = {CHOSEN: "corridor, or the scene of --scene"}

HEADLINES = ("L3, dark_excess", "L3, missing_energy")
"""What is read first beside the leak."""

SHARES = ("leak_through", "leak_wrong_face", "leak", "missing_light")


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A scene as a camera sees it, its lit voxels, and what one ray through each pixel meets."""

    edge: int
    loaded: LoadedScene
    prepared: PreparedScene
    volume: VoxelVolume
    config: RenderConfig
    gbuffer: GBuffer

    def diffuse(self) -> np.ndarray:
        """Indirect diffuse light [row, column, rgb]."""
        incident = trace_diffuse(
            self.gbuffer, self.volume, self.config.diffuse, self.prepared.scene
        )
        light = np.array(self.gbuffer.albedo * incident, dtype=np.float64)
        return light.T.reshape(self.edge, self.edge, 3)

    def audit(self, count: int, volume: VoxelVolume | None = None) -> list[PointLight]:
        """Audit all pixels with several batches of probes, also in other voxels."""
        scene = self.prepared.scene
        return [
            audit_points(
                scene,
                self.volume if volume is None else volume,
                self.gbuffer,
                self.config.diffuse,
                reflected_light(scene),
                seed,
            )
            for seed in range(count)
        ]


def picture_config() -> RenderConfig:
    """Return the preset "high" with fewer voxels."""
    config = preset("high")
    return replace(config, clipmap=replace(config.clipmap, resolution=RESOLUTION))


def make_picture(source: str, edge: int, *, is_given: bool = False) -> Picture:
    """Load, voxelize and light a scene: a built-in one, or one that is given, in all its voxels."""
    loaded = load_scene(source, resolution=(edge, edge))
    config = preset("high") if is_given else picture_config()
    prepared = vctgi.prepare_scene(
        loaded.scene, loaded.scene.sensors()[loaded.sensor_index], config
    )
    volume = vctgi.light_volume(prepared, config).volume
    return Picture(
        edge=edge,
        loaded=loaded,
        prepared=prepared,
        volume=volume,
        config=config,
        gbuffer=_looked_at(prepared, config, edge),
    )


def _looked_at(prepared: PreparedScene, config: RenderConfig, edge: int) -> GBuffer:
    # Not through the centres of pixels, which may look exactly at an edge of a room.
    pixel = dr.arange(mi.UInt32, edge * edge)
    place = mi.Point2f(pixel % edge, pixel // edge) + mi.Point2f(*PIXEL_PLACE)
    ray, _ = prepared.sensor.sample_ray_differential(
        as_component(0.0), as_component(0.5), place / edge, mi.Point2f(0.5)
    )
    gbuffer = trace_gbuffer(
        prepared.scene,
        ray,
        pixel,
        config.gbuffer,
        has_specular=prepared.plan.has_specular,
        has_passing=prepared.plan.has_passing,
        lobe_kinds=prepared.lobe_kinds,
    )
    dr.eval(gbuffer)
    return gbuffer


def picture_of(context: StudyContext, name: str) -> Picture:
    """Return a picture, made once."""
    is_given = name == CHOSEN and context.scene is not None
    source = (context.scene or "corridor") if name == CHOSEN else name
    make = partial(make_picture, source, EDGE[context.quick], is_given=is_given)
    return context.once(f"picture of {name}", make)


def batches_of(context: StudyContext, name: str) -> list[PointLight]:
    """Return the audit's batches of a picture, found once."""
    picture, count = picture_of(context, name), BATCHES[context.quick]
    return context.once(f"audit of {name}", partial(picture.audit, count))


def audit_in(context: StudyContext, name: str) -> LeakAudit:
    """Return the audit of a picture, made and drawn once."""

    def audit() -> LeakAudit:
        edge = EDGE[context.quick]
        found = audit_of(batches_of(context, name), (edge, edge))
        add_audit_maps(context.shelf, picture_of(context, name).loaded.title, found)
        return found

    return context.once(f"whole audit of {name}", audit)


def checks() -> list[Check]:
    """Return the checks of pictures."""
    found = []
    for scene in SCENES:
        rows: list[tuple[str, Callable[..., Measured]]] = [
            (f"audit, {share}", partial(_share, share=share)) for share in SHARES
        ]
        rows += [
            ("audit, hidden from all probes (at least)", partial(_part, part="hidden")),
            ("audit, blocked from a probe (at most)", partial(_part, part="blocked")),
            ("audit by one choice a cone, blocked", _by_choice),
            ("L3, dark_excess", partial(_excess, row="dark_excess")),
            ("L3, missing_energy", partial(_excess, row="missing_energy")),
        ]
        for title, measure in rows:
            is_leak = title == "audit, leak"
            found.append(
                Check(
                    name=f"{scene}, {title}",
                    configuration=CONFIGURATION + (GIVEN if scene == CHOSEN else ""),
                    scene=f"{WORDS.get(scene, f'built-in {scene}')}, {LIGHT}",
                    measure=partial(measure, scene=scene),
                    limit_high=MOST_LEAK.get(scene) if is_leak else None,
                    goal=0.0,
                    in_quick=scene != CHOSEN,
                    is_headline=is_leak or title in HEADLINES,
                )
            )
    found += [
        Check(
            name=f"sealed_rooms, dark room alone, audit, {share}",
            configuration=CONFIGURATION,
            scene="built-in sealed_rooms, where all that is gathered has leaked",
            measure=partial(_dark_share, share=share),
            limit_low=1.0 - ROUNDING if share == "leak" else None,
            limit_high=1.0 + ROUNDING if share == "leak" else None,
        )
        for share in SHARES[:3]
    ]
    found.append(
        Check(
            name="sealed_rooms, L1, dark room over lit room",
            configuration=CONFIGURATION,
            scene=f"built-in sealed_rooms, {LIGHT}",
            measure=_rooms_ratio,
            limit_high=0.05,
            goal=0.0,
        )
    )
    return found


def _share(context: StudyContext, scene: str, share: str) -> Measured:
    return measured(audit_shares(audit_in(context, scene))[share])


def _part(context: StudyContext, scene: str, part: str) -> Measured:
    """Return a bound of the light that came through."""
    batches = batches_of(context, scene)
    edge = EDGE[context.quick]
    as_through = [replace(each, through=getattr(each, part)) for each in batches]
    return measured(audit_shares(audit_of(as_through, (edge, edge)))["leak_through"])


def _by_choice(context: StudyContext, scene: str) -> Measured:
    batches = batches_of(context, scene)
    light, blocked = (
        np.stack([getattr(each, name).ravel() for each in batches])
        for name in ("cone_light", "is_blocked")
    )
    return measured(share_of_choices(light, blocked))


def _excess(context: StudyContext, scene: str, row: str) -> Measured:
    def compare() -> dict[str, Measurement]:
        picture = picture_of(context, scene)
        request = reference.ReferenceRequest(
            samples_per_pixel=PATHS[context.quick], batch_count=8, rest_samples_per_pixel=0
        )
        truth = reference.render_reference(
            picture.loaded.scene,
            sensor=picture.loaded.sensor_index,
            request=request,
            cache_directory=None,
            progress=lambda share: context.progress("path tracing", share),
        )
        light, batches = picture.diffuse(), truth.batches("indirect_diffuse")
        require_told_apart(light, batches, PATHS[context.quick], f"the reference of {scene}")
        add_excess_maps(context.shelf, picture.loaded.title, light, batches)
        return one_sided_excess(light, batches)

    return measured(context.once(f"excess of {scene}", compare)[row])


def dark_room(audit: LeakAudit) -> np.ndarray:
    """Return where a picture of sealed_rooms shows the dark room [row, column]."""
    found: np.ndarray = (audit.truth.mean(axis=0) < DARK_TRUTH) & (
        audit.gathered.mean(axis=0) > 0.0
    )
    return found


def _rooms_ratio(context: StudyContext) -> Measured:
    audit = audit_in(context, "sealed_rooms")
    return rooms_ratio(audit, dark_room(audit))


def rooms_ratio(audit: LeakAudit, is_dark: np.ndarray) -> Measured:
    """Return L1 of a picture of sealed_rooms, given where it shows the dark room."""
    gathered, truth = audit.gathered.mean(axis=0), audit.truth.mean(axis=0)
    return Measured(value=sealed_room_ratio(gathered[is_dark], gathered[truth >= DARK_TRUTH]))


def _dark_share(context: StudyContext, share: str) -> Measured:
    audit = audit_in(context, "sealed_rooms")
    return measured(audit_shares(audit, dark_room(audit))[share])


def measured(found: Measurement) -> Measured:
    """Return the number and interval of a metric."""
    return Measured(value=found.value, low=found.low, high=found.high)
