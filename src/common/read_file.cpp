#include "ground_scale_vo/common/read_file.hpp"

#include <fstream>
#include <system_error>

#include "ground_scale_vo/common/error.hpp"

namespace ground_scale_vo {
namespace fs = std::filesystem;

std::string readFile(const fs::path& file, std::size_t max_bytes) {
  std::error_code error;
  if (!fs::exists(file, error)) {
    const bool is_link = fs::is_symlink(fs::symlink_status(file, error));
    throw DataError(file.string() + (is_link ? ": is a link to nothing" : ": no such file"));
  }
  if (!fs::is_regular_file(file, error)) throw DataError(file.string() + ": not a file");
  const auto bytes = fs::file_size(file, error);
  if (error) throw DataError(file.string() + ": " + error.message());
  if (bytes > max_bytes) {
    throw DataError(file.string() + ": has " + std::to_string(bytes) + " bytes, more than the " +
                    std::to_string(max_bytes) + " that are plausible");
  }
  std::ifstream stream(file, std::ios::binary);
  std::string content(static_cast<std::size_t>(bytes), '\0');
  if (!stream.read(content.data(), static_cast<std::streamsize>(bytes))) {
    throw DataError(file.string() + ": cannot be read");
  }
  return content;
}

}  // namespace ground_scale_vo
