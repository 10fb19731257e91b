"""What each BSDF contributes is stated, and its albedo is what it reflects."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.bsdf_kinds import NAMES, all_kinds
from tests.vctgi.small_scenes import SceneDict, diffuse, load
from vctgi.maths.directions import kronecker_points
from vctgi.maths.stub_gaps import as_component
from vctgi.scene.materials import (
    CONTRIBUTIONS,
    GENERIC_CONTRIBUTION,
    Material,
    describe_material,
)
from vctgi.scene.reflectance import hemispherical_albedo

pytestmark = pytest.mark.usefixtures("variant")

ETA = 1.5
COUNT = 1 << 16
"""Lanes: each one texel's estimate, and one direction of the hemisphere."""

MONTE_CARLO = 0.01
"""Absolute, of albedos in [0, 1]: more than four standard errors of either estimate."""


def material(name: str) -> Material:
    return describe_material(built(all_kinds()[name]))


def built(description: SceneDict) -> mi.BSDF:
    bsdf: mi.BSDF = mi.load_dict(description)
    return bsdf


@pytest.mark.parametrize("name", NAMES)
def test_every_kind_is_described(name: str) -> None:
    found = material(name)
    assert found.kind
    assert found.contribution
    assert found.is_known == (found.kind in CONTRIBUTIONS)
    # Hair is no surface; it is named as not known, and so is a polarised kind.
    assert found.is_known or name in ("hair", "pplastic")
    if not found.is_known:
        assert found.contribution == GENERIC_CONTRIBUTION


def test_described_classes_exist() -> None:
    kinds = {material(name).kind for name in NAMES}
    assert set(CONTRIBUTIONS) <= kinds


@pytest.mark.parametrize(
    ("name", "has_diffuse", "has_specular", "has_null"),
    [
        ("diffuse", True, False, False),
        ("plastic", True, True, False),
        ("roughplastic", True, True, False),
        ("conductor", False, True, False),
        ("roughconductor", False, True, False),
        ("dielectric", False, True, False),
        ("roughdielectric", False, True, False),
        ("mask", True, False, True),
        ("null", False, False, True),
        ("blendbsdf", True, False, False),
        ("twosided", True, True, False),
    ],
)
def test_lobes_are_found(name: str, has_diffuse: bool, has_specular: bool, has_null: bool) -> None:
    found = material(name)
    lobes = (found.has_diffuse, found.has_specular, found.has_null)
    assert lobes == (has_diffuse, has_specular, has_null)


def test_two_sided_adapters_are_looked_through() -> None:
    found = material("twosided")
    assert found.kind == "RoughPlastic"
    assert found.is_two_sided
    assert not material("diffuse").is_two_sided
    assert material("dielectric").is_two_sided


def lit_point(scene: mi.Scene, degrees: float) -> mi.SurfaceInteraction3f:
    """Return a point of a surface that light meets at an angle to the normal, on `COUNT` lanes."""
    angle = np.radians(degrees)
    d = np.array([np.sin(angle), 0.0, -np.cos(angle)])
    lanes = dr.zeros(mi.Vector3f, COUNT)
    origin = mi.Point3f(lanes + mi.Vector3f(*([0.1, 0.2, 0.0] - 2.0 * d).tolist()))
    ray = mi.Ray3f(origin, lanes + mi.Vector3f(*d.tolist()))
    return scene.ray_intersect(ray)


def surface(description: SceneDict) -> mi.Scene:
    """Return a square; it must be kept as long as its BSDF is asked."""
    return load(s={"type": "rectangle", "bsdf": description})


def smooth_albedo(si: mi.SurfaceInteraction3f) -> np.ndarray:
    """Integral of the smooth lobes over the hemisphere of the light, by even sampling."""
    points = kronecker_points(dr.arange(mi.UInt32, COUNT))
    wo = mi.warp.square_to_uniform_hemisphere(points)
    context = mi.BSDFContext()
    value = si.bsdf().eval(context, si, wo)
    pdf = mi.warp.square_to_uniform_hemisphere_pdf(wo)
    mean: np.ndarray = np.array(value / pdf, dtype=np.float64).mean(axis=1)
    return mean


def mirror_albedo(name: str, degrees: float) -> np.ndarray:
    """Return the closed form of the mirror lobe, Fresnel's reflectance."""
    cosine = float(np.cos(np.radians(degrees)))
    if name == "conductor":
        parameters = mi.traverse(built(all_kinds()[name]))
        eta, k = (np.array(parameters[f"{part}.value"]).ravel() for part in ("eta", "k"))
        rows = [
            float(
                mi.fresnel_conductor(
                    as_component(cosine), dr.auto.ad.Complex2f(float(e), float(kk))
                )[0]
            )
            for e, kk in zip(eta, k, strict=True)
        ]
        return np.array(rows)
    ior = {"plastic": 1.49, "dielectric": ETA, "thindielectric": ETA}.get(name)
    if ior is None:
        return np.zeros(3)
    reflected = float(mi.fresnel(as_component(cosine), as_component(ior / 1.000277))[0][0])
    if name == "thindielectric":
        # All reflections between the two faces together.
        reflected = 2.0 * reflected / (1.0 + reflected)
    return np.full(3, reflected)


@pytest.mark.parametrize("degrees", [0.0, 40.0, 70.0])
# A hair has no hemisphere: its BSDF is defined on fibres.
@pytest.mark.parametrize("name", [name for name in NAMES if name != "hair"])
def test_albedo_is_what_the_bsdf_reflects(name: str, degrees: float) -> None:
    scene = surface(all_kinds()[name])
    si = lit_point(scene, degrees)
    estimate = np.array(hemispherical_albedo(si, dr.arange(mi.UInt32, COUNT)), np.float64)
    found = estimate.mean(axis=1)
    expected = smooth_albedo(si) + mirror_albedo(name, degrees)
    assert name == "null" or expected.min() > 0.0
    np.testing.assert_allclose(found, expected, atol=MONTE_CARLO)
    assert np.all(found <= 1.0 + MONTE_CARLO)


@pytest.mark.parametrize("value", [0.0, 0.37, 1.0])
def test_albedo_of_a_diffuse_surface_is_exact(value: float) -> None:
    scene = surface(diffuse(value))
    si = lit_point(scene, 30.0)
    estimate = np.array(hemispherical_albedo(si, dr.arange(mi.UInt32, COUNT)))
    np.testing.assert_allclose(estimate, value, rtol=1e-6)
