"""`vctgi plan`: what would be run for a scene, and what is left out."""

from __future__ import annotations

import dataclasses
from typing import Any

import vctgi
from experiments.record import unsupported_parts
from experiments.scenes import load_scene
from experiments.session import DEFAULT_RESOLUTION, find_preset, start_mitsuba
from vctgi.plan_entries import PlanEntry


def plan_lines(
    source: str,
    preset: str,
    resolution: int | None,
    variant: str | None,
    sensor: int,
    keep: tuple[str, ...] = (),
) -> tuple[list[str], list[dict[str, Any]]]:
    """Return the plan of a scene as lines of a table and as plain values."""
    find_preset(preset)
    start_mitsuba(variant)
    config = dataclasses.replace(vctgi.preset(preset), keep=keep)
    loaded = load_scene(
        source,
        resolution=resolution,
        default_resolution=DEFAULT_RESOLUTION,
        sensor_index=sensor,
        needs_light=config.mode != "ambient",
    )
    camera = loaded.scene.sensors()[loaded.sensor_index]
    prepared = vctgi.prepare_scene(loaded.scene, camera, config)
    entries = prepared.plan.entries
    width = max(len(entry.item) for entry in entries)
    lines = [f"{loaded.title}: {prepared.triangles.triangle_count:,} triangles"]
    for entry in entries:
        verdict = "kept    " if entry.kept else "left out"
        lines.append(f"  {verdict}  {entry.item:<{width}}  {entry.reason}{_consequences(entry)}")
    warnings = [*loaded.warnings, *unsupported_parts(prepared)]
    lines += [f"  warning   {warning}" for warning in warnings]
    return lines, [dataclasses.asdict(entry) for entry in entries]


def _consequences(entry: PlanEntry) -> str:
    """Say what leaving something out saves, changes in the picture, and what keeps it."""
    words = [
        f"saves {entry.saved}" if entry.saved and not entry.kept else "",
        f"picture: {entry.bound}" if entry.bound else "",
        f"override: {entry.override}" if entry.override else "",
    ]
    said = "; ".join(word for word in words if word)
    return f" ({said})" if said else ""
