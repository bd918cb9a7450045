"""report.html, the page of a run."""

import html.parser
import json
import sys

import cv2
import numpy as np
import pytest
import run_page
from conftest import CAMERA_HEIGHT, images_of, run, tool

FRAMES = 60


class Page(html.parser.HTMLParser):
    """Fails where the elements of a page are not nested. words: its text."""

    def __init__(self, folder):
        super().__init__()
        self.words, self.elements, self._open = "", [], []
        text = (folder / "report.html").read_text(encoding="utf-8")
        assert "http" not in text and "<script" not in text  # one file without network
        self.feed(text)
        self.close()
        assert not self._open

    def handle_starttag(self, tag, attrs):
        self.elements.append(tag)
        if tag not in ("meta", "img", "br"):
            self._open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append(tag)

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        self.words += data


@pytest.fixture
def folder(tmp_path):
    """results(state of each frame): a folder; 1 m a frame, those that are lost are bridged after them."""
    def results(states, said, **metrics):
        known = np.array([state in ("ok", "held") for state in states])
        poses = np.tile(np.eye(3, 4), (FRAMES, 1, 1))
        poses[:, 2, 3] = np.maximum.accumulate(np.where(known, np.arange(FRAMES), 0))
        np.savetxt(tmp_path / "poses.txt", poses.reshape(FRAMES, 12))
        rows = [f"{i},{100 + 0.1 * i},{state if ok else 'unknown'},{'none' if state == 'ok' else 'no_plane'},"
                f"{2.2 if i == 20 else 2 * ok},{2 * ok},{0.04 * ok},{'lost' if state == 'lost' else 'tracking'}"
                for i, (state, ok) in enumerate(zip(states, known))]
        (tmp_path / "scale.csv").write_text(
            "\n".join(["frame,stamp,status,reason,raw_scale,scale,sigma,vo_status", *rows]))
        (tmp_path / "run.json").write_text(json.dumps(said))
        (tmp_path / "metrics.json").write_text(json.dumps({
            "frames": FRAMES, "tracked_frames": FRAMES, "lost_events": states.count("lost"), "camera_height_m": 1.65,
            "length_m": poses[-1, 2, 3], "length_sigma_m": 0.25, "gt_length_m": None, "t_err_percent": None,
            "smoothed": False, **metrics}))
        return tmp_path
    return results


def test_good_run(folder):
    lens = {"f": 718.125, "cx": 607, "cy": 185, "k1": 0.0125, "k2": 0}
    results = folder(["ok"] * FRAMES, {"given_lens": lens, "lens": {**lens, "f": 719.5}, "lens_sigma": lens})
    wanted = []
    verdict = run_page.write(results, ["ground_scale_vo", "run", "a & b"], lambda frames: wanted.extend(frames) or
                             [np.zeros((10, 20), np.uint8), None])
    assert verdict == (0, "Usable", ["tracked in 60 of 60 images, scale measured over 100 % of the distance, length known "
                                     "to ± 0.8 %"])
    page = Page(results)
    for text in ("✓ Usable", "59.0 ± 0.5 m", "Measured scale +10.0 % from the filtered one", "frame 20, 2.0 s", "719.50",
                 "ground_scale_vo run 'a & b'"):
        assert text in page.words
    assert wanted == [0, 20] and page.elements.count("img") == 1 and page.elements.count("svg") == 3


def test_run_with_losses(folder):
    results = folder(["ok"] * 25 + ["lost"] * 5 + ["ok"] * 10 + ["held"] * 15 + ["ok"] * 5,
                     {"warnings": ["2 images <are> not used"], "first_image": 7, "given_lens": {}})
    wanted = []
    verdict = run_page.write(results, images_at=lambda frames: wanted.extend(frames) or [None] * len(frames))
    assert verdict == (1, "Usable in part", ["position lost 1× (at 24 m), 10 % of the distance is bridged",
                                             "scale not measured over 25 % of the distance", "1 warning, see below"])
    page = Page(results)
    for text in ("! Usable in part", "Position lost for 0.5 s; 6.0 m are bridged", "2 images <are> not used",
                 "Scale held for 15.0 m: what is ahead is not one plane", "this drive did not change it"):
        assert text in page.words
    assert wanted == [7, 27, 32, 54]


def test_failed_run(folder):
    results = folder(["unknown"] * FRAMES, {"failure": "no metric pose: there is no road", "warnings": []})
    assert run_page.write(results) == (2, "Not usable", ["no metric pose: there is no road"])
    page = Page(results)
    assert "No metric pose for 5.9 s: what is ahead is not one plane" in page.words and "svg" not in page.elements


@pytest.mark.parametrize("door", ["folder", "bag", "run_sequence"])
def test_images_of_the_drive(gsv_command, short, bag, tmp_path, door):
    numbers = [0, 1, 30]
    height = ["--camera-height", CAMERA_HEIGHT]
    if door == "run_sequence":
        run(tool("run_sequence"), short, *height, "--out", tmp_path, "--images", *numbers)
        found = [cv2.imread(str(tmp_path / f"{number}.png"), cv2.IMREAD_GRAYSCALE) for number in numbers]
    else:
        from ground_scale_vo import command_line
        drive = short if door == "folder" else bag
        assert gsv_command("run", drive, *height)[0] == 0
        page = Page(tmp_path / "results" / drive.stem)
        assert page.elements.count("img") >= 1 and f"ground_scale_vo run {drive}" in page.words
        arguments = command_line.parse(["run", str(drive), *map(str, height)])
        found = command_line.opener(drive, arguments)().images_at(numbers)
    every = images_of(short)
    assert all(np.array_equal(image, every[number]) for image, number in zip(found, numbers))


def test_run_without_a_trajectory(gsv_command, shortest, tmp_path):
    mask = 0 * images_of(shortest)[0]
    mask[:4, :4] = 255
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    status, _, message = gsv_command("run", shortest, "--camera-height", CAMERA_HEIGHT, "--mask", "mask.png")
    page = Page(tmp_path / "results/shortest")
    assert status == 1 and "Not usable" in page.words and message.partition(": ")[2].strip() in page.words


def test_without_jinja2(gsv, gsv_command, shortest, tmp_path, monkeypatch):
    monkeypatch.delattr(gsv, "run_page", raising=False)
    monkeypatch.setitem(sys.modules, "ground_scale_vo.run_page", None)  # importing it fails
    status, _, message = gsv_command("run", shortest, "--camera-height", CAMERA_HEIGHT)
    assert status == 0 and message.startswith("no report.html: ")
    assert (tmp_path / "results/shortest/trajectory.png").exists()
