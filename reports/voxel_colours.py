"""Pictures of voxels -> colours: one rule a quantity, the same in reports and debug pages."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib as mpl
import numpy as np

from reports.pictures import NOT_FINITE, Bytes, Floats, finite_pixels, srgb_from_linear

MISS = (38, 50, 72)
"""Dark blue: no voxel there. Darker than any grey that matters, and no colour of a map."""

QUANTITIES = {
    "opacity": "Share of light that the voxel stops over a path of one voxel: black 0, white 1.",
    "albedo": "Mean albedo of the surfaces in the slots that face the ray.",
    "normal": "Mean normal, world space, -1 to 1 per axis, from the six one-sided slots.",
    "radiance": "Emittance over opacity of the slots that face the ray.",
}
"""What is shown of each level, in the order of a page, with what it means."""


@dataclass(frozen=True)
class VoxelPicture:
    """One quantity of the voxels of one level.

    Attributes
    ----------
    values
        [y, x] or [y, x, 3], linear.
    shade
        [y, x] factor that draws the edges of voxels; 0 where there is no voxel.
    """

    values: Floats
    shade: Floats


def voxel_codes(quantity: str, picture: VoxelPicture, *, exposure: float) -> Bytes:
    """Return 8-bit colours [y, x, 3].

    Parameters
    ----------
    quantity
        A key of `QUANTITIES`.
    picture
        Its values; not finite ones become magenta.
    exposure
        Stops, for radiance.

    Raises
    ------
    ValueError
        A quantity that is not known.
    """
    values = np.asarray(picture.values, np.float32)
    if quantity == "normal":
        codes = np.round(255.0 * np.clip(0.5 + 0.5 * np.nan_to_num(values), 0.0, 1.0))
    elif quantity == "opacity":
        grey = np.round(255.0 * np.clip(np.nan_to_num(values), 0.0, 1.0))
        codes = np.repeat(grey[..., None], 3, axis=-1)
    elif quantity in QUANTITIES:
        codes = srgb_from_linear(values, exposure=exposure if quantity == "radiance" else 0.0)
    else:
        raise ValueError(f"voxel_codes: no quantity '{quantity}'; use {', '.join(QUANTITIES)}")
    shaded: Bytes = np.round(codes * picture.shade[..., None]).astype(np.uint8)
    shaded[~finite_pixels(values)] = NOT_FINITE
    shaded[picture.shade <= 0.0] = MISS
    return shaded


def difference_codes(difference: Floats, is_hit: Bytes, *, scale: float) -> Bytes:
    """Return colours of a signed difference [y, x]: red above, blue below, white none."""
    position = np.clip(0.5 + 0.5 * np.asarray(difference) / scale, 0.0, 1.0)
    codes: Bytes = np.round(255.0 * mpl.colormaps["RdBu_r"](position)[..., :3]).astype(np.uint8)
    codes[~np.asarray(is_hit, bool)] = MISS
    return codes


def level_colours(count: int) -> Bytes:
    """Return one colour for each level [level, 3], told apart also by those who see two hues."""
    table = mpl.colormaps["tab10"](np.arange(count) % 10)[:, :3]
    colours: Bytes = np.round(255.0 * table).astype(np.uint8)
    return colours
