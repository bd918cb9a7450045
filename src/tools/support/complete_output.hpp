#pragma once

#include <unistd.h>

#include <filesystem>
#include <string>
#include <system_error>

namespace gsv {

/// Calls write(PATH) with a temporary name beside the target, and gives what it wrote, a file or a
/// folder, the name of the target, so that this is complete or missing.
template <typename Write>
void writeCompletely(const std::filesystem::path& target, const Write& write) {
  const std::filesystem::path partial = target.string() + ".partial." + std::to_string(getpid());
  try {
    write(partial);
    std::filesystem::rename(partial, target);
  } catch (...) {
    std::error_code ignored;
    std::filesystem::remove_all(partial, ignored);
    throw;
  }
}

}  // namespace gsv
