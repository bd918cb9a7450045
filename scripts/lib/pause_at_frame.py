#!/usr/bin/env python3
"""Pauses the playback of kitti.launch when a frame has left both nodelets.

usage: pause_at_frame.py FRAME
"""

import sys
import threading

import rospy
from ground_scale_vo.msg import ScaleEstimate, VoFrame
from std_srvs.srv import SetBool


def main():
    frame = int(sys.argv[1])
    rospy.init_node("pause_at_frame", disable_signals=True)
    reached = threading.Event()
    wanted = {}

    def on_frame(message):
        if message.sequence >= frame:
            wanted.setdefault("stamp", message.header.stamp)

    def on_scale(message):
        if "stamp" in wanted and message.header.stamp >= wanted["stamp"]:
            reached.set()

    subscribers = [
        rospy.Subscriber("vo/frame", VoFrame, on_frame, queue_size=10),
        rospy.Subscriber("scale", ScaleEstimate, on_scale, queue_size=10),
    ]
    reached.wait()
    for subscriber in subscribers:
        subscriber.unregister()
    rospy.ServiceProxy("bag_player/pause_playback", SetBool)(True)


if __name__ == "__main__":
    main()
