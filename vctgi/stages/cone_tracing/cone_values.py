"""The continuous parameters of cones as arrays, by name: what an optimiser moves.

A frame of numbers in a configuration bakes them into its kernels. Here they are opaque arrays, so
that another value needs no other kernel, and so that derivatives can be taken with respect to them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.stages.cone_tracing.diffuse_config import DiffuseConesConfig
from vctgi.stages.cone_tracing.live_march import LiveMarch
from vctgi.stages.cone_tracing.march_config import ConeMarchConfig

MARCH_NAMES = {
    "step_ratio": "step_ratio",
    "min_step_voxels": "min_step_voxels",
    "start_offset_voxels": "start_offset_voxels",
    "level_bias": "level_bias",
    "pull_back_voxels": "pull_back_voxels",
    "opacity_exponent": "correction_factor",
}
"""Parameters of the march of diffuse cones, and what `ConeMarchConfig` calls them. One lane each,
or one a cone."""

WIDEST = math.pi - 1e-6
"""Full apex angle, radians, behind which half the angle has no tangent in single precision."""

BOUNDS = {
    "apertures": (0.0, True, WIDEST),
    "aperture_scale": (0.0, False, math.inf),
    "weights": (0.0, False, math.inf),
    "elevations": (0.0, True, 0.5 * math.pi),
    "step_ratio": (0.0, False, math.inf),
    "min_step_voxels": (0.0, False, math.inf),
    "start_offset_voxels": (0.0, True, math.inf),
    "opacity_exponent": (0.0, False, math.inf),
    "specular_aperture_scale": (0.0, False, math.inf),
    "ambient_range_scale": (0.0, False, math.inf),
    "sparse_normal_angle": (0.0, False, math.pi + 1e-6),
    "sparse_plane_slope": (0.0, False, math.inf),
    "sparse_depth_ratio": (0.0, False, math.inf),
    "prefilter_scale": (0.0, False, math.inf),
    "thickness_voxels": (0.0, True, 2.0 + 1e-6),
}
"""Lower end, whether it belongs to the interval, and upper end, which does not."""

CONE_NAMES = ("apertures", "weights", "elevations", "azimuths")
"""Parameters of which there is one a cone."""

SCALE_NAMES = ("aperture_scale", "specular_aperture_scale", "ambient_range_scale")
"""Parameters of one lane."""


class ConeValues(Mapping[str, "mi.Float"]):
    """Parameters of cones by name; assigning to a name replaces its values.

    `apertures`
        Full apex angle of each diffuse cone before the scale, radians, [0, pi).
    `aperture_scale`
        Factor on all of them.
    `weights`
        How much each diffuse cone counts, > 0; they are divided by their sum.
    `elevations`
        Angle of each diffuse cone's axis to the normal, radians, [0, pi / 2).
    `azimuths`
        Angle of each diffuse cone's axis around the normal, radians, before they are all turned.
    `step_ratio`, `min_step_voxels`, `start_offset_voxels`, `level_bias`, `pull_back_voxels`
        March of diffuse cones, as in `ConeMarchConfig`.
    `opacity_exponent`
        Exponent on what a step of a diffuse cone lets through, > 0.
    `specular_aperture_scale`
        Factor on the apertures of specular lobes, > 0.
    `ambient_range_scale`
        Factor on the range of ambient occlusion, > 0.

    Cones that light voxels for further bounces (`RenderConfig.bounce_cones`) have none of these.

    Parameters
    ----------
    diffuse
        Cones whose numbers the values start from.

    Raises
    ------
    ValueError
        The cones belong to the world instead of the surface.
    """

    def __init__(self, diffuse: DiffuseConesConfig) -> None:
        cones = diffuse.cones()
        if cones.frame == "world":
            raise ValueError(
                f"ConeValues: the cones of '{diffuse.cone_set}' belong to the world; parameters "
                "are those of cones around a surface's normal. Use a set of that kind."
            )
        self.cone_count = cones.cone_count
        self._values: dict[str, mi.Float] = {
            "apertures": _opaque([a / diffuse.aperture_scale for a in cones.apertures]),
            "weights": _opaque(cones.weights),
            "elevations": _opaque([math.acos(min(1.0, z)) for _, _, z in cones.directions]),
            "azimuths": _opaque([math.atan2(y, x) for x, y, _ in cones.directions]),
            "aperture_scale": _opaque([diffuse.aperture_scale]),
            "specular_aperture_scale": _opaque([1.0]),
            "ambient_range_scale": _opaque([1.0]),
        }
        for name, held in MARCH_NAMES.items():
            self._values[name] = _opaque([getattr(diffuse.march, held)])

    def __getitem__(self, name: str) -> mi.Float:
        """Return the values of a parameter."""
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        """Go through the names."""
        return iter(self._values)

    def __len__(self) -> int:
        """Count the names."""
        return len(self._values)

    def __setitem__(self, name: str, value: mi.Float) -> None:
        """Replace the values of a parameter.

        Raises
        ------
        ValueError
            There is no such parameter, or it has another number of values.
        """
        if name not in self._values:
            raise ValueError(f"no parameter '{name}'; there are {', '.join(self._values)}.")
        value = mi.Float(value)
        allowed = {self.cone_count} if name in CONE_NAMES else {1}
        if name in MARCH_NAMES:
            allowed = {1, self.cone_count}
        if dr.width(value) not in allowed:
            counts = " or ".join(str(each) for each in sorted(allowed))
            raise ValueError(f"parameter '{name}' takes {counts} values, got {dr.width(value)}.")
        self._values[name] = value

    def of_cone(self, name: str, cone: mi.UInt32) -> mi.Float:
        """Return a parameter's value for each lane, whose cone is given."""
        value = self._values[name]
        index = cone if dr.width(value) > 1 else cone * 0
        return dr.gather(mi.Float, value, index)

    def normalised_weights(self) -> mi.Float:
        """Return the share of each cone; they sum to 1."""
        return mi.Float(self._values["weights"] / dr.sum(self._values["weights"]))

    def local_axis(self, cone: mi.UInt32) -> mi.Vector3f:
        """Return unit axes around +z."""
        sine, cosine = dr.sincos(self.of_cone("elevations", cone))
        sin_turn, cos_turn = dr.sincos(self.of_cone("azimuths", cone))
        return mi.Vector3f(sine * cos_turn, sine * sin_turn, cosine)

    def lane_apertures(self, cone: mi.UInt32) -> mi.Float:
        """Return the full apex angle of each lane's cone, radians."""
        scale = self.of_cone("aperture_scale", cone)
        return mi.Float(self.of_cone("apertures", cone) * scale)

    def march(self, rules: ConeMarchConfig, cone: mi.UInt32) -> LiveMarch:
        """Return the march of each lane's diffuse cone."""
        values = {held: self.of_cone(name, cone) for name, held in MARCH_NAMES.items()}
        return LiveMarch(rules, falloff_length=None, **values)

    def to_diffuse(self, config: DiffuseConesConfig) -> DiffuseConesConfig:
        """Return a configuration of these cones.

        Raises
        ------
        ValueError
            It cannot hold the values: the march differs from cone to cone, or they are out of
            bounds.
        """
        numbers: dict[str, Any] = {held: self._single(name) for name, held in MARCH_NAMES.items()}
        return replace(
            config,
            cone_count=self.cone_count,
            aperture_scale=self._single("aperture_scale"),
            cone_apertures=self._tuple("apertures"),
            cone_weights=tuple(float(v) for v in self.normalised_weights()),
            cone_elevations=self._tuple("elevations"),
            cone_azimuths=self._tuple("azimuths"),
            march=replace(config.march, **numbers),
        )

    def check_bounds(self) -> None:
        """Refuse values at which cones are none, or never end.

        Raises
        ------
        ValueError
            A value is out of the bounds that the class states, or not finite.
        """
        for name, held in self._values.items():
            values = np.array(dr.detach(held), dtype=np.float64)
            if not np.isfinite(values).all():
                raise ValueError(f"parameter '{name}' must be finite, got {values.tolist()}.")
            low, includes_low, high = BOUNDS.get(name, (-math.inf, False, math.inf))
            is_good = (values > low) | ((values == low) & includes_low)
            if not (is_good & (values < high)).all():
                interval = f"{'[' if includes_low else '('}{low:g}, {high:g})"
                raise ValueError(
                    f"parameter '{name}' must be in {interval}, got {values.tolist()}; "
                    "bound what an optimiser may do."
                )
        widest = float(np.max(np.array(dr.detach(self._values["apertures"]), dtype=np.float64)))
        widest *= float(self._values["aperture_scale"][0])
        if not widest < WIDEST:
            raise ValueError(
                f"parameters 'apertures' and 'aperture_scale' make a cone of {widest:g} radians, "
                f"and none can be wider than {WIDEST:g}; bound what an optimiser may do."
            )

    def _add(self, name: str, number: float) -> None:
        """Add a parameter of one value."""
        self._values[name] = _opaque([number])

    def _tuple(self, name: str) -> tuple[float, ...]:
        return tuple(float(each) for each in dr.detach(self._values[name]))

    def _single(self, name: str) -> float:
        """Return the one value of a parameter."""
        values = self._tuple(name)
        if any(each != values[0] for each in values):
            raise ValueError(
                f"parameter '{name}' differs from cone to cone, and a configuration holds one "
                "number for all: give it one value."
            )
        return values[0]


def _opaque(numbers: object) -> mi.Float:
    """Return numbers as an array that no kernel bakes in."""
    value = mi.Float(list(numbers))  # type: ignore[call-overload]
    dr.make_opaque(value)
    return value
