"""From a daemon's LCM channels to the channels of a Foxglove server. Subscribes only: nothing here publishes to a
robot, and the server takes nothing from viewers."""

from __future__ import annotations

import re
import time
from typing import Any

import foxglove

from .. import _core
from ..logs.batch import LcmMessage, Sorter
from ..logs.encode import Encoder
from ..logs.output import Output, schema_of

MOST_AT_ONCE = 5000  # messages: a flood must not stop those before it
QUEUE = 2000  # messages of one subscription, two seconds at 1 kHz
TOGETHER_S = 0.02  # messages are encoded in batches: one at a time costs far more


class Bridge:
    """`lcm`: an open connection. `context`: the server's."""

    def __init__(self, lcm: Any, prefix: str, context: foxglove.Context):
        self._lcm, self._context = lcm, context
        self._came: list[LcmMessage] = []
        self._sorter, self._encoder = Sorter(), Encoder()
        self._channels: dict[tuple[str, str], foxglove.Channel] = {}
        self.messages = 0
        self._subscription = lcm.subscribe(f"{re.escape(prefix)}_.*", self._take)
        self._subscription.set_queue_capacity(QUEUE)

    def _take(self, channel: str, data: bytes) -> None:
        self._came.append((channel, _core.message_type(data), time.time_ns() // 1000, data))

    def _handle(self, within_s: float) -> bool:
        """Takes one message; False where none comes."""
        try:
            taken: int = self._lcm.handle_timeout(max(1, round(1000 * within_s)))
        except OSError:  # a signal came, or the network is gone for now
            time.sleep(TOGETHER_S)
            return False
        return taken > 0

    def step(self) -> None:
        """Waits a moment for messages and passes them on."""
        if not self._handle(TOGETHER_S):
            return
        until = time.monotonic() + TOGETHER_S
        while len(self._came) < MOST_AT_ONCE and (left := until - time.monotonic()) > 0:
            if not self._handle(left):
                break
        came, self._came = self._came, []
        self.messages += len(came)
        for output in self._encoder.encode(self._sorter.sort(came)):
            self._channel(output).log(output.data, log_time=output.time_ns)

    def _channel(self, output: Output) -> foxglove.Channel:
        key = output.topic, output.schema
        if key not in self._channels:
            schema = foxglove.Schema(name=output.schema, encoding="protobuf", data=schema_of(output.schema))
            self._channels[key] = foxglove.Channel(
                output.topic, schema=schema, message_encoding="protobuf", context=self._context
            )
        return self._channels[key]

    def remarks(self) -> list[str]:
        """What could not be passed on, and robots that are not drawn."""
        left_out = [f"{channel}: left out, {why}" for channel, why in self._sorter.left_out]
        return self._encoder.remarks() + left_out

    def close(self) -> None:
        self._lcm.unsubscribe(self._subscription)
