"""Two benchmarks compared: counts decide, milliseconds advise."""

from __future__ import annotations

from dataclasses import dataclass

from experiments.errors import InputError
from reports.bench_record import BenchRecord, FrameResult, PresetResult

DEFAULT_BOUND = 0.01
"""Share by which a count may grow: processors round a few steps of cones in a million apart."""

OPERATIONS_BOUND = 0.1
"""The same for operations of the kernels' code, which every rewriting moves a little, at least."""


@dataclass(frozen=True)
class CountChange:
    """A count that is not what it was."""

    name: str
    before: int
    after: int

    @property
    def growth(self) -> float:
        """Relative growth; infinite for what was nothing."""
        return self.after / self.before - 1.0 if self.before else float("inf")

    def line(self) -> str:
        """Say which, from what to what."""
        share = f"{self.growth:+.2%}" if self.before else "new"
        return f"{self.name}: {self.before:,} -> {self.after:,} ({share})"


@dataclass(frozen=True)
class Comparison:
    """What changed.

    Attributes
    ----------
    regressions
        Counts that grew by more than the bound.
    changes
        The others that changed.
    times
        Lines about milliseconds.
    """

    regressions: list[CountChange]
    changes: list[CountChange]
    times: list[str]

    def lines(self) -> list[str]:
        """Return what is printed of it."""
        return [
            *(f"MORE WORK  {each.line()}" for each in self.regressions),
            *(f"changed    {each.line()}" for each in self.changes),
            *(f"advisory   {each}" for each in self.times),
            *([] if self.regressions or self.changes else ["counts are the baseline's"]),
        ]


def counts_of(record: BenchRecord) -> dict[str, int]:
    """Return all that does not depend on the machine, by name."""
    found: dict[str, int] = {}
    for preset in record.presets:
        found |= {f"{preset.preset}, {name}": value for name, value in _counts_of(preset).items()}
    return found


def _counts_of(preset: PresetResult) -> dict[str, int]:
    cones = preset.cones.model_dump()
    found = {name.replace("_", " "): int(value) for name, value in cones.items()}
    for frames in preset.frames:
        for each in frames.stages:
            counts = each.counts.model_dump()
            found |= {
                f"{frames.kind}, {each.stage}, {name.replace('_', ' ')}": int(value)
                for name, value in counts.items()
            }
    return found


def compare(before: BenchRecord, after: BenchRecord, bound: float = DEFAULT_BOUND) -> Comparison:
    """Compare a benchmark with an earlier one of the same scene, size and back end.

    Parameters
    ----------
    before, after
        Records. Presets and kinds of frames that only one has are left out.
    bound
        Share by which counts may grow; operations by `OPERATIONS_BOUND` at least.

    Raises
    ------
    InputError
        They are not of the same work.
    """
    for what, old, new in (
        ("scene", before.scene, after.scene),
        ("size", (before.width, before.height), (after.width, after.height)),
        ("back end", before.machine.backend, after.machine.backend),
    ):
        if old != new:
            raise InputError(
                what=f"the baseline's {what} is {old}, this run's {new}",
                where="--baseline",
                remedy="compare runs of the same work, or measure a new baseline",
            )
    shared = {each.preset for each in before.presets} & {each.preset for each in after.presets}
    if not shared:
        raise InputError(
            what="the baseline has none of the presets", where="--baseline", remedy="name others"
        )
    old_counts, new_counts = counts_of(_only(before, shared)), counts_of(_only(after, shared))
    kinds = _kinds(before) & _kinds(after)
    pairs = [
        CountChange(name, old_counts.get(name, 0), new_counts.get(name, 0))
        for name in dict.fromkeys([*old_counts, *new_counts])
        if _is_shared(name, kinds)
    ]
    changed = [each for each in pairs if each.before != each.after]
    regressions = [each for each in changed if each.growth > _bound_of(each.name, bound)]
    return Comparison(
        regressions, [each for each in changed if each not in regressions], _times(before, after)
    )


def _bound_of(name: str, bound: float) -> float:
    return max(bound, OPERATIONS_BOUND) if name.endswith("operations") else bound


def _only(record: BenchRecord, names: set[str]) -> BenchRecord:
    presets = [each for each in record.presets if each.preset in names]
    return record.model_copy(update={"presets": presets})


def _kinds(record: BenchRecord) -> set[str]:
    return {frames.kind for each in record.presets for frames in each.frames}


def _is_shared(name: str, kinds: set[str]) -> bool:
    """Whether a count is of the cones, or of a kind of frame that both have."""
    parts = name.split(", ")
    return len(parts) == 2 or parts[1] in kinds


def _times(before: BenchRecord, after: BenchRecord) -> list[str]:
    old = {(each.preset, frames.kind): frames for each, frames in _frames(before)}
    lines = []
    for preset, frames in _frames(after):
        earlier = old.get((preset.preset, frames.kind))
        if earlier is not None:
            was, now = earlier.device_ms.median, frames.device_ms.median
            lines.append(f"{preset.preset}, {frames.kind}: {was:.3f} ms -> {now:.3f} ms")
    return lines


def _frames(record: BenchRecord) -> list[tuple[PresetResult, FrameResult]]:
    return [(each, frames) for each in record.presets for frames in each.frames]
