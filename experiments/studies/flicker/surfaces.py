"""Which surface each pixel shows, for pixels that show no other.

A plane does not tell: a lamp hangs a hundredth of the room below the ceiling, and both face down.
Nor does the shape alone, as Mitsuba may make one of all that shares a material: `motion_of` asks
for both.
"""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.maths.stub_gaps import as_component

RAYS_PER_EDGE = 8
"""Rays along an edge of a pixel."""

LEAST_COSINE = 0.9
"""Between the normals of one surface within a pixel: a cube is one shape, but several surfaces."""

SEVERAL = -1
"""Number of a pixel that shows several surfaces."""


def surfaces_shown(scene: mi.Scene, sensor: mi.Sensor) -> np.ndarray:
    """Return the number of the shape that all of a pixel shows [row, column], or `SEVERAL`.

    Parameters
    ----------
    scene, sensor
        What is seen, and by whom; lens and shutter at their middle.
    """
    width, height = (int(n) for n in sensor.film().crop_size())
    edge = RAYS_PER_EDGE
    lane = dr.arange(mi.UInt32, width * height * edge * edge)
    column, row = lane % (width * edge), lane // (width * edge)
    place = mi.Point2f(
        (mi.Float(column) + 0.5) / (width * edge), (mi.Float(row) + 0.5) / (height * edge)
    )
    ray, _ = sensor.sample_ray(
        as_component(sensor.shutter_open()), as_component(0.5), place, mi.Point2f(0.5, 0.5)
    )
    si = scene.ray_intersect(mi.Ray3f(ray))
    shape = np.array(dr.reinterpret_array(mi.UInt32, si.shape), dtype=np.int64)
    numbers = _by_pixel(shape[:, None], width, height)[..., 0]
    normals = _by_pixel(np.array(si.n, dtype=np.float64).T, width, height)
    first = normals[:, :, :1]
    is_one = (numbers == numbers[..., :1]).all(axis=-1)
    is_one &= ((normals * first).sum(axis=-1) >= LEAST_COSINE).all(axis=-1)
    # Rays that met nothing have the number 0 and no normal.
    return np.where(is_one, numbers[..., 0], SEVERAL)


def _by_pixel(values: np.ndarray, width: int, height: int) -> np.ndarray:
    """Return values [row, column, ray, channel] of rays in rows."""
    edge = RAYS_PER_EDGE
    tiles = values.reshape(height, edge, width, edge, -1).transpose(0, 2, 1, 3, 4)
    return tiles.reshape(height, width, edge * edge, -1)
