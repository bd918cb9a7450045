// Measures the cost of the offline pipeline over one KITTI folder: times, processor time, memory.

#include <malloc.h>
#include <nav_msgs/Odometry.h>
#include <ros/serialization.h>
#include <sched.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <filesystem>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "common/files.hpp"
#include "common/time.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/evaluation/progress_line.hpp"
#include "ground_scale_vo/evaluation/run_report.hpp"
#include "ground_scale_vo/io/process_usage.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ros/odometry_output.hpp"
#include "support/drive_arguments.hpp"

namespace fs = std::filesystem;

namespace {

constexpr const char* kDetails =
    R"(Files in DIR:
  timing.csv    as of run_sequence: milliseconds of every stage and frame
  usage.csv     a line per frame: decode_cpu, frame_cpu: processor time of decoding, and of
                odometry and scale stage without the mapping thread [ms]; publish: wall time of
                filling and serialising the messages that the nodelets would publish [ms]; wall_s,
                cpu_s: wall time and processor time of all threads since the start of the run [s];
                rss_mb, peak_rss_mb: memory [MiB]
  baseline.csv  with --baseline, a line per frame from the second on: detect, total: wall time of
                the corner detection and of all steps; cpu: processor time of all steps [ms]

If it may use more than one processor core (taskset), each image is decoded while the previous one is
processed, else before it is processed.

Exit status: 0 done, 1 the data cannot be used, 2 the arguments cannot be used.)";

struct Arguments : gsv::DriveArguments {
  int repeat = 1;
  bool baseline = false;
};

/// Fills and serialises the messages that the nodelets would publish for the last frame of the run.
/// Returns their size [bytes].
std::size_t serialiseMessages(const gsv::OfflineRun& run, const gsv::TfFrames& frames) {
  using ros::serialization::serializeMessage;
  const gsv::VoFrame& frame = run.last().vo.frame;
  const gsv::ScaleRecovery::Output& scale = run.last().scale;
  std_msgs::Header header;
  header.frame_id = frames.base_frame;
  std::size_t bytes = serializeMessage(*gsv::toMsg(frame, header)).num_bytes +
                      serializeMessage(*gsv::toMsg(scale.scale, frame.map_id, header)).num_bytes;
  if (frame.status == gsv::VoStatus::kTracking) {
    bytes += serializeMessage(*gsv::toOdometryMsg(frame, header, "vo_world")).num_bytes;
  }
  if (scale.pose) {
    const auto odometry = gsv::toOdometryMsg(*scale.pose, frames, header.stamp);
    tf2_msgs::TFMessage tf;
    tf.transforms.push_back(gsv::toTransformMsg(*odometry));
    bytes += serializeMessage(*odometry).num_bytes + serializeMessage(tf).num_bytes;
  }
  return bytes;
}

/// Positions of the features of one frame that were tracked from the previous image, outliers
/// included [px].
using Pixels = std::vector<cv::Point2f>;

Pixels trackedPixels(const gsv::VisualOdometry::Output& vo) {
  Pixels pixels;
  for (const auto& feature : vo.frame.features) pixels.emplace_back(feature.u.x(), feature.u.y());
  for (const auto& feature : vo.rejected) pixels.emplace_back(feature.u.x(), feature.u.y());
  return pixels;
}

/// Runs the pipeline over the drive, several times in turn with stamps that continue to grow, and
/// writes timing.csv and usage.csv. Returns each frame's pixels with --baseline.
std::vector<Pixels> measurePipeline(const Arguments& arguments) {
  auto drive = gsv::openDrive(arguments.drive);
  gsv::OfflineRun run(drive->camera(), arguments.options, drive->mask());
  gsv::RunProgress progress(gsv::resultName(arguments.drive.path),
                            arguments.repeat * drive->count());
  const auto frames = gsv::TfFrames::ofCamera("odom", "camera");
  std::vector<Pixels> pixels;
  std::ostringstream usage =
      gsv::csvStream("frame,decode_cpu,frame_cpu,publish,wall_s,cpu_s,rss_mb,peak_rss_mb");
  const gsv::Stopwatch wall;
  const double cpu_begin = gsv::processUsage().cpu_s;
  std::int64_t offset_ns = 0, last_ns = 0;
  for (int pass = 0; pass < arguments.repeat; ++pass) {
    if (pass > 0) drive = gsv::openDrive(arguments.drive);
    for (;;) {
      const double decode_begin = gsv::threadCpuMs();
      const auto image = drive->next();
      const double frame_begin = gsv::threadCpuMs();
      if (!image) break;
      if (image->grey.empty()) continue;
      constexpr std::int64_t kPause = 100'000'000;  // [ns] between two passes
      if (pass > 0 && last_ns >= image->stamp_ns + offset_ns) {
        offset_ns = last_ns + kPause - image->stamp_ns;
      }
      last_ns = image->stamp_ns + offset_ns;
      const std::size_t i = run.record().frames().size();
      const gsv::RunFrame& frame = run.process(image->grey, last_ns, image->decode_ms);
      const double frame_end = gsv::threadCpuMs();
      const gsv::Stopwatch watch;
      if (serialiseMessages(run, frames) == 0) throw std::logic_error("messages without bytes");
      const double publish_ms = watch.ms();
      if (arguments.baseline) pixels.push_back(trackedPixels(run.last().vo));
      const gsv::ProcessUsage now = gsv::processUsage();
      usage << i << ',' << frame_begin - decode_begin << ',' << frame_end - frame_begin << ','
            << publish_ms << ',' << wall.seconds() << ',' << now.cpu_s - cpu_begin << ','
            << now.rss_mb << ',' << now.peak_rss_mb << '\n';
      progress.show(frame);
    }
  }
  const fs::path out = arguments.out;
  gsv::writeFile(out / "timing.csv", gsv::timingCsv(run.record()));
  gsv::writeFile(out / "usage.csv", usage.str());
  return pixels;
}

/// Measures OpenCV alone on the drive: image pyramid, corner detection and Lucas-Kanade tracking in
/// every frame, the minimum that a feature tracker computes. points[i]: the pixels to track into
/// image i; points[0] is ignored.
std::string measureBaseline(const Arguments& arguments, const std::vector<Pixels>& points) {
  const gsv::VisualOdometry::Options& options = arguments.options.odometry.vo;
  // Keep freed memory: whether malloc returns that of OpenCV's large temporary images to the system
  // after every image would depend on what this process has allocated before.
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
  mallopt(M_TRIM_THRESHOLD, 256 << 20);
  constexpr double kCornerQuality = 0.01;  // relative to the strongest, OpenCV's example value
  const cv::Size window(9, 9);             // this and the levels as in src/vo/tracking
  constexpr int kLevels = 4;
  const auto pyramid = [&](const cv::Mat& base) {
    std::vector<cv::Mat> levels;
    cv::buildOpticalFlowPyramid(base, levels, window, kLevels);
    return levels;
  };
  std::ostringstream csv = gsv::csvStream("frame,detect,total,cpu");
  const auto drive = gsv::openDrive(arguments.drive);
  const auto nextImage = [&] {
    for (;;) {
      cv::Mat image = drive->next().value().grey;
      if (!image.empty()) return image;
    }
  };
  std::vector<cv::Mat> from = pyramid(nextImage());
  for (std::size_t i = 1; i < points.size(); ++i) {
    const cv::Mat current = nextImage();
    const double cpu_begin = gsv::threadCpuMs();
    const gsv::Stopwatch total;
    std::vector<cv::Mat> to = pyramid(current);
    const gsv::Stopwatch detection;
    std::vector<cv::Point2f> corners;
    cv::goodFeaturesToTrack(current, corners, std::max(1, static_cast<int>(points[i].size())),
                            kCornerQuality, options.cell_size * current.cols / 2);
    const double detect_ms = detection.ms();
    std::vector<cv::Point2f> found;
    std::vector<unsigned char> ok;
    std::vector<float> error;
    if (!points[i].empty()) {
      cv::calcOpticalFlowPyrLK(from, to, points[i], found, ok, error, window, kLevels);
    }
    csv << i << ',' << detect_ms << ',' << total.ms() << ',' << gsv::threadCpuMs() - cpu_begin
        << '\n';
    from = std::move(to);
  }
  return csv.str();
}

int run(Arguments arguments) {
  cv::setNumThreads(1);
  gsv::makeFolder(arguments.out);  // fails before the run, not after it
  cpu_set_t cores;                 // that this process may use
  arguments.drive.options.ahead =
      sched_getaffinity(0, sizeof cores, &cores) == 0 && CPU_COUNT(&cores) > 1;
  const std::vector<Pixels> pixels = measurePipeline(arguments);
  if (arguments.baseline) {
    gsv::writeFile(fs::path(arguments.out) / "baseline.csv", measureBaseline(arguments, pixels));
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  gsv::CommandLine command_line("benchmark_sequence",
                                "Runs the offline pipeline over one KITTI folder and records what "
                                "it costs. scripts/benchmark\n"
                                "calls it and makes tables of its files.",
                                kDetails);
  arguments.addTo(&command_line, "folder for the files below");
  command_line.options().add_options()  //
      ("baseline", gsv::po::bool_switch(&arguments.baseline),
       "afterwards, over the same images: OpenCV's pyramid, corner detection and Lucas-Kanade "
       "alone, "
       "each frame with as many points as the pipeline tracked")  //
      ("repeat", gsv::numberInRange("--repeat", &arguments.repeat, "N", 1, 100000),
       "drive the sequence N times in turn");
  return command_line.run(
      argc, argv, [&] { arguments.check(); }, [&] { return run(arguments); });
}
