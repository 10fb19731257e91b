"""A march whose numbers are arrays: the same rules, at values that can have derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.sampling import ReadRule, WeightRule
from vctgi.clipmap.texel_choice import Filtering
from vctgi.stages.cone_tracing.march_config import (
    ColorRule,
    ConeMarchConfig,
    CorrectionRule,
    StepRule,
)


@dataclass
class LiveMarch:
    """A `ConeMarchConfig` with arrays, one value a lane or one for all, in place of its numbers.

    Attributes
    ----------
    rules
        Everything that is chosen in Python.
    step_ratio, min_step_voxels, start_offset_voxels, level_bias, pull_back_voxels
        As there.
    correction_factor
        As there: factor on the optical depth of a step.
    falloff_length
        As there; None where light is gathered.
    """

    rules: ConeMarchConfig
    step_ratio: mi.Float
    min_step_voxels: mi.Float
    start_offset_voxels: mi.Float
    level_bias: mi.Float
    pull_back_voxels: mi.Float
    correction_factor: mi.Float
    falloff_length: mi.Float | None = None

    @classmethod
    def of_numbers(cls, rules: ConeMarchConfig, falloff_length: mi.Float | None) -> LiveMarch:
        """Return the march of a configuration at its own numbers, but for the falloff."""
        return cls(
            rules,
            step_ratio=dr.opaque(mi.Float, rules.step_ratio),
            min_step_voxels=dr.opaque(mi.Float, rules.min_step_voxels),
            start_offset_voxels=dr.opaque(mi.Float, rules.start_offset_voxels),
            level_bias=dr.opaque(mi.Float, rules.level_bias),
            pull_back_voxels=dr.opaque(mi.Float, rules.pull_back_voxels),
            correction_factor=dr.opaque(mi.Float, rules.correction_factor),
            falloff_length=falloff_length,
        )

    @property
    def min_transmittance(self) -> float:
        """As the rules say."""
        return self.rules.min_transmittance

    @property
    def read(self) -> ReadRule:
        """As the rules say."""
        return self.rules.read

    @property
    def filtering(self) -> Filtering:
        """As the rules say."""
        return self.rules.filtering

    @property
    def weights(self) -> WeightRule:
        """As the rules say."""
        return self.rules.weights

    @property
    def correction(self) -> CorrectionRule:
        """As the rules say."""
        return self.rules.correction

    @property
    def color(self) -> ColorRule:
        """As the rules say."""
        return self.rules.color

    @property
    def step_rule(self) -> StepRule:
        """As the rules say."""
        return self.rules.step_rule

    @property
    def sample_place(self) -> float:
        """As the rules say."""
        return self.rules.sample_place

    @property
    def max_distance_voxels(self) -> float | None:
        """As the rules say."""
        return self.rules.max_distance_voxels

    @property
    def max_footprint_voxels(self) -> float | None:
        """As the rules say."""
        return self.rules.max_footprint_voxels


AnyMarch: TypeAlias = ConeMarchConfig | LiveMarch
"""A march of numbers or of arrays."""
