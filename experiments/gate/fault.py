"""A planted fault, and whether the gate that must fail for it does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from reports.junit import Verdict


@dataclass(frozen=True)
class Fault:
    """Where a verdict must show a planted fault."""

    name: str
    kind: str
    """Kind of gate that must fail."""
    item: str
    """What that gate is about, as the verdicts name it."""

    def judge(self, gate: str, scene: str, verdicts: Sequence[Verdict], seconds: float) -> Verdict:
        """Return a verdict of kind `mutant`; failed when the fault went unnoticed.

        Parameters
        ----------
        gate, scene
            Name of the gate and of its scene.
        verdicts
            What the gate says of the numbers with the fault.
        seconds
            What that took.
        """
        caught = [
            verdict
            for verdict in verdicts
            if verdict.gate == f"{gate}: {self.item}"
            and verdict.kind == self.kind
            and not verdict.passed
        ]
        return Verdict(
            gate=f"{gate}: {self.name}",
            scene=scene,
            kind="mutant",
            passed=bool(caught),
            value=None,
            limit=f"{self.kind} of {self.item} fails",
            message=caught[0].message if caught else f"the {self.kind} gate let this fault through",
            seconds=seconds,
        )
