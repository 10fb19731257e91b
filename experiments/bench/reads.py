"""Texels that cones read, counted where they read them, and how fast the machine reads them alone.

The counts hold for whatever the march does: a texel counts when a lane asks storage for it. One
tap of a texture that the hardware interpolates counts as one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import drjit as dr
import mitsuba as mi

from experiments.clocks import timed_frame
from reports.bench_record import Rates
from vctgi.clipmap.formats import VoxelAddress
from vctgi.clipmap.gathered import GatheredTexels
from vctgi.clipmap.neighbourhood import Layer, Neighbourhood, VoxelTexels
from vctgi.clipmap.storage import VoxelVolume
from vctgi.clipmap.texture import TextureTexels
from vctgi.maths.directions import random_bits

RATE_LANES = {dr.JitBackend.LLVM: 1 << 18, dr.JitBackend.CUDA: 1 << 22}
"""Lanes that read at a time, without anything else to do."""

READS_PER_LANE = 64

RATE_REPETITIONS = 5
"""Of which the fastest counts: a floor is what the machine can do."""

COPIED_FLOATS = {dr.JitBackend.LLVM: 1 << 24, dr.JitBackend.CUDA: 1 << 28}
"""Numbers of single precision that are copied, more than caches hold."""


class CountingTexels:
    """Texels that count how often they are asked for."""

    def __init__(self, texels: VoxelTexels) -> None:
        self._texels = texels
        self._count = dr.zeros(mi.Int64, 1)

    @property
    def byte_count(self) -> int:
        """Bytes that the texels take."""
        return self._texels.byte_count

    @property
    def scale(self) -> mi.Float | None:
        """Emittance of 1 in texels, W m^-2 sr^-1."""
        return self._texels.scale

    def has_axis(self, axis: int) -> bool:
        """Whether there is anything to read for travel along an axis."""
        return self._texels.has_axis(axis)

    def taps(
        self, around: Neighbourhood, layer: Layer, active: mi.Bool | bool = True
    ) -> Iterator[tuple[mi.Float, mi.Float, mi.Vector4f]]:
        """Fetch what storage fetches, and count it."""
        found = list(self._texels.taps(around, layer, active))
        # The lanes of a loop that have ended count for nothing: Dr.Jit masks what they would add.
        lanes = mi.UInt32(0) & around.level
        dr.scatter_add(self._count, mi.Int64(len(found)), lanes, mi.Bool(active))
        yield from found

    def texel(self, around: Neighbourhood, layer: Layer, active: mi.Bool | bool) -> mi.Vector4f:
        """Fetch what storage fetches, and count it."""
        lanes = mi.UInt32(0) & around.level
        dr.scatter_add(self._count, mi.Int64(1), lanes, mi.Bool(active))
        return self._texels.texel(around, layer, active)

    def take_count(self) -> int:
        """Return the texels that were read since the last call."""
        found = int(self._count[0])
        self._count = dr.zeros(mi.Int64, 1)
        return found


def counting(volume: VoxelVolume) -> tuple[VoxelVolume, Callable[[], int]]:
    """Return a volume whose reads are counted, and what returns the count since it was asked last.

    It is for reading without derivatives.
    """
    texels = CountingTexels(volume.texels)
    return replace(volume, texels=texels), texels.take_count


def measure_rates(volume: VoxelVolume) -> Rates:
    """Return how fast the machine reads the texels of a volume, and copies memory."""
    return Rates(
        coherent_reads=_read_rate(volume, is_random=False),
        random_reads=_read_rate(volume, is_random=True),
        copied_bytes=_copy_rate(),
    )


def _read_rate(volume: VoxelVolume, *, is_random: bool) -> float:
    """Texels a second that a loop reads which does nothing else."""
    lanes = RATE_LANES[dr.backend_v(mi.Float)]
    fetch = bare_fetch(volume.texels)

    def read(turn: int) -> None:
        start = dr.opaque(mi.UInt32, turn)
        row = dr.opaque(mi.UInt32, ROW)

        def body(number: mi.UInt32, total: mi.Vector4f) -> tuple[mi.UInt32, mi.Vector4f]:
            lane = dr.arange(mi.UInt32, lanes)
            place = random_bits(lane, number + start) if is_random else lane + number * row + start
            return number + 1, mi.Vector4f(total + fetch(mi.UInt32(place)))

        _, total = dr.while_loop(
            state=(dr.zeros(mi.UInt32, lanes), dr.zeros(mi.Vector4f, lanes)),
            cond=lambda number, _: number < READS_PER_LANE,
            body=body,
            labels=("number", "total"),
            label="bare reads",
        )
        dr.eval(total)

    return lanes * READS_PER_LANE / _fastest(read)


ROW = 64
"""Texels from one read of a lane to its next, where neighbouring lanes read neighbouring ones."""


def bare_fetch(texels: VoxelTexels) -> Callable[[mi.UInt32], mi.Vector4f]:
    """Return what reads a texel by any number, with no more work than it takes.

    Numbers are masked, not divided, so that they reach as many texels as the largest power of two
    that are there.
    """
    if isinstance(texels, GatheredTexels):
        slabs = texels.code.slab_count(texels.directions.count)
        voxels = texels.byte_count // (texels.code.word_bytes * slabs)
        # One word of each voxel: as far as one slab of all of them reaches.
        mask = dr.opaque(mi.UInt32, _power_below(voxels) - 1)
        none = mi.UInt32(0)

        def gathered(place: mi.UInt32) -> mi.Vector4f:
            voxel = VoxelAddress(none, none, place & mask)
            return texels.code.fetch(texels.words, voxel, 0, texels.directions.count, True)

        return gathered
    if isinstance(texels, TextureTexels):
        depth, _, width = (int(n) for n in texels.texture.shape[:3])
        bits = dr.opaque(mi.UInt32, width.bit_length() - 1)
        row_mask = dr.opaque(mi.UInt32, width - 1)
        layer_mask = dr.opaque(mi.UInt32, _power_below(depth) - 1)

        def sampled(place: mi.UInt32) -> mi.Vector4f:
            x, y = place & row_mask, (place >> bits) & row_mask
            z = (place >> (2 * bits)) & layer_mask
            point = (mi.Vector3f(mi.Float(x), mi.Float(y), mi.Float(z)) + 0.5) * texels.per_texel
            return mi.Vector4f(*texels.texture.eval(mi.Point3f(point)))

        return sampled
    raise ValueError(
        f"measure_rates: nothing says how a bare {type(texels).__name__} is read; add it to "
        "experiments/bench/reads.py."
    )


def _power_below(count: int) -> int:
    """Largest power of two that is not above a count."""
    return 1 << (count.bit_length() - 1)


def _copy_rate() -> float:
    """Bytes a second, read and written."""
    count = COPIED_FLOATS[dr.backend_v(mi.Float)]
    source = dr.full(mi.Float, 1.0, count)
    dr.eval(source)

    def copy(turn: int) -> None:
        dr.eval(source + dr.opaque(mi.Float, float(turn)))

    return 2 * BYTES_PER_FLOAT * count / _fastest(copy)


BYTES_PER_FLOAT = 4


def _fastest(work: Callable[[int], None]) -> float:
    """Device time of the fastest of some repetitions after one that compiles, seconds."""

    def render(turn: int) -> None:
        work(turn)

    times = [timed_frame(render, turn)[0].device for turn in range(1 + RATE_REPETITIONS)]
    return min(times[1:])
