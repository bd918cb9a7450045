#pragma once

#include <stdexcept>

namespace ground_scale_vo {

/// A message that cannot be used. what() is one sentence with the reason.
class MessageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace ground_scale_vo
