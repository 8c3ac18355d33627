"""Stands in for rclpy: nodes keep what they make, messages go to whoever subscribed, timers run when a test calls them.

A parameter is as `rclpy.parameters` says, else as it is declared.
"""

from __future__ import annotations

import signal
from typing import Any

parameters: dict[str, Any] = {}
nodes: list[Any] = []
_down = False


def init(args: list[str] | None = None) -> None:
    """As rclpy does, which ends spinning on SIGINT and SIGTERM."""
    global _down
    _down = False

    def end(*_: object) -> None:
        global _down
        _down = True

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)


def ok() -> bool:
    return not _down


def try_shutdown() -> None:
    global _down
    _down = True
