# What a sealed test rests on: files written once, one process at a set, a command that cannot read the answers.
# Knows nothing of plants, effects or scores.
import contextlib
import fcntl
import hashlib
import json
import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path


class Wrong(Exception):
    pass


def sha(data):
    return hashlib.sha256(data).hexdigest()


def now():
    return time.time_ns()


def shard_ids(count, shard):
    part, _, whole = shard.partition("/")
    if not (part.isdigit() and whole.isdigit() and 1 <= int(part) <= int(whole)):
        raise Wrong(f"--shard {shard}: write i/n with 1 <= i <= n, such as 2/8")
    return [k for k in range(count) if k % int(whole) == int(part) - 1]


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


def confined(vault):
    """Prefix of a command that makes the vault unreadable to it; checked, not assumed. A vault that is not on this machine
    needs none; root's rights are dropped all the same."""
    drop = [["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]] if os.geteuid() == 0 else []
    hide = ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", 'mount -t tmpfs none "$0" && exec "$@"', str(vault)]
    there = vault.exists()
    if not there:
        print(f"{vault} is not on this machine: nothing to hide", flush=True)
    probe = next(iter(sorted(vault.glob("*.json"))), None) if there else None
    for prefix in drop + ([hide] if there else [[]]):
        try:
            works = subprocess.run([*prefix, "true"], capture_output=True).returncode == 0
        except FileNotFoundError:
            continue
        if works and (probe is None or subprocess.run([*prefix, "cat", str(probe)], capture_output=True).returncode != 0):
            return prefix
    raise Wrong(f"the diagnosis could read {vault}: move it to another machine or user, or run as root with setpriv")


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


def diagnose_one(command, folder, prefix, timeout_s):
    """Runs the command on a copy of the set, under names that tell nothing. (report or None, facts)"""
    with tempfile.TemporaryDirectory(prefix="set_") as work:
        work = Path(work)
        shutil.copytree(folder, work / "set", copy_function=shutil.copyfile)
        (work / "out").mkdir()
        for path in [work, *work.rglob("*")]:
            path.chmod(0o777 if path.is_dir() else 0o644)
            os.utime(path, (0, 0))  # when it was written tells how long it took to make
        words = [w.replace("{robot}", str(work / "set" / "robot.yaml")).replace("{set}", str(work / "set"))
                 .replace("{out}", str(work / "out")) for w in command]
        begin = now()
        try:
            done = subprocess.run([*prefix, *words], cwd=work, capture_output=True, text=True, errors="replace", timeout=timeout_s,
                                  env={"PATH": os.environ["PATH"], "HOME": str(work)})
            code, error = done.returncode, done.stderr[-2000:]
        except subprocess.TimeoutExpired:
            code, error = -1, f"more than {timeout_s} s"
        report = None
        if code == 0:
            try:
                report = json.loads((work / "out" / "report.json").read_text())
                report["verdict"], [(c["effect"], c["where"], c["p"]) for c in report["causes"]], report["location"]
            except (OSError, ValueError, KeyError, TypeError) as wrong:
                report, error = None, f"report.json: {type(wrong).__name__}: {wrong}"
        return report, dict(started_ns=begin, finished_ns=now(), exit_code=code, error=error)
