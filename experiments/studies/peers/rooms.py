"""Rooms by the recipes of other systems and by ours: the Cornell box against paths, and a furnace.

All recipes see the same voxels with exact light, at N = 64, apart from mips of their own. Intervals
are over phases of the grid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mitsuba as mi
import numpy as np

from experiments.studies import scenes
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.cornell import cornell_box, path_traced, primary_hits
from experiments.studies.cornell_truth import CornellTruth
from experiments.studies.exact_voxels import (
    Radiance,
    exact_emittance,
    lay_out_window,
    scene_of,
    surfaces_in,
)
from experiments.studies.peers.walls import OURS, recipe
from experiments.studies.phases import phase_offsets
from experiments.studies.tracers import constant_radiance
from vctgi.clipmap.levels import ClipmapLayout
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap, pack_volume
from vctgi.peers import PEERS
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.diffuse import trace_diffuse
from vctgi.stages.downsampling import downsample
from vctgi.stages.voxelization.opacity import voxelize_opacity

PHASE_COUNT = (8, 1)
"""Places in the grid, in the whole study and in the quick one."""

PICTURE_EDGE, PATH_COUNT = (48, 16), (2048, 1024)
"""Receivers along an edge of the picture, and paths of each half of the reference."""

FURNACE_EDGE = (10, 4)
"""Receivers along an edge of each wall."""

CORNELL = "mi.cornell_box(), E / pi of one bounce at primary hits"
FURNACE = "closed box of radiance 1, two wide, axis-aligned"

KNOWN_CLASSIC = {"energy ratio": 0.562, "relMSE": 0.190, "furnace": 0.492}
"""What the common recipe reached in the prototype."""

IDEAL = {"energy ratio": 1.0, "relMSE": 0.0, "furnace": 1.0}


def checks() -> list[Check]:
    """Return the checks on rooms."""
    found = []
    for name in [*OURS, *PEERS]:
        title = f"{name}, N = 64" if name in OURS else PEERS[name].title
        for number, goal in IDEAL.items():
            is_furnace = number == "furnace"
            found.append(
                Check(
                    name=f"{FURNACE_NAME if is_furnace else CORNELL_NAME}, {name}, {number}",
                    configuration=title,
                    scene=FURNACE if is_furnace else CORNELL,
                    measure=partial(MEASURES[number], name=name),
                    goal=KNOWN_CLASSIC[number] if name == "classic" else goal,
                )
            )
        if name in PEERS and PEERS[name].published_gain != 1.0:
            found += _published(name)
    return found


def _published(name: str) -> list[Check]:
    """Return the checks on a recipe with its own scale."""
    gain = PEERS[name].published_gain
    return [
        Check(
            name=f"{CORNELL_NAME}, {name} with its scale, {number}",
            configuration=f"{PEERS[name].title}; times {gain:.4g}",
            scene=CORNELL,
            measure=partial(measure, name=name, gain=gain),
            goal=IDEAL[number],
        )
        for number, measure in (("energy ratio", _energy), ("relMSE", _relmse))
    ]


@dataclass(frozen=True)
class Room:
    """A room at one phase: its finest voxels, which recipes fill the mips from, and receivers.

    Attributes
    ----------
    scene
        For near-field rays.
    opacity, emittance
        Exact ones of the finest level.
    points, normals
        [point, 3].
    """

    scene: mi.Scene
    opacity: OpacityClipmap
    emittance: EmittanceClipmap
    points: np.ndarray
    normals: np.ndarray

    def gather(self, name: str) -> np.ndarray:
        """E / pi [point, rgb] by a recipe."""
        diffuse, mips = recipe(name)
        opacity, lit = downsample(self.opacity, self.emittance, mips)
        assert lit is not None, "downsampling keeps the emittance it is given"
        at = white_receivers(self.points, self.normals)
        found = trace_diffuse(at, pack_volume(opacity, lit), diffuse, self.scene)
        return np.array(found, dtype=np.float64).T


def fill_room(
    scene: mi.Scene,
    layout: ClipmapLayout,
    radiance: Radiance,
    points: np.ndarray,
    normals: np.ndarray,
) -> Room:
    """Voxelize a scene and light its voxels exactly."""
    surfaces = surfaces_in(scene)
    opacity = voxelize_opacity(surfaces, layout)
    emittance = exact_emittance(opacity, surfaces.vertices, radiance)
    return Room(scene, opacity, emittance, points, normals)


def _energy(context: StudyContext, name: str, gain: float = 1.0) -> Measured:
    truth = _reference(context).mean.mean()
    return mean_of([gain * float(v.mean() / truth) for v in _in_cornell(context, name)])


def _relmse(context: StudyContext, name: str, gain: float = 1.0) -> Measured:
    reference = _reference(context)
    return mean_of([reference.relmse(gain * v) for v in _in_cornell(context, name)])


def _furnace(context: StudyContext, name: str) -> Measured:
    return mean_of([float(v.mean()) for v in _in_furnace(context, name)])


MEASURES = {"energy ratio": _energy, "relMSE": _relmse, "furnace": _furnace}
CORNELL_NAME, FURNACE_NAME = "Cornell box", "box"


def _reference(context: StudyContext) -> CornellTruth:
    """Return the Cornell box at rest by paths."""

    def trace() -> CornellTruth:
        context.progress("paths", 0.0)
        room = cornell_box(np.zeros(3))
        at = primary_hits(room, PICTURE_EDGE[context.quick])
        first, second = (path_traced(room, at, PATH_COUNT[context.quick], n) for n in (1, 2))
        return CornellTruth(room, at, (first, second))

    return context.once("paths", trace)


def _in_cornell(context: StudyContext, name: str) -> list[np.ndarray]:
    reference = _reference(context)
    layout = lay_out_window(reference.room.triangles)

    def fill(phase: np.ndarray) -> Room:
        offset = phase * layout.finest_voxel_size
        room = cornell_box(offset)
        points, normals = reference.at.points + offset, reference.at.normals
        return fill_room(room.scene, layout, room.radiance, points, normals)

    return _gathered(context, "Cornell box", fill, name)


def _in_furnace(context: StudyContext, name: str) -> list[np.ndarray]:
    box = scenes.white_furnace(FURNACE_EDGE[context.quick], seed=1)
    layout = lay_out_window(box.triangles)

    def fill(phase: np.ndarray) -> Room:
        moved = box.moved(phase * layout.finest_voxel_size)
        radiance = constant_radiance(moved.radiance)
        world = scene_of(moved.triangles)
        return fill_room(world, layout, radiance, moved.points, moved.normals)

    return _gathered(context, "furnace", fill, name)


def _gathered(
    context: StudyContext, kind: str, fill: Callable[[np.ndarray], Room], name: str
) -> list[np.ndarray]:
    """E / pi [point, rgb] by a recipe for each phase; rooms are filled once, for all recipes."""

    def gather() -> list[np.ndarray]:
        found = []
        offsets = phase_offsets(PHASE_COUNT[context.quick])
        for number, offset in enumerate(offsets):
            context.progress(f"{kind}, {name}", number / len(offsets))
            room = context.once(f"{kind}, phase {number}", partial(fill, offset))
            found.append(room.gather(name))
        return found

    return context.once(f"{kind}, {name}", gather)
