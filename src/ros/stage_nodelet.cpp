#include "ros/stage_nodelet.hpp"

#include <boost/make_shared.hpp>
#include <exception>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/ros/conversions.hpp"

namespace ground_scale_vo {
namespace {

constexpr double kDiagnosticsPeriod = 1.0;  // [s] wall time
constexpr double kStartup = 5.0;            // [s] a driver may start after the nodelets
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
  std::string echo;
  for (const ParamReader::Entry& entry : reader.entries()) {
    echo += "\n  " + ParamReader::echo(entry);
  }
  NODELET_INFO_STREAM(getName() << ": parameters" << echo);
  for (const std::string& sentence : reader.warnings()) {
    NODELET_WARN_STREAM(getName() << ": " << sentence);
  }
}

std::string StageNodelet::tfFrame(const std::string& name, const std::string& subject) {
  const std::string warning = leadingSlashWarning(name, subject);
  if (!warning.empty()) log_->warn("frame_id", warning);
  return withoutLeadingSlashes(name);
}

void StageNodelet::countFrame(const Stopwatch& watch) {
  ++processed_;
  since_processed_.emplace();
  frame_ms_ = watch.ms();
}

void StageNodelet::diagnose(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const auto frames =
      static_cast<double>(processed_ - std::exchange(diagnosed_processed_, processed_));
  status.add("rate [Hz]", 1e3 * frames / since_diagnosis_.lapMs());
  status.add("time of the last frame [ms]", frame_ms_);
  StageState state;
  describe(&state, status);
  for (const auto& [kind, count] : log_->dropped()) status.add("dropped: " + kind, count);

  if (since_processed_) state.since_processed_s = since_processed_->seconds();
  state.dropped -= std::exchange(diagnosed_dropped_, state.dropped);
  if (state.missing.empty()) {
    state.warnings.insert(state.warnings.begin(), missingClock());
  } else {
    state.missing = withMissingClock(state.missing);
  }
  warnOfMissingInput(state.missing);
  const DiagnosticStatus summary = summarize(state);
  status.summary(static_cast<std::uint8_t>(summary.level), summary.message);
}

/// While ROS time stands still, because a bag is paused or has ended, nothing is expected.
void StageNodelet::warnOfMissingInput(const std::string& sentence) {
  const ros::Time now = ros::Time::now();
  const bool is_paused = now == std::exchange(last_ros_time_, now) && !now.isZero();
  if (sentence.empty() || is_paused || since_start_.seconds() < kStartup) return;
  // The name of the input without the duration and the topic.
  log_->warn(sentence.substr(0, sentence.find(' ', 3)), sentence, kMissingInputPeriod);
}

}  // namespace ground_scale_vo
