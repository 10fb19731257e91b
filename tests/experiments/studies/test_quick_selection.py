"""What `--quick --only` selects can be measured, also where the quick version leaves it out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from experiments.errors import InputError
from experiments.studies.aliasing import moved_rooms
from experiments.studies.aliasing.moved_rooms import HOWS, QUICK_HOWS, MovedRoom
from experiments.studies.catalogue import STUDIES, checks_of, select_checks
from experiments.studies.check import StudyContext
from experiments.studies.run import measured_row

SMALL = ("light", "leaking", "banding")
"""Studies of which a check that the quick version leaves out takes seconds."""


def quick_context() -> StudyContext:
    return StudyContext(quick=True, progress=lambda _step, _share: None)


@pytest.mark.parametrize("study", STUDIES)
def test_a_check_can_be_asked_for_by_its_name_alone(variant: str, study: str) -> None:
    """Each is selected, quick or not; what is left out is left out without `--only` alone."""
    known = checks_of(STUDIES[study])
    for check in known:
        assert select_checks(known, check.name, quick=True) == [check]
    unasked = select_checks(known, None, quick=True)
    assert unasked == [check for check in known if check.in_quick]
    with pytest.raises(InputError, match="no check holds 'no such name'"):
        select_checks(known, "no such name", quick=True)


def test_a_moved_thing_is_injected_in_the_way_that_is_asked_for(
    variant: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The quick version renders two ways of three, and the third only where it is named."""
    rendered: list[tuple[str, ...]] = []

    def render(
        _context: StudyContext, _mover: str, _level: int, hows: tuple[str, ...]
    ) -> MovedRoom:
        rendered.append(hows)
        rng = np.random.default_rng(3)
        light = rng.uniform(0.5, 1.5, (16, 4, 3))
        return MovedRoom(
            places=np.arange(16) / 8.0,
            powers={how: np.ones(16) for how in hows},
            light={how: light for how in hows},
            batches=1.2 * rng.uniform(0.5, 1.5, (16, 4, 3)) + 1e-6 * rng.random((4, 16, 4, 3)),
        )

    monkeypatch.setattr(moved_rooms, "_move", render)
    context = quick_context()
    known = select_checks(checks_of(STUDIES["aliasing"]), "moved light, level 1", quick=True)
    for check in known:
        assert measured_row("aliasing", check, context).value is not None, check.name
    # Once for the ways of the quick version, and once for all
    assert sorted(rendered) == sorted([QUICK_HOWS, HOWS])


@pytest.mark.slow
@pytest.mark.parametrize("study", SMALL)
def test_what_the_quick_version_leaves_out_is_measured_when_named(variant: str, study: str) -> None:
    known = checks_of(STUDIES[study])
    left_out = next(check for check in known if not check.in_quick)
    (chosen,) = select_checks(known, left_out.name, quick=True)
    measure: Callable[[StudyContext], object] = chosen.measure
    measure(quick_context())
