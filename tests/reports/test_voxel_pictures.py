"""Voxels on pages: colours by quantity, rows by level, atlases that hold every layer once."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from reports.accuracy import accuracy_report
from reports.pictures import NOT_FINITE
from reports.record import ImageFile, Record, write_image, write_record
from reports.voxel_colours import MISS, VoxelPicture, difference_codes, voxel_codes
from reports.voxel_page import PageGroup, PagePicture, SliceBlock, atlas, voxel_page
from reports.voxel_sheet import image_name, is_voxel_image

SHADE = np.array([[1.0, 0.5, 0.0]], np.float32)


def test_colours_follow_the_quantity_the_shade_and_the_holes() -> None:
    normal = np.array([[[1.0, 0.0, -1.0]] * 3], np.float32)
    codes = voxel_codes("normal", VoxelPicture(normal, SHADE), exposure=0.0)
    assert codes[0].tolist() == [[255, 128, 0], [128, 64, 0], list(MISS)]
    opacity = np.array([[1.0, 0.2, 0.0]], np.float32)
    codes = voxel_codes("opacity", VoxelPicture(opacity, np.ones((1, 3), np.float32)), exposure=0.0)
    assert codes[0].tolist() == [[255] * 3, [51] * 3, [0] * 3]


def test_exposure_is_for_radiance_only_and_missing_samples_are_magenta() -> None:
    values = np.array([[[0.25] * 3, [np.nan] * 3]], np.float32)
    picture = VoxelPicture(values, np.ones((1, 2), np.float32))
    radiance, albedo = (
        voxel_codes(quantity, picture, exposure=2.0) for quantity in ("radiance", "albedo")
    )
    assert radiance[0, 0].tolist() == [255] * 3
    assert albedo[0, 0].tolist() == [137] * 3, "0.25 by the sRGB curve"
    assert albedo[0, 1].tolist() == radiance[0, 1].tolist() == list(NOT_FINITE)


def test_a_quantity_that_is_none_is_refused() -> None:
    picture = VoxelPicture(np.zeros((1, 1), np.float32), np.ones((1, 1), np.float32))
    with pytest.raises(ValueError, match="no quantity 'mass'; use opacity, albedo"):
        voxel_codes("mass", picture, exposure=0.0)


def test_differences_are_red_above_blue_below_and_white_at_none() -> None:
    is_hit = np.array([[True, True, True, False]])
    codes = difference_codes(np.array([[0.5, -0.5, 0.0, 0.0]]), is_hit, scale=0.5)[0]
    red, blue, white, miss = codes.astype(int)
    assert red[0] > red[2] + 50
    assert blue[2] > blue[0] + 50
    assert white.min() > 240
    assert miss.tolist() == list(MISS)


def test_an_atlas_holds_each_layer_where_the_viewer_looks_for_it() -> None:
    block = np.random.default_rng(1).integers(0, 256, (5, 5, 5, 3)).astype(np.uint8)
    sheet = atlas(block, 3)
    assert sheet.shape == (10, 15, 3)
    for z in range(5):
        row, column = divmod(z, 3)
        found = sheet[5 * row : 5 * row + 5, 5 * column : 5 * column + 5]
        np.testing.assert_array_equal(found, block[z])


def test_the_page_of_a_frame_loads_nothing_and_escapes_names() -> None:
    block = np.zeros((2, 2, 2, 3), np.uint8)
    page = voxel_page(
        "Voxels of <b>",
        ["a note"],
        [
            PageGroup(
                title="level <0>",
                pictures=[PagePicture(name="a.png", title="opacity", caption="c", codes=block[0])],
            )
        ],
        [["what", "mean"], ["level 1", "+0.5"]],
        [
            SliceBlock(
                title="level 0",
                edge=2,
                layer_size=0.5,
                lowest=(-1.0, 0.0, 2.5),
                opacity=block,
                radiance=block,
            )
        ],
    )
    assert "<b>" not in page.split("<style>")[0]
    assert "level &lt;0&gt;" in page
    assert 'data-lowest="[-1.0, 0.0, 2.5]"' in page
    sources = re.findall(r'src="([^"]*)"', page)
    assert len(sources) == 3
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert "http://" not in page
    assert "https://" not in page
    picture = Image.open(io.BytesIO(base64.b64decode(sources[1].split(",")[1])))
    assert picture.size == (4, 2)


@pytest.fixture
def record_with_voxels(
    records_folder: Path, make_record: Callable[..., Record]
) -> Callable[..., Path]:
    """Write a record with pictures of voxels, of `width` x 4 pixels."""

    def write(width: int = 6, unsampled: int = 0) -> Path:
        images: dict[str, ImageFile] = {}
        for level in (0, 1):
            colours = np.full((4, width, 3), 0.5, np.float32)
            albedo = colours.copy()
            albedo[0, :unsampled] = np.nan
            for quantity, values in {
                "opacity": colours[..., 0],
                "albedo": albedo,
                "normal": colours,
                "radiance": colours,
                "shade": colours[..., 0],
            }.items():
                name = image_name(level, quantity)
                file = records_folder / "voxels" / f"{name}.exr"
                images[name] = write_image(file, values, f"level {level}: voxels of <0.5>")
        record = make_record(images, record_id="voxels", width=width, height=4)
        return write_record(record, records_folder)

    return write


def test_a_report_has_a_closed_section_with_a_row_for_each_level(
    record_with_voxels: Callable[..., Path],
) -> None:
    page = accuracy_report([record_with_voxels(unsampled=3)])
    section = page.split('<details class="voxels">')[1].split("</details>")[0]
    assert "2 levels" in section
    for level in (0, 1):
        assert f"<h4>level {level}: voxels of &lt;0.5&gt;</h4>" in section
    assert section.count("data:image/png") == 8
    assert section.count("3 pixels without a sample of albedo are magenta") == 2
    assert "not finite" not in page, "its own section says it"


def test_large_pictures_are_thinned_out(record_with_voxels: Callable[..., Path]) -> None:
    page = accuracy_report([record_with_voxels(width=600)])
    section = page.split('<details class="voxels">')[1]
    source = re.findall(r'src="data:image/png;base64,([^"]*)"', section)[0]
    assert Image.open(io.BytesIO(base64.b64decode(source))).size == (200, 2)


def test_a_record_without_voxels_has_no_such_section(write: Callable[..., Path]) -> None:
    assert '<details class="voxels">' not in accuracy_report([write()])


def test_names_of_pictures_of_voxels() -> None:
    assert is_voxel_image(image_name(3, "shade"))
    assert not is_voxel_image("albedo")
    with pytest.raises(AssertionError, match="no picture of voxels"):
        image_name(0, "mass")
