"""What frames trace, kept from one frame to the next, which then only launches it.

Tracing a frame in Python takes longer than its kernels on a large GPU. Frames of one scene, size
and configuration trace the same: `dr.freeze` records it once. Whatever may differ from frame to
frame is an input of what is recorded, or part of the key that it is found by.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, TypeVar

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.levels import move_clipmap
from vctgi.clipmap.storage import VoxelVolume
from vctgi.config import RenderConfig
from vctgi.maths.constant_tables import kept_tables
from vctgi.prepared import PreparedScene
from vctgi.scene.extent import scene_bounds

Found = TypeVar("Found")


class TraceCache:
    """Keeps what frames of one scene trace, for those who render many.

    Values of the scene, camera and voxels may change between frames: `vctgi.render_frame` returns
    the same with a cache as without, bit for bit. Another scene object empties the cache, and so
    must `clear` where shapes, materials or lights of a scene came, went or were replaced.
    """

    def __init__(self) -> None:
        self._scene: mi.Scene | None = None
        self._frozen: dict[Hashable, _Recorded | None] = {}

    def clear(self) -> None:
        """Forget everything."""
        self._scene = None
        self._frozen.clear()

    @property
    def recording_count(self) -> int:
        """How often something was traced since the cache was empty."""
        kept = (each for each in self._frozen.values() if each is not None)
        return sum(int(each.frozen.n_recordings) for each in kept)

    def hold(self, scene: mi.Scene) -> None:
        """Keep what frames of a scene trace; another than before empties the cache."""
        if self._scene is not scene:
            self.clear()
            self._scene = scene

    def key_of(self, prepared: PreparedScene, config: RenderConfig) -> Hashable:
        """Return what frames have to share to be traced alike; another scene empties the cache."""
        self.hold(prepared.scene)
        plan, sensor = prepared.plan, prepared.sensor
        size = tuple(int(n) for n in sensor.film().crop_size())
        shutter = float(sensor.shutter_open()), float(sensor.shutter_open_time())
        bounds = tuple(x for corner in scene_bounds(prepared.scene) for x in corner.tolist())
        parts = (plan.has_specular, plan.has_passing, plan.has_sky_in_cones)
        return config, size, shutter, bounds, parts

    def run(
        self,
        key: Hashable,
        function: Callable[..., Found],
        *inputs: Any,
    ) -> Found:
        """Return what a function of arrays returns, traced only when the key is new.

        Parameters
        ----------
        key
            Everything else that the function depends on.
        function
            Must depend on nothing but its inputs and the key.
        inputs
            Its inputs.
        """
        if key not in self._frozen:
            # The first time all tables of constants are made, which a recording could not do.
            self._frozen[key] = None
            return function(*inputs)
        recorded = self._frozen[key]
        if recorded is None:
            recorded = _Recorded(function, kept_tables())
            self._frozen[key] = recorded
        with _no_collection():
            try:
                found: Found = recorded.frozen(recorded.tables, *inputs)
            except RuntimeError as error:
                if OTHER_OBJECTS not in str(error):
                    raise
                # Objects of any scene came or went, which a recording counts.
                recorded = _Recorded(function, kept_tables())
                self._frozen[key] = recorded
                found = recorded.frozen(recorded.tables, *inputs)
        return found


OTHER_OBJECTS = "number of registry entries"
"""What Dr.Jit says where Mitsuba has more or fewer objects than there were at the recording."""


@contextmanager
def _no_collection() -> Iterator[None]:
    """Keep Python from collecting garbage: no array of NumPy's may go while Dr.Jit records."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


class _Recorded:
    """A function that is traced once, with the tables that it may read."""

    def __init__(
        self, function: Callable[..., object], tables: Sequence[mi.Float | mi.UInt32]
    ) -> None:
        def with_tables(tables: object, *inputs: object) -> object:
            return function(*inputs)

        self.tables = list(tables)
        self.frozen: Any = dr.freeze(with_tables)


def with_windows_at_origin(volume: VoxelVolume) -> VoxelVolume:
    """Return a volume whose layout says nothing of where its windows stand; its table does."""
    return replace(volume, layout=move_clipmap(volume.layout, (0.0, 0.0, 0.0)))
