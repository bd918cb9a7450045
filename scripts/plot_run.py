#!/usr/bin/python3
"""Draws trajectory.png, scale.png, timing.png (with timing.csv) and errors.png (with ground truth)
into the result folders of run_sequence and evaluate_bag."""

import argparse
import csv
import json
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

TRUTH, ESTIMATE, RAW, TARGET = "0.35", "tab:blue", "tab:green", "tab:red"
STATUS_COLOURS = {"ok": "tab:green", "held": "tab:orange", "unknown": "0.7", "lost": "tab:red"}


def read_positions(file):
    """N x 3 [m]."""
    return np.loadtxt(file, ndmin=2).reshape(-1, 3, 4)[:, :, 3]


def read_table(file):
    """Columns by name; numbers where every cell is one."""
    with open(file, newline="") as stream:
        rows = list(csv.DictReader(stream))
    table = {}
    for name in rows[0]:
        cells = [row[name] for row in rows]
        try:
            table[name] = np.array(cells, dtype=float)
        except ValueError:
            table[name] = np.array(cells)
    return table


def save(figure, file):
    figure.tight_layout()
    temporary = file.with_name(file.name + ".tmp")
    try:
        figure.savefig(temporary, dpi=110, format="png")
        temporary.replace(file)
    finally:
        temporary.unlink(missing_ok=True)
        plt.close(figure)


def draw_trajectory(folder, estimate, truth, title):
    """Top view, as the paper's Fig. 4."""
    figure, axes = plt.subplots(figsize=(8, 8))
    if truth is not None:
        axes.plot(truth[:, 0], truth[:, 2], color=TRUTH, linestyle="--", label="ground truth")
        axes.plot(*truth[-1, [0, 2]], "s", color=TRUTH, label="true end")
    axes.plot(estimate[:, 0], estimate[:, 2], color=ESTIMATE, label="estimate")
    axes.plot(*estimate[0, [0, 2]], "o", color="black", label="start")
    axes.plot(*estimate[-1, [0, 2]], "s", color=ESTIMATE, label="end")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.grid(True, linewidth=0.4)
    axes.set(xlabel="x, right [m]", ylabel="z, forward [m]", title=title)
    axes.legend()
    save(figure, folder / "trajectory.png")


def draw_status(axes, scale):
    """A strip at the bottom: what state each frame was in."""
    state = np.where(scale["vo_status"] == "lost", "lost", scale["status"])
    for name, colour in STATUS_COLOURS.items():
        if np.any(state == name):
            axes.broken_barh([(frame - 0.5, 1) for frame in scale["frame"][state == name]],
                             (0, 0.03), color=colour, linewidth=0,
                             transform=axes.get_xaxis_transform(), label=f"{name} (strip)")


def draw_scale(folder, scale, camera_height, title):
    """As the paper's Fig. 3: each frame's own camera height in the trajectory's metres, with the
    filtered scale and its band, and the heights' distribution; below, the scale and its status."""
    figure, grid = plt.subplots(2, 2, figsize=(12, 8), sharey="row",
                                gridspec_kw={"width_ratios": [3, 1]})
    frames = scale["frame"]
    known = scale["status"] != "unknown"
    measured = known & (scale["raw_scale"] > 0)
    filtered = np.where(known, scale["scale"], np.nan)
    sigma = np.where(known, scale["sigma"], np.nan)
    heights = camera_height * scale["scale"][measured] / scale["raw_scale"][measured]

    axes = grid[0, 0]
    relative = 2 * sigma / np.where(known, scale["scale"], np.nan)
    axes.fill_between(frames, camera_height * (1 - relative), camera_height * (1 + relative),
                      color=ESTIMATE, alpha=0.25, linewidth=0, label="filtered, 2 sigma")
    axes.plot(frames[measured], heights, ".", color=RAW, markersize=3, label="of the frame alone")
    axes.axhline(camera_height, color=TARGET, linewidth=1, label=f"given, {camera_height:g} m")
    axes.set(ylabel="scaled camera height [m]", title=title)
    if len(heights):
        low, high = np.percentile(heights, [1, 99])
        margin = 0.5 * max(high - low, 0.02 * camera_height)
        axes.set_ylim(min(low, camera_height) - margin, max(high, camera_height) + margin)
    axes.legend(loc="upper right", fontsize="small")

    axes = grid[0, 1]
    if len(heights):
        axes.hist(heights, bins=np.linspace(*axes.get_ylim(), 40), orientation="horizontal",
                  color=RAW, alpha=0.7)
        median = np.median(heights)
        spread = 1.4826 * np.median(np.abs(heights - median))  # a normal distribution's sigma
        axes.axhline(median, color="black", linewidth=1,
                     label=f"median {median:.3f} m\nspread {spread:.3f} m")
        axes.legend(loc="upper right", fontsize="small")
    axes.axhline(camera_height, color=TARGET, linewidth=1)
    axes.set(xlabel="frames", title=f"distribution, {len(heights)} frames")

    axes = grid[1, 0]
    axes.plot(frames[measured], scale["raw_scale"][measured], ".", color=RAW, markersize=3,
              label="raw")
    axes.fill_between(frames, filtered - 2 * sigma, filtered + 2 * sigma, color=ESTIMATE,
                      alpha=0.25, linewidth=0, label="filtered, 2 sigma")
    axes.plot(frames, filtered, color=ESTIMATE, label="filtered")
    for change in np.flatnonzero(np.diff(scale["map_id"])):
        axes.axvline(frames[change] + 0.5, color="black", linewidth=0.8, linestyle=":")
    draw_status(axes, scale)
    axes.set(xlabel="frame", ylabel="scale [m per VO unit]")
    if np.any(known):
        # The band, but for the few frames at a map's start in which it is still wide.
        lower, upper = filtered - 2 * sigma, filtered + 2 * sigma
        low = np.percentile(np.append(lower[known], scale["raw_scale"][measured]), 4)
        high = np.percentile(np.append(upper[known], scale["raw_scale"][measured]), 96)
        low = min(low, np.min(filtered[known]))
        high = max(high, np.max(filtered[known]))
        margin = 0.1 * max(high - low, 0.02 * high)
        axes.set_ylim(low - margin, high + margin)
    grid[1, 1].legend(*axes.get_legend_handles_labels(), loc="upper left", fontsize="small")
    grid[1, 1].axis("off")
    for axes in (grid[0, 0], grid[0, 1], grid[1, 0]):
        axes.grid(True, linewidth=0.4)
    for axes in grid[:, 0]:
        axes.set_xlim(frames[0] - 0.5, frames[-1] + 0.5)
    save(figure, folder / "scale.png")


def draw_timing(folder, timing, title):
    """As the paper's Fig. 5. A stage counts in the frames in which it ran."""
    stages, times = [], []
    for name, values in timing.items():
        ran = values[values > 0]
        if name == "frame" or len(ran) == 0:
            continue
        name = name.replace("bundle_adjustment", "bundle adj.").replace("adjustment_wait", "wait")
        stages.append(name.replace("_", "\n", 1) +
                      f"\n{np.median(ran):.2g} ms\n{100 * len(ran) / len(values):.0f} %")
        times.append(ran)
    figure, axes = plt.subplots(figsize=(12, 6))
    axes.boxplot(times, whis=(5, 95), showfliers=False)
    axes.set_xticks(range(1, len(stages) + 1))
    axes.set_xticklabels(stages, fontsize="small")
    axes.set_ylim(bottom=0)
    axes.grid(True, axis="y", linewidth=0.4)
    axes.set(ylabel="time [ms]", title=f"{title}: box quartiles, whiskers 5 and 95 %; below the "
             "median and the share of frames in which the stage ran")
    save(figure, folder / "timing.png")


def draw_errors(folder, metrics, title):
    """Error against segment length, the KITTI devkit's and the short ones."""
    figure, (translation, rotation) = plt.subplots(1, 2, figsize=(12, 5))
    for key, marker, label in (("by_short_length", ".", "10 ... 80 m"),
                               ("by_length", "o", "100 ... 800 m (devkit)")):
        errors = metrics[key] or []
        lengths = [error["length_m"] for error in errors]
        for axes, member in ((translation, "t_err_percent"), (rotation, "r_err_deg_per_m")):
            if lengths:
                axes.plot(lengths, [error[member] for error in errors], marker=marker,
                          color=ESTIMATE, label=label)
    translation.set(ylabel="translation error [%]", title=title)
    rotation.set(ylabel="rotation error [deg/m]")
    for axes in (translation, rotation):
        axes.set_xlabel("segment length [m]")
        axes.set_ylim(bottom=0)
        axes.set_xlim(left=0)
        axes.grid(True, linewidth=0.4)
        if axes.lines:
            axes.legend()
    save(figure, folder / "errors.png")


def figure_text(metrics, key, form):
    return "-" if metrics[key] is None else form.format(metrics[key])


def draw(folder):
    metrics = json.loads((folder / "metrics.json").read_text())
    name = folder.resolve().name
    estimate = read_positions(folder / "poses.txt")
    has_truth = (folder / "ground_truth.txt").exists()
    truth = read_positions(folder / "ground_truth.txt") if has_truth else None
    draw_trajectory(folder, estimate, truth,
                    f"{name}: {metrics['length_m']:.1f} m, "
                    f"t_err {figure_text(metrics, 't_err_percent', '{:.2f} %')}, "
                    f"r_err {figure_text(metrics, 'r_err_deg_per_m', '{:.4f} deg/m')}")
    draw_scale(folder, read_table(folder / "scale.csv"), metrics["camera_height_m"], name)
    for picture in ("timing.png", "errors.png"):
        (folder / picture).unlink(missing_ok=True)  # of an earlier run
    if (folder / "timing.csv").exists():
        draw_timing(folder, read_table(folder / "timing.csv"), name)
    if has_truth:
        draw_errors(folder, metrics, name)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=pathlib.Path, metavar="DIR",
                        help="a result folder")
    for folder in parser.parse_args().folders:
        try:
            draw(folder)
        except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
            sys.exit(f"plot_run.py: {folder}: cannot be drawn ({error})")


if __name__ == "__main__":
    main()
