"""scripts/evaluate: the odometry over KITTI folders, its files, and the tables over several runs."""

import json
import re

import matplotlib.image
import numpy as np
import pytest
from conftest import CAMERA_HEIGHT, FRAMES, SCRIPTS, assert_refused, on_full_disk, on_terminal, poses_of, run, tool

EVALUATE = SCRIPTS / "evaluate"
RUN_SEQUENCE = tool("run_sequence")
METRICS = """frames tracked_frames lost_events length_m gt_length_m rle_percent t_err_percent r_err_deg_per_m
t_err_short_percent ate_rmse_m ms_vo_median ms_vo_p95 ms_scale_median ms_scale_p95 ms_total_median
peak_rss_mb""".split()


def test_files_of_a_run(short, evaluated):
    times = np.genfromtxt(evaluated / "timing.csv", delimiter=",", names=True)
    assert (times["decode"] > 0).all() and (times["vo_total"] > 0).all() and (times["scale_total"][10:] > 0).all()
    metrics = json.loads((evaluated / "metrics.json").read_text())
    assert set(METRICS) <= set(metrics)
    assert metrics["frames"] == FRAMES and metrics["lost_events"] == 0
    assert metrics["t_err_percent"] is metrics["r_err_deg_per_m"] is None  # shorter than 100 m
    assert metrics["camera_height_m"] == CAMERA_HEIGHT and abs(metrics["height_bias_percent"]) < 3
    truth, poses = poses_of(short / "poses.txt"), poses_of(evaluated / "poses.txt")
    length = np.linalg.norm(np.diff(truth[:, :, 3], axis=0), axis=1).sum()
    assert metrics["gt_length_m"] == pytest.approx(length) and abs(metrics["rle_percent"]) < 3
    assert len(poses) == FRAMES and np.linalg.norm(poses[-1, :, 3] - truth[-1, :, 3]) < 0.05 * length
    stamps = np.loadtxt(evaluated / "trajectory_tum.txt")[:, 0]
    assert stamps == pytest.approx(np.loadtxt(short / "times.txt"))
    for name in ("trajectory", "scale", "timing"):
        assert (evaluated / f"{name}.png").stat().st_size > 0


def test_progress_on_a_terminal(shortest, tmp_path):
    output = on_terminal(RUN_SEQUENCE, shortest, "--camera-height", 1.65, "--out", tmp_path)
    distance = max(float(metres) for metres in re.findall(r"shortest: 12/12 frames, [\d.]+/s, ([\d.]+) m", output))
    driven = np.linalg.norm(poses_of(shortest / "poses.txt")[-1, :, 3])
    assert 0.5 * driven < distance < 1.2 * driven
    metrics = json.loads((tmp_path / "shortest/metrics.json").read_text())
    assert f"12 tracked, {metrics['length_m']:.1f} m, written to" in output and "no frame got a scale" not in output


def test_options_and_mask_reach_the_run(shortest, tmp_path):
    """A mask that hides everything: no corner is found."""
    mask = tmp_path / "mask.png"
    matplotlib.image.imsave(mask, np.zeros((248, 800)), cmap="gray", vmin=0, vmax=1)
    for options in (["--mask", mask], ["--set", "refine=false", "--set", "gpe/min_points=1000000"]):
        done = run(EVALUATE, shortest, "--out", tmp_path, "--camera-height", 2, *options)
        assert "no frame got a scale" in done.stdout + done.stderr
        assert json.loads((tmp_path / "shortest/metrics.json").read_text())["camera_height_m"] == 2
    matplotlib.image.imsave(mask, np.zeros((248, 799)), cmap="gray", vmin=0, vmax=1)
    assert_refused(1, f"--mask {mask} is 799x248, the camera 800x248", EVALUATE, shortest, "--out", tmp_path,
                   "--mask", mask)


@pytest.mark.parametrize("status, text, arguments", [
    (2, "SEQ is missing", []),
    (1, "none: no such folder", ["none"]),
    (2, "have the same name", ["SHORT", "OUT/short"]),
    (2, "there is no option foo", ["SHORT", "--set", "foo=1"]),
    (2, "gpe/min_points", ["SHORT", "SHORTEST", "--set", "gpe/min_points=abc"]),
    (2, "camera_height is 0", ["SHORT", "--camera-height", "0"]),
    (2, "unknown scenario", ["--scenarios", "none"]),
    (2, "unknown fault", ["--faults", "none"]),
])
def test_refuses(short, shortest, tmp_path, status, text, arguments):
    (tmp_path / "short").mkdir()
    words = {"SHORT": short, "SHORTEST": shortest, "OUT/short": tmp_path / "short"}
    assert_refused(status, text, EVALUATE, *(words.get(word, word) for word in arguments),
                   *([] if "--faults" in arguments else ["--out", tmp_path]))
    assert not list((tmp_path / "short").iterdir())


def test_damaged_folder(damaged_folder, tmp_path):
    folder, reason = damaged_folder
    assert_refused(1, reason, EVALUATE, folder, "--out", tmp_path)


def test_a_failed_sequence_is_reported(shortest, tmp_path):
    """The others are run, and its metrics of an earlier run do not remain."""
    folder, out = tmp_path / "empty", tmp_path / "out"
    folder.mkdir()
    (out / "empty").mkdir(parents=True)
    (out / "empty/metrics.json").write_text("{}")
    done = run(EVALUATE, folder, shortest, "--out", out, check=False)
    assert done.returncode == 1 and "empty: has neither image_0" in done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines()[-2:]] == ["sequence", "shortest"]
    assert not (out / "empty/metrics.json").exists()


def test_full_disk(shortest, tmp_path):
    assert_refused(1, "poses.txt: cannot be written", RUN_SEQUENCE, shortest, "--camera-height", 1.65, "--out",
                   tmp_path, **on_full_disk(1))
    assert list((tmp_path / "shortest").iterdir()) == []


def test_metrics_table(evaluated, tmp_path):
    """What is not known is a dash."""
    _, row = run(tool("metrics_table.py"), evaluated).stdout.splitlines()
    metrics = json.loads((evaluated / "metrics.json").read_text())
    assert row.split() == [
        "short", "40", "40", "0", f"{metrics['length_m']:.1f}", f"{metrics['rle_percent']:.2f}", "-", "-", "-",
        f"{metrics['t_err_short_percent']:.2f}", f"{metrics['scale_within_2_sigma']:.2f}",
        f"{metrics['ms_total_median']:.1f}"]
    assert_refused(1, "metrics.json: cannot be read", tool("metrics_table.py"), tmp_path)
