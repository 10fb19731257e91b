"""A room in which a lamp, an object, the viewer's windows or everything moves across voxels.

A spot lamp lights the floor, and a floating cube above it unless it is the lamp that moves. All
that is lit lies in one clip level and in none finer. Receivers are points of the walls, which stand
still, so that what they see changes as the true light does, and beyond it only by what the voxels
do.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import mitsuba as mi
import numpy as np

from experiments.studies.aliasing.figures import add_sweep_figures
from experiments.studies.aliasing.light_tracing import traced_light
from experiments.studies.check import StudyContext
from experiments.studies.light.injections import INJECTIONS
from experiments.studies.light.lit_rooms import (
    LitPoints,
    light_points,
    placement,
    power,
    room,
    slot_power,
)
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.storage import EmittanceClipmap, pack_volume
from vctgi.config import preset
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.diffuse import trace_diffuse
from vctgi.stages.downsampling import downsample

MOVERS = ("light", "object", "camera", "grid")
"""What moves: the lamp, the cube, the windows around a viewer, or everything but the lattice."""

HOWS = ("scatter", "scatter 3 wide", "centre")
"""Ways to inject that are compared: without a pre-filter, with one, and the crudest."""

QUICK_HOWS = HOWS[:2]
"""Those of the quick version."""

FINEST_VOXEL = 1.0 / 16.0
"""World units, as all lengths here; a power of two, so that whole voxels are moved exactly."""

RESOLUTION, LEVELS = 32, 3
"""Voxels along an edge of a clip level; levels in which the lit part lies in turn."""

LIT = np.array([0.21, -0.8, -0.13])
"""Middle of what is lit."""

AWAY_VOXELS = (0, 12, 12)
"""From there to the middle of the windows along x, in voxels of the level: the next finer window
ends at 8, its own at 16."""

CUBE_EDGE, LAMP_HEIGHT, CUTOFF_DEGREES = 0.16, 0.75, 12.0
SHARPNESS = 0.9
"""Part of the beam's angle in which it is even."""

PERIODS = {"light": 2, "object": 2, "camera": 4, "grid": 2}
"""Voxels that are crossed; windows move two at a time."""

PHASES = (16, 8)
RECEIVERS = (120, 48)
PATHS = (512, 256)
BATCHES = (8, 4)
"""Steps to a voxel, points, paths of a batch of the reference, and batches, in the whole study and
in the quick one."""

ALL_FOUND = 3
"""Width of a pre-filter, for which texels without opacity of their own count as well."""


@dataclass(frozen=True)
class MovedRoom:
    """What was found at each place of whatever moves.

    Attributes
    ----------
    places
        [frame] in voxels of the level.
    powers, light
        For each way to inject: power in the level's voxels over what should be there [frame], and
        E / pi [frame, point, rgb].
    batches
        The truth [batch, frame, point, rgb].
    """

    places: np.ndarray
    powers: dict[str, np.ndarray]
    light: dict[str, np.ndarray]
    batches: np.ndarray


def moved_room(context: StudyContext, mover: str, level: int, how: str) -> MovedRoom:
    """Return what was found as one thing moved through voxels of a level, found once for all.

    The quick version injects in `QUICK_HOWS` only, unless `how` is another way.
    """
    hows = QUICK_HOWS if context.quick and how in QUICK_HOWS else HOWS
    key = f"{mover}, level {level}, {', '.join(hows)}"
    return context.once(key, partial(_move, context, mover, level, hows))


def wall_points(count: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Return points [point, 3] of the four walls and the ceiling, and their normals."""
    rng = np.random.default_rng(seed)
    wall = np.arange(count) % 5
    axis, side = np.array([0, 0, 2, 2, 1])[wall], np.array([-1.0, 1.0, -1.0, 1.0, 1.0])[wall]
    points = rng.uniform(-0.95, 0.95, (count, 3))
    normals = np.zeros((count, 3))
    points[np.arange(count), axis] = side
    normals[np.arange(count), axis] = -side
    return points, normals


def moved_scene(whole: np.ndarray, lamp: np.ndarray, cube: np.ndarray | None) -> mi.Scene:
    """Return the room with everything, the lamp or the cube moved, or without a cube."""
    outer = placement(whole, is_turned=False)
    above = LIT + lamp + np.array([0.0, LAMP_HEIGHT, 0.0])
    beam: Any = mi.ScalarTransform4f().look_at(
        above.tolist(), (LIT + lamp).tolist(), [0.0, 0.0, 1.0]
    )
    parts = room(outer)
    parts["spot"] = {
        "type": "spot",
        "to_world": outer @ beam,
        "cutoff_angle": CUTOFF_DEGREES,
        "beam_width": SHARPNESS * CUTOFF_DEGREES,
    }
    if cube is not None:
        turned = placement(LIT + cube, is_turned=True)
        small = mi.ScalarTransform4f().scale(0.5 * CUBE_EDGE)
        parts["cube"] = {"type": "cube", "to_world": outer @ turned @ small}
    scene: mi.Scene = mi.load_dict(parts)
    return scene


def windows(level: int, ahead: float = 0.0, whole: np.ndarray | None = None) -> ClipmapLayout:
    """Return windows of which `level` holds what is lit, and no finer one does.

    Parameters
    ----------
    level
        In 0 .. `LEVELS` - 1; one more level holds the rest of the room.
    ahead
        How far the viewer has moved along x.
    whole
        How far everything has been moved.
    """
    voxel = FINEST_VOXEL * 2.0**level
    moved = np.zeros(3) if whole is None else whole
    middle = LIT + moved + np.array([AWAY_VOXELS[level] * voxel + ahead, 0.0, 0.0])
    x, y, z = middle.tolist()
    return lay_out_clipmap(
        (x, y, z), finest_voxel_size=FINEST_VOXEL, level_count=LEVELS + 1, resolution=RESOLUTION
    )


def cone_light(
    points: LitPoints, emittance: EmittanceClipmap, at: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """Return E / pi [point, rgb] that the cones of preset "high" find."""
    opacity, lit = downsample(points.opacity, emittance)
    assert lit is not None, "downsampling keeps the emittance it is given"
    volume = pack_volume(opacity, lit)
    cones = preset("high").diffuse
    found = trace_diffuse(white_receivers(at, normals), volume, cones, points.scene)
    light: np.ndarray = np.array(found, dtype=np.float64).T
    return light


def recentred(
    context: StudyContext, how: str, besides: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return the light [point, 1, rgb] before and after a move of everything by whole voxels.

    `besides`, in voxels of the finest level, is moved as well: the fault that a gate must find.
    """
    points, normals = wall_points(RECEIVERS[context.quick])
    coarsest = FINEST_VOXEL * 2.0**LEVELS
    whole = coarsest * RESOLUTION / 4.0 * np.array([1.0, -1.0, 2.0])
    whole = whole + besides * FINEST_VOXEL
    still = np.zeros(3)
    found = []
    for moved in (still, whole):
        lit = light_points(moved_scene(moved, still, still), windows(0, whole=moved))
        emittance = lit.inject(INJECTIONS[how])
        found.append(cone_light(lit, emittance, points + moved, normals)[:, None])
    return found[0], found[1]


def _move(context: StudyContext, mover: str, level: int, hows: tuple[str, ...]) -> MovedRoom:
    voxel = FINEST_VOXEL * 2.0**level
    phases = PHASES[context.quick]
    places = np.arange(phases * PERIODS[mover]) / phases
    places -= places.mean()
    powers: dict[str, list[float]] = {how: [] for how in hows}
    light: dict[str, list[np.ndarray]] = {how: [] for how in hows}
    truth: list[np.ndarray] = []
    points, normals = wall_points(RECEIVERS[context.quick])
    still = np.zeros(3)
    known_windows = None
    for frame, place in enumerate(places):
        context.progress(f"{mover}, level {level}", frame / len(places))
        step = np.array([place * voxel, 0.0, 0.0])
        whole, lamp, cube = (step if mover == name else still for name in ("grid", *MOVERS[:2]))
        layout = windows(level, place * voxel if mover == "camera" else 0.0)
        scene = moved_scene(whole, lamp, None if mover == "light" else cube)
        if mover == "camera" and known_windows == layout.levels:
            # Snapped windows stand still in between, and so does all that is in them.
            for how in hows:
                powers[how].append(powers[how][-1])
                light[how].append(light[how][-1])
        else:
            lit = light_points(scene, layout)
            expected = slot_power(lit, ALL_FOUND, level)
            for how in hows:
                emittance = lit.inject(INJECTIONS[how])
                powers[how].append(power(emittance, level) / expected)
                light[how].append(cone_light(lit, emittance, points + whole, normals))
        known_windows = layout.levels
        if mover in ("camera", "grid") and truth:
            truth.append(truth[0])
        else:
            trace = partial(_reference, context, scene, points + whole, normals)
            truth.append(context.once(f"{mover}, level {level}, truth of {frame}", trace))
    found = MovedRoom(
        places=places,
        powers={how: np.array(values) for how, values in powers.items()},
        light={how: np.stack(values) for how, values in light.items()},
        batches=np.stack(truth, axis=1),
    )
    add_sweep_figures(
        context.shelf,
        f"Moved {mover}, level {level}",
        places,
        found.powers,
        found.light,
        found.batches,
    )
    return found


def _reference(
    context: StudyContext, scene: mi.Scene, points: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """Return independent batches [batch, point, rgb]; the same paths in every frame."""
    return np.stack(
        [
            traced_light(scene, points, normals, PATHS[context.quick], seed)
            for seed in range(BATCHES[context.quick])
        ]
    )
