#pragma once

#include <cstddef>

namespace ground_scale_vo {

/// True in a build with the address or the thread sanitizer. There no bound on memory is asserted,
/// for what is freed waits in quarantine and every access has a shadow; and a test may wait kSlower
/// times as long.
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

/// Of the catalogues of drives that measure accuracy every so manieth runs: a drive takes minutes
/// then, and all run the same code.
constexpr std::size_t kEveryDrive = kSanitized ? 5 : 1;

}  // namespace ground_scale_vo
