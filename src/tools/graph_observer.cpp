// Records when images, and the results that the nodelets publish for them, arrive at this program.

#include <nav_msgs/Odometry.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <sstream>
#include <string>

#include "common/files.hpp"
#include "common/time.hpp"
#include "ground_scale_vo/io/process_usage.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "ground_scale_vo/ros/conversions.hpp"
#include "ground_scale_vo/ros_tools/node_process.hpp"
#include "support/command_line.hpp"

namespace {

constexpr std::uint32_t kQueue = 1000;  // [messages]

constexpr const char* kManager = "ground_scale_vo_manager";  // of the launch files

class Observer {
 public:
  Observer() {
    const auto hints = ros::TransportHints().tcpNoDelay();
    image_ = handle_.subscribe<sensor_msgs::Image>(
        "image", kQueue,
        [this](const auto& message) { recordArrival(message->header.stamp, &Line::image); }, {},
        hints);
    frame_ = handle_.subscribe<gsv::VoFrameMsg>(
        "vo/frame", kQueue, [this](const auto& message) { onFrame(message->header.stamp); }, {},
        hints);
    odometry_ = handle_.subscribe<nav_msgs::Odometry>(
        "odometry", kQueue,
        [this](const auto& message) { recordArrival(message->header.stamp, &Line::odometry); }, {},
        hints);
  }

  std::string csv() const {
    std::ostringstream stream = gsv::csvStream("stamp,image,frame,odometry,cpu_s,peak_rss_mb");
    for (const auto& [stamp, line] : lines_) {
      stream << gsv::formatSeconds(gsv::toNanoseconds(stamp)) << ',' << line.image << ','
             << line.frame << ',' << line.odometry << ',' << line.usage.cpu_s << ','
             << line.usage.peak_rss_mb << '\n';
    }
    return stream.str();
  }

 private:
  struct Line {
    // Arrival times since the start of this program [s]; NaN: not arrived.
    double image = NAN, frame = NAN, odometry = NAN;
    gsv::ProcessUsage usage;  // of the manager when vo/frame arrived
  };

  Line& recordArrival(const ros::Time& stamp, double Line::*time) {
    Line& line = lines_[stamp];
    line.*time = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    return line;
  }

  void onFrame(const ros::Time& stamp) {
    Line& line = recordArrival(stamp, &Line::frame);
    if (!process_) process_ = gsv::processOf(kManager);
    if (process_) line.usage = gsv::processUsage(*process_);
  }

  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  ros::NodeHandle handle_;
  std::optional<pid_t> process_;  // of the manager
  std::map<ros::Time, Line> lines_;
  ros::Subscriber image_, frame_, odometry_;
};

int run(const std::string& file) {
  // Fails before the run when FILE cannot be written, and leaves no empty table behind.
  gsv::writeFile(file, "");
  std::filesystem::remove(file);
  const auto observer = std::make_unique<Observer>();
  std::puts("listening");
  std::fflush(stdout);
  ros::spin();
  gsv::writeFile(file, observer->csv());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "graph_observer");  // removes the remappings from the arguments
  std::string file;
  gsv::CommandLine command_line(
      "graph_observer",
      "Subscribes to `image`, `vo/frame` and `odometry` until it is interrupted (SIGINT), then\n"
      "writes FILE: a line per stamp, with the wall time [s] since the start of this "
      "program at\n"
      "which it and the messages computed from it arrived (nan: never). Takes ROS remappings. "
      "Waits "
      "for\n"
      "a ROS master, and prints \"listening\" to stdout when it has subscribed.",
      "Exit status: 0 done, 1 FILE cannot be written, 2 the arguments cannot be used.");
  command_line.options().add_options()  //
      ("out", gsv::requiredValue(&file, "FILE"),
       "the table: stamp, image, frame, odometry, and cpu_s, peak_rss_mb of "
       "ground_scale_vo_manager on this machine when vo/frame arrived");
  return command_line.run(
      argc, argv, [] {}, [&] { return run(file); });
}
