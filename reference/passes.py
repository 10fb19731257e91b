"""One batch as a series of equal passes: seeds, wavefront size, sums over pixels, finiteness."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Final

import drjit as dr
import mitsuba as mi
import numpy as np

from reference.components import TracePass, Tracer

LANES_PER_PASS: Final = {"llvm_ad_rgb": 1 << 22, "cuda_ad_rgb": 1 << 24}
"""Paths traced at once, by variant: enough to fill the machine, few enough to fit beside others."""
BYTES_PER_LANE: Final = 256
"""Upper estimate of what a path keeps in memory between kernels: four components of three floats,
the sampler's state and as much again for what Dr.Jit holds while it sums."""
MEMORY_SHARE: Final = 0.75
"""Of the machine's memory that a reference may take."""


def check_memory(pixel_count: int, batch_count: int, component_count: int) -> None:
    """Refuse a film whose smallest pass and whose batches do not fit in memory.

    Raises
    ------
    ValueError
        With the bytes needed, the bytes there are, and the way out.
    """
    # float64 sums of one batch beside the float32 batches themselves
    kept = pixel_count * component_count * 3 * (4 * batch_count + 8)
    needed = kept + pixel_count * BYTES_PER_LANE
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > MEMORY_SHARE * memory:
        raise ValueError(
            f"render_reference: {pixel_count} pixels in {batch_count} batches need "
            f"{needed / 2**30:.1f} GiB of the {memory / 2**30:.1f} GiB here: ask for fewer "
            "batches, a smaller film, or crop windows one after another."
        )


def samples_per_pass(batch_samples_per_pixel: int, pixel_count: int, variant: str) -> int:
    """Largest divisor of a batch's samples whose pass stays within `LANES_PER_PASS`; at least 1.

    A divisor, so that all passes have one shape and share one compiled kernel.
    """
    limit = max(1, LANES_PER_PASS[variant] // pixel_count)
    return next(
        count
        for count in range(min(limit, batch_samples_per_pixel), 0, -1)
        if batch_samples_per_pixel % count == 0
    )


def pass_seed(seed: int, batch: int, pass_index: int, stream: int) -> int:
    """Draw a 32-bit seed for one pass; NumPy's `SeedSequence` sees that none are related."""
    sequence = np.random.SeedSequence([seed, batch, pass_index, stream])
    return int(sequence.generate_state(1, dtype=np.uint32)[0])


def render_passes(
    trace: TracePass,
    tracer: Tracer,
    *,
    pass_samples: int,
    seeds: list[int],
    on_pass: Callable[[], None],
) -> dict[str, np.ndarray]:
    """Mean over all samples of all passes, per pixel.

    Parameters
    ----------
    trace
        Gives one sample per lane of one or more components.
    tracer
        Scene, sensor and split.
    pass_samples
        Samples per pixel in each pass.
    seeds
        One per pass.
    on_pass
        Called after each pass.

    Returns
    -------
    dict
        float32 `[y, x, rgb]` by component, W m^-2 sr^-1.

    Raises
    ------
    RuntimeError
        If a sample is not finite; names the component, how many pixels and the first of them.
    """
    width, height = tracer.sensor.film().crop_size()
    lane_count = width * height * pass_samples
    sums: dict[str, np.ndarray] = {}
    for seed in seeds:
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, lane_count)
        pixels = dr.arange(mi.UInt32, lane_count) // dr.opaque(mi.UInt32, pass_samples)
        # A colour known while tracing, such as a black scene's, is one lane wide
        samples = {
            name: [channel + dr.zeros(mi.Float, lane_count) for channel in value]
            for name, value in trace(tracer, sampler, pixels).items()
        }
        # All in one kernel: what two components share is traced once
        dr.eval(samples)
        # Neighbouring lanes belong to one pixel; summing blocks is exact from run to run,
        # adding with atomics is not
        images = {
            name: [dr.block_sum(channel, pass_samples) for channel in channels]
            for name, channels in samples.items()
        }
        dr.eval(images)
        for name, channels in images.items():
            image = np.stack([channel.numpy() for channel in channels], axis=-1)
            image = image.reshape(height, width, 3)
            _check_finite(name, image)
            sums[name] = sums.get(name, 0.0) + image.astype(np.float64)
        on_pass()
    sample_count = pass_samples * len(seeds)
    return {name: (total / sample_count).astype(np.float32) for name, total in sums.items()}


def _check_finite(name: str, image: np.ndarray) -> None:
    """Refuse an image with a sum that is not finite, which a single bad sample is enough for."""
    bad = ~np.isfinite(image).all(axis=-1)
    if bad.any():
        y, x = (int(index) for index in np.argwhere(bad)[0])
        raise RuntimeError(
            f"render_reference: component {name!r} has samples that are not finite in "
            f"{int(bad.sum())} pixels, the first at x = {x}, y = {y} of the crop window: look "
            "for an emitter, texture or vertex there that is infinite or NaN."
        )
