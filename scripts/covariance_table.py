#!/usr/bin/python3
"""Prints the consistency of the published covariances over result folders, one line each.

NEES: mean normalised estimation error squared of the relative pose over 10, 50 and 100 m, per degree
of freedom: 1 is consistent, more is overconfident. 2 sigma: share of the errors of its six components
within two standard deviations: 0.95 is consistent. first pose m: distance travelled until the first
metric pose; first scale: error of the scale over the published standard deviation in the first frame
that has a scale and a known true scale.
"""

import argparse
import json
import math
import pathlib
import sys

LENGTHS = (10, 50, 100)


def values(folder):
    """Per column; None where the drive has no value."""
    metrics = json.loads((folder / "metrics.json").read_text())
    lengths = {entry["length_m"]: entry for entry in metrics["covariance_by_length"] or []}
    cells = []
    for key in ("nees_per_dof", "within_2_sigma"):
        cells += [lengths[length][key] if length in lengths else None for length in LENGTHS]
    return cells + [metrics["first_metric_pose_m"], metrics["first_scale_error_sigmas"]]


def mean(column):
    known = [value for value in column if value is not None]
    return sum(known) / len(known) if known else None


def share(column, condition):
    """Of all drives; one without a value does not meet the condition."""
    return sum(value is not None and condition(value) for value in column) / len(column)


def text(value):
    return "-" if value is None else f"{value:.2f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=pathlib.Path, metavar="DIR",
                        help="a result folder of run_sequence or evaluate_scenarios")
    folders = parser.parse_args().folders
    drives = []
    for folder in folders:
        try:
            drives.append((folder.resolve().name, values(folder)))
        except (OSError, ValueError, KeyError) as error:
            sys.exit(f"covariance_table.py: {folder}/metrics.json: cannot be read ({error})")
    columns = list(zip(*(cells for _, cells in drives)))
    rows = [["drive"] + [f"NEES {length} m" for length in LENGTHS] +
            [f"2 sigma {length} m" for length in LENGTHS] + ["first pose m", "first scale"]]
    rows += [[name] + [text(value) for value in cells] for name, cells in drives]
    rows.append(["mean"] + [text(mean(column)) for column in columns[:-2]] + ["", ""])
    widths = [max(len(cell) for cell in column) for column in zip(*rows)]
    for cells in rows:
        rest = (cell.rjust(width) for cell, width in zip(cells[1:], widths[1:]))
        print("  ".join([cells[0].ljust(widths[0]), *rest]).rstrip())
    print(f"first metric pose within 3 m: {share(columns[-2], lambda m: m <= 3):.2f} of "
          f"{len(drives)} drives; first scale with a known true scale within 2 sigma: "
          f"{share(columns[-1], lambda z: math.fabs(z) <= 2):.2f}")


if __name__ == "__main__":
    main()
