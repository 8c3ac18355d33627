"""What the results of tools/gap_table are worth: each against its truth, and the tables, figures and the picture of all.
Knows cases and reports, not how they came about."""
import csv
import json
import statistics
import sys

from shares import wilson

FOUND = ("attributed", "ambiguous_group")
GAP = FOUND + ("unexplained",)
TOO_SMALL = 0.5  # sigma: what a bound lets an effect reach, and nobody needs to see


# ---- one case ----

def norm(where):
    return "all" if where in ("", "section:1") else where


class Scored:
    """One case's result against its truth."""

    def __init__(self, result, registry):
        self.case, self.trouble = result["case"], result["trouble"]
        self.name, self.kind, self.size = (self.case[key] for key in ("name", "kind", "size"))
        self.wanted = result["truth"] or self.case["effects"]
        self.report = result["report"]
        r = self.report or {}
        self.verdict = r.get("verdict", "failed")
        self.causes, self.accepted = r.get("causes", []), r.get("accepted", [])
        self.seconds = result.get("diagnose_s")
        self.top = self.causes[0] if self.causes else None
        self.by_name = registry
        sizes = [t["sigma"] for t in result["truth"] or [] if "sigma" in t]
        self.reached = min((s["reached"] for s in sizes), default=0.0)
        self.limited = any(s["limited"] for s in sizes)
        first = [f for f in r.get("location", []) if f.get("first")]
        self.cut = first[0]["cut"] if first else ""
        self.wanted_cut = min((registry[t["effect"]]["first_cut"] for t in self.wanted), default="")

    @staticmethod
    def same(cause, truth):
        return cause["effect"] == truth["effect"] and norm(cause["where"]) == norm(truth["where"])

    def named(self, truth):
        """The verdict names this effect, by itself or as one of a group that cannot be told apart."""
        if self.verdict not in FOUND:
            return False
        if any(self.same(a, truth) for a in self.accepted):
            return True
        groups = {c["group"] for c in self.causes if c["group"] > 0 and any(
            a["effect"] == c["effect"] and norm(a["where"]) == norm(c["where"]) for a in self.accepted)}
        return self.verdict == "ambiguous_group" and any(c["group"] in groups and self.same(c, truth) for c in self.causes)

    @property
    def exact(self):
        """The first cause is the true one, or one of the group that the verdict names with the true one in it."""
        if self.verdict not in FOUND or not self.top or not self.wanted:
            return False
        if self.same(self.top, self.wanted[0]):
            return True
        return self.verdict == "ambiguous_group" and self.top["group"] > 0 and any(
            c["group"] == self.top["group"] and self.same(c, self.wanted[0]) for c in self.causes)

    @property
    def beside(self):
        """Effects that are named and are not there."""
        if self.verdict != "attributed":
            return []
        return [c["effect"] for c in self.accepted if not any(self.same(c, t) for t in self.wanted)]

    def looks_like_it(self, cause):
        """Either of the two effects says that it looks like the other."""
        truth = self.wanted[0]["effect"]
        return cause["effect"] in self.by_name[truth]["confusable"] or truth in self.by_name.get(cause["effect"], {}).get("confusable", ())

    @property
    def sure_of_another(self):
        """Causes that are accepted at 0.9 and more, alone or in a group, and do not look like the one that was left out."""
        return [c["effect"] for c in self.accepted if self.verdict in FOUND and c.get("p", 0) >= 0.9 and not self.looks_like_it(c)]

    @property
    def confidently_wrong(self):
        return bool(self.verdict == "attributed" and self.top and self.top["p"] >= 0.9 and
                    not any(self.same(self.top, t) for t in self.wanted))

    @property
    def parameter_error(self):
        """|found - true| over the true deviation from nominal, of the parameter that was varied."""
        if self.verdict not in FOUND or not self.wanted or "parameters" not in self.wanted[0]:
            return None
        truth, vary = self.wanted[0], self.case["effects"][0]["vary"]
        nominal = next(p["nominal"] for p in self.by_name[truth["effect"]]["parameters"] if p["name"] == vary)
        for cause in self.causes:
            if self.same(cause, truth) and vary in cause.get("parameters", {}):
                true = truth["parameters"][vary]
                return abs(cause["parameters"][vary]["value"] - true) / abs(true - nominal) if true != nominal else None
        return None

    @property
    def closed(self):
        pooled = ((self.report or {}).get("closed") or {}).get("pooled")
        return (pooled["value"], *pooled["ci"]) if pooled and pooled.get("value") is not None else None

    @property
    def outcome(self):
        if self.trouble:
            return "failed"
        if self.kind == "null":
            return "false alarm" if self.verdict in GAP else "right"
        if self.kind == "numbers":
            if self.verdict in FOUND and any(not self.by_name[c["effect"]]["controller_can_use_it"] for c in self.accepted):
                return "a law accused"
            return "right" if self.verdict in GAP else "not seen"
        if self.kind == "pair":
            found = sum(self.named(t) for t in self.wanted)
            return ("none found", "one found", "right")[found]
        if self.kind == "left_out":
            if self.verdict in FOUND:
                return "what looks like it" if self.looks_like_it(self.top) and not self.sure_of_another else "another named"
            return "right" if self.verdict == "unexplained" else "not seen"
        if self.exact:
            return "right" if self.same(self.top, self.wanted[0]) else "in its group"
        if self.verdict in FOUND:
            return "another named"
        if self.verdict not in GAP and self.limited and self.reached < TOO_SMALL:
            return "too small"
        return "unexplained" if self.verdict == "unexplained" else "not seen"


# ---- the tables ----

def text_of(effects):
    out = []
    for e in effects:
        values = e.get("parameters") or {}
        size = f" ({e['sigma']['reached']:.2g})" if isinstance(e.get("sigma"), dict) else ""
        out.append(f"{e['effect']}{'' if e['where'] == 'all' else ' ' + e['where']}" +
                   "".join(f" {k}={v:g}" for k, v in values.items()) + size)
    return " + ".join(out)


def cause_text(cause):
    if cause is None:
        return ""
    return f"{cause['effect']}{'' if norm(cause['where']) == 'all' else ' ' + cause['where']} {cause['p']:.2f}"


COLUMNS = ("case", "kind", "effect", "where", "parameter", "value", "asked_sigma", "reached_sigma", "channel", "first_cut",
           "right_cut", "verdict", "first_cause", "first_where", "p", "group_exact", "outcome", "parameter_error", "closed",
           "closed_low", "closed_high", "accepted", "seconds", "trouble")


def write_csv(path, scored):
    with open(path, "w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(COLUMNS)
        blank = lambda v: "" if v is None else f"{v:.4g}" if isinstance(v, float) else v
        for s in scored:
            planted = s.case["effects"]
            values = [t.get("parameters", {}).get(e["vary"]) for t, e in zip(s.wanted, planted)]
            sigma = [t["sigma"] for t in s.wanted if isinstance(t.get("sigma"), dict)]
            join = lambda items: " + ".join(str(blank(i)) for i in items)
            rows.writerow([blank(v) for v in (
                s.name, s.kind, join(e["effect"] for e in planted), join(e["where"] for e in planted),
                join(e["vary"] for e in planted), join(values), join(e["sigma"] for e in planted),
                join(float(g["reached"]) for g in sigma), join(g["channel"] for g in sigma), s.cut,
                int(s.cut == s.wanted_cut) if s.kind == "single" and s.report else "", s.verdict,
                s.top["effect"] if s.top else "", s.top["where"] if s.top else "", s.top["p"] if s.top else None,
                int(s.exact) if s.kind == "single" and s.report else "", s.outcome, s.parameter_error,
                *(s.closed or (None, None, None)), "; ".join(cause_text(c) for c in s.accepted), s.seconds, s.trouble)])


def summary(o, scored):
    """Lines (text, count, of, value, interval) and the same as numbers."""
    lines, numbers = [], {}

    def share(name, hits, of):
        p, low, high = wilson(hits, of)
        numbers[name] = {"k": hits, "n": of, "value": p if of else None, "ci": [low, high] if of else None}
        lines.append((name, f"{hits} of {of}", f"{100 * p:.1f} % [{100 * low:.1f}, {100 * high:.1f}]" if of else "no such cases"))

    def middle(name, values, scale, unit):
        numbers[name] = {"n": len(values), "median": statistics.median(values) if values else None}
        lines.append((name, str(len(values)), f"{scale * statistics.median(values):.3g} {unit}" if values else "no such cases"))

    done = [s for s in scored if not s.trouble]
    single = [s for s in done if s.kind == "single"]
    for size in o.sigma:
        of_size = [s for s in single if s.size == size and not s.limited]
        share(f"first cause, group-exact, at {size:g} sigma", sum(s.exact for s in of_size), len(of_size))
        share(f"first cut at {size:g} sigma", sum(s.cut == s.wanted_cut for s in of_size), len(of_size))
        share(f"seen at {size:g} sigma (any verdict of a gap)", sum(s.verdict in GAP for s in of_size), len(of_size))
        errors = [s.parameter_error for s in of_size if s.exact and s.parameter_error is not None]
        middle(f"parameter error at {size:g} sigma, median", errors, 100, "% of the deviation")
        middle(f"closed at {size:g} sigma, median", [s.closed[0] for s in of_size if s.exact and s.closed], 100, "%")
    large = [s for s in single if s.size >= 3 and not s.limited]
    share("first cause, group-exact, at 3 sigma and more", sum(s.exact for s in large), len(large))
    share("first cut at 3 sigma and more", sum(s.cut == s.wanted_cut for s in large), len(large))
    share("confidently wrong (p >= 0.9), all cases", sum(s.confidently_wrong for s in done if s.kind != "left_out"),
          sum(s.kind != "left_out" for s in done))
    share("something besides the truth accepted, singles", sum(bool(s.beside) and s.exact for s in single), len(single))
    nulls = [s for s in done if s.kind == "null"]
    share("false alarms without a gap", sum(s.outcome == "false alarm" for s in nulls), len(nulls))
    numbers_wrong = [s for s in done if s.kind == "numbers"]
    share("only numbers wrong: a law accused", sum(s.outcome == "a law accused" for s in numbers_wrong), len(numbers_wrong))
    left_out = [s for s in done if s.kind == "left_out" and not s.limited]
    if left_out:
        share("left out of the library: unexplained, or what is said to look like it",
              sum(s.outcome in ("right", "what looks like it") for s in left_out), len(left_out))
        share("left out of the library: unexplained", sum(s.outcome == "right" for s in left_out), len(left_out))
        share("left out of the library: any cause that is not said to look like it, p >= 0.9",
              sum(bool(s.sure_of_another) for s in left_out), len(left_out))
    pairs = [s for s in done if s.kind == "pair" and not s.limited]
    share("both of a pair", sum(s.outcome == "right" for s in pairs), len(pairs))
    share("at least one of a pair", sum(s.outcome != "none found" for s in pairs), len(pairs))
    middle("seconds of a diagnosis, median", [s.seconds for s in done if s.seconds], 1, "s")
    share("cases that failed", sum(bool(s.trouble) for s in scored), len(scored))
    return lines, numbers


def write_markdown(path, o, scored, lines, robot, missing):
    versions = sorted({" ".join(s.report["version"]) for s in scored if s.report})
    text = [f"# Planted and found: {robot.name}, {o.set} set, seed {o.seed}\n",
            f"{len(scored)} cases, {missing} not done yet. Diagnosed by {', '.join(versions) or 'nobody'}. Sizes are in sigma: "
            "rms change in the channel that shows it most, over that channel's noise floor. Group-exact: the first cause is "
            "the true one, or stands with the true one in the group that the verdict names. Intervals are 95 % (Wilson; "
            "closed fraction: bootstrap over runs).\n", "| | of | |", "|---|---|---|"]
    text += [f"| {' | '.join(line)} |" for line in lines]
    text += ["\n| planted (sigma reached) | asked | first cut | verdict | first cause, p | | parameter error | closed | s |",
             "|---|---|---|---|---|---|---|---|---|"]
    for s in scored:
        error = f"{100 * s.parameter_error:.2g} %" if s.parameter_error is not None else ""
        closed = "{:.1f} % [{:.1f}, {:.1f}]".format(*(100 * v for v in s.closed)) if s.closed else ""
        cut = s.cut + ("" if s.kind != "single" or not s.report or s.cut == s.wanted_cut else f" (is {s.wanted_cut})")
        cause = " + ".join(cause_text(c) for c in s.accepted) if len(s.accepted) > 1 else cause_text(s.top)
        text.append(f"| {text_of(s.wanted) or 'nothing'} | {f'{s.size:g}' if s.size else ''} | {cut} | {s.verdict} | {cause} | "
                    f"{s.outcome}{'; ' + s.trouble if s.trouble else ''}{'; as large as it gets' if s.limited else ''} | "
                    f"{error} | {closed} | {f'{s.seconds:.0f}' if s.seconds else ''} |")
    path.write_text("\n".join(text) + "\n")


COLOURS = {"right": "#009E73", "in its group": "#8FD3BC", "unexplained": "#F0E442", "not seen": "#DDDDDD", "too small": "#FFFFFF",
           "another named": "#D55E00", "failed": "#000000"}


def draw_picture(path, o, scored, names):
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.patches import Patch
    cell = {(s.case["effects"][0]["effect"], s.size): s for s in scored if s.kind == "single"}
    names = [n for n in names if any((n, size) in cell for size in o.sigma)]
    if not names:
        return False
    figure, (grid, error) = plt.subplots(1, 2, figsize=(13, 1.8 + 0.24 * len(names)), layout="constrained", sharey=True,
                                         width_ratios=[1.6, 1])
    for row, name in enumerate(names):
        for column, size in enumerate(o.sigma):
            s = cell.get((name, size))
            if s is None:
                continue
            grid.add_patch(plt.Rectangle((column - 0.48, row - 0.45), 0.96, 0.9, color=COLOURS[s.outcome], alpha=0.55))
            text = cause_text(s.top) if s.outcome == "another named" else s.outcome
            if s.limited:
                text += f", {s.reached:.2g} sigma at most"
            grid.text(column, row, text, ha="center", va="center", fontsize=7)
            if s.parameter_error is not None:
                error.plot(max(1e-2, 100 * s.parameter_error), row, "o", ms=4 + 2 * column, mfc="none",
                           color=f"C{column}", label=f"{size:g} sigma")
    grid.set(xlim=(-0.5, len(o.sigma) - 0.5), ylim=(len(names) - 0.5, -0.5), xticks=range(len(o.sigma)),
             yticks=range(len(names)))
    grid.set_xticklabels([f"{size:g} sigma" for size in o.sigma])
    grid.set_yticklabels(names, fontsize=8)
    grid.tick_params(length=0, labeltop=True, labelbottom=False)
    figure.suptitle(f"What is planted and what is named first ({o.set} set, seed {o.seed})", fontsize=10)
    grid.legend(handles=[Patch(color=c, alpha=0.55, label=k) for k, c in COLOURS.items()], fontsize=8, ncol=7,
                loc="upper left", bbox_to_anchor=(0, 0), frameon=False)
    error.set(xscale="log", xlabel="parameter error [% of the deviation from nominal]")
    error.grid(alpha=0.3)
    handles = dict(zip(*reversed(error.get_legend_handles_labels())))
    labels = [label for label in (f"{size:g} sigma" for size in o.sigma) if label in handles]
    if labels:
        error.legend([handles[label] for label in labels], labels, fontsize=8)
    figure.savefig(path, dpi=130)
    return True


def write_tables(o, results, registry, robot, missing):
    by_name = {e["effect"]: e for e in registry}
    scored = [Scored(r, by_name) for r in results]
    lines, numbers = summary(o, scored)
    write_csv(o.out / "table.csv", scored)
    write_markdown(o.out / "table.md", o, scored, lines, robot, missing)
    (o.out / "summary.json").write_text(json.dumps({"cases": len(scored), "missing": missing, "figures": numbers}, indent=1))
    try:
        draw_picture(o.out / "table.png", o, scored, [e["effect"] for e in registry])
    except ImportError as e:
        print(f"gap_table: no picture: {e}; sudo apt-get install python3-matplotlib", file=sys.stderr)
    return lines
