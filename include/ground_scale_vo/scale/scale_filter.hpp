#pragma once

#include <array>
#include <cstdint>
#include <deque>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/scale/scale_estimate.hpp"

namespace ground_scale_vo {

/// Smooths the camera height h in VO units along the way (the paper's section III.C). With a local
/// map neighbouring frames share one scale, so the height is what varies slowly; the scale follows
/// as h*/h. A bias or a slow drift costs accuracy, jitter hardly does: the filter is slow.
///
/// State: ln h with its variance, a random walk in distance. Each source gives at most one
/// measurement a frame, but those of neighbouring frames see the same road: their information is
/// taken per distance, so the frame rate does not matter.
///
/// The gain follows from the options. How large the errors are in this street with this camera does
/// not: sigma() is scaled by how well the measurements of late, rejected ones too, agreed with the
/// state.
class ScaleFilter {
 public:
  enum class Source : std::uint8_t {
    kPoints = 0,  ///< the plane through the ground points
    kPixels = 1   ///< the plane that aligns the road's pixels
  };
  struct Options {
    double correlation_h = 3;  ///< measurements of one source agree over this way [camera heights]
    double drift_per_sqrt_h = 0.01;  ///< random walk of ln h over one camera height of way
    /// ... and over one radian of rotation: a turn replaces the map that carries the scale.
    double drift_per_sqrt_rad = 0.05;
    double measurement_floor = 0.015;  ///< least relative sigma of one measurement
    double gate_sigma = 3;             ///< measurements farther off are rejected
    double agreement_memory_h = 20;    ///< way over which the scale of sigma forgets
    int start_measurements = 4;        ///< the latest few that must agree to start or restart it
    double start_spread = 0.15;        ///< agree: at most this far from their median, relative
    double start_way_h = 5;            ///< and not before this way [camera heights]
    /// Relative error that all measurements of a young map share: they see one piece of road, and
    /// points whose depths one short way has told. It fades as the map grows.
    double start_sigma = 0.1;
    double start_memory_h = 6;  ///< ... over this way from the map's first frame [camera heights]
    double restart_h = 12;      ///< contradiction over this way restarts it [camera heights]
    /// The paper's literal choice: moving average of the scale h*/h over so many frames. 0: off.
    int moving_average_frames = 0;
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("correlation_h", self.correlation_h, 0, 1e6,
            "[camera heights] measurements of one source agree over this way");
      visit("drift_per_sqrt_h", self.drift_per_sqrt_h, 0, 1,
            "[] random walk of ln h over one camera height of way");
      visit("drift_per_sqrt_rad", self.drift_per_sqrt_rad, 0, 1,
            "[] random walk of ln h over one radian of rotation");
      visit("measurement_floor", self.measurement_floor, 1e-4, 1,
            "[] least relative sigma of one measurement");
      visit("gate_sigma", self.gate_sigma, 0.1, 1000,
            "[sigma] measurements farther off are rejected");
      visit("agreement_memory_h", self.agreement_memory_h, 0.1, 1e6,
            "[camera heights] way over which sigma learns how well measurements agree");
      visit("start_measurements", self.start_measurements, 1, 1000,
            "[frames] that must agree to start or restart");
      visit("start_way_h", self.start_way_h, 0, 1e6, "[camera heights] no start before this way");
      visit("start_spread", self.start_spread, 1e-4, 10,
            "[] they agree: at most this far from their median, relative");
      visit("start_sigma", self.start_sigma, 0, 10,
            "[] relative error that the measurements of a young map share");
      visit("start_memory_h", self.start_memory_h, 0.01, 1e6,
            "[camera heights] way over which that error fades");
      visit("restart_h", self.restart_h, 0, 1e6,
            "[camera heights] contradiction over this way restarts it");
      visit("moving_average_frames", self.moving_average_frames, 0, 1e6,
            "[frames] moving average of the scale instead; 0: off");
    }
    /// Throws OptionError.
    void validate() const;
  };

  explicit ScaleFilter(const Options& options);

  /// The camera moved by `distance` [VO units, >= 0] and turned by `angle` [rad, >= 0] since the
  /// last call: the variance grows.
  void move(double distance, double angle);

  /// One frame's measurement [VO units]. True when it was used; one that is not finite, or a height
  /// that is not positive, never is.
  bool update(double height, double sigma, Source source = Source::kPoints);

  bool known() const { return known_; }
  double height() const;  ///< [VO units]; 0 while not known
  double sigma() const;   ///< standard deviation of height() [VO units]; 0 while not known

  void reset();  ///< a new map: another unit of length

 private:
  struct Measurement {
    double log_height;
    double variance;
  };
  bool start(const Measurement& measurement, Source source);
  void settle(Source source);
  double sharedVariance() const;
  void learnAgreement(Source source, double squared);

  Options options_;
  bool known_ = false;
  double log_height_ = 0;
  double variance_ = 0;
  double way_ = 0;  ///< since reset()
  /// Way at the last measurement used, and at the last one seen, of each source.
  std::array<double, 2> last_update_at_{}, last_seen_at_{};
  double agreement_ = 1;  ///< mean square of innovations over what was expected
  /// The latest of each source since one was used; all are with the points until there is a state.
  std::array<std::deque<Measurement>, 2> challengers_;
  std::array<double, 2> challenged_at_{};  ///< way at the first of those
  std::deque<double> inverse_heights_;     ///< of the moving average
};

}  // namespace ground_scale_vo
