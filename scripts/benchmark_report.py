#!/usr/bin/python3
"""Makes tables and plots of the measurements of scripts/benchmark in a folder."""

import argparse
import json
import os
import pathlib
import platform
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

# group, column of timing.csv (publish: of usage.csv; vo_rest: vo_total without the other stages of the
# odometry), label
STAGES = [
    ("image", "decode", "decode"),
    ("odometry", "vo_pyramid", "pyramid"),
    ("odometry", "vo_track", "track"),
    ("odometry", "vo_adjustment_wait", "wait for bundle adjustment"),
    ("odometry", "vo_align", "align patches"),
    ("odometry", "vo_pose", "pose"),
    ("odometry", "vo_detect", "detect"),
    ("odometry", "vo_triangulate", "triangulate"),
    ("odometry", "vo_rest", "rest"),
    ("odometry", "vo_total", "odometry, total"),
    ("mapping thread", "vo_bundle_adjustment", "bundle adjustment"),
    ("scale stage", "scale_delaunay", "Delaunay"),
    ("scale stage", "scale_gpe", "GPE"),
    ("scale stage", "scale_gpa", "GPA"),
    ("scale stage", "scale_direct", "direct plane estimation"),
    ("scale stage", "scale_filter", "filter"),
    ("scale stage", "scale_total", "scale stage, total"),
    ("messages", "publish", "publish"),
    ("frame", "total", "frame, total"),
]
BASELINE = [("baseline", name, f"OpenCV: {name}") for name in ("pyramid", "detect", "track", "total")]
COLOURS = {
    "image": "0.6", "odometry": "tab:blue", "mapping thread": "tab:purple",
    "scale stage": "tab:green", "messages": "tab:brown", "frame": "black", "baseline": "tab:orange",
}
VERDICTS = {True: "met", False: "missed", None: "not measured"}
MIN_SLOPE_FRAMES = 300  # fewer do not show the growth of memory
# Stages of the odometry whose times are measured; they run one after the other.
ODOMETRY_STAGES = ["vo_pyramid", "vo_track", "vo_adjustment_wait", "vo_align", "vo_pose", "vo_detect",
                   "vo_triangulate"]


def read_table(file):
    """Columns by name."""
    table = np.genfromtxt(file, delimiter=",", names=True, ndmin=1)
    return {name: table[name] for name in table.dtype.names}


def read_run(folder):
    """One run of benchmark_sequence: run.json, and the columns of timing.csv and usage.csv."""
    run = {"facts": json.loads((folder / "run.json").read_text())}
    run["time"] = read_table(folder / "timing.csv")
    run["usage"] = read_table(folder / "usage.csv")
    run["time"]["vo_rest"] = run["time"]["vo_total"] - sum(
        run["time"][name] for name in ODOMETRY_STAGES)
    run["time"]["publish"] = run["usage"]["publish"]
    return run


def figures(values):
    """Median and upper quantiles of times [ms]; None if there are none."""
    if len(values) == 0:
        return {"median": None, "p95": None, "p99": None, "max": None}
    quantiles = np.percentile(values, [50, 95, 99, 100])
    return dict(zip(("median", "p95", "p99", "max"), map(float, quantiles)))


def stage_figures(times):
    """Quantiles over the frames in which the stage ran, their share, and the mean over all frames."""
    ran = times[times > 0]
    return {**figures(ran), "share": len(ran) / len(times), "mean": float(np.mean(times))}


def run_figures(run):
    usage, frames = run["usage"], run["facts"]["frames"]
    cpu = 1e3 * usage["cpu_s"][-1] / frames
    decode, main_thread = np.mean(usage["decode_cpu"]), np.mean(usage["frame_cpu"])
    adjusted = np.mean(run["time"]["vo_bundle_adjustment"] > 0)
    return {
        **run["facts"],
        "frames_per_second": float(frames / usage["wall_s"][-1]),
        "cpu_ms_per_frame": float(cpu),
        "frame_cpu_ms_median": float(np.median(usage["frame_cpu"])),
        "decode_cpu_ms_per_frame": float(decode),
        # The remainder: the mapping thread, and a little for messages and for the measurement.
        "adjustment_cpu_ms": float((cpu - decode - main_thread) / adjusted) if adjusted else None,
        "features_median": float(np.median(usage["features"])),
        "peak_rss_mb": float(usage["peak_rss_mb"][-1]),
        "stages_ms": {name: stage_figures(run["time"][name]) for _, name, _ in STAGES},
    }


def memory_figures(run):
    """Memory over the drive: at ten frames, and its slope over the second half, when that is long
    enough."""
    rss = run["usage"]["rss_mb"]
    half = np.arange(len(rss) // 2, len(rss))
    slope = 1000 * np.polyfit(half, rss[half], 1)[0] if len(half) >= MIN_SLOPE_FRAMES else None
    places = np.linspace(0, len(rss) - 1, 11)[1:].astype(int)
    return {
        "frames": len(rss),
        "rss_mb": [{"frame": int(i), "rss_mb": float(rss[i])} for i in places],
        "growth_mb_per_1000_frames": None if slope is None else float(slope),
        "peak_rss_mb": float(run["usage"]["peak_rss_mb"][-1]),
    }


def ratio_figures(run, baseline):
    """Processor time of the pipeline without decoding, divided by that of the OpenCV baseline.
    Processor time, unlike wall time, hardly depends on other load of the machine."""
    usage = run["usage"]
    per_frame = 1e3 * usage["cpu_s"][-1] / len(usage["cpu_s"]) - np.mean(usage["decode_cpu"])
    # The pipeline detects corners only in keyframes.
    detected = run["time"]["vo_detect"][1:] > 0
    same_detections = baseline["cpu"] - np.where(detected, 0, baseline["detect"] / baseline["total"] *
                                              baseline["cpu"])
    return {
        "median": float(np.median(usage["frame_cpu"][1:]) / np.median(baseline["cpu"])),
        "mean_with_adjustment": float(per_frame / np.mean(baseline["cpu"])),
        "mean_with_adjustment_and_its_detections": float(per_frame / np.mean(same_detections)),
    }


def graph_figures(file, images):
    """Figures of one run of the nodelets, and its latencies [ms] from image to odometry."""
    table = read_table(file)
    frames = np.flatnonzero(np.isfinite(table["frame"]))
    if len(frames) == 0:
        raise ValueError(f"{file}: no vo/frame was received")

    # Instant at which the player is due to publish each image: linear in the stamp, with the offset of
    # the image that arrived with the least delay. So a late arrival counts as latency.
    rate = float(file.stem.split("_")[1])
    due = table["stamp"] / rate
    due += np.nanmin(table["image"] - due)

    def latency(what):
        times = 1e3 * (table[what] - due)
        return times[np.isfinite(times)]

    known = frames[table["cpu_s"][frames] > 0]  # the process may be unknown in the first frames
    cpu = np.diff(table["cpu_s"][known[[0, -1]]])[0] / max(len(known) - 1, 1) if len(known) else None
    return {
        "rate": rate,
        "images": images,
        "frames": len(frames),
        "dropped": images - len(frames),
        "scale_messages": int(np.isfinite(table["scale"]).sum()),
        "odometry_messages": int(np.isfinite(table["odometry"]).sum()),
        "latency_ms": figures(latency("odometry")),
        "latency_to_frame_ms": figures(latency("frame")),
        "latency_to_image_ms": figures(latency("image")),
        "cpu_ms_per_frame": None if cpu is None else float(1e3 * cpu),
        "peak_rss_mb": float(np.max(table["peak_rss_mb"])),
    }, latency("odometry")


def threshold_figures(report):
    """Compares the figures with the performance targets for images of 1241x376 on an idle machine."""
    one, two, memory = report["one_core"], report["two_cores"], report["memory"]
    ratio = report["pipeline_over_baseline"]
    pipeline_ms = one["cpu_ms_per_frame"] - one["decode_cpu_ms_per_frame"]
    thresholds = [
        ("pipeline over OpenCV baseline, median frame", ratio["median"], "<=", 0.5),
        ("pipeline over OpenCV baseline, mean with bundle adjustment", ratio["mean_with_adjustment"],
         "<=", 0.6),
        ("processor time without decoding [ms a frame]", pipeline_ms, "<=", 5.5),
        ("one core, decoding included [frames/s]", one["frames_per_second"], ">=", 60),
        ("peak memory [MiB]", max(memory["peak_rss_mb"], two["peak_rss_mb"]), "<=", 120),
        ("growth of memory [MiB in 1000 frames]", memory["growth_mb_per_1000_frames"], "<=", 5),
    ]
    for graph in report["graph"]:
        if graph["rate"] == 1:
            thresholds += [
                ("latency at the bag's rate, p99 [ms]", graph["latency_ms"]["p99"], "<=", 15),
                ("latency at the bag's rate, maximum [ms]", graph["latency_ms"]["max"], "<=", 25)]
        if graph["rate"] == 15:
            thresholds.append(("images dropped at 15 times the bag's rate", graph["dropped"], "<=", 0))
    return [
        {"what": what, "value": value, "sign": sign, "limit": limit,
         "met": None if value is None else value <= limit if sign == "<=" else value >= limit}
        for what, value, sign, limit in thresholds
    ]


def machine(load):
    model = platform.processor() or platform.machine()
    for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            model = line.split(":", 1)[1].strip()
            break
    return {"processor": model, "cores": os.cpu_count(), "load_at_start": load}


def number(value, digits=3):
    """With so many significant digits; integers without decimals."""
    if value is None:
        return "–"
    if isinstance(value, int) or abs(value) >= 10 ** (digits - 1):
        return f"{value:.0f}"
    if abs(value) < 0.0005:
        return "0"
    return f"{value:.{max(digits - 1 - int(np.floor(np.log10(abs(value)))), 0)}f}" \
        if abs(value) >= 0.01 else f"{value:.3f}"


def markdown(headings, rows):
    """A table that is also aligned as plain text."""
    rows = [[cell if isinstance(cell, str) else number(cell) for cell in row] for row in rows]
    widths = [max(len(row[i]) for row in [headings, *rows]) for i in range(len(headings))]

    def line(row):
        rest = (cell.rjust(width) for cell, width in zip(row[1:], widths[1:]))
        return "| " + " | ".join([row[0].ljust(widths[0]), *rest]) + " |"

    marks = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    return "\n".join([line(headings), "| " + " | ".join(marks) + " |", *map(line, rows)])


def introduction(report):
    host = report["machine"]
    return (f"{host['processor']}, {host['cores']} cores, load {host['load_at_start']} at the start "
            "(0: idle).")


def benchmark_text(name, report):
    one, two, graph = report["one_core"], report["two_cores"], report["graph"]
    ratio, baseline, memory = report["pipeline_over_baseline"], report["baseline_ms"], report["memory"]
    parts = [f"# {name}: {one['width']}x{one['height']}, {one['frames']} frames",
             introduction(report),
             "## Stages, one core [ms]",
             "All threads on one core, so the bundle adjustment delays the frame after its keyframe. "
             "Times of a stage are over the frames in which it ran. *frame, total* is odometry and "
             "scale stage, without decoding, messages and the mapping thread."]

    def cells(stage):
        return [stage[key] for key in ("median", "p95", "p99", "max")]

    rows = [[f"{group}: {label}" if group != label.split(",")[0] else label, *cells(stage),
             f"{100 * stage['share']:.0f} %"]
            for group, column, label in STAGES for stage in [one["stages_ms"][column]]]
    rows += [[label, *cells(baseline[column]), "100 %"] for _, column, label in BASELINE]
    parts.append(markdown(["stage", "median", "p95", "p99", "max", "ran in"], rows))
    parts += ["## Pipeline over the OpenCV baseline",
              f"The baseline is OpenCV alone on the same images in the same run, with "
              f"{number(baseline['points_median'])} points a frame (median): pyramid, corners, "
              "Lucas-Kanade in every frame. The ratios are of processor time.",
              markdown(["pipeline over baseline", "ratio"],
                       [["median frame over median frame, without the mapping thread",
                         ratio["median"]],
                        ["mean over mean, with the bundle adjustment",
                         ratio["mean_with_adjustment"]],
                        ["the same, the baseline detecting corners only in frames in which the "
                         "pipeline does", ratio["mean_with_adjustment_and_its_detections"]]])]
    parts += ["## Throughput and memory",
              markdown(["run", "frames/s", "processor ms a frame", "of it decoding",
                        "its main thread, median", "odometry median ms", "scale stage median ms",
                         "peak MiB"],
                       [[f"{run['cores']} core{'s' if run['cores'] > 1 else ''}",
                         run["frames_per_second"], run["cpu_ms_per_frame"],
                         run["decode_cpu_ms_per_frame"], run["frame_cpu_ms_median"],
                         run["stages_ms"]["vo_total"]["median"],
                         run["stages_ms"]["scale_total"]["median"], run["peak_rss_mb"]]
                        for run in (one, two)]),
              "*Its main thread*: processor time of odometry and scale stage. Peaks: the run on "
              "one core also keeps the points for the baseline.",
              f"Memory over {memory['frames']} frames, the sequence forwards and backwards in "
              f"turn: {', '.join(number(place['rss_mb']) for place in memory['rss_mb'])} MiB after "
              f"each tenth, {number(memory['peak_rss_mb'])} MiB at most; over the second half it "
              f"grows by {number(memory['growth_mb_per_1000_frames'])} MiB in 1000 frames."]
    if graph:
        parts += ["## Nodelets",
                  "Latency: wall time from an image's stamp, on the clock of the bag player, until another "
                  "node receives its metric odometry. *image*: until that node receives the image "
                  "itself, median; more than a millisecond means that the machine is busy. "
                  "Dropped: images without a vo/frame. Processor time and memory are the nodelet "
                  "manager's.",
                  markdown(["rate", "images", "dropped", "odometry", "latency median ms", "p95",
                            "p99", "max", "image", "processor ms a frame", "peak MiB"],
                           [[f"{run['rate']:g} x", run["images"], run["dropped"],
                             run["odometry_messages"], *cells(run["latency_ms"]),
                             run["latency_to_image_ms"]["median"],
                             run["cpu_ms_per_frame"], run["peak_rss_mb"]] for run in graph])]
    parts += ["## Targets", "For images of 1241x376 on an idle machine.",
              markdown(["", "measured", "target", ""],
                       [[target["what"], target["value"], f"{target['sign']} {target['limit']}",
                         VERDICTS[target["met"]]] for target in report["targets"]])]
    return "\n\n".join(parts) + "\n"


def write(file, text):
    temporary = file.with_name(file.name + ".tmp")
    try:
        temporary.write_text(text)
        temporary.replace(file)
    finally:
        temporary.unlink(missing_ok=True)


def save(figure, file):
    temporary = file.with_name(file.name + ".tmp")
    try:
        figure.savefig(temporary, dpi=110, format="png", bbox_inches="tight")
        temporary.replace(file)
    finally:
        temporary.unlink(missing_ok=True)
        plt.close(figure)


def draw_stages(folder, name, run, baseline, report):
    """As the paper's Fig. 5, all stages and the baseline."""
    rows = [(group, label, run["time"][column]) for group, column, label in STAGES]
    rows += [(group, label, baseline[column]) for group, column, label in BASELINE]
    rows = [(group, label, times[times > 0]) for group, label, times in rows]
    rows = [row for row in rows if len(row[2])]
    figure, axes = plt.subplots(figsize=(11, 0.36 * len(rows) + 1.5))
    boxes = axes.boxplot([times for _, _, times in rows], vert=False, whis=(5, 95), widths=0.6,
                         patch_artist=True, medianprops={"color": "white", "linewidth": 2},
                         flierprops={"marker": ".", "markersize": 3, "alpha": 0.3})
    for box, flier, (group, _, _) in zip(boxes["boxes"], boxes["fliers"], rows):
        box.set(facecolor=COLOURS[group], edgecolor=COLOURS[group])
        flier.set(markeredgecolor=COLOURS[group], markerfacecolor=COLOURS[group])
    axes.set_xscale("log")
    # Times below a microsecond are not shown.
    low = max(min(np.percentile(times, 5) for _, _, times in rows), 1e-3)
    axes.set_xlim(left=0.7 * low)
    axes.xaxis.set_major_formatter(matplotlib.ticker.FormatStrFormatter("%g"))
    axes.set_yticks(range(1, len(rows) + 1))
    axes.set_yticklabels([f"{label}   {np.median(times):.2g} ms" for _, label, times in rows])
    for tick, (group, _, _) in zip(axes.get_yticklabels(), rows):
        tick.set_color(COLOURS[group])
    axes.invert_yaxis()
    axes.grid(True, axis="x", which="both", linewidth=0.3)
    groups = dict.fromkeys(group for group, _, _ in rows)
    axes.legend([plt.Rectangle((0, 0), 1, 1, color=COLOURS[group]) for group in groups],
                list(groups), loc="upper left", bbox_to_anchor=(1.01, 1), frameon=False)
    ratio = report["pipeline_over_baseline"]
    axes.set(xlabel="time of a frame in which the stage ran [ms]: box quartiles, whiskers 5 and "
             "95 %; beside the name the median",
             title=f"{name}, {run['facts']['width']}x{run['facts']['height']}, one core: "
             f"frame {ratio['median']:.2f} x the baseline, {ratio['mean_with_adjustment']:.2f} x with the "
             "bundle adjustment (processor time)")
    save(figure, folder / "stages.png")


def draw_latency(folder, name, latencies, report):
    figure, axes = plt.subplots(figsize=(8, 5))
    axes.boxplot([times for _, times in latencies], whis=(5, 95), widths=0.5,
                 flierprops={"marker": ".", "markersize": 3, "alpha": 0.4})
    axes.set_xticks(range(1, len(latencies) + 1))
    axes.set_xticklabels([f"{rate:g} x\n{graph['dropped']} of {graph['images']} dropped"
                          for (rate, _), graph in zip(latencies, report["graph"])])
    axes.set_ylim(bottom=0)
    axes.grid(True, axis="y", linewidth=0.4)
    axes.set(xlabel="rate of the bag", ylabel="image stamp to metric odometry [ms]",
             title=f"{name}: latency in the nodelets' graph\n(box quartiles, whiskers 5 and 95 %)")
    save(figure, folder / "latency.png")


def draw_memory(folder, name, run):
    figure, axes = plt.subplots(figsize=(8, 4))
    axes.plot(run["usage"]["rss_mb"], color="tab:blue", label="in use")
    axes.plot(run["usage"]["peak_rss_mb"], color="0.5", linestyle="--", label="peak so far")
    axes.set_ylim(bottom=0)
    axes.grid(True, linewidth=0.4)
    axes.legend(loc="lower right")
    axes.set(xlabel="frame", ylabel="memory of the process [MiB]",
             title=f"{name}: memory over the drive")
    save(figure, folder / "memory.png")


def write_report(folder, stem, report, text):
    write(folder / f"{stem}.json", json.dumps(report, indent=2, allow_nan=False) + "\n")
    write(folder / f"{stem}.md", text)
    print(text)


def report_benchmark(folder, load):
    name = folder.resolve().name
    one, two = read_run(folder / "one_core"), read_run(folder / "two_cores")
    long_drive = read_run(folder / "long_drive")
    baseline = read_table(folder / "one_core" / "baseline.csv")
    files = sorted(folder.glob("graph_*.csv"), key=lambda file: float(file.stem.split("_")[1]))
    graphs = [graph_figures(file, one["facts"]["frames"]) for file in files]
    report = {
        "machine": machine(load),
        "one_core": run_figures(one),
        "two_cores": run_figures(two),
        "baseline_ms": {**{column: stage_figures(baseline[column]) for _, column, _ in BASELINE},
                     "points_median": float(np.median(baseline["points"]))},
        "pipeline_over_baseline": ratio_figures(one, baseline),
        "memory": memory_figures(long_drive),
        "graph": [graph for graph, _ in graphs],
    }
    report["targets"] = threshold_figures(report)
    draw_stages(folder, name, one, baseline, report)
    draw_memory(folder, name, long_drive)
    latencies = [(graph["rate"], times) for graph, times in graphs]
    if latencies:
        draw_latency(folder, name, latencies, report)
    write_report(folder, "benchmark", report, benchmark_text(name, report))


# series: title, the varied option or property, remark
SERIES = {
    "features": ("Features", "tracker/cell_size", "The side of the square that holds one corner."),
    "image": ("Image size", "pixels", "The same images, resized, with cells of a size that gives about as many features."),
    "window": ("Window", "bundle_adjustment/window", "Twice as many keyframes are kept."),
}


def varied_value(series, run):
    """The value of the varied option or property in one run of a series."""
    if series == "image":
        return f"{run['width']}x{run['height']}"
    return run["settings"].split()[0].split("=")[1]


def report_growth(folder, load):
    name = folder.resolve().name
    report = {"machine": machine(load), "series": {}}
    for series in SERIES:
        runs = []
        for place in sorted((folder / "growth" / series).iterdir()):
            runs.append(run_figures(read_run(place)))
        report["series"][series] = runs
    parts = [f"# {name}: growth", introduction(report),
             "One core; each series varies one setting. Stages: median wall time in milliseconds over "
             "the frames in which the stage ran. Main thread (odometry and scale stage, median), "
             "adjustment (mapping thread, mean per bundle adjustment) and frame (total, mean, "
             "decoding included): processor time in milliseconds, which hardly depends on other load "
             "of the machine."]
    columns = ["vo_pyramid", "vo_track", "vo_align", "vo_pose", "vo_detect", "scale_delaunay",
               "scale_gpa", "scale_direct"]
    labels = {column: label for _, column, label in STAGES}
    for series, (title, what, how) in SERIES.items():
        rows = []
        for run in report["series"][series]:
            rows.append([varied_value(series, run), run["features_median"],
                         *(run["stages_ms"][column]["median"] for column in columns),
                         run["frame_cpu_ms_median"], run["adjustment_cpu_ms"],
                         run["cpu_ms_per_frame"], run["peak_rss_mb"]])
        parts += [f"## {title}", how,
                  markdown([what, "features", *(labels[column] for column in columns),
                            "main thread", "adjustment", "frame", "peak MiB"], rows)]
    write_report(folder, "growth", report, "\n\n".join(parts) + "\n")


def report_micro(folder):
    """One row per benchmark and one column per size, named as by Google Benchmark; one table for all
    benchmarks of the same sizes."""
    report = json.loads((folder / "micro.json").read_text())
    host = report["context"]
    runs_of = {}
    for run in report["benchmarks"]:
        if run.get("run_type") != "aggregate":
            name, *sizes = run["name"].replace("/manual_time", "").split("/")
            # Manual times are wall times; otherwise use processor time, which depends less on other
            # load of the machine.
            time = run["real_time" if "manual_time" in run["name"] else "cpu_time"]
            to_ms = {"ns": 1e-6, "us": 1e-3, "ms": 1.0, "s": 1e3}[run["time_unit"]]
            runs_of.setdefault(name, []).append((", ".join(sizes), time * to_ms))
    text = [f"Processor milliseconds of one call. {host['num_cpus']} cores of "
            f"{host['mhz_per_cpu']} MHz, load {host['load_avg'][0]:.2f} at the start."]
    tables = {}
    for name, runs in runs_of.items():
        sizes = tuple(size for size, _ in runs)
        tables.setdefault(sizes, []).append([name, *(time for _, time in runs)])
    text += [markdown(["", *sizes], rows) for sizes, rows in tables.items()]
    write(folder / "micro.md", "\n\n".join(text) + "\n")
    print("\n\n".join(text))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=pathlib.Path, metavar="DIR",
                        help="results of scripts/benchmark for one sequence")
    parser.add_argument("--growth", action="store_true", help="report the runs in DIR/growth")
    parser.add_argument("--micro", action="store_true", help="report DIR/micro.json")
    parser.add_argument("--load", type=float, default=0.0,
                        help="load average of the machine before the first run")
    arguments = parser.parse_args()
    try:
        if arguments.micro:
            report_micro(arguments.folder)
        elif arguments.growth:
            report_growth(arguments.folder, arguments.load)
        else:
            report_benchmark(arguments.folder, arguments.load)
    except (OSError, ValueError, KeyError, IndexError) as error:
        sys.exit(f"benchmark_report.py: {arguments.folder}: cannot be reported ({error})")


if __name__ == "__main__":
    main()
