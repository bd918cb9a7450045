#include "ground_scale_vo/simulation/fault_drives.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <future>
#include <limits>
#include <mutex>
#include <set>

#include "ground_scale_vo/common/error.hpp"
#include "support/sanitizer.hpp"

// Images with faults in, metres out: nothing breaks, nothing is invented, and it says so.

namespace ground_scale_vo {
namespace {

TEST(FaultDrives, TenOfThemHoldEveryFaultAndRoomBetween) {
  std::set<std::string> names, heights;
  for (std::size_t i = 0; i < kFaultDrives; ++i) {
    const FaultDrive drive = faultDrive(i);
    EXPECT_NO_THROW(drive.options.validate()) << i;
    heights.insert(std::to_string(drive.options.camera_height));
    ASSERT_GE(drive.faults.size(), 2u);
    std::size_t clean_from = 0, hiding = 0;
    for (const PlacedFault& fault : drive.faults) {
      names.insert(fault.what);
      EXPECT_GT(fault.first, clean_from + 20) << drive.name << ": " << fault.what;
      EXPECT_GE(fault.last, fault.first);
      const double seconds =
          static_cast<double>(fault.last - fault.first + 1) / drive.options.frame_rate_hz;
      if (fault.hides) {
        EXPECT_GT(seconds, 3) << drive.name << ": " << fault.what;
      }
      hiding += fault.hides;
      clean_from = fault.last + 1;
    }
    EXPECT_EQ(hiding, 1u) << drive.name;
    EXPECT_GT(drive.options.frames, static_cast<int>(clean_from) + 20);
    // The same seed gives the same drive.
    EXPECT_EQ(faultDrive(i).options.frames, drive.options.frames);
    EXPECT_EQ(faultDrive(i).faults.front().seed, drive.faults.front().seed);
  }
  EXPECT_EQ(heights.size(), kFaultDrives);
  for (const std::string& name : faultNames()) {
    EXPECT_EQ(names.count(name), 1u) << name;
    EXPECT_EQ(faultDrive(name).faults.front().what, name);
  }
  EXPECT_NE(faultDrive(0, 1).options.random_seed, faultDrive(0, 2).options.random_seed);
  EXPECT_THROW(faultDrive(kFaultDrives), OptionError);
  EXPECT_THROW(faultDrive("gremlins"), OptionError);
}

FaultRunFigures good() {
  FaultRunFigures figures;
  figures.frames = 100;
  FaultFigures fault;
  fault.what = "black";
  fault.hides = true;
  fault.duration_s = 4;
  fault.said_after_s = 0.1;
  fault.missed_m = 20;
  fault.sigma_m = 15;
  figures.faults = {fault};
  figures.stretches = {{10, 40, 30, 2}};
  return figures;
}

TEST(FaultDrives, EveryBarCanBreak) {
  EXPECT_EQ(violatedThreshold(good()), "");
  const auto broken = [](const auto& change) {
    FaultRunFigures figures = good();
    change(figures);
    return violatedThreshold(figures);
  };
  using Figures = FaultRunFigures;
  EXPECT_NE(broken([](Figures& f) { f.non_finite_frames = 1; }), "");
  EXPECT_NE(broken([](Figures& f) { f.stretches[0].error_percent = 5.1; }), "");
  EXPECT_NE(broken([](Figures& f) { f.stretches[0].error_percent = NAN; }), "");
  EXPECT_NE(broken([](Figures& f) { f.stretches.clear(); }), "");
  EXPECT_NE(broken([](Figures& f) { f.faults[0].said_after_s = 3.1; }), "");
  EXPECT_NE(broken([](Figures& f) { f.faults[0].said_after_s = NAN; }), "");
  EXPECT_NE(broken([](Figures& f) { f.faults[0].ok_frames = 1; }), "");
  EXPECT_NE(broken([](Figures& f) { f.faults[0].metric_after = -1; }), "");
  EXPECT_NE(broken([](Figures& f) { f.faults[0].invented_m = 3; }), "");
  EXPECT_NE(broken([](Figures& f) { f.faults[0].sigma_m = 1; }), "");
}

TEST(FaultDrives, NumbersThatAreNotFiniteAreSeen) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  VisualOdometry::Output vo;
  vo.frame.features.resize(2);
  EXPECT_TRUE(isFinite(vo));
  vo.frame.features[1].p_c.x() = static_cast<float>(kNan);
  EXPECT_TRUE(isFinite(vo)) << "of no point";
  vo.frame.features[1].has_point = true;
  EXPECT_FALSE(isFinite(vo));
  vo.frame.features.clear();
  vo.frame.T_w_c.translation().x() = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(isFinite(vo));

  ScaleRecovery::Output scale;
  EXPECT_TRUE(isFinite(scale));
  scale.pose = MetricPose();
  EXPECT_TRUE(isFinite(scale));
  scale.pose->covariance(2, 3) = kNan;
  EXPECT_FALSE(isFinite(scale));
  scale.pose->covariance.setIdentity();
  scale.pose->covariance(1, 1) = -1e-3;
  EXPECT_FALSE(isFinite(scale));
  scale.pose.reset();
  scale.scale.sigma = kNan;
  EXPECT_FALSE(isFinite(scale));
}

TEST(FaultDrives, KeepTheirBars) {
  cv::setNumThreads(1);  // two drives at once
  std::atomic<std::size_t> next{0};
  std::mutex printing;
  const auto work = [&] {
    for (std::size_t i = 0; (i = kEveryDrive * next++) < kFaultDrives;) {
      const FaultDrive drive = faultDrive(i);
      const FaultRunFigures figures = runFaultDrive(drive);
      double worst = 0;
      std::string faults;
      for (const StretchFigures& s : figures.stretches) worst = std::max(worst, s.error_percent);
      for (const FaultFigures& f : figures.faults) faults += " " + f.what + ",";
      const std::lock_guard<std::mutex> lock(printing);
      std::printf("%s:%s stretches within %.2f %%\n", drive.name.c_str(), faults.c_str(), worst);
      EXPECT_EQ(violatedThreshold(figures), "") << drive.name;
      EXPECT_GE(figures.stretches.size(), 2u) << drive.name;
    }
  };
  std::future<void> other = std::async(std::launch::async, work);
  work();
  other.get();
  cv::setNumThreads(-1);
}

}  // namespace
}  // namespace ground_scale_vo
