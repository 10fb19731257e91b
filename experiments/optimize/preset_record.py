"""A fit as a preset file, with the record of how it was made, and as JSON."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import vctgi
from experiments.optimize.findings import Measured, ViewFinding, mean_ratio
from experiments.optimize.run import FitOptions, FitResult
from reports.record import Machine
from vctgi.preset_file import PresetFile, config_changes, is_preset_file, read_preset_file


def fitted_preset(
    options: FitOptions, result: FitResult, command: str, machine: Machine
) -> PresetFile:
    """Return the file: what the fit changed of the preset that it started from, and the record."""
    base_name = options.preset
    if is_preset_file(base_name):
        # A file's base is a preset that is no file, so that files do not depend on one another.
        base_name = read_preset_file(base_name).base
    elif base_name in vctgi.config.shipped_presets():
        base_name = read_preset_file(vctgi.config.shipped_presets()[base_name]).base
    base = vctgi.preset(base_name)
    fitted = result.fitted
    if options.clipmap_resolution is not None:
        clipmap = vctgi.preset(options.preset).clipmap
        fitted = replace(fitted, clipmap=clipmap)
    changes, unset = config_changes(base, fitted)
    return PresetFile(
        base=base_name,
        changes=changes,
        unset=unset,
        record=fit_record(options, result, command, machine),
    )


def fit_record(
    options: FitOptions, result: FitResult, command: str, machine: Machine
) -> dict[str, Any]:
    """Return how a fit was made and what it found, as TOML and JSON hold it."""
    start, end = result.objective
    record: dict[str, Any] = {
        "command": command,
        "scenes": list(options.scenes),
        "held_out": [each.title for each in result.held_out],
        "preset": options.preset,
        "method": options.method,
        "derivatives": options.derivatives,
        "ended": result.minimum.message,
        "points": result.minimum.evaluations,
        "seed": options.seed,
        "frames_per_view": options.frame_count,
        "resolution": options.resolution,
        "reference_spp": options.reference_spp,
        "objective_before": start,
        "objective_after": end,
        "backend": machine.backend,
        "device": machine.device,
        "commit": machine.commit,
        "has_changes": machine.is_dirty,
        "versions": dict(machine.versions),
        "parameters": _parameter_rows(result),
        "training": {each.title: _view_row(each) for each in result.training},
        "unseen": {each.title: _view_row(each) for each in result.held_out},
    }
    if options.clipmap_resolution is not None:
        record["clipmap_resolution"] = options.clipmap_resolution
    if result.held_out:
        record["held_out_ratio"] = asdict(mean_ratio(result.held_out))
    return record


def parameter_interval(result: FitResult, number: int) -> Measured | None:
    """Return the interval of a parameter; None where a method gives none."""
    if result.uncertainty is None:
        return None
    parameter, half = result.parameters[number], result.uncertainty.half_widths[number]
    low, high = parameter.inner_bounds
    centre = float(result.end[number])
    # Ends beyond a bound are the bound: the parameter is not allowed past it.
    return Measured(
        value=parameter.outer(centre),
        low=parameter.outer(max(centre - float(half), low)),
        high=parameter.outer(min(centre + float(half), high)),
    )


def _parameter_rows(result: FitResult) -> dict[str, Any]:
    rows = {}
    for number, parameter in enumerate(result.parameters):
        row: dict[str, Any] = {
            "start": float(parameter.outer(float(result.start[number]))),
            "end": float(parameter.outer(float(result.end[number]))),
            "bounds": [float(parameter.low), float(parameter.high)],
        }
        interval = parameter_interval(result, number)
        if interval is not None and result.uncertainty is not None:
            row["interval"] = [interval.low, interval.high]
            row["is_identified"] = bool(result.uncertainty.is_identified[number])
            row["is_at_bound"] = bool(result.uncertainty.is_held[number])
        rows[parameter.name] = row
    return rows


def _view_row(finding: ViewFinding) -> dict[str, Any]:
    before, after = finding.error
    return {
        "relmse_e2_before": [before.value, before.low, before.high],
        "relmse_e2_after": [after.value, after.low, after.high],
        "ratio": [finding.ratio.value, finding.ratio.low, finding.ratio.high],
        "dark_excess": list(finding.dark_excess),
        "missing_energy": list(finding.missing_energy),
        "samples_per_pixel": list(finding.samples),
        "rays_per_pixel": list(finding.rays),
        "gathering_ms": list(finding.milliseconds),
    }
