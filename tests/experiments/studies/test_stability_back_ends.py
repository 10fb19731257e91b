"""Stiff cases come out alike on both back ends."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.doctor import CUDA_VARIANT, LLVM_VARIANT, diagnose_cuda
from experiments.llvm import require_usable_llvm
from experiments.studies.check import StudyContext
from experiments.studies.stability import find_case
from experiments.studies.stability.back_ends import (
    AGREEMENT,
    NAMES,
    cases,
    difference,
    pictures_of,
)


def context() -> StudyContext:
    return StudyContext(quick=True, progress=lambda _step, _share: None)


@pytest.mark.gpu
@pytest.mark.skipif(not diagnose_cuda().is_usable, reason="no CUDA device")
@pytest.mark.parametrize("name", NAMES)
def test_both_back_ends_make_the_same_pictures(name: str) -> None:
    require_usable_llvm()
    truth, found = (
        pictures_of(variant, find_case, name, context()) for variant in (LLVM_VARIANT, CUDA_VARIANT)
    )
    most = AGREEMENT[1]
    assert most is not None
    assert difference(truth, found) <= most


@pytest.mark.usefixtures("variant")
def test_each_case_is_one_of_the_catalogue_and_its_own_twin(variant: str) -> None:
    assert len(cases(find_case)) == len(NAMES)
    assert all(find_case(name).is_sound for name in NAMES)
    shared = context()
    name = "fog of opacity 1 a voxel"
    first, again = (pictures_of(variant, find_case, name, shared) for _ in range(2))
    assert difference(first, again) == 0.0


def test_a_picture_that_is_not_black_differs_from_one_that_is() -> None:
    black, grey = np.zeros((2, 2, 3)), np.full((2, 2, 3), 0.5)
    assert difference([black], [black]) == 0.0
    assert difference([black], [grey]) == np.inf
    assert difference([grey, black], [1.02 * grey, black]) == pytest.approx(0.02)
