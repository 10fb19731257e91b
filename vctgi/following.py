"""Frames of a scene that goes on: what nothing changed since the last frame is not done again.

Where nothing moved at all, neither surfaces nor lights nor the camera, the lit voxels are those of
the frame before, and a frame is no more than its cones. Where surfaces or windows moved, only what
they made stale is voxelized again, and the light is new. Both equal a frame from scratch bit for
bit; `RenderConfig.keep` with "motion" makes every frame from scratch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import mitsuba as mi

from vctgi.clipmap.regions import same_levels
from vctgi.config import RenderConfig
from vctgi.pipeline import (
    LitVolume,
    SceneVoxels,
    light_volume,
    prepare_scene,
    update_voxels,
    voxelize_scene,
)
from vctgi.prepared import PreparedScene, StageClock, no_clock
from vctgi.scene.state import SceneState, scene_state


@dataclass(frozen=True)
class FollowedScene:
    """A scene in the state of one frame.

    Attributes
    ----------
    state
        Its parameters.
    config
        What was asked for.
    prepared, voxels, lit
        What `prepare_scene`, `voxelize_scene` and `light_volume` made of it.
    is_reused
        Whether all of that is an earlier frame's.
    """

    state: SceneState
    config: RenderConfig
    prepared: PreparedScene
    voxels: SceneVoxels
    lit: LitVolume
    is_reused: bool = False


def follow_scene(
    earlier: FollowedScene | None,
    scene: mi.Scene,
    sensor: mi.Sensor,
    config: RenderConfig,
    clock: StageClock = no_clock,
) -> FollowedScene:
    """Return lit voxels of a scene as it is now.

    Parameters
    ----------
    earlier
        What the call for the frame before returned, used up by this one; None for the first.
    scene, sensor
        Scene and camera, which may have been changed through `mi.traverse`.
    config
        What is asked for.
    clock
        Times the stages.

    Raises
    ------
    SceneError
        As `prepare_scene` does.
    """
    state = scene_state(scene, sensor)
    if config.is_kept("motion"):
        earlier = None
    if earlier is not None and earlier.config == config and earlier.state.is_same(state):
        return replace(earlier, is_reused=True)
    prepared = prepare_scene(scene, sensor, config, clock)
    if earlier is not None and _can_update(earlier, prepared, config):
        voxels = update_voxels(earlier.voxels, prepared, config, clock)
    else:
        voxels = voxelize_scene(prepared, config, clock)
    lit = light_volume(prepared, config, clock, voxels)
    return FollowedScene(state, config, prepared, voxels, lit)


def _can_update(earlier: FollowedScene, prepared: PreparedScene, config: RenderConfig) -> bool:
    """Whether voxels can follow: they are as large as before, and made by the same rules.

    What a mask shows is not compared, so masked surfaces are voxelized anew.
    """
    return (
        same_levels(earlier.prepared.plan.layout, prepared.plan.layout)
        and earlier.config.voxelization == config.voxelization
        and not config.voxelization.is_complete
        and earlier.config.keep == config.keep
        and not prepared.surfaces.masks
        and not earlier.prepared.surfaces.masks
    )
