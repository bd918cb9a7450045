// Runs a fuzz target on its corpus, then on mutations of it, each of which depends only on the seed
// and its number:
//
//   X_fuzz [SEED [FIRST [COUNT]]]
//
// (defaults: 1, 0, as planned by the target). A crash prints the arguments that run its input
// alone.

#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <random>

#include "fuzz_target.hpp"
#include "support/long_tests.hpp"

namespace ground_scale_vo::fuzz {
namespace {

unsigned long long seed = 1, number = 0, count = 0;  // NOLINT: of the command line

extern "C" void nameInput(int signal) {
  std::fprintf(stderr, "signal %d: reproduce it with the arguments %llu %llu 1\n", signal, seed,
               number);
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

/// Mutates inputs of a corpus, with tokens that are edge cases for parsers of numbers and of KITTI
/// files.
class Mutator {
 public:
  explicit Mutator(const std::vector<std::string>& corpus)
      : corpus_(corpus), random_(seed * 0x9E3779B97F4A7C15u + number) {}

  std::string input() {
    constexpr std::size_t kMaxSize = 1u << 16;  // [bytes]
    std::string input = corpus_[below(corpus_.size())];
    for (std::size_t k = below(6) + 1; k > 0; --k) mutate(&input);
    return input.substr(0, kMaxSize);
  }

 private:
  std::size_t below(std::size_t limit) { return random_() % limit; }

  void mutate(std::string* input) {
    static const char* const kWords[] = {
        "nan", "-inf", "1e400", "1e-400", "0",     "-0",   "-1",         "1e308", "1e19",
        "1e9", "0x1p", "1,5",   "",       "x",     "\n",   "\r\n",       " ",     "\t",
        "#",   "P0:",  "=",     "/",      "0.001", "true", "4294967296", "--",    "1e-320"};
    const std::size_t at = below(input->size() + 1);
    switch (below(5)) {
      case 0:
        if (at < input->size()) (*input)[at] ^= static_cast<char>(1u << below(8));
        break;
      case 1:
        input->erase(at, below(4) > 0 ? below(16) + 1 : std::string::npos);
        break;
      case 2: {
        const std::string& other = corpus_[below(corpus_.size())];
        *input = input->substr(0, at) + other.substr(below(other.size() + 1));
        break;
      }
      case 3: {  // replaces a word of a text
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

  const std::vector<std::string>& corpus_;
  std::mt19937_64 random_;
};

TEST(Fuzz, HandlesEveryInput) {
  Plan target = plan();
  target.corpus.emplace_back();
  if (count == 0) count = runsLongTests() ? target.inputs : target.inputs / 3;
  for (const auto end = number + count; number < end; ++number) {
    run(number < target.corpus.size() ? target.corpus[number] : Mutator(target.corpus).input());
  }
}

}  // namespace
}  // namespace ground_scale_vo::fuzz

int main(int argc, char** argv) {
  using namespace ground_scale_vo::fuzz;
  testing::InitGoogleTest(&argc, argv);
  testing::GTEST_FLAG(catch_exceptions) = false;  // an exception ends the process as a signal does
  unsigned long long* const arguments[] = {&seed, &number, &count};
  for (int i = 1; i < std::min(argc, 4); ++i) *arguments[i - 1] = std::stoull(argv[i]);
  for (const int signal : {SIGABRT, SIGSEGV, SIGFPE, SIGBUS}) std::signal(signal, nameInput);
  return RUN_ALL_TESTS();
}
