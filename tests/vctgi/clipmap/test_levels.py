"""Windows are nested, snapped to whole parents, and keep their margin around the centre."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vctgi.clipmap.levels import (
    COARSEST_MIP_RESOLUTION,
    WINDOW_MARGIN_VOXELS,
    ClipmapConfig,
    ClipmapLayout,
    lay_out_clipmap,
)

_CENTRE = st.one_of(st.floats(-10.0, 10.0), st.floats(-1e5, 1e5))
layouts = st.builds(
    lambda x, y, z, voxel_size, level_count, power: lay_out_clipmap(
        (x, y, z), finest_voxel_size=voxel_size, level_count=level_count, resolution=2**power
    ),
    *(_CENTRE, _CENTRE, _CENTRE),
    voxel_size=st.floats(1e-3, 10.0),
    level_count=st.integers(1, 6),
    power=st.integers(3, 8),
)


@given(layout=layouts)
def test_children_of_a_voxel_are_all_inside_or_all_outside(layout: ClipmapLayout) -> None:
    for finer in layout.levels[:-1]:
        assert all(lowest % 2 == 0 for lowest in finer.origin)
        assert finer.resolution % 2 == 0


@given(layout=layouts)
def test_mips_cover_exactly_the_coarsest_window(layout: ClipmapLayout) -> None:
    coarsest = layout.coarsest
    for mip in layout.levels[layout.clip_level_count :]:
        factor = 2 ** (mip.level - coarsest.level)
        assert tuple(factor * lowest for lowest in mip.origin) == coarsest.origin
        assert factor * mip.resolution == coarsest.resolution
    assert layout.levels[-1].resolution == COARSEST_MIP_RESOLUTION


@given(layout=layouts)
def test_each_window_lies_inside_the_next(layout: ClipmapLayout) -> None:
    for finer, coarser in zip(layout.clip_levels[:-1], layout.clip_levels[1:], strict=True):
        for low, high in zip(finer.origin, coarser.origin, strict=True):
            assert 2 * high <= low
            assert low + finer.resolution <= 2 * (high + coarser.resolution)


@given(layout=layouts)
def test_window_keeps_its_margin_around_the_centre(layout: ClipmapLayout) -> None:
    for level in layout.clip_levels[:-1]:
        for lowest, centre in zip(level.origin, layout.centre, strict=True):
            offset = centre / level.voxel_size - (lowest + 0.5 * level.resolution)
            # One voxel of snapping; the rest of the margin is for interpolation and pull-back.
            assert abs(offset) <= 1.0 + 1e-6 * abs(centre / level.voxel_size)
            assert WINDOW_MARGIN_VOXELS >= 1.0


@given(layout=layouts)
def test_storage_is_packed_without_gaps(layout: ClipmapLayout) -> None:
    end = 0
    for level, offset in zip(layout.levels, layout.voxel_offsets, strict=True):
        assert offset == end
        end += level.voxel_count
    assert layout.voxel_count == end


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("resolution", 48, "power of two"),
        ("resolution", 4, "8 .. 256"),
        ("finest_voxel_size", 0.0, "> 0"),
        ("level_count", 9, "1 .. 8"),
        ("max_level_count", 0, "1 .. 8"),
    ],
)
def test_impossible_sizes_are_refused(field: str, value: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ClipmapConfig(**{field: value})  # type: ignore[arg-type]
