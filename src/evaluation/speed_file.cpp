#include "ground_scale_vo/evaluation/speed_file.hpp"

#include <algorithm>
#include <boost/algorithm/string.hpp>
#include <cmath>
#include <cstddef>
#include <string>

#include "common/files.hpp"
#include "common/text.hpp"
#include "common/time.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/io/image_folder.hpp"

namespace gsv {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kOxtsNumbers = 30, kForwardVelocity = 8;

std::vector<SpeedSample> readOxtsSpeeds(const fs::path& folder) {
  const NumberedFiles files = numberedFiles(folder / "data", {".txt"});
  const std::vector<std::int64_t> stamps_ns = readImageStamps(folder / "timestamps.txt", files);
  std::vector<SpeedSample> speeds;
  for (std::size_t i = 0; i < files.files.size(); ++i) {
    const TextFile text(files.files[i]);
    speeds.push_back({stamps_ns[i], text.numbers(0, kOxtsNumbers)[kForwardVelocity], 0});
  }
  return speeds;
}

std::vector<std::string> columnsOf(const std::string& line) {
  std::vector<std::string> columns;
  boost::split(columns, line, boost::is_any_of(","));
  for (std::string& column : columns) boost::trim(column);
  return columns;
}

std::vector<SpeedSample> readSpeedTable(const fs::path& file) {
  const TextFile text(file);
  const std::vector<std::string> names = columnsOf(text.line(0));
  const auto columnOf = [&](const char* name) {
    return static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin());
  };
  const std::size_t stamp = columnOf("stamp"), speed = columnOf("speed"), sigma = columnOf("sigma");
  if (stamp == names.size() || speed == names.size()) {
    text.fail(0, "a heading with the columns stamp and speed is expected");
  }
  std::vector<SpeedSample> speeds;
  for (std::size_t i = 1; i < text.size(); ++i) {
    const std::vector<std::string> columns = columnsOf(text.line(i));
    if (columns.size() != names.size()) {
      text.fail(i, format("has %zu columns instead of %zu", columns.size(), names.size()));
    }
    const auto number = [&](std::size_t column) {
      const auto value = parseNumber<long double>(columns[column]);
      if (!value) text.fail(i, "'" + columns[column].substr(0, 30) + "' is not a finite number");
      return *value;
    };
    const long double seconds = number(stamp);
    if (!(seconds >= 0 && seconds <= kLatestStamp)) text.fail(i, "the stamp is not one in seconds");
    speeds.push_back({std::llround(1e9L * seconds), static_cast<double>(number(speed)),
                      sigma < names.size() ? static_cast<double>(number(sigma)) : 0});
    if (speeds.size() > 1 && speeds[speeds.size() - 2].stamp_ns >= speeds.back().stamp_ns) {
      text.fail(i, "the stamp is not later than the one before");
    }
  }
  if (speeds.empty()) throw DataError(file.string() + ": has no speed");
  return speeds;
}

}  // namespace

std::vector<SpeedSample> readSpeeds(const fs::path& path) {
  return fs::is_directory(path) ? readOxtsSpeeds(path) : readSpeedTable(path);
}

}  // namespace gsv
