// The Python module ground_scale_vo._core: the core and the evaluation with numpy arrays in place
// of cv::Mat and Eigen. ground_scale_vo/__init__.py is its only user, checks types and shapes, and
// documents the results.

#include <cmath>
#include <mutex>
#include <optional>
#include <string>

#include "arrays.hpp"
#include "common/files.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/evaluation/run_report.hpp"
#include "ground_scale_vo/input/camera.hpp"
#include "ground_scale_vo/input/image.hpp"
#include "ground_scale_vo/io/trajectory_io.hpp"

namespace {

using Output = gsv::MetricOdometry::Output;

constexpr std::int64_t kMinInterval = 1'000'000;  // [ns] of images

/// A copy: the caller may write to the array later. array: continuous, of 8 or 16 bits.
cv::Mat toImage(const py::array& array) {
  return cv::Mat(static_cast<int>(array.shape(0)), static_cast<int>(array.shape(1)),
                 array.itemsize() == 2 ? CV_16UC1 : CV_8UC1, const_cast<void*>(array.data()))
      .clone();
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
                                         const std::vector<std::string>& settings, bool record) {
  gsv::MetricOdometry::Options options;
  options.scale.record = record;
  for (const std::string& setting : settings) gsv::setOption(options, setting);
  options.scale.camera_height = camera_height;
  return options;
}

gsv::PinholeCamera makeCamera(const CameraTuple& camera) {
  const auto [width, height, fx, fy, cx, cy, lens_is_estimated] = camera;
  gsv::PinholeCamera result{width, height, fx, fy, cx, cy, lens_is_estimated};
  result.validate();
  const std::string warning =
      gsv::checkCalibration(gsv::withoutDistortion(result), "the camera", {width, height});
  if (!warning.empty() && PyErr_WarnEx(PyExc_UserWarning, warning.c_str(), 1) != 0) {
    throw py::error_already_set();
  }
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
  result["reason"] = gsv::toString(estimate.measurement);
  result["map_id"] = output.vo.frame.map_id;
  result["source"] = gsv::toString(estimate.source);
  result["speed_error"] = output.scale.speed_error;
  result["speed_warning"] = output.scale.speed_warning;
  for (const char* name :
       {"pose", "covariance", "scale", "sigma", "plane", "camera_height", "camera_height_sigma"}) {
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
  if (estimate.camera_height > 0) {
    result["camera_height"] = estimate.camera_height;
    result["camera_height_sigma"] = estimate.camera_height_sigma;
  }
  if (is_known && !estimate.n_c.isZero() && estimate.height > 0) {
    Eigen::Vector4d plane;
    plane << estimate.n_c, estimate.scale * estimate.height;
    result["plane"] = py::cast(plane);
  }
  addTracks(output, &result);
  return result;
}

/// The results of a run.
struct Record {
  gsv::RunRecord run;
  double camera_height;

  Reals poses() const { return fromPoses(run.metricPoses()); }

  std::string metrics(const std::optional<Reals>& poses,
                      const std::optional<Reals>& heights) const {
    return gsv::metricsJson(run, camera_height, toPoses(poses, "ground_truth"),
                            toHeights(heights, "ground_truth_heights"));
  }

  void write(const std::string& folder, const std::optional<Reals>& poses,
             const std::optional<Reals>& heights) const {
    gsv::writeRun(folder, run, camera_height, toPoses(poses, "ground_truth"),
                  toHeights(heights, "ground_truth_heights"));
  }
};

/// MetricOdometry, and on request the record of its run. Processes one image at a time, also when
/// several threads call it.
class Odometry {
 public:
  Odometry(const CameraTuple& camera, double camera_height,
           const std::vector<std::string>& settings, const std::optional<Bytes>& mask, bool record)
      : camera_height_(camera_height),
        odometry_(makeCamera(camera), makeOptions(camera_height, settings, record),
                  mask ? toImage(*mask) : cv::Mat()) {
    if (record) record_.emplace();
  }

  void addSpeed(std::int64_t stamp_ns, double speed, double sigma) {
    const std::lock_guard<std::mutex> lock(mutex_);
    odometry_.addSpeed({stamp_ns, speed, sigma});
  }

  py::dict process(const py::array& image_array, std::int64_t stamp_ns) {
    const cv::Mat pixels = toImage(image_array);
    Output output;
    {
      const py::gil_scoped_release release;
      const std::lock_guard<std::mutex> lock(mutex_);
      if (stamp_ns <= last_stamp_ns_) {
        throw gsv::OptionError("stamp is " + std::to_string(stamp_ns) +
                               ", it must be greater than that of the previous image, " +
                               std::to_string(last_stamp_ns_));
      }
      if (last_stamp_ns_ >= 0 && stamp_ns - last_stamp_ns_ < kMinInterval) {
        throw gsv::OptionError("stamp is only " + std::to_string(stamp_ns - last_stamp_ns_) +
                               " ns after that of the previous image: is it in milliseconds or "
                               "microseconds?");
      }
      output = odometry_.process(grey_converter_.convert(pixels), stamp_ns);
      last_stamp_ns_ = stamp_ns;
      if (record_) record_->append(output.vo, output.scale);
    }
    return toResult(output);
  }

  Record record() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return {requireRecord(), camera_height_};
  }

  Record smoothed() {
    const std::lock_guard<std::mutex> lock(mutex_);
    Record smoothed{requireRecord(), camera_height_};
    smoothed.run.smooth(odometry_.smoothed());
    return smoothed;
  }

 private:
  /// Throws OptionError without a record.
  const gsv::RunRecord& requireRecord() const {
    if (!record_) throw gsv::OptionError("record is False: MetricOdometry keeps no record");
    return *record_;
  }

  const double camera_height_;
  gsv::MetricOdometry odometry_;
  gsv::GreyConverter grey_converter_;
  std::optional<gsv::RunRecord> record_;
  std::mutex mutex_;
  std::int64_t last_stamp_ns_ = -1;
};

}  // namespace

PYBIND11_MODULE(_core, module) {
  py::register_exception<gsv::DataError>(module, "DataError", PyExc_ValueError);
  py::class_<Odometry>(module, "Odometry")
      .def(py::init<const CameraTuple&, double, const std::vector<std::string>&,
                    const std::optional<Bytes>&, bool>())
      .def("process", &Odometry::process)
      .def("add_speed", &Odometry::addSpeed)
      .def("record", &Odometry::record)
      .def("smoothed", &Odometry::smoothed);
  py::class_<Record>(module, "Record")
      .def("poses", &Record::poses)
      .def("metrics", &Record::metrics)
      .def("write", &Record::write);
  addDrives(&module);
  module.attr("__version__") = GROUND_SCALE_VO_VERSION;
  module.attr("USUAL_HEIGHTS") = py::make_tuple(gsv::kMinUsualHeight, gsv::kMaxUsualHeight);
  module.def("read_options", &gsv::readOptions);
  module.def("require_new_file",
             [](const std::string& file, bool force) { gsv::requireNewFile(file, force); });
  module.def("write_file", [](const std::string& file, const std::string& content) {
    gsv::writeFile(file, content);
  });
}
