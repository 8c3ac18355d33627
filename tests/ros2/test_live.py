"""The bridge as a process of its own beside `tendril sim`: however it ends, the robot is disarmed."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import tendril
from tendril.messages import state_t

# Arms by its service, bends by its topic, and prints what it published.
PROGRAM = """
import threading, time
import numpy as np
import rclpy
from std_msgs.msg import Float64MultiArray
from tendril_ros2 import bridge


def operate():
    while not rclpy.nodes or not rclpy.nodes[0].sent.get("/joint_states"):
        time.sleep(0.05)
    node = rclpy.nodes[0]
    for _ in range(5):  # a busy machine takes its time to start the guard
        answer = node.call("/tendril/arm")
        if answer.success:
            break
    print(answer.message, flush=True)
    end = time.monotonic() + 20
    while time.monotonic() < end and not np.allclose(node.sent["/tendril/sections"][-1].position, [0.6, 0.3], atol=0.03):
        node.receive("/tendril/target_bending", Float64MultiArray(data=[0.6, 0.3]))
        time.sleep(0.05)
    time.sleep(0.4)  # the reference stands
    pose, joints = node.sent["/tendril/tip"][-1].pose.position, node.sent["/joint_states"][-1]
    print("tip", pose.x, pose.y, pose.z, *joints.position, flush=True)


threading.Thread(target=operate, daemon=True).start()
bridge.main()
"""


@contextlib.contextmanager
def simulated_robot():
    words = ["tendril", "sim", "--headless"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        line = process.stdout.readline()
        assert "Ctrl-C stops" in line, line
        yield
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)


def until_disarmed(client, within_s):
    end = time.monotonic() + within_s
    while time.monotonic() < end:
        if client.state().mode == state_t.MODE_CONFIGURED:
            return True
        time.sleep(0.1)
    return False


@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGKILL])
def test_arms_bends_and_disarms_however_it_ends(ending):
    with simulated_robot(), tendril.Client() as client:
        bridge = subprocess.Popen(
            [sys.executable, "-B", "-P", "-c", PROGRAM], stdout=subprocess.PIPE, text=True, env=os.environ
        )
        try:
            armed = bridge.stdout.readline()
            words = bridge.stdout.readline().split()
            assert words[0] == "tip", words
            state = client.state()
            assert state.mode == state_t.MODE_RUNNING, (armed, state.mode_text)
            np.testing.assert_allclose(state.bending_target_rad, [0.6, 0.3], atol=1e-9)
            np.testing.assert_allclose(np.array(words[1:4], float), state.tip_estimate_W_m, atol=5e-4)
            assert float(words[4]) == pytest.approx(0.6 / 8, rel=0.1)
        finally:
            bridge.send_signal(ending)
            bridge.wait(timeout=20)
        assert until_disarmed(client, 15.0)
