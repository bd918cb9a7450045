#!/usr/bin/python3
"""Checks that a benchmark.json is complete and consistent. Sets no limits on times."""

import csv
import json
import math
import os
import pathlib
import sys

# In the order of the report: STAGES[1:9] are the parts of vo_total, STAGES[11:16] those of scale_total.
STAGES = ["decode", "vo_pyramid", "vo_track", "vo_adjustment_wait", "vo_align", "vo_pose",
          "vo_detect", "vo_triangulate", "vo_rest", "vo_total", "vo_bundle_adjustment",
          "scale_delaunay", "scale_gpe", "scale_gpa", "scale_direct", "scale_filter",
          "scale_total", "publish", "total"]
BASELINE = ["pyramid", "detect", "track", "total"]


def finite(value, place="benchmark.json"):
    """Every number is finite; null is allowed, for values that were not measured."""
    if isinstance(value, dict):
        for name, member in value.items():
            finite(member, f"{place}: {name}")
    elif isinstance(value, list):
        for i, member in enumerate(value):
            finite(member, f"{place}: {i}")
    elif isinstance(value, float):
        assert math.isfinite(value), place


def check_stages(stages, names):
    for name in names:
        stage = stages[name]
        assert 0 <= stage["share"] <= 1, name
        if stage["share"] > 0:
            assert 0 < stage["median"] <= stage["p95"] <= stage["p99"] <= stage["max"], name
            assert 0 < stage["mean"] <= stage["max"], name


def column(file, name):
    with file.open() as text:
        return [row[name] for row in csv.DictReader(text)]


def check(folder, frames, rates):
    report = json.loads((folder / "benchmark.json").read_text())
    finite(report)
    for name in ("benchmark.md", "stages.png", "memory.png", "latency.png"):
        assert (folder / name).stat().st_size > 0, name
    for run in (report["one_core"], report["two_cores"]):
        assert run["frames"] == frames and run["features_median"] > 0
        assert run["frames_per_second"] > 0 and run["peak_rss_mb"] > 0
        assert run["cpu_ms_per_frame"] > run["decode_cpu_ms_per_frame"] > 0
        stages = run["stages_ms"]
        check_stages(stages, STAGES)
        parts = sum(stages[name]["mean"] for name in STAGES[1:9])
        assert math.isclose(parts, stages["vo_total"]["mean"], rel_tol=1e-6)
        parts = sum(stages[name]["mean"] for name in STAGES[11:16])
        assert 0 < parts <= stages["scale_total"]["mean"]
        assert math.isclose(stages["vo_total"]["mean"] + stages["scale_total"]["mean"],
                            stages["total"]["mean"], rel_tol=1e-6)
        assert stages["vo_bundle_adjustment"]["share"] > 0, "no keyframe in the whole drive"
        assert stages["vo_adjustment_wait"]["share"] == stages["vo_bundle_adjustment"]["share"]
    assert report["one_core"]["cores"] == 1
    assert report["two_cores"]["cores"] == min(2, len(os.sched_getaffinity(0)))
    baseline = report["baseline_ms"]
    check_stages(baseline, BASELINE)
    one_core = folder / "one_core"
    points = column(one_core / "baseline.csv", "points")
    assert points == column(one_core / "usage.csv", "features")[1:], "other points than the pipeline's"
    assert baseline["points_median"] > 0
    parts = sum(baseline[name]["mean"] for name in BASELINE[:3])
    assert math.isclose(parts, baseline["total"]["mean"], rel_tol=1e-6)
    assert all(ratio > 0 for ratio in report["pipeline_over_baseline"].values())
    memory = report["memory"]
    assert memory["frames"] == 2 * frames - 1  # forwards and backwards
    # The kernel sums both counters over the threads at different times: they may differ slightly.
    assert all(0 < at["rss_mb"] <= memory["peak_rss_mb"] + 5 for at in memory["rss_mb"])
    assert [graph["rate"] for graph in report["graph"]] == rates
    for graph in report["graph"]:
        assert graph["images"] == frames and 0 < graph["frames"] <= frames
        assert graph["dropped"] == frames - graph["frames"]
        assert 0 < graph["odometry_messages"] <= graph["scale_messages"] <= graph["frames"]
        latency = graph["latency_ms"]
        assert 0 < latency["median"] <= latency["p95"] <= latency["max"]
        assert graph["latency_to_frame_ms"]["median"] > 0
        assert graph["cpu_ms_per_frame"] > 0 and graph["peak_rss_mb"] > 0
    for target in report["targets"]:
        assert target["met"] in (True, False, None) and target["what"], target


if __name__ == "__main__":
    check(pathlib.Path(sys.argv[1]), int(sys.argv[2]), [float(rate) for rate in sys.argv[3:]])
