"""Texels are dealt to lamps by what they light, and shared by power where there are too few."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import SceneDict, area_light, grey, load, room
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.scene.lights import list_lights
from vctgi.stages.reflective_shadow_map import (
    ReflectiveShadowMapConfig,
    render_reflective_shadow_maps,
    survey_lamps,
)
from vctgi.stages.reflective_shadow_map.lamps import LEAST_TEXELS, share_texels

pytestmark = pytest.mark.usefixtures("variant")

FACES_WITHIN = 0.25
"""Relative. 256 rays, and cosines that are taken as at least 0.1."""


def layout() -> ClipmapLayout:
    return lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.0625, level_count=1, resolution=64)


def beam(half: float) -> SceneDict:
    """Return a square lamp, twice `half` wide, that shines straight down."""
    down = mi.ScalarTransform4f().translate([0.0, 0.5, 0.0]).rotate([1, 0, 0], 90).scale(half)
    emitter = {"type": "directionalarea", "radiance": grey(1.0)}
    return {"type": "rectangle", "to_world": down, "emitter": emitter}


def beam_faces(half: float) -> float:
    """Voxel faces that the lamp lights on the floor."""
    return (2.0 * half / layout().finest_voxel_size) ** 2


def test_lit_faces_are_counted() -> None:
    point = {"type": "point", "position": [0.0, 0.0, 0.0], "intensity": grey(1.0)}
    ball = {"type": "sphere", "center": [0.0, -0.4, 0.0], "radius": 0.02}
    lamp = {**ball, "emitter": area_light()}
    scene = load(point=point, beam=beam(0.4), lamp=lamp, **room())
    listed = list_lights(scene)
    survey = survey_lamps(scene, listed, layout())
    names = [light.name.split(".")[0] for light in listed]
    faces = dict(zip(names, survey.lit_faces, strict=True))
    walls = 24.0 / layout().finest_voxel_size ** 2
    assert faces["point"] == pytest.approx(walls, rel=FACES_WITHIN)
    assert faces["beam"] == pytest.approx(beam_faces(0.4), rel=FACES_WITHIN)
    # A point of the lamp sees the half of the room that it faces.
    assert 0.25 * walls < faces["lamp"] < walls


def test_narrow_beam_gets_a_small_map_whose_texels_are_smaller_than_voxels() -> None:
    scene = load(beam=beam(0.8), **room())
    config = ReflectiveShadowMapConfig()
    (found,) = render_reflective_shadow_maps(scene, list_lights(scene), layout(), config)
    wanted = config.texels_per_face * beam_faces(0.8)
    assert found.texel_count == pytest.approx(wanted, rel=FACES_WITHIN)


def test_lamp_of_uneven_power_gets_a_full_map() -> None:
    spot = {"type": "spot", "cutoff_angle": 5.0, "intensity": grey(1.0)}
    scene = load(spot=spot, **room())
    config = ReflectiveShadowMapConfig()
    (found,) = render_reflective_shadow_maps(scene, list_lights(scene), layout(), config)
    assert found.texel_count == pytest.approx((64 * config.texels_per_voxel) ** 2, rel=1e-3)


def test_texels_are_shared_by_power_and_none_goes_without() -> None:
    wanted, power = np.array([1e4, 1e4, 1e4, 100.0]), np.array([8.0, 4.0, 0.0, 8.0])
    dealt = share_texels(wanted, power, 10_000)
    assert dealt.sum() == pytest.approx(10_000, rel=1e-6)
    assert dealt[0] == pytest.approx(2.0 * dealt[1], rel=1e-6)
    assert dealt[2] == LEAST_TEXELS
    assert dealt[3] == 100.0
    np.testing.assert_array_equal(share_texels(wanted, power, 40_000), wanted)


def test_many_lamps_keep_to_the_budget() -> None:
    bulb = {"type": "point", "intensity": grey(1.0)}
    bulbs = {f"b{n}": {**bulb, "position": [0.01 * n - 0.5, 0, 0]} for n in range(100)}
    scene = load(**bulbs, **room())
    config = ReflectiveShadowMapConfig(max_texel_count=20_000)
    (found,) = render_reflective_shadow_maps(scene, list_lights(scene), layout(), config)
    assert 0.8 * 20_000 < found.texel_count <= 20_000
    with pytest.raises(ValueError, match="max_texel_count = 1000; raise it"):
        render_reflective_shadow_maps(
            scene, list_lights(scene), layout(), ReflectiveShadowMapConfig(max_texel_count=1000)
        )


@pytest.mark.parametrize(
    "name", ["texels_per_voxel", "texels_per_face", "full_lamp_count", "max_texel_count"]
)
def test_empty_maps_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=name):
        ReflectiveShadowMapConfig(**{name: 0})
