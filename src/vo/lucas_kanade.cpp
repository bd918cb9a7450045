#include "vo/lucas_kanade.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace ground_scale_vo {

std::vector<cv::Mat> LucasKanade::pyramid(const cv::Mat& image, int levels) const {
  std::vector<cv::Mat> result;
  const int border = static_cast<int>(layout_.stride);  // a patch outside, and its own border
  for (cv::Size size = image.size(); static_cast<int>(result.size()) <= levels;
       size = {(size.width + 1) / 2, (size.height + 1) / 2}) {
    if (!result.empty() && std::min(size.width, size.height) <= layout_.side) break;
    cv::Mat padded(size.height + 2 * border, size.width + 2 * border, CV_8UC1);
    cv::Mat level = padded({{border, border}, size});
    if (result.empty()) {
      image.copyTo(level);
    } else {
      cv::pyrDown(result.back(), level, size);
    }
    cv::copyMakeBorder(level, padded, border, border, border, border,
                       cv::BORDER_REFLECT_101 | cv::BORDER_ISOLATED);
    result.push_back(level);
  }
  return result;
}

PyramidSearch::PyramidSearch(const LucasKanade& lucas_kanade, const std::vector<cv::Mat>& from,
                             const std::vector<cv::Mat>& to)
    : layout_(lucas_kanade.layout()),
      from_(from),
      to_(to),
      templates_(std::min(from.size(), to.size())) {}

void PyramidSearch::prefetch(const cv::Point2f& from_point, const cv::Point2f& guess,
                             int levels) const {
  for (int level = std::min(levels, static_cast<int>(templates_.size()) - 1); level >= 0; --level) {
    const auto scale = static_cast<float>(1 << level);
    prefetchPatch(from_[static_cast<std::size_t>(level)], from_point / scale, layout_.side);
    prefetchPatch(to_[static_cast<std::size_t>(level)], guess / scale, layout_.side);
  }
}

void PyramidSearch::setPatch(const cv::Point2f& from_point) {
  from_point_ = from_point;
  for (LevelTemplate& level : templates_) level.state = LevelTemplate::kUnknown;
}

const PatchTemplate* PyramidSearch::templateOf(int level) {
  const auto k = static_cast<std::size_t>(level);
  LevelTemplate& result = templates_[k];
  if (result.state == LevelTemplate::kUnknown) {
    const cv::Point2f centre = from_point_ / static_cast<float>(1 << level);
    result.state = result.patch.set(layout_, from_[k], centre, &workspace_)
                       ? LevelTemplate::kUsable
                       : LevelTemplate::kUnusable;
  }
  return result.state == LevelTemplate::kUsable ? &result.patch : nullptr;
}

bool PyramidSearch::find(int levels, cv::Point2f* point) {
  if (!templateOf(0)) return false;  // whatever the coarser levels find
  bool found = false;
  for (int level = std::min(levels, static_cast<int>(templates_.size()) - 1); level >= 0; --level) {
    const PatchTemplate* const patch = templateOf(level);
    const auto scale = static_cast<float>(1 << level);
    *point /= scale;
    found = patch && patch->find(layout_, to_[static_cast<std::size_t>(level)], &workspace_, point);
    *point *= scale;
  }
  return found;
}

}  // namespace ground_scale_vo
