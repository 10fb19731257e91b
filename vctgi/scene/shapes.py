"""Mitsuba shapes as triangle meshes in world space.

Meshes are taken as they are. Spheres, disks and cylinders are tessellated on a grid of their own
parameters, inscribed, with a chord error of at most `CHORD_ERROR` of the radius. Instances place
the shapes of their group. Anything else is named as unsupported.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import drjit as dr
import mitsuba as mi
import numpy as np

CHORD_ERROR = 1e-3
"""Largest distance between a tessellated arc and its chord, in radii."""

Surface = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Points [n, 3] of parameters u and v [n]."""

SINGLE_PRECISION = 1e-5
"""Relative rounding of a transformed bounding box in single precision, with room."""

POLE_AREA = 1e-9
"""Area, in squared radii, below which a cell's triangle is the flat one at a pole."""

ARC_SEGMENTS = math.ceil(math.pi / math.acos(1.0 - CHORD_ERROR))
"""Chords of a full circle at that error (71)."""


@dataclass
class ShapeMesh:
    """One shape as triangles.

    Attributes
    ----------
    shape
        The Mitsuba shape whose BSDF the triangles have.
    name
        For messages.
    positions
        [vertex, 3] world space, float64.
    faces
        [triangle, 3] vertex indices, counter-clockwise seen from the front.
    uv
        [vertex, 2] texture coordinates.
    is_in_scene
        Whether ray hits name this shape and its faces (true for top-level meshes).
    live
        The positions with derivatives; None where they have none.
    """

    shape: mi.Shape
    name: str
    positions: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    is_in_scene: bool
    live: mi.Point3f | None = None


@dataclass
class ShapeList:
    """All shapes of a scene that became triangles, and the names of those that did not."""

    meshes: list[ShapeMesh] = field(default_factory=list)
    unsupported: list[str] = field(default_factory=list)


def list_shapes(scene: mi.Scene) -> ShapeList:
    """Return every shape of a scene as triangles in world space."""
    shapes = ShapeList()
    groups = _shape_groups(scene)
    for index, shape in enumerate(scene.shapes()):
        name = shape.id() or f"shape {index}"
        if shape.class_name() == "Instance":
            _add_instance(shapes, shape, name, groups)
            continue
        mesh = _mesh_from_shape(shape, name, is_in_scene=True)
        if mesh is None:
            shapes.unsupported.append(f"shape '{name}' ({shape.class_name()}): left out")
        else:
            shapes.meshes.append(mesh)
    return shapes


def _children(parent: mi.Object) -> list[mi.Shape]:
    """Shapes that a scene or a shape group holds, groups included."""
    shapes: list[mi.Shape] = []

    # The class exists only once a variant is set.
    class Collector(mi.TraversalCallback):
        def put(self, _name: str, value: object, *_: object) -> None:
            if isinstance(value, mi.Shape):
                shapes.append(value)

    parent.traverse(Collector())
    return shapes


def _shape_groups(scene: mi.Scene) -> list[mi.Shape]:
    """Return the shape groups, which `scene.shapes()` leaves out."""
    return [s for s in _children(scene) if s.class_name().startswith("ShapeGroup")]


def _add_instance(shapes: ShapeList, instance: mi.Shape, name: str, groups: list[mi.Shape]) -> None:
    """Append the meshes of an instance's group, moved to where the instance stands."""
    to_world = _matrix(mi.traverse(instance)["to_world"])
    # Mitsuba does not tell which group an instance shows, so its bounding box has to.
    shown = [group for group in groups if _is_box_of(instance, group, to_world)]
    if len(shown) != 1:
        shapes.unsupported.append(
            f"instance '{name}': {len(shown)} shape groups fit its bounding box: left out"
        )
        return
    for child in _children(shown[0]):
        child_name = f"{name}/{child.id()}"
        mesh = _mesh_from_shape(child, child_name, is_in_scene=False)
        if mesh is None:
            shapes.unsupported.append(f"shape '{child_name}' ({child.class_name()}): left out")
        else:
            shapes.meshes.append(_moved(mesh, to_world))


def _is_box_of(instance: mi.Shape, group: mi.Shape, to_world: np.ndarray) -> bool:
    """Whether the group's box, corner by corner to world space, has the instance's bounds."""
    low, high = _box(group)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    moved = (low + corners * (high - low)) @ to_world[:3, :3].T + to_world[:3, 3]
    expected_low, expected_high = _box(instance)
    slack = SINGLE_PRECISION * float(np.max(np.abs([expected_low, expected_high])))
    return bool(
        np.all(np.abs(moved.min(axis=0) - expected_low) <= slack)
        and np.all(np.abs(moved.max(axis=0) - expected_high) <= slack)
    )


def _box(shape: mi.Shape) -> tuple[np.ndarray, np.ndarray]:
    box = shape.bbox()
    low, high = (np.array(end, dtype=np.float64).ravel() for end in (box.min, box.max))
    return low, high


def _moved(mesh: ShapeMesh, to_world: np.ndarray) -> ShapeMesh:
    """Return `mesh` with its positions transformed; a mirroring turns the faces over."""
    positions = mesh.positions @ to_world[:3, :3].T + to_world[:3, 3]
    is_mirrored = np.linalg.det(to_world[:3, :3]) < 0.0
    faces = mesh.faces[:, ::-1] if is_mirrored else mesh.faces
    return ShapeMesh(mesh.shape, mesh.name, positions, faces, mesh.uv, is_in_scene=False)


def _mesh_from_shape(shape: mi.Shape, name: str, *, is_in_scene: bool) -> ShapeMesh | None:
    """One shape as triangles, or None if its kind is not supported."""
    if isinstance(shape, mi.Mesh):
        buffer = shape.vertex_positions_buffer()
        positions = np.array(dr.detach(buffer), dtype=np.float64).reshape(-1, 3)
        live = None
        if dr.grad_enabled(buffer):
            # A variable of its own: Dr.Jit 1.5 overwrites the derivatives that calls of shapes
            # brought to the buffer with those of gathers from it.
            live = dr.unravel(mi.Point3f, buffer * dr.opaque(mi.Float, 1.0))
        faces = np.array(shape.faces_buffer(), dtype=np.int64).reshape(-1, 3)
        uv = (
            np.array(shape.vertex_texcoords_buffer(), dtype=np.float64).reshape(-1, 2)
            if shape.has_vertex_texcoords()
            else np.zeros((len(positions), 2))
        )
        faces = _wound_as_shaded(shape, positions, faces)
        # Mitsuba keeps the winding of a mesh with flipped normals and turns the normals alone.
        if shape.has_flipped_normals():
            faces = faces[:, ::-1]
        return ShapeMesh(shape, name, positions, faces, uv, is_in_scene, live)
    if shape.class_name() not in ANALYTIC_SURFACES:
        return None
    return _tessellated(shape, name)


def _wound_as_shaded(shape: mi.Mesh, positions: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Turn over the faces whose winding contradicts the normals of their vertices.

    Mitsuba shades the side that vertex normals name, and a mirroring `to_world` turns the winding
    against them.
    """
    if not shape.has_vertex_normals():
        return faces
    normals = np.array(shape.vertex_normals_buffer(), dtype=np.float64).reshape(-1, 3)
    a, b, c = (positions[faces[:, corner]] for corner in range(3))
    facing = np.einsum("ij,ij->i", np.cross(b - a, c - a), normals[faces].sum(axis=1))
    return np.where((facing < 0.0)[:, None], faces[:, ::-1], faces)


def _sphere(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    sin_theta = np.sin(np.pi * v)
    return np.stack([_cos(u) * sin_theta, _sin(u) * sin_theta, np.cos(np.pi * v)], axis=1)


def _cylinder(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.stack([_cos(u), _sin(u), v], axis=1)


def _disk(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.stack([u * _cos(v), u * _sin(v), np.zeros_like(u)], axis=1)


def _cos(turns: np.ndarray) -> np.ndarray:
    cosine: np.ndarray = np.cos(2.0 * np.pi * turns)
    return cosine


def _sin(turns: np.ndarray) -> np.ndarray:
    sine: np.ndarray = np.sin(2.0 * np.pi * turns)
    return sine


ANALYTIC_SURFACES: dict[str, tuple[Surface, Surface, int, int]] = {
    # class: point and outward normal of (u, v) before `to_world`, segments along u and along v
    "Sphere": (_sphere, _sphere, ARC_SEGMENTS, ARC_SEGMENTS // 2 + 1),
    "Cylinder": (_cylinder, lambda u, v: _cylinder(u, 0.0 * v), ARC_SEGMENTS, 1),
    "Disk": (_disk, lambda u, v: np.tile([0.0, 0.0, 1.0], (len(u), 1)), 1, ARC_SEGMENTS),
}
"""Mitsuba's parametric shapes, as its documentation places them."""


def _tessellated(shape: mi.Shape, name: str) -> ShapeMesh:
    """Return a parametric shape on a grid of its own (u, v), each face turned as its normal."""
    surface, normal_of, count_u, count_v = ANALYTIC_SURFACES[shape.class_name()]
    u, v = np.meshgrid(np.linspace(0.0, 1.0, count_u + 1), np.linspace(0.0, 1.0, count_v + 1))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    to_world = _matrix(mi.traverse(shape)["to_world"])
    positions = surface(uv[:, 0], uv[:, 1])
    outward = normal_of(uv[:, 0], uv[:, 1])
    corner = np.arange(count_u)[None, :] + (count_u + 1) * np.arange(count_v)[:, None]
    right, up = 1, count_u + 1
    lower = np.stack([corner, corner + right, corner + right + up], axis=-1).reshape(-1, 3)
    upper = np.stack([corner, corner + right + up, corner + up], axis=-1).reshape(-1, 3)
    faces = np.concatenate([lower, upper])
    a, b, c = (positions[faces[:, i]] for i in range(3))
    facing = np.einsum("ij,ij->i", np.cross(b - a, c - a), outward[faces].mean(axis=1))
    if shape.has_flipped_normals():
        facing = -facing
    faces[facing < 0.0] = faces[facing < 0.0][:, ::-1]
    # The cells at a pole or at a disk's centre have one triangle without area.
    edges = positions[faces]
    area = np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1)
    faces = faces[area > POLE_AREA]
    # Mitsuba takes a cylinder's normal from its tangents in world space, so that a mirroring turns
    # it inwards; undone by turning the faces once more before `_moved` does.
    if shape.class_name() == "Cylinder" and np.linalg.det(to_world[:3, :3]) < 0.0:
        faces = faces[:, ::-1]
    moved = _moved(ShapeMesh(shape, name, positions, faces, uv, is_in_scene=False), to_world)
    live = mi.traverse(shape)["to_world"]
    if dr.grad_enabled(live):
        moved.live = live @ mi.Point3f(*(mi.Float(np.float32(each)) for each in positions.T))
    return moved


def _matrix(transform: mi.AffineTransform4f) -> np.ndarray:
    """Return the 4 x 4 matrix of a transform of one lane."""
    rows: np.ndarray = np.array(dr.detach(transform.matrix), dtype=np.float64).reshape(4, 4, -1)[
        ..., 0
    ]
    return rows
