"""Study "stability": its catalogue, some of its cases, and that it sees what is wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest

from experiments.studies.catalogue import checks_of, find_study
from experiments.studies.check import Check, StudyContext
from experiments.studies.stability import HEADLINES, catalogue
from experiments.studies.stability.case import (
    REFUSED,
    UNSOUND,
    Outcome,
    StabilityCase,
    checks_of_case,
    refusal,
    unsound,
)
from reports.study_record import is_within

pytestmark = pytest.mark.usefixtures("variant")

LEAST_CASES = 40

FAST = (
    "lamp 1e+08 times as bright",
    "lamp without power beside a lit one",
    "fog of opacity 1 a voxel",
    "fog by a step of a thousand voxels",
    "triangles of no area",
    "vertex of NaN",
    "frame of 1 x 1 pixels, sparse",
    "camera exactly on a wall",
    "rgb10a2, lamp 1e+08 times as bright",
    "float16, light above 65504",
)


@pytest.fixture(scope="module")
def context(variant: str) -> StudyContext:
    return StudyContext(quick=True, progress=lambda _step, _share: None)


def cases() -> list[StabilityCase]:
    return [case for family in catalogue().values() for case in family]


def passes(check: Check, context: StudyContext) -> bool:
    return is_within(check.measure(context).value, check.limit_low, check.limit_high)


def test_the_catalogue_has_many_cases_with_names_and_reasons() -> None:
    found = cases()
    assert len(found) >= LEAST_CASES
    assert len({case.name for case in found}) == len(found)
    assert all(case.expected and len(case.why.split()) >= 3 for case in found)
    assert all(case.is_sound or case.limits for case in found)


def test_every_check_has_a_name_of_its_own_and_says_with_what() -> None:
    found = checks_of(find_study("stability"))
    assert [each.name for each in found if each.is_headline] == [*HEADLINES]
    assert all(each.in_quick for each in found if each.is_headline)
    assert len({check.name for check in found}) == len(found)
    assert all(check.configuration and check.scene for check in found)
    limited = [check for check in found if (check.limit_low, check.limit_high) != (None, None)]
    assert limited == found


@pytest.mark.parametrize("name", FAST)
def test_fast_cases_keep_to_their_limits(name: str, context: StudyContext) -> None:
    (case,) = [case for case in cases() if case.name == name]
    assert case.in_quick
    for check in checks_of_case(case, "of this test"):
        assert passes(check, context), check.name


@pytest.mark.parametrize("planted", [math.nan, math.inf, -1e-9])
def test_one_value_that_is_no_light_fails_a_case(planted: float, context: StudyContext) -> None:
    picture = np.ones((4, 4, 3))
    picture[1, 2, 0] = planted
    assert unsound(picture) == 1
    case = StabilityCase(
        name=f"planted {planted}",
        expected="light",
        why="this test says so",
        run=lambda _context: Outcome(pictures=[picture]),
    )
    (check,) = checks_of_case(case, "of this test")
    assert check.name.endswith(UNSOUND)
    assert not passes(check, context)


def test_a_case_that_breaks_fails_alone_and_says_why(
    context: StudyContext, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(_context: StudyContext) -> Outcome:
        raise RuntimeError("out of\nvoxels")

    case = StabilityCase(name="broken", expected="light", why="this test says so", run=broken)
    (check,) = checks_of_case(case, "of this test")
    assert not passes(check, context)
    assert capsys.readouterr().err == "broken: RuntimeError: out of voxels\n"


def raises(message: str) -> object:
    raise ValueError(message)


@pytest.mark.parametrize(
    ("message", "is_clear"),
    [("step is 0: raise it", True), ("step\nis 0", False), ("something else", False), ("", False)],
)
def test_only_one_line_that_names_the_fault_is_a_refusal(
    message: str, is_clear: bool, context: StudyContext
) -> None:
    case = refusal(f"refused {message}", "this test says so", lambda: raises(message), "step")
    (check,) = checks_of_case(case, "of this test")
    assert check.name.endswith(REFUSED)
    assert passes(check, context) == is_clear


def test_what_is_rendered_is_no_refusal(context: StudyContext) -> None:
    case = refusal("nothing refused", "this test says so", lambda: None)
    (check,) = checks_of_case(case, "of this test")
    assert not passes(check, context)
