"""Study "aliasing": its truth against paths, moves by whole voxels, and a pre-filter left out."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.studies.aliasing.light_tracing import traced_light
from experiments.studies.aliasing.moved_rooms import (
    LEVELS,
    cone_light,
    moved_scene,
    wall_points,
    windows,
)
from experiments.studies.catalogue import checks_of, find_study
from experiments.studies.light.injections import INJECTIONS
from experiments.studies.light.lit_rooms import light_points, power, slot_power
from metrics.aliasing import power_ripple, recentring_difference, temporal_difference_rms
from reference import probe_irradiance

pytestmark = pytest.mark.usefixtures("variant")

STILL = np.zeros(3)

ERRORS = 4.0
"""Standard errors between two means of independent batches."""

ROUNDING = 1e-4
"""Relative: single precision in scenes that are moved by several windows."""


def test_every_check_has_a_name_of_its_own_and_says_with_what() -> None:
    found = checks_of(find_study("aliasing"))
    assert len({check.name for check in found}) == len(found)
    assert all(check.configuration and check.scene for check in found)


def test_paths_from_the_lamp_agree_with_the_reference() -> None:
    scene = moved_scene(STILL, STILL, STILL)
    points, normals = wall_points(30)
    ours = np.array([traced_light(scene, points, normals, 256, seed).mean() for seed in range(8)])
    found = probe_irradiance(scene, points, normals, samples=8 * 8192, batch_count=8)
    theirs = found.batches("indirect").mean(axis=(1, 2)) / np.pi
    error = np.sqrt((ours.var(ddof=1) + theirs.var(ddof=1)) / 8.0)
    assert abs(ours.mean() - theirs.mean()) < ERRORS * error
    assert error < 0.02 * theirs.mean()


@pytest.mark.parametrize("level", range(LEVELS))
def test_what_is_lit_lies_in_its_level_and_in_no_finer_one(level: int) -> None:
    layout = windows(level)
    points = light_points(moved_scene(STILL, STILL, STILL), layout)
    (lit,) = points.maps
    at = np.array(lit.position, dtype=np.float64).T
    at = at[np.array(lit.reflected_flux)[1] > 0.0]
    voxel = layout.levels[level].voxel_size

    def is_held(number: int, margin: float) -> np.ndarray:
        window = layout.levels[number]
        low, high = np.array(window.window_min) + margin, np.array(window.window_max) - margin
        return np.asarray(((at > low) & (at < high)).all(axis=1))

    assert is_held(level, 2.0 * voxel).all()
    assert level == 0 or not is_held(level - 1, -2.0 * voxel).any()


def test_moves_by_whole_voxels_change_nothing_and_others_do() -> None:
    points, normals = wall_points(30)
    found = []
    for moved in (STILL, np.array([4.0, -4.0, 8.0]), np.array([0.03, 0.0, 0.0])):
        whole = moved if moved[0] > 1.0 else STILL
        lit = light_points(moved_scene(moved, STILL, STILL), windows(0, whole=whole))
        emittance = lit.inject(INJECTIONS["scatter"])
        found.append(cone_light(lit, emittance, points + moved, normals)[:, None])
    assert recentring_difference(found[0], found[1]) < ROUNDING
    assert recentring_difference(found[0], found[2]) > 10.0 * ROUNDING


def test_ripple_and_change_without_a_good_injection_are_found() -> None:
    # The planted fault: voxels take the one texel that is nearest to their middle.
    level = 1
    points, normals = wall_points(30)
    layout = windows(level)
    voxel = layout.levels[level].voxel_size
    names = ("scatter 3 wide", "scatter", "centre")
    powers: dict[str, list[float]] = {name: [] for name in names}
    light: dict[str, list[np.ndarray]] = {name: [] for name in names}
    truth = []
    for place in (0.0, 0.125, 0.25, 0.375, 0.5):
        scene = moved_scene(STILL, STILL, np.array([place * voxel, 0.0, 0.0]))
        lit = light_points(scene, layout)
        expected = slot_power(lit, 3, level)
        truth.append(np.stack([traced_light(scene, points, normals, 256, s) for s in range(4)]))
        for name in names:
            emittance = lit.inject(INJECTIONS[name])
            powers[name].append(power(emittance, level) / expected)
            light[name].append(cone_light(lit, emittance, points, normals))
    ripple = {name: power_ripple(values).value for name, values in powers.items()}
    assert ripple["scatter 3 wide"] < 1e-5
    assert ripple["scatter 3 wide"] < ripple["scatter"] < ripple["centre"]
    assert ripple["centre"] > 0.01
    batches = np.stack(truth, axis=1)
    change = {
        name: temporal_difference_rms(np.stack(values), batches) for name, values in light.items()
    }
    assert change["centre"].low is not None
    assert change["scatter"].high is not None
    assert change["centre"].low > change["scatter"].high
    still = temporal_difference_rms(batches.mean(axis=0), batches)
    assert still.value < 0.2 * change["scatter 3 wide"].value
