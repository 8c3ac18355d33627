"""Tasks of a campaign on Dask: planned here, done by workers on this machine or by a cluster, results as they come.
A task is a function of a module and arguments that can be pickled. Knows nothing of what the tasks do."""
import argparse
import collections
import contextlib
import importlib
import importlib.machinery
import importlib.util
import logging
import os
import pathlib
import queue
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import uuid

ROOT = pathlib.Path(__file__).resolve().parent.parent
MOST_DEATHS = 2      # of workers at one task: the second ends it
CONNECT_S = 15
NO_WORKER_S = 120    # without any worker, until it is an error
FROM_OUTSIDE = (signal.SIGHUP, signal.SIGINT, signal.SIGKILL, signal.SIGTERM)  # ends of programs; crashes are their own
QUIET_S = 30         # between two lines of progress where there is no terminal

Task = collections.namedtuple("Task", "name function arguments")
Done = collections.namedtuple("Done", "task value error")  # error: an exception, or None


class Wrong(Exception):
    """Wrong use, or a machine that is not ready; the text says what to do."""


class WorkerDied(Exception):
    """A worker, or what it ran, was ended before the task was. A task raises it where it sees that it was begun before."""


class Stopped(Exception):
    """The campaign was stopped while the task ran."""


# ---- on a worker ----

_here = threading.local()   # campaign: of the task that this thread is at
_children = {}              # process id: campaign
_stopped = set()            # campaigns
_lock = threading.Lock()


def _call(root, file, module, name, arguments, campaign):
    """Runs a task on a worker, which needs nothing of the project but its folder: pickled by value."""
    import importlib
    import os
    import sys
    if not os.path.exists(file):
        raise FileNotFoundError(f"the worker does not see {file}: share the project's folder with it under the same path")
    for folder in (os.path.join(root, "tools"), root):
        if folder not in sys.path:
            sys.path.insert(0, folder)
    return importlib.import_module(module)._run(file, name, arguments, campaign)


def _run(file, name, arguments, campaign):
    _here.campaign = campaign
    return getattr(_module_of(file), name)(*arguments)


def _module_of(file):
    """The module in this file, loaded under its own name where packages know it, such as tests.blind.seal."""
    path = pathlib.Path(file)
    if path.suffix == ".py":
        parts = path.relative_to(ROOT).with_suffix("").parts if ROOT in path.parents else (path.stem,)
        if path.parent == ROOT / "tools" and not __name__.startswith("tools."):
            parts = parts[1:]
        return importlib.import_module(".".join(parts))
    name = f"program_{path.name}"
    if name not in sys.modules:
        loader = importlib.machinery.SourceFileLoader(name, file)
        module = importlib.util.module_from_spec(importlib.util.spec_from_loader(name, loader))
        loader.exec_module(module)
        sys.modules[name] = module
    return sys.modules[name]


def _stop(campaign):
    """Ends what the tasks of a campaign have started on this worker."""
    with _lock:
        _stopped.add(campaign)
        for process, of in _children.items():
            if of == campaign:
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.killpg(process, signal.SIGKILL)


def dask_setup(worker):
    """Called by Dask in each worker of this machine. Ctrl-C at the terminal is for the planning process, which ends them."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    worker.extensions.pop("shuffle", None)  # no task needs it, and closed a second time it prints a traceback


@contextlib.contextmanager
def program(words, **how):
    """A program that a task runs, in a session of its own. It ends with the block, with the worker, and with the campaign."""
    campaign = getattr(_here, "campaign", None)
    with _lock:
        if campaign in _stopped:
            raise Stopped
        how = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, **how}
        child = subprocess.Popen(["setpriv", "--pdeathsig", "KILL", "--", *map(str, words)], start_new_session=True, **how)
        _children[child.pid] = campaign
    try:
        yield child
    finally:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(child.pid, signal.SIGKILL)
        child.wait()
        with _lock:
            del _children[child.pid]
        if campaign in _stopped:
            raise Stopped


def run(words, timeout_s=None):
    """(exit code, what the program said on the error stream); 124 where it took longer. What is stopped from outside, as where
    memory ends, is done again as if its worker had died."""
    with program(words, stderr=subprocess.PIPE, text=True, errors="replace") as child:
        try:
            said = child.communicate(timeout=timeout_s)[1]
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            return 124, child.communicate()[1] + f"\nno answer within {timeout_s:.0f} s"
        if -child.returncode in FROM_OUTSIDE:
            raise WorkerDied(f"its program was stopped from outside ({signal.Signals(-child.returncode).name})")
        return child.returncode, said


# ---- in the planning process ----

def positive(text):
    if not (text.isascii() and text.isdecimal() and 1 <= int(text) <= 1000):
        raise argparse.ArgumentTypeError(f"'{text}': expected a whole number from 1 to 1000")
    return int(text)


def address(text):
    if not re.fullmatch(r"(tcp|tls)://([^\s/:\[\]]+|\[[0-9a-fA-F:]+\]):[0-9]{1,5}", text):
        raise argparse.ArgumentTypeError(f"'{text}': expected tcp://HOST:PORT or tls://HOST:PORT")
    return text


def add_arguments(parser):
    parser.add_argument("--jobs", type=positive, default=os.cpu_count(), metavar="N",
                        help="workers on this machine, a task each at a time (default: one a core)")
    parser.add_argument("--scheduler", type=address, metavar="ADDRESS",
                        help="a cluster's Dask scheduler instead, tcp://HOST:PORT or tls://HOST:PORT; its workers see the folders of the "
                             "project and of the output under the same paths (docs/guides/campaigns.md)")


class Progress:
    """One line on the error stream: how far, how long still. Rewritten at a terminal, elsewhere every half minute."""

    def __init__(self, count):
        self.count, self.done, self.begin, self.shown = count, 0, time.monotonic(), time.monotonic()
        self.terminal = sys.stderr.isatty()

    @property
    def left_s(self):
        return (time.monotonic() - self.begin) / self.done * (self.count - self.done) if self.done else None

    def show(self, at_work):
        if not self.terminal and time.monotonic() < self.shown + QUIET_S:
            return
        self.shown = time.monotonic()
        left = "" if self.left_s is None else f", {clock(self.left_s)} to go"
        line = f"{self.done} of {self.count} done, {at_work} at work{left}"
        print(f"\r{line}\033[K" if self.terminal else line, end="" if self.terminal else "\n", file=sys.stderr, flush=True)

    def clear(self):
        if self.terminal:
            print("\r\033[K", end="", file=sys.stderr, flush=True)


def clock(seconds):
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes:02} min" if hours else f"{minutes} min" if seconds >= 90 else f"{seconds:.0f} s"


class Workers:
    """with Workers(jobs, scheduler) as workers: for done in workers.results(tasks): ...

    A worker that dies loses nothing: its task is done again, once; where that worker dies as well, it is an error. Ctrl-C and
    SIGTERM end what runs. Started with the first task, so that a campaign with nothing to do costs nothing."""

    def __init__(self, jobs, scheduler=None):
        self.jobs, self.scheduler = jobs, scheduler
        self.campaign, self.client, self.cluster, self.scratch, self.running = uuid.uuid4().hex, None, None, None, {}
        self.ended = queue.SimpleQueue()
        self.starting = self.interrupted = False  # processes that have begun to start can only be ended once they have

    def __enter__(self):
        here = threading.current_thread() is threading.main_thread()
        self.before = {s: signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM) if here}
        for number, handler in self.before.items():
            if handler != signal.SIG_IGN:  # as in the background of a shell
                signal.signal(number, self._interrupt)
        return self

    def __exit__(self, *error):
        for number in self.before:
            signal.signal(number, signal.SIG_IGN)
        self._close()
        for number, handler in self.before.items():
            signal.signal(number, handler)

    def _interrupt(self, *_):
        """The first ends the campaign; what comes while it is being ended must not cut that short."""
        for number in self.before:
            signal.signal(number, signal.SIG_IGN)
        self.interrupted = True
        if not self.starting:
            raise KeyboardInterrupt

    def results(self, tasks, begin=None):
        """Yields a Done for each task, in the order in which they end; they begin in the order given.

        begin(task): called here each time before a task goes to a worker, so twice where the first died. Where it returns False,
        the task is left out; where it returns a task, that is done in its place."""
        waiting, deaths = collections.deque(tasks), collections.Counter()
        self.progress = Progress(len(waiting))
        alone_since = None
        while waiting or self.running:
            if self.client is None:
                self._start()
            places = self._places()
            alone_since = None if places else alone_since or time.monotonic()
            if alone_since and time.monotonic() > alone_since + NO_WORKER_S:
                raise Wrong(f"no worker for {NO_WORKER_S} s: start one (dask worker {self.scheduler or ''}); the same command goes on")
            while waiting and len(self.running) < places:
                task = waiting.popleft()
                given = begin(task) if begin else None
                if given is False:
                    self.progress.count -= 1
                else:
                    self._submit(task, given or task)
            self.progress.show(len(self.running))
            done = self._next() if waiting or self.running else None
            if done is None:
                continue
            if isinstance(done.error, WorkerDied) and deaths[done.task.name] + 1 < MOST_DEATHS:
                deaths[done.task.name] += 1
                waiting.appendleft(done.task)
                self.progress.clear()
                print(f"{done.task.name}: its worker died; it begins again", file=sys.stderr, flush=True)
                continue
            self.progress.done += 1
            self.progress.clear()
            yield done
        self.progress.clear()

    def _submit(self, task, given):
        file = os.path.realpath(given.function.__code__.co_filename)
        future = self.client.submit(_call, str(ROOT), file, __name__, given.function.__name__, given.arguments, self.campaign,
                                    pure=False, key=f"{task.name}-{uuid.uuid4().hex}")
        self.running[future.key] = task, future
        future.add_done_callback(self.ended.put)

    def _next(self):
        """The Done of a task that has ended; None where none did within a second."""
        from distributed.scheduler import KilledWorker
        try:
            future = self.ended.get(timeout=1)
        except queue.Empty:
            if self.client.status not in ("running", "connecting"):
                raise Wrong(f"the scheduler {self.scheduler or 'of this machine'} is gone; start it again, and the same command goes on")
            return None
        task, _ = self.running.pop(future.key, (None, None))
        if task is None:
            return None
        if future.status == "finished":
            try:
                return Done(task, future.result(), None)
            except Exception as error:  # the worker that holds it is gone, or it does not fit together here
                return Done(task, None, WorkerDied(f"{task.name}: no result: {error}"))
        if future.status != "error":  # cancelled or lost: the scheduler went, and came back without its tasks
            return Done(task, None, WorkerDied(f"{task.name}: {future.status}"))
        error = future.exception()
        if isinstance(error, (KilledWorker, WorkerDied)):
            error = WorkerDied(f"{task.name}: {MOST_DEATHS} workers died at it; it may need more memory than they have")
        return Done(task, None, error)

    def _places(self):
        try:
            return sum(self.client.nthreads().values())
        except OSError:
            return 0  # the scheduler is away: _next says so where it does not come back

    def _start(self):
        os.environ.setdefault("DASK_LOGGING__DISTRIBUTED", "critical")  # before the import, and for the workers: errors are told here
        try:
            import cloudpickle
            import dask
            import distributed
        except ModuleNotFoundError as missing:
            raise Wrong(f"{sys.executable} has no package {missing.name}: sudo apt-get install python3-distributed, or, in an "
                        "environment of its own, pip install distributed cryptography")
        cloudpickle.register_pickle_by_value(sys.modules[__name__])
        for name in ("distributed.client", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        dask.config.set({"distributed.scheduler.allowed-failures": 0, "distributed.scheduler.worker-saturation": 1.0,
                         "distributed.comm.timeouts.connect": f"{CONNECT_S}s",
                         "distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []})
        if self.scheduler and self.scheduler.startswith("tls:") and not dask.config.get("distributed.comm.tls.ca-file", None):
            raise Wrong(f"--scheduler {self.scheduler}: no certificates; name them in DASK_DISTRIBUTED__COMM__TLS__CA_FILE, "
                        "..._TLS__CLIENT__CERT and ..._TLS__CLIENT__KEY")
        try:
            self.starting = not self.scheduler
            self.client = distributed.Client(self.scheduler or self._own_cluster(distributed), timeout=CONNECT_S, set_as_default=False)
            self.client.wait_for_workers(1, timeout=2 * CONNECT_S)
            self.starting = False
            if self.interrupted:
                raise KeyboardInterrupt
            if self.scheduler:
                self._remark_on_scheduler()
        except (OSError, TimeoutError, ValueError) as error:
            if not self.scheduler:
                raise Wrong(f"the workers of this machine did not start: {type(error).__name__}: {error}")
            what = "it has no worker" if self.client else "no scheduler answers"
            raise Wrong(f"--scheduler {self.scheduler}: {what} ({error or type(error).__name__}); start them with `dask scheduler` and "
                        "`dask worker`, as docs/guides/campaigns.md says, or leave --scheduler out")

    def _remark_on_scheduler(self):
        """A cluster's scheduler may do tasks of dead workers again by itself, which then counts as one time here."""
        again = self.client.run_on_scheduler(lambda dask_scheduler: dask_scheduler.allowed_failures)
        if again:
            print(f"remark: {self.scheduler} lets a task kill {again + 1} workers before it is told here; start it with "
                  "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES=0", file=sys.stderr, flush=True)

    def _own_cluster(self, distributed):
        """Processes of one thread each. Only this program can use them: whoever reaches a scheduler runs what he likes as its
        user, and other users reach ports of this machine, so both sides show certificates that are made for the occasion."""
        self.scratch = tempfile.mkdtemp(prefix="tendril-workers-")
        os.chmod(self.scratch, 0o711)  # programs that tasks run as another user have folders in it
        door = {"host": "127.0.0.1", "protocol": "tls://", "security": distributed.Security.temporary(), "dashboard": False,
                "dashboard_address": "127.0.0.1:0"}
        worker = {"cls": distributed.Nanny, "options": {
            **door, "nthreads": 1, "memory_limit": 0, "silence_logs": logging.CRITICAL, "local_directory": self.scratch,
            "preload": [str(ROOT / "tools" / "workers.py")], "env": {"TMPDIR": self.scratch}}}
        self.cluster = distributed.SpecCluster(workers={k: worker for k in range(self.jobs)}, security=door["security"],
                                               scheduler={"cls": distributed.Scheduler, "options": door}, silence_logs=logging.CRITICAL)
        return self.cluster

    def _close(self):
        if self.client is not None:
            with contextlib.suppress(Exception):  # what cannot be reached any more has nothing to end
                self._end_tasks()
            with contextlib.suppress(Exception):
                self.client.close(timeout=5)
        if self.cluster is not None:
            with contextlib.suppress(Exception):
                self.cluster.close(timeout=10)
        if self.scratch:
            shutil.rmtree(self.scratch, ignore_errors=True)

    def _end_tasks(self):
        futures = [future for _, future in self.running.values()]
        if futures:
            self.client.cancel(futures, force=True)
            self.client.run(_call, str(ROOT), str(ROOT / "tools" / "workers.py"), __name__, "_stop", (self.campaign,), None,
                            on_error="ignore")
        self.running.clear()
