#include "ground_scale_vo/common/nearest_name.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace ground_scale_vo {
namespace {

TEST(NearestName, CountsSingleLetterEdits) {
  EXPECT_EQ(editDistance("", ""), 0u);
  EXPECT_EQ(editDistance("height", ""), 6u);
  EXPECT_EQ(editDistance("camera_height", "camera_hight"), 1u);
  EXPECT_EQ(editDistance("kitten", "sitting"), 3u);
}

TEST(NearestName, FindsTheNearestAndNoneForAnUnrelatedName) {
  const std::vector<std::string> known = {"odom_frame", "base_frame", "camera_height"};
  EXPECT_EQ(nearestName("odom_fram", known), "odom_frame");
  EXPECT_EQ(nearestName("camera_hieght", known), "camera_height");
  EXPECT_EQ(nearestName("frame", {"base_frame"}), "base_frame") << "half of it";
  EXPECT_EQ(nearestName("xyz", known), "");
  EXPECT_EQ(nearestName("gate", {"rate", "date"}), "rate") << "the first of equals";
}

}  // namespace
}  // namespace ground_scale_vo
