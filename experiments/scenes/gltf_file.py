"""glTF 2.0 files as JSON and NumPy arrays: containers, buffers and accessors.

Read here and not by a general mesh library, because a scene must arrive exactly or not at all: the
ones looked at keep colours in eight bits, read sparse accessors as zeros, or leave normalized
integers as they are.
"""

from __future__ import annotations

import base64
import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt

from experiments.errors import InputError

_MAGIC: Final = b"glTF"
_JSON_CHUNK: Final = 0x4E4F534A
_BINARY_CHUNK: Final = 0x004E4942
_COMPONENTS: Final = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


@dataclass(frozen=True, kw_only=True)
class GltfFile:
    """A glTF asset in memory."""

    path: Path
    tree: dict[str, Any]
    """The JSON part."""
    buffers: tuple[bytes, ...]


def read_gltf(path: Path) -> GltfFile:
    """Read a `.gltf` or `.glb` file with all buffers that it names.

    Raises
    ------
    InputError
        When the container or the JSON is broken, a buffer is missing, or it is not glTF 2.
    """
    content = path.read_bytes()
    binary: bytes | None = None
    try:
        if content[:4] == _MAGIC:
            chunks = _chunks(content)
            tree = json.loads(chunks[_JSON_CHUNK])
            binary = chunks.get(_BINARY_CHUNK)
        else:
            tree = json.loads(content)
        version = str(tree["asset"]["version"])
    except (ValueError, KeyError, TypeError, struct.error) as error:
        raise broken(path, f"{type(error).__name__}: {error}") from error
    if not version.startswith("2."):
        raise InputError(
            what=f"this is glTF {version}", where=str(path), remedy="export it as glTF 2.0"
        )
    buffers = tuple(
        _buffer(path, entry, binary if index == 0 else None)
        for index, entry in enumerate(tree.get("buffers", []))
    )
    return GltfFile(path=path, tree=tree, buffers=buffers)


def broken(path: Path, reason: str) -> InputError:
    """Make the error for a file that says it is glTF and does not keep to the format."""
    return InputError(
        what=f"the glTF file is broken ({reason})",
        where=str(path),
        remedy="export it again, or check it with the Khronos glTF validator",
    )


def read_accessor(file: GltfFile, index: int) -> npt.NDArray[np.generic]:
    """Values of an accessor, [count, width]; normalized integers become floats.

    Raises
    ------
    ValueError, KeyError, IndexError
        When the accessor does not fit its buffer.

    References
    ----------
    glTF 2.0 specification, sections 3.6.2 (accessors) and 3.11 (normalized integers).
    """
    accessor = file.tree["accessors"][index]
    dtype = np.dtype(_COMPONENTS[accessor["componentType"]])
    count, width = int(accessor["count"]), _WIDTHS[accessor["type"]]
    if "bufferView" in accessor:
        start = int(accessor.get("byteOffset", 0))
        values = _view_values(file, accessor["bufferView"], start, dtype, (count, width))
    else:
        values = np.zeros((count, width), dtype)
    if "sparse" in accessor:
        values = values.copy()
        _apply_sparse(file, accessor["sparse"], values)
    if accessor.get("normalized", False):
        return np.maximum(values.astype(np.float32) / np.iinfo(dtype).max, -1.0)
    return values


def read_image(file: GltfFile, index: int) -> bytes:
    """Read the encoded bytes of an image, embedded or beside the file.

    Raises
    ------
    InputError
        When the image file is missing.
    """
    image = file.tree["images"][index]
    if "bufferView" in image:
        return _view_bytes(file, image["bufferView"])
    return _from_uri(file.path, image["uri"], "texture")


def _chunks(content: bytes) -> dict[int, bytes]:
    chunks: dict[int, bytes] = {}
    offset = 12
    while offset < len(content):
        length, kind = struct.unpack_from("<II", content, offset)
        chunk = content[offset + 8 : offset + 8 + length]
        if len(chunk) != length:
            raise ValueError("a chunk is cut short")
        chunks.setdefault(kind, chunk)
        offset += 8 + length
    return chunks


def _buffer(path: Path, entry: dict[str, Any], binary: bytes | None) -> bytes:
    if "uri" in entry:
        content = _from_uri(path, entry["uri"], "buffer")
    elif binary is not None:
        content = binary
    else:
        raise broken(path, "a buffer has no content")
    if len(content) < entry["byteLength"]:
        raise broken(path, "a buffer is cut short")
    return content


def _from_uri(path: Path, uri: str, kind: str) -> bytes:
    if uri.startswith("data:"):
        return base64.b64decode(uri.partition(",")[2])
    beside = path.parent / unquote(uri)
    if not beside.is_file():
        raise InputError(
            what=f'the {kind} file "{uri}" is missing',
            where=str(path),
            remedy="put the file there, or export the scene as one .glb file",
        )
    return beside.read_bytes()


def _view_bytes(file: GltfFile, index: int) -> bytes:
    view = file.tree["bufferViews"][index]
    start = int(view.get("byteOffset", 0))
    end = start + int(view["byteLength"])
    content = file.buffers[int(view["buffer"])][start:end]
    if len(content) != end - start:
        raise ValueError("a buffer view reaches past its buffer")
    return content


def _view_values(
    file: GltfFile, view: int, start: int, dtype: np.dtype[Any], shape: tuple[int, int]
) -> npt.NDArray[np.generic]:
    content = _view_bytes(file, view)
    stride = file.tree["bufferViews"][view].get("byteStride", dtype.itemsize * shape[1])
    return np.ndarray(shape, dtype, buffer=content, offset=start, strides=(stride, dtype.itemsize))


def _apply_sparse(file: GltfFile, sparse: dict[str, Any], values: npt.NDArray[np.generic]) -> None:
    count, places, replaced = int(sparse["count"]), sparse["indices"], sparse["values"]
    rows = _view_values(
        file,
        places["bufferView"],
        int(places.get("byteOffset", 0)),
        np.dtype(_COMPONENTS[places["componentType"]]),
        (count, 1),
    )
    values[rows[:, 0].astype(np.int64)] = _view_values(
        file,
        replaced["bufferView"],
        int(replaced.get("byteOffset", 0)),
        values.dtype,
        (count, values.shape[1]),
    )
