#include "vo/descriptors.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <opencv2/features2d.hpp>
#include <utility>

#include "common/vector_loop.hpp"
#include "ground_scale_vo/common/math.hpp"
#include "vo/feature.hpp"

namespace gsv {
namespace {

/// A descriptor tolerates a change of size by a fifth, so three scales cover a factor of 2.4.
constexpr float kScaleFactor = 1.4f;

constexpr int kPatchSize_px = 31;  // that of ORB
constexpr int kBorder_px = 16;     // points nearer to the image border have no descriptor
constexpr int kBits = 256;         // of a descriptor

/// [bits] largest distance of a match; unrelated descriptors differ in half of the bits.
constexpr int kMaxDistance = kBits / 5;
/// Largest distance of a match relative to the second best (Lowe's ratio test).
constexpr double kMaxDistanceRatio = 0.8;

/// Number of matches whose median displacement predicts that of a point.
constexpr std::size_t kNeighbours = 7;

}  // namespace

Descriptors::Descriptors(const cv::Mat& image, std::vector<cv::Point2f> points, const cv::Mat& mask)
    : points_(std::move(points)) {
  for (auto& descriptors : at_scale_) descriptors.resize(points_.size());
  if (points_.empty()) return;
  std::vector<cv::KeyPoint> keypoints;
  for (int scale = 0; scale < kScales; ++scale) {
    for (std::size_t i = 0; i < points_.size(); ++i) {
      constexpr float kAngle = 0, kResponse = 0;
      const int reach = cvRound(kBorder_px * std::pow(kScaleFactor, scale));
      if (touchesMask(mask, points_[i], reach)) continue;
      keypoints.emplace_back(points_[i], static_cast<float>(kPatchSize_px), kAngle, kResponse,
                             scale, static_cast<int>(i));
    }
  }
  const auto orb = cv::ORB::create(static_cast<int>(keypoints.size()), kScaleFactor, kScales,
                                   kBorder_px, 0, 2, cv::ORB::HARRIS_SCORE, kPatchSize_px);
  cv::Mat rows;
  orb->compute(image, keypoints, rows);  // removes the keypoints near the border
  for (std::size_t row = 0; row < keypoints.size(); ++row) {
    Bits bits;
    std::memcpy(&bits, rows.ptr(static_cast<int>(row)), sizeof bits);
    at_scale_[static_cast<std::size_t>(keypoints[row].octave)]
             [static_cast<std::size_t>(keypoints[row].class_id)] = bits;
  }
}

/// Processors with AVX2 have an instruction that counts bits.
GSV_VECTOR_LOOP int Descriptors::differingBits(const Bits& a, const Bits& b) {
  int count = 0;
  for (std::size_t i = 0; i < a.size(); ++i) count += __builtin_popcountll(a[i] ^ b[i]);
  return count;
}

/// One of the two is taken at full resolution.
int Descriptors::distance(std::size_t i, const Descriptors& other, std::size_t k) const {
  int best = kBits;
  const auto compare = [&](const std::optional<Bits>& a, const std::optional<Bits>& b) {
    if (a && b) best = std::min(best, differingBits(*a, *b));
  };
  for (std::size_t scale = 0; scale < kScales; ++scale) {
    compare(at_scale_[0][i], other.at_scale_[scale][k]);
    if (scale > 0) compare(at_scale_[scale][i], other.at_scale_[0][k]);
  }
  return best;
}

std::vector<DescriptorMatch> matchDescriptors(const Descriptors& from, const Descriptors& to,
                                              const std::vector<cv::Point2f>& near,
                                              float radius_px) {
  using Best = std::pair<int, std::size_t>;  // distance and index
  constexpr Best kNoMatch{kBits + 1, 0};
  std::vector<Best> best_from(to.points().size(), kNoMatch);
  std::vector<DescriptorMatch> candidates;
  for (std::size_t i = 0; i < from.points().size(); ++i) {
    Best best = kNoMatch;
    int second = kBits;
    for (std::size_t k = 0; k < to.points().size(); ++k) {
      if (!near.empty()) {
        const cv::Point2f offset = to.points()[k] - near[i];
        if (!(offset.dot(offset) <= radius_px * radius_px)) continue;
      }
      const int distance = from.distance(i, to, k);
      if (distance < best_from[k].first) best_from[k] = {distance, i};
      if (distance < best.first) {
        second = best.first;
        best = {distance, k};
      } else {
        second = std::min(second, distance);
      }
    }
    if (best.first <= kMaxDistance && best.first < kMaxDistanceRatio * second) {
      candidates.push_back({i, best.second});
    }
  }
  std::vector<DescriptorMatch> matches;
  for (const DescriptorMatch& match : candidates) {
    if (best_from[match.to].second == match.from) matches.push_back(match);
  }
  return matches;
}

std::vector<cv::Point2f> predictPixelsByMatches(const std::vector<cv::Point2f>& from,
                                                const std::vector<cv::Point2f>& to,
                                                const std::vector<DescriptorMatch>& matches) {
  const std::size_t neighbours = std::min(kNeighbours, matches.size());
  std::vector<cv::Point2f> predicted;
  std::vector<std::pair<float, std::size_t>> by_distance(matches.size());
  for (const cv::Point2f& point : from) {
    for (std::size_t k = 0; k < matches.size(); ++k) {
      const cv::Point2f offset = from[matches[k].from] - point;
      by_distance[k] = {offset.dot(offset), k};
    }
    std::partial_sort(by_distance.begin(),
                      by_distance.begin() + static_cast<std::ptrdiff_t>(neighbours),
                      by_distance.end());
    std::vector<double> dx, dy;
    for (std::size_t n = 0; n < neighbours; ++n) {
      const DescriptorMatch& match = matches[by_distance[n].second];
      dx.push_back(to[match.to].x - from[match.from].x);
      dy.push_back(to[match.to].y - from[match.from].y);
    }
    predicted.push_back(
        point + cv::Point2f(static_cast<float>(median(&dx)), static_cast<float>(median(&dy))));
  }
  return predicted;
}

}  // namespace gsv
