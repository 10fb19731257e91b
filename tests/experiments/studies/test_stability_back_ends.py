"""Stiff cases come out alike on both back ends."""

from __future__ import annotations

from collections.abc import Iterator

import mitsuba as mi
import numpy as np
import pytest

from experiments.doctor import CUDA_VARIANT, LLVM_VARIANT, diagnose_cuda
from experiments.llvm import require_usable_llvm
from experiments.studies.check import StudyContext
from experiments.studies.stability import catalogue
from experiments.studies.stability.case import mean_difference, outcome_of

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not diagnose_cuda().is_usable, reason="no CUDA device"),
]

MOST = 0.01
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


@pytest.fixture(autouse=True)
def variant_is_put_back() -> Iterator[None]:
    before = mi.variant()
    yield
    if before is not None:
        mi.set_variant(before)


def pictures(variant: str, name: str) -> list[np.ndarray]:
    mi.set_variant(variant)
    context = StudyContext(quick=True, progress=lambda _step, _share: None)
    (case,) = [case for family in catalogue().values() for case in family if case.name == name]
    outcome = outcome_of(context, case)
    assert outcome is not None
    return [np.array(each, dtype=np.float64) for each in outcome.pictures]


@pytest.mark.parametrize("name", NAMES)
def test_both_back_ends_make_the_same_pictures(name: str) -> None:
    require_usable_llvm()
    truth, found = (pictures(variant, name) for variant in (LLVM_VARIANT, CUDA_VARIANT))
    for expected, picture in zip(truth, found, strict=True):
        if expected.any():
            assert mean_difference(picture, expected) <= MOST
        else:
            assert not picture.any()
