"""What this machine can render with, and how to fix what is missing.

Every command that renders calls `choose_variant` before it touches Mitsuba: afterwards an unusable
LLVM could not be reported any more (see `experiments.llvm`). Like that module, this one imports
nothing outside the standard library, so that it works where nothing is installed yet.
"""

from __future__ import annotations

import importlib.metadata
import os
import platform
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from experiments.cuda import find_cuda
from experiments.errors import InputError
from experiments.llvm import find_llvm, require_usable_llvm

CUDA_VARIANT: Final = "cuda_ad_rgb"
LLVM_VARIANT: Final = "llvm_ad_rgb"
SUPPORTED_VARIANTS: Final = (LLVM_VARIANT, CUDA_VARIANT)
AUTOMATIC: Final = "auto"

CORE_PACKAGES: Final = (
    "mitsuba",
    "drjit",
    "OpenEXR",
    "colour-science",
    "scikit-image",
    "numpy",
    "scipy",
    "pydantic",
    "cyclopts",
    "jinja2",
    "matplotlib",
    "flip-evaluator",
    "pillow",
    "rich",
)
"""Distributions that vctgi does not work without."""
EXTRA_PACKAGES: Final = {
    "pyoidn": "denoise",
    "weasyprint": "pdf",
    "cvvdp": "vdp",
    "optuna": "tune",
    "distributed": "cluster",
    "pyarrow": "store",
    "duckdb": "store",
}
"""Distributions that add something, and the extra of vctgi that installs each."""


@dataclass(frozen=True, kw_only=True)
class Backend:
    """One Dr.Jit back end on this machine."""

    name: str
    """`llvm` or `cuda`."""
    variant: str
    """Mitsuba variant that runs on it."""
    is_usable: bool
    version: str
    """Version of LLVM, or of the driver's CUDA interface; empty when there is none."""
    device: str
    """LLVM: the library file. CUDA: the first device. Empty when there is none."""
    problem: str
    """Why it cannot be used; empty when it can."""
    remedy: str
    """What to do about the problem; empty when there is none."""


@dataclass(frozen=True, kw_only=True)
class Package:
    """One Python distribution that vctgi can use."""

    name: str
    version: str | None
    """None when it is not installed."""
    extra: str
    """The extra that asks for it; empty for a core dependency."""

    @property
    def remedy(self) -> str:
        """What to type when it is missing; empty when it is not."""
        if self.version is not None:
            return ""
        return f"pip install {self.name}" + (f" (extra '{self.extra}')" if self.extra else "")


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """All that `vctgi doctor` reports."""

    backends: tuple[Backend, ...]
    packages: tuple[Package, ...]
    python: str
    system: str
    processor: str
    core_count: int
    """Cores that this process may use."""
    memory_gib: float
    """Physical memory, GiB."""

    @property
    def variant(self) -> str | None:
        """Variant that `auto` stands for here; None when no back end is usable."""
        usable = [backend.variant for backend in self.backends if backend.is_usable]
        return next((v for v in (CUDA_VARIANT, LLVM_VARIANT) if v in usable), None)

    @property
    def is_healthy(self) -> bool:
        """Whether vctgi can render here: a usable back end and every core package."""
        is_complete = all(p.version is not None for p in self.packages if not p.extra)
        return self.variant is not None and is_complete

    def to_json(self) -> dict[str, Any]:
        """Return plain lists and dictionaries for `json.dump`."""
        return {**asdict(self), "variant": self.variant, "is_healthy": self.is_healthy}


def diagnose() -> Diagnosis:
    """Look at the back ends, the packages and the machine.

    Returns
    -------
    Diagnosis
        Nothing of it needs Mitsuba or Dr.Jit to be importable.
    """
    return Diagnosis(
        backends=(diagnose_llvm(), diagnose_cuda()),
        packages=tuple(
            Package(name=name, version=_installed_version(name), extra=extra)
            for name, extra in [*((name, "") for name in CORE_PACKAGES), *EXTRA_PACKAGES.items()]
        ),
        python=platform.python_version(),
        system=platform.platform(),
        processor=_processor_name(),
        core_count=len(os.sched_getaffinity(0)),
        memory_gib=os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30,
    )


def diagnose_llvm() -> Backend:
    """Whether Dr.Jit would find an LLVM that it can render with."""
    search = find_llvm()
    return Backend(
        name="llvm",
        variant=LLVM_VARIANT,
        is_usable=search.is_usable,
        version=search.picked.version_text if search.picked else "",
        device=search.picked.path if search.picked else "",
        problem="" if search.is_usable else f"{search.what}: {search.where}",
        remedy=search.remedy,
    )


def diagnose_cuda() -> Backend:
    """Whether the NVIDIA driver, a device and the ray-tracing library are there."""
    search = find_cuda()
    return Backend(
        name="cuda",
        variant=CUDA_VARIANT,
        is_usable=search.is_usable,
        version=search.version,
        device=search.device,
        problem=search.problem,
        remedy=search.remedy,
    )


def choose_variant(requested: str | None) -> str:
    """Decide which Mitsuba variant to set, and make sure that it will run.

    Parameters
    ----------
    requested
        A variant's name; None or `auto` takes a usable CUDA device first, then LLVM.

    Returns
    -------
    str
        `cuda_ad_rgb` or `llvm_ad_rgb`; setting it is left to the caller.

    Raises
    ------
    InputError
        The variant is not supported, it needs a device that this machine lacks, or
        `DRJIT_LIBLLVM_PATH` names an unusable library.
    MachineryError
        LLVM is needed, and the one that Dr.Jit would load is missing or unusable.
    """
    is_automatic = requested is None or requested == AUTOMATIC
    if not is_automatic and requested not in SUPPORTED_VARIANTS:
        raise InputError(
            "unsupported variant",
            f"{requested!r}",
            f"ask for {' or '.join(SUPPORTED_VARIANTS)} (spectral, mono, polarized and scalar"
            " variants are not supported)",
        )
    if requested != LLVM_VARIANT:
        cuda = diagnose_cuda()
        if cuda.is_usable:
            return CUDA_VARIANT
        if not is_automatic:
            raise InputError(
                cuda.problem, CUDA_VARIANT, f"{cuda.remedy}, or ask for {LLVM_VARIANT}"
            )
    require_usable_llvm()
    return LLVM_VARIANT


def report_lines(diagnosis: Diagnosis) -> list[str]:
    """Text of `vctgi doctor`.

    Parameters
    ----------
    diagnosis
        What `diagnose` found.

    Returns
    -------
    list of str
        Lines without ends; a line that starts with `to fix:` follows each fault.
    """
    lines = [
        f"python     {diagnosis.python}",
        f"system     {diagnosis.system}",
        f"processor  {diagnosis.processor}, {diagnosis.core_count} cores,"
        f" {diagnosis.memory_gib:.1f} GiB",
        "",
    ]
    for backend in diagnosis.backends:
        state = f"{backend.version}  {backend.device}" if backend.is_usable else backend.problem
        lines.append(f"{'ok' if backend.is_usable else '--':<4}{backend.variant:<13}{state}")
        if backend.remedy:
            lines.append(f"    to fix: {backend.remedy}")
    lines.append("")
    for package in diagnosis.packages:
        mark = "ok" if package.version else ("--" if package.extra else "!!")
        state = package.version or f"not installed; to fix: {package.remedy}"
        lines.append(f"{mark:<4}{package.name:<16}{state}")
    lines.append("")
    if diagnosis.variant is None:
        lines.append("no back end is usable: nothing can be rendered on this machine")
    elif not diagnosis.is_healthy:
        lines.append("a package is missing that vctgi does not work without")
    else:
        lines.append(f"renders with {diagnosis.variant}")
    return lines


def _installed_version(name: str) -> str | None:
    """Version of an installed distribution, or None."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _processor_name() -> str:
    """Model name of the processor where Linux tells it, else the architecture."""
    processors = Path("/proc/cpuinfo")
    if processors.is_file():
        for line in processors.read_text().splitlines():
            key, _, value = line.partition(":")
            if key.strip() == "model name":
                return value.strip()
    return platform.machine()
