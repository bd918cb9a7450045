#include "ground_scale_vo/evaluation/opencv_baseline.hpp"

#include <malloc.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <sstream>
#include <utility>

#include "ground_scale_vo/common/stopwatch.hpp"
#include "ground_scale_vo/io/csv_stream.hpp"
#include "ground_scale_vo/io/process_usage.hpp"

namespace ground_scale_vo {

std::string measureOpencvBaseline(const std::vector<std::vector<cv::Point2f>>& points,
                                  const std::function<cv::Mat(std::size_t)>& image,
                                  const FeatureTracker::Options& options) {
  // Keep freed memory: whether malloc returns that of OpenCV's large temporary images to the system
  // after every image would depend on what this process has allocated before.
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
  mallopt(M_TRIM_THRESHOLD, 256 << 20);
  constexpr double kCornerQuality = 0.01;  // relative to the strongest, OpenCV's example value
  const cv::Size window(FeatureTracker::kPatchSide_px, FeatureTracker::kPatchSide_px);
  const auto pyramid = [&](const cv::Mat& base) {
    std::vector<cv::Mat> levels;
    cv::buildOpticalFlowPyramid(base, levels, window, options.pyramid_levels);
    return levels;
  };
  std::ostringstream csv = csvStream("frame,points,pyramid,detect,track,total,cpu");
  std::vector<cv::Mat> from = pyramid(image(0));
  for (std::size_t i = 1; i < points.size(); ++i) {
    const cv::Mat current = image(i);
    const double cpu_begin = threadCpuMs();
    Stopwatch watch;
    std::vector<cv::Mat> to = pyramid(current);
    const double pyramid_ms = watch.lapMs();

    std::vector<cv::Point2f> corners;
    cv::goodFeaturesToTrack(current, corners, std::max(1, static_cast<int>(points[i].size())),
                            kCornerQuality, options.cell_size * current.cols / 2);
    const double detect_ms = watch.lapMs();

    std::vector<cv::Point2f> found;
    std::vector<unsigned char> ok;
    std::vector<float> error;
    if (!points[i].empty()) {
      cv::calcOpticalFlowPyrLK(from, to, points[i], found, ok, error, window,
                               options.pyramid_levels);
    }
    const double track_ms = watch.lapMs();
    csv << i << ',' << points[i].size() << ',' << pyramid_ms << ',' << detect_ms << ',' << track_ms
        << ',' << pyramid_ms + detect_ms + track_ms << ',' << threadCpuMs() - cpu_begin << '\n';
    from = std::move(to);
  }
  return csv.str();
}

}  // namespace ground_scale_vo
