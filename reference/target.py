"""A reference rendered until its noise is as low as asked: batch after batch, then no more."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import mitsuba as mi

from reference.batch_run import check_scene, open_run
from reference.cache import Batch
from reference.noise import LEAST_BATCHES, NoiseFloor, NoisyReferenceError, noise_floor
from reference.passes import check_memory
from reference.path_trace import reference_key
from reference.request import Reference, ReferenceRequest

PILOT_BATCH_SAMPLES: Final = 16
"""Paths a pixel of a batch, until it is known how many are needed."""
AIMED_BATCHES: Final = 16
"""Batches at most that are expected to reach the target: enough for a variance, few in memory."""

ALMOST_DONE: Final = 0.99
"""Largest share that is told before the target is reached."""


@dataclass(frozen=True, kw_only=True)
class ReferenceTarget:
    """How good a reference is asked for."""

    relmse: float
    """Noise of the mean at which rendering stops (`noise.NoiseFloor.upper`), a pure number, > 0."""
    component: str = "image"
    """Which light, as in `Reference.batches`."""
    most_samples_per_pixel: int = 1 << 16
    """Paths a pixel that are not exceeded; at least those of the pilot, 64."""
    scattering_count: int = 2
    """As in `ReferenceRequest`."""
    seed: int = 0
    """As in `ReferenceRequest`."""
    is_split_by_count: bool = False
    """As in `ReferenceRequest`."""

    def __post_init__(self) -> None:
        """Refuse what no rendering could reach."""
        if not self.relmse > 0.0:
            raise ValueError(f"ReferenceTarget.relmse must be above 0, got {self.relmse}.")
        least = PILOT_BATCH_SAMPLES * LEAST_BATCHES
        if self.most_samples_per_pixel < least:
            raise ValueError(
                f"ReferenceTarget.most_samples_per_pixel must be at least {least}, the pilot's, "
                f"got {self.most_samples_per_pixel}."
            )
        # It checks what it takes over
        self.request(PILOT_BATCH_SAMPLES, LEAST_BATCHES)

    def request(self, batch_samples: int, batch_count: int) -> ReferenceRequest:
        """Return what so many batches amount to."""
        return ReferenceRequest(
            samples_per_pixel=batch_samples * batch_count,
            batch_count=batch_count,
            scattering_count=self.scattering_count,
            seed=self.seed,
            is_split_by_count=self.is_split_by_count,
        )


def render_to_target(
    scene: mi.Scene,
    *,
    sensor: int = 0,
    target: ReferenceTarget,
    cache_directory: Path | None,
    progress: Callable[[float], None] | None = None,
) -> Reference:
    """Path-traced components of a view, as many batches as the noise asks for.

    Four small batches tell how many paths are needed, and so how large a batch should be: a power
    of two, so that one target finds the batches of another. Batches are then added until the upper
    bound of their noise is below the target. Which these are depends on nothing but the scene and
    the target, so a run that was killed goes on with the batches it has.

    Parameters
    ----------
    scene, sensor, cache_directory
        As in `render_reference`.
    target
        When to stop.
    progress
        Called with the share that is done as far as the noise tells by now, in [0, 1], never
        falling, 1 at the end.

    Raises
    ------
    NoisyReferenceError
        The target needs more paths than are allowed; what was rendered is kept. Or there is no
        light that the noise could be relative to.
    ValueError, RuntimeError
        As in `render_reference`.
    """
    check_scene(scene, sensor)
    view = _View(scene, sensor, target, cache_directory, _OpenMeter(progress, target))
    reference, floor = _add_batches(view, PILOT_BATCH_SAMPLES, LEAST_BATCHES)
    if floor.upper > target.relmse:
        _require_allowed(target, floor)
        needed = floor.samples_for(target.relmse)
        # Each number of paths is a power of two: the smallest that reaches as far
        batch_samples = 1 << max(0, -(-needed // AIMED_BATCHES) - 1).bit_length()
        batch_samples = max(PILOT_BATCH_SAMPLES, batch_samples)
        most = max(LEAST_BATCHES, target.most_samples_per_pixel // batch_samples)
        reference, floor = _add_batches(view, batch_samples, most)
        if floor.upper > target.relmse:
            _require_allowed(target, floor)
    view.meter.finish()
    return reference


@dataclass
class _View:
    """What is rendered, how well, and who is told."""

    scene: mi.Scene
    sensor: int
    target: ReferenceTarget
    cache_directory: Path | None
    meter: _OpenMeter


def _add_batches(
    view: _View, batch_samples: int, most_batches: int
) -> tuple[Reference, NoiseFloor]:
    """Render batches until the target or `most_batches` is reached."""
    target = view.target
    width, height = view.scene.sensors()[view.sensor].film().crop_size()
    request = target.request(batch_samples, LEAST_BATCHES)
    key = reference_key(view.scene, sensor=view.sensor, request=request, is_open_ended=True)
    batches: list[Batch] = []
    view.meter.start(batch_samples)
    with open_run(view.scene, view.sensor, request, key, view.cache_directory) as run:
        while True:
            count = len(batches) + 1
            check_memory(width * height, count, len(request.component_names()))
            batches.append(run.batch(len(batches), view.meter.advance))
            view.meter.finish_batches(count)
            if count < LEAST_BATCHES:
                continue
            reference = run.reference(batches, target.request(batch_samples, count))
            floor = noise_floor(reference, target.component)
            if not math.isfinite(floor.value):
                raise NoisyReferenceError(
                    f"the scene has no light in {target.component!r}: no noise can be relative to "
                    "it; turn the camera to something lit, or ask for a number of paths."
                )
            if floor.upper <= target.relmse or count >= most_batches:
                return reference, floor
            view.meter.aim(floor.samples_for(target.relmse))


def _require_allowed(target: ReferenceTarget, floor: NoiseFloor) -> None:
    """Refuse a target that is out of reach."""
    needed = floor.samples_for(target.relmse)
    if needed > target.most_samples_per_pixel:
        raise NoisyReferenceError(
            f"a noise relMSE of {target.relmse:.2g} in {target.component!r} needs about {needed} "
            f"paths a pixel, more than the {target.most_samples_per_pixel} that are allowed "
            f"({floor.samples_per_pixel} gave {floor.upper:.2g}): allow more, or ask for less."
        )


class _OpenMeter:
    """Turns samples into a share of what the noise says is needed."""

    def __init__(self, progress: Callable[[float], None] | None, target: ReferenceTarget) -> None:
        self._progress = progress
        # Until the noise is known, the most that it could be: the share then only jumps forward
        self._needed = target.most_samples_per_pixel
        self._batch_samples = 0
        self._samples = 0.0
        self._share = 0.0

    def start(self, batch_samples: int) -> None:
        """Begin batches of so many samples."""
        self._batch_samples = batch_samples
        self._samples = 0.0

    def advance(self, batch_share: float) -> None:
        """Count a pass, as a share of its batch."""
        self._samples += batch_share * self._batch_samples
        self._report(self._samples / self._needed)

    def finish_batches(self, count: int) -> None:
        """Count so many batches as done, whether rendered or read."""
        self._samples = count * self._batch_samples
        self._report(self._samples / self._needed)

    def aim(self, needed: int) -> None:
        """Say how many samples are needed in all, as far as is known."""
        self._needed = needed

    def finish(self) -> None:
        """All done."""
        self._share = 1.0
        self._report(1.0)

    def _report(self, share: float) -> None:
        # The end is only reached when the noise is; and more noise than thought takes nothing back
        self._share = max(self._share, min(share, ALMOST_DONE))
        if self._progress is not None:
            self._progress(self._share)
