"""`vctgi gate`: render what the gates ask for, and let them judge."""

from __future__ import annotations

from pathlib import Path

import metrics
from experiments.gate import GateSpec, load_gates, pinned_display, run_gate
from experiments.progress import ProgressReport
from experiments.run import RunOptions, run_scene
from experiments.scenes import load_scene
from experiments.session import find_preset, start_mitsuba, writable_folder
from reports.record import Record


def gate_scenes(
    gates_file: Path,
    *,
    output: Path,
    junit: Path | None,
    markdown: Path | None,
    update_reason: str | None,
    mutants: bool,
    variant: str | None,
    cache: Path,
) -> int:
    """Check the gates of a file and return the exit code.

    Raises
    ------
    InputError
        A gates file that cannot be used; nothing was rendered.
    """
    gates = load_gates(gates_file)
    writable_folder(output)
    chosen = start_mitsuba(variant)
    baselines = gates_file.parent / gates.baselines
    with ProgressReport() as progress:

        def render(gate: GateSpec) -> tuple[Record, Path]:
            find_preset(gate.preset, is_compared=True)
            number = [each.name for each in gates.gates].index(gate.name) + 1
            progress.start_scene(f"gate {gate.name}", number, len(gates.gates))
            loaded = load_scene(gate.scene, resolution=(gate.width, gate.height))
            # Pictures are judged as they were when the baseline was reviewed.
            pinned = pinned_display(baselines, gate, chosen)
            display = metrics.DisplaySettings(**pinned.model_dump()) if pinned else None
            options = RunOptions(
                preset=gate.preset,
                reference_spp=gate.reference_spp,
                is_counted=False,
                cache_directory=cache,
                command=f"vctgi gate {gates_file}",
            )
            return run_scene(loaded, options, output, chosen, progress, display)

        code = run_gate(
            gates_file,
            render,
            junit=junit,
            markdown=markdown,
            update_reason=update_reason,
            mutants=mutants,
        )
        verdict = {0: "passed", 1: "FAILED"}.get(code, "could not be judged")
        progress.say(f"{len(gates.gates)} gates: {verdict}")
    return code
