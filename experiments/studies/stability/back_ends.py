"""The same cases on the other back end: pictures by CUDA and by LLVM have to be alike."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

import mitsuba as mi
import numpy as np

from experiments.doctor import CUDA_VARIANT, LLVM_VARIANT
from experiments.errors import InputError, MachineryError
from experiments.llvm import require_usable_llvm
from experiments.studies.check import StudyContext
from experiments.studies.stability.case import (
    Limits,
    Outcome,
    StabilityCase,
    mean_difference,
    outcome_of,
)

AGREEMENT: Limits = (None, 0.01)
"""Mean difference: a ray that meets an edge may fall on its other side, and takes a whole cone's or
texel's light with it."""

NAMES = (
    "lamp 1e-08 times as bright",
    "lamp 1e+08 times as bright",
    "room scaled by 0.0001",
    "room scaled by 1e+06",
    "fog of opacity 1 a voxel",
    "fog by a step of a thousandth of a voxel",
    "24 scatterings at albedo 1",
    "floor with slivers of aspect 1e6",
    "frame of 1 x 64 pixels, sparse",
    "camera exactly on a wall",
    "room of mirrors",
    "rgb10a2, lamp 1e+08 times as bright",
)
"""One or two of each family."""

Find = Callable[[str], StabilityCase]
"""Returns a case by its name, for the variant that is set."""


def can_compare() -> bool:
    """Whether CUDA renders, and LLVM could."""
    if mi.variant() != CUDA_VARIANT:
        return False
    try:
        require_usable_llvm()
    except (InputError, MachineryError):
        return False
    return True


def cases(find: Find) -> list[StabilityCase]:
    """Return a case for each of `NAMES`; only for where `can_compare`."""
    return [
        StabilityCase(
            name=f"{name}, by LLVM",
            expected="the picture of CUDA",
            why="both compute the same in single precision, in another order",
            run=partial(_compared, name=name, find=find),
            limits={"mean difference from CUDA": AGREEMENT},
            goals={"mean difference from CUDA": 0.0},
        )
        for name in NAMES
    ]


def difference(expected: list[np.ndarray], found: list[np.ndarray]) -> float:
    """Return the largest mean difference of any picture; one of black must be black."""
    assert len(expected) == len(found), "a case makes as many pictures on all back ends"
    return max(
        mean_difference(picture, truth) if truth.any() else (np.inf if picture.any() else 0.0)
        for truth, picture in zip(expected, found, strict=True)
    )


def pictures_of(variant: str, case_of: Find, name: str, context: StudyContext) -> list[np.ndarray]:
    """Return what a case makes on a back end; another variant is put back after it.

    Raises
    ------
    RuntimeError
        The case broke.
    """
    with _variant(variant):
        outcome = outcome_of(context, case_of(name))
        if outcome is None:
            raise RuntimeError(f"{name} broke on {variant}")
        return [np.array(each, dtype=np.float64) for each in outcome.pictures]


@contextmanager
def _variant(name: str) -> Iterator[None]:
    before = mi.variant()
    mi.set_variant(name)
    try:
        yield
    finally:
        if before is not None:
            mi.set_variant(before)


def _compared(context: StudyContext, name: str, find: Find) -> Outcome:
    def other() -> StudyContext:
        return StudyContext(quick=context.quick, progress=context.progress)

    ours = pictures_of(CUDA_VARIANT, find, name, context)
    # Shared work holds arrays of a back end, so the other has its own.
    theirs = pictures_of(LLVM_VARIANT, find, name, context.once("stability, other back end", other))
    return Outcome(pictures=theirs, numbers={"mean difference from CUDA": difference(ours, theirs)})
