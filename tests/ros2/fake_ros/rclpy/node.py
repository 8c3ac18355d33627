"""Fake: what the bridge uses of a node."""

from __future__ import annotations

import sys
import time
from typing import Any

from builtin_interfaces.msg import Time

import rclpy


class _Publisher:
    def __init__(self, kind: type, sent: list[Any]) -> None:
        self._kind, self._sent = kind, sent

    def publish(self, message: Any) -> None:
        assert type(message) is self._kind, message
        self._sent.append(message)


class _Logger:
    """As rclpy's, it refuses a place in the source that changes its severity."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str]] = []
        self._severity: dict[tuple[str, int], str] = {}

    def _log(self, level: str, line: str) -> None:
        caller = sys._getframe(2)
        place = caller.f_code.co_filename, caller.f_lineno
        if self._severity.setdefault(place, level) != level:
            raise ValueError("Logger severity cannot be changed between calls.")
        self.lines.append((level, line))

    def info(self, line: str, throttle_duration_sec: float = 0.0) -> None:
        self._log("info", line)

    def warning(self, line: str, throttle_duration_sec: float = 0.0) -> None:
        self._log("warning", line)

    def error(self, line: str, throttle_duration_sec: float = 0.0) -> None:
        self._log("error", line)


class _Now:
    def to_msg(self) -> Any:
        now = time.time_ns()
        return Time(sec=now // 10**9, nanosec=now % 10**9)


class _Clock:
    def now(self) -> _Now:
        return _Now()


class _Parameter:
    def __init__(self, value: Any) -> None:
        self.value = value


class Node:
    def __init__(self, name: str) -> None:
        self.name = name
        self.sent: dict[str, list[Any]] = {}
        self.services: dict[str, Any] = {}
        self.subscriptions_by_topic: dict[str, tuple[type, Any]] = {}
        self.timers: list[tuple[float, Any]] = []
        self.logger = _Logger()
        self.declared: dict[str, Any] = {}
        rclpy.nodes.append(self)

    def _full(self, topic: str) -> str:
        return topic.replace("~", "/" + self.name) if topic.startswith("~") else "/" + topic.lstrip("/")

    def declare_parameter(self, name: str, default: Any) -> _Parameter:
        value = rclpy.parameters.get(name, default)
        assert type(value) is type(default), (name, value)
        self.declared[name] = value
        return _Parameter(value)

    def create_publisher(self, kind: type, topic: str, qos: Any) -> _Publisher:
        return _Publisher(kind, self.sent.setdefault(self._full(topic), []))

    def create_subscription(self, kind: type, topic: str, callback: Any, qos: Any, *, callback_group: Any) -> None:
        self.subscriptions_by_topic[self._full(topic)] = kind, callback

    def create_service(self, kind: type, name: str, callback: Any, *, callback_group: Any) -> None:
        self.services[self._full(name)] = kind, callback

    def create_timer(self, period_s: float, callback: Any, *, callback_group: Any) -> None:
        self.timers.append((period_s, callback))

    def get_clock(self) -> _Clock:
        return _Clock()

    def get_logger(self) -> _Logger:
        return self.logger

    # ---- what a test does in place of other nodes ----

    def call(self, service: str) -> Any:
        kind, callback = self.services[service]
        return callback(kind.Request(), kind.Response())

    def receive(self, topic: str, message: Any) -> None:
        kind, callback = self.subscriptions_by_topic[topic]
        assert type(message) is kind, message
        callback(message)
