// The master is restarted while a pair of nodelets runs. The test has its own master, on another
// port than that of rostest (--own-master).

#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>

#include "child_process.hpp"
#include "node_probe.hpp"
#include "nodelet_pair.hpp"

namespace ground_scale_vo {
namespace {

std::unique_ptr<ChildProcess> startMaster() {
  auto master = std::make_unique<ChildProcess>(std::vector<std::string>{
      "rosmaster", "--core", "-p", std::to_string(ros::master::getPort())});
  EXPECT_TRUE(waitUntil([] { return ros::master::check(); })) << master->output();
  return master;
}

TEST(Roscore, NodeletsSurviveItsRestart) {
  std::unique_ptr<ChildProcess> master = startMaster();
  ros::NodeHandle handle;
  ros::AsyncSpinner spinner(2);
  spinner.start();
  const RenderedDrive drive(smallDrive(60));
  ChildProcess manager({"rosrun", "nodelet", "nodelet", "manager", "__name:=manager"});
  const ManagerClient client("/manager");
  ASSERT_TRUE(client.waitForServices());
  auto pair = std::make_unique<NodeletPair>(client, drive, "/car");
  ASSERT_TRUE(pair->load());
  ASSERT_TRUE(pair->play(0, 19));

  // Without a master existing connections stay.
  master->send(SIGKILL);
  ASSERT_TRUE(master->waitForEnd());
  ASSERT_FALSE(ros::master::check());
  ASSERT_TRUE(pair->play(20, 39));

  // Restarted and empty: no node has registered again.
  master = startMaster();
  EXPECT_THROW(NodeProbe("/manager"), std::runtime_error);
  ASSERT_TRUE(pair->play(40, 59));
  EXPECT_NEAR(pair->displacementRatio(), 1, 0.05);
  EXPECT_TRUE(manager.running()) << manager.output();

  manager.send(SIGINT);
  EXPECT_EQ(manager.waitForEnd(), 0) << manager.output();
  EXPECT_EQ(manager.output().find("terminate called"), std::string::npos) << manager.output();

  // A manager that is started now works, and so does the camera of this test, which is advertised
  // again.
  pair.reset();
  ChildProcess again({"rosrun", "nodelet", "nodelet", "manager", "__name:=manager"});
  ASSERT_TRUE(client.waitForServices());
  NodeletPair second(client, drive, "/car");
  ASSERT_TRUE(second.load());
  ASSERT_TRUE(second.playAll());
  EXPECT_NEAR(second.displacementRatio(), 1, 0.05);
  again.send(SIGINT);
  EXPECT_EQ(again.waitForEnd(), 0) << again.output();
}

}  // namespace
}  // namespace ground_scale_vo
