"""Frames with and without what a scene does not need: pictures, work, memory, time."""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

import vctgi
from experiments.clocks import timed_frame
from vctgi.config import RenderConfig
from vctgi.pipeline import Frame, LitVolume, light_volume, prepare_scene, voxelize_scene
from vctgi.trace_cache import TraceCache

PICTURES = ("indirect_diffuse", "indirect_specular", "albedo", "normal", "depth", "ambient")
"""Parts of a frame that are compared."""


@dataclass(frozen=True)
class Rendered:
    """A frame with what it was made of.

    Attributes
    ----------
    frame, lit
        Picture and voxels.
    """

    frame: Frame
    lit: LitVolume

    @property
    def values(self) -> np.ndarray:
        """All numbers of the picture, flat."""
        parts = [getattr(self.frame, name) for name in PICTURES]
        return np.concatenate([np.array(part).ravel() for part in parts if part is not None])


Render = Callable[[int], Rendered]
"""Renders a frame with a seed, until the device is asked for all of it."""


def single_frames(scene: mi.Scene, config: RenderConfig, *, with_reading: bool) -> Render:
    """Return what makes frames of a scene from scratch.

    Parameters
    ----------
    scene
        Its first camera is used.
    config
        What is asked for.
    with_reading
        Whether a frame reads the scene anew, too.
    """
    sensor = scene.sensors()[0]
    prepared = prepare_scene(scene, sensor, config)

    def render(seed: int) -> Rendered:
        read = prepare_scene(scene, sensor, config) if with_reading else prepared
        lit = light_volume(read, config, voxels=voxelize_scene(read, config))
        return Rendered(vctgi.render_frame(read, lit.volume, config, seed=seed), lit)

    return render


def following_frames(
    scene: mi.Scene, config: RenderConfig, change: Callable[[int], None] = lambda _: None
) -> Render:
    """Return what makes the frames of a scene one after the other, as a game would.

    What they trace is recorded once. Launches then follow one another closely, so that a GPU's
    clock does not count the time in which Python is tracing the next.

    Parameters
    ----------
    scene
        Its first camera is used.
    config
        What is asked for.
    change
        Called before each frame with its number, to move things.
    """
    sensor = scene.sensors()[0]
    held: vctgi.FollowedScene | None = None
    number = 0
    cache = TraceCache()

    def render(seed: int) -> Rendered:
        nonlocal held, number
        change(number)
        number += 1
        held = vctgi.follow_scene(held, scene, sensor, config)
        volume = held.lit.volume
        frame = vctgi.render_frame(held.prepared, volume, config, seed=seed, cache=cache)
        return Rendered(frame, held.lit)

    return render


@dataclass(frozen=True)
class Work:
    """What a warm frame took.

    Attributes
    ----------
    operations
        Instructions of its kernels times their lanes; those of a loop count once.
    launches
        Kernels.
    peak
        Most memory that was held at a time, bytes, above what was held before.
    """

    operations: float
    launches: int
    peak: float


def work_of(render: Render) -> Work:
    """Render a frame that compiles nothing and count what it does."""
    render(0)
    gc.collect()
    dr.sync_thread()
    dr.flush_malloc_cache()
    backend = dr.backend_v(mi.Float)
    dr.detail.malloc_clear_statistics()
    before = dr.detail.malloc_watermark(backend)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        found = render(1)
        dr.sync_thread()
        kernels = dr.kernel_history()
    peak = float(dr.detail.malloc_watermark(backend) - before)
    del found
    traced = [kernel for kernel in kernels if "operation_count" in kernel]
    operations = sum(float(each["operation_count"]) * float(each["size"]) for each in traced)
    return Work(operations, len(traced), peak)


@dataclass
class Pair:
    """The same frames with everything left out that can be, and with something kept.

    Attributes
    ----------
    lean, kept
        Renderers.
    """

    lean: Render
    kept: Render

    @classmethod
    def of(cls, make: Callable[[RenderConfig], Render], config: RenderConfig, name: str) -> Pair:
        """Make both; `name` is what is kept, or "all"."""
        return cls(make(config), make(replace(config, keep=(name,))))


def interleaved(pair: Pair, repetitions: int) -> tuple[list[float], list[float]]:
    """Return device times of frames, left out and kept, seconds, in turns.

    Both have to be warm: `work_of` makes them so.
    The order within a turn alternates, so that neither has the better place.
    """
    lean: list[float] = []
    kept: list[float] = []
    for turn in range(repetitions):
        both = [(pair.lean, lean), (pair.kept, kept)]
        for render, times in both[:: 1 if turn % 2 else -1]:
            times.append(timed_frame(render, turn)[0].device)
    return lean, kept
