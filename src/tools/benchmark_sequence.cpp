// What one KITTI folder costs: the offline pipeline under a watch, and OpenCV alone beside it.

#include <nav_msgs/Odometry.h>
#include <ros/serialization.h>
#include <sched.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <locale>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/parse_number.hpp"
#include "ground_scale_vo/common/stopwatch.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/evaluation/run_report.hpp"
#include "ground_scale_vo/evaluation/set_option.hpp"
#include "ground_scale_vo/io/image_reader.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"
#include "ground_scale_vo/io/process_usage.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "run_progress.hpp"
#include "sequence_arguments.hpp"
#include "tool_main.hpp"

namespace gsv = ground_scale_vo;

namespace {

constexpr const char* kUsage =
    R"(usage: benchmark_sequence SEQ --camera-height M --out DIR [options]

Runs the offline pipeline over one KITTI folder and notes what it costs. scripts/benchmark calls this
and makes tables of it.

  SEQ                KITTI folder, as of run_sequence
  --camera-height M  height of the camera above the road [m]; required
  --out DIR          folder for the files below
  --cores N          processor cores that the process may use (default 1). With 1 an image is decoded
                     before it is worked on, with more while the one before is worked on
  --floor            afterwards, over the same images: OpenCV's pyramid, corner detection and
                     Lucas-Kanade alone, each frame with as many points as the pipeline tracked
  --repeat N         drive the sequence N times, forwards and backwards in turn (default 1)
  --image-scale S    images and camera S times as large (default 1)
  --set GROUP/NAME=VALUE
                     a parameter of either nodelet (docs/parameters.md); may be repeated

Files in DIR:
  run.json           frames, width, height [px], cores, and the settings of --set as one text
  timing.csv         as of run_sequence: milliseconds of every stage and frame
  usage.csv          a line a frame: features tracked from the image before; in milliseconds
                     decode_cpu, frame_cpu: processor time of decoding, and of front end and scale
                     stage without the second thread; publish: wall time of filling and serialising
                     the messages that the nodelets would publish; since the first frame began: wall_s,
                     cpu_s (processor time of all threads); rss_mb, peak_rss_mb [MiB]
  floor.csv          with --floor, a line a frame from the second on: wall time of each piece and of
                     all, and cpu, processor time of all, in milliseconds

Exit status: 0 done, 1 the data cannot be used, 2 the arguments cannot be used.
)";

struct Arguments : gsv::SequenceArguments {
  int cores = 1, repeat = 1;
  bool floor = false;
  double image_scale = 1;
  std::string settings;  ///< of --set, as one text
};

/// Throws OptionError.
Arguments parseArguments(int argc, char** argv) {
  Arguments arguments;
  arguments.parse(argc, argv, [&](const std::string& argument, const Arguments::Value& value) {
    if (argument == "--cores") {
      arguments.cores = gsv::parseWholeNumber(argument, value(), 1, 1024);
    } else if (argument == "--repeat") {
      arguments.repeat = gsv::parseWholeNumber(argument, value(), 1, 100000);
    } else if (argument == "--image-scale") {
      arguments.image_scale = gsv::parseNumber(argument, value());
      gsv::requireInRange(argument.c_str(), arguments.image_scale, 0.1, 10);
    } else if (argument == "--floor") {
      arguments.floor = true;
    } else if (argument == "--set") {
      const std::string setting = value();
      gsv::setOption(arguments.options, setting);
      arguments.settings += (arguments.settings.empty() ? "" : " ") + setting;
    } else {
      return false;
    }
    return true;
  });
  return arguments;
}

/// This process and all its threads to come run on that many of the cores it may use now. Throws
/// OptionError when there are not so many.
void useCores(int cores) {
  cpu_set_t allowed, wanted;
  CPU_ZERO(&wanted);
  int found = 0;
  if (sched_getaffinity(0, sizeof allowed, &allowed) == 0) {
    for (std::size_t i = 0; i < CPU_SETSIZE && found < cores; ++i) {
      if (!CPU_ISSET(i, &allowed)) continue;
      CPU_SET(i, &wanted);
      ++found;
    }
  }
  if (found < cores || sched_setaffinity(0, sizeof wanted, &wanted) != 0) {
    throw gsv::OptionError("--cores is " + std::to_string(cores) + ", but this process may use " +
                           std::to_string(found));
  }
}

/// The drive: the sequence forwards and backwards in turn, with stamps that go on, at any size.
class Drive {
 public:
  explicit Drive(const Arguments& arguments)
      : sequence_(arguments.sequence), scale_(arguments.image_scale) {
    const std::size_t n = sequence_.size();
    for (std::size_t i = 0; i < n; ++i) add(i);
    for (int time = 1; time < arguments.repeat; ++time) {
      for (std::size_t k = 1; k < n; ++k) add(time % 2 == 1 ? n - 1 - k : k);
    }
    camera_ = sequence_.camera();
    const cv::Mat first = image(0);
    const double x = static_cast<double>(first.cols) / camera_.width;
    const double y = static_cast<double>(first.rows) / camera_.height;
    camera_ = {first.cols, first.rows, x * camera_.fx, y * camera_.fy,
               // (0, 0) is the centre of a pixel
               x * (camera_.cx + 0.5) - 0.5, y * (camera_.cy + 0.5) - 0.5};
  }

  const std::string& name() const { return sequence_.name(); }
  std::size_t size() const { return order_.size(); }
  const gsv::PinholeCamera& camera() const { return camera_; }
  std::int64_t stampNs(std::size_t i) const { return stamps_ns_[i]; }
  cv::Mat image(std::size_t i) const {
    cv::Mat image = sequence_.image(order_[i]);
    if (scale_ != 1) {
      cv::resize(image, image, {}, scale_, scale_, scale_ < 1 ? cv::INTER_AREA : cv::INTER_CUBIC);
    }
    return image;
  }

 private:
  void add(std::size_t i) {
    const std::int64_t step =
        order_.empty() ? sequence_.stampNs(0)
                       : std::abs(sequence_.stampNs(i) - sequence_.stampNs(order_.back()));
    stamps_ns_.push_back(order_.empty() ? step : stamps_ns_.back() + step);
    order_.push_back(i);
  }

  gsv::KittiSequence sequence_;
  double scale_;
  gsv::PinholeCamera camera_;
  std::vector<std::size_t> order_;
  std::vector<std::int64_t> stamps_ns_;
};

/// Fills and serialises what the nodelets would publish of the run's last frame. Returns the bytes.
std::size_t publish(const gsv::OfflineRun& run, const gsv::OdometryFrames& frames) {
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

std::ostringstream table(const std::string& heading) {
  std::ostringstream stream;
  stream.imbue(std::locale::classic());
  stream.precision(10);
  stream << heading << '\n';
  return stream;
}

/// The pixels of one frame that the pipeline tracked, in its image or in the one before.
using Pixels = std::vector<cv::Point2f>;

Pixels trackedPixels(const gsv::VisualOdometry::Output& vo) {
  Pixels pixels;
  for (const auto& feature : vo.frame.features) pixels.emplace_back(feature.u.x(), feature.u.y());
  for (const auto& feature : vo.rejected) pixels.emplace_back(feature.u.x(), feature.u.y());
  return pixels;
}

/// The pipeline over the drive: timing.csv and usage.csv. Returns each frame's pixels with --floor.
std::vector<Pixels> measurePipeline(const Drive& drive, const Arguments& arguments) {
  gsv::OfflineRun run(drive.camera(), arguments.options);
  gsv::RunProgress progress(drive.name(), drive.size());
  const auto frames = gsv::OdometryFrames::ofCamera("odom", "camera");
  std::vector<Pixels> pixels;
  std::ostringstream usage =
      table("frame,features,decode_cpu,frame_cpu,publish,wall_s,cpu_s,rss_mb,peak_rss_mb");
  const gsv::Stopwatch wall;
  const double cpu_begin = gsv::processUsage().cpu_s;
  gsv::ImageReader reader(
      drive.size(), [&](std::size_t i) { return drive.image(i); }, arguments.cores > 1);
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const gsv::ImageReader::Image image = reader.next();
    const double frame_cpu_begin = gsv::threadCpuMs();
    const gsv::RunFrame& frame = run.process(image.image, drive.stampNs(i), image.decode_ms);
    const double frame_cpu_ms = gsv::threadCpuMs() - frame_cpu_begin;
    const gsv::Stopwatch watch;
    if (publish(run, frames) == 0) throw std::logic_error("messages without bytes");
    const double publish_ms = watch.ms();
    const gsv::VisualOdometry::Output& vo = run.last().vo;
    if (arguments.floor) pixels.push_back(trackedPixels(vo));
    const gsv::ProcessUsage now = gsv::processUsage();
    usage << i << ',' << vo.frame.features.size() + vo.rejected.size() << ',' << image.decode_cpu_ms
          << ',' << frame_cpu_ms << ',' << publish_ms << ',' << wall.seconds() << ','
          << now.cpu_s - cpu_begin << ',' << now.rss_mb << ',' << now.peak_rss_mb << '\n';
    progress.show(frame);
  }
  std::ostringstream facts;
  facts << "{\"frames\": " << drive.size() << ", \"width\": " << drive.camera().width
        << ", \"height\": " << drive.camera().height << ", \"cores\": " << arguments.cores
        << ", \"settings\": \"" << arguments.settings << "\"}\n";
  gsv::writeFile(std::filesystem::path(arguments.out) / "run.json", facts.str());
  gsv::writeFile(std::filesystem::path(arguments.out) / "timing.csv", gsv::timingCsv(run.record()));
  gsv::writeFile(std::filesystem::path(arguments.out) / "usage.csv", usage.str());
  return pixels;
}

/// floor.csv: the least that any tracker of corners does with these images. pixels: of each frame.
void measureFloor(const Drive& drive, const Arguments& arguments,
                  const std::vector<Pixels>& pixels) {
  const gsv::FeatureTracker::Options& tracker = arguments.options.vo.tracker;
  const cv::Size window(tracker.window_px, tracker.window_px);
  const auto pyramid = [&](const cv::Mat& image) {
    std::vector<cv::Mat> levels;
    cv::buildOpticalFlowPyramid(image, levels, window, tracker.pyramid_levels);
    return levels;
  };
  std::ostringstream csv = table("frame,points,pyramid,detect,track,total,cpu");
  std::vector<cv::Mat> from = pyramid(drive.image(0));
  for (std::size_t i = 1; i < drive.size(); ++i) {
    const cv::Mat image = drive.image(i);
    const double cpu_begin = gsv::threadCpuMs();
    gsv::Stopwatch watch;
    std::vector<cv::Mat> to = pyramid(image);
    const double pyramid_ms = watch.lapMs();

    const Pixels& points = pixels[i];
    Pixels corners;
    cv::goodFeaturesToTrack(image, corners, std::max(1, static_cast<int>(points.size())), 0.01,
                            tracker.cell * image.cols / 2);
    const double detect_ms = watch.lapMs();

    Pixels found;
    std::vector<unsigned char> ok;
    std::vector<float> error;
    if (!points.empty()) {
      cv::calcOpticalFlowPyrLK(from, to, points, found, ok, error, window, tracker.pyramid_levels);
    }
    const double track_ms = watch.lapMs();
    csv << i << ',' << points.size() << ',' << pyramid_ms << ',' << detect_ms << ',' << track_ms
        << ',' << pyramid_ms + detect_ms + track_ms << ',' << gsv::threadCpuMs() - cpu_begin
        << '\n';
    from = std::move(to);
  }
  gsv::writeFile(std::filesystem::path(arguments.out) / "floor.csv", csv.str());
}

void run(const Arguments& arguments) {
  useCores(arguments.cores);
  cv::setNumThreads(1);
  gsv::makeFolder(arguments.out);  // fails now rather than after the run
  const Drive drive(arguments);
  const std::vector<Pixels> pixels = measurePipeline(drive, arguments);
  if (arguments.floor) measureFloor(drive, arguments, pixels);
}

}  // namespace

int main(int argc, char** argv) {
  return gsv::toolMain("benchmark_sequence", kUsage, argc, argv, parseArguments, run);
}
