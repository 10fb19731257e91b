"""Which LLVM Dr.Jit would load on this machine, and whether it can render with it.

The check must come before Dr.Jit is initialised, because afterwards nothing can be caught: LLVM 15
and 16 end the whole process in an ordinary render. So this module imports neither Dr.Jit nor
Mitsuba, nor anything else outside the standard library, and looks at libraries in a process of
their own. `python -m experiments.llvm` prints the verdict and exits with the matching code.

Dr.Jit 1.5 loads the library that `DRJIT_LIBLLVM_PATH` names, else `libLLVM.so`, else the newest
`libLLVM*.so.*` in the standard folders (`experiments.library_search`). Versions: below 15 is
refused with an ImportError, 15 and 16 cannot compile a render ("Cannot select: fminimum") and
abort, 17 and newer work.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from experiments.errors import (
    EXIT_BAD_INPUT,
    EXIT_DONE,
    EXIT_MACHINERY,
    InputError,
    MachineryError,
)
from experiments.library_search import SEARCHED_FOLDERS, matches, names_in_search_order

PATH_VARIABLE: Final = "DRJIT_LIBLLVM_PATH"
OLDEST_USABLE: Final = 17
"""First major version that compiles every kernel of a render."""
OLDEST_ACCEPTED: Final = 15
"""First major version that Dr.Jit does not refuse; it aborts with those below `OLDEST_USABLE`."""
PROBE_SECONDS: Final = 60.0
"""A probe takes about 0.1 s; a minute means that the file system hangs."""

# Where distributions and LLVM's own packages put libraries that Dr.Jit does not find by itself
_OTHER_PATTERNS: Final = (
    *(f"{folder}/libLLVM*.so*" for folder in SEARCHED_FOLDERS),
    "/usr/lib/llvm-*/lib/libLLVM*.so*",
    "/usr/lib/llvm/*/lib*/libLLVM*.so*",
    "/usr/lib64/libLLVM*.so*",
    "/usr/lib64/llvm*/lib*/libLLVM*.so*",
    "/usr/local/lib/libLLVM*.so*",
)


@dataclass(frozen=True, kw_only=True)
class LlvmLibrary:
    """One LLVM shared library."""

    path: str
    """File as the dynamic loader found it."""
    version: tuple[int, int, int] | None
    """Major, minor and patch; None when the library does not tell."""

    @property
    def is_usable(self) -> bool:
        """Whether Dr.Jit can render with it."""
        return self.version is not None and self.version[0] >= OLDEST_USABLE

    @property
    def version_text(self) -> str:
        """Version as `19.1.7`, or `of unknown version`."""
        return ".".join(map(str, self.version)) if self.version else "of unknown version"

    @property
    def verdict(self) -> str:
        """What Dr.Jit does with it, in a clause."""
        if self.version is None:
            return "cannot be judged"
        if self.version[0] < OLDEST_ACCEPTED:
            return "is refused by Dr.Jit"
        if self.version[0] < OLDEST_USABLE:
            return "aborts the process in a render"
        return "works"


@dataclass(frozen=True, kw_only=True)
class LlvmSearch:
    """What Dr.Jit would find on this machine."""

    requested: str | None
    """Value of `DRJIT_LIBLLVM_PATH`; None when unset or empty."""
    picked: LlvmLibrary | None
    """The library that Dr.Jit would load; None when there is none."""
    failure: str = ""
    """Why nothing was loaded."""
    alternative: LlvmLibrary | None = None
    """Newest usable library elsewhere; looked for only when `picked` cannot be used."""

    @property
    def is_usable(self) -> bool:
        """Whether Dr.Jit would find an LLVM that it can render with."""
        return self.picked is not None and self.picked.is_usable

    @property
    def what(self) -> str:
        """The library and its fitness, in a clause."""
        if self.picked is None:
            return "no LLVM for the llvm_ad_rgb back end"
        return f"LLVM {self.picked.version_text} {self.picked.verdict}"

    @property
    def where(self) -> str:
        """The file that is meant, or the places that were searched."""
        if self.requested is not None:
            return f"{PATH_VARIABLE}={self.requested}" + (self.failure and f" ({self.failure})")
        if self.picked is not None:
            return self.picked.path
        return f"libLLVM.so and {', '.join(SEARCHED_FOLDERS)}"

    @property
    def remedy(self) -> str:
        """What to type; empty when nothing is wrong."""
        if self.is_usable:
            return ""
        if self.alternative is not None:
            return f"export {PATH_VARIABLE}={self.alternative.path}"
        unset = f"unset {PATH_VARIABLE} and " if self.requested is not None else ""
        return (
            f"{unset}sudo apt-get install libllvm19, or export {PATH_VARIABLE}=FILE"
            f" with a libLLVM of version {OLDEST_USABLE} or newer"
        )


def find_llvm() -> LlvmSearch:
    """Search for LLVM as Dr.Jit does, without loading it into this process.

    Returns
    -------
    LlvmSearch
        The library that Dr.Jit would load, its version and, if that is unusable, another.
    """
    requested = os.environ.get(PATH_VARIABLE) or None
    picked, failure = _probe(names_in_search_order(PATH_VARIABLE, "libLLVM.so", "libLLVM*.so.*"))
    if picked is not None and picked.is_usable:
        return LlvmSearch(requested=requested, picked=picked)
    return LlvmSearch(
        requested=requested, picked=picked, failure=failure, alternative=_newest_usable()
    )


def require_usable_llvm() -> LlvmLibrary:
    """Make sure that Dr.Jit will load an LLVM that it can render with.

    Returns
    -------
    LlvmLibrary
        The library that Dr.Jit will load.

    Raises
    ------
    InputError
        `DRJIT_LIBLLVM_PATH` names a library that is missing or unusable.
    MachineryError
        The variable is not set, and what Dr.Jit finds is missing or unusable.
    """
    search = find_llvm()
    if search.picked is not None and search.is_usable:
        return search.picked
    error = InputError if search.requested is not None else MachineryError
    raise error(search.what, search.where, search.remedy)


def _newest_usable() -> LlvmLibrary | None:
    """Newest usable library in any of the usual places."""
    files = {Path(path).resolve(): path for path in sorted(matches(*_OTHER_PATTERNS))}
    found = (_probe([path])[0] for path in files.values())
    usable = [library for library in found if library is not None and library.is_usable]
    return max(usable, key=lambda library: library.version or (0, 0, 0), default=None)


def _probe(names: list[str]) -> tuple[LlvmLibrary | None, str]:
    """Load the first of `names` that loads, in a process of its own; else say why none did."""
    script = Path(__file__).with_name("probe_llvm.py")
    try:
        probe = subprocess.run(
            [sys.executable, "-I", str(script), *names],
            capture_output=True,
            check=True,
            env=_loader_environment(),
            text=True,
            timeout=PROBE_SECONDS,
        )
    except subprocess.SubprocessError as error:
        return None, f"it cannot be loaded: {error}"
    answer = json.loads(probe.stdout)
    if "failures" in answer:
        return None, "it cannot be loaded: " + answer["failures"][-1]
    if answer["path"] is None:
        return None, "it is no LLVM library"
    version = answer["version"]
    return LlvmLibrary(path=answer["path"], version=tuple(version) if version else None), ""


def _loader_environment() -> dict[str, str]:
    """Environment in which the loader also looks into Dr.Jit's folder, the run path of its core."""
    environment = dict(os.environ)
    spec = importlib.util.find_spec("drjit")
    if spec is not None and spec.submodule_search_locations:
        # The loader consults the run path right after this variable
        folders = [environment.get("LD_LIBRARY_PATH", ""), *spec.submodule_search_locations]
        environment["LD_LIBRARY_PATH"] = ":".join(filter(None, folders))
    return environment


def main() -> int:
    """Print the verdict as one line; the exit code says what kind of fault it is."""
    try:
        library = require_usable_llvm()
    except (InputError, MachineryError) as error:
        sys.stderr.write(f"{error}\n")
        return EXIT_BAD_INPUT if isinstance(error, InputError) else EXIT_MACHINERY
    sys.stdout.write(f"LLVM {library.version_text} {library.verdict}: {library.path}\n")
    return EXIT_DONE


if __name__ == "__main__":
    sys.exit(main())
