"""What is asked of the path tracer and what comes back: `ReferenceRequest` and `Reference`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

COMPONENT_NAMES: Final = ("emission", "direct", "indirect_diffuse", "indirect_specular", "rest")
"""What is rendered, in scatterings: 0, 1, 2..k (twice: by the lobe of the first hit), above k."""

DERIVED_NAMES: Final[dict[str, tuple[str, ...]]] = {
    "indirect": ("indirect_diffuse", "indirect_specular"),
    "image": ("emission", "direct", "indirect_diffuse", "indirect_specular"),
}
"""Sums of components, formed batch by batch so that their variance knows what is correlated."""

LOBES: Final = ("diffuse", "specular")
"""Lobes of the first hit."""

LEAST_BATCH_COUNT: Final = 2
"""A variance needs two batches."""


@dataclass(frozen=True, kw_only=True)
class ReferenceRequest:
    """How much path tracing is asked for; all of it is part of the reference's key."""

    samples_per_pixel: int
    """Paths through a pixel over all batches; a multiple of `batch_count`."""
    batch_count: int = 8
    """Batches with independent seeds, at least 2; their spread gives the variance."""
    scattering_count: int = 2
    """k: `indirect_*` holds 2..k surface scatterings, `rest` holds more; at least 1."""
    seed: int = 0
    """Start of every random number, >= 0."""
    rest_samples_per_pixel: int | None = None
    """Paths for `rest` over all batches, a multiple of `batch_count`; None is a quarter of
    `samples_per_pixel` rounded up to such a multiple, 0 leaves `rest` out."""
    is_split_by_count: bool = False
    """Whether indirect light is held for each number of scatterings on its own and `rest` by lobe:
    `indirect_diffuse_2`, .. `indirect_diffuse_k`, `rest_diffuse`, the same for `specular`."""

    def __post_init__(self) -> None:
        self._check_at_least("batch_count", self.batch_count, LEAST_BATCH_COUNT)
        self._check_at_least("scattering_count", self.scattering_count, 1)
        self._check_at_least("seed", self.seed, 0)
        self._check_at_least("samples_per_pixel", self.samples_per_pixel, self.batch_count)
        self._check_multiple("samples_per_pixel", self.samples_per_pixel)
        if self.rest_samples_per_pixel is not None:
            self._check_at_least("rest_samples_per_pixel", self.rest_samples_per_pixel, 0)
            self._check_multiple("rest_samples_per_pixel", self.rest_samples_per_pixel)

    def _check_at_least(self, name: str, value: int, least: int) -> None:
        if value < least:
            raise ValueError(f"ReferenceRequest.{name} must be at least {least}, got {value}.")

    def _check_multiple(self, name: str, value: int) -> None:
        if value % self.batch_count:
            remedy = value + self.batch_count - value % self.batch_count
            raise ValueError(
                f"ReferenceRequest.{name} must be a multiple of batch_count = "
                f"{self.batch_count}, got {value}: ask for {remedy}."
            )

    @property
    def batch_samples_per_pixel(self) -> int:
        """Paths through a pixel in one batch."""
        return self.samples_per_pixel // self.batch_count

    @property
    def rest_batch_samples_per_pixel(self) -> int:
        """Paths for `rest` through a pixel in one batch."""
        if self.rest_samples_per_pixel is None:
            return -(-self.samples_per_pixel // (4 * self.batch_count))
        return self.rest_samples_per_pixel // self.batch_count

    def component_names(self) -> list[str]:
        """List what is rendered for this request, in the order of the scatterings."""
        has_rest = self.rest_batch_samples_per_pixel > 0
        if not self.is_split_by_count:
            return [name for name in COMPONENT_NAMES if name != "rest" or has_rest]
        counts = range(2, self.scattering_count + 1)
        names = ["emission", "direct"]
        names += [f"indirect_{lobe}_{count}" for count in counts for lobe in LOBES]
        return names + [f"rest_{lobe}" for lobe in LOBES if has_rest]


@dataclass(kw_only=True)
class Reference:
    """Path-traced components of one view, as batches with independent seeds."""

    components: dict[str, np.ndarray]
    """By `ReferenceRequest.component_names`: float32 `[batch, y, x, rgb]`, W m^-2 sr^-1; `rest` is
    missing if the request left it out."""
    key: str
    """SHA-256 of all that determines the numbers, 64 hexadecimal digits."""
    request: ReferenceRequest
    seconds: float
    """Wall time that the rendering took, whenever it was done; reading the cache costs nothing."""
    from_cache: bool
    """Whether every batch was read from disk."""
    notes: list[str]
    """What a reader of the numbers should know: components left out as exactly zero, BSDFs
    without an exact lobe split, conventions of the scene that were overridden."""

    def batches(self, name: str) -> np.ndarray:
        """Batches of a component or of a sum of some: `[batch, y, x, rgb]`.

        Sums are those of `DERIVED_NAMES`; and, of a reference that is split by count,
        `indirect_diffuse`, `indirect_specular`, `rest`, and both lobes of j scatterings
        `indirect_j`. They are formed batch by batch, so that their variance knows what is
        correlated.

        Raises
        ------
        ValueError
            If the reference does not hold that component.
        """
        parts = self._parts(name)
        if parts == [name]:
            return self.components[name]
        total = np.zeros(next(iter(self.components.values())).shape, np.float64)
        for part in parts:
            total += self.components[part]
        return total.astype(np.float32)

    def _parts(self, name: str) -> list[str]:
        """List the components that a name stands for."""
        if name in self.components:
            return [name]
        if name in DERIVED_NAMES:
            return [part for each in DERIVED_NAMES[name] for part in self._parts(each)]
        if self.request.is_split_by_count:
            stem, _, last = name.rpartition("_")
            is_one_count = stem == "indirect" and last.isdecimal()
            parts = [
                part
                for part in self.components
                if (is_one_count and part.startswith("indirect_") and part.endswith(f"_{last}"))
                or part.startswith(f"{name}_")
            ]
            # With one scattering there is no indirect light: a sum of no parts
            is_empty_sum = self.request.scattering_count == 1 and name in DERIVED_NAMES["indirect"]
            if parts or is_empty_sum:
                return parts
        known = [*self.components, *DERIVED_NAMES]
        raise ValueError(
            f"Reference.batches: no component named {name!r}, this one holds {known}; "
            "`rest` needs ReferenceRequest.rest_samples_per_pixel > 0, light of exactly j "
            "scatterings needs is_split_by_count."
        )

    def mean(self, name: str) -> np.ndarray:
        """Mean over the batches: float64 `[y, x, rgb]`, W m^-2 sr^-1."""
        return np.asarray(self.batches(name).mean(axis=0, dtype=np.float64))

    def variance_of_mean(self, name: str) -> np.ndarray:
        """Unbiased variance of `mean`: float64 `[y, x, rgb]`, squared units of radiance.

        The spread of the M batches over M; its own relative error is sqrt(2 / (M - 1)).
        """
        batches = self.batches(name)
        variance: np.ndarray = batches.var(axis=0, ddof=1, dtype=np.float64) / len(batches)
        return variance
