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
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "ground_scale_vo/calibration/lens_calibration.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/set_option.hpp"
#include "ground_scale_vo/common/text_file.hpp"
#include "ground_scale_vo/evaluation/drive_run.hpp"
#include "ground_scale_vo/evaluation/run_progress.hpp"
#include "ground_scale_vo/evaluation/run_record.hpp"
#include "ground_scale_vo/evaluation/run_report.hpp"
#include "ground_scale_vo/input/calibration_check.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/input/camera_info.hpp"
#include "ground_scale_vo/input/encoded_image.hpp"
#include "ground_scale_vo/input/grey_converter.hpp"
#include "ground_scale_vo/io/drive_reader.hpp"
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

/// A copy: the caller may write to the array later. array: continuous, of 8 or 16 bits.
cv::Mat toImage(const py::array& array) {
  return cv::Mat(static_cast<int>(array.shape(0)), static_cast<int>(array.shape(1)),
                 array.itemsize() == 2 ? CV_16UC1 : CV_8UC1, const_cast<void*>(array.data()))
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
  const std::string warning =
      gsv::checkCalibration(gsv::calibrationOf(result), "the camera", {width, height});
  if (!warning.empty() && PyErr_WarnEx(PyExc_UserWarning, warning.c_str(), 1) != 0) {
    throw py::error_already_set();
  }
  return result;
}

CameraTuple toTuple(const gsv::PinholeCamera& c) {
  return {c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.lens_is_estimated};
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
      output = odometry_.process(grey_converter_.convert(pixels), stamp_ns);
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
  gsv::GreyConverter grey_converter_;
  std::optional<gsv::RunRecord> record_;
  std::mutex mutex_;
  std::int64_t last_stamp_ns_ = -1;
};

/// The messages of a bag, which Python reads.
class PythonImages : public gsv::ImageSource {
 public:
  /// messages: iterator over (stamp_ns, encoding or format, is_compressed, is_bigendian, height,
  /// width, step, data).
  PythonImages(std::string name, std::size_t count, py::object messages)
      : name_(std::move(name)), count_(count), messages_(std::move(messages)) {}
  ~PythonImages() override {
    const py::gil_scoped_acquire acquire;
    messages_ = {};
  }

  const std::string& name() const override { return name_; }
  std::size_t count() const override { return count_; }
  bool zeroIsUnset() const override { return true; }

  std::optional<gsv::StoredImage> next() override {
    const py::gil_scoped_acquire acquire;
    PyObject* const item = PyIter_Next(messages_.ptr());
    if (!item) {
      if (PyErr_Occurred()) {
        const py::error_already_set error;
        throw gsv::DataError(py::str(error.value()).cast<std::string>());
      }
      return std::nullopt;
    }
    return read(py::reinterpret_steal<py::tuple>(item));
  }

 private:
  static gsv::StoredImage read(const py::tuple& message) {
    gsv::StoredImage image;
    image.stamp_ns = message[0].cast<std::int64_t>();
    image.encoding = message[1].cast<std::string>();
    const std::string_view bytes = message[7].cast<std::string_view>();
    try {
      if (message[2].cast<bool>()) {
        image.pixels = gsv::decodePixels(bytes);
        image.encoding = gsv::bayerPatternOf(image.encoding);
      } else {
        image.pixels =
            gsv::pixelsOf({message[4].cast<std::uint32_t>(), message[5].cast<std::uint32_t>(),
                           image.encoding, message[3].cast<bool>(),
                           message[6].cast<std::uint32_t>(),
                           reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()})
                .clone();
      }
    } catch (const gsv::DataError& error) {
      image.error = error.what();
    }
    return image;
  }

  const std::string name_;
  const std::size_t count_;
  py::object messages_;
};

/// A drive that is read once.
struct Reader {
  std::unique_ptr<gsv::DriveReader> drive;
  gsv::GroundTruth truth;
};
using ReaderPtr = std::shared_ptr<Reader>;

ReaderPtr openFiles(const std::string& path, const std::string& camera_file, double fov_deg,
                    bool unrectified, const std::string& mask_file, double fps) {
  auto reader = std::make_shared<Reader>();
  const py::gil_scoped_release release;
  reader->drive =
      gsv::openDrive({path, camera_file, fov_deg, unrectified, {mask_file, fps}}, &reader->truth);
  return reader;
}

gsv::CameraInfo toCameraInfo(const py::dict& fields) {
  gsv::CameraInfo info;
  info.height = fields["height"].cast<std::uint32_t>();
  info.width = fields["width"].cast<std::uint32_t>();
  info.distortion_model = fields["distortion_model"].cast<std::string>();
  info.D = fields["D"].cast<std::vector<double>>();
  info.K = fields["K"].cast<std::array<double, 9>>();
  info.R = fields["R"].cast<std::array<double, 9>>();
  info.P = fields["P"].cast<std::array<double, 12>>();
  info.binning_x = fields["binning_x"].cast<std::uint32_t>();
  info.binning_y = fields["binning_y"].cast<std::uint32_t>();
  const auto roi = fields["roi"].cast<std::array<std::uint32_t, 4>>();
  info.roi = {roi[0], roi[1], roi[2], roi[3]};
  return info;
}

/// infos: iterable over the messages of info_topic; the first valid one is used.
gsv::DriveReader::Calibration calibrationIn(const py::iterable& infos,
                                            const std::string& info_topic,
                                            const std::string& image_topic, bool is_rectified,
                                            std::string* warning) {
  std::string reason = "topic " + info_topic + " has no message";
  for (const py::handle fields : infos) {
    const gsv::CameraInfo info = toCameraInfo(fields.cast<py::dict>());
    try {
      const gsv::DriveReader::Calibration calibration{
          gsv::calibrationOf(info, info_topic, is_rectified), "camera_info on topic " + info_topic};
      *warning = gsv::rectificationSentence(info, is_rectified, image_topic);
      return calibration;
    } catch (const gsv::DataError& error) {
      reason = error.what();
    }
  }
  throw gsv::DataError(reason);
}

/// The camera file, the field of view or the messages of camera_info describe the images.
ReaderPtr openMessages(const std::string& topic, std::size_t count, const py::object& messages,
                       const std::string& info_topic, const py::iterable& infos, bool is_rectified,
                       const std::string& camera_file, double fov_deg, const std::string& mask_file,
                       double fps) {
  std::string warning;
  gsv::DriveReader::Calibration calibration;
  if (fov_deg > 0) {
    calibration.fov_deg = fov_deg;
  } else if (!camera_file.empty()) {
    calibration = {gsv::readCameraFile(camera_file), camera_file};
  } else {
    calibration = calibrationIn(infos, info_topic, topic, is_rectified, &warning);
  }
  auto reader = std::make_shared<Reader>();
  reader->drive = std::make_unique<gsv::DriveReader>(
      std::make_unique<PythonImages>(topic, count, messages), calibration,
      gsv::DriveReader::Options{mask_file, fps, false});
  if (!warning.empty()) reader->drive->warn(warning);
  return reader;
}

/// The next image that can be used, rectified, and its stamp; None after the last one.
py::object nextRectified(const ReaderPtr& reader) {
  for (;;) {
    std::optional<gsv::DriveReader::Image> image;
    {
      const py::gil_scoped_release release;
      image = reader->drive->next();
      if (image && !image->given.empty()) {
        const gsv::CalibratedCamera& camera = reader->drive->camera();
        if (!camera.isGivenRectified()) image->given = camera.undistortion().image(image->given);
      }
    }
    if (!image) return py::none();
    if (!image->given.empty()) return py::make_tuple(fromImage(image->given), image->stamp_ns);
  }
}

/// Runs the odometry over a drive and writes the results.
py::dict run(const ReaderPtr& reader, const std::string& name, double camera_height,
             const std::vector<std::string>& settings, const std::string& folder, bool is_strict) {
  gsv::DriveRun result;
  {
    const py::gil_scoped_release release;
    gsv::DriveRun::Options options;
    options.odometry.scale.camera_height = camera_height;
    options.settings = settings;
    gsv::RunProgress progress(name, reader->drive->count());
    result = gsv::runDrive(reader->drive.get(), options,
                           [&](const gsv::RunFrame& frame) { progress.show(frame); });
    gsv::writeRun(folder, result, camera_height, reader->truth);
  }
  py::dict report;
  report["warnings"] = result.warnings;
  report["summary"] = result.summary();
  report["failure"] = result.failure;
  report["status"] = result.exitStatus(is_strict);
  return report;
}

void addDrives(py::module* module) {
  py::class_<Reader, ReaderPtr>(*module, "Reader")
      .def_property_readonly("count", [](const Reader& r) { return r.drive->count(); })
      .def_property_readonly("camera",
                             [](const Reader& r) { return toTuple(r.drive->camera().camera()); })
      .def_property_readonly("mask",
                             [](const Reader& r) -> py::object {
                               const cv::Mat& mask = r.drive->rectifiedMask();
                               if (mask.empty()) return py::none();
                               return fromImage(mask);
                             })
      .def_property_readonly(
          "readout_time",
          [](const Reader& r) { return r.drive->camera().calibration().readout_time; })
      .def_property_readonly("ground_truth",
                             [](const Reader& r) { return fromPoses(r.truth.poses); })
      .def_property_readonly("ground_truth_heights",
                             [](const Reader& r) { return r.truth.heights; })
      .def("next", &nextRectified)
      .def("warnings", [](const Reader& r) { return r.drive->warnings(); })
      .def("failure", [](const Reader& r) { return r.drive->failure(); });
  module->def("open_files", &openFiles);
  module->def("open_messages", &openMessages);
  module->def("camera_info_topic_of", &gsv::cameraInfoTopicOf);
  module->def("require_no_bag", [](const std::string& path) { gsv::requireNoBag(path); });
  module->def("result_name", &gsv::resultName);
  module->def("run", &run);
}

/// open: () -> Reader. The GIL is held only while it is called.
gsv::RepeatableDrive toDrive(const py::object& open, const std::string& name) {
  return [open, name, run = 0](const gsv::ImageVisitor& visit) mutable {
    ReaderPtr reader;
    {
      const py::gil_scoped_acquire acquire;
      reader = open().cast<ReaderPtr>();
    }
    {
      gsv::ProgressLine progress(name + ", run " + std::to_string(++run), reader->drive->count());
      while (const auto image = reader->drive->next()) {
        if (!image->given.empty()) visit(image->given, image->stamp_ns);
        progress.step(" images");
      }
    }
    const py::gil_scoped_acquire acquire;
    reader.reset();
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
py::dict calibrateLens(const std::vector<py::object>& drives, const std::vector<std::string>& names,
                       bool is_rough, const std::vector<std::string>& settings) {
  const auto first = drives.front()().cast<ReaderPtr>();
  const gsv::CameraCalibration given = first->drive->camera().calibration();
  if (!given.hasLens()) {
    throw gsv::DataError(names.front() + ": the distortion is " + given.describe() +
                         ", calibrate estimates plumb_bob with at most 5 coefficients; calibrate "
                         "the camera with that, or rectify the images");
  }
  const gsv::Lens start = gsv::lensOf(given);
  const gsv::PinholeCamera& camera = start.camera;
  gsv::LensCalibration::Options options;
  if (is_rough) options.expectRoughStart(camera.width);
  options.vo.readout_time = given.readout_time;
  for (const std::string& setting : settings) gsv::setOption(options, setting);
  std::vector<gsv::RepeatableDrive> repeatable;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    repeatable.push_back(toDrive(drives[i], names[i]));
  }
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
    std::vector<std::uint8_t> png;
    cv::imencode(".png", gsv::drawResiduals(drive, camera), png);
    output["residuals"] = py::bytes(reinterpret_cast<const char*>(png.data()), png.size());
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
  addDrives(&module);
  module.def("calibrate_lens", &calibrateLens);
  module.def("require_new_file",
             [](const std::string& file, bool force) { gsv::requireNewFile(file, force); });
  module.def("write_file", [](const std::string& file, const py::bytes& content) {
    gsv::writeFile(file, std::string(content));
  });
}
