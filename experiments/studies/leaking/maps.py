"""Maps of leaks: where light came through, where it is of the wrong face, where it is missing."""

from __future__ import annotations

import numpy as np

from experiments.studies.figures import BRIGHTEST, FigureShelf
from metrics.leaking import LIT_SHARE, SIGMA_COUNT, LeakAudit, excess_map
from metrics.luminance import luminance

FAINT = 0.1
"""Brightest value of the maps of leaks, over that of the light gathered."""

UNIT = "W m⁻² sr⁻¹"


def add_audit_maps(shelf: FigureShelf, group: str, audit: LeakAudit) -> None:
    """Keep what was gathered, what of it came through or from a wrong face, and what is missing.

    The scale reaches to the brightest percent of the light gathered, of the parts to a tenth of it.
    """
    gathered = audit.gathered.mean(axis=0)
    through, wrong = audit.through.mean(axis=0), excess_map(audit, 1.0)
    brightest = float(np.quantile(gathered, BRIGHTEST))
    shelf.add_map(
        group,
        "Light gathered",
        gathered,
        high=brightest,
        unit=UNIT,
        caption="What the diffuse cones bring, E / pi, luminance.",
    )
    parts = {
        "Light from behind the true hit": (
            through,
            "Read where geometry lies between the point and the place (L2, through).",
        ),
        "Light of the wrong face": (
            wrong,
            "Read in sight, but brighter than what is seen there, times the picture's gain "
            "(L2, wrong face).",
        ),
        "Over-occlusion": (
            excess_map(audit, -1.0),
            "True light, times the picture's gain, that the cones do not bring.",
        ),
    }
    for title, (values, caption) in parts.items():
        shelf.add_map(group, title, values, high=FAINT * brightest, unit=UNIT, caption=caption)
    shelf.add_map(
        group,
        "Leaked share",
        (through + wrong) / np.maximum(gathered, 1e-12),
        high=1.0,
        unit="of the light gathered",
        caption="Both parts of the leak over the light gathered.",
    )


def add_excess_maps(shelf: FigureShelf, group: str, light: np.ndarray, batches: np.ndarray) -> None:
    """Keep both pictures [row, column, rgb] and L3's two maps, of batches [batch, ...]."""
    truth = batches.mean(axis=0)
    if truth.sum() > 0.0:
        shelf.add_picture(group, "Cones", light, like=truth, caption="Indirect diffuse light.")
        shelf.add_picture(
            group, "Path tracing", truth, like=truth, caption="The same light, path traced."
        )
    seen, bright = luminance(light), np.stack([luminance(each) for each in batches])
    mean, error = bright.mean(axis=0), bright.std(axis=0, ddof=1) / np.sqrt(len(bright))
    is_dark = mean < LIT_SHARE * mean.mean()
    high = FAINT * float(np.quantile(mean, BRIGHTEST))
    shelf.add_map(
        group,
        "Light where it should be dark",
        np.where(is_dark, np.maximum(seen - mean - SIGMA_COUNT * error, 0.0), 0.0),
        high=high,
        unit=UNIT,
        caption="More than path tracing plus three standard errors, where that has less than 5 % "
        "of the picture's mean (L3).",
    )
    shelf.add_map(
        group,
        "Missing light",
        np.maximum(mean - seen - SIGMA_COUNT * error, 0.0),
        high=high,
        unit=UNIT,
        caption="Less than path tracing minus three standard errors (L3's counterpart).",
    )
