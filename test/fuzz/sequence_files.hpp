#pragma once

#include <opencv2/imgcodecs.hpp>
#include <string>

#include "fuzz_target.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"

namespace ground_scale_vo::fuzz {

inline void writeScratch(const std::string& name, const std::string& text) {
  writeScratch(name, reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
}

/// A sequence of two images in the scratch folder, the same for every input.
inline void makeSequence() {
  static const bool kMade = [] {
    std::filesystem::create_directories(std::filesystem::path(scratchFolder()) / "image_0");
    std::vector<unsigned char> png;
    cv::imencode(".png", cv::Mat(12, 16, CV_8UC1, cv::Scalar(100)), png);
    for (const char* name : {"image_0/0.png", "image_0/1.png"}) {
      writeScratch(name, png.data(), png.size());
    }
    writeScratch("calib.txt", "P0: 10 0 8 0 0 10 6 0 0 0 1 0\n");
    writeScratch("times.txt", "0\n0.1\n");
    return true;
  }();
  static_cast<void>(kMade);
}

/// Replaces one file of the sequence and reads the sequence: either its data are valid, or one
/// sentence says what is wrong.
inline void readSequenceWith(const char* file, const std::uint8_t* data, std::size_t size) {
  makeSequence();
  writeScratch(file, data, size);
  try {
    const KittiSequence sequence(scratchFolder());
    sequence.camera().validate();
    require(sequence.stampNs(0) < sequence.stampNs(1), "stamps increase");
    for (const Eigen::Isometry3d& pose : sequence.groundTruth()) {
      require(pose.matrix().allFinite(), "ground truth poses are finite");
    }
  } catch (const DataError& error) {
    const std::string text = error.what();
    // "FOLDER: has 3 ground truth heights for 2 images" names the folder, not the file.
    require(text.find(file) != std::string::npos || text.find("has ") != std::string::npos,
            "the error names the file or the number that does not match");
    require(text.find('\n') == std::string::npos, "the error is one line");
  }
}

}  // namespace ground_scale_vo::fuzz
