// Notes when images enter the nodelets' graph and when what they make of them comes out.

#include <nav_msgs/Odometry.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <locale>
#include <map>
#include <memory>
#include <optional>
#include <sstream>
#include <string>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/io/process_usage.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "ground_scale_vo/ros/messages.hpp"
#include "ground_scale_vo/ros_tools/node_process.hpp"
#include "tool_main.hpp"

namespace gsv = ground_scale_vo;

namespace {

constexpr const char* kUsage =
    R"(usage: graph_observer --out FILE [--manager NODE] [ROS remappings]

Listens to `image`, `vo/frame`, `scale` and `odometry` until it is interrupted (SIGINT), then writes
FILE: a line for each image, by stamp, with the wall time [s] at which it and what the nodelets made
of it were heard (nan: never). Waits for a ROS master, and says "listening" on stdout when it listens.

  --out FILE      the table: stamp, image, frame, scale, odometry, cpu_s, rss_mb, peak_rss_mb
  --manager NODE  the nodelet manager whose processor time and memory [MiB] are noted with each
                  vo/frame (default ground_scale_vo_manager); it must run on this machine

Exit status: 0 done, 1 FILE cannot be written, 2 wrong arguments.
)";

constexpr std::uint32_t kQueue = 1000;

struct Arguments {
  std::string out, manager = "ground_scale_vo_manager";
};

/// Throws OptionError.
Arguments parseArguments(int argc, char** argv) {
  ros::init(argc, argv, "graph_observer");  // takes its remappings out
  Arguments arguments;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument != "--out" && argument != "--manager") {
      throw gsv::OptionError(argument + " is not an option, see --help");
    }
    if (++i == argc) throw gsv::OptionError(argument + " needs a value");
    (argument == "--out" ? arguments.out : arguments.manager) = argv[i];
  }
  if (arguments.out.empty()) throw gsv::OptionError("--out is missing, see --help");
  return arguments;
}

class Observer {
 public:
  explicit Observer(const Arguments& arguments) : manager_(arguments.manager) {
    const auto hints = ros::TransportHints().tcpNoDelay();
    image_ = handle_.subscribe<sensor_msgs::Image>(
        "image", kQueue, [this](const auto& message) { note(message->header.stamp, &Line::image); },
        {}, hints);
    frame_ = handle_.subscribe<gsv::VoFrameMsg>(
        "vo/frame", kQueue, [this](const auto& message) { onFrame(message->header.stamp); }, {},
        hints);
    scale_ = handle_.subscribe<gsv::ScaleEstimateMsg>(
        "scale", kQueue, [this](const auto& message) { note(message->header.stamp, &Line::scale); },
        {}, hints);
    odometry_ = handle_.subscribe<nav_msgs::Odometry>(
        "odometry", kQueue,
        [this](const auto& message) { note(message->header.stamp, &Line::odometry); }, {}, hints);
  }

  std::string csv() const {
    std::ostringstream stream;
    stream.imbue(std::locale::classic());
    stream.precision(10);
    stream << "stamp,image,frame,scale,odometry,cpu_s,rss_mb,peak_rss_mb\n";
    for (const auto& [stamp, line] : lines_) {
      stream << stamp.sec << '.' << std::to_string(1000000000u + stamp.nsec).substr(1) << ','
             << line.image << ',' << line.frame << ',' << line.scale << ',' << line.odometry << ','
             << line.usage.cpu_s << ',' << line.usage.rss_mb << ',' << line.usage.peak_rss_mb
             << '\n';
    }
    return stream.str();
  }

 private:
  struct Line {
    double image = NAN, frame = NAN, scale = NAN, odometry = NAN;  // [s] since the start
    gsv::ProcessUsage usage;
  };

  Line& note(const ros::Time& stamp, double Line::*what) {
    Line& line = lines_[stamp];
    line.*what = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    return line;
  }

  void onFrame(const ros::Time& stamp) {
    Line& line = note(stamp, &Line::frame);
    if (!process_) process_ = gsv::processOf(manager_);
    if (process_) line.usage = gsv::processUsage(*process_);
  }

  const std::string manager_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  ros::NodeHandle handle_;
  std::optional<pid_t> process_;
  std::map<ros::Time, Line> lines_;
  ros::Subscriber image_, frame_, scale_, odometry_;
};

void run(const Arguments& arguments) {
  // Fails now rather than after the run, and leaves no empty table if that breaks off.
  gsv::writeFile(arguments.out, "");
  std::filesystem::remove(arguments.out);
  const auto observer = std::make_unique<Observer>(arguments);
  std::puts("listening");
  std::fflush(stdout);
  ros::spin();
  gsv::writeFile(arguments.out, observer->csv());
}

}  // namespace

int main(int argc, char** argv) {
  return gsv::toolMain("graph_observer", kUsage, argc, argv, parseArguments, run);
}
