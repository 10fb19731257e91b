"""Every kind of BSDF that Mitsuba 3.9.1 builds from a dictionary, with what it needs."""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from tests.vctgi.small_scenes import SceneDict, color, diffuse, grey


def _bitmap(values: np.ndarray) -> SceneDict:
    pixels = mi.Bitmap(np.ascontiguousarray(values, dtype=np.float32))
    return {"type": "bitmap", "bitmap": pixels, "raw": True}


def _straight_normals() -> SceneDict:
    return _bitmap(np.full((2, 2, 3), [0.5, 0.5, 1.0]))


def opaque() -> dict[str, SceneDict]:
    """Kinds that reflect or block."""
    coat: SceneDict = {"type": "roughplastic", "diffuse_reflectance": color(0.6, 0.3, 0.1)}
    return {
        "diffuse": {"type": "diffuse", "reflectance": color(0.7, 0.4, 0.1)},
        "plastic": {"type": "plastic", "diffuse_reflectance": color(0.6, 0.3, 0.1)},
        "roughplastic": {**coat, "alpha": 0.2},
        "conductor": {"type": "conductor", "material": "Au"},
        "roughconductor": {"type": "roughconductor", "material": "Cu", "alpha": 0.3},
        "principled": {
            "type": "principled",
            "base_color": color(0.8, 0.5, 0.2),
            "roughness": 0.5,
            "metallic": 0.3,
            "clearcoat": 0.5,
        },
        "pplastic": {"type": "pplastic", "diffuse_reflectance": grey(0.4), "alpha": 0.2},
        "blendbsdf": {"type": "blendbsdf", "weight": 0.25, "a": diffuse(0.8), "b": diffuse(0.2)},
        "bumpmap": {
            "type": "bumpmap",
            "texture": _bitmap(np.full((2, 2, 1), 0.5)),
            "nested": diffuse(0.6),
        },
        "normalmap": {
            "type": "normalmap",
            "normalmap": _straight_normals(),
            "nested": diffuse(0.6),
        },
        "twosided": {"type": "twosided", "bsdf": {**coat, "alpha": 0.2}},
        "mask": {"type": "mask", "opacity": 0.3, "nested": diffuse(0.8)},
    }


def transmitting() -> dict[str, SceneDict]:
    """Kinds that let light through as well."""
    return {
        "dielectric": {"type": "dielectric", "int_ior": 1.5},
        "roughdielectric": {"type": "roughdielectric", "alpha": 0.3, "int_ior": 1.5},
        "thindielectric": {"type": "thindielectric", "int_ior": 1.5},
        "principledthin": {
            "type": "principledthin",
            "base_color": color(0.8, 0.5, 0.2),
            "roughness": 0.5,
            "spec_trans": 0.4,
            "diff_trans": 0.6,
        },
        "null": {"type": "null"},
        "hair": {"type": "hair"},
    }


def all_kinds() -> dict[str, SceneDict]:
    return opaque() | transmitting()


NAMES = [
    *("diffuse", "plastic", "roughplastic", "conductor", "roughconductor", "principled"),
    *("pplastic", "blendbsdf", "bumpmap", "normalmap", "twosided", "mask"),
    *("dielectric", "roughdielectric", "thindielectric", "principledthin", "null", "hair"),
]
"""Kinds by plugin name. Left out: `measured` and `measured_polarized` need files, `circular`,
`polarizer` and `retarder` a polarised variant."""
