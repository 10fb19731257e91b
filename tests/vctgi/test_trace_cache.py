"""Frames with a cache equal frames without one, bit for bit, whatever changed in between."""

from __future__ import annotations

import gc
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.hand_made_volumes import stored_numbers
from tests.vctgi.small_scenes import area_light, camera, load, oblique, room
from vctgi.clipmap.levels import move_clipmap
from vctgi.config import RenderConfig, preset
from vctgi.frame_pipeline import FrameTally
from vctgi.parameters import ConeParameters
from vctgi.pipeline import (
    Frame,
    LitVolume,
    PreparedScene,
    light_volume,
    prepare_scene,
    render_frame,
    update_voxels,
    voxelize_scene,
)
from vctgi.trace_cache import TraceCache

pytestmark = pytest.mark.usefixtures("variant")


def furnished_room(size: int = 16) -> mi.Scene:
    lamp = {"type": "sphere", "center": [0.3, 0.5, -0.2], "radius": 0.2}
    glossy = {"type": "twosided", "bsdf": {"type": "roughconductor", "alpha": 0.3}}
    place = mi.ScalarTransform4f().translate([-0.3, -0.6, -0.2]) @ oblique().scale(0.3)
    return load(
        sensor=camera([0.5, 0.2, 0.9], [0.0, -0.2, 0.0], size=size, fov=80.0),
        lamp={**lamp, "emitter": area_light(4.0)},
        box={"type": "cube", "to_world": place, "bsdf": glossy},
        **room(),
    )


CEILING = "wall4"
"""Of a room, left out to let the sun in."""


def small(name: str) -> RenderConfig:
    config = preset(name)
    clipmap = replace(config.clipmap, resolution=16, level_count=2)
    return replace(config, clipmap=clipmap, samples_per_pixel=1)


def lit_scene(scene: mi.Scene, config: RenderConfig) -> tuple[PreparedScene, LitVolume]:
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    return prepared, light_volume(prepared, config)


def assert_same(found: Frame, expected: Frame) -> None:
    for name, image in vars(expected).items():
        if isinstance(image, mi.TensorXf):
            np.testing.assert_array_equal(np.array(getattr(found, name)), np.array(image), name)
    assert found.refined_share == expected.refined_share


@pytest.mark.parametrize("name", ["medium", "high", "ambient"])
def test_frames_equal_those_without_a_cache(name: str) -> None:
    config, cache = small(name), TraceCache()
    scene = furnished_room()
    prepared, lit = lit_scene(scene, config)
    layout = prepared.plan.layout

    def compare(seed: int) -> None:
        found = render_frame(prepared, lit.volume, config, seed=seed, cache=cache)
        assert_same(found, render_frame(prepared, lit.volume, config, seed=seed))

    def turn_camera() -> None:
        values = mi.traverse(prepared.sensor)
        values["to_world"] = values["to_world"] @ mi.Transform4f().rotate([0.0, 1.0, 0.0], 20.0)
        values.update()

    for seed in range(3):
        compare(seed)
    # A camera that moves for the first time is a constant of the kernels no more.
    turn_camera()
    compare(3)
    recordings = cache.recording_count
    assert recordings > 0
    turn_camera()
    compare(4)
    # The windows move, with other light in them.
    x, y, z = layout.centre
    moved = move_clipmap(layout, (x + 4.0 * layout.finest_voxel_size, y, z))
    prepared = replace(prepared, plan=replace(prepared.plan, layout=moved))
    lit = light_volume(prepared, config)
    compare(5)
    # Lanes of few that trace cones of their own may be another power of two, and no more.
    assert cache.recording_count <= recordings + 1


def test_moved_surfaces_are_not_stale() -> None:
    config, cache, scene = small("high"), TraceCache(), furnished_room()
    prepared, lit = lit_scene(scene, config)
    for seed in range(2):
        render_frame(prepared, lit.volume, config, seed=seed, cache=cache)
    values = mi.traverse(scene)
    name = next(key for key, _ in values if "box" in key and key.endswith("vertex_positions"))
    values[name] = values[name] + 0.05
    values.update()
    prepared, lit = lit_scene(scene, config)
    found = render_frame(prepared, lit.volume, config, seed=5, cache=cache)
    assert_same(found, render_frame(prepared, lit.volume, config, seed=5))


def test_lit_voxels_equal_those_without_a_cache() -> None:
    cache, config = TraceCache(), small("medium")
    sun = {
        "type": "directional",
        "direction": [0.3, -1.0, 0.2],
        "irradiance": {"type": "rgb", "value": 3.0},
    }
    walls = {name: each for name, each in room().items() if name != CEILING}
    lamp = {"type": "sphere", "center": [0.3, 0.5, -0.2], "radius": 0.2, "emitter": area_light(4.0)}
    scene = load(
        sensor=camera([0.5, 0.2, 0.9], [0.0, -0.2, 0.0], size=8), sun=sun, lamp=lamp, **walls
    )
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    layout = prepared.plan.layout
    x, y, z = layout.centre
    for step in range(5):
        moved = move_clipmap(layout, (x + 2.0 * step * layout.finest_voxel_size, y, z))
        here = replace(prepared, plan=replace(prepared.plan, layout=moved))
        if step > 2:
            values = mi.traverse(prepared.plan.lights[0].emitter)
            values["to_world"] = values["to_world"] @ mi.Transform4f().rotate([1.0, 0.0, 0.0], 5.0)
            values.update()
        found, expected = (light_volume(here, config, cache=kept) for kept in (cache, None))
        np.testing.assert_array_equal(stored_numbers(found.volume), stored_numbers(expected.volume))
        assert found.lost_flux_share == expected.lost_flux_share
        assert found.texel_count == expected.texel_count > 0
    # Pilot and rays of the sun, and rays of the lamp; once more each where it moves first. Sums of
    # light, and texels.
    assert 0 < cache.recording_count <= 8
    with pytest.raises(ValueError, match="leave out `cache`"):
        light_volume(prepared, config, parameters=ConeParameters.from_config(config), cache=cache)
    values = mi.traverse(scene)
    name = next(key for key, _ in values if key.endswith("reflectance.value"))
    dr.enable_grad(values[name])
    values.update()
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    with pytest.raises(ValueError, match="leave out `cache`"):
        light_volume(prepared, config, cache=cache)
    # Scenes share the object of equal parts.
    dr.disable_grad(values[name])
    values.update()


def test_a_walk_records_nothing_after_its_first_steps_however_many_windows_move() -> None:
    cache, config = TraceCache(), small("medium")
    config = replace(config, clipmap=replace(config.clipmap, level_count=4, finest_voxel_size=0.1))
    irradiance = {"type": "rgb", "value": 3.0}
    sun = {"type": "directional", "direction": [0.3, -1.0, 0.2], "irradiance": irradiance}
    flat = mi.ScalarTransform4f().rotate([1, 0, 0], -90).scale(40.0)
    ground = {"type": "rectangle", "to_world": flat, "bsdf": {"type": "diffuse"}}
    scene = load(sensor=camera([0.5, 0.5, 0.9], [0.0, 0.0, 0.0], size=8), sun=sun, ground=ground)
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    layout, voxels = prepared.plan.layout, voxelize_scene(prepared, config)
    light_volume(prepared, config, voxels=voxels, cache=cache)
    x, y, z = layout.centre
    counts, moved_windows = [], set()
    origins = [level.origin for level in layout.clip_levels]
    for step in range(1, 16):
        # Faster and faster, so that more windows follow at a time.
        offset = step * (step + 1) / 2 * layout.finest_voxel_size
        moved = move_clipmap(layout, (x + offset, y, z))
        now = [level.origin for level in moved.clip_levels]
        moved_windows.add(sum(old != new for old, new in zip(origins, now, strict=True)))
        origins = now
        here = replace(prepared, plan=replace(prepared.plan, layout=moved))
        voxels = update_voxels(voxels, here, config)
        found = light_volume(here, config, voxels=voxels, cache=cache)
        counts.append(cache.recording_count)
        if step % 4 == 0:
            expected = light_volume(here, config)
            numbers = stored_numbers(expected.volume)
            np.testing.assert_array_equal(stored_numbers(found.volume), numbers)
    assert len(moved_windows) > 2
    # Light that moved with its windows is sorted by them from the second time on.
    assert counts[-1] == counts[2] > 0


def test_a_light_that_goes_dark_does_not_lend_its_rays_to_the_next() -> None:
    cache, config = TraceCache(), small("medium")

    def outside(x: float, power: float) -> dict[str, Any]:
        irradiance = {"type": "rgb", "value": power}
        return {"type": "directional", "direction": [x, -1.0, 0.2], "irradiance": irradiance}

    walls = {name: each for name, each in room().items() if name != CEILING}
    eye = camera([0.5, 0.2, 0.9], [0.0, -0.2, 0.0], size=8)
    scene = load(sensor=eye, moon=outside(-0.6, 0.0), sun=outside(0.3, 3.0), **walls)
    values = mi.traverse(scene)
    dark, bright = (f"{name}.irradiance.value" for name in ("moon", "sun"))
    for frame in range(6):
        if frame == 3:
            values[dark], values[bright] = mi.Color3f(3.0), mi.Color3f(0.0)
            values.update()
        prepared = prepare_scene(scene, scene.sensors()[0], config)
        assert len(prepared.plan.lights) == 1
        found, expected = (light_volume(prepared, config, cache=kept) for kept in (cache, None))
        np.testing.assert_array_equal(stored_numbers(found.volume), stored_numbers(expected.volume))


def test_another_scene_or_configuration_is_not_mixed_up() -> None:
    cache = TraceCache()
    for size, name in ((16, "medium"), (12, "medium")):
        config = small(name)
        prepared, lit = lit_scene(furnished_room(size), config)
        for seed in range(2):
            found = render_frame(prepared, lit.volume, config, seed=seed, cache=cache)
        assert_same(found, render_frame(prepared, lit.volume, config, seed=1))


def test_scenes_may_come_and_go() -> None:
    config, cache, others = small("medium"), TraceCache(), []
    prepared, lit = lit_scene(furnished_room(), config)
    for seed in range(3):
        for _ in range(2):
            found = render_frame(prepared, lit.volume, config, seed=seed, cache=cache)
        assert_same(found, render_frame(prepared, lit.volume, config, seed=seed))
        others = [furnished_room(12), furnished_room(12)] if seed == 0 else []
        gc.collect()
    assert not others


def test_counted_frames_and_those_with_parameters_are_refused() -> None:
    config, cache = small("medium"), TraceCache()
    prepared, lit = lit_scene(furnished_room(), config)
    with pytest.raises(ValueError, match="leave out `cache`"):
        render_frame(prepared, lit.volume, config, tally=FrameTally(), cache=cache)
    parameters = ConeParameters.from_config(config)
    with pytest.raises(ValueError, match="leave out `cache`"):
        render_frame(prepared, lit.volume, config, parameters=parameters, cache=cache)


def test_moving_windows_compile_nothing_new() -> None:
    config = small("medium")
    prepared, _ = lit_scene(furnished_room(), config)
    layout = prepared.plan.layout
    x, y, z = layout.centre
    missed = []
    for step in range(4):
        moved = move_clipmap(layout, (x + 2.0 * step * layout.finest_voxel_size, y, z))
        here = replace(prepared, plan=replace(prepared.plan, layout=moved))
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            render_frame(here, light_volume(here, config).volume, config)
            kernels = dr.kernel_history((dr.KernelType.JIT,))
        missed.append([kernel["operation_count"] for kernel in kernels if not kernel["cache_hit"]])
    # The second frame may meet what the first did not, such as a level without light.
    assert sum(len(each) for each in missed[2:]) == 0, missed
