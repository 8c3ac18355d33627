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
    figure, (tip, tension) = plt.subplots(2, 1, figsize=(8, 5.5), sharex=True)
    for option, name, colour in ((2, "2: disable voltage", "tab:blue"), (3, "3: quick stop", "tab:orange")):
        rows = table[table["option"] == option]
        tip.plot(rows["t_s"], rows["tip_x_mm"], color=colour, label=name)
        tension.plot(rows["t_s"], rows["highest_tension_N"], color=colour)
    tip.set_ylabel("tip x [mm]")
    tip.legend(title="object 0x6007")
    tension.set_ylabel("highest tension [N]")
    tension.set_xlabel("time after the daemon was killed [s]")
    for axes in (tip, tension):
        axes.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(sys.argv[2], dpi=110)
    return 0


if __name__ == "__main__":
    sys.exit(main())
