#!/usr/bin/python3
"""metrics_table.py DIR...: prints one table over the metrics.json of result folders."""

import json
import pathlib
import sys

# heading, key in metrics.json, format
COLUMNS = [
    ("frames", "frames", "d"), ("tracked", "tracked_frames", "d"), ("lost", "lost_events", "d"),
    ("length m", "length_m", ".1f"), ("rle %", "rle_percent", ".2f"), ("t_err %", "t_err_percent", ".2f"),
    ("r_err deg/m", "r_err_deg_per_m", ".4f"), ("t_err true length %", "t_err_true_length_percent", ".2f"),
    ("t_err short %", "t_err_short_percent", ".2f"), ("2 sigma", "scale_within_2_sigma", ".2f"),
    ("ms median", "ms_total_median", ".1f")]


def row(folder):
    metrics = json.loads((folder / "metrics.json").read_text())
    return [folder.resolve().name, *("-" if metrics[key] is None else format(metrics[key], form)
                                     for _, key, form in COLUMNS)]


def main():
    rows = [["sequence", *(heading for heading, _, _ in COLUMNS)]]
    for folder in map(pathlib.Path, sys.argv[1:]):
        try:
            rows.append(row(folder))
        except (OSError, ValueError, KeyError) as error:
            sys.exit(f"metrics_table.py: {folder}/metrics.json: cannot be read ({error})")
    widths = [max(map(len, column)) for column in zip(*rows)]
    for cells in rows:
        print("  ".join([cells[0].ljust(widths[0]), *map(str.rjust, cells[1:], widths[1:])]))


if __name__ == "__main__":
    main()
