#include "ground_scale_vo/io/image_folder.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <sstream>
#include <utility>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/format.hpp"
#include "ground_scale_vo/common/parse_number.hpp"
#include "ground_scale_vo/common/text_file.hpp"
#include "utc.hpp"

namespace ground_scale_vo {
namespace fs = std::filesystem;
namespace {

using Numbers = std::vector<std::string>;  // without leading zeros, of any length

constexpr std::size_t kDecimals = 12;

bool isDigit(char c) { return c >= '0' && c <= '9'; }

/// By length first: the numbers have no leading zeros.
struct Smaller {
  bool operator()(const Numbers& a, const Numbers& b) const {
    return std::lexicographical_compare(
        a.begin(), a.end(), b.begin(), b.end(), [](const std::string& x, const std::string& y) {
          return std::make_pair(x.size(), x) < std::make_pair(y.size(), y);
        });
  }
};

/// Splits a name into its numbers and the rest, with # for each number. Digits after a point that
/// follows a number are its decimals, as in the time 1600000000.5.
std::pair<std::string, Numbers> split(const std::string& name) {
  std::string pattern;
  Numbers numbers;
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
      numbers.back() += digits;
    } else {
      numbers.push_back(digits);
    }
    pattern += '#';
    i = end;
  }
  for (std::string& number : numbers) {
    number.erase(0, std::min(number.find_first_not_of('0'), number.size() - 1));
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
std::vector<std::uint64_t> varyingNumbers(const std::map<Numbers, fs::path, Smaller>& files) {
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
    const std::string& group = groups[varying.front()];
    if (varying.size() > 1 || group.size() > 18) return {};
    numbers.push_back(std::stoull(group));
  }
  return numbers;
}

/// Throws DataError when a number other than the last one tells series of files apart, as the 0 and
/// 1 of cam0_000000.png and cam1_000000.png: the other numbers are the same for each of its values.
void requireOneSeries(const fs::path& folder, const std::map<Numbers, fs::path, Smaller>& files) {
  const std::size_t groups = files.begin()->first.size();
  for (std::size_t k = 0; k + 1 < groups; ++k) {
    std::map<std::string, std::pair<std::set<Numbers>, fs::path>> series;
    for (const auto& [numbers, file] : files) {
      Numbers others = numbers;
      others.erase(others.begin() + static_cast<long>(k));
      auto& [seen, first] = series[numbers[k]];
      if (seen.empty()) first = file;
      seen.insert(others);
    }
    const auto& [first, first_file] = series.begin()->second;
    const bool are_same =
        std::all_of(series.begin(), series.end(),
                    [&first = first](const auto& s) { return s.second.first == first; });
    if (series.size() < 2 || first.size() < 2 || !are_same) continue;
    throw DataError(folder.string() + " holds several series of files, of " +
                    first_file.filename().string() + " and of " +
                    series.rbegin()->second.second.filename().string() +
                    ": keep those of one camera");
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

/// Words of the stamps, one of each line that is no comment, and the numbers of these lines.
struct Stamps {
  std::vector<std::string> words;
  std::vector<std::size_t> lines;
};

Stamps readWords(const TextFile& text) {
  Stamps stamps;
  std::size_t columns = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text.isComment(i)) continue;
    const std::size_t words = text.wordCount(i);
    if (columns == 0) columns = words;
    if (words != columns || (words != 1 && words != 3)) {
      text.fail(i,
                "has " + std::to_string(words) + " words; one number a line is expected, a time");
    }
    std::istringstream line(text.line(i));
    std::string word;
    for (std::size_t k = 0; k < (columns == 3 ? 2 : 1); ++k) line >> word;
    stamps.words.push_back(word);
    stamps.lines.push_back(i);
  }
  return stamps;
}

/// Frame rates of cameras on vehicles: 0.5 to 250 Hz.
constexpr long double kMinInterval = 0.004L, kMaxInterval = 2;  // [s]
/// [s] Stamps in this range are times since 1970.
constexpr long double kMinEpoch = kEarliestEpoch, kMaxEpoch = kLatestStamp;

/// The number of nanoseconds in the unit of the stamps. 0: none gives a plausible frame rate.
long double unitOf(const std::vector<long double>& values) {
  std::vector<long double> intervals;
  for (std::size_t i = 1; i < values.size(); ++i) {
    if (values[i] > values[i - 1]) intervals.push_back(values[i] - values[i - 1]);
  }
  const auto middle = intervals.begin() + static_cast<long>(intervals.size() / 2);
  std::nth_element(intervals.begin(), middle, intervals.end());
  for (const long double unit : {1e9L, 1e6L, 1e3L, 1.0L}) {
    const long double seconds = unit * 1e-9L;
    if (intervals.empty()) {
      const long double first = values.front() * seconds;
      if (unit == 1e9L ? first < kMaxEpoch : first > kMinEpoch && first < kMaxEpoch) return unit;
    } else if (*middle * seconds >= kMinInterval && *middle * seconds <= kMaxInterval) {
      return unit;
    }
  }
  return 0;
}

std::vector<std::int64_t> parseStamps(const TextFile& text, const Stamps& stamps) {
  std::vector<long double> values;
  for (std::size_t i = 0; i < stamps.words.size(); ++i) {
    const auto value = parseNumber<long double>(stamps.words[i]);
    if (!value) text.fail(stamps.lines[i], "'" + stamps.words[i].substr(0, 30) + "' is not a time");
    values.push_back(*value);
  }
  const long double unit = unitOf(values);
  if (unit == 0) {
    const std::string& second = stamps.words[std::min<std::size_t>(1, stamps.words.size() - 1)];
    text.fail(stamps.lines.front(),
              "the stamps, " + stamps.words.front() + ", " + second +
                  " ..., give no plausible frame rate in seconds, milliseconds or nanoseconds");
  }
  std::vector<std::int64_t> stamps_ns;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const long double ns = values[i] * unit;
    if (!(std::abs(ns) < kMaxEpoch * 1e9L)) {
      text.fail(stamps.lines[i], "'" + stamps.words[i] + "' is not a time");
    }
    stamps_ns.push_back(std::llround(ns));
  }
  return stamps_ns;
}

}  // namespace

NumberedFiles numberedFiles(const fs::path& folder, const std::vector<std::string>& extensions) {
  std::map<Numbers, fs::path, Smaller> files;
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

std::vector<std::int64_t> readImageStamps(const fs::path& file, const NumberedFiles& images) {
  const TextFile text(file);
  std::vector<std::int64_t> all;
  if (text.line(0).find(':') != std::string::npos) {
    for (std::size_t i = 0; i < text.size(); ++i) all.push_back(readUtc(text, i));
  } else {
    const Stamps stamps = readWords(text);
    if (!stamps.words.empty()) all = parseStamps(text, stamps);
  }
  const std::size_t n = images.files.size();
  if (all.size() == n) return all;
  const std::vector<std::uint64_t>& numbers = images.numbers;
  const bool is_range = !numbers.empty() && all.size() == numbers.back() - numbers.front() + 1;
  // A single surplus line of images that are numbered from 1 may be any of them.
  const bool is_part = !numbers.empty() && numbers.front() != 1 && all.size() > numbers.back();
  if (!is_range && !is_part) {
    throw DataError(file.string() + ": has " + std::to_string(all.size()) + " stamps for " +
                    std::to_string(n) + " images");
  }
  std::vector<std::int64_t> stamps_ns;
  for (const std::uint64_t number : numbers) {
    stamps_ns.push_back(all[is_range ? number - numbers.front() : number]);
  }
  return stamps_ns;
}

std::vector<std::int64_t> constantRate(std::size_t images, double fps) {
  std::vector<std::int64_t> stamps_ns;
  for (std::size_t i = 0; i < images; ++i) {
    stamps_ns.push_back(stampAtRate(i, fps));
  }
  return stamps_ns;
}

}  // namespace ground_scale_vo
