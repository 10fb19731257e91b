"""Jobs of 50 ms that leave true records, so that sweeps can be killed many times quickly."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from experiments.errors import MachineryError
from experiments.sweep.folder import SweepFolder
from experiments.sweep.lanes import LocalLanes
from experiments.sweep.ledger import SweepLedger
from experiments.sweep.run import SweepEnd, SweepOptions, run_sweep
from experiments.sweep.work import Work
from reports.record import read_records

PICTURE = b"stands for a picture: only its checksum is looked at"

# Writes what a run writes, in the same order: the picture, then the record, whole or not at all;
# and then says in a common file that it has done its work.
SCRIPT = """
import hashlib, json, os, pathlib, secrets, sys, time
job = json.loads(pathlib.Path(sys.argv[1]).read_text())
records = pathlib.Path(sys.argv[2]) / "records"
time.sleep(job["seconds"])
name = job["name"] + "-" + secrets.token_hex(4)
(records / name).mkdir(parents=True)
picture = job["picture"].encode()
(records / name / "image.exr").write_bytes(picture)
record = dict(job["record"], record_id=name, images={"image": {
    "path": name + "/image.exr", "sha256": hashlib.sha256(picture).hexdigest()}})
part = records / ("." + name + ".part.json")
part.write_text(json.dumps(record))
os.link(part, records / (name + ".json"))
part.unlink()
with open(job["diary"], "a") as diary:
    diary.write(job["name"] + "\\n")
"""

COMMAND = ("{python}", "-I", "-S", "-c", SCRIPT, "{job}", "{output}")


def tiny_work(folder: Path, count: int, seconds: float = 0.05) -> dict[str, Work]:
    """Return jobs by key; each adds a line to the diary beside the folder when it is done."""
    record = json.loads(_record_text(folder))
    return {
        f"{number:064x}"[::-1]: Work(
            label=f"tiny {number}",
            command=COMMAND,
            parameters={"preset": "high", "values": {"number": number}},
            content=json.dumps(
                {
                    "name": f"tiny-{number}",
                    "seconds": seconds,
                    "record": record,
                    "picture": PICTURE.decode(),
                    "diary": str(diary(folder)),
                }
            ),
        )
        for number in range(count)
    }


def _record_text(folder: Path) -> str:
    """Return a record as JSON, kept beside the folder: what makes it takes long to import."""
    path = folder.with_name(folder.name + ".record")
    if not path.exists():
        from tests.reports.conftest import record_with

        path.write_text(record_with({}).model_dump_json())
    return path.read_text()


def python_work(code: str, label: str = "odd") -> dict[str, Work]:
    """Return one job that runs Python code, with the attempt's folder as its first argument."""
    command = ("{python}", "-I", "-S", "-c", code, "{output}")
    return {"ab" * 32: Work(label=label, command=command)}


def diary(folder: Path) -> Path:
    """Return the file in which jobs say that they are done."""
    return folder.with_name(folder.name + ".diary")


def sweep_here(folder: Path, work: dict[str, Work], workers: int = 2, **options: float) -> SweepEnd:
    """Run a sweep in this process."""
    folder.mkdir(exist_ok=True)
    wanted = SweepOptions(**{"timeout": 20.0, "back_off": 0.01, **options})  # type: ignore[arg-type]
    return run_sweep(SweepFolder(folder), work, LocalLanes(workers), wanted)


def assert_each_done_once(folder: Path, work: dict[str, Work]) -> None:
    """Nothing was lost, nothing that was finished was done again, nothing is half-written."""
    names = sorted(json.loads(each.content)["name"] for each in work.values())
    place = SweepFolder(folder)
    records = read_records(place.records)
    assert sorted(path.stem.rpartition("-")[0] for path in records) == names
    done = diary(folder).read_text().split()
    assert len(done) == len(set(done)), "work that was finished was done again"
    published = {path.name for path in place.records.iterdir()}
    assert published == {path.name for path in records} | {path.stem for path in records}
    receipts = list(place.root.glob("jobs/*/attempt-*/records/*.json"))
    assert sorted(path.name for path in receipts) == sorted(path.name for path in records)
    ledger = SweepLedger(place.ledger, "nobody")
    ledger.want({key: (each.label, each.parameters) for key, each in work.items()})
    assert ledger.counts() == {"waiting": 0, "running": 0, "done": len(work), "set aside": 0}
    ledger.close()


def run_tiny_sweep(folder: Path, count: int) -> int:
    """Run a sweep of tiny jobs as a command would; return the exit code."""
    try:
        end = sweep_here(folder, tiny_work(folder, count))
    except MachineryError as error:
        sys.stderr.write(f"{error}\n")
        return 3
    return 1 if end.set_aside else 0


def nursery() -> None:
    """Run a sweep for each line `count folder`, by a fork: that spares its imports.

    Answers with its process number as it starts and its exit code as it ends.
    """
    for line in sys.stdin:
        count, folder = line.rstrip("\n").split(" ", 1)
        pid = os.fork()
        if pid == 0:
            os._exit(run_tiny_sweep(Path(folder), int(count)))
        print(pid, flush=True)  # noqa: T201 - the answer
        _, status = os.waitpid(pid, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)  # noqa: T201 - the answer


if __name__ == "__main__":
    if len(sys.argv) > 1:
        sys.exit(run_tiny_sweep(Path(sys.argv[1]), int(sys.argv[2])))
    nursery()
