"""Fixtures of the command tests: rendered sequences and bags, and ways to run a command.

scripts/test runs these tests with the environment of its build (scripts/lib/environment.sh). Each launch
has a ROS master of its own, so the tests may run at the same time.
"""

import contextlib
import fcntl
import importlib
import json
import os
import pathlib
import pty
import re
import resource
import select
import signal
import socket
import subprocess
import sys
import time
import xmlrpc.client

import bags
import cv2
import numpy as np
import pytest
from std_msgs.msg import String

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCRIPTS = ROOT / "scripts"
sys.path.insert(0, str(SCRIPTS))  # for the tests of the Python scripts as modules
BUILD = pathlib.Path(os.environ.get("GROUND_SCALE_VO_BUILD", ROOT / "build"))
TIMEOUT_S = 600
CAMERA_HEIGHT = 1.65
FRAMES = 40  # of the sequence `short`


def tool(name):
    """An executable of the build."""
    return BUILD / "devel/lib/ground_scale_vo" / name


def run(command, *arguments, check=True, timeout=TIMEOUT_S, **options):
    """Runs a command; its result has the texts `stdout` and `stderr`."""
    done = subprocess.run([str(word) for word in (command, *arguments)], stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                          timeout=timeout, **options)
    assert not check or done.returncode == 0, f"status {done.returncode}\n{done.stdout}{done.stderr}"
    return done


def on_full_disk(kib):
    """Option of run(): the command can write no file larger than this, as after `ulimit -f`."""
    cache = BUILD / "CMakeCache.txt"
    if cache.exists() and "GROUND_SCALE_VO_COVERAGE:BOOL=ON" in cache.read_text():
        pytest.skip("the counters of executed lines could not be written either, and would be lost")

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (kib * 1024, kib * 1024))
    return {"preexec_fn": limit}


def assert_one_sentence(text, stderr):
    """A command wrote one sentence, which contains the text. Beside it may stand the progress of a run of more than
    ten seconds, on a slow machine, and warnings of FFmpeg, OpenCV 4.10 and ROS 1.17."""
    others = r"\w+: \d+/\d+ |\[mov,|\[ WARN:|Warning: class_loader|\s+at line \d+ in "
    sentences = [line for line in stderr.splitlines() if not re.match(others, line)]
    assert len(sentences) == 1 and text in sentences[0], stderr


def assert_refused(status, text, command, *arguments, **options):
    """The command exits with this status and one sentence on stderr that contains the text."""
    done = run(command, *arguments, check=False, **options)
    assert done.returncode == status, done.stdout + done.stderr
    assert_one_sentence(text, done.stderr)


def assert_played(output, results, frames=FRAMES):
    """A demo has processed the images and written its results. Where the machine is busy, the nodelets may
    have dropped some."""
    processed = int(re.search(r"(\d+) frames out of both nodelets", output)[1])
    assert frames / 4 <= processed <= frames, output
    for name in ("metrics.json", "trajectory.png", "scale.png", "timing.png", "report.html"):
        assert (results / name).stat().st_size > 0


def wait_until(condition, while_runs=None):
    """Waits for the condition; fails when the process ends first."""
    deadline = time.monotonic() + TIMEOUT_S
    while not condition():
        assert while_runs is None or while_runs.poll() is None, while_runs.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.05)


def pid_of(node, master):
    """Process id of a node, from the URI of its master."""
    _, _, uri = xmlrpc.client.ServerProxy(master).lookupNode("/test", node)
    return xmlrpc.client.ServerProxy(uri).getPid("/test")[2]


@contextlib.contextmanager
def roslaunch(log, file, *arguments):
    """A running roslaunch with a master of its own, and the URI of that. file: of the package, or a path."""
    with socket.socket() as free:
        free.bind(("", 0))
        port = free.getsockname()[1]
    master = f"http://localhost:{port}"
    environment = {**os.environ, "ROS_MASTER_URI": master, "ROS_HOSTNAME": "localhost"}
    with open(log, "w", encoding="utf-8") as output:
        process = subprocess.Popen(
            ["roslaunch", "-p", str(port), *([] if os.path.isabs(file) else ["ground_scale_vo"]),
             str(file), *map(str, arguments)],
            stdin=subprocess.DEVNULL, stdout=output, stderr=output, env=environment)
    try:
        yield process, master
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(TIMEOUT_S)


def on_terminal(command, *arguments, environment=None, answer=""):
    """Runs a command with a terminal as its standard streams, on which somebody types the answer; its output."""
    terminal, streams = pty.openpty()
    os.write(terminal, answer.encode())
    process = subprocess.Popen([str(word) for word in (command, *arguments)], stdin=streams,
                               stdout=streams, stderr=streams, env=environment,
                               start_new_session=True)
    os.close(streams)
    output, deadline = b"", time.monotonic() + TIMEOUT_S
    try:
        while select.select([terminal], [], [], deadline - time.monotonic())[0]:
            output += os.read(terminal, 65536)
    except OSError:  # Linux: the last process has closed the terminal
        pass
    finally:
        os.close(terminal)
    text = output.decode(errors="replace")
    assert process.wait(max(1, deadline - time.monotonic())) == 0, text
    return text


def pip_install(venv, build):
    """Makes a virtual environment with the Python package, installed with pip without network. build: the
    build folder that has compiled it, or compiles it now."""
    run("/usr/bin/python3", "-m", "venv", "--system-site-packages", "--without-pip", venv)
    run(venv / "bin/python", "-m", "pip", "install", "--no-index", "--no-build-isolation", ROOT,
        env={**os.environ, "GROUND_SCALE_VO_PYTHON_BUILD": str(build)})


def made_once(path, make):
    """Calls make() unless this or another worker of pytest has made the path before. Returns the path."""
    with open(f"{path}.lock", "a+", encoding="utf-8") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        lock.seek(0)
        if not lock.read():
            make()
            lock.write("made")
    return path


@pytest.fixture(scope="session")
def data(tmp_path_factory):
    """The folder of what is made once for all tests and workers."""
    folder = tmp_path_factory.getbasetemp()
    return folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder


def rendered(folder, *arguments):
    """A KITTI folder."""
    return made_once(folder, lambda: run(tool("render_drive"), *arguments, folder))


@pytest.fixture(scope="session")
def short(data):
    return rendered(data / "short", "--frames", FRAMES)


@pytest.fixture(scope="session")
def shortest(data):
    return rendered(data / "shortest", "--frames", 12)


@pytest.fixture(scope="session")
def bag(short):
    """`short` as a bag."""
    file = short.with_suffix(".bag")
    return made_once(file, lambda: run(tool("kitti_to_bag"), short, "--out", file))


@pytest.fixture(scope="session")
def low(data):
    """A KITTI folder with a camera 0.6 m above the road."""
    return rendered(data / "low", "--frames", 60, "--camera-height", 0.6, "--stop", 0, "--size", "480x148")


@pytest.fixture(scope="session")
def low_bag(low):
    """`low` as a bag, with GPS fixes on /fix."""
    file = low.with_suffix(".bag")

    def make():
        run(tool("kitti_to_bag"), low, "--out", file)
        bags.add_fixes(file, poses_of(low / "poses.txt"))
    return made_once(file, make)


@pytest.fixture(params=["truncated", "text"])
def damaged_bag(request, bag, tmp_path):
    """A bag that is damaged or holds other messages than images."""
    file = tmp_path / f"{request.param}.bag"
    if request.param == "truncated":
        file.write_bytes(bag.read_bytes()[: bag.stat().st_size // 2])
    else:
        bags.copy(bag, file, lambda topic, message: (topic, String("no image")))
    return file


@pytest.fixture(scope="session")
def evaluated(short, data):
    """The result folder of scripts/evaluate for `short`."""
    out = made_once(data / "evaluated", lambda: run(
        SCRIPTS / "evaluate", short, "--out", data / "evaluated"))
    return out / short.name


@pytest.fixture(scope="session")
def venv(data):
    """A virtual environment with the Python package that the build under test has compiled."""
    folder = data / "venv"
    return made_once(folder, lambda: pip_install(folder, BUILD))


@pytest.fixture(scope="session")
def gsv(venv):
    """The package, which has been imported for the ROS messages already."""
    package = importlib.import_module("ground_scale_vo")
    package.__path__ += map(str, venv.glob("lib/*/site-packages/ground_scale_vo"))
    return package


@pytest.fixture
def gsv_command(gsv, tmp_path, monkeypatch, capfd):
    """gsv_command(ARGUMENT...): exit status, output and stderr of the command ground_scale_vo, which runs in tmp_path, in
    this process: the start of another takes a second."""
    del gsv

    def call(*arguments):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["ground_scale_vo", *map(str, arguments)])
        status = importlib.import_module("ground_scale_vo.command_line").main()
        output = capfd.readouterr()
        return status, output.out, output.err
    return call


def poses_of(file):
    """N x 3 x 4, of a file of KITTI poses."""
    return np.loadtxt(file, ndmin=2).reshape(-1, 3, 4)


def camera_matrix(folder):
    """K of a KITTI folder."""
    projection = (folder / "calib.txt").read_text().splitlines()[0].split()[1:]
    return np.array(projection, float).reshape(3, 4)[:, :3]


def images_of(folder):
    return [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in sorted((folder / "image_0").iterdir())]


def distorted_images_of(folder, D):
    """What a camera with the distortion D would have taken."""
    K, images = camera_matrix(folder), images_of(folder)
    height, width = images[0].shape
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(np.float64).reshape(-1, 1, 2)
    points = cv2.undistortPoints(pixels, K, np.array(D), None, None, K)
    maps = points.reshape(height, width, 2).astype(np.float32)
    return [cv2.remap(image, maps, None, cv2.INTER_CUBIC) for image in images]


def write_camera(file, folder, model="plumb_bob", D=(0, 0, 0, 0, 0), **others):
    """A YAML of camera_calibration for the images of a KITTI folder."""
    height, width = images_of(folder)[0].shape
    keys = {"image_width": width, "image_height": height, "distortion_model": model, **others}
    matrices = {"camera_matrix": camera_matrix(folder).ravel().tolist(), "distortion_coefficients": list(D)}
    file.write_text("".join([*(f"{key}: {json.dumps(value)}\n" for key, value in keys.items()),
                             *(f"{key}:\n  data: {value}\n" for key, value in matrices.items())]))
    return file
