"""How many pixels trace diffuse cones, and when a neighbour's light may be taken."""

from __future__ import annotations

import math
from dataclasses import dataclass

EDGES = {1: 1, 4: 2, 9: 3, 16: 4}
"""Edge in pixels of the blocks of which one pixel is traced, by the sparsity."""


@dataclass(frozen=True, kw_only=True)
class ReconstructionConfig:
    """How the diffuse light of all pixels is made from that of a few."""

    sparsity: int = 1
    """One camera ray of so many traces cones: 1, 4, 9 or 16."""
    is_traced_once: bool = False
    """Whether only the first camera rays of the pixels trace, and further ones take their light
    from those too: the cones of one ray a pixel, however many there are, at the noise of one."""
    max_normal_angle: float = math.radians(30.0)
    """Angle between normals at which a neighbour counts no more, radians, (0, pi]."""
    max_plane_slope: float = 0.3
    """Distance of a neighbour from the plane of the surface, over its distance, at which it counts
    no more, > 0."""
    max_depth_ratio: float = 0.3
    """Difference of depths over the smaller of them at which a neighbour counts no more, > 0."""
    min_support: float = 0.1
    """Weight of the neighbours that count over that of all, below which a pixel traces cones of its
    own, [0, 1]."""

    max_contrast: float | None = None
    """Standard deviation of the neighbours' light over its mean, above which a pixel traces cones
    of its own, > 0: surfaces do not say where a shadow ends; None: no limit."""

    def __post_init__(self) -> None:
        """Refuse patterns that do not exist, and thresholds that let nothing through."""
        if self.sparsity not in EDGES:
            raise ValueError(
                f"ReconstructionConfig.sparsity must be one of {tuple(EDGES)}, got {self.sparsity}."
            )
        if not 0.0 < self.max_normal_angle <= math.pi:
            raise ValueError(
                "ReconstructionConfig.max_normal_angle must be in (0, pi], "
                f"got {self.max_normal_angle}: at 0 no pixel finds a neighbour."
            )
        for name in ("max_plane_slope", "max_depth_ratio"):
            if not getattr(self, name) > 0.0:
                raise ValueError(
                    f"ReconstructionConfig.{name} must be > 0, got {getattr(self, name)}: "
                    "at 0 no pixel finds a neighbour."
                )
        if self.max_contrast is not None and not self.max_contrast > 0.0:
            raise ValueError(
                f"ReconstructionConfig.max_contrast must be > 0 or None, got {self.max_contrast}."
            )
        if not 0.0 <= self.min_support <= 1.0:
            raise ValueError(
                f"ReconstructionConfig.min_support must be in [0, 1], got {self.min_support}."
            )

    @property
    def edge(self) -> int:
        """Edge of a block, pixels."""
        return EDGES[self.sparsity]
