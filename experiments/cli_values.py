"""Values of the command line: refused where nothing could use them, and results written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from experiments.run import RunOptions


def run_options(
    preset: str, spp: int, seed: int, cache: Path | None, keep: Sequence[str] | None = None
) -> RunOptions:
    """Return the options of a run, refusing what it could not use."""
    from experiments.session import find_preset

    find_preset(preset, is_compared=True)
    from experiments.run import BATCH_COUNT, RunOptions

    if at_least("--spp", spp, BATCH_COUNT) % BATCH_COUNT:
        raise InputError(
            what=f"--spp is {spp}",
            where="the command line",
            remedy=f"give a multiple of {BATCH_COUNT}, one share for each independent batch",
        )
    return RunOptions(
        preset=preset,
        reference_spp=spp,
        seed=at_least("--seed", seed, 0),
        cache_directory=reference_folder(cache),
        keep=kept_names(keep),
    )


def kept_names(words: Sequence[str] | None) -> tuple[str, ...]:
    """Return the names that `--keep` gives, each once, refusing those that mean nothing."""
    from vctgi.eliminations import check_names

    names = dict.fromkeys(name for word in words or () for name in word.split(",") if name)
    try:
        check_names(tuple(names))
    except ValueError as error:
        what, _, remedy = str(error).rstrip(".").partition("; ")
        raise InputError(what=what.partition(": ")[2], where="--keep", remedy=remedy) from error
    return tuple(names)


def reference_folder(folder: Path | None) -> Path:
    """Return the folder of references, proved to be writable."""
    from experiments.session import writable_folder
    from reference import default_cache_directory

    return writable_folder(folder or default_cache_directory(), "--cache")


def picture_size(resolution: int | None) -> int | None:
    """Return a picture size that every metric can measure, or None for the default."""
    if resolution is None:
        return None
    from experiments.session import SMALLEST_PICTURE

    return at_least("--resolution", resolution, SMALLEST_PICTURE)


def at_least(name: str, value: int, least: int) -> int:
    """Return `value`, or refuse it by the name of its option."""
    if value < least:
        raise InputError(
            what=f"{name} is {value}", where="the command line", remedy=f"give at least {least}"
        )
    return value


def finish(lines: list[str], result: Any, json_file: Path | None) -> None:
    """Print the lines of a command, and write its result where that is asked for."""
    if json_file is not None:
        from experiments.session import writable_file

        writable_file(json_file, "--json").write_text(
            json.dumps(result, indent=1), encoding="utf-8"
        )
    print("\n".join(lines))  # noqa: T201 - the command's result
