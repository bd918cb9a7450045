"""scripts/report and scripts/benchmark: figures, tables, and what has been measured before."""

import json

import pytest
from conftest import FRAMES, SCRIPTS, run

REPORT = SCRIPTS / "report"


def test_a_part_is_measured_once(short, tmp_path):
    command = REPORT, short, "--only", "sequences", "--out", tmp_path
    assert "sequences: measured before" not in run(*command).stderr
    drive = json.loads((tmp_path / "results.json").read_text())["sequences"]["short"]
    assert drive["frames"] == drive["tracked_frames"] == FRAMES and drive["rle_percent"] < 3
    assert f"| short | {FRAMES} | {FRAMES} |" in (tmp_path / "results.md").read_text()
    assert "sequences: measured before" in run(*command).stderr


def test_a_failed_part_and_wrong_arguments_are_named(short, tmp_path):
    (tmp_path / "empty/image_0").mkdir(parents=True)
    done = run(REPORT, short, tmp_path / "empty", "--only", "sequences", "--out", tmp_path / "out", check=False)
    assert done.returncode == 1 and "sequences failed" in done.stderr
    for command in (REPORT, SCRIPTS / "benchmark"):
        done = run(command, tmp_path / "none", check=False)
        assert done.returncode == 2 and f"{tmp_path / 'none'}: no such folder" in done.stderr


@pytest.mark.long
def test_benchmark(short, tmp_path):
    run(SCRIPTS / "benchmark", short, "--out", tmp_path, "--rates", "1")
    figures = json.loads((tmp_path / "short/benchmark.json").read_text())
    assert 0 < figures["ratio_mean"] < 10 and figures["frames_per_second"] > 1
    assert figures["rates"]["1"]["median_ms"] > 0 and "| Delaunay |" in (tmp_path / "short/benchmark.md").read_text()
