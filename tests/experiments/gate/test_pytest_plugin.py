"""The pytest plugin in a project of its own: items, failures, usage errors, and a whole round."""

from __future__ import annotations

import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from experiments import pytest_plugin
from experiments.cli import main
from tests.experiments.gate.test_study_gates import GATES

pytest_plugins = ["pytester"]

PLUGIN = "experiments.pytest_plugin"
ROOT = Path(__file__).resolve().parents[3]

JUNIT = """
import sys
from pathlib import Path
from reports.junit import Verdict, write_junit
Path("ran").open("a").write(" ".join(sys.argv[1:]) + chr(10))
def verdict(item, kind, passed, message):
    return Verdict(gate=f"waves: {item}", scene="study banding", kind=kind, passed=passed,
                   value=None, limit="<= 1", message=message, seconds=0.0)
write_junit([
    verdict("numbers", "finite", True, "fine"),
    verdict("bands", "noninferior", False, "0.2 [0.1, 0.3]; baseline 0.01"),
    verdict("energy", "absolute", True, "1.0"),
    verdict("order bands_fall_with_the_step", "order", True, "below"),
], Path(sys.argv[sys.argv.index("--junit") + 1]))
"""

EXAMPLE = ROOT / "experiments" / "gate" / "example"


@pytest.fixture
def project(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> pytest.Pytester:
    """Hand out a project with a gates file and an ini file, where gates take no time."""
    pytester.makefile(".toml", gates=GATES)
    pytester.makepyprojecttoml(
        '[tool.pytest.ini_options]\nvctgi_gates = ["gates.toml"]\nfilterwarnings = ["error"]\n'
    )
    pytester.makepyfile(test_other="def test_other():\n    pass\n", fake=JUNIT)
    monkeypatch.setattr(pytest_plugin, "COMMAND", (sys.executable, "fake.py"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    return pytester


def run(project: pytest.Pytester, *words: str) -> pytest.RunResult:
    # Where the package is installed, its entry point would load the module a second time
    options = ("-p", "no:vctgi_gate", "-p", "no:cacheprovider")
    return project.runpytest_inprocess(*options, *words, plugins=[pytest_plugin])


def test_each_check_is_an_item_and_a_failure_says_how_to_update(project: pytest.Pytester) -> None:
    result = run(project, "--junitxml=out.xml")
    result.assert_outcomes(passed=4, failed=1)
    result.stdout.fnmatch_lines(
        [
            "waves: bands",
            "bands [[]noninferior]: 0.2 [[]0.1, 0.3]; baseline 0.01 (limit: <= 1)",
            "to review a new baseline: vctgi gate gates.toml --only waves --update --reason TEXT",
        ]
    )
    assert "Traceback" not in result.stdout.str()
    names = {case.attrib["name"] for case in ElementTree.parse("out.xml").iter("testcase")}
    assert {"waves: sound", "waves: bands", "waves: energy", "test_other"} <= names
    # One process for all items
    assert len(Path("ran").read_text(encoding="utf-8").splitlines()) == 1


def test_a_deselected_failure_is_not_told_by_another_item(project: pytest.Pytester) -> None:
    run(project, "-k", "sound").assert_outcomes(passed=1, deselected=4)


def test_named_paths_leave_the_gates_of_the_ini_file_out(project: pytest.Pytester) -> None:
    run(project, "test_other.py").assert_outcomes(passed=1)
    run(project, "gates.toml").assert_outcomes(passed=3, failed=1)
    result = run(project, "test_other.py", "--vctgi-gates", "gates.toml")
    result.assert_outcomes(passed=4, failed=1)


def test_gates_run_where_only_another_folder_is_searched(project: pytest.Pytester) -> None:
    project.mkdir("tests")
    ini = project.path / "pyproject.toml"
    ini.write_text(ini.read_text(encoding="utf-8") + '\ntestpaths = ["tests"]\n', encoding="utf-8")
    run(project).assert_outcomes(passed=3, failed=1)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (GATES.replace("rel =", "rle ="), "*rle: unknown key*"),
        ("schema_version = ", "*not TOML*"),
        (None, "*cannot read the gates file (No such file or directory): *"),
    ],
)
def test_a_bad_file_is_one_line_and_a_usage_error(
    project: pytest.Pytester, text: str | None, line: str
) -> None:
    path = project.path / "gates.toml"
    path.unlink()
    if text is not None:
        path.write_text(text, encoding="utf-8")
    result = run(project)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines([f"ERROR: {line}"])
    assert len(result.stderr.str().strip().splitlines()) == 1


def test_a_crash_of_the_gates_fails_each_item(project: pytest.Pytester) -> None:
    project.makepyfile(fake="import sys\nsys.stderr.write('out of memory')\nsys.exit(3)\n")
    result = run(project)
    result.assert_outcomes(passed=1, failed=4)
    result.stdout.fnmatch_lines(["*the gates ended with 3: out of memory*"])


def test_nothing_heavy_is_imported_where_no_gate_is_asked_for() -> None:
    heavy = "{'mitsuba', 'drjit', 'numpy', 'scipy', 'pydantic'}"
    code = f"import sys, {PLUGIN}; sys.exit(bool({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False, cwd=ROOT).returncode == 0


def test_the_package_offers_the_plugin() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["entry-points"]["pytest11"] == {"vctgi_gate": PLUGIN}


@pytest.mark.slow
def test_another_project_gates_its_own_scene(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a baseline it fails, with one it passes, and with whiter walls it fails again."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("VCTGI_CACHE", str(pytester.path / "cache"))
    monkeypatch.delenv("GITHUB_ACTIONS", raising=False)
    for each in ("gates.toml", "room.xml", "pyproject.toml"):
        text = (EXAMPLE / each).read_text(encoding="utf-8").replace("= 64", "= 16")
        (pytester.path / each).write_text(text, encoding="utf-8")
    scene = pytester.path / "room.xml"
    words = ["-W", "error"]
    result = run(pytester, *words)
    result.assert_outcomes(failed=2)
    result.stdout.fnmatch_lines(
        ["*there is no baseline; make one, review it and commit it: vctgi*"]
    )
    assert main(["gate", "gates.toml", "--update", "--reason", "first"]) == 0
    run(pytester, *words).assert_outcomes(passed=2)
    whiter = scene.read_text(encoding="utf-8").replace('value="0.5"', 'value="0.7"')
    scene.write_text(whiter, encoding="utf-8")
    result = run(pytester, *words)
    result.stdout.fnmatch_lines(["*scene digest [[]exact]*"])
