# The score of sealed campaigns: opens the seals, checks hashes and order, and counts. Knows nothing of plants.
import json
import math
import os
import random
import shutil
import stat
import statistics
import sys
from pathlib import Path

from tests.blind.seal import (HEAD, LEDGER, OPENED, NotRun, Wrong, diagnose_one, digest, end_of, enter, entered, listed, now,
                              parts_of, seal_of, seal_sha, sha, shard_ids, vault_of, write_once)
from tools.shares import wilson

SEEN = 0.3  # sigma from which half of all effects shall be seen
UNSEEN = 0.03  # sigma, a third of the least that is drawn: the short runs that tell sizes missed the effect
CONFIDENT = 0.9
VERDICTS = ("no_gap", "attributed", "ambiguous_group", "unexplained", "insufficient_data")
IN_RECORD = ("verdict", "causes", "location", "accepted", "closed", "baselines")


def need(holds, what):
    if not holds:
        raise ValueError(what)


def checked(truth, record):
    """ValueError that says what is wrong with a set's truth or with what was answered."""
    text, numbers = (lambda v: isinstance(v, str)), (lambda v: isinstance(v, (int, float)) and math.isfinite(v))
    all_of = lambda v, holds: isinstance(v, list) and all(isinstance(x, dict) and holds(x) for x in v)
    need(isinstance(truth, dict) and isinstance(record, dict), "truth or record is no object")
    need(text(truth.get("id")) and text(truth.get("robot")) and text(truth.get("load_cell")), "truth without id, robot or load_cell")
    need(text(truth.get("set_kind")), "truth without set_kind")
    need(all_of(truth.get("truth"), lambda t: text(t.get("effect")) and text(t.get("where")) and text(t.get("cut"))), "truth's effects")
    need(bool(truth["truth"]) == (truth["set_kind"] not in ("null", "nuisance_null")), "effects do not go with set_kind")
    need(all_of(truth.get("sizes"), lambda x: numbers(x.get("sigma")) and x["sigma"] >= 0), "truth's sizes")
    need(text(record.get("id")) and text(record.get("data_sha256")) and text(record.get("program_sha256")), "record without id or hashes")
    need(isinstance(record.get("started_ns"), int), "record without time")
    need(text(record.get("vault", "")) and text(record.get("seal_sha256", "")), "record's vault or seal_sha256")
    if record.get("report") is not None:
        check_report(record["report"])


def check_report(report):
    """ValueError that says what is wrong with a diagnosis's report."""
    text, numbers = (lambda v: isinstance(v, str)), (lambda v: isinstance(v, (int, float)) and math.isfinite(v))
    all_of = lambda v, holds: isinstance(v, list) and all(isinstance(x, dict) and holds(x) for x in v)
    cause = lambda c: text(c.get("effect")) and text(c.get("where"))
    need(isinstance(report, dict) and report.get("verdict") in VERDICTS, f"verdict; accepted are {', '.join(VERDICTS)}")
    need(all_of(report.get("causes"), lambda c: cause(c) and numbers(c.get("p")) and 0 <= c["p"] <= 1), "causes")
    need(bool(report["causes"]) or report["verdict"] not in ("attributed", "ambiguous_group"), "causes, of which there is none")
    need(all_of(report.get("location", []), lambda f: text(f.get("cut"))), "location")
    need(all_of(report.get("accepted", []), cause) and all_of(report.get("baselines", []), lambda b: cause(b) and text(b.get("name"))),
         "accepted or baselines")
    closed = report.get("closed") or {}
    check_closed(closed)


def check_closed(closed):
    share = lambda v: v is None or (isinstance(v, dict) and (v.get("value") is None or
                                                            (isinstance(v["value"], (int, float)) and math.isfinite(v["value"]))))
    need(isinstance(closed, dict) and all(share(closed.get(k)) for k in ("pooled", "ceiling")), "closed")


def refused(seal, answer_text, record, data=None):
    """Why a record does not count, or None."""
    if sha(answer_text.encode()) != seal["answer_sha256"]:
        return "the opened answer is not the sealed one"
    if record.get("seal_sha256", seal_sha(seal)) != seal_sha(seal):  # answers up to c15 do not name it
        return "its seal is not the one it was diagnosed under"
    wanted = seal["followup_sha256"] if record["id"].endswith("_followup") else seal["data_sha256"]
    if record["data_sha256"] != wanted or (data is not None and data.exists() and digest(data) != wanted):
        return "the data are not the sealed ones"
    if record["started_ns"] < seal["sealed_ns"]:
        return "the diagnosis is older than the seal"
    return None


class Case:
    """One scored set: truth beside diagnosis."""

    def __init__(self, truth, record, oracle=None, sealed=None):
        """sealed: the opened text and its seal, where they are known (ValueError where something is amiss)."""
        checked(truth, record)
        need(oracle is None or isinstance(oracle, dict), "oracle")
        check_closed((oracle or {}).get("closed") or {})
        self.opened, self.record, self.oracle, self.sealed = truth, record, oracle, sealed
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
            report["location"] = [f for f in report.get("location", []) if f.get("first")]
            report["causes"] = [{k: c[k] for k in ("effect", "where", "p", "group") if k in c} for k, c in enumerate(self.causes)
                                if k < 5 or c["p"] >= 0.001 or c["effect"] in ("unknown", "no_gap") or
                                (group and c.get("group") == group)]
            report["accepted"] = [{k: c[k] for k in ("effect", "where")} for c in report.get("accepted", [])]
            closed = report.get("closed") or {}
            report["closed"] = {k: {"value": closed[k].get("value")} for k in ("pooled", "ceiling") if closed.get(k)}
            report["build"] = self.build
        kept = ("id", "data_sha256", "program_sha256", "seal_sha256", "started_ns", "finished_ns", "confined", "vault")
        line = dict(record=dict({k: self.record[k] for k in kept if k in self.record}, report=report), oracle=self.oracle)
        if self.sealed:
            return dict(opened=self.sealed[0], seal=self.sealed[1], **line)
        return dict(truth={k: self.opened[k] for k in ("id", "truth", "set_kind", "sizes", "robot", "load_cell")}, **line)

    @property
    def top(self):
        return self.causes[0] if self.causes else None

    @staticmethod
    def same(cause, wanted):
        # one value for all is the same as the robot's, its sections' or all units'
        norm = lambda w: "all" if w in ("", "all", "section:1") else w
        return cause["effect"] == wanted[0] and norm(cause["where"]) == norm(wanted[1])

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

    def names_causes(self):
        return self.verdict in ("attributed", "ambiguous_group")

    def confident_wrong(self):
        """The first line is a cause that was not planted, and the answer is sure of it (or of its group)."""
        if not self.names_causes() or self.top["effect"] in ("no_gap", "unknown"):
            return False
        return self.top["p"] >= CONFIDENT and not self.group_hit() and not any(self.same(self.top, w) for w in self.wanted)

    def confident_besides(self):
        """Any accepted cause that was not planted, and the answer is sure of it."""
        accepted = (self.report or {}).get("accepted", [])
        return self.names_causes() and any(
            c["p"] >= CONFIDENT and any(self.same(c, (a["effect"], a["where"])) for a in accepted)
            and not any(self.same(c, w) for w in self.wanted) for c in self.causes)

    @property
    def build(self):
        """Version and revision, as far as the report (or what a record kept of it) says them."""
        report = self.report or {}
        made = report.get("provenance") or {}
        return [made[k] for k in ("version", "revision") if k in made] or report.get("build", [])

    def first_cut(self):
        return next((f["cut"] for f in self.report["location"] if f.get("first")), None) if self.report else None


def auroc(positive, negative):
    if not positive or not negative:
        return float("nan")
    wins = sum((a > b) + 0.5 * (a == b) for a in positive for b in negative)
    return wins / (len(positive) * len(negative))


def resampled(figure, *groups, times=400):
    """[low, high] of 95 % of a figure over groups of sets, each drawn again from itself."""
    draw = random.Random(4711)
    values = sorted(v for _ in range(times) if math.isfinite(v := figure(*[draw.choices(g, k=len(g)) for g in groups])))
    return [values[int(0.025 * len(values))], values[int(0.975 * len(values))]] if values else [math.nan, math.nan]


def logistic(points):
    """(a, b) of share = 1 / (1 + exp(-a - b log sigma)), by Newton's method; None where the points do not tell."""
    hits = sum(d for _, d in points)
    if len(points) < 8 or hits in (0, len(points)):
        return None
    w = [0.0, 1.0]
    for _ in range(30):
        g, h = [-1e-3 * w[0], -1e-3 * w[1]], [[1e-3, 0], [0, 1e-3]]
        for x, d in points:
            p = 1 / (1 + math.exp(-max(-30, min(30, w[0] + w[1] * x))))
            for a, xa in enumerate((1, x)):
                g[a] += (d - p) * xa
                for b, xb in enumerate((1, x)):
                    h[a][b] += p * (1 - p) * xa * xb
        det = h[0][0] * h[1][1] - h[0][1] * h[1][0]
        w = [w[0] + (g[0] * h[1][1] - g[1] * h[0][1]) / det, w[1] + (g[1] * h[0][0] - g[0] * h[1][0]) / det]
    return w if w[1] > 0 and abs(w[0] / w[1]) < 20 else None


def half_point(cases):
    """sigma of 50 % detection by a logistic curve over log sigma, its 95 % interval from resampled sets, the curve, and
    found and of by bins of sigma. Sets whose size the short runs do not show take no part."""
    points = [(math.log(c.sigma), c.alarm()) for c in cases if c.sigma >= UNSEEN]
    edges = [0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 12.8, 1e9]
    bins = []
    for a, b in zip(edges, edges[1:]):
        inside = [c.alarm() for c in cases if a <= c.sigma < b]
        if inside:
            bins.append((a, b, sum(inside), len(inside)))
    w = logistic(points)
    if w is None:
        return math.nan, (0.0, math.inf), None, bins
    draw = random.Random(4711)
    fits = [logistic(draw.choices(points, k=len(points))) for _ in range(200)]
    halves = sorted(math.exp(-f[0] / f[1]) if f else math.inf for f in fits)
    return math.exp(-w[0] / w[1]), (halves[5], halves[194]), w, bins


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
    plants = sorted({c.opened.get("plant", "lagrange") for c in nulls})
    for plant in plants if len(plants) > 1 else ():
        of_plant = [c for c in nulls if c.opened.get("plant", "lagrange") == plant]
        row(f"those of the plant {plant}", sum(c.alarm() for c in of_plant), len(of_plant), "-")
    nn = [c for c in cases if c.kind == "nuisance_null"]
    row("false alarms on nuisance nulls", sum(c.alarm() for c in nn), len(nn), "-")
    foreign = [c.unknown for c in cases if c.kind == "unlisted" and c.sigma > 1 and c.report]
    own = [c.unknown for c in known if c.sigma > 1 and c.report]
    area = auroc(foreign, own)
    span = resampled(auroc, foreign, own)
    numbers["unknown AUROC"] = dict(value=area, n=[len(foreign), len(own)], ci=span)
    lines.append(f"| unknown mechanism rejected, AUROC at > 1 sigma | {len(foreign)} against {len(own)} | "
                 f"{area:.3f} [{span[0]:.3f}, {span[1]:.3f}] | >= 0.95 |")
    unl = [c for c in cases if c.kind == "unlisted" and c.sigma > 1]
    row("unlisted at > 1 sigma never given a confident name", sum(not c.confident_wrong() for c in unl), len(unl), "-")
    row("or only that of what it turns into where it changes little",
        sum(not c.confident_wrong() or c.top["effect"] == c.truth[0].get("near") for c in unl), len(unl), "-")
    answered = cases + followups
    row("confidently wrong (p >= 0.9)", sum(c.confident_wrong() for c in answered), len(answered), "<= 1 %")
    row("any accepted cause that was not planted, at p >= 0.9", sum(c.confident_besides() for c in answered), len(answered), "-")
    judged = [c for c in cases if c.top and c.kind != "weak"]

    def reliability(name, none_below):
        """Of the first line: sets by tenths of p. An effect below `none_below` sigma counts as none; of one that the library
        does not have `unknown` is right, of a pair either."""
        pairs = []
        for c in judged:
            if not c.wanted or c.sigma < none_below:
                hit = c.top["effect"] == "no_gap"
            elif c.kind == "unlisted":
                hit = c.top["effect"] == "unknown"
            else:
                hit = any(c.same(c.top, w) for w in c.wanted)
            pairs.append((c.top["p"], hit))

        def by_tenths(of):
            bins = {}
            for p, hit in of:
                bins.setdefault(min(9, int(p * 10)), []).append((p, hit))
            return bins

        def error(of):
            off = sum(abs(sum(p for p, _ in v) - sum(h for _, h in v)) for v in by_tenths(of).values())
            return off / len(of) if of else math.nan
        bins, ece, span = by_tenths(pairs), error(pairs), resampled(error, pairs)
        numbers[name] = dict(value=ece, n=len(judged), ci=span)
        lines.append(f"| {name} | {len(judged)} sets | {ece:.3f} [{span[0]:.3f}, {span[1]:.3f}] | "
                     f"{'<= 0.05' if none_below == 0 else '-'} |")
        numbers[f"reliability, none below {none_below:g} sigma"] = [
            [sum(p for p, _ in v) / len(v), sum(h for _, h in v), len(v)] for _, v in sorted(bins.items())]
        return bins
    bins = reliability("calibration error of the first line, all but weak excitation", 0)
    bins_seen = reliability(f"the same, effects below {SEEN:g} sigma counted as none", SEEN)
    pairs = [c for c in cases if c.kind == "pair"]

    def both(c):
        named = (c.report or {}).get("accepted") or c.causes[:2]
        return all(any(c.same(a, w) for a in named) for w in c.wanted)
    row("both of a pair", sum(both(c) for c in pairs), len(pairs), ">= 80 %")

    def pooled(report, key="pooled"):
        return (((report or {}).get("closed") or {}).get(key) or {}).get("value")

    def middle(name, asked, most, goal):
        """Median over the sets in which there is something to close; what the answer closes nothing of counts as nothing."""
        ratios = [(pooled(c.report) or 0) / o for c in asked if (o := most(c) or 0) > 0.05]
        if ratios:
            mid, span = statistics.median(ratios), resampled(statistics.median, ratios)
            numbers[name] = dict(median=mid, n=len(ratios), asked=len(asked), ci=span)
            lines.append(f"| {name}, median | {len(ratios)} of {len(asked)} sets | {mid:.3f} [{span[0]:.3f}, {span[1]:.3f}] | {goal} |")
    middle("gap closed over that of an oracle told the effect", [c for c in known if c.oracle], lambda c: pooled(c.oracle), ">= 0.97")
    middle("gap closed over what refitting every number closes", known,
           lambda c: pooled(c.report, "ceiling"), "-")
    seen = [c for c in known if c.kind != "no_tracker"]
    half, (low, high), curve, found = half_point(seen)
    numbers["half detection sigma"], numbers["half detection interval"] = half, [low, high]
    numbers["detection"] = dict(logistic=curve, found=found)
    unseen = [c for c in seen if c.sigma < UNSEEN]
    lines.append(f"| 50 % detection limit{f', without {len(unseen)} whose size the short runs do not show' if unseen else ''} | "
                 f"{len(seen) - len(unseen)} sets | {half:.2f} sigma [{low:.2f}, {high:.2f}] | <= 0.3 sigma |")
    reached = sorted(s["sigma"] / s["wanted_sigma"] for c in cases if c.kind != "nuisance_null" for s in c.opened["sizes"]
                     if s.get("wanted_sigma"))
    if reached:
        at = lambda share: reached[min(len(reached) - 1, int(share * len(reached)))]
        numbers["reached over drawn"] = [at(0), at(0.1), at(0.5), at(0.9), at(1)]
        lines.append(f"| size reached over size drawn (bounds, and what cannot be made so large): least, tenth, middle, ninetieth, most | "
                     f"{len(reached)} effects | {', '.join(f'{v:.2f}' for v in numbers['reached over drawn'])} | - |")
    shown = {c.id for c in cases if c.kind == "weak" and c.group_hit()}
    unresolved = [c for c in followups if c.id not in shown]
    row("follow-up finds the cause that weak excitation had not shown", sum(c.group_hit() for c in unresolved),
        len(unresolved), ">= 90 %")
    row("diagnosis failed to answer", sum(c.report is None for c in answered), len(answered), "0")
    names = {c["effect"] for case in cases for c in case.causes} - {"no_gap", "unknown"}
    lines.append("\nBaselines on the same singles at > 3 sigma: chance " +
                 (f"at most 1 of the {len(names)} effects that appear in the answers, {100 / len(names):.1f} %" if names else "unknown"))
    chosen = [(c, {b["name"]: b for b in (c.report or {}).get("baselines", [])}) for c in strong]
    for b in sorted({name for _, by_name in chosen for name in by_name}):
        hit = [c.same(by_name[b], c.wanted[0]) for c, by_name in chosen if b in by_name]
        row(f"baseline {b}, names the true cause", sum(hit), len(hit), "-")
    for which, shown in (("every planted effect counts", bins), (f"effects below {SEEN:g} sigma counted as none", bins_seen)):
        lines.append(f"\nReliability of the first line, {which}: p, share right, sets")
        for b in sorted(shown):
            v = shown[b]
            lines.append(f"  {sum(p for p, _ in v) / len(v):.2f}  {sum(h for _, h in v) / len(v):.2f}  {len(v)}")
    lines.append("\nDetection: sigma from, to, found, of")
    lines += [f"  {a:g} {b:g}  {k} of {n}" for a, b, k, n in found]
    lines.append("\nConfusion at > 3 sigma (truth -> top cause: sets)")
    confusion, matrix = {}, {}
    for c in cases:
        if c.kind != "pair" and (c.kind in ("null", "nuisance_null") or c.sigma > 1):
            planted = "nothing" if not c.wanted else "none of the library's" if c.kind == "unlisted" else c.wanted[0][0]
            named = ("diagnosis failed" if not c.report else "no gap" if not c.alarm() else "unexplained" if not c.names_causes()
                     else c.wanted[0][0] if c.group_hit() else "no gap or a cause" if c.top["effect"] == "no_gap" else c.top["effect"])
            row_of = matrix.setdefault(planted, {})
            row_of[named] = row_of.get(named, 0) + 1
    numbers["confusion matrix, > 1 sigma"] = {a: dict(sorted(b.items())) for a, b in sorted(matrix.items())}
    for c in strong:
        got = f"{c.top['effect']} {c.top['where']}".strip() if c.top else c.verdict
        if not c.group_hit():
            key = (" ".join(c.wanted[0]), f"{got} [{c.verdict}]")
            confusion.setdefault(key, []).append(f"{c.id} ({c.sigma:.1f} sigma)")
    lines += [f"  {a} -> {b}: {', '.join(ids)}" for (a, b), ids in sorted(confusion.items())] or ["  none"]
    lines.append(f"\nNot found, all above {SEEN:g} sigma: what was planted (largest) -> verdict, first line")
    for c in answered:
        found = (both(c) if c.kind == "pair" else c.verdict == "unexplained" if c.kind == "unlisted" else c.group_hit())
        if c.wanted and c.sigma > SEEN and not found:
            first = f"{c.top['effect']} {c.top['where']} {c.top['p']:.2f}".replace("  ", " ") if c.top else "-"
            lines.append(f"  {c.record['id']} {c.kind}: {' + '.join(' '.join(w) for w in c.wanted)} ({c.sigma:.2g} sigma) -> "
                         f"{c.verdict}, {first}")
    alarms = [f"{c.id} {c.kind} -> {c.top['effect'] if c.top else ''} [{c.verdict}]" for c in nulls + nn
              if c.alarm()]
    lines.append("\nAlarms on nulls: " + (", ".join(alarms) or "none"))
    wrong = [f"{c.record['id']} {'+'.join(w for w, _ in c.wanted) or c.kind} ({c.sigma:.1f} sigma) -> {c.top['effect']} "
             f"{c.top['p']:.3f}" for c in answered if c.confident_wrong()]
    lines.append("Confidently wrong: " + (", ".join(wrong) or "none"))
    builds = {}
    for c in answered:
        builds.setdefault(" ".join([c.record["program_sha256"][:12], *map(str, c.build)]), []).append(c)
    lines.append("Programs: " + ", ".join(f"{b} ({len(v)} answers)" for b, v in sorted(builds.items())))
    kept = {}
    for c in answered:
        how = c.record.get("vault") or {True: "confined", False: "not confined"}.get(c.record.get("confined"), "not known")
        kept[how] = kept.get(how, 0) + 1
    lines.append("Vault: " + ", ".join(f"{how} ({n} answers)" for how, n in sorted(kept.items())))
    lines.append("Refused: " + ("; ".join(f"{i}: {why}" for i, why in refusals) or "none"))
    numbers["confusion"] = [[a, b, ids] for (a, b), ids in sorted(confusion.items())]
    return lines, numbers


def picture(numbers, path):
    """Reliability diagram, detection curve and confusion matrix."""
    from matplotlib.figure import Figure
    matrix = numbers["confusion matrix, > 1 sigma"]
    besides = ("no gap", "no gap or a cause", "unexplained", "diagnosis failed")
    named = sorted({n for row in matrix.values() for n in row} - {*besides}) + [n for n in besides if any(n in r for r in matrix.values())]
    planted = [n for n in named if n in matrix] + [n for n in matrix if n not in named]
    tall = 0.2 * len(planted) + 2
    figure = Figure(figsize=(max(10, 0.2 * len(named) + 3), 4.4 + tall), layout="constrained")
    top, bottom = figure.subfigures(2, 1, height_ratios=[4.4, tall])
    left, right = top.subplots(1, 2)
    below = bottom.subplots()
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
    for y, truth in enumerate(planted):
        for n, count in matrix[truth].items():
            right_so = n == truth or (truth, n) in (("nothing", "no gap"), ("none of the library's", "unexplained"))
            below.text(named.index(n), y, count, ha="center", va="center", fontsize=7, color="white",
                       bbox=dict(boxstyle="square,pad=0.25", color=blue if right_so else orange, lw=0))
    below.set(xlim=(-0.5, len(named) - 0.5), ylim=(len(planted) - 0.5, -0.5), xticks=range(len(named)), yticks=range(len(planted)),
              title="What was planted (rows; one cause above 1 sigma, or nothing) and what was answered: sets")
    below.set_xticklabels(named, rotation=90, fontsize=7)
    below.set_yticklabels(planted, fontsize=7)
    below.grid(alpha=0.25)
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
        try:
            report, facts = diagnose_one(command, data, [], 3600)
            trouble = facts["error"].strip()[-200:]
        except NotRun as wrong:
            report, trouble = None, wrong
        if report is None:  # not kept: the next time it is tried again
            print(f"oracle, {case.id}: {trouble}", file=sys.stderr, flush=True)
            return None
        write_once(kept, json.dumps({"closed": report["closed"]}) + "\n")
    return json.loads(kept.read_text())


def opened(folder, vault, oracle):
    """A campaign's cases, what is refused, its parts, and what else is to be said of it: (cases, [(name, why)],
    [(part, of how many, sets of the whole)], [note])."""
    cases, refusals, notes = [], [], []
    if not vault.is_dir():
        raise Wrong(f"{vault}: the answers of {folder} are not there; name their folder with --vault")
    sealed = sorted(p.stem for p in (folder / "seals").glob("*.json"))
    entries = entered(vault / LEDGER, folder / HEAD)
    given, begun, seals = {}, {}, {}  # by name: hashes of answers, how often it was begun, hashes of its seal
    was_opened, late = False, []
    for entry in entries or ():
        name = entry["name"]
        if name == OPENED:
            was_opened = True
            continue
        late += [name] * (was_opened and entry["sha256"] != "")
        given.setdefault(name, []).extend(filter(None, [entry["sha256"]]))
        begun[name] = begun.get(name, 0) + ("begun_ns" in entry)
        seals.setdefault(name, set()).update(filter(None, [entry["seal_sha256"]]))
    parts = parts_of(vault)
    drawn = {f"{k:04d}" for part, whole, count in parts for k in shard_ids(count, f"{part}/{whole}")}
    gone = ({p.stem for p in vault.glob("*.json")} | {name.removesuffix("_followup") for name in given}) - set(sealed)
    refusals += [(name, "its seal is gone") for name in sorted(gone)]
    refusals += [(name, "drawn, not made") for name in sorted(drawn - set(sealed) - gone)]
    if entries is None:
        notes.append("its ledger of answers is " + ("gone" if (folder / HEAD).exists() else "not there (nor is it where the vault was away "
                     "from the diagnosis)") + ", so that nobody knows whether a set was answered twice")
    else:
        enter(vault / LEDGER, folder / HEAD, OPENED, opened_ns=now())  # before any is: what is answered from now on shows
        notes.append(f"ledger of answers: {end_of(vault / LEDGER)}")
    if late:
        notes.append(f"{len(late)} answered after seals had been opened: {listed(late)}")
    dataless, unlisted, unbound = [], [], 0
    for name in sealed:
        try:
            seal = seal_of(folder, name)
        except ValueError as wrong:
            refusals.append((name, str(wrong)))
            continue
        try:
            text = (vault / f"{name}.json").read_text()
            truth = json.loads(text)
            for which in [name] + [f"{name}_followup"] * ("followup_sha256" in seal):
                path, data = folder / "answers" / f"{which}.json", folder / "sets" / which
                if not data.exists():
                    dataless.append(which)
                if not path.exists():
                    times = begun.get(which, 0)
                    refusals.append((which, f"begun {times} times, not answered" if times > 1 else "begun, not answered" if times else
                                     "not diagnosed"))
                    continue
                try:
                    answer = path.read_text()
                    record = json.loads(answer)
                    case = Case(truth, record, sealed=(text, seal))
                    need(record["id"] == which, "another set's answer")
                except (ValueError, OSError, KeyError, TypeError, OverflowError, RecursionError) as wrong:
                    refusals.append((which, f"its answer: {wrong}"))
                    continue
                why = refused(seal, text, record, data)
                if os.stat(path).st_mode & stat.S_IWUSR:
                    why = why or "the answer's file can be rewritten"
                if entries is not None:
                    written = given.get(which, [])
                    if len(written) > 1:
                        why = why or f"answered {len(written)} times"
                    elif not written:
                        unlisted.append(which)
                        why = why or "not in the ledger of answers"
                    elif written != [sha(answer.encode())]:
                        why = why or "not the answer that was given"
                    if seals.get(which, set()) - {seal_sha(seal)}:
                        why = why or "its seal is not the one it was diagnosed under"
                if why:
                    refusals.append((which, why))
                    continue
                unbound += "seal_sha256" not in record
                if oracle and not case.followup:
                    case.oracle = told(oracle, case, data.resolve())
                cases.append(case)
        except FileNotFoundError as wrong:
            refusals.append((name, f"{Path(wrong.filename).name} is not in the vault (--vault)"))
        except (ValueError, KeyError, OSError, TypeError, OverflowError, RecursionError) as wrong:
            refusals.append((name, f"{name}.json in the vault, or its data: {type(wrong).__name__}: "
                                   f"{getattr(wrong, 'strerror', None) or wrong}; put them back from a copy"))
    twice = [f"{name} ({times} times)" for name, times in sorted(begun.items()) if times > 1]
    if twice:
        notes.append(f"begun more than once, as what was stopped may be: {listed(twice)}")
    if unbound:
        notes.append(f"{unbound} answers not bound to their seals: they do not say under which they were given (up to c15 none does)")
    if dataless:
        notes.append(f"the data of {len(dataless)} are gone, and were not compared with the seals: {listed(dataless)}")
    if gone or unlisted:
        notes.append(f"{len(gone)} in the vault or its ledger without a seal here, {len(unlisted)} answers not in the ledger: where two "
                     "vaults were copied into one, take them apart and name both campaigns, score CAMPAIGN1 CAMPAIGN2")
    return cases, refusals, parts, notes


def recorded(path):
    """The same of the record of a campaign that was opened before."""
    cases, refusals, parts, notes, head = [], [], [], [], None
    try:
        lines = path.read_text().splitlines()
    except (OSError, ValueError) as wrong:
        raise Wrong(f"{path}: {wrong}")
    for number, line in enumerate(lines, 1):
        try:
            x = json.loads(line)
            need(isinstance(x, dict), "no object")
            if number == 1 and "lines" in x:
                head, parts = x, [tuple(part) for part in x["parts"]]
                need(isinstance(x["sha256"], str) and all(len(p) == 3 and all(isinstance(n, int) for n in p) for p in parts), "first line")
                continue
            if "refused" in x:
                need(isinstance(x["refused"], list) and len(x["refused"]) == 2, "refused takes a set and a reason")
                refusals.append(tuple(map(str, x["refused"])))
                continue
            if "note" in x:
                notes.append(str(x["note"]))
                continue
            truth = json.loads(x["opened"]) if "opened" in x else x["truth"]
            case = Case(truth, x["record"], x["oracle"], (x["opened"], x["seal"]) if "opened" in x else None)
            why = refused(x["seal"], x["opened"], x["record"]) if case.sealed else None
            if why:
                refusals.append((x["record"]["id"], why))
            else:
                cases.append(case)
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as wrong:
            raise Wrong(f"{path}:{number}: not a line of a record: {type(wrong).__name__}: {wrong}; "
                        "take the record as score --record wrote it")
    if lines and not head:
        notes.append(f"{path}: without the first line that tells how many follow (records of before it was written have none): that "
                     "lines were lost or changed would not be seen")
    if not cases and not refusals:
        raise Wrong(f"{path}: neither a campaign with sealed sets nor the record of one (it is empty)")
    if head and (len(lines) - 1 != head["lines"] or sha("\n".join(lines[1:]).encode()) != head["sha256"]):
        raise Wrong(f"{path}: its first line is of other lines ({head['lines']}, there are {len(lines) - 1}): "
                    "take the record as score --record wrote it")
    return cases, refusals, parts, notes


def head_of(lines, parts):
    """First line of a record: what shows that none of the others was lost or changed by accident."""
    return json.dumps(dict(lines=len(lines), sha256=sha("\n".join(lines).encode()), parts=parts), separators=(",", ":"))


def score(o):
    cases, refusals, parts, notes, counted = [], [], [], [], set()
    if o.record and Path(o.record).exists():
        raise Wrong(f"--record {o.record}: is there already, and written once; give another name")
    if o.oracle and not shutil.which(o.oracle):
        raise Wrong(f"--oracle {o.oracle}: no such program")
    for output in (o.json, o.record, o.picture):
        if output and not Path(output).absolute().parent.is_dir():
            raise Wrong(f"{output}: no folder {Path(output).absolute().parent}")
        if output and Path(output).is_dir():
            raise Wrong(f"{output}: a folder; name a file in it")
    if o.picture and Path(o.picture).suffix not in (".png", ".svg", ".pdf"):
        raise Wrong(f"--picture {o.picture}: accepted are names in .png, .svg and .pdf")
    if o.picture:
        import matplotlib.figure  # noqa: F401  (where it is missing, that is told before anything is written)
    for campaign in map(Path, o.campaigns):
        if campaign.is_file():
            if o.oracle:
                raise Wrong(f"--oracle needs the sets, which {campaign} has not: name the campaign's folder")
            more = recorded(campaign)
        elif any((campaign / "seals").glob("*.json")):
            more = opened(campaign, vault_of(campaign, o.vault), o.oracle)
        else:
            raise Wrong(f"{campaign}: neither a campaign with sealed sets nor the record of one (--record)")
        for case in more[0]:
            same = case.record["id"], case.record["data_sha256"]
            if same in counted:
                raise Wrong(f"{campaign}: set {case.record['id']} is in it or in what was named before already; each counts once")
            counted.add(same)
        cases += more[0]
        refusals += more[1]
        parts += more[2]
        notes += [(campaign, note) for note in more[3]]
    sets = [c for c in cases if not c.followup]
    lines, numbers = table(sets, [c for c in cases if c.followup], refusals)
    # What is to last comes before what is printed, which nobody may be there to read.
    if o.json:
        finite = lambda v: ({k: finite(x) for k, x in v.items()} if isinstance(v, dict) else [finite(x) for x in v]
                            if isinstance(v, (list, tuple)) else None if isinstance(v, float) and not math.isfinite(v) else v)
        Path(o.json).write_text(json.dumps(finite(dict(numbers, sets=len(sets), refused=refusals, notes=[n for _, n in notes])), indent=1)
                                + "\n")
    if o.picture:
        picture(numbers, o.picture)
    if o.record:
        written = [json.dumps(x, separators=(",", ":")) for x in [c.line() for c in cases] + [dict(refused=r) for r in refusals] +
                   [dict(note=n) for _, n in notes]]
        write_once(Path(o.record), "\n".join([head_of(written, sorted(parts)), *written]) + "\n")
    bare = sorted(c.id for c in sets if not c.sealed)
    print(f"{len(sets)} sealed sets, {len(refusals)} refused")
    if bare:
        print(f"Of {len(bare)} the record holds no seal, so that none was checked: {listed(bare)}")
    for whole, count in sorted({part[1:] for part in parts}):
        there = sorted(part[0] for part in parts if part[1:] == (whole, count))
        print(f"Parts of {count} sets: {', '.join(map(str, there))} of {whole}")
    for campaign, note in notes:
        print(f"{campaign}: {note}")
    print()
    print("\n".join(lines))
