"""Axis directions, low-discrepancy points and hashes: pure functions of numbers.

The six opacity directions have the order +x -x +y -y +z -z everywhere: slot ``2 * axis`` holds
what a ray travelling towards +axis meets, slot ``2 * axis + 1`` what one towards -axis meets.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import drjit as dr
import mitsuba as mi

from vctgi.maths.stub_gaps import as_bits

if TYPE_CHECKING:
    from collections.abc import Sequence

DIRECTION_COUNT = 6
"""Opacity directions of a voxel."""

PLASTIC_RATIO = 1.32471795724474602596
"""Root of x^3 = x + 1, the base of the two-dimensional Kronecker sequence [Roberts2018]."""


def other_axes(axis: int) -> tuple[int, int]:
    """Return the two axes across `axis`, in cyclic order (x -> y, z)."""
    return (axis + 1) % 3, (axis + 2) % 3


def kronecker_points(index: mi.UInt32, offset: Sequence[float] = (0.5, 0.5)) -> mi.Point2f:
    """Return points of the two-dimensional R2 sequence.

    Parameters
    ----------
    index
        Sequence number.
    offset
        Start of the sequence in the unit square.

    Returns
    -------
    mi.Point2f
        Points in [0, 1)^2.

    References
    ----------
    [Roberts2018] M. Roberts, The unreasonable effectiveness of quasirandom sequences.
    """
    # In integers modulo 2^32: the fraction stays exact at any index.
    steps = [int(2**32 / PLASTIC_RATIO), int(2**32 / PLASTIC_RATIO**2)]
    coordinates = []
    for step, start in zip(steps, offset, strict=True):
        bits = index * mi.UInt32(step) + mi.UInt32(int(start * 2**32) % 2**32)
        coordinates.append(unit_from_bits(bits))
    return mi.Point2f(*coordinates)


FOUR_DIMENSIONAL_RATIO = 1.16730397826141868426
"""Root of x^5 = x + 1, the base of the four-dimensional Kronecker sequence [Roberts2018]."""


def kronecker_points_4d(index: mi.UInt32) -> list[mi.Float]:
    """Return the four coordinates, in [0, 1), of points of the R4 sequence [Roberts2018]."""
    coordinates = []
    for axis in range(4):
        step = mi.UInt32(int(2**32 / FOUR_DIMENSIONAL_RATIO ** (axis + 1)))
        coordinates.append(unit_from_bits(index * step + mi.UInt32(2**31)))
    return coordinates


def unit_from_bits(bits: mi.UInt32) -> mi.Float:
    """Return the number in [0, 1) whose leading 24 binary digits are those of `bits`."""
    return mi.Float(bits >> 8) * (1.0 / 2**24)


def random_bits(index: mi.UInt32, stream: int | mi.UInt32) -> mi.UInt32:
    """Return a hash of `index`, the same in every run, that differs from stream to stream."""
    bits, _ = mi.sample_tea_32(as_bits(index), as_bits(mi.UInt32(stream)), TEA_ROUNDS)
    return mi.UInt32(bits)


def random_unit(index: mi.UInt32, stream: int | mi.UInt32) -> mi.Float:
    """Return a hash of `index` in [0, 1): the same lane gives the same number in every run."""
    return unit_from_bits(random_bits(index, stream))


RAY_EPSILON = 64.0 * 2.0**-24
"""Offset of a new ray from its surface, relative to its coordinates and to the scene's extent: room
for the roundings of single precision. Mitsuba's own rule adds a length in world units, 9e-5, which
is more than a small scene has."""


def offset_from_surface(
    p_world: mi.Point3f, normal: mi.Vector3f, half_extent: mi.Float
) -> mi.Point3f:
    """Return where a ray that leaves a surface on the side of `normal` starts.

    Parameters
    ----------
    p_world
        Point of the surface.
    normal
        Its unit normal, on the side that the ray is on.
    half_extent
        Half the longest edge of the scene's bounds, world units.
    """
    scale = half_extent + dr.max(dr.abs(p_world))
    return mi.Point3f(dr.fma(normal, scale * RAY_EPSILON, p_world))


TEA_ROUNDS = 8
"""Rounds of the hash; Mitsuba's default of 4 is far from uniform on small consecutive numbers."""


def front_normal(si: mi.SurfaceInteraction3f) -> mi.Vector3f:
    """Return the geometric normal on the side of the shading normal, which BSDFs call the front.

    The two differ in side where a mirroring has turned the winding of a mesh with vertex normals.
    """
    return face_forward(mi.Vector3f(si.n), mi.Vector3f(si.sh_frame.n))


def face_forward(normal: mi.Vector3f, direction: mi.Vector3f) -> mi.Vector3f:
    """Return `normal` or its opposite, whichever lies in the hemisphere of `direction`."""
    return dr.select(dr.dot(normal, direction) < 0.0, -normal, normal)
