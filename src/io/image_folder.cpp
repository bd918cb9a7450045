#include "ground_scale_vo/io/image_folder.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include "common/files.hpp"
#include "common/text.hpp"
#include "common/time.hpp"
#include "ground_scale_vo/common/error.hpp"

namespace gsv {
namespace fs = std::filesystem;
namespace {

/// Without leading zeros, of any length: compared by the number of digits first.
using Number = std::pair<std::size_t, std::string>;
using Numbers = std::vector<Number>;
using FilesByNumbers = std::map<Numbers, fs::path>;

constexpr std::size_t kDecimals = 12;

bool isDigit(char c) { return c >= '0' && c <= '9'; }

/// Splits a name into its numbers and the rest, with # for each number. Digits after a point that
/// follows a number are its decimals, as in the time 1600000000.5.
std::pair<std::string, Numbers> split(const std::string& name) {
  std::string pattern;
  std::vector<std::string> digit_groups;
  for (std::size_t i = 0; i < name.size();) {
    if (!isDigit(name[i])) {
      pattern += name[i++];
      continue;
    }
    std::size_t end = i;
    while (end < name.size() && isDigit(name[end])) ++end;
    std::string digits = name.substr(i, end - i);
    const std::size_t n = pattern.size();
    if (n > 1 && pattern[n - 1] == '.' && pattern[n - 2] == '#' && digits.size() <= kDecimals) {
      digits.resize(kDecimals, '0');
      digit_groups.back() += digits;
    } else {
      digit_groups.push_back(digits);
    }
    pattern += '#';
    i = end;
  }
  Numbers numbers;
  for (std::string& group : digit_groups) {
    group.erase(0, std::min(group.find_first_not_of('0'), group.size() - 1));
    numbers.emplace_back(group.size(), group);
  }
  return {pattern, numbers};
}

std::string lowerCase(std::string text) {
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return text;
}

[[noreturn]] void failWithoutFiles(const fs::path& folder, const std::vector<std::string>& wanted) {
  std::string types;
  for (const std::string& type : wanted) types += (types.empty() ? "" : ", ") + type;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string type = lowerCase(entry.path().extension().string());
    for (const char* other : {".bmp", ".pgm", ".ppm", ".tif", ".tiff", ".webp", ".raw", ".exr"}) {
      if (type == other) {
        throw DataError(folder.string() + ": the images are " + type + " files, such as " +
                        entry.path().filename().string() + "; convert them to PNG");
      }
    }
  }
  throw DataError(folder.string() + " has no file with a number in its name and the type " + types);
}

/// The number that varies, of each file; empty if several vary or one is too long.
std::vector<std::uint64_t> varyingNumbers(const FilesByNumbers& files) {
  const Numbers& first = files.begin()->first;
  std::vector<std::size_t> varying;
  for (std::size_t k = 0; k < first.size(); ++k) {
    const bool varies = std::any_of(files.begin(), files.end(),
                                    [&](const auto& file) { return file.first[k] != first[k]; });
    if (varies) varying.push_back(k);
  }
  if (varying.empty()) varying.push_back(first.size() - 1);  // a single file
  std::vector<std::uint64_t> numbers;
  for (const auto& [groups, file] : files) {
    const auto& [digits, group] = groups[varying.front()];
    if (varying.size() > 1 || digits > 18) return {};
    numbers.push_back(std::stoull(group));
  }
  return numbers;
}

/// Throws DataError when a number other than the last one tells series of files apart, as the 0 and
/// 1 of cam0_000000.png and cam1_000000.png: the other numbers are the same for each of its values.
void requireOneSeries(const fs::path& folder, const FilesByNumbers& files) {
  for (std::size_t k = 0; k + 1 < files.begin()->first.size(); ++k) {
    std::map<Number, fs::path> first_of;  // of each value
    std::set<Numbers> others;
    for (const auto& [numbers, file] : files) {
      first_of.emplace(numbers[k], file);
      Numbers rest = numbers;
      rest.erase(rest.begin() + static_cast<long>(k));
      others.insert(rest);
    }
    if (first_of.size() < 2 || others.size() < 2) continue;
    if (first_of.size() * others.size() > files.size()) continue;
    throw DataError(folder.string() + " holds several series of files, of " +
                    first_of.begin()->second.filename().string() + " and of " +
                    first_of.rbegin()->second.filename().string() + ": keep those of one camera");
  }
}

std::string missingNumbers(const fs::path& folder, const std::vector<std::uint64_t>& numbers) {
  std::size_t gaps = 0, steps = 0, first_gap = 0;
  for (std::size_t i = 1; i < numbers.size(); ++i) {
    if (numbers[i] == numbers[i - 1] + 1) {
      ++steps;
    } else if (gaps++ == 0) {
      first_gap = i;
    }
  }
  // Stamps as names, or every tenth image, have a gap at every step.
  if (gaps == 0 || steps < gaps) return {};
  const std::uint64_t missing = numbers.back() - numbers.front() + 1 - numbers.size();
  return folder.string() + ": " + std::to_string(missing) + " of the image numbers " +
         std::to_string(numbers.front()) + " to " + std::to_string(numbers.back()) +
         " are missing, the first one after " + std::to_string(numbers[first_gap - 1]);
}

/// Frame rates of cameras on vehicles: 0.5 to 250 Hz.
constexpr long double kMinInterval = 0.004L, kMaxInterval = 2;  // [s]

/// Stamps from one number a line, or from the second of three; lines that are no comments.
std::vector<std::int64_t> readNumericStamps(const TextFile& text) {
  std::vector<long double> values;
  std::vector<std::string> stamps;
  std::vector<std::size_t> lines;
  std::size_t columns = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text.isComment(i)) continue;
    const std::vector<std::string> words = text.words(i);
    if (columns == 0) columns = words.size();
    if (words.size() != columns || (columns != 1 && columns != 3)) {
      text.fail(i, "has " + std::to_string(words.size()) +
                       " words; one number a line is expected, a time");
    }
    stamps.push_back(words[columns / 2].substr(0, words[columns / 2].find(',')));
    lines.push_back(i);
    const auto value = parseNumber<long double>(stamps.back());
    if (!value) text.fail(i, "'" + stamps.back().substr(0, 30) + "' is not a time");
    values.push_back(*value);
  }
  if (values.empty()) return {};
  const long double unit = nanosecondsPerUnit(values, kMinInterval, kMaxInterval);
  if (unit == 0) {
    text.fail(lines.front(),
              "the stamps, " + stamps.front() + ", " + stamps[values.size() > 1] +
                  " ..., give no plausible frame rate in seconds, milliseconds or nanoseconds");
  }
  std::vector<std::int64_t> stamps_ns;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const long double ns = values[i] * unit;
    if (!(std::abs(ns) < kLatestStamp * 1e9L)) {
      text.fail(lines[i], "'" + stamps[i] + "' is not a time");
    }
    stamps_ns.push_back(std::llround(ns));
  }
  return stamps_ns;
}

/// Line i of a KITTI raw drive, a time in UTC; independent of the time zone of this machine.
std::int64_t readUtc(const TextFile& text, std::size_t i) {
  const std::vector<std::string> words = text.words(i);
  std::tm date{};
  const std::string time = words.size() == 2 ? words[0] + " " + words[1] : "";
  const char* rest = strptime(time.c_str(), "%Y-%m-%d %H:%M:%S", &date);
  const auto fraction = parseNumber<double>(rest ? "0" + std::string(rest) : "");
  const int day = date.tm_mday;
  const std::int64_t seconds = timegm(&date);  // makes the first of March of the 30th of February
  if (!fraction || !(*fraction < 1) || date.tm_mday != day || seconds < 0 ||
      static_cast<double>(seconds) > kLatestStamp) {
    text.fail(i, "is not a time such as 2011-09-26 13:02:25.964389445");
  }
  return seconds * 1'000'000'000 + std::llround(1e9 * *fraction);
}

}  // namespace

long double nanosecondsPerUnit(const std::vector<long double>& values, long double min_interval,
                               long double max_interval) {
  std::vector<long double> intervals;
  for (std::size_t i = 1; i < values.size(); ++i) {
    if (values[i] > values[i - 1]) intervals.push_back(values[i] - values[i - 1]);
  }
  const auto middle = intervals.begin() + static_cast<long>(intervals.size() / 2);
  std::nth_element(intervals.begin(), middle, intervals.end());
  for (const long double unit : {1e9L, 1e6L, 1e3L, 1.0L}) {
    const long double seconds = unit * 1e-9L, first = values.front() * seconds;
    const bool is_plausible =
        intervals.empty() ? first < kLatestStamp && (unit == 1e9L || first > kEarliestEpoch)
                          : *middle * seconds >= min_interval && *middle * seconds <= max_interval;
    if (is_plausible) return unit;
  }
  return 0;
}

NumberedFiles numberedFiles(const fs::path& folder, const std::vector<std::string>& extensions) {
  FilesByNumbers files;
  std::string first_pattern;
  fs::path first;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().stem().string();
    const std::string type = lowerCase(entry.path().extension().string());
    const bool is_wanted =
        std::find(extensions.begin(), extensions.end(), type) != extensions.end();
    const auto [pattern, numbers] = split(name);
    if (!is_wanted || name.front() == '.' || numbers.empty() || entry.is_directory()) continue;
    if (files.empty()) {
      first_pattern = pattern;
      first = entry.path();
    }
    if (pattern != first_pattern) {
      throw DataError(folder.string() + " holds several series of files, of " +
                      std::min(first.filename(), entry.path().filename()).string() + " and of " +
                      std::max(first.filename(), entry.path().filename()).string() +
                      ": keep those of one camera");
    }
    const auto [other, is_new] = files.emplace(numbers, entry.path());
    if (!is_new) {
      throw DataError(std::max(entry.path(), other->second).string() + " has the same number as " +
                      std::min(entry.path(), other->second).filename().string());
    }
  }
  if (files.empty()) failWithoutFiles(folder, extensions);
  requireOneSeries(folder, files);
  NumberedFiles result;
  for (const auto& file : files) result.files.push_back(file.second);
  result.numbers = varyingNumbers(files);
  result.warning = missingNumbers(folder, result.numbers);
  return result;
}

NumberedFiles imageFiles(const fs::path& folder) {
  return numberedFiles(folder, {".png", ".jpg", ".jpeg"});
}

std::optional<std::vector<std::size_t>> linesOf(const NumberedFiles& images, std::size_t lines) {
  std::vector<std::size_t> result(images.files.size());
  std::iota(result.begin(), result.end(), 0);
  if (lines == result.size()) return result;
  const std::vector<std::uint64_t>& numbers = images.numbers;
  const bool is_range = !numbers.empty() && lines == numbers.back() - numbers.front() + 1;
  // A single surplus line of images that are numbered from 1 may be any of them.
  const bool is_part = !numbers.empty() && numbers.front() != 1 && lines > numbers.back();
  if (!is_range && !is_part) return std::nullopt;
  for (std::size_t i = 0; i < result.size(); ++i) {
    result[i] = is_range ? numbers[i] - numbers.front() : numbers[i];
  }
  return result;
}

std::vector<std::int64_t> readStamps(const fs::path& file) {
  const TextFile text(file);
  if (text.line(0).find(':') == std::string::npos) return readNumericStamps(text);
  std::vector<std::int64_t> stamps_ns;
  for (std::size_t i = 0; i < text.size(); ++i) stamps_ns.push_back(readUtc(text, i));
  return stamps_ns;
}

std::vector<std::int64_t> readImageStamps(const fs::path& file, const NumberedFiles& images) {
  const std::vector<std::int64_t> all = readStamps(file);
  const auto lines = linesOf(images, all.size());
  if (!lines) {
    throw DataError(file.string() + ": has " + std::to_string(all.size()) + " stamps for " +
                    std::to_string(images.files.size()) + " images");
  }
  std::vector<std::int64_t> stamps_ns;
  for (const std::size_t line : *lines) stamps_ns.push_back(all[line]);
  return stamps_ns;
}

}  // namespace gsv
