#!/usr/bin/env python3
"""Draws what `tendril reproduce` computed: reads DIR/reproduce.json and DIR/*.csv, writes DIR/index.html.
Computes nothing of the robot; the page is one file that opens without a network."""
import argparse
import base64
import csv
import html
import io
import json
import math
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
UNITS = ["#08306b", "#2171b5", "#6baed6", "#e6850e"]  # base to tip
TENDONS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7"]
PAPER, OURS, GREY = "#B00020", "#0072B2", "#777777"
VERDICTS = {"confirmed": ("confirmed", "ok"), "differs": ("differs", "no"),
            "not_reproducible_as_stated": ("not reproducible as stated", "open")}
SECTIONS = {"5.2": "5.2 Circle in space", "3.1": "3.1 No tension", "3.2": "3.2 One tendon pulls with 5 N",
            "4": "4 Friction between tendon and pulley", "5.1": "5.1 Planar bend", "6": "6 Conclusions"}


class Failure(Exception):
    """One line for the user."""


def version():
    """The project's version, as the build has it."""
    found = re.search(r"project\(tendril VERSION ([0-9.]+)", (ROOT / "CMakeLists.txt").read_text()) \
        if (ROOT / "CMakeLists.txt").exists() else None
    return found.group(1) if found else "unknown"


class Results:
    """The claims and the series by name."""

    def __init__(self, folder):
        self.folder = folder
        try:
            self.all = json.loads((folder / "reproduce.json").read_text())
            self.claims = self.all["claims"]
        except OSError as e:
            raise Failure(f"{e.filename}: {e.strerror}; it should be a folder that `tendril reproduce` wrote") from e
        except (json.JSONDecodeError, KeyError) as e:
            raise Failure(f"{folder / 'reproduce.json'}: not what `tendril reproduce` writes ({e}); run it again") from e

    def claim(self, name):
        for c in self.claims:
            if c["id"] == name:
                return c
        raise Failure(f"{self.folder / 'reproduce.json'}: no claim {name}; written by another version?")

    def series(self, name):
        """Columns of a CSV file as arrays by name."""
        import numpy as np
        path = self.folder / f"{name}.csv"
        try:
            with path.open(newline="") as f:
                rows = list(csv.reader(f))
            values = np.array([[float(x) for x in row] for row in rows[1:]])
            return {c: values[:, i] for i, c in enumerate(rows[0])}
        except OSError as e:
            raise Failure(f"{path}: {e.strerror}; run `tendril reproduce` again") from e
        except (ValueError, IndexError) as e:
            raise Failure(f"{path}: not a table of numbers ({e}); run `tendril reproduce` again") from e


def new_figure(width, height, rows=1, columns=1, **options):
    from matplotlib.figure import Figure
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for a in axes.flat:
        a.grid(True, color="#e3e3e3", linewidth=0.6)
        a.set_axisbelow(True)
        for side in ("top", "right"):
            a.spines[side].set_visible(False)
    return figure, axes


def legend(axis, **options):
    axis.legend(frameon=False, fontsize=8.5, **options)


def eq31(r):
    figure, ((a,),) = new_figure(6.2, 4.6)
    s = r.series("eq31")
    for length, color in ((60, OURS), (90, GREY)):
        of = s["length_mm"] == length
        a.plot([0, *(1e3 * s["x_m"][of])], [0, *(1e3 * s["z_m"][of])], color=color, linewidth=2.4,
               label=f"{length} mm robot bent by pi/3")
    x, z = 28.6479, 49.6196
    a.plot([-x, x], [z, z], color=PAPER, linewidth=1.6, linestyle=(0, (5, 2)), label="circle of eq. 31, from the side")
    a.plot([x], [z], "o", color=PAPER, markersize=6)
    a.set_aspect("equal")
    a.set_xlabel("x [mm]")
    a.set_ylabel("z [mm]")
    a.set_xlim(-33, 62)
    a.set_ylim(0, 82)
    legend(a, loc="lower right")
    return figure, f"Side view: the circle of eq. 31 (radius {x} mm at z = {z} mm) belongs to a robot of 60 mm."


def fig4(r):
    s = r.series("zero_tension")
    figure, axes = new_figure(9.4, 4.8, 4, 1, sharex=True, sharey=True)
    shown = s["t_s"] <= 1.0
    for i in range(4):
        a = axes[i, 0]
        a.plot(s["t_s"][shown], 1e6 * s[f"u{i + 1}"][shown], color=UNITS[i], linewidth=0.9)
        a.axhline(0, color="#000000", linewidth=0.7)
        a.set_ylabel(f"unit {i + 1}\n[µrad]", fontsize=8.5)
    axes[-1, 0].set_xlabel("t [s]")
    return figure, "Fig. 4a recomputed: the signed bend u of each unit in the first second, from 1e-4 rad, no tension."


def fig5(r):
    figure, axes = new_figure(9.4, 3.9, 1, 2, sharey=True)
    for a, name, title in ((axes[0, 0], "pull_undamped", "the paper's equations: no damping"),
                           (axes[0, 1], "pull_damped", "with the damping stated")):
        s = r.series(name)
        shown = s["t_s"] <= 2
        for i in range(4):
            a.plot(s["t_s"][shown], s[f"u{i + 1}"][shown], color=UNITS[i], linewidth=0.9, label=f"unit {i + 1}")
        a.axhline(math.pi / 6, color=PAPER, linestyle=(0, (5, 2)), linewidth=1.2, label="pi/6 (the paper)")
        a.set_title(title, fontsize=10)
        a.set_xlabel("t [s]")
    axes[0, 0].set_ylabel("bending angle of a unit [rad]")
    legend(axes[0, 1], loc="upper right", ncol=2)
    return figure, "Fig. 5a recomputed: 5 N on tendon 1 from pi/12 a unit; upright, 90 mm."


def fig5_readings(r):
    rows = r.claim("3.2_equilibrium")["readings"]
    figure, ((a,),) = new_figure(9.4, 4.2)
    names = list(rows)
    for y, name in enumerate(names):
        for i in range(4):
            x = rows[name].get(f"unit {i + 1} [rad]")
            if isinstance(x, (int, float)):
                a.plot(x, y, "o", color=UNITS[i], markersize=7, label=f"unit {i + 1}" if y == 0 else None)
            elif i == 0:
                a.text(math.pi / 6 + 0.02, y, "no equilibrium", va="center", fontsize=8.5)
    a.axvline(math.pi / 6, color=PAPER, linestyle=(0, (5, 2)), linewidth=1.2, label="pi/6 (the paper)")
    a.set_yticks(range(len(names)), names, fontsize=8.5)
    a.invert_yaxis()
    a.set_xlim(left=0)
    a.set_xlabel("bending angle of a unit at rest [rad]")
    legend(a, loc="upper right")
    return figure, "Where each reading of the paper comes to rest under 5 N on tendon 1."


def fig7(r):
    import numpy as np
    s = r.series("fig7")
    figure, axes = new_figure(9.4, 6.6, 2, 2, sharex=True, sharey="col")
    styles = {(0.67, 1): ("#0072B2", "-"), (0.67, 10): ("#0072B2", (0, (4, 2))), (1.0, 1): ("#D55E00", "-"),
              (1.0, 10): ("#D55E00", (0, (4, 2)))}
    for column, alpha in enumerate((0.15, 0.6)):
        for row, law in enumerate((1, 2)):
            a = axes[row, column]
            of = (s["law"] == 0) & np.isclose(s["alpha"], alpha)
            a.plot(s["wrap_rad"][of], s["ratio"][of], color="#000000", linewidth=1.8, label="classic")
            for (n, rho), (color, line) in styles.items():
                of = (s["law"] == law) & np.isclose(s["alpha"], alpha) & np.isclose(s["n"], n) & (s["rho"] == rho)
                a.plot(s["wrap_rad"][of], s["ratio"][of], color=color, linestyle=line, linewidth=1.5,
                       label=f"n = {n:g}, rho = {rho:g}")
            a.set_title(f"alpha = {alpha:g}, {'cumulative law (the paper)' if law == 1 else 'local law'}", fontsize=10)
            if column == 0:
                a.set_ylabel("tension ratio, motor / robot")
            if row == 1:
                a.set_xlabel("wrap [rad]")
    legend(axes[0, 0], loc="upper left")
    return figure, "Fig. 7 recomputed at unit output tension: below with the power law between densities."


def fig11(r):
    figure, axes = new_figure(9.4, 6.6, 2, 2)
    law, loop = r.series("planar_statics"), r.series("planar_loop")
    a = axes[0, 0]
    a.plot(1e3 * loop["wanted_x_m"], 1e3 * loop["wanted_z_m"], color="#000000", linestyle=(0, (4, 2)), label="wanted")
    a.plot(1e3 * loop["tip_x_m"], 1e3 * loop["tip_z_m"], color=OURS, label="simulated rig")
    a.set_aspect("equal", adjustable="datalim")
    a.set_xlabel("x [mm]")
    a.set_ylabel("z [mm]")
    a.set_title("tip path", fontsize=10)
    legend(a, loc="lower left")
    a = axes[0, 1]
    a.plot(loop["t_s"], loop["us_rad"], color=OURS, label="true bend")
    a.plot(loop["t_s"], [0.26 * (t - 0.25) for t in loop["t_s"]], color=PAPER, linestyle=(0, (5, 2)), linewidth=1,
           label="0.26 rad/s")
    a.set_ylim(-0.05, 1.75)
    a.set_xlabel("t [s]")
    a.set_ylabel("bend [rad]")
    a.set_title("bend of the whole robot", fontsize=10)
    legend(a, loc="upper left")
    a = axes[1, 0]
    a.plot(loop["us_rad"], loop["motor_N_1"], color=TENDONS[1], label="tendon 1, motor side")
    a.plot(loop["us_rad"], loop["base_N_1"], color=TENDONS[0], label="tendon 1, at the robot")
    a.plot(law["bend_rad"], law["tension_1_N"], color="#000000", linestyle=(0, (4, 2)), label="tendon 1, model, no pretension")
    a.plot(loop["us_rad"], loop["base_N_2"], color=GREY, linewidth=1, label="tendon 2, at the robot")
    a.set_xlabel("bend [rad]")
    a.set_ylabel("tension [N]")
    a.set_title("tensions", fontsize=10)
    legend(a, loc="upper left")
    a = axes[1, 1]
    a.plot(loop["us_rad"], loop["motor_N_1"] - loop["base_N_1"], color=OURS, label="simulated rig")
    a.plot(law["bend_rad"], law["loss_N"], color="#000000", linestyle=(0, (4, 2)), label="law at the tension needed")
    a.plot([1.6], [1.26], "o", color=PAPER, label="1.26 N at 1.6 rad (the paper)")
    a.set_xlabel("bend [rad]")
    a.set_ylabel("loss in tendon 1 [N]")
    a.set_title("what the pulley takes", fontsize=10)
    legend(a, loc="upper left")
    return figure, "Fig. 11 recomputed on the 90 mm rig: controller, bus, drives and plant in simulated time."


def fig13(r):
    figure, axes = new_figure(9.4, 6.6, 2, 2, sharex=True)
    three, four = r.series("circle_loop_3"), r.series("circle_loop_4")
    for a, s, count in ((axes[0, 0], three, 3), (axes[0, 1], four, 4)):
        t = s["t_s"] - s["t_s"][0]
        for j in range(count):
            a.plot(t, s[f"motor_N_{j + 1}"], color=TENDONS[j], label=f"tendon {j + 1}")
            a.plot(t, s[f"desired_base_N_{j + 1}"], color=TENDONS[j], linestyle=(0, (3, 2)), linewidth=1)
        a.set_title(f"{count} tendons: actual (full) and theoretical (dashed)", fontsize=10)
        a.set_ylabel("tension [N]")
        legend(a, loc="lower center", ncol=count, handlelength=1.1, columnspacing=1)
        a.set_ylim(bottom=-0.9)
    a = axes[1, 0]
    for s, color, name in ((three, TENDONS[0], "3 tendons"), (four, TENDONS[1], "4 tendons")):
        a.plot(s["t_s"] - s["t_s"][0], s["motor_N_1"] - s["base_N_1"], color=color, label=f"tendon 1 of {name}")
    a.axhline(0.42, color=PAPER, linestyle=(0, (5, 2)), linewidth=1.2, label="mean 0.42 N (the paper)")
    a.axhline(0, color="#000000", linewidth=0.7)
    a.set_ylim(top=2.2)
    a.set_title("actual less at the robot: what the pulley takes", fontsize=10)
    a.set_xlabel("t [s]")
    a.set_ylabel("loss [N]")
    legend(a, loc="upper right")
    a = axes[1, 1]
    a.plot(three["t_s"] - three["t_s"][0], [math.hypot(u, v) for u, v in zip(three["us_rad"], three["vs_rad"])],
           color=OURS, label="true bend, 3 tendons")
    a.axhline(math.pi / 3, color=PAPER, linestyle=(0, (5, 2)), linewidth=1.2, label="pi/3 (the paper)")
    a.set_ylim(0.9, 1.2)
    a.set_title("bend of the whole robot", fontsize=10)
    a.set_xlabel("t [s]")
    a.set_ylabel("bend [rad]")
    legend(a, loc="upper right")
    return figure, "Fig. 13 recomputed on 60 mm rigs with 3 and with 4 tendons, one revolution of eq. 31."


PLOTS = {f.__name__: f for f in (eq31, fig4, fig5, fig5_readings, fig7, fig11, fig13)}


def as_image(figure):
    out = io.BytesIO()
    figure.savefig(out, format="svg", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(out.getvalue()).decode()


STYLE = """
body { font: 15px/1.5 system-ui, 'DejaVu Sans', sans-serif; color: #1c1c1c; background: #fff; margin: 0 auto;
  max-width: 1080px; padding: 24px 28px 60px; }
h1 { font-size: 25px; margin: 0 0 4px; } h2 { font-size: 19px; margin: 44px 0 8px; border-bottom: 2px solid #1c1c1c; }
p.lead { margin: 4px 0 14px; color: #444; }
table { border-collapse: collapse; } th, td { text-align: left; padding: 4px 10px; border-bottom: 1px solid #ddd;
  vertical-align: top; } th { font-weight: 600; font-size: 13px; color: #444; }
table.overview { width: 100%; } a { color: inherit; }
table.readings { font-size: 12.5px; margin: 6px 0; } table.readings td + td, table.readings th + th { text-align: right; }
.scroll { overflow-x: auto; }
.badge { display: inline-block; padding: 1px 9px; border-radius: 10px; font-size: 12.5px; font-weight: 600;
  white-space: nowrap; }
.ok { background: #d9f0e3; color: #0b5b34; } .no { background: #fbdcd5; color: #8c1d06; }
.open { background: #fdeec6; color: #6b4a00; }
article { margin: 22px 0; padding-left: 14px; border-left: 4px solid #ddd; }
article.ok { border-color: #3fa06f; background: none; color: inherit; }
article.no { border-color: #d2573a; background: none; color: inherit; }
article.open { border-color: #d8a017; background: none; color: inherit; }
article h3 { font-size: 16px; margin: 0 0 6px; } article p { margin: 4px 0; }
dl { display: flex; gap: 34px; margin: 6px 0; flex-wrap: wrap; } dl div { min-width: 150px; }
dt { font-size: 12px; color: #666; } dd { margin: 0; font-size: 17px; font-weight: 600; }
figure { margin: 16px 0 6px; } figure img { max-width: 100%; } figcaption { font-size: 13px; color: #444; }
summary { cursor: pointer; font-size: 13px; color: #444; }
footer { margin-top: 44px; font-size: 12.5px; color: #666; }
@media print { details { display: block; } article { break-inside: avoid; } }
"""


def number(x):
    if x is None:
        return ""
    if isinstance(x, str):
        return html.escape(x)
    if x == 0:
        return "0"
    return f"{x:.4g}" if 1e-3 <= abs(x) < 1e5 else f"{x:.1e}"


def readings_table(readings):
    columns = []
    for row in readings.values():
        columns += [c for c in row if c not in columns]
    head = "".join(f"<th>{html.escape(c)}</th>" for c in ["", *columns])
    body = "".join("<tr><td>" + html.escape(name) + "</td>" + "".join(f"<td>{number(row.get(c))}</td>" for c in columns) +
                   "</tr>" for name, row in readings.items())
    return f'<div class="scroll"><table class="readings"><tr>{head}</tr>{body}</table></div>'


def claim_article(c):
    text, kind = VERDICTS[c["verdict"]]
    where = c["figure"] or f"section {c['section']}"
    parts = [f'<article id="{html.escape(c["id"])}" class="{kind}">',
             f'<h3>{html.escape(c["claim"])}</h3>',
             f'<dl><div><dt>the paper, {html.escape(where)}</dt><dd>{html.escape(c["paper"])}</dd></div>',
             f'<div><dt>ours</dt><dd>{html.escape(c["ours"])}</dd></div>',
             f'<div><dt>verdict</dt><dd><span class="badge {kind}">{text}</span></dd></div></dl>',
             f'<p>{html.escape(c["reason"])}</p>']
    if c["readings"]:
        parts.append(f"<details><summary>readings and numbers</summary>{readings_table(c['readings'])}</details>")
    return "\n".join([*parts, "</article>"])


def page(results):
    claims = results.claims
    counts = {v: sum(c["verdict"] == v for c in claims) for v in VERDICTS}
    out = ["<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>The paper, recomputed</title>",
           '<meta name="viewport" content="width=device-width">', f"<style>{STYLE}</style></head><body>",
           "<h1>The paper, recomputed</h1>",
           f'<p class="lead">{html.escape(results.all["paper"])}. Every claim and figure that a simulation can check, with '
           "Tendril's model and simulator: the paper's value beside ours, verdict and reason.</p>",
           "<p>" + " &nbsp; ".join(f'<span class="badge {VERDICTS[v][1]}">{counts[v]} {VERDICTS[v][0]}</span>'
                                   for v in VERDICTS) + "</p>",
           '<table class="overview"><tr><th>where</th><th>claim</th><th>paper</th><th>ours</th><th>verdict</th></tr>']
    for c in claims:
        text, kind = VERDICTS[c["verdict"]]
        out.append(f'<tr><td>{html.escape(c["figure"] or c["section"])}</td>'
                   f'<td><a href="#{html.escape(c["id"])}">{html.escape(c["what"])}</a></td>'
                   f'<td>{html.escape(c["paper"])}</td><td>{html.escape(c["ours"])}</td>'
                   f'<td><span class="badge {kind}">{text}</span></td></tr>')
    out.append("</table>")
    heading, drawn = None, set()
    for c in claims:
        title = "Eq. 31 The circle's geometry" if c["figure"] == "eq. 31" else SECTIONS.get(c["section"], c["section"])
        if title != heading:
            heading = title
            out.append(f"<h2>{html.escape(title)}</h2>")
        if c["plot"] and c["plot"] not in drawn:
            drawn.add(c["plot"])
            if c["plot"] not in PLOTS:
                raise Failure(f"claim {c['id']} names a plot {c['plot']} that this script does not know; versions mixed?")
            figure, caption = PLOTS[c["plot"]](results)
            out.append(f'<figure><img alt="{html.escape(caption)}" src="{as_image(figure)}">'
                       f"<figcaption>{html.escape(caption)}</figcaption></figure>")
        out.append(claim_article(c))
    out.append(f'<footer>tendril {html.escape(results.all["version"])} ({html.escape(results.all["git_revision"])}), '
               f'computed in {results.all["wall_s"]:.0f} s. All numbers: reproduce.json and the *.csv beside this page.'
               "</footer></body></html>\n")
    return "\n".join(out)


def main():
    parser = argparse.ArgumentParser(prog="report_reproduce.py", description="Draws what `tendril reproduce` computed.")
    parser.add_argument("folder", metavar="DIR", type=pathlib.Path,
                        help="a folder of `tendril reproduce` with reproduce.json; index.html goes there too")
    parser.add_argument("--version", action="version", version=f"report_reproduce.py {version()}")
    folder = parser.parse_args().folder
    try:
        import matplotlib
    except ImportError:
        raise Failure("no matplotlib for this Python: sudo apt-get install python3-matplotlib") from None
    matplotlib.use("Agg")
    matplotlib.rcParams.update({"font.size": 9.5, "path.simplify_threshold": 0.5, "svg.hashsalt": "tendril"})
    text = page(Results(folder))
    try:
        (folder / "index.html").write_text(text)
    except OSError as e:
        raise Failure(f"cannot write {folder / 'index.html'}: {e.strerror}") from e


if __name__ == "__main__":
    try:
        main()
    except Failure as failure:
        print(f"report_reproduce.py: {failure}", file=sys.stderr)
        sys.exit(1)
