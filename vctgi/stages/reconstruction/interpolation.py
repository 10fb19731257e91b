"""Diffuse light of every camera ray from that of the traced pixels around it.

A ray takes the light of the traced pixels of its own block and of the eight around it, weighed by
how near they are in the picture and by how much they belong to the same surface: its normal, its
plane, its depth. Weights are normalised, so what is the same everywhere stays so. A ray that finds
too few of its kind says so, and is traced itself. Of several rays in a pixel each looks for its own
surface, so the average over them is the resolve of a multisampled picture, and no light smears over
an edge. What is interpolated is irradiance: textures are not blurred.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.maths.colors import channel_mean
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.records import GBuffer
from vctgi.stages.reconstruction.config import ReconstructionConfig
from vctgi.stages.reconstruction.sparse_pixels import SparseGrid, select_sparse_pixels

Gather = Callable[[GBuffer], "mi.Color3f"]
"""Returns the light that visible points gather, albedo left out."""


@dataclass
class TracedPixels:
    """The pixels that were traced, one a block.

    Attributes
    ----------
    grid
        Their blocks.
    place
        Where their rays pass through the picture, pixels.
    surface
        What the rays met.
    light
        What was gathered there.
    """

    grid: SparseGrid
    place: mi.Point2f
    surface: _Surface
    light: mi.Color3f


@dataclass(frozen=True)
class SurfaceWidths:
    """How unlike two points of one surface may be, as numbers or as arrays of one lane.

    Attributes
    ----------
    normal_angle, plane_slope, depth_ratio
        `ReconstructionConfig.max_normal_angle`, `max_plane_slope` and `max_depth_ratio`.
    """

    normal_angle: float | mi.Float
    plane_slope: float | mi.Float
    depth_ratio: float | mi.Float


@dataclass
class _Surface:
    """What decides whether two points lie on one surface."""

    is_usable: mi.Bool
    position: mi.Point3f
    normal: mi.Vector3f
    depth: mi.Float


@dataclass
class Interpolated:
    """Light of every ray that found it, and which did not.

    Attributes
    ----------
    light
        As the traced pixels have it.
    is_alone
        Which rays found too few neighbours, and have to gather light of their own; None: none.
    """

    light: mi.Color3f
    is_alone: mi.Bool | None


def trace_sparse(
    gbuffer: GBuffer, place: mi.Point2f, grid: SparseGrid, gather: Gather
) -> TracedPixels:
    """Gather the light of one pixel in each block.

    Parameters
    ----------
    gbuffer
        One ray of every pixel, in rows.
    place
        Where the rays pass through the picture, pixels from its upper left corner.
    grid
        The blocks.
    gather
        Gathers light.
    """
    pixel = select_sparse_pixels(grid)
    points = dr.gather(GBuffer, gbuffer, pixel)
    traced_place = dr.gather(mi.Point2f, place, pixel)
    surface = _surface_of(points)
    # All in one launch, before each of them is read by itself.
    dr.eval(points, traced_place, surface)
    light = gather(points)
    dr.eval(light)
    return TracedPixels(grid, traced_place, surface, light)


def interpolate(
    gbuffer: GBuffer,
    place: mi.Point2f,
    traced: TracedPixels,
    config: ReconstructionConfig,
    widths: SurfaceWidths | None = None,
) -> Interpolated:
    """Give every ray the light of the traced pixels of its surface.

    Parameters
    ----------
    gbuffer, place
        One ray of every pixel, in rows, and where they pass through the picture. They need not be
        those that were traced.
    traced
        The traced pixels.
    config
        What counts as the same surface, and how much of it is needed.
    widths
        Values that go before those of `config`, for derivatives; None: those. Which rays find too
        few neighbours changes in jumps, which derivatives do not see.

    References
    ----------
    [Panteleev2014], slide "Sparse diffuse cone tracing".
    """
    own = _surface_of(gbuffer)
    widths = widths or SurfaceWidths(
        config.max_normal_angle, config.max_plane_slope, config.max_depth_ratio
    )
    light, support, contrast = _weigh_neighbours(own, place, traced, widths)
    is_alone = support < config.min_support
    if config.max_contrast is not None:
        # Opaque, so that all limits share one kernel.
        is_alone |= contrast > dr.opaque(mi.Float, config.max_contrast)
    is_alone &= own.is_usable
    # Together, or their neighbours would be weighed twice.
    dr.eval(light, is_alone)
    return Interpolated(light, mi.Bool(is_alone))


def lone_rays(found: Interpolated) -> mi.UInt32 | None:
    """Return the numbers of the rays that have to gather light of their own, None if none has.

    The host waits for it.
    """
    if found.is_alone is None:
        return None
    alone = mi.UInt32(dr.compress(found.is_alone))
    return alone if dr.width(alone) > 0 else None


def lanes_for(ray_count: int) -> int:
    """Return how many lanes gather light for so many rays.

    Their number differs from frame to frame, and kernels belong to a number of lanes: idle lanes
    bring it to a power of two, so that few kernels are made.
    """
    return max(LEAST_LANES, 1 << (ray_count - 1).bit_length()) if ray_count > 0 else 0


def refine(
    gbuffer: GBuffer, light: mi.Color3f, alone: mi.UInt32 | None, gather: Gather
) -> mi.Color3f:
    """Return the light of all rays, those without neighbours traced by themselves.

    Parameters
    ----------
    gbuffer
        One ray of every pixel.
    light
        What interpolation gave them.
    alone
        Numbers of those without neighbours, as `lone_rays` has them.
    gather
        Gathers light.
    """
    light = mi.Color3f(light)
    if alone is None:
        return light
    lane = dr.arange(mi.UInt32, lanes_for(dr.width(alone)))
    is_real = lane < mi.UInt32(dr.opaque_width(alone))
    ray = dr.gather(mi.UInt32, alone, lane, is_real)
    points = dr.gather(GBuffer, gbuffer, ray, is_real)
    points.is_valid &= is_real
    dr.eval(points)
    traced = dr.gather(mi.Color3f, gather(points), dr.arange(mi.UInt32, dr.width(alone)))
    dr.scatter(light, traced, alone)
    dr.eval(light)
    return light


def _weigh_neighbours(
    own: _Surface, place: mi.Point2f, traced: TracedPixels, widths: SurfaceWidths
) -> tuple[mi.Color3f, mi.Float, mi.Float]:
    """Weighted mean of the neighbours' light, the share of their weight that counts, contrast.

    Contrast is the standard deviation of their light over its mean.
    """
    grid = traced.grid
    pixel = dr.arange(mi.UInt32, grid.width * grid.height)
    bx = mi.Int32(pixel % grid.width) // grid.edge
    by = mi.Int32(pixel // grid.width) // grid.edge
    total = mi.Color3f(0.0)
    weight_sum, nearness_sum, squares = mi.Float(0.0), mi.Float(0.0), mi.Float(0.0)
    for row in (-1, 0, 1):
        for column in (-1, 0, 1):
            x, y = bx + column, by + row
            is_there = (x >= 0) & (y >= 0) & (x < grid.column_count) & (y < grid.row_count)
            block = mi.UInt32(dr.select(is_there, y * grid.column_count + x, 0))
            nearness = _nearness(
                mi.Vector2f(place - dr.gather(mi.Point2f, traced.place, block)), grid.edge
            )
            nearness = dr.select(is_there, nearness, 0.0)
            other = dr.gather(_Surface, traced.surface, block)
            weight = nearness * _likeness(own, other, widths)
            light = dr.gather(mi.Color3f, traced.light, block)
            total = dr.fma(as_component(weight), light, total)
            squares = dr.fma(weight, dr.square(channel_mean(light)), squares)
            weight_sum += weight
            nearness_sum += nearness
    # A pixel's own block is always within reach, so nearness is never 0 all around.
    has_any = weight_sum > 0.0
    weights = dr.select(has_any, weight_sum, 1.0)
    mean = mi.Color3f(total / as_component(weights))
    grey = channel_mean(mean)
    deviation = dr.safe_sqrt(squares / weights - dr.square(grey))
    contrast = mi.Float(deviation / dr.select(grey > 0.0, grey, 1.0))
    return mean, weight_sum / nearness_sum, contrast


def _nearness(offset: mi.Vector2f, edge: int) -> mi.Float:
    """Tent that ends where a traced pixel can leave the nine blocks that are looked at.

    A pixel at the rim of its block is `edge + 1` away from the nearest one that is not looked at,
    and the places of rays within two pixels differ by up to half a pixel more or less than that.
    """
    reach = edge + 0.5
    along = dr.maximum(1.0 - dr.abs(offset) / reach, 0.0)
    return mi.Float(along.x * along.y)


def _likeness(own: _Surface, other: _Surface, widths: SurfaceWidths) -> mi.Float:
    """How much two points belong to one surface, [0, 1], by normal, plane and depth."""
    least_cosine = dr.cos(widths.normal_angle)
    cosine = mi.Float(dr.dot(own.normal, other.normal))
    by_normal = (cosine - least_cosine) / (1.0 - least_cosine)

    # Distance from either plane over distance: the slope at which the other point stands off. It
    # has no unit, so it means the same near and far, and in grazing view.
    between = mi.Vector3f(other.position - own.position)
    squared = mi.Float(dr.squared_norm(between))
    # Selected before the root, whose derivative at 0 is none.
    distance = dr.sqrt(dr.select(squared > 0.0, squared, 1.0))
    from_own = mi.Float(dr.abs(dr.dot(own.normal, between)))
    from_other = mi.Float(dr.abs(dr.dot(other.normal, between)))
    slope = dr.maximum(from_own, from_other) / distance
    by_plane = 1.0 - slope / widths.plane_slope

    nearer = dr.minimum(own.depth, other.depth)
    ratio = dr.abs(own.depth - other.depth) / dr.select(nearer > 0.0, nearer, 1.0)
    by_depth = 1.0 - ratio / widths.depth_ratio

    shares = (dr.clip(each, 0.0, 1.0) for each in (by_normal, by_plane, by_depth))
    first, second, third = shares
    is_usable = own.is_usable & other.is_usable
    return mi.Float(dr.select(is_usable, first * second * third, 0.0))


LEAST_LANES = 1024
"""Points that are gathered for at a time at least."""


def _surface_of(gbuffer: GBuffer) -> _Surface:
    """Return the surfaces of rays; those that reflect nothing diffusely gather no light."""
    is_usable = gbuffer.is_valid & (dr.max(gbuffer.albedo) > 0.0)
    return _Surface(mi.Bool(is_usable), gbuffer.position, gbuffer.normal, gbuffer.depth)
