#pragma once

namespace gsv {

/// True in a build with the address or the thread sanitizer. Such builds need more memory and time:
/// tests skip memory limits and multiply timeouts by kTimeoutFactor.
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

constexpr double kTimeoutFactor = kSanitized ? 10 : 1;

}  // namespace gsv
