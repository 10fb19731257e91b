"""What a run was made on and with: the facts that stand in every record."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Literal

from experiments.doctor import CUDA_VARIANT, diagnose
from reports.record import Machine

BackendName = Literal["llvm_ad_rgb", "cuda_ad_rgb"]
"""Variants that a record can be made on."""

SOURCE_FOLDER = Path(__file__).resolve().parent.parent


def describe_machine(variant: BackendName) -> Machine:
    """Return processor, device, versions and commit, for the back end in use."""
    found = diagnose()
    name = "cuda" if variant == CUDA_VARIANT else "llvm"
    backend = next(each for each in found.backends if each.name == name)
    commit, is_dirty = _commit()
    return Machine(
        backend=variant,
        device=backend.device if name == "cuda" else f"{found.processor}, LLVM {backend.version}",
        processor=found.processor,
        core_count=found.core_count,
        memory_gib=found.memory_gib,
        system=found.system,
        python=found.python,
        versions={package.name: package.version for package in found.packages if package.version},
        commit=commit,
        is_dirty=is_dirty,
    )


def _commit() -> tuple[str, bool]:
    """Commit of the source tree and whether it has changes; "unknown" outside a checkout."""
    head = _git("rev-parse", "HEAD")
    return head or "unknown", bool(head) and bool(_git("status", "--porcelain"))


def _git(*arguments: str) -> str:
    try:
        done = subprocess.run(
            ["git", *arguments],
            cwd=SOURCE_FOLDER,
            capture_output=True,
            text=True,
            timeout=10.0,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
