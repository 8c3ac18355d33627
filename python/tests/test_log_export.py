"""What `tendril log export` writes, read back with the packages that others use."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("lcm", reason="the extra 'export' is not installed")
mcap_reader = pytest.importorskip("mcap.reader", reason="the extra 'export' is not installed")
parquet = pytest.importorskip("pyarrow.parquet", reason="the extra 'export' is not installed")
from foxglove_schemas_protobuf.Log_pb2 import Log
from pyarrow import csv

from conftest import ROBOTS
from log_help import Reader, every_kind, fields, plain, random_message
from view_help import START, state_message, write_log

import tendril
from tendril import messages
from tendril.export import __main__ as program
from tendril.logs import protobuf
from tendril.logs.columns import grouped
from tendril.messages.fields import FIELDS


def export(*words):
    assert program.main([*map(str, words)]) == 0


def contents(path):
    """By topic: log time, which is the publish time, schema name and message."""
    reader, found = Reader(), {}
    with path.open("rb") as file:
        for schema, channel, message in mcap_reader.make_reader(file, validate_crcs=True).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
            read = reader.read(schema.name, schema.data, message.data)
            assert message.publish_time == message.log_time
            found.setdefault(channel.topic, []).append((message.log_time, schema.name, read))
    return found


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    given = every_kind()
    return write_log(tmp_path_factory.mktemp("log") / "all.lcmlog", given), given


@pytest.fixture(scope="module")
def exported(log, tmp_path_factory):
    folder = tmp_path_factory.mktemp("out")
    export(log[0], "--mcap", folder / "all.mcap", "--csv", folder / "csv", "--parquet", folder / "parquet")
    return folder


def test_mcap_holds_every_message_of_every_type_at_its_time(log, exported):
    found = contents(exported / "all.mcap")
    for kind in set(FIELDS) - {"snapshot_t"}:
        ending = kind.removesuffix("_t")
        given = [message for name, message in log[1] if name == ending.upper()]
        read = found[f"/TENDRIL/{ending}"]
        assert len(read) == len(given) > 0
        for (log_ns, schema, message), original in zip(read, given):
            original = type(original).decode(original.encode())
            assert (log_ns, schema) == (1000 * original.utime, f"tendril.{kind}")
            assert {name: plain(getattr(message, name)) for name in original.__slots__} == fields(original)


def test_tables_hold_every_number(log, exported):
    for kind in set(FIELDS) - {"snapshot_t"}:
        name = kind.removesuffix("_t").upper()
        given = [type(m).decode(m.encode()) for ending, m in log[1] if ending == name]
        table = parquet.read_table(exported / "parquet" / f"TENDRIL_{name}.parquet")
        text = csv.read_csv(exported / "csv" / f"TENDRIL_{name}.csv")
        assert table.column("time").cast("int64").to_pylist() == [1000 * m.utime for m in given]
        assert text.column("time").cast("timestamp[ns]").cast("int64").to_pylist() == [
            1000 * m.utime for m in given
        ]
        for field, _, count in FIELDS[kind]:
            expected = [getattr(message, field) for message in given]
            if field in table.column_names:
                assert plain(table.column(field).to_pylist()) == plain(expected), field
            else:
                read = [table.column(f"{field}_{i + 1}").to_pylist() for i in range(len(expected[0]))]
                assert plain(list(zip(*read))) == plain(expected), field
                of_csv = [text.column(f"{field}_{i + 1}").to_pylist() for i in range(len(expected[0]))]
                np.testing.assert_array_equal(
                    np.array(of_csv, dtype=float).T, np.array(expected, dtype=float)
                )


def test_frames_and_body_are_those_of_the_model(exported, rig):
    found = contents(exported / "all.mcap")
    model = tendril.Model(rig)
    states = {log_ns: message for log_ns, *_, message in found["/TENDRIL/state"]}
    assert len(found["/TENDRIL/frames"]) == len(found["/TENDRIL/scene"]) > 10
    for (log_ns, _, frames), (scene_ns, schema, scene) in zip(
        found["/TENDRIL/frames"], found["/TENDRIL/scene"]
    ):
        assert (scene_ns, schema) == (log_ns, "foxglove.SceneUpdate")
        q = np.tile(np.array(states[log_ns].bending_estimate_rad) / rig.units, rig.units)
        disks = model.disks(q)[1:]
        drawn = [t for t in frames.transforms if "disk" in t.child_frame_id]
        assert {t.parent_frame_id for t in frames.transforms} == {"TENDRIL/F_0"} and len(drawn) == rig.units
        for transform, pose in zip(drawn, disks):
            place, turn = transform.translation, transform.rotation
            np.testing.assert_allclose([place.x, place.y, place.z], pose[:3, 3], atol=1e-12)
            # The third column of the rotation, by the quaternion.
            w, x, y, z = turn.w, turn.x, turn.y, turn.z
            normal = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
            np.testing.assert_allclose(normal, pose[:3, 2], atol=1e-9)
        (robot,) = scene.entities
        assert len(robot.lines) == 1 + rig.tendons and len(robot.cylinders) == 1 + rig.units
        end = robot.lines[0].points[-1]
        np.testing.assert_allclose([end.x, end.y, end.z], disks[-1][:3, 3], atol=1e-9)


def test_a_robot_whose_bend_is_not_known_is_taken_away(tmp_path):
    bends = [(0.1, 0.0), (float("nan"), 0.0), (float("nan"), 0.0), (0.2, 0.0)]
    given = [("STATE", state_message(0.1 * i, bending=bend)) for i, bend in enumerate(bends)]
    write_log(tmp_path / "a.lcmlog", given)
    export(tmp_path / "a.lcmlog", "--mcap", tmp_path / "a.mcap", "--robot", ROBOTS / "rig_60mm.yaml")
    scenes = [message for *_, message in contents(tmp_path / "a.mcap")["/TENDRIL/scene"]]
    assert [(len(s.entities), len(s.deletions)) for s in scenes] == [(1, 0), (0, 1), (1, 0)]


def test_log_lines_are_events_and_changes(tmp_path):
    event = messages.event_t()
    event.utime, event.status, event.status_text = START + 5, 412, "a drive reports an error"
    event.source, event.text = "bus", "node 3"
    states = [state_message(0.1 * i, mode="running") for i in range(18)]
    for state in (*states[2:4], states[5]):  # back within a second, so it had not ended
        state.status, state.status_text, state.status_remedy = 105, "tension is limited", "see max_tension"
    states[17].mode, states[17].mode_text = 5, "hold"
    write_log(tmp_path / "a.lcmlog", [("EVENT", event), *(("STATE", state) for state in states)])
    export(tmp_path / "a.lcmlog", "--mcap", tmp_path / "a.mcap")
    found = contents(tmp_path / "a.mcap")["/TENDRIL/log"]
    assert [
        (ns // 1000 - START, message.level, message.name, message.message) for ns, *_, message in found
    ] == [
        (0, Log.INFO, "state", "mode: running"),
        (5, Log.ERROR, "bus", "412 a drive reports an error: node 3"),
        (200_000, Log.WARNING, "state", "105 tension is limited; see max_tension"),
        (1_600_000, Log.INFO, "state", "no longer 105: ok"),
        (1_700_000, Log.INFO, "state", "mode: hold"),
    ]
    assert all(m.timestamp.seconds * 10**9 + m.timestamp.nanos == ns for ns, *_, m in found)


def test_layouts_name_what_is_in_the_file(exported):
    found = contents(exported / "all.mcap")
    layout = json.loads((exported / "all.foxglove.json").read_text())
    panels = layout["configById"]
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", [])]
    assert len(paths) > 10 and panels["RosOut!lines"]["topicToRender"] in found
    assert set(panels["3D!robot"]["topics"]) <= set(found)
    curves = [c.get("name") for c in ElementTree.parse(exported / "all.plotjuggler.xml").iter("curve")]
    assert len(curves) > 10
    for path in [*paths, *(".".join(curve.rsplit("/", 1)) for curve in curves)]:
        topic, field = path.rsplit(".", 1)
        name, _, index = field.partition("[")
        value = getattr(found[topic][0][-1], name)
        assert not index or int(index[:-1]) < len(value), path

    def leaves(tree):
        return [tree] if isinstance(tree, str) else leaves(tree["first"]) + leaves(tree["second"])

    assert sorted(leaves(layout["layout"])) == sorted(panels)


def test_damage_and_foreign_messages_are_left_out_and_named(tmp_path, capsys):
    given = [("STATE", state_message(0.01 * i)) for i in range(100)]
    given[30:30] = [
        ("CAMERA", b"not of this program"),
        ("SNAPSHOT", random_message("snapshot_t", 0, random.Random(2))),
    ]
    path = write_log(tmp_path / "a.lcmlog", given)
    data = bytearray(path.read_bytes())
    data[20_000:20_100] = bytes(100)
    path.write_bytes(data)
    export(path, "--mcap", tmp_path / "a.mcap")
    remarks = capsys.readouterr().err
    assert "TENDRIL_CAMERA: 1 messages left out, of another program" in remarks
    assert "TENDRIL_SNAPSHOT: 1 messages left out" in remarks and "damaged: the event at byte" in remarks
    assert 95 <= len(contents(tmp_path / "a.mcap")["/TENDRIL/state"]) < 100


def test_a_log_of_two_robots_keeps_them_apart(tmp_path):
    a = write_log(tmp_path / "a.lcmlog", every_kind(5), prefix="LEFT")
    b = write_log(tmp_path / "b.lcmlog", every_kind(5, seed=2), prefix="RIGHT_ARM")
    (tmp_path / "both.lcmlog").write_bytes(a.read_bytes() + b.read_bytes())
    export(tmp_path / "both.lcmlog", "--mcap", tmp_path / "both.mcap")
    found = contents(tmp_path / "both.mcap")
    for prefix in ("LEFT", "RIGHT_ARM"):
        assert len(found[f"/{prefix}/state"]) == 5 and f"/{prefix}/scene" in found


def test_a_robot_that_takes_over_has_a_table_of_its_own(tmp_path):
    first, second = state_message(0), state_message(1)
    second.num_tendons += 1
    for field, _, count in FIELDS["state_t"]:
        if count == "num_tendons":
            setattr(second, field, (*getattr(second, field), 0.0))
    log = write_log(tmp_path / "a.lcmlog", [("STATE", first), ("STATE", second)])
    export(log, "--parquet", tmp_path / "tables")
    first, second = (
        parquet.read_table(tmp_path / "tables" / f"TENDRIL_STATE{n}.parquet") for n in ("", "_2")
    )
    assert (len(first), len(second)) == (1, 1) and len(second.column_names) > len(first.column_names)


def test_whatever_passes_for_a_message_can_be_read():
    """A log's damage may leave bytes that decode, texts that are none among them."""
    rng, reader, passed = random.Random(3), Reader(), 0
    for kind in sorted(set(FIELDS) - {"snapshot_t"}):
        for _ in range(40):
            data = bytearray(random_message(kind, 0.0, rng).encode())
            for _ in range(rng.randrange(4)):
                data[rng.randrange(8, len(data))] = rng.randrange(256)
            if tendril._core.message_type(bytes(data)) == "":
                continue
            for group in grouped(kind, [bytes(data)]):
                (encoded,) = protobuf.encoded(group)
                reader.read(protobuf.schema_name(kind), protobuf.schema(kind), encoded)
                passed += 1
    assert passed > 200


@pytest.mark.parametrize("option, name", [("--mcap", "out.mcap"), ("--csv", "out"), ("--parquet", "out")])
def test_nothing_is_lost_and_nothing_half_is_left(log, tmp_path, capsys, option, name):
    out = tmp_path / name
    if option == "--mcap":
        out.write_text("precious")
    else:
        out.mkdir()
        (out / "TENDRIL_STATE.csv").write_text("precious")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert program.main([str(log[0]), option, str(out)]) == 1
    assert "--overwrite" in capsys.readouterr().err
    empty = tmp_path / "empty.lcmlog"
    empty.write_bytes(b"")
    assert program.main([str(empty), option, str(out), "--overwrite"]) == 1
    assert "no message" in capsys.readouterr().err
    empty.unlink()
    half = (
        out.with_name(out.name + ".part") if option == "--mcap" else out / f"TENDRIL_STATE.{option[2:]}.part"
    )
    half.write_text("of a black box")
    assert program.main([str(log[0]), option, str(out), "--overwrite"]) == 1
    assert "would be lost" in capsys.readouterr().err and half.read_text() == "of a black box"
    half.unlink()
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    export(log[0], option, out, "--overwrite")
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.parametrize(
    "words, status, line",
    [
        ([], 2, "no destination"),
        (["--mcap", "{tmp}"], 1, "is a folder"),
        (["--mcap", "{tmp}/none/a.mcap"], 1, "cannot be written"),
        (["--csv", "{log}/a"], 1, "no folder can be made"),
        (["--mcap", "{tmp}/a.mcap", "--robot", "nowhere.yaml"], 1, "nowhere.yaml"),
    ],
)
def test_bad_words_are_one_line(log, tmp_path, capsys, words, status, line):
    given = [word.format(tmp=tmp_path, log=log[0]) for word in words]
    try:
        done = program.main([str(log[0]), *given])
    except SystemExit as e:
        done = e.code
    printed = capsys.readouterr()
    assert (done, printed.out) == (status, "") and not list(tmp_path.iterdir())
    assert printed.err.count("\n") == 1 and printed.err.startswith("tendril: log: ") and line in printed.err


@pytest.mark.parametrize("path", ["nowhere.lcmlog", "."])
def test_a_log_that_is_none_is_one_line(tmp_path, capsys, path):
    assert program.main([path, "--mcap", str(tmp_path / "a.mcap")]) == 1
    assert capsys.readouterr().err.count("\n") == 1 and not list(tmp_path.iterdir())


def long_log(log, folder):
    path = folder / "long.lcmlog"
    path.write_bytes(log[0].read_bytes() * 30)
    return path


TARGETS = [("--mcap", "a.mcap", "a.mcap.part"), ("--csv", "tables", "tables")]


@pytest.mark.parametrize("option, name, part", TARGETS)
def test_a_full_disk_leaves_nothing(log, tmp_path, option, name, part):
    words = [sys.executable, "-P", "-m", "tendril.export", long_log(log, tmp_path), option, tmp_path / name]
    limited = ["prlimit", "--fsize=5000", *map(str, words)]
    done = subprocess.run(limited, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 1 and done.stderr.count("\n") == 1 and "nothing is written" in done.stderr, (
        done.stderr
    )
    assert [path.name for path in tmp_path.iterdir()] == ["long.lcmlog"]


@pytest.mark.parametrize("option, name, part", TARGETS)
def test_an_interrupt_leaves_nothing(log, tmp_path, option, name, part):
    words = [sys.executable, "-P", "-m", "tendril.export", long_log(log, tmp_path), option, tmp_path / name]
    for _ in range(10):
        running = subprocess.Popen([*map(str, words)], stderr=subprocess.PIPE, text=True)
        begun, end = tmp_path / part, time.monotonic() + 300
        while not begun.exists() and running.poll() is None and time.monotonic() < end:
            time.sleep(0.005)
        running.send_signal(signal.SIGTERM)
        _, said = running.communicate(timeout=300)
        if running.returncode != 0:
            break
        for path in tmp_path.iterdir():  # on a busy machine it was through before the signal came
            if path.name != "long.lcmlog":
                shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert running.returncode == 128 + signal.SIGTERM and "nothing is written" in said
    assert [path.name for path in tmp_path.iterdir()] == ["long.lcmlog"]


@pytest.mark.skipif(not shutil.which("tendril"), reason="the program is not on the path")
def test_tendril_hands_over():
    def handed_over(python, *words):
        command = ["tendril", "log", *words]
        environment = {**os.environ, "TENDRIL_PYTHON": python}
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=60, env=environment, check=False
        )
        assert done.stdout == "" and done.stderr.count("\n") == 1, done.stderr
        return done.returncode, done.stderr

    assert handed_over(sys.executable, "export", "nowhere", "--mcap", "a.mcap")[1].startswith(
        "tendril: log: cannot read log nowhere: "
    )
    assert handed_over(sys.executable, "export", "nowhere")[0] == 2
    for command in (["export", "nowhere", "--csv", "a"], ["serve"]):
        status, line = handed_over("/usr/bin/false", *command)
        assert status == 1 and f"pip install './python[{command[0]}]'" in line
