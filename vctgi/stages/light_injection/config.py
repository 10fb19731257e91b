"""Which algorithm puts light into voxels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

Algorithm = Literal["scatter", "gather", "centre"]
Normalisation = Literal["power", "radiance"]

PREFILTERS = (1, 3, 5)
"""Voxels along an edge of the box that a texel may touch."""


@dataclass(frozen=True, kw_only=True)
class LightInjectionConfig:
    """How lit points become emittance."""

    algorithm: Algorithm = "scatter"
    """"scatter": each texel adds its power to its voxels. "gather": each covered slot collects
    the texels near it; the same sums, bit for bit. "centre": each covered slot takes the radiance
    of the one texel in it that is nearest to its middle; power is not kept."""
    prefilter: int = 1
    """Voxels along an edge of the box that a texel is spread over, 1 (none), 3 or 5; of each level
    its own voxels. Only covered slots get light, weighed by their opacity, and power is kept."""
    prefilter_scale: float = 1.0
    """Factor on the width of the pre-filter's kernel within its box, > 0; 1: a B-spline. Other
    than 1 only where there is a pre-filter."""
    normalisation: Normalisation = "power"
    """"power": all that is injected stays, so a slot may be brighter than the surfaces in it.
    "radiance": no slot is brighter than its opacity times the radiance that the texels in it have
    on average, which must be known; what is above is left out."""

    def __post_init__(self) -> None:
        """Refuse what is not offered."""
        for name, offered in (("algorithm", Algorithm), ("normalisation", Normalisation)):
            if getattr(self, name) not in get_args(offered):
                raise ValueError(
                    f"LightInjectionConfig.{name} must be one of {', '.join(get_args(offered))}, "
                    f"got '{getattr(self, name)}'."
                )
        if self.prefilter not in PREFILTERS:
            raise ValueError(
                f"LightInjectionConfig.prefilter must be one of {PREFILTERS}, got {self.prefilter}."
            )
        if not 0.0 < self.prefilter_scale < math.inf:
            raise ValueError(
                "LightInjectionConfig.prefilter_scale must be > 0 and finite, "
                f"got {self.prefilter_scale}."
            )
        if self.prefilter == 1 and self.prefilter_scale != 1.0:
            raise ValueError(
                "LightInjectionConfig.prefilter_scale must be 1 without a pre-filter, got "
                f"{self.prefilter_scale}; set prefilter to 3 or 5."
            )
        if self.algorithm == "centre" and self.prefilter > 1:
            raise ValueError(
                'LightInjectionConfig.prefilter must be 1 with algorithm "centre", which takes one '
                f"texel for each voxel, got {self.prefilter}."
            )

    @property
    def reach_voxels(self) -> int:
        """Voxels that light may be spread to, in each direction."""
        return self.prefilter // 2

    @property
    def needs_radiance(self) -> bool:
        """Whether texels must know the radiance of the surface that they lie on."""
        return self.algorithm == "centre" or self.normalisation == "radiance"


DEFAULT_CONFIG = LightInjectionConfig()
