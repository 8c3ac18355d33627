# The figures of scored sets: rates with their intervals, calibration, detection, confusion, as lines and as numbers. Knows
# cases, not how they were kept or opened.
import math
import random
import statistics

from tools.shares import wilson

SEEN = 0.3  # sigma from which half of all effects shall be seen
UNSEEN = 0.03  # sigma, a third of the least that is drawn: the short runs that tell sizes missed the effect


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


class Figures:
    """Each figure adds its line and its numbers; they are printed in the order in which they are taken."""

    def __init__(self, cases, followups, refusals):
        self.lines, self.numbers = [], {}
        self.cases, self.followups, self.refusals = cases, followups, refusals
        self.answered = cases + followups
        self.known = [c for c in cases if c.kind in ("single", "parameter", "no_tracker")]
        self.strong = [c for c in self.known if c.sigma > 3]
        self.nulls = [c for c in cases if c.kind == "null"]
        self.nuisances = [c for c in cases if c.kind == "nuisance_null"]

    def row(self, name, k, n, goal):
        p, low, high = wilson(k, n)
        self.numbers[name] = dict(k=k, n=n, value=p, ci=[low, high], goal=goal)
        shown = f"{100 * p:5.1f} % [{100 * low:5.1f}, {100 * high:5.1f}]" if n else "no such sets"
        self.lines.append(f"| {name} | {k} of {n} | {shown} | {goal} |")

    def causes(self):
        strong = self.strong
        self.lines.append("| figure | count | value, Wilson 95 % | goal |\n|---|---|---|---|")
        self.row("top-1 cause at > 3 sigma, group-exact", sum(c.group_hit() for c in strong), len(strong), ">= 95 %")
        self.row("the same, effect's name alone", sum(bool(c.top) and (c.group_hit() or c.top["effect"] == c.wanted[0][0])
                                                     for c in strong), len(strong), "-")
        located = [c for c in strong if c.kind != "no_tracker" and c.cell == "motor_side"]
        self.row("correct first cut at > 3 sigma (motor-side cell)", sum(c.first_cut() == c.truth[0]["cut"] for c in located),
                 len(located), ">= 97 %")

    def false_alarms(self):
        nulls, nuisances = self.nulls, self.nuisances
        self.row("false alarms on exact nulls", sum(c.alarm() for c in nulls), len(nulls), "0 of 60")
        plants = sorted({c.opened.get("plant", "lagrange") for c in nulls})
        for plant in plants if len(plants) > 1 else ():
            of_plant = [c for c in nulls if c.opened.get("plant", "lagrange") == plant]
            self.row(f"those of the plant {plant}", sum(c.alarm() for c in of_plant), len(of_plant), "-")
        self.row("false alarms on nuisance nulls", sum(c.alarm() for c in nuisances), len(nuisances), "-")

    def unlisted(self):
        unlisted = [c for c in self.cases if c.kind == "unlisted" and c.sigma > 1]
        foreign = [c.unknown for c in unlisted if c.report]
        own = [c.unknown for c in self.known if c.sigma > 1 and c.report]
        area, span = auroc(foreign, own), resampled(auroc, foreign, own)
        self.numbers["unknown AUROC"] = dict(value=area, n=[len(foreign), len(own)], ci=span)
        self.lines.append(f"| unknown mechanism rejected, AUROC at > 1 sigma | {len(foreign)} against {len(own)} | "
                          f"{area:.3f} [{span[0]:.3f}, {span[1]:.3f}] | >= 0.95 |")
        self.row("unlisted at > 1 sigma never given a confident name", sum(not c.confident_wrong() for c in unlisted),
                 len(unlisted), "-")
        self.row("or only that of what it turns into where it changes little",
                 sum(not c.confident_wrong() or c.top["effect"] == c.truth[0].get("near") for c in unlisted), len(unlisted), "-")

    def confidence(self):
        answered = self.answered
        self.row("confidently wrong (p >= 0.9)", sum(c.confident_wrong() for c in answered), len(answered), "<= 1 %")
        self.row("any accepted cause that was not planted, at p >= 0.9", sum(c.confident_besides() for c in answered),
                 len(answered), "-")

    def reliability(self, name, none_below):
        """Of the first line: sets by tenths of p. An effect below `none_below` sigma counts as none; of one that the library
        does not have `unknown` is right, of a pair either."""
        judged = [c for c in self.cases if c.top and c.kind != "weak"]
        pairs = [(c.top["p"], first_line_right(c, none_below)) for c in judged]
        bins, ece, span = by_tenths(pairs), calibration_error(pairs), resampled(calibration_error, pairs)
        self.numbers[name] = dict(value=ece, n=len(judged), ci=span)
        self.lines.append(f"| {name} | {len(judged)} sets | {ece:.3f} [{span[0]:.3f}, {span[1]:.3f}] | "
                          f"{'<= 0.05' if none_below == 0 else '-'} |")
        self.numbers[f"reliability, none below {none_below:g} sigma"] = [
            [sum(p for p, _ in v) / len(v), sum(h for _, h in v), len(v)] for _, v in sorted(bins.items())]
        return bins

    def pairs(self):
        pairs = [c for c in self.cases if c.kind == "pair"]
        self.row("both of a pair", sum(both(c) for c in pairs), len(pairs), ">= 80 %")

    def closed(self, name, asked, most, goal):
        """Median over the sets in which there is something to close; what the answer closes nothing of counts as nothing."""
        ratios = [(pooled(c.report) or 0) / o for c in asked if (o := most(c) or 0) > 0.05]
        if ratios:
            mid, span = statistics.median(ratios), resampled(statistics.median, ratios)
            self.numbers[name] = dict(median=mid, n=len(ratios), asked=len(asked), ci=span)
            self.lines.append(f"| {name}, median | {len(ratios)} of {len(asked)} sets | {mid:.3f} "
                              f"[{span[0]:.3f}, {span[1]:.3f}] | {goal} |")

    def detection(self):
        seen = [c for c in self.known if c.kind != "no_tracker"]
        half, (low, high), curve, found = half_point(seen)
        self.numbers["half detection sigma"], self.numbers["half detection interval"] = half, [low, high]
        self.numbers["detection"] = dict(logistic=curve, found=found)
        unseen = [c for c in seen if c.sigma < UNSEEN]
        besides = f", without {len(unseen)} whose size the short runs do not show" if unseen else ""
        self.lines.append(f"| 50 % detection limit{besides} | {len(seen) - len(unseen)} sets | "
                          f"{half:.2f} sigma [{low:.2f}, {high:.2f}] | <= 0.3 sigma |")
        return found

    def sizes(self):
        reached = sorted(s["sigma"] / s["wanted_sigma"] for c in self.cases if c.kind != "nuisance_null" for s in c.opened["sizes"]
                         if s.get("wanted_sigma"))
        if reached:
            at = lambda share: reached[min(len(reached) - 1, int(share * len(reached)))]
            self.numbers["reached over drawn"] = [at(0), at(0.1), at(0.5), at(0.9), at(1)]
            self.lines.append("| size reached over size drawn (bounds, and what cannot be made so large): least, tenth, middle, "
                              f"ninetieth, most | {len(reached)} effects | "
                              f"{', '.join(f'{v:.2f}' for v in self.numbers['reached over drawn'])} | - |")

    def followed_up(self):
        shown = {c.id for c in self.cases if c.kind == "weak" and c.group_hit()}
        unresolved = [c for c in self.followups if c.id not in shown]
        self.row("follow-up finds the cause that weak excitation had not shown", sum(c.group_hit() for c in unresolved),
                 len(unresolved), ">= 90 %")
        self.row("diagnosis failed to answer", sum(c.report is None for c in self.answered), len(self.answered), "0")

    def baselines(self):
        names = {c["effect"] for case in self.cases for c in case.causes} - {"no_gap", "unknown"}
        self.lines.append("\nBaselines on the same singles at > 3 sigma: chance " +
                          (f"at most 1 of the {len(names)} effects that appear in the answers, {100 / len(names):.1f} %"
                           if names else "unknown"))
        chosen = [(c, {b["name"]: b for b in (c.report or {}).get("baselines", [])}) for c in self.strong]
        for b in sorted({name for _, by_name in chosen for name in by_name}):
            hit = [c.same(by_name[b], c.wanted[0]) for c, by_name in chosen if b in by_name]
            self.row(f"baseline {b}, names the true cause", sum(hit), len(hit), "-")

    def list_reliability(self, which, bins):
        self.lines.append(f"\nReliability of the first line, {which}: p, share right, sets")
        for b in sorted(bins):
            v = bins[b]
            self.lines.append(f"  {sum(p for p, _ in v) / len(v):.2f}  {sum(h for _, h in v) / len(v):.2f}  {len(v)}")

    def list_detection(self, found):
        self.lines.append("\nDetection: sigma from, to, found, of")
        self.lines += [f"  {a:g} {b:g}  {k} of {n}" for a, b, k, n in found]

    def confusion(self):
        self.lines.append("\nConfusion at > 3 sigma (truth -> top cause: sets)")
        confusion, matrix = {}, {}
        for c in self.cases:
            if c.kind != "pair" and (c.kind in ("null", "nuisance_null") or c.sigma > 1):
                planted = "nothing" if not c.wanted else "none of the library's" if c.kind == "unlisted" else c.wanted[0][0]
                row_of = matrix.setdefault(planted, {})
                row_of[answer_of(c)] = row_of.get(answer_of(c), 0) + 1
        self.numbers["confusion matrix, > 1 sigma"] = {a: dict(sorted(b.items())) for a, b in sorted(matrix.items())}
        for c in self.strong:
            got = f"{c.top['effect']} {c.top['where']}".strip() if c.top else c.verdict
            if not c.group_hit():
                key = (" ".join(c.wanted[0]), f"{got} [{c.verdict}]")
                confusion.setdefault(key, []).append(f"{c.id} ({c.sigma:.1f} sigma)")
        self.lines += [f"  {a} -> {b}: {', '.join(ids)}" for (a, b), ids in sorted(confusion.items())] or ["  none"]
        return [[a, b, ids] for (a, b), ids in sorted(confusion.items())]

    def not_found(self):
        self.lines.append(f"\nNot found, all above {SEEN:g} sigma: what was planted (largest) -> verdict, first line")
        for c in self.answered:
            found = (both(c) if c.kind == "pair" else c.verdict == "unexplained" if c.kind == "unlisted" else c.group_hit())
            if c.wanted and c.sigma > SEEN and not found:
                first = f"{c.top['effect']} {c.top['where']} {c.top['p']:.2f}".replace("  ", " ") if c.top else "-"
                self.lines.append(f"  {c.record['id']} {c.kind}: {' + '.join(' '.join(w) for w in c.wanted)} "
                                  f"({c.sigma:.2g} sigma) -> {c.verdict}, {first}")

    def mistakes(self):
        alarms = [f"{c.id} {c.kind} -> {c.top['effect'] if c.top else ''} [{c.verdict}]" for c in self.nulls + self.nuisances
                  if c.alarm()]
        self.lines.append("\nAlarms on nulls: " + (", ".join(alarms) or "none"))
        wrong = [f"{c.record['id']} {'+'.join(w for w, _ in c.wanted) or c.kind} ({c.sigma:.1f} sigma) -> {c.top['effect']} "
                 f"{c.top['p']:.3f}" for c in self.answered if c.confident_wrong()]
        self.lines.append("Confidently wrong: " + (", ".join(wrong) or "none"))

    def provenance(self):
        builds, kept = {}, {}
        for c in self.answered:
            builds.setdefault(" ".join([c.record["program_sha256"][:12], *map(str, c.build)]), []).append(c)
            how = c.record.get("vault") or {True: "confined", False: "not confined"}.get(c.record.get("confined"), "not known")
            kept[how] = kept.get(how, 0) + 1
        self.lines.append("Programs: " + ", ".join(f"{b} ({len(v)} answers)" for b, v in sorted(builds.items())))
        self.lines.append("Vault: " + ", ".join(f"{how} ({n} answers)" for how, n in sorted(kept.items())))
        self.lines.append("Refused: " + ("; ".join(f"{i}: {why}" for i, why in self.refusals) or "none"))


def first_line_right(c, none_below):
    if not c.wanted or c.sigma < none_below:
        return c.top["effect"] == "no_gap"
    if c.kind == "unlisted":
        return c.top["effect"] == "unknown"
    return any(c.same(c.top, w) for w in c.wanted)


def by_tenths(pairs):
    bins = {}
    for p, hit in pairs:
        bins.setdefault(min(9, int(p * 10)), []).append((p, hit))
    return bins


def calibration_error(pairs):
    off = sum(abs(sum(p for p, _ in v) - sum(h for _, h in v)) for v in by_tenths(pairs).values())
    return off / len(pairs) if pairs else math.nan


def both(c):
    named = (c.report or {}).get("accepted") or c.causes[:2]
    return all(any(c.same(a, w) for a in named) for w in c.wanted)


def pooled(report, key="pooled"):
    return (((report or {}).get("closed") or {}).get(key) or {}).get("value")


def answer_of(c):
    return ("diagnosis failed" if not c.report else "no gap" if not c.alarm() else "unexplained" if not c.names_causes()
            else c.wanted[0][0] if c.group_hit() else "no gap or a cause" if c.top["effect"] == "no_gap" else c.top["effect"])


def table(cases, followups, refusals):
    """Lines to print, and the same as numbers."""
    f = Figures(cases, followups, refusals)
    f.causes()
    f.false_alarms()
    f.unlisted()
    f.confidence()
    bins = f.reliability("calibration error of the first line, all but weak excitation", 0)
    bins_seen = f.reliability(f"the same, effects below {SEEN:g} sigma counted as none", SEEN)
    f.pairs()
    f.closed("gap closed over that of an oracle told the effect", [c for c in f.known if c.oracle], lambda c: pooled(c.oracle), ">= 0.97")
    f.closed("gap closed over what refitting every number closes", f.known, lambda c: pooled(c.report, "ceiling"), "-")
    found = f.detection()
    f.sizes()
    f.followed_up()
    f.baselines()
    f.list_reliability("every planted effect counts", bins)
    f.list_reliability(f"effects below {SEEN:g} sigma counted as none", bins_seen)
    f.list_detection(found)
    confusion = f.confusion()
    f.not_found()
    f.mistakes()
    f.provenance()
    f.numbers["confusion"] = confusion
    return f.lines, f.numbers


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
