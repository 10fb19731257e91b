"""The composite GitHub action: its scripts, run in a made-up workspace with what GitHub sets."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[3]
ACTION = ROOT / ".github" / "actions" / "gate"
EXAMPLE = ROOT / "experiments" / "gate" / "example"

JUDGED = """#!/usr/bin/env python3
import os, sys
from pathlib import Path
sys.path.insert(0, ROOT)
from experiments.gate.summary import github_annotations, markdown_summary
from reports.junit import Verdict, write_junit
Path("words").write_text(" ".join(sys.argv[1:]))
assert os.environ["VCTGI_CACHE"].endswith("cache")
found = [Verdict(gate=f"room: {i}", scene="room.xml", kind="noninferior", passed=False, value=2.0,
                 limit="<= 1", message="x" * 1500, seconds=0.0) for i in range(COUNT)]
write_junit(found, Path(sys.argv[sys.argv.index("--junit") + 1]))
Path(sys.argv[sys.argv.index("--markdown") + 1]).write_text(markdown_summary(found, "vctgi gate"))
print("\\n".join(github_annotations(found)))
sys.exit(1 if found else 0)
"""

CALLED = """#!/usr/bin/env bash
cd "$WORKSPACE" && PYTHONPATH=ROOT exec PYTHON -m experiments "$@"
"""


class Job:
    """A workspace, the files that GitHub reads, and a checkout of the action with its command."""

    def __init__(self, folder: Path) -> None:
        self.workspace, self.root = folder / "work", folder / "root"
        self.runner = folder / "runner"
        for each in (self.workspace, self.root / ".venv" / "bin", self.runner):
            each.mkdir(parents=True)
        self.output, self.summary = folder / "output", folder / "summary"
        self.output.touch()
        self.summary.touch()

    def command(self, text: str) -> None:
        """Put a command in the place of the one that the set-up installs."""
        file = self.root / ".venv" / "bin" / "vctgi"
        file.write_text(text, encoding="utf-8")
        file.chmod(0o755)

    def run(self, name: str, **environment: str) -> subprocess.CompletedProcess[str]:
        """Run the script of a step."""
        (step,) = [each for each in steps() if each.get("name") == name]
        known = {
            "PATH": os.environ["PATH"],
            "HOME": str(self.runner),
            "GITHUB_ACTIONS": "true",
            "GITHUB_ACTION_PATH": str(ACTION),
            "GITHUB_OUTPUT": str(self.output),
            "GITHUB_STEP_SUMMARY": str(self.summary),
            "RUNNER_TEMP": str(self.runner),
            "RUNNER_OS": "Linux",
            "WORKSPACE": str(self.workspace),
            "ROOT": str(self.root),
            "FOLDER": str(self.runner / "vctgi-gate"),
            "GATES": "gates.toml",
            "VARIANT": "",
            "MUTANTS": "false",
        }
        assert set(step["env"]) <= known.keys() | {"PYTHON"}, "the test sets what the step does"
        return subprocess.run(
            ["bash", "--noprofile", "--norc", "-e", "-o", "pipefail", "-c", step["run"]],
            cwd=self.workspace,
            env={**known, **environment},
            capture_output=True,
            text=True,
            check=False,
        )

    @property
    def outputs(self) -> dict[str, str]:
        """What later steps see."""
        lines = self.output.read_text(encoding="utf-8").splitlines()
        return dict(line.split("=", 1) for line in lines)


def action() -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((ACTION / "action.yml").read_text(encoding="utf-8"))
    return found


def steps() -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = action()["runs"]["steps"]
    return found


@pytest.fixture
def job(tmp_path: Path) -> Job:
    made = Job(tmp_path)
    gates = (EXAMPLE / "gates.toml").read_text(encoding="utf-8")
    (made.workspace / "gates.toml").write_text(gates, encoding="utf-8")
    return made


def judged(count: int) -> str:
    text = JUDGED.replace("ROOT", repr(str(ROOT))).replace("COUNT", str(count))
    return text.replace("/usr/bin/env python3", sys.executable)


def test_it_is_composite_and_no_input_is_written_into_a_script() -> None:
    found = action()
    assert found["runs"]["using"] == "composite"
    assert set(found["inputs"]) == {"gates", "variant", "python-version", "mutants", "cache"}
    for step in steps():
        if "run" in step:
            assert step["shell"] == "bash"
            assert "${{" not in step["run"], "an input in a script could be a command"
    named = {step.get("id") for step in steps()}
    assert {"names", "gate"} <= named


def test_the_key_of_the_cache_follows_gates_variant_and_sources(job: Job) -> None:
    keys = set()
    for variant in ("", "cuda_ad_rgb"):
        for more in ("", "\n# another\n"):
            gates = job.workspace / "gates.toml"
            gates.write_text(gates.read_text(encoding="utf-8") + more, encoding="utf-8")
            assert job.run("Name what is kept", VARIANT=variant).returncode == 0
            assert job.outputs["key"].startswith(job.outputs["prefix"])
            keys.add(job.outputs["key"])
    assert len(keys) == 4
    assert Path(job.outputs["root"]) == ROOT


def test_without_a_gates_file_one_annotation_says_so(job: Job) -> None:
    done = job.run("Name what is kept", GATES="none.toml")
    assert done.returncode == 2
    assert done.stdout == ("::error title=vctgi gate::no gates file none.toml in the workspace\n")


def test_the_set_up_is_that_of_the_makefile(job: Job) -> None:
    (job.root / "Makefile").write_text("setup:\n\t@echo set up with $$PYTHON\n", encoding="utf-8")
    job.command("#!/usr/bin/env bash\necho asked: $*\n")
    done = job.run("Install vctgi and LLVM", PYTHON="python3.12")
    assert done.stdout.splitlines()[-2:] == ["set up with python3.12", "asked: doctor"]
    assert (ROOT / "Makefile").read_text(encoding="utf-8").count("\nsetup:") == 1


@pytest.mark.parametrize(("count", "lines"), [(0, 0), (2000, 10)])
def test_summary_and_annotations_keep_to_the_limits_of_github(
    job: Job, count: int, lines: int
) -> None:
    job.command(judged(count))
    done = job.run("Check the gates", MUTANTS="true", VARIANT="llvm_ad_rgb")
    assert done.returncode == (1 if count else 0)
    assert job.outputs == {"exit-code": str(done.returncode)}
    assert done.stdout.count("::error") == lines
    assert 0 < job.summary.stat().st_size <= 1024 * 1024
    text = job.summary.read_text(encoding="utf-8")
    assert f"{count} of {count} checks failed" in text
    words = (job.workspace / "words").read_text(encoding="utf-8")
    assert words.endswith("--variant llvm_ad_rgb --mutants")
    assert (job.runner / "vctgi-gate" / "report" / "junit.xml").is_file()


def test_a_bad_gates_file_is_told_in_annotation_and_summary(job: Job) -> None:
    """The true command: nothing is rendered, so that there are no verdicts."""
    (job.workspace / "gates.toml").write_text("schema_version = 2\n", encoding="utf-8")
    job.command(CALLED.replace("ROOT", str(ROOT)).replace("PYTHON ", f"{sys.executable} "))
    done = job.run("Check the gates")
    assert done.returncode == 2
    assert job.outputs == {"exit-code": "2"}
    (line,) = done.stdout.splitlines()
    assert line.startswith("::error title=vctgi gate::vctgi: schema_version: ")
    summary = job.summary.read_text(encoding="utf-8")
    assert "nothing was judged" in summary
    assert "schema_version" in summary


def test_the_example_is_short_and_asks_for_inputs_that_there_are() -> None:
    text = (EXAMPLE / "workflow.yml").read_text(encoding="utf-8")
    assert len(text.strip().splitlines()) == 5
    content = yaml.safe_load(text)
    checkout, gate = content["jobs"]["gate"]["steps"]
    assert checkout["uses"].startswith("actions/checkout@")
    path = gate["uses"].split("@")[0].split("/", 2)[2]
    assert (ROOT / path / "action.yml").is_file()
    assert set(gate["with"]) <= set(action()["inputs"])
    assert (EXAMPLE / gate["with"]["gates"]).is_file()
