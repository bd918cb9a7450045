#include "ground_scale_vo/io/text_file.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "ground_scale_vo/evaluation/run_report.hpp"
#include "support/temporary_folder.hpp"

namespace ground_scale_vo {
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
  /// Of the entries of the temporary folder.
  std::vector<std::string> names() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder_))
      names.push_back(entry.path().filename());
    return names;
  }
};

TEST_F(TextFiles, FullDiskKeepsThePreviousFile) {
  write("poses.txt", "of a previous run");
  for (const std::size_t bytes : {100u, 5000u, 1000000u}) {  // below and above the size of a buffer
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

TEST_F(TextFiles, EveryFileOfARunIsCompleteOrMissing) {
  RunRecord record;
  for (std::uint32_t i = 0; i < 100; ++i) {
    VisualOdometry::Output vo;
    vo.frame.sequence = i;
    record.append(vo, {});
  }
  writeRun(folder_ / "complete", record, 1.65, {});
  std::size_t failed = 0;
  for (rlim_t bytes = 0; bytes < 40000; bytes += 500) {
    const fs::path folder = folder_ / "partial";
    std::string error;
    {
      const FullDisk disk(bytes);
      error = dataErrorOf([&] { writeRun(folder, record, 1.65, {}); }, folder_);
    }
    failed += error != "no error";
    for (const auto& entry : fs::directory_iterator(folder)) {
      const fs::path complete = folder_ / "complete" / entry.path().filename();
      ASSERT_TRUE(fs::exists(complete)) << entry.path();
      if (complete.filename() == "metrics.json") continue;  // its peak_rss_mb varies
      EXPECT_EQ(fs::file_size(entry.path()), fs::file_size(complete)) << entry.path();
    }
    fs::remove_all(folder);
  }
  // Of 80 size limits, the lowest are too small for some file, the highest for none.
  EXPECT_GT(failed, 10u);
  EXPECT_LT(failed, 80u);
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
}

TEST_F(TextFiles, TooLargeFilesAreNotRead) {
  const fs::path file = write("calib.txt", "P0: 1");
  fs::resize_file(file, 100u << 20);
  EXPECT_EQ(readError(file),
            "/calib.txt: has 104857600 bytes, more than the 67108864 that are plausible");
}

TEST_F(TextFiles, LinesOfMillionsOfNumbersAreRejected) {
  std::string line = "P0:";
  for (int i = 0; i < 5000000; ++i) line += " 1";
  // Words beyond the twelfth are counted, not parsed.
  const TextFile text(write("calib.txt", line + " x"));
  EXPECT_EQ(dataErrorOf([&] { text.numbers(text.lineOf("P0:"), 12, 1); }, folder_),
            "/calib.txt, line 1: has 5000001 numbers instead of 12");
}

TEST_F(TextFiles, TextThatIsNoFiniteDoubleIsRejected) {
  for (const char* word : {"1e400", "-1e400", "inf", "nan", "1e", "0x10", "1,5", "--1", "1.2.3"}) {
    const TextFile text(write("p.txt", word));
    EXPECT_EQ(dataErrorOf([&] { text.numbers(0, 1); }, folder_),
              "/p.txt, line 1: '" + std::string(word) + "' is not a finite number");
  }
}

}  // namespace
}  // namespace ground_scale_vo
