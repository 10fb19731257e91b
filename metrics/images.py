"""What every metric asks of its input before it computes anything."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrics.finite import require_finite

Image = NDArray[np.float64]
"""Linear RGB radiance, W m^-2 sr^-1, ``(H, W, 3)``."""

Batches = NDArray[np.float64]
"""Independent renderings of one reference, equal in expectation, ``(M, H, W, 3)``."""


def checked_image(image: ArrayLike, name: str) -> Image:
    """Return the image in float64, once it is known to be a finite ``(H, W, 3)`` image.

    Parameters
    ----------
    image
        Linear RGB, ``(H, W, 3)``, any real dtype.
    name
        What it is, for messages.

    Raises
    ------
    ValueError
        For another shape, an empty image, numbers that are not real, NaN or infinity.
    """
    array = _real_array(image, name)
    _require_channels(array, 3, f"{name}.shape must be (H, W, 3)")
    require_finite(array, name)
    return array.astype(np.float64, copy=False)


def checked_batches(batches: ArrayLike, *, least: int) -> Batches:
    """Return the reference batches in float64, once they are known to be finite and enough.

    Parameters
    ----------
    batches
        Linear RGB, ``(M, H, W, 3)``, any real dtype.
    least
        Fewest batches that the caller's estimator can do with.

    Raises
    ------
    ValueError
        For another shape, fewer batches, numbers that are not real, NaN or infinity.
    """
    array = _real_array(batches, "batches")
    _require_channels(array, 4, "batches.shape must be (M, H, W, 3)")
    if array.shape[0] < least:
        raise ValueError(
            f"batches must hold at least {least} independent references, got {array.shape[0]}: "
            "render the reference in more batches, each with its own seed."
        )
    for index, batch in enumerate(array):
        require_finite(batch, f"batches[{index}]")
    return array.astype(np.float64, copy=False)


def checked_pair(test: ArrayLike, reference: ArrayLike) -> tuple[Image, Image]:
    """Return test and reference in float64, once both are finite images of one shape.

    Raises
    ------
    ValueError
        For anything `checked_image` refuses, or two shapes that differ.
    """
    checked_test = checked_image(test, "test")
    checked_reference = checked_image(reference, "reference")
    _require_same_shape(checked_test, checked_reference.shape)
    return checked_test, checked_reference


def checked_inputs(test: ArrayLike, batches: ArrayLike, *, least: int = 2) -> tuple[Image, Batches]:
    """Return the test image and the reference batches in float64, once they fit together.

    Raises
    ------
    ValueError
        For anything `checked_image` or `checked_batches` refuses, or shapes that differ.
    """
    checked_test = checked_image(test, "test")
    checked_reference = checked_batches(batches, least=least)
    _require_same_shape(checked_test, checked_reference.shape[1:])
    return checked_test, checked_reference


def _real_array(values: ArrayLike, name: str) -> NDArray[Any]:
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} must hold real numbers, got dtype {array.dtype}.")
    return array


def _require_channels(array: NDArray[Any], dimensions: int, rule: str) -> None:
    if array.ndim == dimensions and array.shape[-1] == 4:
        raise ValueError(f"{rule}, got {array.shape}: drop alpha with image[..., :3].")
    if array.ndim != dimensions or array.shape[-1] != 3:
        raise ValueError(f"{rule}, got {array.shape}: pass linear RGB.")
    if array.size == 0:
        raise ValueError(f"{rule} with at least one pixel, got {array.shape}: it is empty.")


def _require_same_shape(test: Image, shape: tuple[int, ...]) -> None:
    if test.shape != shape:
        raise ValueError(
            f"test and reference must have one shape, got {test.shape} and {shape}: "
            "render both at one resolution."
        )
