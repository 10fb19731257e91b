"""What the numbers of the study "flicker" are."""

from __future__ import annotations

from metrics.flicker import FLICKER_FORMULA, FLICKER_RMS_FORMULA
from metrics.flicker_parts import NOISE_FORMULA, STRUCTURE_FORMULA
from reports.study_figures import Definition

DEFINITIONS = (
    Definition(
        name="mean change beyond the truth's",
        formula=FLICKER_FORMULA,
        source="metrics/flicker.py, flicker; intervals over batches of the reference",
    ),
    Definition(
        name="RMS change beyond the truth's",
        formula=FLICKER_RMS_FORMULA,
        source="metrics/flicker.py, flicker_rms; the noise of the reference is taken out",
    ),
    Definition(
        name="noise, RMS",
        formula=NOISE_FORMULA,
        source="metrics/flicker_parts.py, flicker_noise; intervals over seeds",
    ),
    Definition(
        name="structure, RMS",
        formula=STRUCTURE_FORMULA,
        source="metrics/flicker_parts.py, flicker_structure; intervals over seeds and batches",
    ),
    Definition(
        name="RMS change beyond dense pixels'",
        formula="sqrt(mean (dV - dD)^2) / mean D, D: dense pixels, both of cones never turned",
        source="experiments/studies/flicker/parts.py; neither noise nor reference",
    ),
    Definition(
        name="energy",
        formula="mean V / mean R over all frames",
        source="metrics/energy.py, energy_ratio",
    ),
    Definition(
        name="RMS change that accumulation leaves",
        formula="RMS change of accumulated frames / RMS change of single ones, without the truth",
        source="experiments/studies/flicker",
    ),
)
