#!/usr/bin/env python3
"""Pictures of pages of the built site at the width of a desktop and of a phone, by headless Chromium; fails where a
page is wider than its window. Run by tools/docs. Knows the site's folders, nothing of what the pages say."""
import argparse
import html
import json
import pathlib
import re
import subprocess
import sys
import tempfile

PAGES = ["index", "guides/first-hour", "reference/robot-file", "results/tracking", "explanation/control-laws"]
WIDTHS = {"desktop": 1280, "phone": 390}
HIGHEST = 8000  # Chromium draws no higher window; what lies below is cut off

# A frame has exactly the width that it is given; a window of Chromium's has 500 pixels at least.
FRAMES = """<!DOCTYPE html><meta charset="utf-8"><style>body {{ margin: 0; background: #888 }} iframe {{ border: 0; display: block }}</style>
{frames}
<pre id="sizes"></pre>
<script>
addEventListener("load", () => {{
  const sizes = [...document.querySelectorAll("iframe")].map(frame => {{
    const page = frame.contentDocument.scrollingElement;
    return [page.scrollWidth, page.scrollHeight];
  }});
  document.getElementById("sizes").textContent = JSON.stringify(sizes);
}});
</script>"""


class Browser:
    def __init__(self, program, folder):
        self.program, self.folder = program, pathlib.Path(folder)

    def run(self, frames, *options):
        """Shows (address, width, height) below each other; Chromium's standard output."""
        page = self.folder / "frames.html"
        page.write_text(FRAMES.format(frames="\n".join(
            f'<iframe src="{html.escape(address)}" width="{width}" height="{height}"></iframe>'
            for address, width, height in frames)))
        done = subprocess.run(
            [self.program, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
             "--allow-file-access-from-files", f"--user-data-dir={self.folder / 'profile'}", *options, page.as_uri()],
            capture_output=True, text=True, timeout=300)
        if done.returncode:
            sys.exit(f"{self.program} ended with {done.returncode}: {done.stderr.strip()[-500:]}")
        return done.stdout

    def sizes(self, frames):
        """Width and height that each page takes in its frame."""
        shown = re.search(r'<pre id="sizes">(.*?)</pre>', self.run(frames, "--dump-dom"))
        if not shown or not shown[1]:
            sys.exit(f"{self.program} shows no page: is the site built?")
        return json.loads(html.unescape(shown[1]))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("site", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("pages", nargs="*", default=PAGES, help="such as guides/tables")
    parser.add_argument("--browser", default="chromium")
    options = parser.parse_args()
    for page in options.pages:
        if not (options.site / f"{page}.html").is_file():
            sys.exit(f"the site has no page '{page}': name one as in {', '.join(PAGES)}")
    options.folder.mkdir(parents=True, exist_ok=True)
    wanted = [(page, name) for page in options.pages for name in WIDTHS]
    frames = [((options.site / f"{page}.html").resolve().as_uri(), WIDTHS[name], 800) for page, name in wanted]
    too_wide = []
    with tempfile.TemporaryDirectory() as work:
        browser = Browser(options.browser, work)
        for (page, name), (address, width, _), (taken, height) in zip(wanted, frames, browser.sizes(frames)):
            picture = options.folder / f"{page.replace('/', '-')}-{name}.png"
            height = min(height, HIGHEST)
            browser.run([(address, width, height)], f"--window-size={max(width, 500)},{height}",
                        f"--screenshot={picture.resolve()}")
            print(picture)
            if taken > width:
                too_wide.append(f"{page}: takes {taken} pixels in a window of {width}")
    if too_wide:
        sys.exit("\n".join(too_wide))


if __name__ == "__main__":
    main()
