# What a sealed test rests on: files written once, one process at a set, a command that cannot read the answers.
# Knows nothing of plants, effects or scores.
import contextlib
import fcntl
import hashlib
import json
import os
import re
import shutil
import signal
import stat
import subprocess
import tempfile
import time
from pathlib import Path

from tools import workers
from tools.workers import Wrong

LEDGER = "answers.ledger"  # in the vault: what was begun and answered, in order
OPENED = "score"  # name of its lines that say when seals were opened
HEAD = "ledger.head"  # in the campaign: how far the ledger had come, so that lines taken off its end show
WRONG_USE = (2, 126, 127)  # exit codes of a command that was called wrongly, may not be run or is not there
MOST_BYTES = 200_000_000  # of a report
KEEP = (  # of a report
    "verdict", "sentence", "location", "causes", "accepted", "closed", "leftover_sigma", "confusable", "baselines",
    "degradations", "provenance")
OTHER_USER = 65534  # as whom root lets the command run: nobody


class NotRun(RuntimeError):
    """The machine's fault, not the command's: nothing is answered."""


def sha(data):
    return hashlib.sha256(data).hexdigest()


def now():
    return time.time_ns()


def ids_of(part, whole, count):
    """Numbers of the sets in a part of a campaign; those of today have one."""
    return range(part - 1, count, whole)


def parts_of(vault):
    """(part, of how many, sets of the whole) of every part that a maker has begun."""
    return sorted(tuple(map(int, path.stem.split("_of_"))) for path in vault.glob("*_of_*_of_*.kinds")
                  if re.fullmatch(r"\d+_of_\d+_of_\d+", path.stem))


def write_once(path, text):
    """A file that is whole or not there, and cannot be written a second time."""
    path = Path(path)
    with tempfile.NamedTemporaryFile("w", dir=path.parent, prefix=f".{path.name}.") as file:
        file.write(text)
        file.flush()
        os.fchmod(file.fileno(), 0o444)
        os.link(file.name, path)


@contextlib.contextmanager
def planning(folder, what, command="gap_blind", more="--jobs, --scheduler"):
    """Only one process at a time plans a campaign and writes its ledger. The lock ends with the process. command, more: for the
    message, whose campaign it is and the options that give it more workers."""
    with open(folder / f".{what}.lock", "w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise Wrong(f"{folder}: another {command} {what} is at this campaign; wait for it, or stop it and begin again with more "
                        f"workers ({more})")
        yield


def digest(folder):
    h = hashlib.sha256()
    for path in sorted(Path(folder).iterdir()):
        h.update(path.name.encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return h.hexdigest()


def listed(names):
    """The first of many names."""
    return ", ".join(names[:8]) + (" ..." if len(names) > 8 else "")


def seal_of(folder, name):
    """A set's seal. ValueError where its file is none."""
    path = folder / "seals" / f"{name}.json"
    try:
        seal = json.loads(path.read_text())
        hashes = [seal["answer_sha256"], seal["data_sha256"], seal.get("followup_sha256", "")]
        if seal["id"] != name or not all(isinstance(h, str) for h in hashes) or not isinstance(seal["sealed_ns"], int):
            raise ValueError("other fields")
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as wrong:
        raise ValueError(f"seals/{path.name} is no seal that make wrote ({type(wrong).__name__}: {wrong}); put it back from a copy")
    return seal


def seal_sha(seal):
    """SHA-256 of a seal's file as make writes it, also of a seal that only a record holds."""
    return sha((json.dumps(seal) + "\n").encode())


def enter(ledger, head, name, **what):
    """Writes down what became of `name`: begun, answered or not. What was done again, changed or taken out since shows by it."""
    with open(ledger, "ab+", buffering=0) as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        lines = file.read().decode(errors="replace").splitlines()
        not_cut(lines, ledger, head)
        lines.append(json.dumps(dict(name=name, **what, before=sha(lines[-1].encode()) if lines else "")))
        end, line = file.tell(), (lines[-1] + "\n").encode()
        if file.write(line) < len(line):
            file.truncate(end)
            raise OSError(f"no space left for a line of {ledger}")
        os.fsync(file.fileno())
        new = head.with_name(f"{head.name}.new")
        new.write_text(json.dumps(dict(lines=len(lines), sha256=sha(lines[-1].encode()))) + "\n")
        os.replace(new, head)


def not_cut(lines, ledger, head):
    """Wrong where lines are missing at the ledger's end. One more than the head knows of is what an interruption leaves."""
    if not head.exists():
        if sum('"seal_sha256"' in line for line in lines) > 1:  # up to c15 there was none
            raise Wrong(f"{head} is gone, which says how many lines {ledger} has; put it back as diagnose left it")
        return
    try:
        known = json.loads(head.read_text())
        count, last = int(known["lines"]), known["sha256"]
    except (ValueError, KeyError, TypeError, RecursionError):
        raise Wrong(f"{head} says no longer how many lines {ledger} has; put it back as diagnose left it")
    if not 1 <= count <= len(lines) or sha(lines[count - 1].encode()) != last:
        raise Wrong(f"{ledger}: {len(lines)} lines, not the {count} that {head} knows of; put it back as diagnose left it, or, where two "
                    "vaults were copied into one, take them apart and name both campaigns: score CAMPAIGN1 CAMPAIGN2")


def end_of(ledger):
    """Length and last line's hash of a ledger: whoever notes them elsewhere sees whether any line was taken off since."""
    lines = ledger.read_text(errors="replace").splitlines()
    return f"{len(lines)} lines, the last {sha(lines[-1].encode())[:16]}" if lines else "empty"


def entered(ledger, head):
    """Lines of the ledger; None without one. Wrong where a line was changed or taken out."""
    if not ledger.exists():
        return None
    entries, before, remedy = [], "", "; put the ledger back as diagnose left it"
    texts = ("name", "before", "sha256", "seal_sha256")
    with open(ledger, errors="replace") as file:
        fcntl.flock(file, fcntl.LOCK_SH)  # nobody writes to it and to the head meanwhile
        lines = file.read().splitlines()
        for number, line in enumerate(lines, 1):
            try:
                entry = dict.fromkeys(texts[2:], "") | json.loads(line)
                if not all(isinstance(entry[key], str) for key in texts):
                    raise ValueError
            except (ValueError, KeyError, TypeError, RecursionError):
                raise Wrong(f"{ledger}:{number}: not a line of a ledger of answers: {line[:60]}{remedy}")
            if entry["before"] != before:
                raise Wrong(f"{ledger}:{number}: the line of {entry['name']} does not follow the one above it{remedy}")
            before = sha(line.encode())
            entries.append(entry)
        not_cut(lines, ledger, head)
    return entries


def confined(vault, campaign):
    """(prefix of a command that makes the vault unreadable to it, how); checked, not assumed. A vault that is not on this
    machine needs none; root's rights are dropped all the same."""
    vault, campaign = vault.resolve(), campaign.resolve()  # the command runs in a folder of its own
    there = vault.exists()
    files = sorted(map(str, vault.iterdir())) if there else []
    if os.geteuid() == 0:
        # A change of user undoes what workers.program had the kernel do where the worker dies.
        prefix, how = ["setpriv", "--pdeathsig=KILL", f"--reuid={OTHER_USER}", f"--regid={OTHER_USER}", "--clear-groups", "--no-new-privs"], "other user"
    elif there:
        # What may mount may also unmount: its rights go once both folders are covered.
        prefix, how = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c",
                       'mount -t tmpfs none "$0" && mount -t tmpfs none "$1" && shift && '
                       'exec setpriv --bounding-set=-all --inh-caps=-all --no-new-privs "$@"', str(vault), str(campaign)], "covered"
    else:
        prefix, how = [], "same user"
    spy = 'umount "$0" 2>/dev/null; for f; do cat "$f" >/dev/null 2>&1 && exit 1; done; exit 0'
    try:
        works = subprocess.run([*prefix, "sh", "-c", spy, str(vault), *files], cwd="/", capture_output=True).returncode == 0
    except FileNotFoundError:
        works = False
    if not works:
        raise Wrong(f"the diagnosis could read {vault}: move it to another machine or user, or run as root with setpriv")
    return prefix, how if there else f"{how}, no vault here"


def may_be_vault(vault, folder):
    """Wrong where make would take a folder that is somebody else's."""
    inside = vault.resolve()
    if folder.resolve() == inside or folder.resolve() in inside.parents:
        raise Wrong(f"--vault {vault} must lie outside the campaign, which the diagnosis reads; name a new folder beside it")
    if inside in folder.resolve().parents:
        raise Wrong(f"--vault {vault} contains the campaign {folder}, and would be closed to all others; name a new folder beside it")
    if vault.exists() and not vault.is_dir():
        raise Wrong(f"--vault {vault} is no folder; name a new one")
    # In this order: who makes another part at the same time notes the vault before it is filled.
    filled, note = vault.exists() and any(vault.iterdir()), folder / "vault"
    noted = note.read_text().strip() if note.exists() else None
    if noted and Path(noted) != inside:
        raise Wrong(f"--vault {vault}: this campaign's answers are in {noted}; name that with --vault")
    if filled and not noted:
        raise Wrong(f"--vault {vault} is not empty, and not this campaign's; name a new or an empty folder")


def vault_of(folder, named):
    """Where the answers are: as named, else where make put them."""
    note = folder / "vault"
    noted = Path(note.read_text().strip()) if note.exists() else Path(f"{str(folder).rstrip('/')}.vault")
    if not named:
        return noted
    if not Path(named).is_dir():
        raise Wrong(f"--vault {named}: no such folder; make put the answers into {noted}")
    if noted.exists() and not noted.samefile(named):
        raise Wrong(f"--vault {named}: this campaign's answers are in {noted}, which is there")
    return Path(named)


def run_once(words, work, timeout_s):
    """(exit code, end of stderr); what it has started ends with it."""
    with tempfile.TemporaryFile() as err:  # without a name, so that the command cannot put something else in its place
        with workers.program(words, cwd=work, stderr=err, env={"PATH": os.environ["PATH"], "HOME": str(work)}) as done:
            try:
                code = done.wait(timeout_s)
            except subprocess.TimeoutExpired:
                code = None
        err.seek(max(0, err.seek(0, os.SEEK_END) - 2000))
        text = err.read().decode(errors="replace")
    return (124, f"more than {timeout_s} s") if code is None else (code, text)


def run_sealed(data, command, program_sha256, vault, folder, claim, timeout_s, program=None):
    """A task: what the command answers to one set, and how the answers were hidden from it: (report or None, facts, how).

    program: the file that program_sha256 is of, where it is not the command's first word but called by it.
    claim: a file of this one beginning, which the ledger knows of. Where it is there already, a worker died at it, and it is for
    the planning process to write down that it is begun again."""
    try:
        open(claim, "x").close()
    except FileExistsError:
        raise workers.WorkerDied
    program = program or command[0]
    if sha(Path(program).read_bytes()) != program_sha256:
        raise NotRun(f"{program} is another program where the worker runs")
    prefix, how = confined(Path(vault), Path(folder))
    report, run = diagnose_one(command, data, prefix, timeout_s)
    return report and {key: report[key] for key in KEEP if key in report}, run, dict(confined=bool(prefix), vault=how)


def diagnose_one(command, folder, prefix, timeout_s):
    """Runs the command on a copy of the set, under names that tell nothing. (report or None, facts). NotRun where the
    machine kept it from running to its end."""
    with tempfile.TemporaryDirectory(prefix="set_", ignore_cleanup_errors=True) as work:
        work = Path(work)
        try:
            shutil.copytree(folder, work / "set", copy_function=shutil.copyfile)
        except (OSError, shutil.Error) as wrong:
            raise NotRun(f"cannot copy the set: {wrong}")
        (work / "out").mkdir()
        for path in [work, *work.rglob("*")]:
            if prefix and os.geteuid() == 0:
                os.chown(path, OTHER_USER, OTHER_USER)
            path.chmod(0o700 if path.is_dir() else 0o600)
            os.utime(path, (0, 0))  # when it was written tells how long it took to make
        if subprocess.run([*prefix, "test", "-w", str(work / "out")], cwd=work, capture_output=True).returncode != 0:
            raise NotRun(f"the command, as another user, cannot write into {work}: set TMPDIR to a folder that everybody may enter")
        words = [w.replace("{robot}", str(work / "set" / "robot.yaml")).replace("{set}", str(work / "set"))
                 .replace("{out}", str(work / "out")) for w in command]
        begin = now()
        code, error = run_once([*prefix, *words], work, timeout_s)
        finished = now()
        if -code in (signal.SIGHUP, signal.SIGINT, signal.SIGKILL, signal.SIGTERM):  # crashes are the command's own
            raise NotRun(f"stopped from outside ({signal.Signals(-code).name})")
        if code != 0 and "No space left on device" in error:
            raise NotRun(error.strip()[-200:])
        report = None
        if code == 0:
            path = work / "out" / "report.json"
            try:
                if not stat.S_ISREG(path.lstat().st_mode) or path.lstat().st_size > MOST_BYTES:
                    raise ValueError("no plain file of a sensible size")
                report = json.loads(path.read_text())
                report["verdict"], [(c["effect"], c["where"], c["p"]) for c in report["causes"]], report["location"]
            except (OSError, ValueError, KeyError, TypeError, RecursionError) as wrong:
                report, error = None, f"report.json: {type(wrong).__name__}: {wrong}"
        return report, dict(started_ns=begin, finished_ns=finished, exit_code=code, error=error)
