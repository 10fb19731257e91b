"""Small scenes for the tests of the reference, as Mitsuba dictionaries."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

SIZE = 32


def film(width: int = SIZE, height: int = SIZE, **crop: int) -> dict[str, Any]:
    return {
        "type": "hdrfilm",
        "width": width,
        "height": height,
        "rfilter": {"type": "box"},
        "component_format": "float32",
        **crop,
    }


def camera(
    origin: list[float], target: list[float], fov: float = 45.0, **more: Any
) -> dict[str, Any]:
    return {
        "type": "perspective",
        "fov": fov,
        "to_world": mi.ScalarTransform4f().look_at(origin, target, [0, 1, 0.01]),
        "film": film(),
        **more,
    }


def grey(value: float) -> dict[str, Any]:
    return {"type": "rgb", "value": value}


def diffuse(value: float = 0.6) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": grey(value)}


def rectangle(
    place: list[float], angle: float = -90.0, size: float = 1.0, **more: Any
) -> dict[str, Any]:
    """Place a square of half-edge `size`, turned about x; -90 degrees faces up."""
    to_world = mi.ScalarTransform4f().translate(place).rotate([1, 0, 0], angle).scale(size)
    return {"type": "rectangle", "to_world": to_world, **more}


def sphere(centre: list[float], radius: float, **more: Any) -> dict[str, Any]:
    return {"type": "sphere", "center": centre, "radius": radius, **more}


def area_light(value: float) -> dict[str, Any]:
    return {"type": "area", "radiance": grey(value)}


def cornell() -> dict[str, Any]:
    scene: dict[str, Any] = mi.cornell_box()  # type: ignore[no-untyped-call]
    scene["sensor"]["film"] = film()
    return scene


def mixed_materials() -> dict[str, Any]:
    """Glossy, delta, masked and two-sided surfaces under an area light; thin lens, crop window."""
    lens = camera([0, 1.2, 4], [0, 0.5, 0]) | {
        "type": "thinlens",
        "aperture_radius": 0.05,
        "focus_distance": 4.0,
        "film": film(40, 36, crop_width=32, crop_height=28, crop_offset_x=5, crop_offset_y=7),
    }
    return {
        "type": "scene",
        "sensor": lens,
        "floor": rectangle(
            [0, 0, 0],
            size=3.0,
            bsdf={"type": "roughplastic", "alpha": 0.2, "diffuse_reflectance": grey(0.5)},
        ),
        "wall": rectangle([0, 1, -1.5], 0.0, 3.0, bsdf={"type": "twosided", "inner": diffuse(0.7)}),
        "metal": sphere([-0.9, 0.5, 0], 0.5, bsdf={"type": "roughconductor", "alpha": 0.3}),
        "glass": sphere([0.9, 0.5, 0], 0.5, bsdf={"type": "dielectric"}),
        "veil": rectangle(
            [0, 0.6, 0.8],
            0.0,
            0.4,
            bsdf={
                "type": "mask",
                "opacity": 0.5,
                "inner": {"type": "twosided", "inner": {"type": "plastic"}},
            },
        ),
        "light": rectangle([0, 3, 0.5], 90.0, 1.5, emitter=area_light(4.0)),
    }


def under_a_sky() -> dict[str, Any]:
    """Put a principled surface and an instance of a glossy group under an environment map."""
    random = np.random.Generator(np.random.PCG64(3))
    sky = (0.5 + random.random((8, 16, 3))).astype(np.float32)
    return {
        "type": "scene",
        "sensor": camera([0, 1.5, 4], [0, 0.4, 0]),
        "sky": {"type": "envmap", "bitmap": mi.Bitmap(sky)},
        "floor": rectangle([0, 0, 0], size=3.0, bsdf=diffuse(0.5)),
        "block": {
            "type": "cube",
            "to_world": mi.ScalarTransform4f().translate([-0.8, 0.4, 0]).scale(0.4),
            "bsdf": {"type": "principled", "base_color": grey(0.6), "roughness": 0.4},
        },
        "group": {
            "type": "shapegroup",
            "ball": sphere(
                [0, 0, 0],
                0.5,
                bsdf={
                    "type": "blendbsdf",
                    "weight": 0.4,
                    "a": diffuse(0.7),
                    "b": {"type": "roughconductor", "alpha": 0.25},
                },
            ),
        },
        "ball": {
            "type": "instance",
            "to_world": mi.ScalarTransform4f().translate([0.8, 0.5, 0]),
            "group": {"type": "ref", "id": "group"},
        },
    }


def floor_under_test(bsdf: dict[str, Any]) -> dict[str, Any]:
    """Let a camera see nothing but the floor, which receives light from a wall.

    The floor is flat, so it is never the second surface of a path that starts on it.
    """
    return {
        "type": "scene",
        "sensor": camera([0, 1, 0.5], [0, 0, 0], 30.0, film=film(16, 16)),
        "floor": rectangle([0, 0, 0], size=2.0, bsdf=bsdf),
        "wall": rectangle([0, 1, -0.9], 0.0, 2.0, bsdf=diffuse(0.8)),
        "light": rectangle([0, 2, 1.5], 120.0, 0.7, emitter=area_light(8.0)),
    }


def textured(
    albedo: float = 0.4, texel: float = 0.3, height: float = 0.0, *, width: int = 8
) -> dict[str, Any]:
    """Few pixels, one texture, one mesh: quick to render and to hash."""
    texels = np.full((4, 4, 3), 0.5, np.float32)
    texels[1, 2] = texel
    return {
        "type": "scene",
        "sensor": camera([0, 1.5, 3], [0, 0.3, 0], film=film(width, 8)),
        "floor": rectangle(
            [0, 0, 0],
            size=2.0,
            bsdf={
                "type": "diffuse",
                "reflectance": {"type": "bitmap", "bitmap": mi.Bitmap(texels), "raw": True},
            },
        ),
        "block": {
            "type": "cube",
            "to_world": mi.ScalarTransform4f().translate([0, 0.3 + height, 0]).scale(0.3),
            "bsdf": diffuse(albedo),
        },
        "light": rectangle([0, 2, 0], 90.0, emitter=area_light(3.0)),
    }
