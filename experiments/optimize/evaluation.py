"""Evaluations of frames, kept on disk when done and found again by what they depend on."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

import metrics
from experiments.optimize.frames import FrameSource, point_config
from experiments.optimize.intervals import LEVEL
from experiments.optimize.ledger import EvaluationLedger
from experiments.optimize.parameters import Parameter
from experiments.optimize.statistics import (
    FrameSlopes,
    FrameValues,
    frame_slopes,
    frame_values,
    slopes_from_json,
)
from experiments.optimize.target import Array
from experiments.optimize.views import COMPONENT, View
from vctgi.config import RenderConfig

SOURCE_FOLDER = Path(__file__).resolve().parents[2]
"""Where the packages lie."""

COUNTED_PACKAGES = ("vctgi", "reference", "experiments/optimize")
"""Packages whose sources decide a fit's numbers."""


class FrameEvaluator:
    """Numbers of frames of several views, for `Fit`.

    Parameters
    ----------
    views
        What is rendered.
    frame_count
        Frames of each.
    base
        Configuration that the parameters change.
    parameters
        What a point's numbers are.
    source
        Renders.
    ledger
        Keeps what is found.
    first_frame
        Number of the first frame: held-out views have places in the lattice of their own.
    tell
        Called before each evaluation with the title of its view.
    """

    def __init__(
        self,
        views: Sequence[View],
        frame_count: int,
        base: RenderConfig,
        parameters: Sequence[Parameter],
        source: FrameSource,
        ledger: EvaluationLedger,
        *,
        first_frame: int = 0,
        tell: Callable[[str], None] = lambda _title: None,
    ) -> None:
        self._views = views
        self._frame_count = frame_count
        self._base = base
        self._parameters = parameters
        self._source = source
        self._ledger = ledger
        self._first_frame = first_frame
        self._tell = tell
        self._held: dict[tuple[int, int, RenderConfig], tuple[Array, Array]] = {}

    @property
    def scene_count(self) -> int:
        """Views."""
        return len(self._views)

    @property
    def frame_count(self) -> int:
        """Frames of each view."""
        return self._frame_count

    def values(self, scene: int, frame: int, point: Array) -> FrameValues:
        """Return a frame's numbers."""
        return self.values_of(scene, frame, point_config(self._base, self._parameters, point))

    def values_of(self, scene: int, frame: int, config: RenderConfig) -> FrameValues:
        """Return a frame's numbers for any configuration."""
        view = self._views[scene]
        number = self._first_frame + frame
        parts = ("values", *self._parts(view, number, config))
        row = self._ledger.find(*parts)
        if row is None:
            self._tell(view.name.title)
            picture = self._source.picture(view, number, config)
            row = frame_values(view.target, picture.image, picture.cost).to_json()
            self._ledger.add(row, *parts)
        return FrameValues(**row)

    def slopes(self, scene: int, frame: int, point: Array) -> FrameSlopes:
        """Return a frame's numbers and their derivatives."""
        view = self._views[scene]
        config = point_config(self._base, self._parameters, point)
        names = ",".join(each.name for each in self._parameters)
        number = self._first_frame + frame
        kind = self._source.derivatives
        parts = ("slopes", kind, names, str(self._frame_count), *self._parts(view, number, config))
        row = self._ledger.find(*parts)
        if row is None:
            self._tell(f"{view.name.title}, derivatives")
            picture = self._source.picture(view, number, config)
            columns, costs = self._columns(scene, frame, config)
            other, _ = self._columns(scene, (frame + 1) % self._frame_count, config)
            found = frame_slopes(view.target, (picture.image, picture.cost), columns, other, costs)
            row = found.to_json()
            self._ledger.add(row, *parts)
        return slopes_from_json(row)

    def measured(self, scene: int, frame: int, config: RenderConfig) -> metrics.Estimate:
        """Return a frame's `metrics.relmse_e2`, whose interval is the noise of the reference."""
        view = self._views[scene]
        number = self._first_frame + frame
        parts = ("measured", *self._parts(view, number, config))
        row = self._ledger.find(*parts)
        if row is None:
            self._tell(f"{view.name.title}, at the end")
            image = self._source.picture(view, number, config).image
            found = metrics.relmse_e2(image, view.batches, component=COMPONENT)
            row = {"value": found.value, "low": found.low, "high": found.high}
            self._ledger.add(row, *parts)
        return metrics.Estimate(**row, level=LEVEL)

    def _columns(self, scene: int, frame: int, config: RenderConfig) -> tuple[Array, Array]:
        """Return derivatives of a frame, kept while the other frames of its view ask for them."""
        key = (scene, frame, config)
        if key not in self._held:
            # Only the last view at the last point is asked for again.
            self._held = {
                known: each for known, each in self._held.items() if known[::2] == key[::2]
            }
            self._held[key] = self._source.columns(
                self._views[scene], self._first_frame + frame, config, self._parameters
            )
        return self._held[key]

    def _parts(self, view: View, number: int, config: RenderConfig) -> tuple[str, ...]:
        """Return what a frame depends on."""
        return (view.key, view.name.title, str(number), str(self._source.seed), repr(config))


def code_circumstances(variant: str) -> str:
    """Return a word for the sources and versions that a fit's numbers come from."""
    digest = hashlib.sha256(variant.encode())
    for package in COUNTED_PACKAGES:
        for path in sorted((SOURCE_FOLDER / package).rglob("*.py")):
            digest.update(str(path.relative_to(SOURCE_FOLDER)).encode())
            digest.update(path.read_bytes())
    for package in ("mitsuba", "drjit", "numpy", "scipy"):
        digest.update(version(package).encode())
    return digest.hexdigest()
