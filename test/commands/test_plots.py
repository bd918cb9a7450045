"""plot_run.py: what its plots show."""

import json

import numpy as np
import plot_run
import pytest

FRAMES, STOP = 60, slice(20, 40)


@pytest.fixture
def figures(monkeypatch):
    """The figures that are drawn, instead of files."""
    drawn = []
    monkeypatch.setattr(plot_run, "save", lambda figure, file, pdf: drawn.append(figure))
    return drawn


def test_standstill_has_width_in_the_scale_plot(figures, tmp_path):
    status = np.full(FRAMES, "ok", dtype=object)
    status[STOP] = "held"
    (tmp_path / "scale.csv").write_text("frame,stamp,status,raw_scale,scale,sigma,map_id,vo_status\n" + "".join(
        f"{i},{100 + 0.1 * i},{status[i]},{15.5 if status[i] == 'ok' else 0},15.6,0.1,0,tracking\n"
        for i in range(FRAMES)))
    plot_run.draw_scale(tmp_path / "scale", plot_run.read_table(tmp_path / "scale.csv"), 1.65, "", False)
    axes = figures[0].axes[2]
    held = next(bars for bars in axes.collections if str(bars.get_label()).startswith("held"))
    extents = [path.get_extents() for path in held.get_paths()]
    assert max(e.x1 for e in extents) - min(e.x0 for e in extents) == pytest.approx(2.0)
    assert axes.get_xlabel() == "time [s]"


@pytest.mark.parametrize("frames", [5, 12, FRAMES])
def test_counts_of_the_scale_plot_are_integers(figures, tmp_path, frames):
    table = {"stamp": 0.1 * np.arange(frames), "status": np.full(frames, "ok"), "map_id": np.zeros(frames),
             "raw_scale": 15.5 + 0.1 * np.sin(np.arange(frames)), "scale": np.full(frames, 15.6),
             "sigma": np.full(frames, 0.1), "vo_status": np.full(frames, "tracking")}
    plot_run.draw_scale(tmp_path / "scale", table, 1.65, "", False)
    histogram = figures[0].axes[1]
    assert histogram.get_xlabel() == "frames"
    ticks = histogram.get_xticks()
    assert len(ticks) > 1 and np.all(ticks == np.round(ticks)), ticks


def line(axes, label):
    return next(line for line in axes.lines if line.get_label() == label).get_xydata()


@pytest.fixture
def folder(tmp_path):
    """Results of 20 frames; each number is used in one place only."""
    folder = tmp_path / "drive"
    folder.mkdir()
    steps = np.arange(20.0)
    for name, factor in (("poses", 1.1), ("poses_unscaled", 0.5), ("ground_truth", 1.0)):
        poses = np.tile(np.eye(3, 4), (20, 1, 1))
        poses[:, 0, 3], poses[:, 1, 3], poses[:, 2, 3] = 0.2 * factor * steps, -5, factor * steps
        np.savetxt(folder / f"{name}.txt", poses.reshape(20, 12))
    (folder / "scale.csv").write_text("frame,stamp,status,raw_scale,scale,sigma,map_id,vo_status\n" + "".join(
        f"{i},{100 + 0.1 * i},{'held' if i in (5, 6) else 'ok'},{1.25 if i != 7 else 0},1.5,0.15,0,"
        f"{'lost' if i == 9 else 'tracking'}\n" for i in range(20)))
    (folder / "timing.csv").write_text("frame,vo_total,scale_total\n" + "".join(
        f"{i},{(i + 1) ** 2 if i < 15 else 0},4\n" for i in range(20)))
    errors = [{"length_m": length, "t_err_percent": 2.0, "r_err_deg_per_m": 0.03} for length in (10, 20)]
    (folder / "metrics.json").write_text(json.dumps({
        "length_m": 21.2, "t_err_percent": None, "r_err_deg_per_m": None, "camera_height_m": 1.65,
        "by_short_length": errors, "by_length": [{**errors[0], "length_m": 100, "t_err_percent": 1.0}]}))
    return folder


def test_plots_of_a_run(figures, folder):
    plot_run.draw(folder, False)
    trajectory, scale, timing, errors = figures
    axes = trajectory.axes[0]
    assert line(axes, "estimate")[-1] == pytest.approx([0.2 * 1.1 * 19, 1.1 * 19])
    assert line(axes, "ground truth")[-1] == pytest.approx([0.2 * 19, 19])
    assert "21.2 m" in axes.get_title(loc="left")
    heights, _, scales = scale.axes[:3]
    unfiltered = line(heights, "unfiltered")
    assert len(unfiltered) == 19 and unfiltered[:, 1] == pytest.approx(np.full(19, 1.65 * 1.5 / 1.25))
    band = heights.collections[0].get_paths()[0].get_extents()
    assert (band.y0, band.y1) == pytest.approx((1.65 * 0.8, 1.65 * 1.2))
    assert line(scales, "filtered")[:, 1] == pytest.approx(np.full(20, 1.5))
    band = scales.collections[0].get_paths()[0].get_extents()
    assert (band.y0, band.y1) == pytest.approx((1.5 - 0.3, 1.5 + 0.3))
    assert {bars.get_label() for bars in scales.collections if "frames" in str(bars.get_label())} == {
        "ok: 17 frames", "held: 2 frames", "lost: 1 frames"}
    labels = [text.get_text().split() for text in timing.axes[1].get_yticklabels()]
    assert labels == [["64.000", "75", "%"], ["4.000", "100", "%"]]  # median, share of the frames
    translation, rotation = errors.axes
    assert line(translation, "10 to 80 m").tolist() == [[10, 2], [20, 2]]
    assert line(translation, "100 to 800 m: KITTI devkit").tolist() == [[100, 1]]
    assert line(rotation, "10 to 80 m").tolist() == [[10, 0.03], [20, 0.03]]


@pytest.mark.parametrize("arguments, files", [([], {".png"}), (["--pdf"], {".png", ".pdf"})])
def test_files(folder, monkeypatch, arguments, files):
    monkeypatch.setattr("sys.argv", ["plot_run.py", str(folder), *arguments])
    plot_run.main()
    assert {file.name for file in folder.iterdir() if file.suffix in (".png", ".pdf")} == {
        name + suffix for name in ("trajectory", "scale", "timing", "errors") for suffix in files}


def test_plots_of_an_earlier_run_are_removed(figures, folder):
    plots = [folder / (name + suffix) for name in ("trajectory", "scale", "timing", "errors")
             for suffix in (".png", ".pdf")]
    for plot in plots:
        plot.touch()
    (folder / "ground_truth.txt").unlink()
    plot_run.draw(folder, False)
    assert len(figures) == 3 and not any(plot.exists() for plot in plots)


def test_medians_of_the_timing_plot_have_a_unit(figures, tmp_path):
    plot_run.draw_timing(tmp_path / "timing", {"vo_total": np.array([5.0, 6.0, 7.0])}, "", False)
    assert any("median [ms]" in text.get_text() for text in figures[0].axes[0].texts)
