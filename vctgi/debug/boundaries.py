"""Where the levels of a clipmap lie in a picture: their windows, and which level a cone reads."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import mitsuba as mi
import numpy as np

from vctgi.clipmap.levels import ClipmapLayout, LevelLayout
from vctgi.debug.camera import PixelRays
from vctgi.maths.directions import face_forward, other_axes
from vctgi.maths.stub_gaps import as_mask
from vctgi.stages.cone_tracing.march import level_around

NO_LEVEL = -1
"""A pixel that no line crosses."""

HALF_LINE_PIXELS = 0.8
"""Half width of the lines of a window."""

SMALLEST_ACROSS = 1e-18
"""Square of the sine below which a ray counts as parallel to an edge; it then passes it at no one
place."""


@dataclass
class BoundaryView:
    """The levels as the camera sees them, each [y, x].

    Attributes
    ----------
    is_hit
        Whether the ray meets a surface.
    read_level
        The finest level that a cone reads at that surface, fractional where a window fades out.
    cosine
        Of the angle between ray and surface, for shading, [0, 1].
    line_level
        The clip level whose window has an edge there, the finest of several, or `NO_LEVEL`.
    is_in_front
        Whether that edge lies before the surface.
    """

    is_hit: np.ndarray
    read_level: np.ndarray
    cosine: np.ndarray
    line_level: np.ndarray
    is_in_front: np.ndarray


def view_boundaries(scene: mi.Scene, layout: ClipmapLayout, rays: PixelRays) -> BoundaryView:
    """Return which level a cone reads at each visible point, and the edges of all windows."""
    ray = mi.Ray3f(rays.origin, rays.direction)
    si = scene.ray_intersect(ray, as_mask(True))
    is_hit = rays.picture(mi.Bool(si.is_valid()))
    normal = face_forward(mi.Vector3f(si.n), -rays.direction)
    cosine = np.abs(np.sum(rays.picture(normal) * rays.picture(rays.direction), axis=-1))
    read_level = rays.picture(level_around(layout, mi.Point3f(*layout.centre), mi.Point3f(si.p)))
    depth = np.where(is_hit, rays.picture(mi.Float(si.t)), np.inf)

    line_level = np.full(is_hit.shape, NO_LEVEL)
    is_in_front = np.zeros(is_hit.shape, bool)
    # The finest level is drawn last, over the others.
    for level in reversed(layout.clip_levels):
        distance = window_edge_distance(level, rays)
        is_line = np.isfinite(distance)
        line_level[is_line] = level.level
        is_in_front[is_line] = distance[is_line] <= depth[is_line]
    return BoundaryView(
        is_hit=is_hit,
        read_level=np.where(is_hit, read_level, 0.0),
        cosine=np.where(is_hit, cosine, 0.0),
        line_level=line_level,
        is_in_front=is_in_front,
    )


def window_edge_distance(level: LevelLayout, rays: PixelRays) -> np.ndarray:
    """Return how far away the nearest edge of a window is in each pixel that shows one.

    Works for any camera: a pixel shows an edge when its ray passes closer than half a line.

    Returns
    -------
    numpy.ndarray
        [y, x] world units along the ray; infinite where no edge is shown.
    """
    origin = rays.picture(rays.origin).astype(np.float64)
    direction = rays.picture(rays.direction).astype(np.float64)
    corners = (level.window_min, level.window_max)
    shown = np.full(direction.shape[:2], np.inf)
    for axis in range(3):
        u, v = other_axes(axis)
        across2 = np.maximum(direction[..., u] ** 2 + direction[..., v] ** 2, SMALLEST_ACROSS)
        for corner_u, corner_v in product(corners, corners):
            # Seen along its axis an edge is a point, and the ray passes it in the plane.
            to_u, to_v = corner_u[u] - origin[..., u], corner_v[v] - origin[..., v]
            t = (to_u * direction[..., u] + to_v * direction[..., v]) / across2
            miss = np.abs(to_u * direction[..., v] - to_v * direction[..., u]) / np.sqrt(across2)
            along = origin[..., axis] + t * direction[..., axis]
            is_shown = (t > 0.0) & (miss < HALF_LINE_PIXELS * t * rays.pixel_angle)
            is_shown &= (along >= corners[0][axis]) & (along <= corners[1][axis])
            shown = np.where(is_shown, np.minimum(shown, t), shown)
    return shown
