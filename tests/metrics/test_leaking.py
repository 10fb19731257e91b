"""Leaking in pictures of which the leak is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from metrics.leaking import (
    LeakAudit,
    audit_shares,
    excess_map,
    one_sided_excess,
    picture_gain,
    sealed_room_ratio,
    share_of_choices,
)
from metrics.synthetic import half_dark_light

BATCHES, EDGE = 6, 24

ROUNDING = 1e-12
NOISE = 0.05
"""Standard deviation of a batch's truth."""


def light() -> NDArray[np.float64]:
    """Return what a picture should hold: the right half is dark."""
    return half_dark_light(EDGE)


def audit_of(
    seen: NDArray[np.float64], through: NDArray[np.float64] | float, *, noise: float = 0.0
) -> LeakAudit:
    """Audit of a picture that shows `seen` and beside it what came through."""
    shape = (BATCHES, EDGE, EDGE)
    part = np.broadcast_to(through, shape).copy()
    truth = light() + np.random.default_rng(5).normal(scale=noise, size=shape) * (light() > 0.0)
    return LeakAudit(gathered=np.broadcast_to(seen, shape) + part, through=part, truth=truth)


def value(audit: LeakAudit, name: str) -> float:
    return audit_shares(audit)[name].value


def test_the_truth_does_not_leak() -> None:
    for name in ("leak_through", "leak_wrong_face", "leak", "missing_light"):
        assert value(audit_of(light(), 0.0), name) == pytest.approx(0.0, abs=ROUNDING)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.5])
def test_a_leak_through_geometry_has_its_share(share: float) -> None:
    leaked = np.where(light() > 0.0, 0.0, share / (1.0 - share) * light().sum() / (EDGE**2 / 2))
    audit = audit_of(light(), leaked)
    assert value(audit, "leak_through") == pytest.approx(share, rel=1e-9)
    assert value(audit, "leak_wrong_face") == pytest.approx(0.0, abs=ROUNDING)
    assert value(audit, "leak") == pytest.approx(share, rel=1e-9)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.5])
def test_a_wrong_face_has_its_share(share: float) -> None:
    dark = np.where(light() > 0.0, 0.0, share / (1.0 - share) * light().sum() / (EDGE**2 / 2))
    audit = audit_of(light() + dark, 0.0)
    assert value(audit, "leak_wrong_face") == pytest.approx(share, rel=1e-9)
    assert value(audit, "leak_through") == 0.0


def test_light_that_is_missing_is_told_apart() -> None:
    seen = light()
    lost = seen[:6].sum()
    seen[:6] = 0.0
    audit = audit_of(seen, 0.0)
    assert value(audit, "missing_light") == pytest.approx(lost / seen.sum(), rel=1e-9)
    assert value(audit, "leak") == pytest.approx(0.0, abs=ROUNDING)


def test_energy_times_a_factor_is_no_leak() -> None:
    leaked = np.where(light() > 0.0, 0.0, 0.2)
    for noise in (0.0, NOISE):
        plain = audit_of(light() + 0.05 * leaked, leaked, noise=noise)
        brighter = LeakAudit(
            gathered=1.05 * plain.gathered, through=1.05 * plain.through, truth=plain.truth
        )
        for name in ("leak", "leak_through", "leak_wrong_face", "missing_light"):
            assert value(brighter, name) == pytest.approx(value(plain, name), rel=1e-9)
    assert picture_gain(brighter) == pytest.approx(1.05 * picture_gain(plain), rel=1e-9)


def test_more_leak_is_a_larger_number() -> None:
    found = [value(audit_of(light(), k * 0.1), "leak") for k in range(5)]
    assert found == sorted(found)
    assert len(set(found)) == len(found)


def test_noise_of_the_truth_is_no_leak() -> None:
    rows = audit_shares(audit_of(light(), 0.0, noise=NOISE))
    for row in rows.values():
        assert row.low is not None
        assert row.high is not None
        assert row.value < 0.1 * NOISE
        assert row.low <= 0.0 or row.value < 0.02 * NOISE


@pytest.mark.parametrize("name", ["leak_through", "leak_wrong_face"])
def test_intervals_of_an_audit_hold_its_share(name: str) -> None:
    inside, share = 0, 0.1
    dark = np.where(light() > 0.0, 0.0, share / (1.0 - share) * light().sum() / (EDGE**2 / 2))
    for seed in range(100):
        # Probes see another part of what came through in each batch, a fifth on average.
        rng = np.random.default_rng(seed)
        part = 0.2 * dark * rng.gamma(2.0, 0.5, size=(BATCHES, EDGE, EDGE))
        gathered = np.broadcast_to(light() + dark, part.shape).copy()
        truth = light() * rng.normal(1.0, NOISE, size=part.shape)
        row = audit_shares(LeakAudit(gathered=gathered, through=part, truth=truth))[name]
        assert row.low is not None
        assert row.high is not None
        inside += row.low <= share * (0.2 if name == "leak_through" else 0.8) <= row.high
    # 95 of 100 nominally, less four standard deviations of a binomial.
    assert inside >= 86, inside


def test_a_mask_asks_for_a_part_with_the_gain_of_the_whole() -> None:
    dark = np.broadcast_to(light() == 0.0, (EDGE, EDGE))
    audit = audit_of(1.1 * light(), np.where(dark, 0.3, 0.0))
    assert audit_shares(audit, dark)["leak_through"].value == pytest.approx(1.0)
    assert audit_shares(audit, ~dark)["leak"].value == pytest.approx(0.0, abs=ROUNDING)
    assert excess_map(audit, 1.0).max() == pytest.approx(0.0, abs=ROUNDING)


def test_bad_audits_are_refused() -> None:
    good = audit_of(light(), 0.1)
    one_nan = good.through.copy()
    one_nan[1, 2, 3] = np.nan
    with pytest.raises(ValueError, match="NaN"):
        LeakAudit(gathered=good.gathered, through=one_nan, truth=good.truth)
    with pytest.raises(ValueError, match="one shape"):
        LeakAudit(gathered=good.gathered, through=good.through[:2], truth=good.truth)
    with pytest.raises(ValueError, match="must hold light"):
        LeakAudit(gathered=0.0 * good.gathered, through=good.through, truth=good.truth)
    with pytest.raises(ValueError, match="boolean"):
        audit_shares(good, np.ones((EDGE, EDGE)))
    with pytest.raises(ValueError, match="no light is gathered"):
        audit_shares(good, np.zeros((EDGE, EDGE), dtype=np.bool_))
    two = LeakAudit(gathered=good.gathered[:2], through=good.through[:2], truth=good.truth[:2])
    with pytest.raises(ValueError, match="at least 3 batches"):
        audit_shares(two)


def test_choices_are_unbiased_and_their_intervals_hold_the_truth() -> None:
    rng = np.random.default_rng(7)
    weights = rng.exponential(size=400)
    blocked_part = rng.uniform(size=400) ** 4
    truth = float((weights * blocked_part).sum() / weights.sum())
    found, inside = [], 0
    for _ in range(200):
        picks = rng.uniform(size=(8, 400)) < blocked_part
        row = share_of_choices(np.broadcast_to(weights, picks.shape), picks)
        found.append(row.value)
        assert row.low is not None
        assert row.high is not None
        inside += row.low <= truth <= row.high
    assert np.mean(found) == pytest.approx(truth, abs=4.0 * np.std(found) / np.sqrt(200))
    # 190 of 200 nominally, less four standard deviations of a binomial.
    assert inside >= 178


def test_bad_choices_are_refused() -> None:
    with pytest.raises(ValueError, match="one shape"):
        share_of_choices(np.ones((2, 3)), np.ones((3, 2)))
    with pytest.raises(ValueError, match="NaN"):
        share_of_choices(np.full((2, 3), np.nan), np.ones((2, 3)))
    with pytest.raises(ValueError, match="0 everywhere"):
        share_of_choices(np.zeros((2, 3)), np.ones((2, 3)))


def rgb_batches(noise: float = 0.0) -> NDArray[np.float64]:
    batches = np.repeat(light()[None, ..., None], BATCHES, axis=0)
    batches = batches + np.random.default_rng(2).normal(scale=noise, size=batches.shape)
    return np.repeat(batches, 3, axis=-1)


def test_one_sided_excess_of_known_pictures() -> None:
    test = rgb_batches()[0]
    rows = one_sided_excess(test, rgb_batches())
    assert rows["dark_excess"].value == rows["missing_energy"].value == 0.0
    leaking = test + np.where(light() == 0.0, 0.1, 0.0)[..., None]
    share = 0.1 * (EDGE**2 / 2) / light().sum()
    rows = one_sided_excess(leaking, rgb_batches())
    assert rows["dark_excess"].value == pytest.approx(share, rel=1e-6)
    rows = one_sided_excess(0.5 * test, rgb_batches())
    assert rows["missing_energy"].value == pytest.approx(0.5, rel=1e-6)
    # Too bright where the reference is bright is no leak
    assert one_sided_excess(1.05 * test, rgb_batches())["dark_excess"].value == 0.0


def test_one_sided_excess_of_the_reference_itself_is_near_zero() -> None:
    rows = one_sided_excess(rgb_batches()[0], rgb_batches(NOISE))
    assert rows["dark_excess"].value < 1e-3
    assert rows["missing_energy"].value < 1e-3


def test_one_sided_excess_without_a_dark_pixel_says_so() -> None:
    bright = np.ones((BATCHES, 4, 4, 3))
    assert "no pixel" in one_sided_excess(2.0 * bright[0], bright)["dark_excess"].note
    with pytest.raises(ValueError, match="some light"):
        one_sided_excess(bright[0], 0.0 * bright)
    with pytest.raises(ValueError, match="NaN"):
        one_sided_excess(np.full((4, 4, 3), np.nan), bright)


def test_sealed_rooms() -> None:
    assert sealed_room_ratio([0.0, 0.2], [1.0, 3.0]) == pytest.approx(0.05)
    with pytest.raises(ValueError, match="lit must hold light"):
        sealed_room_ratio([1.0], [0.0])
    with pytest.raises(ValueError, match="empty"):
        sealed_room_ratio([], [1.0])
    with pytest.raises(ValueError, match="NaN"):
        sealed_room_ratio([np.nan], [1.0])
