#pragma once

#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/resource.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "ground_scale_vo/common/error.hpp"

namespace gsv {

/// Fixture with a temporary folder for each test.
class TemporaryFolder : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (std::filesystem::temp_directory_path() / "gsv_test_XXXXXX").string();
    ASSERT_NE(mkdtemp(pattern.data()), nullptr);
    folder_ = pattern;
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  /// Writes folder_/name and creates its parent folders.
  std::filesystem::path write(const std::string& name, const std::string& content) const {
    const std::filesystem::path file = folder_ / name;
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file, std::ios::binary) << content;
    return file;
  }

  std::filesystem::path folder_;
};

/// Simulates a full disk without privileges: limits the size of files that this process writes, for
/// the lifetime of the object, to `bytes`.
class FullDisk {
 public:
  explicit FullDisk(rlim_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit limit = before_;
    limit.rlim_cur = bytes;
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FullDisk() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  void (*const handler_)(int);
  rlimit before_{};
};

/// The message of the DataError that `action` throws, with the path of the folder removed;
/// "no error" if it throws none.
template <typename Action>
std::string dataErrorOf(Action action, const std::filesystem::path& folder) {
  try {
    action();
  } catch (const DataError& error) {
    std::string message = error.what();
    const std::string prefix = folder.string();
    for (auto at = message.find(prefix); at != std::string::npos; at = message.find(prefix)) {
      message.replace(at, prefix.size(), "");
    }
    return message;
  }
  return "no error";
}

/// GROUND_SCALE_VO_DATA/name; empty when the variable is unset or there is no such path.
inline std::filesystem::path dataPath(const std::string& name) {
  const char* root = std::getenv("GROUND_SCALE_VO_DATA");
  const std::filesystem::path path = root ? std::filesystem::path(root) / name : "";
  return std::filesystem::exists(path) ? path : "";
}

}  // namespace gsv
