#include "ground_scale_vo/common/text_file.hpp"

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
    if (lines_.empty() && line.rfind("\xef\xbb\xbf", 0) == 0) line.erase(0, 3);  // UTF-8 mark
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

std::size_t TextFile::find(const std::string& key) const {
  for (std::size_t i = 0; i < size(); ++i) {
    bool is_key = false;
    forEachWord(line(i), [&](const std::string& word) {
      is_key = word == key;
      return false;
    });
    if (is_key) return i;
  }
  return size();
}

bool TextFile::has(const std::string& key) const { return find(key) < size(); }

std::size_t TextFile::lineOf(const std::string& key) const {
  const std::size_t i = find(key);
  if (i == size()) throw DataError(file_.string() + ": has no line that begins with " + key);
  return i;
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

}  // namespace ground_scale_vo
