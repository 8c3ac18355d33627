"""What the package's command lines have in common: options of who talks to a daemon, numbers, errors of one line."""

from __future__ import annotations

import argparse
import os
import re
import signal
import sys
from collections.abc import Callable
from typing import Any, NoReturn

from .client import DEFAULT_URL


class Parser(argparse.ArgumentParser):
    """Wrong use is one line, as `tendril` words it; `prog` is 'tendril WHAT'."""

    def error(self, message: str) -> NoReturn:
        print(f"tendril: {self.prog.split()[1]}: {message}; see {self.prog} --help", file=sys.stderr)
        raise SystemExit(2)


def number(least: float, most: float, unit: str = "", kind: type[float] | type[int] = float) -> Callable[[str], Any]:
    """The type of an option that is a number within bounds, which NaN is not."""

    def read(text: str) -> Any:
        try:
            value = kind(text)
        except ValueError:
            value = float("nan")
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"'{text}' is not accepted; give {least:g} to {most:g} {unit}".rstrip())
        return value

    return read


def prefix(text: str) -> str:
    """The type of --prefix, as the daemon accepts it."""
    if not re.fullmatch("[A-Za-z0-9_]{1,40}", text):
        raise argparse.ArgumentTypeError(f"'{text}' is not a prefix; accepted: 1 to 40 letters, digits and '_'")
    return text


def stop_signals() -> list[signal.Signals]:
    """Those that ask a program to end, without a hang-up that is ignored, as under nohup."""
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return [signal.SIGINT, signal.SIGTERM] + ([] if ignored else [signal.SIGHUP])


def add_duration(parser: argparse.ArgumentParser, since: str) -> None:
    """--duration, in seconds since something."""
    parser.add_argument(
        "--duration",
        type=number(0, 1e6, "s"),
        default=0.0,
        metavar="S",
        help=f"end this long after {since}; 0: on Ctrl-C (%(default)g)",
    )


def add_lcm_options(parser: argparse.ArgumentParser) -> None:
    """--lcm and --prefix."""
    parser.add_argument(
        "--lcm",
        metavar="URL",
        default=os.environ.get("LCM_DEFAULT_URL") or DEFAULT_URL,
        help="LCM address, as in the daemon's lcm.url (LCM_DEFAULT_URL; %(default)s)",
    )
    parser.add_argument(
        "--prefix",
        type=prefix,
        metavar="WORD",
        default="TENDRIL",
        help="as in the daemon's lcm.channel_prefix (%(default)s)",
    )
