#!/usr/bin/python3
"""Draws trajectory.png, scale.png, timing.png (with timing.csv) and track.png (with track.geojson) into result
folders."""

import argparse
import json
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import matplotlib.patches  # noqa: E402
import matplotlib.path  # noqa: E402
import matplotlib.ticker  # noqa: E402
import numpy as np  # noqa: E402

GROUND_TRUTH, ESTIMATE, RAW, TARGET = "0.35", "tab:blue", "tab:green", "tab:red"
PLOTS = ("trajectory", "scale", "timing", "track")
STATUS_COLOURS = {"ok": "tab:green", "held": "tab:orange", "unknown": "0.7", "lost": "tab:red"}
SOURCE_COLOURS = {"road": "tab:cyan", "speed": "tab:purple", "road and speed": "tab:blue"}


def read_positions(file):
    """N x 3 [m]."""
    return np.loadtxt(file, ndmin=2).reshape(-1, 3, 4)[:, :, 3]


def read_table(file):
    """Columns by name."""
    return np.atleast_1d(np.genfromtxt(file, delimiter=",", names=True, dtype=None, encoding="utf-8"))


def read_map(folder):
    """East and north [m] of what track.geojson holds, by name: track, fixes and outliers are N x 2, "95 % corridor" is a list of
    rings. None without the file."""
    file = folder / "track.geojson"
    if not file.exists():
        return None
    shapes = {one["properties"]["name"]: one["geometry"]["coordinates"] for one in json.loads(file.read_text())["features"]}
    origin = np.array(shapes["track"][0][:2])
    scale = np.radians(6371e3) * np.array([np.cos(np.radians(origin[1])), 1])

    def metres(places):
        return (np.array([place[:2] for place in places]).reshape(-1, 2) - origin) * scale
    rings = [metres(ring) for polygon in shapes.pop("95 % corridor") for ring in polygon]
    return {"95 % corridor": rings, **{name: metres(places) for name, places in shapes.items()}}


def draw_map(axes, shapes, estimate, measured, outlier):
    """What read_map() returns, in these colours."""
    path = matplotlib.path.Path.make_compound_path(*map(matplotlib.path.Path, shapes["95 % corridor"]))
    axes.add_patch(matplotlib.patches.PathPatch(path, color=estimate, alpha=0.25, linewidth=0, label="95 % corridor"))
    axes.plot(*shapes["track"].T, color=estimate, linewidth=1.2, label="track")
    axes.plot(*shapes["fixes"].T, ".", color=measured, markersize=3, label="fixes")
    axes.plot(*shapes["outliers"].T, "x", color=outlier, markersize=4, label="outliers")
    axes.set_aspect("equal", "datalim")
    axes.set(xlabel="east [m]", ylabel="north [m]")


def save(figure, file):
    """Writes a PNG; the file is complete or missing."""
    temporary = file.with_suffix(".tmp")
    try:
        figure.savefig(temporary, dpi=150, format="png", bbox_inches="tight")
        temporary.replace(file)
    finally:
        temporary.unlink(missing_ok=True)
        plt.close(figure)


def legend_above(axes, columns, **arguments):
    """A legend above the axes, where it covers no data."""
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.3, ncol=columns,
                frameon=False, fontsize="small", handlelength=1.5, columnspacing=1.2, **arguments)


def draw_trajectory(file, estimate, ground_truth, title):
    """Top view, as the paper's Fig. 4: equal axes, and a figure in the proportions of the drive,
    with an aspect ratio of at most 5:2."""
    every = [estimate] if ground_truth is None else [estimate, ground_truth]
    every = np.concatenate(every)[:, [0, 2]]
    low, high = every.min(axis=0), every.max(axis=0)
    span = np.maximum(high - low, 1.0)
    span = 1.1 * np.maximum(span, 0.4 * span.max())
    figure, axes = plt.subplots(figsize=tuple(7 * span / span.max()))
    if ground_truth is not None:
        axes.plot(ground_truth[:, 0], ground_truth[:, 2], color=GROUND_TRUTH, linestyle="--",
                  label="ground truth")
        axes.plot(*ground_truth[-1, [0, 2]], "s", color=GROUND_TRUTH, markersize=5,
                  label="ground truth end")
    axes.plot(estimate[:, 0], estimate[:, 2], color=ESTIMATE, label="estimate")
    axes.plot(*estimate[0, [0, 2]], "o", color="black", markersize=5, label="start")
    axes.plot(*estimate[-1, [0, 2]], "s", color=ESTIMATE, markersize=5, label="end")
    axes.set_aspect("equal")
    middle = (low + high) / 2
    axes.set_xlim(middle[0] - span[0] / 2, middle[0] + span[0] / 2)
    axes.set_ylim(middle[1] - span[1] / 2, middle[1] + span[1] / 2)
    axes.grid(True, linewidth=0.4)
    axes.set(xlabel="x, right [m]", ylabel="z, forward [m]")
    axes.set_title(title, loc="left", fontsize="medium")
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1), borderaxespad=0, frameon=False)
    save(figure, file)


def draw_bar(axes, edges, states, colours, bottom):
    """A bar with the state of each frame, from it to the next one."""
    for name, colour in colours.items():
        chosen = np.flatnonzero(states == name)
        if len(chosen):
            axes.broken_barh([(edges[i], edges[i + 1] - edges[i]) for i in chosen], (bottom, 0.03),
                             color=colour, linewidth=0, transform=axes.get_xaxis_transform(),
                             label=f"{name}: {len(chosen)} frames")


def draw_scale(file, scale, camera_height, name, title):
    """The paper's Fig. 3, over time: the unfiltered camera height,
    converted to metres with the filtered scale (height * scale / raw_scale), the +-2 sigma
    band of the filter around the height, which is given or learned from speeds, and the distribution of
    the unfiltered heights; below, the scale and its status."""
    figure, grid = plt.subplots(2, 2, figsize=(10, 7), sharey="row", sharex="col",
                                gridspec_kw={"width_ratios": [4, 1], "hspace": 0.22,
                                             "wspace": 0.05})
    time = scale["stamp"] - scale["stamp"][0]
    known = scale["status"] != "unknown"
    # With speeds alone, the raw scale does not come from a plane; without a known height it has no unit.
    measured = known & (scale["raw_scale"] > 0) & (scale["source"] != "speed") & (scale["camera_height"] > 0)
    height = np.where(known & (scale["camera_height"] > 0), scale["camera_height"], np.nan)
    filtered = np.where(known, scale["scale"], np.nan)
    sigma = np.where(known, scale["sigma"], np.nan)
    heights = (height * filtered)[measured] / scale["raw_scale"][measured]

    axes = grid[0, 0]
    relative = 2 * sigma / np.where(known, scale["scale"], np.nan)
    axes.plot(time[measured], heights, ".", color=RAW, markersize=3, label="unfiltered")
    axes.fill_between(time, height * (1 - relative), height * (1 + relative),
                      color=ESTIMATE, alpha=0.25, linewidth=0, label=rf"{name}, $\pm 2\sigma$")
    learned = (scale["camera_height_sigma"] > 0) & np.isin(scale["source"], ("speed", "both")).any()
    if learned.any():
        band = 2 * np.where(learned, scale["camera_height_sigma"], np.nan)
        axes.fill_between(time, height - band, height + band, color=TARGET, alpha=0.25, linewidth=0,
                          label=r"learned, $\pm 2\sigma$")
    if camera_height > 0:
        axes.axhline(camera_height, color=TARGET, linewidth=1, label=f"given: {camera_height:g} m")
    axes.set(ylabel="camera height [m]")
    if len(heights):
        low, high = np.percentile(heights, [1, 99])
        levels = [low, high] + [camera_height] * (camera_height > 0)
        margin = 0.5 * max(high - low, 0.02 * high)
        axes.set_ylim(min(levels) - margin, max(levels) + margin)
    legend_above(axes, 4)
    figure.suptitle(title, x=0.125, ha="left", fontsize="medium", y=0.96)

    axes = grid[0, 1]
    if len(heights):
        axes.hist(heights, bins=np.linspace(*axes.get_ylim(), 40), orientation="horizontal",
                  color=RAW, alpha=0.7)
        median = np.median(heights)
        deviation = 1.4826 * np.median(np.abs(heights - median))  # robust standard deviation
        axes.axhline(median, color="black", linewidth=1,
                     label=f"median {median:.3f} m\nstd. dev. {deviation:.3f} m")
        legend_above(axes, 1)
    if camera_height > 0:
        axes.axhline(camera_height, color=TARGET, linewidth=1)
    axes.set_xlabel("frames")
    axes.xaxis.set_major_locator(matplotlib.ticker.MaxNLocator("auto", steps=[1, 2, 5, 10],
                                                            integer=True))
    axes.tick_params(labelbottom=True)

    axes = grid[1, 0]
    axes.plot(time[measured], scale["raw_scale"][measured], ".", color=RAW, markersize=3,
              label="unfiltered")
    axes.plot(time, filtered, color=ESTIMATE, label=name)
    axes.fill_between(time, filtered - 2 * sigma, filtered + 2 * sigma, color=ESTIMATE,
                      alpha=0.25, linewidth=0, label=r"$\pm 2\sigma$")
    for number, change in enumerate(np.flatnonzero(np.diff(scale["map_id"]))):
        axes.axvline(time[change], color="black", linewidth=0.8, linestyle=":",
                     label="" if number else "new map")
    edges = np.append(time, time[-1])
    draw_bar(axes, edges, np.where(scale["vo_status"] == "lost", "lost", scale["status"]), STATUS_COLOURS, 0)
    if np.isin(scale["source"], ["speed", "both"]).any():
        sources = np.where(scale["source"] == "both", "road and speed", scale["source"])
        draw_bar(axes, edges, sources, SOURCE_COLOURS, 0.04)
    axes.set(xlabel="time [s]", ylabel="scale [m per unit of the odometry]")
    if np.any(known):
        # Limits from percentiles: the band is wide in the first frames of a map.
        lower, upper = filtered - 2 * sigma, filtered + 2 * sigma
        low = np.percentile(np.append(lower[known], scale["raw_scale"][measured]), 4)
        high = np.percentile(np.append(upper[known], scale["raw_scale"][measured]), 96)
        low = min(low, np.min(filtered[known]))
        high = max(high, np.max(filtered[known]))
        margin = 0.1 * max(high - low, 0.02 * high)
        axes.set_ylim(low - margin, high + margin)
    grid[1, 1].legend(*axes.get_legend_handles_labels(), loc="upper left", borderaxespad=0,
                      bbox_to_anchor=(-0.1, 0.9), frameon=False, fontsize="small")
    grid[1, 1].axis("off")
    for axes in (grid[0, 0], grid[0, 1], grid[1, 0]):
        axes.grid(True, linewidth=0.4)
    grid[1, 0].set_xlim(0, max(time[-1], 1.0))
    save(figure, file)


def draw_timing(file, timing, title):
    """The paper's Fig. 5: a row for each stage, over the frames in which it ran and was timed (of
    evaluate_bag about one per second)."""
    stages = [(name, timing[name][timing[name] > 0], len(timing)) for name in timing.dtype.names
              if name != "frame" and np.any(timing[name] > 0)]
    figure, axes = plt.subplots(figsize=(8, 0.9 + 0.29 * len(stages)))
    axes.boxplot([ran for _, ran, _ in stages], vert=False, whis=(5, 95), showfliers=False,
                 widths=0.6, medianprops={"color": TARGET})
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(matplotlib.ticker.FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(matplotlib.ticker.LogFormatter())
    axes.set_yticks(range(1, len(stages) + 1))
    axes.set_yticklabels([name.replace("_", " ") for name, _, _ in stages], fontsize="small")
    axes.invert_yaxis()
    axes.grid(True, axis="x", linewidth=0.4)
    axes.set_xlabel("time [ms]: box quartiles, line median, whiskers 5 and 95 %", fontsize="small")
    right_axis = axes.twinx()
    right_axis.set_ylim(axes.get_ylim())
    right_axis.set_yticks(axes.get_yticks())
    right_axis.set_yticklabels([f"{np.median(ran):11.3f} {100 * len(ran) / frames:5.0f} %"
                                for _, ran, frames in stages], fontsize="small", family="monospace")
    right_axis.tick_params(length=0)
    axes.set_title(title, loc="left", fontsize="medium")
    axes.text(1.01, 1.01, f"{'median [ms]':>11} {'timed':>7}", transform=axes.transAxes,
              fontsize="small", family="monospace")
    save(figure, file)


def draw_track(file, shapes, title):
    figure, axes = plt.subplots(figsize=(8, 6))
    draw_map(axes, shapes, ESTIMATE, RAW, TARGET)
    axes.grid(True, linewidth=0.4)
    axes.set_title(title, loc="left", fontsize="medium", pad=20)
    legend_above(axes, 4)
    save(figure, file)


def draw(folder):
    metrics = json.loads((folder / "metrics.json").read_text())
    name = folder.resolve().name
    estimate = read_positions(folder / "poses.txt")
    has_ground_truth = (folder / "ground_truth.txt").exists()
    ground_truth = read_positions(folder / "ground_truth.txt") if has_ground_truth else None
    for plot in PLOTS:  # of a previous run
        (folder / (plot + ".png")).unlink(missing_ok=True)
    title = f"{name}: estimated length {metrics['length_m']:.1f} m"
    if metrics["t_err_percent"] is not None:
        title += (f"\ntranslation {metrics['t_err_percent']:.2f} %, "
                  f"rotation {metrics['r_err_deg_per_m']:.4f} deg/m")
    draw_trajectory(folder / "trajectory.png", estimate, ground_truth, title)
    draw_scale(folder / "scale.png", read_table(folder / "scale.csv"), metrics["camera_height_m"],
               "smoothed" if metrics.get("smoothed") else "filtered", name)
    if (folder / "timing.csv").exists():
        draw_timing(folder / "timing.png", read_table(folder / "timing.csv"), name)
    if (folder / "track.geojson").exists():
        draw_track(folder / "track.png", read_map(folder), name)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=pathlib.Path, metavar="DIR",
                        help="a result folder")
    arguments = parser.parse_args()
    for folder in arguments.folders:
        try:
            draw(folder)
        except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
            sys.exit(f"plot_run.py: {folder}: cannot be drawn ({error})")


if __name__ == "__main__":
    main()
