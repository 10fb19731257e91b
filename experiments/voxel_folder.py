"""`vctgi render --debug voxels`: the voxels of a frame as a folder of pictures with one page."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

import metrics
from experiments.debug_pictures import level_title, level_view
from reports.pictures import Bytes, srgb_from_linear
from reports.voxel_colours import (
    MISS,
    QUANTITIES,
    VoxelPicture,
    difference_codes,
    level_colours,
    voxel_codes,
)
from reports.voxel_page import PageGroup, PagePicture, SliceBlock, voxel_page
from vctgi.clipmap.storage import OpacityClipmap, VoxelVolume
from vctgi.debug.boundaries import NO_LEVEL, BoundaryView, view_boundaries
from vctgi.debug.camera import PixelRays, pixel_rays
from vctgi.debug.opacity_difference import OpacityDifference, compare_opacity
from vctgi.debug.ray_cast import VISIBLE_OPACITY, compose_voxels
from vctgi.debug.slices import VoxelBlock, voxel_block
from vctgi.debug.voxels import LevelVoxels, stored_voxels
from vctgi.pipeline import PreparedScene
from vctgi.stages.downsampling import downsample
from vctgi.stages.voxelization.opacity import OpacityVoxelizationConfig, voxelize_opacity

PICTURE_EDGE = 512
"""Pixels along the longer edge of a picture; smaller films are seen at their own size."""

SAMPLES_PER_FACE = 16.0
"""Points of albedo on a voxel's face: enough that hardly a visible voxel goes without."""

SLICE_BYTES = 4_000_000
"""Most that the slices take of a page; beyond it, 2^3 voxels are merged into one, and again."""

PAGE = "index.html"

HIDDEN_LINE = 0.45
"""Share of its colour that the line of a window has behind a surface."""

HEADING = ["comparison", "slots", "mean", "RMS", "largest", "sum / sum"]


def write_voxel_folder(
    prepared: PreparedScene,
    volume: VoxelVolume,
    voxelization: OpacityVoxelizationConfig,
    title: str,
    folder: Path,
) -> list[str]:
    """Write pictures of the voxels and a page about them.

    Parameters
    ----------
    prepared
        The scene.
    volume
        Its lit voxels, as cones read them.
    voxelization
        How they were made.
    title
        Of the page.
    folder
        Where to; files of the same names are replaced.

    Returns
    -------
    list of str
        What was written and what it says, a line each.
    """
    rays = pixel_rays(prepared.sensor, PICTURE_EDGE)
    levels = range(volume.layout.clip_level_count)
    exposure: float | None = None
    groups, blocks = [_boundaries(prepared, volume, rays)], []
    for level in levels:
        voxels = stored_voxels(volume, level)
        view = level_view(prepared, voxels, rays, voxelization.slots, SAMPLES_PER_FACE)
        if exposure is None:
            exposure = _exposure(view.radiance)
        pictures = [
            _picture(
                f"level{level}_{quantity}",
                quantity,
                meaning,
                voxel_codes(
                    quantity,
                    VoxelPicture(getattr(view, quantity), np.where(view.is_hit, view.shade, 0.0)),
                    exposure=exposure,
                ),
            )
            for quantity, meaning in QUANTITIES.items()
        ]
        pictures.append(_composed(voxels, rays, level, exposure))
        groups.append(PageGroup(title=level_title(voxels), pictures=pictures))
        blocks.append(voxel_block(voxels))
    differences = list(_differences(prepared, voxelization, rays))
    for level, name, difference in differences:
        groups[1 + level].pictures.append(_difference_picture(level, name, difference))
    table = [HEADING, *(_row(level, name, found) for level, name, found in differences)]
    assert exposure is not None, "a clipmap has at least one level"
    slices = _slices(blocks, exposure)
    page = voxel_page(title, _notes(exposure, blocks, slices), groups, table, slices)
    return _write(folder, groups, page, table)


def _write(folder: Path, groups: list[PageGroup], page: str, table: list[list[str]]) -> list[str]:
    """Write the files of a folder, each whole or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    pictures = [picture for group in groups for picture in group.pictures]
    for picture in pictures:
        with tempfile.NamedTemporaryFile(dir=folder, prefix=".", suffix=".png") as part:
            Image.fromarray(picture.codes, mode="RGB").save(part.name, optimize=True)
            (folder / picture.name).write_bytes(Path(part.name).read_bytes())
    (folder / PAGE).write_text(page, encoding="utf-8")
    lines = [f"{folder / PAGE} ({len(page) / 1e6:.1f} MB)"]
    lines += [str(folder / picture.name) for picture in pictures]
    return lines + ["  ".join(row) for row in table]


def _picture(name: str, title: str, caption: str, codes: Bytes) -> PagePicture:
    return PagePicture(name=f"{name}.png", title=title, caption=caption, codes=codes)


def _exposure(radiance: np.ndarray) -> float:
    """Return the stops at which the finest level is shown, 0 where it is dark."""
    lit = radiance[radiance.max(axis=-1) > 0.0]
    return metrics.display_settings(lit[None]).exposure if len(lit) else 0.0


def _composed(voxels: LevelVoxels, rays: PixelRays, level: int, exposure: float) -> PagePicture:
    radiance, opacity = compose_voxels(voxels, rays)
    codes = srgb_from_linear(rays.picture(radiance), exposure=exposure).astype(np.float64)
    share = rays.picture(opacity)[..., None]
    behind = np.round(codes + (1.0 - share) * np.array(MISS))
    return _picture(
        f"level{level}_composed",
        "composed",
        "All voxels along the ray, front to back; what passes them all is dark blue.",
        np.clip(behind, 0, 255).astype(np.uint8),
    )


def _boundaries(prepared: PreparedScene, volume: VoxelVolume, rays: PixelRays) -> PageGroup:
    """Picture of the levels: which one is read where, and the edges of their windows."""
    view = view_boundaries(prepared.scene, volume.layout, rays)
    count = volume.layout.clip_level_count
    picture = _picture(
        "levels",
        "levels",
        "Colour: the finest level that a cone reads at the surface (blue 0, orange 1, green 2, "
        "red 3, purple 4, ...), blended where a window fades into the next. Lines: edges of the "
        "windows, weak behind surfaces.",
        boundary_codes(view, count),
    )
    return PageGroup(title="Level boundaries", pictures=[picture])


def boundary_codes(view: BoundaryView, level_count: int) -> Bytes:
    """Return the colours [y, x, 3] of a view of level boundaries."""
    colours = level_colours(level_count).astype(np.float64)
    lower = np.clip(np.floor(view.read_level).astype(int), 0, level_count - 1)
    upper = np.minimum(lower + 1, level_count - 1)
    blend = (view.read_level - lower)[..., None]
    tint = (1.0 - blend) * colours[lower] + blend * colours[upper]
    codes = np.where(
        view.is_hit[..., None], tint * (0.25 + 0.6 * view.cosine[..., None]), np.array(MISS)
    )
    is_line = view.line_level != NO_LEVEL
    line = 0.7 * colours[np.maximum(view.line_level, 0)] + 0.3 * 255.0
    strength = (is_line * np.where(view.is_in_front, 1.0, HIDDEN_LINE))[..., None]
    shown: Bytes = np.round((1.0 - strength) * codes + strength * line).astype(np.uint8)
    return shown


def _differences(
    prepared: PreparedScene, voxelization: OpacityVoxelizationConfig, rays: PixelRays
) -> Iterator[tuple[int, str, OpacityDifference]]:
    """Compare opacities: sampled with exact coverage, downsampled with direct voxels."""
    layout = prepared.plan.layout
    voxelization = replace(voxelization, is_complete=True)
    direct = voxelize_opacity(prepared.surfaces, layout, voxelization)
    analytic = replace(voxelization, coverage="analytic", max_supersampling=1)
    exact = voxelize_opacity(prepared.surfaces, layout, analytic)
    for level in layout.clip_levels:
        yield level.level, "coverage", compare_opacity(direct, exact, level.level, rays)
    filled, _ = downsample(OpacityClipmap(layout, list(direct.levels), direct.rule), None)
    for finer, coarser in zip(layout.clip_levels[:-1], layout.clip_levels[1:], strict=True):
        found = compare_opacity(filled, direct, coarser.level, rays, within=finer)
        yield coarser.level, "mismatch", found


DIFFERENCES = {
    "coverage": "Sampled coverage minus exact coverage",
    "mismatch": "Downsampled from the finer level minus voxelized directly",
}
"""What is compared, by name."""


def _difference_picture(level: int, name: str, difference: OpacityDifference) -> PagePicture:
    scale = difference_scale(difference.difference)
    codes = difference_codes(difference.difference, difference.is_hit, scale=scale)
    caption = f"{DIFFERENCES[name]}: red more, blue less, the full colour at {scale:g}."
    return _picture(f"level{level}_{name}", name, caption, codes)


def difference_scale(difference: np.ndarray) -> float:
    """Return the difference that has the full colour: 1, 1/2, 1/4, ..., the smallest that fits."""
    largest = float(np.abs(difference).max(initial=0.0))
    return 2.0 ** max(math.ceil(math.log2(largest)), -10) if largest > 0.0 else 1.0


def _row(level: int, name: str, difference: OpacityDifference) -> list[str]:
    numbers = difference.numbers
    ratio = "-" if numbers.total_ratio is None else f"{numbers.total_ratio:.4f}"
    return [
        f"level {level}: {DIFFERENCES[name].lower()}",
        f"{numbers.slot_count}",
        f"{numbers.mean:+.4f}",
        f"{numbers.rms:.4f}",
        f"{numbers.largest:.4f}",
        ratio,
    ]


def _slices(blocks: list[VoxelBlock], exposure: float) -> list[SliceBlock]:
    """Return the levels for the viewer, merged until they fit the page."""
    factor = 1
    while True:
        slices = [_slice_block(block.merged(factor), exposure) for block in blocks]
        size = sum(len(s.atlas_uri(q)) for s in slices for q in ("opacity", "radiance"))
        if size <= SLICE_BYTES or slices[0].edge <= 16:
            return slices
        factor *= 2


def _slice_block(block: VoxelBlock, exposure: float) -> SliceBlock:
    edge = block.opacity.shape[0]
    radiance = srgb_from_linear(
        block.radiance.reshape(edge * edge, edge, 3).astype(np.float32), exposure=exposure
    ).reshape(edge, edge, edge, 3)
    is_empty = ~(block.opacity > 0.0).any(axis=-1)
    opacity = np.round(255.0 * block.opacity).astype(np.uint8)
    for codes in (opacity, radiance):
        codes[is_empty] = MISS
    return SliceBlock(
        title=f"level {block.level.level}, {block.level.voxel_size:.4g} a voxel",
        edge=edge,
        layer_size=block.level.voxel_size * block.pooled,
        lowest=block.level.window_min,
        opacity=opacity,
        radiance=radiance,
    )


def _notes(exposure: float, blocks: list[VoxelBlock], slices: list[SliceBlock]) -> list[str]:
    """Say what the pictures need to be understood."""
    notes = [
        "Pictures of a level show the first voxel along each ray of which a slot that faces the "
        f"ray has an opacity of at least {VISIBLE_OPACITY:g}; voxels are one-sided and are not "
        "seen from behind. Nothing is interpolated. Dark blue: no voxel; magenta: no sample.",
        f"Radiance is shown at {exposure:+.1f} stops with the plain sRGB curve.",
    ]
    merged = blocks[0].opacity.shape[0] // slices[0].edge
    if merged > 1:
        notes.append(
            f"To keep this page small, slices show {merged}^3 voxels as one: the largest opacity, "
            "the mean radiance."
        )
    return notes
