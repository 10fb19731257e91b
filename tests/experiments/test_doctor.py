"""The doctor names each fault with its remedy, and a variant is chosen only if it will run."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from experiments import cuda, doctor
from experiments.doctor import (
    CUDA_VARIANT,
    LLVM_VARIANT,
    Backend,
    Diagnosis,
    Package,
    choose_variant,
    diagnose,
    diagnose_cuda,
    report_lines,
)
from experiments.errors import InputError, MachineryError
from experiments.llvm import LlvmLibrary

HEALTHY_DRIVER: dict[str, Any] = {
    "has_driver": True,
    "has_ray_tracing": True,
    "cuda_version": [12, 4],
    "device_count": 1,
    "device": "NVIDIA Something",
    "memory_bytes": 8 * 2**30,
}


def backend(variant: str, *, is_usable: bool) -> Backend:
    return Backend(
        name=variant.split("_")[0],
        variant=variant,
        is_usable=is_usable,
        version="19.1.7" if is_usable else "",
        device="a device" if is_usable else "",
        problem="" if is_usable else f"{variant} is missing",
        remedy="" if is_usable else f"install {variant}",
    )


def diagnosis(*, has_llvm: bool, has_cuda: bool, has_numpy: bool = True) -> Diagnosis:
    return Diagnosis(
        backends=(
            backend(LLVM_VARIANT, is_usable=has_llvm),
            backend(CUDA_VARIANT, is_usable=has_cuda),
        ),
        packages=(
            Package(name="numpy", version="2.0" if has_numpy else None, extra=""),
            Package(name="pyoidn", version=None, extra="denoise"),
        ),
        python="3.11.2",
        system="Linux",
        processor="a processor",
        core_count=2,
        memory_gib=8.0,
    )


@pytest.fixture
def cuda_is(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Give the machine a CUDA device, or take it away."""

    def pretend(is_usable: bool) -> None:
        monkeypatch.setattr(
            doctor, "diagnose_cuda", lambda: backend(CUDA_VARIANT, is_usable=is_usable)
        )

    return pretend


@pytest.fixture
def llvm_is(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Give the machine a usable LLVM, or take it away."""

    def pretend(is_usable: bool) -> None:
        def require() -> LlvmLibrary:
            if not is_usable:
                raise MachineryError("no LLVM", "libLLVM.so", "install it")
            return LlvmLibrary(path="/lib/libLLVM.so", version=(19, 1, 7))

        monkeypatch.setattr(doctor, "require_usable_llvm", require)

    return pretend


@pytest.mark.parametrize(
    ("requested", "has_cuda", "chosen"),
    [
        (None, True, CUDA_VARIANT),
        (None, False, LLVM_VARIANT),
        ("auto", True, CUDA_VARIANT),
        ("auto", False, LLVM_VARIANT),
        (LLVM_VARIANT, True, LLVM_VARIANT),
        (CUDA_VARIANT, True, CUDA_VARIANT),
    ],
)
def test_takes_the_device_first_unless_told_otherwise(
    requested: str | None, has_cuda: bool, chosen: str, cuda_is: Any, llvm_is: Any
) -> None:
    cuda_is(has_cuda)
    llvm_is(True)
    assert choose_variant(requested) == chosen


@pytest.mark.parametrize(
    "requested", ["scalar_rgb", "llvm_ad_spectral", "cuda_ad_mono", "llvm_rgb", "nonsense", ""]
)
def test_refuses_other_variants_and_names_the_two(requested: str) -> None:
    with pytest.raises(InputError, match=f"{requested}'; ask for {LLVM_VARIANT} or {CUDA_VARIANT}"):
        choose_variant(requested)


def test_refuses_a_device_that_is_not_there(cuda_is: Any) -> None:
    cuda_is(False)
    with pytest.raises(InputError, match=f"is missing: .*install .*, or ask for {LLVM_VARIANT}"):
        choose_variant(CUDA_VARIANT)


@pytest.mark.parametrize("requested", [None, "auto", LLVM_VARIANT])
def test_an_unusable_llvm_is_found_before_the_variant_is_set(
    requested: str | None, cuda_is: Any, llvm_is: Any
) -> None:
    cuda_is(False)
    llvm_is(False)
    with pytest.raises(MachineryError, match="no LLVM"):
        choose_variant(requested)


def test_a_device_needs_no_llvm(cuda_is: Any, llvm_is: Any) -> None:
    cuda_is(True)
    llvm_is(False)
    assert choose_variant("auto") == CUDA_VARIANT


@pytest.mark.parametrize(
    ("change", "problem", "remedy"),
    [
        ({"has_driver": False}, "no NVIDIA driver", "install an NVIDIA driver"),
        ({"failure": "cuInit returned error 100"}, "error 100", "CUDA_VISIBLE_DEVICES"),
        (
            {"has_driver": False, "has_hidden_driver": True},
            "does not find the NVIDIA driver",
            "export DRJIT_LIBCUDA_PATH=libcuda.so.1",
        ),
        ({"cuda_version": [12, 1]}, r"too old \(CUDA 12\.1\)", "570 or newer"),
        ({"cuda_version": [12, 7]}, r"refused by Dr\.Jit .*\(CUDA 12\.7\)", "570 or newer"),
        ({"has_ray_tracing": False}, "libnvoptix", "NVIDIA_DRIVER_CAPABILITIES"),
    ],
)
def test_each_fault_of_the_driver_has_its_remedy(
    change: dict[str, Any], problem: str, remedy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cuda, "_probe", lambda: HEALTHY_DRIVER | change)
    found = diagnose_cuda()
    assert not found.is_usable
    assert re.search(problem, found.problem)
    assert remedy in found.remedy


def test_a_healthy_driver_is_usable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cuda, "_probe", lambda: HEALTHY_DRIVER)
    found = diagnose_cuda()
    assert found.is_usable
    assert (found.version, found.device) == ("12.4", "NVIDIA Something (8 GiB)")
    assert (found.problem, found.remedy) == ("", "")


# A driver that answers as NVIDIA's does; DEVICE_COUNT 0 makes cuDeviceGet fail like a hidden device
FAKE_DRIVER = r"""
#include <stddef.h>
#include <string.h>
int cuInit(unsigned flags) { return flags; }
int cuDriverGetVersion(int *version) { *version = 12040; return 0; }
int cuDeviceGetCount(int *count) { *count = DEVICE_COUNT; return 0; }
int cuDeviceGet(int *device, int ordinal) { *device = 7; return ordinal < DEVICE_COUNT ? 0 : 101; }
int cuDeviceGetName(char *name, int length, int device) {
    strncpy(name, device == 7 ? "Fake Device" : "another", length); return 0;
}
int cuDeviceTotalMem_v2(size_t *bytes, int device) { *bytes = 6ull << 30; return device != 7; }
"""


@pytest.fixture
def build_driver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Compile the fake driver, and let Dr.Jit's variables name it."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler for the fake driver")

    def build(device_count: int) -> None:
        library = tmp_path / "libcuda.so"
        options = ["-shared", "-fPIC", f"-DDEVICE_COUNT={device_count}", "-o", str(library)]
        subprocess.run(
            [compiler, *options, "-xc", "-"],
            check=True,
            input=FAKE_DRIVER,
            text=True,
        )
        monkeypatch.setenv(cuda.DRIVER_VARIABLE, str(library))
        monkeypatch.setenv(cuda.RAY_TRACING_VARIABLE, str(library))

    return build


def test_reads_what_the_driver_answers(build_driver: Callable[[int], None]) -> None:
    build_driver(1)
    found = diagnose_cuda()
    assert found.is_usable
    assert (found.version, found.device) == ("12.4", "Fake Device (6 GiB)")


def test_passes_on_which_call_of_the_driver_failed(build_driver: Callable[[int], None]) -> None:
    build_driver(0)
    assert "cuDeviceGet returned error 101" in diagnose_cuda().problem


def test_misses_ray_tracing_where_the_library_does_not_load(
    build_driver: Callable[[int], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    build_driver(1)
    monkeypatch.setenv(cuda.RAY_TRACING_VARIABLE, "/nowhere/libnvoptix.so.1")
    assert "libnvoptix" in diagnose_cuda().problem


@pytest.mark.parametrize(
    ("has_llvm", "has_cuda", "variant"),
    [
        (True, True, CUDA_VARIANT),
        (True, False, LLVM_VARIANT),
        (False, True, CUDA_VARIANT),
        (False, False, None),
    ],
)
def test_one_back_end_is_enough(has_llvm: bool, has_cuda: bool, variant: str | None) -> None:
    found = diagnosis(has_llvm=has_llvm, has_cuda=has_cuda)
    assert found.variant == variant
    assert found.is_healthy == (variant is not None)


def test_a_core_package_is_needed_and_an_extra_is_not() -> None:
    complete = diagnosis(has_llvm=True, has_cuda=False)
    assert complete.is_healthy
    incomplete = diagnosis(has_llvm=True, has_cuda=False, has_numpy=False)
    assert not incomplete.is_healthy
    assert "a package is missing" in report_lines(incomplete)[-1]


def test_the_text_gives_every_fault_its_remedy() -> None:
    found = diagnosis(has_llvm=False, has_cuda=False, has_numpy=False)
    text = "\n".join(report_lines(found))
    for fault in found.backends:
        assert fault.problem in text
        assert f"to fix: {fault.remedy}" in text
    assert "to fix: pip install numpy" in text
    assert "to fix: pip install pyoidn (extra 'denoise')" in text
    assert "nothing can be rendered" in text


def test_the_diagnosis_of_this_machine_survives_json() -> None:
    found = diagnose()
    read = json.loads(json.dumps(found.to_json()))
    assert read["variant"] == found.variant
    assert [b["name"] for b in read["backends"]] == ["llvm", "cuda"]
    assert read["core_count"] >= 1
    assert read["memory_gib"] > 0
    assert report_lines(found) == report_lines(replace(found))


def test_the_package_lists_are_those_of_the_project() -> None:
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]

    def names(requirements: list[str]) -> set[str]:
        return {re.split(r"[<>=]", requirement)[0] for requirement in requirements}

    assert names(project["dependencies"]) == set(doctor.CORE_PACKAGES)
    extras = {
        name: extra
        for extra, requirements in project["optional-dependencies"].items()
        for name in names(requirements)
        if extra != "dev"
    }
    assert extras == doctor.EXTRA_PACKAGES


@pytest.mark.gpu
def test_finds_the_device_of_this_machine() -> None:
    found = diagnose_cuda()
    if not found.is_usable:
        pytest.skip(found.problem)
    assert found.device
    assert choose_variant("auto") == CUDA_VARIANT
