"""Simulated sets, tables and the diagnosis: the numbers of the command line bit for bit, exact tables, Ctrl-C, errors."""

from __future__ import annotations

import dataclasses
import json
import re
import signal
import subprocess
import sys
import threading
import time
import types

import numpy as np
import pandas
import pytest

import tendril
from tendril.data_set import as_set

from conftest import ROBOTS, SOURCE, program

ROBOT = ROBOTS / "rig_60mm.yaml"
PLAN = SOURCE / "examples" / "session_plan.yaml"
PAYLOAD = "tip_payload mass_kg=0.002"
FEW = ["tip_payload", "bending_stiffness", "backlash"]
# One motion and its repeat, as short as they may be.
SHORT = "runs:\n  - {family: circle, duration_s: 3, repeats: 1}\n"


@pytest.fixture(scope="module")
def data():
    seen = []
    made = tendril.simulate(ROBOT, [PAYLOAD], plan=PLAN, seed=3, progress=lambda *stage: seen.append(stage))
    assert {name for name, _ in seen} >= {run.name for run in made} and all(0 <= share <= 1 for _, share in seen)
    return made


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The same set by the command line."""
    out = tmp_path_factory.mktemp("cli") / "set"
    program("gap", "simulate", "--robot", ROBOT, "--plan", PLAN, "--effect", PAYLOAD, "--seed", 3, "--out", out)
    return out


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """A plan for what takes long on any runs and gives the same of few: its file."""
    plan = tmp_path_factory.mktemp("short") / "plan.yaml"
    plan.write_text(SHORT)
    return plan


@pytest.fixture(scope="module")
def short_data(short):
    return tendril.simulate(ROBOT, [PAYLOAD], plan=short, seed=3)


@dataclasses.dataclass
class Diagnosed:
    """A diagnosis, and what was seen while it ran."""

    report: tendril.Report
    stages: list[str]
    turns: int
    """That another thread of the interpreter took, at most one a millisecond."""


@pytest.fixture(scope="module")
def diagnosed(folder):
    stages, turns, over = [], 0, threading.Event()

    def count():
        nonlocal turns
        while not over.wait(0.001):
            turns += 1

    thread = threading.Thread(target=count)
    thread.start()
    try:
        report = tendril.diagnose(ROBOT, folder, only=FEW, next=False, progress=lambda stage, _: stages.append(stage))
    finally:
        over.set()
        thread.join()
    return Diagnosed(report, stages, turns)


@pytest.fixture(scope="module")
def report(diagnosed):
    return diagnosed.report


def test_simulated_files_equal_the_command_lines(data, folder, tmp_path):
    data.to_folder(tmp_path / "set")
    names = sorted(file.name for file in folder.iterdir())
    assert names == sorted(file.name for file in (tmp_path / "set").iterdir()) and "robot.yaml" in names
    for name in names:
        assert (folder / name).read_bytes() == (tmp_path / "set" / name).read_bytes(), name


def comparable(report):
    """A report without what its maker and its time of day put into it."""
    report["provenance"].update(command="", revision="", seconds=0)
    report["next_commands"] = []
    return report


def test_report_equals_the_command_lines(diagnosed, folder, tmp_path):
    few = ",".join(FEW)
    program("gap", "diagnose", "--robot", ROBOT, folder, "--only", few, "--no-next", "--out", tmp_path / "out")
    theirs = json.loads((tmp_path / "out" / "report.json").read_text())
    ours = diagnosed.report
    assert comparable(json.loads(ours.to_json())) == comparable(theirs)
    assert len(set(diagnosed.stages)) > 2
    ours.save(tmp_path / "ours")
    assert tendril.Report.load(tmp_path / "ours" / "report.json") == ours
    assert (tmp_path / "ours" / "report.html").read_text() == ours.to_html()


def test_a_planted_effect_is_found(data, report):
    assert report.verdict == "attributed" and report.accepted[0].effect == "tip_payload"
    assert report.accepted[0].parameters["mass_kg"].value == pytest.approx(0.002, rel=0.1)
    assert report.closed.pooled.value > 0.8
    assert report.sentence in str(report).replace("\n", " ") or "tip_payload" in str(report)
    better = report.corrected(data.robot)
    tip = [tendril.Model(robot).fk(tendril.Model(robot).statics([1, 0.3, 0.3])).position for robot in (data.robot, better)]
    assert tip[1][2] < tip[0][2]  # the payload bends it further


def test_what_changed_is_found(short, short_data):
    before = tendril.simulate(ROBOT, plan=short, seed=4)
    change = tendril.diagnose(ROBOT, short_data, before, only=FEW, next=False)
    assert change.accepted[0].effect == "tip_payload"
    assert {run.before for run in change.provenance.runs} - {""}


def mirrored(value):
    if dataclasses.is_dataclass(value):
        fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value) if f.name != "_diagnosis"}
        return {("from" if k == "_from" else k): mirrored(v) for k, v in fields.items()}
    if isinstance(value, dict):
        return {key: mirrored(item) for key, item in value.items()}
    return [mirrored(item) for item in value] if isinstance(value, (list, tuple)) else value


def test_a_notebook_shows_the_summary_and_a_debugger_one_line(report):
    shown = []
    report._repr_pretty_(types.SimpleNamespace(text=shown.append), False)
    assert shown == [str(report)]
    assert "tip_payload" in repr(report) and "\n" not in repr(report) and len(repr(report)) < 500


def test_dataclasses_mirror_the_json(report):
    values = json.loads(report.to_json())
    ours = mirrored(report)
    for finding in ours["location"]:  # these two are there only where they have a value
        for key in ("tendon", "section"):
            if finding[key] is None:
                del finding[key]
    for channel in ours["closed"]["channels"].values():  # as is this
        if channel["as_filed"] is None:
            del channel["as_filed"]
    assert ours == values


def test_tables_come_back_as_they_went(data):
    tables = data.to_pandas()
    assert list(tables) == [run.name for run in data]
    assert all(run in data and run.name in data for run in data) and "none" not in data
    runs = {run.name: {"family": run.family, "repeat_of": run.repeat_of or "none"} for run in data}
    again = tendril.DataSet.from_dataframe(tables, data.robot, runs=runs)
    for run, same in zip(data, again):
        assert (run.family, run.repeat_of) == (same.family, same.repeat_of)
        for channel in ("time", "torque_target", "torque_actual", "motor_position", "tension", "tip", "bending"):
            a, b = getattr(run, channel), getattr(same, channel)
            assert (a is None) == (b is None) and (a is None or np.array_equal(a, b, equal_nan=True)), channel


def test_a_set_keeps_its_name_with_another_robot(data):
    named = tendril.DataSet.from_dataframe(data.to_pandas(), data.robot, name="../elsewhere")
    other = data.robot.with_effects([PAYLOAD])
    again = as_set(other, named, same_robot=True)
    assert again.name == "../elsewhere" and again.robot.effects == other.effects


def test_logs_give_runs(tmp_path):
    program("demo", "--trajectory", "planar", "--no-plots", "--out", tmp_path)
    runs = tendril.DataSet.from_log(next(tmp_path.rglob("*.lcmlog")))
    assert len(runs) == 1 and runs.runs[0].tension.shape[1] == runs.robot.tendons
    assert "C4" in runs.cuts()


def test_wrong_tables_say_what_is_missing(rig):
    good = pandas.DataFrame({"t_s": [0, 0.01, 0.02], "tension_N_1": [1.0, 1.1, 1.2]})
    with pytest.raises(ValueError, match=r"a\.csv:1: no column t_s"):
        tendril.DataSet.from_dataframe({"a": good.drop(columns="t_s")}, rig)
    with pytest.raises(ValueError, match="no usable column"):
        tendril.DataSet.from_dataframe(good.rename(columns={"tension_N_1": "force"}), rig)
    with pytest.raises(ValueError, match="load_cell 'left' is not known; accepted: motor_side"):
        tendril.DataSet.from_dataframe({"a": good}, rig, runs={"a": {"load_cell": "left"}})
    with pytest.raises(ValueError, match="runs names b; there are only a"):
        tendril.DataSet.from_dataframe({"a": good}, rig, runs={"b": {}})
    with pytest.raises(ValueError, match="runs is .*; give keys of runs.yaml"):
        tendril.DataSet.from_dataframe({"a": good}, rig, runs={"a": 3})
    for name in (1, "a/b", " a", "a\nb", "a\0", "\udcff", 101 * "a", ""):
        with pytest.raises(ValueError, match="a run is called .*; accepted: 1 to 100 printable characters"):
            tendril.DataSet.from_dataframe({name: good}, rig)
    for table in (good.iloc[:0], good.iloc[::-1], good.assign(t_s=np.nan), good.assign(tension_N_1="a"), pandas.DataFrame()):
        with pytest.raises(ValueError, match=r"^run\.csv:[^\n]*$") as error:
            tendril.DataSet.from_dataframe(table, rig)
        assert "tendril-" not in str(error.value)
    with pytest.raises(ValueError, match="give a pandas DataFrame"):
        tendril.DataSet.from_dataframe({"a": [1, 2]}, rig)


def test_times_in_another_unit_are_refused_before_they_fill_the_memory(rig, data):
    table = next(iter(data.to_pandas().values())).iloc[:200]
    with pytest.raises(tendril.Error, match="run: its rows are 1e-12 s apart; accepted: 1e-06 s or more"):
        tendril.diagnose(rig, table.assign(t_s=1e-9 * table["t_s"]), next=False)


def test_wrong_arguments_are_named(rig, data, tmp_path):
    with pytest.raises(ValueError, match="there is no effect 'tip_paylod'; did you mean tip_payload"):
        tendril.simulate(rig, ["tip_paylod mass_kg=0.002"])
    with pytest.raises(ValueError, match="mass_kg"):
        tendril.simulate(rig, ["tip_payload mass_kg=-5"])
    with pytest.raises(ValueError, match="give a list of texts"):
        tendril.simulate(rig, PAYLOAD)
    with pytest.raises(ValueError, match="seed is 1.5; give a whole number from 0"):
        tendril.simulate(rig, seed=1.5)
    with pytest.raises(ValueError, match="no effect is left"):
        tendril.diagnose(rig, data, without=tendril.effects())
    for arguments in ({"noise": "no"}, {"load_cell": 3}, {"set": None}, {"jobs": True}, {"seed": 1.5}):
        with pytest.raises(ValueError, match=next(iter(arguments))):
            tendril.simulate(rig, **arguments)
    for another in (ROBOTS / "rig_90mm.yaml", tendril.load_robot(ROBOTS / "rig_90mm.yaml")):
        with pytest.raises(tendril.Error, match="robot.yaml: these runs are of another robot") as error:
            tendril.diagnose(another, data)
        assert "tendril-" not in str(error.value)
    with pytest.raises(ValueError, match="next is 'no'; give True or False"):
        tendril.diagnose(rig, data, next="no")
    assert data.runs[0] in data and data.runs[0].name in data and "none" not in data
    with pytest.raises(ValueError, match="delta_m is 0; give a number above 0"):
        tendril.diagnose(rig, data, delta_m=0)
    with pytest.raises(tendril.Error, match="no such file or folder"):
        tendril.diagnose(rig, tmp_path / "none")
    with pytest.raises(ValueError, match="give a DataSet, paths, or pandas tables"):
        tendril.diagnose(rig, 7)
    with pytest.raises(tendril.Error, match="actuation"):
        tendril.simulate(ROBOTS / "qi2021_60mm.yaml")


def test_calibration_is_the_command_lines(short_data, tmp_path):
    folder = tmp_path / "set"
    short_data.to_folder(folder)
    found = tendril.calibrate(ROBOT, folder, threads=1)
    program("gap", "calibrate", "--robot", ROBOT, folder, "--out", tmp_path / "better.yaml", "--json", tmp_path / "c.json")
    theirs = json.loads((tmp_path / "c.json").read_text())
    assert [dataclasses.asdict(n) for n in found.numbers] == theirs["numbers"]
    assert [dataclasses.asdict(c) for c in found.channels] == theirs["channels"]
    assert found.correlation.tolist() == theirs["correlation"]
    assert found.converged and "Numbers learned" in str(found)
    mass = next(n for n in found.numbers if n.key == "body.sections.unit_mass_kg")
    assert mass.low <= mass.value <= mass.high and mass.deviation <= mass.prior_deviation
    assert found.robot.to_yaml() != tendril.load_robot(ROBOT).to_yaml()
    with pytest.raises(ValueError, match="seed is -1"):
        tendril.calibrate(ROBOT, folder, seed=-1)


@pytest.mark.parametrize(
    "work",
    [
        "tendril.diagnose({robot!r}, {folder!r})",
        "tendril.calibrate({robot!r}, {folder!r})",
        "tendril.simulate({robot!r})",
    ],
)
def test_ctrl_c_is_heard_within_a_second(work, folder):
    call = work.format(robot=str(ROBOT), folder=str(folder))
    script = (
        "import sys, time, tendril\n"
        "def progress(stage, share):\n"
        "    print(stage, flush=True)\n"
        "try:\n"
        f"    {call[:-1]}, progress=progress)\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', time.time(), flush=True)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    process.stdout.readline()
    time.sleep(0.7)
    sent = time.time()
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=60)
    line = out.splitlines()[-1]
    assert line.startswith("interrupted"), out
    assert float(line.split()[1]) - sent < 1.0


def test_an_exception_in_progress_ends_the_work(folder):
    def progress(stage, share):
        raise ZeroDivisionError(stage)

    with pytest.raises(ZeroDivisionError):
        tendril.diagnose(ROBOT, folder, progress=progress)


def test_the_gil_is_released(diagnosed):
    assert diagnosed.turns > 50


def test_robots_under_the_same_torques(rig):
    pulls = np.zeros((400, rig.tendons))
    pulls[:, 0] = np.linspace(0, 0.002, 400)
    masses = [0.0, 0.002, 0.004]
    seen = []
    variants = [[f"tip_payload mass_kg={m}"] for m in masses]
    found = tendril.simulate_torques(rig, pulls, 0.001, variants, progress=lambda *stage: seen.append(stage))
    assert found.tip.shape == (3, 400, 3) and found.tension_base.shape == (3, 400, rig.tendons)
    assert found.bending.shape == (3, 400, 2) and found.failed == ["", "", ""]
    assert found.time[-1] == pytest.approx(0.4) and seen and seen[-1][0] == "simulating"
    assert 0.002 < found.tip[0, -1, 0] < found.tip[2, -1, 0]  # upright: a heavier tip falls further
    alone = tendril.simulate_torques(rig, pulls, 0.001, [variants[1]], jobs=1)
    for of_all, of_one in zip(found[1:6], alone[1:6], strict=True):
        np.testing.assert_array_equal(of_all[1], of_one[0])
    nominal = tendril.simulate_torques(rig, pulls, 0.001)
    np.testing.assert_array_equal(nominal.tip[0], found.tip[0])
    exact = tendril.simulate_torques(rig, pulls, 0.001, tolerance=1e-11)
    off = [
        np.abs(tendril.simulate_torques(rig, pulls, 0.001, tolerance=tolerance).tip - exact.tip).max()
        for tolerance in (1e-3, 1e-7, 1e-9)
    ]
    assert off[0] > 10 * off[1] and off[1] > 10 * off[2], off


def test_wrong_torques_are_named(rig):
    pulls = np.zeros((3, rig.tendons))
    for arguments, words in [
        ((np.zeros((3, 9)), 0.001), "torque has shape (3, 9)"),
        ((pulls, 0.0), "step is 0 s"),
        ((pulls, 0.001, []), "variants is empty"),
        ((pulls, 0.001, [[]], 0.1), "tolerance is 0.1"),
        ((pulls, 0.001, "tip_payload"), "list of lists"),
        ((pulls, 0.001, [["tip_payloat mass_kg=1"]]), "did you mean tip_payload"),
        ((np.full_like(pulls, np.inf), 0.001), "finite"),
    ]:
        with pytest.raises(ValueError, match=re.escape(words)):
            tendril.simulate_torques(rig, *arguments[:3], **dict(zip(["tolerance"], arguments[3:], strict=False)))
    with pytest.raises(ValueError, match="mass_kg"):
        tendril.simulate_torques(rig, pulls, 0.001, [["tip_payload mass_kg=-1"]])
