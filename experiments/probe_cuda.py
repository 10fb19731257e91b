"""Ask the NVIDIA driver for its version and its first device.

Run as a script, in a process of its own, so that asking creates no state in a process that renders
(and a driver that crashes takes nothing with it). The arguments are the name of the ray-tracing
library and those of the driver, in the order to try; one JSON object goes to standard output. The
functions are those of the CUDA driver interface; 0 means success in all of them.
"""

from __future__ import annotations

import ctypes
import json
import sys

# What an installed driver is called even where Dr.Jit does not look for it
_DRIVER = "libcuda.so.1"
_NAME_BYTES = 256


def load_first(names: list[str]) -> ctypes.CDLL | None:
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


def main(ray_tracing: str, drivers: list[str]) -> None:
    """Print what the driver says, and whether the ray-tracing library loads."""
    driver = load_first(drivers)
    answer: dict[str, object] = {"has_driver": driver is not None}
    if driver is None:
        answer["has_hidden_driver"] = load_first([_DRIVER]) is not None
    else:
        answer |= describe_device(driver)
        answer["has_ray_tracing"] = load_first([ray_tracing]) is not None
    json.dump(answer, sys.stdout)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
