#pragma once

#include <cstddef>

namespace ground_scale_vo {

/// True in a build with the address or the thread sanitizer. Such a build needs more memory, so
/// tests assert no limits on it, and more time: tests scale their timeouts by kSlower.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)  // gcc
constexpr bool kSanitized = true;
#elif defined(__has_feature)  // clang
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif
#else
constexpr bool kSanitized = false;
#endif

constexpr double kSlower = kSanitized ? 10 : 1;

/// Tests run every kEveryDrive-th drive of a catalogue: with a sanitizer a drive takes minutes, and
/// all of them run the same code.
constexpr std::size_t kEveryDrive = kSanitized ? 5 : 1;

}  // namespace ground_scale_vo
