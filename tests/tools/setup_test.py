#!/usr/bin/env python3
"""tools/setup where it cannot, or need not, install anything: what it says, and how fast. Package tools are stand-ins.
Knows setup's functions by name; the real installation is tests/tools/fresh_root.sh's."""
import os
import pathlib
import stat
import subprocess
import tempfile
import time
import unittest

SETUP = pathlib.Path(__file__).resolve().parent.parent.parent / "tools" / "setup"


class Setup(unittest.TestCase):
    def setUp(self):
        self.temporary = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self.temporary.name)
        self.calls = self.folder / "calls"

    def tearDown(self):
        self.temporary.cleanup()

    def stand_in(self, name, script):
        path = self.folder / name
        path.write_text(f"#!/bin/bash\necho \"{name} $*\" >>'{self.calls}'\n{script}\n")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)

    def call(self, code):
        return subprocess.run(["bash", "-c", f"source {SETUP}; {code}"], capture_output=True, text=True, timeout=60,
                              stdin=subprocess.DEVNULL, env=dict(os.environ, PATH=f"{self.folder}:{os.environ['PATH']}"))

    def called(self, name):
        text = self.calls.read_text() if self.calls.exists() else ""
        return [line for line in text.split("\n") if line.startswith(name + " ")]

    # dpkg-query that knows all packages, or all but two until apt-get has run.
    ALL = 'for p in "$@"; do case $p in -*) ;; *) echo "installed $p" ;; esac; done'

    def some(self):
        return (f'for p in "$@"; do case $p in -*) ;; ninja-build | libeigen3-dev) [ -e {self.folder}/done ] &&'
                ' echo "installed $p" ;; *) echo "installed $p" ;; esac; done')

    def test_nothing_missing_is_quick_and_silent(self):
        self.stand_in("dpkg-query", self.ALL)
        self.stand_in("apt-get", "exit 1")
        began = time.monotonic()
        done = self.call("install_packages test")
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "", ""))
        self.assertLess(time.monotonic() - began, 1)
        self.assertEqual(self.called("apt-get"), [])

    def test_without_rights_it_names_packages_and_remedy(self):
        self.stand_in("dpkg-query", self.some())
        self.stand_in("apt-get", "exit 1")
        done = self.call("can_be_admin() { return 1; }; install_packages build")
        self.assertEqual(done.returncode, 1)
        self.assertIn("apt-get install --no-install-recommends ninja-build libeigen3-dev", done.stderr)
        self.assertEqual(self.called("apt-get"), [])

    def test_only_what_is_missing_is_installed(self):
        self.stand_in("dpkg-query", self.some())
        self.stand_in("apt-get", f'case "$*" in *install*) touch {self.folder}/done ;; esac')
        done = self.call("as_admin() { \"$@\"; }; can_be_admin() { :; }; install_packages build")
        self.assertEqual(done.returncode, 0, done.stderr)
        calls = self.called("apt-get")
        self.assertEqual(len(calls), 2)
        self.assertTrue(calls[0].endswith("update"))
        self.assertTrue(calls[1].endswith("--no-install-recommends ninja-build libeigen3-dev"))

    def test_offline_is_told_with_the_remedy(self):
        self.stand_in("dpkg-query", self.some())
        self.stand_in("apt-get", "echo 'E: Could not resolve host' >&2; exit 100")
        done = self.call("as_admin() { \"$@\"; }; can_be_admin() { :; }; install_packages build")
        self.assertEqual(done.returncode, 1)
        self.assertIn("online", done.stderr)
        self.assertIn("ninja-build libeigen3-dev", done.stderr)

    def test_another_package_manager_is_waited_for(self):
        self.stand_in("dpkg-query", self.some())
        self.stand_in("apt-get", f"""case "$*" in *install*) ;; *) exit 0 ;; esac
if [ -e {self.folder}/second ]; then touch {self.folder}/done; exit 0; fi
touch {self.folder}/second
echo 'E: Could not get lock /var/lib/dpkg/lock-frontend. It is held by process 1' >&2
exit 100""")
        done = self.call("as_admin() { \"$@\"; }; can_be_admin() { :; }; sleep() { :; }; install_packages build")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("waiting", done.stdout)

    def test_every_package_of_the_list_says_why(self):
        done = self.call("package_list")
        for line in done.stdout.strip().split("\n"):
            name, need, why = line.split(None, 2)
            self.assertIn(need, ("build", "docs", "test", "screenshots"), line)
            self.assertTrue(why, line)


if __name__ == "__main__":
    unittest.main(verbosity=2)
