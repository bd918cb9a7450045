"""Calls the Python module with random arguments, valid ones among them. A call returns, or raises
TypeError or ValueError; everything else, and a crash, ends the program.

Writes into the working directory.

usage: random_python_calls.py CALLS [SEED]
"""

import faulthandler
import itertools
import math
import random
import sys

import cv2
import ground_scale_vo as gsv
import numpy as np

WIDTH, HEIGHT = 96, 64
STRANGE = [
    None, True, 0, 1, -1, 2**31, 2**63, -2**70, 10**400, 1.5, -0.0, math.nan, math.inf, 1j, "", "text",
    "a\0b", "\ud800", b"bytes", [], {}, object(), int, np.float32(2), np.int8(-3), np.array(1.0),
    np.zeros(0), np.zeros((0, 4, 4)), np.full((2, 4, 4), math.nan), np.zeros((2, 4, 4)),
    np.array(["a"]), np.array([None]), np.zeros((HEIGHT, WIDTH)), np.zeros((HEIGHT, WIDTH), bool),
    np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.zeros((WIDTH, HEIGHT), np.uint8),
    np.ma.masked_all((HEIGHT, WIDTH), np.uint8), np.zeros(3, [("a", int)]),
    np.broadcast_to(np.uint8(7), (HEIGHT, WIDTH)), np.zeros((2 * HEIGHT, WIDTH), np.uint8)[::-2]]
NAMES = ["refine", "random_seed", "max_speed", "tracker/cell_size", "tracker/cel_size", "gpe/min_points",
         "map/window", "paper_literal", "", "x"]


class Calls:
    def __init__(self, rng):
        self.rng = rng
        self.camera = gsv.Camera(WIDTH, HEIGHT, 60, 60, 48, 32)
        noise = np.random.default_rng(rng.randrange(2**32)).integers(0, 256, (300, 300), np.uint8)
        self.road = cv2.GaussianBlur(noise, (0, 0), 1.5)
        self.stamps = itertools.count(0, 10**8)
        self.odometry = gsv.MetricOdometry(self.camera, 1.5, record=True)
        self.result = self.odometry.process(self.image(), next(self.stamps))
        self.images = 1  # that the odometry has processed

    def image(self):
        """A section of the road of random size: the camera jumps forwards and backwards."""
        size = 100 + self.rng.randrange(200)
        return cv2.resize(self.road[:size, :size], (WIDTH, HEIGHT))

    def any(self, *valid):
        if self.rng.random() < 0.7:
            return self.rng.choice(valid)
        return self.rng.choice([*STRANGE, self.camera, self.odometry, self.result])

    def truth(self):
        poses = np.repeat(np.eye(4)[None], self.rng.choice([self.images, 3]), axis=0)
        return self.any(None, poses), self.any(None, np.ones(self.images))

    def call(self):
        kind = self.rng.randrange(10)
        if kind == 0:
            camera = self.any(self.camera._replace(**{self.rng.choice(self.camera._fields): self.any(60)}))
            gsv.MetricOdometry(camera, 1.5)
        elif kind == 1:
            names = self.rng.sample(NAMES, self.rng.choice([0, 0, 0, 1, 2]))
            options = {name: self.any(True, False, 1, 20, 0.5) for name in names}
            self.odometry = gsv.MetricOdometry(
                self.any(self.camera), self.any(1.5), mask=self.any(None, self.image()),
                record=self.any(True), **options)
            self.images = 0
        elif kind == 2:
            self.odometry.metrics(*self.truth())
        elif kind == 3:
            self.odometry.write(self.any("results"), *self.truth())
        elif kind == 4:
            list(gsv.read_kitti(self.any("results", "drive")))
        elif kind == 5:
            assert self.odometry.poses().shape == (self.images, 4, 4)
        else:
            self.result = self.odometry.process(self.any(self.image()), self.any(next(self.stamps)))
            self.images += 1


def main():
    faulthandler.enable()
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    calls, done, refused = Calls(random.Random(seed)), 0, 0
    for _ in range(int(sys.argv[1])):
        try:
            calls.call()
            done += 1
        except (TypeError, ValueError) as error:
            assert str(error)
            refused += 1
    print(f"{done} done, {refused} refused")


if __name__ == "__main__":
    main()
