#!/usr/bin/env python3
"""A page in headless Chromium, in real time: pictures of it, and what a script finds in it. Knows nothing of the page.
Needs the Python package websockets, which the view brings along."""
import argparse
import base64
import itertools
import json
import pathlib
import subprocess
import sys
import tempfile
import time
import urllib.request

# WebGL by the processor: a machine without a screen has no graphics card to use.
OPTIONS = ["--headless=new", "--no-sandbox", "--hide-scrollbars", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
           "--no-first-run", "--disable-background-networking", "--disable-component-update", "--remote-debugging-port=0"]


class Page:
    """A context: Chromium, ended with it."""

    def __init__(self, address, width=1280, height=720, browser="chromium", start_s=30):
        self.folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self.messages = []  # of the page's console, and its errors
        self.process = subprocess.Popen(
            [browser, *OPTIONS, f"--user-data-dir={self.folder.name}", f"--window-size={width},{height}", "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            self._connect(start_s)
            self.numbers = itertools.count(1)
            for domain in ("Page", "Runtime", "Log", "Network"):
                self.call(f"{domain}.enable")
            # The window's own size counts bars that no page shows.
            self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
            self.call("Page.navigate", url=address)
        except BaseException:
            self.close()
            raise

    def _connect(self, start_s):
        from websockets.sync.client import connect
        port_file, end = pathlib.Path(self.folder.name) / "DevToolsActivePort", time.monotonic() + start_s
        while not port_file.exists() or not port_file.read_text().strip():
            if self.process.poll() is not None or time.monotonic() > end:
                raise RuntimeError("Chromium does not start")
            time.sleep(0.1)
        port = port_file.read_text().split()[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=start_s) as answer:
            target = next(t for t in json.load(answer) if t["type"] == "page")
        self.socket = connect(target["webSocketDebuggerUrl"], max_size=None, proxy=None)

    def call(self, method, **parameters):
        """Of the DevTools protocol."""
        number = next(self.numbers)
        self.socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self.socket.recv(timeout=60))
            if message.get("id") == number:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']}")
                return message["result"]
            self._note(message)

    def _note(self, message):
        kind, details = message.get("method"), message.get("params", {})
        if kind == "Runtime.exceptionThrown":
            self.messages.append(details["exceptionDetails"].get("exception", {}).get("description", "an exception"))
        elif kind == "Log.entryAdded" and details["entry"]["level"] == "error":
            self.messages.append(details["entry"]["text"])

    def evaluate(self, script):
        """The value of a script, a promise's when it is settled."""
        result = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in result:
            raise RuntimeError(result["exceptionDetails"].get("exception", {}).get("description", "the script failed"))
        return result["result"].get("value")

    def until(self, script, within_s=30):
        """Waits until the script's value is true. One that fails is not true yet: a new page has no body."""
        end = time.monotonic() + within_s
        while not self.evaluate(f"(() => {{ try {{ return Boolean({script}) }} catch {{ return false }} }})()"):
            if time.monotonic() > end:
                raise TimeoutError(f"not within {within_s} s: {script}; the page says: {self.messages[-3:]}")
            time.sleep(0.2)

    def picture(self):
        """The window's contents as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def close(self):
        if hasattr(self, "socket"):
            self.socket.close()
        self.process.terminate()
        try:
            self.process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.folder.cleanup()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def await_server(address, within_s):
    """A browser that finds nobody there does not try again."""
    end = time.monotonic() + within_s
    while True:
        try:
            urllib.request.urlopen(address, timeout=10).close()
            return
        except OSError as e:
            if time.monotonic() > end:
                sys.exit(f"{address}: nobody answers within {within_s:g} s ({e})")
            time.sleep(0.1)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("address")
    parser.add_argument("picture", type=pathlib.Path)
    parser.add_argument("--size", default="1280x720")
    parser.add_argument("--wait", default="true", help="a script whose value is true once the page is ready")
    parser.add_argument("--after", type=float, default=2, help="seconds from then to the picture")
    parser.add_argument("--within", type=float, default=120, help="seconds that this may take")
    parser.add_argument("--do", default="null", help="a script to run before the picture")
    options = parser.parse_args()
    width, height = (int(n) for n in options.size.split("x"))
    await_server(options.address, options.within)
    with Page(options.address, width, height) as page:
        page.until(options.wait, options.within)
        page.evaluate(options.do)
        end = time.monotonic() + options.after
        while time.monotonic() < end:
            page.evaluate("1")  # takes in what the page says
            time.sleep(0.2)
        options.picture.write_bytes(page.picture())
        for message in page.messages:
            print(message, file=sys.stderr)


if __name__ == "__main__":
    main()
