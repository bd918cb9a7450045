#include "common/files.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "support/temporary_folder.hpp"

namespace gsv {
namespace {

namespace fs = std::filesystem;

class TextFiles : public TemporaryFolder {
 protected:
  std::string readError(const fs::path& file) const {
    return dataErrorOf([&] { TextFile{file}; }, folder_);
  }
  /// The error when a file of so many bytes is written.
  std::string writeError(const std::string& name, std::size_t bytes) const {
    return dataErrorOf([&] { writeFile(folder_ / name, std::string(bytes, 'x')); }, folder_);
  }
  /// Names of the entries of the temporary folder.
  std::vector<std::string> names() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder_))
      names.push_back(entry.path().filename());
    return names;
  }
};

TEST_F(TextFiles, FullDiskKeepsThePreviousFile) {
  write("poses.txt", "of a previous run");
  for (const std::size_t bytes : {100u, 1000000u}) {  // below and above the size of a buffer
    std::string error;
    {
      const FullDisk disk(bytes / 2);
      error = writeError("poses.txt", bytes);
    }
    EXPECT_EQ(error, "/poses.txt: cannot be written, File too large");
    EXPECT_EQ(names(), std::vector<std::string>{"poses.txt"});
    EXPECT_EQ(readFile(folder_ / "poses.txt", 100), "of a previous run");
  }
  EXPECT_EQ(writeError("poses.txt", 100), "no error");
  EXPECT_EQ(readFile(folder_ / "poses.txt", 100), std::string(100, 'x'));
}

TEST_F(TextFiles, UnwritablePathsAreErrors) {
  EXPECT_EQ(writeError("none/poses.txt", 10),
            "/none/poses.txt: cannot be written, there is no folder /none");
  fs::create_directories(folder_ / "poses.txt" / "inside");
  EXPECT_EQ(writeError("poses.txt", 10), "/poses.txt: cannot be written, Is a directory");
  EXPECT_EQ(names(), std::vector<std::string>{"poses.txt"});
}

TEST_F(TextFiles, NonFilesAreRejectedWithoutBlocking) {
  EXPECT_EQ(readError(folder_), ": not a file");
  EXPECT_EQ(readError(folder_ / "none"), "/none: no such file");
  fs::create_symlink(folder_ / "none", folder_ / "link");
  EXPECT_EQ(readError(folder_ / "link"), "/link: is a link to nothing");
  ASSERT_EQ(mkfifo((folder_ / "pipe").c_str(), 0600), 0);
  EXPECT_EQ(readError(folder_ / "pipe"), "/pipe: not a file");
  fs::create_symlink("loop", folder_ / "loop");
  EXPECT_EQ(readError(folder_ / "loop"), "/loop: is a link to nothing");
  const fs::path file = write("calib.txt", "P0: 1");
  fs::resize_file(file, 100u << 20);
  EXPECT_EQ(readError(file),
            "/calib.txt: has 104857600 bytes, more than the 67108864 that are plausible");
}

}  // namespace
}  // namespace gsv
