"""Specular part of the study "accuracy": its list of checks, and the numbers that decide bands."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.studies.accuracy.glossy import steps_to
from experiments.studies.accuracy.specular import checks
from experiments.studies.check import StudyContext
from reports.study_record import is_within
from vctgi.stages.cone_tracing.specular import specular_march

pytestmark = pytest.mark.usefixtures("variant")


def test_every_check_has_a_name_of_its_own_and_says_with_what() -> None:
    found = checks()
    assert len({check.name for check in found}) == len(found)
    assert all(check.configuration and check.scene for check in found)


def test_table_of_lobes_keeps_to_its_limits() -> None:
    context = StudyContext(quick=True, progress=lambda _step, _share: None)
    chosen = [check for check in checks() if check.name.startswith("lobe of roughconductor, ggx")]
    assert len(chosen) == 2
    for check in chosen:
        value = check.measure(context).value
        assert is_within(value, check.limit_low, check.limit_high), f"{check.name}: {value}"


def test_steps_are_counted_as_the_march_takes_them() -> None:
    march, voxel_size, aperture = specular_march(1.0), 0.1, 0.3
    growth = march.step_ratio * 2.0 * np.tan(0.5 * aperture)
    t, marched = march.start_offset_voxels * voxel_size, []
    while t < 5.0:
        marched.append(t)
        t += max(growth * t, march.min_step_voxels * voxel_size)
    counted = steps_to(np.array(marched), np.full(len(marched), aperture), march, voxel_size)
    # Where even steps end, one of them straddles the turn.
    np.testing.assert_allclose(counted, np.arange(len(marched)), atol=0.2)
    np.testing.assert_allclose(np.diff(counted)[-5:], 1.0, atol=1e-6)
