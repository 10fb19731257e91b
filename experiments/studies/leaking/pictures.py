"""The leak audit and the one-sided excess of whole pictures, with the renderer's own light."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import drjit as dr
import matplotlib as mpl
import mitsuba as mi
import numpy as np
from matplotlib.figure import Figure

import reference
import vctgi
from experiments.scenes import load_scene
from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.cornell import PIXEL_PLACE
from experiments.studies.leaking.audit import PointLight, audit_of, audit_points, reflected_light
from experiments.studies.noise import require_told_apart
from metrics.leaking import (
    LeakAudit,
    audit_shares,
    excess_map,
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

SCENES = ("sealed_rooms", "cornell_box")

EDGE = (64, 32)
BATCHES = (8, 4)
PATHS = (1024, 1024)
"""Pixels along an edge, batches of probes, and paths a pixel of the reference, in the whole study
and in the quick one."""

RESOLUTION = 64

ROUNDING = 1e-6
"""Of sums in double precision of numbers in single precision."""

DARK_TRUTH = 1e-9
"""Pixels of sealed_rooms with less true light lie in the dark room."""

MOST_LEAK = {"sealed_rooms": 0.10, "cornell_box": 0.10}
"""Most of the picture's light that may have leaked."""

FAINT = 0.1
"""Brightest value of the maps of leaks, over that of the light gathered."""

SHARES = ("leak_through", "leak_wrong_face", "leak", "missing_light")


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A scene as a camera sees it, its lit voxels, and what one ray through each pixel meets."""

    edge: int
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


def make_picture(name: str, edge: int) -> Picture:
    """Load, voxelize and light a built-in scene."""
    loaded, config = load_scene(name, resolution=edge), picture_config()
    prepared = vctgi.prepare_scene(loaded.scene, loaded.scene.sensors()[0], config)
    volume = vctgi.light_volume(prepared, config).volume
    return Picture(
        edge=edge,
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
        has_specular=False,
        has_passing=False,
        lobe_kinds=None,
    )
    dr.eval(gbuffer)
    return gbuffer


def picture_of(context: StudyContext, name: str) -> Picture:
    """Return a picture, made once."""
    edge = EDGE[context.quick]
    return context.once(f"picture of {name}", partial(make_picture, name, edge))


def batches_of(context: StudyContext, name: str) -> list[PointLight]:
    """Return the audit's batches of a picture, found once."""
    picture, count = picture_of(context, name), BATCHES[context.quick]
    return context.once(f"audit of {name}", partial(picture.audit, count))


def audit_in(context: StudyContext, name: str) -> LeakAudit:
    """Return the audit of a picture; its map is written beside, if files are wanted."""
    edge = EDGE[context.quick]
    audit = audit_of(batches_of(context, name), (edge, edge))
    if context.output is not None:
        draw_leaks(audit, context.output / f"leaks-{name}.png")
    return audit


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
            found.append(
                Check(
                    name=f"{scene}, {title}",
                    configuration=f'cones and light of preset "high", N = {RESOLUTION}',
                    scene=f"built-in {scene}, indirect diffuse light of two scatterings",
                    measure=partial(measure, scene=scene),
                    limit_high=MOST_LEAK[scene] if title == "audit, leak" else None,
                    goal=0.0,
                )
            )
    found += [
        Check(
            name=f"sealed_rooms, dark room alone, audit, {share}",
            configuration=f'cones and light of preset "high", N = {RESOLUTION}',
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
            configuration=f'cones and light of preset "high", N = {RESOLUTION}',
            scene="built-in sealed_rooms, indirect diffuse light of two scatterings",
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
        edge = EDGE[context.quick]
        request = reference.ReferenceRequest(
            samples_per_pixel=PATHS[context.quick], batch_count=8, rest_samples_per_pixel=0
        )
        truth = reference.render_reference(
            load_scene(scene, resolution=edge).scene,
            sensor=0,
            request=request,
            cache_directory=None,
            progress=lambda share: context.progress("path tracing", share),
        )
        light, batches = picture_of(context, scene).diffuse(), truth.batches("indirect_diffuse")
        require_told_apart(light, batches, PATHS[context.quick], f"the reference of {scene}")
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


def draw_leaks(audit: LeakAudit, path: Path) -> None:
    """Write what was gathered, what of it came through or from a wrong face, and what is missing.

    The scale reaches to the brightest percent of the light gathered, of the parts to a tenth of it.
    """
    gathered = audit.gathered.mean(axis=0)
    parts = {
        "gathered": gathered,
        "through geometry": audit.through.mean(axis=0),
        "wrong face": excess_map(audit, 1.0),
        "missing": excess_map(audit, -1.0),
    }
    share = (parts["through geometry"] + parts["wrong face"]) / np.maximum(gathered, 1e-12)
    brightest = float(np.quantile(gathered, 0.99))
    with mpl.rc_context({"font.size": 9}):
        figure = Figure(figsize=(15, 3.4), layout="constrained")
        for axes, (title, values) in zip(
            figure.subplots(1, 5), [*parts.items(), ("leaked share", share)], strict=True
        ):
            highest = {"leaked share": 1.0, "gathered": brightest}.get(title, FAINT * brightest)
            shown = axes.imshow(values, vmin=0.0, vmax=highest, cmap="magma")
            axes.set_title(title)
            axes.set_axis_off()
            figure.colorbar(shown, ax=axes, shrink=0.8)
        figure.savefig(path, dpi=80)
