# Sealed campaigns: sets with something unknown planted, a diagnosis that never sees the answers, and the score.
# make and score know the plant; diagnose knows folders, hashes and a command, nothing else.
import argparse
import contextlib
import fcntl
import hashlib
import json
import os
import secrets
import shutil
import stat
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
KINDS = dict(single=0.38, parameter=0.15, null=0.2, nuisance_null=0.05, unlisted=0.08, pair=0.08, weak=0.03, no_tracker=0.03)


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


# ---------------------------------------------------------------- make
def kinds_of(count, rng):
    """Kinds for `count` sets: whole parts by the composition, the rest by chance, in random order."""
    names, kinds = list(KINDS), []
    for name in names:
        kinds += [name] * int(KINDS[name] * count)
    while len(kinds) < count:
        kinds.append(rng.choices(names, [KINDS[n] * count % 1 + 1e-9 for n in names])[0])
    rng.shuffle(kinds)
    return kinds


def draw(kind, rng, among=None):
    """What to plant: list of (name, where, sigma, sign); what lists name only `among` these."""
    from tests.blind import effects
    groups = dict(single=("listed", "scale", "sensor"), parameter=("scale",), unlisted=("unlisted",), pair=("listed", "scale"),
                  weak=("listed", "scale"), no_tracker=("listed", "scale"))
    if kind not in groups:
        return []
    pool = [e for e in effects.LIST.values() if e.kind in groups[kind] and e.name != "free_chain"]
    if among and kind != "unlisted":
        pool = [e for e in pool if e.name in among]
    if kind == "no_tracker":
        pool = [e for e in pool if not e.name.startswith("tracker")]

    def one(sigma):
        e = rng.choice(pool)
        pool.remove(e)
        parts = dict(tendon=3, unit=4).get(e.scope)
        alone = parts and e.on_one and (not e.on_all or rng.random() < 0.4)
        where = f"{e.scope}:{rng.randint(1, parts)}" if alone else "all"
        return e.name, where, sigma, rng.choice((-1, 1)) if e.low < 0 else 1

    log_uniform = lambda a, b: a * (b / a) ** rng.random()
    if kind == "pair":
        s = log_uniform(5, 30)
        return [one(s), one(s / log_uniform(1, 5))]
    return [one(log_uniform(3, 30) if kind in ("weak", "no_tracker") else log_uniform(0.1, 30))]


def make(o):
    import random
    from tests.blind import effects
    folder, vault = Path(o.campaign), Path(o.vault or o.campaign.rstrip("/") + ".vault")
    if folder.resolve() == vault.resolve() or folder.resolve() in vault.resolve().parents:
        raise Wrong("--vault must lie outside the campaign, which the diagnosis reads")
    strange = sorted(set(o.effects or ()) - set(effects.LIST))
    if strange:
        raise Wrong(f"--effects: no {', '.join(strange)}; accepted: {', '.join(effects.LIST)}")
    ids = shard_ids(o.sets, o.shard)
    for d in (folder / "sets", folder / "seals", vault):
        d.mkdir(parents=True, exist_ok=True)
    vault.chmod(0o700)
    rng = random.SystemRandom()
    for k, kind in zip(ids, kinds_of(len(ids), rng)):
        name = f"{k:04d}"
        with mine(folder / "seals" / f".{name}.lock") as free:
            if free and not (folder / "seals" / f"{name}.json").exists():
                make_one(o, folder, vault, name, kind, rng)


def make_one(o, folder, vault, name, kind, rng):
    import yaml
    from tests.blind import make as generator
    for leftover in (folder / "sets" / name, folder / "sets" / f"{name}_followup"):
        shutil.rmtree(leftover, ignore_errors=True)
    robot_name = rng.choice(["rig_90mm"] * 4 + ["rig_60mm"])
    robot = yaml.safe_load((ROOT / "config" / "robots" / f"{robot_name}.yaml").read_text())
    cell = rng.choice(["motor_side"] * 4 + ["robot_side"])
    seed = rng.getrandbits(48)
    for _ in range(5):  # again where what was drawn cannot be made
        items, sizes = [], []
        for effect, where, sigma, sign in draw(kind, rng, o.effects):
            amount, size, channel = generator.amount_for(robot, effect, where, sigma, seed, sign, cell)
            items.append((effect, where, amount))
            sizes.append(dict(wanted_sigma=sigma, sigma=size, channel=channel))
        others = ["cocontraction", "circle", "steps", "multisine", "ladder", "hold"]
        families = ["triangle"] + rng.sample(others, o.families - 1)
        nuisance = 0.0
        if kind == "nuisance_null":
            nuisance, size = generator.small_nuisance(robot, seed, cell)
            sizes.append(dict(wanted_sigma=0.0, sigma=size, channel="any"))
        common = dict(robot_name=robot_name, items=items, seed=seed, load_cell=cell, tracker=kind != "no_tracker",
                      colour=rng.choice([0, 0, 0.5, 0.9]), lost=rng.choice([0, 0, 0, 0.03]),
                      jitter=rng.choice([3e-6, 3e-6, 2e-5]), nuisance=nuisance)
        try:
            extra = {}
            if kind == "weak":
                answer = generator.make_set(folder / "sets" / name, None, families=["weak", "weak"], **common)
                extra = generator.make_set(folder / "sets" / f"{name}_followup", None, families=families, **common)
                extra = dict(followup_sha256=extra["sha256_of_data"])
            else:
                answer = generator.make_set(folder / "sets" / name, None, families=families, **common)
            break
        except RuntimeError:
            shutil.rmtree(folder / "sets" / name, ignore_errors=True)
    else:
        raise RuntimeError(f"set {name}: five draws could not be simulated")
    answer.update(extra, id=name, set_kind=kind, sizes=sizes, nonce=secrets.token_hex(32))
    text = json.dumps(answer, indent=1) + "\n"
    path = vault / f"{name}.json"
    path.unlink(missing_ok=True)
    write_once(path, text)
    seal = dict(id=name, answer_sha256=sha(text.encode()), data_sha256=answer["sha256_of_data"], sealed_ns=now(), **extra)
    write_once(folder / "seals" / f"{name}.json", json.dumps(seal) + "\n")
    print(f"set {name} sealed {seal['answer_sha256'][:16]}", flush=True)


# ---------------------------------------------------------------- diagnose
def digest(folder):
    h = hashlib.sha256()
    for path in sorted(Path(folder).iterdir()):
        h.update(path.name.encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return h.hexdigest()


def confined(vault):
    """Prefix of a command that makes the vault unreadable to it; checked, not assumed."""
    probe = next(iter(sorted(vault.glob("*.json"))), None) if vault.exists() else None
    if not vault.exists():
        print(f"{vault} is not on this machine: nothing to hide (else name it by --vault)", flush=True)
        return []
    prefixes = [["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]] if os.geteuid() == 0 else []
    hide = 'mount -t tmpfs none "$0" && exec "$@"'
    prefixes.append(["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", hide, str(vault)])
    for prefix in prefixes:
        try:
            works = subprocess.run([*prefix, "true"], capture_output=True).returncode == 0
        except FileNotFoundError:
            continue
        if works and (probe is None or subprocess.run([*prefix, "cat", str(probe)], capture_output=True).returncode != 0):
            return prefix
    raise Wrong(f"the diagnosis could read {vault}: move it to another machine or user, or run as root with setpriv")


def diagnose_one(command, folder, prefix, timeout_s):
    """Runs the command on a copy of the set, under names that tell nothing. (report or None, facts)"""
    with tempfile.TemporaryDirectory(prefix="set_") as work:
        work = Path(work)
        shutil.copytree(folder, work / "set")
        (work / "out").mkdir()
        for path in [work, *work.rglob("*")]:
            path.chmod(0o777 if path.is_dir() else 0o644)
        words = [w.replace("{robot}", str(work / "set" / "robot.yaml")).replace("{set}", str(work / "set"))
                 .replace("{out}", str(work / "out")) for w in command]
        begin = now()
        try:
            done = subprocess.run([*prefix, *words], cwd=work, capture_output=True, text=True, timeout=timeout_s,
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


IN_RECORD = ("verdict", "causes", "location", "accepted", "closed", "baselines")
KEEP = ("verdict", "sentence", "location", "causes", "accepted", "closed", "leftover_sigma", "confusable", "baselines",
        "degradations", "provenance")


def diagnose(o):
    folder = Path(o.campaign)
    vault = Path(o.vault or o.campaign.rstrip("/") + ".vault")
    prefix = confined(vault)
    command = o.command or [str(o.tendril), "gap", "diagnose", "--robot", "{robot}", "--out", "{out}", "--no-next", "{set}"]
    program = shutil.which(command[0])
    if not program:
        raise Wrong(f"{command[0]}: no such program; give --tendril or the command after --")
    if not any((folder / "seals").glob("*.json")):
        raise Wrong(f"--campaign {folder}: no sealed sets in its folder seals; gap_blind make writes them")
    (folder / "answers").mkdir(exist_ok=True)
    program_sha256 = sha(Path(program).read_bytes())
    for k in shard_ids(o.sets or 100000, o.shard):
        if not (folder / "seals" / f"{k:04d}.json").exists():
            continue
        for name in (f"{k:04d}", f"{k:04d}_followup"):
            data, out = folder / "sets" / name, folder / "answers" / f"{name}.json"
            if not data.exists() or out.exists():
                continue
            with mine(folder / "answers" / f".{name}.lock") as free:
                if not free or out.exists():
                    continue
                before = digest(data)
                report, facts = diagnose_one(command, data, prefix, o.timeout)
                answer = dict(id=name, data_sha256=before, program_sha256=program_sha256,
                              report=report and {key: report[key] for key in KEEP if key in report}, **facts)
                write_once(out, json.dumps(answer) + "\n")
            print(f"{name}: {report['verdict'] if report else 'failed: ' + facts['error'].strip()[-200:]}, "
                  f"{(facts['finished_ns'] - facts['started_ns']) / 1e9:.1f} s", flush=True)


# ---------------------------------------------------------------- score
SEEN = 0.3  # sigma from which half of all effects shall be seen


def wilson(k, n, z=1.959964):
    if n == 0:
        return float("nan"), 0.0, 1.0
    p = k / n
    c = (p + z * z / (2 * n)) / (1 + z * z / n)
    h = z / (1 + z * z / n) * (p * (1 - p) / n + z * z / (4 * n * n)) ** 0.5
    return p, max(0.0, c - h), min(1.0, c + h)


def refused(seal, answer_text, answer, record, data):
    """Why a record does not count, or None."""
    if sha(answer_text.encode()) != seal["answer_sha256"]:
        return "the opened answer is not the sealed one"
    wanted = seal["followup_sha256"] if record["id"].endswith("_followup") else seal["data_sha256"]
    if record["data_sha256"] != wanted or (data.exists() and digest(data) != wanted):
        return "the data are not the sealed ones"
    if record["started_ns"] < seal["sealed_ns"]:
        return "the diagnosis is older than the seal"
    return None


class Case:
    """One scored set: truth beside diagnosis."""

    def __init__(self, truth, record, oracle=None):
        self.opened, self.record, self.oracle = truth, record, oracle
        self.followup = record["id"].endswith("_followup")
        self.truth, self.kind, self.id = truth["truth"], truth["set_kind"], truth["id"]
        self.sigma = max([s["sigma"] for s in truth["sizes"]], default=0.0)
        self.channel = truth["sizes"][0]["channel"] if truth["sizes"] else ""
        self.robot, self.cell = truth["robot"], truth["load_cell"]
        self.report = record["report"]
        r = self.report or {}
        self.verdict = r.get("verdict", "failed")
        self.causes = r.get("causes", [])
        self.p = {(c["effect"], c["where"]): c["p"] for c in self.causes}
        self.unknown = sum(c["p"] for c in self.causes if c["effect"] == "unknown") + (self.verdict == "unexplained")
        self.wanted = [(t["effect"], t["where"]) for t in self.truth]

    def line(self):
        """What a score is made of, for the record that outlives logs and vault: causes that nobody gave weight are left out."""
        report = self.report and {k: self.report[k] for k in IN_RECORD if k in self.report}
        if report:
            group = self.top and self.top.get("group")
            report["hypotheses"] = self.hypotheses
            report["location"] = [f for f in report.get("location", []) if f.get("first")]
            report["causes"] = [{k: c[k] for k in ("effect", "where", "p", "group") if k in c} for k, c in enumerate(self.causes)
                                if k < 5 or c["p"] >= 0.001 or (group and c.get("group") == group)]
            report["accepted"] = [{k: c[k] for k in ("effect", "where")} for c in report.get("accepted", [])]
            closed = report.get("closed") or {}
            report["closed"] = {k: {"value": closed[k].get("value")} for k in ("pooled", "ceiling") if closed.get(k)}
        return dict(truth={k: self.opened[k] for k in ("id", "truth", "set_kind", "sizes", "robot", "load_cell")},
                    record=dict({k: self.record[k] for k in ("id", "data_sha256", "program_sha256", "started_ns", "finished_ns")},
                                report=report), oracle=self.oracle)

    @property
    def hypotheses(self):
        return (self.report or {}).get("hypotheses", len(self.causes))

    @staticmethod
    def same(cause, wanted):
        # one value for all is the same as the robot's, its sections' or all units'
        norm = lambda w: "all" if w in ("", "all", "section:1") else w
        return cause["effect"] == wanted[0] and norm(cause["where"]) == norm(wanted[1])

    @property
    def top(self):
        return self.causes[0] if self.causes else None

    def group_hit(self):
        """The top cause is the true one, or stands in one group with it and the verdict says that it is a group."""
        if not self.top or not self.wanted:
            return False
        if self.same(self.top, self.wanted[0]):
            return True
        g = self.top.get("group", 0)
        return self.verdict == "ambiguous_group" and g > 0 and any(
            c.get("group") == g and self.same(c, self.wanted[0]) for c in self.causes)

    def alarm(self):
        """A gap is claimed. A diagnosis that failed to answer has a row of its own."""
        return self.verdict not in ("no_gap", "insufficient_data", "failed")

    def confident_wrong(self):
        if not self.top or self.verdict != "attributed":
            return False
        return self.top["p"] >= 0.9 and not any(self.same(self.top, w) for w in self.wanted)

    def first_cut(self):
        return next((f["cut"] for f in self.report["location"] if f.get("first")), None) if self.report else None


def auroc(positive, negative):
    if not positive or not negative:
        return float("nan")
    wins = sum((a > b) + 0.5 * (a == b) for a in positive for b in negative)
    return wins / (len(positive) * len(negative))


def half_point(cases):
    """sigma of 50 % detection by a logistic curve over log sigma (Newton), and the binned curve."""
    import math
    bins = []
    edges = [0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 12.8, 1e9]
    points = [(max(c.sigma, 1e-3), c.verdict not in ("no_gap", "insufficient_data", "failed")) for c in cases]
    for a, b in zip(edges, edges[1:]):
        inside = [d for s, d in points if a <= s < b]
        if inside:
            bins.append((a, b, sum(inside), len(inside)))
    hits = sum(d for _, d in points)
    if len(points) < 8 or hits in (0, len(points)):
        return float("nan"), bins, None
    w = [0.0, 1.0]
    for _ in range(50):
        g, h = [-1e-3 * w[0], -1e-3 * w[1]], [[1e-3, 0], [0, 1e-3]]
        for s, d in points:
            x = math.log(s)
            p = 1 / (1 + math.exp(-max(-30, min(30, w[0] + w[1] * x))))
            for a, xa in enumerate((1, x)):
                g[a] += (d - p) * xa
                for b, xb in enumerate((1, x)):
                    h[a][b] += p * (1 - p) * xa * xb
        det = h[0][0] * h[1][1] - h[0][1] * h[1][0]
        w = [w[0] + (g[0] * h[1][1] - g[1] * h[0][1]) / det, w[1] + (g[1] * h[0][0] - g[0] * h[1][0]) / det]
    return (math.exp(-w[0] / w[1]) if w[1] > 0 else float("nan")), bins, w


def table(cases, followups, refusals):
    lines, numbers = [], {}

    def row(name, k, n, goal):
        p, low, high = wilson(k, n)
        numbers[name] = dict(k=k, n=n, value=p, ci=[low, high], goal=goal)
        shown = f"{100 * p:5.1f} % [{100 * low:5.1f}, {100 * high:5.1f}]" if n else "no such sets"
        lines.append(f"| {name} | {k} of {n} | {shown} | {goal} |")

    known = [c for c in cases if c.kind in ("single", "parameter", "no_tracker")]
    strong = [c for c in known if c.sigma > 3]
    lines.append("| figure | count | value, Wilson 95 % | goal |\n|---|---|---|---|")
    row("top-1 cause at > 3 sigma, group-exact", sum(c.group_hit() for c in strong), len(strong), ">= 95 %")
    row("the same, effect's name alone", sum(bool(c.top) and (c.group_hit() or c.top["effect"] == c.wanted[0][0])
                                            for c in strong), len(strong), "-")
    located = [c for c in strong if c.kind != "no_tracker" and c.cell == "motor_side"]
    row("correct first cut at > 3 sigma (motor-side cell)", sum(c.first_cut() == c.truth[0]["cut"] for c in located),
        len(located), ">= 97 %")
    nulls = [c for c in cases if c.kind == "null"]
    row("false alarms on exact nulls", sum(c.alarm() for c in nulls), len(nulls), "0 of 60")
    nn = [c for c in cases if c.kind == "nuisance_null"]
    row("false alarms on nuisance nulls", sum(c.alarm() for c in nn), len(nn), "-")
    foreign = [c.unknown for c in cases if c.kind == "unlisted" and c.sigma > 1 and c.report]
    own = [c.unknown for c in known if c.sigma > 1 and c.report]
    area = auroc(foreign, own)
    numbers["unknown AUROC"] = dict(value=area, n=[len(foreign), len(own)])
    lines.append(f"| unknown mechanism rejected, AUROC at > 1 sigma | {len(foreign)} against {len(own)} | {area:.3f} | >= 0.95 |")
    unl = [c for c in cases if c.kind == "unlisted" and c.sigma > 1]
    row("unlisted at > 1 sigma never given a confident name", sum(not c.confident_wrong() for c in unl), len(unl), "-")
    row("or only that of what it turns into where it changes little",
        sum(not c.confident_wrong() or c.top["effect"] == c.truth[0].get("near") for c in unl), len(unl), "-")
    row("confidently wrong (p >= 0.9)", sum(c.confident_wrong() for c in cases), len(cases), "<= 1 %")
    judged = [c for c in cases if c.top and c.kind in ("single", "parameter", "null", "nuisance_null", "no_tracker")]

    def reliability(name, none_below):
        """Of the top cause: sets by tenths of p. An effect below `none_below` sigma counts as none."""
        bins = {}
        for c in judged:
            none = not c.wanted or c.sigma < none_below
            hit = (none and c.top["effect"] == "no_gap") or (bool(c.wanted) and c.same(c.top, c.wanted[0]))
            bins.setdefault(min(9, int(c.top["p"] * 10)), []).append((c.top["p"], hit))
        ece = sum(abs(sum(p for p, _ in v) - sum(h for _, h in v)) for v in bins.values()) / len(judged) if judged else float("nan")
        numbers[name] = dict(value=ece, n=len(judged))
        lines.append(f"| {name} of the top cause | {len(judged)} sets | {ece:.3f} | <= 0.05 |")
        numbers[f"reliability, none below {none_below:g} sigma"] = [
            [sum(p for p, _ in v) / len(v), sum(h for _, h in v), len(v)] for _, v in sorted(bins.items())]
        return bins
    reliability("calibration error", 0)
    bins = reliability(f"calibration error with effects below {SEEN:g} sigma as none,", SEEN)
    pairs = [c for c in cases if c.kind == "pair"]

    def both(c):
        named = (c.report or {}).get("accepted") or c.causes[:2]
        return all(any(c.same(a, w) for a in named) for w in c.wanted)
    row("both of a pair", sum(both(c) for c in pairs), len(pairs), ">= 80 %")

    def pooled(report, key="pooled"):
        return (((report or {}).get("closed") or {}).get(key) or {}).get("value")

    def middle(name, ratios, goal):
        ratios = sorted(ratios)
        if ratios:
            numbers[name] = dict(median=ratios[len(ratios) // 2], n=len(ratios))
            lines.append(f"| {name}, median | {len(ratios)} sets | {ratios[len(ratios) // 2]:.3f} | {goal} |")
    # What closes nothing counts as nothing, not as missing.
    middle("gap closed over that of an oracle told the effect",
           [(pooled(c.report) or 0) / o for c in known if (o := pooled(c.oracle)) and o > 0.05],
           ">= 0.97")
    middle("gap closed over what refitting every number closes",
           [pooled(c.report) / o for c in known if pooled(c.report) is not None and (o := pooled(c.report, "ceiling"))], "-")
    half, curve, logistic = half_point([c for c in known if c.kind != "no_tracker"])
    numbers["half detection sigma"] = half
    numbers["detection"] = dict(logistic=logistic, found=curve)
    lines.append(f"| 50 % detection limit | {len(known)} sets | {half:.2f} sigma | <= 0.3 sigma |")
    row("follow-up resolves weak excitation", sum(c.group_hit() for c in followups), len(followups), ">= 90 %")
    row("diagnosis failed to answer", sum(c.report is None for c in cases), len(cases), "0")
    hypotheses = max((c.hypotheses for c in cases), default=0)
    lines.append("\nBaselines on the same singles at > 3 sigma: " +
                 (f"chance 1 of {hypotheses} hypotheses = {100 / hypotheses:.1f} %" if hypotheses else "no answers"))
    chosen = [(c, {b["name"]: b for b in (c.report or {}).get("baselines", [])}) for c in strong]
    for b in sorted({name for _, by_name in chosen for name in by_name}):
        hit = [c.same(by_name[b], c.wanted[0]) for c, by_name in chosen if b in by_name]
        row(f"baseline {b}, names the true cause", sum(hit), len(hit), "-")
    lines.append("\nReliability of the top cause: p, share right, sets")
    for b in sorted(bins):
        v = bins[b]
        lines.append(f"  {sum(p for p, _ in v) / len(v):.2f}  {sum(h for _, h in v) / len(v):.2f}  {len(v)}")
    lines.append("\nDetection: sigma from, to, found, of")
    lines += [f"  {a:g} {b:g}  {k} of {n}" for a, b, k, n in curve]
    lines.append("\nConfusion at > 3 sigma (truth -> top cause: sets)")
    confusion = {}
    for c in strong:
        got = f"{c.top['effect']} {c.top['where']}".strip() if c.top else c.verdict
        if not c.group_hit():
            key = (" ".join(c.wanted[0]), f"{got} [{c.verdict}]")
            confusion.setdefault(key, []).append(f"{c.id} ({c.sigma:.1f} sigma)")
    lines += [f"  {a} -> {b}: {', '.join(ids)}" for (a, b), ids in sorted(confusion.items())] or ["  none"]
    alarms = [f"{c.id} {c.kind} -> {c.top['effect'] if c.top else ''} [{c.verdict}]" for c in nulls + nn
              if c.alarm()]
    lines.append("\nAlarms on nulls: " + (", ".join(alarms) or "none"))
    lines.append("Refused: " + ("; ".join(f"{i}: {why}" for i, why in refusals) or "none"))
    numbers["confusion"] = [[a, b, ids] for (a, b), ids in sorted(confusion.items())]
    return lines, numbers


def picture(numbers, path):
    """Reliability diagram and detection curve."""
    import math
    from matplotlib.figure import Figure
    figure = Figure(figsize=(10, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    blue, orange = "#1f77b4", "#d95f02"

    def shares(axes, points, colour, label):
        """(x, k, n): share k / n with its Wilson interval; the marker's area grows with n."""
        for k, (x, hits, n) in enumerate(points):
            share, low, high = wilson(hits, n)
            axes.plot([x, x], [low, high], color=colour, lw=1.2, alpha=0.6)
            axes.scatter([x], [share], s=10 + 1.5 * n, color=colour, alpha=0.8, label=label if k == 0 else None, zorder=3)

    left.plot([0, 1], [0, 1], color="0.7", lw=1, label="what it says is what is so")
    shares(left, numbers["reliability, none below 0 sigma"], blue, "every planted effect counts")
    shares(left, [(p + 0.012, k, n) for p, k, n in numbers[f"reliability, none below {SEEN:g} sigma"]], orange,
           f"below {SEEN:g} sigma counted as none")
    left.set(xlabel="probability of the first line of the answer", ylabel="share that was right", xlim=(-0.02, 1.04), ylim=(-0.02, 1.04),
             title="How sure, and how often right")
    left.legend(loc="upper left", fontsize=8)
    detection = numbers["detection"]
    shares(right, [(math.sqrt(a * min(b, 2 * a)), k, n) for a, b, k, n in detection["found"]], blue, "sets, with 95 % intervals")
    if detection["logistic"]:
        a, b = detection["logistic"]
        x = [10 ** (-1 + 2.5 * i / 200) for i in range(201)]
        right.plot(x, [1 / (1 + math.exp(-a - b * math.log(v))) for v in x], color=orange, lw=1.5,
                   label=f"half are seen from {numbers['half detection sigma']:.2f} sigma")
    right.set(xscale="log", xlabel="size of the planted effect [sigma]", ylim=(-0.02, 1.04),
              ylabel="share in which a gap is found", title="How small a cause is seen")
    right.legend(loc="lower right", fontsize=8)
    for axes in (left, right):
        axes.grid(alpha=0.25)
    figure.savefig(path, dpi=110)


def told(program, case, data):
    """What the diagnosis closes when the effect is told, after the seal is open: a report, kept beside the sets."""
    if case.kind not in ("single", "parameter") or case.sigma <= 1 or not data.exists():
        return None
    kept = data.parent.parent / "oracle" / f"{case.id}.json"
    if not kept.exists():
        kept.parent.mkdir(exist_ok=True)
        command = [program, "gap", "diagnose", "--robot", "{robot}", "--out", "{out}", "--no-next", "--only", case.wanted[0][0],
                   "{set}"]
        report, _ = diagnose_one(command, data, [], 3600)
        write_once(kept, json.dumps(report and {"closed": report["closed"]}) + "\n")
    return json.loads(kept.read_text())


def opened(folder, vault, oracle):
    """A campaign's cases and what is refused: (cases, [(name, why)])."""
    cases, refusals = [], []
    for seal_file in sorted((folder / "seals").glob("*.json")):
        seal = json.loads(seal_file.read_text())
        for name in (seal["id"], seal["id"] + "_followup"):
            path = folder / "answers" / f"{name}.json"
            if not path.exists():
                if not name.endswith("_followup"):
                    refusals.append((name, "not diagnosed"))
                continue
            try:
                text = (vault / f"{seal['id']}.json").read_text()
                record, truth = json.loads(path.read_text()), json.loads(text)
            except FileNotFoundError:
                refusals.append((name, f"{vault} does not hold its answer (--vault)"))
                continue
            except ValueError as wrong:
                refusals.append((name, f"answer or truth is not JSON: {wrong}"))
                continue
            why = refused(seal, text, truth, record, folder / "sets" / name)
            if os.stat(path).st_mode & stat.S_IWUSR:
                why = why or "the answer's file can be rewritten"
            if why:
                refusals.append((name, why))
                continue
            case = Case(truth, record)
            if oracle and not case.followup:
                case.oracle = told(oracle, case, (folder / "sets" / name).resolve())
            cases.append(case)
    return cases, refusals


def recorded(path):
    """The same of the record of a campaign that was opened before."""
    cases, refusals = [], []
    for number, line in enumerate(path.read_text().splitlines(), 1):
        try:
            x = json.loads(line)
            if "truth" in x:
                cases.append(Case(x["truth"], x["record"], x["oracle"]))
            else:
                refusals.append(tuple(x["refused"]))
        except (ValueError, KeyError, TypeError) as wrong:
            raise Wrong(f"{path}:{number}: not a line of a record: {type(wrong).__name__}: {wrong}")
    return cases, refusals


def score(o):
    cases, refusals, counted = [], [], set()
    for campaign in map(Path, o.campaigns):
        if campaign.is_file():
            more = recorded(campaign)
        elif any((campaign / "seals").glob("*.json")):
            more = opened(campaign, Path(o.vault or f"{campaign}.vault"), o.oracle)
        else:
            raise Wrong(f"{campaign}: neither a campaign with sealed sets nor the record of one (--record)")
        for case in more[0]:
            same = case.record["id"], case.record["data_sha256"]
            if same in counted:
                raise Wrong(f"{campaign}: set {case.record['id']} is in what was named before, too; name each campaign once")
            counted.add(same)
        cases += more[0]
        refusals += more[1]
    if o.record:
        write_once(Path(o.record), "".join(json.dumps(x, separators=(",", ":")) + "\n"
                                           for x in [c.line() for c in cases] + [dict(refused=r) for r in refusals]))
    sets = [c for c in cases if not c.followup]
    lines, numbers = table(sets, [c for c in cases if c.followup], refusals)
    print(f"{len(sets)} sealed sets, {len(refusals)} refused\n")
    print("\n".join(lines))
    if o.picture:
        picture(numbers, o.picture)
    if o.json:
        Path(o.json).write_text(json.dumps(dict(numbers, sets=len(sets), refused=refusals), indent=1) + "\n")


def at_least(least, kind):
    def number(text):
        value = kind(text)
        if not least <= value < 1e9:
            raise argparse.ArgumentTypeError(f"{text}: accepted are {least} and more")
        return value
    number.__name__ = kind.__name__
    return number


def main():
    a = argparse.ArgumentParser(prog="gap_blind", description="Sealed test of tendril gap diagnose on a foreign plant's data.")
    sub = a.add_subparsers(dest="what", required=True)
    m = sub.add_parser("make", help="draw, simulate and seal")
    m.add_argument("--campaign", required=True, help="folder of sets, seals and answers")
    m.add_argument("--vault", help="folder of the answers (default: CAMPAIGN.vault)")
    m.add_argument("--sets", type=at_least(1, int), required=True, help="of the whole campaign")
    m.add_argument("--families", type=int, default=5, choices=range(2, 8), help="kinds of excitation in a set")
    m.add_argument("--effects", metavar="LIST", type=lambda text: text.split(","),
                   help="draw those that the library has among these only, with commas between (default: all)")
    m.add_argument("--shard", default="1/1", help="i/n: this part of the sets")
    d = sub.add_parser("diagnose", help="run the diagnosis on what is sealed, once a set")
    d.add_argument("--campaign", required=True)
    d.add_argument("--vault", help="what the diagnosis must not read (default: CAMPAIGN.vault)")
    d.add_argument("--sets", type=at_least(1, int), help="only the first so many (default: all that are sealed)")
    d.add_argument("--shard", default="1/1", help="i/n: this part of the sets")
    d.add_argument("--tendril", default="tendril", help="the program (default: the one in PATH)")
    d.add_argument("--timeout", type=at_least(1, float), default=3600, help="seconds for one set")
    d.add_argument("command", nargs="*", help="another command after --, with {robot}, {set}, {out}")
    s = sub.add_parser("score", help="open the seals and count")
    s.add_argument("campaigns", nargs="+", help="folders, or records of campaigns opened before")
    s.add_argument("--vault", help="folder of the answers (default: CAMPAIGN.vault)")
    s.add_argument("--json", metavar="FILE", help="the table's numbers")
    s.add_argument("--picture", metavar="FILE", help="reliability diagram and detection curve (.png, .svg or .pdf)")
    s.add_argument("--record", metavar="FILE", help="also what the score is made of, a line a set; written once")
    s.add_argument("--oracle", metavar="TENDRIL", help="also let this program fit the effect that it is told, on every single")
    o = a.parse_args()
    dict(make=make, diagnose=diagnose, score=score)[o.what](o)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except Wrong as error:
        print(f"gap_blind: {error}", file=sys.stderr)
        sys.exit(2)
    except (RuntimeError, OSError, KeyError, ValueError) as error:
        print(f"gap_blind: {error}", file=sys.stderr)
        sys.exit(1)
    except ModuleNotFoundError as missing:
        which = "matplotlib (python3-matplotlib)" if missing.name == "matplotlib" else "those of tests/blind/requirements.txt"
        print(f"gap_blind: no Python package {missing.name}: install {which} and name the Python that has them, "
              "PYTHON=.../bin/python tools/gap_blind ...", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("gap_blind: stopped; what is done stays, and the same command goes on", file=sys.stderr)
        sys.exit(130)
