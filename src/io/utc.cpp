#include "utc.hpp"

#include <time.h>

#include <cmath>
#include <ctime>
#include <optional>
#include <regex>
#include <string>

namespace ground_scale_vo {
namespace {

/// Independent of the time zone of this machine.
std::optional<std::int64_t> parseUtc(const std::string& line) {
  static const std::regex kPattern(
      "(\\d{4})-(\\d{2})-(\\d{2}) (\\d{2}):(\\d{2}):(\\d{2})\\.(\\d{1,9})");
  // Not part of the pattern: std::regex recurses for each repeated character.
  const std::string text = line.substr(0, line.find_last_not_of(TextFile::kBlanks) + 1);
  std::smatch match;
  if (!std::regex_match(text, match, kPattern)) return std::nullopt;
  std::tm date{};
  date.tm_year = std::stoi(match[1]) - 1900;
  date.tm_mon = std::stoi(match[2]) - 1;
  date.tm_mday = std::stoi(match[3]);
  date.tm_hour = std::stoi(match[4]);
  date.tm_min = std::stoi(match[5]);
  date.tm_sec = std::stoi(match[6]);
  std::tm normalised = date;
  const std::int64_t seconds = timegm(&normalised);
  const bool exists = normalised.tm_mon == date.tm_mon && normalised.tm_mday == date.tm_mday &&
                      normalised.tm_hour == date.tm_hour && normalised.tm_min == date.tm_min &&
                      normalised.tm_sec == date.tm_sec;
  if (!exists || std::abs(static_cast<double>(seconds)) > kLatestStamp) return std::nullopt;
  std::string nanoseconds = match[7];
  nanoseconds.resize(9, '0');
  return seconds * 1000000000 + std::stoll(nanoseconds);
}

}  // namespace

std::int64_t readUtc(const TextFile& text, std::size_t i) {
  const auto stamp = parseUtc(text.line(i));
  if (!stamp) text.fail(i, "is not a time such as 2011-09-26 13:02:25.964389445");
  return *stamp;
}

}  // namespace ground_scale_vo
