"""The components add up to Mitsuba's path tracer, and each one is what its name says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from reference import Reference, ReferenceRequest, render_reference
from reference.components import heeds_lobe_mask
from tests.reference import reference_scenes as scenes
from tests.reference.statistics_of_images import (
    SIGNIFICANCE,
    assert_same_expectation,
    least_p_value,
    path_batches,
)

BATCHES = 12
SAMPLES = 48
"""Per batch."""
REQUEST = ReferenceRequest(
    samples_per_pixel=SAMPLES * BATCHES,
    batch_count=BATCHES,
    rest_samples_per_pixel=SAMPLES * BATCHES,
)
WITHOUT_REST = replace(REQUEST, rest_samples_per_pixel=0)
SCENES = [scenes.cornell, scenes.mixed_materials, scenes.under_a_sky]


def trace(scene: dict[str, Any], request: ReferenceRequest = WITHOUT_REST) -> Reference:
    return render_reference(mi.load_dict(scene), request=request, cache_directory=None)


@pytest.mark.parametrize("make_scene", SCENES)
def test_components_add_up_to_the_path_tracer(make_scene: Callable[[], dict[str, Any]]) -> None:
    scene = mi.load_dict(make_scene())
    reference = render_reference(scene, request=REQUEST, cache_directory=None)
    image = reference.batches("image")
    up_to_two = path_batches(scene, 3, samples=SAMPLES, count=BATCHES)
    unlimited = path_batches(scene, -1, samples=SAMPLES, count=BATCHES)
    assert_same_expectation(image, up_to_two)
    assert_same_expectation(image + reference.batches("rest"), unlimited)
    # The test has power: 5 % more light, or the missing rest, would be seen
    assert least_p_value(1.05 * image, up_to_two) < SIGNIFICANCE
    assert least_p_value(image, unlimited) < SIGNIFICANCE


@pytest.mark.parametrize("scattering_count", [1, 3])
def test_other_scattering_counts_add_up(scattering_count: int) -> None:
    scene = mi.load_dict(scenes.mixed_materials())
    request = replace(REQUEST, scattering_count=scattering_count)
    reference = render_reference(scene, request=request, cache_directory=None)
    limited = path_batches(scene, scattering_count + 1, samples=SAMPLES, count=BATCHES)
    unlimited = path_batches(scene, -1, samples=SAMPLES, count=BATCHES)
    assert_same_expectation(reference.batches("image"), limited)
    assert_same_expectation(reference.batches("image") + reference.batches("rest"), unlimited)
    if scattering_count == 1:
        assert not reference.batches("indirect").any()


def test_emission_and_direct_are_those_of_the_path_tracer() -> None:
    scene = mi.load_dict(scenes.cornell())
    reference = render_reference(scene, request=WITHOUT_REST, cache_directory=None)
    emission = path_batches(scene, 1, samples=SAMPLES, count=BATCHES)
    up_to_one = path_batches(scene, 2, samples=SAMPLES, count=BATCHES)
    assert_same_expectation(reference.batches("emission"), emission)
    assert_same_expectation(reference.batches("emission") + reference.batches("direct"), up_to_one)


CONDUCTOR = {"type": "roughconductor", "alpha": 0.3}
SHARE = 0.3


def test_a_blend_splits_into_its_ingredients() -> None:
    """A blend of weight w gives (1 - w) of one surface as diffuse and w of the other as not."""
    mixture = {"type": "blendbsdf", "weight": SHARE, "a": scenes.diffuse(), "b": CONDUCTOR}
    bsdf = {"type": "twosided", "inner": mixture}
    blend = trace(scenes.floor_under_test(bsdf))
    diffuse = trace(scenes.floor_under_test(scenes.diffuse()))
    conductor = trace(scenes.floor_under_test(CONDUCTOR))
    assert_same_expectation(
        blend.batches("indirect_diffuse"), (1 - SHARE) * diffuse.batches("indirect_diffuse")
    )
    assert_same_expectation(
        blend.batches("indirect_specular"), SHARE * conductor.batches("indirect_specular")
    )


def test_a_mask_keeps_its_opacity_of_the_diffuse_part() -> None:
    """Below the floor it is dark, so what passes the mask carries nothing."""
    bsdf = {"type": "mask", "opacity": SHARE, "inner": scenes.diffuse()}
    masked = trace(scenes.floor_under_test(bsdf))
    diffuse = trace(scenes.floor_under_test(scenes.diffuse()))
    assert_same_expectation(
        masked.batches("indirect_diffuse"), SHARE * diffuse.batches("indirect_diffuse")
    )
    assert not masked.batches("indirect_specular").any()


def test_passing_a_mask_is_a_scattering_and_shadow_rays_stop_at_it() -> None:
    """What a fully transparent veil lets through is direct light without it, indirect with it."""
    scene = {
        "type": "scene",
        "sensor": scenes.camera([0, 1, 0.5], [0, 0, 0], 30.0, film=scenes.film(16, 16)),
        "floor": scenes.rectangle([0, 0, 0], size=2.0, bsdf=scenes.diffuse()),
        "light": scenes.rectangle([0, 3, 0], 90.0, 2.0, emitter=scenes.area_light(2.0)),
    }
    veil = scenes.rectangle(
        [0, 2, 0], size=6.0, bsdf={"type": "mask", "opacity": 0.0, "inner": scenes.diffuse()}
    )
    bare, veiled = trace(scene), trace(scene | {"veil": veil})
    assert not veiled.batches("direct").any()
    assert_same_expectation(veiled.batches("indirect_diffuse"), bare.batches("direct"))
    assert any("shadow rays stop" in note for note in veiled.notes)


def test_without_other_lobes_indirect_specular_is_zero_and_said_to_be() -> None:
    reference = trace(scenes.cornell(), ReferenceRequest(samples_per_pixel=8))
    assert not reference.batches("indirect_specular").any()
    assert any("indirect_specular is exactly zero" in note for note in reference.notes)


def test_a_bsdf_that_hides_its_lobes_is_named() -> None:
    reference = trace(scenes.under_a_sky(), ReferenceRequest(samples_per_pixel=8))
    note = next(note for note in reference.notes if "lobes apart" in note)
    assert note.startswith("Principled")
    assert reference.mean("indirect_diffuse").mean() > 0.0
    assert reference.mean("indirect_specular").mean() > 0.0


@pytest.mark.parametrize(
    ("bsdf", "is_heeded"),
    [
        ({"type": "plastic"}, True),
        ({"type": "roughplastic"}, True),
        ({"type": "twosided", "inner": {"type": "roughplastic"}}, True),
        ({"type": "mask", "inner": {"type": "roughplastic"}}, True),
        ({"type": "principled"}, False),
        ({"type": "twosided", "inner": {"type": "principled"}}, False),
    ],
)
def test_which_bsdfs_evaluate_their_lobes_apart(bsdf: dict[str, Any], is_heeded: bool) -> None:
    assert heeds_lobe_mask(mi.load_dict(bsdf)) is is_heeded


def test_samples_that_are_not_finite_are_an_error() -> None:
    scene = scenes.textured() | {
        "light": {"type": "constant", "radiance": scenes.grey(float("inf"))}
    }
    with pytest.raises(RuntimeError, match=r"component 'emission' .* in \d+ pixels, the first"):
        trace(scene, ReferenceRequest(samples_per_pixel=8))


def test_a_scene_without_light_is_black() -> None:
    scene = scenes.textured()
    del scene["light"]
    reference = trace(scene, ReferenceRequest(samples_per_pixel=8))
    assert not any(batches.any() for batches in reference.components.values())


def test_batches_are_independent_and_their_number_does_not_move_the_mean() -> None:
    many = trace(scenes.cornell(), ReferenceRequest(samples_per_pixel=256, batch_count=16))
    few = trace(scenes.cornell(), ReferenceRequest(samples_per_pixel=256, batch_count=4))
    assert_same_expectation(many.batches("image"), few.batches("image"))
    # Differences of disjoint pairs are symmetric about zero whatever the noise looks like, so the
    # products of their signs are fair coins unless pairs share random numbers
    green = many.batches("indirect")[..., 1].reshape(16, -1)
    signs = np.sign(green[0::2] - green[1::2])
    agreement = (signs @ signs.T / (signs**2 @ (signs**2).T))[np.triu_indices(8, 1)]
    # Five standard errors of a coin's mean, for 28 pairs of pairs
    assert np.abs(agreement).max() < 5.0 / np.sqrt(green.shape[1])
