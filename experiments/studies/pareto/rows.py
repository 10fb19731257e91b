"""The numbers of each scene: times and errors of presets, fits, and what paths need for the same.

Intervals of times are quartiles of the repetitions; all others hold 95 %.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

from experiments.clocks import REPETITIONS, Clocks
from experiments.studies.check import Check, Measured, RefusedError, StudyContext
from experiments.studies.pareto.bench import MOVING, Bench, Result, bench_of, has_denoiser
from experiments.studies.pareto.cone_frames import FRAMES, STILL
from experiments.studies.pareto.figures import draw
from experiments.studies.pareto.methods import DENOISED, HIGH, PATHS, PRESET_NAMES
from experiments.studies.pareto.trade_off import (
    Errors,
    error_at,
    fit_floor,
    fit_slope,
    pareto_front,
    ratio,
    time_to_reach,
)

CHOSEN = "chosen scene"
"""The scene of `--scene`; without one, that of a corridor of rooms."""

SCENES: Final = (
    "cornell_box",
    "sealed_rooms",
    "glossy_floor",
    "small_light",
    "open_sky",
    CHOSEN,
)
QUICK_SCENE = "cornell_box"

SLOPE_LIMITS: Final = (-1.15, -0.85)
"""Of the squared error of an unbiased method over its samples: one over their number is -1."""

MOST_ENERGY_ERROR: Final = 0.03
"""Of path tracing at its most samples: what is left of its noise, but no other transport."""

CONFIGURATION = "indirect light of two scatterings; still frames by the device's clock"
MILLISECONDS: Final = 1e3

Read = Callable[[Bench], Measured]


def checks() -> list[Check]:
    """Return the checks of all scenes."""
    return [check for scene in SCENES for check in _checks(scene)]


def _checks(scene: str) -> list[Check]:
    found = [
        _check(scene, "slope of path tracing's relMSE over samples", _slope_over_samples,
               limits=SLOPE_LIMITS, goal=-1.0, is_headline=True),
        _check(scene, "slope of path tracing's relMSE over time", _slope_over_time, goal=-1.0),
        _check(scene, "energy of path tracing at its most samples", _path_energy,
               limits=(1.0 - MOST_ENERGY_ERROR, 1.0 + MOST_ENERGY_ERROR), goal=1.0),
        _check(scene, "bias floor of high, relMSE", _floor, goal=0.0, is_headline=True),
        _check(scene, "methods on the front", _front_size),
        _check(scene, "noise of the reference, relMSE", _noise, goal=0.0),
        *(_check(scene, f"{HIGH}, {kind}, time of whole frames over that of their parts",
                 partial(_whole_over_parts, kind), goal=1.0) for kind in MOVING),
    ]  # fmt: skip
    for preset in PRESET_NAMES:
        found += _preset_checks(scene, preset)
    return found


def _preset_checks(scene: str, preset: str) -> list[Check]:
    """Return the checks of one preset."""
    errors: dict[str, Read] = {
        "relMSE": lambda bench: bench.results[preset].score.relmse,
        "energy": lambda bench: bench.results[preset].score.energy,
        "FLIP of the picture": lambda bench: bench.results[preset].score.flip,
    }
    times: dict[str, Read] = {}
    for kind in FRAMES:
        times[f"{kind}, device time, ms"] = partial(_time, preset, kind, Clocks.device)
        times[f"{kind}, wall time, ms"] = partial(_time, preset, kind, Clocks.wall)
        times[f"{kind}, compile time, s"] = partial(_compiling, preset, kind)
    ratios: dict[str, Read] = {}
    headlines = []
    for family in _competitors():
        for kind in FRAMES:
            title = f"{family}'s time to its relMSE over that of a frame, {kind}"
            ratios[title] = partial(_time_ratio, preset, kind, family)
            headlines += [title] if kind == STILL else []
        title = f"{family}'s relMSE in its time over its own"
        ratios[title] = partial(_error_ratio, preset, family)
        headlines += [title] if preset == HIGH else []
    return [
        _check(
            scene,
            f"{preset}, {title}",
            read,
            configuration=f'preset "{preset}"; {words}',
            is_headline=title in headlines,
        )
        for words, rows in (
            (f"expected over the seeds of {REPETITIONS} frames", errors),
            (f"times, median and quartiles of {REPETITIONS} warm frames", times),
            ("above 1 paths need longer, or have the larger error", ratios),
        )
        for title, read in rows.items()
    ]


def _competitors() -> tuple[str, ...]:
    return (PATHS, DENOISED) if has_denoiser() else (PATHS,)


def _check(
    scene: str,
    title: str,
    read: Read,
    *,
    configuration: str = CONFIGURATION,
    limits: tuple[float, float] | None = None,
    goal: float | None = None,
    is_headline: bool = False,
) -> Check:
    def measure(context: StudyContext) -> Measured:
        source = (context.scene or "corridor") if scene == CHOSEN else scene
        bench = bench_of(context, source)
        context.once(f"charts of {source}", lambda: draw(context.shelf, bench))
        try:
            return read(bench)
        except ValueError as error:
            # What noise hides, or lies beyond the end of a curve.
            raise RefusedError(str(error)) from error

    low, high = limits or (None, None)
    words = "built-in corridor, or the scene of --scene" if scene == CHOSEN else f"built-in {scene}"
    return Check(
        name=f"{scene}, {title}",
        configuration=configuration,
        scene=words,
        measure=measure,
        limit_low=low,
        limit_high=high,
        goal=goal,
        is_headline=is_headline,
        in_quick=scene == QUICK_SCENE,
    )


def family_of(bench: Bench, family: str) -> list[Result]:
    """Return the results of a family, from few to many samples."""
    found = [each for each in bench.results.values() if each.method.family == family]
    return sorted(found, key=lambda each: each.method.samples_per_pixel)


def errors_over_time(results: list[Result]) -> Errors:
    """Return relMSE over the median of the device time."""
    return Errors.of(
        [each.clocks[STILL].device_median() for each in results],
        [each.score.relmse for each in results],
    )


def errors_over_samples(results: list[Result]) -> Errors:
    """Return relMSE over samples a pixel."""
    return Errors.of(
        [Measured(value=float(each.method.samples_per_pixel)) for each in results],
        [each.score.relmse for each in results],
    )


def _slope_over_samples(bench: Bench) -> Measured:
    return fit_slope(errors_over_samples(family_of(bench, PATHS)))


def _slope_over_time(bench: Bench) -> Measured:
    return fit_slope(errors_over_time(family_of(bench, PATHS)))


def _path_energy(bench: Bench) -> Measured:
    return family_of(bench, PATHS)[-1].score.energy


def _floor(bench: Bench) -> Measured:
    """Return b^2 of "high" over its samples a pixel."""
    found = [each for each in bench.results.values() if each.method.is_on_floor]
    return fit_floor(errors_over_samples(found)).level


def _front_size(bench: Bench) -> Measured:
    results = list(bench.results.values())
    front = pareto_front(
        [each.clocks[STILL].device().value for each in results],
        [each.score.relmse.value for each in results],
    )
    names = ", ".join(results[each].method.name for each in front)
    return Measured(value=float(len(front)), note=names)


def _noise(bench: Bench) -> Measured:
    floor = bench.noise
    return Measured(value=floor.value, note=f"{floor.samples_per_pixel} paths a pixel")


def _time(preset: str, kind: str, clock: Callable[[Clocks], Measured], bench: Bench) -> Measured:
    found = clock(bench.results[preset].clocks[kind])
    assert found.low is not None
    assert found.high is not None
    return Measured(
        value=MILLISECONDS * found.value,
        low=MILLISECONDS * found.low,
        high=MILLISECONDS * found.high,
    )


def _whole_over_parts(kind: str, bench: Bench) -> Measured:
    """Return how far the sum of the parts of a moving frame, timed apart, can be trusted."""
    result = bench.results[HIGH]
    return ratio(result.clocks[kind].device_median(), result.parts[kind].device_median())


def _compiling(preset: str, kind: str, bench: Bench) -> Measured:
    return Measured(value=bench.results[preset].clocks[kind].compile)


def _time_ratio(preset: str, kind: str, family: str, bench: Bench) -> Measured:
    """Return how many times as long paths take for the error that a preset has."""
    own = bench.results[preset]
    results = family_of(bench, family)
    crossing = time_to_reach(errors_over_time(results), own.score.relmse)
    time = own.clocks[kind].device_median()
    if crossing.reached == "inside":
        return ratio(crossing.time, time)
    samples = [each.method.samples_per_pixel for each in results]
    note = (
        f"at most: reached with {samples[0]} sample a pixel already"
        if crossing.reached == "before"
        else f"at least: not reached within {samples[-1]} samples a pixel"
    )
    return Measured(value=crossing.time.value / time.value, note=note)


def _error_ratio(preset: str, family: str, bench: Bench) -> Measured:
    """Return how many times a preset's error paths have in its time."""
    own = bench.results[preset]
    results = family_of(bench, family)
    errors = errors_over_time(results)
    seen = errors.seen()
    time = own.clocks[STILL].device().value
    found = error_at(errors, time)
    if found is not None:
        return ratio(found, own.score.relmse)
    if len(seen.x) == 0:
        raise ValueError(f"noise hides all errors of {family}")
    is_before = time < seen.x[0]
    words = (
        "least: its fewest samples take longer" if is_before else "most: its most take less time"
    )
    bound = float(seen.values[0 if is_before else -1]) / own.score.relmse.value
    return Measured(value=bound, note=f"at {words}")
