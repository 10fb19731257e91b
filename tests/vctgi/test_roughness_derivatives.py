"""Derivatives by a roughness, constant or a texture, in both modes and against differences."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import area_light, camera, diffuse, room
from vctgi.clipmap.levels import ClipmapConfig
from vctgi.config import RenderConfig
from vctgi.pipeline import light_volume, prepare_scene, render_frame
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig
from vctgi.stages.cone_tracing.specular import SpecularConesConfig

pytestmark = pytest.mark.usefixtures("variant")

CONFIG = RenderConfig(
    clipmap=ClipmapConfig(resolution=16),
    diffuse=DiffuseConesConfig(cone_count=4, near_field_voxels=0.0),
    specular=SpecularConesConfig(rough_cone_count=1),
    samples_per_pixel=2,
)
"""One cone a lobe: of several, those that dip below their surface are left out at once, a jump that
derivatives do not see. Two samples a pixel: calls of one disturb those of the next, if any do."""

ROUGH = "ball.bsdf.alpha.value"
BITMAP = "ball.bsdf.alpha.data"

STEP = 1e-3
"""Relative step of the differences."""

POINTS = (0.8, 1.0, 1.3)
"""Factors on the roughness at which derivatives are taken."""

LIMIT, LEAST_SHARE = 0.05, 0.02
"""Share of the difference by which a derivative may be off, and share of the mean picture below
which a difference counts as so much: a picture has kinks wherever a sample changes voxels."""

SAME = 1e-4
"""Both modes add the same numbers in another order."""


def scene_of(alpha: Any) -> mi.Scene:
    """Return a lit room with a metal ball, whose BSDF is loaded last: a trap of Dr.Jit's."""
    lamp = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([0, 0.6, 0]).rotate([1, 0, 0], 90).scale(0.3),
        "emitter": area_light(5.0),
    }
    ball = {
        "type": "sphere",
        "center": [0.0, -0.4, -0.1],
        "radius": 0.5,
        "bsdf": {"type": "roughconductor", "alpha": alpha},
    }
    eye = camera([0, 0, 0.9], [0, -0.3, 0], size=32, fov=70.0)
    parts = {**room(bsdf=diffuse()), "lamp": lamp, "eye": eye, "ball": ball}
    # One after the other, not side by side
    scene: mi.Scene = mi.load_dict({"type": "scene", **parts}, parallel=False)
    return scene


def texture() -> dict[str, Any]:
    values = np.linspace(0.25, 0.4, 16, dtype=np.float32).reshape(4, 4, 1)
    return {"type": "bitmap", "data": mi.TensorXf(values), "raw": True}


class Pictures:
    """A scene's mean indirect light as a function of a factor on a roughness."""

    def __init__(self, scene: mi.Scene, name: str) -> None:
        self.scene, self.name = scene, name
        self.parameters: Any = mi.traverse(scene)
        self.start = type(self.parameters[name])(self.parameters[name])

    def at(self, factor: mi.Float) -> mi.Float:
        kind, width = type(self.start), dr.width(self.start)
        if width > 1:
            numbers = self.start.array * (factor + dr.zeros(mi.Float, width))
            self.parameters[self.name] = kind(numbers, self.start.shape)
        else:
            self.parameters[self.name] = self.start * factor
        self.parameters.update()
        prepared = prepare_scene(self.scene, self.scene.sensors()[0], CONFIG)
        volume = light_volume(prepared, CONFIG).volume
        frame = render_frame(prepared, volume, CONFIG)
        return mi.Float(frame.indirect_diffuse.array + frame.indirect_specular.array)

    def mean(self, factor: float) -> float:
        return float(np.mean(np.array(self.at(dr.opaque(mi.Float, factor)), dtype=np.float64)))

    def forward(self, factor: float) -> float:
        value = dr.opaque(mi.Float, factor)
        dr.enable_grad(value)
        dr.set_grad(value, 1.0)
        return float(np.mean(np.array(dr.forward_to(self.at(value)), dtype=np.float64)))

    def reverse(self, factor: float) -> float:
        value = dr.opaque(mi.Float, factor)
        dr.enable_grad(value)
        numbers = self.at(value)
        dr.backward(numbers * (1.0 / dr.width(numbers)))
        return float(dr.grad(value)[0])


@pytest.mark.parametrize("name", [ROUGH, BITMAP])
def test_both_modes_are_the_difference(name: str) -> None:
    pictures = Pictures(scene_of(0.27 if name == ROUGH else texture()), name)
    for factor in POINTS:
        ends = [pictures.mean(factor * (1.0 + sign * STEP)) for sign in (1.0, -1.0)]
        wanted = (ends[0] - ends[1]) / (2.0 * STEP * factor)
        least = LEAST_SHARE * 0.5 * sum(ends)
        forward, reverse = pictures.forward(factor), pictures.reverse(factor)
        assert forward == pytest.approx(reverse, rel=SAME)
        assert abs(forward - wanted) <= LIMIT * max(abs(wanted), least)


@pytest.mark.slow
def test_mitsuba_renders_with_both_modes() -> None:
    scene = scene_of(0.27)
    parameters: Any = mi.traverse(scene)
    integrator = mi.load_dict({"type": "vctgi", "preset": "medium", "resolution": 16})
    render: Any = mi.render

    def mean() -> mi.Float:
        image = render(scene, parameters, integrator=integrator, spp=2, seed=1)
        return mi.Float(dr.mean(image[..., :3]).array)

    value = dr.opaque(mi.Float, 0.27)
    dr.enable_grad(value)
    parameters[ROUGH] = value
    parameters.update()
    dr.set_grad(value, 1.0)
    forward = float(dr.forward_to(mean())[0])
    dr.set_grad(value, 0.0)
    dr.backward(mean())
    assert forward != 0.0
    assert float(dr.grad(value)[0]) == pytest.approx(forward, rel=SAME)
