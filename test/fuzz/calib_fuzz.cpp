// calib.txt of a KITTI folder.

#include "sequence_files.hpp"

namespace ground_scale_vo::fuzz {

Plan plan() {
  return {/*iterations=*/20000,
          {"P0: 7.188560000000e+02 0.000000000000e+00 6.071928000000e+02 0.000000000000e+00 "
           "0.000000000000e+00 7.188560000000e+02 1.852157000000e+02 0.000000000000e+00 "
           "0.000000000000e+00 0.000000000000e+00 1.000000000000e+00 0.000000000000e+00\n",
           "P1: 1 2 3\nP0: 10 0 8 0 0 10 6 0 0 0 1 0\r\nTr: x\n"}};
}

}  // namespace ground_scale_vo::fuzz

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  ground_scale_vo::fuzz::readSequenceWith("calib.txt", data, size);
  return 0;
}
