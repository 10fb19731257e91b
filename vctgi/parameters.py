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
from vctgi.stages.voxelization.opacity import OpacityVoxelizationConfig

SPARSE_NAMES = {
    "sparse_normal_angle": "max_normal_angle",
    "sparse_plane_slope": "max_plane_slope",
    "sparse_depth_ratio": "max_depth_ratio",
}
"""Parameters of the interpolation between sparse pixels, and what `ReconstructionConfig` calls
them."""


class ConeParameters(ConeValues):
    """Parameters of a frame by name, as Dr.Jit arrays: those of `ConeValues`, and some more.

    `sparse_normal_angle`, `sparse_plane_slope`, `sparse_depth_ratio`
        Where a frame has sparse pixels: how unlike a neighbour of the same surface may be, as
        `ReconstructionConfig.max_normal_angle` and so on, > 0. Derivatives do not see which rays
        find too few neighbours and trace cones of their own (`min_support`).
    `prefilter_scale`
        Where injection has a pre-filter: `LightInjectionConfig.prefilter_scale`, > 0.
    `thickness_voxels`
        With analytic coverage, which alone is smooth in it: `SlotRule.thickness_voxels`, [0, 2].

    The last two belong to `light_volume`, the others to `render_frame`.
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
        if config.injection.prefilter > 1:
            values._add("prefilter_scale", config.injection.prefilter_scale)
        if config.voxelization.coverage == "analytic":
            values._add("thickness_voxels", config.voxelization.slots.thickness_voxels)
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
        injection = config.injection
        if "prefilter_scale" in self:
            injection = replace(injection, prefilter_scale=self._single("prefilter_scale"))
        return replace(
            config,
            injection=injection,
            voxelization=self.voxelization(config.voxelization),
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

    def voxelization(self, config: OpacityVoxelizationConfig) -> OpacityVoxelizationConfig:
        """Return how surfaces become opacity at these values."""
        if "thickness_voxels" not in self:
            return config
        slots = replace(config.slots, thickness_voxels=self._single("thickness_voxels"))
        return replace(config, slots=slots)
