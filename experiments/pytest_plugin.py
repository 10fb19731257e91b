"""Pytest plugin: gates of scenes as test items, for this project and for others.

A project names its gates file in its ini file (``vctgi_gates = ["gates.toml"]``) or on the command
line (``--vctgi-gates FILE``). Each thing that a gate checks is one item. The gates run in a process
of their own when the first of their items does: Mitsuba, its variant and its warnings stay out of
the tests beside.

Nothing heavy is imported here, for pytest loads this module wherever the package is installed.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from experiments.gate.gates_file import GatesFile

OPTION, INI = "--vctgi-gates", "vctgi_gates"
SOUND = "sound"
"""Item of all that is checked without being asked for: finite, comparable, quiet, reviewed."""
COMMAND = (sys.executable, "-m", "experiments", "gate")


class GateFailure(Exception):  # noqa: N818 - a verdict, and no error of the code
    """What a failing item says."""


@dataclass(frozen=True)
class Found:
    """One verdict on a gate."""

    gate: str
    item: str
    kind: str
    passed: bool
    text: str


def pytest_addoption(parser: pytest.Parser) -> None:
    """Offer the options, and the same in the ini file."""
    group = parser.getgroup("vctgi", "quality gates of rendered scenes")
    group.addoption(
        OPTION,
        action="append",
        default=[],
        metavar="FILE",
        help="Check the gates of this gates.toml; may be repeated.",
    )
    group.addoption(
        "--vctgi-variant", default=None, metavar="VARIANT", help="llvm_ad_rgb or cuda_ad_rgb."
    )
    parser.addini(INI, "gates.toml files that are checked with the tests", type="paths", default=[])
    parser.addini("vctgi_variant", "variant that gates are checked on", default="")
    parser.addini("vctgi_output", "folder of the records that gates make", type="paths", default=[])


def pytest_configure(config: pytest.Config) -> None:
    """Add the gates files to what is collected, and refuse one that cannot be used.

    Files of the ini file are left out where the command line names what to collect.
    """
    asked = [Path(config.invocation_params.dir, each) for each in config.getoption(OPTION)]
    if config.args_source != pytest.Config.ArgsSource.ARGS:
        asked += config.getini(INI)
    known = {Path(config.invocation_params.dir, each.split("::")[0]) for each in config.args}
    for path in asked:
        _load(path)
        if path not in known:
            config.args.append(str(path))


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Collect a gates file that was asked for, by an option, the ini file or its path."""
    config = parent.config
    asked = [Path(config.invocation_params.dir, each) for each in config.getoption(OPTION)]
    asked += config.getini(INI)
    if file_path.resolve() not in {path.resolve() for path in asked}:
        return None
    return GatesCollector.from_parent(parent, path=file_path)


class GatesCollector(pytest.File):
    """A gates file: its gates, and once they have run, what was found."""

    found: list[Found] | None = None
    checked: dict[str, set[str]]
    """What is checked by name, of each gate."""

    def collect(self) -> Iterator[pytest.Item]:
        """Yield an item for each thing that is checked."""
        content = _load(self.path)
        self.checked = {}
        for gate, names, _ in _asked_of(content):
            self.checked.setdefault(gate, set()).update(names)
        for gate, names, needs in _asked_of(content):
            for name in names:
                yield GateItem.of_gate(self, gate, name, needs)

    def run_gates(self) -> list[Found]:
        """Check, once, all gates of which an item was selected."""
        if self.found is None:
            items = [each for each in self.session.items if isinstance(each, GateItem)]
            needed = [name for each in items if each.parent is self for name in each.needs]
            self.found = _verdicts(self, list(dict.fromkeys(needed)))
        return self.found


class GateItem(pytest.Item):
    """One thing that a gate checks."""

    gate: str
    checked: str
    needs: tuple[str, ...]

    @classmethod
    def of_gate(
        cls, parent: GatesCollector, gate: str, checked: str, needs: tuple[str, ...]
    ) -> GateItem:
        """Make the item of one thing that a gate checks; `needs` names the gates that must run."""
        item: GateItem = cls.from_parent(parent, name=f"{gate}: {checked}")
        item.gate, item.checked, item.needs = gate, checked, needs
        return item

    @property
    def gates(self) -> GatesCollector:
        """The file that it is from."""
        assert isinstance(self.parent, GatesCollector)
        return self.parent

    def runtest(self) -> None:
        """Fail with what the gate says, and how a change that is meant becomes the baseline.

        Raises
        ------
        GateFailure
            A check has failed, or could not be made.
        """
        found = [each for each in self.gates.run_gates() if each.gate == self.gate]
        if self.checked == SOUND:
            named = self.gates.checked[self.gate] - {SOUND}
            mine = [each for each in found if each.item not in named]
        else:
            mine = [each for each in found if each.item == self.checked]
        if mine and all(each.passed for each in mine):
            return
        # Without a baseline, or a render, there is no verdict on a number: say why.
        wrong = [each for each in mine or found if not each.passed]
        lines = [f"{each.item} [{each.kind}]: {each.text}" for each in wrong]
        raise GateFailure("\n".join(lines or ["the gate said nothing about it"]))

    def repr_failure(
        self, excinfo: pytest.ExceptionInfo[BaseException], style: object = None
    ) -> str:
        """Return the verdict and the update command, without a traceback."""
        if not isinstance(excinfo.value, GateFailure):
            return str(super().repr_failure(excinfo))
        command = update_command(self.path, self.needs)
        return f"{self.name}\n{excinfo.value}\nto review a new baseline: {command}"

    def reportinfo(self) -> tuple[Path, None, str]:
        """Say where it stands."""
        return self.path, None, self.name


def update_command(path: Path, names: Iterable[str]) -> str:
    """Return what to type to make new baselines of some gates."""
    only = [word for name in names for word in ("--only", name)]
    words = ["vctgi", "gate", os.path.relpath(path), *only, "--update"]
    return f"{shlex.join(words)} --reason TEXT"


def _asked_of(content: GatesFile) -> Iterator[tuple[str, list[str], tuple[str, ...]]]:
    """Yield each gate's name, what is checked of it, and the gates that have to run for it."""
    for gate in content.gates:
        names = [f"{each.metric} of {each.component}" for each in gate.metrics]
        names += [f"time of {each.stage}" for each in gate.budgets]
        names += ["memory of the voxels"] if gate.memory is not None else []
        names += ["rendered twice"] if gate.deterministic else []
        yield gate.name, list(dict.fromkeys([SOUND, *names])), (gate.name,)
    for order in content.orders:
        yield order.better, [f"order {order.name}"], (order.better, order.worse)
    for study in content.studies:
        names = [each.metric for each in study.checks]
        names += [f"order {order.name}" for order in study.orders]
        yield study.name, list(dict.fromkeys([SOUND, *names])), (study.name,)


def _load(path: Path) -> GatesFile:
    """Read a gates file; one line and a usage error if it cannot be used."""
    from experiments.errors import InputError
    from experiments.gate.gates_file import load_gates

    try:
        return load_gates(path)
    except InputError as error:
        raise pytest.UsageError(str(error)) from None


def _verdicts(collector: GatesCollector, names: list[str]) -> list[Found]:
    """Run gates in a process of their own and read its report."""
    config = collector.config
    variant = config.getoption("--vctgi-variant") or config.getini("vctgi_variant")
    with tempfile.TemporaryDirectory(prefix="vctgi-gates-") as scratch:
        report = Path(scratch, "gate.xml")
        output = [*config.getini("vctgi_output"), Path(scratch)][0]
        only = [word for name in names for word in ("--only", name)]
        chosen = ["--variant", variant] if variant else []
        words = [str(collector.path), *only, *chosen, "--output", str(output)]
        done = subprocess.run(
            [*COMMAND, *words, "--junit", str(report)],
            capture_output=True,
            text=True,
            check=False,
        )
        if not report.is_file():
            lines = done.stderr.strip().splitlines() or ["it said nothing"]
            text = f"the gates ended with {done.returncode}: {lines[-1]}"
            return [Found(name, SOUND, "error", passed=False, text=text) for name in names]
        return list(_read(report))


def _read(report: Path) -> Iterator[Found]:
    for case in ElementTree.parse(report).iter("testcase"):
        facts = {each.attrib["name"]: each.attrib["value"] for each in case.iter("property")}
        gate, _, item = facts["gate"].partition(": ")
        failure = case.find("failure")
        if failure is None:
            yield Found(gate, item, facts["kind"], passed=True, text="")
        else:
            text = f"{failure.attrib['message']} (limit: {facts['limit'] or 'none'})"
            yield Found(gate, item, facts["kind"], passed=False, text=text)
