"""`vctgi sweep`: many runs from one file, resumed by the same command."""

from __future__ import annotations

import contextlib
import json
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from experiments.cli_options import Cache, JsonFile, Presets, Resolution, Sensor, Variant
from experiments.errors import EXIT_DONE, EXIT_FAILED, InputError
from experiments.sweep.specification import SweepSpec, load_sweep, parse_set

if TYPE_CHECKING:
    from experiments.sweep.jobs import Job
    from experiments.sweep.lanes import Lanes
    from experiments.sweep.run import Settled, SweepEnd, SweepOptions

SHORTEST_TIMEOUT = 1.0
"""Seconds."""


def sweep(  # noqa: PLR0913 - the options of a command
    sweep_file: Path | None = None,
    *,
    output: Annotated[
        Path, Parameter(name=["--output", "-o"], help="Folder; the same one goes on.")
    ] = Path("vctgi-sweep"),
    scene: Annotated[
        list[str] | None, Parameter(negative="", help="Scenes, instead of the file's.")
    ] = None,
    preset: Presets | None = None,
    parameter: Annotated[
        list[str] | None,
        Parameter(
            name="--set",
            negative="",
            help="NAME=VALUE,VALUE: values of a field, such as diffuse.aperture_scale=0.8,1.",
        ),
    ] = None,
    seeds: Annotated[str | None, Parameter(help="With commas.")] = None,
    resolution: Resolution | None = None,
    spp: Annotated[int | None, Parameter(name="--spp", help="Paths of the reference.")] = None,
    variant: Variant = None,
    sensor: Sensor | None = None,
    workers: Annotated[
        int | None, Parameter(help="Jobs at a time; left out: 1, or one for each GPU.")
    ] = None,
    gpus: Annotated[str | None, Parameter(help="Devices to deal jobs to, such as 0,1.")] = None,
    timeout: Annotated[float, Parameter(help="Time limit of an attempt, seconds.")] = 3600.0,
    retries: Annotated[int, Parameter(help="Attempts after the first that failed.")] = 2,
    retry_set_aside: Annotated[
        bool, Parameter(negative="", help="Try again what an earlier sweep set aside.")
    ] = False,
    cluster: Annotated[
        str | None, Parameter(help="Address of a Dask scheduler that runs the jobs.")
    ] = None,
    dry_run: Annotated[bool, Parameter(negative="", help="Only list the jobs.")] = False,
    cache: Cache = None,
    json_file: JsonFile = None,
) -> int:
    """Render scenes x presets x parameter values x seeds, each in a process of its own.

    SWEEP_FILE is TOML; options take the place of its entries. The same folder goes on where a sweep
    was stopped or killed: what is finished is not rendered again. Exit 1 when jobs were set aside.
    """
    given: dict[str, Any] = {
        "scenes": scene,
        "presets": preset,
        "parameters": None if parameter is None else parse_set(parameter),
        "seeds": None if seeds is None else _whole_numbers("--seeds", seeds),
        "resolution": resolution,
        "reference_spp": spp,
        "variant": variant,
        "sensor": sensor,
    }
    spec = load_sweep(sweep_file, {k: v for k, v in given.items() if v is not None})
    lanes_wanted = _Lanes(workers, gpus, cluster)
    from experiments.sweep.run import SweepOptions

    if timeout < SHORTEST_TIMEOUT or retries < 0:
        raise InputError(
            what=f"--timeout {timeout:g}, --retries {retries}",
            where="the command line",
            remedy=f"give at least {SHORTEST_TIMEOUT:g} s, and no negative number",
        )
    options = SweepOptions(timeout=timeout, retries=retries, is_retrying=retry_set_aside)
    jobs = _jobs(spec, cache, is_remote=cluster is not None)
    if dry_run:
        print("\n".join(_listed(jobs)))  # noqa: T201 - the command's result
        return EXIT_DONE
    end = _run(jobs, output, lanes_wanted, options)
    if json_file is not None:
        _write_json(json_file, end)
    print("\n".join(_summary(end, output)))  # noqa: T201 - the command's result
    return EXIT_FAILED if end.set_aside else EXIT_DONE


class _Lanes:
    """Where the jobs run, as the command line says it."""

    def __init__(self, workers: int | None, gpus: str | None, cluster: str | None) -> None:
        self.gpus = [] if gpus is None else [word.strip() for word in gpus.split(",")]
        self.workers, self.cluster = workers, cluster
        if workers is not None and workers < 1:
            raise InputError(f"--workers is {workers}", "the command line", "give at least 1")
        if gpus is not None and not all(self.gpus):
            raise InputError(f"--gpus is '{gpus}'", "the command line", "write such as 0,1")
        if gpus is not None and cluster is not None:
            raise InputError(
                what="--gpus and --cluster do not go together",
                where="the command line",
                remedy="start workers with `dask worker ... --resources GPU=1`, each with its"
                " CUDA_VISIBLE_DEVICES",
            )

    @property
    def count(self) -> int:
        """Jobs at a time on this machine."""
        return self.workers or max(1, len(self.gpus))

    def threads(self) -> int | None:
        """Return the processor threads of each job where several share the processor."""
        from experiments.doctor import diagnose

        if self.cluster is not None or self.gpus or self.count == 1:
            return None
        return max(1, diagnose().core_count // self.count)

    @contextlib.contextmanager
    def open(self, needs_gpu: bool) -> Iterator[Lanes]:
        """Give the lanes, and leave the cluster in the end."""
        from experiments.sweep.lanes import LocalLanes

        if self.cluster is None:
            yield LocalLanes(self.count, self.gpus)
            return
        from experiments.sweep.cluster import ClusterLanes

        lanes = ClusterLanes(self.cluster, needs_gpu=needs_gpu, count=self.workers)
        try:
            yield lanes
        finally:
            lanes.close()


def _jobs(spec: SweepSpec, cache: Path | None, *, is_remote: bool) -> dict[str, Job]:
    """Check everything that a job could stumble over, and list the jobs."""
    from experiments.doctor import choose_variant
    from experiments.session import list_presets, writable_folder
    from experiments.sweep.code_version import code_version
    from experiments.sweep.jobs import list_jobs
    from experiments.sweep.scene_digests import scene_digests

    spec = spec.model_copy(update={"presets": list_presets(spec.presets)})
    if is_remote and spec.variant is None:
        raise InputError(
            what="no variant is named",
            where="--cluster",
            remedy="give --variant llvm_ad_rgb or cuda_ad_rgb: the workers may differ from here",
        )
    if cache is not None:
        writable_folder(cache, "--cache")
    # The cluster may have devices that this machine has not; scenes are only loaded here.
    here = choose_variant(None if is_remote else spec.variant)
    variant = spec.variant if is_remote and spec.variant is not None else here
    if variant not in ("llvm_ad_rgb", "cuda_ad_rgb"):
        choose_variant(variant)
    blank = dict.fromkeys(spec.scenes, "")
    about: dict[str, Any] = {
        "variant": variant,
        "digest_variant": here,
        "cache": cache,
        "code": code_version(),
    }
    list_jobs(spec, blank, **about)  # parameters are refused before scenes are loaded
    digests = scene_digests(
        spec.scenes, variant=here, resolution=spec.resolution, sensor=spec.sensor
    )
    return list_jobs(spec, digests, **about)


def _run(jobs: dict[str, Job], output: Path, wanted: _Lanes, options: SweepOptions) -> SweepEnd:
    from experiments.progress import ProgressReport, time_text
    from experiments.session import writable_folder
    from experiments.sweep.folder import SweepFolder
    from experiments.sweep.render_work import render_work
    from experiments.sweep.run import run_sweep

    threads = wanted.threads()
    work = {key: render_work(job, options.timeout, threads) for key, job in jobs.items()}
    needs_gpu = any(job.variant.startswith("cuda") for job in jobs.values())
    folder = SweepFolder(writable_folder(output).resolve())
    began = time.monotonic()
    rendered = 0
    with _told_to_end(), wanted.open(needs_gpu) as lanes, ProgressReport() as progress:
        progress.start_scene("sweep", 1, 1)
        progress("jobs", 0.0)

        def tell(settled: Settled) -> None:
            nonlocal rendered
            rendered += settled.outcome.kind == "finished" and settled.outcome.seconds > 0.0
            left = settled.total - settled.done
            pace = (time.monotonic() - began) / max(1, rendered)
            ahead = f"; about {time_text(pace * left)} left" if rendered and left else ""
            words = _told(settled)
            progress.say(f"[{settled.done}/{settled.total}] {settled.claim.label}: {words}{ahead}")
            progress("jobs", settled.done / settled.total)

        return run_sweep(folder, work, lanes, options, tell)


def _told(settled: Settled) -> str:
    """Say how an attempt ended."""
    if settled.outcome.kind == "finished":
        seconds = settled.outcome.seconds
        return f"{seconds:.0f} s" if seconds > 0.0 else "taken up, finished before"
    fate = "set aside" if settled.state == "set aside" else "will be tried again"
    return f"{fate} after attempt {settled.claim.attempt}: {settled.outcome.line}"


@contextlib.contextmanager
def _told_to_end() -> Iterator[None]:
    """Take SIGTERM for Ctrl-C: attempts are ended and their rows handed back."""

    def interrupt(_number: int, _frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _listed(jobs: dict[str, Job]) -> list[str]:
    lines = [f"{key[:12]}  {job.label}" for key, job in jobs.items()]
    return [*lines, f"{len(jobs)} jobs"]


def _summary(end: SweepEnd, output: Path) -> list[str]:
    before = f", {end.found} of them before" if end.found else ""
    lines = [f"{end.total} jobs: {end.done} done{before}, {len(end.set_aside)} set aside"]
    lines += [
        f"set aside after {each.attempt} attempts: {each.label}: {each.error}"
        for each in end.set_aside
    ]
    return [*lines, f"next: vctgi results page {output}; vctgi results export {output} -o FILE"]


def _write_json(path: Path, end: SweepEnd) -> None:
    from dataclasses import asdict

    from experiments.session import writable_file

    text = json.dumps(asdict(end), indent=1)
    writable_file(path, "--json").write_text(text, encoding="utf-8")


def _whole_numbers(option: str, text: str) -> list[int]:
    try:
        return [int(word) for word in text.split(",")]
    except ValueError as error:
        raise InputError(
            f"{option} is '{text}'", "the command line", "give whole numbers with commas"
        ) from error
