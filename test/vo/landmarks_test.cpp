#include "ground_scale_vo/vo/landmarks.hpp"

#include <gtest/gtest.h>

namespace ground_scale_vo {
namespace {

/// Landmarks whose outlier count is their id.
Landmarks landmarksWith(const std::vector<std::uint64_t>& ids) {
  Landmarks landmarks;
  for (const std::uint64_t id : ids) landmarks[id].outlier_count = static_cast<int>(id);
  return landmarks;
}

std::vector<std::uint64_t> idsOf(const Landmarks& landmarks) {
  std::vector<std::uint64_t> ids;
  for (const auto& [id, landmark] : landmarks) {
    EXPECT_EQ(landmark.outlier_count, static_cast<int>(id));
    ids.push_back(id);
  }
  return ids;
}

TEST(Landmarks, areOrderedAndUnique) {
  const Landmarks landmarks = landmarksWith({5, 9, 2, 5, 7, 2, 12});
  EXPECT_EQ(idsOf(landmarks), (std::vector<std::uint64_t>{2, 5, 7, 9, 12}));
  EXPECT_EQ(landmarks.at(7).outlier_count, 7);
  EXPECT_EQ(landmarks.find(12)->first, 12u);
  for (const std::uint64_t id : {0, 3, 13}) EXPECT_EQ(landmarks.find(id), landmarks.end());
}

TEST(Landmarks, removeThoseThatFulfilACondition) {
  Landmarks landmarks = landmarksWith({1, 2, 3, 4, 5, 6});
  landmarks.removeIf([](const Landmark& landmark) { return landmark.outlier_count % 3 != 1; });
  EXPECT_EQ(idsOf(landmarks), (std::vector<std::uint64_t>{1, 4}));
  landmarks.removeIf([](const Landmark&) { return true; });
  EXPECT_TRUE(landmarks.empty());
}

TEST(LandmarkWalk, findsWhatIsThereInAnyOrder) {
  const Landmarks landmarks = landmarksWith({2, 5, 7, 9, 12});
  LandmarkWalk walk(landmarks);
  for (const std::uint64_t id : {0, 2, 2, 4, 9, 10, 12, 13, 5, 4, 2, 7, 0, 12}) {
    const Landmark* const found = walk.find(id);
    ASSERT_EQ(found != nullptr, landmarks.find(id) != landmarks.end()) << id;
    if (found) {
      EXPECT_EQ(found->outlier_count, static_cast<int>(id));
    }
  }
  const Landmarks none;
  EXPECT_EQ(LandmarkWalk(none).find(1), nullptr);
}

}  // namespace
}  // namespace ground_scale_vo
