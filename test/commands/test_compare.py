"""scripts/compare: each kind of loss is found and named, and nothing else."""

import json
import subprocess

import pytest
from conftest import ROOT

DRIVE = {"tracked_frames": 100, "lost_events": 0, "rle_percent": 0.3, "t_err_percent": None, "t_err_short_percent": 1.0,
         "t_err_true_length_percent": 0.4, "first_metric_pose_m": 1.0, "violated": ""}
SEEDS = ("1", "2", "3")
RESULTS = {
    **{part: {"seeds": {seed: {"a": DRIVE, "b": {**DRIVE, "t_err_percent": 0.6, "violated": "RLE"}} for seed in SEEDS}}
       for part in ("sequences", "variants", "scenarios", "faults")},
    "benchmark": {"a": {"ratio_mean": 0.5}}}


def changed(path, seeds, value):
    """RESULTS with another figure: path PART/DRIVE/KEY, with these seeds."""
    new = json.loads(json.dumps(RESULTS))
    part, drive, key = path.split("/")
    for drives in [new[part]["seeds"][seed] for seed in seeds] or [new[part]]:
        drives[drive][key] = value
    return new


def compare(tmp_path, new):
    files = tmp_path / "old.json", tmp_path / "new.json"
    for file, results in zip(files, (RESULTS, new)):
        file.write_text(json.dumps(results))
    return subprocess.run([ROOT / "scripts/compare", *files], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("path, seeds, value, named", [
    ("sequences/a/rle_percent", "123", 0.38, None),  # its mean is 0.04 points worse
    ("sequences/a/rle_percent", "1", 0.5, None),  # over the three seeds 0.033
    ("sequences/a/rle_percent", "123", 0.42, "sequences: rle_percent"),
    ("scenarios/a/tracked_frames", "2", 99, None),
    ("scenarios/a/tracked_frames", "23", 99, "scenarios: a: fewer tracked frames with seed 2, 3"),
    ("scenarios/a/first_metric_pose_m", "123", None, "scenarios: a: no first metric pose"),
    ("scenarios/a/violated", "2", "late scale", None),
    ("scenarios/a/violated", "13", "late scale", "scenarios: a: threshold late scale with seed 1, 3"),
    ("scenarios/b/violated", "123", "", None),
    ("scenarios/b/violated", "12", "rotation", "scenarios: b: threshold rotation"),
    ("faults/a/violated", "3", "lost", None),
    ("faults/a/violated", "12", "lost", "faults: a: threshold lost"),
    ("benchmark/a/ratio_mean", "", 0.54, None),
    ("benchmark/a/ratio_mean", "", 0.56, "benchmark: a"),
])
def test_a_loss_fails_and_is_named(tmp_path, path, seeds, value, named):
    done = compare(tmp_path, changed(path, seeds, value))
    assert done.returncode == (1 if named else 0), done.stdout
    assert [line.startswith(f"worse: {named}") for line in done.stdout.splitlines() if line.startswith("worse: ")] == (
        [True] if named else [])


def test_a_missing_drive_fails_and_a_missing_part_or_seed_is_an_error(tmp_path):
    new = json.loads(json.dumps(RESULTS))
    del new["benchmark"], new["variants"]["seeds"]["1"]["a"]
    done = compare(tmp_path, new)
    assert done.returncode == 1 and "worse: variants: a is missing" in done.stdout
    del new["faults"]["seeds"]["3"]
    done = compare(tmp_path, new)
    assert done.returncode == 2 and "faults has the seeds 1, 2, 3 and 1, 2" in done.stderr
    del new["faults"]
    done = compare(tmp_path, new)
    assert done.returncode == 2 and "faults" in done.stderr
