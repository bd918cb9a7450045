"""plot_run.py: what its plots show."""

import json

import numpy as np
import plot_run
import pytest
from conftest import assert_refused, on_full_disk, tool

FRAMES = 20


@pytest.fixture
def figures(monkeypatch):
    """The figures that are drawn, instead of files."""
    drawn = []
    monkeypatch.setattr(plot_run, "save", lambda figure, *_: drawn.append(figure))
    return drawn


@pytest.fixture
def folder(tmp_path):
    """Results of a run; each number is used in one place only."""
    folder = tmp_path / "drive"
    folder.mkdir()
    steps = np.arange(FRAMES)
    for name, factor in (("poses", 1.1), ("poses_unscaled", 0.5), ("ground_truth", 1.0)):
        poses = np.tile(np.eye(3, 4), (FRAMES, 1, 1))
        poses[:, 0, 3], poses[:, 1, 3], poses[:, 2, 3] = 0.2 * factor * steps, -5, factor * steps
        np.savetxt(folder / f"{name}.txt", poses.reshape(FRAMES, 12))
    (folder / "scale.csv").write_text("frame,stamp,status,raw_scale,scale,sigma,map_id,vo_status,source,camera_height,"
                                      "camera_height_sigma\n" + "".join(
        f"{i},{100 + 0.1 * i},{'held' if i in (5, 6) else 'ok'},{1.25 if i != 7 else 0},1.5,0.15,0,"
        f"{'lost' if i == 9 else 'tracking'},road,1.65,0\n" for i in range(FRAMES)))
    (folder / "timing.csv").write_text("frame,vo_total,scale_total\n" + "".join(
        f"{i},{(i + 1) ** 2 if i < 15 else 0},4\n" for i in range(FRAMES)))
    (folder / "metrics.json").write_text(json.dumps({
        "length_m": 21.2, "t_err_percent": None, "r_err_deg_per_m": None, "camera_height_m": 1.65}))
    return folder


def line(axes, label):
    return next(line for line in axes.lines if line.get_label() == label).get_xydata()


def test_plots_of_a_run(figures, folder):
    plot_run.draw(folder)
    trajectory, scale, timing = figures
    assert line(trajectory.axes[0], "estimate")[-1] == pytest.approx([0.2 * 1.1 * 19, 1.1 * 19])
    assert line(trajectory.axes[0], "ground truth")[-1] == pytest.approx([0.2 * 19, 19])
    heights, _, scales = scale.axes[:3]
    unfiltered = line(heights, "unfiltered")
    assert len(unfiltered) == 19 and unfiltered[:, 1] == pytest.approx(np.full(19, 1.65 * 1.5 / 1.25))
    assert line(scales, "filtered")[:, 1] == pytest.approx(np.full(FRAMES, 1.5))
    for axes, value, two_sigma in ((heights, 1.65, 0.2 * 1.65), (scales, 1.5, 0.3)):
        band = axes.collections[0].get_paths()[0].get_extents()
        assert (band.y0, band.y1) == pytest.approx((value - two_sigma, value + two_sigma))
    states = {str(bars.get_label()): bars for bars in scales.collections if "frames" in str(bars.get_label())}
    assert set(states) == {"ok: 17 frames", "held: 2 frames", "lost: 1 frames"}
    labels = [text.get_text().split() for text in timing.axes[1].get_yticklabels()]
    assert labels == [["64.000", "75", "%"], ["4.000", "100", "%"]]  # median, share of the frames


def test_full_disk(folder):
    assert_refused(1, "cannot be drawn", tool("plot_run.py"), folder, **on_full_disk(10))
    assert not [file for file in folder.iterdir() if ".tmp" in file.name]
