from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from pydantic import ValidationError

from reports.record import (
    SCHEMA_VERSION,
    ImageFile,
    Interval,
    MetricValue,
    Record,
    StageTime,
    load_image,
    read_record,
    read_records,
    write_image,
    write_record,
)

MakeRecord = Callable[..., Record]
Write = Callable[..., Path]


def test_a_record_equals_what_is_read_back(write: Write, records_folder: Path) -> None:
    path = write(config={"aperture": 0.6, "nested": {"list": (1, 2.5, None, "x", True)}})
    record = read_record(path)
    assert path == records_folder / "cornell-high-0001.json"
    assert (
        write_record(record, records_folder / "copy-without-images") if not record.images else True
    )
    assert read_record(path) == record
    assert record.config == {"aperture": 0.6, "nested": {"list": [1, 2.5, None, "x", True]}}
    assert record.schema_version == SCHEMA_VERSION


def test_writing_twice_gives_the_same_bytes(make_record: MakeRecord, tmp_path: Path) -> None:
    record = make_record({})
    first, second = (write_record(record, tmp_path / name) for name in ("a", "b"))
    assert first.read_bytes() == second.read_bytes()


def test_writing_leaves_only_the_record(make_record: MakeRecord, tmp_path: Path) -> None:
    path = write_record(make_record({}), tmp_path)
    assert list(tmp_path.iterdir()) == [path]


def test_a_record_is_never_replaced(make_record: MakeRecord, tmp_path: Path) -> None:
    path = write_record(make_record({}), tmp_path)
    before = path.read_bytes()
    with pytest.raises(ValueError, match="exists already and records are append-only; choose"):
        write_record(make_record({}, seed=2), tmp_path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_records_are_read_in_the_order_of_their_names(
    make_record: MakeRecord, tmp_path: Path
) -> None:
    for name in ("b", "a", "c"):
        write_record(make_record({}, record_id=name), tmp_path)
    records = read_records(tmp_path)
    assert [path.name for path in records] == ["a.json", "b.json", "c.json"]
    assert [record.record_id for record in records.values()] == ["a", "b", "c"]


def test_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no such folder of records; make one"):
        read_records(tmp_path / "nothing")


def test_a_missing_record_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"nothing\.json: cannot read the record \(No such file"):
        read_record(tmp_path / "nothing.json")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\xff\xfe", "not UTF-8 text at byte 0"),
        (b'{"a": 1,\n "b"', "not JSON at line 2, column 5"),
        (b"[1, 2]", "its JSON is no object"),
        (b"{}", "schema version None, but this program reads 1; make the record again"),
        (b'{"schema_version": 2}', "schema version 2, but this program reads 1"),
        (b'{"schema_version": 1}', r"broken record at record_id: Field required \(\d+ fault"),
    ],
)
def test_a_broken_record_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "broken.json"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=f"{re.escape(str(path))}: .*{message}"):
        read_record(path)


def test_a_wrong_field_is_named(make_record: MakeRecord, tmp_path: Path) -> None:
    path = write_record(make_record({}), tmp_path)
    content = json.loads(path.read_text(encoding="utf-8"))
    content["machine"]["core_count"] = "many"
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ValueError, match=r"broken record at machine\.core_count: .*make it again"):
        read_record(path)


def test_not_a_number_in_a_file_is_refused(make_record: MakeRecord, tmp_path: Path) -> None:
    path = write_record(make_record({}), tmp_path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('"memory_gib": 7.7', '"memory_gib": NaN'), encoding="utf-8")
    with pytest.raises(ValueError, match=r"broken record at machine\.memory_gib"):
        read_record(path)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_numbers_must_be_finite(make_record: MakeRecord, value: float) -> None:
    with pytest.raises(ValidationError, match="finite"):
        Interval(low=value, high=1.0)
    with pytest.raises(ValidationError, match=r"config\.cones\[1\]\.aperture is .*finite"):
        make_record({}, config={"cones": [{}, {"aperture": value}]})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"record_id": "../up"}, "must name a file"),
        ({"record_id": ".hidden"}, "must name a file"),
        ({"created": "2026-01-31T12:00:00"}, "must be an ISO 8601 time in UTC"),
        ({"created": "2026-01-31T12:00:00+01:00"}, "must be an ISO 8601 time in UTC"),
        ({"created": "yesterday"}, "Invalid isoformat"),
        ({"width": 0}, "greater than or equal to 1"),
        ({"colour": "red"}, "Extra inputs are not permitted"),
        ({"schema_version": 2}, "Input should be 1"),
    ],
)
def test_a_wrong_value_is_refused(
    make_record: MakeRecord, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValidationError, match=message):
        make_record({}, **changes)


@pytest.mark.parametrize("path", ["/etc/x.exr", "../x.exr", "a/../../x.exr", "a\\x.exr", ""])
def test_an_image_stays_in_its_folder(path: str) -> None:
    with pytest.raises(ValidationError, match="must be relative to the record's folder"):
        ImageFile(path=path, sha256="0" * 64)


def test_a_checksum_has_its_form() -> None:
    with pytest.raises(ValidationError, match="64 lower-case hexadecimal digits"):
        ImageFile(path="a/x.exr", sha256="ABC")


def test_an_interval_is_ordered() -> None:
    with pytest.raises(ValidationError, match=r"low 2\.0 must not exceed high 1\.0"):
        Interval(low=2.0, high=1.0)


def test_the_spread_of_a_time_holds_its_median() -> None:
    with pytest.raises(ValidationError, match=r"stage 'trace': low_ms 3\.0 <= median"):
        StageTime(stage="trace", median_ms=2.0, low_ms=3.0, high_ms=4.0, count=5)


def test_a_record_is_frozen(make_record: MakeRecord) -> None:
    with pytest.raises(ValidationError, match="frozen"):
        make_record({}).seed = 3


def test_numpy_numbers_are_taken() -> None:
    metric = MetricValue(
        name="mse",
        component="image",
        value=np.float32(0.5),  # type: ignore[arg-type]
        interval=None,
        formula="mean",
        ideal=0.0,
    )
    assert type(metric.value) is float


@pytest.mark.parametrize("shape", [(4, 6, 3), (4, 6)])
def test_an_image_is_read_back_bit_for_bit(
    make_record: MakeRecord, tmp_path: Path, shape: tuple[int, ...]
) -> None:
    pixels = np.random.default_rng(1).normal(size=shape).astype(np.float32)
    pixels.flat[0], pixels.flat[1] = np.inf, np.nan
    entry = write_image(tmp_path / "run" / "image.exr", pixels, "a picture")
    assert (entry.path, entry.description) == ("run/image.exr", "a picture")
    record = make_record({"image": entry}, record_id="run", width=6, height=4)
    path = write_record(record, tmp_path)
    read = load_image(path, read_record(path), "image")
    assert read.dtype == np.float32
    np.testing.assert_array_equal(read, pixels)
    assert {file.name for file in (tmp_path / "run").iterdir()} == {"image.exr"}


@pytest.mark.parametrize("shape", [(4, 6, 4), (4,), (0, 6), (1, 2, 3, 3)])
def test_an_image_of_another_shape_is_refused(tmp_path: Path, shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"write_image: array for .* has shape .*; give \(height"):
        write_image(tmp_path / "run" / "image.exr", np.zeros(shape), "")
    assert not (tmp_path / "run").exists()


def test_an_image_is_never_replaced(tmp_path: Path) -> None:
    path = tmp_path / "run" / "image.exr"
    write_image(path, np.zeros((2, 2)), "")
    before = path.read_bytes()
    with pytest.raises(ValueError, match="exists already and records are append-only"):
        write_image(path, np.ones((2, 2)), "")
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_a_picture_that_a_record_lacks_is_named(write: Write) -> None:
    path = write()
    with pytest.raises(ValueError, match="no image 'sky'; this record has albedo, depth"):
        load_image(path, read_record(path), "sky")


def test_a_missing_image_is_refused(write: Write, records_folder: Path) -> None:
    path = write()
    record = read_record(path)
    (records_folder / record.images["flip"].path).unlink()
    with pytest.raises(ValueError, match=r"flip\.exr: image 'flip' of .* is missing; keep records"):
        load_image(path, record, "flip")


def test_an_altered_image_is_refused(write: Write, records_folder: Path) -> None:
    path = write()
    record = read_record(path)
    file = records_folder / record.images["flip"].path
    octets = bytearray(file.read_bytes())
    octets[-1] ^= 1
    file.write_bytes(octets)
    with pytest.raises(
        ValueError, match=r"flip\.exr: .* was altered after .*make the record again"
    ):
        load_image(path, record, "flip")


def test_a_record_of_an_absent_image_is_not_written(
    make_record: MakeRecord, tmp_path: Path
) -> None:
    record = make_record({"image": ImageFile(path="run/image.exr", sha256="0" * 64)})
    with pytest.raises(ValueError, match=r"image 'image' .* is missing"):
        write_record(record, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_an_image_of_another_size_is_refused(make_record: MakeRecord, tmp_path: Path) -> None:
    entry = write_image(tmp_path / "run" / "image.exr", np.zeros((4, 6)), "")
    record = make_record({"image": entry}, width=7, height=4)
    path = write_record(record, tmp_path)
    with pytest.raises(ValueError, match="6x4 pixels, but the record says 7x4"):
        load_image(path, record, "image")


def _entry_of(file: Path) -> ImageFile:
    import hashlib

    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    return ImageFile(path=f"{file.parent.name}/{file.name}", sha256=digest)


def test_an_image_that_is_no_exr_is_refused(make_record: MakeRecord, tmp_path: Path) -> None:
    file = tmp_path / "run" / "image.exr"
    file.parent.mkdir()
    file.write_bytes(b"not an image")
    record = make_record({"image": _entry_of(file)})
    with pytest.raises(ValueError, match="not a readable EXR file"):
        load_image(write_record(record, tmp_path), record, "image")


def test_an_image_of_other_channels_is_refused(make_record: MakeRecord, tmp_path: Path) -> None:
    file = tmp_path / "run" / "image.exr"
    file.parent.mkdir()
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"Z": np.zeros((4, 6), np.float32)}).write(str(file))
    record = make_record({"image": _entry_of(file)}, width=6, height=4)
    with pytest.raises(ValueError, match=r"channels \['Z'\] are neither R G B nor Y"):
        load_image(write_record(record, tmp_path), record, "image")
