#include "ground_scale_vo/dataset/text_file.hpp"

#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>

#include "ground_scale_vo/error.hpp"
#include "ground_scale_vo/parse_number.hpp"

namespace ground_scale_vo {
namespace fs = std::filesystem;
namespace {

/// A word fit for an error message: short, and printable whatever the file holds.
std::string quote(const std::string& word) {
  constexpr std::size_t kLongest = 30;
  std::string quoted = "'";
  for (const char c : word.substr(0, kLongest)) quoted += c >= ' ' && c <= '~' ? c : '?';
  return quoted + (word.size() > kLongest ? "...'" : "'");
}

std::vector<std::string> split(const std::string& line) {
  std::istringstream stream(line);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

}  // namespace

std::string readFile(const fs::path& file, std::size_t max_bytes) {
  std::error_code error;
  if (!fs::exists(file, error)) throw DataError(file.string() + ": no such file");
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
  fs::path temporary = file;
  temporary += ".tmp";
  std::ofstream stream(temporary, std::ios::binary | std::ios::trunc);
  stream.write(content.data(), static_cast<std::streamsize>(content.size()));
  stream.close();
  std::error_code error;
  if (stream) fs::rename(temporary, file, error);
  if (!stream || error) {
    std::error_code ignored;
    fs::remove(temporary, ignored);
    throw DataError(file.string() + ": cannot be written");
  }
}

void makeFolder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw DataError(folder.string() + ": cannot be made, " + error.message());
}

TextFile::TextFile(const fs::path& file) : file_(file) {
  std::istringstream stream(readFile(file, kMaxBytes));
  std::size_t used = 0;
  for (std::string line; std::getline(stream, line);) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    lines_.push_back(line);
    if (line.find_first_not_of(" \t") != std::string::npos) used = lines_.size();
  }
  lines_.resize(used);
  if (lines_.empty()) throw DataError(file.string() + ": is empty");
}

std::vector<std::string> TextFile::words(std::size_t i) const { return split(line(i)); }

std::vector<double> TextFile::numbers(std::size_t i, std::size_t count, std::size_t first) const {
  const std::vector<std::string> found = words(i);
  std::vector<double> values;
  for (std::size_t k = first; k < found.size(); ++k) {
    const auto value = parseNumber<double>(found[k]);
    if (!value) fail(i, quote(found[k]) + " is not a finite number");
    values.push_back(*value);
  }
  if (values.size() != count) {
    fail(i,
         "has " + std::to_string(values.size()) + " numbers instead of " + std::to_string(count));
  }
  return values;
}

std::size_t TextFile::lineOf(const std::string& key) const {
  for (std::size_t i = 0; i < size(); ++i) {
    const std::vector<std::string> found = words(i);
    if (!found.empty() && found.front() == key) return i;
  }
  throw DataError(file_.string() + ": has no line that begins with " + key);
}

std::int64_t TextFile::nanoseconds(std::size_t i, const std::string& word) const {
  // long double, whose 64 bits of mantissa hold an epoch stamp to the nanosecond.
  constexpr long double kLargest = 9.2e9L;
  const auto seconds = parseNumber<long double>(word);
  if (!seconds || std::abs(*seconds) > kLargest) fail(i, quote(word) + " is not a time in seconds");
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
