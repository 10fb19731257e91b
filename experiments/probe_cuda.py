"""Ask the NVIDIA driver for its version and its first device.

Run as a script, in a process of its own, so that asking creates no state in a process that renders
(and a driver that crashes takes nothing with it): one JSON object goes to standard output. The
functions are those of the CUDA driver interface; 0 means success in all of them.
"""

from __future__ import annotations

import ctypes
import json
import os
import sys

_LIBRARIES = ("libcuda.so", "libcuda.so.1", "/usr/lib/wsl/lib/libcuda.so.1")
_RAY_TRACING_LIBRARY = "libnvoptix.so.1"
_NAME_BYTES = 256


def load_first(names: tuple[str, ...]) -> ctypes.CDLL | None:
    """Load the first library that loads, or None."""
    for name in names:
        try:
            return ctypes.CDLL(name)
        except OSError:
            continue
    return None


def describe_device(driver: ctypes.CDLL) -> dict[str, object]:
    """Version, device name and device memory in bytes, or the failing call and its code."""
    version, count, device = ctypes.c_int(), ctypes.c_int(), ctypes.c_int()
    name, memory = ctypes.create_string_buffer(_NAME_BYTES), ctypes.c_size_t()
    calls: tuple[tuple[str, tuple[object, ...]], ...] = (
        ("cuInit", (0,)),
        ("cuDriverGetVersion", (ctypes.byref(version),)),
        ("cuDeviceGetCount", (ctypes.byref(count),)),
        ("cuDeviceGet", (ctypes.byref(device), 0)),
        ("cuDeviceGetName", (name, _NAME_BYTES, device)),
        ("cuDeviceTotalMem_v2", (ctypes.byref(memory), device)),
    )
    for function, arguments in calls:
        code = getattr(driver, function)(*arguments)
        if code != 0:
            return {"failure": f"{function} returned error {code}"}
    return {
        "cuda_version": [version.value // 1000, version.value % 1000 // 10],
        "device_count": count.value,
        "device": name.value.decode(),
        "memory_bytes": memory.value,
    }


def main() -> None:
    """Print what the driver says, and whether the ray-tracing library loads."""
    requested = os.environ.get("DRJIT_LIBCUDA_PATH")
    driver = load_first((requested,) if requested else _LIBRARIES)
    answer: dict[str, object] = {"has_driver": driver is not None}
    if driver is not None:
        answer |= describe_device(driver)
        answer["has_ray_tracing"] = load_first((_RAY_TRACING_LIBRARY,)) is not None
    json.dump(answer, sys.stdout)


if __name__ == "__main__":
    main()
