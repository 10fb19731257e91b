"""The continuous parameters of a frame's cones: made from a configuration, put back into one."""

from __future__ import annotations

from dataclasses import replace
from typing import Self, overload

import drjit as dr
import mitsuba as mi

from vctgi.config import RenderConfig
from vctgi.stages.cone_tracing.cone_values import ConeValues
from vctgi.stages.cone_tracing.diffuse_config import DiffuseConesConfig


class ConeParameters(ConeValues):
    """Parameters of cones by name, as Dr.Jit arrays (`ConeValues` says which)."""

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
        return replace(
            config,
            diffuse=self.to_diffuse(config.diffuse),
            specular=replace(
                config.specular, aperture_scale=self._single("specular_aperture_scale")
            ),
            ambient=ambient,
        )
