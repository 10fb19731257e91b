"""A synthetic bench: one true picture, one biased render of it, noisy references, no renderer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from experiments.gate.baseline import Baseline
from experiments.gate.specification import GateSpec
from experiments.gate.update import baseline_from_record
from experiments.record import metric_value
from metrics.energy import energy_ratio
from metrics.squared_error import relmse_e2
from reports.record import (
    Display,
    ImageFile,
    Machine,
    MetricValue,
    NoiseFloor,
    Record,
    ReferenceInfo,
    SceneInfo,
    StageTime,
    write_image,
)

Pixels = NDArray[np.float64]

SIZE = 32
BATCH_COUNT = 8


@dataclass
class Bench:
    """Draws references of one true picture and measures records against them."""

    folder: Path
    batch_noise: float = 0.02
    """Relative noise of a pixel in one batch."""
    draw_count: int = 0
    truth: Pixels = field(init=False)
    render: Pixels = field(init=False)

    def __post_init__(self) -> None:
        y, x = np.mgrid[0:SIZE, 0:SIZE] / SIZE
        shade = 0.2 + 0.8 * np.exp(-3.0 * ((x - 0.4) ** 2 + (y - 0.6) ** 2))
        self.truth = shade[..., None] * np.array([0.9, 0.7, 0.5])
        # A tenth too dark with a pattern on it: the face of a biased method.
        pattern = 0.9 + 0.12 * np.sin(9.0 * x) * np.cos(7.0 * y)
        self.render = self.truth * pattern[..., None]

    def batches(self, seed: int) -> Pixels:
        """Independent noisy references, [batch, y, x, 3]."""
        rng = np.random.default_rng(seed)
        noise = rng.standard_normal((BATCH_COUNT, *self.truth.shape))
        return np.asarray(self.truth * (1.0 + self.batch_noise * noise))

    def record(
        self,
        *,
        seed: int = 1,
        render: Pixels | None = None,
        method: str = "vctgi",
        extra: Sequence[MetricValue] = (),
    ) -> tuple[Record, Path]:
        """Measure a render against references of a seed, with pictures beside the record."""
        picture = self.render if render is None else render
        batches = self.batches(seed)
        measured = [
            metric_value(energy_ratio(picture, batches, component="indirect")),
            metric_value(relmse_e2(picture, batches, component="indirect")),
        ]
        self.draw_count += 1
        record_id = f"bench-{self.draw_count:05d}"
        images = self._images(record_id, picture, batches.mean(axis=0))
        record = Record(
            record_id=record_id,
            created="2026-01-31T12:00:00+00:00",
            command="vctgi render bench",
            scene=SceneInfo(
                name="bench",
                title="Bench",
                source="synthetic",
                purpose="gate tests",
                digest="digest-of-bench",
                triangle_count=12,
                emitters={"area": 1},
                bsdfs={"diffuse": 3},
                bounds_min=(0.0, 0.0, 0.0),
                bounds_max=(1.0, 1.0, 1.0),
                contributions=[],
                unsupported=[],
            ),
            method=method,
            preset="medium",
            config={"step_ratio": 0.5, "levels": 4},
            plan=[],
            seed=0,
            width=SIZE,
            height=SIZE,
            reference=ReferenceInfo(
                key=f"key-{seed}",
                samples_per_pixel=512,
                batch_count=BATCH_COUNT,
                scattering_count=2,
                seed=seed,
                seconds=1.0,
                from_cache=False,
                noise_relmse=1e-4,
                noise_floors={"indirect": NoiseFloor(value=5e-5, upper=6e-5)},
                truncated_share=0.01,
            ),
            metrics=[*measured, *extra],
            times=[
                StageTime(stage="trace", median_ms=10.0, low_ms=9.5, high_ms=10.8, count=7),
            ],
            images=images,
            machine=Machine(
                backend="llvm_ad_rgb",
                device="cpu",
                processor="bench processor",
                core_count=2,
                memory_gib=8.0,
                system="Linux",
                python="3.11.2",
                versions={"mitsuba": "3.9.1", "drjit": "1.5.0"},
                commit="0" * 40,
                is_dirty=False,
            ),
            display=Display(
                nits_per_unit=100.0,
                exposure=0.0,
                flip_start_exposure=-1.0,
                flip_stop_exposure=2.0,
                flip_exposure_count=3,
                flip_pixels_per_degree=67.0,
            ),
            warnings=[],
        )
        return record, self.folder / f"{record_id}.json"

    def gate(self, *metrics: dict[str, object], **changes: object) -> GateSpec:
        """Build a gate for the bench; the default holds energy and relMSE as a project would."""
        chosen = metrics or (ENERGY, RELMSE, ENERGY_BOUNDS, RELMSE_CAP)
        settings: dict[str, object] = {
            "name": "bench",
            "scene": "bench",
            "preset": "medium",
            "width": SIZE,
            "height": SIZE,
            "reference_spp": 512,
            "metric": list(chosen),
        }
        return GateSpec.model_validate({**settings, **changes})

    def baseline(self, gate: GateSpec, record: Record | None = None) -> Baseline:
        """Make a baseline, from a reference of another seed than records have by default."""
        source = self.record(seed=2)[0] if record is None else record
        return baseline_from_record(gate, source, "bench")

    def _images(self, record_id: str, picture: Pixels, reference: Pixels) -> dict[str, ImageFile]:
        pictures = {"image": picture, "reference": reference, "error": picture - reference}
        return {
            name: write_image(self.folder / record_id / f"{name}.exr", pixels, name)
            for name, pixels in pictures.items()
        }


ENERGY: dict[str, object] = {
    "kind": "noninferior",
    "metric": "energy_ratio",
    "component": "indirect",
    "scale": "ratio",
    "rel": 0.02,
}
RELMSE: dict[str, object] = {
    "kind": "noninferior",
    "metric": "relmse_e2",
    "component": "indirect",
    "rel": 0.05,
}
ENERGY_BOUNDS: dict[str, object] = {
    "kind": "absolute",
    "metric": "energy_ratio",
    "component": "indirect",
    "scale": "ratio",
    "low": 0.8,
    "high": 1.0,
}
RELMSE_CAP: dict[str, object] = {
    "kind": "absolute",
    "metric": "relmse_e2",
    "component": "indirect",
    "cap": 0.025,
}


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    """Hand out a bench whose records live in the test's own folder."""
    return Bench(tmp_path / "records")
