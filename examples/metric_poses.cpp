// metric_poses FOLDER HEIGHT: metric odometry of a KITTI odometry folder. HEIGHT is that of the
// camera above the road [m]. Prints the stamp [s] and the position [m] of each image.

#include <fstream>
#include <iostream>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "ground_scale_vo/metric_odometry.hpp"

int main(int argc, char** argv) try {
  if (argc != 3) throw std::invalid_argument("usage: metric_poses FOLDER HEIGHT");
  const std::string folder = argv[1];
  std::vector<std::string> files;
  cv::glob(folder + "/image_0/*.*", files);  // sorted by name
  if (files.empty()) throw std::invalid_argument("no images in " + folder + "/image_0");
  const cv::Size size = cv::imread(files[0], cv::IMREAD_GRAYSCALE).size();

  std::ifstream calib(folder + "/calib.txt"), times(folder + "/times.txt");
  std::string name;  // "P0:", then the projection matrix by rows
  double fx, fy, cx, cy, zero;
  calib >> name >> fx >> zero >> cx >> zero >> zero >> fy >> cy;

  ground_scale_vo::MetricOdometry::Options options;
  options.scale.camera_height = std::stod(argv[2]);
  ground_scale_vo::MetricOdometry odometry({size.width, size.height, fx, fy, cx, cy}, options);
  for (const std::string& file : files) {
    double stamp = 0;
    times >> stamp;
    const cv::Mat image = cv::imread(file, cv::IMREAD_GRAYSCALE);
    const auto output = odometry.process(image, static_cast<std::int64_t>(stamp * 1e9));
    if (!output.scale.pose) continue;  // no metric pose before the first scale is known
    std::cout << stamp << ' ' << output.scale.pose->T_o_c.translation().transpose() << '\n';
  }
} catch (const std::exception& error) {
  std::cerr << "metric_poses: " << error.what() << '\n';
  return 1;
}
