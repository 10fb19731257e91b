"""Records -> one JPEG: for each scene cones, reference, signed error and FLIP side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from reports.pictures import Bytes, Floats, luminance, srgb_from_linear
from reports.record import Record, load_image, read_record

COLUMNS = ("voxel cone tracing", "path tracing", "signed error", "HDR-FLIP")
GAP, HEADER, FOOTER = 6, 26, 22
"""Pixels between pictures, above the columns and below each row."""

JPEG_QUALITY = 88
"""The sheet is to be looked at, not measured; what is measured are the EXR files of the records."""

ERROR_SHARE = 0.25
"""The error colours end at this share of the reference's mean luminance."""


def write_sheet(record_paths: Sequence[Path], output: Path, *, width: int = 240) -> Path:
    """Write a contact sheet of records.

    Parameters
    ----------
    record_paths
        Records with the images `image`, `reference`, `error` and `flip`.
    output
        JPEG file; it appears only when it is whole.
    width
        Width of each picture, pixels.

    Raises
    ------
    ValueError
        No records, or a picture is missing or altered.
    """
    if not record_paths:
        raise ValueError("write_sheet: no records; make some with `vctgi report`")
    rows = [_row(path, width) for path in record_paths]
    sheet_width = max(row.width for row in rows)
    sheet = Image.new("RGB", (sheet_width, HEADER + sum(row.height for row in rows)), "white")
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(size=13)
    for column, name in enumerate(COLUMNS):
        draw.text((GAP + column * (width + GAP), 6), name, fill="black", font=font)
    top = HEADER
    for row in rows:
        sheet.paste(row, (0, top))
        top += row.height
    output.parent.mkdir(parents=True, exist_ok=True)
    partial = output.with_name(f".{output.name}.partial")
    sheet.save(partial, format="JPEG", quality=JPEG_QUALITY, optimize=True)
    partial.replace(output)
    return output


def _row(path: Path, width: int) -> Image.Image:
    """Return the pictures of one record with a line of text below."""
    record = read_record(path)
    pictures = [
        _resized(codes, width)
        for codes in (
            _shown(path, record, "image"),
            _shown(path, record, "reference"),
            _signed(path, record),
            _mapped(load_image(path, record, "flip"), "magma"),
        )
    ]
    height = pictures[0].height
    row = Image.new("RGB", (GAP + len(pictures) * (width + GAP), height + FOOTER), "white")
    for column, picture in enumerate(pictures):
        row.paste(picture, (GAP + column * (width + GAP), 0))
    font = ImageFont.load_default(size=12)
    ImageDraw.Draw(row).text((GAP, height + 3), _caption(record), fill="black", font=font)
    return row


def _caption(record: Record) -> str:
    """Title and headline numbers of a record."""
    values = {(m.component, m.name): m.value for m in record.metrics}
    parts = [f"{record.scene.title} ({record.preset})"]
    for label, key in (
        ("indirect energy", ("indirect", "energy_ratio")),
        ("relMSE", ("indirect", "relmse_e2")),
        ("picture FLIP", ("image", "flip")),
    ):
        if key in values:
            parts.append(f"{label} {values[key]:.3g}")
    return "   ".join(parts)


def _shown(path: Path, record: Record, name: str) -> Bytes:
    return srgb_from_linear(load_image(path, record, name), exposure=record.display.exposure)


def _signed(path: Path, record: Record) -> Bytes:
    """Luminance error, red too bright, blue too dark."""
    error = luminance(load_image(path, record, "error"))
    mean = float(luminance(load_image(path, record, "reference")).mean())
    scale = ERROR_SHARE * mean if mean > 0.0 else 1.0
    return _mapped(np.asarray(0.5 + 0.5 * error / scale, np.float32), "RdBu_r")


def _mapped(position: Floats, colours: str) -> Bytes:
    table = mpl.colormaps[colours](np.clip(luminance(position), 0.0, 1.0))
    codes: Bytes = np.round(255.0 * table[..., :3]).astype(np.uint8)
    return codes


def _resized(codes: Bytes, width: int) -> Image.Image:
    picture = Image.fromarray(codes, mode="RGB")
    height = round(picture.height * width / picture.width)
    return picture.resize((width, height), Image.Resampling.BOX)
