"""A position-controlled robot that is watched: simulated runs of which only motors and tips are kept, other commands
every day; and rules by numbers made up here."""

import csv
import dataclasses
import io
import shutil
import types

import numpy as np
import pytest
import tendril
from conftest import ROBOTS
from tendril.watch import __main__ as program
from tendril.watch import page, postures, text
from tendril.watch.change import DAY_s
from tendril.watch.store import Entry, Key, Number, Store
from test_watch import run

ROBOT = ROBOTS / "rig_60mm.yaml"
PAYLOAD_kg = 0.02
PLAN = """name: slow
runs:
  - {{family: circle, duration_s: 6, amplitude_rad: {0}}}
  - {{family: triangle, duration_s: 8, amplitude_rad: {0}}}
"""
MASS = Key("tip_payload", "all", "mass_kg")
REMEDY = "accept the robot anew: tendril gap accept"
LOST = "states without a reading of a motor or a disk"
DISKS = [Key("held_out_error", f"disk 4 {axis}", "rms") for axis in "xyz"]


def motors_and_tips(data, every=8):
    """What a position controller and a camera record of these runs."""
    seen = ("t_s", "motor_position", "tip_x", "tip_y", "tip_z")
    return {
        name: table[[c for c in table.columns if c.startswith(seen)]].dropna().iloc[::every]
        for name, table in data.to_pandas().items()
    }


@pytest.fixture(scope="module")
def days(tmp_path_factory):
    """Folders: the accepted day, one with other commands, one with others and a mass at the tip, unusable ones."""
    place = tmp_path_factory.mktemp("days")
    made = {"accepted": ([], 0.6), "same": ([], 0.5), "changed": ([f"tip_payload mass_kg={PAYLOAD_kg}"], 0.55)}
    for seed, (name, (effects, amplitude)) in enumerate(made.items(), 1):
        (place / "plan.yaml").write_text(PLAN.format(amplitude))
        data = tendril.simulate(ROBOT, effects, plan=place / "plan.yaml", seed=seed)
        tables = motors_and_tips(data)
        if name != "same":  # the tracker lost the tip for a while
            circle = tables["01_circle"].copy()
            circle.loc[circle["t_s"].between(2, 3), ["tip_x_m", "tip_y_m", "tip_z_m"]] = float("nan")
            tables["01_circle"] = circle
        tendril.DataSet.from_dataframe(tables, ROBOT).to_folder(place / name)
    tendril.DataSet.from_dataframe({"a": tables["01_circle"].iloc[:60]}, ROBOT).to_folder(place / "short")
    data.to_folder(place / "with_tensions")
    without = {name: table.drop(columns="motor_position_rad_2") for name, table in tables.items()}
    tendril.DataSet.from_dataframe(without, ROBOT).to_folder(place / "no_motor_2")
    return place


@pytest.fixture(scope="module")
def watched(days):
    """The database after both days: itself, what accepting, the day and the alarm printed, its page and its report."""
    db, out, html = days / "watch.db", days / "out", days / "page.html"
    accepted = run("accept", "--db", db, "--robot", ROBOT, "--at", "2026-11-01", "--note", "new", days / "accepted")
    shutil.copy(db, days / "accepted.db")
    words = ["watch", "--db", db, "--robot", ROBOT, "--page", html, "--out", out]
    quiet = run(*words, "--at", "2026-11-02", days / "same")
    alarm = run(*words, "--at", "2026-11-03", days / "changed")
    return types.SimpleNamespace(db=db, accepted=accepted, quiet=quiet, alarm=alarm, page=html, out=out)


def kept(db):
    with Store(str(db), "ro") as store:
        accepted = store.accepted("rig_60mm")[-1]
        return accepted, store.days(accepted)


def test_the_accepted_state_is_how_well_the_robot_was_learned_disk_by_disk(watched):
    status, out, err = watched.accepted
    assert (status, err) == (0, "") and "learned: it misses disk 4 by 0." in out, (out, err)
    assert len([line for line in out.splitlines() if LOST in line]) == 1 and "tensions" not in out, out
    accepted, _ = kept(watched.db)
    assert accepted.diagnosed and list(accepted.numbers) == DISKS
    assert all(n.unit == "m" and 1e-5 < n.value < 1e-3 for n in accepted.numbers.values())
    rows = list(csv.DictReader(io.StringIO(run("history", "--db", watched.db, "--csv")[1])))
    assert {row["where"] for row in rows if row["kind"] == "accepted"} == {"disk 4 x", "disk 4 y", "disk 4 z"}


def test_a_day_with_other_commands_is_no_alarm(watched):
    assert watched.quiet == (0, "robot 'rig_60mm' on 2026-11-02: as accepted\n", "")


def test_a_mass_at_the_tip_is_an_alarm_with_its_cause_size_and_probability(watched):
    status, out, _ = watched.alarm
    assert status == program.CHANGED and out.startswith("ALARM: robot 'rig_60mm' on 2026-11-03: changed beyond")
    assert "tip_payload mass_kg +" in out and "since 2026-11-03; cause: tip_payload (p 0.9" in out, out
    assert "disk 4 z is missed by" in out and "mm when accepted)" in out
    assert out.count(LOST) == 1 and "@before" not in out, out
    entry = kept(watched.db)[1][-1]
    for channel in entry.channels:
        matters = np.hypot(channel["floor"], channel["delta"]) - channel["floor"]  # from there on it is in excess
        material = entry.numbers[Key("held_out_error", channel["name"], "rms")].material
        assert material == pytest.approx(matters) and 0 < material < channel["delta"]
    assert entry.finding["unchanged"] < 1e-6 and entry.finding["changes"][0]["effect"] == "tip_payload"
    change = postures.changes(kept(watched.db)[1])[0]
    assert change.key == MASS and change.ci[0] < PAYLOAD_kg < change.ci[1]
    report = tendril.Report.load(next(watched.out.glob("2026-11-03-*/report.json")))
    assert "tip_payload" in report.sentence and report.closed.channels["disk 4 z"].as_filed > 0


def test_the_course_of_every_disk_and_of_the_named_change_is_on_the_page(watched):
    shown = watched.page.read_text()
    assert "Held-out error" in shown and "tip_payload (p 0.9" in shown
    for key in (*DISKS, MASS):
        assert f"<h3>{key}</h3>" in shown
    cards = shown.split("Held-out error")[1].split("<div class='card'>")
    of_disk = next(card for card in cards if str(DISKS[2]) in card)
    assert of_disk.count("<circle") == 3  # accepted, and two days


def test_the_same_day_again_and_its_history_are_the_same_alarm(watched, days):
    again = run("watch", "--db", watched.db, "--robot", ROBOT, "--at", "2026-11-09", days / "changed")
    assert again == (program.CHANGED, watched.alarm[1], "")
    lines = run("history", "--db", watched.db)[1].splitlines()
    assert lines[1].endswith("as accepted") and "ALARM       tip_payload (p 0.9" in lines[2]
    assert "tip_payload mass_kg +" in lines[3]


@pytest.mark.parametrize(
    "words, line",
    [
        (["watch", "{days}/short"], "needs 40 (a state is a mean over 0.25 s"),
        (["accept", "{days}/short"], "needs 40 (a state is a mean over 0.25 s"),
        (["accept", "{days}/no_motor_2"], "no position of motor 2; accepted: readings of all 3 motors"),
        (["watch", "{days}/no_motor_2"], "no position of motor 2; accepted: readings of all 3 motors"),
        (["watch", "{days}/with_tensions"], "was accepted by motors and markers alone; accept it with runs like these"),
    ],
)
def test_what_cannot_be_weighed_is_one_line_and_not_entered(watched, days, words, line):
    was = run("history", "--db", watched.db, "--json")
    command, data = words[0], words[1].format(days=days)
    status, out, err = run(command, "--db", watched.db, "--robot", ROBOT, "--at", "2026-11-08", data)
    assert (status, out) == (1, "") and err.count("\n") == 1 and line in err, err
    assert run("history", "--db", watched.db, "--json") == was


def test_a_day_needs_the_accepted_runs_as_they_were(watched, days, tmp_path):
    """The robot is learned from them again."""
    db = tmp_path / "watch.db"
    with Store(str(db), "rwc") as store:
        state = kept(days / "accepted.db")[0]
        store.add(dataclasses.replace(state, id=0, runs={name: "0" for name in state.runs}))
        gone = dataclasses.replace(state, id=0, sources=[str(tmp_path / "gone")])
    words = ["watch", "--db", db, "--robot", ROBOT, "--at", "2026-11-08", days / "changed"]
    status, out, err = run(*words)
    assert (status, out) == (1, "") and "changed since it was accepted" in err and REMEDY in err, err
    with Store(str(db)) as store:
        store.add(gone)
    status, out, err = run(*words)
    assert (status, out) == (1, "") and "gone: no longer there" in err and REMEDY in err, err
    assert err.count("\n") == 1


def test_from_which_states_on_a_robot_is_learned(days):
    """With one state less than it needs, a calibration says that it was not done state by state."""
    table = tendril.DataSet.from_folder(days / "accepted").to_pandas()["02_triangle"].dropna(axis=1, how="all")
    table["t_s"] = [0.25 * row for row in range(len(table))]
    least = tendril._core.least_posture_states
    for count in (least - 1, least):
        runs = tendril.DataSet.from_dataframe(table.iloc[:count], ROBOT)
        assert postures.states(runs) == count
        too_few = any("not calibrated state by state" in note for note in tendril.calibrate(ROBOT, runs).notes)
        assert too_few == (count < least)
    assert postures.states(tendril.DataSet.from_folder(days / "with_tensions")) is None


def test_a_robot_that_is_not_that_of_the_file_is_not_accepted(days, monkeypatch):
    runs = tendril.DataSet.from_folder(days / "accepted")
    found = dataclasses.replace(tendril.calibrate(ROBOT, runs), not_learned="The robot cannot be learned. Check. ")
    monkeypatch.setattr(postures, "calibrate", lambda *_, **__: found)
    with pytest.raises(tendril.Error, match=r"^runs: The robot cannot be learned\. Check\.$"):
        postures.learned(dataclasses.replace(entry(0), sources=["runs"]), runs, None)
    tip = [types.SimpleNamespace(name="tip x", unit="m", held_out=0.001)]
    with pytest.raises(tendril.Error, match="runs: compared by 'tip x'.*; record"):
        postures.missed(tip, "runs")
    turns = [types.SimpleNamespace(name=f"turn of disk 4 about {axis}", unit="rad", held_out=0.1) for axis in "xyz"]
    assert postures.missed(turns, "runs") == "from orientations alone"


def test_what_was_left_out_is_told_with_the_entry_and_what_acceptance_said_is_not_told_again():
    of_accepted = ["run a: 3 of 24 states without a reading", "the tracker's clock gains 2 ms a second"]
    told = [
        "neither torques nor tensions: and so on",
        "a: the marker of disk 4 leaps away and back in 2 frames",
        "run a@before: 3 of 24 states without a reading",
        "run a@before: 5 of 24 states without a reading",
        of_accepted[1],
        of_accepted[0],
    ]
    notes = postures.day_notes(["left out: b"], ["left out: b", *told], of_accepted, ["a"])
    assert notes == ["left out: b", told[1], told[3], of_accepted[0]]


def test_numbers_that_had_not_settled_are_told_with_the_accepted_state(days, monkeypatch):
    runs = tendril.DataSet.from_folder(days / "accepted")
    told = ["neither torques nor tensions", "x", "x"]
    found = dataclasses.replace(tendril.calibrate(ROBOT, runs), converged=False, notes=told)
    monkeypatch.setattr(postures, "calibrate", lambda *_, **__: found)
    notes = postures.learned(dataclasses.replace(entry(0), sources=["runs"]), runs, None).notes
    assert notes[1:] == ["x", "the numbers of the robot had not settled after the allowed steps"]


def entry(day, cause=None, alarm=True, value=0.0):
    """A day whose diagnosis names this cause; None: nothing changed."""
    numbers = {MASS: Number("kg", value, 0.001, 0), DISKS[0]: Number("m", 0.004, 0, 1e-4)}
    channels = [{"name": "disk 4 x", "unit": "m", "rms": 0.004, "floor": 0.0005, "delta": 1e-4}]
    named = {"effect": "tip_payload", "where": "all", "p": 0.8}
    told = {"verdict": "unexplained", "sentence": "?", "remark": "", "established": False, "causes": []}
    if cause == "named":
        told |= {"verdict": "attributed", "established": True, "one_of_them": False, "causes": [named]}
    finding = {"alarm": alarm and cause is not None, "unchanged": 0.01, "changes": [], "false_alarms_per_year": 0.5}
    finding["cause"] = None if cause is None else told
    return Entry("arm", day * DAY_s, numbers, {}, channels=channels, finding=finding, diagnosed=True)


def test_a_change_is_since_the_first_day_of_those_that_name_it_without_a_break():
    course = [entry(1, "named"), entry(2), entry(3, "named", alarm=False), entry(4, "named", value=0.02)]
    change = postures.changes(course)[0]
    assert change.since == 3 * DAY_s and change.amount == 0.02 and change.z == pytest.approx(20) and change.alarm
    assert postures.changes(course[:3]) == [] and postures.changes([]) == []
    assert postures.unchanged(Key("bending_stiffness", "all", "scale")) == 1


def test_a_likely_change_that_days_without_one_show_too_is_no_alarm_and_says_so():
    report = types.SimpleNamespace(
        verdict="attributed",
        sentence="",
        accepted=[types.SimpleNamespace(effect="slack", where="tendon:1", p=0.9, group=0)],
        causes=[types.SimpleNamespace(effect="no_gap", p=0.01)],
    )
    assert not postures.finding(report, 0.5)["alarm"] and postures.finding(report, 10)["alarm"]
    day = entry(1, "named", alarm=False)
    assert text.sentence(day, []).endswith("not sure that anything changed; the diagnosis says: tip_payload (p 0.8)")
    words = text.day_text(day, day, [])
    assert not words.startswith("ALARM") and "probability that nothing changed: 0.01" in words
    state = dataclasses.replace(day, numbers={DISKS[0]: Number("m", 0.0005, 0, 0)})
    assert ">unsure<" in page.page(state, [day], [])


def test_an_alarm_without_a_cause_names_the_disk_that_is_missed_most():
    words = text.sentence(entry(1, "unexplained"), [])
    assert words.endswith("disk 4 x is missed by 4 mm (0.5 mm when accepted); cause: unexplained")
