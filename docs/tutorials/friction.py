"""Ratio of horizontal to vertical force while a body is dragged over another: python3 friction.py TRACE.csv OUT.csv

TRACE.csv is the trace that `palpate run` wrote, a table of the force over time; OUT.csv gets time and ratio."""

import sys

import numpy as np

# DRAGGED: time from which on ratios are written, s. SLIDING: time from which on the body slides, s.
DRAGGED, SLIDING = 0.15, 0.35


def main(file, out):
    trace = np.genfromtxt(file, delimiter=",", names=True)
    trace = trace[trace["time_s"] > DRAGGED]
    ratio = np.hypot(trace["force_x"], trace["force_z"]) / trace["force_y"]
    print(f"at most {ratio.max():.3f}; from {SLIDING} s on {ratio[trace['time_s'] > SLIDING].mean():.3f}")
    np.savetxt(out, np.column_stack([trace["time_s"], ratio]), delimiter=",", fmt="%.5g",
               header="time (s),horizontal over vertical force", comments="")


if __name__ == "__main__":
    main(*sys.argv[1:])
