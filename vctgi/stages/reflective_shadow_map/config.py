"""How many texels the maps have."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class ReflectiveShadowMapConfig:
    """Resolution of the maps."""

    texels_per_voxel: float = 8.0
    """Texels along an edge of a full map for each voxel along an edge of a level, > 0."""
    texels_per_face: float = 16.0
    """Texels of a lamp for each voxel's face that it lights, > 0; a full map's are the most."""
    full_lamp_count: int = 4
    """Lamps that may each have a full map, >= 1; more lamps share the texels of so many by their
    power, and none gets fewer than 64."""
    max_texel_count: int = 1 << 22
    """Texels of all maps together; more lights than that allows get smaller maps."""

    def __post_init__(self) -> None:
        """Refuse an empty map."""
        for name in ("texels_per_voxel", "texels_per_face"):
            value = getattr(self, name)
            if not value > 0.0:
                raise ValueError(f"ReflectiveShadowMapConfig.{name} must be > 0, got {value}.")
        for name in ("full_lamp_count", "max_texel_count"):
            value = getattr(self, name)
            if value < 1:
                raise ValueError(f"ReflectiveShadowMapConfig.{name} must be >= 1, got {value}.")
