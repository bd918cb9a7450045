"""scripts/benchmark: its reports are complete and consistent, its arguments are checked."""

import check_benchmark
import pytest
from conftest import SCRIPTS, assert_refused, run, tool

BENCHMARK = SCRIPTS / "benchmark"


@pytest.mark.serial
def test_report(short, tmp_path):
    run(BENCHMARK, short, "--out", tmp_path, "--rates", "1,2", "--repeat", 2)
    check_benchmark.check(tmp_path / "short", frames=40, rates=[1, 2])


def test_micro(tmp_path):
    run(BENCHMARK, "--micro", "--filter", "/(width:620|points:125|features:125)", "--out", tmp_path)
    assert "\n| bundleAdjustment " in (tmp_path / "micro.md").read_text()


def test_growth(shortest, tmp_path):
    run(BENCHMARK, "--growth", shortest, "--out", tmp_path)
    assert "\n| bundle_adjustment/window " in (tmp_path / "shortest/growth.md").read_text()


@pytest.mark.parametrize("text, arguments", [
    ("SEQ is missing", []),
    ("--camera-height", ["SHORT", "--camera-height", "0"]),
    ("'fast' is not a positive number", ["SHORT", "--rates", "1,fast"]),
    ("--repeat", ["SHORT", "--repeat", "0"]),
    ("takes no SEQ", ["--micro", "SHORT"]),
    ("own folder", ["SHORT", "--out", ".."]),
])
def test_wrong_arguments(short, text, arguments):
    arguments = [short if word == "SHORT" else word for word in arguments]
    assert_refused(2, text, BENCHMARK, *arguments, cwd=short)


@pytest.mark.parametrize("status, text, arguments", [
    (2, "none", ["--set", "none=1"]),
    (2, "tracker/cell_size", ["--set", "tracker/cell_size=7"]),
    (1, "may use", ["--cores", "1024"]),
])
def test_benchmark_sequence_wrong_arguments(short, tmp_path, status, text, arguments):
    assert_refused(status, text, tool("benchmark_sequence"), short, "--camera-height", 1.65, "--out",
                   tmp_path, *arguments)


def test_benchmark_sequence_damaged_folder(damaged_folder, tmp_path):
    folder, reason = damaged_folder
    assert_refused(1, reason, tool("benchmark_sequence"), folder, "--camera-height", 1.65, "--out",
                   tmp_path)
