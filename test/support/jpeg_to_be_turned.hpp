#pragma once

#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

namespace ground_scale_vo {

/// The bytes of a JPEG file whose EXIF orientation says that a viewer should turn the image.
inline std::string jpegToBeTurned(const cv::Mat& image) {
  std::vector<unsigned char> bytes;
  cv::imencode(".jpg", image, bytes);
  const std::string exif(
      "\xff\xe1\x00\x22"                                   // APP1, 34 bytes
      "Exif\0\0MM\0\x2a\0\0\0\x08"                         // big-endian TIFF, first table at 8
      "\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0",  // one entry: orientation 6
      36);
  std::string jpeg(bytes.begin(), bytes.end());
  return jpeg.insert(2, exif);
}

}  // namespace ground_scale_vo
