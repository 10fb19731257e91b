"""The two ways in which a command ends early, and the exit codes of the command line.

A user meets an error as one line: what is wrong, where, and what to do about it. Code below the
command line raises one of these two; only the command line catches them, prints the line and
turns the class into an exit code.
"""

from __future__ import annotations

from typing import Final

EXIT_DONE: Final = 0
"""The command did what it was asked."""
EXIT_FAILED: Final = 1
"""A gate, a comparison or a study came to the verdict "failed"."""
EXIT_BAD_INPUT: Final = 2
"""Bad usage or bad input: the user can mend it by asking differently."""
EXIT_MACHINERY: Final = 3
"""The machinery failed: a render crashed, a reference is missing, a back end cannot run."""


class _OneLineError(Exception):
    """What, where and remedy, printed as one line."""

    def __init__(self, what: str, where: str, remedy: str) -> None:
        super().__init__(what, where, remedy)
        self.what = what
        self.where = where
        self.remedy = remedy

    def __str__(self) -> str:
        return " ".join(f"{self.what}: {self.where}; {self.remedy}".split())


class InputError(_OneLineError):
    """The user's input cannot be used; exit code `EXIT_BAD_INPUT`.

    Parameters
    ----------
    what
        What is wrong, as a short noun phrase or sentence ("no camera in the scene").
    where
        The file, option or value that it was found in.
    remedy
        What to do, as an imperative ("add a sensor").
    """


class MachineryError(_OneLineError):
    """The machine or the software below us failed; exit code `EXIT_MACHINERY`.

    Parameters
    ----------
    what
        What failed.
    where
        The stage, library, process or file that failed.
    remedy
        What to do about it.
    """
