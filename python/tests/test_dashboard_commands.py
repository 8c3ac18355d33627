"""The dashboard without a screen: the dead man, what is sent and what is not, the guard, and what is shown."""

from __future__ import annotations

import os
import re
import subprocess
import threading

import numpy as np
import pytest

import tendril
from tendril.dashboard import guard as guard_side
from tendril.dashboard import state as view
from tendril.dashboard.__main__ import parser
from tendril.dashboard.jog import SEND_EVERY_S, Jog, Limits
from tendril.dashboard.operator import Operator
from tendril.messages import state_t

from stand_ins import Daemon, Guard, a_state

SENDER = 7
LIMITS = Limits(sections=1, length=0.06, max_bending=2.6, tip_speed=0.012, bend_speed=0.5)


@pytest.fixture()
def daemon(rig):
    return Daemon(rig)


@pytest.fixture()
def operator(daemon):
    operator = Operator(daemon, Guard(), Jog(), sender=SENDER)
    operator.tick(0.0)
    return operator


# ---- the dead man ----


@pytest.mark.parametrize("delay", [0.25, 0.5, 0.66])
def test_a_tap_moves_for_one_permission_whatever_the_keyboards_delay(delay):
    jog = Jog()
    jog.press((1, 0, 0), 0.0)
    assert jog.permitted(0.149) and not jog.permitted(0.151)
    assert not jog.permitted(delay - 0.01), "a held key pauses until it repeats"
    jog.press((1, 0, 0), delay)
    assert jog.permitted(delay + 0.092), "steady at the repeat of a Linux console"


def test_events_that_queued_up_move_nothing():
    jog = Jog()
    for at in np.arange(0, 1, 0.033):
        jog.press((1, 0, 0), float(at))
    assert not jog.permitted(2.0), "handled two seconds late"


def test_each_target_ends_by_itself_and_the_motion_in_a_rest():
    jog, state, at = Jog(), a_state(), 0.0
    jog.press((1, 0, 0), 0.0)
    targets = []
    while at < 1.0:
        if target := jog.step(at, state, LIMITS):
            targets.append((at, target))
        at += SEND_EVERY_S
    moving = [(when, target) for when, target in targets if target.rate.any()]
    assert moving and all(when + target.valid_for <= 0.15 + SEND_EVERY_S + 1e-9 for when, target in moving)
    assert np.allclose(moving[0][1].rate, [0.25 * 0.012, 0, 0]), "at a quarter of the limit"
    rests = [target for _, target in targets if not target.rate.any()]
    assert len(rests) == 3 and len({target.value.tobytes() for target in rests}) == 1
    assert rests[0].value[0] == pytest.approx(0.15 * 0.25 * 0.012, rel=1e-6)


def test_no_target_leaves_what_the_gate_accepts():
    jog = Jog()
    jog.faster(5)
    jog.choose("bend")
    at_limit = a_state(bending_desired_rad=np.array([2.59, 0.3]))
    for i in range(40):
        jog.press((1, 0), 0.05 * i)
        target = jog.step(0.05 * i, at_limit, LIMITS)
        assert np.linalg.norm(target.value) <= 2.6
    assert jog.held_back and not target.rate.any()
    jog.choose("tip")
    for i in range(40, 120):
        jog.press((0, 0, 1), 0.05 * i)
        target = jog.step(0.05 * i, a_state(), LIMITS)
    assert np.linalg.norm(target.value - [0, 0, 0.06]) < 0.1 * 0.06, "the robot does not follow: the target waits"


def test_another_kind_ends_the_motion_of_the_first():
    jog = Jog()
    jog.press((1, 0, 0), 0.0)
    jog.step(0.0, a_state(), LIMITS)
    jog.choose("bend")
    target = jog.step(0.05, a_state(), LIMITS)
    assert target.kind == "tip" and not target.rate.any()


# ---- what is sent ----


def test_what_the_gate_would_refuse_is_not_sent(operator, daemon):
    operator.jog_on = True
    operator.press((1, 0, 0), 0.1, 0.1)
    operator.tick(0.1)
    assert daemon.sent == [] and "204" in operator.message.text and "press a to arm" in operator.message.text
    operator.request("clear", 0.2)
    assert daemon.sent == [] and operator.message.refused
    daemon.heard = False
    operator.tick(2.0)
    operator.request("arm", 2.0)
    assert daemon.sent == [] and "no state" in operator.message.text


def test_arms_jogs_and_disarms_on_leaving(operator, daemon):
    operator.request("arm", 0.1)
    operator.tick(0.2)
    operator.press((1, 0, 0), 0.2, 0.2)
    operator.tick(0.25)
    assert daemon.sent == ["arm"], "the jog is off"
    operator.jog_on = True
    operator.press((1, 0, 0), 0.3, 0.3)
    operator.tick(0.3)
    assert daemon.targets[0][0] == "tip" and operator._guard.told[-1]
    assert operator.leave() == "" and daemon.sent[-1] == "disarm" and operator._guard.left is True


def test_only_watching_commands_nothing(operator, daemon):
    daemon.mode = state_t.MODE_RUNNING
    for i in range(40):
        operator.tick(0.05 * i)
    operator.leave()
    assert daemon.sent == []


def test_a_refusal_is_shown_and_ends_the_jog_until_the_key_is_let_go(operator, daemon):
    daemon.mode, operator.jog_on = state_t.MODE_RUNNING, True
    operator.tick(0.1)
    operator.press((1, 0, 0), 0.1, 0.1)
    operator.tick(0.15)
    daemon.changed = dict(command_sequence=(SENDER << 32) + 1, command_status=212, command_status_text="another; end it")
    operator.tick(0.2)
    assert operator.message.text == "another; end it (212)"
    count = len(daemon.targets)
    for at in (0.23, 0.26, 0.3, 0.35):
        operator.press((1, 0, 0), at, at)
        operator.tick(at)
    assert len(daemon.targets) == count
    operator.press((1, 0, 0), 0.9, 0.9)
    operator.tick(0.9)
    assert len(daemon.targets) == count + 1


def test_a_daemon_that_is_lost_is_disarmed_when_it_comes_back(operator, daemon):
    operator.request("arm", 0.1)
    operator.tick(0.2)
    daemon.heard = False
    operator.tick(1.5)
    assert daemon.sent[-1] == "disarm" and daemon.mode == state_t.MODE_RUNNING, "it heard nothing"
    daemon.heard = True
    operator.tick(1.8)
    assert daemon.mode == state_t.MODE_CONFIGURED


def test_without_its_guard_it_neither_arms_nor_jogs(daemon):
    operator = Operator(daemon, Guard(there=False), Jog(), sender=SENDER)
    operator.tick(0.0)
    operator.request("arm", 0.0)
    assert daemon.sent == [] and operator.message.refused


@pytest.mark.parametrize("letters, disarms", [(b"nna", 1), (b"nan", 0), (b"aq", 0), (b"n", 0), (b"", 0)])
def test_the_guard_disarms_what_was_left_armed(daemon, letters, disarms):
    read, write = os.pipe()
    with open(read, "rb") as end:
        os.write(write, letters)
        os.close(write)
        guard_side.stand_by(end, daemon)
    assert len(daemon.sent) == disarms


def test_the_guard_disarms_for_one_that_hangs(daemon):
    read, write = os.pipe()
    with open(read, "rb") as end:
        os.write(write, b"a")
        thread = threading.Thread(target=guard_side.stand_by, args=(end, daemon, 0.1))
        thread.start()
        thread.join(0.5)
        assert thread.is_alive() and daemon.sent == ["disarm"]
        os.close(write)
        thread.join(5)
    assert daemon.sent == ["disarm"]


# ---- what is shown ----


def test_words_are_those_of_the_daemons_tables(rig):
    event = tendril.Event(1, 402, "", "bus", "node 2: \x1b[31m0x7320")
    shown = view.text_of(view.events([event, event], 5))
    assert tendril._core.status_remedy(402) in shown and "(2 times)" in shown and "\x1b" not in shown
    head = view.text_of(view.heading(a_state(reported=np.array([310])), rig, None, 0))
    assert tendril._core.status_text(310) in head and tendril._core.status_remedy(310) in head
    assert tendril._core.drive_state_text(3) == "enabled" and tendril._core.drive_state_text(99) == "?"
    with pytest.raises(ValueError, match="accepted: arm"):
        tendril._core.accepted_in(4, "dance")


def test_tensions_stand_against_their_limits(rig):
    lines = view.tendons(a_state(), None, rig, None)
    bars = [line[1] for line in lines[1:]]
    assert bars[0][1] == "good" and bars[1] == ("█" * 16, "warn") and lines[2][3][1] == "bad"
    assert "-" in lines[3][2][0], "not known"
    assert view.bar(4, 8, 10) == "█████░░░░░" and view.bar(float("nan"), 8, 4) == "░░░░"


# ---- its options ----


@pytest.mark.parametrize("option", ["--tip-speed", "--bend-speed", "--release"])
def test_options_have_the_bounds_of_tendril_status(option, capsys):
    with pytest.raises(SystemExit):
        parser().parse_args([option, "nan"])
    ours = capsys.readouterr().err
    bounds = re.fullmatch(rf"tendril: status: argument {option}: 'nan' is not accepted; give (.+) (\S+); see .+\n", ours)
    assert bounds, ours
    words = ["tendril", "status", "--watch", option, "nan"]
    theirs = subprocess.run(words, capture_output=True, text=True, timeout=20, check=False)
    assert theirs.returncode == 2 and f"nan is not a number from {bounds[1]}; give {bounds[2]}" in theirs.stderr
