#pragma once

#include <diagnostic_msgs/DiagnosticArray.h>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <string>

#include "topic_recorder.hpp"

namespace ground_scale_vo {

/// True if the predicate holds for a status in one of the reports.
template <typename Reports>
bool anyStatus(const Reports& reports,
               const std::function<bool(const diagnostic_msgs::DiagnosticStatus&)>& predicate) {
  return std::any_of(reports.begin(), reports.end(), [&](const auto& report) {
    return std::any_of(report->status.begin(), report->status.end(), predicate);
  });
}

/// True if a status arrives for which the predicate holds. from_now: ignore those already recorded.
inline bool waitForStatus(
    TopicRecorder<diagnostic_msgs::DiagnosticArray>& diagnostics,
    const std::function<bool(const diagnostic_msgs::DiagnosticStatus&)>& predicate,
    bool from_now = true) {
  if (from_now) diagnostics.clear();
  return diagnostics.wait([&](const auto& reports) { return anyStatus(reports, predicate); });
}

/// The value of a key as a number; 0 if the status lacks the key.
inline double numberIn(const diagnostic_msgs::DiagnosticStatus& status, const std::string& key) {
  for (const auto& entry : status.values) {
    if (entry.key == key) return std::stod(entry.value);
  }
  return 0;
}
inline int countIn(const diagnostic_msgs::DiagnosticStatus& status, const std::string& key) {
  return static_cast<int>(numberIn(status, key));
}

/// True if from now on a status with this value of the key arrives; empty: any value. of: part of
/// the status name, which contains the nodelet's; empty: of any nodelet.
inline bool waitForValue(TopicRecorder<diagnostic_msgs::DiagnosticArray>& diagnostics,
                         const std::string& key, const std::string& value = "",
                         const std::string& of = "") {
  return waitForStatus(diagnostics, [&](const auto& status) {
    return status.name.find(of) != std::string::npos &&
           std::any_of(status.values.begin(), status.values.end(), [&](const auto& entry) {
             return entry.key == key && (value.empty() || entry.value == value);
           });
  });
}

/// True if a status of nodelet `of` (part of its name) arrives with this level and a message that
/// contains the text.
inline bool waitForSummary(TopicRecorder<diagnostic_msgs::DiagnosticArray>& diagnostics,
                           const std::string& of, std::int8_t level, const std::string& text,
                           bool from_now = true) {
  return waitForStatus(
      diagnostics,
      [&](const auto& status) {
        return status.name.find(of) != std::string::npos && status.level == level &&
               status.message.find(text) != std::string::npos;
      },
      from_now);
}

}  // namespace ground_scale_vo
