// The option --set GROUP/NAME=VALUE of the tools.

#include "fuzz_target.hpp"
#include "ground_scale_vo/common/error.hpp"
#include "ground_scale_vo/common/set_option.hpp"
#include "ground_scale_vo/evaluation/offline_run.hpp"

namespace ground_scale_vo::fuzz {

Plan plan() {
  return {20000,
          {"tracker/cell_size=0.03", "refine=false", "random_seed=7", "gpe/min_points=12",
           "direct/patch_size = 1", "bundle_adjustment/window=5"}};
}

}  // namespace ground_scale_vo::fuzz

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ground_scale_vo;
  const std::string text(reinterpret_cast<const char*>(data), size);
  OfflineRun::Options options;
  try {
    setOption(options, text);
  } catch (const OptionError&) {
    return 0;
  }
  // An option within its range may still contradict another one.
  try {
    options.validate();
  } catch (const OptionError&) {
  }
  return 0;
}
