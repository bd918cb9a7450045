// The Python module ground_scale_vo._core: the core and the evaluation with numpy arrays in place
// of cv::Mat and Eigen. ground_scale_vo/__init__.py is its only user, checks types and shapes, and
// documents the results.

#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <mutex>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "ground_scale_vo/calibration/lens_calibration.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/set_option.hpp"
#include "ground_scale_vo/evaluation/run_record.hpp"
#include "ground_scale_vo/evaluation/run_report.hpp"
#include "ground_scale_vo/io/image_reader.hpp"
#include "ground_scale_vo/io/kitti_sequence.hpp"
#include "ground_scale_vo/io/text_file.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"
#include "ground_scale_vo/metric_odometry.hpp"

namespace gsv = ground_scale_vo;
namespace py = pybind11;

namespace {

using Output = gsv::MetricOdometry::Output;
using Poses = std::vector<Eigen::Isometry3d>;
using RowMajor4d = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;
using Bytes = py::array_t<std::uint8_t, py::array::c_style>;
using Reals = py::array_t<double, py::array::c_style>;
using CameraTuple = std::tuple<int, int, double, double, double, double, bool>;

/// A copy: the caller may write to the array later.
cv::Mat toImage(const Bytes& array) {
  return cv::Mat(static_cast<int>(array.shape(0)), static_cast<int>(array.shape(1)), CV_8UC1,
                 const_cast<std::uint8_t*>(array.data()))
      .clone();
}

/// rows x columns, or rows x columns x channels. Precondition: the image is continuous.
Bytes fromImage(const cv::Mat& image) {
  auto* owned = new cv::Mat(image);
  const py::capsule owner(owned, [](void* mat) { delete static_cast<cv::Mat*>(mat); });
  std::vector<py::ssize_t> shape{image.rows, image.cols};
  if (image.channels() > 1) shape.push_back(image.channels());
  return Bytes(shape, image.data, owner);
}

/// N x 4 x 4; none: no poses. Throws OptionError.
Poses toPoses(const std::optional<Reals>& array, const std::string& name) {
  Poses poses;
  for (py::ssize_t i = 0; array && i < array->shape(0); ++i) {
    const Eigen::Map<const RowMajor4d> m(array->data(i));
    const auto pose = gsv::rigidTransform(m.topLeftCorner<3, 3>(), m.topRightCorner<3, 1>());
    if (!pose || m.row(3) != Eigen::RowVector4d(0, 0, 0, 1)) {
      throw gsv::OptionError(name + "[" + std::to_string(i) + "] is not a finite rigid transform");
    }
    poses.push_back(*pose);
  }
  return poses;
}

Reals fromPoses(const Poses& poses) {
  Reals array({static_cast<py::ssize_t>(poses.size()), py::ssize_t{4}, py::ssize_t{4}});
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const auto row = static_cast<py::ssize_t>(i);
    Eigen::Map<RowMajor4d>(array.mutable_data(row)) = poses[i].matrix();
  }
  return array;
}

/// None: no heights. Throws OptionError.
std::vector<double> toHeights(const std::optional<Reals>& array, const std::string& name) {
  if (!array) return {};
  for (py::ssize_t i = 0; i < array->size(); ++i) {
    gsv::requireInRange((name + "[" + std::to_string(i) + "]").c_str(), array->data()[i],
                        gsv::kMinCameraHeight, gsv::kMaxCameraHeight);
  }
  return {array->data(), array->data() + array->size()};
}

gsv::MetricOdometry::Options makeOptions(double camera_height,
                                         const std::vector<std::string>& settings) {
  gsv::MetricOdometry::Options options;
  for (const std::string& setting : settings) gsv::setOption(options, setting);
  options.scale.camera_height = camera_height;
  return options;
}

gsv::PinholeCamera makeCamera(const CameraTuple& camera) {
  const auto [width, height, fx, fy, cx, cy, lens_is_estimated] = camera;
  gsv::PinholeCamera result{width, height, fx, fy, cx, cy, lens_is_estimated};
  result.validate();
  return result;
}

/// The features of a frame: pixels (N x 2), ids (N), and points (N x 3) [m], NaN where there is
/// none or the scale is unknown.
void addTracks(const Output& output, py::dict* result) {
  const std::vector<gsv::TrackedFeature>& features = output.vo.frame.features;
  const auto n = static_cast<py::ssize_t>(features.size());
  py::array_t<float> tracks({n, py::ssize_t{2}}), points({n, py::ssize_t{3}});
  py::array_t<std::uint64_t> ids(n);
  const double scale = output.scale.scale.scale > 0 ? output.scale.scale.scale : NAN;
  for (py::ssize_t i = 0; i < n; ++i) {
    const gsv::TrackedFeature& feature = features[static_cast<std::size_t>(i)];
    const auto metres = static_cast<float>(feature.has_point ? scale : NAN);
    Eigen::Map<Eigen::Vector2f>(tracks.mutable_data(i)) = feature.u;
    Eigen::Map<Eigen::Vector3f>(points.mutable_data(i)) = metres * feature.p_c;
    *ids.mutable_data(i) = feature.id;
  }
  (*result)["tracks"] = tracks;
  (*result)["track_ids"] = ids;
  (*result)["points"] = points;
}

/// The fields of the Python class Result.
py::dict toResult(const Output& output) {
  const gsv::ScaleEstimate& estimate = output.scale.scale;
  const bool is_known = estimate.status != gsv::ScaleStatus::kUnknown;
  py::dict result;
  result["stamp"] = output.vo.frame.stamp_ns;
  result["status"] = gsv::toString(output.status());
  result["scale_status"] = gsv::toString(estimate.status);
  result["reason"] = gsv::toString(estimate.reason);
  result["map_id"] = output.vo.frame.map_id;
  for (const char* name : {"pose", "covariance", "scale", "sigma", "plane"}) {
    result[name] = py::none();
  }
  if (const auto& pose = output.pose()) {
    result["pose"] = py::cast(Eigen::Matrix4d(pose->T_o_c.matrix()));
    result["covariance"] = py::cast(pose->covariance);
  }
  if (is_known) {
    result["scale"] = estimate.scale;
    result["sigma"] = estimate.sigma;
  }
  if (is_known && !estimate.n_c.isZero()) {
    Eigen::Vector4d plane;
    plane << estimate.n_c, estimate.scale * estimate.height;
    result["plane"] = py::cast(plane);
  }
  addTracks(output, &result);
  return result;
}

/// MetricOdometry, and on request the record of its run. Processes one image at a time, also when
/// several threads call it.
class Odometry {
 public:
  Odometry(const CameraTuple& camera, double camera_height,
           const std::vector<std::string>& settings, const std::optional<Bytes>& mask, bool record)
      : camera_height_(camera_height),
        odometry_(makeCamera(camera), makeOptions(camera_height, settings),
                  mask ? toImage(*mask) : cv::Mat()) {
    if (record) record_.emplace();
  }

  py::dict process(const Bytes& image_array, std::int64_t stamp_ns) {
    const cv::Mat image = toImage(image_array);
    Output output;
    {
      const py::gil_scoped_release release;
      const std::lock_guard<std::mutex> lock(mutex_);
      if (stamp_ns <= last_stamp_ns_) {
        throw gsv::OptionError("stamp is " + std::to_string(stamp_ns) +
                               ", it must be greater than that of the previous image, " +
                               std::to_string(last_stamp_ns_));
      }
      output = odometry_.process(image, stamp_ns);
      last_stamp_ns_ = stamp_ns;
      if (record_) record_->append(output.vo, output.scale);
    }
    return toResult(output);
  }

  Reals poses() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return fromPoses(record().metricPoses());
  }

  std::string metrics(const std::optional<Reals>& poses, const std::optional<Reals>& heights) {
    const std::lock_guard<std::mutex> lock(mutex_);
    return gsv::metricsJson(record(), camera_height_, truePoses(poses), trueHeights(heights));
  }

  void write(const std::string& folder, const std::optional<Reals>& poses,
             const std::optional<Reals>& heights) {
    const std::lock_guard<std::mutex> lock(mutex_);
    gsv::writeRun(folder, record(), camera_height_, truePoses(poses), trueHeights(heights));
  }

 private:
  /// Throws OptionError without a record.
  const gsv::RunRecord& record() const {
    if (!record_) throw gsv::OptionError("record is False: MetricOdometry keeps no record");
    return *record_;
  }

  Poses truePoses(const std::optional<Reals>& array) const {
    Poses poses = toPoses(array, "ground_truth");
    requireLength("ground_truth", poses.size());
    return poses;
  }

  std::vector<double> trueHeights(const std::optional<Reals>& array) const {
    std::vector<double> heights = toHeights(array, "ground_truth_heights");
    requireLength("ground_truth_heights", heights.size());
    return heights;
  }

  /// Throws OptionError unless there is an entry for each recorded image, or none.
  void requireLength(const std::string& name, std::size_t length) const {
    const std::size_t images = record().frames().size();
    if (length == 0 || length == images) return;
    throw gsv::OptionError(name + " has " + std::to_string(length) + " entries, but " +
                           std::to_string(images) + " images are recorded");
  }

  const double camera_height_;
  gsv::MetricOdometry odometry_;
  std::optional<gsv::RunRecord> record_;
  std::mutex mutex_;
  std::int64_t last_stamp_ns_ = -1;
};

/// Iterates over (image, stamp) of a folder; decodes each image while the caller processes the
/// previous one.
class KittiIterator {
 public:
  explicit KittiIterator(std::shared_ptr<gsv::KittiSequence> sequence)
      : sequence_(std::move(sequence)),
        reader_(sequence_->size(), [this](std::size_t i) { return sequence_->image(i); }) {}

  /// After an error, as a Python generator: no further image.
  std::pair<Bytes, std::int64_t> next() {
    const std::size_t i = std::exchange(index_, sequence_->size());
    if (i >= sequence_->size()) throw py::stop_iteration();
    const cv::Mat image = reader_.next().image;
    index_ = i + 1;
    return {fromImage(image), sequence_->stampNs(i)};
  }

 private:
  const std::shared_ptr<gsv::KittiSequence> sequence_;
  gsv::ImageReader reader_;
  std::size_t index_ = 0;
};

void addKitti(py::module* module) {
  using Sequence = gsv::KittiSequence;
  py::class_<KittiIterator>(*module, "KittiIterator")
      .def("__iter__", [](py::object self) { return self; })
      .def("__next__", &KittiIterator::next);
  py::class_<Sequence, std::shared_ptr<Sequence>>(*module, "KittiSequence")
      .def(py::init([](const std::string& folder) { return std::make_shared<Sequence>(folder); }))
      .def("name", &Sequence::name)
      .def("camera",
           [](const Sequence& sequence) {
             const gsv::PinholeCamera& c = sequence.camera();
             return CameraTuple(c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.lens_is_estimated);
           })
      .def("stamps",
           [](const Sequence& sequence) {
             std::vector<std::int64_t> stamps;
             for (std::size_t i = 0; i < sequence.size(); ++i)
               stamps.push_back(sequence.stampNs(i));
             return stamps;
           })
      .def("ground_truth",
           [](const Sequence& sequence) { return fromPoses(sequence.groundTruth()); })
      .def("ground_truth_heights", &Sequence::groundTruthHeights)
      .def("__iter__", [](const std::shared_ptr<Sequence>& sequence) {
        return std::make_unique<KittiIterator>(sequence);
      });
}

/// open: () -> iterable over (image, stamp). The GIL is held only while it is called and iterated.
gsv::RepeatableDrive toDrive(const py::object& open) {
  return [open](const gsv::ImageVisitor& visit) {
    const py::gil_scoped_acquire acquire;
    for (const py::handle item : open()) {
      const auto [array, stamp_ns] = item.cast<std::pair<Bytes, std::int64_t>>();
      const cv::Mat image = toImage(array);
      const py::gil_scoped_release release;
      visit(image, stamp_ns);
    }
  };
}

py::dict toReport(const gsv::LensEstimator::Result& drive) {
  py::dict report;
  report["status"] = drive.reason.empty() ? gsv::toString(drive.status) : drive.reason.c_str();
  report["keyframes"] = drive.keyframes;
  report["tracks"] = drive.tracks;
  report["rms_before"] = drive.rms_before_px;
  report["rms_after"] = drive.rms_after_px;
  return report;
}

/// The result of ground_scale_vo calibrate, see _core.pyi.
py::dict calibrateLens(const std::vector<py::object>& drives, const CameraTuple& camera_tuple,
                       const std::array<double, 5>& distortion, double readout_time, bool is_rough,
                       const std::vector<std::string>& settings) {
  const gsv::PinholeCamera camera = makeCamera(camera_tuple);
  gsv::LensCalibration::Options options;
  if (is_rough) options.expectRoughStart(camera.width);
  options.vo.readout_time = readout_time;
  for (const std::string& setting : settings) gsv::setOption(options, setting);
  const gsv::Lens start = gsv::lensOf(
      {camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, distortion});
  std::vector<gsv::RepeatableDrive> repeatable;
  for (const py::object& drive : drives) repeatable.push_back(toDrive(drive));
  const gsv::LensCalibration calibration(options);
  gsv::LensCalibration::Result result;
  {
    const py::gil_scoped_release release;
    result = calibration.calibrate(repeatable, start);
  }
  py::list reports;
  py::dict output;
  for (const auto& drive : result.drives) {
    reports.append(toReport(drive));
    if (drive.status != gsv::LensEstimator::Status::kOk || output.contains("residuals")) continue;
    output["residuals"] = fromImage(gsv::drawResiduals(drive, camera));
  }
  output["drives"] = reports;
  output["reason"] = result.reason;
  output["runs"] = result.runs;
  output["converged"] = result.converged || result.confirmed;
  output["confirmed"] = result.confirmed;
  gsv::CameraCalibration estimate = gsv::calibrationOf(result.estimate.lens);
  estimate.estimated = true;
  estimate.readout_time = options.vo.readout_time;
  const std::string table = gsv::lensTable(result);
  output["table"] = table;
  output["yaml"] = gsv::cameraYaml(estimate, "Estimated by ground_scale_vo calibrate.\n" + table);
  return output;
}

}  // namespace

PYBIND11_MODULE(_core, module) {
  py::register_exception<gsv::DataError>(module, "DataError", PyExc_ValueError);
  py::class_<Odometry>(module, "Odometry")
      .def(py::init<const CameraTuple&, double, const std::vector<std::string>&,
                    const std::optional<Bytes>&, bool>())
      .def("process", &Odometry::process)
      .def("poses", &Odometry::poses)
      .def("metrics", &Odometry::metrics)
      .def("write", &Odometry::write);
  addKitti(&module);
  module.def("calibrate_lens", &calibrateLens);
  module.def("require_new_file",
             [](const std::string& file, bool force) { gsv::requireNewFile(file, force); });
  module.def("write_file", [](const std::string& file, const py::bytes& content) {
    gsv::writeFile(file, std::string(content));
  });
}
