#include "ros/stage_nodelet.hpp"

#include <algorithm>
#include <boost/make_shared.hpp>
#include <exception>
#include <utility>

#include "common/text.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/ros/conversions.hpp"

namespace gsv {
namespace {

constexpr double kDiagnosticsPeriod = 1.0;  // [s] wall time
constexpr double kStartup = 5.0;            // [s] a driver may start after the nodelets
constexpr double kSilence = 5.0;  // [s] as rqt_runtime_monitor before it marks a node stale
constexpr std::chrono::seconds kMissingInputPeriod(30);  // of the warnings in the log

class Task : public ros::CallbackInterface {
 public:
  explicit Task(std::function<void()> task) : task_(std::move(task)) {}
  CallResult call() override {
    task_();
    return Success;
  }

 private:
  const std::function<void()> task_;
};

}  // namespace

std::string withMissingClock(const std::string& sentence) {
  if (!ros::Time::isSimTime() || !ros::Time::now().isZero()) return sentence;
  return sentence + (sentence.empty() ? "" : "; ") +
         "/use_sim_time is true, but no time was received on /clock: publish it, or for a live "
         "camera set /use_sim_time to false and restart all nodes";
}

void StageNodelet::post(std::function<void()> task) {
  callbacks_.addCallback(boost::make_shared<Task>(std::move(task)));
}

void StageNodelet::onInit() {
  ros::NodeHandle handle = getNodeHandle(), private_handle = getPrivateNodeHandle();
  handle.setCallbackQueue(&callbacks_);
  private_handle.setCallbackQueue(&callbacks_);
  log_ = std::make_unique<WarningLog>(getName());
  try {
    start(handle, private_handle);
  } catch (const std::exception& error) {  // passed on: the nodelet manager refuses the nodelet
    NODELET_FATAL_STREAM(getName() << " does not start: " << error.what());
    throw;
  }
  advertise(private_handle, "reset", [this] { return "reset: " + reset(); });
  updater_ = std::make_unique<diagnostic_updater::Updater>(handle, private_handle, getName());
  updater_->setHardwareID("none");
  updater_->add(stage_, this, &StageNodelet::diagnose);
  diagnostics_timer_ =
      handle.createWallTimer(ros::WallDuration(kDiagnosticsPeriod),
                             [this](const ros::WallTimerEvent&) { updater_->force_update(); });
  spinner_.start();
}

void StageNodelet::advertise(ros::NodeHandle& private_handle, const std::string& name,
                             std::function<std::string()> serve) {
  using Trigger = std_srvs::Trigger;
  services_.push_back(private_handle.advertiseService<Trigger::Request, Trigger::Response>(
      name, [serve = std::move(serve)](Trigger::Request&, Trigger::Response& response) {
        try {
          response.message = serve();
          response.success = true;
        } catch (const DataError& refusal) {
          response.message = refusal.what();
        }
        return true;
      }));
}

void StageNodelet::logParams(const ParamReader& reader) {
  NODELET_INFO_STREAM(getName() << ": parameters" << reader.echo());
  for (const std::string& sentence : reader.warnings()) {
    NODELET_WARN_STREAM(getName() << ": " << sentence);
  }
}

std::string StageNodelet::tfFrame(const std::string& name, const std::string& subject) {
  const std::string warning = leadingSlashWarning(name, subject);
  if (!warning.empty()) log_->warn("frame_id", warning);
  return withoutLeadingSlashes(name);
}

void StageNodelet::countInput() {
  ++received_;
  since_received_ = Stopwatch();
}

std::string StageNodelet::missingInput(const std::string& topic) const {
  if (received_ == 0) return "no " + input_ + " received yet on " + topic;
  if (since_received_.seconds() < kSilence) return {};
  return "no " + input_ + format(" for %.0f s on ", since_received_.seconds()) + topic;
}

void StageNodelet::countFrame(const Stopwatch& watch) {
  ++processed_;
  since_processed_.emplace();
  frame_ms_ = watch.ms();
}

void StageNodelet::diagnose(Diagnostics& status) {
  const auto frames =
      static_cast<double>(processed_ - std::exchange(diagnosed_processed_, processed_));
  status.add("rate [Hz]", 1e3 * frames / since_diagnosis_.lapMs());
  status.add("time of the last frame [ms]", frame_ms_);
  State state = describe(status);
  for (const auto& [kind, count] : log_->dropped()) status.add("dropped: " + kind, count);
  if (!state.missing.empty()) state.missing = withMissingClock(state.missing);
  warnOfMissingInput(state.missing);
  addToSummary(state, status);
}

void StageNodelet::addToSummary(const State& state, Diagnostics& status) {
  const std::uint64_t dropped = state.dropped - std::exchange(diagnosed_dropped_, state.dropped);
  std::vector<std::string> errors = {state.missing};
  errors.insert(errors.end(), state.errors.begin(), state.errors.end());
  for (const std::string& error : errors) {
    if (!error.empty()) return status.summary(DiagnosticStatus::ERROR, error);
  }
  std::vector<std::string> warnings = {withMissingClock("")};
  if (dropped > 0) {
    if (!since_processed_ || since_processed_->seconds() >= kSilence) {
      std::string error = "no usable " + input_;
      if (since_processed_) error += format(" for %.0f s", since_processed_->seconds());
      status.summary(DiagnosticStatus::ERROR, error);
    }
    warnings.push_back(std::to_string(dropped) + " " + inputs_ + " dropped in the last second");
  }
  warnings.insert(warnings.end(), state.warnings.begin(), state.warnings.end());
  for (const std::string& warning : warnings) {
    if (warning.empty()) continue;
    status.level = std::max<std::int8_t>(status.level, DiagnosticStatus::WARN);
    status.message += "; " + warning;
  }
}

/// While ROS time stands still, because a bag is paused or has ended, nothing is expected.
void StageNodelet::warnOfMissingInput(const std::string& sentence) {
  const ros::Time now = ros::Time::now();
  const bool is_paused = now == std::exchange(last_ros_time_, now) && !now.isZero();
  if (sentence.empty() || is_paused || since_start_.seconds() < kStartup) return;
  // The name of the input without the duration and the topic.
  log_->warn(sentence.substr(0, sentence.find(' ', 3)), sentence, kMissingInputPeriod);
}

}  // namespace gsv
