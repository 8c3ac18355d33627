"""The database of watched robots: whole after a kill and on a full disk."""

import dataclasses
import json
import os
import random
import sqlite3
import subprocess
import sys

import pytest
from tendril.watch.store import Entry, Key, Number, Store, StoreError

NUMBERS = 150
FILL = """
import resource, sys
sys.path.insert(0, {tests!r})
from test_watch_store import day
from tendril.watch.store import Store, StoreError
if {limit}:
    resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
with Store({path!r}) as store:
    accepted = store.accepted("robot")[0]
    n = len(store.days(accepted))
    while True:
        try:
            n += 1
            print(store.add(day(n, accepted.id)).id, flush=True)
        except StoreError as error:
            print(error, file=sys.stderr)
            raise SystemExit(1)
"""


def day(n, accepted=None):
    numbers = {Key("cell_offset", f"tendon:{j}", "N"): Number("N", n + j, 1.0, 2.0) for j in range(NUMBERS)}
    return Entry("robot", 1e6 + n, numbers, {"circle": f"{n:064x}"}, accepted=accepted, note=f"day {n}")


@pytest.fixture()
def database(tmp_path):
    path = str(tmp_path / "watch.db")
    with Store(path, "rwc") as store:
        store.add(day(0))
    return path


def fill(path, limit=0):
    text = FILL.format(tests=os.path.dirname(__file__), path=path, limit=limit)
    return subprocess.Popen(
        [sys.executable, "-c", text], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def kept(path):
    """Numbers of the days that are there, each of them whole."""
    with Store(path, "ro") as store:
        days = store.days(store.accepted("robot")[0])
    for one in days:
        assert one.numbers == day(int(one.note.split()[1])).numbers
    with sqlite3.connect(path) as raw:
        assert raw.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert raw.execute(
            "SELECT count(*) FROM numbers WHERE entry NOT IN (SELECT id FROM entries)"
        ).fetchone() == (0,)
    return [one.id for one in days]


def test_an_entry_comes_back_as_it_was(database):
    with Store(database) as store:
        accepted = store.accepted("robot")[0]
        given = day(1, accepted.id)
        added = store.add(given)
        assert store.days(accepted) == [added]
        assert {**vars(added), "id": 0} == vars(given)


def test_only_an_entry_that_older_programs_cannot_read_is_kept_from_them(database):
    """These hand all that is in `about` to their Entry, which has no `diagnosed`."""

    def format_and_abouts():
        with sqlite3.connect(database) as raw:
            return raw.execute("PRAGMA user_version").fetchone()[0], [
                json.loads(row[0]) for row in raw.execute("SELECT about FROM entries ORDER BY id")
            ]

    with Store(database) as store:
        first = store.accepted("robot")[0]
        store.conclude(store.add(day(1, first.id)))
    form, abouts = format_and_abouts()
    assert form == 1 and not any("diagnosed" in about for about in abouts)
    with Store(database) as store:
        learned = store.add(dataclasses.replace(day(2), diagnosed=True))
    form, abouts = format_and_abouts()
    assert form == 2 and abouts[-1]["diagnosed"]
    with Store(database, "ro") as store:
        assert [state.diagnosed for state in store.accepted("robot")] == [False, True]
        assert store.accepted("robot")[-1] == learned


def test_a_kill_at_any_moment_loses_nothing_that_was_kept(database):
    rng, said = random.Random(1), []
    for _ in range(6):
        process = fill(database)
        assert process.stdout is not None
        said += [int(process.stdout.readline()) for _ in range(3)]  # it is at work
        try:
            process.communicate(timeout=rng.uniform(0, 0.06))
        except subprocess.TimeoutExpired:
            process.kill()
        rest, _ = process.communicate()
        said += [int(line) for line in rest.split("\n")[:-1]]
        assert process.returncode == -9
        assert set(said) <= set(kept(database))
    assert len(said) > 12


def test_a_full_disk_is_one_line_and_loses_nothing(database):
    before = kept(database)
    process = fill(database, limit=os.path.getsize(database) + 200_000)
    out, err = process.communicate(timeout=60)
    said = [int(line) for line in out.split()]
    assert process.returncode == 1 and err.count("\n") == 1, err
    assert "make room on its disk" in err and "nothing of this entry was kept" in err
    assert said and kept(database) == before + said
    with Store(database) as store:
        assert store.add(day(10**6, store.accepted("robot")[0].id)).id > said[-1]


def test_the_same_runs_are_entered_once(database):
    with Store(database) as store:
        accepted = store.accepted("robot")[0]
        store.add(day(1, accepted.id))
        with pytest.raises(StoreError):
            store.add(day(1, accepted.id))
        assert len(store.days(accepted)) == 1


def test_a_database_whose_maker_was_killed_is_made_again(tmp_path):
    path = tmp_path / "watch.db"
    path.touch()
    with Store(str(path), "rwc") as store:
        assert store.robots() == []


@pytest.mark.parametrize("what", ["nothing", "folder", "text", "other", "later"])
def test_what_is_no_such_database_is_one_line_and_stays(tmp_path, what):
    path = tmp_path / "watch.db"
    if what == "folder":
        path.mkdir()
    elif what == "text":
        path.write_text("time,tension\n" * 100)
    elif what == "other":
        with sqlite3.connect(path) as other:
            other.execute("CREATE TABLE mine (x)")
    elif what == "later":
        with Store(str(path), "rwc"), sqlite3.connect(path) as later:
            later.execute("PRAGMA user_version=99")
    was = path.read_bytes() if path.is_file() else None
    with pytest.raises(StoreError) as error:
        Store(str(path), "rw" if what == "nothing" else "rwc")
    assert "\n" not in str(error.value) and str(path) in str(error.value)
    assert path.is_dir() if what == "folder" else path.exists() == (what != "nothing")
    if what in ("text", "other"):
        assert path.read_bytes() == was
