"""Irradiance at probes: closed forms, and the same light as a camera sees on a white surface."""

from __future__ import annotations

import math
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from reference import ProbeIrradiance, ReferenceRequest, probe_irradiance, render_reference
from tests.reference import reference_scenes as scenes

EMISSION, ALBEDO = 2.0, 0.5
STANDARD_ERRORS = 5.0
"""Chance of 1e-6 for each number that a true equality is called false."""
ROUNDING = 1e-4
"""Relative: rays start a little off the probe, and sums of float32."""


def measure(scene: dict[str, Any], points: Any, normals: Any, **more: Any) -> ProbeIrradiance:
    more = {"samples": 8192, **more}
    return probe_irradiance(mi.load_dict({"type": "scene", **scene}), points, normals, **more)


def assert_near(found: ProbeIrradiance, name: str, truth: Any) -> None:
    allowed = STANDARD_ERRORS * np.sqrt(found.variance_of_mean(name)) + ROUNDING * np.abs(truth)
    difference = np.abs(found.mean(name) - truth)
    assert (difference <= allowed).all(), (found.mean(name), truth)


def furnace() -> dict[str, Any]:
    walls = {
        "type": "cube",
        "flip_normals": True,
        "bsdf": scenes.diffuse(ALBEDO),
        "emitter": scenes.area_light(EMISSION),
    }
    return {"walls": walls}


POINTS = [[0.0, -1.0, 0.0], [1.0, 0.3, -0.2], [0.2, -0.1, 0.4]]
NORMALS = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.6, 0.0, 0.8]]
"""On the floor, on a wall, and in free space."""


def test_a_furnace_has_its_closed_form_at_every_probe() -> None:
    """E = pi e (1 + a + a^2 + ..): each scattering brings a times the one before."""
    one = measure(furnace(), POINTS, NORMALS, scattering_count=2)
    assert_near(one, "direct", math.pi * EMISSION)
    assert_near(one, "indirect", math.pi * EMISSION * ALBEDO)
    two = measure(furnace(), POINTS, NORMALS, scattering_count=3)
    assert_near(two, "indirect", math.pi * EMISSION * (ALBEDO + ALBEDO**2))
    every = measure(furnace(), POINTS, NORMALS, scattering_count=-1)
    assert_near(every, "total", math.pi * EMISSION / (1.0 - ALBEDO))
    assert not measure(furnace(), POINTS, NORMALS, scattering_count=1).batches("indirect").any()


def test_a_point_light_and_an_even_sky_have_their_closed_forms() -> None:
    lamp = {"lamp": {"type": "point", "position": [0, 3, 0], "intensity": scenes.grey(18.0)}}
    sky = {"sky": {"type": "constant", "radiance": scenes.grey(0.7)}}
    tilt = math.radians(30.0)
    normals = [[0, 1, 0], [math.sin(tilt), math.cos(tilt), 0], [0, -1, 0]]
    points = np.zeros((3, 3))
    # A point light has no variance: I cos / r^2, and nothing from behind
    found = measure(lamp, points, normals, samples=16)
    assert_near(found, "direct", np.array([[2.0], [2.0 * math.cos(tilt)], [0.0]]))
    assert not found.batches("indirect").any()
    assert_near(measure(sky, points, normals), "direct", math.pi * 0.7)


def test_white_surfaces_show_a_camera_the_irradiance_of_probes() -> None:
    """Radiance of a diffuse surface is albedo / pi times the irradiance on it: both components."""
    scene = {
        "type": "scene",
        "sensor": scenes.camera([0, 1, 0.5], [0, 0, 0], 2.0, film=scenes.film(4, 4)),
        **{k: v for k, v in scenes.floor_under_test(scenes.diffuse(0.8)).items() if k != "sensor"},
    }
    scene.pop("type")
    loaded = mi.load_dict({"type": "scene", **scene})
    seen = render_reference(
        loaded,
        request=ReferenceRequest(samples_per_pixel=4096, rest_samples_per_pixel=0),
        cache_directory=None,
    )
    found = measure({k: v for k, v in scene.items()}, [[0, 0, 0]], [[0, 1, 0]], samples=1 << 15)
    for of_camera, of_probe in (("direct", "direct"), ("indirect", "indirect")):
        # A view of 2 degrees: the light hardly changes over it
        image = seen.batches(of_camera).mean(axis=(1, 2), dtype=np.float64) * math.pi / 0.8
        variance = image.var(axis=0, ddof=1) / len(image) + found.variance_of_mean(of_probe)[0]
        difference = np.abs(image.mean(axis=0) - found.mean(of_probe)[0])
        allowed = STANDARD_ERRORS * np.sqrt(variance) + SLOPE * image.mean(axis=0)
        assert (difference <= allowed).all(), of_camera
        # And it has power: 5 % more would be seen
        assert (difference + 0.05 * image.mean(axis=0) > allowed).all(), of_camera


SLOPE = 0.002
"""Relative: curvature of the light over the 4 cm that the camera sees."""


def test_batches_are_independent_and_seeds_differ() -> None:
    first, second = (measure(furnace(), POINTS, NORMALS, samples=64, seed=s) for s in (0, 1))
    again = measure(furnace(), POINTS, NORMALS, samples=64)
    assert first.batches("indirect").tobytes() == again.batches("indirect").tobytes()
    everything = np.concatenate([first.batches("indirect"), second.batches("indirect")])
    assert len(np.unique(everything[:, 0, 0])) == len(everything)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": [[0, 0]]}, r"must both have the shape \[probe, 3\]"),
        ({"points": [], "normals": []}, r"must both have the shape \[probe, 3\]"),
        ({"points": [[0, 0, float("nan")]]}, "must be finite"),
        ({"normals": [[0, 2, 0]]}, "must have unit length"),
        ({"samples": 12}, "must be a multiple of batch_count = 8"),
        ({"batch_count": 1}, "batch_count must be at least 2"),
        ({"scattering_count": 0}, "scattering_count must be at least 1"),
        ({"seed": -1}, "seed must be at least 0"),
    ],
)
def test_bad_probes_are_refused_with_the_rule(change: dict[str, Any], message: str) -> None:
    given = {"points": [[0, 0, 0]], "normals": [[0, 1, 0]], "samples": 16, **change}
    with pytest.raises(ValueError, match=message):
        measure(furnace(), given.pop("points"), given.pop("normals"), **given)


def test_a_light_that_is_not_finite_is_an_error() -> None:
    lamp = {"sky": {"type": "constant", "radiance": scenes.grey(float("inf"))}}
    with pytest.raises(RuntimeError, match=r"component '.*direct' .* at 1 probes"):
        measure(lamp, [[0, 0, 0]], [[0, 1, 0]], samples=16)


def test_an_unknown_component_is_an_error() -> None:
    nothing = np.zeros((2, 1, 3), np.float32)
    probes = ProbeIrradiance(components={"direct": nothing, "indirect": nothing}, samples=2)
    with pytest.raises(ValueError, match="no component named 'rest'"):
        probes.mean("rest")
