"""plot_run.py: what its plots show."""

import sys

import numpy as np
import pytest
from conftest import SCRIPTS

sys.path.insert(0, str(SCRIPTS))
import plot_run  # noqa: E402

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


def test_medians_of_the_timing_plot_have_a_unit(figures, tmp_path):
    plot_run.draw_timing(tmp_path / "timing", {"vo_total": np.array([5.0, 6.0, 7.0])}, "", False)
    assert any("median [ms]" in text.get_text() for text in figures[0].axes[0].texts)
