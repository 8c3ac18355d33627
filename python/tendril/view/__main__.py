"""The command line of `tendril view`, which hands over to `python -m tendril.view`."""

from __future__ import annotations

import argparse
import os
import signal
import socket
import sys
import threading
import webbrowser

from .._command_line import Parser, add_duration, add_lcm_options, number
from .frames import Recording, ViewError

DESCRIPTION = """The robot in 3-D, in a browser of this machine: live (without SOURCE), a log, a data set, or a
diagnosis. Backbone, disks, tendons coloured by tension between their limits, reference and measured tip with trails,
load cells as bars, base and gravity, with a time slider; a diagnosis shows the measured, the nominal and the corrected
robot side by side. It sends nothing to a robot, and serves 127.0.0.1 only."""
SOURCES = """LCM logs or folders with one, data-set folders, CSV files (with --robot), or the report.json of
tendril gap diagnose, or its folder, and the runs that it was made from (those of its own command line if left out)"""


def make_parser() -> argparse.ArgumentParser:
    parser = Parser(prog="tendril view", description=DESCRIPTION)
    parser.add_argument("source", metavar="SOURCE", nargs="*", help=SOURCES)
    parser.add_argument(
        "--robot", metavar="FILE", help="robot file, instead of the one in a log or a data set"
    )
    add_lcm_options(parser)
    parser.add_argument(
        "--port",
        type=number(0, 65535, kind=int),
        default=8095,
        help="of 127.0.0.1; 0: any that is free (%(default)s)",
    )
    parser.add_argument(
        "--at",
        type=number(0, 1e9, "s"),
        metavar="S",
        help="begin at rest at this time of the recording, instead of playing it",
    )
    parser.add_argument("--no-browser", action="store_true", help="only print the address")
    add_duration(parser, "a page was first open")
    return parser


def open_browser(address: str, wanted: bool) -> None:
    """The address, and a browser where there is a display for one."""
    port = address.rpartition(":")[2]
    print(f"{address}  (Ctrl-C ends it)", flush=True)
    if not wanted:
        return
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or sys.platform == "darwin"):
        print(
            f"no display here, so no browser: on the machine with the screen, run "
            f"ssh -L {port}:127.0.0.1:{port} {socket.gethostname()} and open the address there",
            flush=True,
        )
        return

    def show() -> None:
        try:
            shown = webbrowser.open(address)
        except webbrowser.Error:
            shown = False
        if not shown:
            print("no browser could be started: open the address in one", flush=True)

    threading.Thread(target=show, daemon=True).start()  # some browsers return when they are closed


def summary(recordings: list[Recording]) -> str:
    first = recordings[0]
    robots = first.robots[0].name
    times = ", ".join(f"{r.title} {r.duration_s:.1f} s" for r in recordings[:4])
    more = f" and {len(recordings) - 4} more" if len(recordings) > 4 else ""
    return f"tendril view: '{robots}': {times}{more}"


def require_within(recordings: list[Recording] | None, at_s: float | None) -> None:
    if recordings and at_s is not None and at_s > (most := recordings[0].duration_s):
        raise ViewError(f"--at {at_s:g}: '{recordings[0].title}' ends at {most:.1f} s; give a time up to that")


def show(options: argparse.Namespace) -> None:
    from . import server as servers
    from .live import Live
    from .show import Show
    from .sources import open_sources

    servers.require_free(options.port)  # before a long log is read
    recordings = open_sources(options.source, options.robot) if options.source else None
    require_within(recordings, options.at)
    live = None if recordings else Live(options.lcm, options.prefix)
    server = servers.start(options.port, "tendril view")
    try:
        if recordings:
            print(summary(recordings))
            for remark in recordings[0].remarks:
                print(f"  {remark}")
        else:
            print(f"tendril view: live from {options.lcm}, {options.prefix}_STATE")
        running, stop = Show(server, recordings, live, options.at), threading.Event()
        for one in (signal.SIGINT, signal.SIGTERM):  # until here they end it at once
            signal.signal(one, lambda *_: stop.set())
        open_browser(f"http://{servers.HOST}:{server.get_port()}", not options.no_browser)
        running.run(stop, options.duration)
        print(running.rate.line(), flush=True)
    finally:
        servers.stop(server)
        if live is not None:
            live.close()


def main(arguments: list[str] | None = None) -> int:
    options = make_parser().parse_args(arguments)
    if options.source == [] and options.robot is not None:
        make_parser().error(
            "--robot is for logs and tables; a running daemon says itself which robot it controls"
        )
    if options.source == [] and options.at is not None:
        make_parser().error("--at is a time of a recording; a live view begins at the present")
    try:
        show(options)
    except ViewError as e:
        print(f"tendril: view: {e}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    except OSError as e:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what is still to be written has no place
        if not isinstance(e, BrokenPipeError):
            print(f"tendril: view: {e.filename or 'the standard output'}: {e.strerror}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
