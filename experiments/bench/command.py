"""`vctgi bench`: how fast frames are, beside what they do and what they would need at least."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, cast

from cyclopts import Parameter

from experiments.bench.comparison import DEFAULT_BOUND
from experiments.cli_options import JsonFile, Sensor, Variant
from experiments.errors import EXIT_DONE, EXIT_FAILED, InputError
from reports.bench_record import BenchRecord, bench_text, read_bench

DEFAULT_FRAMES = 32

DEFAULT_SIZE = {"llvm_ad_rgb": (480, 270), "cuda_ad_rgb": (1920, 1080)}

RECORD_NAME = "bench.json"


def bench(  # noqa: PLR0913 - the options of a command
    scene: str = "cornell_box",
    *,
    preset: Annotated[
        list[str] | None,
        Parameter(
            help="Presets to measure: repeat the option or part names by commas; ambient, medium, "
            "high and ultra if left out. Each is measured at one camera ray a pixel.",
            negative="",
        ),
    ] = None,
    resolution: Annotated[
        str | None,
        Parameter(
            help="Size of the picture, such as 1920x1080, which it is on a GPU; else 480x270."
        ),
    ] = None,
    frames: Annotated[
        int,
        Parameter(
            help="Frames of each kind that are timed; 300 for figures that are kept, 0 for counts "
            "alone."
        ),
    ] = DEFAULT_FRAMES,
    seconds: Annotated[
        float, Parameter(help="Frames of a kind end after so long, however many there were.")
    ] = 60.0,
    voxels: Annotated[
        int | None, Parameter(help="Voxels along an edge of a level; left out, the preset's.")
    ] = None,
    levels: Annotated[
        int | None, Parameter(help="Levels of the clipmap; left out, as the scene needs.")
    ] = None,
    first_frame: Annotated[
        list[str] | None,
        Parameter(
            help="Presets whose first frame is also timed in processes of their own, without and "
            "with a cache of kernels.",
            negative="",
        ),
    ] = None,
    baseline: Annotated[
        Path | None,
        Parameter(help="Record to compare with: counts that grew fail, times are advice."),
    ] = None,
    bound: Annotated[
        float, Parameter(help="Share by which counts may exceed the baseline's.")
    ] = DEFAULT_BOUND,
    output: Annotated[Path | None, Parameter(help=f"Folder for {RECORD_NAME}.")] = None,
    variant: Variant = None,
    sensor: Sensor = 0,
    json_file: JsonFile = None,
) -> int:
    """Time frames by stage, still and moving, beside their floors and counts.

    Device time of all of indirect light, not of primary visibility and direct light. With
    `--baseline`, exit 1 when a count that does not depend on the machine grew.
    """
    wanted = _Wanted(
        scene=scene,
        presets=_names(preset) or ["ambient", "medium", "high", "ultra"],
        first_frame=_names(first_frame),
        size=_size(resolution),
        clipmap={
            name: value
            for name, value in (("resolution", voxels), ("level_count", levels))
            if value is not None
        },
        frames=frames,
        seconds=seconds,
    )
    if frames < 0:
        raise InputError(
            what=f"--frames is {frames}", where="the command line", remedy="give at least 0"
        )
    earlier = None if baseline is None else _baseline(baseline)
    from experiments.session import find_preset, start_mitsuba, writable_file, writable_folder

    chosen = start_mitsuba(variant)
    for name in (*wanted.presets, *wanted.first_frame):
        find_preset(name)
    files = [] if json_file is None else [writable_file(json_file, "--json")]
    if output is not None:
        files.append(writable_folder(output) / RECORD_NAME)
    record = _measure(wanted, chosen, sensor)
    from experiments.bench.table import bench_lines

    print("\n".join(bench_lines(record)))  # noqa: T201 - the command's result
    for file in files:
        file.write_text(bench_text(record), encoding="utf-8")
    if earlier is None:
        return EXIT_DONE
    from experiments.bench.comparison import compare

    comparison = compare(earlier, record, bound)
    print("\n".join(["", *comparison.lines()]))  # noqa: T201 - the command's result
    return EXIT_FAILED if comparison.regressions else EXIT_DONE


@dataclass(frozen=True, kw_only=True)
class _Wanted:
    """What a benchmark is asked for."""

    scene: str
    presets: list[str]
    first_frame: list[str]
    size: tuple[int, int] | None
    clipmap: dict[str, int]
    frames: int
    seconds: float

    def words(self, size: tuple[int, int]) -> list[str]:
        """Return what to type to measure the same."""
        options = {"voxels": "resolution", "levels": "level_count"}
        return [
            *("vctgi", "bench", self.scene, "--preset", ",".join(self.presets)),
            *("--resolution", f"{size[0]}x{size[1]}", "--frames", str(self.frames)),
            *(
                word
                for option, name in options.items()
                if name in self.clipmap
                for word in (f"--{option}", str(self.clipmap[name]))
            ),
            *(["--first-frame", ",".join(self.first_frame)] if self.first_frame else []),
        ]


def _measure(wanted: _Wanted, variant: str, sensor: int) -> BenchRecord:
    from experiments.bench.first_frame import measure_first_frames
    from experiments.bench.measure import BenchOptions, bench_preset
    from experiments.machine import BackendName, describe_machine
    from experiments.progress import ProgressReport
    from experiments.scenes import load_scene

    size = wanted.size or DEFAULT_SIZE[variant]
    options = BenchOptions(frames=wanted.frames, seconds=wanted.seconds, **wanted.clipmap)
    found = []
    with ProgressReport() as progress:
        progress.start_scene(wanted.scene, 1, 1)
        loaded = load_scene(wanted.scene, resolution=size, sensor_index=sensor, needs_light=False)
        for name in wanted.presets:
            result = bench_preset(loaded, name, options, progress)
            if name in wanted.first_frame:
                progress(f"{name}: first frame", 0.0)
                request = {
                    "scene": wanted.scene,
                    "size": size,
                    "variant": variant,
                    "preset": name,
                    "clipmap": wanted.clipmap,
                }
                firsts = measure_first_frames(request)
                result = result.model_copy(update={"first_frames": firsts})
            found.append(result)
    return BenchRecord(
        created=datetime.now(UTC),
        command=shlex.join(wanted.words(size)),
        scene=loaded.name,
        width=size[0],
        height=size[1],
        machine=describe_machine(cast(BackendName, variant)),
        presets=found,
    )


def _names(words: list[str] | None) -> list[str]:
    return [name.strip() for word in words or [] for name in word.split(",") if name.strip()]


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    found = re.fullmatch(r"([1-9]\d*)x([1-9]\d*)", text)
    if found is None:
        raise InputError(
            what=f"--resolution is {text!r}",
            where="the command line",
            remedy="give width and height in pixels, such as 1920x1080",
        )
    return int(found[1]), int(found[2])


def _baseline(path: Path) -> BenchRecord:
    try:
        return read_bench(path)
    except ValueError as error:
        raise InputError(
            what=str(error), where="--baseline", remedy="name a file of `vctgi bench --json FILE`"
        ) from error
