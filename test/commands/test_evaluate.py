"""scripts/evaluate: the odometry over KITTI folders, its files, and the tables over several runs."""

import json

import matplotlib.image
import numpy as np
import pytest
from conftest import CAMERA_HEIGHT, FRAMES, SCRIPTS, assert_refused, poses_of, run, tool

EVALUATE = SCRIPTS / "evaluate"


def test_files_of_a_run(short, evaluated):
    metrics = json.loads((evaluated / "metrics.json").read_text())
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


def test_options_and_mask_reach_the_run(shortest, tmp_path):
    """A mask that shows a corner of the image: no feature is found. One that hides everything is refused."""
    mask = tmp_path / "mask.png"
    pixels = np.zeros((248, 800))
    matplotlib.image.imsave(mask, pixels, cmap="gray", vmin=0, vmax=1)
    assert_refused(1, f"the mask {mask} hides the whole image", EVALUATE, shortest, "--out", tmp_path, "--mask", mask)
    pixels[:4, :4] = 1
    matplotlib.image.imsave(mask, pixels, cmap="gray", vmin=0, vmax=1)
    for options in (["--mask", mask], ["--set", "refine=false", "--set", "gpe/min_points=1000000"]):
        done = run(EVALUATE, shortest, "--out", tmp_path, "--camera-height", 2, *options, check=False)
        assert done.returncode == 1 and "shortest: no metric pose: the " in done.stderr
        assert json.loads((tmp_path / "shortest/metrics.json").read_text())["camera_height_m"] == 2
    matplotlib.image.imsave(mask, np.zeros((248, 799)), cmap="gray", vmin=0, vmax=1)
    assert_refused(1, f"the mask {mask} is 799x248, the camera 800x248", EVALUATE, shortest, "--out", tmp_path,
                   "--mask", mask)


def test_a_failed_sequence_is_reported(shortest, tmp_path):
    """The others are run, and its metrics of an earlier run do not remain."""
    empty, drive, out = (tmp_path / name for name in ("it's empty", "it's a drive", "it's out"))
    empty.mkdir()
    drive.symlink_to(shortest)
    (out / empty.name).mkdir(parents=True)
    (out / empty.name / "metrics.json").write_text("{}")
    done = run(EVALUATE, empty, drive, "--out", out, check=False)
    assert done.returncode == 1 and "it's empty does not contain its calibration" in done.stderr
    assert [line.split("  ")[0] for line in done.stdout.splitlines()[-2:]] == ["sequence", drive.name]
    assert not (out / empty.name / "metrics.json").exists()


def test_metrics_table(evaluated):
    """What is not known is a dash."""
    _, row = run(tool("metrics_table.py"), evaluated).stdout.splitlines()
    metrics = json.loads((evaluated / "metrics.json").read_text())
    assert row.split() == [
        "short", "40", "40", "0", f"{metrics['length_m']:.1f}", f"{metrics['rle_percent']:.2f}", "-", "-", "-",
        f"{metrics['t_err_short_percent']:.2f}", f"{metrics['scale_within_2_sigma']:.2f}",
        f"{metrics['ms_total_median']:.1f}"]
