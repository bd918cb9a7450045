#include "ground_scale_vo/common/options.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <type_traits>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/set_option.hpp"
#include "ground_scale_vo/scale/scale_recovery.hpp"
#include "ground_scale_vo/simulation/synthetic_drive.hpp"
#include "ground_scale_vo/vo/visual_odometry.hpp"
#include "support/drive_run.hpp"

namespace ground_scale_vo {
namespace {

using Numbers = std::vector<double>;

void append(const Eigen::Isometry3d& T, Numbers* numbers) {
  numbers->insert(numbers->end(), T.data(), T.data() + 16);
}

Numbers numbersOf(const VisualOdometry::Output& output) {
  const VoFrame& frame = output.frame;
  Numbers numbers{static_cast<double>(frame.status), static_cast<double>(frame.map_id),
                  static_cast<double>(frame.keyframe), static_cast<double>(frame.features.size())};
  append(frame.T_w_c, &numbers);
  for (const TrackedFeature& f : frame.features) {
    numbers.insert(numbers.end(), {f.u.x(), f.u.y(), f.p_c.z(), f.depth_sigma});
  }
  return numbers;
}

Numbers numbersOf(const ScaleRecovery::Output& output) {
  const ScaleEstimate& s = output.scale;
  Numbers numbers{static_cast<double>(s.status),
                  static_cast<double>(s.reason),
                  s.raw_scale,
                  s.scale,
                  s.sigma,
                  static_cast<double>(s.ground_points),
                  static_cast<double>(s.window_points),
                  output.mounting_pitch,
                  output.mounting_roll,
                  output.mounting_sigma};
  if (!output.pose) return numbers;
  append(output.pose->T_o_c, &numbers);
  for (const Matrix6d* P : {&output.pose->covariance, &output.pose->twist_covariance}) {
    numbers.insert(numbers.end(), P->data(), P->data() + P->size());
  }
  return numbers;
}

/// A visitor of visitAllParameters() that lists other values of every option.
class OtherValues {
 public:
  struct Option {
    std::string name;
    std::vector<std::string> values;
  };

  template <typename Number>
  void operator()(const std::string& name, const Number& field, double min, double max,
                  const char* /*meaning*/) {
    const double now = static_cast<double>(field);
    std::vector<std::string> values;
    for (const double value : {2 * now, now / 2, min, max}) {
      if (value == now || value < min || value > max) continue;
      std::ostringstream text;
      text << (std::is_integral_v<Number> ? std::floor(value) : value);
      values.push_back(text.str());
    }
    options.push_back({name, values});
  }
  void operator()(const std::string& name, const bool& field, const char* /*meaning*/) {
    options.push_back({name, {field ? "false" : "true"}});
  }

  std::vector<Option> options;
};

/// The options of which no other value changes the result. outputsWith(options, use) calls
/// use(output) for each frame of a drive until it returns false.
template <typename Options, typename Outputs>
std::vector<std::string> optionsWithoutEffect(const Options& defaults, const Outputs& outputsWith) {
  OtherValues other;
  visitAllParameters(defaults, other);
  EXPECT_GT(other.options.size(), 10u);
  std::vector<Numbers> expected;
  outputsWith(defaults, [&](const auto& output) {
    expected.push_back(numbersOf(output));
    return true;
  });
  std::vector<std::string> without_effect;
  for (const OtherValues::Option& option : other.options) {
    const auto changesTheResult = [&](const std::string& value) {
      Options options = defaults;
      try {
        setOption(options, option.name + "=" + value);
        options.validate();
      } catch (const OptionError&) {  // not possible together with the other options
        return false;
      }
      std::size_t i = 0;
      bool same = true;
      outputsWith(options, [&](const auto& output) {
        same = numbersOf(output) == expected[i++];
        return same;
      });
      return !same;
    };
    if (std::none_of(option.values.begin(), option.values.end(), changesTheResult)) {
      without_effect.push_back(option.name);
    }
  }
  return without_effect;
}

/// A drive with a stop, in which two images are of another street, as are all from image 56 on.
class Options : public testing::Test {
 protected:
  static SyntheticDrive::Options driveOptions(std::uint64_t seed) {
    SyntheticDrive::Options options = smallImages();
    options.frames = 85;
    options.stop_at_m = 22;
    options.stop_s = 1;
    options.random_seed = seed;
    return options;
  }

  static const std::vector<cv::Mat>& images() {
    static const std::vector<cv::Mat> images = [] {
      const SyntheticDrive drive(driveOptions(1)), other(driveOptions(2));
      std::vector<cv::Mat> rendered;
      for (std::size_t i = 0; i < drive.size(); ++i) {
        rendered.push_back((i > 40 && i < 43) || i > 55 ? other.image(i) : drive.image(i));
      }
      return rendered;
    }();
    return images;
  }

  /// Calls use(output) for each image until it returns false.
  template <typename Use>
  static void odometry(const VisualOdometry::Options& options, const Use& use) {
    VisualOdometry odometry(driveOptions(1).camera, options);
    for (std::size_t i = 0; i < images().size(); ++i) {
      if (!use(odometry.process(images()[i], static_cast<std::int64_t>(i) * 100'000'000))) return;
    }
  }
};

TEST_F(Options, EachOfTheOdometryHasAnEffect) {
  const auto without_effect =
      optionsWithoutEffect(VisualOdometry::Options(),
                           [](const auto& options, const auto& use) { odometry(options, use); });
  EXPECT_EQ(without_effect, std::vector<std::string>());
}

TEST_F(Options, EachOfTheScaleStageHasAnEffect) {
  std::vector<VoFrame> frames;
  odometry({}, [&](const VisualOdometry::Output& output) {
    frames.push_back(output.frame);
    return true;
  });
  ScaleRecovery::Options defaults;
  defaults.camera_height = 1.65;
  const auto without_effect =
      optionsWithoutEffect(defaults, [&](const auto& options, const auto& use) {
        ScaleRecovery scale(options);
        for (std::size_t i = 0; i < frames.size(); ++i) {
          if (!use(scale.process(frames[i], images()[i]))) return;
        }
      });
  // These need road close to the camera, a search for the height, a series of wrong measurements,
  // or a gap with accelerations: ground_point_extraction_test, direct_plane_estimator_test,
  // plane_fit_test, scale_filter_test, and metric_trajectory_test have them.
  EXPECT_EQ(
      without_effect,
      (std::vector<std::string>{
          "gpe/min_ahead_heights", "fit/sac_tilt_rad", "direct/min_ahead_heights",
          "direct/search_range", "direct/search_min_correlation", "direct/search_min_peak_margin",
          "direct/search_max_disagreement", "direct/search_interval_heights",
          "filter/restart_measurements", "filter/restart_max_deviation",
          "filter/restart_distance_heights", "trajectory/bridge_acceleration_sigma"}));
}

}  // namespace
}  // namespace ground_scale_vo
