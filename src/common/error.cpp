#include "ground_scale_vo/common/error.hpp"

#include <sstream>

namespace ground_scale_vo {

void requireInRange(const char* option, double value, double min, double max) {
  if (value >= min && value <= max) return;
  std::ostringstream sentence;
  sentence << option << " is " << value << ", it must lie in [" << min << ", " << max << "]";
  throw OptionError(sentence.str());
}

}  // namespace ground_scale_vo
