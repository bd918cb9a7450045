// rostests NAME [option of GoogleTest...]: runs the tests of NAME.cpp.

#include <gtest/gtest.h>
#include <ros/ros.h>

#include <filesystem>
#include <iostream>
#include <string>

namespace ground_scale_vo {
namespace {

/// Adds the tests of all other files to those that --gtest_filter or GTEST_FILTER excludes. False
/// if NAME.cpp has no tests, or a test suite of it is in another file, too.
bool selectTestsOf(const std::string& name) {
  std::string& filter = testing::GTEST_FLAG(filter);
  const testing::UnitTest& all = *testing::UnitTest::GetInstance();
  bool found = false;
  for (int i = 0; i < all.total_test_suite_count(); ++i) {
    const testing::TestSuite& suite = *all.GetTestSuite(i);
    int in_file = 0;
    for (int k = 0; k < suite.total_test_count(); ++k) {
      in_file += std::filesystem::path(suite.GetTestInfo(k)->file()).stem() == name;
    }
    if (in_file == 0) {
      // Patterns after the only '-' exclude tests.
      filter += filter.find('-') == std::string::npos ? '-' : ':';
      filter += std::string(suite.name()) + ".*";
    } else if (in_file < suite.total_test_count()) {
      std::cerr << "rostests: the test suite " << suite.name() << " is in several files\n";
      return false;
    } else {
      found = true;
    }
  }
  if (!found) std::cerr << "rostests: there are no tests of \"" << name << ".cpp\"\n";
  return found;
}

}  // namespace
}  // namespace ground_scale_vo

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  const std::string name = argc > 1 ? argv[1] : "";
  if (!ground_scale_vo::selectTestsOf(name)) return 2;
  if (testing::GTEST_FLAG(list_tests)) return RUN_ALL_TESTS();  // without a master
  ros::init(argc, argv, name);
  ros::AsyncSpinner spinner(2);
  spinner.start();
  return RUN_ALL_TESTS();
}
