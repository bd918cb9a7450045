// Measures the cost of the offline pipeline over one KITTI folder: times, processor time, memory.

#include <nav_msgs/Odometry.h>
#include <ros/serialization.h>
#include <sched.h>
#include <tf2_msgs/TFMessage.h>

#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/stopwatch.hpp"
#include "ground_scale_vo/common/text_file.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"
#include "ground_scale_vo/evaluation/opencv_baseline.hpp"
#include "ground_scale_vo/evaluation/repeated_drive.hpp"
#include "ground_scale_vo/evaluation/run_progress.hpp"
#include "ground_scale_vo/evaluation/run_report.hpp"
#include "ground_scale_vo/io/csv_stream.hpp"
#include "ground_scale_vo/io/image_reader.hpp"
#include "ground_scale_vo/io/process_usage.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros/odometry_output.hpp"
#include "support/command_line.hpp"
#include "support/sequence_arguments.hpp"

namespace gsv = ground_scale_vo;
namespace fs = std::filesystem;

namespace {

constexpr const char* kDetails =
    R"(Files in DIR:
  run.json      frames, width, height [px], cores that the process may use, and the settings of --set
                as one text
  timing.csv    as of run_sequence: milliseconds of every stage and frame
  usage.csv     a line per frame: features: number tracked from the previous image; decode_cpu,
                frame_cpu: processor time of decoding, and of odometry and scale stage without the
                mapping thread [ms]; publish: wall time of filling and serialising the messages that
                the nodelets would publish [ms]; wall_s, cpu_s: wall time and processor time of all
                threads since the start of the run [s]; rss_mb, peak_rss_mb: memory [MiB]
  baseline.csv  with --baseline, a line per frame from the second on: wall time of each step and of
                all, and cpu, processor time of all, in milliseconds

Exit status: 0 done, 1 the data cannot be used, 2 the arguments cannot be used.)";

struct Arguments : gsv::SequenceArguments {
  int cores = 1, repeat = 1;
  bool baseline = false;
  double image_scale = 1;
};

/// Restricts this process and its future threads to the first `cores` of the cores that it may use.
/// Throws OptionError when these are fewer.
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

/// Number of cores that this process may use.
int usableCores() {
  cpu_set_t allowed;
  return sched_getaffinity(0, sizeof allowed, &allowed) == 0 ? CPU_COUNT(&allowed) : 0;
}

/// Fills and serialises the messages that the nodelets would publish for the last frame of the run.
/// Returns their size [bytes].
std::size_t serialiseMessages(const gsv::OfflineRun& run, const gsv::OdometryFrames& frames) {
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

/// Content of run.json.
std::string runJson(const gsv::RepeatedDrive& drive, const Arguments& arguments) {
  std::string settings;
  for (const std::string& setting : arguments.settings) {
    settings += (settings.empty() ? "" : " ") + setting;
  }
  const nlohmann::ordered_json json{{"frames", drive.size()},
                                    {"width", drive.camera().width},
                                    {"height", drive.camera().height},
                                    {"cores", usableCores()},
                                    {"settings", settings}};
  return json.dump() + "\n";
}

/// Runs the pipeline over the drive and writes run.json, timing.csv and usage.csv. Returns each
/// frame's pixels with --baseline.
std::vector<Pixels> measurePipeline(const gsv::RepeatedDrive& drive, const Arguments& arguments) {
  gsv::OfflineRun run(drive.camera(), arguments.options);
  gsv::RunProgress progress(drive.name(), drive.size());
  const auto frames = gsv::OdometryFrames::ofCamera("odom", "camera");
  std::vector<Pixels> pixels;
  std::ostringstream usage =
      gsv::csvStream("frame,features,decode_cpu,frame_cpu,publish,wall_s,cpu_s,rss_mb,peak_rss_mb");
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
    if (serialiseMessages(run, frames) == 0) throw std::logic_error("messages without bytes");
    const double publish_ms = watch.ms();
    const gsv::VisualOdometry::Output& vo = run.last().vo;
    if (arguments.baseline) pixels.push_back(trackedPixels(vo));
    const gsv::ProcessUsage now = gsv::processUsage();
    usage << i << ',' << vo.frame.features.size() + vo.rejected.size() << ',' << image.decode_cpu_ms
          << ',' << frame_cpu_ms << ',' << publish_ms << ',' << wall.seconds() << ','
          << now.cpu_s - cpu_begin << ',' << now.rss_mb << ',' << now.peak_rss_mb << '\n';
    progress.show(frame);
  }
  const fs::path out = arguments.out;
  gsv::writeFile(out / "run.json", runJson(drive, arguments));
  gsv::writeFile(out / "timing.csv", gsv::timingCsv(run.record()));
  gsv::writeFile(out / "usage.csv", usage.str());
  return pixels;
}

void run(const Arguments& arguments) {
  useCores(arguments.cores);
  cv::setNumThreads(1);
  gsv::makeFolder(arguments.out);  // fails before the run, not after it
  const gsv::RepeatedDrive drive(arguments.sequence, arguments.repeat, arguments.image_scale);
  const std::vector<Pixels> pixels = measurePipeline(drive, arguments);
  if (!arguments.baseline) return;
  gsv::writeFile(fs::path(arguments.out) / "baseline.csv",
                 gsv::measureOpencvBaseline(
                     pixels, [&](std::size_t i) { return drive.image(i); },
                     arguments.options.odometry.vo.tracker));
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
      ("cores", gsv::numberInRange("--cores", &arguments.cores, "N", 1, 1024),
       "processor cores that the process may use; with 1 each image is decoded before it is "
       "processed, with more while the previous one is processed")  //
      ("baseline", gsv::po::bool_switch(&arguments.baseline),
       "afterwards, over the same images: OpenCV's pyramid, corner detection and Lucas-Kanade "
       "alone, "
       "each frame with as many points as the pipeline tracked")  //
      ("repeat", gsv::numberInRange("--repeat", &arguments.repeat, "N", 1, 100000),
       "drive the sequence N times, forwards and backwards in turn")  //
      ("image-scale", gsv::numberInRange("--image-scale", &arguments.image_scale, "S", 0.1, 10),
       "factor on the size of images and camera");
  return command_line.run(
      argc, argv, [&] { arguments.check(); },
      [&] {
        run(arguments);
        return 0;
      });
}
