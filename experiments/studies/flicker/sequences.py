"""A slow slide of the camera: frames of each sparsity, with and without history, and the truth.

The voxels stay as they are; what flickers is cones that are turned anew in each frame, and pixels
that take their light from others. Single frames are rendered with several seeds, which tells the
two apart, and once more with cones that are never turned, which leaves the second alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np

import reference
import vctgi
from experiments.scenes import load_scene
from experiments.studies.accuracy.sparse import sparse_config
from experiments.studies.check import StudyContext
from experiments.studies.flicker.surfaces import surfaces_shown
from metrics.flicker import Motion, motion_of
from vctgi.clipmap.storage import VoxelVolume
from vctgi.pipeline import PreparedScene, TemporalFrame
from vctgi.stages.reconstruction.temporal import Projection, place_of, project

SPARSITIES = (1, 4, 9, 16)
"""Camera rays for each that traces cones."""

EDGE = (48, 32)
WARM_UP, MEASURED = (12, 6), (5, 3)
"""Pixels along the longer edge; frames that only make history, and frames that are compared, in the
whole study and in the quick one."""

STEP_PX = (0.37, 0.23)
"""Slide along and across the picture from frame to frame, in pixels at the middle distance."""

RENDERINGS = (8, 4)
"""Seeds of the single frames, in the whole study and in the quick one."""

SEED_STEP = 1000
"""Between the seeds of renderings, whose frames take the next ones."""

LIMITED = 9
"""Sparsity at which frames are also made without a limit on the contrast of neighbours."""

PATHS, BATCHES = 8192, 8
"""Paths a pixel of the reference, and its batches: its noise is most of an interval."""


@dataclass(frozen=True)
class Sequence:
    """Frames of a slide.

    Attributes
    ----------
    frames
        By sparsity and whether history was used: indirect diffuse light [frame, row, column, rgb].
    forgotten
        By sparsity: the same with history, which is thrown away before each frame.
    renderings
        By sparsity: single frames [seed, frame, row, column, rgb].
    unlimited
        Single frames of sparsity `LIMITED` without a limit on contrast.
    fixed
        By sparsity and whether contrast has its limit: single frames without random numbers.
    motion
        Where each pixel's surface was.
    motion_by_plane
        The same where a surface is whatever lies on one plane, so that edges are let in.
    stride
        World units that a pixel is wide at the middle distance.
    """

    frames: dict[tuple[int, bool], np.ndarray]
    forgotten: dict[int, np.ndarray]
    renderings: dict[int, np.ndarray]
    unlimited: np.ndarray
    fixed: dict[tuple[int, bool], np.ndarray]
    motion: Motion
    motion_by_plane: Motion
    stride: float


def sequence(context: StudyContext) -> Sequence:
    """Return the slide through the scene, rendered once for all checks."""
    return context.once("flicker", partial(_render, context))


def _render(context: StudyContext) -> Sequence:
    quick = context.quick
    loaded = load_scene(context.scene or "cornell_box", resolution=EDGE[quick])
    sensor = loaded.scene.sensors()[loaded.sensor_index]
    prepared = vctgi.prepare_scene(loaded.scene, sensor, sparse_config(1))
    volume = vctgi.light_volume(prepared, sparse_config(1)).volume
    world_from_camera = np.array(sensor.world_transform().matrix, dtype=np.float64).reshape(4, 4)
    first = vctgi.render_frame(prepared, volume, sparse_config(16))
    depth = np.array(first.depth)
    stride = float(np.median(depth[depth > 0.0])) * project(sensor).pixel_angle

    frames: dict[tuple[int, bool], list[np.ndarray]] = {}
    forgotten: dict[int, list[np.ndarray]] = {}
    more: dict[tuple[str, int, bool], list[list[np.ndarray]]] = {}
    places, positions, normals, surfaces = [], [], [], []
    histories: dict[int, TemporalFrame | None] = dict.fromkeys(SPARSITIES)
    before: Projection | None = None
    count = WARM_UP[quick] + MEASURED[quick]
    for number in range(count):
        context.progress("frames", number / count)
        move_sensor(sensor, world_from_camera, number * stride * np.array([*STEP_PX, 0.0]))
        is_measured = number >= WARM_UP[quick]
        for sparsity in SPARSITIES:
            config = sparse_config(sparsity)
            frame = vctgi.render_frame(prepared, volume, config, seed=number)
            kept, histories[sparsity] = vctgi.accumulate_frame(
                histories[sparsity], frame, sensor, config
            )
            if is_measured:
                for has_history, each in ((False, frame), (True, kept)):
                    frames.setdefault((sparsity, has_history), []).append(
                        np.array(each.indirect_diffuse, dtype=np.float64)
                    )
                fresh, _ = vctgi.accumulate_frame(None, frame, sensor, config)
                forgotten.setdefault(sparsity, []).append(
                    np.array(fresh.indirect_diffuse, dtype=np.float64)
                )
        if not is_measured:
            continue
        for key, found in _more_frames(prepared, volume, number, RENDERINGS[quick]).items():
            more.setdefault(key, []).append(found)
        # All sparsities send the same camera rays.
        positions.append(np.array(frame.position, dtype=np.float64))
        normals.append(np.array(frame.surface_normal, dtype=np.float64))
        surfaces.append(surfaces_shown(loaded.scene, sensor))
        if before is not None:
            places.append(places_before(before, positions[-1]))
        before = project(sensor)
    single = {key: np.stack(each) for key, each in frames.items()}
    extra = {key: np.stack(each, axis=1) for key, each in more.items()}
    seen = np.stack(places), np.stack(positions), np.stack(normals)
    return Sequence(
        frames=single,
        forgotten={key: np.stack(each) for key, each in forgotten.items()},
        renderings={
            each: np.concatenate([single[each, False][None], extra["pixel", each, True]])
            for each in SPARSITIES
        },
        unlimited=extra["pixel", LIMITED, False][0],
        fixed={key[1:]: each[0] for key, each in extra.items() if key[0] == "fixed"},
        motion=motion_of(*seen, np.stack(surfaces)),
        motion_by_plane=motion_of(*seen),
        stride=stride,
    )


def _more_frames(
    prepared: PreparedScene, volume: VoxelVolume, number: int, seed_count: int
) -> dict[tuple[str, int, bool], list[np.ndarray]]:
    """Return single frames by rotation of the cones, sparsity and whether contrast has its limit.

    Those with random numbers take the seeds after the first one; without a limit, the first.
    """
    found = {}
    ways = [(each, True) for each in SPARSITIES] + [(LIMITED, False)]
    for sparsity, has_limit in ways:
        config = sparse_config(sparsity)
        if not has_limit:
            sparse = replace(config.reconstruction, max_contrast=None)
            config = replace(config, reconstruction=sparse)
        cones = replace(config.diffuse, rotation="fixed", is_jittered=False)
        still = replace(config, diffuse=cones)
        found["fixed", sparsity, has_limit] = [_diffuse(prepared, volume, still, number)]
        seeds = range(1, seed_count) if has_limit else range(1)
        found["pixel", sparsity, has_limit] = [
            _diffuse(prepared, volume, config, number + SEED_STEP * each) for each in seeds
        ]
    return found


def _diffuse(
    prepared: PreparedScene,
    volume: VoxelVolume,
    config: vctgi.RenderConfig,
    seed: int,
) -> np.ndarray:
    frame = vctgi.render_frame(prepared, volume, config, seed=seed)
    return np.array(frame.indirect_diffuse, dtype=np.float64)


def truth_of(context: StudyContext) -> np.ndarray:
    """Return the truth [batch, frame, row, column, rgb], rendered once for all checks."""

    def render() -> np.ndarray:
        quick, stride = context.quick, sequence(context).stride
        loaded = load_scene(context.scene or "cornell_box", resolution=EDGE[quick])
        sensor = loaded.scene.sensors()[loaded.sensor_index]
        start = np.array(sensor.world_transform().matrix, dtype=np.float64).reshape(4, 4)
        truth = []
        for number in range(MEASURED[quick]):
            context.progress("path tracing", number / MEASURED[quick])
            place = (WARM_UP[quick] + number) * stride * np.array([*STEP_PX, 0.0])
            move_sensor(sensor, start, place)
            truth.append(_path_traced(loaded.scene, loaded.sensor_index))
        return np.stack(truth, axis=1)

    return context.once("flicker, truth", render)


def move_sensor(sensor: mi.Sensor, world_from_camera: np.ndarray, offset: np.ndarray) -> None:
    """Place a camera so far from where it was, along its own axes."""
    moved = world_from_camera.copy()
    moved[:3, 3] += world_from_camera[:3, :3] @ offset
    parameters = mi.traverse(sensor)
    parameters["to_world"] = mi.Transform4f(mi.ScalarTransform4f(moved.astype(np.float32)))
    parameters.update()


def places_before(projection: Projection, positions: np.ndarray) -> np.ndarray:
    """Return where the camera before showed points [row, column, 3]: [row, column, 2], pixels."""
    points = mi.Point3f(np.ascontiguousarray(positions.reshape(-1, 3).T, dtype=np.float32))
    place, depth = place_of(projection, points)
    dr.eval(place, depth)
    found = np.array(place, dtype=np.float64).T
    # What lies behind the camera is nowhere in its picture.
    found[np.array(depth) <= 0.0] = -1.0
    return found.reshape(*positions.shape[:2], 2)


def _path_traced(scene: mi.Scene, sensor_index: int) -> np.ndarray:
    """Return batches [batch, row, column, rgb] of the same light."""
    request = reference.ReferenceRequest(
        samples_per_pixel=PATHS,
        batch_count=BATCHES,
        rest_samples_per_pixel=0,
    )
    found = reference.render_reference(
        scene, sensor=sensor_index, request=request, cache_directory=None
    )
    return found.batches("indirect_diffuse").astype(np.float64)
