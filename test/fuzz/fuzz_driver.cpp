// Runs a fuzz target without libFuzzer on mutations of the inputs of Plan::corpus, reproducibly for
// a seed.
//
//   X_fuzz [--iterations N] [--seed S]
//       runs the corpus and N mutated inputs (defaults: a third of Plan::iterations, with
//       `scripts/test --long` all of them; seed 1)
//   X_fuzz FILE...
//       runs these inputs only
//
// An input that crashes the process is kept in the file X_fuzz.input.

#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>

#include "fuzz_target.hpp"
#include "support/long_tests.hpp"

namespace ground_scale_vo::fuzz {
namespace {

int iterations = -1;  // negative: as planned
std::uint64_t seed = 1;
std::vector<std::string> files;
std::string input_file;                   // keeps the input that crashes the process
const std::string* under_test = nullptr;  // the input that is being run

extern "C" void keepInput(int signal) {
  std::signal(signal, SIG_DFL);
  if (under_test != nullptr) std::ofstream(input_file, std::ios::binary) << *under_test;
  std::raise(signal);
}

void runTarget(const std::string& input) {
  under_test = &input;
  // An exact copy, so that a sanitizer detects reads beyond its end.
  const std::vector<std::uint8_t> bytes(input.begin(), input.end());
  LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
  under_test = nullptr;
}

/// Mutates inputs of a corpus, with tokens that are edge cases for parsers of numbers and of KITTI
/// files.
class Mutator {
 public:
  explicit Mutator(std::vector<std::string> corpus) : corpus_(std::move(corpus)), random_(seed) {}

  std::string next() {
    std::string input = corpus_[below(corpus_.size())];
    for (std::size_t k = below(6) + 1; k > 0; --k) mutate(&input);
    if (input.size() > kMaxSize) input.resize(kMaxSize);
    return input;
  }

 private:
  static constexpr std::size_t kMaxSize = 1u << 16;  // [bytes]

  std::size_t below(std::size_t count) { return count == 0 ? 0 : random_() % count; }

  void mutate(std::string* input) {
    static const char* const kWords[] = {
        "nan", "-inf", "1e400", "1e-400", "0",     "-0",   "-1",         "1e308", "1e19",
        "1e9", "0x1p", "1,5",   "",       "x",     "\n",   "\r\n",       " ",     "\t",
        "#",   "P0:",  "=",     "/",      "0.001", "true", "4294967296", "--",    "1e-320"};
    const std::size_t at = below(input->size() + 1);
    switch (below(6)) {
      case 0:
        if (at < input->size()) (*input)[at] ^= static_cast<char>(1u << below(8));
        break;
      case 1:
        input->erase(at, below(4) > 0 ? below(16) + 1 : std::string::npos);
        break;
      case 2:
        input->insert(at, input->substr(below(input->size() + 1), below(64) + 1));
        break;
      case 3: {
        const std::string& other = corpus_[below(corpus_.size())];
        *input = input->substr(0, at) + other.substr(below(other.size() + 1));
        break;
      }
      case 4: {  // replaces a word of a text
        const char* const blank = " \t\r\n=";
        const std::size_t begin = std::min(input->find_first_not_of(blank, at), input->size());
        const std::size_t end = std::min(input->find_first_of(blank, begin), input->size());
        input->replace(begin, end - begin, kWords[below(std::size(kWords))]);
        break;
      }
      default:
        for (std::size_t k = below(8) + 1; k > 0; --k) {
          input->insert(at, 1, static_cast<char>(random_()));
        }
    }
  }

  const std::vector<std::string> corpus_;
  std::mt19937_64 random_;
};

TEST(Fuzz, HandlesEveryInput) {
  for (const std::string& file : files) {
    std::ifstream stream(file, std::ios::binary);
    ASSERT_TRUE(stream) << file;
    runTarget({std::istreambuf_iterator<char>(stream), {}});
  }
  if (!files.empty()) return;
  const Plan target = plan();
  for (const std::string& input : target.corpus) runTarget(input);
  runTarget("");
  Mutator mutator(target.corpus);
  const int planned = runsLongTests() ? target.iterations : target.iterations / 3;
  const int count = iterations >= 0 ? iterations : planned;
  for (int i = 0; i < count; ++i) runTarget(mutator.next());
}

}  // namespace
}  // namespace ground_scale_vo::fuzz

int main(int argc, char** argv) {
  using namespace ground_scale_vo::fuzz;
  testing::InitGoogleTest(&argc, argv);
  testing::GTEST_FLAG(catch_exceptions) = false;  // an exception ends the process: input is kept
  input_file = std::filesystem::absolute(argv[0]).string() + ".input";
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    const bool has_value = i + 1 < argc;
    if (argument == "--iterations" && has_value) {
      iterations = std::atoi(argv[++i]);
    } else if (argument == "--seed" && has_value) {
      seed = std::strtoull(argv[++i], nullptr, 10);
    } else {
      files.push_back(argument);
    }
  }
  for (const int signal : {SIGABRT, SIGSEGV, SIGFPE, SIGBUS}) std::signal(signal, keepInput);
  return RUN_ALL_TESTS();
}
