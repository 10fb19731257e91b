"""How a cone marches, as data. Rules are chosen in Python: kernels hold only what is used."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from vctgi.clipmap.sampling import ReadRule, WeightRule
from vctgi.clipmap.texel_choice import Filtering

CorrectionRule = Literal["depth", "exponent", "linear", "none"]
"""What becomes of the opacity a of one voxel over a step of k voxels. "depth": exp(-k depth), depth
being -ln(1 - a) up to a cap and interpolated per length between levels; "exponent": 1 - (1 - a)^k;
"linear": min(1, k a); "none": a."""

ColorRule = Literal["opacity", "proportional"]
"""What becomes of its emittance. "opacity": what becomes of its opacity; "proportional": k times
as much, whatever the opacity."""

StepRule = Literal["footprint", "spheres"]
"""How long a step is. "footprint": a share of the footprint; "spheres": as far as spheres that fill
the cone touch."""


@dataclass(frozen=True, kw_only=True)
class ConeMarchConfig:
    """How a cone marches; the defaults are the recipe of docs/decisions/0001."""

    step_ratio: float = 0.5
    """Step length over footprint, (0, 1]."""
    min_step_voxels: float = 0.25
    """Shortest step, in voxels of the finest level that holds the sample, > 0."""
    start_offset_voxels: float = 1.0
    """Distance from the apex at which the first step begins, in voxels, >= 0."""
    level_bias: float = -1.0
    """Added to log2(footprint / finest voxel size)."""
    pull_back_voxels: float = 0.25
    """How far before the sample the voxels are read, because a ray meets a smeared wall early."""
    min_transmittance: float = 1e-4
    """A cone that lets less through has ended, [0, 1)."""
    read: ReadRule = "layered"
    """How opacity is interpolated: "layered" (docs/decisions/0001) or "trilinear", as alpha."""
    filtering: Filtering = "linear"
    """What a sample reads: "linear" interpolates between the texels around it and between two
    levels; "random_level" reads the level that a random number of the cone chooses, half as many
    texels; "random_texel" also one texel of each axis in place of eight. The same in the mean
    where a step stops little. Derivatives of "random_texel" are those of "random_level"."""
    weights: WeightRule = "projected"
    """How much each of the three slots counts that face a ray of direction d: "projected" |d|,
    "squared" d^2, or "normalised" |d| over its sum."""
    correction: CorrectionRule = "depth"
    """How opacity follows the length of the step."""
    color: ColorRule = "opacity"
    """How emittance follows it; "depth" knows only "opacity"."""
    correction_factor: float = 1.0
    """Factor on the step length that opacity and emittance are corrected by, > 0; "depth" is right
    with 1, and with another an exponent on what a step lets through, for fits."""
    step_rule: StepRule = "footprint"
    """How long a step is."""
    sample_place: float = 0.5
    """Where in a step the voxels are read, [0, 1]: 0 at its beginning, 1 at its end."""
    max_distance_voxels: float | None = None
    """Where a cone ends, in voxels of the finest level; None: where the clipmap does."""
    max_footprint_voxels: float | None = None
    """Footprint at which it ends, in voxels of the finest level; None: any."""
    falloff_length: float | None = None
    """If given, a voxel at distance t sends out exp(-t / falloff_length) in place of its light, so
    that a cone gathers how far what is near closes it off; world units, > 0, may be infinite."""

    def __post_init__(self) -> None:
        """Refuse a march that skips voxels or never ends, and rules that do not fit together."""
        if not 0.0 < self.step_ratio <= 1.0:
            raise ValueError(
                f"ConeMarchConfig.step_ratio must be in (0, 1], got {self.step_ratio}: "
                "a larger step skips voxels."
            )
        if not self.min_step_voxels > 0.0:
            raise ValueError(
                f"ConeMarchConfig.min_step_voxels must be > 0, got {self.min_step_voxels}: "
                "a thin cone would never end."
            )
        if self.start_offset_voxels < 0.0:
            raise ValueError(
                f"ConeMarchConfig.start_offset_voxels must be >= 0, got {self.start_offset_voxels}."
            )
        if not 0.0 <= self.min_transmittance < 1.0:
            raise ValueError(
                "ConeMarchConfig.min_transmittance must be in [0, 1), "
                f"got {self.min_transmittance}."
            )
        if not 0.0 <= self.sample_place <= 1.0:
            raise ValueError(
                f"ConeMarchConfig.sample_place must be in [0, 1], got {self.sample_place}."
            )
        for name in (
            "correction_factor",
            "max_distance_voxels",
            "max_footprint_voxels",
            "falloff_length",
        ):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise ValueError(f"ConeMarchConfig.{name} must be > 0, got {value}.")
        self._check_rules()

    def _check_rules(self) -> None:
        for name, known in (
            ("read", ReadRule),
            ("filtering", Filtering),
            ("weights", WeightRule),
            ("correction", CorrectionRule),
            ("color", ColorRule),
            ("step_rule", StepRule),
        ):
            value = getattr(self, name)
            if value not in get_args(known):
                raise ValueError(
                    f"ConeMarchConfig.{name} must be one of {get_args(known)}, got {value!r}."
                )
        if self.read == "layered" and self.correction != "depth":
            raise ValueError(
                f'ConeMarchConfig: read="layered" gives optical depth, which {self.correction!r} '
                'does not correct; use correction="depth" or read="trilinear".'
            )
        if self.correction == "depth" and self.color != "opacity":
            raise ValueError(
                'ConeMarchConfig: correction="depth" knows how a step emits; color is for the '
                "other corrections."
            )
