"""scripts/evaluate, scripts/ablation and the offline run behind them."""

import matplotlib.image
import numpy
import pytest
from conftest import SCRIPTS, assert_refused, on_full_disk, on_terminal, run, tool

EVALUATE = SCRIPTS / "evaluate"
RUN_SEQUENCE = tool("run_sequence")


def test_progress_on_a_terminal(shortest, tmp_path):
    output = on_terminal(RUN_SEQUENCE, shortest, "--camera-height", 1.65, "--out", tmp_path)
    assert "\rshortest: 12/12 frames, " in output


def test_set_reaches_the_run(short, tmp_path):
    done = run(EVALUATE, short, "--out", tmp_path, "--set", "refine=false", "--set",
               "gpe/min_points=1000000")
    assert "no frame got a scale" in done.stdout + done.stderr


@pytest.mark.parametrize("text, arguments", [
    ("there is no option foo", ["SHORT", "--set", "foo=1"]),
    ("gpe/min_points", ["SHORT", "SHORTEST", "--set", "gpe/min_points=abc"]),
    ("--camera-height", ["SHORT", "--camera-height", "0"]),
    ("--scenarios", ["SHORT", "--ablation"]),
    ("unknown scenario", ["--scenarios", "none"]),
    ("unknown fault", ["--faults", "none"]),
    ("--faults", ["SHORT", "--seed", "1"]),
    ("--mask", ["--scenarios", "--mask", "mask.png"]),
    ("--faults", ["--faults", "--set", "refine=false"]),
    ("tracker/cell_size is 7", ["--scenarios", "pitched", "--set", "tracker/cell_size=7"]),
])
def test_wrong_arguments(short, shortest, tmp_path, text, arguments):
    sequences = {"SHORT": short, "SHORTEST": shortest}
    arguments = [sequences.get(word, word) for word in arguments]
    assert_refused(2, text, EVALUATE, *arguments, "--out", tmp_path)


@pytest.mark.parametrize("command", ["evaluate", "benchmark", "ablation"])
def test_no_such_folder(command):
    assert_refused(1, "none: no such folder", SCRIPTS / command, "none")


def test_mask(short, tmp_path):
    """One that hides everything: no corner is found."""
    mask = tmp_path / "mask.png"

    def write(value, width=800):
        matplotlib.image.imsave(mask, numpy.full((248, width), value), cmap="gray", vmin=0, vmax=1)

    for value, found in ((0, False), (1, True)):
        write(value)
        done = run(EVALUATE, short, "--out", tmp_path, "--mask", mask)
        assert ("no frame got a scale" not in done.stdout + done.stderr) == found
    write(1, width=799)
    assert_refused(1, f"--mask {mask} is 799x248, the camera 800x248", EVALUATE, short, "--out",
                   tmp_path, "--mask", mask)
    assert_refused(1, "none.png", EVALUATE, short, "--out", tmp_path, "--mask", "none.png")


def test_misspelt_option(short, tmp_path):
    assert_refused(2, "did you mean tracker/cell_size?", RUN_SEQUENCE, short, "--camera-height",
                   1.65, "--out", tmp_path, "--set", "tracker/cel_size=1")


def test_refuses_to_overwrite_the_sequence(short):
    assert_refused(1, "over the sequence", RUN_SEQUENCE, short, "--camera-height", 1.65, "--out",
                   short.parent)


def test_damaged_folder(damaged_folder, tmp_path):
    folder, reason = damaged_folder
    assert_refused(1, reason, EVALUATE, folder, "--out", tmp_path)


@pytest.mark.parametrize("command", ["evaluate", "benchmark", "ablation"])
def test_two_sequences_of_one_name(short, tmp_path, command):
    (tmp_path / "short").mkdir()
    assert_refused(2, "have the same name", SCRIPTS / command, short, tmp_path / "short")


def test_ablation_wrong_arguments():
    assert_refused(2, "SEQ is missing", SCRIPTS / "ablation")


def test_covariance_table(shortest, tmp_path):
    run(RUN_SEQUENCE, shortest, "--camera-height", 1.65, "--out", tmp_path)
    table = run(tool("covariance_table.py"), tmp_path / "shortest").stdout
    assert "NEES 10 m" in table and "\nshortest " in table and "of 1 drives" in table


def test_covariance_table_without_metrics(tmp_path):
    assert_refused(1, "metrics.json: cannot be read", tool("covariance_table.py"), tmp_path)


def test_full_disk(short, tmp_path):
    assert_refused(1, "poses.txt: cannot be written, File too large", RUN_SEQUENCE, short,
                   "--camera-height", 1.65, "--out", tmp_path, **on_full_disk(1))
    assert list((tmp_path / "short").iterdir()) == []


def test_plots_on_full_disk(shortest, tmp_path):
    run(RUN_SEQUENCE, shortest, "--camera-height", 1.65, "--out", tmp_path)
    results = tmp_path / "shortest"
    assert_refused(1, "cannot be drawn", tool("plot_run.py"), results, **on_full_disk(10))
    assert not [file for file in results.iterdir() if ".tmp" in file.name]
