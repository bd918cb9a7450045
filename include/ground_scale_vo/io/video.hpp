#pragma once

#include <filesystem>
#include <memory>

#include "ground_scale_vo/io/image_source.hpp"

namespace ground_scale_vo {

/// The images of a video, as OpenCV decodes them with FFmpeg: grey, turned as its metadata say.
/// Stamps are those of the video; phones record with a variable rate. Throws DataError.
std::unique_ptr<ImageSource> openVideo(const std::filesystem::path& file);

}  // namespace ground_scale_vo
