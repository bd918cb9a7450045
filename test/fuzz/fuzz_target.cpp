#include "fuzz_target.hpp"

#include <stdlib.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>

namespace ground_scale_vo::fuzz {
namespace {

namespace fs = std::filesystem;

class Scratch {
 public:
  Scratch() {
    const fs::path memory = "/dev/shm";
    const fs::path parent = fs::is_directory(memory) ? memory : fs::temp_directory_path();
    std::string pattern = (parent / "gsv_fuzz_XXXXXX").string();
    require(mkdtemp(pattern.data()) != nullptr, "the scratch folder can be created");
    folder_ = pattern;
  }
  ~Scratch() {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  const std::string& folder() const { return folder_; }

 private:
  std::string folder_;
};

}  // namespace

void require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "check failed: %s\n", what);
  std::abort();
}

const std::string& scratchFolder() {
  static const Scratch kScratch;
  return kScratch.folder();
}

void writeScratch(const std::string& name, const std::uint8_t* data, std::size_t size) {
  std::ofstream stream(fs::path(scratchFolder()) / name, std::ios::binary | std::ios::trunc);
  stream.write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
}

double Input::number() {
  using Limits = std::numeric_limits<double>;
  constexpr double kNumbers[] = {0,
                                 -0.0,
                                 1,
                                 -1,
                                 Limits::quiet_NaN(),
                                 Limits::infinity(),
                                 -Limits::infinity(),
                                 Limits::max(),
                                 Limits::min(),
                                 Limits::denorm_min(),
                                 1e-30,
                                 1e-9,
                                 1e-3,
                                 0.5,
                                 1e3,
                                 1e6,
                                 1e9,
                                 4294967296.0,
                                 1e19,
                                 1e30,
                                 -1e30,
                                 std::numeric_limits<float>::max(),
                                 1e150,
                                 -1e300};
  constexpr std::size_t kCount = sizeof kNumbers / sizeof *kNumbers;
  const std::size_t choice = below(kCount + 8);
  return choice < kCount ? kNumbers[choice] : take<double>();
}

std::string Input::text(std::size_t max_size) {
  std::string text;
  for (std::size_t length = below(max_size + 1); length > 0; --length) text += take<char>();
  return text;
}

}  // namespace ground_scale_vo::fuzz
