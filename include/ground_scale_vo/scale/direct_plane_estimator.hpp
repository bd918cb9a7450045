#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/scale/ground_plane.hpp"
#include "ground_scale_vo/scale/motion_history.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"
#include "ground_scale_vo/vo/vo_frame.hpp"

namespace ground_scale_vo {

/// The plane from the road's pixels: between two frames of known motion (R, t) a pixel of the plane
/// m = n / h with ray r moves to R r - t (m . r), so the plane that makes earlier pictures fall on
/// the present one is the road. It needs texture but no corners, and no points.
///
/// The road ahead is cut into small tiles. A tile of the present picture is sampled on a grid, and
/// so is each earlier picture where the plane says; both are freed of their mean and contrast,
/// so light, shade and exposure drop out. All that a wrong plane does to a tile is to shift it
/// along its epipolar line: each tile and each earlier picture give one shift of q = m . r with a
/// variance (large where the texture runs along the line), and a robust fit to the shifts moves m.
/// In that fit the motion itself is uncertain, which a shift common to all tiles may also mean; the
/// road is rough, which limits what one tile says; and tiles that disagree (kerbs, wheels) lose
/// their weight. Repeated until m rests.
class DirectPlaneEstimator {
 public:
  struct Options {
    double min_ahead_h = 1.5;  ///< the strip of road that is looked at, along the path
    double max_ahead_h = 10;
    double half_width_h = 1.0;   ///< the lane alone: kerb and pavement lie higher
    double tile = 0.03;          ///< [focal lengths] side of a tile
    double blur = 0.0010;        ///< [focal lengths] of the pictures, before they are sampled
    double baseline_h = 0.7;     ///< to the first earlier picture; the second is twice as far
    double noise = 2;            ///< [grey levels] a tile with less contrast counts little
    double registration = 1e-4;  ///< [focal lengths] a tile's place is no better known than this
    double roughness_h = 0.005;
    double bend_sigma = 1e-3;          ///< [1/camera height] of the road, up and down
    double rotation_sigma_rad = 7e-5;  ///< of the motion between two frames
    double direction_sigma_rad = 1e-3;
    int max_iterations = 12;
    double max_step = 1.4;         ///< factor between height found and predicted
    double min_correlation = 0.8;  ///< of the tiles on the plane found
    double max_sigma = 0.05;       ///< relative, of the height
    int min_tiles = 24;

    double search_range = 10;          ///< factor around the features' median height
    double search_correlation = 0.75;  ///< of a start, over the shorter baseline
    double search_lead = 0.15;         ///< and so much before every other height
    double search_agreement = 0.09;    ///< relative, between the two baselines
    double search_every_h = 3;         ///< while alignment fails

    double foreign_h = 0.1;       ///< a feature's point is this far off the plane: no road
    double static_memory_h = 10;  ///< way over which what stands still in the picture is learnt
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("min_ahead_h", self.min_ahead_h, 0, 1000,
            "[camera heights] where the strip of road begins");
      visit("max_ahead_h", self.max_ahead_h, 0.1, 1000,
            "[camera heights] where it ends, or 6 beyond the nearest road in the picture");
      visit("half_width_h", self.half_width_h, 0.01, 1000, "[camera heights] its half width");
      visit("tile", self.tile, 1e-3, 1, "[focal lengths] side of a tile");
      visit("blur", self.blur, 0, 0.1, "[focal lengths] smoothing of the pictures");
      visit("baseline_h", self.baseline_h, 0.01, 100,
            "[camera heights] to the first earlier picture; the second is twice as far");
      visit("noise", self.noise, 0.01, 255,
            "[grey levels] a tile with less contrast counts little");
      visit("registration", self.registration, 0, 1,
            "[focal lengths] a tile's place is no better known than this");
      visit("roughness_h", self.roughness_h, 1e-6, 1,
            "[camera heights] of the road: limits the weight of a tile");
      visit("bend_sigma", self.bend_sigma, 1e-9, 1,
            "[1/camera height] curvature of the road up and down");
      visit("rotation_sigma_rad", self.rotation_sigma_rad, 1e-9, 1,
            "[rad] of the odometry's rotation between two pictures");
      visit("direction_sigma_rad", self.direction_sigma_rad, 1e-9, 1,
            "[rad] of its direction of motion between them");
      visit("max_iterations", self.max_iterations, 1, 1000, "[iterations] of an alignment");
      visit("max_step", self.max_step, 1, 100, "[] factor between height found and predicted");
      visit("min_correlation", self.min_correlation, 0, 1, "[] of the tiles on the plane found");
      visit("max_sigma", self.max_sigma, 1e-4, 10, "[] relative, of the height found");
      visit("min_tiles", self.min_tiles, 3, 1e6, "[tiles] fewer are no plane");
      visit("search_range", self.search_range, 1, 1000,
            "[] a start is sought within this factor of the features' median height");
      visit("search_correlation", self.search_correlation, 0, 1, "[] least one of a start");
      visit("search_lead", self.search_lead, 0, 2, "[] of its correlation before other heights");
      visit("search_agreement", self.search_agreement, 1e-3, 1,
            "[] relative, of the heights over both baselines");
      visit("search_every_h", self.search_every_h, 0, 1e6,
            "[camera heights] between searches while alignment fails");
      visit("foreign_h", self.foreign_h, 1e-3, 100,
            "[camera heights] a feature this far off the plane is no road");
      visit("static_memory_h", self.static_memory_h, 0.1, 1e6,
            "[camera heights] way over which what stands still in the image is learnt");
    }
    /// Throws OptionError.
    void validate() const;
  };

  struct Result {
    /// kNone: plane, height_sigma and correlation are valid. Otherwise kStandstill (no earlier
    /// picture from another place) or kNoPlane.
    ScaleReason status = ScaleReason::kNoPlane;
    GroundPlane plane;        ///< in the frame's camera axes, VO units
    double height_sigma = 0;  ///< VO units
    double correlation = 0;   ///< of present and earlier tiles, weighted by their texture
    int tiles = 0;            ///< pairs of tiles it rests on
    bool searched = false;    ///< found by the search, not from the prediction
  };

  explicit DirectPlaneEstimator(const Options& options);
  ~DirectPlaneEstimator();

  /// frame: tracking, of the map since reset(); image: its rectified picture (8-bit grey, of the
  /// camera's size). prior: of the normal, in this camera's axes.
  /// chord: averaged motion; tells where the path leads. height: predicted [VO units]; 0 when it is
  /// not known: then it is sought. Keeps the picture for the frames to come.
  Result align(const VoFrame& frame, const cv::Mat& image, const NormalPrior& prior,
               const std::optional<MotionHistory::Chord>& chord, double height);

  /// A new map: forgets the pictures, but not what stands still in them.
  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ground_scale_vo
