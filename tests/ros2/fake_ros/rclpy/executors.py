"""Fake: a thread a timer, until rclpy is shut down."""

import threading
import time

import rclpy


class ExternalShutdownException(Exception):
    pass


class MultiThreadedExecutor:
    def __init__(self, num_threads: int) -> None:
        self._nodes = []

    def add_node(self, node) -> None:
        self._nodes.append(node)

    def _repeat(self, period_s: float, callback) -> None:
        while rclpy.ok():
            callback()
            time.sleep(period_s)

    def spin(self) -> None:
        threads = [threading.Thread(target=self._repeat, args=timer) for node in self._nodes for timer in node.timers]
        for thread in threads:
            thread.start()
        while rclpy.ok():
            time.sleep(0.05)
        for thread in threads:
            thread.join()
        raise ExternalShutdownException
