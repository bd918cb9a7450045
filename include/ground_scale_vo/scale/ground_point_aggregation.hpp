#pragma once

#include <Eigen/Geometry>
#include <deque>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/scale/ground_point_extraction.hpp"
#include "ground_scale_vo/scale/plane_fit.hpp"

namespace ground_scale_vo {

/// Ground Point Aggregation (GPA, the paper's section III.B and Alg. 2): the ground points of a
/// window of frames, moved into one frame, and the plane through them.
class GroundPointAggregation {
 public:
  struct Options {
    double window_h = 3.0;  ///< length of the window along the way [camera heights]
    int max_frames = 60;    ///< and at most this many frames (Alg. 2 line 8; the paper: 4)
    int min_frames = 1;     ///< the window is used from this many frames on
    int max_points = 3000;  ///< and points (the oldest frames go first)
    /// A feature seen in several frames of the window counts once, with its newest point. The map
    /// point is the same one: its copies would only pretend to be independent.
    bool feature_once = true;
    PlaneFit::Options fit;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("window_h", self.window_h, 0, 1e6,
            "[camera heights] length of the window along the way");
      visit("max_frames", self.max_frames, 1, 1e6, "[frames] in the window at most");
      visit("min_frames", self.min_frames, 1, 1e6, "[frames] with fewer the window is not used");
      visit("max_points", self.max_points, 3, 1e7, "[points] in the window at most");
      visit("feature_once", self.feature_once,
            "[] a feature of several frames counts once, with its newest point");
    }
    /// Throws OptionError.
    void validate() const;
  };

  struct Result {
    PlaneFit::Result fit;            ///< in the newest frame's axes
    std::vector<PlanePoint> window;  ///< the points it was given
  };

  explicit GroundPointAggregation(const Options& options);

  /// Appends the newest frame. A frame that moved less than min_step since the one before takes its
  /// place, so standing still does not fill the window with copies (0: never).
  /// travelled: way since the start of the map, not decreasing; min_step likewise [VO units].
  void add(const Eigen::Isometry3d& T_w_c, double travelled, const std::vector<GroundPoint>& points,
           double min_step);

  /// Plane of the window in the camera T_w_c, which need not be that of the newest frame.
  /// height_hint: rough camera height [VO units], > 0: the unit of the window's length.
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
  std::deque<Frame> queue_;  ///< oldest first
};

}  // namespace ground_scale_vo
