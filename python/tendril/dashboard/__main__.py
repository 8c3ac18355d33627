"""`python -m tendril.dashboard`, to which `tendril status --watch` hands over on a terminal."""

from __future__ import annotations

import argparse
import importlib.util
import os
import signal
import sys

from .._command_line import Parser, add_lcm_options, number
from ..errors import install

DESCRIPTION = """Shows what a daemon and its robot do, and operates it from the keyboard.

Modes and statuses with their remedies, tip and bends, tensions against their limits, drives, timing and events.
Keys: SPACE or d disarms (always), a arms, h holds, c clears a fault, j switches the jog on, t and 1 to 4 choose tip or
a section's bend, held arrow keys (for the tip PgUp and PgDn, too) move it, + and - choose the speed, q quits."""
EPILOG = """A jog key moves the robot only while it repeats; released, the motion ends within --release. What was armed or
moved from here is disarmed when the dashboard ends in any way. Needs a terminal of 80x24."""


def parser() -> argparse.ArgumentParser:
    """The options."""
    p = Parser(
        prog="tendril status --watch",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_lcm_options(p)
    p.add_argument(
        "--tip-speed",
        metavar="MM/S",
        type=number(0.1, 100, "mm/s"),
        help="limit of the jog of the tip (default: a fifth of the robot's length per second)",
    )
    p.add_argument(
        "--bend-speed",
        metavar="RAD/S",
        type=number(0.01, 2, "rad/s"),
        help="limit of the jog of a bend (default: the daemon's trajectory.default_speed_radps)",
    )
    p.add_argument(
        "--release",
        metavar="MS",
        default=150.0,
        type=number(60, 300, "ms"),
        help="how long one event of a jog key permits motion; longer than the keyboard's repeat, shorter than its "
        "delay (default: %(default)g)",
    )
    return p


def _missing() -> str:
    """Why it cannot start here; empty: it can."""
    if importlib.util.find_spec("textual") is None:
        return f"the dashboard needs textual; install it: {install('dashboard')}"
    # Textual draws on the standard error.
    if not all(stream.isatty() for stream in (sys.stdin, sys.stdout, sys.stderr)):
        return "the dashboard needs a terminal; for scripts: tendril status --json, or --watch through a pipe"
    if os.environ.get("TERM", "") in ("", "dumb"):
        return "the dashboard needs a terminal that can be drawn on (TERM is not set, or dumb); see tendril status"
    return ""


def _run(options: argparse.Namespace) -> int:
    from .. import Client
    from .app import Dashboard
    from .guard import Guard
    from .jog import Jog
    from .operator import Operator

    client = Client(options.lcm, options.prefix)
    client.state()  # nobody there: said before the screen is taken
    guard = Guard(options.lcm, options.prefix)
    guard.start()
    tip_speed = None if options.tip_speed is None else 1e-3 * options.tip_speed
    operator = Operator(client, guard, Jog(1e-3 * options.release), tip_speed, options.bend_speed)
    app = Dashboard(operator)
    try:
        code = app.run(mouse=False)
    finally:
        # The terminal may be gone, and with it what is written.
        for number in (signal.SIGHUP, signal.SIGTERM, signal.SIGINT):
            signal.signal(number, signal.SIG_IGN)
        was_ours = operator.ours
        trouble = operator.leave()
        client.close()
    if trouble:
        print(f"tendril: status: {trouble}", file=sys.stderr)
        return 1
    if was_ours and not app.ended_by:
        print("disarmed")
    return int(code if code is not None else app.return_code or 0)


def main() -> int:
    """Exit status: 0 left in order, 1 failed, 2 wrong use."""
    options = parser().parse_args()
    from .. import Error

    if missing := _missing():
        print(f"tendril: status: {missing}", file=sys.stderr)
        return 2
    try:
        return _run(options)
    except (Error, ValueError, OSError) as error:
        print(f"tendril: status: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
