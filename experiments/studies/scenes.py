"""Scenes of which the light is known in closed form: surfaces of constant radiance, and receivers.

Every surface is one-sided, wound counter-clockwise seen from the side that shines. Lengths are
world units; a room is two wide.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

OBLIQUE_AXIS = (1.0, 2.0, 3.0)
OBLIQUE_DEGREES = 33.0
"""The turn after which nothing is aligned with the voxels any more."""


@dataclass(frozen=True, kw_only=True)
class ShiningScene:
    """Surfaces of constant radiance, and points that receive their light.

    Attributes
    ----------
    triangles
        [triangle, corner, 3] world space, float64.
    radiance
        [triangle] W m^-2 sr^-1.
    points, normals
        [point, 3] receivers, and the side on which they receive.
    """

    triangles: np.ndarray
    radiance: np.ndarray
    points: np.ndarray
    normals: np.ndarray

    def turned(self) -> ShiningScene:
        """Return the scene after the oblique turn about the origin."""
        turn = oblique_matrix()
        return replace(
            self,
            triangles=self.triangles @ turn.T,
            points=self.points @ turn.T,
            normals=self.normals @ turn.T,
        )

    def moved(self, offset: np.ndarray) -> ShiningScene:
        """Return the scene moved by a vector, world units."""
        return replace(self, triangles=self.triangles + offset, points=self.points + offset)


def oblique_matrix() -> np.ndarray:
    """Return the rotation [3, 3] by `OBLIQUE_DEGREES` about `OBLIQUE_AXIS` (Rodrigues)."""
    x, y, z = np.array(OBLIQUE_AXIS) / math.hypot(*OBLIQUE_AXIS)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = math.radians(OBLIQUE_DEGREES)
    matrix: np.ndarray = (
        np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)
    )
    return matrix


@dataclass(frozen=True)
class Rectangle:
    """A rectangle from a corner along two edges; its front is on the side of their product."""

    corner: tuple[float, float, float]
    u: tuple[float, float, float]
    v: tuple[float, float, float]

    @property
    def normal(self) -> np.ndarray:
        """Unit normal."""
        product = np.cross(self.u, self.v)
        unit: np.ndarray = product / np.linalg.norm(product)
        return unit

    @property
    def area(self) -> float:
        """Area, square world units."""
        return float(np.linalg.norm(np.cross(self.u, self.v)))

    @property
    def triangles(self) -> np.ndarray:
        """[2, corner, 3] its two halves."""
        a, b, c, d = (self._at(s, t) for s, t in ((0, 0), (1, 0), (1, 1), (0, 1)))
        return np.array([[a, b, c], [a, c, d]])

    def stratified_points(self, edge: int, rng: np.random.Generator) -> np.ndarray:
        """[edge^2, 3] points, one at a random place of each of `edge` x `edge` cells."""
        place = rng.random((2, edge, edge))
        s = (np.arange(edge)[:, None] + place[0]) / edge
        t = (np.arange(edge)[None, :] + place[1]) / edge
        points: np.ndarray = self._at(s.ravel()[:, None], t.ravel()[:, None])
        return points

    def _at(self, s: float | np.ndarray, t: float | np.ndarray) -> np.ndarray:
        point: np.ndarray = np.array(self.corner) + s * np.array(self.u) + t * np.array(self.v)
        return point


def box_faces(low: tuple[float, ...], high: tuple[float, ...]) -> list[Rectangle]:
    """Return the six faces of a box, shining inwards; order -x +x -y +y -z +z."""
    faces = []
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        edges = []
        for along in (a, b):
            edge = [0.0, 0.0, 0.0]
            edge[along] = high[along] - low[along]
            edges.append((edge[0], edge[1], edge[2]))
        upper = [*low]
        upper[axis] = high[axis]
        faces.append(Rectangle((low[0], low[1], low[2]), edges[0], edges[1]))
        faces.append(Rectangle((upper[0], upper[1], upper[2]), edges[1], edges[0]))
    return faces


def _scene(
    shining: list[tuple[Rectangle, float]], receivers: list[Rectangle], edge: int, seed: int
) -> ShiningScene:
    """Put rectangles of a radiance each and receiving rectangles together."""
    rng = np.random.default_rng(seed)
    points = [each.stratified_points(edge, rng) for each in receivers]
    return ShiningScene(
        triangles=np.concatenate([each.triangles for each, _ in shining]),
        radiance=np.repeat([radiance for _, radiance in shining], 2),
        points=np.concatenate(points),
        normals=np.repeat([each.normal for each in receivers], edge * edge, axis=0),
    )


def white_furnace(edge: int, seed: int) -> ShiningScene:
    """Return the closed box of radiance 1: every point receives E / pi = 1 [design oracle 5]."""
    walls = box_faces((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    return _scene([(wall, 1.0) for wall in walls], walls, edge, seed)


FLOOR = Rectangle((-0.5, 0.0, -0.5), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
WALL = Rectangle((-0.5, 0.0, -0.5), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def parallel_squares(distance: float, edge: int, seed: int) -> ShiningScene:
    """Return two unit squares that face each other; the lower one shines, the upper receives."""
    ceiling = Rectangle((-0.5, distance, -0.5), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    return _scene([(FLOOR, 1.0), (ceiling, 0.0)], [ceiling], edge, seed)


def perpendicular_squares(edge: int, seed: int) -> ShiningScene:
    """Return two unit squares that share an edge at a right angle."""
    return _scene([(FLOOR, 1.0), (WALL, 0.0)], [WALL], edge, seed)


def parallel_form_factor(distance: float) -> float:
    """Form factor between two parallel unit squares that face each other at a distance."""
    a = 1.0 / distance
    b = 1.0 + a * a
    term = math.log(b * b / (1.0 + 2.0 * a * a)) / 2.0
    arcs = 2.0 * a * math.sqrt(b) * math.atan(a / math.sqrt(b)) - 2.0 * a * math.atan(a)
    return 2.0 / (math.pi * a * a) * (term + arcs)


def perpendicular_form_factor() -> float:
    """Form factor between two unit squares that share an edge at a right angle."""
    arcs = 2.0 * math.atan(1.0) - math.sqrt(2.0) * math.atan(1.0 / math.sqrt(2.0))
    return (arcs + 0.25 * math.log(0.75)) / math.pi


def divided_rooms(thickness: float, edge: int, seed: int) -> ShiningScene:
    """Return a lit and a dark closed room, unit cubes with a solid wall between them.

    Parameters
    ----------
    thickness
        Of the wall, world units.
    edge
        Receivers along an edge of each wall of the dark room, where the truth is 0.
    seed
        Of the receivers' places.
    """
    half = 0.5 * thickness
    lit = box_faces((-1.0 - half, -0.5, -0.5), (-half, 0.5, 0.5))
    dark = box_faces((half, -0.5, -0.5), (1.0 + half, 0.5, 0.5))
    shining = [(wall, 1.0) for wall in lit] + [(wall, 0.0) for wall in dark]
    return _scene(shining, dark, edge, seed)
