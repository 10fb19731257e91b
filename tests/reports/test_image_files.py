"""EXR files that others wrote: read as they are, or refused by name."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray

from reports.record import ImageFile, load_image, write_record
from reports.schema import Record
from tests.reports.conftest import record_with

HEIGHT, WIDTH = 4, 6

Channels = dict[str, NDArray[np.generic]]


def plane(dtype: type, seed: int = 1) -> NDArray[np.generic]:
    values = 4.0 * np.random.default_rng(seed).uniform(size=(HEIGHT, WIDTH))
    return values.astype(dtype)


def recorded(folder: Path, content: bytes) -> tuple[Path, Record]:
    """Record a file of these bytes as the only picture."""
    file = folder / "run" / "image.exr"
    file.parent.mkdir(exist_ok=True)
    file.write_bytes(content)
    entry = ImageFile(path="run/image.exr", sha256=hashlib.sha256(content).hexdigest())
    record = record_with({"image": entry}, width=WIDTH, height=HEIGHT)
    return write_record(record, folder), record


def exr(folder: Path, channels: Channels, **header: object) -> bytes:
    file = folder / "written.exr"
    base = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(base | header, dict(channels)).write(str(file))
    return file.read_bytes()


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.uint32])
@pytest.mark.parametrize("names", ["RGB", "Y"])
def test_numbers_of_any_width_are_read_exactly(tmp_path: Path, names: str, dtype: type) -> None:
    channels = {name: plane(dtype, seed) for seed, name in enumerate(names)}
    path, record = recorded(tmp_path, exr(tmp_path, channels))
    found = load_image(path, record, "image")
    assert found.dtype == np.float32
    expected = np.stack([channels[name] for name in names], axis=-1)
    np.testing.assert_array_equal(found.reshape(expected.shape), expected.astype(np.float32))


def test_sixteen_bit_infinity_is_kept(tmp_path: Path) -> None:
    # It is the reader's to refuse: a report shows where a picture is broken.
    values = plane(np.float16)
    values[0, 0], values[0, 1] = np.inf, np.nan
    path, record = recorded(tmp_path, exr(tmp_path, {"Y": values}))
    np.testing.assert_array_equal(load_image(path, record, "image"), values.astype(np.float32))


@pytest.mark.parametrize("names", ["RG", "RGBA", "YA", "B", "XYZ"])
def test_missing_and_further_channels_are_named(tmp_path: Path, names: str) -> None:
    path, record = recorded(tmp_path, exr(tmp_path, {name: plane(np.float32) for name in names}))
    with pytest.raises(ValueError, match=r"image\.exr: channels \[.*\] are neither R G B nor Y"):
        load_image(path, record, "image")


@pytest.mark.parametrize(
    "cut", [lambda whole: whole[:-20], lambda whole: whole[: len(whole) // 2], lambda _: b""]
)
def test_a_file_that_ends_early_is_refused(tmp_path: Path, cut: Callable[[bytes], bytes]) -> None:
    whole = exr(tmp_path, {name: plane(np.float32) for name in "RGB"})
    path, record = recorded(tmp_path, cut(whole))
    with pytest.raises(ValueError, match=r"image\.exr: not a readable EXR file"):
        load_image(path, record, "image")
