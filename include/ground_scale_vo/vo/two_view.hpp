#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/vo/camera.hpp"

namespace ground_scale_vo {

enum class TwoViewStatus {
  kOk,
  kTooFewMatches,
  kTooLittleParallax,  ///< standing still or turning on the spot: a rotation explains it
  kNoModel,            ///< neither an essential matrix nor a homography explains the matches
  kAmbiguous           ///< several motions explain them about equally well
};

/// The motion between two images of a static scene, up to scale, from matched pixels. An essential
/// matrix and a homography compete, so that a planar scene is no special case: every motion that
/// either proposes is judged by the points that it puts before both cameras at their pixels.
class TwoView {
 public:
  struct Options {
    int min_matches = 80;
    double inlier_error =
        0.0021;  ///< reprojection error of an inlier [focal lengths] (1.5 px at 718)
    double min_parallax = 0.012;
    double min_inlier_share = 0.45;
    double max_second_share = 0.9;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("min_matches", self.min_matches, 8, 10000, "[matches] below this no start is tried");
      visit("inlier_error", self.inlier_error, 1e-5, 0.1,
            "[focal lengths] reprojection error of an inlier");
      visit("min_parallax", self.min_parallax, 1e-4, 1, "[rad] median angle left after rotation");
      visit("min_inlier_share", self.min_inlier_share, 0, 1, "[] of the matches");
      visit("max_second_share", self.max_second_share, 0, 1,
            "[] support of the second best motion over that of the best");
    }
    /// Throws OptionError.
    void validate() const;
  };

  struct Result {
    TwoViewStatus status = TwoViewStatus::kNoModel;
    Eigen::Isometry3d T_2_1 = Eigen::Isometry3d::Identity();  ///< |t| = 1
    std::vector<bool> inlier;                                 ///< for each match: has a point
    std::vector<double> inverse_depth_1;  ///< 1 / z in the first camera; valid where inlier
    double median_parallax = 0;           ///< [rad]
    bool planar = false;                  ///< the homography's motion won
  };

  explicit TwoView(const Options& options);

  /// u1, u2: [px], same length. Deterministic.
  Result estimate(const PinholeCamera& camera, const std::vector<Eigen::Vector2d>& u1,
                  const std::vector<Eigen::Vector2d>& u2) const;

 private:
  Options options_;
};

}  // namespace ground_scale_vo
