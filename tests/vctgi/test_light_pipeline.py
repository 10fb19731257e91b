"""Light of all levels at once equals that of one after the other, and kept light new light."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import vctgi
from tests.vctgi.hand_made_volumes import stored_numbers
from tests.vctgi.small_scenes import area_light, camera, color, diffuse, grey, load, oblique, room
from vctgi.clipmap.levels import move_clipmap
from vctgi.clipmap.storage import StorageConfig
from vctgi.config import RenderConfig
from vctgi.errors import SceneError
from vctgi.pipeline import (
    LitVolume,
    PreparedScene,
    SceneVoxels,
    light_volume,
    prepare_scene,
    update_voxels,
    voxelize_scene,
)
from vctgi.stages.light_injection import inject_all_levels, inject_light
from vctgi.stages.reflective_shadow_map import (
    KeptLight,
    render_reflective_shadow_maps,
    trace_all_levels,
)

pytestmark = pytest.mark.usefixtures("variant")

FIXED_POINT = 2.0**-50
"""Steps of sums over the largest emittance, with room for the sum being larger than any slot."""

SINGLE_PRECISION_SUM = 1e-4
"""Relative rounding of the sum of all texels in single precision, which one of two makes."""

LAUNCHES = 60
"""Most that lighting voxels may take, for two lights from outside."""


def settings() -> RenderConfig:
    config = vctgi.preset("medium")
    clipmap = replace(
        config.clipmap,
        resolution=16,
        level_count=3,
        finest_voxel_size=0.1,
        centre=(0.0, 0.0, 0.0),
    )
    return replace(config, clipmap=clipmap, storage=StorageConfig(), samples_per_pixel=1)


def open_room(**lights: Any) -> mi.Scene:
    """Return a room without a ceiling, with something in it."""
    walls = room(mi.ScalarTransform4f().scale(0.9), bsdf=diffuse(0.6))
    walls.pop("wall4")
    gold = {"type": "twosided", "bsdf": {"type": "roughconductor", "alpha": 0.4}}
    place = mi.ScalarTransform4f().translate([0.2, -0.4, 0.1]) @ oblique().scale(0.2)
    box = {"type": "cube", "to_world": place, "bsdf": gold}
    eye = camera([0.5, 0.2, 0.9], [0.0, -0.2, 0.0], size=8, fov=80.0)
    return load(sensor=eye, box=box, **walls, **lights)


def lamps() -> dict[str, Any]:
    lamp = {"type": "sphere", "center": [0.3, 0.5, -0.2], "radius": 0.1, "emitter": area_light(4.0)}
    return {
        "lamp": lamp,
        "bulb": {"type": "point", "position": [-0.3, 0.2, 0.1], "intensity": color(1, 2, 3)},
    }


def outside() -> dict[str, Any]:
    return {
        "sun": {"type": "directional", "direction": [0.2, -1.0, 0.3], "irradiance": grey(3.0)},
        "sky": {"type": "constant", "radiance": color(0.3, 0.5, 0.8)},
    }


def prepared_room(lights: dict[str, Any]) -> tuple[PreparedScene, RenderConfig, SceneVoxels]:
    scene, config = open_room(**lights), settings()
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    return prepared, config, voxelize_scene(prepared, config)


def rounding() -> float:
    """Relative: one on the CPU; a GPU's kernels differ in which products they fuse with sums.

    An H200 moves the places that rays hit so that the light of a sky changes by 1.1e-5 at most.
    """
    return 4e-5 if dr.backend_v(mi.Float) == dr.JitBackend.CUDA else 2.0**-23


def words(lit: LitVolume) -> np.ndarray:
    return stored_numbers(lit.volume)


@pytest.mark.parametrize("lights", [lamps, outside, lambda: {**lamps(), **outside()}])
def test_all_levels_at_once_are_lit_like_one_after_the_other(
    lights: Callable[[], dict[str, Any]],
) -> None:
    prepared, config, voxels = prepared_room(lights())
    rules, layout = config.reflective_shadow_map, prepared.plan.layout
    arguments = (prepared.scene, list(prepared.plan.lights), layout, rules, voxels.opacity)
    maps = render_reflective_shadow_maps(*arguments)
    expected = inject_light(maps, voxels.opacity)
    texels = trace_all_levels(*arguments, prepared.plain_bsdfs)
    light = inject_all_levels(texels, voxels.opacity)
    found = light.emittance()
    for one, other in zip(found.levels, expected.levels, strict=True):
        scale = float(np.array(other).max(initial=0.0))
        np.testing.assert_allclose(
            np.array(one), np.array(other), rtol=rounding(), atol=FIXED_POINT * scale
        )
    assert found.lost_flux_share == pytest.approx(
        expected.lost_flux_share, rel=SINGLE_PRECISION_SUM, abs=1e-7
    )
    assert light.fallen.texel_count == sum(each.texel_count for each in maps)


def turn_sun(parameters: mi.SceneParameters) -> None:
    turn = mi.Transform4f().rotate([0.0, 0.0, 1.0], 5.0)
    parameters["sun.to_world"] = turn @ parameters["sun.to_world"]


def dim_sky(parameters: mi.SceneParameters) -> None:
    parameters["sky.radiance.value"] = mi.Color3f(0.1)


def paint_walls(parameters: Any) -> None:
    for name in list(parameters.keys()):
        if name.endswith("reflectance.value") and "specular" not in name:
            parameters[name] = mi.Color3f(0.9, 0.1, 0.1)


def move_nothing(parameters: mi.SceneParameters) -> None:
    """Leave all as it is."""


@pytest.mark.parametrize("change", [turn_sun, dim_sky, paint_walls, move_nothing])
@pytest.mark.parametrize("step", [0.0, 0.15, 0.7])
def test_kept_light_is_that_of_new_voxels(
    change: Callable[[mi.SceneParameters], None], step: float
) -> None:
    prepared, config, voxels = prepared_room(outside())
    for _ in range(3):
        light_volume(prepared, config, voxels=voxels)
    assert voxels.light.texels
    parameters: Any = mi.traverse(prepared.scene)
    change(parameters)
    parameters.update()
    layout = move_clipmap(prepared.plan.layout, (step, 0.0, 0.0))
    moved = replace(prepared, plan=replace(prepared.plan, layout=layout))
    followed = update_voxels(voxels, moved, config)
    found = light_volume(moved, config, voxels=followed)
    np.testing.assert_array_equal(words(found), words(light_volume(moved, config)))


def test_no_light_is_sent_to_levels_beyond_the_scene() -> None:
    prepared, config, _ = prepared_room(outside())
    wide = replace(config, clipmap=replace(config.clipmap, level_count=5))
    around = prepare_scene(prepared.scene, prepared.sensor, wide)
    lit = voxelize_scene(around, wide)
    texels = trace_all_levels(
        prepared.scene,
        list(around.plan.lights),
        around.plan.layout,
        wide.reflective_shadow_map,
        lit.opacity,
        prepared.plain_bsdfs,
    )
    for each in texels:
        assert each.level is not None
        # The room is 1.8 wide, windows are 1.6, 3.2, ...; a surface may fill a voxel behind it.
        assert set(np.array(each.level).tolist()) == {0, 1, 2}
    assert not any(np.array(level).any() for level in lit.opacity.levels[2:])


def test_light_of_voxels_that_changed_is_found_again() -> None:
    prepared, config, voxels = prepared_room(outside())
    for _ in range(2):
        light_volume(prepared, config, voxels=voxels)
    kept = set(voxels.light.texels)
    assert kept == {(light, level) for light in range(2) for level in range(3)}
    voxels.light.follow(voxels.opacity, voxels.opacity, [1])
    assert set(voxels.light.texels) == {key for key in kept if key[1] != 1}


def test_other_voxels_get_other_light() -> None:
    prepared, config, voxels = prepared_room(outside())
    for _ in range(2):
        light_volume(prepared, config, voxels=voxels)
    halved = [0.5 * level for level in voxels.opacity.levels]
    voxels.opacity = replace(voxels.opacity, levels=halved)
    other = replace(voxels)
    assert other.light == KeptLight()
    found = light_volume(prepared, config, voxels=voxels)
    np.testing.assert_array_equal(words(found), words(light_volume(prepared, config, voxels=other)))


def test_light_is_kept_only_for_who_keeps_voxels() -> None:
    prepared, config, voxels = prepared_room(outside())
    light_volume(prepared, config)
    assert voxels.light == KeptLight()


def test_few_launches() -> None:
    prepared, config, voxels = prepared_room(outside())
    for _ in range(2):
        light_volume(prepared, config)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        light_volume(prepared, config, voxels=voxels)
        assert len(dr.kernel_history()) <= LAUNCHES


def test_a_light_without_a_power_is_refused_by_its_name() -> None:
    lights = outside()
    lights["sun"]["irradiance"] = grey(1.0)
    prepared, config, _ = prepared_room(lights)
    parameters: Any = mi.traverse(prepared.scene)
    parameters["sun.irradiance.value"] = mi.Color3f(float("nan"))
    parameters.update()
    with pytest.raises(SceneError, match="sun"):
        light_volume(prepared, config)
