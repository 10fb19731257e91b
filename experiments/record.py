"""From a finished run to its record: pictures, facts, warnings, one JSON file."""

from __future__ import annotations

import dataclasses
import re
import secrets
from collections import Counter
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np

import metrics
import reference
from experiments.debug_pictures import voxel_images
from experiments.machine import BackendName, describe_machine
from experiments.noise import noise_warnings
from experiments.scenes import LoadedScene
from reports.record import (
    Display,
    FrameCost,
    ImageFile,
    Interval,
    MetricValue,
    NoiseFloor,
    PlanEntry,
    Record,
    ReferenceInfo,
    SceneInfo,
    StageTime,
    write_image,
    write_record,
)
from vctgi.config import RenderConfig
from vctgi.pipeline import FrameTally, LitVolume, PreparedScene
from vctgi.scene.lights import CAVEATS, KNOWN_KINDS, UNCOMPARED

NOTABLE_LOSS = 0.02
"""Share of injected flux whose loss is worth a warning."""

LONGEST_NAME = 160
"""Characters of a record's id before its time; with that, it stays below the schema's 200."""

METHOD = "voxel cone tracing"


class Options(Protocol):
    """What a record tells of how the run was asked for."""

    @property
    def preset(self) -> str:
        """Name of the configuration."""

    @property
    def seed(self) -> int:
        """Start of all random numbers."""

    @property
    def command(self) -> str:
        """What to type to make the record again."""


@dataclass
class RunResult:
    """All that a run found out.

    Attributes
    ----------
    loaded, config
        Scene and configuration.
    prepared, lit
        What the renderer made of them.
    truth
        The reference.
    tests, references
        Component pictures [height, width, 3] of both methods.
    floors
        Noise of the references, by component.
    surfaces
        Albedo, normal, depth.
    measured, times, display
        Numbers about them.
    """

    loaded: LoadedScene
    config: RenderConfig
    prepared: PreparedScene
    lit: LitVolume
    truth: reference.Reference
    tests: dict[str, np.ndarray]
    references: dict[str, np.ndarray]
    floors: dict[str, NoiseFloor]
    surfaces: dict[str, np.ndarray]
    measured: list[metrics.Measurement]
    times: list[StageTime]
    tally: FrameTally | None
    display: metrics.DisplaySettings


def keep_record(
    result: RunResult, options: Options, output: Path, variant: str
) -> tuple[Record, Path]:
    """Write the pictures and the record of a run below `output`/records."""
    created = datetime.now(UTC)
    preset = _file_word(options.preset)
    name = f"{result.loaded.name}-{preset}-{variant.split('_')[0]}"
    token = secrets.token_hex(2)
    record_id = f"{_fit_for_a_file(name)}-{created:%Y%m%dT%H%M%S}-{token}"
    records = output / "records"
    height, width = result.tests["image"].shape[:2]
    record = Record(
        record_id=record_id,
        created=created.isoformat(),
        command=options.command,
        scene=_scene_info(result),
        method=METHOD,
        preset=options.preset,
        config=config_values(result.config),
        plan=[PlanEntry(**dataclasses.asdict(e)) for e in result.prepared.plan.entries],
        seed=options.seed,
        width=width,
        height=height,
        reference=_reference_info(result),
        metrics=[metric_value(m) for m in result.measured],
        times=result.times,
        cost=_frame_cost(result),
        images=_write_images(result, records / record_id),
        machine=describe_machine(cast(BackendName, variant)),
        display=Display(**dataclasses.asdict(result.display)),
        warnings=_warnings(result),
    )
    return record, write_record(record, records)


def _fit_for_a_file(name: str) -> str:
    """Return a name as a record's id may hold it: a preset's label may have values in it."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name)[:LONGEST_NAME]


def _scene_info(result: RunResult) -> SceneInfo:
    loaded, prepared = result.loaded, result.prepared
    low, high = prepared.triangles.bounds
    kinds = Counter(material.kind for material in prepared.materials)
    sentences = {f"{m.kind}: {m.contribution}" for m in prepared.materials}
    return SceneInfo(
        name=loaded.name,
        title=loaded.title,
        source=loaded.source,
        purpose=loaded.purpose,
        digest=reference.scene_digest(loaded.scene),
        triangle_count=prepared.triangles.triangle_count,
        emitters=dict(Counter(light.kind for light in prepared.plan.lights)),
        bsdfs=dict(kinds),
        bounds_min=_point(low),
        bounds_max=_point(high),
        contributions=sorted(sentences),
        unsupported=unsupported_parts(prepared),
        credit=loaded.credit,
    )


def _point(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z


def unsupported_parts(prepared: PreparedScene) -> list[str]:
    """Name everything in the scene that the renderer does not do, or does untested."""
    found = list(prepared.triangles.unsupported)
    found += sorted(
        {f"material {m.kind}: {m.contribution}" for m in prepared.materials if not m.is_known}
    )
    found += sorted(
        {
            f"emitter {light.kind}: {CAVEATS.get(light.kind, UNCOMPARED)}"
            for light in prepared.plan.lights
            if light.kind not in KNOWN_KINDS
        }
    )
    if any(material.kind == "Null" for material in prepared.materials):
        found.append(
            "null surfaces: Mitsuba counts each as a scattering and stops shadow rays at it, so "
            "the two methods do not hold the same light behind one"
        )
    if any(shape.is_medium_transition() for shape in prepared.scene.shapes()):
        found.append("participating media: ignored on both sides")
    return found


def _reference_info(result: RunResult) -> ReferenceInfo:
    truth = result.truth
    reflected = float(truth.mean("direct").mean() + truth.mean("indirect").mean())
    rest = float(truth.mean("rest").mean())
    batches = truth.batches("indirect")
    is_lit = bool((batches.reshape(len(batches), -1).max(axis=1) > 0.0).all())
    noise = metrics.reference_noise_relmse(batches).value if is_lit else None
    return ReferenceInfo(
        key=truth.key,
        samples_per_pixel=truth.request.samples_per_pixel,
        batch_count=truth.request.batch_count,
        scattering_count=truth.request.scattering_count,
        seed=truth.request.seed,
        seconds=truth.seconds,
        from_cache=truth.from_cache,
        noise_relmse=noise,
        noise_floors=result.floors,
        truncated_share=rest / (reflected + rest) if reflected + rest > 0.0 else 0.0,
        notes=truth.notes,
    )


def _frame_cost(result: RunResult) -> FrameCost | None:
    tally = result.tally
    if tally is None:
        return None
    return FrameCost(
        gathering_cones=tally.gathering.cone_count,
        gathering_samples=tally.gathering.sample_count,
        specular_cones=tally.specular.cone_count,
        specular_samples=tally.specular.sample_count,
        near_field_rays=tally.gathering.ray_count + tally.specular.ray_count,
        voxel_bytes=result.lit.volume.byte_count,
    )


def metric_value(measurement: metrics.Measurement) -> MetricValue:
    """Return a measurement as records hold it."""
    low, high = measurement.low, measurement.high
    return MetricValue(
        name=measurement.name,
        component=measurement.component,
        value=measurement.value,
        interval=None if low is None or high is None else Interval(low=low, high=high),
        formula=measurement.formula,
        unit=measurement.unit,
        ideal=measurement.ideal,
        note=measurement.note,
    )


def _write_images(result: RunResult, folder: Path) -> dict[str, ImageFile]:
    """Write all pictures of a run."""
    tests, truths = result.tests, result.references
    pictures = {
        "image": (tests["image"], "emission + direct + indirect light by cones"),
        "reference": (truths["image"], "emission + direct + indirect light by path tracing"),
        "error": (tests["image"] - truths["image"], "image - reference"),
        "flip": (
            metrics.flip(tests["image"], truths["image"], result.display.flip).error_map,
            "HDR-FLIP of image against reference",
        ),
        "direct": (result.truth.mean("direct"), "direct light, Mitsuba's on both sides"),
        "emission": (result.truth.mean("emission"), "emission, Mitsuba's on both sides"),
    }
    for name in ("indirect", "indirect_diffuse", "indirect_specular"):
        pictures[name] = (tests[name], f"{name} by cones")
        pictures[f"reference_{name}"] = (truths[name], f"{name} by path tracing")
    for name, values in result.surfaces.items():
        pictures[name] = (values, f"{name} of the first surface")
    pictures |= voxel_images(result.prepared, result.lit.volume, result.config.voxelization.slots)
    return {
        name: write_image(folder / f"{name}.exr", np.asarray(values, np.float32), description)
        for name, (values, description) in pictures.items()
    }


def _warnings(result: RunResult) -> list[str]:
    """Collect what a reader must know before believing the numbers."""
    prepared = result.prepared
    found = list(result.loaded.warnings)
    degenerate = sum(prepared.triangles.degenerate_counts.values())
    if degenerate:
        found.append(f"{degenerate} triangles without area left out of the voxels")
    flipped = prepared.surfaces.flipped_count
    if flipped:
        found.append(
            f"{flipped} of {prepared.triangles.triangle_count} two-sided triangles are wound away "
            "from where they are seen and were turned over in the voxels"
        )
    for level, share in enumerate(result.lit.lost_flux_share):
        if share > NOTABLE_LOSS:
            found.append(
                f"level {level}: {100.0 * share:.1f} % of the reflected light was not injected: "
                "it fell on sides that no camera path meets, or where the voxels have no opacity"
            )
    found += [
        f"left out: {entry.item}: {entry.reason}"
        for entry in prepared.plan.entries
        if entry.item.startswith("geometry") and not entry.kept
    ]
    found += noise_warnings(result.floors, result.measured, result.truth.request.samples_per_pixel)
    return list(dict.fromkeys(found))


def config_values(config: RenderConfig) -> dict[str, Any]:
    """Return a configuration as a record holds it.

    What is kept stands there only where something is: gates compare configurations, and one that
    overrides nothing is the one that baselines were reviewed with.
    """
    values = dataclasses.asdict(config)
    if not config.keep:
        del values["keep"]
    return values


def _file_word(preset: str) -> str:
    """Return a preset's name without the colon of "peer:compix" or the path of a preset file."""
    return (Path(preset).stem if preset.endswith(".toml") else preset).replace(":", "-")
