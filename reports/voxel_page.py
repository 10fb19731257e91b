"""One page about the voxels of a frame: pictures by level, numbers, and a viewer of slices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from PIL import Image

from reports.pictures import Bytes, png_uri


@dataclass(frozen=True, kw_only=True)
class PagePicture:
    """A picture with its file name and what it shows."""

    name: str
    """File name in the folder of the page."""
    title: str
    caption: str
    codes: Bytes
    """[y, x, 3]."""

    @property
    def uri(self) -> str:
        """PNG data URI."""
        return png_uri(Image.fromarray(self.codes, mode="RGB"))


@dataclass(frozen=True, kw_only=True)
class PageGroup:
    """Pictures that belong together."""

    title: str
    pictures: list[PagePicture]


@dataclass(frozen=True, kw_only=True)
class SliceBlock:
    """The voxels of a level for the viewer, 8-bit colours [z, y, x, 3] of each quantity."""

    title: str
    edge: int
    """Layers along an axis."""
    layer_size: float
    """Thickness of a layer, world units."""
    lowest: tuple[float, float, float]
    """Corner of the window, world units."""
    opacity: Bytes
    radiance: Bytes

    @property
    def columns(self) -> int:
        """Layers side by side in an atlas."""
        return math.ceil(math.sqrt(self.edge))

    def atlas_uri(self, quantity: str) -> str:
        """PNG data URI of all layers along z, row by row of `columns`, the lowest first."""
        block: Bytes = getattr(self, quantity)
        return png_uri(Image.fromarray(atlas(block, self.columns), mode="RGB"))


def atlas(block: Bytes, columns: int) -> Bytes:
    """Return the layers [z, y, x, 3] of a block side by side, [row y, column x, 3]."""
    depth, height, width, _ = block.shape
    rows = math.ceil(depth / columns)
    padded = np.zeros((rows * columns, height, width, 3), np.uint8)
    padded[:depth] = block
    tiled = padded.reshape(rows, columns, height, width, 3).transpose(0, 2, 1, 3, 4)
    return tiled.reshape(rows * height, columns * width, 3)


def voxel_page(
    title: str,
    notes: Sequence[str],
    groups: Sequence[PageGroup],
    table: Sequence[Sequence[str]],
    blocks: Sequence[SliceBlock],
) -> str:
    """Build the page; it loads nothing, so it works offline and alone.

    Parameters
    ----------
    title
        Of the page.
    notes
        What a reader must know, a sentence each.
    groups
        Pictures, in order.
    table
        Numbers about differences; the first row is the heading. May be empty.
    blocks
        Levels of the slice viewer.
    """
    environment = Environment(
        loader=PackageLoader("reports", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("voxels.html.j2").render(
        title=title,
        notes=notes,
        groups=groups,
        table=table,
        blocks=blocks,
        style=Markup(_part("accuracy.css") + _part("voxels.css")),
        script=Markup(_part("voxels.js")),
    )


def _part(name: str) -> str:
    return files("reports").joinpath("templates", name).read_text(encoding="utf-8")
