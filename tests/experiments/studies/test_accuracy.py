"""Study "accuracy": its list of checks, and a few of its numbers in the quick version."""

from __future__ import annotations

from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

from experiments.cli import main
from experiments.errors import EXIT_DONE
from experiments.studies import scenes
from experiments.studies.catalogue import checks_of, find_study
from experiments.studies.check import StudyContext
from experiments.studies.exact_voxels import (
    Radiance,
    exact_emittance,
    light_exactly,
    scene_of,
    surfaces_in,
)
from experiments.studies.tracers import Bench, constant_radiance, incident_in, over_phases
from reports.study_record import read_study
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.storage import VoxelVolume
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig
from vctgi.stages.voxelization.opacity import voxelize_opacity

pytestmark = pytest.mark.usefixtures("variant")

RADIANCE = 3.0


def quick_context() -> StudyContext:
    return StudyContext(quick=True, progress=lambda step, share: None)


COLUMN_ROWS = 26
"""Numbers of the table for one column: six of the Cornell box, furnace and squares, eight walls."""

SINGLE_PRECISION = 1e-6


def test_every_check_has_a_name_of_its_own_and_says_with_what() -> None:
    found = checks_of(find_study("accuracy"))
    assert len({check.name for check in found}) == len(found)
    assert all(check.configuration and check.scene for check in found)


@pytest.mark.parametrize("column", ["17 cones", "64 cones"])
def test_a_column_has_one_configuration(column: str) -> None:
    found = [each for each in checks_of(find_study("accuracy")) if each.name.endswith(column)]
    rows = [each for each in found if "against" not in each.name]
    assert len(rows) == COLUMN_ROWS
    assert len({each.configuration for each in rows}) == 1
    assert all(each.limit_low is not None or each.limit_high is not None for each in rows)


@pytest.mark.parametrize(
    "only", ["white furnace, turned, mean, 17 cones", "leak, wall of 2 voxels, axis, 64 cones"]
)
def test_numbers_keep_to_their_limits(only: str, tmp_path: Path) -> None:
    file = tmp_path / "study.json"
    words = ["study", "accuracy", "--quick", "--only", only, "--json", str(file)]
    assert main([*words, "--cache", str(tmp_path)]) == EXIT_DONE
    assert all(row.passed for row in read_study(file).rows)


def test_tracers_of_a_bench_read_the_same_voxels_once() -> None:
    lit = []

    def light(scene: mi.Scene, layout: ClipmapLayout, radiance: Radiance) -> VoxelVolume:
        lit.append(layout)
        return light_exactly(scene, layout, radiance)

    cones = DiffuseConesConfig(cone_count=6)
    bench = Bench(name="two", tracers={"one": cones, "other": cones}, light=light, phases=(2, 1))
    context = quick_context()
    scene = scenes.white_furnace(1, seed=1)
    found = incident_in(context, bench, "furnace", scene)
    incident_in(context, bench, "furnace", scene)
    assert len(lit) == 1
    np.testing.assert_array_equal(found["one"][0], found["other"][0])


def test_phases_are_counted_by_the_version_of_the_study() -> None:
    assert len(over_phases(quick_context(), lambda offset: offset, (8, 3))) == 3


def test_exact_light_fills_every_clip_level() -> None:
    # A furnace of which the finest window holds a corner only.
    scene = scenes.white_furnace(1, seed=1)
    layout = lay_out_clipmap((0.8, 0.8, 0.8), finest_voxel_size=0.05, level_count=3, resolution=16)
    surfaces = surfaces_in(scene_of(scene.triangles))
    opacity = voxelize_opacity(surfaces, layout)
    radiance = constant_radiance(RADIANCE * scene.radiance)
    lit = exact_emittance(opacity, surfaces.vertices, radiance)
    for level in layout.clip_levels:
        alpha = np.array(opacity.levels[level.level])
        assert alpha.max() > 0.0
        found = np.array(lit.levels[level.level])
        np.testing.assert_allclose(found[0], RADIANCE * alpha, rtol=SINGLE_PRECISION)
