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
#include "ros/diagnostics.hpp"
#include "ros/params.hpp"

namespace gsv {

/// The sentence, followed by a clause while ROS time does not run: drivers then stamp their images
/// with zero, or wait for the time.
std::string withMissingClock(const std::string& sentence);

/// What both nodelets have: a thread on which all callbacks run one after the other, a log, the
/// service ~reset, and the diagnostics once a second. The manager's queue would drop what arrives
/// during onInit, and is destroyed before the subscriptions when onInit throws.
class StageNodelet : public nodelet::Nodelet {
 protected:
  /// What the summary of the diagnostics adds to that of the last frame. Empty texts: nothing is
  /// wrong.
  struct State {
    std::string missing;                ///< an input; takes precedence over `errors`
    std::vector<std::string> errors;    ///< the first one is the summary
    std::uint64_t dropped = 0;          ///< since construction: queue full, refused, stamp
    std::vector<std::string> warnings;  ///< appended
  };
  using Diagnostics = diagnostic_updater::DiagnosticStatusWrapper;

  /// stage: what the diagnostics append to the name of the nodelet. input: the name of its messages
  /// and of several of them: "vo/frame", "frames".
  StageNodelet(std::string stage, std::string input, std::string inputs)
      : stage_(std::move(stage)), input_(std::move(input)), inputs_(std::move(inputs)) {}

  /// Subscribes and advertises with handles of the own queue; callbacks run afterwards. Throws
  /// OptionError.
  virtual void start(ros::NodeHandle& handle, ros::NodeHandle& private_handle) = 0;
  /// ~reset. Returns what happens next, for the answer of the service.
  virtual std::string reset() = 0;
  /// Sets the summary of the last frame, and adds values.
  virtual State describe(Diagnostics& status) = 0;

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
  /// A message of the input arrived; it may be refused later.
  void countInput();
  std::uint64_t received() const { return received_; }
  /// One sentence if none has come yet, or none any more; empty: they arrive.
  std::string missingInput(const std::string& topic) const;
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

  /// The tf frame of a message without leading slashes, which it warns of. subject: what names it.
  std::string tfFrame(const std::string& name, const std::string& subject);

  std::unique_ptr<WarningLog> log_;

 private:
  void onInit() final;
  void logParams(const ParamReader& reader);
  void diagnose(Diagnostics& status);
  void addToSummary(const State& state, Diagnostics& status);
  void warnOfMissingInput(const std::string& sentence);

  const std::string stage_, input_, inputs_;
  ros::CallbackQueue callbacks_;  // before all that uses it: destroyed after that
  ros::AsyncSpinner spinner_{1, &callbacks_};
  std::vector<ros::ServiceServer> services_;
  std::unique_ptr<diagnostic_updater::Updater> updater_;
  ros::WallTimer diagnostics_timer_;
  const Stopwatch since_start_{};
  Stopwatch since_diagnosis_, since_received_;
  ros::Time last_ros_time_;  ///< of the last diagnosis
  std::uint64_t received_ = 0, processed_ = 0, diagnosed_processed_ = 0, diagnosed_dropped_ = 0;
  std::optional<Stopwatch> since_processed_;
  double frame_ms_ = 0;
};

}  // namespace gsv
