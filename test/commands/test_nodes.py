"""The Python nodes that the launch files start."""

import fcntl
import os
import re
import signal
import socket
import subprocess

import pytest
from conftest import ROOT, TIMEOUT_S

MODULE_OF_ROS = re.compile(rb"\| +(gen(msg|py)|ros\w+|yaml|numpy)\b")  # or of its dependencies


@pytest.mark.parametrize("node", ["playback_monitor", "view_frame", "feed_another_vo", "bag_recorder"])
def test_interrupt_during_the_imports_ends_silently(node):
    """roslaunch interrupts a node that has just been started when a required one ends."""
    reader, writer = os.pipe()
    # The node blocks in a write while it imports, because the pipe is small and nobody reads it.
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, 4096)
    with subprocess.Popen(["/usr/bin/python3", "-X", "importtime", ROOT / "nodes" / node],
                          stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=writer) as process:
        os.close(writer)
        with open(reader, "rb", buffering=0) as stderr:
            line = b""
            while not MODULE_OF_ROS.search(line):
                line = stderr.readline()
                assert line, "no module of ROS is imported"
            process.send_signal(signal.SIGINT)
            output = stderr.read().decode()
        assert process.wait(TIMEOUT_S) == -signal.SIGINT
    assert "Traceback" not in output, output


@pytest.mark.parametrize("node", ["playback_monitor", "view_frame", "feed_another_vo"])
def test_interrupt_during_the_registration_ends_silently(node, tmp_path):
    with socket.create_server(("localhost", 0)) as master:
        environment = {**os.environ, "ROS_LOG_DIR": str(tmp_path),
                       "ROS_MASTER_URI": f"http://localhost:{master.getsockname()[1]}"}
        process = subprocess.Popen(["/usr/bin/python3", ROOT / "nodes" / node], env=environment,
                                   stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                   stderr=subprocess.STDOUT, text=True)
        try:
            master.settimeout(TIMEOUT_S)
            connection, _ = master.accept()  # by rospy.init_node, which waits for the answer
            process.send_signal(signal.SIGINT)
            connection.close()
            master.close()
            output, _ = process.communicate(timeout=TIMEOUT_S)
        finally:
            process.kill()
    assert process.returncode == -signal.SIGINT and not output, output
