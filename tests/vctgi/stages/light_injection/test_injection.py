"""Algorithms of injection agree where they should, keep power, and refuse what they cannot do."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from tests.oracles.lights import FIXED_POINT, finite_lights, layout, shadow_maps
from tests.vctgi.small_scenes import camera, load, oblique, room
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.config import RenderConfig
from vctgi.pipeline import prepare_scene
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.stages.light_injection import LightInjectionConfig, inject_light
from vctgi.stages.light_injection.balance import drawing_power
from vctgi.stages.light_injection.kernels import TAPS
from vctgi.stages.outgoing_radiance import with_radiance
from vctgi.stages.voxelization.opacity import voxelize_opacity

pytestmark = pytest.mark.usefixtures("variant")

STRIPES = 0.02
"""RMS of what a pre-filter makes of even light in slanted walls; 0.013 with 1024 points a face."""

BULB_RADIANCE = 1e-4
"""Relative. A bulb is one sample exactly; single precision at grazing angles."""


def lit_room(*, is_turned: bool = True) -> tuple[list[ReflectiveShadowMap], OpacityClipmap]:
    walls = room(oblique() if is_turned else None)
    eye = camera([0.5, 0.4, 0.6], [0.0, 0.0, 0.0])
    scene = load(light=finite_lights()["point"][0], sensor=eye, **walls)
    surfaces = prepare_scene(scene, scene.sensors()[0], RenderConfig()).surfaces
    return with_radiance(scene, shadow_maps(scene), 1), voxelize_opacity(surfaces, layout())


def injected(
    maps: list[ReflectiveShadowMap], opacity: OpacityClipmap, **options: Any
) -> np.ndarray:
    lit = inject_light(maps, opacity, LightInjectionConfig(**options))
    return np.array(lit.levels[0], dtype=np.float64)


@pytest.mark.parametrize("prefilter", [1, 3, 5])
@pytest.mark.parametrize("normalisation", ["power", "radiance"])
def test_gather_is_scatter_bit_for_bit(prefilter: int, normalisation: str) -> None:
    maps, opacity = lit_room()
    options = {"prefilter": prefilter, "normalisation": normalisation}
    scattered = injected(maps, opacity, algorithm="scatter", **options)
    gathered = injected(maps, opacity, algorithm="gather", **options)
    np.testing.assert_array_equal(gathered, scattered)


@pytest.mark.parametrize("prefilter", [3, 5])
def test_pre_filter_keeps_power_and_writes_only_where_there_is_opacity(prefilter: int) -> None:
    maps, opacity = lit_room(is_turned=False)
    sharp, smooth = injected(maps, opacity), injected(maps, opacity, prefilter=prefilter)
    np.testing.assert_allclose(smooth.sum(axis=1), sharp.sum(axis=1), rtol=FIXED_POINT)
    assert not smooth[:, np.array(opacity.levels[0]) == 0.0].any()


@pytest.mark.parametrize("width", sorted(TAPS))
def test_taps_share_out_all_light(width: int) -> None:
    middle, *rest = TAPS[width]
    assert middle + 2.0 * sum(rest) == pytest.approx(1.0)
    assert 2 * len(rest) + 1 == width


@pytest.mark.parametrize("width", sorted(TAPS))
def test_balanced_slots_draw_as_much_as_they_give(width: int) -> None:
    _, opacity = lit_room()
    level = opacity.layout.levels[0]
    alpha = np.array(opacity.levels[0], dtype=np.float64)
    drawing = np.array(drawing_power(opacity.levels[0], level, width), dtype=np.float64)

    def blurred(values: np.ndarray) -> np.ndarray:
        cube = values.reshape((6,) + (level.resolution,) * 3)
        for axis in (1, 2, 3):
            total = TAPS[width][0] * cube
            for distance, tap in enumerate(TAPS[width][1:], start=1):
                total = total + tap * (
                    np.roll(cube, distance, axis) + np.roll(cube, -distance, axis)
                )
            cube = total
        return cube.ravel()

    # Even light in every slot, shared out by the weights, comes back as even light.
    is_covered = alpha > 0.0
    weight_sum = np.where(is_covered, blurred(drawing), 1.0)
    received = drawing * blurred(np.where(is_covered, alpha / weight_sum, 0.0))
    ratio = received[is_covered] / alpha[is_covered]
    assert np.average((ratio - 1.0) ** 2, weights=alpha[is_covered]) ** 0.5 <= STRIPES


def test_centre_test_lights_a_voxel_as_a_whole() -> None:
    maps, opacity = lit_room(is_turned=False)
    alpha = np.array(opacity.levels[0])
    found = injected(maps, opacity, algorithm="centre")[1]
    radiance = np.array(maps[0].radiance)[1]
    is_lit = found > 0.0
    quotient = found[is_lit] / alpha[is_lit]
    assert quotient.max() <= radiance.max() * (1.0 + FIXED_POINT)
    # Each value is that of one texel.
    nearest = np.sort(radiance)[np.searchsorted(np.sort(radiance), quotient * (1 - 1e-6))]
    np.testing.assert_allclose(quotient, nearest, rtol=1e-5)


def test_radiance_of_a_bulb_is_its_closed_form() -> None:
    maps, _ = lit_room(is_turned=False)
    (lit,) = maps
    position, normal = (np.array(a, dtype=np.float64) for a in (lit.position, lit.normal))
    towards = np.array([[0.2], [0.1], [-0.3]]) - position
    distance = np.linalg.norm(towards, axis=0)
    cosine = np.sum(towards * normal, axis=0) / distance
    expected = 0.5 / np.pi * 3.0 * cosine / distance**2
    np.testing.assert_allclose(np.array(lit.radiance)[1], expected, rtol=BULB_RADIANCE)


@pytest.mark.parametrize("options", [{"algorithm": "centre"}, {"normalisation": "radiance"}])
def test_points_without_radiance_are_refused_where_it_is_needed(options: dict[str, str]) -> None:
    maps, opacity = lit_room()
    bare = [replace(each, radiance=None) for each in maps]
    with pytest.raises(ValueError, match="with_radiance"):
        injected(bare, opacity, **options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"algorithm": "splat"}, "must be one of scatter, gather, centre"),
        ({"normalisation": "none"}, "must be one of power, radiance"),
        ({"prefilter": 2}, "must be one of"),
        ({"algorithm": "centre", "prefilter": 3}, "must be 1 with"),
    ],
)
def test_what_is_not_offered_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        LightInjectionConfig(**options)


def test_light_without_power_stays_dark() -> None:
    maps, opacity = lit_room()
    dark = [
        replace(m, reflected_flux=m.reflected_flux * 0.0, radiance=mi.Color3f(m.incident_flux * 0))
        for m in maps
    ]
    for normalisation in ("power", "radiance"):
        found = injected(dark, opacity, prefilter=3, normalisation=normalisation)
        assert not found.any()
