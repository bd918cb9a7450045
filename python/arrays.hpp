#pragma once

// The module ground_scale_vo._core: what both of its files use.

#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <tuple>
#include <vector>

#include "ground_scale_vo/input/camera.hpp"

namespace py = pybind11;

using Poses = std::vector<Eigen::Isometry3d>;
using RowMajor4d = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;
using Bytes = py::array_t<std::uint8_t, py::array::c_style>;
using Reals = py::array_t<double, py::array::c_style>;
using CameraTuple = std::tuple<int, int, double, double, double, double, bool>;

/// rows x columns, or rows x columns x channels. Precondition: the image is continuous.
inline Bytes fromImage(const cv::Mat& image) {
  auto* owned = new cv::Mat(image);
  const py::capsule owner(owned, [](void* mat) { delete static_cast<cv::Mat*>(mat); });
  std::vector<py::ssize_t> shape{image.rows, image.cols};
  if (image.channels() > 1) shape.push_back(image.channels());
  return Bytes(shape, image.data, owner);
}

/// N x 4 x 4.
inline Reals fromPoses(const Poses& poses) {
  Reals array({static_cast<py::ssize_t>(poses.size()), py::ssize_t{4}, py::ssize_t{4}});
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const auto row = static_cast<py::ssize_t>(i);
    Eigen::Map<RowMajor4d>(array.mutable_data(row)) = poses[i].matrix();
  }
  return array;
}

inline CameraTuple toTuple(const gsv::PinholeCamera& c) {
  return {c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.lens_is_estimated};
}

/// Drives: Reader, open_files, open_messages, run, calibrate_lens; angles of the mounting.
void addDrives(py::module* module);
