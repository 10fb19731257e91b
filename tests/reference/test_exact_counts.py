"""Light of exactly j scatterings, by lobe: what it adds up to, and what it is alone."""

from __future__ import annotations

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from reference import Reference, ReferenceRequest, render_reference
from tests.reference import reference_scenes as scenes
from tests.reference.statistics_of_images import (
    SIGNIFICANCE,
    assert_same_expectation,
    least_p_value,
    path_batches,
)

BATCHES = 12
SAMPLES = 24
"""Per batch."""
COUNT = 3
REQUEST = ReferenceRequest(
    samples_per_pixel=SAMPLES * BATCHES,
    batch_count=BATCHES,
    scattering_count=COUNT,
    rest_samples_per_pixel=SAMPLES * BATCHES,
    is_split_by_count=True,
)
ROUNDING = 1e-5
"""Relative to the brightest pixel: float32 sums in another order."""


def trace(scene: mi.Scene, request: ReferenceRequest = REQUEST) -> Reference:
    return render_reference(scene, request=request, cache_directory=None)


@pytest.fixture(scope="module")
def mixed(variant: str) -> tuple[mi.Scene, Reference]:
    """Every kind of surface, with its reference."""
    mi.set_variant(variant)
    scene = mi.load_dict(scenes.mixed_materials())
    return scene, trace(scene)


def test_all_counts_and_the_rest_add_up_to_the_path_tracer(
    mixed: tuple[mi.Scene, Reference],
) -> None:
    scene, reference = mixed
    assert list(reference.components) == REQUEST.component_names()
    total = np.sum([batches for batches in reference.components.values()], axis=0)
    unlimited = path_batches(scene, -1, samples=SAMPLES, count=BATCHES)
    assert_same_expectation(total, unlimited)
    # The test has power: the light of one count less, or 5 % more of all, would be seen
    assert least_p_value(total - reference.batches("indirect_3"), unlimited) < SIGNIFICANCE
    assert least_p_value(1.05 * total, unlimited) < SIGNIFICANCE


def test_each_count_alone_is_a_difference_of_two_path_tracers(
    mixed: tuple[mi.Scene, Reference],
) -> None:
    scene, reference = mixed
    for count in range(2, COUNT + 1):
        shorter = path_batches(scene, count, samples=SAMPLES, count=BATCHES, seed=7)
        longer = path_batches(scene, count + 1, samples=SAMPLES, count=BATCHES, seed=99)
        assert_same_expectation(shorter + reference.batches(f"indirect_{count}"), longer)
        variance = reference.variance_of_mean(f"indirect_diffuse_{count}")
        assert variance.shape == reference.mean("image").shape
        assert (variance >= 0.0).all()
        assert variance.any()


def test_the_counts_add_up_to_what_is_not_split(mixed: tuple[mi.Scene, Reference]) -> None:
    """The same random numbers make the same paths, so this holds sample by sample."""
    scene, split = mixed
    whole = trace(scene, replace(REQUEST, is_split_by_count=False))
    for name in ("emission", "direct", "indirect_diffuse", "indirect_specular", "image", "rest"):
        brightest = whole.batches(name).max()
        difference = np.abs(split.batches(name) - whole.batches(name)).max()
        assert difference <= ROUNDING * brightest, name
    assert split.key != whole.key


def test_a_closed_furnace_has_its_closed_form_at_every_count() -> None:
    """In a box of one emission e and one albedo a, j scatterings carry e a^j to every pixel."""
    emission, albedo = 2.0, 0.5
    scene = mi.load_dict(
        {
            "type": "scene",
            "sensor": scenes.camera([0, 0, 0], [0, 0, 1], film=scenes.film(8, 8)),
            "walls": {
                "type": "cube",
                "flip_normals": True,
                "bsdf": scenes.diffuse(albedo),
                "emitter": scenes.area_light(emission),
            },
        }
    )
    reference = trace(scene)
    for count in range(2, COUNT + 1):
        found = reference.batches(f"indirect_{count}").mean(axis=(1, 2, 3), dtype=np.float64)
        error = found.std(ddof=1) / np.sqrt(BATCHES)
        # Five standard errors, and rounding where a sample has no variance at all
        assert abs(found.mean() - emission * albedo**count) <= 5.0 * error + 1e-5
    rest = float(reference.mean("rest").mean())
    assert rest == pytest.approx(emission * albedo ** (COUNT + 1) / (1 - albedo), rel=0.02)


def test_one_scattering_has_no_indirect_light_to_split() -> None:
    request = ReferenceRequest(samples_per_pixel=8, scattering_count=1, is_split_by_count=True)
    reference = trace(mi.load_dict(scenes.textured()), request)
    assert list(reference.components) == ["emission", "direct", "rest_diffuse", "rest_specular"]
    assert not reference.batches("indirect").any()
    assert reference.batches("image") == pytest.approx(
        reference.batches("emission") + reference.batches("direct")
    )


def test_a_count_that_is_not_held_is_an_error() -> None:
    batches = np.zeros((BATCHES, 1, 1, 3), np.float32)
    reference = Reference(
        components=dict.fromkeys(REQUEST.component_names(), batches),
        key="",
        request=REQUEST,
        seconds=0.0,
        from_cache=False,
        notes=[],
    )
    with pytest.raises(ValueError, match="no component named 'indirect_4'"):
        reference.mean("indirect_4")
