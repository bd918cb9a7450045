#include "numbered_files.hpp"

#include <map>
#include <regex>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
namespace fs = std::filesystem;

std::vector<fs::path> numberedFiles(const fs::path& folder, const std::string& extensions) {
  // A number of 18 digits fits into the key type.
  const std::regex pattern("([0-9]{1,18})\\.(" + extensions + ")");
  std::map<unsigned long long, fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string file_name = entry.path().filename().string();
    std::smatch match;
    if (!std::regex_match(file_name, match, pattern)) continue;
    const auto [other, is_new] = files.emplace(std::stoull(match[1]), entry.path());
    if (!is_new) {
      throw DataError(entry.path().string() + " has the same number as " +
                      other->second.filename().string());
    }
  }
  if (files.empty()) {
    const std::string names =
        "NNN." + std::regex_replace(extensions, std::regex("\\|"), " or NNN.");
    throw DataError(folder.string() + " has no file " + names);
  }
  std::vector<fs::path> ordered;
  for (const auto& [number, file] : files) {
    if (number != ordered.size()) {
      throw DataError(file.string() + ": the numbering is not consecutive: " +
                      std::to_string(ordered.size()) + " is missing");
    }
    ordered.push_back(file);
  }
  return ordered;
}

}  // namespace ground_scale_vo
