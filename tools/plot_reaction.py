#!/usr/bin/python3
"""plot_reaction.py CSV PNG: tip and tension after the daemon was killed, for both reactions of the drives (object
0x6007). The table comes from the test Reaction with TENDRIL_REACTION_CSV set; knows its columns only."""
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
    axes[0][0].legend(title="object 0x6007")
    axes[1][0].set_ylabel("highest tension [N]")
    figure.tight_layout()
    figure.savefig(sys.argv[2], dpi=110)
    return 0


if __name__ == "__main__":
    sys.exit(main())
