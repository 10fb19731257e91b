"""`vctgi optimize`: check what is asked for, fit, write the preset file, print the tables."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from cyclopts import Parameter

from experiments.cli_options import Cache, JsonFile, Preset, Variant
from experiments.errors import EXIT_DONE, InputError

if TYPE_CHECKING:
    from experiments.optimize.run import FitOptions

METHODS = ("gauss-newton", "adam", "evolution", "optuna")
DERIVATIVES = ("forward", "differences")
DEFAULT_PARAMETERS = ("aperture_scale", "exponent", "pull_back", "level_bias")


def optimize(  # noqa: PLR0913 - the options of a command
    *scenes: str,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Preset file, .toml.")],
    held_out: Annotated[
        list[str] | None,
        Parameter(negative="", help="Scenes that are only measured: repeat, or part by commas."),
    ] = None,
    held_out_views: Annotated[
        bool, Parameter(help="Also measure training scenes from turned cameras.")
    ] = True,
    preset: Preset = "high",
    parameters: Annotated[
        list[str] | None,
        Parameter(
            negative="",
            help="What is fitted: aperture_scale, apertures, weights, elevations, step_ratio, "
            "min_step, start_offset, exponent, pull_back, level_bias, near_field, ring_jitter, "
            "max_contrast; with evolution and Optuna also cone_count, sparsity, traced_once, "
            "filtering. "
            "Default: " + ", ".join(DEFAULT_PARAMETERS) + ".",
        ),
    ] = None,
    method: Annotated[str, Parameter(help="One of " + ", ".join(METHODS) + ".")] = "gauss-newton",
    derivatives: Annotated[
        str, Parameter(help="forward (Dr.Jit) or differences (central).")
    ] = "forward",
    equal_cost: Annotated[
        bool, Parameter(help="Whether cones may read no more than at the start.")
    ] = True,
    limit_leaks: Annotated[
        bool, Parameter(help="Whether leaking and over-occlusion may not get worse.")
    ] = True,
    frames: Annotated[
        int, Parameter(help="Frames of each view, each at its own place of the voxels.")
    ] = 4,
    iterations: Annotated[int, Parameter(help="Most points, steps or trials.")] = 20,
    spp: Annotated[int, Parameter(name="--spp", help="Paths a pixel of the references.")] = 512,
    resolution: Annotated[int, Parameter(help="Longer edge of the pictures, pixels.")] = 64,
    clipmap_resolution: Annotated[
        int | None,
        Parameter(help="Voxels along an edge of a level while fitting; left out: the preset's."),
    ] = None,
    seed: int = 0,
    variant: Variant = None,
    cache: Cache = None,
    json_file: JsonFile = None,
) -> int:
    """Fit a preset's numbers to path-traced references, and write them as a preset file.

    SCENES are trained on; --held-out scenes and turned views are only measured. Every command takes
    the file as its --preset. Leaking, over-occlusion and what cones read may not get worse. A run
    that was stopped goes on where it was, and ends where it would have.
    """
    from experiments.session import find_preset, start_mitsuba, writable_file, writable_folder
    from reference import default_cache_directory

    if output.suffix != ".toml":
        raise InputError(
            what=f"'{output}' is not the name of a preset file",
            where="--output",
            remedy="give a name that ends in .toml",
        )
    _one_of("--method", method, METHODS)
    _one_of("--derivatives", derivatives, DERIVATIVES)
    _check_numbers(frames, iterations, seed, clipmap_resolution, resolution, spp)
    find_preset(preset, is_compared=True)
    chosen = start_mitsuba(variant)
    from experiments.optimize.fit import LimitRules
    from experiments.optimize.frames import Derivatives
    from experiments.optimize.run import FitOptions, Method, check_options, view_names

    options = FitOptions(
        scenes=tuple(scenes),
        held_out=_parted(held_out or []),
        has_turned_views=held_out_views,
        preset=preset,
        parameters=_parted(parameters or DEFAULT_PARAMETERS),
        method=cast(Method, method),
        derivatives=cast(Derivatives, derivatives),
        frame_count=frames,
        iterations=iterations,
        reference_spp=spp,
        resolution=resolution,
        seed=seed,
        limits=LimitRules(has_leaks=limit_leaks, has_cost=equal_cost),
        clipmap_resolution=clipmap_resolution,
    )
    check_options(options)
    view_names(options)
    writable_file(output)
    if json_file is not None:
        writable_file(json_file, "--json")
    kept = writable_folder(cache or default_cache_directory(), "--cache")
    return _fit_and_write(options, chosen, kept, output, json_file)


def _fit_and_write(
    options: FitOptions, variant: str, cache: Path, output: Path, json_file: Path | None
) -> int:
    from experiments.machine import BackendName, describe_machine
    from experiments.optimize.preset_record import fit_record, fitted_preset
    from experiments.optimize.run import run_fit
    from experiments.optimize.summary import summary_lines
    from experiments.progress import ProgressReport
    from vctgi.preset_file import write_preset_file

    command = command_line(options, output, variant)
    machine = describe_machine(cast(BackendName, variant))
    with ProgressReport() as progress:
        progress.start_scene(f"optimize {options.preset}", 1, 1)
        result = run_fit(replace(options, cache=cache), variant, progress)
    write_preset_file(output, fitted_preset(options, result, command, machine))
    if json_file is not None:
        row = fit_record(options, result, command, machine)
        json_file.write_text(json.dumps(row, indent=1) + "\n", encoding="utf-8")
    print("\n".join(summary_lines(result, output)))  # noqa: T201 - the command's result
    return EXIT_DONE


def command_line(options: FitOptions, output: Path, variant: str) -> str:
    """Return what to type to make the same fit again."""
    words = ["vctgi", "optimize", *options.scenes]
    words += [word for scene in options.held_out for word in ("--held-out", scene)]
    words += [] if options.has_turned_views else ["--no-held-out-views"]
    words += ["--preset", options.preset, "--parameters", ",".join(options.parameters)]
    words += ["--method", options.method, "--derivatives", options.derivatives]
    words += [] if options.limits.has_cost else ["--no-equal-cost"]
    words += [] if options.limits.has_leaks else ["--no-limit-leaks"]
    words += ["--frames", str(options.frame_count), "--iterations", str(options.iterations)]
    words += ["--spp", str(options.reference_spp), "--resolution", str(options.resolution)]
    if options.clipmap_resolution is not None:
        words += ["--clipmap-resolution", str(options.clipmap_resolution)]
    words += ["--seed", str(options.seed), "--variant", variant, "--output", str(output)]
    return shlex.join(words)


def _parted(words: list[str] | tuple[str, ...]) -> tuple[str, ...]:
    """Return names that were repeated or parted by commas."""
    names = [name.strip() for word in words for name in word.split(",")]
    return tuple(dict.fromkeys(name for name in names if name))


def _one_of(option: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        raise InputError(
            what=f"{option} is '{value}'",
            where="the command line",
            remedy=f"use {', '.join(known)}",
        )


def _check_numbers(
    frames: int,
    iterations: int,
    seed: int,
    clipmap_resolution: int | None,
    resolution: int,
    spp: int,
) -> None:
    from experiments.run import BATCH_COUNT
    from experiments.session import SMALLEST_PICTURE

    least = {
        "--frames": (frames, 2, "one frame does not tell its own noise"),
        "--iterations": (iterations, 1, ""),
        "--seed": (seed, 0, ""),
        "--resolution": (resolution, SMALLEST_PICTURE, ""),
        "--spp": (spp, BATCH_COUNT, ""),
    }
    if clipmap_resolution is not None:
        least["--clipmap-resolution"] = (clipmap_resolution, 8, "")
    for name, (value, smallest, reason) in least.items():
        if value < smallest:
            raise InputError(
                what=f"{name} is {value}" + (f", but {reason}" if reason else ""),
                where="the command line",
                remedy=f"give at least {smallest}",
            )
    if spp % BATCH_COUNT:
        raise InputError(
            what=f"--spp is {spp}",
            where="the command line",
            remedy=f"give a multiple of {BATCH_COUNT}, one share for each independent batch",
        )
    if clipmap_resolution is not None and clipmap_resolution & (clipmap_resolution - 1):
        raise InputError(
            what=f"--clipmap-resolution is {clipmap_resolution}",
            where="the command line",
            remedy="give a power of two",
        )
