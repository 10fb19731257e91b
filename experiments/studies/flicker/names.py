"""What the rows of flicker are called, and the curve that they stand on."""

from __future__ import annotations

from experiments.studies.figures import Curve

OVER_SPARSITY = Curve(
    group="Change from frame to frame",
    title="Flicker by the number of camera rays for each that traces cones",
    caption="RMS change beyond the truth's along exact motion vectors, over the mean light. "
    '"noise" and "structure" are the parts of single frames: what another seed changes, and what '
    "none does; squared, they add up.",
    x_label="camera rays for each that traces cones",
    y_label="RMS flicker, share of the mean light",
    is_x_log=True,
)

SCENE = "built-in cornell_box, or --scene; diffuse light, 4 rays a pixel, 0.44 pixels a frame"


def name_of(sparsity: int) -> str:
    """Return what frames of a sparsity are called."""
    return "dense" if sparsity == 1 else f"every {sparsity}th ray"


def configuration(sparsity: int) -> str:
    """Return how they are rendered."""
    return f'preset "high" with N = 64, sparsity {sparsity}'
