"""Waits until a frame has a parent on /tf, and prints that. usage: wait_for_frame.py FRAME"""

import sys
import threading

import rospy
from tf2_msgs.msg import TFMessage


def main():
    found = threading.Event()
    parents = []

    def on_tf(message):
        for transform in message.transforms:
            if transform.child_frame_id == sys.argv[1]:
                parents.append(transform.header.frame_id)
                found.set()

    rospy.init_node("wait_for_frame", disable_signals=True)
    rospy.Subscriber("/tf", TFMessage, on_tf)
    found.wait()
    print(parents[0])


if __name__ == "__main__":
    main()
