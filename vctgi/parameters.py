"""The continuous parameters of a frame's cones: made from a configuration, put back into one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Self, overload

import drjit as dr
import mitsuba as mi

from vctgi.config import RenderConfig
from vctgi.stages.cone_tracing.cone_values import ConeValues
from vctgi.stages.cone_tracing.diffuse_config import DiffuseConesConfig
from vctgi.stages.reconstruction.interpolation import SurfaceWidths


SPARSE_NAMES = {
    "sparse_normal_angle": "max_normal_angle",
    "sparse_plane_slope": "max_plane_slope",
    "sparse_depth_ratio": "max_depth_ratio",
}
"""Parameters of the interpolation between sparse pixels, and what `ReconstructionConfig` calls
them."""


class ConeParameters(ConeValues):
    """Parameters of a frame by name, as Dr.Jit arrays: those of `ConeValues`, and

    `sparse_normal_angle`, `sparse_plane_slope`, `sparse_depth_ratio`
        Where a frame has sparse pixels: how unlike a neighbour of the same surface may be, as
        `ReconstructionConfig.max_normal_angle` and so on, > 0. Derivatives do not see which rays
        find too few neighbours and trace cones of their own (`min_support`).
    """

    @classmethod
    def from_config(cls, config: RenderConfig | DiffuseConesConfig) -> Self:
        """Return the parameters that a configuration's numbers are.

        Parameters
        ----------
        config
            A frame's, or that of diffuse cones alone.
        """
        if isinstance(config, DiffuseConesConfig):
            return cls(config)
        values = cls(config.diffuse)
        values["specular_aperture_scale"] = dr.opaque(mi.Float, config.specular.aperture_scale)
        if config.reconstruction.sparsity > 1:
            for name, held in SPARSE_NAMES.items():
                values._add(name, getattr(config.reconstruction, held))
        return values

    @overload
    def to_config(self, config: RenderConfig) -> RenderConfig: ...
    @overload
    def to_config(self, config: DiffuseConesConfig) -> DiffuseConesConfig: ...

    def to_config(
        self, config: RenderConfig | DiffuseConesConfig
    ) -> RenderConfig | DiffuseConesConfig:
        """Return a configuration of these values, all else being as in `config`.

        Raises
        ------
        ValueError
            The configuration cannot hold the values: out of its bounds, or different from cone to
            cone where it has one number.
        """
        if isinstance(config, DiffuseConesConfig):
            return self.to_diffuse(config)
        scale = self._single("ambient_range_scale")
        ambient = config.ambient
        for name in ("range_world", "range_share"):
            held = getattr(ambient, name)
            if held is not None:
                ambient = replace(ambient, **{name: scale * held})
        reconstruction = config.reconstruction
        if SPARSE_NAMES.keys() <= self.keys():
            found: dict[str, Any] = {held: self._single(n) for n, held in SPARSE_NAMES.items()}
            reconstruction = replace(reconstruction, **found)
        return replace(
            config,
            reconstruction=reconstruction,
            diffuse=self.to_diffuse(config.diffuse),
            specular=replace(
                config.specular, aperture_scale=self._single("specular_aperture_scale")
            ),
            ambient=ambient,
        )

    def surface_widths(self) -> SurfaceWidths | None:
        """Return what the interpolation between sparse pixels takes; None where there are none."""
        if not SPARSE_NAMES.keys() <= self.keys():
            return None
        return SurfaceWidths(*(self[name] for name in SPARSE_NAMES))
