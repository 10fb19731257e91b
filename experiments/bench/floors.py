"""What a stage must read and write at least, apart from the texels that cones read.

Each array that a stage is given is counted once, and each that it returns; what caches do not hold,
atomics, and passes over the same data come on top, and are what a ratio to the floor shows.
"""

from __future__ import annotations

from dataclasses import dataclass

from experiments.bench.kernels import (
    COMPOSITE,
    DOWNSAMPLING,
    INJECTION,
    INTERPOLATION,
    SPECULAR,
    TRACING,
    VOXELS,
)
from experiments.bench.walks import STILL
from reports.bench_record import Rates
from vctgi.clipmap.regions import count_voxels, own_regions
from vctgi.config import RenderConfig
from vctgi.pipeline import PreparedScene

FLOAT, TRIPLE = 4, 12
"""Bytes of a number, and of a point, direction or colour."""

OPACITY, EMITTANCE = 6 * FLOAT, 6 * TRIPLE
"""Bytes of a voxel's opacity and emittance in single precision, six directions."""

TRIANGLE = 3 * TRIPLE

MAP_POINT = 3 * TRIPLE
"""Of a light map: place, normal, reflected power."""

SURFACE = 2 * TRIPLE + FLOAT
"""Of a visible point: place, normal, distance."""


@dataclass(frozen=True)
class Sizes:
    """What a frame was made of.

    Attributes
    ----------
    pixels, traced
        Camera rays, and those that gather light of their own.
    triangles, own_voxels
        Of the scene; those of the clip levels that no finer level covers.
    filled, texels
        Voxels filled anew, points of light maps.
    volume_bytes
        What cones read from.
    """

    pixels: int
    traced: int
    triangles: int
    own_voxels: int
    filled: int
    texels: int
    volume_bytes: int


def own_voxels(prepared: PreparedScene) -> int:
    """Return the voxels that surfaces and light are written to."""
    layout = prepared.plan.layout
    return count_voxels(box for level in layout.clip_levels for box in own_regions(layout, level))


def least_bytes(kind: str, sizes: Sizes, config: RenderConfig) -> dict[str, int]:
    """Return bytes by stage of a frame of a kind."""
    is_ambient = config.mode == "ambient"
    light = FLOAT if is_ambient else TRIPLE
    found = {
        TRACING: sizes.traced * (SURFACE + light),
        COMPOSITE: sizes.pixels * 2 * (light + TRIPLE),
    }
    if config.reconstruction.sparsity > 1:
        found[INTERPOLATION] = (sizes.pixels + sizes.traced) * (SURFACE + light)
    if not is_ambient:
        # Lobe, axis and light of a pixel; a filter reads and writes the light once more.
        passes = 1 if config.specular_filter.kind == "none" else 2
        found[SPECULAR] = sizes.pixels * (SURFACE + 2 * TRIPLE + passes * TRIPLE)
    if kind != STILL:
        emittance = 0 if is_ambient else EMITTANCE
        found[DOWNSAMPLING] = sizes.own_voxels * (OPACITY + emittance) + sizes.volume_bytes
        if not is_ambient:
            found[INJECTION] = 2 * sizes.texels * MAP_POINT + sizes.own_voxels * (
                OPACITY + emittance
            )
    if sizes.filled:
        found[VOXELS] = sizes.triangles * TRIANGLE + sizes.filled * OPACITY
    return found


def floor_ms(reads: int, byte_count: int, rates: Rates) -> float:
    """Return the time that texels and bytes take at the machine's rates, ms."""
    return 1e3 * (reads / rates.coherent_reads + byte_count / rates.copied_bytes)
