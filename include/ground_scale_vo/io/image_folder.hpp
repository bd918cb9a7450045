#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace gsv {

/// Files in the order of the numbers in their names, such as frame7.png, frame12.png.
struct NumberedFiles {
  std::vector<std::filesystem::path> files;
  /// The number in each name that varies, if only one does; else empty.
  std::vector<std::uint64_t> numbers;
  std::string warning;  ///< about missing numbers, or empty
};

/// The files of a folder with one of these extensions (lower case, with a dot; names may have upper
/// case). Hidden files and names without a number are left out. Throws DataError that names the
/// folder and a file: no such file (it names files of other image types), two with the same number,
/// or names that differ in more than their numbers, as of two cameras.
NumberedFiles numberedFiles(const std::filesystem::path& folder,
                            const std::vector<std::string>& extensions);
/// The images of a folder: PNG and JPEG.
NumberedFiles imageFiles(const std::filesystem::path& folder);

/// The line of each image, from 0, in a file with this many. With more lines than images the number
/// in the name of an image is that of its line, as in a part of a KITTI sequence. Empty: not known.
std::optional<std::vector<std::size_t>> linesOf(const NumberedFiles& images, std::size_t lines);

/// The stamps [ns] in a text file with one number a line: seconds, milliseconds,
/// microseconds or nanoseconds, whichever gives a plausible frame rate; of the three columns of
/// TUM's times.txt the second one; of EuRoC's data.csv the first one; or times such as 2011-09-26
/// 13:02:25.964389445 (UTC). Lines that begin with # are ignored. Throws DataError that names file
/// and line.
std::vector<std::int64_t> readStamps(const std::filesystem::path& file);
/// The same of each image. Throws DataError: linesOf() does not know them.
std::vector<std::int64_t> readImageStamps(const std::filesystem::path& file,
                                          const NumberedFiles& images);

/// The number of nanoseconds in the unit of stamps: seconds, milliseconds, microseconds or
/// nanoseconds, whichever gives a median interval between these [s]. 0: none does.
long double nanosecondsPerUnit(const std::vector<long double>& stamps, long double min_interval,
                               long double max_interval);

/// [s] In 1985: later stamps are times since 1970, earlier ones times since the start of a drive.
constexpr double kEarliestEpoch = 5e8;

}  // namespace gsv
