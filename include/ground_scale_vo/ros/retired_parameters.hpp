#pragma once

#include <vector>

#include "ground_scale_vo/ros/param_reader.hpp"

namespace ground_scale_vo {

/// A ROS parameter of an earlier version under a name that no option has any more.
struct RetiredParameter {
  enum class Now {
    kRenamed,  ///< a ROS parameter of another name: refused, so that a value is not lost silently
    kOffline,  ///< an option of the offline tools only, under another name: warned about
    kRemoved   ///< does not exist any more: warned about
  };
  const char* name;
  Now now;
  const char* replacement;  ///< the name today; empty for kRemoved
};

/// Of both nodelets.
const std::vector<RetiredParameter>& retiredParameters();

/// Throws OptionError if a renamed parameter is set; makes the reader warn about the others.
void noteRetiredParameters(ParamReader& reader);

}  // namespace ground_scale_vo
