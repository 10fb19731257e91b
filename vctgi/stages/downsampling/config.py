"""How levels are filled from finer ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

MipRule = Literal["columns", "average"]
"""How eight children make a voxel. "columns": along each direction the two of a column add up;
"average": their mean, in which a wall of one voxel opens more at every level."""


@dataclass(frozen=True, kw_only=True)
class DownsamplingConfig:
    """How levels are filled from finer ones."""

    mips: MipRule = "columns"
    """How eight children make a voxel."""
    is_isotropic: bool = False
    """Whether a voxel is first made the same from all sides: as opaque as its most opaque slot,
    and as bright as all of them on average."""

    def __post_init__(self) -> None:
        """Refuse rules that do not exist."""
        if self.mips not in get_args(MipRule):
            raise ValueError(
                f"DownsamplingConfig.mips must be one of {get_args(MipRule)}, got {self.mips!r}."
            )


DEFAULT_DOWNSAMPLING = DownsamplingConfig()
