#!/usr/bin/python3
"""The paper's Tables I and II and Figs. 3, 4 and 5 over whole KITTI sequences, for scripts/report.

report_paper.py PART DIR   reads the results of run_sequence in DIR/PART/00 to 10, writes DIR/PART/report.md,
                           fig3.png, fig4.png and fig5.png. PART: kitti or paths (rendered)
"""

import json
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import report_tables  # noqa: E402
from plot_run import ESTIMATE, GROUND_TRUTH, RAW, TARGET, read_positions, read_table, save  # noqa: E402
from report_figures import KITTI_PARTS, kitti, rounded  # noqa: E402

HEIGHT_SEQUENCES = ("02", "05")  # of the paper's Fig. 3
START_M = 50                     # of a drive, that determines the constant scale in Fig. 4 [m]
STAGES = (("MVO", "tab:blue"), ("GPE", "tab:orange"), ("GPA", "tab:green"), ("direct", "tab:red"))


def heights(folder):
    """Frames with a measurement, the unfiltered and the filtered camera height [m] in them: the height in units
    of the odometry, times the median scale of the map."""
    scale = read_table(folder / "scale.csv")
    height = json.loads((folder / "metrics.json").read_text())["camera_height_m"]
    frames = np.flatnonzero((scale["status"] != "unknown") & (scale["raw_scale"] > 0))
    filtered, raw = scale["scale"][frames], scale["raw_scale"][frames]
    maps = scale["map_id"][frames]
    median = np.array([np.median(filtered[maps == number]) for number in maps]) if len(maps) else maps
    return frames, height * median / raw, height * median / filtered


def draw_heights(folders, file):
    """Fig. 3: the distribution of the unfiltered heights about the filtered ones, and both over the frames."""
    chosen = [folder for folder in folders if folder.name in HEIGHT_SEQUENCES]
    chosen = chosen or sorted(folders, key=lambda folder: -len(read_positions(folder / "poses.txt")))[:2]
    figure, grid = plt.subplots(len(chosen), 2, figsize=(11, 3.2 * len(chosen)), squeeze=False,
                                gridspec_kw={"width_ratios": [1, 3], "hspace": 0.35})
    for row, folder in zip(grid, chosen):
        frames, raw, filtered = heights(folder)
        if len(frames):
            deviation = 100 * (raw / filtered - 1)
            row[0].hist(deviation, bins=np.linspace(*np.percentile(deviation, [1, 99]), 40), color=RAW)
            low, high = np.percentile(np.append(raw, filtered), [1, 99])
            row[1].set_ylim(low - 0.3 * (high - low), high + 0.3 * (high - low))
        row[0].set(xlabel="height of a frame − filtered height [%]", ylabel="frames")
        row[1].plot(frames, raw, ".", color=RAW, markersize=2, label="unfiltered")
        row[1].plot(frames, filtered, color=TARGET, label="filtered")
        row[1].set(xlabel="frame", ylabel="camera height [m]")
        row[1].set_title(f"{folder.name}: height in units of the odometry, times one scale", loc="left",
                         fontsize="medium")
        row[1].legend(frameon=False, fontsize="small")
        row[1].grid(True, linewidth=0.4)
    save(figure, file, False)


def path_length(positions):
    """Up to each position [m]."""
    return np.append(0, np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1)))


def with_one_scale(unscaled, metric):
    """The trajectory without scale recovery: a constant scale from the first START_M metres."""
    end = np.searchsorted(path_length(metric), START_M)
    length = path_length(unscaled)[min(end, len(unscaled) - 1)]
    return unscaled * (path_length(metric)[min(end, len(metric) - 1)] / length) if length > 0 else unscaled


def draw_trajectories(folders, file):
    """Fig. 4: top views."""
    columns = min(len(folders), 4)
    rows = -(-len(folders) // columns)
    figure, grid = plt.subplots(rows, columns, figsize=(3.6 * columns, 3.6 * rows), squeeze=False)
    for axes in grid.flat[len(folders):]:
        axes.axis("off")
    for axes, folder in zip(grid.flat, folders):
        truth, metric, unscaled = (read_positions(folder / f"{name}.txt")
                                   for name in ("ground_truth", "poses", "poses_unscaled"))
        for positions, colour, style, label in (
                (with_one_scale(unscaled, metric), RAW, "-", "odometry with one scale"),
                (truth, GROUND_TRUTH, "--", "ground truth"), (metric, ESTIMATE, "-", "with scale recovery")):
            axes.plot(positions[:, 0], positions[:, 2], color=colour, linestyle=style, linewidth=1.2, label=label)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(folder.name, loc="left", fontsize="medium")
        axes.grid(True, linewidth=0.4)
    grid[-1, 0].set(xlabel="x [m]", ylabel="z [m]")
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="lower center", ncol=3, frameon=False,
                  bbox_to_anchor=(0.5, 0.92))
    save(figure, file, False)


def draw_run_time(figures, file):
    """Fig. 5: the median time of each stage."""
    names = [name for name in sorted(figures) if name != "run"]
    figure, axes = plt.subplots(figsize=(1.5 + 0.9 * len(names), 3.4))
    width = 0.8 / len(STAGES)
    for k, (stage, colour) in enumerate(STAGES):
        axes.bar(np.arange(len(names)) + (k - (len(STAGES) - 1) / 2) * width,
                 [figures[name]["run_time_ms"][stage] for name in names], width, color=colour, label=stage)
    axes.set_xticks(range(len(names)))
    axes.set_xticklabels(names)
    axes.set(xlabel="sequence", ylabel="median time [ms]")
    axes.grid(True, axis="y", linewidth=0.4)
    axes.legend(frameon=False, ncol=len(STAGES), loc="lower left", bbox_to_anchor=(0, 1))
    save(figure, file, False)


def main():
    part, out = sys.argv[1], pathlib.Path(sys.argv[2])
    folder = out / part
    try:
        figures = rounded(kitti(folder))
        if not figures:
            raise ValueError("no results")
        folders = [folder / name for name in sorted(figures)]
        draw_heights(folders, folder / "fig3")
        draw_trajectories(folders, folder / "fig4")
        draw_run_time(figures, folder / "fig5")
    except (OSError, ValueError, KeyError, IndexError) as error:
        sys.exit(f"report_paper.py: {folder}: cannot be read ({error!r})")
    text = report_tables.paper_page(KITTI_PARTS[part], report_tables.paper_tables(figures))
    (folder / "report.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
