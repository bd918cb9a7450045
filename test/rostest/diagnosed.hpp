#pragma once

#include <diagnostic_msgs/DiagnosticArray.h>

#include <cstdint>
#include <string>

#include "inbox.hpp"

namespace ground_scale_vo {

/// True when the diagnostics come to tell this value, from now on; empty: any. of: part of the
/// name of the nodelet that shall tell it.
inline bool diagnosed(Inbox<diagnostic_msgs::DiagnosticArray>& diagnostics, const std::string& key,
                      const std::string& value = "", const std::string& of = "") {
  diagnostics.clear();
  return diagnostics.wait([&](const auto& reports) {
    for (const auto& report : reports) {
      for (const auto& status : report->status) {
        if (status.name.find(of) == std::string::npos) continue;
        for (const auto& entry : status.values) {
          if (entry.key == key && (value.empty() || entry.value == value)) return true;
        }
      }
    }
    return false;
  });
}

/// The same of the one line that is shown: with this level, the text is a part of it. Unless
/// from_now, one that has come since the inbox was last cleared counts too.
inline bool diagnosedAs(Inbox<diagnostic_msgs::DiagnosticArray>& diagnostics, const std::string& of,
                        std::int8_t level, const std::string& text, bool from_now = true) {
  if (from_now) diagnostics.clear();
  return diagnostics.wait([&](const auto& reports) {
    for (const auto& report : reports) {
      for (const auto& status : report->status) {
        if (status.name.find(of) != std::string::npos && status.level == level &&
            status.message.find(text) != std::string::npos) {
          return true;
        }
      }
    }
    return false;
  });
}

}  // namespace ground_scale_vo
