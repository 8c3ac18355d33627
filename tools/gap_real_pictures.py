"""Pictures of what tools/gap_real found: a row a set with the tip as measured and predicted, how likely each single
change is, and the errors of the disks. Knows the summary and reports in its folder, not how they came about."""
import contextlib
import io
import json
import math
import sys

from workers import Wrong

PICTURES = {"real_trunk": ("trunk_a", "trunk_b", "trunk_c"), "real_opencr": ("opencr_v4", "opencr_v6")}
DRAWABLE = [name for members in PICTURES.values() for name in members]
WINDOW_S = 30   # of longer curves nobody sees what they miss
LEAST_P = 1e-6  # shorter bars all mean "no"; the numbers beside them say how much so
SPARSE = 120    # readings: fewer are marked, since a line alone looks as if there were more
# One colour a role in every panel; NOT_NAMED, a pale WITH_CHANGE: the likeliest where the verdict names none.
MEASURED, FLOOR, FILE, LEARNED, WITH_CHANGE, NOT_NAMED, OTHERS = (
    "#222222", "#d9d9d9", "#888888", "#D55E00", "#0072B2", "#a9cce4", "#b9b9b9")
BARS = (("nominal", FILE, "robot file"), ("calibrated", LEARNED, "learned from before"),
        ("with_cause", WITH_CHANGE, "with the likeliest change"))


def ready(folder):
    """Before anything is diagnosed: tells what would end the drawing."""
    try:
        import matplotlib.figure  # noqa: F401
        folder.mkdir(parents=True, exist_ok=True)
    except ImportError as error:
        raise Wrong(f"{error}; Debian: python3-matplotlib, or leave out --pictures") from error
    except OSError as error:
        raise Wrong(f"--pictures {folder}: {error.strerror}; name a folder that can be written") from error


def draw(out, folder, names=None):
    """What there is of the sets (None: of all) in `out`; the pictures' paths."""
    sets = summary(out)
    lacking = [n for n in names or () if n not in sets]
    if lacking:
        raise Wrong(f"{out / 'summary.json'}: no {lacking[0]} (there are {', '.join(sets)}); diagnose it first")
    wanted = {name: found for name, found in sets.items() if not names or name in names}
    for name, found in wanted.items():
        if "error" in found:
            print(f"gap_real: {name}: not diagnosed, so not drawn: {found['error']}", file=sys.stderr)
    figures = {}  # all are drawn before any is written
    for picture, members in PICTURES.items():
        rows = [Found(out, wanted[n]) for n in members if "error" not in wanted.get(n, {"error": "not there"})]
        if rows:
            figures[folder / f"{picture}.png"] = drawn(rows)
    if not figures:
        raise Wrong(f"nothing to draw: of {', '.join(DRAWABLE)} none is asked for and diagnosed in {out}")
    for path, figure in figures.items():
        try:
            save(figure, path)
        except OSError as error:
            raise Wrong(f"{path}: {error.strerror}") from error
    return list(figures)


def save(figure, path):
    """In few colours: that looks the same and is a third as large."""
    from PIL import Image  # a part of matplotlib's own needs
    whole = io.BytesIO()
    figure.savefig(whole, dpi=110)
    Image.open(whole).convert("RGB").quantize(64, dither=0).save(path, optimize=True)


# ---- what a run left ----

@contextlib.contextmanager
def understanding(path):
    try:
        yield
    except OSError as error:
        raise Wrong(f"{path}: {error.strerror}; diagnose again") from error
    except (ValueError, KeyError, TypeError, AttributeError, IndexError, StopIteration) as error:
        raise Wrong(f"{path}: cannot be understood ({type(error).__name__}: {error}); it is damaged or another "
                    "version's: diagnose again") from error


def summary(out):
    """Its sets by name."""
    path = out / "summary.json"
    if not path.is_file():
        raise Wrong(f"no summary.json in {out}: name with --out what an earlier run wrote, or leave out --no-diagnosis")
    with understanding(path):
        return {s["name"]: s for s in json.loads(path.read_text())["sets"]}


class Found:
    """What is drawn of a set."""

    def __init__(self, out, found):
        self.name = found["name"]
        with understanding(out / "summary.json"):
            self._take_summary(found)
        report = out / self.name / "report" / "report.json"
        with understanding(report):
            self._take_report(json.loads(report.read_text()))
        if self.curve is None:
            raise Wrong(f"{report}: no curves of disk {self.disks[-1]}, as in those of older programs; build anew and "
                        f"diagnose {self.name} again")

    def _take_summary(self, found):
        self.title = f"{self.name}: {found['verdict']}, learned from {found['before']}"
        causes = [(float(c["p"]), f"{c['effect']} {c['where']}".strip()) for c in found["causes"]]
        self.causes = sorted(causes, reverse=True)
        self.likeliest = next(name for _, name in self.causes if name != "unknown")
        by_disk = found["held_out_rms_mm_by_disk"]
        self.disks, self.floor_mm = by_disk["disks"], found["floor_mm_by_disk"]
        self.errors_mm = {key: by_disk[key] for key, *_ in BARS}
        if {len(v) for v in (self.floor_mm, *self.errors_mm.values())} != {len(self.disks)}:
            raise ValueError("not one error a disk")

    def _take_report(self, report):
        self.named = {f"{c['effect']} {c['where']}".strip() for c in report["accepted"]}
        if report["verdict"] == "no_gap":
            self.named.add("no_gap")
        places = [f"disk {self.disks[-1]} {axis}" for axis in "xyz"]
        curves = [Curve(o) for o in report.get("overlays", []) if o["channel"] in places]
        self.curve = max((c for c in curves if c.rms_mm() > 0), key=Curve.rms_mm, default=None)


class Curve:
    """A channel in a run, in mm; readings that are missing are not numbers."""

    def __init__(self, overlay):
        self.run, self.channel, self.floor = overlay["run"], overlay["channel"], 1e3 * overlay["floor"]
        self.time_s = [float(t) for t in overlay["time_s"]]
        self.measured, self.learned, self.with_change = (
            [math.nan if v is None else 1e3 * v for v in overlay[key]] for key in ("measured", "before", "after"))
        if len(self.measured) != len(self.time_s) or len(self.learned) != len(self.time_s) or \
                len(self.with_change) not in (0, len(self.time_s)):  # none where nothing changed
            raise ValueError(f"{self.channel}: not one value a time")

    def predicted(self):
        """(values, colour) of each prediction."""
        return [(v, colour) for v, colour in ((self.learned, LEARNED), (self.with_change, WITH_CHANGE)) if v]

    def squares(self):
        return [0.0 if math.isnan(m - b) else (m - b) ** 2 for m, b in zip(self.measured, self.learned)]

    def rms_mm(self):
        there = sum(not math.isnan(m - b) for m, b in zip(self.measured, self.learned))
        return math.sqrt(sum(self.squares()) / there) if there else 0.0

    def shown(self):
        """The part of WINDOW_S in which the learned robot misses most, as a slice."""
        squares, most, best, end, total = self.squares(), -1.0, slice(0, 0), 0, 0.0
        for begin, time in enumerate(self.time_s):
            while end < len(squares) and self.time_s[end] <= time + WINDOW_S:
                total += squares[end]
                end += 1
            if total > most:
                most, best = total, slice(begin, end)
            total -= squares[begin]
        return best


# ---- the panels ----

def drawn(rows):
    from matplotlib.figure import Figure
    heights = [max(2.6, 0.8 + 0.13 * len(row.causes)) for row in rows]
    figure = Figure(figsize=(11, sum(heights) + 0.3), layout="constrained")
    panels, legend = figure.subfigures(2, 1, height_ratios=[sum(heights), 0.3])
    grid = panels.add_gridspec(len(rows), 3, width_ratios=(5, 3, 3), height_ratios=heights)
    for i, row in enumerate(rows):
        over, under = grid[i, 0].subgridspec(2, 1, height_ratios=(3, 2)).subplots(sharex=True)
        evidence, errors = (panels.add_subplot(grid[i, k]) for k in (1, 2))
        draw_curve(over, row)
        draw_missed(under, row.curve)
        draw_evidence(evidence, row)
        draw_errors(errors, row)
        for axis in (over, under, evidence, errors):
            plain(axis)
        if i == 0:
            evidence.set_title("probability of each single change", fontsize=10, loc="left")
            errors.set_title("rms error by disk", fontsize=10, loc="left")
    legend.legend(handles=shown_in(rows), loc="center", ncols=6, fontsize=8.5, frameon=False)
    return figure


def plain(axis):
    axis.grid(color="#e2e2e2", linewidth=0.6)
    axis.set_axisbelow(True)
    axis.tick_params(labelsize=7.5)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


def draw_curve(axis, row):
    curve = row.curve
    part = curve.shown()
    time = curve.time_s[part]
    axis.plot(time, curve.measured[part], color=MEASURED, **line_of(time))
    for values, colour in curve.predicted():
        axis.plot(time, values[part], color=colour, **line_of(time))
    axis.set_title(row.title, fontsize=10, loc="left")
    axis.set_ylabel(f"{curve.channel} [mm]", fontsize=8.5)
    axis.tick_params(labelbottom=False)


def draw_missed(axis, curve):
    """What the curves differ by; beside the motion itself the floor would be a hair."""
    part = curve.shown()
    time, measured = curve.time_s[part], curve.measured[part]
    axis.axhspan(-curve.floor, curve.floor, color=FLOOR, linewidth=0)
    for values, colour in curve.predicted():
        axis.plot(time, [m - v for m, v in zip(measured, values[part])], color=colour, **line_of(time))
    axis.margins(x=0.01)
    axis.set_xlabel(f"time of {curve.run} [s]", fontsize=8.5)
    axis.set_ylabel("missed [mm]", fontsize=8.5)


def line_of(time):
    return {"linewidth": 1.2, **({"marker": ".", "markersize": 4} if len(time) < SPARSE else {})}


def draw_evidence(axis, row):
    for place, (p, name) in enumerate(row.causes):
        colour = WITH_CHANGE if name in row.named else NOT_NAMED if name == row.likeliest else OTHERS
        end = max(p, LEAST_P)
        axis.barh(place, end - LEAST_P, left=LEAST_P, color=colour, height=0.75)
        axis.annotate(f"{p:.2g}" if p >= 1e-3 else f"{p:.0e}", (end, place), (3, 0), textcoords="offset points",
                      va="center", fontsize=7)
    axis.set_xscale("log")
    axis.set_xlim(LEAST_P, 12)  # beyond 1 for the numbers
    axis.set_xticks([10.0 ** k for k in range(-6, 1, 2)])
    axis.minorticks_off()
    axis.set_yticks(range(len(row.causes)), [name for _, name in row.causes])
    axis.set_ylim(len(row.causes) - 0.4, -0.6)
    axis.set_xlabel("probability", fontsize=8.5)


def draw_errors(axis, row):
    places = range(len(row.disks))
    for place, floor in zip(places, row.floor_mm):
        axis.bar(place, floor, 0.96, color=FLOOR)
        axis.plot([place - 0.48, place + 0.48], [floor, floor], color=MEASURED, linewidth=0.8, linestyle=(0, (4, 2)),
                  zorder=4)
    for k, (key, colour, _) in enumerate(BARS):
        bars = axis.bar([place + 0.29 * (k - 1) for place in places], row.errors_mm[key], 0.27, color=colour, zorder=3)
        axis.bar_label(bars, fmt="%.1f", fontsize=7, padding=1, zorder=5)
    aside = 0.55 if len(row.disks) > 1 else 1.2  # a disk alone would be wide
    axis.set_xlim(-aside, len(row.disks) - 1 + aside)
    axis.set_xticks(places, [f"disk {d}" for d in row.disks])
    axis.margins(y=0.12)
    axis.set_ylabel("rms [mm]", fontsize=8.5)


def shown_in(rows):
    """What a legend says of them."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    named = [(colour, label) for _, colour, label in BARS]
    if any(row.likeliest not in row.named for row in rows):
        named.append((NOT_NAMED, "likeliest, not named"))
    return [Line2D([], [], color=MEASURED, linewidth=1.2, label="measured"),
            *(Patch(color=colour, label=label) for colour, label in [(FLOOR, "floor (held out, before)"), *named])]
