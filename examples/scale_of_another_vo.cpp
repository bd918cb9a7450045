// scale_of_another_vo HEIGHT < FRAMES: the metric scale for a monocular odometry of another
// project. HEIGHT is that of the camera above the road [m]. FRAMES begins with the rectified camera
// (width height fx fy cx cy [px]). Each frame follows: stamp [ns], number of features, camera pose
// (3x4 by rows, camera to map) and, for each feature by ascending id: id, pixel u v, its map point
// x y z in camera axes and the standard deviation of z; lengths in units of that odometry. Prints
// for each frame with a metric pose the stamp [s], scale [m per unit], its standard deviation, and
// the metric position [m].

#include <iostream>
#include <stdexcept>
#include <string>

#include "ground_scale_vo/scale/scale_recovery.hpp"

int main(int argc, char** argv) try {
  gsv::ScaleRecovery::Options options;
  if (argc != 2) throw std::invalid_argument("usage: scale_of_another_vo HEIGHT < FRAMES");
  options.camera_height = std::stod(argv[1]);
  gsv::ScaleRecovery scale_recovery(options);
  gsv::VoFrame frame;
  gsv::PinholeCamera& camera = frame.camera;
  std::cin >> camera.width >> camera.height >> camera.fx >> camera.fy >> camera.cx >> camera.cy;
  std::size_t features;
  for (; std::cin >> frame.stamp_ns >> features; ++frame.sequence) {
    frame.status = gsv::VoStatus::kTracking;  // kLost: a frame without a pose
    for (int k = 0; k < 12; ++k) std::cin >> frame.T_w_c(k / 4, k % 4);
    frame.features.resize(features);
    for (gsv::TrackedFeature& feature : frame.features) {
      feature.has_point = true;
      std::cin >> feature.id >> feature.u.x() >> feature.u.y() >> feature.p_c.x() >>
          feature.p_c.y() >> feature.p_c.z() >> feature.depth_sigma;
    }
    // A second argument, the rectified grey image, adds the direct measurement.
    const gsv::ScaleRecovery::Output output = scale_recovery.process(frame);
    if (!output.pose) continue;  // no scale yet, or the pose is refused
    std::cout << 1e-9 * static_cast<double>(frame.stamp_ns) << ' ' << output.scale.scale << ' '
              << output.scale.sigma << ' ' << output.pose->T_o_c.translation().transpose() << '\n';
  }
} catch (const std::exception& error) {
  std::cerr << "scale_of_another_vo: " << error.what() << '\n';
  return 1;
}
