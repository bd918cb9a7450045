// The nodelets with the parameter mask, on a rendered drive whose images show a hood with a
// texture.

#include <gtest/gtest.h>
#include <stdlib.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "drive_test.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "support/drive_run.hpp"
#include "support/textured_hood.hpp"

namespace ground_scale_vo {
namespace {

class Mask : public testing::Test {
 protected:
  static constexpr std::size_t kFrames = 40;

  static void SetUpTestSuite() {
    const SyntheticDrive::Options options = smallDrive(kFrames);
    hood_ =
        std::make_unique<TexturedHood>(cv::Size(options.camera.width, options.camera.height), 0.1);
    drive_ = std::make_unique<RenderedDrive>(
        options, "camera", [](const cv::Mat& image) { return hood_->cover(image); });
    std::string pattern = (std::filesystem::temp_directory_path() / "gsv_mask_XXXXXX").string();
    ASSERT_NE(mkdtemp(pattern.data()), nullptr);
    folder_ = pattern;
  }
  static void TearDownTestSuite() {
    drive_.reset();
    std::filesystem::remove_all(folder_);
  }
  void SetUp() override { ASSERT_TRUE(manager_.waitForServices()); }
  void TearDown() override { EXPECT_EQ(manager_.loaded(), 0u); }

  static std::string writeMask(const std::string& name, const cv::Mat& mask) {
    const std::string file = folder_ / name;
    EXPECT_TRUE(cv::imwrite(file, mask));
    return file;
  }
  static void setMask(NodeletPair& pair, const std::string& file) {
    pair.setParam("mono_vo", "mask", file);
    pair.setParam("scale_recovery", "mask", file);
  }

  /// Scale of every frame.
  static std::vector<double> scalesOf(const std::vector<ScaleEstimateMsg::ConstPtr>& messages) {
    std::vector<double> scales;
    for (const auto& message : messages) scales.push_back(message->scale);
    return scales;
  }
  /// The same without ROS, with the masks of the two stages.
  static std::vector<double> offlineScales(const cv::Mat& vo_mask, const cv::Mat& scale_mask) {
    const SyntheticDrive& drive = drive_->drive();
    VisualOdometry odometry(drive.camera(), {}, vo_mask);
    ScaleRecovery recovery(optionsFor(drive.cameraHeight()).scale);
    std::vector<double> scales;
    for (std::size_t i = 0; i < kFrames; ++i) {
      const cv::Mat image = hood_->cover(drive.image(i));
      const VoFrame frame = odometry.process(image, drive.frame(i).stamp_ns).frame;
      scales.push_back(recovery.process(frame, image, scale_mask).scale.scale);
    }
    return scales;
  }
  static double largestDifference(const std::vector<double>& a, const std::vector<double>& b) {
    double largest = 0;
    for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, std::abs(a[i] - b[i]));
    return largest;
  }

  ManagerClient manager_{"/manager"};
  ros::NodeHandle handle_;
  TopicRecorder<diagnostic_msgs::DiagnosticArray> diagnostics_{handle_, "/diagnostics"};
  static inline std::unique_ptr<TexturedHood> hood_;
  static inline std::unique_ptr<RenderedDrive> drive_;
  static inline std::filesystem::path folder_;
};

/// Whether every pixel of a row is grey. Precondition: bgr8.
bool isGrey(const sensor_msgs::Image& image, int row) {
  const std::uint8_t* pixel = &image.data.at(static_cast<std::size_t>(row) * image.step);
  for (std::uint32_t u = 0; u < image.width; ++u, pixel += 3) {
    if (pixel[0] != pixel[1] || pixel[1] != pixel[2]) return false;
  }
  return true;
}

TEST_F(Mask, RegionIsNotUsedButTinted) {
  NodeletPair pair(manager_, *drive_, "/masked");
  setMask(pair, writeMask("mask.png", hood_->mask()));
  ASSERT_TRUE(pair.load());
  TopicRecorder<sensor_msgs::Image> tracks(handle_, "/masked/vo/image_tracks");
  TopicRecorder<sensor_msgs::Image> road(handle_, "/masked/image_road");
  ASSERT_TRUE(waitUntil([&] { return tracks.connected() && road.connected(); }));
  ASSERT_TRUE(pair.playAll());
  std::size_t features = 0;
  for (const auto& frame : pair.frames.messages()) {
    features += frame->v.size();
    for (const float row : frame->v) ASSERT_LT(row, hood_->top());
  }
  EXPECT_GT(features, 100 * kFrames);
  const std::vector<double> scales = scalesOf(pair.scales.messages());
  ASSERT_EQ(scales.size(), kFrames);
  EXPECT_LT(largestDifference(scales, offlineScales(hood_->mask(), hood_->mask())), 1e-9);
  // The check would notice a nodelet that does not use its mask.
  EXPECT_GT(largestDifference(scales, offlineScales({}, hood_->mask())), 1e-3);
  EXPECT_GT(largestDifference(scales, offlineScales(hood_->mask(), {})), 1e-3);
  const ros::Time last = pair.header(kFrames - 1).stamp;
  for (auto* images : {&tracks, &road}) {
    ASSERT_TRUE(images->waitForStamp(last));
    const auto image = images->messages().back();
    ASSERT_EQ(image->height, static_cast<std::uint32_t>(hood_->mask().rows));
    EXPECT_FALSE(isGrey(*image, static_cast<int>(image->height) - 1));
  }
  EXPECT_TRUE(waitForValue(diagnostics_, "images", "used", "masked/scale_recovery"));
  EXPECT_TRUE(pair.unload());
}

TEST_F(Mask, OfAnotherSizeIsAnErrorThatNamesIt) {
  NodeletPair pair(manager_, *drive_, "/other_size");
  const std::string file = writeMask("other.png", hood_->mask().colRange(0, 300));
  setMask(pair, file);
  ASSERT_TRUE(pair.load());
  pair.publish(0);
  const std::string error = "parameter mask: " + file +
                            " is 300x124, the camera 400x124 of camera_info on topic "
                            "/other_size/camera_info";
  EXPECT_TRUE(waitForSummary(diagnostics_, "other_size/mono_vo",
                             diagnostic_msgs::DiagnosticStatus::ERROR, error));
  EXPECT_TRUE(
      waitForValue(diagnostics_, "dropped: camera_info refused", "1", "other_size/scale_recovery"));
  EXPECT_TRUE(pair.frames.messages().empty());
  EXPECT_TRUE(pair.unload());
}

TEST_F(Mask, ThatCannotBeReadKeepsBothNodeletsFromLoading) {
  NodeletPair pair(manager_, *drive_, "/missing");
  setMask(pair, folder_ / "missing.png");
  EXPECT_FALSE(pair.loadMonoVo());
  EXPECT_FALSE(pair.loadScaleRecovery());
}

}  // namespace
}  // namespace ground_scale_vo
