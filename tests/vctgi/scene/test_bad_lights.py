"""Emitters that cannot shine are refused by name; dark ones are left out by the plan."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import SceneDict, area_light, camera, diffuse, grey, load, room
from vctgi.config import RenderConfig, preset
from vctgi.errors import SceneError
from vctgi.pipeline import PreparedScene, light_volume, prepare_scene, render_frame

pytestmark = pytest.mark.usefixtures("variant")


def bitmap(values: np.ndarray) -> mi.Bitmap:
    return mi.Bitmap(np.ascontiguousarray(values, dtype=np.float32))


def sky_with(pixel: float) -> SceneDict:
    values = np.ones((8, 16, 3))
    values[3, 4] = pixel
    return {"type": "envmap", "bitmap": bitmap(values)}


def point(value: float) -> SceneDict:
    return {"type": "point", "position": [0.1, 0.2, 0.0], "intensity": grey(value)}


def slide(value: float) -> SceneDict:
    values = np.ones((4, 4, 3))
    values[1, 2] = value
    texture = {"type": "bitmap", "bitmap": bitmap(values), "raw": True}
    return {"type": "projector", "irradiance": texture}


def flat(shape: SceneDict) -> SceneDict:
    return {**shape, "emitter": area_light()}


NO_POWER = "negative, infinite or NaN.*lamp.*finite and at least 0"

BAD: dict[str, tuple[Any, str]] = {
    "negative point": (lambda: point(-1.0), NO_POWER),
    "infinite point": (lambda: point(float("inf")), NO_POWER),
    "point of NaN": (lambda: point(float("nan")), NO_POWER),
    "negative slide": (lambda: slide(-1.0), NO_POWER),
    "infinite slide": (lambda: slide(float("inf")), NO_POWER),
    "negative sky pixel": (lambda: sky_with(-5.0), f"of its 'data'.*{NO_POWER[:8]}"),
    "sky pixel of NaN": (lambda: sky_with(float("nan")), NO_POWER),
    "infinite sky pixel": (lambda: sky_with(float("inf")), NO_POWER),
    "negative constant": (lambda: {"type": "constant", "radiance": grey(-1.0)}, NO_POWER),
    "infinite sun": (
        lambda: {"type": "directional", "irradiance": grey(float("inf"))},
        NO_POWER,
    ),
    "spot without an angle": (
        lambda: {"type": "spot", "cutoff_angle": 0.0, "beam_width": 0.0},
        "no angle.*lamp.*above 0 degrees",
    ),
    "spot of negative angle": (
        lambda: {"type": "spot", "cutoff_angle": -5.0, "beam_width": -6.0},
        "no angle.*lamp",
    ),
    "line for a lamp": (
        lambda: flat(
            {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale([0.0, 1.0, 1.0])}
        ),
        "no area.*enlarge the shape",
    ),
    "point for a sphere": (
        lambda: flat({"type": "sphere", "radius": 0.0}),
        "no area.*enlarge the shape",
    ),
    "lamp inside a ball": (
        lambda: point(1.0),
        "backs of one-sided surfaces.*lamp.*move it out",
    ),
}
"""Emitters, and what is said of each."""


def prepare(**parts: Any) -> PreparedScene:
    scene = load(sensor=camera([0.5, 0.2, 0.9], [0.0, -0.2, 0.0], fov=80.0), **parts)
    return prepare_scene(scene, scene.sensors()[0], preset("medium"))


@pytest.mark.parametrize("name", BAD)
@pytest.mark.filterwarnings("ignore:invalid value encountered:RuntimeWarning")
def test_emitter_that_cannot_shine_is_refused_by_name(name: str) -> None:
    make, message = BAD[name]
    parts = room()
    if name == "lamp inside a ball":
        parts["ball"] = {"type": "sphere", "center": [0.1, 0.2, 0], "radius": 0.1}
        parts["ball"]["bsdf"] = diffuse()
    with pytest.raises(SceneError, match=message):
        prepare(lamp=make(), **parts)


def test_lamp_in_a_ball_that_reflects_on_both_sides_is_kept() -> None:
    shade = {"type": "sphere", "center": [0.1, 0.2, 0], "radius": 0.1}
    shade["bsdf"] = {"type": "twosided", "bsdf": diffuse()}
    assert len(prepare(lamp=point(1.0), shade=shade, **room()).plan.lights) == 1


def lamp_facing_away() -> SceneDict:
    up = mi.ScalarTransform4f().translate([0.0, 3.0, 0.0]).rotate([1, 0, 0], -90)
    return {"type": "rectangle", "to_world": up, "emitter": area_light()}


def test_plan_leaves_out_and_names_lights_that_reach_nothing_or_have_no_power() -> None:
    plan = prepare(bulb=point(1.0), off=point(0.0), away=lamp_facing_away(), **room()).plan
    assert [light.name for light in plan.lights] == ["bulb"]
    reasons = {entry.item: entry.reason for entry in plan.entries if not entry.kept}
    assert "off" in reasons["lights without power"]
    assert "away.emitter" in reasons["lights that reach nothing"]


def test_scene_of_dark_lights_is_black_and_finite() -> None:
    config = RenderConfig(samples_per_pixel=1)
    prepared = prepare(off=point(0.0), night={"type": "constant", "radiance": grey(0.0)}, **room())
    assert prepared.plan.lights == ()
    frame = render_frame(prepared, light_volume(prepared, config).volume, config)
    assert not np.array(frame.indirect_diffuse).any()
