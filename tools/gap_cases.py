"""The cases of tools/gap_table: which there are, how one is made and diagnosed, and where its result is kept.
Knows the program's options and report, not what a result is worth."""
import json
import os
import pathlib
import random
import shutil
import time

import workers
from workers import Wrong

PAIR_SIZES = (10, 5, 3)     # floors of the second effect of a pair; the first has the largest
NUMBERS_WRONG = 3           # in a robot whose numbers alone are wrong
FORMAT = 2                  # of the cases' files


# ---- which cases there are ----

def draw(effect, size, rng):
    """One effect at a place, with a parameter and a side of nominal where there is a choice."""
    places = effect["places"]
    alone = [p for p in places if p != "all"]
    where = rng.choice(alone) if alone and ("all" not in places or rng.random() < 0.5) else "all"
    parameter = rng.choice([p for p in effect["parameters"] if not p["shape"]])
    sides = [s for s, end in ((1, "upper"), (-1, "lower")) if parameter[end] != parameter["nominal"]]
    return {"effect": effect["effect"], "where": where, "vary": parameter["name"], "sigma": rng.choice(sides) * size,
            "both_sides": len(sides) == 2}


def cases_of(o, registry):
    """Every case, the same for the same options: its name, kind, seed and effects."""
    cases = []

    def add(name, kind, size, effects):
        cases.append({"name": name, "kind": kind, "size": size, "effects": effects, "set": o.set,
                      "seed": random.Random(f"{o.seed}/{name}/noise").getrandbits(40)})

    for effect in registry:
        if o.effects is None or effect["effect"] in o.effects:
            for size in o.sigma:
                name = f"{effect['effect']}_{size:g}"
                add(name, "single", size, [draw(effect, size, random.Random(f"{o.seed}/{name}"))])
        if o.left_out and (o.effects is None or effect["effect"] in o.effects):
            name = f"{effect['effect']}_left_out"
            add(name, "left_out", o.left_out, [draw(effect, o.left_out, random.Random(f"{o.seed}/{name}"))])
    for k in range(o.nulls):
        add(f"null_{k + 1:02}", "null", 0, [])
    numbers = [e for e in registry if e["controller_can_use_it"] and not e["nuisance"]]
    for k in range(o.numbers):
        rng = random.Random(f"{o.seed}/numbers/{k}")
        add(f"numbers_{k + 1:02}", "numbers", 3, [draw(e, 3, rng) for e in rng.sample(numbers, min(NUMBERS_WRONG, len(numbers)))])
    plain = [e for e in registry if not e["nuisance"]]
    for k in range(o.pairs):
        rng = random.Random(f"{o.seed}/pair/{k}")
        first, second = rng.sample(plain, 2)
        size = PAIR_SIZES[k % len(PAIR_SIZES)]
        add(f"pair_{k + 1:02}", "pair", size, [draw(first, PAIR_SIZES[0], rng), draw(second, size, rng)])
    return cases


# ---- one case, on a worker ----

def run_case(case, how):
    """Result of a case. how: tendril, robot, sets (folder), threads, timeout_s, keep; paths are absolute."""
    return Run(case, how).result()


class Run:
    def __init__(self, case, how):
        self.case, self.how, self.work = case, how, pathlib.Path(how["sets"]) / case["name"]
        self.truth = self.work / "truth.json"
        self.found = {"format": FORMAT, "case": case, "truth": None, "report": None, "trouble": "", "simulate_s": 0.0}

    def call(self, *words):
        """Exit code, the last line of what it said on the error stream, and the seconds it took."""
        start = time.monotonic()
        code, said = workers.run([self.how["tendril"], *words], self.how["timeout_s"])
        lines = [line for line in said.splitlines() if line.strip()]
        return code, lines[-1].strip() if lines else "", time.monotonic() - start

    def result(self):
        shutil.rmtree(self.work, ignore_errors=True)
        self.work.mkdir(parents=True)
        try:
            code, said = self.simulate()
            if code != 0:
                self.found["trouble"] = f"not made: {said}"
            else:
                self.diagnose()
        finally:
            if not self.how["keep"]:
                shutil.rmtree(self.work, ignore_errors=True)
        return self.found

    def simulate(self):
        """Exit code and what was said. A bound of the parameter before the size asked, or a robot that does not run so: the other
        side of nominal; where that reaches less, back again."""
        reached = {}
        for side in (1, -1, 1):
            if len(reached) == 2 and reached[1] <= reached[-1]:
                break
            code, said = self.simulate_on(side)
            sizes = [t["sigma"] for t in self.found["truth"] or [] if "sigma" in t]
            if code == 0 and not any(s["limited"] for s in sizes) or not any(e["both_sides"] for e in self.case["effects"]):
                break
            reached[side] = min((s["reached"] for s in sizes), default=0.0) if code == 0 else -1.0
        return code, said

    def simulate_on(self, side):
        planted = []
        for e in self.case["effects"]:
            sign = side if e["both_sides"] else 1
            planted += ["--effect", f"{e['effect']} where={e['where']} vary={e['vary']} sigma={sign * e['sigma']:g}"]
        self.truth.unlink(missing_ok=True)
        shutil.rmtree(self.work / "data", ignore_errors=True)
        code, said, seconds = self.call("gap", "simulate", "--robot", self.how["robot"], "--set", self.case["set"], "--seed",
                                        self.case["seed"], "--jobs", self.how["threads"], "--out", self.work / "data", "--truth",
                                        self.truth, *planted)
        self.found["simulate_s"] += seconds
        self.found["truth"] = json.loads(self.truth.read_text())["effects"] if self.truth.exists() else None
        return code, said

    def diagnose(self):
        left_out = self.case["effects"] if self.case["kind"] == "left_out" else []
        without = [word for e in left_out for word in ("--without", e["effect"])]
        code, said, self.found["diagnose_s"] = self.call(
            "gap", "diagnose", "--robot", self.how["robot"], self.work / "data", "--no-next", "--threads", self.how["threads"],
            "--out", self.work / "report", *without)
        if code != 0:
            self.found["trouble"] = f"not diagnosed: {said}"
            return
        report = json.loads((self.work / "report" / "report.json").read_text())
        self.found["report"] = worth_keeping(report)
        self.found["report"]["version"] = [report["provenance"][key] for key in ("version", "revision")]


def worth_keeping(report):
    """Of a report what the tables are made of; of causes those that have weight."""
    group = report["causes"][0]["group"] if report["causes"] else 0
    causes = [c for k, c in enumerate(report["causes"]) if k < 5 or c["p"] >= 1e-3 or (group and c["group"] == group)]
    plain = lambda c: {"effect": c["effect"], "where": c["where"], "p": c["p"], "group": c["group"],
                       "parameters": {name: {"value": v["value"]} for name, v in c.get("parameters", {}).items()}}
    pooled = (report["closed"] or {}).get("pooled")
    return {"verdict": report["verdict"], "leftover_sigma": report["leftover_sigma"], "causes": [plain(c) for c in causes],
            "accepted": [{key: c[key] for key in ("effect", "where", "p") if key in c} for c in report["accepted"]],
            "location": [f for f in report["location"] if f.get("first")],
            "closed": {"pooled": pooled} if pooled else {}, "degradations": report["degradations"]}


# ---- what is kept ----

def write_case(out, result):
    path = out / "cases" / f"{result['case']['name']}.json"
    path.with_suffix(".new").write_text(json.dumps(result, indent=1))
    os.replace(path.with_suffix(".new"), path)


def read_record(path):
    """Results by name."""
    lines = path.read_text().splitlines() if path and path.exists() else []
    results = {}
    for number, line in enumerate(lines, 1):
        try:
            r = json.loads(line)
            if not (isinstance(r["trouble"], str) and (r["truth"] is None or isinstance(r["truth"], list))):
                raise TypeError("trouble or truth")
            if r["report"] is not None:
                r["report"]["verdict"], r["report"]["version"], [(c["effect"], c["p"]) for c in r["report"]["causes"]]
            results[r["case"]["name"]] = r
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise Wrong(f"{path}:{number}: not a line of a record of this tool's making: {type(error).__name__}: {error}")
    return results


def write_record(path, results):
    new = path.with_name(path.name + ".new")
    new.write_text("".join(json.dumps(r, separators=(",", ":")) + "\n" for r in results))
    os.replace(new, path)


def read_case(o, case):
    """What was found in this case, or None when it is not there, was cut short, or is of another run's making."""
    try:
        result = json.loads((o.out / "cases" / f"{case['name']}.json").read_text())
    except (OSError, ValueError):
        result = {}
    for known in (result, o.recorded.get(case["name"], {})):
        if known.get("format") == FORMAT and known.get("case") == case:
            return known
    return None
