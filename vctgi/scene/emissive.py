"""Surfaces that shine by themselves: the triangles of Mitsuba's area lights."""

from __future__ import annotations

from dataclasses import dataclass

import mitsuba as mi
import numpy as np

from vctgi.scene.lights import emitter_kind
from vctgi.scene.registry import registry_number
from vctgi.scene.shapes import list_shapes
from vctgi.scene.surfaces import VoxelSurfaces, opaque_surfaces
from vctgi.scene.triangles import is_degenerate


@dataclass
class EmissiveSurfaces:
    """Triangles that emit on their front.

    Attributes
    ----------
    surfaces
        The triangles, counter-clockwise seen from the side that shines.
    emitter_number
        [triangle] the area light of each, as a number of Dr.Jit's registry.
    emitters
        The area lights, which live as long as their numbers are used.
    """

    surfaces: VoxelSurfaces
    emitter_number: np.ndarray
    emitters: list[mi.Emitter]


def list_emissive_surfaces(scene: mi.Scene) -> EmissiveSurfaces:
    """Return the triangles of all area lights of a scene; there may be none."""
    vertices, uv, owner = [np.zeros((0, 3, 3))], [np.zeros((0, 3, 2))], []
    emitters: list[mi.Emitter] = []
    for mesh in list_shapes(scene).meshes:
        emitter = mesh.shape.emitter()
        if emitter is None or emitter_kind(emitter) != "AreaLight":
            continue
        corners = mesh.positions[mesh.faces]
        is_kept = ~is_degenerate(corners)
        vertices.append(corners[is_kept])
        uv.append(mesh.uv[mesh.faces][is_kept])
        owner.append(np.full(int(is_kept.sum()), len(emitters)))
        emitters.append(emitter)
    surfaces = opaque_surfaces(np.concatenate(vertices))
    surfaces.uv = np.concatenate(uv)
    which = np.concatenate(owner) if owner else np.zeros(0, dtype=np.int64)
    surfaces.shape_index = which
    numbers = [registry_number(mi.EmitterPtr(each)) for each in emitters]
    return EmissiveSurfaces(surfaces, np.array(numbers, dtype=np.uint32)[which], emitters)
