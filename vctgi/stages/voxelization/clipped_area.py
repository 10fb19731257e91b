"""Area of a triangle within a box, seen along an axis, in closed form.

By Green's theorem the area of a polygon is the integral of u dv around it. Within a rectangle, both
u and v are clamped to it: what lies outside then collapses onto its rim, where it cancels. Depth is
linear over the triangle, so the slab of depths that the box allows is a stripe; its two straight
rims close the outline where they cut the triangle. So the outline has at most five pieces, three
edges and two cuts, and each is one clamped integral. No list of corners is built, every lane does
the same, and the result has derivatives by the corners.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import drjit as dr
import mitsuba as mi

SMALLEST_SPAN = 1e-150
"""Differences below this count as none: the square of what remains is still a normal number, which
the derivative of a quotient needs."""

NOISE_FLOOR = 2.0**-46
"""Share of the box, as far as the triangle's bounds reach, that the rounding of five integrals may
leave over where there is nothing; areas below it are 0."""

if TYPE_CHECKING:
    Point = tuple[mi.Float64, mi.Float64]
    Corner = tuple[mi.Float64, mi.Float64, mi.Float64]


def clipped_area(
    u: list[mi.Float64], v: list[mi.Float64], depth: list[mi.Float64], low: Corner, high: Corner
) -> mi.Float64:
    """Return the projected area of the part of a triangle that lies in a box.

    Parameters
    ----------
    u, v
        Coordinates of the three corners in the plane of projection, in any unit of length.
    depth
        Coordinates of the corners along the axis of projection.
    low, high
        Corners (u, v, depth) of the box. Depths are half-open: a triangle of one depth lies in the
        box of which it is the lower face, and in no other.

    Returns
    -------
    mi.Float64
        Area on the (u, v) plane, >= 0 whichever way the triangle is wound, and 0 where it is seen
        edge-on. Rounding errs by less than 2^-46 of the box, and for corners far away by 2^-50 of
        their distance times the box's longer edge: with corners 10^6 boxes away the error is below
        10^-9 of the box. Derivatives are finite everywhere.

    References
    ----------
    [Panteleev2014] proposes analytic coverage, not how.
    """
    origin_u, width = _reach(u, low[0], high[0])
    origin_v, height = _reach(v, low[1], high[1])
    corners = [(u[i] - origin_u, v[i] - origin_v) for i in range(3)]
    size = (width, height)

    area = mi.Float64(0.0)
    at_low, at_high = _cuts(corners, depth, low[2]), _cuts(corners, depth, high[2])
    for a in range(3):
        b = (a + 1) % 3
        is_below_a, is_below_b = depth[a] < low[2], depth[b] < low[2]
        is_above_a, is_above_b = depth[a] >= high[2], depth[b] >= high[2]
        start = _either(is_below_a, at_low[a], _either(is_above_a, at_high[a], corners[a]))
        end = _either(is_below_b, at_low[a], _either(is_above_b, at_high[a], corners[b]))
        is_outside = (is_below_a & is_below_b) | (is_above_a & is_above_b)
        area += dr.select(is_outside, 0.0, _edge_integral(start, end, size))
    # What lies below the lower rim is taken away, so that rim is walked backwards.
    area += _rim_integral(at_low, depth, low[2], size, is_upper=False)
    area += _rim_integral(at_high, depth, high[2], size, is_upper=True)

    is_there = (width > 0.0) & (height > 0.0) & (high[2] > low[2])
    area = dr.abs(area)
    return dr.select(is_there & (area > NOISE_FLOOR * width * height), area, 0.0)


def _reach(
    corner: list[mi.Float64], low: mi.Float64, high: mi.Float64
) -> tuple[mi.Float64, mi.Float64]:
    """Origin and width of the box along an axis, cut to thrice the triangle's bounds.

    Integrals are taken from an origin near the triangle, so that tiny ones keep their digits. The
    margin keeps edges that run along an axis away from the clamp, where derivatives have a kink.
    """
    corner = [dr.detach(c) for c in corner]
    least = dr.minimum(dr.minimum(corner[0], corner[1]), corner[2])
    most = dr.maximum(dr.maximum(corner[0], corner[1]), corner[2])
    margin = most - least
    begin = dr.maximum(low, least - margin)
    return begin, dr.minimum(high, most + margin) - begin


def _cuts(corners: list[Point], depth: list[mi.Float64], limit: mi.Float64) -> list[Point]:
    """Return where each edge a -> a + 1 passes a depth; the origin for edges that do not."""
    cuts = []
    for a in range(3):
        b = (a + 1) % 3
        is_cut = (depth[a] < limit) != (depth[b] < limit)
        # Selected before the division: what is not finite must not reach derivatives either.
        rise = dr.select(is_cut, depth[b] - depth[a], 1.0)
        share = _quotient(dr.select(is_cut, limit - depth[a], 0.0), rise)
        point = [corners[a][i] + share * (corners[b][i] - corners[a][i]) for i in range(2)]
        cuts.append((dr.select(is_cut, point[0], 0.0), dr.select(is_cut, point[1], 0.0)))
    return cuts


def _rim_integral(
    cuts: list[Point], depth: list[mi.Float64], limit: mi.Float64, size: Point, *, is_upper: bool
) -> mi.Float64:
    """Integral along the segment that closes the outline where a depth cuts the triangle."""
    upward, downward = (mi.Float64(0.0), mi.Float64(0.0)), (mi.Float64(0.0), mi.Float64(0.0))
    for a in range(3):
        is_below_a, is_below_b = depth[a] < limit, depth[(a + 1) % 3] < limit
        upward = _either(is_below_a & ~is_below_b, cuts[a], upward)
        downward = _either(~is_below_a & is_below_b, cuts[a], downward)
    start, end = (upward, downward) if is_upper else (downward, upward)
    return _edge_integral(start, end, size)


def _edge_integral(start: Point, end: Point, size: Point) -> mi.Float64:
    """Integral of u dv along a segment, with both clamped to [0, size]."""
    (u_a, v_a), (u_b, v_b) = start, end
    width, height = size
    clamped_a, clamped_b = dr.clip(v_a, 0.0, height), dr.clip(v_b, 0.0, height)
    # An end within the range stays what it is, also where the segment is level.
    slope_a = _quotient(clamped_a - v_a, v_b - v_a)
    slope_b = _quotient(clamped_b - v_b, v_b - v_a)
    from_u, to_u = u_a + slope_a * (u_b - u_a), u_b + slope_b * (u_b - u_a)
    return _mean_of_clamp(from_u, to_u, width) * (clamped_b - clamped_a)


def _mean_of_clamp(a: mi.Float64, b: mi.Float64, width: mi.Float64) -> mi.Float64:
    """Mean of clamp(x, 0, width) for x evenly between `a` and `b`.

    The mean of the clamped ends, and what the parts before 0 and beyond `width` differ from it.
    """
    low, high = dr.minimum(a, b), dr.maximum(a, b)
    clamped_low, clamped_high = dr.clip(low, 0.0, width), dr.clip(high, 0.0, width)
    before = dr.maximum(-low, 0.0) - dr.maximum(-high, 0.0)
    beyond = dr.maximum(high - width, 0.0) - dr.maximum(low - width, 0.0)
    above_mean = 0.5 * ((width - clamped_low) + (width - clamped_high))
    mean = 0.5 * (clamped_low + clamped_high)
    return mean + _quotient(beyond * above_mean - before * mean, high - low)


def _either(condition: mi.Bool, one: Point, other: Point) -> Point:
    """Select one point or the other."""
    return dr.select(condition, one[0], other[0]), dr.select(condition, one[1], other[1])


def _quotient(numerator: mi.Float64, denominator: mi.Float64) -> mi.Float64:
    """Quotient, or 0 where the denominator is."""
    is_there = dr.abs(denominator) > SMALLEST_SPAN
    return dr.select(is_there, numerator, 0.0) / dr.select(is_there, denominator, 1.0)
