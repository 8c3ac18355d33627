"""Where an alarm goes beyond this program: the journal, and operators over LCM."""

from __future__ import annotations

import os
import re
import sys
import time

from .. import _core
from ..errors import Error, install

CRITICAL = "<2>"  # as syslog(3) numbers them: systemd takes it from the line's head
NOTICE = "<5>"
DEGRADED = 319  # status: something beside the control loop is not as it should be


def in_journal(stream: int = 1) -> bool:
    """Whether systemd's journal reads this stream."""
    place = re.fullmatch(r"(\d+):(\d+)", os.environ.get("JOURNAL_STREAM", ""))
    if not place:
        return False
    try:
        seen = os.fstat(stream)
    except OSError:
        return False
    return (seen.st_dev, seen.st_ino) == (int(place[1]), int(place[2]))


def say(text: str, alarm: bool) -> None:
    """On the standard output; in the journal with its priority, each line of it."""
    prefix = (CRITICAL if alarm else NOTICE) if in_journal() else ""
    print("\n".join(prefix + line for line in text.splitlines()), flush=True)


def publish(text: str, url: str, prefix: str) -> None:
    """As an event, which `tendril status`, the dashboard and the daemon's log show. Raises Error."""
    try:
        import lcm

        from ..messages import event_t
    except ImportError:
        raise Error(f"--event needs lcm, which is not installed; install it: {install('watch')}") from None
    event = event_t()
    event.utime, event.status, event.source = round(1e6 * time.time()), DEGRADED, "gap watch"
    event.status_text, event.text = _core.status_text(DEGRADED), text
    try:
        lcm.LCM(url).publish(f"{prefix}_EVENT", event.encode())
    except (RuntimeError, OSError) as error:
        raise Error(f"--event: {url}: {error}; check --lcm and the route of its address") from None


def warn(command: str, text: str) -> None:
    print(f"tendril: gap {command}: {text}", file=sys.stderr, flush=True)
