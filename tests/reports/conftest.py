"""Synthetic records: plausible pictures made with NumPy, no renderer."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pytest
from numpy.typing import NDArray

from reports.record import (
    Display,
    ImageFile,
    Interval,
    Machine,
    MetricValue,
    PlanEntry,
    Record,
    ReferenceInfo,
    SceneInfo,
    StageTime,
    write_image,
    write_record,
)

Floats = NDArray[np.float32]

AWKWARD = "rooms <b>& \"doors\"</b> 'x' {{ 7*7 }} </script>"
"""A name that breaks every page that does not escape it."""


class WriteRecord(Protocol):
    """Writes a synthetic record; keyword arguments replace fields of `Record`."""

    def __call__(
        self,
        *,
        record_id: str = ...,
        name: str = ...,
        drop_images: tuple[str, ...] = ...,
        width: int = ...,
        height: int = ...,
        **changes: Any,
    ) -> Path:
        """Return the path of the record."""


def synthetic_pictures(width: int, height: int) -> dict[str, Floats]:
    """Two versions of a box-like room with a ball and a lamp of radiance 15."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    x, y = (x + 0.5) / width * 2 - 1, (y + 0.5) / height * 2 - 1
    edge = np.maximum(np.abs(x), np.abs(y))
    albedo = np.full((height, width, 3), 0.73, np.float32)
    albedo[(x < -0.6) & (edge == -x)] = (0.63, 0.06, 0.05)
    albedo[(x > 0.6) & (edge == x)] = (0.14, 0.45, 0.09)
    normal = np.zeros((height, width, 3), np.float32)
    normal[..., 2] = 1.0
    normal[(edge > 0.6) & (edge == np.abs(x))] = (1, 0, 0)
    normal[(edge > 0.6) & (edge == np.abs(y))] = (0, 1, 0)
    depth = np.where(edge > 0.6, 4.0 - 2.5 * edge, 2.5).astype(np.float32)
    radius = np.hypot(x - 0.15, y - 0.3) / 0.3
    ball = radius < 1
    albedo[ball], depth[ball] = 0.8, 1.5 - 0.3 * np.sqrt(1 - radius[ball] ** 2)
    normal[ball] = (
        np.stack([x - 0.15, 0.3 - y, 0.3 * np.sqrt(np.maximum(1 - radius**2, 0))], -1)[ball] / 0.3
    )
    lamp = (np.abs(x) < 0.2) & (y < -0.62) & (y > -0.8)
    emission = np.zeros_like(albedo)
    emission[lamp] = (15.0, 12.5, 9.0)
    falloff = 1.0 / (0.6 + (y + 0.9) ** 2 + x**2)
    shade = np.clip(0.4 - 0.6 * normal[..., 1] * 0 + 0.5 * normal[..., 2], 0.1, 1.0)
    direct = albedo * (0.55 * falloff * shade)[..., None]
    direct[np.hypot((x - 0.25) / 0.35, (y - 0.75) / 0.1) < 1] *= 0.15
    diffuse = albedo * (0.12 + 0.08 * (1 + x) * 0.5)[..., None] * (1.3, 1.0, 0.85)
    specular = np.where(ball[..., None], 0.15 * (1 - radius[..., None] ** 2), 0.0) * (1.0, 0.9, 0.8)

    def noisy(clean: NDArray[np.floating], amount: float) -> Floats:
        return np.asarray(clean * rng.gamma(1 / amount, amount, clean.shape), np.float32)

    direct = noisy(direct, 0.002)
    theirs = {"indirect_diffuse": noisy(diffuse, 0.002), "indirect_specular": noisy(specular, 0.01)}
    leak = 0.05 * np.exp(-(((edge - 0.6) / 0.05) ** 2))[..., None]
    ours = {
        "indirect_diffuse": np.asarray(0.93 * diffuse + leak, np.float32),
        "indirect_specular": np.asarray(
            specular * (0.8 + 0.25 * np.sin(60 * y))[..., None], np.float32
        ),
    }
    pictures = {f"reference_{name}": picture for name, picture in theirs.items()} | ours
    pictures["indirect"] = sum(ours.values(), np.zeros_like(direct))
    pictures["reference_indirect"] = sum(theirs.values(), np.zeros_like(direct))
    pictures["image"] = emission + direct + pictures["indirect"]
    pictures["reference"] = emission + direct + pictures["reference_indirect"]
    pictures["error"] = pictures["image"] - pictures["reference"]
    pictures["flip"] = np.clip(3 * np.abs(pictures["error"]).mean(axis=-1), 0, 1)
    return pictures | {
        "direct": direct,
        "emission": emission,
        "albedo": albedo,
        "normal": normal,
        "depth": depth,
    }


def _metric(
    name: str, component: str, value: float, half: float | None, ideal: float
) -> MetricValue:
    formulas = {
        "energy_ratio": "mean(V) / mean(R)",
        "relmse_e2": "mean((V - R)^2 / (R^2 + e)), e = 0.01 mean(Y)^2",
        "flip": "HDR-FLIP, mean over pixels",
        "ssim_pq": "SSIM of PQ luminance, data_range 1, sigma 1.5",
        "delta_e_itp": "720 |d(I, T/2, P)|",
    }
    interval = None if half is None else Interval(low=value - half, high=value + half)
    return MetricValue(
        name=name,
        component=component,
        value=value,
        interval=interval,
        formula=formulas[name],
        ideal=ideal,
        unit="JND" if name == "delta_e_itp" else "",
    )


def record_with(images: dict[str, ImageFile], **changes: Any) -> Record:
    """Build a record around images; `changes` replace its fields."""
    fields: dict[str, Any] = {
        "record_id": "cornell-high-0001",
        "created": "2026-01-31T12:00:00+00:00",
        "command": "vctgi report cornell --preset high --seed 1",
        "scene": scene_named("cornell"),
        "method": "vctgi",
        "preset": "high",
        "config": {"cone_set": {"name": "fibonacci", "aperture": 0.6, "count": 17}, "levels": 4},
        "plan": [
            PlanEntry(item="diffuse cones", kept=True, reason="17 of 17 materials are diffuse"),
            PlanEntry(
                item="environment texture",
                kept=False,
                reason="no environment emitter",
                saved="4 MiB, 1 lookup a cone",
                bound="bit for bit",
                override="--keep sky",
            ),
        ],
        "seed": 1,
        "width": 320,
        "height": 320,
        "reference": ReferenceInfo(
            key="3f0c9a" * 8,
            samples_per_pixel=4096,
            batch_count=16,
            scattering_count=2,
            seed=1000,
            seconds=48.2,
            from_cache=True,
            noise_relmse=2.1e-5,
            truncated_share=0.083,
        ),
        "metrics": [
            _metric("energy_ratio", "image", 0.9871, 0.0021, 1.0),
            _metric("relmse_e2", "image", 0.00312, 0.00004, 0.0),
            _metric("flip", "image", 0.0583, 0.0007, 0.0),
            _metric("ssim_pq", "image", 0.9812, 0.0003, 1.0),
            _metric("delta_e_itp", "image", 3.27, None, 0.0),
            _metric("energy_ratio", "indirect", 0.9312, 0.0052, 1.0),
            _metric("relmse_e2", "indirect", 0.0214, 0.0006, 0.0),
            _metric("energy_ratio", "indirect_diffuse", 0.941, 0.004, 1.0),
            _metric("relmse_e2", "indirect_diffuse", -0.00002, 0.00009, 0.0),
        ],
        "times": [
            StageTime(stage="opacity voxelization", median_ms=41, low_ms=39, high_ms=47, count=9),
            StageTime(
                stage="reflective shadow map", median_ms=12, low_ms=11.5, high_ms=13, count=9
            ),
            StageTime(stage="light injection", median_ms=8.3, low_ms=8.1, high_ms=9.4, count=9),
            StageTime(stage="diffuse cones", median_ms=212, low_ms=205, high_ms=240, count=9),
            StageTime(stage="composite", median_ms=0.61, low_ms=0.6, high_ms=0.7, count=9),
        ],
        "images": images,
        "machine": Machine(
            backend="llvm_ad_rgb",
            device="LLVM 19.1",
            processor="a processor",
            core_count=2,
            memory_gib=7.7,
            system="Linux",
            python="3.11.2",
            versions={"mitsuba": "3.9.1", "drjit": "1.5.0"},
            commit="0123456789abcdef0123456789abcdef01234567",
            is_dirty=False,
        ),
        "display": Display(
            nits_per_unit=55.0,
            exposure=0.5,
            flip_start_exposure=-2.0,
            flip_stop_exposure=3.0,
            flip_exposure_count=5,
            flip_pixels_per_degree=67.02,
        ),
        "warnings": [],
    }
    return Record.model_validate(fields | changes)


def scene_named(name: str, **changes: Any) -> SceneInfo:
    """Build the facts of a scene."""
    fields: dict[str, Any] = {
        "name": name,
        "title": f"Synthetic {name}",
        "source": f"built-in scene {name}",
        "purpose": "A closed diffuse box with a small lamp: colour bleeding from two walls.",
        "digest": "ab" * 32,
        "triangle_count": 12340,
        "emitters": {"area": 1},
        "bsdfs": {"diffuse": 4, "roughconductor": 1},
        "bounds_min": (-1.0, -1.0, -1.0),
        "bounds_max": (1.0, 1.0, 1.0),
        "contributions": ["diffuse: reflectance into diffuse cones and into voxels"],
        "unsupported": [],
    }
    return SceneInfo.model_validate(fields | changes)


@pytest.fixture(scope="session")
def pictures() -> Callable[[int, int], dict[str, Floats]]:
    return synthetic_pictures


@pytest.fixture
def make_record() -> Callable[..., Record]:
    return record_with


@pytest.fixture
def make_scene() -> Callable[..., SceneInfo]:
    return scene_named


@pytest.fixture(scope="session")
def awkward_name() -> str:
    return AWKWARD


@pytest.fixture
def records_folder(tmp_path: Path) -> Path:
    return tmp_path / "records"


@pytest.fixture
def write(records_folder: Path) -> WriteRecord:
    def write_synthetic(
        *,
        record_id: str = "cornell-high-0001",
        name: str = "cornell",
        drop_images: tuple[str, ...] = (),
        width: int = 48,
        height: int = 32,
        **changes: Any,
    ) -> Path:
        images = {
            key: write_image(records_folder / record_id / f"{key}.exr", picture, key)
            for key, picture in synthetic_pictures(width, height).items()
            if key not in drop_images
        }
        changes.setdefault("scene", scene_named(name))
        record = record_with(images, record_id=record_id, width=width, height=height, **changes)
        return write_record(record, records_folder)

    return write_synthetic
