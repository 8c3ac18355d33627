# What a sealed test rests on: files written once, one process at a set, a command that cannot read the answers.
# Knows nothing of plants, effects or scores.
import contextlib
import fcntl
import hashlib
import json
import os
import shutil
import signal
import stat
import subprocess
import tempfile
import time
from pathlib import Path


LEDGER = "answers.ledger"  # in the vault: what was answered, in order
MOST_BYTES = 200_000_000  # of a report
OTHER_USER = 65534  # as whom root lets the command run: nobody


class Wrong(Exception):
    pass


class NotRun(RuntimeError):
    """The machine's fault, not the command's: nothing is answered."""


def sha(data):
    return hashlib.sha256(data).hexdigest()


def now():
    return time.time_ns()


def shard_ids(count, shard):
    part, _, whole = shard.partition("/")
    number = lambda t: t.isascii() and t.isdecimal()
    if not (number(part) and number(whole) and 1 <= int(part) <= int(whole)):
        raise Wrong(f"--shard {shard}: write i/n with 1 <= i <= n, such as 2/8")
    return [k for k in range(count) if k % int(whole) == int(part) - 1]


def parts_of(vault):
    """(part, of how many, sets of the whole) of every part that a maker has begun."""
    return sorted(tuple(map(int, path.stem.split("_of_"))) for path in vault.glob("*_of_*_of_*.kinds"))


def write_once(path, text):
    """A file that is whole or not there, and cannot be written a second time."""
    path = Path(path)
    with tempfile.NamedTemporaryFile("w", dir=path.parent, prefix=f".{path.name}.") as file:
        file.write(text)
        file.flush()
        os.fchmod(file.fileno(), 0o444)
        os.link(file.name, path)


@contextlib.contextmanager
def mine(path):
    """Whether nobody else is at what this file stands for; until the block or the process ends, nobody comes to be."""
    with open(path, "w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print(f"{path.name.split('.')[1]}: another process is at it, left to that", flush=True)
            yield False
            return
        try:
            yield True
        finally:
            path.unlink(missing_ok=True)  # who waits with the file that is gone finds the work done


def digest(folder):
    h = hashlib.sha256()
    for path in sorted(Path(folder).iterdir()):
        h.update(path.name.encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return h.hexdigest()


def enter(ledger, name, text):
    """Writes down that `name` was answered so; what was answered again, or changed since, shows beside it."""
    with open(ledger, "a+") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        lines = file.read().splitlines()
        entry = dict(name=name, sha256=sha(text.encode()), before=sha(lines[-1].encode()) if lines else "")
        file.write(json.dumps(entry) + "\n")
        file.flush()
        os.fsync(file.fileno())


def entered(ledger):
    """{name: [sha256 of each answer]}; None without a ledger. ValueError where a line was changed or taken out."""
    if not ledger.exists():
        return None
    answers, before = {}, ""
    for number, line in enumerate(ledger.read_text().splitlines(), 1):
        try:
            entry = json.loads(line)
            name, given, follows = entry["name"], entry["sha256"], entry["before"]
        except (ValueError, KeyError, TypeError):
            raise ValueError(f"{ledger}:{number}: not a line of a ledger of answers: {line[:60]}")
        if follows != before:
            raise ValueError(f"{ledger}:{number}: the line of {name} does not follow the one above it")
        before = sha(line.encode())
        answers.setdefault(name, []).append(given)
    return answers


def confined(vault, campaign):
    """(prefix of a command that makes the vault unreadable to it, how); checked, not assumed. A vault that is not on this
    machine needs none; root's rights are dropped all the same."""
    vault, campaign = vault.resolve(), campaign.resolve()  # the command runs in a folder of its own
    there = vault.exists()
    files = sorted(map(str, vault.iterdir())) if there else []
    if not there:
        print(f"{vault} is not on this machine: nothing to hide", flush=True)
    if os.geteuid() == 0:
        prefix, how = ["setpriv", f"--reuid={OTHER_USER}", f"--regid={OTHER_USER}", "--clear-groups", "--no-new-privs"], "other user"
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
        done = subprocess.Popen(words, cwd=work, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=err, start_new_session=True,
                                env={"PATH": os.environ["PATH"], "HOME": str(work)})
        try:
            code = done.wait(timeout_s)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(done.pid, signal.SIGKILL)
            done.wait()
        err.seek(max(0, err.seek(0, os.SEEK_END) - 2000))
        text = err.read().decode(errors="replace")
    return (124, f"more than {timeout_s} s") if code is None else (code, text)


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
