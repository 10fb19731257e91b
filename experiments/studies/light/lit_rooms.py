"""Scenes and lit points for the study of injection, and what injection makes of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.studies.exact_voxels import surfaces_in
from experiments.studies.scenes import oblique_matrix
from vctgi.clipmap.addressing import texel_from_voxel
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.slots import filled_layers, surface_slot
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap, VoxelVolume, pack_volume
from vctgi.scene.lights import list_lights
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.stages.downsampling import downsample
from vctgi.stages.light_injection import LightInjectionConfig, inject_light
from vctgi.stages.outgoing_radiance import with_radiance
from vctgi.stages.reflective_shadow_map import (
    ReflectiveShadowMapConfig,
    render_reflective_shadow_maps,
)
from vctgi.stages.voxelization.opacity import voxelize_opacity

INWARD_TURNS = [
    ([0, 1, 0], 0.0),
    ([0, 1, 0], 90.0),
    ([0, 1, 0], 180.0),
    ([0, 1, 0], 270.0),
    ([1, 0, 0], 90.0),
    ([1, 0, 0], -90.0),
]
"""Turns that take the wall at z = -1, facing +z, to the six walls of a room."""

ALBEDO, EMISSION = 0.5, 2.0


@dataclass
class LitPoints:
    """A scene as voxels, and where its light lands."""

    scene: mi.Scene
    opacity: OpacityClipmap
    maps: list[ReflectiveShadowMap]

    def volume(self, config: LightInjectionConfig) -> VoxelVolume:
        """Return voxels that are lit as `config` says."""
        opacity, lit = downsample(self.opacity, self.inject(config))
        assert lit is not None, "downsampling keeps the emittance it is given"
        return pack_volume(opacity, lit)

    def inject(self, config: LightInjectionConfig) -> EmittanceClipmap:
        """Return the emittance of each level's own lit points."""
        return inject_light(self.maps, self.opacity, config)


def light_points(
    scene: mi.Scene, layout: ClipmapLayout, texels_per_voxel: float | None = None
) -> LitPoints:
    """Voxelize a scene and trace its light, with the radiance of every lit point."""
    opacity = voxelize_opacity(surfaces_in(scene), layout)
    config = ReflectiveShadowMapConfig()
    if texels_per_voxel is not None:
        config = ReflectiveShadowMapConfig(texels_per_voxel=texels_per_voxel)
    maps = render_reflective_shadow_maps(scene, list_lights(scene), layout, config)
    return LitPoints(scene, opacity, with_radiance(scene, maps))


def placement(offset: np.ndarray, *, is_turned: bool) -> Any:
    """Return the transform that turns a scene, if asked, and then moves it."""
    matrix = np.eye(4)
    if is_turned:
        matrix[:3, :3] = oblique_matrix()
    matrix[:3, 3] = offset
    return mi.ScalarTransform4f(matrix.astype(np.float32))


def room(outer: Any, **more: Any) -> dict[str, Any]:
    """Six diffuse walls that face inwards, of the cube from -1 to 1."""
    grey = {"type": "rgb", "value": ALBEDO}
    eye = mi.ScalarTransform4f().look_at([0.6, 0.5, 0.7], [0.0, 0.0, 0.0], [0, 1, 0])
    camera = {"type": "perspective", "fov": 90.0, "to_world": outer @ eye}
    walls: dict[str, Any] = {"type": "scene", "sensor": camera}
    for index, (axis, degrees) in enumerate(INWARD_TURNS):
        turn = mi.ScalarTransform4f().rotate(axis, degrees).translate([0, 0, -1])
        bsdf = {"type": "diffuse", "reflectance": grey}
        wall = {"type": "rectangle", "to_world": outer @ turn, "bsdf": bsdf}
        walls[f"wall{index}"] = {**wall, **more}
    return walls


def shining_room(outer: Any) -> mi.Scene:
    """Return the white furnace: every wall shines alike."""
    radiance = {"type": "rgb", "value": EMISSION}
    scene: mi.Scene = mi.load_dict(room(outer, emitter={"type": "area", "radiance": radiance}))
    return scene


def bulb_room(outer: Any) -> mi.Scene:
    """Return a room with a bulb off its middle."""
    bulb = {
        "type": "point",
        "to_world": outer @ mi.ScalarTransform4f().translate([0.2, 0.1, -0.3]),
        "intensity": {"type": "rgb", "value": 3.0},
    }
    scene: mi.Scene = mi.load_dict({**room(outer), "bulb": bulb})
    return scene


def small_cube(outer: Any, edge: float) -> mi.Scene:
    """Return a lit cube, turned obliquely, far from anything else."""
    to_world = (
        outer @ placement(np.zeros(3), is_turned=True) @ mi.ScalarTransform4f().scale(0.5 * edge)
    )
    scene: mi.Scene = mi.load_dict(
        {
            "type": "scene",
            "sensor": {"type": "perspective"},
            "cube": {"type": "cube", "to_world": to_world},
            "bulb": {
                "type": "spot",
                "to_world": outer
                @ mi.ScalarTransform4f().look_at([1.0, 1.2, 0.9], [0.0, 0.0, 0.0], [0, 1, 0]),
                "cutoff_angle": 15.0,
            },
        }
    )
    return scene


def nested_layout(voxel_size: float, level_count: int) -> ClipmapLayout:
    """Return levels of 32^3 voxels around the origin."""
    return lay_out_clipmap(
        (0.0, 0.0, 0.0), finest_voxel_size=voxel_size, level_count=level_count, resolution=32
    )


def power(lit: EmittanceClipmap, level: int) -> float:
    """Radiance times projected area over all slots of a level, green, W sr^-1."""
    size = lit.layout.levels[level].voxel_size
    return float(np.array(lit.levels[level], dtype=np.float64)[1].sum() * size**2)


def slot_power(points: LitPoints, prefilter: int, level: int = 0) -> float:
    """Power that the slots of a level should hold, W sr^-1: flux / pi of texels that find opacity.

    Without a pre-filter a texel must find it in its own slot, with one anywhere near.
    """
    opacity, total = points.opacity, 0.0
    window = opacity.layout.levels[level]
    alpha = np.array(opacity.levels[level])
    for each in points.maps:
        flux = np.array(each.reflected_flux, dtype=np.float64)[1] / np.pi
        place = each.position / window.voxel_size
        for axis in range(3):
            slot = surface_slot(mi.Float(each.normal[axis]), opacity.rule)
            voxel = mi.Vector3i(dr.floor(place))
            facing = np.abs(np.array(each.normal[axis], dtype=np.float64))
            for layer, is_filled in filled_layers(mi.Float(place[axis]), slot):
                voxel[axis] = layer
                texel = texel_from_voxel(voxel, window.resolution)
                index = np.array(texel + (2 * axis + slot.side) * window.voxel_count)
                is_found = np.array(is_filled) & ((alpha[index] > 0.0) | (prefilter > 1))
                total += float(flux @ (facing * is_found))
    return total


def lamp(outer: Any, edge: float) -> mi.Scene:
    """Return a square lamp."""
    emitter = {"type": "area", "radiance": {"type": "rgb", "value": EMISSION}}
    to_world = outer @ mi.ScalarTransform4f().scale(0.5 * edge)
    shape = {"type": "rectangle", "to_world": to_world, "emitter": emitter}
    scene: mi.Scene = mi.load_dict({"type": "scene", "lamp": shape})
    return scene
