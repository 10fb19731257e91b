"""`vctgi gate`: render what the gates ask for, and let them judge."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import cast

import metrics
import vctgi
from experiments.errors import InputError
from experiments.gate import GateSpec, StudyGate, load_gates, pinned_display, run_gate
from experiments.machine import BackendName, describe_machine
from experiments.progress import ProgressReport
from experiments.run import RunOptions, run_scene
from experiments.scenes import load_scene
from experiments.session import find_preset, start_mitsuba, writable_file, writable_folder
from experiments.studies.catalogue import checks_of, find_study
from experiments.studies.check import Check, StudyContext
from experiments.studies.run import measured_row
from reports.record import Record
from reports.study_record import StudyRecord


@dataclass(frozen=True, kw_only=True)
class GateOptions:
    """What is done with the gates of a file, and where it is reported."""

    junit: Path | None = None
    markdown: Path | None = None
    """Files of the verdicts, and of the failures."""
    update_reason: str | None = None
    """Given: write baselines with this reason instead of comparing."""
    mutants: bool = False
    """Also plant every mutant, and demand that it is caught."""
    only: Sequence[str] = ()
    """Names of the gates to check; none: all."""


def gate_scenes(
    gates_file: Path, options: GateOptions, *, output: Path, variant: str | None, cache: Path
) -> int:
    """Check the gates of a file and return the exit code.

    Raises
    ------
    InputError
        A gates file that cannot be used, a preset or a check that does not exist, a report that
        cannot be written; nothing was rendered.
    """
    gates = load_gates(gates_file)
    if options.only:
        gates = gates.only(options.only)
    writable_folder(output)
    for report, option in ((options.junit, "--junit"), (options.markdown, "--markdown")):
        if report is not None:
            writable_file(report, option)
    chosen = start_mitsuba(variant)
    for each in gates.gates:
        find_preset(each.preset, is_compared=True)
    for study in gates.studies:
        require_checks(study, [*study.needed, *study.planted])
    baselines = gates_file.parent / gates.baselines
    with ProgressReport() as progress:

        def render(gate: GateSpec) -> tuple[Record, Path]:
            number = [each.name for each in gates.gates].index(gate.name) + 1
            progress.start_scene(f"gate {gate.name}", number, len(gates.gates))
            loaded = load_scene(scene_of(gate, gates_file), resolution=(gate.width, gate.height))
            # Pictures are judged as they were when the baseline was reviewed.
            pinned = pinned_display(baselines, gate, chosen)
            display = metrics.DisplaySettings(**pinned.model_dump()) if pinned else None
            run_options = RunOptions(
                preset=gate.preset,
                config=config_of(gate),
                reference_spp=gate.reference_spp,
                is_counted=gate.memory is not None,
                cache_directory=cache,
                command=f"vctgi gate {gates_file}",
            )
            return run_scene(loaded, run_options, output, chosen, progress, display)

        def measure(gate: StudyGate, names: Sequence[str]) -> StudyRecord:
            return measure_study(gate, names, chosen, progress)

        code = run_gate(
            gates_file,
            render,
            measure,
            junit=options.junit,
            markdown=options.markdown,
            update_reason=options.update_reason,
            mutants=options.mutants,
            only=options.only,
        )
        verdict = {0: "passed", 1: "FAILED"}.get(code, "could not be judged")
        progress.say(f"{len(gates.gates) + len(gates.studies)} gates: {verdict}")
    return code


def config_of(gate: GateSpec) -> vctgi.RenderConfig:
    """Return the preset's configuration, with the camera rays that the gate asks for."""
    config = vctgi.preset(gate.preset)
    if gate.samples_per_pixel is None:
        return config
    return replace(config, samples_per_pixel=gate.samples_per_pixel)


def scene_of(gate: GateSpec, gates_file: Path) -> str:
    """Return the scene to load: a file beside the gates file, or else what the gate names."""
    beside = gates_file.parent / gate.scene
    return str(beside) if beside.is_file() else gate.scene


def require_checks(gate: StudyGate, names: Sequence[str]) -> dict[str, Check]:
    """Return the checks of a gate's study by name, all of `names` among them.

    Raises
    ------
    InputError
        No such study, or no check of a name.
    """
    known = {check.name: check for check in checks_of(find_study(gate.study))}
    for name in names:
        if name not in known:
            raise InputError(
                f"study {gate.study} has no check {name!r}",
                f"gate {gate.name}",
                f"`vctgi study {gate.study}` names them",
            )
    return known


def measure_study(
    gate: StudyGate, names: Sequence[str], variant: str, progress: ProgressReport
) -> StudyRecord:
    """Measure some checks of the study that a gate names.

    Raises
    ------
    InputError
        No such study, or no check of a name.
    """
    known = require_checks(gate, names)
    context = StudyContext(quick=gate.quick, progress=progress)
    words = [gate.study, *(["--quick"] if gate.quick else [])]
    rows = []
    for number, name in enumerate(names, start=1):
        progress.start_scene(f"gate {gate.name}: {name}", number, len(names))
        rows.append(measured_row(shlex.join(words), known[name], context))
    return StudyRecord(
        study=gate.study,
        quick=gate.quick,
        created=datetime.now(UTC),
        command=shlex.join(["vctgi", "study", *words]),
        rows=rows,
        machine=describe_machine(cast(BackendName, variant)),
    )
