"""The plugin: scene files that name it render with `mi.render`, and refuse what it cannot do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

import vctgi
from tests.vctgi.small_scenes import area_light, camera, diffuse, load, room
from vctgi.config import PRESETS
from vctgi.integrator import AMBIENT_AOV_NAMES, AOV_NAMES, SUPPORTED_VARIANTS, known_presets
from vctgi.stages.cone_tracing.specular import SpecularConesConfig
from vctgi.stages.reconstruction.denoising import SpecularFilterConfig

pytestmark = pytest.mark.usefixtures("variant")

SAMPLES = 4

NOISE = 0.05
"""Relative, of picture means at four samples a pixel."""

ROUNDING = 1e-4
"""Relative, of sums of components in single precision."""


def plugin(**more: Any) -> mi.Integrator:
    description = {"type": "vctgi", "preset": "medium", "resolution": 32, **more}
    integrator: mi.Integrator = mi.load_dict(description)
    return integrator


@pytest.fixture
def scene() -> mi.Scene:
    place = mi.ScalarTransform4f().translate([0, 0.9, 0]).rotate([1, 0, 0], 90).scale(0.3)
    lamp = {"type": "rectangle", "id": "lamp", "to_world": place, "emitter": area_light(5.0)}
    eye = camera([0.0, 0.0, 0.9], [0.0, -0.2, 0.0], fov=80.0)
    return load(sensor=eye, lamp=lamp, **room(bsdf=diffuse(0.6)))


def channels(scene: mi.Scene, integrator: mi.Integrator) -> dict[str, np.ndarray]:
    picture = np.array(mi.render(scene, integrator=integrator, spp=SAMPLES))
    assert picture.shape[2] == 3 + len(AOV_NAMES)
    names = ["R", "G", "B", *integrator.aov_names()]
    return {name: picture[..., index] for index, name in enumerate(names)}


def test_dictionary_renders(scene: mi.Scene) -> None:
    integrator = plugin()
    assert integrator.aov_names() == AOV_NAMES
    found = channels(scene, integrator)
    assert all(np.isfinite(image).all() for image in found.values())
    for color in "RGB":
        whole = sum(
            found[f"{part}.{color}"] for part in ("direct", "indirect_diffuse", "indirect_specular")
        )
        np.testing.assert_allclose(found[color], whole, rtol=ROUNDING, atol=ROUNDING)
        assert found[f"indirect_diffuse.{color}"].mean() > 0.01
    assert not found["indirect_specular.G"].any()
    assert found["depth.Z"].min() > 0.0
    length = np.sqrt(sum(found[f"normal.{axis}"] ** 2 for axis in "XYZ"))
    assert length.max() <= 1.0 + ROUNDING
    assert np.median(length) > 0.99


def test_ambient_preset_renders_a_scene_without_light() -> None:
    eye = camera([0.0, 0.0, 0.9], [0.0, -0.2, 0.0], fov=80.0)
    unlit = load(sensor=eye, **room(bsdf=diffuse(0.6)))
    integrator = plugin(preset="ambient")
    assert integrator.aov_names() == AMBIENT_AOV_NAMES
    picture = np.array(mi.render(unlit, integrator=integrator, spp=SAMPLES))
    assert picture.shape[2] == 3 + len(AMBIENT_AOV_NAMES)
    ambient = picture[..., 3]
    assert 0.0 < ambient.min() < ambient.max() <= 1.0
    np.testing.assert_allclose(picture[..., 1], 0.6 * ambient, rtol=ROUNDING, atol=ROUNDING)


def test_every_ray_of_the_plugin_has_cones_of_its_own() -> None:
    assert vctgi.preset("high").reconstruction.sparsity == 9
    integrator: Any = plugin(preset="high")
    assert integrator.config.reconstruction.sparsity == 1


def test_direct_light_is_mitsubas_own(scene: mi.Scene) -> None:
    found = channels(scene, plugin())
    direct: Any = mi.load_dict({"type": "direct"})
    expected = np.array(mi.render(scene, integrator=direct, spp=64))
    assert found["direct.G"].mean() == pytest.approx(expected[..., 1].mean(), rel=NOISE)


def test_xml_scene_that_names_it_renders() -> None:
    text = """<scene version="3.0.0">
        <integrator type="vctgi">
            <string name="preset" value="medium"/>
            <integer name="resolution" value="16"/>
            <integer name="cone_count" value="9"/>
            <float name="aperture_scale" value="0.8"/>
        </integrator>
        <sensor type="perspective">
            <transform name="to_world">
                <lookat origin="0,1,4" target="0,0.3,0" up="0,1,0"/>
            </transform>
            <film type="hdrfilm">
                <integer name="width" value="8"/><integer name="height" value="8"/>
            </film>
        </sensor>
        <shape type="cube"><transform name="to_world"><scale value="0.4"/></transform></shape>
        <shape type="rectangle"><transform name="to_world">
            <rotate x="1" angle="-90"/><scale value="2"/><translate y="-0.4"/>
        </transform></shape>
        <emitter type="directional"><vector name="direction" value="1,-2,-1"/></emitter>
    </scene>"""
    scene: Any = mi.load_string(text)
    integrator = scene.integrator()
    assert integrator.config.clipmap.resolution == 16
    assert integrator.config.diffuse.cone_count == 9
    assert integrator.config.diffuse.aperture_scale == pytest.approx(0.8)
    picture = np.array(mi.render(scene, spp=2))
    assert picture.shape == (8, 8, 3 + len(AOV_NAMES))
    assert np.isfinite(picture).all()
    assert picture[..., 6:9].mean() > 0.0


def test_changed_light_is_seen_at_the_next_render(scene: mi.Scene) -> None:
    integrator = plugin()
    before = channels(scene, integrator)
    parameters = mi.traverse(scene)
    (key,) = [key for key, _ in parameters if key.endswith("emitter.radiance.value")]
    parameters[key] = 3.0 * parameters[key]
    parameters.update()
    after = channels(scene, integrator)
    for name in ("indirect_diffuse.G", "direct.G"):
        np.testing.assert_allclose(after[name], 3.0 * before[name], rtol=1e-3, atol=1e-5)


def test_moved_shape_is_seen_at_the_next_render(scene: mi.Scene) -> None:
    integrator = plugin()
    before = channels(scene, integrator)["indirect_diffuse.G"].mean()
    parameters = mi.traverse(scene)
    # Every wall but the lamp's goes away to the left.
    for key, _ in parameters:
        if key.endswith("vertex_positions") and not key.startswith("lamp"):
            positions = np.array(parameters[key]).reshape(-1, 3) - [50.0, 0.0, 0.0]
            parameters[key] = mi.Float(positions.astype(np.float32).ravel())
    parameters.update()
    after = channels(scene, integrator)["indirect_diffuse.G"].mean()
    assert before > 0.01
    assert after == 0.0


def test_same_seed_gives_the_same_picture(scene: mi.Scene) -> None:
    first, second = (channels(scene, plugin()) for _ in range(2))
    for name, image in first.items():
        np.testing.assert_array_equal(image, second[name])


def test_unknown_preset_is_refused_with_the_known_ones() -> None:
    with pytest.raises(
        Exception, match="no preset 'best'; choose one of ambient, medium, high, ultra"
    ):
        mi.load_dict({"type": "vctgi", "preset": "best"})
    assert known_presets() == [*PRESETS, "high-fitted"]


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [("resolution", 48, "power of two"), ("cone_count", 65, "no set of 65 cones")],
)
def test_impossible_overrides_are_refused(name: str, value: int, message: str) -> None:
    with pytest.raises(Exception, match=message):
        mi.load_dict({"type": "vctgi", name: value})


def test_scene_without_light_is_refused() -> None:
    eye = camera([0.0, 0.0, 0.9], [0.0, -0.2, 0.0])
    # Mitsuba wraps what an integrator raises.
    with pytest.raises(RuntimeError) as caught:
        mi.render(load(sensor=eye, **room()), integrator=plugin(), spp=1)
    assert isinstance(caught.value.__cause__, vctgi.SceneError)
    assert "no light" in str(caught.value.__cause__)


@pytest.fixture
def unsupported_variant(variant: str) -> Iterator[str]:
    name = "scalar_rgb"
    mi.set_variant(name)
    yield name
    mi.set_variant(variant)


def test_unsupported_variant_is_refused(unsupported_variant: str) -> None:
    with pytest.raises(Exception, match=f"'{unsupported_variant}' is not supported"):
        mi.load_dict({"type": "vctgi"})


def test_supported_variants_are_the_ones_that_design_promises() -> None:
    assert SUPPORTED_VARIANTS == ("llvm_ad_rgb", "cuda_ad_rgb")


def test_noise_of_pixels_and_filter_are_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    talk = replace(
        PRESETS["medium"],
        specular=SpecularConesConfig(noise="blue"),
        specular_filter=SpecularFilterConfig(kind="bilateral"),
    )
    monkeypatch.setitem(PRESETS, "medium", talk)
    config = plugin().config  # type: ignore[attr-defined]  # of our class, not of the base
    assert config.specular.noise == "random"
    assert config.specular_filter.kind == "none"
