"""The command lines of `tendril gap accept`, `gap watch` and `gap history`, as `python -m tendril.watch COMMAND`."""

from __future__ import annotations

import argparse
import os
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import replace

from .. import load_robot
from .._command_line import Parser, add_lcm_options, number
from .._progress import Line
from ..data_set import DataSet
from ..errors import Error
from ..report import Report
from . import alarm, day, page, postures, text
from .change import Change, changes
from .store import Entry, Store, StoreError

FALSE_ALARMS_PER_YEAR = 0.5
CHANGED = 3  # exit status
# What --each finds may be a recording that goes on: its rows reach the disk within this time.
STILL_WRITTEN_S = 60.0
DB = "database of watched robots (SQLite)"


def add_entry_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--db", metavar="FILE", required=True, help=DB)
    parser.add_argument("--robot", metavar="FILE", required=True, help="robot file")
    parser.add_argument(
        "--at", metavar="DATE", type=moment, help="when the runs were recorded, YYYY-MM-DD[THH:MM] (UTC)"
    )
    parser.add_argument(
        "--same-robot", action="store_true", help="the runs are of --robot although their own file differs"
    )
    parser.add_argument(
        "data", metavar="DATA", nargs="+", help="data-set folders, CSV files or LCM logs of one entry"
    )


def moment(given: str) -> float:
    """The type of --at."""
    import datetime

    try:
        time = datetime.datetime.fromisoformat(given)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"'{given}' is no date; give YYYY-MM-DD or YYYY-MM-DDTHH:MM"
        ) from None
    return (time if time.tzinfo else time.replace(tzinfo=datetime.timezone.utc)).timestamp()


def make_parser(command: str) -> argparse.ArgumentParser:
    parser = Parser(prog=f"tendril gap {command}")
    if command == "history":
        parser.add_argument("--db", metavar="FILE", required=True, help=DB)
        parser.add_argument(
            "--robot", metavar="NAME", help="its name; may be left out where there is one only"
        )
        form = parser.add_mutually_exclusive_group()
        form.add_argument("--json", action="store_true", help="all entries with all numbers, as JSON")
        form.add_argument("--csv", action="store_true", help="the same, a row a number and entry")
        parser.add_argument("--page", metavar="FILE", help="the courses as a page")
        return parser
    add_entry_options(parser)
    if command == "accept":
        parser.add_argument("--note", default="", help="why")
        positive = number(1e-12, 1e6)
        parser.add_argument(
            "--delta-N", dest="delta_N", type=positive, help="tension difference that does not matter [N]"
        )
        parser.add_argument(
            "--delta-mm", dest="delta_mm", type=positive, help="tip distance that does not matter [mm]"
        )
        return parser
    parser.add_argument(
        "--each", action="store_true", help="DATA are folders of entries: what is in them and not entered yet"
    )
    parser.add_argument("--page", metavar="FILE", help="the courses as a page, written anew each time")
    parser.add_argument(
        "--out",
        metavar="DIR",
        default="out/watch",
        help="folder for the diagnosis of an alarm, of a position-controlled robot also of an unsure day "
        "(%(default)s)",
    )
    parser.add_argument("--json", action="store_true", help="a line of JSON an entry instead of the text")
    parser.add_argument(
        "--no-cause",
        action="store_true",
        help="no diagnosis of an alarm; of a position-controlled robot, whose days are diagnosed in any case, "
        "no report",
    )
    parser.add_argument(
        "--false-alarms",
        type=number(1e-6, 100, "a year"),
        default=FALSE_ALARMS_PER_YEAR,
        help="false alarms in 365 entries, at most (%(default)s)",
    )
    parser.add_argument("--event", action="store_true", help="publish an alarm as an event over LCM")
    add_lcm_options(parser)
    return parser


def accept(o: argparse.Namespace) -> int:
    require_writable(o.db)
    with Line() as line:
        runs = day.read_runs(o.data, o.robot, o.same_robot)
        entry = replace(
            day.unmeasured(runs, o.data, day.recorded_at(o.data) if o.at is None else o.at),
            note=o.note,
            robot_yaml=runs.robot.to_yaml(),
            delta_N=o.delta_N,
            delta_m=None if o.delta_mm is None else 1e-3 * o.delta_mm,
        )
        if postures.states(runs) is not None:
            entry = postures.learned(entry, runs, line)
        else:
            entry = day.measured(entry, runs, None, line)
    with Store(o.db, "rwc") as store:
        entry = store.add(entry)
    print(
        f"robot '{entry.robot}' accepted as of {text.moment(entry.at)} UTC: "
        f"{len(entry.numbers)} numbers of {len(runs)} runs"
    )
    for note in entry.notes:
        print(f"  {note}")
    return 0


def require_writable(db: str) -> None:
    """Found before the work; where it is missing it is made with its first entry."""
    if os.path.exists(db):
        with Store(db, "rwc") as store:
            store.require_writable()
    elif not os.access(os.path.dirname(os.path.abspath(db)), os.W_OK):
        raise StoreError(
            f"{db}: its folder is not there or may not be written by this user; give another --db"
        )


def watch(o: argparse.Namespace) -> int:
    if o.page:
        page.require_page(o.page)
    if o.each and o.at is not None:
        raise ValueError("--at is the date of one entry, --each has several; give one of them")
    with Store(o.db, "rw") as store:
        store.require_writable()
        accepted = accepted_state(store, o.robot)
        return watch_each(store, o, accepted) if o.each else watch_one(store, o, accepted, o.data)


def watch_each(store: Store, o: argparse.Namespace, accepted: Entry) -> int:
    """What lies in the folders and is no entry yet, in order of time. One that cannot be read does not stop others."""
    days = store.days(accepted)
    known = {source for entry in [accepted, *days] for source in entry.sources}
    earlier = {
        source
        for state in store.accepted(accepted.robot)
        for entry in [state, *store.days(state)]
        for source in entry.sources
    }

    def is_new(path: str) -> bool:
        at = day.recorded_at([path])
        # Of the accepted state's own day, what an earlier state has seen was before it.
        return path not in known and (at > accepted.at or (at == accepted.at and path not in earlier))

    new = []
    for path in filter(is_new, day.in_folders(o.data)):
        age_s = time.time() - day.written_at(path)
        if 0 <= age_s < STILL_WRITTEN_S:
            alarm.warn(
                "watch", f"{path}: written {age_s:.0f} s ago, perhaps not complete: left for the next time"
            )
        else:
            new.append(path)
    if not new and days and days[-1].finding.get("alarm"):
        when = text.date(days[-1].at)
        alarm.say(f"ALARM: robot '{accepted.robot}': nothing new since the alarm of {when}", True)
        return CHANGED
    status = 0
    for path in new:
        try:
            status = max(status, watch_one(store, o, accepted, [path]))
        except (StoreError, BrokenPipeError):
            raise
        except (Error, ValueError, OSError) as error:
            alarm.warn("watch", f"left out: {error}")
            status = max(status, 1)
    if not new:
        alarm.say(f"robot '{accepted.robot}': nothing new", False)
    return status


def watch_one(store: Store, o: argparse.Namespace, accepted: Entry, paths: list[str]) -> int:
    """One entry: measured unless it is there, judged beside the days before it, kept, reported."""
    runs = day.read_runs(paths, o.robot, o.same_robot)
    entry = day.unmeasured(runs, paths, day.recorded_at(paths) if o.at is None else o.at)
    days = store.days(accepted)
    known = next((other for other in days if other.digest == entry.digest), None)
    if known is not None:
        days = [other for other in days if (other.at, other.id) <= (known.at, known.id)]
        return report_entry(
            o, accepted, days, changed(accepted, days, known.finding["false_alarms_per_year"])
        )
    if entry.at < accepted.at:
        raise Error(
            f"{paths[0]}: recorded {text.moment(entry.at)}, before the accepted state ({text.moment(accepted.at)}); "
            "give runs from after it, or their date with --at"
        )
    if entry.digest == accepted.digest:
        raise Error(f"{paths[0]}: these are the accepted runs; give those of a later day")
    days = [other for other in days if other.at <= entry.at]
    entry = replace(entry, accepted=accepted.id)
    enter = diagnosed if accepted.diagnosed else followed
    with Line() as line:
        entry, report = enter(store, o, runs, accepted, days, entry, line)
    days = [*days, entry]
    status = report_entry(o, accepted, days, changed(accepted, days, o.false_alarms))
    if report is not None:
        save(report, os.path.join(o.out, f"{text.date(entry.at)}-{entry.digest[:12]}"))
    return status


def followed(
    store: Store, o: argparse.Namespace, runs: DataSet, accepted: Entry, days: list[Entry], entry: Entry, line: Line
) -> tuple[Entry, Report | None]:
    """The entry as kept, number by number, and the diagnosis of an alarm."""
    entry = day.measured(entry, runs, accepted, line)
    found = changes(accepted, [*days, entry], o.false_alarms)
    # Kept before it is diagnosed: whatever happens there, the alarm is not lost.
    entry = store.add(replace(entry, finding=day.finding(found, o.false_alarms)))
    if o.no_cause or not entry.finding["alarm"]:
        return entry, None
    report = cause_of(runs, accepted, entry, line)
    if report is not None:
        store.conclude(entry)
    return entry, report


def diagnosed(
    store: Store, o: argparse.Namespace, runs: DataSet, accepted: Entry, days: list[Entry], entry: Entry, line: Line
) -> tuple[Entry, Report | None]:
    """The same of a position-controlled robot, whose days are diagnosed in any case."""
    entry, report = postures.diagnosed(entry, runs, accepted, o.false_alarms, line)
    entry.finding["changes"] = [change.as_json() for change in postures.changes([*days, entry])]
    return store.add(entry), report if entry.finding["cause"] and not o.no_cause else None


def changed(accepted: Entry, days: list[Entry], false_alarms_per_year: float) -> list[Change]:
    """What the last of these days shows."""
    return postures.changes(days) if accepted.diagnosed else changes(accepted, days, false_alarms_per_year)


def cause_of(runs: DataSet, accepted: Entry, entry: Entry, line: Line) -> Report | None:
    """Adds it to the finding. An alarm without a diagnosis is an alarm all the same."""
    try:
        report, remark = day.name_cause(runs, accepted, line)
    except Error as error:
        alarm.warn("watch", f"no diagnosis of the alarm: {error}")
        return None
    entry.finding["cause"] = day.cause_json(report, remark)
    return report


def accepted_state(store: Store, file: str) -> Entry:
    """The newest of the robot of this file, which has to be the accepted one."""
    robot = load_robot(file)
    states = store.accepted(robot.name)
    if not states:
        raise Error(
            f"robot '{robot.name}' has no accepted state; give it one: tendril gap accept --robot {file} DATA"
        )
    if states[-1].robot_yaml != robot.to_yaml():
        raise Error(
            f"{file}: differs from the accepted robot file of '{robot.name}'; give the accepted file, "
            "or accept the robot with this one: tendril gap accept"
        )
    return states[-1]


def report_entry(o: argparse.Namespace, accepted: Entry, days: list[Entry], found: list[Change]) -> int:
    """Of the last of `days`: on the terminal or in the journal, as a page, over LCM. What fails here does not undo the
    entry, nor hide an alarm."""
    entry = days[-1]
    alarmed = bool(entry.finding.get("alarm"))
    failed = 0
    for work in reports(o, accepted, days, found, alarmed):
        try:
            work()
        except Error as error:
            alarm.warn("watch", str(error))
            failed = 1
    # Last, for its reader may be gone.
    alarm.say(text.day_json(entry, found) if o.json else text.day_text(entry, accepted, found), alarmed)
    return CHANGED if alarmed else failed


def reports(
    o: argparse.Namespace, accepted: Entry, days: list[Entry], found: list[Change], alarmed: bool
) -> list[Callable[[], None]]:
    works: list[Callable[[], None]] = []
    if o.event and alarmed:
        works.append(lambda: alarm.publish(text.sentence(days[-1], found), o.lcm, o.prefix))
    if o.page:
        works.append(lambda: page.write(o.page, page.page(accepted, days, found)))
    return works


def save(report: Report, folder: str) -> None:
    try:
        report.save(folder)
    except Error as error:
        alarm.warn("watch", f"{error}; the entry is kept without its report")
        return
    print(f"  report: {folder}/report.html", file=sys.stderr)


def history(o: argparse.Namespace) -> int:
    if o.page:
        page.require_page(o.page)
    with Store(o.db, "ro") as store:
        robot = only_robot(store, o.robot, o.db)
        states = [(accepted, store.days(accepted)) for accepted in store.accepted(robot)]
    if o.json or o.csv:
        print(text.history_json(states) if o.json else text.history_csv(states), end="\n" if o.json else "")
    for accepted, days in states:
        rate = days[-1].finding["false_alarms_per_year"] if days else FALSE_ALARMS_PER_YEAR
        found = changed(accepted, days, rate)
        if not (o.json or o.csv):
            print(text.history_text(accepted, days, found))
    if o.page:
        page.write(o.page, page.page(accepted, days, found))
    return 0


def only_robot(store: Store, given: str | None, db: str) -> str:
    robots = store.robots()
    if given is not None and given not in robots:
        raise StoreError(f"{db}: no robot '{given}'; there are {', '.join(robots) or 'none'}")
    if given is None and len(robots) != 1:
        raise StoreError(
            f"{db}: {len(robots)} robots; name one with --robot: {', '.join(robots) or 'none is there'}"
        )
    return given or robots[0]


COMMANDS = {"accept": accept, "watch": watch, "history": history}


def main(arguments: list[str] | None = None) -> int:
    words = sys.argv[1:] if arguments is None else arguments
    if not words or words[0] not in COMMANDS:
        print(f"tendril: gap: give {', '.join(COMMANDS)}", file=sys.stderr)
        return 2
    options = make_parser(words[0]).parse_args(words[1:])
    warnings.showwarning = lambda message, *_: alarm.warn(words[0], f"warning: {message}")
    try:
        status = COMMANDS[words[0]](options)
        sys.stdout.flush()
        return status
    except (Error, ValueError) as error:
        alarm.warn(words[0], str(error))
    except KeyboardInterrupt:
        return 130
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what is still to be written has no place
        if not isinstance(error, BrokenPipeError):
            alarm.warn(words[0], f"{error.filename or 'the standard output'}: {error.strerror}")
    return 1


if __name__ == "__main__":
    sys.exit(main())
