"""The pictures of one record, read, checked and made ready for a page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from reports.pictures import (
    Floats,
    SignedMap,
    finite_pixels,
    linear_payload,
    luminance,
    normal_uri,
    sequential_uri,
    signed_map,
    thumbnail_uri,
    tone_mapped_uri,
)
from reports.record import load_image
from reports.schema import Record
from reports.voxel_sheet import VoxelRow, is_voxel_image, voxel_rows

COMPONENTS = (
    ("indirect_diffuse", "indirect diffuse"),
    ("indirect_specular", "indirect specular"),
    ("indirect", "indirect"),
    ("direct", "direct"),
    ("emission", "emission"),
    ("albedo", "albedo"),
    ("normal", "normal"),
    ("depth", "depth"),
)
"""Component pictures in the order of the page, by name in a record and by title."""

Detail = Literal["all", "most", "viewer", "none"]
"""Pictures of a record that are shown: "most" are all but the linear values for the exposure,
"viewer" are those of the slider and its maps, so that a page of many records of a scene stays below
20 MB."""

EXPOSURE_PIXEL_LIMIT = 512 * 512
"""Pictures of more pixels come without linear values (some 3 bytes a pixel), and so without an
exposure control, so that a page of ten scenes stays below 20 MB at the sizes of the report."""


@dataclass(frozen=True, kw_only=True)
class Component:
    """One column of the component pictures; each side a PNG data URI."""

    title: str
    ours: str | None
    reference: str | None
    caption: str


@dataclass(frozen=True, kw_only=True)
class Pictures:
    """The pictures of a record as data URIs; None where the record has none."""

    image: str | None
    reference: str | None
    thumbnail: str | None
    image_payload: str | None
    reference_payload: str | None
    error: SignedMap | None
    relative_scale: float | None
    """The error map's scale over the reference's mean luminance."""
    flip: str | None
    components: list[Component]
    voxels: list[VoxelRow]
    faults: list[str]
    """What is wrong with the pictures, a sentence each."""


def read_pictures(record_path: Path, record: Record, detail: Detail = "all") -> Pictures:
    """Read every picture of a record that a page shows.

    Parameters
    ----------
    record_path, record
        The record and its file.
    detail
        Which of them are made ready; all are read and checked.

    Raises
    ------
    ValueError
        When a picture is missing on disk, altered, or not readable (`load_image`).
    """
    linear = {name: load_image(record_path, record, name) for name in sorted(record.images)}
    faults = _faults(linear)
    if detail == "none":
        linear = {}
    exposure = record.display.exposure
    image, reference = linear.get("image"), linear.get("reference")
    flip = linear.get("flip")
    error = signed_map(linear["error"]) if "error" in linear else None
    return Pictures(
        image=_tone_mapped(image, exposure),
        reference=_tone_mapped(reference, exposure),
        thumbnail=None if image is None else thumbnail_uri(image, exposure=exposure),
        image_payload=_payload(image) if detail == "all" else None,
        reference_payload=_payload(reference) if detail == "all" else None,
        error=error,
        relative_scale=_relative_scale(error, reference),
        flip=None if flip is None else sequential_uri(flip, low=0.0, high=1.0, colours="magma"),
        components=_components(linear, exposure) if detail in ("all", "most") else [],
        voxels=voxel_rows(linear, record.images, exposure=exposure)
        if detail in ("all", "most")
        else [],
        faults=faults,
    )


def _components(linear: dict[str, Floats], exposure: float) -> list[Component]:
    """Columns that at least one side has a picture for."""
    columns = []
    for name, title in COMPONENTS:
        ours, reference = linear.get(name), linear.get(f"reference_{name}")
        if ours is None and reference is None:
            continue
        uri: str | None
        if name == "depth" and ours is not None:
            uri, caption = _depth(ours)
        elif name == "normal" and ours is not None:
            uri, caption = normal_uri(ours), "world space, -1 to 1 per axis"
        elif name == "albedo" and ours is not None:
            uri, caption = tone_mapped_uri(ours, exposure=0.0), "reflectance, 0 to 1"
        else:
            uri, caption = _tone_mapped(ours, exposure), ""
        if reference is None and not caption:
            caption = (
                "no reference picture" if name.startswith("indirect") else "same on both sides"
            )
        columns.append(
            Component(
                title=title,
                ours=uri,
                reference=_tone_mapped(reference, exposure),
                caption=caption,
            )
        )
    return columns


def _depth(depth: Floats) -> tuple[str, str]:
    """Picture a depth: near white, far dark; no surface (infinite or 0) counts as farthest."""
    distance = luminance(depth)
    hit = np.isfinite(distance) & (distance > 0.0)
    if not hit.any():
        return sequential_uri(np.zeros_like(distance), low=0.0, high=1.0, colours="gray"), "empty"
    near, far = float(distance[hit].min()), float(distance[hit].max())
    shown = np.where(np.isnan(distance) | hit, distance, np.float32(far))
    uri = sequential_uri(shown, low=near, high=far, colours="gray_r")
    return uri, f"{near:.3g} (white) to {far:.3g} (black) world units"


def _tone_mapped(linear: Floats | None, exposure: float) -> str | None:
    return None if linear is None else tone_mapped_uri(linear, exposure=exposure)


def _payload(linear: Floats | None) -> str | None:
    small = linear is not None and linear.shape[0] * linear.shape[1] <= EXPOSURE_PIXEL_LIMIT
    return linear_payload(linear) if linear is not None and small else None


def _relative_scale(error: SignedMap | None, reference: Floats | None) -> float | None:
    if error is None or reference is None:
        return None
    light = luminance(reference)
    mean = float(light[np.isfinite(light)].mean(dtype=np.float64)) if light.size else 0.0
    return error.scale / mean if mean > 0.0 else None


def _faults(linear: dict[str, Floats]) -> list[str]:
    """Pictures that are absent, or hold values that are no radiance."""
    faults = [] if "image" in linear else ["No picture of the method was recorded."]
    for name, pixels in linear.items():
        if is_voxel_image(name):
            # Their own section says what is missing in them.
            continue
        # An infinite depth is a ray that meets nothing.
        bad = np.isnan(pixels) if name == "depth" else ~finite_pixels(pixels)
        count = int(bad.sum())
        if count:
            faults.append(
                f"{count} pixel(s) of {name} are not finite; they are magenta in the pictures."
            )
    return faults
