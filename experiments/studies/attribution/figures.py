"""The waterfall of a ledger, and what its numbers are."""

from __future__ import annotations

from experiments.studies.figures import FigureShelf
from metrics.attribution import Attribution
from metrics.confidence import Estimate
from reports.study_figures import (
    Bounded,
    Definition,
    WaterfallFigure,
    WaterfallPanel,
    WaterfallStage,
)

METRICS = "metrics/attribution.py, attribute_error"

DEFINITIONS = (
    Definition(
        name="energy error",
        formula="mean V / mean R - 1; V the renderer, R path tracing of as many scatterings, "
        "indirect diffuse light",
        source=f"{METRICS}; intervals over independent renderings of both",
    ),
    Definition(
        name="relmse error",
        formula="mean of (V - R)^2 / (R^2 + 0.01 (mean R)^2), of pairs of different renderings, in "
        "which neither noise has a bias",
        source=f"{METRICS}; metrics/squared_error.py",
    ),
    Definition(
        name="owned by a stage, forward and backward",
        formula="by how much the error falls when the stage is made exact after all before it, or "
        "after all behind it",
        source=METRICS,
    ),
    Definition(
        name="interaction",
        formula="forward - backward: 0 where a stage owns the same whatever else is exact; what no "
        "order shares out is half the sum of all |interactions|",
        source=METRICS,
    ),
    Definition(
        name="left over, standard errors",
        formula="|error with all stages exact| / its standard error: the ledger closes where this "
        "is that of noise",
        source="experiments/studies/attribution",
    ),
)


def add_waterfall(shelf: FigureShelf, title: str, energy: Attribution, relmse: Attribution) -> None:
    """Keep the waterfall of both errors of a scene."""
    shelf.add(
        WaterfallFigure(
            group=title,
            title="What is left of the error after each stage",
            caption="Blue: stages are made exact from the top down; orange: from the bottom up. "
            "Lines are 95 % intervals of each stage's share.",
            panels=[
                _panel(energy, "energy error, mean V / mean R \N{MINUS SIGN} 1"),
                _panel(relmse, "relMSE"),
            ],
        )
    )


def _panel(found: Attribution, label: str) -> WaterfallPanel:
    return WaterfallPanel(
        label=label,
        start=_bounded(found.start),
        noise=_bounded(found.noise),
        stages=[
            WaterfallStage(
                name=stage.name,
                forward=_bounded(stage.forward),
                backward=_bounded(stage.backward),
                interaction=_bounded(stage.interaction),
            )
            for stage in found.stages
        ],
        end=_bounded(found.end),
        interaction=found.interaction,
    )


def _bounded(estimate: Estimate) -> Bounded:
    return Bounded(value=estimate.value, low=estimate.low, high=estimate.high)
