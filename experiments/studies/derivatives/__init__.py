"""Study "derivatives": whether derivatives of a picture are right, and what they cost.

Each parameter is moved by shares of itself, and the mean picture followed. Both modes are compared
to central differences of a relative step of 0.0001, and reverse mode to those of 0.01, over which
the picture has many kinks: wherever a sample passes from one voxel to the next.
"""

from __future__ import annotations

from experiments.studies.check import Check
from experiments.studies.derivatives import agreement, cost, placed, prb, stable
from reports.study_figures import Definition

SCENE = "Cornell box with a rough metal ball, 96 x 96 pixels, in the quick version 48 x 48"


DEFINITIONS = (
    Definition(
        name="off differences",
        formula="|AD - D| / max(|D|, 0.02 mean): of the mean picture, by the share by which the "
        "values become larger, each by another; D the central difference; mean over seeds",
        source="experiments/studies/derivatives/measure.py; worst of three points",
    ),
    Definition(
        name="cosine with prb's",
        formula="mean <v_i, r_j> / sqrt(<v_1, v_2> <r_1, r_2>); v derivatives by cones, r by prb, "
        "of a share of the parameter, two independent pictures each",
        source="experiments/studies/derivatives/prb.py",
    ),
    Definition(
        name="squared difference from prb's, over its square",
        formula="<v_1 - r_1, v_2 - r_2> / <r_1, r_2>",
        source="experiments/studies/derivatives/prb.py",
    ),
)


def checks() -> list[Check]:
    """Return the checks of derivatives."""
    return [
        *agreement.checks(SCENE),
        *stable.checks(),
        *placed.checks(),
        *prb.checks(SCENE),
        *cost.checks(SCENE),
    ]
