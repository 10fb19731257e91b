"""What every command that renders does first: choose a back end, then let Mitsuba in.

Nothing here imports Mitsuba at module level: the check for a usable LLVM has to come first, because
Dr.Jit ends the process on some of the others.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

from experiments.doctor import choose_variant
from experiments.errors import InputError


def start_mitsuba(requested: str | None) -> str:
    """Choose a variant, set it and register the integrator; return the variant.

    Raises
    ------
    InputError, MachineryError
        An unsupported variant; no usable back end.
    """
    variant = choose_variant(requested)
    import mitsuba as mi

    mi.set_variant(variant)
    mi.set_log_level(mi.LogLevel.Warn)
    import vctgi  # noqa: F401 - registers the integrator

    return variant


def find_preset(name: str, *, is_compared: bool = False) -> None:
    """Refuse a preset that does not exist, before anything is loaded or rendered.

    Parameters
    ----------
    name
        The preset.
    is_compared
        Whether its light is to be compared with a path tracer's.

    Raises
    ------
    InputError
        No preset of that name, a preset file that cannot be used, or none that renders light where
        that is compared.
    """
    from vctgi.config import preset, preset_names
    from vctgi.errors import PresetFileError
    from vctgi.preset_file import is_preset_file

    if name not in preset_names() and not is_preset_file(name):
        known = ", ".join(preset_names())
        raise InputError(
            what=f"no preset '{name}'",
            where="--preset",
            remedy=f"use {known}, or the path of a preset file (.toml)",
        )
    try:
        config = preset(name)
    except PresetFileError as error:
        raise InputError(what=error.what, where=error.where, remedy=error.remedy) from error
    if is_compared and config.mode == "ambient":
        raise InputError(
            what=f"the preset '{name}' renders no light that a path tracer could be compared with",
            where="--preset",
            remedy="see its picture by `vctgi render`, and its error by `vctgi study accuracy`",
        )


OURS, PEERS = "all", "peers"
"""Words for many presets: all of ours that render light, and the recipes of other systems."""


def list_presets(words: Sequence[str]) -> list[str]:
    """Return the presets that a command names, each once, in the order of their first naming.

    Parameters
    ----------
    words
        Names of presets, lists of them with commas, "all", or "peers": each recipe of another
        system as it is, and with that system's own scale where it has one.

    Raises
    ------
    InputError
        No preset of a name, one that renders no light, or no name at all.
    """
    from vctgi.config import PRESETS
    from vctgi.peers import PEER_PREFIX, PUBLISHED_SUFFIX
    from vctgi.peers import PEERS as RECIPES

    groups = {
        OURS: [name for name, config in PRESETS.items() if config.mode != "ambient"],
        PEERS: [
            PEER_PREFIX + name + end
            for name, peer in RECIPES.items()
            for end in (("",) if peer.published_gain == 1.0 else ("", PUBLISHED_SUFFIX))
        ],
    }
    names = [name.strip() for word in words for name in word.split(",") if name.strip()]
    found = list(dict.fromkeys(each for name in names for each in groups.get(name, [name])))
    if not found:
        raise InputError(what="no preset is named", where="--preset", remedy="name one")
    for name in found:
        find_preset(name, is_compared=True)
    return found


DEFAULT_RESOLUTION = 256
"""Longer edge of a report's pictures, pixels, where the user names none."""


SMALLEST_PICTURE = 16
"""Shortest edge that every metric can measure, pixels."""


def writable_folder(path: Path, option: str = "--output") -> Path:
    """Make a folder and prove that it can be written.

    Raises
    ------
    InputError
        It cannot.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path, prefix=".write-test-")
        os.close(handle)
        Path(name).unlink()
    except OSError as error:
        raise InputError(
            what=f"cannot write there ({error.strerror})",
            where=str(path),
            remedy=f"give {option} a folder that you may write to",
        ) from error
    return path


def writable_file(path: Path, option: str = "--output") -> Path:
    """Prove that a file can be written, without making it; its folder is made."""
    if path.is_dir():
        raise InputError(what="is a folder", where=str(path), remedy="give the name of a file")
    writable_folder(path.parent, option)
    return path
