"""All that a fit has to know of one frame: a few numbers, however large its picture is.

The error is a sum of squares, so its value, its gradient and the normal matrix J^T J say all that
Gauss-Newton reads off pictures and Jacobians. Evaluations can so be kept on disk as lines.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TypeVar

import numpy as np

from experiments.optimize.target import Array, Target
from vctgi.clipmap.texel_choice import Filtering

Number = TypeVar("Number", float, Array)

FILTERING_WORK: dict[Filtering, float] = {
    "linear": 1.0,
    "random_level": 0.53,
    "random_texel": 0.13,
}
"""Time of a sample over that of one that interpolates, from the kernels of "medium" in Sponza on an
NVIDIA H200 (docs/decisions/0022)."""

RAY_WORK = 10.0
"""Time of a near-field ray over that of such a sample: 0.71 ns and 70 ps of "high" there. It has no
units for rays; where a GPU has them, rays cost less, and equal work is less time."""


def work_of(samples: Number, rays: Number) -> Number:
    """Return samples and rays, or their derivatives, counted in samples that interpolate."""
    return samples + RAY_WORK * rays


@dataclass(frozen=True, kw_only=True)
class FrameCost:
    """What a frame's diffuse cones read, for each pixel."""

    samples: float
    """Samples of the voxels, counted in samples that interpolate (`FILTERING_WORK`)."""
    rays: float
    """Real rays of the near field."""

    @property
    def work(self) -> float:
        """Both, as `work_of`."""
        return work_of(self.samples, self.rays)


@dataclass(frozen=True, kw_only=True)
class FrameValues:
    """Numbers of one frame."""

    error: float
    """Debiased relative squared error of indirect diffuse light."""
    squares: float
    """The same without the constant that only the reference decides, >= 0."""
    dark_excess: float
    """Light where the reference is dark, over all its light."""
    missing_energy: float
    """Light that is missing, over all light of the reference."""
    samples: float
    """Samples of the voxels for each pixel, counted in samples that interpolate."""
    rays: float
    """Real rays of the near field for each pixel."""

    @property
    def work(self) -> float:
        """Both, as `work_of`."""
        return work_of(self.samples, self.rays)

    def to_json(self) -> dict[str, float]:
        """Return the numbers by name."""
        return asdict(self)


SLOPE_NAMES = ("dark_excess", "missing_energy", "work")
"""Numbers of a frame that limits are set on, and whose derivatives are kept."""


@dataclass(frozen=True, kw_only=True)
class FrameSlopes:
    """Derivatives of those numbers by the parameters, in their inner units.

    Attributes
    ----------
    values
        The numbers.
    gradient
        Of the error, [parameter].
    normal
        2 J^T J' with the derivatives J' of another frame, made symmetric, [parameter, parameter].
        Ripple of one frame is no curvature of the mean over places, and two frames do not share it;
        J^T J of one frame alone is 2.5 times too large for apertures in forward mode.
    reference_noise
        Covariance of the gradient that noise of the reference brings, [parameter, parameter].
    limited
        Derivatives of what has a limit, [parameter] each, by `SLOPE_NAMES`.
    """

    values: FrameValues
    gradient: Array
    normal: Array
    reference_noise: Array
    limited: dict[str, Array]

    def to_json(self) -> dict[str, object]:
        """Return what JSON can hold, exactly."""
        return {
            "values": self.values.to_json(),
            "gradient": self.gradient.tolist(),
            "normal": self.normal.tolist(),
            "reference_noise": self.reference_noise.tolist(),
            "limited": {name: each.tolist() for name, each in self.limited.items()},
        }


def slopes_from_json(row: dict[str, object]) -> FrameSlopes:
    """Return what `FrameSlopes.to_json` wrote."""
    limited, values = row["limited"], row["values"]
    assert isinstance(limited, dict)
    assert isinstance(values, dict)
    return FrameSlopes(
        values=FrameValues(**values),
        gradient=np.array(row["gradient"], dtype=np.float64),
        normal=np.array(row["normal"], dtype=np.float64),
        reference_noise=np.array(row["reference_noise"], dtype=np.float64),
        limited={name: np.array(each, dtype=np.float64) for name, each in limited.items()},
    )


def frame_values(target: Target, image: Array, cost: FrameCost) -> FrameValues:
    """Return the numbers of a picture [y, x, rgb]."""
    dark, missing = target.excess(image)
    return FrameValues(
        error=target.error(image),
        squares=target.squares(image),
        dark_excess=dark,
        missing_energy=missing,
        samples=cost.samples,
        rays=cost.rays,
    )


def frame_slopes(
    target: Target,
    picture: tuple[Array, FrameCost],
    columns: Array,
    other_columns: Array,
    cost_slopes: Array,
) -> FrameSlopes:
    """Return the numbers of a picture and their derivatives.

    Parameters
    ----------
    target
        Of the view.
    picture
        The frame's picture and cost, as for `frame_values`.
    columns, other_columns
        Derivatives of this frame's picture and of another's, [parameter, y, x, rgb].
    cost_slopes
        Derivatives of samples and rays for each pixel, [2, parameter].
    """
    image, cost = picture
    flat, other = (each.reshape(len(each), -1) for each in (columns, other_columns))
    products = (flat * target.weights.reshape(-1)) @ other.T
    scale = 2.0 / image.size
    pulls = scale * target.batch_pulls.reshape(len(target.batch_pulls), -1) @ flat.T
    dark, missing = target.excess_slopes(image, columns)
    return FrameSlopes(
        values=frame_values(target, image, cost),
        gradient=flat @ target.pull(image).reshape(-1),
        normal=0.5 * scale * (products + products.T),
        reference_noise=(pulls.T * target.batch_factors) @ pulls,
        limited={
            "dark_excess": dark,
            "missing_energy": missing,
            "work": work_of(cost_slopes[0], cost_slopes[1]),
        },
    )
