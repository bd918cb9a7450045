#include "ground_scale_vo/evaluation/clock_offset.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>

#include "common/time.hpp"
#include "ground_scale_vo/common/math.hpp"

namespace gsv {
namespace {

constexpr double kCoarseStep = 0.5, kFineStep = 0.05;  // [s]
constexpr double kMostProducts = 2e8;     // of the coarse search, whose step grows beyond them
constexpr double kLongestPeriod = 2;      // [s] between two samples, or three median periods
constexpr double kShortestOverlap = 8;    // [s]
constexpr double kIndependentAfter = 2;   // [s] until the errors of the speeds are independent
constexpr double kLikelihoodRatio = 9;    // chi-square at which another offset is excluded,
constexpr double kResidualRatio = 1.5;    // and the least ratio of its squared residuals
constexpr double kPeakWidth = 2;          // [s] offsets farther from the best one are excluded
constexpr double kSensorResidual = 1e-4;  // two sensors agree to 1 % at best
constexpr double kLeastCorrelation = 0.7;
constexpr double kParabola = 0.25;     // [s] to the neighbours that give the peak between two steps
constexpr double kLargestSigma = 0.5;  // [s]

/// Mean speeds in intervals of equal length; NaN where there is none.
using Grid = std::vector<double>;

double spanOf(const std::vector<SpeedSample>& samples) {
  return secondsBetween(samples.front().stamp_ns, samples.back().stamp_ns);
}

double longestPeriod(const std::vector<SpeedSample>& samples) {
  std::vector<double> periods;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    periods.push_back(secondsBetween(samples[i - 1].stamp_ns, samples[i].stamp_ns));
  }
  return std::max(kLongestPeriod, 3 * median(&periods));
}

/// The samples, interpolated linearly and averaged over each step [s].
Grid resample(const std::vector<SpeedSample>& samples, double step) {
  const double longest = longestPeriod(samples);
  const std::int64_t start_ns = samples.front().stamp_ns;
  const auto count = static_cast<std::size_t>(spanOf(samples) / step) + 1;
  std::vector<double> integrals(count), times(count);
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const SpeedSample &a = samples[i - 1], &b = samples[i];
    const double from = secondsBetween(start_ns, a.stamp_ns),
                 to = secondsBetween(start_ns, b.stamp_ns);
    if (!(to > from) || to - from > longest) continue;
    const double slope = (b.speed - a.speed) / (to - from);
    for (auto k = static_cast<std::size_t>(from / step);
         k < count && static_cast<double>(k) * step < to; ++k) {
      const double left = std::max(from, static_cast<double>(k) * step);
      const double right = std::min(to, static_cast<double>(k + 1) * step);
      if (!(right > left)) continue;
      integrals[k] += (right - left) * (a.speed + slope * ((left + right) / 2 - from));
      times[k] += right - left;
    }
  }
  for (std::size_t k = 0; k < count; ++k) {
    integrals[k] =
        times[k] > 0.9 * step ? integrals[k] / times[k] : std::numeric_limits<double>::quiet_NaN();
  }
  return integrals;
}

/// Agreement of two grids when the second one is shifted by whole steps.
struct Agreement {
  double overlap = 0;      ///< [steps]
  double residual = 1;     ///< share of the squared speeds that a common factor does not explain
  double correlation = 0;  ///< Pearson's
};

Agreement compare(const Grid& reference, const Grid& other, std::ptrdiff_t shift) {
  const auto n = static_cast<std::ptrdiff_t>(reference.size());
  const auto m = static_cast<std::ptrdiff_t>(other.size());
  double count = 0, x = 0, y = 0, xx = 0, yy = 0, xy = 0;
  for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(0, shift); i < std::min(n, m + shift); ++i) {
    const double a = reference[static_cast<std::size_t>(i)];
    const double b = other[static_cast<std::size_t>(i - shift)];
    if (std::isnan(a) || std::isnan(b)) continue;
    count += 1, x += a, y += b, xx += a * a, yy += b * b, xy += a * b;
  }
  Agreement result{count, 1, 0};
  if (xx > 0 && yy > 0) result.residual = kSensorResidual + 1 - xy * std::abs(xy) / (xx * yy);
  const double xx_centred = xx - x * x / count, yy_centred = yy - y * y / count;
  if (xx_centred > 1e-9 * xx && yy_centred > 1e-9 * yy) {
    result.correlation = (xy - x * y / count) / std::sqrt(xx_centred * yy_centred);
  }
  return result;
}

double independentSpeeds(const Agreement& agreement, double step) {
  return agreement.overlap * step / kIndependentAfter;
}

double validSteps(const Grid& grid) {
  return static_cast<double>(
      std::count_if(grid.begin(), grid.end(), [](double speed) { return !std::isnan(speed); }));
}

struct Peak {
  std::ptrdiff_t shift = 0;  ///< [steps]
  Agreement at = {};
};

/// Lowest residual near a shift: of the parabola through it and its neighbours at a minimum.
double lowestResidual(const Grid& reference, const Grid& other, const Peak& peak) {
  const double before = compare(reference, other, peak.shift - 1).residual;
  const double after = compare(reference, other, peak.shift + 1).residual;
  const double residual = peak.at.residual, curvature = before + after - 2 * residual;
  if (!(curvature > 0) || std::min(before, after) < residual) return residual;
  return std::max(kSensorResidual, residual - std::pow(after - before, 2) / (8 * curvature));
}

/// The only shift that the speeds do not exclude, up to kPeakWidth; nullopt: there are others.
std::optional<Peak> onlyShift(const Grid& reference, const Grid& other, double step) {
  const double least =
      std::max(std::min(validSteps(reference), validSteps(other)) / 2, kShortestOverlap / step);
  std::vector<Peak> peaks;
  for (auto k = -static_cast<std::ptrdiff_t>(other.size());
       k < static_cast<std::ptrdiff_t>(reference.size()); ++k) {
    const Peak peak{k, compare(reference, other, k)};
    if (peak.at.overlap >= least) peaks.push_back(peak);
  }
  if (peaks.empty()) return std::nullopt;
  const Peak best = *std::min_element(peaks.begin(), peaks.end(), [](const Peak& a, const Peak& b) {
    return a.at.residual < b.at.residual;
  });
  if (best.at.correlation < kLeastCorrelation) return std::nullopt;
  const double excluded =
      lowestResidual(reference, other, best) *
      std::max(kResidualRatio, std::exp(kLikelihoodRatio / independentSpeeds(best.at, step)));
  const bool is_only = std::all_of(peaks.begin(), peaks.end(), [&](const Peak& peak) {
    return static_cast<double>(std::abs(peak.shift - best.shift)) * step <=
               std::max(kPeakWidth, step) ||
           lowestResidual(reference, other, peak) >= excluded;
  });
  return is_only ? std::optional(best) : std::nullopt;
}

}  // namespace

std::optional<ClockOffset> clockOffset(const std::vector<SpeedSample>& reference,
                                       const std::vector<SpeedSample>& other) {
  if (reference.size() < 3 || other.size() < 3) return std::nullopt;
  const double step =
      std::max(kCoarseStep, std::sqrt(spanOf(reference) * spanOf(other) / kMostProducts));
  const auto coarse = onlyShift(resample(reference, step), resample(other, step), step);
  if (!coarse) return std::nullopt;

  const Grid a = resample(reference, kFineStep), b = resample(other, kFineStep);
  const auto fine = [](double time) {
    return static_cast<std::ptrdiff_t>(std::lround(time / kFineStep));
  };
  const std::ptrdiff_t centre = fine(static_cast<double>(coarse->shift) * step);
  Peak peak;
  for (std::ptrdiff_t k = centre - fine(2 * step); k <= centre + fine(2 * step); ++k) {
    const Agreement at = compare(a, b, k);
    if (at.residual < peak.at.residual) peak = {k, at};
  }
  // A parabola through the peak and its neighbours.
  const double before = compare(a, b, peak.shift - fine(kParabola)).residual;
  const double after = compare(a, b, peak.shift + fine(kParabola)).residual;
  const double curvature = (before + after - 2 * peak.at.residual) / (kParabola * kParabola);
  if (!(curvature > 0)) return std::nullopt;
  ClockOffset result;
  result.offset_s = secondsBetween(other.front().stamp_ns, reference.front().stamp_ns) +
                    static_cast<double>(peak.shift) * kFineStep +
                    (before - after) / (2 * kParabola * curvature);
  result.sigma_s =
      std::sqrt(2 * peak.at.residual / (curvature * independentSpeeds(peak.at, kFineStep)));
  result.correlation = peak.at.correlation;
  if (result.sigma_s > kLargestSigma) return std::nullopt;
  return result;
}

}  // namespace gsv
