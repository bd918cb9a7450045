// metric_poses FOLDER HEIGHT: metric odometry of a KITTI odometry folder. HEIGHT is that of the
// camera above the road [m]. Prints the stamp [s] and the position [m] of each image with a metric
// pose, in the axes of the first camera (x right, y down, z forward).

#include <filesystem>
#include <fstream>
#include <iostream>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "ground_scale_vo/metric_odometry.hpp"

int main(int argc, char** argv) try {
  if (argc != 3) throw std::invalid_argument("usage: metric_poses FOLDER HEIGHT");
  const std::string folder = argv[1];
  const std::string images = folder + "/image_0";
  double height = 0;
  if (!(std::istringstream(argv[2]) >> height)) {
    throw std::invalid_argument("HEIGHT is '" + std::string(argv[2]) +
                                "', it must be a number [m]");
  }
  if (!std::filesystem::is_directory(images)) {
    throw std::invalid_argument(images + ": no such folder");
  }
  std::vector<std::string> files;
  cv::glob(images + "/*.*", files);  // sorted by name
  if (files.empty()) throw std::invalid_argument(images + ": no images");
  const cv::Size size = cv::imread(files[0], cv::IMREAD_GRAYSCALE).size();

  std::ifstream calib(folder + "/calib.txt"), times(folder + "/times.txt");
  std::string name;  // "P0:", then the projection matrix by rows
  double fx, fy, cx, cy, zero;
  if (!(calib >> name >> fx >> zero >> cx >> zero >> zero >> fy >> cy)) {
    throw std::invalid_argument(folder + "/calib.txt: no projection matrix");
  }

  gsv::MetricOdometry::Options options;
  options.scale.camera_height = height;
  const gsv::PinholeCamera camera{size.width, size.height, fx, fy, cx, cy};
  gsv::MetricOdometry odometry(camera, options);
  for (const std::string& file : files) {
    double stamp = 0;
    if (!(times >> stamp)) throw std::invalid_argument(folder + "/times.txt: no stamp for " + file);
    const cv::Mat image = cv::imread(file, cv::IMREAD_GRAYSCALE);
    const auto output = odometry.process(image, static_cast<std::int64_t>(stamp * 1e9));
    if (!output.pose()) continue;  // no scale yet, or tracking is lost
    std::cout << stamp << ' ' << output.pose()->T_o_c.translation().transpose() << '\n';
  }
} catch (const std::exception& error) {
  std::cerr << "metric_poses: " << error.what() << '\n';
  return 1;
}
