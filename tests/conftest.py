"""Back ends as fixtures, and the modes that every test runs under."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator

import pytest
from hypothesis import settings

from experiments.doctor import CUDA_VARIANT, LLVM_VARIANT, diagnose_cuda
from experiments.llvm import require_usable_llvm

# The first example compiles kernels, so that no deadline would be met
settings.register_profile("local", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("ci" if os.environ.get("CI") else "local")

_HAS_CUDA = diagnose_cuda().is_usable
_VARIANTS = [
    LLVM_VARIANT,
    *([pytest.param(CUDA_VARIANT, marks=pytest.mark.gpu)] if _HAS_CUDA else []),
]


@pytest.fixture(scope="module", params=_VARIANTS)
def variant(request: pytest.FixtureRequest) -> Iterator[str]:
    """Set a Mitsuba variant for a module's tests, and give its memory back after them."""
    name: str = request.param
    if name == LLVM_VARIANT:
        # Not a matter of taste: an unusable LLVM would end the test run without a report
        require_usable_llvm()
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(name)
    mi.set_log_level(mi.LogLevel.Warn)
    yield name
    gc.collect()
    dr.flush_malloc_cache()
