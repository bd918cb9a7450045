// The rules of every door for the images of a drive.

#include "ground_scale_vo/io/drive_reader.hpp"

#include "support/test.hpp"

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

TEST(DriveReader, UsesTheImagesAndSaysWhatIsWrong) {
  const std::string wrong_stamp = "have a stamp that does not continue the others and are not used";
  const struct {
    std::vector<double> stamps, used;
    std::string warning = {}, failure = {};  ///< how they begin; empty: there is none
    std::size_t declared = 0;
    double fps = 0;
  } kCases[] = {
      {{0, 0.1, 0.2}, {0, 0.1, 0.2}},
      {{3}, {3}},
      {{0, 0.1, 60, 60.1}, {0, 0.1, 60, 60.1}},
      {{0, 0, 0}, {0, 0.05, 0.1}, {}, {}, 3, 20},
      // A wrong stamp costs one image.
      {{0, 0.1, 500, 0.3, 0.4}, {0, 0.1, -1, 0.3, 0.4}, "1 of 5 images " + wrong_stamp},
      {{0, 0.1, 0.7, 0.3, 0.4}, {0, 0.1, -1, 0.3, 0.4}, "1 of 5 images " + wrong_stamp},
      {{0, 0.1, 0.1, 0.3, 0.4}, {0, 0.1, -1, 0.3, 0.4}, "1 of 5 images " + wrong_stamp},
      {{0, 0.1, 0.05, 0.3, 0.4}, {0, 0.1, -1, 0.3, 0.4}, "1 of 5 images " + wrong_stamp},
      {{500, 10, 10.1, 10.2}, {-1, 10, 10.1, 10.2}, "1 of 4 images " + wrong_stamp},
      {{10, 10.1, 10.2, 500}, {10, 10.1, 10.2, -1}, "1 of 4 images " + wrong_stamp},
      // Joined drives continue after the usual interval.
      {{100, 100.5, 101, 0, 0.5, 1},
       {100, 100.5, 101, 101.5, 102, 102.5},
       "the stamps start again 1 time"},
      {{100, 100.5, 101, 0, 0.5, 1, 7, 7.5, 0, 0.5},
       {100, 100.5, 101, 101.5, 102, 102.5, 108.5, 109, 109.5, 110},
       "the stamps start again 2 times"},
      // At most a quarter is left out.
      {{0, 0, 0.1, 0.2, 0.3, 0.3, 0.4, 0.5},
       {0, -1, 0.1, 0.2, 0.3, -1, 0.4, 0.5},
       "2 of 8 images " + wrong_stamp},
      {{0, 0, 0.1, 0.2, 0.2, 0.3},
       {0, -1, 0.1, 0.2, -1, 0.3},
       "2 of 6 images " + wrong_stamp,
       "only 4 of 6 images could be used; "},
      {{10, 10, 10, 10, 10.1, 10.05},
       {10, -1, -1, -1, 10.1, -1},
       "4 of 6 images " + wrong_stamp,
       "only 2 of 6 images could be used; "},
      {{kBroken, 0, kBroken, 0.2, 0.3},
       {-1, 0, -1, 0.2, 0.3},
       "2 of 5 images cannot be decoded and are not used, the first one because broken",
       "drive is damaged: 2 of 5 images cannot be decoded"},
      {{0, 0.1, 0.2}, {0, 0.1, 0.2}, {}, "drive ends early: only 3 of 10 images can be read", 10},
      {{0, 0.1, kUnreadable, 0.3}, {0, 0.1}, {}, "cannot be read to its end; 2 of 4 images were"},
  };
  for (const auto& c : kCases) {
    SCOPED_TRACE(testing::PrintToString(c.stamps));
    DriveReader drive = reader(c.stamps, c.declared, c.fps);
    EXPECT_EQ(read(&drive), c.used);
    EXPECT_EQ(drive.camera().width, 8);  // of the images
    const auto warnings = drive.warnings();
    EXPECT_EQ(warnings.size(), c.warning.empty() ? 0u : 1u);
    for (const std::string& warning : warnings) EXPECT_EQ(warning.find(c.warning), 0u) << warning;
    EXPECT_EQ(drive.failure().substr(0, std::max<std::size_t>(c.failure.size(), 1)), c.failure);
  }
}

TEST(DriveReader, RefusesADriveWithoutUsableStampsOrImages) {
  for (const std::size_t images : {3u, 100u}) {
    DriveReader drive = reader(std::vector<double>(images, 0.0));
    expectThrows<DataError>([&] { read(&drive); }, "have no usable stamps (the stamp 0.000000000");
  }
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
  CameraCalibration binned{4, 3, 5, 5, 2, 1.5};
  binned.binning = {2, 2};
  const std::pair<CameraCalibration, const char*> kCases[] = {
      {{16, 12, 10, 10, 8, 6},
       "the images are 8x6, but camera.yaml describes 16x12: are the images binned by 2?"},
      {{6, 8, 10, 10, 3, 4}, "turned alike"},
      {binned,
       "camera.yaml describes 4x3 with its binning of 2x2: if the calibration is of the binned"},
      {{0, 0, 10, 10, 8, 6}, "camera.yaml is of another image size: its principal point (8, 6)"},
      {{8, 6, 6, 6, 2, 1.4}, "images of about 5x4"}};
  for (const auto& [calibration, reason] : kCases) {
    expectThrows<DataError>([&, camera = calibration] { open(camera); }, reason);
  }
  open({8, 6, 10, 10, 2, 1.4});  // a tele lens in small images, so rather a part of larger ones
}

}  // namespace
}  // namespace gsv
