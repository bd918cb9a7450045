#include "common/files.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <sstream>
#include <system_error>

#include "common/text.hpp"
#include "ground_scale_vo/common/error.hpp"

namespace gsv {
namespace fs = std::filesystem;
namespace {

/// A word for an error message: at most 30 characters, all printable.
std::string quote(const std::string& word) {
  constexpr std::size_t kMaxLength = 30;
  std::string quoted = "'";
  for (const char c : word.substr(0, kMaxLength)) quoted += c >= ' ' && c <= '~' ? c : '?';
  return quoted + (word.size() > kMaxLength ? "...'" : "'");
}

void requireFolderOf(const fs::path& file) {
  const fs::path folder = file.parent_path();
  std::error_code error;
  if (folder.empty() || fs::is_directory(folder, error)) return;
  throw DataError(file.string() + ": cannot be written, there is no folder " + folder.string());
}

}  // namespace

bool isThere(const fs::path& path) { return fs::exists(fs::symlink_status(path)); }

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

void writeFile(const fs::path& file, const std::string& content) {
  requireFolderOf(file);
  const fs::path temporary = file.string() + ".tmp";
  std::error_code error;
  errno = 0;
  std::ofstream stream(temporary, std::ios::binary);
  stream << content;
  stream.close();  // a full disk may show only here
  if (!stream) {
    error = std::error_code(errno, std::generic_category());
  } else {
    fs::rename(temporary, file, error);
  }
  if (!error) return;
  std::error_code ignored;
  fs::remove(temporary, ignored);
  throw DataError(file.string() + ": cannot be written, " + error.message());
}

void requireNewFile(const fs::path& file, bool force) {
  const fs::file_type type = fs::status(file).type();
  if (type == fs::file_type::not_found) return requireFolderOf(file);
  if (type != fs::file_type::regular) throw DataError(file.string() + " is not a regular file");
  if (!force) throw DataError(file.string() + " exists already; --force replaces it");
}

void makeFolder(const fs::path& folder) {
  std::error_code error;
  if (fs::is_directory(folder, error)) return;  // a link to one is an error to libstdc++ 10
  fs::create_directories(folder, error);
  if (error) throw DataError(folder.string() + ": cannot be created, " + error.message());
}

TextFile::TextFile(const fs::path& file) : file_(file) {
  std::istringstream stream(readFile(file, kMaxBytes));
  std::size_t last_used = 0;
  for (std::string line; std::getline(stream, line);) {
    if (lines_.empty() && line.rfind("\xef\xbb\xbf", 0) == 0) line.erase(0, 3);  // UTF-8 mark
    if (!line.empty() && line.back() == '\r') line.pop_back();
    lines_.push_back(line);
    if (line.find_first_not_of(" \t") != std::string::npos) last_used = lines_.size();
  }
  lines_.resize(last_used);
  if (lines_.empty()) throw DataError(file.string() + ": is empty");
}

std::vector<std::string> TextFile::words(std::size_t i) const {
  std::istringstream stream(line(i));
  return {std::istream_iterator<std::string>(stream), {}};
}

std::vector<double> TextFile::numbers(std::size_t i, std::size_t count, std::size_t first) const {
  const std::vector<std::string> words = this->words(i);
  std::vector<double> values;
  for (std::size_t k = first; k < std::min(words.size(), first + count); ++k) {
    const auto value = parseNumber<double>(words[k]);
    if (!value) fail(i, quote(words[k]) + " is not a finite number");
    values.push_back(*value);
  }
  const std::size_t found = words.size() - std::min(words.size(), first);
  if (found != count) {
    fail(i, "has " + std::to_string(found) + " numbers instead of " + std::to_string(count));
  }
  return values;
}

std::size_t TextFile::find(const std::string& key) const {
  const auto begins = [&](const std::string& line) {
    std::string word;
    std::istringstream(line) >> word;
    return word == key;
  };
  const auto found = std::find_if(lines_.begin(), lines_.end(), begins);
  return static_cast<std::size_t>(found - lines_.begin());
}

std::size_t TextFile::lineOf(const std::string& key) const {
  const std::size_t i = find(key);
  if (i == size()) throw DataError(file_.string() + ": has no line that begins with " + key);
  return i;
}

void TextFile::fail(std::size_t i, const std::string& what) const {
  throw DataError(file_.string() + ", line " + std::to_string(i + 1) + ": " + what);
}

}  // namespace gsv
