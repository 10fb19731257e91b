"""Whether Mitsuba could run on an NVIDIA device of this machine.

Dr.Jit 1.5 wants the driver's CUDA interface 12.2 (driver 535) or newer; for ray tracing it also
wants OptiX, a part of the driver that containers often leave out, and refuses CUDA 12.7, whose
drivers miscompile. The driver is asked in a process of its own, and nothing outside the standard
library is imported.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from experiments.library_search import names_in_search_order

DRIVER_VARIABLE: Final = "DRJIT_LIBCUDA_PATH"
RAY_TRACING_VARIABLE: Final = "DRJIT_LIBOPTIX_PATH"
OLDEST_CUDA: Final = (12, 2)
"""CUDA interface of driver 535, below which Dr.Jit switches the back end off."""
MISCOMPILING_CUDA: Final = (12, 7)
"""CUDA interface of drivers 565 to 569, on which Dr.Jit refuses to trace rays."""
PROBE_SECONDS: Final = 60.0
"""Creating no context, a probe takes well under a second; a minute means a hanging driver."""

_DRIVER_REMEDY: Final = "install an NVIDIA driver of version 570 or newer"


@dataclass(frozen=True, kw_only=True)
class CudaSearch:
    """What Dr.Jit would find on this machine."""

    version: str
    """CUDA interface of the driver, as `12.4`; empty when there is none."""
    device: str
    """Name and memory of the first device; empty when there is none."""
    problem: str
    """The first thing that keeps Mitsuba from using it; empty when nothing does."""
    remedy: str
    """What to do about the problem; empty when there is none."""

    @property
    def is_usable(self) -> bool:
        """Whether Mitsuba can trace rays on the device."""
        return not self.problem


def find_cuda() -> CudaSearch:
    """Ask the driver for its version and its first device, and look for OptiX.

    Returns
    -------
    CudaSearch
        The device, or the first problem with its remedy.
    """
    answer = _probe()
    version = tuple(answer.get("cuda_version", ()))
    problem, remedy = _first_problem(answer, version)
    device = ""
    if "device" in answer:
        device = f"{answer['device']} ({answer['memory_bytes'] / 2**30:.0f} GiB)"
    return CudaSearch(
        version=".".join(map(str, version)), device=device, problem=problem, remedy=remedy
    )


def _first_problem(answer: dict[str, Any], version: tuple[int, ...]) -> tuple[str, str]:
    """Return the first thing that keeps Mitsuba from using the device, and the remedy."""
    if not answer["has_driver"]:
        if answer.get("has_hidden_driver"):
            return (
                "Dr.Jit does not find the NVIDIA driver",
                f"export {DRIVER_VARIABLE}=libcuda.so.1",
            )
        return "no NVIDIA driver (libcuda.so)", _DRIVER_REMEDY
    if "failure" in answer:
        return f"the NVIDIA driver offers no device ({answer['failure']})", (
            "make the device visible to this process (CUDA_VISIBLE_DEVICES, the container's"
            " device list)"
        )
    if version < OLDEST_CUDA or version == MISCOMPILING_CUDA:
        fault = "too old" if version < OLDEST_CUDA else "refused by Dr.Jit for ray tracing"
        return f"the NVIDIA driver is {fault} (CUDA {version[0]}.{version[1]})", _DRIVER_REMEDY
    if not answer["has_ray_tracing"]:
        return "the driver's ray-tracing library is missing (libnvoptix.so.1)", (
            "in a container, start it with NVIDIA_DRIVER_CAPABILITIES=compute,graphics,utility;"
            f" elsewhere, export {RAY_TRACING_VARIABLE}=FILE"
        )
    return "", ""


def _probe() -> dict[str, Any]:
    """Ask the driver in a process of its own."""
    script = Path(__file__).with_name("probe_cuda.py")
    ray_tracing = os.environ.get(RAY_TRACING_VARIABLE) or "libnvoptix.so.1"
    drivers = names_in_search_order(DRIVER_VARIABLE, "libcuda.so", "libcuda.so.*")
    try:
        probe = subprocess.run(
            [sys.executable, "-I", str(script), ray_tracing, *drivers],
            capture_output=True,
            check=True,
            text=True,
            timeout=PROBE_SECONDS,
        )
    except subprocess.SubprocessError as error:
        return {"has_driver": True, "failure": str(error)}
    answer: dict[str, Any] = json.loads(probe.stdout)
    return answer
