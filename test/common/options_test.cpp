#include "ground_scale_vo/common/options.hpp"

#include <gtest/gtest.h>

#include <string>
#include <tuple>
#include <type_traits>

#include "common/text.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/metric_odometry.hpp"

namespace gsv {
namespace {

/// The error message for an assignment; empty if there is no error.
std::string errorOf(const std::string& assignment) {
  MetricOdometry::Options options;
  try {
    setOption(options, assignment);
  } catch (const OptionError& error) {
    return error.what();
  }
  return "";
}

TEST(SetOption, SetsEveryFieldTypeInOdometryAndScale) {
  MetricOdometry::Options options;
  setOption(options, "tracker/min_corner_ratio=0.25");
  setOption(options, "bundle_adjustment/window=9");
  setOption(options, "fit/camber_sigma_rad=4e-2");
  setOption(options, "gpe/min_points=30");
  setOption(options, "random_seed=5");
  setOption(options, "refine=false");
  EXPECT_EQ(options.odometry.vo.min_corner_ratio, 0.25);
  EXPECT_EQ(options.odometry.vo.adjusted_keyframes, 9);
  EXPECT_EQ(options.scale.gpa.fit.camber_sigma_rad, 0.04);
  EXPECT_EQ(options.scale.gpe.min_points, 30);
  EXPECT_EQ(options.scale.random_seed, 5u);
  EXPECT_FALSE(options.scale.refine);
}

TEST(SetOption, ErrorsNameTheOption) {
  EXPECT_EQ(errorOf("direct/patch_size"),
            "'direct/patch_size' is not an assignment; expected [GROUP/]NAME=VALUE");
  EXPECT_EQ(errorOf("dirct/patch_size=0.1"),
            "there is no option dirct/patch_size; did you mean direct/patch_size?");
  EXPECT_EQ(errorOf("xyzzy=1"), "there is no option xyzzy");
  EXPECT_EQ(errorOf("direct/patch_size=wide"), "direct/patch_size: 'wide' is not a number");
  EXPECT_EQ(errorOf("direct/patch_size="), "direct/patch_size: '' is not a number");
  EXPECT_EQ(errorOf("gpe/min_points=30.5"), "gpe/min_points: '30.5' is not an integer");
  EXPECT_EQ(errorOf("gpe/min_points=1e99"), "gpe/min_points is 1e+99, it must lie in [3, 1e+06]");
  EXPECT_EQ(errorOf("direct/patch_size=2"), "direct/patch_size is 2, it must lie in [0.001, 1]");
  EXPECT_EQ(errorOf("refine=1"), "refine is '1', it must be true or false");
}

TEST(VisitAllParameters, EveryRangeIsCheckedUnderTheNameOfItsOption) {
  MetricOdometry::Options valid;
  valid.scale.camera_height = 1.65;
  ASSERT_NO_THROW(valid.validate());
  int numbers = 0;
  visitAllParameters(valid, [&](const std::string& name, auto&, auto... range) {
    if constexpr (sizeof...(range) == 3) {
      MetricOdometry::Options options = valid;
      visitAllParameters(options, [&](const std::string& other, auto& field, auto... limits) {
        if constexpr (sizeof...(limits) == 3) {
          if (other != name) return;
          const double max = std::get<1>(std::tuple(limits...));
          field = static_cast<std::decay_t<decltype(field)>>(max + 1);
        }
      });
      try {
        options.validate();
        ADD_FAILURE() << name << " accepted";
      } catch (const OptionError& error) {
        EXPECT_EQ(std::string(error.what()).rfind(name + " is ", 0), 0u) << error.what();
      }
      ++numbers;
    }
  });
  EXPECT_GT(numbers, 20);
}

TEST(ParseNumber, AcceptsOnlyCompleteFiniteNumbers) {
  EXPECT_EQ(parseNumber<double>("-1.5e2"), -150.0);
  for (const char* text : {"", " 1", "1,5", "1.5m", "nan", "inf", "1e999", "0x10"}) {
    EXPECT_FALSE(parseNumber<double>(text)) << text;
  }
}

}  // namespace
}  // namespace gsv
