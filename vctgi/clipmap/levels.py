"""Where the levels of a clipmap lie: nested windows of equal resolution around a centre.

Clip levels 0 .. `clip_level_count` - 1 have `resolution`^3 voxels each, of a size that doubles per
level. Behind the coarsest one stands its mip pyramid down to 4^3 voxels, which wide cones read far
away. Windows are snapped so that every voxel of a level has all or none of its eight children in
the finer window: to even voxels, and for the coarsest one to the voxels of its last mip.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

COARSEST_MIP_RESOLUTION = 4
"""Voxels along an edge of the last mip."""

WINDOW_MARGIN_VOXELS = 2.5
"""What a window keeps free at its rim: one voxel of snapping, one of interpolation, half a voxel
of pull-back."""


@dataclass(frozen=True, kw_only=True)
class ClipmapConfig:
    """Size of the clipmap; what is None is chosen from the scene by the plan."""

    resolution: int = 64
    """Voxels along an edge of a level, a power of two in 8 .. 256."""
    finest_voxel_size: float | None = None
    """Edge of a level-0 voxel, world units."""
    level_count: int | None = None
    """Clip levels, 1 .. 8."""
    max_level_count: int = 5
    """Most clip levels that are chosen automatically."""
    centre: tuple[float, float, float] | None = None
    """World point that the windows surround."""
    ahead: float | None = None
    """Places the centre this far ahead of the viewer, in half extents of the finest window, 0 .. 1;
    None surrounds what the viewer sees nearby."""

    def __post_init__(self) -> None:
        """Refuse what cannot be addressed."""
        if not 8 <= self.resolution <= 256 or self.resolution & (self.resolution - 1):
            raise ValueError(
                "ClipmapConfig.resolution must be a power of two in 8 .. 256, "
                f"got {self.resolution}: toroidal addressing wraps by a bit mask."
            )
        if self.finest_voxel_size is not None and not self.finest_voxel_size > 0.0:
            raise ValueError(
                f"ClipmapConfig.finest_voxel_size must be > 0, got {self.finest_voxel_size}."
            )
        if self.ahead is not None and not 0.0 <= self.ahead <= 1.0:
            raise ValueError(
                f"ClipmapConfig.ahead must be in [0, 1], got {self.ahead}: "
                "farther ahead, the viewer stands outside the finest window."
            )
        if self.ahead is not None and self.centre is not None:
            raise ValueError("ClipmapConfig: give either centre or ahead, not both.")
        for name in ("level_count", "max_level_count"):
            value = getattr(self, name)
            if value is not None and not 1 <= value <= 8:
                raise ValueError(f"ClipmapConfig.{name} must be in 1 .. 8, got {value}.")


@dataclass(frozen=True, kw_only=True)
class LevelLayout:
    """One level of the clipmap or of the mip pyramid behind it.

    Attributes
    ----------
    level
        0 is finest.
    voxel_size
        Edge of a voxel, world units.
    resolution
        Voxels along an edge.
    origin
        Lowest voxel of the window, (x, y, z), in voxels of this level.
    """

    level: int
    voxel_size: float
    resolution: int
    origin: tuple[int, int, int]

    @property
    def voxel_count(self) -> int:
        """Voxels of the level."""
        return self.resolution**3

    @property
    def window_min(self) -> tuple[float, float, float]:
        """Lowest corner of the window, world units."""
        x, y, z = self.origin
        return (x * self.voxel_size, y * self.voxel_size, z * self.voxel_size)

    @property
    def window_max(self) -> tuple[float, float, float]:
        """Highest corner of the window, world units."""
        x, y, z = self.window_min
        extent = self.resolution * self.voxel_size
        return (x + extent, y + extent, z + extent)


@dataclass(frozen=True, kw_only=True)
class ClipmapLayout:
    """All levels, finest first.

    Attributes
    ----------
    levels
        Clip levels, then the mips of the coarsest one.
    clip_level_count
        How many of them are clip levels.
    centre
        World point that the windows surround before snapping.
    spare_level_count
        How many of the clip levels, the coarsest ones, are filled although finer ones hold the
        whole scene; nothing reads what only they hold.
    """

    levels: tuple[LevelLayout, ...]
    clip_level_count: int
    centre: tuple[float, float, float]
    spare_level_count: int = 0

    @property
    def finest_voxel_size(self) -> float:
        """Edge of a level-0 voxel, world units."""
        return self.levels[0].voxel_size

    @property
    def resolution(self) -> int:
        """Voxels along an edge of a clip level."""
        return self.levels[0].resolution

    @property
    def clip_levels(self) -> tuple[LevelLayout, ...]:
        """The clip levels, finest first."""
        return self.levels[: self.clip_level_count]

    @property
    def read_clip_level_count(self) -> int:
        """Clip levels that cones tell apart."""
        return self.clip_level_count - self.spare_level_count

    @property
    def last_read_level(self) -> int:
        """Coarsest level, or mip, that cones read."""
        return len(self.levels) - 1 - self.spare_level_count

    @property
    def coarsest(self) -> LevelLayout:
        """The coarsest clip level, whose window bounds everything that cones can meet."""
        return self.levels[self.read_clip_level_count - 1]

    @property
    def extent(self) -> float:
        """Edge of the coarsest window, world units."""
        return self.coarsest.resolution * self.coarsest.voxel_size

    @cached_property
    def voxel_offsets(self) -> tuple[int, ...]:
        """First voxel of each level in storage, counting the voxels of all levels before it."""
        offsets = [0]
        for level in self.levels[:-1]:
            offsets.append(offsets[-1] + level.voxel_count)
        return tuple(offsets)

    @property
    def voxel_count(self) -> int:
        """Voxels of all levels."""
        return sum(level.voxel_count for level in self.levels)


def lay_out_clipmap(
    centre: tuple[float, float, float],
    *,
    finest_voxel_size: float,
    level_count: int,
    resolution: int,
    spare_level_count: int = 0,
) -> ClipmapLayout:
    """Place the windows of a clipmap around a world point.

    Parameters
    ----------
    centre
        World point, usually ahead of the viewer.
    finest_voxel_size
        Edge of a level-0 voxel, world units, > 0.
    level_count
        Clip levels, >= 1.
    resolution
        Voxels along an edge of a clip level, a power of two.
    spare_level_count
        How many of the levels nothing needs; they change nothing about the others.
    """
    levels = []
    for level in range(level_count):
        voxel_size = finest_voxel_size * 2.0**level
        is_coarsest = level >= level_count - spare_level_count - 1
        snap = resolution // COARSEST_MIP_RESOLUTION if is_coarsest else 2
        origin = tuple(_snapped_origin(c, voxel_size, resolution, snap) for c in centre)
        levels.append(_level(level, voxel_size, resolution, origin))
    mip_resolution = resolution // 2
    while mip_resolution >= COARSEST_MIP_RESOLUTION:
        finer = levels[-1]
        origin = tuple(o // 2 for o in finer.origin)
        levels.append(_level(finer.level + 1, 2.0 * finer.voxel_size, mip_resolution, origin))
        mip_resolution //= 2
    return ClipmapLayout(
        levels=tuple(levels),
        clip_level_count=level_count,
        centre=centre,
        spare_level_count=spare_level_count,
    )


def move_clipmap(layout: ClipmapLayout, centre: tuple[float, float, float]) -> ClipmapLayout:
    """Return the same levels around another world point."""
    return lay_out_clipmap(
        centre,
        finest_voxel_size=layout.finest_voxel_size,
        level_count=layout.clip_level_count,
        resolution=layout.resolution,
        spare_level_count=layout.spare_level_count,
    )


def _level(level: int, voxel_size: float, resolution: int, origin: tuple[int, ...]) -> LevelLayout:
    x, y, z = origin
    return LevelLayout(level=level, voxel_size=voxel_size, resolution=resolution, origin=(x, y, z))


def _snapped_origin(centre: float, voxel_size: float, resolution: int, snap: int) -> int:
    """Lowest voxel of a window around `centre`, a multiple of `snap` voxels."""
    return snap * round((centre / voxel_size - 0.5 * resolution) / snap)
