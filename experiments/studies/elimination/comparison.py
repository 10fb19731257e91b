"""A pair of frames: with something left out, and with it kept."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import mitsuba as mi
import numpy as np

import vctgi
from experiments.scenes.parts import SceneDict
from experiments.studies.check import Measured, StudyContext
from experiments.studies.elimination.frames import Pair, Rendered, Work, interleaved, work_of
from vctgi.clipmap.storage import StorageConfig
from vctgi.config import RenderConfig

MIB = float(1 << 20)
"""Bytes of a mebibyte."""

TURNS, QUICK_TURNS = 15, 3
"""Frames of each kind that are timed, at least."""

Bound = Callable[[Rendered, Rendered], float]
"""From the frame that leaves out and the one that does not, how far any number may move."""


def study_config(*, quick: bool) -> RenderConfig:
    """Return the configuration that all cases start from."""
    # In single precision: a texture's weights are rounded by its size, which less storage changes.
    config = replace(vctgi.preset("high"), storage=StorageConfig())
    if not quick:
        return config
    clipmap = replace(config.clipmap, resolution=32)
    return replace(config, clipmap=clipmap, samples_per_pixel=1)


def loaded_scene(context: StudyContext, make: Callable[[int], SceneDict]) -> mi.Scene:
    """Return a scene, loaded once for all cases that show it: they share its kernels."""
    size = picture_size(quick=context.quick)

    def load() -> mi.Scene:
        scene: mi.Scene = mi.load_dict(make(size))
        return scene

    return context.once(f"elimination, scene {make.__name__}", load)


def picture_size(*, quick: bool) -> int:
    """Return the edge of the pictures, pixels."""
    return 24 if quick else 256


@dataclass(frozen=True)
class Comparison:
    """What leaving out changed.

    Attributes
    ----------
    lean, kept
        The frames of one seed.
    lean_work, kept_work
        What a warm frame takes.
    lean_times, kept_times
        Device times of warm frames in turns, seconds.
    """

    lean: Rendered
    kept: Rendered
    lean_work: Work
    kept_work: Work
    lean_times: list[float]
    kept_times: list[float]

    @classmethod
    def of(cls, context: StudyContext, pair: Pair, least_turns: int = 0) -> Comparison:
        """Render, count and time both."""
        lean, kept = pair.lean(0), pair.kept(0)
        works = work_of(pair.lean), work_of(pair.kept)
        turns = max(QUICK_TURNS if context.quick else TURNS, least_turns)
        times = interleaved(pair, turns)
        return cls(lean, kept, *works, *times)

    @property
    def time_ratio(self) -> Measured:
        """Median over turns of the time with it kept over that with it left out, quartiles."""
        ratios = np.array(self.kept_times) / np.array(self.lean_times)
        low, middle, high = (float(each) for each in np.quantile(ratios, [0.25, 0.5, 0.75]))
        return Measured(value=middle, low=low, high=high, note=self._milliseconds(np.median))

    @property
    def least_time_ratio(self) -> Measured:
        """Shortest frame with everything left out over the shortest with everything kept.

        What else the machine does can only lengthen a frame, so the shortest says most.
        """
        return Measured(
            value=min(self.lean_times) / min(self.kept_times), note=self._milliseconds(np.min)
        )

    @property
    def operation_ratio(self) -> Measured:
        """Operations with it kept over those with it left out."""
        lean, kept = self.lean_work, self.kept_work
        note = f"{lean.launches} kernels left out, {kept.launches} kept"
        return Measured(value=kept.operations / lean.operations, note=note)

    @property
    def memory_saved(self) -> Measured:
        """Peak with it kept less that with it left out, MiB."""
        lean, kept = self.lean_work.peak / MIB, self.kept_work.peak / MIB
        return Measured(value=kept - lean, note=f"peak {lean:.4g} left out, {kept:.4g} kept")

    def difference(self, bound: Bound | None) -> Measured:
        """Numbers that differ, or the largest difference over its bound."""
        lean, kept = self.lean.values, self.kept.values
        if bound is None:
            return Measured(value=float(np.count_nonzero(lean != kept)), note=f"of {lean.size:,}")
        largest = float(np.abs(lean.astype(np.float64) - kept).max())
        most = bound(self.lean, self.kept)
        note = f"largest difference {largest:.3g}, bound {most:.3g}"
        share = largest / most if most > 0.0 else (0.0 if largest == 0.0 else math.inf)
        return Measured(value=share, note=note)

    def _milliseconds(self, middle: Callable[[list[float]], np.floating]) -> str:
        lean, kept = (1e3 * float(middle(each)) for each in (self.lean_times, self.kept_times))
        return f"{lean:.4g} ms left out, {kept:.4g} ms kept"
