#!/usr/bin/python3 -B
"""The runner of documentation pages: what it must pass and, more important, what it must fail."""
import pathlib
import subprocess
import sys
import tempfile
import time
import unittest

HERE = pathlib.Path(__file__).resolve().parent


def page(*blocks):
    return "# A page\n\n" + "\n\n".join(blocks) + "\n"


def run(text, *attributes):
    return f"```{{.sh .run{''.join(' ' + a for a in attributes)}}}\n{text}\n```"


def output(text, *attributes):
    return f"```{{.text .output{''.join(' ' + a for a in attributes)}}}\n{text}\n```"


class RunBlocks(unittest.TestCase):
    def result(self, text):
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            (folder / "page.md").write_text(text, encoding="utf-8")
            (folder / "bin").mkdir()
            # One of the programs that a page finds on its path, and the place of the sources.
            program = folder / "bin" / "show-sources"
            program.write_text("#!/bin/sh\ncat $TENDRIL/sources.txt\n")
            (folder / "sources.txt").write_text("of this tree\n")
            program.chmod(0o755)
            return subprocess.run([sys.executable, "-B", HERE / "run_blocks.py", folder / "page.md", "--bin",
                                   folder / "bin", "--source", folder], capture_output=True, text=True)

    def passes(self, text):
        result = self.result(text)
        self.assertEqual(result.returncode, 0, result.stderr)

    def fails(self, text, *says):
        result = self.result(text)
        self.assertEqual(result.returncode, 1, result.stdout)
        for words in says:
            self.assertIn(words, result.stderr)

    def test_blocks_run_in_order_in_one_folder_with_the_programs_at_hand(self):
        text = page(run("echo 1 > here"), run("cat here; show-sources"), output("1\nof this tree"))
        self.passes(text)
        self.fails(text.replace("echo 1", "echo 2"), "actual\n    2\n    of this tree")
        self.fails(text.replace("this tree", "another tree"), "actual\n    1\n    of this tree")
        self.fails(text.replace("> here", "> there"), "exit status 1", "here")

    def test_a_block_that_is_not_marked_is_not_run(self):
        self.passes(page("```sh\nfalse\n```", run("true")))

    def test_a_failing_command_fails_wherever_it_stands(self):
        self.fails(page(run("false")), "page.md:3", "exit status 1")
        self.fails(page(run("false\ntrue")), "exit status 1")
        self.fails(page(run("false | cat")), "exit status 1")
        self.fails(page(run("no-such-program")), "exit status 127", "not found")

    def test_what_a_failing_block_left_in_the_background_ends_with_it(self):
        with tempfile.TemporaryDirectory() as folder:
            left = pathlib.Path(folder) / "left"
            self.fails(page(run(f"sleep 1000 > /dev/null 2>&1 & echo $! > {left}\nfalse")), "exit status 1")
            state = pathlib.Path(f"/proc/{left.read_text().strip()}/stat")
            # Gone, or dead and not yet collected by its parent.
            deadline = time.monotonic() + 10
            while state.exists() and state.read_text().rpartition(")")[2].split()[0] != "Z":
                self.assertLess(time.monotonic(), deadline, "still running")
                time.sleep(0.02)

    def test_an_expected_exit_status_is_held_to(self):
        self.passes(page(run("exit 2", 'exit="2"')))
        self.fails(page(run("true", 'exit="2"')), "exit status 0, expected 2")

    def test_other_output_fails_and_shows_both(self):
        self.fails(page(run("echo one"), output("two")), "page.md:7", "expected\n    two", "actual\n    one")
        self.fails(page(run("echo one; echo more"), output("one")), "more")
        self.fails(page(run("echo one"), output("one\nmore")), "more")
        self.fails(page(run("true"), output("one")), "(nothing)")

    def test_spaces_and_empty_lines_do_not_count(self):
        self.passes(page(run("echo 'a    b'; echo; echo c"), output("a b\nc")))

    def test_dots_stand_for_anything(self):
        self.passes(page(run("seq 5"), output("1\n...\n5")))
        self.passes(page(run("echo took 12 s"), output("took ... s")))
        self.fails(page(run("seq 5"), output("1\n...\n6")), "actual")

    def test_figures_are_equal_without_a_tolerance(self):
        self.fails(page(run("echo error 0.654"), output("error 0.653")), "0.654")

    def test_figures_are_compared_within_the_tolerance(self):
        shown = output("error 0.653 mm, x -2e-3, 0 misses", 'tolerance="5%"')
        self.passes(page(run("echo error 0.680 mm, x -2.05e-3, 0 misses"), shown))
        self.fails(page(run("echo error 0.690 mm, x -2e-3, 0 misses"), shown), "0.690")
        self.fails(page(run("echo error 0.653 mm, x 2e-3, 0 misses"), shown), "2e-3")
        self.fails(page(run("echo error 0.653 mm, x -2e-3, 1 misses"), shown), "1 misses")
        self.fails(page(run("echo error many mm, x -2e-3, 0 misses"), shown), "many")

    def test_digits_within_a_name_are_no_figure(self):
        self.fails(page(run("echo rig_61mm"), output("rig_60mm", 'tolerance="5%"')), "rig_61mm")

    def test_a_page_that_shows_nothing_to_run_fails(self):
        self.fails(page("```sh\ntrue\n```"), "no block to run")

    def test_a_page_with_a_slip_fails(self):
        self.fails(page("```{.sh .run}\ntrue"), "not closed")
        self.fails(page(output("one")), "follows no block")
        self.fails(page(run("echo 1"), output("1", 'tolerance="much"')), "no percentage")

    def test_a_block_in_an_admonition_is_run(self):
        self.fails(page("!!! note\n    ```{.sh .run}\n    false\n    ```"), "exit status 1")


if __name__ == "__main__":
    unittest.main()
