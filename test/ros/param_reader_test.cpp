#include "ground_scale_vo/ros/param_reader.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "ground_scale_vo/ros/params.hpp"

namespace ground_scale_vo {
namespace {

using XmlRpc::XmlRpcValue;

/// The error message for these parameters of ScaleRecovery; empty if they are accepted.
std::string refusal(XmlRpcValue tree) {
  try {
    ParamReader reader("/car/scale_recovery", tree);
    ScaleRecoveryParams::read(reader);
  } catch (const OptionError& error) {
    return error.what();
  }
  return "";
}

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
  EXPECT_FALSE(reader.entries()[1].given);
  EXPECT_EQ(ParamReader::echo(reader.entries()[1]),
            "group/untouched = 4  [] how many, [1, 10] (default)");
}

TEST(ParamReader, RefusalsNameTheParameterAndItsRange) {
  XmlRpcValue tree;
  tree["camera_height"] = -1.0;
  EXPECT_EQ(refusal(tree),
            "parameter /car/scale_recovery/camera_height is -1, it must lie in [0.05, 100]");
  tree["camera_height"] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(refusal(tree).find("camera_height is nan"), std::string::npos);
  tree["camera_height"] = "1.65";
  EXPECT_NE(refusal(tree).find("camera_height is a string, it must be a number"),
            std::string::npos);
  tree["camera_height"] = 1.65;
  tree["random_seed"] = 1.5;
  EXPECT_NE(refusal(tree).find("random_seed is 1.5, it must be a whole number"), std::string::npos);
  tree["random_seed"] = 2;
  tree["publish_tf"] = 1;
  EXPECT_NE(refusal(tree).find("publish_tf is a number, it must be true or false"),
            std::string::npos);
  tree["publish_tf"] = false;
  tree["base_frame"] = 5;
  EXPECT_NE(refusal(tree).find("base_frame is a number, it must be a string"), std::string::npos);
  tree["base_frame"] = "base_link";
  EXPECT_EQ(refusal(tree), "");
}

TEST(ParamReader, TheCameraHeightHasNoDefault) {
  EXPECT_NE(refusal(XmlRpcValue()).find("camera_height is not set and has no default"),
            std::string::npos);
}

TEST(ParamReader, FramesMustDiffer) {
  XmlRpcValue tree;
  tree["camera_height"] = 1.65;
  tree["base_frame"] = "odom";
  EXPECT_NE(refusal(tree).find("must differ"), std::string::npos);
}

TEST(ParamReader, TheFixedFrameMustHaveAName) {
  for (const char* name : {"", "/"}) {
    XmlRpcValue tree;
    tree["camera_height"] = 1.65;
    tree["odom_frame"] = name;
    EXPECT_EQ(refusal(tree), "parameter odom_frame is empty") << name;
  }
}

TEST(ParamReader, RemovesTheLeadingSlashOfAFrameName) {
  XmlRpcValue tree;
  tree["camera_height"] = 1.65;
  tree["odom_frame"] = "/odom";
  tree["base_frame"] = "/base_link";
  ParamReader reader("/scale_recovery", tree);
  const ScaleRecoveryParams params = ScaleRecoveryParams::read(reader);
  EXPECT_EQ(params.odom_frame, "odom");
  EXPECT_EQ(params.base_frame, "base_link");
  EXPECT_EQ(ParamReader::echo(reader.entries()[1]).find("odom_frame = \"odom\" "), 0u);
  ASSERT_EQ(reader.warnings().size(), 2u);
  EXPECT_EQ(reader.warnings()[0],
            "parameter /scale_recovery/odom_frame is \"/odom\"; tf2 has no leading slash, \"odom\" "
            "is used");
  tree["base_frame"] = "odom";
  EXPECT_NE(refusal(tree), "");  // the same frame
}

TEST(ParamReader, WarnsOfUnknownNamesWithTheMostSimilarOne) {
  XmlRpcValue tree;
  tree["camera_height"] = 1.65;
  tree["odom_fram"] = "map";
  tree["tracker"]["nonsense_nobody_wrote"] = 1;
  tree["image_transport"] = "raw";  // read by the image subscriber
  ParamReader reader("/scale_recovery", tree);
  ScaleRecoveryParams::read(reader);
  const std::vector<std::string> warnings = reader.warnings();
  ASSERT_EQ(warnings.size(), 2u);
  EXPECT_EQ(warnings[0],
            "parameter /scale_recovery/odom_fram is unknown and has no effect; did you mean "
            "/scale_recovery/odom_frame?");
  EXPECT_EQ(warnings[1],
            "parameter /scale_recovery/tracker/nonsense_nobody_wrote is unknown and has no "
            "effect");
}

}  // namespace
}  // namespace ground_scale_vo
