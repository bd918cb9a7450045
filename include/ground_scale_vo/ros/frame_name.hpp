#pragma once

#include <cstddef>
#include <functional>
#include <string>

namespace ground_scale_vo {

/// The name of a tf frame without leading slashes, which tf2 rejects, unlike tf.
inline std::string withoutLeadingSlashes(const std::string& given) {
  const std::size_t first = given.find_first_not_of('/');
  return first == std::string::npos ? std::string() : given.substr(first);
}

/// The same, with a warning. subject: what names the frame, for the sentence that `warn` gets if
/// there is a slash.
inline std::string frameName(const std::string& given, const std::string& subject,
                             const std::function<void(const std::string& sentence)>& warn) {
  std::string name = withoutLeadingSlashes(given);
  if (name != given) {
    warn(subject + " is \"" + given + "\"; tf2 has no leading slash, \"" + name + "\" is used");
  }
  return name;
}

}  // namespace ground_scale_vo
