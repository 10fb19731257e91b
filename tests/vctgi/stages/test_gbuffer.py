"""The G-buffer: geometry as Mitsuba has it, and lobes measured on the BSDFs themselves."""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.bsdf_kinds import all_kinds
from tests.vctgi.small_scenes import SceneDict, color, diffuse, load
from vctgi.maths.directions import kronecker_points
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.records import GBuffer
from vctgi.stages.gbuffer import PLAIN_FLAGS, GBufferConfig, trace_gbuffer

pytestmark = pytest.mark.usefixtures("variant")

COUNT = 4096
"""Camera rays, all to one point of view: their mean is the lobe's."""

EXACT = 1e-5
"""Single precision."""

MONTE_CARLO = 0.02
"""Relative: 16 stratified samples of each of 4096 rays."""

MIRROR_APERTURE = 2e-3
"""Radians: acos near 1 turns a rounding of 6e-8 of a length into an angle of 1e-3."""


def seen(
    description: SceneDict, degrees: float = 45.0, sample_count: int = 16, **flags: bool
) -> GBuffer:
    """Look at a square in the plane z = 0 from one direction by `COUNT` rays."""
    scene = load(s={"type": "rectangle", "bsdf": description})
    angle = math.radians(degrees)
    d = dr.zeros(mi.Vector3f, COUNT) + mi.Vector3f(math.sin(angle), 0.0, -math.cos(angle))
    ray = mi.RayDifferential3f(mi.Ray3f(mi.Point3f(mi.Vector3f(0.1, 0.2, 0.0) - 2.0 * d), d))
    kept = {"has_specular": True, "has_passing": True, **flags}
    gbuffer = trace_gbuffer(
        scene,
        ray,
        dr.arange(mi.UInt32, COUNT),
        GBufferConfig(lobe_sample_count=sample_count),
        has_specular=kept["has_specular"],
        has_passing=kept["has_passing"],
    )
    dr.eval(gbuffer)
    return gbuffer


def mean(value: mi.Color3f | mi.Vector3f) -> np.ndarray:
    """Mean over the rays; what is the same in all of them may be one lane wide."""
    average: np.ndarray = np.array(value, dtype=np.float64).reshape(3, -1).mean(axis=1)
    return average


def test_geometry_is_what_mitsuba_hits() -> None:
    found = seen(diffuse())
    assert dr.all(found.is_valid)
    np.testing.assert_allclose(mean(mi.Vector3f(found.position)), [0.1, 0.2, 0.0], atol=EXACT)
    np.testing.assert_allclose(mean(found.normal), [0.0, 0.0, 1.0], atol=EXACT)
    assert float(found.depth[0]) == pytest.approx(2.0, rel=EXACT)


def test_normal_faces_the_viewer_from_behind_too() -> None:
    found = seen({"type": "twosided", "bsdf": diffuse(0.4)}, degrees=135.0)
    np.testing.assert_allclose(mean(found.normal), [0.0, 0.0, -1.0], atol=EXACT)
    np.testing.assert_allclose(mean(found.albedo), 0.4, rtol=EXACT)
    behind = seen(diffuse(0.4), degrees=135.0)
    assert not mean(behind.albedo).any()


def test_rays_into_the_void_see_nothing() -> None:
    scene = load(s={"type": "rectangle"})
    ray = mi.RayDifferential3f(mi.Ray3f(mi.Point3f(5.0, 5.0, 1.0), mi.Vector3f(0.0, 0.0, -1.0)))
    found = trace_gbuffer(
        scene, ray, mi.UInt32(0), GBufferConfig(), has_specular=True, has_passing=True
    )
    assert not found.is_valid[0]
    assert float(found.depth[0]) == 0.0
    for value in (found.albedo, found.specular_albedo, found.passed):
        assert not mean(value).any()


@pytest.mark.parametrize("has_specular", [False, True])
def test_diffuse_albedo_is_the_reflectance(has_specular: bool) -> None:
    reflectance = {"type": "diffuse", "reflectance": color(0.7, 0.4, 0.1)}
    found = seen(reflectance, has_specular=has_specular, has_passing=False)
    np.testing.assert_allclose(mean(found.albedo), [0.7, 0.4, 0.1], rtol=EXACT)
    assert not mean(found.specular_albedo).any()
    assert not mean(found.passed).any()


def test_textured_albedo_is_that_of_the_point() -> None:
    texture = {
        "type": "checkerboard",
        "color0": color(0.8, 0.2, 0.2),
        "color1": color(0.1, 0.1, 0.6),
    }
    found = seen({"type": "diffuse", "reflectance": texture})
    values = np.array(found.albedo).reshape(3, -1).T
    assert any(np.allclose(values, each) for each in ([0.8, 0.2, 0.2], [0.1, 0.1, 0.6]))


@pytest.mark.parametrize("degrees", [0.0, 30.0, 75.0])
def test_mirror_is_a_thin_cone_along_the_mirrored_ray(degrees: float) -> None:
    found = seen({"type": "conductor", "material": "none"}, degrees)
    angle = math.radians(degrees)
    np.testing.assert_allclose(
        mean(found.specular_axis), [math.sin(angle), 0.0, math.cos(angle)], atol=EXACT
    )
    assert np.array(found.specular_aperture).max() <= MIRROR_APERTURE
    np.testing.assert_allclose(mean(found.specular_albedo), 1.0, rtol=EXACT)
    assert not mean(found.albedo).any()


def test_aperture_grows_with_the_roughness() -> None:
    apertures = []
    for alpha in (0.05, 0.1, 0.2, 0.35, 0.5):
        lobe = {"type": "roughconductor", "material": "none", "alpha": alpha}
        found = seen(lobe, degrees=30.0)
        apertures.append(float(np.array(found.specular_aperture).mean()))
        # The mean direction stays near the mirrored one.
        mirrored = np.array([0.5, 0.0, math.sqrt(0.75)])
        axis = mean(found.specular_axis)
        assert axis @ mirrored / np.linalg.norm(axis) > math.cos(0.3)
    assert np.all(np.diff(apertures) > 0.0)
    # Microfacets tilted by alpha turn a ray by 2 alpha, to either side.
    assert 2.0 * 0.05 < apertures[0] < 8.0 * 0.05
    assert 2.0 * 0.5 < apertures[-1] < 0.75 * math.pi


def test_aperture_does_not_depend_on_the_number_of_samples() -> None:
    lobe = {"type": "roughconductor", "material": "none", "alpha": 0.2}
    found = [
        float(np.array(seen(lobe, 30.0, count).specular_aperture).mean()) for count in (16, 256)
    ]
    assert found[0] == pytest.approx(found[1], rel=0.1)


def lobe_albedo(description: SceneDict, flag: mi.BSDFFlags) -> np.ndarray:
    """Albedo [channel] of one smooth lobe by itself, seen at 45 degrees: by even sampling."""
    scene = load(s={"type": "rectangle", "bsdf": description})
    count = 1 << 16
    d = dr.zeros(mi.Vector3f, count) + mi.Vector3f(math.sqrt(0.5), 0.0, -math.sqrt(0.5))
    si = scene.ray_intersect(mi.Ray3f(mi.Point3f(mi.Vector3f(0.1, 0.2, 0.0) - 2.0 * d), d))
    index = dr.arange(mi.UInt32, count)
    wo = mi.warp.square_to_uniform_hemisphere(kronecker_points(index))
    context = mi.BSDFContext()
    context.type_mask = int(flag)
    value = si.bsdf().eval(context, si, wo)
    average: np.ndarray = 2.0 * math.pi * np.array(value, dtype=np.float64).mean(axis=1)
    return average


@pytest.mark.parametrize("name", ["roughplastic", "pplastic"])
def test_lobes_of_plastic_are_kept_apart(name: str) -> None:
    description = all_kinds()[name]
    found = seen(description)
    diffuse_lobe = lobe_albedo(description, mi.BSDFFlags.DiffuseReflection)
    glossy_lobe = lobe_albedo(description, mi.BSDFFlags.GlossyReflection)
    np.testing.assert_allclose(mean(found.albedo), diffuse_lobe, rtol=2.0 * MONTE_CARLO)
    np.testing.assert_allclose(mean(found.specular_albedo), glossy_lobe, rtol=5.0 * MONTE_CARLO)


@pytest.mark.parametrize("name", ["plastic", "roughplastic", "pplastic", "principled"])
def test_lobes_keep_their_sum(name: str) -> None:
    description = all_kinds()[name]
    found = seen(description)
    whole = lobe_albedo(description, mi.BSDFFlags.All)
    if name == "plastic":
        # The mirror lobe has no value to integrate, but Fresnel's closed form.
        cosine, ior = as_component(math.sqrt(0.5)), as_component(1.49 / 1.000277)
        whole = whole + float(mi.fresnel(cosine, ior)[0][0])
    both = mean(found.albedo) + mean(found.specular_albedo)
    np.testing.assert_allclose(both, whole, rtol=2.0 * MONTE_CARLO)
    assert both.max() < 1.0


@pytest.mark.parametrize("opacity", [0.0, 0.3, 1.0])
def test_mask_splits_light_between_albedo_and_what_passes(opacity: float) -> None:
    found = seen({"type": "mask", "opacity": opacity, "nested": diffuse(0.8)})
    np.testing.assert_allclose(mean(found.albedo), 0.8 * opacity, rtol=MONTE_CARLO, atol=EXACT)
    np.testing.assert_allclose(mean(found.passed), 1.0 - opacity, atol=EXACT)
    assert not mean(found.specular_albedo).any()


def test_null_surface_passes_everything() -> None:
    found = seen({"type": "null"})
    np.testing.assert_allclose(mean(found.passed), 1.0, rtol=EXACT)
    assert not mean(found.albedo).any()


def test_thin_glass_reflects_and_passes_all_light() -> None:
    found = seen({"type": "thindielectric"})
    whole = mean(found.specular_albedo) + mean(found.passed)
    np.testing.assert_allclose(whole, 1.0, rtol=MONTE_CARLO)


def test_same_index_makes_the_same_decisions() -> None:
    first, second = (seen(all_kinds()["principled"]) for _ in range(2))
    for name in ("albedo", "specular_albedo", "specular_axis", "specular_aperture"):
        np.testing.assert_array_equal(
            np.array(getattr(first, name)), np.array(getattr(second, name))
        )


def test_plain_flags_are_those_of_a_diffuse_lobe() -> None:
    names = "DiffuseReflection Anisotropic SpatiallyVarying NonSymmetric FrontSide BackSide"
    flags = 0
    for name in names.split():
        flags |= int(getattr(mi.BSDFFlags, name))
    assert flags == PLAIN_FLAGS


def test_nothing_measured_is_refused() -> None:
    with pytest.raises(ValueError, match="lobe_sample_count must be >= 1"):
        GBufferConfig(lobe_sample_count=0)
