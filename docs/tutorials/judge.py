"""A stand-in for the participant of a two-interval forced choice, who judges by force: python3 judge.py FOLDER

FOLDER has trials.csv, with a line FIRST,SECOND for each trial (the names of its two samples), and for each sample the
table of a recorded haptic session, SAMPLE.csv. A sample's name is its modulus relative to the reference sample's."""

import csv
import random
import sys
from statistics import NormalDist

import numpy as np

JND = 0.07  # just noticeable difference of a force, as a share of it
# REFERENCE: name of the reference sample. HELD: time from which on the hand holds still, s. SURFACE: height of the
# device at which the tool touches the sample, m.
REFERENCE, HELD, SURFACE = "1.00", 0.8, 0.01


def main(folder):
    with open(f"{folder}/trials.csv") as file:
        trials = list(csv.reader(file))
    force, stiffness = {}, {}
    for sample in sorted({sample for trial in trials for sample in trial}):
        ticks = np.genfromtxt(f"{folder}/{sample}.csv", delimiter=",", names=True)
        held = ticks[ticks["time_s"] > HELD]
        force[sample] = held["played_force_y"].mean()
        stiffness[sample] = force[sample] / (SURFACE - held["device_y"].mean())
    # With this noise in both intervals, three of four answers are right where the forces differ by JND.
    noise = JND / NormalDist().inv_cdf(0.75) / 2**0.5
    chance, answers = random.Random(2), {sample: [] for sample in force if sample != REFERENCE}
    for trial in trials:
        felt = {sample: force[sample] * (1 + chance.gauss(0, noise)) for sample in trial}
        comparison = trial[0] if trial[1] == REFERENCE else trial[1]
        answers[comparison].append(felt[comparison] > felt[REFERENCE])
    print("modulus   force  stiffness  judged stiffer  expected")
    for sample, stiffer in answers.items():
        of_force, of_stiffness = (of[sample] / of[REFERENCE] - 1 for of in (force, stiffness))
        expected = NormalDist(0, noise * 2**0.5).cdf(of_force)
        print(f"{float(sample) - 1:+7.0%}  {of_force:+6.1%}  {of_stiffness:+9.1%}  "
              f"{sum(stiffer):8d} of {len(stiffer):2d}  {expected:8.0%}")


if __name__ == "__main__":
    main(sys.argv[1])
