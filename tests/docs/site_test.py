#!/usr/bin/env python3
"""The site as a reader has it: it builds without a warning, every link and anchor leads somewhere, every page is in the
navigation, and nothing is fetched from elsewhere. Needs mkdocs (tools/setup installs it); skipped where it is missing."""
import html.parser
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import urllib.parse

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
FETCHING = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src", "video": "src"}


class Page(html.parser.HTMLParser):
    """Ids and links of a page."""

    def __init__(self, text):
        super().__init__()
        self.ids, self.links, self.fetched, self.twice = set(), [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        name = attributes.get("id")
        if name:
            (self.twice.append if name in self.ids else self.ids.add)(name)
        if tag == "a" and attributes.get("href"):
            self.links.append(attributes["href"])
        address = attributes.get(FETCHING.get(tag))
        # Addresses of the page itself, for search engines, are not fetched.
        if address and attributes.get("rel") != "canonical":
            self.fetched.append(address)


def broken_links(site):
    """One line 'page: link' for each that leads nowhere, and for each thing fetched from another host."""
    pages = {path: Page(path.read_text()) for path in site.rglob("*.html")}
    found = []
    for path, page in pages.items():
        name = path.relative_to(site)
        for link in page.links + page.fetched:
            scheme, host, to, _, fragment = urllib.parse.urlsplit(link)
            if scheme or host:
                if link in page.fetched and scheme != "data":
                    found.append(f"{name}: fetches {link}")
                continue
            target = site / to.lstrip("/") if to.startswith("/") else path.parent / urllib.parse.unquote(to)
            target = path if not to else target.resolve()
            if target.is_dir():
                target = target / "index.html"
            if not target.exists():
                found.append(f"{name}: {link}: no such page")
            elif fragment and target in pages and urllib.parse.unquote(fragment) not in pages[target].ids:
                found.append(f"{name}: {link}: no such place there")
        found += [f"{name}: two places are called #{name_}" for name_ in page.twice if name_.strip("_")]
    return found


def names_gone(page, sources):
    """Names in backticks that a page takes from the sources, and that stand in none of them: constants, types and
    functions, tests."""
    gone = []
    for quoted in re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", page, flags=re.S)):
        name = re.match(r"(k[A-Z]\w+|[A-Z][a-z]+[A-Z]\w*|[A-Z]\w+(?=\()|\w+_(?:test|bench|campaign)$)", quoted)
        words = re.findall(r"[A-Za-z_]\w{3,}", quoted) if name else []
        gone += [f"{quoted}: no {word}" for word in words if word not in sources and "NAME" not in word]
    return gone


class Names(unittest.TestCase):
    """What the pages for programmers call by name is called so in the sources."""

    def test_every_name_of_the_pages_is_in_the_sources(self):
        sources = set()
        for folder in ("include", "src", "tools", "tests", "cmake", "python"):
            for path in (ROOT / folder).rglob("*"):
                of_package = path.suffix == ".py" and folder == "python"
                if of_package or path.suffix in (".h", ".cpp", ".txt", ".inc", ".cmake"):
                    sources |= set(re.findall(r"\w+", path.read_text(errors="replace")))
        gone = [f"{page.relative_to(ROOT)}: {name}" for page in sorted((ROOT / "docs").rglob("*.md"))
                for name in names_gone(page.read_text(), sources)]
        self.assertEqual(gone, [])

    def test_a_name_that_is_gone_is_found(self):
        page = "`kRows` and `Step(Archive&)`, then `kGone`, `Forget(Archive&)` and `old_test`"
        self.assertEqual(names_gone(page, {"kRows", "Step", "Archive"}),
                         ["kGone: no kGone", "Forget(Archive&): no Forget", "old_test: no old_test"])


class Site(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        folder = pathlib.Path(cls.temporary.name).resolve()
        done = subprocess.run([ROOT / "tools" / "docs", "site", sys.argv[1], folder], capture_output=True, text=True,
                              stdin=subprocess.DEVNULL)
        cls.messages, cls.code = done.stdout + done.stderr, done.returncode
        cls.folder, cls.site = folder, folder / "site"

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    def setUp(self):
        self.assertEqual(self.code, 0, self.messages)

    def test_it_builds_without_a_word(self):
        self.assertNotIn("WARNING", self.messages)
        self.assertTrue((self.site / "search" / "search_index.json").exists())

    def test_links_and_anchors_lead_somewhere(self):
        self.assertEqual(broken_links(self.site), [])

    def test_every_page_is_in_the_navigation(self):
        listed = (self.folder / "mkdocs.yml").read_text()
        pages = [str(p.relative_to(self.folder / "src")) for p in (self.folder / "src").rglob("*.md")]
        self.assertGreater(len(pages), 12)
        self.assertEqual([page for page in pages if page not in listed], [])

    def test_what_is_broken_is_found(self):
        with tempfile.TemporaryDirectory() as name:
            site = pathlib.Path(name).resolve()
            (site / "a.html").write_text('<a href="b.html#here">x</a><a href="b.html#there">x</a><a href="c.html">x</a>'
                                         '<script src="https://elsewhere.example/x.js"></script>')
            (site / "b.html").write_text('<p id="here"></p>')
            self.assertEqual(broken_links(site), ["a.html: b.html#there: no such place there", "a.html: c.html: no such page",
                                                  "a.html: fetches https://elsewhere.example/x.js"])


if __name__ == "__main__":
    if shutil.which("mkdocs") is None:
        print("skipped: mkdocs is not installed (tools/setup installs it; Debian: mkdocs, mkdocs-material)")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1], verbosity=2)
