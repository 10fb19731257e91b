"""Denoised path tracing is closer to the truth than what it started from; a missing extra says so."""

from __future__ import annotations

import importlib
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from reference import DenoiserMissingError, render_denoised
from tests.reference import reference_scenes as scenes

LEAST_GAIN = 3.0
"""Squared error before over after; measured 8 at 4 paths a pixel of a 64 x 64 Cornell box."""
SAMPLES = 4
TRUTH_SAMPLES = 1024


def cornell() -> mi.Scene:
    description = scenes.cornell()
    description["sensor"]["film"] = scenes.film(64, 64)
    scene: mi.Scene = mi.load_dict(description)
    return scene


def test_the_denoiser_takes_most_of_the_error_away() -> None:
    pytest.importorskip("pyoidn", reason="the extra [denoise] is not installed")
    scene = cornell()
    frame = render_denoised(scene, samples_per_pixel=SAMPLES, scattering_count=2)
    path: Any = mi.load_dict({"type": "path", "max_depth": 3})
    truth = np.array(mi.render(scene, integrator=path, spp=TRUTH_SAMPLES, seed=mi.UInt32(9)))
    # The lamp itself is so bright that it would be all of the error
    dim = truth.max(axis=-1) < 1.0

    def error(image: np.ndarray) -> float:
        return float(np.mean((image - truth)[dim] ** 2))

    assert error(frame.image) * LEAST_GAIN < error(frame.noisy)
    assert frame.image.dtype == np.float32
    assert frame.image.shape == frame.noisy.shape == truth.shape
    assert np.isfinite(frame.image).all()
    assert frame.render_seconds > 0.0
    assert frame.denoise_seconds > 0.0


def test_the_guides_are_albedo_and_normal_of_the_first_surface() -> None:
    pytest.importorskip("pyoidn", reason="the extra [denoise] is not installed")
    # A camera above a grey floor that faces up
    scene = mi.load_dict(scenes.floor_under_test(scenes.diffuse(0.6)))
    frame = render_denoised(scene, samples_per_pixel=2)
    assert frame.albedo == pytest.approx(0.6, abs=1e-5)
    assert frame.normal == pytest.approx(np.broadcast_to([0.0, 1.0, 0.0], (16, 16, 3)), abs=1e-5)


def test_without_the_extra_the_error_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(f"No module named {name!r}")

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(DenoiserMissingError, match=r"No module named 'pyoidn'.*\[denoise\]"):
        render_denoised(mi.load_dict(scenes.textured()), samples_per_pixel=1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"samples_per_pixel": 0}, "samples_per_pixel must be at least 1"),
        ({"scattering_count": -1}, "scattering_count must be None or at least 0"),
        ({"sensor": 3}, "sensor 3 does not exist"),
    ],
)
def test_bad_numbers_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        render_denoised(mi.load_dict(scenes.textured()), **{"samples_per_pixel": 1, **change})
