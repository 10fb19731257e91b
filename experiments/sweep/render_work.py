"""A job as work: the hidden command that renders it, and what that is given."""

from __future__ import annotations

from experiments.sweep.jobs import Job
from experiments.sweep.work import Work


def render_work(job: Job, timeout: float, threads: int | None) -> Work:
    """Return the work of rendering a job.

    Parameters
    ----------
    job
        The job.
    timeout
        Of an attempt, seconds: the process ends itself a little later, should nobody else do it.
    threads
        Processor threads that it may use; None for all.
    """
    command = ["{python}", "-m", "experiments", "sweep-job", "{job}", "--output", "{output}"]
    command += ["--timeout", f"{timeout:g}"]
    if threads is not None:
        command += ["--threads", str(threads)]
    return Work(
        label=job.label,
        command=tuple(command),
        parameters=job.parameters(),
        content=job.model_dump_json(indent=1) + "\n",
    )
