"""Study "elimination": what is saved by leaving out what a scene does not need.

For each elimination (`cases.py`): frames with it left out and with it kept by `RenderConfig.keep`,
compared bit for bit or against the proved bound; counted work, peak memory and device time of both.
Then everything together, on a scene that needs little and on one that needs all (`whole.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.elimination.cases import CASES, Case
from experiments.studies.elimination.comparison import Comparison, loaded_scene, study_config
from experiments.studies.elimination.figures import Savings
from experiments.studies.elimination.frames import Pair
from experiments.studies.elimination.whole import whole_checks
from reports.study_figures import Definition

LEAST_MIB = 1.0
"""What has to be saved where memory is what is saved; the quick version saves 6."""


def checks() -> list[Check]:
    """Return the rows of every elimination, then those of all together."""
    return [check for case in CASES for check in _checks_of(case)] + whole_checks(savings)


def savings(context: StudyContext) -> Savings:
    """Return what the cases saved that were measured so far."""
    return context.once("elimination, savings", Savings)


def compare(context: StudyContext, case: Case) -> Comparison:
    """Render a case both ways, once for all its numbers."""

    def measure() -> Comparison:
        context.progress(case.name, 0.0)
        scene = loaded_scene(context, case.scene)
        config = case.change(study_config(quick=context.quick))
        found = Comparison.of(context, Pair.of(partial(case.frames, scene), config, case.keep))
        savings(context).note(
            case.name,
            found.difference(case.bound),
            found.time_ratio,
            found.lean_work,
            found.kept_work,
        )
        return found

    return context.once(f"elimination, {case.name}", measure)


def _checks_of(case: Case) -> list[Check]:
    def row(what: str, measure: Callable[[Comparison], Measured], *limits: float | None) -> Check:
        return Check(
            name=f"{case.name}: {what}",
            configuration=f"--keep {case.keep} against nothing kept, {case.bound_text}",
            scene=case.about,
            measure=lambda context: measure(compare(context, case)),
            limit_low=limits[0],
            limit_high=limits[1],
            in_quick=case.in_quick,
        )

    differing, most = "numbers of the picture that differ", 0.0
    if case.bound is not None:
        differing, most = "difference over its bound", 1.0
    return [
        row(differing, lambda found: found.difference(case.bound), 0.0, most),
        row(
            "operations, kept over left out",
            lambda found: found.operation_ratio,
            1.0 if case.saves == "operations" else None,
            None,
        ),
        row("device time, kept over left out", lambda found: found.time_ratio, None, None),
        row(
            "peak memory saved, MiB",
            lambda found: found.memory_saved,
            LEAST_MIB if case.saves == "memory" else None,
            None,
        ),
    ]


DEFINITIONS = [
    Definition(
        name="numbers of the picture that differ",
        formula="count of left out != kept, over light, albedo, normal, depth and openness",
        source="vctgi/eliminations.py",
    ),
    Definition(
        name="difference over its bound",
        formula="max |left out - kept| / bound",
        source="vctgi/eliminations.py",
    ),
    Definition(
        name="operations, kept over left out",
        formula="sum over kernels of instructions x lanes; a loop's body counts once",
        source="Dr.Jit's kernel history",
    ),
    Definition(
        name="device time, kept over left out",
        formula="median over turns of t(kept) / t(left out), quartiles; warm frames in "
        "alternating order",
        source="Dr.Jit's kernel history",
    ),
]
