"""Injection in pictures: what cones and thin rays make of voxels that light was injected into."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.cornell import (
    CornellBox,
    Receivers,
    cornell_box,
    path_traced,
    primary_hits,
)
from experiments.studies.exact_voxels import (
    exact_emittance,
    lay_out_window,
    light_exactly,
)
from experiments.studies.light.injections import COMPARED, INJECTIONS, PLACEMENTS, Limits, row
from experiments.studies.light.lit_rooms import (
    ALBEDO,
    EMISSION,
    LitPoints,
    light_points,
    placement,
    shining_room,
)
from experiments.studies.phases import phase_offsets
from experiments.studies.representation.thin_rays import gather as thin_rays
from experiments.studies.scenes import white_furnace
from vctgi.config import preset
from vctgi.pipeline import prepare_scene
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.diffuse import trace_diffuse

FURNACES = ("scatter", "scatter 3 wide", "scatter bounded", "scatter 3 wide bounded", "centre")
SMOOTH = "scatter 3 wide"
TEXELS_PER_VOXEL = {"default maps": None, "16 texels a voxel": 16.0}
"""Texels along an edge of the maps; what points gain in default maps is the noise of texels."""

FURNACE_MEAN, FURNACE_LARGEST = 0.92, 1.001
FURNACE_EDGE = (20, 8)
RESOLUTION = 64
"""Voxels along an edge of a level of the furnace."""

EXACT = "exact light"
RELATIVE_FLOOR = 0.01
"""Share of the squared mean reference that keeps relMSE finite in the dark."""

PHASE_COUNT = 4
PICTURE_EDGE, PATH_COUNT = (48, 24), 1024
NEXT_TO_NOTHING = 0.01
"""Share of the mean radiance below which a slot counts as unlit."""


def checks() -> list[Check]:
    """Return the checks of the white furnace and the Cornell box."""
    return [*_furnace_checks(), *_cornell_checks()]


def _furnace_checks() -> list[Check]:
    rows = []
    for where in PLACEMENTS:
        scene = f"white furnace, {where}: preset high at N = 64, first scattering over closed form"
        ways = [(how, "default maps") for how in FURNACES] + [(SMOOTH, "16 texels a voxel")]
        for how, texels in ways:
            name = how if texels == "default maps" else f"{how}, {texels}"
            limits: Limits = {"limit_low": FURNACE_MEAN} if how == SMOOTH else {}
            mean = partial(_furnace_mean, how=how, where=where, texels=texels)
            rows.append(row(f"furnace mean, {where}", name, scene, mean, **limits))
            limits = {"limit_high": FURNACE_LARGEST} if name != how else {}
            largest = partial(_furnace_largest, how=how, where=where, texels=texels)
            rows.append(row(f"furnace largest point, {where}", name, scene, largest, **limits))
    return rows


def _furnace(context: StudyContext, how: str, where: str, texels: str) -> np.ndarray:
    """E / pi [point] over the radiance of lit walls."""
    is_turned = PLACEMENTS[where]

    def make() -> LitPoints:
        scene = shining_room(placement(np.zeros(3), is_turned=is_turned))
        high = preset("high")
        config = replace(high, clipmap=replace(high.clipmap, resolution=RESOLUTION))
        layout = prepare_scene(scene, scene.sensors()[0], config).plan.layout
        return light_points(scene, layout, TEXELS_PER_VOXEL[texels])

    def gather() -> np.ndarray:
        points = context.once(f"furnace {where} {texels}", make)
        at = white_furnace(FURNACE_EDGE[context.quick], seed=1)
        at = at.turned() if is_turned else at
        found = trace_diffuse(
            white_receivers(at.points, at.normals),
            points.volume(INJECTIONS[how]),
            preset("high").diffuse,
            points.scene,
        )
        share: np.ndarray = np.array(found, dtype=np.float64)[1] / (ALBEDO * EMISSION)
        return share

    return context.once(f"furnace {where} {texels} {how}", gather)


def _furnace_mean(context: StudyContext, how: str, where: str, texels: str) -> Measured:
    return Measured(value=float(_furnace(context, how, where, texels).mean()))


def _furnace_largest(context: StudyContext, how: str, where: str, texels: str) -> Measured:
    return Measured(value=float(_furnace(context, how, where, texels).max()))


def _cornell_checks() -> list[Check]:
    scene = "mi.cornell_box(), E / pi of one bounce at primary hits"
    rows = []
    for how in (EXACT, *COMPARED):
        for rays in ("17 cones", "256 thin rays"):
            for name, measure in (("energy", _cornell_energy), ("relMSE", _cornell_relmse)):
                found = partial(measure, how=how, rays=rays)
                rows.append(row(f"Cornell box, {name}, {rays}", how, scene, found))
    for how in COMPARED:
        unlit = partial(_false_light, how=how)
        rows.append(row("light in unlit slots", how, "mi.cornell_box()", unlit))
        rows.append(row("light misplaced", how, "mi.cornell_box()", partial(_misplaced, how=how)))
    return rows


@dataclass
class _Cornell:
    """The box at several phases with its lit points, receivers, and paths in two halves."""

    rooms: list[CornellBox]
    points: list[LitPoints]
    offsets: list[np.ndarray]
    at: Receivers
    halves: tuple[np.ndarray, np.ndarray]


def _cornell(context: StudyContext) -> _Cornell:
    def make() -> _Cornell:
        still = cornell_box(np.zeros(3))
        layout = lay_out_window(still.triangles)
        at = primary_hits(still, PICTURE_EDGE[context.quick])
        first, second = (path_traced(still, at, PATH_COUNT, seed) for seed in (1, 2))
        count = 1 if context.quick else PHASE_COUNT
        offsets = [phase * layout.finest_voxel_size for phase in phase_offsets(count)]
        rooms = [cornell_box(offset) for offset in offsets]
        points = [light_points(each.scene, layout) for each in rooms]
        return _Cornell(rooms, points, offsets, at, (first, second))

    return context.once("Cornell box", make)


def _gathered(context: StudyContext, how: str, rays: str) -> list[np.ndarray]:
    """E / pi [point, rgb] at each phase."""

    def make() -> list[np.ndarray]:
        box = _cornell(context)
        found = []
        for each, points, offset in zip(box.rooms, box.points, box.offsets, strict=True):
            if how == EXACT:
                volume = light_exactly(each.scene, points.opacity.layout, each.radiance)
            else:
                volume = points.volume(INJECTIONS[how])
            places = box.at.points + offset
            if rays == "17 cones":
                at = white_receivers(places, box.at.normals)
                light = trace_diffuse(at, volume, preset("high").diffuse, each.scene)
                found.append(np.array(light, dtype=np.float64).T)
            else:
                found.append(thin_rays(volume, each.scene, places, box.at.normals))
        return found

    return context.once(f"Cornell box {how} {rays}", make)


def _cornell_energy(context: StudyContext, how: str, rays: str) -> Measured:
    first, second = _cornell(context).halves
    truth = 0.5 * float(first.mean() + second.mean())
    return mean_of([float(each.mean()) / truth for each in _gathered(context, how, rays)])


def _cornell_relmse(context: StudyContext, how: str, rays: str) -> Measured:
    first, second = _cornell(context).halves
    truth = 0.5 * (first + second)
    scale = truth**2 + RELATIVE_FLOOR * truth.mean() ** 2
    errors = [np.mean((v - first) * (v - second) / scale) for v in _gathered(context, how, rays)]
    return mean_of([float(error) for error in errors])


def _slots(context: StudyContext, how: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Opacity [slot], exact emittance [rgb, slot] and injected emittance at the first phase."""
    box = _cornell(context)
    points, here = box.points[0], box.rooms[0]
    exact = context.once(
        "exact emittance", lambda: exact_emittance(points.opacity, here.triangles, here.radiance)
    )
    lit = points.inject(INJECTIONS[how])
    first, second = (np.array(each.levels[0], dtype=np.float64) for each in (exact, lit))
    return np.array(points.opacity.levels[0], dtype=np.float64), first, second


def _false_light(context: StudyContext, how: str) -> Measured:
    """Share of all light that lies in slots whose surfaces get next to none."""
    alpha, exact, lit = _slots(context, how)
    mean = exact.sum() / alpha.sum()
    is_unlit = exact.sum(axis=0) < NEXT_TO_NOTHING * mean * alpha
    return Measured(value=float(lit[:, is_unlit].sum() / lit.sum()))


def _misplaced(context: StudyContext, how: str) -> Measured:
    """Half the sum of what each slot has too much or too little, over all light."""
    _, exact, lit = _slots(context, how)
    return Measured(value=0.5 * float(np.abs(lit - exact).sum() / exact.sum()))
