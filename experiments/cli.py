"""The command line `vctgi`.

Exit codes: 0 done, 1 a gate or comparison failed, 2 bad usage or bad input, 3 the machinery failed.
An error is one line on standard error; `--debug` adds the traceback.
"""

from __future__ import annotations

import sys
import traceback
from pathlib import Path
from typing import Annotated

from cyclopts import App, CycloptsError, Parameter

from experiments.bench.command import bench
from experiments.cli_options import (
    Cache,
    JsonFile,
    Keep,
    Preset,
    Presets,
    Resolution,
    Sensor,
    Spp,
    Variant,
)
from experiments.cli_values import (
    at_least,
    finish,
    kept_names,
    picture_size,
    reference_folder,
    run_options,
)
from experiments.errors import (
    EXIT_BAD_INPUT,
    EXIT_DONE,
    EXIT_MACHINERY,
    InputError,
    MachineryError,
)
from experiments.optimize.command import optimize
from experiments.sweep.command import sweep
from experiments.sweep.job_command import sweep_job, sweep_scenes
from experiments.sweep.results_command import results

app = App(
    name="vctgi",
    help="How wrong is real-time global illumination by voxel cone tracing? Renders a Mitsuba "
    "scene by cones and by path tracing, and measures the difference.",
    help_flags=["--help", "-h"],
    result_action="return_value",
)
for command in (bench, optimize, sweep, results):
    app.command(command)
app.command(sweep_job, show=False)
app.command(sweep_scenes, show=False)


@app.command
def report(  # noqa: PLR0913 - the options of a command
    *scenes: str,
    output: Path = Path("vctgi-report"),
    preset: Presets | None = None,
    resolution: Resolution | None = None,
    spp: Spp = 512,
    seed: int = 0,
    variant: Variant = None,
    sensor: Sensor = 0,
    cache: Cache = None,
    keep: Keep = None,
    json_file: JsonFile = None,
) -> int:
    """Render scenes both ways and write one page that says how wrong the cones are.

    SCENES are Mitsuba XML files, Python files with a scene() function, glTF, OBJ or PLY meshes, or
    names of built-in scenes; all built-in scenes if none is given. Without a preset, 'high'; with
    several, the page shows them side by side.
    """
    from experiments.report import make_report
    from experiments.session import list_presets

    presets = list_presets(["high"] if preset is None else preset)
    page = make_report(
        list(scenes),
        output=output,
        presets=presets,
        options=run_options(presets[0], spp, seed, cache, keep),
        resolution=picture_size(resolution),
        variant=variant,
        sensor=sensor,
        json_file=json_file,
    )
    print(page)  # noqa: T201 - the command's result
    return EXIT_DONE


@app.command
def plan(
    scene: str,
    *,
    preset: Preset = "high",
    resolution: Resolution | None = None,
    variant: Variant = None,
    sensor: Sensor = 0,
    keep: Keep = None,
    json_file: JsonFile = None,
) -> int:
    """Show what would be run for a scene and what is left out, with reasons."""
    from experiments.inspect import plan_lines

    size = picture_size(resolution)
    lines, entries = plan_lines(scene, preset, size, variant, sensor, kept_names(keep))
    finish(lines, entries, json_file)
    return EXIT_DONE


@app.command
def render(  # noqa: PLR0913 - the options of a command
    scene: str,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    preset: Preset = "high",
    resolution: Resolution | None = None,
    spp: Annotated[int, Parameter(help="Paths a pixel of the direct light.")] = 64,
    seed: int = 0,
    variant: Variant = None,
    sensor: Sensor = 0,
    keep: Keep = None,
    debug: Annotated[
        str | None,
        Parameter(
            help="Also write pictures of what lies between, to a folder beside the file: voxels."
        ),
    ] = None,
) -> int:
    """Render one frame by cones to a multi-channel EXR file."""
    from experiments.frame_files import render_frame_file

    lines = render_frame_file(
        scene,
        output,
        preset,
        resolution,
        at_least("--spp", spp, 1),
        at_least("--seed", seed, 0),
        variant,
        sensor,
        debug,
        kept_names(keep),
    )
    if lines:
        print("\n".join(lines))  # noqa: T201 - the command's result
    return EXIT_DONE


@app.command
def reference(  # noqa: PLR0913 - the options of a command
    scene: str,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    resolution: Resolution | None = None,
    spp: Annotated[
        int | None,
        Parameter(
            name="--spp",
            help="Paths a pixel, 512 if left out; with --target-relmse at most so many, or 65536.",
        ),
    ] = None,
    target_relmse: Annotated[
        float | None,
        Parameter(help="Add batches until the noise of the mean, as a relMSE, is below this."),
    ] = None,
    seed: int = 0,
    variant: Variant = None,
    sensor: Sensor = 0,
    cache: Cache = None,
) -> int:
    """Render the path-traced truth to a multi-channel EXR file, with a variance per component.

    Finished batches are kept, so that a run which was stopped goes on where it was.
    """
    from experiments.reference_file import TargetOptions, reference_file, reference_to_target

    if target_relmse is None:
        options = run_options("high", 512 if spp is None else spp, seed, cache)
        line = reference_file(scene, output, resolution, options, variant, sensor)
    else:
        target = TargetOptions(
            relmse=target_relmse, most_spp=spp, seed=seed, cache=reference_folder(cache)
        )
        line = reference_to_target(scene, output, resolution, target, variant, sensor)
    print(line)  # noqa: T201 - the command's result
    return EXIT_DONE


@app.command
def gate(  # noqa: PLR0913 - the options of a command
    gates: Path = Path("tests/gates/gates.toml"),
    *,
    output: Path = Path("build/gate"),
    junit: Path | None = None,
    markdown: Path | None = None,
    update: Annotated[bool, Parameter(negative="")] = False,
    reason: str | None = None,
    mutants: Annotated[bool, Parameter(negative="")] = False,
    only: Annotated[
        list[str] | None,
        Parameter(help="Name of a gate to check alone; may be repeated.", negative=""),
    ] = None,
    variant: Variant = None,
    cache: Cache = None,
) -> int:
    """Check scenes against reviewed baselines; exit 1 on a true regression.

    `--update --reason TEXT` writes the baselines instead; `--mutants` also plants faults and
    demands that the gates catch them.
    """
    from experiments.gate_command import GateOptions, gate_scenes

    if update != (reason is not None):
        raise InputError(
            what="--update and --reason go together",
            where="the command line",
            remedy="write: vctgi gate GATES --update --reason 'why the new numbers are right'",
        )
    return gate_scenes(
        gates,
        GateOptions(
            junit=junit, markdown=markdown, update_reason=reason, mutants=mutants, only=only or []
        ),
        output=output,
        variant=variant,
        cache=reference_folder(cache),
    )


@app.command
def study(  # noqa: PLR0913 - the options of a command
    name: str | None = None,
    *,
    quick: Annotated[
        bool, Parameter(negative="", help="A smaller version, a minute on two cores.")
    ] = False,
    only: Annotated[
        str | None, Parameter(help="Measure only the checks whose name holds this text.")
    ] = None,
    resume: Annotated[
        bool, Parameter(negative="", help="Keep numbers that the same code has measured before.")
    ] = False,
    scene: Annotated[
        str | None, Parameter(help="Scene for the checks that take one, such as those of speed.")
    ] = None,
    output: Annotated[
        Path | None, Parameter(help="Folder for record, figures and a page of all studies in it.")
    ] = None,
    pdf: Annotated[
        bool, Parameter(negative="", help="Also the page as PDF, with --output (extra [pdf]).")
    ] = False,
    variant: Variant = None,
    cache: Cache = None,
    json_file: JsonFile = None,
) -> int:
    """Run a named experiment; exit 1 when one of its numbers misses its limit.

    Without a NAME, list the studies.
    """
    from experiments.studies.command import StudyOptions, run_study, study_titles

    if name is None:
        titles = study_titles()
        width = max(map(len, titles))
        lines = [f"{each.ljust(width)}  {title}" for each, title in titles.items()]
        finish(lines, titles, json_file)
        return EXIT_DONE
    return run_study(
        name,
        StudyOptions(quick=quick, only=only, resume=resume, scene=scene, pdf=pdf),
        output=output,
        variant=variant,
        cache=cache,
        json_file=json_file,
    )


@app.command
def doctor(*, json_file: JsonFile = None) -> int:
    """Show back ends, LLVM, driver and versions, and how to fix what is missing."""
    from experiments.doctor import diagnose, report_lines

    found = diagnose()
    finish(report_lines(found), found.to_json(), json_file)
    return EXIT_DONE if found.is_healthy else EXIT_MACHINERY


def main(arguments: list[str] | None = None) -> int:
    """Run a command and return its exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    given, is_debug = _take_debug(given)
    try:
        code = app(given, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        return _fail(f"{_one_line(error)}; see 'vctgi --help'", EXIT_BAD_INPUT, is_debug)
    except InputError as error:
        return _fail(str(error), EXIT_BAD_INPUT, is_debug)
    except MachineryError as error:
        return _fail(str(error), EXIT_MACHINERY, is_debug)
    except KeyboardInterrupt:
        return _fail("interrupted", EXIT_MACHINERY, is_debug=False)
    except Exception as error:  # the last net: still one line
        return _fail(_unforeseen(error), _unforeseen_code(error), is_debug)
    return code if isinstance(code, int) else EXIT_DONE


def _take_debug(given: list[str]) -> tuple[list[str], bool]:
    """Part the bare `--debug`, which asks for a traceback, from `render`'s `--debug NAME`."""
    kept: list[str] = []
    is_debug = False
    for place, word in enumerate(given):
        follower = given[place + 1 : place + 2]
        has_name = kept[:1] == ["render"] and follower and not follower[0].startswith("-")
        if word == "--debug" and not has_name:
            is_debug = True
        else:
            kept.append(word)
    return kept, is_debug


def _unforeseen(error: Exception) -> str:
    """One line for an error that no command foresaw, or that the renderer raised for the scene."""
    if _unforeseen_code(error) == EXIT_BAD_INPUT:
        return _one_line(error)
    return f"{type(error).__name__}: {_one_line(error)}; run again with --debug for the traceback"


def _unforeseen_code(error: Exception) -> int:
    """Return 2 for a scene that the renderer refuses, 3 for anything else."""
    refused = sys.modules.get("vctgi.errors")
    is_refused = refused is not None and isinstance(error, refused.SceneError)
    return EXIT_BAD_INPUT if is_refused else EXIT_MACHINERY


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _fail(line: str, code: int, is_debug: bool) -> int:
    """Print the one line, after the traceback if it is asked for."""
    if is_debug:
        traceback.print_exc()
    sys.stderr.write(f"vctgi: {line}\n")
    return code
