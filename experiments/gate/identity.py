"""The kinds `finite` and `exact`: sound pictures of the same thing, measured the same way."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from experiments.errors import MachineryError
from experiments.gate.baseline import Baseline, config_hash
from experiments.gate.finding import UPDATE_REMEDY, Finding
from experiments.gate.specification import GateSpec
from reports.record import Record, load_image
from reports.voxel_sheet import is_voxel_image

SIGNED_IMAGES: Final = frozenset({"error", "normal"})
"""Pictures that may be negative; all others hold radiance, shares or distances."""


def check_finite(record: Record, record_path: Path) -> Finding:
    """Find NaN, infinite and, where none may be, negative values in the pictures of a record.

    Raises
    ------
    MachineryError
        When the record has no picture, or one is missing or altered.
    """
    if not record.images:
        raise MachineryError("no picture to check", str(record_path), "record the images")
    faults: list[str] = []
    count = 0
    # Pictures of voxels mark what is unknown by NaN and hold normals; nothing is measured on them.
    names = [name for name in sorted(record.images) if not is_voxel_image(name)]
    for name in names:
        try:
            pixels = load_image(record_path, record, name)
        except ValueError as error:
            raise MachineryError(str(error), f"image {name}", "render it again") from error
        is_finite = np.isfinite(pixels)
        not_finite = int(np.count_nonzero(~is_finite))
        is_negative = is_finite & (pixels < 0.0)
        negative = 0 if name in SIGNED_IMAGES else int(np.count_nonzero(is_negative))
        count += not_finite + negative
        if not_finite or negative:
            faults.append(f"{name}: {not_finite} not finite, {negative} negative")
    return Finding(
        kind="finite",
        passed=not faults,
        value=float(count),
        limit="0 values not finite or negative",
        message="; ".join(faults) or f"{len(names)} pictures are finite",
    )


def require_as_asked(record: Record, gate: GateSpec) -> None:
    """Refuse a record that is not of what the gate asked to render.

    Raises
    ------
    MachineryError
        When preset or resolution differ, or the reference has fewer samples than asked for.
    """
    spp = 0 if record.reference is None else record.reference.samples_per_pixel
    asked = f"preset {gate.preset}, {gate.width}x{gate.height}, {gate.reference_spp} reference spp"
    got = f"preset {record.preset}, {record.width}x{record.height}, {spp} reference spp"
    same = (record.preset, record.width, record.height) == (gate.preset, gate.width, gate.height)
    if not same or spp < gate.reference_spp:
        raise MachineryError(
            f"asked for {asked}; got {got}",
            f"record {record.record_id} of gate {gate.name}",
            "render what the gate asks for",
        )


def check_identity(record: Record, baseline: Baseline) -> dict[str, Finding]:
    """Compare what must be the same for two records' numbers to be comparable.

    Returns
    -------
    dict
        A finding of kind `exact` for each of: scene digest, configuration, method, back end,
        resolution, scatterings.
    """
    measured, stored = record.reference, baseline.reference
    pairs: dict[str, tuple[object, object]] = {
        "scene digest": (record.scene.digest, baseline.scene_digest),
        "configuration": (config_hash(record.config), baseline.config_hash),
        "method": (record.method, baseline.method),
        "back end": (record.machine.backend, baseline.backend),
        "resolution": (
            f"{record.width}x{record.height}",
            f"{baseline.width}x{baseline.height}",
        ),
        "scatterings": (
            None if measured is None else measured.scattering_count,
            None if stored is None else stored.scattering_count,
        ),
    }
    return {name: _same(value, wanted) for name, (value, wanted) in pairs.items()}


def _same(value: object, wanted: object) -> Finding:
    passed = value == wanted
    return Finding(
        kind="exact",
        passed=passed,
        value=None,
        limit=f"exactly {wanted}",
        message="the same" if passed else f"{value}, the baseline has {wanted}; {UPDATE_REMEDY}",
    )
