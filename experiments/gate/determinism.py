"""The kind `exact` of two renders: the same command must give the same pictures, bit for bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from experiments.errors import MachineryError
from experiments.gate.finding import Finding
from reports.record import Record, load_image

RENDERED_TWICE = "rendered twice"
"""What the verdict on determinism is about."""

Files = tuple[Record, Path]
"""A record and its file."""


def check_rendered_twice(first: Files, second: Files) -> Finding:
    """Count the values that differ between all pictures of two records.

    Returns
    -------
    Finding
        Failed when a value differs, be it by rounding; two NaN at one place are the same.

    Raises
    ------
    MachineryError
        A picture is missing or was altered.
    """
    return compare_pictures(pictures_of(*first), pictures_of(*second))


def pictures_of(record: Record, path: Path) -> dict[str, np.ndarray]:
    """Read all pictures of a record.

    Raises
    ------
    MachineryError
        One is missing or was altered.
    """
    found = {}
    for name in sorted(record.images):
        try:
            found[name] = load_image(path, record, name)
        except ValueError as error:
            raise MachineryError(str(error), f"image {name}", "render it again") from error
    return found


def compare_pictures(first: dict[str, np.ndarray], second: dict[str, np.ndarray]) -> Finding:
    """Compare pictures by name; see `check_rendered_twice`."""
    faults = [f"{name}: only in one" for name in sorted(first.keys() ^ second.keys())]
    count = len(faults)
    for name in sorted(first.keys() & second.keys()):
        differing = _differing(first[name], second[name])
        count += differing
        if differing:
            faults.append(f"{name}: {differing} values")
    return Finding(
        kind="exact",
        passed=not faults,
        value=float(count),
        limit="0 values that differ between two renders",
        message=f"not the same twice: {'; '.join(faults)}; find what is not deterministic"
        if faults
        else f"{len(first)} pictures are the same twice",
    )


def plant_rounding(pictures: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Move one value of the first picture to its neighbour among the floats."""
    name = min(pictures)
    moved = pictures[name].copy()
    flat = moved.reshape(-1)
    flat[flat.size // 2] = np.nextafter(flat[flat.size // 2], np.inf, dtype=moved.dtype)
    return {**pictures, name: moved}


def check_planted_rounding(record: Record, path: Path) -> Finding:
    """Compare the pictures of a record with themselves after one value was moved by rounding."""
    pictures = pictures_of(record, path)
    return compare_pictures(pictures, plant_rounding(pictures))


def _differing(first: np.ndarray, second: np.ndarray) -> int:
    if first.shape != second.shape:
        return max(first.size, second.size)
    same = (first == second) | (np.isnan(first) & np.isnan(second))
    return int(np.count_nonzero(~same))
