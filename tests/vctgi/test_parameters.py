"""Parameters of cones: the numbers of a configuration and back, and the same picture."""

from __future__ import annotations

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import area_light, camera, load, room
from vctgi.clipmap.levels import ClipmapConfig
from vctgi.config import RenderConfig, preset
from vctgi.parameters import ConeParameters
from vctgi.pipeline import light_volume, prepare_scene, render_frame
from vctgi.stages.cone_tracing.cone_values import MARCH_NAMES
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig

pytestmark = pytest.mark.usefixtures("variant")

ROUNDING = 2e-5
"""Two ways to compute one cone in single precision, of the largest pixel: the apertures' tangent,
and steps whose number can differ by one that is as short as rounding."""


def small(**more: object) -> RenderConfig:
    diffuse = DiffuseConesConfig(cone_count=6, near_field_voxels=2.0)
    base = RenderConfig(clipmap=ClipmapConfig(resolution=16), diffuse=diffuse, samples_per_pixel=1)
    return replace(base, **more)  # type: ignore[arg-type]


def lit_room() -> mi.Scene:
    lamp = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([0, 0.6, 0]).rotate([1, 0, 0], 90).scale(0.3),
        "emitter": area_light(5.0),
    }
    glossy = {"type": "roughconductor", "alpha": 0.3}
    ball = {"type": "sphere", "center": [0.4, -0.5, 0.2], "radius": 0.4, "bsdf": glossy}
    eye = camera([0, 0, 0.9], [0, -0.3, 0], size=8, fov=80.0)
    return load(**room(), lamp=lamp, ball=ball, eye=eye)


@pytest.mark.parametrize("mode", ["indirect", "ambient"])
def test_the_parameters_of_a_configuration_give_its_picture(mode: str) -> None:
    config = small(mode=mode)
    scene = lit_room()
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    volume = light_volume(prepared, config).volume
    plain = render_frame(prepared, volume, config)
    parameters = ConeParameters.from_config(config)
    live = render_frame(prepared, volume, config, parameters=parameters)
    for name in ("indirect_diffuse", "indirect_specular", "ambient"):
        if getattr(plain, name) is None:
            continue
        wanted, found = (np.array(getattr(each, name)) for each in (plain, live))
        if mode == "indirect":
            assert wanted.max() > 0.0
        np.testing.assert_allclose(found, wanted, atol=ROUNDING * max(wanted.max(), 1e-9))


@pytest.mark.parametrize("name", ["medium", "high", "ultra", "peer:crassin", "ambient"])
def test_a_configuration_comes_back_from_its_parameters(name: str) -> None:
    config = preset(name)
    back = ConeParameters.from_config(config).to_config(config)
    for held in MARCH_NAMES.values():
        wanted = getattr(config.diffuse.march, held)
        assert getattr(back.diffuse.march, held) == pytest.approx(wanted, rel=1e-6)
    wanted_cones, cones = config.diffuse.cones(), back.diffuse.cones()
    for field in ("apertures", "weights", "directions"):
        wanted, found = (np.array(getattr(each, field)) for each in (wanted_cones, cones))
        # The angle of an axis near the normal is an arc cosine near 1
        np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-6)


def test_changed_values_reach_the_configuration() -> None:
    config = small()
    parameters = ConeParameters.from_config(config)
    parameters["apertures"] = 0.8 * parameters["apertures"]
    parameters["weights"] = mi.Float([2.0, 1, 1, 1, 1, 1])
    parameters["opacity_exponent"] = mi.Float(1.25)
    parameters["specular_aperture_scale"] = mi.Float(0.5)
    parameters["ambient_range_scale"] = mi.Float(3.0)
    back = parameters.to_config(config)
    assert back.diffuse.march.correction_factor == 1.25
    assert back.specular.aperture_scale == 0.5
    assert back.ambient.range_share == pytest.approx(3.0 * 0.1)
    assert back.diffuse.cones().weights == pytest.approx([2 / 7] + [1 / 7] * 5)
    assert back.diffuse.cones().apertures == pytest.approx(
        [0.8 * a for a in config.diffuse.cones().apertures]
    )
    scene = lit_room()
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    volume = light_volume(prepared, config).volume
    live = render_frame(prepared, volume, config, parameters=parameters)
    plain = render_frame(prepared, volume, back)
    for name in ("indirect_diffuse", "indirect_specular"):
        wanted, found = (np.array(getattr(each, name)) for each in (plain, live))
        np.testing.assert_allclose(found, wanted, atol=ROUNDING * wanted.max())


def test_what_a_configuration_cannot_hold_is_refused() -> None:
    config = small()
    parameters = ConeParameters.from_config(config)
    with pytest.raises(ValueError, match="no parameter 'aperture'"):
        parameters["aperture"] = mi.Float(1.0)
    with pytest.raises(ValueError, match="'weights' takes 6 values"):
        parameters["weights"] = mi.Float(1.0)
    parameters["step_ratio"] = mi.Float([0.5] * 5 + [0.4])
    with pytest.raises(ValueError, match="'step_ratio' differs from cone to cone"):
        parameters.to_config(config)
    parameters["step_ratio"] = mi.Float(1.5)
    with pytest.raises(ValueError, match="step_ratio must be in"):
        parameters.to_config(config)
    with pytest.raises(ValueError, match="'compix16' belong to the world"):
        ConeParameters.from_config(preset("peer:compix"))
    with pytest.raises(ValueError, match="cone_apertures must be 6 numbers"):
        DiffuseConesConfig(cone_count=6, cone_apertures=(1.0, 2.0))
    with pytest.raises(ValueError, match="cone_elevations must be"):
        DiffuseConesConfig(cone_count=1, cone_elevations=(1.6,))
