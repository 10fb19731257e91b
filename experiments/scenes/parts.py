"""Pieces that the built-in scenes are put together from: solids, rooms, panels, cameras.

Y is up, lengths are metres, radiances W m^-2 sr^-1. Walls are closed boxes with outward normals, so
that a surface is met from its front side only and a wall has the thickness that it is drawn with.
"""

from __future__ import annotations

from typing import Any, Final

import mitsuba as mi

SceneDict = dict[str, Any]
"""A scene or an object in the form that `mi.load_dict` takes."""

Vector = tuple[float, float, float]
"""A point, direction or RGB triple."""

UP: Final[Vector] = (0.0, 1.0, 0.0)
FILM_SIZE_PX: Final = 256
SAMPLE_COUNT: Final = 64


def add(a: Vector, b: Vector) -> Vector:
    """Sum of two triples."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def diffuse(red: float, green: float, blue: float) -> SceneDict:
    """One-sided diffuse surface of the given albedo, each in [0, 1]."""
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": [red, green, blue]}}


def area_light(red: float, green: float, blue: float) -> SceneDict:
    """Area emitter of the given radiance, W m^-2 sr^-1."""
    return {"type": "area", "radiance": {"type": "rgb", "value": [red, green, blue]}}


def solid_box(
    low: Vector, high: Vector, bsdf: SceneDict, *, world_from_model: Any = None
) -> SceneDict:
    """Return a closed box with outward normals between two opposite corners.

    Parameters
    ----------
    low, high
        Corners, model space; `low` is below `high` on each axis.
    bsdf
        Surface of all six faces; each face has UV coordinates of its own in [0, 1]^2.
    world_from_model
        `mi.ScalarTransform4f` applied last; identity when left out.

    Raises
    ------
    ValueError
        When the box has no volume.
    """
    if not all(a < b for a, b in zip(low, high, strict=True)):
        raise ValueError(f"solid_box: low must be below high on each axis, got {low} and {high}.")
    centre = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
    half = [(b - a) / 2 for a, b in zip(low, high, strict=True)]
    placed = mi.ScalarTransform4f().translate(centre).scale(half)
    if world_from_model is not None:
        placed = world_from_model @ placed
    return {"type": "cube", "to_world": placed, "bsdf": bsdf}


def ceiling_light(
    centre: Vector, size: tuple[float, float], radiance: Vector, *, world_from_model: Any = None
) -> SceneDict:
    """Rectangular area light that faces down.

    Parameters
    ----------
    centre
        Middle of the panel, model space, just below the ceiling.
    size
        Edge lengths along X and Z.
    radiance
        W m^-2 sr^-1, RGB; the panel itself reflects nothing.
    world_from_model
        As in `solid_box`.
    """
    placed = (
        mi.ScalarTransform4f()
        .translate(centre)
        .rotate([1, 0, 0], 90)
        .scale([size[0] / 2, size[1] / 2, 1])
    )
    if world_from_model is not None:
        placed = world_from_model @ placed
    return {
        "type": "rectangle",
        "to_world": placed,
        "bsdf": diffuse(0.0, 0.0, 0.0),
        "emitter": area_light(*radiance),
    }


def room(
    low: Vector,
    high: Vector,
    thickness: float,
    surfaces: dict[str, SceneDict],
    *,
    world_from_model: Any = None,
) -> SceneDict:
    """Six slabs around a box of air, named floor, ceiling, west, east, back and front.

    The slabs overlap in the edges of the room: slabs that only touched would leave slits of
    rounding size, through which a ray in a million escapes.

    Parameters
    ----------
    low, high
        Corners of the air, model space. West is -X, back is -Z.
    thickness
        Of each slab, > 0.
    surfaces
        BSDF of each slab by its name; `default` stands for those not named.
    world_from_model
        As in `solid_box`.

    Returns
    -------
    SceneDict
        Objects by name, to be merged into a scene.
    """
    (x0, y0, z0), (x1, y1, z1) = low, high
    t, half = thickness, thickness / 2
    slabs: dict[str, tuple[Vector, Vector]] = {
        "floor": ((x0 - t, y0 - t, z0 - t), (x1 + t, y0, z1 + t)),
        "ceiling": ((x0 - t, y1, z0 - t), (x1 + t, y1 + t, z1 + t)),
        "west": ((x0 - t, y0 - half, z0 - t), (x0, y1 + half, z1 + t)),
        "east": ((x1, y0 - half, z0 - t), (x1 + t, y1 + half, z1 + t)),
        "back": ((x0 - half, y0 - half, z0 - t), (x1 + half, y1 + half, z0)),
        "front": ((x0 - half, y0 - half, z1), (x1 + half, y1 + half, z1 + t)),
    }
    return {
        name: solid_box(
            *corners,
            surfaces.get(name, surfaces["default"]),
            world_from_model=world_from_model,
        )
        for name, corners in slabs.items()
    }


def perspective(
    origin: Vector,
    target: Vector,
    fov_deg: float,
    *,
    near_clip: float = 0.01,
    far_clip: float = 1000.0,
    world_from_model: Any = None,
) -> SceneDict:
    """Square pinhole camera with a box filter and independent samples.

    Parameters
    ----------
    origin, target
        Eye and a point in the middle of the picture, model space.
    fov_deg
        Field of view over the smaller edge of the film, degrees (Mitsuba's convention).
    near_clip, far_clip
        Where primary rays start and end, along the axis. They cut primary rays only: what lies
        before the near plane still throws its shadow.
    world_from_model
        As in `solid_box`.
    """
    placed = mi.ScalarTransform4f().look_at(origin=origin, target=target, up=UP)
    if world_from_model is not None:
        placed = world_from_model @ placed
    return {
        "type": "perspective",
        "fov": fov_deg,
        "fov_axis": "smaller",
        "near_clip": near_clip,
        "far_clip": far_clip,
        "to_world": placed,
        "sampler": {"type": "independent", "sample_count": SAMPLE_COUNT},
        "film": {
            "type": "hdrfilm",
            "width": FILM_SIZE_PX,
            "height": FILM_SIZE_PX,
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": {"type": "box"},
        },
    }


def empty_scene() -> SceneDict:
    """Scene with nothing in it but a path tracer without a bounce limit."""
    return {"type": "scene", "integrator": {"type": "path"}}
