#!/usr/bin/python3
"""Prints the tables of scripts/ablation from the metrics.json of its runs, and writes these to
ablation.json, by row and sequence."""

import argparse
import json
import pathlib
import sys

# Tables: heading, and for each value of a cell its key in metrics.json and its format.
TABLES = [
    ("t_err % / RLE % / share of frames held",
     [("t_err_percent", "{:.2f}"), ("rle_percent", "{:.2f}"), ("scale_held_share", "{:.2f}")]),
    ("t_err % with true lengths / median error of the filtered scale % / robust standard "
     "deviation of a single frame % / share within 2 sigma",
     [("t_err_true_length_percent", "{:.2f}"), ("scale_error_median_percent", "{:+.2f}"),
      ("scale_error_spread_percent", "{:.1f}"), ("scale_within_2_sigma", "{:.2f}")]),
]
TIME = "ms_scale_median"
BIAS = "height_bias_percent"


def number(value, form):
    return "–" if value is None else form.format(value)


def read(folder, row, sequence):
    file = folder / str(row) / sequence / "metrics.json"
    try:
        return json.loads(file.read_text())
    except FileNotFoundError:
        return None  # the run failed and printed the reason
    except (OSError, ValueError) as error:
        sys.exit(f"ablation_table.py: {file}: cannot be read ({error})")


def cell(metrics, columns):
    if metrics is None:
        return "failed"
    return " / ".join(number(metrics.get(key), form) for key, form in columns)


def line(cells):
    return "| " + " | ".join(cells) + " |"


def tables(labels, sequences, metrics):
    with_heights = [k for k, name in enumerate(sequences)
                    if any(row[k] and row[k].get(BIAS) is not None for row in metrics)]
    for number_of_table, (heading, columns) in enumerate(TABLES):
        yield heading + ":\n"
        last = (["scale stage, ms"] if number_of_table == 0 else
                ["bias of the plane %, " + sequences[k] for k in with_heights])
        yield line([""] + sequences + last)
        yield "|" + "---|" * (len(sequences) + 1 + len(last))
        for label, row in zip(labels, metrics):
            if number_of_table == 0:
                times = [m[TIME] for m in row if m]
                end = [number(sum(times) / len(times) if times else None, "{:.1f}")]
            else:
                end = [number((row[k] or {}).get(BIAS), "{:+.2f}") for k in with_heights]
            yield line([label] + [cell(m, columns) for m in row] + end)
        yield ""


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=pathlib.Path, help="holds ROW/SEQ/metrics.json, with the number of the row")
    parser.add_argument("--rows", nargs="+", required=True, metavar="LABEL",
                        help="labels of the rows 0, 1, 2 ...")
    parser.add_argument("--sequences", nargs="+", required=True, metavar="SEQ",
                        help="names of the sequences, in the order of the columns")
    arguments = parser.parse_args()
    metrics = [[read(arguments.folder, row, name) for name in arguments.sequences]
               for row in range(len(arguments.rows))]
    table = [[label, dict(zip(arguments.sequences, row))] for label, row in zip(arguments.rows, metrics)]
    (arguments.folder / "ablation.json").write_text(json.dumps(dict(table), indent=1) + "\n")
    print("\n".join(tables(arguments.rows, arguments.sequences, metrics)))


if __name__ == "__main__":
    main()
