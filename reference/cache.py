"""References on disk: one checksummed file per batch, written whole or not at all.

Layout: `<cache directory>/<key>/batch_0000.npz ...` and `<key>/lock`. A batch holds its arrays,
what was noted about the scene, the seconds it took and a SHA-256 over all of that. A file is
written under another name and renamed when it is complete, so a reader never sees half of one; an
exclusive lock on the key's folder lets a second process wait for the first one's batches.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import logging
import os
import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

LOGGER = logging.getLogger(__name__)

CACHE_VARIABLE: Final = "VCTGI_CACHE"
"""Environment variable that overrides where references are kept."""
_COMPONENT_PREFIX: Final = "component."


@dataclass(kw_only=True)
class Batch:
    """One batch of a reference, as rendered or as read."""

    components: dict[str, np.ndarray]
    """By component: float32 `[y, x, rgb]`, W m^-2 sr^-1."""
    notes: list[str]
    seconds: float
    """Wall time of its rendering."""


def default_cache_directory() -> Path:
    """Where references go unless the caller says otherwise.

    `$VCTGI_CACHE` if set, else `vctgi/references` in `$XDG_CACHE_HOME`, else in `~/.cache`.
    """
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "vctgi" / "references"


@contextlib.contextmanager
def locked_entry(cache_directory: Path, key: str) -> Iterator[Path]:
    """Hold the folder of a key, made if missing, against every other process meanwhile.

    The operating system drops the lock of a process that dies.
    """
    entry = cache_directory / key
    entry.mkdir(parents=True, exist_ok=True)
    with (entry / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            LOGGER.info("reference %s is being rendered by another process: waiting", key[:12])
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield entry


def batch_path(entry: Path, index: int) -> Path:
    """File of one batch in a key's folder."""
    return entry / f"batch_{index:04d}.npz"


def write_batch(entry: Path, index: int, batch: Batch) -> None:
    """Store a batch; on return the file is complete under its final name."""
    arrays = {_COMPONENT_PREFIX + name: array for name, array in batch.components.items()}
    arrays["notes"] = np.array(json.dumps(batch.notes))
    arrays["seconds"] = np.array(batch.seconds, dtype=np.float64)
    arrays["checksum"] = np.array(_checksum(arrays))
    descriptor, name = tempfile.mkstemp(prefix=".batch_", suffix=".tmp", dir=entry)
    temporary = Path(name)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            np.savez(stream, allow_pickle=False, **arrays)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(batch_path(entry, index))
    finally:
        temporary.unlink(missing_ok=True)


def read_batch(entry: Path, index: int, shapes: dict[str, tuple[int, ...]]) -> Batch | None:
    """Read a batch back; None if there is none or if the file is damaged, which is logged.

    Parameters
    ----------
    entry
        Folder of the key.
    index
        Which batch.
    shapes
        Components that the batch must hold, with their shapes.
    """
    path = batch_path(entry, index)
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except FileNotFoundError:
        return None
    except (OSError, EOFError, ValueError, zipfile.BadZipFile) as error:
        LOGGER.warning("damaged reference file %s (%s): rendering it again", path, error)
        return None
    found = str(arrays.pop("checksum", ""))
    held = {_COMPONENT_PREFIX + name: shape for name, shape in shapes.items()}
    if found != _checksum(arrays) or held != {
        name: array.shape for name, array in arrays.items() if name in held
    }:
        LOGGER.warning("damaged reference file %s (wrong checksum): rendering it again", path)
        return None
    return Batch(
        components={name: arrays[_COMPONENT_PREFIX + name] for name in shapes},
        notes=json.loads(str(arrays["notes"])),
        seconds=float(arrays["seconds"]),
    )


def _checksum(arrays: dict[str, np.ndarray]) -> str:
    """SHA-256 over names, types, shapes and bytes, in the order of the names."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"\n{name} {array.dtype.str} {arrays[name].shape}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
