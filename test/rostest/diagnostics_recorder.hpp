#pragma once

#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <map>
#include <string>

#include "topic_recorder.hpp"

namespace ground_scale_vo {

using Status = diagnostic_msgs::DiagnosticStatus;

/// The value of a key; empty if the status lacks it.
inline std::string valueIn(const Status& status, const std::string& key) {
  for (const auto& entry : status.values) {
    if (entry.key == key) return entry.value;
  }
  return {};
}
/// The same as a number; 0 if the status lacks it.
inline double numberIn(const Status& status, const std::string& key) {
  const std::string value = valueIn(status, key);
  return value.empty() ? 0 : std::stod(value);
}

/// Records the diagnostics of all nodelets. A nodelet is given without a leading slash.
class DiagnosticsRecorder : public TopicRecorder<diagnostic_msgs::DiagnosticArray> {
 public:
  explicit DiagnosticsRecorder(ros::NodeHandle& handle) : TopicRecorder(handle, "/diagnostics") {}

  /// True if a status of the nodelet arrives for which the predicate holds; otherwise it has the
  /// last status. from_now: not one that is recorded already.
  testing::AssertionResult waitForStatus(const std::string& nodelet,
                                         const std::function<bool(const Status&)>& predicate,
                                         bool from_now = true) {
    if (from_now) clear();
    Status last;
    const bool found = wait([&](const auto& reports) {
      for (const auto& report : reports) {
        for (const Status& status : report->status) {
          if (status.name.rfind(nodelet + ":", 0) != 0) continue;
          last = status;
          if (predicate(status)) return true;
        }
      }
      return false;
    });
    if (found) return testing::AssertionSuccess();
    testing::AssertionResult result = testing::AssertionFailure();
    result << "last status of " << nodelet << ": " << int(last.level) << " " << last.message;
    for (const auto& entry : last.values) result << "\n  " << entry.key << ": " << entry.value;
    return result;
  }
  /// A status with this level and a message that contains the text.
  testing::AssertionResult waitForSummary(const std::string& nodelet, std::int8_t level,
                                          const std::string& text, bool from_now = true) {
    return waitForStatus(
        nodelet,
        [&](const Status& status) {
          return status.level == level && status.message.find(text) != std::string::npos;
        },
        from_now);
  }
  /// A status with all of these values.
  testing::AssertionResult waitForValues(const std::string& nodelet,
                                         const std::map<std::string, std::string>& values) {
    return waitForStatus(nodelet, [&](const Status& status) {
      return std::all_of(values.begin(), values.end(), [&](const auto& value) {
        return valueIn(status, value.first) == value.second;
      });
    });
  }
  /// The next status of the nodelet.
  Status next(const std::string& nodelet) {
    Status next;
    EXPECT_TRUE(waitForStatus(nodelet, [&](const Status& status) {
      next = status;
      return true;
    }));
    return next;
  }
};

}  // namespace ground_scale_vo
