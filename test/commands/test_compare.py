"""scripts/compare: each kind of loss is found and named, and nothing else."""

import json
import subprocess

import pytest
from conftest import ROOT

DRIVE = {"tracked_frames": 100, "lost_events": 0, "rle_percent": 0.3, "t_err_percent": None, "t_err_short_percent": 1.0,
         "t_err_true_length_percent": 0.4, "first_metric_pose_m": 1.0}
RESULTS = {
    **{part: {"a": DRIVE, "b": {**DRIVE, "t_err_percent": 0.6}} for part in ("sequences", "variants", "scenarios")},
    "ablation": {"a": {"default": {"violated": ""}}, "b": {"default": {"violated": "RLE"}}},
    "faults": {"violated": 0, "max_error_percent": 0.8}, "benchmark": {"a": {"ratio_mean": 0.5}}}


def compare(tmp_path, new):
    files = tmp_path / "old.json", tmp_path / "new.json"
    for file, results in zip(files, (RESULTS, new)):
        file.write_text(json.dumps(results))
    return subprocess.run([ROOT / "scripts/compare", *files], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("path, value, named", [
    ("sequences/a/rle_percent", 0.38, None),  # its mean is 0.04 points worse
    ("sequences/a/rle_percent", 0.42, "sequences: rle_percent"),
    ("scenarios/a/tracked_frames", 99, "scenarios: a: tracked_frames"),
    ("scenarios/a/first_metric_pose_m", None, "scenarios: a: first metric pose"),
    ("ablation/a/default/violated", "late scale", "a violates late scale"),
    ("ablation/b/default/violated", "", None),
    ("faults/violated", 1, "faults: drives with a violated threshold"),
    ("benchmark/a/ratio_mean", 0.56, "benchmark: a"),
])
def test_a_loss_fails_and_is_named(tmp_path, path, value, named):
    new = json.loads(json.dumps(RESULTS))
    *keys, last = path.split("/")
    part = new
    for key in keys:
        part = part[key]
    part[last] = value
    done = compare(tmp_path, new)
    assert done.returncode == (1 if named else 0), done.stdout
    assert [line for line in done.stdout.splitlines() if line.startswith("worse: ")] == (
        [line for line in done.stdout.splitlines() if named in line and line.startswith("worse: ")] if named else [])


def test_a_missing_drive_fails_and_a_missing_part_is_an_error(tmp_path):
    new = json.loads(json.dumps(RESULTS))
    del new["variants"]["a"]
    done = compare(tmp_path, new)
    assert done.returncode == 1 and "missing: a" in done.stdout
    del new["faults"]
    done = compare(tmp_path, new)
    assert done.returncode == 2 and "faults" in done.stderr
