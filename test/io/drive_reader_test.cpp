// The rules of every door for the images of a drive.

#include "ground_scale_vo/io/drive_reader.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "support/expect_throws.hpp"

namespace gsv {
namespace {

constexpr double kUnreadable = -7;

/// Grey images of 8 x 6 pixels with these stamps [s]. NaN: an image that cannot be decoded;
/// kUnreadable: nothing can be read from there on.
class Images : public ImageSource {
 public:
  Images(std::vector<double> stamps, std::size_t declared, int type)
      : stamps_(std::move(stamps)), declared_(declared), type_(type) {}
  const std::string& name() const override { return name_; }
  std::size_t count() const override { return declared_; }
  std::optional<StoredImage> next() override {
    if (index_ == stamps_.size()) return std::nullopt;
    const double stamp = stamps_[index_++];
    if (stamp == kUnreadable) throw DataError("cannot be read to its end");
    StoredImage image;
    if (std::isnan(stamp)) {
      image.error = "broken";
    } else {
      image.stamp_ns = std::llround(1e9 * stamp);
      image.pixels = cv::Mat(6, 8, type_, cv::Scalar::all(100));
    }
    return image;
  }

 private:
  const std::string name_ = "drive";
  const std::vector<double> stamps_;
  const std::size_t declared_;
  const int type_;
  std::size_t index_ = 0;
};

DriveReader reader(const std::vector<double>& stamps, std::size_t declared = 0, double fps = 0,
                   int type = CV_8UC1) {
  const std::size_t count = declared > 0 ? declared : stamps.size();
  return DriveReader(std::make_unique<Images>(stamps, count, type),
                     {CameraCalibration{0, 0, 10, 10, 3.5, 2.5}, "camera.yaml"}, {"", fps});
}

/// The stamps of the images as they come, negative for those that are not used [s].
std::vector<double> read(DriveReader* drive) {
  std::vector<double> stamps;
  while (const auto image = drive->next()) {
    stamps.push_back(image->grey.empty() ? -1 : static_cast<double>(image->stamp_ns) / 1e9);
  }
  return stamps;
}

constexpr double kBroken = NAN;

TEST(DriveReader, GivesEveryImageInOrder) {
  DriveReader drive = reader({0, 0.1, 0.2});
  EXPECT_EQ(read(&drive), (std::vector<double>{0, 0.1, 0.2}));
  EXPECT_EQ(drive.camera().width, 8);  // of the images
  EXPECT_TRUE(drive.warnings().empty());
  EXPECT_EQ(drive.failure(), "");
  DriveReader single = reader({3});
  EXPECT_EQ(read(&single), (std::vector<double>{3}));
}

TEST(DriveReader, AWrongStampCostsOneImage) {
  for (const double wrong : {500.0, 0.7, 0.1, 0.05}) {
    DriveReader drive = reader({0, 0.1, wrong, 0.3, 0.4});
    EXPECT_EQ(read(&drive), (std::vector<double>{0, 0.1, -1, 0.3, 0.4})) << wrong;
    ASSERT_EQ(drive.warnings().size(), 1u);
    EXPECT_EQ(drive.warnings()[0].find("1 of 5 images have a stamp that does not continue"), 0u);
    EXPECT_EQ(drive.failure(), "");
  }
  DriveReader first = reader({500, 10, 10.1, 10.2});
  EXPECT_EQ(read(&first), (std::vector<double>{-1, 10, 10.1, 10.2}));
  DriveReader last = reader({10, 10.1, 10.2, 500});
  EXPECT_EQ(read(&last), (std::vector<double>{10, 10.1, 10.2, -1}));
}

TEST(DriveReader, JoinedDrivesContinueAfterTheUsualInterval) {
  DriveReader drive = reader({100, 100.5, 101, 0, 0.5, 1});
  EXPECT_EQ(read(&drive), (std::vector<double>{100, 100.5, 101, 101.5, 102, 102.5}));
  ASSERT_EQ(drive.warnings().size(), 1u);
  EXPECT_EQ(drive.warnings()[0].find("the stamps start again 1 time"), 0u);
  DriveReader pause = reader({0, 0.1, 60, 60.1});
  EXPECT_EQ(read(&pause), (std::vector<double>{0, 0.1, 60, 60.1}));
}

TEST(DriveReader, RefusesStampsThatDoNotIncreaseUnlessTheRateIsGiven) {
  for (const std::size_t images : {3u, 100u}) {
    DriveReader drive = reader(std::vector<double>(images, 0.0));
    expectThrows<DataError>([&] { read(&drive); }, "have no usable stamps (the stamp 0.000000000");
  }
  DriveReader drive = reader({0, 0, 0}, 3, 20);
  EXPECT_EQ(read(&drive), (std::vector<double>{0, 0.05, 0.1}));
}

TEST(DriveReader, LeavesOutAtMostAQuarter) {
  DriveReader quarter = reader({0, 0, 0.1, 0.2, 0.3, 0.3, 0.4, 0.5});
  read(&quarter);
  EXPECT_EQ(quarter.failure(), "");
  DriveReader more = reader({0, 0, 0.1, 0.2, 0.2, 0.3});
  read(&more);
  EXPECT_EQ(more.failure().find("only 4 of 6 images could be used; "), 0u);
}

TEST(DriveReader, ReportsWhatIsMissingOrDamaged) {
  DriveReader damaged = reader({kBroken, 0, kBroken, 0.2, 0.3});
  EXPECT_EQ(read(&damaged), (std::vector<double>{-1, 0, -1, 0.2, 0.3}));
  EXPECT_EQ(damaged.warnings().at(0),
            "2 of 5 images cannot be decoded and are not used, the first one because broken");
  EXPECT_EQ(damaged.failure(), "drive is damaged: 2 of 5 images cannot be decoded");
  DriveReader part = reader({0, 0.1, 0.2}, 10);
  read(&part);
  EXPECT_EQ(part.failure(), "drive ends early: only 3 of 10 images can be read");
  DriveReader cut = reader({0, 0.1, kUnreadable, 0.3});
  EXPECT_EQ(read(&cut), (std::vector<double>{0, 0.1}));
  EXPECT_EQ(cut.failure(), "cannot be read to its end; 2 of 4 images were read");
  DriveReader few = reader({10, 10, 10, 10, 10.1, 10.05});
  read(&few);
  EXPECT_EQ(few.failure().find("only 2 of 6 images could be used; "), 0u);
  expectThrows<DataError>([&] { reader({kBroken}); },
                          "drive: has no image that can be decoded: broken");
}

TEST(DriveReader, TakesSixteenBitsByTheRangeInUse) {
  DriveReader drive = reader({0, 0.1}, 2, 0, CV_16UC1);
  EXPECT_EQ(drive.next()->grey.at<std::uint8_t>(0, 0), 100);
}

TEST(DriveReader, RefusesTheCalibrationOfAnotherSize) {
  const auto open = [](const CameraCalibration& calibration) {
    DriveReader(std::make_unique<Images>(std::vector<double>{0}, 1, CV_8UC1),
                {calibration, "camera.yaml"}, {});
  };
  expectThrows<DataError>(
      [&] {
        open({16, 12, 10, 10, 8, 6});
      },
      "the images are 8x6, but camera.yaml describes 16x12: are the images "
      "binned by 2?");
  expectThrows<DataError>([&] { open({6, 8, 10, 10, 3, 4}); }, "turned alike");
  expectThrows<DataError>(
      [&] {
        CameraCalibration binned{4, 3, 5, 5, 2, 1.5};
        binned.binning = {2, 2};
        open(binned);
      },
      "camera.yaml describes 4x3 with its binning of 2x2: if the calibration is of the binned");
  expectThrows<DataError>(
      [&] {
        open({0, 0, 10, 10, 8, 6});
      },
      "camera.yaml is of another image size: its principal point (8, 6)");
  expectThrows<DataError>([&] { open({8, 6, 6, 6, 2, 1.4}); }, "images of about 5x4");
  open({8, 6, 10, 10, 2, 1.4});  // a tele lens in small images, so rather a part of larger ones
}

}  // namespace
}  // namespace gsv
