"""The meshes of a loaded scene as NumPy arrays: the one place that knows Mitsuba's mesh layout."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import mitsuba as mi
import numpy as np
import numpy.typing as npt

_POSITIONS: Final = "vertex_positions"
_FACES: Final = "faces"
_GENERATED_NAME: Final = re.compile(r"(^|\.)object_\d+$")
"""Mitsuba calls an object without an id by its address."""


@dataclass(frozen=True, kw_only=True)
class MeshArrays:
    """Triangles of one mesh."""

    name: str
    """The shape's id, with the path of groups that it lies in."""
    positions: npt.NDArray[np.float32]
    """[vertex, 3], XYZ, world space (model space inside a shape group)."""
    faces: npt.NDArray[np.uint32]
    """[triangle, 3], indices of vertices."""


def meshes(scene: mi.Scene) -> Iterator[MeshArrays]:
    """Each mesh of a scene, those inside shape groups included.

    Goes through `mi.traverse`, which reaches the inside of shape groups, where `scene.shapes()`
    shows their instances only.
    """
    # SceneParameters iterates over pairs, so its keys must be asked for.
    parameters = mi.traverse(scene)
    for key in parameters.keys():  # type: ignore[no-untyped-call]  # noqa: SIM118
        path, _, last = key.rpartition(".")
        if last != _POSITIONS:
            continue
        yield MeshArrays(
            name="a mesh without an id" if _GENERATED_NAME.search(path) else path,
            positions=np.asarray(parameters[key], dtype=np.float32).reshape(-1, 3),
            faces=np.asarray(parameters[f"{path}.{_FACES}"], dtype=np.uint32).reshape(-1, 3),
        )


def triangle_count(scene: mi.Scene) -> int:
    """Triangles in all meshes; a shape group counts once, an analytic shape not at all."""
    return sum(len(mesh.faces) for mesh in meshes(scene))


def zero_area_count(mesh: MeshArrays) -> int:
    """Triangles whose area is exactly zero.

    Corners are float32, so that the products of their differences are exact in double precision
    and collinear corners give exactly zero.
    """
    corners = mesh.positions.astype(np.float64)[mesh.faces]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return int(np.count_nonzero(~np.cross(first, second).any(axis=1)))
