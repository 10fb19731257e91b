"""Attribution of errors to stages, on renderers whose errors are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from metrics.attribution import Attribution, ErrorKind, attribute_error
from metrics.confidence import Estimate

SHAPE = (8, 12, 10, 3)
NAMES = ["first", "second", "third"]
FACTORS = np.array([1.2, 0.9, 1.05])
"""By what each stage that is not exact multiplies the light."""

ROUNDING = 1e-12
SUM_ROUNDING = 1e-9


def _truth(noise: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    level = np.linspace(0.5, 2.0, SHAPE[1] * SHAPE[2]).reshape(1, SHAPE[1], SHAPE[2], 1)
    return level * (1.0 + noise * rng.standard_normal(SHAPE))


def _chains(noise: float, seed: int = 100) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Pictures of a renderer whose stages multiply, each picture with noise of its own."""
    forward = [_truth(noise, seed + n) * FACTORS[n:].prod() for n in range(4)]
    backward = [_truth(noise, seed + 10 + n) * FACTORS[: 3 - n].prod() for n in range(4)]
    # Both orders begin and end with the same renderer.
    backward[0], backward[-1] = forward[0], forward[-1]
    return forward, backward


def _attribute(kind: ErrorKind, noise: float, seed: int = 0) -> Attribution:
    forward, backward = _chains(noise, seed=100 * (seed + 1))
    return attribute_error(kind, NAMES, forward, backward, _truth(noise, seed))


def _holds(estimate: Estimate, value: float, widths: float = 1.0) -> bool:
    half = 0.5 * (estimate.high - estimate.low)
    return abs(estimate.value - value) <= widths * half + ROUNDING


def test_energy_of_stages_that_multiply() -> None:
    """Without noise each share is the difference of products, in both orders."""
    found = _attribute("energy", 0.0)
    products = [FACTORS[n:].prod() for n in range(4)]
    heads = [FACTORS[:n].prod() for n in range(4)]
    assert found.start.value == pytest.approx(products[0] - 1.0, abs=ROUNDING)
    for n, stage in enumerate(found.stages):
        assert stage.forward.value == pytest.approx(products[n] - products[n + 1], abs=ROUNDING)
        assert stage.backward.value == pytest.approx(heads[n + 1] - heads[n], abs=ROUNDING)
        between = stage.forward.value - stage.backward.value
        assert stage.interaction.value == pytest.approx(between, abs=ROUNDING)
    assert found.end.value == pytest.approx(0.0, abs=ROUNDING)


def test_relmse_of_one_stage() -> None:
    """A factor of 1.2 on the only wrong stage owns (0.2 R)^2 / (R^2 + eps), in either order."""
    truth = _truth(0.0, 0)
    exact = [truth] * 3
    found = attribute_error(
        "relmse", NAMES, [1.2 * truth, *exact], [1.2 * truth] * 3 + [truth], truth
    )
    level = truth[0]
    expected = float(np.mean((0.2 * level) ** 2 / (level**2 + 0.01 * level.mean() ** 2)))
    assert found.stages[0].forward.value == pytest.approx(expected, rel=1e-9)
    assert found.stages[0].backward.value == pytest.approx(expected, rel=1e-9)
    for stage in found.stages[1:]:
        assert stage.forward.value == pytest.approx(0.0, abs=ROUNDING)
        assert stage.backward.value == pytest.approx(0.0, abs=ROUNDING)
    assert found.interaction == pytest.approx(0.0, abs=ROUNDING)


@pytest.mark.parametrize("kind", ["energy", "relmse"])
def test_shares_add_up(kind: ErrorKind) -> None:
    """Start, noise, stages and end are one sum, whatever the noise."""
    found = _attribute(kind, 0.3)
    for order in ("forward", "backward"):
        shares = [getattr(stage, order).value for stage in found.stages]
        left = found.start.value - found.noise.value - sum(shares)
        # The jackknife's correction is linear, so sums of estimates are estimates of sums.
        assert left == pytest.approx(found.end.value, abs=SUM_ROUNDING)


@pytest.mark.parametrize("kind", ["energy", "relmse"])
def test_noise_hardly_moves_shares(kind: ErrorKind) -> None:
    """Nine of ten intervals of noisy chains hold the share without noise."""
    clean = _attribute(kind, 0.0)
    held = []
    for seed in range(12):
        noisy = _attribute(kind, 0.1, seed)
        pairs = zip(clean.stages, noisy.stages, strict=True)
        held += [_holds(b.forward, a.forward.value) for a, b in pairs]
        held.append(_holds(noisy.end, 0.0))
    assert np.mean(held) >= 0.85


def test_noise_of_one_frame() -> None:
    """One rendering owns the variance of its noise; with exact stages nothing else is left."""
    noise = 0.2
    truth = _truth(0.02, 0)
    pictures = [_truth(noise, 1)] * 4
    found = attribute_error("relmse", NAMES, pictures, pictures, truth)
    level = _truth(0.0, 0)[0]
    expected = float(np.mean((noise * level) ** 2 / (level**2 + 0.01 * level.mean() ** 2)))
    assert _holds(found.noise, expected, widths=1.5)
    assert _holds(found.end, 0.0, widths=1.5)


@pytest.mark.parametrize("kind", ["energy", "relmse"])
def test_a_planted_fault_does_not_close(kind: ErrorKind) -> None:
    """An exact renderer that is 5 % too bright leaves more than its interval."""
    forward, backward = _chains(0.05)
    forward[-1] = 1.05 * forward[-1]
    found = attribute_error(kind, NAMES, forward, backward, _truth(0.05, 0))
    assert found.end.low > 0.0


def test_shares_grow_with_their_cause() -> None:
    """The farther a stage is off, the more it owns."""
    truth = _truth(0.05, 0)
    owned = []
    for factor in (1.0, 1.05, 1.1, 1.2):
        chain = [factor * _truth(0.05, 1), *[_truth(0.05, 2)] * 3]
        back = [chain[0]] * 3 + [_truth(0.05, 2)]
        owned.append(attribute_error("relmse", NAMES, chain, back, truth).stages[0].forward.value)
    assert owned == sorted(owned)


def test_bad_input_is_refused() -> None:
    """Counts, shapes, NaN, too few batches and a black reference each have their message."""
    truth = _truth(0.0, 0)
    good = [truth] * 4
    with pytest.raises(ValueError, match="3 stages need 4 pictures"):
        attribute_error("energy", NAMES, good[:3], good, truth)
    with pytest.raises(ValueError, match="one shape"):
        attribute_error("energy", NAMES, [each[:, :5] for each in good], good, truth)
    with pytest.raises(ValueError, match="at least 5"):
        attribute_error("energy", NAMES, [g[:4] for g in good], [g[:4] for g in good], truth[:4])
    with pytest.raises(ValueError, match="no light"):
        attribute_error("relmse", NAMES, good, good, 0.0 * truth)
    bad = truth.copy()
    bad[2, 3, 4, 1] = np.nan
    with pytest.raises(ValueError, match="finite"):
        attribute_error("energy", NAMES, [bad, *good[1:]], good, truth)
