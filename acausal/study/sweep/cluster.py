"""Executors of Dask distributed, for sweeps on several machines."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from acausal.errors import UsageError
from acausal.study.sweep.tables import package

# Time limit for the answer of a scheduler.
_TIMEOUT = "10s"


@contextmanager
def cluster(address: str, workers: int) -> Iterator[tuple[Executor, int]]:
    """(Executor, number of its threads) of the scheduler at `host:port`, or of a local cluster of `workers` processes.

    Raises UsageError: AC015 if `distributed` is not installed, AC063 if no scheduler answers.
    """
    distributed = package("distributed")
    if not address:
        local = distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address=None, silence_logs=logging.ERROR
        )
        with local, distributed.Client(local) as client:
            yield client.get_executor(pure=False, retries=0), workers
        return
    try:
        client = distributed.Client(f"tcp://{address}", timeout=_TIMEOUT)
    except (OSError, ValueError) as error:
        raise UsageError(
            "AC063",
            f"no Dask scheduler answers at {address}",
            evidence=[str(error)],
            help="dask scheduler starts one, dask worker HOST:PORT a worker; dask:// alone starts a cluster here",
        ) from error
    with client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise UsageError("AC063", f"the Dask scheduler at {address} has no workers", help="dask worker HOST:PORT")
        yield client.get_executor(pure=False, retries=0), threads
