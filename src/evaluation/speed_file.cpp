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
#include "ground_scale_vo/common/math.hpp"
#include "ground_scale_vo/io/image_folder.hpp"

namespace gsv {
namespace fs = std::filesystem;
namespace {

/// [s] Between two speeds: 1 kHz to 0.4 Hz.
constexpr long double kMinInterval = 0.0009L, kMaxInterval = 2.5L;
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

/// Where the columns of the table are.
struct Columns {
  std::size_t count, stamp, speed, sigma;  ///< sigma: count, when there is none
  double metres_per_second = 1;            ///< of the unit of speed and sigma
};

Columns readHeading(const TextFile& text, const std::string& stated_unit, bool height_is_given) {
  const std::vector<std::string> names = columnsOf(text.line(0));
  const auto columnOf = [&](const std::string& name) {
    return static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin());
  };
  Columns columns{names.size(), columnOf("stamp"), columnOf("speed"), columnOf("sigma")};
  std::string unit = stated_unit;
  for (const SpeedUnit& known : kSpeedUnits) {
    const std::size_t column = columnOf("speed_" + std::string(known.name));
    if (column == names.size()) continue;
    if (!unit.empty() && unit != known.name) {
      text.fail(0, "the column " + names[column] + " is not in the unit " + unit);
    }
    columns.speed = column;
    unit = known.name;
  }
  if (columns.stamp == names.size() || columns.speed == names.size()) {
    text.fail(
        0,
        "a heading with the columns stamp and speed_mps, speed_kmh, speed_mph, speed_knots or "
        "speed_mmps is expected");
  }
  if (unit.empty() && !height_is_given) {
    text.fail(0,
              "the unit of the column speed is not known, and without --camera-height a wrong one "
              "would not be noticed: name the column speed_mps, speed_kmh, speed_mph, speed_knots "
              "or speed_mmps, or add --speed-unit");
  }
  if (!unit.empty()) columns.metres_per_second = speedUnit(unit).metres_per_second;
  return columns;
}

std::vector<SpeedSample> readSpeedTable(const fs::path& file, const std::string& unit,
                                        bool height_is_given) {
  const TextFile text(file);
  const Columns columns = readHeading(text, unit, height_is_given);
  std::vector<SpeedSample> speeds;
  std::vector<long double> stamps;
  for (std::size_t i = 1; i < text.size(); ++i) {
    const std::vector<std::string> words = columnsOf(text.line(i));
    if (words.size() != columns.count) {
      text.fail(i, format("has %zu columns instead of %zu", words.size(), columns.count));
    }
    const auto number = [&](std::size_t column) {
      const auto value = parseNumber<long double>(words[column]);
      if (!value) text.fail(i, "'" + words[column].substr(0, 30) + "' is not a finite number");
      return *value;
    };
    const auto speed = [&](std::size_t column) {
      return columns.metres_per_second * static_cast<double>(number(column));
    };
    stamps.push_back(number(columns.stamp));
    speeds.push_back(
        {0, speed(columns.speed), columns.sigma < columns.count ? speed(columns.sigma) : 0});
    if (i > 1 && stamps[i - 2] >= stamps[i - 1]) {
      text.fail(i, "the stamp is not later than the one before");
    }
  }
  if (speeds.empty()) throw DataError(file.string() + ": has no speed");
  const long double ns_per_unit = nanosecondsPerUnit(stamps, kMinInterval, kMaxInterval);
  for (std::size_t i = 0; i < speeds.size(); ++i) {
    const long double ns = stamps[i] * ns_per_unit;
    if (!(ns_per_unit > 0 && ns >= 0 && ns <= kLatestStamp * 1e9L)) {
      text.fail(i + 1,
                "the stamp is not one in seconds, milliseconds, microseconds or nanoseconds");
    }
    speeds[i].stamp_ns = std::llround(ns);
  }
  return speeds;
}

}  // namespace

std::vector<SpeedSample> readSpeeds(const fs::path& path, const std::string& unit,
                                    bool height_is_given) {
  if (!unit.empty()) speedUnit(unit);
  if (fs::is_directory(path)) return readOxtsSpeeds(path);
  std::vector<SpeedSample> speeds = readSpeedTable(path, unit, height_is_given);
  requireVehicleSpeeds(speeds, path.string());
  return speeds;
}

std::pair<std::vector<SpeedSample>, std::string> readVelocities(const Velocities& velocities,
                                                                const std::string& unit,
                                                                const std::string& topic) {
  VelocityReader reader(speedUnit(unit));
  std::vector<SpeedSample> speeds;
  std::string reason = "has no message";
  std::size_t refused = 0;
  for (const auto& [stamp_ns, velocity, variance] : velocities) {
    try {
      const SpeedSample speed = reader.read(stamp_ns, velocity, variance);
      if (speeds.empty() || speed.stamp_ns > speeds.back().stamp_ns) speeds.push_back(speed);
    } catch (const DataError& error) {
      if (refused++ == 0) reason = error.what();
    }
  }
  if (speeds.empty()) throw DataError("speed on " + topic + " " + reason);
  requireVehicleSpeeds(speeds, topic);
  if (refused == 0) return {speeds, ""};
  return {speeds, format("%zu of %zu speeds are not used: speed on ", refused, velocities.size()) +
                      topic + " " + reason};
}

void requireVehicleSpeeds(const std::vector<SpeedSample>& speeds, const std::string& name) {
  std::vector<double> magnitudes;
  magnitudes.reserve(speeds.size());
  for (const SpeedSample& speed : speeds) magnitudes.push_back(std::abs(speed.speed));
  const double largest = *std::max_element(magnitudes.begin(), magnitudes.end());
  if (median(magnitudes) <= kMaxVehicleSpeed) return;
  throw DataError(name + format(": the speeds reach %.0f m/s, but a vehicle's are within %.0f m/s: "
                                "is their unit mm/s (--speed-unit mmps)?",
                                largest, kMaxVehicleSpeed));
}

}  // namespace gsv
