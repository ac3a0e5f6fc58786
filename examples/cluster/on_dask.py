"""A cohort on Dask: each task examines a part of the people and keeps it in a journal, and the parts become one result.

    python on_dask.py people.toml people 3 [ADDRESS OF A SCHEDULER]

A task whose worker is lost is given to another one, which goes on where the journal ends. Journals are locked and must lie on a file system
that all workers see.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from dask.distributed import Client, LocalCluster, wait

import fluorspar as fs


def examined(client: Client, cohort: Path, out: Path, parts: int) -> Any:
    """The numbers of a cohort, whose files go to a folder."""
    cohort, out = cohort.resolve(), out.resolve()
    shards = [f"{part}/{parts}" for part in range(1, parts + 1)]
    # Journals change what a task finds: none is taken for another that ran before
    tasks = [client.submit(fs.cohort, cohort, shard=shard, out=out, threads=1, pure=False) for shard in shards]
    wait(tasks)
    client.gather(tasks)
    return fs.cohort(cohort, out=out)


if __name__ == "__main__":
    cohort, out, parts, *address = sys.argv[1:]
    cluster = address[0] if address else LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with Client(cluster) as client:
        print(examined(client, Path(cohort), Path(out), int(parts)).people)
