"""What a scene does not need: left out with the picture unchanged, kept where that is asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import vctgi
from experiments.scenes import BUILT_IN, load_scene
from tests.vctgi.small_scenes import SceneDict, area_light, camera, color, diffuse, grey, load, room
from vctgi.clipmap.storage import StorageConfig
from vctgi.config import RenderConfig
from vctgi.eliminations import ALL, ELIMINATIONS
from vctgi.pipeline import Frame, PreparedScene, light_volume, prepare_scene, render_frame
from vctgi.plan_directions import faced_directions
from vctgi.scene.constants import is_dark, is_opaque_mask
from vctgi.scene.surfaces import opaque_surfaces

pytestmark = pytest.mark.usefixtures("variant")

SIZE, RESOLUTION = 16, 16


def settings(**changes: Any) -> RenderConfig:
    config = vctgi.preset("medium")
    clipmap = replace(config.clipmap, resolution=RESOLUTION)
    config = replace(config, clipmap=clipmap, storage=StorageConfig(), samples_per_pixel=1)
    return replace(config, **changes)


def frame_of(scene: mi.Scene, config: RenderConfig) -> tuple[PreparedScene, Frame]:
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    return prepared, render_frame(prepared, light_volume(prepared, config).volume, config)


def numbers(frame: Frame) -> np.ndarray:
    names = ("indirect_diffuse", "indirect_specular", "albedo", "normal", "depth")
    return np.concatenate([np.array(getattr(frame, name)).ravel() for name in names])


def lit_room(**more: Any) -> mi.Scene:
    lamp = {"type": "point", "position": [0.1, 0.2, 0.0], "intensity": grey(1.0)}
    eye = camera([0.5, 0.2, 0.9], [0.0, -0.2, 0.0], size=8, fov=80.0)
    return load(sensor=eye, lamp=lamp, **room(), **more)


FAST = ("cornell_box", "sealed_rooms")
"""Built-in scenes of which two frames compile in a few seconds."""


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[] if name in FAST else pytest.mark.slow) for name in BUILT_IN],
)
def test_no_built_in_scene_changes_by_what_is_left_out(name: str) -> None:
    scene = load_scene(name, resolution=SIZE, default_resolution=SIZE).scene
    prepared, lean = frame_of(scene, settings())
    _, kept = frame_of(scene, settings(keep=(ALL,)))
    assert np.array_equal(numbers(lean), numbers(kept))
    assert any(entry.override.startswith("--keep") for entry in prepared.plan.entries)


def test_what_can_be_kept_says_how_and_what_it_costs_the_picture() -> None:
    configs = [settings(), settings(emission_in_voxels=True, sky_in_cones=True)]
    clipmap, storage = configs[0].clipmap, configs[0].storage
    configs += [replace(vctgi.preset("ambient"), clipmap=clipmap, storage=storage)]
    for config in configs:
        for entry in prepare_scene(lit_room(), lit_room().sensors()[0], config).plan.entries:
            if entry.override.startswith("--keep "):
                assert entry.override.removeprefix("--keep ") in ELIMINATIONS
                assert entry.bound
            if not entry.kept:
                assert entry.saved
                assert entry.override


def test_a_name_that_means_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="nothing is called 'speculr'; use all, specular"):
        settings(keep=("speculr",))


@pytest.mark.parametrize("name", ["specular", "alpha", "levels", "sky"])
def test_what_is_asked_for_is_kept(name: str) -> None:
    scene = lit_room()
    config = settings(sky_in_cones=True)

    def entries(keep: tuple[str, ...]) -> list[bool]:
        plan = prepare_scene(scene, scene.sensors()[0], replace(config, keep=keep)).plan
        wanted = f"--keep {name}"
        return [e.kept for e in plan.entries if e.override == wanted or wanted[2:] in e.reason]

    assert entries(()) == [False]
    assert entries((name,)) == [True]


def mask(opacity: Any) -> SceneDict:
    return {"type": "mask", "opacity": opacity, "nested": diffuse()}


def picture(values: list[float]) -> SceneDict:
    return {"type": "bitmap", "data": mi.TensorXf(values, (2, 2, 1)), "raw": True}


@pytest.mark.parametrize(
    ("opacity", "is_opaque"),
    [
        (lambda: 1.0, True),
        (lambda: picture([1.0] * 4), True),
        (lambda: 0.999, False),
        (lambda: picture([1.0, 1.0, 0.5, 1.0]), False),
    ],
)
def test_only_masks_of_ones_are_opaque(opacity: Callable[[], Any], is_opaque: bool) -> None:
    assert is_opaque_mask(mi.load_dict(mask(opacity()))) == is_opaque
    assert not is_opaque_mask(mi.load_dict(diffuse()))
    around_null = {"type": "mask", "opacity": opacity(), "nested": {"type": "thindielectric"}}
    assert not is_opaque_mask(mi.load_dict(around_null))


def test_opaque_masks_are_read_as_what_they_mask() -> None:
    wall = {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([0, 0, -0.5])}
    scene = lit_room(screen={**wall, "bsdf": mask(1.0)})
    sensor = scene.sensors()[0]
    lean, kept = (prepare_scene(scene, sensor, settings(keep=keep)) for keep in ((), ("alpha",)))
    assert not lean.plan.has_passing
    assert not lean.surfaces.masks
    assert kept.plan.has_passing
    assert len(kept.surfaces.masks) == 1


def emitter(**more: Any) -> mi.Emitter:
    light: mi.Emitter = mi.load_dict({"type": "point", "position": [0, 0, 0], **more})
    return light


def test_only_lights_that_are_zero_all_over_are_dark() -> None:
    assert is_dark(emitter(intensity=grey(0.0)))
    assert not is_dark(emitter(intensity=color(0.0, 1e-30, 0.0)))
    values = np.zeros((64, 128, 3), dtype=np.float32)
    assert is_dark(mi.load_dict({"type": "envmap", "bitmap": mi.Bitmap(values)}))
    # A star that no survey's sample would find
    values[5, 7] = 1.0
    assert not is_dark(mi.load_dict({"type": "envmap", "bitmap": mi.Bitmap(values)}))


def test_a_dark_light_with_derivatives_is_not_left_out() -> None:
    light = emitter(intensity=grey(0.0))
    parameters = mi.traverse(light)
    dr.enable_grad(parameters["intensity.value"])
    assert not is_dark(light)


@pytest.mark.parametrize(("degrees", "is_kept"), [(0.0, False), (142.0, True)])
def test_a_spot_is_left_out_only_where_all_lies_beside_its_cone(
    degrees: float, is_kept: bool
) -> None:
    outwards = mi.ScalarTransform4f().translate([0, 0, 5]).rotate([1, 0, 0], degrees)
    spot = {"type": "spot", "to_world": outwards, "cutoff_angle": 20.0, "intensity": grey(1.0)}
    scene = lit_room(spot=spot)
    plan = prepare_scene(scene, scene.sensors()[0], settings()).plan
    assert ("spot" in [light.name for light in plan.lights]) == is_kept


def test_a_lamp_that_only_a_tilted_corner_sees_is_kept() -> None:
    """No ray of its survey meets the speck, yet the speck lies before it."""
    up = mi.ScalarTransform4f().translate([0, 3, 0]).rotate([1, 0, 0], -90)
    away = {"type": "rectangle", "to_world": up, "emitter": area_light()}
    speck = mi.ScalarTransform4f().translate([40.0, 3.1, 40.0]).scale(1e-3)
    seen = {"type": "rectangle", "to_world": speck, "bsdf": diffuse()}
    for more, is_kept in (({}, False), ({"speck": seen}, True)):
        scene = lit_room(away=away, **more)
        plan = prepare_scene(scene, scene.sensors()[0], settings()).plan
        assert ("away.emitter" in [light.name for light in plan.lights]) == is_kept


def test_directions_are_those_from_which_fronts_are_met() -> None:
    # Counter-clockwise from above: its front is met by what travels along -y
    floor = np.array([[[0.0, 0, 0], [0, 0, 1], [1, 0, 0]]])
    assert faced_directions(opaque_surfaces(floor)) == (False, False, False, True, False, False)
    slope = np.array([[[0.0, 0, 0], [0, 0, 1], [1, 0.5, 0]]])
    assert faced_directions(opaque_surfaces(slope)) == (True, False, False, True, False, False)


def test_bound_of_left_out_bounces_holds() -> None:
    config = settings(scattering_count=24)
    scene = lit_room()
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    lit = light_volume(prepared, config)
    assert len(lit.bounce_fluxes) - 1 < config.bounce_count
    lean = render_frame(prepared, lit.volume, config)
    _, kept = frame_of(scene, replace(config, keep=("bounces",)))
    largest = float(np.abs(numbers(lean) - numbers(kept)).max())
    assert 0.0 < largest <= lit.left_out_radiance
    # The bound is no more than 100 times too careful: it would find a tail that is forgotten
    assert lit.left_out_radiance < 100.0 * largest
