#pragma once

#include <Eigen/Geometry>
#include <deque>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/scale/ground_point_extraction.hpp"
#include "ground_scale_vo/scale/plane_fit.hpp"

namespace ground_scale_vo {

/// Ground Point Aggregation (GPA, the paper's section III.B and Alg. 2): a sliding window of
/// frames, their ground points transformed into one camera frame, and the plane through them.
class GroundPointAggregation {
 public:
  struct Options {
    double window_heights = 3.0;
    int max_frames = 60;
    int min_frames = 1;
    /// A map point has one error however often it is seen; its copies are not independent.
    bool unique_features = true;
    PlaneFit::Options fit;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("window_heights", self.window_heights, 0, 1e6,
            "[camera heights] length of the window, as distance travelled");
      visit("max_frames", self.max_frames, 1, 1e6,
            "[frames] in the window at most (Alg. 2 line 8)");
      visit("min_frames", self.min_frames, 1, 1e6, "[frames] that the window needs to be used");
      visit("unique_features", self.unique_features,
            "[] a feature seen in several frames counts once, with its newest point");
    }
    /// Throws OptionError.
    void validate() const;
  };

  struct Result {
    PlaneFit::Result fit;            ///< in the axes of the camera asked for
    std::vector<PlanePoint> window;  ///< the points of the fit, newest frame first
  };

  /// Throws OptionError.
  explicit GroundPointAggregation(const Options& options);

  /// Appends the newest frame. Precondition: the camera has moved since the last one, otherwise the
  /// window fills with copies. travelled: distance since the start of the map, not decreasing [VO
  /// units].
  void add(const Eigen::Isometry3d& T_w_c, double travelled,
           const std::vector<GroundPoint>& points);

  /// Plane of the window in the camera T_w_c, which need not be the newest frame's.
  /// height_hint: approximate camera height [VO units], > 0; converts the window's length.
  Result estimate(const Eigen::Isometry3d& T_w_c, double travelled, const NormalPrior& prior,
                  double height_hint);

  void reset();

 private:
  struct Frame {
    Eigen::Isometry3d T_w_c;
    double travelled;
    std::vector<GroundPoint> points;
  };
  std::vector<PlanePoint> window(const Eigen::Isometry3d& T_w_c) const;

  Options options_;
  PlaneFit fit_;
  std::deque<Frame> queue_;  ///< Alg. 2's buffer, oldest first
};

}  // namespace ground_scale_vo
