"""The LLVM that is announced is the one that Dr.Jit loads, and a bad one is found before it is."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from experiments import llvm
from experiments.errors import EXIT_BAD_INPUT, EXIT_DONE, InputError, MachineryError
from experiments.library_search import natural_sort_key
from experiments.llvm import LlvmLibrary, LlvmSearch, find_llvm

REPOSITORY = Path(__file__).parents[2]

# Files of this process's address space that belong to an LLVM, one path a line
MAPPED_LLVM = """
import os, sys
with open("/proc/self/maps") as maps:
    print(*{os.path.realpath(l.split()[-1]) for l in maps if "libLLVM" in l}, sep="\\n")
"""
WAKE_DRJIT = "import drjit.llvm as backend; backend.Float([1, 2]) + 1\n"


def run_python(code: str, **variables: str) -> str:
    """Output of a fresh interpreter, with these environment variables."""
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        check=True,
        cwd=REPOSITORY,
        env=os.environ | variables,
        text=True,
    ).stdout.strip()


def library(major: int, path: str = "/somewhere/libLLVM.so") -> LlvmLibrary:
    return LlvmLibrary(path=path, version=(major, 1, 0))


@pytest.fixture
def usable_path() -> str:
    search = find_llvm()
    if search.picked is None or not search.is_usable:
        pytest.skip("no usable LLVM on this machine")
    return search.picked.path


def installed(major: int) -> str:
    """Return the library of this major version from where Debian puts it, or skip."""
    for path in sorted(Path("/usr/lib").glob(f"*-linux-gnu/libLLVM-{major}.so.1")):
        return str(path)
    pytest.skip(f"libllvm{major} is not installed")


# Which of these files Dr.Jit 1.5.0 opened when its search found exactly them
@pytest.mark.parametrize(
    ("files", "opened"),
    [
        (["libLLVM-9.so.1", "libLLVM-14.so.1", "libLLVM-14.0.6.so.1"], "libLLVM-14.so.1"),
        (["libLLVM-15.so.1", "libLLVM-17.so.1", "libLLVM-17.0.6.so.1"], "libLLVM-17.so.1"),
        (["libLLVM-17.so.1", "libLLVM.so.19.1", "libLLVM-19.so.1"], "libLLVM.so.19.1"),
        (["libLLVM.so.18.1", "libLLVM.so.18.1.3", "libLLVM-18.so.1"], "libLLVM.so.18.1.3"),
        (["libLLVM.so.9", "libLLVM.so.21.1", "libLLVM.so.19.1"], "libLLVM.so.21.1"),
        (["libLLVM.so.18.10", "libLLVM.so.18.9"], "libLLVM.so.18.10"),
        (["libLLVM-20.so.1", "libLLVM.so.18.1"], "libLLVM.so.18.1"),
    ],
)
def test_sorts_files_as_drjit_does(files: list[str], opened: str) -> None:
    assert max(files, key=natural_sort_key) == opened


@pytest.mark.parametrize("place", ["standard folders", "empty variable", "variable", "loader path"])
def test_announces_the_library_that_drjit_loads(
    place: str, usable_path: str, tmp_path: Path
) -> None:
    (tmp_path / "libLLVM.so").symlink_to(usable_path)
    variables = {
        "standard folders": {},
        "empty variable": {llvm.PATH_VARIABLE: ""},
        "variable": {llvm.PATH_VARIABLE: str(tmp_path / "libLLVM.so")},
        "loader path": {"LD_LIBRARY_PATH": str(tmp_path)},
    }[place]
    announce = "from experiments.llvm import *; print(require_usable_llvm().path)"
    announced = run_python(announce, **variables)
    assert Path(announced).is_relative_to(tmp_path) == (place in {"variable", "loader path"})
    assert run_python(WAKE_DRJIT + MAPPED_LLVM, **variables) == os.path.realpath(announced)


def test_the_search_loads_nothing_into_the_process() -> None:
    code = (
        "import sys; from experiments import doctor, llvm; llvm.find_llvm(); doctor.diagnose()\n"
        "assert not {'drjit', 'mitsuba', 'numpy'} & set(sys.modules)\n"
    )
    assert run_python(code + MAPPED_LLVM) == ""


@pytest.mark.parametrize(
    ("major", "is_usable", "verdict"),
    [
        (14, False, "refused by Dr.Jit"),
        (15, False, "aborts the process"),
        (16, False, "aborts the process"),
        (17, True, "works"),
        (22, True, "works"),
    ],
)
def test_judges_by_the_major_version(major: int, is_usable: bool, verdict: str) -> None:
    assert library(major).is_usable == is_usable
    assert verdict in library(major).verdict


def test_a_library_that_tells_no_version_is_not_usable() -> None:
    unknown = LlvmLibrary(path="/somewhere/libLLVM.so", version=None)
    assert not unknown.is_usable
    assert f"LLVM {unknown.version_text} {unknown.verdict}" == (
        "LLVM of unknown version cannot be judged"
    )


@pytest.mark.parametrize(("major", "verdict"), [(14, "refused"), (15, "aborts"), (16, "aborts")])
def test_refuses_an_installed_llvm_that_is_too_old(
    major: int, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = installed(major)
    monkeypatch.setenv(llvm.PATH_VARIABLE, path)
    with pytest.raises(InputError, match=f"LLVM {major}[0-9.]* .*{verdict}.*{path}; .*export"):
        llvm.require_usable_llvm()


def test_drjit_refuses_what_is_called_refused() -> None:
    path = installed(14)
    with pytest.raises(subprocess.CalledProcessError) as failure:
        run_python(WAKE_DRJIT, **{llvm.PATH_VARIABLE: path})
    assert "LLVM version (14) is too old" in failure.value.stderr


@pytest.mark.parametrize(
    ("text", "reason"), [(None, "No such file"), (500 * "words", "invalid ELF")]
)
def test_a_variable_that_names_no_library_is_bad_input(
    text: str | None, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "libLLVM.so"
    if text is not None:
        path.write_text(text)
    monkeypatch.setenv(llvm.PATH_VARIABLE, str(path))
    with pytest.raises(InputError, match=rf"no LLVM .*={path} .*{reason}.*; "):
        llvm.require_usable_llvm()


def test_another_library_than_llvm_is_bad_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(llvm.PATH_VARIABLE, "libc.so.6")
    with pytest.raises(InputError, match=r"libc\.so\.6 \(it is no LLVM library\)"):
        llvm.require_usable_llvm()


def test_a_bad_library_in_the_standard_place_is_the_machines_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv(llvm.PATH_VARIABLE, raising=False)
    answers = {"libLLVM.so": library(15, "/lib/libLLVM.so")}
    monkeypatch.setattr(llvm, "_probe", lambda names: (answers[names[0]], ""))
    monkeypatch.setattr(llvm, "_newest_usable", lambda: library(19, "/opt/libLLVM.so.19.1"))
    with pytest.raises(
        MachineryError,
        match=r"^LLVM 15\.1\.0 aborts .*: /lib/libLLVM\.so; "
        r"export DRJIT_LIBLLVM_PATH=/opt/libLLVM\.so\.19\.1$",
    ):
        llvm.require_usable_llvm()
    assert llvm.PATH_VARIABLE not in os.environ


def test_says_what_to_install_where_there_is_none(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    nothing = LlvmSearch(requested=None, picked=None, failure="libLLVM.so: cannot open")
    monkeypatch.setattr(llvm, "find_llvm", lambda: nothing)
    with pytest.raises(MachineryError, match=r"no LLVM .*; sudo apt-get install libllvm19, or"):
        llvm.require_usable_llvm()
    assert llvm.main() == 3
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1


def test_finds_the_newest_usable_library_elsewhere(
    usable_path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "libLLVM.so.19.1").symlink_to(usable_path)
    (tmp_path / "libLLVM.so.99.1").write_text("no library")
    monkeypatch.setattr(llvm, "_OTHER_PATTERNS", (f"{tmp_path}/libLLVM*.so*",))
    monkeypatch.setenv(llvm.PATH_VARIABLE, str(tmp_path / "libLLVM.so.99.1"))
    search = find_llvm()
    assert search.alternative is not None
    assert search.alternative.path == str(tmp_path / "libLLVM.so.19.1")
    assert search.remedy == f"export {llvm.PATH_VARIABLE}={tmp_path}/libLLVM.so.19.1"


def test_the_exit_code_tells_whose_fault_it_is(
    usable_path: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(llvm.PATH_VARIABLE, usable_path)
    assert llvm.main() == EXIT_DONE
    monkeypatch.setenv(llvm.PATH_VARIABLE, "/nowhere/libLLVM.so")
    assert llvm.main() == EXIT_BAD_INPUT
