#include "ground_scale_vo/io/kitti_sequence.hpp"

#include <cstdio>
#include <opencv2/imgcodecs.hpp>

#include "support/temporary_folder.hpp"
#include "support/test.hpp"

namespace gsv {
namespace {

namespace fs = std::filesystem;

const std::string kCalibration = "P0: 70 0 32 0 0 71 24 0 0 0 1 0\n";
const std::string kIdentityRow = "1 0 0 0 0 1 0 0 0 0 1 0\n";
const std::string kRawDrive = "2011_09_26/drive_0001_sync";
const std::string kRawCalibration = "2011_09_26/calib_cam_to_cam.txt";

/// Builds small folders of both KITTI layouts, odometry and raw.
class KittiSequences : public TemporaryFolder {
 protected:
  /// An image file with grey values 3 * x + y; extension: "png" or "jpg".
  std::string encoded(const std::string& extension, const cv::Size& size = {64, 48}) const {
    cv::Mat image(size, CV_8UC1);
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) image.at<uchar>(y, x) = static_cast<uchar>(3 * x + y);
    }
    std::vector<uchar> bytes;
    cv::imencode("." + extension, image, bytes);
    return {bytes.begin(), bytes.end()};
  }

  /// i with leading zeros.
  static std::string number(int i, int digits) {
    char text[16];
    std::snprintf(text, sizeof text, "%0*d", digits, i);
    return text;
  }

  /// Three images, three stamps, no ground truth.
  fs::path makeOdometry(const std::string& name = "sequences/07",
                        const std::string& extension = "png") const {
    for (int i = 0; i < 3; ++i) {
      write(name + "/image_0/" + number(i, 6) + "." + extension, encoded(extension));
    }
    write(name + "/calib.txt", kCalibration + "P1: 1 2 3\n");
    write(name + "/times.txt", "0.000000e+00\n1.037360e-01\n0.2073386\n");
    return folder_ / name;
  }

  /// Two images and stamps, no GPS/IMU data.
  fs::path makeRaw() const {
    for (int i = 0; i < 2; ++i) {
      write(kRawDrive + "/image_00/data/" + number(i, 10) + ".png", encoded("png"));
    }
    write(kRawDrive + "/image_00/timestamps.txt",
          "2011-09-26 13:02:25.964389445\n2011-09-26 13:02:26.06439\n");
    write(kRawCalibration,
          "calib_time: 09-Jan-2012 13:57:47\nR_rect_00: 1 0 0 0 1 0 0 0 1\n"
          "P_rect_00: 70 0 32 0 0 71 24 0 0 0 1 0\n");
    return folder_ / kRawDrive;
  }

  /// A GPS/IMU reading: latitude, longitude [degrees], altitude [m], roll, pitch, yaw [rad].
  fs::path writeOxts(int i, const std::string& pose) const {
    std::string rest;
    for (int k = 0; k < 24; ++k) rest += " 0";
    return write(kRawDrive + "/oxts/data/" + number(i, 10) + ".txt", pose + rest + "\n");
  }

  /// Two GPS/IMU readings. The second one is 1e-5 degrees of longitude further east, 0.5 m higher
  /// and turned left by 0.1 rad.
  void addOxts() const {
    writeOxts(0, "49.0 8.4 116.0 0 0 0");
    writeOxts(1, "49.0 8.40001 116.5 0 0 0.1");
    // velo = imu shifted; camera x = -velo y, y = -velo z, z = velo x.
    write("2011_09_26/calib_imu_to_velo.txt",
          "calib_time: 25-May-2012\nR: 1 0 0 0 1 0 0 0 1\nT: -0.8 0.3 -0.8\n");
    write("2011_09_26/calib_velo_to_cam.txt", "R: 0 -1 0 0 0 -1 1 0 0\nT: 0 -0.1 -0.3\n");
  }

  std::string errorOf(const fs::path& sequence) const {
    return dataErrorOf([&] { KittiSequence{sequence}; }, folder_);
  }

  void expectNoGroundTruth(const fs::path& folder, const std::string& reason) const {
    const KittiSequence sequence(folder);
    EXPECT_TRUE(sequence.groundTruth().empty() && sequence.groundTruthHeights().empty());
    ASSERT_EQ(sequence.warnings().size(), 1u) << reason;
    EXPECT_EQ(sequence.warnings()[0].find("ground truth is not used: " + folder_.string() + reason),
              0u)
        << sequence.warnings()[0];
  }
};

TEST_F(KittiSequences, ReadsAnOdometryFolder) {
  const KittiSequence sequence(makeOdometry());
  EXPECT_EQ(sequence.name(), "07");
  EXPECT_EQ(sequence.size(), 3u);
  EXPECT_TRUE(isSameCamera(sequence.camera(), {64, 48, 70, 71, 32, 24}));
  EXPECT_EQ(sequence.stampNs(0), 0);
  EXPECT_EQ(sequence.stampNs(1), 103736000);
  EXPECT_EQ(sequence.stampNs(2), 207338600);
  EXPECT_TRUE(sequence.groundTruth().empty());
  const cv::Mat image = sequence.image(2);
  EXPECT_EQ(image.type(), CV_8UC1);
  EXPECT_EQ(image.at<uchar>(5, 7), 26);
  EXPECT_THROW(sequence.image(3), std::out_of_range);
}

TEST_F(KittiSequences, ReadsTheWorkingFolderWithJpegImages) {
  const fs::path before = fs::current_path();
  fs::current_path(makeOdometry("drive", "jpg"));
  const KittiSequence sequence("./");
  fs::current_path(before);
  EXPECT_EQ(sequence.name(), "drive");
  EXPECT_EQ(sequence.image(0).size(), cv::Size(64, 48));
}

TEST_F(KittiSequences, ReadsTheHeightsOfARenderedDriveAndIgnoresFurtherStamps) {
  const fs::path folder = makeOdometry();
  EXPECT_TRUE(KittiSequence(folder).groundTruthHeights().empty());
  write("sequences/07/ground.txt", "# height, normal\n1.6 0 -1 0\n1.7 0 -1 0\n1.65 0 -1 0\n");
  write("sequences/07/times.txt", "0\n0.1\n0.2\n0.3\r\n\r\n");
  EXPECT_EQ(KittiSequence(folder).groundTruthHeights(), (std::vector<double>{1.6, 1.7, 1.65}));
  EXPECT_EQ(KittiSequence(folder).stampNs(2), 200000000);
}

TEST_F(KittiSequences, RefusesBadFilesAndLeavesOutBadGroundTruthWithTheirNameAndLine) {
  const fs::path folder = makeOdometry();
  const struct {
    const char* file;
    std::string content, error;
  } kCases[] = {
      {"times.txt", "0\n0.1\n", ": has 2 stamps for 3 images"},
      {"times.txt", "", ": is empty"},
      {"times.txt", "0\nnan\n1\n", ", line 2: 'nan' is not a time"},
      {"times.txt", "0\n1 2\n3\n", ", line 2: has 2 words; one number a line is expected, a time"},
      {"times.txt", "0 a.png\n1 b.png\n2 c.png\n", ", line 1: has 2 words"},
      {"times.txt", "0\n2.5\n5\n",
       ", line 1: the stamps, 0, 2.5 ..., give no plausible frame rate in seconds, milliseconds or "
       "nanoseconds"},
      {"calib.txt", "P1: 1 2\n", ": has no line that begins with P0:"},
      {"calib.txt", "\nP0: 1 2\n", ", line 2: has 2 numbers instead of 12"},
      {"calib.txt", "P0: 70 1 32 0 0 71 24 0 0 0 1 0\n",
       ", line 1: P0: is not the projection of a rectified pinhole camera"},
      {"calib.txt", "P0: -70 0 32 0 0 71 24 0 0 0 1 0\n", ", line 1: "},
      {"poses.txt", kIdentityRow + kIdentityRow, ": has 2 for 3 images"},
      {"poses.txt", kIdentityRow + kIdentityRow + "1 0 0 1e300 0 1 0 0 0 0 1 0\n",
       ", line 3: its position is implausibly far away"},
      {"poses.txt", kIdentityRow + kIdentityRow + "1 0 0 0 0 1e308 0 0 0 0 1 0\n",
       ", line 3: its 3x3 is not a rotation"},
      {"ground.txt", "1.6 0 -1 0\n0 0 -1 0\n", ", line 2: its height is not positive"},
      {"ground.txt", "1.6 0 -1\n", ", line 1: has 3 numbers instead of 4"},
      {"ground.txt", "1.6 0 -1 0\n1.7 0 -1 0\n", ": has 2 for 3 images"},
  };
  for (const auto& [file, content, error] : kCases) {
    const std::string name = std::string("sequences/07/") + file, reason = "/" + name + error;
    const bool is_required = fs::exists(folder / file);
    write(name, content);
    if (is_required) {
      EXPECT_EQ(errorOf(folder).find(reason), 0u) << errorOf(folder);
      makeOdometry();
    } else {
      expectNoGroundTruth(folder, reason);
      fs::remove(folder / file);
    }
  }
  fs::create_symlink(folder / "none", folder / "poses.txt");
  expectNoGroundTruth(folder, "/sequences/07/poses.txt: is a link to nothing");
}

TEST_F(KittiSequences, FindsTheGroundTruthOfAPartByItsNumbers) {
  const fs::path folder = makeOdometry();
  fs::rename(folder / "image_0/000000.png", folder / "image_0/000003.png");
  fs::rename(folder / "image_0/000001.png", folder / "image_0/000004.png");
  std::string poses;
  for (int i = 0; i < 6; ++i) poses += "1 0 0 " + std::to_string(i) + " 0 1 0 0 0 0 1 0\n";
  write("sequences/07/poses.txt", poses);
  const KittiSequence sequence(folder);
  ASSERT_EQ(sequence.groundTruth().size(), 3u);
  EXPECT_EQ(sequence.groundTruth()[0].translation().x(), 0);
  EXPECT_EQ(sequence.groundTruth()[2].translation().x(), 2);
  EXPECT_TRUE(sequence.warnings().empty());
}

// What a file must hold: EncodedImage.
TEST_F(KittiSequences, RefusesBrokenImagesWhenTheyAreRead) {
  const KittiSequence sequence(makeOdometry());
  const std::string name = "sequences/07/image_0/000001.png", whole = encoded("png");
  for (const auto& [bytes, error] :
       {std::pair(whole.substr(0, whole.size() / 2), "is not a whole PNG or JPEG image"),
        {whole.substr(0, 33) + whole.substr(whole.size() - 12), "cannot be decoded as an image"},
        {encoded("png", {32, 48}), "is 32x48 instead of 64x48"}}) {
    write(name, bytes);
    EXPECT_EQ(dataErrorOf([&] { sequence.image(1); }, folder_), "/" + name + ": " + error);
  }
  fs::remove(folder_ / name);
  EXPECT_EQ(dataErrorOf([&] { sequence.image(1); }, folder_), "/" + name + ": no such file");
}

TEST_F(KittiSequences, TellsUnitsOfStampsApart) {
  const fs::path folder = makeOdometry();
  const struct {
    const char* stamps;
    std::int64_t first_ns, second_ns;
  } kCases[] = {
      {"0\n0.1\n0.2\n", 0, 100000000},
      {"\xef\xbb\xbf"
       "0\r\n0.1\r\n0.2\r\n",
       0, 100000000},
      {"# times\n0\n33.5\n67\n", 0, 33500000},
      {"1317042145964\n1317042146064\n1317042146164\n", 1317042145964000000, 1317042146064000000},
      {"1317042145964389445\n1317042146064389445\n1317042146164389445\n", 1317042145964389445,
       1317042146064389445},
      {"1317042145.964389445\n1317042146.06\n1317042146.16\n", 1317042145964389445,
       1317042146060000000},
      {"0 12.5 0.01\n1 12.6 0.01\n2 12.7 0.01\n", 12500000000, 12600000000},  // TUM mono
  };
  for (const auto& c : kCases) {
    write("sequences/07/times.txt", c.stamps);
    const KittiSequence sequence(folder);
    EXPECT_EQ(sequence.stampNs(0), c.first_ns) << c.stamps;
    EXPECT_EQ(sequence.stampNs(1), c.second_ns) << c.stamps;
  }
  fs::remove(folder / "times.txt");
  EXPECT_TRUE(KittiSequence(folder, {false, true, false}).stamps().empty());
}

TEST_F(KittiSequences, ReadsPartsAndNamesMissingNumbers) {
  const fs::path folder = makeOdometry();
  const auto rename = [&](int from, int to) {
    fs::rename(folder / "image_0" / (number(from, 6) + ".png"),
               folder / "image_0" / (number(to, 6) + ".PNG"));
  };
  rename(2, 5);
  EXPECT_EQ(errorOf(folder), "no error");  // a stamp for each
  write("sequences/07/times.txt", "0\n.1\n.2\n.3\n.4\n.5\n.6\n");
  EXPECT_EQ(KittiSequence(folder).stampNs(2), 500000000);  // by its number
  EXPECT_EQ(
      KittiSequence(folder).warnings().at(0).substr(folder_.string().size()),
      "/sequences/07/image_0: 3 of the image numbers 0 to 5 are missing, the first one after 1");
  rename(0, 3);
  rename(1, 4);
  EXPECT_EQ(KittiSequence(folder).stampNs(0), 300000000);
  EXPECT_TRUE(KittiSequence(folder).warnings().empty());
  write("sequences/07/times.txt", "0\n.1\n.2\n.3\n");
  EXPECT_EQ(errorOf(folder), "/sequences/07/times.txt: has 4 stamps for 3 images");
}

TEST_F(KittiSequences, RefusesSeveralSeriesOfFiles) {
  const fs::path folder = makeOdometry();
  write("sequences/07/image_0/.000003.png", "hidden");
  write("sequences/07/image_0/mask.png", encoded("png"));
  EXPECT_EQ(KittiSequence(folder).size(), 3u);
  write("sequences/07/image_0/000000.jpg", encoded("jpg"));
  EXPECT_NE(errorOf(folder).find(" has the same number as 000000."), std::string::npos);
  fs::remove(folder / "image_0/000000.jpg");
  for (const char* name : {"cam0_1", "cam0_2", "cam1_1", "cam1_2"}) {
    write(std::string("two/") + name + ".png", encoded("png"));
  }
  EXPECT_EQ(
      dataErrorOf([&] { imageFiles(folder_ / "two"); }, folder_),
      "/two holds several series of files, of cam0_1.png and of cam1_1.png: keep those of one "
      "camera");
  for (const char* name : {"1600000000.5", "1600000000.45", "1600000001.5", "1600000001.45"}) {
    write(std::string("times/image_") + name + ".png", encoded("png"));
  }
  std::string order;
  for (const fs::path& file : imageFiles(folder_ / "times").files) {
    order += file.filename().string() + " ";
  }
  EXPECT_EQ(order,
            "image_1600000000.45.png image_1600000000.5.png image_1600000001.45.png "
            "image_1600000001.5.png ");
  write("sequences/07/image_0/right000000.png", encoded("png"));
  EXPECT_EQ(errorOf(folder).find("/sequences/07/image_0 holds several series of files, of 00000"),
            0u)
      << errorOf(folder);
}

TEST_F(KittiSequences, ReadsDrivesBeforeRectification) {
  const fs::path folder = makeRaw();
  const std::string rectified = "P_rect_00: 20 0 16 0 0 20 12 0 0 0 1 0\n";
  write(kRawCalibration,
        "S_00: 64 48\nK_00: 80 0 30 0 81 25 0 0 1\nD_00: -0.3 0.1 0 0 0\nS_rect_00: 32 24\n" +
            rectified);
  EXPECT_EQ(errorOf(folder),
            "/2011_09_26/drive_0001_sync: the images are not rectified (64x48); --unrectified uses "
            "K_00 and D_00 of /2011_09_26/calib_cam_to_cam.txt");
  const CameraCalibration raw = KittiSequence(folder, {true, true, true}).calibration();
  EXPECT_EQ(raw.fx, 80);
  EXPECT_EQ(raw.distortion, (std::vector<double>{-0.3, 0.1, 0, 0, 0}));
  // Without sizes, the principal point tells.
  write(kRawCalibration, rectified);
  EXPECT_EQ(dataErrorOf([&] { KittiSequence(folder).camera(); }, folder_),
            "/2011_09_26/calib_cam_to_cam.txt (P_rect_00) is of another image size: its principal "
            "point (16, 12) is the centre of images of about 33x25, the images are 64x48");
}

TEST_F(KittiSequences, RefusesWhatIsNoSequence) {
  EXPECT_EQ(errorOf(folder_ / "none"), "/none: no such folder");
  EXPECT_EQ(errorOf(folder_),
            ": has neither image_0 (KITTI odometry) nor image_00/data (KITTI raw)");
  const fs::path folder = makeOdometry();
  fs::remove(folder / "times.txt");
  EXPECT_EQ(errorOf(folder), "/sequences/07/times.txt: no such file");
  fs::remove_all(folder / "image_0");
  fs::create_directory(folder / "image_0");
  EXPECT_EQ(
      errorOf(folder),
      "/sequences/07/image_0 has no file with a number in its name and the type .png, .jpg, .jpeg");
}

TEST_F(KittiSequences, ReadsARawDrive) {
  const fs::path drive = makeRaw();
  for (const char* zone : {"UTC", "America/New_York"}) {
    setenv("TZ", zone, 1);
    const KittiSequence sequence(drive);
    EXPECT_EQ(sequence.name(), "drive_0001_sync");
    EXPECT_EQ(sequence.size(), 2u);
    EXPECT_EQ(sequence.camera().fx, 70);
    EXPECT_EQ(sequence.stampNs(0), 1317042145964389445);
    EXPECT_EQ(sequence.stampNs(1), 1317042146064390000);
    EXPECT_TRUE(sequence.groundTruth().empty());
  }
  unsetenv("TZ");
}

TEST_F(KittiSequences, RefusesBadRawStamps) {
  const fs::path drive = makeRaw();
  const std::string stamps = kRawDrive + "/image_00/timestamps.txt";
  for (const char* bad : {"2011-13-26 13:02:25.5", "2011-02-30 13:02:25.5", "2011-09-26 25:02:25.5",
                          "2011-09-26 13:02", "9999-09-26 13:02:25.5", "yester:day"}) {
    write(stamps, std::string(bad) + "\n" + bad);
    EXPECT_EQ(errorOf(drive),
              "/" + stamps + ", line 1: is not a time such as 2011-09-26 13:02:25.964389445")
        << bad;
  }
  const std::string blanks(300000, ' ');
  write(stamps, "2011-09-26 13:02:25.5" + blanks + "\r\n2011-09-26 13:02:26.5\t\v\f\n");
  const KittiSequence sequence(drive);
  EXPECT_EQ(sequence.stampNs(1) - sequence.stampNs(0), 1'000'000'000);
}

TEST_F(KittiSequences, LeavesOutRawGroundTruthThatCannotBeUsed) {
  const fs::path drive = makeRaw();
  addOxts();
  const std::string oxts = "/oxts/data/0000000001.txt, line 1: ";
  const fs::path second = writeOxts(1, "49 8 116 0 0 0 1");
  expectNoGroundTruth(drive, "/" + kRawDrive + oxts + "has 31 numbers instead of 30");
  writeOxts(1, "91 8 0 0 0 0");
  expectNoGroundTruth(drive,
                      "/" + kRawDrive + oxts + "its latitude is not between -90 and 90 degrees");
  fs::remove(second);
  expectNoGroundTruth(drive, "/" + kRawDrive + "/oxts: has 1 for 2 images");
  write("2011_09_26/calib_velo_to_cam.txt", "R: 0 0 0 0 0 0 0 0 0\nT: 0 0 0\n");
  expectNoGroundTruth(drive, "/2011_09_26/calib_velo_to_cam.txt, line 1: R: is not a rotation");
}

TEST_F(KittiSequences, FindsGroundTruthOfAnotherRateByItsStamps) {
  const fs::path drive = makeRaw();
  addOxts();
  std::string times;
  for (int i = 0; i < 12; ++i) {
    times += "2011-09-26 13:02:" + std::to_string(25.966 + 0.01 * i) + "\n";
    if (i > 0) writeOxts(i, i == 10 ? "49.0 8.40001 116.5 0 0 0.1" : "49.1 8.4 0 0 0 0");
  }
  expectNoGroundTruth(drive, "/" + kRawDrive + "/oxts: has 12 for 2 images");
  write(kRawDrive + "/oxts/timestamps.txt", times);
  const KittiSequence sequence(drive);
  ASSERT_EQ(sequence.groundTruth().size(), 2u);
  EXPECT_NEAR(sequence.groundTruth()[1].translation().norm(), 0.9, 0.1);
}

TEST_F(KittiSequences, ReadsADriveOfKitti360) {
  const fs::path drive = makeRaw();
  fs::rename(drive / "image_00/data", drive / "image_00/data_rect");
  write("calibration/perspective.txt",
        "calib_time: 01-Jan-2018\nS_rect_00: 64 48\nP_rect_00: 72 0 32 0 0 72 30 0 0 0 1 0\n");
  const KittiSequence sequence(drive);
  EXPECT_EQ(sequence.size(), 2u);
  EXPECT_TRUE(isSameCamera(sequence.camera(), {64, 48, 72, 72, 32, 30}));
}

// The expected motion is composed from the files' numbers with Eigen.
TEST_F(KittiSequences, RawGroundTruthIsThatOfTheRectifiedCamera) {
  const fs::path drive = makeRaw();
  addOxts();
  writeOxts(0, "49.0 8.4 116.0 0.02 -0.03 0.4");
  writeOxts(1, "49.00001 8.40001 116.5 0.05 0.04 0.9");
  // A quarter turn about the optical axis.
  write(kRawCalibration, "R_rect_00: 0 -1 0 1 0 0 0 0 1\nP_rect_00: 70 0 32 0 0 71 24 0 0 0 1 0\n");
  const auto rotation = [](double roll, double pitch, double yaw) {
    return Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
           Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
           Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX());
  };
  const double metre_per_degree = 6378137.0 * M_PI / 180.0;
  const Eigen::Translation3d moved(std::cos(49.0 * M_PI / 180.0) * 1e-5 * metre_per_degree,
                                   1e-5 * metre_per_degree, 0.5);
  const Eigen::Isometry3d T_w_imu0(rotation(0.02, -0.03, 0.4)),
      T_w_imu1(moved * rotation(0.05, 0.04, 0.9));
  const Eigen::Translation3d T_velo_imu(-0.8, 0.3, -0.8);
  Eigen::Matrix3d R_cam_velo, R_rect;
  R_cam_velo << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  R_rect << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  Eigen::Isometry3d T_c_imu(Eigen::Translation3d(0, -0.1, -0.3));
  T_c_imu.rotate(R_cam_velo);
  T_c_imu.prerotate(R_rect);
  T_c_imu = T_c_imu * T_velo_imu;
  const Eigen::Isometry3d expected = T_c_imu * T_w_imu0.inverse() * T_w_imu1 * T_c_imu.inverse();
  const KittiSequence sequence(drive);
  EXPECT_TRUE(sequence.groundTruth().at(0).isApprox(Eigen::Isometry3d::Identity(), 1e-9));
  const Eigen::Isometry3d& pose = sequence.groundTruth().at(1);
  EXPECT_LT((pose.translation() - expected.translation()).norm(), 1e-5);
  EXPECT_LT((pose.linear() - expected.linear()).norm(), 1e-9);
}

}  // namespace
}  // namespace gsv
