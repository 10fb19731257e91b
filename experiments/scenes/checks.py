"""What a scene must have before it is worth rendering; each fault is one line."""

from __future__ import annotations

from typing import Any, Final

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.errors import InputError
from experiments.scenes.mesh_access import meshes, zero_area_count

_PROBE_WIDTH: Final = 32
"""The camera is probed with 32 x 32 primary rays."""
_TOUCHING: Final = 1e-3
"""Distance over the scene's extent below which a camera counts as stuck in a surface."""
_LIGHT_DEPTH: Final = 8
"""Path length that is tried before a place counts as dark."""
_LIGHT_REPEATS: Final = 16
"""Paths per primary ray that are tried before a place counts as dark."""


def check_scene(
    scene: mi.Scene, sensor_index: int, where: str, *, needs_light: bool = True
) -> list[str]:
    """Refuse a scene that no picture can be made of.

    Parameters
    ----------
    scene
        A loaded scene.
    sensor_index
        The camera that will be used, from 0.
    where
        The scene's file or name, for the messages.
    needs_light
        Whether a scene without light is of no use.

    Returns
    -------
    list of str
        Warnings: faults that the renderer can live with.

    Raises
    ------
    InputError
        No such camera, no light, no geometry, vertices that are NaN or infinite, or a camera inside
        a wall.
    """
    _require_camera(scene, sensor_index, where)
    if needs_light and not scene.emitters():
        raise InputError(
            what="the scene has no light",
            where=where,
            remedy="add an emitter, for example <emitter type='constant'/>",
        )
    warnings = _check_geometry(scene, where)
    if scene.emitters():
        _require_free_camera(scene, scene.sensors()[sensor_index], where)
    return warnings


def _require_camera(scene: mi.Scene, sensor_index: int, where: str) -> None:
    count = len(scene.sensors())
    if count == 0:
        raise InputError(
            what="the scene has no camera",
            where=where,
            remedy="add a sensor, for example <sensor type='perspective'>",
        )
    if not 0 <= sensor_index < count:
        raise InputError(
            what=f"there is no camera {sensor_index}, the scene has {count}",
            where=where,
            remedy=f"choose a camera from 0 to {count - 1}",
        )


def _check_geometry(scene: mi.Scene, where: str) -> list[str]:
    """Finite and not empty; returns a warning for each mesh with triangles of no area."""
    warnings: list[str] = []
    sound_count = 0
    for mesh in meshes(scene):
        bad_count = int(np.count_nonzero(~np.isfinite(mesh.positions).all(axis=1)))
        if bad_count:
            raise InputError(
                what=f"{bad_count} vertices of the shape {mesh.name} are NaN or infinite",
                where=where,
                remedy="export the mesh again or remove those vertices",
            )
        stray_count = int(np.count_nonzero(mesh.faces >= len(mesh.positions)))
        if stray_count:
            raise InputError(
                what=f"{stray_count} face corners of the shape {mesh.name} name no vertex",
                where=where,
                remedy="export the mesh again",
            )
        flat_count = zero_area_count(mesh)
        sound_count += len(mesh.faces) - flat_count
        if flat_count:
            warnings.append(f"{flat_count} zero-area triangles in {mesh.name} skipped")
    for shape in scene.shapes():
        if shape.is_mesh():
            continue
        box = shape.bbox()
        if not (box.valid() and np.isfinite([*box.min, *box.max]).all()):
            raise InputError(
                what=f"the shape {shape.id() or shape.class_name()} has no finite extent",
                where=where,
                remedy="give it a finite size and position",
            )
        sound_count += 1
    if sound_count == 0:
        raise InputError(
            what="the scene has no geometry (no shape with an area)",
            where=where,
            remedy="add a shape",
        )
    return warnings


def _require_free_camera(scene: mi.Scene, sensor: mi.Sensor, where: str) -> None:
    """Refuse a camera that sees nothing but the inside of something that light does not reach.

    Seeing back faces alone proves nothing: many good scenes have walls whose normals point
    outwards or anywhere, under a two-sided BSDF. Such a scene is told apart by the light that
    arrives.
    """
    index = dr.arange(mi.UInt32, _PROBE_WIDTH**2)
    film_position = (mi.Point2f(index % _PROBE_WIDTH, index // _PROBE_WIDTH) + 0.5) / _PROBE_WIDTH
    time: Any = dr.zeros(mi.Float)
    wavelength_sample: Any = dr.full(mi.Float, 0.5)
    ray, _ = sensor.sample_ray_differential(time, wavelength_sample, film_position, mi.Point2f(0.5))
    hit = scene.ray_intersect(ray)
    if not dr.all(hit.is_valid() & (dr.dot(mi.Vector3f(hit.n), ray.d) > 0)):
        return
    shapes: Any = hit.shape
    is_one_shape = len({shape.ptr for shape in shapes}) == 1
    reach = _TOUCHING * float(dr.max(scene.bbox().extents()))
    is_stuck = is_one_shape and dr.all(hit.t < reach)
    if is_stuck or not _light_arrives(scene, ray):
        name = shapes[0].id() or "a shape without an id"
        raise InputError(
            what=f"the camera is inside a wall (every view ray meets the back of {name})",
            where=where,
            remedy="move the camera into the open, or turn the surface's normals towards it",
        )


def _light_arrives(scene: mi.Scene, ray: mi.RayDifferential3f) -> bool:
    """Whether a few path-traced samples along primary rays find any light at all."""
    integrator = mi.load_dict({"type": "path", "max_depth": _LIGHT_DEPTH})
    sampler = mi.load_dict({"type": "independent"})
    count = dr.width(ray.d)
    for repeat in range(_LIGHT_REPEATS):
        sampler.seed(repeat, count)
        radiance, _, _ = integrator.sample(scene, sampler, ray)
        if dr.any(dr.max(radiance) > 0):
            return True
    return False
