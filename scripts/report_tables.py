"""The figures and tables that scripts/report derives from docs/results.json.

derived(results) returns the results with two more parts: `summary` (single figures) and `tables` (Markdown).
"""

import math
import statistics

from paper_results import FRAMES, LENGTHS as PAPER_LENGTHS, PAPER, ROTATION, TRANSLATION

# Folder: name in docs, description. Other drives have the name of their folder.
DRIVES = {
    "kitti_00_0000_0199": ("00", "KITTI odometry 00, frames 0–199"),
    "kitti_05_0100_0159": ("05", "KITTI odometry 05, frames 100–159"),
    "kitti_06_0000_0050": ("06", "KITTI odometry 06, frames 0–50"),
    "kitti_raw_0926_0039": ("0039", "KITTI raw 2011_09_26 drive 0039"),
    "rendered_04": ("rendered_04", "rendered street, path of KITTI 04"),
    "rendered_09_traffic": ("rendered_09", "rendered street with traffic and a stop"),
    "low_1": ("low_1", "rendered, camera at 0.5 m, level"),
    "low_2": ("low_2", "rendered, camera at 0.5 m, pitched by 5.7°"),
}
DESCRIPTIONS = dict(DRIVES.values())
LENGTHS = (10, 50, 100)
WITHIN_2_SIGMA = 0.9545  # share of a normal distribution
QUANTILE = 1.96          # of 95 % of a normal distribution, both sides


def number(value, form=".2f"):
    """A figure as text; the format is only for floating-point numbers."""
    if value is None:
        return "–"
    return format(value, form).replace("-", "−") if isinstance(value, float) else str(value)


def table(headings, rows):
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines).replace("| --- ", "|---") \
        .replace("--- |", "---|")


def drives(part):
    """Its drives by name, without the description of the run; those of DRIVES first, in that order."""
    order = list(DESCRIPTIONS)
    names = sorted(set(part) - {"run"},
                   key=lambda name: (order.index(name) if name in order else len(order), name))
    return {name: part[name] for name in names}


def mean(values):
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


def interval(values):
    """Mean and its standard error over drives."""
    known = [value for value in values if value is not None]
    if len(known) < 2:
        return number(mean(known))
    centre = mean(known)
    variance = sum((value - centre) ** 2 for value in known) / (len(known) - 1)
    return f"{number(centre)} ± {math.sqrt(variance / len(known)):.2f}"


def is_exact(drive):
    """True when the ground truth of the drive is exact, so that its covariance is not added."""
    return all(drive[f"nees_{length}"] == drive[f"nees_exact_{length}"] for length in LENGTHS)


def groups(results):
    """Groups of drives for the covariance: title and the figures of each drive."""
    for part, measured, exact in (("sequences", "KITTI drives", "rendered drives"),
                                  ("variants", "variants of KITTI drives", "variants of a rendered drive"),
                                  ("scenarios", None, "scenarios")):
        for title, wanted in ((measured, False), (exact, True)):
            chosen = [drive for drive in drives(results[part]).values() if is_exact(drive) == wanted]
            if chosen:
                yield title, chosen


def sequence_table(part):
    rows = [[DESCRIPTIONS.get(name, name), f"{d['frames']} ({d['lost_events']})",
             number(d["gt_length_m"], ".0f"), number(d["rle_percent"]), number(d["t_err_percent"]),
             number(d["r_err_deg_per_m"], ".4f"), number(d["scale_within_2_sigma"])]
            for name, d in drives(part).items()]
    return table(["sequence", "frames (lost)", "length m", "RLE %", "t_err %", "r_err deg/m", "2σ"],
                 rows)


def drive_table(part):
    keys = [("frames", ""), ("tracked_frames", ""), ("gt_length_m", ".1f"), ("rle_percent", ".2f"),
            ("t_err_percent", ".2f"), ("t_err_short_percent", ".2f"), ("t_err_true_length_percent", ".3f"),
            ("scale_within_2_sigma", ".2f"), ("scale_held_share", ".2f"), ("first_metric_pose_m", ".1f"),
            ("first_scale_error_sigmas", ".2f"), *((f"nees_{length}", ".2f") for length in LENGTHS),
            *((f"within_{length}", ".2f") for length in LENGTHS)]
    headings = ["drive", "frames", "tracked", "length m", "RLE %", "t_err %", "t_err short %",
                "t_err true length %", "2σ", "held", "first pose m", "first scale σ",
                *(f"NEES {length} m" for length in LENGTHS), *(f"2σ {length} m" for length in LENGTHS)]
    return table(headings, [[name, *(number(drive[key], form) for key, form in keys)]
                            for name, drive in drives(part).items()])


def covariance_table(results):
    chosen = list(groups(results))
    chosen.append(("all", [drive for _, group in chosen for drive in group]))
    rows = [[title, len(group), *(interval([drive[f"{key}_{length}"] for drive in group])
                                  for key in ("nees", "within") for length in LENGTHS)]
            for title, group in chosen]
    return table(["drives", "number", *(f"NEES {length} m" for length in LENGTHS),
                  *(f"within 2σ, {length} m" for length in LENGTHS)], rows)


def independent_segments(drive, length):
    """Number of segments that do not overlap; those of the metrics begin every metre."""
    return max(1, int(drive["gt_length_m"] // length))


def nees_interval(drive, length):
    """95 % interval of the mean NEES per degree of freedom of a consistent covariance: that of chi^2, by
    Wilson and Hilferty's approximation."""
    variance = 2 / (9 * 6 * independent_segments(drive, length))
    return [(1 - variance + sign * QUANTILE * math.sqrt(variance)) ** 3 for sign in (-1, 1)]


def share_interval(drive, length):
    """95 % interval of the share within two standard deviations of a consistent covariance."""
    deviation = math.sqrt(WITHIN_2_SIGMA * (1 - WITHIN_2_SIGMA) / (6 * independent_segments(drive, length)))
    return [min(WITHIN_2_SIGMA + sign * QUANTILE * deviation, 1.0) for sign in (-1, 1)]


def interval_cell(value, interval):
    """Bold outside the interval."""
    if value is None:
        return number(value)
    low, high = interval
    text = f"{number(value)} ({number(low)}–{number(high)})"
    return text if low <= value <= high else f"**{text}**"


def consistency_table(part):
    rows = [[name, *(interval_cell(drive[f"nees_{length}"], nees_interval(drive, length)) for length in LENGTHS),
             *(interval_cell(drive[f"within_{length}"], share_interval(drive, length)) for length in LENGTHS)]
            for name, drive in drives(part).items()]
    return table(["drive", *(f"NEES {length} m" for length in LENGTHS),
                  *(f"within 2σ, {length} m" for length in LENGTHS)], rows)


def ablation_cell(run):
    if run is None:
        return ""
    text = "no scale" if run["rle_percent"] is None else number(run["rle_percent"])
    return f"**{text}**" if run["violated"] else text


def component_cell(drive):
    """In brackets: the scenario does not show clearly that the component is needed."""
    return drive["component"] if drive.get("disabled", {"clearly": True})["clearly"] else f"({drive['component']})"


def ablation_table(part):
    rows = [[f"`{name}`", ablation_cell(d["default"]), number(d["default"]["held"]),
             number(d["default"]["within_2_sigma"]),
             *(ablation_cell(d.get(key)) for key in ("paper", "features_only", "direct_only", "disabled")),
             component_cell(d)] for name, d in drives(part).items()]
    return table(["scenario", "RLE after start", "held", "2σ", "`paper_literal`", "features only", "direct only",
                  "without the component", "component"], rows)


def component_table(part):
    names = list(drives(part["rows"][0]["drives"]))
    keys = ("t_err_percent", "rle_percent", "scale_within_2_sigma")
    biased = [name for name in names if part["rows"][0]["drives"][name]["height_bias_percent"] is not None]
    rows = [[row["label"], *(" / ".join(number(row["drives"][name][key]) for key in keys) for name in names),
             *(number(row["drives"][name]["height_bias_percent"], "+.2f") for name in biased)]
            for row in part["rows"]]
    return table(["", *names, *(f"plane bias, {name}" for name in biased)], rows)


def fault_table(part):
    keys = [("count", ""), ("detected_s", ".1f"), ("metric_frames", ""), ("excess_path_m", ".2f"),
            ("error_m", ".1f"), ("sigma_m", ".1f")]
    return table(["fault", "number", "detected s", "metric frames", "excess path m", "error m", "σ m"],
                 [[kind.replace("_", " "), *("never" if fault[key] is None else number(fault[key], form)
                                             for key, form in keys)]
                  for kind, fault in sorted(part["kinds"].items())])


def stage_table(part):
    by_drive = drives(part)
    stages = [{row[0]: row[1:] for row in drive["stages"]} for drive in by_drive.values()]
    rows = [[label, *(number(value, ".2f" if value < 1 else ".1f")
                      for drive in stages for value in drive[label][:2]),
             number(100 * stages[0][label][2], ".0f") + " %"] for label in stages[0]]
    return table(["stage", *(f"{name} {what}" for name in by_drive for what in ("median", "p95")),
                  f"frames ({next(iter(by_drive))})"], rows)


BENCHMARK_ROWS = [
    ("processor time per frame on one core, ms", "cpu_ms_per_frame", ".1f"),
    ("of which PNG decoding, ms", "decode_cpu_ms_per_frame", ".1f"),
    ("ratio to OpenCV alone", "ratio_mean", ".2f"),
    ("the same of the median frame, without bundle adjustment", "ratio_median", ".2f"),
    ("ratio to OpenCV alone, corners only in keyframes", "ratio_same_detections", ".2f"),
    ("frames/s offline, two cores, decoding included", "frames_per_second", ".0f"),
    ("peak memory, MiB", "peak_rss_mb", ".0f"),
]


def benchmark_table(part):
    by_drive = drives(part)
    return table(["", *by_drive], [[label, *(number(drive[key], form) for drive in by_drive.values())]
                                   for label, key, form in BENCHMARK_ROWS])


def latency_table(part):
    by_drive = drives(part)
    rates = next(iter(by_drive.values()))["rates"]
    rows = [[rate, *(number(drive["rates"][rate][key], ".1f") for drive in by_drive.values()
                     for key in ("median_ms", "p99_ms", "max_ms", "cpu_ms_per_frame")),
             *(drive["rates"][rate]["dropped"] for drive in by_drive.values())]
            for rate in sorted(rates, key=float)]
    return table(["playback rate", *(f"{name} {what}" for name in by_drive
                                     for what in ("median", "p99", "max", "processor ms")),
                  *(f"{name} dropped" for name in by_drive)], rows)


def growth_table(part):
    keys = [("features", ".0f"), ("frame_cpu_ms_median", ".1f"), ("adjustment_cpu_ms", ".1f"),
            ("cpu_ms_per_frame", ".1f"), ("peak_rss_mb", ".0f")]
    return table(["", "features", "odometry + scale, median", "one bundle adjustment, mean",
                  "whole frame, mean", "peak MiB"],
                 [[row["setting"], *(number(row[key], form) for key, form in keys)] for row in part["rows"]])


def height_table(part):
    def cell(value):
        return "too short" if value is None else f"{value[0]:.3f} ± {value[1]:.3f}"
    return table(["drive", "true height m", "from trajectory m", "from length m"],
                 [[DESCRIPTIONS.get(name, name), number(d["true_m"]), cell(d["trajectory"]), cell(d["length"])]
                  for name, d in drives(part).items()])


def relative_error_percent(length, true_length):
    return 100 * abs(length - true_length) / true_length


def own(part, key):
    """Our figures of the KITTI sequences, and those of the complete ones."""
    values = [part.get(name, {}).get(key) for name in FRAMES]
    return values, [value if name in part and part[name]["frames"] == frames else None
                    for value, (name, frames) in zip(values, FRAMES.items())]


def paper_table(part, columns, forms):
    """A row for each KITTI sequence, and the means of each column over all of its sequences and over those for
    which the last two columns, the paper's and ours, have a figure. columns: heading, values of 00 to 10, and
    those in the means."""
    rows = []
    for i, (name, frames) in enumerate(FRAMES.items()):
        is_part = name in part and part[name]["frames"] != frames
        label = f"{name} ({part[name]['frames']} of {frames} frames)" if is_part else name
        rows.append([label, *(number(values[i], form) for (_, values, _), form in zip(columns, forms))])
    compared = [None not in pair for pair in zip(columns[-2][2], columns[-1][2])]
    means, both = ["mean"], [f"mean where {PAPER} and ours"]
    for (_, _, values), form in zip(columns, forms):
        chosen = [value for value, use in zip(values, compared) if use]
        means.append(number(mean(values), form))
        both.append(number(None if None in chosen else mean(chosen), form))
    return table(["sequence", *(heading for heading, _, _ in columns)], [*rows, means, both])


def length_table(part):
    """Table I."""
    true_m, paper_m = zip(*(PAPER_LENGTHS.get(name, (None, None)) for name in FRAMES))
    paper_rle = [None if true is None else relative_error_percent(length, true)
                 for true, length in zip(true_m, paper_m)]
    columns = [("ground truth of the paper m", true_m, true_m), (f"{PAPER} m", paper_m, paper_m),
               ("ground truth m", *own(part, "gt_length_m")), ("ours m", *own(part, "length_m")),
               (f"{PAPER} RLE %", paper_rle, paper_rle), ("ours RLE %", *own(part, "rle_percent"))]
    return paper_table(part, columns, [".1f", ".1f", ".1f", ".1f", ".2f", ".2f"])


def error_table(part, published, key, form):
    """Table II: one of its two errors."""
    columns = [*((system, values, values) for system, values in published.items()), ("ours", *own(part, key))]
    return paper_table(part, columns, [form] * len(columns))


def run_time_table(part):
    stages = list(next(iter(drives(part).values()))["run_time_ms"])
    return table(["sequence", *(f"{stage} ms" for stage in stages), "peak MiB"],
                 [[name, *(number(drive["run_time_ms"][stage], ".2f") for stage in stages),
                   number(drive["peak_rss_mb"], ".0f")] for name, drive in sorted(drives(part).items())])


def paper_tables(part):
    return {"lengths": length_table(part),
            "translation_errors": error_table(part, TRANSLATION, "t_err_percent", ".2f"),
            "rotation_errors": error_table(part, ROTATION, "r_err_deg_per_m", ".4f"),
            "run_time": run_time_table(part)}


def paper_page(description, tables):
    """The text of DIR/PART/report.md of scripts/report."""
    return "\n\n".join([
        "# The paper's tables and figures", description,
        "A mean is the plain mean of a column's sequences; a sequence that is not complete has no part in it.",
        "## Table I: length of the trajectory", tables["lengths"],
        "Lengths of the paper with its two columns exchanged, and its relative errors (RLE) recomputed from them.",
        "## Table II: translation error, %", tables["translation_errors"],
        "## Table II: rotation error, deg/m", tables["rotation_errors"],
        "## Fig. 3: camera height", "![camera height](fig3.png)",
        "## Fig. 4: trajectories", "![trajectories](fig4.png)",
        "## Fig. 5: run time", "![run time](fig5.png)",
        "Median of the frames in which a stage runs:", tables["run_time"]]) + "\n"


def run_table(results):
    return table(["part", "version", "date", "machine", "command"],
                 [[part, run["version"], run["date"], run["machine"], f"`{run['command']}`"]
                  for part, run in ((part, results[part]["run"]) for part in sorted(results))])


def summary(results):
    sets = {part: list(drives(results[part]).values()) for part in ("sequences", "variants", "scenarios")
            if part in results}
    every = [drive for part in sets.values() for drive in part]
    figures = {"drives": len(every)}
    if every:
        for figure, key, limit in (("pose_within_3_m", "first_metric_pose_m", 3),
                                   ("scale_within_2_sigma", "first_scale_error_sigmas", 2)):
            figures[figure] = sum(d[key] is not None and abs(d[key]) <= limit for d in every)
    for part, members in sets.items():
        figures[part] = {"drives": len(members)}
        for key in ("rle_percent", "t_err_percent", "t_err_short_percent", "first_metric_pose_m",
                    "t_err_true_length_percent"):
            known = [d[key] for d in members if d[key] is not None]
            figures[part].update({
                key: mean(known), key + "_drives": len(known), key + "_min": min(known, default=None),
                key + "_max": max(known, default=None),
                key + "_median": statistics.median(known) if known else None})
    if "ablation" in results:
        runs = drives(results["ablation"])
        figures["ablation"] = {
            "failed_" + key: sum(bool(d[key]["violated"]) for d in runs.values())
            for key in ("default", "paper", "features_only", "direct_only")}
        both = [(d["features_only"]["rle_percent"], d["direct_only"]["rle_percent"]) for d in runs.values()
                if not d["features_only"]["violated"] and not d["direct_only"]["violated"]]
        without = [d["disabled"]["clearly"] for d in runs.values() if "disabled" in d]
        figures["ablation"].update(
            both=len(both), features_mean=mean([f for f, _ in both]), direct_mean=mean([d for _, d in both]),
            direct_better=sum(d < f for f, d in both), components=len(without),
            components_clear=sum(without))
    return figures


TABLES = {  # name: parts that it needs, function of these
    "sequences": (["sequences"], sequence_table),
    "sequence_drives": (["sequences"], drive_table),
    "consistency": (["sequences"], consistency_table),
    "variants": (["variants"], drive_table),
    "scenarios": (["scenarios"], drive_table),
    "ablation": (["ablation"], ablation_table),
    "components": (["components"], component_table),
    "faults": (["faults"], fault_table),
    "stages": (["benchmark"], stage_table),
    "benchmark": (["benchmark"], benchmark_table),
    "latency": (["benchmark"], latency_table),
    "growth": (["growth"], growth_table),
    "heights": (["heights"], height_table),
}


def derived(results):
    tables = {name: make(*(results[part] for part in parts)) for name, (parts, make) in TABLES.items()
              if all(part in results for part in parts)}
    for part in ("kitti", "paths"):
        if part in results:
            tables.update({f"{part}_{name}": text for name, text in paper_tables(results[part]).items()})
    if {"sequences", "variants", "scenarios"} <= set(results):
        tables["covariance"] = covariance_table(results)
    tables["runs"] = run_table(results)
    return {**results, "summary": summary(results), "tables": tables}


def page(figures):
    """The text of docs/results.md."""
    parts = ["# Results", "Written by `scripts/report` from `results.json`, which also has the figures that "
             "the other pages cite. [Commands and files](reference/commands.md#output-files) defines the "
             "figures."]
    for name, text in figures["tables"].items():
        parts += [f"## {name.replace('_', ' ').capitalize()}", text]
    return "\n\n".join(parts) + "\n"
