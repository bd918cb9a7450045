#pragma once

#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

namespace ground_scale_vo {

/// Decodes a JPEG or PNG image without the plugin of image_transport, which Debian lacks. Encoding
/// of the result: mono8, mono16, bgr8, bgra8 …, or the Bayer pattern that `format` names. Throws
/// MessageError when the data are truncated or cannot be decoded, or for an implausible size.
sensor_msgs::ImagePtr decode(const sensor_msgs::CompressedImage& image);

}  // namespace ground_scale_vo
