"""Fingerprints of scenes, taken in a process of their own: loading one may end it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence

from experiments.errors import EXIT_DONE, InputError, MachineryError
from experiments.sweep.same_code import same_code_environment

LOAD_SECONDS = 600.0
"""Large scenes take a minute each to load."""


def scene_digests(
    scenes: Sequence[str], *, variant: str, resolution: int | None, sensor: int
) -> dict[str, str]:
    """Load and check scenes; return what identifies the content of each.

    Raises
    ------
    InputError
        A scene that cannot be rendered, as `vctgi report` would say it.
    MachineryError
        The process that loads them failed.
    """
    words = [sys.executable, "-m", "experiments", "sweep-scenes", *scenes]
    words += ["--variant", variant, "--sensor", str(sensor)]
    if resolution is not None:
        words += ["--resolution", str(resolution)]
    try:
        done = subprocess.run(
            words,
            capture_output=True,
            text=True,
            timeout=LOAD_SECONDS,
            check=False,
            env=same_code_environment(),
        )
    except subprocess.TimeoutExpired as error:
        raise MachineryError(
            what=f"the scenes were not loaded in {LOAD_SECONDS:.0f} s",
            where=", ".join(scenes),
            remedy="sweep fewer scenes at a time",
        ) from error
    lines = done.stdout.splitlines()
    if done.returncode != EXIT_DONE or not lines:
        said = [line for line in done.stderr.splitlines() if line.strip()]
        raise MachineryError(
            what=f"loading ended with {done.returncode}" + (f": {said[-1]}" if said else ""),
            where=", ".join(scenes),
            remedy="try each scene with `vctgi plan`",
        )
    answer = json.loads(lines[-1])
    if "refused" in answer:
        raise InputError(**answer["refused"])
    digests: dict[str, str] = answer["digests"]
    return digests
