#include "ground_scale_vo/scale/direct_plane_estimator.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/finite.hpp"
#include "ground_scale_vo/common/median.hpp"
#include "ground_scale_vo/scale/lane_region.hpp"

namespace ground_scale_vo {
namespace {

constexpr int kSide = 8;  ///< samples along a side of a tile
constexpr int kSamples = kSide * kSide;
constexpr int kReferences = 2;
constexpr int kPictures = 12;            ///< kept
constexpr double kSpacing = 0.2;         ///< between kept ones [first baseline]
constexpr double kMinBaseline = 0.2;     ///< [first baseline]
constexpr double kMaxBaselineRatio = 8;  ///< between a picture's distance and the one wanted
constexpr double kSideMargin = 0.12;     ///< around the strip, for later frames [focal lengths]
constexpr double kUpperMargin = 0.04;    ///< likewise
constexpr double kMinBlurPx = 0.6;       ///< less, and the interpolation between pixels shows
constexpr double kKernelReach = 2.5;     ///< of the blur [its sigma]
constexpr int kMinTilePx = 8;
constexpr double kShortestStrip = 6;          ///< beyond the nearest road in the picture
constexpr double kLeastSlope = 0.02;          ///< of a ray down to a road that can be read
constexpr double kConverged = 2e-4;           ///< a relative step of m below this is rest
constexpr int kSpreadIterations = 5;          ///< then the spread of the shifts stays as it is
constexpr double kSearchStep = 0.05;          ///< of ln h
constexpr double kValley = 0.26;              ///< heights this close in ln h belong to one valley
constexpr double kClearCorrelation = 0.92;    ///< of tiles on a road without anything else
constexpr double kFartherCorrelation = 0.75;  ///< of what is asked over the shorter baseline
constexpr float kMatchFloor = 0.01f;          ///< least variance of a normalised residual
/// A tile whose texture runs along the epipolar line but for this share says nothing of q.
constexpr float kAperture = 0.2f;
constexpr float kMinTexture = 1e-3f;
constexpr float kCauchyPixel = 2;      ///< [deviations]
constexpr double kCauchyTile = 2;      ///< [deviations]
constexpr double kForeignSigma = 3;    ///< of a feature's depth
constexpr float kStaticFlow = 0.004f;  ///< a tile of road would have moved [focal lengths]
constexpr float kStaticCorrelation = 0.8f;
constexpr float kStaticLead = 0.1f;  ///< over the correlation of a tile of road
constexpr float kStaticTexture = 0.5f;
constexpr float kStationary = 0.5f;  ///< from here on a cell is masked

using Samples = Eigen::Array<float, kSamples, 1>;
using Vector5f = Eigen::Matrix<float, 5, 1>;
using Matrix9d = Eigen::Matrix<double, 9, 9>;
using Vector9d = Eigen::Matrix<double, 9, 1>;

struct Picture {
  Eigen::Isometry3d T_w_c = Eigen::Isometry3d::Identity();
  cv::Rect roi;     ///< of the image; empty: none
  cv::Mat storage;  ///< as large as the image, so that it stays where it is
  const float* row(int v) const { return storage.ptr<float>(v - roi.y) - roi.x; }
};

struct Tile {
  std::size_t cell = 0;    ///< in the grid of tiles over the image
  bool masked = false;     ///< takes no part
  cv::Point corner;        ///< upper left [px]
  float texture = 0;       ///< share of the variance that is not noise
  Samples ray_x, ray_y;    ///< z = 1
  Samples value;           ///< freed of mean and contrast
  Samples grad_x, grad_y;  ///< of value [1/px]
};

/// An earlier picture and the motion to it.
struct Reference {
  const Picture* picture = nullptr;
  Eigen::Matrix3f R;              ///< y = R r - t (m . r)
  Eigen::Vector3f t;              ///< VO units
  Eigen::Vector3f across[2];      ///< orthogonal to t, of its length
  Matrix9d H = Matrix9d::Zero();  ///< of the plane and of this motion's errors
  Vector9d b = Vector9d::Zero();
};

/// A tile in one earlier picture.
struct Match {
  bool inside = false;  ///< it lies in that picture and is readable
  float correlation = 0;
  float shift = 0;     ///< of q, that the tile asks for
  float variance = 0;  ///< of shift, from the pixels
  Eigen::Vector3f ray;
  Vector5f motion;        ///< shift by the motion's errors: rotation, direction
  bool readable = false;  ///< not all texture runs along the epipolar line
  float per_pixel = 0;    ///< shift of q by a shift in the image [1 / focal length]
  Samples jacobian;       ///< of value by q, mean free; of the first iteration
};

/// How far ahead the lower edge of the picture sees the road [camera heights]; 0: beyond reach.
double nearestRoad(const PinholeCamera& camera, const NormalPrior& prior) {
  const Eigen::Vector3d ray(0, (camera.height - 1 - camera.cy) / camera.fy, 1);
  const double down = -prior.n_c.dot(ray);
  return down > kLeastSlope ? std::abs(prior.forward_c.dot(ray)) / down : 0;
}

/// Frees values of mean and contrast. texture: share of the variance that is not noise. Returns the
/// deviation, noise included.
float normalise(float noise, Samples* values, float* texture) {
  *values -= values->mean();
  const float variance = values->square().mean();
  const float deviation = std::sqrt(variance + noise * noise);
  *values /= deviation;
  *texture = variance / (variance + noise * noise);
  return deviation;
}

/// Frees values of mean and contrast too. Returns how well they correlate with the tile, noise
/// left out.
float correlation(const Tile& tile, float noise, Samples* values) {
  float texture = 0;
  normalise(noise, values, &texture);
  const float product = (tile.value * *values).mean();
  return product / std::sqrt(std::max(tile.texture * texture, kMinTexture));
}

}  // namespace

void DirectPlaneEstimator::Options::validate() const {
  visitParameters(*this, RangeCheck("refinement/"));
  requireInRange("refinement/max_ahead_h", max_ahead_h, min_ahead_h, 1000);
}

struct DirectPlaneEstimator::Impl {
  explicit Impl(const Options& o) : options(o) { options.validate(); }

  void prepare(const PinholeCamera& new_camera);
  double heightOfFeatures(const VoFrame& frame, const LaneRegion& strip,
                          const NormalPrior& prior) const;
  void markForeign(const VoFrame& frame, const NormalPrior& prior, double height);
  void cutTiles(const cv::Mat& image, const LaneRegion& strip);
  void chooseReferences(double height);
  bool sample(const Reference& reference, const Tile& tile, const Eigen::Vector3f& m,
              Samples* values) const;
  void linearise(const Reference& reference, const Tile& tile, const Eigen::Vector3f& m,
                 Match* match) const;
  void measure(const Reference& reference, const Tile& tile, const Eigen::Vector3f& m,
               Match* match) const;
  double correlate(const Reference& reference, const Eigen::Vector3f& m) const;
  double search(const NormalPrior& prior, double middle) const;
  Result alignFrom(const NormalPrior& prior, double height);
  bool isSearchDue(const Eigen::Vector3d& here_w, double height) const;
  void unmaskForeign();
  void learnStatic(const NormalPrior& prior, double height, bool aligned);
  void keep(double height);

  const Options options;
  PinholeCamera camera;
  int tile_px = 0, columns = 0, rows = 0;
  cv::Mat kernel, twice_smooth;
  std::vector<Picture> pictures;  ///< first the present one, then `kept` earlier ones, newest first
  std::size_t kept = 0;
  std::vector<int> foreign;       ///< by cell: features off the plane less those on it
  std::vector<float> stationary;  ///< by cell: 1 stands still in the image, 0 moves with the road

  std::vector<Tile> tiles;
  std::vector<Reference> references;
  std::vector<Match> matches;  ///< of tile i in reference k: i * kReferences + k
  mutable std::vector<double> scratch;
  std::optional<Eigen::Vector3d> sure_at_w;  ///< the last alignment, or search
};

/// For another camera than before: everything of the image's size.
void DirectPlaneEstimator::Impl::prepare(const PinholeCamera& new_camera) {
  const auto same = [](const PinholeCamera& a, const PinholeCamera& b) {
    return a.width == b.width && a.height == b.height && a.fx == b.fx && a.fy == b.fy &&
           a.cx == b.cx && a.cy == b.cy;
  };
  if (same(camera, new_camera)) return;
  camera = new_camera;
  tile_px = std::max(kMinTilePx, static_cast<int>(std::lround(options.tile * camera.fx)));
  columns = camera.width / tile_px;
  rows = camera.height / tile_px;
  const double blur_px = std::max(kMinBlurPx, options.blur * camera.fx);
  const int reach = static_cast<int>(std::ceil(kKernelReach * blur_px));
  kernel = cv::getGaussianKernel(2 * reach + 1, blur_px, CV_32F);
  pictures.assign(kPictures + 1, Picture());
  for (Picture& picture : pictures) picture.storage.create(camera.height, camera.width, CV_32F);
  twice_smooth.create(camera.height, camera.width, CV_32F);
  kept = 0;
  const std::size_t cells = static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  foreign.assign(cells, 0);
  stationary.assign(cells, 0.f);
  tiles.reserve(cells);
  matches.reserve(cells * kReferences);
  scratch.reserve(cells * kReferences);
  references.reserve(kReferences);
}

/// Median height of the camera over the features in the strip, each taken as road [VO units]: the
/// order of magnitude of the height. 0: there are none.
double DirectPlaneEstimator::Impl::heightOfFeatures(const VoFrame& frame, const LaneRegion& strip,
                                                    const NormalPrior& prior) const {
  std::vector<double> heights;
  for (const TrackedFeature& feature : frame.features) {
    if (!hasUsablePoint(feature) || !strip.contains(camera.ray(feature.u.cast<double>()))) continue;
    const double height = -prior.n_c.dot(feature.p_c.cast<double>());
    if (height > 0) heights.push_back(height);
  }
  return heights.empty() ? 0 : median(&heights);
}

/// Cells in which more features lie off the expected plane than on it.
void DirectPlaneEstimator::Impl::markForeign(const VoFrame& frame, const NormalPrior& prior,
                                             double height) {
  std::fill(foreign.begin(), foreign.end(), 0);
  if (!(height > 0)) return;
  const auto right = static_cast<float>(columns * tile_px);
  const auto bottom = static_cast<float>(rows * tile_px);
  for (const TrackedFeature& feature : frame.features) {
    const Eigen::Vector2f& u = feature.u;
    if (!hasUsablePoint(feature) ||
        !(u.x() >= 0 && u.y() >= 0 && u.x() < right && u.y() < bottom)) {
      continue;
    }
    const int column = static_cast<int>(u.x()) / tile_px, row = static_cast<int>(u.y()) / tile_px;
    const double expected = -prior.n_c.dot(camera.ray(feature.u.cast<double>())) / height;
    const double z = feature.p_c.z();
    const double off = std::abs(1 / z - expected);
    const double allowed =
        options.foreign_h * expected + kForeignSigma * feature.depth_sigma / (z * z);
    foreign[static_cast<std::size_t>(row * columns + column)] += off > allowed ? 1 : -1;
  }
}

/// The present picture, and its tiles in the strip.
void DirectPlaneEstimator::Impl::cutTiles(const cv::Mat& image, const LaneRegion& strip) {
  tiles.clear();
  Picture& picture = pictures.front();
  picture.roi = cv::Rect();
  // A cell at the image's edge has no gradient there.
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const cv::Rect square(column * tile_px, row * tile_px, tile_px, tile_px);
      if (column == 0 || square.br().x >= camera.width || square.br().y >= camera.height) continue;
      const cv::Point centre = (square.tl() + square.br()) / 2;
      if (row == 0 || !strip.contains(camera.ray({centre.x, centre.y}))) continue;
      Tile& tile = tiles.emplace_back();
      tile.cell = static_cast<std::size_t>(row * columns + column);
      tile.corner = square.tl();
      tile.masked = foreign[tile.cell] > 0 || stationary[tile.cell] > kStationary;
      picture.roi |= square;
    }
  }
  if (tiles.empty()) return;
  const int side = static_cast<int>(kSideMargin * camera.fx);
  const int above = static_cast<int>(kUpperMargin * camera.fy);
  picture.roi -= cv::Point(side, above);
  picture.roi += cv::Size(2 * side, above + tile_px);
  picture.roi &= cv::Rect(0, 0, camera.width, camera.height);
  cv::Mat smooth = picture.storage(cv::Rect({0, 0}, picture.roi.size()));
  cv::sepFilter2D(image(picture.roi), smooth, CV_32F, kernel, kernel);
  // The earlier pictures show this road from farther off, smaller and so more blurred: what is
  // compared with them is smoothed once more. Without that the difference in sharpness moves tiles.
  cv::Mat smoother = twice_smooth(cv::Rect({0, 0}, picture.roi.size()));
  cv::sepFilter2D(smooth, smoother, CV_32F, kernel, kernel, {-1, -1}, 0,
                  cv::BORDER_REFLECT_101 | cv::BORDER_ISOLATED);

  const auto stride = static_cast<std::ptrdiff_t>(twice_smooth.step1());
  for (Tile& tile : tiles) {
    for (int k = 0; k < kSamples; ++k) {
      const int u = tile.corner.x + (2 * (k % kSide) + 1) * tile_px / (2 * kSide);
      const int v = tile.corner.y + (2 * (k / kSide) + 1) * tile_px / (2 * kSide);
      const float* pixel = smoother.ptr<float>(v - picture.roi.y) + (u - picture.roi.x);
      tile.ray_x[k] = static_cast<float>((u - camera.cx) / camera.fx);
      tile.ray_y[k] = static_cast<float>((v - camera.cy) / camera.fy);
      tile.value[k] = *pixel;
      tile.grad_x[k] = 0.5f * (pixel[1] - pixel[-1]);
      tile.grad_y[k] = 0.5f * (pixel[stride] - pixel[-stride]);
    }
    const float deviation =
        normalise(static_cast<float>(options.noise), &tile.value, &tile.texture);
    tile.grad_x /= deviation;
    tile.grad_y /= deviation;
  }
}

/// The earlier pictures whose distances are nearest to one and two baselines.
void DirectPlaneEstimator::Impl::chooseReferences(double height) {
  references.clear();
  const Picture& present = pictures.front();
  const double baseline = options.baseline_h * height;
  const Picture* first = nullptr;
  for (int k = 1; k <= kReferences; ++k) {
    const Picture* best = nullptr;
    double best_ratio = kMaxBaselineRatio;
    for (std::size_t i = 1; i <= kept; ++i) {
      const Picture& picture = pictures[i];
      const double distance = (picture.T_w_c.translation() - present.T_w_c.translation()).norm();
      if (picture.roi.empty() || &picture == first || distance < kMinBaseline * baseline) continue;
      const double ratio = std::max(distance / (k * baseline), k * baseline / distance);
      if (ratio < best_ratio) {
        best_ratio = ratio;
        best = &picture;
      }
    }
    if (best == nullptr) return;
    first = best;
    const Eigen::Isometry3d T_then_now = best->T_w_c.inverse() * present.T_w_c;
    Reference reference;
    reference.picture = best;
    reference.R = T_then_now.linear().cast<float>();
    reference.t = T_then_now.translation().cast<float>();
    reference.across[0] = reference.t.unitOrthogonal() * reference.t.norm();
    reference.across[1] = reference.t.normalized().cross(reference.across[0]);
    references.push_back(reference);
  }
}

/// The tile's samples in an earlier picture under the plane m. False: not all lie in it.
bool DirectPlaneEstimator::Impl::sample(const Reference& reference, const Tile& tile,
                                        const Eigen::Vector3f& m, Samples* values) const {
  const Picture& picture = *reference.picture;
  const Eigen::Matrix3f A = reference.R - reference.t * m.transpose();
  const auto fx = static_cast<float>(camera.fx), fy = static_cast<float>(camera.fy);
  const auto cx = static_cast<float>(camera.cx - picture.roi.x);
  const auto cy = static_cast<float>(camera.cy - picture.roi.y);
  const auto right = static_cast<float>(picture.roi.width - 1);
  const auto bottom = static_cast<float>(picture.roi.height - 1);
  const float* const data = picture.storage.ptr<float>();
  const auto stride = static_cast<std::ptrdiff_t>(picture.storage.step1());
  const Samples z = A(2, 0) * tile.ray_x + A(2, 1) * tile.ray_y + A(2, 2);
  if (!(z > 0).all()) return false;  // nor when it is no number
  const Samples u = fx * (A(0, 0) * tile.ray_x + A(0, 1) * tile.ray_y + A(0, 2)) / z + cx;
  const Samples v = fy * (A(1, 0) * tile.ray_x + A(1, 1) * tile.ray_y + A(1, 2)) / z + cy;
  if (!(u >= 0 && v >= 0 && u < right && v < bottom).all()) return false;
  for (int i = 0; i < kSamples; ++i) {
    const auto left = static_cast<int>(u[i]), above = static_cast<int>(v[i]);
    const float a = u[i] - static_cast<float>(left), b = v[i] - static_cast<float>(above);
    const float* p = data + above * stride + left;
    const float upper = p[0] + a * (p[1] - p[0]);
    const float lower = p[stride] + a * (p[stride + 1] - p[stride]);
    (*values)[i] = upper + b * (lower - upper);
  }
  return true;
}

/// How the samples in the earlier picture answer to q and to errors of the motion. The gradient is
/// that of the present picture, carried over by the plane's homography.
void DirectPlaneEstimator::Impl::linearise(const Reference& reference, const Tile& tile,
                                           const Eigen::Vector3f& m, Match* match) const {
  const Eigen::Matrix3f A = reference.R - reference.t * m.transpose();
  const auto fx = static_cast<float>(camera.fx), fy = static_cast<float>(camera.fy);
  float mean = 0, squares = 0;
  Vector5f motion_mean = Vector5f::Zero(), motion = Vector5f::Zero();
  Eigen::Vector2f slope_mean(0, 0), slope(0, 0);  // of the value by the place in the image
  float slope_squares = 0, along_squares = 0;
  for (int i = 0; i < kSamples; ++i) {
    const Eigen::Vector3f ray(tile.ray_x[i], tile.ray_y[i], 1.f);
    const Eigen::Vector3f y = A * ray;
    const float z = y.z(), xn = y.x() / z, yn = y.y() / z;
    // Present pixel to earlier pixel, in focal lengths, and its inverse transposed on the gradient.
    const float a = (A(0, 0) - xn * A(2, 0)) / z, b = (A(0, 1) - xn * A(2, 1)) / z;
    const float c = (A(1, 0) - yn * A(2, 0)) / z, d = (A(1, 1) - yn * A(2, 1)) / z;
    const float determinant = a * d - b * c;
    const float gx = tile.grad_x[i] * fx, gy = tile.grad_y[i] * fy;
    const float hx = (d * gx - c * gy) / (determinant * z);
    const float hy = (a * gy - b * gx) / (determinant * z);
    // Change of the value by a change of y.
    const Eigen::Vector3f by_y(hx, hy, -hx * xn - hy * yn);
    const float j = -by_y.dot(reference.t);
    const float q = m.dot(ray);
    Vector5f by_motion;
    const Eigen::Vector3f turn = y.cross(by_y);
    by_motion << turn.x(), turn.y(), turn.z(), -q * by_y.dot(reference.across[0]),
        -q * by_y.dot(reference.across[1]);
    match->jacobian[i] = j;
    slope_mean += Eigen::Vector2f(hx, hy) * z / kSamples;
    slope += j * z * Eigen::Vector2f(hx, hy);
    slope_squares += (hx * hx + hy * hy) * z * z;
    along_squares +=
        (Eigen::Vector2f(xn, yn) * reference.t.z() - reference.t.head<2>()).squaredNorm() /
        (z * z * kSamples);
    mean += j / kSamples;
    squares += j * j;
    motion_mean += by_motion / kSamples;
    motion += j * by_motion;
  }
  match->jacobian -= mean;
  const float information =
      std::max(squares - kSamples * mean * mean, std::numeric_limits<float>::min());
  match->readable = information > kAperture * kAperture * along_squares *
                                      (slope_squares - kSamples * slope_mean.squaredNorm());
  match->motion = (motion - kSamples * mean * motion_mean) / information;
  match->per_pixel = (slope - kSamples * mean * slope_mean).norm() / information;
}

/// The shift of q that the tile asks for at the plane m.
void DirectPlaneEstimator::Impl::measure(const Reference& reference, const Tile& tile,
                                         const Eigen::Vector3f& m, Match* match) const {
  Samples values;
  match->inside = sample(reference, tile, m, &values);
  if (!match->inside) return;
  match->correlation = correlation(tile, static_cast<float>(options.noise), &values);
  const Samples residual = tile.value - values;
  const Samples squares = residual.square();
  // Cauchy weights, then one step along q.
  const float scale =
      kSamples / (kCauchyPixel * kCauchyPixel * std::max(squares.sum(), kMatchFloor));
  const Samples weight = 1 / (1 + squares * scale);
  const Samples wj = weight * match->jacobian;
  const Samples wjj = wj * match->jacobian;
  const float information = wjj.sum();
  match->inside = match->readable && information > 0;
  match->shift = (wj * residual).sum() / information;
  const float registration = match->per_pixel * static_cast<float>(options.registration);
  match->variance = ((weight * squares).sum() / weight.sum() + kMatchFloor) / information +
                    registration * registration;
  match->ray = Eigen::Vector3f((wjj * tile.ray_x).sum() / information,
                               (wjj * tile.ray_y).sum() / information, 1.f);
}

/// Mean correlation of the tiles under the plane m, weighted by texture; -1 when too few tiles of
/// the strip lie in the earlier picture.
double DirectPlaneEstimator::Impl::correlate(const Reference& reference,
                                             const Eigen::Vector3f& m) const {
  double sum = 0, weights = 0, all = 0;
  int inside = 0;
  Samples values;
  for (std::size_t i = 0; i < tiles.size(); i += 2) {  // half of them tell the valley
    const Tile& tile = tiles[i];
    if (tile.masked) continue;
    all += tile.texture;
    if (!sample(reference, tile, m, &values)) continue;
    sum += tile.texture * correlation(tile, static_cast<float>(options.noise), &values);
    weights += tile.texture;
    ++inside;
  }
  return 2 * inside >= options.min_tiles && weights > 0.5 * all ? sum / weights : -1;
}

/// The height at which both baselines see one and the same clear valley, around `middle`; 0: none.
double DirectPlaneEstimator::Impl::search(const NormalPrior& prior, double middle) const {
  if (references.size() < kReferences) return 0;
  const int half = static_cast<int>(std::ceil(std::log(options.search_range) / kSearchStep));
  std::array<double, kReferences> found{};
  for (std::size_t k = 0; k < kReferences; ++k) {
    std::vector<double>& score = scratch;
    score.clear();
    for (int i = -half; i <= half; ++i) {
      const double height = middle * std::exp(kSearchStep * i);
      score.push_back(correlate(references[k], (prior.n_c / height).cast<float>()));
    }
    const auto best = std::max_element(score.begin(), score.end());
    double rival = -1;
    for (auto other = score.begin(); other != score.end(); ++other) {
      if (std::abs(static_cast<double>(other - best)) * kSearchStep > kValley) {
        rival = std::max(rival, *other);
      }
    }
    const double least =
        k == 0 ? options.search_correlation : kFartherCorrelation * options.search_correlation;
    if (*best < least || *best - rival < options.search_lead) return 0;
    found[k] = middle * std::exp(kSearchStep * static_cast<double>(best - score.begin() - half));
  }
  return std::abs(std::log(found[0] / found[1])) < options.search_agreement ? found[1] : 0;
}

DirectPlaneEstimator::Result DirectPlaneEstimator::Impl::alignFrom(const NormalPrior& prior,
                                                                   double height) {
  Result result;
  Eigen::Vector3d m = prior.n_c / height;
  matches.resize(tiles.size() * kReferences);
  Eigen::Matrix4d H = Eigen::Matrix4d::Zero();  // of the plane and the bend
  double spread = 1;
  bool rests = false;
  for (int iteration = 0; iteration < options.max_iterations && !rests; ++iteration) {
    const Eigen::Vector3f m_float = m.cast<float>();
    double correlation = 0, weights = 0;
    result.tiles = 0;
    scratch.clear();
    const auto variance = [&](const Match& match) {
      const double rough = options.roughness_h * m_float.dot(match.ray);
      return match.variance + kReferences * rough * rough;
    };
    for (std::size_t i = 0; i < tiles.size(); ++i) {
      if (tiles[i].masked) continue;
      for (std::size_t k = 0; k < references.size(); ++k) {
        Match& match = matches[i * kReferences + k];
        if (iteration == 0) linearise(references[k], tiles[i], m_float, &match);
        measure(references[k], tiles[i], m_float, &match);
        if (!match.inside) continue;
        ++result.tiles;
        correlation += tiles[i].texture * match.correlation;
        weights += tiles[i].texture;
        scratch.push_back(std::abs(match.shift) / std::sqrt(variance(match)));
      }
    }
    if (result.tiles < options.min_tiles || !(weights > 0)) return result;
    result.correlation = correlation / weights;
    if (iteration < kSpreadIterations) spread = std::max(1.0, kSigmaOfMad * median(&scratch));

    // Plane and errors of the motion, from the shifts; then without the latter.
    for (Reference& reference : references) {
      reference.H.setZero();
      reference.b.setZero();
    }
    for (std::size_t i = 0; i < tiles.size(); ++i) {
      if (tiles[i].masked) continue;
      for (std::size_t k = 0; k < references.size(); ++k) {
        const Match& match = matches[i * kReferences + k];
        if (!match.inside) continue;
        Vector9d row;
        const Eigen::Vector3d ray = match.ray.cast<double>();
        const double q = m.dot(ray);
        const double ahead = prior.forward_c.dot(ray) / (-q * height);  // [camera heights]
        row << ray, -0.5 * q * ahead * ahead, match.motion.cast<double>();
        const double expected = variance(match) * spread * spread;
        const double shift = match.shift;
        const double weight = 1 / (expected + shift * shift / (kCauchyTile * kCauchyTile));
        references[k].H.noalias() += weight * row * row.transpose();
        references[k].b += weight * shift * row;
      }
    }
    H.setZero();
    Eigen::Vector4d b = Eigen::Vector4d::Zero();
    for (Reference& reference : references) {
      reference.H.diagonal().segment<3>(4).array() += std::pow(options.rotation_sigma_rad, -2);
      reference.H.diagonal().tail<2>().array() += std::pow(options.direction_sigma_rad, -2);
      const Eigen::Matrix<double, 4, 5> cross = reference.H.topRightCorner<4, 5>();
      const Eigen::LDLT<Eigen::Matrix<double, 5, 5>> motion(reference.H.bottomRightCorner<5, 5>());
      H += reference.H.topLeftCorner<4, 4>() - cross * motion.solve(cross.transpose());
      b += reference.b.head<4>() - cross * motion.solve(reference.b.tail<5>());
    }
    for (const auto& [axis, sigma] : {std::pair(prior.forward_c, prior.pitch_sigma),
                                      std::pair(prior.lateral(), prior.roll_sigma)}) {
      const Eigen::Vector3d jacobian = height * axis / sigma;
      H.topLeftCorner<3, 3>() += jacobian * jacobian.transpose();
      b.head<3>() -= jacobian * jacobian.dot(m);
    }
    H(3, 3) += std::pow(options.bend_sigma, -2);
    const Eigen::Vector3d step = H.ldlt().solve(b).head<3>();
    if (!isFinite(step)) return result;
    m += step;
    if (!(m.dot(prior.n_c) > 0)) return result;
    rests = step.norm() < kConverged * m.norm();
  }
  result.plane = {m.normalized(), 1 / m.norm()};
  const Eigen::Vector3d n_c = result.plane.n_c;
  const double relative =
      result.plane.height * std::sqrt(n_c.dot(H.inverse().topLeftCorner<3, 3>() * n_c));
  // What correlates less than clear road does is partly something else: not known so well.
  const double doubt = std::max(1.0, (1 - result.correlation) / (1 - kClearCorrelation));
  result.height_sigma = doubt * relative * result.plane.height;
  const double factor = std::abs(std::log(result.plane.height / height));
  if (result.correlation >= options.min_correlation && factor <= std::log(options.max_step) &&
      relative <= options.max_sigma) {
    result.status = ScaleReason::kNone;
  }
  return result;
}

/// While the height is not known (0), always; else when nothing was found for some way.
bool DirectPlaneEstimator::Impl::isSearchDue(const Eigen::Vector3d& here_w, double height) const {
  return !sure_at_w || !(height > 0) ||
         (here_w - *sure_at_w).norm() > options.search_every_h * height;
}

/// Whether features lie on a plane is not known when the plane is sought.
void DirectPlaneEstimator::Impl::unmaskForeign() {
  for (Tile& tile : tiles) tile.masked = stationary[tile.cell] > kStationary;
}

/// What stands still in the image while the camera moves belongs to the vehicle: hood, its shadow.
void DirectPlaneEstimator::Impl::learnStatic(const NormalPrior& prior, double height,
                                             bool aligned) {
  if (references.empty() || kept == 0) return;
  const Reference& reference = references.front();
  const double step = (pictures[1].T_w_c.translation() - pictures[0].T_w_c.translation()).norm();
  const auto rate = static_cast<float>(std::min(1.0, step / (options.static_memory_h * height)));
  const Eigen::Vector3f m = (prior.n_c / height).cast<float>();
  const cv::Rect& roi = reference.picture->roi;
  const auto noise = static_cast<float>(options.noise);
  Samples values;
  for (const Tile& tile : tiles) {
    const cv::Rect square(tile.corner, cv::Size(tile_px, tile_px));
    if ((square & roi) != square) continue;
    const Eigen::Vector3f ray(tile.ray_x[0], tile.ray_y[0], 1.f);
    const Eigen::Vector3f y = reference.R * ray - reference.t * m.dot(ray);
    if (!((y / y.z() - ray).norm() > kStaticFlow)) continue;
    for (int i = 0; i < kSamples; ++i) {
      const auto u = static_cast<int>(std::lround(tile.ray_x[i] * camera.fx + camera.cx));
      const auto v = static_cast<int>(std::lround(tile.ray_y[i] * camera.fy + camera.cy));
      values[i] = reference.picture->row(v)[u];
    }
    const float still = correlation(tile, noise, &values);
    const float moving =
        aligned && sample(reference, tile, m, &values) ? correlation(tile, noise, &values) : 0.f;
    const bool stands =
        tile.texture > kStaticTexture && still > kStaticCorrelation && still > moving + kStaticLead;
    stationary[tile.cell] += rate * ((stands ? 1.f : 0.f) - stationary[tile.cell]);
  }
}

/// Puts the present picture to the earlier ones; in the place of the newest when that one is so
/// near to its predecessor that it adds nothing.
void DirectPlaneEstimator::Impl::keep(double height) {
  if (pictures.front().roi.empty()) return;
  const bool crowded =
      kept >= 2 && (pictures[1].T_w_c.translation() - pictures[2].T_w_c.translation()).norm() <
                       kSpacing * options.baseline_h * height;
  if (crowded) {
    std::swap(pictures[0], pictures[1]);
  } else {
    std::rotate(pictures.begin(), pictures.end() - 1, pictures.end());
    kept = std::min(kept + 1, pictures.size() - 1);
  }
}

DirectPlaneEstimator::DirectPlaneEstimator(const Options& options)
    : impl_(std::make_unique<Impl>(options)) {}

DirectPlaneEstimator::~DirectPlaneEstimator() = default;

void DirectPlaneEstimator::reset() {
  impl_->kept = 0;
  impl_->sure_at_w.reset();
}

DirectPlaneEstimator::Result DirectPlaneEstimator::align(
    const VoFrame& frame, const cv::Mat& image, const NormalPrior& prior,
    const std::optional<MotionHistory::Chord>& chord, double height) {
  Impl& s = *impl_;
  s.prepare(frame.camera);
  s.pictures.front().T_w_c = frame.T_w_c;
  // A tele lens sees no road near by.
  const double farthest =
      std::max(s.options.max_ahead_h, nearestRoad(frame.camera, prior) + kShortestStrip);
  const LaneRegion strip(prior, chord, height, s.options.min_ahead_h, farthest,
                         s.options.half_width_h);
  s.markForeign(frame, prior, height);
  s.cutTiles(image, strip);
  const double rough = height > 0 ? height : s.heightOfFeatures(frame, strip, prior);

  Result result;
  result.status = ScaleReason::kStandstill;
  if (rough > 0) s.chooseReferences(rough);
  if (rough > 0 && !s.references.empty()) {
    result.status = ScaleReason::kNoPlane;
    if (height > 0) result = s.alignFrom(prior, height);
    const Eigen::Vector3d& here = s.pictures.front().T_w_c.translation();
    const bool lost = result.status != ScaleReason::kNone;
    if (lost && s.isSearchDue(here, height)) {
      s.unmaskForeign();
      const double middle = s.heightOfFeatures(frame, strip, prior);
      s.chooseReferences(middle);
      const double found = middle > 0 ? s.search(prior, middle) : 0;
      if (found > 0) result = s.alignFrom(prior, found);
      result.searched = true;
    }
    if (!lost || result.searched) s.sure_at_w = here;
    const bool aligned = result.status == ScaleReason::kNone;
    s.learnStatic(prior, aligned ? result.plane.height : rough, aligned);
  }
  if (rough > 0) s.keep(rough);
  return result;
}

}  // namespace ground_scale_vo
