#include "ground_scale_vo/ros/param_reader.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "ground_scale_vo/ros/params.hpp"

namespace ground_scale_vo {
namespace {

using XmlRpc::XmlRpcValue;

TEST(ParamReader, KeepsDefaultsAndReadsWhatIsGiven) {
  XmlRpcValue tree;
  tree["group"]["count"] = 7;
  tree["ratio"] = 1;  // a whole number is a number
  tree["name"] = "abc";
  tree["flag"] = true;
  int count = 3, untouched = 4;
  double ratio = 0.5;
  std::string name = "x";
  bool flag = false;
  ParamReader reader("/n", tree);
  reader.declare("group/count", count, 1, 10, "[] how many");
  reader.declare("group/untouched", untouched, 1, 10, "[] how many");
  reader.declare("ratio", ratio, 0, 1, "[] of all");
  reader.declare("name", name, "[] of it");
  reader.declare("flag", flag, "[] on");
  EXPECT_EQ(count, 7);
  EXPECT_EQ(untouched, 4);
  EXPECT_EQ(ratio, 1.0);
  EXPECT_EQ(name, "abc");
  EXPECT_TRUE(flag);
  EXPECT_TRUE(reader.warnings().empty());
  ASSERT_EQ(reader.entries().size(), 5u);
  EXPECT_EQ(ParamReader::echo(reader.entries()[0]), "group/count = 7  [] how many, [1, 10]");
  EXPECT_EQ(ParamReader::echo(reader.entries()[1]),
            "group/untouched = 4  [] how many, [1, 10] (default)");
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
  try {
    ScaleRecoveryParams::read(reader);
    ADD_FAILURE() << "accepted: " << reason;
  } catch (const OptionError& error) {
    EXPECT_NE(std::string(error.what()).find(reason), std::string::npos)
        << error.what() << "; expected: " << reason;
  }
}

TEST(ParamReader, RefusalsNameTheParameterAndItsRange) {
  expectRefused("camera_height", -1.0,
                "parameter /car/scale_recovery/camera_height is -1, it must lie in [0.05, 100]");
  expectRefused("camera_height", std::nan(""), "camera_height is nan");
  expectRefused("camera_height", "1.65", "camera_height is a string, it must be a number");
  expectRefused("random_seed", 1.5, "random_seed is 1.5, it must be a whole number");
  expectRefused("publish_tf", 1, "publish_tf is a number, it must be true or false");
  expectRefused("base_frame", 5, "base_frame is a number, it must be a string");
  expectRefused("base_frame", "odom", "must differ");
  expectRefused("base_frame", "/odom", "must differ");
  expectRefused("odom_frame", "", "odom_frame is empty");
  expectRefused("odom_frame", "/", "odom_frame is empty");
  ParamReader without_height("/n", XmlRpcValue());
  EXPECT_THROW(ScaleRecoveryParams::read(without_height), OptionError);
}

TEST(ParamReader, RemovesTheLeadingSlashOfAFrameName) {
  XmlRpcValue tree = validTree();
  tree["odom_frame"] = "/map";
  tree["base_frame"] = "/base_link";
  ParamReader reader("/scale_recovery", tree);
  const ScaleRecoveryParams params = ScaleRecoveryParams::read(reader);
  EXPECT_EQ(params.odom_frame, "map");
  EXPECT_EQ(params.base_frame, "base_link");
  EXPECT_EQ(ParamReader::echo(reader.entries()[1]).find("odom_frame = \"map\" "), 0u);
  ASSERT_EQ(reader.warnings().size(), 2u);
  EXPECT_NE(reader.warnings()[0].find("/scale_recovery/odom_frame is \"/map\""), std::string::npos);
}

TEST(ParamReader, WarnsOfUnknownNamesWithTheMostSimilarOne) {
  XmlRpcValue tree = validTree();
  tree["odom_fram"] = "map";
  tree["tracker"]["nonsense_nobody_wrote"] = 1;
  tree["image_transport"] = "raw";     // read by the image subscriber
  tree["direct"]["patch_size"] = 0.1;  // of the offline tools
  ParamReader reader("/scale_recovery", tree);
  ScaleRecoveryParams::read(reader);
  const std::vector<std::string> warnings = reader.warnings();
  ASSERT_EQ(warnings.size(), 3u);
  EXPECT_EQ(warnings[0].find("parameter /scale_recovery/direct/patch_size is not a ROS "), 0u);
  EXPECT_EQ(warnings[1],
            "parameter /scale_recovery/odom_fram is unknown and has no effect; did you mean "
            "/scale_recovery/odom_frame?");
  EXPECT_EQ(warnings[2],
            "parameter /scale_recovery/tracker/nonsense_nobody_wrote is unknown and has no "
            "effect");
}

}  // namespace
}  // namespace ground_scale_vo
