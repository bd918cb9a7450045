#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

namespace ground_scale_vo {

/// Returns the bytes of a file. Throws DataError: no such file, not a file, not readable, more than
/// max_bytes.
std::string readFile(const std::filesystem::path& file, std::size_t max_bytes);

}  // namespace ground_scale_vo
