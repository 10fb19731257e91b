"""Bad requests are refused with the rule and the remedy; what is derived is derived right."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from reference import Reference, ReferenceRequest, render_reference
from reference.passes import check_memory, samples_per_pass
from tests.reference import reference_scenes as scenes

REQUEST = ReferenceRequest(samples_per_pixel=8)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"samples_per_pixel": 12}, "multiple of batch_count = 8, got 12: ask for 16"),
        ({"samples_per_pixel": 0}, "samples_per_pixel must be at least 8, got 0"),
        ({"samples_per_pixel": 8, "batch_count": 1}, "batch_count must be at least 2"),
        ({"samples_per_pixel": 8, "scattering_count": 0}, "scattering_count must be at least 1"),
        ({"samples_per_pixel": 8, "seed": -1}, "seed must be at least 0"),
        ({"samples_per_pixel": 8, "rest_samples_per_pixel": 3}, "rest_samples_per_pixel"),
    ],
)
def test_bad_requests_name_the_field_and_the_rule(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ReferenceRequest(**fields)


def test_the_rest_gets_a_quarter_of_the_samples_unless_told() -> None:
    assert ReferenceRequest(samples_per_pixel=256).rest_batch_samples_per_pixel == 8
    assert ReferenceRequest(samples_per_pixel=8).rest_batch_samples_per_pixel == 1
    told = ReferenceRequest(samples_per_pixel=8, rest_samples_per_pixel=0)
    assert told.rest_batch_samples_per_pixel == 0


def test_a_missing_sensor_is_an_error() -> None:
    with pytest.raises(ValueError, match="sensor 1 does not exist, the scene has 1"):
        render_reference(
            mi.load_dict(scenes.textured()), sensor=1, request=REQUEST, cache_directory=None
        )


def test_an_unsupported_variant_is_an_error() -> None:
    scene = mi.load_dict(scenes.textured())
    mi.set_variant("scalar_rgb")
    with pytest.raises(ValueError, match="variant 'scalar_rgb' is not supported"):
        render_reference(scene, request=REQUEST, cache_directory=None)


def test_a_film_that_cannot_fit_is_refused_with_the_bytes() -> None:
    with pytest.raises(ValueError, match=r"need \d+\.\d GiB of the .* fewer batches"):
        check_memory(pixel_count=1 << 36, batch_count=8, component_count=5)


def test_passes_divide_a_batch_and_stay_within_the_wavefront() -> None:
    assert samples_per_pass(32, 256 * 256, "llvm_ad_rgb") == 32
    assert samples_per_pass(100, 1 << 16, "llvm_ad_rgb") == 50
    assert samples_per_pass(31, 1 << 20, "llvm_ad_rgb") == 1
    assert samples_per_pass(8, 1 << 25, "cuda_ad_rgb") == 1


def test_mean_and_variance_are_those_of_the_batches() -> None:
    batches = np.arange(24, dtype=np.float32).reshape(4, 1, 2, 3)
    reference = Reference(
        components=dict.fromkeys(
            ("emission", "direct", "indirect_diffuse", "indirect_specular"), batches
        ),
        key="",
        request=ReferenceRequest(samples_per_pixel=4, batch_count=4),
        seconds=0.0,
        from_cache=False,
        notes=[],
    )
    # Steps of 6 about their mean: variance 6^2 (1.5^2 + 0.5^2) 2 / 3 = 60
    assert reference.variance_of_mean("direct") == pytest.approx(60.0 / 4.0)
    assert reference.mean("direct")[0, 0] == pytest.approx([9.0, 10.0, 11.0])
    # Fully correlated components add their spreads, not their variances
    assert reference.variance_of_mean("image") == pytest.approx(16 * 60.0 / 4.0)
    with pytest.raises(ValueError, match="no component named 'rest'"):
        reference.mean("rest")
