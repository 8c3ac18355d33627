"""The installed tree as another project and a user see it: headers and libraries by find_package, programs by PATH."""
import argparse
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

OPTIONS = None


def run(*command, **more):
    return subprocess.run([str(c) for c in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **more)


class Examples(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.kept = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.kept.name)
        cls.prefix = cls.folder / "prefix"
        installed = run(OPTIONS.cmake, "--install", OPTIONS.build, "--prefix", cls.prefix)
        assert installed.returncode == 0, installed.stdout
        cls.environment = {**os.environ, "PATH": f"{cls.prefix / 'bin'}:{os.environ['PATH']}"}

    @classmethod
    def tearDownClass(cls):
        cls.kept.cleanup()

    def test_programs_are_built_against_what_is_installed(self):
        build = self.folder / "build"
        # Nothing of the checkout may be needed.
        examples = self.folder / "examples"
        subprocess.run(["cp", "-r", str(OPTIONS.source / "examples"), str(examples)], check=True)
        for step in ((OPTIONS.cmake, "-S", examples, "-B", build, f"-DCMAKE_PREFIX_PATH={self.prefix}"),
                     (OPTIONS.cmake, "--build", build)):
            done = run(*step)
            self.assertEqual(done.returncode, 0, done.stdout)
        for file in build.rglob("*.cmake"):
            self.assertNotIn(f"{OPTIONS.source}/include", file.read_text(), file)
        self.bends(build / "bend_by_tension", examples / "my_robot.yaml")
        self.watches(build / "watch_and_move")

    def bends(self, program, robot):
        done = run(program, robot, 4, 0.5, 0.5)
        self.assertEqual(done.returncode, 0, done.stdout)
        tip = [float(x) for x in done.stdout.split(":")[1].split()]
        table = "T1,T2,T3\n4,0.5,0.5\n"
        model = run(self.prefix / "bin/tendril", "model", "statics", "--robot", robot, input=table)
        self.assertEqual(model.returncode, 0, model.stdout)
        names, values = (line.split(",") for line in model.stdout.strip().splitlines()[:2])
        row = dict(zip(names, values))
        for axis, found in zip("xyz", tip):
            self.assertAlmostEqual(found, 1e3 * float(row[axis]), places=2)
        done = run(program, robot, 4)
        self.assertEqual(done.returncode, 2)
        self.assertIn("my_robot has 3 tendons", done.stdout)
        self.assertEqual(run(program, self.folder / "missing.yaml", 1).returncode, 1)

    def watches(self, program):
        self.assertEqual(run(program).returncode, 2)
        done = run(program, "memq://")  # where no daemon can be
        self.assertEqual(done.returncode, 1)
        self.assertIn("no daemon was heard on memq://", done.stdout)

    def test_new_files_name_the_installed_schemas(self):
        tendril, schemas = self.prefix / "bin/tendril", self.prefix / "share/tendril/schema"
        done = run(tendril, "init", self.folder, "--name", "arm", "--defaults")
        self.assertEqual(done.returncode, 0, done.stdout)
        for kind, file in (("robot", "arm.yaml"), ("daemon", "arm_tendrild.yaml")):
            schema = schemas / f"{kind}.schema.json"
            self.assertEqual(schema.read_text(), run(tendril, "config", "schema", kind).stdout)
            first = (self.folder / file).read_text().splitlines()[0]
            self.assertEqual(first, f"# yaml-language-server: $schema={schema.resolve()}")

    def complete(self, *words):
        """What bash offers for the last word."""
        script = ('source "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _tendril; printf "%s\\n" "${COMPREPLY[@]}"')
        done = run("bash", "-c", script, "bash", self.prefix / "share/bash-completion/completions/tendril", *words)
        self.assertEqual(done.returncode, 0, done.stdout)
        return done.stdout.split()

    def test_the_shell_completes_commands_options_and_values(self):
        self.assertEqual(self.complete("tendril", "gap", "dia"), ["diagnose"])
        self.assertIn("--before", self.complete("tendril", "gap", "diagnose", "--b"))
        self.assertEqual(self.complete("tendril", "demo", "--trajectory", ""), ["circle", "planar", "all"])
        self.assertIn("--simulated", self.complete("tendrild", "--s"))
        zsh = self.prefix / "share/zsh/vendor-completions/_tendril"
        self.assertTrue(zsh.read_text().startswith("#compdef tendril tendrild tendril-plant"))
        if shutil.which("zsh"):
            self.assertEqual(run("zsh", "-n", zsh).stdout, "")

    def test_every_command_has_a_manual_page(self):
        if not shutil.which("help2man"):
            self.skipTest("the build had no help2man")
        pages = {page.stem for page in (self.prefix / "share/man/man1").glob("*.1")}
        commands = run(OPTIONS.build / "bin/tendril-reference", "--commands").stdout.split("\n")
        self.assertLess(20, len(pages))
        self.assertEqual({c.replace(" ", "-") for c in commands if c}, pages)
        self.assertIn("--before", (self.prefix / "share/man/man1/tendril-gap-diagnose.1").read_text().replace("\\-", "-"))

    def test_a_whole_session_runs(self):
        out = self.folder / "session"
        done = run(self.prefix / "share/doc/tendril/examples/session.sh", out, env=self.environment)
        self.assertEqual(done.returncode, 0, done.stdout)
        report = json.loads((out / "gap/report.json").read_text())
        self.assertEqual(report["causes"][0]["effect"], "bending_stiffness")
        self.assertAlmostEqual(report["causes"][0]["parameters"]["scale"]["value"], 0.9, delta=0.01)
        runs = json.loads((out / "compare/compare.json").read_text())["trajectories"][0]["runs"]
        own, nominal, found = (r["tip_rms_error_m"] for r in runs)
        self.assertLess(abs(found - own), 0.1 * (nominal - own))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--build", type=pathlib.Path, required=True)
    parser.add_argument("--source", type=pathlib.Path, required=True)
    parser.add_argument("--cmake", required=True)
    OPTIONS, rest = parser.parse_known_args()
    unittest.main(argv=[sys.argv[0], *rest])
