"""The entry: render a scene's reference, or read the batches that are already on disk."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import importlib.metadata
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import mitsuba as mi
import numpy as np

from reference.cache import Batch, locked_entry, read_batch, write_batch
from reference.components import Tracer, heeds_lobe_mask, trace_components, trace_rest
from reference.passes import (
    LANES_PER_PASS,
    check_memory,
    pass_seed,
    render_passes,
    samples_per_pass,
)
from reference.request import COMPONENT_NAMES, Reference, ReferenceRequest
from reference.scene_digest import scene_digest, scene_objects

ALGORITHM_VERSION: Final = 2
"""Raised by every change that changes a number, so that no old file is taken for a new one."""
_COMPONENTS_STREAM: Final = 0
_REST_STREAM: Final = 1


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
    _check_scene(scene, sensor)
    tracer = Tracer(
        scene, scene.sensors()[sensor], request.scattering_count, _has_specular_lobe(scene)
    )
    width, height = tracer.sensor.film().crop_size()
    wanted = _wanted(request)
    check_memory(width * height, request.batch_count, len(wanted))
    key = reference_key(scene, sensor=sensor, request=request)
    meter = _Meter(progress, request.batch_count)
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(wanted, (height, width, 3))

    batches: list[Batch] = []
    read_count = 0
    notes: list[str] | None = None
    with contextlib.ExitStack() as stack:
        entry = None
        if cache_directory is not None:
            entry = stack.enter_context(locked_entry(cache_directory, key))
        for index in range(request.batch_count):
            batch = None if entry is None else read_batch(entry, index, shapes)
            if batch is None:
                notes = _notes(tracer) if notes is None else notes
                batch = _render_batch(tracer, request, index, notes, meter)
                if entry is not None:
                    write_batch(entry, index, batch)
            else:
                read_count += 1
            meter.finish_batch(index)
            batches.append(batch)
    return Reference(
        components={
            name: np.stack([batch.components[name] for batch in batches]) for name in wanted
        },
        key=key,
        request=request,
        seconds=sum(batch.seconds for batch in batches),
        from_cache=read_count == request.batch_count,
        notes=batches[0].notes,
    )


def reference_key(scene: mi.Scene, *, sensor: int = 0, request: ReferenceRequest) -> str:
    """SHA-256 of all that determines a reference's numbers: 64 hexadecimal digits.

    Scene, sensor, request, our algorithm's version, the size of a pass, the variant and the
    versions of Mitsuba and Dr.Jit.
    """
    description = {
        "scene": scene_digest(scene),
        "sensor": sensor,
        "integrator": "path, split by scattering count and first lobe, box filter",
        "algorithm": ALGORITHM_VERSION,
        "request": {
            **dataclasses.asdict(request),
            "rest_samples_per_pixel": request.rest_batch_samples_per_pixel * request.batch_count,
        },
        "lanes_per_pass": LANES_PER_PASS[str(mi.variant())],
        "variant": mi.variant(),
        "mitsuba": importlib.metadata.version("mitsuba"),
        "drjit": importlib.metadata.version("drjit"),
    }
    return hashlib.sha256(json.dumps(description, sort_keys=True).encode()).hexdigest()


def _check_scene(scene: mi.Scene, sensor: int) -> None:
    if mi.variant() not in LANES_PER_PASS:
        raise ValueError(
            f"render_reference: variant {mi.variant()!r} is not supported; set one of "
            f"{list(LANES_PER_PASS)} with mi.set_variant and load the scene again."
        )
    count = len(scene.sensors())
    if not 0 <= sensor < count:
        raise ValueError(
            f"render_reference: sensor {sensor} does not exist, the scene has {count}; add a "
            "sensor or choose another index."
        )


def _has_rest(request: ReferenceRequest) -> bool:
    return request.rest_batch_samples_per_pixel > 0


def _wanted(request: ReferenceRequest) -> list[str]:
    """List the components that a request leads to."""
    return [name for name in COMPONENT_NAMES if name != "rest" or _has_rest(request)]


def _has_specular_lobe(scene: mi.Scene) -> bool:
    """Whether any BSDF, nested ones included, scatters in another way than diffusely."""
    bsdfs = (node for node in scene_objects(scene) if isinstance(node, mi.BSDF))
    return any(_is_not_only_diffuse(bsdf) for bsdf in bsdfs)


def _is_diffuse(bsdf: mi.BSDF) -> bool:
    return bool(int(bsdf.flags()) & int(mi.BSDFFlags.Diffuse))


def _is_not_only_diffuse(bsdf: mi.BSDF) -> bool:
    return bool(int(bsdf.flags()) & int(mi.BSDFFlags.All) & ~int(mi.BSDFFlags.Diffuse))


def _notes(tracer: Tracer) -> list[str]:
    """List what a reader of this scene's reference should know."""
    notes = []
    objects = scene_objects(tracer.scene)
    if not tracer.has_specular:
        notes.append("indirect_specular is exactly zero: every BSDF is diffuse.")
    else:
        bsdfs = [node for node in objects if isinstance(node, mi.BSDF)]
        both = [node for node in bsdfs if _is_diffuse(node) and _is_not_only_diffuse(node)]
        for name in sorted({node.class_name() for node in both if not heeds_lobe_mask(node)}):
            notes.append(
                f"{name} does not evaluate its lobes apart: indirect light goes to "
                "indirect_diffuse or indirect_specular by the lobe that Mitsuba sampled."
            )
        if any(int(node.flags()) & int(mi.BSDFFlags.Null) for node in bsdfs):
            notes.append(
                "passing a null surface (mask, thin dielectric) counts as a scattering and "
                "shadow rays stop at it, as in Mitsuba's path."
            )
    shapes = (node for node in objects if isinstance(node, mi.Shape))
    if any(shape.is_medium_transition() for shape in shapes):
        notes.append("participating media are ignored, as in Mitsuba's path.")
    if tracer.scattering_count == 1:
        notes.append("indirect components are exactly zero: scattering_count is 1.")
    if "BoxFilter" not in str(tracer.sensor.film().rfilter()):
        notes.append("pixels are averaged with the box filter instead of the scene's own.")
    return notes


def _render_batch(
    tracer: Tracer, request: ReferenceRequest, index: int, notes: list[str], meter: _Meter
) -> Batch:
    """Render one batch; a component that the scene cannot have is zero without being traced."""
    start = time.perf_counter()
    width, height = tracer.sensor.film().crop_size()
    plans = [(trace_components, request.batch_samples_per_pixel, _COMPONENTS_STREAM)]
    if _has_rest(request):
        plans.append((trace_rest, request.rest_batch_samples_per_pixel, _REST_STREAM))
    components = {name: np.zeros((height, width, 3), np.float32) for name in _wanted(request)}
    sample_total = sum(samples for _, samples, _ in plans)
    for trace, samples, stream in plans:
        pass_samples = samples_per_pass(samples, width * height, str(mi.variant()))
        seeds = [
            pass_seed(request.seed, index, number, stream)
            for number in range(samples // pass_samples)
        ]
        components |= render_passes(
            trace,
            tracer,
            pass_samples=pass_samples,
            seeds=seeds,
            on_pass=functools.partial(meter.advance, pass_samples / sample_total),
        )
    return Batch(components=components, notes=notes, seconds=time.perf_counter() - start)


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
