"""`vctgi report`: scenes to records, records to one page."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from experiments.errors import InputError
from experiments.measured_scene import load_measured_scene
from experiments.progress import ProgressReport
from experiments.run import RunOptions, run_scene
from experiments.scenes import BUILT_IN, LoadedScene
from experiments.session import (
    start_mitsuba,
    writable_file,
    writable_folder,
)
from reports.accuracy import write_accuracy_report
from reports.headline import noise_bound
from reports.markdown import write_markdown_summary
from reports.record import Record
from reports.sheet import write_sheet
from vctgi.errors import SceneError

PAGE, SUMMARY, SHEET = "index.html", "summary.md", "sheet.jpg"
"""Files that a report leaves in its folder, beside `records/`."""

LONG_SHEET = 24
"""Records from which on the pictures of the sheet are half as wide, so that it can be looked at."""


def make_report(
    sources: list[str],
    *,
    presets: Sequence[str],
    output: Path,
    options: RunOptions,
    resolution: int | None,
    variant: str | None,
    sensor: int,
    json_file: Path | None,
) -> Path:
    """Render scenes both ways and write the page about them.

    Parameters
    ----------
    sources
        Scenes as the command line takes them; empty for all built-in ones.
    presets
        Configurations that each scene is rendered with; at least one.
    output
        Folder for the page and the records.
    options
        Samples, seed; its preset does not matter.
    resolution
        Longer edge of the pictures, pixels; None for the default.
    variant
        Back end, or None to choose.
    sensor
        Which camera of each scene.
    json_file
        Gets the records' numbers as one JSON list.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    InputError
        Bad input. A scene that turns out to be unfit only while it is rendered, or with one of the
        presets, does not take the others with it: their page is written first.
    ValueError
        A picture that cannot be measured, in the same way.
    """
    chosen = start_mitsuba(variant)
    names = sources or list(BUILT_IN)
    results: list[tuple[Record, Path]] = []
    failures: list[Exception] = []
    with ProgressReport() as progress:
        # All scenes are loaded and checked before the first is rendered: a typing error in the
        # last name must not cost the minutes of the others.
        for name in names:
            load_measured_scene(name, resolution, sensor)
        writable_folder(output)
        if json_file is not None:
            writable_file(json_file, "--json")
        for number, name in enumerate(names, start=1):
            loaded = load_measured_scene(name, resolution, sensor)
            for place, preset in enumerate(presets, start=1):
                about = f", {preset}" if len(presets) > 1 else ""
                done = (number - 1) * len(presets) + place
                progress.start_scene(loaded.title + about, done, len(names) * len(presets))
                wanted = replace(options, preset=preset)
                command = _command(name, resolution, wanted, chosen, loaded)
                wanted = replace(wanted, command=command)
                try:
                    record, path = run_scene(loaded, wanted, output, chosen, progress)
                except (InputError, SceneError, ValueError) as error:
                    # The others are still worth a page.
                    failures.append(error)
                    progress.say(f"left out{about}: {' '.join(str(error).split())}")
                    continue
                results.append((record, path))
                progress.say(f"{preset}: {headline(record)}" if about else headline(record))
    if not results:
        raise failures[0]
    paths = [path for _, path in results]
    page = write_accuracy_report(paths, output / PAGE)
    write_markdown_summary(paths, output / SUMMARY)
    write_sheet(paths, output / SHEET, width=240 if len(paths) <= LONG_SHEET else 120)
    if json_file is not None:
        rows = [record.model_dump(mode="json") for record, _ in results]
        json_file.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    if failures:
        raise failures[0]
    return page


def _command(
    name: str, resolution: int | None, options: RunOptions, variant: str, loaded: LoadedScene
) -> str:
    """Return what to type to make a record again."""
    words = ["vctgi", "report", name, "--preset", options.preset]
    if resolution is not None:
        words += ["--resolution", str(resolution)]
    words += [word for name in options.keep for word in ("--keep", name)]
    words += ["--spp", str(options.reference_spp), "--seed", str(options.seed)]
    return shlex.join([*words, "--variant", variant, "--sensor", str(loaded.sensor_index)])


def headline(record: Record) -> str:
    """One line about a finished record."""
    values = {(m.component, m.name): m for m in record.metrics}

    def text(component: str, name: str) -> str:
        found = values.get((component, name))
        if found is None:
            return "-"
        bound = noise_bound(found, record)
        if bound is not None:
            return f"below the noise (under {bound:.3g})"
        if found.interval is None:
            return f"{found.value:.3g}"
        return f"{found.value:.3g} [{found.interval.low:.3g}, {found.interval.high:.3g}]"

    frame = next(t for t in record.times if t.stage == "frame")
    return (
        f"{record.scene.title}: indirect energy {text('indirect', 'energy_ratio')}, "
        f"relMSE {text('indirect', 'relmse_e2')}, picture FLIP {text('image', 'flip')}, "
        f"{frame.median_ms / 1e3:.2f} s a frame"
    )
