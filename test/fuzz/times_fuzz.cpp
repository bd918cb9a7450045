// times.txt of a KITTI folder.

#include "sequence_files.hpp"

namespace ground_scale_vo::fuzz {

Plan plan() {
  return {20000,
          {"0.000000e+00\n1.037360e-01\n2.073340e-01\n", "1317042145.964389445\n1317042146.06\r\n",
           "-3\n4e2\n\n"}};
}

}  // namespace ground_scale_vo::fuzz

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  ground_scale_vo::fuzz::readSequenceWith("times.txt", data, size);
  return 0;
}
