#pragma once

#include <optional>

#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/scale/ground_plane.hpp"
#include "ground_scale_vo/scale/motion_history.hpp"

namespace ground_scale_vo {

/// How the camera is mounted on the vehicle, estimated slowly: pitch from the direction of motion
/// (which on average lies in the road) and roll from the planes found. The paper assumes a pitch of
/// zero; 1 degree is 11 % of the height for a point 10 m ahead.
class Mounting {
 public:
  struct Options {
    double start_pitch_sigma = 0.07;    ///< of the start-up value zero [rad]
    double start_roll_sigma = 0.05;     ///< of the start-up value zero [rad]
    double pitch_motion_sigma = 0.012;  ///< nodding and slope edges: road against mounting [rad]
    double roll_motion_sigma = 0.012;   ///< leaning and camber: road against mounting [rad]
    /// Bounce of the camera against the road between a chord's ends [camera heights]: a chord of
    /// length L constrains the pitch to bounce / L.
    double bounce_h = 0.02;
    double chord_h = 3;     ///< length of the chord for the direction of motion [camera heights]
    double memory_h = 200;  ///< distance over which the average forgets [camera heights]
    double max_tilt_rad = 0.26;  ///< limit of both estimates
    template <typename Self, typename Visit>
    static void visitParameters(Self& self, Visit&& visit) {
      visit("start_pitch_sigma", self.start_pitch_sigma, 1e-4, 1,
            "[rad] of the start-up pitch zero");
      visit("start_roll_sigma", self.start_roll_sigma, 1e-4, 1, "[rad] of the start-up roll zero");
      visit("pitch_motion_sigma", self.pitch_motion_sigma, 1e-4, 1,
            "[rad] nodding and slope edges: road against mounting");
      visit("roll_motion_sigma", self.roll_motion_sigma, 1e-4, 1,
            "[rad] leaning and camber: road against mounting");
      visit("bounce_h", self.bounce_h, 1e-5, 1,
            "[camera heights] bounce against the road between the ends of a chord");
      visit("chord_h", self.chord_h, 0.01, 1000,
            "[camera heights] length of the chord for the direction of motion");
      visit("memory_h", self.memory_h, 1, 1e6,
            "[camera heights] way over which the averages forget");
      visit("max_tilt_rad", self.max_tilt_rad, 0.001, 0.8, "[rad] limit of pitch and roll");
    }
    /// Throws OptionError.
    void validate() const;
  };

  explicit Mounting(const Options& options);

  double pitch() const { return pitch_.mean; }  ///< [rad], positive looks down
  double roll() const { return roll_.mean; }    ///< [rad], positive: the camera's x axis dips
  /// Unit, up: the road's normal in camera axes when the vehicle stands level on it.
  Eigen::Vector3d normal() const;

  /// The road's normal in the camera of the last pose in `history`: the mounting's, turned so that
  /// it is orthogonal to the direction of motion as far as both are trusted (Eq. 3). height: of the
  /// camera [VO units], 0 when not known.
  NormalPrior prior(const MotionHistory& history, double height) const;

  /// Learns from one frame: the chord behind it and, when one was accepted, its plane.
  /// step_h: way since the last call [camera heights].
  void update(const std::optional<MotionHistory::Chord>& chord, const GroundPlane* plane,
              double step_h);

  void reset();

 private:
  struct Average {
    double mean = 0;
    double sigma = 0;  ///< of the mean
  };
  void learn(Average* average, double value, double motion_sigma, double step_h) const;

  Options options_;
  Average pitch_, roll_;
};

}  // namespace ground_scale_vo
