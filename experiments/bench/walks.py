"""Frames in a row, as an application renders them: a still one, a moving camera, moving lights.

Still: the voxels are kept lit, and cones are traced. Camera: it goes to and fro along its view, the
windows of the clipmap follow, what enters them is voxelized, and all voxels are lit and downsampled
again. Lights: those that have a place or a direction of their own move, and all voxels are lit and
downsampled again. Reading the scene is part of none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import mitsuba as mi
import numpy as np

import vctgi
from vctgi.clipmap.levels import move_clipmap
from vctgi.clipmap.storage import VoxelVolume
from vctgi.config import RenderConfig
from vctgi.frame_pipeline import FrameTally
from vctgi.pipeline import Frame, LitVolume, PreparedScene, update_voxels, voxelize_scene
from vctgi.prepared import StageClock, no_clock
from vctgi.trace_cache import TraceCache

STILL, CAMERA, LIGHTS = "still", "moving camera", "moving light"
"""Kinds of frames."""

CHANGE = "scene change"
"""What the clock is told while camera or lights are moved."""

KINDS = (STILL, CAMERA, LIGHTS)

TURN_FRAMES: Final = 32
"""Frames after which a camera turns round: windows of five levels all move once at least."""

LIGHT_STEP: Final = 0.002
"""Turn of a light in a frame, radians; lamps of no size move by so much of the widest window."""


@dataclass(frozen=True)
class WalkedFrame:
    """A frame, and the voxels it was made of.

    Attributes
    ----------
    frame, volume
        Picture and voxels.
    filled_count
        Voxels that were filled with surfaces anew.
    lit
        What the light of this frame was, None where it is an earlier one's.
    """

    frame: Frame
    volume: VoxelVolume
    filled_count: int
    lit: LitVolume | None

    @property
    def texel_count(self) -> int:
        """Points of light maps, for which the host waits."""
        return 0 if self.lit is None else self.lit.texel_count


class Walk:
    """A scene whose frames are asked for by number.

    Parameters
    ----------
    prepared
        The scene.
    config
        How it is rendered.
    kind
        One of `KINDS`.
    cache
        Where what frames trace is recorded; None: nowhere.
    """

    def __init__(
        self,
        prepared: PreparedScene,
        config: RenderConfig,
        kind: str,
        cache: TraceCache | None = None,
    ) -> None:
        self.prepared, self.config, self.kind, self.cache = prepared, config, kind, cache
        self._moved = prepared
        self._voxels = voxelize_scene(prepared, config)
        self._lit = vctgi.light_volume(prepared, config, voxels=self._voxels)
        self._view = _matrix(prepared.sensor)
        self._lights = [_movable(light.emitter) for light in prepared.plan.lights]

    @property
    def volume(self) -> VoxelVolume:
        """Voxels of the last frame."""
        return self._lit.volume

    def frame(self, number: int, clock: StageClock = no_clock) -> WalkedFrame:
        """Render a frame; numbers must come in order, but may start again at 0."""
        with clock(CHANGE):
            self.change(number)
        return self.render(number, clock)

    def change(self, number: int) -> None:
        """Do what an application does before it asks for a frame: move camera or lights."""
        if self.kind == CAMERA:
            self._moved = self._step(number)
        if self.kind == LIGHTS:
            self._move_lights(number)

    def render(self, number: int, clock: StageClock = no_clock) -> WalkedFrame:
        """Render the frame of the last `change`."""
        prepared, filled = self._moved, 0
        if self.kind == CAMERA:
            self._voxels = update_voxels(self._voxels, prepared, self.config, clock)
            filled = self._voxels.filled_count
        if self.kind != STILL:
            self._lit = vctgi.light_volume(
                prepared, self.config, clock, self._voxels, cache=self.cache
            )
        frame = vctgi.render_frame(
            prepared, self.volume, self.config, clock, seed=number, cache=self.cache
        )
        lit = None if self.kind == STILL else self._lit
        return WalkedFrame(frame, self.volume, filled, lit)

    def count(self, volume: VoxelVolume, clock: StageClock) -> FrameTally:
        """Render the still frame of number 0 from a volume that counts its reads."""
        tally = FrameTally()
        vctgi.render_frame(self.prepared, volume, self.config, clock, seed=0, tally=tally)
        return tally

    def put_back(self) -> None:
        """Place camera and lights where they were."""
        _place(self.prepared.sensor, self._view)
        self._move_lights(0)

    def _step(self, number: int) -> PreparedScene:
        """Move camera and windows by one finest voxel a frame, to and fro."""
        layout = self.prepared.plan.layout
        along = TURN_FRAMES - abs(number % (2 * TURN_FRAMES) - TURN_FRAMES)
        forward = self._view[:3, 2] / np.linalg.norm(self._view[:3, 2])
        offset = along * layout.finest_voxel_size * forward
        moved = self._view.copy()
        moved[:3, 3] += offset
        _place(self.prepared.sensor, moved)
        x, y, z = (np.array(layout.centre) + offset).tolist()
        plan = replace(self.prepared.plan, layout=move_clipmap(layout, (x, y, z)))
        return replace(self.prepared, plan=plan)

    def _move_lights(self, number: int) -> None:
        along = TURN_FRAMES - abs(number % (2 * TURN_FRAMES) - TURN_FRAMES)
        distance = LIGHT_STEP * self.prepared.plan.layout.extent
        for move in self._lights:
            move(along, distance)


def _matrix(thing: mi.Sensor | mi.Emitter) -> np.ndarray:
    return np.array(thing.world_transform().matrix, dtype=np.float64).reshape(4, 4)


def _place(thing: mi.Sensor | mi.Emitter, matrix: np.ndarray) -> None:
    parameters = mi.traverse(thing)
    parameters["to_world"] = mi.Transform4f(mi.ScalarTransform4f(matrix.astype(np.float32)))
    parameters.update()


def _movable(emitter: mi.Emitter) -> Callable[[int, float], None]:
    """Return what moves a light by so many steps, of a length for lamps; some stand still."""
    parameters = mi.traverse(emitter)
    if "position" in parameters:
        start = np.array(parameters["position"], dtype=np.float64).ravel()

        def shift(along: int, step: float) -> None:
            x, y, z = start.tolist()
            parameters["position"] = mi.Point3f(x + along * step, y, z)
            parameters.update()

        return shift
    if "to_world" in parameters and emitter.get_shape() is None:
        matrix = _matrix(emitter)

        def turn(along: int, step: float) -> None:
            angle = along * LIGHT_STEP
            cos, sin = np.cos(angle), np.sin(angle)
            rotation = np.eye(4)
            rotation[:2, :2] = [[cos, -sin], [sin, cos]]
            # About the light's own place.
            moved = rotation @ matrix
            moved[:3, 3] = matrix[:3, 3]
            _place(emitter, moved)

        return turn
    return lambda _along, _step: None
