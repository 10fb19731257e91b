"""EXR pictures of a record: written once, checked by checksum when read."""

from __future__ import annotations

import hashlib
import os
import secrets
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from reports.schema import ImageFile, Record


def write_image(path: Path, array: NDArray[np.floating], description: str) -> ImageFile:
    """Write a float32 EXR and return its entry for `Record.images`.

    Parameters
    ----------
    path
        `<records>/<record_id>/NAME.exr`; the entry's path is its last two parts, which is
        relative to the folder of `<records>/<record_id>.json`. Missing folders are made.
    array
        Linear values, [y, x, 3] for channels R G B or [y, x] for channel Y.
    description
        What the picture shows, in a few words.

    Raises
    ------
    ValueError
        When the shape is another one, or the file is already there.
    """
    pixels = np.ascontiguousarray(array, dtype=np.float32)
    if pixels.size == 0 or not (pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] == 3)):
        raise ValueError(
            f"write_image: array for {path} has shape {pixels.shape}; give (height, width) or "
            "(height, width, 3), not empty"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = unused_name_beside(path)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channel = "Y" if pixels.ndim == 2 else "RGB"
    try:
        OpenEXR.File(header, {channel: pixels}).write(str(temporary))
        digest = hashlib.sha256(temporary.read_bytes()).hexdigest()
        publish_once(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    return ImageFile(path=f"{path.parent.name}/{path.name}", sha256=digest, description=description)


def load_image(record_path: Path, record: Record, name: str) -> NDArray[np.float32]:
    """Read a picture of a record after checking that it is the one that was recorded.

    Parameters
    ----------
    record_path
        The record's JSON file; pictures are found relative to its folder.
    record
        The record read from it.
    name
        Key of `record.images`.

    Returns
    -------
    numpy.ndarray
        float32, linear, [y, x, 3] (R G B) or [y, x] (Y). Not-finite values are kept.

    Raises
    ------
    ValueError
        When the record has no such picture, or the file is missing, altered, not an EXR file,
        has other channels, or is not `record.height` x `record.width`.
    """
    pixels = _read_pixels(checked_image_path(record_path, record, name), record.command)
    if pixels.shape[:2] != (record.height, record.width):
        raise ValueError(
            f"{record_path.parent / record.images[name].path}: {pixels.shape[1]}x{pixels.shape[0]} "
            f"pixels, but the record says {record.width}x{record.height}; make the record again: "
            f"{record.command}"
        )
    return pixels


def load_image_file(folder: Path, entry: ImageFile, command: str) -> NDArray[np.float32]:
    """Read a picture after checking that it is the one that was written.

    Parameters
    ----------
    folder
        Which the entry's path is relative to.
    entry
        As `write_image` returned it.
    command
        What makes it again, for the messages of errors.

    Returns
    -------
    numpy.ndarray
        As `load_image`.

    Raises
    ------
    ValueError
        The file is missing, altered, not an EXR file, or has other channels.
    """
    file = folder / entry.path
    _check_file(file, entry, f"image {file.stem!r}", command=command)
    return _read_pixels(file, command)


def _read_pixels(file: Path, command: str) -> NDArray[np.float32]:
    try:
        channels = OpenEXR.File(str(file), separate_channels=True).channels()
    except (RuntimeError, ValueError) as error:
        # A file that ends early has no parts, which is a ValueError that names no file.
        raise ValueError(
            f"{file}: not a readable EXR file ({error}); make the record again: {command}"
        ) from error
    if set(channels) == {"R", "G", "B"}:
        pixels = np.stack([channels[key].pixels for key in "RGB"], axis=-1)
    elif set(channels) == {"Y"}:
        pixels = channels["Y"].pixels
    else:
        raise ValueError(
            f"{file}: channels {sorted(channels)} are neither R G B nor Y; write pictures with "
            "write_image"
        )
    return np.asarray(pixels, dtype=np.float32)


def checked_image_path(record_path: Path, record: Record, name: str) -> Path:
    """Path of a record's picture, once its file is there and its checksum is right.

    Raises
    ------
    ValueError
        When the record has no such picture, or the file is missing or altered.
    """
    entry = record.images.get(name)
    if entry is None:
        raise ValueError(
            f"{record_path}: no image {name!r}; this record has {', '.join(sorted(record.images))}"
        )
    file = record_path.parent / entry.path
    owner = f" of {record_path.name}"
    _check_file(file, entry, f"image {name!r}", owner=owner, command=record.command)
    return file


def _check_file(file: Path, entry: ImageFile, what: str, *, command: str, owner: str = "") -> None:
    if not file.is_file():
        raise ValueError(
            f"{file}: {what}{owner} is missing; keep records and their folders together, or make "
            f"the record again: {command}"
        )
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    if digest != entry.sha256:
        raise ValueError(
            f"{file}: {what} was altered after it was recorded (sha256 {digest[:12]}..., recorded "
            f"{entry.sha256[:12]}...); make the record again: {command}"
        )


def unused_name_beside(path: Path) -> Path:
    """Name a half-written file: same folder (same file system), hidden, same suffix."""
    return path.with_name(f".{path.stem}.{os.getpid()}.{secrets.token_hex(4)}.part{path.suffix}")


def publish_once(temporary: Path, path: Path) -> None:
    """Give a finished file its name, in one step, unless the name is taken.

    A hard link, not `os.replace`: it fails when the name exists, so that two writers cannot
    replace each other's file. The caller removes the temporary name.

    Raises
    ------
    ValueError
        When `path` exists.
    """
    try:
        os.link(temporary, path)
    except FileExistsError as error:
        raise ValueError(
            f"{path}: exists already and records are append-only; choose another record_id"
        ) from error
