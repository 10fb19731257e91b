"""Records of one scene side by side: which belong together, and what a page shows of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup

from reports.headline import (
    HEADLINES,
    PEER_PREFIX,
    Headline,
    find_metric,
    frame_seconds,
    is_peer,
    samples_per_pixel,
)
from reports.method_plot import method_svg
from reports.pictures import (
    Floats,
    SignedMap,
    error_scale,
    jpeg_uri,
    luminance,
    reduced,
    signed_map,
)
from reports.record import load_image
from reports.schema import MetricValue, Record
from reports.sections import Detail

SHOWN = tuple(
    each
    for each in HEADLINES
    if (each.key, each.component)
    in {("energyratio", "indirect"), ("relmse", "indirect"), ("flip", "image")}
)
"""Metrics of each method."""

PICTURE_WIDTH = 192
"""Most pixels that a picture is wide."""

WHITE_QUANTILE, WHITE = 0.95, 0.8
"""The exposure is the one, in half stops, that takes this quantile of the reference's luminance
closest below this value."""


@dataclass(frozen=True, kw_only=True)
class Method:
    """One record among those of its scene."""

    key: str
    """Section of the record on the page."""
    record: Record
    title: str
    is_peer: bool
    picture: str | None
    error: SignedMap | None
    metrics: list[tuple[Headline, MetricValue | None]]
    samples: float | None
    """Of the voxels, a pixel."""
    seconds: float | None
    """Of a frame."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """All records of a scene that have one reference."""

    key: str
    title: str
    record: Record
    """One of them, for what they have in common."""
    methods: list[Method]
    reference: str | None
    exposure: float
    """Stops, of all pictures."""
    scale: float
    """Error at the end of the colours of all error maps."""
    relative_scale: float | None
    """The same over the reference's mean."""
    block: int
    """Edge of the block of pixels that is one pixel of a picture."""
    chart: Markup | None
    backends: list[str]


def grouped(records: Sequence[tuple[Path, Record]]) -> list[list[tuple[Path, Record]]]:
    """Group records that hold the same scene, size and reference, in the order of their firsts."""
    groups: dict[tuple[object, ...], list[tuple[Path, Record]]] = {}
    for path, record in records:
        reference = None if record.reference is None else record.reference.key
        scene = record.scene
        key = (scene.name, scene.digest, record.width, record.height, reference)
        groups.setdefault(key, []).append((path, record))
    return list(groups.values())


def compare(key: str, group: Sequence[tuple[Path, Record]], keys: Mapping[Path, str]) -> Comparison:
    """Put the records of a group side by side.

    Parameters
    ----------
    key
        Letters and digits, unique on the page.
    group
        At least two records of a scene.
    keys
        Section of each record's file on the page.

    Raises
    ------
    ValueError
        When a picture is missing on disk, altered, or not readable.
    """
    ours = [_picture(path, record, "indirect") for path, record in group]
    truths = [_picture(path, record, "reference_indirect") for path, record in group]
    errors = [_picture(path, record, "error") for path, record in group]
    truth = next((each for each in truths if each is not None), None)
    first = group[0][1]
    brightest = truth if truth is not None else next((o for o in ours if o is not None), None)
    exposure = first.display.exposure if brightest is None else _exposure(brightest)
    known = [each for each in errors if each is not None]
    scale = error_scale(known) if known else 1.0
    records = [record for _, record in group]
    chart = method_svg(records, key=f"{key}-chart")
    return Comparison(
        key=key,
        title=first.scene.title or first.scene.name,
        record=first,
        methods=[
            Method(
                key=keys[path],
                record=record,
                title=record.preset.removeprefix(PEER_PREFIX),
                is_peer=is_peer(record),
                picture=_shown(picture, exposure),
                error=None if error is None else signed_map(reduced(error, PICTURE_WIDTH), scale),
                metrics=[(headline, find_metric(record, headline)) for headline in SHOWN],
                samples=samples_per_pixel(record),
                seconds=frame_seconds(record),
            )
            for (path, record), picture, error in zip(group, ours, errors, strict=True)
        ],
        reference=_shown(truth, exposure),
        exposure=exposure,
        scale=scale,
        relative_scale=_relative(scale, truth),
        block=math.ceil(first.width / PICTURE_WIDTH),
        chart=None if chart is None else Markup(chart),
        backends=sorted({record.machine.backend for record in records}),
    )


def is_listed(record: Record, group: Sequence[tuple[Path, Record]]) -> bool:
    """Whether a record is in the tables of all scenes: a peer only where nothing is ours."""
    return not is_peer(record) or all(is_peer(other) for _, other in group)


def detail_among(record: Record, group: Sequence[tuple[Path, Record]]) -> Detail:
    """Return which pictures a page shows of a record: the dearest of ours stands for its scene."""
    if len(group) == 1:
        return "all"
    if is_peer(record):
        return "none"
    dearest = [other for _, other in group if not is_peer(other)][-1]
    return "most" if record is dearest else "viewer"


def _picture(path: Path, record: Record, name: str) -> Floats | None:
    return load_image(path, record, name) if name in record.images else None


def _shown(linear: Floats | None, exposure: float) -> str | None:
    return None if linear is None else jpeg_uri(reduced(linear, PICTURE_WIDTH), exposure=exposure)


def _exposure(linear: Floats) -> float:
    """Return the stops that make a picture neither dark nor white."""
    light = luminance(linear)
    lit = light[np.isfinite(light) & (light > 0.0)]
    if not lit.size:
        return 0.0
    return math.floor(2.0 * math.log2(WHITE / float(np.quantile(lit, WHITE_QUANTILE)))) / 2.0


def _relative(scale: float, truth: Floats | None) -> float | None:
    if truth is None:
        return None
    light = luminance(truth)
    mean = float(light[np.isfinite(light)].mean(dtype=np.float64)) if light.size else 0.0
    return scale / mean if mean > 0.0 else None
