#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace ground_scale_vo {

/// The latest stamp that ROS knows, in the year 2106 [s].
constexpr double kLatestStamp = 4294967295;

/// Something has this name, be it a link to nothing.
bool isThere(const std::filesystem::path& path);

/// A file's bytes. Throws DataError: no such file, not a file, not readable, more than max_bytes.
std::string readFile(const std::filesystem::path& file, std::size_t max_bytes);

/// Writes under a temporary name beside the file and renames, so that the file is there whole or
/// not at all. Throws DataError.
void writeFile(const std::filesystem::path& file, const std::string& content);

/// Makes the folder and those above it where they are missing. Throws DataError.
void makeFolder(const std::filesystem::path& folder);

/// A table of numbers in text: the lines of a file, read at once. LF and CRLF end a line; blank
/// lines at the end do not count. Numbers are read the same in every locale, and NaN and infinity
/// are not numbers here. Every refusal is a DataError of the form "FILE, line N: what is wrong".
class TextFile {
 public:
  static constexpr std::size_t kMaxBytes = 64u << 20;

  /// Throws DataError as readFile does, and when the file has no line.
  explicit TextFile(const std::filesystem::path& file);

  std::size_t size() const { return lines_.size(); }
  const std::string& line(std::size_t i) const { return lines_.at(i); }

  /// Blank-separated words of line i.
  std::size_t wordCount(std::size_t i) const;
  /// Line i from its word `first` on as exactly `count` numbers. Throws DataError.
  std::vector<double> numbers(std::size_t i, std::size_t count, std::size_t first = 0) const;
  /// The first line that begins with the word `key`. Throws DataError when there is none.
  std::size_t lineOf(const std::string& key) const;
  /// The first of the numbers of line i as seconds, exact to the nanosecond. Throws DataError, also
  /// beyond kLatestStamp before or after 0.
  std::int64_t nanoseconds(std::size_t i) const;

  [[noreturn]] void fail(std::size_t i, const std::string& what) const;

 private:
  std::filesystem::path file_;
  std::vector<std::string> lines_;
};

/// Seconds with nine decimals, exact.
std::string formatSeconds(std::int64_t stamp_ns);

}  // namespace ground_scale_vo
