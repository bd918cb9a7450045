#pragma once

#include <diagnostic_msgs/DiagnosticArray.h>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <string>

#include "inbox.hpp"

namespace ground_scale_vo {

/// True when from now on a status comes in the diagnostics of which the predicate is true. Unless
/// from_now, one that has come since the inbox was last cleared counts too.
inline bool waitForStatus(
    Inbox<diagnostic_msgs::DiagnosticArray>& diagnostics,
    const std::function<bool(const diagnostic_msgs::DiagnosticStatus&)>& predicate,
    bool from_now = true) {
  if (from_now) diagnostics.clear();
  return diagnostics.wait([&](const auto& reports) {
    return std::any_of(reports.begin(), reports.end(), [&](const auto& report) {
      return std::any_of(report->status.begin(), report->status.end(), predicate);
    });
  });
}

/// 0 when the status does not tell.
inline int countIn(const diagnostic_msgs::DiagnosticStatus& status, const std::string& key) {
  for (const auto& entry : status.values) {
    if (entry.key == key) return std::stoi(entry.value);
  }
  return 0;
}

/// True when the diagnostics come to tell this value, from now on; empty: any. of: part of the
/// name of the nodelet that shall tell it.
inline bool diagnosed(Inbox<diagnostic_msgs::DiagnosticArray>& diagnostics, const std::string& key,
                      const std::string& value = "", const std::string& of = "") {
  return waitForStatus(diagnostics, [&](const auto& status) {
    return status.name.find(of) != std::string::npos &&
           std::any_of(status.values.begin(), status.values.end(), [&](const auto& entry) {
             return entry.key == key && (value.empty() || entry.value == value);
           });
  });
}

/// The same of the one line that is shown: with this level, the text is a part of it.
inline bool diagnosedAs(Inbox<diagnostic_msgs::DiagnosticArray>& diagnostics, const std::string& of,
                        std::int8_t level, const std::string& text, bool from_now = true) {
  return waitForStatus(
      diagnostics,
      [&](const auto& status) {
        return status.name.find(of) != std::string::npos && status.level == level &&
               status.message.find(text) != std::string::npos;
      },
      from_now);
}

}  // namespace ground_scale_vo
