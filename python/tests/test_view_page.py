"""The view's page as a browser has it: it draws, moves, keeps to itself, and no other site's page reaches it. Needs
Chromium; skipped where there is none."""

import functools
import http.server
import io
import json
import shutil
import subprocess
import sys
import threading

import numpy as np
import pytest

pytest.importorskip("viser", reason="the extra 'view' is not installed")
pytest.importorskip("lcm", reason="the extra 'view' is not installed")
if not shutil.which("chromium"):
    pytest.skip("no chromium here", allow_module_level=True)

import view_help
from conftest import SOURCE

sys.path.insert(0, str(SOURCE / "tools"))
import browser_page

PORT_LINE = "http://127.0.0.1:"


class View:
    """The command, running; a context."""

    def __init__(self, *words):
        words = [*map(str, words), "--port", "0", "--no-browser"]
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-u", "-m", "tendril.view", *words],
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        self.lines = []
        for line in self.process.stdout:
            self.lines.append(line)
            if line.startswith(PORT_LINE):
                self.address = line.split()[0]
                return
        raise AssertionError("".join(self.lines))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        rest, _ = self.process.communicate(timeout=30)
        self.lines += rest.splitlines()


def pixels(png):
    import imageio.v3 as iio

    return iio.imread(io.BytesIO(png), extension=".png")[:, :, :3].astype(int)


def like(image, colour, by=60):
    """How many pixels are about this colour."""
    return int((np.abs(image - np.array(colour)).sum(axis=2) < by).sum())


@pytest.fixture(scope="module")
def view(tmp_path_factory):
    log = view_help.circle_log(tmp_path_factory.mktemp("log") / "circle.lcmlog", seconds=30)
    with View(log) as running:
        yield running
    assert running.process.returncode == 0, running.lines
    assert "frames/s" in running.lines[-1] or "no page" in running.lines[-1], running.lines
    print(running.lines[-1])


READY = "document.querySelector('canvas') !== null && document.body.innerText.includes('tensions [N]')"


def test_the_page_draws_and_moves(view):
    with browser_page.Page(view.address + "?fixedDpr=0.5", 800, 500) as page:
        page.until(READY, within_s=120)
        first_time = page.evaluate("document.body.innerText.match(/([0-9.]+) s running/)[1]")
        page.until(f"document.body.innerText.match(/([0-9.]+) s running/)[1] - {first_time} > 1", within_s=60)
        first = pixels(page.picture())
        words = page.evaluate("document.body.innerText")
        page.until(f"document.body.innerText.match(/([0-9.]+) s running/)[1] - {first_time} > 2", within_s=60)
        second = pixels(page.picture())
        assert not page.messages, page.messages  # no error, and nothing that its own policy forbids
        scripts = page.evaluate(
            "performance.getEntriesByType('resource').map(r => r.name).filter(n => !n.startsWith('data:')"
            " && !n.startsWith('blob:') && new URL(n).host !== location.host)"
        )
    assert scripts == []  # nothing is fetched from elsewhere
    for word in ("time [s]", "play", "speed", "trail [s]", "tension", "reference", "tip off its reference"):
        assert word in words, words
    assert "Share" not in words
    left = first[:, :460]
    assert (
        like(left, (230, 128, 10), 90) > 20 and like(left, (10, 140, 125), 90) > 20
    )  # the tips and their trails
    assert (left.sum(axis=2) < 250).sum() > 200  # backbone and base
    assert (np.abs(first[:, :460] - second[:, :460]).sum(axis=2) > 60).sum() > 500


def test_a_page_of_another_site_does_not_reach_it(view, tmp_path):
    """The other site is another port of this machine: nearer than that no other page can be."""
    viser_version = __import__("viser").__version__
    host = view.address.removeprefix("http://")
    (tmp_path / "index.html").write_text(f"""<!DOCTYPE html><script>
      window.found = {{}};
      const socket = new WebSocket("ws://{host}", "viser-v{viser_version}");
      socket.onopen = () => found.socket = "open";
      socket.onerror = () => found.socket = "refused";
      fetch("http://{host}/").then(r => found.fetch = r.status, () => found.fetch = "refused");
      fetch("http://{host}/", {{mode: "no-cors"}}).then(r => found.opaque = r.type, () => found.opaque = "refused");
      </script><iframe src="http://{host}/"></iframe>""")
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(tmp_path))
    handler.log_message = lambda *_: None
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as site:
        threading.Thread(target=site.serve_forever, daemon=True).start()
        with browser_page.Page(f"http://127.0.0.1:{site.server_address[1]}/", 600, 400) as page:
            page.until("window.found && found.socket && found.fetch", within_s=60)
            found = page.evaluate("JSON.stringify(found)")
        site.shutdown()
    assert json.loads(found)["socket"] == "refused" and json.loads(found)["fetch"] == "refused"
