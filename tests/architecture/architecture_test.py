#!/usr/bin/env python3
"""The rules of the house: includes between rooms, what each file begins with, how each program answers.
Knows the tree, not what is in it; the room rules come from the build (room_rules.txt: a room and what it may include)."""
import argparse
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

ARGUMENTS = None
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')
# Time and sockets are passed in from outside: only these rooms may ask the system for them.
ROOMS_OF_THE_OUTSIDE = {"rt", "can", "io", "daemon", "rig", "experiment", "commission"}
# Who reads and writes messages.
ROOMS_OF_MESSAGES = {"io", "rig"}
OUTSIDE = re.compile(r"^(chrono|thread|mutex|condition_variable|future|ctime|time\.h|unistd\.h|pthread\.h|sched\.h|poll\.h"
                     r"|lcm/.*|sys/.*|net/.*|netinet/.*|arpa/.*|linux/.*)$")
OUTSIDE_EXCEPTIONS = {
    "src/core/clock.cpp",   # the one clock the others are given
    "include/tendril/core/parallel.h",   # work on all cores, whose result does not depend on their number
    "src/gap/set_folder.cpp",  # whether files may be made there, and a name that no other program uses
    "src/sim/capstan_cache.cpp",  # tables that replays on several threads share
    "src/experiment/experiment_live.cpp",  # the operator's side of a running daemon, in real time
    "src/experiment/experiment_run.cpp",   # runs on several threads, and how long they took
    "src/motion/follower.cpp",             # an operator's program: streams in real time
    "src/experiment/diagnosis_run.cpp",    # how long it took
    "src/experiment/demo.cpp",             # how much faster than real time it was
    "src/commission/live_link.cpp",        # an operator's program: pulls in real time
    "src/commission/outcome.cpp",          # the date of a record, and on which computer it was made
}
# Narrower than the room: drives know the wire, not the master.
FORBIDDEN_HEADERS = {"emulator": {"tendril/canopen/master.h"}}


def sources(root, *folders, suffixes=(".h", ".cpp")):
    for folder in folders:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in suffixes and path.is_file():
                yield path


def room_of(path, root):
    parts = path.relative_to(root).parts
    return parts[2] if parts[0] == "include" else parts[1]  # src/<room>/..., studies/<room>/..., include/tendril/<room>/...


def read_rules(file):
    rules = {}
    for line in file.read_text().split("\n"):
        if line.strip():
            room, *others = line.split()
            rules[room] = set(others) | {room}
    return rules


def stays_in_room(path, header, root, room):
    target = (path.parent / header).resolve()
    return target.exists() and any((root / top / room).resolve() in target.parents for top in ("src", "studies"))


def include_violations(root, rules):
    """One line 'file:line: ...' for each include that the room of the file may not have."""
    found = []
    for path in sources(root, "src", "include", "studies"):
        room, name = room_of(path, root), str(path.relative_to(root))
        if room not in rules:
            found.append(f"{name}:1: '{room}' is no room (no tendril_room() names it)")
            continue
        for number, line in enumerate(path.read_text().split("\n"), 1):
            match = INCLUDE.match(line)
            if not match:
                continue
            header, where = match.group(2), f"{name}:{number}: {room} "
            parts = header.split("/")
            if parts[0] == "tendril":
                if parts[1] not in rules[room]:
                    found.append(where + f"may not include {header}; it may know: {', '.join(sorted(rules[room]))}")
                elif header in FORBIDDEN_HEADERS.get(room, ()):
                    found.append(where + f"may not include {header}")
            elif parts[0] == "tendril_lcm":
                if room not in ROOMS_OF_MESSAGES:
                    found.append(where + f"may not include {header}: messages are io's business")
            elif match.group(1) == '"' and not stays_in_room(path, header, root, room):
                found.append(where + f"may not include \"{header}\": use tendril/<room>/... or a file of the room")
            elif room not in ROOMS_OF_THE_OUTSIDE and OUTSIDE.match(header) and name not in OUTSIDE_EXCEPTIONS:
                found.append(where + f"may not include <{header}>: time, threads and sockets are passed in")
    return found


class Rooms(unittest.TestCase):
    def setUp(self):
        self.rules = read_rules(ARGUMENTS.rules)

    def test_every_include_is_allowed(self):
        violations = include_violations(ARGUMENTS.source, self.rules)
        self.assertFalse(violations, "\n" + "\n".join(violations))

    def test_the_rules_have_no_circle(self):
        rooms = {room: others - {room} for room, others in self.rules.items()}
        while rooms:
            free = [room for room, others in rooms.items() if not others & set(rooms)]
            self.assertTrue(free, f"these rooms know each other in a circle: {sorted(rooms)}")
            for room in free:
                del rooms[room]

    def test_the_simulator_never_sees_the_controller(self):
        for room in ("sim", "gap"):
            self.assertNotIn("control", self.rules.get(room, ()))
        for room in ("sim", "emulator", "rig"):
            self.assertNotIn(room, self.rules["control"] | self.rules["daemon"])
            self.assertNotIn("control", self.rules[room])

    def test_a_planted_violation_is_found(self):
        plants = {
            'src/model/a.cpp': '#include "tendril/can/can_port.h"',
            'src/control/a.cpp': "#include <chrono>",
            'src/emulator/a.cpp': '#include "tendril/canopen/master.h"',
            'include/tendril/core/a.h': '#include "tendril_lcm/state_t.hpp"',
            'src/core/b.cpp': '#include "../model/body.h"',
            'src/cellar/a.cpp': "",
            'studies/qi2021/a.cpp': '#include "tendril/gap/report.h"',
        }
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            for name, text in plants.items():
                (root / name).parent.mkdir(parents=True, exist_ok=True)
                (root / name).write_text(f"// one\n{text}\n")
            found = include_violations(root, self.rules)
        self.assertEqual(sorted(v.split(":")[0] for v in found), sorted(plants))


class SourceFiles(unittest.TestCase):
    """What a reader may expect of every file."""

    def everything(self):
        for folder, _, files in os.walk(ARGUMENTS.source):
            parts = pathlib.Path(folder).relative_to(ARGUMENTS.source).parts
            if parts and (parts[0] in (".git", "build", "out", ".cache") or "__pycache__" in parts):
                continue
            for name in files:
                path = pathlib.Path(folder) / name
                if path.suffix in (".png", ".svg", ".csv", ".pyc", ".bin", ".lcmlog") or "corpus" in path.parts:
                    continue
                try:
                    yield path, path.read_text()
                except UnicodeDecodeError:
                    continue

    def test_no_leftovers(self):
        # Put together here so that this file passes its own test.
        words = re.compile("|".join(("TO" + "DO", "FIX" + "ME", "\\bX" + "XX\\b", "<" * 7 + " ", ">" * 7 + " ",
                                     "/" + "work/", "/" + "tmp/b/", "deb\\.debian" + "\\.org")))
        found = [f"{p.relative_to(ARGUMENTS.source)}:{n}: {line.strip()}" for p, text in self.everything()
                 if p.name != "LICENSE" for n, line in enumerate(text.split("\n"), 1) if words.search(line)]
        self.assertFalse(found, "\n" + "\n".join(found))

    def test_text_is_clean(self):
        found = []
        for p, text in self.everything():
            if p.suffix not in (".h", ".cpp", ".py", ".sh", ".lcm", ".txt", ".cmake", ".yaml", ".json", ""):
                continue
            name = p.relative_to(ARGUMENTS.source)
            if "\r" in text or "\t" in text and "tests" not in p.parts:
                found.append(f"{name}: tabs or carriage returns")
            if text and not text.endswith("\n"):
                found.append(f"{name}: no newline at the end")
            found += [f"{name}:{n}: space at the end of the line"
                      for n, line in enumerate(text.split("\n"), 1) if line != line.rstrip()]
        self.assertFalse(found, "\n" + "\n".join(found))

    def test_each_file_says_what_it_is_for(self):
        found = []
        for path in sources(ARGUMENTS.source, "src", "include", "studies", "tools", "tests", suffixes=(".h", ".cpp")):
            # A file that implements a header begins with it; there the comment is in the header.
            first = path.read_text().split("\n", 1)[0]
            own = re.match(r'#include "(?:.*/)?([^/"]+)\.h"', first)
            if not first.startswith("// ") and not (own and own.group(1) == path.stem):
                found.append(str(path.relative_to(ARGUMENTS.source)))
        self.assertFalse(found, f"these files begin without a comment: {found}")


class Scripts(unittest.TestCase):
    def scripts(self):
        for folder in (".ci", "tools", "tests"):
            for path in sorted((ARGUMENTS.source / folder).rglob("*")):
                if path.is_file():
                    with path.open("rb") as file:
                        first = file.readline()
                    if first.startswith(b"#!"):
                        yield path, first.decode()

    def test_shell_scripts_parse(self):
        checked = 0
        for path, first in self.scripts():
            shell = next((w for w in ("bash", "sh") if w in re.split(r"[/\s]+", first)), None)
            if shell:
                done = subprocess.run([shell, "-n", str(path)], capture_output=True, text=True)
                self.assertEqual(done.returncode, 0, done.stderr)
                checked += 1
        self.assertGreater(checked, 4)

    def test_commands_are_executable(self):
        for path, _ in self.scripts():
            if "tests" not in path.relative_to(ARGUMENTS.source).parts or path.suffix == ".sh":
                self.assertTrue(os.access(path, os.X_OK), f"{path} is not executable")


def answer(*command):
    return subprocess.run([str(c) for c in command], capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=30)


class Programs(unittest.TestCase):
    """--help and --version answer with 0; wrong use is told on the error stream, with 2."""

    BINARIES = ("tendril", "tendrild", "tendril-plant")
    SCRIPTS = ("demo", "docs", "test", "setup", "vcan-run", "plot_demo.py")

    def programs(self):
        for name in self.BINARIES:
            yield ARGUMENTS.programs / name
        for name in self.SCRIPTS:
            yield ARGUMENTS.source / "tools" / name

    def subcommands(self, *command):
        """Every chain of subcommands of a CLI11 program, found in its help."""
        text = answer(*command, "--help").stdout
        if "\nSubcommands:\n" not in text:
            return
        for line in text.split("\nSubcommands:\n")[1].split("\n"):
            match = re.match(r"  (\S+)\s", line)
            if match:
                yield (*command, match.group(1))
                yield from self.subcommands(*command, match.group(1))

    def test_help(self):
        for program in self.programs():
            with self.subTest(program=program.name):
                done = answer(program, "--help")
                self.assertEqual((done.returncode, done.stderr), (0, ""))
                self.assertGreater(len(done.stdout), 40)

    def test_version(self):
        version = re.search(r"VERSION (\d+\.\d+\.\d+)", (ARGUMENTS.source / "CMakeLists.txt").read_text().split(
            "project(tendril")[1]).group(1)
        for program in self.programs():
            with self.subTest(program=program.name):
                done = answer(program, "--version")
                self.assertEqual((done.returncode, done.stderr), (0, ""))
                self.assertIn(version, done.stdout)

    def test_wrong_use(self):
        wrong = [(ARGUMENTS.programs / name, "--no-such-option") for name in self.BINARIES]
        wrong += [(ARGUMENTS.programs / "tendril",), (ARGUMENTS.programs / "tendril", "no-such-command"),
                  (ARGUMENTS.programs / "tendrild",)]
        tools = ARGUMENTS.source / "tools"
        wrong += [(tools / "setup", "--no-such-option"), (tools / "test", "no-such-option"), (tools / "docs", "no-such-command"), (tools / "vcan-run",),
                  (tools / "vcan-run", "--no-such-option", "true"), (tools / "vcan-run", "--timeout", "soon", "true"),
                  (tools / "plot_demo.py",)]
        for command in wrong:
            with self.subTest(command=" ".join(map(str, command))):
                done = answer(*command)
                self.assertEqual(done.returncode, 2, done.stderr)
                self.assertNotEqual(done.stderr.strip(), "")

    def test_every_subcommand(self):
        commands = list(self.subcommands(ARGUMENTS.programs / "tendril"))
        self.assertGreater(len(commands), 5)
        for command in commands:
            with self.subTest(command=" ".join(map(str, command[1:]))):
                self.assertEqual(answer(*command, "--help").returncode, 0)
                done = answer(*command, "--no-such-option")
                self.assertEqual(done.returncode, 2, done.stderr)
                self.assertNotEqual(done.stderr.strip(), "")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--source", type=pathlib.Path, required=True)
    parser.add_argument("--rules", type=pathlib.Path, required=True)
    parser.add_argument("--programs", type=pathlib.Path, required=True)
    ARGUMENTS, rest = parser.parse_known_args()
    unittest.main(argv=[sys.argv[0], *rest], verbosity=2)
