#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace ground_scale_vo {

/// The files of a folder that are named by a number, such as 000012.png, in the order of their
/// numbers. These must be 0, 1, 2 ... without a gap; leading zeros are optional. Other files are
/// ignored. extensions: the accepted file extensions, separated by '|', such as "png|jpg". Throws
/// DataError when there is no such file, when two have the same number, or when a number is
/// missing.
std::vector<std::filesystem::path> numberedFiles(const std::filesystem::path& folder,
                                                 const std::string& extensions);

}  // namespace ground_scale_vo
