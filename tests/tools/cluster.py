"""A Dask cluster of two workers on this machine, for tests of programs that take --scheduler. Knows nothing of the project."""
import os
import tempfile


class cluster:
    """with cluster() as address: ...; no generator, which would wait for ever where a test is interrupted and Python ends."""

    def __init__(self, workers=2):
        self.workers = workers

    def __enter__(self):
        os.environ.setdefault("DASK_LOGGING__DISTRIBUTED", "critical")
        import dask
        import distributed
        dask.config.set({"distributed.scheduler.allowed-failures": 0})
        self.scratch = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self.those = distributed.LocalCluster(n_workers=self.workers, threads_per_worker=1, host="127.0.0.1", memory_limit=0,
                                              dashboard_address="127.0.0.1:0", local_directory=self.scratch.name)
        return self.those.scheduler_address

    def __exit__(self, *error):
        self.those.close(timeout=20)
        self.scratch.cleanup()
