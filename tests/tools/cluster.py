"""A Dask cluster of two workers on this machine, for tests of programs that take --scheduler. Knows nothing of the project."""
import contextlib
import os
import tempfile


@contextlib.contextmanager
def cluster(workers=2):
    """Address of its scheduler."""
    os.environ.setdefault("DASK_LOGGING__DISTRIBUTED", "critical")
    import dask
    import distributed
    dask.config.set({"distributed.scheduler.allowed-failures": 0})
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch, distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0", memory_limit=0,
            local_directory=scratch) as those:
        yield those.scheduler_address
