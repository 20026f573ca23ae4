"""Presents the trials of a two-interval forced choice on a haptic device: python3 ask.py FOLDER PARTICIPANT [DEVICE]

FOLDER has trials.csv, with the names of the two samples of each trial, and a scene SAMPLE.toml for each sample. Writes
PARTICIPANT.csv, with a line NUMBER,FIRST,SECOND,ANSWER for each trial (the trial's number, its samples in order, and
which of these was stiffer, 1 or 2), and a recording of the haptic session in every interval."""

import csv
import subprocess
import sys
from pathlib import Path

SECONDS = "4"  # duration of an interval, s


def main(folder, participant, device="haply"):
    recordings = Path(folder) / participant
    recordings.mkdir(exist_ok=True)
    answers = recordings.with_suffix(".csv")
    if answers.exists() and answers.stat().st_size > 0:
        sys.exit(f"{answers} has answers already: give another name")
    with open(f"{folder}/trials.csv") as file:
        trials = list(csv.reader(file))
    with open(answers, "w") as results:
        for number, trial in enumerate(trials, 1):
            for interval, sample in enumerate(trial, 1):
                print(f"Trial {number} of {len(trials)}, sample {interval}: press into it", flush=True)
                name = recordings / f"{number}-{interval}"
                command = ["palpate", "run", f"{folder}/{sample}.toml", "--haptics", device, "--seconds", SECONDS]
                command += ["--record", f"{name}.palpate", "--out", name]
                status = subprocess.run(command, stdout=subprocess.DEVNULL).returncode
                if status != 0:
                    sys.exit(status)
            answer = ""
            while answer not in ("1", "2"):
                answer = input("Which was stiffer, 1 or 2? ")
            results.write(f"{number},{trial[0]},{trial[1]},{answer}\n")
            results.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
