#!/usr/bin/python3
"""plot_reaction.py CSV PNG: tip and tension after the daemon was killed, for both reactions of the drives (object
0x6007); an SVG and a PDF are written beside the PNG. The table comes from the test Reaction with TENDRIL_REACTION_CSV
set; knows its columns only."""
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np


def main():
    if len(sys.argv) != 3 or sys.argv[1].startswith("-"):
        print(__doc__)
        return 0 if "--help" in sys.argv else 2
    table = np.genfromtxt(sys.argv[1], delimiter=",", names=True)
    timeouts = sorted(set(table["timeout_ms"]))
    figure, axes = plt.subplots(2, len(timeouts), figsize=(4.5 * len(timeouts), 5), sharey="row", squeeze=False)
    for (tip, tension), timeout in zip(axes.T, timeouts):
        shown = table[(table["timeout_ms"] == timeout) & (table["t_s"] <= timeout / 1e3 + 0.15)]
        for option, name, style in ((2, "2: disable voltage", "-"), (3, "3: quick stop", "--")):
            rows = shown[shown["option"] == option]
            tip.plot(1e3 * rows["t_s"], rows["tip_x_mm"], style, label=name)
            tension.plot(1e3 * rows["t_s"], rows["highest_tension_N"], style)
        tip.set_title(f"heartbeat missed for {timeout:g} ms")
        tension.set_xlabel("time after the daemon was killed [ms]")
        for plot in (tip, tension):
            plot.grid(alpha=0.3)
    axes[0][0].set_ylabel("tip x [mm]")
    axes[1][0].set_ylabel("highest tension [N]")
    figure.tight_layout(rect=(0, 0, 1, 0.93))
    figure.legend(*axes[0][0].get_legend_handles_labels(), title="object 0x6007", loc="upper center", ncol=2, frameon=False)
    for kind, undated in ((".png", None), (".svg", {"Date": None}), (".pdf", {"CreationDate": None})):
        figure.savefig(pathlib.Path(sys.argv[2]).with_suffix(kind), dpi=110, metadata=undated)
    return 0


if __name__ == "__main__":
    sys.exit(main())
