"""The hidden commands that a sweep starts: render one job; look at the scenes before all."""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from experiments.errors import EXIT_DONE, InputError
from experiments.sweep.disk import EXIT_DISK_FULL, is_disk_full

LONGEST_ALARM = 10**8
"""Seconds; three years."""

AFTER_LIMIT = 30
"""Seconds after its time limit at which a job ends itself: its sweep did not, so it is dead."""


def sweep_job(
    job_file: Path,
    *,
    output: Annotated[Path, Parameter(help="Gets `records/`.")],
    timeout: float,
    threads: int | None = None,
) -> int:
    """Render one job of a sweep; only a sweep calls this."""
    signal.alarm(int(min(timeout, LONGEST_ALARM)) + AFTER_LIMIT)
    try:
        _render(job_file, output, threads)
    except Exception as error:
        if is_disk_full(error):
            sys.stderr.write(f"vctgi: {error}\n")
            return EXIT_DISK_FULL
        raise
    return EXIT_DONE


def _render(job_file: Path, output: Path, threads: int | None) -> None:
    from experiments.session import start_mitsuba
    from experiments.sweep.code_version import code_version
    from experiments.sweep.jobs import Job

    job = Job.model_validate_json(job_file.read_text(encoding="utf-8"))
    if job.code != code_version():
        raise InputError(
            what="the code here is not the code that the sweep was started with",
            where=str(job_file),
            remedy="start the sweep again, with the same vctgi on every machine",
        )
    variant = start_mitsuba(job.variant)
    import drjit as dr

    from experiments.progress import ProgressReport
    from experiments.run import RunOptions, run_scene
    from experiments.scenes import load_scene
    from experiments.session import DEFAULT_RESOLUTION
    from reference import default_cache_directory, scene_digest

    if threads is not None:
        dr.set_thread_count(threads)
    loaded = load_scene(
        job.scene,
        resolution=job.resolution,
        default_resolution=DEFAULT_RESOLUTION,
        sensor_index=job.sensor,
    )
    if variant == job.digest_variant and scene_digest(loaded.scene) != job.scene_digest:
        raise InputError(
            what="the scene has changed since the sweep was started",
            where=job.scene,
            remedy="start the sweep again",
        )
    options = RunOptions(
        preset=job.configuration,
        config=job.config(),
        reference_spp=job.reference_spp,
        seed=job.seed,
        cache_directory=default_cache_directory() if job.cache is None else Path(job.cache),
        command=job.command,
    )
    with ProgressReport() as progress:
        progress.start_scene(job.label, 1, 1)
        run_scene(loaded, options, output, variant, progress)


def sweep_scenes(*scenes: str, variant: str, resolution: int | None = None, sensor: int = 0) -> int:
    """Load scenes as a sweep's jobs will; print their fingerprints, or the fault of the first."""
    from experiments.session import start_mitsuba

    start_mitsuba(variant)
    from experiments.measured_scene import load_measured_scene
    from reference import scene_digest

    answer: dict[str, dict[str, str]] = {"digests": {}}
    try:
        for name in scenes:
            loaded = load_measured_scene(name, resolution, sensor)
            answer["digests"][name] = scene_digest(loaded.scene)
    except InputError as error:
        answer = {"refused": {"what": error.what, "where": error.where, "remedy": error.remedy}}
    print(json.dumps(answer))  # noqa: T201 - what the sweep reads
    return EXIT_DONE
