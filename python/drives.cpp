// Drives of the module ground_scale_vo._core: files, the messages of a bag, and what is computed
// from them. Only the Python files of ground_scale_vo call these functions.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "arrays.hpp"
#include "common/files.hpp"
#include "ground_scale_vo/calibration/lens_calibration.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/options.hpp"
#include "ground_scale_vo/evaluation/clock_offset.hpp"
#include "ground_scale_vo/evaluation/drive_run.hpp"
#include "ground_scale_vo/evaluation/progress_line.hpp"
#include "ground_scale_vo/evaluation/speed_file.hpp"
#include "ground_scale_vo/input/camera_file.hpp"
#include "ground_scale_vo/input/image.hpp"
#include "input/camera_input.hpp"
#include "scale/road.hpp"

namespace {

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

/// The messages of a bag, which Python reads.
class PythonImages : public gsv::ImageSource {
 public:
  /// messages: iterator over images (stamp_ns, encoding or format, is_compressed, is_bigendian,
  /// height, width, step, data, frame_id) and dictionaries with the fields of camera_info.
  /// span: () -> span().
  PythonImages(std::string name, std::size_t count, py::object messages, py::object span)
      : name_(std::move(name)),
        count_(count),
        messages_(std::move(messages)),
        span_(std::move(span)) {}
  ~PythonImages() override {
    const py::gil_scoped_acquire acquire;
    messages_ = {};
    span_ = {};
  }

  const std::string& name() const override { return name_; }
  std::size_t count() const override { return count_; }
  bool zeroIsUnset() const override { return true; }
  std::optional<Span> span() const override {
    const py::gil_scoped_acquire acquire;
    return span_().cast<Span>();
  }

  std::optional<gsv::StoredImage> next() override {
    const py::gil_scoped_acquire acquire;
    std::vector<std::shared_ptr<const gsv::CameraInfo>> infos;
    while (const py::object message = nextMessage()) {
      if (py::isinstance<py::tuple>(message)) {
        gsv::StoredImage image = read(message);
        image.camera_infos = std::move(infos);
        return image;
      }
      infos.push_back(std::make_shared<const gsv::CameraInfo>(toCameraInfo(message)));
    }
    return std::nullopt;
  }
  void skip() override {
    const py::gil_scoped_acquire acquire;
    while (const py::object message = nextMessage()) {
      if (py::isinstance<py::tuple>(message)) return;
    }
  }

 private:
  /// Null after the last one.
  py::object nextMessage() {
    PyObject* const message = PyIter_Next(messages_.ptr());
    if (!message && PyErr_Occurred()) {
      const py::error_already_set error;
      throw gsv::DataError(py::str(error.value()).cast<std::string>());
    }
    return py::reinterpret_steal<py::object>(message);
  }

  static gsv::StoredImage read(const py::tuple& message) {
    gsv::StoredImage image;
    image.stamp_ns = message[0].cast<std::int64_t>();
    image.encoding = message[1].cast<std::string>();
    image.frame_id = message[8].cast<std::string>();
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
  py::object messages_, span_;
};

/// A drive that is read once.
struct Reader {
  std::unique_ptr<gsv::DriveReader> drive;
  gsv::GroundTruth truth = {};
  gsv::Undistortion undistortion{drive->camera(), drive->mask()};
};
using ReaderPtr = std::shared_ptr<Reader>;

ReaderPtr openFiles(const std::string& path, const std::string& camera_file, double fov_deg,
                    bool unrectified, const std::string& mask_file, double fps) {
  const py::gil_scoped_release release;
  gsv::GroundTruth truth;
  auto drive = gsv::openDrive({path, camera_file, fov_deg, unrectified, {mask_file, fps}}, &truth);
  return std::make_shared<Reader>(Reader{std::move(drive), std::move(truth)});
}

/// infos: iterable over the messages of info_topic; the first valid one is used.
gsv::DriveReader::Calibration calibrationIn(const py::iterable& infos,
                                            const std::string& info_topic,
                                            const std::string& image_topic, bool is_rectified,
                                            std::string* warning) {
  std::string reason = "topic " + info_topic + " has no message";
  gsv::CameraInput input(is_rectified);
  for (const py::handle fields : infos) {
    const gsv::CameraInfo info = toCameraInfo(fields.cast<py::dict>());
    try {
      input.setCameraInfo(info, info_topic, image_topic);
    } catch (const gsv::DataError& error) {
      reason = error.what();
      continue;
    }
    *warning = input.warning();
    if (!gsv::rectificationContradiction(info, is_rectified, image_topic).is_certain) {
      return {input.camera() ? *input.camera() : *input.unsized(),
              "camera_info on topic " + info_topic, 0, info_topic, is_rectified};
    }
    reason = *warning;
    break;
  }
  throw gsv::DataError(reason);
}

/// The camera file, the field of view or the messages of camera_info describe the images.
ReaderPtr openMessages(const std::string& topic, std::size_t count, const py::object& messages,
                       const py::object& span, const std::string& info_topic,
                       const py::iterable& infos, bool is_rectified, const std::string& camera_file,
                       double fov_deg, const std::string& mask_file, double fps) {
  std::string warning;
  gsv::DriveReader::Calibration calibration;
  if (fov_deg > 0) {
    calibration.fov_deg = fov_deg;
  } else if (!camera_file.empty()) {
    calibration.camera = gsv::readCameraFile(camera_file);
    calibration.source = camera_file;
  } else {
    calibration = calibrationIn(infos, info_topic, topic, is_rectified, &warning);
  }
  auto drive = std::make_unique<gsv::DriveReader>(
      std::make_unique<PythonImages>(topic, count, messages, span), calibration,
      gsv::DriveReader::Options{mask_file, fps, false});
  if (!warning.empty()) drive->warn(warning);
  return std::make_shared<Reader>(Reader{std::move(drive)});
}

/// The next image that can be used, rectified, and its stamp; None after the last one.
py::object nextRectified(const ReaderPtr& reader) {
  std::optional<gsv::DriveReader::Image> image;
  {
    const py::gil_scoped_release release;
    image = reader->drive->nextOfCamera();
    if (image) image->grey = reader->undistortion.image(image->grey).grey;
  }
  if (!image) return py::none();
  return py::make_tuple(fromImage(image->grey), image->stamp_ns);
}

/// DriveReader::imagesAt(), None for an empty one.
py::list imagesAt(const ReaderPtr& reader, const std::vector<std::size_t>& numbers) {
  std::vector<cv::Mat> images;
  {
    const py::gil_scoped_release release;
    images = reader->drive->imagesAt(numbers);
  }
  py::list list;
  for (const cv::Mat& image : images) {
    list.append(image.empty() ? py::object(py::none()) : py::object(fromImage(image)));
  }
  return list;
}

/// open: () -> Reader. The GIL is held only while it is called. camera: of the images' size, else
/// the drive throws DataError.
gsv::RepeatableDrive toDrive(const py::object& open, const std::string& name,
                             const gsv::CameraCalibration& camera) {
  return [open, name, camera, run = 0](const gsv::ImageVisitor& visit) mutable {
    ReaderPtr reader;
    {
      const py::gil_scoped_acquire acquire;
      reader = open().cast<ReaderPtr>();
    }
    const gsv::CameraCalibration& own = reader->drive->camera();
    gsv::checkCalibration(camera, "the calibration of the first drive", {own.width, own.height});
    {
      gsv::ProgressLine progress(name + ", run " + std::to_string(++run), reader->drive->count());
      while (const auto image = reader->drive->nextOfCamera()) {
        visit(image->grey, image->stamp_ns);
        progress.step(" images");
      }
    }
    const py::gil_scoped_acquire acquire;
    reader.reset();
  };
}

/// N x 6 x 6: RunFrame::covariance; NaN without a metric pose.
Reals covariancesOf(const std::vector<gsv::RunFrame>& frames) {
  Reals array({static_cast<py::ssize_t>(frames.size()), py::ssize_t{6}, py::ssize_t{6}});
  for (std::size_t i = 0; i < frames.size(); ++i) {
    Eigen::Map<gsv::Matrix6d> row(array.mutable_data(static_cast<py::ssize_t>(i)));
    row.setConstant(std::numeric_limits<double>::quiet_NaN());
    if (frames[i].has_metric_pose) row = frames[i].covariance;
  }
  return array;
}

/// Runs the odometry over a drive, shows the progress and writes the results. open: () -> Reader.
/// is_smooth: DriveRun::Options::smooth, with lensOfDrive(). is_rough: of lensOfDrive(). Returns
/// the covariances of the poses, warnings, summary, failure and exit status.
py::dict run(const py::object& open, const std::string& name, double camera_height,
             const std::vector<std::string>& settings, const std::vector<gsv::SpeedSample>& speeds,
             double speed_offset, const std::string& folder, bool is_smooth, bool is_rough,
             bool is_strict) {
  const auto reader = open().cast<ReaderPtr>();
  const gsv::RepeatableDrive images = toDrive(open, name + ", lens", reader->drive->camera());
  gsv::DriveRun result;
  {
    const py::gil_scoped_release release;
    gsv::DriveRun::Options options;
    options.odometry.scale.camera_height = camera_height;
    options.settings = settings;
    options.speeds = speeds;
    options.speed_offset = speed_offset;
    options.smooth = is_smooth;
    if (is_smooth || is_rough) {
      options.lens = gsv::lensOfDrive(images, *reader->drive, options, is_rough);
    }
    gsv::RunProgress progress(name, reader->drive->count());
    result = gsv::runDrive(reader->drive.get(), options,
                           [&](const gsv::RunFrame& frame) { progress.show(frame); });
    gsv::writeRun(folder, result, camera_height, reader->truth);
  }
  py::dict report;
  report["covariances"] = covariancesOf(result.record.frames());
  report["warnings"] = result.warnings;
  report["summary"] = result.summary();
  report["failure"] = result.failure;
  report["status"] = result.exitStatus(is_strict);
  return report;
}

/// gsv::clockOffset() of N stamps [s] and speeds each: (offset_s, sigma_s), or None.
py::object clockOffset(const std::vector<double>& stamps, const std::vector<double>& speeds,
                       const std::vector<double>& other_stamps,
                       const std::vector<double>& other_speeds) {
  const auto samples = [](const std::vector<double>& times, const std::vector<double>& values) {
    std::vector<gsv::SpeedSample> result;
    for (std::size_t i = 0; i < times.size(); ++i) {
      result.push_back({std::llround(1e9 * times[i]), values.at(i), 0});
    }
    return result;
  };
  const auto offset =
      gsv::clockOffset(samples(stamps, speeds), samples(other_stamps, other_speeds));
  if (!offset) return py::none();
  return py::make_tuple(offset->offset_s, offset->sigma_s);
}

/// Prints the estimates of the drives. Throws DataError when the lens is not observable.
void show(const gsv::LensCalibration::Result& result, const std::vector<std::string>& names) {
  for (std::size_t i = 0; i < result.drives.size(); ++i) {
    const gsv::LensEstimator::Result& drive = result.drives[i];
    std::printf("%s: %s, %zu keyframes, %zu tracks, residual rms %.3f -> %.3f px\n",
                names[i].c_str(),
                drive.reason.empty() ? gsv::toString(drive.status) : drive.reason.c_str(),
                drive.keyframes, drive.tracks, drive.rms_before_px, drive.rms_after_px);
  }
  if (!result.reason.empty()) {
    throw gsv::DataError("the lens is not observable: " + result.reason);
  }
  std::printf("%s", gsv::lensTable(result).c_str());
  if (result.confirmed) {
    std::printf(
        "the drives confirm the calibration: the estimate does not differ significantly from it\n");
  } else if (!result.converged) {
    std::fprintf(stderr,
                 "the estimate still changed in run %d; run again with the result as --camera\n",
                 result.runs);
  }
}

/// The mean residuals over the image of the first drive that observes the lens, as PNG.
std::string residualImage(const gsv::LensCalibration::Result& result,
                          const gsv::PinholeCamera& camera) {
  const auto drive = std::find_if(result.drives.begin(), result.drives.end(), [](const auto& one) {
    return one.status == gsv::LensEstimator::Status::kOk;
  });
  return gsv::encodePng(gsv::drawResiduals(*drive, camera));
}

/// Estimates the lens from drives, functions that open the same drive at each call; the first one
/// has the calibration. is_rough: it is from a field of view that may be wrong by 15 %. Prints the
/// result and writes it to the file, with an image of the residuals beside it. Throws DataError
/// when the drives do not determine the lens.
void calibrateLens(const std::vector<py::object>& drives, const std::vector<std::string>& names,
                   bool is_rough, const std::vector<std::string>& settings, const std::string& file,
                   bool force) {
  const std::filesystem::path image = std::filesystem::path(file).replace_extension(".png");
  if (image == file) {
    throw gsv::OptionError("--out " + file + " is the name of the image beside it, use .yaml");
  }
  for (const std::filesystem::path& output : {std::filesystem::path(file), image}) {
    gsv::requireNewFile(output, force);
  }
  const auto first = drives.front()().cast<ReaderPtr>();
  const gsv::CameraCalibration given = first->drive->camera();
  const gsv::Lens start = gsv::lensOf(given);
  gsv::LensCalibration::Options options;
  options.is_rough = is_rough;
  options.vo.readout_time = given.readout_time;
  for (const std::string& setting : settings) gsv::setOption(options, setting);
  std::vector<gsv::RepeatableDrive> repeatable;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    repeatable.push_back(toDrive(drives[i], names[i], given));
  }
  const gsv::LensCalibration calibration(options);
  const py::gil_scoped_release release;
  const gsv::LensCalibration::Result result =
      calibration.calibrate(repeatable, start, first->drive->mask());
  show(result, names);
  gsv::CameraCalibration estimate = gsv::calibrationOf(result.estimate.lens);
  estimate.estimated = true;
  estimate.k1_sigma = result.estimate.sigmas()[3];
  estimate.readout_time = options.vo.readout_time;
  gsv::writeFile(file, gsv::cameraYaml(estimate, "Estimated by ground_scale_vo calibrate.\n" +
                                                     gsv::lensTable(result)));
  gsv::writeFile(image, residualImage(result, start.camera));
  std::printf("written to %s and %s\n", file.c_str(), image.c_str());
  std::fflush(stdout);
}

}  // namespace

void addDrives(py::module* module) {
  py::class_<Reader, ReaderPtr>(*module, "Reader")
      .def_property_readonly("count", [](const Reader& r) { return r.drive->count(); })
      .def_property_readonly("camera",
                             [](const Reader& r) { return toTuple(r.undistortion.camera()); })
      .def_property_readonly("mask",
                             [](const Reader& r) -> py::object {
                               const cv::Mat& mask = r.undistortion.mask();
                               if (mask.empty()) return py::none();
                               return fromImage(mask);
                             })
      .def_property_readonly("readout_time",
                             [](const Reader& r) { return r.drive->camera().readout_time; })
      .def_property_readonly("ground_truth",
                             [](const Reader& r) { return fromPoses(r.truth.poses); })
      .def_property_readonly("ground_truth_heights",
                             [](const Reader& r) { return r.truth.heights; })
      .def("next", &nextRectified)
      .def("images_at", &imagesAt)
      .def("warnings", [](const Reader& r) { return r.drive->warnings(); })
      .def("failure", [](const Reader& r) { return r.drive->failure(); });
  module->def("height_yaml", &gsv::heightYaml);
  module->def("mounting_comments", &gsv::mountingComments);
  module->def("pitch_of", &gsv::pitchOf);
  module->def("roll_of", &gsv::rollOf);
  module->def("open_files", &openFiles);
  module->def("open_messages", &openMessages);
  module->def("require_camera_info", [](const py::iterable& infos, const std::string& info_topic,
                                        const std::string& image_topic, bool is_rectified) {
    std::string warning;
    calibrationIn(infos, info_topic, image_topic, is_rectified, &warning);
  });
  module->def("require_no_bag", [](const std::string& path) { gsv::requireNoBag(path); });
  module->def("result_name", &gsv::resultName);
  py::class_<gsv::SpeedSample>(*module, "SpeedSample");
  module->def("read_speeds", [](const std::string& file, const std::string& unit, bool has_height) {
    return gsv::readSpeeds(file, unit, has_height);
  });
  module->def("read_velocities", &gsv::readVelocities);
  module->def("run", &run);
  module->def("clock_offset", &clockOffset);
  module->def("calibrate_lens", &calibrateLens);
}
