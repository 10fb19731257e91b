"""The names under which Dr.Jit 1.5 looks for a shared library on Linux, in its order.

It takes the first that loads, whatever its version: what an environment variable names and nothing
else, if the variable is set and not empty; the plain file name by the rules of the dynamic loader;
the last match in the standard folders when file names are sorted with runs of digits as numbers.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Final

SEARCHED_FOLDERS: Final = (
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/usr/lib/wsl/lib",
)


def names_in_search_order(variable: str, file_name: str, pattern: str) -> list[str]:
    """List the names that Dr.Jit gives to the dynamic loader until one loads.

    Parameters
    ----------
    variable
        Environment variable that overrides the search.
    file_name
        Name that is left to the loader's own search.
    pattern
        File pattern for the standard folders.

    Returns
    -------
    list of str
        One to two names, never none.
    """
    requested = os.environ.get(variable)
    if requested:
        return [requested]
    found = matches(*(f"{folder}/{pattern}" for folder in SEARCHED_FOLDERS))
    return [file_name, *sorted(found, key=natural_sort_key)[-1:]]


def matches(*patterns: str) -> list[str]:
    """Files that match any of these absolute patterns, in no particular order."""
    return [str(path) for pattern in patterns for path in Path("/").glob(pattern.removeprefix("/"))]


def natural_sort_key(path: str) -> list[tuple[int, int]]:
    """Order of file names in which a run of digits counts as one number.

    Parameters
    ----------
    path
        Path of a library.

    Returns
    -------
    list of tuple
        Key for `sorted`; the last file in this order is the one that Dr.Jit loads.
    """
    # A number sorts among the characters where its digits would: "-" < "." < 0..9 < "A" < "a"
    return [
        (ord("0"), int(run)) if run.isdecimal() else (ord(run), 0)
        for run in re.findall(r"[0-9]+|[^0-9]", path)
    ]
