"""`vctgi plan`: what would be run for a scene, and what is left out."""

from __future__ import annotations

import dataclasses
from typing import Any

import vctgi
from experiments.record import unsupported_parts
from experiments.scenes import load_scene
from experiments.session import DEFAULT_RESOLUTION, find_preset, start_mitsuba


def plan_lines(
    source: str, preset: str, resolution: int | None, variant: str | None, sensor: int
) -> tuple[list[str], list[dict[str, Any]]]:
    """Return the plan of a scene as lines of a table and as plain values."""
    find_preset(preset)
    start_mitsuba(variant)
    config = vctgi.preset(preset)
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
        saved = f" (saves {entry.saved})" if entry.saved and not entry.kept else ""
        lines.append(f"  {verdict}  {entry.item:<{width}}  {entry.reason}{saved}")
    warnings = [*loaded.warnings, *unsupported_parts(prepared)]
    lines += [f"  warning   {warning}" for warning in warnings]
    return lines, [dataclasses.asdict(entry) for entry in entries]
