"""Every public metric on bad input: a clear error or a defined answer, and the process lives.

Warnings are errors here (pyproject.toml), so a division by nothing does not pass for an answer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray

import metrics
from metrics import DisplaySettings, FlipSettings, LeakAudit, Measurement
from metrics.attribution import attribute_error
from metrics.display_banding import display_banding, display_banding_excess
from metrics.flicker import flicker
from metrics.synthetic import LeakingPicture, march_cycles, sliding_motion

Array = NDArray[Any]
Arrays = dict[str, Array]
Outcome = Literal["value", "error"]

EDGE, BATCHES = 16, 6
FRAMES = 24
PLACES = np.arange(FRAMES) / 8.0
CYCLES = march_cycles(32, 0.2)
PHASES = np.arange(8) / 8.0
FLIP = FlipSettings(start_exposure=-3.0, stop_exposure=0.0, exposure_count=2, pixels_per_degree=67)
DISPLAY = DisplaySettings(
    nits_per_unit=20.0,
    exposure=0.0,
    flip_start_exposure=-3.0,
    flip_stop_exposure=0.0,
    flip_exposure_count=2,
    flip_pixels_per_degree=67.0,
)
MOTION = sliding_motion(frames=3, height=EDGE, width=EDGE)[0]

HALF_PRECISION = 1e-2
"""Relative: the metric of numbers that are rounded to 16 bits, in 16 bits and in 64."""


@dataclass(frozen=True)
class Subject:
    """A metric, good input for it, and which of its arrays may be what."""

    good: Callable[[], Arrays]
    call: Callable[[Arrays], object]
    has_colour: bool = True
    one_pixel: Outcome = "value"
    black_reference: Outcome = "error"
    reference: str = "batches"


def positive(*shape: int, seed: int = 1) -> Array:
    return np.random.default_rng(seed).uniform(0.5, 1.5, shape)


def pair(*shape: int) -> Callable[[], Arrays]:
    return lambda: {"test": positive(*shape), "batches": positive(BATCHES, *shape, seed=2)}


def renderings(count: int) -> Arrays:
    shape = (3, EDGE, EDGE, 3)
    return {"test": positive(count, *shape), "batches": positive(BATCHES, *shape, seed=2)}


def image_metric(call: Callable[..., object], **options: object) -> Callable[[Arrays], object]:
    return lambda arrays: call(arrays["test"], arrays["batches"], **options)


def leak_audit(arrays: Arrays) -> object:
    return metrics.audit_shares(LeakAudit(**arrays))


def audit_arrays() -> Arrays:
    audit = LeakingPicture(through=0.1, edge=EDGE).audit(BATCHES)
    return {"gathered": audit.gathered, "through": audit.through, "truth": audit.truth}


def attribution(arrays: Arrays) -> object:
    chain = [arrays["test"], arrays["test"], arrays["batches"]]
    found = attribute_error("relmse", ["first", "second"], chain, chain, arrays["batches"])
    return [found.start.value, found.end.value, found.interaction]


IMAGES: dict[str, Subject] = {
    "energy_ratio": Subject(pair(EDGE, EDGE, 3), image_metric(metrics.energy_ratio)),
    "mse": Subject(pair(EDGE, EDGE, 3), image_metric(metrics.mse), black_reference="value"),
    "relmse_e2": Subject(pair(EDGE, EDGE, 3), image_metric(metrics.relmse_e2)),
    "relmse_e001": Subject(
        pair(EDGE, EDGE, 3), image_metric(metrics.relmse_e001), black_reference="value"
    ),
    "mre": Subject(pair(EDGE, EDGE, 3), image_metric(metrics.mean_relative_error)),
    "flip": Subject(
        pair(EDGE, EDGE, 3),
        image_metric(metrics.mean_flip, settings=FLIP),
        black_reference="value",
    ),
    "ssim_pq": Subject(
        pair(EDGE, EDGE, 3),
        image_metric(metrics.ssim_pq, nits_per_unit=20.0),
        one_pixel="error",
        black_reference="value",
    ),
    "delta_e_itp": Subject(
        pair(EDGE, EDGE, 3),
        image_metric(metrics.delta_e_itp, nits_per_unit=20.0),
        black_reference="value",
    ),
    "delta_e_2000": Subject(
        pair(EDGE, EDGE, 3),
        image_metric(metrics.delta_e_2000, exposure=0.0),
        black_reference="value",
    ),
    "suite": Subject(
        pair(EDGE, EDGE, 3),
        image_metric(metrics.measure, component="image", display=DISPLAY),
        one_pixel="error",
        black_reference="value",
    ),
    "reference_noise_relmse": Subject(
        lambda: {"batches": positive(BATCHES, EDGE, EDGE, 3)},
        lambda arrays: metrics.reference_noise_relmse(arrays["batches"]),
    ),
    "one_sided_excess": Subject(pair(EDGE, EDGE, 3), image_metric(metrics.one_sided_excess)),
    "attribution": Subject(
        lambda: {
            "test": positive(BATCHES, 4, 4, 3),
            "batches": positive(BATCHES, 4, 4, 3, seed=2),
        },
        attribution,
    ),
}

OVER_TIME: dict[str, Subject] = {
    "temporal_difference_error": Subject(
        pair(FRAMES, 4, 3), image_metric(metrics.temporal_difference_error)
    ),
    "temporal_difference_rms": Subject(
        pair(FRAMES, 4, 3), image_metric(metrics.temporal_difference_rms)
    ),
    "pop_share": Subject(pair(FRAMES, 4, 3), image_metric(metrics.pop_share)),
    "voxel_period_rms": Subject(
        pair(FRAMES, 4, 3), image_metric(metrics.voxel_period_rms, places=PLACES)
    ),
    "voxel_period_share": Subject(
        pair(FRAMES, 4, 3), image_metric(metrics.voxel_period_share, places=PLACES)
    ),
    "flicker": Subject(
        pair(3, EDGE, EDGE, 3), image_metric(flicker, motion=MOTION), one_pixel="error"
    ),
    "flicker_rms": Subject(
        pair(3, EDGE, EDGE, 3), image_metric(metrics.flicker_rms, motion=MOTION), one_pixel="error"
    ),
    "flicker_structure": Subject(
        lambda: renderings(4),
        image_metric(metrics.flicker_structure, motion=MOTION),
        one_pixel="error",
    ),
    "flicker_noise": Subject(
        lambda: renderings(4), image_metric(metrics.flicker_noise, motion=MOTION), one_pixel="error"
    ),
    "recentring_difference": Subject(
        lambda: {"batches": positive(4, 1, 3), "test": positive(4, 1, 3, seed=2)},
        lambda arrays: metrics.recentring_difference(arrays["batches"], arrays["test"]),
    ),
    "power_ripple": Subject(
        lambda: {"batches": positive(BATCHES, 16)},
        lambda arrays: metrics.power_ripple(arrays["batches"]),
        has_colour=False,
    ),
}

OTHERS: dict[str, Subject] = {
    "audit_shares": Subject(audit_arrays, leak_audit, has_colour=False, reference="gathered"),
    "share_of_choices": Subject(
        lambda: {"batches": positive(BATCHES, 40), "is_blocked": np.eye(BATCHES, 40)},
        lambda arrays: metrics.share_of_choices(arrays["batches"], arrays["is_blocked"]),
        has_colour=False,
    ),
    "sealed_room_ratio": Subject(
        lambda: {"test": 0.1 * positive(40), "batches": positive(40)},
        lambda arrays: metrics.sealed_room_ratio(arrays["test"], arrays["batches"]),
        has_colour=False,
    ),
    "phase_spread": Subject(
        lambda: {"batches": positive(8, 32, 32)},
        lambda arrays: metrics.phase_spread(arrays["batches"]),
        has_colour=False,
    ),
    "structured_power": Subject(
        lambda: {"batches": positive(32, 32) - 1.0, "cycles": CYCLES},
        lambda arrays: metrics.structured_power(arrays["batches"], arrays["cycles"]),
        has_colour=False,
        one_pixel="error",
        black_reference="value",
    ),
    "structured_share": Subject(
        lambda: {"batches": positive(32, 32) - 1.0, "cycles": CYCLES},
        lambda arrays: metrics.structured_share(arrays["batches"], arrays["cycles"]),
        has_colour=False,
        one_pixel="error",
        black_reference="value",
    ),
    "moving_bands": Subject(
        lambda: {"batches": positive(8, 32, 32), "offsets": PHASES, "cycles": CYCLES},
        lambda a: metrics.moving_bands(a["batches"], a["offsets"], a["cycles"]).power.value,
        has_colour=False,
        one_pixel="error",
    ),
    "display_banding": Subject(
        lambda: {"batches": positive(70, 70, 3)},
        lambda arrays: display_banding(arrays["batches"], nits_per_unit=20.0),
        one_pixel="error",
        black_reference="value",
    ),
    "display_banding_excess": Subject(
        lambda: {"test": positive(70, 70, 3), "batches": positive(2, 70, 70, 3)},
        image_metric(display_banding_excess, nits_per_unit=20.0),
        one_pixel="error",
        black_reference="value",
    ),
}

SUBJECTS = IMAGES | OVER_TIME | OTHERS
ARRAYS = [(name, array) for name, subject in SUBJECTS.items() for array in subject.good()]

COLOURED = [(name, array) for name, array in ARRAYS if SUBJECTS[name].has_colour]
SHAPED = [(name, array) for name, array in ARRAYS if name != "sealed_room_ratio"]
"""But for rooms, which are lists of pixels of any shape."""

RENDERED_OFTEN = ("flicker_structure", "flicker_noise")
"""What is tested has batches of its own, of which there may be any number."""

WITHOUT_BATCHES = (
    "recentring_difference",
    "sealed_room_ratio",
    "structured_power",
    "structured_share",
    "display_banding",
    "display_banding_excess",
)

every_subject = pytest.mark.parametrize("name", SUBJECTS)
every_array = pytest.mark.parametrize(("name", "array"), ARRAYS)


def values_of(found: object) -> list[float]:
    """Return all numbers of an answer, ends of intervals included."""
    if isinstance(found, Measurement | metrics.Estimate):
        return [each for each in (found.value, found.low, found.high) if each is not None]
    if isinstance(found, dict):
        return [value for each in found.values() for value in values_of(each)]
    if isinstance(found, list):
        return [value for each in found for value in values_of(each)]
    assert isinstance(found, float), type(found)
    return [found]


def outcome_of(subject: Subject, arrays: Arrays) -> Outcome:
    """Say what a metric makes of input; numbers that are not finite are no answer."""
    try:
        found = subject.call(arrays)
    except ValueError:
        return "error"
    assert np.isfinite(values_of(found)).all(), found
    return "value"


@every_subject
def test_good_input_has_an_answer(name: str) -> None:
    assert outcome_of(SUBJECTS[name], SUBJECTS[name].good()) == "value"


@every_array
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_refused(name: str, array: str, bad: float) -> None:
    arrays = SUBJECTS[name].good()
    spoilt = arrays[array].copy()
    spoilt.reshape(-1)[spoilt.size // 2] = bad
    with pytest.raises(ValueError, match="finite"):
        SUBJECTS[name].call(arrays | {array: spoilt})


@every_array
@pytest.mark.parametrize("axis", [0, -2, -1])
def test_empty_and_cut_arrays_are_refused(name: str, array: str, axis: int) -> None:
    arrays = SUBJECTS[name].good()
    axis = max(axis, -arrays[array].ndim)
    empty = np.take(arrays[array], [], axis=axis)
    assert outcome_of(SUBJECTS[name], arrays | {array: empty}) == "error"
    # An image that stands alone, a room and a list of powers may have any size.
    is_alone = len(arrays) == 1 or name == "sealed_room_ratio"
    is_batch = axis == 0 and (array == "batches" or name in RENDERED_OFTEN)
    if not (is_alone or is_batch):
        cut = np.take(arrays[array], range(1, arrays[array].shape[axis]), axis=axis)
        assert outcome_of(SUBJECTS[name], arrays | {array: cut}) == "error"


@pytest.mark.parametrize(("name", "array"), SHAPED)
def test_arrays_of_another_rank_are_refused(name: str, array: str) -> None:
    arrays = SUBJECTS[name].good()
    with pytest.raises(ValueError):  # noqa: PT011 - every metric has words of its own
        SUBJECTS[name].call(arrays | {array: arrays[array][None, None]})
    with pytest.raises(ValueError):  # noqa: PT011 - as above
        SUBJECTS[name].call(arrays | {array: np.array(1.0)})


@pytest.mark.parametrize(("name", "array"), COLOURED)
def test_rgba_is_refused(name: str, array: str) -> None:
    subject = SUBJECTS[name]
    arrays = subject.good()
    alpha = np.ones((*arrays[array].shape[:-1], 1))
    with pytest.raises(ValueError, match=r"3\)|alpha"):
        subject.call(arrays | {array: np.concatenate([arrays[array], alpha], axis=-1)})


@every_subject
def test_sixteen_bits_are_read_as_they_are(name: str) -> None:
    short = {key: each.astype(np.float16) for key, each in SUBJECTS[name].good().items()}
    wide = {key: each.astype(np.float64) for key, each in short.items()}
    found, expected = (values_of(SUBJECTS[name].call(each)) for each in (short, wide))
    np.testing.assert_allclose(found, expected, rtol=HALF_PRECISION, atol=1e-9)


@every_subject
def test_black_input(name: str) -> None:
    subject = SUBJECTS[name]
    arrays = subject.good()
    black = np.zeros_like(arrays[subject.reference])
    assert outcome_of(subject, arrays | {subject.reference: black}) == subject.black_reference
    if "test" in arrays:
        assert outcome_of(subject, arrays | {"test": np.zeros_like(arrays["test"])}) == "value"
        # A pair of black pictures must not end the process, as FLIP alone would.
        both = {key: np.zeros_like(each) for key, each in arrays.items()}
        assert outcome_of(subject, both) == subject.black_reference


@pytest.mark.parametrize("name", [name for name in SUBJECTS if name != "audit_shares"])
def test_constant_input_has_an_answer(name: str) -> None:
    subject = SUBJECTS[name]
    keep = ("offsets", "cycles", "is_blocked")
    flat = {
        key: each if key in keep else np.full_like(each, 0.5)
        for key, each in subject.good().items()
    }
    assert outcome_of(subject, flat) == "value"


@every_subject
def test_negative_light_has_an_answer(name: str) -> None:
    subject = SUBJECTS[name]
    arrays = subject.good()
    array = "test" if "test" in arrays else subject.reference
    spoilt = arrays[array].copy()
    spoilt.reshape(-1)[:2] = -0.3
    assert outcome_of(subject, arrays | {array: spoilt}) == "value"


@pytest.mark.parametrize("name", [name for name in SUBJECTS if name != "power_ripple"])
def test_one_pixel(name: str) -> None:
    subject = SUBJECTS[name]
    arrays = {key: _one_pixel(each, name, key) for key, each in subject.good().items()}
    assert outcome_of(subject, arrays) == subject.one_pixel


@pytest.mark.parametrize("name", [name for name in SUBJECTS if name not in WITHOUT_BATCHES])
def test_one_batch_is_refused(name: str) -> None:
    subject = SUBJECTS[name]
    arrays = subject.good()
    count = len(arrays[subject.reference])
    one = {key: each[:1] for key, each in arrays.items() if len(each) == count}
    assert outcome_of(subject, arrays | one) == "error"


def _one_pixel(values: Array, name: str, array: str) -> Array:
    """Leave one pixel or receiver; frames, batches and phases stay as many."""
    if array == "offsets":
        return values
    if name in OVER_TIME and not name.startswith(("flicker", "recentring_difference")):
        return values[..., :1, :]
    if name in ("share_of_choices", "sealed_room_ratio"):
        return values[..., :1]
    if SUBJECTS[name].has_colour:
        return values[..., :1, :1, :]
    return values[..., :1, :1]
