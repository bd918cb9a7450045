#include "ros/params.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

#include "support/expect_throws.hpp"

namespace ground_scale_vo {
namespace {

using XmlRpc::XmlRpcValue;

TEST(ParamReader, ExpandsTheHomeFolderOfFiles) {
  XmlRpcValue tree;
  tree["mask"] = "~/mask.png";
  tree["camera_file"] = "/a/~/camera.yaml";
  ParamReader reader("/n", tree);
  const MonoVoParams params = MonoVoParams::read(reader);
  EXPECT_EQ(params.mask, std::string(std::getenv("HOME")) + "/mask.png");
  EXPECT_EQ(params.camera_file, "/a/~/camera.yaml");
}

XmlRpcValue validTree() {
  XmlRpcValue tree;
  tree["camera_height"] = 1.65;
  return tree;
}

template <typename Value>
void expectRefused(const char* name, const Value& value, const std::string& reason) {
  XmlRpcValue tree = validTree();
  tree[name] = value;
  ParamReader reader("/car/scale_recovery", tree);
  expectThrows<OptionError>([&] { ScaleRecoveryParams::read(reader); }, reason);
}

TEST(MonoVoParams, KnowWhetherTheReadoutTimeIsGiven) {
  XmlRpcValue tree;
  for (const bool given : {false, true}) {
    ParamReader reader("/mono_vo", tree);
    EXPECT_EQ(MonoVoParams::read(reader).readout_time_is_given, given);
    tree["odometry"]["readout_time"] = 0.0;
  }
}

TEST(ParamReader, RefusalsNameTheParameterAndItsRange) {
  expectRefused("camera_height", -1.0,
                "parameter /car/scale_recovery/camera_height is -1, it must lie in [0.05, 100]");
  expectRefused("camera_height", std::nan(""), "nan");
  expectRefused("camera_height", "high", "camera_height: 'high' is not a number");
  expectRefused("random_seed", 1.5, "random_seed: '1.5' is not an integer");
  expectRefused("publish_tf", 1, "publish_tf is '1', it must be true or false");
  expectRefused("base_frame", "/odom", "must differ");
  expectRefused("odom_frame", "/", "odom_frame is empty");
}

TEST(ParamReader, WarnsOfSlashesInFrameNamesAndOfUnknownNames) {
  XmlRpcValue tree = validTree();
  tree["odom_frame"] = "/map";
  tree["base_fram"] = "b";
  tree["tracker"]["nonsense_nobody_wrote"] = 1;
  ParamReader reader("/scale_recovery", tree);
  EXPECT_EQ(ScaleRecoveryParams::read(reader).odom_frame, "map");
  EXPECT_EQ(ParamReader::echo(reader.entries()[1]).find("odom_frame = \"map\" "), 0u);
  std::string warnings;
  for (const std::string& warning : reader.warnings()) warnings += warning + '\n';
  for (const char* part :
       {"/scale_recovery/odom_frame is \"/map\"",
        "parameter /scale_recovery/base_fram is unknown and has no effect; did you mean "
        "/scale_recovery/base_frame?\n",
        "parameter /scale_recovery/tracker/nonsense_nobody_wrote is unknown and has no effect\n"}) {
    EXPECT_NE(warnings.find(part), std::string::npos) << warnings;
  }
  EXPECT_EQ(reader.warnings().size(), 3u) << warnings;
}

}  // namespace
}  // namespace ground_scale_vo
