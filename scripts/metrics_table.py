#!/usr/bin/python3
"""Prints one table over the metrics.json of result folders."""

import argparse
import json
import pathlib
import sys

# heading, key in metrics.json, format
COLUMNS = [
    ("frames", "frames", "{:d}"),
    ("tracked", "tracked_frames", "{:d}"),
    ("lost", "lost_events", "{:d}"),
    ("length m", "length_m", "{:.1f}"),
    ("rle %", "rle_percent", "{:.2f}"),
    ("t_err %", "t_err_percent", "{:.2f}"),
    ("r_err deg/m", "r_err_deg_per_m", "{:.4f}"),
    ("t_err true length %", "t_err_true_length_percent", "{:.2f}"),
    ("t_err short %", "t_err_short_percent", "{:.2f}"),
    ("2 sigma", "scale_within_2_sigma", "{:.2f}"),
    ("ms median", "ms_total_median", "{:.1f}"),
]


def row(folder):
    metrics = json.loads((folder / "metrics.json").read_text())
    cells = [folder.resolve().name]
    for _, key, form in COLUMNS:
        value = metrics[key]
        cells.append("-" if value is None else form.format(value))
    return cells


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=pathlib.Path, metavar="DIR",
                        help="a result folder of run_sequence")
    folders = parser.parse_args().folders
    rows = [["sequence"] + [heading for heading, _, _ in COLUMNS]]
    for folder in folders:
        try:
            rows.append(row(folder))
        except (OSError, ValueError, KeyError) as error:
            sys.exit(f"metrics_table.py: {folder}/metrics.json: cannot be read ({error})")
    widths = [max(len(cell) for cell in column) for column in zip(*rows)]
    for cells in rows:
        rest = (cell.rjust(width) for cell, width in zip(cells[1:], widths[1:]))
        print("  ".join([cells[0].ljust(widths[0]), *rest]))


if __name__ == "__main__":
    main()
