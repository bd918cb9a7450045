#include "input/distortion_model.hpp"

#include <algorithm>
#include <opencv2/calib3d.hpp>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
namespace {

using Names = DistortionModel::Names;
using Points = DistortionModel::Points;
using Coefficients = DistortionModel::Coefficients;

constexpr double kMaxCoefficient = 1e3;
const cv::Matx33d kNormalised = cv::Matx33d::eye();  // camera matrix

void distortBrown(const Points& from, const Coefficients& coefficients, Points* to) {
  std::vector<cv::Point3d> rays;
  cv::convertPointsToHomogeneous(from, rays);
  cv::projectPoints(rays, cv::Vec3d(), cv::Vec3d(), kNormalised, coefficients, *to);
}

void undistortBrown(const Points& from, const Coefficients& coefficients, Points* to) {
  cv::undistortPoints(from, *to, kNormalised, coefficients);
}

void distortFisheye(const Points& from, const Coefficients& coefficients, Points* to) {
  cv::fisheye::distortPoints(from, *to, kNormalised, coefficients);
}

void undistortFisheye(const Points& from, const Coefficients& coefficients, Points* to) {
  cv::fisheye::undistortPoints(from, *to, kNormalised, coefficients);
}

/// "4, 5 or 8" with last " or ".
std::string enumeration(const Names& words, const std::string& last) {
  std::string text = words.front();
  for (std::size_t i = 1; i < words.size(); ++i) {
    text += (i + 1 == words.size() ? last : ", ") + words[i];
  }
  return text;
}

}  // namespace

const std::vector<DistortionModel>& distortionModels() {
  // plumb_bob with the coefficients of rational_polynomial is accepted, and vice versa.
  static const std::vector<std::size_t> kBrown{0, 4, 5, 8, 12, 14};
  static const std::vector<DistortionModel> kModels{
      {{"plumb_bob", "radtan"},
       {"PinHole", "Rectified"},
       {"PINHOLE"},
       kBrown,
       true,
       distortBrown,
       undistortBrown},
      {{"rational_polynomial"}, {}, {}, kBrown, true, distortBrown, undistortBrown},
      {{"equidistant", "fisheye", "kannala_brandt", "KANNALA_BRANDT"},
       {"KannalaBrandt8"},
       {"KANNALA_BRANDT"},
       {4},
       false,
       distortFisheye,
       undistortFisheye}};
  return kModels;
}

const DistortionModel& plumbBob() { return distortionModels().front(); }

const DistortionModel& modelNamed(const std::string& name, Names DistortionModel::*names,
                                  const std::string& what) {
  Names supported;
  for (const DistortionModel& model : distortionModels()) {
    const Names& own = model.*names;
    if (std::find(own.begin(), own.end(), name) != own.end()) return model;
    if (!own.empty()) supported.push_back(own.front());
  }
  throw OptionError(what + "supported are " + enumeration(supported, " and "));
}

void DistortionModel::validate(const Coefficients& coefficients) const {
  if (std::find(counts.begin(), counts.end(), coefficients.size()) == counts.end()) {
    Names numbers;
    for (const std::size_t count : counts) numbers.push_back(std::to_string(count));
    if (counts.front() == 0) numbers.erase(numbers.begin());
    throw OptionError(names.front() + " distortion has " + enumeration(numbers, " or ") +
                      " coefficients, not " + std::to_string(coefficients.size()));
  }
  for (const double k : coefficients) {
    requireInRange("distortion coefficient", k, -kMaxCoefficient, kMaxCoefficient);
  }
}

}  // namespace ground_scale_vo
