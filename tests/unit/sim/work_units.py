"""Units for `test_work.py`, which processes of any engine can import; run as a script, a driver to be killed."""

import json
import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ohmloom.sim.work import Batch, open_work

ITEMS = 6


@dataclass(frozen=True)
class Draw:
    """Draws a number. A file ``bad_ITEM`` makes it fail, ``kill_worker_ITEM`` or ``kill_driver_ITEM`` kills that."""

    marks: str

    def __call__(self, item, stopped, report):
        marks = Path(self.marks)
        with (marks / "pids").open("a") as file:
            file.write(f"{os.getpid()} {item}\n")
        for name, pid in (("worker", os.getpid()), ("driver", os.getppid())):
            mark = marks / f"kill_{name}_{item}"
            if mark.exists():
                while name == "driver" and any(marks.glob("kill_worker_*")):
                    time.sleep(0.01)  # the worker comes first
                mark.unlink()
                os.kill(pid, signal.SIGKILL)
        if (marks / f"bad_{item}").exists():
            raise ValueError(f"bad {item}")
        draw = np.random.default_rng(np.random.SeedSequence(5, spawn_key=(item,))).random()
        # Counts and flags arrive as numpy's.
        report(item, {"draw": draw, "count": np.int64(item), "even": np.bool_(item % 2 == 0)})
        return True


def batch(marks):
    return Batch(name="draws", unit=Draw(str(marks)), items=range(ITEMS), inputs={"seed": 5})


def drive(out, marks, **options):
    with open_work(folder=Path(out), **options) as work:
        return work.run(batch(marks))


if __name__ == "__main__":
    sys.stdout.write(json.dumps(drive(sys.argv[1], sys.argv[2], workers=int(sys.argv[3]))))
