"""Tables I and II of the paper of Tian et al., with its misprints corrected."""

# KITTI odometry sequences with ground truth, and their number of frames.
FRAMES = {"00": 4541, "01": 1101, "02": 4661, "03": 801, "04": 271, "05": 2761, "06": 1101, "07": 1101, "08": 4071,
          "09": 1591, "10": 1201}

# Length of the ground truth and of the paper's trajectory [m]. Its Table I has the two columns swapped, and
# relative errors of 02, 03 and 07 that do not follow from them.
LENGTHS = {"00": (3724.419, 3645.213), "02": (5067.233, 5071.151), "03": (560.888, 547.774),
           "04": (393.645, 391.861), "05": (2205.576, 2175.159), "06": (1232.876, 1235.982),
           "07": (694.697, 709.065), "08": (3222.795, 3137.398), "09": (1705.051, 1738.601), "10": (919.518, 911.399)}

# Table II: per system the mean errors over 100 to 800 m of the sequences 00 to 10.
PAPER = "Tian et al."
TRANSLATION = {  # [%]
    "ORB-SLAM2-noLC": (20.8, None, 9.52, None, None, 18.63, 18.98, 13.82, 22.06, 12.74, 4.86),
    "VISO2-M": (11.91, None, 3.33, 10.66, 7.40, 12.67, 4.74, None, 13.94, 4.04, 25.20),
    "VISO2-Stereo": (2.32, None, 2.01, 2.32, 0.99, 1.78, 1.17, None, 2.35, 2.36, 1.37),
    "Song et al.": (2.04, None, 1.50, 3.37, 2.19, 1.43, 2.09, None, 2.37, 1.76, 2.12),
    "Zhou et al.": (2.17, None, None, 2.70, None, None, None, None, None, None, 2.09),
    "Wagstaff, Kelly": (1.86, None, 2.27, None, None, 1.50, 2.05, 1.78, 2.05, 1.50, 3.70),
    "DNet": (1.94, None, 3.07, None, None, 3.32, 2.74, 2.74, 2.72, 3.70, 5.09),
    PAPER: (1.41, None, 2.18, 1.79, 1.91, 1.61, 2.03, 1.77, 1.51, 1.77, 1.25),
}
ROTATION = {  # [deg/m]
    "VISO2-M": (0.0209, None, 0.0114, 0.0197, 0.0093, 0.0328, 0.0157, None, 0.0203, 0.0143, 0.0388),
    "VISO2-Stereo": (0.0109, None, 0.0074, 0.0107, 0.0081, 0.0098, 0.0072, None, 0.0104, 0.0094, 0.0086),
    "Song et al.": (0.0048, None, 0.0035, 0.0021, 0.0028, 0.0038, 0.0081, None, 0.0044, 0.0047, 0.0085),
    "Zhou et al.": (0.0039, None, None, 0.0044, None, None, None, None, None, None, 0.0054),
    PAPER: (0.0054, None, 0.0046, 0.0041, 0.0021, 0.0064, 0.0044, 0.0230, 0.0076, 0.0118, 0.0031),
}
