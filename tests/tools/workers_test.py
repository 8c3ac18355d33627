#!/usr/bin/python3 -B
"""tools/workers.py: what a campaign's workers promise. Workers are killed while they work, by the test or by their own task."""
import contextlib
import io
import os
import pathlib
import signal
import socket
import ssl
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from unittest import mock

import psutil

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools"))
import workers
from workers import Task, Workers

from cluster import cluster


# ---- tasks: functions of this file, run by the workers ----

def note(folder, name):
    """Leaves a file by which the test sees that the task began, and in which process."""
    with open(pathlib.Path(folder) / name, "a") as file:
        file.write(f"{os.getpid()}\n")


def quick(folder, name):
    note(folder, name)
    return name, os.getpid()


def until_another_worker_is_at_it(folder, name):
    """Takes for ever the first time."""
    note(folder, name)
    if len((pathlib.Path(folder) / name).read_text().splitlines()) == 1:
        workers.run(["sleep", "61.5"])
    return name, os.getpid()


def deadly(folder, name):
    note(folder, name)
    os.kill(os.getpid(), signal.SIGKILL)


def fails(folder, name):
    raise ValueError(f"{name} cannot be done")


def begun_before(folder, name):
    """As where the scheduler does a task again by itself."""
    note(folder, name)
    if len((pathlib.Path(folder) / name).read_text().splitlines()) == 1:
        raise workers.WorkerDied
    return name, os.getpid()


def killed_program(folder, name):
    """As where memory ends, the first time."""
    note(folder, name)
    if len((pathlib.Path(folder) / name).read_text().splitlines()) == 1:
        workers.run(["sh", "-c", "kill -9 $$"])
    return workers.run(["sh", "-c", "echo why >&2; exit 3"]), workers.run(["sleep", "61.5"], 0.2)[0]


def sleeps(folder, name):
    note(folder, name)
    workers.run(["sleep", "61.5"])


def pids(folder, name):
    with contextlib.suppress(FileNotFoundError):
        return [int(line) for line in (folder / name).read_text().splitlines()]
    return []


def sleepers():
    found = []
    for path in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            found += [path.parent.name] * (path.read_bytes() == b"sleep\x0061.5\0")
    return found


def soon(true, seconds=30):
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.05)
    return true()


class Promises(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))

    def task(self, name, function):
        return Task(name, function, (str(self.folder), name))

    def test_one_of_two_workers_is_killed_and_nothing_is_lost(self):
        names = [f"t{k}" for k in range(8)]
        tasks = [self.task(n, until_another_worker_is_at_it if n == "t3" else quick) for n in names]
        begun, killed = [], []

        def kill():
            if soon(lambda: pids(self.folder, "t3")) and soon(sleepers):
                killed.extend(pids(self.folder, "t3"))
                os.kill(killed[0], signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        with Workers(2) as those:
            results = list(those.results(tasks, lambda task: begun.append(task.name)))
        killer.join()
        self.assertEqual([r.error for r in results], [None] * 8)
        self.assertEqual(sorted(r.value[0] for r in results), names)  # each once
        self.assertEqual([len(pids(self.folder, n)) for n in names], [1, 1, 1, 2, 1, 1, 1, 1])
        again = begun.index("t3", begun.index("t3") + 1)
        self.assertEqual(begun[:again] + begun[again + 1:], names)  # in the order of the plan, and that one once more
        self.assertNotEqual(*pids(self.folder, "t3"))
        self.assertEqual(sleepers(), [], "what the dead worker had started runs on")

    def test_what_kills_two_workers_is_named_and_the_others_are_done(self):
        with Workers(2) as those:
            results = {r.task.name: r for r in those.results(
                [self.task("a", quick), self.task("bad", deadly), self.task("b", quick), self.task("wrong", fails), self.task("c", quick)])}
        self.assertEqual(len(pids(self.folder, "bad")), 2)
        self.assertIn("bad: 2 workers died at it", str(results["bad"].error))
        self.assertEqual(str(results["wrong"].error), "wrong cannot be done")
        self.assertEqual([results[n].value[0] for n in "abc"], ["a", "b", "c"])

    def test_others_on_this_machine_cannot_use_its_workers(self):
        with Workers(1) as those:
            next(those.results([self.task("a", quick)]))
            me = psutil.Process()
            doors = {c.laddr.ip for p in (me, *me.children(recursive=True)) for c in p.connections() if c.status == psutil.CONN_LISTEN}
            self.assertEqual(doors, {"127.0.0.1"})
            host, port = those.cluster.scheduler_address.removeprefix("tls://").split(":")
            context = ssl.create_default_context()
            context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
            for wrapped in (lambda s: s, context.wrap_socket):
                with socket.create_connection((host, int(port)), timeout=20) as plain, self.assertRaises((OSError, EOFError)), \
                        wrapped(plain) as stream:
                    stream.sendall(b"\0" * 64)
                    if not stream.recv(1):
                        raise EOFError

    def stopped(self, *where):
        """What a program said that was stopped while its two tasks ran."""
        words = "import sys; sys.path[:0] = sys.argv[1:3]; import workers_test as t; t.stop_me(*sys.argv[3:])"
        here = pathlib.Path(__file__).resolve().parent
        child = subprocess.Popen([sys.executable, "-B", "-c", words, here, here.parents[1] / "tools", self.folder, *where],
                                 stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True)
        self.assertTrue(soon(lambda: len(sleepers()) == 2))
        os.killpg(child.pid, signal.SIGINT)  # as a terminal does, its workers too
        said = child.communicate(timeout=30)[0]
        self.assertTrue(soon(lambda: not sleepers(), 5), "what the tasks had started runs on")
        return said

    def test_stopped_by_hand_it_ends_what_it_started(self):
        self.assertEqual(self.stopped(), "stopped\n")


class OnACluster(Promises):
    """Most of the same is shown above; here what is different where the workers are not this program's own."""
    test_one_of_two_workers_is_killed_and_nothing_is_lost = None
    test_what_kills_two_workers_is_named_and_the_others_are_done = None
    test_others_on_this_machine_cannot_use_its_workers = None

    @classmethod
    def setUpClass(cls):
        cls.scheduler = cls.enterClassContext(cluster())

    def test_stopped_by_hand_it_ends_what_it_started(self):
        self.assertEqual(self.stopped(self.scheduler), "stopped\n")
        with Workers(1, self.scheduler) as those:  # the cluster goes on
            self.assertEqual([r.value[0] for r in those.results([self.task("a", quick)])], ["a"])

    def test_a_worker_that_dies_and_a_task_that_the_scheduler_began_again(self):
        begun = []
        with Workers(1, self.scheduler) as those:
            killed, = those.results([self.task("killed", killed_program)])
            self.assertEqual(killed.value, ((3, "why\n"), 124))
            self.assertEqual(len(pids(self.folder, "killed")), 2)
            results = {r.task.name: r for r in those.results(
                [self.task("bad", deadly), self.task("twice", begun_before), self.task("a", quick)], lambda task: begun.append(task.name))}
        self.assertIn("bad: 2 workers died at it", str(results["bad"].error))
        self.assertEqual((results["twice"].value[0], results["a"].value[0]), ("twice", "a"))
        self.assertEqual(sorted(begun), ["a", "bad", "bad", "twice", "twice"])

    def test_where_there_is_no_cluster_it_says_so_soon(self):
        with socket.create_server(("127.0.0.1", 0)) as silent, mock.patch.object(workers, "CONNECT_S", 1):
            for address in (f"tcp://127.0.0.1:{silent.getsockname()[1]}", "tcp://127.0.0.1:1"):
                with self.assertRaisesRegex(workers.Wrong, "no scheduler answers .*dask scheduler"), Workers(1, address) as those:
                    list(those.results([self.task("a", quick)]))
        with self.assertRaisesRegex(workers.Wrong, "no certificates"), Workers(1, "tls://127.0.0.1:1") as those:
            list(those.results([self.task("a", quick)]))
        with cluster(0) as alone, mock.patch.object(workers, "CONNECT_S", 1), \
                self.assertRaisesRegex(workers.Wrong, "it has no worker"), Workers(1, alone) as those:
            list(those.results([self.task("a", quick)]))


class Telling(unittest.TestCase):
    def test_progress_tells_how_long_it_still_takes(self):
        with mock.patch.object(sys, "stderr", io.StringIO()) as said, mock.patch.object(time, "monotonic", lambda: self.now):
            self.now = 0
            progress = workers.Progress(10)
            progress.show(2)
            self.now, progress.done = 200, 4
            progress.show(2)
            self.now = 210  # no terminal: not yet again
            progress.show(2)
        self.assertEqual(said.getvalue(), "4 of 10 done, 2 at work, 5 min to go\n")

    def test_nothing_to_do_starts_nothing(self):
        with Workers(2) as those:
            self.assertEqual(list(those.results([])), [])
            self.assertIsNone(those.client)


def stop_me(folder, scheduler=None):
    try:
        with Workers(2, scheduler) as those:
            list(those.results([Task(n, sleeps, (folder, n)) for n in ("a", "b")]))
    except KeyboardInterrupt:
        print("stopped")


if __name__ == "__main__":
    unittest.main()
