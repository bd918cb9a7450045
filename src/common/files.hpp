#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace gsv {

/// True if the path exists, possibly as a dangling link.
bool isThere(const std::filesystem::path& path);

/// Returns the bytes of a file. Throws DataError: no such file, not a file, not readable, more than
/// max_bytes.
std::string readFile(const std::filesystem::path& file, std::size_t max_bytes);

/// Writes under a temporary name beside the file and renames, so that the file is complete or
/// missing. Throws DataError.
void writeFile(const std::filesystem::path& file, const std::string& content);

/// Throws DataError when the output file exists and `force` is false, when it is a folder, a device
/// or another file that is not a regular one, or when the folder of a new file does not exist.
void requireNewFile(const std::filesystem::path& file, bool force);

/// Creates the folder and its parents where they are missing. Throws DataError.
void makeFolder(const std::filesystem::path& folder);

/// A table of numbers in text. Lines end with LF or CRLF; blank lines at the end are ignored.
/// Numbers are parsed independently of the locale; NaN and infinity are rejected. Errors are
/// DataErrors of the form "FILE, line N: what is wrong".
class TextFile {
 public:
  static constexpr std::size_t kMaxBytes = 64u << 20;

  /// Throws DataError as readFile does, and when the file is empty.
  explicit TextFile(const std::filesystem::path& file);

  std::size_t size() const { return lines_.size(); }
  const std::string& line(std::size_t i) const { return lines_.at(i); }
  /// True if line i begins with '#'.
  bool isComment(std::size_t i) const { return line(i).rfind('#', 0) == 0; }

  /// The blank-separated words of line i.
  std::vector<std::string> words(std::size_t i) const;
  /// The words of line i from `first` on, which must be exactly `count` numbers. Throws DataError.
  std::vector<double> numbers(std::size_t i, std::size_t count, std::size_t first = 0) const;
  /// True if a line begins with the word `key`.
  bool has(const std::string& key) const { return find(key) < size(); }
  /// The first line that begins with the word `key`. Throws DataError when there is none.
  std::size_t lineOf(const std::string& key) const;

  /// Throws a DataError on line i.
  [[noreturn]] void fail(std::size_t i, const std::string& what) const;

 private:
  std::size_t find(const std::string& key) const;  ///< size(): there is none

  std::filesystem::path file_;
  std::vector<std::string> lines_;
};

}  // namespace gsv
