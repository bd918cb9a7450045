#!/usr/bin/python3
"""Collects the figures of scripts/report.

report_figures.py PART DIR [--key=value ...]   reads the results of a part in DIR/PART/, writes DIR/PART.json
report_figures.py --write DIR ROOT             puts all DIR/PART.json into ROOT/docs/results.json
"""

import csv
import datetime
import json
import math
import pathlib
import re
import statistics
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from report_tables import DRIVES, LENGTHS  # noqa: E402

COUNTS = ("frames", "tracked_frames", "lost_events")
METRICS = ("gt_length_m", "rle_percent", "t_err_percent",
           "r_err_deg_per_m", "t_err_short_percent", "t_err_true_length_percent", "t_err_sim3_percent",
           "scale_within_2_sigma", "scale_held_share", "first_metric_pose_m", "first_scale_error_sigmas")

# The paper's stages (its Fig. 5), and the direct measurement: columns of timing.csv.
STAGES = {"MVO": ["vo_total"], "GPE": ["scale_delaunay", "scale_gpe"], "GPA": ["scale_gpa"],
          "direct": ["scale_direct"], "total": ["total"]}


def rounded(value):
    """Floating-point numbers with five significant digits, in all parts of the value."""
    if isinstance(value, float):
        return float(f"{value:.5g}")
    if isinstance(value, dict):
        return {key: rounded(part) for key, part in value.items()}
    return [rounded(part) for part in value] if isinstance(value, list) else value


def read(file):
    return json.loads(file.read_text(encoding="utf-8"))


def short_name(folder):
    """The name in docs of a folder of results, also of a variant of a known drive."""
    for name, (short, _) in DRIVES.items():
        if folder == name or folder.startswith(name + "_"):
            return short + folder[len(name):]
    return re.sub(r"\W", "_", folder)


def as_float(value):
    """Whole numbers of nlohmann-json are integers in Python."""
    return None if value is None else float(value)


def drive_figures(metrics):
    figures = {key: metrics[key] for key in COUNTS + METRICS}
    lengths = {entry["length_m"]: entry for entry in metrics["covariance_by_length"] or []}
    for length in LENGTHS:
        entry = lengths.get(length, {})
        figures[f"nees_{length}"] = entry.get("nees_per_dof")
        figures[f"nees_exact_{length}"] = entry.get("nees_per_dof_exact_ground_truth")
        figures[f"within_{length}"] = entry.get("within_2_sigma")
    return {key: value if key in COUNTS else as_float(value) for key, value in figures.items()}


def folders(folder):
    """Figures of run_sequence or evaluate_scenarios."""
    return {short_name(file.parent.name): drive_figures(read(file))
            for file in sorted(folder.glob("*/metrics.json"))}


def kitti(folder):
    """Figures of whole sequences, and the median time of the paper's stages in the frames in which they run."""
    figures = {}
    for file in sorted(folder.glob("[01][0-9]/metrics.json")):
        metrics = read(file)
        with open(file.with_name("timing.csv"), encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
        times = {stage: [sum(float(row[column]) for column in columns) for row in rows]
                 for stage, columns in STAGES.items()}
        figures[file.parent.name] = {
            **drive_figures(metrics), "length_m": as_float(metrics["length_m"]),
            "peak_rss_mb": as_float(metrics["peak_rss_mb"]),
            "run_time_ms": {stage: statistics.median([time for time in values if time > 0] or [0.0])
                            for stage, values in times.items()}}
    return figures


def ablation(folder):
    keep = ("rle_percent", "held", "within_2_sigma", "displacement_sigmas", "violated", "clearly")
    return {entry.pop("drive"): {key: {name: run[name] for name in keep} if isinstance(run, dict) else run
                                 for key, run in entry.items()}
            for entry in read(folder / "ablation.json")}


def components(folder):
    keep = ("t_err_percent", "rle_percent", "scale_within_2_sigma", "height_bias_percent")
    return {"rows": [{"label": label, "drives": {short_name(name): {key: as_float(metrics[key]) for key in keep}
                                                 for name, metrics in row.items()}}
                     for label, row in read(folder / "ablation.json").items()]}


def faults(folder):
    """The output of evaluate_faults, and per kind of fault the largest value of each figure, null for never."""
    text = (folder / "faults.txt").read_text(encoding="utf-8")
    kinds = {}
    pattern = (r": ([a-z ]+?) +[\d.]+ s(?:, hides)?: detected (\S+) s, ok (\d+), tracking (-?\d+), metric (-?\d+), "
               r"excess path (\S+) m, error (\S+) m, sigma (\S+) m")
    for kind, detected, ok, tracking, metric, excess, error, sigma in re.findall(pattern, text):
        seen = {"detected_s": math.inf if detected == "nan" else float(detected), "ok_frames": int(ok),
                "tracking_frames": math.inf if tracking == "-1" else int(tracking),
                "metric_frames": math.inf if metric == "-1" else int(metric), "excess_path_m": float(excess),
                "error_m": float(error), "sigma_m": float(sigma)}
        largest = kinds.setdefault(kind.replace(" ", "_"), {"count": 0, **seen})
        largest["count"] += 1
        for key, value in seen.items():
            largest[key] = max(largest[key], value)
    kinds = {kind: {key: None if value == math.inf else value for key, value in largest.items()}
             for kind, largest in kinds.items()}
    count, violated = re.search(r"(\d+) drives, (\d+) with a violated", text).groups()
    return {"drives": int(count), "violated": int(violated), "kinds": kinds, "lines": text.splitlines(),
            "max_error_percent": max(map(float, re.findall(r"m, error (\S+) %", text)))}


def benchmark(folder):
    import benchmark_report  # needs matplotlib
    figures = {}
    for file in sorted(folder.glob("*/benchmark.json")):
        report = read(file)
        one, ratio = report["one_core"], report["pipeline_over_baseline"]
        stages = [(label, one["stages_ms"][column]) for _, column, label in benchmark_report.STAGES]
        figures[short_name(file.parent.name)] = {
            "stages": [[label, stage["median"], stage["p95"], stage["share"]] for label, stage in stages],
            "cpu_ms_per_frame": one["cpu_ms_per_frame"],
            "decode_cpu_ms_per_frame": one["decode_cpu_ms_per_frame"],
            "ratio_mean": ratio["mean_with_adjustment"], "ratio_median": ratio["median"],
            "ratio_same_detections": ratio["mean_with_adjustment_and_its_detections"],
            "frames_per_second": report["two_cores"]["frames_per_second"],
            "peak_rss_mb": report["memory"]["peak_rss_mb"],
            "long_drive_frames": report["memory"]["frames"],
            "rates": {f"{run['rate']:g}": {
                **{f"{key}_ms": run["latency_ms"][key] for key in ("median", "p99", "max")},
                **{key: run[key] for key in ("dropped", "cpu_ms_per_frame", "peak_rss_mb")}}
                for run in report["graph"]}}
    return figures


def growth(folder):
    import benchmark_report  # needs matplotlib
    keep = ("frame_cpu_ms_median", "adjustment_cpu_ms", "cpu_ms_per_frame", "peak_rss_mb")
    report = read(next(folder.glob("*/growth.json")))
    return {"rows": [{"setting": f"{what}: {benchmark_report.varied_value(series, run)}",
                      "features": run["features_median"], **{key: run[key] for key in keep}}
                     for series, (_, what, _) in benchmark_report.SERIES.items()
                     for run in report["series"][series]]}


def heights(folder):
    """Per drive its height, and the calibrated one with its 95 % interval from each source of length."""
    figures = {}
    for file in sorted(folder.glob("*.truth")):
        figures[short_name(file.stem)] = drive = {"true_m": float(file.read_text())}
        for source in ("trajectory", "length"):
            result = file.with_suffix(f".{source}.yaml")
            match = re.search(r"camera_height: (\S+) +# \[m\] ± (\S+)", result.read_text(encoding="utf-8")) \
                if result.exists() else None
            drive[source] = [float(match[1]), float(match[2])] if match else None
    return figures


# Parts over whole KITTI sequences: how report.md describes them.
KITTI_PARTS = {
    "kitti": "Measured on the images of KITTI odometry.",
    "paths": "**Rendered**: the images are those of a street, rendered along the smoothed ground-truth path of each "
             "sequence. Real images are more difficult; the figures of other systems are those on real images.",
}
COLLECT = {**{part: kitti for part in KITTI_PARTS},
           "sequences": folders, "variants": folders, "scenarios": folders, "ablation": ablation,
           "components": components, "faults": faults, "benchmark": benchmark, "growth": growth,
           "heights": heights}


def dump(value, indent=""):
    """JSON with sorted keys; a value that fits on a line, and every flat object, is on one line."""
    line = json.dumps(value, sort_keys=True, ensure_ascii=False)
    if not isinstance(value, (dict, list)) or len(line) < 100:
        return line
    if isinstance(value, list):
        entries = [dump(part, indent + " ") for part in value]
    elif any(isinstance(part, (dict, list)) for part in value.values()):
        entries = [f"{json.dumps(key)}: {dump(value[key], indent + ' ')}" for key in sorted(value)]
    else:
        return line
    brackets = "{}" if isinstance(value, dict) else "[]"
    return f",\n{indent} ".join(entries).join([f"{brackets[0]}\n{indent} ", f"\n{indent}{brackets[1]}"])


def main():
    if sys.argv[1] == "--write":
        results_file = pathlib.Path(sys.argv[3]) / "docs/results.json"
        results = read(results_file) if results_file.exists() else {}
        for part in COLLECT:
            file = pathlib.Path(sys.argv[2]) / f"{part}.json"
            results.update({part: read(file)} if file.exists() else {})
        results_file.write_text(dump(results) + "\n", encoding="utf-8")
        return
    part, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    run = dict(argument[2:].split("=", 1) for argument in sys.argv[3:])
    run.setdefault("date", datetime.date.today().isoformat())
    try:
        figures = COLLECT[part](folder / part)
        if not figures:
            raise ValueError("no results")
    except (OSError, ValueError, KeyError, AttributeError, StopIteration) as error:
        sys.exit(f"report_figures.py: {folder / part}: cannot be read ({error!r})")
    (folder / f"{part}.json").write_text(dump(rounded({"run": run, **figures})) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
