#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/core/version.hpp>
#include <string>

#include "support/sanitizer.hpp"

namespace ground_scale_vo {

// The figures of docs/results.json are reproducible to the last digit, whatever instruction set the
// processor has, but only with the libraries and the compiler with which they were measured, those
// of Debian 12. Elsewhere the drives only have to meet their thresholds.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
constexpr bool kReproducesFigures =
    __GNUC__ == 12 && CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR == 6 && !kSanitized;
#else
constexpr bool kReproducesFigures = false;
#endif

/// A member of metricsJson() by its name in docs/results.json: nees_50 is nees_per_dof in the entry
/// of covariance_by_length for 50 m. Null if there is none.
inline nlohmann::json publishedMember(const nlohmann::json& metrics, const std::string& name) {
  const std::string prefixes[][2] = {{"nees_exact_", "nees_per_dof_exact_ground_truth"},
                                     {"nees_", "nees_per_dof"},
                                     {"within_", "within_2_sigma"}};
  for (const auto& [prefix, member] : prefixes) {
    if (name.compare(0, prefix.size(), prefix) != 0) continue;
    for (const nlohmann::json& entry : metrics.at("covariance_by_length")) {
      if (entry.at("length_m") == std::stod(name.substr(prefix.size()))) return entry.at(member);
    }
    return nullptr;
  }
  return metrics.at(name);
}

/// docs/results.json.
inline nlohmann::json publishedResults() {
  std::ifstream file(std::filesystem::path(__FILE__).parent_path() / "../../docs/results.json");
  return nlohmann::json::parse(file);
}

/// Expects the figures that docs/results.json has for a drive in the section. Whoever changes them
/// measures all of them again, with scripts/report. metrics: from metricsJson().
inline void expectPublishedFigures(const std::string& section, const std::string& drive,
                                   const std::string& metrics) {
  if (!kReproducesFigures) return;
  const auto measured = nlohmann::json::parse(metrics);
  const nlohmann::json figures = publishedResults().at(section).at(drive);
  ASSERT_FALSE(figures.empty());
  for (const auto& [name, published] : figures.items()) {
    const nlohmann::json value = publishedMember(measured, name);
    ASSERT_EQ(value.is_null(), published.is_null()) << name;
    if (value.is_null()) continue;
    const double expected = published;  // rounded to five digits
    EXPECT_NEAR(value.get<double>(), expected, 1e-3 * std::abs(expected) + 1e-4)
        << name << " of " << drive << " is not the published one; see scripts/report";
  }
}

/// The same for a drive with faults. text: faultDriveText().
inline void expectPublishedFaults(const std::string& text) {
  if (!kReproducesFigures) return;
  const nlohmann::json lines = publishedResults().at("faults").at("lines");
  std::string published;
  for (const auto& line : lines) published += line.get<std::string>() + "\n";
  EXPECT_NE(published.find(text), std::string::npos)
      << text << "is not the published result; see scripts/report";
}

}  // namespace ground_scale_vo
