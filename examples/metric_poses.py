"""metric_poses.py FOLDER HEIGHT: as metric_poses.cpp, in Python. Prints the stamp [s] and the position
[m] of each image with a metric pose, in the axes of the first camera (x right, y down, z forward).
"""

import sys

import ground_scale_vo as gsv


def main(folder, height):
    drive = gsv.open_drive(folder)
    odometry = gsv.MetricOdometry(drive.camera, float(height))
    for image, stamp in drive:
        result = odometry.process(image, stamp)
        if result.pose is not None:  # else no scale yet, or tracking is lost
            x, y, z = result.pose[:3, 3]
            print(f"{1e-9 * stamp:g} {x:g} {y:g} {z:g}")


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except (TypeError, ValueError) as error:
        sys.exit(f"metric_poses.py: {error}")
