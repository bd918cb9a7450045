#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <string>

namespace ground_scale_vo {

/// An image as it is stored.
struct StoredImage {
  std::int64_t stamp_ns = 0;
  cv::Mat pixels;        ///< of 8 or 16 bits; empty with an error
  std::string encoding;  ///< of the pixels, for GreyConverter::convert()
  std::string error;     ///< why there are no pixels
};

/// The images of a drive in their order: a folder, a video, or a topic of a bag.
class ImageSource {
 public:
  virtual ~ImageSource() = default;
  /// For messages: folder, file or topic.
  virtual const std::string& name() const = 0;
  /// Images that the folder or file declares.
  virtual std::size_t count() const = 0;
  /// A stamp of zero is that of an image without one, as in ROS messages.
  virtual bool zeroIsUnset() const { return false; }
  /// After the last image: whether fewer than count() of them were read.
  virtual bool endsEarly(std::size_t read) const { return read < count(); }
  /// Empty after the last one. Throws DataError when no further image can be read.
  virtual std::optional<StoredImage> next() = 0;
};

}  // namespace ground_scale_vo
