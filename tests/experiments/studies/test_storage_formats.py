"""Storage formats on a rendered scene: bytes, errors within bounds, a picture that hardly moves."""

from __future__ import annotations

import pytest

from experiments.studies.check import Check, StudyContext
from experiments.studies.representation.formats import checks

pytestmark = pytest.mark.usefixtures("variant")


@pytest.fixture(scope="module")
def context(variant: str) -> StudyContext:
    return StudyContext(quick=True, progress=lambda step, share: None)


def chosen(words: str) -> list[Check]:
    return [check for check in checks() if words in check.name]


def test_every_check_has_a_name_of_its_own() -> None:
    names = [check.name for check in checks()]
    assert len(set(names)) == len(names)


def test_the_talks_format_takes_the_talks_bytes(context: StudyContext) -> None:
    found = [check.measure(context).value for check in chosen("rgb10a2")[:1]]
    assert found == [32.0]
    found = [check.measure(context).value for check in chosen("rgb10a2 x3: bytes")]
    assert found == [16.0]


@pytest.mark.parametrize("name", ["float32 x6", "float16 x6", "rgb10a2 x6", "srgb8 x6", "rgba8 x6"])
def test_a_rendered_scene_stays_within_the_bound(name: str, context: StudyContext) -> None:
    (check,) = chosen(f"{name}: error over bound")
    assert check.limit_high == 1.0
    assert check.measure(context).value <= 1.0


def test_a_picture_from_compact_voxels_keeps_to_its_limits(context: StudyContext) -> None:
    for check in [*chosen("rgb10a2 x6: relMSE"), *chosen("rgb10a2 x6: energy")]:
        value = check.measure(context).value
        assert check.limit_high is not None
        assert value <= check.limit_high
        assert check.limit_low is None or value >= check.limit_low


def test_reads_are_timed_on_the_device(context: StudyContext) -> None:
    (check,) = chosen("float16 x6: ns a coherent read")
    measured = check.measure(context)
    assert measured.value > 0.0
    assert measured.low is not None
