"""A robot that is watched, from runs to the alarm, on a few seconds of simulated runs."""

import contextlib
import csv
import dataclasses
import io
import json
import os
import re
import shutil
import subprocess
import sys
import time
import types
import xml.etree.ElementTree

import pytest
import tendril
from conftest import ROBOTS
from tendril.watch import __main__ as program
from tendril.watch import alarm, text
from tendril.watch.day import cause_json
from tendril.watch.store import Key, Store
from tendril.watch.text import cause_words

ROBOT = ROBOTS / "rig_60mm.yaml"
PLAN = """name: short
runs:
  - {family: circle, duration_s: 3, amplitude_rad: 0.6}
  - {family: triangle, duration_s: 4, amplitude_rad: 0.6}
"""
OFFSET = 0.05
ACCEPTED, DAY = "2026-11-01", "2026-11-02"


def run(*words):
    """Exit status, output and errors of `python -m tendril.watch`."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = program.main([str(word) for word in words])
        except SystemExit as ended:
            status = ended.code
    return status, out.getvalue(), err.getvalue()


@pytest.fixture(scope="module")
def days(tmp_path_factory):
    """Folders: the accepted day, one without a change, one whose load cell is off."""
    place = tmp_path_factory.mktemp("days")
    (place / "plan.yaml").write_text(PLAN)
    made = {"accepted": [], "same": [], "changed": [f"cell_offset where=tendon:1 N={OFFSET}"]}
    for seed, (name, effects) in enumerate(made.items(), 1):
        tendril.simulate(ROBOT, effects, plan=place / "plan.yaml", seed=seed).to_folder(place / name)
    return place


@pytest.fixture(scope="module")
def watched(days):
    """A database with the accepted state."""
    db = days / "watch.db"
    status, out, err = run(
        "accept", "--db", db, "--robot", ROBOT, "--at", ACCEPTED, "--note", "new", days / "accepted"
    )
    assert (status, err) == (0, ""), err
    assert "accepted as of 2026-11-01" in out
    shutil.copy(db, days / "accepted.db")
    return db


@pytest.fixture(scope="module")
def alarmed(days, watched):
    """After a day without and a day with a change: the database, and what the second printed."""
    quiet = run("watch", "--db", watched, "--robot", ROBOT, "--at", DAY, days / "same")
    assert quiet[0] == 0 and "as accepted" in quiet[1], quiet
    page, log = days / "page.html", days / "events.lcmlog"
    words = ["--at", "2026-11-03", "--no-cause", "--page", page, "--event", "--lcm", f"file://{log}?mode=w"]
    return watched, run("watch", "--db", watched, "--robot", ROBOT, *words, days / "changed"), page, log


def test_a_change_is_an_alarm_with_its_number_and_day(alarmed):
    db, (status, out, _), _, _ = alarmed
    assert status == program.CHANGED and out.startswith("ALARM: robot 'rig_60mm' on 2026-11-03")
    with Store(str(db), "ro") as store:
        last = store.days(store.accepted("rig_60mm")[-1])[-1]
    change = next(
        c for c in last.finding["changes"] if (c["effect"], c["where"]) == ("cell_offset", "tendon:1")
    )
    assert change["alarm"] and change["ci"][0] - 0.002 < OFFSET < change["ci"][1] + 0.002
    assert "since 2026-11-03" in out
    found = last.numbers[Key("cell_offset", "tendon:1", "N")]
    assert abs(found.value - OFFSET) < 4 * found.deviation and found.deviation < OFFSET / 10
    assert abs(last.numbers[Key("cell_offset", "tendon:3", "N")].value) < OFFSET / 2
    assert 0 < found.material < OFFSET


def test_the_alarm_is_an_event_over_lcm(alarmed):
    lcm = pytest.importorskip("lcm", reason="the extra 'watch' is not installed")
    from tendril.messages import event_t

    events = [(e.channel, event_t.decode(e.data)) for e in lcm.EventLog(str(alarmed[3]), "r")]
    assert [channel for channel, _ in events] == ["TENDRIL_EVENT"]
    assert events[0][1].source == "gap watch" and "changed beyond materiality" in events[0][1].text


def test_the_page_needs_nothing_else_and_shows_every_number(alarmed):
    page = alarmed[2].read_text()
    assert "http" not in page.replace("http-equiv", "") and "<script" not in page
    with Store(str(alarmed[0]), "ro") as store:
        numbers = store.accepted("rig_60mm")[-1].numbers
    for key in numbers:
        assert f"<h3>{key}</h3>" in page
    plots = re.findall("<svg.*?</svg>", page)
    assert len(plots) >= len(numbers)
    for plot in plots:
        points = [float(c.get("cy")) for c in xml.etree.ElementTree.fromstring(plot).iter("circle")]
        assert len(points) == 3 and all(0 < y < 150 for y in points)


def test_the_same_runs_again_are_the_same_entry_and_the_same_alarm(alarmed, days):
    db, (_, out, _), _, _ = alarmed
    again = run("watch", "--db", db, "--robot", ROBOT, "--at", "2026-11-09", "--no-cause", days / "changed")
    assert again == (program.CHANGED, out, "")


def test_history_has_every_number_of_every_entry(alarmed):
    db = alarmed[0]
    status, text, _ = run("history", "--db", db)
    assert status == 0 and "new" in text and "ALARM" in text
    rows = list(csv.DictReader(io.StringIO(run("history", "--db", db, "--csv")[1])))
    states = json.loads(run("history", "--db", db, "--json")[1])["states"]
    entries = [states[0]["accepted"], *states[0]["days"]]
    assert [entry["at"] for entry in entries] == sorted(entry["at"] for entry in entries)
    assert len(rows) == sum(len(entry["numbers"]) for entry in entries)
    last = [n for n in entries[-1]["numbers"] if (n["effect"], n["where"]) == ("cell_offset", "tendon:1")]
    kept = [
        r
        for r in rows
        if (r["effect"], r["where"], r["entry"]) == ("cell_offset", "tendon:1", str(entries[-1]["id"]))
    ]
    assert float(kept[0]["value"]) == last[0]["value"]


def settle(folder):
    """As though nothing had been written there for an hour."""
    for file in folder.rglob("*"):
        os.utime(file, (time.time() - 3600,) * 2)


def test_each_enters_what_is_new_in_order_and_leaves_out_what_cannot_be_read(days, watched, tmp_path):
    db, inbox = tmp_path / "watch.db", tmp_path / "inbox"
    with Store(str(watched), "ro") as store:
        accepted = store.accepted("rig_60mm")[0]
    with Store(str(db), "rwc") as store:
        store.add(accepted)
    shutil.copytree(days / "same", inbox / "2026-11-05")
    (inbox / "2026-11-04").mkdir()
    words = ["watch", "--db", db, "--robot", ROBOT, "--each", "--no-cause", inbox]
    later = time.time() + 1
    for file in (inbox / "2026-11-05").iterdir():
        os.utime(file, (later - 5,) * 2)
    status, out, err = run(*words)
    assert status == 1 and "2026-11-05: written" in err and "left for the next time" in err, err
    settle(inbox)
    status, out, err = run(*words)
    assert (
        status == 1 and err.count("\n") >= 1 and "2026-11-04" in err and "on 2026-11-05: as accepted" in out
    )
    os.rmdir(inbox / "2026-11-04")
    assert run(*words) == (0, "robot 'rig_60mm': nothing new\n", "")


def test_an_alarm_stands_until_the_robot_is_accepted_and_its_runs_are_not_entered_again(
    alarmed, days, tmp_path
):
    db, inbox = tmp_path / "watch.db", tmp_path / "inbox"
    shutil.copy(alarmed[0], db)
    inbox.mkdir()
    words = ["watch", "--db", db, "--robot", ROBOT, "--each", "--no-cause", inbox]
    status, out, _ = run(*words)
    assert (
        status == program.CHANGED and "ALARM: " in out and "nothing new since the alarm of 2026-11-03" in out
    )
    # On the day of the alarm the robot is mended and accepted: its broken runs of that day are no new entry.
    broken = inbox / "2026-11-03_broken"
    shutil.copytree(days / "changed", broken)
    settle(broken)
    with Store(str(db)) as store:
        state = store.accepted("rig_60mm")[-1]
        last = store.days(state)[-1]
        noon = program.day.recorded_at([str(broken)])
        store.add(dataclasses.replace(last, id=0, at=noon, runs={"x": "0"}, sources=[str(broken)]))
        store.add(dataclasses.replace(state, id=0, at=noon, runs={"y": "1"}))
    assert run(*words) == (0, "robot 'rig_60mm': nothing new\n", "")


def test_an_alarm_that_later_days_explain_is_still_reported(alarmed):
    with Store(str(alarmed[0]), "ro") as store:
        entry = store.days(store.accepted("rig_60mm")[-1])[-1]
    assert entry.finding["alarm"] and "the days entered since explain it" in text.sentence(entry, [])


def test_an_alarm_is_kept_though_its_diagnosis_is_cut_off(watched, days, tmp_path, monkeypatch):
    db = tmp_path / "watch.db"
    shutil.copy(days / "accepted.db", db)

    def cut_off(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(program.day, "name_cause", cut_off)
    words = ["watch", "--db", db, "--robot", ROBOT, "--at", "2026-11-07", "--out", tmp_path / "out"]
    assert run(*words, days / "changed")[0] == 130
    with Store(str(db), "ro") as store:
        last = store.days(store.accepted("rig_60mm")[-1])[-1]
    assert last.finding["alarm"] and last.finding["cause"] is None


def test_another_robot_file_is_not_compared(watched, days, tmp_path):
    other = tmp_path / "robot.yaml"
    program_words = [
        "tendril",
        "gap",
        "apply",
        "--robot",
        ROBOT,
        "--effect",
        "bending_stiffness scale=0.9",
        "--out",
        other,
    ]
    subprocess.run([str(word) for word in program_words], check=True, capture_output=True)
    status, out, err = run("watch", "--db", watched, "--robot", other, days / "same")
    assert (status, out) == (1, "") and "differs from the accepted robot file" in err


@pytest.mark.parametrize(
    "words, status, line",
    [
        (["watch", "--db", "none.db", "--robot", ROBOT, "x"], 1, "no such database"),
        (["watch", "--db", "{db}", "--robot", ROBOT, "--at", "yesterday", "x"], 2, "is no date"),
        (["watch", "--db", "{db}", "--robot", ROBOT, "--at", "2026-11-02", "nowhere"], 1, "nowhere"),
        (["watch", "--db", "{db}", "--robot", "nowhere.yaml", "x"], 1, "nowhere.yaml"),
        (
            ["watch", "--db", "{db}", "--robot", ROBOT, "--at", "2020-01-01", "{days}/accepted"],
            1,
            "before the accepted",
        ),
        (
            ["watch", "--db", "{db}", "--robot", ROBOT, "--at", "2026-11-09", "{days}/accepted"],
            1,
            "these are the accepted runs",
        ),
        (["watch", "--db", "{db}", "--robot", ROBOT, "--each", "--at", DAY, "{days}"], 1, "give one of them"),
        (
            ["watch", "--db", "{db}", "--robot", ROBOT, "--page", __file__, "{days}/same"],
            1,
            "no page of gap watch",
        ),
        (["watch", "--db", "{db}", "--robot", ROBOT, "--each", "nowhere"], 1, "no folder"),
        (["watch", "--db", "{db}", "--robot", ROBOT, "--false-alarms", "nan", "x"], 2, "not accepted"),
        (["accept", "--db", "{days}", "--robot", ROBOT, "{days}/same"], 1, "a folder"),
        (["accept", "--db", "no/new.db", "--robot", ROBOT, "{days}/same"], 1, "its folder is not there"),
        (["accept", "--db", "new.db", "--robot", ROBOT, "nowhere"], 1, "nowhere"),
        (
            ["watch", "--db", "{db}", "--robot", ROBOT, "--page", "no/p.html", "{days}/same"],
            1,
            "no such folder",
        ),
        (["history", "--db", "{db}", "--robot", "arm"], 1, "no robot 'arm'; there are rig_60mm"),
        (["history", "--db", "{db}", "--json", "--csv"], 2, "not allowed"),
    ],
)
def test_what_cannot_be_is_one_line_and_changes_nothing(
    watched, days, tmp_path, monkeypatch, words, status, line
):
    monkeypatch.chdir(tmp_path)
    was = run("history", "--db", watched, "--json")
    given = [str(word).format(db=watched, days=days) if "{" in str(word) else word for word in words]
    found, out, err = run(*given)
    assert (found, out) == (status, "") and err.count("\n") == 1 and line in err, err
    assert run("history", "--db", watched, "--json") == was and not list(tmp_path.iterdir())


def test_the_journal_gets_a_priority_on_every_line():
    read, write = os.pipe()
    place = os.fstat(write)
    code = "from tendril.watch import alarm; alarm.say('ALARM: a\\n  b', True)"
    environment = {**os.environ, "JOURNAL_STREAM": f"{place.st_dev}:{place.st_ino}"}
    subprocess.run([sys.executable, "-P", "-c", code], stdout=write, env=environment, check=True, timeout=60)
    os.close(write)
    with os.fdopen(read) as told:
        assert told.read() == "<2>ALARM: a\n<2>  b\n"
    assert not alarm.in_journal()


def test_causes_that_cannot_be_told_apart_are_all_named():
    def cause(effect, p, group):
        return types.SimpleNamespace(effect=effect, where="all", p=p, group=group)

    wrap, alpha, other = (
        cause("wrap_angle", 0.49, 1),
        cause("capstan_alpha", 0.48, 1),
        cause("unknown", 0.03, 0),
    )
    report = types.SimpleNamespace(
        verdict="ambiguous_group", sentence="", causes=[wrap, alpha, other], accepted=[wrap]
    )
    assert cause_words(cause_json(report, "")) == "wrap_angle (p 0.49) or capstan_alpha (p 0.48)"
    report = types.SimpleNamespace(
        verdict="attributed", sentence="", causes=[alpha, other], accepted=[cause("slack", 1, 0)]
    )
    assert cause_words(cause_json(report, "")) == "slack (p 1)"
    report = types.SimpleNamespace(verdict="no_gap", sentence="", causes=[other], accepted=[])
    assert cause_words(cause_json(report, "")) == "none by this day's runs alone"
