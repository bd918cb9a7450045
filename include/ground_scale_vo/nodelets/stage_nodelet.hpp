#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <nodelet/nodelet.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <ros/spinner.h>
#include <std_srvs/Trigger.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/time.hpp"
#include "ground_scale_vo/ros/diagnostics.hpp"
#include "ground_scale_vo/ros/params.hpp"

namespace ground_scale_vo {

/// What both nodelets have: a thread for their callbacks, a log, the service ~reset, and the
/// diagnostics once a second.
///
/// All callbacks run one after the other on the nodelet's own thread. The nodelet manager's queue
/// is not used for three reasons: it drops what arrives during onInit (such as a latched
/// camera_info), it is destroyed before the subscriptions when onInit throws, and it shares its
/// threads with the other nodelets.
class StageNodelet : public nodelet::Nodelet {
 protected:
  /// Subscribes and advertises with handles of the own queue; callbacks run afterwards. Throws
  /// OptionError.
  virtual void start(ros::NodeHandle& handle, ros::NodeHandle& private_handle) = 0;
  /// ~reset. Returns what happens next, for the answer of the service.
  virtual std::string reset() = 0;
  /// What the diagnostics append to the name of the nodelet: "odometry" or "scale".
  virtual std::string stage() const = 0;
  /// All but what this class knows. dropped: since construction.
  virtual void describe(StageState* state) = 0;
  /// Further values of the diagnostics.
  virtual void addValues(diagnostic_updater::DiagnosticStatusWrapper& status) = 0;

  /// Reads the parameters, logs those in effect and warns about unknown ones. Throws OptionError.
  template <typename Params>
  Params loadParams(const ros::NodeHandle& private_handle) {
    XmlRpc::XmlRpcValue tree;
    ros::param::get(private_handle.getNamespace(), tree);
    ParamReader reader(private_handle.getNamespace(), tree);
    Params params = Params::read(reader);
    logParams(reader);
    return params;
  }
  /// A frame was processed, in the time of the watch.
  void countFrame(const Stopwatch& watch);
  std::uint64_t processed() const { return processed_; }

  /// A service of type Trigger. serve: returns the answer; a DataError is a refusal with its
  /// reason.
  void advertise(ros::NodeHandle& private_handle, const std::string& name,
                 std::function<std::string()> serve);

  /// Runs the task on the nodelet's thread, after all callbacks that wait now.
  void post(std::function<void()> task);
  /// Waits for the callback in progress; no callback runs afterwards. The destructor of a derived
  /// class must call it: its members are destroyed before this class.
  void stopCallbacks() { spinner_.stop(); }

  std::unique_ptr<WarningLog> log_;

 private:
  void onInit() final;
  void logParams(const ParamReader& reader);
  void diagnose(diagnostic_updater::DiagnosticStatusWrapper& status);
  void warnOfMissingInput(const MissingInput& missing, bool clock_runs);

  ros::CallbackQueue callbacks_;  // first: destroyed after all that uses it
  ros::AsyncSpinner spinner_{1, &callbacks_};
  std::vector<ros::ServiceServer> services_;
  std::unique_ptr<diagnostic_updater::Updater> updater_;
  ros::WallTimer diagnostics_timer_;
  const Stopwatch since_start_{};
  Stopwatch since_diagnosis_;
  ros::Time last_ros_time_;  ///< of the last diagnosis
  std::uint64_t processed_ = 0, diagnosed_processed_ = 0, diagnosed_dropped_ = 0;
  std::optional<Stopwatch> since_processed_;
  double frame_ms_ = 0;
};

}  // namespace ground_scale_vo
