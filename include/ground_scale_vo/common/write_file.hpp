#pragma once

#include <filesystem>
#include <string>

namespace ground_scale_vo {

/// Throws DataError unless the folder of the file, which is to be written, exists.
void requireFolderOf(const std::filesystem::path& file);

/// Writes under a temporary name beside the file and renames, so that the file is complete or
/// missing. Throws DataError.
void writeFile(const std::filesystem::path& file, const std::string& content);

}  // namespace ground_scale_vo
