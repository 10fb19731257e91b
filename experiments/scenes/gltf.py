"""glTF scenes as Mitsuba objects: node transforms, triangles, materials, emission."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from experiments.errors import InputError
from experiments.scenes.gltf_file import GltfFile, broken, read_accessor, read_gltf
from experiments.scenes.gltf_materials import emission, surface

_SUPPORTED: Final = frozenset({"KHR_materials_emissive_strength", "KHR_mesh_quantization"})
_TRIANGLES, _STRIP, _FAN = 4, 5, 6

Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class GltfScene:
    """What a glTF file turns into."""

    objects: dict[str, Any]
    """`mi.Mesh` by name, ready for a scene dict."""
    has_light: bool
    """Whether any of them glows."""
    warnings: list[str]
    """What was not converted."""


@dataclass(kw_only=True)
class _Conversion:
    file: GltfFile
    dropped: set[str] = field(default_factory=set)
    bsdfs: dict[int | None, Any] = field(default_factory=dict)


def load_gltf(path: Path) -> GltfScene:
    """Convert the default scene of a glTF or GLB file.

    Raises
    ------
    InputError
        When the file is broken, a buffer or a texture is missing, or it needs an extension that is
        not supported.
    """
    file = read_gltf(path)
    required = set(file.tree.get("extensionsRequired", [])) - _SUPPORTED
    if required:
        raise InputError(
            what=f"the glTF file needs {', '.join(sorted(required))}",
            where=str(path),
            remedy="export it without that extension",
        )
    conversion = _Conversion(file=file)
    for name in set(file.tree.get("extensionsUsed", [])) - _SUPPORTED:
        conversion.dropped.add(f"glTF extension {name} ignored")
    for name in ("animations", "skins", "cameras"):
        if file.tree.get(name):
            conversion.dropped.add(f"glTF {name} ignored")
    objects: dict[str, Any] = {}
    has_light = False
    try:
        for node, world_from_node in _nodes(file.tree):
            if "mesh" not in node:
                continue
            mesh = file.tree["meshes"][node["mesh"]]
            for primitive in mesh["primitives"]:
                label = "".join(c if c.isalnum() else "_" for c in mesh.get("name", "mesh"))
                made = _convert(conversion, primitive, world_from_node, f"{label}_{len(objects)}")
                if made is not None:
                    objects[f"{label}_{len(objects)}"] = made
                    has_light = has_light or made.is_emitter()
    except (KeyError, IndexError, TypeError, ValueError, struct.error, RecursionError) as error:
        raise broken(path, f"{type(error).__name__}: {error}") from error
    return GltfScene(objects=objects, has_light=has_light, warnings=sorted(conversion.dropped))


def _nodes(tree: dict[str, Any]) -> Iterator[tuple[dict[str, Any], Matrix]]:
    """Each node of the default scene with its `world_from_node`."""
    scenes = tree.get("scenes", [])
    roots = scenes[tree.get("scene", 0)].get("nodes", []) if scenes else []

    def visit(index: int, parent: Matrix) -> Iterator[tuple[dict[str, Any], Matrix]]:
        node = tree["nodes"][index]
        placed = parent @ _parent_from_node(node)
        yield node, placed
        for child in node.get("children", []):
            yield from visit(child, placed)

    for root in roots:
        yield from visit(root, np.eye(4))


def _parent_from_node(node: dict[str, Any]) -> Matrix:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T  # column-major
    x, y, z, w = node.get("rotation", [0.0, 0.0, 0.0, 1.0])
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    placed = np.eye(4)
    placed[:3, :3] = rotation * np.array(node.get("scale", [1.0, 1.0, 1.0]))
    placed[:3, 3] = node.get("translation", [0.0, 0.0, 0.0])
    return placed


def _convert(
    conversion: _Conversion, primitive: dict[str, Any], world_from_node: Matrix, name: str
) -> Any:
    """Convert a primitive to `mi.Mesh`, or None where it has no triangles."""
    attributes = primitive["attributes"]
    if "targets" in primitive:
        conversion.dropped.add("glTF morph targets ignored")
    if "COLOR_0" in attributes:
        conversion.dropped.add("glTF vertex colours ignored")
    mode = primitive.get("mode", _TRIANGLES)
    if mode not in (_TRIANGLES, _STRIP, _FAN):
        conversion.dropped.add("glTF points and lines ignored")
        return None
    file, linear = conversion.file, world_from_node[:3, :3]
    positions = _vectors(file, attributes["POSITION"])
    count = len(positions)
    order = (
        read_accessor(file, primitive["indices"])[:, 0].astype(np.int64)
        if "indices" in primitive
        else np.arange(count)
    )
    faces = _faces(order, mode)
    if faces.size and faces.max() >= count:
        raise ValueError("an index points past the vertices")
    if np.linalg.det(linear) < 0:
        faces = faces[:, ::-1]
    normals = coordinates = None
    if "NORMAL" in attributes:
        normals = _vectors(file, attributes["NORMAL"]) @ np.linalg.inv(linear)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    if "TEXCOORD_0" in attributes:
        coordinates = _vectors(file, attributes["TEXCOORD_0"])
    mesh = mi.Mesh(
        name,
        count,
        len(faces),
        _properties(conversion, primitive.get("material")),
        has_vertex_normals=normals is not None,
        has_vertex_texcoords=coordinates is not None,
    )
    parameters = mi.traverse(mesh)
    parameters["faces"] = mi.UInt32(faces.astype(np.uint32).ravel())
    world = positions @ linear.T + world_from_node[:3, 3]
    for key, values in (
        ("vertex_positions", world),
        ("vertex_normals", normals),
        ("vertex_texcoords", coordinates),
    ):
        if values is not None:
            parameters[key] = mi.Float(values.astype(np.float32).ravel())
    parameters.update()
    return mesh


def _vectors(file: GltfFile, index: int) -> Matrix:
    """Read an accessor in double precision, [vertex, width]."""
    return np.asarray(read_accessor(file, index), dtype=np.float64)


def _faces(order: npt.NDArray[np.int64], mode: int) -> npt.NDArray[np.int64]:
    """Vertex indices of triangles, [triangle, 3], from a list, strip or fan."""
    if mode == _TRIANGLES:
        return order.reshape(-1, 3)
    first = np.arange(max(len(order) - 2, 0))
    if mode == _FAN:
        return np.stack([order[first + 1], order[first + 2], order[first * 0]], axis=1)
    odd = first % 2  # every other triangle of a strip is wound the other way
    return np.stack([order[first], order[first + 1 + odd], order[first + 2 - odd]], axis=1)


def _properties(conversion: _Conversion, index: int | None) -> Any:
    """Surface (shared by all primitives of a material) and emission (one a mesh)."""
    file = conversion.file
    material = {} if index is None else file.tree["materials"][index]
    if index not in conversion.bsdfs:
        conversion.bsdfs[index] = mi.load_dict(surface(file, material, conversion.dropped))
    properties = mi.Properties()
    properties["surface"] = conversion.bsdfs[index]
    emitter = emission(file, material, conversion.dropped)
    if emitter is not None:
        properties["emission"] = mi.load_dict(emitter)
    return properties
