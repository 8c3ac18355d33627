#!/usr/bin/env python3
"""tools/vcan-run: a command behaves as if run directly, only with vcan0 beside it, and nothing stays behind.
Knows nothing of the way the bus is provided."""
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

VCAN_RUN = str(pathlib.Path(__file__).resolve().parent.parent.parent / "tools" / "vcan-run")


def run(*arguments, timeout=60, **how):
    how.setdefault("stdin", subprocess.DEVNULL) if "input" not in how else None
    return subprocess.run([VCAN_RUN, *arguments], capture_output=True, text=True, timeout=timeout, **how)


class VcanRun(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        # Its working files go here, so that leftovers show.
        self.environment = dict(os.environ, TMPDIR=self.folder.name)

    def tearDown(self):
        self.assertEqual(os.listdir(self.folder.name), [], "files left behind")
        self.folder.cleanup()

    def test_command_sees_its_world_and_the_bus(self):
        script = r"""
pwd; printf '%s\n' "$ODD"; echo to-errors >&2; cat
ip -brief link show vcan0; ip -brief link show lo; ip route
python3 - <<'PY'
import socket
a, b = (socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) for _ in range(2))
a.bind(("vcan0",)); b.bind(("vcan0",)); b.settimeout(5)
a.send(bytes([0x23, 1, 0, 0, 4, 0, 0, 0, 0xDE, 0xAD, 0xBE, 0xEF, 0, 0, 0, 0]))
print("frame", b.recv(16)[:12].hex())
r = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); r.settimeout(5)
r.bind(("239.255.76.67", 7667))
r.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton("239.255.76.67") + socket.inet_aton("0.0.0.0"))
socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b"hello", ("239.255.76.67", 7667))
print("multicast", r.recv(10).decode())
PY
exit 7
"""
        odd = "two\nlines 'and' \"quotes\" $HOME \\ *"
        lines = "".join(f"line {i}\n" for i in range(2000))
        with tempfile.TemporaryDirectory(prefix="odd name ") as place:
            done = run("--timeout", "40", "bash", "-c", script, input=lines, cwd=place,
                       env=dict(self.environment, ODD=odd))
        self.assertEqual(done.returncode, 7, done.stderr)
        self.assertEqual(done.stderr, "to-errors\n")
        head = f"{os.path.realpath(place)}\n{odd}\n{lines}"
        self.assertEqual(done.stdout[:len(head)], head)
        rest = done.stdout[len(head):]
        self.assertRegex(rest, r"vcan0 .*UP")
        self.assertRegex(rest, r"lo .*MULTICAST,UP")
        self.assertIn("224.0.0.0/4 dev lo", rest)
        self.assertIn("frame 2301000004000000deadbeef", rest)
        self.assertIn("multicast hello", rest)

    def test_time_out_ends_it(self):
        began = time.monotonic()
        done = run("--timeout", "2", "sleep", "60", env=self.environment)
        self.assertEqual(done.returncode, 124)
        self.assertLess(time.monotonic() - began, 30)

    def test_virtual_time_skips_waiting(self):
        if run("--kernel", "uml", "--check").returncode:
            self.skipTest("no user-mode kernel here")
        script = "before=$(date +%s); sleep 1000; echo $(($(date +%s) - before))"
        done = run("--kernel", "uml", "--virtual-time", "sh", "-c", script, env=self.environment)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertAlmostEqual(int(done.stdout), 1000, delta=1)

    def test_what_a_command_leaves_running_ends_with_it(self):
        done = run("sh", "-c", "sleep 1000 & setsid sleep 1000 & echo done", env=self.environment)
        self.assertEqual((done.returncode, done.stdout), (0, "done\n"))

    def test_signals_reach_the_command(self):
        for number, name in ((signal.SIGINT, "INT"), (signal.SIGTERM, "TERM")):
            with self.subTest(signal=name):
                script = f"trap 'echo caught; exit 9' {name}; echo ready; while :; do sleep 0.1; done"
                process = subprocess.Popen([VCAN_RUN, "--timeout", "40", "bash", "-c", script], stdin=subprocess.DEVNULL,
                                           stdout=subprocess.PIPE, text=True, env=self.environment)
                self.assertEqual(process.stdout.readline(), "ready\n")
                process.send_signal(number)
                output, _ = process.communicate(timeout=30)
                self.assertEqual((process.returncode, output), (9, "caught\n"))

    def test_its_own_death_takes_everything_along(self):
        marker = f"{self.folder.name}/"
        process = subprocess.Popen([VCAN_RUN, "sh", "-c", "echo ready; sleep 1000"], stdin=subprocess.DEVNULL,
                                   stdout=subprocess.PIPE, text=True, env=self.environment)
        self.assertEqual(process.stdout.readline(), "ready\n")
        process.kill()
        process.wait()
        process.stdout.close()

        def left():
            for pid in filter(str.isdigit, os.listdir("/proc")):
                try:
                    words = pathlib.Path("/proc", pid, "cmdline").read_bytes().decode(errors="replace")
                except OSError:
                    continue
                if marker in words:
                    yield words
        deadline = time.monotonic() + 10
        while (list(left()) or os.listdir(self.folder.name)) and time.monotonic() < deadline:
            time.sleep(0.05)
        self.assertEqual(list(left()), [])

    def test_a_missing_program_is_told_with_its_package(self):
        for program, package in (("insmod", "kmod"), ("ip", "iproute2")):
            if program == "insmod" and not os.path.exists("/usr/bin/linux.uml"):
                continue  # only the user-mode kernel needs it
            path = shutil.which(program, path="/usr/sbin:/usr/bin:/sbin:/bin")
            if path is None:
                self.skipTest(f"{program} is not installed here")
            # An empty file in its place, seen by this command only.
            hide = f"mount --bind {self.folder.name}/empty {os.path.realpath(path)} && exec {VCAN_RUN} --kernel uml --check"
            empty = pathlib.Path(self.folder.name) / "empty"
            empty.touch(mode=0o644)
            own = ["unshare", "--mount"] + ([] if os.getuid() == 0 else ["--map-root-user"])
            done = subprocess.run([*own, "bash", "-c", hide], capture_output=True, text=True, timeout=60)
            empty.unlink()
            self.assertEqual(done.returncode, 1, done.stdout)
            self.assertIn(f"{program} is missing", done.stderr)
            self.assertIn(f"sudo apt-get install {package}", done.stderr)

    def test_a_missing_command_is_told(self):
        done = run("no-such-command", env=self.environment)
        self.assertEqual(done.returncode, 127)
        self.assertIn("no-such-command", done.stderr)


if __name__ == "__main__":
    check = run("--check")
    if check.returncode:
        print(f"SKIPPED: {check.stderr.strip()}")
        sys.exit(77)
    print(f"vcan0 comes from {check.stdout.strip()}")
    unittest.main(verbosity=2)
