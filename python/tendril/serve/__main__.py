"""The command line of `tendril log serve`, which hands over to `python -m tendril.serve`."""

from __future__ import annotations

import argparse
import ipaddress
import logging
import os
import signal
import sys
import threading
import time

import foxglove

from .._command_line import Parser, add_duration, add_lcm_options, number, stop_signals
from ..view.frames import ViewError
from ..view.live import open_lcm
from .bridge import Bridge
from .guard import Admission, Guard, ServeError, hidden_address, is_loopback

DESCRIPTION = """What a running daemon publishes, live for Foxglove (its WebSocket protocol): every message, the robot's
frames and body, log lines. It sends nothing to a robot and takes nothing from viewers. Served on this machine only,
unless --address says otherwise; pages of other sites and other names of this machine are refused."""
SILENT_AFTER_S = 3.0


def address(text: str) -> str:
    """The type of --address."""
    try:
        return text if text == "localhost" else str(ipaddress.ip_address(text))
    except ValueError:
        accepted = "accepted: an IP address of this machine, or 0.0.0.0 for all"
        raise argparse.ArgumentTypeError(f"'{text}' is no address; {accepted}") from None


def make_parser() -> argparse.ArgumentParser:
    parser = Parser(prog="tendril log serve", description=DESCRIPTION)
    add_lcm_options(parser)
    parser.add_argument(
        "--port", type=number(0, 65535, kind=int), default=8765, help="of the address; 0: any (%(default)s)"
    )
    parser.add_argument(
        "--address",
        type=address,
        default="127.0.0.1",
        help="where it is served; any but a loopback address lets every machine that reaches it read along (%(default)s)",
    )
    parser.add_argument(
        "--host", action="append", default=[], metavar="NAME", help="one more name by which viewers reach it"
    )
    parser.add_argument(
        "--origin",
        action="append",
        default=[],
        metavar="ORIGIN",
        help="one more web page that may read along",
    )
    add_duration(parser, "the start")
    return parser


class Reporter:
    """Each line once: a page that is refused asks again and again."""

    def __init__(self) -> None:
        self._said: set[str] = set()

    def __call__(self, text: str) -> None:
        # A request's headers are whatever a stranger sent.
        text = "".join(c if c.isprintable() else "?" for c in text)[:500]
        if text not in self._said and len(self._said) < 100:
            self._said.add(text)
            print(f"tendril: log: {text}", file=sys.stderr, flush=True)


def warn_of_others(where: str, report: Reporter) -> None:
    if not is_loopback(where):
        report(
            f"warning: {where} is no loopback address: every machine that reaches it reads along, and nothing is "
            "encrypted; an SSH tunnel to 127.0.0.1 is safer"
        )


def run(bridge: Bridge, options: argparse.Namespace, report: Reporter, stop: threading.Event) -> None:
    start = heard = time.monotonic()
    count = 0
    while not stop.is_set():
        bridge.step()
        now = time.monotonic()
        if bridge.messages > count:
            count, heard = bridge.messages, now
        elif now > heard + SILENT_AFTER_S:
            report(
                f"no daemon answers on {options.lcm} ({options.prefix}_...); is tendrild or tendril sim running, with "
                "the same --lcm and --prefix?"
            )
        for remark in bridge.remarks():
            report(remark)
        if options.duration and now > start + options.duration:
            return


def serve(options: argparse.Namespace) -> None:
    lcm = open_lcm(options.lcm)
    report, stop, context, inner = Reporter(), threading.Event(), foxglove.Context(), hidden_address()
    logging.getLogger("foxglove").setLevel(logging.CRITICAL)  # of broken connections
    server = foxglove.start_server(name=f"tendril {options.prefix}", host=inner, port=0, context=context)
    try:
        admission = Admission(options.address, options.host, options.origin)
        guard = Guard(options.address, options.port, (inner, server.port), admission, Reporter())
        for one in stop_signals():
            signal.signal(one, lambda *_: stop.set())
        warn_of_others(options.address, report)
        bridge = Bridge(lcm, options.prefix, context)
        shown = f"[{options.address}]" if ":" in options.address else options.address
        print(f"ws://{shown}:{guard.port}  (Foxglove: Open connection; Ctrl-C ends it)", flush=True)
        run(bridge, options, report, stop)
        print(f"{bridge.messages} messages passed on", flush=True)
        guard.stop()
        bridge.close()
    finally:
        server.stop()


def main(arguments: list[str] | None = None) -> int:
    options = make_parser().parse_args(arguments)
    try:
        serve(options)
    except (ServeError, ViewError) as e:
        print(f"tendril: log: {e}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
