#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace ground_scale_vo {

/// The files N.EXTENSION of a folder in the order of their numbers N, which must be 0, 1, 2 ...
/// N may have leading zeros. extensions: alternatives of a regular expression, e.g. "png|jpg".
/// Throws DataError when no file matches, when two have the same number, or when the numbering is
/// not consecutive.
std::vector<std::filesystem::path> numberedFiles(const std::filesystem::path& folder,
                                                 const std::string& extensions);

}  // namespace ground_scale_vo
