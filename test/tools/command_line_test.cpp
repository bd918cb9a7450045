#include "tools/support/command_line.hpp"

#include <gtest/gtest.h>

#include <stdexcept>
#include <string>
#include <vector>

namespace ground_scale_vo {
namespace {

struct Outcome {
  int status = 0;
  std::string out, err;
  std::string sequence, folder;
  double height = 0;
  int threads = 2;
  std::vector<std::string> settings;
};

/// A tool with one argument of each kind; run() returns `returned`, or throws with --fail.
Outcome runTool(std::vector<std::string> arguments, int returned = 0) {
  Outcome outcome;
  bool fail = false;
  CommandLine command_line("tool", "Does things.", "Exit status: 0, 1 or 2.");
  command_line.addPositional("SEQ", "a folder", &outcome.sequence);
  command_line.options().add_options()                                                 //
      ("out", requiredValue(&outcome.folder, "DIR"), "results")                        //
      ("height", po::value(&outcome.height)->value_name("M"), "height")                //
      ("threads", numberInRange("--threads", &outcome.threads, "N", 1, 8), "threads")  //
      ("set", po::value(&outcome.settings)->composing(), "settings")                   //
      ("fail", po::bool_switch(&fail), "throw");
  arguments.insert(arguments.begin(), "tool");
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  outcome.status = command_line.run(
      static_cast<int>(argv.size()), argv.data(),
      [&] {
        if (outcome.height < -1) throw OptionError("--height is below -1");
      },
      [&] {
        if (fail) throw std::runtime_error("no data");
        return returned;
      });
  outcome.out = testing::internal::GetCapturedStdout();
  outcome.err = testing::internal::GetCapturedStderr();
  return outcome;
}

TEST(CommandLine, AcceptsArgumentsInAnyOrder) {
  const Outcome outcome =
      runTool({"--set", "a=1", "--out=x", "seq", "--set", "b=2", "--height", "-0.5"});
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_EQ(outcome.sequence, "seq");
  EXPECT_EQ(outcome.folder, "x");
  EXPECT_EQ(outcome.height, -0.5);
  EXPECT_EQ(outcome.threads, 2);
  EXPECT_EQ(outcome.settings, (std::vector<std::string>{"a=1", "b=2"}));
}

TEST(CommandLine, HelpHasArgumentsAndDefaults) {
  const Outcome outcome = runTool({"--help"});
  EXPECT_EQ(outcome.status, 0);
  for (const char* text : {"usage: tool SEQ --out DIR [options]\n", "Does things.", "a folder",
                           "--threads N (=2)", "Exit status: 0, 1 or 2."}) {
    EXPECT_NE(outcome.out.find(text), std::string::npos) << text << " in\n" << outcome.out;
  }
}

TEST(CommandLine, WrongArgumentsGiveStatus2AndAOneLineMessageThatNamesThem) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases = {
      {{"--out", "x"}, "SEQ is missing"},
      {{"seq"}, "--out is missing"},
      {{"seq", "--out", ""}, "--out needs a value"},
      {{"seq", "other", "--out", "x"}, "'other'"},
      {{"seq", "--out", "x", "--nonsense"}, "--nonsense"},
      {{"seq", "--out", "x", "--height", "high"}, "--height"},
      {{"seq", "--out", "x", "--height", "-2"}, "--height is below -1"},
      {{"seq", "--out", "x", "--threads", "9"}, "--threads is 9, it must lie in [1, 8]"},
      {{"seq", "--out", "x", "--out", "y"}, "--out"}};
  for (const auto& [arguments, message] : cases) {
    const Outcome outcome = runTool(arguments);
    EXPECT_EQ(outcome.status, 2);
    EXPECT_EQ(outcome.out, "");
    EXPECT_EQ(outcome.err.find("tool: "), 0u) << outcome.err;
    EXPECT_NE(outcome.err.find(message), std::string::npos) << message << " in " << outcome.err;
    EXPECT_EQ(outcome.err.find('\n'), outcome.err.size() - 1) << outcome.err;
  }
}

TEST(CommandLine, StatusIsThatOfRunOr1WhenItThrows) {
  EXPECT_EQ(runTool({"seq", "--out", "x"}, 3).status, 3);
  const Outcome failed = runTool({"seq", "--out", "x", "--fail"});
  EXPECT_EQ(failed.status, 1);
  EXPECT_EQ(failed.err, "tool: no data\n");
}

}  // namespace
}  // namespace ground_scale_vo
