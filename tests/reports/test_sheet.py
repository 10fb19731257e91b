"""The contact sheet shows every record's pictures where its columns say."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from reports.record import load_image, read_record
from reports.sheet import COLUMNS, FOOTER, GAP, HEADER, write_sheet

WIDTH = 64
JPEG_CODES = 24
"""Largest mean difference of 8-bit codes that the sheet's JPEG and box filter may make."""


def test_a_sheet_has_a_row_for_each_record_and_a_column_for_each_picture(
    write: Callable[..., Path], tmp_path: Path
) -> None:
    paths = [write(record_id=f"r{n}", name=f"scene {n}", width=32, height=16) for n in range(3)]
    with Image.open(write_sheet(paths, tmp_path / "sheet.jpg", width=WIDTH)) as sheet:
        row = WIDTH // 2 + FOOTER
        assert sheet.size == (GAP + len(COLUMNS) * (WIDTH + GAP), HEADER + len(paths) * row)


def test_the_first_two_columns_are_the_two_methods(
    write: Callable[..., Path], tmp_path: Path
) -> None:
    path = write(record_id="r", width=WIDTH, height=WIDTH)
    record = read_record(path)
    with Image.open(write_sheet([path], tmp_path / "sheet.jpg", width=WIDTH)) as sheet:
        codes = np.asarray(sheet, dtype=np.float64)
    for column, name in enumerate(("image", "reference")):
        left = GAP + column * (WIDTH + GAP)
        shown = codes[HEADER : HEADER + WIDTH, left : left + WIDTH] / 255.0
        linear = np.clip(load_image(path, record, name) * 2.0**record.display.exposure, 0, 1)
        expected = np.where(
            linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055
        )
        assert np.abs(shown - expected).mean() * 255.0 < JPEG_CODES


def test_no_records_is_an_error_and_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no records"):
        write_sheet([], tmp_path / "sheet.jpg")
    assert not list(tmp_path.iterdir())


def test_a_missing_picture_is_an_error_and_leaves_no_file(
    write: Callable[..., Any], tmp_path: Path
) -> None:
    path = write(record_id="r", drop_images=("flip",), width=32, height=32)
    with pytest.raises(ValueError, match="flip"):
        write_sheet([path], tmp_path / "sheet.jpg")
    assert not (tmp_path / "sheet.jpg").exists()
