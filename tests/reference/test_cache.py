"""What is read from disk is what was rendered, whatever happened to processes and files."""

from __future__ import annotations

import logging
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from reference import (
    Reference,
    ReferenceRequest,
    default_cache_directory,
    reference_key,
    render_reference,
)
from reference.cache import batch_path, locked_entry
from tests.reference import reference_scenes as scenes

REPOSITORY = Path(__file__).parents[2]
REQUEST = ReferenceRequest(samples_per_pixel=16, batch_count=4)


def render(cache: Path | None, request: ReferenceRequest = REQUEST, **scene: Any) -> Reference:
    return render_reference(
        mi.load_dict(scenes.textured(**scene)), request=request, cache_directory=cache
    )


def assert_same_bits(first: Reference, second: Reference) -> None:
    assert first.key == second.key
    assert first.components.keys() == second.components.keys()
    for name, batches in first.components.items():
        assert batches.dtype == np.float32
        assert batches.tobytes() == second.components[name].tobytes(), name


def child(body: str, cache: Path) -> subprocess.Popen[str]:
    """Start a process that renders the same reference into `cache`."""
    code = f"""
import os, signal, logging, pathlib
logging.basicConfig(level=logging.INFO)
import mitsuba as mi
mi.set_variant({mi.variant()!r})
from reference import ReferenceRequest, render_reference
from tests.reference import reference_scenes as scenes
def render(progress=None):
    return render_reference(
        mi.load_dict(scenes.textured()),
        request=ReferenceRequest(samples_per_pixel=16, batch_count=4),
        cache_directory=pathlib.Path({str(cache)!r}),
        progress=progress,
    )
{body}
"""
    return subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=REPOSITORY,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_a_hit_equals_a_render_bit_for_bit(tmp_path: Path) -> None:
    rendered, hit, fresh = render(tmp_path), render(tmp_path), render(None)
    assert not rendered.from_cache
    assert hit.from_cache
    assert_same_bits(rendered, hit)
    assert_same_bits(rendered, fresh)
    assert hit.notes == rendered.notes
    assert hit.seconds == rendered.seconds > 0.0


def test_the_key_changes_with_all_that_changes_the_numbers() -> None:
    def key(request: ReferenceRequest = REQUEST, **scene: Any) -> str:
        return reference_key(mi.load_dict(scenes.textured(**scene)), request=request)

    keys = [
        key(),
        key(albedo=0.41),
        key(texel=0.31),
        key(height=1e-3),
        key(width=9),
        key(ReferenceRequest(samples_per_pixel=16, batch_count=4, seed=1)),
        key(ReferenceRequest(samples_per_pixel=20, batch_count=4)),
        key(ReferenceRequest(samples_per_pixel=16, batch_count=8)),
        key(ReferenceRequest(samples_per_pixel=16, batch_count=4, scattering_count=3)),
        key(ReferenceRequest(samples_per_pixel=16, batch_count=4, rest_samples_per_pixel=0)),
    ]
    assert len(set(keys)) == len(keys)
    assert key() == keys[0]


def test_another_seed_gives_other_batches() -> None:
    other = render(None, ReferenceRequest(samples_per_pixel=16, batch_count=4, seed=1))
    ours = render(None)
    for mine in ours.batches("direct"):
        for theirs in other.batches("direct"):
            assert not np.array_equal(mine, theirs)


@pytest.mark.parametrize("damage", ["truncated", "emptied", "one_bit", "not_an_archive"])
def test_a_damaged_file_is_reported_and_rendered_again(
    damage: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    whole = render(tmp_path)
    path = batch_path(tmp_path / whole.key, 2)
    content = path.read_bytes()
    middle = len(content) // 2
    path.write_bytes(
        {
            "truncated": content[:middle],
            "emptied": b"",
            "one_bit": content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :],
            "not_an_archive": b"x" * len(content),
        }[damage]
    )
    with caplog.at_level(logging.WARNING):
        mended = render(tmp_path)
    assert "damaged reference file" in caplog.text
    assert not mended.from_cache
    assert_same_bits(whole, mended)
    assert render(tmp_path).from_cache


def test_a_killed_run_resumes_with_the_batches_it_has(tmp_path: Path) -> None:
    killed = child(
        "render(lambda done: os.kill(os.getpid(), signal.SIGKILL) if done > 0.6 else None)",
        tmp_path,
    )
    killed.communicate()
    assert killed.returncode == -signal.SIGKILL
    fresh = render(None)
    entry = tmp_path / fresh.key
    kept = {path: path.stat().st_mtime_ns for path in entry.glob("batch_*.npz")}
    assert len(kept) == 2
    resumed = render(tmp_path)
    assert_same_bits(resumed, fresh)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_two_processes_share_the_work_of_one(tmp_path: Path) -> None:
    both = [child("print(render().from_cache)", tmp_path) for _ in range(2)]
    ends = [process.communicate() for process in both]
    assert [process.returncode for process in both] == [0, 0], ends
    assert sorted(output.strip() for output, _ in ends) == ["False", "True"]
    assert render(tmp_path).from_cache
    assert not list(tmp_path.rglob("*.tmp"))


def test_who_waits_for_another_process_says_so(tmp_path: Path) -> None:
    key = render(None).key
    with locked_entry(tmp_path, key):
        waiting = child("print(render().from_cache)", tmp_path)
        assert waiting.stderr is not None
        lines = iter(waiting.stderr.readline, "")
        assert any("rendered by another process: waiting" in line for line in lines)
    output, _ = waiting.communicate()
    assert output.strip() == "False"


def test_progress_never_falls_and_ends_at_one(tmp_path: Path) -> None:
    scene = mi.load_dict(scenes.textured())
    for _ in ("rendered", "read"):
        shares: list[float] = []
        render_reference(scene, request=REQUEST, cache_directory=tmp_path, progress=shares.append)
        assert shares == sorted(shares)
        assert shares[0] > 0.0
        assert shares[-1] == 1.0


def test_the_default_directory_follows_the_environment(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("VCTGI_CACHE", str(tmp_path / "chosen"))
    assert default_cache_directory() == tmp_path / "chosen"
    monkeypatch.delenv("VCTGI_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert default_cache_directory() == tmp_path / "xdg" / "vctgi" / "references"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert default_cache_directory() == Path.home() / ".cache" / "vctgi" / "references"
