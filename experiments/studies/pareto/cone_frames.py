"""Frames by cones: of a still scene, of a moving camera, and of moving lights.

What a frame does: still, the voxels are kept lit, and it gathers; with a moving camera the windows
of the clipmap move by the smallest step that moves the finest, slabs that entered are voxelized,
levels that changed are lit from outside and all by lamps, all is downsampled again, and it gathers;
with moving lights the surfaces' voxels are kept,
and light maps, injection and downsampling are done again. Reading the scene is part of none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import mitsuba as mi
import numpy as np

import vctgi
from experiments.clocks import Render
from experiments.scenes import LoadedScene
from experiments.studies.pareto.methods import Method
from vctgi.clipmap.levels import move_clipmap
from vctgi.config import RenderConfig
from vctgi.pipeline import (
    Frame,
    LitVolume,
    PreparedScene,
    SceneVoxels,
    update_voxels,
    voxelize_scene,
)
from vctgi.trace_cache import TraceCache

STILL, CAMERA, LIGHTS = "still", "moving camera", "moving lights"
"""Kinds of frames."""

FRAMES = (STILL, CAMERA, LIGHTS)

Update = Callable[[], tuple[PreparedScene, LitVolume]]
"""Returns the scene of the next frame, and its lit voxels."""

STEP_VOXELS = 2
"""Of the windows: their lowest voxels are even."""


def light_key(config: RenderConfig) -> RenderConfig:
    """Return a configuration that is equal for all methods that gather from the same lit voxels."""
    plain = RenderConfig()
    return replace(
        config,
        samples_per_pixel=plain.samples_per_pixel,
        reconstruction=plain.reconstruction,
        diffuse=plain.diffuse,
    )


@dataclass
class LitScene:
    """A scene with the voxels that several methods gather from.

    Attributes
    ----------
    prepared, voxels
        The scene, and its surfaces as voxels.
    lit
        The same, lit.
    cache
        What frames trace, which is recorded once: a game does not trace its frames either.
    """

    prepared: PreparedScene
    voxels: SceneVoxels
    lit: LitVolume
    cache: TraceCache = field(default_factory=TraceCache)

    @classmethod
    def of(cls, loaded: LoadedScene, config: RenderConfig) -> LitScene:
        """Voxelize and light a scene."""
        sensor = loaded.scene.sensors()[loaded.sensor_index]
        prepared = vctgi.prepare_scene(loaded.scene, sensor, config)
        voxels = voxelize_scene(prepared, config)
        return cls(prepared, voxels, vctgi.light_volume(prepared, config, voxels=voxels))

    def still(self, config: RenderConfig) -> Render:
        """Return what gathers from the voxels as they are."""
        return lambda seed: self._frame(self.prepared, self.lit, config, seed)

    def _frame(
        self,
        prepared: PreparedScene,
        lit: LitVolume,
        config: RenderConfig,
        seed: int,
    ) -> Frame:
        return vctgi.render_frame(prepared, lit.volume, config, seed=seed, cache=self.cache)

    def moving_lights(self, config: RenderConfig) -> Render:
        """Return what lights the voxels again and gathers."""
        update = self.update(LIGHTS, config)
        return lambda seed: self._frame(*update(), config, seed)

    def moving_camera(self, config: RenderConfig) -> Render:
        """Return what moves the windows to and fro, follows with the voxels, lights and gathers."""
        update = self.update(CAMERA, config)
        return lambda seed: self._frame(*update(), config, seed)

    def update(self, kind: str, config: RenderConfig) -> Update:
        """Return what brings the voxels to the next frame of a kind, without gathering.

        Parameters
        ----------
        kind
            `CAMERA` or `LIGHTS`.
        config
            Its light is that of all methods that gather from these voxels.
        """

        def light() -> tuple[PreparedScene, LitVolume]:
            # Voxels that nobody lit yet: light from outside is not found on them.
            voxels = replace(self.voxels)
            return self.prepared, vctgi.light_volume(self.prepared, config, voxels=voxels)

        if kind == LIGHTS:
            return light
        layout = self.prepared.plan.layout
        centre = np.array(layout.centre)
        step = STEP_VOXELS * layout.finest_voxel_size * _view_direction(self.prepared.sensor)
        # Voxels of its own, because an update uses up those that it is given.
        held = voxelize_scene(self.prepared, config)
        turn = 0

        def move() -> tuple[PreparedScene, LitVolume]:
            nonlocal held, turn
            turn += 1
            x, y, z = (centre + (turn % 2) * step).tolist()
            plan = replace(self.prepared.plan, layout=move_clipmap(layout, (x, y, z)))
            moved = replace(self.prepared, plan=plan)
            held = update_voxels(held, moved, config)
            return moved, vctgi.light_volume(moved, config, voxels=held)

        return move


def indirect_image(frame: Frame, method: Method) -> np.ndarray:
    """Return the indirect light of a frame [row, column, rgb]."""
    diffuse = np.array(frame.indirect_diffuse, dtype=np.float32)
    specular = np.array(frame.indirect_specular, dtype=np.float32)
    return np.float32(method.gain) * diffuse + specular


def _view_direction(sensor: mi.Sensor) -> np.ndarray:
    """Return the axis of the world that is closest to a camera's own, with its sign."""
    matrix = np.array(sensor.world_transform().matrix, dtype=np.float64).reshape(4, 4)
    forward = matrix[:3, 2]
    axis = int(np.argmax(np.abs(forward)))
    direction = np.zeros(3)
    direction[axis] = np.sign(forward[axis]) or 1.0
    return direction
