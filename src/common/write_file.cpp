#include "ground_scale_vo/common/write_file.hpp"

#include <cerrno>
#include <cstdio>
#include <system_error>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {

namespace fs = std::filesystem;

void requireFolderOf(const fs::path& file) {
  const fs::path folder = file.parent_path();
  std::error_code error;
  if (folder.empty() || fs::is_directory(folder, error)) return;
  throw DataError(file.string() + ": cannot be written, there is no folder " + folder.string());
}

void writeFile(const fs::path& file, const std::string& content) {
  requireFolderOf(file);
  fs::path temporary = file;
  temporary += ".tmp";
  const auto systemError = [] { return std::error_code(errno, std::generic_category()); };
  std::error_code error;
  std::FILE* const stream = std::fopen(temporary.c_str(), "wb");
  if (stream == nullptr) error = systemError();
  if (!error) {
    if (std::fwrite(content.data(), 1, content.size(), stream) != content.size()) {
      error = systemError();
    }
    // Flushes the last bytes: a full disk may show only here.
    if (std::fclose(stream) != 0 && !error) error = systemError();
    if (!error) fs::rename(temporary, file, error);
    if (error) {
      std::error_code ignored;
      fs::remove(temporary, ignored);
    }
  }
  if (error) throw DataError(file.string() + ": cannot be written, " + error.message());
}

}  // namespace ground_scale_vo
