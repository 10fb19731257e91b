"""Oracle 8, first half: RSM flux is the power of the emitter that hits the scene."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.oracles.lights import (
    FIXED_POINT,
    LIGHT_NAMES,
    ball,
    finite_lights,
    lamp,
    shadow_maps,
    total,
)
from tests.vctgi.small_scenes import SceneDict, color, grey, load, oblique, room
from vctgi.errors import SceneError
from vctgi.scene.lights import KNOWN_KINDS, list_lights

pytestmark = pytest.mark.usefixtures("variant")

CLOSED_ROOM = 1e-5
"""Relative. Every ray lands: what is left is rounding, and the quadrature of a spot's falloff."""

TEXTURED_EMITTER = 0.01
"""Relative. Where the power is not the same in all texels, a map is a quadrature."""

SILHOUETTE = 0.002
"""Relative. Texels along the outline of what light from outside hits either land or do not."""

MONTE_CARLO = 0.015
"""Relative, four standard errors of the comparison with 2^20 points of direct light."""


def incident(scene: mi.Scene) -> float:
    return float(sum(total(m.incident_flux)[1] for m in shadow_maps(scene)))


@pytest.mark.parametrize("name", LIGHT_NAMES)
@pytest.mark.parametrize("is_turned", [False, True], ids=["axis", "turned"])
def test_all_power_of_a_lamp_lands_in_a_closed_room(name: str, is_turned: bool) -> None:
    light, power = finite_lights()[name]
    walls = room(oblique() if is_turned else None)
    assert incident(load(light=light, **walls)) == pytest.approx(power, rel=CLOSED_ROOM)


def test_every_kind_that_is_called_known_is_compared_with_direct_light_here() -> None:
    scenes = [load(light=light, **room()) for light, _ in finite_lights().values()]
    scenes += [load(light=light, ball=ball()) for light in distant_lights().values()]
    found = {light.kind for scene in scenes for light in list_lights(scene)}
    # Mitsuba 3.9.1 cannot connect a point to a timed sun and sky in a JIT variant.
    assert found >= KNOWN_KINDS - {"TimedSunskyEmitter"}


def bitmap(values: np.ndarray) -> mi.Bitmap:
    return mi.Bitmap(np.ascontiguousarray(values, dtype=np.float32))


def uneven_sky() -> np.ndarray:
    values = np.full((16, 32, 3), 0.5)
    values[5, 7] = 60.0
    return values


def distant_lights() -> dict[str, SceneDict]:
    aimed = mi.ScalarTransform4f().look_at([0.1, 0.9, 0.0], [0.1, -0.2, 0.05], [0, 0, 1])
    slide = np.zeros((8, 8, 3))
    slide[2:6, 1:7] = np.linspace(0.2, 2.0, 6)[None, :, None]
    return {
        "constant": {"type": "constant", "radiance": grey(2.0)},
        "directional": {"type": "directional", "direction": [1, -2, 0.5], "irradiance": grey(2.0)},
        "even envmap": {"type": "envmap", "bitmap": bitmap(np.full((16, 32, 3), 2.0))},
        "sunsky": {"type": "sunsky", "sun_direction": [0.4, 0.3, 0.8], "turbidity": 4.0},
        "uneven envmap": {"type": "envmap", "bitmap": bitmap(uneven_sky())},
        "projector": {
            "type": "projector",
            "to_world": aimed,
            "fov": 50.0,
            "scale": 3.0,
            "irradiance": {"type": "bitmap", "bitmap": bitmap(slide), "raw": True},
        },
    }


@pytest.mark.parametrize(
    ("name", "power"),
    [
        # A convex body of area A collects pi L A; a beam of irradiance E its shadow times E.
        ("constant", 2.0 * math.pi * 4.0 * math.pi * 0.36),
        ("even envmap", 2.0 * math.pi * 4.0 * math.pi * 0.36),
        ("directional", 2.0 * math.pi * 0.36),
    ],
)
def test_distant_light_on_a_ball_is_its_closed_form(name: str, power: float) -> None:
    scene = load(light=distant_lights()[name], ball=ball())
    assert incident(scene) == pytest.approx(power, rel=SILHOUETTE)


def direct_power(scene: mi.Scene, count: int = 1 << 20) -> float:
    """Power that falls on the shapes of a scene by Mitsuba's other path: points that see lights."""
    power = 0.0
    for shape in scene.shapes():
        if shape.is_emitter():
            continue
        sampler: Any = mi.load_dict({"type": "independent"})
        sampler.seed(3, count)
        sample = shape.sample_position(0.0, sampler.next_2d())
        si = dr.zeros(mi.SurfaceInteraction3f, count)
        si.p, si.n, si.sh_frame = sample.p, sample.n, mi.Frame3f(sample.n)
        light, value = scene.sample_emitter_direction(si, sampler.next_2d())
        cosine = dr.maximum(dr.dot(sample.n, light.d), 0.0)
        area = float(shape.surface_area()[0])
        power += float(dr.mean(mi.Float64(value.y * cosine))[0]) * area
    return power


@pytest.mark.parametrize(
    "name",
    ["constant", "directional", "even envmap", "uneven envmap", "projector", "sunsky"],
)
def test_map_holds_the_power_that_direct_light_brings_to_a_ball(name: str) -> None:
    scene = load(light=distant_lights()[name], ball=ball())
    found, direct = incident(scene), direct_power(scene)
    assert found == pytest.approx(direct, rel=MONTE_CARLO)


# Mitsuba cannot connect a point to a lamp that shines one way, so that one has no direct light.
@pytest.mark.parametrize("name", [name for name in LIGHT_NAMES if name != "directional area"])
def test_map_holds_the_power_that_direct_light_brings_to_a_room(name: str) -> None:
    scene = load(light=finite_lights()[name][0], **room())
    found, direct = incident(scene), direct_power(scene, 1 << 18)
    assert found == pytest.approx(direct, rel=MONTE_CARLO)


def test_lamp_with_a_texture_keeps_its_power() -> None:
    values = np.zeros((4, 4, 3))
    values[1, 2], values[3, 0] = 8.0, 24.0
    light = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([0, 0.9, 0]).rotate([1, 0, 0], 90).scale(0.3),
        "emitter": {
            "type": "area",
            "radiance": {
                "type": "bitmap",
                "bitmap": bitmap(values),
                "raw": True,
                "filter_type": "nearest",
            },
        },
    }
    power = math.pi * 0.36 * float(values[..., 1].mean())
    assert incident(load(light=light, **room())) == pytest.approx(power, rel=TEXTURED_EMITTER)


def test_surface_reflects_its_albedo() -> None:
    walls = room(bsdf={"type": "diffuse", "reflectance": color(0.8, 0.3, 0.1)})
    (found,) = shadow_maps(load(light=finite_lights()["sphere"][0], **walls))
    share = total(found.reflected_flux) / total(found.incident_flux)
    np.testing.assert_allclose(share, [0.8, 0.3, 0.1], rtol=FIXED_POINT)


def test_back_of_a_one_sided_surface_reflects_nothing() -> None:
    turned_out = room(flip_normals=True)
    (lit,) = shadow_maps(load(light=finite_lights()["point"][0], **room()))
    (unlit,) = shadow_maps(load(light=finite_lights()["point"][0], **turned_out))
    assert total(lit.reflected_flux).min() > 0.0
    assert total(unlit.reflected_flux).max() == 0.0


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_light_without_a_power_is_refused_by_name(value: float) -> None:
    scene = load(bulb=finite_lights()["point"][0], **room())
    parameters = mi.traverse(scene)
    parameters["bulb.intensity.value"] = mi.Color3f(value)
    parameters.update()
    with pytest.raises(SceneError, match=r"negative, infinite or NaN.*bulb"):
        shadow_maps(scene)


def test_light_that_reaches_nothing_has_no_map() -> None:
    ball_only = load(light=finite_lights()["rectangle"][0], ball=ball())
    assert len(shadow_maps(ball_only)) == 1
    up = mi.ScalarTransform4f().translate([0.0, 3.0, 0.0]).rotate([1, 0, 0], -90)
    away = load(light=lamp({"type": "rectangle", "to_world": up}), ball=ball())
    assert shadow_maps(away) == []


def test_all_lamps_share_one_map_in_which_each_keeps_its_power() -> None:
    lights = finite_lights()
    scene = load(**{name.replace(" ", "_"): light for name, (light, _) in lights.items()}, **room())
    (found,) = shadow_maps(scene)
    owner = np.array(found.light_index)
    flux = np.array(found.incident_flux, dtype=np.float64)[1]
    listed = list_lights(scene)
    sums = np.bincount(owner, flux, len(listed))
    # Lamps stand in one another's way, which changes where light lands but not how much.
    expected = {name.replace(" ", "_"): power for name, (_, power) in lights.items()}
    for light, power in zip(listed, sums, strict=True):
        assert power == pytest.approx(expected[light.name.split(".")[0]], rel=SPOT_OF_FEW_TEXELS)


SPOT_OF_FEW_TEXELS = 1e-3
"""Relative. A spot that lights little has a map of 4096 texels, each a value of its falloff."""


def textured_spot() -> SceneDict:
    aimed = mi.ScalarTransform4f().look_at([0.1, 0.5, 0.0], [0.3, -1.0, 0.1], [0, 0, 1])
    slide = np.linspace(0.2, 2.0, 8)[None, :, None] * np.ones((8, 8, 3))
    texture = {"type": "bitmap", "bitmap": bitmap(slide), "raw": True}
    return {"type": "spot", "to_world": aimed, "cutoff_angle": 25.0, "texture": texture}


def test_textured_spot_keeps_its_power() -> None:
    scene = load(light=textured_spot(), **room())
    assert incident(scene) == pytest.approx(direct_power(scene), rel=MONTE_CARLO)


SLIT = 0.01
"""Relative, of the light through a slit: texels at its edges either pass or do not."""


def test_pilot_moves_texels_and_no_power() -> None:
    # A hall with a slit in its roof: what passes is known, as the hall is convex.
    width, radiance = 0.2, 2.0
    half = 0.5 * (1.0 - 0.5 * width)
    walls = room()
    del walls["wall4"]
    place = mi.ScalarTransform4f
    for side in (-1.0, 1.0):
        roof = place().translate([side * (1.0 - half), 1.0, 0.0]).rotate([1, 0, 0], 90.0)
        walls[f"roof{side:g}"] = {"type": "rectangle", "to_world": roof.scale([half, 1.0, 1.0])}
    scene = load(sky={"type": "constant", "radiance": grey(radiance)}, **walls)
    (found,) = shadow_maps(scene)
    position, normal = (np.array(each, dtype=np.float64) for each in (found.position, found.normal))
    is_inside = np.einsum("ij,ij->j", position, normal) < 0.0
    flux = np.array(found.incident_flux, dtype=np.float64)[1, is_inside].sum()
    assert flux == pytest.approx(math.pi * radiance * 2.0 * width, rel=SLIT)
    # Spread evenly over the sky, 1.7 % of the texels that land would: the slit's share of the hull.
    assert is_inside.mean() > 0.25
