"""Load an LLVM library and say where it came from and which version it is.

Run as a script, in a process of its own: the arguments are names for the dynamic loader, tried
in order, and one JSON object goes to standard output. Loading a second LLVM into a process that
renders could disturb it, and a broken one could end it; here neither matters.
"""

from __future__ import annotations

import ctypes
import json
import os
import re
import sys

# LLVM has LLVMGetVersion since 16; older ones only tell their version through this C++ function
_VERSION_STRING = "_ZN4llvm16LTOCodeGenerator16getVersionStringEv"


class _SymbolInfo(ctypes.Structure):
    _fields_ = (
        ("file_name", ctypes.c_char_p),
        ("file_base", ctypes.c_void_p),
        ("symbol_name", ctypes.c_char_p),
        ("symbol_address", ctypes.c_void_p),
    )


def library_version(library: ctypes.CDLL) -> tuple[int, int, int] | None:
    """Version of a loaded LLVM, or None when it tells none."""
    if hasattr(library, "LLVMGetVersion"):
        parts = [ctypes.c_uint() for _ in range(3)]
        library.LLVMGetVersion(*(ctypes.byref(part) for part in parts))
        return (parts[0].value, parts[1].value, parts[2].value)
    if hasattr(library, _VERSION_STRING):
        version_string = getattr(library, _VERSION_STRING)
        version_string.restype = ctypes.c_char_p
        found = re.search(rb"(\d+)\.(\d+)\.(\d+)", version_string() or b"")
        if found:
            return (int(found[1]), int(found[2]), int(found[3]))
    return None


def library_path(library: ctypes.CDLL) -> str | None:
    """File that a loaded LLVM was read from, or None when it is no LLVM."""
    info = _SymbolInfo()
    if not hasattr(library, "LLVMContextCreate"):
        return None
    address = ctypes.cast(library.LLVMContextCreate, ctypes.c_void_p)
    if not ctypes.CDLL(None).dladdr(address, ctypes.byref(info)):
        return None
    return os.fsdecode(info.file_name)


def main(names: list[str]) -> None:
    """Print what the first loadable name is, or why none could be loaded."""
    failures = []
    for name in names:
        try:
            library = ctypes.CDLL(name, mode=os.RTLD_NOW)
        except OSError as error:
            failures.append(str(error))
            continue
        json.dump({"path": library_path(library), "version": library_version(library)}, sys.stdout)
        return
    json.dump({"failures": failures}, sys.stdout)


if __name__ == "__main__":
    main(sys.argv[1:])
