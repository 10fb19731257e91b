"""The scene as one flat list of triangles, in double precision on the host.

Zero-area triangles are counted and left out; a vertex that is not finite is an error, because a
clipped or dropped one would change the scene in silence.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.errors import SceneError
from vctgi.scene.shapes import ShapeMesh, list_shapes

DEGENERATE_AREA = 1e-14
"""A triangle is degenerate when its area is below this share of the square of its longest edge:
single-precision vertices cannot tell it from a line."""


@dataclass
class LiveCorners:
    """Corners of triangles with derivatives.

    Attributes
    ----------
    positions
        World points.
    index
        [triangle, corner] which of them each corner is.
    """

    positions: mi.Point3f
    index: np.ndarray


@dataclass
class SceneTriangles:
    """Triangles of a scene.

    Attributes
    ----------
    vertices
        [triangle, corner, 3] world space, float64; counter-clockwise seen from the front.
    uv
        [triangle, corner, 2] texture coordinates.
    bsdf_index
        [triangle] index into `bsdfs`.
    shape_index
        [triangle] index into `shape_names`.
    bsdfs
        The distinct BSDFs of the scene.
    shape_names
        Names of the shapes, for messages.
    first_face
        For each top-level mesh, its Mitsuba shape, its first triangle here and its face count;
        `kept` maps its faces to triangles.
    kept
        [face over all top-level meshes and others] triangle index, or -1 for a degenerate face.
    degenerate_counts
        Zero-area triangles left out, by shape name.
    unsupported
        Sentences about what has no triangles here.
    live
        Their corners with derivatives; None where they have none.
    """

    vertices: np.ndarray
    uv: np.ndarray
    bsdf_index: np.ndarray
    shape_index: np.ndarray
    bsdfs: list[mi.BSDF]
    shape_names: list[str]
    first_face: list[tuple[mi.Shape, int]]
    kept: np.ndarray
    degenerate_counts: dict[str, int]
    unsupported: list[str]
    live: LiveCorners | None = None

    @property
    def triangle_count(self) -> int:
        """Number of triangles."""
        return len(self.vertices)

    @property
    def normals(self) -> np.ndarray:
        """[triangle, 3] unit geometric normals."""
        a, b, c = (self.vertices[:, corner] for corner in range(3))
        normal = np.cross(b - a, c - a)
        unit: np.ndarray = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        return unit

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner of the scene, world units."""
        return self.vertices.min(axis=(0, 1)), self.vertices.max(axis=(0, 1))


def extract_triangles(scene: mi.Scene) -> SceneTriangles:
    """Flatten a Mitsuba scene.

    Raises
    ------
    SceneError
        No triangles, or a vertex that is NaN or infinite.
    """
    shapes = list_shapes(scene)
    for mesh in shapes.meshes:
        _require_finite(mesh)
    if not shapes.meshes:
        raise SceneError("no geometry", "the scene", "add at least one shape with an area")
    bsdfs: list[mi.BSDF] = []
    bsdf_of_mesh = [_index_of(mesh.shape.bsdf(), bsdfs) for mesh in shapes.meshes]
    face_counts = [len(mesh.faces) for mesh in shapes.meshes]
    starts = np.concatenate([[0], np.cumsum(face_counts)]).astype(np.int64)
    vertices = np.concatenate([mesh.positions[mesh.faces] for mesh in shapes.meshes])
    uv = np.concatenate([mesh.uv[mesh.faces] for mesh in shapes.meshes])
    shape_index = np.repeat(np.arange(len(shapes.meshes)), face_counts)

    is_kept = ~is_degenerate(vertices)
    if not is_kept.any():
        raise SceneError(
            "no geometry", "the scene", "every triangle has zero area; check the meshes"
        )
    kept = np.where(is_kept, np.cumsum(is_kept) - 1, -1)
    names = [mesh.name for mesh in shapes.meshes]
    lost = np.bincount(shape_index[~is_kept], minlength=len(names))
    return SceneTriangles(
        vertices=vertices[is_kept],
        uv=uv[is_kept],
        bsdf_index=np.array(bsdf_of_mesh)[shape_index[is_kept]],
        shape_index=shape_index[is_kept],
        bsdfs=bsdfs,
        shape_names=names,
        first_face=[
            (mesh.shape, int(start))
            for mesh, start in zip(shapes.meshes, starts[:-1], strict=True)
            if mesh.is_in_scene and mesh.shape.is_mesh()
        ],
        kept=kept,
        degenerate_counts={name: int(n) for name, n in zip(names, lost, strict=True) if n},
        unsupported=shapes.unsupported,
        live=_live_corners(shapes.meshes, is_kept),
    )


def _live_corners(meshes: list[ShapeMesh], is_kept: np.ndarray) -> LiveCorners | None:
    """Return the corners of the triangles that are kept, if any of them has derivatives."""
    if all(mesh.live is None for mesh in meshes):
        return None
    counts = [len(mesh.positions) for mesh in meshes]
    starts = np.cumsum([0, *counts[:-1]])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
    parts = [
        mi.Point3f(mesh.positions.T.astype(np.float32)) if mesh.live is None else mesh.live
        for mesh in meshes
    ]
    axes = (dr.concat([mi.Float(part[axis]) for part in parts]) for axis in range(3))
    return LiveCorners(mi.Point3f(*axes), np.concatenate(faces)[is_kept])


def is_degenerate(vertices: np.ndarray) -> np.ndarray:
    """Whether triangles [triangle, corner, 3] have no area worth the name."""
    a, b, c = (vertices[:, corner] for corner in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    edges = np.stack([b - a, c - b, a - c])
    longest2 = np.max(np.sum(edges**2, axis=-1), axis=0)
    thin: np.ndarray = area <= DEGENERATE_AREA * longest2
    return thin


def _require_finite(mesh: ShapeMesh) -> None:
    used = mesh.positions[mesh.faces.ravel()]
    broken = int(np.count_nonzero(~np.isfinite(used).all(axis=1)))
    if broken:
        raise SceneError(
            f"{broken} face corners are NaN or infinite",
            f"shape '{mesh.name}'",
            "repair the mesh before rendering",
        )


def _index_of(bsdf: mi.BSDF, bsdfs: list[mi.BSDF]) -> int:
    for index, known in enumerate(bsdfs):
        if known is bsdf or known.ptr == bsdf.ptr:
            return index
    bsdfs.append(bsdf)
    return len(bsdfs) - 1
