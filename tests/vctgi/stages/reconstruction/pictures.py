"""Pictures of planes seen by a pinhole camera, written down rather than rendered."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.scene.receivers import white_receivers
from vctgi.scene.records import GBuffer
from vctgi.stages.reconstruction.config import ReconstructionConfig
from vctgi.stages.reconstruction.interpolation import interpolate, lone_rays, refine, trace_sparse
from vctgi.stages.reconstruction.sparse_pixels import SparseGrid


@dataclass
class Picture:
    """What each pixel sees.

    Attributes
    ----------
    gbuffer, place
        Visible points, and where their rays pass.
    surface
        [height, width] number of the plane that is seen.
    light
        [height, width] light that is gathered there.
    traced
        Points that gathered light, counted.
    """

    gbuffer: GBuffer
    place: mi.Point2f
    surface: np.ndarray
    light: np.ndarray
    traced: int = 0

    def gather(self, points: GBuffer) -> mi.Color3f:
        """Look the light up by the number of the ray."""
        self.traced += int(np.count_nonzero(np.array(points.is_valid)))
        flat = mi.Float(np.ascontiguousarray(self.light.ravel(), dtype=np.float32))
        return mi.Color3f(dr.gather(mi.Float, flat, points.sample_index, points.is_valid))


@dataclass(frozen=True)
class Plane:
    """A plane that some pixels see: through a point, with a unit normal."""

    point: tuple[float, float, float]
    normal: tuple[float, float, float]


def pinhole(size: int, shift: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Ray directions [size, size, 3] of a camera at the origin, and places [size, size, 2]."""
    y, x = np.mgrid[0:size, 0:size] + shift
    place = np.stack([x, y], axis=-1)
    film = 2.0 * place / size - 1.0
    direction = np.concatenate([film, np.ones((size, size, 1))], axis=-1)
    return direction / np.linalg.norm(direction, axis=-1, keepdims=True), place


def picture_of(
    planes: list[Plane], surface: np.ndarray, light: np.ndarray, shift: float = 0.5
) -> Picture:
    """Return the picture in which each pixel sees the plane whose number it has, -1 none."""
    direction, place = pinhole(len(surface), shift)
    position, normal = np.zeros_like(direction), np.zeros_like(direction)
    normal[..., 2] = -1.0
    for number, plane in enumerate(planes):
        n, p = np.array(plane.normal), np.array(plane.point)
        depth = (n @ p) / (direction @ n)
        is_here = surface == number
        position[is_here] = (depth[..., None] * direction)[is_here]
        normal[is_here] = n
    points = white_receivers(position.reshape(-1, 3), normal.reshape(-1, 3))
    points.depth = mi.Float(np.linalg.norm(position, axis=-1).ravel().astype(np.float32))
    points.is_valid = mi.Bool((surface >= 0).ravel())
    flat = np.ascontiguousarray(place.reshape(-1, 2).T, dtype=np.float32)
    return Picture(points, mi.Point2f(flat), surface, light)


def reconstruct(
    picture: Picture, config: ReconstructionConfig, other: Picture | None = None
) -> tuple[np.ndarray, int]:
    """Light [height, width] of the rays of `other` from traced pixels, and how many traced."""
    height, width = picture.surface.shape
    grid = SparseGrid(width=width, height=height, edge=config.edge)
    traced = trace_sparse(picture.gbuffer, picture.place, grid, picture.gather)
    asked = other or picture
    found = interpolate(asked.gbuffer, asked.place, traced, config)
    alone = lone_rays(found)
    light = refine(asked.gbuffer, found.light, alone, asked.gather)
    count = 0 if alone is None else int(dr.width(alone))
    return np.array(light)[1].reshape(height, width), count
