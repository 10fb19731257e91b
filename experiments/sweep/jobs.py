"""The jobs of a sweep: a scene, configuration and seed each, keyed by all that they depend on."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from experiments.sweep.overrides import changed_config
from experiments.sweep.specification import SweepSpec
from vctgi.config import RenderConfig, preset


class Job(BaseModel):
    """One run; as JSON it is what the job's process is given."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    scene: str
    """A built-in name, or an absolute path."""
    scene_digest: str
    digest_variant: str
    """Back end on which the digest was made: another one's may differ in the last bit."""
    preset: str
    values: dict[str, Any]
    """What differs from the preset, by dotted name."""
    seed: int
    resolution: int | None
    reference_spp: int
    variant: str
    sensor: int
    cache: str | None
    """Folder of references; None for the default. Says nothing about the result."""
    code: str
    """Version of the code that may run it."""

    def config(self) -> RenderConfig:
        """Return the configuration.

        Raises
        ------
        InputError
            A value that it refuses.
        """
        return changed_config(preset(self.preset), self.values)

    @property
    def configuration(self) -> str:
        """The preset with what differs from it."""
        return ", ".join([self.preset, *(f"{k}={_text(v)}" for k, v in self.values.items())])

    @property
    def label(self) -> str:
        """What a list of jobs calls it."""
        return f"{Path(self.scene).name}, {self.configuration}, seed {self.seed}"

    @property
    def command(self) -> str:
        """What to type to run this job alone."""
        words = ["vctgi", "sweep", "--scene", self.scene, "--preset", self.preset]
        for name, value in self.values.items():
            words += ["--set", f"{name}={_toml(value)}"]
        words += ["--seeds", str(self.seed), "--spp", str(self.reference_spp)]
        if self.resolution is not None:
            words += ["--resolution", str(self.resolution)]
        return shlex.join([*words, "--variant", self.variant, "--sensor", str(self.sensor)])

    @property
    def key(self) -> str:
        """SHA-256 of all that the result depends on, apart from the machine."""
        content = {
            "config": dataclasses.asdict(self.config()),
            "scene": self.scene_digest,
            "resolution": self.resolution,
            "reference_spp": self.reference_spp,
            "seed": self.seed,
            "variant": self.variant,
            "sensor": self.sensor,
            "code": self.code,
        }
        text = json.dumps(content, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    def parameters(self) -> dict[str, Any]:
        """Return what a table of results shows of the job."""
        return {
            "scene": self.scene,
            "preset": self.preset,
            "seed": self.seed,
            "reference_spp": self.reference_spp,
            "values": self.values,
        }


def list_jobs(
    spec: SweepSpec,
    digests: Mapping[str, str],
    *,
    variant: str,
    digest_variant: str,
    cache: Path | None,
    code: str,
) -> dict[str, Job]:
    """Return the jobs of a sweep by key; of equal ones, the first.

    Jobs that need the same reference, which only one of them renders, stand far apart, so that
    several workers do not wait for one.

    Parameters
    ----------
    spec
        The sweep, its presets listed by name.
    digests
        Fingerprint of each scene.
    variant, digest_variant
        Back end of the jobs, and of the fingerprints.
    cache
        Folder of references.
    code
        `code_version()`.

    Raises
    ------
    InputError
        A parameter that no configuration has, or a value that one refuses.
    """
    names = list(spec.parameters)
    points = list(itertools.product(*spec.parameters.values()))
    jobs: dict[str, Job] = {}
    for name, point, seed, scene in itertools.product(
        spec.presets, points, spec.seeds, spec.scenes
    ):
        is_file = Path(scene).suffix and Path(scene).exists()
        job = Job(
            scene=str(Path(scene).resolve()) if is_file else scene,
            scene_digest=digests[scene],
            digest_variant=digest_variant,
            preset=name,
            values=dict(zip(names, point, strict=True)),
            seed=seed,
            resolution=spec.resolution,
            reference_spp=spec.reference_spp,
            variant=variant,
            sensor=spec.sensor,
            cache=None if cache is None else str(cache.resolve()),
            code=code,
        )
        jobs.setdefault(job.key, job)
    return jobs


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _toml(value: Any) -> str:
    """Write a value so that `--set` reads it back; JSON's form is also TOML's but for null."""
    return json.dumps(value)
