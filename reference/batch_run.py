"""Batches of one request, one at a time: read from the cache, or rendered and kept there."""

from __future__ import annotations

import contextlib
import functools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import mitsuba as mi
import numpy as np

from reference.cache import Batch, locked_entry, read_batch, write_batch
from reference.components import Tracer, heeds_lobe_mask, trace_components, trace_rest
from reference.passes import LANES_PER_PASS, pass_seed, render_passes, samples_per_pass
from reference.request import Reference, ReferenceRequest
from reference.scene_digest import scene_objects

_COMPONENTS_STREAM: Final = 0
_REST_STREAM: Final = 1


@dataclass
class BatchRun:
    """A scene, what is asked of it, and where its batches are kept.

    Attributes
    ----------
    tracer, request
        Scene, sensor, split; samples of a batch and seed. The number of batches does not count.
    key
        Name of the entry in the cache.
    entry
        Locked folder of the batches, or None to keep nothing.
    read_count
        Batches so far that came from the folder.
    notes
        What a reader of the scene's reference should know; found when first needed.
    """

    tracer: Tracer
    request: ReferenceRequest
    key: str
    entry: Path | None
    read_count: int = 0
    notes: list[str] | None = None

    def batch(self, index: int, on_share: Callable[[float], None]) -> Batch:
        """Return a batch, which does not depend on how many others there are.

        Parameters
        ----------
        index
            Which one, >= 0.
        on_share
            Called with the share of the batch that each pass of it adds; not if it is read.
        """
        width, height = self.tracer.sensor.film().crop_size()
        names = self.request.component_names()
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(names, (height, width, 3))
        found = None if self.entry is None else read_batch(self.entry, index, shapes)
        if found is not None:
            self.read_count += 1
            return found
        self.notes = _notes(self.tracer) if self.notes is None else self.notes
        rendered = _render_batch(self.tracer, self.request, index, self.notes, on_share)
        if self.entry is not None:
            write_batch(self.entry, index, rendered)
        return rendered

    def reference(self, batches: list[Batch], request: ReferenceRequest) -> Reference:
        """Put batches together; `request` is what they amount to."""
        return Reference(
            components={
                name: np.stack([batch.components[name] for batch in batches])
                for name in request.component_names()
            },
            key=self.key,
            request=request,
            seconds=sum(batch.seconds for batch in batches),
            from_cache=self.read_count == len(batches),
            notes=batches[0].notes,
        )


@contextlib.contextmanager
def open_run(
    scene: mi.Scene,
    sensor: int,
    request: ReferenceRequest,
    key: str,
    cache_directory: Path | None,
) -> Iterator[BatchRun]:
    """Hold the entry of a key while its batches are rendered."""
    tracer = Tracer(
        scene,
        scene.sensors()[sensor],
        request.scattering_count,
        _has_specular_lobe(scene),
        request.is_split_by_count,
    )
    with contextlib.ExitStack() as stack:
        entry = None
        if cache_directory is not None:
            entry = stack.enter_context(locked_entry(cache_directory, key))
        yield BatchRun(tracer, request, key, entry)


def check_scene(scene: mi.Scene, sensor: int) -> None:
    """Refuse a variant that is not supported and a sensor that does not exist."""
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
    tracer: Tracer,
    request: ReferenceRequest,
    index: int,
    notes: list[str],
    on_share: Callable[[float], None],
) -> Batch:
    """Render one batch; a component that the scene cannot have is zero without being traced."""
    start = time.perf_counter()
    width, height = tracer.sensor.film().crop_size()
    plans = [(trace_components, request.batch_samples_per_pixel, _COMPONENTS_STREAM)]
    if request.rest_batch_samples_per_pixel > 0:
        plans.append((trace_rest, request.rest_batch_samples_per_pixel, _REST_STREAM))
    components = {
        name: np.zeros((height, width, 3), np.float32) for name in request.component_names()
    }
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
            on_pass=functools.partial(on_share, pass_samples / sample_total),
        )
    seconds = time.perf_counter() - start
    return Batch(components=components, notes=notes, seconds=seconds)
