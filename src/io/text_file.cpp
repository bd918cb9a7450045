#include "ground_scale_vo/io/text_file.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <system_error>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/parse_number.hpp"

namespace ground_scale_vo {
namespace fs = std::filesystem;
namespace {

/// A word for an error message: at most 30 characters, all printable.
std::string quote(const std::string& word) {
  constexpr std::size_t kMaxLength = 30;
  std::string quoted = "'";
  for (const char c : word.substr(0, kMaxLength)) quoted += c >= ' ' && c <= '~' ? c : '?';
  return quoted + (word.size() > kMaxLength ? "...'" : "'");
}

/// Calls take(word) for each blank-separated word until it returns false.
template <typename Take>
void forEachWord(const std::string& line, const Take& take) {
  std::size_t end = 0;
  for (std::size_t begin = line.find_first_not_of(TextFile::kBlanks); begin != std::string::npos;
       begin = line.find_first_not_of(TextFile::kBlanks, end)) {
    end = std::min(line.find_first_of(TextFile::kBlanks, begin), line.size());
    if (!take(line.substr(begin, end - begin))) return;
  }
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

void requireNewFile(const fs::path& file, bool force) {
  const fs::file_type type = fs::status(file).type();
  if (type == fs::file_type::not_found) return requireFolderOf(file);
  if (type != fs::file_type::regular) throw DataError(file.string() + " is not a regular file");
  if (!force) throw DataError(file.string() + " exists already; --force replaces it");
}

void makeFolder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw DataError(folder.string() + ": cannot be created, " + error.message());
}

TextFile::TextFile(const fs::path& file) : file_(file) {
  std::istringstream stream(readFile(file, kMaxBytes));
  std::size_t last_used = 0;
  for (std::string line; std::getline(stream, line);) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    lines_.push_back(line);
    if (line.find_first_not_of(" \t") != std::string::npos) last_used = lines_.size();
  }
  lines_.resize(last_used);
  if (lines_.empty()) throw DataError(file.string() + ": is empty");
}

std::size_t TextFile::wordCount(std::size_t i) const {
  std::size_t count = 0;
  forEachWord(line(i), [&](const std::string&) {
    ++count;
    return true;
  });
  return count;
}

std::vector<double> TextFile::numbers(std::size_t i, std::size_t count, std::size_t first) const {
  std::vector<double> values;
  std::size_t words = 0;
  forEachWord(line(i), [&](const std::string& word) {
    // A line may have millions of words: surplus words are counted, not parsed.
    if (words++ < first || values.size() == count) return true;
    const auto value = parseNumber<double>(word);
    if (!value) fail(i, quote(word) + " is not a finite number");
    values.push_back(*value);
    return true;
  });
  const std::size_t found = words - std::min(words, first);
  if (found != count) {
    fail(i, "has " + std::to_string(found) + " numbers instead of " + std::to_string(count));
  }
  return values;
}

std::size_t TextFile::lineOf(const std::string& key) const {
  for (std::size_t i = 0; i < size(); ++i) {
    bool is_key = false;
    forEachWord(line(i), [&](const std::string& word) {
      is_key = word == key;
      return false;
    });
    if (is_key) return i;
  }
  throw DataError(file_.string() + ": has no line that begins with " + key);
}

std::int64_t TextFile::nanoseconds(std::size_t i) const {
  std::string word;
  forEachWord(line(i), [&](const std::string& first) {
    word = first;
    return false;
  });
  // long double, whose 64 bits of mantissa hold an epoch stamp to the nanosecond.
  const auto seconds = parseNumber<long double>(word);
  if (!seconds || std::abs(*seconds) > kLatestStamp) {
    fail(i, quote(word) + " is not a time in seconds");
  }
  return std::llround(*seconds * 1e9L);
}

void TextFile::fail(std::size_t i, const std::string& what) const {
  throw DataError(file_.string() + ", line " + std::to_string(i + 1) + ": " + what);
}

std::string formatSeconds(std::int64_t stamp_ns) {
  constexpr std::int64_t kSecond = 1000000000;
  char text[32];
  std::snprintf(text, sizeof text, "%s%lld.%09lld", stamp_ns < 0 ? "-" : "",
                static_cast<long long>(std::abs(stamp_ns / kSecond)),
                static_cast<long long>(std::abs(stamp_ns % kSecond)));
  return text;
}

}  // namespace ground_scale_vo
