"""Quality gates: records against reviewed baselines, by intervals."""

from __future__ import annotations

from experiments.gate.baseline import Baseline as Baseline
from experiments.gate.baseline import baseline_path as baseline_path
from experiments.gate.baseline import pinned_display as pinned_display
from experiments.gate.baseline import read_baseline as read_baseline
from experiments.gate.evaluation import evaluate as evaluate
from experiments.gate.gates_file import GatesFile as GatesFile
from experiments.gate.gates_file import load_gates as load_gates
from experiments.gate.mutants import check_mutants as check_mutants
from experiments.gate.run import GateRun as GateRun
from experiments.gate.run import check_gates as check_gates
from experiments.gate.run import run_gate as run_gate
from experiments.gate.specification import GateSpec as GateSpec
from experiments.gate.study_run import MeasureStudy as MeasureStudy
from experiments.gate.study_specification import StudyGate as StudyGate
from experiments.gate.update import update_baselines as update_baselines
