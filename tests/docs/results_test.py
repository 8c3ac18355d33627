#!/usr/bin/env python3
"""The tables of README.md and docs/results: each has one place, says which build measured it and when, and a table made
from records is what these records say."""
import importlib.machinery
import importlib.util
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
PROGRAMS = pathlib.Path(sys.argv.pop(1))

loader = importlib.machinery.SourceFileLoader("results", str(ROOT / "tools/results"))
spec = importlib.util.spec_from_loader("results", loader)
sys.dont_write_bytecode = True
results = importlib.util.module_from_spec(spec)
loader.exec_module(results)


def places(page):
    """Name and text of each table of a page."""
    return re.findall(r"<!-- results: (\w+) -->\n(.*?)<!-- end of results -->", page.read_text(), re.DOTALL)


class Results(unittest.TestCase):
    def test_every_table_has_one_place(self):
        pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
        found = sorted((name, str(page.relative_to(ROOT))) for page in pages for name, _ in places(page))
        self.assertEqual(found, sorted((name, block.page) for name, block in results.BLOCKS.items()))

    def test_every_table_says_its_build_and_has_rows(self):
        for page in sorted({block.page for block in results.BLOCKS.values()}):
            for name, text in places(ROOT / page):
                with self.subTest(table=name):
                    self.assertGreater(text.count("\n|"), 2)
                    if results.BLOCKS[name].command:
                        self.assertRegex(text, r"^\n`.+`, build [0-9a-f]{7,12}(-dirty)?(, \d{4}-\d\d-\d\d)?:\n")

    def test_the_table_of_the_sealed_campaigns_is_that_of_their_records(self):
        now = results.campaigns(PROGRAMS, None)
        page = ROOT / results.BLOCKS["campaigns"].page
        self.assertEqual([line for line in dict(places(page))["campaigns"].splitlines() if line.startswith("|")], now)

    def test_the_headline_says_of_the_sealed_campaigns_what_their_records_say(self):
        with tempfile.TemporaryDirectory() as folder:
            now = [f"| {' | '.join(row)} |" for row in results.sealed(pathlib.Path(folder))]
        said = dict(places(ROOT / "README.md"))["headline"].splitlines()
        self.assertEqual([line for line in said if line.startswith("| Sealed campaigns")], now)

    def test_numbers_have_no_exponent(self):
        self.assertEqual([results.digits(v) for v in (0.0732, 0.63412, 11.0, 99.96, 721.4, 16432, 1.2e-5)],
                         ["0.0732", "0.634", "11.0", "100", "721", "16400", "0.0000120"])

    def test_an_unknown_table_is_refused_with_those_there_are(self):
        done = subprocess.run([sys.executable, "-B", ROOT / "tools/results", "speeed"], capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 2)
        self.assertIn("no table 'speeed'; there are headline, ", done.stderr)


if __name__ == "__main__":
    unittest.main()
