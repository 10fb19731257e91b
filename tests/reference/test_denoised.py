"""Denoised path tracing beats what it started from; without the extra it says how to get it."""

from __future__ import annotations

import importlib
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from reference import DenoiserMissingError, render_denoised
from tests.reference import reference_scenes as scenes

LEAST_GAIN = 5.0
"""Median over pixels of the squared error, before over after; measured 11 at 4 paths a pixel of a
64 x 64 Cornell box and 6 at 16. The mean falls only to 0.78 and 0.25: what is left of it lies at
the edge of the lamp, which a denoiser smears over a few pixels."""
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
    before, after = (np.mean((image - truth) ** 2, axis=-1) for image in (frame.noisy, frame.image))
    assert np.median(after) * LEAST_GAIN < np.median(before)
    assert after.mean() < before.mean()
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
