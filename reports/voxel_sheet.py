"""The voxels of a record, as rows of small pictures, one row a level."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from PIL import Image

from reports.pictures import Floats, finite_pixels, png_uri
from reports.schema import ImageFile
from reports.voxel_colours import QUANTITIES, VoxelPicture, voxel_codes

IMAGE_NAME = re.compile(r"voxels(\d+)_(opacity|albedo|normal|radiance|shade)")
"""Names of these pictures in a record: level and quantity."""

LARGEST_EDGE = 256
"""Pixels along the longer edge of a picture on the page; larger ones are thinned out."""


def image_name(level: int, quantity: str) -> str:
    """Return the name of a picture in a record."""
    name = f"voxels{level}_{quantity}"
    assert IMAGE_NAME.fullmatch(name), f"{name} is no picture of voxels"
    return name


def is_voxel_image(name: str) -> bool:
    """Whether a record's picture is one of these."""
    return IMAGE_NAME.fullmatch(name) is not None


@dataclass(frozen=True, kw_only=True)
class VoxelRow:
    """One level on a page."""

    title: str
    pictures: list[tuple[str, str]]
    """Quantity and PNG data URI."""
    note: str


def voxel_rows(
    linear: Mapping[str, Floats], images: Mapping[str, ImageFile], *, exposure: float
) -> list[VoxelRow]:
    """Return a row for each level that a record has pictures of, finest first.

    Parameters
    ----------
    linear
        All pictures of the record.
    images
        Their entries; that of the opacity says what the level is.
    exposure
        Stops, for radiance.
    """
    found = (IMAGE_NAME.fullmatch(name) for name in linear)
    levels = sorted({int(match.group(1)) for match in found if match and match.group(2) == "shade"})
    rows = []
    for level in levels:
        shade = linear[image_name(level, "shade")]
        pictures = []
        unsampled = 0
        for quantity in QUANTITIES:
            name = image_name(level, quantity)
            if name in linear:
                step = max(1, -(-max(shade.shape) // LARGEST_EDGE))
                picture = VoxelPicture(linear[name][::step, ::step], shade[::step, ::step])
                codes = voxel_codes(quantity, picture, exposure=exposure)
                pictures.append((quantity, png_uri(Image.fromarray(codes, mode="RGB"))))
                unsampled += int(np.count_nonzero(~finite_pixels(linear[name])))
        rows.append(
            VoxelRow(
                title=images[image_name(level, "shade")].description or f"level {level}",
                pictures=pictures,
                note=f"{unsampled} pixels without a sample of albedo are magenta."
                if unsampled
                else "",
            )
        )
    return rows
