"""Parameters of a configuration: read, written, bounded, refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from experiments.errors import InputError
from experiments.optimize.find_parameters import find_parameters, parameter_names
from experiments.optimize.frames import live_numbers, tangents_of
from experiments.optimize.parameters import CHOICES, SINGLE, Parameter, write_point
from vctgi.config import RenderConfig, preset
from vctgi.parameters import ConeParameters

HIGH = preset("high")
ALL = [name for name in parameter_names() if name not in CHOICES]


def each_parameter() -> list[Parameter]:
    return find_parameters(ALL, HIGH)


@pytest.mark.parametrize("parameter", each_parameter(), ids=lambda each: each.name)
def test_what_is_written_is_read(parameter: Parameter) -> None:
    start = parameter.read(HIGH)
    assert parameter.low <= start <= parameter.high
    assert parameter.outer(parameter.inner(start)) == pytest.approx(start)
    value = 0.5 * (start + parameter.high)
    assert parameter.read(parameter.write(HIGH, value)) == pytest.approx(value)
    assert parameter.outer(parameter.inner_bounds[1] + 1.0) == parameter.high
    assert parameter.reason


def test_all_together_are_written_side_by_side() -> None:
    parameters = each_parameter()
    values = [0.5 * (each.read(HIGH) + each.high) for each in parameters]
    config = write_point(HIGH, parameters, values)
    assert [each.read(config) for each in parameters] == pytest.approx(values)


def test_a_ring_moves_its_cones_alone() -> None:
    (_, second, _) = find_parameters(["apertures"], HIGH)
    after = second.write(HIGH, 0.6).diffuse.cones()
    before = HIGH.diffuse.cones()
    moved = [a != b for a, b in zip(before.apertures, after.apertures, strict=True)]
    # Seventeen cones stand as 1, 6 and 10.
    assert moved == [False] + [True] * 6 + [False] * 10
    assert after.directions == before.directions


def test_weights_are_ratios_and_sum_to_one() -> None:
    pole, ring = find_parameters(["weights"], HIGH)
    weights = ring.write(pole.write(HIGH, 2.0), 3.0).diffuse.cones().weights
    assert math.fsum(weights) == pytest.approx(1.0)
    assert [weights[0] / weights[-1], weights[1] / weights[-1]] == pytest.approx([2.0, 3.0])


def test_another_count_of_cones_forgets_what_was_set_cone_by_cone() -> None:
    (count,) = find_parameters(["cone_count"], HIGH)
    (aperture, *_) = find_parameters(["apertures"], HIGH)
    changed = count.write(aperture.write(HIGH, 0.6), 9)
    assert changed.diffuse == replace(HIGH.diffuse, cone_count=9)
    assert count.outer(10.9) == 12


def test_each_choice_is_written_and_read() -> None:
    for choice in find_parameters(list(CHOICES), HIGH):
        assert choice.options is not None
        for option in choice.options:
            assert choice.read(choice.write(HIGH, option)) == option
            assert choice.outer(choice.inner(option)) == option
    once = CHOICES["traced_once"].write(HIGH, 1)
    assert once.reconstruction.is_traced_once


@pytest.mark.parametrize(
    ("names", "preset_name", "words"),
    [
        (["brightness"], "high", "no parameter 'brightness'"),
        ([], "high", "no parameter is named"),
        (["near_field"], "medium", "'near_field' is 0"),
        (["max_contrast"], "medium", "'max_contrast' is inf"),
        (["apertures"], "peer:compix", "have none"),
        (["cone_count", "weights"], "high", "other rings"),
    ],
)
def test_what_cannot_be_fitted_is_refused(names: list[str], preset_name: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        find_parameters(names, preset(preset_name))


def test_arrays_and_numbers_of_the_cones_agree(variant: str) -> None:
    config: RenderConfig = SINGLE["aperture_scale"].write(HIGH, 1.2)
    live, numbers = ConeParameters.from_config(config), live_numbers(config)
    for name, values in numbers.items():
        assert np.array(live[name]) == pytest.approx(values, rel=1e-6, abs=1e-6), name


def test_tangents_say_how_a_parameter_moves_the_arrays() -> None:
    scale = tangents_of(HIGH, SINGLE["aperture_scale"])
    # By the logarithm: d scale / d ln scale = scale.
    assert list(scale) == ["aperture_scale"]
    assert scale["aperture_scale"] == pytest.approx([1.0])
    assert tangents_of(HIGH, SINGLE["start_offset"])["start_offset_voxels"] == pytest.approx([1.0])
    # Rays of the near field are not part of the march.
    assert tangents_of(HIGH, SINGLE["near_field"]) == {}
    (pole, _) = find_parameters(["weights"], HIGH)
    shares = tangents_of(HIGH, pole)["weights"]
    assert shares.sum() == pytest.approx(0.0, abs=1e-9)
