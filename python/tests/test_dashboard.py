"""The dashboard's screen and keys by Textual's own driver, beside a daemon that records what it is sent."""

from __future__ import annotations

import asyncio
import time

import numpy as np
import pytest

from tendril.messages import state_t

from stand_ins import Daemon, Guard

pytest.importorskip("textual", reason="SKIPPED: textual is not installed")

from tendril.dashboard.app import Dashboard
from tendril.dashboard.jog import Jog
from tendril.dashboard.operator import Operator


def at(rig, mode, size, steps):
    """Runs `steps(app, pilot)` on a screen of that size; returns the daemon."""
    daemon = Daemon(rig, mode)

    async def run() -> None:
        app = Dashboard(Operator(daemon, Guard(), Jog(), sender=1))
        async with app.run_test(size=size) as pilot:
            await pilot.pause(0.1)
            await steps(app, pilot)

    asyncio.run(run())
    return daemon


def shown(app) -> str:
    """The screen's text."""
    lines = app.screen._compositor.render_strips()
    return "\n".join("".join(segment.text for segment in strip) for strip in lines)


def test_everything_that_matters_is_on_80x24(rig):
    async def steps(app, pilot):
        text = shown(app)
        for words in ("SPACE or d  disarm", f"mode {state_t.MODE_CONFIGURED}", "tip [mm]", "bend 1", "a arm", "q quit"):
            assert words in text, text
        assert max(map(len, text.splitlines())) <= 80

    at(rig, state_t.MODE_CONFIGURED, (80, 24), steps)


def test_a_small_terminal_says_so_and_moves_nothing(rig):
    async def steps(app, pilot):
        text = " ".join(shown(app).split())
        assert "80x24 needed; d disarms" in text, text
        await pilot.press("j", "right", "right")
        await pilot.press("space")
        await pilot.pause(0.1)

    daemon = at(rig, state_t.MODE_RUNNING, (40, 10), steps)
    assert daemon.sent == ["disarm"] * len(daemon.sent) and daemon.sent


def test_a_held_key_moves_and_its_release_stops(rig):
    async def steps(app, pilot):
        await pilot.press("right")
        await pilot.pause(0.15)
        assert not daemon_of(app).sent, "the jog is off"
        await pilot.press("j")
        end = time.monotonic() + 0.5
        while time.monotonic() < end:
            await pilot.press("right")
        await pilot.pause(0.5)

    daemon = at(rig, state_t.MODE_RUNNING, (80, 24), steps)
    assert len(daemon.targets) == len(daemon.sent)
    moving = [command for command in daemon.sent if command[2] is not None and np.any(command[2])]
    assert len(moving) >= 3 and all(command[0] == "tip" for command in moving)
    assert all(command[2][0] > 0 and command[3] <= 0.25 for command in moving)
    assert daemon.sent[-1][2] is None, "the last target is at rest"


def test_a_key_that_waited_moves_nothing(rig):
    async def steps(app, pilot):
        app.operator.jog_on = True
        now = time.monotonic()
        app.operator.press((1.0, 0.0, 0.0), now - 0.5, now)
        await pilot.pause(0.2)

    assert not at(rig, state_t.MODE_RUNNING, (80, 24), steps).sent


def test_what_the_gate_would_refuse_is_not_sent(rig):
    async def steps(app, pilot):
        await pilot.press("a")
        await pilot.pause(0.25)
        assert "204" in app.operator.message.text and "press c" in app.operator.message.text

    assert not at(rig, state_t.MODE_FAULT, (80, 24), steps).sent


def test_arm_and_disarm_are_one_key_each(rig):
    async def steps(app, pilot):
        await pilot.press("a")
        await pilot.press("d")

    assert at(rig, state_t.MODE_CONFIGURED, (80, 24), steps).sent[:2] == ["arm", "disarm"]


def daemon_of(app) -> Daemon:
    return app.operator._client
