"""The entry: render a scene's reference, or read the batches that are already on disk."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import json
from collections.abc import Callable
from pathlib import Path
from typing import Final

import mitsuba as mi

from reference.batch_run import check_scene, open_run
from reference.passes import LANES_PER_PASS, check_memory
from reference.request import Reference, ReferenceRequest
from reference.scene_digest import scene_digest

ALGORITHM_VERSION: Final = 2
"""Raised by every change that changes a number, so that no old file is taken for a new one."""


def render_reference(
    scene: mi.Scene,
    *,
    sensor: int = 0,
    request: ReferenceRequest,
    cache_directory: Path | None,
    progress: Callable[[float], None] | None = None,
) -> Reference:
    """Path-traced components of a view, in batches with independent seeds.

    Pixels are averaged with the box filter over the film's crop window, whatever filter the scene
    names. Transport is that of Mitsuba's `path`: media are ignored, a null surface (`mask`)
    counts as one scattering, shadow rays stop at it.

    Parameters
    ----------
    scene
        A loaded scene of variant `llvm_ad_rgb` or `cuda_ad_rgb`.
    sensor
        Index into the scene's sensors.
    request
        Samples, batches, scattering count and seed.
    cache_directory
        Where finished batches are kept and looked for; None renders everything, keeps nothing.
    progress
        Called with the share that is done, in [0, 1], never falling, 1 at the end.

    Raises
    ------
    ValueError
        If the variant is not supported, there is no such sensor, or the film does not fit.
    RuntimeError
        If a sample is not finite.
    """
    check_scene(scene, sensor)
    width, height = scene.sensors()[sensor].film().crop_size()
    check_memory(width * height, request.batch_count, len(request.component_names()))
    key = reference_key(scene, sensor=sensor, request=request)
    meter = _Meter(progress, request.batch_count)
    batches = []
    with open_run(scene, sensor, request, key, cache_directory) as run:
        for index in range(request.batch_count):
            batches.append(run.batch(index, meter.advance))
            meter.finish_batch(index)
        return run.reference(batches, request)


def reference_key(
    scene: mi.Scene, *, sensor: int = 0, request: ReferenceRequest, is_open_ended: bool = False
) -> str:
    """SHA-256 of all that determines a reference's numbers: 64 hexadecimal digits.

    Scene, sensor, request, our algorithm's version, the size of a pass, the variant and the
    versions of Mitsuba and Dr.Jit. Open-ended, it leaves out the number of batches, on which no
    batch depends.
    """
    description = {
        "scene": scene_digest(scene),
        "sensor": sensor,
        "integrator": "path, split by scattering count and first lobe, box filter",
        "algorithm": ALGORITHM_VERSION,
        "request": _described(request, is_open_ended),
        "lanes_per_pass": LANES_PER_PASS[str(mi.variant())],
        "variant": mi.variant(),
        "mitsuba": importlib.metadata.version("mitsuba"),
        "drjit": importlib.metadata.version("drjit"),
    }
    return hashlib.sha256(json.dumps(description, sort_keys=True).encode()).hexdigest()


def _described(request: ReferenceRequest, is_open_ended: bool) -> dict[str, object]:
    """Return what a key says of a request."""
    described = dataclasses.asdict(request)
    described["rest_samples_per_pixel"] = request.rest_batch_samples_per_pixel * request.batch_count
    # Absent where it changes nothing, so that files from before there was a choice are still found
    if not request.is_split_by_count:
        del described["is_split_by_count"]
    if is_open_ended:
        described["batch_count"] = None
        described["samples_per_pixel"] = request.batch_samples_per_pixel
        described["rest_samples_per_pixel"] = request.rest_batch_samples_per_pixel
    return described


class _Meter:
    """Turns passes and batches into a share that is done."""

    def __init__(self, progress: Callable[[float], None] | None, batch_count: int) -> None:
        self._progress = progress
        self._batch_count = batch_count
        self._done = 0.0

    def advance(self, batch_share: float) -> None:
        """One pass more, as a share of its batch."""
        self._report(self._done + batch_share / self._batch_count)

    def finish_batch(self, index: int) -> None:
        """All of a batch, whether rendered or read."""
        self._report((index + 1) / self._batch_count)

    def _report(self, done: float) -> None:
        # Shares of passes are rounded numbers: their sum may pass one by a last bit
        self._done = min(done, 1.0)
        if self._progress is not None:
            self._progress(self._done)
